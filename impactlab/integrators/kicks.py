"""Kicks by all forces that are no part of the linear motion, at a shifted place; and what they count in velocities."""

from __future__ import annotations

import numpy as np

from impactlab.compiling.jit import inlined
from impactlab.kernels.flow import COEFFICIENTS
from impactlab.kernels.kick import add_forced, add_scaled, apply_kick, clear, scaled_sum

SHIFT, KICK, HALF_KICK, HALF_STEP, LAG, PUSH = range(COEFFICIENTS, COEFFICIENTS + 6)
"""Columns of the coefficients; four of push follow: x, v by the mean of a given force, x, v by its slope."""

SPLIT_FRICTION = 0.125
"""Largest friction over a step, ``c h/m``, that may act at one moment of it."""


def kick_share(friction: np.ndarray, little: float = SPLIT_FRICTION) -> np.ndarray:
    """Return the share of kicks that counts in velocities at their own time, by friction over a step, ``γh = c h/m``.

    A constant force F keeps a body at F/c. What is left of earlier kicks g = F h/m is g/(exp(γh) − 1), so that
    1/γh − 1/(exp(γh) − 1) of a kick belongs to its own time. That is 1/2 where there is `little` friction.
    """
    slowed = friction > little
    strong = np.where(slowed, friction, 1.0)
    return np.where(slowed, 1.0 / strong + np.exp(-strong) / np.expm1(-strong), 0.5)


def kick_lag(friction: np.ndarray) -> np.ndarray:
    """Return the part of kicks that velocities in their middle have beyond those of the smooth path; see `kick_share`.

    It is all that is left of 1/2 − θ where a step holds little friction.
    """
    return np.where(friction > SPLIT_FRICTION, 0.0, friction / 12.0)


def kick_width(friction: np.ndarray) -> np.ndarray:
    """Return the share w of kicks g so that velocities at their own time, and w g to either side of them, are right.

    Mean squares of velocities with the `kick_share` θ of linear kicks are ``(θ² − (1 − 2θ)/(exp(2γh) − 1)) E[g²]`` too
    small, a sixth of E[g²] where there is little friction; the mean of the three has ``2w²/3 E[g²]`` more.
    """
    share = kick_share(friction)
    with np.errstate(over="ignore"):
        missing = share**2 - (1.0 - 2.0 * share) / np.expm1(2.0 * np.maximum(friction, SPLIT_FRICTION))
    return np.where(friction > SPLIT_FRICTION, np.sqrt(1.5 * np.maximum(missing, 0.0)), 0.5)


@inlined
def kick(forces, tables, passes, still, v, y, slot):  # type: ignore[no-untyped-def]
    """Change the velocities v by all forces at the shifted place y, which is a result, [body, lane] each.

    Forces that depend on velocities are evaluated in some passes, 0 where there are none; `still` holds zeros. The slot
    is a `History` of one step, with the displacements; the rest is written, of which the velocities are those in the
    middle of the kick.
    """
    parameters, indices, coefficients = tables.parameters, tables.indices, tables.coefficients
    x, middle, total, indentation, contact_force = slot
    # the conservative force at x says where the kick is read
    forces(x, still, still, 0.0, parameters, indices, indentation, contact_force, total)
    scaled_sum(x, coefficients, SHIFT, total, y)
    if passes == 0:
        forces(y, v, v, 0.0, parameters, indices, indentation, contact_force, total)
    for _ in range(passes):  # each force is solved for its own velocity, with the other forces of the pass before
        scaled_sum(v, coefficients, HALF_KICK, total, middle)
        half_step = coefficients[0, HALF_STEP, 0]
        forces(y, v, middle, half_step, parameters, indices, indentation, contact_force, total)
    apply_kick(coefficients, KICK, total, v, middle)


@inlined
def push_by_given(coefficients, forced, index, part, push, x, v):  # type: ignore[no-untyped-def]
    """Add the response to a part of given forces in a step, mean or slope; the forces of bodies are left in `push`."""
    clear(push)
    add_forced(forced, 2 * index + part, push)
    add_scaled(coefficients, PUSH + 2 * part, push, x)
    add_scaled(coefficients, PUSH + 2 * part + 1, push, v)
