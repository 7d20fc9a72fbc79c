"""Rules by which a simulation is planned: step, duration, batches, blocks, seed and start."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from impactlab.component import finite, suggestion
from impactlab.counting import counts_closings
from impactlab.dissipation import damping_step
from impactlab.errors import InvalidInput, warn
from impactlab.given import resolving_step
from impactlab.integrators.base import Integrator
from impactlab.kinks import kink_step
from impactlab.linear import linear_variances, lines_of, regular_lines
from impactlab.model import Model
from impactlab.profiles import STABLE_REACH
from impactlab.scene import Stiffening

LANES = 520
"""Largest number of realizations in a block: enough to outweigh what a step costs at any number, few
enough for the cache."""

CACHED, FEW = 4000, 64
"""Bodies times lanes of a block that stay in a core's cache; lanes that are not worth dividing for it."""

LONG, MANY = 16, 200
"""Bodies per lane, and bodies, from which loops over the bodies of one lane cost less than loops over lanes."""

RELAXATION_TIMES = 12.0
"""Length of the automatic spin-up in relaxation times of the slowest body."""

SETTLED = 5.0
"""Relaxation times of spin-up after which the motion counts as stationary."""

TRANSIENT = 0.5
"""Part of the step of linear bodies, of which each is exact, in a transient: Simpson's rule over a step of 1/ω is
0.1 to 0.2 % off for a mean square over few of them, which this makes sixteen times less."""

BATCHES, BATCH_TIMES = 64, 20.0
"""Least number of batches for a standard error, and the length of one in relaxation times."""

MOST_STEPS = 2.0**53
"""Number of steps that a float can count."""

LEAST_STEPS = 1e-9
"""Part of a recommended step that a run may take: over less the motion is lost in rounding."""

MOST_SAMPLES = 4096
"""Steps per batch where every step is exact, so that the work does not grow with the time."""

SERIES_BYTES = 160e6
"""Memory that the series of a block may take."""

FURTHER = 2.0
"""Multiple of the step at which rules take forces for resolved, up to which a measurement may find one to be right."""

STOPPING = 10.0
"""Friction over a step, ``c h/m``, from which on counts of closings do not see how bodies are stopped."""

SERIES_FRICTION = 3.0
"""Largest friction over an automatic step, ``c h/m``, of a body under a sum of cosines that is kicked."""

CALL_SECONDS, LANE_STEP_SECONDS, STEP_SECONDS = 0.05, 5e-9, 1e-6
"""Length of a compiled call and the cost it is planned with: short, so that interrupts are answered."""


def choose_step(
    model: Model, integrator: Integrator, stiffening: Stiffening, given: float | None, begin: float = 0.0,
    end: float = 0.0, start: str | np.ndarray = "stationary",
) -> float:  # fmt: skip
    """Return the given step, checked, or the recommended one for a run between two times from a start.

    Raises
    ------
    InvalidInput
        If the step is too large for the scene (the largest safe one is named), or no rule
        leads to a step.
    """
    unknown = model.nonlinear_bodies & ~np.isfinite(stiffening.energy)
    if given is None and unknown.any():
        raise InvalidInput(
            f"No step can be chosen: the energy that {model.bodies[int(unknown.argmax())]!r} brings into collisions "
            "is not known, since an excited body has no damping. Give step= (s)."
        )
    stiffness = stiffening.links, stiffening.bodies
    largest = integrator.largest_step(model, *stiffness)
    if largest <= 0.0:
        raise InvalidInput(
            f"{type(integrator).__name__} is unstable at any step for this network (a body is not damped "
            "enough). Use il.ExactFlow()."
        )
    if given is not None:
        if given > largest:
            raise InvalidInput(
                f"A step of {given:g} s is too large for {type(integrator).__name__} in this scene: the largest "
                f"safe one is {largest:.3g} s, {integrator.recommended_step(model, *stiffness):.3g} s is recommended."
            )
        return given
    step = min(integrator.recommended_step(model, *stiffness), damping_step(model, stiffening))
    if integrator.kicks:
        step = min(step, kink_step(model, stiffening), series_step(model))
        slow = stopping_step(model, step)
        if slow < step and counts_closings(model, integrator, start, stiffening, step):
            step = slow
    if end > begin:
        step = resolving_step(model, begin, end, step)
    if not math.isfinite(step):
        raise InvalidInput("No step can be chosen: no body has stiffness or damping. Give step= (s).")
    return step


