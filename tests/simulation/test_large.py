"""Networks of many bodies: the same numbers as one by one, and no work that grows faster than their number."""

import math
import sys

import numpy as np
import pytest
from scenes import base, plan_of

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.components.evaluation import call_each
from impactlab.integrators import exact_flow
from impactlab.plan.seed import seed_of
from impactlab.statistics import chain, controls, moments
from impactlab.statistics.regression import Regression
from impactlab.step_control.rules.kinks import kink_step
from impactlab.step_control.rules.tangent_stiffness import Stiffening, energies

CALLS = [0]


class Counted(il.ContactLaw):
    """Hertz contact and a bit more, that counts how often it is evaluated."""

    stiffness: float = il.parameter(units="N m-3/2")

    @staticmethod
    def force(indentation, stiffness):
        CALLS[0] += 1
        return stiffness * indentation * (math.sqrt(indentation) + indentation)


class Steep(il.ContactLaw):
    exponent: float = il.parameter()

    @staticmethod
    def force(indentation, exponent):
        return 1e4 * indentation**exponent


class Brittle(il.ContactLaw):
    limit: float = il.parameter()

    @staticmethod
    def force(indentation, limit):
        return 1.0 / (limit - limit) if limit > 2.0 else indentation


def unequal(count, law=il.HertzContact, seed=1):
    """A chain of bodies that all differ, some free, some not excited, some pressed together."""
    rng = np.random.default_rng(seed)
    mass = rng.uniform(0.5, 2.0, count)
    bodies = [
        il.DuffingOscillator(mass=m, damping=0.2, stiffness=0.0 if i % 5 == 3 else 30.0 + m, cubic=10.0 * m)
        for i, m in enumerate(mass)
    ]
    clearance = 0.05 * mass[1:] - 0.06 * (rng.random(count - 1) < 0.2)
    noise = [None if i % 7 == 4 else il.WhiteNoise(m) for i, m in enumerate(mass)]
    return il.chain(
        count, bodies, [law(1e4 * m) for m in mass[1:]], clearance=clearance.tolist(), excitation=noise, walls=False
    )


def stiffening(network):
    model = Model.of(network)
    return model, Stiffening.of(model, energies(model, "stationary", 10.0))


def test_kernels_of_many_components_give_the_bits_of_one():
    laws = [il.HertzContact(7.0), il.LinearContact(3.0), il.HertzContact(1e5), il.PowerLawContact(2.0, exponent=1.3)]
    depth = np.random.default_rng(1).uniform(0.0, 2.0, (4, 9))
    together = call_each(laws, "force", depth, np.zeros((4, 1)))
    np.testing.assert_array_equal(together, [law.call("force", row, 0.0) for law, row in zip(laws, depth, strict=True)])


def test_an_overflow_is_no_number_and_a_mistake_names_its_component():
    values = call_each([Steep(2.0), Steep(400.0)], "force", np.full((2, 1), 10.0), np.zeros((2, 1)))
    assert values[0] == 1e6
    assert np.isnan(values[1])
    with pytest.raises(
        il.InvalidInput, match=r"Brittle\.force failed for Brittle\(limit=3\.0\) at indentation = 0: ZeroDivisionError"
    ):
        call_each([Brittle(1.0), Brittle(3.0)], "force", np.zeros((2, 4)), np.zeros((2, 1)))


def test_contacts_together_have_the_bits_of_contacts_alone():
    """Depths and tangents do not depend on what else is in the network, to the last bit."""
    network = unequal(12)
    _, together = stiffening(network)
    assert len(np.unique(together.penetration)) == 11
    assert (together.bodies > 0.0).all()
    for slot, (name, contact) in enumerate(network.contacts.items()):
        alone = network.replace(
            contacts={other: None if other != name else contact for other in network.contacts},
        )
        own = Stiffening.of(Model.of(alone), together.energy)
        assert own.penetration[0] == together.penetration[slot]
        assert own.contacts[0] == together.contacts[slot]
    for slot in range(12):
        single = il.Network({"a": list(network.oscillators.values())[slot]})
        assert Stiffening.of(Model.of(single), together.energy[[slot]]).bodies[0] == together.bodies[slot]


