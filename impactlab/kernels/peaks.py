"""Peaks of contact forces between steps: what the function takes that is generated for laws that depend on the rate."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from impactlab.compiling.intrinsics import address_of, call
from impactlab.compiling.jit import Function, inlined, kernel, part
from impactlab.compiling.records import Block, Blocks, Numbers, Slots, by_address

LARGEST, OF_BATCH, ROWS = range(7, 10)
"""Rows of the numbers that a contact keeps from a step to the next. Rows 0 to 3: indentation, rate and force at the
last step, and the number of the step. Rows 4 to 6: depth, speed and force of the collision that is followed; the speed
is not above 0 where there is none. `LARGEST`: the largest force since the last snapshot with peaks, and `OF_BATCH` that
of the batch before it, NaN where none was read."""


class Between(NamedTuple):
    """The end of a step, and where it began."""

    v: Block  # velocity [body, lane]
    indentation: Block  # [contact, lane]
    contact_force: Block  # [contact, lane]
    before: Blocks  # [row, contact, lane] see `ROWS`
    jitter: Numbers  # (contact,) what white noise changes rates by in a step, root mean square (m s-1)
    parameters: Numbers  # of the forces, with the states
    indices: Slots
    step: float  # (s)


PEAKS, PEAKS_OF_ONE = by_address(Between, False), by_address(Between, True)
"""Types of the function that is generated for the peaks of a network, for blocks and for those of one lane."""


def reading(signature: Any) -> Callable[[Function], Any]:
    """Compile a function of the type `PEAKS`, and return it with its address."""
    return lambda function: part(signature, function)


@inlined
def read_peaks(history, slot, now, closings, indices):  # type: ignore[no-untyped-def]
    """Find the largest forces in a step, which ends in the given slot."""
    v, indentation, contact_force = history.v[slot], history.indentation[slot], history.contact_force[slot]
    peaks = closings.peaks
    place = Between(
        v, indentation, contact_force, peaks.before, closings.jitter, peaks.parameters, indices, closings.step
    )  # fmt: skip
    call(peaks.function, address_of(place), now)


@kernel
def write_peaks(contact_force, peaks, snapshots, index):  # type: ignore[no-untyped-def]
    """Write the largest force of each contact since the snapshot before to the last rows of a snapshot.

    Where no force was read between steps, the force at the step is written.
    """
    first, before = snapshots.shape[1] - peaks.written, peaks.before
    for contact in range(peaks.written):
        for lane in range(snapshots.shape[2]):
            found, most = before[LARGEST, contact, lane], before[OF_BATCH, contact, lane]
            snapshots[index, first + contact, lane] = contact_force[contact, lane]
            if not math.isnan(found):
                snapshots[index, first + contact, lane] = found
                before[OF_BATCH, contact, lane] = most if most > found else found
                before[LARGEST, contact, lane] = math.nan
