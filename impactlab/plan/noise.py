"""White noise."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from impactlab.assembly.incidence import runs
from impactlab.assembly.model import Model
from impactlab.assembly.remembered import remembered
from impactlab.integrators.base import Integrator
from impactlab.kernels.random import streams_of
from impactlab.plan.subdomains import Tile, refuse_to_cut


class Shares(NamedTuple):
    """How much of the density of the white noise on each body is that of each noise."""

    noise: np.ndarray  # (pair,) number of the noise
    body: np.ndarray  # (pair,) place of the body among those under white noise
    share: np.ndarray  # (pair,)
    noises: int  # how many there are
    bodies: int

    @classmethod
    def of(cls, model: Model, intensity: np.ndarray) -> Shares:
        """Return the shares of noise in a model with given spectral densities of the bodies, (body,)."""
        noises = model.sources["intensity"]
        number, body, weight = noises.drives
        with np.errstate(invalid="ignore"):
            share = weight**2 * model.noise.reference_density[number] / intensity[body]
        white = noises.bodies
        return cls(number, np.searchsorted(white, body), share, len(noises.names), len(white))

    def added(self, factor: np.ndarray) -> np.ndarray:
        """Return by what the density on each body changes, (n, body), where those of all noises do, (n, noise)."""
        result = np.zeros((self.bodies, len(factor)))
        np.add.at(result, self.body, (self.share * factor[:, self.noise]).T)
        return result.T


@dataclass(frozen=True, eq=False)
class WhiteNoises:
    """White noise on some bodies."""

    white: np.ndarray  # (white,) slots of these bodies
    rows: np.ndarray  # (row,) slots of the bodies by row of noise; second rows of some come last
    runs: np.ndarray
    """Runs of successive bodies whose first rows are successive too, (run, 3): first body, its row or -1, length."""
    amplitude: np.ndarray  # (phase, 2, row) of the rows
    streams: np.ndarray  # (3, row) addresses of the noise
    intensity: np.ndarray  # (white,) density of the noise on `white` that the amplitudes were made with
    shares: Shares  # of each noise in the density on each body
    noises: np.ndarray  # (row,) which noise it is
    time_varying: bool  # whether densities depend on time
    random: np.ndarray  # (body,) whether noise of any kind reaches each body
    common: np.ndarray  # (body,) whether a noise on each body drives others, too
    coarse: bool  # whether a step takes the noise that a run at half the step has in two

    @classmethod
    def of(cls, model: Model, integrator: Integrator, step: float, seed: tuple[int, int], coarse: bool) -> WhiteNoises:
        """Return the white noise of a model as a method takes it at a step (s)."""
        white = np.array(model.sources["intensity"].bodies, dtype=np.int64)
        rows = integrator.noise(model, step)
        intensity = model.noise.reference_intensity
        common = np.zeros(len(model.bodies), dtype=bool)
        for slots in model.sources["intensity"].joining:
            common[slots] = True
        return cls(
            white=white,
            rows=rows.bodies,
            runs=noise_runs(rows.bodies, len(model.bodies)),
            amplitude=np.ascontiguousarray(rows.amplitude.transpose(0, 2, 1)),
            streams=streams_of(seed, rows.streams, rows.numbers.tolist()),
            intensity=intensity[white],
            shares=Shares.of(model, intensity),
            noises=rows.noises,
            time_varying=model.noise.varying,
            random=model.random,
            common=common,
            coarse=coarse,
        )

    @cached_property
    def distinct(self) -> tuple[np.ndarray, np.ndarray]:
        """Addresses of the streams that differ, (3, stream), and which of them each row has, nothing if all differ."""
        if not self.common.any():
            return self.streams, np.zeros(0, dtype=np.int64)
        streams, which = np.unique(self.streams, axis=1, return_inverse=True)
        return np.ascontiguousarray(streams), which.reshape(-1).astype(np.int64)

    def restricted(self, tile: Tile) -> WhiteNoises:
        """Return the noise on the bodies of a tile, where each has its own of constant density; else refuse."""
        refuse_to_cut(self, self.time_varying or self.common.any())
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
            runs=noise_runs(rows, len(tile.bodies)),
            amplitude=np.ascontiguousarray(self.amplitude[:, :, chosen]),
            streams=np.ascontiguousarray(self.streams[:, chosen]),
            noises=self.noises[chosen],
            random=self.random[tile.bodies],
            common=self.common[tile.bodies],
        )


@remembered
def noise_runs(rows: np.ndarray, bodies: int) -> np.ndarray:
    """Return bodies that follow each other, as do their first rows of noise; see `WhiteNoises.runs`."""
    row, every = np.full(bodies, -1), np.arange(bodies)
    slots, first = np.unique(rows, return_index=True)
    row[slots] = first
    begin, _, count = runs(every, constant=[np.where(row < 0, -bodies, row - every)])
    return np.stack([begin, row[begin], count], axis=1)
