"""Networks: bodies, contacts, couplings and excitations, composed by name and checked."""

from __future__ import annotations

import reprlib
import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeVar

from impactlab.component import Component, suggestion
from impactlab.contact import WALL, Contact, ContactLaw
from impactlab.coupling import Coupling
from impactlab.errors import InvalidInput
from impactlab.excitation import Excitation
from impactlab.oscillator import Oscillator
from impactlab.potentials import check_potentials

if TYPE_CHECKING:
    from impactlab.check import NetworkCheck
    from impactlab.compiled import CompiledNetwork
    from impactlab.integrators import Integrator

Member = TypeVar("Member", bound=Component)
Family = Mapping[str, Member] | Iterable[tuple[str, Member]]

_SHOWN = 6

_NOT_IN_FILES = ("Cc", "Cs")
"""Categories of Unicode that labels of arrays and files cut off or cannot hold: control characters, surrogates."""

_FAMILIES: dict[str, type[Component]] = {
    "oscillators": Oscillator,
    "contacts": Contact,
    "excitations": Excitation,
    "couplings": Coupling,
}
"""Families of a network, in the order in which it takes them."""


class Network:
    """Bodies that can touch each other, may be coupled, and are excited from outside; immutable.

    Two networks are equal when they have the same members of the same names in the same
    order, which is that of the results.

    Parameters
    ----------
    oscillators : mapping of str to Oscillator
        The bodies by name (a sequence of pairs will do as well).
    contacts : mapping of str to Contact, optional
        The places where bodies can touch, by name.
    excitations : mapping of str to Excitation, optional
        The excitation of a body, by the body's name.
    couplings : mapping of str to Coupling, optional
        Springs and dampers between bodies, by name.

    Raises
    ------
    InvalidInput
        If there are no bodies, a name is empty or given twice, a contact, a coupling or an
        excitation names a body that does not exist, a member is of the wrong family, or a potential
        is not the integral of its force.
    """

    __slots__ = ("_contacts", "_couplings", "_excitations", "_oscillators")

    def __init__(
        self,
        oscillators: Family[Oscillator],
        contacts: Family[Contact] | None = None,
        excitations: Family[Excitation] | None = None,
        couplings: Family[Coupling] | None = None,
    ) -> None:
        self._oscillators = _family("oscillators", oscillators, Oscillator)
        self._contacts = _family("contacts", {} if contacts is None else contacts, Contact)
        self._excitations = _family("excitations", {} if excitations is None else excitations, Excitation)
        self._couplings = _family("couplings", {} if couplings is None else couplings, Coupling)
        if not self._oscillators:
            raise InvalidInput("A network needs at least one oscillator; none was given.")
        for name, link in [*self._contacts.items(), *self._couplings.items()]:
            for side in (link.first, link.second):
                if side is not WALL and side not in self._oscillators:
                    raise InvalidInput(
                        f"{type(link).__name__} {name!r} names a body {side!r} that is not in the network; "
                        f"{suggestion(str(side), self._oscillators)}"
                    )
        for name in self._excitations:
            if name not in self._oscillators:
                raise InvalidInput(
                    f"There is an excitation for {name!r}, which is not in the network; "
                    f"{suggestion(name, self._oscillators)}"
                )
        laws = ((name, contact.law) for name, contact in self._contacts.items())
        check_potentials("contact", laws, "force", "potential")
        check_potentials("body", self._oscillators.items(), "residual", "residual_potential", both_sides=True)

    @property
    def oscillators(self) -> Mapping[str, Oscillator]:
        """The bodies by name."""
        return MappingProxyType(self._oscillators)

    @property
    def contacts(self) -> Mapping[str, Contact]:
        """The contacts by name."""
        return MappingProxyType(self._contacts)

    @property
    def excitations(self) -> Mapping[str, Excitation]:
        """The excitations by the name of the body that they act on."""
        return MappingProxyType(self._excitations)

    @property
    def couplings(self) -> Mapping[str, Coupling]:
        """The couplings by name."""
        return MappingProxyType(self._couplings)

    def replace(
        self,
        *,
        oscillators: Mapping[str, Oscillator | None] | None = None,
        contacts: Mapping[str, Contact | None] | None = None,
        excitations: Mapping[str, Excitation | None] | None = None,
        couplings: Mapping[str, Coupling | None] | None = None,
    ) -> Network:
        """Return a network in which some members are changed, added or, with None, removed.

        Raises
        ------
        InvalidInput
            If a member to be removed does not exist, or the new network is not valid.
        """
        return Network(
            _changed("oscillator", self._oscillators, oscillators),
            _changed("contact", self._contacts, contacts),
            _changed("excitation", self._excitations, excitations),
            _changed("coupling", self._couplings, couplings),
        )

    def compile(self) -> CompiledNetwork:
        """Compile the network's forces and return its noise-free right-hand side."""
        from impactlab.compiled import CompiledNetwork

        return CompiledNetwork(self)

    def check(self, step: float | None = None, integrator: Integrator | None = None) -> NetworkCheck:
        """Find the network's time scales and predict the bias of a step, without simulating.

        Parameters
        ----------
        step : float, optional
            Time step (s); by default the one that `simulate` would choose before it makes it
            divide the duration. Of forces that vary in time the first twelve relaxation times
            are looked at.
        integrator : Integrator, optional
            Method; `ExactFlow` by default.

        Returns
        -------
        NetworkCheck
            Prints a table; its ``dataset`` has the numbers.

        Raises
        ------
        InvalidInput
            If the step or the integrator cannot be used; with the words of `simulate`.
        """
        from impactlab.check import check

        return check(self, step, integrator)

    def source(self) -> str:
        """Return the text of the module that is generated for this network."""
        from impactlab.generate import generate
        from impactlab.model import Model

        return generate(Model.of(self))

    def to_dict(self) -> dict[str, Any]:
        """Return the network as plain data that JSON can hold."""
        return {
            title: {name: item.to_dict() for name, item in getattr(self, f"_{title}").items()} for title in _FAMILIES
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Network:
        """Make a network from what :meth:`to_dict` returned."""
        if not isinstance(data, Mapping):
            raise InvalidInput(f"A network is given as data by a mapping, {reprlib.repr(data)} was given.")
        for title, family in data.items():
            if title not in _FAMILIES:
                raise InvalidInput(f"A network has {', '.join(_FAMILIES)}; {title!r} was given.")
            if not isinstance(family, Mapping):
                raise InvalidInput(f"{title} are given as data by a mapping, {reprlib.repr(family)} was given.")
        families: dict[str, Any] = {
            title: {name: kind.from_dict(item) for name, item in data.get(title, {}).items()}
            for title, kind in _FAMILIES.items()
        }
        return cls(**families)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Network):
            return NotImplemented
        return all(list(getattr(self, name).items()) == list(getattr(other, name).items()) for name in self.__slots__)

    def __hash__(self) -> int:
        return hash(tuple(tuple(getattr(self, name).items()) for name in self.__slots__))

    def __reduce__(self) -> tuple[Any, ...]:
        return Network, tuple(getattr(self, f"_{title}") for title in _FAMILIES)

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


