"""Cosines, sines and exponentials without branches, so that loops over many of them become vectors.

Polynomials are those of fdlibm (Sun Microsystems, 1993) and Taylor's. They are right to two units in the last place.
"""

from __future__ import annotations

import math

import numpy as np

from impactlab.compiling.jit import kernel

MOST_ANGLE = 1e6
"""Largest angle (rad) whose quarter turns leave a part that is exact to rounding."""
MOST_HALVINGS = 1023.0
"""Halvings of 1 that leave nothing, for it is 0 by its bits."""


@kernel
def cosine_and_sine(angle):  # type: ignore[no-untyped-def]
    """Return the cosine and the sine of an angle."""
    quarters = math.floor(angle * 0.6366197723675814 + 0.5)
    part = (
        (angle - quarters * 1.5707963267341256) - quarters * 6.077100506303966e-11
    ) - quarters * 2.0222662487959506e-21
    z = part * part
    sine = -2.50507602534068634195e-08 + z * 1.58969099521155010221e-10
    sine = 8.33333333332248946124e-03 + z * (-1.98412698298579493134e-04 + z * (2.75573137070700676789e-06 + z * sine))
    sine = part + part * z * (-1.66666666666666324348e-01 + z * sine)
    cosine = -2.75573143513906633035e-07 + z * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11)
    cosine = -1.38888888888741095749e-03 + z * (2.48015872894767294178e-05 + z * cosine)
    cosine = 1.0 - 0.5 * z + z * z * (4.16666666666666019037e-02 + z * cosine)
    turn = int(quarters)
    one, two = (sine, cosine) if turn & 1 else (cosine, sine)
    return -one if (turn + 1) & 2 else one, -two if turn & 2 else two


@kernel
def faded(growth):  # type: ignore[no-untyped-def]
    """Return the exponential of minus a number that is not negative."""
    halvings = min(math.floor(growth * 1.4426950408889634 + 0.5), MOST_HALVINGS)
    r = (halvings * 0.6931471803691238 - growth) + halvings * 1.9082149292705877e-10
    z = r * r
    value = (1.0 / 3628800.0 + r * (1.0 / 39916800.0)) + z * (1.0 / 479001600.0 + r * (1.0 / 6227020800.0))
    value = (1.0 / 40320.0 + r * (1.0 / 362880.0)) + z * value
    value = (1.0 / 24.0 + r * (1.0 / 120.0)) + z * ((1.0 / 720.0 + r * (1.0 / 5040.0)) + z * value)
    value = (1.0 + r) + z * ((0.5 + r * (1.0 / 6.0)) + z * value)
    return value * np.int64((1023 - np.int64(halvings)) << 52).view(np.float64)  # the power of a half, by its bits
