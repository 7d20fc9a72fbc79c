"""Exact laws of trees: against quadrature, closed forms, the law of pairs and themselves, refined."""

import itertools
import math

import numpy as np
import pytest
from laws import DoubleWell, SofteningContact, TwoWells

import impactlab as il
from impactlab.components.sides import WALL
from impactlab.reference import conditions, piecewise, subsystems
from impactlab.reference.reference import exact


def body(stiffness, mass=1.0, cubic=None):
    if cubic is None:
        return il.LinearOscillator(mass=mass, damping=0.5, stiffness=stiffness)
    return il.DuffingOscillator(mass=mass, damping=0.5, stiffness=stiffness, cubic=cubic)


def heated(bodies, contacts=None, couplings=None, temperature=1.0):
    noises = {
        name: il.WhiteNoise(temperature * item.damping / math.pi) for name, item in bodies.items() if item.damping
    }
    return il.Network(bodies, contacts, noises, couplings)


def spring(one, other, stiffness):
    return il.Coupling(one, other, il.LinearCoupling(stiffness))


def tree_law(network):
    """The law by transfer integrals, also where there is a simpler one."""
    (subsystem,) = subsystems.subsystems_of(network)
    (temperature,) = set(subsystem.temperatures.values())
    return conditions.tree_law(subsystem, temperature)


SOFT, STIFF = body(1.0, 0.5), body(900.0, 2.0)
HERTZ = il.HertzContact(2e4)
PAIRS = {
    "base": ((STIFF, SOFT), {"gap": il.Contact("a", "b", HERTZ, clearance=0.1)}),
    "preload": ((STIFF, SOFT), {"gap": il.Contact("b", "a", HERTZ, clearance=-2.0)}),
    "rare": ((SOFT, SOFT), {"gap": il.Contact("a", "b", il.LinearContact(1e8), clearance=7.0)}),
    "hard": ((SOFT, STIFF), {"gap": il.Contact("a", "b", il.HertzContact(1e12), clearance=1.0)}),
    "kink": ((SOFT, SOFT), {"gap": il.Contact("a", "b", SofteningContact(stiffness=40.0, depth=1e-3), clearance=0.1)}),
    "cage": (
        (SOFT, il.LinearOscillator(mass=0.2)),
        {
            "one": il.Contact("a", "b", HERTZ, clearance=0.1),
            "other": il.Contact("b", "a", il.LinearContact(1e4), clearance=0.2),
        },
    ),
}


@pytest.mark.full
@pytest.mark.parametrize("name", PAIRS)
def test_pairs_by_transfer_integrals(name):
    """The pair has a law of its own, with one integral over the gap."""
    bodies, contacts = PAIRS[name]
    network = heated(dict(zip("ab", bodies, strict=True)), contacts)
    law, other = tree_law(network), exact(network).laws[0]
    for item in "ab":
        mean, variance = other.moments(item)
        assert law.moments(item)[1] == pytest.approx(variance, rel=1e-11)
        assert law.moments(item)[0] == pytest.approx(mean, abs=1e-11 * math.sqrt(variance))
        x = mean + math.sqrt(variance) * np.linspace(-4.0, 4.0, 9)
        np.testing.assert_allclose(law.density(item, x), other.density(item, x), rtol=1e-9, atol=1e-20)
        np.testing.assert_allclose(law.probability(item, x), other.probability(item, x), atol=1e-11)
    for contact in contacts.values():
        np.testing.assert_allclose(law.contact(contact), other.contact(contact), rtol=1e-10)
    joint = [item.joint_density("b", "a", np.array([0.05, 0.3]), np.array([0.01, 0.3])) for item in (law, other)]
    np.testing.assert_allclose(*joint, rtol=1e-9)


