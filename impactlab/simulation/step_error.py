"""The error that a step makes in a scene, measured there: short stretches at the step and at a part of it.

Two whole runs at different steps drift apart after a few collisions, and then see nothing below their own noise.
Stretches that begin at one state, under the same noise, see the local error of the step with very little noise: the
difference of each statistic in the stretch, and that of the energy at its end, which the scene keeps for as long as its
energy is correlated.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from impactlab.assembly.model import Model
from impactlab.errors import Diverged, heard_by, warn
from impactlab.integrators.base import Integrator
from impactlab.integrators.exact_flow import ExactFlow
from impactlab.kernels.rows import FV
from impactlab.kernels.sums import SLOTS
from impactlab.nonlinear.relaxation import correlation_of_neighbours
from impactlab.plan.plan import Plan
from impactlab.plan.realizations import LANE_STEP_SECONDS, STEP_SECONDS, most_lanes
from impactlab.results.schema import BODY, CONTACT, STATISTICS
from impactlab.simulation.block import Block
from impactlab.simulation.planning import make_plan
from impactlab.simulation.request import Request
from impactlab.statistics.moments import moments_of

if TYPE_CHECKING:
    import xarray as xr

MOST_BIAS = 0.0015
"""Bias of the step, as a part of a statistic, up to which a step that is chosen will do."""

SURELY_FINE = 0.2
"""Part of the automatic step up to which a step that is given needs no measurement, whatever the network."""

WORTH_SAYING = 0.005
"""Bias of a step from which on there is a warning."""

USUAL_BIAS = MOST_BIAS / 3.0
"""Standard deviation of the biases of chosen steps before a measurement, so that hardly any is beyond what will do; in
51 random networks it was 0.05 % by maximum likelihood."""

STRETCH = 32
"""Steps of a stretch where forces may part two paths: some contacts long, and short beside the time between them."""

FARTHEST = 10.0
"""Times the automatic step from which on biases are not expected to grow: hardly any larger step is let through."""

SHARE, LEAST_SECONDS, MOST_SECONDS = 0.2, 0.05, 2.0
"""Part of the work of a run that the measurement may take, what it always may, and what is enough for any scene (s, as
a plan foresees it)."""

UNCLEAR_SECONDS = 0.25
"""Time that a measurement of a short run may take which leaves it open whether a bias is worth saying (s)."""

WHOLE_SECONDS = 2.0
"""Time that the whole path of a run without noise may take, at the step and at a finer one (s)."""

LANES, STRETCHES, FEWEST = 256, 64, 8
"""Most realizations and stretches of a measurement, and the fewest stretches."""

TOGETHER = 8
"""Realizations that are one in the statistics of a measurement where there are many: each takes time."""

UNITS = 32
"""Least number of independent units of a measurement: so many tell a standard error to 13 %."""

SPIN_UP = 3.0
"""Relaxation times before the first stretch: states need be typical only."""

CERTAIN = 2.5
"""Standard errors within which a bias is not known, with some ten statistics looked at."""

STILL = 1e-9
"""Part of the mean square of a displacement below which its variance is rounding, or what a spin-up has left."""

TRIALS = 6
"""Steps that are tried before the best is taken as it is."""

WORTHWHILE, WORTH_SECONDS, LARGER = 1.2, 1.0, 2
"""Factor from which on a larger step, and time of a run from which on looking for it (s), is worth its work, and how
many are tried: each takes a fifth of the run, or about as long as a run of half a second, and may save half of it."""

SEED = 7, 2023
"""Seed of all measurements: the step of a scene does not depend on that of the run."""

LITTLE = 0.01
"""Friction over a step, ``c h/m``, below which series do for what it changes."""

FINER, FINEST = 2, 4
"""Steps of the fine run in one of the coarse; where nothing is random, so that one path alone must tell the error."""


@dataclass(frozen=True, eq=False)
class StepError:
    """Bias of a step in each statistic, as measured.

    Attributes
    ----------
    step : float
        The step (s).
    bias, error : dict of str to (body or contact,) ndarray
        By the name of the statistic, as a part of its value (of the root mean square for means that may be 0);
        standard errors.
    labels : dict of str to tuple of str
        Names of bodies and contacts by dimension.
    met : dict of str to (body or contact,) ndarray
        Statistics as they were met on the way.
    """

    step: float
    bias: dict[str, np.ndarray]
    error: dict[str, np.ndarray]
    labels: dict[str, tuple[str, ...]]
    met: dict[str, np.ndarray] = field(default_factory=dict)

    @property
    def worst(self) -> tuple[str, str, float, float]:
        """The statistic whose bias is most certainly large: name, label, bias and standard error."""
        found = ("", "", 0.0, 0.0)
        for name, biases in self.bias.items():
            for label, bias, error in zip(
                self.labels[STATISTICS[name].dimension], biases, self.error[name], strict=True
            ):
                if abs(bias) - CERTAIN * error > abs(found[2]) - CERTAIN * found[3]:
                    found = (name, label, float(bias), float(error))
        return found

    @property
    def certain(self) -> float:
        """Largest bias of any statistic, without what may be chance."""
        _, _, bias, error = self.worst
        return max(abs(bias) - CERTAIN * error, 0.0)

    def unclear(self, time: float) -> bool:
        """Whether a bias may be worth saying, beside the standard error that so many closings in some time (s) leave.

        Those of bodies are not counted on: balances may make them as small as they like.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            of_contacts = np.nan_to_num(1.0 / np.sqrt(time * self.met.get("contact_rate", np.zeros(0))), nan=np.inf)
        beside = {BODY: np.zeros(1), CONTACT: of_contacts}
        for name, error in self.error.items():
            largest = np.where(np.isfinite(error), np.abs(self.bias[name]) + CERTAIN * error, 0.0)
            if (largest > WORTH_SAYING + beside[STATISTICS[name].dimension]).any():
                return True
        return False

    @property
    def better(self) -> float:
        """A step that makes the bias small enough, if it falls with the square of the step (s)."""
        bias = abs(self.worst[2])
        return self.step * max(0.25, 0.8 * math.sqrt(MOST_BIAS / bias)) if bias > MOST_BIAS else self.step

    def allowance(self, name: str, usual: float = USUAL_BIAS) -> np.ndarray:
        """Return the root mean square of the bias of a statistic, given what was measured: as large as it may well be.

        A bias b of which nothing is known but that the step was chosen is a normal number with the standard deviation
        s that is `usual`. Measured as b̂ ± σ, it has the mean q b̂ and the variance q σ² = (1 − q) s², with
        q = s²/(s² + σ²). What is `CERTAIN` is no unusual measurement but an unusual bias, and known: q = 1.
        """
        bias, error = self.bias[name], self.error[name]
        known = np.where(np.abs(bias) > CERTAIN * error, 1.0, 1.0 / (1.0 + (error / usual) ** 2))
        result: np.ndarray = np.hypot(known * bias, np.sqrt(1.0 - known) * usual)
        return result

    def usual(self, automatic: float) -> float:
        """Return the standard deviation of biases that is to be expected, from the step that rules allow (s)."""
        return USUAL_BIAS * min(max(1.0, self.step / max(automatic, 1e-300)), FARTHEST) ** 2

    def will_do(self, automatic: float) -> bool:
        """Whether no bias is too large, nor may well be."""
        usual = self.usual(automatic)
        largest = max(self.allowance(name, usual).max(initial=0.0) for name in self.bias)
        return self.certain <= MOST_BIAS and largest <= MOST_BIAS

    def added_to(self, dataset: xr.Dataset, automatic: float) -> xr.Dataset:
        """Return a dataset with the biases, and with standard errors that allow for them.

        Parameters
        ----------
        dataset : Dataset
            Statistics with the standard errors of their scatter.
        automatic : float
            The step that the rules allow (s): biases of larger ones are as much larger as the square of the step.
        """
        usual = self.usual(automatic)
        result = {}
        for name, bias in self.bias.items():
            statistic = STATISTICS[name]
            dimension, units, long_name = statistic.dimension, statistic.units, statistic.long_name
            part = "the root mean square" if name in _MAY_BE_ZERO else "it"
            seen = self.error[name][np.isfinite(self.error[name])].max(initial=0.0)
            result[statistic.step_bias] = (
                dimension,
                bias,
                {
                    "units": "1",
                    "long_name": f"bias of the step in {long_name}, as a part of {part}",
                    "comment": f"measured in short stretches; standard error at most {seen:.1g}",
                },
            )
            allowance = self.allowance(name, usual) * _size(name, lambda item: dataset[item].values)
            result[statistic.allowance] = (
                dimension,
                allowance,
                {
                    "units": units,
                    "long_name": f"part of the standard error of {long_name} that allows for the bias of the step",
                    "comment": "root mean square of the bias, given what was measured of it",
                },
            )
            for variable in (statistic, statistic.direct):
                if variable.name in dataset:
                    error = dataset[variable.error]
                    comment = f"of the scatter, and beside it {statistic.allowance}: square root of the sum of squares"
                    attrs = {**error.attrs, "comment": comment}
                    result[variable.error] = dimension, np.hypot(error.values, allowance), attrs
        return dataset.assign(result)


