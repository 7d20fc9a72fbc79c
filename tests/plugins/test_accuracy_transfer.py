"""Transfer integrals: against other exact laws, identities that hold for any law, and themselves."""

import numpy as np
import pytest
from impactlab_numerics.accuracy.random_networks import random_network
from impactlab_numerics.transfer.quadrature import Quadrature
from impactlab_numerics.transfer.trees import transfer_statistics
from scenes import base

import impactlab as il

pytestmark = pytest.mark.campaign

CLOSE = 1e-8


def assert_agrees(network, reference):
    """Compare transfer integrals with a dataset."""
    for name, by_label in transfer_statistics(network).items():
        expected = reference[name].to_series()
        assert by_label == {label: pytest.approx(expected[label], rel=CLOSE, abs=1e-14) for label in expected.index}


def body(frequency=5.0, ratio=0.1, mass=1.0, cubic=None):
    if cubic is None:
        return il.LinearOscillator.from_frequency(frequency, ratio, mass=mass)
    return il.DuffingOscillator.from_frequency(frequency, ratio, mass=mass, cubic=cubic)


def heated(bodies, contacts=None, couplings=None, temperature=1.0):
    noises = {name: il.WhiteNoise(temperature * item.damping / np.pi) for name, item in bodies.items()}
    return il.Network(bodies, contacts, noises, couplings)


spring = il.Coupling("one", "two", il.LinearCoupling(300.0))
PAIRS = [
    base(),
    base(clearance=-0.1),
    base(clearance=0.6),
    base(contacts={"gap": il.Contact("two", "one", il.LinearContact(2e3), clearance=0.1)}),
    base(contacts={"gap": il.Contact("one", "two", il.PowerLawContact(1e7, exponent=2.7), clearance=0.02)}),
    base(contacts={"other": il.Contact("two", "one", il.LinearContact(500.0), clearance=0.2)}),
    base(couplings={"spring": spring}),
    base(couplings={"spring": spring, "wall": il.Coupling(il.WALL, "two", il.LinearCoupling(30.0))}),
]


@pytest.mark.parametrize("network", PAIRS)
def test_pairs(network):
    assert_agrees(network, il.exact(network).statistics())


@pytest.mark.parametrize("seed", [0, 1, 6, 7, 13])
def test_random_trees(seed):
    """Two programs for the same sums, which share nothing."""
    network = random_network(seed)
    assert_agrees(network, il.exact(network).statistics())


def test_single_bodies_between_walls():
    walls = {
        "upper": il.Contact("a", il.WALL, il.HertzContact(1e4), clearance=-0.05),
        "lower": il.Contact(il.WALL, "a", il.LinearContact(1e3), clearance=0.3),
    }
    network = heated({"a": body(cubic=40.0), "b": body(2.0)}, walls)
    assert_agrees(network, il.exact(network).statistics())


def test_springs_alone_are_the_inverse_of_the_stiffness():
    frequencies = {"a": 3.0, "b": 40.0, "c": 5.0, "d": 8.0, "e": 2.0}
    edges = {("a", "b"): 50.0, ("b", "c"): 2.0, ("b", "d"): 900.0, ("e", "d"): 10.0}
    couplings = {f"{i}{j}": il.Coupling(i, j, il.LinearCoupling(k)) for (i, j), k in edges.items()}
    network = heated({name: body(value) for name, value in frequencies.items()}, None, couplings, temperature=2.0)
    stiffness = np.diag([value**2 for value in frequencies.values()])
    for (i, j), k in edges.items():
        row = np.array([(name == i) - float(name == j) for name in frequencies])
        stiffness += k * np.outer(row, row)
    found = transfer_statistics(network)["mean_square_displacement"]
    np.testing.assert_allclose(list(found.values()), np.diag(2.0 * np.linalg.inv(stiffness)), rtol=CLOSE)


