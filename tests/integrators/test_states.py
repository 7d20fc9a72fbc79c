"""Laws with states: what they are given, when these change, and what everything else says to them."""

import math
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from laws import Slider, WorkingContact, WorkingImpacts

import impactlab as il
from impactlab.assembly.generate import generate
from impactlab.assembly.model import Model
from impactlab.machine import tuned
from impactlab.plan.request import Request
from impactlab.plan.seed import Seed
from impactlab.simulation.block import Block
from impactlab.simulation.memory_use import sizes
from impactlab.simulation.planning import make_plan


class YieldingContact(il.ContactLaw):
    """Spring that unloads on a stiffer line from the largest indentation (Walton and Braun 1986)."""

    loading: float = il.parameter(units="N m-1")
    unloading: float = il.parameter(units="N m-1")
    largest: float = il.state(0.0, units="m")

    def force(indentation, loading, unloading, largest):
        return max(loading * largest - unloading * (largest - indentation), 0.0)

    def update(indentation, largest):
        return max(indentation, largest)


METHODS = [il.ExactFlow(), il.RungeKutta4(), il.EulerMaruyama()]
EXACT = il.ExactFlow(measured=False)


@pytest.mark.full
def test_a_law_of_a_few_lines_rebounds_as_theory_says():
    """Of the energy ½ k δ² the unloading gives back k/k', so that the restitution is ``sqrt(k/k')``."""
    law = YieldingContact(1e4, unloading=4e4)
    network = il.Network({"a": il.LinearOscillator()}, {"stop": il.Contact("a", il.WALL, law, clearance=0.1)})
    for method in (EXACT, il.RungeKutta4()):
        options = {"integrator": method, "initial": {"velocity": {"a": 1.0}}, "record": il.Trajectory(0.2)}
        result = il.simulate(network, 0.2, step=1e-5, **options)
        assert float(result.velocity.isel(time=-1).squeeze()) == pytest.approx(-0.5, abs=2e-5)


@pytest.mark.full
def test_work_by_the_rule_that_anybody_would_write():
    """Force times rate times step is the energy that the body loses in a collision, to second order in the step."""
    body = il.LinearOscillator(mass=0.5)
    network = il.Network(
        {"a": body}, {"w": il.Contact("a", il.WALL, WorkingContact(1e6, damping=200.0), clearance=1e-3)}
    )
    off = []
    for step in (1e-4, 5e-5):  # 0.14 and 0.07 of the time scale of the contact
        starts = {"velocity": {"a": np.linspace(0.5, 1.5, 64)}}  # that meet the wall at all phases of a step
        options = {"step": step, "integrator": EXACT, "initial": starts, "record": il.FinalState()}
        last = il.simulate(network, 0.01, realizations=64, **options)
        lost = 0.25 * (starts["velocity"]["a"] ** 2 - last.final_velocity.values[:, 0] ** 2)
        work = last.final_law_state.values[:, 0]
        assert (lost > 0.03).all()
        off.append(np.abs(work / lost - 1.0).mean())
    table = last.impactlab.table().set_index(["statistic", "label"])
    assert table.loc[("mean_law_state", "w.work"), "value"] == last.mean_law_state.item()
    assert off[0] < 1e-3  # with the rate before the push of the contact it is 0.2
    assert off[1] < 0.4 * off[0]


@pytest.mark.campaign
def test_states_that_the_force_reads_and_others_each_have_their_rate():
    """Impacts are those of the law without the work, bit by bit, and the work is the energy that is lost."""
    off = []
    for step in (4e-5, 2e-5):
        runs = []
        for law in (WorkingImpacts(1e6, restitution=0.5), il.LankaraniNikraveshContact(1e6, restitution=0.5)):
            stop = il.Contact("a", il.WALL, law, clearance=1e-3)
            starts = {"velocity": {"a": np.linspace(0.5, 1.5, 64)}}
            options = {"step": step, "integrator": EXACT, "initial": starts, "record": il.FinalState()}
            network = il.Network({"a": il.LinearOscillator(mass=0.5)}, {"w": stop})
            runs.append(il.simulate(network, 0.01, realizations=64, **options))
        assert np.array_equal(*(run.final_velocity for run in runs))
        lost = 0.25 * (starts["velocity"]["a"] ** 2 - runs[0].final_velocity.values[:, 0] ** 2)
        work = runs[0].final_law_state.sel(state="w.work").values
        off.append(np.abs(work / lost - 1.0).mean())
    assert off[0] < 0.005
    assert off[1] < 0.6 * off[0]


