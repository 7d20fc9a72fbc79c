"""Bodies, contacts, couplings and excitations, composed by name and checked: what a network is, not what it can do."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable, Mapping, Sequence, Set
from operator import attrgetter
from types import MappingProxyType
from typing import Any, NamedTuple, Self, TypeVar

import numpy as np

from impactlab.components.component import SHOWN, Component, classes_named
from impactlab.components.contact import Contact, RoundContact
from impactlab.components.coupling import Coupling, LinearCoupling, MatrixTerm
from impactlab.components.descriptions import uncertain_in, with_numbers
from impactlab.components.excitation import BaseMotion, Excitation, Source
from impactlab.components.oscillator import InvertedOscillator, LinearOscillator, MasslessCoordinate, Oscillator
from impactlab.components.potentials import check_potentials
from impactlab.components.prescribed import PrescribedBody, PrescribedMotion
from impactlab.components.sides import (
    WALL,
    Combination,
    Side,
    bodies_of,
    directions_of,
    is_round,
    named_by,
    weights_of_side,
)
from impactlab.components.structure import Structure
from impactlab.errors import InvalidInput
from impactlab.inputs import checked, known_name, shown, suggestion

Member = TypeVar("Member", bound=Component)
Family = Mapping[str, Member] | Iterable[tuple[str, Member]]

_NOT_IN_FILES = ("Cc", "Cs")
"""Categories of Unicode that labels of arrays and files cut off or cannot hold: control characters, surrogates."""

FAMILIES: dict[str, tuple[type[Component], ...]] = {
    "oscillators": (Oscillator, Structure, PrescribedMotion),
    "contacts": (Contact, RoundContact),
    "excitations": (Excitation, Source, BaseMotion),
    "couplings": (Coupling,),
}
"""Families of a network, in the order in which it takes them, and what their members may be."""

Shares = Mapping[str, float]
"""Weights by the name of a body."""


class _Expanded(NamedTuple):
    """The members of a network without structures and points: coordinates are bodies, and sides name these."""

    bodies: dict[str, Oscillator]
    points: dict[str, Shares]
    contacts: dict[str, Contact | RoundContact]
    excitations: dict[str, Excitation | Source]
    couplings: dict[str, Coupling]
    sources: dict[str, Source]
    prescribed: dict[str, Excitation]


@checked
class Composition:
    """The members of a network, by family and name; immutable.

    What is below `impactlab.Network`, which adds the methods that compile and check, reads this alone.
    """

    __slots__ = ("_contacts", "_couplings", "_excitations", "_expanded", "_oscillators")

    def __init__(
        self,
        oscillators: Family[Oscillator] | Family[Oscillator | Structure | PrescribedMotion],
        contacts: Family[Contact] | Family[Contact | RoundContact] | None = None,
        excitations: Family[Excitation | Source | BaseMotion] | None = None,
        couplings: Family[Coupling] | None = None,
    ) -> None:
        self._oscillators = _family("oscillators", oscillators)
        self._contacts = _family("contacts", {} if contacts is None else contacts)
        self._excitations = _family("excitations", {} if excitations is None else excitations)
        self._couplings = _family("couplings", {} if couplings is None else couplings)
        if not self._oscillators:
            raise InvalidInput("A network needs at least one oscillator; none was given.")
        if any(map(attrgetter("is_uncertain"), self._all())):
            middle = {place: item.median for place, item in self.uncertain_numbers.items()}
            self._expanded: _Expanded = self._as_given(self.with_numbers(middle)._expanded)
            return
        bodies, terms, points = _with_structures(self._oscillators)
        self._check_names(bodies, terms, points)
        self._check_held()
        self._check_massless()
        prescribed = {name: body.displacement for name, body in _of(bodies, PrescribedBody).items()}
        if prescribed:
            self._check_prescribed(prescribed, len(bodies))
        motions = _of(self._excitations, BaseMotion).items()
        excitations = self._excitations | {name: self._forces(name, item) for name, item in motions}
        contacts, couplings = self._contacts, self._couplings
        if points:
            contacts = {name: _without_points(name, item, points) for name, item in contacts.items()}
            couplings = {name: _without_points(name, item, points) for name, item in couplings.items()}
            excitations = {name: _at_bodies(name, item, points) for name, item in excitations.items()}
        sources = _of(excitations, Source)
        self._expanded = _Expanded(bodies, points, contacts, excitations, couplings | terms, sources, prescribed)
        check_potentials("contact", _laws(self._contacts), "force", "potential")
        check_potentials("coupling", _laws(self._couplings), "force", "potential", both_sides=True)
        check_potentials("body", bodies, "residual", "residual_potential", both_sides=True)

    def _all(self) -> list[Component]:
        """Return all members."""
        return [item for title in FAMILIES for item in getattr(self, f"_{title}").values()]

    def _as_given(self, expanded: _Expanded) -> _Expanded:
        """Return the members of a network of numbers, with the uncertain ones in the place of their own."""
        changes = {}
        for title, field in zip(FAMILIES, ("bodies", "contacts", "excitations", "couplings"), strict=True):
            own, members = getattr(expanded, field), getattr(self, f"_{title}")
            there = {name: item for name, item in members.items() if name in own and item.is_uncertain}
            changes[field] = own | there
        return expanded._replace(**changes)

    @property
    def is_uncertain(self) -> bool:
        """Whether it has uncertain numbers, so that it describes many networks."""
        return any(map(attrgetter("is_uncertain"), self._all()))

    @property
    def uncertain_numbers(self) -> dict[str, Any]:
        """The numbers that are uncertain, by their places, such as ``oscillators.a.stiffness``."""
        return {
            f"{title}.{name}.{place}": item
            for title in FAMILIES
            for name, member in getattr(self, f"_{title}").items()
            if member.is_uncertain
            for place, item in uncertain_in(member).items()
        }

    def check_numbers(self) -> None:
        """Refuse a network that has uncertain numbers."""
        if places := list(self.uncertain_numbers):
            named = f"{', '.join(places[:SHOWN])}{' and more' if len(places) > SHOWN else ''}"
            raise InvalidInput(
                f"The network has uncertain numbers ({named}), so that it describes many: il.simulate and il.sweep "
                "draw from these. Choose one by network.with_numbers({place: number})."
            )

    def with_numbers(self, numbers: Mapping[str, float]) -> Self:
        """Return a network with numbers in the place of uncertain ones, by their places.

        Raises
        ------
        InvalidInput
            If there is no uncertain number in a place, or the network cannot be made of the numbers.
        """
        known = self.uncertain_numbers
        for place in numbers:
            known_name("uncertain number", place, known)
        return self.replace(
            **{
                title: {
                    name: with_numbers(member, _below(f"{title}.{name}.", numbers))
                    for name, member in getattr(self, f"_{title}").items()
                    if member.is_uncertain
                }
                for title in FAMILIES
            }
        )

    def _check_names(
        self, bodies: Mapping[str, Oscillator], terms: Mapping[str, Coupling], points: Mapping[str, Shares]
    ) -> None:
        """Refuse members that name what is not there, or have the name of something else."""
        places = {**bodies, **points}
        for name in terms:
            if name in self._couplings:
                raise InvalidInput(f"couplings: {name!r} is the name of a coupling, and of a term of a structure.")
        links = [*self._contacts.values(), *self._couplings.values()]
        there = {*places, WALL}.__contains__
        sides = (map(attrgetter(side), links) for side in ("first", "second"))
        found = all(all(map(there, of_links)) for of_links in sides)
        for name, link in () if found else [*self._contacts.items(), *self._couplings.items()]:
            for body in named_by(link):
                if body not in places:
                    raise InvalidInput(
                        f"{type(link).__name__} {name!r} names a body {body!r} that is not in the network; "
                        f"{self._instead(body, places)}"
                    )
        if not _has(self._excitations, Source | BaseMotion) and self._excitations.keys() <= places.keys():
            return
        for name, item in self._excitations.items():
            if isinstance(item, Excitation):
                if name not in places:
                    raise InvalidInput(
                        f"There is an excitation for {name!r}, which is not in the network (one with a name of its own "
                        "is an il.Source(…, on=…), or an il.BaseMotion of the ground); "
                        f"{self._instead(name, places)}"
                    )
                continue
            if name in places or name in self._oscillators:
                raise InvalidInput(
                    f"The source {name!r} has the name of a body, by which the body's own noise is drawn; give it a "
                    "name of its own."
                )
            known = self._followers() if isinstance(item, BaseMotion) else places
            for body in item.on:
                if body not in known:
                    kind = type(item).__name__
                    raise InvalidInput(
                        f"{kind} {name!r} drives {body!r}, which is not in the network; {self._instead(body, known)}"
                    )

    def _check_held(self) -> None:
        """Refuse bodies that nothing keeps from moving away."""
        links = [*self._contacts.values(), *self._couplings.values()]
        for name, body in self._oscillators.items() if _has(self._oscillators, InvertedOscillator) else ():
            if not isinstance(body, InvertedOscillator) or body.repulsion <= body.stiffness:
                continue
            if not any(name in named_by(link) for link in links):
                raise InvalidInput(
                    f"Nothing holds {name!r}, which is repelled by {body.repulsion - body.stiffness:g} N m-1 more than "
                    "its spring holds it: add stops or a coupling, or use il.DoubleWellOscillator."
                )

    def _check_massless(self) -> None:
        """Refuse forces on coordinates without mass that would move them at once, and need steps of their lag."""
        massless = set(_of(self._oscillators, MasslessCoordinate))
        if not massless:
            return
        for name, link in [*self._contacts.items(), *self._couplings.items()]:
            if isinstance(link.law, LinearCoupling):
                continue
            for body in massless.intersection(bodies_of(link)):
                what = f"{type(link).__name__} {name!r} with {type(link.law).__name__}"
                raise InvalidInput(
                    f"{what} acts on {body!r}, which has no mass: contacts, and couplings that are not linear, act on "
                    f"bodies with mass. Let {name!r} act on one that an il.LinearCoupling connects with {body!r}, or "
                    f"make {body!r} an il.LinearOscillator with a mass."
                )

    def _check_prescribed(self, given: Mapping[str, Excitation], bodies: int) -> None:
        """Refuse bodies of given motion that are random, pushed, or in touch with nothing that is free to move."""
        for name, displacement in given.items():
            if displacement.kind != "force":
                raise InvalidInput(
                    f"The displacement of {name!r} must be a given function of time such as "
                    f"il.Harmonic(0.01, frequency=50.0), not {displacement!r}."
                )
        for name, item in self._excitations.items():
            for body in given.keys() & ({name} if isinstance(item, Excitation) else set(item.on)):
                what = "has an excitation" if name == body else f"is driven by {name!r}"
                raise InvalidInput(f"{body!r} {what}, but moves as it is given, whatever force acts on it.")
        if len(given) == bodies:
            raise InvalidInput("All bodies move as they are given; a network needs one that is free to move.")
        for name, link in [*self._contacts.items(), *self._couplings.items()]:
            if given.keys() >= set(named_by(link)):
                raise InvalidInput(f"Both sides of {name!r} move as they are given, so that it does nothing.")

    def _forces(self, name: str, item: BaseMotion) -> Source:
        """Return the source of forces on all that follows a motion of the ground."""
        inertia: dict[str, float] = {}
        for place, body in self._oscillators.items():
            if isinstance(body, PrescribedMotion | PrescribedBody):  # relative to the ground
                continue
            if not isinstance(body, Structure):
                inertia[place] = item.factor(place) * body.mass
                continue
            factors = {own: item.factor(f"{place}.{own}", place) for own in body.places()}
            try:
                for factor in dict.fromkeys(factors.values() if factors else [item.factor(place)]):
                    following = [own for own in factors if factors[own] == factor]
                    forces = _named(place, body.inertia(following)) if factor else {}
                    inertia |= {own: inertia.get(own, 0.0) + factor * force for own, force in forces.items()}
            except InvalidInput as error:
                raise InvalidInput(f"BaseMotion {name!r} cannot move {place!r}: {error}") from None
        return Source(item.acceleration, on={body: -force for body, force in inertia.items() if force})

    def _followers(self) -> set[str]:
        """Return the names of all that may follow the ground."""
        structures = self.structures.items()
        return {*self._oscillators, *(f"{name}.{own}" for name, body in structures for own in body.places())}

    @property
    def oscillators(self) -> Mapping[str, Oscillator]:
        """The bodies by name; of structures each coordinate is one."""
        return MappingProxyType(self._expanded.bodies)

    @property
    def structures(self) -> Mapping[str, Structure]:
        """The structures of several coordinates by name."""
        return _of(self._oscillators, Structure)

    @property
    def points(self) -> Mapping[str, Shares]:
        """The weights of the bodies in the displacement of each point of a structure, by the name of the point."""
        return MappingProxyType(self._expanded.points)

    @property
    def prescribed(self) -> Mapping[str, Excitation]:
        """The displacements of bodies whose motion is given, by their names."""
        return MappingProxyType(self._expanded.prescribed)

    @property
    def contacts(self) -> Mapping[str, Any]:
        """The contacts by name; in the place of points they have combinations."""
        return MappingProxyType(self._expanded.contacts)

    @property
    def named_contacts(self) -> Mapping[str, Any]:
        """The contacts by name as they were given, with the names of points."""
        return MappingProxyType(self._contacts)

    @property
    def excitations(self) -> Mapping[str, Any]:
        """The excitations by the name of the body that they act on, and the sources by their own.

        The excitation at a point is a source of its name.
        """
        return MappingProxyType(self._expanded.excitations)

    def excitations_of(self, body: str) -> list[tuple[str, Excitation, float]]:
        """Return name, excitation and weight of all that drives a body: its own excitation, then sources."""
        own = [(body, self.excitations[body], 1.0)] if body in self.excitations else []
        return own + [(name, item.excitation, item.on[body]) for name, item in self.sources.items() if body in item.on]

    @property
    def sources(self) -> Mapping[str, Source]:
        """The excitations that have a name of their own."""
        return MappingProxyType(self._expanded.sources)

    def excitations_on(self, bodies: Set[str]) -> dict[str, Any]:
        """Return the excitations that act on any of some bodies, by name."""
        acting = {name: item.on for name, item in self.sources.items()}
        return {
            name: item for name, item in self.excitations.items() if not bodies.isdisjoint(acting.get(name, (name,)))
        }

    @property
    def couplings(self) -> Mapping[str, Coupling]:
        """The couplings by name, and the terms of the matrices of structures."""
        return MappingProxyType(self._expanded.couplings)

    def displaced(self, point: str) -> Shares:
        """Return the displacements of the bodies that move a point by 1, and no other point of its structure.

        Raises
        ------
        InvalidInput
            If the displacements of the structure do not follow from those of its points.
        """
        name = next(name for name in self.structures if point in _named(name, self.structures[name].weights()))
        structure = self.structures[name]
        rows, bodies = structure.weights(), list(structure.bodies())
        shapes = np.array([[row.get(body, 0.0) for body in bodies] for row in rows.values()])
        square = len(shapes) == len(bodies)
        # up to this condition of the shapes, displacements of bodies follow from the displacements of points
        if not square or np.linalg.cond(shapes) > 1e10:
            raise InvalidInput(
                f"The displacements of the {len(bodies)} bodies of {name!r} do not follow from that of {point!r} and "
                f"its other points; name bodies, such as {f'{name}.{bodies[0]}'!r}."
            )
        column = np.linalg.inv(shapes)[:, list(_named(name, rows)).index(point)]
        return dict(zip([f"{name}.{body}" for body in bodies], column.tolist(), strict=True))

    def _instead(self, name: str, places: Iterable[str]) -> str:
        """Say what may be meant by a name that is that of no body or point."""
        if name in self.structures:
            structure = self.structures[name]
            first = next(iter({**structure.weights(), **structure.bodies()}))
            return f"name a coordinate or a point of the structure, such as {f'{name}.{first}'!r}."
        if name.lower() == "wall":
            return "the wall is il.WALL, in a file {wall = true}."
        return suggestion(name, places)

    def replace(
        self,
        *,
        oscillators: Mapping[str, Oscillator | Structure | PrescribedMotion | None] | None = None,
        contacts: Mapping[str, Contact | RoundContact | None] | None = None,
        excitations: Mapping[str, Excitation | Source | BaseMotion | None] | None = None,
        couplings: Mapping[str, Coupling | None] | None = None,
    ) -> Self:
        """Return a network in which some members are changed, added or, with None, removed.

        Raises
        ------
        InvalidInput
            If a member to be removed does not exist, or the new network is not valid.
        """
        return type(self)(
            _changed("oscillator", self._oscillators, oscillators),
            _changed("contact", self._contacts, contacts),
            _changed("excitation", self._excitations, excitations),
            _changed("coupling", self._couplings, couplings),
        )

    def given(self) -> dict[str, Mapping[str, Component]]:
        """Return the members as they were given, by family and name."""
        return {title: MappingProxyType(getattr(self, f"_{title}")) for title in FAMILIES}

    def to_dict(self) -> dict[str, Any]:
        """Return the network as plain data that JSON can hold."""
        flat: dict[int, dict[str, Any]] = {}  # of components that may be those of many members

        def data_of(item: Component) -> dict[str, Any]:
            data = flat.get(id(item))
            if data is None:
                data = item.to_dict()
                if not any(isinstance(value, dict | list) for value in data.values()):
                    flat[id(item)] = data
            return dict(data)

        return {title: {name: data_of(item) for name, item in family.items()} for title, family in self.given().items()}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Make a network from what :meth:`to_dict` returned."""
        for title, family in data.items():
            if title not in FAMILIES:
                raise InvalidInput(f"A network has no {title!r}; {suggestion(title, FAMILIES)}")
            if not isinstance(family, Mapping):
                raise InvalidInput(f"{title} are stored as a mapping, not {shown(family)}.")
        families: dict[str, Any] = {
            title: {name: kind_of(item, kinds).from_dict(item) for name, item in data.get(title, {}).items()}
            for title, kinds in FAMILIES.items()
        }
        return cls(**families)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Composition):
            return NotImplemented
        return self._members() == other._members()

    def __hash__(self) -> int:
        return hash(self._members())

    def _members(self) -> tuple[tuple[tuple[str, Component], ...], ...]:
        """Names and members of all families, in order."""
        return tuple(tuple(getattr(self, f"_{title}").items()) for title in FAMILIES)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), tuple(getattr(self, f"_{title}") for title in FAMILIES)

    def __repr__(self) -> str:
        counts = [_count(self._oscillators, "body", "bodies"), _count(self._contacts, "contact", "contacts")]
        counts += [_count(self._couplings, "coupling", "couplings")] if self._couplings else []
        lines = [f"Network: {', '.join(counts)}, {_count(self._excitations, 'excitation', 'excitations')}"]
        for title in FAMILIES:
            members = getattr(self, f"_{title}")
            if members:
                lines.append(f"  {title}")
            lines += [f"    {name}: {item!r}" for name, item in list(members.items())[:SHOWN]]
            if len(members) > SHOWN:
                lines.append(f"    … and {len(members) - SHOWN} more")
        return "\n".join(lines)


