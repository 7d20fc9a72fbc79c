"""Events that mechanisms locate within the flow of a step: their parts of a plan, and what a block has of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

import numpy as np

from impactlab.assembly.model import Model
from impactlab.compiling.own_memory import Stored, function_of
from impactlab.compiling.scalars import DISABLED
from impactlab.integrators.interval_arguments import Zeros
from impactlab.integrators.located import NO_FOLLOWER, OWN, Follower
from impactlab.plan.subdomains import Tile, refuse_to_cut


class Room(NamedTuple):
    """What a block offers to mechanisms that locate events in its steps."""

    lanes: int
    zeros: Zeros  # makes an array of a shape and a type
    closings: np.ndarray  # [contact, lane] sums of closings, to which a mechanism adds those that it locates
    depths: np.ndarray  # [contact, lane] indentations from which other closings are counted; nothing where they are not
    told: bool = False  # whether snapshots hold what events tell


class Times(NamedTuple):
    """Times of a run."""

    step: float  # (s)
    spin_up: int  # index of the step that begins at time 0


class Remarks(NamedTuple):
    """What is to be said of the events of a finished run."""

    warnings: list[tuple[str, str]]  # kinds, and messages
    thresholds: np.ndarray  # (contact,) closing velocity from which on closings count, NaN where all do (m s-1)
    comments: dict[str, str]  # of variables by their names


class EventPart:
    """The part of a plan of a mechanism that locates events; answers here are those of one that has none of its own."""

    record: ClassVar[type]
    """The type of its arrays in a block, a `NamedTuple`, of which the first field is the `WithinAddress`."""

    after_flow: ClassVar[Callable[..., None] | None] = None
    """What the mechanism does after the flow of a step: takes the address of its arrays and the number of the step."""

    after_kick: ClassVar[Callable[..., None] | None] = None
    """The same after the kick that ends the step."""

    after_step: ClassVar[Callable[..., None] | None] = None
    """The same when the step is done, where there are snapshots."""

    dissipative: bool = True
    """Whether the events may take energy."""

    order: float = 1.0
    """Power of the step with which the rate of events converges at least."""

    impulsive: np.ndarray = np.zeros(0, dtype=np.int64)
    """Slots of the impulsive contacts."""

    told: int = 0
    """Rows of what its events tell in snapshots, see `impactlab.results.snapshot.BY_IMPACTS`: of a field `shown` of its
    arrays, [1 + snapshot, row, lane], sums at first, then those at the snapshots of a call."""

    couplings: np.ndarray = np.zeros(0, dtype=np.int64)
    """Numbers of the couplings whose forces it makes."""

    def check(self, model: Model, displacement: np.ndarray) -> None:
        """Refuse a start, (body,) or (body, realization), that the mechanism does not allow."""

    def doubts(self, contacts: Sequence[str], step: float) -> list[tuple[str, str]]:
        """Return kinds and messages of warnings of what the steps of a run will not resolve."""
        return []

    def arrays(self, room: Room) -> Any:
        """Return the arrays of a block: a `record`."""
        raise NotImplementedError

    def opened(self, arrays: Any, realizations: np.ndarray, follower: Follower) -> Any:
        """Return the arrays of a block for its realizations, with who follows bodies through the steps."""
        return arrays

    def follower(self, arrays: Any, own: Any, single: bool) -> Follower | None:
        """Return how others tell the mechanism, if it follows bodies through the steps."""
        return None

    def under_noise(self, density: np.ndarray) -> dict[str, Any]:
        """Return fields of the arrays for steps in which white noises have mean spectral densities, (step, noise)."""
        return {}

    def begin(self, arrays: Any) -> None:
        """Forget the steps before, of which the block begins anew."""

    def lasting(self, arrays: Any) -> list[np.ndarray]:
        """Return the arrays that a step leaves to the next one, […, lane], which may be changed."""
        raise NotImplementedError

    def noted(self, arrays: Any) -> np.ndarray:
        """Return what the steps of a block have left to be said, (…, lane)."""
        return np.zeros((0, 0))

    def slow(self, noted: np.ndarray) -> np.ndarray:
        """Whether the rate of each of the contacts leaves out events that are too slow to count, (impulsive,)."""
        return np.zeros(len(self.impulsive), dtype=bool)

    def whole(self, finer: int, seen: float, slow: np.ndarray) -> np.ndarray:
        """Return the factor from the measured to the full bias of the rate of each contact, (impulsive,).

        Parameters
        ----------
        finer : int
            How many times shorter the steps are that were compared.
        seen : float
            Part of the bias of other statistics that is seen as a difference between the steps.
        slow : (impulsive,) ndarray of bool
            As :meth:`slow` returns.
        """
        return np.ones(len(self.impulsive))

    def push(self, pushes: np.ndarray, closings: np.ndarray) -> None:
        """Add to the numbers of independent pushes of each body, (body,), from those of closings, (contact,)."""

    def remarks(self, noted: np.ndarray, contacts: Sequence[str], times: Times, rates: bool) -> Remarks:
        """Return what is to be said of a run, from what all blocks have noted; of `rates`, where they are wanted."""
        return Remarks([], np.full(len(contacts), np.nan), {})


@dataclass(frozen=True, eq=False)
class Events:
    """Mechanisms of a run that locate events; those that strike bodies come after those that follow bodies."""

    parts: tuple[EventPart, ...]
    impulsive: np.ndarray = field(init=False)  # slots of the contacts whose forces are impulses
    dissipative: bool = field(init=False)  # whether events may take energy

    def __post_init__(self) -> None:
        impulsive = np.concatenate([EventPart.impulsive, *(part.impulsive for part in self.parts)])
        object.__setattr__(self, "impulsive", impulsive)
        object.__setattr__(self, "dissipative", any(part.dissipative for part in self.parts))

    @classmethod
    def of(cls, model: Model, step: float, seed: tuple[int, int], energy: np.ndarray | float = 0.0) -> Events:
        """Return the events of a model at a step (s), with the typical energies of its bodies (J)."""
        located = sorted((item for item in model.mechanisms if item.in_flow), key=lambda item: item.strikes)
        return cls(tuple(item.events(model, step, seed, energy) for item in located))

    @property
    def order(self) -> float:
        """Power of the step with which the rates of events converge at least; 1 where there are none."""
        return min([1.0, *(part.order for part in self.parts)])

    def whole(self, finer: int, seen: float, slow: np.ndarray) -> np.ndarray:
        """Return the factor from the measured to the full bias of the rate of each contact, (contact,).

        1 for a contact with a force; see `EventPart.whole`. Contacts are `slow` whose rate leaves out events.
        """
        result = np.ones(len(slow))
        for part in self.parts:
            result[part.impulsive] = part.whole(finer, seen, slow[part.impulsive])
        return result

    def slow(self, noted: Sequence[np.ndarray], contacts: int) -> np.ndarray:
        """Whether the rate of each contact leaves out events that are too slow to count, (contact,) of bool."""
        result = np.zeros(contacts, dtype=bool)
        for part, item in zip(self.parts, noted, strict=True):
            result[part.impulsive] |= part.slow(item)
        return result

    def remarks(
        self, noted: Sequence[Sequence[np.ndarray]], contacts: Sequence[str], times: Times, rates: bool = True
    ) -> Remarks:
        """Return what is to be said of a run, from what each block has noted of each part; of `rates` if wanted."""
        result = Remarks([], np.full(len(contacts), np.nan), {})
        for part, items in zip(self.parts, zip(*noted, strict=True), strict=True):
            said = part.remarks(np.concatenate(items, axis=-1), contacts, times, rates)
            result.warnings.extend(said.warnings)
            np.copyto(result.thresholds, said.thresholds, where=np.isfinite(said.thresholds))
            result.comments.update(said.comments)
        return result

    @property
    def told(self) -> int:
        """Rows of what events tell in snapshots."""
        return sum(part.told for part in self.parts)

    @property
    def losses(self) -> slice:
        """Which of these rows are the losses of the impacts of impulsive contacts."""
        begin = sum(part.told for part in self.parts if not len(part.impulsive))
        return slice(begin, begin + len(self.impulsive))

    @property
    def moments(self) -> slice:
        """Which are impulses times what was left of their steps."""
        return slice(self.losses.stop, self.losses.stop + len(self.impulsive))

    @property
    def works(self) -> list[tuple[np.ndarray, slice]]:
        """Numbers of couplings, then of contacts, and the rows of what their forces give to each of their bodies."""
        first, contacts = self.losses.start, self.impulsive
        couplings = np.concatenate([EventPart.couplings, *(part.couplings for part in self.parts)])
        return [(couplings, slice(first)), (contacts, slice(self.moments.stop, self.told))]

    def restricted(self, tile: Tile) -> Events:
        """Return itself where there are no events; else refuse."""
        refuse_to_cut(self, bool(self.parts))
        return self


class BlockEvents:
    """The events of a block: the arrays of its mechanisms, and the table by which the loop calls these.

    Parameters
    ----------
    events : Events
    arrays : tuple
        Arrays of each part.
    realizations : (lane,) ndarray
    single : bool
        Whether the block has one lane, in arrays without an axis of lanes.
    """

    def __init__(self, events: Events, arrays: tuple[Any, ...], realizations: np.ndarray, single: bool) -> None:
        self.parts = events.parts
        self._stored: list[Stored] = []
        self._told: list[tuple[np.ndarray, np.ndarray]] = []  # sums that are kept, and arrays of the present call
        opened, follower = [], NO_FOLLOWER
        for part, item in zip(self.parts, arrays, strict=True):
            opened.append(part.opened(item, realizations, follower))
            self._stored.append(Stored(opened[-1], single))
            follower = part.follower(opened[-1], self._stored[-1].address, single) or follower
        self.arrays = tuple(opened)
        # addresses of the arrays of the mechanisms, and of their functions; see `Tables.events`
        self.table = np.zeros((len(self.parts), 4), dtype=object if DISABLED else np.int64)
        for row, (part, stored) in enumerate(zip(self.parts, self._stored, strict=True)):
            functions = part.after_flow, part.after_kick, part.after_step
            self.table[row, OWN] = stored.address
            self.table[row, OWN + 1 :] = [function_of(part.record, function, single) for function in functions]

    def under_noise(self, density: np.ndarray) -> None:
        """Change the arrays for steps in which white noises have these mean spectral densities, (step, noise)."""
        for part, stored in zip(self.parts, self._stored, strict=True):
            stored.change(**part.under_noise(density))

    def open_told(self, snapshots: int) -> None:
        """Give room for what events tell in so many snapshots of the next steps."""
        self._told = []
        for part, item, stored in zip(self.parts, self.arrays, self._stored, strict=True):
            if part.told:
                more = np.zeros((snapshots, *item.shown.shape[1:]))
                self._told.append((item.shown, np.concatenate([item.shown, more])))
                stored.change(shown=self._told[-1][1])

    def take_told(self) -> np.ndarray:
        """Return what events have told in these snapshots, (snapshot, row, lane), and keep the sums for the next."""
        for kept, found in self._told:
            kept[0] = found[0]
        return np.concatenate([found[1:] for _, found in self._told], axis=1)

    def told(self) -> np.ndarray:
        """Return the sums of what events tell, (row, lane)."""
        return np.concatenate([item.shown[0] for part, item in zip(self.parts, self.arrays, strict=True) if part.told])

    def begin(self) -> None:
        """Forget the steps before."""
        for part, item in zip(self.parts, self.arrays, strict=True):
            part.begin(item)

    def lasting(self) -> list[np.ndarray]:
        """Return the arrays that a step leaves to the next one, […, lane], which may be changed."""
        both = zip(self.parts, self.arrays, strict=True)
        return [item for part, arrays in both for item in part.lasting(arrays)]

    def noted(self) -> tuple[np.ndarray, ...]:
        """Return what the steps have left to be said, of each part."""
        return tuple(part.noted(item) for part, item in zip(self.parts, self.arrays, strict=True))
