"""Contacts in a plane: what is refused, files, and what other parts of the package say to them."""

import dataclasses

import numpy as np
import pytest

import impactlab as il
from impactlab.assembly.members import SLIDING
from impactlab.components.contact import SlidingFriction

LAW = il.HertzContact(1e5)
PLACE = "rotor.x", "rotor.y"


def contact(first=PLACE, second=il.WALL, law=LAW, **fields):
    return il.RoundContact(first, second, law, **{"clearance": 0.01} | fields)


def rotor(**fields):
    shaft = il.LinearStructure([1.0, 1.0], np.eye(2), 100.0 * np.eye(2), names=("x", "y"))
    return il.Network({"rotor": shaft}, {"rub": contact(**fields)})


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"clearance": 0.0}, r"RoundContact.clearance must be larger than 0 m, not 0.0\."),
        ({"clearance": -0.1}, r"RoundContact.clearance must be larger than 0 m, not -0.1\."),
        ({"friction_coefficient": -0.1}, r"RoundContact.friction_coefficient must be at least 0, not -0.1\."),
        ({"friction_coefficient": 0.1}, r"RoundContact with friction needs friction_velocity \(m s-1\)"),
        ({"first": ("rotor.x", "rotor.x")}, r"RoundContact.first must be two .*; twice 'rotor.x' was given\."),
        ({"first": ("rotor.x",)}, r"RoundContact.first must be the two coordinates x and y, .* not \('rotor.x',\)\."),
        ({"first": "rotor.x"}, r"RoundContact.first must be the two coordinates x and y, .* not 'rotor.x'\."),
        (
            {"first": ("rotor.x", il.WALL)},
            r"RoundContact.first must be two different coordinates.*the wall was given\.",
        ),
        ({"second": ("case.x", "case.x")}, r"RoundContact.second must be two .*; twice 'case.x' was given\."),
        ({"second": ("rotor.x", "case.y")}, r"A round contact of 'rotor.x' with 'rotor.x' acts on nothing"),
        ({"center": (0.1,)}, r"RoundContact.center must be a list of 2 numbers, not \(0.1,\)\."),
        ({"law": il.RigidContact(0.5)}, r"RoundContact.law cannot be RigidContact: impacts are located along"),
        ({"law": il.HertzdampContact(1e5, restitution=0.5)}, r"RoundContact.law cannot be HertzdampContact: it has st"),
        ({"law": 3.0}, r"RoundContact.law must be a contact law such as il.HertzContact\(1e4\), not 3.0\."),
    ],
)
def test_bad_input_is_refused_in_one_line(fields, message):
    with pytest.raises(il.InvalidInput, match=message) as caught:
        contact(**fields)
    assert "\n" not in str(caught.value)


def test_unknown_coordinate_is_refused():
    with pytest.raises(
        il.InvalidInput, match=r"RoundContact 'rub' names a body 'rotor.z' .*; did you mean 'rotor.[xy]'"
    ):
        rotor(first=("rotor.x", "rotor.z"))


def test_files():
    """A network comes back from plain data and from TOML, with a wall, a pair and combinations as sides."""
    half = il.Combination({"rotor.x": 0.5, "case.x": 0.5})
    bodies = {
        name: il.LinearStructure([1.0, 1.0], np.eye(2), np.eye(2), names=("x", "y")) for name in ("rotor", "case")
    }
    contacts = {
        "fixed": contact(center=(1e-3, -2e-3), friction_coefficient=0.2, friction_velocity=0.1, surface_velocity=3.0),
        "case": contact(second=("case.x", "case.y")),
        "middle": contact(first=(half, "rotor.y")),
    }
    network = il.Network(bodies, contacts)
    assert il.Network.from_dict(network.to_dict()) == network
    assert il.Network.from_toml(network.to_toml()) == network


def test_numbers_of_friction_are_its_fields():
    assert SlidingFriction.field_names() == SLIDING
    assert {*SLIDING} <= {field.name for field in dataclasses.fields(il.RoundContact)}


def test_what_does_not_know_planes_says_so():
    network = rotor().replace(excitations={name: il.WhiteNoise(1.0) for name in PLACE})
    with pytest.raises(il.NoExactReference, match=r"'rub' is a round contact; laws are known for contacts along one"):
        il.exact(network)
    with pytest.raises(il.InvalidInput, match=r"PeakForces: 'rub' is a round contact, of which no crossings"):
        il.simulate(network, 1.0, record=il.PeakForces(), rng=1)
