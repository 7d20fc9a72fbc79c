"""Exact flow: the linear stochastic motion between kicks by all other forces."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from impactlab.assembly.mechanism import interrupted, largest_step
from impactlab.assembly.model import Model
from impactlab.assembly.remembered import kept, remembered
from impactlab.compiling.jit import inlined
from impactlab.components.excitation import KINDS
from impactlab.components.fields import parameter
from impactlab.components.literature import article
from impactlab.integrators.arguments import Cross, Flows, Group, NoiseRows, slot_of
from impactlab.integrators.base import Integrator, coupling_rate, frequencies
from impactlab.integrators.driver import sample_of, sampled
from impactlab.integrators.kicks import KICK, LAG, SPLIT_FRICTION, kick, kick_lag, push_by_given
from impactlab.integrators.located import AFTER_FLOW, AFTER_KICK, AFTER_STEP, happen, open_call
from impactlab.integrators.noise_rows import rows_of_source, with_own_noise
from impactlab.kernels.flow import flow, flow_between, push_between
from impactlab.kernels.kick import add_response, copy, smooth_velocity
from impactlab.kernels.sums import SLOTS
from impactlab.linear.laws import coupled_systems, flowing_systems
from impactlab.linear.systems import LinearSystem
from impactlab.linear.transitions import (
    GAUSS,
    distinct_rows,
    free_flows,
    noise_columns,
    noise_root,
    response_to_force,
    split_transition,
    system_response,
    system_transition,
    transitions,
)

STIFF, DAMPED, MOST_COUPLED = 0.01, 0.02, 6
"""A coupling kicks up to ``h² k (1/m₁ + 1/m₂)`` and ``h c (1/m₁ + 1/m₂)``, and in groups of more bodies."""

MOST_OF_STRUCTURE = 32
"""Bodies of a group that has coordinates of a structure: its highest mode would make steps far too short."""


OVERDAMPED = 100.0
"""Rate of friction, over the natural frequency, from which a body follows forces as if it had no mass (ζ of 50)."""

LEAST_SPLIT = 0.01
"""Largest friction over a step, ``c h/m``, that may act at one moment of it where an accuracy is to be reached."""


@inlined
def _flow_of_step(tables, driven, state, history, steps, index):  # type: ignore[no-untyped-def]
    """Make the flow of a step; return its slot of the history, with the displacements, and the force of the last kick.

    Velocities of the state are those after the flow, and `Integrator.step` tells of the arguments.
    """
    coefficients, cross = tables.coefficients, tables.cross
    noise, series, forced = driven.noise, driven.series, driven.forced
    now = steps.first + index
    past, slot = slot_of(history, (now - 1) % SLOTS), slot_of(history, now % SLOTS)
    v, y, push, before = state.v, state.reading, state.work[0], state.work[1]
    x, last_force = (past.x, past.force) if index else (state.x, state.total)
    if series.bodies.shape[0]:
        copy(x, y)
        x = y
        add_response(series, sample_of(steps, now), -1.0, x, v)
    if cross.bodies.shape[0]:
        copy(v, before)
    sample, normals = index if noise.scale.shape[0] > 1 else 0, noise.normals[now % 4]
    flow(coefficients, now % coefficients.shape[0], noise, sample, normals, x, v, slot.x)
    if cross.bodies.shape[0]:
        flow_between(cross, normals, x, before, slot.x, v)
    if forced.bodies.shape[0]:
        for part in range(2):  # mean and slope
            push_by_given(coefficients, forced, index, part, push, slot.x, v)
            push_between(cross, part, push, slot.x, v)
    if series.bodies.shape[0]:
        add_response(series, sample_of(steps, now) + 1, 1.0, slot.x, v)
    return slot, last_force


@inlined
def _end_step(tables, state, slot, last_force, steps, index):  # type: ignore[no-untyped-def]
    """Write what is read after a step, and what the next call begins with."""
    last = index == steps.number - 1
    if last or sampled(steps, index):
        smooth_velocity(tables.coefficients, KICK, LAG, slot.v, slot.force, last_force, state.velocity)
        copy(slot.contact_force, state.contact_force)
    if last:
        copy(slot.x, state.x)
        copy(slot.force, state.total)


class ExactFlow(Integrator):
    """Exact flow with a shifted kick; the default.

    One step is the linear motion of every body under its white noise, then a kick by all
    remaining forces R. The kick and every statistic of contacts and positions are read
    at ``y = x + (h²/12) R(x)/m``: for conservative forces this is the force-gradient
    correction of a fourth-order splitting to its order, without the derivative of any
    force (Chin, Phys. Lett. A 226, 1997, 344). Velocities of trajectories take the change of the
    force since the kick before for its derivative, so that paths are of third order under forces
    that do not depend on velocities. A force that does is solved for the one at which it acts:
    that in the middle of the kick where it is a weak damper, nearly that after it where it is a
    strong one. Without contacts
    there is no error at any step. Sums of cosines and filtered noises enter through their exact
    linear response, given forces through the one to what is linear in the time of a step, which
    has their integral. States of laws are read at y and at the velocity in the middle of the kick, for
    contacts whose force depends on the velocity without the part due to this force.

    The linear motion of a body with contacts is the exact undamped one, with the friction
    and noise of the step at one of the two nodes of Gauss's rule, in turn. That takes one
    normal instead of two and keeps the linear law just as well. Between kicks the mean
    kinetic energy varies like a parabola around its true value, which it has at these
    nodes: friction and noise that act there (and not, as usual, in the middle) feel the
    right temperature. Bodies without contacts, and those with friction over a step of more
    than 1/8, have the exact Gaussian transition. So have groups of up to 6 bodies on linear
    couplings if one coupling is stiff or strongly damped; other couplings kick. Bodies of which impacts, or slip and
    stick, are located within the flow of a step have it, too, and their couplings kick.

    Parameters
    ----------
    jumps : bool
        Whether realizations in which nothing can touch for a while take that time in one exact
        transition, where this saves work (default). It changes no path; statistics of
        displacements and velocities are sampled once per interval then, contacts at every step.
    measured : bool
        Whether the bias of the step is measured on the scene before the run, where the automatic step is not
        certified or a larger one is given (default); see `impactlab.step_control.measured`. Else a run takes the
        step as it is.

    Notes
    -----
    A method that derives from this one makes every step, and the bias of its step is not measured. One with a `step`
    of its own locates no events, neither impacts nor slip and stick, unless it says so by `collides`.

    Examples
    --------
    >>> method = il.ExactFlow(jumps=False)
    >>> result = il.simulate(network, 20.0, realizations=64, integrator=method, rng=1)
    >>> result.attrs["integrator"]
    'ExactFlow'
    """

    citation = article(
        "Takahashi, M. and Imada, M.",
        "Monte Carlo calculation of quantum systems",
        "J. Phys. Soc. Jpn.", 53, 1984, "3765",
    )  # fmt: skip

    jumps: bool = parameter(True)
    measured: bool = parameter(True)

    order: ClassVar[float] = 3.0
    handles: ClassVar[tuple[str, ...]] = KINDS
    kicks: ClassVar[bool] = True
    phases: ClassVar[int] = 2
    reach: ClassVar[int] = 2
    blocks: ClassVar[int] = 2
    takes_response: ClassVar[bool] = True
    collides: ClassVar[bool] = True

    @property
    def derived(self) -> bool:
        """Whether this is a method of a user, known by its functions only."""
        return type(self).__module__ != __name__

    @property
    def crosses(self) -> bool:
        """Whether intervals may be crossed in one transition, which is that of many steps of the methods here."""
        return self.jumps and not self.derived

    @staticmethod
    def step(forces, tables, driven, state, history, steps, index):  # type: ignore[no-untyped-def]
        now, events = steps.first + index, tables.events
        if events.shape[0]:
            if index == 0:
                open_call(tables, state, history, steps)
            copy(state.v, tables.before)
        slot, last_force = _flow_of_step(tables, driven, state, history, steps, index)
        happen(AFTER_FLOW, events, now)
        kick(forces, tables, steps.passes, state.still, state.v, state.reading, slot)
        happen(AFTER_KICK, events, now)
        _end_step(tables, state, slot, last_force, steps, index)
        if steps.every:
            happen(AFTER_STEP, events, now)

    @staticmethod
    def accepted(state, middle, steps):  # type: ignore[no-untyped-def]
        return state.reading, middle, 0.5 * steps.step

    def arrange(self, model: Model, tangent: np.ndarray, residual: np.ndarray | float = 0.0) -> Model:
        linear, names = model.couplings.linear.any(axis=0), np.array(model.couplings.names)
        if not linear.any():
            return model
        moved = model.coupled.any(~model.bodies.free)
        of_structures = model.coupled.chosen(model.couplings.matrix_terms).numbers() > 0
        parts = [
            linear & model.coupled.any(np.isin(np.arange(model.wall), slots))
            for slots, _ in coupled_systems(model)
            if len(slots) <= (MOST_OF_STRUCTURE if of_structures[slots].any() else MOST_COUPLED)
            and not model.noise.varying
            and not interrupted(model)[slots].any()
            and not (moved & model.coupled.any(np.isin(np.arange(model.wall), slots))).any()
        ]

        def flowing(chosen: list[np.ndarray]) -> Model:
            return Model.of(model.network, set(names[np.any(chosen, axis=0)].tolist())) if chosen else model

        step = self.recommended_step(flowing(parts), tangent, residual)
        inverse = model.coupled.squares(1.0 / model.mass)
        with np.errstate(invalid="ignore"):  # an infinite step
            stiffness, damping = model.couplings.linear
            stiff = (step**2 * stiffness * inverse > STIFF) | (step * damping * inverse > DAMPED)
        return flowing([part for part in parts if (part & stiff).any()])

    def cross(self, model: Model, step: float) -> Cross:
        groups = self.flows(with_own_noise(model), step).groups
        if not groups:
            return super().cross(model, step)
        blocks = []
        for group in groups:
            body, other = np.nonzero(~np.eye(len(group.slots), dtype=bool))
            flow, noise = (
                _blocks(part)[body, other].reshape(-1, 4) for part in (group.transition, noise_root(group.covariance))
            )
            push = np.moveaxis(_response(group.system, step), 0, 2)[body, other]  # x, v by each of both forces
            blocks.append((np.stack([group.slots[body], group.slots[other]], axis=1), flow, noise, push))
        bodies, flow, noise, push = (np.ascontiguousarray(np.concatenate(part)) for part in zip(*blocks, strict=True))
        rows = np.full((2, len(model.mass)), -1)
        noise_rows = self.noise(model, step)
        for row, (body, name) in enumerate(zip(noise_rows.bodies, noise_rows.streams, strict=True)):
            if name == model.bodies.names[body]:
                rows[int(rows[0, body] >= 0), body] = row
        return Cross(bodies, flow, noise, push, rows)

    def coefficients(self, model: Model, step: float) -> np.ndarray:
        response = response_to_force(model.mass, model.damping, model.stiffness, step)
        if systems := flowing_systems(model):
            response = response.copy()
            for slots, system in systems:
                response[slots] = np.diagonal(_response(system, step), axis1=1, axis2=2).T
        known = _coefficients(self.flows(model, step).transition, response, model.mass, model.damping, step)
        return known.copy()  # methods that derive from this one may change them

    def noise(self, model: Model, step: float) -> NoiseRows:
        own, split = with_own_noise(model), self._split(model, step)
        flows = self.flows(own, step)
        columns = np.stack([noise_columns(q) for q in flows.covariance])  # (phase, 2, body, 2)
        white = own.sources["intensity"].bodies
        noisy = set(white)
        for group in flows.groups:  # two normals for each body, as soon as there is noise on one
            columns[:, :, group.slots] = _own(noise_root(group.covariance)).transpose(2, 0, 1)
            noisy |= set(group.slots.tolist()) if group.system.intensity.any() else set()
        first = np.array(sorted(noisy), dtype=np.int64)
        second = first[~split[first]]
        slots, which = np.append(first, second), np.repeat((0, 1), (len(first), len(second)))
        number = np.full(len(model.mass), -1)
        number[[*white]] = np.arange(len(white))
        names = tuple(map(model.bodies.names.__getitem__, slots.tolist()))
        rows = NoiseRows(slots, names, which, number[slots], columns[:, which, slots])
        others = model.sources["intensity"].beyond_own
        if not others:
            return rows
        places = GAUSS[: len(columns)]
        return rows.with_others([rows_of_source(model, split, step, source, places) for source in others]).ordered()

    def flows(self, model: Model, step: float) -> Flows:
        return _flows(model, self, step)

    def _split(self, model: Model, step: float) -> np.ndarray:
        """Whether friction and noise of each body act at one moment of the step, (body,) of bool."""
        alone = np.zeros(len(model.mass), dtype=bool)
        alone[list(model.sources["intensity"].bodies)] = True
        for slots, _ in flowing_systems(model):
            alone[slots] = False
        little = model.damping * step <= SPLIT_FRICTION * model.mass
        split: np.ndarray = alone & model.kicks.nonlinear & ~interrupted(model) & little
        return split

    def largest_step(self, model: Model, tangent: np.ndarray, residual: np.ndarray | float = 0.0) -> float:
        return min(self._step(model, tangent, residual, 1.6, 3.0, 1.0), largest_step(model))

    def recommended_step(self, model: Model, tangent: np.ndarray, residual: np.ndarray | float = 0.0) -> float:
        if not model.kicks.nonlinear.any():  # every step is exact: a few samples per period
            frequency, rate, _ = _motion(model)
            return min(_over(1.0, frequency.max()), _over(1.0, rate.max()))
        return self._step(model, tangent, residual, 0.5, 1.0, 0.05)

    def _step(
        self,
        model: Model,
        tangent: np.ndarray,
        residual: np.ndarray | float,
        of_kicks: float,
        of_flow: float,
        of_dampers: float,
    ) -> float:
        """Limit the step by the frequency of the forces that kick and of the bodies they act on, and by dampers."""
        springs = np.zeros_like(model.stiffness) + residual
        kicks, flow, dampers = _rates(model, tangent.tobytes(), springs.tobytes())
        return min(_over(of_kicks, kicks), _over(of_flow, flow), _over(of_dampers, dampers))


@remembered
def _coefficients(
    a: np.ndarray, response: np.ndarray, mass: np.ndarray, damping: np.ndarray, step: float
) -> np.ndarray:
    """Return the numbers of the method from its flows and responses to forces, (phase, body, column)."""
    of_mass = np.array([[step**2 / 12.0], [step], [0.5 * step]]) / mass
    lag = step / mass * kick_lag(damping / mass * step)
    constant = np.column_stack([*of_mass, np.full_like(mass, 0.5 * step), lag, *response.T])
    return np.concatenate([a.reshape(*a.shape[:2], 4), np.broadcast_to(constant, (len(a), *constant.shape))], 2)


@kept
def _rates(model: Model, tangent: bytes, residual: bytes) -> tuple[float, float, float]:
    """Return the frequency of the forces that kick, that of the bodies they act on, and the rate of dampers (s-1)."""
    frequency, _, kicked = _motion(model)
    if not kicked.any():
        return 0.0, 0.0, 0.0
    of_kicks = frequencies(model, np.frombuffer(tangent) * model.kicks.links, np.frombuffer(residual))
    return float(of_kicks[-1]), float(frequency[kicked].max()), coupling_rate(model)


@kept
def _flows(model: Model, method: ExactFlow, step: float) -> Flows:
    linear = model.mass, model.damping, model.stiffness, model.noise.reference_intensity
    flows = _flows_alone(*linear, method._split(model, step), step)
    groups = tuple(_group(slots, system, step) for slots, system in flowing_systems(model))
    if groups:
        flows = tuple(item.copy() for item in flows)
        for group in groups:
            for alone, joint in zip(flows, group[2:], strict=True):
                alone[:, group.slots] = _own(joint)
    a, q, middle_a, middle_q = flows
    return Flows(a, q, middle_a, middle_q, groups)


@remembered
def _flows_alone(
    mass: np.ndarray, damping: np.ndarray, stiffness: np.ndarray, intensity: np.ndarray, split: np.ndarray, step: float
) -> tuple[np.ndarray, ...]:
    """Return flows and covariances of bodies alone over a step and half of it, of both phases, (phase, body, 2, 2)."""
    different, which = distinct_rows(np.stack([mass, damping, stiffness, intensity, split], axis=1))
    if len(different) < len(mass):
        m, c, k, s, together = different.T
        return tuple(part[:, which] for part in _flows_alone(m, c, k, s, together > 0.0, step))
    linear = mass, damping, stiffness, intensity
    exact = [part for pair in transitions(*linear, [step, 0.5 * step]) for part in pair]
    phases = [exact, exact]
    if split.any():
        ends = [(place, until) for place in GAUSS for until in (1.0, 0.5)]
        free, alone = free_flows(mass, stiffness, step, ends), split[:, None, None]
        whole, half, other_whole, other_half = (split_transition(*linear, step, *end, free) for end in ends)
        parts = (*whole, *half), (*other_whole, *other_half)
        phases = [[np.where(alone, *pair) for pair in zip(part, exact, strict=True)] for part in parts]
    return tuple(np.stack(part) for part in zip(*phases, strict=True))


@kept
def _motion(model: Model) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return frequency and rate of friction of each body's linear motion, and whether kicks act on it, (body,) each.

    For a body in a group they are the largest of the group. Bodies that are not kicked, and so overdamped that they
    follow the others, relax: what counts is that rate, and the frequency of motions that oscillate.
    """
    frequency, rate = np.sqrt(model.stiffness / model.mass), model.damping / model.mass
    kicked = model.kicks.nonlinear.copy()
    following = (rate > OVERDAMPED * frequency) & (frequency > 0.0) & ~kicked
    frequency[following] = rate[following] = frequency[following] ** 2 / rate[following]
    for slots, system in flowing_systems(model):
        frequency[slots], rate[slots] = system.scales
        friction, square = (np.diag(matrix) / system.mass for matrix in (system.damping, system.stiffness))
        following = friction > OVERDAMPED * np.sqrt(square)
        if following.any() and not (following & kicked[slots]).any():
            frequency[slots] = system.oscillation
            rate[slots] = np.where(following, square / friction, friction).max()
        kicked[slots] = kicked[slots].any()
    return frequency, rate, kicked


