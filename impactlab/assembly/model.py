"""From names to slots: a network as arrays of numbers. The only index arithmetic."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence, Set
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from itertools import compress, islice, repeat
from operator import attrgetter
from typing import Any, Protocol, TypeVar

import numpy as np

from impactlab.assembly.incidence import runs
from impactlab.assembly.links import Combinations, Links, Pairs, RoundLinks, joined
from impactlab.assembly.members import LAWS, LEADING, ROUND, SLIDING, Kind, Members, Rows, by_kind
from impactlab.assembly.sources import Noise, Sources
from impactlab.components.contact import Contact, ContactLaw, RoundContact
from impactlab.components.coupling import Coupling, CouplingLaw, MatrixTerm
from impactlab.components.evaluation import TIME, are_one, of_classes, of_objects
from impactlab.components.excitation import KINDS, Excitation, Source
from impactlab.components.oscillator import Oscillator
from impactlab.components.sides import are_differences, directions_of, is_round, weights_of
from impactlab.machine import uncollected

Result = TypeVar("Result")

KNOWN: list[Any] = []
"""All mechanisms; a class that derives from `impactlab.assembly.mechanism.Mechanism` adds one."""

SAMPLED = tuple(kind for kind in KINDS if kind not in ("intensity", "force"))
"""Kinds of excitation of which a run takes samples: all but functions of time."""


class Described(Protocol):
    """A network as a model reads it; see `impactlab.components.composition.Composition`."""

    def check_numbers(self) -> None: ...
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
class Bodies:
    """The bodies of a network by slot."""

    names: tuple[str, ...]
    oscillators: tuple[Oscillator, ...]  # equal ones are one object
    free: np.ndarray  # (body,) of bool, whether forces move it; else its motion is given
    excited: np.ndarray  # (body,) of bool, whether it has an excitation
    sampled: tuple[int, ...]  # slots under noises that are not white, of which a run takes samples
    residual: np.ndarray  # (body,) of bool, whether it has a residual force

    @classmethod
    def of(cls, network: Described, sources: Mapping[str, Sources[Excitation]]) -> Bodies:
        """Return the bodies of a network with some excitations."""
        names, given, oscillators = tuple(network.oscillators), network.prescribed, same(network.oscillators.values())
        excited = np.zeros(len(names), dtype=bool)
        for kind in sources.values():
            excited[kind.drives.body] = True
        sampled = tuple(sorted({slot for kind in SAMPLED for slot in sources[kind].drives.body.tolist()}))
        free = np.array([name not in given for name in names] if given else np.ones(len(names)), dtype=bool)
        residual = np.array(of_classes(lambda kind: kind.has_kernel("residual"), oscillators))
        return cls(names, oscillators, free, excited, sampled, residual)

    def __len__(self) -> int:
        return len(self.names)


@dataclass(frozen=True, eq=False)
class Contacts:
    """The contacts of a network."""

    names: tuple[str, ...]
    laws: tuple[ContactLaw, ...]  # equal ones are one object
    impulsive: np.ndarray  # (contact,) of bool, whether it has impulses in the place of a force
    round: np.ndarray  # (contact,) of bool, whether it acts in a plane
    timed: np.ndarray  # (contact,) of bool, whether its force depends on time

    @classmethod
    def of(cls, network: Described) -> Contacts:
        """Return the contacts of a network."""
        contacts = network.contacts
        laws = same([item.law for item in contacts.values()])
        flags = of_classes(lambda kind: (kind.impulsive, TIME in kind.kernel("force")[1]), laws)
        impulsive, timed = np.array(flags, dtype=bool).reshape(-1, 2).T
        in_plane = of_classes(lambda kind: issubclass(kind, RoundContact), contacts.values())
        return cls(tuple(contacts), laws, impulsive, np.array(in_plane, dtype=bool), timed)


@dataclass(frozen=True, eq=False)
class Couplings:
    """The couplings of a network."""

    names: tuple[str, ...]
    laws: tuple[CouplingLaw, ...]  # equal ones are one object
    linear: np.ndarray  # (2, coupling) stiffness (N m-1) and damping (N s m-1) of the linear ones, 0 for others
    flowing: np.ndarray  # (coupling,) of bool, whether an integrator treats it as a part of the bodies' linear motion
    sticking: np.ndarray  # (coupling,) of bool, whether slip and stick are located in the motion between kicks
    matrix_terms: np.ndarray  # (coupling,) of bool, whether it is a term of the matrices of a structure

    @classmethod
    def of(cls, network: Described, flowing: Collection[str]) -> Couplings:
        """Return the couplings of a network, with some linear ones in the linear motion."""
        names, laws = tuple(network.couplings), same([item.law for item in network.couplings.values()])
        flags = of_classes(lambda kind: (kind.sticks, issubclass(kind, MatrixTerm)), laws)
        sticking, terms = np.array(flags, dtype=bool).reshape(-1, 2).T
        linear = np.array([law.linear for law in laws]).reshape(-1, 2).T
        return cls(names, laws, linear, np.array([name in flowing for name in names], dtype=bool), sticking, terms)


def same(items: Iterable[Result]) -> tuple[Result, ...]:
    """Return items, in the place of equal ones the first of these."""
    first: dict[Result, Result] = {}
    return tuple(of_objects(lambda item: first.setdefault(item, item), list(items)))


@dataclass(frozen=True, eq=False)
class Kicks:
    """Contacts, couplings that are not a part of the motion between kicks, and residual forces."""

    links: np.ndarray  # (link,) of bool, whether the contact or coupling is one of these forces
    bodies: np.ndarray  # (body,) of bool, whether one of them acts on it
    nonlinear: np.ndarray  # (body,) of bool, the same with couplings that stick
    passes: int
    """How often a kick evaluates forces with the velocities that they give; 0 where none depends on any. Contacts and
    residuals are solved for their own velocity, so that once will do where no two of them meet.
    """
    dissipative: bool  # whether one depends on velocities or states
    timed: np.ndarray  # (body,) of bool, whether one that depends on time acts on it
    rated: np.ndarray  # (contact,) of bool, whether it is not round, and depends on the rate of its indentation
    states: tuple[tuple[str, str], ...]
    """Labels of the states of laws, such as "spring.pull", and their units, in the order of `Members.states`."""
    state_ends: Pairs  # two bodies, or one and the wall, that the law of each state acts on

    @classmethod
    def of(cls, model: Model) -> Kicks:
        """Return the forces of a network."""
        members, bodies, couplings, ends, coupled = (
            model.members, model.bodies, model.couplings, model.ends, model.coupled,
        )  # fmt: skip
        wall, flowing, kicking = len(bodies), couplings.flowing, ~(couplings.flowing | couplings.sticking)
        slowed, states = [np.zeros(0, dtype=np.int64)], [np.zeros((0, 2), dtype=np.int64)]
        timed, rated = np.zeros(wall + 1, dtype=bool), np.zeros(len(ends), dtype=bool)
        dissipative = any(of_objects(lambda law: law.dissipative, list(compress(couplings.laws, ~flowing))))
        for kind, (leading, _) in zip(members.kinds, members.tables, strict=True):
            if kind.role not in LAWS:
                continue
            # slots that each member acts on, and two of them, or one and the wall
            slots = pairs = leading
            if kind.role == "residual":
                pairs = np.pad(leading, ((0, 0), (0, 1)), constant_values=wall)
            elif kind.role != "coupling":
                of_coupling = kind.role == "combination"
                links = coupled.chosen(leading[:, 0] - len(ends)) if of_coupling else ends.chosen(leading[:, 0])
                slots, pairs = links.slots, links.pairs
                if kind.states and not links.plain:
                    pairs = np.pad(links.first()[:, None], ((0, 0), (0, 1)), constant_values=wall)
            if kind.timed:
                timed[slots] = True
            if kind.rated:
                rated[leading[:, 0]] = True
            if kind.states:
                ends_of_runs = np.cumsum(runs(*leading.T)[-1])
                states += [part for part in np.split(pairs, ends_of_runs[:-1]) for _ in kind.states]
            if kind.role in ("coupling", "combination"):
                slowed += [slots.ravel()] * 2 if "rate" in kind.kinematic else []
                continue
            dissipative |= bool(kind.states) or kind.role == "rubbing" or kind.slows
            if kind.slows or kind.role == "rubbing":
                several = kind.role in ROUND  # links along x and y, which are solved together
                slowed += [np.unique(ends.chosen(row).slots) for row in leading[:, :1]] if several else [slots]
        numbers = np.bincount(np.concatenate([item.ravel() for item in slowed]), minlength=wall + 1)[:wall]
        kicked = np.append(bodies.residual, False)
        kicked[np.append(ends.slots, coupled.chosen(kicking).slots)] = True
        nonlinear = kicked.copy()
        nonlinear[coupled.chosen(couplings.sticking).slots] = True
        return cls(
            links=np.append(np.ones(len(ends), dtype=bool), kicking),
            bodies=kicked[:-1],
            nonlinear=nonlinear[:-1],
            passes=min(int(numbers.max()), 2) if dissipative else 0,
            dissipative=dissipative,
            timed=timed[:-1],
            rated=rated,
            states=_labels(model) if len(members.states) else (),
            state_ends=Pairs(wall, np.concatenate(states)),
        )


def _labels(model: Model) -> tuple[tuple[str, str], ...]:
    """Return `Kicks.states`."""
    contacts, couplings, bodies = model.contacts, model.couplings, model.bodies
    families = {"force": (contacts.names, contacts.laws), "residual": (bodies.names, bodies.oscillators)}
    result = []
    for kind, (leading, _) in zip(model.members.kinds, model.members.tables, strict=True):
        both = zip(*families.get(kind.role, (couplings.names, couplings.laws)), strict=True)
        owners = (name for name, law in both if type(law) is kind.component)
        for count in runs(*leading.T)[-1] if kind.states else ():
            names = list(islice(owners, int(count)))
            result += [(f"{name}.{state}", kind.component.units_of(state)) for state in kind.states for name in names]
    return tuple(result)


@dataclass(frozen=True, eq=False)
class Model:
    """A network as arrays.

    Bodies have slots 0 … n − 1 in the order of their names; slot n is the wall, a body
    that is always at rest at 0, so that walls need no code of their own.
    """

    network: Described  # where the model comes from
    wall: int  # slot of the wall, the number of bodies
    mass: np.ndarray  # (body,) of the linear part, as the next two (kg)
    damping: np.ndarray  # (N s m-1)
    stiffness: np.ndarray  # (N m-1)
    ends: Links  # what each contact acts along: its gap, but for the clearance
    clearance: np.ndarray  # (contact,) at rest (m)
    coupled: Links  # the same of the couplings; their extension is the negative of it
    bodies: Bodies
    contacts: Contacts
    couplings: Couplings
    sources: dict[str, Sources[Excitation]]
    """Excitations of each of `KINDS`."""
    members: Members  # contacts, other couplings, residual forces and functions of time, as generated loops take them

    @classmethod
    @uncollected()
    def of(cls, network: Described, flowing: Collection[str] = ()) -> Model:
        """Make the model of a network, with some linear couplings in the linear motion."""
        network.check_numbers()
        oscillators = list(network.oscillators.values())
        mass, damping, stiffness = (_numbers(oscillators, field) for field in ("mass", "damping", "stiffness"))
        slots = dict(zip(network.oscillators, range(len(oscillators)), strict=True))
        sources = _sources(network, slots)
        bodies, contacts, couplings = Bodies.of(network, sources), Contacts.of(network), Couplings.of(network, flowing)
        ends, coupled = _links(network, couplings.flowing, slots, mass)
        links = list(network.contacts.values())
        clearance = _numbers(links, "clearance")
        for slot in np.flatnonzero(contacts.round):
            clearance[slot] = links[slot].clearance_at_rest
        rows = _members(network, slots, bodies, contacts, couplings, ends, clearance, 1.0 / mass)
        rows |= _in_time(sources)
        return cls(
            network=network,
            wall=len(oscillators),
            mass=mass,
            damping=damping,
            stiffness=stiffness,
            ends=ends,
            clearance=clearance,
            coupled=coupled,
            bodies=bodies,
            contacts=contacts,
            couplings=couplings,
            sources=sources,
            members=Members.of(rows, ends, coupled),
        )

    @cached_property
    def mechanisms(self) -> tuple[Any, ...]:
        """Mechanisms of the network by name, each an `impactlab.assembly.mechanism.Mechanism`."""
        import_module("impactlab.mechanisms")  # late and by its name, since it stands above all stages
        return tuple(item for item in sorted(KNOWN, key=lambda item: item.name) if item.there(self))

    @cached_property
    def excitations(self) -> list[tuple[str, Excitation]]:
        """All excitations with the first of their names, those of each kind one after the other."""
        first: dict[int, tuple[str, Excitation]] = {}
        for kind in self.sources.values():
            for name, item in zip(kind.names, kind.excitations, strict=True):
                first.setdefault(id(item), (name, item))
        return list(first.values())

    @cached_property
    def links(self) -> Links:
        """Contacts, then couplings."""
        return joined(self.ends, self.coupled)

    @cached_property
    def kicks(self) -> Kicks:
        """The forces that are not a part of the motion between kicks."""
        return Kicks.of(self)

    @cached_property
    def noise(self) -> Noise:
        """Spectral densities of the white noises."""
        varying = any(kind.kinematic for kind in self.members.of_role("intensity"))
        return Noise.of(self.sources["intensity"], varying, len(self.mass))

    @cached_property
    def connected(self) -> np.ndarray:
        """Label of the connected part of each body, (body,) of int; walls and bodies of given motion do not connect."""
        return self.links.held(~self.bodies.free).parts

    @cached_property
    def random(self) -> np.ndarray:
        """Whether a noise acts on the connected part of each body, (body,) of bool."""
        noisy = self.noise.reference_intensity > 0.0
        noisy[[*self.bodies.sampled]] = True
        return np.isin(self.connected, self.connected[noisy])

    @cached_property
    def points(self) -> tuple[tuple[str, tuple[tuple[int, float], ...]], ...]:
        """Names of the points of structures, with the slots and weights of the bodies in each sum."""
        slots = {name: slot for slot, name in enumerate(self.bodies.names)}
        rows = self.network.points.items()
        return tuple((name, tuple((slots[body], share) for body, share in row.items())) for name, row in rows)

    def first_of(self, links: Links) -> np.ndarray:
        """Return the body of each link that has the lowest slot, of those whose motion is not given, (link,)."""
        result, free = links.first(), self.bodies.free
        if not free.all():
            lowest, moved = np.full(len(links), self.wall), np.append(free, False)[links.slots]
            np.minimum.at(lowest, links.rows[moved], links.slots[moved])
            result = np.where(lowest < self.wall, lowest, result)
        return result

    def touching(self) -> np.ndarray:
        """Label of the part of each body that contacts alone connect, (body,) of int."""
        return self.ends.held(~self.bodies.free).parts

    def coupled_parts(self) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Return slots, stiffness and damping matrix of the bodies that linear couplings connect, part by part.

        Bodies of given motion are as walls to them.
        """
        linear = np.asarray(self.couplings.linear.any(axis=0))
        if not linear.any():
            return []
        links, (stiffness, damping) = (
            self.coupled.chosen(linear).held(~self.bodies.free),
            self.couplings.linear[:, linear],
        )
        labels = links.parts
        part_of_link = labels[links.first()]
        result = []
        for part in np.unique(part_of_link):
            slots, rows = np.flatnonzero(labels == part), part_of_link == part
            k, c = (links.chosen(rows).springs(strength[rows], slots) for strength in (stiffness, damping))
            result.append((slots, k, c))
        return result


