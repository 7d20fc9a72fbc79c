"""The arrays of a block: allocated where it runs, or only counted to know what it takes."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import DTypeLike

from impactlab.integrators.base import History, State, Sums
from impactlab.integrators.jumps import Work, Zeros, work_space
from impactlab.kernels.sums import CONTACT_ROWS, PAIR_ROWS, SLOTS
from impactlab.plan import Plan


class Arrays(NamedTuple):
    """What a block works with."""

    state: State
    history: History
    sums: Sums
    work: Work | None  # of a block that jumps


class Counted:
    """Stands for `numpy.zeros` and notes the bytes of what is asked for, which take no memory."""

    def __init__(self) -> None:
        self.bytes = 0

    def __call__(self, shape: tuple[int, ...], dtype: DTypeLike = float) -> np.ndarray:
        kind = np.dtype(dtype)
        self.bytes += math.prod(shape) * kind.itemsize
        return np.broadcast_to(np.zeros((), kind), shape)


def allocate(plan: Plan, lanes: int, zeros: Zeros = np.zeros) -> Arrays:
    """Return the arrays of a block of some lanes, all 0.

    Parameters
    ----------
    plan : Plan
    lanes : int
        Realizations of the block.
    zeros : callable
        Makes an array of a shape and a type.
    """
    system, forces, observed, method = plan.system, plan.forces, plan.observed, plan.method
    bodies, contacts, rows, single = len(system.bodies), len(system.ends), len(plan.noise.rows), plan.single

    def of_bodies() -> np.ndarray:
        return zeros((bodies + 1, lanes))

    def of_contacts() -> np.ndarray:
        return zeros((contacts, lanes))

    state = State(
        x=of_bodies(),
        v=of_bodies(),
        reading=of_bodies(),
        velocity=of_bodies(),
        rest=of_bodies(),
        total=of_bodies(),
        indentation=of_contacts(),
        contact_force=of_contacts(),
        external=of_bodies(),
        slope_x=of_bodies(),
        slope_v=of_bodies(),
        middle=of_bodies(),
        normals=zeros((4, rows, lanes), np.float32),
    )
    slots = 0 if plan.subdomains.tiles else SLOTS
    history = History(*[zeros((slots, count, lanes)) for count in (bodies + 1,) * 3 + (contacts,) * 2])
    sums = Sums(
        bodies=zeros((method.integrator.phases, plan.rows, observed.bodies, lanes)),
        contacts=zeros((CONTACT_ROWS, observed.contacts, lanes)),
        ends=system.ends,
        indices=forces.indices,
        window=observed.window,
        half_kick=forces.half_kick,
        closing=zeros((4, contacts * single, lanes)),
        push=zeros(((bodies + 1) * single * bool(len(forces.half_kick)), lanes)),
        kick=zeros((contacts * single, lanes)),
        products=zeros((PAIR_ROWS, len(method.pairs), lanes)),
        pairs=method.pairs,
        before=zeros((2, observed.contacts * observed.counted, lanes)),
        jitter=observed.jitter,
        step=plan.clock.step,
    )
    return Arrays(
        state, history, sums, None if method.jumps is None else work_space(method.jumps, rows, bodies, lanes, zeros)
    )
