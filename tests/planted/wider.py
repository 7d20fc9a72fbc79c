"""Bugs in what white noise and smooth conservative contacts do not need: dashpots, given functions, starts, loads."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

import impactlab.plan.plan
from impactlab.integrators.kicks import HALF_STEP
from impactlab.linear import band_limited, given_functions
from impactlab.simulation import block, functions_in_steps, growing_ensemble
from impactlab.statistics import joint_moments, moments, rare, regression
from impactlab.step_control.rules import automatic, steps
from planted.dynamics import column
from planted.plant import Bug, Plant, both, instead, returned
from planted.wider_scenes import CLAMP, DASHPOT, DECAY, FAST, GUST, LOADED, RESONANCE, SELDOM

UNMEASURED = instead(growing_ensemble, "worth_measuring", lambda *_: False)
"""The step as rules choose it; else its error is measured, and it is made smaller whatever a rule forgot."""


def nothing_is(values):
    """As `impactlab.linear.given_functions.looked_at`, but every function is smooth."""
    return np.zeros(values.shape[:-1], dtype=bool), values[..., 1:-1].min(axis=-1)


def mean_only(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A given force as constant over a step."""
    mean, slope = given_functions.mean_and_slope(values)
    return mean, np.zeros_like(slope)


def first_only(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A given function as it is at the beginning of a step."""
    return values[..., 0], np.zeros_like(values[..., 0])


def in_panels(rule: Any) -> Plant:
    """What steps see of a harmonic force by another rule."""
    weights = instead(functions_in_steps, "panel_weights", band_limited.panel_weights.__wrapped__)  # those not kept
    return both(instead(band_limited, "mean_and_slope", rule), weights)


def longest(model: Any, begin: float, end: float, step: float) -> float:
    """The step as it is, however fast given functions vary."""
    return step


def no_load(*means: Any) -> Any:
    return np.zeros_like(means[0])


BUGS = [
    Bug("step without the rates of dashpots", DASHPOT,
        both(instead(automatic, "damping_step", lambda *_: math.inf), UNMEASURED)),
    Bug("step whose error is not measured", CLAMP, UNMEASURED),
    Bug("force of a clamped dashpot at the velocity before the kick", CLAMP,
        both(column(HALF_STEP, 0.0), UNMEASURED)),
    Bug("force of a strong dashpot at the velocity before the kick", DASHPOT, column(HALF_STEP, 0.0)),
    Bug("force of a dashpot at the velocity after the kick", CLAMP, both(column(HALF_STEP, 2.0), UNMEASURED)),
    Bug("step that does not see how fast a force varies", FAST, instead(automatic, "resolving_step", longest)),
    Bug("given force at the beginning of a step", RESONANCE, in_panels(first_only)),
    Bug("given force as constant over a step", FAST, in_panels(mean_only)),
    Bug("density of noise at the beginning of a step that does not see how fast it varies", GUST,
        both(instead(automatic, "resolving_step", longest), instead(functions_in_steps, "looked_at", nothing_is),
             instead(functions_in_steps, "mean_and_slope", first_only))),
    Bug("means of a transient over its kicks", DECAY,
        instead(impactlab.plan.plan.Plan, "transient", property(lambda plan: False))),
    Bug("means of a transient without the halves of its ends", DECAY,
        returned(block.Block, "_edge", lambda edge, *_: type(edge)(*(0.0 * item for item in edge)))),
    Bug("variance by squares of which one is of the chain, the other of the motion", LOADED,
        both(instead(joint_moments, "mean_load", no_load), instead(moments, "mean_load", no_load))),
    Bug("rate by a flux, of kicks that a static load makes", LOADED,
        instead(steps, "counts_closings", lambda *_: False)),
    Bug("balances as controls of what hardly any contact moved", SELDOM,
        both(returned(rare.Events, "seldom", lambda seldom, *_: np.zeros_like(seldom)),
             instead(regression.Regression, "rests_on_few",
                     lambda regression, values: np.zeros(len(values), dtype=bool)))),
]  # fmt: skip
