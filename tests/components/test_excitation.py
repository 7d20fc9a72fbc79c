"""Excitations: conventions, lines, and the errors of each."""

import numpy as np
import pytest
from laws import Cosine

import impactlab as il


def test_kinds():
    kinds = {cls.__name__: cls.kind for cls in (il.Excitation, il.WhiteNoise, il.ShinozukaNoise, Cosine)}
    assert kinds == {"Excitation": None, "WhiteNoise": "intensity", "ShinozukaNoise": "lines", "Cosine": "force"}


def test_one_sided_density_is_four_pi_times_the_two_sided():
    assert il.WhiteNoise.from_one_sided(4 * np.pi * 16.0).spectral_density == pytest.approx(16.0, rel=1e-15)
    noise = il.ShinozukaNoise.from_one_sided(4 * np.pi, band=(1.0, 2.0), components=3)
    assert noise == il.ShinozukaNoise(noise.spectral_density, band=(1.0, 2.0), components=3)
    assert noise.spectral_density == pytest.approx(1.0, rel=1e-15)


def test_lines_of_bounded_noise():
    """f_k = f_a + k Δf, k = 1…N, and the power S_f (f_b − f_a) of the band, S_f = 4πS."""
    noise = il.ShinozukaNoise(3.0, band=(10.0, 30.0), components=40)
    frequencies, amplitudes = noise.lines()
    np.testing.assert_allclose(frequencies / (2 * np.pi), 10.0 + 0.5 * np.arange(1, 41), rtol=1e-14)
    assert np.ptp(amplitudes) == 0.0
    assert (amplitudes**2 / 2).sum() == pytest.approx(4 * np.pi * 3.0 * 20.0, rel=1e-14)
    assert noise.spacing == 0.5


def test_period_of_the_paper_s_series_is_its_duration():
    noise = il.ShinozukaNoise(16.0)
    assert (noise.band, noise.components) == ((0.0, 500.0), 50000)
    assert noise.period == pytest.approx(100.0, rel=1e-14)
    assert noise.replace(allow_repeat=True).period == np.inf
    assert il.WhiteNoise(1.0).period == np.inf


@pytest.mark.parametrize("band", [(1.0, 1.0), (2.0, 1.0), (1.0,), (1.0, 2.0, 3.0), 5.0, "ab", None, ()])
def test_bad_band(band):
    with pytest.raises(
        il.InvalidInput, match=r"ShinozukaNoise.band must be (two increasing frequencies in Hz|a list of 2 numbers)"
    ):
        il.ShinozukaNoise(1.0, band=band)


@pytest.mark.parametrize("band", [(-1.0, 1.0), (0.0, np.inf), (np.nan, 1.0), ("0", "1"), (None, 1.0), (False, True)])
def test_band_that_is_not_made_of_frequencies(band):
    with pytest.raises(il.InvalidInput, match=r"ShinozukaNoise.band"):
        il.ShinozukaNoise(1.0, band=band)


def test_band_may_be_a_list_or_whole_numbers():
    assert il.ShinozukaNoise(1.0, band=[0, 5]) == il.ShinozukaNoise(1.0, band=(0.0, 5.0))
    assert repr(il.ShinozukaNoise(1.0, band=[0, 5])) == "ShinozukaNoise(spectral_density=1.0, band=(0.0, 5.0))"


@pytest.mark.parametrize("components", [0, -1, 1.0, 2.5, True, None])
def test_bad_number_of_components(components):
    with pytest.raises(il.InvalidInput, match=r"ShinozukaNoise.components must be"):
        il.ShinozukaNoise(1.0, components=components)


@pytest.mark.parametrize("cls", [il.WhiteNoise, il.ShinozukaNoise])
@pytest.mark.parametrize("density", [-1.0, np.nan, np.inf])
def test_bad_density(cls, density):
    with pytest.raises(il.InvalidInput, match=rf"{cls.__name__}.spectral_density must be .*not {density}"):
        cls(density)
    with pytest.raises(il.InvalidInput):
        cls.from_one_sided(density)
