"""How realizations begin."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from impactlab.assembly.model import Model
from impactlab.components.component import finite, known_name, suggestion
from impactlab.errors import InvalidInput
from impactlab.kernels.random import addresses
from impactlab.linear.laws import correlated_systems, filter_labels, initial_variances, linear_variances
from impactlab.plan.subdomains import Tile
from impactlab.results.snapshot import places_of

WORDS = "stationary", "rest"
"""Starts that have a name."""

QUANTITIES, STATE, FILTER = ("displacement", "velocity"), "state", "filter_state"
"""What may be given of bodies at the start, of laws, and of filters of noise."""


@dataclass(frozen=True, eq=False)
class Start:
    """Where realizations begin."""

    state: str | np.ndarray
    """"stationary", "rest", or displacements and velocities, (2, body, realization), all alike where there is one."""
    streams: np.ndarray  # (3, body) addresses of a random start
    deviations: np.ndarray
    """Standard deviations of displacement and velocity that a stationary start is drawn with, (2, body)."""
    factors: tuple[tuple[np.ndarray, np.ndarray], ...]
    """The same of bodies that couplings or noises connect: their slots, and a root of the covariance of (x, v)."""
    rest: np.ndarray  # (body,) displacements of bodies that start at rest (m)
    laws: np.ndarray | None = None
    """States that laws begin with beside a given state, (state, realization) or (state, 1); None for their own."""
    filters: np.ndarray | None = None
    """The same of filters of noise, NaN for those that are drawn; None for all of them."""

    @classmethod
    def of(
        cls, model: Model, state: str | np.ndarray, residual: np.ndarray, rest: np.ndarray, temperature: np.ndarray,
        seed: tuple[int, int], laws: np.ndarray | None = None,
    ) -> Start:  # fmt: skip
        """Return the start that was asked for.

        `residual` is the stiffness of residual forces at the energies of the bodies (N m-1), `rest` are displacements
        under the static forces of contacts (m), and `temperature` is what is expected of bodies that nothing but
        contacts heats (J), NaN elsewhere, (body,) each.
        """
        drawn = model.bodies if isinstance(state, str) and state == "stationary" else ()
        return cls(
            state, addresses(seed, drawn, "start"), _deviations(model, residual, temperature),
            _factors(model, residual, temperature), rest, laws,
        )  # fmt: skip

    @property
    def given(self) -> bool:
        """Whether displacements and velocities are given."""
        return isinstance(self.state, np.ndarray)

    def restricted(self, tile: Tile) -> Start:
        """Return the start of a tile, whose state is that of the network at each call."""
        return replace(
            self, state=np.zeros((2, len(tile.bodies), 1)), streams=self.streams[:, :0],
            deviations=self.deviations[:, tile.bodies], factors=(), rest=self.rest[tile.bodies],
        )  # fmt: skip


def _deviations(model: Model, residual: np.ndarray, temperature: np.ndarray) -> np.ndarray:
    """Standard deviations under white noise alone, 0 for other bodies, (2, body).

    They are the linear ones, but a residual force that stiffens a body narrows its displacement. Bodies that nothing
    but contacts can heat start at the temperature that is expected of them, where it is known.
    """
    velocity = initial_variances(model)[1]
    velocity = np.where(np.isfinite(temperature), temperature / model.mass, velocity)
    with np.errstate(divide="ignore", invalid="ignore"):
        variances = np.stack([model.mass * velocity / (model.stiffness + residual), velocity])
    variances[~np.isfinite(variances)] = 0.0
    result: np.ndarray = np.sqrt(variances)
    return result


def start_of(initial: Any, model: Model) -> str | np.ndarray:
    """Return "stationary", "rest", or displacements and velocities (2, body, realization), (2, body, 1) if all alike.

    Other forms and unknown names are refused.
    """
    if initial is None or (isinstance(initial, str) and initial == "stationary"):
        variances, varying = linear_variances(model), model.time_varying or model.modulated
        return "stationary" if np.isfinite(variances).all() and not varying else "rest"
    if isinstance(initial, str) and initial == "rest":
        return "rest"
    if not isinstance(initial, Mapping) or set(initial) - {*QUANTITIES, STATE, FILTER}:
        raise InvalidInput(
            'initial must be "stationary", "rest" or {"displacement": {name: value}, "velocity": {name: value}}, '
            f"or a result that has il.FinalState() or the path of its file, not {initial!r}."
        )
    places, points = places_of(model.bodies), model.network.points
    state = np.zeros((2, len(model.bodies), realizations_of(initial)))
    for row, quantity in enumerate(QUANTITIES):
        values = _by_name(initial, quantity)
        for name, value in values.items():
            if name not in places and name not in points:
                known = (*model.bodies, *points)
                raise InvalidInput(f"initial: there is no oscillator {name!r}; {suggestion(name, known)}")
            if name in model.network.prescribed:
                raise InvalidInput(
                    f"initial {quantity} of {name!r} cannot be chosen: its motion is given by an il.PrescribedMotion; "
                    "leave it out."
                )
            numbers = _numbers(f"initial {quantity} of {name!r}", value)
            shares = model.network.displaced(name) if name in points else {name: 1.0}
            twice = [body for body in shares if name in points and body in values]
            if twice:
                raise InvalidInput(
                    f"initial {quantity} is given of the point {name!r} and of {twice[0]!r}, which moves it; give that "
                    "of points alone or of bodies alone."
                )
            for body, share in shares.items():
                state[row, places[body]] += share * numbers
    return state


def states_of(initial: Any, model: Model) -> np.ndarray | None:
    """Return the states that laws begin with, (state, realization), (state, 1) if all alike; None if none is given."""
    values = _by_name(initial, STATE) if isinstance(initial, Mapping) else {}
    if not values:
        return None
    labels = places_of([label for label, _ in model.states])
    states = np.repeat(model.members.states[:, None], realizations_of(initial), axis=1)
    for label, value in values.items():
        known_name("state of a law", label, labels)
        states[labels[label]] = _numbers(f"initial state {label!r}", value)
    return states


def filters_of(initial: Any, model: Model) -> np.ndarray | None:
    """Return the states that filters of noise begin with, as `states_of` those of laws; NaN for filters of others."""
    values = _by_name(initial, FILTER) if isinstance(initial, Mapping) else {}
    if not values:
        return None
    labels = places_of(filter_labels(model))
    result = np.full((len(labels), realizations_of(initial)), np.nan)
    own, given = (_by_filter(item) for item in (labels, values))
    for name in own:
        if own[name] == given.get(name):
            for label in own[name]:
                result[labels[label]] = _numbers(f"initial filter state {label!r}", values[label])
    return result


def _by_filter(labels: Iterable[str]) -> dict[str, set[str]]:
    """Return the states of each filter by its name."""
    result: dict[str, set[str]] = {}
    for label in labels:
        result.setdefault(label.rpartition(".")[0], set()).add(label)
    return result


def realizations_of(initial: Any) -> int:
    """Return how many realizations have a start of their own in given values; 1 where all begin alike."""
    if not isinstance(initial, Mapping):
        return 1
    groups = (values for values in initial.values() if isinstance(values, Mapping))
    sizes = {len(value) for values in groups for value in values.values() if _several(value)} - {0, 1}
    if len(sizes) > 1:
        raise InvalidInput(f"initial has values of {sorted(sizes)} realizations; give as many everywhere, or one.")
    return max(sizes, default=1)


def _by_name(initial: Mapping[str, Any], quantity: str) -> Mapping[str, Any]:
    values = initial.get(quantity, {})
    if not isinstance(values, Mapping):
        raise InvalidInput(f"initial {quantity} must be {{name: value}}, not {values!r}.")
    return values


def _several(value: Any) -> bool:
    """Whether a value is given for each realization."""
    return isinstance(value, list | tuple) or (isinstance(value, np.ndarray) and value.ndim == 1)


def _numbers(place: str, value: Any) -> np.ndarray:
    """Return one number, or those of all realizations."""
    numbers = [finite(place, item) for item in (value if _several(value) else (value,))]
    if not numbers:
        raise InvalidInput(f"{place} has no values.")
    return np.array(numbers)


def _factors(model: Model, residual: np.ndarray, temperature: np.ndarray) -> tuple[tuple[np.ndarray, np.ndarray], ...]:
    """Return slots of bodies that linear couplings or white noises connect, and a root of the covariance of (x, v).

    Residual forces narrow the law. What only contacts can heat has the `temperature` given for it (J), (body,).
    Without a stationary law the root is 0.
    """
    result = []
    for slots, system in correlated_systems(model):
        added = residual[slots]
        stiffer = replace(system, stiffness=system.stiffness + np.diag(added)) if added.any() else system
        cold = not system.damping.any() and not model.excited[slots].any()
        heat = float(np.median(temperature[slots]))
        covariance = stiffer.thermal_covariance(heat) if cold and math.isfinite(heat) else stiffer.covariance
        squares, shapes = np.linalg.eigh(np.zeros((2 * len(slots),) * 2) if covariance is None else covariance)
        result.append((slots, shapes * np.sqrt(np.maximum(squares, 0.0))))
    return tuple(result)
