"""Many datasets as one, over a product of coordinates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr


def gathered(datasets: Sequence[xr.Dataset], coordinates: Mapping[str, xr.Variable]) -> xr.Dataset:
    """Return datasets over a product of coordinates, the last of which varies fastest, as one dataset.

    The coordinates become its first dimensions. What a dataset lacks is NaN, or an empty text.
    """
    aligned = xr.align(*datasets, join="outer", copy=False)
    lengths = tuple(len(values) for values in coordinates.values())
    kept: dict[Any, Any] = {}
    indexes: dict[Any, xr.Variable] = {}
    further = set()
    for name in dict.fromkeys(name for dataset in aligned for name in dataset.variables):
        found = [dataset.variables.get(name) for dataset in aligned]
        first = next(variable for variable in found if variable is not None)
        if first.dims == (name,):
            indexes[name] = first
            continue
        values = _joined([None if variable is None else variable.values for variable in found])
        kept[name] = ((*coordinates, *first.dims), values.reshape(lengths + values.shape[1:]), first.attrs)
        if any(name in dataset.coords for dataset in aligned):
            further.add(name)
    return xr.Dataset(kept, {**indexes, **coordinates}).set_coords(further)


def _joined(arrays: list[np.ndarray | None]) -> np.ndarray:
    """Stack arrays; what is missing, or shorter than others, is filled up."""
    known = [array for array in arrays if array is not None]
    shape = tuple(max(lengths) for lengths in zip(*(array.shape for array in known), strict=True))
    if len(known) == len(arrays) and all(array.shape == shape for array in known):
        return np.stack(known)
    text = known[0].dtype.kind not in "fiub"
    result = np.full((len(arrays), *shape), "" if text else np.nan, dtype=object if text else float)
    for place, array in enumerate(arrays):
        if array is not None:
            inside: Any = (place, *map(slice, array.shape), ...)
            result[inside] = array
    return result.astype(str) if text else result
