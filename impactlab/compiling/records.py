"""Types of records in compiled code, from the annotations of their fields."""

from __future__ import annotations

from functools import cache
from typing import Annotated, Any, NamedTuple, get_type_hints

import numpy as np
from numba import b1, c16, f4, f8, i8, types, u4, u8, void

pointer_to: Any = types.CPointer
"""Type of the address of a value, by the type of the value."""


class Typed(NamedTuple):
    """Types of an annotated field, for blocks and for blocks of one lane."""

    of_lanes: Any
    of_one: Any


def _array(dimensions: int, kind: Any = f8) -> Typed:
    """Return the type of an array, whose last axis is contiguous."""
    return Typed(*[types.Array(kind, dimensions, "C")] * 2)


def _lanes(dimensions: int, kind: Any = f8) -> Typed:
    """Return the types of an array whose last axis are the lanes, of which a block of one lane has none."""
    return Typed(*(types.Array(kind, count, "C") for count in (dimensions, dimensions - 1)))


Numbers = Annotated[np.ndarray, _array(1)]
Table = Annotated[np.ndarray, _array(2)]
Cube = Annotated[np.ndarray, _array(3)]
Phasors = Annotated[np.ndarray, _array(1, c16)]
Slots = Annotated[np.ndarray, _array(1, i8)]
SlotTable = Annotated[np.ndarray, _array(2, i8)]
Streams = Annotated[np.ndarray, _array(2, u8)]
"""Addresses of random numbers, see `impactlab.kernels.random`."""
Realizations = Annotated[np.ndarray, _array(1, u4)]
RealizationTable = Annotated[np.ndarray, _array(2, u4)]

Block = Annotated[np.ndarray, _lanes(2)]
"""State or force, ``[body, lane]`` or ``[contact, lane]``."""
Blocks = Annotated[np.ndarray, _lanes(3)]
BlockTable = Annotated[np.ndarray, _lanes(4)]
Normals = Annotated[np.ndarray, _lanes(3, f4)]
NormalTable = Annotated[np.ndarray, _lanes(4, f4)]

_SCALARS = {float: f8, int: i8, bool: b1}


@cache
def type_of(annotation: Any, single: bool, **others: Any) -> Any:
    """Return the compiler's type of what is annotated so, for blocks or for blocks of one lane.

    Some fields of a record may have `others` than its annotations say.
    """
    for item in getattr(annotation, "__metadata__", ()):
        if isinstance(item, Typed):
            return item.of_one if single else item.of_lanes
    if annotation in _SCALARS:
        return _SCALARS[annotation]
    if not hasattr(annotation, "_fields"):
        raise TypeError(f"A field of a record is annotated {annotation!r}, for which compiled code has no type")
    fields = get_type_hints(annotation, include_extras=True) | others
    items = [type_of(fields[name], single) for name in annotation._fields]
    constructor: Any = types.NamedTuple if len(set(items)) > 1 else types.NamedUniTuple
    return constructor(items, annotation) if len(set(items)) > 1 else constructor(items[0], len(items), annotation)


def signature(single: bool, *annotations: Any) -> Any:
    """Return the type of a compiled function without a result, of what is annotated so or has the compiler's types."""
    return void(*(item if isinstance(item, types.Type) else type_of(item, single) for item in annotations))


def by_address(record: Any, single: bool) -> Any:
    """Return the type of a function that takes the address of a record and an index; see `call` and `part`."""
    return void(pointer_to(type_of(record, single)), i8)


def type_from_python(record: Any, single: bool) -> Any:
    """Return the type of a record as Python hands it over: addresses are numbers."""
    fields = get_type_hints(record, include_extras=True)
    found = {name: getattr(fields[name], "__metadata__", (None,))[0] for name in fields}
    addresses = {name for name, item in found.items() if isinstance(item, Typed) and _is_address(item.of_lanes)}
    return type_of(record, single, **dict.fromkeys(addresses, int))


def _is_address(kind: Any) -> bool:
    return isinstance(kind, pointer_to)


def address(record: Any) -> Any:
    """Return the annotation of a field that is the address of a record."""
    return Annotated[Any, Typed(*(pointer_to(type_of(record, single)) for single in (False, True)))]
