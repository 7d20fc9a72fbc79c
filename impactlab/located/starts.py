"""Where lanes start: at given states, or at rest."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from impactlab.assembly.model import Model
from impactlab.located.given_waves import given_waves
from impactlab.located.scenes import Linear
from impactlab.located.sliders import sliders_at


class Scene(Protocol):
    """A network as a lane."""

    def at_rest(self) -> np.ndarray: ...


def first_states(
    model: Model, scene: Scene, start: str | np.ndarray, states: np.ndarray, time: float, lanes: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return displacements and velocities of free bodies, and of sliders behind them, (lane, coordinate).

    Lanes start at displacements and velocities of all bodies, (2, body, lane), or at rest where these are a word, with
    states of laws, (state, lane), at a time (s).
    """
    free = model.bodies.free
    if isinstance(start, str):
        x, v = np.zeros((2, lanes, len(free)))
        x[:, free] = scene.at_rest()[:, : free.sum()]
    else:
        x, v = np.broadcast_to(start, (2, len(free), lanes)).transpose(0, 2, 1).copy()
    if not isinstance(scene, Linear):
        return x[:, free], v[:, free]
    for slot, wave in given_waves(model):
        x[:, slot] = wave.at(time)[0]
    sliders = sliders_at(model, x, states)
    return np.concatenate([x[:, free], sliders], axis=1), np.concatenate([v[:, free], 0.0 * sliders], axis=1)
