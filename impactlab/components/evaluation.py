"""Kernels evaluated in Python: what they return, at which states, and for many components at once."""

from __future__ import annotations

import functools
import itertools
import math
import operator
from collections.abc import Callable, Iterable, Sequence
from numbers import Number
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    import numpy as np

UPDATE, ELAPSED = "update", "elapsed"
"""Kernel that returns the states of a law, and its argument of time: how long ago those that it takes were accepted."""

TIME = "time"
"""Argument of a kernel that is the time since the beginning of the measurement (s), the last of the kinematic ones."""

NUMBERS = (int, float, Number)
"""Types of numbers, NumPy's included; Python's truth values are instances too."""

Found = tuple[Callable[..., float], tuple[str, ...], tuple[str, ...]]
"""A kernel with the names of its kinematic arguments and of its fields."""

ERRORS = ArithmeticError, AttributeError, LookupError, NameError, TypeError, ValueError
"""What a kernel may raise where it is not defined, or wrong."""

Item = TypeVar("Item")
Answer = TypeVar("Answer")


def by_name(names: Sequence[str], kinematic: Sequence[Any]) -> dict[str, Any]:
    """Return kinematic arguments by their names; the time is 0 where it is left out."""
    left_out = names[len(kinematic) :] == (TIME,)
    return dict(zip(names, (*kinematic, 0.0) if left_out else kinematic, strict=True))


def of_classes(function: Callable[[type[Any]], Answer], items: Iterable[Any]) -> list[Answer]:
    """Return what a function says of the class of each item; it is asked once for each class."""
    classes = list(map(type, items))
    known = {cls: function(cls) for cls in dict.fromkeys(classes)}
    return [*known.values()] * len(classes) if len(known) == 1 else list(map(known.__getitem__, classes))


def of_objects(function: Callable[[Item], Answer], items: Sequence[Item]) -> list[Answer]:
    """Return what a function says of each item; it is asked once for each object."""
    if are_one(items):
        return [function(items[0])] * len(items)
    keys = list(map(id, items))
    known = {key: function(item) for key, item in dict(zip(keys, items, strict=True)).items()}
    return list(map(known.__getitem__, keys))


def are_one(items: Sequence[Any]) -> bool:
    """Whether there are items, and all of them are one object."""
    return len(items) > 0 and all(map(operator.is_, items, itertools.repeat(items[0])))


