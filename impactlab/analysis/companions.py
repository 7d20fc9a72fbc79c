"""Companions of paths: others at a small distance, with the same noise."""

from __future__ import annotations

from contextlib import ExitStack
from types import TracebackType
from typing import Any, Self

import numpy as np
import xarray as xr

import impactlab
from impactlab.analysis.rhythm import Rhythm
from impactlab.assembly.model import Model
from impactlab.errors import InvalidInput
from impactlab.linear.laws import lines_of
from impactlab.located.rows_of_couplings import weights
from impactlab.networks.network import Network
from impactlab.plan.seed import Seed
from impactlab.records.final_state import CONTINUATION

NEAR = 1e-7
"""Distance of companions, as a part of the root mean square of a state: rounding is a millionth of it."""


def _rigid_under_white_noise(model: Model) -> list[str]:
    """Return the names of rigid contacts whose gaps are accelerated by white noise."""
    if not model.random.any():
        return []
    density = model.noise.matrix(np.arange(len(model.bodies)))
    rates = weights(model.ends) / np.where(model.bodies.free, model.mass, np.inf)
    power = np.einsum("ci,ij,cj->c", rates, density, rates)
    return [model.contacts.names[place] for place in np.flatnonzero(model.contacts.impulsive & (power > 0.0))]


class Companions:
    """Paths of a network side by side, each with companions that are put back to a small distance.

    Runs with one seed that begin as often as each other have the same noise.

    Parameters
    ----------
    network : Network
    model : Model
        The same.
    count : int
        Companions of each path.
    paths : int
    transient : float, optional
        Length of the motion before (s).
    initial : optional
        Where paths begin, as for `impactlab.simulate`.
    seed : Seed
        Of the noise.
    """

    def __init__(
        self, network: Network, model: Model, count: int, paths: int, transient: float | None, initial: Any, seed: Seed
    ) -> None:
        for contact in _rigid_under_white_noise(model):
            raise InvalidInput(
                f"White noise acts across the rigid contact {contact!r}: paths beside each other part there by the "
                "root of their distance, so that they have no Lyapunov exponents. Use a stiff il.LinearContact here."
            )
        if model.contacts.impulsive.any():
            rigid = model.contacts.names[int(np.flatnonzero(model.contacts.impulsive)[0])]
            raise InvalidInput(
                f"lyapunov follows rigid contacts such as {rigid!r} only where nothing is random and laws are linear "
                "between impacts: steps let slow bounces end in rest. Use a stiff il.LinearContact here."
            )
        if lines_of(model):
            raise InvalidInput("lyapunov knows no sums of cosines, whose phases last; use white or filtered noise.")
        self.network, self.count, self.paths, self.initial, self.seed = network, count, paths, initial, seed
        self.interval, self.settling, self.rate = Rhythm.of(model, transient)
        self.time = 0.0
        self.runs: list[impactlab.Run] = []
        self._open = ExitStack()

    def __enter__(self) -> Self:
        options: dict[str, Any] = {"realizations": self.paths, "interval": self.interval, "rng": self.seed}
        first = impactlab.Run(self.network, initial=self.initial, spin_up=self.settling, **options)
        others: dict[str, Any] = {**options, "step": first.step, "spin_up": 0.0, "initial": "rest"}
        self.runs = [first, *(impactlab.Run(self.network, **others) for _ in range(self.count))]
        for run in self.runs:
            self._open.enter_context(run)
        self.names = [str(name) for name in first.state.data_vars if name != CONTINUATION]
        state = self._values(first.state)
        self.size = np.sqrt((state**2).mean(axis=(0, 1))) or 1.0
        draws = np.random.default_rng(np.random.SeedSequence(self.seed)).normal(
            size=(self.paths, self.count, state.shape[1])
        )
        self.apart = np.linalg.qr(draws.transpose(0, 2, 1))[0].transpose(0, 2, 1)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._open.close()

    def _values(self, state: xr.Dataset) -> np.ndarray:
        """Return all states of the paths, (path, state)."""
        return np.concatenate([state[name].values.reshape(self.paths, -1) for name in self.names], axis=1)

    def _beside(self, state: xr.Dataset, apart: np.ndarray) -> xr.Dataset:
        """Return states at some distance from others, (path, state)."""
        result, first = state.copy(deep=True), 0
        for name in self.names:
            values = result[name].values
            width = values[0].size
            values += apart[:, first : first + width].reshape(values.shape)
            first += width
        return result

    def grown(self, intervals: int) -> np.ndarray:
        """Go on for some intervals; return the logarithms of the growth in each, (path, interval, companion)."""
        growths, first = np.empty((self.paths, intervals, self.count)), self.runs[0]
        distance = NEAR * self.size
        for place in range(intervals):
            state = first.state
            first.restart(state, time=0.0)
            for number, run in enumerate(self.runs[1:]):
                run.restart(self._beside(state, distance * self.apart[:, number]), time=0.0)
            for run in self.runs:
                run.advance(self.interval)
            ends = self._values(first.state)
            moved = np.stack([self._values(run.state) - ends for run in self.runs[1:]], axis=-1) / distance
            orthonormal, triangle = np.linalg.qr(moved)
            with np.errstate(divide="ignore"):
                growths[:, place] = np.log(np.abs(np.diagonal(triangle, axis1=1, axis2=2)))
            self.apart = orthonormal.transpose(0, 2, 1)
            self.time += self.interval
        return growths

    def multipliers(self) -> np.ndarray | None:
        """Companions tell no multipliers."""
        return None

    def balance(self) -> float | None:
        """Nor is there a balance."""
        return None
