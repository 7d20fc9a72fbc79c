"""The non-linear members of a network, laid out for the loops of a generated module."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np

from impactlab.assembly.incidence import differences, gathering, runs
from impactlab.assembly.links import Combinations, Links, RoundLinks, joined
from impactlab.assembly.remembered import remembered
from impactlab.compiling.kernel_text import look_at
from impactlab.components.component import Component
from impactlab.components.evaluation import TIME, UPDATE, of_objects
from impactlab.inputs import finite

PLACES, HEADER = 3, 2
"""Entries of `Members.indices` before the entries of the kinds, and entries for each kind."""

LEADING = {
    "force": ("slot",),
    "coupling": ("first", "second"),
    "combination": ("link",),
    "residual": ("body",),
    "round": ("slot", "along_x", "along_y", "mobile_x", "mobile_y"),
    "rubbing": ("slot", "along_x", "along_y", "mobile_x", "mobile_y"),
    "forcing": ("row",),
    "factor": ("row",),
    "intensity": ("row",),
    "modulation": ("row",),
}
"""Indices of a member of each kind; 'force' is a contact's, 'forcing' an excitation's, 'factor' what that is multiplied
by, and 'combination' a coupling's where links have weights. 'round' are contacts in a plane, 'rubbing' those with
friction: their links along x and y, and the same times inverse masses."""


Table = tuple[np.ndarray, np.ndarray]
"""Members of a kind: their indices, (member, leading), and their parameters, (member, parameter)."""

LAWS = "force", "coupling", "combination", "residual", "round", "rubbing"
"""Roles of the kinds whose forces depend on the motion, which may have states."""

ROUND = "round", "rubbing"
"""Roles of contacts in a plane."""

SLIDING = "friction_coefficient", "surface_velocity", "friction_velocity"
"""Parameters of contacts with sliding friction: the fields of `impactlab.components.contact.SlidingFriction`."""


class Rows(NamedTuple):
    """Members of a kind."""

    components: Sequence[Component]
    indices: np.ndarray  # (member, leading)
    leading: np.ndarray  # (member, parameter) before those that are fields


@dataclass(frozen=True)
class Kind:
    """All members of a network with one class and one kernel: a loop in the generated text."""

    role: str  # a key of `LEADING`
    component: type[Component]
    kernel: str  # its name
    sampled: tuple[str, ...] = ()  # fields that are rows of numbers
    kinematic: tuple[str, ...] = field(init=False, compare=False)  # kinematic arguments that the kernel depends on
    states: tuple[str, ...] = field(init=False, compare=False)  # fields that are states
    reads_states: bool = field(init=False, compare=False)  # whether the kernel takes one
    kernels: tuple[str, ...] = field(init=False, compare=False)  # names of the kernels that loops over members call
    timed: bool = field(init=False, compare=False)  # whether it is a law that takes the time
    leading: tuple[str, ...] = field(init=False, compare=False)  # names of the parameters that precede the fields
    fields: tuple[str, ...] = field(init=False, compare=False)  # other fields that the kernels take
    slows: bool = field(init=False, compare=False)
    """Whether the force of a contact or a residual depends on a velocity, which a kick then changes."""
    rated: bool = field(init=False, compare=False)
    """Whether it is a contact force that depends on the rate, so that its peaks are read between steps."""

    @staticmethod
    def of(role: str, component: Component, kernel: str) -> Kind:
        """Return the kind of a member."""
        cls: Any = type(component)
        kind, fields = _without_samples(role, cls, kernel)
        sampled = tuple([name for name in fields if isinstance(getattr(component, name), tuple)])
        return replace(kind, sampled=sampled) if sampled else kind

    def __post_init__(self) -> None:
        component = self.component
        states = component.state_names() if self.role in LAWS else ()
        kernels = (self.kernel, UPDATE) if states else (self.kernel,)
        arguments = [component.arguments(name) for name in kernels]
        slows = not {"rate", "velocity"}.isdisjoint(arguments[0][0]) and self.role in ("force", "residual", *ROUND)
        taken = dict.fromkeys(name for _, fields in arguments for name in fields)
        leading: tuple[str, ...] = ("clearance",) if self.role == "force" else ()
        if self.role in ROUND:
            mobility = ("mobility_x", "mobility_y", "mobility_xy") * (slows or self.role == "rubbing")
            leading = "clearance", "center_x", "center_y", *mobility, *SLIDING * (self.role == "rubbing")
        elif slows:
            leading = *leading, "mobility"
        for name, value in {
            "kinematic": component.kernel(self.kernel)[1],
            "states": states,
            "reads_states": not set(arguments[0][1]).isdisjoint(states),
            "kernels": kernels,
            "timed": self.role in LAWS and any(TIME in own for own, _ in arguments),
            "leading": leading,
            "fields": tuple(name for name in taken if name not in states),
            "slows": slows,
            "rated": slows and self.role == "force",
        }.items():
            object.__setattr__(self, name, value)

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters of a row."""
        return (*self.leading, *self.fields)


