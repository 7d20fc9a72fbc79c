"""How far given forces and motions move linear bodies: against closed forms."""

import itertools
import math

import numpy as np
import pytest

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.linear.given_response import MANY, given_ranges

BODY = il.LinearOscillator.from_frequency(2.0, 0.05)
HARMONIC, LOAD = il.Harmonic(0.7, frequency=1.7), il.ConstantForce(20.0)


def ranges(bodies, excitations, couplings=None, end=60.0, begin=-120.0):
    return given_ranges(Model.of(il.Network(bodies, {}, excitations, couplings or {})), begin, end)


def test_a_harmonic_force_and_a_load():
    found = ranges({"a": BODY}, {"h": il.Source(HARMONIC, on="a"), "l": il.Source(LOAD, on="a")})[..., 0]
    amplitude = 0.7 / abs(4.0 - 1.7**2 + 0.2j * 1.7)
    np.testing.assert_allclose(found[0], [5.0 - amplitude, 5.0 + amplitude], rtol=2e-3)
    np.testing.assert_allclose(found[1], [-1.7 * amplitude, 1.7 * amplitude], rtol=1e-2)


def test_a_run_too_long_to_be_looked_at_as_a_whole():
    stiff = il.LinearOscillator.from_frequency(200.0, 0.001)
    found = ranges({"a": stiff}, {"a": il.Harmonic(3.0, frequency=200.0)}, end=3000.0, begin=-60.0)
    assert found[0, 1, 0] == pytest.approx(3.0 / (2.0 * 0.001 * 200.0**2), rel=0.01)


def test_a_motion_pulls_what_hangs_on_it():
    motion = il.PrescribedMotion(il.Harmonic(0.3, frequency=1.2))
    spring = il.Coupling("p", "a", il.LinearCoupling(2.0, damping=0.1))
    found = ranges({"a": BODY, "p": motion}, {}, {"k": spring})
    pull = 0.3 * abs(2.0 + 0.1j * 1.2)
    assert found[0, 1, 0] == pytest.approx(pull / abs(6.0 - 1.2**2 + 0.3j * 1.2), rel=5e-3)
    np.testing.assert_allclose(found[:, 1, 1], [0.3, 0.36], rtol=1e-3)


def test_many_bodies_on_couplings_follow_as_if_forces_were_slow():
    names = [f"b{number}" for number in range(MANY + 1)]
    springs = {name: il.Coupling(name, other, il.LinearCoupling(1.0)) for name, other in itertools.pairwise(names)}
    found = ranges(dict.fromkeys(names, BODY), {"l": il.Source(LOAD, on="b0")}, springs)
    rest = 0.5 * (math.sqrt(32.0) - 4.0)  # stiffness of the rest of a long chain, s = 1/(1 + 1/(4 + s))
    assert found[0, 1, 0] == pytest.approx(20.0 / (4.0 + rest), rel=1e-6)
