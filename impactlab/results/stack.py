"""Many datasets as one, over a product of coordinates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from impactlab.results.labels import Variables


class Findings(NamedTuple):
    """What a dataset holds, in plain arrays: many become one dataset sooner than datasets do."""

    variables: Variables
    coordinates: Variables
    attributes: dict[str, Any]

    @classmethod
    def of(cls, dataset: xr.Dataset) -> Findings:
        """Return what a dataset holds."""
        parts: list[Any] = [
            {name: (item.dims, item.values, item.attrs) for name, item in family.items()}
            for family in (dataset.data_vars, dataset.coords)
        ]
        return cls(parts[0], parts[1], dataset.attrs)

    def dataset(self) -> xr.Dataset:
        """Return it as a dataset."""
        return xr.Dataset(self.variables, self.coordinates, self.attributes)

    def everything(self) -> Variables:
        """Return coordinates and variables."""
        return {**self.coordinates, **self.variables}

    def indexes(self) -> Variables:
        """Return the labels of dimensions."""
        return {name: item for name, item in self.coordinates.items() if item[0] == (name,)}


def gathered(results: Sequence[xr.Dataset | Findings], coordinates: Mapping[str, xr.Variable]) -> xr.Dataset:
    """Return results over a product of coordinates, the last of which varies fastest, as one dataset.

    The coordinates become its first dimensions. What a result lacks is NaN, or an empty text.
    """
    found = [Findings.of(item) if isinstance(item, xr.Dataset) else item for item in results]
    if not _labels_agree(found):
        found = [Findings.of(item) for item in xr.align(*(item.dataset() for item in found), join="outer", copy=False)]
    lengths = tuple(len(values) for values in coordinates.values())
    kept: dict[Any, Any] = {}
    indexes: dict[Any, Any] = {}
    further = {name for item in found for name in item.coordinates}
    every = [item.everything() for item in found]
    for name in dict.fromkeys(name for item in every for name in item):
        of_name = [item.get(name) for item in every]
        first = next(variable for variable in of_name if variable is not None)
        dimensions, _, attributes = first
        if dimensions == (name,):
            indexes[name] = first
            continue
        values = _joined([None if variable is None else np.asarray(variable[1]) for variable in of_name])
        kept[name] = ((*coordinates, *dimensions), values.reshape(lengths + values.shape[1:]), attributes)
    return xr.Dataset(kept, {**indexes, **coordinates}).set_coords(further & kept.keys())


def _labels_agree(found: Sequence[Findings]) -> bool:
    """Whether all results that have a dimension label it alike."""
    known: Variables = {}
    for item in found:
        for name, variable in item.indexes().items():
            if not np.array_equal(known.setdefault(name, variable)[1], variable[1]):
                return False
    return True


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