class Counting(il.CouplingLaw):
    """Counts the accepted steps, and notes how long they were, where and how fast it was then."""

    steps: float = il.state(0.0)
    span: float = il.state(0.0, units="s")
    place: float = il.state(0.0, units="m")
    speed: float = il.state(0.0, units="m s-1")
    force_: float = il.parameter(1.0, units="N")

    def force(extension, steps, force_):
        return force_ + 0.0 * steps

    def update(extension, rate, elapsed, steps, span, place, speed):
        return steps + (1.0 if elapsed > 0.0 else 0.0), span + elapsed, extension, rate


def planned(network, step, realizations=1, integrator=EXACT, initial="rest"):
    return make_plan(Model.of(network), Request(1.0, realizations, step, integrator, 0.0, initial, [], Seed(1, 2)))


def block_of(*arguments, **options):
    plan = planned(*arguments, **options)
    return Block(plan, plan.realizations.of(0), lambda steps: None)


@pytest.mark.full
@pytest.mark.parametrize("realizations", [1, 3])
@pytest.mark.parametrize("method", METHODS, ids=lambda item: type(item).__name__)
def test_states_change_once_in_a_step(method, realizations):
    """However often a method evaluates forces; at the place and the velocity after it."""
    bodies = {
        "a": il.LinearOscillator(damping=1.0, stiffness=1.0),
        "b": il.LinearOscillator(damping=1.0, stiffness=1.0),
    }
    couplings = {"one": il.Coupling("a", "b", Counting()), "two": il.Coupling(il.WALL, "b", Counting())}
    network = il.Network(bodies, {}, {"a": il.WhiteNoise(1.0)}, couplings)
    block = block_of(network, 1e-3, realizations, integrator=method, initial={"displacement": {"b": 0.5}})
    assert (block.states == np.array([[0.0], [0.0], [0.5], [0.0]] * 2)).all()
    block.advance(100, None)
    block.advance(150, None)
    steps, span, place, speed = block.states.reshape(2, 4, -1).swapaxes(0, 1)
    assert (steps == 250.0).all()
    np.testing.assert_allclose(span, 0.25, rtol=1e-12)
    x, v = block.state.x, block.state.v
    of_kick = 1e-3 if isinstance(method, il.ExactFlow) else 0.0
    np.testing.assert_allclose(place, [x[1] - x[0], x[1]], atol=of_kick**2)
    np.testing.assert_allclose(speed, [v[1] - v[0], v[1]], atol=2.0 * of_kick, rtol=1e-12)


def everything(factor=1.0):
    """Contacts with and without rates, a coupling and a body, of all of which some have states."""
    bodies = {
        "a": il.LinearOscillator(damping=0.5, stiffness=10.0),
        "b": Slider(spring=20.0 * factor, most=2.0, damping=0.2, stiffness=40.0),
        "c": il.LinearOscillator(damping=0.2, stiffness=40.0),
    }
    contacts = {
        "ab": il.Contact("a", "b", YieldingContact(1e3, unloading=3e3), clearance=0.05),
        "bc": il.Contact("b", "c", il.LankaraniNikraveshContact(1e4, restitution=0.6), clearance=0.05),
        "w": il.Contact(il.WALL, "a", il.HertzContact(1e3), clearance=0.3),
        "c": il.Contact("c", il.WALL, YieldingContact(1e3, unloading=2e3, largest=0.01), clearance=0.1),
    }
    couplings = {
        "m": il.Coupling("a", "c", il.MaxwellCoupling(5.0, damping=1.0)),
        "n": il.Coupling("a", "b", Counting()),
    }
    return il.Network(bodies, contacts, dict.fromkeys(bodies, il.WhiteNoise(0.5)), couplings)


@pytest.mark.campaign
@pytest.mark.filterwarnings("ignore:Too few")
def test_blocks_lanes_and_workers_give_the_same_numbers():
    options = {
        "duration": 2.0,
        "spin_up": 1.0,
        "step": 2e-3,
        "rng": 3,
        "record": il.Trajectory(0.5),
        "integrator": EXACT,
    }
    many = il.simulate(everything(), realizations=9, **options)
    with ThreadPoolExecutor(3) as pool:
        again = il.simulate(everything(), realizations=9, executor=pool, **options)
    assert np.array_equal(many.displacement, again.displacement)
    one = il.simulate(everything(), **options)
    np.testing.assert_allclose(one.displacement[0], many.displacement[0], rtol=1e-9, atol=1e-12)


