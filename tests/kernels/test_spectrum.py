"""Phases of cosines and the spectrum of their sums, against numpy's functions."""

import numpy as np
import pytest
from scenes import phases
from scipy.stats import kstest

from impactlab.kernels.random import stream
from impactlab.kernels.series import Amplitudes, Phases, cosine_and_sine, fill_spectrum, fill_words
from impactlab.linear.spectral_lines import Lines

SEED = (1, 2)
ADDRESS = np.array(stream(SEED, "body", "phases"), dtype=np.uint64)


def drawn(count, realization=3, block=0):
    """Words of some phases."""
    words = np.empty(count, np.uint32)
    fill_words(ADDRESS, np.uint32(realization), block, words)
    return words


def test_phases_never_change():
    answer = "0x1.feac5c4400000p-3 0x1.a610875e00000p-2 0x1.bd4a61c400000p-3 0x1.f5faeb3800000p-4"
    np.testing.assert_array_equal((drawn(4) + 0.5) / 2.0**32, [float.fromhex(number) for number in answer.split()])


@pytest.mark.parametrize(("realization", "block"), [(0, 0), (9, 2**32 - 1), (2**32 - 1, 2**56 - 2)])
def test_words_are_the_addressed_ones(realization, block):
    lines = Lines((0,), "body", np.ones(4), np.ones(4))
    turns = (drawn(4, realization, block) + 0.5) / 2.0**32
    np.testing.assert_array_equal(2.0 * np.pi * turns, phases(SEED, lines, realization, block))


def test_cosine_and_sine_are_as_accurate_as_their_rounding_in_all_quadrants():
    words = np.concatenate([drawn(2**14), np.arange(8) * 2**29, np.arange(1, 9) * 2**29 - 1]).astype(np.uint32)
    cosine, sine = np.array([cosine_and_sine(word) for word in words]).T
    angle = 2.0 * np.pi * (words + 0.5) / 2.0**32
    assert np.abs(cosine - np.cos(angle)).max() < 1.5e-15  # the rounding of an angle near 2π is 4e-16
    assert np.abs(sine - np.sin(angle)).max() < 1.5e-15
    assert np.abs(cosine**2 + sine**2 - 1.0).max() < 1e-15


def test_phases_are_uniform():
    assert kstest((drawn(2**18) + 0.5) / 2.0**32, "uniform").pvalue > 1e-4


@pytest.mark.parametrize("samples", [2, 3, 7, 512, 700, 1400, 5000, 5001])
@pytest.mark.parametrize("lines", [1, 511, 1301])
def test_spectrum_holds_every_line_where_its_samples_are(lines, samples):
    rng = np.random.default_rng(1)
    frequencies, gains = rng.uniform(1.0, 2.0, lines), rng.normal(size=(2, lines)) + 1j * rng.normal(size=(2, lines))
    amplitudes = gains * np.exp(1j * phases(SEED, Lines((0,), "body", frequencies, gains), 5, 2))
    spectrum = np.full((4, samples // 2 + 1), np.nan, dtype=complex)
    parts = Amplitudes(frequencies, gains.real.copy(), gains.imag.copy())
    fill_spectrum(Phases(ADDRESS, np.uint32(5), 2), 11, samples, parts, spectrum)
    two_sided = np.zeros((4, samples), dtype=complex)
    for part, values in enumerate([amplitudes, 1j * frequencies * amplitudes]):
        for row in range(2):
            np.add.at(two_sided[2 * row + part], (11 + np.arange(lines)) % samples, values[row])
    expected = np.fft.rfft(np.fft.ifft(two_sided, axis=1, norm="forward").real, axis=1, norm="forward")
    np.testing.assert_allclose(spectrum, expected, rtol=0.0, atol=1e-12)
