"""The arrays of a block: allocated where it runs, or only counted to know what it takes."""

from __future__ import annotations

import math
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike

from impactlab.integrators.arguments import Closings, Flux, History, Peaks, State, Sums, Turns
from impactlab.integrators.interval_arguments import Zeros
from impactlab.kernels.memory import with_states
from impactlab.kernels.peaks import ROWS as PEAK_ROWS
from impactlab.kernels.rows import FLUX, PAIR_ROWS, TURN
from impactlab.kernels.sums import SLOTS
from impactlab.plan.events import Room
from impactlab.plan.plan import Plan
from impactlab.results.schema import BODY, CONTACT, sampled_of

CACHE_LINE = 64
"""Bytes of a line of the cache, and of the longest vectors of a processor."""


class Arrays(NamedTuple):
    """What a block works with."""

    state: State
    history: History
    sums: Sums
    normals: np.ndarray  # (4, row, lane) of the noise, single precision
    distinct: np.ndarray  # (4, stream, lane) the same of streams, where rows share some
    parameters: np.ndarray  # of the forces, with the states of laws at their start
    before: np.ndarray  # [body, lane] velocities before the flow, where events are located in it
    events: tuple[Any, ...]  # arrays of the mechanisms that locate them


def aligned(shape: tuple[int, ...], dtype: DTypeLike = float) -> np.ndarray:
    """Return zeros that begin with a line of the cache, so that no vector of eight lanes spans two lines."""
    kind = np.dtype(dtype)
    size = math.prod(shape) * kind.itemsize
    memory = np.zeros(size + CACHE_LINE, np.uint8)
    begin = -memory.ctypes.data % CACHE_LINE
    return memory[begin : begin + size].view(kind).reshape(shape)


def copy_lanes(source: Any, lanes: np.ndarray, target: Any) -> None:
    """Copy the chosen lanes, in their order, of all arrays in nested tuples into arrays with so many lanes."""
    if isinstance(source, tuple):
        for one, own in zip(source, target, strict=True):
            copy_lanes(one, lanes, own)
    elif isinstance(source, np.ndarray) and not np.may_share_memory(source, target):
        if source.shape == target.shape:  # all lanes, or an array without lanes
            target[...] = source
        elif source.ndim > 1:  # parameters with states of laws are one row of numbers
            target[...] = source[..., lanes]


def allocate(plan: Plan, lanes: int, zeros: Zeros = aligned) -> Arrays:
    """Return the arrays of a block with the given number of lanes, all 0 except the parameters.

    `zeros` makes an array from its shape and type.
    """
    system, forces, observed, method = plan.system, plan.forces, plan.observed, plan.method
    bodies, contacts, rows, single = len(system.bodies), len(system.ends), len(plan.noise.rows), plan.single

    plain = system.ends.plain
    of_bodies, of_contacts = partial(zeros, (bodies + 1, lanes)), partial(zeros, (contacts, lanes))
    state = State(
        x=of_bodies(),
        v=of_bodies(),
        reading=of_bodies(),
        velocity=of_bodies(),
        total=of_bodies(),
        indentation=of_contacts(),
        contact_force=of_contacts(),
        still=of_bodies(),
        work=method.work(rows, lanes, zeros),
    )
    slots = 0 if plan.subdomains.tiles else SLOTS
    history = History(*[zeros((slots, count, lanes)) for count in (bodies + 1,) * 3 + (contacts,) * 2])
    parameters = forces.parameters
    if forces.clocked:
        parameters = with_states(parameters, forces.states, lanes, zeros)
    sampled = sampled_of(CONTACT)
    sums = Sums(
        bodies=zeros((method.integrator.phases, plan.rows, observed.bodies, lanes)),
        contacts=zeros((FLUX + 1 + len(sampled), observed.contacts, lanes)),
        summed=FLUX + 1 + sum(not statistic.largest for statistic in sampled),
        samples=zeros((len(sampled_of(BODY)), observed.bodies, lanes)),
        products=zeros((PAIR_ROWS, len(method.pairs), lanes)),
        ends=system.ends.pairs if plain else np.zeros((0, 2), dtype=np.int64),
        pairs=method.pairs,
        indices=forces.indices,
        closings=Closings(
            before=zeros((2, observed.contacts * observed.counted, lanes)),
            jitter=observed.jitter,
            weights=forces.parameters[:0] if plain else forces.parameters,
            step=plan.clock.step,
            peaks=_peaks(plan, parameters, lanes, zeros),
        ),
        flux=Flux(
            window=observed.window[: len(system.ends) * ("contact_rate" not in observed.left_out)],
            half_kick=forces.half_kick,
            closing=zeros((4, contacts * (single or not plain), lanes)),
            push=zeros(((bodies + 1) * single * bool(len(forces.half_kick)), lanes)),
            kick=zeros((contacts * single, lanes)),
        ),
        turns=_turns(plan, lanes, zeros),
        points=plan.points.sums(lanes, zeros),
        read=plan.read,
    )
    streams, which = plan.noise.distinct
    of_streams = zeros((4, streams.shape[1] * bool(len(which)), lanes), np.float32)
    normals = zeros((4, rows, lanes), np.float32)
    room = Room(lanes, zeros, sums.contacts[FLUX], sums.closings.before[0], observed.told)
    events = tuple(part.arrays(room) for part in plan.events.parts)
    before = zeros(((bodies + 1) * bool(events), lanes))
    return Arrays(state, history, sums, normals, of_streams, parameters, before, events)


def _peaks(plan: Plan, parameters: np.ndarray, lanes: int, zeros: Zeros) -> Peaks:
    """Return the arrays with which peaks between steps are read; the function is set later."""
    contacts = plan.observed.contacts * bool(plan.observed.rated.any() or plan.observed.peaked)
    row = FLUX + 1 + [statistic.name for statistic in sampled_of(CONTACT)].index("peak_contact_force")
    return Peaks(0, zeros((PEAK_ROWS, contacts, lanes)), parameters, row, contacts * plan.observed.peaked)


def _turns(plan: Plan, lanes: int, zeros: Zeros) -> Turns:
    """Return arrays for the last kick, where the changes of velocity by flows are summed."""
    turning = plan.observed.bodies * (plan.rows > TURN)
    half = 0.5 * plan.clock.step / plan.system.linear[0]
    late = plan.method.late(plan.system.linear, plan.clock.step)[: plan.observed.bodies * plan.observed.kicked]
    return Turns(half=half, force=zeros((turning, lanes)), middle=zeros((turning, lanes)), late=late)
