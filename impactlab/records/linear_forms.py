"""Linear forms of displacements, velocities and contact forces, of which records keep statistics."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from impactlab.assembly.model import Model
from impactlab.components.component import finite, known_name, suggestion
from impactlab.errors import InvalidInput
from impactlab.kernels.turning_points import between_cubics, between_parabolas, sum_rows
from impactlab.linear.laws import coupled_systems
from impactlab.plan.plan import Plan
from impactlab.results.labels import Labelled
from impactlab.results.snapshot import QUANTITIES, Snapshot, places_of

EXAMPLE = 'of={"drift": {"upper": 1.0, "lower": -1.0}, "speed": ("velocity", "upper")}'

RAISED = 0.5826
"""How much higher the top of a Brownian path is than its highest sample, in root mean squares of a step (M. Broadie,
P. Glasserman and S. Kou, Math. Finance 7, 1997, 325)."""

SMOOTH_STEPS, ROUGH_STEPS = 0.25, 0.05
"""Step times the fastest rate of linear motion: Hermite's cubic of displacements is then 1e-5 off, and the largest
velocities, where noise makes them rough, 0.1 %."""

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

    def write(self, snapshots: np.ndarray, result: np.ndarray, scale: float = 1.0) -> None:
        """Write the form times a scale from snapshots [sample, row, lane], [sample, lane]."""
        sum_rows(snapshots, self.rows, self.weights, scale, result)


def jumps_by_noise(forms: Sequence[RowsOfForm], plan: Plan) -> np.ndarray:
    """Return by how much white noise changes each form in a step, root mean square, through the velocities in it."""
    noise, place = plan.noise, plan.snapshot.place("velocity")
    pushes = noise.amplitude[:, 1]  # (phase, row)
    if not plan.method.integrator.kicks:  # rows are forces
        pushes = pushes * plan.clock.step / plan.system.linear[0][noise.rows]
    which = noise.distinct[1]
    which = which if len(which) else np.arange(len(noise.rows))
    order = np.argsort(noise.rows, kind="stable")
    begin = np.searchsorted(noise.rows[order], np.arange(len(plan.system.bodies) + 1))
    result = np.zeros(len(forms))
    for number, (rows, weights) in enumerate(forms):
        own = (rows >= place.start) & (rows < place.stop)
        slots, weights = rows[own] - place.start, weights[own]
        pushed = [order[begin[slot] : begin[slot + 1]] for slot in slots.tolist()]
        if any(map(len, pushed)):
            along = pushes[:, np.concatenate(pushed)] * np.repeat(weights, [len(item) for item in pushed])
            streams, normal = np.unique(which[np.concatenate(pushed)], return_inverse=True)
            normals = np.zeros((len(along), len(streams)))
            np.add.at(normals.T, normal, along.T)
            result[number] = np.sqrt((normals**2).sum(axis=1).mean())
    return result


def longest_step(forms: Forms, model: Model) -> float:
    """Return the longest step between which paths of forms are told well where any step is exact (s)."""
    rates = np.concatenate([np.sqrt(model.stiffness / model.mass), model.damping / model.mass])
    fastest = max([float(rates.max()), *(max(system.scales) for _, system in coupled_systems(model))])
    share = SMOOTH_STEPS if all(form.smooth for form in forms) else ROUGH_STEPS
    return share / fastest if fastest > 0.0 else math.inf


class PathsOfForms:
    """What forms do between the samples of a block of realizations.

    Between steps displacements follow Hermite's cubic of the displacements and velocities at both ends; where an
    impulsive contact has hit, the tangents. Forms with velocities or forces turn at the top of a parabola, or at a step
    where white noise makes them rough.

    Parameters
    ----------
    forms : tuple of Form
    plan : Plan
    """

    def __init__(self, forms: Forms, plan: Plan) -> None:
        self.rows, self.step = RowsOfForm.of_all(forms, plan.snapshot), plan.clock.step
        slopes = iter(RowsOfForm.of_all([form for form in forms if form.smooth], plan.snapshot, "velocity"))
        self.slopes = [next(slopes) if form.smooth else None for form in forms]
        self.jumps = jumps_by_noise(self.rows, plan)
        self.pushed = ["contact_force" in form.quantities for form in forms]
        self.hits = plan.snapshot.impulsive_rows
        self.before = np.zeros((0, 0, 0, 0))

    def start(self, values: np.ndarray) -> None:
        """Begin with the snapshot at t = 0, [row, lane]."""
        self.before = self._with_slopes(np.stack([values, values]))

    def _with_slopes(self, snapshots: np.ndarray, before: int = 0) -> np.ndarray:
        """Return values and slopes times the step, [2, form, sample, lane], with room for some samples before."""
        samples, _, lanes = snapshots.shape
        both = np.empty((2, len(self.rows), before + samples, lanes))
        for form, (rows, slopes) in enumerate(zip(self.rows, self.slopes, strict=True)):
            rows.write(snapshots, both[0, form, before:])
            if slopes is not None:
                slopes.write(snapshots, both[1, form, before:], self.step)
        return both

    def next(self, snapshots: np.ndarray) -> np.ndarray:
        """Return what forms do from the last snapshot on, [form, 1 + 3 sample, lane], in order of time."""
        both = self._with_slopes(snapshots, 2)
        both[:, :, :2] = self.before
        self.before, (values, slopes) = both[:, :, -2:].copy(), both
        result = np.empty((len(values), 1 + 3 * len(snapshots), snapshots.shape[2]))
        result[:, 0] = values[:, 1]
        broken = (snapshots[:, self.hits] != 0.0).any(axis=1)
        for form, series in enumerate(result):
            fine = series[1:].reshape(len(snapshots), 3, -1)
            if self.slopes[form] is not None:
                between_cubics(values[form, 1:], slopes[form, 1:], broken, fine)
            elif self.jumps[form] > 0.0:
                fine[:] = values[form, 2:, None]
            else:
                between_parabolas(values[form], self.pushed[form], fine)
        return result
