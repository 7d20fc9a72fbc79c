"""Laws whose states follow displacements: links whose turning ends steps, and laws that are exact between turns."""

from __future__ import annotations

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from impactlab.assembly.incidence import runs
from impactlab.assembly.members import Kind
from impactlab.assembly.model import Model
from impactlab.components.component import Component
from impactlab.components.evaluation import ELAPSED, ERRORS, TIME, UPDATE
from impactlab.located.rows_of_couplings import weights

SCALES = 10.0 ** np.arange(-9.0, 2.0)
"""Sizes of motions at which the states of a law are looked at (m)."""

WAYS = 0.07, 0.6, -0.4
"""Ways from there, as parts of these sizes, which turn and do not."""

EXACT = 1e-13
"""Difference between states after a way and after its halves that is taken for rounding, as a part of the largest."""


class Turns(NamedTuple):
    """Links whose extensions turn, one for each law with states that follow them."""

    names: tuple[str, ...]
    links: np.ndarray  # (turn, body) weights in the extension
    contacts: np.ndarray  # (turn,) the contact whose law it is, -1 for none
    laws: np.ndarray
    """Number of the law of each state, (state,), from 1 on; negative if it follows exactly over short ways only; 0 if
    the law relaxes.
    """


def turns_of(model: Model) -> Turns:
    """Return the links of a network whose turning ends steps."""
    count = len(model.bodies)
    names: list[str] = []
    links, contacts, laws = [np.zeros((0, count))], [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    for kind, (leading, _) in zip(model.members.kinds, model.members.tables, strict=True):
        if not kind.states:
            continue
        owners = [(name, law) for name, law in _laws(model, kind) if type(law) is kind.component]
        relaxes = ELAPSED in kind.component.arguments(UPDATE)[0]
        follows = not relaxes and all(follows_exactly(law) for law in {law for _, law in owners})
        numbers = (len(names) + 1 + np.arange(len(leading))) * (0 if relaxes else 1 if follows else -1)
        starts = np.cumsum(runs(*leading.T)[-1])[:-1]  # states are run by run, one after the other
        laws += [np.tile(part, len(kind.states)) for part in np.split(numbers, starts)]
        if not relaxes:
            names += [name for name, _ in owners]
            links.append(_links(model, kind, leading))
            contacts.append(leading[:, 0] if kind.role == "force" else np.full(len(leading), -1))
    return Turns(tuple(names), np.concatenate(links), np.concatenate(contacts), np.concatenate(laws))


def _laws(model: Model, kind: Kind) -> Any:
    """Return names and laws of the family of a kind."""
    if kind.role == "force":
        return zip(model.contacts.names, model.contacts.laws, strict=True)
    if kind.role == "residual":
        return zip(model.bodies.names, model.bodies.oscillators, strict=True)
    return zip(model.couplings.names, model.couplings.laws, strict=True)


def _links(model: Model, kind: Kind, leading: np.ndarray) -> np.ndarray:
    """Return the weight of each body in the extension of each member of a kind."""
    if kind.role == "force":
        result: np.ndarray = weights(model.ends)[leading[:, 0]]
    elif kind.role == "combination":
        result = -weights(model.coupled)[leading[:, 0] - len(model.ends)]
    else:
        unit = np.eye(len(model.bodies) + 1)[:, :-1]  # the wall is behind the bodies
        result = unit[leading[:, 0]] if kind.role == "residual" else unit[leading[:, 1]] - unit[leading[:, 0]]
    return result


@cache
def follows_exactly(law: Component) -> bool:
    """Whether the states of a law after a way are those after its halves, to rounding, at motions of all sizes."""
    try:
        both = np.array([_after_halves(law, size, way) for size in SCALES.tolist() for way in WAYS])
    except ERRORS:
        return False
    apart, largest = np.abs(both[:, 0] - both[:, 1]), np.abs(both).max(axis=(0, 1))
    return bool((apart <= EXACT * largest).all())


def _after_halves(law: Component, size: float, way: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the states of a law after a way, and after its halves, from a place where its extension has turned."""
    states, rate = tuple(getattr(law, name) for name in law.state_names()), math.copysign(size, way)
    for place in (0.4, 1.3, 0.5):
        states = _updated(law, place * size, size, states)
    half = _updated(law, (0.5 + 0.5 * way) * size, 1.1 * rate, states)
    return tuple(_updated(law, (0.5 + way) * size, rate, begin) for begin in (states, half))  # type: ignore[return-value]


def _updated(law: Component, place: float, rate: float, states: tuple[float, ...]) -> tuple[float, ...]:
    """Return the states of a law at a place."""
    kinematic, fields = law.arguments(UPDATE)
    known = dict.fromkeys(("extension", "indentation", "displacement"), place)
    known |= {"rate": rate, "velocity": rate, TIME: 0.0} | dict(zip(law.state_names(), states, strict=True))
    update: Any = getattr(law, UPDATE)
    new = update(*(known[name] if name in known else getattr(law, name) for name in (*kinematic, *fields)))
    return (new,) if len(states) == 1 else tuple(new)
