"""From names to slots: a network as arrays of numbers. The only index arithmetic."""

from __future__ import annotations

import functools
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from impactlab.component import Component, call_each, finite
from impactlab.composition import Composition
from impactlab.contact import Wall
from impactlab.incidence import differences, gathering, runs

Result = TypeVar("Result")

PLACES, HEADER = 3, 2
"""Entries of `Model.indices` before those of the kinds, and for each kind."""

LEADING = {
    "force": ("slot",),
    "coupling": ("first", "second"),
    "residual": ("body",),
    "forcing": ("row",),
    "intensity": ("row",),
}
"""Indices of a member of each kind; 'force' is a contact's, 'forcing' an excitation's."""


@dataclass(frozen=True)
class Kind:
    """All members of a network with one class and one kernel: a loop in the generated text.

    Attributes
    ----------
    role : str
        A key of `LEADING`.
    component : type
        The class.
    kernel : str
        Name of its kernel.
    """

    role: str
    component: type[Component]
    kernel: str

    @property
    def kinematic(self) -> tuple[str, ...]:
        """Kinematic arguments that the kernel takes."""
        return self.component.kernel(self.kernel)[1]

    @property
    def fields(self) -> tuple[str, ...]:
        """Fields that the kernel takes."""
        return self.component.kernel(self.kernel)[2]

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters of a row."""
        leading = ("clearance",) if self.role == "force" else ()
        return (*leading, "mobility", *self.fields) if self.slows else (*leading, *self.fields)

    @property
    def slows(self) -> bool:
        """Whether the force of a contact or a residual depends on a velocity, which a kick then changes."""
        return not {"rate", "velocity"}.isdisjoint(self.kinematic) and self.role in ("force", "residual")


@dataclass(frozen=True, eq=False)
class Model:
    """A network as arrays.

    Bodies have slots 0 … n − 1 in the order of their names; slot n is the wall, a body
    that is always at rest at 0, so that walls need no code of their own.

    Attributes
    ----------
    network : Network
        Where the model comes from.
    bodies, contacts : tuple of str
        Names by slot.
    couplings : tuple of str
        Names of the couplings.
    mass, damping, stiffness : (body,) ndarray
        Linear part (kg, N s m-1, N m-1).
    ends : (contact, 2) ndarray of int
        Slots of the first and second body of each contact.
    clearance : (contact,) ndarray
        Clearances (m).
    coupled : (coupling, 2) ndarray of int
        Slots of the first and second body of each coupling.
    coupling : (2, coupling) ndarray
        Stiffness (N m-1) and damping (N s m-1) of the linear couplings, 0 for others.
    flowing : (coupling,) ndarray of bool
        Which of them an integrator treats as a part of the bodies' linear motion.
    kinds : tuple of Kind
        Kinds of non-linear members, in canonical order.
    tables : tuple
        Members of each kind.
    parameters : ndarray
        Parameters of all kinds, run by run, one name after the other.
    indices : ndarray of int
        Members whose indices follow each other make a run, along which loops vectorise. Three places:
        of what `impactlab.kernels.kick.differences` and `gather` read, and of `ends`; for each kind the number
        of its runs and the place of the first; then, at these places, the runs: indices of the
        first member, number of members, place of the parameters.
    white, lines, forced : tuple of int
        Slots of the bodies under white noise, under lines, and under a given force.
    """

    network: Composition
    bodies: tuple[str, ...]
    contacts: tuple[str, ...]
    couplings: tuple[str, ...]
    mass: np.ndarray
    damping: np.ndarray
    stiffness: np.ndarray
    ends: np.ndarray
    clearance: np.ndarray
    coupled: np.ndarray
    coupling: np.ndarray
    flowing: np.ndarray
    kinds: tuple[Kind, ...]
    tables: tuple[Table, ...]
    parameters: np.ndarray
    indices: np.ndarray
    white: tuple[int, ...]
    lines: tuple[int, ...]
    forced: tuple[int, ...]

    @classmethod
    def of(cls, network: Composition, flowing: Collection[str] = ()) -> Model:
        """Make the model of a network, with some linear couplings in the linear motion."""
        slots = {name: slot for slot, name in enumerate(network.oscillators)}
        bodies = list(network.oscillators.values())
        excited = {slots[name]: item for name, item in network.excitations.items()}
        by_kind = {kind: tuple(s for s in sorted(excited) if excited[s].kind == kind) for kind in _EXCITATIONS}

        def slot_of(body: str | Wall) -> int:
            return slots[body] if isinstance(body, str) else len(slots)

        ends, coupled = (
            [(slot_of(item.first), slot_of(item.second)) for item in links.values()]
            for links in (network.contacts, network.couplings)
        )
        inverse_mass = np.array([*(1.0 / body.mass for body in bodies), 0.0])  # a wall does not move
        members: dict[Kind, list[tuple[Component, tuple[int, ...], tuple[float, ...]]]] = {}
        for slot, contact in enumerate(network.contacts.values()):
            kind = Kind("force", type(contact.law), "force")
            mobility = float(inverse_mass[list(ends[slot])].sum())
            extra = (contact.clearance, mobility) if kind.slows else (contact.clearance,)
            members.setdefault(kind, []).append((contact.law, (slot,), extra))
        for (name, coupling), pair in zip(network.couplings.items(), coupled, strict=True):
            kind = Kind("coupling", type(coupling.law), "force")
            members.setdefault(kind, [])  # also without a row: the text does not depend on what flows
            if name not in flowing:
                members[kind].append((coupling.law, pair, ()))
        for slot, body in enumerate(bodies):
            if body.has_kernel("residual"):
                kind = Kind("residual", type(body), "residual")
                members.setdefault(kind, []).append((body, (slot,), (1.0 / body.mass,) if kind.slows else ()))
        for row, slot in enumerate(by_kind["force"]):
            item = excited[slot]
            members.setdefault(Kind("forcing", type(item), "force"), []).append((item, (row,), ()))
        for row, slot in enumerate(by_kind["intensity"]):
            item = excited[slot]
            members.setdefault(Kind("intensity", type(item), "intensity"), []).append((item, (row,), ()))
        kinds = tuple(sorted(members, key=lambda kind: (kind.role, kind.component.__name__, kind.component.__module__)))
        tables = _tables(kinds, members)
        parameters, indices = packed(tables, np.array(ends, dtype=np.int64).reshape(-1, 2), len(bodies))
        return cls(
            network=network,
            bodies=tuple(network.oscillators),
            contacts=tuple(network.contacts),
            couplings=tuple(network.couplings),
            mass=np.array([body.mass for body in bodies]),
            damping=np.array([body.damping for body in bodies]),
            stiffness=np.array([body.stiffness for body in bodies]),
            ends=np.array(ends, dtype=np.int64).reshape(-1, 2),
            clearance=np.array([contact.clearance for contact in network.contacts.values()]),
            coupled=np.array(coupled, dtype=np.int64).reshape(-1, 2),
            coupling=np.array([item.law.linear for item in network.couplings.values()]).reshape(-1, 2).T,
            flowing=np.array([name in flowing for name in network.couplings], dtype=bool),
            kinds=kinds,
            tables=tables,
            parameters=parameters,
            indices=indices,
            white=by_kind["intensity"],
            lines=by_kind["lines"],
            forced=by_kind["force"],
        )

    @property
    def natural_frequencies(self) -> np.ndarray:
        """Undamped natural frequencies of the bodies without contacts (rad s-1), (body,)."""
        return np.asarray(np.sqrt(self.stiffness / self.mass))

    @property
    def excited(self) -> np.ndarray:
        """Whether each body has an excitation, (body,) of bool."""
        result = np.zeros(len(self.bodies), dtype=bool)
        result[[*self.white, *self.lines, *self.forced]] = True
        return result

    @property
    def wall(self) -> int:
        """Slot of the wall."""
        return len(self.bodies)

    @property
    def links(self) -> np.ndarray:
        """Slots of the first and second body of each contact, then of each coupling, (link, 2)."""
        return np.concatenate([self.ends, self.coupled])

    @property
    def kicking(self) -> np.ndarray:
        """Whether each link is a force of its own, not a part of the linear motion, (link,) of bool."""
        return np.concatenate([np.ones(len(self.ends), dtype=bool), ~self.flowing])

    def of_links(self, strength: np.ndarray) -> np.ndarray:
        """Return the matrix of springs of some strengths in the places of the links, (body, body)."""
        return _springs(self.links, strength, np.arange(self.wall))

    def of_role(self, *roles: str) -> tuple[Kind, ...]:
        """Kinds of some roles."""
        return tuple(kind for kind in self.kinds if kind.role in roles)

    @property
    def passes(self) -> int:
        """How often a kick evaluates forces with the velocities that they give; 0 where none depends on any.

        Contacts and residuals are solved for their own velocity, so that once will do where no two of them meet.
        """
        slowed = [np.zeros(0, dtype=np.int64)]
        for kind, (leading, _) in zip(self.kinds, self.tables, strict=True):
            if kind.slows:
                slowed.append(self.ends[leading[:, 0]].ravel() if kind.role == "force" else leading[:, 0])
            elif kind.role == "coupling" and "rate" in kind.kinematic:
                slowed.append(np.repeat(leading, 2))
        numbers = np.bincount(np.concatenate(slowed), minlength=self.wall + 1)[: self.wall]
        return 0 if not self.dissipative else min(int(numbers.max()), 2)

    @property
    def dissipative(self) -> bool:
        """Whether a force of a contact, a coupling or a residual depends on velocities, except those that flow."""
        kinds = self.of_role("force", "residual")
        return any(not {"rate", "velocity"}.isdisjoint(kind.kinematic) for kind in kinds) or any(
            item.law.dissipative
            for item, flows in zip(self.network.couplings.values(), self.flowing, strict=True)
            if not flows
        )

    @property
    def only_touching(self) -> bool:
        """Whether bodies act on each other in contacts only, under noise and no other excitation."""
        return not (len(self.coupled) or self.lines or self.forced)

    @property
    def time_varying(self) -> bool:
        """Whether the intensity of a white noise depends on time."""
        return any(kind.kinematic for kind in self.of_role("intensity"))

    @property
    def nonlinear_bodies(self) -> np.ndarray:
        """Whether each body has contacts, couplings that do not flow, or a residual force, (body,) of bool."""
        result = np.zeros(len(self.bodies) + 1, dtype=bool)
        result[self.links[self.kicking].ravel()] = True
        result[:-1] |= self.residual
        return result[:-1]

    @property
    def residual(self) -> np.ndarray:
        """Whether each body has a residual force, (body,) of bool."""
        if not self.of_role("residual"):
            return np.zeros(len(self.bodies), dtype=bool)
        return np.array([body.has_kernel("residual") for body in self.network.oscillators.values()])

    def intensities(self, time: float = 0.0) -> np.ndarray:
        """Two-sided spectral density of the white noise on each body (N2 s rad-1), (body,)."""
        result = np.zeros(len(self.bodies))
        given = self.network.excitations
        excitations = [given[self.bodies[slot]] for slot in self.white]
        result[list(self.white)] = call_each(excitations, "intensity", np.full((len(excitations), 1), time))[:, 0]
        return result

    @cached_property
    def initial_intensities(self) -> np.ndarray:
        """Return :meth:`intensities` at time 0; not to be changed."""
        return self.intensities()

    def reference_intensities(self) -> np.ndarray:
        """Densities for which coefficients are made: the constant ones, 1 where they vary, (body,)."""
        if not self.time_varying:
            return self.initial_intensities
        result = np.zeros(len(self.bodies))
        result[list(self.white)] = 1.0
        return result

    def connected(self) -> np.ndarray:
        """Label of the connected part of each body, (body,) of int; walls do not connect."""
        return self._labels

    @property
    def random(self) -> np.ndarray:
        """Whether a noise acts on the connected part of each body, (body,) of bool."""
        noisy = self.reference_intensities() > 0.0
        noisy[list(self.lines)] = True
        labels = self.connected()
        return np.isin(labels, labels[noisy])

    def touching(self) -> np.ndarray:
        """Label of the part of each body that contacts alone connect, (body,) of int."""
        return connected_parts(len(self.bodies), self.ends)

    @cached_property
    def _labels(self) -> np.ndarray:
        return connected_parts(len(self.bodies), self.links)

    def coupled_parts(self) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Return slots, stiffness and damping matrix of the bodies that linear couplings connect, part by part."""
        linear = self.coupling.any(axis=0)
        pairs, (stiffness, damping) = self.coupled[linear], self.coupling[:, linear]
        labels = connected_parts(len(self.bodies), pairs)
        part_of_pair = labels[pairs.min(axis=1)]  # the wall has the largest slot
        result = []
        for part in np.unique(part_of_pair):
            slots, rows = np.flatnonzero(labels == part), part_of_pair == part
            k, c = (_springs(pairs[rows], strength[rows], slots) for strength in (stiffness, damping))
            result.append((slots, k, c))
        return result


