"""What can be known of a network before it is simulated: time scales, steps and their bias."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from impactlab.assembly.generate import generate
from impactlab.assembly.mechanism import Mode, check_method, refusals
from impactlab.assembly.model import Model
from impactlab.components.composition import Composition
from impactlab.errors import InvalidInput
from impactlab.inputs import checked, positive
from impactlab.integrators.base import Integrator, check_integrator
from impactlab.integrators.exact_flow import ExactFlow
from impactlab.integrators.intervals import refusal_of_intervals
from impactlab.linear.damping import damped
from impactlab.linear.decay import relaxation_time
from impactlab.linear.laws import hottest, linear_variances
from impactlab.machine import tuning
from impactlab.networks.linearized import LinearizedNetwork
from impactlab.plan.clock import RELAXATION_TIMES
from impactlab.step_control.rules.automatic import certified, choose_step
from impactlab.step_control.rules.force_checks import stiffening_of
from impactlab.step_control.rules.relaxation import growth_of
from impactlab.step_control.rules.tangent_stiffness import Stiffening, energies, moments

MOST_BODIES = 200
"""Bodies up to which modes are computed, or exact laws looked for: the cost grows with their cube."""

WITHOUT_STEPS = (
    "Nothing is random: where no method is given, il.simulate makes steps only if il.EventLocated cannot follow the "
    "motion or would take much longer; integrator_reason of the result says so."
)

ROWS_OF_TABLE = 12
"""Rows of a table that a text shows."""


@checked
@dataclass(frozen=True, eq=False, repr=False)
class NetworkCheck:
    """Time scales of a network and the steps that suit them; printed as a table.

    Parameters
    ----------
    dataset : xarray.Dataset
        ``natural_frequency`` (oscillator): each body alone, on its own spring; those that `coupled` (oscillator)
        marks are on linear couplings as well, and printed by their modes only. ``thermal_penetration`` (under noise),
        ``static_penetration``, ``tangent_stiffness``, ``shortest_contact`` (contact): where
        the contact has stored the energy that a body brings, on top of the preload; the stiffness there, or
        the largest that counts at other energies; half a period of the pair on it, ``π sqrt(μ/K)``. ``largest_step``,
        ``recommended_step``, ``refusal`` (integrator): NaN and the reason where a method
        cannot be used. ``open_frequency`` (mode), where there are contacts: of the network with all of them open,
        without forces that are not linear. ``closed_frequency``, ``bias_mean_square_displacement``,
        ``bias_mean_square_velocity`` (mode): of the network with all contacts closed on
        linear springs. A bias is that of the response to white noise, relative, due to the
        step alone, and infinite where the method is unstable; contacts that are open most
        of the time make it smaller.
        Attributes: ``integrator``, ``step`` (s), ``note``, and ``run``, on what `simulate` does with its step.

    Examples
    --------
    >>> check = network.check()
    >>> check.dataset.natural_frequency.values.round(3)
    array([3.162])
    """

    dataset: xr.Dataset

    @classmethod
    def of(
        cls,
        network: Composition,
        step: float | None = None,
        integrator: Integrator | None = None,
        most_modes: int = MOST_BODIES,
    ) -> NetworkCheck:
        """Find the time scales of a network and predict the bias of a step.

        Parameters
        ----------
        network : Network
        step : float, optional
            Time step (s); by default the one that `simulate` would choose before it makes it
            divide the duration.
        integrator : Integrator, optional
            Method that makes steps; `ExactFlow` by default.
        most_modes : int
            Bodies up to which modes are computed.

        Raises
        ------
        InvalidInput
            If the step or the integrator cannot be used; with the words of `simulate`.
        """
        method = integrator or ExactFlow()
        check_integrator(method)
        model = Model.of(network)
        generate(model)  # which refuses kernels that cannot be compiled
        until = RELAXATION_TIMES * relaxation_time(damped(model)[1])
        energy = energies(model, "stationary", until)
        growing = np.isinf(hottest(model, linear_variances(damped(model)[0])[1]))  # excited and not damped
        energy = np.where(growing, np.inf, energy)
        stiffening = stiffening_of(model, energy, moments(model, 0.0, until))
        known = np.isfinite(energy) | ~model.kicks.bodies
        methods = {**{type(item).__name__: item for item in _bundled()}, type(method).__name__: method}
        rows = {name: _steps(model, item, stiffening, until) for name, item in sorted(methods.items())}
        if step is None:
            step = rows[type(method).__name__][1]
        else:
            check_method(model, method)
            step = choose_step(_arranged(model, method, stiffening), method, stiffening, positive("step", step))
        modes: dict[str, Any] = {}
        note = f"Modes are computed for up to {most_modes} bodies."
        if len(model.bodies) <= most_modes:
            modes, note = _modes(_arranged(model, method, stiffening), stiffening, method, step, known)
            if len(model.ends):
                modes = {"open_frequency": ("mode", LinearizedNetwork.open(model).modes()[0]), **modes}
        coupled = np.zeros(len(model.bodies), dtype=bool)
        coupled[[slot for slots, *_ in model.coupled_parts() for slot in slots]] = True
        data = xr.Dataset(
            {
                "natural_frequency": ("oscillator", np.sqrt(model.stiffness / model.mass)),
                "coupled": ("oscillator", coupled),
                **_contacts(model, stiffening, known),
                **{
                    name: ("integrator", [row[column] for row in rows.values()])
                    for column, name in enumerate(("largest_step", "recommended_step", "refusal"))
                },
                **modes,
            },
            {"oscillator": list(model.bodies.names), "contact": list(model.contacts.names), "integrator": list(rows)},
            {
                "title": "Check of a network",
                "integrator": repr(method),
                "step": float(step),
                "note": note,
                "run": " ".join(_of_runs(model, method, stiffening, step)),
            },
        )
        for name, (units, long_name) in _LABELS.items():
            if name in data:
                data[name].attrs = {"units": units, "long_name": long_name}
        if not len(model.ends) and "closed_frequency" in data:
            data["closed_frequency"].attrs["long_name"] = "frequency"
        if "mode" in data.sizes:
            data = data.assign_coords(mode=np.arange(1, data.sizes["mode"] + 1))
        return cls(data)

    def __repr__(self) -> str:
        data = self.dataset
        lines = [f"{data.attrs['title']}: {data.attrs['integrator']}, step {data.attrs['step']:.4g} s"]
        if "mode" in data.sizes:
            data = data.isel(oscillator=~data.coupled.values)
        for dimension in ("oscillator", "contact", "integrator", "mode"):
            if data.sizes.get(dimension):
                lines += ["", *_table(data, dimension)]
        reasons = [str(reason) for reason in data.refusal.values if reason]
        notes = [*reasons, data.attrs["note"], data.attrs["run"]]
        return "\n".join([*lines, *(f"\n{note}" for note in dict.fromkeys(notes) if note)])


_LABELS = {
    "natural_frequency": ("rad s-1", "natural frequency"),
    "thermal_penetration": ("m", "thermal penetration"),
    "static_penetration": ("m", "static penetration"),
    "tangent_stiffness": ("N m-1", "tangent stiffness"),
    "shortest_contact": ("s", "shortest contact"),
    "largest_step": ("s", "largest step"),
    "recommended_step": ("s", "recommended step"),
    "open_frequency": ("rad s-1", "frequency, contacts open"),
    "closed_frequency": ("rad s-1", "frequency, contacts closed"),
    "bias_mean_square_displacement": ("1", "bias of mean square displacement"),
    "bias_mean_square_velocity": ("1", "bias of mean square velocity"),
}


def _bundled() -> Iterator[Integrator]:
    """Make one of each integrator that is defined, complete, and needs no arguments."""
    waiting = [Integrator]
    while waiting:
        cls = waiting.pop()
        waiting += cls.__subclasses__()
        variant = cls is not ExactFlow and cls.__module__ == ExactFlow.__module__  # which it turns into by itself
        if cls.step is not Integrator.step and not variant:
            try:
                yield cls()
            except InvalidInput:  # abstract, or a field without a default
                continue


def _steps(model: Model, integrator: Integrator, stiffening: Stiffening, until: float) -> tuple[float, float, str]:
    """Return largest and recommended step, or the reason why there is none."""
    try:
        check_method(model, integrator)
        model = _arranged(model, integrator, stiffening)
        recommended = choose_step(model, integrator, stiffening, None, end=until)
    except InvalidInput as error:
        return np.nan, np.nan, str(error)
    return integrator.largest_step(model, stiffening.links, stiffening.bodies), recommended, ""


def _arranged(model: Model, integrator: Integrator, stiffening: Stiffening) -> Model:
    return integrator.arrange(model, stiffening.links, stiffening.bodies)


def _contacts(model: Model, stiffening: Stiffening, known: np.ndarray) -> dict[str, Any]:
    """Return the variables of the contacts; NaN where the energy of a body is not known."""
    static = Stiffening.of(model, np.zeros_like(stiffening.energy), stiffening.times).penetration
    unknown = ~model.ends.all(known)
    inverse = model.ends.squares(1.0 / model.mass)
    tangent = np.where(unknown, np.nan, stiffening.contacts)
    with np.errstate(divide="ignore"):
        half_period = np.where(tangent == 0.0, np.nan, np.pi / np.sqrt(tangent * inverse))
    thermal = "contact", np.where(unknown, np.nan, stiffening.penetration - static)
    return {
        **({"thermal_penetration": thermal} if model.random.any() else {}),
        "static_penetration": ("contact", static),
        "tangent_stiffness": ("contact", tangent),
        "shortest_contact": ("contact", half_period),
    }


def _modes(
    model: Model, stiffening: Stiffening, integrator: Integrator, step: float, known: np.ndarray
) -> tuple[dict[str, Any], str]:
    """Return the variables of the modes, and why some are missing or not a number."""
    if not known.all():
        return {}, "No modes with closed contacts: the energy that a body brings into collisions is not known."
    linear = LinearizedNetwork.of(model, stiffening)
    frequencies, shapes = linear.modes()
    exact = linear.covariance()
    discrete = linear.discrete_covariance(integrator, step) if np.isfinite(step) else None
    note, biases = "", np.full((2, len(frequencies)), np.nan)
    if not model.noise.intensity.any():
        note = "No bias is predicted: no body is under white noise."
    elif model.kicks.states:
        note = "No bias is predicted: laws have states."
    elif model.kicks.timed.any():
        note = "No bias is predicted: laws depend on time."
    elif model.sources["intensity"].joining:
        note = "No bias is predicted: one white noise drives several bodies."
    elif exact is None:
        note = "No bias is predicted: the network with closed contacts has no stationary law."
    elif discrete is None and np.isfinite(step):
        note = f"No bias is predicted: the linear map of {type(integrator).__name__} is not known."
    elif discrete is None:
        note = f"No bias is predicted: {type(integrator).__name__} has no step."
    else:
        reached = _of_modes(exact, shapes, model.mass)
        weights = np.stack([frequencies**2, np.ones_like(frequencies)])
        moving = weights * reached > 1e-12 * (weights * reached).max()  # what noise does not reach is 0/0
        found = _of_modes(discrete, shapes, model.mass) if np.isfinite(discrete).all() else np.inf
        biases = np.where(moving, found / np.where(moving, reached, 1.0) - 1.0, np.nan)
    return {
        "closed_frequency": ("mode", frequencies),
        "bias_mean_square_displacement": ("mode", biases[0]),
        "bias_mean_square_velocity": ("mode", biases[1]),
    }, note


def _of_runs(model: Model, integrator: Integrator, stiffening: Stiffening, step: float) -> list[str]:
    """Say whether the motion is stationary, a run measures its step, and what wants every step of all bodies."""
    result = [WITHOUT_STEPS] if isinstance(integrator, ExactFlow) and not model.random.any() else []
    if model.kicks.timed.any():
        result.append("Laws depend on time: statistics are means over the time of a run, which begins at 0.")
    if growth := growth_of(model):
        result.append(f"{growth}.")
    if not model.bodies.free.all():
        result.append("Motions are given: statistics are means over the time of a run, which begins at 0.")
    if not isinstance(integrator, ExactFlow) or integrator.derived or not model.kicks.nonlinear.any():
        return result
    if integrator.measured and not certified(_arranged(model, integrator, stiffening), stiffening.penetration, step):
        result.append("The bias of the step is measured before a run, which may choose another.")
    if integrator.jumps and len(model.ends) and (reason := refusal_of_intervals(model)):
        result.append(f"Contact-free intervals are not crossed at once: {reason}.")
    if len(model.bodies) >= 2 * tuning().tile_bodies and (reason := refusals(model).get(Mode.TILES, "")):
        result.append(f"The network does not run in tiles: {reason}.")
    return result


def _of_modes(covariance: np.ndarray, shapes: np.ndarray, mass: np.ndarray) -> np.ndarray:
    """Mean squares of displacement and velocity of the modal coordinates ``φᵀ M x``, (2, mode)."""
    weights = shapes.T * mass
    count = len(mass)
    parts = covariance[:count, :count], covariance[count:, count:]
    return np.stack([((weights @ part) * weights).sum(axis=1) for part in parts])


def _table(data: xr.Dataset, dimension: str) -> list[str]:
    """Print the numbers along a dimension, one row per label."""
    names = [str(name) for name, item in data.data_vars.items() if item.dims == (dimension,) and "units" in item.attrs]
    columns = [["", dimension, *(str(label) for label in data[dimension].values)]]
    for name in names:
        attrs = data[name].attrs
        units = "" if attrs["units"] == "1" else f"({attrs['units']})"
        columns.append([attrs["long_name"], units, *(f"{value:.4g}" for value in data[name].values)])
    widths = [max(map(len, column)) for column in columns]
    rows = [
        "  ".join([row[0].ljust(widths[0]), *map(str.rjust, row[1:], widths[1:])]).rstrip()
        for row in zip(*columns, strict=True)
    ]
    half = ROWS_OF_TABLE // 2
    hidden = len(rows) - 2 - ROWS_OF_TABLE
    return rows if hidden <= 0 else [*rows[: 2 + half], f"… {hidden} more", *rows[-half:]]
