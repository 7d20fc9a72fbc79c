"""Random numbers that are addressed, not drawn: streams of normals without state.

A stream belongs to (seed, body, purpose) and holds one sequence for every realization.
Element n of the sequence is a pure function of these, so that a realization has the
same numbers in any block, thread or machine, alone or among thousands.

The words are Philox4x32-10 (Salmon, Moraes, Dror and Shaw, SC'11, doi:10.1145/2063384.2063405):
key = 64 bits of the stream, counter = (block, realization, 32 more bits of the stream).
One block of four words gives normals 4 block … 4 block + 3 by the method of Box and
Muller, two from each pair of words (a, b): a makes the radius (tails to 6.7 σ); bits 8 and 9
of b make the two signs and bits 10 to 31 the angle inside a quadrant. Normals are of single
precision: their rounding, 1e-7, is far below any statistical error, and twice as many fit
into a vector register. Only additions, multiplications and square roots are used, which
IEEE 754 rounds alike everywhere, so that the numbers agree to the last bit between machines.
The logarithm, sine and cosine are minimax polynomials of relative accuracy 3e-8.

These numbers are fixed: a faster implementation must return the same ones.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Iterable, Sequence

import numpy as np

from impactlab.compiling.jit import allocating, kernel
from impactlab.compiling.scalars import scalar

_M0, _M1 = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
_W0, _W1 = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)
LOW, WORD = np.uint64(0xFFFFFFFF), np.uint64(32)
"""Mask of the lower 32 of 64 bits, and the shift of the upper ones."""

_10, _22, _23, _I23 = np.uint32(10), np.uint32(22), np.uint32(23), np.int32(23)
_BIT8, _BIT9 = np.uint32(1 << 8), np.uint32(1 << 9)
_SQRT_HALF = np.int32(0x3F3504F3)  # the bits of sqrt(1/2)
_HALF, _ONE, _LN2 = np.float32(0.5), np.float32(1.0), np.float32(np.log(2.0))
_SQRT_HALF_NUMBER = np.float32(np.sqrt(0.5))
_RADIUS_UNIT = np.float32(2.0**-32)
_ANGLE_UNIT, _ANGLE_MIDDLE = np.float32(np.pi / 2.0**23), np.float32(2.0**21 - 0.5)
_LOGARITHM = tuple(
    np.float32(number)
    for number in (0.33333910, -0.25001338, 0.19963063, -0.16577585, 0.14914769, -0.14267487, 0.087004349)
)
_SINE = tuple(np.float32(number) for number in (-0.16666651, 0.0083320364, -0.00019504022))
_COSINE = tuple(np.float32(number) for number in (-0.49999857, 0.041655026, -0.0013585909))


def stream(seed: tuple[int, int], name: str, purpose: str) -> tuple[int, int, int]:
    """Return the address of a stream: two words of the key and one of the counter, from BLAKE2 keyed by the seed.

    The seed is 128 bits as two words of 64 bits, the name that of the body or the source, and the purpose says what the
    numbers are for in at most 16 bytes ("noise", "start", "phases").
    """
    low, high, word = addresses(seed, [name], purpose)[:, 0].tolist()
    return low, high, word


def addresses(seed: tuple[int, int], names: Iterable[str], purpose: str) -> np.ndarray:
    """Return the addresses of the streams of several names for one purpose, (3, name) of uint64."""
    begun = hashlib.blake2b(digest_size=12, key=struct.pack("<2Q", *seed), person=purpose.encode())
    digests = []
    for name in map(str.encode, names):
        digest = begun.copy()
        digest.update(name)
        digests.append(digest.digest())
    return np.frombuffer(b"".join(digests), dtype="<u4").reshape(-1, 3).T.astype(np.uint64, order="C")


def streams_of(seed: tuple[int, int], names: Sequence[str], numbers: Sequence[int]) -> np.ndarray:
    """Return the addresses of rows of noise, (3, row), from names of bodies or sources and numbers of their normals."""
    result, which = np.empty((3, len(names)), dtype=np.uint64), np.asarray(numbers)
    for number in set(numbers):
        rows = np.flatnonzero(which == number)
        own = map(names.__getitem__, rows.tolist())
        result[:, rows] = addresses(seed, own, "noise" if number == 0 else f"noise {number + 1}")
    return result


@scalar
def philox(c0, c1, c2, c3, k0, k1):  # type: ignore[no-untyped-def]
    """Ten rounds of Philox4x32; words of 32 bits, the key in 64."""
    for _ in range(10):
        p0 = _M0 * np.uint64(c0)
        p1 = _M1 * np.uint64(c2)
        c0 = np.uint32(np.uint32(p1 >> WORD) ^ c1 ^ np.uint32(k0))
        c1 = np.uint32(p1 & LOW)
        c2 = np.uint32(np.uint32(p0 >> WORD) ^ c3 ^ np.uint32(k1))
        c3 = np.uint32(p0 & LOW)
        k0 = (k0 + _W0) & LOW
        k1 = (k1 + _W1) & LOW
    return c0, c1, c2, c3


@scalar
def normal_pair(a, b):  # type: ignore[no-untyped-def]
    """Two independent standard normals from two words of 32 bits."""
    # radius / sqrt(2) = sqrt(-log u); u = 2^e (1 + x) with 1 + x in [sqrt(1/2), sqrt(2))
    u = (np.float32(a) + _HALF) * _RADIUS_UNIT
    bits = np.int32(np.float32(u).view(np.int32))
    e = np.int32(np.int32(bits - _SQRT_HALF) >> _I23)
    near_one = -(np.float32(~a) + _HALF) * _RADIUS_UNIT  # u - 1 without the rounding of u
    x = near_one if e == 0 else np.int32(bits - np.int32(e << _I23)).view(np.float32) - _ONE
    l3, l4, l5, l6, l7, l8, l9 = _LOGARITHM
    p = l3 + x * (l4 + x * (l5 + x * (l6 + x * (l7 + x * (l8 + x * l9)))))
    r = np.sqrt(-(x + x * x * (p * x - _HALF) + np.float32(e) * _LN2))
    # the angle is pi/4 + t with |t| < pi/4; the signs choose the quadrant
    t = (np.float32(np.int32(b >> _10)) - _ANGLE_MIDDLE) * _ANGLE_UNIT
    q = t * t
    s3, s5, s7 = _SINE
    c2, c4, c6 = _COSINE
    sine = t * (_ONE + q * (s3 + q * (s5 + q * s7)))
    cosine = _ONE + q * (c2 + q * (c4 + q * c6))
    first = np.uint32(np.float32(r * (cosine - sine)).view(np.uint32))
    second = np.uint32(np.float32(r * (cosine + sine)).view(np.uint32))
    first = np.uint32(first ^ np.uint32((b & _BIT8) << _23))
    second = np.uint32(second ^ np.uint32((b & _BIT9) << _22))
    return np.uint32(first).view(np.float32), np.uint32(second).view(np.float32)


@kernel
def fill_normals(streams, realizations, block, normals):  # type: ignore[no-untyped-def]
    """Write normals 4 block … 4 block + 3 of every stream and realization, (4, stream, lane) of single precision.

    Streams are addresses as `stream` returns them, (3, stream) of uint64, and realizations indices, (lane,) of uint32.
    """
    c0 = np.uint32(block & LOW)
    c1 = np.uint32(block >> WORD)
    # two loops: words first, kept as the bits of the result, then normals; one loop
    # for both runs out of registers and takes a quarter longer
    for row in range(normals.shape[1]):
        k0, k1, c3 = streams[0, row], streams[1, row], np.uint32(streams[2, row])
        for lane in range(normals.shape[2]):  # the shape of what is written: so the loops vectorise
            w0, w1, w2, w3 = philox(c0, c1, realizations[lane], c3, k0, k1)
            normals[0, row, lane] = np.uint32(w0).view(np.float32)
            normals[1, row, lane] = np.uint32(w1).view(np.float32)
            normals[2, row, lane] = np.uint32(w2).view(np.float32)
            normals[3, row, lane] = np.uint32(w3).view(np.float32)
    for half in (0, 2):
        for row in range(normals.shape[1]):
            for lane in range(normals.shape[2]):
                a = np.uint32(np.float32(normals[half, row, lane]).view(np.uint32))
                b = np.uint32(np.float32(normals[half + 1, row, lane]).view(np.uint32))
                first, second = normal_pair(a, b)
                normals[half, row, lane] = first
                normals[half + 1, row, lane] = second


@kernel
def fill_steps(noise, group, normals):  # type: ignore[no-untyped-def]
    """Write the normals of steps 4 group … 4 group + 3 for every row of noise.

    Coarse noise is the sum of the normals of every two steps of a run at half the step, over √2, so that both runs
    follow nearly the same paths.
    """
    fill_streams(noise, group, noise.distinct if noise.which.shape[0] else normals)
    for row in range(noise.which.shape[0]):  # rows of one stream have the same normals
        number = noise.which[row]
        for part in range(4):
            for lane in range(normals.shape[2]):
                normals[part, row, lane] = noise.distinct[part, number, lane]


@allocating
def fill_streams(noise, group, normals):  # type: ignore[no-untyped-def]
    """Do so for every stream of the noise."""
    if not noise.coarse:
        fill_normals(noise.streams, noise.realizations, np.uint64(group), normals)
        return
    fine = np.empty_like(normals)
    for half in (0, 1):
        fill_normals(noise.streams, noise.realizations, np.uint64(2 * group + half), fine)
        for pair in (0, 1):
            for row in range(normals.shape[1]):
                for lane in range(normals.shape[2]):
                    both = fine[2 * pair, row, lane] + fine[2 * pair + 1, row, lane]
                    normals[2 * half + pair, row, lane] = _SQRT_HALF_NUMBER * both


@kernel
def philox_words(counters_and_keys, words):  # type: ignore[no-untyped-def]
    """Apply Philox4x32-10 to rows (c0, c1, c2, c3, k0, k1); for tests against known answers."""
    for row in range(counters_and_keys.shape[0]):
        c = counters_and_keys[row]
        result = philox(np.uint32(c[0]), np.uint32(c[1]), np.uint32(c[2]), np.uint32(c[3]), c[4], c[5])
        for part in range(4):
            words[row, part] = result[part]


def normals_of(
    seed: tuple[int, int], name: str, purpose: str, realizations: np.ndarray, first_block: int, blocks: int
) -> np.ndarray:
    """Return consecutive normals of one `stream`, (4 blocks, lane) of single precision, from the first block on."""
    addresses = np.array([stream(seed, name, purpose)], dtype=np.uint64).T.copy()
    lanes = np.ascontiguousarray(realizations, dtype=np.uint32)
    result = np.empty((blocks, 4, 1, lanes.size), dtype=np.float32)
    for index in range(blocks):
        fill_normals(addresses, lanes, np.uint64(first_block + index), result[index])
    return result.reshape(4 * blocks, lanes.size)
