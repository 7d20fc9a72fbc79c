"""What every integrator is, and the arguments that its compiled loop takes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numba import b1, f4, f8, i8, types, u4, u8, void

from impactlab.component import Component
from impactlab.errors import InvalidInput
from impactlab.kernels.jit import FORCES, FORCES_OF_ONE, loop
from impactlab.kernels.single import without_lanes
from impactlab.linear import LinearSystem, lines_of
from impactlab.model import Model


class Noise(NamedTuple):
    """White noise on some bodies: rows of normals, two for a body whose flow needs them."""

    bodies: np.ndarray  # (row,) slots, second rows last
    runs: np.ndarray  # (run, 3) bodies that follow each other: the first, its row or -1, number
    seconds: int  # first of the second rows
    amplitude: np.ndarray  # (phase, 2, row) of displacement and velocity, or nothing and force
    streams: np.ndarray  # (3, row) addresses of the streams
    realizations: np.ndarray  # (lane,) indices
    scale: np.ndarray  # (1 or step, row) factor of the amplitude
    coarse: bool  # whether a step takes the noise of two steps of half the length


class Cross(NamedTuple):
    """Blocks of the linear motion that carry one body to another."""

    bodies: np.ndarray  # (block, 2) slots of the body that is reached and of the other
    flow: np.ndarray  # (block, 4) a_xx, a_xv, a_vx, a_vv
    noise: np.ndarray  # (block, 4) by the first and the second normal of the other: x, x, v, v
    push: np.ndarray  # (block, 4) x and v by a unit force on the other, by one that grows from -1 to 1 in a step


class Series(NamedTuple):
    """Sums of cosines on some bodies, sampled in time."""

    bodies: np.ndarray  # (row,) slots
    samples: np.ndarray  # (lane, row or 2 row, time): the force, or the response x and v
    near: np.ndarray  # (NEAR + 1, row or 2 row, lane): those of the next times, lanes side by side


class Forced(NamedTuple):
    """Given forces on some bodies during one call."""

    bodies: np.ndarray  # (row,) slots
    force: np.ndarray  # (time, row): samples, or with `takes_response` mean and slope of each step in turn


class State(NamedTuple):
    """State and work space of a block; the last body is the wall."""

    x: np.ndarray  # [body, lane]
    v: np.ndarray  # [body, lane]
    reading: np.ndarray  # displacement at which contacts and densities are read
    velocity: np.ndarray  # velocity at the time of `reading`
    rest: np.ndarray  # zeros [body, lane]
    total: np.ndarray  # force [body, lane]
    indentation: np.ndarray  # [contact, lane]
    contact_force: np.ndarray  # [contact, lane]
    external: np.ndarray  # given forces and noise [body, lane]
    slope_x: np.ndarray  # weighted sum of slopes [body, lane]
    slope_v: np.ndarray
    middle: np.ndarray  # velocity in the middle of the last kick, where sums need it
    normals: np.ndarray  # (4, row, lane) of single precision


class History(NamedTuple):
    """The last steps, which go into the sums together; see `impactlab.kernels.sums`."""

    x: np.ndarray  # [slot, body, lane]
    v: np.ndarray  # velocity at the time of x
    force: np.ndarray  # force of the kick there
    indentation: np.ndarray  # [slot, contact, lane]
    contact_force: np.ndarray


class Sums(NamedTuple):
    """Where a block adds up its statistics; see `impactlab.kernels.sums`."""

    bodies: np.ndarray  # (phase, row, body, lane)
    contacts: np.ndarray  # (4, contact, lane)
    ends: np.ndarray  # (contact, 2)
    indices: np.ndarray  # `impactlab.model.Model.indices`
    window: np.ndarray  # (contact,) half width for the rate (m)
    half_kick: np.ndarray  # (0 to 2, body) of a unit force: see `Plan`
    closing: np.ndarray  # [step, contact, lane] closing velocities in four steps
    push: np.ndarray  # [body, lane] half of what a kick gives to velocities
    kick: np.ndarray  # [contact, lane] the same of closing velocities
    products: np.ndarray  # (9, pair, lane)
    pairs: np.ndarray  # (pair, 2) slots of bodies
    before: np.ndarray  # [2, contact, lane] indentation and rate a step ago, nothing where closings are not counted
    jitter: np.ndarray  # (contact,) what white noise changes a closing velocity by in a step, root mean square
    step: float


def _array(dimensions: int, kind: Any = f8) -> Any:
    """Type of an array, of which the last axis is contiguous."""
    return types.Array(kind, dimensions, "C")


def _tuple(kind: Any, *items: Any) -> Any:
    """Type of a named tuple."""
    constructor: Any = types.NamedTuple if len(set(items)) > 1 else types.NamedUniTuple
    return constructor(items, kind) if len(set(items)) > 1 else constructor(items[0], len(items), kind)


def _signature(forces: Any, lane: int) -> Any:
    """Signature of a loop over blocks that have an axis of lanes (1) or not (0)."""
    numbers, table, cube = _array(1), _array(2), _array(3)
    slots, pairs = _array(1, i8), _array(2, i8)
    block, blocks = _array(1 + lane), _array(2 + lane)
    return void(
        forces,
        numbers,
        slots,
        cube,
        _tuple(Cross, pairs, table, table, table),
        _tuple(Noise, slots, pairs, i8, cube, _array(2, u8), _array(1, u4), table, b1),
        _tuple(Series, slots, cube, blocks),
        _tuple(Forced, slots, table),
        _tuple(State, *[block] * 12, _array(2 + lane, f4)),
        _tuple(History, *[blocks] * 5),
        _tuple(
            Sums,
            _array(3 + lane),
            blocks,
            pairs,
            slots,
            numbers,
            table,
            blocks,
            block,
            block,
            blocks,
            pairs,
            blocks,
            numbers,
            f8,
        ),
        blocks,
        f8,
        i8,
        b1,
        i8,
        i8,
        i8,
        i8,
    )


ADVANCE = _signature(FORCES, 1)
"""Signature of an integrator's loop: (forces, parameters, indices, coefficients, cross, noise, series,
forced, state, history, sums, snapshots, step, passes, summing, first, count, every, phase).

