"""Large networks in tiles give the numbers of the whole, bit for bit, on any number of threads."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from laws import TabulatedContact
from scenes import plan_of

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.machine import tuned
from impactlab.plan.subdomains import Subdomains
from impactlab.simulation import ensemble

BODY, CUBIC = il.LinearOscillator.from_frequency(6.28, 0.1), il.DuffingOscillator(2.0, damping=0.3, stiffness=30.0)
HERTZ = il.HertzContact(1e4)


def chain(law=HERTZ, bodies=120):
    """Of two kinds of bodies, every third of them under noise, with contacts to a wall and across."""
    names = [f"b{k}" for k in range(bodies)]
    walls = [(name, il.WALL) for name in names[::7]]
    pairs = [*itertools.pairwise(names), *walls, *zip(names, names[2:], strict=False)]
    laws = [law, HERTZ, il.LinearContact(2e3)]
    contacts = {f"c{k}": il.Contact(*pair, laws[k % 3 if k % 5 else 0], clearance=0.01) for k, pair in enumerate(pairs)}
    oscillators = {name: CUBIC if k % 10 < 3 else BODY for k, name in enumerate(names)}
    return il.Network(oscillators, contacts, {name: il.WhiteNoise(3.0) for name in names[::3]})


def grid(rows=64, columns=4):
    names = [[f"{row} {column}" for column in range(columns)] for row in range(rows)]
    lines = [*names, *zip(*names, strict=True)]
    pairs = [pair for line in lines for pair in itertools.pairwise(line)]
    contacts = {f"c{k}": il.Contact(*pair, HERTZ, clearance=0.01) for k, pair in enumerate(pairs)}
    every = list(itertools.chain(*names))
    return il.Network(dict.fromkeys(every, BODY), contacts, {name: il.WhiteNoise(3.0) for name in every})


@pytest.fixture
def small():
    with tuned(tile_bodies=30, tile_steps=(16, 8), tile_excess=6.0, single_lane_steps=0.0):
        yield


def planned(network):
    options = {"spin_up": 0.03, "initial": "rest", "integrator": il.ExactFlow(), "seed": (1, 2)}
    records = [il.Trajectory(0.02), il.Density(bins=20), il.FinalState()]
    return plan_of(network, duration=0.2, step=1e-3, records=records, workers=1, **options)


def assert_same(first, second):
    np.testing.assert_array_equal(first.bodies, second.bodies)
    np.testing.assert_array_equal(first.contacts, second.contacts)
    for one, two in zip(first.records, second.records, strict=True):
        assert set(one) == set(two)
        for name in one:
            np.testing.assert_array_equal(one[name], two[name], err_msg=name)


@pytest.mark.full
@pytest.mark.parametrize(
    "network",
    [
        chain(),
        pytest.param(chain(il.HuntCrossleyContact(1e4, dissipation=0.3)), marks=pytest.mark.campaign),
        pytest.param(chain(TabulatedContact([0.0, 50.0, 400.0], distance=0.01)), marks=pytest.mark.campaign),
        grid(),
    ],
    ids=["chain", "damped", "tabulated", "grid"],
)
def test_tiles_give_the_bits_of_the_whole(network, small):
    tiled = planned(network)
    assert len(tiled.subdomains.tiles) == len(network.oscillators) // 30
    with tuned(tile_bodies=10**9):
        whole = planned(network)
    assert not whole.subdomains.tiles
    expected = ensemble.run_block(whole, 0)
    assert expected.contacts[:, 0].any()  # bodies touch
    for threads in (1, 3):
        assert_same(expected, ensemble.run_block(tiled, 0, threads=threads))


@pytest.mark.full
def test_a_halo_that_is_too_small_is_noticed(small):
    """The comparison above can fail: halos of next neighbours do not serve eight steps."""
    plan = planned(chain())
    with tuned(tile_steps=(1,)):
        narrow = replace(Subdomains.of(Model.of(chain()), 1), steps=8)
    expected, wrong = (ensemble.run_block(item, 0) for item in (plan, replace(plan, subdomains=narrow)))
    assert (wrong.bodies != expected.bodies).any()


def test_every_body_and_contact_is_summed_once(small):
    model = Model.of(chain())
    parts = Subdomains.of(model, 2)
    steps, tiles = parts.steps, parts.tiles
    assert steps in (16, 8)
    own = np.concatenate([tile.bodies[: tile.own_bodies] for tile in tiles])
    assert sorted(own) == list(range(len(model.bodies)))
    own = np.concatenate([tile.contacts[: tile.own_contacts] for tile in tiles])
    assert sorted(own) == list(range(len(model.ends)))


@pytest.mark.parametrize("network", [chain(), grid()], ids=["chain", "grid"])
def test_a_tile_has_all_bodies_within_its_reach_and_no_other(network, small):
    model = Model.of(network)
    parts, nearby = Subdomains.of(model, 2), {slot: {slot} for slot in range(len(model.bodies))}
    for first, second in model.ends.pairs[(model.ends.pairs < model.wall).all(axis=1)].tolist():
        nearby[first].add(second)
        nearby[second].add(first)
    for tile in parts.tiles:
        within = set(tile.bodies[: tile.own_bodies].tolist())
        for _ in range(2 * parts.steps):
            within = set().union(*map(nearby.get, within))
        halo = tile.bodies[tile.own_bodies :].tolist()
        assert halo == sorted(within - set(tile.bodies[: tile.own_bodies].tolist()))


def test_networks_without_parts_of_their_own_are_not_cut(small):
    """A star, whose halos are everything, and small networks."""
    names = [f"b{k}" for k in range(90)]
    star = {f"c{k}": il.Contact("b0", name, HERTZ) for k, name in enumerate(names[1:])}
    with tuned(tile_excess=1.5):
        assert not Subdomains.of(Model.of(il.Network(dict.fromkeys(names, BODY), star)), 2).tiles
    assert not Subdomains.of(Model.of(il.chain(59, BODY, HERTZ)), 2).tiles