def chain(
    bodies: int,
    oscillator: Oscillator | Sequence[Oscillator],
    law: ContactLaw | Sequence[ContactLaw],
    *,
    clearance: float | Sequence[float] = 0.0,
    excitation: Excitation | Sequence[Excitation | None] | None = None,
    walls: bool = False,
) -> Network:
    """Return bodies in a row, each of which can touch the next.

    Parameters
    ----------
    bodies : int
        Number of bodies; they are named ``body_0``, ``body_1``, …
    oscillator : Oscillator or sequence
        One for all bodies, or one for each.
    law : ContactLaw or sequence
        One for all contacts (named ``contact_0``, …, from left to right), or one for each.
    clearance : float or sequence
        Clearance of the contacts (m).
    excitation : Excitation or sequence, optional
        One for all bodies (their noises are independent), or one or None for each.
    walls : bool
        Whether the first body can touch a wall on its left and the last on its right.

    Returns
    -------
    Network

    Raises
    ------
    InvalidInput
        If the number of bodies is not positive or a sequence has the wrong length.
    """
    if isinstance(bodies, bool) or not isinstance(bodies, int) or bodies < 1:
        raise InvalidInput(f"chain: bodies must be a whole number of at least 1, {bodies!r} was given.")
    names = [f"body_{index}" for index in range(bodies)]
    ends: list[Any] = [WALL, *names, WALL] if walls else list(names)
    pairs = list(pairwise(ends))
    oscillators = _each("oscillator", oscillator, bodies)
    excitations = _each("excitation", excitation, bodies)
    laws = _each("law", law, len(pairs))
    clearances = _each("clearance", clearance, len(pairs))
    return Network(
        dict(zip(names, oscillators, strict=True)),
        {
            f"contact_{index}": Contact(*pair, laws[index], clearance=clearances[index])
            for index, pair in enumerate(pairs)
        },
        {name: item for name, item in zip(names, excitations, strict=True) if item is not None},
    )


def _each(name: str, value: Any, count: int) -> list[Any]:
    """Return one value per place, from one for all or a sequence of the right length."""
    if not isinstance(value, Sequence):
        return [value] * count
    if len(value) != count:
        raise InvalidInput(f"chain: {name} must be one for all or a sequence of {count}, {len(value)} were given.")
    return list(value)


def _family(title: str, members: Family[Any], kind: type[Component]) -> dict[str, Any]:
    """Return the members of one family as a checked dictionary."""
    try:
        pairs = [(name, member) for name, member in (members.items() if isinstance(members, Mapping) else members)]
    except (TypeError, ValueError) as error:
        raise InvalidInput(
            f"{title} must be a mapping of names to il.{kind.__name__} objects, {members!r} was given."
        ) from error
    family: dict[str, Any] = {}
    for name, member in pairs:
        if not isinstance(name, str) or not name.strip():
            raise InvalidInput(f"{title}: a name must be a text that is not empty, {name!r} was given.")
        if not name.isprintable() and any(unicodedata.category(letter) in _NOT_IN_FILES for letter in name):
            raise InvalidInput(f"{title}: a name must have no control characters, {name!r} was given.")
        if name in family:
            raise InvalidInput(f"{title}: the name {name!r} was given twice.")
        if not isinstance(member, kind):
            raise InvalidInput(f"{title}: {name!r} must be an il.{kind.__name__}, {member!r} was given.")
        family[name] = member
    return family


def _changed(kind: str, old: Mapping[str, Any], changes: Mapping[str, Any] | None) -> dict[str, Any]:
    changes = changes or {}
    for name, member in changes.items():
        if member is None and name not in old:
            raise InvalidInput(f"There is no {kind} {name!r} to remove; {suggestion(name, old)}")
    merged = {**old, **changes}
    return {name: member for name, member in merged.items() if member is not None}


def _count(members: Mapping[str, Any], one: str, many: str) -> str:
    return f"{len(members) or 'no'} {one if len(members) == 1 else many}"
