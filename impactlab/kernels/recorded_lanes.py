"""Lanes under samples of their own: linear responses to records that are scaled, and peaks of what moves."""

from __future__ import annotations

from typing import NamedTuple

from impactlab.compiling.intrinsics import value_at
from impactlab.compiling.jit import kernel
from impactlab.compiling.records import Blocks, Cube, Numbers, Slots, Table
from impactlab.compiling.scalars import scalar
from impactlab.kernels.interpolation import cubic, turns

ONE_BEFORE, LATEST, LATEST_RATE = range(3)
"""Rows of what is remembered of a form: its last two values, and its rate (times the interval)."""


class ScaledRecords(NamedTuple):
    """Records, the linear response to them in a step, and which one each lane has at which scale."""

    flow: Table  # (row, row) of the responses over a step; rows are displacement and velocity of each body in turn
    push: Table  # (2, row) responses to a force of 1, and to one that grows from -1 to 1 in a step
    forces: Cube  # (step, 2, record) mean in each step, and growth in half of it
    record: Slots  # (lane,)
    scale: Numbers  # (lane,)
    work: Cube  # (2, row, record) responses at both ends of a step
    factors: Cube  # of envelopes, which records do not have
    first: int
    near: Blocks  # (NEAR + 1, row, lane) samples of series, see `impactlab.integrators.arguments.Series`
    row: int  # first of the rows that are brought here


@kernel
def next_of_records(own, step):  # type: ignore[no-untyped-def]
    """Carry the responses to all records over a step."""
    here, there = own.work[0], own.work[1]
    for row in range(here.shape[0]):
        for record in range(here.shape[1]):
            there[row, record] = (
                own.push[0, row] * own.forces[step, 0, record] + own.push[1, row] * own.forces[step, 1, record]
            )
        for other in range(here.shape[0]):
            factor = own.flow[row, other]
            for record in range(here.shape[1]):
                there[row, record] += factor * here[other, record]
    for row in range(here.shape[0]):
        for record in range(here.shape[1]):
            here[row, record] = there[row, record]


@kernel
def bring_scaled(own, first):  # type: ignore[no-untyped-def]
    """Write responses at the samples first, first + 1, … of all lanes to rows of `near`; they begin at 0."""
    near, begin, work = own.near, own.row, own.work[0]
    for row in range(work.shape[0]):
        for record in range(work.shape[1]):
            work[row, record] = 0.0
        for lane in range(near.shape[2]):
            near[0, begin + row, lane] = 0.0
    for sample in range(near.shape[0] - 1):
        next_of_records(own, min(first + sample, own.forces.shape[0] - 1))
        for row in range(work.shape[0]):
            for lane in range(near.shape[2]):
                near[sample + 1, begin + row, lane] = own.scale[lane] * work[row, own.record[lane]]


def bring_records(place, first):  # type: ignore[no-untyped-def]
    """Bring samples near; `place` is the address of `ScaledRecords`."""
    bring_scaled(value_at(place), first)


class SummedRows(NamedTuple):
    """Weighted sums of rows of snapshots."""

    begin: Slots  # (form + 1,)
    rows: Slots  # (term,)
    weights: Numbers  # (term,)
    to_rates: Slots  # (form,) distance from rows to those of their rates, 0 where these are not known
    hits: Slots  # (row,) of impulses, which change rates at once
    interval: float  # between snapshots (s)


@scalar
def turn_of_cubic(before, rate, value, next_rate):  # type: ignore[no-untyped-def]
    """Return the value where Hermite's cubic between two samples turns; its rates there have different signs."""
    square, cube = cubic(rate, next_rate, value - before)
    low, high = turns(rate, square, cube)
    at = low if low > 0.0 else high
    return before + at * (rate + at * (square + at * cube))


@scalar
def turn_of_tangents(before, rate, value, next_rate):  # type: ignore[no-untyped-def]
    """Return the value where the tangents at two samples meet, between which an impact changes the rate at once."""
    at = (value - before - next_rate) / (rate - next_rate)
    return before + rate * at if 0.0 < at < 1.0 else value