@pytest.mark.full
@pytest.mark.parametrize("realizations", [pytest.param(1, marks=pytest.mark.campaign), 3])
def test_calls_of_any_length_go_on_where_the_last_one_ended(realizations):
    """So does a block that is given the numbers of another one."""
    whole, parts = (block_of(everything(), 2e-3, realizations) for _ in range(2))
    whole.advance(400, None)
    for steps in (64, 32, 128):
        parts.advance(steps, None)
    other = block_of(everything(), 2e-3, realizations)
    for kept, found in zip([*other.state[:-1], other.states], [*parts.state[:-1], parts.states], strict=True):
        kept[:] = found
    other.now = parts.now
    for block in (parts, other):
        block.advance(400 - 224, None)
        assert np.array_equal(whole.states, block.states)
        assert np.array_equal(whole.state.x, block.state.x)
        assert np.array_equal(whole.state.v, block.state.v)


@pytest.mark.campaign
def test_plain_python_gives_the_same_numbers(run_python, tmp_path):
    text = """
import sys
import numpy as np
sys.path[:0] = sys.argv[1:]
from test_states import block_of, everything
for realizations in (1, 2):
    block = block_of(everything(), 2e-3, realizations)
    block.advance(40, None)
    print(*block.states.ravel())
"""
    (tmp_path / "run.py").write_text(text, encoding="utf-8")
    here = Path(__file__).parent
    printed = run_python(tmp_path / "run.py", here, here.parent, NUMBA_DISABLE_JIT="1").splitlines()
    for realizations, line in zip((1, 2), printed, strict=True):
        block = block_of(everything(), 2e-3, realizations)
        block.advance(40, None)
        np.testing.assert_allclose(block.states.ravel(), np.array(line.split(), dtype=float), rtol=1e-9, atol=1e-15)


@pytest.mark.full
def test_a_body_that_slips_loses_the_energy_of_its_loop():
    """It slips from where its spring, pulled by f at the start, pushes by f; so it does for the rest of the way."""
    body = Slider(spring=50.0, most=0.2, stiffness=400.0)
    network = il.Network({"a": body})
    options = {"initial": {"displacement": {"a": 1.0}}, "record": il.Trajectory(0.12)}
    path = il.simulate(network, 0.12, step=1e-5, integrator=EXACT, **options).squeeze().isel(time=-1)
    x, v = float(path.displacement), float(path.velocity)
    assert 0.5 * 400.0 * (1.0 - x**2) - 0.5 * v**2 == pytest.approx(0.2 * (1.0 - x - 2.0 * 0.2 / 50.0), rel=1e-5)


@pytest.mark.full
@pytest.mark.filterwarnings("ignore:Too few")
@pytest.mark.parametrize("realizations", [1, 3])
@pytest.mark.parametrize("method", METHODS, ids=lambda item: type(item).__name__)
def test_trajectories_have_the_states_at_their_times(method, realizations, tmp_path):
    """With labels, in memory and in a file; here what is known: the number of steps, and the place."""
    bodies = {name: il.LinearOscillator(damping=1.0, stiffness=1.0) for name in "ab"}
    couplings = {"one": il.Coupling("a", "b", Counting()), "two": il.Coupling(il.WALL, "b", Counting())}
    network = il.Network(bodies, {}, {"a": il.WhiteNoise(1.0)}, couplings)
    options = {
        "realizations": realizations,
        "step": 1e-3,
        "integrator": method,
        "record": il.Trajectory(0.01),
        "rng": 1,
    }
    found = il.simulate(network, 0.1, initial="rest", spin_up=0.005, **options)
    assert found.state.values.tolist()[:4] == ["one.steps", "one.span", "one.place", "one.speed"]
    assert found.law_state.attrs["comment"] == "units: steps 1, span s, place m, speed m s-1"
    steps = found.law_state.sel(state="two.steps")
    assert (steps == 5.0 + 10.0 * np.arange(11)).all()
    x = found.displacement
    place = found.law_state.sel(state=["one.place", "two.place"]).values
    np.testing.assert_array_equal(place, np.stack([x[..., 1] - x[..., 0], x[..., 1]], axis=-1))
    written = il.simulate(network, 0.1, initial="rest", spin_up=0.005, out=tmp_path / "run.nc", **options)
    assert written.law_state.equals(found.law_state)
    assert written.law_state.attrs == found.law_state.attrs


