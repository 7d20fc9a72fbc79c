"""One figure of all that a result holds."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from itertools import islice

import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import impactlab
from impactlab.components.component import SHOWN
from impactlab.components.contact import RoundContact
from impactlab.errors import InvalidInput
from impactlab.plotting.curves import peaks, spectrum
from impactlab.plotting.density_plots import density, joint_density
from impactlab.plotting.drawing import network
from impactlab.plotting.held import LABELS, configuration, contacts_of, names_of, of_names, rows
from impactlab.plotting.impact_plots import impacts
from impactlab.plotting.lines import FEW, profile, sweep
from impactlab.plotting.motion import trajectory
from impactlab.plotting.planes import orbit
from impactlab.plotting.style import name_text, style, units_text
from impactlab.results.measured import measured_text
from impactlab.results.schema import STATISTICS, check_labels

Panel = Callable[[xr.Dataset, Axes], object]
"""Draws something of a result."""

_STATISTICS = (
    "mean_square_displacement", "mean_square_velocity", "contact_ratio", "contact_rate", "mean_contact_force",
    "peak_contact_force",
)  # fmt: skip
_PROFILES = ("mean_square_displacement", "contact_ratio")

_QUANTITIES = ("displacement", "velocity", "contact_force")
_WIDTH, _HEIGHT = 4.8, 3.2  # of a panel, in inches


@style()
def overview(result: xr.Dataset) -> Figure:
    """Draw what a result holds: its network, statistics, and what records kept of one simulation; or a sweep.

    Parameters
    ----------
    result : Dataset
        What `simulate` or `sweep` returned.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InvalidInput
        If it holds nothing of the kind.
    """
    check_labels(result)
    panels = list(_panels(result))
    if not panels:
        raise InvalidInput("The result holds nothing that can be drawn: it is none of il.simulate or il.sweep.")
    drawn = _network_of(result)
    above, columns = int(drawn is not None), min(2, len(panels))
    rows = above + math.ceil(len(panels) / columns)
    figure = Figure(figsize=(_WIDTH * columns, _HEIGHT * rows))
    grid = figure.add_gridspec(rows, columns)
    if drawn is not None:
        network(drawn, ax=figure.add_subplot(grid[0, :]))
    for index, panel in enumerate(panels):
        panel(result, figure.add_subplot(grid[above + index // columns, index % columns]))
    return figure


def _panels(result: xr.Dataset) -> Iterator[Panel]:
    """Give what draws each part of a result."""
    held = [name for name in STATISTICS if name in result and result[name].size]
    statistics = [name for name in _STATISTICS if name in held] or held
    if any(set(result[name].dims) - set(LABELS) for name in statistics):  # a sweep
        for name in statistics:
            yield partial(_sweep, name)
        return
    few = [name for name in statistics if result[name].size <= FEW]
    many = [name for name in statistics if name not in few]
    if few:
        yield partial(_table, few)
    for name in [name for name in many if name in _PROFILES] or many[: not few]:
        yield partial(_profile, name)
    for draw, form in ((density, "density_{}"), (joint_density, "joint_density"), (spectrum, "spectrum_{}")):
        for quantity in _QUANTITIES if "{}" in form else ("",):
            if form.format(quantity) in result:
                yield partial(_record, draw, form.format(quantity), quantity)
    if "window_peak_force" in result:
        yield partial(_record, peaks, "window_peak_force", "")
    if "density_closing_velocity" in result:
        yield partial(_record, impacts, "density_closing_velocity", "")
    if "impact_closing_velocity" in result:
        yield _impacts
    if "displacement" in result:
        in_planes = [name for name, contact in contacts_of(result).items() if isinstance(contact, RoundContact)]
        for name in in_planes[:SHOWN]:
            yield partial(_orbit, name)
    for quantity in ("displacement", "contact_force"):
        if quantity in result:
            yield partial(_record, trajectory, quantity, quantity)


def _sweep(name: str, result: xr.Dataset, ax: Axes) -> None:
    sweep(result, name, ax=ax)


def _orbit(name: str, result: xr.Dataset, ax: Axes) -> None:
    orbit(result, name, ax=ax)


def _impacts(result: xr.Dataset, ax: Axes) -> None:
    """Draw the impacts of the first contacts."""
    recorded = dict.fromkeys(result["impact_series_contact"].values.tolist())
    impacts(result, list(islice(recorded, SHOWN)), ax=ax)


def _table(names: list[str], result: xr.Dataset, ax: Axes) -> None:
    """Write values of statistics with their standard errors."""
    lines = []
    for name in names:
        data = result[name]
        _, labels = names_of(data)
        errors = result.get(f"{name}_standard_error", xr.full_like(data, math.nan))
        title, units = str(data.attrs.get("long_name", name)), str(data.attrs.get("units", "1"))
        for label, value, error in zip(labels, data.values.flat, errors.values.flat, strict=True):
            value_text = measured_text(float(value), float(error))
            lines.append([title, name_text(label), value_text, "" if units == "1" else units_text(units)])
            title = ""
    table = ax.table(lines, cellLoc="left", loc="center", edges="open")
    table.auto_set_font_size(False)
    table.set_fontsize(8.0)
    table.auto_set_column_width(list(range(4)))
    ax.set_axis_off()


def _profile(name: str, result: xr.Dataset, ax: Axes) -> None:
    profile(result, name, ax=ax)


def _record(draw: Callable[..., Axes], variable: str, quantity: str, result: xr.Dataset, ax: Axes) -> None:
    """Draw what a record kept, of the first bodies or contacts."""
    options = {"quantity": quantity} if quantity else {}
    if draw is joint_density:
        draw(result, ax=ax)
    else:
        draw(result, [name for name, _ in islice(rows(of_names(result[variable])), SHOWN)], **options, ax=ax)


def _network_of(result: xr.Dataset) -> impactlab.Network | None:
    """Return the network of one simulation, if its classes are known."""
    try:
        return impactlab.Network.from_dict(configuration(result)["network"])
    except (InvalidInput, LookupError, TypeError):
        return None
