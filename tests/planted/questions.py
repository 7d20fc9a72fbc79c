"""Bugs in questions about uncertain numbers and fragility, and in records along located paths: of known answers."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import scipy.signal
import scipy.stats

import impactlab as il
from impactlab.analysis import fragility, uncertain
from impactlab.kernels.event_log import WHEN
from impactlab.located import quantities_on_paths
from impactlab.located.energy_of_events import EnergyOfEvents
from impactlab.located.passages_of_events import PassagesOfEvents
from impactlab.located.quantities_on_paths import QuantityOnPaths
from impactlab.plan.seed import seed_of
from impactlab.statistics import sensitivity
from planted.detectors import Distances, Scene
from planted.plant import Bug, called, instead, returned

EXACT = 1e-9
"""In the place of a standard error where nothing is random, as a part of the value."""

DRAWS, ANALYSES = 128, 300
"""Draws of two numbers, and analyses of them."""


class Drawn(Scene):
    """Sums of two normal numbers with noise, whose variances are known, and the shares of two draws."""

    name = "uncertain numbers"

    def law(self) -> Any:
        return {"mean": 0.0, "noise": 9.0, "numbers": 5.0, "indices": np.array([0.8, 0.2])}

    def evidence(self) -> Any:
        random, found = np.random.default_rng(1), []
        for _ in range(ANALYSES):
            numbers = random.normal(size=(DRAWS, 2))
            values = (numbers @ [2.0, 1.0])[:, None] + 3.0 * random.normal(size=(DRAWS, 8))
            found.append(sensitivity.Sensitivity.of(values, scipy.stats.norm.cdf(numbers)))
        return found, [uncertain._shares(seed_of(1), name, 2000) for name in ("stiffness", "damping")]

    def distances(self, found: Any, law: Any) -> Distances:
        analyses, shares = found
        result = {"draws of two numbers": abs(float(np.corrcoef(shares)[0, 1])) * math.sqrt(2000.0)}
        for name, value in law.items():
            values, errors = (np.array([getattr(item, name)[place] for item in analyses]) for place in (0, 1))
            off = np.abs(values.mean(axis=0) - value) / (values.std(axis=0, ddof=1) / math.sqrt(ANALYSES))
            ratio = np.log(np.sqrt((errors**2).mean(axis=0)) / values.std(axis=0, ddof=1))
            result[name] = float(np.max(off))
            result[f"error of {name}"] = float(np.max(np.abs(ratio))) / 0.08  # 0.05 by the number of analyses
        return result


class Shaken(Scene):
    """A linear body under twelve records: its peaks by a filter, fractions and bands by SciPy."""

    name = "fragility"
    limit, scales = 0.3, np.geomspace(0.4, 2.5, 31)

    @cache  # noqa: B019  # scenes are few
    def records(self) -> Any:
        times = np.linspace(0.0, 3.0, 31)
        return times, np.random.default_rng(2).normal(size=(12, 31))

    @cache  # noqa: B019
    def law(self) -> Any:
        (times, values), fine = self.records(), np.linspace(0.0, 3.0, 3001)
        body = scipy.signal.StateSpace([[0.0, 1.0], [-4.0, -0.4]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]])
        peaks = [np.abs(scipy.signal.lsim(body, np.interp(fine, times, row), fine)[1]).max() for row in values]
        return np.array(peaks)[:, None] * self.scales

    def evidence(self) -> Any:
        times, values = self.records()
        records = [il.SampledForce(times, row) for row in values]
        body = il.LinearOscillator(damping=0.4, stiffness=4.0)
        return il.fragility(lambda record: il.Network({"a": body}, {}, {"a": record}), records, self.scales,
                            {"a": self.limit}, step=0.02)  # fmt: skip

    def distances(self, found: Any, law: Any) -> Distances:
        counts, capacities = (law >= self.limit).sum(axis=0), np.log(self.limit / law[:, 0] * self.scales[0])
        bands = [scipy.stats.binomtest(int(count), 12).proportion_ci(method="wilson") for count in counts]
        low, high = (np.array([getattr(item, end) for item in bands]) for end in ("low", "high"))
        spread = capacities.std()
        off = {
            "peaks": np.abs(found.peak.values[0] / law - 1.0).max() / 1e-4,
            "fractions": np.abs(found.probability.values[0] - counts / 12.0).max() / EXACT,
            "bands": np.abs([found.probability_low[0] - low, found.probability_high[0] - high]).max() / EXACT,
            # of capacities that are known to a scale
            "median": abs(math.log(found.median_scale.item()) - capacities.mean()) / (0.1 * spread),
            "error of the median": abs(math.log(found.median_scale_standard_error.item() / found.median_scale.item()
                                                / (spread / math.sqrt(12.0)))) / 0.15,
        }  # fmt: skip
        return {name: float(value) for name, value in off.items()}


def _square(velocity):  # type: ignore[no-untyped-def]
    return velocity * velocity


def _speed(velocity):  # type: ignore[no-untyped-def]
    return velocity


class Swinging(Scene):
    """A damped body that swings freely: its path is known in closed form."""

    name = "records along located paths"
    length, damping = 5.0, 0.2

    def law(self) -> Any:
        t, decay = np.linspace(0.0, self.length, 200001), 0.5 * self.damping
        pace = math.sqrt(1.0 - decay**2)
        x = np.exp(-decay * t) * np.sin(pace * t) / pace
        v = np.exp(-decay * t) * np.cos(pace * t) - decay * x
        energy = 0.5 * (x**2 + v**2)
        passed = t[(x >= 0.5).argmax()]
        return {"mean": np.trapezoid(v**2, t) / self.length, "lost": (energy[0] - energy[-1]) / self.length,
                "least": float(v.min()), "passed": passed}  # fmt: skip

    def evidence(self) -> Any:
        network = il.Network({"a": il.LinearOscillator(damping=self.damping, stiffness=1.0)})
        records = [
            il.Observable("kinetic", _square, per="oscillator", units="m2 s-2"),
            il.Observable("speed", _speed, per="oscillator", units="m s-1"),
            il.EnergyFlows(),
        ]  # fmt: skip
        options: dict[str, Any] = {"initial": {"velocity": {"a": 1.0}}}
        passage = il.simulate(network, self.length, record=il.FirstPassage({"a": 0.5}), **options)
        return il.simulate(network, self.length, record=records, **options), passage

    def distances(self, found: Any, law: Any) -> Distances:
        run, passage = found
        value = {
            "mean": run.mean_kinetic.item(),
            "lost": run.power_dissipated.item(),
            "least": run.smallest_speed.item(),
            "passed": passage.passage_time.item(),
        }
        near = {"mean": 1e-8, "lost": 1e-8, "least": 1e-5, "passed": 3e-5}  # by the grid of the closed form
        result = {name: abs(value[name] - law[name]) / near[name] for name in value}
        return result | {"balance": abs(run.power_balance.item()) / 1e-12}


DRAWN, SHAKEN, SWINGING = Drawn(), Shaken(), Swinging()
SCENES = [DRAWN, SHAKEN, SWINGING]


def wald(counts: np.ndarray, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Return bands about the fraction."""
    part = counts / number
    half = 1.96 * np.sqrt(part * (1.0 - part) / number)
    return part - half, part + half


