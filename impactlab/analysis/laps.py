"""The map from section to section of one network, for any number of starts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from impactlab.analysis.found_points import TOLERANCE
from impactlab.analysis.prepared import Prepared
from impactlab.errors import InvalidInput
from impactlab.kernels.from_event_to_event import Span
from impactlab.located.course import Course
from impactlab.located.scenes import Linear
from impactlab.located.smooth import Smooth
from impactlab.located.smooth_course import SmoothCourse

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
        model = prepared.model
        if prepared.surface is not None:
            raise InvalidInput(f"section: il.basins looks at motions by an il.Strobe, not {prepared.surface!r}.")
        if isinstance(prepared.scene, Smooth) and model.kicks.states:
            raise InvalidInput(
                f"il.basins knows no laws with states such as {model.kicks.states[0][0]!r}, which starts do not tell; "
                "use il.bifurcation with initial=."
            )

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

    def _around(self, states: np.ndarray, number: int, result: np.ndarray) -> None:
        x, v = np.split(states, 2, axis=1)
        begin = np.full(len(x), self.prepared.strobe.start)
        times, span = begin[:, None] + self.period * np.arange(1, number + 1), Span(TOLERANCE, False)
        scene = self.prepared.scene
        course: Course | SmoothCourse
        if isinstance(scene, Linear):
            lanes = scene.lanes(np.zeros(len(x), np.int64))
            course = Course(lanes, x, v, begin, times[:, -1], times, span, one=True)
            course.chosen = np.asarray(~course.overlap.any(axis=1))
        else:
            course = SmoothCourse([scene] * len(x), x, v, np.zeros((len(x), 0)), begin, times[:, -1], times, span)
            free = np.asarray(~course.overlap.any(axis=1))
            if not free.all():
                others = np.full((int(free.sum()), *result.shape[1:]), np.nan)
                if len(others):
                    self._around(states[free], number, others)
                result[free] = others
                return
        course.run(self._name)
        done = np.asarray(~course.overlap.any(axis=1))
        done[list(course.stuck)] = False
        result[done] = course.lanes.samples[done, :, : states.shape[1]]

    def _name(self, lane: int, contact: int) -> str:
        return self.prepared.row_names()[contact]
