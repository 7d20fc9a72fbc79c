"""Paths of one linear body at a rigid stop under one wave: many side by side."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from impactlab.kernels.contact_states import RIGID
from impactlab.kernels.one_body_lanes import (
    AT_REST,
    COSINE,
    FREE_GAP,
    FREE_RATE,
    FRESH,
    GROWN,
    HITS,
    LANES,
    NEAR_BY,
    NOTED,
    PASSED,
    QUICKEST,
    RESTING,
    ROWS_OF_LANES,
    TOUCHES,
    UNTIL,
    OneBody,
    one_body_loop,
)
from impactlab.located.course import Stuck
from impactlab.located.scenes import TOUCHING, Linear
from impactlab.machine import cores

LOOKS_OF_ONE_BODY = 4096
"""Looks of a call: some milliseconds."""

MOST_LOOKS = 200_000
"""Looks in a period after which a path does not get on."""


def is_one_body(scene: Linear) -> bool:
    """Whether a scene, all of whose lanes are alike, is one body on a spring at a rigid stop, driven by one wave."""
    if scene.shape != (1, 1, 1) or scene.loads.shape[2] or scene.kinds[0] != RIGID or not scene.links.all():
        return False
    decay, square = 0.5 * scene.damping[0, 0, 0] / scene.mass[0, 0], scene.stiffness[0, 0, 0] / scene.mass[0, 0]
    return bool(square > 0.0 and decay * decay < 0.98 * square and scene.frequencies[0, 0] > 0.0)


class OneBodyPaths:
    """Paths of such a scene, with a difference each.

    Parameters
    ----------
    scene : Linear
        One lane tells the network.
    time : float
        When the paths begin (s).
    x, v : (path,) ndarray
        Where they begin.
    period : float
        Time from strobe to strobe, a whole number of periods of the wave (s).
    tolerance : float
        Height of bounces that are not followed, see `impactlab.located.event_located.EventLocated`.
    held : (path,) ndarray or bool
        Whether each rests at the stop.
    quickest : (path,) ndarray or float
        Largest closing velocity of each so far (m s-1).
    """

    def __init__(
        self, scene: Linear, time: float, x: np.ndarray, v: np.ndarray, period: float, tolerance: float,
        held: np.ndarray | bool = False, quickest: np.ndarray | float = 0.0,
    ) -> None:  # fmt: skip
        mass, damping, stiffness = scene.mass[0, 0], scene.damping[0, 0, 0], scene.stiffness[0, 0, 0]
        omega, link = float(scene.frequencies[0, 0]), float(scene.links[0, 0, 0])
        wave = link * scene.force[0, 0, 0] / (stiffness - mass * omega**2 + 1j * omega * damping) + scene.wall[0, 0, 0]
        wave *= np.exp(1j * omega * time)
        rest, decay = link * scene.load[0, 0] / stiffness, 0.5 * damping / mass
        self.body = OneBody(
            float(decay), float(np.sqrt(stiffness / mass - decay**2)), omega, float(rest + scene.gap[0, 0]),
            float(wave.real), float(-wave.imag), float(scene.restitution[0, 0]), period, tolerance**0.5,
        )  # fmt: skip
        wall = scene.wall[0, 0, 0] * np.exp(1j * omega * time)
        self.link, self.place, self.pace = link, scene.gap[0, 0] + wall.real, (1j * omega * wall).real
        gap, rate = link * x + self.place, link * v + self.pace
        self.overlap = gap > TOUCHING * (np.abs(link * x) + np.abs(scene.gap[0, 0]) + np.abs(wall))
        free, pace = gap - self.body.constant - wave.real, rate - (1j * omega * wave).real
        begins, held = self._at_stop(gap, rate, free, pace), held | self.overlap
        self.paths, groups = len(x), -(-len(x) // LANES)
        self.state = np.zeros((groups, ROWS_OF_LANES, LANES))
        held = held | (begins > 0.0)
        for row, values in (
            (FREE_GAP, np.where(held, 0.0, free)), (FREE_RATE, np.where(held, 0.0, pace)), (RESTING, held),
            (FRESH, ~held & (begins < 0.0)), (QUICKEST, np.broadcast_to(quickest, len(x))),
        ):  # fmt: skip
            self.state[:, row] = np.resize(values, groups * LANES).reshape(groups, LANES)
        self.state[:, [COSINE, NEAR_BY, GROWN]] = 1.0

    def _at_stop(self, gap: np.ndarray, rate: np.ndarray, free: np.ndarray, pace: np.ndarray) -> np.ndarray:
        """Return 1 for paths that begin at the stop without a velocity and are pressed, −1 if they are pulled, else 0.

        Paths are given by their gaps and rates, and by what the free motion is of both.
        """
        body, size = self.body, np.hypot(self.body.real, self.body.imaginary)
        still = np.abs(gap) <= TOUCHES * (np.abs(free) + np.abs(body.constant) + size)
        still &= np.abs(rate) <= AT_REST * (np.abs(pace) + body.omega * size)
        kappa, square = body.g**2 + body.w**2, body.omega**2
        pull = -2.0 * body.g * pace - kappa * free - square * body.real
        twist = (
            -kappa * pace + 2.0 * body.g * (2.0 * body.g * pace + kappa * free) - square * body.omega * body.imaginary
        )
        pull = np.where(np.abs(pull) > AT_REST * (kappa * np.abs(free) + square * size), pull, 0.0)
        pressed = (pull > 0.0) | ((pull == 0.0) & (twist >= 0.0))
        return np.asarray(np.where(still, np.where(pressed, 1.0, -1.0), 0.0))

    def grown(self, intervals: int, periods: int) -> np.ndarray:
        """Go on for intervals of some strobes; return the logarithms of the growth in each, (path, interval)."""
        with np.errstate(divide="ignore"):
            return np.asarray(np.log(self._noted(intervals, periods)[:, 3]).T)

    def points(self, number: int) -> np.ndarray:
        """Go on for some strobes; return displacement and velocity at each, (path, strobe, 2), NaN for an overlap."""
        body, (gap, rate, resting, _) = self.body, self._noted(number, 1).transpose(1, 2, 0)
        gap = np.where(resting > 0.0, 0.0, gap + (body.constant + body.real))
        rate = np.where(resting > 0.0, 0.0, rate + body.omega * body.imaginary)
        states = np.stack([gap - self.place, rate - self.pace], axis=2) / self.link
        return np.where(self.overlap[:, None, None], np.nan, states)

    def _noted(self, times: int, periods: int) -> np.ndarray:
        """Go on until each path is noted so often, after so many strobes each; return (time, 4, path)."""
        state, groups = self.state, len(self.state)
        state[:, NOTED] = 0.0
        state[:, UNTIL] = state[:, PASSED] + periods
        noted = np.empty((times, 4, groups * LANES))
        loop, threads = one_body_loop(), min(cores(), groups)
        ends = np.linspace(0, groups, threads + 1).astype(int)

        def run(first: int, last: int) -> None:
            for _ in range(1 + times * periods * MOST_LOOKS // LOOKS_OF_ONE_BODY):
                loop(self.body, state.reshape(groups, -1), float(periods), noted, LOOKS_OF_ONE_BODY, first, last)
                if (state[first:last, NOTED] == times).all():
                    return
            raise Stuck("A path has events without end.")

        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(run, ends[:-1], ends[1:]))
        return noted[:, :, : self.paths]

    @property
    def impacts(self) -> np.ndarray:
        """How many impacts each path has had, (path,)."""
        return self.state[:, HITS].ravel()[: self.paths]
