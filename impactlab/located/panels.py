"""Given functions of time as polynomials on panels."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.polynomial import chebyshev

from impactlab.components.excitation import Excitation
from impactlab.components.loads import SampledForce
from impactlab.components.modulated import ModulatedForce
from impactlab.errors import InvalidInput
from impactlab.kernels.pieces import DEGREE, TURN, Panels

SMALL = 1e-14
"""Part of the largest value of a function up to which the last coefficients of its polynomials are rounding."""

LAST = 3
"""How many of them have to be."""

FEWEST_PANELS = 64
"""Panels of a run at least."""

WIDEST = TURN
"""Largest angle of the fastest body in a panel (rad): nodes are up to 0.3 rad apart, so that only shorter functions may
be overlooked. A power series lasts no longer either."""

ROUNDED = 1e-15
"""The same for a panel as long as its distance from t = 0; rounding of the time is a larger part of shorter ones."""

SPREAD = 8
"""Panels that tell how fine most of them are to be."""

MOST = 1e9
"""Memory of the polynomials of a call (bytes)."""

_TOO_LARGE = (
    f"EventLocated needs over {MOST:.0e} bytes for the given forces from {{begin:g}} to {{end:g}} s; make the run "
    "shorter, or use il.ExactFlow()."
)
_COUNT = DEGREE + 1
_NODES = 0.5 - 0.5 * np.cos(np.pi * (np.arange(_COUNT) + 0.5) / _COUNT)


@cache  # of runs with functions alone
def _transforms() -> tuple[np.ndarray, np.ndarray]:
    """Return how values at Chebyshev's nodes become coefficients of his polynomials in [0, 1], and their powers."""
    fit = np.linalg.inv(chebyshev.chebvander(2.0 * _NODES - 1.0, DEGREE))
    powers = np.zeros((_COUNT, _COUNT))
    for degree in range(_COUNT):
        polynomial = np.polynomial.Chebyshev.basis(degree, [0.0, 1.0]).convert(kind=np.polynomial.Polynomial)
        powers[degree, : degree + 1] = polynomial.coef
    return fit, powers


def panels_of(functions: Sequence[Sequence[Excitation]], begin: float, end: float, fastest: float) -> Panels:
    """Return the given functions of lanes between two times, (function,) each.

    Panels end where functions are known to change, and are halved where they are no polynomials to rounding; where a
    function jumps without saying so, down to the rounding of the time. `fastest` is the largest rate of a body
    (rad s-1).

    Raises
    ------
    InvalidInput
        If a function is not finite, or needs more panels than there is memory for.
    """
    number = len(functions[0]) if functions else 0
    if not number:
        return Panels(np.zeros(0), np.zeros((0, 0)), np.zeros(1, np.int64), np.zeros(len(functions), np.int64))
    first: dict[tuple[int, ...], int] = {}  # realizations of one network have the same functions
    sets = np.array([first.setdefault(tuple(map(id, lane)), len(first)) for lane in functions], dtype=np.int64)
    least = max(FEWEST_PANELS, math.ceil(fastest * (end - begin) / WIDEST))
    uniform = np.linspace(begin, end, least + 1)
    room, edges, powers = MOST, list[np.ndarray](), list[np.ndarray]()
    for place in np.unique(sets, True)[1]:
        own = functions[place]
        breaks = within([item for one in own for item in breaks_of(one)], begin, end)
        ends, found = _fitted(own, np.unique(np.concatenate([uniform, breaks])), room)
        edges.append(ends)
        powers.append((found @ _transforms()[1]).reshape(len(found), -1))
        room -= powers[-1].nbytes
    begins = np.cumsum([0, *map(len, edges)])
    return Panels(np.concatenate(edges), np.concatenate(powers), begins, sets)


