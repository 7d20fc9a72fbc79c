"""Sums of cosines with random phases: their complex amplitudes, folded onto the frequencies of an FFT.

The phase of line n is ``2π (w + ½) / 2³²``, where w is word n of the stream; see
`impactlab.kernels.random`. Its quadrant is in the first bits of the word, so that no number is
reduced. Only additions and multiplications are used. The polynomials interpolate at the
nodes of Chebyshev on (−π/4, π/4); their errors are 2e-17 and 2e-16.
"""

from __future__ import annotations

import math

import numpy as np

from impactlab.kernels.jit import kernel, scalar
from impactlab.kernels.random import philox

CHUNK = 512
"""Lines that are worked on together, so that their numbers stay in the cache; a multiple of 4."""

_LOW, _32 = np.uint64(0xFFFFFFFF), np.uint64(32)
_EIGHTH, _QUARTER, _HALF = np.uint32(1 << 29), np.uint32(1 << 30), np.uint32(1 << 31)  # of a turn
_WITHIN, _MIDDLE, _UNIT = np.uint32((1 << 30) - 1), 2.0**29 - 0.5, 2.0 * math.pi * 2.0**-32
_SINE = (
    -0.16666666666666666, 0.008333333333330948, -0.00019841269836758574,
    2.755731610255244e-06, -2.5051131845003624e-08, 1.5918129294866608e-10,
)  # fmt: skip
_COSINE = (
    -0.49999999999999967, 0.04166666666663093, -0.0013888888882127952,
    2.480158262335195e-05, -2.755585551192951e-07, 2.066550487012274e-09,
)  # fmt: skip


@scalar
def cosine_and_sine(word):  # type: ignore[no-untyped-def]
    """Cosine and sine of the phase that belongs to a word of 32 bits."""
    turned = np.uint32(word + _EIGHTH)  # the nearest quarter turn, and the rest of the angle
    t = (np.float64(np.int32(np.uint32(turned & _WITHIN))) - _MIDDLE) * _UNIT
    q = t * t
    s3, s5, s7, s9, s11, s13 = _SINE
    c2, c4, c6, c8, c10, c12 = _COSINE
    sine = t + t * (q * (s3 + q * (s5 + q * (s7 + q * (s9 + q * (s11 + q * s13))))))
    cosine = 1.0 + q * (c2 + q * (c4 + q * (c6 + q * (c8 + q * (c10 + q * c12)))))
    odd = np.uint32(turned & _QUARTER) != 0
    a, b = (sine, cosine) if odd else (cosine, sine)
    return (
        -a if np.uint32(np.uint32(turned + _QUARTER) & _HALF) != 0 else a,
        -b if np.uint32(turned & _HALF) != 0 else b,
    )