def test_the_least_of_the_steps_for_kinks_is_that_of_one_contact():
    network = unequal(8, il.LinearContact)
    model, together = stiffening(network)
    alone = []
    for name in network.contacts:
        single = network.replace(contacts={other: None for other in network.contacts if other != name})
        own = Stiffening.of(Model.of(single), together.energy)
        alone.append(kink_step(Model.of(single), own))
    assert kink_step(model, together) == min(alone) < math.inf


def test_a_depth_takes_few_evaluations_of_a_law():
    """Bisection alone would take 12 × 62 for each contact, and as many for the end of its profile."""
    network = il.chain(
        40, il.LinearOscillator(damping=1.0, stiffness=9.0), [Counted(1e4 + k) for k in range(39)],
        excitation=il.WhiteNoise(1.0),
    )  # fmt: skip
    CALLS[0] = 0
    stiffening(network)
    assert CALLS[0] / 39 < 2 * 12 * 27 + 800


def test_equal_contacts_are_worked_out_once():
    body = il.LinearOscillator(damping=1.0, stiffness=9.0)
    counts = []
    for bodies in (3, 300):
        CALLS[0] = 0
        stiffening(il.chain(bodies, body, Counted(1e4), excitation=il.WhiteNoise(1.0)))
        counts.append(CALLS[0])
    assert counts[0] == counts[1] > 0


def planned(network, **changes):
    return plan_of(network, **({"duration": 0.2, "realizations": 2, "spin_up": 0.0, "seed": seed_of(1)} | changes))


def test_a_plan_works_out_its_flow_once(monkeypatch):
    calls = []
    usual = exact_flow.split_transition

    def counted(*arguments, **options):
        calls.append(arguments[4])
        return usual(*arguments, **options)

    monkeypatch.setattr(exact_flow, "split_transition", counted)
    plan = planned(base())
    assert calls == [plan.clock.step] * 4  # two phases, to the end and to the middle


@pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")
def test_batches_are_units_of_one_estimate(monkeypatch):
    calls = []
    usual = chain.cycle
    for module in (chain, moments):
        monkeypatch.setattr(module, "cycle", lambda *arguments: calls.append(1) or usual(*arguments))
    il.simulate(base(), 4.0, realizations=2, rng=1)
    assert len(calls) == 3  # means and squares of held bodies, and means of free ones


@pytest.mark.full
@pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")
@pytest.mark.parametrize("spin_up", [0.0, None], ids=["transient", "stationary"])
def test_moments_of_some_bodies_at_a_time_have_the_bits_of_all(spin_up, monkeypatch):
    network, calls, usual = unequal(7), [], moments._of_bodies
    monkeypatch.setattr(moments, "_of_bodies", lambda *arguments: calls.append(1) or usual(*arguments))

    def run():
        calls.clear()
        return il.simulate(network, 2.0, realizations=2, rng=1, step=0.004, spin_up=spin_up)

    whole, number = run(), len(calls)
    monkeypatch.setattr(moments, "AT_ONCE", 1)
    parts = run()
    assert len(calls) == 7 * number > 0
    for name, values in whole.data_vars.items():
        np.testing.assert_array_equal(values, parts[name], err_msg=name)


def reference(values, controls, weights):
    """Weighted regression by least squares: value at control 0 and its standard error."""
    design = np.column_stack([np.ones(len(values)), *controls])
    root = np.sqrt(weights / weights.mean())
    found, residual, *_ = np.linalg.lstsq(design * root[:, None], values * root, rcond=None)
    covariance = np.linalg.inv((design * root[:, None]).T @ (design * root[:, None]))
    return found[0], np.sqrt(residual[0] / (len(values) - design.shape[1]) * covariance[0, 0])


