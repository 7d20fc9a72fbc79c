"""What calls ask for, as data that JSON can hold, and digests of it."""

from __future__ import annotations

import dataclasses
import enum
import hashlib
import os
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from impactlab.errors import InvalidInput


def plain_data(value: Any) -> Any:
    """Return components, arrays, paths and earlier results as data that JSON can hold; refuse what is none."""
    if hasattr(value, "data_vars"):  # an earlier result
        return {"digest": digest(value)}
    if hasattr(value, "to_dict"):  # components and networks
        return plain_data(value.to_dict())
    if isinstance(value, Mapping):
        return {str(key): plain_data(item) for key, item in value.items()}
    if isinstance(value, list | tuple | range):
        return [plain_data(item) for item in value]
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if hasattr(value, "tolist"):  # of NumPy
        return plain_data(value.tolist())
    if value is None or isinstance(value, bool | int | float | str):
        return value
    raise InvalidInput(f"Only plain data can be kept and compared, not {value!r}.")


def digest(value: Any) -> str:
    """Return a digest of a description, nested data, arrays and objects: equal in all processes for equal content."""
    result = hashlib.sha256()
    _add(value, result.update)
    return result.hexdigest()[:32]


def _add(value: Any, give: Callable[[bytes], None]) -> None:
    """Give what tells a value from others, as bytes."""
    if isinstance(value, np.ndarray) and value.dtype != object:
        give(f"{value.dtype.str}{value.shape}".encode())
        give(np.ascontiguousarray(value).tobytes())
    elif value is None or isinstance(value, bool | int | float | complex | str | np.generic | enum.Enum):
        give(f"{type(value).__name__} {value!r};".encode())
    elif hasattr(value, "data_vars"):
        _add([(name, item.dims, item.values) for name, item in sorted(value.variables.items())], give)
    elif isinstance(value, list | tuple):
        give(f"{len(value)}(".encode())
        for item in value:
            _add(item, give)
    elif isinstance(value, Mapping):
        give(f"{len(value)}{{".encode())
        for key, item in value.items():
            _add(key, give)
            _add(item, give)
    elif isinstance(value, set | frozenset):
        give("".join(sorted(map(repr, value))).encode())
    elif hasattr(value, "__qualname__"):  # functions and classes
        give(f"{value.__module__}.{value.__qualname__};".encode())
    elif dataclasses.is_dataclass(value):
        give(f"{type(value).__qualname__}(".encode())
        for field in dataclasses.fields(value):
            _add(getattr(value, field.name), give)
    else:
        give(f"{type(value).__qualname__}(".encode())
        _add(value.__reduce_ex__(4)[1:3], give)
