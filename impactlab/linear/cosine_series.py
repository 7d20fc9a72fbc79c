"""Sums of cosines with random phases, sampled in time: by FFT where lines and samples lie on one grid."""

from __future__ import annotations

import numpy as np

from impactlab.kernels.random import stream
from impactlab.kernels.series import CHUNK, Amplitudes, Phases, fill_spectrum
from impactlab.linear.spectral_lines import Lines, regular_lines
from impactlab.machine import tuning

_BLOCK = 256  # samples that share one evaluation of the cosines off the grid


class Cosines:
    """What the sum of cosines on one body does, realization by realization.

    By unit force each line does its gains, (row, line) of complex. Where `derivatives` are wanted, too, there are
    `channels` for each row and its derivative, in turn. Without an interval between samples (s) there are none, with
    one as many as are needed.
    """

    def __init__(
        self,
        seed: tuple[int, int],
        lines: Lines,
        gains: np.ndarray,
        derivatives: bool,
        interval: float | None,
        needed: float = np.inf,
    ) -> None:
        self._frequencies, self._interval = lines.frequencies, interval
        self._address = np.array(stream(seed, lines.name, "phases"), dtype=np.uint64)
        amplitudes = lines.amplitudes * gains
        parts = np.ascontiguousarray(amplitudes.real), np.ascontiguousarray(amplitudes.imag)
        self._lines = Amplitudes(lines.frequencies, *parts)
        self._grid = None if interval is None else _grid(lines.frequencies, interval, needed)
        self._lowest, self._period = self._grid or (
            1,
            2 * CHUNK if interval is None else 2 * len(lines.frequencies) + 2,
        )
        self.channels = len(gains) * (2 if derivatives else 1)
        bins = min(self._period // 2 + 1, self._lowest + len(lines.frequencies))  # above, there is nothing
        self._spectrum = np.empty((self.channels, bins), dtype=complex)
        self._drawn: tuple[int, int] | None = None

    def start(self, realization: int, attempt: int) -> np.ndarray:
        """Return the values at t = 0, (channel,).

        Each attempt of a realization has phases of its own.
        """
        self._draw(realization, attempt)
        real = self._spectrum.real
        last = real[:, -1] if 2 * (real.shape[1] - 1) == self._period else 0.0
        result: np.ndarray = 2.0 * real.sum(axis=1) - real[:, 0] - last
        return result

    def sample(self, realization: int, attempt: int, samples: np.ndarray) -> None:
        """Write the values at t = 0, interval, 2 interval, … to `samples`, (channel, time).

        They are ``Re Σ a_k exp(i ω_k t)``. If the lines are whole multiples of one frequency and
        the period is a whole number of intervals, one period comes from one FFT; lines above
        the Nyquist frequency of the samples are folded, which leaves the values at the samples
        exact. Other lines that are equally far apart are summed by a chirp transform. Any
        others are summed in blocks, ``exp(iω(s + r)) = exp(iωs) exp(iωr)``, as a matrix product.
        """
        self._draw(realization, attempt)
        bins, count = self._period, samples.shape[1]
        if self._grid is not None:
            period = samples if count == bins else np.empty((self.channels, bins))
            np.fft.irfft(self._spectrum, bins, axis=1, norm="forward", out=period)
            for begin in range(0, 0 if period is samples else count, bins):
                samples[:, begin : begin + bins] = period[:, : count - begin]
            return
        assert self._interval is not None
        amplitudes = 2.0 * self._spectrum[:, 1:]
        spacing = _spacing(self._frequencies)
        if spacing:
            for channel, amplitude in enumerate(amplitudes):
                samples[channel] = _chirp(self._frequencies[0], spacing, amplitude, self._interval, count)
            return
        within = np.exp(1j * np.outer(self._frequencies, np.arange(_BLOCK) * self._interval))
        most = _BLOCK * max(1, int(tuning().cosines / len(self._frequencies)))
        for begin in range(0, count, most):
            end = min(begin + most, count)
            starts = np.arange(begin, end, _BLOCK) * self._interval
            for channel, amplitude in enumerate(amplitudes):
                rows = np.exp(1j * np.outer(starts, self._frequencies)) * amplitude
                samples[channel, begin:end] = (rows @ within).real.reshape(-1)[: end - begin]

    def _draw(self, realization: int, attempt: int) -> None:
        """Draw the spectrum of a realization, unless they are those of the last call."""
        if self._drawn != (realization, attempt):
            self._drawn = realization, attempt
            phases = Phases(self._address, np.uint32(realization), attempt)
            fill_spectrum(phases, self._lowest, self._period, self._lines, self._spectrum)


def sample_count(lines: tuple[Lines, ...], interval: float, needed: int) -> int:
    """Return how many samples are to be kept, to be continued periodically: one period of all, or what is needed."""
    grids = [_grid(item.frequencies, interval, needed) for item in lines]
    periods = {grid[1] if grid else needed for grid in grids}
    return min(needed, *periods) if len(periods) == 1 else needed


def sampling_seconds(lines: Lines, interval: float, needed: int) -> float:
    """Return the approximate time to sample one realization of a sum (s)."""
    count, grid = len(lines.frequencies), _grid(lines.frequencies, interval, needed)
    if grid is not None:
        return 5e-9 * (grid[1] + count)
    return 2.5e-7 * (needed + count) if _spacing(lines.frequencies) else 1e-9 * needed * count


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


def _grid(frequencies: np.ndarray, interval: float, needed: float) -> tuple[int, int] | None:
    """Return the index of the first line and the number of samples in a period, if all are whole and it is wanted."""
    regular = regular_lines(frequencies)
    if regular is None:
        return None
    period = regular[1] / interval
    if abs(period - round(period)) > 1e-7 * period or round(period) < 2:
        return None
    # from so many samples in a period on, by the samples and lines that are wanted, the rest of it is not worth an
    # FFT
    if period > 16 * (needed + len(frequencies)):
        return None
    return int(regular[0][0]), round(period)
