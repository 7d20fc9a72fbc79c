"""Periodic orbits of a network, found from paths that come back near to themselves."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import xarray as xr

from impactlab.analysis.described import described, ends_of_diagram, start_of, stored_start
from impactlab.analysis.linear_orbits import method_of
from impactlab.analysis.near_returns import (
    Return,
    Returns,
    given_states,
    is_same,
    orbit_near,
    returns_of,
    starts_of,
    told,
)
from impactlab.analysis.orbit import Base, Orbit, OrbitMethod
from impactlab.assembly.model import Model
from impactlab.components.stored import stored
from impactlab.errors import InvalidInput, NoOrbit, keep_in
from impactlab.inputs import Count, checked
from impactlab.networks.network import Network
from impactlab.progress import reporter
from impactlab.records.surface import Strobe, Surface
from impactlab.results.dataset import configuration_of

STROBED = 1e-9
"""Part of a period by which a section may miss that of the force."""


@checked
def orbits(
    network: Network,
    section: Surface | None = None,
    start: xr.Dataset | str | None = None,
    *,
    periods: Count = 4,
    initial: Mapping[str, Any] | None = None,
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
        Where the path begins: the end of a result with `FinalState` or `Trajectory`; one value of a diagram by strobes
        of `bifurcation`; the orbits that `orbits` found for a network like this one; or "search", many random starts,
        which find orbits beside each other. At rest by default.
    periods : int
        How many periods an orbit takes at most.
    initial : mapping, optional
        Where the path begins at t = 0, as for `simulate`, in the place of `start`; with several values of a body for
        several paths.
    seed : int
        Of the random starts.
    progress : bool or callable, optional
        As for `simulate`. When a search is interrupted, its error has the orbits that were found as `found`.

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

    Notes
    -----
    Multipliers are the eigenvalues of the matrix of equation :eq:`monodromy` of the theory.

    Examples
    --------
    >>> found = il.orbits(driven)
    >>> found.periods.values, found.stable.values
    (array([1]), array([1], dtype=int8))
    """
    method, values, show = method_of(network), np.zeros(1), reporter(progress)
    base = _base(method, values, section)
    if isinstance(start, xr.Dataset) and "path_error" in start and "point" in start.dims:
        start = ends_of_diagram(start)
    if initial is None:
        states, begins = starts_of(method, values, start, base, seed)
    elif start is None:
        states = given_states(Model.of(network), initial)
        begins = np.zeros(len(states))
    else:
        raise InvalidInput("Give start= or initial=, not both.")
    options = {
        "section": None if section is None else section.to_dict(), "periods": periods, "seed": seed, "initial": initial,
        "start": stored_start(start, method) if isinstance(start, xr.Dataset) else start,
    }  # fmt: skip
    found, misses = list[Orbit](), list[str]()

    def dataset() -> xr.Dataset:
        found.sort(key=lambda item: float(item.unknowns[-2]))
        return described(method, found, section, {"network": stored(network), "orbits": options}, base)

    known = isinstance(start, xr.Dataset) and "section_time" in start
    if isinstance(start, xr.Dataset) and known:
        returns = Returns(_known(method, values, start, states, begins, base), [])
    else:
        returns = returns_of(method, values, states, begins, base, periods)
    try:
        for number, item in enumerate(returns.near):
            show(number / len(returns.near))
            outcome = orbit_near(method, values, item, base)
            if isinstance(outcome, str):
                misses.append(outcome)
            elif not any(is_same(method, outcome, other, base) for other in found):
                found.append(outcome)
            if found and start != "search" and not known and (initial is None or len(states) == 1):
                break
    except KeyboardInterrupt as error:
        if found:
            keep_in(error, dataset(), "orbits that were found")
        raise
    show(1.0)
    if not found:
        if not (returns.near or returns.rests):
            misses = [str(method.near(states[0], values, base.period, (base.wave, base.cycles)))]
        raise NoOrbit(told(method, returns, misses, len(states), periods, base.period))
    return dataset()


def again(
    dataset: xr.Dataset, options: Mapping[str, Any], progress: Callable[[float], None] | None = None
) -> xr.Dataset:
    """Return orbits again from what is stored with them."""
    given, network = dict(options), configuration_of(dataset)["network"]
    section, start = given.pop("section"), given.pop("start")
    section = None if section is None else Surface.from_dict(section)
    start = start_of(start, network) if isinstance(start, Mapping) else start
    return orbits(Network.from_dict(network), section, start, progress=progress, **given)


def _base(method: OrbitMethod, values: np.ndarray, section: Surface | None) -> Base:
    """Return the period of which orbits take a whole number."""
    force = method.force(values)
    if force is None:
        if isinstance(section, Strobe):
            raise InvalidInput("Nothing varies in time: il.Strobe tells no phase; use il.AtContact or il.Crossing.")
        return Base(method.slowest(values), -1, 0)
    if not isinstance(section, Strobe):
        return Base(*force)
    period, wave, cycles = force
    times = round(section.period / period)
    if times < 1 or abs(section.period - times * period) > STROBED * section.period:
        raise InvalidInput(
            f"The period of {section!r} is {section.period / period:.9g} times that of the force, {period:.12g} s, but "
            "must be a whole number of these."
        )
    return Base(times * period, wave, times * cycles)


def _known(
    method: OrbitMethod, values: np.ndarray, start: xr.Dataset, states: np.ndarray, begins: np.ndarray, base: Base
) -> list[Return]:
    """Return the states at the time 0 of orbits that are known, of a network like this one."""
    lengths, result = np.atleast_1d(start["period"].values).tolist(), list[Return]()
    paths = method.sampled(states, values, begins, np.array([0.0, base.period]))
    for length, path, state in zip(lengths, paths, states, strict=True):
        count = max(1, round(length / base.period)) if base.wave >= 0 else 1
        period = count * base.period if base.wave >= 0 else length
        result.append(Return(0.0, count, period, path[0], state, np.zeros_like(state)))
    return result
