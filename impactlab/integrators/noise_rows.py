"""Rows of a white noise that drives several bodies: the bodies that each normal number of a step moves, and how far."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from impactlab.assembly.model import Model
from impactlab.assembly.remembered import kept
from impactlab.errors import InvalidInput
from impactlab.integrators.arguments import NoiseRows
from impactlab.linear.laws import MOST_TOGETHER, flowing_systems, joined_systems
from impactlab.linear.transitions import lower_root, split_noise, system_response, system_transition


@kept
def with_own_noise(model: Model) -> Model:
    """Return the model without the white noises that have a name of their own; itself where there are none."""
    noises = model.sources["intensity"]
    return replace(model, sources={**model.sources, "intensity": noises.only_own()}) if noises.beyond_own else model


def rows_of_source(model: Model, split: np.ndarray, step: float, number: int, places: Sequence[float]) -> NoiseRows:
    """Return the rows of the white noise of some number in a model, which has a name of its own.

    Its first normal is its integral over the step (s), the same for all bodies. Where it is `split` it acts on bodies
    at one moment of the step, one of the `places` for each phase of the method, as parts of the step: these take
    nothing else. The motion of the others has a part that this determines, and one that is independent of it, for which
    they take further normals: the covariance of all that they do is exact at any step.
    """
    noises, density = model.sources["intensity"], float(model.noise.reference_density[number])
    slots, weights = noises.driven(number)
    size, at_once = weights * math.sqrt(2.0 * math.pi * density), split[slots]
    m, c, k = (item[slots[at_once]] for item in (model.mass, model.damping, model.stiffness))
    bodies, numbers = [slots[at_once]], [np.zeros(int(at_once.sum()), dtype=np.int64)]
    columns = [split_noise(m, c, k, size[at_once], step, places)]
    if not at_once.all():
        moving, normals = _motion(model, slots[~at_once], size[~at_once], step)
        for column in range(normals.shape[2]):
            reached = normals[:, :, column].any(axis=1)
            bodies.append(moving[reached])
            numbers.append(np.full(int(reached.sum()), column))
            columns.append(np.broadcast_to(normals[reached, :, column], (len(places), int(reached.sum()), 2)))
    rows = np.concatenate(bodies)
    names, same = (noises.names[number],) * len(rows), np.full(len(rows), number)
    return NoiseRows(rows, names, np.concatenate(numbers), same, np.concatenate(columns, axis=1))


def _motion(model: Model, driven: np.ndarray, size: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the motion that a noise gives in a step (s) to its bodies and to the bodies of their groups.

    Given are the slots of the driven bodies, and the root of 2π times the spectral density of the force on
    each, with its sign, (n,). Returned are slots, (body,), and displacements and velocities by the normals,
    (body, 2, normal).
    """
    slots, system = joined_systems(model, flowing_systems(model), [driven])[-1]
    count, rate = len(slots), sum(system.scales)
    if count > MOST_TOGETHER:
        raise InvalidInput(
            f"One white noise moves {count} bodies that no contact touches, or that are strongly damped, at a time; "
            f"the exact flow takes {MOST_TOGETHER} of them. Use il.EulerMaruyama(), or several sources."
        )
    forces = np.zeros(count)
    forces[np.searchsorted(slots, driven)] = size
    matrices = system.mass, system.damping, system.stiffness
    _, covariance = system_transition(*matrices, np.outer(forces, forces) / (2.0 * math.pi), step, rate)
    held = system_response(*matrices, step, rate)[0] @ forces / math.sqrt(step)  # by what its integral tells of it
    by_body = np.arange(2 * count).reshape(2, count).T.ravel()  # x and v of a body follow each other
    rest = (covariance - np.outer(held, held))[np.ix_(by_body, by_body)]
    root = lower_root(rest, np.diag(covariance)[by_body])
    columns = np.column_stack([held[by_body], root[:, root.any(axis=0)]])
    return slots, columns.reshape(count, 2, -1)
