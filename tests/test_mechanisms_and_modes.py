"""Each mechanism in each mode of running: the numbers of plain blocks, bit for bit, or refused by its name."""

from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pytest
from mechanisms import MECHANISMS, coupled, row
from scenes import changed, plan_of

import impactlab as il
from impactlab.assembly.mechanism import Mechanism, Mode, refusals
from impactlab.assembly.model import KNOWN, Model
from impactlab.compiling.intrinsics import value_at
from impactlab.compiling.records import Block as LaneBlock
from impactlab.compiling.records import Numbers, Slots
from impactlab.integrators.located import WithinAddress, step_of
from impactlab.integrators.stretches import MOST_BODIES, stretching
from impactlab.machine import tuned
from impactlab.plan.events import EventPart
from impactlab.plan.in_registers import layout_of
from impactlab.plan.side_by_side import Planned
from impactlab.simulation import ensemble
from impactlab.simulation.block import Block
from impactlab.simulation.block_sums import merged
from impactlab.simulation.idle_bodies import split
from impactlab.simulation.joint_runs import JointRun, joins, run_all
from impactlab.step_control.tolerance.tolerance import method_for

pytestmark = pytest.mark.filterwarnings("ignore::impactlab.ImpactLabWarning")

EXACT = il.ExactFlow(measured=False)
STEP, REALIZATIONS = 0.005, 4
TILES = {"tile_bodies": 6, "tile_steps": (16, 8), "tile_excess": 6.0, "single_lane_steps": 0.0}
"""With these, 12 bodies are two tiles."""

each_mechanism = pytest.mark.parametrize("name", MECHANISMS)


def planned(network, realizations=REALIZATIONS, lanes=REALIZATIONS, **options):
    """Plan a short run in blocks of some lanes."""
    usual = {"duration": 1.0, "spin_up": 0.1, "step": STEP, "integrator": EXACT, "records": [il.Trajectory(0.05)]}
    with tuned(single_lane_bodies=1 if lanes == 1 else 1000, single_lane_steps=0.0):
        plan = plan_of(network, realizations=realizations, **(usual | options))
    assert plan.clock.step == STEP
    return changed(plan, realizations__lanes=lanes)


def collected(results):
    """Sums and paths of all realizations of some blocks, these on the last axis."""
    sums = merged(results)
    paths = {name: np.concatenate([result.records[0][name] for result in results]).T for name in results[0].records[0]}
    names = "bodies", "contacts", "products", "points", "laws"
    return {**dict(zip(names, sums, strict=True)), **paths}


def numbers(plan, executor=None):
    return collected(ensemble.run(plan, executor, lambda share: None))


def assert_same(found, expected, realizations=slice(None)):
    assert found.keys() == expected.keys()
    for name in expected:
        np.testing.assert_array_equal(found[name], expected[name][..., realizations], err_msg=name)
    assert np.isfinite(found["displacement"]).all()
    assert found["displacement"].any()


def in_registers(plan):
    block = Block(plan, plan.realizations.of(0), lambda steps: None)
    block.stretch = stretching(layout_of(plan))[1]
    block.advance(plan.clock.spin_up_steps, None)
    return collected([block.measure()])


def side_by_side(networks):
    """Numbers of each network, side by side in one run, and in plain blocks."""
    planned_of = [Planned(Model.of(network), planned(network, seed=(7, k))) for k, network in enumerate(networks)]
    (found,) = run_all([JointRun(planned_of)], lambda part: None)
    together = [collected(item.blocks) for item in found]
    return zip(together, [numbers(item.plan) for item in planned_of], strict=True)


@pytest.fixture(scope="module")
def processes():
    with ProcessPoolExecutor(1) as pool:
        yield pool


RARE = {"duration": 100.0, "spin_up": 5.0, "step": STEP, "realizations": 2048}
"""Of a run in which bodies seldom touch."""


def met(plan, mode):
    """Whether all mechanisms of a network say that they can meet a mode."""
    return mode not in plan.system.refusals


def tiled(network):
    """Plan two realizations in tiles, where the network can have them."""
    with tuned(**TILES):
        return planned(network, realizations=2, lanes=1)


def far_apart(name):
    """Bodies under noise that seldom touch, as far as the mechanism lets them."""
    without_noise = {"prescribed motion", "dry friction", "dry friction at a rigid contact"}
    free = ["b0", "b1", "b2"][name in without_noise :]
    network = row(name, noisy=free)
    return network.replace(contacts={key: item.replace(clearance=3.0) for key, item in network.contacts.items()})


