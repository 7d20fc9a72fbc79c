"""The forces of a network in given states, for solvers that do not run its loops."""

from __future__ import annotations

import numpy as np

from impactlab.assembly.generate import generate
from impactlab.assembly.model import Model
from impactlab.compiling.build import build
from impactlab.compiling.force_type import evaluate
from impactlab.kernels.memory import TIMES, states_in, with_states


class Forces:
    """The forces of a network in some states at a time, the lanes, for what is outside the loops of a run.

    Attributes
    ----------
    x, v : (body, lane) ndarray
        Displacements and velocities, to be filled in.
    states : (state, lane) ndarray
        States of laws, to be filled in; those that laws begin with at first.
    total : (body, lane) ndarray
        Forces on the bodies but those of their own springs and dampers, after `evaluate` (N).
    of_contacts : (contact, lane) ndarray
        Those of the contacts (N).
    """

    def __init__(self, model: Model, lanes: int = 1) -> None:
        self._members, self._module = model.members, build(generate(model))
        self._given = np.zeros((1, len(model.sources["force"].names)))
        own, laws = self._members.parameters, self._members.states
        self._parameters = with_states(own, laws, lanes, np.zeros)
        bodies, contacts = len(model.bodies), len(model.ends)
        x, v, total = (np.zeros((1, bodies + 1, lanes)) for _ in range(3))
        indentation, force = np.zeros((2, 1, contacts, lanes))
        self._arrays = x, v, self._parameters, self._members.indices, indentation, force, total
        self.x, self.v, self.total, self.of_contacts = x[0, :-1], v[0, :-1], total[0, :-1], force[0]
        self.states = states_in(self._parameters, len(laws), lanes)

    def evaluate(self, t: float) -> None:
        """Look at the forces at a time (s)."""
        self._parameters[TIMES] = t, 0.0
        evaluate(self._module.forces, *self._arrays)

    def given(self, t: float) -> np.ndarray:
        """Return the given forces of all sources at a time, (source,) (N)."""
        self._module.forcing(np.array([float(t)]), self._members.parameters, self._members.indices, self._given)
        forces: np.ndarray = self._given[0]
        return forces
