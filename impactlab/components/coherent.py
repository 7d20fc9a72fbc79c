"""Noises whose correlation falls with the distance and the frequency: wind on a facade, waves in the ground."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from impactlab.components.component import SHOWN
from impactlab.components.correlated import driving_by
from impactlab.components.excitation import BaseMotion, Excitation, Source
from impactlab.components.fields import parameter
from impactlab.components.sampled_rows import take_samples
from impactlab.errors import InvalidInput
from impactlab.inputs import checked, finite, positive, shown

Coherence = Callable[[np.ndarray, float], Any]
"""Coherences at angular frequencies (rad s-1), of two places at some distance (m)."""


class SharedCosines(Excitation):
    """A sum of cosines whose random phases φ others have, too: ``Σ A_n cos(ω_n t + ψ_n + φ_n)``; see `coherent`.

    Parameters
    ----------
    frequencies : (line,) array_like
        Increasing angular frequencies (rad s-1).
    amplitudes : (line,) array_like
        Amplitudes A (N).
    shifts : (line,) array_like
        Differences ψ of the phases (rad).
    phases : str
        Name of the random phases; those of one name have the same frequencies.
    repeats_after : float
        Time after which the sum repeats and a longer run is refused (s).

    Examples
    --------
    >>> il.SharedCosines((1.0, 2.0), (0.5, 0.3), (0.0, 0.0), phases="gusts")
    SharedCosines(frequencies=(1.0, 2.0), amplitudes=(0.5, 0.3), shifts=(0.0, 0.0), phases='gusts')
    """

    frequencies: Sequence[float] | np.ndarray = parameter(units="rad s-1", kw_only=False)
    amplitudes: Sequence[float] | np.ndarray = parameter(units="N", kw_only=False)
    shifts: Sequence[float] | np.ndarray = parameter(units="rad", kw_only=False)
    phases: str = parameter(kw_only=False)
    repeats_after: float | None = parameter(None, units="s")

    def __post_init__(self) -> None:
        for name in ("amplitudes", "shifts"):
            take_samples(self, name, of="frequencies")
        super().__post_init__()

    def __repr__(self) -> str:
        count = len(self.frequencies)
        return super().__repr__() if count <= SHOWN else f"SharedCosines of {count} lines, {self.phases!r}"

    @property
    def phases_of(self) -> str | None:
        return self.phases

    @property
    def period(self) -> float:
        return math.inf if self.repeats_after is None else self.repeats_after

    def lines(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the angular frequencies (rad s-1) and the complex amplitudes (N) of the cosines."""
        return np.array(self.frequencies), np.array(self.amplitudes) * np.exp(1j * np.array(self.shifts))


