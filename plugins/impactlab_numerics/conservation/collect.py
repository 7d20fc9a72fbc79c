"""From paths without friction to energies, reversals, momenta and orders."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from scipy.integrate import solve_ivp
from scipy.special import gamma, zeta

import impactlab as il
from impactlab_numerics.conservation.scenes import (
    BOUNCING,
    MASSES,
    SCENES,
    bounces,
    path_starts,
    paths,
    side_by_side,
    starts,
)
from impactlab_numerics.conservation.study import BOUNCE_STEPS, BOUNCES, COARSEST, PATH_DURATION, PATH_INTERVAL, key

if TYPE_CHECKING:
    from impactlab_numerics.conservation.study import ConservationStudy

WINDOWS = 10
"""Parts of a run over which the energy is averaged."""

COMPARED = 25
"""Steps at the beginning in which a path is compared with the way back."""

REVERSED = ("pair, Hertz", "chain, Hertz")
"""Scenes that are reversed: one that is regular and one that is chaotic."""


def collect(study: ConservationStudy, results: Mapping[str, xr.Dataset]) -> xr.DataTree:
    """Return the tree of results: groups ``energy``, ``bounce``, ``reversal``, ``momentum`` and ``order``."""
    groups = {
        "/energy": _energies(study, results),
        "/bounce": _bounces(study, results),
        "/reversal": _reversals(study),
        "/momentum": _momentum(study, results["momentum"]),
        "/order": _orders(study, results),
    }
    return xr.DataTree.from_dict(groups)


def energies(network: il.Network, dataset: xr.Dataset, copies: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the energy of every copy (J), and whether no contact of it is closed, (time, copy) each."""
    bodies = list(network.oscillators.values())
    slots: dict[Any, int] = {name: slot for slot, name in enumerate(network.oscillators)}
    mass, stiffness = (np.array([getattr(body, name) for body in bodies]) for name in ("mass", "stiffness"))
    x, v = dataset.displacement.values[0], dataset.velocity.values[0]
    total = _by_copy(0.5 * mass * v**2 + 0.5 * stiffness * x**2, copies)
    place = np.concatenate([x, np.zeros((len(x), 1))], axis=1)
    for name, contact in network.contacts.items():
        first, second = (slots.get(side, len(slots)) for side in (contact.first, contact.second))
        depth = place[:, first] - place[:, second] - contact.clearance
        total[:, int(name.rpartition("_")[2])] += contact.law.call("potential", np.maximum(depth, 0.0))
    closed = _by_copy(dataset.contact_force.values[0] > 0.0, copies)
    return total, closed == 0


def _by_copy(values: np.ndarray, copies: int) -> np.ndarray:
    """Sum over the members of each copy, (time, copy)."""
    result: np.ndarray = values.reshape(len(values), copies, -1).sum(axis=2, dtype=float)
    return result


