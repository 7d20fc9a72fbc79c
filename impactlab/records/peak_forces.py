"""Records of peaks: the largest contact forces in windows of time, and how often levels are crossed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from impactlab.assembly.model import Model
from impactlab.components.fields import parameter
from impactlab.errors import WORTH_SAYING, InvalidInput
from impactlab.inputs import finite, suggestion
from impactlab.kernels.histogram import add_crossings, find_peaks
from impactlab.plan.plan import Plan
from impactlab.records.reach import deepest
from impactlab.records.record import Keeper, Record
from impactlab.records.recorded_run import RecordedRun
from impactlab.results.labels import Variables, labelled, with_error
from impactlab.results.snapshot import PEAKS, places_of
from impactlab.statistics.subsamples import OF_BAND, in_subsamples, mean_of_subsamples

PER_OCTAVE, OCTAVES = 64, 8
"""Bins of the peaks of forces that depend on the rate, to each factor of two, and these factors below the largest."""


class PeakForces(Record):
    """Largest contact forces in windows of time, and forces that are exceeded once in a given time.

    Peaks grow with the time of observation: each has that of its window, in which forces are read at the steps, and
    between them if they depend on the rate. The return level F of a time t has ``ν(F) t = 1``; ν is the rate of peaks
    above F. For forces of the indentation alone it is that at which indentations are crossed on the way in, a flux like
    the contact rate, so that no short contact is missed. Where a dashpot takes part, peaks are counted, each from where
    the force rises to twice its least to where it falls to half its largest. Levels are NaN for forces that depend on
    time.
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

    Notes
    -----
    A level is exceeded within a time with a probability below the bound of equation :eq:`exceedance` of the theory.

    Examples
    --------
    >>> result = il.simulate(network, 20.0, realizations=64, record=il.PeakForces(window=5.0), rng=1)
    >>> result.window_peak_force.dims
    ('realization', 'window', 'contact')
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
            raise InvalidInput(f"PeakForces.limits is a number or {{name: number}} (m), not {self.limits!r}.")
        for time in self.return_times or ():
            if time <= 0.0:
                raise InvalidInput(f"PeakForces.return_times must be larger than 0 s, not {time!r}.")

    every_step: ClassVar[bool] = True
    peaks: ClassVar[bool] = True

    def resolved(self, model: Model) -> Record:
        known = places_of(tuple(model.network.contacts))
        names = tuple(self.contacts or known)
        given = dict(self.limits) if isinstance(self.limits, tuple) else dict.fromkeys(names, self.limits)
        for name in (*names, *given):
            if name not in known:
                raise InvalidInput(f"PeakForces: there is no contact {name!r}; {suggestion(name, known)}")
            if model.contacts.round[known[name]]:
                raise InvalidInput(
                    f"PeakForces: {name!r} is a round contact, of which no crossings are recorded; name others in "
                    "contacts=. Its largest force is peak_contact_force."
                )
            if model.contacts.impulsive[known[name]]:
                law = type(model.contacts.laws[known[name]]).__name__
                raise InvalidInput(f"PeakForces: {name!r} is a {law}: its impacts have an impulse, but no force.")
        depths = dict(zip(known, deepest(model).tolist(), strict=True))
        limits = []
        for name in names:
            depth = depths[name] if given.get(name) is None else finite(f"PeakForces.limits of {name!r}", given[name])
            if not 0.0 < depth < math.inf:
                state = "must be more than 0 m and finite" if given.get(name) is not None else "cannot be estimated"
                raise InvalidInput(
                    f"PeakForces: the largest indentation of {name!r} {state} (it is {depth!r}); give "
                    f"limits={{{name!r}: …}} (m)."
                )
            limits.append((name, depth))
        return self.replace(contacts=names, limits=tuple(limits))

    def stride(self, model: Model, step: float) -> int:
        return 1

    def keeper(self, run: RecordedRun, realizations: np.ndarray, ratio: int) -> Keeper:
        return _Peaks(self, run.plan, realizations)

    def steps_per_window(self, plan: Plan) -> int:
        """Return the number of steps in a window.

        Raises
        ------
        InvalidInput
            If it is longer than the run.
        """
        if self.window is None:
            return plan.clock.steps
        steps = max(1, int(self.window / plan.clock.step * (1.0 + 1e-9)))
        if steps > plan.clock.steps:
            raise InvalidInput(
                f"PeakForces.window of {self.window:g} s is longer than the duration of {plan.clock.duration:g} s."
            )
        return steps

    def bytes_per_realization(self, run: RecordedRun, interval: float) -> int:
        plan = run.plan
        bins = 3 * self.bins * len(self.limits) + PER_OCTAVE * OCTAVES * len(self._rated(plan))
        windows = len(self.limits) * (plan.clock.steps // self.steps_per_window(plan))
        return 8 * (plan.samples_per_realization * bins + windows)

    def _slots(self, plan: Plan) -> list[int]:
        """Return the places of the contacts among all."""
        places = places_of(plan.system.contacts)
        return [places[name] for name, _ in self.limits]

    def _rated(self, plan: Plan) -> list[int]:
        """Return which of the contacts have forces that depend on the rate, so that peaks are counted."""
        slots = self._slots(plan)
        return np.flatnonzero(plan.observed.rated[slots]).tolist() if plan.snapshot.peaked else []

    def label(self, run: RecordedRun, results: list[dict[str, np.ndarray]], interval: float) -> Variables:
        plan = run.plan
        count, window = len(plan.system.contacts), self.steps_per_window(plan) * plan.clock.step
        if not count:
            return {}
        flux, inward, push, samples = (
            in_subsamples([result[key] for result in results]) for key in ("flux", "inward", "push", "samples")
        )
        peaks = np.concatenate([result["peaks"] for result in results])
        above = {row: _above(results, number) for number, row in enumerate(self._rated(plan))}
        times = np.array(self.return_times or (window, 10.0 * window, 100.0 * window))
        rate, error, indentation, force = np.full((4, count, self.bins), np.nan)
        factor, everywhere = np.full(count, np.nan), np.full((*peaks.shape[:2], count), np.nan)
        levels = np.full((2, count, len(times)), np.nan)
        for row, (slot, (_, depth)) in enumerate(zip(self._slots(plan), self.limits, strict=True)):
            width = depth / self.bins
            own, total = flux[:, row], inward[:, row].sum(axis=0)
            indentation[slot] = (np.arange(self.bins) + 0.5) * width
            force[slot] = np.divide(push[:, row].sum(axis=0), total, out=np.full(self.bins, np.nan), where=total > 0.0)
            trusted = plan.realizations.trusted
            mean, scatter, factor[slot] = mean_of_subsamples(own, samples[:, None], trusted, slice(None))
            rate[slot], error[slot] = mean / width, np.where(mean > 0.0, scatter / width, np.nan)
            relative = np.divide(scatter, mean, out=np.full(self.bins, np.inf), where=mean > 0.0)
            if plan.realizations.trusted and not plan.forces.timed_contacts[slot]:
                curve = own, samples, rate[slot], relative, force[slot]
                if row in above:
                    own, forces = above[row]
                    mean, scatter, _ = mean_of_subsamples(own, samples[:, None], trusted, slice(None))
                    relative = np.divide(scatter, mean, out=np.full(len(mean), np.inf), where=mean > 0.0)
                    curve = own, samples, mean / plan.clock.step, relative, forces
                levels[:, slot] = np.transpose([_return_level(*curve, time) for time in times])
            everywhere[:, :, slot] = peaks[:, :, row]
        per_bin, per_time = ("contact", "crossing_bin"), ("contact", "return_time")
        of_rate = "rate of crossings of an indentation on the way in, averaged over bins"
        of_level = "contact force that is exceeded once in the return time, on average"
        return {
            "window_peak_force": labelled(
                ("realization", "window", "contact"), everywhere, "N", "largest contact force in each window"
            ),
            "peak_window": labelled((), np.array(window), "s", "length of the windows of peaks"),
            **with_error("crossing_rate", per_bin, rate, error, "s-1", of_rate),
            "crossing_rate_band_factor": (("contact",), factor, OF_BAND),
            "crossing_indentation": labelled(per_bin, indentation, "m", "centers of the bins"),
            "crossing_force": labelled(per_bin, force, "N", "mean contact force at crossings"),
            "return_time": labelled(("return_time",), times, "s", "return time"),
            **with_error("return_level", per_time, levels[0], levels[1], "N", of_level),
        }


class _Peaks(Keeper):
    def __init__(self, record: PeakForces, plan: Plan, realizations: np.ndarray) -> None:
        super().__init__()
        self.record, self.parts, self.window = record, plan.samples_per_realization, record.steps_per_window(plan)
        bodies, count, lanes = len(plan.system.bodies), len(record.limits), len(realizations)
        slots = record._slots(plan)
        first = [plan.snapshot.place(name).start for name in ("displacement", "velocity", "contact_force")]
        of_peaks = plan.snapshot.place(PEAKS.name).start if plan.snapshot.peaked else first[2]
        self.forces = first[2] + np.array(slots, dtype=np.int64)
        ends = [plan.system.ends.chosen(np.array([slot])) for slot in slots]
        moving = [item.slots < bodies for item in ends]
        self.weights = [item.weights[some] for item, some in zip(ends, moving, strict=True)]
        self.rows = [
            np.stack([row + item.slots[some] for row in first[:2]]) for item, some in zip(ends, moving, strict=True)
        ]
        self.clearance = plan.system.clearance[slots]
        self.inverse_width = np.array([record.bins / depth for _, depth in record.limits])
        self.flux, self.inward, self.push = np.zeros((3, self.parts, count, lanes, record.bins))
        self.samples = np.zeros((lanes, self.parts))
        self.largest = of_peaks + np.array(slots, dtype=np.int64)
        self.peaks = np.zeros((lanes, plan.clock.steps // self.window, count))
        self.counted = [_CountedPeaks(self.largest[row], self.parts, lanes) for row in record._rated(plan)]

    def add(self, snapshots: np.ndarray, batch: int) -> None:
        begin, self.seen = self.seen, self.seen + len(snapshots)
        part = min(batch, self.parts - 1)
        self.samples[:, part] += len(snapshots)
        for row in range(len(self.rows)):
            target = self.flux[part, row], self.inward[part, row], self.push[part, row]
            along = self.rows[row], self.weights[row], self.forces[row]
            add_crossings(snapshots, along, self.clearance[row], self.inverse_width[row], *target)
        for window in range(begin // self.window, min((self.seen - 1) // self.window + 1, self.peaks.shape[1])):
            inside = slice(max(window * self.window - begin, 0), (window + 1) * self.window - begin)
            largest = snapshots[inside, self.largest].max(axis=0).T
            np.maximum(self.peaks[:, window], largest, out=self.peaks[:, window])
        for item in self.counted:
            item.add(snapshots, part)

    def result(self) -> dict[str, np.ndarray]:
        flux, inward, push = (item.transpose(2, 0, 1, 3) for item in (self.flux, self.inward, self.push))
        return {
            "flux": flux, "inward": inward, "push": push, "samples": self.samples, "peaks": self.peaks,
            "counts": np.array([item.counts for item in self.counted]),
            "highest": np.array([item.highest for item in self.counted]),
        }  # fmt: skip


class _CountedPeaks:
    """Numbers of peaks of one force by their size, in bins of which the highest is that of the largest peak so far."""

    def __init__(self, row: int, parts: int, lanes: int) -> None:
        self.row, self.level, self.highest = row, np.zeros(lanes), np.iinfo(np.int64).min // 2
        self.counts = np.zeros((lanes, parts, PER_OCTAVE * OCTAVES))

    def add(self, snapshots: np.ndarray, part: int) -> None:
        """Take snapshots of a part."""
        peaks = np.empty((len(snapshots), len(self.level)))
        find_peaks(snapshots, self.row, self.level, peaks)
        samples, lanes = np.nonzero(peaks)
        if not len(samples):
            return
        bins = np.floor(np.log2(peaks[samples, lanes]) * PER_OCTAVE).astype(np.int64)
        highest = max(self.highest, int(bins.max()))
        self.counts, self.highest = _raised(self.counts, highest - self.highest), highest
        place = bins - highest + self.counts.shape[2] - 1
        np.add.at(self.counts, (lanes[place >= 0], part, place[place >= 0]), 1.0)


def _raised(counts: np.ndarray, by: int) -> np.ndarray:
    """Return numbers in bins, the last axis, that are higher by so many; the lowest are left out."""
    raised = np.zeros_like(counts)
    if by < counts.shape[-1]:
        raised[..., : counts.shape[-1] - by] = counts[..., by:]
    return raised


def _above(results: list[dict[str, np.ndarray]], number: int) -> tuple[np.ndarray, np.ndarray]:
    """Return how many peaks of a force are above some values in each subsample, and these values (N)."""
    highest = max(int(result["highest"][number]) for result in results)
    counts = in_subsamples(
        [_raised(result["counts"][number], highest - int(result["highest"][number])) for result in results]
    )
    exponents = (np.arange(counts.shape[1]) + highest + 1 - counts.shape[1]) / PER_OCTAVE
    return np.cumsum(counts[:, ::-1], axis=1)[:, ::-1], np.exp2(np.maximum(exponents, -1000.0))


def _return_level(
    flux: np.ndarray, samples: np.ndarray, rate: np.ndarray, relative: np.ndarray, force: np.ndarray, time: float
) -> tuple[float, float]:
    """Force at which crossings are once in a time, and its standard error; NaN if it is not known.

    Around the level, where the rate is within a factor e of one in the time, its logarithm has the form of a Gibbs law:
    ``a + b δ + c ∫F``, F being a parabola in the indentation δ. Its largest value must be known to be above one in
    the time.
    """
    with np.errstate(divide="ignore"):
        distance = np.log(rate * time)
    # return levels are taken from rates that are known to a quarter
    usable = (relative <= 0.25) & np.isfinite(force) & (np.abs(distance) <= 1.0)
    top, last = int(np.argmax(rate)), int(np.flatnonzero(usable).max(initial=-1))
    begin = int(np.flatnonzero(~usable[:top]).max(initial=-1)) + 1  # of the usable bins around the top
    near = np.flatnonzero(usable & (np.arange(len(rate)) >= begin))
    if len(near) < 4 or last < top or distance[near].max() < 0.0 or distance[last] > 0.0:
        return math.nan, math.nan
    middle, half = 0.5 * (near[0] + near[-1]), 0.5 * (near[-1] - near[0])
    place = (near - middle) / half
    level, stiffness, bend = np.linalg.lstsq(np.vander(place, 3, increasing=True), force[near], rcond=None)[0]
    twist = (
        2.0 / 3.0 * np.clip(bend / stiffness, -0.5, 0.5) if stiffness > 0.0 else 0.0
    )  # of the work, δ² (1 + twist δ)
    weights = 1.0 / relative[near]
    terms = np.stack([np.ones(len(near)), place, place**2 * (1.0 + twist * place)], axis=1)
    solve = np.linalg.pinv(weights[:, None] * terms) * weights
    logarithm = np.polynomial.Polynomial([*(solve @ distance[near]), 0.0])
    logarithm.coef[3] = twist * logarithm.coef[2]
    # what each subsample adds to the logarithms of the rates
    parts = flux[:, near] / flux[:, near].sum(axis=0) - samples[:, None] / samples.sum()
    subsamples = len(samples)

    def scatter(at: float) -> float:
        moved = parts @ ([1.0, at, at**2 * (1.0 + twist * at)] @ solve)
        return math.hypot(WORTH_SAYING, math.sqrt(float((moved**2).sum()) * subsamples / (subsamples - 1.0)))

    highest = place[int(np.argmax(logarithm(place)))]
    roots = logarithm.roots()
    falling = [x for x in roots[roots.imag == 0.0].real if highest <= x <= 1.0 and logarithm.deriv()(x) < 0.0]
    # the largest rate must be above one in a return time by three standard errors, or its level is not known
    if not falling or logarithm(highest) < 3.0 * scatter(highest):
        return math.nan, math.nan
    crossed = falling[0]
    slope = (stiffness + 2.0 * bend * crossed) / abs(float(logarithm.deriv()(crossed)))
    return float(level + crossed * (stiffness + bend * crossed)), scatter(crossed) * slope
