"""Records in memory of their own, for compiled functions that take their addresses."""

from __future__ import annotations

import hashlib
import sys
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from impactlab.compiling.intrinsics import write_at
from impactlab.compiling.jit import Function, composed, loop, part
from impactlab.compiling.records import by_address, signature, type_from_python
from impactlab.compiling.scalars import DISABLED
from impactlab.compiling.single import text_of


class Stored:
    """A record in memory of its own, which holds its arrays.

    Parameters
    ----------
    record : NamedTuple
        Where its first field is an address, which then is 0, compiled code may change it by `write_at`.
    single : bool
        Whether it is a record of a block of one lane.
    """

    def __init__(self, record: Any, single: bool) -> None:
        self._single, self._kind = single, type_from_python(type(record), single)
        self._given, self._held = record, SimpleNamespace() if DISABLED else None
        # 16 words of 8 bytes for each field: an array of five axes has 15
        self._memory = np.zeros(0 if DISABLED else 16 * _fields(record), dtype=np.int64)
        self._write()

    @property
    def address(self) -> Any:
        """Address of the record; where nothing is compiled, an object with its fields, which may be set."""
        return self._held if DISABLED else self._memory.ctypes.data

    def change(self, **fields: Any) -> None:
        """Change some fields of the record."""
        self._given = self._given._replace(**fields)
        self._write()

    def _write(self) -> None:
        record = without_lane(self._given, self._kind) if self._single else self._given
        if DISABLED:
            vars(self._held).update(record._asdict())
        else:
            own: Any = type(record)
            loop(signature(self._single, self._kind, int), _writing(own))(record, self.address)
            self._held = record  # as long as its memory is read


@cache
def function_of(record: Any, function: Function | None, single: bool) -> Any:
    """Return the address of a function that takes the address of a record, for blocks or for blocks of one lane."""
    return 0 if function is None else part(by_address(record, single), text_of(function, single))[1]


def without_lane(item: Any, kind: Any) -> Any:
    """Return an argument without the axis of its one lane where its type has none."""
    if isinstance(item, np.ndarray):
        return item[..., 0] if item.ndim > kind.ndim else item
    return type(item)(*map(without_lane, item, kind)) if isinstance(item, tuple) else item


@cache
def _writing(record: Any) -> Function:
    """Return what writes a record, under a name of its own: a process must not load the machine code for the records of
    modules that it has not.
    """
    file = getattr(sys.modules[record.__module__], "__file__", None)
    version = hashlib.sha256(f"{file} {record.__module__} {record.__qualname__}".encode()).hexdigest()[:12]
    return composed(_write, version)


def _write(record, place):  # type: ignore[no-untyped-def]
    write_at(record, place)


def _fields(record: Any) -> int:
    """Return the number of arrays and numbers of a record and its records."""
    return sum(map(_fields, record)) if isinstance(record, tuple) else 1