def call_each(components: Sequence[Any], name: str, *kinematic: np.ndarray) -> np.ndarray:
    """Evaluate a kernel of many components of any classes in Python, each on its row of arrays, (component, point).

    The arrays are all kinematic arguments of the family's kernel, in order; see `by_name`. The result is NaN where a
    function of Python overflows or is not defined, which compiled ones do not tell.
    """
    import numpy as np  # studies are listed without it

    result: np.ndarray = np.empty(np.broadcast_shapes(*(item.shape for item in kinematic)))
    # equal components are looked for where each has few points
    if len(components) > 1 and result.shape[1] <= 4:
        arrays = [np.broadcast_to(item, result.shape) for item in kinematic]
        first, which = distinct(components, arrays)
        if len(first) < len(components):
            result[:] = call_each([components[row] for row in first], name, *(item[first] for item in arrays))[which]
            return result
    by_class: dict[Any, list[int]] = {}
    for row, component in enumerate(components):
        by_class.setdefault(type(component), []).append(row)
    # numbers of Python at a time, which take much memory
    most = max(1, 1_000_000 // max(1, result.shape[1]))
    parts = [(cls, all_[k : k + most]) for cls, all_ in by_class.items() for k in range(0, len(all_), most)]
    for cls, rows in parts:
        function, used, fields = cls.kernel(name)
        values = by_name(cls.kernels[name], kinematic)
        shape = len(rows), result.shape[1]
        columns = [np.broadcast_to(values[item], result.shape)[rows].ravel().tolist() for item in used]
        for field in fields:
            columns.append([value for row in rows for value in [getattr(components[row], field)] * shape[1]])
        if (floats := floats_of(function, columns)) is not None:
            result[rows] = np.array(floats).reshape(shape)
            continue
        points = zip(*columns, strict=True) if columns else itertools.repeat((), shape[0] * shape[1])
        try:
            result[rows] = np.fromiter(itertools.starmap(_without_overflow(function), points), float).reshape(shape)
        except ERRORS:
            for row in rows:  # which says what is wrong, and where
                components[row].call(name, *(np.broadcast_to(item, result.shape)[row] for item in kinematic))
            raise
    return result


def floats_of(function: Callable[..., float], columns: Sequence[Iterable[Any]]) -> list[float] | None:
    """Return a function of the rows of columns; None without columns, or where a value is no float or an error."""
    if not columns:
        return None
    try:
        found = list(map(function, *columns))
    except ERRORS:
        return None
    return found if set(map(type, found)) <= {float} else None


def distinct(components: Sequence[Any], arrays: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return the first of all components that are the same with the same numbers, and which of these each one is.

    The arrays are (component,) or (component, point); what is first comes first.
    """
    import numpy as np  # studies are listed without it

    columns = [column for item in arrays for column in (item.T if item.ndim > 1 else [item])]
    varying = [column for column in columns if (column != column[:1]).any()]
    if components and not are_one(components):
        varying.append(np.fromiter(map(id, components), np.float64, len(components)))  # addresses have 48 bits
    if not varying:
        return np.arange(min(len(components), 1)), np.zeros(len(components), dtype=np.int64)
    order = np.lexsort(varying)
    new = np.append(True, np.logical_or.reduce([column[order[1:]] != column[order[:-1]] for column in varying]))
    first, place = order[new], np.empty(np.count_nonzero(new), dtype=np.int64)
    by_place = np.argsort(first)
    place[by_place] = np.arange(len(first))
    which = np.empty(len(components), dtype=np.int64)
    which[order] = place[np.cumsum(new) - 1]
    return first[by_place], which


def _without_overflow(function: Callable[..., float]) -> Callable[..., float]:
    def guarded(*arguments: Any) -> float:
        try:
            value = function(*arguments)
        except (OverflowError, ValueError):  # as of math.sqrt
            return math.nan
        return value if type(value) is float else number_of(value)

    return guarded


def number_of(value: Any) -> float:
    """Return what a kernel returned as a float."""
    if value is None:
        raise TypeError("it returned None; every branch must return a number")
    if not isinstance(value, NUMBERS) and type(value).__name__ != "bool":  # NumPy's truth values
        raise TypeError(f"it returned {value!r}, not a number")
    return float(value)


def _at_new_states_of(cls: Any, name: str) -> Found:
    """Return a kernel that reads states as `Component.kernel` does: those that hold just after a start."""
    (own, fields), (of_update, of_states) = cls.arguments(name), cls.arguments(UPDATE)
    kinematic = tuple(item for item in cls.kernels[name] if item in (*own, *of_update))
    used = tuple(dict.fromkeys((*fields, *of_states)))
    kernel, update, states = getattr(cls, name), getattr(cls, UPDATE), cls.state_names()

    def at_new_states(*values: Any) -> float:
        known = {**dict(zip((*kinematic, *used), values, strict=True)), ELAPSED: 0.0}
        try:
            new = update(*(known[item] for item in (*of_update, *of_states)))
        except Exception as error:
            error.args = (f"in {UPDATE}: {error}",)
            raise
        known.update(zip(states, (new,) if len(states) == 1 else new, strict=True))
        return kernel(*(known[item] for item in (*own, *fields)))  # type: ignore[no-any-return]

    return at_new_states, kinematic, used


at_new_states: Callable[[Any, str], Found] = functools.cache(_at_new_states_of)
