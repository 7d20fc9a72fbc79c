"""Phases of waves in phase space."""

from __future__ import annotations

import numpy as np

from impactlab.compiling.jit import allocating


@allocating
def turn(planes, first, second):  # type: ignore[no-untyped-def]
    """Multiply complex numbers by phases of two directions, in place.

    Real and imaginary parts are planes, (waves, 2, center, first, second); the phases are complex numbers of the same
    precision, (waves, center, first) and (waves, center, second).
    """
    cosine, sine = np.empty(second.shape[2], planes.dtype), np.empty(second.shape[2], planes.dtype)
    for k in range(planes.shape[0]):
        for j in range(planes.shape[2]):
            for n in range(len(cosine)):
                cosine[n], sine[n] = second[k, j, n].real, second[k, j, n].imag
            for m in range(planes.shape[3]):
                real, imaginary = first[k, j, m].real, first[k, j, m].imag
                x, y = planes[k, 0, j, m], planes[k, 1, j, m]
                for n in range(len(cosine)):
                    c = real * cosine[n] - imaginary * sine[n]
                    s = real * sine[n] + imaginary * cosine[n]
                    old = x[n]
                    x[n] = c * old - s * y[n]
                    y[n] = s * old + c * y[n]
