"""What the sums of short segments at a step and at a part of it tell of the bias of the step."""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import partial
from typing import NamedTuple

import numpy as np

from impactlab.assembly.model import Model
from impactlab.kernels.rows import FV
from impactlab.nonlinear.relaxation import correlation_of_neighbours
from impactlab.plan.plan import Plan
from impactlab.results.schema import BODY, CONTACT, OF_STATES, STATE, statistic_of
from impactlab.simulation.separation import error_of_means
from impactlab.simulation.step_error import BIASED, FEWEST, GROWTH, MAY_BE_ZERO, STILL, StepError, limit_of, size_of
from impactlab.statistics.moments import moments_of

TOGETHER = 8
"""Realizations that are one in the statistics of a measurement where there are many: each takes time."""

UNITS = 32
"""Least number of independent units of a measurement: so many tell a standard error to 13 %."""

ORDER, ORDER_OF_STATES = 2.0, 1.5
"""Power of the step with which biases are taken to fall, and the same where laws have states: what a law does not see
of a step in which noise turns the motion back is as large as h^(3/2)."""

ONE_MORE = 1.0 / math.sqrt(6.0)
"""Standard deviation of the number of closings, or of steps in contact in a closing, between two paths that differ by
when they close and open: of the difference of two numbers between 0 and 1."""

SEPARATED = 0.1
"""Part of the kinetic energy by which two paths without noise differ at the end of segments, from which on they tell no
more of the rest of the run than independent ones."""

_POWER, _LOAD, _BALANCE = "power of kicks", "load", "balance of the mean square velocity"
_CHANGES = "mean rate of all changes of states"
"""Names of what is known of units beside statistics."""

Sums = tuple[np.ndarray, ...]
"""Of bodies, contacts, pairs and states of laws."""


class Segments(NamedTuple):
    """What is known of segments that follow each other; each lane is a mean over realizations, see `together`."""

    coarse: list[Sums]  # (…, lane) of each segment
    fine: list[Sums]
    energy: np.ndarray  # (segment, part, lane) that the coarse path has more at its end (J)

    def followed_by(self, other: Segments) -> Segments:
        """Return these segments and others that follow them."""
        energy = np.concatenate([self.energy, other.energy])
        return Segments(self.coarse + other.coarse, self.fine + other.fine, energy)


class Coverage(NamedTuple):
    """What segments are of a run, in steps."""

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


