"""What a simulation will do, decided beforehand: step, spin-up, blocks. Pure data and rules."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from impactlab.component import finite, suggestion
from impactlab.errors import AccuracyWarning, InvalidInput
from impactlab.generate import generate
from impactlab.integrators.base import Integrator
from impactlab.kernels.random import stream
from impactlab.model import Model
from impactlab.network import Network
from impactlab.scene import (
    Lines,
    contact_energy,
    linear_variances,
    lines_of,
    penetrations,
    regular_lines,
    relaxation_time,
)

if TYPE_CHECKING:
    from impactlab.record import Record

LANES = 256
"""Largest number of realizations in a block: enough to fill vector units, few enough for the cache."""

RELAXATION_TIMES = 12.0
"""Length of the automatic spin-up in relaxation times of the slowest body."""

BATCHES, BATCH_TIMES = 64, 20.0
"""Least number of batches for a standard error, and the length of one in relaxation times."""

CALL_SECONDS, LANE_STEP_SECONDS, STEP_SECONDS = 0.05, 5e-9, 1e-6
"""Length of a compiled call and the cost it is planned with: short, so that interrupts are answered."""


@dataclass(frozen=True, eq=False)
class Plan:
    """Everything that a worker needs to run a block, as plain picklable data.

    Attributes
    ----------
    text : str
        Generated module.
    integrator : Integrator
        Method.
    coefficients : (body, column) ndarray
        The method's numbers.
    parameters, indices : ndarray
        What the generated functions take.
    linear : (3, body) ndarray
        Mass, damping and stiffness.
    ends, clearance, window : ndarray
        Of the contacts: slots of the bodies, clearance (m), half width for the rate (m).
    dissipative, time_varying : bool
        Whether forces depend on velocities, and white noise on time.
    white : (row,) ndarray of int
        Slots of the bodies under white noise.
    streams, starts : (row, 3), (body, 3) ndarray of uint64
        Addresses of the noise and of the random start.
    seed : tuple of int
        128 bits.
    intensity : (row,) ndarray
        Density that the coefficients were made with.
    lines : tuple of Lines
    forced : (row,) ndarray of int
        Slots of the bodies under given forces.
    start : str or (2, body) ndarray
        "stationary", "rest", or displacements and velocities.
    deviations : (2, body) ndarray
        Standard deviations of the linear law under white noise, for a stationary start.
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
    """

    text: str
    integrator: Integrator
    coefficients: np.ndarray
    parameters: np.ndarray
    indices: np.ndarray
    linear: np.ndarray
    ends: np.ndarray
    clearance: np.ndarray
    window: np.ndarray
    dissipative: bool
    time_varying: bool
    white: np.ndarray
    streams: np.ndarray
    starts: np.ndarray
    seed: tuple[int, int]
    intensity: np.ndarray
    lines: tuple[Lines, ...]
    forced: np.ndarray
    start: str | np.ndarray
    deviations: np.ndarray
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

    @property
    def blocks(self) -> int:
        """Number of blocks."""
        return -(-self.realizations // self.lanes)

    def realizations_of(self, block: int) -> np.ndarray:
        """Indices of the realizations in a block."""
        return np.arange(block * self.lanes, min((block + 1) * self.lanes, self.realizations), dtype=np.uint64)


def choose_step(
    model: Model, integrator: Integrator, tangent: np.ndarray, energy: np.ndarray, given: float | None
) -> float:
    """Return the given step, checked, or the recommended one.

    Raises
    ------
    InvalidInput
        If the step is too large for the scene (the largest safe one is named), or no rule
        leads to a step.
    """
    if given is None and not np.isfinite(energy).all():
        contact = model.contacts[int(np.flatnonzero(~np.isfinite(energy))[0])]
        raise InvalidInput(
            f"No step can be chosen: the energy of the collisions at contact {contact!r} is not known, since an "
            "excited body has no damping. Give step= (s)."
        )
    largest = integrator.largest_step(model, tangent)
    if largest <= 0.0:
        raise InvalidInput(
            f"{type(integrator).__name__} is unstable at any step for this network (a body is not damped "
            "enough). Use il.ExactFlow()."
        )
    if given is not None:
        if given > largest:
            raise InvalidInput(
                f"A step of {given:g} s is too large for {type(integrator).__name__} in this scene: the largest "
                f"safe one is {largest:.3g} s, {integrator.recommended_step(model, tangent):.3g} s is recommended."
            )
        return given
    step = integrator.recommended_step(model, tangent)
    if not math.isfinite(step):
        raise InvalidInput("No step can be chosen: no body has stiffness or damping. Give step= (s).")
    return step


def fit_step(step: float, fixed: bool, intervals: list[float], duration: float) -> tuple[float, int]:
    """Return a step that divides all `intervals`, and the number of steps in the duration.

    A step that is not fixed is made smaller until it divides the first interval; if
    there is none, until it divides the duration.

    Raises
    ------
    InvalidInput
        If an interval is not a whole number of steps.
    """
    if not fixed:
        whole = intervals[0] if intervals else duration
        step = whole / math.ceil(whole / step * (1.0 - 1e-12))
    for interval in intervals:
        if abs(interval / step - round(interval / step)) > 1e-6 or round(interval / step) < 1:
            raise InvalidInput(
                f"An interval of {interval:g} s is not a whole number of steps of {step:g} s; change one of them."
            )
    return step, max(1, round(duration / step))


def check_periods(model: Model, total: float) -> float | None:
    """Return the period of the first series that repeats, after checking the time of the run.

    Raises
    ------
    InvalidInput
        If a series would repeat within the run.
    """
    for name, excitation in model.network.excitations.items():
        if total > excitation.period * (1.0 + 1e-9):
            raise InvalidInput(
                f"The series of {name!r} repeats after {excitation.period:g} s, but the run with its spin-up takes "
                f"{total:g} s. Use more components, a shorter run, or allow_repeat=True."
            )
    for item in lines_of(model):
        regular = regular_lines(item.frequencies)
        if regular is not None:
            return regular[1]
    return None


def warn_of_bands(model: Model) -> None:
    """Warn of series that hardly excite their body: no line near its natural frequency."""
    for item in lines_of(model):
        natural = math.sqrt(model.stiffness[item.body] / model.mass[item.body])
        if natural > 0.0 and not item.frequencies.min() <= natural <= item.frequencies.max():
            warnings.warn(
                f"The band of the excitation of {item.name!r} ({item.frequencies.min() / (2 * math.pi):g} to "
                f"{item.frequencies.max() / (2 * math.pi):g} Hz) does not contain its natural frequency "
                f"{natural / (2 * math.pi):g} Hz.",
                AccuracyWarning,
                stacklevel=4,
            )


def batch_count(realizations: int, duration: float, relaxation: float) -> int:
    """Return the even number of batches per realization: two, or more if there are few realizations."""
    wanted = -(-BATCHES // realizations)
    possible = int(duration / (BATCH_TIMES * relaxation)) if relaxation > 0.0 else wanted
    count = max(2, min(wanted, possible) if possible * realizations >= BATCHES else 2)
    return count + count % 2


def block_shape(model: Model, realizations: int, workers: int, series_bytes: int) -> tuple[int, int]:
    """Return lanes per block and steps per call.

    Parameters
    ----------
    model : Model
    realizations, workers : int
    series_bytes : int
        Memory that the series of one realization take.
    """
    share = -(-realizations // workers)
    lanes = min(LANES, -(-share // 8) * 8, realizations)
    if series_bytes:
        lanes = max(1, min(lanes, int(100e6 / series_bytes)))
    cost = STEP_SECONDS * (1 + len(model.mass) // 10) + LANE_STEP_SECONDS * lanes * (len(model.mass) + len(model.ends))
    return lanes, max(1, int(CALL_SECONDS / cost))


def seed_of(rng: Any) -> tuple[int, int]:
    """Return 128 bits of seed from what NumPy takes as `rng` (SPEC 7).

    An integer or a SeedSequence gives the same seed every time; a Generator or
    BitGenerator gives two words and moves on; None gives fresh entropy.

    Raises
    ------
    InvalidInput
        If it is none of these.
    """
    if isinstance(rng, np.random.Generator | np.random.BitGenerator):
        words = np.random.default_rng(rng).integers(0, 2**64, 2, dtype=np.uint64)
        return int(words[0]), int(words[1])
    try:
        sequence = rng if isinstance(rng, np.random.SeedSequence) else np.random.SeedSequence(rng)
    except (TypeError, ValueError) as error:
        raise InvalidInput(
            f"rng must be None, a whole number of at least 0, a SeedSequence or a Generator, {rng!r} was given."
        ) from error
    low, high = sequence.generate_state(2, np.uint64)
    return int(low), int(high)


def start_of(initial: Any, model: Model) -> str | np.ndarray:
    """Return "stationary", "rest", or displacements and velocities (2, body).

    Raises
    ------
    InvalidInput
        If `initial` is none of the allowed forms or names a body that does not exist.
    """
    if initial is None or (isinstance(initial, str) and initial == "stationary"):
        variances = linear_variances(model)
        return "stationary" if np.isfinite(variances).all() and not model.time_varying else "rest"
    if isinstance(initial, str) and initial == "rest":
        return "rest"
    if not isinstance(initial, Mapping) or set(initial) - {"displacement", "velocity"}:
        raise InvalidInput(
            'initial must be "stationary", "rest" or {"displacement": {name: value}, "velocity": {name: value}}, '
            f"{initial!r} was given."
        )
    state = np.zeros((2, len(model.bodies)))
    for row, quantity in enumerate(("displacement", "velocity")):
        for name, value in dict(initial.get(quantity, {})).items():
            if name not in model.bodies:
                raise InvalidInput(f"initial: there is no oscillator {name!r}; {suggestion(name, model.bodies)}")
            state[row, model.bodies.index(name)] = finite(f"initial {quantity} of {name!r}", value)
    return state


def positive(name: str, value: Any, units: str = "s") -> float:
    """Return a positive finite number, or raise `InvalidInput` that names it."""
    number = finite(name, value)
    if number <= 0.0:
        raise InvalidInput(f"{name} must be larger than 0 {units}, {value!r} was given.")
    return number


def make_plan(
    network: Network,
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
) -> Plan:
    """Decide everything about a simulation before it runs.

    Parameters are those of `simulate`; `workers` is the number of blocks that run at once.

    Raises
    ------
    InvalidInput
        If something cannot be done; the message says what would work.
    """
    model = Model.of(network)
    integrator.check(model)
    duration = positive("duration", duration)
    if (
        isinstance(realizations, bool)
        or not isinstance(realizations, int | np.integer)
        or not 1 <= realizations < 2**32
    ):
        raise InvalidInput(f"realizations must be a whole number from 1 to 2^32 - 1, {realizations!r} was given.")
    start = start_of(initial, model)
    energy = contact_energy(model, start, duration)
    penetration, tangent = penetrations(model, energy)
    records = [record.resolved(model) for record in records]
    intervals = [interval for record in records if (interval := record.exact_interval()) is not None]
    relaxation = relaxation_time(model)
    if spin_up is None:
        spin_up = 0.0 if isinstance(start, np.ndarray) or not network.excitations else RELAXATION_TIMES * relaxation
    elif finite("spin_up", spin_up) < 0.0:
        raise InvalidInput(f"spin_up must be at least 0 s, {spin_up!r} was given.")
    period = check_periods(model, duration + spin_up)
    given = None if step is None else positive("step", step)
    chosen = choose_step(model, integrator, tangent, energy, given)
    if given is None and period is not None and all(_divides(interval, period) for interval in intervals[:1]):
        intervals.append(period)
    step, steps = fit_step(chosen, given is not None, intervals, duration)
    warn_of_bands(model)
    strides = [record.stride(model, step) for record in records]
    every = math.gcd(*strides)
    batches = batch_count(realizations, duration, relaxation)
    unit = max(every, 1)
    boundaries = [batch * steps // batches // unit * unit for batch in range(1, batches)]
    boundaries = [*sorted({end for end in boundaries if 0 < end < steps}), steps]
    spin_up_steps = math.ceil(spin_up / step * (1.0 - 1e-12))
    lines = lines_of(model)
    rows = len(lines) * (2 if integrator.takes_response else 1)
    lanes, steps_per_call = block_shape(
        model, realizations, workers, 8 * rows * integrator.samples_per_step * (spin_up_steps + steps)
    )
    white = np.array(model.white, dtype=np.int64)
    return Plan(
        text=generate(model),
        integrator=integrator,
        coefficients=np.ascontiguousarray(integrator.coefficients(model, step)),
        parameters=model.parameters,
        indices=model.indices,
        linear=np.stack([model.mass, model.damping, model.stiffness]),
        ends=model.ends,
        clearance=model.clearance,
        window=0.1 * np.where(penetration > 0.0, penetration, 1.0),
        dissipative=model.dissipative,
        time_varying=model.time_varying,
        white=white,
        streams=_addresses(seed, [model.bodies[slot] for slot in model.white], "noise"),
        starts=_addresses(seed, model.bodies if isinstance(start, str) and start == "stationary" else (), "start"),
        seed=seed,
        intensity=model.reference_intensities()[white],
        lines=lines,
        forced=np.array(model.forced, dtype=np.int64),
        start=start,
        deviations=_white_deviations(model),
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
    )


def _divides(interval: float, period: float) -> bool:
    return abs(period / interval - round(period / interval)) < 1e-9 * period / interval


def _addresses(seed: tuple[int, int], names: Sequence[str], purpose: str) -> np.ndarray:
    return np.array([stream(seed, name, purpose) for name in names], dtype=np.uint64).reshape(-1, 3)


def _white_deviations(model: Model) -> np.ndarray:
    """Standard deviations of the linear law under white noise alone, 0 for other bodies, (2, body)."""
    variances = linear_variances(model)
    variances[:, list(model.lines)] = 0.0
    result: np.ndarray = np.sqrt(variances)
    return result
