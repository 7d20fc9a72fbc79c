"""The states of laws in a block: behind the parameters of the forces, lane by lane, with the time since they held.

A block whose laws have states, or depend on time, has a copy of the parameters of its own. Behind them stand sums over
steps (of the states, their squares and the size of their changes), the states before the last step, and the states, a
row of lanes each; then the number of states, the time at which the last step was accepted, and the time that has
passed since.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from impactlab.compiling.intrinsics import address_of, borrow, call, rows, rows_of_lanes
from impactlab.compiling.jit import Function, inlined, kernel, loop, part
from impactlab.compiling.records import Block, Numbers, Slots, by_address, signature
from impactlab.compiling.scalars import scalar
from impactlab.compiling.single import instead_of


class Accepted(NamedTuple):
    """Arguments of the generated function that updates the states where a step is accepted."""

    x: Block  # displacement [body, lane]
    v: Block  # velocity [body, lane]
    contact_force: Block  # [contact, lane]
    half_step: float  # of a kick, in whose middle v is (s); 0 where v is that after the step
    parameters: Numbers  # of the forces, with the states
    indices: Slots


ACCEPT, ACCEPT_OF_ONE = by_address(Accepted, False), by_address(Accepted, True)
"""Types of the generated function that updates the states of a network: for blocks, and for blocks of one lane."""


def accepting(signature: Any) -> Callable[[Function], Any]:
    """Compile a function of the type `ACCEPT`, and return it with its address."""
    return lambda function: part(signature, function, True)


def accept(
    function: Any, single: bool, blocks: Sequence[np.ndarray], parameters: np.ndarray, indices: np.ndarray
) -> None:
    """Call the function that `accepting` returned from outside the loops; blocks are x, v and contact forces."""
    blocks = [item[..., 0] if single else item for item in blocks]
    run = loop(signature(single, int, Block, Block, Block, Numbers, Slots), _accept)
    run(function[1], *blocks, parameters, indices)


def _accept(function, x, v, contact_force, parameters, indices):  # type: ignore[no-untyped-def]
    call(function, address_of(borrow(Accepted(x, v, contact_force, 0.0, parameters, indices))), 0)


BEHIND = 3
"""Numbers behind the states: how many they are, the time of the last accepted step, and what has passed since (s)."""

TIMES = slice(-2, None)
"""The last two of them; generated text reads them by these places."""

SUMS = 4
"""Rows of each state before it: three sums, and its value before the last step."""


def with_states(parameters: np.ndarray, states: np.ndarray, lanes: int, zeros: Callable[..., np.ndarray]) -> np.ndarray:
    """Return parameters with the states of some lanes at their start values, and the numbers behind them."""
    numbers = zeros((len(parameters) + (1 + SUMS) * len(states) * lanes + BEHIND,))
    if numbers.flags.writeable:  # else memory is only counted
        numbers[: len(parameters)] = parameters
        states_in(numbers, len(states), lanes)[:] = states[:, None]
        numbers[-BEHIND] = len(states)
    return numbers


def states_in(parameters: np.ndarray, count: int, lanes: int) -> np.ndarray:
    """Return so many states among parameters, which may be changed, (state, lane)."""
    end = len(parameters) - BEHIND
    return parameters[end - count * lanes : end].reshape(count, lanes)


def sums_in(parameters: np.ndarray, count: int, lanes: int) -> np.ndarray:
    """Return the sums of the states, and the states before the last step, (`SUMS`, state, lane)."""
    end = len(parameters) - BEHIND - count * lanes
    return parameters[end - SUMS * count * lanes : end].reshape(SUMS, count, lanes)


@inlined
def remembered(parameters, place, count, block):  # type: ignore[no-untyped-def]
    """Return a state of members in a row, [member, lane]; `place` counts rows from the end, `block` has the lanes."""
    lanes = block.shape[1]
    return rows_of_lanes(parameters, parameters.shape[0] - BEHIND - place * lanes, count, lanes)


@instead_of(remembered)
def _remembered_of_one(parameters, place, count, block):  # type: ignore[no-untyped-def]
    return rows(parameters, parameters.shape[0] - BEHIND - place, count)


@kernel
def sum_states(parameters, block):  # type: ignore[no-untyped-def]
    """Add the states of an accepted step to the sums; the lanes are those of the block."""
    count = int(parameters[parameters.shape[0] - BEHIND])
    states, before = remembered(parameters, count, count, block), remembered(parameters, 2 * count, count, block)
    changes, squares = remembered(parameters, 3 * count, count, block), remembered(parameters, 4 * count, count, block)
    sums = remembered(parameters, 5 * count, count, block)
    for row in range(count):
        for lane in range(states.shape[1]):
            value = states[row, lane]
            sums[row, lane] += value
            squares[row, lane] += value * value
            changes[row, lane] += abs(value - before[row, lane])
            before[row, lane] = value


@kernel
def write_states(parameters, sums, snapshots, index):  # type: ignore[no-untyped-def]
    """Write the states into a snapshot, after what `impactlab.kernels.sums.write_snapshot` writes."""
    first, snapshot = 2 * sums.bodies.shape[2] + sums.contacts.shape[1], snapshots[index]
    count = int(parameters[parameters.shape[0] - BEHIND])
    states = remembered(parameters, count, count, snapshot)
    for row in range(count):
        for lane in range(states.shape[1]):
            snapshot[first + row, lane] = states[row, lane]


@scalar
def set_accepted(tables, steps, now):  # type: ignore[no-untyped-def]
    """Tell laws that the last accepted step is that before some step."""
    if steps.clocked:
        tables.parameters[tables.parameters.shape[0] - 2] = (now - steps.spin_up) * steps.step


@scalar
def set_elapsed(tables, steps, time):  # type: ignore[no-untyped-def]
    """Tell laws how long ago the last step was accepted (s)."""
    if steps.clocked:
        tables.parameters[tables.parameters.shape[0] - 1] = time
