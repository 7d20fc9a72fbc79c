"""Steps in time, and the batches that standard errors come from."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from fractions import Fraction

import numpy as np

from impactlab.errors import InvalidInput
from impactlab.plan.subdomains import Tile

RELAXATION_TIMES = 12.0
"""Length of the automatic spin-up in relaxation times of the slowest body."""

LENGTH = 100.0
"""Length of a run, where none is given, in relaxation times of the slowest body: beside it the spin-up is short."""

SETTLED = 5.0
"""Relaxation times of spin-up after which the motion counts as stationary."""

TRANSIENT = 0.5
"""Factor on the step of linear bodies in a transient. Each step is exact, but Simpson's rule over steps of 1/ω is
0.1 to 0.2 % off for a mean square over few steps; half the step makes that sixteen times less."""

BATCHES, BATCH_TIMES = 64, 20.0
"""Least number of batches for a standard error, and the length of one in relaxation times."""

MOST_STEPS = 2.0**53
"""Number of steps that a float can count."""

MOST_SAMPLES = 4096
"""Steps per batch where every step is exact, so that the work does not grow with the time, or where friction tells no
length of a batch."""


@dataclass(frozen=True, eq=False)
class Clock:
    """Steps, and the times that they are measured by."""

    step: float  # (s)
    spin_up_steps: int  # before statistics begin
    steps: int  # of the statistics
    boundaries: tuple[int, ...]  # steps at which batches end; the last is `steps`
    relaxation: float  # longest time after which samples are independent (s), 0 if nothing is damped
    settling: float  # relaxation time of what the start does not know (s)
    automatic: float
    """The step that the rules choose where none is given (s); 0 where they choose none. Of a larger step that was
    measured, biases are expected to grow with the square of its ratio to this one.
    """
    certified: bool  # whether the automatic step of such a network is right without a measurement
    begin: int = 0  # steps from t = 0 to the begin of the statistics, of a run that goes on from an earlier one
    spin_up: float = field(init=False)  # time before statistics begin (s)
    duration: float = field(init=False)  # time of the statistics (s)
    first: int = field(init=False)  # steps of a realization before its statistics begin
    all_steps: int = field(init=False)  # steps to be made
    settled: bool = field(init=False)  # whether the spin-up is long enough for balances to be used

    def __post_init__(self) -> None:
        spin_up = max(self.spin_up_steps, 0) * self.step
        for name, value in (
            ("spin_up", spin_up),
            ("duration", self.steps * self.step),
            ("first", self.spin_up_steps + self.begin),
            ("all_steps", self.steps if self.begin else self.spin_up_steps + self.steps),
            ("settled", settles(spin_up, self.settling)),
        ):
            object.__setattr__(self, name, value)

    def restricted(self, tile: Tile) -> Clock:
        """Return itself: all tiles make the same steps."""
        return self


def settles(spin_up: float, settling: float) -> bool:
    """Whether a motion is stationary after a spin-up, by the relaxation time of what its start does not know (s)."""
    return spin_up >= SETTLED * settling * (1.0 - 1e-9)


def fit_step(
    step: float, fixed: bool, intervals: list[float], duration: float, multiple: int = 1, smooth: bool = False
) -> tuple[float, int]:
    """Return a step that divides all `intervals`, and the number of steps in the duration.

    A step that is not fixed is made smaller until a `multiple` of it divides the longest time that all intervals are
    whole numbers of; if there is no interval, until it divides the duration. The number of steps is such a multiple. If
    the number of steps in that time is to be `smooth`, it has no prime factor above 5, which an FFT takes best.
    Intervals that are not a whole number of steps are refused.
    """
    if fixed and step > duration * (1.0 + 1e-9):
        raise InvalidInput(f"A step of {step:g} s is longer than the duration of {duration:g} s; change one of them.")
    if not fixed:
        whole = _common(intervals) if intervals else duration
        count = math.ceil(_steps(whole, multiple * step) * (1.0 - 1e-12))
        if smooth:
            from scipy.fft import next_fast_len  # loaded only where there are series

            count = next_fast_len(count, real=True)
        step = whole / (multiple * count)
    for interval in intervals:
        if abs(interval / step - round(interval / step)) > 1e-6 or round(interval / step) < 1:
            among = f"Intervals of {intervals[0]:g} s and {interval:g} s are no whole numbers of any usable step"
            alone = f"An interval of {interval:g} s is not a whole number of steps of {step:g} s"
            raise InvalidInput(f"{alone if fixed else among}; change one of them.")
    return step, multiple * max(1, round(_steps(duration, multiple * step)))


def _common(intervals: list[float]) -> float:
    """Return the longest time that all intervals are whole numbers of, or the first interval if there is none."""
    first = intervals[0]
    # parts of an interval, at most, of which another interval is a whole number
    shares = [Fraction(interval / first).limit_denominator(1000) for interval in intervals]
    if any(abs(share * first - interval) > 1e-9 * interval for share, interval in zip(shares, intervals, strict=True)):
        return first
    return first / math.lcm(*(share.denominator for share in shares))


def _steps(time: float, step: float) -> float:
    """Return how many steps a time takes, if a float can count them."""
    if step <= 0.0 or time / step >= MOST_STEPS:
        raise InvalidInput(
            f"A time of {time:g} s has too many steps of {step:g} s; give a shorter time or a larger step."
        )
    # over less than this part of a step the motion is lost in rounding
    if time / step < 1e-9:
        raise InvalidInput(
            f"A time of {time:g} s is too short for steps of {step:g} s; give a longer time or a smaller step."
        )
    return time / step


def batches_wanted(realizations: int) -> int:
    """Return the even number of batches per realization that is enough for standard errors."""
    wanted = -(-BATCHES // realizations)
    return wanted + wanted % 2


def batch_count(realizations: int, duration: float, relaxation: float) -> int:
    """Return the even number of batches per realization: what is wanted if the time is enough, else two."""
    wanted = batches_wanted(realizations)
    return wanted if duration * (1.0 + 1e-9) >= wanted * BATCH_TIMES * relaxation else 2


def enough_units(realizations: int, batches: np.ndarray, relaxation: float) -> bool:
    """Whether realizations, or batches of some lengths (s, up to a sample), are enough for standard errors.

    Where nothing is damped the relaxation time is not known (0) and batches do not count.
    """
    long = relaxation > 0.0 and batches.min() >= BATCH_TIMES * relaxation
    return realizations >= BATCHES or bool(long and realizations * len(batches) >= BATCHES)