def _numbers(items: Sequence[Any], field: str) -> np.ndarray:
    """Return one field of each component as an array, (item,)."""
    if are_one(items):
        return np.full(len(items), getattr(items[0], field))
    return np.array(list(map(attrgetter(field), items)), dtype=float)


def _sources(network: Described, slots: Mapping[str, int]) -> dict[str, Sources[Excitation]]:
    """Return the excitations, grouped by the method that they define."""
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


def _links(network: Described, flowing: np.ndarray, slots: Mapping[str, int], mass: np.ndarray) -> tuple[Links, Links]:
    """Return contacts and couplings of bodies with some slots and masses as links.

    Both are pairs if all that kick are differences: combinations that flow are only terms of a matrix.
    """
    contacts: list[Contact | RoundContact]
    contacts, couplings = list(network.contacts.values()), list(network.couplings.values())
    plain = are_differences([*contacts, *compress(couplings, ~flowing)])

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
    """Return the slots of both sides, (link, 2); the slot of the wall follows the last body."""
    result, wall = np.empty((len(links), 2), dtype=np.int64), repeat(len(slots))
    for side, name in enumerate(("first", "second")):
        result[:, side] = list(map(slots.get, map(attrgetter(name), links), wall))
    return result


_IN_TIME = (
    ("forcing", ("force",), "force"),
    ("intensity", ("intensity",), "intensity"),
    ("modulation", SAMPLED, "modulation"),
)
"""Roles of functions of time, the kinds of excitation with each role, and the names of their kernels."""


