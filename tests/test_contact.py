"""Contacts and their laws."""

import copy
import pickle

import numpy as np
import pytest

import impactlab as il

LAW = il.HertzContact(1e4)


def test_hertz_force_and_potential():
    assert float(LAW.evaluate(0.04)) == pytest.approx(1e4 * 0.04**1.5, rel=1e-15)
    assert float(LAW.call("potential", 0.04)) == pytest.approx(0.4 * 1e4 * 0.04**2.5, rel=1e-15)


def test_linear_force_and_potential():
    law = il.LinearContact(50.0)
    assert float(law.evaluate(0.2)) == 10.0
    assert float(law.call("potential", 0.2)) == pytest.approx(1.0, rel=1e-15)


def test_evaluate_is_zero_where_the_contact_is_open():
    np.testing.assert_array_equal(il.LinearContact(2.0).evaluate([[-1.0, 0.0], [1.0, 2.0]]), [[0, 0], [2, 4]])


def test_evaluate_broadcasts_indentation_and_rate():
    class Dashpot(il.ContactLaw):
        damping: float = il.parameter(units="N s m-1")

        def force(rate, damping):
            return damping * rate

    force = Dashpot(2.0).evaluate([[-1.0], [1.0]], [3.0, -4.0])
    np.testing.assert_array_equal(force, [[0.0, 0.0], [6.0, -8.0]])


def test_wall_is_one_object():
    for wall in (copy.copy(il.WALL), copy.deepcopy(il.WALL), pickle.loads(pickle.dumps(il.WALL))):
        assert wall is il.WALL
    assert repr(il.WALL) == "WALL"


@pytest.mark.parametrize("ends", [("a", "b"), ("a", il.WALL), (il.WALL, "a")])
def test_contact_round_trip(ends):
    contact = il.Contact(*ends, LAW, clearance=-0.5)
    assert il.Contact.from_dict(contact.to_dict()) == contact
    assert pickle.loads(pickle.dumps(contact)) == contact
    assert (
        eval(repr(contact), vars(il) | {"WALL": il.WALL, "Contact": il.Contact, "HertzContact": il.HertzContact})
        == contact
    )


def test_a_body_named_like_the_wall_is_a_body():
    contact = il.Contact("WALL", "a", LAW)
    assert il.Contact.from_dict(contact.to_dict()).first == "WALL"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("a", "a", LAW), r"in contact with itself: 'a' was given twice"),
        ((il.WALL, il.WALL, LAW), r"in contact with itself: WALL was given twice"),
        (("", "a", LAW), r"Contact.first must be the name of a body or il.WALL, '' was given"),
        (("a", None, LAW), r"Contact.second must be the name of a body or il.WALL, None was given"),
        (("a", 3, LAW), r"Contact.second must be the name of a body or il.WALL, 3 was given"),
        (("a", "b", 1e4), r"Contact.law must be a contact law such as .*, 10000.0 was given"),
        (("a", "b", il.HertzContact), r"Contact.law must be a contact law"),
        (("a", "b"), r"Contact needs law"),
        (("a", "b", LAW, 0.1), r"takes 3 value\(s\) by position, 4 were given.*clearance"),
    ],
)
def test_bad_contact(arguments, message):
    with pytest.raises(il.InvalidInput, match=message):
        il.Contact(*arguments)


@pytest.mark.parametrize("clearance", [np.nan, np.inf, -np.inf, "0.1", None])
def test_bad_clearance(clearance):
    with pytest.raises(il.InvalidInput, match=r"Contact.clearance must be a"):
        il.Contact("a", "b", LAW, clearance=clearance)


@pytest.mark.parametrize("cls", [il.HertzContact, il.LinearContact])
@pytest.mark.parametrize("stiffness", [-1.0, np.nan, np.inf])
def test_bad_stiffness(cls, stiffness):
    with pytest.raises(il.InvalidInput, match=rf"{cls.__name__}.stiffness must be .*{stiffness} was given"):
        cls(stiffness)
