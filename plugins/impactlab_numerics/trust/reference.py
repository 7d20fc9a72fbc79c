"""References: exact laws, fine steps, and paths by another solver."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.linear.decay import relaxation_time
from impactlab.results.schema import CONTACT, STATISTICS, stationary
from impactlab.step_control.measured.bias import USUAL_BIAS
from impactlab_numerics.trust.drawing import RELAXATIONS, Scene
from impactlab_numerics.trust.path_means import COUNTED, PathMeans, path_statistics

JUDGED = tuple(statistic.name for statistic in stationary())
"""Statistics that are judged."""

FINER = 16
"""Parts of the automatic step in the reference."""

FINE_ENOUGH = 4
"""Least parts where the scene is known to be resolved."""

SENSITIVE = 2e-3
"""Change of a mean by which a path without noise depends on its start too much to be judged."""

STILL = 1e-9
"""Part of the largest mean square of all bodies below which another is rounding, or a remainder of the spin-up."""

MOST_BODY_STEPS = 1.5e9
"""Steps of a body that are taken if fewer tell nothing: half a minute or so."""

POINTS = 200
"""Samples of a path in the time in which its fastest motion turns by 2π."""

LOOKS = 64
"""Times in a contact at which its force is looked at, by Gauss's rule."""

_DOUBT = 4e-3
"""Relative difference of two estimates at the fine step that is doubted."""

_DOUBT_ERRORS = 4.0
"""Standard errors of that difference in addition."""

_PLACES, _SHARES = np.polynomial.legendre.leggauss(LOOKS)
_PLACES, _SHARES = 0.5 * (_PLACES + 1.0), 0.5 * _SHARES


class Unknown(Exception):
    """There is no reference; the message says why."""


class Sensitive(Unknown):
    """The reference depends too much on the start."""


class Reference(NamedTuple):
    """Values and standard errors by statistic, (label,) each; NaN where nothing is known.

    `doubts` are statistics of which two estimates at the fine step differ.
    """

    kind: str
    values: Mapping[str, np.ndarray]
    errors: Mapping[str, np.ndarray]
    step: float = math.nan
    doubts: tuple[str, ...] = ()


def reference_of(scene: Scene, step: float, seed: Any, body_steps: float) -> Reference:
    """Return the reference of a scene.

    Parameters
    ----------
    scene : Scene
    step : float
        Step of the run that is judged (s).
    seed : seed
        Of the reference.
    body_steps : float
        Steps of a body that the reference may take.

    Raises
    ------
    Unknown
        If nothing is known, or it would take too long.
    """
    if scene.deterministic:
        return _path(scene)
    if not scene.transient:
        try:
            return _exact(scene.equivalent or scene.network)
        except il.NoExactReference:
            pass
    return _fine(scene, step, seed, body_steps)


def _exact(network: il.Network) -> Reference:
    law = il.exact(network).statistics()
    values = {name: law[name].values for name in JUDGED if name in law}
    return Reference("exact law", values, {name: np.zeros_like(value) for name, value in values.items()})


def _fine(scene: Scene, step: float, seed: Any, body_steps: float) -> Reference:
    """Run the scene at a fine step, with noise of its own."""
    network = scene.network
    options = {name: value for name, value in scene.options.items() if name != "record"}
    bodies, duration, realizations = len(network.oscillators), options["duration"], options["realizations"]
    spin_up = options.get("spin_up")
    if spin_up is None:
        given = isinstance(options.get("initial"), Mapping)
        spin_up = 0.0 if given else RELAXATIONS * relaxation_time(Model.of(network))
    spin_up *= scene.settling
    kinds = {getattr(item, "excitation", item).kind for item in network.excitations.values()}
    series = "lines" in kinds  # each realization takes its time
    if realizations < 256 and not (scene.transient or series):  # as much time, but samples that are surely independent
        duration, realizations = duration * realizations / 256.0, 256
        duration = max(duration, 2.0 * relaxation_time(Model.of(network)))
    fine = min(step / FINER, scene.fine)
    body_steps /= 5.0 if series else 1.0

    def work(at: float) -> float:
        return float(bodies * (spin_up + duration) / at)

    if work(fine) * realizations > body_steps:
        fine = max(fine, min(step / FINE_ENOUGH, scene.fine, work(1.0) * realizations / body_steps))
        realizations = max(64, min(realizations, int(body_steps / work(fine))))
        if work(fine) * realizations > MOST_BODY_STEPS:
            raise Unknown(f"{work(fine) * realizations:.2g} steps of a body are too many")
    count = math.ceil(duration / fine)
    options |= {"realizations": realizations, "duration": duration, "spin_up": spin_up, "step": duration / count}
    method = il.ExactFlow(jumps=False, measured=False)  # looks at every step
    result = il.simulate(network, rng=seed, record=PathMeans(), integrator=method, **options)
    path = path_statistics(result)
    rigid = np.array([isinstance(item.law, il.RigidContact) for item in network.contacts.values()], dtype=bool)
    round_ones = np.array([isinstance(item, il.RoundContact) for item in network.contacts.values()], dtype=bool)
    unseen = rigid | round_ones  # a path of samples does not show when these close
    values, errors, doubts = {}, {}, []
    for name in JUDGED:
        if name not in path:
            continue
        source = result if realizations == 1 and name in result else path  # one path has no error of its own
        value, error = source[name].values, source[f"{name}_standard_error"].values
        scale = scale_of(name, {item: path[item].values for item in JUDGED if item in path})
        if not scene.transient and name != "contact_rate" and name in result:
            other, scatter = result[name].values, result[f"{name}_standard_error"].values
            if (np.abs(value - other) > _DOUBT * scale + _DOUBT_ERRORS * np.hypot(error, scatter)).any():
                doubts.append(name)
            else:
                better = scatter < error
                value, error = np.where(better, other, value), np.where(better, scatter, error)
        if STATISTICS[name].dimension == CONTACT:
            known = path["closings"].values >= COUNTED
            value = np.where(known, value, np.nan)
            if name in result:
                value = np.where(unseen, result[name].values, value)
                error = np.where(unseen, result[f"{name}_standard_error"].values, error)
            if name == "contact_ratio":  # noise leaves rests of rigid contacts no duration but that of a step
                value = np.where(rigid, np.nan, value)
        values[name], errors[name] = value, np.hypot(error, USUAL_BIAS * (options["step"] / step) ** 2 * scale)
    return Reference("fine step", values, errors, options["step"], tuple(doubts))


