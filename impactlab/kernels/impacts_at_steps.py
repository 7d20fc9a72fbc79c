"""Impacts of contacts, put together from their gaps, rates and forces at the steps of a run.

A contact closes and opens where Hermite's cubic through gaps and rates at two steps crosses 0.
"""

from __future__ import annotations

import math

from impactlab.compiling.jit import kernel
from impactlab.kernels.event_log import (
    BEGAN,
    CLOSING,
    DURATION,
    EVENT,
    IMPULSE,
    LARGEST,
    LEAVING,
    LOST_ENERGY,
    OF_CONTACT,
)
from impactlab.kernels.interpolation import cubic, rise

LANE, SUBSAMPLE, FLAG = 0, 2, 3
"""Columns of an impact besides the number of its contact and those from `BEGAN` on, which are those of an event: its
lane and subsample, and the sum of its flags. Contacts are numbered among those that are followed."""

CLOSED_AT_START, RESTS, CLOSED_AT_END = 1, 2, 4
"""Flags of an impact: it had begun before, it ends in rest, it goes on."""

LAST_GAP, LAST_RATE, LAST_FORCE, INSIDE, ONGOING = range(5)
"""Rows of what is known of a contact: at the step before; whether it is closed, 2 from the start on; and the first of
those of an impact that goes on, in the order of the columns from `BEGAN` on."""

ROWS_OF_CONTACT = ONGOING + EVENT - BEGAN
"""How many these are."""


@kernel
def _crossing(gap, by, next_by, end):  # type: ignore[no-untyped-def]
    """Return where a gap that changes its sign over a step is 0, as a part of it, and its slope there."""
    bend, twist = cubic(by, next_by, end - gap)
    sign = 1.0 if end > gap else -1.0
    s = rise(sign * gap, sign * by, sign * bend, sign * twist, 0.0, 1.0)
    return s, by + s * (2.0 * bend + 3.0 * twist * s)


@kernel
def _write(known, contact, lane, subsample, flag, row):  # type: ignore[no-untyped-def]
    """Write an impact."""
    row[LANE], row[SUBSAMPLE], row[OF_CONTACT] = lane, subsample, contact
    row[FLAG] = flag + (CLOSED_AT_START if known[INSIDE, contact, lane] == 2.0 else 0)
    for column in range(BEGAN, EVENT):
        row[column] = known[ONGOING + column - BEGAN, contact, lane]


@kernel
def _close(known, contact, lane, time, closing):  # type: ignore[no-untyped-def]
    """Let an impact begin."""
    known[INSIDE, contact, lane] = 1.0
    for row in range(ONGOING, known.shape[0]):
        known[row, contact, lane] = 0.0
    known[ONGOING, contact, lane], known[ONGOING + CLOSING - BEGAN, contact, lane] = time, closing


@kernel
def follow_impacts(snapshots, first, steps, along, known, subsamples, rows):  # type: ignore[no-untyped-def]
    """Follow contacts from a snapshot on, one at each step; write the impacts that end.

    It returns with which snapshot to go on, and how many impacts there are: where `rows` may become too few it stops.
    `steps` are the number of the step of the first snapshot, and their length (s). It is `along` contacts: where the
    entries of each begin, rows of displacements, of velocities, and weights; clearances, rows of the force and of its
    largest value since the step before, and whether the force jumps where the contact closes.
    """
    begin, places, paces, weights, clearance, forces, largest, jumps = along
    number, length = 0, steps[1]
    for sample in range(first, snapshots.shape[0]):
        if number + known.shape[1] * known.shape[2] > rows.shape[0]:
            return sample, number
        time = length * (steps[0] + sample - 1.0)  # of the step before
        for contact in range(known.shape[1]):
            for lane in range(known.shape[2]):
                gap, rate = -clearance[contact], 0.0
                for entry in range(begin[contact], begin[contact + 1]):
                    gap += weights[entry] * snapshots[sample, places[entry], lane]
                    rate += weights[entry] * snapshots[sample, paces[entry], lane]
                force = snapshots[sample, forces[contact], lane]
                before, of_before = known[LAST_GAP, contact, lane], known[LAST_FORCE, contact, lane]
                by, next_by = length * known[LAST_RATE, contact, lane], length * rate
                known[LAST_GAP, contact, lane], known[LAST_RATE, contact, lane] = gap, rate
                known[LAST_FORCE, contact, lane] = force
                inside = known[INSIDE, contact, lane] > 0.0
                if not inside and gap <= 0.0:
                    continue
                work = 0.5 * (of_before + force) * (gap - before)
                if not inside:
                    s, slope = _crossing(before, by, next_by, gap)
                    _close(known, contact, lane, time + s * length, max(slope, 0.0) / length)
                    work = (1.0 if jumps[contact] else 0.5) * force * gap
                top = ONGOING + LARGEST - BEGAN
                known[top, contact, lane] = max(known[top, contact, lane], snapshots[sample, largest[contact], lane])
                if gap > 0.0:
                    known[ONGOING + IMPULSE - BEGAN, contact, lane] += length * force
                    known[ONGOING + LOST_ENERGY - BEGAN, contact, lane] += work
                    continue
                s, slope = _crossing(before, by, next_by, gap)
                known[ONGOING + LOST_ENERGY - BEGAN, contact, lane] -= 0.5 * of_before * before
                known[ONGOING + LEAVING - BEGAN, contact, lane] = max(-slope, 0.0) / length
                lasted = time + s * length - known[ONGOING, contact, lane]
                known[ONGOING + DURATION - BEGAN, contact, lane] = lasted
                _write(known, contact, lane, subsamples[lane], 0, rows[number])
                known[INSIDE, contact, lane] = 0.0
                number += 1
    return snapshots.shape[0], number


@kernel
def end_impacts(time, known, subsamples, rows):  # type: ignore[no-untyped-def]
    """Write the impacts that go on at the end of a run; return how many these are."""
    number = 0
    for contact in range(known.shape[1]):
        for lane in range(known.shape[2]):
            if known[INSIDE, contact, lane] > 0.0:
                known[ONGOING + DURATION - BEGAN, contact, lane] = time - known[ONGOING, contact, lane]
                known[ONGOING + LEAVING - BEGAN, contact, lane] = math.nan
                _write(known, contact, lane, subsamples[lane], CLOSED_AT_END, rows[number])
                number += 1
    return number