def _group(slots: np.ndarray, system: LinearSystem, step: float) -> Group:
    parts = system.mass, system.damping, system.stiffness, system.intensity
    rate = sum(system.scales)
    return Group(slots, system, *system_transition(*parts, step, rate), *system_transition(*parts, 0.5 * step, rate))


def _response(system: LinearSystem, step: float) -> np.ndarray:
    """Displacements and velocities of a group after a step from rest, by the body that is pushed, (4, n, n)."""
    response = system_response(system.mass, system.damping, system.stiffness, step, sum(system.scales))
    return response.reshape(4, len(system.mass), -1)


def _blocks(joint: np.ndarray) -> np.ndarray:
    """Turn a matrix of all x, then all v, into (body, other, 2, 2)."""
    count = len(joint) // 2
    return joint.reshape(2, count, 2, count).transpose(1, 3, 0, 2)


def _own(joint: np.ndarray) -> np.ndarray:
    """Return the blocks of each body with itself, (body, 2, 2)."""
    index = np.arange(len(joint) // 2)
    return _blocks(joint)[index, index]


def _over(number: float, frequency: float) -> float:
    return number / float(frequency) if frequency > 0.0 else float("inf")


class WholeFlow(ExactFlow):
    """The exact flow with the exact Gaussian transition for all bodies, so that steps add up to that of an interval.

    Chosen automatically where jumps save work.
    """

    phases: ClassVar[int] = 1

    def flows(self, model: Model, step: float) -> Flows:
        both = super().flows(model, step)
        a, q, middle_a, middle_q = (part[:1] for part in both[:-1])
        return Flows(a, q, middle_a, middle_q, both.groups)

    def _split(self, model: Model, step: float) -> np.ndarray:
        return np.zeros(len(model.mass), dtype=bool)


class FineFlow(ExactFlow):
    """The exact flow with the exact Gaussian transition for all bodies but those with very little friction in a step.

    The remaining error of friction that acts at one moment of a step is at most 10⁻⁵ of a mean square. Chosen
    automatically for a run with a tolerance.
    """

    def _split(self, model: Model, step: float) -> np.ndarray:
        return np.asarray(super()._split(model, step) & (model.damping * step <= LEAST_SPLIT * model.mass))
