"""Random numbers that are addressed, not drawn: streams of normals without state.

A stream belongs to (seed, body, purpose) and holds one sequence for every realization.
Element n of the sequence is a pure function of these, so that a realization has the
same numbers in any block, thread or machine, alone or among thousands.

The words are Philox4x32-10 (Salmon, Moraes, Dror and Shaw, SC'11, doi:10.1145/2063384.2063405):
key = 64 bits of the stream, counter = (block, realization, 32 more bits of the stream).
One block of four words gives normals 4 block … 4 block + 3 by the method of Box and
Muller, two from each pair of words (a, b): 40 bits, a and the low byte of b, make the
radius (tails to 7.5 σ); bits 8 and 9 of b make the two signs and bits 10 to 31 the angle
inside a quadrant. Only additions, multiplications, divisions and square roots are used,
which IEEE 754 rounds alike everywhere, so that the numbers agree to the last bit between
machines. The logarithm, sine and cosine are minimax polynomials of relative accuracy
5e-11, finer than the spacing of the uniforms that enter.

These numbers are fixed: a faster implementation must return the same ones.
"""

from __future__ import annotations

import hashlib

import numpy as np

from impactlab.kernels.jit import kernel, scalar

_M0, _M1 = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
_W0, _W1 = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)
_LOW, _32 = np.uint64(0xFFFFFFFF), np.uint64(32)
_BYTE, _8, _10, _54, _55 = (np.uint64(value) for value in (0xFF, 8, 10, 54, 55))
_BIT8, _BIT9 = np.uint64(1 << 8), np.uint64(1 << 9)
_SQRT_HALF = np.int64(0x3FE6A09E667F3BCD)  # the bits of sqrt(1/2)
_RADIUS_UNIT = 2.0**-40
_ANGLE_UNIT, _ANGLE_MIDDLE = np.pi / 2.0**23, 2.0**21 - 0.5
_LN2 = np.log(2.0)


def stream(seed: tuple[int, int], name: str, purpose: str) -> tuple[int, int, int]:
    """Return the address of a stream: two words of the key and one of the counter.

    Parameters
    ----------
    seed : tuple of int
        128 bits of seed as two words of 64 bits.
    name : str
        Name of the body.
    purpose : str
        What the numbers are for, at most 16 bytes ("noise", "start", "phases").

    Returns
    -------
    tuple of int
        Three words of 32 bits, from BLAKE2 keyed by the seed.
    """
    key = b"".join(word.to_bytes(8, "little") for word in seed)
    digest = hashlib.blake2b(name.encode(), digest_size=12, key=key, person=purpose.encode()).digest()
    low, high, word = (int.from_bytes(digest[4 * k : 4 * k + 4], "little") for k in range(3))
    return low, high, word


@scalar
def philox(c0, c1, c2, c3, k0, k1):  # type: ignore[no-untyped-def]
    """Ten rounds of Philox4x32 on words of 32 bits that are held in 64."""
    for _ in range(10):
        p0 = _M0 * c0
        p1 = _M1 * c2
        c0 = (p1 >> _32) ^ c1 ^ k0
        c1 = p1 & _LOW
        c2 = (p0 >> _32) ^ c3 ^ k1
        c3 = p0 & _LOW
        k0 = (k0 + _W0) & _LOW
        k1 = (k1 + _W1) & _LOW
    return c0, c1, c2, c3


@scalar
def normal_pair(a, b):  # type: ignore[no-untyped-def]
    """Two independent standard normals from two words of 32 bits."""
    # radius / sqrt(2) = sqrt(-log u); u = 2^e m with m in [sqrt(1/2), sqrt(2))
    u = (np.float64(np.int64((a << _8) | (b & _BYTE))) + 0.5) * _RADIUS_UNIT
    bits = np.float64(u).view(np.int64)
    e = (np.int64(bits) - _SQRT_HALF) >> np.int64(52)
    m = np.int64(np.int64(bits) - (e << np.int64(52))).view(np.float64)
    s = (m - 1.0) / (m + 1.0)
    z = s * s
    p = 0.2853505103781631 + z * 0.23616359099145984
    p = 2.0000000000083595 + z * (0.6666666524748752 + z * (0.4000038467237519 + z * p))
    r = np.sqrt(-(s * p + np.float64(e) * _LN2))
    # the angle is pi/4 + t with |t| < pi/4; the signs choose the quadrant
    t = (np.float64(np.int64(b >> _10)) - _ANGLE_MIDDLE) * _ANGLE_UNIT
    q = t * t
    sine = 0.00833332878245888 + q * (-0.000198392022122311 + q * 2.7173456841089953e-06)
    sine = t * (0.9999999999956731 + q * (-0.16666666631591165 + q * sine))
    cosine = -0.0013886617999647076 + q * 2.4379831251175367e-05
    cosine = 0.9999999999524894 + q * (-0.4999999961485761 + q * (0.041666616692532826 + q * cosine))
    first = np.float64(r * (cosine - sine)).view(np.uint64)
    second = np.float64(r * (cosine + sine)).view(np.uint64)
    first = np.uint64(first) ^ ((b & _BIT8) << _55)
    second = np.uint64(second) ^ ((b & _BIT9) << _54)
    return np.uint64(first).view(np.float64), np.uint64(second).view(np.float64)


