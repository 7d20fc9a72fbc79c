"""Networks with forces that are no linear functions, as the arrays of steps that end at events."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np

from impactlab.assembly.forces_in_states import Forces
from impactlab.assembly.generate import generate
from impactlab.assembly.mechanism import given_motions
from impactlab.assembly.members import HEADER, PLACES
from impactlab.assembly.model import Model
from impactlab.compiling.build import build
from impactlab.compiling.scalars import DISABLED
from impactlab.kernels.contact_states import EFFECTIVE_MASS, RESTITUTION, RIGID, SPRING, SURFACE
from impactlab.kernels.from_step_to_step import Rigid
from impactlab.kernels.memory import with_states
from impactlab.kernels.smooth_steps import IN_TIME, ROW_B, ROW_C, ROW_E3, ROW_E5, ROW_QUINTIC, STAGES, Bodies
from impactlab.located.panels import breaks_of, within
from impactlab.located.rows_of_couplings import weights
from impactlab.located.scenes import points_of, wave_of
from impactlab.located.turning import turns_of

BALANCED = 1e-9
"""Part of the forces at displacements 0 that may be left at rest."""

NO_FLOWS = np.zeros((0, 4), dtype=np.int64)
"""No products."""


@cache
def tableau() -> np.ndarray:
    """Return the numbers of Dormand and Prince's method of order eight."""
    from scipy.integrate import DOP853  # loaded only where steps are made

    rows = np.zeros((ROW_QUINTIC + 5, STAGES + 1))
    rows[:STAGES, :STAGES] = DOP853.A[:STAGES, :STAGES]
    rows[ROW_B, :STAGES], rows[ROW_C, :STAGES], rows[ROW_C, STAGES] = DOP853.B, DOP853.C[:STAGES], 1.0
    rows[ROW_E3], rows[ROW_E5] = DOP853.E3, DOP853.E5
    times = rows[ROW_C, list(IN_TIME)]
    rows[ROW_QUINTIC:, : len(IN_TIME)] = np.linalg.inv(np.vander(times, increasing=True))[1:]
    return rows


class Smooth:
    """A network as a lane of steps that end at events.

    Parameters
    ----------
    model : Model
        Its forces are functions of displacements, velocities and time.
    flows : (product, 4) ndarray
        Products of impulses and velocities that are summed; see `impactlab.kernels.integrals`.
    """

    def __init__(self, model: Model, flows: np.ndarray = NO_FLOWS) -> None:
        self.flows = flows
        self.model, self.text, members = model, generate(model, located=True), model.members
        self.numbers = with_states(members.parameters, members.states, 1, np.zeros)
        self.indices = members.indices
        self.free = np.flatnonzero(model.bodies.free)
        self.linear = np.stack([np.where(model.bodies.free, model.mass, 0.0), model.damping, model.stiffness])
        self.frequencies, self.motions = _motions(model)
        source, body, weight = model.sources["force"].drives
        acts = model.bodies.free[body]
        self.drives, self.shares = np.stack([source[acts], body[acts]]), weight[acts]
        self.sources = len(model.sources["force"].names)
        self.turns, self.laws, self.rigid = turns_of(model), model.contacts.laws, model.contacts.impulsive
        self.breaks = [item for one in model.sources["force"].excitations for item in breaks_of(one)]

    @property
    def alike(self) -> tuple[Any, ...]:
        """What the networks of one call have in common."""
        turns = self.turns.contacts, self.turns.laws, self.rigid
        arrays = self.indices, self.free, self.drives, self.shares, *turns
        breaks = [(times.tobytes(), repeats) for times, repeats in self.breaks]
        numbers = [item.tobytes() for item in (*arrays, self.flows)]
        return self.text, len(self.frequencies), len(self.model.points), *numbers, *breaks

    def at_rest(self) -> np.ndarray:
        """Return displacements under contacts and residual forces alone, 0 where none acts there, (1, body)."""
        forces, model, free = Forces(self.model), self.model, self.free

        def left(x: np.ndarray) -> np.ndarray:
            forces.x[free, 0] = x
            forces.evaluate(0.0)
            force: np.ndarray = forces.total[free, 0] - model.stiffness[free] * x
            return force

        start = np.zeros(len(free))
        if not left(start).any():
            return start[None]
        from scipy.optimize import root  # loaded only for bodies that are pressed together

        found = root(left, start, tol=1e-14)
        balanced = np.abs(left(found.x)).max() <= BALANCED * np.abs(left(start)).max()
        return (found.x if balanced else start)[None]

    def ends(self, begin: float, end: float) -> np.ndarray:
        """Return the times between two others at which given forces begin, end or have samples."""
        return within(self.breaks, begin, end)


