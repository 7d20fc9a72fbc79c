"""Differences of paths, carried exactly along motion that is linear between events."""

from __future__ import annotations

from types import TracebackType
from typing import Any, Self

import numpy as np

from impactlab.analysis.found_points import overlap_text
from impactlab.analysis.one_body import OneBodyPaths, is_one_body
from impactlab.analysis.rhythm import Rhythm
from impactlab.assembly.model import Model
from impactlab.errors import InvalidInput
from impactlab.kernels.contact_states import DASHPOT, FRICTION, HELD, RIGID
from impactlab.kernels.from_event_to_event import CHATTERS, CLOSINGS, FASTEST, RATIO, Span
from impactlab.located.course import Course, Stuck
from impactlab.located.event_located import EventLocated
from impactlab.located.findings import Wanted
from impactlab.located.scenes import as_lanes
from impactlab.networks.network import Network
from impactlab.plan.seed import Seed
from impactlab.plan.start import start_of, states_of
from impactlab.simulation.restart import given_by

SPREAD_OF_PATHS = 1e-7
"""Differences between the velocities of paths where they begin, as a part of the largest state."""

MOST_GROWTH = 8.0
"""Largest logarithm of the growth in an interval: differences stay linearly independent to seven digits."""

PILOT, MOST_JOINED = 32, 64
"""Intervals in which the growth is seen beforehand, and how many of them may be joined to one."""

PERIODS = 64
"""Periods in an interval of one body: growths beyond 1e300 are not known, and lanes wait for each other at its end."""

REPEATS = 32
"""Intervals after which a motion may repeat, at most."""

CLOSED_ORBIT = 1e-9
"""Part of the size of a motion up to which it has come back to where it was."""


