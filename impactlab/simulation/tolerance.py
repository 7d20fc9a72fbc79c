"""An accuracy instead of a duration: how many realizations, and at which step."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import xarray as xr

from impactlab.assembly.model import Model
from impactlab.components.component import finite, suggestion
from impactlab.components.composition import Composition
from impactlab.errors import InvalidInput
from impactlab.linear.laws import linear_variances
from impactlab.nonlinear.relaxation import undamped
from impactlab.results.dataset import configuration_of
from impactlab.results.schema import OF_POINTS, STATISTICS, scatter_of, statistic_of, variables

PILOT = 256
"""Realizations of the first attempt."""

RELAXATION_TIMES = 100.0
"""Length of a realization in relaxation times, beside which the spin-up is short."""

SAFETY = 0.85
"""Part of the tolerance that an attempt aims at."""

DRIFT = 6.0
"""Difference between two halves of a run, in standard errors, from which it is not stationary."""

UNLIKE = 0.2
"""Relative difference of the mean forces of a contact in the runs at one and two steps, from which a step is halved."""

HALVINGS = 6
"""How often the step is halved before a tolerance is given up."""

Attempt = Callable[[int, float | None, bool, float], xr.Dataset]


def checked(tolerance: Any, model: Model) -> dict[str, float]:
    """Return tolerances by the name of the statistic.

    They are refused if one is not positive, or a statistic is unknown, has no error bar, or no stationary value in this
    network.
    """
    if not isinstance(tolerance, Mapping) or not tolerance:
        raise InvalidInput(f'tolerance must be like {{"mean_square_displacement": 1e-3}}, not {tolerance!r}.')
    for name, value in tolerance.items():
        known = STATISTICS | OF_POINTS if model.points else STATISTICS
        if name not in known:
            raise InvalidInput(f"tolerance: there is no statistic {name!r}; {suggestion(name, known)}")
        if not known[name].stationary:
            raise InvalidInput(
                f"tolerance: {name} grows with the observation time; name another statistic, or give duration= instead."
            )
        if not 0.0 < finite(f"tolerance of {name}", value) <= 1.0:
            raise InvalidInput(f"tolerance of {name} must be larger than 0 and at most 1, not {value!r}.")
    _refuse_drifting(tuple(tolerance), model)
    return {name: float(value) for name, value in tolerance.items()}


def _refuse_drifting(names: tuple[str, ...], model: Model) -> None:
    """Refuse statistics that have no stationary value, or none but 0."""
    heated = linear_variances(model)[1]
    if not heated.any():
        raise InvalidInput("tolerance: nothing is excited by noise, so every statistic is 0; give duration=.")
    growing = undamped(model)
    for body, name in enumerate(model.bodies):
        if growing[body]:
            raise InvalidInput(
                f"tolerance: {name!r} is excited but not damped, so it has no stationary state; give duration=."
            )
        held = model.stiffness[body] > 0.0 or model.nonlinear_bodies[body]
        if not held and any(statistic_of(item).held for item in names):
            raise InvalidInput(
                f"tolerance: nothing confines {name!r}, so its displacement has no stationary value; give duration=."
            )


def reach(
    attempt: Attempt, tolerance: dict[str, float], max_seconds: float, least: int, step: float | None
) -> xr.Dataset:
    """Repeat a simulation with more realizations or a smaller step until it is good enough.

    Every attempt runs at a step h and, with the same noise, at 2h. The bias of the step is estimated as a third of the
    difference, which is right for a method of second order and too much for a higher one. Both runs follow nearly the
    same paths, so that their difference says little of the scatter of either: a run is not accepted because it happens
    to be off. A result is good enough when ``|bias| + 2 standard errors ≤ tolerance |value|`` for every label; where
    the value is 0 by symmetry, its standard deviation takes its place.

    ``attempt(realizations, step, coarse, seconds)`` returns a dataset; with step None the step is chosen, coarse runs
    have the noise of those at half the step, and a run that would take longer than some seconds is refused. The first
    attempt has at least the `least` realizations, and a step if one is given (s). The last one is returned, with
    ``<name>_bias`` and what was spent; a tolerance that cannot be reached in the time, as far as that can be foreseen,
    is refused.
    """
    begin = time.monotonic()
    realizations = max(PILOT, least)
    halvings = attempts = 0
    while True:
        started = time.monotonic()
        left = max_seconds - (started - begin)
        fine = attempt(realizations, step, False, left)
        coarse = attempt(realizations, 2.0 * fine.attrs["step"], True, left)
        took = time.monotonic() - started
        attempts += 1
        if max(fine.attrs["drift"], coarse.attrs["drift"]) > DRIFT:
            raise InvalidInput(
                f"After a spin-up of {fine.attrs['spin_up']:g} s the motion is not stationary, so a tolerance has no "
                "meaning yet. Give a longer spin_up= and duration=."
            )
        excess, scatter, biased = _judge(fine, coarse, tolerance)
        if excess <= 1.0:
            return _labelled(fine, coarse, tolerance, attempts, time.monotonic() - begin)
        if biased:
            halvings += 1
            step = 0.5 * fine.attrs["step"]
        growth = 1.0 if biased else (excess / SAFETY) ** 2
        needed = took * max(growth, (scatter / SAFETY) ** 2) * (2.0 if biased else 1.0)
        if halvings > HALVINGS or time.monotonic() - begin + needed > max_seconds:
            times = f"{needed:.2g} s more" if math.isfinite(needed) else "more time than can be foreseen"
            raise InvalidInput(
                f"The tolerance {tolerance} would take about {times}; after {attempts} attempt(s) the largest error is "
                f"{excess:.3g} times the tolerance. Give a larger tolerance=, or max_seconds=."
            )
        realizations = math.ceil(realizations * growth)


def _judge(fine: xr.Dataset, coarse: xr.Dataset, tolerance: dict[str, float]) -> tuple[float, float, bool]:
    """Return the largest error over its tolerance, that without the bias, and whether more realizations cannot help.

    A contact that was never closed counts as not known at all; a body that never moves is known.
    """
    biased = _sees_other_forces(fine, coarse)
    excess, without = 2.0 * biased, 0.0
    for name, relative in tolerance.items():
        if name not in fine:
            raise InvalidInput(f"tolerance: this network has no {name}.")
        allowed = relative * _scale(fine, name)
        error = scatter_of(fine, name).values
        bias, uncertainty = _bias(fine, coarse, name)
        for one in zip(allowed, np.abs(bias), error, uncertainty, strict=True):
            most, off, scatter, doubt = map(float, one)
            if most == 0.0 and scatter == 0.0 and "oscillator" in fine[name].dims:
                continue
            spent = off + 2.0 * scatter
            known = most > 0.0 and math.isfinite(spent)
            excess = max(excess, spent / most if known else math.inf)
            without = max(without, 2.0 * scatter / most if known else math.inf)
            biased |= off - 2.0 * doubt > 0.5 * most
    return excess, without, biased


def _sees_other_forces(fine: xr.Dataset, coarse: xr.Dataset) -> bool:
    """Whether contact forces of the two runs differ by more than `UNLIKE`, so that their difference is no estimate.

    A step is refused at which bodies overlap and a contact that could push them apart did not: neither run has its
    force.
    """
    if "mean_contact_force" not in fine:
        return False
    forces, closed = (
        np.stack([item[name].values for item in (fine, coarse)]) for name in ("mean_contact_force", "contact_ratio")
    )
    contacts = Composition.from_dict(configuration_of(fine)["network"]).contacts
    for slot in np.flatnonzero((forces == 0.0).all(axis=0) & (closed > 0.0).all(axis=0)):
        name = str(fine.contact.values[slot])
        if (contacts[name].law.evaluate(10.0 ** np.arange(-9.0, 4.0)) > 0.0).any():
            raise InvalidInput(
                f"tolerance: {name!r} was closed in {100.0 * closed[0, slot]:.2g} % of the time without any force at a "
                f"step of {fine.attrs['step']:.3g} s, which is too large. Give a smaller step=."
            )
    error = np.hypot(*(scatter_of(item, "mean_contact_force").values for item in (fine, coarse)))
    difference = np.abs(forces[0] - forces[1])
    return bool((difference > UNLIKE * forces.max(axis=0) + 3.0 * np.nan_to_num(error)).any())


def _bias(fine: xr.Dataset, coarse: xr.Dataset, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the bias of the step and its standard error.

    Of the difference of the two values and the mean difference of pairs of realizations, the better known.
    """
    both = (coarse[name].values - fine[name].values) / 3.0
    of_both = np.hypot(scatter_of(coarse, name).values, scatter_of(fine, name).values) / 3.0
    each = statistic_of(name).by_realization
    pairs = (coarse[each].values - fine[each].values) / 3.0
    of_pairs = pairs.std(axis=0, ddof=1) / math.sqrt(len(pairs))
    better = of_pairs < of_both
    return np.where(better, pairs.mean(axis=0), both), np.where(better, of_pairs, of_both)


