"""Linear forms of displacements, velocities and contact forces, of which records keep statistics."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from impactlab.assembly.model import Model
from impactlab.errors import InvalidInput
from impactlab.inputs import finite, known_name, suggestion
from impactlab.results.labels import Labelled
from impactlab.results.snapshot import QUANTITIES, Snapshot, places_of

EXAMPLE = 'of={"drift": {"upper": 1.0, "lower": -1.0}, "speed": ("velocity", "upper")}'

Term = tuple[str, str, float]
"""Quantity, "" where it follows from the name; name of a body, a point or a contact; weight."""


class Form(NamedTuple):
    """A weighted sum of displacements, velocities and contact forces."""

    name: str
    terms: tuple[Term, ...]

    def __repr__(self) -> str:
        return tuple.__repr__(self)  # of which a record can be made again

    @property
    def quantities(self) -> set[str]:
        """The quantities of the terms."""
        return {quantity for quantity, _, _ in self.terms}

    @property
    def smooth(self) -> bool:
        """Whether it is one of displacements, whose velocities tell its slope."""
        return self.quantities == {"displacement"}

    @property
    def units(self) -> str:
        """The units, where all terms have the same."""
        found = {QUANTITIES[quantity].units for quantity in self.quantities}
        return found.pop() if len(found) == 1 else ""


Forms = tuple[Form, ...]
"""The forms of a record."""


def forms_given(place: str, given: Any) -> Forms | None:
    """Return linear forms as a user writes them, or a file has them; None for those of all bodies and contacts."""
    if given is None:
        return None
    if isinstance(given, str) or _is_pair(given):
        given = [given]
    if isinstance(given, Mapping):
        forms = [Form(str(name), _terms(f"{place} of {name!r}", form)) for name, form in given.items()]
    elif isinstance(given, Sequence):
        forms = [_form(place, item) for item in given]
    else:
        raise InvalidInput(f"{place} must be linear forms by name, such as {EXAMPLE}, not {given!r}.")
    if not forms:
        raise InvalidInput(f"{place} is empty; give linear forms by name, such as {EXAMPLE}, or leave it out.")
    for name, number in Counter(form.name for form in forms).items():
        if number > 1:
            raise InvalidInput(f"{place}: {name!r} is given twice.")
    return tuple(forms)


def _is_pair(item: Any) -> bool:
    """Whether something is a quantity with a name."""
    pair = isinstance(item, list | tuple) and len(item) == 2 and all(isinstance(part, str) for part in item)
    return pair and item[0] in QUANTITIES


def _form(place: str, item: Any) -> Form:
    """Return one of a sequence: a name, a quantity with a name, or a form of a file."""
    if isinstance(item, list | tuple) and len(item) == 2 and isinstance(item[1], list | tuple):
        name, terms = item
        return Form(str(name), tuple((str(quantity), str(of), float(weight)) for quantity, of, weight in terms))
    ((quantity, name, weight),) = _terms(place, item)
    return Form(f"{quantity} of {name}" if quantity else name, ((quantity, name, weight),))


def _terms(place: str, form: Any) -> tuple[Term, ...]:
    """Return the terms of a form: a name, a quantity with a name, or weights by these."""
    if isinstance(form, str) or _is_pair(form):
        form = {form if isinstance(form, str) else tuple(form): 1.0}
    if not (isinstance(form, Mapping) and form):
        raise InvalidInput(f"{place} must be a name, a quantity with a name, or weights by these, not {form!r}.")
    terms = []
    for item, weight in form.items():
        if not (isinstance(item, str) or _is_pair(item)):
            raise InvalidInput(
                f"{place}: {item!r} is neither a name nor a quantity with a name such as ('velocity', 'upper'); "
                f"quantities are {', '.join(map(repr, QUANTITIES))}."
            )
        quantity, name = ("", item) if isinstance(item, str) else item
        terms.append((quantity, name, finite(f"{place}, weight of {item!r}", weight)))
    if not any(weight for _, _, weight in terms):
        raise InvalidInput(f"{place} has no weight other than 0.")
    return tuple(terms)


def resolved_forms(place: str, given: Forms | None, model: Model) -> Forms:
    """Return forms with the quantities of all terms, by default of all bodies and contacts; refuse unknown names."""
    bodies, contacts = dict.fromkeys((*model.bodies.names, *model.network.points)), places_of(model.contacts.names)
    if given is None:
        soft = [name for name, slot in contacts.items() if not model.contacts.impulsive[slot]]
        of_contacts = [(name if name not in bodies else f"force of {name}", ("contact_force", name)) for name in soft]
        of_bodies = [(name, ("displacement", name)) for name in model.bodies.names]
        given = forms_given(place, dict([*of_bodies, *of_contacts]))
    assert given is not None
    result = []
    for form in given:
        terms = tuple((_quantity(place, *term[:2], bodies, contacts), *term[1:]) for term in form.terms)
        result.append(form._replace(terms=terms))
        for quantity, name, _ in terms:
            if quantity == "contact_force" and model.contacts.impulsive[contacts[name]]:
                law = type(model.contacts.laws[contacts[name]]).__name__
                raise InvalidInput(f"{place}: {name!r} is a {law}: its impacts have an impulse, but no force.")
    return tuple(result)


def _quantity(place: str, quantity: str, name: str, bodies: Mapping[str, Any], contacts: Mapping[str, Any]) -> str:
    """Return the quantity of a term, or refuse its name."""
    if not quantity:
        if name in bodies and name in contacts:
            raise InvalidInput(
                f"{place}: {name!r} is a body and a contact; write ('displacement', {name!r}) or "
                f"('contact_force', {name!r})."
            )
        if name not in bodies and name not in contacts:
            known = suggestion(name, (*bodies, *contacts))
            raise InvalidInput(f"{place}: there is no oscillator or contact {name!r}; {known}")
        return "displacement" if name in bodies else "contact_force"
    of_contacts = quantity == "contact_force"
    known_name("contact" if of_contacts else "oscillator", name, contacts if of_contacts else bodies)
    return quantity


def names_of_forms(dimension: str, forms: Forms) -> Labelled:
    """Return the names of forms along a dimension, with the units where these differ."""
    text = "; ".join(f"{form.name}: {_described(form)}" for form in forms)
    return (dimension,), np.array([form.name for form in forms]), {"long_name": "linear form", "comment": text}


def _described(form: Form) -> str:
    """Return a form in words."""
    terms = (f"{weight:g} × {quantity.replace('_', ' ')} of {name}" for quantity, name, weight in form.terms)
    return f"{' + '.join(terms)} ({form.units or 'mixed units'})"


def units_of(forms: Forms) -> str:
    """Return the units that all forms have, "" where they differ."""
    found = {form.units for form in forms}
    return found.pop() if len(found) == 1 else ""


class RowsOfForm(NamedTuple):
    """Rows of snapshots that a form is a sum of."""

    rows: np.ndarray
    weights: np.ndarray

    @classmethod
    def of_all(cls, forms: Sequence[Form], snapshot: Snapshot, quantity: str = "") -> list[RowsOfForm]:
        """Return the rows of each form, or those of another quantity of the same names."""
        points, known, result = dict(snapshot.points), dict[str, dict[str, int]](), []
        for form in forms:
            found = []
            for own, name, weight in form.terms:
                wanted = quantity or own
                first = snapshot.place(wanted).start
                if own != "contact_force" and name in points:
                    found += [(first + slot, weight * share) for slot, share in points[name]]
                    continue
                if wanted not in known:
                    known[wanted] = places_of(snapshot.names(wanted))
                found.append((first + known[wanted][name], weight))
            rows, weights = zip(*found, strict=True)
            result.append(cls(np.array(rows, dtype=np.int64), np.array(weights)))
        return result


def joined_rows(items: Sequence[RowsOfForm]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return where the entries of each item begin, and the rows and weights of all; see `sum_rows`."""
    begins = np.cumsum([0, *(len(item.rows) for item in items)])
    return begins, np.concatenate([item.rows for item in items]), np.concatenate([item.weights for item in items])