@pytest.mark.full
def test_couplings_alone_are_gaussian():
    """The covariance of displacements is T times the inverse of the stiffness."""
    stiffness = {"a": 9.0, "b": 1600.0, "c": 25.0, "d": 64.0, "e": 0.0}
    edges = {("a", "b"): 50.0, ("b", "c"): 2.0, ("d", "b"): 900.0, ("e", "d"): 10.0}
    couplings = {f"{i}{j}": spring(i, j, k) for (i, j), k in edges.items()}
    couplings["wall"] = spring(WALL, "c", 7.0)
    bodies = {name: body(k) for name, k in stiffness.items()}
    reference = exact(heated(bodies, {"none": il.Contact("a", "b", il.HertzContact(0.0))}, couplings, temperature=2.0))
    matrix = np.diag([*stiffness.values()]) + np.diag([0.0, 0.0, 7.0, 0.0, 0.0])
    for (i, j), k in edges.items():
        row = np.array([(name == i) - float(name == j) for name in bodies])
        matrix += k * np.outer(row, row)
    covariance = 2.0 * np.linalg.inv(matrix)
    found = reference.statistics().mean_square_displacement
    np.testing.assert_allclose(found, np.diag(covariance), rtol=1e-11)
    for i, j in (("a", "b"), ("c", "e"), ("e", "a")):
        index = [list(bodies).index(name) for name in (i, j)]
        part = covariance[np.ix_(index, index)]
        x = np.sqrt(np.diag(part)) * np.array([[0.3, -0.2], [1.0, 1.5]])
        expected = np.exp(-0.5 * np.einsum("ni,ij,nj->n", x, np.linalg.inv(part), x))
        expected /= 2.0 * math.pi * math.sqrt(np.linalg.det(part))
        np.testing.assert_allclose(reference.joint_density(i, j, x[:, 0], x[:, 1]), expected, rtol=1e-9)


@pytest.mark.full
def test_chain_against_three_dimensional_quadrature():
    """Three bodies between walls: sums over the gaps, in which every kink lies on an edge, and the middle body."""
    k, cubic, eta, kappa, gap, wall = (30.0, 20.0, 50.0), 300.0, 2e3, 400.0, 0.1, 0.5
    bodies = {"a": body(k[0]), "b": body(k[1], 3.0, cubic), "c": body(k[2], 0.3)}
    contacts = {
        "ab": il.Contact("a", "b", il.HertzContact(eta), clearance=gap),
        "bc": il.Contact("b", "c", il.LinearContact(kappa), clearance=-gap),
        "wall": il.Contact("c", WALL, il.LinearContact(kappa), clearance=wall),
    }
    network = heated(bodies, contacts, {"spring": spring("a", "b", 15.0)})
    data = exact(network).statistics()

    nodes, weights = np.polynomial.legendre.leggauss(20)

    def panels(edges):
        half = 0.5 * np.diff(edges)[:, None]
        return (edges[:-1, None] + half * (1.0 + nodes)).ravel(), (half * weights).ravel()

    steps = 0.02 * 2.0 ** np.arange(-6.0, 8.0)
    b, wb = panels(np.unique([*np.linspace(-1.4, 1.4, 13), wall - gap]))
    ab, wab = panels(np.unique([-2.0, *np.linspace(-1.6, gap, 7), *(gap + steps[gap + steps < 1.0])]))
    a = b[:, None] + ab
    of_a = np.exp(-0.5 * k[0] * a**2 - 0.4 * eta * np.maximum(ab - gap, 0.0) ** 2.5 - 7.5 * ab**2) * wab
    # the sum over c, with edges at its wall and where it touches b
    c_sums = []
    for place in b:
        corner = place + gap  # δ = b − c + gap > 0 below it
        c, wc = panels(np.unique([-1.6, 1.6, wall, corner, *np.linspace(-1.5, 1.5, 7)]))
        closed = np.maximum(corner - c, 0.0)
        energy = 0.5 * k[2] * c**2 + 0.5 * kappa * (closed**2 + np.maximum(c - wall, 0.0) ** 2)
        values = wc * np.exp(-energy)
        c_sums.append([values @ f for f in (np.ones_like(c), c**2, closed > 0.0, kappa * closed, c > wall)])
    of_c = np.array(c_sums).T
    of_b = np.exp(-0.5 * k[1] * b**2 - 0.25 * cubic * b**4) * wb
    a_sums = [of_a @ f for f in (np.ones_like(ab), ab > gap, eta * np.maximum(ab - gap, 0.0) ** 1.5)]
    total = of_b @ (a_sums[0] * of_c[0])
    expected = {
        "ratio": [of_b @ (a_sums[1] * of_c[0]), of_b @ (a_sums[0] * of_c[2]), of_b @ (a_sums[0] * of_c[4])],
        "force": [of_b @ (a_sums[2] * of_c[0]), of_b @ (a_sums[0] * of_c[3])],
        "square": [of_b @ ((of_a * a**2).sum(axis=1) * of_c[0]), of_b @ (b**2 * a_sums[0] * of_c[0])],
    }
    np.testing.assert_allclose(data.contact_ratio, np.array(expected["ratio"]) / total, rtol=1e-8)
    np.testing.assert_allclose(data.mean_contact_force[:2], np.array(expected["force"]) / total, rtol=1e-8)
    np.testing.assert_allclose(data.mean_square_displacement[:2], np.array(expected["square"]) / total, rtol=1e-8)
    assert data.mean_square_displacement[2] == pytest.approx(of_b @ (a_sums[0] * of_c[1]) / total, rel=1e-8)


