"""Networks that depend on parameters, with their numbers as polynomials."""

import math

import numpy as np
import pytest

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.located.families import Family, numbers_of
from impactlab.located.scenes import linear_of


def stop(frequency=1.0, gap=1.0, amplitude=1.0, damping=0.1, law=None):
    return il.Network(
        oscillators={"a": il.LinearOscillator(damping=damping, stiffness=1.0)},
        contacts={"stop": il.Contact("a", il.WALL, law or il.RigidContact(restitution=0.8), clearance=gap)},
        excitations={"a": il.Harmonic(amplitude=amplitude, frequency=frequency, phase=0.5 * math.pi)},
    )


def pair(ratio, amplitude):
    """Two bodies, one on a moving ground, whose numbers are no polynomials of the parameters."""
    return il.Network(
        oscillators={
            "a": il.LinearOscillator.from_frequency(natural_frequency=math.exp(ratio), damping_ratio=0.1),
            "b": il.LinearOscillator(mass=1.0 / (1.0 + ratio), damping=0.2, stiffness=math.sqrt(2.0 + ratio)),
            "ground": il.PrescribedMotion(il.Harmonic(amplitude=amplitude, frequency=2.0 + ratio)),
        },
        contacts={"gap": il.Contact("a", "b", il.KelvinVoigtContact(stiffness=100.0, damping=1.0), clearance=0.1)},
        couplings={"base": il.Coupling("ground", "a", il.LinearCoupling(stiffness=3.0, damping=0.1 * ratio))},
    )


def close(family, make, points):
    """Whether a family has the numbers of networks that are made one by one."""
    found = family.scenes(np.array(points))
    for lane, values in enumerate(points):
        scene = linear_of(Model.of(make(*values)))
        exact = numbers_of(scene)
        one = family.numbers(np.array([values]))[0]
        np.testing.assert_allclose(one, exact, rtol=3e-13, atol=1e-14)
        np.testing.assert_allclose(found.frequencies[lane], scene.frequencies[0], rtol=3e-13)
    assert len(found.functions) == len(points)


def test_one_parameter():
    family = Family.of(stop, {"frequency": (0.5, 3.0)})
    assert family.coefficients.shape[:2] == (1, 1)  # only the frequency varies
    close(family, stop, [(0.5,), (1.7,), (3.0,)])


def test_two_parameters_that_numbers_do_not_follow_by_polynomials_of_low_degree():
    family = Family.of(pair, {"ratio": (0.0, 3.0), "amplitude": (-1.0, 1.0)})
    close(family, pair, [(0.0, -0.3), (1.3, 0.77), (2.9, 0.0001)])


def test_panels_where_one_polynomial_does_not_do():
    def make(gap):
        return stop(gap=1.0 / (1e-3 + gap * gap))

    family = Family.of(make, {"gap": (-1.0, 1.0)})
    assert len(family.boxes) > 1
    close(family, make, [(-1.0,), (0.012,), (0.5,)])


@pytest.mark.parametrize(
    ("make", "ranges", "message"),
    [
        (lambda gap: stop(gap=abs(gap - 0.3)), {"gap": (0.0, 1.0)}, "no smooth functions of 'gap' near 0.3"),
        (lambda gap: stop(damping=gap), {"gap": (-1.0, 1.0)}, "There is no network at gap=-"),
        (lambda gap: stop(law=il.HertzContact(1e3)), {"gap": (0.0, 1.0)}, "not linear between events"),
        (lambda gap: stop(law=il.LinearContact(1.0) if gap < 0.5 else None), {"gap": (0.0, 1.0)}, "in numbers only"),
        (stop, {"gap": (1.0, 1.0)}, "from a lower to a higher"),
        (lambda gap: None, {"gap": (0.0, 1.0)}, "must return an il.Network"),
    ],
)
def test_families_that_are_refused(make, ranges, message):
    with pytest.raises(il.InvalidInput, match=message):
        Family.of(make, ranges)


def test_values_outside():
    with pytest.raises(il.InvalidInput, match="outside"):
        Family.of(stop, {"gap": (0.5, 1.0)}).scenes(np.array([[1.2]]))
