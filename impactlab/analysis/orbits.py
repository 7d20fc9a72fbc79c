"""Periodic orbits of a network, found from paths that come back near to themselves."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr

from impactlab.analysis.described import described, states_in
from impactlab.analysis.itineraries import without_drift
from impactlab.analysis.linear_orbits import LinearOrbits
from impactlab.analysis.mapped_orbits import MappedOrbits
from impactlab.analysis.orbit import Orbit, OrbitMethod, along
from impactlab.assembly.model import Model
from impactlab.components.stored import stored
from impactlab.errors import InvalidInput, NoOrbit
from impactlab.located.event_located import EventLocated, check, linear_between_events
from impactlab.located.families import Family
from impactlab.networks.network import Network
from impactlab.progress import reporter
from impactlab.records.surface import Strobe, Surface

STARTS = 64
"""Random starts of a search."""

WIDEST = 1.2
"""Powers of ten between velocities of random starts, from those of the motion that begins at rest on."""

LENGTH = 200
"""Periods of the force over which paths are followed, in which they settle."""

RETURNS = 6
"""Near returns of a path from which orbits are looked for."""

SAME = 1e-6
"""Distance of orbits that are one, as a part of their sizes."""

SETTLED = 1e-5
"""Distance at which a path counts as settled, as a part of its size."""

STROBED = 1e-9
"""Part of a period by which a section may miss that of the force."""

CLOSED = 1e-6
"""Distance from itself at which an orbit counts as found, as a part of its size and of its growth."""


class Return(NamedTuple):
    """A state to which a path comes back after some periods."""

    distance: float  # as a part of the size of the motion
    periods: int
    state: np.ndarray


def orbits(
    network: Network,
    section: Surface | None = None,
    start: xr.Dataset | str | None = None,
    *,
    periods: int = 4,
    seed: int = 0,
    progress: bool | Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Return periodic orbits of a network in which nothing is random, stable and unstable ones, with their multipliers.

    An orbit is looked for where a path comes back near to itself, by Newton's method: on the state and the times of all
    events, where the motion is linear between these, else on the map of states over a period.

    Parameters
    ----------
    network : Network
        Its forces have one period, or none: then the period of the orbit is found, too.
    section : Strobe, AtContact or Crossing, optional
        Where the state of an orbit is told: at the beginning of a period of the force by default. The period of a
        `Strobe` is a whole number of periods of the force, and orbits are looked for that take some of its periods.
    start : Dataset or str, optional
        Where the path begins: the end of a result with `FinalState` or `Trajectory`; the orbits that `orbits` found for
        a network like this one; or "search", many random starts, which find orbits beside each other. At rest by
        default.
    periods : int
        How many periods an orbit takes at most.
    seed : int
        Of the random starts.
    progress : bool or callable, optional
        As for `simulate`.

    Returns
    -------
    xarray.Dataset
        Along ``orbit``: ``period`` (s) and ``periods`` of the force, ``displacement`` and ``velocity`` on the section
        and its ``section_time`` (s), ``multiplier_real`` and ``multiplier_imag``, whether it is ``stable``, the events
        of a period in order, ``event_time`` (s), ``event_contact``, ``event_kind`` and ``closing_velocity`` (m s-1),
        the number of ``impacts``, the ``energy_lost`` in a period (J), the ``closure``, the distance between both ends
        of the path over a period as a part of its size, and the path, ``path_displacement`` and ``path_velocity``
        along ``phase``.

    Raises
    ------
    InvalidInput
        If the network or an option cannot be used, or the section is never crossed.
    NoOrbit
        If no orbit is found; the message tells the nearest return.
    """
    options = {"periods": periods, "seed": seed, "start": start if isinstance(start, str) else None}
    method, values = method_of(network), np.zeros(1)
    base = _base(method, values, section)
    if not (isinstance(periods, int) and periods > 0):
        raise InvalidInput(f"periods is a number of periods, 1 or more, not {periods!r}.")
    show = reporter(progress)
    states, begins = _starts(method, values, start, base[0], seed)
    found, misses = list[Orbit](), list[str]()
    known = _periods_of(start, base[0])
    returns = _returns(method, values, states, begins, base[0], periods, known)
    for number, item in enumerate(returns):
        show(number / len(returns))
        outcome = _near(method, values, item, base)
        if isinstance(outcome, str):
            misses.append(outcome)
        elif not any(_is_same(method, values, outcome, other, base[0]) for other in found):
            found.append(outcome)
        if found and start != "search" and known is None:
            break
    show(1.0)
    if not found:
        raise NoOrbit(_not_found(returns, misses, len(states), periods, base[0]))
    found.sort(key=lambda item: float(item.unknowns[-2]))
    return described(method, found, section, {"network": stored(network), "orbits": options}, base[0])


