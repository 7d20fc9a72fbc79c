"""What several tests share."""

import gc
import importlib.util
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings
from tiers import FILES, FULL, SHORT

import impactlab as il
from impactlab.integrators.driver import stepping
from impactlab.integrators.jumps import jumping_loop
from impactlab.kernels.from_event_to_event import located_loop

# the processes that this one starts, and those that they start, keep all cores busy
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

gc.set_threshold(50_000)  # compilers make many objects of which none is garbage yet: a seventh of their time

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # by a shell that runs tests in the background
    signal.signal(signal.SIGINT, signal.default_int_handler)

settings.register_profile("impactlab", deadline=None, derandomize=True, database=None)
settings.load_profile("impactlab")


@pytest.hookimpl(tryfirst=True)
def pytest_configure(config):
    """Choose the tier of tests, as an expression for ``-m``; workers get the one of the process that starts them."""
    named = all(item.partition("::")[0].endswith(".py") for item in config.args)
    tiers = {"": FILES if named else SHORT, "full": FULL}
    config.option.markexpr = tiers.get(config.option.markexpr, config.option.markexpr)


MANY = 1000
"""Tests of a run that needs most loops."""


@pytest.fixture(scope="session", autouse=True)
def loops(request):
    """Compile the largest loops, each of two workers others, before both want all of them at the same time."""
    if request.session.testscollected < MANY:
        return
    worker = os.environ.get("PYTEST_XDIST_WORKER")
    if worker == "gw0":
        stepping(il.ExactFlow.step, il.ExactFlow.accepted, False)
        jumping_loop()
    elif worker == "gw1":
        stepping(il.RungeKutta4.step, il.RungeKutta4.accepted, False)
        located_loop()


@pytest.fixture(autouse=True)
def _no_open_figures():
    """Close what a test has drawn, before pyplot warns of many figures."""
    yield
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close("all")


@pytest.fixture
def base_case():
    """Make the pair of Luo, Yan and Zhang (2023); at a ratio of 16 its temperatures are equal."""

    def make(frequency_ratio=16.0, clearance=0.05):
        slow = 2.0 * np.pi
        return il.Network(
            oscillators={
                "one": il.LinearOscillator.from_frequency(frequency_ratio * slow, 0.1),
                "two": il.LinearOscillator.from_frequency(slow, 0.1),
            },
            contacts={"gap": il.Contact("one", "two", il.HertzContact(1e4), clearance=clearance)},
            excitations={"one": il.WhiteNoise(16.0), "two": il.WhiteNoise(1.0)},
        )

    return make


@pytest.fixture(scope="session")
def start_python():
    """Start another Python that finds this impactlab; what is returned waits for its output."""

    started = []

    def start(*arguments, **environment):
        package = str(Path(il.__file__).parents[1])
        path = os.pathsep.join(filter(None, [package, os.environ.get("PYTHONPATH")]))
        process = subprocess.Popen(
            [sys.executable, "-W", "error", *map(str, arguments)],
            env={**os.environ, "PYTHONPATH": path, "PYTHONIOENCODING": "utf-8", **environment},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            encoding="utf-8",
        )

        started.append(process)

        def output():
            printed, errors = process.communicate(timeout=120)
            assert process.returncode == 0, errors
            return printed

        return output

    yield start
    for process in started:
        process.kill()
        process.communicate()


@pytest.fixture(scope="session")
def run_python(start_python):
    """Run another Python and return what it printed."""
    return lambda *arguments, **environment: start_python(*arguments, **environment)()


@pytest.fixture
def golden():
    """Compare a text with the copy that a person has read; it lies in ``tests/golden``."""

    def compare(name, text):
        assert text == (Path(__file__).parent / "golden" / name).read_text(encoding="utf-8")

    return compare


@pytest.fixture(scope="session")
def lists():
    """The script that writes the lists that follow from the source."""
    path = Path(il.__file__).parents[1] / "docs" / "names.py"
    spec = importlib.util.spec_from_file_location("names_of_impactlab", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
