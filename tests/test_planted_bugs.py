"""The statistics of one run against the exact law: right as it is, wrong with any of eight bugs in it."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scenes import base, deviations

import impactlab as il
import impactlab.simulation
from impactlab.kernels.flow import GAUSS, split_transition
from impactlab.reference.potential import Potential

NAMES = [
    "mean_displacement", "mean_square_displacement", "variance_displacement", "mean_velocity", "mean_square_velocity",
    "contact_ratio", "contact_rate", "mean_contact_force",
]  # fmt: skip
SHIFT = 4


def largest_deviation():
    """Distance of all default statistics from the exact law, in standard errors beyond 0.1 %."""
    network = base()
    ds = il.simulate(network, 20.0, realizations=8192, step=0.008, rng=1)
    return max(deviations(ds, il.exact(network).statistics(), NAMES, relative=1e-3).values())


def change_plan(monkeypatch, change):
    make = impactlab.simulation.make_plan
    monkeypatch.setattr(impactlab.simulation, "make_plan", lambda *args, **options: change(make(*args, **options)))


def change_coefficients(monkeypatch, change):
    def changed(plan):
        coefficients = plan.coefficients.copy()
        change(plan, coefficients)
        return replace(plan, coefficients=coefficients)

    change_plan(monkeypatch, changed)


def factor_in_the_noise(factor):
    def plant(monkeypatch):
        change_plan(monkeypatch, lambda plan: replace(plan, amplitude=math.sqrt(factor) * plan.amplitude))

    return plant


def one_sided_contact(monkeypatch):
    def one_sided(plan):
        indices = plan.indices.copy()
        last = indices[2] - 1
        assert indices[last] == 1  # the sign of the last contact of the last body
        indices[last] = 0
        return replace(plan, indices=indices)

    change_plan(monkeypatch, one_sided)


def missing_damping(monkeypatch):
    def undamped(plan, coefficients):
        mass, damping, stiffness = plan.linear
        for phase, place in enumerate(GAUSS):
            flow, _ = split_transition(mass, 0.0 * damping, stiffness, plan.intensity, plan.step, place)
            coefficients[phase, :SHIFT] = flow.reshape(-1, 4).T

    change_coefficients(monkeypatch, undamped)


def printed_potential(monkeypatch):
    """The paper's Eq. 10 and 12: 3/2 where the integral of the force has 5/2."""

    def potential(indentation, stiffness):
        return 0.4 * stiffness * indentation * math.sqrt(indentation)

    monkeypatch.setattr(il.HertzContact, "potential", staticmethod(potential))
    monkeypatch.setattr(Potential, "check_work", lambda *of: None)  # which would refuse it


def force_read_before_the_shift(monkeypatch):
    def unshifted(plan, coefficients):
        coefficients[:, SHIFT] = 0.0

    change_coefficients(monkeypatch, unshifted)


def one_stream_for_both(monkeypatch):
    change_plan(monkeypatch, lambda plan: replace(plan, streams=np.repeat(plan.streams[:, :1], 2, axis=1)))


def spin_up_lost(monkeypatch):
    change_plan(monkeypatch, lambda plan: replace(plan, spin_up_steps=0))


BUGS = {
    "factor 2 in the noise": factor_in_the_noise(2.0),
    "factor π in the noise": factor_in_the_noise(np.pi),
    "force on one body only": one_sided_contact,
    "missing damping": missing_damping,
    "exponent 3/2 in the potential": printed_potential,
    "force read at x instead of y": force_read_before_the_shift,
    "one stream for both bodies": one_stream_for_both,
    "spin-up lost": spin_up_lost,
}


@pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")
@pytest.mark.parametrize("plant", [None, *BUGS.values()], ids=["no bug", *BUGS])
def test_statistics_catch_every_planted_bug(plant, monkeypatch):
    if plant is None:
        assert largest_deviation() < 3.5
    else:
        plant(monkeypatch)
        assert largest_deviation() > 6.0
