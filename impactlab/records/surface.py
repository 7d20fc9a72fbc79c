"""Surfaces at whose crossings a motion is looked at, and the points in which it meets them."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np

from impactlab.components.component import Component
from impactlab.components.fields import parameter
from impactlab.errors import InvalidInput

WHOLE = 1e-9
"""Part of a period up to which the time of a look is a whole number of periods."""


class Surface(Component):
    """A surface in the space of states and time, at whose crossings a motion is looked at."""

    @property
    def inwards(self) -> bool:
        """Whether it is met where a contact closes, or where a level is crossed upwards."""
        return False


class Strobe(Surface):
    """The times ``start + k period``, such as those of one phase of a force.

    Parameters
    ----------
    period : float
        Time between looks (s).
    start : float
        Time of the first look (s); a whole number of periods earlier or later is the same surface.

    Examples
    --------
    >>> il.Strobe(0.5)
    Strobe(period=0.5)
    """

    period: float = parameter(units="s", above=0.0)
    start: float = parameter(0.0, units="s")

    @property
    def first(self) -> float:
        """Time of the first look from t = 0 on (s)."""
        early = math.floor(self.start / self.period * (1.0 + WHOLE))
        first = self.start - early * self.period
        return first if first > WHOLE * self.period else 0.0

    def first_from(self, begin: float) -> float:
        """Return the time of the first look of a run (s): one at the end of an earlier run belongs to that."""
        turns = (begin - self.first) / self.period
        number = math.ceil(turns * (1.0 - WHOLE)) if begin <= 0.0 else math.floor(turns * (1.0 + WHOLE)) + 1
        return self.first + self.period * max(number, 0)


class AtContact(Surface):
    """The times at which a contact closes, or opens.

    Parameters
    ----------
    contact : str
        Name of a contact.
    side : str
        "closing", with the state just before, or "leaving", with the state just after a rigid contact has bounced or
        a soft one has opened.

    Examples
    --------
    >>> il.AtContact("stop")
    AtContact(contact='stop')
    """

    contact: str = parameter()
    side: str = parameter("closing", kw_only=False)

    sides: ClassVar[tuple[str, ...]] = "closing", "leaving"

    def __post_init__(self) -> None:
        super().__post_init__()
        _one_of(self, "side", self.sides)

    @property
    def inwards(self) -> bool:
        return self.side == "closing"


class Crossing(Surface):
    """The times at which the displacement of a body crosses a level.

    Parameters
    ----------
    body : str
        Name of a body or coordinate.
    level : float
        Displacement (m).
    direction : str
        "up" or "down".

    Examples
    --------
    >>> il.Crossing("a", 0.0, "up")
    Crossing(body='a')
    """

    body: str = parameter()
    level: float = parameter(0.0, units="m", kw_only=False)
    direction: str = parameter("up", kw_only=False)

    directions: ClassVar[tuple[str, ...]] = "up", "down"

    def __post_init__(self) -> None:
        super().__post_init__()
        _one_of(self, "direction", self.directions)

    @property
    def inwards(self) -> bool:
        return self.direction == "up"


def _one_of(item: Component, field: str, known: tuple[str, ...]) -> None:
    """Refuse a value of a field that is not one of those known."""
    given = getattr(item, field)
    if given not in known:
        raise InvalidInput(f"{type(item).__name__}: {field} is {' or '.join(map(repr, known))}, not {given!r}.")


class SectionPoints:
    """The points of a section of some realizations: time, velocity of the contact, displacements and velocities.

    Parameters
    ----------
    keep : int, optional
        The last points of each realization that are kept.
    most : int
        How many points may be kept in all.
    """

    def __init__(self, keep: int | None, most: int) -> None:
        self.keep, self.most, self.count = keep, most, 0
        self.parts: list[tuple[np.ndarray, np.ndarray]] = []

    def take(self, lanes: np.ndarray, values: np.ndarray) -> None:
        """Take the next points, (point, column), of the realizations with some numbers, (point,)."""
        self.parts.append((lanes, values))
        self.count += len(lanes)
        if self.count > (self.most if self.keep is None else 2 * self.most):
            self.parts = [self._kept()]
            self.count = len(self.parts[0][0])
            if self.count > self.most:
                raise InvalidInput(
                    f"Section: there are more than {self.most} points; give keep=, the last points of each "
                    "realization that are kept, or a larger most=."
                )

    def _kept(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the points that are kept, in the order of realizations, and within each of time."""
        lanes, values = (np.concatenate(items) for items in zip(*self.parts, strict=True))
        order = np.argsort(lanes, kind="stable")
        lanes, values = lanes[order], values[order]
        if self.keep is not None:
            behind = np.searchsorted(lanes, lanes, side="right") - np.arange(len(lanes))
            lanes, values = lanes[behind <= self.keep], values[behind <= self.keep]
        return lanes, values

    def result(self, realizations: int, columns: int) -> dict[str, np.ndarray]:
        """Return how many points each realization has, and all of them."""
        if not self.parts:
            return {"sizes": np.zeros(realizations, np.int64), "values": np.zeros((0, columns))}
        lanes, values = self._kept()
        return {"sizes": np.bincount(lanes, minlength=realizations), "values": values}
