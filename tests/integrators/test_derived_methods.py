"""Methods that derive from those of the package are used wherever these would be, or refused."""

import itertools

import numpy as np
import pytest
from scenes import plan_of

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.integrators.exact_flow import _end_step, _flow_of_step
from impactlab.integrators.kicks import kick
from impactlab.integrators.stretches import MOST_BODIES
from impactlab.machine import tuned
from impactlab.plan.in_registers import layout_of
from impactlab.simulation.idle_bodies import split
from impactlab.step_control.tolerance.tolerance import method_for

VELOCITY = 3
"""Coefficient of the flow: what a velocity adds to that after a step."""

BODY = il.LinearOscillator.from_frequency(6.0, 0.1)
NOISE = il.WhiteNoise(1.0)
HERTZ = il.HertzContact(1e4)


class Slowed(il.ExactFlow):
    """Takes a tenth of every velocity in each step."""

    def coefficients(self, model, step):
        result = super().coefficients(model, step)
        result[..., VELOCITY] *= 0.9
        return result


class OwnStep(il.ExactFlow):
    """Makes the same step by a function of its own, and takes a tenth of every velocity after it."""

    @staticmethod
    def step(forces, tables, driven, state, history, steps, index):
        slot, last_force = _flow_of_step(tables, driven, state, history, steps, index)
        kick(forces, tables, steps.passes, state.still, state.v, state.reading, slot)
        _end_step(tables, state, slot, last_force, steps, index)
        for body in range(state.v.shape[0]):
            for lane in range(state.v.shape[1]):
                state.v[body, lane] *= 0.9


def pair(law=HERTZ, clearance=0.5, **fields):
    contacts = {"gap": il.Contact("a", "b", law, clearance=clearance)}
    return il.Network({"a": BODY, "b": BODY}, contacts, **({"excitations": {"a": NOISE, "b": NOISE}} | fields))


def rubbing():
    friction = il.Coupling("a", il.WALL, il.CoulombFrictionCoupling(0.5))
    return il.Network({"a": BODY}, {}, {"a": il.Harmonic(5.0, frequency=4.0)}, {"rub": friction})


def row(bodies):
    names = [f"b{k}" for k in range(bodies)]
    contacts = {f"{a} {b}": il.Contact(a, b, HERTZ, clearance=0.01) for a, b in itertools.pairwise(names)}
    return il.Network(dict.fromkeys(names, BODY), contacts, dict.fromkeys(names, NOISE))


SCENES = {
    "intervals": (pair(), {"realizations": 2048, "duration": 200.0}),
    "rigid": (pair(il.RigidContact(0.8)), {"realizations": 64}),
    "dry friction": (rubbing(), {"realizations": 64}),
    "registers": (pair(clearance=0.01), {"realizations": 1}),
    "structure": (
        il.Network({"beam": il.ModalStructure([6.0], [0.1], points={"tip": [1.0]})}, excitations={"beam.1": NOISE}),
        {"realizations": 64},
    ),
}  # fmt: skip


@pytest.mark.parametrize("method", [Slowed(), Slowed(jumps=False)])
@pytest.mark.parametrize("name", SCENES)
def test_plans_have_the_numbers_and_the_step_of_the_method(name, method):
    network, options = SCENES[name]
    with tuned(single_lane_steps=0.0):
        plan, usual = (plan_of(network, **options, step=0.002, integrator=item) for item in (method, il.ExactFlow()))
    model = Model.of(network)
    assert plan.method.integrator is method
    assert (usual.method.interval > 1) == (name == "intervals")
    assert plan.method.interval == 1
    assert (layout_of(plan) is not None) == (name == "registers")
    own = method.coefficients(model, plan.clock.step).transpose(0, 2, 1)
    np.testing.assert_array_equal(plan.method.coefficients, own)
    assert plan.method.step is il.ExactFlow.step


