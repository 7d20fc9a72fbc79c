"""The points of a sweep: their values, networks, options and random numbers."""

from __future__ import annotations

import hashlib
import inspect
import itertools
import json
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr

import impactlab
from impactlab.errors import ImpactLabError, InvalidInput
from impactlab.inputs import finite, shown, suggestion
from impactlab.plan.seed import Seed
from impactlab.results.schema import variables

if TYPE_CHECKING:
    from impactlab import Network

MakeNetwork = Callable[..., "Network | tuple[Network, Mapping[str, Any]]"]

_TAKEN = {
    "oscillator", "contact", "realization", "time", "sample", "status", "reference_status", "warning", "warnings"
}  # fmt: skip
_OPTIONS = [
    name
    for name in inspect.signature(impactlab.simulate).parameters  # type: ignore[has-type]
    if name not in ("network", "rng", "executor", "progress", "out", "checkpoint", "continues", "branch")
]


class Point(NamedTuple):
    """One combination of values: what is simulated there, or why nothing is."""

    key: str
    network: Network | None
    options: dict[str, Any]
    refusal: str = ""


def make_points(
    make_network: MakeNetwork,
    values: Mapping[str, Sequence[Any]],
    labels: Mapping[str, np.ndarray],
    options: Mapping[str, Any],
    seed: Seed,
    common_random_numbers: bool,
) -> tuple[Point, ...]:
    """Return the product of some values, the last varying fastest; see `impactlab.sweep`.

    Names, options and what `make_network` returns are refused where they cannot be used.
    """
    options = _checked_options(options)
    check_called(make_network, tuple(values))
    points = []
    for combination, label in zip(
        itertools.product(*values.values()),
        itertools.product(*(array.tolist() for array in labels.values())),
        strict=True,
    ):
        place = dict(zip(values, combination, strict=True))
        key = ", ".join(f"{name}={value!r}" for name, value in place.items())
        own = seed if common_random_numbers else _seed_at(seed, dict(zip(values, label, strict=True)))
        try:
            made = make_network(**place)
        except ImpactLabError as error:
            points.append(Point(key, None, {}, reason_of(error)))
        else:
            network, changes = _checked(made, key)
            points.append(Point(key, network, {**options, **changes, "rng": own}))
    _check_names(points)
    return tuple(points)


def values_of(name: Any, given: Any) -> list[Any]:
    """Return the values of one name, with plain numbers for those of NumPy; a bad name or none is refused."""
    if not isinstance(name, str) or not name.isidentifier() or name in _TAKEN | set(variables()):
        raise InvalidInput(
            f"A sweep cannot have a dimension {name!r}, which is reserved or no identifier: rename the argument."
        )
    if isinstance(given, xr.DataArray):
        given = given.values
    if isinstance(given, str | Mapping | set) or not hasattr(given, "__iter__"):
        raise InvalidInput(f"The values of {name!r} must be a list, not {given!r}.")
    values = [item.item() if isinstance(item, np.generic) else item for item in given]
    if not values:
        raise InvalidInput(f"The sweep has no values of {name!r}; give at least one.")
    return values


def labels_of(name: str, values: list[Any]) -> np.ndarray:
    """Return the labels of values: numbers and texts themselves, the text of anything else; none may be twice."""
    kinds = {type(value) for value in values}
    if kinds <= {int, float}:
        numbers = [finite(f"{name}[{index}]", value) for index, value in enumerate(values)]
        labels = np.array(values if kinds == {int} else numbers)
    elif kinds == {bool}:
        labels = np.array(values)
    else:
        labels = np.array([value if isinstance(value, str) else repr(value) for value in values])
    unique, counts = np.unique(labels, return_counts=True)
    if counts.max() > 1:
        raise InvalidInput(f"The sweep has the value {unique[counts.argmax()]} of {name!r} more than once.")
    return labels


def reason_of(outcome: Any) -> str:
    """Return on one line why there is no result, "" if there is one."""
    return " ".join(str(outcome).split()) if isinstance(outcome, ImpactLabError) else ""


def _seed_at(seed: Seed, place: Mapping[str, Any]) -> Seed:
    """Return the seed of a point: a function of its values, whatever the other points are."""
    values = [(name, _plain(value)) for name, value in sorted(place.items())]
    text = json.dumps([*seed, values])
    words = hashlib.sha256(text.encode()).digest()
    return Seed(int.from_bytes(words[:8], "little"), int.from_bytes(words[8:16], "little"))


def _plain(value: Any) -> Any:
    """Return a value as it is written down: 1 like 1.0, but whole numbers that no float holds in full."""
    return value if isinstance(value, str) or float(value) != value else float(value)


def check_called(make_network: Any, names: tuple[str, ...]) -> None:
    """Refuse a function that cannot be called with some names."""
    try:
        inspect.signature(make_network).bind(**dict.fromkeys(names))
    except TypeError as error:
        raise InvalidInput(
            f"make_network cannot be called with the names of the sweep, {', '.join(names)}: {error}."
        ) from None


def _checked_options(options: Mapping[str, Any]) -> dict[str, Any]:
    """Return options of points, with a list of records, which may be given as something that can be read once."""
    for name in options:
        if name not in _OPTIONS:
            raise InvalidInput(f"simulate has no option {name!r} for a point; {suggestion(name, _OPTIONS)}")
    if options.get("record") is not None:
        return {**options, "record": impactlab.Record.all_of(options["record"])}
    return dict(options)


def _checked(made: Any, key: str) -> tuple[Network, Mapping[str, Any]]:
    """Return a network and the options of its point, or refuse what `make_network` returned."""
    network, changes = made if isinstance(made, tuple) and len(made) == 2 else (made, {})
    if not isinstance(network, impactlab.Network) or not isinstance(changes, Mapping):
        raise InvalidInput(
            f"make_network must return an il.Network, or a pair of it and a mapping of options, but at {key} it "
            f"returned {made!r}."
        )
    return network, _checked_options(changes)


def _check_names(points: Sequence[Point]) -> None:
    """Refuse networks whose bodies or contacts have different names: they share no labels."""
    made = [(point.key, point.network) for point in points if point.network is not None]
    for key, network in made[1:]:
        for family in ("oscillators", "contacts"):
            first, other = (list(getattr(item, family)) for item in (made[0][1], network))
            if first != other:
                names, others = shown(first), shown(other)
                raise InvalidInput(
                    f"The {family} of a sweep must have the same names in the same order at all points: they are "
                    f"{names} at {made[0][0]} and {others} at {key}. Sweep over each kind of network by itself."
                )
