"""The two sides of a contact or a coupling: names of bodies, combinations of them, or the wall."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, NamedTuple

from impactlab.errors import InvalidInput
from impactlab.inputs import checked


class Wall:
    """The fixed body at ``x = 0`` that a contact may have on one side.

    Examples
    --------
    >>> il.Contact("a", il.WALL, il.HertzContact(1e4), clearance=0.1)
    Contact('a', WALL, HertzContact(stiffness=10000.0), clearance=0.1)
    """

    def __repr__(self) -> str:
        return "WALL"

    def __reduce__(self) -> str:
        return "WALL"

    def to_dict(self) -> dict[str, Any]:
        """Return plain data that stand for it."""
        return dict(_WALL_DATA)


WALL = Wall()

_WALL_DATA, _COMBINATION = {"wall": True}, "combination"


@checked
@dataclass(frozen=True, init=False, repr=False)
class Combination:
    """A point whose displacement is a weighted sum of those of bodies, ``Σ w x``, as a side of a contact or a coupling.

    A force on the point acts on each body with its weight, so that it does the same work: the end of a lever, a point
    of a beam between two others, a deflection in the shape of a mode.

    Parameters
    ----------
    weights : mapping of str to float
        Weight of each body, or point of a structure, by its name.

    Raises
    ------
    InvalidInput
        If there is no weight, or one is 0 or not finite.

    Examples
    --------
    >>> il.Contact(il.Combination({"left": 1.5, "right": -0.5}), il.WALL, il.HertzContact(1e4))
    Contact(Combination({'left': 1.5, 'right': -0.5}), WALL, HertzContact(stiffness=10000.0), clearance=0.0)
    """

    weights: tuple[tuple[str, float], ...]

    def __init__(self, weights: Mapping[str, float]) -> None:
        if not weights:
            raise InvalidInput(
                "A Combination needs a weight for at least one body, such as "
                f'il.Combination({{"a": 1.0, "b": -0.5}}), not {weights!r}.'
            )
        for name, weight in weights.items():
            if not name:
                raise InvalidInput("Combination: a weight belongs to the name of a body, not to ''.")
            if not weight:
                raise InvalidInput(f"Combination: the weight of {name!r} must not be 0; leave it out.")
        object.__setattr__(self, "weights", tuple((name, float(weight)) for name, weight in weights.items()))

    def __repr__(self) -> str:
        return f"Combination({dict(self.weights)!r})"

    def __reduce__(self) -> tuple[Any, ...]:
        return Combination, (dict(self.weights),)

    def to_dict(self) -> dict[str, Any]:
        """Return plain data that stand for it."""
        return {_COMBINATION: dict(self.weights)}


Side = str | Combination | Wall


class Direction(NamedTuple):
    """The two sides of a round contact along x or y, like the sides of a plain contact."""

    first: Side
    second: Side


def is_round(link: Any) -> bool:
    """Whether a contact acts in a plane."""
    return isinstance(link.first, tuple)


def directions_of(link: Any) -> tuple[Any, ...]:
    """Return the objects that have the sides of a link: the link itself, or both directions of a round contact."""
    return tuple(link.directions) if is_round(link) else (link,)


def weights_of_side(side: Side) -> dict[str, float]:
    """Return the weights of the bodies, or points, in the displacement of a side; a wall has none."""
    if isinstance(side, Combination):
        return dict(side.weights)
    return {side: 1.0} if isinstance(side, str) else {}


def weights_of(link: Any) -> dict[str, float]:
    """Return the weights w of the bodies in ``first − second = w·x`` of a contact or coupling, without those of 0."""
    result = weights_of_side(link.first)
    for name, weight in weights_of_side(link.second).items():
        result[name] = result.get(name, 0.0) - weight
    return {name: weight for name, weight in result.items() if weight}


def bodies_of(link: Any) -> tuple[str, ...]:
    """Return the names of the bodies of a contact or a coupling, those of its first side first."""
    return tuple(dict.fromkeys(name for direction in directions_of(link) for name in weights_of(direction)))


def named_by(link: Any) -> Iterator[str]:
    """Give the names of all bodies that a contact or a coupling names, also of those whose weights cancel."""
    for first, second in ((item.first, item.second) for item in directions_of(link)):
        yield from weights_of_side(first)
        yield from weights_of_side(second)


def is_difference(link: Any) -> bool:
    """Whether both sides of a contact or coupling are bodies, or one is the wall."""
    return not isinstance(link.first, Combination | tuple) and not isinstance(link.second, Combination | tuple)


def are_differences(links: Sequence[Any]) -> bool:
    """Whether all links are differences; see `is_difference`."""
    kinds = {kind for side in ("first", "second") for kind in set(map(type, map(attrgetter(side), links)))}
    return not any(issubclass(kind, Combination | tuple) for kind in kinds)


def check_sides(link: Any) -> None:
    """Refuse sides of a contact or coupling that leave nothing to act on; they may be given as data.

    Combinations that come to one body or to the difference of two are written as such.
    """
    kind = type(link).__name__
    for side in ("first", "second"):
        object.__setattr__(link, side, _side(f"{kind}.{side}", getattr(link, side)))
    if is_difference(link):
        if link.first == link.second:
            raise InvalidInput(
                f"A {kind.lower()} of a body with itself: {link.first!r} was given twice; name two different bodies."
            )
        return
    weights = weights_of(link)
    if not weights:
        raise InvalidInput(
            f"A {kind.lower()} of {link.first!r} with {link.second!r} acts on nothing: no weight is left of their "
            "difference."
        )
    if sorted(weights.values()) in ([1.0], [-1.0], [-1.0, 1.0]):
        named = {weight: name for name, weight in weights.items()}
        object.__setattr__(link, "first", named.get(1.0, WALL))
        object.__setattr__(link, "second", named.get(-1.0, WALL))


def check_directions(contact: Any) -> None:
    """Refuse sides of a round contact that are not two different coordinates each; they may be given as data."""
    kind = type(contact).__name__
    for name in ("first", "second"):
        place, given = f"{kind}.{name}", getattr(contact, name)
        if name == "second" and (given is WALL or (isinstance(given, Mapping) and dict(given) == _WALL_DATA)):
            object.__setattr__(contact, name, WALL)
            continue
        if not isinstance(given, tuple) or len(given) != 2:
            other = " or il.WALL" if name == "second" else ""
            raise InvalidInput(
                f'{place} must be the two coordinates x and y, such as ("rotor.x", "rotor.y"){other}, not {given!r}.'
            )
        sides = tuple(_side(place, side) for side in given)
        if sides[0] == sides[1] or WALL in sides:
            wrong = "the wall" if WALL in sides else f"twice {sides[0]!r}"
            raise InvalidInput(f"{place} must be two different coordinates, x and y; {wrong} was given.")
        object.__setattr__(contact, name, sides)
    for direction in contact.directions:
        if not weights_of(direction):
            raise InvalidInput(
                f"A round contact of {direction.first!r} with {direction.second!r} acts on nothing: no weight is left "
                "of their difference."
            )


def _side(place: str, side: Any) -> Side:
    if isinstance(side, Mapping) and dict(side) == _WALL_DATA:
        return WALL
    if isinstance(side, Mapping) and set(side) == {_COMBINATION}:
        return Combination(side[_COMBINATION])
    if not isinstance(side, str | Wall | Combination) or side == "":
        raise InvalidInput(f"{place} must be the name of a body, an il.Combination or il.WALL, not {side!r}.")
    return side
