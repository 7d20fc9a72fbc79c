"""Networks and bodies that several tests use, and the comparison of a run with numbers."""

from dataclasses import replace

import numpy as np

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.kernels.random import philox_words, stream
from impactlab.plan.request import Request
from impactlab.results.schema import scatter_of
from impactlab.simulation.planning import make_plan
from impactlab.step_control.measured.bias import size_of
from impactlab.step_control.measured.step_bias import BIASED


def plan_of(network, **options):
    """Plan a run, by default of one realization at the automatic step."""
    usual = {
        "duration": 10.0, "realizations": 1, "step": None, "integrator": il.ExactFlow(), "spin_up": None,
        "initial": None, "records": [], "seed": (1, 2), "workers": 2,
    }  # fmt: skip
    return make_plan(Model.of(network), Request(**(usual | options)))


def changed(plan, **fields):
    """Return a plan with other fields, each named ``part__field``."""
    for name, value in fields.items():
        part, _, field = name.partition("__")
        plan = replace(plan, **{part: replace(getattr(plan, part), **{field: value})})
    return plan


def base(ratio=16.0, clearance=0.05, **changes):
    """The pair of Luo, Yan and Zhang (2023): natural frequencies 2π ratio and 2π, damping ratio 0.1."""
    one = il.LinearOscillator.from_frequency(natural_frequency=2.0 * np.pi * ratio, damping_ratio=0.1)
    two = il.LinearOscillator.from_frequency(natural_frequency=2.0 * np.pi, damping_ratio=0.1)
    network = il.Network(
        {"one": one, "two": two},
        {"gap": il.Contact("one", "two", il.HertzContact(1e4), clearance=clearance)},
        {"one": il.WhiteNoise(16.0), "two": il.WhiteNoise(1.0)},
    )
    return network.replace(**changes)


def linear(frequency=2.0 * np.pi, ratio=0.1, density=1.0):
    """One linear body under white noise."""
    body = il.LinearOscillator.from_frequency(natural_frequency=frequency, damping_ratio=ratio)
    return il.Network({"a": body}, excitations={"a": il.WhiteNoise(density)})


def deviations(dataset, reference, names, relative=0.0):
    """Distance of each statistic from its reference in standard errors, beyond a relative allowance."""
    result = {}
    for name in names:
        error = np.asarray(dataset[f"{name}_standard_error"])
        expected = np.asarray(reference[name])
        beyond = np.abs(np.asarray(dataset[name]) - expected) - relative * np.abs(expected)
        result[name] = float(np.max(beyond / error))
    return result


def off(found, reference, names=BIASED):
    """Return by how much statistics are off, as a part of them, and the standard error of that, name by name."""
    result = {}
    for name in (name for name in names if name in found):
        size = size_of(name, lambda item: reference[item].values)
        difference = found[name].values - reference[name].values
        errors = [np.nan_to_num(scatter_of(item, name).values) for item in (found, reference)]
        with np.errstate(invalid="ignore"):
            result[name] = np.nan_to_num(difference / size), np.nan_to_num(np.hypot(*errors) / size)
    return result


def phases(seed, lines, realization, attempt):
    """Phases of the lines of one realization, word by word from their stream."""
    low, high, word = stream(seed, lines.name, "phases")
    blocks = -(-len(lines.frequencies) // 4)
    counters = attempt * blocks + np.arange(blocks, dtype=np.uint64)
    rows = np.empty((blocks, 6), dtype=np.uint64)
    rows[:, 0], rows[:, 1], rows[:, 2:] = counters & 0xFFFFFFFF, counters >> 32, [realization, word, low, high]
    words = np.empty((blocks, 4), dtype=np.uint64)
    philox_words(rows, words)
    return 2.0 * np.pi * ((words.ravel() + 0.5) / 2.0**32)[: len(lines.frequencies)]


BUILDINGS = {
    "tower": il.LinearStructure([2.0, 1.0], [[3.0, -1.0], [-1.0, 1.0]], [[400.0, -150.0], [-150.0, 150.0]]),
    "beam": il.ModalStructure(
        [9.0, 20.0], 0.04, mass=[1.5, 1.0], points={"tip": [1.0, -0.6]}, participation=[1.8, 0.7]
    ),
    "hut": il.LinearOscillator(mass=1.0, damping=0.5, stiffness=60.0),
}
"""Two structures and a body that have no links between them."""

ROOFS = "tower.2", "beam.tip", "hut"
"""One place of each."""


def matrices_of_buildings():
    """Return mass, damping and stiffness matrices of them, forces M ι by accelerations below each, and their roofs."""
    mass, damping, stiffness = np.diag([2.0, 1.0, 1.5, 1.0, 1.0]), np.zeros((5, 5)), np.zeros((5, 5))
    damping[:2, :2], stiffness[:2, :2] = [[3.0, -1.0], [-1.0, 1.0]], [[400.0, -150.0], [-150.0, 150.0]]
    damping[2:, 2:] = np.diag([2 * 0.04 * 9.0 * 1.5, 2 * 0.04 * 20.0, 0.5])
    stiffness[2:, 2:] = np.diag([81.0 * 1.5, 400.0, 60.0])
    forces, roofs = np.zeros((5, 3)), np.zeros((3, 5))
    forces[:2, 0], forces[2:4, 1], forces[4, 2] = [2.0, 1.0], [1.8, 0.7], 1.0
    roofs[0, 1], roofs[1, 2:4], roofs[2, 4] = 1.0, [1.0, -0.6], 1.0
    return mass, damping, stiffness, forces, roofs


def covariances_of_buildings(excitations, quantity="displacement"):
    """Return the exact covariances of their roofs under some excitations."""
    law = il.exact(il.Network(BUILDINGS, None, excitations))
    return np.array([[law.covariance(one, other, quantity) for other in ROOFS] for one in ROOFS])