def scale_of(name: str, values: Mapping[str, Any]) -> np.ndarray:
    """Return the size by which the difference of a statistic is measured: its own, for means the root mean square.

    Bodies hardly move below `STILL` of the largest mean square.
    """
    if STATISTICS[name].square:
        return np.asarray(np.sqrt(scale_of(STATISTICS[name].square, values)))
    size = np.asarray(np.abs(values[name]))
    if STATISTICS[name].dimension == CONTACT:
        return size
    square = np.abs(values["mean_square_velocity" if "velocity" in name else "mean_square_displacement"])
    return np.asarray(np.maximum(size, STILL * square.max(initial=0.0)))


def _path(scene: Scene) -> Reference:
    """Solve a scene without noise by another method, with its contacts as events."""
    values = _solved(scene, 0.0)
    shifted = _solved(scene, 1e-4) if scene.network.contacts else values
    errors = {name: np.zeros_like(value) for name, value in values.items()}
    for name, value in values.items():
        if (np.abs(shifted[name] - value) > SENSITIVE * scale_of(name, values)).any():
            raise Sensitive(f"{name} depends on the start too much")
    return Reference("path", values, errors)


def _solved(scene: Scene, shift: float) -> dict[str, np.ndarray]:
    """Return means of a path over [0, T]; `shift` is a relative change of the start and a delay of the spin-up."""
    from scipy.integrate import solve_ivp

    system = scene.network.compile()
    options, relaxation = scene.options, relaxation_time(Model.of(scene.network))
    initial = options.get("initial")
    begin, duration = 0.0, options["duration"]
    if isinstance(initial, Mapping):
        state = system.state(**initial) * (1.0 + shift)
    else:
        begin = -options.get("spin_up", RELAXATIONS * relaxation) * (1.0 + shift)
        state = system.state()
    events: list[Callable[..., float]] = system.contact_events
    solution = solve_ivp(
        system.rhs, (begin, duration), state, method="DOP853", rtol=1e-9, atol=1e-12 * _size(scene),
        max_step=10.0 * scene.fine, dense_output=True, events=events,
    )  # fmt: skip
    if not solution.success:
        raise Unknown(f"the path was not found: {solution.message}")
    count = min(200_000, max(2000, math.ceil(duration * POINTS * 0.05 / (2.0 * math.pi * scene.fine))))
    times = np.linspace(0.0, duration, count + 1)
    states = solution.sol(times)
    bodies = len(scene.network.oscillators)

    def mean(values: np.ndarray) -> np.ndarray:
        return np.asarray(np.trapezoid(values, times, axis=0) / duration)

    x, v = states[:bodies].T, states[bodies:].T
    found = {
        "mean_displacement": mean(x),
        "mean_square_displacement": mean(x * x),
        "variance_displacement": mean(x * x) - mean(x) ** 2,
        "mean_velocity": mean(v),
        "mean_square_velocity": mean(v * v),
    }
    if not scene.network.contacts:
        return found
    ratios, rates, forces = [], [], []
    for index, (event, passed) in enumerate(zip(events, solution.t_events, strict=True)):
        inside = passed[(passed > 0.0) & (passed < duration)]
        ends = np.concatenate([[0.0], inside, [duration]])
        closed = np.array([event(t, solution.sol(t)) > 0.0 for t in 0.5 * (ends[1:] + ends[:-1])])
        lengths = np.diff(ends)[closed]
        ratios.append(float(lengths.sum()) / duration)
        rates.append(float(np.count_nonzero(closed[1:] & ~closed[:-1])) / duration)
        # within each contact: a dashpot's force jumps when it closes
        looks = (ends[:-1][closed, None] + lengths[:, None] * _PLACES).ravel()
        force = (
            system.to_dataset(looks, solution.sol(looks))["contact_force"].values if len(looks) else np.zeros((0, 1))
        )
        forces.append(float(lengths @ force[:, index % force.shape[1]].reshape(-1, LOOKS) @ _SHARES) / duration)
    return found | {
        "contact_ratio": np.array(ratios),
        "contact_rate": np.array(rates),
        "mean_contact_force": np.array(forces),
    }


def _size(scene: Scene) -> float:
    """Return a usual displacement (m)."""
    initial = scene.options.get("initial")
    given = [abs(value) for part in initial.values() for value in part.values()] if isinstance(initial, Mapping) else []
    forces = [abs(getattr(item, "amplitude", 0.0)) for item in scene.network.excitations.values()]
    stiffness = max(body.stiffness for body in scene.network.oscillators.values()) or 1.0
    return float(max([*given, *(force / stiffness for force in forces), 1e-6]))