def test_regressions_row_by_row_are_those_of_least_squares():
    rng = np.random.default_rng(2)
    controls = rng.normal(0.1, 1.0, (5, 3, 80)) * np.array([1.0, 1e-6, 1e4])[:, None]
    values = rng.normal(3.0, 1.0, (5, 80)) + controls.sum(axis=1) * 1e-4
    weights = rng.uniform(0.5, 1.5, 80)
    value, error = Regression(controls, weights).at_zero(values)
    expected = [reference(*row, weights) for row in zip(values, controls, strict=True)]
    np.testing.assert_allclose(np.stack([value, error], axis=1), expected, rtol=1e-10)


def test_a_control_that_is_a_copy_or_constant_adds_nothing():
    rng = np.random.default_rng(3)
    controls, values, weights = rng.normal(size=(1, 2, 80)), rng.normal(size=(1, 80)), np.ones(80)
    more = np.concatenate([controls, controls[:, :1], np.full((1, 1, 80), 0.3)], axis=1)
    plain, redundant = Regression(controls, weights), Regression(more, weights)
    np.testing.assert_allclose(redundant.at_zero(values), plain.at_zero(values), rtol=1e-10)


def test_controls_are_those_of_a_body_and_its_neighbours():
    body, law = il.LinearOscillator(damping=1.0, stiffness=9.0), il.HertzContact(1e4)
    network = il.Network(
        dict.fromkeys("abcd", body),
        {"1": il.Contact("c", "a", law), "2": il.Contact("a", il.WALL, law), "3": il.Contact("b", "c", law)},
        couplings={
            "4": il.Coupling("a", "c", il.LinearCoupling(1.0)),
            "5": il.Coupling("d", "a", il.LinearCoupling(1.0)),
        },
    )
    plan = planned(network, step=0.01)
    near = controls.neighbours(plan.system.links.pairs, np.ones(4, dtype=bool))
    assert near.pairs.tolist() == [
        [0, 0], [0, 2], [0, 3], [1, 1], [1, 2], [2, 2], [2, 0], [2, 1], [3, 3], [3, 0],
    ]  # fmt: skip
    assert controls.touching(plan.system.ends).pairs.tolist() == [[0, 2], [0, 0], [1, 0], [2, 1], [2, 2]]
    usable = np.array([[True, False], [True, True], [False, False], [False, True]])
    chosen = {}
    for rows, (bodies, places) in near.choices(usable, 2):
        for row, *chosen_of in zip(rows.tolist(), bodies.tolist(), places.tolist(), strict=True):
            chosen[row] = list(zip(*chosen_of, strict=True))
    assert chosen == {0: [(0, 0), (3, 1)], 1: [(1, 0), (1, 1)], 2: [(0, 0), (1, 0)], 3: [(3, 1), (0, 0)]}


def test_the_text_of_a_large_network_is_short():
    assert len(repr(unequal(1000))) < 2500


@pytest.mark.filterwarnings("ignore:Too few independent samples")
def test_a_large_chain_needs_no_function_of_python_for_each_member():
    """From the chain to its dataset: less than two calls of a function of Python for each body and its contact."""

    def run(count):
        body, law = il.LinearOscillator(damping=1.0, stiffness=40.0), il.HertzContact(1e4)
        network = il.chain(count, body, law, clearance=0.01, excitation=il.WhiteNoise(1.0))
        il.simulate(network, duration=0.02, realizations=1, rng=1, step=0.004, spin_up=0.0)

    def calls(count):
        number = 0

        def counted(frame, event, argument):
            nonlocal number
            number += event == "call"

        sys.setprofile(counted)
        try:
            run(count)
        finally:
            sys.setprofile(None)
        return number

    run(1000)  # imports, compiles, and keeps what other runs take
    assert calls(3000) - calls(1000) < 2 * 2000
