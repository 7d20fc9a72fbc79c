"""Sweeps: simulations over a product of values as one labelled dataset."""

from __future__ import annotations

import hashlib
import inspect
import itertools
import json
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from impactlab.component import finite, suggestion
from impactlab.dataset import CONFIGURATION, VARIABLES, provenance
from impactlab.errors import ImpactLabError, InvalidInput
from impactlab.gather import gathered
from impactlab.network import Network
from impactlab.progress import reporter
from impactlab.reference import exact
from impactlab.rules import Seed, seed_of
from impactlab.simulation import simulate
from impactlab.together import Job, run_together

DONE = "done"
"""Status of a point that was simulated."""

MakeNetwork = Callable[..., Network | tuple[Network, Mapping[str, Any]]]

_TAKEN = {"oscillator", "contact", "realization", "time", "status", "reference_status", *VARIABLES}
_OPTIONS = [
    name for name in inspect.signature(simulate).parameters if name not in ("network", "rng", "executor", "progress")
]
_UNITS = {"step": "s", "duration": "s", "spin_up": "s", "seconds_spent": "s"}


class Point(NamedTuple):
    """One combination of values: what is simulated there, or why nothing is."""

    key: str
    network: Network | None
    options: dict[str, Any]
    refusal: str = ""


@dataclass(frozen=True, eq=False)
class Sweep:
    """What a sweep simulates, and how its results become one dataset.

    Attributes
    ----------
    coordinates : dict of str to xarray.Variable
        The values by name.
    points : tuple of Point
        Their product; the last name varies fastest.
    reference : bool
        Whether the exact statistics are wanted.
    """

    coordinates: dict[str, xr.Variable]
    points: tuple[Point, ...]
    reference: bool = False

    def jobs(self) -> dict[str, Job]:
        """Return the simulations by the key of their point."""

        def job(point: Point) -> Job:
            return lambda pool, note: simulate(point.network, **point.options, executor=pool, progress=note)  # type: ignore[arg-type]

        return {point.key: job(point) for point in self.points if not point.refusal}

    def dataset(self, outcomes: Mapping[str, xr.Dataset | ImpactLabError]) -> xr.Dataset:
        """Return the outcomes of all points as one dataset; see `sweep`.

        Raises
        ------
        ImpactLabError
            If no point could be simulated.
        """
        refusals = {point.key: point.refusal or _reason(outcomes[point.key]) for point in self.points}
        if all(refusals.values()):
            key, reason = next(iter(refusals.items()))
            error = outcomes.get(key)
            kind = type(error) if isinstance(error, ImpactLabError) else InvalidInput
            raise kind(f"No point of the sweep could be simulated; at {key}: {reason}")
        found = []
        for point in self.points:
            outcome = outcomes.get(point.key)
            result = outcome if isinstance(outcome, xr.Dataset) else xr.Dataset()
            scalars = {
                name: ((), value, {"units": _UNITS.get(name, "1")} if not isinstance(value, str) else {})
                for name, value in result.attrs.items()
                if name not in provenance("", {})
            }
            network = {} if point.network is None else {"network": point.network.to_dict()}
            scalars[CONFIGURATION] = (
                (),
                result.attrs.get(CONFIGURATION, json.dumps(network, sort_keys=True)),
                {"long_name": "what makes the point again"},
            )
            scalars["status"] = ((), refusals[point.key] or DONE, {"long_name": f"{DONE}, or why not"})
            result = result.assign({name: value for name, value in scalars.items() if name not in self.coordinates})
            found.append(result.assign(_reference(point)) if self.reference else result)
        text = {"sweep": {"names": list(self.coordinates), "reference": self.reference}}
        title = f"Statistics of networks of oscillators with contacts over {', '.join(self.coordinates)}"
        return gathered(found, self.coordinates).assign_attrs(provenance(title, text))


