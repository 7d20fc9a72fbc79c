"""Records of extremes: the largest and least values of linear forms in windows of time."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import Any, ClassVar

import numpy as np

from impactlab.components.fields import parameter
from impactlab.components.literature import article
from impactlab.errors import InvalidInput
from impactlab.kernels.turning_points import BROWNIAN, PathOfForm, widen
from impactlab.plan.clock import BATCHES
from impactlab.plan.plan import Plan
from impactlab.records.linear_forms import Forms, names_of_forms, units_of
from impactlab.records.paths_of_forms import RAISED, RecordOfPaths, TurnsOfPath, paths_of
from impactlab.records.record import Keeper
from impactlab.records.recorded_run import RecordedRun
from impactlab.results.labels import Variables, labelled, with_error
from impactlab.results.snapshot import PEAKS, places_of
from impactlab.statistics.tails import TAILS, level_with_error, summary_of, without_each

EXTREMES = "maximum", "minimum", "magnitude"
"""Extremes of each form: its largest and its least value, and the larger of their magnitudes."""

FITTED = "of a law fitted to the maxima of windows, whatever their own law is"


class Extremes(RecordOfPaths):
    """Largest and least values, in windows of time, of linear forms of displacements, velocities and contact forces.

    Extremes grow with the time of observation: each has that of its window. The return level of a time t is passed in
    a window of the length T with the probability ``1 − exp(−T/t)``, which is T/t if t is long. It is that quantile of
    the extremes of windows, NaN where fewer than 10 of them lie beyond. For longer times two laws are fitted to the
    extremes by L-moments, that of Gumbel and the generalized one (GEV): their levels are extrapolations, as good as the
    law, and levels of two windows or of both laws that differ show that it is not good.

    Between steps displacements follow Hermite's cubic of displacements and velocities, or two tangents where a rigid
    contact hits. Velocities and forces turn at the top of a parabola, and forces of contacts with a dashpot where
    `peak_contact_force` finds their peaks. Where white noise makes velocities rough, the largest value at the steps is
    raised by 0.58 of the root mean square that noise adds in a step, as for the maximum of a Brownian path. All steps
    are taken, without jumps.

    Parameters
    ----------
    of : mapping, sequence or str, optional
        Linear forms by name: a name, of a body or point for its displacement and of a contact for its force; a quantity
        with a name, such as ``("velocity", "upper")``; or weights by these. A sequence of such names stands for forms
        that have their names. Units are those of the terms, and left out where these differ. By default all bodies
        and contacts.
    windows : sequence of float
        Lengths of the windows (s), whole multiples of the shortest one.
    return_times : sequence of float, optional
        Return times (s); by default 1, 10 and 100 of the longest windows.

    Examples
    --------
    >>> drift = il.Extremes({"drift": {"upper": 1.0, "lower": -1.0}}, windows=(10.0,))
    >>> speed = il.Extremes({"speed": ("velocity", "upper")}, windows=(10.0,))
    """

    citation = article(
        "Hosking, J. R. M.",
        "L-moments: analysis and estimation of distributions using linear combinations of order statistics",
        "J. R. Stat. Soc. B", 52, 1990, "105", "10.1111/j.2517-6161.1990.tb01775.x",
    )  # fmt: skip

    windows: tuple[float, ...] = parameter((10.0, 600.0), units="s")
    return_times: tuple[float, ...] | None = parameter(None, units="s")

    peaks: ClassVar[bool] = True

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.windows or min(self.windows) <= 0.0:
            raise InvalidInput(f"Extremes.windows must be larger than 0 s, not {self.windows!r}.")
        for window, count in zip(self.windows, self.lengths, strict=True):
            if abs(count * min(self.windows) - window) > 1e-9 * window:
                raise InvalidInput(
                    f"Extremes.windows must be whole multiples of the shortest one, {min(self.windows):g} s, and "
                    f"{window:g} s is not."
                )
        if len(set(self.lengths)) < len(self.windows):
            raise InvalidInput(f"Extremes.windows are given twice: {self.windows!r}.")
        for time in self.return_times or ():
            if time <= 0.0:
                raise InvalidInput(f"Extremes.return_times must be larger than 0 s, not {time!r}.")

    @property
    def lengths(self) -> list[int]:
        """Lengths of the windows in those of the shortest one."""
        return [round(window / min(self.windows)) for window in self.windows]

    def exact_interval(self) -> float | None:
        return min(self.windows)

    def keeper(self, run: RecordedRun, realizations: np.ndarray, ratio: int) -> Keeper:
        return _Blocks(self, run.plan, realizations)

    def blocks(self, plan: Plan) -> int:
        """Return the number of the shortest windows in the run; refuse a run that is shorter than the longest."""
        clock = plan.clock
        if max(self.windows) > clock.duration * (1.0 + 1e-9):
            raise InvalidInput(
                f"Extremes: a window of {max(self.windows):g} s is longer than the duration of {clock.duration:g} s; "
                "give shorter windows= or run for longer."
            )
        return clock.steps // round(min(self.windows) / clock.step)

    def bytes_per_realization(self, run: RecordedRun, interval: float) -> int:
        return 16 * len(self.of) * self.blocks(run.plan)

    def label(self, run: RecordedRun, results: list[dict[str, np.ndarray]], interval: float) -> Variables:
        forms: Forms = self.of
        blocks = np.concatenate([result["blocks"] for result in results])  # (realization, block, form, side)
        times = np.array(self.return_times or [factor * max(self.windows) for factor in (1.0, 10.0, 100.0)])
        parts = run.parts if run.realizations < BATCHES else 1
        found = _Found.empty(len(forms), len(self.windows), len(times))
        for column, (window, length) in enumerate(zip(self.windows, self.lengths, strict=True)):
            for row, kind, sign, maxima in _maxima(blocks, length):
                groups = _groups(len(maxima), maxima.shape[1], parts)
                trusted = bool(run.plan.realizations.trusted and groups[-1] + 1 >= BATCHES)
                found.take((row, kind, column), sign, maxima.ravel(), groups, times / window, trusted)
        of_block = "realization", "extreme_block", "extreme_form"
        units = units_of(forms)
        return {
            **found.labelled(units),
            "window_maximum": labelled(of_block, blocks[:, :, :, 0], units, "maximum in each of the shortest windows"),
            "window_minimum": labelled(of_block, -blocks[:, :, :, 1], units, "minimum in each of the shortest windows"),
            "extreme_form": names_of_forms("extreme_form", forms),
            "extreme_kind": (("extreme_kind",), np.array(EXTREMES), {"long_name": "kind of the extreme"}),
            "extreme_window": labelled(("extreme_window",), np.array(self.windows), "s", "length of the windows"),
            "extreme_return_time": labelled(("extreme_return_time",), times, "s", "return time"),
            "extreme_tail": (("extreme_tail",), np.array(TAILS), {"long_name": "law that is fitted"}),
        }


def _maxima(blocks: np.ndarray, length: int) -> Any:
    """Yield the form, the kind, its sign, and maxima in windows of some blocks, (realization, window)."""
    count = blocks.shape[1] // length
    whole = blocks[:, : count * length].reshape(len(blocks), count, length, *blocks.shape[2:]).max(axis=2)
    for row in range(blocks.shape[2]):
        sides = whole[:, :, row, 0], whole[:, :, row, 1], whole[:, :, row].max(axis=2)
        for kind, maxima in enumerate(sides):
            yield row, kind, -1.0 if EXTREMES[kind] == "minimum" else 1.0, maxima


def _groups(realizations: int, windows: int, parts: int) -> np.ndarray:
    """Return the number of the independent group of each window: a realization, or a part of one."""
    parts = min(parts, windows)
    within = np.arange(windows) * parts // windows
    return (np.arange(realizations)[:, None] * parts + within).ravel()


class _Found:
    """Values and errors, [value or error, form, kind, window, …]."""

    def __init__(self, moments: np.ndarray, levels: np.ndarray, laws: np.ndarray, beyond: np.ndarray) -> None:
        self.moments, self.levels, self.laws, self.beyond = moments, levels, laws, beyond

    @classmethod
    def empty(cls, forms: int, windows: int, times: int) -> _Found:
        """Return room for all."""
        shape = 2, forms, len(EXTREMES), windows
        inner = (2,), (times,), (len(TAILS), 3), (len(TAILS), times)
        return cls(*(np.full((*shape, *item), np.nan) for item in inner))

    def take(
        self, place: tuple[int, int, int], sign: float, maxima: np.ndarray, groups: np.ndarray, periods: np.ndarray,
        trusted: bool,
    ) -> None:  # fmt: skip
        """Take what maxima, or minima with the other sign, tell of return levels in so many windows."""
        at, number = (slice(None), *place), len(TAILS)
        summary = np.stack(without_each(partial(summary_of, periods=periods), maxima, groups, trusted))
        self.moments[at], laws, beyond = summary[:, :2], summary[:, 2 : 2 + 3 * number], summary[:, 2 + 3 * number :]
        self.laws[at], self.beyond[at] = laws.reshape(2, number, 3), beyond.reshape(2, number, -1)
        self.levels[at] = np.transpose(
            [level_with_error(maxima, groups, math.exp(-1.0 / period), trusted) for period in periods]
        )
        value = (0, *place)
        self.moments[value][0] *= sign
        self.laws[value][:, 0] *= sign
        self.levels[value] *= sign
        self.beyond[value] *= sign

    def labelled(self, units: str) -> Variables:
        """Return the variables."""
        dims = "extreme_form", "extreme_kind", "extreme_window"
        level = "value that is passed in a window once in the return time, on average"
        variables: Variables = {}
        for name, extra, (value, error), own, text in (
            ("mean", (), self.moments[..., 0], units, "mean over windows of the extreme in each"),
            ("deviation", (), self.moments[..., 1], units, "standard deviation of the extremes of windows"),
            ("return_level", ("extreme_return_time",), self.levels, units, level),
            ("location", ("extreme_tail",), self.laws[..., 0], units, f"location {FITTED}"),
            ("scale", ("extreme_tail",), self.laws[..., 1], units, f"scale {FITTED}"),
            ("shape", ("extreme_tail",), self.laws[..., 2], "1", f"shape {FITTED}"),
            ("fitted_level", ("extreme_tail", "extreme_return_time"), self.beyond, units, f"return level {FITTED}"),
        ):
            variables |= with_error(f"extreme_{name}", (*dims, *extra), value, error, own, text)
        return variables


class _Blocks(Keeper):
    """Keeps the maxima of forms, and of their negatives, in the shortest windows."""

    wants_start = True

    def __init__(self, record: Extremes, plan: Plan, realizations: np.ndarray) -> None:
        super().__init__()
        self.window, lanes = round(min(record.windows) / plan.clock.step), len(realizations)
        self.blocks = np.full((len(record.of), 2, record.blocks(plan), lanes), -np.inf)
        paths, jumps = paths_of(record.of, plan)
        self.raised, slots = RAISED * jumps, places_of(plan.snapshot.contacts)
        self.turns = [(form, TurnsOfPath(path, lanes, self.window), 0) for form, path in enumerate(paths)]
        for form, item in enumerate(record.of):
            if (peaks := _peaks_of(item.terms, plan, slots)) is not None:
                self.turns.append((form, TurnsOfPath(peaks, lanes, self.window), 1))

    def start(self, values: np.ndarray) -> None:
        for _, turns, _ in self.turns:
            turns.start(values)

    def add(self, snapshots: np.ndarray, batch: int) -> None:
        for form, turns, before in self.turns:
            for places, values, number in turns.next(snapshots):
                places[1] -= before  # a peak is one of the step that ends
                widen(places, values, number, self.window, self.blocks[form])

    def result(self) -> dict[str, np.ndarray]:
        raised = self.raised[:, None, None, None]
        return {"blocks": (self.blocks + raised).transpose(3, 2, 0, 1)}


def _peaks_of(terms: tuple[tuple[str, str, float], ...], plan: Plan, slots: Mapping[str, int]) -> PathOfForm | None:
    """Return the path of the peaks of the one force of a form, if snapshots hold them."""
    quantity, name, weight = terms[0]
    if len(terms) > 1 or quantity != "contact_force" or not (plan.snapshot.peaked and plan.observed.rated[slots[name]]):
        return None
    row, none = plan.snapshot.place(PEAKS.name).start + slots[name], np.zeros(0, dtype=np.int64)
    return PathOfForm(np.array([row]), np.array([weight]), none, none, plan.clock.step, BROWNIAN, True)