@pytest.mark.campaign
@each_mechanism
def test_blocks_of_any_size_have_the_bits_of_one(name, processes):
    network = row(name)
    plain = numbers(planned(network))
    assert_same(numbers(planned(network, lanes=2)), plain)
    assert_same(numbers(planned(network, lanes=3)), plain)
    assert_same(numbers(planned(network, lanes=1)), plain)
    assert_same(numbers(planned(network, lanes=2), processes), plain)
    one = planned(network, realizations=1, lanes=1)
    assert one.single == met(one, Mode.ONE_LANE)
    assert_same(numbers(one), plain, slice(1))
    few = len(one.system.bodies) <= MOST_BODIES
    assert (layout_of(one) is not None) == (met(one, Mode.REGISTERS) and few)
    if layout_of(one) is not None:
        assert_same(in_registers(one), plain, slice(1))


@pytest.mark.campaign
@each_mechanism
def test_a_scene_has_its_mechanism(name):
    """It is another motion than without."""
    found, without = (numbers(planned(row(of))) for of in (name, ""))
    assert (
        found["displacement"].shape != without["displacement"].shape
        or (found["displacement"] != without["displacement"]).any()
    )


@pytest.mark.campaign
@each_mechanism
def test_tiles_have_the_bits_of_the_whole(name):
    network = row(name, bodies=12)
    plan = tiled(network)
    assert bool(plan.subdomains.tiles) == met(plan, Mode.TILES)
    if plan.subdomains.tiles:
        assert_same(numbers(plan), numbers(planned(network, realizations=2, lanes=2)))


@pytest.mark.parametrize("name", ["rigid contact", "filtered noise", "weak linear coupling", "points of a structure"])
def test_parts_of_plans_that_no_tile_knows_are_not_cut(name):
    """Should their mechanism say, by mistake, that it meets tiles."""
    subdomains = tiled(row(bodies=12)).subdomains
    plan = planned(row(name, bodies=12))
    assert not met(plan, Mode.TILES)
    with pytest.raises(NotImplementedError, match="its mechanism must not meet them"):
        _ = replace(plan, subdomains=subdomains).tiles


@pytest.mark.campaign
@each_mechanism
def test_networks_side_by_side_have_the_bits_of_each(name):
    networks = [row(name, clearance=clearance) for clearance in (0.01, 0.02, 0.03)]
    plan = planned(networks[0])
    taken = joins(Planned(Model.of(networks[0]), plan))
    assert taken == met(plan, Mode.SIDE_BY_SIDE)
    if taken:
        for together, alone in side_by_side(networks):
            assert_same(together, alone)


@pytest.mark.campaign
@each_mechanism
def test_bodies_apart_from_idle_ones_have_the_bits_of_the_whole(name):
    network, plain = row(name, idle=True), {"records": []}
    apart = split(Model.of(network), EXACT, None, [])
    if apart is None:
        assert not met(planned(network), Mode.IDLE_BODIES)
        return
    busy, whole = planned(apart[0], **plain), planned(network, **plain)
    assert apart[1].oscillators.keys() == {"idle"}
    slots = [whole.system.bodies.index(body) for body in busy.system.bodies]
    found, expected = ensemble.run(busy, None, lambda share: None), ensemble.run(whole, None, lambda share: None)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one.bodies, other.bodies[:, :, :, slots])
        np.testing.assert_array_equal(one.contacts, other.contacts)
        np.testing.assert_array_equal(one.laws, other.laws)


@pytest.mark.campaign
@pytest.mark.parametrize("name", ["", *MECHANISMS])
def test_contact_free_intervals_have_the_law_of_single_steps(name):
    network = far_apart(name)
    plan = plan_of(network, integrator=il.ExactFlow(measured=False), **RARE)
    assert (plan.method.interval > 1) == (met(plan, Mode.INTERVALS) and bool((plan.start.deviations > 0.0).all()))
    assert met(plan, Mode.SAMPLES) or not plan.observed.sampled
    if plan.method.interval > 1:
        found, expected = (
            il.simulate(network, rng=5, integrator=il.ExactFlow(measured=False, jumps=jumps), **RARE)
            for jumps in (True, False)
        )
        for statistic in ("mean_square_displacement", "mean_square_velocity", "contact_rate", "mean_contact_force"):
            scatter = np.hypot(*(item[f"{statistic}_standard_error"].values for item in (found, expected)))
            assert (expected[statistic].values > 8.0 * scatter).all()
            off = (found[statistic].values - expected[statistic].values) / scatter
            assert np.abs(off).max() < 4.0, statistic


def test_every_mechanism_has_a_scene():
    """One that is added needs a scene, with which the tests above cross it with all modes."""
    models = [*map(Model.of, map(row, MECHANISMS)), Model.of(row("stiff linear coupling"), ["own"])]
    of_scenes = {item for model in models for item in model.mechanisms}
    assert of_scenes == {item for item in KNOWN if type(item).__module__.startswith("impactlab.")}