def _fitted(functions: Sequence[Excitation], edges: np.ndarray, room: float) -> tuple[np.ndarray, np.ndarray]:
    """Return edges of panels, and the coefficients of Chebyshev's polynomials there, (panel, function, coefficient)."""
    panels, chosen = np.stack([edges[:-1], edges[1:]], axis=1), np.linspace(0, len(edges) - 2, SPREAD).astype(int)
    widths, parts, size = np.diff(panels)[:, 0], 1, np.zeros(len(functions))
    span = float(edges[-1] - edges[0])
    while True:  # most panels are so fine
        tried = panels[chosen, :1] + np.outer(widths[chosen] / parts, [0.0, 1.0])
        fits = _fits(functions, tried)
        size = np.maximum(size, np.abs(fits).sum(axis=-1).max(axis=0))
        if _rough(fits, tried, size, span).mean() <= 0.5:
            break
        parts = max(parts + 1, 4 * parts // 3)
    if 16.0 * len(panels) * parts * (DEGREE + 1) * len(functions) > room:
        raise InvalidInput(_TOO_LARGE.format(begin=edges[0], end=edges[-1]))
    left = (panels[:, :1] + widths[:, None] / parts * np.arange(parts)).ravel()
    panels, done, found = np.stack([left, np.append(left[1:], edges[-1])], axis=1), list[np.ndarray](), []
    while len(panels):
        room -= 16.0 * panels.size * (DEGREE + 1) * len(functions)
        if room < 0.0:
            raise InvalidInput(_TOO_LARGE.format(begin=edges[0], end=edges[-1]))
        fits = _fits(functions, panels)
        size = np.maximum(size, np.abs(fits).sum(axis=-1).max(axis=0))
        rough = _rough(fits, panels, size, span)
        done.append(panels[~rough])
        found.append(fits[~rough])
        middle = panels[rough].mean(axis=1, keepdims=True)
        halves = np.concatenate([panels[rough, :1], middle, middle, panels[rough, 1:]], axis=1)
        panels = halves.reshape(-1, 2)
    panels, fits = np.concatenate(done), np.concatenate(found)
    order = np.argsort(panels[:, 0])
    fits[np.abs(fits) < 0.1 * SMALL * size[:, None]] = 0.0
    return np.append(panels[order, 0], edges[-1]), fits[order]


def _rough(fits: np.ndarray, panels: np.ndarray, size: np.ndarray, span: float) -> np.ndarray:
    """Return whether functions are no polynomials to rounding on each panel of a run of some length (s)."""
    times = np.maximum(np.abs(panels).max(axis=1), span)  # a jump may be at the time 0
    allowed = SMALL + ROUNDED * times / (panels[:, 1] - panels[:, 0])
    last = np.abs(fits[..., -LAST:]).max(axis=-1)
    return np.asarray((last > allowed[:, None] * size).any(axis=1))


def _fits(functions: Sequence[Excitation], panels: np.ndarray) -> np.ndarray:
    """Return the coefficients of Chebyshev's polynomials, (panel, function, coefficient)."""
    times = panels[:, :1] + (panels[:, 1:] - panels[:, :1]) * _NODES
    values = np.stack([item.call("force", times) for item in functions], axis=1)
    if not np.isfinite(values).all():
        panel, function, node = np.argwhere(~np.isfinite(values))[0]
        raise InvalidInput(
            f"The force of {functions[function]!r} is {values[panel, function, node]:g} at {times[panel, node]:g} s."
        )
    return np.asarray(values @ _transforms()[0].T)


def breaks_of(excitation: Excitation) -> list[tuple[np.ndarray, bool]]:
    """Return the times at which a given force, and what it multiplies, is not smooth, and whether they repeat."""
    if isinstance(excitation, SampledForce):
        return [(np.asarray(excitation.times, dtype=float), excitation.repeats)]
    if isinstance(excitation, ModulatedForce):
        return [(np.asarray(excitation.times, dtype=float), False), *breaks_of(excitation.carrier)]
    return [(np.array(excitation.acts_between), False)]


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