def method_of(network: Network) -> LinearOrbits | MappedOrbits:
    """Return what finds the orbits of a network, or refuse it."""
    if not isinstance(network, Network):
        raise InvalidInput(f"orbits takes an il.Network, not {network!r}.")
    model = Model.of(network)
    if model.random.any():
        name = np.array(model.bodies.names)[model.random][0] if len(model.random) == len(model.bodies) else "it"
        raise InvalidInput(
            f"Random forces act on {name!r}: orbits are those of a network in which nothing is random. Leave them out, "
            "and give the network with them to il.orbit_spread."
        )
    check(model, EventLocated())
    if linear_between_events(model) and LinearOrbits.knows(model):
        return LinearOrbits(Family.alone(model))
    return MappedOrbits.of(network)


def _base(method: OrbitMethod, values: np.ndarray, section: Surface | None) -> tuple[float, int, int]:
    """Return the period of which orbits take a whole number (s), a wave and its cycles in it; 0, −1 and 0 for none."""
    force = method.force(values)
    if not isinstance(section, Strobe):
        return force or (0.0, -1, 0)
    if force is None:
        raise InvalidInput("Nothing varies in time: il.Strobe tells no phase; use il.AtContact or il.Crossing.")
    period, wave, cycles = force
    times = round(section.period / period)
    if times < 1 or abs(section.period - times * period) > STROBED * section.period:
        raise InvalidInput(
            f"The period of {section!r} is {section.period / period:.9g} times that of the force, {period:.12g} s, but "
            "must be a whole number of these."
        )
    return times * period, wave, times * cycles


def _periods_of(start: xr.Dataset | str | None, base: float) -> list[int] | None:
    """Return how many periods of the force orbits take, None of another start."""
    if not isinstance(start, xr.Dataset) or "section_time" not in start:
        return None
    return [max(1, round(float(period) / base)) for period in np.atleast_1d(start["period"].values)]


