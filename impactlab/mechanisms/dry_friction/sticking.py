"""Dry friction that sticks: which networks have it, what it acts on, and the motion in which it is located."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from impactlab.assembly.links import Links
from impactlab.assembly.mechanism import Method, Mode, refuse_unless, struck
from impactlab.assembly.model import Model
from impactlab.compiling.own_memory import function_of
from impactlab.components.coupling import CoulombFrictionCoupling
from impactlab.errors import InvalidInput
from impactlab.integrators.kicks import kick_lag
from impactlab.integrators.located import Follower
from impactlab.linear.transitions import response_to_force, transition
from impactlab.mechanisms.dry_friction.slip_and_stick import (
    DEGREE,
    LEFT,
    SEEN,
    WORK,
    Rubbing,
    Rubs,
    hold,
    rub,
    shift,
    show_work,
    turn,
)
from impactlab.mechanisms.forces_of_links import Couplings
from impactlab.plan.events import EventPart, Room


class DryFriction(Couplings):
    """Dry friction that sticks: slip and stick are located within the flow of every step."""

    name = "dry frictions that stick"
    modes = frozenset({Mode.ONE_LANE, Mode.SAMPLES, Mode.LOCATED})
    in_flow = True

    def chosen(self, model: Model) -> np.ndarray:
        return model.couplings.sticking

    def place(self, model: Model) -> str:
        return model.couplings.names[int(model.couplings.sticking.argmax())]

    def refuse(self, model: Model, method: Method) -> None:
        refuse_unless(method.collides, self, model, method)
        acted = self.bodies(model)
        names = model.bodies.names
        for slot in model.sources["intensity"].bodies:
            if acted[slot]:
                raise InvalidInput(
                    f"White noise acts on {names[slot]!r}, which has dry friction that sticks: it has no value "
                    "at a moment that a breakaway force could be compared to. Use il.FrictionCoupling there."
                )
        for slot in np.flatnonzero(_links(model).numbers() > 1).tolist() if method.makes_steps else ():
            raise InvalidInput(
                f"{names[slot]!r} has two dry frictions that stick; use il.EventLocated() where nothing is "
                "random, or il.FrictionCoupling for all but one."
            )

    def largest_step(self, model: Model) -> float:
        """Return the largest step in which slip and stick of bodies can be followed as a power series (s)."""
        acted = self.bodies(model)
        rates = np.append(np.sqrt(model.stiffness / model.mass)[acted], (model.damping / model.mass)[acted])
        fastest = float(rates.max(initial=0.0))
        return 1.0 / fastest if fastest > 0.0 else float("inf")

    def followed(self, model: Model) -> np.ndarray:
        slots, _, rows = _links(model).moving()
        result = np.full((2, len(model.bodies)), -1)
        result[:, slots] = rows, np.arange(len(slots))
        return result

    def events(self, model: Model, step: float, seed: tuple[int, int], energy: np.ndarray | float) -> DryFrictionOfRun:
        return DryFrictionOfRun.of(model, step)


def _links(model: Model) -> Links:
    """Return the links of dry friction."""
    return model.coupled.chosen(np.flatnonzero(model.couplings.sticking))


@dataclass(frozen=True, eq=False)
class DryFrictionOfRun(EventPart):
    """Dry friction of a run."""

    record: ClassVar[type] = Rubbing
    after_flow = staticmethod(rub)
    after_kick = staticmethod(hold)
    after_step = staticmethod(show_work)

    links: Rubs
    numbers: np.ndarray  # (link,) of the couplings
    struck: bool  # whether impacts act on any of their bodies

    @classmethod
    def of(cls, model: Model, step: float) -> DryFrictionOfRun:
        """Return the dry friction of a model at a step (s)."""
        links = _links(model)
        slots, weights, rows = links.moving()
        inverse, inertia = 1.0 / model.mass, 1.0 / links.squares(1.0 / model.mass)
        laws = [law for law in model.couplings.laws if isinstance(law, CoulombFrictionCoupling)]
        friction, ratio, velocity = np.array([(law.friction, law.static_ratio, law.velocity) for law in laws]).T
        begin = np.searchsorted(rows, np.arange(len(laws) + 1))
        numbers = np.stack([friction, ratio * friction, velocity, inertia])
        shares = weights * inverse[slots] * inertia[rows]
        struck_there = bool(struck(model)[slots].any())
        couplings = np.flatnonzero(model.couplings.sticking)
        return cls(Rubs(begin, slots, weights, shares, numbers, _motion(model, step)), couplings, struck_there)

    @property
    def couplings(self) -> np.ndarray:  # type: ignore[override]
        return self.numbers

    @property
    def told(self) -> int:  # type: ignore[override]
        return len(self.links.bodies)

    def arrays(self, room: Room) -> Rubbing:
        lanes, zeros = room.lanes, room.zeros
        count, entries = len(self.links.begin) - 1, len(self.links.bodies)
        return Rubbing(
            within=0,
            links=self.links,
            earlier=zeros((entries, lanes)),
            work=zeros((WORK, entries)),
            series=zeros((entries + 1, DEGREE + 1)),
            seen=zeros((SEEN, count, lanes)),
            left=zeros((LEFT * self.struck, count, lanes)),
            kept=zeros((WORK, entries * self.struck, lanes)),
            told=np.zeros(entries + 1),
            struck=np.zeros(2, dtype=np.int64),
            done=zeros((entries * room.told, lanes)),
            shown=zeros((1, entries * room.told, lanes)),
        )

    def follower(self, arrays: Rubbing, own: int, single: bool) -> Follower:
        struck, moved = (function_of(Rubbing, function, single) for function in (turn, shift))
        return Follower(own, struck, moved, arrays.told, arrays.struck)

    def begin(self, arrays: Rubbing) -> None:
        arrays.seen[:] = 0.0

    def lasting(self, arrays: Rubbing) -> list[np.ndarray]:
        return [arrays.seen, arrays.earlier, arrays.left, arrays.kept]

    def push(self, pushes: np.ndarray, closings: np.ndarray) -> None:
        pushes[self.links.bodies] = np.inf  # it acts all the time


def _motion(model: Model, step: float) -> np.ndarray:
    """Return the rows of numbers of bodies that `impactlab.mechanisms.dry_friction.slip_and_stick` names."""
    linear = model.mass, model.damping, model.stiffness
    flow, _ = transition(*linear, np.zeros_like(model.mass), step)
    lag = step / model.mass * kick_lag(model.damping / model.mass * step)
    x_mean, v_mean, x_slope, v_slope = response_to_force(*linear, step).T
    kicks = step**2 / 12.0 / model.mass, 0.5 * step / model.mass, lag
    return np.stack([*linear, *kicks, *flow.reshape(-1, 4).T, x_mean, v_mean, x_slope, v_slope])