BUGS = [
    Bug("variance by numbers with that of noise", DRAWN,
        returned(sensitivity, "_without_each", lambda right, *_: 0.0 * right)),
    Bug("parts of numbers without the degrees of the polynomial", DRAWN,
        returned(sensitivity, "_left", lambda right, *_: right * (DRAWS - 6.0) / (DRAWS - 1.0))),
    Bug("jackknife without its factor", DRAWN,
        returned(sensitivity, "_jackknifed", lambda right, *_: right._replace(error=right.error / math.sqrt(DRAWS)))),
    Bug("one draw for all numbers", DRAWN,
        called(uncertain, "_shares", lambda seed, name, draws: (seed, "", draws))),
    Bug("peaks of one side", SHAKEN,
        returned(fragility, "magnitudes", lambda right, ranges: ranges[:, 1])),
    Bug("bands about the fraction", SHAKEN, instead(fragility, "fraction_band", wald)),
    Bug("records that count at each scale", SHAKEN,
        returned(fragility, "lognormal", lambda right, exceeded, scales: right._replace(
            covariance=right.covariance / len(scales)))),
    Bug("squares of nodes by half their weights", SWINGING,
        called(QuantityOnPaths, "take", lambda own, lane, snapshots, times, weights: (
            own, lane, snapshots, times, 0.5 * weights))),
    Bug("least values at nodes only", SWINGING,
        instead(quantities_on_paths, "_largest", lambda times, values: values.max(axis=0))),
    Bug("dampers that take 1 % more", SWINGING,
        returned(EnergyOfEvents, "powers", lambda right, *_: right._replace(damped=1.01 * right.damped))),
    Bug("no stored energy along paths", SWINGING,
        returned(EnergyOfEvents, "powers", lambda right, *_: right._replace(stored=0.0 * right.stored))),
    Bug("passages at the event before", SWINGING,
        called(PassagesOfEvents, "take", lambda own, lane, events, states: (
            own, lane, events - np.eye(1, events.shape[1], WHEN) * 1e-3, states))),
]  # fmt: skip
