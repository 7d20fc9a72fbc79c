"""Oscillators: constructors, frequencies, and the motion that they describe."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import ellipk

import impactlab as il


def test_from_frequency_and_back():
    body = il.LinearOscillator.from_frequency(32 * np.pi, 0.1, mass=2.5)
    assert body.mass == 2.5
    assert body.stiffness == pytest.approx(2.5 * (32 * np.pi) ** 2, rel=1e-15)
    assert body.damping == pytest.approx(2 * 0.1 * 32 * np.pi * 2.5, rel=1e-15)
    assert body.natural_frequency == pytest.approx(32 * np.pi, rel=1e-15)
    assert body.damping_ratio == pytest.approx(0.1, rel=1e-15)


def test_from_frequency_is_the_same_for_every_class():
    body = il.DuffingOscillator.from_frequency(2.0, 0.5, cubic=3.0)
    assert body == il.DuffingOscillator(3.0, mass=1.0, damping=2.0, stiffness=4.0)


def test_defaults_are_a_free_body():
    body = il.LinearOscillator()
    assert (body.mass, body.damping, body.stiffness) == (1.0, 0.0, 0.0)
    assert (body.natural_frequency, body.damping_ratio) == (0.0, 0.0)
    assert body.replace(damping=1.0).damping_ratio == np.inf


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"natural_frequency": -1.0}, r"at least 0, not -1.0 and 0.0"),
        ({"natural_frequency": 1.0, "damping_ratio": -0.1}, r"not 1.0 and -0.1"),
        ({"natural_frequency": np.nan}, r"from_frequency: natural_frequency must be a finite number"),
        ({"natural_frequency": 1.0, "damping_ratio": np.inf}, r"damping_ratio must be a finite number"),
        ({"natural_frequency": "fast"}, r"must be a number, not 'fast'"),
        ({"natural_frequency": 1.0, "mass": 0.0}, r"LinearOscillator.mass must be larger than 0 kg"),
        ({"natural_frequency": 1.0, "mass": -1.0}, r"LinearOscillator.mass must be larger than 0 kg"),
        ({"natural_frequency": 1.0, "mass": np.nan}, r"from_frequency: mass must be a finite number"),
        ({"natural_frequency": 1.0, "cubic": 2.0}, r"LinearOscillator has no field 'cubic'"),
        ({"natural_frequency": 1.0, "stiffness": 2.0}, r"from_frequency computes stiffness .* leave stiffness out"),
    ],
)
def test_from_frequency_refuses(arguments, message):
    with pytest.raises(il.InvalidInput, match=message):
        il.LinearOscillator.from_frequency(**arguments)


@pytest.mark.parametrize("field", ["mass", "damping", "stiffness"])
@pytest.mark.parametrize("value", [-1.0, np.nan, np.inf])
def test_bad_linear_part(field, value):
    with pytest.raises(il.InvalidInput, match=rf"LinearOscillator.{field} must be .*not {value}"):
        il.LinearOscillator(**{field: value})


def test_period_of_the_duffing_oscillator():
    """Free motion from x = a at rest: T = 4 K(m)/sqrt(ω² + ε a²), m = ε a²/(2 (ω² + ε a²))
    (Nayfeh and Mook, Nonlinear Oscillations, 1979, section 2.1)."""
    linear, cubic, amplitude = 4.0, 3.0, 1.5
    compiled = il.Network({"a": il.DuffingOscillator(cubic, stiffness=linear)}).compile()
    square = linear + cubic * amplitude**2
    period = 4.0 * ellipk(cubic * amplitude**2 / (2.0 * square)) / np.sqrt(square)
    start = compiled.state(displacement={"a": amplitude})
    end = solve_ivp(compiled.rhs, (0.0, period), start, method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
    np.testing.assert_allclose(end, start, atol=1e-9)