def kept(function: Callable[..., Result]) -> Callable[..., Result]:
    """Keep what a function of a model and hashable arguments returns for as long as the model lives."""

    @functools.wraps(function)
    def known(model: Model, *arguments: Any) -> Result:
        results = model.__dict__.setdefault("_kept", {})
        key = function, *arguments
        if key not in results:
            results[key] = function(model, *arguments)
        return results[key]  # type: ignore[no-any-return]

    return known


def connected_parts(count: int, pairs: np.ndarray) -> np.ndarray:
    """Label of the connected part of each of some bodies, (body,) of int; walls do not connect."""
    first, second = pairs[(pairs < count).all(axis=1)].T
    parts = np.arange(count)
    while True:  # every body takes the smallest label in reach, which doubles each time
        before = parts.copy()
        lowest = np.minimum(parts[first], parts[second])
        for side in (parts[first], parts[second], first, second):
            np.minimum.at(parts, side, lowest)
        parts = parts[parts]
        if (parts == before).all():
            labels: np.ndarray = np.unique(parts, return_inverse=True)[1].reshape(-1)
            return labels


def _springs(pairs: np.ndarray, strength: np.ndarray, slots: np.ndarray) -> np.ndarray:
    """Matrix of springs between pairs of bodies with some slots, in increasing order, or a wall."""
    matrix = np.zeros((len(slots) + 1, len(slots) + 1))
    first, second = np.searchsorted(slots, pairs).T
    for row, column, sign in ((first, first, 1.0), (second, second, 1.0), (first, second, -1.0), (second, first, -1.0)):
        np.add.at(matrix, (row, column), sign * strength)
    return matrix[:-1, :-1]