def _energies(study: ConservationStudy, results: Mapping[str, xr.Dataset]) -> xr.Dataset:
    """Return how far the energy is from that at the start, over windows of each run.

    It is read while no contact is closed, if that happens: then it is that of the springs and the velocities,
    and constant from step to step. Where contacts never open it is averaged over each window, since it swings
    within every oscillation.
    """
    shape = len(SCENES), study.halvings + 1, WINDOWS
    contacts, rms, mean, swing = (np.full(shape, np.nan) for _ in range(4))
    step = np.empty(shape[:2])
    for row, (name, scene) in enumerate(SCENES.items()):
        network = side_by_side(scene.make(), study.copies)
        for column in range(shape[1]):
            dataset = results[key(name, column)]
            step[row, column] = dataset.attrs["step"]
            energy, is_open = energies(network, dataset, study.copies)
            moving = _by_copy(
                0.5
                * np.array([body.mass for body in network.oscillators.values()])
                * dataset.velocity.values[0, :1] ** 2,
                study.copies,
            )
            relative = (energy - energy[0]) / moving
            closing = float(dataset.contact_rate.sum()) / study.copies
            wanders = np.isfinite(scene.power)
            space = (
                np.geomspace(len(relative) // 200 + 2, len(relative), WINDOWS + 1)
                if wanders
                else np.linspace(0, len(relative), WINDOWS + 1)
            )
            ends = space.astype(int)
            for window, (begin, end) in enumerate(pairwise(ends)):
                part, seen = relative[begin:end], is_open[begin:end]
                if wanders:
                    contacts[row, column, window] = closing * float(dataset.time[begin:end].mean())
                    known = part[seen] if seen.any() else part  # too hot: some contact is always closed
                else:
                    contacts[row, column, window] = scene.rate * float(dataset.time[begin:end].mean())
                    known = part.mean(axis=0) - relative[: ends[1]].mean(axis=0)
                    swing[row, column, window] = part.std(axis=0).mean()
                if known.size:
                    rms[row, column, window] = np.sqrt((known**2).mean())
                    mean[row, column, window] = known.mean()
    dims = ("scene", "halving", "window")
    return xr.Dataset(
        {
            "contacts": (dims, contacts, _named("contacts of a copy until the middle of the window")),
            "error": (dims, rms, _named("root mean square of the relative error of the energy")),
            "mean_error": (dims, mean, _named("mean relative error of the energy")),
            "swing": (dims, swing, _named("standard deviation of the energy within a window, relative")),
            "step": (dims[:2], step, {"units": "s", "long_name": "step"}),
            "power": ("scene", [scene.power for scene in SCENES.values()], _named("power of the indentation")),
        },
        {"scene": list(SCENES), "halving": np.arange(study.halvings + 1)},
    )


def _named(text: str) -> dict[str, Any]:
    return {"units": "1", "long_name": text}


def kink(power: float, stiffness: np.ndarray, step: float) -> np.ndarray:
    """Return the root mean square of the relative change of the energy by one contact, in theory.

    A pair of reduced mass μ = 2/3 kg that closes at 1 m/s feels ``F = c t^p`` after t = 0. A sum over steps
    instead of the integral changes the velocity by ``(c/μ) h^(p+1) ζ(−p, a)``, a being uniform on (0, 1);
    ``∫₀¹ ζ(−p, a)² da = 2 Γ(p + 1)² ζ(2p + 2)/(2π)^(2p+2)``, by Parseval from Hurwitz's series. Opening does
    the same again, and the energy changes by twice the relative change of the velocity.
    """
    square = 2.0 * gamma(power + 1.0) ** 2 * zeta(2.0 * power + 2.0) / (2.0 * np.pi) ** (2.0 * power + 2.0)
    return np.asarray(2.0 * stiffness / (2.0 / 3.0) * step ** (power + 1.0) * np.sqrt(2.0 * square))


def _bounces(study: ConservationStudy, results: Mapping[str, xr.Dataset]) -> xr.Dataset:
    """Return the change of the energy of the relative motion of an isolated pair in one contact."""
    shape = len(BOUNCING), len(BOUNCE_STEPS)
    found, theory, step = np.empty(shape), np.empty(shape), np.empty(shape)
    for row, (kind, power) in enumerate(BOUNCING.items()):
        network, _, frequency = bounces(kind, BOUNCES, study.seed)
        stiffness = np.array([contact.law.to_dict()["stiffness"] for contact in network.contacts.values()])
        for column in range(len(BOUNCE_STEPS)):
            dataset = results[f"bounce_{kind}_{column}"]
            velocity = dataset.velocity.values[0, -1].reshape(-1, 2)
            change = (velocity[:, 0] - velocity[:, 1]) ** 2 - 1.0
            found[row, column] = np.sqrt((change**2).mean())
            theory[row, column] = np.sqrt((kink(power, stiffness, dataset.attrs["step"]) ** 2).mean())
            step[row, column] = dataset.attrs["step"] * frequency
    dims = ("force", "step")
    return xr.Dataset(
        {
            "change": (dims, found, _named("root mean square of the relative change of the energy by a contact")),
            "theory": (dims, theory, _named("the same from the error of a sum over a kink")),
            "relative_step": (dims, step, _named("step times the frequency of the contact")),
        },
        {"force": list(BOUNCING)},
    )


def _reversals(study: ConservationStudy) -> xr.Dataset:
    """Run scenes for a number of contacts, reverse all velocities, run as long again, and compare with the start."""
    copies = 16 * study.copies
    shape = len(REVERSED), len(study.reversed_contacts)
    error, largest, contacts, count = np.full(shape, np.nan), np.full(shape, np.nan), np.empty(shape), np.empty(shape)
    for row, name in enumerate(REVERSED):
        scene = SCENES[name]
        network = side_by_side(scene.make(), copies)
        initial = starts(scene.make(), copies, scene.speed, [study.seed, 7])
        for column, wanted in enumerate(study.reversed_contacts):
            step = 0.02
            duration = step * round(wanted / scene.rate / step)
            options: dict[str, Any] = {
                "step": step,
                "integrator": il.ExactFlow(measured=False),
                "record": il.Trajectory(step),
                "rng": study.seed,
            }
            there = il.simulate(network, duration + step, initial=initial, **options)
            turned = {
                quantity: dict(zip(network.oscillators, (sign * there[quantity].values[0, -2]).tolist(), strict=True))
                for quantity, sign in (("displacement", 1.0), ("velocity", -1.0))
            }
            back = il.simulate(network, duration, initial=turned, **options)
            # what a path shows, and what it is given, has estimates of how forces change within a step to either side
            touched = _by_copy(there.contact_force.values[0] > 0.0, copies) > 0
            is_open = ~(touched[:-2] | touched[1:-1] | touched[2:])
            early = slice(1, 1 + COMPARED)
            x, v = (
                there[quantity].values[0, early] - sign * back[quantity].values[0, ::-1][early]
                for quantity, sign in (("displacement", 1.0), ("velocity", -1.0))
            )
            off = np.hypot(x, v).reshape(COMPARED, copies, -1).max(axis=2)
            seen = is_open[:COMPARED].any(axis=0) & is_open[-1]
            worst = np.where(is_open[:COMPARED], off, 0.0).max(axis=0)[seen]
            contacts[row, column] = float(there.contact_rate.sum()) * duration / copies
            count[row, column] = len(worst)
            if len(worst):
                error[row, column], largest[row, column] = np.median(worst), worst.max()
    dims = ("scene", "time")
    return xr.Dataset(
        {
            "contacts": (dims, contacts, _named("contacts of a copy until the motion is reversed")),
            "error": (dims, error, _named("median over copies of the largest distance from the start (m, m/s)")),
            "largest": (dims, largest, _named("largest over copies")),
            "copies": (dims, count, _named("copies without a closed contact at the reversal")),
        },
        {"scene": list(REVERSED)},
    )


def _momentum(study: ConservationStudy, dataset: xr.Dataset) -> xr.Dataset:
    momenta = dataset.velocity.values[0] * np.array(MASSES)
    total, size = momenta.sum(axis=1), np.abs(momenta).sum(axis=1)
    contacts = float(dataset.contact_rate.sum()) * dataset.time.values
    return xr.Dataset(
        {
            "error": ("time", (total - total[0]) / size[0], _named("change of the momentum over that of all bodies")),
            "contacts": ("time", contacts, _named("contacts until then")),
        },
        {"time": dataset.time.values},
    )


def _orders(study: ConservationStudy, results: Mapping[str, xr.Dataset]) -> xr.Dataset:
    """Return the largest error of paths against DOP853, in the geometric mean over the copies, and its slopes."""
    scenes = paths()
    shape = len(COARSEST), len(scenes), study.order_steps
    error, step = np.empty(shape), np.empty((shape[0], shape[2]))
    for column, (name, path) in enumerate(scenes.items()):
        network = side_by_side(path.network, study.path_copies)
        expected = _reference(network, path_starts(study.path_copies))
        for row, (kind, coarsest) in enumerate(COARSEST.items()):
            for halving in range(study.order_steps):
                dataset = results[f"{kind}_{name}_{halving}"]
                found = np.concatenate([dataset.displacement.values[0], dataset.velocity.values[0]], axis=1)
                off = np.sqrt(((found - expected) ** 2).mean(axis=0)).reshape(2, study.path_copies, -1).max(axis=(0, 2))
                error[row, column, halving] = np.exp(np.log(off).mean())
                step[row, halving] = coarsest / 2.0**halving
    slope = np.array([[np.polyfit(np.log(step[i]), np.log(error[i, j]), 1)[0] for j in range(shape[1])]
                      for i in range(shape[0])])  # fmt: skip
    dims = ("integrator", "force", "halving")
    return xr.Dataset(
        {
            "error": (dims, error, _named("error of paths (m, m/s), root mean square over time, mean over starts")),
            "step": (("integrator", "halving"), step, {"units": "s", "long_name": "step"}),
            "order": (dims[:2], slope, _named("slope of the error")),
            "power": ("force", [path.power for path in scenes.values()], _named("power of the indentation")),
        },
        {"integrator": list(COARSEST), "force": list(scenes)},
    )


def _reference(network: il.Network, initial: dict[str, dict[str, float]]) -> np.ndarray:
    compiled = network.compile()
    times = PATH_INTERVAL * np.arange(round(PATH_DURATION / PATH_INTERVAL) + 1)
    start = compiled.state(displacement=initial["displacement"], velocity=initial["velocity"])
    solution = solve_ivp(
        compiled.rhs, (0.0, PATH_DURATION), start, "DOP853", times, rtol=1e-12, atol=1e-13, max_step=0.01
    )
    return np.asarray(solution.y.T)
