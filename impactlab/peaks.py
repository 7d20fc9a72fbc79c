"""Records of peaks: the largest contact forces in windows of time, and how often levels are crossed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from impactlab.component import finite, parameter, suggestion
from impactlab.errors import InvalidInput
from impactlab.groups import OF_BAND, grouped, mean_of_groups, samples_per_realization
from impactlab.kernels.histogram import add_crossings
from impactlab.model import Model
from impactlab.plan import Plan
from impactlab.record import Keeper, Record, Variables
from impactlab.scene import Stiffening, energies

REACH = 20.0
"""Thermal energies that the largest indentation stores, where it is not given."""

KNOWN = 0.25
"""Largest relative standard error of a rate from which return levels are taken."""


class PeakForces(Record):
    """Largest contact forces in windows of time, and forces that are exceeded once in a given time.

    Peaks grow with the time of observation: each has that of its window. Return levels come from the rate ν at
    which indentations are crossed on the way in, a flux like the contact rate, so that no short contact is missed. The
    return level F of a time t has ``ν(F) t = 1``, for forces that grow with the indentation and depend on it alone.
    The largest force in a time t is above any F with a probability of at most ``P(F(0) > F) + ν(F) t``; where
    crossings do not cluster it is below with the probability ``exp(−ν(F) t)``. All steps are taken, without jumps.

    Parameters
    ----------
    window : float, optional
        Length of the windows (s), whole steps; by default the duration.
    contacts : sequence of str, optional
        Contacts; all by default.
    bins : int
        Number of bins of the indentation.
    limits : float or mapping of str to float, optional
        Largest indentation of all contacts, or by name (m); by default that which stores 20 thermal energies.
    return_times : sequence of float, optional
        Return times (s); by default 1, 10 and 100 windows. Levels are NaN where rates are not known to 25 %.
    """

    window: float | None = parameter(None, units="s", above=0.0)
    contacts: tuple[str, ...] | None = parameter(None)
    bins: int = parameter(100, minimum=4)
    limits: Any = parameter(None)
    return_times: tuple[float, ...] | None = parameter(None, units="s")

    def __post_init__(self) -> None:
        super().__post_init__()
        if isinstance(self.limits, Mapping):
            object.__setattr__(self, "limits", tuple(self.limits.items()))
        elif isinstance(self.limits, list | tuple):  # of pairs, as a file has them
            pairs = tuple(tuple(item) if isinstance(item, list) else item for item in self.limits)
            object.__setattr__(self, "limits", pairs)
        by_name = isinstance(self.limits, tuple) and all(isinstance(item, tuple) for item in self.limits)
        if not (self.limits is None or isinstance(self.limits, int | float) or by_name):
            raise InvalidInput(f"PeakForces.limits is a number or {{name: number}} (m), {self.limits!r} was given.")
        for time in self.return_times or ():
            if finite("PeakForces.return_times", time) <= 0.0:
                raise InvalidInput(f"PeakForces.return_times must be larger than 0 s, {time!r} was given.")

    every_step: ClassVar[bool] = True

    def resolved(self, model: Model) -> Record:
        known = tuple(model.network.contacts)
        if isinstance(self.contacts, str):
            raise InvalidInput(f"PeakForces: contacts is a sequence of names, {self.contacts!r} was given.")
        names = tuple(self.contacts or known)
        given = dict(self.limits) if isinstance(self.limits, tuple) else dict.fromkeys(names, self.limits)
        for name in (*names, *given):
            if name not in known:
                raise InvalidInput(f"PeakForces: there is no contact {name!r}; {suggestion(name, known)}")
        heat = energies(model, "stationary", 1.0)
        depths = dict(zip(known, Stiffening.of(model, REACH * heat).penetration.tolist(), strict=True))
        limits = []
        for name in names:
            depth = depths[name] if given.get(name) is None else finite(f"PeakForces.limits of {name!r}", given[name])
            if not 0.0 < depth < math.inf:
                raise InvalidInput(
                    f"PeakForces: the largest indentation of {name!r} must be more than 0 m and finite, it is "
                    f"{depth!r}; give limits={{{name!r}: …}}."
                )
            limits.append((name, depth))
        return self.replace(contacts=names, limits=tuple(limits))

    def stride(self, model: Model, step: float) -> int:
        return 1

    def keeper(self, plan: Plan, realizations: np.ndarray, ratio: int) -> Keeper:
        return _Peaks(self, plan, realizations)

    def steps_per_window(self, plan: Plan) -> int:
        """Return the number of steps in a window.

        Raises
        ------
        InvalidInput
            If it is longer than the run.
        """
        if self.window is None:
            return plan.steps
        steps = max(1, int(self.window / plan.step * (1.0 + 1e-9)))
        if steps > plan.steps:
            raise InvalidInput(
                f"PeakForces.window of {self.window:g} s is longer than the duration of {plan.steps * plan.step:g} s."
            )
        return steps

    def bytes_per_realization(self, plan: Plan) -> int:
        bins, windows = 2 * samples_per_realization(plan) * self.bins, plan.steps // self.steps_per_window(plan)
        return 8 * len(self.limits) * (bins + windows)

    def label(self, plan: Plan, results: list[dict[str, np.ndarray]], interval: float) -> Variables:
        count, window = len(plan.contacts), self.steps_per_window(plan) * plan.step
        if not count:
            return {}
        flux, push, samples = (grouped([result[key] for result in results]) for key in ("flux", "push", "samples"))
        peaks = np.concatenate([result["peaks"] for result in results])
        times = np.array(self.return_times or (window, 10.0 * window, 100.0 * window))
        rate, error, indentation, force = np.full((4, count, self.bins), np.nan)
        factor, everywhere = np.full(count, np.nan), np.full((*peaks.shape[:2], count), np.nan)
        levels = np.full((2, count, len(times)), np.nan)
        for row, (name, depth) in enumerate(self.limits):
            slot, width = plan.contacts.index(name), depth / self.bins
            own, total = flux[:, row], flux[:, row].sum(axis=0)
            indentation[slot] = (np.arange(self.bins) + 0.5) * width
            force[slot] = np.divide(push[:, row].sum(axis=0), total, out=np.full(self.bins, np.nan), where=total > 0.0)
            mean, scatter, factor[slot] = mean_of_groups(own, samples[:, None], plan.trusted, slice(None))
            rate[slot], error[slot] = mean / width, np.where(mean > 0.0, scatter / width, np.nan)
            relative = np.divide(scatter, mean, out=np.full(self.bins, np.inf), where=mean > 0.0)
            if plan.trusted:
                found = [_return_level(own, samples, rate[slot], relative, force[slot], time) for time in times]
                levels[:, slot] = np.transpose(found)
            everywhere[:, :, slot] = peaks[:, :, row]
        per_bin, per_time = ("contact", "crossing_bin"), ("contact", "return_time")
        of_rate = "rate of crossings of an indentation on the way in, averaged over bins"
        of_level = "contact force that is exceeded once in the return time, on average"
        return {
            "window_peak_force": (
                ("realization", "window", "contact"),
                everywhere,
                _attrs("N", "largest contact force in each window"),
            ),
            "peak_window": ((), np.array(window), _attrs("s", "length of the windows of peaks")),
            "crossing_rate": (per_bin, rate, _attrs("s-1", of_rate, "crossing_rate_standard_error")),
            "crossing_rate_standard_error": (per_bin, error, _attrs("s-1", f"standard error of the {of_rate}")),
            "crossing_rate_band_factor": (("contact",), factor, OF_BAND),
            "crossing_indentation": (per_bin, indentation, _attrs("m", "centers of the bins")),
            "crossing_force": (per_bin, force, _attrs("N", "mean contact force at crossings")),
            "return_time": (("return_time",), times, _attrs("s", "return time")),
            "return_level": (per_time, levels[0], _attrs("N", of_level, "return_level_standard_error")),
            "return_level_standard_error": (per_time, levels[1], _attrs("N", "standard error of the return level")),
        }


def _attrs(units: str, long_name: str, error: str | None = None) -> dict[str, str]:
    attrs = {"units": units, "long_name": long_name}
    return attrs if error is None else {**attrs, "ancillary_variables": error}


class _Peaks(Keeper):
    def __init__(self, record: PeakForces, plan: Plan, realizations: np.ndarray) -> None:
        self.record, self.seen, self.parts = record, 0, samples_per_realization(plan)
        self.window = record.steps_per_window(plan)
        bodies, count, lanes = len(plan.bodies), len(record.limits), len(realizations)
        slots = [plan.contacts.index(name) for name, _ in record.limits]
        ends = plan.ends[slots]
        places = np.where(ends < bodies, ends, -1)
        self.forces = 2 * bodies + np.array(slots, dtype=np.int64)
        self.rows = np.column_stack([places, np.where(places < 0, -1, bodies + places), self.forces])
        self.clearance = plan.clearance[slots]
        self.inverse_width = np.array([record.bins / depth for _, depth in record.limits])
        self.flux, self.push = np.zeros((2, self.parts, count, lanes, record.bins))
        self.samples = np.zeros((lanes, self.parts))
        self.peaks = np.zeros((lanes, plan.steps // self.window, count))

    def add(self, snapshots: np.ndarray, batch: int) -> None:
        begin, self.seen = self.seen, self.seen + len(snapshots)
        part = min(batch, self.parts - 1)
        self.samples[:, part] += len(snapshots)
        for row in range(len(self.rows)):
            target = self.flux[part, row], self.push[part, row]
            add_crossings(snapshots, self.rows[row], self.clearance[row], self.inverse_width[row], *target)
        for window in range(begin // self.window, min((self.seen - 1) // self.window + 1, self.peaks.shape[1])):
            inside = slice(max(window * self.window - begin, 0), (window + 1) * self.window - begin)
            largest = snapshots[inside, self.forces].max(axis=0).T
            np.maximum(self.peaks[:, window], largest, out=self.peaks[:, window])

    def result(self) -> dict[str, np.ndarray]:
        flux, push = (item.transpose(2, 0, 1, 3) for item in (self.flux, self.push))
        return {"flux": flux, "push": push, "samples": self.samples, "peaks": self.peaks}


def _return_level(
    flux: np.ndarray, samples: np.ndarray, rate: np.ndarray, relative: np.ndarray, force: np.ndarray, time: float
) -> tuple[float, float]:
    """Force at which crossings are once in a time, and its standard error; NaN if it is not known.

    The force is a parabola in the logarithm of the rate where that is within a factor e of one in the time.
    """
    falling = np.arange(len(rate)) >= int(np.argmax(rate))
    with np.errstate(divide="ignore"):
        distance = np.log(rate * time)
    near = np.flatnonzero(falling & (relative <= KNOWN) & np.isfinite(force) & (np.abs(distance) <= 1.0))
    y = distance[near]
    if len(near) < 4 or y[0] < 0.0 or y[-1] > 0.0:
        return math.nan, math.nan
    weights = 1.0 / relative[near]
    solve = np.linalg.pinv(weights[:, None] * np.vander(y, 3, increasing=True)) * weights
    level, slope, bend = solve @ force[near]
    # what each group adds to the logarithms of the rates moves the parabola
    parts = flux[:, near] / flux[:, near].sum(axis=0) - samples[:, None] / samples.sum()
    moved = parts @ (solve[0] * (slope + 2.0 * bend * y))
    groups = len(samples)
    return float(level), math.sqrt(float((moved**2).sum()) * groups / (groups - 1.0))
