"""Potentials that are not the work of their forces are found when a network is made; right ones pass."""

import math

import numpy as np
import pytest
from laws import DoubleWell

import impactlab as il
from impactlab.reference.reference import exact


class PrintedHertzContact(il.HertzContact):
    """The potential with the exponent of the force, as Luo, Yan and Zhang (2023) print it."""

    @staticmethod
    def potential(indentation, stiffness):
        return 0.4 * stiffness * indentation * math.sqrt(indentation)


class ScaledContact(il.ContactLaw):
    factor: float = il.parameter()
    offset: float = il.parameter(0.0, units="J")

    @staticmethod
    def force(indentation):
        return indentation**2

    @staticmethod
    def potential(indentation, factor, offset):
        return factor * indentation**3 / 3.0 + offset


class ExponentialContact(il.ContactLaw):
    """Overflows for large indentations; terms cancel for small ones. Right if `term` is 1."""

    length: float = il.parameter(units="m", above=0.0)
    term: float = il.parameter(1.0)

    @staticmethod
    def force(indentation, length):
        return (math.exp(indentation / length) - 1.0) / length

    @staticmethod
    def potential(indentation, length, term):
        return math.exp(indentation / length) - 1.0 - term * indentation / length


class CosineContact(il.ContactLaw):
    """A term that is rounded away for small indentations beside one that is not."""

    length: float = il.parameter(units="m", above=0.0)

    @staticmethod
    def force(indentation, length):
        return 4.0 * math.sin(indentation / length) + 5.0 * indentation / length

    @staticmethod
    def potential(indentation, length):
        return 4.0 * length * (1.0 - math.cos(indentation / length)) + 2.5 * indentation**2 / length


class StagedContact(il.ContactLaw):
    """Nothing up to a depth, then a force that jumps, or whose slope does."""

    depth: float = il.parameter(units="m")
    jump: float = il.parameter(units="N")

    @staticmethod
    def force(indentation, depth, jump):
        return 0.0 if indentation < depth else jump + 30.0 * (indentation - depth)

    @staticmethod
    def potential(indentation, depth, jump):
        rest = max(indentation - depth, 0.0)
        return jump * rest + 15.0 * rest**2


class ShortContact(il.ContactLaw):
    """Not defined beyond an indentation."""

    limit: float = il.parameter(units="m")

    @staticmethod
    def force(indentation, limit):
        return indentation / (1.0 - indentation / limit)

    @staticmethod
    def potential(indentation, limit):
        return -limit * indentation - limit**2 * math.log(1.0 - indentation / limit)


class NumpyContact(il.ContactLaw):
    """Overflows with a warning."""

    @staticmethod
    def force(indentation):
        return np.exp(1e3 * indentation) - 1.0

    @staticmethod
    def potential(indentation):
        return 1e-3 * (np.exp(1e3 * indentation) - 1.0) - indentation


class DashpotContact(il.ContactLaw):
    """What its potential should be is not known."""

    @staticmethod
    def force(indentation, rate):
        return indentation * (1.0 + rate)

    @staticmethod
    def potential(indentation):
        return 7.0


class OneSided(il.Oscillator):
    """A residual force whose potential is wrong on the left."""

    @staticmethod
    def residual(displacement):
        return displacement**3

    @staticmethod
    def residual_potential(displacement):
        return 0.25 * displacement**4 if displacement > 0.0 else 0.3 * displacement**4


BODY = il.LinearOscillator(damping=1.0, stiffness=50.0)


def touching(*laws):
    contacts = {f"c{k}": il.Contact("a", "b", law, clearance=0.1) for k, law in enumerate(laws)}
    return il.Network({"a": BODY, "b": BODY}, contacts)


