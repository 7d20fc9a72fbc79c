"""How realizations begin."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from impactlab.kernels.random import addresses
from impactlab.linear import linear_variances
from impactlab.model import Model
from impactlab.plan.subdomains import Tile
from impactlab.scene import Stiffening, start_factors


@dataclass(frozen=True, eq=False)
class Start:
    """Where realizations begin.

    Attributes
    ----------
    state : str or (2, body) ndarray
        "stationary", "rest", or displacements and velocities.
    streams : (3, body) ndarray of uint64
        Addresses of a random start.
    deviations : (2, body) ndarray
        Standard deviations of displacement and velocity under white noise, for a stationary start.
    factors : tuple
        Pairs for such a start: slots of bodies that couplings connect, root of the covariance of their (x, v).
    rest : (body,) ndarray
        Displacements of bodies that start at rest (m).
    """

    state: str | np.ndarray
    streams: np.ndarray
    deviations: np.ndarray
    factors: tuple[tuple[np.ndarray, np.ndarray], ...]
    rest: np.ndarray

    @classmethod
    def of(
        cls, model: Model, state: str | np.ndarray, stiffening: Stiffening, temperature: np.ndarray,
        seed: tuple[int, int],
    ) -> Start:  # fmt: skip
        """Return a start.

        Parameters
        ----------
        model : Model
        state : str or ndarray
            What was asked for.
        stiffening : Stiffening
            The scene at its energies.
        temperature : (body,) ndarray
            What is expected of bodies that nothing but contacts heats (J), NaN elsewhere.
        seed : tuple of int
            128 bits.
        """
        drawn = model.bodies if isinstance(state, str) and state == "stationary" else ()
        return cls(
            state, addresses(seed, drawn, "start"), _deviations(model, stiffening, temperature),
            start_factors(model, stiffening, temperature), stiffening.rest,
        )  # fmt: skip

    @property
    def given(self) -> bool:
        """Whether displacements and velocities are given."""
        return isinstance(self.state, np.ndarray)

    def restricted(self, tile: Tile) -> Start:
        """Return the start of a tile, whose state is that of the network at each call."""
        return replace(
            self, state=np.zeros((2, len(tile.bodies))), streams=self.streams[:, :0],
            deviations=self.deviations[:, tile.bodies], factors=(), rest=self.rest[tile.bodies],
        )  # fmt: skip


def _deviations(model: Model, stiffening: Stiffening, temperature: np.ndarray) -> np.ndarray:
    """Standard deviations under white noise alone, 0 for other bodies, (2, body).

    They are the linear ones, but a residual force that stiffens a body narrows its displacement. Bodies that nothing
    but contacts can heat start at the temperature that is expected of them, where it is known.
    """
    velocity = linear_variances(model)[1]
    velocity = np.where(np.isfinite(temperature), temperature / model.mass, velocity)
    with np.errstate(divide="ignore", invalid="ignore"):
        variances = np.stack([model.mass * velocity / (model.stiffness + stiffening.bodies), velocity])
    variances[~np.isfinite(variances)] = 0.0
    variances[:, list(model.lines)] = 0.0
    result: np.ndarray = np.sqrt(variances)
    return result
