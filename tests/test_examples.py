"""Every public name has an example in its docstring, which runs and gives what it shows."""

import doctest
import inspect
import re
from operator import attrgetter
from pathlib import Path

import pytest

import impactlab as il

SHARED = Path(__file__).parent.parent / "docs" / "site" / "networks.py"
"""What the examples share."""

NAMES = [name for name in il.__all__ if name != "__version__"] + [f"plot.{name}" for name in il.plot.__all__]

RUNS = re.compile(
    r"il\.(simulate|sweep|Run|rerun|orbits|continue_orbits|orbit_spread|basins|bifurcation|lyapunov|fragility|"
    r"required_separation|uncertain|fokker_planck|exact_covariance|run_study|plot|catalogue)\(|\.compile\("
)
"""Calls that compile, draw or take long."""


def text_of(name: str) -> str:
    return inspect.getdoc(attrgetter(name)(il)) or ""


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[pytest.mark.full] if RUNS.search(text_of(name)) else []) for name in NAMES],
)
def test_example_gives_what_it_shows(name: str) -> None:
    shared: dict[str, object] = {}
    exec(compile(SHARED.read_text(encoding="utf-8"), SHARED.name, "exec"), shared)
    _, section, shown = text_of(name).partition("Examples\n--------\n")
    assert section, f"il.{name} has no section Examples in its docstring"
    test = doctest.DocTestParser().get_doctest(shown, shared, name, None, None)
    assert test.examples, f"the Examples of il.{name} are empty"
    told: list[str] = []
    failed = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE).run(test, out=told.append).failed
    assert not failed, "".join(told)