class Tangents:
    """Paths of a network side by side, and small differences from each that are kept orthonormal.

    Parameters
    ----------
    network : Network
    model : Model
        The same, linear between events, without noise.
    count : int
        Differences of each path.
    paths : int
    transient : float, optional
        Length of the motion before (s).
    initial : optional
        Where paths begin, as for `impactlab.simulate`.
    seed : Seed
        Of the differences between the paths.
    """

    def __init__(
        self, network: Network, model: Model, count: int, paths: int, transient: float | None, initial: Any, seed: Seed
    ) -> None:
        self.model, self.count, self.paths = model, count, paths
        self.base, settling, self.rate = Rhythm.of(model, transient)
        self.interval = self.base
        given = given_by(initial, network, None)
        states = states_of(given, model)
        states = model.members.states[:, None] if states is None else states
        method = EventLocated()
        self.begun = Wanted(model, method, start_of(given, model), 1, 1.0, 0.0, (), None, {}, states)
        alone = self._course(1, 0.0, *self.begun.at_start())
        for contact in np.flatnonzero(alone.overlap[0]).tolist():
            raise InvalidInput(overlap_text(self.begun.rows[contact], alone.overlap[0, contact]))
        self._to(alone, settling)
        x, v = alone.lanes.x, alone.lanes.v
        size = max(np.abs(x).max(initial=0.0), np.abs(v).max(initial=0.0)) or 1.0
        draws = np.random.default_rng(np.random.SeedSequence(seed)).normal(size=(paths, v.shape[1]))
        draws[0] = 0.0
        self.course = self._course(paths, settling, np.repeat(x, paths, axis=0), v + SPREAD_OF_PATHS * size * draws)
        self._to(self.course, settling)
        self._follow(count)
        self._choose_interval()
        self.course.lanes.contacts[:, [CLOSINGS, CHATTERS, RATIO]] = 0.0
        self.time, self.alone = 0.0, count == 1 and is_one_body(self.course.scene)
        self.fast: OneBodyPaths | None = None
        if self.alone:
            self.interval = self.base * PERIODS

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        pass

    def _course(self, paths: int, begin: float, x: np.ndarray, v: np.ndarray) -> Course:
        scene = as_lanes([self.begun.scene] * paths)  # type: ignore[list-item]
        times = np.full(paths, begin), np.full(paths, begin), np.zeros((paths, 0))
        return Course(scene, x, v, *times, Span(EventLocated().tolerance, bool(scene.dampers.any())))

    def _to(self, course: Course, length: float, samples: int = 0) -> None:
        """Let a course go on for some time (s), with samples at the ends of equal parts."""
        begin = course.end
        times = begin[:, None] + length / max(samples, 1) * np.arange(1, samples + 1)
        course.go_on(begin + length if not samples else times[:, -1], times)
        course.run(lambda lane, contact: self.begun.rows[contact])
        if course.stuck:
            raise Stuck(next(iter(course.stuck.values())))

    def _follow(self, count: int, orthonormal: bool = True) -> None:
        identity = np.eye(2 * self.course.lanes.x.shape[1])[:count]
        self.course.follow(np.repeat(identity[None], self.paths, axis=0), orthonormal)

    def _choose_interval(self) -> None:
        """Join intervals as long as differences do not grow or shrink too much in them."""
        self._to(self.course, PILOT * self.base, PILOT)
        growths = self.course.lanes.growths
        finite = growths[np.isfinite(growths)]
        most = np.ptp(finite) + np.abs(finite).max() if finite.size else MOST_GROWTH
        self.interval = self.base * min(MOST_JOINED, max(1, int(MOST_GROWTH / max(most, 1e-300))))

    def grown(self, intervals: int) -> np.ndarray:
        """Go on for some intervals; return the logarithms of the growth in each, (path, interval, difference)."""
        if self.alone:
            return self._grown_alone(intervals)
        self._to(self.course, intervals * self.interval, intervals)
        self.time += intervals * self.interval
        return self.course.lanes.growths.copy()

    def _grown_alone(self, intervals: int) -> np.ndarray:
        """Let paths of one body go on in the lanes of vectors, which takes a fifth of the time."""
        if self.fast is None:
            lanes = self.course.lanes
            self.fast = OneBodyPaths(
                self.course.scene, self.course.end[0], lanes.x[:, 0], lanes.v[:, 0], self.base,
                EventLocated().tolerance, lanes.statuses[:, 0] == HELD, lanes.contacts[:, FASTEST, 0],
            )  # fmt: skip
        self.time += intervals * self.interval
        return self.fast.grown(intervals, PERIODS)[:, :, None]

    def multipliers(self) -> np.ndarray | None:
        """Return the exponents by Floquet multipliers if all paths are at periodic motions with the same ones."""
        course, bodies = self.course, self.course.lanes.x.shape[1]
        if self.fast is not None:
            return None
        points = course.lanes.samples[:, :, : 2 * bodies]
        repeats = min(REPEATS, points.shape[1] - 1)
        size = np.abs(points).max(axis=(0, 1)) + np.finfo(float).tiny
        back = np.abs(points[:, -1:] - points[:, -1 - repeats : -1]) <= CLOSED_ORBIT * size
        periods = repeats - np.flatnonzero(back.all(axis=(0, 2)))
        if not periods.size:
            return None
        period = int(periods.min()) * round((course.lanes.times[0, -1] - course.lanes.times[0, -2]) / self.base)
        self._follow(2 * bodies, orthonormal=False)
        course.lanes.contacts[:, [CLOSINGS, CHATTERS, RATIO]], self.time = 0.0, 0.0
        begins = np.concatenate([course.lanes.x, course.lanes.v], axis=1)
        self._to(course, period * self.base)
        self.time = period * self.base
        ends = np.concatenate([course.lanes.x, course.lanes.v], axis=1)
        maps = course.lanes.differences[:, 1:].transpose(0, 2, 1)
        self._follow(self.count)
        if not (np.abs(ends - begins) <= CLOSED_ORBIT * size).all():
            return None
        with np.errstate(divide="ignore"):
            rates = np.sort(np.log(np.abs(np.linalg.eigvals(maps))) / self.time, axis=1)[:, ::-1]
        found = rates[:, : self.count]
        same = np.isclose(found, found[0], rtol=1e-6, atol=1e-6 * self.rate)
        return found[0] if same.all() else None

    def balance(self) -> float | None:
        """Return the sum of all exponents, from dampers, restitutions and impacts of the paths, if they tell it."""
        scene, lanes = self.course.scene, self.course.lanes
        parting = (scene.kinds == DASHPOT) & scene.dampers.any(axis=0)  # their dampers act for an unknown time
        if (parting | (scene.kinds >= FRICTION)).any():
            return None
        inverse = (scene.links**2 / scene.mass[:, None, :]).sum(axis=-1)
        total = -(np.diagonal(scene.damping, axis1=1, axis2=2) / scene.mass).sum(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            lost = 2.0 * lanes.contacts[:, CLOSINGS] / self.time * np.log(scene.restitution)
            rigid = np.where(lanes.contacts[:, CLOSINGS] > 0.0, lost, 0.0)
        rests = (lanes.contacts[:, CHATTERS] > 0.0) | (lanes.statuses == HELD)
        rigid = np.where(rests, -np.inf, rigid)
        soft = -scene.dampers * inverse * lanes.contacts[:, RATIO] / self.time
        total = total + np.where(scene.kinds == RIGID, rigid, soft).sum(axis=1)
        return float(total.mean())
