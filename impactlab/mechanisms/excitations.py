"""White noise, sums of cosines, and given forces."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from impactlab.assembly.mechanism import ALL, Load, Mechanism, Method, Mode, at
from impactlab.assembly.model import Model
from impactlab.errors import InvalidInput


class Excitations(Mechanism, family=True):
    """Excitations of one kind."""

    kind: ClassVar[str]
    """A key of `impactlab.assembly.model.Model.sources`."""

    def there(self, model: Model) -> bool:
        return bool(model.sources[self.kind].names)

    def bodies(self, model: Model) -> np.ndarray:
        return at(model, model.sources[self.kind].bodies)

    def refuse(self, model: Model, method: Method) -> None:
        if self.kind in method.handles:
            return
        name, excitation = model.sources[self.kind].named()[0]
        raise InvalidInput(
            f"{type(method).__name__} does not handle the excitation of {name!r} "
            f"({type(excitation).__name__}, defined by {excitation.kind}); it handles {', '.join(method.handles)}. "
            "Use il.ExactFlow()."
        )


class WhiteNoises(Excitations):
    """White noise."""

    name = "white noise"
    kind = "intensity"
    modes = ALL - {Mode.LOCATED}


class SourcesOfWhiteNoise(Excitations):
    """White noise with a name of its own, which may drive several bodies: their paths are not independent."""

    name = "sources of white noise"
    kind = "intensity"
    modes = ALL - {Mode.TILES, Mode.INTERVALS, Mode.FINE_FLOW, Mode.LOCATED}

    def there(self, model: Model) -> bool:
        return bool(model.sources["intensity"].beyond_own)


class VaryingWhiteNoises(Excitations):
    """White noise whose intensity depends on time, so that no transition serves all steps."""

    name = "white noise that varies in time"
    kind = "intensity"
    modes = frozenset({Mode.ONE_LANE, Mode.REGISTERS, Mode.SIDE_BY_SIDE, Mode.FORCES})

    def there(self, model: Model) -> bool:
        return model.noise.varying


class SumsOfCosines(Excitations):
    """Sums of cosines with random phases, sampled for each block."""

    name = "sums of cosines"
    kind = "lines"
    modes = frozenset({Mode.ONE_LANE, Mode.FORCES})


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
