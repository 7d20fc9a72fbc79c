"""Dry friction that sticks: what it acts on, and the motion in which slip and stick are located."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from impactlab.assembly.model import Model
from impactlab.components.coupling import CoulombFrictionCoupling
from impactlab.integrators.arguments import Rubbing, Rubs
from impactlab.integrators.interval_arguments import Zeros
from impactlab.integrators.kicks import kick_lag
from impactlab.kernels.dry_friction import DEGREE, SEEN, WORK
from impactlab.linear.transitions import response_to_force, transition


@dataclass(frozen=True, eq=False)
class DryFriction:
    """Dry friction of a run."""

    names: tuple[str, ...]  # of the couplings
    links: Rubs

    @classmethod
    def of(cls, model: Model, step: float) -> DryFriction:
        """Return that of a model at a step (s)."""
        if not model.rubbing.any():
            return _NOTHING
        links = model.coupled.chosen(np.flatnonzero(model.rubbing))
        moving = links.slots < links.count
        slots, weights, rows = links.slots[moving], links.weights[moving], links.rows[moving]
        inverse, inertia = 1.0 / model.mass, 1.0 / links.squares(1.0 / model.mass)
        laws = [law for law in model.coupling_laws if isinstance(law, CoulombFrictionCoupling)]
        friction, ratio, velocity = np.array([(law.friction, law.static_ratio, law.velocity) for law in laws]).T
        begin = np.searchsorted(rows, np.arange(len(laws) + 1))
        numbers = np.stack([friction, ratio * friction, velocity, inertia])
        shares = weights * inverse[slots] * inertia[rows]
        names = tuple(name for name, rubs in zip(model.couplings, model.rubbing, strict=True) if rubs)
        return cls(names, Rubs(begin, slots, weights, shares, numbers, _motion(model, step)))

    def arrays(self, lanes: int, zeros: Zeros) -> Rubbing:
        """Return what a block takes, with no function yet."""
        count, entries = len(self.names), len(self.links.bodies)
        return Rubbing(
            function=0,
            links=self.links,
            before=zeros(((self.links.motion.shape[1] + 1) * bool(count), lanes)),
            earlier=zeros((entries, lanes)),
            work=zeros((WORK, entries)),
            series=zeros((entries + 1, DEGREE + 1)),
            seen=zeros((SEEN, count, lanes)),
        )


_NONE, _BEGIN = np.zeros(0), np.zeros(1, dtype=np.int64)
_NOTHING = DryFriction((), Rubs(_BEGIN, _BEGIN[:0], _NONE, _NONE, np.zeros((4, 0)), np.zeros((0, 0))))


def _motion(model: Model, step: float) -> np.ndarray:
    """Return the rows of numbers of bodies that `impactlab.kernels.dry_friction` names."""
    linear = model.mass, model.damping, model.stiffness
    flow, _ = transition(*linear, np.zeros_like(model.mass), step)
    lag = step / model.mass * kick_lag(model.damping / model.mass * step)
    x_mean, v_mean, x_slope, v_slope = response_to_force(*linear, step).T
    kicks = step**2 / 12.0 / model.mass, 0.5 * step / model.mass, lag
    return np.stack([*linear, *kicks, *flow.reshape(-1, 4).T, x_mean, v_mean, x_slope, v_slope])