@kernel
def fill_normals(streams, realizations, block, normals):  # type: ignore[no-untyped-def]
    """Write normals 4 block … 4 block + 3 of every stream and realization.

    Parameters
    ----------
    streams : (stream, 3) uint64
        Addresses as `stream` returns them.
    realizations : (lane,) uint64
        Indices of the realizations, below 2^32.
    block : uint64
        Index of the block.
    normals : (stream, 4, lane) float64
        Result.
    """
    lanes = normals.shape[2]  # the shape of what is written: so the loops vectorise
    c0 = np.uint64(block) & _LOW
    c1 = np.uint64(block) >> _32
    for row in range(streams.shape[0]):
        k0, k1, c3 = streams[row, 0], streams[row, 1], streams[row, 2]
        # two loops: words first, kept as the bits of the result, then normals; one loop
        # for both runs out of registers and takes a quarter longer
        for lane in range(lanes):
            w0, w1, w2, w3 = philox(c0, c1, realizations[lane] & _LOW, c3, k0, k1)
            normals[row, 0, lane] = np.uint64(w0).view(np.float64)
            normals[row, 1, lane] = np.uint64(w1).view(np.float64)
            normals[row, 2, lane] = np.uint64(w2).view(np.float64)
            normals[row, 3, lane] = np.uint64(w3).view(np.float64)
        for half in (0, 2):
            for lane in range(lanes):
                a = np.float64(normals[row, half, lane]).view(np.uint64)
                b = np.float64(normals[row, half + 1, lane]).view(np.uint64)
                first, second = normal_pair(np.uint64(a), np.uint64(b))
                normals[row, half, lane] = first
                normals[row, half + 1, lane] = second


@kernel
def fill_uniforms(address, realization, block, uniforms):  # type: ignore[no-untyped-def]
    """Write uniforms on (0, 1) of one stream and realization, four a block, from `block` on.

    Parameters
    ----------
    address : (3,) uint64
        Address as `stream` returns it.
    realization : uint64
        Index of the realization, below 2^32.
    block : uint64
        Index of the first block.
    uniforms : (4 n,) float64
        Result.
    """
    k0, k1, c3 = address[0], address[1], address[2]
    for index in range(uniforms.shape[0] // 4):
        counter = np.uint64(block) + np.uint64(index)
        words = philox(counter & _LOW, counter >> _32, np.uint64(realization), c3, k0, k1)
        for part in range(4):
            uniforms[4 * index + part] = (np.float64(np.int64(words[part])) + 0.5) * 2.0**-32


@kernel
def philox_words(counters_and_keys, words):  # type: ignore[no-untyped-def]
    """Apply Philox4x32-10 to rows (c0, c1, c2, c3, k0, k1); for tests against known answers."""
    for row in range(counters_and_keys.shape[0]):
        c = counters_and_keys[row]
        result = philox(c[0], c[1], c[2], c[3], c[4], c[5])
        for part in range(4):
            words[row, part] = result[part]


def normals_of(
    seed: tuple[int, int], name: str, purpose: str, realizations: np.ndarray, first_block: int, blocks: int
) -> np.ndarray:
    """Return consecutive normals of one stream.

    Parameters
    ----------
    seed, name, purpose
        See `stream`.
    realizations : (lane,) array of int
        Indices of the realizations.
    first_block, blocks : int
        First block of four normals and number of blocks.

    Returns
    -------
    (4 blocks, lane) ndarray
    """
    addresses = np.array([stream(seed, name, purpose)], dtype=np.uint64)
    lanes = np.ascontiguousarray(realizations, dtype=np.uint64)
    result = np.empty((blocks, 4, lanes.size))
    for index in range(blocks):
        fill_normals(addresses, lanes, np.uint64(first_block + index), result[index : index + 1])
    return result.reshape(4 * blocks, lanes.size)
