"""What a simulation will do, decided before it runs, as plain data."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from impactlab.certified import certified
from impactlab.component import finite
from impactlab.composition import Composition
from impactlab.counting import counts_closings, jitter
from impactlab.damping import damped
from impactlab.errors import InvalidInput
from impactlab.forces import stiffening_of
from impactlab.generate import generate
from impactlab.given import kinds_of
from impactlab.integrators.base import Cross, Flows, Integrator
from impactlab.integrators.exact_flow import kick_share, kick_width
from impactlab.integrators.jumps import Jumps, WholeFlow
from impactlab.intervals import LEAF, foreseen_levels, jump_lanes, jump_tables, may_jump, sampled_will_do
from impactlab.kernels.random import addresses, streams_of
from impactlab.kernels.sums import KICK_ROWS, STATE_ROWS
from impactlab.kinks import warn_of_kinks
from impactlab.linear import (
    Lines,
    flowing_systems,
    linear_variances,
    lines_of,
    relaxation_time,
    responses,
)
from impactlab.model import Model, connected_parts
from impactlab.relaxation import Relaxation, closing_rates, spin_up_of, warn_of_unknown_damping
from impactlab.rules import (
    CALL_SECONDS,
    MOST_SAMPLES,
    MOST_STEPS,
    RELAXATION_TIMES,
    SETTLED,
    TRANSIENT,
    batch_count,
    block_shape,
    check_periods,
    choose_step,
    enough_units,
    fit_step,
    highest_step,
    most_lanes,
    positive,
    start_of,
    warn_of_bands,
)
from impactlab.scene import Stiffening, energies, gap_scale, met_energies, start_factors
from impactlab.series import sample_count, sampling_seconds
from impactlab.tiles import Tile, make_tiles, noise_runs

if TYPE_CHECKING:
    from impactlab.record import Record

NEVER = 1e-3
"""Closings of a contact expected in a run, below which it is taken for one that cannot close."""

WINDOW = 0.2
"""Half width of the window of the contact rate, as a part of the length over which the density of a gap varies."""


@dataclass(frozen=True, eq=False)
class Plan:
    """Everything that a worker needs to run a block, as plain picklable data.

    Attributes
    ----------
    text : str
        Generated module.
    integrator : Integrator
        Method.
    coefficients : (phase, column, body) ndarray
        The method's numbers.
    cross : Cross
        Blocks of the linear motion between bodies.
    flows : Flows or None
        What is between kicks.
    parameters, indices : ndarray
        What the generated functions take.
    linear : (3, body) ndarray
        Mass, damping and stiffness.
    ends, clearance, window : ndarray
        Of the contacts: slots of the bodies, clearance (m), half width for the rate (m).
    links : (link, 2) ndarray of int
        Slots of the bodies of each contact, then of each coupling.
    counted : bool
        Whether rates are counts of closings, not fluxes through the windows.
    jitter : (contact,) ndarray
        What noise changes closing velocities by in a step, root mean square (m s-1).
    half_kick : (0 to 2, body) ndarray
        Of what a unit force of a kick gives the velocity of each body and the wall: how far velocities are spread
        around their own time, half of it without friction; and, where friction slows bodies within a step, what those
        in the middle of the kick lack. Nothing where no body feels another force than that of one contact.
    likely : (contact,) ndarray of bool
        Whether each contact may close in the run.
    kicked : (body,) ndarray of bool
        Whether these, couplings that do not flow or a residual force act on each body.
    passes : int
        How often a kick evaluates forces that depend on velocities, 0 where there are none.
    certified : bool
        Whether the automatic step of such a network is right without a measurement.
    automatic : float
        The step that is chosen where none is given (s); 0 where none can be. Where a larger one was measured, that from
        which its biases are to be expected to grow with its square.
    time_varying : bool
        Whether white noise depends on time.
    white : (white,) ndarray of int
        Slots of the bodies under white noise.
    noise_rows : (row,) ndarray of int
        Slots of the bodies by row of noise; second rows of some come last.
    noise_runs : (run, 3) ndarray of int
        Bodies that follow each other, as do their first rows: first body, its row or -1, number.
    amplitude : (phase, 2, row) ndarray
        Amplitude of the rows.
    streams, starts : (3, row), (3, body) ndarray of uint64
        Addresses of the noise and of the random start.
    seed : tuple of int
        128 bits.
    intensity : (white,) ndarray
        Density of the noise on `white` that the amplitudes were made with.
    random : (body,) ndarray of bool
        Whether noise reaches each body.
    lines : tuple of Lines
    responses : tuple
        What each of `lines` moves; see `impactlab.linear.responses`.
    forced : (row,) ndarray of int
        Slots of the bodies under given forces.
    start : str or (2, body) ndarray
        "stationary", "rest", or displacements and velocities.
    deviations : (2, body) ndarray
        Standard deviations of displacement and velocity under white noise, for a stationary start.
    factors : tuple
        Pairs for such a start: slots of bodies that couplings connect, root of the covariance of their (x, v).
    rest : (body,) ndarray
        Displacements of bodies that start at rest (m).
    step : float
    spin_up_steps, steps : int
    boundaries : tuple of int
        Steps at which batches end; the last is `steps`.
    every : int
        Steps between snapshots, 0 for none.
    records : tuple
        Pairs of a resolved record and the number of snapshots between its own.
    bodies, contacts : tuple of str
        Names by slot.
    realizations, lanes, steps_per_call : int
    trusted : bool
        Whether there are enough independent realizations or batches for standard errors.
    relaxation : float
        Longest time after which samples are independent (s), 0 if nothing is damped.
    settling : float
        Relaxation time of what the start does not know (s).
    coarse : bool
        Whether a step takes the noise that a run at half the step has in two.
    sampled : bool
        Whether states are samples of a stationary motion, not all that there are.
    jumps : Jumps or None
        How intervals in which nothing can touch are covered at once.
    own_bodies, own_contacts : int
        How many are summed, from the first on.
    tile_steps : int
        Steps that tiles make alone.
    tiles : tuple of Tile
        Parts of a large network that run in turn, if any.
    """

    text: str
    integrator: Integrator
    coefficients: np.ndarray
    cross: Cross
    flows: Flows | None
    parameters: np.ndarray
    indices: np.ndarray
    linear: np.ndarray
    ends: np.ndarray
    clearance: np.ndarray
    window: np.ndarray
    counted: bool
    jitter: np.ndarray
    half_kick: np.ndarray
    links: np.ndarray
    likely: np.ndarray
    kicked: np.ndarray
    passes: int
    certified: bool
    automatic: float
    time_varying: bool
    white: np.ndarray
    noise_rows: np.ndarray
    noise_runs: np.ndarray
    amplitude: np.ndarray
    streams: np.ndarray
    starts: np.ndarray
    seed: tuple[int, int]
    intensity: np.ndarray
    random: np.ndarray
    lines: tuple[Lines, ...]
    responses: tuple[tuple[np.ndarray, np.ndarray], ...]
    forced: np.ndarray
    start: str | np.ndarray
    deviations: np.ndarray
    factors: tuple[tuple[np.ndarray, np.ndarray], ...]
    rest: np.ndarray
    step: float
    spin_up_steps: int
    steps: int
    boundaries: tuple[int, ...]
    every: int
    records: tuple[tuple[Any, int], ...]
    bodies: tuple[str, ...]
    contacts: tuple[str, ...]
    realizations: int
    lanes: int
    steps_per_call: int
    trusted: bool
    relaxation: float
    settling: float
    coarse: bool
    sampled: bool
    jumps: Jumps | None
    own_bodies: int
    own_contacts: int
    tile_steps: int
    tiles: tuple[Tile, ...]

    @property
    def blocks(self) -> int:
        """Number of blocks."""
        return -(-self.realizations // self.lanes)

    @property
    def settled(self) -> bool:
        """Whether the spin-up is long enough for balances to be used."""
        return self.spin_up_steps * self.step >= SETTLED * self.settling * (1.0 - 1e-9)

    @property
    def steady(self) -> bool:
        """Whether noise moves the bodies, and nothing but too short a spin-up keeps it from being stationary."""
        transient = isinstance(self.start, np.ndarray) or self.time_varying or len(self.forced)
        return not transient and bool(len(self.white) or self.lines)

    @property
    def transient(self) -> bool:
        """Whether the states at the start and the end of the measurement count: it is no sample of a stationary motion.

        Sums then have rows for it; see `impactlab.kernels.sums`. So have those under cosines, whose mean velocity
        is known from the states at both ends only.
        """
        steady = self.steady and self.settled and self.relaxation > 0.0 and not self.lines
        return not (self.sampled or steady)

    @property
    def rows(self) -> int:
        """Rows of the sums over bodies that the loop makes."""
        if not self.integrator.kicks:
            return STATE_ROWS
        return KICK_ROWS + bool(self.lines or len(self.forced))

    @property
    def grouped(self) -> np.ndarray:
        """Whether each body is in a group of `flows`, (body,) of bool."""
        groups = self.flows.groups if self.flows is not None else ()
        result = np.zeros(len(self.bodies), dtype=bool)
        for group in groups:
            result[group.slots] = True
        return result

    @property
    def cold(self) -> np.ndarray:
        """Slots of bodies that nothing but kicks moves, in parts of the network that are excited, (some,)."""
        driven = np.zeros(len(self.bodies), dtype=bool)
        for slots in (self.noise_rows, self.forced, *(slots for slots, _ in self.responses)):
            driven[slots] = True
        labels = connected_parts(len(driven), self.links)
        return np.flatnonzero(~driven & np.isin(labels, labels[driven]))

    @property
    def pairs(self) -> np.ndarray:
        """Slots of the pairs of bodies of each group of `flows`, (pair, 2)."""
        groups = self.flows.groups if self.flows is not None else ()
        pairs = [np.stack(np.triu_indices(len(group.slots), 1), axis=1) for group in groups]
        none = np.zeros((0, 2), dtype=np.int64)
        return np.concatenate([none, *(group.slots[pair] for group, pair in zip(groups, pairs, strict=True))])

    def seconds(self, workers: int) -> float:
        """Time that the run will take on so many cores, roughly (s)."""
        rounds = -(-self.blocks // workers)
        interval = self.step / self.integrator.samples_per_step
        samples = (self.spin_up_steps + self.steps) * self.integrator.samples_per_step + 1
        rows = [2 * len(slots) if self.integrator.takes_response else 1 for slots, _ in self.responses]
        sampling = sum(
            row * sampling_seconds(item, interval, samples) for row, item in zip(rows, self.lines, strict=True)
        )
        stepping = (self.spin_up_steps + self.steps) / self.steps_per_call * CALL_SECONDS
        return rounds * (stepping + min(self.lanes, self.realizations) * sampling)

    def realizations_of(self, block: int) -> np.ndarray:
        """Indices of the realizations in a block."""
        return np.arange(block * self.lanes, min((block + 1) * self.lanes, self.realizations), dtype=np.uint32)

    def counts(self, begin: int, end: int) -> np.ndarray:
        """Return how many of some steps after the spin-up are in each phase of the method's cycle, (phase,)."""
        phases = self.integrator.phases
        last = phases - 1 - np.arange(phases)
        steps: np.ndarray = (self.spin_up_steps + end + last) // phases - (self.spin_up_steps + begin + last) // phases
        return steps


