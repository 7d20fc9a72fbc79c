"""Exact laws of rings: against trees, sums over three coordinates, closed forms, balances and a simulation."""

import itertools
import math

import numpy as np
import pytest
from impactlab_numerics.laws.contacts import ExponentialWall
from scenes import deviations

import impactlab as il
from impactlab.reference.reference import exact
from impactlab.reference.ring import RingLaw

pytestmark = pytest.mark.campaign

NULL = il.HertzContact(0.0)
NAMES = ["mean_displacement", "variance_displacement", "contact_ratio", "contact_rate", "mean_contact_force"]


def body(stiffness, mass=1.0):
    return il.LinearOscillator(mass=mass, damping=0.5, stiffness=stiffness)


def ring(bodies, laws, clearances, couplings=None):
    """Bodies a, b, c, … at 1 J, each in contact with the next, the last with the first."""
    names = "abcdef"[: len(bodies)]
    sides = [one + other for one, other in zip(names, names[1:] + names[0], strict=True)]
    contacts = {
        side: il.Contact(*side, law, clearance=clearance)
        for side, law, clearance in zip(sides, laws, clearances, strict=True)
    }
    noises = {name: il.WhiteNoise(item.damping / math.pi) for name, item in zip(names, bodies, strict=True)}
    return il.Network(dict(zip(names, bodies, strict=True)), contacts, noises, couplings)


HERTZ, LINEAR = il.HertzContact(3e4), il.LinearContact(500.0)


class Steep(il.Oscillator):
    """Forces that overflow in Python for large displacements."""

    length: float = il.parameter(units="m")

    @staticmethod
    def residual(displacement, length):
        return math.sinh(displacement / length) / length

    @staticmethod
    def residual_potential(displacement, length):
        return math.cosh(displacement / length) - 1.0


MIXED = ring(
    [body(30.0), body(90.0, 2.0), body(10.0), il.DuffingOscillator(damping=0.5, stiffness=20.0, cubic=200.0)],
    [HERTZ, LINEAR, il.PowerLawContact(900.0, exponent=2.2), NULL],
    [0.05, -0.2, 0.3, 0.0],
    {"bc": il.Coupling("b", "c", il.LinearCoupling(30.0)), "a": il.Coupling("a", il.WALL, il.LinearCoupling(10.0))},
)


@pytest.mark.parametrize(
    ("network", "null"),
    [
        (MIXED, "da"),
        (ring([body(4.0), body(120.0), body(40.0)], [HERTZ, NULL, il.LinearContact(1e8)], [-1.0, 0.0, 0.3]), "bc"),
        (
            ring(
                [Steep(1e-1, damping=0.5, stiffness=3.0), body(90.0), body(9.0)],
                [ExponentialWall(1e2, depth=1e-2), HERTZ, NULL],
                [0.1] * 3,
            ),
            "ca",
        ),
    ],
)
def test_a_ring_with_a_contact_without_force_is_a_chain(network, null):
    reference, chain = exact(network), exact(network.replace(contacts={null: None}))
    assert isinstance(reference.laws[0], RingLaw)
    found, expected = reference.statistics(), chain.statistics()
    for name in NAMES:
        kept = found[name].drop_sel(contact=null) if "contact" in found[name].dims else found[name]
        np.testing.assert_allclose(kept, expected[name], rtol=1e-10, atol=1e-12, err_msg=name)
    x = np.linspace(-0.8, 0.8, 9)
    np.testing.assert_allclose(
        reference.density("b", "displacement", x), chain.density("b", "displacement", x), rtol=1e-9, atol=1e-13
    )
    bins = [item.bin_density("c", "displacement", x) for item in (reference, chain)]
    np.testing.assert_allclose(*bins, rtol=1e-9, atol=1e-13)
    contact = next(name for name in network.contacts if name != null)
    for name, quantity in (("a", "displacement"), (contact, "contact_force")):
        level = chain.return_level(name, quantity, 1000.0)
        assert reference.return_level(name, quantity, 1000.0) == pytest.approx(level, rel=1e-9)
        bounds = [item.exceedance_bound(name, quantity, level) for item in (reference, chain)]
        assert bounds[0] == pytest.approx(bounds[1], rel=1e-7)


