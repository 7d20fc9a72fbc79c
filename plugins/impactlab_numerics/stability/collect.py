"""The cells of the stability study, simulated and judged, and its wild scenes."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr
from scipy.fft import next_fast_len

import impactlab as il
from impactlab.sweeps.scheduler import run_together
from impactlab_numerics.scenes import shaken as shaken_in_band
from impactlab_numerics.stability.cells import (
    JUDGED,
    MOST_SAMPLES,
    WORST,
    Length,
    Verdict,
    pair,
    scene_on,
    shaken,
    verdict,
)
from impactlab_numerics.stability.study import AXES
from impactlab_numerics.stability.wild_runs import run_scene
from impactlab_numerics.stability.wild_scenes import wild_scene

if TYPE_CHECKING:
    from impactlab_numerics.stability.study import StabilityStudy

METHODS: tuple[il.Integrator, ...] = (il.ExactFlow(measured=False), il.RungeKutta4(), il.EulerMaruyama())
"""The methods, the default one first."""

DEFAULT = type(METHODS[0]).__name__

AUTOMATIC = "automatic"
"""Label of the step that a method chooses."""

PAPER = "paper"
"""Label of the paper's step."""

QUARTER = 0.25
"""Step of the reference under bounded noise, by the automatic one, about."""

FINEST = QUARTER / 1.5
"""Step from which on cells under bounded noise are run, by the automatic one."""


class Cell(NamedTuple):
    """A method at a step in a scene."""

    method: il.Integrator
    noise: str
    axis: str
    value: float
    label: str
    network: il.Network
    given: float | None
    limits: tuple[float, float]
    length: Length | None
    body_steps: float

    @property
    def step(self) -> float:
        """The step that is given, or the automatic one (s)."""
        return self.limits[0] if self.given is None else self.given