def stacked(networks: Sequence[Smooth], of: Callable[[Smooth], Any]) -> np.ndarray:
    """Return an array of each network, (network, …), which is made once where several are the same."""
    places: dict[int, int] = {}
    rows = [places.setdefault(id(item), len(places)) for item in networks]
    different = {id(item): item for item in networks}
    return np.stack([of(item) for item in different.values()])[rows]


def bodies_of(networks: Sequence[Smooth]) -> Bodies:
    """Return networks of one structure as the lanes of a call."""
    first = networks[0]
    module = build(first.text)
    functions = [getattr(module, name, (None, 0))[1] for name in ("given", "accept")]
    return Bodies(
        module.forces,
        np.array(functions, dtype=object if DISABLED else np.int64),
        first.indices,
        stacked(networks, lambda item: item.linear),
        first.drives,
        first.shares,
        stacked(networks, lambda item: np.concatenate([weights(item.model.ends), *[item.turns.links] * 2])),
        stacked(networks, lambda item: item.motions),
        stacked(networks, lambda item: item.frequencies),
        stacked(networks, lambda item: points_of(item.model)),
        np.concatenate([_places(first.model), *[first.turns.contacts] * 2]),
        tableau(),
    )


def rigid_of(bodies: Bodies, networks: Sequence[Smooth]) -> Rigid:
    """Return what the impacts of rigid contacts take of networks in the lanes of a call."""
    contacts, free = networks[0].rigid, networks[0].free
    links = bodies.links[:, : len(contacts)]
    pushes = links[:, :, free] / bodies.linear[:, None, 0, free]
    inverse = (links[:, :, free] * pushes).sum(axis=-1)
    numbers = np.zeros((len(networks), len(contacts), SURFACE + 1))
    numbers[:, :, RESTITUTION] = stacked(
        networks, lambda item: np.array([getattr(law, "restitution", 0.0) for law in item.laws])
    )
    numbers[:, :, EFFECTIVE_MASS] = np.divide(1.0, inverse, out=np.zeros_like(inverse), where=inverse > 0.0)
    walls = np.einsum("lki,liw->lkw", links, bodies.motions[:, :, 1:])
    kinds = np.where(contacts, RIGID, SPRING)
    parts = bodies.frequencies, numbers, links[:, :, free], pushes, walls, kinds, networks[0].flows
    return Rigid(*map(np.ascontiguousarray, parts))


def _motions(model: Model) -> tuple[np.ndarray, np.ndarray]:
    """Return frequencies of given motions, and constants and amplitudes of these, (body, 1 + 2 wave)."""
    given = [(slot, *wave_of(item)) for slot, item in given_motions(model)]
    frequencies = np.array(sorted({frequency for _, _, frequency, amplitude in given if amplitude}))
    motions = np.zeros((len(model.bodies), 1 + 2 * len(frequencies)))
    for slot, constant, frequency, amplitude in given:
        motions[slot, 0] = constant
        if amplitude:
            place = 1 + 2 * int(np.searchsorted(frequencies, frequency))
            motions[slot, place : place + 2] = amplitude.real, amplitude.imag
    return frequencies, motions


def _places(model: Model) -> np.ndarray:
    """Return where the clearance of each contact is among the parameters of the forces."""
    members = model.members
    places, width = np.zeros(len(model.ends), dtype=np.int64), 3
    for number, kind in enumerate(members.kinds):
        if kind.role != "force":
            continue
        runs, at = members.indices[PLACES + HEADER * number :][:2]
        for run in range(runs):
            slot, count, start = members.indices[at + run * (width + bool(kind.states)) :][:3]
            places[slot : slot + count] = start + np.arange(count)
    return places
