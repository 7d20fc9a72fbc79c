"""Plots of trajectories: over time, in the phase plane, and its points at a period."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from impactlab.components.component import positive, suggestion
from impactlab.components.sides import Combination
from impactlab.errors import InvalidInput
from impactlab.plotting.captions import side_text
from impactlab.plotting.held import contact_weights, known_dataset, of_names, rigid_contacts, rows, several, variable
from impactlab.plotting.style import COLORS, axes_of, dashes, label_text, legend, number_text, style

Place = str | Combination
"""What moves: a body, a point of a structure, or a weighted sum of these."""

_QUANTITIES = {"displacement": "m", "velocity": "m s-1", "contact_force": "N"}
_CLOSED: dict[str, Any] = {"facecolor": "0.5", "alpha": 0.3, "linewidth": 0.0}
_MOST = 4

SMALLEST = 0.1
"""Part of the motion that a stroboscopic section shows at least."""


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
    samples may be missed, except impacts of rigid contacts: the interval of each is shaded, and their force is drawn as
    its mean over each interval.

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
    rigid = rigid_contacts(one) if quantity == "contact_force" else ()
    for index, (name, line) in enumerate(zip(given, lines, strict=True)):
        look: dict[str, Any] = {"label": side_text(name), "ls": dashes(index)}
        look["drawstyle"] = "steps-pre" if name in rigid else "default"
        axes.plot(one["time"].values, line, **look)
    title = quantity.replace("_", " ")
    axes.set(xlabel="time (s)", ylabel=label_text(title, _QUANTITIES[quantity]), xlim=one["time"].values[[0, -1]])
    if len(given) == 1:
        axes.set_ylabel(label_text(f"{title} of {side_text(given[0])}", _QUANTITIES[quantity]))
    return legend(axes)


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
    """
    one = one_realization(result, realization)
    x, v = series(one, "displacement", name), series(one, "velocity", name)
    axes = axes_of(ax, (4.0, 3.6))
    axes.plot(x, v, lw=0.8, label="open")
    closed = np.zeros(len(x), dtype=bool)
    for forces in _closed(one, [name]).values():
        closed |= forces
    if closed.any():
        beside = closed | np.append(closed[1:], False)  # with the way to the first sample inside
        inside = [np.where(beside, item, np.nan) for item in (x, v)]
        axes.plot(*inside, color=COLORS[1], lw=1.2, label="in contact")
    return legend(_phase_plane(axes, name))


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
    """
    some = _of_some_time(result) if realization is None else one_realization(result, realization)
    x, v = series(some, "displacement", name), series(some, "velocity", name)
    times = some["time"].values
    wanted = np.arange(times[0], times[-1] * (1.0 + 1e-9), positive("period", period))
    interval = (times[-1] - times[0]) / max(len(times) - 1, 1)
    places = np.rint((wanted - times[0]) / interval).astype(int)
    if np.abs(times[places] - wanted).max() > 1e-3 * interval:
        raise InvalidInput(
            f"The period of {period:g} s is no whole number of intervals of {interval:g} s between samples; record "
            f"il.Trajectory(interval={period:g}/32), say."
        )
    axes = axes_of(ax, (4.0, 3.6))
    many = x[..., places].size
    axes.plot(x[..., places].ravel(), v[..., places].ravel(), ".", ms=4.0 if many < 500 else 1.5)
    axes.set(xlim=_wide(x, x[..., places]), ylim=_wide(v, v[..., places]))
    axes.set_title(f"every {number_text(period)} s")
    return _phase_plane(axes, name)


def _wide(whole: np.ndarray, some: np.ndarray) -> tuple[float, float]:
    """Return limits around some of the points of a motion; if they are at one place, not only its rounding is seen."""
    middle, half = 0.5 * float(some.max() + some.min()), 0.55 * float(np.ptp(some))
    half = max(half, SMALLEST * float(np.ptp(whole)))
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


def _closed(result: xr.Dataset, names: Iterable[Place]) -> dict[str, np.ndarray]:
    """Return when contacts of some bodies, or all where that is not known, were closed, (time,) of bool, by name."""
    if "contact_force" not in result:
        return {}
    own: set[str] = set()
    for name in names:
        own |= dict(name.weights).keys() if isinstance(name, Combination) else {name}
    ends = contact_weights(result)
    forces = of_names(result["contact_force"])
    return {
        contact: forces.sel(place).values != 0.0
        for contact, place in rows(forces)
        if contact not in ends or own & ends[contact][0].keys()
    }


def _shade(axes: Axes, result: xr.Dataset, names: Iterable[Place]) -> None:
    """Shade the times at which contacts were closed; a few of them can be told apart."""
    found = {name: closed for name, closed in _closed(result, names).items() if closed.any()}
    many = len(found) > _MOST
    looks: list[dict[str, Any]] = [
        _CLOSED,
        *({**_CLOSED, "facecolor": item} for item in COLORS[4:1:-1]),
    ]
    if many:
        found = {"a contact": np.any(list(found.values()), axis=0)}
    times, rigid = result["time"].values, rigid_contacts(result)
    half = 0.5 * float(np.diff(times[:2]).sum())
    for (name, closed), look in zip(found.items(), looks, strict=False):
        turns = np.flatnonzero(np.diff(closed, prepend=False, append=False)).reshape(-1, 2)
        early = 2.0 * half if name in rigid else half  # an impact is in the interval before the sample
        spans = [(times[begin] - early, times[end - 1] - times[begin] + 2.0 * half) for begin, end in turns]
        axes.broken_barh(spans, (0.0, 1.0), transform=axes.get_xaxis_transform(), label=f"{name} closed", **look)


def _phase_plane(axes: Axes, name: Place) -> Axes:
    axes.set_xlabel(label_text(f"displacement of {side_text(name)}", _QUANTITIES["displacement"]))
    axes.set_ylabel(label_text(f"velocity of {side_text(name)}", _QUANTITIES["velocity"]))
    return axes
