"""Paths of one linear body at a rigid stop under one wave: many side by side."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from impactlab.kernels.contact_states import HELD, RIGID
from impactlab.kernels.one_body_lanes import (
    COSINE,
    FREE_GAP,
    FREE_RATE,
    GROWN,
    HITS,
    LANES,
    NEAR_BY,
    PASSED,
    RESTING,
    ROWS_OF_LANES,
    OneBody,
    one_body_loop,
)
from impactlab.located.course import Stuck
from impactlab.located.scenes import Linear
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
    statuses : (path,) ndarray
        Whether each is open, or rests at the stop.
    period : float
        Time from strobe to strobe, a whole number of periods of the wave (s).
    slow : float
        Velocity of bounces that are not followed (m s-1).
    """

    def __init__(
        self, scene: Linear, time: float, x: np.ndarray, v: np.ndarray, statuses: np.ndarray, period: float,
        slow: float,
    ) -> None:  # fmt: skip
        mass, damping, stiffness = scene.mass[0, 0], scene.damping[0, 0, 0], scene.stiffness[0, 0, 0]
        omega, link = float(scene.frequencies[0, 0]), float(scene.links[0, 0, 0])
        wave = link * scene.force[0, 0, 0] / (stiffness - mass * omega**2 + 1j * omega * damping) + scene.wall[0, 0, 0]
        wave *= np.exp(1j * omega * time)
        rest, decay = link * scene.load[0, 0] / stiffness, 0.5 * damping / mass
        self.body = OneBody(
            float(decay), float(np.sqrt(stiffness / mass - decay**2)), omega, float(rest + scene.gap[0, 0]),
            float(wave.real), float(-wave.imag), float(scene.restitution[0, 0]), period, slow,
        )  # fmt: skip
        wall = scene.wall[0, 0, 0] * np.exp(1j * omega * time)
        gap, rate = link * x + scene.gap[0, 0] + wall.real, link * v + (1j * omega * wall).real
        held = statuses == HELD
        self.paths, groups = len(x), -(-len(x) // LANES)
        self.state = np.zeros((groups, ROWS_OF_LANES, LANES))
        for row, values in (
            (FREE_GAP, np.where(held, 0.0, gap - self.body.constant - wave.real)),
            (FREE_RATE, np.where(held, 0.0, rate - (1j * omega * wave).real)),
            (RESTING, held.astype(float)),
        ):
            self.state[:, row] = np.resize(values, groups * LANES).reshape(groups, LANES)
        self.state[:, [COSINE, NEAR_BY]] = 1.0

    def grown(self, intervals: int, periods: int) -> np.ndarray:
        """Go on for intervals of some strobes; return the logarithms of the growth in each, (path, interval)."""
        growths = np.empty((len(self.state), intervals, LANES))
        loop, threads, looks = one_body_loop(), min(cores(), len(self.state)), min(LOOKS_OF_ONE_BODY, 8 * periods)

        def run(group: int) -> None:
            state = self.state[group]
            for interval in range(intervals):
                state[GROWN] = 1.0
                until = state[PASSED, 0] + periods
                for _ in range(1 + periods * MOST_LOOKS // looks):
                    if (state[PASSED] >= until).all():
                        break
                    loop(
                        self.body,
                        state.ravel(),
                        until,
                        LOOKS_OF_ONE_BODY if periods > LOOKS_OF_ONE_BODY else 8 * periods,
                    )
                else:
                    raise Stuck("A path has events without end.")
                with np.errstate(divide="ignore"):
                    growths[group, interval] = np.log(state[GROWN])

        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(run, range(len(self.state))))
        return growths.transpose(0, 2, 1).reshape(-1, intervals)[: self.paths]

    @property
    def impacts(self) -> np.ndarray:
        """How many impacts each path has had, (path,)."""
        return self.state[:, HITS].ravel()[: self.paths]

    def points(self) -> tuple[np.ndarray, np.ndarray]:
        """Return gaps and their rates at the last strobe, (path,)."""
        body, state = self.body, self.state
        resting = state[:, RESTING] > 0.0
        gap = np.where(resting, 0.0, state[:, FREE_GAP] + body.constant + body.real)
        rate = np.where(resting, 0.0, state[:, FREE_RATE] + body.omega * body.imaginary)
        return gap.ravel()[: self.paths], rate.ravel()[: self.paths]
