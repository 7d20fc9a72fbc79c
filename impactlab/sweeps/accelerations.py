"""Absolute accelerations of a run, from its trajectories."""

from __future__ import annotations

import os

import numpy as np
import xarray as xr

from impactlab.assembly.forces_in_states import Forces
from impactlab.assembly.mechanism import Mode, refusing
from impactlab.assembly.model import Model
from impactlab.components.excitation import BaseMotion, Excitation, Source
from impactlab.errors import InvalidInput
from impactlab.inputs import checked
from impactlab.machine import ROWS_AT_A_TIME
from impactlab.networks.network import Network
from impactlab.results.dataset import load
from impactlab.results.labels import Variables, labelled, with_error
from impactlab.results.schema import BODY, POINT
from impactlab.results.snapshot import STATES
from impactlab.results.stack import on_own_axes
from impactlab.sweeps.rerun import network_of


@checked
def absolute_acceleration(source: xr.Dataset | str | os.PathLike[str]) -> xr.Dataset:
    """Return the absolute accelerations of a run with trajectories: what people, floors and accelerometers feel.

    They are the forces of springs, dampers, contacts and couplings on a body, and other given forces, over its mass.
    The motion of the ground, an `il.BaseMotion`, is no such force: with the displacement x relative to the ground it is
    ``m (x'' + a) = F``, and for structures ``M (x'' + ι a) = −K x − C x' + …`` (Chopra, Dynamics of Structures, 4th
    ed., 2012, section 6.3). So they are finite also where the ground moves like white noise. Under gravity, which is a
    ground that is accelerated all the time, they are what an accelerometer reads: 9.8 m s-2 on a body at rest.

    Parameters
    ----------
    source : Dataset, str or path
        What `simulate` returned with a record `il.Trajectory`, or a netCDF file of it.

    Returns
    -------
    xarray.Dataset
        ``absolute_acceleration`` (realization, time, oscillator) (m s-2); over all samples of a realization
        ``mean_square_absolute_acceleration`` and ``peak_absolute_acceleration``, the largest size, as means over
        realizations (oscillator), with standard errors if there are at least two. At points of structures, with
        ``point_`` before the name, accelerations are those of the modes or coordinates that move them.

    Raises
    ------
    InvalidInput
        If there is no trajectory or no network, or accelerations are unknown: under noise on a body itself, with
        impacts, friction that sticks, and given motions of bodies.

    Examples
    --------
    >>> ground = il.BaseMotion(il.Harmonic(1.0, frequency=2.0))
    >>> shaken = il.Network({"a": il.LinearOscillator(damping=0.5, stiffness=10.0)}, {}, {"ground": ground})
    >>> path = il.simulate(shaken, 5.0, initial="rest", record=il.Trajectory(0.1))
    >>> il.absolute_acceleration(path).absolute_acceleration.dims
    ('realization', 'time', 'oscillator')
    """
    dataset, network = source if isinstance(source, xr.Dataset) else load(source), network_of(source)
    if not isinstance(dataset, xr.Dataset) or "displacement" not in dataset or "velocity" not in dataset:
        raise InvalidInput("There are no trajectories; repeat the run with record=il.Trajectory(interval).")
    dataset, model = on_own_axes(dataset), Model.of(network)
    whole = all(BODY in dataset[name].dims for name in ("displacement", "velocity"))
    if not whole or (model.kicks.states and STATES.name not in dataset):
        raise InvalidInput(
            "Accelerations need the trajectories of all bodies and states of laws; repeat the run with "
            "record=il.Trajectory(interval) without names= and quantities=."
        )
    _refuse_unknown(network, model)
    if "realization" not in dataset.dims:  # one that was selected
        dataset = dataset.expand_dims("realization")
    accelerations = _accelerations(network, model, dataset)
    coordinates = {name: dataset[name] for name in ("time", BODY, POINT) if name in dataset.coords}
    variables = _variables(accelerations, BODY, "")
    if network.points:
        weights = np.array([[row.get(name, 0.0) for name in model.bodies.names] for row in network.points.values()])
        variables |= _variables(accelerations @ weights.T, POINT, "point_")
    return xr.Dataset(variables, coordinates)


def _refuse_unknown(network: Network, model: Model) -> None:
    """Refuse networks whose accelerations do not follow from displacements and velocities."""
    for name, item in network.given()["excitations"].items():
        if isinstance(item, BaseMotion):
            continue
        excitation = item.excitation if isinstance(item, Source) else item
        if not isinstance(excitation, Excitation) or excitation.kind != "force":
            raise InvalidInput(
                f"The accelerations are not known, because {name!r}, {type(excitation).__name__}, acts on bodies "
                "themselves and trajectories do not hold it; as il.BaseMotion it would be a motion of the ground."
            )
    for mechanism in refusing(model, Mode.FORCES):
        raise InvalidInput(f"Accelerations are not known with {mechanism.example(model)}.")


def _accelerations(network: Network, model: Model, dataset: xr.Dataset) -> np.ndarray:
    """Return the absolute accelerations of the bodies, (realization, time, body) (m s-2)."""
    order = "time", "realization"
    x, v = (
        dataset[name].sel({BODY: list(model.bodies.names)}).transpose(BODY, *order).values
        for name in ("displacement", "velocity")
    )
    number, realizations = x.shape[1:]
    times = np.ascontiguousarray(dataset["time"].values, dtype=float)
    states = np.zeros((0, number, realizations))
    if STATES.name in dataset:
        states = dataset[STATES.name].transpose(STATES.dimension, *order).values
    most = max(1, ROWS_AT_A_TIME // realizations)
    together = 1 if model.kicks.timed.any() else min(number, most)  # times, of laws that know no time
    forces, result = Forces(model, together * realizations), np.empty(x.shape)
    for first in range(0, number, together):
        here = np.arange(first, first + together).clip(max=number - 1)  # the last one again where some are left over
        for own, values in ((forces.x, x), (forces.v, v), (forces.states, states)):
            own[:] = values[:, here].reshape(own.shape)
        forces.evaluate(times[first])
        linear = model.stiffness[:, None] * forces.x + model.damping[:, None] * forces.v
        result[:, here] = (forces.total - linear).reshape(-1, together, realizations)
    grounds = {name for name, item in network.given()["excitations"].items() if isinstance(item, BaseMotion)}
    sources = model.sources["force"]
    acting = [drive for drive in zip(*sources.drives, strict=True) if sources.names[drive[0]] not in grounds]
    if acting:
        given = np.array([forces.given(time).copy() for time in times])
        for source, body, weight in acting:
            result[body] += weight * given[:, source, None]
    return np.asarray((result / model.mass[:, None, None]).transpose(2, 1, 0))


def _variables(accelerations: np.ndarray, dimension: str, prefix: str) -> Variables:
    """Return accelerations, (realization, time, label), their mean squares and their peaks as variables."""
    name, text = f"{prefix}absolute_acceleration", "absolute acceleration" + (" at points" if prefix else "")
    dimensions = "realization", "time", dimension
    result = {name: labelled(dimensions, accelerations, "m s-2", text)}
    squares, peaks = (accelerations**2).mean(axis=1), np.abs(accelerations).max(axis=1)
    for kind, each, units, of in (
        ("mean_square", squares, "m2 s-4", "mean square"),
        ("peak", peaks, "m s-2", "mean over realizations of the largest"),
    ):
        several = len(each) > 1
        errors = each.std(axis=0, ddof=1) / np.sqrt(len(each)) if several else None
        result |= with_error(
            f"{prefix}{kind}_absolute_acceleration", (dimension,), each.mean(axis=0), errors, units, f"{of} {text}"
        )
    return result
