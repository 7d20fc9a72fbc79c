"""The forces of contacts, couplings and residual forces."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from impactlab.assembly.generate import generate
from impactlab.assembly.links import Links
from impactlab.assembly.model import Model
from impactlab.integrators.kicks import kick_share, kick_width
from impactlab.linear.laws import flowing_systems
from impactlab.plan.subdomains import Tile, refuse_to_cut


@dataclass(frozen=True, eq=False)
class Forces:
    """Generated functions, their arguments, and the bodies that they act on."""

    text: str  # generated module
    parameters: np.ndarray  # arguments of its functions, as `indices`
    indices: np.ndarray
    states: np.ndarray  # of laws at the start; see `impactlab.assembly.members.Members`
    labels: tuple[tuple[str, str], ...]  # names of the states, and their units
    state_ends: Links  # two bodies, or one and the wall, that the law of each state acts on
    timed: np.ndarray  # (body,) whether a law that depends on time acts on it
    timed_contacts: np.ndarray  # (contact,) whether its law is one
    passes: int  # how often a kick evaluates forces that depend on velocities, 0 where there are none
    likely: np.ndarray  # (contact,) whether each may close in the run
    kicked: np.ndarray  # (body,) whether these, couplings that do not flow or a residual force act on it
    half_kick: np.ndarray
    """Velocities of each body and the wall per unit force of a kick, (0 to 2, body + 1). Row 0: half-width of
    the three velocity samples around a kick. Row 1: correction of the mid-kick velocity for friction within the step,
    only where friction is strong. No rows where each body feels one contact at most.
    """

    @property
    def clocked(self) -> bool:
        """Whether laws have states or depend on time."""
        return bool(len(self.states) or self.timed.any())

    @classmethod
    def of(cls, model: Model, likely: np.ndarray, *, single: bool, kick: float | None) -> Forces:
        """Return the forces of a model for a method that kicks at a step (s), or None, in blocks of one lane or many.

        `likely` says whether each contact may close in the run, (contact,) of bool.
        """
        kicks, kicked = model.kicks, np.append(model.bodies.residual, False)
        acting = kicks.links & np.append(likely, np.ones(len(model.coupled), dtype=bool))
        kicked[model.links.chosen(acting).slots] = True
        return cls(
            generate(model, single), model.members.parameters, model.members.indices, model.members.states,
            kicks.states, kicks.state_ends, kicks.timed, model.contacts.timed, kicks.passes, likely,
            np.asarray(kicked[:-1]),
            np.zeros((0, model.wall + 1)) if kick is None else _half_kick(model, kick),
        )  # fmt: skip

    def restricted(self, tile: Tile) -> Forces:
        """Return the forces in a tile."""
        refuse_to_cut(self, self.clocked)
        with_wall = np.append(tile.bodies, len(self.kicked))
        return replace(
            self, parameters=tile.parameters, indices=tile.indices, timed=self.timed[tile.bodies],
            timed_contacts=self.timed_contacts[tile.contacts],
            likely=self.likely[tile.contacts], kicked=self.kicked[tile.bodies], half_kick=self.half_kick[:, with_wall],
        )  # fmt: skip


def _half_kick(model: Model, step: float) -> np.ndarray:
    """Return `Forces.half_kick`."""
    touching = model.links.chosen(model.kicks.links).numbers()
    alone = (touching <= 1) & ~model.bodies.residual
    of_contacts = model.ends.coordinates()
    friction = step * model.damping / model.mass
    for slots, _ in flowing_systems(model):
        friction[slots] = 0.0
    shares = np.stack([kick_width(friction), kick_share(friction) - 0.5])
    rows = 0 if alone[of_contacts].all() else 1 + bool(shares[1].any())
    return np.pad(step / model.mass * shares, ((0, 0), (0, 1)))[:rows]
