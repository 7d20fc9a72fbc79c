"""The map from section to section of one network, for any number of starts."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from typing import Any

import numpy as np

import impactlab
from impactlab.analysis.found_points import TOLERANCE, drifts_of
from impactlab.analysis.one_body import OneBodyPaths, is_one_body
from impactlab.analysis.prepared import Prepared
from impactlab.errors import InvalidInput
from impactlab.kernels.from_event_to_event import Span
from impactlab.located.course import Course, Stuck
from impactlab.located.scenes import Linear
from impactlab.located.smooth import Smooth
from impactlab.located.smooth_course import SmoothCourse
from impactlab.records.surface import Surface

STEP = 1e-6
"""Part of the sizes of a motion by which states are changed to find how differences grow along it."""

AT_A_TIME = 16384
"""Starts of a call, so that memory is bounded and interrupts are answered."""


class Laps:
    """A network from section to section.

    Parameters
    ----------
    prepared : Prepared
        The network; the states of its laws follow from displacements and velocities.
    """

    def __init__(self, prepared: Prepared) -> None:
        self.prepared, self.period = prepared, prepared.strobe.period
        self.coordinates = len(prepared.begin(None)[0][0]) // 2
        model, scene = prepared.model, prepared.scene
        self.one_body = scene if isinstance(scene, Linear) and is_one_body(scene) else None
        if prepared.surface is not None:
            raise InvalidInput(f"section: il.basins looks at motions by an il.Strobe, not {prepared.surface!r}.")
        if isinstance(prepared.scene, Linear) and drifts_of(prepared.scene).shape[1]:
            raise InvalidInput("Nothing holds this network, which drifts: it has no attractors at places of their own.")
        if isinstance(prepared.scene, Smooth) and model.kicks.states:
            raise InvalidInput(
                f"il.basins knows no laws with states such as {model.kicks.states[0][0]!r}, which starts do not tell; "
                "use il.bifurcation with initial=."
            )

    @classmethod
    def of(cls, network: impactlab.Network, section: Surface | None) -> Laps:
        """Return the map of a network, or refuse it; where nothing varies in time, any period tells its rests."""
        return cls(Prepared.of(network, section, "il.basins", any_period=True))

    def begin(self, initial: Mapping[str, Any] | None) -> np.ndarray:
        """Return the state, (2 coordinate,), at rest or at given displacements and velocities."""
        return np.asarray(self.prepared.begin(initial)[0][0])

    def around(self, states: np.ndarray, number: int) -> np.ndarray:
        """Return the points that follow states, (start, 2 coordinate), as (start, point, 2 coordinate).

        They are NaN where hard bodies overlap, or a motion cannot be followed.
        """
        result = np.full((len(states), number, states.shape[1]), np.nan)
        for first in range(0, len(states), AT_A_TIME):
            part = slice(first, min(first + AT_A_TIME, len(states)))
            self._around(states[part], number, result[part])
        return result

    def overlap(self, states: np.ndarray) -> np.ndarray:
        """Return whether hard bodies overlap in states, (start,)."""
        return np.asarray(self._course(states, 1).overlap.any(axis=1))

    def _course(self, states: np.ndarray, number: int) -> Course | SmoothCourse:
        """Return the lanes of some starts, for a number of points."""
        x, v = np.split(states, 2, axis=1)
        begin = np.full(len(x), self.prepared.strobe.start)
        times, span = begin[:, None] + self.period * np.arange(1, number + 1), Span(TOLERANCE, False)
        scene = self.prepared.scene
        if isinstance(scene, Linear):
            lanes = scene.lanes(np.zeros(len(x), np.int64))
            return Course(lanes, x, v, begin, times[:, -1], times, span, one=True)
        laws = np.zeros((len(x), 0))
        return SmoothCourse([scene] * len(x), x, v, laws, begin, times[:, -1], times, span, compared=False)

    def _around(self, states: np.ndarray, number: int, result: np.ndarray) -> None:
        if self.one_body is not None:
            begin, (x, v) = self.prepared.strobe.start, states.T
            with contextlib.suppress(Stuck):  # events of one path without end, which others are not to pay for
                result[:] = OneBodyPaths(self.one_body, begin, x, v, self.period, TOLERANCE).points(number)
                return
        course = self._course(states, number)
        free = np.asarray(~course.overlap.any(axis=1))
        if isinstance(course, Course):
            course.chosen = free
        elif not free.all():
            others = np.full((int(free.sum()), *result.shape[1:]), np.nan)
            if len(others):
                self._around(states[free], number, others)
            result[free] = others
            return
        course.run(self._name)
        free[list(course.stuck)] = False
        result[free] = course.lanes.samples[free, :, : states.shape[1]]

    def monodromies(self, points: np.ndarray, sizes: np.ndarray) -> np.ndarray:
        """Return how small differences, in units of sizes, grow from each point of a motion on over its period.

        They are exact where motion is linear between events. Points are (point, 2 coordinate).
        """
        period, count = points.shape
        if isinstance(self.prepared.scene, Linear):
            course = self._course(points, period)
            assert isinstance(course, Course)
            course.follow(np.tile(np.eye(count), (period, 1, 1)), orthonormal=False)
            course.run(self._name)
            grown = course.lanes.differences[:, 1:]
        else:
            shifts = STEP * np.diag(sizes)
            starts = np.concatenate([points[:, None] + shifts, points[:, None] - shifts], axis=1)
            ends = self.around(starts.reshape(-1, count), period)[:, -1].reshape(period, 2, count, count)
            there = np.asarray(np.isfinite(ends).all(axis=3))  # not beyond a hard stop
            one, other = np.where(there[..., None], ends, points[:, None, None]).transpose(1, 0, 2, 3)
            ways = np.maximum(there.sum(axis=1), 1)[:, :, None]
            grown = (one - other) / (ways * STEP * sizes[:, None])
        return np.asarray(grown.transpose(0, 2, 1) * sizes / sizes[:, None])

    def _name(self, lane: int, contact: int) -> str:
        return self.prepared.row_names()[contact]
