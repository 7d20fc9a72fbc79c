"""What each device of the default method is worth, measured one by one on the base case."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.compiling.jit import kernel
from impactlab.kernels.random import normals_of
from impactlab.machine import tuning
from impactlab_numerics.work_precision.methods import Findings, Method, seconds_to
from impactlab_numerics.work_precision.study import PAIR

if TYPE_CHECKING:
    from impactlab_numerics.work_precision.study import WorkPrecisionStudy

NORMALS = 2**20
"""Normals that a generator makes when it is timed."""


def contributions(study: WorkPrecisionStudy, table: dict[Method, Findings], speed: xr.Dataset) -> xr.Dataset:
    """Return by which factor the time to the highest accuracy in E[x²] grows without each device.

    All else stays as it is. Where a device allows a longer step, the best of the steps that were
    measured are compared, with their biases; else run time × error² at the automatic step.
    """
    accuracy, start = study.accuracies[-1], (PAIR, "impactlab")
    flow, plain, two, euler = (
        {method: found for method, found in table.items() if method == Method(*start, scheme, "white", method.step)}
        for scheme in ("exact flow", "exact flow, plain kick", "exact flow, two normals", "Euler–Maruyama")
    )
    usual = next(found for method, found in flow.items() if not method.step)
    rows: list[tuple[str, str, float, str]] = []
    lanes = _speed(speed, "full blocks")
    for width in ("blocks of 1", "blocks of 8"):
        fewer = _speed(speed, width)
        measured = f"{fewer:.3g} instead of {lanes:.3g} steps of a body per second"
        rows.append(("lanes", f"{width} realizations instead of {tuning().lanes}", lanes / fewer, measured))
    own, other = _generators(study.rounds)
    network = study.scenes()[PAIR]
    drawn = len(il.ExactFlow().noise(Model.of(network), usual.step).bodies) / len(network.oscillators)
    ratio = 1.0 + lanes * drawn * (other - own)
    measured = (
        f"{1e9 * other:.2f} instead of {1e9 * own:.2f} ns a normal, "
        f"{drawn:g} in {1e9 / lanes:.1f} ns for a step of a body"
    )
    rows.append(("generator", "NumPy's generator, one normal at a time", ratio, measured))
    for name, instead, others, index, direct in (
        ("exact flow", "Euler–Maruyama, both with plain means", euler, 0, True),
        ("shifted kick", "a kick where the body is", plain, 0, False),
        ("shifted kick", "the same, for the contact ratio", plain, 1, False),
    ):
        (step, best), (other_step, most) = (_best(group, accuracy, index, direct) for group in (flow, others))
        measured = f"{most:.3g} s at a step of {1e3 * other_step:g} ms instead of {best:.3g} s at {1e3 * step:.3g} ms"
        rows.append((name, instead, most / best, measured))
    (exact,) = two.values()
    costs = [found.rate * found.scatter[0] for found in (exact, usual)]
    biases = " and ".join(f"{100 * found.bias[0]:.3f} ± {100 * found.bias_error[0]:.3f} %" for found in (exact, usual))
    measured = f"{costs[0]:.3g} instead of {costs[1]:.3g} s × error², with biases of {biases}"
    rows.append(("one normal in a step", "exact friction and noise, two normals", costs[0] / costs[1], measured))
    errors = np.sqrt([usual.direct_scatter[0], usual.scatter[0]])
    measured = f"standard errors {errors[0] / errors[1]:.2f} times as large"
    rows.append(("balances", "plain means", float(errors[0] / errors[1]) ** 2, measured))
    columns = {
        "device": ("device", {}),
        "instead": ("what stands in its place", {}),
        "ratio": ("time without the device, in units of that with it", {"units": "1"}),
        "measured": ("what was measured", {}),
    }
    return xr.Dataset(
        {
            name: ("row", list(values), {"long_name": text, **units})
            for (name, (text, units)), values in zip(columns.items(), zip(*rows, strict=True), strict=True)
        }
    )


def _speed(speed: xr.Dataset, width: str) -> float:
    return float(speed["body_steps_per_second"].sel(run=f"{PAIR}, impactlab, {width}, 1 thread"))


def _best(group: dict[Method, Findings], accuracy: float, index: int, direct: bool) -> tuple[float, float]:
    """Return the step with the shortest time to an accuracy in a statistic, and that time."""
    times = [(float(seconds_to(accuracy, found, direct=direct)[index]), found.step) for found in group.values()]
    seconds, step = min(times)
    return step, seconds


def _generators(rounds: int) -> tuple[float, float]:
    """Return the seconds that a normal takes: from impactlab's streams, from NumPy's generator in a loop."""
    generator, lanes = np.random.default_rng(1), tuning().lanes
    calls: dict[str, Callable[[], Any]] = {
        "own": lambda: normals_of((1, 2), "body", "noise", np.arange(lanes), 0, NORMALS // (4 * lanes)),
        "numpy": lambda: sum_of_normals(generator, NORMALS),
    }
    times: dict[str, list[float]] = {name: [] for name in calls}
    for number in range(rounds + 1):
        for name, call in calls.items():
            begin = time.perf_counter()
            call()
            if number:  # the first one compiles
                times[name].append((time.perf_counter() - begin) / NORMALS)
    return float(np.median(times["own"])), float(np.median(times["numpy"]))


@kernel
def sum_of_normals(generator, count):  # type: ignore[no-untyped-def]
    """Return the sum of a number of normals, drawn one at a time."""
    total = 0.0
    for _ in range(count):
        total += generator.standard_normal()
    return total