def _of_kinds(
    role: str, components: Sequence[Any], kernel: str, indices: np.ndarray, *leading: np.ndarray,
    acting: np.ndarray | None = None,
) -> dict[Kind, Rows]:  # fmt: skip
    """Return members of some components, kind by kind; where it is said which are `acting`, without the others.

    Kinds without a member stay, so that the generated text does not depend on which of them act.
    """
    result: dict[Kind, Rows] = {}
    for kind, numbers in by_kind(role, components, kernel).items() if len(components) else ():
        chosen = numbers if acting is None else numbers[acting[numbers]]
        columns = [item[chosen] for item in leading[: len(kind.leading)]]
        table = np.stack(columns, axis=1) if columns else np.zeros((len(chosen), 0))
        of_kind = [components[number] for number in chosen.tolist()]
        result[kind] = Rows(of_kind, indices[chosen].reshape(len(chosen), len(LEADING[role])), table)
    return result


def _members(
    network: Described, slots: Mapping[str, int], bodies: Bodies, contacts: Contacts, couplings: Couplings,
    ends: Links, clearance: np.ndarray, mobility: np.ndarray,
) -> dict[Kind, Rows]:  # fmt: skip
    """Return contacts, couplings that do not stick, and residual forces, kind by kind."""
    straight = np.flatnonzero(~contacts.round)
    laws = list(map(contacts.laws.__getitem__, straight.tolist()))
    result = _of_kinds("force", laws, "force", straight, clearance[straight], ends.squares(mobility)[straight])
    if isinstance(ends, RoundLinks):
        result |= _in_plane(list(network.contacts.values()), ends, len(couplings.laws))
    numbers = np.flatnonzero(~couplings.sticking)
    kicking = ~couplings.flowing[numbers]
    role, indices = "combination", len(ends) + numbers
    if ends.plain:  # of a coupling that flows, which may have weights, nobody asks the ends
        items = list(network.couplings.values())
        role, indices = "coupling", np.zeros((len(numbers), 2), dtype=np.int64)
        indices[kicking] = _pairs(slots, [items[number] for number in numbers[kicking]])
    result |= _of_kinds(role, [couplings.laws[number] for number in numbers], "force", indices, acting=kicking)
    bent = np.flatnonzero(bodies.residual)
    return result | _of_kinds("residual", [bodies.oscillators[slot] for slot in bent], "residual", bent, mobility[bent])