@pytest.mark.parametrize("seed", [4, 11, 12])
def test_mean_forces_balance(seed):
    """The mean force on every linear body is 0: its spring, couplings and contacts."""
    network = random_network(seed)
    found = transfer_statistics(network)
    mean, forces = found["mean_displacement"], found["mean_contact_force"]
    size = sum(forces.values())
    linear = [name for name, item in network.oscillators.items() if isinstance(item, il.LinearOscillator)]
    assert linear
    for name in linear:
        total = -network.oscillators[name].stiffness * mean[name]
        for key, contact in network.contacts.items():
            total += ((contact.second == name) - float(contact.first == name)) * forces[key]
        for coupling in network.couplings.values():
            sides = coupling.first, coupling.second
            if name in sides:
                (other,) = (side for side in sides if side != name)
                total += coupling.law.stiffness * (mean.get(other, 0.0) - mean[name])
        assert abs(total) < CLOSE * size


@pytest.mark.parametrize("seed", [4, 11, 12])
def test_two_resolutions_agree(seed):
    fine, coarse = (transfer_statistics(random_network(seed), item) for item in (Quadrature(28, 1e-13), Quadrature()))
    for name, by_label in fine.items():
        for label, value in by_label.items():
            assert coarse[name][label] == pytest.approx(value, rel=CLOSE, abs=1e-12)


def test_where_neighbours_press_against_each_other():
    """Two preloads against a body between them: its law lies far out on those of its neighbours."""
    stiff = body(30.0)
    contacts = {
        "left": il.Contact("a", "b", il.LinearContact(600.0), clearance=-0.33),
        "right": il.Contact("b", "c", il.LinearContact(600.0), clearance=-0.33),
    }
    network = heated({"a": stiff, "b": stiff, "c": stiff}, contacts, temperature=0.5)
    found = transfer_statistics(network)
    # both contacts are always closed, so that everything is linear and the mean is a static solution
    stiffness = np.diag([900.0, 900.0, 900.0]) + 600.0 * np.array(
        [[1.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]]
    )
    mean = np.linalg.solve(stiffness, [-198.0, 0.0, 198.0])
    np.testing.assert_allclose(list(found["mean_displacement"].values()), mean, rtol=CLOSE, atol=1e-9)
    variance = 0.5 * np.diag(np.linalg.inv(stiffness))
    np.testing.assert_allclose(list(found["variance_displacement"].values()), variance, rtol=CLOSE)
    np.testing.assert_allclose(list(found["contact_ratio"].values()), 1.0, rtol=CLOSE)


def test_a_law_far_from_where_the_springs_are_is_refused():
    press = {"wall": il.Contact("a", il.WALL, il.HertzContact(1e6), clearance=-20.0)}
    with pytest.raises(il.InvalidInput, match="12 standard deviations"):
        transfer_statistics(heated({"a": body(1.0)}, press))


class OtherLaw(il.ContactLaw):
    @staticmethod
    def force(indentation):
        return indentation


a, b, c = (body(value) for value in (3.0, 4.0, 5.0))
touch = il.HertzContact(1e3)
ring = {name: il.Contact(*name, touch) for name in ("ab", "bc", "ca")}


@pytest.mark.parametrize(
    ("network", "message"),
    [
        (heated({"a": a, "b": b, "c": c}, ring), "form a loop"),
        (base(contacts={"gap": il.Contact("one", "two", OtherLaw())}), "powers of the indentation"),
        (base(excitations={"one": il.WhiteNoise(3.0)}), "different temperatures"),
        (base(excitations={"one": None}), "white noise"),
        (base(oscillators={"one": il.LinearOscillator(damping=1.0)}), "with a spring"),
        (base(couplings={"damper": il.Coupling("one", "two", il.LinearCoupling(1.0, damping=1.0))}), "without damping"),
    ],
)
def test_what_transfer_integrals_cannot_do_is_refused(network, message):
    with pytest.raises(il.InvalidInput, match=message):
        transfer_statistics(network)