def bias_of(
    coarse: Plan, fine: Plan, model: Model, coverage: Coverage, found: list[Segments], chattering: np.ndarray
) -> StepError:  # fmt: skip
    """Turn the sums of all segments of all blocks into biases and their standard errors.

    Parameters
    ----------
    coarse, fine : Plan
        Plans of the blocks at the step, and at a part of it.
    model : Model
    coverage : Coverage
        What the segments are of the run; where nothing is random, what they leave out alone is not known.
    found : list of Segments
        Of each block.
    chattering : (rigid,) ndarray of bool
        Whether impacts of rigid contacts were too slow to count.
    """
    finer, labels = round(coarse.clock.step / fine.clock.step), model.connected()
    energy = np.concatenate([item.energy for item in found], axis=-1)
    segments, _, lanes = energy.shape
    seen = 1.0 - finer ** -(
        ORDER_OF_STATES if model.remembering or model.interrupted.any() else ORDER
    )  # part of the bias
    of_coarse = _joined(coarse, coverage, 1, [item.coarse for item in found])
    of_fine = _joined(fine, coverage, finer, [item.fine for item in found])
    gained = _gained(coarse, of_coarse, labels, energy, coverage)
    apart = coarse.random or (segments > 1 and _separated(coarse, of_coarse["mean_square_velocity"], labels, energy))
    mean = of_fine["mean_displacement"].mean(axis=-1)
    of_coarse, of_fine = _with_variance(of_coarse, mean), _with_variance(of_fine, mean)
    mass, damping, _ = coarse.system.linear
    forgotten = damping * coarse.clock.step > mass  # bodies that friction may stop within a step
    moved = np.append(coarse.noise.random, False)
    if not coarse.steady or not moved.any():  # else what a start has left of a body that nothing moves is no motion
        moved[:] = True
    moved[:-1] &= ~model.prescribed

    names = [name for name in (*BIASED, *OF_STATES) if name in of_coarse and len(of_coarse[name])]
    limit = limit_of(sum(len(of_coarse[name]) for name in names))

    def scatter(values: np.ndarray, fitted: int) -> np.ndarray:
        values = values.reshape(-1, segments, lanes)
        if coverage.follow:
            return error_of_means(values, partial(_widened, limit=limit))
        if coarse.random and not coarse.steady and lanes > 1:  # times differ by more than chance
            return _error_in_time(values, coverage.left_out, limit)
        return _error(values, 1.0 if apart else coverage.left_out, limit, fitted)

    still = {BODY: ~moved[:-1], CONTACT: ~model.ends.any(moved[:-1]), STATE: ~model.state_ends.any(moved[:-1])}
    of_rest = np.zeros((2, len(labels)), dtype=bool)
    if not coarse.random:
        of_rest = _at_rest(coarse, (of_coarse, of_fine), labels)
        gained[np.bincount(labels, ~of_rest[0]) == 0.0] = 0.0
    slow, at_zero = of_rest
    resting = {BODY: slow, CONTACT: model.ends.all(slow), STATE: model.state_ends.all(slow)}
    bias, error, measured = {}, {}, {}
    grows = _grows(of_coarse[GROWTH], limit) if model.remembering else np.zeros(0, dtype=bool)
    growth = np.zeros(0)
    for name in names:
        difference, value = of_coarse[name] - of_fine[name], of_fine[name].mean(axis=-1)
        kept, fitted = gained[labels[_first_bodies(model, name)]], 1
        if name == "mean_square_velocity":
            off = np.stack([item[_BALANCE][forgotten] for item in (of_coarse, of_fine)], axis=1)
            difference[forgotten] -= _of_noise(difference[forgotten], off)
            kept[forgotten], fitted = 0.0, 1 + 2 * bool(forgotten.any())
        if name not in MAY_BE_ZERO:
            difference = difference + value[:, None] * kept
        size = size_of(name, lambda item: of_fine[item].mean(axis=-1))
        if name == GROWTH:
            growth = size = np.where(grows, size, of_fine[_CHANGES].mean(axis=-1))
        if statistic_of(name).dimension == STATE:
            size = np.where(size == 0.0, np.inf, size)  # a state that stays 0 does so at any step
        with np.errstate(divide="ignore", invalid="ignore"):
            relative = difference / seen / size[:, None]
        if name == "contact_rate":
            relative[coarse.impacts.rigid.contacts] *= _of_impacts(coarse, finer, seen, chattering)
        unseen = ~np.isfinite(relative).all(axis=-1)  # 0/0: nothing moves, or closes
        relative[unseen] = 0.0
        bias[name] = relative.mean(axis=-1)
        error[name] = scatter(relative, fitted)
        error[name][unseen] = np.inf
        dimension = statistic_of(name).dimension
        rests = at_zero if name in ("mean_displacement", "mean_square_displacement") else resting[dimension]
        bias[name][still[dimension] | rests] = error[name][still[dimension] | rests] = 0.0
        if name == "contact_ratio":  # a rest is known to a step, and has no duration where noise ends it
            bias[name][model.rigid] = error[name][model.rigid] = 0.0
        measured[name] = of_coarse[name].mean(axis=-1)
    if model.remembering:
        _follow_growth(bias, error, grows)
    velocity = of_coarse["mean_square_velocity"]
    labels_of = {BODY: model.bodies, CONTACT: model.contacts, STATE: tuple(label for label, _ in model.states)}
    # from a given start damped bodies under noise become stationary; all others may meet something to the end
    varying = coarse.noise.time_varying or coarse.led or not (coarse.noise.random & (damping > 0.0)).all()
    reached = coverage.reached if varying else 1.0
    if "mean_square_velocity" in measured:  # a body at rest is none that is too fast
        measured["mean_square_velocity"][slow] = np.inf
    unsure = {} if coarse.random else _unsure(coarse, model, measured)
    return StepError(
        coarse.clock.step, bias, error, labels_of, measured, scatter(velocity, 1), reached, unsure,
        doubt_of_order=0.0 if coarse.random else 1.0 / finer,  # all that a bias of first order leaves
        growth=growth,
        order=ORDER_OF_STATES if model.remembering else ORDER,
    )  # fmt: skip


def _grows(rates: np.ndarray, limit: float) -> np.ndarray:
    """Whether each state grows by more than chance, from its growth rates in all units, (state, unit)."""
    number = rates.shape[-1]
    if number < FEWEST:
        return np.zeros(len(rates), dtype=bool)
    return np.asarray(np.abs(rates.mean(axis=-1)) > limit * rates.std(axis=-1, ddof=1) / math.sqrt(number))


def _follow_growth(bias: dict[str, np.ndarray], error: dict[str, np.ndarray], grows: np.ndarray) -> None:
    """Give means of states that grow the biases of their growth rates: all segments begin at one state."""
    growth, doubt = bias[GROWTH][grows], error[GROWTH][grows]
    bias["mean_law_state"][grows], error["mean_law_state"][grows] = growth, doubt
    bias["mean_square_law_state"][grows], error["mean_square_law_state"][grows] = (2.0 + growth) * growth, 2.0 * doubt


