"""Answers of random networks, compared with those of longer runs, as a tree."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

import impactlab as il
from impactlab_numerics.coverage import questions
from impactlab_numerics.coverage.networks import Drawn, drawn

if TYPE_CHECKING:
    from impactlab_numerics.coverage.study import CoverageStudy

EVERY = 5
"""One in so many networks is asked about uncertain numbers, which take hundreds of draws each."""

Refusals = list[tuple[int, str, str]]


def collect(study: CoverageStudy, results: Mapping[str, xr.Dataset]) -> xr.DataTree:
    """Ask all networks, and return the differences, and what was refused."""
    rows: list[tuple[int, str, questions.Row]] = []
    refusals: Refusals = []
    for number in study.numbers:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", il.ImpactLabWarning)
            item = drawn(number, study.realizations)
            rows += [(number, item.kind, row) for row in asked(item, study.times, refusals)]
    of = {"long_name": "difference from the longer run in errors of the difference", "units": "1"}
    comparisons = xr.Dataset(
        {"z": ("comparison", [row.z for *_, row in rows], of)},
        {
            "network": ("comparison", np.array([number for number, *_ in rows], dtype=int)),
            "class": ("comparison", np.array([kind for _, kind, _ in rows], dtype=str)),
            "question": ("comparison", np.array([row.question for *_, row in rows], dtype=str)),
            "quantity": ("comparison", np.array([row.quantity for *_, row in rows], dtype=str)),
        },
    )
    said = xr.Dataset(
        {"message": ("refusal", np.array([text for *_, text in refusals], dtype=str))},
        {
            "network": ("refusal", np.array([number for number, *_ in refusals], dtype=int)),
            "question": ("refusal", np.array([question for _, question, _ in refusals], dtype=str)),
        },
    )
    return xr.DataTree.from_dict({"/comparisons": comparisons, "/refusals": said})


def asked(item: Drawn, times: int, refusals: Refusals) -> Iterator[questions.Row]:
    """Yield the differences of all answers of a network."""
    refused: list[str] = []
    runs: list[xr.Dataset] = []

    def attempt(question: str, ask: Callable[[], Iterator[questions.Row]]) -> list[questions.Row]:
        try:
            return list(ask())
        except il.ImpactLabError as error:
            refusals.append((item.number, question, str(error)))
            return []

    def of_records() -> Iterator[questions.Row]:
        runs[:] = questions.of_records(item, times, refused)
        for question, names in questions.RECORDS.items():
            yield from questions.compared(question, names, *runs)
        yield from questions.balances(*runs)

    yield from attempt("records", of_records)
    refusals += [(item.number, text.partition(" ")[0].partition(":")[0], text) for text in refused]
    name = next((name for name, body in item.network.oscillators.items() if _moved(item, name, body)), None)
    if not runs or name is None or item.in_batches:
        return
    limits = {name: _limit(runs[1], name)}
    yield from attempt("FirstPassage", lambda: questions.passages(*questions.of_passages(item, times, limits)))
    yield from attempt("fragility", lambda: _of_fragility(item, times, limits))
    if item.number % EVERY == 0 and type(item.network.oscillators[name]) is il.LinearOscillator:
        yield from attempt("Uncertain", lambda: _of_uncertain(item, times, name))


def _moved(item: Drawn, name: str, body: object) -> bool:
    """Whether noise moves a body that a spring and a damper hold."""
    noise = item.network.excitations.get(name)
    held = isinstance(body, il.Oscillator) and body.stiffness > 0.0 and body.damping > 0.0
    return bool(held and noise is not None and noise.kind != "force")


def _limit(run: xr.Dataset, name: str) -> float:
    """Return the mean of the largest displacements in windows (m)."""
    mean = run.extreme_mean.sel(extreme_form=name, extreme_kind="magnitude")
    return float(mean.isel(extreme_window=0))


def _of_fragility(item: Drawn, times: int, limits: dict[str, float]) -> Iterator[questions.Row]:
    short, long = questions.of_fragility(item, times, limits)
    yield from questions.bands(short, long, times)
    yield from questions.compared("fragility", ("median_scale", "dispersion"), short, long)


def _of_uncertain(item: Drawn, times: int, name: str) -> Iterator[questions.Row]:
    short, long = questions.of_uncertain(item, times // 2, name)
    for end in ("", "_parameter_variance", "_noise_variance", "_sobol_index"):
        names = [statistic + end for statistic in questions.UNCERTAIN]
        yield from questions.compared("Uncertain", names, short, long)
