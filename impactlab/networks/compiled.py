"""A network as a function: the right-hand side for solvers of ordinary differential equations."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import xarray as xr

from impactlab.assembly.forces_in_states import Forces
from impactlab.assembly.mechanism import Mode, refusing
from impactlab.assembly.model import Model
from impactlab.components.composition import Composition
from impactlab.errors import InvalidInput
from impactlab.inputs import checked
from impactlab.plan.start import start_of
from impactlab.results.snapshot import TIME, Snapshot


@checked
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
        If forces are no functions of the motion and the time: laws with states, impacts, friction that sticks, bodies
        of given motion.

    Examples
    --------
    >>> system = network.compile()
    >>> system.rhs(0.0, system.state(displacement={"a": 0.05})).round(6)
    array([ 0. , -0.5])
    """

    def __init__(self, network: Composition) -> None:
        self.network = network
        self.model = Model.of(network)
        kinds = (kind for kind in self.model.members.kinds if kind.states)
        if some := ", ".join(f"{kind.component.__name__} ({', '.join(kind.states)})" for kind in kinds):
            raise InvalidInput(
                f"A network is no function of displacements and velocities alone where laws have states: {some}."
            )
        for mechanism in refusing(self.model, Mode.FORCES):
            raise InvalidInput(f"A right-hand side knows no {mechanism.example(self.model)}; use il.simulate.")
        self._forces = Forces(self.model)

    def rhs(self, t: float, y: np.ndarray) -> np.ndarray:
        """Return dy/dt for a state y (2 bodies,), as `scipy.integrate.solve_ivp` wants it."""
        model = self.model
        bodies = len(model.bodies)
        if y.shape != (2 * bodies,):
            raise InvalidInput(f"y must be displacements and velocities of {bodies} bodies, not of shape {y.shape}.")
        x, v = y[:bodies], y[bodies:]
        force = self._at(t, x, v).total[:, 0] - model.stiffness * x - model.damping * v
        if model.sources["force"].bodies:
            number, body, weight = model.sources["force"].drives
            np.add.at(force, body, weight * self._forces.given(t)[number])
        return np.concatenate([v, force / model.mass])

    def _at(self, t: float, x: np.ndarray, v: np.ndarray) -> Forces:
        """Return the forces in a state."""
        forces = self._forces
        forces.x[:, 0], forces.v[:, 0] = x, v
        forces.evaluate(t)
        return forces

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
        return [self._event(contact) for contact in range(len(self.model.contacts.names))]

    def _event(self, contact: int) -> Callable[[float, np.ndarray], float]:
        link = self.model.ends.chosen(np.array([contact]))
        clearance = float(self.model.clearance[contact])

        def indentation(t: float, y: np.ndarray) -> float:
            return float(link.gap(y[: len(self.model.bodies.names)])[0]) - clearance

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
        bodies = len(self.model.bodies.names)
        if t.ndim != 1 or y.shape != (2 * bodies, len(t)):
            raise InvalidInput(
                f"t must be a row of times, and y have the shape ({2 * bodies}, {t.size}), not {t.shape} and {y.shape}."
            )
        forces = np.empty((len(t), len(self.model.contacts.names)))
        for index, (time, column) in enumerate(zip(t, y.T, strict=True)):
            forces[index] = self._at(time, column[:bodies], column[bodies:]).of_contacts[:, 0]
        snapshots = np.hstack([y.T, forces])
        variables = Snapshot(self.model.bodies.names, self.model.contacts.names, points=self.model.points).labelled(
            snapshots, "time"
        )
        coordinates: dict[str, Any] = {
            "time": ("time", t, TIME),
            "oscillator": list(self.model.bodies.names),
        }
        if self.model.network.points:
            coordinates["point"] = list(self.model.network.points)
        if self.model.contacts.names:
            coordinates["contact"] = list(self.model.contacts.names)
        return xr.Dataset(variables, coordinates)
