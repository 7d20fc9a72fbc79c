"""Plots of trajectories: over time, in the phase plane, and its points at a period."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from impactlab.components.contact import RoundContact
from impactlab.components.sides import Combination, bodies_of
from impactlab.errors import InvalidInput
from impactlab.inputs import checked, positive, suggestion
from impactlab.plotting.captions import side_text
from impactlab.plotting.held import contacts_of, impulsive_contacts, known_dataset, of_names, rows, several, variable
from impactlab.plotting.style import COLORS, axes_of, dashes, label_text, legend_above, name_text, number_text, style

Place = str | Combination
"""What moves: a body, a point of a structure, or a weighted sum of these."""

_QUANTITIES = {"displacement": "m", "velocity": "m s-1", "contact_force": "N"}
_CLOSED: dict[str, Any] = {"facecolor": "0.5", "alpha": 0.3, "linewidth": 0.0}

SMALLEST = 0.1
"""Part of a motion below which a stroboscopic section is drawn on its path, and that is shown at least."""


@checked
@style()
def trajectory(
    result: xr.Dataset,
    names: Place | Iterable[Place] | None = None,
    quantity: str = "displacement",
    *,
    realization: int = 0,
    ax: Axes | None = None,
) -> Axes:
    """Draw displacements, velocities or contact forces of one realization over time.

    Times at which a contact of what is drawn was closed are shaded; contacts shorter than the interval between
    samples may be missed, except those of impulsive contacts: the interval of each is shaded, and their force is drawn
    as its mean over each interval.

    Parameters
    ----------
    result : Dataset
        Of a simulation with ``record=[il.Trajectory(interval)]``. Part of the time is drawn of
        ``result.sel(time=slice(2.0, 3.0))``.
    names : str, Combination or sequence of these, optional
        Bodies, points of structures, or weighted sums of them; or contacts. All bodies or contacts by default.
    quantity : str
        "displacement", "velocity" or "contact_force".
    realization : int
        Which one.
    ax : Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes

    Raises
    ------
    InvalidInput
        If the result holds no trajectories, or a name or the quantity is unknown.

    Examples
    --------
    >>> path = il.simulate(driven, 20.0, initial="rest", record=il.Trajectory(0.05))
    >>> axes = il.plot.trajectory(path)
    >>> axes.get_ylabel()
    'displacement of a (m)'
    """
    if quantity not in _QUANTITIES:
        raise InvalidInput(f"quantity: {suggestion(quantity, _QUANTITIES)}")
    one = one_realization(result, realization)
    given: list[Any] = [] if names is None else several(names)
    if names is None:
        data = trajectories(one, quantity, ["time"])
        given = [name for name, _ in rows(data)]
    lines = [series(one, quantity, name) for name in given]
    axes = axes_of(ax)
    if quantity != "contact_force":
        _shade(axes, one, given)
    impulsive = impulsive_contacts(one) if quantity == "contact_force" else ()
    for index, (name, line) in enumerate(zip(given, lines, strict=True)):
        look: dict[str, Any] = {"label": name_text(side_text(name)), "ls": dashes(index)}
        look["drawstyle"] = "steps-pre" if name in impulsive else "default"
        axes.plot(one["time"].values, line, **look)
    title = quantity.replace("_", " ")
    axes.set(xlabel="time (s)", ylabel=label_text(title, _QUANTITIES[quantity]), xlim=one["time"].values[[0, -1]])
    if len(given) == 1:
        axes.set_ylabel(axis_label(given[0], quantity))
    return legend_above(axes, least=2)


@checked
@style()
def phase_portrait(result: xr.Dataset, name: Place, *, realization: int = 0, ax: Axes | None = None) -> Axes:
    """Draw the velocity of a body over its displacement, the parts where a contact of it was closed in another colour.

    Parameters
    ----------
    result : Dataset
        Of a simulation with ``record=[il.Trajectory(interval)]``.
    name : str or Combination
        The body, the point of a structure, or a weighted sum of them.
    realization : int
        Which one.
    ax : Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes

    Raises
    ------
    InvalidInput
        If the result holds no trajectories, or the name is unknown.

    Examples
    --------
    >>> path = il.simulate(driven, 20.0, initial="rest", record=il.Trajectory(0.05))
    >>> axes = il.plot.phase_portrait(path, "a")
    """
    one = one_realization(result, realization)
    x, v = series(one, "displacement", name), series(one, "velocity", name)
    axes = axes_of(ax, (4.0, 3.6))
    draw_path(axes, x, v, _closed(one, [name]).values())
    return legend_above(_phase_plane(axes, name), least=2)


@checked
@style()
def stroboscopic(
    result: xr.Dataset,
    name: Place,
    period: float,
    *,
    realization: int | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Draw a stroboscopic section: displacement and velocity of a body once in a period, from the first sample on.

    Points that are close to each other, as those of a motion that repeats itself, are drawn on the path of the last
    period.

    Parameters
    ----------
    result : Dataset
        Of a simulation with ``record=[il.Trajectory(interval)]``, the period being a whole number of intervals. What
        comes before the motion has settled is left out by ``result.sel(time=slice(start, None))``.
    name : str or Combination
        The body, the point of a structure, or a weighted sum of them.
    period : float
        Period of the excitation (s), 2π/ω.
    realization : int, optional
        Which one; all by default.
    ax : Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes

    Raises
    ------
    InvalidInput
        If the result holds no trajectories, the name is unknown, or the period is no whole number of intervals.

    Examples
    --------
    >>> path = il.simulate(driven, 100.0, initial="rest", record=il.Trajectory(np.pi))
    >>> axes = il.plot.stroboscopic(path, "a", period=np.pi)
    """
    some = _of_some_time(result) if realization is None else one_realization(result, realization)
    x, v = series(some, "displacement", name), series(some, "velocity", name)
    times = some["time"].values
    interval = (times[-1] - times[0]) / max(len(times) - 1, 1)
    wanted = np.arange(times[0], times[-1] * (1.0 + 1e-9), max(positive("period", period), 0.5 * interval))
    places = np.rint((wanted - times[0]) / interval).astype(int)
    if np.abs(times[places] - wanted).max() > 1e-3 * interval:
        raise InvalidInput(
            f"The period of {period:g} s is no whole number of intervals of {interval:g} s between samples; record "
            f"il.Trajectory(interval={period:g}/32), say."
        )
    axes = axes_of(ax, (4.0, 3.6))
    points = [item[..., places].ravel() for item in (x, v)]
    if all(np.ptp(some) < SMALLEST * np.ptp(whole) for some, whole in zip(points, (x, v), strict=True)):
        last = slice(-1 - round(period / interval), None)
        axes.plot(*(item[..., last].reshape(-1, item[..., last].shape[-1])[0] for item in (x, v)), color="0.75", lw=0.8)
    else:
        axes.set(xlim=_wide(x, points[0]), ylim=_wide(v, points[1]))
    # many points are drawn smaller
    axes.plot(*points, "o", color=COLORS[0], ms=4.0 if len(points[0]) < 500 else 1.2)
    axes.set_title(f"once in each period of {number_text(period)} s")
    return _phase_plane(axes, name)


