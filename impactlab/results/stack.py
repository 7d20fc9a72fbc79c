"""Many datasets as one, over a product of coordinates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from impactlab.results.labels import Variables

DONE = "done"
"""Status of a point of a sweep that was simulated."""


class Findings(NamedTuple):
    """What a dataset holds, in plain arrays: many become one dataset sooner than datasets do."""

    variables: Variables
    coordinates: Variables
    attributes: dict[str, Any]

    @classmethod
    def of(cls, dataset: xr.Dataset) -> Findings:
        """Return the variables and attributes of a dataset."""
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


class Shared:
    """Holds what many results have in common, such as attributes and labels, only once."""

    def __init__(self) -> None:
        self._known: Variables = {}

    def __call__(self, found: Findings) -> Findings:
        """Return a result with the objects of earlier ones where these are equal."""
        return found._replace(variables=self._of(found.variables), coordinates=self._of(found.coordinates))

    def _of(self, family: Variables) -> Variables:
        return {name: self._one(name, *item[:3]) for name, item in family.items()}

    def _one(self, name: str, dimensions: Any, values: Any, attributes: dict[str, Any]) -> Any:
        known = self._known.setdefault(name, (dimensions, values, attributes))
        texts = all(isinstance(item, str) for item in attributes.values())
        return (
            known[0] if dimensions == known[0] else dimensions,
            known[1] if _equal(values, known[1]) else values,
            known[2] if texts and attributes == known[2] else attributes,
        )


def _equal(one: Any, other: Any) -> bool:
    """Whether two variables have the same values, of the same kind."""
    same = isinstance(one, np.ndarray) and isinstance(other, np.ndarray) and one.dtype == other.dtype
    return same and np.array_equal(one, other)


def gathered(results: Sequence[xr.Dataset | Findings], coordinates: Mapping[str, xr.Variable]) -> xr.Dataset:
    """Return results over a product of coordinates, the last of which varies fastest, as one dataset.

    The coordinates become its first dimensions. What a result lacks is NaN, or an empty text. Where samples of the same
    number are at different places of an axis, such as time, the dimension is their number, see `number_of`, and the
    places are a coordinate that depends on the result, too.
    """
    found = [Findings.of(item) if isinstance(item, xr.Dataset) else item for item in results]
    common, own = _axes(found)
    found = [_numbered(item, own) for item in found]
    if not _labels_agree(found, common):
        of_each = [item.dataset() for item in found]
        others = {name for item in of_each for name in item.dims if name in common or name not in item.coords}
        found = [Findings.of(item) for item in xr.align(*of_each, join="outer", exclude=others, copy=False)]
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
            indexes[name] = common.get(name, first)
            continue
        values = _joined([None if variable is None else np.asarray(variable[1]) for variable in of_name])
        kept[name] = ((*coordinates, *dimensions), values.reshape(lengths + values.shape[1:]), attributes)
    return xr.Dataset(kept, {**indexes, **coordinates}).set_coords(further & kept.keys())


def number_of(axis: str) -> str:
    """Return the dimension of the number of a sample along an axis such as that of time."""
    return "sample" if axis == "time" else f"{axis}_number"


def on_own_axes(dataset: xr.Dataset) -> xr.Dataset:
    """Return a point of a sweep with its samples along axes, as a simulation has them, and none of other points."""
    for dimension in [str(name) for name in dataset.dims if name not in dataset.coords]:
        along = [item for item in dataset.variables.values() if dimension in item.dims and item.dtype.kind == "f"]
        length = max((_filled(item, dimension) for item in along), default=dataset.sizes[dimension])
        if length < dataset.sizes[dimension]:
            dataset = dataset.isel({dimension: slice(length)})
    axes = {number_of(str(name)): name for name in dataset.coords if dataset[name].dims == (number_of(str(name)),)}
    return dataset.swap_dims(axes)


def _filled(variable: xr.Variable, dimension: str) -> int:
    """Return how many places there are along a dimension up to the last that is not empty."""
    length = variable.sizes[dimension]
    if length and bool(variable.isel({dimension: -1}).notnull().any()):
        return length
    others = [name for name in variable.dims if name != dimension]
    return int(np.flatnonzero(variable.notnull().any(others)).max(initial=-1)) + 1


def _axes(found: Sequence[Findings]) -> tuple[Variables, set[str]]:
    """Return the axes along which a sample has the same place in all results, and the names of the others."""
    axes: dict[str, list[Any]] = {}
    for item in found:
        for name, variable in item.indexes().items():
            if np.asarray(variable[1]).dtype.kind == "f":
                axes.setdefault(name, []).append(variable)
    common = {name: max(several, key=lambda variable: len(variable[1])) for name, several in axes.items()}
    own = {
        name
        for name, (_, longest, _) in common.items()
        # places that differ by less differ by rounding alone
        if not all(np.allclose(longest[: len(some)], some, rtol=1e-12, atol=0.0) for _, some, _ in axes[name])
    }
    return {name: variable for name, variable in common.items() if name not in own}, own


def _numbered(found: Findings, own: set[str]) -> Findings:
    """Return a result with numbers of samples in place of some axes."""
    if own.isdisjoint(found.coordinates):
        return found
    renamed = {name: number_of(name) for name in own}
    variables, coordinates = (
        {name: (tuple(renamed.get(one, one) for one in item[0]), item[1], item[2]) for name, item in family.items()}
        for family in (found.variables, found.coordinates)
    )
    return Findings(variables, coordinates, found.attributes)


def _labels_agree(found: Sequence[Findings], axes: Variables) -> bool:
    """Whether all results that have a dimension, axes aside, label it alike."""
    known: Variables = {}
    for item in found:
        for name, variable in item.indexes().items():
            if name not in axes and not np.array_equal(known.setdefault(name, variable)[1], variable[1]):
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
