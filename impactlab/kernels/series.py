"""Sums of cosines with random phases: their complex amplitudes, folded into the spectrum of an FFT.

The phase of line n is ``2π (w + ½) / 2³²``, where w is word n of the stream; see
`impactlab.kernels.random`. Its quadrant is in the first bits of the word, so that no number is
reduced. Only additions and multiplications are used. The polynomials interpolate at the
nodes of Chebyshev on (−π/4, π/4); their errors are 2e-17 and 2e-16.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from impactlab.compiling.jit import allocating, kernel
from impactlab.compiling.scalars import scalar
from impactlab.kernels.random import LOW, WORD, philox

CHUNK = 512
"""Lines that are worked on together, so that their numbers stay in the cache; a multiple of 4."""

NEAR = 32
"""Samples that are put side by side for the loops at a time; an even number."""

_1 = np.uint32(1)
_EIGHTH, _QUARTER, _HALF = np.uint64(1 << 29), np.uint32(1 << 30), np.uint32(1 << 31)  # of a turn
_WITHIN, _MIDDLE, _UNIT = np.uint32((1 << 30) - 1), 2.0**29 - 0.5, 2.0 * math.pi * 2.0**-32
_SINE = (
    -0.16666666666666666, 0.008333333333330948, -0.00019841269836758574,
    2.755731610255244e-06, -2.5051131845003624e-08, 1.5918129294866608e-10,
)  # fmt: skip
_COSINE = (
    -0.49999999999999967, 0.04166666666663093, -0.0013888888882127952,
    2.480158262335195e-05, -2.755585551192951e-07, 2.066550487012274e-09,
)  # fmt: skip


class Phases(NamedTuple):
    """Which random phases: a set of one realization."""

    address: np.ndarray  # (3,) of their stream
    realization: np.uint32
    attempt: int  # which set


class Amplitudes(NamedTuple):
    """Lines of a sum of cosines at phase 0."""

    frequencies: np.ndarray  # (line,) angular frequencies (rad s-1)
    real: np.ndarray  # (row, line)
    imaginary: np.ndarray


@scalar
def cosine_and_sine(word):  # type: ignore[no-untyped-def]
    """Cosine and sine of the phase that belongs to a word of 32 bits."""
    turned = np.uint32((np.uint64(word) + _EIGHTH) & LOW)  # the nearest quarter turn, and the rest of the angle
    t = (np.float64(np.int32(np.uint32(turned & _WITHIN))) - _MIDDLE) * _UNIT
    q = t * t
    s3, s5, s7, s9, s11, s13 = _SINE
    c2, c4, c6, c8, c10, c12 = _COSINE
    sine = t + t * (q * (s3 + q * (s5 + q * (s7 + q * (s9 + q * (s11 + q * s13))))))
    cosine = 1.0 + q * (c2 + q * (c4 + q * (c6 + q * (c8 + q * (c10 + q * c12)))))
    odd = np.uint32(turned & _QUARTER) != 0
    a, b = (sine, cosine) if odd else (cosine, sine)
    return (
        -a if np.uint32((turned ^ np.uint32(turned << _1)) & _HALF) != 0 else a,
        -b if np.uint32(turned & _HALF) != 0 else b,
    )


@kernel
def fill_words(address, realization, block, words):  # type: ignore[no-untyped-def]
    """Write words 4 block, 4 block + 1, … of one realization, (4 n,) of uint32.

    `address` is what `impactlab.kernels.random.stream` returns.
    """
    k0, k1, c3 = address[0], address[1], np.uint32(address[2])
    for index in range(words.shape[0] // 4):
        counter = np.uint64(block) + np.uint64(index)
        c0, c1 = np.uint32(counter & LOW), np.uint32(counter >> WORD)
        w0, w1, w2, w3 = philox(c0, c1, np.uint32(realization), c3, k0, k1)
        words[4 * index] = np.uint32(w0)
        words[4 * index + 1] = np.uint32(w1)
        words[4 * index + 2] = np.uint32(w2)
        words[4 * index + 3] = np.uint32(w3)


@kernel
def _add(words, real, imaginary, frequencies, x, y, u, v):  # type: ignore[no-untyped-def]
    for index in range(x.shape[0]):
        cosine, sine = cosine_and_sine(words[index])
        a = real[index] * cosine - imaginary[index] * sine
        b = real[index] * sine + imaginary[index] * cosine
        x[index] += a
        y[index] += b
        u[index] -= b * frequencies[index]
        v[index] += a * frequencies[index]


@allocating
def _add_lines(phases, first, spacing, lines, sums):  # type: ignore[no-untyped-def]
    """Write to `sums`, (row, part, bin), the sums of all lines there: first, first + spacing, … are in bin 0.

    The parts are real and imaginary part of the amplitude and of that of its derivative.
    """
    frequencies, real, imaginary = lines
    blocks = phases.attempt * ((real.shape[1] + 3) // 4)
    words = np.empty(CHUNK + 8, np.uint32)
    sums[:] = 0.0
    for line in range(first, real.shape[1], spacing):
        begin, end = max(line, 0), min(line + sums.shape[2], real.shape[1])
        if begin >= end:
            continue
        before, at, until = begin % 4, begin - line, end - line
        some = words[: (before + end - begin + 3) // 4 * 4]
        fill_words(phases.address, phases.realization, blocks + begin // 4, some)
        for row in range(real.shape[0]):
            here = words[before:], real[row, begin:end], imaginary[row, begin:end], frequencies[begin:end]
            x, y, u, v = sums[row, 0, at:until], sums[row, 1, at:until], sums[row, 2, at:until], sums[row, 3, at:until]
            _add(*here, x, y, u, v)


@kernel
def _join(real, imaginary, mirrored_real, mirrored_imaginary, spectrum):  # type: ignore[no-untyped-def]
    for k in range(spectrum.shape[0]):
        spectrum[k] = complex(0.5 * (real[k] + mirrored_real[k]), 0.5 * (imaginary[k] - mirrored_imaginary[k]))


@allocating
def fill_spectrum(phases, lowest, samples, lines, spectrum):  # type: ignore[no-untyped-def]
    """Write the spectrum whose inverse real FFT, not normalized, is ``Re Σ a_n exp(2πi (lowest + n) t/samples)``.

    Lines that have equal values at t = 0, 1, … are added up: number k goes to bin k mod samples and, as the
    conjugate, to −k mod samples. The spectrum is complex, (channel, samples // 2 + 1 or less), up to some bin: each row
    or, if there is room, each row and its derivative.
    """
    rows, bins = lines.real.shape[0], spectrum.shape[1]
    derivatives = spectrum.shape[0] // rows
    for low in range(0, bins, CHUNK):
        high = min(low + CHUNK, bins)
        own, mirrored = np.empty((rows, 4, high - low)), np.empty((rows, 4, high - low))
        for first, sums in ((low, own), (1 - high, mirrored)):
            _add_lines(phases, (first - lowest) % samples - samples, samples, lines, sums)
        for row in range(rows):
            for part in range(derivatives):
                parts = own[row, 2 * part], own[row, 2 * part + 1]
                others = mirrored[row, 2 * part, ::-1], mirrored[row, 2 * part + 1, ::-1]
                _join(*parts, *others, spectrum[derivatives * row + part, low:high])


@kernel
def bring_near(series, first):  # type: ignore[no-untyped-def]
    """Write samples first, first + 1, … of all lanes, which are periodic, to `series.near`."""
    near, samples = series.near, series.samples
    for row in range(samples.shape[1]):
        done = 0
        while done < near.shape[0]:
            begin = (first + done) % samples.shape[2]
            count = min(8, near.shape[0] - done, samples.shape[2] - begin)  # a line of the cache
            _transpose(samples[:, row, begin : begin + count], near[done : done + count, row])
            done += count


@kernel
def _transpose(source, result):  # type: ignore[no-untyped-def]
    for time in range(result.shape[0]):
        for lane in range(result.shape[1]):
            result[time, lane] = source[lane, time]
