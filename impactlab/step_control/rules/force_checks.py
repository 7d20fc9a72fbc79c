"""Forces of contacts, couplings and bodies, looked at before anything is computed with them: they must be finite."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from impactlab.assembly.model import Model
from impactlab.assembly.remembered import keep, kept
from impactlab.components.component import Component
from impactlab.components.evaluation import call_each, distinct, of_classes
from impactlab.errors import InvalidInput
from impactlab.linear.laws import spread
from impactlab.step_control.rules.tangent_stiffness import Stiffening, moments

LARGEST = 1e100
"""Size (m, m s-1, N) from which a number counts as infinite: its square and a sum of those must be finite."""

BEYOND = 1.001
"""Indentation that is looked at, in those that the scene certainly reaches: a law may end just there."""

PLACES = 64
"""Most places at which a force is looked at."""

VALUES = 20_000
"""Most values of all forces of a network that are looked at: a few of each force where there are many."""

NETWORKS_TOGETHER = 64
"""Networks whose forces are checked together; if one has to be refused, each is checked alone."""

AT_REST = np.array([0.0, -1.0, 1.0])
"""Extensions and displacements, in lengths of the network, at which forces are checked that must be finite at 0."""

EXPLAINED_TO = 100.0
"""Displacement up to which forces are examined after a run has diverged, in units of a length of the network."""

EXPLAINED_PLACES = 1000
"""Number of displacements at which forces are then examined."""


class _Force(NamedTuple):
    """A force to be checked: its owner, its arguments, and the places and rates at which it is evaluated."""

    what: str
    component: Component
    kernel: str
    of: str
    scale: float
    rate: float

    def says(self, value: float, place: float, rate: float) -> str:
        at_rate = f" and a {_RATES[self.of]} of {rate:.4g} m/s" if rate else ""
        return (
            f"The force of {self.what}, {self.component!r}, is {value:.4g} N at {_ARTICLES[self.of]} {self.of} of "
            f"{place:.4g} m{at_rate}"
        )


_ARTICLES = {"indentation": "an", "extension": "an", "displacement": "a"}
_RATES = {"indentation": "rate", "extension": "rate", "displacement": "velocity"}


@kept
def stiffening_of(model: Model, energy: np.ndarray, times: np.ndarray) -> Stiffening:
    """Return the stiffness added by forces at given energies of the bodies, looked at at some times (s).

    Refuse forces as `check_forces` does.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # of forces that are not finite, which is said in words
        stiffening = Stiffening.of(model, energy, times)
    check_forces(model, stiffening.penetration, energy)
    return stiffening


def look_at_all(models: Sequence[Model], energies: Sequence[np.ndarray]) -> None:
    """Evaluate `stiffening_of` for several models in one pass and store the results in its cache.

    Nothing is refused here: models among which forces are doubtful are evaluated one by one later, and so are laws that
    depend on time.
    """
    scenes = [scene for scene in zip(models, energies, strict=True) if not scene[0].kicks.timed.any()]
    with np.errstate(over="ignore", invalid="ignore"):
        found = Stiffening.of_each(*zip(*scenes, strict=True)) if scenes else []
    whole = [(*scene, stiffening) for scene, stiffening in zip(scenes, found, strict=True)]
    for begin in range(0, len(whole), NETWORKS_TOGETHER):
        some = whole[begin : begin + NETWORKS_TOGETHER]
        for model, energy, stiffening in some if _all_in_order(some) else ():
            keep(stiffening_of, model, energy, moments(model, 0.0, 0.0), value=stiffening)


