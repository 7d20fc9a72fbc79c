"""The record of sections, from the events and samples of runs without steps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from impactlab.assembly.model import Model
from impactlab.components.contact import Contact, LinearContact
from impactlab.components.sides import WALL
from impactlab.kernels import event_log as log
from impactlab.kernels.contact_states import HELD, OPEN
from impactlab.located.rows_of_couplings import weights
from impactlab.records.surface import AtContact, Crossing, SectionPoints, Strobe, Surface

LEVEL = "level of the section"
"""Name of the contact without a force that tells when a body crosses a level."""

Motions = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Displacements and velocities of bodies of given motion at some times, (time, body)."""


def with_level(model: Model, surface: Surface | None) -> Model:
    """Return the network that is followed: where a section is at a level, with a contact there that has no force."""
    if not isinstance(surface, Crossing):
        return model
    level = Contact(surface.body, WALL, LinearContact(0.0), clearance=surface.level)
    network: Any = model.network
    return Model.of(network.replace(contacts={LEVEL: level}))


class SectionsOfEvents:
    """The points of a section of the realizations of one network.

    Parameters
    ----------
    surface : Surface
    names : sequence of str, optional
        Bodies that are kept; all by default.
    points : SectionPoints
        Takes the points.
    model : Model
        The network that is followed, see `with_level`.
    motions : callable
        See `Motions`.
    """

    def __init__(
        self, surface: Surface, names: Sequence[str] | None, points: SectionPoints, model: Model, motions: Motions
    ) -> None:
        self.points, self.motions, self.free = points, motions, model.bodies.free
        self.kept = [model.bodies.names.index(name) for name in names or model.bodies.names]
        if isinstance(surface, Strobe):
            return
        name = surface.contact if isinstance(surface, AtContact) else LEVEL
        self.slot, self.speed = model.contacts.names.index(name), isinstance(surface, AtContact)
        self.closing = surface.inwards
        law = model.contacts.laws[self.slot]
        self.restitution = float(getattr(law, "restitution", 0.0))
        self.rigid = bool(model.contacts.impulsive[self.slot])
        link = weights(model.ends)[self.slot]
        along = np.where(self.free, link / model.mass, 0.0)
        self.push = along / max(float(along @ link), np.finfo(float).tiny)  # by a unit change of the rate of the gap

    def take(self, lane: int, events: np.ndarray, states: np.ndarray) -> None:
        """Take the events of a realization, and the states after them."""
        open_then = events[:, log.BEFORE if self.closing else log.AFTER] == OPEN
        chosen = open_then & (events[:, log.OF_CONTACT] == self.slot) & (events[:, log.WHEN] >= 0.0)
        if not chosen.any():
            return
        events, (x, v) = events[chosen], self._all(events[chosen, log.WHEN], states[chosen])
        rate = events[:, log.RATE_BEFORE]
        if self.closing and self.rigid:  # the state before the impact
            factor = 1.0 + np.where(events[:, log.AFTER] == HELD, 0.0, self.restitution)
            v = v + (factor * rate)[:, None] * self.push
        if not self.closing:  # by a bounce, or after a while
            rate = np.where(events[:, log.BEFORE] == OPEN, self.restitution, -1.0) * rate
        self._keep(lane, events[:, log.WHEN], (x, v), rate if self.speed else None)

    def take_samples(self, times: np.ndarray, samples: np.ndarray) -> None:
        """Take the samples of all realizations at some times, (realization, time, 2 body)."""
        for lane, states in enumerate(samples):
            self._keep(lane, times, self._all(times, states), None)

    def _all(self, times: np.ndarray, states: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return displacements and velocities of all bodies, from those of free ones, behind which sliders may be."""
        inner, free = states.shape[1] // 2, int(self.free.sum())
        x, v = self.motions(times)
        x[:, self.free], v[:, self.free] = states[:, :free], states[:, inner : inner + free]
        return x, v

    def _keep(
        self, lane: int, times: np.ndarray, states: tuple[np.ndarray, np.ndarray], speed: np.ndarray | None
    ) -> None:
        """Keep points of a realization."""
        values = np.empty((len(times), 2 + 2 * len(self.kept)))
        values[:, 0], values[:, 1] = times, np.nan if speed is None else speed
        values[:, 2:] = np.concatenate([item[:, self.kept] for item in states], axis=1)
        self.points.take(np.full(len(times), lane), values)

    def result(self, realizations: int) -> dict[str, np.ndarray]:
        """Return how many points each realization has, and all of them."""
        return self.points.result(realizations, 2 + 2 * len(self.kept))
