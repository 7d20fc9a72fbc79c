"""Means over [0, T] of the path itself, by the trapezoidal rule, and contacts that are counted.

They share nothing with the estimators of a simulation but the states, and are made in references, at fine steps.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import xarray as xr

from impactlab.assembly.model import Model
from impactlab.compiling.jit import kernel
from impactlab.errors import InvalidInput
from impactlab.plan.plan import Plan
from impactlab.records.record import Keeper, Record
from impactlab.records.recorded_run import RecordedRun
from impactlab.results.labels import Variables

BODIES = ("mean_displacement", "mean_square_displacement", "mean_velocity", "mean_square_velocity")
CONTACTS = ("contact_ratio", "contact_rate", "mean_contact_force")
PREFIX = "path_"

COUNTED = 30
"""Closings that must have been counted for a contact to be judged by them."""


class PathMeans(Record):
    """Means over time of every realization, from all of its steps, as ``path_<statistic>``."""

    def stride(self, model: Model, step: float) -> int:
        return 1

    def keeper(self, run: RecordedRun, realizations: np.ndarray, ratio: int) -> Keeper:
        if run.plan.observed.every != 1:
            raise InvalidInput("PathMeans takes every step: give il.ExactFlow(jumps=False), and no other records.")
        return _Means(run.plan, len(realizations))

    def label(self, run: RecordedRun, results: list[dict[str, np.ndarray]], interval: float) -> Variables:
        sums = {name: np.concatenate([item[name] for item in results]) for name in results[0]}
        families = (("oscillator", BODIES), ("contact", CONTACTS if run.names("contact_force") else ()))
        return {
            f"{PREFIX}{name}": (("realization", dimension), sums[name], {"long_name": f"{name} of the path"})
            for dimension, names in families
            for name in names
        }


class _Means(Keeper):
    wants_start = True

    def __init__(self, plan: Plan, lanes: int) -> None:
        super().__init__()
        self.plan = plan
        bodies, contacts = len(plan.system.bodies), len(plan.system.contacts)
        self.bodies = np.zeros((len(BODIES), bodies, lanes))
        self.contacts = np.zeros((len(CONTACTS), contacts, lanes))
        self.motion = np.zeros((2, contacts, lanes))  # squares of relative velocities, and of steps between samples
        self.gap = np.full((contacts, lanes), np.nan)
        self.closed = np.ones((contacts, lanes), dtype=np.bool_)  # a contact that is closed at first has not closed
        self.last = np.zeros((1, plan.snapshot.size, lanes))

    def start(self, values: np.ndarray) -> None:
        self._add(np.ascontiguousarray(values)[None], 0.5)

    def add(self, snapshots: np.ndarray, batch: int) -> None:
        if len(snapshots):
            self._add(snapshots, 1.0)
            self.last = snapshots[-1:].copy()

    def _add(self, samples: np.ndarray, weight: float) -> None:
        ends, clearance = self.plan.system.ends, self.plan.system.clearance
        begins = np.searchsorted(ends.rows, np.arange(len(ends) + 1))
        _add_samples(
            samples, weight, begins, ends.slots, ends.weights, clearance, self.bodies, self.contacts, self.motion,
            self.gap, self.closed,
        )  # fmt: skip

    def result(self) -> dict[str, np.ndarray]:
        self._add(self.last, -0.5)  # by the trapezoidal rule the first and the last count half
        self.contacts[1] /= self.plan.clock.step * self._seen()[:, None]
        found = dict(zip((*BODIES, *CONTACTS), (*self.bodies, *self.contacts), strict=True))
        return {name: (values / self.plan.clock.steps).T for name, values in found.items()}

    def _seen(self) -> np.ndarray:
        """Return the part of the closings of each contact that samples of the path show, (contact,).

        White noise turns bodies round within a step. By Rice's formula the rate of closings is as the root mean square
        of the relative velocity, and that of changes between samples as that of their difference over the step:
        ``1 − c h/6m`` of it for bodies of one damping.
        """
        speed, moved = self.motion.sum(axis=-1)
        with np.errstate(divide="ignore", invalid="ignore"):
            seen = np.sqrt(moved / speed) / self.plan.clock.step
        return np.where((seen > 0.0) & (seen < 1.0), seen, 1.0)


@kernel
def _add_samples(  # type: ignore[no-untyped-def]
    samples, weight, begins, slots, weights, clearance, bodies, contacts, motion, gaps, closed
):
    """Add samples [time, quantity, lane] to the sums of bodies and contacts, [statistic, body or contact, lane]."""
    count = bodies.shape[1]
    for time in range(samples.shape[0]):
        for body in range(count):
            for lane in range(samples.shape[2]):
                x, v = samples[time, body, lane], samples[time, count + body, lane]
                bodies[0, body, lane] += weight * x
                bodies[1, body, lane] += weight * x * x
                bodies[2, body, lane] += weight * v
                bodies[3, body, lane] += weight * v * v
        for contact in range(contacts.shape[1]):
            for lane in range(samples.shape[2]):
                gap, velocity = -clearance[contact], 0.0
                for entry in range(begins[contact], begins[contact + 1]):
                    if slots[entry] < count:  # the wall is the last body
                        gap += weights[entry] * samples[time, slots[entry], lane]
                        velocity += weights[entry] * samples[time, count + slots[entry], lane]
                change = gap - gaps[contact, lane]
                if weight == 1.0 and change == change:  # not the first
                    motion[0, contact, lane] += velocity * velocity
                    motion[1, contact, lane] += change * change
                gaps[contact, lane] = gap
                now = gap > 0.0
                contacts[0, contact, lane] += weight * now
                contacts[1, contact, lane] += now and not closed[contact, lane]
                contacts[2, contact, lane] += weight * samples[time, 2 * count + contact, lane]
                closed[contact, lane] = now


def path_statistics(result: xr.Dataset) -> xr.Dataset:
    """Return the means of a result with `PathMeans` over its realizations, with standard errors.

    Returns
    -------
    Dataset
        Default statistics but the peak, and ``closings``, how many were counted of each contact.
    """
    found: dict[str, Any] = {}

    def put(name: str, dimension: str, influence: np.ndarray, value: np.ndarray) -> None:
        found[name] = (dimension, value)
        found[f"{name}_standard_error"] = (
            dimension,
            influence.std(axis=0, ddof=1) / math.sqrt(len(influence)) if len(influence) > 1 else np.nan * value,
        )

    for dimension, names in (("oscillator", BODIES), ("contact", CONTACTS)):
        for name in names:
            if f"{PREFIX}{name}" in result:
                each = result[f"{PREFIX}{name}"].values
                put(name, dimension, each, each.mean(axis=0))
    x, square = (result[f"{PREFIX}{name}"].values for name in BODIES[:2])
    mean = x.mean(axis=0)
    put("variance_displacement", "oscillator", square - 2.0 * mean * x, square.mean(axis=0) - mean**2)
    if f"{PREFIX}contact_rate" in result:
        total = result.attrs["duration"] * result.attrs["realizations"]
        found["closings"] = ("contact", total * found["contact_rate"][1])
    coordinates = {name: result[name].values for name in ("oscillator", "contact") if name in result.coords}
    return xr.Dataset(found, coordinates, {"step": result.attrs["step"]})