It makes `count` steps, of which `first` is the index of the first. `passes` is how often the forces
of a kick are evaluated with the velocities that they give, 0 where they depend on none. If
`summing`, every step adds to the sums. After every `every`-th step, if that is not 0, it writes a
snapshot ``snapshots[k, quantity, lane]``: displacement of all bodies, velocity of all bodies, force
of all contacts; `phase` steps have gone since the last one when it begins."""


_ADVANCE_OF_ONE = _signature(FORCES_OF_ONE, 0)


def compiled(function: Callable[..., None], single: bool) -> Callable[..., None]:
    """Return the loop of an integrator for blocks, or from the same text for blocks of one lane."""
    return loop(_ADVANCE_OF_ONE, _single(function)) if single else loop(ADVANCE, function)


_single = cache(without_lanes)


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


class Integrator(Component):
    """A method that carries a block of realizations through time.

    A subclass is one module: a compiled loop with the signature `ADVANCE` and a class
    that says what the loop can do and how large its step may be.
    """

    order: ClassVar[float | None] = None
    """Order of convergence of paths under smooth forces."""

    handles: ClassVar[tuple[str, ...]] = ()
    """Kinds of excitation: "intensity" (white noise), "lines", "force"."""

    kicks: ClassVar[bool] = False
    """Whether forces act as kicks, which the processed statistics and the balances need."""

    phases: ClassVar[int] = 1
    """Steps after which the method repeats itself."""

    samples_per_step: ClassVar[int] = 1
    """Samples of a series or a given force that the loop takes in a step."""

    reach: ClassVar[int] = 0
    """Contacts that a force reaches in a step, one more if it depends on velocities; 0 if nothing runs in tiles."""

    takes_response: ClassVar[bool] = False
    """Whether a series is the linear response (x, v) instead of the force, and given forces are integrated."""

    required: ClassVar[tuple[str, ...]] = ("order",)

    @staticmethod
    def loop(single: bool = False) -> Callable[..., None]:
        """Return the compiled loop, for blocks of one lane if `single`; see `compiled`."""
        raise NotImplementedError

    def arrange(self, model: Model, tangent: np.ndarray, residual: np.ndarray | float = 0.0) -> Model:
        """Return the model with those couplings in the linear motion that the method wants there.

        Parameters are those of `largest_step`; all other functions take what this one returns.
        """
        return model

    def cross(self, model: Model, step: float) -> Cross:
        """Return the linear motion between bodies; nothing where they move by themselves."""
        return Cross(np.zeros((0, 2), np.int64), *[np.zeros((0, 4))] * 3)

    def coefficients(self, model: Model, step: float) -> np.ndarray:
        """Return the numbers per body that the loop takes, (phase, body, column)."""
        raise NotImplementedError

    def noise(self, model: Model, step: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the rows of white noise: slots of their bodies, (row,), and `Noise.amplitude`."""
        raise NotImplementedError

    def flows(self, model: Model, step: float) -> Flows | None:
        """Return what is between kicks, None for a method that does not kick."""
        return None

    def largest_step(self, model: Model, tangent: np.ndarray, residual: np.ndarray | float = 0.0) -> float:
        """Return the largest step at which the method is stable (s).

        Parameters
        ----------
        model : Model
            The network.
        tangent : (link,) ndarray
            Stiffness of the contacts when they are closed, then of the couplings (N m-1).
        residual : (body,) ndarray
            Stiffness of the residual forces (N m-1).
        """
        raise NotImplementedError

    def recommended_step(self, model: Model, tangent: np.ndarray, residual: np.ndarray | float = 0.0) -> float:
        """Return the step that is chosen when none is given (s)."""
        raise NotImplementedError

    def check(self, model: Model) -> None:
        """Refuse a network whose excitations the method does not handle.

        Raises
        ------
        InvalidInput
            Names the body, what was given and what would work.
        """
        for name, excitation in model.network.excitations.items():
            if excitation.kind not in self.handles:
                raise InvalidInput(
                    f"{type(self).__name__} does not handle the excitation of {name!r} "
                    f"({type(excitation).__name__}, defined by {excitation.kind}); "
                    f"it handles {', '.join(self.handles)}."
                )


