"""Plans of networks of one structure as one plan: their bodies side by side, in one compiled run.

Body b of network p has the slot ``b n + p`` among n networks, and so have contacts, noises and all else that is
counted: rows of network p are every n-th one from p on. Nothing connects the networks, and each has random numbers of
its own, so that it moves bit for bit as it does alone.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from impactlab.assembly.links import Pairs
from impactlab.assembly.members import Members, Table, packed
from impactlab.assembly.model import Model
from impactlab.integrators.arguments import Flows
from impactlab.machine import tuning
from impactlab.plan.driving import Driving
from impactlab.plan.forces import Forces
from impactlab.plan.method import Method
from impactlab.plan.noise import Shares, WhiteNoises, noise_runs
from impactlab.plan.observed import Observed
from impactlab.plan.plan import Plan, System
from impactlab.plan.realizations import STEP_SECONDS, lane_seconds
from impactlab.plan.start import Start
from impactlab.plan.subdomains import Subdomains


class Planned(NamedTuple):
    """A network and its plan."""

    model: Model
    plan: Plan


def structure(planned: Planned) -> Hashable:
    """Return the key that plans must share to be joined: everything but their numbers."""
    model, plan = planned
    system, forces, method, noise, driving = plan.system, plan.forces, plan.method, plan.noise, plan.driving
    clock, observed = plan.clock, plan.observed
    slots = (
        system.ends.pairs, system.links.pairs, noise.white, noise.rows, noise.noises, driving.forced, driving.forces,
        noise.shares.noise, noise.shares.body, *(leading for leading, _ in model.members.tables),
    )  # fmt: skip
    return (
        forces.text, forces.passes, len(forces.half_kick), model.members.kinds, method.integrator,
        method.coefficients.shape, noise.amplitude.shape, noise.time_varying, tuple(item.tobytes() for item in slots),
        clock.step, clock.spin_up_steps, clock.steps, clock.boundaries, plan.transient,
        plan.start.state.shape if isinstance(plan.start.state, np.ndarray) else plan.start.state,
        plan.realizations.number, plan.realizations.lanes, observed.every, observed.counted, observed.sampled,
        observed.peaked, observed.kicked, observed.left_out, tuple(ratio for _, ratio in observed.records),
        forces.timed.tobytes(),
    )  # fmt: skip


def side_by_side(planned: Sequence[Planned]) -> Plan:
    """Return the plan of all networks; their plans have one `structure`, and their mechanisms meet `Mode.SIDE_BY_SIDE`.

    It has no records: each network keeps its own.
    """
    plans = [plan for _, plan in planned]
    first, number = plans[0], len(plans)
    given = _given_forces([model.members for model, _ in planned], first.driving.given)
    of_lane = lane_seconds(len(first.system.bodies), len(first.system.links), 0) * number
    calls = STEP_SECONDS + of_lane * first.realizations.lanes
    return replace(
        first,
        system=_system([plan.system for plan in plans]),
        forces=_forces([model for model, _ in planned], [plan.forces for plan in plans], given),
        method=_method([plan.method for plan in plans]),
        noise=_noise([plan.noise for plan in plans], len(first.system.bodies)),
        driving=_driving([plan.driving for plan in plans], len(first.system.bodies), given),
        start=_start([plan.start for plan in plans]),
        realizations=replace(
            first.realizations, networks=number, steps_per_call=max(1, int(tuning().call_seconds / calls))
        ),
        observed=_observed([plan.observed for plan in plans]),
        subdomains=Subdomains(0, ()),
    )


def together(arrays: Sequence[np.ndarray], axis: int = -1) -> np.ndarray:
    """Return the arrays of networks as one, with their rows along an axis side by side."""
    shape, axis = list(arrays[0].shape), axis % arrays[0].ndim
    shape[axis] *= len(arrays)
    return np.ascontiguousarray(np.stack(arrays, axis=axis + 1).reshape(shape))


def _places(numbers: np.ndarray, count: int, last: int | None = None) -> np.ndarray:
    """Return the places of things among those of all networks, by network as their rows are; one may be the wall's.

    −1 is nothing, and stays so.
    """
    each = numbers[..., None] * count + np.arange(count)
    each[numbers < 0] = -1
    if last is not None:
        each[numbers == last] = last * count
    return np.ascontiguousarray(np.moveaxis(each, -1, 1).reshape(-1, *numbers.shape[1:]))


def _links(count: int, pairs: np.ndarray, number: int) -> Pairs:
    return Pairs(count * number, _places(pairs, number, count))


def _system(systems: Sequence[System]) -> System:
    first, number = systems[0], len(systems)
    count = len(first.bodies)
    return System(
        tuple(name for name in first.bodies for _ in systems),
        tuple(name for name in first.contacts for _ in systems),
        together([item.linear for item in systems]),
        _links(count, first.ends.pairs, number),
        together([item.clearance for item in systems]),
        _links(count, first.links.pairs, number),
        first.refusals,
    )


def _given_forces(members: Sequence[Members], count: int) -> np.ndarray:
    """Return which number each given force of each network has, (force, network): networks with equal ones share them.

    The forces of a network follow each other.
    """
    kinds = [index for index, kind in enumerate(members[0].kinds) if kind.role == "forcing"]
    forces = [b"".join(item.tables[index][1].tobytes() for index in kinds) for item in members]
    seen = {numbers: place for place, numbers in enumerate(dict.fromkeys(forces))}
    sets = [seen[numbers] for numbers in forces]
    return np.asarray(np.arange(count)[:, None] + count * np.array(sets))


def _tables(members: Sequence[Members], walls: int, given: np.ndarray) -> list[Table]:
    """Return the members of all networks, kind by kind."""
    number, tables = len(members), []
    roles = zip(members[0].kinds, members[0].tables, strict=True)
    noises = sum(len(leading) for kind, (leading, _) in roles if kind.role == "intensity")
    for index, kind in enumerate(members[0].kinds):
        leading, _ = members[0].tables[index]
        numbers = together([item.tables[index][1] for item in members], axis=0)
        if kind.role == "forcing":
            rows, chosen = np.unique(given[leading[:, 0]].ravel(), return_index=True)
            tables.append((rows[:, None], numbers[chosen]))
        elif kind.role == "intensity":
            tables.append((_noise_numbers(leading[:, 0], noises, number)[:, None], numbers))
        else:
            last = walls if kind.role == "coupling" else None
            tables.append((_places(leading, number, last), numbers))
    return tables


def _noise_numbers(numbers: np.ndarray, noises: int, count: int) -> np.ndarray:
    """Return the numbers of noises among those of all networks, one network after the other; −1 is none."""
    each = numbers[:, None] + noises * np.arange(count)
    each[numbers < 0] = -1
    return each.ravel()


def _forces(models: Sequence[Model], forces: Sequence[Forces], given: np.ndarray) -> Forces:
    first, number, wall = forces[0], len(forces), models[0].wall
    tables = _tables([model.members for model in models], wall, given)
    ends = _links(wall, models[0].ends.pairs, number)
    parameters, indices, _ = packed(tables, ends, models[0].members.samples)
    half_kick = together([item.half_kick[:, :-1] for item in forces])
    return replace(
        first,
        parameters=parameters,
        indices=indices,
        half_kick=np.pad(half_kick, ((0, 0), (0, 1))),
        timed=together([item.timed for item in forces]),
        timed_contacts=together([item.timed_contacts for item in forces]),
        likely=together([item.likely for item in forces]),
        kicked=together([item.kicked for item in forces]),
    )


def _method(methods: Sequence[Method]) -> Method:
    coefficients = together([item.coefficients for item in methods])
    flows = [item.flows for item in methods if item.flows is not None]
    if not flows:
        return replace(methods[0], coefficients=coefficients)
    a, q, middle_a, middle_q = (together(item, axis=1) for item in zip(*(item[:4] for item in flows), strict=True))
    return replace(methods[0], coefficients=coefficients, flows=Flows(a, q, middle_a, middle_q, ()))


def _noise(noises: Sequence[WhiteNoises], bodies: int) -> WhiteNoises:
    first, number = noises[0], len(noises)
    rows, of_one = _places(first.rows, number), first.shares.noises
    shares = Shares(
        _noise_numbers(first.shares.noise, of_one, number), _places(first.shares.body, number),
        together([item.shares.share for item in noises]), of_one * number, first.shares.bodies * number,
    )  # fmt: skip
    return replace(
        first,
        white=_places(first.white, number),
        rows=rows,
        runs=noise_runs(rows, bodies * number),
        shares=shares,
        noises=_noise_numbers(first.noises, of_one, number),
        amplitude=together([item.amplitude for item in noises]),
        streams=together([item.streams for item in noises]),
        intensity=together([item.intensity for item in noises]),
        random=together([item.random for item in noises]),
        common=together([item.common for item in noises]),
    )


def _driving(drivings: Sequence[Driving], bodies: int, given: np.ndarray) -> Driving:
    first, number = drivings[0], len(drivings)
    highest = np.empty(int(given.max(initial=-1)) + 1)
    highest[given] = np.stack([item.highest for item in drivings], axis=1)
    return replace(
        first,
        forced=_places(first.forced, number),
        highest=highest,
        forces=given[first.forces].ravel(),
        weights=together([item.weights for item in drivings]),
        interrupted=np.zeros(bodies * number, dtype=bool),
        sets=len(highest) // max(first.given, 1) or 1,
    )


def _start(starts: Sequence[Start]) -> Start:
    first, number = starts[0], len(starts)
    states = [item.state for item in starts if isinstance(item.state, np.ndarray)]
    return replace(
        first,
        state=together(states, axis=1) if states else first.state,
        streams=together([item.streams for item in starts]),
        deviations=together([item.deviations for item in starts]),
        factors=tuple(
            (slots * number + place, factor) for place, item in enumerate(starts) for slots, factor in item.factors
        ),
        rest=together([item.rest for item in starts]),
    )


def _observed(observed: Sequence[Observed]) -> Observed:
    first, number = observed[0], len(observed)
    return replace(
        first,
        records=(),
        window=together([item.window for item in observed]),
        jitter=together([item.jitter for item in observed]),
        rated=together([item.rated for item in observed]),
        bodies=first.bodies * number,
        contacts=first.contacts * number,
    )