def _of_impacts(plan: Plan, finer: int, seen: float, chattering: np.ndarray) -> np.ndarray:
    """Return what biases of the rates of impacts are to others of which a part is seen; 0 where nothing tells them.

    Rates of the fast impacts alone are like others.
    """
    of_order = seen / (1.0 - finer ** -plan.impacts.orders[:, None])
    return np.where(plan.impacts.unresolved[:, None], 0.0, np.where(chattering[:, None], 1.0, of_order))


def _separated(plan: Plan, v2: np.ndarray, labels: np.ndarray, energy: np.ndarray) -> bool:
    """Whether paths of a connected part differ much in energy at the ends of segments, (segment, part, lane) (J)."""
    kinetic = np.bincount(labels, 0.5 * plan.system.linear[0] * v2.mean(axis=-1))
    return bool((np.sqrt((energy**2).mean(axis=(0, 2))) > SEPARATED * kinetic).any())


def _at_rest(plan: Plan, units: tuple[dict[str, np.ndarray], ...], labels: np.ndarray) -> np.ndarray:
    """Whether bodies are at rest on a path, where nothing is random: which of their statistics mean nothing, (2, body).

    Their velocities, and their displacements, are rounding, or what has decayed of a motion, beside those of the bodies
    around them, those at the start, and those of a step under the forces of their contacts alone.
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


def _unsure(plan: Plan, model: Model, measured: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return what a path without noise leaves unsure of biases of contacts, as standard errors; see `ONE_MORE`."""
    rate, time = measured.get("contact_rate"), plan.clock.duration
    if rate is None:
        return {}
    with np.errstate(divide="ignore", invalid="ignore"):
        one = np.nan_to_num(ONE_MORE / (time * rate), posinf=0.0)
        step = np.nan_to_num(ONE_MORE * plan.clock.step * rate / measured["contact_ratio"], posinf=0.0)
    return {
        "contact_rate": one,
        "contact_ratio": np.hypot(step, one) * ~model.rigid,  # a rest is known to a step, and is not told
        "mean_contact_force": one * model.rigid,
    }


def rows_of(model: Model, parts: np.ndarray, names: Iterable[str]) -> dict[str, np.ndarray]:
    """Return what is known of connected parts for the bodies or contacts of some statistics, by name."""
    labels = model.connected()
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


def _error(values: np.ndarray, left_out: float, limit: float, fitted: int) -> np.ndarray:
    """Return the standard error of the mean over segments and lanes, (…, segment, lane).

    A segment goes on where the one before has ended, which makes neighbours alike or unlike: lanes, or where there are
    few parts of them, are independent. A share may be `left_out` of what there is. The error is larger by as much as
    the quantile of Student's law for so many units, less what was `fitted`, is beyond the normal one at the limit.
    """
    segments, lanes = values.shape[-2:]
    parts = min(segments, -(-UNITS // lanes))
    cuts = np.arange(parts) * segments // parts
    sizes = np.diff([*cuts, segments])[:, None]
    units = (np.add.reduceat(values, cuts, axis=-2) / sizes).reshape(*values.shape[:-2], -1)
    if units.shape[-1] == 1:
        return np.full(units.shape[:-1], np.inf if left_out > 0.0 else 0.0)
    error: np.ndarray = (
        _widened(units.shape[-1] - fitted, limit) * units.std(axis=-1, ddof=1) * math.sqrt(left_out / units.shape[-1])
    )
    return error


def _error_in_time(values: np.ndarray, left_out: float, limit: float) -> np.ndarray:
    """Return the same where segments tell of different times, (…, segment, lane).

    Lanes of one segment differ by chance alone; times differ among themselves, which matters for those `left_out`.
    """
    segments, lanes = values.shape[-2:]
    variance = values.var(axis=-1, ddof=1).mean(axis=-1) / (segments * lanes)
    if segments > 1:
        variance = variance + left_out * values.mean(axis=-1).var(axis=-1, ddof=1) / segments
    error: np.ndarray = _widened(segments * (lanes - 1), limit) * np.sqrt(variance)
    return error


def _widened(freedom: int, limit: float) -> float:
    """Return how much farther Student's law reaches than the normal one at some standard errors."""
    from scipy.special import ndtr, stdtrit  # loaded only here

    return float(-stdtrit(freedom, ndtr(-limit))) / limit if freedom > 0 else math.inf


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


def _first_bodies(model: Model, name: str) -> np.ndarray:
    """Slots of bodies, or of one body of each contact, or of the law of each state."""
    links = {CONTACT: model.ends, STATE: model.state_ends}.get(statistic_of(name).dimension)
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