def test_springs_in_a_ring_are_gaussian():
    """A contact without force makes the law a ring's; without it the covariance is the inverse of the stiffness."""
    springs = {
        "ab": il.Coupling("a", "b", il.LinearCoupling(50.0)),
        "bc": il.Coupling("b", "c", il.LinearCoupling(7.0)),
        "ca": il.Coupling("c", "a", il.LinearCoupling(90.0)),
    }
    network = ring([body(k) for k in (9.0, 60.0, 25.0)], [NULL] * 3, [0.1] * 3, springs)
    gauss = exact(network.replace(contacts=dict.fromkeys(network.contacts))).statistics()
    data = exact(network).statistics()
    np.testing.assert_allclose(data.variance_displacement, gauss.variance_displacement, rtol=1e-11)
    np.testing.assert_allclose(data.mean_displacement, 0.0, atol=1e-13)


def test_contacts_that_stay_closed_are_springs():
    kappa, overlap, k = 100.0, 3.0, np.array([50.0, 30.0, 70.0])
    network = ring([body(item) for item in k], [il.LinearContact(kappa)] * 3, [-overlap, -overlap, -0.5 * overlap])
    data = exact(network).statistics()
    steps = np.array([[1.0, -1.0, 0.0], [0.0, 1.0, -1.0], [-1.0, 0.0, 1.0]])
    matrix = np.diag(k) + kappa * steps.T @ steps
    mean = np.linalg.solve(matrix, -kappa * steps.T @ (overlap * np.array([1.0, 1.0, 0.5])))
    np.testing.assert_allclose(data.variance_displacement, np.diag(np.linalg.inv(matrix)), rtol=1e-9)
    np.testing.assert_allclose(data.mean_displacement, mean, rtol=1e-9)


def test_triangle_against_three_dimensional_quadrature():
    """Sums over b, a − b and c − b, with edges wherever a contact closes."""
    k, eta, kappa, gaps = (30.0, 20.0, 50.0), 2e3, 400.0, (0.1, 0.2, 0.15)
    network = ring(
        [body(item) for item in k], [il.HertzContact(eta), il.LinearContact(kappa), il.HertzContact(eta)], gaps
    )
    nodes, weights = np.polynomial.legendre.leggauss(16)

    def panels(edges):
        half = 0.5 * np.diff(edges)[:, None]
        return (edges[:-1, None] + half * (1.0 + nodes)).ravel(), (half * weights).ravel()

    b, wb = panels(np.linspace(-1.9, 1.9, 7))
    near = 0.03 * 2.0 ** np.arange(-4.0, 4.0)
    total, sums = 0.0, np.zeros(8)
    meet = -gaps[1] - gaps[2]  # of a − b: b touches c where c touches a
    some = np.linspace(-1.6, 0.7, 9)
    us, wu = panels(np.unique([*some[np.abs(some - 0.1) > 0.05], meet, *(meet - near), gaps[0], *(gaps[0] + near)]))
    for u, weight in zip(us, wu, strict=True):  # a − b
        corners = -gaps[1], u + gaps[2]  # of c − b: b touches c below the first, c touches a above the second
        fine = np.concatenate([[corner - sign * near for sign in (1.0, -1.0)] for corner in corners]).ravel()
        edges = np.unique([*corners, *fine, *np.linspace(-1.8, 1.8, 7)])
        v, wv = panels(edges[np.abs(edges) <= 1.8])
        ab, bc, ca = u - gaps[0], -v - gaps[1], v - u - gaps[2]
        of_links = (
            0.4 * eta * (max(ab, 0.0) ** 2.5 + np.maximum(ca, 0.0) ** 2.5) + 0.5 * kappa * np.maximum(bc, 0.0) ** 2
        )
        x = b[:, None], b[:, None] + u, b[:, None] + v
        energy = 0.5 * (k[1] * x[0] ** 2 + k[0] * x[1] ** 2 + k[2] * x[2] ** 2) + of_links
        density = weight * wb[:, None] * wv * np.exp(-energy)
        total += density.sum()
        of_v = density.sum(axis=0)
        forces = eta * max(ab, 0.0) ** 1.5, kappa * np.maximum(bc, 0.0), eta * np.maximum(ca, 0.0) ** 1.5
        sums += [
            of_v.sum() * (ab > 0.0), of_v @ (bc > 0.0), of_v @ (ca > 0.0),
            *(of_v @ (force + 0.0 * v) for force in forces),
            (density * x[1] ** 2).sum(), (density * x[2] ** 2).sum(),
        ]  # fmt: skip
    data = exact(network).statistics()
    found = [*data.contact_ratio.values, *data.mean_contact_force.values, *data.mean_square_displacement.values[[0, 2]]]
    np.testing.assert_allclose(found, sums / total, rtol=1e-7)