def sweep(
    make_network: MakeNetwork,
    over: Mapping[str, Sequence[Any]],
    *,
    reference: bool = False,
    common_random_numbers: bool = False,
    rng: Any = None,
    executor: Executor | None = None,
    progress: bool | Callable[[float], None] | None = None,
    **simulate_options: Any,
) -> xr.Dataset:
    """Simulate networks over a product of values and return one dataset.

    Points that differ in numbers only share one compilation; all share the workers.

    Parameters
    ----------
    make_network : callable
        ``make_network(name=value, ...)`` returns the network of a point, or a pair of it and
        options of `simulate` for this point alone. Bodies and contacts have the same names
        everywhere.
    over : mapping of str to sequence
        Values by name: numbers, texts, components, which their text labels. Every combination is a
        point. Attributes of a DataArray, such as its units, are kept.
    reference : bool
        Whether to add the exact statistics as ``<name>_exact`` where there is an exact law.
    common_random_numbers : bool
        Whether all points have the random numbers that `simulate` has at this `rng`, which makes
        differences between points more accurate. By default the numbers of each follow from `rng`
        and the point's own values, so that it keeps them when values are added to the sweep.
    rng : optional
        Seed, as for `simulate`.
    executor : concurrent.futures.Executor, optional
        Where to run; threads on all cores by default. Numbers never depend on it.
    progress : bool or callable, optional
        As for `simulate`, over all points.
    **simulate_options
        Options of `simulate` for all points.

    Returns
    -------
    xarray.Dataset
        The variables of `simulate` with the names of `over` as first dimensions, NaN at a
        refused point; a point's attributes, such as ``step``, as variables; ``status``, which is
        "done" or the reason why a point was refused or diverged; with `reference` also
        ``reference_status``. A point selected from it can be given to `rerun` and `network_of`.

    Raises
    ------
    InvalidInput
        If something given cannot be used, before anything runs, or every point is refused.
    Diverged
        If no point remained finite.
    """
    made = make_sweep(
        make_network,
        over,
        reference=reference,
        common_random_numbers=common_random_numbers,
        rng=rng,
        **simulate_options,
    )
    alone = any(point.options.get("tolerance") is not None for point in made.points)
    return made.dataset(run_points(made.jobs(), executor, progress, alone))


def run_points(
    jobs: Mapping[str, Job],
    executor: Executor | None,
    progress: bool | Callable[[float], None] | None,
    alone: bool = False,
) -> dict[str, xr.Dataset | ImpactLabError]:
    """Run the jobs of a sweep and return what came of each."""
    outcomes: dict[str, xr.Dataset | ImpactLabError] = {}
    show = reporter(progress)

    def watch(_: str, parts: Mapping[str, float]) -> None:
        part = sum(parts.values()) / len(parts)
        if part < 1.0 or len(outcomes) == len(jobs):  # the end is shown once
            show(part)

    run_together(jobs, outcomes.__setitem__, kind="Point", executor=executor, alone=alone, watch=watch)
    return outcomes


def make_sweep(
    make_network: MakeNetwork,
    over: Mapping[str, Sequence[Any]],
    *,
    reference: bool = False,
    common_random_numbers: bool = False,
    rng: Any = None,
    **options: Any,
) -> Sweep:
    """Make the networks of a sweep and decide its random numbers; nothing is simulated yet.

    Parameters and errors are those of `sweep`.
    """
    _check_options(options)
    if not isinstance(over, Mapping) or not over:
        raise InvalidInput(f'sweep takes values by name, such as {{"clearance": [0.01, 0.05]}}, {over!r} was given.')
    values = {name: _values(name, given) for name, given in over.items()}
    _check_arguments(make_network, tuple(values))
    coordinates = {
        name: xr.Variable(name, _labels(name, items), getattr(over[name], "attrs", {}))
        for name, items in values.items()
    }
    seed = seed_of(rng)
    points = []
    labels = itertools.product(*(coordinate.values.tolist() for coordinate in coordinates.values()))
    for combination, label in zip(itertools.product(*values.values()), labels, strict=True):
        place = dict(zip(values, combination, strict=True))
        key = ", ".join(f"{name}={value!r}" for name, value in place.items())
        own = seed if common_random_numbers else _seed_at(seed, dict(zip(values, label, strict=True)))
        try:
            made = make_network(**place)
        except ImpactLabError as error:
            points.append(Point(key, None, {}, _reason(error)))
        else:
            network, changes = _checked(made, key)
            points.append(Point(key, network, {**options, **changes, "rng": own}))
    _check_names(points)
    return Sweep(coordinates, tuple(points), reference)