@checked
def coherent(
    noise: Excitation | BaseMotion,
    positions: Mapping[str, Any],
    coherence: Coherence,
    *,
    wave_speed: float | None = None,
    name: str = "noise",
) -> dict[str, Source | BaseMotion]:
    """Return noises of one spectrum at several places, for ``excitations=`` of a network.

    The cross-spectral density of two places j and k is ``S(ω) γ(ω, d_jk) exp(iω(x_j − x_k)/c)``, with a coherence γ of
    the distance d and, if there is a speed c, waves that pass along the first coordinate. At each frequency the matrix
    of the coherences is a product ``L Lᵀ``, and each column of L has random phases of its own (Shinozuka, J. Sound Vib.
    25, 1972, 111; Deodatis, J. Eng. Mech. 122, 1996, 778).

    An `impactlab.BaseMotion` in the place of the noise is the acceleration of the ground below each body or structure.
    Displacements are then relative to the ground at the place of each; see there.

    Parameters
    ----------
    noise : TabulatedNoise, ShinozukaNoise or another sum of cosines, or BaseMotion
        Its spectral density is that at each place. The table of filtered noise is
        ``il.TabulatedNoise(frequencies, noise.density(frequencies))``.
    positions : mapping of str to float or sequence of float
        Place of each body, or point of a structure, on a line or by coordinates (m); of what is on the ground, with a
        `BaseMotion`.
    coherence : callable
        Coherences γ from -1 to 1 at angular frequencies, (frequency,) (rad s-1), of two places at a distance (m), such
        as :func:`davenport` and :func:`harichandran_vanmarcke` return.
    wave_speed : float, optional
        Apparent speed c of waves along the first coordinate (m s-1): they come later where it is larger, or earlier if
        the speed is negative. By default no wave passes.
    name : str
        The sources are called by it, a number and the body, such as "noise 1 left".

    Returns
    -------
    dict of str to Source or BaseMotion

    Raises
    ------
    InvalidInput
        If the noise is no sum of cosines, positions are no numbers, or a matrix of coherences has a negative
        eigenvalue; the message tells the frequency.

    Examples
    --------
    >>> gusts = il.TabulatedNoise([0.5, 2.0, 12.0], [0.3, 0.1, 0.0], components=100)
    >>> sources = il.coherent(gusts, {"left": 0.0, "right": 15.0}, il.davenport(8.0, speed=20.0))
    >>> list(sources)
    ['noise 1 left', 'noise 1 right', 'noise 2 right']
    """
    kind, given = driving_by("coherent", noise)
    if not isinstance(given, Excitation) or given.kind != "lines" or isinstance(given, SharedCosines):
        table = "; il.TabulatedNoise(frequencies, noise.density(frequencies)) is that of filtered noise"
        raise InvalidInput(
            f"coherent takes a sum of cosines such as il.TabulatedNoise, not {given!r}"
            f"{table if getattr(given, 'kind', '') == 'filter' else ''}."
        )
    places = _places(positions)
    speed = math.inf if wave_speed is None else finite("coherent: wave_speed", wave_speed)
    if not speed:
        raise InvalidInput("coherent: wave_speed must not be 0; leave it out where no wave passes.")
    frequencies, amplitudes = (np.asarray(part, dtype=float) for part in given.lines())  # type: ignore[attr-defined]
    roots = _roots(_matrices(frequencies, places, coherence), frequencies)
    bodies = list(positions)
    result: dict[str, Source | BaseMotion] = {}
    repeats = None if math.isinf(given.period) else given.period
    for number in range(len(bodies)):
        for row in range(number, len(bodies)):
            share = roots[:, row, number]
            if share.any():
                shifts = -frequencies * (places[row, 0] / speed)
                own = SharedCosines(
                    frequencies, amplitudes * share, shifts, f"{name} {number + 1}", repeats_after=repeats
                )  # fmt: skip
                result[f"{name} {number + 1} {bodies[row]}"] = kind(own, on=bodies[row])
    return result


@checked
def davenport(decay: float, speed: float) -> Coherence:
    """Return the coherence ``exp(−C |ω| d/(2π U))`` of gusts (Davenport, Q. J. R. Meteorol. Soc. 87, 1961, 194).

    Parameters
    ----------
    decay : float
        Coefficient C, of about 10.
    speed : float
        Mean speed U of the wind (m s-1).

    Returns
    -------
    callable
        Coherences at angular frequencies (rad s-1), of two places at a distance (m).

    Examples
    --------
    >>> round(float(il.davenport(8.0, speed=20.0)(2 * np.pi, 1.0)), 4)
    0.6703
    """
    scale = _not_negative("davenport: decay", decay) / (2.0 * math.pi * positive("davenport: speed", speed, "m s-1"))
    return lambda frequencies, distance: np.exp(-scale * np.abs(frequencies) * distance)


