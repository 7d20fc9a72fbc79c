"""How much memory a run takes, said before it is allocated."""

from __future__ import annotations

import os

from impactlab.errors import InvalidInput
from impactlab.kernels.sums import CONTACT_ROWS, PAIR_ROWS, SLOTS, TRANSIENT_ROWS
from impactlab.plan import Plan
from impactlab.series import sample_count

COPIES = 6
"""How many times the sums of a run are in memory while they are evaluated, at most."""

RECORD_COPIES = 3
"""The same of what records keep."""

COUNT_COPIES = 4
"""The same of what is summed over the blocks, beside that of the blocks that run."""


def sizes(plan: Plan) -> tuple[int, int]:
    """Return the bytes that a realization takes while it runs, and what its sums take."""
    bodies, contacts, rows = len(plan.bodies), len(plan.contacts), len(plan.noise_rows)
    whole = plan.transient and plan.integrator.kicks
    of_sums = 8 * plan.integrator.phases * (TRANSIENT_ROWS if whole else plan.rows) * bodies
    of_sums += 8 * CONTACT_ROWS * contacts + 8 * (1 + whole) * PAIR_ROWS * len(plan.pairs)
    if plan.tiles:  # all of it for the tiles with their halos, and a state of the network
        state = 8 * (9 * bodies + 2 * contacts) + of_sums
        bodies, contacts = (sum(map(len, parts)) for parts in zip(*(tile[:2] for tile in plan.tiles), strict=True))
        state += plan.coefficients[..., 0].nbytes * bodies
    else:
        state = 0
    state += 8 * (9 * bodies + 2 * contacts) + 8 * SLOTS * (3 * bodies + 2 * contacts) + 16 * rows
    if plan.jumps is not None:  # states and noise of all levels of halves
        levels = plan.jumps.levels + 1
        state += 8 * (bodies + 1) * (5 + 8 * levels) + 4 * (8 * bodies + 8 * rows) + 20 * levels
    elif plan.lanes == 1:
        state += 8 * (bodies + 5 * contacts)
    return state + of_sums + _series(plan), of_sums


def _series(plan: Plan) -> int:
    """Return the bytes of the series of a realization, with what the chirp transform of a row of it takes."""
    if not plan.lines:
        return 0
    method, response = plan.integrator, plan.integrator.takes_response
    rows = sum(2 * len(slots) for slots, _ in plan.responses) if response else len(plan.lines)
    needed = (plan.spin_up_steps + plan.steps) * method.samples_per_step + 1
    return 8 * (rows + 12) * sample_count(plan.lines, plan.step / method.samples_per_step, needed)


def needed(plan: Plan, workers: int) -> int:
    """Return the bytes that a run with its results takes, without trajectories."""
    running, of_sums = sizes(plan)
    kept: int = plan.realizations * sum(record.bytes_per_realization(plan) for record, _ in plan.records)
    counts: int = sum(record.bytes_per_block(plan) for record, _ in plan.records)
    run: int = min(plan.realizations, workers * plan.lanes) * running + (
        COPIES * plan.realizations * (len(plan.boundaries) + 1) * of_sums + RECORD_COPIES * kept
    )
    run += (min(plan.blocks, workers) + COUNT_COPIES) * counts
    return run


def available() -> float:
    """Return the bytes of memory that can be had: what the system says, else what is built in, else infinity."""
    try:
        with open("/proc/meminfo", encoding="ascii") as file:
            for line in file:
                if line.startswith("MemAvailable:"):
                    return 1024.0 * int(line.split()[1])
    except (OSError, ValueError):
        pass
    try:
        return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    except (AttributeError, OSError, ValueError):
        return float("inf")


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
    trajectories *= 1 if plan.blocks == 1 else 2  # once more while they are joined
    if trajectories and run + trajectories > there:
        raise InvalidInput(
            f"The trajectories would take {trajectories / 1e9:.3g} GB of memory, {there / 1e9:.3g} GB are available: "
            "use a longer interval or fewer realizations, or write them to a file with out=."
        )
    if run > there:
        raise InvalidInput(
            f"{plan.realizations} realizations of {len(plan.bodies)} bodies and {len(plan.contacts)} contacts would "
            f"take {run / 1e9:.3g} GB of memory ({run / plan.realizations / len(plan.bodies):.3g} bytes per body and "
            f"realization), {there / 1e9:.3g} GB are available: use fewer realizations, a smaller network, or "
            "records of less."
        )
