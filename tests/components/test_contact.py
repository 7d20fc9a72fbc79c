"""Contacts and their laws."""

import copy
import pickle

import numpy as np
import pytest
from scenes import deviations

import impactlab as il

LAW = il.HertzContact(1e4)
POWER_LAW_STATISTICS = [
    "mean_displacement", "mean_square_displacement", "mean_square_velocity", "contact_ratio", "mean_contact_force",
]  # fmt: skip


def test_hertz_force_and_potential():
    assert float(LAW.evaluate(0.04)) == pytest.approx(1e4 * 0.04**1.5, rel=1e-15)
    assert float(LAW.call("potential", 0.04)) == pytest.approx(0.4 * 1e4 * 0.04**2.5, rel=1e-15)


def test_linear_force_and_potential():
    law = il.LinearContact(50.0)
    assert float(law.evaluate(0.2)) == 10.0
    assert float(law.call("potential", 0.2)) == pytest.approx(1.0, rel=1e-15)


def test_power_law_force_and_potential():
    law = il.PowerLawContact(50.0, exponent=2.0)
    assert float(law.evaluate(0.2)) == pytest.approx(2.0, rel=1e-15)
    assert float(law.call("potential", 0.2)) == pytest.approx(50.0 * 0.2**3 / 3.0, rel=1e-15)


@pytest.mark.parametrize(("exponent", "law"), [(1.0, il.LinearContact(1e3)), (1.5, il.HertzContact(1e4))])
def test_power_law_is_the_linear_and_the_hertz_law(exponent, law):
    """A simulation of the general law meets the exact statistics of the special one."""
    body = il.LinearOscillator.from_frequency(natural_frequency=2.0 * np.pi, damping_ratio=0.1)
    pair = {"a": body, "b": body.replace(mass=3.0)}
    noise = {name: il.WhiteNoise(1.0) for name in pair}
    special = il.Network(pair, {"gap": il.Contact("a", "b", law, clearance=0.05)}, noise)
    power = il.PowerLawContact(law.stiffness, exponent=exponent)
    general = special.replace(contacts={"gap": il.Contact("a", "b", power, clearance=0.05)})
    expected = il.exact(special).statistics()
    exact = il.exact(general).statistics()
    for name in expected.data_vars:
        np.testing.assert_allclose(exact[name], expected[name], rtol=1e-11, atol=1e-14, err_msg=name)
    result = il.simulate(general, 200.0, realizations=128, rng=1)
    assert max(deviations(result, expected, POWER_LAW_STATISTICS, 1e-3).values()) < 3.0


@pytest.mark.full
def test_power_law_of_a_cone_meets_its_exact_law():
    body = il.LinearOscillator.from_frequency(natural_frequency=2.0 * np.pi, damping_ratio=0.1)
    network = il.Network(
        {"a": body, "b": body},
        {"gap": il.Contact("a", "b", il.PowerLawContact(1e5, exponent=2.0), clearance=0.05)},
        {"a": il.WhiteNoise(1.0), "b": il.WhiteNoise(1.0)},
    )
    result = il.simulate(network, 400.0, realizations=256, rng=2)
    assert max(deviations(result, il.exact(network).statistics(), POWER_LAW_STATISTICS, 1e-3).values()) < 3.0


def test_a_steep_law_is_planned_and_has_an_exact_law():
    """Far out its force overflows; that is infinite, as in compiled code, and no warning."""
    assert il.PowerLawContact(1e4, exponent=20.0).evaluate(2e15) == np.inf
    wall = il.Contact("a", il.WALL, il.PowerLawContact(1e4, exponent=12.5))
    body = il.LinearOscillator(damping=1.0, stiffness=1.0)
    network = il.Network({"a": body}, {"wall": wall}, {"a": il.WhiteNoise(1.0)})
    assert 0.0 < il.exact(network).statistics().contact_ratio.item() < 0.5
    assert il.simulate(network, 10.0, realizations=64, rng=1).attrs["step"] > 0.0


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
        (("a", "a", LAW), r"contact of a body with itself: 'a' was given twice"),
        ((il.WALL, il.WALL, LAW), r"contact of a body with itself: WALL was given twice"),
        (("", "a", LAW), r"Contact.first must be the name of a body, an il.Combination or il.WALL, not ''"),
        (("a", None, LAW), r"Contact.second must be the name of a body, an il.Combination or il.WALL, not None"),
        (("a", 3, LAW), r"Contact.second must be the name of a body, an il.Combination or il.WALL, not 3"),
        (("a", "b", 1e4), r"Contact.law must be a contact law such as .*, not 10000.0"),
        (("a", "b", il.HertzContact), r"Contact.law must be a contact law"),
        (("a", "b"), r"Contact needs law"),
        (("a", "b", LAW, 0.1), r"takes 3 value\(s\) by position, not 4.*clearance"),
    ],
)
def test_bad_contact(arguments, message):
    with pytest.raises(il.InvalidInput, match=message):
        il.Contact(*arguments)


def test_backlash_is_a_contact_on_either_side():
    contacts = il.backlash("a", il.WALL, LAW, clearance=0.1, name="stop")
    assert contacts == {
        "stop_upper": il.Contact("a", il.WALL, LAW, clearance=0.1),
        "stop_lower": il.Contact(il.WALL, "a", LAW, clearance=0.1),
    }


@pytest.mark.parametrize("clearance", [np.nan, np.inf, -np.inf, "0.1", None])
def test_bad_clearance(clearance):
    with pytest.raises(il.InvalidInput, match=r"Contact.clearance must be a"):
        il.Contact("a", "b", LAW, clearance=clearance)


@pytest.mark.parametrize("cls", [il.HertzContact, il.LinearContact])
@pytest.mark.parametrize("stiffness", [-1.0, np.nan, np.inf])
def test_bad_stiffness(cls, stiffness):
    with pytest.raises(il.InvalidInput, match=rf"{cls.__name__}.stiffness must be .*not {stiffness}"):
        cls(stiffness)
