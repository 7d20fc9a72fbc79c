"""Exact transitions over many steps, for realizations in which no contact can close meanwhile.

The noise of an interval is a random object of its own, whether its parts are drawn or not:
`w` is its contribution to (x, v) over the whole interval, normal with covariance Q. Its parts are
drawn only where needed, given the whole: `w = A w_a + w_b` for the two halves, or one term
for every step. So a realization has the same noise in any order of drawing.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from impactlab.compiling.jit import kernel
from impactlab.kernels.rows import VV, XV, XX, V, X


class Piece(NamedTuple):
    """State of some lanes at the beginning of an interval, and the noise in it, [body, lane] each."""

    x: np.ndarray
    v: np.ndarray
    wx: np.ndarray
    wv: np.ndarray


@kernel
def draw(factors, rows, normals, column, wx, wv, size):  # type: ignore[no-untyped-def]
    """Draw the noise of an interval.

    factors: Cholesky factors l_xx, l_vx, l_vv of its covariance, (body, 3).
    rows: row of each body's normals, -1 for a body without noise.
    normals, column: standard normals, (4, row, lane), and the first of the two columns that are used.
    wx, wv: result [body, lane].
    size: sum of the squares of the normals [body, lane].
    """
    for body in range(rows.shape[0]):
        row = rows[body]
        if row < 0:
            for lane in range(wx.shape[1]):
                wx[body, lane] = 0.0
                wv[body, lane] = 0.0
                size[body, lane] = 0.0
            continue
        l_xx, l_vx, l_vv = factors[body, 0], factors[body, 1], factors[body, 2]
        for lane in range(wx.shape[1]):
            first, second = float(normals[column, row, lane]), float(normals[column + 1, row, lane])
            wx[body, lane] = l_xx * first
            wv[body, lane] = l_vx * first + l_vv * second
            size[body, lane] = first * first + second * second


@kernel
def jump(transition, piece, after_x, after_v):  # type: ignore[no-untyped-def]
    """Carry bodies over an interval; `transition` is (body, 4)."""
    x, v, wx, wv = piece
    for body in range(transition.shape[0]):
        a_xx, a_xv, a_vx, a_vv = transition[body]
        for lane in range(after_x.shape[1]):
            displacement, velocity = x[body, lane], v[body, lane]
            after_x[body, lane] = a_xx * displacement + a_xv * velocity + wx[body, lane]
            after_v[body, lane] = a_vx * displacement + a_vv * velocity + wv[body, lane]
    hold_wall(after_x)
    hold_wall(after_v)


@kernel
def hold_wall(block):  # type: ignore[no-untyped-def]
    """Set the wall, the last body of a block, to 0: the memory of a dense block may hold anything there."""
    wall = block.shape[0] - 1
    for lane in range(block.shape[1]):
        block[wall, lane] = 0.0


@kernel
def bound(reach, ends, limit, x, v, size, worst):  # type: ignore[no-untyped-def]
    """Bound the indentation of all contacts during an interval, from the size of each body's state and noise.

    With z = (x/s_x, v/s_v, normals) the mean path between the ends of the interval is ``b(t)·z``, so that
    ``|z| max |b(t)|`` bounds it.

    reach: 1/s_x, 1/s_v and the largest |b| (m) of each body and the wall, (body, 3).
    ends: bodies of the contacts, (contact, 2).
    limit: extension of the gap that cannot be closed by what is not in the mean path, (contact,) (m).
    x, v: state at the beginning [body, lane].
    size: what `draw` returned [body, lane]; overwritten by the bounds of the displacements.
    worst: largest excess over `limit`, (1, lane); the lanes where it is positive may touch.
    """
    for body in range(reach.shape[0]):
        of_x, of_v, most = reach[body]
        for lane in range(worst.shape[1]):
            displacement, velocity = of_x * x[body, lane], of_v * v[body, lane]
            square = displacement * displacement + velocity * velocity + size[body, lane]
            size[body, lane] = most * square**0.5
    for lane in range(worst.shape[1]):
        worst[0, lane] = size[ends[0, 0], lane] + size[ends[0, 1], lane] - limit[0]
    for contact in range(1, ends.shape[0]):
        first, second = ends[contact]
        for lane in range(worst.shape[1]):
            worst[0, lane] = max(worst[0, lane], size[first, lane] + size[second, lane] - limit[contact])


@kernel
def search(path, limit, ends, piece, worst):  # type: ignore[no-untyped-def]
    """Find whether the mean path between the ends of an interval, a `Piece`, comes near a contact at any of its steps.

    path: displacement at every step per unit x, v, w_x and w_v, (step, body, 4).
    limit: largest extension of the gap from which the noise about the mean path does not close it, (step, contact) (m).
    ends, worst: as in `bound`; the last is the result.
    """
    x, v, wx, wv = piece
    for lane in range(worst.shape[1]):
        worst[0, lane] = -1.0
    for step in range(path.shape[0]):
        for contact in range(ends.shape[0]):
            i, j = ends[contact]
            a, b, c, d = path[step, i]
            e, f, g, h = path[step, j]
            most = limit[step, contact]
            for lane in range(worst.shape[1]):
                first = a * x[i, lane] + b * v[i, lane] + c * wx[i, lane] + d * wv[i, lane]
                second = e * x[j, lane] + f * v[j, lane] + g * wx[j, lane] + h * wv[j, lane]
                worst[0, lane] = max(worst[0, lane], first - second - most)


@kernel
def select(worst, chosen):  # type: ignore[no-untyped-def]
    """Write the lanes where `worst` is not negative, or not a number, and return their number."""
    count = 0
    for lane in range(worst.shape[1]):
        chosen[count] = lane
        count += not worst[0, lane] < 0.0
    return count


@kernel
def take(block, chosen, result):  # type: ignore[no-untyped-def]
    """Copy some lanes of a block into the lanes of another."""
    for row in range(result.shape[0]):
        for lane in range(result.shape[1]):
            result[row, lane] = block[row, chosen[lane]]


@kernel
def put(block, chosen, result):  # type: ignore[no-untyped-def]
    """Copy the lanes of a block into some lanes of another, row by row of the first."""
    for row in range(block.shape[0]):
        for lane in range(block.shape[1]):
            result[row, chosen[lane]] = block[row, lane]


@kernel
def add_to(block, chosen, result):  # type: ignore[no-untyped-def]
    """Add the lanes of a block to some lanes of another."""
    for row in range(block.shape[0]):
        for lane in range(block.shape[1]):
            result[row, chosen[lane]] += block[row, lane]


@kernel
def halve(gain, factors, transition, rows, normals, whole, half):  # type: ignore[no-untyped-def]
    """Draw the noise of the two halves of an interval, given that of the whole.

    gain: mean of the first half's per unit of the whole's, (body, 4).
    factors: Cholesky factors of its conditional covariance, (body, 3).
    transition: flow over half the interval, (body, 4).
    rows, normals: as in `draw`.
    whole: the interval; its noise is overwritten by the noise of the second half.
    half: the first half.
    """
    wx, wv, half_x, half_v = whole.wx, whole.wv, half.wx, half.wv
    for body in range(rows.shape[0]):
        row = rows[body]
        if row < 0:
            for lane in range(half_x.shape[1]):
                half_x[body, lane] = 0.0
                half_v[body, lane] = 0.0
            continue
        g_xx, g_xv, g_vx, g_vv = gain[body]
        l_xx, l_vx, l_vv = factors[body, 0], factors[body, 1], factors[body, 2]
        a_xx, a_xv, a_vx, a_vv = transition[body]
        for lane in range(half_x.shape[1]):
            whole_x, whole_v = wx[body, lane], wv[body, lane]
            first, second = float(normals[0, row, lane]), float(normals[1, row, lane])
            x = g_xx * whole_x + g_xv * whole_v + l_xx * first
            v = g_vx * whole_x + g_vv * whole_v + l_vx * first + l_vv * second
            half_x[body, lane], half_v[body, lane] = x, v
            wx[body, lane] = whole_x - a_xx * x - a_xv * v
            wv[body, lane] = whole_v - a_vx * x - a_vv * v


@kernel
def pin(inverse, wx, wv, sum_x, sum_v):  # type: ignore[no-untyped-def]
    """Turn the difference between the noise of an interval and the sum over its steps into multipliers.

    `inverse` is the inverse of the covariance of the interval, (body, 3); the result is written to `sum_x`, `sum_v`.
    """
    for body in range(inverse.shape[0]):
        i_xx, i_xv, i_vv = inverse[body, 0], inverse[body, 1], inverse[body, 2]
        for lane in range(sum_x.shape[1]):
            x, v = wx[body, lane] - sum_x[body, lane], wv[body, lane] - sum_v[body, lane]
            sum_x[body, lane] = i_xx * x + i_xv * v
            sum_v[body, lane] = i_xv * x + i_vv * v


@kernel
def correct(gain, of_x, of_v, x, v):  # type: ignore[no-untyped-def]
    """Add to each step what makes the noise of all steps that of their interval (Matheron's rule)."""
    for body in range(gain.shape[0]):
        g_xx, g_xv, g_vx, g_vv = gain[body]
        for lane in range(x.shape[1]):
            x[body, lane] += g_xx * of_x[body, lane] + g_xv * of_v[body, lane]
            v[body, lane] += g_vx * of_x[body, lane] + g_vv * of_v[body, lane]


@kernel
def add_samples(x, v, sums):  # type: ignore[no-untyped-def]
    """Add the powers of displacement and velocity to ``sums[row, body, lane]``."""
    for body in range(sums.shape[1]):
        for lane in range(sums.shape[2]):
            displacement, velocity = x[body, lane], v[body, lane]
            sums[X, body, lane] += displacement
            sums[V, body, lane] += velocity
            sums[XX, body, lane] += displacement * displacement
            sums[XV, body, lane] += displacement * velocity
            sums[VV, body, lane] += velocity * velocity


@kernel
def amend_samples(x, v, middle, chosen, sums):  # type: ignore[no-untyped-def]
    """Replace, in what `add_samples` added, the velocities of some lanes by those in the middle of their kick."""
    for body in range(sums.shape[1]):
        for lane in range(middle.shape[1]):
            other = chosen[lane]
            old, new = v[body, lane], middle[body, lane]
            sums[V, body, other] += new - old
            sums[XV, body, other] += x[body, lane] * (new - old)
            sums[VV, body, other] += new * new - old * old