_EXCITATIONS = ("intensity", "lines", "force")


Table = tuple[np.ndarray, np.ndarray]
"""Members of a kind: their indices, (member, leading), and their parameters, (member, parameter)."""


def _tables(
    kinds: Iterable[Kind], members: dict[Kind, list[tuple[Component, tuple[int, ...], tuple[float, ...]]]]
) -> tuple[Table, ...]:
    tables = []
    for kind in kinds:
        rows = members[kind]
        leading = np.array([row for _, row, _ in rows], dtype=np.int64).reshape(-1, len(LEADING[kind.role]))
        numbers = np.array([(*extra, *(_number(item, field) for field in kind.fields)) for item, _, extra in rows])
        tables.append((leading, numbers.reshape(len(rows), len(kind.parameters))))
    return tuple(tables)


def packed(
    members: Iterable[Table], ends: np.ndarray, bodies: int, order: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Lay out the runs of all kinds in one array of numbers and one of indices; see `Model`.

    The forces on a body are added in the order of the contacts, or in another `order`, (contact,).
    """
    tables, columns, header = [differences(ends), gathering(ends, bodies, order), ends.ravel()], [np.zeros(0)], []
    for leading, numbers in members:
        *begins, counts = runs(*leading.T)
        ends_of_runs = np.cumsum(counts)
        first = sum(map(len, columns)) + (ends_of_runs - counts) * numbers.shape[1]
        tables.append(np.stack([*begins, counts, first]).T.ravel())
        header.append(len(counts))
        columns += [part.T.ravel() for part in np.split(numbers, ends_of_runs[:-1])]
    places = PLACES + HEADER * len(header) + np.cumsum([0, *map(len, tables[:-1])])
    heads = [entry for pair in zip(header, places[PLACES:], strict=True) for entry in pair]
    return np.concatenate(columns), np.concatenate([places[:PLACES], heads, *tables]).astype(np.int64)


def _number(component: Component, field: str) -> float:
    """Return the value of a field that a kernel takes: a number or a truth value."""
    value = getattr(component, field)
    place = f"{type(component).__name__}.{field}, which a kernel takes,"
    return float(value) if isinstance(value, bool) else finite(place, value)
