"""The two sides of a contact or a coupling: names of bodies, or the wall."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from impactlab.errors import InvalidInput


class Wall:
    """The fixed body at ``x = 0`` that a contact may have on one side."""

    def __repr__(self) -> str:
        return "WALL"

    def __reduce__(self) -> str:
        return "WALL"


WALL = Wall()

_WALL_DATA = {"wall": True}


def check_sides(link: Any) -> None:
    """Refuse sides of a contact or coupling that are not two bodies, or one and WALL, which may be given as data."""
    kind = type(link).__name__
    for side in ("first", "second"):
        body = getattr(link, side)
        if isinstance(body, Mapping) and dict(body) == _WALL_DATA:
            object.__setattr__(link, side, WALL)
        elif not isinstance(body, str | Wall) or body == "":
            raise InvalidInput(f"{kind}.{side} must be the name of a body or il.WALL, not {body!r}.")
    if link.first == link.second:
        raise InvalidInput(
            f"A {kind.lower()} of a body with itself: {link.first!r} was given twice; name two different bodies."
        )


def plain_sides(data: dict[str, Any]) -> dict[str, Any]:
    """Return the data of a contact or coupling with plain data in the place of WALL."""
    return {name: dict(_WALL_DATA) if value is WALL else value for name, value in data.items()}
