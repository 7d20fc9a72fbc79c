"""White noise."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from impactlab.assembly.incidence import runs
from impactlab.assembly.model import Model
from impactlab.integrators.base import Integrator
from impactlab.kernels.random import streams_of
from impactlab.plan.subdomains import Tile


@dataclass(frozen=True, eq=False)
class WhiteNoises:
    """White noise on some bodies.

    Attributes
    ----------
    white : (white,) ndarray of int
        Slots of these bodies.
    rows : (row,) ndarray of int
        Slots of the bodies by row of noise; second rows of some come last.
    runs : (run, 3) ndarray of int
        Bodies that follow each other, as do their first rows: first body, its row or -1, number.
    amplitude : (phase, 2, row) ndarray
        Amplitude of the rows.
    streams : (3, row) ndarray of uint64
        Addresses of the noise.
    intensity : (white,) ndarray
        Density of the noise on `white` that the amplitudes were made with.
    time_varying : bool
        Whether it depends on time.
    random : (body,) ndarray of bool
        Whether noise of any kind reaches each body.
    coarse : bool
        Whether a step takes the noise that a run at half the step has in two.
    """

    white: np.ndarray
    rows: np.ndarray
    runs: np.ndarray
    amplitude: np.ndarray
    streams: np.ndarray
    intensity: np.ndarray
    time_varying: bool
    random: np.ndarray
    coarse: bool

    @classmethod
    def of(cls, model: Model, integrator: Integrator, step: float, seed: tuple[int, int], coarse: bool) -> WhiteNoises:
        """Return the white noise of a model as a method takes it at a step (s)."""
        white = np.array(model.white, dtype=np.int64)
        rows, amplitude = integrator.noise(model, step)
        return cls(
            white=white,
            rows=rows,
            runs=_runs(rows, len(model.bodies)),
            amplitude=np.ascontiguousarray(amplitude.transpose(0, 2, 1)),
            streams=streams_of(seed, [model.bodies[slot] for slot in rows]),
            intensity=model.reference_intensities()[white],
            time_varying=model.time_varying,
            random=model.random,
            coarse=coarse,
        )

    def restricted(self, tile: Tile) -> WhiteNoises:
        """Return the noise on the bodies of a tile; the density belongs to the network, it is constant there."""
        place = np.full(len(self.random), -1)
        place[tile.bodies] = np.arange(len(tile.bodies))
        chosen = np.flatnonzero(place[self.rows] >= 0)
        _, first = np.unique(self.rows[chosen], return_index=True)
        second = np.ones(len(chosen), dtype=bool)
        second[first] = False
        chosen = chosen[np.lexsort((place[self.rows[chosen]], second))]
        rows = place[self.rows[chosen]]
        return replace(
            self,
            rows=rows,
            runs=_runs(rows, len(tile.bodies)),
            amplitude=np.ascontiguousarray(self.amplitude[:, :, chosen]),
            streams=np.ascontiguousarray(self.streams[:, chosen]),
            random=self.random[tile.bodies],
        )


def _runs(rows: np.ndarray, bodies: int) -> np.ndarray:
    """Return bodies that follow each other, as do their first rows of noise; see `WhiteNoises.runs`."""
    row, every = np.full(bodies, -1), np.arange(bodies)
    slots, first = np.unique(rows, return_index=True)
    row[slots] = first
    begin, _, count = runs(every, constant=[np.where(row < 0, -bodies, row - every)])
    return np.stack([begin, row[begin], count], axis=1)
