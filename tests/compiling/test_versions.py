"""The oldest and the newest numba that the package allows, each in an environment of its own.

It takes minutes and an index of packages, so that it is asked for:
``IMPACTLAB_VERSIONS=1 python -m pytest -m campaign -n 0 -rs tests/compiling/test_versions.py``.
"""

import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
(ALLOWED,) = (item for item in PROJECT["dependencies"] if item.startswith("numba"))
OLDEST = ALLOWED.removeprefix("numba>=").partition(",")[0]

SCENES = """
import json
import sys
import warnings

import numba

import impactlab as il
from impactlab.compiling.jit import compilations
from impactlab.integrators import stretches

warnings.simplefilter("ignore", il.AccuracyWarning)  # of few realizations
body = il.LinearOscillator(mass=1.0, damping=0.4, stiffness=40.0)


def pair(law=None, clearance=0.05, couplings=None, **sources):
    contacts = {"gap": il.Contact("one", "two", law or il.HertzContact(1e4), clearance=clearance)}
    noise = {"one": il.WhiteNoise(1.0), "two": il.WhiteNoise(1.0)}
    return il.Network({"one": body, "two": body}, contacts, sources or noise, couplings)


maxwell = {"k": il.Coupling("one", "two", il.MaxwellCoupling(2.0, damping=1.0))}
stick = {"k": il.Coupling("one", il.WALL, il.CoulombFrictionCoupling(0.5))}
series = {name: il.ShinozukaNoise(1.0, band=(0.0, 10.0), components=50, allow_repeat=True) for name in ("one", "two")}
sources = {
    "one": il.OrnsteinUhlenbeckNoise(5.0, correlation_time=0.1),
    "two": il.PoissonImpulses(5.0, mean=0.5, standard_deviation=0.1),
    "given": il.Source(il.Harmonic(1.0, frequency=1.7), on="two"),
}
row = il.chain(300, body, il.HertzContact(1e4), clearance=0.02, excitation=il.WhiteNoise(1.0))
scenes = {
    "pair": (pair(), {}),
    "rigid": (pair(il.RigidContact(0.7)), {}),
    "states": (pair(couplings=maxwell), {}),
    "friction": (pair(couplings=stick, two=il.WhiteNoise(1.0)), {}),
    "rate": (pair(il.HuntCrossleyContact(400.0, dissipation=1.0)), {}),
    "intervals": (pair(clearance=3.0), {"initial": "stationary", "duration": 10.0}),
    "sources": (pair(**sources), {}),
    "explicit": (pair(**series), {"integrator": il.RungeKutta4()}),
    "one lane": (row, {"realizations": 1}),
    "registers": (pair(), {"realizations": 1}),
}
found = {}
for name, (network, options) in scenes.items():
    stretches.WORTH_COMPILING = 0 if name == "registers" else 10**9
    options = {"duration": 1.0, "realizations": 8, "step": 0.005, "spin_up": 0.0, "initial": "rest", "rng": 1} | options
    data = il.simulate(network, progress=False, **options)
    values = [data[kind].values for kind in ("mean_square_displacement", "mean_contact_force")]
    found[name] = [float(value) for array in values for value in array.ravel()]
print(json.dumps([numba.__version__, compilations(), stretches.stretching.cache_info().currsize, found]))
"""


def run(python, **cache):
    """Simulate all scenes in a process; return the version of numba, what was compiled, and statistics by scene."""
    environment = os.environ | {"PYTHONPATH": str(ROOT), "PYTHONWARNINGS": "error"} | cache
    done = subprocess.run([python, "-c", SCENES], env=environment, capture_output=True, encoding="utf-8", check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def here():
    """Statistics by scene with the numba of this environment."""
    return run(sys.executable)[-1]


@pytest.mark.skipif("IMPACTLAB_VERSIONS" not in os.environ, reason="asked for by IMPACTLAB_VERSIONS=1")
@pytest.mark.campaign
@pytest.mark.parametrize("wanted", [f"numba=={OLDEST}.*", ALLOWED], ids=["oldest", "newest"])
def test_scenes_run_and_machine_code_is_loaded_again(wanted, here, tmp_path):
    environment = tmp_path / "environment"
    subprocess.run([sys.executable, "-m", "venv", environment], check=True)
    python = environment / ("Scripts" if os.name == "nt" else "bin") / "python"
    others = [item for item in PROJECT["dependencies"] if item != ALLOWED]
    pip = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", wanted, *others]
    installed = subprocess.run(pip, capture_output=True, encoding="utf-8", check=False)
    if installed.returncode:
        pytest.skip(f"{wanted} cannot be installed here: {installed.stderr.strip().splitlines()[-1]}")
    cache = {"IMPACTLAB_CACHE": str(tmp_path / "cache")}
    version, compiled, stretches, found = run(python, **cache)
    assert version.startswith(OLDEST) or wanted == ALLOWED
    assert compiled > 0
    assert stretches == 1  # the scene of registers
    assert found.keys() == here.keys()
    for name, values in found.items():
        np.testing.assert_allclose(values, here[name], rtol=1e-9, err_msg=name)
    assert run(python, **cache) == [version, 0, 1, found]
