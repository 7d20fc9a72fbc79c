"""From names to slots: a network as arrays of numbers. The only index arithmetic."""

from __future__ import annotations

import functools
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from functools import cached_property
from itertools import compress, islice, repeat
from operator import attrgetter
from typing import Any, Protocol, TypeVar

import numpy as np

from impactlab.assembly.incidence import runs
from impactlab.assembly.links import Combinations, Links, Pairs, RoundLinks, joined
from impactlab.assembly.members import LEADING, ROUND, SLIDING, Kind, Members, Rows, by_kind
from impactlab.assembly.sources import Sources
from impactlab.components.contact import Contact, ContactLaw, RigidContact, RoundContact
from impactlab.components.coupling import CoulombFrictionCoupling, Coupling, CouplingLaw, MatrixTerm
from impactlab.components.evaluation import TIME, are_one, call_each, of_classes, of_objects
from impactlab.components.excitation import KINDS, Excitation, Source
from impactlab.components.oscillator import Oscillator
from impactlab.components.sides import are_differences, directions_of, is_round, weights_of
from impactlab.machine import uncollected

Result = TypeVar("Result")


class Described(Protocol):
    """A network as a model reads it; see `impactlab.components.composition.Composition`."""

    @property
    def oscillators(self) -> Mapping[str, Oscillator]: ...
    @property
    def points(self) -> Mapping[str, Mapping[str, float]]: ...
    @property
    def prescribed(self) -> Mapping[str, Excitation]: ...
    @property
    def contacts(self) -> Mapping[str, Any]: ...
    @property
    def couplings(self) -> Mapping[str, Coupling]: ...
    @cached_property
    def excitations(self) -> Mapping[str, Excitation | Source]: ...
    @property
    def sources(self) -> Mapping[str, Source]: ...
    def excitations_on(self, bodies: Set[str]) -> dict[str, Any]: ...
    def displaced(self, point: str) -> Mapping[str, float]: ...
    def given(self) -> Mapping[str, Mapping[str, Any]]: ...
    def to_dict(self) -> dict[str, Any]: ...