def worth_measuring(plan: Plan, model: Model, integrator: Integrator, given: float | None) -> bool:
    """Whether nothing but a measurement tells what the step of a plan does."""
    wanted = isinstance(integrator, ExactFlow) and integrator.measured
    if not wanted or plan.noise.coarse or not model.nonlinear_bodies.any():
        return False
    beyond = 1.0 + 1e-9 if plan.clock.certified else SURELY_FINE
    return (given is None and not plan.clock.certified) or (given is not None and given > beyond * plan.clock.automatic)


def measured(
    plan_of: Callable[..., Plan], plan: Plan, model: Model, initial: object, free: bool
) -> tuple[Plan, StepError]:
    """Return a plan whose step makes no large error in the scene, and the error that it makes; warn if there is none.

    Parameters
    ----------
    plan_of : callable
        Makes the plan of the run whose step is at most so large (s), and may be larger than the rules want where mean
        square velocities of the bodies are given.
    plan : Plan
        The plan with the step to begin with.
    model : Model
    initial : optional
        How the run starts, as `simulate` takes it.
    free : bool
        Whether the step may be changed.
    """
    first, error = plan, step_error(plan, model, initial)
    for _ in range(TRIALS - 1 if free else 0):
        if error.certain <= MOST_BIAS:
            break
        plan = plan_of(error.better)
        error = step_error(plan, model, initial)
    if math.isinf(error.certain):
        return first, error  # the run will say where it diverges
    if free and plan is first and error.certain <= MOST_BIAS:
        plan, error = _larger(plan_of, plan, error, model, initial)
    if error.certain > WORTH_SAYING:
        name, label, bias, scatter = error.worst
        warn(
            f"The step of {plan.clock.step:.3g} s makes {STATISTICS[name].long_name} of {label!r} about "
            f"{100.0 * abs(bias):.2g} ± {100.0 * scatter:.1g} % too {'large' if bias > 0.0 else 'small'}, "
            f"as measured in short stretches of this scene; try step={error.better:.2g}."
        )
    return plan, error