@functools.cache
def _without_samples(role: str, component: type[Component], kernel: str) -> tuple[Kind, tuple[str, ...]]:
    """Return a kind, and its fields, which many members share.

    A kernel whose text says that it is no formula is refused, before anybody calls it.
    """
    kind = Kind(role, component, kernel)
    for name in kind.kernels if role != "intensity" or kind.kinematic else ():  # constant ones are numbers, not code
        look_at(getattr(component, name))
    return kind, kind.fields


@dataclass
class Samples:
    """Rows of numbers that kernels take as fields, one after the other; equal ones are there once."""

    end: int  # place behind the last one among the parameters
    places: dict[tuple[float, ...], int] = field(default_factory=dict)

    def place(self, row: tuple[float, ...]) -> int:
        """Return the place of a row, at the end if it is new."""
        if row not in self.places:
            self.places[row], self.end = self.end, self.end + len(row)
        return self.places[row]

    @property
    def numbers(self) -> np.ndarray:
        """Numbers of all members."""
        return np.array([number for row in self.places for number in row], dtype=float)


@dataclass(frozen=True, eq=False)
class Members:
    """Members whose kernels are called, by class."""

    kinds: tuple[Kind, ...]  # in canonical order
    tables: tuple[Table, ...]  # members of each kind
    parameters: np.ndarray
    """Parameters of all kinds, run by run, one name after the other; before them the weights of links, the centers of
    round links, and samples. A field that is a row of numbers is replaced by the place of the first number and the
    count.
    """
    indices: np.ndarray
    """Members whose indices follow each other make a run, along which loops vectorise. Three places: of the tables for
    `impactlab.kernels.kick.differences` and `gather`, and of the ends of contacts (with weights, of the tables for
    `impactlab.kernels.combinations`: links, nothing, and round links); for each kind the number of its runs and
    the place of the first; then, at these places, the runs: indices of the first member, number of members, place of
    the parameters and, of kinds that have them, of the states, in rows from the end.
    """
    states: np.ndarray  # states of all members at the start, run by run, one name after the other
    samples: np.ndarray  # numbers of all rows that are fields

    @classmethod
    def of(cls, rows: Mapping[Kind, Rows], ends: Links, coupled: Links) -> Members:
        """Lay out the members of each kind, with contacts and couplings along some links."""
        # intensities come last, so that all other loops are the same without noise
        key = attrgetter("role", "component.__name__", "component.__module__", "sampled")
        kinds = tuple(sorted(rows, key=lambda kind: (kind.role == "intensity", *key(kind))))
        links = ends if ends.plain else joined(ends, coupled)
        samples = Samples(len(_of_links(links)[1]) if isinstance(links, Combinations | RoundLinks) else 0)
        tables = tuple(_table(kind, rows[kind], samples) for kind in kinds)
        starts = [_numbers(rows[kind].components, kind.states) for kind in kinds]
        return cls(kinds, tables, *packed(tables, links, samples.numbers, starts=starts), samples.numbers)

    def of_role(self, *roles: str) -> tuple[Kind, ...]:
        """Return the kinds that have one of the given roles."""
        return tuple(kind for kind in self.kinds if kind.role in roles)


def by_kind(role: str, components: Sequence[Component], kernel: str) -> dict[Kind, np.ndarray]:
    """Return which components are of each kind, by their numbers."""
    kinds: dict[Kind, int] = {}
    places = of_objects(lambda component: kinds.setdefault(Kind.of(role, component, kernel), len(kinds)), components)
    which = np.array(places, dtype=np.int64)
    return {kind: np.flatnonzero(which == place) for kind, place in kinds.items()}


