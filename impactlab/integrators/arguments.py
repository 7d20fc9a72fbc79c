"""The arguments that compiled loops take, and their types."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, Self

import numpy as np
from numba import b1, f4, f8, i8, types, u4, u8, void

from impactlab.kernels.forces import FORCES, FORCES_OF_ONE
from impactlab.linear.systems import LinearSystem


class Noise(NamedTuple):
    """White noise on some bodies: rows of normals, two for a body whose flow needs them."""

    bodies: np.ndarray  # (row,) slots, second rows last
    runs: np.ndarray  # (run, 3) bodies that follow each other: the first, its row or -1, number
    seconds: int  # first of the second rows
    amplitude: np.ndarray  # (phase, 2, row) of displacement and velocity, or nothing and force
    streams: np.ndarray  # (3, stream) addresses of the streams, one for each row or, where rows share some, for those
    realizations: np.ndarray  # (lane,) indices
    scale: np.ndarray  # (1 or step, row) factor of the amplitude
    coarse: bool  # whether a step takes the noise of two steps of half the length
    normals: np.ndarray  # (4, row, lane) of four steps, single precision
    which: np.ndarray  # (row,) number of the stream of each row, nothing where each row has its own
    distinct: np.ndarray  # (4, stream, lane) normals of the streams, nothing where each row has its own


class Sparse(NamedTuple):
    """A matrix without its zeros, row by row."""

    begin: np.ndarray  # (row + 1,) where the entries of each row begin
    columns: np.ndarray  # (entry,)
    values: np.ndarray  # (entry,)


class Filters(NamedTuple):
    """Filters of noise and what they move; see `impactlab.linear.transitions.FilteredSteps`."""

    motion: Sparse  # states, then responses, by states
    noise: Sparse  # the same by normal numbers
    flow: Sparse  # of the responses
    output: Sparse  # forces by states, where methods take these
    pairs: np.ndarray  # (response, 3) rows of both parts of each response, -1 for none, and which envelope it has or -1
    envelopes: np.ndarray  # (output,) which envelope each force has, -1 for none
    streams: np.ndarray  # (3, normal) addresses of the normal numbers
    finer: int  # how many samples of the noise there are in one that is taken


class Shots(NamedTuple):
    """Impulses at random times and what they move, by moments: sums of sizes times Chebyshev polynomials of times."""

    response: Sparse  # states, then responses, by moments
    begin: np.ndarray  # (source + 1,) where the moments of each begin
    numbers: np.ndarray  # (3, source) expected number in a sample, mean and standard deviation of the sizes
    streams: np.ndarray  # (3, 2 source) addresses of the numbers of impulses, then of their times and sizes


class Coloured(NamedTuple):
    """Filtered white noises and impulses on some bodies, which go from sample to sample as the loop does."""

    function: int  # address of `impactlab.kernels.coloured.bring_coloured`; 0 where there are none
    filters: Filters
    realizations: np.ndarray  # (lane,) indices
    factors: np.ndarray  # (sample, 3, envelope) value at a sample; mean, and growth in half a sample from there on
    first: int  # number of the first of these samples
    place: np.ndarray  # (2,) numbers of the samples of the last two of `kept`
    kept: np.ndarray  # [3, state, lane] states at the start, and where the last samples that were taken begin and end
    work: np.ndarray  # [3, row, lane]
    normals: np.ndarray  # (4, normal, lane) single precision
    shots: Shots
    moments: np.ndarray  # (moment, lane)


class Series(NamedTuple):
    """Sums of cosines and filtered noises on some bodies, sampled in time."""

    bodies: np.ndarray  # (row,) slots
    samples: np.ndarray  # (lane, row or 2 row, time): the force, or the response x and v, of sums of cosines
    near: np.ndarray  # (NEAR + 1, row or 2 row, lane): those of the next times, lanes side by side
    coloured: Coloured  # the rows after those of sums of cosines


class Forced(NamedTuple):
    """Given forces on some bodies during one call."""

    bodies: np.ndarray  # (row,) slots
    numbers: np.ndarray  # (row,) which of the forces it is
    weights: np.ndarray  # (row,) factor of it
    force: np.ndarray  # (time, force): samples, or with `takes_response` mean and slope of each step in turn


class Driven(NamedTuple):
    """What acts on bodies from outside."""

    noise: Noise
    series: Series
    forced: Forced


class Cross(NamedTuple):
    """Blocks of the linear motion that carry one body to another."""

    bodies: np.ndarray  # (block, 2) slots of the body that is reached and of the other
    flow: np.ndarray  # (block, 4) a_xx, a_xv, a_vx, a_vv
    noise: np.ndarray  # (block, 4) by the first and the second normal of the other: x, x, v, v
    push: np.ndarray  # (block, 4) x and v by a unit force on the other, by one that grows from -1 to 1 in a step
    rows: np.ndarray  # (2, body) both rows of each body's noise, -1 for none; nothing where there are no blocks


class RigidContacts(NamedTuple):
    """Rigid contacts, and how they act."""

    contacts: np.ndarray  # (rigid,) which contacts they are
    begin: np.ndarray  # (rigid + 1,) where the entries of each begin
    bodies: np.ndarray  # (entry,) slots
    weights: np.ndarray  # (entry,) weights of their displacements in the gap
    shares: np.ndarray  # (entry,) velocity that a body gains where the rate of the gap grows by one unit
    numbers: np.ndarray  # (4, rigid) clearance, restitution, inertia, closing velocity from which impacts count
    flow: np.ndarray  # (3, body) rate of decay c/2m, square of the natural frequency, and h/m
    near_begin: np.ndarray  # (rigid + 1,) where those begin that share a body with each
    near: np.ndarray  # (pair,) which these are
    influence: np.ndarray  # (pair,) how much their rate grows where that of the contact grows by one unit


class Impacts(NamedTuple):
    """What impacts take, and what was seen of them in a step."""

    function: int  # address of `impactlab.kernels.impacts.collisions`; 0 where no contact is rigid
    rigid: RigidContacts
    streams: np.ndarray  # (3, rigid) addresses of the random numbers
    realizations: np.ndarray  # (lane,) indices
    spread: np.ndarray  # (1 or step, rigid) what noise adds to rates, σ
    ends: np.ndarray  # [5, rigid, lane] gaps and rates before and after the flow, and how far paths may reach
    paths: np.ndarray  # (10, rigid) of one lane
    before: np.ndarray  # [body, lane] velocities before the flow
    seen: np.ndarray  # [6, rigid, lane]
    closings: np.ndarray  # [contact, lane] sums of closings, to which impacts are added
    depths: np.ndarray  # [contact, lane] indentations from which closings are counted; nothing where they are not


class Flight(NamedTuple):
    """The flow of a step in which bodies may collide."""

    begin: np.ndarray  # displacements before it [body, lane]
    x: np.ndarray  # displacements after it, which are changed
    v: np.ndarray  # velocities after it, which are changed
    pushed: np.ndarray  # force of the kick before it [body, lane]
    impacts: Impacts
    step: float  # (s)
    row: int  # of the spread


class Rubs(NamedTuple):
    """Links of dry friction that sticks, and how they act; see `impactlab.kernels.dry_friction`."""

    begin: np.ndarray  # (link + 1,) where the entries of each begin
    bodies: np.ndarray  # (entry,) slots
    weights: np.ndarray  # (entry,) weights of their displacements in the coordinate that slips
    shares: np.ndarray  # (entry,) velocity that a body gains where that of the coordinate grows by one unit
    numbers: np.ndarray  # (4, link) force of sliding, breakaway force, velocity of the surface, inertia
    motion: np.ndarray  # (14, body)


class Rubbing(NamedTuple):
    """What dry friction takes, and what is known of it at the end of a step."""

    function: int  # address of `impactlab.kernels.dry_friction.rub`; 0 where there is none
    links: Rubs
    before: np.ndarray  # [body, lane] velocities before the flow
    earlier: np.ndarray  # [entry, lane] force of the kick before the last one
    work: np.ndarray  # (6, entry) of one lane
    series: np.ndarray  # (entry + 1, order) of one lane
    seen: np.ndarray  # [2, link, lane]


class Slide(NamedTuple):
    """The flow of a step in which bodies may slip and stick."""

    begin: np.ndarray  # displacements before it [body, lane]
    x: np.ndarray  # displacements after it, which are changed
    v: np.ndarray  # velocities after it, which are changed
    pushed: np.ndarray  # force of the kick before it [body, lane]
    rubbing: Rubbing
    step: float  # (s)


class Events(NamedTuple):
    """What happens between kicks."""

    impacts: Impacts
    rubbing: Rubbing


class Tables(NamedTuple):
    """Numbers of the forces and of the method."""

    parameters: np.ndarray  # of the forces, and the states of their laws; see `impactlab.kernels.memory`
    indices: np.ndarray
    coefficients: np.ndarray  # (phase, column, body)
    cross: Cross
    tableau: np.ndarray  # (2, stage) nodes and weights of an explicit method
    impacts: Impacts  # of rigid contacts
    rubbing: Rubbing  # of dry friction that sticks


class State(NamedTuple):
    """State of a block, and work space of its method; the last body is the wall."""

    x: np.ndarray  # [body, lane]
    v: np.ndarray  # [body, lane]
    reading: np.ndarray  # displacement at which contacts and densities are read
    velocity: np.ndarray  # velocity at the time of `reading`
    total: np.ndarray  # force [body, lane]
    indentation: np.ndarray  # [contact, lane]
    contact_force: np.ndarray  # [contact, lane]
    still: np.ndarray  # zeros [body, lane]
    work: Any  # [block, body, lane], or what a method needs in its place


class History(NamedTuple):
    """The last steps, which go into the sums together; see `impactlab.kernels.sums`."""

    x: np.ndarray  # [slot, body, lane]
    v: np.ndarray  # velocity at the time of x
    force: np.ndarray  # force of the kick there
    indentation: np.ndarray  # [slot, contact, lane]
    contact_force: np.ndarray


class Peaks(NamedTuple):
    """What peaks of forces between steps are read with."""

    function: int  # address of the generated `peaks`; 0 where no force depends on a rate
    before: np.ndarray  # as in `impactlab.kernels.peaks.Between`
    parameters: np.ndarray  # of the forces, with the states
    row: int  # of the sums over contacts
    written: int  # contacts whose peaks are in snapshots: all that are summed, or none


class Closings(NamedTuple):
    """What closings of contacts are counted with, and peaks of their forces are read with."""

    before: np.ndarray  # [2, contact, lane] indentation and rate a step ago, nothing where they are not counted
    jitter: np.ndarray  # (contact,) what white noise changes a closing velocity by in a step, root mean square
    weights: np.ndarray  # of coordinates in gaps, see `impactlab.kernels.combinations`; nothing where all are pairs
    step: float  # (s)
    peaks: Peaks


class Flux(NamedTuple):
    """What the flux of gaps through contact is estimated with."""

    window: np.ndarray  # (contact,) half width (m)
    half_kick: np.ndarray  # (0 to 2, body) of a unit force: see `impactlab.plan.forces.Forces`
    closing: np.ndarray  # [step, contact, lane] closing velocities in four steps
    push: np.ndarray  # [body, lane] half of what a kick gives to velocities
    kick: np.ndarray  # [contact, lane] the same of closing velocities


class Turns(NamedTuple):
    """The last kick, where the force of kicks times what the flow adds to velocities is summed; else nothing."""

    half: np.ndarray  # (body,) half the velocity that a unit force of a kick gives
    force: np.ndarray  # [body, lane]
    middle: np.ndarray  # [body, lane] velocity


class PointSums(NamedTuple):
    """Where a block adds up what it sees at points; see `impactlab.plan.points`."""

    begin: np.ndarray  # (point + 1,) where the entries of each begin
    bodies: np.ndarray  # (entry,) slots
    weights: np.ndarray  # (phase, column, entry), see `impactlab.kernels.points`
    sums: np.ndarray  # (phase, row, point, lane)
    read: np.ndarray  # (4, lane) work space


class Sums(NamedTuple):
    """Where a block adds up its statistics; see `impactlab.kernels.sums`."""

    bodies: np.ndarray  # (phase, row, body, lane)
    contacts: np.ndarray  # (row, contact, lane)
    summed: int  # rows over contacts that are sums; of the others the largest counts
    samples: np.ndarray  # (row, body, lane) of what statistics sample of bodies
    products: np.ndarray  # (9, pair, lane)
    ends: np.ndarray  # (contact, 2), nothing where gaps have weights
    pairs: np.ndarray  # (pair, 2) slots of bodies
    indices: np.ndarray  # `impactlab.assembly.members.Members.indices`
    closings: Closings
    flux: Flux
    turns: Turns
    points: PointSums


class Account(NamedTuple):
    """The last steps, and the sums that they go into."""

    history: History
    sums: Sums


class Functions(NamedTuple):
    """Functions that a loop calls: the forces of the network, and others by their addresses."""

    forces: Any
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


class Stretch(NamedTuple):
    """What several steps at once take; see `impactlab.integrators.stretches`."""

    parameters: np.ndarray  # of the forces
    coefficients: np.ndarray  # (phase, column, body)
    amplitude: np.ndarray  # as in `Noise`, and so the next two
    scale: np.ndarray
    normals: np.ndarray
    weights: np.ndarray  # as in `Forced`, and so the next one
    force: np.ndarray
    state: State
    history: History
    steps: Steps


def array(dimensions: int, kind: Any = f8) -> Any:
    """Type of an array, of which the last axis is contiguous."""
    return types.Array(kind, dimensions, "C")


def named(kind: Any, *items: Any) -> Any:
    """Type of a named tuple."""
    constructor: Any = types.NamedTuple if len(set(items)) > 1 else types.NamedUniTuple
    return constructor(items, kind) if len(set(items)) > 1 else constructor(items[0], len(items), kind)


class _Types:
    """Types of what loops take, for blocks that have an axis of lanes or not."""

    def __init__(self, single: bool) -> None:
        lane = 0 if single else 1
        numbers, table, cube, slots, pairs = array(1), array(2), array(3), array(1, i8), array(2, i8)
        normals = array(2 + lane, f4)
        block, blocks, sums = array(1 + lane), array(2 + lane), array(3 + lane)
        self.forces = FORCES_OF_ONE if single else FORCES
        cross = named(Cross, pairs, table, table, table, pairs)
        rigid = named(RigidContacts, slots, slots, slots, numbers, numbers, table, table, slots, slots, numbers)
        self.impacts = named(
            Impacts, i8, rigid, array(2, u8), array(1, u4), table, blocks, table, block, blocks, block, block
        )
        self.flight = named(Flight, block, block, block, block, self.impacts, f8, i8)
        rubs = named(Rubs, slots, slots, numbers, numbers, table, table)
        self.rubbing = named(Rubbing, i8, rubs, block, block, table, table, blocks)
        self.slide = named(Slide, block, block, block, block, self.rubbing, f8)
        self.tables = named(Tables, numbers, slots, cube, cross, table, self.impacts, self.rubbing)
        self.noise = named(
            Noise, slots, pairs, i8, cube, array(2, u8), array(1, u4), table, b1, normals, slots, normals
        )
        sparse = named(Sparse, slots, slots, numbers)
        filters = named(Filters, *[sparse] * 4, pairs, slots, array(2, u8), i8)
        shots = named(Shots, sparse, slots, table, array(2, u8))
        self.coloured = named(
            Coloured, i8, filters, array(1, u4), cube, i8, slots, blocks, blocks, normals, shots, block
        )
        self.series = named(Series, slots, cube, blocks, self.coloured)
        self.driven = named(Driven, self.noise, self.series, named(Forced, slots, slots, numbers, table))
        self.state = named(State, *[block] * 8, blocks)
        self.history = named(History, *[blocks] * 5)
        closings, points = (
            named(Closings, blocks, numbers, numbers, f8, named(Peaks, i8, blocks, numbers, i8, i8)),
            named(PointSums, slots, slots, cube, sums, block),
        )
        flux, turns = named(Flux, numbers, table, blocks, block, block), named(Turns, numbers, block, block)
        self.sums = named(Sums, sums, blocks, i8, blocks, blocks, pairs, pairs, slots, closings, flux, turns, points)
        self.steps = named(Steps, f8, i8, i8, b1, b1, b1, i8, i8, i8, i8, i8)
        self.account = named(Account, self.history, self.sums)
        self.functions = named(Functions, self.forces, *[i8] * 7)
        self.stretch = named(
            Stretch, numbers, cube, cube, table, normals, numbers, table, self.state, self.history, self.steps
        )
        self.loop = void(
            self.functions, self.tables, self.driven, self.state, self.history, self.sums, blocks, self.steps
        )


OF_LANES, OF_ONE = _Types(False), _Types(True)


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