def _larger(
    plan_of: Callable[..., Plan], plan: Plan, error: StepError, model: Model, initial: object
) -> tuple[Plan, StepError]:
    """Return a plan of a larger step that was found to do as well, or the same plan, and the error of its step.

    A step is no more than twice one that was found to do, so that the differences of all of them add up to its bias.
    """
    factor, too_large = 2.0, math.inf
    for _ in range(LARGER):
        if not (plan.steady and plan.seconds(1) > WORTH_SECONDS):
            break
        trial = plan_of(min(factor * plan.clock.step, too_large / WORTHWHILE), error.met["mean_square_velocity"])
        if trial.clock.step < WORTHWHILE * plan.clock.step:
            break
        found = step_error(trial, model, initial, error.met["mean_square_velocity"])
        if found.will_do(trial.clock.automatic):
            plan, error = trial, found
        else:
            factor, too_large = math.sqrt(factor), trial.clock.step
    return plan, error


def step_error(plan: Plan, model: Model, initial: object, velocity: np.ndarray | None = None) -> StepError:
    """Measure what the step of a plan does to its statistics.

    The time of the measurement is a share of the plan's; it depends on nothing but the plan, and the mean square
    velocities of the bodies that a larger step was chosen with: where its biases stay unclear it will not do.
    """
    realizations, spin_up, stretches, steps, rounds = _budget(plan, model)
    rounds = rounds if velocity is None else 1
    step, finer = plan.clock.step, FINER if plan.noise.random.any() else FINEST

    def part(size: float, coarse: bool) -> Plan:
        request = Request(
            duration=rounds * stretches * steps * step, realizations=realizations, step=size, spin_up=spin_up * step,
            integrator=ExactFlow(jumps=False), initial=initial, records=[], seed=SEED, workers=1, coarse=coarse,
            velocity=velocity,
        )  # fmt: skip
        return make_plan(model, request)

    with heard_by(lambda message, category: None):
        coarse, fine = part(step, True), part(step / finer, False)
    fine = replace(fine, clock=replace(fine.clock, spin_up_steps=finer * coarse.clock.spin_up_steps))
    try:
        pairs = [_Pair(coarse, fine, model, index) for index in range(coarse.realizations.blocks)]
        found: list[list[Stretch]] = [[] for _ in pairs]
        while True:
            for pair, item in zip(pairs, found, strict=True):
                item += pair.run(stretches, steps, finer)
            error = _of_units(coarse, fine, model, steps, plan.clock.steps // steps * steps, found)
            unclear = error.certain <= MOST_BIAS and error.unclear(plan.realizations.number * plan.clock.duration)
            if len(found[0]) >= rounds * stretches or not unclear:
                return error
    except Diverged:
        infinite, exact = np.full(len(model.bodies), np.inf), np.zeros(len(model.bodies))
        labels = {BODY: model.bodies, CONTACT: model.contacts}
        diverged = {"mean_square_velocity": infinite}
        return StepError(step, diverged, {"mean_square_velocity": exact}, labels, diverged)


def _budget(plan: Plan, model: Model) -> tuple[int, int, int, int, int]:
    """Return what a share of the work of a plan buys.

    These are realizations, steps of the spin-up, stretches, steps of each, and how often there may be so many of them
    where they leave too much unclear.
    """
    bodies, links = len(model.mass), len(model.links)
    clock, number = plan.clock, plan.realizations.number
    lane = LANE_STEP_SECONDS * (bodies + links)
    whole = clock.steps // SLOTS * SLOTS
    if not plan.noise.random.any() and whole and (1 + FINEST) * clock.all_steps * (STEP_SECONDS + lane) < WHOLE_SECONDS:
        return number, clock.spin_up_steps, 1, whole, 1
    seconds = min(max(LEAST_SECONDS, SHARE * clock.all_steps * (STEP_SECONDS + number * lane)), MOST_SECONDS)
    single = number == 1 or most_lanes(model, number, 1) == 1  # on any number of cores
    least = 1 if single else bodies // 16 + 2  # blocks of one lane have a text of their own
    numbers = [1] if single else [max(LANES >> power, least) for power in range(0, 9, 2)]
    led = len(plan.driving.forced) > 0  # to a motion that may depend on how it began
    settling = clock.spin_up_steps
    if not led:
        settling = math.ceil(min(settling, SPIN_UP * clock.relaxation / clock.step))
    for realizations in numbers:
        cost = STEP_SECONDS * (1 + bodies // 10) + lane * realizations
        affordable = int(seconds / cost)
        if affordable >= 2 * settling + 3 * FEWEST * STRETCH:
            break
    settling = min(settling, affordable // 3)
    left = max(affordable - settling, 3 * STRETCH) // 3
    steps = STRETCH
    if not len(model.ends) or led:  # paths do not part: as long as they remember
        steps = max(steps, min(left // FEWEST, math.ceil(2.0 * clock.relaxation / clock.step)) // SLOTS * SLOTS)
    if not plan.steady or plan.driving.lines:  # as long as the run, where time counts or a series must not repeat
        left = min(left, plan.clock.steps)
        steps = max(2, min(steps, left // 2 * 2))
    if not plan.noise.random.any():  # parts of the whole path
        steps = max(steps, -(-left // (STRETCHES * SLOTS)) * SLOTS)
    longer = plan.steady and not plan.driving.lines
    rounds = max(1, int(UNCLEAR_SECONDS / seconds)) if longer else 1
    return realizations, settling, max(1, min(STRETCHES, left // steps)), steps, rounds


Sums = tuple[np.ndarray, ...]


class Stretch(NamedTuple):
    """What is known of a stretch."""

    coarse: Sums  # of bodies, contacts and pairs, (…, lane), each lane a mean over some realizations
    fine: Sums
    energy: np.ndarray  # (part, lane) that the coarse run has more at its end (J)


class _Pair:
    """Blocks of the same realizations at a step and at a part of it."""

    def __init__(self, coarse: Plan, fine: Plan, model: Model, index: int) -> None:
        self.coarse, self.fine = (Block(plan, index, lambda steps: None) for plan in (coarse, fine))
        self.mass, _, stiffness = (item[:, None] for item in coarse.system.linear)
        self.stiffness = np.diag(stiffness[:, 0])
        for group in coarse.method.groups:  # couplings that do not kick
            self.stiffness[np.ix_(group.slots, group.slots)] = group.system.stiffness
        self.labels = model.connected()
        self.coarse.advance(coarse.clock.spin_up_steps, None)
        if coarse.observed.counted:
            self.coarse._note_gaps(self.coarse.state.reading, self.coarse.state.velocity)

    def run(self, stretches: int, steps: int, finer: int) -> list[Stretch]:
        """Return the sums of both over each stretch, and the energy that the coarse one has more at its end.

        The coarse block goes on from stretch to stretch; the fine one begins anew where it is.
        """
        result, here = [], _smooth(self.coarse)
        for _ in range(stretches):
            _begin(self.fine, *here)
            self.fine.now = finer * self.coarse.now
            coarse, fine = self.coarse.stretch(steps), self.fine.stretch(finer * steps)
            here = _smooth(self.coarse)
            energy = self._energy(*here, *_smooth(self.fine))
            result.append(Stretch(tuple(map(together, coarse)), tuple(map(together, fine)), together(energy)))
        return result

    def _energy(self, x: np.ndarray, v: np.ndarray, from_x: np.ndarray, from_v: np.ndarray) -> np.ndarray:
        """Energy of one state less that of another, by connected part and lane: conservative forces do the work."""
        way = x - from_x
        forces = _forces(self.coarse, *(from_x + 0.5 * (node + 1.0) * way for node in _NODES))
        push = sum(weight * force for weight, force in zip(0.5 * _WEIGHTS, forces, strict=True))
        pull = self.stiffness @ (0.5 * (x + from_x)) - push
        energy = 0.5 * self.mass * (v**2 - from_v**2) + pull * way
        result = np.zeros((self.labels.max() + 1, energy.shape[1]))
        np.add.at(result, self.labels, energy)
        return result


_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)


def together(values: np.ndarray) -> np.ndarray:
    """Means over `TOGETHER` lanes where there are many, (…, lane)."""
    *rows, lanes = values.shape
    if lanes % TOGETHER or lanes < TOGETHER**2:
        return values
    means: np.ndarray = values.reshape(*rows, TOGETHER, lanes // TOGETHER).mean(axis=-2)
    return means


def _forces(block: Block, *displacements: np.ndarray) -> np.ndarray:
    """Forces of kicks on bodies at rest at some displacements, (body, lane) each: (displacement, body, lane)."""
    states, (bodies, lanes) = len(displacements), displacements[0].shape
    place, rest, total = np.zeros((3, states, bodies + 1, lanes))
    np.stack(displacements, out=place[:, :-1])
    contacts = np.zeros((2, states, len(block.plan.system.ends), lanes))
    block.evaluate(place, rest, *contacts, total)
    forces: np.ndarray = total[:, :-1]
    return forces


def _gradient(block: Block, x: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return ``a = F/m`` of the forces of kicks, and its change in time, at some displacements, (body, lane) each."""
    mass, ahead = block.plan.system.linear[0][:, None], 0.25 * block.plan.clock.step
    way = ahead * v
    before, here, after = _forces(block, x - way, x, x + way)
    return here / mass, (after - before) / (2.0 * ahead * mass)


def _shifts(block: Block) -> tuple[np.ndarray, np.ndarray]:
    """Return s (s²) and r (s) of the smooth path ``x + s a``, ``v − r a − h²a'/12`` that kicks follow, (body, 1).

    A constant force keeps a body at the velocity ``a/γ``, but at ``r a`` more half way through its kicks. Kicks by
    ``F(x + h²a/12)`` make s the mean of h²/12 and r/γ, which is h²/12 where there is little friction.
    """
    mass, damping, _ = (item[:, None] for item in block.plan.system.linear)
    step = block.plan.clock.step
    friction = damping * step / mass
    strong = np.maximum(friction, LITTLE)
    lag = np.where(friction > LITTLE, 0.5 / np.tanh(0.5 * strong) - 1.0 / strong, friction / 12.0)
    ratio = np.where(friction > LITTLE, lag / strong, 1.0 / 12.0)
    return 0.5 * step**2 * (1.0 / 12.0 + ratio), step * lag


def _smooth(block: Block) -> tuple[np.ndarray, np.ndarray]:
    """Return the place and velocity on the smooth path that kicks follow."""
    plan, state = block.plan, block.state
    x, step = state.x[:-1].copy(), plan.clock.step
    v = state.v[:-1] - 0.5 * step * state.total[:-1] / plan.system.linear[0][:, None]
    a, change = _gradient(block, x, v)
    ahead, lag = _shifts(block)
    return x + ahead * a, v - lag * a - step**2 / 12.0 * change


def _begin(block: Block, x: np.ndarray, v: np.ndarray) -> None:
    """Let a block begin at a state of the smooth path."""
    state, step = block.state, block.plan.clock.step
    a, change = _gradient(block, x, v)
    ahead, lag = _shifts(block)
    state.x[:-1] = x - ahead * a
    state.v[:-1] = v + lag * a + step**2 / 12.0 * change
    block._half_kick()
    if block.plan.observed.counted:
        block._note_gaps(state.reading, state.velocity)


def _of_units(coarse: Plan, fine: Plan, model: Model, steps: int, most: int, found: list[list[Stretch]]) -> StepError:
    """Turn the sums of all stretches into biases and their standard errors.

    Where nothing is random, what stretches leave out of a run, of which `most` steps can be looked at, alone is not
    known.
    """
    stretches, labels = len(found[0]), model.connected()
    of_coarse = _joined(coarse, steps, [[item.coarse for item in block] for block in found])
    finer = round(coarse.clock.step / fine.clock.step)
    of_fine = _joined(fine, finer * steps, [[item.fine for item in block] for block in found])
    energy = np.concatenate([np.stack([item.energy for item in block], axis=1) for block in found], axis=-1)
    parts = len(energy)
    lanes = energy.shape[-1]

    def of_parts(values: np.ndarray) -> np.ndarray:
        result = np.zeros((parts, values.shape[-1]))
        np.add.at(result, labels, values)
        return result

    mass, damping, stiffness = (item[:, None] for item in coarse.system.linear)
    energies = of_parts(mass * of_coarse["mean_square_velocity"] + stiffness * of_coarse["mean_square_displacement"])
    size = of_parts(mass * of_coarse["mean_square_velocity"]).mean(axis=-1)
    taken = of_parts(damping * of_coarse["mean_square_velocity"] - of_coarse[_POWER]).mean(axis=-1)
    put_in = np.zeros(parts)
    if not coarse.noise.time_varying:
        np.add.at(
            put_in,
            labels[coarse.noise.white],
            np.pi * coarse.noise.intensity / coarse.system.linear[0, coarse.noise.white],
        )
    length = steps * coarse.clock.step
    memory = _memory(energies.reshape(parts, stretches, lanes), length)
    with np.errstate(divide="ignore", invalid="ignore"):
        memory = np.minimum(memory, size / np.maximum(taken, put_in))[:, None, None]
        if not coarse.steady:  # to the end
            memory = np.minimum(memory, length * np.arange(stretches)[::-1, None])
        gained = (energy * memory / (length * size[:, None, None])).reshape(parts, -1)
    gained = np.where(np.isfinite(gained), gained, 0.0)
    left_out = 1.0 if coarse.noise.random.any() else 1.0 - stretches * steps / most
    of_coarse, of_fine = (
        _with_variance(item, of_fine["mean_displacement"].mean(axis=-1)) for item in (of_coarse, of_fine)
    )
    bias, error = {}, {}
    for name in BIASED:
        if name not in of_coarse or not len(of_coarse[name]):
            continue
        difference, scale = of_coarse[name] - of_fine[name], _size(name, lambda item: of_fine[item].mean(axis=-1))
        kept = gained[labels[_first_bodies(model, name)]]
        if name == "mean_square_velocity":  # friction may make bodies forget their velocities within a step
            forgotten = (damping * coarse.clock.step > mass)[:, 0]
            off = np.stack([item[_BALANCE][forgotten] for item in (of_coarse, of_fine)], axis=1)
            difference[forgotten] -= _of_noise(difference[forgotten], off)
            kept[forgotten] = 0.0
        if name not in _MAY_BE_ZERO:
            difference = difference + of_fine[name].mean(axis=-1)[:, None] * kept
        with np.errstate(divide="ignore", invalid="ignore"):
            relative = difference / (1.0 - finer**-2.0) / scale[:, None]  # of second order
        unseen = ~np.isfinite(relative).all(axis=-1)  # 0/0: nothing moves, or closes
        relative[unseen] = 0.0
        bias[name], error[name] = relative.mean(axis=-1), _error(relative.reshape(-1, stretches, lanes), left_out)
        error[name][unseen] = np.inf
    names = {BODY: model.bodies, CONTACT: model.contacts}
    met = {name: of_coarse[name].mean(axis=-1) for name in bias}
    return StepError(coarse.clock.step, bias, error, names, met)


BIASED = (
    "mean_displacement",
    "mean_square_displacement",
    "variance_displacement",
    "mean_square_velocity",
    "contact_ratio",
    "contact_rate",
    "mean_contact_force",
)
"""Statistics whose bias is measured."""

_MAY_BE_ZERO = {"mean_displacement": "mean_square_displacement"}
_POWER, _LOAD, _BALANCE = "power of kicks", "load", "balance of the mean square velocity"
"""Names of what is known of units beside statistics."""


def _error(values: np.ndarray, left_out: float) -> np.ndarray:
    """Return the standard error of the mean over stretches and lanes, (…, stretch, lane).

    A stretch goes on where the one before has ended, which makes neighbours alike or unlike: lanes, or where there are
    few parts of them, are independent. A share may be `left_out` of what there is.
    """
    stretches, lanes = values.shape[-2:]
    parts = min(stretches, -(-UNITS // lanes))
    cuts = np.arange(parts) * stretches // parts
    sizes = np.diff([*cuts, stretches])[:, None]
    units = (np.add.reduceat(values, cuts, axis=-2) / sizes).reshape(*values.shape[:-2], -1)
    if units.shape[-1] == 1:
        return np.full(units.shape[:-1], np.inf if left_out > 0.0 else 0.0)
    error: np.ndarray = units.std(axis=-1, ddof=1) * math.sqrt(left_out / units.shape[-1])
    return error


def _of_noise(difference: np.ndarray, off: np.ndarray) -> np.ndarray:
    """Return what of differences, (body, unit), follows balances, whose means are 0, (body, balance, unit)."""
    off = np.where(np.isfinite(off).all(axis=-1, keepdims=True), off, 0.0)
    spread = off - off.mean(axis=-1, keepdims=True)
    shares = np.linalg.pinv(spread @ spread.swapaxes(1, 2), hermitian=True) @ spread @ difference[:, :, None]
    return np.asarray((shares * off).sum(axis=1))


def _with_variance(units: dict[str, np.ndarray], mean: np.ndarray) -> dict[str, np.ndarray]:
    """Add the variance of the displacement about a mean: that of x² − 2 E[x] x is of the first order."""
    square = units["mean_square_displacement"] + units[_LOAD]
    variance = square - 2.0 * mean[:, None] * units["mean_displacement"] + mean[:, None] ** 2
    return units | {"variance_displacement": variance}


def _size(name: str, mean: Callable[[str], np.ndarray]) -> np.ndarray:
    """Return what the bias of a statistic is a part of, from means by name."""
    if name in _MAY_BE_ZERO:
        return np.asarray(np.sqrt(mean(_MAY_BE_ZERO[name])))
    size = np.abs(mean(name))
    if name == "variance_displacement":  # of a body that a load holds still
        size = np.maximum(size, STILL * mean("mean_square_displacement"))
    return np.asarray(size)


def _first_bodies(model: Model, name: str) -> np.ndarray:
    """Slots of bodies, or of one body of each contact."""
    return model.ends.min(axis=1) if STATISTICS[name].dimension == CONTACT else np.arange(len(model.bodies))


def _joined(plan: Plan, steps: int, sums: list[list[Sums]]) -> dict[str, np.ndarray]:
    """Statistics of all stretches of all blocks, each a unit, (body or contact, stretch and lane)."""
    parts = [
        np.concatenate([np.stack([item[index] for item in block], axis=-2) for block in sums], axis=-1)
        for index in range(3)
    ]
    stretches, lanes = parts[0].shape[-2:]
    counts = np.stack([plan.counts(index * steps, (index + 1) * steps) for index in range(stretches)], axis=1)
    bodies, contacts, products = (item.reshape(*item.shape[:-2], stretches * lanes) for item in parts)
    moments = moments_of(plan, bodies, np.repeat(counts, lanes, axis=1), contacts, products)
    power, balance = bodies[:, FV].sum(axis=0) / steps, moments.balances["mean_square_velocity"]
    return moments.values() | {_POWER: power, _LOAD: moments.bodies.load, _BALANCE: balance}


def _memory(energy: np.ndarray, length: float) -> np.ndarray:
    """Return for how long energies are correlated (s), from their means over stretches, (part, stretch, lane).

    It is the time for which means over stretches that follow each other correlate as they do. Infinite where it is
    longer than can be seen.
    """
    result = np.full(len(energy), np.inf)
    if energy.shape[1] < FEWEST:
        return result
    offset = energy - energy.mean(axis=(1, 2), keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        correlation = (offset[:, 1:] * offset[:, :-1]).mean(axis=(1, 2)) / (offset**2).mean(axis=(1, 2))
    times = np.geomspace(1e-2, 1e2, 400)
    expected = correlation_of_neighbours(times)
    seen = correlation < expected[0]
    result[seen] = length / np.interp(-correlation[seen], -expected, times)
    return result
