"""The bias of a step, estimated from sums over short segments at the step and at a fraction of the step."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from functools import partial
from typing import NamedTuple

import numpy as np

from impactlab.assembly.mechanism import interrupted
from impactlab.assembly.model import Model
from impactlab.kernels.rows import FV
from impactlab.plan.plan import Plan
from impactlab.results.schema import BODY, CONTACT, EVERY, OF_STATES, STATE
from impactlab.statistics.drift import FEWEST_UNITS
from impactlab.statistics.moments import moments_of
from impactlab.step_control.measured.bias import STILL, Bias, margin_of, size_of
from impactlab.step_control.measured.step_bias import BIASED, GROWTH, StepBias
from impactlab.step_control.rules.relaxation import correlation_of_neighbours

TOGETHER = 8
"""Realizations that are one in the statistics of a measurement where there are many: each takes time."""

UNITS = 32
"""Least number of independent units of a measurement: so many tell a standard error to 13 %."""

ORDER = 2.0
"""Power of the step with which biases are taken to fall."""

ORDER_OF_STATES = 1.5
"""The same where laws have states: in a step in which noise turns the motion back, a law is off by h^(3/2)."""

ONE_MORE = 1.0 / math.sqrt(6.0)
"""Standard deviation of the difference between two paths in the number of closings, or of steps in contact, that comes
from when they close and open: that of the difference of two uniform numbers from 0 to 1."""

FEWEST_PARTS = 4
"""Fewest parts of a path that tell a standard error."""

SEPARATED = 0.1
"""Part of the kinetic energy by which two paths without noise differ at the end of segments, from which on they tell no
more of the rest of the run than independent ones."""

_POWER, _LOAD, _BALANCE = "power of kicks", "load", "balance of the mean square velocity"
_CHANGES = "mean rate of all changes of states"
"""Names of quantities of units that are no statistics."""

Sums = tuple[np.ndarray, ...]
"""Of bodies, contacts, pairs and states of laws."""


class Segments(NamedTuple):
    """Sums of successive segments; each lane is a mean over realizations, see `together`."""

    coarse: list[Sums]  # (…, lane) of each segment
    fine: list[Sums]
    energy: np.ndarray  # (segment, part, lane) excess energy of the coarse path at the end (J)

    def followed_by(self, other: Segments) -> Segments:
        """Return these segments and others that follow them."""
        energy = np.concatenate([self.energy, other.energy])
        return Segments(self.coarse + other.coarse, self.fine + other.fine, energy)


class Coverage(NamedTuple):
    """The place of segments within a run, in steps."""

    begins: tuple[int, ...]
    steps: int  # of each
    run: int
    follow: bool = False  # whether those of the fine path follow each other

    @property
    def left_out(self) -> float:
        """Share of the run that no segment sees."""
        return max(0.0, 1.0 - len(self.begins) * self.steps / self.run)

    @property
    def reached(self) -> float:
        """Share of the run that is over when the last segment ends."""
        return min(1.0, (self.begins[-1] + self.steps) / self.run)

    @property
    def to_the_end(self) -> np.ndarray:
        """Steps of the run that follow each segment."""
        steps: np.ndarray = np.maximum(0, self.run - self.steps - np.array(self.begins))
        return steps


def together(values: np.ndarray) -> np.ndarray:
    """Means over `TOGETHER` lanes where there are many, (…, lane)."""
    *rows, lanes = values.shape
    if lanes % TOGETHER or lanes < TOGETHER**2:
        return values
    means: np.ndarray = values.reshape(*rows, TOGETHER, lanes // TOGETHER).sum(axis=-2) / TOGETHER
    return means


class _Units(NamedTuple):
    """Statistics of the same motion at a step and at a part of it, by unit of the measurement: a segment of a lane."""

    plan: Plan  # at the step
    model: Model
    finer: int
    coarse: dict[str, np.ndarray]  # (body or contact or state, unit)
    fine: dict[str, np.ndarray]
    gained: np.ndarray  # share by which energy grows, (connected part, unit)
    chattering: np.ndarray  # (contact,)
    grows: np.ndarray  # (state,)

    @property
    def order(self) -> float:
        """Power of the step with which biases are taken to fall."""
        return ORDER_OF_STATES if self.model.kicks.states else ORDER

    @property
    def seen(self) -> float:
        """Part of a bias that is seen as the difference between the steps."""
        return 1.0 - float(
            self.finer ** -(ORDER_OF_STATES if self.model.kicks.states or interrupted(self.model).any() else ORDER)
        )

    @property
    def forgotten(self) -> np.ndarray:
        """Whether friction may stop bodies within a step, (body,)."""
        mass, damping, _ = self.plan.system.linear
        return np.asarray(damping * self.plan.clock.step > mass)

    @property
    def names(self) -> list[str]:
        """Statistics whose bias is measured."""
        return [name for name in (*BIASED, *OF_STATES) if name in self.coarse and len(self.coarse[name])]

    @property
    def margin(self) -> float:
        """Margin of the measured biases, in their errors."""
        return margin_of(sum(len(self.coarse[name]) for name in self.names))

    @property
    def growth(self) -> np.ndarray:
        """Sizes to which biases of growth rates are relative, (state,); empty without states."""
        if not self.model.kicks.states:
            return np.zeros(0)
        return np.where(self.grows, self._size(GROWTH), self.fine[_CHANGES].mean(axis=-1))

    def _size(self, name: str) -> np.ndarray:
        return size_of(name, lambda item: self.fine[item].mean(axis=-1))

    def fitted(self, name: str) -> int:
        """Return how many numbers are fitted to the differences of a statistic."""
        return 1 + 2 * bool(name == "mean_square_velocity" and self.forgotten.any())

    def relative(self, name: str) -> np.ndarray:
        """Return the relative bias of a statistic, (label, unit); not finite where nothing moves or closes."""
        difference, value = self.coarse[name] - self.fine[name], self.fine[name].mean(axis=-1)
        kept = self.gained[self.model.connected[_first_bodies(self.model, name)]]
        if name == "mean_square_velocity":
            lost = self.forgotten
            off = np.stack([item[_BALANCE][lost] for item in (self.coarse, self.fine)], axis=1)
            difference[lost] -= _of_noise(difference[lost], off)
            kept[lost] = 0.0
        if not EVERY[name].square:
            difference = difference + value[:, None] * kept
        size = self.growth if name == GROWTH else self._size(name)
        if EVERY[name].dimension == STATE:
            size = np.where(size == 0.0, np.inf, size)  # a state that stays 0 does so at any step
        with np.errstate(divide="ignore", invalid="ignore"):
            relative: np.ndarray = difference / self.seen / size[:, None]
        if name == "contact_rate":
            relative *= self.plan.events.whole(self.finer, self.seen, self.chattering)[:, None]
        return relative


def bias_of(
    coarse: Plan, fine: Plan, model: Model, coverage: Coverage, found: list[Segments], chattering: np.ndarray
) -> StepBias:  # fmt: skip
    """Turn the sums over all segments of all blocks into biases and their errors.

    The plans are those of the blocks at the step and at a part of it. Impacts of `chattering` contacts, (contact,) of
    bool, were too slow to count. Where nothing is random, only the steps between segments are unknown.
    """
    finer, labels = round(coarse.clock.step / fine.clock.step), model.connected
    energy = np.concatenate([item.energy for item in found], axis=-1)
    of_coarse = _joined(coarse, coverage, 1, [item.coarse for item in found])
    of_fine = _joined(fine, coverage, finer, [item.fine for item in found])
    gained = _gained(coarse, of_coarse, labels, energy, coverage)
    apart = coarse.random or (len(energy) > 1 and _separated(coarse, of_coarse["mean_square_velocity"], labels, energy))
    mean = of_fine["mean_displacement"].mean(axis=-1)
    of_coarse, of_fine = _with_variance(of_coarse, mean), _with_variance(of_fine, mean)
    of_rest = np.zeros((2, len(labels)), dtype=bool)
    if not coarse.random:
        of_rest = _at_rest(coarse, (of_coarse, of_fine), labels)
        gained[np.bincount(labels, ~of_rest[0]) == 0.0] = 0.0
    units = _Units(coarse, model, finer, of_coarse, of_fine, gained, chattering, np.zeros(0, dtype=bool))
    if model.kicks.states:
        units = units._replace(grows=_grows(of_coarse[GROWTH], units.margin))

    def scatter(values: np.ndarray, fitted: int) -> np.ndarray:
        values = values.reshape(-1, len(energy), energy.shape[-1])
        if coverage.follow:
            return error_of_means(values, partial(_widened, margin=units.margin))
        if coarse.random and not coarse.steady and energy.shape[-1] > 1:  # times differ by more than chance
            return _error_in_time(values, coverage.left_out, units.margin)
        return _error(values, 1.0 if apart else coverage.left_out, units.margin, fitted)

    bias, measured = dict[str, Bias](), {}
    unsure = {} if coarse.random else _unsure(coarse, model, of_coarse)
    for name in units.names:
        relative = units.relative(name)
        unseen = ~np.isfinite(relative).all(axis=-1)
        relative[unseen] = 0.0
        without = _without_bias(coarse, model, name, of_rest)
        error = np.where(unseen, np.inf, scatter(relative, units.fitted(name)))
        value = np.where(without, 0.0, relative.mean(axis=-1))
        bias[name] = Bias(value, np.where(without, 0.0, error), unsure.get(name, 0.0))
        measured[name] = of_coarse[name].mean(axis=-1)
    if model.kicks.states:
        _follow_growth(bias, units.grows)
    velocity = of_coarse["mean_square_velocity"]
    measured["mean_square_velocity"][of_rest[0]] = np.inf  # a body at rest is none that is too fast
    return StepBias(
        coarse.clock.step, bias,
        {BODY: model.bodies.names, CONTACT: model.contacts.names, STATE: tuple(item[0] for item in model.kicks.states)},
        measured, scatter(velocity, 1), coverage.reached if _varying(coarse) else 1.0,
        error_of_order=0.0 if coarse.random else 1.0 / finer,  # all that a bias of first order leaves
        growth=units.growth,
        order=units.order,
    )  # fmt: skip


def _varying(plan: Plan) -> bool:
    """Whether the motion may meet something new until the end of a run.

    From a given start, damped bodies under noise become stationary; all other motion may meet something new.
    """
    return bool(plan.noise.time_varying or plan.led or not (plan.noise.random & (plan.system.linear[1] > 0.0)).all())


def _without_bias(plan: Plan, model: Model, name: str, of_rest: np.ndarray) -> np.ndarray:
    """Whether labels of a statistic have no measurable bias: nothing moves there, or the bias has no meaning."""
    moved = np.append(plan.noise.random, False)
    if not plan.steady or not moved.any():  # else what a start has left of a body that nothing moves is no motion
        moved[:] = True
    moved[:-1] &= model.bodies.free
    slow, at_zero = of_rest
    if name in ("mean_displacement", "mean_square_displacement"):
        return np.asarray(~moved[:-1] | at_zero)
    dimension = EVERY[name].dimension
    if dimension == BODY:
        return np.asarray(~moved[:-1] | slow)
    ends = model.ends if dimension == CONTACT else model.kicks.state_ends
    result: np.ndarray = ~ends.any(moved[:-1]) | ends.all(slow)
    if name == "contact_ratio":  # a rest is known to a step, and has no duration where noise ends it
        result |= model.contacts.impulsive
    return result


def _grows(rates: np.ndarray, margin: float) -> np.ndarray:
    """Whether each state grows by more than chance, from its growth rates in all units, (state, unit)."""
    number = rates.shape[-1]
    if number < FEWEST_UNITS:
        return np.zeros(len(rates), dtype=bool)
    return np.asarray(np.abs(rates.mean(axis=-1)) > margin * rates.std(axis=-1, ddof=1) / math.sqrt(number))


def _follow_growth(bias: dict[str, Bias], grows: np.ndarray) -> None:
    """Give means of states that grow the biases of their growth rates: all segments begin at one state."""
    growth, error = bias[GROWTH].value[grows], bias[GROWTH].error[grows]
    for name, (value, own) in {
        "mean_law_state": (growth, error),
        "mean_square_law_state": ((2.0 + growth) * growth, 2.0 * error),
    }.items():
        bias[name].value[grows], bias[name].error[grows] = value, own


def _separated(plan: Plan, v2: np.ndarray, labels: np.ndarray, energy: np.ndarray) -> bool:
    """Whether paths of a connected part differ much in energy at the ends of segments, (segment, part, lane) (J)."""
    kinetic = np.bincount(labels, 0.5 * plan.system.linear[0] * v2.mean(axis=-1))
    return bool((np.sqrt((energy**2).mean(axis=(0, 2))) > SEPARATED * kinetic).any())


def _at_rest(plan: Plan, units: tuple[dict[str, np.ndarray], ...], labels: np.ndarray) -> np.ndarray:
    """Whether bodies are at rest on a path without noise: row 0 for velocities, row 1 for displacements, (2, body).

    A velocity or displacement counts as rest if it is rounding, or the remainder of a decayed motion, beside the
    motion of connected bodies, the motion at the start, and the motion in a step under contact forces alone.
    """
    mass, _, stiffness = plan.system.linear
    v2, x2 = (
        np.min([item[name].mean(axis=-1) for item in units], axis=0)
        for name in ("mean_square_velocity", "mean_square_displacement")
    )
    start = plan.start.state if isinstance(plan.start.state, np.ndarray) else np.zeros((2, len(mass), 1))
    first_x2, first_v2 = (start**2).mean(axis=-1)
    largest = np.zeros((2, labels.max() + 1))
    np.maximum.at(largest[0], labels, mass * np.maximum(v2, first_v2) + stiffness * np.maximum(x2, first_x2))
    np.maximum.at(largest[1], labels, np.maximum(x2, first_x2))
    energy, square = largest[:, labels]
    force, ends = np.zeros(len(mass) + 1), plan.system.ends
    if "mean_contact_force" in units[0]:
        np.add.at(force, ends.slots, np.abs(ends.weights) * units[0]["mean_contact_force"].mean(axis=-1)[ends.rows])
    slow = v2 < STILL * np.maximum(energy / mass, (force[:-1] * plan.clock.step / mass) ** 2)
    return np.array([slow, slow & (x2 < STILL * square)])


def _unsure(plan: Plan, model: Model, units: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return errors of the biases of contacts that a path without noise cannot tell; see `ONE_MORE`."""
    time = plan.clock.duration
    if "contact_rate" not in units or not len(units["contact_rate"]):
        return {}
    rate, ratio = (units[name].mean(axis=-1) for name in ("contact_rate", "contact_ratio"))
    with np.errstate(divide="ignore", invalid="ignore"):
        one = np.nan_to_num(ONE_MORE / (time * rate), posinf=0.0)
        step = np.nan_to_num(ONE_MORE * plan.clock.step * rate / ratio, posinf=0.0)
    return {
        "contact_rate": one,
        "contact_ratio": np.hypot(step, one) * ~model.contacts.impulsive,  # a rest is known to a step, and is not told
        "mean_contact_force": one * model.contacts.impulsive,
    }