@pytest.mark.full
def test_hard_bodies_in_a_box():
    """Without springs and for hard contacts the gaps share the free length evenly: the law of Tonks.

    Four bodies between walls with five gaps of 1 m: the mean gap is 1 m, each displacement has
    the variance of an order statistic, and each contact closes at the rate of a flat density.
    """
    count, stiffness = 4, 1e10
    network = il.chain(
        count, il.LinearOscillator(damping=1.0), il.LinearContact(stiffness), clearance=1.0, walls=True,
        excitation=il.WhiteNoise(1.0 / math.pi),
    )  # fmt: skip
    data = exact(network).statistics()
    free, depth = count + 1.0, math.sqrt(0.5 * math.pi / stiffness)  # of penetration, (π/2κ)^½ at T = 1
    index = np.arange(1, count + 1)
    variance = free**2 * index * (free - index) / (free**2 * (free + 1.0))
    np.testing.assert_allclose(data.variance_displacement, variance, rtol=20.0 * depth)
    np.testing.assert_allclose(data.mean_displacement, 0.0, atol=1e-9)
    np.testing.assert_allclose(data.contact_ratio, depth * count / free, rtol=20.0 * depth)
    masses = np.array([1.0, 2.0, 2.0, 2.0, 1.0])
    np.testing.assert_allclose(data.contact_rate, np.sqrt(masses / (2.0 * math.pi)) * count / free, rtol=20.0 * depth)


@pytest.mark.campaign
def test_forces_balance_and_virial():
    """Mean force 0 on every body, and the virial Σ E[x F] = n T; a star of unequal bodies in a wall."""
    bodies = {"hub": DoubleWell(depth=2.0, damping=1.0), "a": body(3.0), "b": body(70.0), "c": body(20.0, 5.0, 9.0)}
    contacts = {
        name: il.Contact("hub", name, law, clearance=clearance)
        for name, law, clearance in (("a", HERTZ, 0.2), ("b", il.LinearContact(50.0), -0.3))
    }
    contacts |= {
        "c": il.Contact("c", "hub", il.PowerLawContact(30.0, exponent=0.5), clearance=0.4),
        "wall": il.Contact(WALL, "hub", HERTZ, clearance=1.1),
    }
    reference = exact(heated(bodies, contacts, {"k": spring("hub", "c", 4.0)}))
    data = reference.statistics()
    force = data.mean_contact_force.to_series()
    mean = data.mean_displacement.to_series()
    assert 3.0 * mean["a"] == pytest.approx(force["a"], rel=1e-10)
    assert 70.0 * mean["b"] == pytest.approx(force["b"], rel=1e-10)
    nodes, weights = np.polynomial.legendre.leggauss(12)
    edges = np.linspace(-3.0, 3.0, 301)
    x = (0.5 * (edges[1:] + edges[:-1])[:, None] + 0.5 * np.diff(edges)[:, None] * nodes).ravel()
    probability = reference.density("hub", "displacement", x) * np.tile(0.01 * weights, 300)
    assert probability.sum() == pytest.approx(1.0, abs=1e-9)
    well = probability @ (8.0 * x * (x**2 - 1.0))
    applied = -force["a"] - force["b"] + force["c"] + force["wall"] + 4.0 * (mean["c"] - mean["hub"])
    assert well == pytest.approx(applied, abs=1e-8)
    bins = reference.bin_density("hub", "displacement", edges)
    np.testing.assert_allclose(bins, probability.reshape(300, 12).sum(axis=1) / 0.02, atol=1e-9)


CHAIN = il.chain(
    3, body(40.0), il.HertzContact(1e4), clearance=0.05, excitation=il.WhiteNoise(0.5 / math.pi), walls=True
)


@pytest.mark.campaign
def test_long_chains_of_equal_bodies_are_computed_once(monkeypatch):
    """The middle of a chain costs nothing: more than twice the length takes the same integrals."""
    counts, original = [], piecewise.shifted_integrals

    def counted(edges, kernel, shifts):
        counts[-1] += 1
        return original(edges, kernel, shifts)

    monkeypatch.setattr("impactlab.reference.messages.shifted_integrals", counted)
    law = body(40.0)
    rows = []
    for count in (120, 300):
        counts.append(0)
        chain = il.chain(count, law, il.HertzContact(1e4), clearance=0.05, excitation=il.WhiteNoise(0.5 / math.pi))
        rows.append(exact(chain).statistics())
    assert counts[1] == counts[0] > 0
    short, long = rows
    for name in ("mean_square_displacement", "contact_ratio", "contact_rate", "mean_contact_force"):
        assert long[name].values[150] == pytest.approx(short[name].values[60], rel=1e-10)
        np.testing.assert_allclose(long[name][:20], short[name][:20], rtol=1e-10)


