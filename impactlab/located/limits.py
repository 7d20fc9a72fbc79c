"""How long runs from event to event may take, as work that is the same on any machine, and as time."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from impactlab.allowed_time import OutOfTime
from impactlab.errors import LONG_TIME, ImpactLabError, ImpactLabWarning, warn

LOOK_SECONDS, STAGE_SECONDS = 3e-7, 1e-7
"""Time of a look at linear motion, and of an evaluation of smooth forces (s)."""

OF_LOOK, OF_STAGE = 20.0, 7.0
"""Terms of modes in functionals, and bodies under smooth forces, that take this time once more."""

ROUGHER = 3.0
"""Evaluations that a path takes at least, in those of the rough one before: errors of 1e-2 and 1e-10 at order 8."""

LEAST_SECONDS = 1.0
"""Time of one core that any run may take: planning and measuring of steps takes as long (s)."""

SLOWER = 6.0
"""Factor on the time of steps up to which a run may take longer: steps are measured before, and are not exact."""

FORESEEN = 0.1
"""Part of the time that is allowed, after which the rest is foreseen from the part that is done."""

LOOKED_AT = 10.0
"""Time after which a run may be said to take long (s)."""


def stage_seconds(bodies: int) -> float:
    """Return the time of an evaluation of smooth forces (s)."""
    return STAGE_SECONDS * (1.0 + bodies / OF_STAGE)


def look_seconds(bodies: int, contacts: int) -> float:
    """Return the time of a look at linear motion (s)."""
    return LOOK_SECONDS * (1.0 + bodies * (bodies + contacts) / OF_LOOK)


def allowed_beside(steps: float) -> float:
    """Return the time of one core that a run may take where steps take some time (s)."""
    return max(LEAST_SECONDS, SLOWER * steps)


def too_long(allowed: float) -> str:
    """Say that a run would take longer than it may (s)."""
    return f"EventLocated would take more than {allowed:.2g} s of one core, much longer than steps."


class TooLong(ImpactLabError):
    """A run takes more work than it may."""


class Limit(NamedTuple):
    """How long some lanes may take."""

    lanes: slice
    seconds: float  # of an evaluation
    steps: Callable[[], float]  # time of one core that steps would take, the same on any machine (s)


class Limits:
    """The limits of the lanes of a call.

    Evaluations are the same wherever lanes run, and in whatever calls, so that a run is within its limit or not.
    """

    def __init__(self, limits: Sequence[Limit] = ()) -> None:
        self._limits = list(limits)
        self._allowed: dict[int, float] = {}
        self.beyond: dict[int, TooLong] = {}
        """Why runs were ended, by their first lanes."""

    def lanes_beyond(self, evaluations: np.ndarray, factor: float = 1.0) -> list[int]:
        """Return the lanes of the runs that are now found beyond their limits; `factor` is of work to work so far."""
        result: list[int] = []
        for limit in self._limits:
            first, spent = limit.lanes.start, factor * limit.seconds * float(evaluations[limit.lanes].sum())
            if first in self.beyond or spent <= LEAST_SECONDS:
                continue
            if first not in self._allowed:
                self._allowed[first] = allowed_beside(limit.steps())
            if spent > self._allowed[first]:
                self.beyond[first] = TooLong(too_long(self._allowed[first]))
                result += range(first, limit.lanes.stop)
        return result


class Watch:
    """Takes the part of a run that is done; ends the run where it is foreseen to take more than some time (s)."""

    def __init__(
        self, show: Callable[[float], None], seconds: float, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._show, self._seconds, self._clock = show, seconds, clock
        self._begin, self._before, self._said = math.nan, 0.0, False

    def __call__(self, part: float) -> None:
        if math.isnan(self._begin):  # code is compiled before
            self._begin = self._clock()
        spent = self._clock() - self._begin
        if part == 0.0:  # what is done beforehand, once
            self._before = spent
        foreseen = self._before + (spent - self._before) / part if part > 0.0 else spent
        if spent > self._seconds or (foreseen > self._seconds and spent > FORESEEN * self._seconds):
            raise OutOfTime(
                f"EventLocated would take about {foreseen:.2g} s, but may take {self._seconds:.2g} s. Give a larger "
                "max_seconds=, a shorter duration= or spin_up=, fewer realizations, or integrator=il.ExactFlow()."
            )
        if foreseen > LONG_TIME and spent > LOOKED_AT and not self._said:
            self._said = True
            text = f"EventLocated would take about {foreseen:.2g} s. Give max_seconds= to refuse such runs."
            warn("long_run", text, ImpactLabWarning)
        self._show(part)
