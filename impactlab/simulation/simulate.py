"""Simulate a network: plan, measure the step, run, estimate, label."""

from __future__ import annotations

import contextlib
import math
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import xarray as xr

import impactlab
from impactlab.assembly.model import Model
from impactlab.compiling.announced import announced
from impactlab.errors import InvalidInput, noted
from impactlab.inputs import checked, positive
from impactlab.integrators.base import Integrator
from impactlab.located.requests import chooses, explained, findings_of, findings_without_steps, without_steps
from impactlab.networks.network import Network
from impactlab.records.record import Record
from impactlab.results.dataset import opened, replacing, told, write
from impactlab.results.warned import by_kind, with_warnings
from impactlab.simulation.ensemble import Execution
from impactlab.simulation.going_on import onward
from impactlab.simulation.growing_ensemble import Ensemble, ensemble_since, request_of, run_plan, seconds_of_steps
from impactlab.simulation.kept_runs import check_kept, kept_run


@checked
def simulate(
    network: Network,
    duration: float | None = None,
    *,
    tolerance: Mapping[str, float] | None = None,
    max_seconds: float | None = None,
    realizations: int = 1,
    step: float | None = None,
    integrator: Integrator | None = None,
    spin_up: float | None = None,
    initial: str | os.PathLike[str] | Mapping[str, Mapping[str, Any]] | xr.Dataset | None = None,
    continues: bool = False,
    branch: int | None = None,
    record: Sequence[Record] | Record | None = None,
    statistics: str | Sequence[str] | None = None,
    on_divergence: str = "keep",
    rng: Any = None,
    executor: Executor | None = None,
    progress: bool | Callable[[float], None] | None = None,
    out: str | os.PathLike[str] | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
) -> xr.Dataset:
    """Simulate an ensemble of realizations and return its statistics.

    Parameters
    ----------
    network : Network
        What to simulate. With numbers that are `impactlab.Uncertain`, statistics are those of `impactlab.uncertain`.
    duration : float, optional
        Time over which statistics are taken, after the spin-up (s). Needed unless there is a
        tolerance; then it is the longest that a realization may be.
    tolerance : mapping of str to float, optional
        Relative accuracy by the name of a statistic: the step, the duration and the number of
        realizations are chosen so that the magnitude of the bias of the step plus 2 standard errors are within it
        for every label.
    max_seconds : float, optional
        Time that may be spent (s). A run that is expected to take longer is refused; by default any time is
        allowed, with a warning beyond an hour. With a tolerance (600 s by default) the result reached in time is
        returned with a warning; ``error_over_tolerance`` tells how far it is from the tolerance.
    realizations : int
        Number of independent realizations; with a tolerance the least. One is run if nothing is random.
    step : float, optional
        Time step (s); chosen from the network by default, where steps are made.
    integrator : Integrator, optional
        Method. By default `ExactFlow`, which makes steps; or `EventLocated`, which follows the motion from event to
        event, if nothing is random and neither a step nor a tolerance is given. ``integrator_reason`` of the result
        says which was chosen and why. `EventLocated` is chosen for networks of up to 50 bodies (and up to 8 contacts,
        if the motion is linear between events) and records that it supports, if it takes at most a second of one core,
        or no longer than accurate steps.
    spin_up : float, optional
        Time before the statistics begin (s). By default twelve relaxation times of the slowest body, or as long as
        collisions and changes between wells take, if that is not much longer than the run; 0 if `initial` is "rest"
        or given.
    initial : str, mapping, Dataset or path, optional
        "stationary" (default: the law without contacts, drawn again while a contact is
        closed; if there is no such law, rest before the spin-up), "rest" (at t = 0), or ``{"displacement":
        {name: value}, "velocity": {name: value}}`` (m, m s-1), 0 for names that are left out; a value is a number, or
        one for each realization. Or the result of a run with `FinalState`, or the path of its file: each realization
        then continues from its own end, at t = 0 and with new noise.
    continues : bool
        Whether to continue the run whose result, with ``FinalState(continues=True)``, is `initial`, at its time: with
        the same realizations, step, method and random numbers, none of which may then be given. Both parts
        have the paths of one longer run: bit for bit with steps, and within the ``path_error`` with
        `EventLocated`. Statistics are those of the second part, from the time ``begin`` on; the bias of its step is not
        measured again.
    branch : int, optional
        Number of new realizations that start from the end of each realization of such a result, at its time and with
        noise of their own, as by `Run.branch`; the same noise if this is repeated. Their numbers follow the earlier
        ones, with the branches of one realization next to each other.
    record : Record or sequence, optional
        What to keep besides the statistics.
    statistics : str or sequence of str, optional
        Names of the statistics in the result, besides those of a `tolerance`; all by default. Values and errors do not
        depend on it. It saves time if no statistic of contacts but the ``contact_ratio`` is named; the ``drift`` then
        ignores contact forces.
    on_divergence : str
        If a realization leaves the range of finite numbers, "keep" (default) leaves it out and continues with the
        others. A warning names it; the attribute ``realizations_diverged`` counts these, ``diverged_realization``,
        ``diverged_time``, ``diverged_oscillator`` and ``diverged_contact`` say which, when and where, and its values
        are NaN. Statistics are then those of the finite realizations, with the bits of a run of these alone.
        "raise" stops the run with the error `Diverged`, as "keep" does if none is left.
    rng : optional
        Seed, as for `numpy.random.default_rng`: None, int, SeedSequence, Generator. Streams are
        keyed by seed, realization, name of the body or the source, and step; or interval, in runs
        with contact-free intervals.
    executor : concurrent.futures.Executor, optional
        Where blocks of realizations run; threads on all cores by default. Numbers never
        depend on it.
    progress : bool or callable, optional
        Progress bar, with a statistic and its error so far; by default on long runs in a terminal or a notebook. A
        function is called with the part that is done.
    out : str or path, optional
        File to write the dataset to (netCDF), completely or not at all; an existing one is
        replaced at the end. Trajectories are written during the run, so that they take
        memory for a few samples only, and read from the file when they are needed.
    checkpoint : str or path, optional
        Folder that keeps finished blocks of realizations, and every few seconds the state of running ones,
        so that the same call continues where the last one was stopped or killed. Numbers are those of a run without it,
        bit for bit. Another call is refused in this folder. Not with a tolerance, whose work depends on the time that
        it takes, nor with trajectories written to ``out``.

    Returns
    -------
    xarray.Dataset
        Default statistics with dims ``oscillator`` or ``contact``, each with
        ``<name>_standard_error``; ``balance_*`` diagnostics; what the records add. Where the bias of the
        step was measured it is ``<name>_step_bias``, a part of the value, and standard errors allow for it.

    Raises
    ------
    InvalidInput
        If an argument cannot be used, or the memory or the disk is too small.
    Diverged
        If all realizations left the range of finite numbers, or one with ``on_divergence="raise"``.

    Examples
    --------
    >>> result = il.simulate(network, duration=100.0, realizations=64, rng=1)
    >>> result.contact_ratio.dims
    ('contact',)
    >>> print(f'{result.contact_ratio.item():.1f}')
    0.1
    """
    if network.is_uncertain:
        return impactlab.uncertain(
            network, None, duration, realizations=realizations, rng=rng, executor=executor, progress=progress,
            tolerance=tolerance, max_seconds=max_seconds, step=step, integrator=integrator, spin_up=spin_up,
            initial=initial, continues=continues, branch=branch, record=record, statistics=statistics, out=out,
            **({} if on_divergence == "keep" else {"on_divergence": on_divergence}),
            **({} if checkpoint is None else {"checkpoint": checkpoint}),
        )  # fmt: skip
    record = None if record is None else Record.all_of(record)
    check_kept(checkpoint, tolerance, out, record)
    allowed = None if max_seconds is None else positive("max_seconds", max_seconds)
    model, options = Model.of(network), (realizations, step, integrator, spin_up, initial, record, statistics)
    given = {
        "realizations": None if realizations == 1 else realizations, "step": step, "integrator": integrator,
        "spin_up": spin_up, "rng": rng, "tolerance": tolerance,
    }  # fmt: skip
    going = onward(network, initial, continues, branch, given)
    if tolerance is not None:
        from impactlab.step_control.tolerance.tolerance import checked, length_of, simulate_to  # loaded only here

        if out is not None:
            raise InvalidInput(
                "simulate cannot write to out= until a tolerance is reached; give duration=, or use il.save afterwards."
            )
        tolerances = checked(tolerance, model)
        request = request_of(network, length_of(model, duration), *options, rng, on_divergence)
        ensemble_of = partial(Ensemble, execution=Execution(executor, growing=True), compared=True)
        return simulate_to(tolerances, allowed, model, request, ensemble_of, progress)
    asked = {**given, "network": network, "duration": duration, "initial": initial, "record": record,
             "statistics": statistics, "continues": continues, "branch": branch,
             "on_divergence": on_divergence}  # fmt: skip
    files = contextlib.nullcontext() if out is None else replacing(Path(out))
    with (
        announced(progress), files as temporary, noted() as warnings,
        kept_run(checkpoint, "simulate", executor, asked) as (kept, seed),
    ):  # fmt: skip
        if going is None:
            request = request_of(network, duration, *options, seed, on_divergence)
        else:
            request = replace(going.request(duration, record, statistics), on_divergence=on_divergence)
        execution = Execution(executor, progress, allowed or math.inf, out, checkpoint=kept)
        report, seconds, reason = execution.report(), execution.seconds, ""
        if going is None:
            steps = partial(seconds_of_steps, model, request) if chooses(integrator, step) else None
            found, reason = findings_without_steps(model, request, steps, report, seconds)
        elif going.makes_steps:
            run = partial(run_plan, execution=execution, progress=report, file=temporary)
            found = going.findings(model, request, execution.workers, run)
        else:
            found = findings_of(without_steps(model, request, None, going.earlier), report, seconds)
        if found is None:
            ensemble = ensemble_since(reason, model, request, execution)
            ensemble.grow(ensemble.number, report, temporary)
            found = ensemble.findings()
        found = explained(found, reason)
        dataset = (with_warnings(found, by_kind(warnings)) if warnings else found).dataset()
        if out is None or temporary is None:
            return dataset
        with told(str(out), temporary):
            write(dataset, temporary, append=temporary.stat().st_size > 0)  # trajectories that arose
    return opened(Path(out))
