"""Networks as results keep them: the text is what JSON makes of the plain data, however much members share."""

import itertools
import json

import pytest

import impactlab as il
from impactlab.components.stored import entries, stored

BODY = il.DuffingOscillator(mass=2.0, damping=0.1, stiffness=3.0, cubic=1e300)
LAW = il.HertzContact(1e4)
NAMES = ["plain", 'quoted "name"', "back\\slash", "Grüße", "😀", "tab-less", "100 %s %", "z"]


def mixed() -> il.Network:
    """Members of many classes and few, alone and shared, with names that JSON writes in another way."""
    pairs = list(itertools.pairwise(NAMES))
    contacts: dict[str, il.Contact | il.RoundContact] = {
        f"{one} to {other}": il.Contact(one, other, LAW, clearance=0.01 * at) for at, (one, other) in enumerate(pairs)
    }
    contacts["stop"] = il.Contact(il.WALL, "z", il.LinearContact(1e3), clearance=-0.0)
    contacts["lever"] = il.Contact(il.Combination({"z": 1.5, "plain": -0.25}), il.WALL, LAW)
    contacts["rim"] = il.RoundContact(("frame.1", "frame.2"), il.WALL, LAW, clearance=0.1, center=(1.0, 2.0))
    frame = il.LinearStructure([1.0, 2.0], [[0.2, -0.1], [-0.1, 0.2]], [[2.0, -1.0], [-1.0, 2.0]])
    gust = il.Source(il.Harmonic(1.0, frequency=2.0), on={"z": -1.0, "plain": 2.0})
    return il.Network(
        {**dict.fromkeys(NAMES, BODY), "frame": frame},
        contacts,
        {**dict.fromkeys(NAMES[:6], il.WhiteNoise(1.0)), "gust": gust},
        {name: il.Coupling(name, "z", il.LinearCoupling(10.0, damping=0.5)) for name in NAMES[:-1]},
    )


@pytest.mark.parametrize("bodies", [1, 2, 3, 40])
def test_of_chains(bodies):
    network = il.chain(bodies, BODY, LAW, clearance=0.01, excitation=il.WhiteNoise(1.0), walls=True)
    assert "".join(stored(network).parts) == json.dumps(network.to_dict())


def test_of_members_of_many_classes():
    network = mixed()
    assert "".join(stored(network).parts) == json.dumps(network.to_dict())
    assert il.Network.from_dict(json.loads("".join(stored(network).parts))) == network
    assert set(entries([stored(network)])) == set(entries(network.to_dict()))
