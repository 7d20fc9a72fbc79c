"""What records add to the time of a run; as a program, it prints that for the pair, chains of 10 and of 100."""

from __future__ import annotations

import time
import warnings
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import xarray as xr

import impactlab as il
from impactlab.machine import tuning
from impactlab_numerics.scenes import scene
from impactlab_numerics.timing import Stopwatch, Whole, in_rounds

SIZES = (2, 10, 100)
"""Bodies of the chains: those that users write."""

BODY_LANES = 20000
"""Most bodies times realizations."""

BATCH = 10.0
"""Seconds that a run simulates, or a multiple of it."""

LINK = il.LinearCoupling(5.0, damping=0.1)
"""Between neighbours, where couplings are observed."""


def work_rate(force: float, rate: float) -> float:
    """Return what a contact, or a coupling, takes."""
    return force * rate


def kinetic_energy(velocity: float, mass: float) -> float:
    """Return the kinetic energy of an oscillator."""
    return 0.5 * mass * velocity * velocity


def phase_radius(displacement_body_0: float, velocity_body_0: float) -> float:
    """Return a quantity of a network."""
    return displacement_body_0 * displacement_body_0 + velocity_body_0 * velocity_body_0


COUPLED = "observable, per coupling"

RECORDS: dict[str, il.Record] = {
    "observable, per contact": il.Observable("work rate", work_rate, units="W"),
    "observable, per oscillator": il.Observable("energy", kinetic_energy, per="oscillator", units="J"),
    COUPLED: il.Observable("work rate", work_rate, per="coupling", units="W"),
    "observable, of the network": il.Observable("radius", phase_radius, per="network", units="1"),
    "energy flows": il.EnergyFlows(),
    "extremes of a displacement": il.Extremes("body_0", windows=(BATCH,), return_times=(100.0,)),
    "extremes of a velocity": il.Extremes(("velocity", "body_0"), windows=(BATCH,), return_times=(100.0,)),
    "cycles of a displacement": il.Cycles("body_0"),
    "correlation of a displacement": il.Correlation(tuple(0.1 * np.arange(11)), "body_0"),
}
"""Records of one quantity, by what they are of."""


def network_of(bodies: int, coupled: bool) -> il.Network:
    """Return a chain, with couplings between neighbours if these are observed."""
    chain = scene(bodies)
    pairs = pairwise(chain.oscillators)
    links = {f"link_{number}": il.Coupling(*pair, LINK) for number, pair in enumerate(pairs)}
    return chain.replace(couplings=links) if coupled else chain


def timer_of(bodies: int, coupled: bool, records: Sequence[il.Record], seconds: float) -> Whole:
    """Return a timer of runs of many realizations from rest, with default settings, on one core."""
    network, realizations = network_of(bodies, coupled), min(tuning().lanes, BODY_LANES // bodies)

    def simulate(batches: int) -> xr.Dataset:
        return il.simulate(
            network, BATCH * batches, realizations=realizations, record=records, rng=1, initial="rest", spin_up=0.0,
            executor=Stopwatch(), progress=False,
        )  # fmt: skip

    return Whole(simulate, BATCH, seconds, time.process_time)


def cost_of_records(sizes: Sequence[int], seconds: float, rounds: int) -> xr.Dataset:
    """Return the time that records add to a run over that of the run, from the least times of some rounds."""
    cases: list[tuple[str, bool]] = [("", False), ("", True), *((name, name == COUPLED) for name in RECORDS)]
    timers = {
        (bodies, *case): timer_of(bodies, case[1], [RECORDS[case[0]]] if case[0] else [], seconds)
        for bodies in sizes
        for case in cases
    }
    least = {key: min(rate for rate, _ in rates) for key, rates in in_rounds(timers, rounds).items()}
    added = [
        [least[bodies, name, coupled] / least[bodies, "", coupled] - 1.0 for bodies in sizes]
        for name, coupled in cases[2:]
    ]
    attributes = {"units": "1", "long_name": "time that a record adds to a run, over that of the run"}
    coordinates = {"record": list(RECORDS), "bodies": list(sizes)}
    return xr.Dataset({"added": (("record", "bodies"), added, attributes)}, coordinates)


def rows_of(table: xr.Dataset) -> list[dict[str, str]]:
    """Return what a table shows."""
    sizes = [f"{size} bodies" for size in table.bodies.values]
    return [
        {"record": name, **{size: f"{cost:+.0%}" for size, cost in zip(sizes, costs, strict=True)}}
        for name, costs in zip(table.record.values.tolist(), table.added.values.tolist(), strict=True)
    ]


if __name__ == "__main__":
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", il.AccuracyWarning)  # runs that are timed are short
        for row in rows_of(cost_of_records(SIZES, 0.4, 4)):
            print("  ".join(f"{key}: {text}" for key, text in row.items()), flush=True)