@kernel
def sum_terms(snapshot, forms, form, value, rate):  # type: ignore[no-untyped-def]
    """Write the value of a form, and its rate times the interval, in all lanes."""
    to_rates = forms.to_rates[form]
    for lane in range(value.shape[0]):
        value[lane], rate[lane] = 0.0, 0.0
    for term in range(forms.begin[form], forms.begin[form + 1]):
        row, weight = forms.rows[term], forms.weights[term]
        for lane in range(value.shape[0]):
            value[lane] += weight * snapshot[row, lane]
        if to_rates:
            for lane in range(value.shape[0]):
                rate[lane] += weight * forms.interval * snapshot[row + to_rates, lane]


@kernel
def widen(value, rate, remembered, span, turns):  # type: ignore[no-untyped-def]
    """Widen the ranges of all lanes to a value, and note where a turn since the value before may be beyond them.

    Nothing turns by more than the sum of both rates, or above a sample by more than what it is above its neighbours.
    """
    for lane in range(value.shape[0]):
        here, now, last = value[lane], rate[lane], remembered[LATEST, lane]
        speed, before = remembered[LATEST_RATE, lane], remembered[ONE_BEFORE, lane]
        least, most = min(span[0, lane], here), max(span[1, lane], here)
        far = abs(speed) + abs(now)
        beyond = (max(last, here) + far > most) | (min(last, here) - far < least)
        above = (last > before) & (last >= here) & (2.0 * last - min(before, here) > most)
        turns[lane] = ((speed * now < 0.0) & beyond) | ((far == 0.0) & above)
        span[0, lane], span[1, lane] = least, most


@kernel
def take_ranges(snapshots, forms, ends, first, remembered, spans, work, turns):  # type: ignore[no-untyped-def]
    """Widen the ranges of forms to what they reach up to each of the next snapshots.

    Forms with rates follow Hermite's cubic from sample to sample, others the parabola through three samples.

    Parameters
    ----------
    snapshots : (sample, row, lane) ndarray
    forms : SummedRows
    ends : (lane,) ndarray
        Number of the last sample of each lane; it stays as it is from then on.
    first : int
        Number of the first of these samples.
    remembered : (form, 3, lane) ndarray
        The last two values, and the rate times the interval.
    spans : (form, 2, lane) ndarray
        Least and largest value.
    work : (2, lane) ndarray
    turns : (lane,) ndarray of bool
    """
    value, rate = work[0], work[1]
    for sample in range(snapshots.shape[0]):
        snapshot = snapshots[sample]
        for form in range(forms.begin.shape[0] - 1):
            known, span = remembered[form], spans[form]
            sum_terms(snapshot, forms, form, value, rate)
            for lane in range(value.shape[0]):
                if first + sample > ends[lane]:
                    value[lane], rate[lane] = known[LATEST, lane], 0.0
            widen(value, rate, known, span, turns)
            for lane in range(value.shape[0]):
                if turns[lane]:
                    turn = turn_in(snapshot, forms, value[lane], rate[lane], known, lane)
                    span[0, lane], span[1, lane] = min(span[0, lane], turn), max(span[1, lane], turn)
            for lane in range(value.shape[0]):
                known[ONE_BEFORE, lane], known[LATEST, lane], known[LATEST_RATE, lane] = (
                    known[LATEST, lane],
                    value[lane],
                    rate[lane],
                )


@scalar
def turn_in(snapshot, forms, value, rate, known, lane):  # type: ignore[no-untyped-def]
    """Return the value where a form has turned in a lane since the sample before last."""
    before, last, speed = known[ONE_BEFORE, lane], known[LATEST, lane], known[LATEST_RATE, lane]
    if speed * rate < 0.0:
        for row in range(forms.hits.shape[0]):
            if snapshot[forms.hits[row], lane] != 0.0:
                return turn_of_tangents(last, speed, value, rate)
        return turn_of_cubic(last, speed, value, rate)
    if before > 0.0 and value > 0.0:
        return last + (value - before) * (value - before) / (8.0 * (2.0 * last - before - value))
    return last
