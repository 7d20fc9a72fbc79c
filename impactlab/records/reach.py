"""How far given forces and motions move bodies between contacts, and noise brings contacts, for limits of densities."""

from __future__ import annotations

import numpy as np

from impactlab.assembly.model import Model
from impactlab.linear.laws import extent, flexibility, hottest
from impactlab.step_control.rules.profiles import REACH
from impactlab.step_control.rules.tangent_stiffness import Stiffening, energies, moments

MARGIN = 0.02
"""Part of its range by which the density of a given motion, or of a body at a contact, is wider on either side."""


def deepest(model: Model) -> np.ndarray:
    """Return the indentations at which contacts store 20 thermal energies, (contact,) (m)."""
    heat = energies(model, "stationary", 1.0)
    led = model.sources["force"].bodies or model.kicks.timed.any()
    if len(model.coupled) and not led:  # what couplings carry is not as hot as a heavy base
        warm = model.mass * extent(model)[1] ** 2
        heat = np.where(warm > 0.0, np.minimum(heat, warm), heat)
    return Stiffening.of(model, REACH * heat, moments(model, 0.0, 1.0)).penetration


def reach_of_moved(
    model: Model, quantity: str, limits: tuple[np.ndarray, np.ndarray], moved: np.ndarray, energies: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return limits between which bodies move, (body,) each, from those of noise and what given forces and motions add.

    `moved` are ranges of `impactlab.linear.given_response`; noise brings so many thermal energies to a contact. A body
    that contacts hold stays between both, as far as these let it go; it may get the energy and the force of those that
    it touches, and the velocity that a body of given motion brings by hitting it in each period.
    """
    (low, high), (least, most), free = limits, moved[0], model.bodies.free
    speed, yielding = np.abs(moved[1]).max(axis=0), flexibility(model)
    margin = MARGIN * (moved[:, 1] - moved[:, 0])
    heat = np.append(np.where(free, model.mass * speed**2, 0.0), 0.0)
    links, held = model.ends, model.ends.any(~model.bodies.free)
    fastest = links.largest(np.where(free, 0.0, speed))
    touched = np.zeros(len(low) + 1, dtype=bool)
    touched[links.slots] = True
    reached = links.slots[held[links.rows]]
    mass, hits = np.append(model.mass, 0.0), np.append(_faster_by_hits(model, yielding), 0.0)
    np.maximum.at(heat, reached, mass[reached] * (hits[reached] * fastest[links.rows[held[links.rows]]]) ** 2)
    touched = touched[:-1] & free
    energy = hottest(model, np.where(free, heat[:-1], 0.0), model.touching())
    if quantity == "velocity":
        reach = np.where(touched, np.maximum(speed, np.sqrt(energy / model.mass)), speed)
        lower, upper = moved[1, 0] - margin[1], moved[1, 1] + margin[1]
        return np.where(free, low - reach, lower), np.where(free, high + reach, upper)
    firm = np.where(np.isfinite(yielding), yielding, 0.0)
    size = np.maximum(np.abs(least), np.abs(most))
    own = np.divide(size, firm, out=np.zeros_like(size), where=firm > 0.0)
    force = hottest(model, own, model.touching())
    reach = np.maximum(np.sqrt(energy * firm), np.where(force > own, force * firm, 0.0))
    lower = np.where(free, low + np.where(touched, np.minimum(least, -reach), least), least - margin[0])
    upper = np.where(free, high + np.where(touched, np.maximum(most, reach), most), most + margin[0])
    if links.plain and touched.any():
        thermal = energies * model.mass * extent(model)[1] ** 2
        stored = np.where(np.isfinite(thermal), thermal, 0.0) + 0.5 * energy + 0.5 * force**2 * firm
        farthest = model.clearance + Stiffening.of(model, stored).penetration
        first, second = links.pairs.T
        bounds = np.append(lower, 0.0), np.append(upper, 0.0)
        # contacts hold back a body that given forces move over ten bodies
        for _ in range(10):
            np.minimum.at(bounds[1], first, bounds[1][second] + farthest)
            np.maximum.at(bounds[0], second, bounds[0][first] - farthest)
            bounds[0][-1] = bounds[1][-1] = 0.0
        lower = np.where(touched, np.minimum(low, bounds[0][:-1]), lower)
        upper = np.where(touched, np.maximum(high, bounds[1][:-1]), upper)
        slack = np.where(
            touched, MARGIN * (upper - lower), 0.0
        )  # a body that an infinite force stops rests at its limit
        lower, upper = lower - slack, upper + slack
    return lower, upper


def _faster_by_hits(model: Model, yielding: np.ndarray) -> np.ndarray:
    """Return how many times faster than a body of given motion others get that it hits in each of their periods."""
    damping_ratio = np.zeros(len(model.mass))
    some = model.damping > 0.0
    damping_ratio[some] = 0.5 * model.damping[some] * np.sqrt(yielding[some] / model.mass[some])
    with np.errstate(divide="ignore"):
        # a body that is hit again and again is taken to become 50 times faster at most
        return np.asarray(np.minimum(-2.0 / np.expm1(-2.0 * np.pi * damping_ratio), 50.0))
