"""Sections: the states of a network at the times at which its motion meets a surface."""

from __future__ import annotations

from typing import ClassVar

from impactlab.components.component import Component
from impactlab.components.fields import parameter
from impactlab.errors import InvalidInput


class Surface(Component):
    """A surface in the space of states and time, at whose crossings a motion is looked at."""


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


def _one_of(item: Component, field: str, known: tuple[str, ...]) -> None:
    """Refuse a value of a field that is not one of those known."""
    given = getattr(item, field)
    if given not in known:
        raise InvalidInput(f"{type(item).__name__}: {field} is {' or '.join(map(repr, known))}, not {given!r}.")