def _reason(outcome: xr.Dataset | ImpactLabError) -> str:
    """Return on one line why there is no result, "" if there is one."""
    return " ".join(str(outcome).split()) if isinstance(outcome, ImpactLabError) else ""


def _reference(point: Point) -> dict[str, Any]:
    """Return the exact statistics of a point as variables, and whether there are any."""
    status, found = point.refusal or DONE, {}
    if point.network is not None:
        try:
            statistics = exact(point.network).statistics()
        except ImpactLabError as error:
            status = _reason(error)
        else:
            for name, variable in statistics.data_vars.items():
                attrs = {**variable.attrs, "long_name": f"exact {variable.attrs['long_name']}"}
                found[f"{name}_exact"] = variable.drop_attrs().assign_attrs(attrs)
    return {**found, "reference_status": ((), status, {"long_name": f"{DONE}, or why there is no exact law"})}


def _seed_at(seed: Seed, place: Mapping[str, Any]) -> Seed:
    """Return the seed of a point: a function of its values, whatever the other points are."""
    values = [(name, value if isinstance(value, str) else float(value)) for name, value in sorted(place.items())]
    text = json.dumps([*seed, values])
    words = hashlib.sha256(text.encode()).digest()
    return Seed(int.from_bytes(words[:8], "little"), int.from_bytes(words[8:16], "little"))


def _values(name: Any, given: Any) -> list[Any]:
    """Return the values of one name, with plain numbers for those of NumPy."""
    if not isinstance(name, str) or not name.isidentifier() or name in _TAKEN:
        raise InvalidInput(f"A sweep cannot have a dimension {name!r}: use the name of an argument that is free.")
    if isinstance(given, xr.DataArray):
        given = given.values
    if isinstance(given, str | Mapping | set) or not hasattr(given, "__iter__"):
        raise InvalidInput(f"The values of {name!r} must be a list, {given!r} was given.")
    values = [item.item() if isinstance(item, np.generic) else item for item in given]
    if not values:
        raise InvalidInput(f"The sweep has no values of {name!r}; give at least one.")
    return values


def _labels(name: str, values: list[Any]) -> np.ndarray:
    """Return the labels of values: numbers and texts themselves, the text of anything else."""
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


def _check_arguments(make_network: Any, names: tuple[str, ...]) -> None:
    if not callable(make_network):
        raise InvalidInput(f"sweep takes a function that returns a network, {make_network!r} was given.")
    try:
        inspect.signature(make_network).bind(**dict.fromkeys(names))
    except TypeError as error:
        raise InvalidInput(
            f"make_network cannot be called with the names of the sweep, {', '.join(names)}: {error}."
        ) from None


def _check_options(options: Mapping[str, Any]) -> None:
    for name in options:
        if name not in _OPTIONS:
            raise InvalidInput(f"simulate has no option {name!r} for a point; {suggestion(name, _OPTIONS)}")


def _checked(made: Any, key: str) -> tuple[Network, Mapping[str, Any]]:
    """Return a network and the options of its point, or refuse what `make_network` returned."""
    network, changes = made if isinstance(made, tuple) and len(made) == 2 else (made, {})
    if not isinstance(network, Network) or not isinstance(changes, Mapping):
        raise InvalidInput(
            f"make_network must return an il.Network, or a pair of it and a mapping of options; at {key} it returned "
            f"{made!r}."
        )
    _check_options(changes)
    return network, changes


def _check_names(points: Sequence[Point]) -> None:
    """Refuse networks whose bodies or contacts have different names: they share no labels."""
    made = [(point.key, point.network) for point in points if point.network is not None]
    for key, network in made[1:]:
        for family in ("oscillators", "contacts"):
            first, other = (list(getattr(item, family)) for item in (made[0][1], network))
            if first != other:
                raise InvalidInput(
                    f"The {family} of a sweep must have the same names in the same order at all points: they are "
                    f"{first} at {made[0][0]} and {other} at {key}. Sweep over each kind of network by itself."
                )