def highest_step(
    model: Model, integrator: Integrator, stiffening: Stiffening, begin: float, end: float, start: str | np.ndarray
) -> float:
    """Return the largest step that a measurement may find to be right (s).

    Forces are resolved nearly as well as the rules want, and steps are stable for all energies that occur: of laws
    that are no powers the stiffness is known with its weight only, at which the rules' step is as large as that.
    """
    step = integrator.recommended_step(model, stiffening.links, stiffening.bodies)
    if stiffening.plain:
        hot = Stiffening.of(model, STABLE_REACH * stiffening.energy)
        stable = integrator.largest_step(model, hot.links, hot.bodies)
        step = min(max(step, stable), FURTHER * step)
    step = min(step, FURTHER * damping_step(model, stiffening), series_step(model))
    if counts_closings(model, integrator, start, stiffening, step):
        step = min(step, stopping_step(model, step))
    return resolving_step(model, begin, end, step)


def stopping_step(model: Model, step: float) -> float:
    """Return a step within which friction hardly stops bodies with contacts, where one a little smaller does that (s).

    Their contacts close with velocities that friction forgets within a step, so that the path between kicks does not
    give the rate of contacts at ``c h/m`` of some 1 to 10 (up to 10 % off). A flux at kicks does.
    """
    if model.lines:  # see `series_step`
        return math.inf
    touching = np.unique(model.ends[model.ends < model.wall])
    rates = model.damping[touching] / model.mass[touching]
    fastest = rates[(step * rates > 1.0) & (step * rates < STOPPING)].max(initial=0.0)
    return float(1.0 / fastest) if fastest else math.inf


def series_step(model: Model) -> float:
    """Return the step at which friction takes little of what a kick gives to bodies under sums of cosines (s).

    The velocities of these are read in the middle of kicks alone, which says nothing of what decays between them:
    with a damping ratio of 10, a natural frequency of 100 rad/s and a Hertz contact E[v²] is 1.7 % too large at
    ``c h/m = 16``, and 0.07 ± 0.003 % too small at 4.
    """
    kicked = [slot for slot in model.lines if model.nonlinear_bodies[slot] and model.damping[slot] > 0.0]
    return min((SERIES_FRICTION * float(model.mass[slot] / model.damping[slot]) for slot in kicked), default=math.inf)


def fit_step(
    step: float, fixed: bool, intervals: list[float], duration: float, multiple: int = 1, smooth: bool = False
) -> tuple[float, int]:
    """Return a step that divides all `intervals`, and the number of steps in the duration.

    A step that is not fixed is made smaller until a `multiple` of it divides the first interval; if
    there is none, until it divides the duration. The number of steps is such a multiple. If the
    number of steps in the interval is to be `smooth`, it has no prime factor above 5, which an FFT
    takes best.

    Raises
    ------
    InvalidInput
        If an interval is not a whole number of steps.
    """
    if fixed and step > duration * (1.0 + 1e-9):
        raise InvalidInput(f"A step of {step:g} s is longer than the duration of {duration:g} s.")
    if not fixed:
        whole = intervals[0] if intervals else duration
        count = math.ceil(_steps(whole, multiple * step) * (1.0 - 1e-12))
        if smooth:
            from scipy.fft import next_fast_len  # loaded only where there are series

            count = next_fast_len(count, real=True)
        step = whole / (multiple * count)
    for interval in intervals:
        if abs(interval / step - round(interval / step)) > 1e-6 or round(interval / step) < 1:
            raise InvalidInput(
                f"An interval of {interval:g} s is not a whole number of steps of {step:g} s; change one of them."
            )
    return step, multiple * max(1, round(_steps(duration, multiple * step)))


def _steps(time: float, step: float) -> float:
    """Return how many steps a time takes, if a float can count them."""
    if step <= 0.0 or time / step >= MOST_STEPS:
        raise InvalidInput(f"{time:g} s are too many steps of {step:g} s.")
    if time / step < LEAST_STEPS:
        raise InvalidInput(f"{time:g} s are too short a time where a step is {step:g} s.")
    return time / step


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
            warn(
                f"The band of the excitation of {item.name!r} ({item.frequencies.min() / (2 * math.pi):g} to "
                f"{item.frequencies.max() / (2 * math.pi):g} Hz) does not contain its natural frequency "
                f"{natural / (2 * math.pi):g} Hz."
            )


