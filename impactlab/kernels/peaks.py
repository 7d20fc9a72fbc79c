"""Peaks of contact forces between steps: what the function takes that is generated for laws that depend on the rate."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba import f8, i8, types, void

from impactlab.kernels.arrays import address_of, call, pointer_to
from impactlab.kernels.jit import BLOCK, BLOCK_OF_ONE, Function, inlined, kernel, part

ROWS, LARGEST, OF_BATCH = 9, 7, 8
"""Rows of what is known of contacts a step ago: indentation, rate, force and the number of that step; of a collision
that is followed, depth, speed (not above 0 where none is) and force; and the largest force, NaN where none was read:
since the last snapshot with peaks, and of the batch before it."""


class Between(NamedTuple):
    """The end of a step, and where it began."""

    v: np.ndarray  # velocity [body, lane]
    indentation: np.ndarray  # [contact, lane]
    contact_force: np.ndarray  # [contact, lane]
    before: np.ndarray  # [row, contact, lane] see `ROWS`
    jitter: np.ndarray  # (contact,) what white noise changes rates by in a step, root mean square (m s-1)
    parameters: np.ndarray  # of the forces, with the states
    indices: np.ndarray
    step: float  # (s)


def _reading(block: Any, blocks: Any) -> Any:
    tuple_of: Any = types.NamedTuple
    return void(pointer_to(tuple_of((*[block] * 3, blocks, f8[::1], f8[::1], i8[::1], f8), Between)), i8)


PEAKS, PEAKS_OF_ONE = _reading(BLOCK, f8[:, :, ::1]), _reading(BLOCK_OF_ONE, f8[:, ::1])
"""Types of the function that is generated for the peaks of a network, for blocks and for those of one lane."""


def reading(signature: Any) -> Callable[[Function], Any]:
    """Compile a function of the type `PEAKS`, and return it with its address."""
    return lambda function: part(signature, function)


@inlined
def read_peaks(history, slot, now, closings, indices):  # type: ignore[no-untyped-def]
    """Find the largest forces on the way to a slot, a step of some number."""
    v, indentation, contact_force = history.v[slot], history.indentation[slot], history.contact_force[slot]
    peaks = closings.peaks
    place = Between(
        v, indentation, contact_force, peaks.before, closings.jitter, peaks.parameters, indices, closings.step
    )  # fmt: skip
    call(peaks.function, address_of(place), now)


@kernel
def write_peaks(contact_force, peaks, snapshots, index):  # type: ignore[no-untyped-def]
    """Write the largest force of each contact since the snapshot before to the last rows of a snapshot.

    Where none was read between steps, it is that at the step.
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
