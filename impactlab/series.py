"""Sums of cosines sampled in time: by FFT where the lines and the samples lie on one grid."""

from __future__ import annotations

import numpy as np

from impactlab.kernels.random import fill_uniforms, stream
from impactlab.linear import Lines, regular_lines

_BLOCK = 256  # samples that share one evaluation of the cosines off the grid


def phases(seed: tuple[int, int], lines: Lines, realization: int, attempt: int) -> np.ndarray:
    """Return the random phases of one realization, uniform on (0, 2π), (line,).

    Each attempt has numbers of its own.
    """
    blocks = -(-len(lines.frequencies) // 4)
    uniforms = np.empty(4 * blocks)
    address = np.array(stream(seed, lines.name, "phases"), dtype=np.uint64)
    fill_uniforms(address, np.uint32(realization), np.uint64(attempt * blocks), uniforms)
    return 2.0 * np.pi * uniforms[: len(lines.frequencies)]


def response_amplitudes(lines: Lines, response: np.ndarray, phase: np.ndarray) -> np.ndarray:
    """Return complex amplitudes of steady displacements and velocities, body by body, (2 body, line).

    `response` are the displacements by unit force, (line, body).
    """
    displacement = lines.amplitudes * np.exp(1j * phase) * response.T
    both: np.ndarray = np.stack([displacement, 1j * lines.frequencies * displacement], axis=1)
    return both.reshape(-1, len(phase))


def force_amplitudes(lines: Lines, phase: np.ndarray) -> np.ndarray:
    """Return complex amplitudes of the force, (1, line)."""
    return (lines.amplitudes * np.exp(1j * phase))[None, :]


def sample_count(frequencies: np.ndarray, interval: float, samples: int) -> int:
    """Return the number of samples that `synthesize` returns: one period, or all."""
    bins = _bins(frequencies, interval)
    return samples if bins is None else bins[1]


def synthesize(frequencies: np.ndarray, amplitudes: np.ndarray, interval: float, samples: int) -> np.ndarray:
    """Sample ``Re Σ a_k exp(i ω_k t)`` at t = 0, interval, 2 interval, …

    If the lines are whole multiples of one frequency and the period is a whole number of
    intervals, one period comes from one FFT; lines above the Nyquist frequency of the
    samples are folded, which leaves the values at the samples exact. Other lines that are
    equally far apart are summed by a chirp transform. Any others are summed in blocks,
    ``exp(iω(s + r)) = exp(iωs) exp(iωr)``, as a matrix product.

    Parameters
    ----------
    frequencies : (line,) ndarray
        Angular frequencies (rad s-1).
    amplitudes : (channel, line) ndarray of complex
        Amplitudes.
    interval : float
        Time between samples (s).
    samples : int
        Number of samples that are needed.

    Returns
    -------
    (sample, channel) ndarray
        One period, to be continued periodically, or `samples` values.
    """
    bins = _bins(frequencies, interval)
    if bins is None:
        spacing = _spacing(frequencies)
        if spacing:
            return np.stack([_chirp(frequencies[0], spacing, a, interval, samples) for a in amplitudes], axis=1)
        starts = np.arange(0, samples, _BLOCK) * interval
        within = np.exp(1j * np.outer(frequencies, np.arange(_BLOCK) * interval))
        result = np.empty((samples, len(amplitudes)))
        for channel, amplitude in enumerate(amplitudes):
            rows = np.exp(1j * np.outer(starts, frequencies)) * amplitude
            result[:, channel] = (rows @ within).real.reshape(-1)[:samples]
        return result
    index, period = bins
    folded = index % period
    upper = folded > period // 2
    target = np.where(upper, period - folded, folded)
    values = np.where(upper, amplitudes.conj(), amplitudes) * (0.5 * period)
    values = np.where((target == 0) | (2 * target == period), 2.0 * values.real, values)
    spectrum = np.zeros((len(amplitudes), period // 2 + 1), dtype=complex)
    for channel, value in enumerate(values):
        if 2 * index.max() <= period:  # nothing is folded, every line has a bin of its own
            spectrum[channel, target] = value
        else:
            np.add.at(spectrum[channel], target, value)
    return np.fft.irfft(spectrum, period, axis=1).T


def _spacing(frequencies: np.ndarray) -> float:
    """Return the distance of lines that are equally far apart, 0 if they are not."""
    steps = np.diff(frequencies)
    mean = float(steps.mean()) if len(steps) else 0.0
    return mean if mean > 0.0 and np.abs(steps - mean).max() < 1e-9 * frequencies.max() else 0.0


def _chirp(first: float, spacing: float, amplitudes: np.ndarray, interval: float, samples: int) -> np.ndarray:
    """Sample ``Re Σ a_k exp(i (first + k spacing) t)`` at any interval, (sample,).

    With ``2 k j = k² + j² − (j − k)²`` the sum is a convolution, done by FFT (Bluestein,
    IEEE Trans. Audio Electroacoust. 18, 1970, 451).
    """
    lines = len(amplitudes)
    index = np.arange(1 - lines, samples, dtype=float)
    chirp = np.exp(0.5j * spacing * interval * index**2)
    size = 2 ** (lines + samples - 1).bit_length()
    spectrum = np.fft.fft(amplitudes * chirp[lines - 1 :: -1], size) * np.fft.fft(chirp.conj(), size)
    sums = np.fft.ifft(spectrum)[lines - 1 : lines - 1 + samples] * chirp[lines - 1 :]
    result: np.ndarray = (np.exp(1j * first * interval * index[lines - 1 :]) * sums).real
    return result


def _bins(frequencies: np.ndarray, interval: float) -> tuple[np.ndarray, int] | None:
    """Return the index of every line and the number of samples in a period, if both are whole."""
    regular = regular_lines(frequencies)
    if regular is None:
        return None
    period = regular[1] / interval
    if abs(period - round(period)) > 1e-7 * period or round(period) < 2:
        return None
    return regular[0], round(period)
