"""Responses of bodies to what pushes them from sample to sample, in the loop: products with rows of lanes."""

from __future__ import annotations

from typing import NamedTuple

from impactlab.compiling.jit import kernel
from impactlab.compiling.records import Numbers, Slots

VALUE, MEAN, SLOPE = 0, 1, 2
"""Rows of factors at a sample: envelope there, mean until the next one, and growth in half of that time."""


class Sparse(NamedTuple):
    """A matrix without its zeros, row by row."""

    begin: Slots  # (row + 1,) where the entries of each row begin
    columns: Slots  # (entry,)
    values: Numbers  # (entry,)


@kernel
def add_product(matrix, given, result):  # type: ignore[no-untyped-def]
    """Add the product of a `Sparse` matrix and rows of lanes to other rows of lanes."""
    for row in range(matrix.begin.shape[0] - 1):
        for entry in range(matrix.begin[row], matrix.begin[row + 1]):
            value, column = matrix.values[entry], matrix.columns[entry]
            for lane in range(result.shape[1]):
                result[row, lane] += value * given[column, lane]


@kernel
def set_rows(source, rows, result):  # type: ignore[no-untyped-def]
    """Copy the first rows of lanes."""
    for row in range(rows):
        for lane in range(result.shape[1]):
            result[row, lane] = source[row, lane]


@kernel
def clear_rows(result):  # type: ignore[no-untyped-def]
    """Set rows of lanes to 0."""
    for row in range(result.shape[0]):
        for lane in range(result.shape[1]):
            result[row, lane] = 0.0


@kernel
def next_responses(tables, factors, sample, moved, ahead, near):  # type: ignore[no-untyped-def]
    """Carry the responses in `near` over one sample, to the rows `ahead`.

    The `tables` have the `flow` of the responses, `Sparse`, and `pairs`, (response, 3): the rows of `moved` of both
    parts of each response, −1 for none, and the envelope of it or −1. Factors are (sample, 3, envelope).
    """
    pairs = tables.pairs
    clear_rows(ahead)
    add_product(tables.flow, near, ahead)
    for row in range(pairs.shape[0]):
        own, growing, envelope = pairs[row, 0], pairs[row, 1], pairs[row, 2]
        if envelope < 0:
            for lane in range(ahead.shape[1]):
                ahead[row, lane] += moved[own, lane]
        else:
            mean = factors[sample, MEAN, envelope]
            slope = factors[sample, SLOPE, envelope]
            for lane in range(ahead.shape[1]):
                ahead[row, lane] += mean * moved[own, lane] + slope * moved[growing, lane]
