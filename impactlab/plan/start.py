"""How realizations begin."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from impactlab.assembly.mechanism import state_labels, with_given_motions
from impactlab.assembly.model import Model
from impactlab.errors import InvalidInput
from impactlab.inputs import finite, known_name, suggestion
from impactlab.kernels.random import addresses
from impactlab.linear.large_matrices import eigh
from impactlab.linear.laws import correlated_systems, initial_variances, linear_variances
from impactlab.plan.subdomains import Tile
from impactlab.results.snapshot import places_of

WORDS = "stationary", "rest"
"""Starts that have a name."""

RULING = 10.0
"""Tangent stiffness of couplings, in that of the body itself, from which on a start does not follow the linear law."""

QUANTITIES, STATE, FILTER = ("displacement", "velocity"), "state", "filter_state"
"""Names in `initial` of the quantities of bodies, of states of laws, and of states of filters."""


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
    known: np.ndarray | None = None
    """Displacements that are known beforehand, (body,) or (body, realization): given, or of bodies of given motion."""
    continuation: np.ndarray | None = None
    """Numbers from which realizations continue an earlier run, (number, realization); None where they begin."""

    @classmethod
    def of(
        cls, model: Model, state: str | np.ndarray, stiffness: tuple[np.ndarray, np.ndarray], rest: np.ndarray,
        temperature: np.ndarray, seed: tuple[int, int], initial: Any, begin: float,
    ) -> Start:  # fmt: skip
        """Return the start that was asked for, at a time `begin` (s).

        `stiffness` is that of couplings, (coupling,), and of residual forces, (body,), at the energies of the bodies
        (N m-1), `rest` are displacements under the static forces of contacts (m), and `temperature` is what is expected
        of bodies that nothing but contacts heats (J), NaN elsewhere, (body,) each.
        """
        drawn = model.bodies.names if isinstance(state, str) and state == "stationary" else ()
        couplings, bodies = stiffness
        residual = _stiffness_at_start(model, couplings, bodies) if len(couplings) else bodies
        known = state[0] if isinstance(state, np.ndarray) else None
        if known is None and state == "rest" and not model.bodies.free.all():
            known = with_given_motions(model, rest, begin)
        return cls(
            state, addresses(seed, drawn, "start"), _deviations(model, residual, temperature),
            _factors(model, residual, temperature), rest, states_of(initial, model), filters_of(initial, model), known,
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


def _stiffness_at_start(model: Model, couplings: np.ndarray, bodies: np.ndarray) -> np.ndarray:
    """Return the stiffness of residual forces, and of nonlinear couplings that rule a body, (body,) (N m-1).

    At displacements of the linear law such couplings would hold many times the energy of the body, which no step that
    is made for this energy could follow.
    """
    links, added = model.coupled, np.zeros(len(model.mass) + 1)
    stiffness = np.maximum(couplings - model.couplings.linear[0], 0.0)
    np.add.at(added, links.slots, links.weights**2 * stiffness[links.rows])
    own = model.stiffness + bodies
    rules = np.isfinite(added[:-1]) & (added[:-1] > RULING * own)
    return bodies + np.where(rules, added[:-1], 0.0)


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
        variances, varying = linear_variances(model), model.noise.varying or bool(model.members.of_role("modulation"))
        return "stationary" if np.isfinite(variances).all() and not varying else "rest"
    if isinstance(initial, str) and initial == "rest":
        return "rest"
    quantities = *QUANTITIES, STATE, FILTER
    if isinstance(initial, Mapping) and (unknown := [item for item in initial if item not in quantities]):
        raise InvalidInput(f"initial: there is no quantity {unknown[0]!r}; {suggestion(str(unknown[0]), quantities)}")
    if not isinstance(initial, Mapping):
        raise InvalidInput(
            'initial must be "stationary", "rest" or {"displacement": {name: value}, "velocity": {name: value}}, '
            f"or a result that has il.FinalState() or the path of its file, not {initial!r}."
        )
    places, points = places_of(model.bodies.names), model.network.points
    state = np.zeros((2, len(model.bodies), realizations_of(initial)))
    for row, quantity in enumerate(QUANTITIES):
        values = _by_name(initial, quantity)
        for name, value in values.items():
            if name not in places and name not in points:
                known = (*model.bodies.names, *points)
                raise InvalidInput(f"initial: there is no oscillator {name!r}; {suggestion(name, known)}")
            if name in places and model.network.oscillators[name].moves_as_given:
                raise InvalidInput(
                    f"initial {quantity} of {name!r} cannot be chosen: its motion is given; leave it out."
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
    labels = places_of([label for label, _ in model.kicks.states])
    states = np.repeat(model.members.states[:, None], realizations_of(initial), axis=1)
    for label, value in values.items():
        known_name("state of a law", label, labels)
        states[labels[label]] = _numbers(f"initial state {label!r}", value)
    return states


def filters_of(initial: Any, model: Model) -> np.ndarray | None:
    """Return the initial states of filters of noise, as `states_of` does for laws; NaN for filters without one."""
    values = _by_name(initial, FILTER) if isinstance(initial, Mapping) else {}
    if not values:
        return None
    labels = places_of(state_labels(model))
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
        cold = not system.damping.any() and not model.bodies.excited[slots].any()
        heat = float(np.median(temperature[slots]))
        covariance = stiffer.thermal_covariance(heat) if cold and math.isfinite(heat) else stiffer.covariance
        squares, shapes = eigh(np.zeros((2 * len(slots),) * 2) if covariance is None else covariance)
        result.append((slots, shapes * np.sqrt(np.maximum(squares, 0.0))))
    return tuple(result)