def _all_in_order(scenes: Sequence[tuple[Model, np.ndarray, Stiffening]]) -> bool:
    """Whether `check_forces` accepts all scenes; their forces are evaluated together."""
    each = [_looked_at(model, stiffening.penetration, energy) for model, energy, stiffening in scenes]
    if any(len(contacts) > VALUES // PLACES for contacts, _ in each):
        return False
    contacts, others = (
        list({force[1:]: force for of_model in all_ for force in of_model}.values()) for all_ in zip(*each, strict=True)
    )
    try:
        _check(contacts, np.linspace(0.0, 1.0, PLACES), everywhere=True)
        _check(others, AT_REST, everywhere=False)
    except InvalidInput:
        return False
    return True


def check_forces(model: Model, penetration: np.ndarray, energy: np.ndarray) -> None:
    """Refuse forces that are not finite where they certainly act, or not the same each time, by law, place and value.

    Forces of contacts are looked at from 0 to the penetration (m), thermal and static, where they have stored the
    energy that a body brings (J), at rest and at the speeds that this energy gives; those of couplings and residual
    forces must be finite at 0. Equal laws are looked at once.
    """
    contacts, others = _looked_at(model, penetration, energy)
    places = max(4, min(PLACES, VALUES // max(1, len(contacts))))
    _check(contacts, np.linspace(0.0, 1.0, places), everywhere=True)
    _check(others, AT_REST, everywhere=False)


def _looked_at(model: Model, penetration: np.ndarray, energy: np.ndarray) -> tuple[list[_Force], list[_Force]]:
    """Return forces of contacts, and others."""
    speed = np.sqrt(2.0 * energy[model.first_of(model.ends)] * model.ends.squares(1.0 / model.mass))
    contacts = _contacts(model, BEYOND * penetration, np.where(np.isfinite(speed), speed, 0.0))
    return contacts, _others(model) if len(model.coupled) or model.bodies.residual.any() else []


def explanation(model: Model, length: np.ndarray) -> str:
    """Say which force is not finite at a place that a run which diverged may have reached; nothing if none is.

    `length` is one of the motion at each contact (m).
    """
    grid = np.linspace(0.0, EXPLAINED_TO, EXPLAINED_PLACES)
    contacts = _contacts(model, length, np.zeros_like(length))
    others = _others(model) if len(model.coupled) or model.bodies.residual.any() else []
    for forces, places in ((contacts, grid), (others, np.append(grid, -grid))):
        some = forces[: VALUES // EXPLAINED_PLACES]
        if not some:
            continue
        place = np.array([force.scale for force in some])[:, None] * places
        try:
            values = _values(some, place, np.zeros_like(place))
        except InvalidInput as error:  # it fails in Python
            return f" {error}"
        wrong = ~np.isfinite(values)
        if wrong.any():
            at = _place(np.where(wrong, -np.abs(place), -np.inf))
            return f" {some[at[0]].says(values[at], place[at], 0.0)}."
    return ""


def _check(forces: Sequence[_Force], places: np.ndarray, everywhere: bool) -> None:
    """Refuse forces that are not finite at the first place, or everywhere."""
    if not forces:
        return
    place = np.array([force.scale for force in forces])[:, None] * places
    of_rates = np.array([0.0, 1.0, -1.0] if any(force.rate for force in forces) else [0.0])
    rate = np.array([force.rate for force in forces])[:, None, None] * of_rates[:, None]
    place, rate = (np.asarray(item).reshape(len(forces), -1) for item in np.broadcast_arrays(place[:, None], rate))
    values = _values(forces, place, rate)
    wrong = ~(np.abs(values) < LARGEST) & (everywhere | (place == 0.0))
    if wrong.any():
        at = _place(wrong)
        raise InvalidInput(
            f"{forces[at[0]].says(values[at], place[at], rate[at])}, which this network reaches: a force must be "
            "finite from 0 on."
        )


def _place(table: np.ndarray) -> tuple[int, int]:
    """Row and column of the first of the largest entries."""
    row, column = divmod(int(table.argmax()), table.shape[1])
    return row, column


def _values(forces: Sequence[_Force], place: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """Forces at the places of each, (force, place)."""
    result = np.empty_like(place)
    for kernel in {force.kernel for force in forces}:
        rows = [row for row, force in enumerate(forces) if force.kernel == kernel]
        result[rows] = call_each([forces[row].component for row in rows], kernel, place[rows], rate[rows])
    return result


def _contacts(model: Model, length: np.ndarray, speed: np.ndarray) -> list[_Force]:
    """Return one force for each law, length and speed that there is."""
    contacts = model.contacts
    speed = speed * np.array(of_classes(lambda kind: "rate" in kind.kernel("force")[1], contacts.laws), dtype=bool)
    return _unique("contact", "force", "indentation", contacts.names, contacts.laws, length, speed)


def _others(model: Model) -> list[_Force]:
    """Return the forces of couplings, then those of bodies, at rest."""
    length = spread(model)[0]
    length = np.where(np.isfinite(length), length, 1.0)  # 1 m where the deviation without contacts is not known
    extensions = model.coupled.largest(length)
    bent = np.flatnonzero(model.bodies.residual)
    names = [model.bodies.names[slot] for slot in bent.tolist()]
    bodies = [model.bodies.oscillators[slot] for slot in bent.tolist()]
    return [
        *_unique("coupling", "force", "extension", model.couplings.names, model.couplings.laws, extensions),
        *_unique("body", "residual", "displacement", names, bodies, length[bent]),
    ]


def _unique(
    what: str, kernel: str, of: str, names: Sequence[str], members: Sequence[Any], scale: np.ndarray,
    rate: np.ndarray | None = None,
) -> list[_Force]:  # fmt: skip
    """Return the forces of members at their scales and rates, 0 if none are given, but those that are equal once."""
    rate = np.zeros_like(scale) if rate is None else rate
    return [
        _Force(f"{what} {names[row]!r}", members[row], kernel, of, float(scale[row]), float(rate[row]))
        for row in distinct(members, [scale, rate])[0].tolist()
    ]