def rows_of(model: Model, parts: np.ndarray, names: Iterable[str]) -> dict[str, np.ndarray]:
    """Return quantities of connected parts, copied to the bodies or contacts of each named statistic."""
    labels = model.connected
    return {name: parts[labels[_first_bodies(model, name)]] for name in names}


def _gained(
    plan: Plan, units: dict[str, np.ndarray], labels: np.ndarray, energy: np.ndarray, coverage: Coverage
) -> np.ndarray:
    """Return the share by which the energy of connected parts grows, since they keep what a step puts in: (part, unit).

    They keep it until friction takes it away; no longer than energies are correlated where motion is
    stationary, and no longer than the run lasts where it is not. NaN where nobody knows for how long.
    """
    segments, parts, lanes = energy.shape
    mass, damping, stiffness = (item[:, None] for item in plan.system.linear)
    v2, put_in = units["mean_square_velocity"], np.zeros(parts)
    if not plan.noise.time_varying:
        white = plan.noise.white
        np.add.at(put_in, labels[white], np.pi * plan.noise.intensity / plan.system.linear[0, white])

    def of_parts(values: np.ndarray) -> np.ndarray:
        result = np.zeros((parts, values.shape[-1]))
        np.add.at(result, labels, values)
        return result

    energies = of_parts(mass * v2 + stiffness * units["mean_square_displacement"]).reshape(parts, segments, lanes)
    size, taken = (of_parts(item).mean(axis=-1) for item in (mass * v2, damping * v2 - units[_POWER]))
    length = coverage.steps * plan.clock.step
    with np.errstate(divide="ignore", invalid="ignore"):
        memory = (size / np.maximum(taken, put_in))[:, None, None]
        if plan.steady:
            memory = np.minimum(memory, _memory(energies, length)[:, None, None])
        else:
            memory = np.minimum(memory, plan.clock.step * coverage.to_the_end[:, None])
        gained = energy.swapaxes(0, 1) * memory / (length * size[:, None, None])
    result: np.ndarray = np.where(np.isfinite(gained), gained, np.nan).reshape(parts, -1)
    return result


