"""Near returns: where paths come back near to themselves, from which orbits are looked for."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from impactlab.analysis.described import states_in
from impactlab.analysis.itineraries import without_drift
from impactlab.analysis.orbit import Base, Orbit, OrbitMethod, along
from impactlab.assembly.model import Model
from impactlab.errors import InvalidInput, NoOrbit
from impactlab.plan.start import start_of
from impactlab.results.dataset import configuration_of

STARTS = 64
"""Random starts of a search."""

POWERS_OF_TEN = 1.2
"""Powers of ten between velocities of random starts, from those of the motion that begins at rest on."""

SETTLING = 200
"""Periods over which paths are followed, in which they settle."""

RETURNS = 6
"""Near returns of a path from which orbits are looked for."""

SAME_ORBIT = 1e-6
"""Distance of orbits that are one, as a part of their sizes."""

SETTLED_PATH = 1e-5
"""Distance at which a path counts as settled, as a part of its size."""

NO_MOTION = 1e-6
"""Size of a motion, as a part of that of its path from the start on, up to which it is a rest."""

OPEN_BY = 1e-6
"""Distance from itself at which an orbit counts as found, as a part of its size and of its growth."""

TOLD = 4
"""Rests that are told of, and displacements of each."""

LOOKS_OF_CROSSING = 64
"""Looks at a path in a slow natural period, to see where it crosses its mean."""


class Return(NamedTuple):
    """A state to which a path comes back."""

    distance: float  # as a part of the size of the motion
    number: int  # of periods, or of crossings
    period: float  # (s)
    state: np.ndarray
    begin: np.ndarray  # where the path began
    extent: np.ndarray  # (2 body,) of the path: how far it goes, the same for all displacements, and for all velocities


class Returns(NamedTuple):
    """Where paths come back near to themselves, or to rest."""

    near: list[Return]  # the nearest ones first
    rests: list[np.ndarray]  # states, (2 body,), of paths that come to rest where nothing varies in time


def starts_of(
    method: OrbitMethod, values: np.ndarray, start: xr.Dataset | str | None, base: Base, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return states where paths begin, (lane, 2 body), and when (s), at most a period before the time 0."""
    size, period = len(method.sizes), base.period
    if isinstance(start, xr.Dataset):
        states, times = states_in(start, method)
        begins = times - np.ceil(times / period - 1e-12) * period
        return states, begins if base.wave >= 0 else np.zeros(len(states))
    if start not in (None, "search"):
        raise InvalidInput(f'start is a result, orbits, "search" or None, not {start!r}.')
    rest = method.at_rest(values)[None]
    if start is None and base.wave >= 0:
        return rest, np.zeros(1)
    path = method.sampled(rest, values, np.zeros(1), np.linspace(0.0, 20.0 * period, 321))[0]
    spread, room = np.nanmax(np.abs(path - rest), axis=0).reshape(2, -1), method.room(values)
    room = room or float(spread[0].max()) or 1.0
    least = np.array([[room], [2.0 * math.pi * room / period]])
    spread = np.maximum(np.maximum(spread, 0.1 * spread.max(axis=1, keepdims=True)), least)
    random, more = np.random.default_rng(seed), STARTS - 1 if start == "search" else 1
    shares = random.uniform(-1.0, 1.0, (more, 2, size // 2))
    shares[:, 1] *= 10.0 ** random.uniform(0.0, POWERS_OF_TEN, (more, 1))
    return np.concatenate([rest, rest + (spread * shares).reshape(-1, size)]), np.zeros(more + 1)


def given_states(model: Model, initial: Mapping[str, Any]) -> np.ndarray:
    """Return given states of the bodies, (start, 2 body)."""
    given = start_of(initial, model)
    if isinstance(given, str):
        raise InvalidInput(f'initial must be {{"displacement": {{name: value}}, …}}, not {initial!r}.')
    return np.concatenate(given[:, model.bodies.free].transpose(0, 2, 1), axis=1)


def returns_of(
    method: OrbitMethod, values: np.ndarray, states: np.ndarray, begins: np.ndarray, base: Base, periods: int
) -> Returns:
    """Return states at the time 0 near which there may be orbits."""
    number, looks = SETTLING + periods, 1 if base.wave >= 0 else LOOKS_OF_CROSSING
    times, result, rests = base.period / looks * np.arange(number * looks), list[Return](), list[np.ndarray]()
    paths = method.sampled(states, values, begins, times)
    for path, begin in zip(paths, states, strict=True):
        if not np.isfinite(path).all():
            continue
        path = without_drift(path, method.drift)
        if base.wave >= 0:
            result += _strobed(path, begin, base.period, periods)
        elif is_still(path[-looks * (periods + 1) :], extent_of(path)) or _dies_away(path):
            rests.append(path[-looks:].mean(axis=0))
        else:
            result += _crossed(path, times, begin, periods)
    return Returns(sorted(result, key=lambda item: item.distance), rests)


def extent_of(path: np.ndarray) -> np.ndarray:
    """Return how far a path of states goes, (2 body,)."""
    ends = np.ptp(path, axis=0).reshape(2, -1).max(axis=1)
    return np.repeat(ends, path.shape[1] // 2)


def is_still(path: np.ndarray, extent: np.ndarray) -> bool:
    """Whether a path of states does not move, beside a path of this extent."""
    return bool((np.ptp(path, axis=0) <= NO_MOTION * extent).all())


def sizes_along(path: np.ndarray) -> np.ndarray:
    """Return the sizes by which distances of states of a path are measured."""
    size: np.ndarray = np.maximum(np.abs(path - path.mean(axis=0)).max(axis=0), 1e-12 * np.abs(path).max())
    halves = np.abs(path).reshape(len(path), 2, -1).max(axis=(0, 2))
    size = np.maximum(size, 1e-3 * halves.repeat(path.shape[1] // 2))
    size[size == 0.0] = 1.0
    return size


def _dies_away(path: np.ndarray) -> bool:
    """Whether a path loses half of its motion, or more, from its third quarter to its last one."""
    third, last = (extent_of(part) for part in np.array_split(path, 4)[2:])
    return bool((last <= 0.5 * third).all())


def _strobed(path: np.ndarray, begin: np.ndarray, period: float, periods: int) -> list[Return]:
    """Return the nearest returns of a path of states at one phase, of each number of periods."""
    size, extent, result = sizes_along(path), extent_of(path), list[Return]()
    for count in range(1, periods + 1):
        apart = np.abs((path[count:] - path[:-count]) / size).max(axis=1)
        if apart[-1] < SETTLED_PATH:  # an attractor
            return [Return(float(apart[-1]), count, count * period, path[-1], begin, extent)]
        for place in np.argsort(apart)[:RETURNS]:
            result.append(Return(float(apart[place]), count, count * period, path[place], begin, extent))
    return sorted(result, key=lambda item: item.distance)[:RETURNS]


def _crossed(path: np.ndarray, times: np.ndarray, begin: np.ndarray, periods: int) -> list[Return]:
    """Return the nearest returns of a path where the displacement that moves most crosses its mean upwards."""
    late, half = path[len(path) // 2 :], path.shape[1] // 2
    body = int(late[:, :half].std(axis=0).argmax())
    above = late[:, body] - late[:, body].mean()
    places = np.flatnonzero((above[:-1] <= 0.0) & (above[1:] > 0.0))
    if len(places) <= 1:
        return []
    shares = above[places] / (above[places] - above[places + 1])
    met = late[places] + shares[:, None] * (late[places + 1] - late[places])
    when, size, result = times[places] + shares * (times[1] - times[0]), sizes_along(late), list[Return]()
    extent = extent_of(path)
    for count in range(1, min(periods, len(met) - 1) + 1):
        apart = np.abs((met[count:] - met[:-count]) / size).max(axis=1)
        place = int(apart.argmin())
        length = float(when[place + count] - when[place])
        result.append(Return(float(apart[place]), count, length, met[place], begin, extent))
    return sorted(result, key=lambda item: item.distance)


def orbit_near(method: OrbitMethod, values: np.ndarray, item: Return, base: Base) -> Orbit | str:
    """Return the orbit near a return, with the shortest period that it has, or why there is none."""
    found = method.near(
        item.state, values, item.period, (base.wave, item.number * base.cycles), NO_MOTION * item.extent
    )
    if isinstance(found, str):
        return found
    length = float(found.unknowns[-1 - len(values)])
    path = without_drift(along(method, found, length / item.number * np.arange(item.number + 1)), method.drift)
    apart = np.abs((path - path[0]) / method.sizes).max(axis=1)
    if base.wave < 0:
        around = along(method, found, length * np.linspace(0.0, 1.0, LOOKS_OF_CROSSING + 1))
        if length < 0.5 * item.period or is_still(without_drift(around, method.drift), item.extent):
            return "Newton's method leads to rest"
    for count in range(1, item.number):
        if item.number % count == 0 and apart[count] < SAME_ORBIT:
            shorter = Return(0.0, count, count * length / item.number, path[0], item.begin, item.extent)
            return orbit_near(method, values, shorter, base)
    growth = max(1.0, float(np.abs(found.monodromy).max()))
    return found if apart[-1] < OPEN_BY * growth else "the path of what Newton's method finds is not closed"


def is_same(method: OrbitMethod, one: Orbit, other: Orbit, base: Base) -> bool:
    """Whether two orbits are one, which may begin some periods later."""
    lengths = [float(item.unknowns[-1 - method.parameters]) for item in (one, other)]
    if abs(lengths[0] - lengths[1]) > SAME_ORBIT * lengths[0]:
        return False
    if base.wave < 0:
        return bool(abs(np.trace(one.monodromy) - np.trace(other.monodromy)) < SAME_ORBIT * np.abs(one.monodromy).max())
    path = along(method, one, base.period * np.arange(round(lengths[0] / base.period) + 1))
    path, state = (without_drift(item, method.drift) for item in (path, other.unknowns[: len(method.sizes)]))
    return bool((np.abs((path - state) / method.sizes).max(axis=1) < SAME_ORBIT).any())


def told(method: OrbitMethod, returns: Returns, misses: Sequence[str], paths: int, periods: int, period: float) -> str:
    """Say what was tried where no orbit was found."""
    tried = f"{paths} path{'s' * (paths > 1)} of {SETTLING} periods of {period:.6g} s"
    if returns.rests and not returns.near:
        return (
            f"No orbit was found: {len(returns.rests)} of {tried} came to rest, at {_rests(method, returns.rests)}. "
            "Nothing varies in time, and a rest has no period: il.lyapunov tells how fast motions die away there."
        )
    if not returns.near:
        why = f" {misses[0]}" if misses else ""
        return f"No orbit was found: none of {tried} could be followed and came back.{why}"
    best = returns.near[0]
    state, begin = (", ".join(f"{value:.6g}" for value in item) for item in (best.state, best.begin))
    return (
        f"No orbit of up to {periods} periods was found from {tried}: the nearest return, after {best.number}, is "
        f"{best.distance:.2g} of the motion away from the state ({state}), on the path from ({begin}), and near it "
        f'{misses[0]}. Give more periods=, start="search", or a start near the orbit.'
    )


def _rests(method: OrbitMethod, rests: Sequence[np.ndarray]) -> str:
    """Return the displacements of some different rests in words."""
    half = len(method.bodies)
    different = {tuple(f"{value + 0.0:.4g}" for value in np.round(item[:half], 12)) for item in rests}
    texts = [
        ", ".join(f"{name} = {value} m" for name, value in zip(method.bodies[:TOLD], item, strict=False))
        for item in sorted(different)
    ]
    return " or ".join(texts[:TOLD]) + ", …" * (len(texts) > TOLD or half > TOLD)


def orbit_again(method: OrbitMethod, orbit: xr.Dataset, values: np.ndarray) -> Orbit:
    """Return the orbit of a dataset as the method finds it."""
    states, times = states_in(orbit, method)
    period, force = float(np.atleast_1d(orbit["period"].values)[0]), method.force(values)
    state, wave, cycles = states[0], -1, 0
    if force is not None:
        base, wave, of_base = force
        cycles = of_base * max(1, round(period / base))
        period = base * cycles / of_base
        begins = times - np.ceil(times / base - 1e-12) * base
        if begins[0] < 0.0:
            state = method.sampled(states, values, begins, np.array([0.0, base]))[0, 0]
    found = method.near(state, values, period, (wave, cycles))
    if isinstance(found, str):
        raise NoOrbit(f"The orbit is not found again: {found}.")
    return found


def one_configuration(orbit: xr.Dataset, does: str) -> Mapping[str, Any]:
    """Return the configuration of a dataset of one orbit, or refuse what is none."""
    if not isinstance(orbit, xr.Dataset) or "section_time" not in orbit:
        raise InvalidInput(f"{does} an orbit that il.orbits returned, not {orbit!r}.")
    if orbit["period"].size != 1:
        raise InvalidInput(
            f"There are {orbit['period'].size} orbits: give one of them, such as orbits.isel(orbit=[0])."
        )
    return configuration_of(orbit)
