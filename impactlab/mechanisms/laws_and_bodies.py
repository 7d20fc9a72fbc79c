"""What laws of contacts, couplings and bodies may need beside the motion, residual forces, and points of structures."""

from __future__ import annotations

import numpy as np

from impactlab.assembly.mechanism import ALL, Mechanism, Mode, at
from impactlab.assembly.model import Model


class ResidualForces(Mechanism):
    """Forces of bodies beyond a spring and a damper: without contacts their motion is not known."""

    name = "residual forces"
    modes = ALL - {Mode.INTERVALS, Mode.IDLE_BODIES, Mode.LOCATED}

    def there(self, model: Model) -> bool:
        return bool(model.bodies.residual.any())

    def bodies(self, model: Model) -> np.ndarray:
        return model.bodies.residual


class LawsWithStates(Mechanism):
    """Laws with states, which are accepted at the end of a step, and may change while a contact is open."""

    name = "laws with states"
    modes = frozenset({Mode.ONE_LANE, Mode.SAMPLES, Mode.LOCATED, Mode.FORCES})

    def there(self, model: Model) -> bool:
        return bool(model.kicks.states)

    def bodies(self, model: Model) -> np.ndarray:
        return at(model, model.kicks.state_ends.slots)


class LawsOfTime(Mechanism):
    """Laws that depend on time."""

    name = "laws that depend on time"
    modes = frozenset({Mode.ONE_LANE, Mode.SIDE_BY_SIDE, Mode.FORCES})

    def there(self, model: Model) -> bool:
        return bool(model.kicks.timed.any())

    def bodies(self, model: Model) -> np.ndarray:
        return model.kicks.timed


class RowsOfNumbers(Mechanism):
    """Fields that are rows of numbers, such as samples of a force, which have one place in the parameters of a run."""

    name = "fields that are rows of numbers"
    modes = ALL - {Mode.SIDE_BY_SIDE}

    def there(self, model: Model) -> bool:
        return bool(model.members.samples.size)


class Points(Mechanism):
    """Points of structures: sums of bodies, which must not be torn apart."""

    name = "points of structures"
    modes = frozenset({Mode.ONE_LANE, Mode.REGISTERS, Mode.SAMPLES, Mode.CERTIFIED_STEP, Mode.LOCATED, Mode.FORCES})

    def there(self, model: Model) -> bool:
        return bool(model.network.points)
