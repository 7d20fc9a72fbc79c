"""Given functions of time as polynomials on panels."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.polynomial import chebyshev

from impactlab.components.excitation import Excitation
from impactlab.components.loads import SampledForce
from impactlab.errors import InvalidInput
from impactlab.kernels.pieces import DEGREE, TURN, Panels

SMALL = 1e-14
"""Part of the largest value of a function up to which the last coefficients of its polynomials are rounding."""

LAST = 3
"""How many of them have to be."""

FEWEST_PANELS = 64
"""Panels of a run at least."""

WIDEST = 10.0 * TURN
"""Largest angle of the fastest body in a panel (rad), so that no function is overlooked that is long enough for it."""

ROUNDED = 1e-15
"""The same for a panel as long as its distance from t = 0; rounding of the time is a larger part of shorter ones."""

MOST = 1e9
"""Memory of the polynomials of a call (bytes)."""

_COUNT = DEGREE + 1
_NODES = 0.5 - 0.5 * np.cos(np.pi * (np.arange(_COUNT) + 0.5) / _COUNT)
_FIT = np.linalg.inv(chebyshev.chebvander(2.0 * _NODES - 1.0, DEGREE))
"""From values at Chebyshev's nodes in [0, 1] to coefficients of his polynomials."""

_POWERS = np.array([np.polynomial.Chebyshev.basis(k, [0.0, 1.0]).convert(kind=np.polynomial.Polynomial).coef.tolist()
                    + [0.0] * (DEGREE - k) for k in range(_COUNT)])  # fmt: skip
"""Powers in each of these, (polynomial, power)."""


def panels_of(functions: Sequence[Sequence[Excitation]], begin: float, end: float, fastest: float) -> Panels:
    """Return the given functions of lanes between two times, (function,) each, on panels that suit all of them.

    Panels end where functions are known to change, and are halved where they are no polynomials to rounding; where a
    function jumps without saying so, down to the rounding of the time. `fastest` is the largest rate of a body
    (rad s-1).

    Raises
    ------
    InvalidInput
        If a function is not finite, or needs more panels than there is memory for.
    """
    first: dict[tuple[int, ...], int] = {}  # realizations of one network have the same functions
    sets = np.array([first.setdefault(tuple(map(id, lane)), len(first)) for lane in functions], dtype=np.int64)
    number, unlike = len(functions[0]) if functions else 0, [functions[lane] for lane in np.unique(sets, True)[1]]
    if not number:
        return Panels(np.array([begin, end]), np.zeros((len(unlike), 0, 0)), sets)
    breaks = [breaks_of(item) for own in unlike for item in own]
    uniform = np.linspace(begin, end, max(FEWEST_PANELS, math.ceil(fastest * (end - begin) / WIDEST)) + 1)
    edges = np.unique(np.concatenate([uniform, within(breaks, begin, end)]))
    open_ones = np.stack([edges[:-1], edges[1:]], axis=1)
    sizes, done, fits = np.zeros((len(unlike), number)), list[np.ndarray](), list[np.ndarray]()
    while len(open_ones):
        if 16.0 * len(unlike) * number * _COUNT * len(open_ones) > MOST:
            raise InvalidInput(
                f"EventLocated needs more than {MOST:.0e} bytes for the given forces from {begin:g} to {end:g} s; make "
                "the run shorter, or use il.ExactFlow()."
            )
        rough, found = np.zeros(len(open_ones), bool), np.zeros((len(unlike), len(open_ones), number, _COUNT))
        allowed = SMALL + ROUNDED * np.abs(open_ones).max(axis=1) / (open_ones[:, 1] - open_ones[:, 0])
        for place, own in enumerate(unlike):
            left = np.flatnonzero(~rough)  # a panel is halved for all sets, so that others need not look at it
            found[place, left] = fitted = _fits(own, open_ones[left])
            sizes[place] = np.maximum(sizes[place], np.abs(fitted).sum(axis=-1).max(axis=0, initial=0.0))
            last = np.abs(fitted[..., -LAST:]).max(axis=-1)
            rough[left] = (last > allowed[left, None] * sizes[place]).any(axis=1)
        done.append(open_ones[~rough])
        fits.append(found[:, ~rough])
        middle = 0.5 * (open_ones[rough, :1] + open_ones[rough, 1:])
        halves = np.stack([open_ones[rough, :1], middle, middle, open_ones[rough, 1:]], axis=1)
        open_ones = halves.reshape(-1, 2)
    panels, coefficients = np.concatenate(done), np.concatenate(fits, axis=1)
    order = np.argsort(panels[:, 0])
    coefficients[np.abs(coefficients) < 0.1 * SMALL * sizes[:, None, :, None]] = 0.0
    functions_of = (coefficients[:, order] @ _POWERS).reshape(len(unlike), len(order), number * _COUNT)
    edges = np.append(panels[order, 0], end)
    return Panels(edges, np.ascontiguousarray(functions_of), sets)  # compiled code takes no others


def _fits(functions: Sequence[Excitation], panels: np.ndarray) -> np.ndarray:
    """Return the coefficients of Chebyshev's polynomials, (panel, function, coefficient)."""
    times = panels[:, :1] + (panels[:, 1:] - panels[:, :1]) * _NODES
    values = np.stack([item.call("force", times) for item in functions], axis=1)
    if not np.isfinite(values).all():
        panel, function, node = np.argwhere(~np.isfinite(values))[0]
        raise InvalidInput(
            f"The force of {functions[function]!r} is {values[panel, function, node]:g} at {times[panel, node]:g} s."
        )
    return np.asarray(values @ _FIT.T)


def breaks_of(excitation: Excitation) -> tuple[np.ndarray, bool]:
    """Return the times at which a given force is not smooth, and whether they repeat."""
    if isinstance(excitation, SampledForce):
        return np.asarray(excitation.times, dtype=float), excitation.repeats
    return np.array(excitation.acts_between), False


def within(breaks: Sequence[tuple[np.ndarray, bool]], begin: float, end: float) -> np.ndarray:
    """Return those times that are between two others, in order."""
    found = [_repeated(times, begin, end) if repeats else times for times, repeats in breaks]
    times = np.unique(np.concatenate([np.zeros(0), *found]))
    chosen: np.ndarray = times[(times > begin) & (times < end)]
    return chosen


def _repeated(times: np.ndarray, begin: float, end: float) -> np.ndarray:
    """Return the times of samples that repeat, and of all their repetitions between two others."""
    period = times[-1] - times[0]
    turns = np.arange(np.floor((begin - times[0]) / period), np.ceil((end - times[0]) / period) + 1)
    result: np.ndarray = (times[:-1] + period * turns[:, None]).ravel()
    return result