def _family(title: str, members: Family[Any]) -> dict[str, Any]:
    """Return the members of one family as a checked dictionary."""
    _check_member_names(title, list(members) if isinstance(members, Mapping) else [name for name, _ in members])
    return dict(members)


def _below(place: str, numbers: Mapping[str, float]) -> dict[str, float]:
    """Return the numbers whose places begin with a place, by what follows."""
    return {name.removeprefix(place): value for name, value in numbers.items() if name.startswith(place)}


def _check_member_names(title: str, names: Sequence[Any]) -> None:
    """Refuse names of a family that are no text, cannot be stored, or are given twice."""
    if all(map(str.strip, names)) and "".join(names).isprintable() and len(set(names)) == len(names):
        return
    known: set[str] = set()
    for name in names:
        if not name.strip():
            raise InvalidInput(f"{title}: a name must be a non-empty string, not {name!r}.")
        if not name.isprintable() and any(unicodedata.category(letter) in _NOT_IN_FILES for letter in name):
            raise InvalidInput(f"{title}: a name must not contain control characters, as does {name!r}.")
        if name in known:
            raise InvalidInput(f"{title}: the name {name!r} was given twice.")
        known.add(name)


def _laws(links: Mapping[str, Contact | RoundContact] | Mapping[str, Coupling]) -> dict[str, Component]:
    """Return the laws of contacts or couplings by the names of these."""
    return dict(zip(links, map(attrgetter("law"), links.values()), strict=True))