def _starts(
    method: OrbitMethod, values: np.ndarray, start: xr.Dataset | str | None, period: float, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return states where paths begin, (lane, 2 body), and when (s), at most a period before the time 0."""
    size = len(method.sizes)
    if isinstance(start, xr.Dataset):
        states, times = states_in(start, method)
        return states, times - np.ceil(times / period - 1e-12) * period
    if start not in (None, "search"):
        raise InvalidInput(f'start is a result, orbits, "search" or None, not {start!r}.')
    rest = method.at_rest(values)[None]
    if start is None:
        return rest, np.zeros(1)
    path = method.sampled(rest, values, np.zeros(1), np.linspace(0.0, 20.0 * period, 321))[0]
    spread = np.nanmax(np.abs(path - rest), axis=0).reshape(2, -1)
    room = method.room(values)
    spread = np.maximum(
        np.maximum(spread, 0.1 * spread.max(axis=1, keepdims=True)), [[room], [room * 2.0 * math.pi / period]]
    )
    random = np.random.default_rng(seed)
    shares = random.uniform(-1.0, 1.0, (STARTS - 1, 2, size // 2))
    shares[:, 1] *= 10.0 ** random.uniform(0.0, WIDEST, (STARTS - 1, 1))
    return np.concatenate([rest, rest + (spread * shares).reshape(-1, size)]), np.zeros(STARTS)


def _returns(
    method: OrbitMethod, values: np.ndarray, states: np.ndarray, begins: np.ndarray, base: float, periods: int,
    found: Sequence[int] | None,
) -> list[Return]:  # fmt: skip
    """Return states at the time 0 near which there may be orbits: those to which paths come back.

    Of orbits that are `found`, with the periods that they take, these are the states.
    """
    if found is not None:
        paths = method.sampled(states, values, begins, np.array([0.0, base]))
        return [Return(0.0, count, path[0]) for count, path in zip(found, paths, strict=True)]
    paths, result = method.sampled(states, values, begins, base * np.arange(LENGTH + periods)), list[Return]()
    for path in paths[np.isfinite(paths).all(axis=(1, 2))]:
        result += _near_returns(without_drift(path, method.drift), periods)
    return sorted(result, key=lambda item: item.distance)


def _near_returns(path: np.ndarray, periods: int) -> list[Return]:
    """Return the nearest returns of a path of states at one phase, of each number of periods."""
    size = np.maximum(np.abs(path - path.mean(axis=0)).max(axis=0), 1e-12 * np.abs(path).max())
    size = np.maximum(size, 1e-3 * np.abs(path).reshape(len(path), 2, -1).max(axis=(0, 2)).repeat(path.shape[1] // 2))
    size[size == 0.0] = 1.0
    result = list[Return]()
    for count in range(1, periods + 1):
        apart = np.abs((path[count:] - path[:-count]) / size).max(axis=1)
        if apart[-1] < SETTLED:  # an attractor
            return [Return(float(apart[-1]), count, path[-1])]
        for place in np.argsort(apart)[:RETURNS]:
            result.append(Return(float(apart[place]), count, path[place]))
    return sorted(result, key=lambda item: item.distance)[:RETURNS]


def _near(method: OrbitMethod, values: np.ndarray, item: Return, base: tuple[float, int, int]) -> Orbit | str:
    """Return the orbit near a return, with the shortest period that it has, or why there is none."""
    period, wave, cycles = base
    found = method.near(item.state, values, item.periods * period, (wave, item.periods * cycles))
    if isinstance(found, str):
        return found
    path = without_drift(along(method, found, period * np.arange(item.periods + 1)), method.drift)
    apart = np.abs((path - path[0]) / method.sizes).max(axis=1)
    for count in range(1, item.periods):
        if item.periods % count == 0 and apart[count] < SAME:
            return _near(method, values, Return(0.0, count, path[0]), base)
    growth = max(1.0, float(np.abs(found.monodromy).max()))
    return found if apart[-1] < CLOSED * growth else "the path of what Newton's method finds is not closed"


def _is_same(method: OrbitMethod, values: np.ndarray, one: Orbit, other: Orbit, base: float) -> bool:
    """Whether two orbits are one, which may begin some periods later."""
    size = len(method.sizes)
    length, periods = one.unknowns[-1 - len(values)], round(one.unknowns[-1 - len(values)] / base)
    if abs(length - other.unknowns[-1 - len(values)]) > SAME * length:
        return False
    path = along(method, one, base * np.arange(periods + 1))
    path, state = (without_drift(item, method.drift) for item in (path, other.unknowns[:size]))
    return bool((np.abs((path - state) / method.sizes).max(axis=1) < SAME).any())


def _not_found(returns: Sequence[Return], misses: Sequence[str], paths: int, periods: int, base: float) -> str:
    """Say what was tried."""
    tried = f"{paths} path{'s' * (paths > 1)} of {LENGTH} periods of {base:.6g} s"
    if not returns:
        return f"No orbit was found: none of {tried} could be followed."
    best = returns[0]
    state = ", ".join(f"{value:.6g}" for value in best.state)
    return (
        f"No orbit of up to {periods} periods was found from {tried}: the nearest return, after {best.periods}, is "
        f"{best.distance:.2g} of the motion away from the state ({state}), and near it {misses[0]}. Give more "
        'periods=, start="search", or a start near the orbit.'
    )
