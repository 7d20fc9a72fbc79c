"""Records of statistics over the cycle of a periodic force."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from impactlab.assembly.model import Model
from impactlab.components.fields import parameter
from impactlab.errors import InvalidInput, unheard
from impactlab.inputs import suggestion
from impactlab.kernels.histogram import count_samples
from impactlab.plan.plan import Plan
from impactlab.records.density import Counts, Density
from impactlab.records.record import Keeper, Record, names_of
from impactlab.records.recorded_run import RecordedRun
from impactlab.results.labels import Variables, labelled, with_error
from impactlab.results.snapshot import ALL, places_of
from impactlab.statistics.subsamples import in_subsamples, mean_of_subsamples

_SQUARES = {"m": "m2", "m s-1": "m2 s-2", "N": "N2"}


def phase_variable(quantity: str, phases: int) -> Variables:
    """Return the phases at which there are samples, from 0 on (rad)."""
    values = 2.0 * math.pi * np.arange(phases) / phases
    return {f"{quantity}_phase": labelled((f"{quantity}_phase",), values, "rad", "phase of the cycle")}


def places(first: int, ratio: int, taken: int, phases: int) -> list[int]:
    """Return where the first sample of each phase is among snapshots, if every `ratio`-th from the first on is one.

    So many samples were taken before; the first of all is one interval after t = 0.
    """
    return [first + (phase - taken - 1) % phases * ratio for phase in range(phases)]


class PhaseMeans(Record):
    """Means and variances over realizations at phases of a cycle: of bodies, points of structures or contact forces.

    Under a periodic force of a period T the statistics vary with the phase 2π t/T, where t = 0 is the begin of the
    statistics and of the time of forces. What `simulate` returns otherwise are means over the cycle.

    Parameters
    ----------
    quantity : str
        "displacement", "velocity" or "contact_force"; "point_displacement" or "point_velocity" at points of structures.
    period : float
        Period T (s): that of the force, or a multiple of it to see subharmonic motion.
    labels : sequence of str, optional
        Bodies, contacts or points; all by default.
    phases : int
        Number of phases, which begin at 0. The step of the run divides the time between two of them.

    Examples
    --------
    >>> result = il.simulate(network, 20.0, realizations=64, record=il.PhaseMeans(period=2.0, phases=8), rng=1)
    >>> result.phase_mean_displacement.dims
    ('displacement_phase', 'oscillator')
    """

    quantity: str = parameter("displacement")
    period: float = parameter(units="s", above=0.0, kw_only=True)
    labels: tuple[str, ...] | None = parameter(None, kw_only=True)
    phases: int = parameter(16, minimum=1)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.quantity not in ALL:
            raise InvalidInput(f"PhaseMeans.quantity: {suggestion(self.quantity, ALL)}")

    @property
    def identity(self) -> tuple[str, ...]:
        return type(self).__name__, self.quantity

    def resolved(self, model: Model) -> Record:
        return self.replace(labels=names_of(self, "label", self.labels, self.quantity, model))

    def exact_interval(self) -> float | None:
        return self.period / self.phases

    def keeper(self, run: RecordedRun, realizations: np.ndarray, ratio: int) -> Keeper:
        return _Moments(self, run.plan, realizations, ratio)

    def bytes_per_realization(self, run: RecordedRun, interval: float) -> int:
        return 8 * run.plan.samples_per_realization * self.phases * (2 * len(self.labels or ()) + 1)

    def label(self, run: RecordedRun, results: list[dict[str, np.ndarray]], interval: float) -> Variables:
        plan = run.plan
        q, known = self.quantity, plan.snapshot.names(self.quantity)
        if not known:
            return {}
        sums, squares, samples = (in_subsamples([item[key] for item in results]) for key in _Moments.KEPT)
        value, spread = np.full((2, 2, self.phases, len(known)), np.nan)  # (value or error, mean or variance, …)
        slots = places_of(known)
        rows = [slots[name] for name in self.labels or ()]
        for phase in range(self.phases):
            number, first = samples[:, phase, None], sums[:, phase]
            mean, error, _ = mean_of_subsamples(first, number, plan.realizations.trusted, slice(None))
            centred = squares[:, phase] - 2.0 * mean * first + mean**2 * number
            variance, of_variance, _ = mean_of_subsamples(centred, number, plan.realizations.trusted, slice(None))
            value[:, phase, rows], spread[:, phase, rows] = (mean, variance), (error, of_variance)
        dims, units, text = (f"{q}_phase", ALL[q].dimension), ALL[q].units, f"{ALL[q].long_name} at a phase"
        return {
            **with_error(f"phase_mean_{q}", dims, value[0], spread[0], units, f"mean {text}"),
            **with_error(f"phase_variance_{q}", dims, value[1], spread[1], _SQUARES[units], f"variance of the {text}"),
            **phase_variable(q, self.phases),
        }


class PhaseDensity(Density):
    """Probability density at phases of a cycle, as `Density` otherwise.

    Parameters
    ----------
    quantity : str
        "displacement" or "velocity"; "point_displacement" or "point_velocity" at points of structures.
    period : float
        Period T of the phase 2π t/T (s), as of `PhaseMeans`.
    phases : int
        Number of phases, which begin at 0.
    oscillators, bins, limits
        As of `Density`.

    Examples
    --------
    >>> record = il.PhaseDensity(period=2.0, phases=4, bins=30)
    >>> result = il.simulate(network, 20.0, realizations=64, record=record, rng=1)
    >>> result.phase_density_displacement.dims
    ('density_displacement_phase', 'oscillator', 'phase_displacement_bin')
    """

    period: float = parameter(units="s", above=0.0, kw_only=True)
    phases: int = parameter(8, minimum=1, kw_only=True)

    def exact_interval(self) -> float | None:
        return self.period / self.phases

    def stride(self, model: Model, step: float) -> int:
        return round(self.period / self.phases / step)

    def bytes_per_block(self, run: RecordedRun) -> int:
        return self.phases * super().bytes_per_block(run)

    def keeper(self, run: RecordedRun, realizations: np.ndarray, ratio: int) -> Keeper:
        return _PhaseCounts(self, run.plan, realizations, ratio)

    def label(self, run: RecordedRun, results: list[dict[str, np.ndarray]], interval: float) -> Variables:
        q, counts = self.quantity, results[0]["counts"]  # (subsample, body, phase, bin)
        whole = super().label(run, [{"counts": counts.sum(axis=2)}], interval)  # warns of limits
        with unheard():
            each = [
                super(PhaseDensity, self).label(run, [{"counts": item}], interval) for item in np.moveaxis(counts, 2, 0)
            ]
        density, error = (
            np.stack([item[f"density_{q}{ending}"][1] for item in each]) for ending in ("", "_standard_error")
        )
        (of, along), _, attributes = whole[f"density_{q}"]
        dims, text = (f"density_{q}_phase", of, f"phase_{along}"), f"{attributes['long_name']}, at a phase"
        _, edges, of_edges = whole[f"{q}_edges"]
        _, centers, of_centers = whole[f"{q}_center"]
        return {
            **with_error(f"phase_density_{q}", dims, density, error, attributes["units"], text),
            f"phase_{q}_edges": ((of, f"phase_{q}_edge"), edges, of_edges),
            f"phase_{q}_center": (dims[1:], centers, of_centers),
            **phase_variable(f"density_{q}", self.phases),
        }


class _PhaseCounts(Counts):
    """Histograms per phase and subsample of realizations."""

    def __init__(self, record: PhaseDensity, plan: Plan, realizations: np.ndarray, ratio: int) -> None:
        super().__init__(record, plan, realizations, ratio)
        bodies, subsamples, bins = self.counts.shape
        self.counts, self.taken = np.zeros((bodies, record.phases, subsamples, bins), dtype=np.int64), 0

    def add(self, snapshots: np.ndarray, batch: int) -> None:
        first, values, phases = self.first_of(snapshots), self.reader(snapshots), self.counts.shape[1]
        for row, of_row, (_, low, high) in zip(self.reader.rows, self.counts, self.record.limits, strict=True):
            inverse_width = self.record.bins / (high - low)
            for counts, place in zip(of_row, places(first, self.ratio, self.taken, phases), strict=True):
                count_samples(
                    values, place, phases * self.ratio, row, low, inverse_width, self.subsamples[batch], counts
                )
        self.taken += len(range(first, len(snapshots), self.ratio))

    def result(self) -> dict[str, np.ndarray]:
        return {"counts": self.counts.transpose(2, 0, 1, 3)}


class _Moments(Keeper):
    """Sums of values and of their squares per realization, or batch of one, and phase."""

    KEPT = "sums", "squares", "samples"

    def __init__(self, record: PhaseMeans, plan: Plan, realizations: np.ndarray, ratio: int) -> None:
        super().__init__(ratio)
        names: Any = record.labels
        self.reader, self.phases, self.taken = plan.snapshot.reader(record.quantity, names), record.phases, 0
        self.parts = plan.samples_per_realization
        shape = len(realizations), self.parts, record.phases
        self.sums, self.squares = np.zeros((2, *shape, len(names)))
        self.samples = np.zeros(shape)

    def add(self, snapshots: np.ndarray, batch: int) -> None:
        own, part = self.reader(self.own(snapshots))[:, self.reader.rows], min(batch, self.parts - 1)
        for phase, place in enumerate(places(0, 1, self.taken, self.phases)):
            values = own[place :: self.phases]
            self.sums[:, part, phase] += values.sum(axis=0).T
            self.squares[:, part, phase] += (values**2).sum(axis=0).T
            self.samples[:, part, phase] += len(values)
        self.taken += len(own)

    def result(self) -> dict[str, np.ndarray]:
        return {name: getattr(self, name) for name in self.KEPT}