@checked
def harichandran_vanmarcke(share: float, ratio: float, distance: float, frequency: float, exponent: float) -> Coherence:
    """Return the coherence of motions of the ground ``A exp(−2dB/(aθ)) + (1 − A) exp(−2dB/θ)``.

    ``B = 1 − A + aA`` and ``θ(ω) = k (1 + (ω/ω₀)^b)^(−1/2)`` (Harichandran and Vanmarcke, J. Eng. Mech. 112, 1986, 154:
    A = 0.736, a = 0.147, k = 5210 m, ω₀ = 2π · 1.09 rad/s and b = 2.78 for one earthquake).

    Parameters
    ----------
    share, ratio : float
        A, from 0 to 1, and a > 0.
    distance : float
        Scale k of the distances (m).
    frequency : float
        Angular frequency ω₀ (rad s-1).
    exponent : float
        Exponent b.

    Returns
    -------
    callable
        Coherences at angular frequencies (rad s-1), of two places at a distance (m).

    Examples
    --------
    >>> loss = il.harichandran_vanmarcke(0.736, 0.147, 5210.0, 6.85, 2.78)
    >>> round(float(loss(2 * np.pi, 100.0)), 4)
    0.9053
    """
    place = "harichandran_vanmarcke"
    if not 0.0 <= finite(f"{place}: share", share) <= 1.0:
        raise InvalidInput(f"{place}: share must be from 0 to 1, not {share!r}.")
    a, k = positive(f"{place}: ratio", ratio, ""), positive(f"{place}: distance", distance, "m")
    corner, b = positive(f"{place}: frequency", frequency, "rad s-1"), _not_negative(f"{place}: exponent", exponent)

    def coherence(frequencies: np.ndarray, apart: float) -> np.ndarray:
        times = 2.0 * apart * (1.0 - share + a * share) / k * np.sqrt(1.0 + (np.abs(frequencies) / corner) ** b)
        return np.asarray(share * np.exp(-times / a) + (1.0 - share) * np.exp(-times))

    return coherence


def _not_negative(place: str, value: float) -> float:
    number = finite(place, value)
    if number < 0.0:
        raise InvalidInput(f"{place} must be at least 0, not {value!r}.")
    return number


def _places(positions: Any) -> np.ndarray:
    """Return the coordinates of places, (place, coordinate) (m)."""
    if not isinstance(positions, Mapping) or not positions:
        raise InvalidInput(f"coherent: positions must be {{name of a body: place}}, not {shown(positions)}.")
    rows = [np.atleast_1d(np.asarray(place, dtype=object)) for place in positions.values()]
    if len({row.shape for row in rows}) > 1 or rows[0].ndim > 1:
        raise InvalidInput("coherent: positions must have as many coordinates each.")
    return np.array(
        [
            [finite(f"coherent: the position of {body!r}", x) for x in row]
            for body, row in zip(positions, rows, strict=True)
        ]
    )


def _matrices(frequencies: np.ndarray, places: np.ndarray, coherence: Coherence) -> np.ndarray:
    """Return the coherences of all pairs of places, (frequency, place, place)."""
    count = len(places)
    result = np.ones((len(frequencies), count, count))
    for row in range(count):
        for column in range(row):
            distance = float(np.linalg.norm(places[row] - places[column]))
            try:
                values = np.broadcast_to(np.asarray(coherence(frequencies, distance), dtype=float), frequencies.shape)
            except (TypeError, ValueError) as error:
                raise InvalidInput(
                    "coherent: coherence must return numbers for angular frequencies, (frequency,), and a distance: "
                    f"{error}."
                ) from error
            wrong = np.flatnonzero(~(np.abs(values) <= 1.0))
            if len(wrong):
                raise InvalidInput(
                    f"coherent: coherence must be from -1 to 1, but it is {values[wrong[0]]:g} at "
                    f"{frequencies[wrong[0]]:g} rad/s and {distance:g} m."
                )
            result[:, row, column] = result[:, column, row] = values
    return result


def _roots(matrices: np.ndarray, frequencies: np.ndarray) -> np.ndarray:
    """Return triangular matrices L of ``L Lᵀ`` = a matrix, or refuse one with a negative eigenvalue."""
    count = matrices.shape[1]
    lowest = np.linalg.eigvalsh(matrices)[:, 0]
    # a negative eigenvalue per body down to this is rounding
    wrong = np.flatnonzero(lowest < -1e-10 * count)
    if len(wrong):
        raise InvalidInput(
            f"coherent: no noises have these coherences at {frequencies[wrong[0]]:g} rad/s, where the lowest "
            f"eigenvalue of their matrix is {lowest[wrong[0]]:g}."
        )
    # eigenvalues per body below this would leave a negative pivot in the root, by rounding
    more = np.maximum(1e-14 * count - 2.0 * lowest, 0.0)[:, None, None]  # so that no pivot is negative
    return np.asarray(np.linalg.cholesky((matrices + more * np.eye(count)) / (1.0 + more)))