def _error(values: np.ndarray, left_out: float, margin: float, fitted: int) -> np.ndarray:
    """Return the standard error of the mean over segments and lanes, (…, segment, lane).

    A segment goes on where the one before has ended, which makes neighbours alike or unlike: lanes, or where there are
    few parts of them, are independent. A share may be `left_out` of what there is. The error is larger by as much as
    the quantile of Student's law for so many units, less what was `fitted`, is beyond the normal one at the margin.
    """
    segments, lanes = values.shape[-2:]
    parts = min(segments, -(-UNITS // lanes))
    cuts = np.arange(parts) * segments // parts
    sizes = np.diff([*cuts, segments])[:, None]
    units = (np.add.reduceat(values, cuts, axis=-2) / sizes).reshape(*values.shape[:-2], -1)
    if units.shape[-1] == 1:
        return np.full(units.shape[:-1], np.inf if left_out > 0.0 else 0.0)
    error: np.ndarray = (
        _widened(units.shape[-1] - fitted, margin) * units.std(axis=-1, ddof=1) * math.sqrt(left_out / units.shape[-1])
    )
    return error


def _error_in_time(values: np.ndarray, left_out: float, margin: float) -> np.ndarray:
    """Return the same standard error where segments stand for different times, (…, segment, lane).

    Lanes of one segment differ by chance alone. Times differ systematically, which matters for the times `left_out`.
    """
    segments, lanes = values.shape[-2:]
    variance = values.var(axis=-1, ddof=1).mean(axis=-1) / (segments * lanes)
    if segments > 1:
        variance = variance + left_out * values.mean(axis=-1).var(axis=-1, ddof=1) / segments
    error: np.ndarray = _widened(segments * (lanes - 1), margin) * np.sqrt(variance)
    return error


def error_of_means(values: np.ndarray, widened: Callable[[int], float]) -> np.ndarray:
    """Return standard errors of means over paths, from parts that follow each other, (row, part, lane).

    Parts may be correlated with the next ones: the largest error of parts of several lengths counts. An error from
    few degrees of freedom is `widened`.
    """
    parts, lanes = values.shape[-2:]
    if lanes >= FEWEST_UNITS:
        units = [values.mean(axis=-2)]
    else:
        numbers = [parts >> power for power in range(4) if parts >> power >= FEWEST_PARTS]
        units = [_longer(values, number) for number in numbers]
    errors = [widened(item.shape[-1] - 1) * item.std(axis=-1, ddof=1) / math.sqrt(item.shape[-1]) for item in units]
    return np.asarray(np.max(errors, axis=0))


def _longer(values: np.ndarray, number: int) -> np.ndarray:
    """Return means over so many longer parts, of all lanes, (row, unit)."""
    cuts = np.arange(number) * values.shape[-2] // number
    means = np.add.reduceat(values, cuts, axis=-2) / np.diff([*cuts, values.shape[-2]])[:, None]
    return np.asarray(means.reshape(len(values), -1))


def _widened(freedom: int, margin: float) -> float:
    """Return the ratio of a quantile of Student's law to the normal one, at the given standard errors."""
    from scipy.special import ndtr, stdtrit  # loaded only here

    return float(-stdtrit(freedom, ndtr(-margin))) / margin if freedom > 0 else math.inf


def _of_noise(difference: np.ndarray, off: np.ndarray) -> np.ndarray:
    """Return the part of differences, (body, unit), that balances with mean 0, (body, balance, unit), explain."""
    off = np.where(np.isfinite(off).all(axis=-1, keepdims=True), off, 0.0)
    spread = off - off.mean(axis=-1, keepdims=True)
    shares = np.linalg.pinv(spread @ spread.swapaxes(1, 2), hermitian=True) @ spread @ difference[:, :, None]
    return np.asarray((shares * off).sum(axis=1))


def _with_variance(units: dict[str, np.ndarray], mean: np.ndarray) -> dict[str, np.ndarray]:
    """Add the variance of the displacement about a mean: that of x² − 2 E[x] x is of the first order."""
    square = units["mean_square_displacement"] + units[_LOAD]
    variance = square - 2.0 * mean[:, None] * units["mean_displacement"] + mean[:, None] ** 2
    return units | {"variance_displacement": variance}


def _first_bodies(model: Model, name: str) -> np.ndarray:
    """Slots of bodies, or of one body of each contact, or of the law of each state."""
    links = {CONTACT: model.ends, STATE: model.kicks.state_ends}.get(EVERY[name].dimension)
    return np.arange(len(model.bodies)) if links is None else model.first_of(links)


def _joined(plan: Plan, coverage: Coverage, finer: int, sums: list[list[Sums]]) -> dict[str, np.ndarray]:
    """Statistics of all segments of all blocks, each a unit, (body or contact, segment and lane)."""
    steps = finer * coverage.steps
    parts = [
        np.concatenate([np.stack(of_kind, axis=-2) for of_kind in kinds], axis=-1)
        for kinds in zip(*(zip(*block, strict=True) for block in sums), strict=True)
    ]
    segments, lanes = parts[0].shape[-2:]
    counts = np.stack([plan.counts(finer * begin, finer * begin + steps) for begin in coverage.begins], axis=1)
    bodies, contacts, products, laws = (item.reshape(*item.shape[:-2], segments * lanes) for item in parts)
    moments = moments_of(
        plan, lambda rows: bodies[:, :, rows], np.repeat(counts, lanes, axis=1), contacts, products, laws
    )
    power, balance = bodies[:, FV].sum(axis=0) / steps, moments.balances["mean_square_velocity"]
    changes = laws[3] / (steps * plan.clock.step)
    return moments.values() | {_POWER: power, _LOAD: moments.bodies.load, _BALANCE: balance, _CHANGES: changes}


def _memory(energy: np.ndarray, length: float) -> np.ndarray:
    """Return for how long energies are correlated (s), from their means over segments, (part, segment, lane).

    It is the time for which means over segments that follow each other correlate as they do. Infinite where it is
    longer than can be seen.
    """
    result = np.full(len(energy), np.inf)
    if energy.shape[1] < FEWEST_UNITS:
        return result
    offset = energy - energy.mean(axis=(1, 2), keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        correlation = (offset[:, 1:] * offset[:, :-1]).mean(axis=(1, 2)) / (offset**2).mean(axis=(1, 2))
    times = np.geomspace(1e-2, 1e2, 400)
    expected = correlation_of_neighbours(times)
    seen = correlation < expected[0]
    result[seen] = length / np.interp(-correlation[seen], -expected, times)
    return result
