"""Coloured noises as descriptions: filters, spectra, and what is refused."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

import impactlab as il
from impactlab.components.filters import filter_of

KANAI = il.KanaiTajimi(1.0, 15.0, 0.6)
CLOUGH = il.CloughPenzien(1.0, 15.0, 0.6, 1.5, 0.5)


def resonance(w, frequency, ratio):
    """Squared denominator of a mass on a spring and damper."""
    return (frequency**2 - w**2) ** 2 + (2.0 * ratio * frequency * w) ** 2


def kanai(w):
    return (15.0**4 + (18.0 * w) ** 2) / resonance(w, 15.0, 0.6)


DENSITIES = {
    "first order": (il.OrnsteinUhlenbeckNoise(0.7, correlation_time=0.2), lambda w: 0.7 / (1.0 + (0.2 * w) ** 2)),
    "band": (
        il.BandPassNoise(0.7, frequency=5.0, damping_ratio=0.1),
        lambda w: 0.7 * w**2 / resonance(w, 5.0, 0.1),
    ),
    "Kanai-Tajimi": (KANAI, kanai),
    "Clough-Penzien": (CLOUGH, lambda w: kanai(w) * w**4 / resonance(w, 1.5, 0.5)),
}


@pytest.mark.parametrize(("noise", "density"), DENSITIES.values(), ids=DENSITIES)
def test_spectra_are_those_of_the_textbooks_and_integrate_to_the_variance(noise, density):
    frequencies = np.array([[0.0, 0.3, 2.0], [5.0, 15.0, 400.0]])
    np.testing.assert_allclose(noise.density(frequencies), density(frequencies), rtol=1e-12, atol=1e-14)
    parts = [quad(density, low, high, limit=200)[0] for low, high in ((0.0, 10.0), (10.0, 100.0), (100.0, np.inf))]
    assert noise.variance == pytest.approx(2.0 * sum(parts), rel=1e-6)


def test_known_variances():
    assert KANAI.variance == pytest.approx(95.81858, rel=1e-7)
    assert il.OrnsteinUhlenbeckNoise(0.7, correlation_time=0.2).variance == pytest.approx(math.pi * 0.7 / 0.2)
    assert il.OrnsteinUhlenbeckNoise.from_variance(3.0, 0.2).variance == pytest.approx(3.0)
    assert il.KanaiTajimi.from_one_sided(4.0 * math.pi, ground_frequency=15.0, ground_damping=0.6) == KANAI


@pytest.mark.parametrize("noise", [item for item, _ in DENSITIES.values()], ids=DENSITIES)
def test_descriptions_go_to_data_and_back(noise):
    both = il.Network(
        {"a": il.LinearOscillator(stiffness=1.0)},
        excitations={
            "a": il.Modulated(noise, [0.0, 1.0], [1.0, 0.5]),
            "ground": il.BaseMotion(noise.replace(at_rest=True)),
        },
    )
    assert il.Network.from_dict(both.to_dict()) == both


def test_an_envelope_of_many_samples_is_named_briefly():
    noise = il.Modulated(KANAI, np.arange(50.0), np.ones(50))
    assert repr(noise) == f"Modulated of 50 samples from 0 to 49 s of {KANAI!r}"


class Unstable(il.FilteredNoise):
    def filter(self):
        return [[0.1]], [1.0], [1.0]


class Misshapen(il.FilteredNoise):
    def filter(self):
        return [[-1.0, 0.0]], [1.0], [1.0]


class Words(il.FilteredNoise):
    def filter(self):
        return "A", [1.0], [1.0]


class Infinite(il.FilteredNoise):
    def filter(self):
        return [[-1.0]], [math.inf], [1.0]


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        (Unstable, "not stable: its slowest motion decays at a rate of -0.1"),
        (Misshapen, r"\(1, 2\), \(1,\) and \(1,\) were returned"),
        (Words, "a matrix and two vectors"),
        (Infinite, "finite numbers"),
    ],
)
def test_filters_that_are_none_are_refused(kind, said):
    with pytest.raises(il.InvalidInput, match=said):
        filter_of(kind())


def test_values_without_meaning_are_refused():
    with pytest.raises(il.InvalidInput, match=r"ground_damping must be larger than 0"):
        il.KanaiTajimi(1.0, 15.0, 0.0)
    with pytest.raises(il.InvalidInput, match=r"correlation_time must be larger than 0 s"):
        il.OrnsteinUhlenbeckNoise(1.0, correlation_time=0.0)
    with pytest.raises(il.InvalidInput, match=r"Modulated.noise must be coloured noise"):
        il.Modulated(3.0, [0.0, 1.0], [1.0, 1.0])
    with pytest.raises(il.InvalidInput, match="abstract"):
        il.FilteredNoise()


@pytest.mark.parametrize(
    ("given", "advice"),
    [
        (il.WhiteNoise(1.0), "white noise with an envelope is an il.ModulatedNoise"),
        (il.ConstantForce(1.0), "a given force with an envelope is an il.ModulatedForce"),
        (il.TabulatedNoise([0.0, 1.0], [1.0, 1.0]), "sums of cosines have no envelope, .* take coloured noise of much"),
        (il.PoissonImpulses(1.0, mean=1.0), "impulses with an envelope are il.ModulatedImpulses"),
    ],
    ids=lambda item: type(item).__name__,
)
def test_what_is_said_of_envelopes_of_other_excitations(given, advice):
    message = rf"Modulated.noise must be coloured noise, not {type(given).__name__}.*{advice}"
    with pytest.raises(il.InvalidInput, match=message):
        il.Modulated(given, [0.0, 1.0], [1.0, 1.0])
    if given.kind != "force":
        with pytest.raises(il.InvalidInput, match=rf"must be a given force such as .*, not {type(given).__name__}"):
            il.ModulatedForce(given, [0.0, 1.0], [1.0, 1.0])
