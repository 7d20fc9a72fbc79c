"""Exact laws with couplings that are nonlinear springs, against quadrature by hand, and against runs."""

import math

import numpy as np
import pytest
from scipy.integrate import dblquad, quad

import impactlab as il

TEMPERATURE = 0.4
BREAK = il.BilinearCoupling(40.0, outer_stiffness=3.0, break_extension=0.1)
CUBIC = il.CubicCoupling(60.0)


def body(stiffness, mass=1.0, damping=0.4):
    return il.LinearOscillator(mass=mass, damping=damping, stiffness=stiffness)


def heated(bodies, couplings, contacts=None):
    """A network at one temperature."""
    noises = {
        name: il.WhiteNoise(item.damping * TEMPERATURE / math.pi) for name, item in bodies.items() if item.damping
    }
    return il.Network(bodies, contacts or {}, noises, couplings)


def broken(e):
    inner = min(abs(e), 0.1)
    return 20.0 * inner**2 + (4.0 + 1.5 * (abs(e) - inner)) * (abs(e) - inner)


@pytest.mark.parametrize(("sides", "sign"), [((il.WALL, "a"), 1.0), (("a", il.WALL), -1.0)])
def test_a_body_on_a_spring_of_two_slopes(sides, sign):
    """Beside a residual force and a stop, which make the sides differ."""

    def weight(x):
        stop = 0.5 * 500.0 * max(x - 0.3, 0.0) ** 2
        return math.exp(-(0.5 * x**2 + 0.25 * 2.0 * x**4 + broken(sign * x) + stop) / TEMPERATURE)

    points = [-0.1, 0.1, 0.3]
    moments = [
        quad(lambda x, n=n: x**n * weight(x), -4.0, 2.0, points=points, limit=200, epsrel=1e-12)[0] for n in range(3)
    ]
    network = heated(
        {"a": il.DuffingOscillator(2.0, damping=0.4, stiffness=1.0)}, {"s": il.Coupling(*sides, BREAK)},
        {"stop": il.Contact("a", il.WALL, il.LinearContact(500.0), clearance=0.3)},
    )  # fmt: skip
    found = il.exact(network).statistics()
    assert found.mean_displacement.item() == pytest.approx(moments[1] / moments[0], rel=1e-8)
    assert found.mean_square_displacement.item() == pytest.approx(moments[2] / moments[0], rel=1e-8)


class Slope(il.CouplingLaw):
    """A force that is not odd, with its potential."""

    stiffness: float = il.parameter(units="N m-1", minimum=0.0)
    push: float = il.parameter(units="N m-2", minimum=0.0)

    @staticmethod
    def force(extension, stiffness, push):
        return stiffness * extension + push * extension * abs(extension) * (2.0 if extension > 0.0 else 1.0)

    @staticmethod
    def potential(extension, stiffness, push):
        return 0.5 * stiffness * extension**2 + push * abs(extension) ** 3 * (2.0 if extension > 0.0 else 1.0) / 3.0


@pytest.mark.full
@pytest.mark.parametrize("held", [False, True], ids=["one integral", "transfer integrals"])
def test_a_pair_with_a_spring_that_is_not_odd(held):
    """The plane is integrated by hand; a spring to the ground makes the law that of a tree."""

    def energy(x, y):
        e = y - x
        own = 15.0 * x**4 if held else 0.0
        return (
            0.5 * 3.0 * x**2
            + 0.5 * 5.0 * y**2
            + own
            + 0.5 * e**2
            + 20.0 * abs(e) ** 3 * (2.0 if e > 0.0 else 1.0) / 3.0
        )

    def moment(function):
        options = {"epsabs": 1e-11, "epsrel": 1e-10}
        parts = ((-3.0, lambda x: x), (lambda x: x, 3.0))
        return sum(
            dblquad(lambda y, x: function(x, y) * math.exp(-energy(x, y) / TEMPERATURE), -3.0, 3.0, *part, **options)[0]
            for part in parts
        )

    couplings = {"s": il.Coupling("a", "b", Slope(1.0, push=20.0))}
    couplings |= {"own": il.Coupling("a", il.WALL, CUBIC)} if held else {}
    found = il.exact(heated({"a": body(3.0), "b": body(5.0, mass=2.0)}, couplings)).statistics()
    total = moment(lambda x, y: 1.0)
    for row, function in enumerate((lambda x, y: x, lambda x, y: y)):
        mean = moment(function) / total
        square = moment(lambda x, y, function=function: function(x, y) ** 2) / total
        assert found.mean_displacement[row].item() == pytest.approx(mean, rel=1e-7)
        assert found.mean_square_displacement[row].item() == pytest.approx(square, rel=1e-8)


