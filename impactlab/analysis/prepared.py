"""Networks in which nothing is random, ready to be followed from section to section."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import impactlab
from impactlab.analysis.rhythm import interval_of
from impactlab.analysis.strobes import is_autonomous, strobe_of
from impactlab.assembly.model import Model
from impactlab.errors import InvalidInput
from impactlab.inputs import suggestion
from impactlab.located.event_located import EventLocated, check, linear_between_events
from impactlab.located.given_waves import given_waves
from impactlab.located.rows_of_couplings import rows_of_couplings
from impactlab.located.scenes import Linear, linear_of
from impactlab.located.sections_of_events import with_level
from impactlab.located.smooth import Smooth
from impactlab.located.starts import first_states
from impactlab.plan.start import start_of, states_of
from impactlab.records.surface import Strobe, Surface


@dataclass(frozen=True, eq=False)
class Prepared:
    """A network, and the section at which it is looked at."""

    model: Model
    followed: Model  # with a contact without a force at the level of a section
    scene: Linear | Smooth  # of this
    strobe: Strobe  # the section, or times at which all forces are as at the start
    surface: Surface | None  # the section where it is no strobe
    forced: bool  # whether there is a force with this period

    @classmethod
    def of(
        cls, network: impactlab.Network, section: Surface | None, question: str, any_period: bool = False
    ) -> Prepared:
        """Prepare a network, or refuse it.

        Parameters
        ----------
        network : Network
        section : Surface, optional
        question : str
            The public name of the question about it.
        any_period : bool
            Whether any period will do where nothing varies in time.
        """
        model = Model.of(network)
        if model.random.any():
            noisy = model.bodies.names[int(np.flatnonzero(model.random)[0])]
            raise InvalidInput(
                f"{question} follows motions in which nothing is random, but a noise moves {noisy!r}; use il.sweep "
                "with il.Trajectory(period) or il.PhaseDensity, or leave out the noise."
            )
        check(model, EventLocated())
        if section is not None and not isinstance(section, Surface):
            raise InvalidInput(f"section is an il.Strobe, il.AtContact or il.Crossing, not {section!r}.")
        surface = None if section is None or isinstance(section, Strobe) else section
        if surface is not None:
            impactlab.Section(surface).resolved(model)  # which refuses names that do not exist
        followed = with_level(model, surface)
        try:
            strobe, forced = strobe_of(model, section if isinstance(section, Strobe) else None), True
        except InvalidInput:
            if surface is None and not (section is None and any_period and is_autonomous(model)):
                raise
            strobe, forced = Strobe(interval_of(model)), False
        scene = linear_of(followed) if linear_between_events(followed) else Smooth(followed)
        return cls(model, followed, scene, strobe, surface, forced)

    @property
    def alike(self) -> tuple[Any, ...]:
        """Properties that the networks of one call have in common."""
        return type(self.scene), self.surface, *self.scene.alike

    def begin(self, initial: Mapping[str, Any] | None) -> tuple[np.ndarray, np.ndarray]:
        """Return displacements and velocities of free bodies and sliders where motions begin, and states of laws.

        They are (start, 2 coordinate) and (start, state).
        """
        model = self.model
        given = "rest" if initial is None else start_of(initial, model)
        states = None if initial is None else states_of(initial, model)
        lanes = 1 if isinstance(given, str) else given.shape[2]
        laws = np.broadcast_to(
            model.members.states[:, None] if states is None else states, (len(model.kicks.states), lanes)
        )
        return np.concatenate(first_states(model, self.scene, given, laws, self.strobe.start, lanes), axis=1), laws.T

    def motions(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return displacements and velocities of all bodies, 0 but for those of given motion, (time, body)."""
        x, v = np.zeros((2, len(times), len(self.model.bodies.names)))
        for slot, wave in given_waves(self.model):
            x[:, slot], v[:, slot] = wave.at(times)
        return x, v

    def of_bodies(self, points: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Return displacements and velocities of all bodies, (…, 2, body), of points (…, 2 coordinate).

        Times, (…,) (s), are those of points of a section that is no strobe.
        """
        free, coordinates = self.model.bodies.free, points.shape[-1] // 2
        result = np.zeros((*points.shape[:-1], 2, len(free)))
        known = points.reshape(*points.shape[:-1], 2, coordinates)[..., : free.sum()]
        result[..., free] = known
        when = self.strobe.start if self.surface is None else times
        for slot, wave in given_waves(self.model):
            result[..., 0, slot], result[..., 1, slot] = wave.at(when)
        return result

    def row_names(self) -> tuple[str, ...]:
        """Return the names of contacts, and of couplings with events behind them."""
        if isinstance(self.scene, Smooth):
            return *self.followed.contacts.names, *self.scene.turns.names * 2
        return *self.followed.contacts.names, *rows_of_couplings(self.followed).names


def slots_of(names: Sequence[str] | str | None, known: Sequence[str]) -> list[int]:
    """Return the places of bodies, all if none is named; unknown names are refused."""
    wanted = list(known) if names is None else [names] if isinstance(names, str) else list(names)
    for name in wanted:
        if name not in known:
            raise InvalidInput(f"names: there is no oscillator {name!r}; {suggestion(str(name), known)}")
    if not wanted:
        raise InvalidInput("names has no name; leave it out for all bodies.")
    return [list(known).index(name) for name in wanted]