def frequencies(model: Model, tangent: np.ndarray) -> np.ndarray:
    """Natural frequencies with springs in the place of contacts and couplings, in increasing order (rad s-1).

    The largest is bounded from above (Gershgorin) where there are many bodies.
    """
    if len(model.bodies) <= 300:
        matrix = np.diag(model.stiffness) + model.of_links(tangent)
        scale = 1.0 / np.sqrt(model.mass)
        return np.sqrt(np.maximum(np.linalg.eigvalsh(scale[:, None] * matrix * scale), 0.0))
    inverse = np.append(1.0 / model.mass, 0.0)  # a wall does not move
    first, second = model.links.T
    bound = np.append(model.stiffness, 0.0) * inverse
    between = tangent * np.sqrt(inverse[first] * inverse[second])
    for side in (first, second):
        np.add.at(bound, side, tangent * inverse[side] + between)
    return np.asarray(np.sqrt(np.sort(bound[:-1])))


def coupling_rate(model: Model) -> float:
    """Largest rate at which the dampers of couplings that kick, alone, would slow the bodies down (s-1)."""
    dampers = np.concatenate([np.zeros(len(model.ends)), model.coupling[1] * ~model.flowing])
    return float(frequencies(replace(model, stiffness=np.zeros_like(model.stiffness)), dampers)[-1] ** 2)


def stable_step(polynomial: Any, model: Model, tangent: np.ndarray) -> float:
    """Largest step of an explicit one-step method with this stability polynomial (s).

    Every natural frequency with closed contacts is taken with the least relative damping
    of any body, and with the largest; 0 if the method is unstable at any step.
    """
    top = float(frequencies(model, tangent)[-1])
    rates = model.damping / model.mass
    poles = [np.roots([1.0, float(rate), top**2]) for rate in {rates.min(), rates.max() + coupling_rate(model)}]
    poles += [
        np.roots([1.0, rate, k / m])
        for rate, k, m in {*zip(rates.tolist(), model.stiffness.tolist(), model.mass.tolist(), strict=True)}
    ]
    values = np.concatenate(poles)
    values = values[np.abs(values) > 1e-12 * max(np.abs(values).max(), 1e-300)]
    if not values.size:
        return float("inf")

    high = 4.0 / np.abs(values).max()
    trials = high * 0.5 ** np.arange(0.0, 20.0, 0.01)  # below, growth would hide in the tolerance
    for steps in np.array_split(trials, np.clip(values.size, 100, trials.size)):
        growth = np.abs(np.polyval(polynomial, steps[:, None] * values))
        stable = steps[(growth <= 1.0 + 1e-12).all(axis=1)]
        if stable.size:
            return float(stable[0])
    return 0.0


class ExplicitIntegrator(Integrator):
    """A one-step method for the right-hand side; white noise is held constant over a step."""

    handles: ClassVar[tuple[str, ...]] = ("intensity", "lines", "force")

    stability_polynomial: ClassVar[tuple[float, ...] | None] = None
    """Coefficients of the amplification factor over ``step × eigenvalue``, highest power first."""

    required: ClassVar[tuple[str, ...]] = ("order", "stability_polynomial")

    fraction: ClassVar[float] = 1.0
    """Recommended step as a part of the largest."""

    def coefficients(self, model: Model, step: float) -> np.ndarray:
        return np.column_stack([model.mass, model.damping, model.stiffness])[None]

    def noise(self, model: Model, step: float) -> tuple[np.ndarray, np.ndarray]:
        rows = np.array(model.white, dtype=np.int64)
        force = np.sqrt(2.0 * np.pi * model.reference_intensities()[rows] / step)
        return rows, np.stack([np.zeros_like(force), force], axis=1)[None]

    def largest_step(self, model: Model, tangent: np.ndarray, residual: np.ndarray | float = 0.0) -> float:
        return min(self._stable(model, tangent, residual), _sampled_step(model))

    def recommended_step(self, model: Model, tangent: np.ndarray, residual: np.ndarray | float = 0.0) -> float:
        return min(self.fraction * self._stable(model, tangent, residual), 0.5 * _sampled_step(model))

    def _stable(self, model: Model, tangent: np.ndarray, residual: np.ndarray | float) -> float:
        return stable_step(self.stability_polynomial, replace(model, stiffness=model.stiffness + residual), tangent)


def _sampled_step(model: Model) -> float:
    """Largest step at which no line of a series is taken for one near the natural frequency of its body (s).

    A line of frequency 1/h looks constant to a method that samples it once in a step, and to
    Runge-Kutta methods too, whose weights of the samples in between do not cancel it.
    """
    natural = model.natural_frequencies
    highest = max((float(item.frequencies.max() + natural[item.body]) for item in lines_of(model)), default=0.0)
    return 2.0 * np.pi / highest if highest > 0.0 else float("inf")