class MagnetCoupling(il.CouplingLaw):
    """Attracts, hardly any more beyond a reach."""

    strength: float = il.parameter(units="N")
    reach: float = il.parameter(units="m", above=0.0)

    @staticmethod
    def force(extension, strength, reach):
        return strength * extension / (reach**2 + extension**2) * reach


class Passages(NamedTuple):
    """Bodies that pass each other between magnets."""

    within: WithinAddress
    bodies: Slots  # (2,)
    kept: Numbers  # (1,) part of the velocity of the first that a passage leaves
    passed: LaneBlock  # (1, lane) how often they have passed each other


def let_pass(place, now):
    """Slow the first body down where it passes the second within the flow of a step."""
    passages = value_at(place)
    step = step_of(value_at(passages.within), now)
    first, second = passages.bodies
    for lane in range(step.x.shape[1]):
        before = step.begin[first, lane] - step.begin[second, lane]
        if before * (step.x[first, lane] - step.x[second, lane]) < 0.0:
            passages.passed[0, lane] += 1.0
            step.v[first, lane] *= passages.kept[0]


@dataclass(frozen=True, eq=False)
class MagnetsOfRun(EventPart):
    """The part of a plan, with arrays, a function and a state of its own."""

    record = Passages
    after_flow = staticmethod(let_pass)

    bodies: np.ndarray
    kept: float

    def arrays(self, room):
        return Passages(0, self.bodies, np.array([self.kept]), room.zeros((1, room.lanes)))

    def lasting(self, arrays):
        return [arrays.passed]

    def noted(self, arrays):
        return arrays.passed

    def remarks(self, noted, contacts, times, rates):
        comments = {"mean_square_velocity": f"{noted.sum():g} passages"}
        return super().remarks(noted, contacts, times, rates)._replace(comments=comments)


class Magnets(Mechanism):
    """Says nothing of any mode."""

    name = "magnets"
    in_flow = True
    kept = 0.9

    def there(self, model):
        return any(isinstance(law, MagnetCoupling) for law in model.couplings.laws)

    def events(self, model, step, seed, energy):
        return MagnetsOfRun(model.coupled.first()[:1] + np.arange(2), self.kept)


@pytest.mark.full
def test_a_mechanism_with_events_and_a_state_of_its_own():
    """It touches nothing inside: one class, its part of a plan, and a function that the loop calls."""
    MECHANISMS["magnets"] = coupled(MagnetCoupling(3.0, reach=0.05))
    network = row("magnets", noisy=["b0"], clearance=3.0)
    del MECHANISMS["magnets"]
    plan = planned(network)
    results = ensemble.run(plan, None, lambda share: None)
    found, (passed,) = collected(results), results[0].events
    paths = found["displacement"]
    assert paths.any()
    assert (passed > 0.0).all()
    assert_same(numbers(planned(network, lanes=2)), found)
    other = Block(plan, plan.realizations.of(0), lambda steps: None)
    other.advance(50, None)
    lasting = other.events.lasting()
    assert [item.shape for item in lasting] == [(1, REALIZATIONS)]
    (part,) = plan.events.parts
    free = numbers(changed(plan, events__parts=(replace(part, kept=1.0),)))
    square = [np.mean(item["velocity"] ** 2) for item in (found, free)]
    assert square[0] < square[1]
    dataset = il.simulate(network, 1.0, spin_up=0.1, step=STEP, realizations=REALIZATIONS, rng=7, integrator=EXACT)
    assert dataset.mean_square_velocity.attrs["comment"].endswith("passages")
    assert int(dataset.mean_square_velocity.attrs["comment"].split()[0]) > 0


def test_a_mechanism_that_says_nothing_runs_in_plain_blocks_only():
    MECHANISMS["magnets"] = coupled(MagnetCoupling(3.0, reach=0.05))
    try:
        network, large, idle, far = (
            row("magnets"),
            row("magnets", bodies=12),
            row("magnets", idle=True),
            far_apart("magnets"),
        )
    finally:
        del MECHANISMS["magnets"]
    model = Model.of(network)
    names = refusals(model)
    assert names.keys() == set(Mode)
    assert all("magnets" in item for item in names.values())
    one = planned(network, realizations=1, lanes=1)
    assert not one.single
    assert layout_of(one) is None
    assert_same(numbers(one), numbers(planned(network)), slice(1))
    assert not tiled(large).subdomains.tiles
    assert not joins(Planned(model, one))
    assert split(Model.of(idle), EXACT, None, []) is None
    plan = plan_of(far, integrator=EXACT, **RARE)
    assert plan.method.interval == 1
    assert not plan.clock.certified
    assert not plan.observed.sampled
    assert method_for(model, il.ExactFlow()) == il.ExactFlow()
    with pytest.raises(il.InvalidInput, match=r"knows no magnets such as 'b0'; use il\.simulate"):
        network.compile()
    assert "Contact-free intervals are not crossed at once: magnets, nonlinear couplings." in str(network.check())
