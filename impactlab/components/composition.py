"""Bodies, contacts, couplings and excitations, composed by name and checked: what a network is, not what it can do."""

from __future__ import annotations

import reprlib
import unicodedata
from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Any, Self, TypeVar

from impactlab.components.component import Component, suggestion
from impactlab.components.contact import Contact
from impactlab.components.coupling import Coupling, MatrixTerm
from impactlab.components.excitation import Excitation, Source
from impactlab.components.oscillator import LinearOscillator, Oscillator
from impactlab.components.potentials import check_potentials
from impactlab.components.sides import WALL, Combination, named_by
from impactlab.components.structure import LinearStructure
from impactlab.errors import InvalidInput

Member = TypeVar("Member", bound=Component)
Family = Mapping[str, Member] | Iterable[tuple[str, Member]]

_SHOWN = 6

_NOT_IN_FILES = ("Cc", "Cs")
"""Categories of Unicode that labels of arrays and files cut off or cannot hold: control characters, surrogates."""

_FAMILIES: dict[str, tuple[type[Component], ...]] = {
    "oscillators": (Oscillator, LinearStructure),
    "contacts": (Contact,),
    "excitations": (Excitation, Source),
    "couplings": (Coupling,),
}
"""Families of a network, in the order in which it takes them, and what their members may be."""