@pytest.mark.full
def test_closed_contacts_are_springs():
    """Linear contacts that never open are Gaussian about a shifted place."""
    preload, kappa, k = -3.0, 100.0, 50.0
    chain = il.chain(4, body(k), il.LinearContact(kappa), clearance=preload, excitation=il.WhiteNoise(0.5 / math.pi))
    data = exact(chain).statistics()
    steps = np.diff(np.eye(4), axis=0)
    matrix = k * np.eye(4) + kappa * steps.T @ steps
    mean = np.linalg.solve(matrix, -kappa * preload * steps.T @ np.ones(3))
    np.testing.assert_allclose(data.variance_displacement, np.diag(np.linalg.inv(matrix)), rtol=1e-10)
    np.testing.assert_allclose(data.mean_displacement, mean, rtol=1e-10)


def refused(network):
    with pytest.raises(il.NoExactReference) as caught:
        exact(network)
    return str(caught.value)


@pytest.mark.full
def test_refusals():
    names = "abcde"
    bodies = {name: body(5.0) for name in names}
    ring = {f"{i}{j}": il.Contact(i, j, HERTZ) for i, j in [*itertools.pairwise("abcd"), ("d", "b"), ("d", "e")]}
    assert "'b' and 'c' and 'd' are connected in loops; the law is computed for trees" in refused(heated(bodies, ring))
    free = {name: il.LinearOscillator(damping=1.0) for name in "abc"}
    line = {f"{i}{j}": il.Contact(i, j, HERTZ) for i, j in itertools.pairwise("abc")}
    assert "'a': the law cannot be normalised, because neither springs nor contacts confine it" in refused(
        heated(free, line)
    )
    cold = {"a": SOFT, "b": SOFT, "c": il.LinearOscillator(stiffness=1.0)}
    slack = line | {"bc": il.Contact("b", "c", il.HertzContact(0.0))}
    assert "'c' has neither noise nor damping, and nothing heats it" in refused(heated(cold, slack))
    exact(heated(cold, line))
    pressed = heated(dict.fromkeys("ab", SOFT), {"gap": il.Contact("a", "b", il.LinearContact(1e12), clearance=-20.0)})
    with pytest.raises(il.NoExactReference, match="too stiff for their preload"):
        tree_law(pressed)
    many = il.chain(50, body(1.0), HERTZ, excitation=il.WhiteNoise(1.0))
    many = many.replace(excitations={"body_7": il.WhiteNoise(3.0)})
    message = refused(many)
    assert (
        "differ: 'body_0' 6.28319 J, 'body_7' 18.8496 J; with S = 1 N2 s rad-1 on 'body_7' they would be equal."
        in message
    )


@pytest.mark.full
@pytest.mark.parametrize("clearance", [-0.4, 0.3])
@pytest.mark.parametrize(
    "well", [pytest.param(2.0, marks=pytest.mark.campaign), 6.0, pytest.param(40.0, marks=pytest.mark.campaign)]
)
def test_a_pair_with_two_wells_each(well, clearance):
    """Against a sum; the curvature is negative between the wells, where the way to the least energy begins."""
    temperature = 0.7
    body = TwoWells(well, wall=3.0, mass=1.0, damping=0.5, stiffness=1.0)
    gap = il.Contact("b", "a", il.LinearContact(20.0), clearance=clearance)
    noise = il.WhiteNoise(0.5 * temperature / np.pi)
    exact = il.exact(il.Network({"a": body, "b": body}, {"gap": gap}, {"a": noise, "b": noise})).statistics()
    x = np.linspace(-4.5, 4.5, 1801)
    own = 0.5 * x**2 + TwoWells.residual_potential(x, well, 3.0)
    indentation = np.maximum(x[None, :] - x[:, None] - clearance, 0.0)
    energy = own[:, None] + own[None, :] + 10.0 * indentation**2
    density = np.exp(-(energy - energy.min()) / temperature)
    density /= density.sum()
    of_a = density.sum(axis=1)
    assert float(exact.mean_displacement[0]) == pytest.approx(of_a @ x, abs=1e-5)
    assert float(exact.mean_square_displacement[0]) == pytest.approx(of_a @ x**2, rel=1e-5)
    assert float(exact.mean_contact_force[0]) == pytest.approx((density * 20.0 * indentation).sum(), rel=2e-3)