def make_plan(
    network: Composition,
    *,
    duration: float,
    realizations: int,
    step: float | None,
    integrator: Integrator,
    spin_up: float | None,
    initial: Any,
    records: Sequence[Record],
    seed: tuple[int, int],
    workers: int,
    coarse: bool = False,
    model: Model | None = None,
    ceiling: float = math.inf,
    velocity: np.ndarray | None = None,
) -> Plan:
    """Decide everything about a simulation before it runs.

    Parameters are those of `simulate`; `workers` is the number of blocks that run at once, and a
    coarse run has the noise of one at half the step. The `model` of the network, if it is there already. An
    automatic step is at most the `ceiling`; it may be larger than the rules want where the mean square `velocity` of
    each body is known (m2 s-2), (body,), since it will be measured.

    Raises
    ------
    InvalidInput
        If something cannot be done; the message says what would work.
    """
    model = model or Model.of(network)
    integrator.check(model)
    duration = positive("duration", duration)
    if (
        isinstance(realizations, bool)
        or not isinstance(realizations, int | np.integer)
        or not 1 <= realizations < 2**32
    ):
        raise InvalidInput(f"realizations must be a whole number from 1 to 2^32 - 1, {realizations!r} was given.")
    start = start_of(initial, model)
    records = [record.resolved(model) for record in records]
    intervals = _intervals(records, duration)
    linear = relaxation_time(damped(model)[1])
    automatic = spin_up is None and isinstance(start, str) and bool(network.excitations)
    if spin_up is None:
        spin_up = RELAXATION_TIMES * linear if automatic else 0.0
    elif finite("spin_up", spin_up) < 0.0:
        raise InvalidInput(f"spin_up must be at least 0 s, {spin_up!r} was given.")
    stiffening = stiffening_of(model, energies(model, start, duration, spin_up))
    relaxed = Relaxation.of(model, stiffening)
    relaxation, settling = relaxed.slowest, max(linear, relaxed.settling)
    if automatic:
        spin_up = spin_up_of(relaxed, spin_up, duration)
        warn_of_unknown_damping(model, spin_up)
    met = stiffening
    if velocity is not None:
        met = Stiffening.of(model, np.minimum(stiffening.energy, met_energies(model, velocity)))
    model = integrator.arrange(model, stiffening.links, stiffening.bodies)
    period = check_periods(model, duration + spin_up)
    given = None if step is None else positive("step", step)
    chosen = choose_step(model, integrator, met, given, -spin_up, duration, start)
    rule = chosen
    if given is None and velocity is not None:
        chosen = max(chosen, highest_step(model, integrator, met, -spin_up, duration, start))
    chosen = min(chosen, ceiling)
    settled = isinstance(start, str) and (start == "stationary" or spin_up >= SETTLED * settling * (1.0 - 1e-9))
    sampled = settled and sampled_will_do(model, integrator, records)
    still = sampled and not model.nonlinear_bodies.any()
    if given is None and (not settled or kinds_of(model)) and not model.nonlinear_bodies.any():
        chosen = min(chosen, TRANSIENT * integrator.recommended_step(model, stiffening.links, stiffening.bodies))
    if given is None and still:
        chosen = max(chosen, duration / (MOST_SAMPLES * batch_count(realizations, duration, relaxation)))
    if given is None and not model.nonlinear_bodies.any():
        chosen = min([chosen, *(record.longest_step(model) for record in records)])
    periods = [] if given is not None or period is None else [period]
    if all(_divides(interval, each) for each in periods for interval in intervals[:1]):
        intervals += periods
    window = WINDOW * gap_scale(model, stiffening.penetration)
    with np.errstate(over="ignore"):
        closings = closing_rates(model, stiffening) * duration * realizations
    likely = ~(closings < NEVER)  # also where it is not known
    deviations = _start_deviations(model, stiffening, relaxed.temperature)
    step, steps = fit_step(chosen, given is not None, intervals, duration, smooth=bool(periods))
    leaf, levels, unit = (LEAF // 2 if coarse else LEAF), 0, 1
    counted = counts_closings(model, integrator, start, stiffening, step)
    if sampled and may_jump(model, deviations):
        foreseen = foreseen_levels(model, 0.5 * step if coarse else step, deviations, window, int(realizations))
        for levels in range(foreseen, 0, -1):
            longer, count = fit_step(chosen, given is not None, intervals, duration, leaf << levels)
            exact = all(round(interval / longer) % (leaf << levels) == 0 for interval in intervals)
            if exact and longer > 0.8 * step and abs(count * longer - duration) <= 1e-3 * duration:
                step, steps, unit, integrator = longer, count, leaf << levels, WholeFlow()
                break
    jumping = unit > 1
    if steps + spin_up / step >= MOST_STEPS:
        raise InvalidInput(f"{duration + spin_up:g} s are too many steps of {step:g} s.")
    warn_of_bands(model)
    if given is None and integrator.kicks:
        warn_of_kinks(model, stiffening, step, duration + spin_up)
    # whole intervals; in a short run one sample at its end
    strides = [min(-(-record.stride(model, step) // unit) * unit, steps) for record in records]
    every = math.gcd(*strides)
    batches = batch_count(realizations, duration, relaxation)
    spin_up_steps = math.ceil(spin_up / (unit * step) * (1.0 - 1e-12)) * unit
    unit = max(every, unit)
    boundaries = [batch * steps // batches // unit * unit for batch in range(1, batches)]
    boundaries = [*sorted({end for end in boundaries if 0 < end < steps}), steps]
    lines = lines_of(model)
    moved = responses(model, flowing_systems(model))
    rows = sum(len(slots) for slots, _ in moved) * (2 if integrator.takes_response else 1)
    samples = (spin_up_steps + steps) * integrator.samples_per_step + 1
    kept = sample_count(lines, step / integrator.samples_per_step, samples) if lines else 0
    most = jump_lanes(model) if jumping else most_lanes(model, realizations, workers)
    lanes, steps_per_call = block_shape(model, realizations, workers, 8 * rows * kept, most)
    alone = lanes == 1 and not jumping and model.only_touching and not model.time_varying
    tile_steps, tiles = make_tiles(model, integrator.reach + model.passes if alone and integrator.reach else 0)
    white = np.array(model.white, dtype=np.int64)
    noise_rows, amplitude = integrator.noise(model, step)
    automatic_step = step
    if given is not None:
        automatic_step = _automatic(model, integrator, stiffening, spin_up, duration, start)
    elif velocity is not None:
        automatic_step = min(step, rule)
    return Plan(
        text=generate(model, single=lanes == 1 and not jumping),
        integrator=integrator,
        coefficients=np.ascontiguousarray(integrator.coefficients(model, step).transpose(0, 2, 1)),
        cross=integrator.cross(model, step),
        flows=integrator.flows(model, step),
        parameters=model.parameters,
        indices=model.indices,
        linear=np.stack([model.mass, model.damping, model.stiffness]),
        ends=model.ends,
        clearance=model.clearance,
        window=window,
        counted=counted,
        jitter=jitter(model, step, duration) if counted else np.zeros(len(model.ends)),
        half_kick=_half_kick(model, step) if integrator.kicks else np.zeros((0, model.wall + 1)),
        links=model.links,
        likely=likely,
        kicked=_kicked(model, likely),
        passes=model.passes,
        certified=certified(model, stiffening.penetration, step),
        automatic=automatic_step,
        time_varying=model.time_varying,
        white=white,
        noise_rows=noise_rows,
        noise_runs=noise_runs(noise_rows, len(model.bodies)),
        amplitude=np.ascontiguousarray(amplitude.transpose(0, 2, 1)),
        streams=streams_of(seed, [model.bodies[slot] for slot in noise_rows]),
        starts=addresses(seed, model.bodies if isinstance(start, str) and start == "stationary" else (), "start"),
        seed=seed,
        intensity=model.reference_intensities()[white],
        random=model.random,
        lines=lines,
        responses=moved,
        forced=np.array(model.forced, dtype=np.int64),
        start=start,
        deviations=deviations,
        factors=start_factors(model, stiffening, relaxed.temperature),
        rest=stiffening.rest,
        step=step,
        spin_up_steps=spin_up_steps,
        steps=steps,
        boundaries=tuple(boundaries),
        every=every,
        records=tuple(
            (record, stride // every if every else 1) for record, stride in zip(records, strides, strict=True)
        ),
        bodies=model.bodies,
        contacts=model.contacts,
        realizations=int(realizations),
        lanes=lanes,
        steps_per_call=steps_per_call,
        trusted=enough_units(realizations, (np.diff([0, *boundaries]) + unit) * step, relaxation),
        relaxation=relaxation,
        settling=settling,
        coarse=coarse,
        own_bodies=len(model.bodies),
        own_contacts=len(model.contacts),
        tile_steps=tile_steps,
        tiles=tiles,
        sampled=still or jumping,
        jumps=jump_tables(model, step, leaf, levels, deviations, window, seed) if jumping else None,
    )


def _automatic(
    model: Model,
    integrator: Integrator,
    stiffening: Stiffening,
    spin_up: float,
    duration: float,
    start: str | np.ndarray,
) -> float:
    """Return the step that is chosen where none is given (s), 0 if none can be."""
    try:
        return choose_step(model, integrator, stiffening, None, -spin_up, duration, start)
    except InvalidInput:
        return 0.0


def _intervals(records: Sequence[Record], duration: float) -> list[float]:
    """Return the times between samples that records must have, after checking that all fit in one run."""
    seen = set()
    for record in records:
        if record.identity in seen:
            raise InvalidInput(
                f"Two records {' '.join(record.identity)} would have variables of the same names; keep one, or "
                "simulate once more with the same rng."
            )
        seen.add(record.identity)
    intervals = [interval for record in records if (interval := record.exact_interval()) is not None]
    if intervals and max(intervals) > duration * (1.0 + 1e-9):
        raise InvalidInput(f"An interval of {max(intervals):g} s is longer than the duration of {duration:g} s.")
    return intervals


def _divides(interval: float, period: float) -> bool:
    return abs(period / interval - round(period / interval)) < 1e-9 * period / interval


def _kicked(model: Model, likely: np.ndarray) -> np.ndarray:
    """Whether forces of kicks may act on each body, (body,) of bool."""
    acting = model.kicking.copy()
    acting[: len(likely)] &= likely
    result = np.append(model.residual, False)
    result[model.links[acting].ravel()] = True
    return result[:-1]


def _half_kick(model: Model, step: float) -> np.ndarray:
    touching = np.bincount(model.links[model.kicking].ravel(), minlength=model.wall + 1)[:-1]
    alone = (touching <= 1) & ~model.residual
    of_contacts = np.unique(model.ends[model.ends < model.wall])
    friction = step * model.damping / model.mass
    for slots, _ in flowing_systems(model):
        friction[slots] = 0.0
    shares = np.stack([kick_width(friction), kick_share(friction) - 0.5])
    rows = 0 if alone[of_contacts].all() else 1 + bool(shares[1].any())
    return np.pad(step / model.mass * shares, ((0, 0), (0, 1)))[:rows]


def _start_deviations(model: Model, stiffening: Stiffening, temperature: np.ndarray) -> np.ndarray:
    """Standard deviations under white noise alone, 0 for other bodies, (2, body).

    They are the linear ones, but a residual force that stiffens a body narrows its displacement. Bodies that nothing
    but contacts can heat start at the temperature that is expected of them, where it is known.
    """
    velocity = linear_variances(model)[1]
    velocity = np.where(np.isfinite(temperature), temperature / model.mass, velocity)
    with np.errstate(divide="ignore", invalid="ignore"):
        variances = np.stack([model.mass * velocity / (model.stiffness + stiffening.bodies), velocity])
    variances[~np.isfinite(variances)] = 0.0
    variances[:, list(model.lines)] = 0.0
    result: np.ndarray = np.sqrt(variances)
    return result