@pytest.mark.parametrize(
    ("law", "message"),
    [
        (PrintedHertzContact(1e4), r"not the integral of PrintedHertzContact\.force: from 0\.0\d+ m to .* it grows by"),
        (ScaledContact(2.0), "not the integral"),
        (ScaledContact(1.0 + 1e-5), "not the integral"),
        (ScaledContact(0.0), "grows by 0 J"),
        (ScaledContact(1.0, offset=1e-3), r"ScaledContact\.potential of contact 'c1' is 0\.001 J at 0"),
        *((ExponentialContact(length, term=0.0), "not the integral") for length in (1e-6, 1e-3, 1.0)),
    ],
)
def test_wrong_potentials_are_refused(law, message):
    with pytest.raises(il.InvalidInput, match=message) as caught:
        touching(il.HertzContact(1e4), law)
    assert f"{type(law).__name__}.potential of contact 'c1'" in str(caught.value)
    assert "or leave it out: only exact laws need it" in str(caught.value)


@pytest.mark.parametrize(
    "law",
    [
        *(il.PowerLawContact(stiffness, exponent=p) for stiffness in (1e-20, 1e12) for p in (0.05, 2.7, 20.0)),
        *(ExponentialContact(length) for length in (1e-6, 1e-3, 1.0, 1e3)),
        *(CosineContact(length) for length in (1e-6, 1e-3, 0.1, 1.0, 100.0)),
        *(
            StagedContact(depth=depth, jump=jump)
            for depth in (1e-6, 1.0 / 3.0, 0.4985, 0.5, 0.501)
            for jump in (0.0, 100.0)
        ),
        ShortContact(0.02),
        ScaledContact(1.0 + 1e-7),
        NumpyContact(),
        DashpotContact(),
        il.HertzContact(0.0),
    ],
)
def test_right_potentials_pass(law):
    touching(law)


@pytest.mark.full
def test_a_potential_that_overflows_where_its_force_does_not_is_refused():
    """From 710 lengths on ``log cosh`` is infinite; an exact law would take that for a wall."""

    class OverflowingContact(il.ContactLaw):
        length: float = il.parameter(units="m")

        @staticmethod
        def force(indentation, length):
            return math.tanh(indentation / length)

        @staticmethod
        def potential(indentation, length):
            return length * math.log(math.cosh(indentation / length))

    contact = il.Contact("a", il.WALL, OverflowingContact(0.01), clearance=0.1)
    body = il.LinearOscillator(damping=1.0, stiffness=0.1)
    with pytest.raises(il.InvalidInput, match=r"OverflowingContact\.potential is not the integral .* it is inf J"):
        exact(il.Network({"a": body}, {"c": contact}, {"a": il.WhiteNoise(1.0)}))


def test_residual_potentials():
    il.Network({"a": DoubleWell(depth=1e9, tilt=1.0), "b": DoubleWell(depth=1.0, tilt=1e-5)})
    with pytest.raises(il.InvalidInput, match=r"OneSided\.residual_potential of body 'b' .* from -0\.\d+ m to -0"):
        il.Network({"a": il.DuffingOscillator(3.0), "b": OneSided()})


def test_the_exact_law_looks_where_the_bodies_are():
    """What is wrong in one of many thousand laws of one class may not be seen before."""
    laws = [ScaledContact(1.0, offset=0.0) for _ in range(16)]
    laws[5] = ScaledContact(1.01)
    contacts = {f"c{k}": il.Contact("a", il.WALL, law, clearance=0.1) for k, law in enumerate(laws)}
    network = il.Network({"a": BODY}, contacts, {"a": il.WhiteNoise(1.0)})
    with pytest.raises(il.InvalidInput, match=r"ScaledContact\.potential is not the integral of the force"):
        exact(network)


def test_equal_laws_are_looked_at_once():
    calls = []

    class CountedContact(il.ContactLaw):
        factor: float = il.parameter()

        @staticmethod
        def force(indentation):
            return indentation**2

        @staticmethod
        def potential(indentation, factor):
            calls.append(indentation)
            return factor * indentation**3 / 3.0

    touching(*[CountedContact(1.0)] * 100)
    once = len(calls)
    touching(*(CountedContact(1.0) for _ in range(100)))
    assert len(calls) == once > 0
    touching(*(CountedContact(1.0 + 1e-9 * k) for k in range(1000)))
    assert len(calls) <= 9 * once
