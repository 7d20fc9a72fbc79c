"""Limit states: levels of displacements, sums of displacements, and contact forces that count as failure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from numbers import Real
from typing import Any, NamedTuple

import numpy as np

from impactlab.assembly.model import Model
from impactlab.components.component import finite, known_name, positive, suggestion
from impactlab.errors import InvalidInput
from impactlab.simulation.recorded_runs import Form

EXAMPLE = '{"tower": 0.1, "gap": 500.0, "drift": ({"upper": 1.0, "lower": -1.0}, [0.02, 0.04])}'


class Demand(NamedTuple):
    """What a motion demands of a network, by its largest size: a sum of displacements, or the force of a contact."""

    name: str
    form: Form
    units: str
    levels: tuple[float, ...]  # of its limit states, from the lowest to the highest


def demands_of(limit: Any, model: Model) -> tuple[Demand, ...]:
    """Return the demands that a user gives with their limits, or refuse them by name."""
    if not isinstance(limit, Mapping) or not limit:
        raise InvalidInput(f"limit is made of limits by name, such as {EXAMPLE}, not {limit!r}.")
    result = []
    for name, given in limit.items():
        if not isinstance(name, str):
            raise InvalidInput(f"limit: {name!r} is no name; write {EXAMPLE}.")
        is_form = isinstance(given, list | tuple) and len(given) == 2 and not isinstance(given[0], Real)
        of, levels = given if is_form else (name, given)
        form = _form(f"limit of {name!r}", of, model)
        result.append(Demand(name, form, "N" if form.of_contact else "m", _levels(name, levels)))
    return tuple(result)


def _levels(name: str, given: Any) -> tuple[float, ...]:
    several = isinstance(given, Sequence | np.ndarray) and not isinstance(given, str)
    levels = [positive(f"limit of {name!r}", item, "") for item in (given if several else [given])]
    if not levels or sorted(set(levels)) != levels:
        raise InvalidInput(f"limit of {name!r} must be a level or increasing levels, not {given!r}.")
    return tuple(levels)


def _form(place: str, of: Any, model: Model) -> Form:
    """Return the force of a contact, or a sum of displacements: a name, a quantity with a name, or weights by names."""
    points, contacts = dict(model.points), model.contacts.names
    places = {name: ((slot, 1.0),) for slot, name in enumerate(model.bodies.names)} | points
    if isinstance(of, str):
        if of in places and of in contacts:
            raise InvalidInput(
                f"{place}: {of!r} is a body and a contact; write (('displacement', {of!r}), level) or "
                f"(('contact_force', {of!r}), level)."
            )
        of = ("contact_force" if of in contacts else "displacement", of)
    if isinstance(of, list | tuple) and len(of) == 2 and all(isinstance(item, str) for item in of):
        known_name(f"quantity of a limit, {place}:", of[0], ("displacement", "contact_force"))
        if of[0] == "contact_force":
            return _force(place, of[1], model)
        of = {of[1]: 1.0}
    if not isinstance(of, Mapping) or not of:
        raise InvalidInput(f"{place}: give weights of displacements by name, or a name with a quantity, not {of!r}.")
    weights: dict[int, float] = {}
    for name, weight in of.items():
        if name not in places:
            known = suggestion(str(name), (*places, *contacts))
            raise InvalidInput(f"{place}: there is no oscillator {name!r}; {known}")
        for slot, share in places[name]:
            weights[slot] = weights.get(slot, 0.0) + share * finite(f"{place}: weight of {name!r}", weight)
    if not any(weights.values()):
        raise InvalidInput(f"{place} has no weight other than 0.")
    return Form(weights, False)


def _force(place: str, name: str, model: Model) -> Form:
    known_name("contact", name, model.contacts.names)
    slot = model.contacts.names.index(name)
    if model.contacts.impulsive[slot]:
        law = type(model.contacts.laws[slot]).__name__
        raise InvalidInput(f"{place}: {name!r} is a {law}, whose impacts have an impulse but no force.")
    return Form({slot: 1.0}, True)
