"""What the dataset of a finished run holds: values with errors, records, and attributes of the whole run."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from impactlab.components.citations import entries
from impactlab.components.literature import in_one_line
from impactlab.components.stored import json_of
from impactlab.plan.plan import Plan
from impactlab.records.recorded_run import RecordedRun
from impactlab.records.trajectory import PerRealization
from impactlab.results.dataset import provenance
from impactlab.results.labels import Variables, labelled
from impactlab.results.schema import Variable, labels_of, variables_of
from impactlab.results.snapshot import REALIZATION
from impactlab.results.stack import Findings
from impactlab.simulation.block_sums import BlockResult
from impactlab.statistics.subsamples import samples_per_realization

if TYPE_CHECKING:
    from impactlab.statistics.estimate import Estimates


def findings_of(
    plan: Plan, estimates: Estimates, results: list[BlockResult], slowest_counted: np.ndarray,
    configuration: dict[str, Any],
) -> Findings:  # fmt: skip
    """Return what the dataset of a finished run holds.

    Of contacts that come to rest by bouncing impacts count from the closing velocities `slowest_counted` on, else NaN.
    """
    given = dict(estimates.values.labelled())
    known = {name: found for name, found in given.items() if not found.value.size or not np.isnan(found.value).all()}
    coordinates = labels_of(plan.system.bodies, plan.system.contacts, plan.points.names)
    coordinates |= plan.snapshot.coordinates
    variables = variables_of(known, coordinates)
    if plan.system.contacts:
        variables |= _of_contacts(plan, estimates)
    if "contact_rate" in variables and np.isfinite(slowest_counted).any():
        text = "closing velocity from which on impacts count in contact_rate"
        variables["impact_velocity_threshold"] = labelled(("contact",), slowest_counted, "m s-1", text)
        variables["contact_rate"][2]["comment"] = (
            "Of contacts with an impact_velocity_threshold only faster impacts count: slower ones are endlessly many "
            "in finite time."
        )
    if "contact_ratio" in variables and plan.impacts.restless.any():
        variables["contact_ratio"][2]["comment"] = (
            "White noise ends a rest of a rigid contact at once: of such contacts this is the part of the steps of "
            f"{plan.clock.step:.3g} s at rest, and falls with the step."
        )
    for index, (item, ratio) in enumerate(plan.observed.records):
        if isinstance(item, PerRealization):
            variables |= _by_realization([one for one in known if one.dimension in coordinates], estimates)
        variables |= item.label(RecordedRun(plan), [result.records[index] for result in results], plan.interval(ratio))
    coordinates |= {name: item for name, item in variables.items() if item[0] == (name,)}
    if any("realization" in dims for dims, *_ in variables.values()):
        coordinates["realization"] = ("realization",), np.arange(plan.realizations.number), REALIZATION
    variables = {name: item for name, item in variables.items() if name not in coordinates}
    return Findings(variables, coordinates, _attributes(plan, estimates, configuration))


def _attributes(plan: Plan, estimates: Estimates, configuration: dict[str, Any]) -> dict[str, Any]:
    """Return the attributes of the whole run."""
    attributes: dict[str, Any] = {
        **provenance(
            "Statistics of a network of oscillators with contacts",
            json_of(configuration),
            in_one_line(entries(configuration)),
        ),
        "integrator": configuration["simulate"]["integrator"]["type"],
        "step": plan.clock.step,
        "duration": plan.clock.duration,
        "spin_up": plan.clock.spin_up,
        "realizations": plan.realizations.number,
        "independent_samples": plan.realizations.number * samples_per_realization(plan),
        "initial": "given" if plan.start.given else plan.start.state,
        "drift": estimates.drift,
        "step_heating": estimates.heating.share,
        "step_heating_standard_error": estimates.heating.error,
    }
    if plan.method.interval > 1:
        attributes["longest_jump"] = plan.method.interval * plan.clock.step
    return attributes


def _of_contacts(plan: Plan, estimates: Estimates) -> Variables:
    """Return on what the values of contacts are based."""
    text = "number of contacts in one of the samples that standard errors come from"
    number = labelled(("contact",), estimates.contacts_per_sample, "1", text)
    number[2]["comment"] = "Differences beyond 5 standard errors are possible below 20."
    time = labelled((), np.array(plan.clock.duration), "s", "time over which peaks are taken")
    return {"observation_time": time, "contacts_per_sample": number}


def _by_realization(variables: list[Variable], estimates: Estimates) -> Variables:
    """Return statistics and balances of the realizations."""
    return {
        item.by_realization: labelled(
            ("realization", item.dimension), estimates.by_realization[item.name], item.units,
            f"{item.long_name}, by realization",
        )
        for item in variables
        if item.name in estimates.by_realization
    }  # fmt: skip
