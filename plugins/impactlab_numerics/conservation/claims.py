"""Claims of the conservation study and their verdicts."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from impactlab.studies.claims import Claim, shown_in, verdict_of

if TYPE_CHECKING:
    from impactlab_numerics.conservation.study import ConservationStudy

ORDERS = {"ExactFlow": 3.0, "RungeKutta4": 4.0, "EulerMaruyama": 1.0}
"""Order of each integrator with smooth forces."""

OF_ORDER = 0.25
"""How near a measured order must be."""

ROUNDING = 1e-12
"""What counts as rounding in a momentum."""


def claims(study: ConservationStudy, tree: xr.DataTree) -> Iterator[Claim]:
    """Yield the claims."""
    energy = tree["energy"].to_dataset()
    smooth = np.isinf(energy.power.values)
    bounce = tree["bounce"].to_dataset()
    of_energy = [_bounded(energy.sel(scene=scene)) for scene in energy.scene.values[smooth]]
    of_energy += [_wanders(energy.sel(scene=scene)) for scene in energy.scene.values[~smooth]]
    of_energy += [_bounces(bounce.sel(force=force)) for force in bounce.force.values]
    yield from shown_in("energy", of_energy)
    yield _returns(tree["reversal"].to_dataset().isel(scene=0))._replace(figure="reversal")
    yield _kept(tree["momentum"].to_dataset())
    order = tree["order"].to_dataset()
    for integrator in order.integrator.values:
        for force in order.force.values:
            yield _order(order.sel(integrator=integrator, force=force))._replace(figure="order")


def _bounded(energy: xr.Dataset) -> Claim:
    """Compare the drift of the mean energy with its oscillation."""
    drift, swing = energy.error.values[:, -1], energy.swing.values[:, -1]
    return Claim(
        "energy",
        f"{energy.scene.item()}: where no contact opens or closes the energy stays where it is, on average.",
        f"At the automatic step it swings by {swing[0]:.1e} of the kinetic energy at the start and has drifted by "
        f"{drift[0]:.1e} in the end; at the smallest step by {swing[-1]:.1e} and {drift[-1]:.1e}.",
        verdict_of(bool((drift < 1e-4).all())),
        "drift below 1e-4 at each step, means over a tenth of the run",
    )


def over_contacts(energy: xr.Dataset) -> tuple[np.ndarray, float, float]:
    """Return error/√n at each step, (halving,), the power of the step it follows, and the power of n of the error.

    Means of logarithms over the windows in which the energy has changed by less than a fifth; the power of n
    is that at the smallest step.
    """
    n, error = energy.contacts.values, energy.error.values
    used = (error > 0.0) & (error < 0.2) & (n > 10.0)
    each = np.where(used, np.log(np.where(used, error, 1.0) / np.sqrt(n)), np.nan)
    known = used.any(axis=1)
    rate = np.full(len(n), np.nan)
    rate[known] = np.nanmean(each[known], axis=1)
    step = np.log(energy.step.values)
    of_step = float(np.polyfit(step[known], rate[known], 1)[0]) if known.sum() > 1 else np.nan
    last = used[-1]
    of_n = float(np.polyfit(np.log(n[-1, last]), np.log(error[-1, last]), 1)[0]) if last.sum() > 2 else np.nan
    return np.exp(rate), of_step, of_n


def _wanders(energy: xr.Dataset) -> Claim:
    """Every opening and closing changes the energy by about the step to the power p + 1."""
    rate, of_step, of_n = over_contacts(energy)
    ends = zip(energy.error.values[:, -1], energy.contacts.values[:, -1], strict=True)
    last = ", ".join(f"{error:.1e} after {n:.1e} contacts" for error, n in ends)
    return Claim(
        "energy",
        f"{energy.scene.item()}: where contacts open and close the energy wanders, and smaller steps make it slower.",
        f"Root mean square of the relative error from the largest to the smallest step: {last}. It is "
        f"{', '.join(f'{item:.1e}' for item in rate)} √n, which falls like the step to the power {of_step:.1f} "
        f"(p + 1 = {float(energy.power) + 1.0:g}), and at the smallest step grows like n to the power {of_n:.2f}.",
        verdict_of(of_step >= 1.5),
        "power of the step at least 1.5",
    )


def _bounces(bounce: xr.Dataset) -> Claim:
    ratio = (bounce.change / bounce.theory).values
    first = bounce.isel(step=0)
    return Claim(
        "energy",
        f"{bounce.force.item()} contact: what one contact does to the energy is the error of a sum over a kink.",
        f"{float(first.change):.1e} at h Ω = {float(first.relative_step):.2f}; over theory "
        f"{', '.join(f'{item:.2f}' for item in ratio)} from the largest to the smallest step.",
        verdict_of(bool((np.abs(ratio[1:] - 1.0) < 0.25).all())),
        "within a quarter of theory at all but the largest step",
    )


def _returns(reversal: xr.Dataset) -> Claim:
    worst = float(np.nanmax(reversal.largest.values))
    return Claim(
        "time reversal",
        f"{reversal.scene.item()}: with all velocities reversed the motion comes back to its start.",
        "Largest distance "
        + ", ".join(
            f"{error:.0e} after {n:.0f} contacts"
            for error, n in zip(reversal.largest.values, reversal.contacts.values, strict=True)
        )
        + ".",
        verdict_of(worst < 1e-9),
        "within 1e-9",
    )


def _kept(momentum: xr.Dataset) -> Claim:
    worst = float(np.abs(momentum.error).max())
    return Claim(
        "momentum",
        "A free chain keeps its momentum to rounding.",
        f"It changes by {worst:.1e} of the sizes of all momenta in {float(momentum.contacts[-1]):.2e} contacts.",
        verdict_of(worst < ROUNDING),
        f"below {ROUNDING:g}",
    )


def _order(order: xr.Dataset) -> Claim:
    smooth, power = ORDERS[order.integrator.item()], float(order.power)
    expected = min(smooth, power + 1.0)
    return Claim(
        "order",
        f"{order.integrator.item()} has order {expected:g} with {order.force.item()} forces"
        + ("." if np.isinf(power) else ": the smaller of its own and p + 1."),
        f"slope {order.order.item():.2f}",
        verdict_of(abs(order.order.item() - expected) <= OF_ORDER),
        f"within {OF_ORDER:g}",
    )
