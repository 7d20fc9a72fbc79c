"""Quantities of one's own: where their arguments come from, and their values in snapshots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from impactlab.assembly.model import Model
from impactlab.errors import InvalidInput
from impactlab.inputs import suggestion
from impactlab.kernels.turning_points import sum_rows
from impactlab.records.accounted_network import OfNetwork
from impactlab.records.formulas import COLUMN, NUMBER, Evaluate, evaluator
from impactlab.records.links_in_snapshots import LinksInSnapshots
from impactlab.results.schema import BODY, CONTACT
from impactlab.results.snapshot import places_of

KERNEL, NETWORK, COUPLING = "kernel", "network", "coupling"

MOTION = {
    CONTACT: ("indentation", "gap", "rate", "force"),
    BODY: ("displacement", "velocity"),
    COUPLING: ("extension", "rate", "force"),
}
"""What a kernel may take of each place, beside fields and states of its law, and the time."""

MEANS, EXTREMES = ("mean", "mean square"), ("largest", "smallest")
"""What is found of a quantity, besides its density."""

WithError = tuple[np.ndarray, np.ndarray]
"""Value and error, (place,) each."""


class Places(NamedTuple):
    """The places at which a quantity is looked at, and where the arguments of its kernel come from; plain data."""

    labels: tuple[str, ...]
    slots: np.ndarray  # (place,) among all contacts, bodies or couplings
    columns: tuple[tuple[str, Any], ...]  # of the motion by name, or "state" with the row of each place
    sources: tuple[str, ...]  # of the arguments, see `impactlab.records.formulas`
    numbers: np.ndarray  # (place, number)
    near: np.ndarray  # (pair, 2) of a place and a body whose balance tells of it
    network: OfNetwork

    @classmethod
    def of(cls, record: Any, arguments: Sequence[str], model: Model, span: tuple[float, float]) -> Places:
        """Return the places of a record in a network, for a run between two times (s); refuse unknown arguments."""
        network = OfNetwork.of(model, max(span[0], 0.0), span[1])
        if record.per == NETWORK:
            return _of_whole(record, arguments, model, network)
        names, laws = _members(record.per, model)
        motion = (*MOTION[record.per], "time")
        hard = model.contacts.impulsive if record.per == CONTACT and "force" in arguments else np.zeros(len(names))
        soft = [pair for pair, without in zip(zip(names, laws, strict=True), hard, strict=True) if not without]
        having = _having(record, arguments, motion, names, dict(soft))
        places = places_of(names)
        slots = np.array([places[name] for name in having])
        chosen = [laws[slot] for slot in slots]
        columns, sources, numbers = _sources(arguments, motion, having, chosen, model)
        return cls(tuple(having), slots, columns, sources, numbers, _near(record.per, slots, model), network)


def _having(
    record: Any, arguments: Sequence[str], motion: Sequence[str], names: Sequence[str], laws: Mapping[str, Any]
) -> list[str]:
    """Return the places whose laws have all that a kernel takes, or refuse it; rigid contacts have no force."""
    known = {name: set(_numbers_of(type(law))) for name, law in laws.items()}
    wanted = [item for item in arguments if item not in motion]
    for name in record.labels or ():
        if name not in names:
            hint = suggestion(name, names)
            raise InvalidInput(f"Observable {record.name!r}: there is no {record.per} {name!r}; {hint}")
    for name in record.labels or names[: 0 if known else 1]:
        if name not in known:
            raise InvalidInput(
                f"Observable {record.name!r} takes the force of {name!r}, a rigid contact, which has impulses; take "
                "its gap or rate, or use il.Impacts or il.EnergyFlows."
            )
    having = [name for name in record.labels or known if known[name].issuperset(wanted)]
    if having and len(having) == len(record.labels or having):
        return having
    every = [*motion, *sorted(set().union(*known.values()))]
    reason = f"takes {', '.join(wanted)}, which no law has" if names else f"looks at no {record.per}: there is none"
    for lost in (item for item in wanted if item not in every):
        reason = f"takes {lost!r}; {suggestion(lost, every)}"
    raise InvalidInput(f"Observable {record.name!r} {reason}")


def _members(per: str, model: Model) -> tuple[tuple[str, ...], Sequence[Any]]:
    """Return the names of all places, and their laws or oscillators."""
    if per == BODY:
        return model.bodies.names, model.bodies.oscillators
    links = model.contacts if per == CONTACT else model.couplings
    return links.names, links.laws


def _numbers_of(kind: Any) -> list[str]:
    """Return the fields of a class that a kernel may take: numbers and states."""
    return [name for name in kind.field_names() if _is_number(kind, name)]


def _is_number(kind: Any, name: str) -> bool:
    return kind.__dataclass_fields__[name].type in ("float", "int", float, int)


def _sources(
    arguments: Sequence[str], motion: Sequence[str], names: Sequence[str], laws: Sequence[Any], model: Model
) -> tuple[tuple[tuple[str, Any], ...], tuple[str, ...], np.ndarray]:
    """Return the columns of a kernel, where its arguments come from, and the numbers of all places."""
    rows = places_of([name for name, _ in model.kicks.states])
    columns: list[tuple[str, Any]] = []
    sources: list[str] = []
    numbers: list[list[float]] = []
    for item in arguments:
        if item in motion or all(item in type(law).state_names() for law in laws):
            own = None if item in motion else np.array([rows[f"{name}.{item}"] for name in names])
            sources.append(COLUMN.format(len(columns)))
            columns.append((item if own is None else "state", own))
        else:
            sources.append(NUMBER.format(len(numbers)))
            numbers.append([float(getattr(law, item)) for law in laws])
    return tuple(columns), tuple(sources), np.array(numbers).reshape(-1, len(laws)).T.copy()


def _near(per: str, slots: np.ndarray, model: Model) -> np.ndarray:
    """Return pairs of a place and a body whose balance tells of it."""
    if per == BODY:
        return np.stack([np.arange(len(slots)), slots], axis=1)
    links = model.ends if per == CONTACT else model.coupled
    bodies, _, rows = links.moving()
    pairs = [(place, body) for place, slot in enumerate(slots.tolist()) for body in bodies[rows == slot].tolist()]
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def _of_whole(record: Any, arguments: Sequence[str], model: Model, network: OfNetwork) -> Places:
    """Return the one place of a quantity of the whole network."""
    known: dict[str, tuple[str, Any]] = {"time": ("time", None)}
    for quantity, names in (
        ("displacement", model.bodies.names), ("velocity", model.bodies.names), ("force", model.contacts.names)
    ):  # fmt: skip
        for slot, name in enumerate(names):
            if quantity != "force" or not model.contacts.impulsive[slot]:
                known[f"{quantity}_{name.replace('.', '_')}"] = quantity, np.array([slot])
    for item in arguments:
        if item not in known:
            raise InvalidInput(f"Observable {record.name!r} takes {item!r}; {suggestion(item, known)}")
    columns = tuple(known[item] for item in arguments)
    sources = tuple(COLUMN.format(place) for place in range(len(arguments)))
    near = np.array([(0, slot) for kind, own in columns if kind != "force" and own is not None for slot in own])
    pairs = np.unique(near.reshape(-1, 2), axis=0).astype(np.int64)
    return Places((NETWORK,), np.zeros(1, dtype=np.int64), columns, sources, np.zeros((1, 0)), pairs, network)


class Quantity:
    """A quantity of one's own as a function of snapshots.

    Parameters
    ----------
    record : Observable
    links : LinksInSnapshots
    """

    def __init__(self, record: Any, links: LinksInSnapshots) -> None:
        self.record, self.links, self.places = record, links, record.of_network
        self.sums = [self._sum(kind, rows) for kind, rows in self.places.columns]

    @cached_property
    def evaluate(self) -> Evaluate:
        """The compiled kernel."""
        return evaluator(self.record.formula, KERNEL, self.places.sources)

    @property
    def rows(self) -> np.ndarray | None:
        """Rows of snapshots that it reads, if they are known."""
        kinds = [kind for kind, _ in self.places.columns]
        if any(item is None and kind != "time" for item, kind in zip(self.sums, kinds, strict=True)):
            return None
        return np.concatenate([np.zeros(0, dtype=np.int64), *(item[1] for item in self.sums if item)])

    def __call__(self, own: np.ndarray, times: np.ndarray, realizations: np.ndarray) -> np.ndarray:
        """Return the quantity in some snapshots, (place, sample, lane); a value that is not finite is an error."""
        places, own = self.places, np.ascontiguousarray(own)
        shape = len(places.labels), len(own), own.shape[2]
        packed, values = np.empty((len(places.columns), *shape)), np.empty(shape)
        for column, summed, (kind, _) in zip(packed, self.sums, places.columns, strict=True):
            if summed is None:
                column[:] = self._column(kind, own, times).transpose(1, 0, 2)
            else:
                sum_rows(own, *summed, column)
            if kind in ("gap", "indentation"):
                column -= places.network.clearance[places.slots, None, None]
            if kind == "indentation":
                np.maximum(column, 0.0, out=column)
        flat = shape[0], shape[1] * shape[2]
        self.evaluate(packed.reshape(len(packed), *flat), places.numbers, values.reshape(flat))
        if not np.isfinite(values).all():
            row, sample, lane = np.argwhere(~np.isfinite(values))[0]
            where = "" if self.record.per == NETWORK else f" at the {self.record.per} {places.labels[row]!r}"
            raise InvalidInput(
                f"Observable {self.record.name!r} is {values[row, sample, lane]:g}{where} of realization "
                f"{int(realizations[lane])} at t = {times[sample]:g} s; correct its kernel for what happens there."
            )
        return values

    def _sum(self, kind: str, rows: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """Return an argument of the kernel as a weighted sum of rows of snapshots, see `sum_rows`, if it is one."""
        links, per, slots = self.links, self.record.per, self.places.slots
        if kind == "time" or (kind == "force" and per == COUPLING):
            return None
        if kind in ("gap", "indentation", "extension", "rate"):
            round_ = links.network.in_plane is not None and per == CONTACT
            return None if round_ else links.sums(slots, int(kind == "rate"), per == COUPLING)
        part = {"displacement": links.x, "velocity": links.v, "force": links.forces, "state": links.states}[kind]
        own = part.start + (slots if rows is None else rows)
        return np.arange(len(own) + 1), own, np.ones(len(own))

    def _column(self, kind: str, own: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Return an argument of the kernel that is no weighted sum of rows at all places, (sample, place, lane)."""
        slots = self.places.slots
        if kind == "time":
            return np.broadcast_to(times[:, None, None], (len(own), len(slots), own.shape[2]))
        found = -self.links.pulls(own, times) if kind == "force" else self.links.along(own, int(kind == "rate"), False)
        return np.asarray(found[:, slots])
