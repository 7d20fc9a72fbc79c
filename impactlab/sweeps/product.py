"""What a sweep simulates: networks over a product of values, and how their results become one labelled dataset."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import xarray as xr

import impactlab
from impactlab.components.literature import in_one_line
from impactlab.components.stored import entries
from impactlab.errors import ImpactLabError, InvalidInput
from impactlab.machine import lost_worker
from impactlab.plan.seed import seed_of
from impactlab.results.dataset import CONFIGURATION, provenance
from impactlab.results.labels import words
from impactlab.results.stack import DONE, Findings, gathered
from impactlab.results.warned import with_all_kinds
from impactlab.sweeps.sweep_points import MakeNetwork, Point, labels_of, make_points, reason_of, values_of

Outcome: TypeAlias = xr.Dataset | Findings | ImpactLabError
"""Result of a point, or the error that refused it."""

_UNITS = dict.fromkeys(("step", "duration", "spin_up", "longest_jump", "seconds_spent"), "s")


@dataclass(frozen=True, eq=False)
class Sweep:
    """What a sweep simulates, and how its results become one dataset."""

    coordinates: dict[str, xr.Variable]  # the values by name
    points: tuple[Point, ...]  # their product; the last name varies fastest
    reference: bool = False  # whether the exact statistics are wanted

    def dataset(self, outcomes: Mapping[str, Outcome]) -> xr.Dataset:
        """Return the outcomes of all points as one dataset, see `sweep`; an error if no point could be simulated.

        Where points were lost with their executor the error has the others as `found`.
        """
        refusals = {point.key: point.refusal or reason_of(outcomes[point.key]) for point in self.points}
        if all(refusals.values()):
            key, reason = next(iter(refusals.items()))
            error = outcomes.get(key)
            kind = type(error) if isinstance(error, ImpactLabError) else InvalidInput
            raise kind(f"No point of the sweep could be simulated; at {key}: {reason}")
        names = {"names": list(self.coordinates), "reference": self.reference}
        title = f"Statistics of networks of oscillators with contacts over {', '.join(self.coordinates)}"
        results = with_all_kinds([found_of(outcomes.get(point.key)) for point in self.points])
        made = [json.loads(found.attributes[CONFIGURATION]) for found in results if found.attributes]
        of_all = provenance(title, json.dumps({"sweep": names}), in_one_line(entries(made)))
        further = []
        for point, result in zip(self.points, results, strict=True):
            variables = {
                **_own_attributes(point, result.attributes, of_all),
                "status": ((), refusals[point.key] or DONE, {"long_name": f"{DONE}, or why not"}),
                **(_reference(point) if self.reference else {}),
            }
            own = {name: variables[name] for name in variables if name not in self.coordinates}
            further.append(Findings(own, {}, {}))
        whole = gathered(results, self.coordinates).assign_attrs(of_all)
        whole = whole.assign(gathered(further, self.coordinates).data_vars)
        if lost := [key for key in refusals if _lost_its_executor(outcomes.get(key))]:
            broken = ImpactLabError(
                f"{len(lost)} of {len(self.points)} points were lost with the executor, first {lost[0]}: "
                f"{refusals[lost[0]]} The attribute found of this error has the others. Repeat the call with a new "
                "executor; with checkpoint=folder it goes on from what is finished, and il.Processes replaces what is "
                "lost."
            )
            broken.found = whole  # type: ignore[attr-defined]
            raise broken
        return whole


def found_of(outcome: Outcome | None) -> Findings:
    """Return the findings of a point: none if the point was refused."""
    if isinstance(outcome, xr.Dataset):
        return Findings.of(outcome)
    return outcome if isinstance(outcome, Findings) else Findings({}, {}, {})


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
    if not isinstance(over, Mapping) or not over:
        raise InvalidInput(f'sweep takes values by name, such as {{"clearance": [0.01, 0.05]}}, not {over!r}.')
    values = {name: values_of(name, given) for name, given in over.items()}
    labels = {name: labels_of(name, items) for name, items in values.items()}
    points = make_points(make_network, values, labels, options, seed_of(rng), common_random_numbers)
    coordinates = {
        name: xr.Variable(name, labels[name], {"long_name": words(name), **getattr(over[name], "attrs", {})})
        for name in values
    }
    return Sweep(coordinates, points, reference)


def _lost_its_executor(outcome: Outcome | None) -> bool:
    """Whether a point was not simulated because its executor broke, or was shut down, meanwhile."""
    cause = outcome.__cause__ if isinstance(outcome, ImpactLabError) else None
    return isinstance(cause, RuntimeError) or lost_worker(cause)


def _own_attributes(point: Point, found: Mapping[str, Any], of_all: Mapping[str, str]) -> dict[str, Any]:
    """Return the attributes of a point as variables, but for those that describe the whole sweep."""
    again = found.get(CONFIGURATION)
    if again is None:
        again = json.dumps({} if point.network is None else {"network": point.network.to_dict()})
    variables = {CONFIGURATION: ((), again, {"long_name": "what makes the point again"})}
    for name, value in found.items():
        if name not in of_all:
            attrs = {} if isinstance(value, str) else {"units": _UNITS.get(name, "1")}
            variables[name] = ((), value, {"long_name": words(name), **attrs})
    return variables


def _reference(point: Point) -> dict[str, Any]:
    """Return the exact statistics of a point as variables, and whether there are any."""
    status = point.refusal or DONE
    found: dict[str, Any] = {}
    if point.network is not None:
        try:
            statistics = impactlab.exact(point.network).statistics()
        except ImpactLabError as error:
            status = reason_of(error)
        else:
            for name, variable in statistics.data_vars.items():
                attrs = {**variable.attrs, "long_name": f"exact {variable.attrs['long_name']}"}
                found[f"{name}_exact"] = (variable.dims, variable.values, attrs)
    return {**found, "reference_status": ((), status, {"long_name": f"{DONE}, or why there is no exact law"})}