@dataclass(frozen=True, eq=False)
class Model:
    """A network as arrays.

    Bodies have slots 0 … n − 1 in the order of their names; slot n is the wall, a body
    that is always at rest at 0, so that walls need no code of their own.
    """

    network: Described  # where the model comes from
    mass: np.ndarray  # (body,) of the linear part, as the next two (kg)
    damping: np.ndarray  # (N s m-1)
    stiffness: np.ndarray  # (N m-1)
    ends: Links  # what each contact acts along: its gap, but for the clearance
    clearance: np.ndarray  # (contact,) at rest (m)
    coupled: Links  # the same of the couplings; their extension is the negative of it
    coupling: np.ndarray  # (2, coupling) stiffness (N m-1) and damping (N s m-1) of the linear couplings, 0 for others
    flowing: np.ndarray  # (coupling,) which of them an integrator treats as a part of the bodies' linear motion
    sources: dict[str, Sources[Excitation]]
    """White noises ("intensity"), given forces ("force"), sums of cosines ("lines"), filtered noises ("filter") and
    impulses."""
    members: Members  # contacts, other couplings, residual forces and functions of time, as generated loops take them

    @classmethod
    @uncollected()
    def of(cls, network: Described, flowing: Collection[str] = ()) -> Model:
        """Make the model of a network, with some linear couplings in the linear motion."""
        bodies = list(network.oscillators.values())
        mass, damping, stiffness = (_numbers(bodies, field) for field in ("mass", "damping", "stiffness"))
        slots = dict(zip(network.oscillators, range(len(bodies)), strict=True))
        ends, coupled = _links(network, flowing, slots, mass)
        sources = _sources(network, slots)
        return cls(
            network=network,
            mass=mass,
            damping=damping,
            stiffness=stiffness,
            ends=ends,
            clearance=_clearances(network),
            coupled=coupled,
            coupling=np.array([item.law.linear for item in network.couplings.values()]).reshape(-1, 2).T,
            flowing=np.array([name in flowing for name in network.couplings], dtype=bool),
            sources=sources,
            members=Members.of(_members(network, ends, flowing, sources, slots, mass), ends, coupled),
        )

    @cached_property
    def bodies(self) -> tuple[str, ...]:
        """Names of the bodies by slot."""
        return tuple(self.network.oscillators)

    @cached_property
    def contacts(self) -> tuple[str, ...]:
        """Names of the contacts."""
        return tuple(self.network.contacts)

    @cached_property
    def couplings(self) -> tuple[str, ...]:
        """Names of the couplings."""
        return tuple(self.network.couplings)

    @cached_property
    def oscillators(self) -> tuple[Oscillator, ...]:
        """The bodies by slot; equal ones are one object, as those of the next two."""
        return same(self.network.oscillators.values())

    @cached_property
    def contact_laws(self) -> tuple[ContactLaw, ...]:
        """Laws of the contacts."""
        return same([item.law for item in self.network.contacts.values()])

    @cached_property
    def coupling_laws(self) -> tuple[CouplingLaw, ...]:
        """Laws of the couplings."""
        return same([item.law for item in self.network.couplings.values()])

    @cached_property
    def excitations(self) -> list[tuple[str, Excitation]]:
        """All excitations with the first of their names, those of each kind one after the other."""
        kinds = self.sources.values()
        named = [item for kind in kinds for item in kind.named()[: 1 if are_one(kind.excitations) else None]]
        return list({id(item[1]): item for item in reversed(named)}.values())[::-1]

    @cached_property
    def white(self) -> tuple[int, ...]:
        """Slots of the bodies under white noise."""
        return self.sources["intensity"].bodies

    @cached_property
    def lines(self) -> tuple[int, ...]:
        """Slots of the bodies under sums of cosines."""
        return self.sources["lines"].bodies

    @cached_property
    def coloured(self) -> tuple[int, ...]:
        """Slots of the bodies under filtered white noise or impulses."""
        return tuple(sorted({*self.sources["filter"].bodies, *self.sources["impulses"].bodies}))

    @cached_property
    def modulated(self) -> bool:
        """Whether a filtered white noise, or impulses, have an envelope that depends on time."""
        return any(item.has_kernel("modulation") for kind in COLOURED for item in self.sources[kind].excitations)

    @cached_property
    def forced(self) -> tuple[int, ...]:
        """Slots of the bodies under a given force."""
        return self.sources["force"].bodies

    @cached_property
    def natural_frequencies(self) -> np.ndarray:
        """Undamped natural frequencies of the bodies without contacts (rad s-1), (body,)."""
        return np.asarray(np.sqrt(self.stiffness / self.mass))

    @cached_property
    def prescribed(self) -> np.ndarray:
        """Whether the motion of each body is given, (body,) of bool."""
        given = self.network.prescribed
        if not given:
            return np.zeros(len(self.bodies), dtype=bool)
        return np.array([name in given for name in self.bodies], dtype=bool)

    @cached_property
    def excited(self) -> np.ndarray:
        """Whether each body has an excitation, (body,) of bool."""
        result = np.zeros(len(self.bodies), dtype=bool)
        result[[*self.white, *self.lines, *self.coloured, *self.forced]] = True
        return result

    @property
    def wall(self) -> int:
        """Slot of the wall."""
        return len(self.bodies)

    @cached_property
    def links(self) -> Links:
        """Contacts, then couplings."""
        return joined(self.ends, self.coupled)

    @cached_property
    def rigid(self) -> np.ndarray:
        """Whether each contact is rigid, (contact,) of bool."""
        return np.array(of_classes(lambda kind: issubclass(kind, RigidContact), self.contact_laws), dtype=bool)

    @cached_property
    def round(self) -> np.ndarray:
        """Whether each contact acts in a plane, (contact,) of bool."""
        return _round(self.network)

    @cached_property
    def impacted(self) -> np.ndarray:
        """Whether each body has a rigid contact, (body,) of bool."""
        result = np.zeros(len(self.bodies) + 1, dtype=bool)
        result[self.ends.chosen(self.rigid).slots] = True
        return result[:-1]

    @cached_property
    def rubbing(self) -> np.ndarray:
        """Whether each coupling is dry friction that sticks, (coupling,) of bool."""
        return np.array(of_classes(lambda kind: issubclass(kind, CoulombFrictionCoupling), self.coupling_laws), bool)

    @cached_property
    def rubbed(self) -> np.ndarray:
        """Whether each body has dry friction that sticks, (body,) of bool."""
        result = np.zeros(len(self.bodies) + 1, dtype=bool)
        result[self.coupled.chosen(self.rubbing).slots] = True
        return result[:-1]

    @cached_property
    def interrupted(self) -> np.ndarray:
        """Whether impacts, or slip and stick of dry friction, are located in the motion of each body between kicks,
        (body,) of bool.
        """
        return np.asarray(self.impacted | self.rubbed)

    @cached_property
    def kicking(self) -> np.ndarray:
        """Whether each link is a force of its own, not a part of the motion between kicks, (link,) of bool."""
        return np.concatenate([np.ones(len(self.ends), dtype=bool), ~(self.flowing | self.rubbing)])

    @cached_property
    def matrix_terms(self) -> np.ndarray:
        """Whether each coupling is a term of the matrices of a structure, (coupling,) of bool."""
        return np.array(of_classes(lambda kind: issubclass(kind, MatrixTerm), self.coupling_laws), dtype=bool)

    @cached_property
    def passes(self) -> int:
        """How often a kick evaluates forces with the velocities that they give; 0 where none depends on any.

        Contacts and residuals are solved for their own velocity, so that once will do where no two of them meet.
        """
        slowed = [np.zeros(0, dtype=np.int64)]
        for kind, (leading, _) in zip(self.members.kinds, self.members.tables, strict=True):
            if kind.role in ROUND:
                each = [np.unique(self.ends.chosen(row).slots) for row in leading[:, :1]]
                slowed += each if kind.slows or kind.role == "rubbing" else []
            elif kind.slows:
                slowed.append(self.ends.chosen(leading[:, 0]).slots if kind.role == "force" else leading[:, 0])
            elif kind.role == "coupling" and "rate" in kind.kinematic:
                slowed.append(np.repeat(leading, 2))
            elif kind.role == "combination" and "rate" in kind.kinematic:
                slowed.append(np.repeat(self.links.chosen(leading[:, 0]).slots, 2))
        numbers = np.bincount(np.concatenate(slowed), minlength=self.wall + 1)[: self.wall]
        return 0 if not self.dissipative else min(int(numbers.max()), 2)

    @cached_property
    def dissipative(self) -> bool:
        """Whether a force that does not flow depends on velocities or states."""
        kinds = self.members.of_role("force", "residual", *ROUND)
        if self.members.of_role("rubbing"):
            return True
        return any(kind.states or not {"rate", "velocity"}.isdisjoint(kind.kinematic) for kind in kinds) or any(
            law.dissipative and not flows for law, flows in zip(self.coupling_laws, self.flowing, strict=True)
        )

    @cached_property
    def states(self) -> tuple[tuple[str, str], ...]:
        """Labels of the states of laws, such as "spring.pull", and their units, in the order of `Members.states`."""
        if not len(self.members.states):
            return ()
        contacts, couplings = (
            {name: link.law for name, link in links.items()}
            for links in (self.network.contacts, self.network.couplings)
        )
        families = {"force": contacts, "residual": self.network.oscillators}
        result = []
        for kind, (leading, _) in zip(self.members.kinds, self.members.tables, strict=True):
            owners = (name for name, law in families.get(kind.role, couplings).items() if type(law) is kind.component)
            for count in runs(*leading.T)[-1] if kind.states else ():
                names = list(islice(owners, int(count)))
                result += [(f"{name}.{state}", kind.component.units(state)) for state in kind.states for name in names]
        return tuple(result)

    @cached_property
    def state_ends(self) -> Pairs:
        """Two bodies, or one and the wall, that the law of each state acts on, in the order of `Members.states`."""
        result = [np.zeros((0, 2), dtype=np.int64)]
        for kind, (leading, _) in zip(self.members.kinds, self.members.tables, strict=True):
            if kind.states:
                ends, cuts = self._ends_of(kind, leading), np.cumsum(runs(*leading.T)[-1])[:-1]
                result += [part for part in np.split(ends, cuts) for _ in kind.states]
        return Pairs(self.wall, np.concatenate(result))

    def _ends_of(self, kind: Kind, leading: np.ndarray) -> np.ndarray:
        """Return two bodies, or one and the wall, that each member of a kind acts on, (member, 2)."""
        if kind.role == "coupling":
            return leading[:, :2]
        if kind.role == "residual":
            first = leading[:, 0]
        else:
            links = (self.links if kind.role == "combination" else self.ends).chosen(leading[:, 0])
            if links.plain:
                return links.pairs
            first = links.first()
        return np.stack([first, np.full(len(first), self.wall)], axis=1)

    @property
    def remembering(self) -> bool:
        """Whether laws of contacts or couplings, or bodies have states."""
        return len(self.members.states) > 0

    @cached_property
    def timed(self) -> np.ndarray:
        """Whether a law that depends on time acts on each body, (body,) of bool."""
        result = np.zeros(len(self.bodies) + 1, dtype=bool)
        for kind, (leading, _) in zip(self.members.kinds, self.members.tables, strict=True):
            if not kind.timed:
                continue
            if kind.role == "force" or kind.role in ROUND:
                result[self.ends.chosen(leading[:, 0]).slots] = True
            elif kind.role == "combination":
                result[self.links.chosen(leading[:, 0]).slots] = True
            else:
                result[leading] = True
        return result[:-1]

    @cached_property
    def varying(self) -> bool:
        """Whether anything varies in time but by white noise: other noises, given forces, intensities or laws."""
        return bool(self.lines or self.coloured or self.forced or self.time_varying or self.timed.any())

    @cached_property
    def timed_contacts(self) -> np.ndarray:
        """Whether the force of each contact depends on time, (contact,) of bool."""
        return np.array(of_classes(lambda kind: TIME in kind.kernel("force")[1], self.contact_laws), dtype=bool)

    @cached_property
    def rated_contacts(self) -> np.ndarray:
        """Whether the force of each contact that is not round depends on the rate of its indentation, (contact,)."""
        result = np.zeros(len(self.ends), dtype=bool)
        for kind, (leading, _) in zip(self.members.kinds, self.members.tables, strict=True):
            if kind.rated:
                result[leading[:, 0]] = True
        return result

    @cached_property
    def points(self) -> tuple[tuple[str, tuple[tuple[int, float], ...]], ...]:
        """Names of the points of structures, with the slots of the bodies of which they are sums, and their weights."""
        rows = self.network.points.items()
        slots = {name: slot for slot, name in enumerate(self.bodies)} if rows else {}
        return tuple((name, tuple((slots[body], share) for body, share in row.items())) for name, row in rows)

    @cached_property
    def time_varying(self) -> bool:
        """Whether the intensity of a white noise depends on time."""
        return any(kind.kinematic for kind in self.members.of_role("intensity"))

    @cached_property
    def kicked(self) -> np.ndarray:
        """Whether each body has contacts, couplings that do not flow, or a residual force, (body,) of bool."""
        result = np.zeros(len(self.bodies) + 1, dtype=bool)
        result[self.links.chosen(self.kicking).slots] = True
        result[:-1] |= self.residual
        return result[:-1]

    @cached_property
    def nonlinear_bodies(self) -> np.ndarray:
        """Whether each body is kicked, or has dry friction that sticks, (body,) of bool."""
        return np.asarray(self.kicked | self.rubbed)

    @cached_property
    def residual(self) -> np.ndarray:
        """Whether each body has a residual force, (body,) of bool."""
        if not self.members.of_role("residual"):
            return np.zeros(len(self.bodies), dtype=bool)
        return np.array(of_classes(lambda kind: kind.has_kernel("residual"), self.oscillators))

    def intensities(self, time: float = 0.0) -> np.ndarray:
        """Two-sided spectral density of the white noise on each body (N2 s rad-1), (body,)."""
        return self.sources["intensity"].added(self.densities(time), len(self.bodies))

    @cached_property
    def initial_intensities(self) -> np.ndarray:
        """Return :meth:`intensities` at time 0; not to be changed."""
        return self.sources["intensity"].added(self.initial_densities, len(self.bodies))

    def reference_intensities(self) -> np.ndarray:
        """Return :meth:`intensities` for which coefficients are made, (body,)."""
        return self.sources["intensity"].added(self.reference_densities(), len(self.bodies))

    def densities(self, time: float = 0.0) -> np.ndarray:
        """Two-sided spectral density of each white noise (N2 s rad-1), (noise,)."""
        excitations = self.sources["intensity"].excitations
        return call_each(excitations, "intensity", np.full((len(excitations), 1), time))[:, 0]

    @cached_property
    def initial_densities(self) -> np.ndarray:
        """Return :meth:`densities` at time 0; not to be changed."""
        return self.densities()

    def reference_densities(self) -> np.ndarray:
        """Densities for which coefficients are made: the constant ones, 1 where they vary, (noise,)."""
        return np.ones(len(self.sources["intensity"].names)) if self.time_varying else self.initial_densities

    def intensity_matrix(self, slots: np.ndarray) -> np.ndarray:
        """Spectral densities of the white noises on some bodies and between them at time 0, (n, n)."""
        return self.sources["intensity"].matrix(self.initial_densities, self.initial_intensities, slots)

    def connected(self) -> np.ndarray:
        """Label of the connected part of each body, (body,) of int; walls and bodies of given motion do not connect."""
        return self._labels

    @cached_property
    def random(self) -> np.ndarray:
        """Whether a noise acts on the connected part of each body, (body,) of bool."""
        noisy = self.reference_intensities() > 0.0
        noisy[[*self.lines, *self.coloured]] = True
        labels = self.connected()
        return np.isin(labels, labels[noisy])

    def first_of(self, links: Links) -> np.ndarray:
        """Return the body of each link that has the lowest slot, of those whose motion is not given, (link,)."""
        result = links.first()
        if self.prescribed.any():
            lowest, free = np.full(len(links), self.wall), ~np.append(self.prescribed, True)[links.slots]
            np.minimum.at(lowest, links.rows[free], links.slots[free])
            result = np.where(lowest < self.wall, lowest, result)
        return result

    def touching(self) -> np.ndarray:
        """Label of the part of each body that contacts alone connect, (body,) of int."""
        return self.ends.held(self.prescribed).parts

    @cached_property
    def _labels(self) -> np.ndarray:
        return self.links.held(self.prescribed).parts

    def coupled_parts(self) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Return slots, stiffness and damping matrix of the bodies that linear couplings connect, part by part.

        Bodies of given motion are as walls to them.
        """
        linear = np.asarray(self.coupling.any(axis=0))
        links, (stiffness, damping) = self.coupled.chosen(linear).held(self.prescribed), self.coupling[:, linear]
        labels = links.parts
        part_of_link = labels[links.first()]
        result = []
        for part in np.unique(part_of_link):
            slots, rows = np.flatnonzero(labels == part), part_of_link == part
            k, c = (links.chosen(rows).springs(strength[rows], slots) for strength in (stiffness, damping))
            result.append((slots, k, c))
        return result


def same(items: Iterable[Result]) -> tuple[Result, ...]:
    """Return items, in the place of equal ones the first of these."""
    first: dict[Result, Result] = {}
    return tuple(of_objects(lambda item: first.setdefault(item, item), list(items)))


def _numbers(items: Sequence[Any], field: str) -> np.ndarray:
    """Return a number of each of some components, (item,)."""
    if are_one(items):
        return np.full(len(items), getattr(items[0], field))
    return np.array(list(map(attrgetter(field), items)), dtype=float)


def _clearances(network: Described) -> np.ndarray:
    """Return the clearances of contacts at rest, (contact,)."""
    contacts = list(network.contacts.values())
    result = _numbers(contacts, "clearance")
    for slot in np.flatnonzero(_round(network)):
        result[slot] = contacts[slot].clearance_at_rest
    return result


def _round(network: Described) -> np.ndarray:
    """Whether each contact acts in a plane, (contact,) of bool."""
    kinds = of_classes(lambda kind: issubclass(kind, RoundContact), network.contacts.values())
    return np.array(kinds, dtype=bool)


def _sources(network: Described, slots: Mapping[str, int]) -> dict[str, Sources[Excitation]]:
    """Return the excitations by what they define."""
    shared = network.sources
    own: dict[str, Any] = {**network.excitations, **network.prescribed}
    names = [name for name in slots if name in own]
    kinds: list[str] = of_classes(lambda cls: cls.kind, map(own.__getitem__, names))
    of_kind = {kind: list(compress(names, map(kind.__eq__, kinds))) for kind in set(kinds)}
    return {
        kind: Sources.of(
            {name: own[name] for name in of_kind.get(kind, ())},
            {name: (item.excitation, item.on) for name, item in shared.items() if item.excitation.kind == kind},
            slots,
        )
        for kind in KINDS
    }


def _links(
    network: Described, flowing: Collection[str], slots: Mapping[str, int], mass: np.ndarray
) -> tuple[Links, Links]:
    """Return contacts and couplings of bodies with some slots and masses as links.

    Both are pairs if all that kick are differences: combinations that flow are only terms of a matrix.
    """
    contacts: list[Contact | RoundContact]
    contacts, couplings = list(network.contacts.values()), list(network.couplings.values())
    kicking = [item for name, item in network.couplings.items() if name not in flowing]
    plain = are_differences([*contacts, *kicking])

    def links_of(items: Sequence[Any], plain: bool) -> Links:
        if plain:
            return Pairs(len(slots), _pairs(slots, items))
        directions = [item for link in items for item in directions_of(link)]
        combinations = [{slots[name]: weight for name, weight in weights_of(item).items()} for item in directions]
        along = Combinations.of(combinations, len(slots))
        if not any(of_classes(lambda kind: issubclass(kind, RoundContact), items)):
            return along
        link = np.repeat(np.arange(len(items)), [1 + is_round(item) for item in items])
        center = [place for item in items for place in (item.center if is_round(item) else (0.0,))]
        return RoundLinks(len(slots), along, link, np.array(center), 1.0 / mass)

    return links_of(contacts, plain), links_of(couplings, plain and are_differences(couplings))


def _pairs(slots: Mapping[Any, int], links: Sequence[Contact | Coupling]) -> np.ndarray:
    """Return the slots of both sides, (link, 2); the wall has that after the last body."""
    result, wall = np.empty((len(links), 2), dtype=np.int64), repeat(len(slots))
    for side, name in enumerate(("first", "second")):
        result[:, side] = list(map(slots.get, map(attrgetter(name), links), wall))
    return result


COLOURED = "filter", "impulses"
"""Kinds of excitation that move bodies from sample to sample, in this order."""

_IN_TIME = (
    ("forcing", ("force",), "force"),
    ("intensity", ("intensity",), "intensity"),
    ("modulation", COLOURED, "modulation"),
)
"""Roles of functions of time, which kinds of excitation have them, and the names of their kernels."""


def _members(
    network: Described, ends: Links, flowing: Collection[str], sources: Mapping[str, Sources[Excitation]],
    slots: Mapping[str, int], mass: np.ndarray,
) -> dict[Kind, Rows]:  # fmt: skip
    """Return what acts by its kernels, kind by kind, without the couplings that flow, or stick."""
    result: dict[Kind, Rows] = {}

    def add(role: str, components: Sequence[Any], kernel: str, indices: np.ndarray, *leading: np.ndarray) -> None:
        for kind, numbers in by_kind(role, components, kernel).items():
            chosen = list(map(components.__getitem__, numbers.tolist()))
            columns = [item[numbers] for item in leading[: len(kind.leading)]]
            table = np.stack(columns, axis=1) if columns else np.zeros((len(numbers), 0))
            result[kind] = Rows(chosen, indices[numbers].reshape(len(numbers), len(LEADING[role])), table)

    bodies = list(network.oscillators.values())
    contacts, mobility = list(network.contacts.values()), 1.0 / mass
    straight = np.flatnonzero(~_round(network))
    clearance, along = _numbers(contacts, "clearance")[straight], ends.squares(mobility)[straight]
    laws = list(map(attrgetter("law"), map(contacts.__getitem__, straight.tolist())))
    add("force", laws, "force", straight, clearance, along)
    for role, laws, indices, columns in _in_plane(contacts, ends, len(network.couplings)):
        add(role, laws, "force", indices, *columns)
    role = "coupling" if ends.plain else "combination"
    acting = {name: not isinstance(item.law, CoulombFrictionCoupling) for name, item in network.couplings.items()}
    kicking = [item for name, item in network.couplings.items() if acting[name] and name not in flowing]
    numbers = np.flatnonzero([acts and name not in flowing for name, acts in acting.items()])
    add(role, [item.law for item in kicking], "force", _pairs(slots, kicking) if ends.plain else len(ends) + numbers)
    for kind in by_kind(role, [item.law for name, item in network.couplings.items() if acting[name]], "force"):
        # also without a row: the text does not depend on what flows
        result.setdefault(kind, Rows([], np.zeros((0, len(LEADING[role])), np.int64), np.zeros((0, 0))))
    bent = np.flatnonzero(of_classes(lambda kind: kind.has_kernel("residual"), bodies))
    add("residual", [bodies[slot] for slot in bent.tolist()], "residual", bent, mobility[bent])
    for role, families, kernel in _IN_TIME:
        own = [item for kind in families for item in sources[kind].excitations]
        having = of_classes(lambda kind, kernel=kernel: kind.has_kernel(kernel), own)  # type: ignore[misc]
        excitations = list(compress(own, having))
        add(role, excitations, kernel, np.arange(len(excitations)))
    factors = [item.multiplied_by for item in sources["force"].excitations]
    products = np.flatnonzero([item is not None for item in factors])
    add("factor", [factors[row] for row in products], "force", products)
    return result


def _in_plane(
    contacts: Sequence[Any], ends: Links, couplings: int
) -> Iterator[tuple[str, list[ContactLaw], np.ndarray, np.ndarray]]:
    """Give the roles of contacts in a plane, with their laws, indices and leading parameters."""
    if not isinstance(ends, RoundLinks):
        return
    count, numbers = len(ends.round), np.arange(len(ends.round))
    links = len(ends) + couplings + numbers + count * np.arange(4)[:, None]
    mobility = ends.in_plane(ends.mobility)
    for role, rubbing in zip(ROUND, (False, True), strict=True):
        rows = np.flatnonzero([bool(contacts[slot].friction) is rubbing for slot in ends.round])
        chosen = [contacts[slot] for slot in ends.round[rows]]
        places = np.array([[item.clearance, *item.center] for item in chosen]).reshape(-1, 3).T
        sliding = np.array([[getattr(item, name) for name in SLIDING] for item in chosen]).reshape(-1, len(SLIDING)).T
        columns = np.concatenate([places, mobility[:, rows], sliding])
        yield role, [item.law for item in chosen], np.stack([ends.round, *links])[:, rows].T, columns


def kept(function: Callable[..., Result]) -> Callable[..., Result]:
    """Keep what a function of a model and hashable arguments returns for as long as the model lives.

    Arrays are read-only.
    """

    @functools.wraps(function)
    def known(model: Model, *arguments: Any) -> Result:
        results = model.__dict__.setdefault("_kept", {})
        key = function, *arguments
        if key not in results:
            results[key] = function(model, *arguments)
            if isinstance(results[key], np.ndarray):
                results[key].setflags(write=False)
        return results[key]  # type: ignore[no-any-return]

    return known


def keep(function: Callable[..., Result], model: Model, *arguments: Any, value: Result) -> None:
    """Let a function that is `kept` return a value that was found elsewhere."""
    model.__dict__.setdefault("_kept", {})[(function.__wrapped__, *arguments)] = value  # type: ignore[attr-defined]
