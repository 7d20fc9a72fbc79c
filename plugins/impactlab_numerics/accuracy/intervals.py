"""Coverage of 95 % intervals on many random networks: simulations, results and verdicts."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from scipy.special import stdtr, stdtrit

import impactlab as il
from impactlab.studies import Item
from impactlab.studies.claims import Claim, verdict_on, worst_verdict
from impactlab_numerics.accuracy.random_networks import closing_rates, random_network

if TYPE_CHECKING:
    from impactlab_numerics.accuracy.study import AccuracyStudy

ALL = (0.93, 0.97)
"""Share of 95 % intervals that hold the exact value, over all statistics."""

EACH = (0.91, 0.99)
"""The same share for each statistic."""

BEYOND = 5.0
"""Standard errors that no difference may exceed where each sample has `CONTACTS` contacts."""

CONTACTS = 20.0
"""Expected number of closings of the rarest contact in a realization, which is its duration."""

CHANCE = 0.01
"""Probability below which chance explains nothing."""

SECTION = "random networks, short runs"
"""Section of the claims."""


def items(study: AccuracyStudy) -> Iterator[Item]:
    """Yield the simulations: the duration is the time in which the rarest contact closes 20 times."""
    for number in range(study.coverage_networks):
        network = random_network(number)
        duration = CONTACTS / min(closing_rates(network).values())
        options = {"duration": duration, "realizations": study.coverage_realizations, "rng": [study.seed, number, 5]}
        yield Item(f"intervals_{number}", network, options)


def collect(study: AccuracyStudy, results: Mapping[str, xr.Dataset], laws: Mapping[int, xr.Dataset]) -> xr.Dataset:
    """Return the differences of all statistics from their exact values in standard errors."""
    tables = []
    for number, law in laws.items():
        table = il.compare(results[f"intervals_{number}"], law)[["z"]]
        tables.append(table.assign(network=("comparison", np.full(table.sizes["comparison"], number))))
    joined = xr.concat(tables, "comparison")
    held = np.abs(joined.z) <= stdtrit(study.coverage_realizations - 1, 0.975)
    texts = {"long_name": "whether the interval of 95 % holds the exact value", "units": "1"}
    joined["held"] = ("comparison", held.values.astype(float), texts)
    joined["z"].attrs = {"long_name": "difference in standard errors", "units": "1"}
    joined["network"].attrs = {"long_name": "number of the network", "units": "1"}
    return joined.assign_attrs(realizations=study.coverage_realizations)


def claims(table: xr.Dataset) -> Iterator[Claim]:
    """Yield verdicts on the shares and on the largest difference.

    Statistics of a network may hold or miss their values together: chance is that of as many
    independent cases as networks.
    """
    z, held = table.z.values, table.held.values
    networks = len(np.unique(table.network.values))
    chance = math.sqrt(0.95 * 0.05 / networks)
    yield Claim(
        SECTION,
        "95 % intervals of all statistics together hold the exact value in 93 to 97 % of cases.",
        f"{100.0 * held.mean():.1f} % of {len(z)}, in {networks} networks.",
        verdict_on(held.mean(), ALL, 2.0 * chance),
        "share between 93 and 97 %; sampling error within 2 standard errors of as many independent cases as networks.",
    )
    rows = shares(table)
    low, high = (pick(rows, key=lambda row: row["coverage (%)"]) for pick in (min, max))
    outside = [verdict_on(row["coverage (%)"] / 100.0, EACH, 2.0 * chance) for row in rows]
    yield Claim(
        SECTION,
        "95 % intervals of each statistic hold the exact value in 91 to 99 % of cases.",
        f"from {low['coverage (%)']:.1f} % ({low['statistic']}) to {high['coverage (%)']:.1f} % ({high['statistic']}).",
        worst_verdict(outside),
        "each share between 91 and 99 %; sampling error as above.",
    )
    largest, freedom = float(np.abs(z).max()), float(table.attrs["realizations"] - 1)
    worst = table.isel(comparison=int(np.abs(z).argmax()))
    limit = float(-stdtrit(freedom, 0.5 * CHANCE / len(z)))
    yield Claim(
        SECTION,
        f"No difference exceeds {BEYOND:g} standard errors where every contact closes {CONTACTS:g} times or more in a "
        "realization.",
        f"The largest is {largest:.1f}, of {worst.statistic.item()} of {worst.label.item()} in network "
        f"{int(worst.network)}; by Student's law {2.0 * len(z) * stdtr(freedom, -BEYOND):.2g} are expected beyond.",
        "holds" if largest <= BEYOND else "sampling error" if largest <= limit else "does not hold",
        f"largest difference within {BEYOND:g}; sampling error within {limit:.1f}, which chance exceeds once in "
        f"{1.0 / CHANCE:g} times.",
    )


def shares(table: xr.Dataset) -> list[dict[str, Any]]:
    """Return the share of intervals that hold, and the law of the differences, of each statistic."""
    rows = []
    for name in dict.fromkeys(table.statistic.values.tolist()):
        part = table.isel(comparison=np.flatnonzero(table.statistic.values == name))
        rows.append(
            {
                "statistic": name,
                "number": part.sizes["comparison"],
                "coverage (%)": round(100.0 * float(part.held.mean()), 2),
                "mean of z": round(float(part.z.mean()), 3),
                "standard deviation of z": round(float(part.z.std()), 3),
                "largest |z|": round(float(np.abs(part.z).max()), 2),
            }
        )
    return rows