def _in_plane(contacts: Sequence[Any], ends: RoundLinks, couplings: int) -> dict[Kind, Rows]:
    """Return contacts in a plane, kind by kind."""
    count, numbers = len(ends.round), np.arange(len(ends.round))
    links = len(ends) + couplings + numbers + count * np.arange(4)[:, None]
    mobility = ends.in_plane(ends.mobility)
    result: dict[Kind, Rows] = {}
    for role, rubbing in zip(ROUND, (False, True), strict=True):
        rows = np.flatnonzero([bool(contacts[slot].friction) is rubbing for slot in ends.round])
        chosen = [contacts[slot] for slot in ends.round[rows]]
        places = np.array([[item.clearance, *item.center] for item in chosen]).reshape(-1, 3).T
        sliding = np.array([[getattr(item, name) for name in SLIDING] for item in chosen]).reshape(-1, len(SLIDING)).T
        columns = np.concatenate([places, mobility[:, rows], sliding])
        indices = np.stack([ends.round, *links])[:, rows].T
        result |= _of_kinds(role, [item.law for item in chosen], "force", indices, *columns)
    return result


def _in_time(sources: Mapping[str, Sources[Excitation]]) -> dict[Kind, Rows]:
    """Return functions of time that excitations are made of, kind by kind."""
    result: dict[Kind, Rows] = {}
    for role, families, kernel in _IN_TIME:
        own = [item for kind in families for item in sources[kind].excitations]
        having = of_classes(lambda kind, kernel=kernel: kind.has_kernel(kernel), own)  # type: ignore[misc]
        excitations = list(compress(own, having))
        result |= _of_kinds(role, excitations, kernel, np.arange(len(excitations)))
    factors = [item.multiplied_by for item in sources["force"].excitations]
    products = np.flatnonzero([item is not None for item in factors])
    return result | _of_kinds("factor", [factors[row] for row in products], "force", products)