@kernel
def fill_phases(address, realization, block, words, cosine, sine):  # type: ignore[no-untyped-def]
    """Write cosine and sine of the phases of lines 4 block, 4 block + 1, … of one realization, (line,) each.

    `address` is what `impactlab.kernels.random.stream` returns; `words` is work space, (line,) of uint32.
    """
    k0, k1, c3 = address[0], address[1], np.uint32(address[2])
    for index in range(words.shape[0] // 4):
        counter = np.uint64(block) + np.uint64(index)
        c0, c1 = np.uint32(counter & _LOW), np.uint32(counter >> _32)
        w0, w1, w2, w3 = philox(c0, c1, np.uint32(realization), c3, k0, k1)
        words[4 * index] = np.uint32(w0)
        words[4 * index + 1] = np.uint32(w1)
        words[4 * index + 2] = np.uint32(w2)
        words[4 * index + 3] = np.uint32(w3)
    for index in range(cosine.shape[0]):
        cosine[index], sine[index] = cosine_and_sine(words[index])


@kernel
def _turn(real, imaginary, cosine, sine, a, b):  # type: ignore[no-untyped-def]
    for index in range(a.shape[0]):
        a[index] = real[index] * cosine[index] - imaginary[index] * sine[index]
        b[index] = real[index] * sine[index] + imaginary[index] * cosine[index]


@kernel
def _add(a, result):  # type: ignore[no-untyped-def]
    for index in range(result.shape[0]):
        result[index] += a[index]


@kernel
def _add_product(sign, a, b, result):  # type: ignore[no-untyped-def]
    for index in range(result.shape[0]):
        result[index] += sign * (a[index] * b[index])


@kernel
def fold(address, realization, attempt, lowest, frequencies, real, imaginary, folded):  # type: ignore[no-untyped-def]
    """Add up complex amplitudes of lines whose samples cannot be told apart.

    Line n has bin ``(lowest + n) mod bins``.

    Parameters
    ----------
    address : (3,) ndarray of uint64
        Stream of the phases.
    realization : uint32
        Index of the realization.
    attempt : int
        Which set of its phases.
    lowest : int
        Bin of the first line, before it is folded.
    frequencies : (line,) ndarray
        Angular frequencies (rad s-1).
    real, imaginary : (row, line) ndarray
        Amplitudes at phase 0.
    folded : (row, 2 or 4, bin) ndarray
        Result: real and imaginary part, and if there is room those of the derivative.
    """
    rows, lines = real.shape
    bins = folded.shape[2]
    words, cosine, sine = np.empty(CHUNK, np.uint32), np.empty(CHUNK), np.empty(CHUNK)
    a, b = np.empty(CHUNK), np.empty(CHUNK)
    folded[:] = 0.0
    blocks = attempt * ((lines + 3) // 4)
    for first in range(0, lines, CHUNK):
        fill_phases(address, realization, blocks + first // 4, words, cosine, sine)
        count = min(CHUNK, lines - first)
        for row in range(rows):
            chunk = slice(first, first + count)
            _turn(real[row, chunk], imaginary[row, chunk], cosine, sine, a[:count], b[:count])
            begin = 0
            while begin < count:
                low = (lowest + first + begin) % bins
                end = min(count, begin + bins - low)
                high = low + end - begin
                _add(a[begin:end], folded[row, 0, low:high])
                _add(b[begin:end], folded[row, 1, low:high])
                if folded.shape[1] > 2:
                    omega = frequencies[first + begin : first + end]
                    _add_product(-1.0, b[begin:end], omega, folded[row, 2, low:high])
                    _add_product(1.0, a[begin:end], omega, folded[row, 3, low:high])
                begin = end


@kernel
def one_sided(folded, spectrum):  # type: ignore[no-untyped-def]
    """Write what an inverse real FFT takes that is not normalized, (channel, bins // 2 + 1) complex.

    ``Re Σ a_k exp(2πi k n/M)`` does not change if a bin k of the upper half goes, as the
    conjugate, to M − k.

    Parameters
    ----------
    folded : (row, part, bin) ndarray
        Result of `fold`.
    spectrum : (channel, bins // 2 + 1) ndarray of complex
        Result; a channel is a row or its derivative.
    """
    rows, parts, _ = folded.shape
    for row in range(rows):
        for part in range(0, parts, 2):
            channel = row * (parts // 2) + part // 2
            spectrum[channel, 0] = folded[row, part, 0]
            real, imaginary = folded[row, part, 1:], folded[row, part + 1, 1:]
            other_real, other_imaginary, result = real[::-1], imaginary[::-1], spectrum[channel, 1:]
            for k in range(result.shape[0]):
                x, y = real[k] + other_real[k], imaginary[k] - other_imaginary[k]
                result[k] = complex(0.5 * x, 0.5 * y)


@kernel
def interleave(rows, lane, samples):  # type: ignore[no-untyped-def]
    """Write series of some lanes, (lane, row, time), to ``samples[time, row, lane …]``."""
    for time in range(samples.shape[0]):
        for row in range(samples.shape[1]):
            for index in range(rows.shape[0]):
                samples[time, row, lane + index] = rows[index, row, time]