def _has(members: Mapping[str, Any], kind: Any) -> bool:
    """Whether any of some members are of a kind; each class is looked at once."""
    return any(issubclass(cls, kind) for cls in set(map(type, members.values())))


def _of(members: Mapping[str, Any], kind: Any) -> dict[str, Any]:
    """Return the members of a kind."""
    return {name: item for name, item in members.items() if isinstance(item, kind)} if _has(members, kind) else {}


def _with_structures(
    given: Mapping[str, Any],
) -> tuple[dict[str, Oscillator], dict[str, Coupling], dict[str, Shares]]:
    """Return bodies with the coordinates of structures, the terms of their matrices, and their points."""
    bodies: dict[str, Oscillator] = {}
    terms: dict[str, Coupling] = {}
    points: dict[str, Shares] = {}
    if not _has(given, Structure | PrescribedMotion):
        return dict(given), terms, points
    for name, body in given.items():
        structure = isinstance(body, Structure)
        if isinstance(body, PrescribedMotion):
            body = PrescribedBody(displacement=body.displacement)
        own = {place: LinearOscillator(**numbers) for place, numbers in body.bodies().items()} if structure else {}
        for place, item in (_named(name, own) if structure else {name: body}).items():
            if place in bodies:
                raise InvalidInput(f"oscillators: {place!r} is the name of a body, and of a coordinate of a structure.")
            bodies[place] = item
        if structure:
            terms |= _terms_of(name, body)
            points |= {place: _named(name, row) for place, row in _named(name, body.weights()).items()}
    for name in points:
        if name in bodies:
            raise InvalidInput(f"oscillators: {name!r} is the name of a body, and of a point of a structure.")
    return bodies, terms, points


