"""Given forces."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from impactlab.assembly.mechanism import Load, Mechanism, Mode, at
from impactlab.assembly.model import Model
from impactlab.mechanisms.noises import Excitations


class GivenForces(Excitations):
    """Given functions of time."""

    name = "given forces"
    kind = "force"
    modes = frozenset({Mode.ONE_LANE, Mode.REGISTERS, Mode.SIDE_BY_SIDE, Mode.LOCATED, Mode.FORCES})

    def there(self, model: Model) -> bool:
        return bool(at(model, model.sources["force"].bodies)[model.bodies.free].any())

    def loads(self, model: Model) -> Iterator[Load]:
        sources = model.sources[self.kind]
        for number, function in enumerate(sources.excitations):
            bodies, weights = sources.driven(number)
            moving = model.bodies.free[bodies]
            yield Load(bodies[moving], function, weights[moving], np.zeros(moving.sum()))


class ProductsOfForces(Mechanism):
    """Given forces times an envelope; those of several networks have no common numbers."""

    name = "products of given forces"
    modes = frozenset({Mode.ONE_LANE, Mode.REGISTERS, Mode.FORCES})

    def there(self, model: Model) -> bool:
        return bool(model.members.of_role("factor"))

    def bodies(self, model: Model) -> np.ndarray:
        return at(model, model.sources["force"].bodies)
