"""Limit states: levels of displacements, sums of displacements, and contact forces that count as failure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from numbers import Real
from typing import Any, NamedTuple

import numpy as np

from impactlab.assembly.model import Model
from impactlab.errors import InvalidInput
from impactlab.inputs import positive
from impactlab.records.linear_forms import forms_given, resolved_forms
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
        form = _form(name, of, model)
        result.append(Demand(name, form, "N" if form.of_contact else "m", _levels(name, levels)))
    return tuple(result)


def _levels(name: str, given: Any) -> tuple[float, ...]:
    several = isinstance(given, Sequence | np.ndarray) and not isinstance(given, str)
    levels = [positive(f"limit of {name!r}", item, "") for item in (given if several else [given])]
    if not levels or sorted(set(levels)) != levels:
        raise InvalidInput(f"limit of {name!r} must be a level or increasing levels, not {given!r}.")
    return tuple(levels)


def _form(name: str, of: Any, model: Model) -> Form:
    """Return the force of a contact, or a sum of displacements: a name, a quantity with a name, or weights by names."""
    place = f"limit of {name!r}"
    (form,) = resolved_forms(place, forms_given("limit", {name: of}), model)
    weights: dict[int, float] = {}
    if form.quantities == {"contact_force"} and [weight for *_, weight in form.terms] == [1.0]:
        return Form({model.contacts.names.index(form.terms[0][1]): 1.0}, True)
    if form.quantities != {"displacement"}:
        raise InvalidInput(f"{place} must be one contact force or a sum of displacements, not {of!r}.")
    places = {name: ((slot, 1.0),) for slot, name in enumerate(model.bodies.names)} | dict(model.points)
    for _, term, weight in form.terms:
        for slot, share in places[term]:
            weights[slot] = weights.get(slot, 0.0) + share * weight
    return Form(weights, False)