def test_bodies_that_nothing_touches_are_not_taken_out():
    bodies = {"a": BODY, "b": BODY, "idle": BODY}
    model = Model.of(pair().replace(oscillators=bodies))
    assert split(model, il.ExactFlow(), None, []) is not None
    assert split(model, Slowed(), None, []) is None


def test_methods_for_an_accuracy():
    model = Model.of(pair())
    assert type(method_for(model, il.ExactFlow())) is not il.ExactFlow
    assert method_for(model, Slowed()) == Slowed()


def test_nothing_is_said_of_the_linear_map_of_a_derived_method():
    class Steeper(il.RungeKutta4):
        @staticmethod
        def step(forces, tables, driven, state, history, steps, index):
            pass

    for method in (Slowed(), Steeper()):
        assert "linear map" in pair().check(integrator=method).dataset.attrs["note"]
    assert "linear map" not in pair().check(integrator=il.RungeKutta4()).dataset.attrs["note"]


@pytest.mark.parametrize("network", [pair(il.RigidContact(0.8)), rubbing()])
def test_a_step_of_its_own_knows_no_impacts_and_no_sticking(network):
    with pytest.raises(
        il.InvalidInput, match=r"OwnStep knows no (rigid contacts|dry frictions that stick).*use il.ExactFlow\(\)"
    ):
        il.simulate(network, 1.0, integrator=OwnStep())


def test_a_step_of_its_own_runs_in_no_tiles_and_in_no_registers():
    with tuned(tile_bodies=30, tile_steps=(16, 8), tile_excess=6.0, single_lane_steps=0.0):
        plans = [
            plan_of(row(120), realizations=1, step=1e-3, integrator=item)
            for item in (il.ExactFlow(), Slowed(), OwnStep())
        ]
        few = plan_of(row(MOST_BODIES), realizations=1, step=1e-3, integrator=OwnStep())
    assert [bool(plan.subdomains.tiles) for plan in plans] == [True, True, False]
    assert layout_of(few) is None
    assert few.method.step is OwnStep.step


def mean_square(network, method, realizations=1, duration=4.0):
    """Mean square of velocities along runs that begin with one of 3 m/s."""
    options = {"step": 0.01, "initial": {"velocity": {"a": 3.0}}, "record": il.Trajectory(0.1), "rng": 1}
    result = il.simulate(network, duration, realizations=realizations, integrator=method, **options)
    assert result.attrs["integrator"] == type(method).__name__
    return float((result.velocity**2).mean())


@pytest.mark.full
@pytest.mark.parametrize("network", [pair(il.RigidContact(0.8), 0.1, excitations={}), rubbing()])
def test_impacts_and_sticking_of_a_derived_method(network):
    """A tenth of the velocity in each step leaves little of the motion."""
    usual, slowed = (mean_square(network, method) for method in (il.ExactFlow(measured=False), Slowed()))
    assert slowed < 0.5 * usual


@pytest.mark.campaign
@pytest.mark.filterwarnings("ignore::impactlab.errors.AccuracyWarning")
@pytest.mark.parametrize("realizations", [1, 64])
@pytest.mark.parametrize("method", [Slowed(), OwnStep()])
def test_velocities_of_a_derived_method(method, realizations):
    """In registers, in blocks of one lane and of many, and side by side in a sweep. Warnings tell that it is wrong."""
    network = pair(clearance=0.01)
    usual = mean_square(network, il.ExactFlow(measured=False), realizations)
    assert mean_square(network, method, realizations) < 0.5 * usual
    both = [
        il.sweep(
            lambda clearance: pair(clearance=clearance), {"clearance": [0.01, 0.02]}, duration=4.0, step=0.01, rng=1,
            realizations=64, integrator=item,
        ).mean_square_velocity.values
        for item in (il.ExactFlow(measured=False), method)
    ]  # fmt: skip
    assert (both[1] < 0.5 * both[0]).all()