def batches_wanted(realizations: int) -> int:
    """Return the even number of batches per realization that is enough for standard errors."""
    wanted = -(-BATCHES // realizations)
    return wanted + wanted % 2


def batch_count(realizations: int, duration: float, relaxation: float) -> int:
    """Return the even number of batches per realization: what is wanted if the time is enough, else two."""
    wanted = batches_wanted(realizations)
    return wanted if duration * (1.0 + 1e-9) >= wanted * BATCH_TIMES * relaxation else 2


def enough_units(realizations: int, batches: np.ndarray, relaxation: float) -> bool:
    """Whether realizations, or batches of some lengths (s, up to a sample), are enough for standard errors.

    Where nothing is damped the relaxation time is not known (0) and batches do not count.
    """
    long = relaxation > 0.0 and batches.min() >= BATCH_TIMES * relaxation
    return realizations >= BATCHES or bool(long and realizations * len(batches) >= BATCHES)


def most_lanes(model: Model, realizations: int, workers: int) -> int:
    """Return the largest number of lanes that a block should have; 1 where loops over bodies cost less."""
    bodies = len(model.mass)
    if bodies >= min(MANY, LONG * -(-realizations // workers)):
        return 1
    return min(LANES, max(FEW, CACHED // bodies // 8 * 8))


def block_shape(model: Model, realizations: int, workers: int, series_bytes: int, most: int = LANES) -> tuple[int, int]:
    """Return lanes per block and steps per call.

    Parameters
    ----------
    model : Model
    realizations, workers : int
    series_bytes : int
        Memory that the series of one realization take.
    most : int
        Largest number of lanes.
    """
    bodies = len(model.mass)
    if most == 1:
        cost = STEP_SECONDS + LANE_STEP_SECONDS * (bodies + len(model.links))
        return 1, max(1, int(CALL_SECONDS / cost))
    blocks = -(-realizations // (most * workers)) * workers  # as many for each worker
    lanes = -(-realizations // (8 * blocks)) * 8
    if lanes % 128 == 0:  # rows that are whole kilobytes apart compete for the same lines of the cache
        lanes += 8
    lanes = min(lanes, realizations)
    if series_bytes:
        lanes = max(1, min(lanes, int(SERIES_BYTES / series_bytes)))
    cost = STEP_SECONDS * (1 + bodies // 10) + LANE_STEP_SECONDS * lanes * (bodies + len(model.links))
    return lanes, max(1, int(CALL_SECONDS / cost))


class Seed(NamedTuple):
    """128 bits as two words of 64 bits."""

    low: int
    high: int


def seed_of(rng: Any) -> Seed:
    """Return 128 bits of seed from what NumPy takes as `rng` (SPEC 7).

    An integer or a SeedSequence gives the same seed every time; a Generator or
    BitGenerator gives two words and moves on; None gives fresh entropy. A seed is itself.

    Raises
    ------
    InvalidInput
        If it is none of these.
    """
    if isinstance(rng, Seed):
        return rng
    if isinstance(rng, bool):
        raise InvalidInput(f"rng must be None, a whole number of at least 0, a SeedSequence or a Generator, not {rng}.")
    if isinstance(rng, np.random.Generator | np.random.BitGenerator):
        words = np.random.default_rng(rng).integers(0, 2**64, 2, dtype=np.uint64)
        return Seed(int(words[0]), int(words[1]))
    try:
        sequence = rng if isinstance(rng, np.random.SeedSequence) else np.random.SeedSequence(rng)
    except (TypeError, ValueError) as error:
        raise InvalidInput(
            f"rng must be None, a whole number of at least 0, a SeedSequence or a Generator, {rng!r} was given."
        ) from error
    low, high = sequence.generate_state(2, np.uint64)
    return Seed(int(low), int(high))


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
        values = initial.get(quantity, {})
        if not isinstance(values, Mapping):
            raise InvalidInput(f"initial {quantity} must be {{name: value}}, {values!r} was given.")
        for name, value in values.items():
            if name not in model.bodies:
                raise InvalidInput(f"initial: there is no oscillator {name!r}; {suggestion(name, model.bodies)}")
            state[row, model.bodies.index(name)] = finite(f"initial {quantity} of {name!r}", value)
    return state


def check_integrator(integrator: Any) -> None:
    """Refuse what is not an integrator."""
    if not isinstance(integrator, Integrator):
        raise InvalidInput(f"integrator must be one such as il.ExactFlow(), {integrator!r} was given.")


def positive(name: str, value: Any, units: str = "s") -> float:
    """Return a positive finite number, or raise `InvalidInput` that names it."""
    number = finite(name, value)
    if number <= 0.0:
        raise InvalidInput(f"{name} must be larger than 0 {units}, {value!r} was given.")
    return number