def _wide(whole: np.ndarray, some: np.ndarray) -> tuple[float, float]:
    """Return limits around some of the points of a motion; if they are at one place, not only its rounding is seen."""
    middle, half = 0.5 * float(some.max() + some.min()), 0.55 * float(np.ptp(some))
    half = max(half, SMALLEST * float(np.ptp(whole)))
    # smaller differences are not shown
    if half <= 1e-6 * abs(middle):
        half = SMALLEST * abs(middle) or 1.0
    return middle - half, middle + half


def series(result: xr.Dataset, quantity: str, name: Place) -> np.ndarray:
    """Return a quantity of a body, a point, a contact or a combination, (…, time)."""
    if isinstance(name, Combination):
        return np.asarray(sum(weight * series(result, quantity, part) for part, weight in name.weights))
    points = f"point_{quantity}"
    of_point = points in result and name in of_names(result[points])["point"].values
    data = trajectories(result, points if of_point else quantity, ["realization", "time"])
    ((_, place),) = rows(data, [name])
    return np.asarray(data.sel(place).values)


def trajectories(result: xr.Dataset, quantity: str, inner: Iterable[str]) -> xr.DataArray:
    """Return a quantity over time, with dimensions of names and `inner` ones; see `variable`."""
    what = "trajectories" + (f" of the {quantity.replace('_', ' ')}" if "time" in known_dataset(result).dims else "")
    return variable(result, quantity, what, "il.Trajectory(interval=…)", inner)