def _table(kind: Kind, rows: Rows, samples: Samples) -> Table:
    columns = [rows.leading.astype(float)]
    for name in kind.fields:
        if name in kind.sampled:
            values = [_row(item, name) for item in rows.components]
            columns.append(np.array([(samples.place(row), len(row)) for row in values], dtype=float).reshape(-1, 2))
        else:
            columns.append(_numbers(rows.components, (name,)))
    return rows.indices, np.concatenate(columns, axis=1)


def _numbers(components: Sequence[Component], fields: Sequence[str]) -> np.ndarray:
    """Return the values of some fields, (member, field)."""
    columns = [_column(components, field) for field in fields]
    return np.stack(columns, axis=1) if columns else np.zeros((len(components), 0))


def packed(
    members: Sequence[Table], links: Links, samples: np.ndarray, order: np.ndarray | None = None,
    starts: Sequence[np.ndarray] = (),
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Lay out the runs of all kinds in one array of numbers, one of indices and one of states; see `Members`.

    The forces on a body are added in the order of the contacts, or in another `order`, (contact,). States at the start
    are (member, state) of each kind, none where nothing is given.
    """
    columns, header = [np.zeros(0), samples], []
    if isinstance(links, Combinations | RoundLinks):
        (all_, rounds), columns[0] = _of_links(links)
        tables = [all_, all_[:0], rounds]
    else:
        tables = [*_of_pairs(links.pairs, links.count, order), links.pairs.ravel()]
    states, left = [np.zeros(0)], sum(start.size for start in starts)
    for kind, (leading, numbers) in enumerate(members):
        *begins, counts = _runs_of(leading)
        ends_of_runs = np.cumsum(counts)
        first = sum(map(len, columns)) + (ends_of_runs - counts) * numbers.shape[1]
        entries = [*begins, counts, first]
        columns += [part.T.ravel() for part in np.split(numbers, ends_of_runs[:-1])]
        if starts and starts[kind].shape[1]:
            entries.append(left - (ends_of_runs - counts) * starts[kind].shape[1])
            states += [part.T.ravel() for part in np.split(starts[kind], ends_of_runs[:-1])]
            left -= starts[kind].size
        tables.append(np.stack(entries).T.ravel())
        header.append(len(counts))
    places = PLACES + HEADER * len(header) + np.cumsum([0, *map(len, tables[:-1])])
    heads = [entry for pair in zip(header, places[PLACES:], strict=True) for entry in pair]
    indices = np.concatenate([places[:PLACES], heads, *tables]).astype(np.int64)
    return np.concatenate(columns), indices, np.concatenate(states)


@remembered
def _of_pairs(pairs: np.ndarray, count: int, order: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """Return the indices by which loops read contacts between pairs of `count` bodies."""
    return differences(pairs), gathering(pairs, count, order)


@remembered
def _runs_of(leading: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return where runs of members begin, by their indices, and their lengths."""
    return tuple(runs(*leading.T))


def _of_links(links: Combinations | RoundLinks) -> tuple[list[np.ndarray], np.ndarray]:
    """Return two tables of links with weights, and their numbers: weights, and centers of round ones.

    The first table describes all links. The second describes the round ones: how many there are, and three entries for
    each.
    """
    if isinstance(links, RoundLinks):
        all_, rounds, centers = links.laid_out()
    else:
        all_, rounds, centers = links, np.zeros((0, 3), dtype=np.int64), np.zeros(0)
    table = np.concatenate([[len(all_) + 2], all_.begin, all_.slots])
    return [table, np.append(len(rounds), rounds)], np.concatenate([all_.weights, centers.ravel()])


def _column(components: Sequence[Component], field: str) -> np.ndarray:
    """Return the values of a field, (member,)."""
    values = of_objects(attrgetter(field), components)
    result = np.array(values) if {float}.issuperset(map(type, values)) else np.array([np.nan])
    if not np.isfinite(result).all():  # or no floats: one by one
        result = np.array([_number(item, field) for item in components])
    return result.astype(float)


def _number(component: Component, field: str) -> float:
    """Return the value of a field that a kernel takes: a number or a truth value."""
    value = getattr(component, field)
    return float(value) if isinstance(value, bool) else finite(_taken(component, field), value)


def _row(component: Component, field: str) -> tuple[float, ...]:
    """Return the numbers of a field that a kernel takes as a row of them."""
    place = _taken(component, field)
    return tuple(finite(f"{place} of which each number", value) for value in getattr(component, field))


def _taken(component: Component, field: str) -> str:
    return f"{type(component).__name__}.{field}, which a kernel takes,"
