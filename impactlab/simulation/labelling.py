"""What the dataset of a finished run holds: values with errors, records, and attributes of the whole run."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from impactlab.components.literature import in_one_line
from impactlab.components.stored import entries, json_of
from impactlab.errors import warn
from impactlab.plan.events import Remarks
from impactlab.plan.plan import Plan
from impactlab.plan.request import Request
from impactlab.records.recorded_run import RecordedRun
from impactlab.records.trajectory import PerRealization, Trajectory
from impactlab.results.dataset import BEGIN, provenance
from impactlab.results.labels import Variables, labelled
from impactlab.results.losses import ADVICE, losses_text, with_losses
from impactlab.results.schema import Variable, labels_of, variables_of
from impactlab.results.snapshot import REALIZATION
from impactlab.results.stack import Findings
from impactlab.simulation.block_sums import BlockResult, merged, remarks_on_events
from impactlab.statistics.drift import DRIFT
from impactlab.statistics.ergodicity import begun_elsewhere
from impactlab.statistics.estimate import Estimates, Rows, estimate
from impactlab.statistics.heating import conservative, unequal_partition

ENDED = (
    "Realizations end when a limit is passed, so that there are none; name them in statistics= for realizations that "
    "all run to the end."
)
"""Attribute of a run without statistics."""


def estimated(
    plan: Plan,
    request: Request,
    results: list[BlockResult],
    rows: Rows | None,
    configuration: dict[str, Any],
    wandering: str,
    run_block: Callable[[Plan, int], BlockResult],
) -> Findings:
    """Return what the dataset of a finished run holds, and warn of what it leaves open.

    A text on `wandering` says that small errors change the path, where no other start is known to do so; `run_block`
    runs a block of another plan, to see whether another start leads to another motion.
    """
    paths = [isinstance(record, Trajectory) for record in request.records]
    path_alone = plan.realizations.number == 1 and bool(paths) and all(paths) and request.statistics is None
    estimates = estimate(plan, *merged(results), rows=rows, wanted=not path_alone)
    rates = request.statistics is None or "contact_rate" in request.statistics
    remarks = remarks_on_events(plan, [result.events for result in results], rates)
    drifting = plan.steady and estimates.drift > DRIFT
    from_rest = not plan.start.given and plan.start.state == "rest" and not plan.clock.spin_up_steps
    transient = from_rest and request.from_rest
    if estimates.values.unbalanced and plan.steady and (plan.clock.settled or not (drifting or from_rest)):
        warn("balance", estimates.values.unbalanced)
    if drifting and not transient:
        warn(
            "drift",
            f"The two halves of the run differ by {estimates.drift:.1f} standard errors: the spin-up of "
            f"{plan.clock.spin_up:g} s may be too short. Give a longer spin_up=.",
        )
    if drifting and transient and request.spin_up is None and not any(paths):
        warn(
            "transient",
            f"Means contain the transient from rest: the two halves of the run differ by {estimates.drift:.1f} "
            "standard errors. Give spin_up= (s) for stationary means, or spin_up=0.0 if the transient is wanted.",
        )
    usual = request.initial is None and not (plan.noise.coarse or plan.random)
    elsewhere = begun_elsewhere(plan, results[0].bodies, lambda other: run_block(other, 0).bodies) if usual else ""
    if message := estimates.remembered or elsewhere:
        warn("several_motions", message)
    elif wandering:
        warn("chaotic_path", wandering)
    if conservative(plan) and not plan.noise.coarse and not drifting:
        partition = unequal_partition(plan, *estimates.values.combined["mean_square_velocity"])
        if message := estimates.heating.warning or partition:
            warn("heating", message)
    return findings_of(plan, estimates, results, remarks, configuration)


def findings_of(
    plan: Plan, estimates: Estimates, results: list[BlockResult], remarks: Remarks,
    configuration: dict[str, Any],
) -> Findings:  # fmt: skip
    """Return the variables and attributes of the dataset of a finished run.

    `remarks` are those on events that mechanisms have located.
    """
    given = dict(estimates.values.labelled())
    known = {name: found for name, found in given.items() if not found.value.size or not np.isnan(found.value).all()}
    coordinates = labels_of(plan.system.bodies, plan.system.contacts, [name for name, _ in plan.points.labels])
    coordinates |= plan.snapshot.coordinates
    variables = variables_of(known, coordinates)
    if plan.system.contacts:
        time, number = np.array(plan.clock.duration), estimates.contacts_per_sample
        variables["observation_time"] = labelled((), time, "s", "time over which peaks are taken")
        text = "number of contacts in one of the samples that standard errors come from"
        variables["contacts_per_sample"] = labelled(("contact",), number, "1", text)
        variables["contacts_per_sample"][2]["comment"] = "Differences beyond 5 standard errors are possible below 20."
    if "contact_rate" in variables and np.isfinite(remarks.thresholds).any():
        text = "closing velocity from which on impacts count in contact_rate"
        variables["impact_velocity_threshold"] = labelled(("contact",), remarks.thresholds, "m s-1", text)
        variables["contact_rate"][2]["comment"] = (
            "Of contacts with an impact_velocity_threshold only faster impacts count: slower ones are endlessly many "
            "in finite time."
        )
    for name in remarks.comments.keys() & variables.keys():
        variables[name][2]["comment"] = remarks.comments[name]
    for index, (item, ratio) in enumerate(plan.observed.records):
        if isinstance(item, PerRealization):
            variables |= _by_realization([one for one in known if one.dimension in coordinates], estimates)
        variables |= item.label(
            RecordedRun(plan, estimates), [result.records[index] for result in results], plan.interval(ratio)
        )
    coordinates |= {name: item for name, item in variables.items() if item[0] == (name,)}
    if any("realization" in dims for dims, *_ in variables.values()):
        numbers = plan.realizations.numbered_from + np.arange(plan.realizations.number)
        coordinates["realization"] = ("realization",), numbers, REALIZATION
    variables = {name: item for name, item in variables.items() if name not in coordinates}
    return _with_losses(variables, coordinates, _attributes(plan, estimates, configuration), plan)


def records_alone(plan: Plan, results: list[BlockResult], configuration: dict[str, Any]) -> Findings:
    """Return the data of records of a run whose realizations ended when these had them, which has no statistics."""
    remarks_on_events(plan, [result.events for result in results], False)
    variables: Variables = {}
    for index, (item, ratio) in enumerate(plan.observed.records):
        variables |= item.label(RecordedRun(plan), [result.records[index] for result in results], plan.interval(ratio))
    coordinates = {name: item for name, item in variables.items() if item[0] == (name,)}
    numbers = plan.realizations.numbered_from + np.arange(plan.realizations.number)
    coordinates["realization"] = ("realization",), numbers, REALIZATION
    variables = {name: item for name, item in variables.items() if name not in coordinates}
    title = "First passages of a network of oscillators with contacts"
    attributes = {**_of_run(plan, title, configuration), "statistics": ENDED}
    return _with_losses(variables, coordinates, attributes, plan)


def warn_of_losses(plan: Plan, explanation: str = "") -> None:
    """Warn of realizations that diverged, with what may explain it."""
    realizations = plan.realizations
    if realizations.losses:
        warn(
            "diverged",
            f"{losses_text(realizations.losses, realizations.number)} Statistics are those of the "
            f"{realizations.finite} that stay finite. {ADVICE}{explanation}",
        )


def _with_losses(variables: Variables, coordinates: Variables, attributes: dict[str, Any], plan: Plan) -> Findings:
    """Return what a dataset holds, in which values of realizations that diverged are NaN."""
    realizations = plan.realizations
    variables, attributes = with_losses(
        variables, attributes, realizations.losses, realizations.finite_places, realizations.number
    )
    return Findings(variables, coordinates, attributes)


def _attributes(plan: Plan, estimates: Estimates, configuration: dict[str, Any]) -> dict[str, Any]:
    """Return the attributes of the whole run, and of its statistics."""
    return {
        **_of_run(plan, "Statistics of a network of oscillators with contacts", configuration),
        "independent_samples": plan.realizations.finite * plan.samples_per_realization,
        "drift": estimates.drift,
        "step_heating": estimates.heating.share,
        "step_heating_standard_error": estimates.heating.error,
    }


def _of_run(plan: Plan, title: str, configuration: dict[str, Any]) -> dict[str, Any]:
    """Return the attributes of the run itself."""
    attributes: dict[str, Any] = {
        **provenance(
            title,
            json_of(configuration),
            in_one_line(entries(configuration)),
        ),
        "integrator": configuration["simulate"]["integrator"]["type"],
        "step": plan.clock.step,
        "duration": plan.clock.duration,
        "spin_up": plan.clock.spin_up,
        "realizations": plan.realizations.number,
        "initial": "given" if plan.start.given else plan.start.state,
    }
    if plan.clock.begin:
        attributes[BEGIN] = plan.clock.begin * plan.clock.step
    if plan.method.interval > 1:
        attributes["longest_jump"] = plan.method.interval * plan.clock.step
    return attributes


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