def test_forces_balance():
    """The mean force on every linear body is 0, in a ring of five in which everything acts."""
    stiffness = (30.0, 90.0, 20.0, 60.0, 40.0)
    laws = [HERTZ, LINEAR, il.PowerLawContact(900.0, exponent=2.2), il.HertzContact(500.0), LINEAR]
    data = exact(ring([body(k) for k in stiffness], laws, [0.05, -0.2, 0.1, 0.0, 0.2])).statistics()
    force, mean = data.mean_contact_force.values, data.mean_displacement.values
    np.testing.assert_allclose(np.array(stiffness) * mean, np.roll(force, 1) - force, rtol=1e-9, atol=1e-11)


def test_simulation_of_a_ring():
    network = ring([body(40.0), body(90.0), body(25.0)], [il.HertzContact(1e4)] * 3, [0.05, 0.1, 0.0])
    result = il.simulate(network, 200.0, realizations=256, rng=2)
    names = [*NAMES, "mean_square_velocity"]
    for name, found in deviations(result, exact(network).statistics(), names, relative=1e-3).items():
        assert found < 3.5, (name, found)


def test_what_is_not_a_ring_alone_is_refused():
    def refused(network, error=il.NoExactReference):
        with pytest.raises(error) as caught:
            exact(network)
        return str(caught.value)

    network = ring([body(40.0)] * 3, [HERTZ] * 3, [0.1] * 3)
    walled = network.replace(contacts={"wall": il.Contact("a", il.WALL, HERTZ, clearance=0.1)})
    message = "'a' and 'b' and 'c' are connected in loops; the law is computed for trees"
    assert message in refused(walled)
    branch = network.replace(
        oscillators={"d": body(40.0)},
        contacts={"cd": il.Contact("c", "d", HERTZ)},
        excitations={"d": il.WhiteNoise(0.5 / math.pi)},
    )
    assert message in refused(branch)
    bodies = {name: il.LinearOscillator(damping=0.5) for name in "abc"}
    assert "in a loop the law is computed for bodies with springs only" in refused(network.replace(oscillators=bodies))
    unlike = network.replace(oscillators={"a": body(4e6)})
    assert "their springs or contacts differ too much in stiffness" in refused(unlike)
    with pytest.raises(il.NoExactReference, match="joint density of 'a' and 'b', which are in a loop"):
        exact(network).joint_density("a", "b", 0.0, 0.0)


def test_every_body_is_looked_from():
    """The order of bodies and contacts does not matter."""
    network = ring([body(30.0), body(90.0, 2.0), body(10.0)], [HERTZ, LINEAR, LINEAR], [0.05, -0.2, 0.3])
    data = exact(network).statistics()
    order = {name: network.oscillators[name] for name in "cab"}
    turned = il.Network(order, dict(reversed(network.contacts.items())), network.excitations)
    other = exact(turned).statistics()
    for name, dim in itertools.product(NAMES, ("oscillator", "contact")):
        if dim in data[name].dims:
            np.testing.assert_allclose(other[name].sel({dim: data[dim]}), data[name], rtol=1e-9, atol=1e-13)