def without_realizations(dataset: xr.Dataset) -> xr.Dataset:
    """Return a dataset without what each realization gave."""
    names = [variable.by_realization for variable in variables().values()]
    dataset = dataset.drop_vars(names, errors="ignore")
    unused = "realization" not in {dim for item in dataset.data_vars.values() for dim in item.dims}
    return dataset.drop_dims("realization") if unused and "realization" in dataset.dims else dataset


def _scale(dataset: xr.Dataset, name: str) -> np.ndarray:
    """Size of a statistic that its tolerance refers to."""
    value: np.ndarray = np.abs(dataset[name].values)
    point = "point_" if name in OF_POINTS else ""
    own = name.removeprefix(point)
    square = {"mean_velocity": "mean_square_velocity", "mean_displacement": "variance_displacement"}.get(own)
    if square is None:
        return value
    zero = value < 5.0 * scatter_of(dataset, name).values
    return np.where(zero, np.sqrt(dataset[point + square].values), value)


def _labelled(
    fine: xr.Dataset, coarse: xr.Dataset, tolerance: dict[str, float], attempts: int, seconds: float
) -> xr.Dataset:
    for name in tolerance:
        statistic = statistic_of(name)
        if statistic.allowance in fine:  # the bias stands beside the standard error, which does not allow for it
            for variable in (statistic, statistic.direct):
                if variable.name in fine:
                    error = fine[variable.error]
                    attrs = {item: text for item, text in error.attrs.items() if item != "comment"}
                    fine[variable.error] = error.dims, scatter_of(fine, variable.name).values, attrs
            fine = fine.drop_vars(statistic.allowance)
        attrs = {**fine[name].attrs, "long_name": f"estimated bias of the step in {fine[name].attrs['long_name']}"}
        attrs.pop("ancillary_variables", None)
        fine[f"{name}_bias"] = (fine[name].dims, _bias(fine, coarse, name)[0], attrs)
    tolerances = ", ".join(f"{name}: {value:g}" for name, value in tolerance.items())
    return fine.assign_attrs(tolerance=tolerances, attempts=attempts, seconds_spent=seconds)
