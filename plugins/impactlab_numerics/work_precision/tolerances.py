"""The price of a tolerance: over that of a run whose step and length are known beforehand to be as accurate."""

from __future__ import annotations

import math
import time
import warnings
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

import impactlab as il
from impactlab_numerics.scenes import scene
from impactlab_numerics.work_precision.study import PAIR

if TYPE_CHECKING:
    from impactlab_numerics.work_precision.study import WorkPrecisionStudy

STATISTIC = "mean_square_displacement"

FIRST = 256
"""Realizations that tell how many make a direct run as accurate."""


def networks() -> dict[str, il.Network]:
    """Return ten networks besides the base case."""
    pair = scene(2)
    first, second = pair.oscillators.values()
    ((contact, touching),) = pair.contacts.items()
    hot = {"body_0": il.WhiteNoise(64.0), "body_1": il.WhiteNoise(1.0)}
    stiffer = il.DuffingOscillator(
        mass=second.mass, damping=second.damping, stiffness=second.stiffness, cubic=4.0 * second.stiffness
    )
    lossy = il.HuntCrossleyContact(1e4, dissipation=0.2)
    cosines = {
        name: il.ShinozukaNoise(noise.spectral_density, band=(0.0, 40.0), components=8000)  # type: ignore[attr-defined]
        for name, noise in pair.excitations.items()
    }
    stop = il.Contact("body", il.WALL, il.LinearContact(2e4), clearance=0.1)
    body, noise = il.LinearOscillator.from_frequency(2.0 * math.pi, 0.1), il.WhiteNoise(1.0)
    return {
        "chain of 3": scene(3),
        "chain of 5": scene(5),
        "chain of 10": scene(10),
        "unequal temperatures": pair.replace(excitations=hot),
        "Duffing": pair.replace(oscillators={"body_0": first, "body_1": stiffer}),
        "rate-dependent contact": pair.replace(contacts={contact: touching.replace(law=lossy)}),
        "bounded noise": pair.replace(excitations=cosines),
        "linear contact": pair.replace(contacts={contact: touching.replace(law=il.LinearContact(1e4))}),
        "stop": il.Network({"body": body}, {"stop": stop}, {"body": noise}),
        "touching": pair.replace(contacts={contact: touching.replace(clearance=0.0)}),
    }


def tolerances(study: WorkPrecisionStudy) -> xr.Dataset:
    """Run networks to a tolerance and, in turns, directly to the same error; on one core."""
    cases = [(PAIR, scene(2), study.accuracies[-1])]
    cases += [(name, network, study.tolerance) for name, network in networks().items()]
    rows = []
    with ThreadPoolExecutor(1) as pool, warnings.catch_warnings():
        warnings.simplefilter("ignore", il.AccuracyWarning)  # first runs are short
        for _, network, tolerance in cases:
            exact = _exact(network)
            rounds = [_both(network, tolerance, exact, study.seed + number, pool) for number in range(study.rounds + 1)]
            found = np.array(rounds[1:])  # the first compiles
            rows.append((tolerance, *np.median(found[:, :-1], axis=0), found[:, -1].max()))
    texts = {
        "tolerance": ("1", "relative tolerance of E[x²]"),
        "seconds": ("s", "time to the tolerance"),
        "direct_seconds": ("s", "time of a run at the same step with the same standard error"),
        "error": ("1", "|bias| + 2 standard errors, over what is allowed"),
        "ratio": ("1", "time to the tolerance over that of the direct run"),
        "difference": ("1", "largest difference from the exact value, over the tolerance; NaN if it is not known"),
    }
    columns = zip(texts.items(), np.array(rows).T, strict=True)
    return xr.Dataset(
        {name: ("network", values, {"units": units, "long_name": text}) for (name, (units, text)), values in columns},
        {"network": [name for name, _, _ in cases]},
    )


def _exact(network: il.Network) -> np.ndarray:
    """Return the exact E[x²] of each body (m²), NaN where no law is known."""
    try:
        return np.asarray(il.exact(network).statistics()[STATISTIC].values)
    except il.NoExactReference:
        return np.full(len(network.oscillators), np.nan)


def _both(network: il.Network, tolerance: float, exact: np.ndarray, seed: int, pool: Any) -> tuple[float, ...]:
    """Return a row of the table: processor times to a tolerance and of a run as accurate (s), and what came of it."""
    common: dict[str, Any] = {"executor": pool, "progress": False}
    begin = time.process_time()
    reached = il.simulate(network, tolerance={STATISTIC: tolerance}, max_seconds=600.0, rng=seed, **common)
    seconds = time.process_time() - begin
    known = {name: reached.attrs[name] for name in ("duration", "spin_up", "step")}
    options = {**common, **known, "integrator": il.ExactFlow(measured=False)}  # a bias that is not looked for
    error = f"{STATISTIC}_standard_error"
    wanted = (reached[error] / reached[STATISTIC]).values
    first = il.simulate(network, realizations=FIRST, rng=seed, **options)
    needed = float(((first[error] / first[STATISTIC]).values / wanted).max() ** 2) * FIRST
    begin = time.process_time()
    il.simulate(network, realizations=max(2, round(needed)), rng=seed, **options)
    direct = time.process_time() - begin
    difference = float(np.abs(reached[STATISTIC].values / exact - 1.0).max()) / tolerance
    return seconds, direct, reached.attrs["error_over_tolerance"], seconds / direct, difference
