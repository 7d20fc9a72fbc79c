"""A network as a function: the right-hand side for solvers of ordinary differential equations."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import xarray as xr

from impactlab.assembly.build import build
from impactlab.assembly.generate import generate
from impactlab.assembly.model import Model
from impactlab.components.composition import Composition
from impactlab.errors import InvalidInput
from impactlab.kernels.jit import evaluate
from impactlab.kernels.memory import TIMES, with_states
from impactlab.plan.start import start_of
from impactlab.results.snapshot import TIME, Snapshot


class Forces:
    """The forces of a network in some states at a time, the lanes, for what is outside the loops of a run."""

    def __init__(self, model: Model, lanes: int = 1) -> None:
        self.model, members = model, model.members
        self._module = build(generate(model))
        self._parameters = with_states(members.parameters, members.states, lanes, np.zeros)
        bodies, contacts = len(model.bodies), len(model.contacts)
        self._x, self._v, self._total = (np.zeros((1, bodies + 1, lanes)) for _ in range(3))
        self._contacts = np.zeros((1, contacts, lanes)), np.zeros((1, contacts, lanes))

    @property
    def of_contacts(self) -> np.ndarray:
        """Those of the contacts where the forces were last looked at, (contact, lane) (N)."""
        forces: np.ndarray = self._contacts[1][0]
        return forces

    def __call__(self, t: float, x: np.ndarray, v: np.ndarray, states: np.ndarray | None = None) -> np.ndarray:
        """Return the forces that springs, dampers, contacts and couplings exert on the bodies, (body, lane) (N).

        Displacements and velocities are (body, lane), and states of laws (state, lane).
        """
        model = self.model
        self._x[0, :-1], self._v[0, :-1], self._parameters[-TIMES] = x, v, t
        if states is not None and states.size:
            self._parameters[-TIMES - states.size : -TIMES] = states.ravel()
        indices = model.members.indices
        evaluate(self._module.forces, self._x, self._v, self._parameters, indices, *self._contacts, self._total)
        return np.asarray(self._total[0, :-1] - model.stiffness[:, None] * x - model.damping[:, None] * v)

    def given(self, times: np.ndarray) -> np.ndarray:
        """Return the given forces of all sources at some times, (time, source) (N)."""
        members, result = self.model.members, np.zeros((len(times), len(self.model.sources["force"].names)))
        self._module.forcing(times, members.parameters, members.indices, result)
        return result


class CompiledNetwork:
    """The noise-free first-order system of a network, y = [x..., v...].

    Parameters
    ----------
    network : Network
        Bodies in the order of their names; excitations that are given functions of time
        act, noise does not.

    Raises
    ------
    InvalidInput
        If a law has states, a contact is rigid, dry friction sticks, or the motion of a body is given.
    """

    def __init__(self, network: Composition) -> None:
        self.network = network
        self.model = Model.of(network)
        kinds = (kind for kind in self.model.members.kinds if kind.states)
        if some := ", ".join(f"{kind.component.__name__} ({', '.join(kind.states)})" for kind in kinds):
            raise InvalidInput(
                f"A network is no function of displacements and velocities alone where laws have states: {some}."
            )
        if self.model.rigid.any():
            name = self.model.contacts[int(self.model.rigid.argmax())]
            raise InvalidInput(
                f"A right-hand side knows no impacts of rigid contacts such as {name!r}; use il.simulate."
            )
        if self.model.rubbing.any():
            name = self.model.couplings[int(self.model.rubbing.argmax())]
            raise InvalidInput(f"A right-hand side knows no sticking, as in {name!r}; use il.simulate.")
        if self.model.prescribed.any():
            name = self.model.bodies[int(self.model.prescribed.argmax())]
            raise InvalidInput(f"A right-hand side knows no given motion, as of {name!r}; use il.simulate.")
        self._forces = Forces(self.model)

    def rhs(self, t: float, y: np.ndarray) -> np.ndarray:
        """Return dy/dt for a state y (2 bodies,), as `scipy.integrate.solve_ivp` wants it."""
        model = self.model
        bodies = len(model.bodies)
        x, v = y[:bodies], y[bodies:]
        force = self._forces(t, x[:, None], v[:, None])[:, 0]
        if model.forced:
            number, body, weight = model.sources["force"].drives
            np.add.at(force, body, weight * self._forces.given(np.array([float(t)]))[0, number])
        return np.concatenate([v, force / model.mass])

    def state(
        self, *, displacement: Mapping[str, float] | None = None, velocity: Mapping[str, float] | None = None
    ) -> np.ndarray:
        """Return y for displacements (m) and velocities (m s-1) by name; 0 where nothing is named."""
        initial = {"displacement": displacement or {}, "velocity": velocity or {}}
        start = start_of(initial, self.model)
        if not isinstance(start, np.ndarray) or start.shape[2] > 1:
            raise InvalidInput("A state has one displacement and one velocity for each oscillator.")
        return np.concatenate(start[..., 0])

    @property
    def contact_events(self) -> list[Callable[[float, np.ndarray], float]]:
        """One function per contact that changes its sign where the contact opens or closes."""
        return [self._event(contact) for contact in range(len(self.model.contacts))]

    def _event(self, contact: int) -> Callable[[float, np.ndarray], float]:
        link = self.model.ends.chosen(np.array([contact]))
        clearance = float(self.model.clearance[contact])

        def indentation(t: float, y: np.ndarray) -> float:
            return float(link.gap(y[: len(self.model.bodies)])[0]) - clearance

        return indentation

    def to_dataset(self, t: np.ndarray, y: np.ndarray) -> xr.Dataset:
        """Label a solution.

        Parameters
        ----------
        t : (time,) ndarray
            Times (s).
        y : (2 bodies, time) ndarray
            States, as `solve_ivp` returns them.

        Returns
        -------
        xarray.Dataset
            ``displacement`` and ``velocity`` (time, oscillator), ``contact_force`` (time, contact).
        """
        bodies = len(self.model.bodies)
        forces = np.empty((len(t), len(self.model.contacts)))
        for index, (time, column) in enumerate(zip(t, np.asarray(y).T, strict=True)):
            self._forces(time, column[:bodies, None], column[bodies:, None])
            forces[index] = self._forces.of_contacts[:, 0]
        snapshots = np.hstack([np.asarray(y).T, forces])
        variables = Snapshot(self.model.bodies, self.model.contacts, points=self.model.points).labelled(
            snapshots, "time"
        )
        coordinates: dict[str, Any] = {
            "time": ("time", np.asarray(t, dtype=float), TIME),
            "oscillator": list(self.model.bodies),
        }
        if self.model.network.points:
            coordinates["point"] = list(self.model.network.points)
        if self.model.contacts:
            coordinates["contact"] = list(self.model.contacts)
        return xr.Dataset(variables, coordinates)