def test_a_run_takes_memory_for_states():
    plain = everything().replace(couplings={"n": None})
    plans = [planned(network, 1e-3, 2) for network in (plain, everything())]
    rows = [len(plan.forces.states) for plan in plans]
    assert rows == [1 + 1 + 1 + 1 + 2, 1 + 1 + 1 + 1 + 2 + 4]
    assert sizes(plans[1])[0] - sizes(plans[0])[0] >= 8 * 4


def test_states_are_fields_whose_value_is_that_at_the_start():
    law = YieldingContact(1.0, unloading=2.0, largest=0.25)
    assert YieldingContact.state_names() == ("largest",)
    assert YieldingContact.units_of("largest") == "m"
    assert il.ContactLaw.from_dict(law.to_dict()) == law
    assert eval(repr(law), {"YieldingContact": YieldingContact}) == law
    assert law.evaluate([0.2, 0.5]).tolist() == pytest.approx([0.15, 0.5])
    assert law.replace(largest=0.0).evaluate(0.2) == pytest.approx(0.2)


def force(indentation, worn):
    return indentation * worn


def update(indentation, worn):
    return worn + indentation


@pytest.mark.parametrize(
    ("base", "members", "message"),
    [
        (il.ContactLaw, {"force": force, "worn": il.state()},
         r"state Law.worn has no start value: write worn: float = il.state\(0.0"),
        (il.ContactLaw, {"force": force, "worn": il.state(0.0)},
         r"Law has states \(worn\), but no update\(indentation, rate, elapsed, time, then states and other fields by "),
        (il.ContactLaw, {"force": lambda indentation: 0.0, "update": lambda indentation: 0.0},
         r"Law defines update, but no state: declare name: float = il.state\(0.0\)"),
        (il.ContactLaw, {"force": force, "update": update, "worn": il.state(0.0), "potential": lambda indentation: 0.0},
         r"Law has states \(worn\), so that its force depends on the past: it has no potential"),
        (il.Excitation, {"intensity": lambda time: 1.0, "worn": il.state(0.0)},
         r"Law cannot have states \(worn\): laws of contacts and couplings, and oscillators can"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_states_is_said_where_the_class_is_made(base, members, message):
    with pytest.raises(il.InvalidInput, match=message):
        type("Law", (base,), {**members, "__annotations__": {"worn": "float"} if "worn" in members else {}})


def test_a_state_without_a_type_is_refused():
    with pytest.raises(il.InvalidInput, match=r"^Law.worn has no type: write worn: float = il.state\(…\)\.$"):
        type("Law", (il.ContactLaw,), {"force": force, "update": update, "worn": il.state(0.0)})
    with pytest.raises(il.InvalidInput, match=r"Law.stiffness has no type: write stiffness: float = il.parameter"):
        type("Law", (il.ContactLaw,), {"force": lambda indentation: 0.0, "stiffness": il.parameter(1.0)})


def test_an_update_of_too_few_states_is_refused():
    class Two(il.CouplingLaw):
        one: float = il.state(0.0)
        two: float = il.state(0.0)

        def force(extension, one, two):
            return one + two + extension

        def update(extension, one, two):
            return one

    with pytest.raises(il.InvalidInput, match=r"Two.force failed .* at extension = 1"):
        Two().evaluate(1.0)


NOISY = {"a": il.WhiteNoise(1.0)}
BODY = {"a": il.LinearOscillator(damping=1.0, stiffness=10.0)}
STOP = {"stop": il.Contact("a", il.WALL, YieldingContact(10.0, unloading=20.0), clearance=0.5)}


def test_what_cannot_have_states_says_so():
    stopped = il.Network(BODY, STOP, NOISY)
    held = il.Network(BODY, {}, NOISY, {"m": il.Coupling(il.WALL, "a", il.JenkinsCoupling(1.0, slip_force=1.0))})
    slipping = il.Network({"a": Slider(spring=1.0, most=1.0, damping=1.0, stiffness=1.0)}, {}, NOISY)
    cases = [
        (stopped, r"force of contact 'stop' depends on the past, by the states of YieldingContact \(largest\)"),
        (held, r"force of coupling 'm' depends on the past, by the states of JenkinsCoupling \(pull, last\)"),
        (slipping, r"residual force of 'a' depends on the past, by the states of Slider \(slip\)"),
    ]
    for network, message in cases:
        with pytest.raises(il.NoExactReference, match=message):
            il.exact(network)
        with pytest.raises(il.InvalidInput, match=r"no function of displacements and velocities alone .* states: \w+"):
            network.compile()
        assert "No bias is predicted: laws have states" in repr(network.check(step=1e-3))
    between = {"c": il.Contact("a", "b", STOP["stop"].law)}
    pair = il.Network({**BODY, "b": BODY["a"]}, between, dict.fromkeys("ab", NOISY["a"]))
    with pytest.raises(il.NoExactReference, match=r"force of contact 'c' depends on the past"):
        il.fokker_planck(pair)


def test_runs_make_every_step():
    network = il.Network(BODY, STOP, NOISY)
    elastic = network.replace(contacts={"stop": il.Contact("a", il.WALL, il.LinearContact(10.0), clearance=2.0)})
    far = network.replace(contacts={"stop": STOP["stop"].replace(clearance=2.0)})
    request = Request(100.0, 64, 0.01, EXACT, None, None, [], Seed(1, 2))
    assert make_plan(Model.of(elastic), request).method.interval > 1
    assert make_plan(Model.of(far), request).method.interval == 1


def test_large_networks_with_states_run_in_one_piece():
    count = 2 * 4000 + 10
    make = lambda law: il.chain(count, BODY["a"], law, excitation=NOISY["a"])  # noqa: E731
    request = Request(0.01, 1, 1e-3, EXACT, 0.0, "rest", [], Seed(1, 2))
    with tuned(single_lane_steps=0.0):
        assert make_plan(Model.of(make(il.HertzContact(1e3))), request).subdomains.tiles
        assert not make_plan(Model.of(make(YieldingContact(1e3, unloading=2e3))), request).subdomains.tiles


def test_text_depends_on_kinds_only():
    assert generate(Model.of(everything())) == generate(Model.of(everything(2.0)))


class Clashing(il.ContactLaw):
    """Fields and states with the names of what the generated loops use."""

    remembered: float = il.state(1.0)
    remembered_0: float = il.state(2.0)
    elapsed_: float = il.parameter(3.0)
    parameters: float = il.state(4.0)
    x: float = il.state(5.0)
    gap: float = il.parameter(6.0)

    def force(indentation, remembered, remembered_0, parameters, x, gap, elapsed_):
        return indentation * (
            remembered + 10.0 * remembered_0 + 100.0 * parameters + 1e3 * x + 1e4 * gap + 1e5 * elapsed_
        )

    def update(indentation, elapsed, remembered, remembered_0, parameters, x, gap, elapsed_):
        return remembered + elapsed, remembered_0 + gap, parameters + elapsed_, x


@pytest.mark.full
def test_names_that_clash_give_the_right_numbers():
    block = block_of(il.Network(BODY, {"w": il.Contact(il.WALL, "a", Clashing())}), 1e-3)
    block.advance(10, None)
    assert block.states[:, 0].tolist() == pytest.approx([1.01, 2.0 + 6.0 * 11, 4.0 + 3.0 * 11, 5.0])
    assert math.isfinite(float(block.state.x[0, 0]))


@pytest.mark.campaign
@pytest.mark.parametrize("realizations", [1, 3])
def test_links_with_weights_have_the_states_of_the_pairs_that_they_are(realizations):
    """A combination of one body with the weight 1 is that body: the same motion along other loops."""

    def point(name):
        return il.Combination({name: 1.0})

    pairs = everything()
    contacts = {**pairs.contacts, "bc": pairs.contacts["bc"].replace(first=point("b"), second=point("c"))}
    couplings = {**pairs.couplings, "n": pairs.couplings["n"].replace(first=point("a"))}
    found = [
        block_of(network, 2e-3, realizations)
        for network in (pairs, il.Network(pairs.oscillators, contacts, pairs.excitations, couplings))
    ]
    for block in found:
        block.advance(300, None)
    assert np.ptp(found[0].states) > 0.1
    np.testing.assert_allclose(found[1].state.x, found[0].state.x, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(
        np.sort(found[1].states, axis=0), np.sort(found[0].states, axis=0), rtol=1e-9, atol=1e-12
    )