@pytest.mark.full
def test_a_chain_of_cubic_springs_is_the_same_from_either_end():
    """With a contact between, and a linear part that is a coupling of its own or the body's."""
    bodies = {name: body(stiffness) for name, stiffness in zip("abc", (2.0, 4.0, 7.0), strict=True)}
    contact = {"gap": il.Contact("a", "b", il.HertzContact(1e3), clearance=0.05)}
    springs = {
        "ab": il.Coupling("a", "b", CUBIC), "bc": il.Coupling("c", "b", BREAK),
        "more": il.Coupling("b", "c", il.LinearCoupling(5.0)),
    }  # fmt: skip
    one = il.exact(heated(bodies, springs, contact)).statistics()
    stiffer = il.BilinearCoupling(45.0, outer_stiffness=8.0, break_extension=0.1)
    other = {"ab": il.Coupling("b", "a", CUBIC), "bc": il.Coupling("b", "c", stiffer)}
    two = il.exact(heated(dict(reversed(bodies.items())), other, contact)).statistics().sel(oscillator=list("abc"))
    for name in ("mean_displacement", "mean_square_displacement", "contact_ratio"):
        np.testing.assert_allclose(one[name], two[name], rtol=1e-9, err_msg=name)


def test_a_cold_body_is_heated_by_its_spring():
    network = heated({"a": body(3.0), "b": il.LinearOscillator(stiffness=2.0)}, {"s": il.Coupling("a", "b", CUBIC)})
    assert il.exact(network).statistics().mean_square_velocity.values == pytest.approx(TEMPERATURE)
    with pytest.raises(il.NoExactReference, match="'b' has neither noise nor damping, and nothing heats it"):
        il.exact(network.replace(couplings={"s": il.Coupling("a", "b", il.CubicCoupling(0.0))}))


def test_a_potential_that_is_not_that_of_its_force_is_refused():
    class Wrong(il.CouplingLaw):
        stiffness: float = il.parameter(units="N m-1")

        @staticmethod
        def force(extension, stiffness):
            return stiffness * extension

        @staticmethod
        def potential(extension, stiffness):
            return stiffness * extension * extension

    with pytest.raises(il.InvalidInput, match=r"Wrong.potential of coupling 's' is not the integral of Wrong.force"):
        heated({"a": body(1.0)}, {"s": il.Coupling("a", il.WALL, Wrong(1.0))})


@pytest.mark.campaign
@pytest.mark.parametrize("law", [BREAK, CUBIC, il.PowerLawCoupling(5.0, exponent=0.5)], ids=repr)
def test_runs_with_nonlinear_springs_against_their_exact_law(law):
    couplings = {"s": il.Coupling("a", "b", law), "own": il.Coupling("a", il.WALL, law)}
    contacts = {"gap": il.Contact("a", "b", il.HertzContact(1e4), clearance=0.1)}
    network = heated({"a": body(1.0), "b": body(5.0, mass=2.0)}, couplings, contacts)
    result, exact = il.simulate(network, 100.0, realizations=1024, rng=4), il.exact(network).statistics()
    for name in ("mean_square_displacement", "mean_square_velocity", "contact_ratio"):
        error = result[f"{name}_standard_error"].values
        assert (error < 1e-2 * exact[name].values).all()
        assert (np.abs(result[name].values - exact[name].values) < 5e-3 * exact[name].values + 3.0 * error).all(), name
