"""Plots of motion in a plane: orbits in round clearances."""

from __future__ import annotations

from collections.abc import Sequence

import xarray as xr
from matplotlib.axes import Axes

from impactlab.components.contact import RoundContact
from impactlab.components.sides import WALL, Combination, weights_of
from impactlab.errors import InvalidInput
from impactlab.inputs import checked, suggestion
from impactlab.plotting.held import contacts_of, several
from impactlab.plotting.motion import (
    Place,
    axis_label,
    draw_path,
    draw_rim,
    one_realization,
    series,
    trajectories,
    when_closed,
)
from impactlab.plotting.orbit_plots import periodic
from impactlab.plotting.style import axes_of, dashes, legend_above, name_text, style


@checked
@style()
def orbit(
    result: xr.Dataset,
    name: str | tuple[Place, Place] | None = None,
    *,
    realization: int = 0,
    ax: Axes | None = None,
) -> Axes:
    """Draw the orbit of a body in a plane: y over x, the rim of its clearance, and where it was in contact.

    Of what `impactlab.orbits` found, the velocity of a body over its displacement.

    Parameters
    ----------
    result : Dataset
        Of `impactlab.orbits`, or of a simulation with ``record=[il.Trajectory(interval)]``. Part of the time is
        drawn of ``result.sel(time=slice(2.0, 3.0))``.
    name : str or pair of str or Combination, optional
        A round contact, whose body is drawn relative to what is around it; or the coordinates x and y, which may be
        without contact. The first round contact by default. Of periodic orbits, a body; the first one by default.
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
        If the result holds no trajectories, a name is unknown, or no round contact is there where none is named.

    Examples
    --------
    >>> axes = il.plot.orbit(il.orbits(driven))
    """
    if isinstance(result, xr.Dataset) and "path_displacement" in result:
        return periodic(result, name, ax)
    one = one_realization(result, realization)
    trajectories(one, "displacement", ["time"])
    contacts = {key: item for key, item in contacts_of(one).items() if isinstance(item, RoundContact)}
    if not isinstance(name, str | None):
        coordinates: Sequence[Place] = tuple(several(name))
        contacts = {key: item for key, item in contacts.items() if (item.first, item.second) == (coordinates, WALL)}
    elif contacts:
        key = next(iter(contacts)) if name is None else name
        if key not in contacts:
            raise InvalidInput(f"There is no round contact {name!r}; {suggestion(str(name), contacts)}")
        contacts = {key: contacts[key]}
        coordinates = [Combination(weights_of(item)) for item in contacts[key].directions]
    else:
        raise InvalidInput('The network has no round contact: name x and y, such as il.plot.orbit(result, ("x", "y")).')
    if len(coordinates) != 2:
        raise InvalidInput(f"An orbit has two coordinates, x and y, not {name!r}.")
    x, y = (series(one, "displacement", item) for item in coordinates)
    axes = axes_of(ax, (4.2, 4.2))
    closed = when_closed(one)
    draw_path(axes, x, y, [closed[key] for key in contacts if key in closed])
    for key, item in contacts.items():
        draw_rim(axes, item, color="0.2", lw=1.0, ls=dashes(1), zorder=3, label=name_text(f"{key} closes"))
    axes.set(aspect="equal", xlabel=axis_label(coordinates[0]), ylabel=axis_label(coordinates[1]))
    axes.set_adjustable("datalim")
    return legend_above(axes, least=2)
