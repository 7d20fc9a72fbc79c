"""How much memory a run takes, said before it is allocated."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import DTypeLike

from impactlab.errors import InvalidInput
from impactlab.kernels.memory import SUMS
from impactlab.kernels.rows import FLUX, PAIR_ROWS, POINT_ROWS, TRANSIENT_ROWS
from impactlab.memory_limits import available
from impactlab.plan.plan import Plan
from impactlab.records.recorded_run import RecordedRun
from impactlab.results.schema import BODY, CONTACT, sampled_of
from impactlab.simulation.arrays import allocate

COPIES = 4
"""How many times sums are in memory while they are evaluated: 3.6 in chains of 2 to 3000 bodies. Sums over all blocks
are, too, besides the sums of the blocks that run."""

TRANSFORMED = 12
"""Rows of samples that the chirp transform of one row takes."""


def sizes(plan: Plan) -> tuple[int, int]:
    """Return the bytes that a realization takes while it runs, and what its sums take."""
    bodies, contacts, pairs = len(plan.system.bodies), len(plan.system.contacts), len(plan.method.pairs)
    whole = plan.transient and plan.method.integrator.kicks
    rows = (TRANSIENT_ROWS if whole else plan.rows) + len(sampled_of(BODY))
    of_sums = 8 * plan.method.integrator.phases * rows * bodies
    of_sums += 8 * (FLUX + 1 + len(sampled_of(CONTACT))) * contacts + 8 * (1 + whole) * PAIR_ROWS * pairs
    of_sums += 8 * plan.method.integrator.phases * POINT_ROWS * len(plan.points.labels)
    of_sums += 8 * SUMS * len(plan.forces.states)
    total = 0

    def counted(shape: tuple[int, ...], dtype: DTypeLike = float) -> np.ndarray:
        """Note the bytes of zeros, which take no memory here."""
        nonlocal total
        kind = np.dtype(dtype)
        total += math.prod(shape) * kind.itemsize
        return np.broadcast_to(np.zeros((), kind), shape)

    allocate(plan, 1, counted)
    for part in plan.tiles if plan.subdomains.tiles else ():
        allocate(part, 1, counted)
        total += part.method.coefficients.nbytes
    of_series = plan.driving.nbytes(plan.method.integrator, plan.clock.step, plan.clock.all_steps, TRANSFORMED)
    return total + of_sums + of_series, of_sums


def needed(plan: Plan, workers: int) -> int:
    """Return the bytes that a run with its results takes, without trajectories."""
    running, of_sums = sizes(plan)
    records, realizations = plan.observed.records, plan.realizations
    kept: int = realizations.number * sum(
        record.copies * record.bytes_per_realization(RecordedRun(plan), plan.interval(ratio))
        for record, ratio in records
    )
    counts: int = sum(record.bytes_per_block(RecordedRun(plan)) for record, _ in records)
    run: int = min(realizations.number, workers * realizations.lanes) * running + (
        COPIES * realizations.number * (len(plan.clock.boundaries) + 1) * of_sums + kept
    )
    run += (min(realizations.blocks, workers) + COPIES) * counts
    return run


def check_memory(plan: Plan, workers: int, trajectories: int) -> None:
    """Refuse a run that does not fit into memory.

    Parameters
    ----------
    plan : Plan
    workers : int
        Blocks that run at once.
    trajectories : int
        Bytes of the trajectories that are kept in memory.

    Raises
    ------
    InvalidInput
        Says what is needed and what there is.
    """
    there, run = available(), needed(plan, workers)
    realizations, bodies = plan.realizations.number, len(plan.system.bodies)
    trajectories *= 1 if plan.realizations.blocks == 1 else 2  # once more while they are joined
    if trajectories and run + trajectories > there:
        raise InvalidInput(
            f"The trajectories would take {trajectories / 1e9:.3g} GB of memory, but {there / 1e9:.3g} GB are "
            "available: use a longer interval or fewer realizations, or write them to a file with out=."
        )
    if run > there:
        raise InvalidInput(
            f"{realizations} realizations of {bodies} bodies and {len(plan.system.contacts)} contacts would "
            f"take {run / 1e9:.3g} GB of memory ({run / realizations / bodies:.3g} bytes per body and "
            f"realization), but {there / 1e9:.3g} GB are available: use fewer realizations, a smaller network, or "
            "smaller records."
        )
