"""The arguments that compiled loops take, and their types."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Annotated, Any, NamedTuple, Self

import numpy as np

from impactlab.compiling.force_type import ForceFunction
from impactlab.compiling.records import (
    Block,
    Blocks,
    BlockTable,
    Cube,
    Normals,
    Numbers,
    Realizations,
    Slots,
    SlotTable,
    Streams,
    Table,
    signature,
    type_of,
)
from impactlab.compiling.scalars import scalar
from impactlab.linear.systems import LinearSystem


class Noise(NamedTuple):
    """White noise on some bodies: rows of normals, two for a body whose flow needs them."""

    bodies: Slots  # (row,) slots, second rows last
    runs: SlotTable  # (run, 3) bodies that follow each other: the first, its row or -1, number
    seconds: int  # first of the second rows
    amplitude: Cube  # (phase, 2, row) of displacement and velocity, or nothing and force
    streams: Streams  # (3, stream) addresses of the streams, one for each row or, where rows share some, for those
    realizations: Realizations  # (lane,) indices
    scale: Table  # (1 or step, row) factor of the amplitude
    coarse: bool  # whether a step takes the noise of two steps of half the length
    normals: Normals  # (4, row, lane) of four steps, single precision
    which: Slots  # (row,) number of the stream of each row, nothing where each row has its own
    distinct: Normals  # (4, stream, lane) normals of the streams, nothing where each row has its own


class Series(NamedTuple):
    """Sums of cosines, and processes that go from sample to sample, on some bodies."""

    bodies: Slots  # (row,) slots
    samples: Cube  # (lane, row or 2 row, time): the force, or the response x and v, of sums of cosines
    near: Blocks  # (NEAR + 1, row or 2 row, lane): those of the next times, lanes side by side
    processes: SlotTable  # (process, 2) addresses of arrays and functions of those of the rows after sums of cosines


class Forced(NamedTuple):
    """Given forces on some bodies during one call."""

    bodies: Slots  # (row,) slots
    numbers: Slots  # (row,) which of the forces it is
    weights: Numbers  # (row,) factor of it
    force: Table  # (time, force): samples, or with `takes_response` mean and slope of each step in turn


class Driven(NamedTuple):
    """What acts on bodies from outside."""

    noise: Noise
    series: Series
    forced: Forced


class Cross(NamedTuple):
    """Blocks of the linear motion that carry one body to another."""

    bodies: SlotTable  # (block, 2) slots of the body that is reached and of the other
    flow: Table  # (block, 4) a_xx, a_xv, a_vx, a_vv
    noise: Table  # (block, 4) by the first and the second normal of the other: x, x, v, v
    push: Table  # (block, 4) x and v by a unit force on the other, by one that grows from -1 to 1 in a step
    rows: SlotTable  # (2, body) both rows of each body's noise, -1 for none; nothing where there are no blocks


class Tables(NamedTuple):
    """Numbers of the forces and of the method."""

    parameters: Numbers  # of the forces, and the states of their laws; see `impactlab.kernels.memory`
    indices: Slots
    coefficients: Cube  # (phase, column, body)
    cross: Cross
    tableau: Table  # (2, stage) nodes and weights of an explicit method
    events: SlotTable  # (mechanism, 4) addresses of arrays of mechanisms that locate events, and of their functions
    before: Block  # [body, lane] velocities before the flow, where there are any


WorkSpace = Annotated[Any, Blocks.__metadata__[0]]
"""[block, body, lane], or what a method needs in its place."""


class State(NamedTuple):
    """State of a block, and work space of its method; the last body is the wall."""

    x: Block  # [body, lane]
    v: Block  # [body, lane]
    reading: Block  # displacement at which contacts and densities are read
    velocity: Block  # velocity at the time of `reading`
    total: Block  # force [body, lane]
    indentation: Block  # [contact, lane]
    contact_force: Block  # [contact, lane]
    still: Block  # zeros [body, lane]
    work: WorkSpace


class History(NamedTuple):
    """The last steps, which go into the sums together; see `impactlab.kernels.sums`."""

    x: Blocks  # [slot, body, lane]
    v: Blocks  # velocity at the time of x
    force: Blocks  # force of the kick there
    indentation: Blocks  # [slot, contact, lane]
    contact_force: Blocks


@scalar
def slot_of(history, slot):  # type: ignore[no-untyped-def]
    """Return a slot of a history."""
    return History(
        history.x[slot], history.v[slot], history.force[slot], history.indentation[slot], history.contact_force[slot]
    )


class Peaks(NamedTuple):
    """What peaks of forces between steps are read with."""

    function: int  # address of the generated `peaks`; 0 where no force depends on a rate
    before: Blocks  # as in `impactlab.kernels.peaks.Between`
    parameters: Numbers  # of the forces, with the states
    row: int  # of the sums over contacts
    written: int  # contacts whose peaks are in snapshots: all that are summed, or none


class Closings(NamedTuple):
    """What closings of contacts are counted with, and peaks of their forces are read with."""

    before: Blocks  # [2, contact, lane] indentation and rate a step ago, nothing where they are not counted
    jitter: Numbers  # (contact,) what white noise changes a closing velocity by in a step, root mean square
    weights: Numbers  # of coordinates in gaps, see `impactlab.kernels.combinations`; nothing where all are pairs
    step: float  # (s)
    peaks: Peaks


class Flux(NamedTuple):
    """What the flux of gaps through contact is estimated with."""

    window: Numbers  # (contact,) half width (m)
    half_kick: Table  # (0 to 2, body) of a unit force: see `impactlab.plan.forces.Forces`
    closing: Blocks  # [step, contact, lane] closing velocities in four steps
    push: Block  # [body, lane] half of what a kick gives to velocities
    kick: Block  # [contact, lane] the same of closing velocities


class Turns(NamedTuple):
    """The last kick, where the force of kicks times what the flow adds to velocities is summed; else nothing."""

    half: Numbers  # (body,) half the velocity that a unit force of a kick gives
    force: Block  # [body, lane]
    middle: Block  # [body, lane] velocity
    late: Numbers  # as in `impactlab.kernels.powers`, where snapshots hold velocities at kicks; else nothing


class PointSums(NamedTuple):
    """Where a block adds up what it sees at points; see `impactlab.plan.structure_points`."""

    begin: Slots  # (point + 1,) where the entries of each begin
    bodies: Slots  # (entry,) slots
    weights: Cube  # (phase, column, entry), see `impactlab.kernels.points`
    sums: BlockTable  # (phase, row, point, lane)
    read: Block  # (4, lane) work space


class Sums(NamedTuple):
    """Where a block adds up its statistics; see `impactlab.kernels.sums`."""

    bodies: BlockTable  # (phase, row, body, lane)
    contacts: Blocks  # (row, contact, lane)
    summed: int  # rows over contacts that are sums; of the others the largest counts
    samples: Blocks  # (row, body, lane) of what statistics sample of bodies
    products: Blocks  # (9, pair, lane)
    ends: SlotTable  # (contact, 2), nothing where gaps have weights
    pairs: SlotTable  # (pair, 2) slots of bodies
    indices: Slots  # `impactlab.assembly.members.Members.indices`
    closings: Closings
    flux: Flux
    turns: Turns
    points: PointSums
    read: Slots  # (row,) of snapshots that are written; nothing where all are


class Account(NamedTuple):
    """The last steps, and the sums that they go into."""

    history: History
    sums: Sums


class Functions(NamedTuple):
    """Functions that a loop calls: the forces of the network, and others by their addresses."""

    forces: ForceFunction
    accept: int  # updates the states of laws: `impactlab.kernels.memory.ACCEPT`; 0 where there are none
    stretch: int  # makes several steps: `impactlab.integrators.stretches.stretch`; 0 where there is none
    fill: int  # writes the normals of four steps: `impactlab.kernels.random.fill_steps`
    near: int  # brings sums of cosines near: `impactlab.kernels.series.bring_near`
    add: int  # adds the history to the sums: `impactlab.kernels.sums.add_history`
    add_points: int  # adds it to those of points: `impactlab.kernels.points.add_history_of_points`
    add_turns_of_points: int  # adds two kicks to those: `impactlab.kernels.points.add_turns_of_points`


class Steps(NamedTuple):
    """Steps of one call."""

    step: float  # (s)
    samples: int  # of series and given forces in a step
    passes: int  # how often the forces of a kick are evaluated with the velocities that they give, 0: with none
    summing: bool  # whether every step adds to the sums
    remembering: bool  # whether laws have states
    clocked: bool  # whether they have some or depend on time
    spin_up: int  # index of the step that begins at time 0
    first: int  # index of the first step
    number: int
    every: int  # steps between snapshots, 0 for none
    phase: int  # steps since the last snapshot when it begins


class Within(NamedTuple):
    """What mechanisms that locate events find of the steps of a call; see `impactlab.integrators.located`."""

    state: State
    history: History
    before: Block  # [body, lane] velocities before the flow of a step
    steps: Steps


class Stretch(NamedTuple):
    """What several steps at once take; see `impactlab.integrators.stretches`."""

    parameters: Numbers  # of the forces
    coefficients: Cube  # (phase, column, body)
    amplitude: Cube  # as in `Noise`, and so the next two
    scale: Table
    normals: Normals
    weights: Numbers  # as in `Forced`, and so the next one
    force: Table
    state: State
    history: History
    steps: Steps


@cache
def loop_type(single: bool, tables: Any = Tables, work: Any = Blocks) -> Any:
    """Return the type of a loop, for blocks or for blocks of one lane; see `impactlab.integrators.driver.advance`."""
    state = type_of(State, single, work=work)
    return signature(single, Functions, tables, Driven, state, History, Sums, Blocks, Steps)


class NoiseRows(NamedTuple):
    """Rows of white noise, with the first row of each body first, by slot.

    Rows of one stream and one number have the same normals.
    """

    bodies: np.ndarray  # (row,) slots
    streams: tuple[str, ...]  # names of bodies or of sources
    numbers: np.ndarray  # (row,) which normal of the stream in a step, from 0 on
    noises: np.ndarray  # (row,) which white noise of the network it is, -1 where several are in one
    amplitude: np.ndarray  # (phase, row, 2) of displacement and velocity, or nothing and force

    def ordered(self) -> Self:
        """Return the rows in the order that the loops want."""
        _, first = np.unique(self.bodies, return_index=True)
        order = np.concatenate([first, np.setdiff1d(np.arange(len(self.bodies)), first)])
        streams = tuple(self.streams[row] for row in order)
        bodies, numbers, noises = (item[order] for item in (self.bodies, self.numbers, self.noises))
        return self._replace(
            bodies=bodies, streams=streams, numbers=numbers, noises=noises, amplitude=self.amplitude[:, order]
        )

    def with_others(self, others: Sequence[NoiseRows]) -> NoiseRows:
        """Return these rows and others."""
        parts = [self, *others]
        bodies, numbers, noises = (
            np.concatenate([getattr(part, name) for part in parts]) for name in ("bodies", "numbers", "noises")
        )
        streams = tuple(name for part in parts for name in part.streams)
        return NoiseRows(bodies, streams, numbers, noises, np.concatenate([part.amplitude for part in parts], axis=1))


class Group(NamedTuple):
    """Linear motion of bodies that couplings connect, (2 body, 2 body) matrices of all x, then all v; see `Flows`."""

    slots: np.ndarray  # (body,)
    system: LinearSystem
    transition: np.ndarray
    covariance: np.ndarray
    middle_transition: np.ndarray
    middle_covariance: np.ndarray


class Flows(NamedTuple):
    """Linear motion between kicks: ``z → A z`` plus normal numbers of covariance Q, (phase, body, 2, 2) each.

    For bodies in groups they are the blocks of their own.
    """

    transition: np.ndarray  # A from one kick to the next
    covariance: np.ndarray  # Q
    middle_transition: np.ndarray  # A from a kick to the middle of the flow
    middle_covariance: np.ndarray
    groups: tuple[Group, ...]