def _named(structure: str, own: Mapping[str, Any]) -> dict[str, Any]:
    """Return things by the names that they have in a network, from those within a structure."""
    return {f"{structure}.{name}": item for name, item in own.items()}


def _terms_of(name: str, structure: Structure) -> dict[str, Coupling]:
    """Return the couplings between the coordinates of a structure."""
    return {
        f"{name}: {label}": Coupling(Combination(_named(name, weights)), WALL, MatrixTerm(stiffness, damping=damping))
        for label, weights, stiffness, damping in structure.terms()
    }


def _of_bodies(weights: Shares, points: Mapping[str, Shares]) -> dict[str, float]:
    """Return the weights of bodies in a weighted sum of bodies and points, without those that cancel."""
    result: dict[str, float] = {}
    for name, weight in weights.items():
        for body, share in points.get(name, {name: 1.0}).items():
            result[body] = result.get(body, 0.0) + weight * share
    return {body: weight for body, weight in result.items() if weight}


def _without_points(name: str, link: Any, points: Mapping[str, Shares]) -> Any:
    """Return a contact or a coupling with combinations of bodies in the place of points."""
    if points.keys().isdisjoint(named_by(link)):
        return link

    def side(given: Side) -> Side:
        weights = weights_of_side(given)
        return given if points.keys().isdisjoint(weights) else Combination(_of_bodies(weights, points))

    for direction in directions_of(link):
        weights = [weights_of_side(item) for item in (direction.first, direction.second)]
        difference = [_of_bodies(item, points) for item in weights]
        if not all(difference[place] for place in (0, 1) if weights[place]) or difference[0] == difference[1]:
            raise InvalidInput(
                f"{type(link).__name__} {name!r} of {direction.first!r} with {direction.second!r} acts on nothing: no "
                "weight is left of any body."
            )
    if not is_round(link):
        return link.replace(first=side(link.first), second=side(link.second))
    pairs = (item if item is WALL else tuple(map(side, item)) for item in (link.first, link.second))
    return link.replace(**dict(zip(("first", "second"), pairs, strict=True)))


