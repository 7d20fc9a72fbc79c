"""Digests of runs at default settings: a scene for each mechanism, and one for each way of running.

``python tests/bits.py`` writes those of this machine to ``tests/golden/bits.json``, for a change that means to change
numbers; ``python tests/bits.py OUT.json`` writes one for each variable, to see which ones differ between two checkouts.
"""

import hashlib
import importlib.metadata
import json
import platform
import sys
import warnings
from pathlib import Path

import llvmlite.binding
import numpy as np
from mechanisms import MECHANISMS, row
from scenes import base

import impactlab as il

GOLDEN = Path(__file__).parent / "golden" / "bits.json"

ALL = {"duration": 4.0, "realizations": 20, "rng": 1, "record": [il.PerRealization(), il.FinalState()]}


def chain(bodies):
    body = il.LinearOscillator(mass=1.0, damping=1.2, stiffness=40.0)
    return il.chain(bodies, body, il.HertzContact(1e4), clearance=0.02, excitation=il.WhiteNoise(1.0))


def apart(clearance):
    return base(clearance=clearance)


MODES = {
    "pair": lambda: il.simulate(base(), **ALL),
    "one realization": lambda: il.simulate(base(), **ALL | {"realizations": 1, "duration": 100.0}),
    "many blocks": lambda: il.simulate(base(), **ALL | {"realizations": 1100, "duration": 1.0}),
    "given step": lambda: il.simulate(base(), step=0.004, **ALL),
    "contact-free intervals": lambda: il.simulate(apart(0.5), **ALL | {"realizations": 600, "duration": 20.0}),
    "chain": lambda: il.simulate(chain(40), **ALL),
    "tiles": lambda: il.simulate(chain(9000), 0.3, step=0.005, rng=1),
    "tolerance": lambda: il.simulate(base(), tolerance={"contact_ratio": 0.02}, rng=1),
    "sweep": lambda: il.sweep(apart, {"clearance": [0.02, 0.05, 0.1]}, duration=4.0, realizations=20, rng=1),
    "density and spectrum": lambda: il.simulate(
        base(), **ALL | {"duration": 40.0, "record": [il.Density(bins=20), il.Spectrum()]}
    ),
    "fourth order": lambda: il.simulate(row("sum of cosines"), integrator=il.RungeKutta4(), step=0.002, **ALL),
    "Euler–Maruyama": lambda: il.simulate(row(), integrator=il.EulerMaruyama(), step=3e-5, **ALL | {"duration": 0.5}),
}
"""Ways of running."""

SCENES = {
    name: lambda name=name: il.simulate(row(name), integrator=il.ExactFlow(), **ALL) for name in MECHANISMS
} | MODES


def digests(dataset):
    """A digest of the bits of each variable of numbers."""
    items = ((name, item.values) for name, item in sorted(dataset.data_vars.items()) if item.dtype.kind in "fiub")
    return {name: hashlib.sha256(values.tobytes()).hexdigest()[:12] for name, values in items}


def digest(dataset):
    """A digest of all bits of all variables of numbers."""
    return hashlib.sha256(json.dumps(digests(dataset)).encode()).hexdigest()[:16]


def surroundings():
    """What the bits of a run depend on beside the package: compilers, libraries, the processor."""
    versions = {name: importlib.metadata.version(name) for name in ("numba", "llvmlite", "numpy", "scipy")}
    extensions = (np.show_config(mode="dicts") or {}).get("SIMD Extensions")
    processor = llvmlite.binding.get_host_cpu_name()
    return {**versions, "system": platform.system(), "processor": processor, "extensions": extensions}


def run(name):
    """Run a scene without a word of its accuracy."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", il.ImpactLabWarning)
        return SCENES[name]()


if __name__ == "__main__":
    if len(sys.argv) > 1:
        written, found = Path(sys.argv[1]), {name: digests(run(name)) for name in SCENES}
    else:
        written, found = GOLDEN, {"surroundings": surroundings()} | {name: digest(run(name)) for name in SCENES}
    written.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
