"""Bodies whose motion is given."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from impactlab.assembly.mechanism import Load, Mechanism, Method, Mode, refuse_unless
from impactlab.assembly.model import Model
from impactlab.assembly.remembered import kept
from impactlab.components.excitation import Excitation
from impactlab.linear.given_functions import LOOKS, irregular_times, looks, motion_at, span_of


class PrescribedMotions(Mechanism):
    """Bodies whose motion is given."""

    name = "bodies of given motion"
    modes = frozenset({Mode.ONE_LANE, Mode.REGISTERS, Mode.LOCATED})

    def there(self, model: Model) -> bool:
        return bool(model.network.prescribed)

    def bodies(self, model: Model) -> np.ndarray:
        return ~model.bodies.free

    def refuse(self, model: Model, method: Method) -> None:
        refuse_unless(method.takes_response and "force" in method.handles, self, model, method)

    def given_motions(self, model: Model) -> tuple[tuple[int, Excitation], ...]:
        slots = np.flatnonzero(~model.bodies.free).tolist()
        return tuple(zip(slots, model.network.prescribed.values(), strict=True))

    def loads(self, model: Model) -> Iterator[Load]:
        """Yield what linear couplings to bodies of given motion do to the others."""
        linear, free = np.asarray(model.couplings.linear.any(axis=0)), model.bodies.free
        if not linear.any():
            return
        links = model.coupled.chosen(linear)
        stiffness, damping = (links.springs(strength) for strength in model.couplings.linear[:, linear])
        for slot, function in self.given_motions(model):
            bodies = np.flatnonzero(free & ((stiffness[:, slot] != 0.0) | (damping[:, slot] != 0.0)))
            yield Load(bodies, function, -stiffness[bodies, slot], -damping[bodies, slot], function.acts_between)

    def sudden_energies(self, model: Model, begin: float, end: float) -> np.ndarray:
        """Return ``m v²`` of bodies that contacts or couplings join to one of given motion, at twice its largest speed.

        An elastic collision gives twice the speed. Bodies of given motion have no energy of their own.
        """
        moved = np.zeros(model.wall + 1)
        of_links = [model.links.slots[model.links.rows == row] for row in range(len(model.links))]
        for slot, displacement in self.given_motions(model):
            speed = _largest_speed(model, displacement, begin, end)
            for slots in (slots for slots in of_links if slot in slots):
                others = slots[slots < model.wall]
                moved[others] = np.maximum(moved[others], 2.0 * model.mass[others] * speed**2)
        return np.where(model.bodies.free, moved[:-1], 0.0)


@kept
def _largest_speed(model: Model, displacement: Excitation, begin: float, end: float) -> float:
    """Return the largest speed of a given motion (m s-1)."""
    first, last = span_of(displacement, begin, end)
    times = irregular_times(first, last, looks(model))
    _, v = motion_at(lambda at: displacement.call("force", at), displacement, times, (last - first) / LOOKS)
    return float(np.abs(v).max(initial=0.0))