def collect(study: StabilityStudy, results: Mapping[str, xr.Dataset]) -> xr.DataTree:
    """Return the tree of results.

    Groups: ``cells`` (one row for each method, noise, place on an axis and step but for references), ``paper`` (ratio
    by stiffness at the paper's step, under its noise), ``wild`` (one row for each wild scene).
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what warnings tell is found here by comparison
        nodes = {"/cells": _maps(study), "/paper": _paper(study), "/wild": _wild(study)}
    return xr.DataTree.from_dict(nodes)


def _maps(study: StabilityStudy) -> xr.Dataset:
    places = [(axis, value) for axis in AXES for value in getattr(study, axis)]
    exact = {place: _exact(scene_on(*place)) for place in places}
    cells: list[Cell] = []
    default = {}
    references: dict[tuple[str, float], Cell] = {}
    for axis, value in places:
        white, rate = scene_on(axis, value), float(exact[axis, value]["contact_rate"][0])
        for noise in ("white", "series") if study.series else ("white",):
            network = white if noise == "white" else shaken(white, study.components)
            limits = _steps(network)
            default[noise, axis, value] = automatic = limits[DEFAULT][0]
            place = noise, axis, value
            fine, length, most = None, None, study.body_steps
            if noise == "series":
                fine = _whole(network, QUARTER * automatic)
                longest = min(1.0 / min(_spacings(network)), MOST_SAMPLES * fine)
                length = Length.of(network, most * automatic / 2.0, rate, longest)
                most = 2.0 * length.total / (FINEST * automatic) if length else most
                references[axis, value] = Cell(
                    METHODS[0], *place, "reference", network, fine, limits[DEFAULT], length, most
                )
            for method in METHODS:
                own = limits[type(method).__name__]
                wanted = {AUTOMATIC: own[0], **{f"{factor:g}": factor * automatic for factor in study.factors}}
                for label, step in {**wanted, PAPER: study.paper_step}.items():
                    given: float | None = None if label == AUTOMATIC else step
                    if noise == "white":
                        trusted = label == AUTOMATIC and method is METHODS[0]
                        most = study.automatic_body_steps if trusted else study.body_steps
                        length = Length.of(network, most * step / 2.0, rate) if step == step else None
                    else:
                        given = given and _whole(network, given)
                        if length and method is METHODS[0] and given == fine:
                            continue  # the reference itself
                    cells.append(Cell(method, *place, label, network, given, own, length, most))
    found = dict(zip(references, _run(list(references.values()), study.seed, lambda cell: None), strict=True))

    def reference(cell: Cell) -> Any:
        place = cell.axis, cell.value
        return exact[place] if cell.noise == "white" else found[place]

    return _table(
        _run(cells, study.seed, reference),
        method=([type(cell.method).__name__ for cell in cells], "method"),
        noise=([cell.noise for cell in cells], "noise"),
        axis=([cell.axis for cell in cells], "what is changed"),
        value=([cell.value for cell in cells], "its value"),
        label=([cell.label for cell in cells], "step, by the automatic one of the default method, or its name"),
        step=([cell.step for cell in cells], "step (s)"),
        automatic_step=([cell.limits[0] for cell in cells], "automatic step of the method (s)"),
        largest_step=([cell.limits[1] for cell in cells], "largest step of the method (s)"),
        default_step=(
            [default[cell.noise, cell.axis, cell.value] for cell in cells],
            "automatic step of the default method (s)",
        ),
    )


def _steps(network: il.Network) -> dict[str, tuple[float, float]]:
    """Return automatic and largest step of each method, NaN where there is none."""
    data = network.check().dataset
    return {
        str(name): (float(automatic), float(largest))
        for name, automatic, largest in zip(
            data.integrator.values, data.recommended_step.values, data.largest_step.values, strict=True
        )
    }


def _whole(network: il.Network, step: float) -> float:
    """Return a step near the given one; the period of the fastest series is a number of them that an FFT takes well."""
    spacing = max(_spacings(network))
    return 1.0 / (spacing * int(next_fast_len(max(2, round(1.0 / (spacing * step))), real=True)))


def _spacings(network: il.Network) -> list[float]:
    """Return the distances between the frequencies of each series (Hz)."""
    return [noise.spacing for noise in network.excitations.values()]  # type: ignore[attr-defined]


def _exact(network: il.Network) -> dict[str, np.ndarray]:
    statistics = il.exact(network).statistics()
    return {name: statistics[name].values for name in JUDGED}


def _run(cells: list[Cell], seed: int, reference: Callable[[Cell], Any]) -> list[Any]:
    """Simulate cells and return verdicts, or without a reference the results, None where there is none."""
    outcomes: list[Any] = [None] * len(cells)
    jobs = {}
    for index, cell in enumerate(cells):
        against = reference(cell)
        is_reference = cell.label == "reference"
        refusal = _cost(cell) or ("" if is_reference or against is not None else "the reference would take too long")
        if refusal:
            outcomes[index] = None if is_reference else Verdict("refused for its cost", reason=refusal)
        else:
            jobs[str(index)] = _job(cell, seed)

    def finished(key: str, outcome: Any) -> None:
        cell = cells[int(key)]
        if cell.label == "reference":
            outcomes[int(key)] = None if isinstance(outcome, il.ImpactLabError) else outcome
        elif isinstance(outcome, il.InvalidInput):
            outcomes[int(key)] = Verdict("refused", reason=str(outcome))
        elif isinstance(outcome, il.Diverged):
            outcomes[int(key)] = Verdict("unstable", reason=str(outcome))
        elif isinstance(outcome, il.ImpactLabError):
            raise outcome
        else:
            outcomes[int(key)] = verdict(outcome, reference(cell))

    if jobs:
        run_together(jobs, finished, kind="Cell")
    return outcomes


def _cost(cell: Cell) -> str:
    """Say why a cell takes too long, if it does; a method that has no step for the scene says that itself."""
    step = cell.step
    if not step <= cell.limits[1]:
        return ""
    if cell.length is None:
        samples = "" if cell.noise == "white" else f", or {MOST_SAMPLES:.2g} samples of a series"
        return f"a standard error of {WORST:.0%} takes more than {cell.body_steps:.2g} steps of a body{samples}"
    if 2.0 * cell.length.total / step > 1.01 * cell.body_steps:
        return f"it takes more than {cell.body_steps:.2g} steps of a body"
    if cell.noise != "white" and (cell.length.duration + cell.length.spin_up) / step > 1.01 * MOST_SAMPLES:
        return f"it takes more than {MOST_SAMPLES:.2g} samples of a series"
    return ""


def _job(cell: Cell, seed: int) -> Callable[[Executor, Callable[[float], None]], xr.Dataset]:
    length = cell.length or Length(1, 1.0, 0.0)  # is refused
    options = {**length.options(), "step": cell.given, "integrator": cell.method, "rng": seed}
    if cell.given is not None:  # a whole number of steps
        options["duration"] = max(1, math.floor(length.duration / cell.step)) * cell.step
    if cell.noise != "white":
        options["record"] = il.PerRealization()

    def job(pool: Executor, note: Callable[[float], None]) -> xr.Dataset:
        return il.simulate(cell.network, **options, executor=pool, progress=note)

    return job


def _paper(study: StabilityStudy) -> xr.Dataset:
    """Runge–Kutta at the paper's step, against the default method at a quarter of its step on the same series."""
    period = study.paper_components / (study.paper_band[1] - study.paper_band[0])
    length = Length(study.paper_realizations, 0.8 * period, 0.2 * period)
    places = [(ratio, value) for ratio in study.paper_frequency_ratios for value in study.paper_stiffness]
    cells: list[Cell] = []
    references: list[Cell] = []
    for ratio, value in places:
        white = pair(frequency_ratio=ratio, law=il.HertzContact(value))
        network = shaken_in_band(white, study.paper_components, study.paper_band)
        limits = _steps(network)
        quarter = _whole(network, QUARTER * limits[DEFAULT][0])
        for into, method, label, step in (
            (references, METHODS[0], "reference", quarter), (cells, il.RungeKutta4(), PAPER, study.paper_step),
        ):  # fmt: skip
            known = limits[type(method).__name__]
            into.append(Cell(method, "paper", "", ratio, label, network, step, known, length, math.inf))
    found = dict(zip(map(id, cells), _run(references, study.seed, lambda cell: None), strict=True))
    verdicts = _run(cells, study.seed, lambda cell: found[id(cell)])
    return _table(
        verdicts,
        frequency_ratio=([ratio for ratio, _ in places], "frequency of the first body by that of the second"),
        stiffness=([value for _, value in places], "stiffness of the contact (N m-3/2)"),
    ).assign_attrs(step=study.paper_step, realizations=length.realizations, duration=length.duration)


