"""Beams from their length, stiffness and supports, as structures with the modes of Euler and Bernoulli."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from impactlab.components.matrices import ZERO
from impactlab.components.modal_structure import ModalStructure
from impactlab.errors import InvalidInput
from impactlab.inputs import checked, positive

_CLAMPED, _PINNED, _FREE = (0, 1), (0, 2), (2, 3)
"""Ends by the derivatives of the displacement that vanish there."""

_SUPPORTS = {
    "cantilever": (_CLAMPED, _FREE),
    "pinned-pinned": (_PINNED, _PINNED),
    "clamped-clamped": (_CLAMPED, _CLAMPED),
    "clamped-pinned": (_CLAMPED, _PINNED),
}

_MOST_MODES = 100
"""Modes up to which the frequencies and shapes have been looked at; higher ones feel the shear that is left out."""


@checked
def beam(
    length: float,
    bending_stiffness: float,
    mass_per_length: float,
    *,
    supports: str,
    modes: int,
    damping_ratios: float | Sequence[float],
    points: Mapping[str, float],
) -> ModalStructure:
    """Return a uniform slender beam or tube by its lowest bending modes.

    The theory is that of Euler and Bernoulli: ``EI w'''' + μ w'' = forces``, S. S. Rao, Vibration of Continuous Systems
    (2007), chapter 11; modal masses are 1. With `BaseMotion` all supports move together. Shear and the inertia of
    rotation are left out, which matters where the wavelength of a mode, ``2 L/n`` or so, is not much larger than the
    depth.

    Parameters
    ----------
    length : float
        Length L (m).
    bending_stiffness : float
        Modulus of elasticity times second moment of area, EI (N m2); of a tube with the diameters D and d it is
        ``E π (D⁴ − d⁴)/64``.
    mass_per_length : float
        Mass per length μ (kg m-1), with that of a fluid that moves along.
    supports : str
        "cantilever", clamped at 0 and free at L; "pinned-pinned"; "clamped-clamped"; or "clamped-pinned".
    modes : int
        How many modes are kept, up to 100.
    damping_ratios : float or sequence of float
        Ratio of the damping of each mode, or of all, to the critical one.
    points : mapping of str to float
        Distance of named points from the end at 0 (m).

    Returns
    -------
    ModalStructure

    Raises
    ------
    InvalidInput
        If a number is not positive, supports are not known, or a point is not on the beam or cannot move.

    Examples
    --------
    >>> tube = il.beam(1.0, 1.0, 1.0, supports="cantilever", modes=2, damping_ratios=0.01, points={"tip": 1.0})
    >>> np.round(tube.natural_frequencies, 2)
    array([ 3.52, 22.03])
    """
    span = positive("beam: length", length, "m")
    stiffness = positive("beam: bending_stiffness", bending_stiffness, "N m2")
    mass = positive("beam: mass_per_length", mass_per_length, "kg m-1")
    if supports not in _SUPPORTS:
        raise InvalidInput(
            f"beam: supports must be one of {', '.join(map(repr, _SUPPORTS))}, not {supports!r}. Modes of a free beam "
            "that do not bend have no frequency; give such a beam by its matrices, il.LinearStructure."
        )
    if not 1 <= modes <= _MOST_MODES:
        raise InvalidInput(f"beam: modes must be a whole number from 1 to {_MOST_MODES}, not {modes!r}.")
    places = {name: _place(name, place, span) for name, place in points.items()}
    roots = [_root(supports, number) for number in range(1, modes + 1)]
    found = [_shape(root, *_SUPPORTS[supports], np.array([*places.values()])) for root in roots]
    means, rows = np.array([mean for _, mean in found]), np.array([row for row, _ in found]).T
    for numbers in (means, rows):
        numbers[np.abs(numbers) < ZERO] = 0.0
    for name, row in zip(places, rows, strict=True):
        if not row.any():
            raise InvalidInput(f"beam: point {name!r} at {points[name]!r} m does not move in any of the {modes} modes.")
    root_of_mass = math.sqrt(mass * span)
    shapes = {name: tuple((row / root_of_mass).tolist()) for name, row in zip(places, rows, strict=True)}
    frequencies = [(root / span) ** 2 * math.sqrt(stiffness / mass) for root in roots]
    participation = (root_of_mass * means).tolist()
    return ModalStructure(tuple(frequencies), damping_ratios, points=shapes, participation=participation)


def _place(name: str, given: float, length: float) -> float:
    if not 0.0 <= given <= length:
        raise InvalidInput(f"beam: point {name!r} must be on the beam, from 0 to {length:g} m, not at {given!r} m.")
    return given / length


def _root(supports: str, number: int) -> float:
    """Return βL of a mode: the root of its characteristic equation, solved for a small angle beside a multiple of π/4.

    ``cos βL cosh βL`` is −1 of a cantilever and 1 of a beam with two clamped ends; ``tan βL = tanh βL`` if one of these
    is pinned.
    """
    if supports == "pinned-pinned":
        return number * math.pi
    if supports == "clamped-pinned":
        return _fixed(number * math.pi, lambda b: math.atan(math.tanh(b)))
    middle = (number - 0.5 if supports == "cantilever" else number + 0.5) * math.pi
    sign = 1.0 if number % 2 else -1.0
    return _fixed(middle, lambda b: sign * math.asin(1.0 / math.cosh(b)))


def _fixed(begin: float, beyond: Callable[[float], float]) -> float:
    """Return b of ``b = begin + beyond(b)``, where what is beyond changes by less than a third of b."""
    b = begin
    for _ in range(40):
        b = begin + beyond(b)
    return b


def _shape(root: float, first: tuple[int, int], last: tuple[int, int], places: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the displacements of a mode at parts of the length, and their mean.

    Their mean square is 1, and they begin upwards.

    It is a sum of a cosine, a sine and two exponentials that decay from either end, so that nothing large cancels.
    """

    def terms(order: int, place: np.ndarray | float) -> np.ndarray:
        """Return the derivatives of the four by β x, (term, place)."""
        angle, sign = root * np.asarray(place), (-1.0) ** order
        cosine, sine = np.cos(angle), np.sin(angle)
        turned = ((cosine, sine), (-sine, cosine), (-cosine, -sine), (sine, -cosine))[order]
        return np.array([*turned, sign * np.exp(-angle), np.exp(angle - root)])

    conditions = np.array([*(terms(order, 0.0) for order in first), *(terms(order, 1.0) for order in last)])
    weights = np.linalg.svd(conditions)[2][-1]
    ends = [float(weights @ terms(order, 1.0)) for order in range(4)]
    square = 0.25 * (ends[0] ** 2 - 2.0 * ends[1] * ends[3] + ends[2] ** 2)
    begins = next(order for order in (1, 2) if order not in first)
    weights *= math.copysign(1.0, float(weights @ terms(begins, 0.0))) / math.sqrt(square)
    mean = float(weights @ (terms(3, 1.0) - terms(3, 0.0))) / root  # since the fourth derivative is φ again
    return np.asarray(weights @ terms(0, places)), mean
