"""What calls ask for, as data that JSON can hold."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from typing import Any

from impactlab.errors import InvalidInput


def plain_data(value: Any) -> Any:
    """Return components, arrays, paths and earlier results as data that JSON can hold; refuse what is none."""
    if hasattr(value, "data_vars"):  # an earlier result
        return {"digest": _digest(value)}
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


def _digest(dataset: Any) -> str:
    """Return a digest of the variables of a dataset."""
    result = hashlib.sha256()
    for name, variable in sorted(dataset.variables.items()):
        result.update(f"{name} {variable.dims} {variable.dtype.str}".encode())
        result.update(variable.values.tobytes())
    return result.hexdigest()