def _wild(study: StabilityStudy) -> xr.Dataset:
    seeds = range(study.first_scene, study.first_scene + study.scenes)
    outcomes = [run_scene(wild_scene(seed)) for seed in seeds]
    return xr.Dataset(
        {
            "outcome": ("scene", np.array([item.kind for item in outcomes], dtype=str)),
            "detail": ("scene", np.array([item.detail for item in outcomes], dtype=str)),
            "seconds": ("scene", np.array([item.seconds for item in outcomes]), {"units": "s"}),
        },
        {"scene": list(seeds)},
    )


def _table(verdicts: list[Verdict], **columns: Any) -> xr.Dataset:
    """Return the table of cells with their verdicts."""
    found: Mapping[str, tuple[list[Any], str]] = {
        "kind": ([item.kind for item in verdicts], "verdict"),
        "statistic": ([item.statistic for item in verdicts], "worst statistic"),
        "deviation": ([item.deviation for item in verdicts], "its relative deviation"),
        "standard_error": ([item.error for item in verdicts], "standard error of that"),
        "judged": ([item.judged for item in verdicts], "statistics that were judged"),
        "reason": ([item.reason for item in verdicts], "reason of a refusal"),
    }
    return xr.Dataset({
        name: ("cell", np.asarray(values), {"long_name": text}) for name, (values, text) in {**columns, **found}.items()
    })  # fmt: skip