class Composition:
    """The members of a network, by family and name; immutable.

    What is below `impactlab.Network`, which adds the methods that compile and check, reads this alone.
    """

    __slots__ = ("_contacts", "_couplings", "_excitations", "_expanded", "_oscillators", "_sources")

    def __init__(
        self,
        oscillators: Family[Oscillator] | Family[Oscillator | LinearStructure],
        contacts: Family[Contact] | None = None,
        excitations: Family[Excitation | Source] | None = None,
        couplings: Family[Coupling] | None = None,
    ) -> None:
        self._oscillators = _family("oscillators", oscillators)
        self._contacts = _family("contacts", {} if contacts is None else contacts)
        self._excitations = _family("excitations", {} if excitations is None else excitations)
        self._couplings = _family("couplings", {} if couplings is None else couplings)
        self._sources = {name: item for name, item in self._excitations.items() if isinstance(item, Source)}
        if not self._oscillators:
            raise InvalidInput("A network needs at least one oscillator; none was given.")
        self._expanded = bodies, _ = _with_structures(self._oscillators, self._couplings)
        for name, link in [*self._contacts.items(), *self._couplings.items()]:
            for body in named_by(link):
                if body not in bodies:
                    raise InvalidInput(
                        f"{type(link).__name__} {name!r} names a body {body!r} that is not in the network; "
                        f"{self._instead(body)}"
                    )
        self._check_sources()
        for name in self._excitations:
            if name not in bodies and name not in self._sources:
                raise InvalidInput(
                    f"There is an excitation for {name!r}, which is not in the network; {self._instead(name)}"
                )
        laws = ((name, contact.law) for name, contact in self._contacts.items())
        check_potentials("contact", laws, "force", "potential")
        check_potentials("body", bodies.items(), "residual", "residual_potential", both_sides=True)

    def _check_sources(self) -> None:
        bodies, _ = self._expanded
        for name, source in self._sources.items():
            if name in bodies or name in self._oscillators:
                raise InvalidInput(
                    f"The source {name!r} has the name of a body, by which the body's own noise is drawn; give it a "
                    "name of its own."
                )
            for body in source.on:
                if body not in bodies:
                    raise InvalidInput(
                        f"Source {name!r} drives {body!r}, which is not in the network; {self._instead(body)}"
                    )

    @property
    def oscillators(self) -> Mapping[str, Oscillator]:
        """The bodies by name; of structures each coordinate is one."""
        return MappingProxyType(self._expanded[0])

    @property
    def structures(self) -> Mapping[str, LinearStructure]:
        """The structures of several coordinates by name."""
        return {name: item for name, item in self._oscillators.items() if isinstance(item, LinearStructure)}

    @property
    def contacts(self) -> Mapping[str, Contact]:
        """The contacts by name."""
        return MappingProxyType(self._contacts)

    @property
    def excitations(self) -> Mapping[str, Any]:
        """The excitations by the name of the body that they act on, and the sources by their own."""
        return MappingProxyType(self._excitations)

    def excitations_of(self, body: str) -> list[tuple[str, Excitation, float]]:
        """Return name, excitation and weight of all that drives a body: its own excitation, then sources."""
        own = [(body, self._excitations[body], 1.0)] if body in self._excitations else []
        sources = [(name, item.excitation, item.on[body]) for name, item in self._sources.items() if body in item.on]
        return own + sources

    @property
    def couplings(self) -> Mapping[str, Coupling]:
        """The couplings by name, and the terms of the matrices of structures."""
        return MappingProxyType(self._expanded[1])

    def _instead(self, name: str) -> str:
        """Say what may be meant by a name that is that of no body."""
        if name in self.structures:
            return f"name a coordinate of the structure, such as {_coordinates(name, self.structures[name])[0]!r}."
        return suggestion(name, self._expanded[0])

    def replace(
        self,
        *,
        oscillators: Mapping[str, Oscillator | LinearStructure | None] | None = None,
        contacts: Mapping[str, Contact | None] | None = None,
        excitations: Mapping[str, Excitation | Source | None] | None = None,
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

    def to_dict(self) -> dict[str, Any]:
        """Return the network as plain data that JSON can hold."""
        return {
            title: {name: item.to_dict() for name, item in getattr(self, f"_{title}").items()} for title in _FAMILIES
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Make a network from what :meth:`to_dict` returned."""
        if not isinstance(data, Mapping):
            raise InvalidInput(f"A network is stored as a mapping, not {reprlib.repr(data)}.")
        for title, family in data.items():
            if title not in _FAMILIES:
                raise InvalidInput(f"A network has {', '.join(_FAMILIES)}, but not {title!r}.")
            if not isinstance(family, Mapping):
                raise InvalidInput(f"{title} are stored as a mapping, not {reprlib.repr(family)}.")
        families: dict[str, Any] = {
            title: {name: _kind_of(item, kinds).from_dict(item) for name, item in data.get(title, {}).items()}
            for title, kinds in _FAMILIES.items()
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
        return tuple(tuple(getattr(self, f"_{title}").items()) for title in _FAMILIES)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), tuple(getattr(self, f"_{title}") for title in _FAMILIES)

    def __repr__(self) -> str:
        counts = [_count(self._oscillators, "body", "bodies"), _count(self._contacts, "contact", "contacts")]
        counts += [_count(self._couplings, "coupling", "couplings")] if self._couplings else []
        lines = [f"Network: {', '.join(counts)}, {_count(self._excitations, 'excitation', 'excitations')}"]
        for title in _FAMILIES:
            members = getattr(self, f"_{title}")
            if members:
                lines.append(f"  {title}")
            lines += [f"    {name}: {item!r}" for name, item in list(members.items())[:_SHOWN]]
            if len(members) > _SHOWN:
                lines.append(f"    … and {len(members) - _SHOWN} more")
        return "\n".join(lines)


def _family(title: str, members: Family[Any]) -> dict[str, Any]:
    """Return the members of one family as a checked dictionary."""
    kinds = _FAMILIES[title]
    expected = " or ".join(f"il.{kind.__name__}" for kind in kinds)
    try:
        pairs = [(name, member) for name, member in (members.items() if isinstance(members, Mapping) else members)]
    except (TypeError, ValueError) as error:
        raise InvalidInput(f"{title} must be a mapping of names to {expected} objects, not {members!r}.") from error
    family: dict[str, Any] = {}
    for name, member in pairs:
        if not isinstance(name, str) or not name.strip():
            raise InvalidInput(f"{title}: a name must be a non-empty string, not {name!r}.")
        if not name.isprintable() and any(unicodedata.category(letter) in _NOT_IN_FILES for letter in name):
            raise InvalidInput(f"{title}: a name must not contain control characters, as does {name!r}.")
        if name in family:
            raise InvalidInput(f"{title}: the name {name!r} was given twice.")
        if not isinstance(member, kinds):
            raise InvalidInput(f"{title}: {name!r} must be an {expected}, not {member!r}.")
        family[name] = member
    return family


def _with_structures(
    given: Mapping[str, Any], couplings: Mapping[str, Coupling]
) -> tuple[dict[str, Oscillator], dict[str, Coupling]]:
    """Return bodies and couplings with the coordinates of structures and the terms of their matrices."""
    bodies: dict[str, Oscillator] = {}
    every = dict(couplings)
    for name, body in given.items():
        own, terms = _of_structure(name, body) if isinstance(body, LinearStructure) else ({name: body}, {})
        for place, item in own.items():
            if place in bodies:
                raise InvalidInput(f"oscillators: {place!r} is the name of a body, and of a coordinate of a structure.")
            bodies[place] = item
        for place, coupling in terms.items():
            if place in every:
                raise InvalidInput(f"couplings: {place!r} is the name of a coupling, and of a term of a structure.")
            every[place] = coupling
    return bodies, every


def _coordinates(name: str, structure: LinearStructure) -> list[str]:
    """Return the names that the coordinates of a structure have in a network."""
    return [f"{name}.{coordinate}" for coordinate in structure.names]


def _of_structure(name: str, structure: LinearStructure) -> tuple[dict[str, Oscillator], dict[str, Coupling]]:
    """Return the coordinates of a structure as bodies, and what connects them as couplings."""
    places = _coordinates(name, structure)
    bodies: dict[str, Oscillator] = {
        place: LinearOscillator(mass=mass, stiffness=stiffness, damping=damping)
        for place, mass, stiffness, damping in zip(places, structure.mass, *structure.to_ground().tolist(), strict=True)
    }
    couplings = {}
    for label, weights, stiffness, damping in structure.terms():
        point = Combination({places[slot]: weight for slot, weight in weights.items()})
        couplings[f"{name}: {label}"] = Coupling(point, WALL, MatrixTerm(stiffness, damping=damping))
    return bodies, couplings


def _kind_of(item: Any, kinds: tuple[type[Component], ...]) -> type[Component]:
    """Return the kind of a stored member by the name of its class; the first one if none of the kinds has it."""
    name = item.get("type", "") if isinstance(item, Mapping) else ""
    return next((kind for kind in kinds if str(name).rpartition(".")[2] == kind.__name__), kinds[0])


def _changed(kind: str, old: Mapping[str, Any], changes: Mapping[str, Any] | None) -> dict[str, Any]:
    changes = changes or {}
    for name, member in changes.items():
        if member is None and name not in old:
            raise InvalidInput(f"There is no {kind} {name!r} to remove; {suggestion(name, old)}")
    merged = {**old, **changes}
    return {name: member for name, member in merged.items() if member is not None}


def _count(members: Mapping[str, Any], one: str, many: str) -> str:
    return f"{len(members) or 'no'} {one if len(members) == 1 else many}"
