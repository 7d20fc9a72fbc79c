"""Orbits as variables of a labelled dataset."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from impactlab.analysis.orbit import Base, Happening, Orbit, OrbitMethod, along
from impactlab.components.literature import in_one_line
from impactlab.components.stored import entries, json_of
from impactlab.errors import InvalidInput
from impactlab.inputs import suggestion
from impactlab.records.surface import AtContact, Crossing, Strobe, Surface
from impactlab.results.dataset import CONFIGURATION, parsed, provenance
from impactlab.results.labels import Variables, labelled
from impactlab.results.schema import BODY

PHASES = 256
"""Parts of a period between states of a path."""

CLOSES = "bounce", "close", "rest"
LEAVES = "bounce", "open", "release"
"""Events at which a contact closes, and at which it opens."""

CRITICAL: Mapping[str, tuple[float, ...]] = {"fold": (1.0,), "flip": (-1.0,), "torus": (math.nan, math.nan)}
"""Multipliers that make an event; NaN anywhere on the unit circle."""

STABLE = "whether the orbit is stable; at a fold, flip or torus, whether it is but for the multipliers that make this"
"""What the variable `stable` says."""

NEUTRAL = 1e-10
"""Distance of multipliers from the unit circle that is rounding, as where orbits are not apart from each other."""

CITATION = (
    "R. I. Leine and H. Nijmeijer, Dynamics and Bifurcations of Non-Smooth Mechanical Systems, Springer, 2004; "
    "M. di Bernardo, C. J. Budd, A. R. Champneys and P. Kowalczyk, Piecewise-smooth Dynamical Systems, Springer, 2008"
)
"""What orbits, their multipliers and events on branches rest on."""


def dataset_of(
    variables: Variables,
    coordinates: Variables,
    title: str,
    configuration: Mapping[str, Any],
    attributes: Mapping[str, Any],
) -> xr.Dataset:
    """Return a labelled dataset that says what it is, and how it was made."""
    references = f"{in_one_line(entries(dict(configuration)))} {CITATION}"
    told = provenance(title, json_of(configuration), references)
    return xr.Dataset(dict(variables), dict(coordinates), {**told, **attributes})


def columns(
    method: OrbitMethod, orbits: Sequence[Orbit], dimension: str, events: Sequence[str] | None = None
) -> tuple[Variables, Variables]:
    """Return variables of orbits along a dimension, but their states, and coordinates.

    At `events` stability is that of the other multipliers: those that make the event are on the unit circle.
    """
    size = len(method.sizes)
    monodromy = np.array([orbit.monodromy for orbit in orbits])
    known = np.isfinite(monodromy).all(axis=(1, 2))
    multipliers = np.full((len(orbits), size), complex(np.nan, np.nan))
    multipliers[known] = np.linalg.eigvals(monodromy[known])
    order = np.argsort(-np.abs(multipliers), axis=1)
    multipliers = np.take_along_axis(multipliers, order, axis=1)
    critical = [CRITICAL.get(event, ()) for event in events or [""] * len(orbits)]
    largest = np.array([_largest(*item, method.trivial) for item in zip(multipliers, critical, strict=True)])
    closure, drifts = method.closures(orbits)
    lists = [method.happenings(orbit) for orbit in orbits]
    one = (dimension,)
    period = np.array([orbit.unknowns[-1 - method.parameters] for orbit in orbits])
    along, of_multiplier = (*one, BODY), (*one, "multiplier")
    variables = {
        "period": labelled(one, period, "s", "period of the orbit"),
        "multiplier_real": labelled(of_multiplier, multipliers.real, "", "real part of the Floquet multiplier"),
        "multiplier_imag": labelled(of_multiplier, multipliers.imag, "", "imaginary part of the Floquet multiplier"),
        "stable": labelled(one, (largest < 1.0 - NEUTRAL).astype(np.int8), "", STABLE),
        "energy_lost": labelled(one, method.losses(orbits), "J", "energy lost in a period"),
        "closure": labelled(one, closure, "1", "distance of both ends of the path as a part of its size"),
        **_events(lists, dimension),
    }
    if method.drift.any():
        variables["drift"] = labelled(along, drifts, "m", "displacement by which a period takes the body along")
    return variables, {BODY: ((BODY,), np.array(method.bodies), {"long_name": "body"})}


def _largest(multipliers: np.ndarray, critical: Sequence[float], trivial: int) -> float:
    """Return the size of the largest multiplier, but for the trivial ones and for critical ones, on the unit circle."""
    left = multipliers.tolist()
    for place in [1.0] * trivial + list(critical):
        left.remove(min(left, key=lambda item: abs(item - place) if math.isfinite(place) else abs(abs(item) - 1.0)))
    return max(map(abs, left), default=0.0)


def _events(lists: Sequence[Sequence[Happening]], dimension: str) -> Variables:
    """Return the events of orbits, and how many of these are impacts."""
    shape = len(lists), max((len(item) for item in lists), default=0)
    times, velocities = np.full(shape, np.nan), np.full(shape, np.nan)
    contacts, kinds = [[""] * shape[1] for _ in lists], [[""] * shape[1] for _ in lists]
    impacts = np.zeros(len(lists), dtype=np.int64)
    for row, item in enumerate(lists):
        for place, event in enumerate(item):
            times[row, place], velocities[row, place] = event.time, event.closing_velocity
            contacts[row][place], kinds[row][place] = event.contact, event.kind
        impacts[row] = sum(event.kind in CLOSES for event in item)
    along = dimension, "event"
    texts = [np.array(item, dtype=str).reshape(shape) for item in (contacts, kinds)]
    return {
        "impacts": labelled((dimension,), impacts, "", "number of impacts in a period"),
        "event_time": labelled(along, times, "s", "time of the event"),
        "event_contact": labelled(along, texts[0], "", "contact of the event"),
        "event_kind": labelled(along, texts[1], "", "kind of the event"),
        "closing_velocity": labelled(along, velocities, "m s-1", "closing velocity of the impact"),
    }


def states_of(states: np.ndarray, dimensions: tuple[str, ...], prefix: str = "", suffix: str = "") -> Variables:
    """Return displacements and velocities as variables."""
    x, v = np.split(states, 2, axis=-1)
    return {
        f"{prefix}displacement": labelled((*dimensions, BODY), x, "m", f"displacement{suffix}"),
        f"{prefix}velocity": labelled((*dimensions, BODY), v, "m s-1", f"velocity{suffix}"),
    }


def described(
    method: OrbitMethod, orbits: Sequence[Orbit], section: Surface | None, configuration: Mapping[str, Any], base: Base
) -> xr.Dataset:
    """Return the dataset of some orbits of a network; orbits take a whole number of `base` periods."""
    variables, coordinates = columns(method, orbits, "orbit")
    met = [on_section(method, orbit, section) for orbit in orbits]
    variables |= states_of(np.array([state for _, state in met]), ("orbit",), suffix=" on the section")
    times = np.array([time for time, _ in met])
    variables["section_time"] = labelled(("orbit",), times, "s", "time at which the orbit is on the section")
    phase, period = np.linspace(0.0, 1.0, PHASES + 1), variables["period"][1]
    paths = [along(method, orbit, length * phase) for orbit, length in zip(orbits, period, strict=True)]
    variables |= states_of(np.array(paths), ("orbit", "phase"), "path_", " along the orbit")
    if base.wave >= 0:
        periods = np.round(period / base.period).astype(np.int64)
        variables["periods"] = labelled(("orbit",), periods, "", "periods of the force in one of the orbit")
    coordinates["phase"] = labelled(("phase",), phase, "1", "part of the period since its beginning")
    title = "Periodic orbits of a network of oscillators with contacts"
    return dataset_of(variables, coordinates, title, configuration, {})


def on_section(method: OrbitMethod, orbit: Orbit, section: Surface | None) -> tuple[float, np.ndarray]:
    """Return when an orbit first meets a surface, and its state there."""
    size, period = len(method.sizes), float(orbit.unknowns[-1 - method.parameters])
    if section is None:
        return 0.0, orbit.unknowns[:size]
    if isinstance(section, Strobe):
        time = math.fmod(section.start, period) % period
        return time, method.state_at(orbit, time)
    if isinstance(section, AtContact):
        if section.contact not in method.contacts:
            raise InvalidInput(
                f"There is no contact {section.contact!r}; {suggestion(section.contact, method.contacts)}"
            )
        kinds = CLOSES if section.side == "closing" else LEAVES
        for place, event in enumerate(method.happenings(orbit)):
            if event.contact == section.contact and event.kind in kinds:
                return event.time, method.state_at_event(orbit, place, section.side == "leaving")
        raise InvalidInput(f"The orbit never meets {section!r}: its contact does not do that in a period.")
    assert isinstance(section, Crossing)
    return _crossing(method, orbit, section, period)


def _crossing(method: OrbitMethod, orbit: Orbit, section: Crossing, period: float) -> tuple[float, np.ndarray]:
    """Return when an orbit first crosses a level, and its state there."""
    from scipy.optimize import brentq

    if section.body not in method.bodies:
        raise InvalidInput(f"There is no body {section.body!r}; {suggestion(section.body, method.bodies)}")
    body, way = method.bodies.index(section.body), 1.0 if section.direction == "up" else -1.0
    path = along(method, orbit, period * np.linspace(0.0, 1.0, PHASES + 1))
    above = way * (path[:, body] - section.level)
    places = np.flatnonzero((above[:-1] <= 0.0) & (above[1:] > 0.0))
    if not len(places):
        raise InvalidInput(
            f"The orbit never crosses {section!r}: {section.body!r} is between {path[:, body].min():.6g} and "
            f"{path[:, body].max():.6g} m."
        )

    def beyond(time: float) -> float:
        return float(method.state_at(orbit, time)[body] - section.level)

    step = period / PHASES
    time = float(brentq(beyond, places[0] * step, (places[0] + 1) * step, xtol=1e-15 * period, rtol=8.9e-16))
    return time, method.state_at(orbit, time)


def states_in(result: xr.Dataset, method: OrbitMethod) -> tuple[np.ndarray, np.ndarray]:
    """Return states in a dataset, (start, 2 body), and the times at which paths have them (s)."""
    if "section_time" in result and "displacement" in result:
        x, v, times = (np.atleast_1d(result[name].values) for name in ("displacement", "velocity", "section_time"))
        x, v = x.reshape(len(times), -1), v.reshape(len(times), -1)
        names = result["displacement"][BODY].values.tolist()
    else:
        for one, other in (("final_displacement", "final_velocity"), ("displacement", "velocity")):
            if one in result and other in result:
                break
        else:
            raise InvalidInput(
                "start needs a result with record=[il.FinalState()] or record=[il.Trajectory(interval)], or orbits."
            )
        ends = [result[name].isel(time=-1) if "time" in result[name].dims else result[name] for name in (one, other)]
        names = ends[0][BODY].values.tolist()
        when = float(result["time"][-1]) if one == "displacement" else float(result.attrs["duration"])
        x, v = (item.values.reshape(-1, len(names)) for item in ends)
        times = np.full(len(x), when)
    missing = [name for name in method.bodies if name not in names]
    if missing:
        raise InvalidInput(f"The start has no body {missing[0]!r}, but {', '.join(names)}.")
    places = [names.index(name) for name in method.bodies]
    return np.hstack([x[:, places], v[:, places]]), times


def ends_of_diagram(diagram: xr.Dataset) -> xr.Dataset:
    """Return where the motions at a value of a bifurcation diagram end, as states in which paths begin."""
    over = [name for name in diagram["displacement"].dims if name not in ("start", "point", BODY)]
    several = [name for name in over if diagram.sizes[name] > 1]
    if several:
        raise InvalidInput(
            f"start is a diagram: choose one value of {several[0]!r}, such as diagram.isel({several[0]}=0)."
        )
    if "section_time" in diagram:
        raise InvalidInput("start is a diagram at a contact or a level, whose points have no phase: use strobes.")
    section = parsed(diagram.attrs[CONFIGURATION])["bifurcation"]["section"]
    ends = diagram.isel({"point": -1, **dict.fromkeys(over, 0)})
    variables = {
        f"final_{name}": (("orbit", BODY), ends[name].values.reshape(-1, diagram.sizes[BODY]))
        for name in ("displacement", "velocity")
    }
    duration = 0.0 if section is None else section["start"]
    return xr.Dataset(variables, {BODY: diagram[BODY].values}, {**diagram.attrs, "duration": duration})


def stored_start(start: xr.Dataset, method: OrbitMethod) -> dict[str, Any]:
    """Return the states in a dataset, and the periods of orbits, as plain data; see `start_of`."""
    states, times = states_in(start, method)
    x, v = np.split(states, 2, axis=1)
    plain = {"bodies": list(method.bodies), "displacement": x.tolist(), "velocity": v.tolist(), "time": times.tolist()}
    if "section_time" in start:
        plain["period"] = np.atleast_1d(start["period"].values).tolist()
    return plain


def start_of(plain: Mapping[str, Any], network: Mapping[str, Any]) -> xr.Dataset:
    """Return a dataset with the states that `stored_start` has stored, of a network."""
    of_orbits, along = "period" in plain, ("orbit", BODY)
    names = ("displacement", "velocity") if of_orbits else ("final_displacement", "final_velocity")
    variables: dict[str, Any] = {
        name: (along, plain[item]) for name, item in zip(names, ("displacement", "velocity"), strict=True)
    }
    if of_orbits:
        variables |= {"section_time": (along[:1], plain["time"]), "period": (along[:1], plain["period"])}
    attributes = {CONFIGURATION: json_of({"network": network}), "duration": plain["time"][0]}
    return xr.Dataset(variables, {BODY: plain["bodies"]}, attributes)