def _at_bodies(name: str, item: Excitation | Source, points: Mapping[str, Shares]) -> Excitation | Source:
    """Return an excitation with weights of bodies where it acts on points."""
    if isinstance(item, Excitation):
        return Source(item, on=points[name]) if name in points else item
    if points.keys().isdisjoint(item.on):
        return item
    on = _of_bodies(item.on, points)
    if not on:
        raise InvalidInput(f"Source {name!r} drives nothing: no weight is left of any body.")
    return item.replace(on=on)


def kind_of(item: Any, kinds: tuple[type[Component], ...]) -> type[Component]:
    """Return the kind of a stored member by the name of its class; the first one if none of the kinds has it."""
    name = str(item.get("type", "")) if isinstance(item, Mapping) else ""
    classes = classes_named(name.rpartition(".")[2]).values()
    return next((kind for kind in kinds if any(issubclass(cls, kind) for cls in classes)), kinds[0])


def _changed(kind: str, old: Mapping[str, Any], changes: Mapping[str, Any] | None) -> dict[str, Any]:
    changes = changes or {}
    for name, member in changes.items():
        if member is None and name not in old:
            raise InvalidInput(f"There is no {kind} {name!r} to remove; {suggestion(name, old)}")
    merged = {**old, **changes}
    return {name: member for name, member in merged.items() if member is not None}


def _count(members: Mapping[str, Any], one: str, many: str) -> str:
    return f"{len(members) or 'no'} {one if len(members) == 1 else many}"
