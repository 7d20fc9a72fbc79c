"""Springs in series with dry friction: where their sliders are is a coordinate behind those of bodies.

A slider that sticks is held where it is, and the spring pulls at it. One that slips pulls with the slip force, and is
where the spring has this force.
"""

from __future__ import annotations

import numpy as np

from impactlab.assembly.model import Model
from impactlab.kernels.contact_states import JENKINS, SLIPS_UP, STICKS
from impactlab.located.rows_of_couplings import sliding_couplings, weights
from impactlab.located.scenes import Linear


def with_sliders(scene: Linear, directions: np.ndarray) -> np.ndarray:
    """Return directions of all rows, those of springs with sliders as elongations of the springs, (lane, row, body)."""
    result, rows, places = directions.copy(), *_places(scene)
    result[:, rows, places] = -1.0
    return result


def held_directions(scene: Linear, directions: np.ndarray) -> np.ndarray:
    """Return directions of all rows, in the place of those of springs with sliders those of the sliders."""
    result, rows, places = directions.copy(), *_places(scene)
    result[:, rows] = 0.0
    result[:, rows, places] = 1.0
    return result


def let_slip(scene: Linear, lanes: np.ndarray, status: np.ndarray, motion: tuple[np.ndarray, ...]) -> None:
    """Let sliders that slip be where their springs have the slip force, and those that stick at rest.

    The motion is that into and out of pairs, its offset and its waves; see `impactlab.located.modes.Motions`.
    """
    into, outof, offset, waves = motion
    bodies, (rows, places) = scene.mass.shape[1], _places(scene)
    into[:, :, bodies + places] = 0.0
    frequency = scene.frequencies[lanes]
    for row, place in zip(rows, places, strict=True):
        if status[row] == STICKS:
            continue
        link, wall = scene.links[lanes, row, None], scene.wall[lanes, row]
        for first, swing in ((0, wall), (bodies, 1j * frequency * wall)):
            own = slice(first, first + bodies)
            outof[:, first + place] = (link @ outof[:, own])[:, 0]
            offset[:, first + place] = (link[:, 0] * offset[:, own]).sum(axis=1)
            waves[:, first + place] = (link @ waves[:, own])[:, 0] + swing
        way = 1.0 if status[row] == SLIPS_UP else -1.0
        offset[:, place] += scene.gap[lanes, row]
        offset[:, place] -= way * scene.frictions[lanes, row, 0] / scene.springs[lanes, row]


def sliders_at(model: Model, x: np.ndarray, states: np.ndarray) -> np.ndarray:
    """Return where sliders are at some displacements of all bodies and states of laws, (realization, slider)."""
    result, labels = [], [label for label, _ in model.kicks.states]
    for extension, (row, law) in zip(_extensions(model, x), sliding_couplings(model), strict=True):
        pull, last = (states[labels.index(f"{model.couplings.names[row]}.{name}")] for name in ("pull", "last"))
        force = np.clip(pull + law.stiffness * (extension - last), -law.slip_force, law.slip_force)
        result.append(extension - force / law.stiffness)
    return np.array(result).reshape(len(result), len(x)).T


def states_at(model: Model, x: np.ndarray, sliders: np.ndarray) -> np.ndarray:
    """Return the states of laws at some displacements of all bodies and places of sliders, (…, state)."""
    labels = [label for label, _ in model.kicks.states]
    result = np.zeros((*x.shape[:-1], len(labels)))
    for number, (row, law) in enumerate(sliding_couplings(model)):
        extension, name = _extensions(model, x)[number], model.couplings.names[row]
        result[..., labels.index(f"{name}.last")] = extension
        result[..., labels.index(f"{name}.pull")] = law.stiffness * (extension - sliders[..., number])
    return result


def _extensions(model: Model, x: np.ndarray) -> np.ndarray:
    """Return the extensions of couplings with sliders, (coupling, …)."""
    rows = [row for row, _ in sliding_couplings(model)]
    return np.moveaxis(-x @ weights(model.coupled)[rows].T, -1, 0)


def _places(scene: Linear) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows of springs with sliders, and the coordinates of these."""
    rows = np.flatnonzero(scene.kinds == JENKINS)
    return rows, scene.mass.shape[1] - len(rows) + np.arange(len(rows))
