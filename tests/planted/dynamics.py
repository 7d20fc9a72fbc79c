"""Bugs in the motion: noise, flow, kicks, contacts, start."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
from scenes import changed

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.integrators import exact_flow, intervals
from impactlab.integrators.exact_flow import ExactFlow
from impactlab.kernels.flow import COEFFICIENTS
from impactlab.linear.transitions import GAUSS, split_transition
from impactlab.plan import noise as noise_plan
from impactlab.plan.realizations import Realizations
from impactlab.simulation.block import Block
from impactlab.simulation.first_states import FirstStates
from impactlab.step_control.rules import expected
from planted.plant import Bug, Plant, both, called, coefficients, in_plan, instead, planned, returned, text
from planted.scenes import (
    ALONE,
    COARSE,
    EARLY,
    GROUP,
    HALVED,
    HELD,
    INTERVALS,
    JUMPS,
    LINEAR,
    LONG,
    PAIR,
    PRESSED,
    START,
    TREE,
)

SHIFT, KICK, HALF_KICK = range(COEFFICIENTS, COEFFICIENTS + 3)


def noise(factor: Any) -> Plant:
    """Multiply the amplitude of the noise, by a number or a function of the plan."""
    return in_plan(noise__amplitude=lambda plan: plan.noise.amplitude * (factor(plan) if callable(factor) else factor))


def of_rows(change: Any) -> Plant:
    """Change the amplitudes of rows of noise, (phase, 2, row), in place."""

    def of_plan(plan: Any) -> Any:
        amplitude = plan.noise.amplitude.copy()
        change(plan, amplitude)
        return changed(plan, noise__amplitude=amplitude)

    return planned(of_plan)


def independent_rows(plan: Any, amplitude: np.ndarray) -> None:
    """Take displacement and velocity as independent: the first row of a body makes x alone, the second v."""
    for second in range(len(np.unique(plan.noise.rows)), len(plan.noise.rows)):
        first = int(np.argmax(plan.noise.rows == plan.noise.rows[second]))
        amplitude[:, 1, second] = np.hypot(amplitude[:, 1, first], amplitude[:, 1, second])
        amplitude[:, 1, first] = 0.0


def velocity_rows(plan: Any, amplitude: np.ndarray) -> None:
    amplitude[:, 0] = 0.0


def flow(mass: float = 1.0, damping: float = 1.0, stiffness: float = 1.0) -> Plant:
    """Multiply what the flow without its noise is made from."""

    def changed(plan: Any, table: np.ndarray) -> None:
        linear = [item * factor for item, factor in zip(plan.system.linear, (mass, damping, stiffness), strict=True)]
        for phase, place in enumerate(GAUSS):
            split, _ = split_transition(*linear, plan.noise.intensity, plan.clock.step, place)
            table[phase, :SHIFT] = split.reshape(-1, 4).T

    return coefficients(changed)


def cycle_of_noise(monkeypatch: Any) -> None:
    """The count of steps begins again with every call."""
    call = Block.call

    def again(self: Block, *arguments: Any) -> None:
        now, self.now = self.now, 0
        try:
            call(self, *arguments)
        finally:
            self.now = now

    monkeypatch.setattr(Block, "call", again)
    in_plan(realizations__steps_per_call=lambda plan: 8)(monkeypatch)


def own_realizations(change: Any) -> Plant:
    right = Realizations.of
    return instead(Realizations, "of", lambda part, block: change(part, right(part, block)).astype(np.uint32))


def by_place(seed: Any, names: list[str], numbers: list[int]) -> tuple[Any, list[str], list[int]]:
    places = {name: str(place) for place, name in enumerate(dict.fromkeys(names))}
    return seed, [places[name] for name in names], numbers


def one_sided(plan: Any) -> np.ndarray:
    indices = plan.forces.indices.copy()
    last = indices[2] - 1
    assert indices[last] == 1  # the sign of the last contact of the last body
    indices[last] = 0
    return indices


def swapped(plan: Any) -> np.ndarray:
    values = plan.forces.parameters.copy()
    stiff, soft = values == 300.0, values == 200.0
    assert stiff.sum() == soft.sum() == 1
    values[stiff], values[soft] = 200.0, 300.0
    return values


def other_side(monkeypatch: Any) -> None:
    make = Model.of

    def turned(network: il.Network, *arguments: Any) -> Model:
        walls = {name: item for name, item in network.contacts.items() if item.first is il.WALL}
        return make(
            network.replace(
                contacts={name: item.replace(first=item.second, second=il.WALL) for name, item in walls.items()}
            ),
            *arguments,
        )

    monkeypatch.setattr(Model, "of", turned)


def stale(code: str) -> str:
    """Move the sum of the forces of contacts before their evaluation."""
    line = "    gather(indices, contact_force, total)\n"
    first = "    # HertzContact: force of"
    assert line in code
    return code.replace(line, "").replace(first, line + first)


def read_early(code: str) -> str:
    """Keep gaps, and the forces there, from the first evaluation of a kick, that at rest."""
    gap = "gaps[member, lane] = gap\n"
    gather = "    gather(indices, contact_force, total)\n"
    assert gap in code
    return code.replace(gap, f"if v[first, lane] == 0.0 and v[second, lane] == 0.0:\n{20 * ' '}{gap}").replace(
        gather,
        f"{gather}    for lane in range(total.shape[1]):\n"
        "        contact_force[0, lane] = HertzContact_force(max(indentation[0, lane], 0.0), parameters[1])\n",
    )


def column(index: int, factor: Any) -> Plant:
    """Multiply a column of the numbers of the method."""

    def changed(plan: Any, table: np.ndarray) -> None:
        table[:, index] *= factor(plan) if callable(factor) else factor

    return coefficients(changed)


def cross(**factors: Any) -> Plant:
    return in_plan(
        method__cross=lambda plan: plan.method.cross._replace(
            **{name: getattr(plan.method.cross, name) * factor(plan) for name, factor in factors.items()}
        )
    )


def first_of_pair(plan: Any) -> np.ndarray:
    body, other = plan.method.cross.bodies.T
    assert len(body)
    return np.where(body < other, 0.0, 1.0)[:, None]


def bound(sigmas: float) -> Plant:
    """Jumps that take no contact for near beyond some standard deviations."""
    return instead(intervals, "NormalDist", lambda: SimpleNamespace(inv_cdf=lambda tail: -sigmas))


def jumping(**changes: Any) -> Plant:
    def changed_jumps(plan: Any) -> Any:
        jumps = plan.method.jumps
        noise = jumps.noise._replace(**{name: change(jumps.noise) for name, change in changes.items()})
        return jumps._replace(noise=noise)

    return in_plan(method__jumps=changed_jumps)


BUGS = [
    Bug("noise with twice its density", PAIR, noise(math.sqrt(2.0))),
    Bug("noise with π times its density", PAIR, noise(math.sqrt(math.pi))),
    Bug("noise without the 2π of its density", LINEAR, noise(1.0 / math.sqrt(2.0 * math.pi))),
    Bug("noise with 1.01 times its density", LONG, noise(math.sqrt(1.01))),
    Bug("variance of the noise in the place of its root", LINEAR, noise(lambda plan: plan.noise.amplitude)),
    Bug("noise divided by the root of the mass", LINEAR,
        noise(lambda plan: np.sqrt(plan.system.linear[0][plan.noise.rows]))),
    Bug("one stream for all bodies", LINEAR,
        in_plan(noise__streams=lambda plan: np.repeat(plan.noise.streams[:, :1], 5, axis=1))),
    Bug("two realizations with the same noise", PAIR, own_realizations(lambda part, own: own // 2)),
    Bug("the same noise in every block", ALONE, own_realizations(lambda part, own: own % part.lanes)),
    Bug("the same noise again after eight steps", LINEAR, cycle_of_noise),
    Bug("streams without the seed", INTERVALS,
        called(noise_plan, "streams_of", lambda seed, names, numbers: ((0, 0), names, numbers))),
    Bug("streams by the place of a body", ALONE, called(noise_plan, "streams_of", by_place)),
    Bug("no noise in the displacement", LINEAR, of_rows(velocity_rows)),
    Bug("no noise in the displacement of a body with contacts", PAIR, of_rows(velocity_rows)),
    Bug("displacement and velocity with independent noise", LINEAR, of_rows(independent_rows)),
    Bug("flow without damping", PAIR, flow(damping=0.0)),
    Bug("flow with twice the damping", PAIR, flow(damping=2.0)),
    Bug("flow with the damping ratio in the place of twice of it", PAIR, flow(damping=0.5)),
    Bug("flow with 1.01 times the stiffness", LONG, flow(stiffness=1.01)),
    Bug("friction and noise in the middle of the step", LONG,
        instead(exact_flow, "GAUSS", (0.5, 0.5))),
    Bug("coupling that moves one of its bodies", GROUP, cross(flow=first_of_pair)),
    Bug("coupled bodies with independent noise", LINEAR, cross(noise=lambda plan: 0.0)),
    Bug("force read before the shift", COARSE, column(SHIFT, 0.0)),
    Bug("shift in the other direction", PAIR, column(SHIFT, -1.0)),
    Bug("kick without the mass", TREE, column(KICK, lambda plan: plan.system.linear[0])),
    Bug("contacts read before the shift", COARSE, in_plan(forces__text=lambda plan: read_early(plan.forces.text))),
    Bug("half the kick", PAIR, column(KICK, 0.5)),
    Bug("force of a damper at the velocity before the kick", PRESSED, column(HALF_KICK, 0.0)),
    Bug("contact force on one body only", PAIR, in_plan(forces__indices=one_sided)),
    Bug("contact forces of the evaluation before", PAIR, in_plan(forces__text=lambda plan: stale(plan.forces.text))),
    Bug("clearance with the other sign", PAIR, text("- clearance", "+ clearance")),
    Bug("contacts that pull", TREE,
        both(text("LinearContact_force(max(gap, 0.0)", "LinearContact_force(gap"),
             text("gap - gap if gap <= 0.0 else force", "force"))),
    Bug("exponent 5/2 in the force of Hertz contact", PAIR,
        text("indentation * math.sqrt", "indentation * indentation * math.sqrt")),
    Bug("exponent 1 in the force of Hertz contact", PAIR, text("indentation * math.sqrt(indentation)", "indentation")),
    Bug("stiffness of another contact", TREE, in_plan(forces__parameters=swapped)),
    Bug("wall on the other side", TREE, other_side),
    Bug("half of a cubic force", TREE, text("return cubic *", "return 0.5 * cubic *")),
    Bug("coupling that pushes one of its bodies", TREE, text("total[second + member, lane] -= force", "pass")),
    Bug("coupling with the other sign", TREE,
        text("total[first + member, lane] += force", "total[first + member, lane] -= 2.0 * force")),
    Bug("twice the automatic step", LONG, returned(ExactFlow, "recommended_step", lambda step, *_: 2.0 * step)),
    Bug("three times the automatic step", HALVED, returned(ExactFlow, "recommended_step", lambda step, *_: 3.0 * step)),
    Bug("start that overlaps", START,
        instead(FirstStates, "_closed", lambda states, x, contacts: np.zeros((1, x.shape[1]), dtype=int))),
    Bug("start with twice the temperature", START,
        in_plan(start__deviations=lambda plan: math.sqrt(2.0) * plan.start.deviations)),
    Bug("one stream for the start of all bodies", START,
        in_plan(start__streams=lambda plan: np.repeat(plan.start.streams[:, :1], 2, axis=1))),
    Bug("given velocities taken for those in the middle of a kick", HELD,
        instead(Block, "_begin_on_path", lambda block, x, v: None)),
    Bug("velocities shown in the middle of kicks, whatever the friction", HELD,
        returned(exact_flow, "kick_lag", lambda lag, *_: 0.0 * lag)),
    Bug("no spin-up", EARLY, in_plan(clock__spin_up_steps=lambda plan: 0)),
    Bug("spin-up by the fastest body", EARLY,
        returned(expected, "relaxation_time", lambda time, model: time / 16.0)),
    Bug("jumps with a bound of 3σ", JUMPS, bound(3.0)),
    Bug("jumps without noise about the mean path", JUMPS, bound(0.0)),
    Bug("halves of a jump whose noise does not add up", JUMPS, jumping(gain=lambda noise: 0.0 * noise.gain)),
]  # fmt: skip