def one_realization(result: Any, realization: int) -> xr.Dataset:
    """Return one realization of a result."""
    dataset = _of_some_time(result)
    if "realization" not in dataset.dims:
        return dataset
    if realization not in dataset["realization"].values:
        raise InvalidInput(f"There is no realization {realization!r}; there are {dataset.sizes['realization']}.")
    return dataset.sel(realization=realization)


def _of_some_time(result: Any) -> xr.Dataset:
    """Return a result; trajectories of which less than two samples were selected are refused."""
    dataset = known_dataset(result)
    if "time" in dataset and dataset["time"].size < 2:
        raise InvalidInput("Less than two samples are left; select more, such as result.sel(time=slice(2.0, 3.0)).")
    return dataset


def when_closed(result: xr.Dataset) -> dict[str, np.ndarray]:
    """Return when each contact was closed, (time,) of bool, by name."""
    if "contact_force" not in result:
        return {}
    forces = of_names(result["contact_force"])
    return {name: forces.sel(place).values != 0.0 for name, place in rows(forces)}


def _closed(result: xr.Dataset, names: Iterable[Place]) -> dict[str, np.ndarray]:
    """Return when the contacts of some bodies were closed, and those of which this is not known."""
    own: set[str] = set()
    for name in names:
        own |= dict(name.weights).keys() if isinstance(name, Combination) else {name}
    contacts = contacts_of(result)
    found = when_closed(result)
    return {key: found[key] for key in found if key not in contacts or own & set(bodies_of(contacts[key]))}


def draw_path(axes: Axes, x: np.ndarray, y: np.ndarray, closed: Iterable[np.ndarray]) -> None:
    """Draw a path, the parts where a contact was closed in another colour."""
    axes.plot(x, y, lw=0.8, label="open")
    touching = np.any([np.zeros(len(x), dtype=bool), *closed], axis=0)
    if touching.any():
        beside = touching | np.append(touching[1:], False)  # with the way to the first sample inside
        inside = [np.where(beside, item, np.nan) for item in (x, y)]
        axes.plot(*inside, color=COLORS[1], lw=1.2, label="in contact")


def draw_rim(axes: Axes, contact: RoundContact, **line: Any) -> None:
    """Draw the circle on which a round contact closes."""
    x, y = contact.center
    angle = np.linspace(0.0, 2.0 * np.pi, 181)
    rim = x + contact.clearance * np.cos(angle), y + contact.clearance * np.sin(angle)
    axes.plot(*rim, **line)


def _shade(axes: Axes, result: xr.Dataset, names: Iterable[Place]) -> None:
    """Shade the times at which contacts were closed; a few of them can be told apart."""
    found = {name: closed for name, closed in _closed(result, names).items() if closed.any()}
    looks: list[dict[str, Any]] = [
        _CLOSED,
        *({**_CLOSED, "facecolor": item} for item in COLORS[4:1:-1]),
    ]
    many = len(found) > len(looks)
    times, impulsive = result["time"].values, impulsive_contacts(result)
    if many:
        impulsive = {"a contact"} if impulsive & found.keys() else set()
        found = {"a contact": np.any(list(found.values()), axis=0)}
    half = 0.5 * float(np.diff(times[:2]).sum())
    for (name, closed), look in zip(found.items(), looks, strict=False):
        turns = np.flatnonzero(np.diff(closed, prepend=False, append=False)).reshape(-1, 2)
        early = 2.0 * half if name in impulsive else half  # an impact is in the interval before the sample
        spans = [(times[begin] - early, times[end - 1] - times[begin] + 2.0 * half) for begin, end in turns]
        if name in impulsive:  # impacts are shorter than a line is wide
            look = look | {"linewidth": 0.8, "edgecolor": look["facecolor"]}
        label = name_text(f"{name} closed")
        axes.broken_barh(spans, (0.0, 1.0), transform=axes.get_xaxis_transform(), label=label, **look)


def _phase_plane(axes: Axes, name: Place) -> Axes:
    axes.set(xlabel=axis_label(name), ylabel=axis_label(name, "velocity"))
    return axes


def axis_label(name: Place, quantity: str = "displacement") -> str:
    """Return the label of an axis for a quantity of what moves."""
    title = quantity.replace("_", " ")
    return label_text(name_text(f"{title} of {side_text(name)}"), _QUANTITIES[quantity])
