"""What contacts and couplings act along: the elongation of a link is a combination ``w·q`` of coordinates."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import ClassVar, NamedTuple

import numpy as np

from impactlab.assembly.remembered import remembered


class Exchanges(NamedTuple):
    """Pairs of coordinates that exchange energy along links, (pair,) each."""

    first: np.ndarray
    second: np.ndarray
    rows: np.ndarray  # the link
    share: np.ndarray  # part of the difference of their energies that they exchange in a collision, on average


class Links(ABC):
    """Contacts or couplings. A force F along a link of the elongation ``w·q`` pushes the coordinates q by −w F.

    Attributes
    ----------
    count : int
        Number of coordinates; a slot of this number is the wall, which is always at 0.
    slots : (entry,) ndarray of int
        Coordinates of all links, link by link.
    weights : (entry,) ndarray
        Their weights.
    pairs : (pair, 2) ndarray of int
        Slots that links connect, two by two; for plain links the slots with the weights 1 and −1.
    """

    count: int
    slots: np.ndarray
    weights: np.ndarray
    pairs: np.ndarray

    plain: ClassVar[bool]
    """Whether each link is the difference of two coordinates, or of one and the wall."""

    @abstractmethod
    def __len__(self) -> int: ...

    @property
    @abstractmethod
    def rows(self) -> np.ndarray:
        """Link of each entry, (entry,)."""

    @cached_property
    def parts(self) -> np.ndarray:
        """Label of the connected part of each coordinate, (coordinate,) of int, read-only; walls do not connect."""
        return _parts(self.pairs, self.count)

    @abstractmethod
    def chosen(self, rows: np.ndarray | slice) -> Links:
        """Return the chosen links."""

    @abstractmethod
    def gap(self, q: np.ndarray) -> np.ndarray:
        """Return the elongations ``w·q``, (link, …), from (coordinate, …) with or without the wall."""

    def rates(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the rates of the elongations at given displacements and velocities, (link, …)."""
        return self.gap(v)

    @abstractmethod
    def squares(self, values: np.ndarray) -> np.ndarray:
        """Return ``Σ w² a`` of values a of the coordinates, (link,).

        Of inverse masses it is the inverse mass along a link, of compliances its compliance, of variances of
        independent coordinates the variance of its elongation.
        """

    @abstractmethod
    def others(self, values: np.ndarray) -> np.ndarray:
        """Return the same without the coordinate of each entry, (entry,)."""

    @abstractmethod
    def mixed(self, covariance: np.ndarray, slots: np.ndarray) -> np.ndarray:
        """Return ``Σ w_i w_j C_ij`` over different coordinates among some slots of the covariance C, (link,)."""

    @abstractmethod
    def with_strengths(self, values: np.ndarray, strength: np.ndarray) -> np.ndarray:
        """Return values of the coordinates plus the diagonal of :meth:`springs`, (coordinate,)."""

    @abstractmethod
    def pushes(self, force: np.ndarray) -> np.ndarray:
        """Return the force ``−Σ w F`` on each coordinate, (coordinate,)."""

    def moving(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the coordinates of all links without walls, their weights, and the links that they are of, in turn."""
        free = self.slots < self.count
        return self.slots[free], self.weights[free], self.rows[free]

    @abstractmethod
    def first(self) -> np.ndarray:
        """Return the coordinate of each link that has the lowest slot, (link,)."""

    @abstractmethod
    def largest(self, values: np.ndarray, wall: float = 0.0) -> np.ndarray:
        """Return the largest value among the coordinates of each link and the wall, (link,)."""

    @abstractmethod
    def springs(self, strength: np.ndarray, slots: np.ndarray | None = None) -> np.ndarray:
        """Return the matrix ``Σ k w wᵀ`` of springs of some strengths k.

        Rows and columns are all coordinates, or the given `slots` in increasing order, which must hold all links.
        """

    @abstractmethod
    def with_row_sums(self, values: np.ndarray, strength: np.ndarray, inverse_mass: np.ndarray) -> np.ndarray:
        """Return values of the coordinates plus the sums of ``|M^-1/2 Σ k w wᵀ M^-1/2|`` over rows, (coordinate,)."""

    @abstractmethod
    def exchanges(self, mass: np.ndarray) -> Exchanges:
        """Return which coordinates exchange energy along links; a wall takes nothing."""

    @abstractmethod
    def held(self, flags: np.ndarray) -> Links:
        """Return the links with the flagged coordinates fixed like a wall."""

    def any(self, flags: np.ndarray) -> np.ndarray:
        """Whether each link has a coordinate with a flag, (link,) of bool."""
        return self.largest(flags.astype(float)) > 0.0

    def all(self, flags: np.ndarray) -> np.ndarray:
        """Whether all coordinates of each link have a flag, (link,) of bool."""
        return ~self.any(~flags)

    def numbers(self) -> np.ndarray:
        """Return the number of links of each coordinate, (coordinate,)."""
        return np.bincount(self.slots, minlength=self.count + 1)[: self.count]

    def coordinates(self) -> np.ndarray:
        """Return the slots of all coordinates that are on a link, in increasing order."""
        return np.flatnonzero(self.numbers())


@dataclass(frozen=True, eq=False)
class Pairs(Links):
    """Links that are the difference of two coordinates, or of one and the wall.

    Their `pairs` are (link, 2).
    """

    count: int
    pairs: np.ndarray
    slots: np.ndarray = field(init=False)
    weights: np.ndarray = field(init=False)

    plain: ClassVar[bool] = True

    def __post_init__(self) -> None:
        weights = np.ones(self.pairs.size)
        weights[1::2] = -1.0
        object.__setattr__(self, "slots", self.pairs.ravel())
        object.__setattr__(self, "weights", weights)

    def __len__(self) -> int:
        return len(self.pairs)

    @property
    def rows(self) -> np.ndarray:
        return np.repeat(np.arange(len(self.pairs)), 2)

    def chosen(self, rows: np.ndarray | slice) -> Pairs:
        return Pairs(self.count, self.pairs[rows])

    def held(self, flags: np.ndarray) -> Pairs:
        fixed = np.append(flags, False)[self.pairs]
        return Pairs(self.count, np.where(fixed, self.count, self.pairs)) if flags.any() else self

    def gap(self, q: np.ndarray) -> np.ndarray:
        first, second = self.pairs.T
        if len(q) == self.count:
            q = np.concatenate([q, np.zeros_like(q[:1])])
        return np.asarray(q[first] - q[second])

    def squares(self, values: np.ndarray) -> np.ndarray:
        first, second = np.append(values, 0.0)[self.pairs.T]
        return np.asarray(first + second)

    def others(self, values: np.ndarray) -> np.ndarray:
        return np.asarray(np.append(values, 0.0)[self.pairs[:, ::-1]].ravel())

    def mixed(self, covariance: np.ndarray, slots: np.ndarray) -> np.ndarray:
        place = np.full(self.count + 1, -1)
        place[slots] = np.arange(len(slots))
        first, second = place[self.pairs].T
        return np.where((first >= 0) & (second >= 0), -2.0 * covariance[first, second], 0.0)

    def with_strengths(self, values: np.ndarray, strength: np.ndarray) -> np.ndarray:
        result = np.append(values, 0.0)
        for side in self.pairs.T:
            np.add.at(result, side, strength)
        return result[:-1]

    def pushes(self, force: np.ndarray) -> np.ndarray:
        result = np.zeros(self.count + 1)
        for side, pushed in zip(self.pairs.T, (-force, force), strict=True):
            np.add.at(result, side, pushed)
        return result[:-1]

    def first(self) -> np.ndarray:
        return np.asarray(np.minimum(*self.pairs.T))

    def largest(self, values: np.ndarray, wall: float = 0.0) -> np.ndarray:
        return np.asarray(np.maximum(np.maximum(*np.append(values, wall)[self.pairs.T]), wall))

    def springs(self, strength: np.ndarray, slots: np.ndarray | None = None) -> np.ndarray:
        slots = np.arange(self.count) if slots is None else slots
        matrix = np.zeros((len(slots) + 1, len(slots) + 1))
        one, two = np.searchsorted(slots, self.pairs).T  # the wall has the largest slot
        for row, column, sign in ((one, one, 1.0), (two, two, 1.0), (one, two, -1.0), (two, one, -1.0)):
            np.add.at(matrix, (row, column), sign * strength)
        return matrix[:-1, :-1]

    def with_row_sums(self, values: np.ndarray, strength: np.ndarray, inverse_mass: np.ndarray) -> np.ndarray:
        first, second = self.pairs.T
        result, inverse = np.append(values, 0.0), np.append(inverse_mass, 0.0)
        between = strength * np.sqrt(inverse[first] * inverse[second])
        for side in (first, second):
            np.add.at(result, side, strength * inverse[side] + between)
        return result[:-1]

    def exchanges(self, mass: np.ndarray) -> Exchanges:
        rows = np.flatnonzero((self.pairs < self.count).all(axis=1))
        first, second = self.pairs[rows].T
        of_both = mass[self.pairs[rows]]
        return Exchanges(first, second, rows, 4.0 / (2.0 + of_both / of_both[:, ::-1]).sum(axis=1))


@dataclass(frozen=True, eq=False)
class Combinations(Links):
    """Links with weights of their own, of one coordinate or more; the wall has none.

    Attributes
    ----------
    begin : (link + 1,) ndarray of int
        Where the entries of each link begin.
    """

    count: int
    begin: np.ndarray
    slots: np.ndarray
    weights: np.ndarray
    pairs: np.ndarray = field(init=False)

    plain: ClassVar[bool] = False

    def __post_init__(self) -> None:
        first = np.flatnonzero(np.diff(self.rows) == 0)  # each coordinate and the next
        object.__setattr__(self, "pairs", np.stack([self.slots[first], self.slots[first + 1]], axis=1))

    @classmethod
    def of(cls, combinations: Sequence[Mapping[int, float]], count: int) -> Combinations:
        """Make links of weights by slot."""
        return cls(
            count,
            np.cumsum([0, *map(len, combinations)]),
            np.array([slot for item in combinations for slot in item], dtype=np.int64),
            np.array([weight for item in combinations for weight in item.values()], dtype=float),
        )

    def __len__(self) -> int:
        return len(self.begin) - 1

    @property
    def rows(self) -> np.ndarray:
        return np.repeat(np.arange(len(self)), np.diff(self.begin))

    def chosen(self, rows: np.ndarray | slice) -> Combinations:
        numbers, first = np.diff(self.begin)[rows], self.begin[:-1][rows]
        begin = np.append(0, np.cumsum(numbers))
        entries = np.repeat(first - begin[:-1], numbers) + np.arange(begin[-1])
        return Combinations(self.count, begin, self.slots[entries], self.weights[entries])

    def held(self, flags: np.ndarray) -> Combinations:
        if not flags.any():
            return self
        moving = ~flags[self.slots]
        begin = np.append(0, np.cumsum(np.bincount(self.rows[moving], minlength=len(self))))
        return Combinations(self.count, begin, self.slots[moving], self.weights[moving])

    def gap(self, q: np.ndarray) -> np.ndarray:
        return self._sums(self.weights.reshape(-1, *[1] * (q.ndim - 1)) * q[self.slots])

    def squares(self, values: np.ndarray) -> np.ndarray:
        return self._sums(self.weights**2 * values[self.slots])

    def others(self, values: np.ndarray) -> np.ndarray:
        entries = np.split(self.weights**2 * values[self.slots], self.begin[1:-1])
        rest = [np.delete(item, place).sum() for item in entries for place in range(len(item))]
        return np.array(rest, dtype=float)

    def mixed(self, covariance: np.ndarray, slots: np.ndarray) -> np.ndarray:
        place, matrix = np.full(self.count, -1), np.zeros((len(self), len(slots)))
        place[slots] = np.arange(len(slots))
        inside = np.flatnonzero(place[self.slots] >= 0)
        matrix[self.rows[inside], place[self.slots[inside]]] = self.weights[inside]
        between = covariance - np.diag(np.diagonal(covariance))
        return np.asarray(np.einsum("ri,ij,rj->r", matrix, between, matrix))

    def with_strengths(self, values: np.ndarray, strength: np.ndarray) -> np.ndarray:
        return values + np.bincount(self.slots, self.weights**2 * strength[self.rows], self.count)

    def pushes(self, force: np.ndarray) -> np.ndarray:
        return np.bincount(self.slots, -self.weights * force[self.rows], self.count)

    def first(self) -> np.ndarray:
        return np.minimum.reduceat(self.slots, self.begin[:-1])

    def largest(self, values: np.ndarray, wall: float = 0.0) -> np.ndarray:
        return np.maximum(np.maximum.reduceat(values[self.slots], self.begin[:-1]), wall)

    def springs(self, strength: np.ndarray, slots: np.ndarray | None = None) -> np.ndarray:
        matrix = self.matrix(np.arange(self.count) if slots is None else slots)
        return np.asarray((matrix.T * strength) @ matrix)

    def with_row_sums(self, values: np.ndarray, strength: np.ndarray, inverse_mass: np.ndarray) -> np.ndarray:
        size = np.abs(self.weights) * np.sqrt(inverse_mass[self.slots])
        return values + np.bincount(self.slots, size * (strength * self._sums(size))[self.rows], self.count)

    def exchanges(self, mass: np.ndarray) -> Exchanges:
        """See `Links.exchanges`: of the parts p of the inverse mass along a link, two have exchanged ``4 p₁p₂``."""
        part = self.weights**2 / mass[self.slots]
        part /= self._sums(part)[self.rows]
        places = [begin + np.stack(np.triu_indices(end - begin, 1)) for begin, end in pairwise(self.begin.tolist())]
        one, two = np.concatenate([np.zeros((2, 0), dtype=np.int64), *places], axis=1)
        return Exchanges(self.slots[one], self.slots[two], self.rows[one], 4.0 * part[one] * part[two])

    def matrix(self, slots: np.ndarray) -> np.ndarray:
        """Return weights of some slots, in increasing order, which hold all of the links', (link, slot)."""
        matrix = np.zeros((len(self), len(slots)))
        matrix[self.rows, np.searchsorted(slots, self.slots)] = self.weights
        return matrix

    def _sums(self, entries: np.ndarray) -> np.ndarray:
        """Sums of entries over each link, (link, …)."""
        return np.asarray(np.add.reduceat(entries, self.begin[:-1], axis=0))


@dataclass(frozen=True, eq=False)
class RoundLinks(Links):
    """Links with *round* ones among them: ``sqrt((w_x·q − x₀)² + (w_y·q − y₀)²) − sqrt(x₀² + y₀²)``, 0 at rest.

    The force of a round link acts along the radius, in any direction between x and y. A spring along the radius adds
    no more to a matrix than two equal springs, along x and along y; other numbers are the largest of all radii.

    Attributes
    ----------
    along : Combinations
        Directions: both of a round link, one of any other.
    link : (direction,) ndarray of int
        Link of each direction, in increasing order.
    center : (direction,) ndarray
        Coordinates x₀ and y₀ of the centers (m), 0 of links that are not round.
    mobility : (coordinate,) ndarray
        Inverse masses.
    """

    count: int
    along: Combinations
    link: np.ndarray
    center: np.ndarray
    mobility: np.ndarray
    slots: np.ndarray = field(init=False)
    weights: np.ndarray = field(init=False)
    pairs: np.ndarray = field(init=False)

    plain: ClassVar[bool] = False

    def __post_init__(self) -> None:
        for name in ("slots", "weights"):
            object.__setattr__(self, name, getattr(self.along, name))
        object.__setattr__(self, "pairs", self._whole.pairs)

    def __len__(self) -> int:
        return int(self.link.max(initial=-1)) + 1

    @property
    def rows(self) -> np.ndarray:
        return np.asarray(self.link[self.along.rows])

    @cached_property
    def first_direction(self) -> np.ndarray:
        """Number of the first direction of each link, (link,)."""
        return np.searchsorted(self.link, np.arange(len(self)))

    @cached_property
    def round(self) -> np.ndarray:
        """Numbers of the links that are round."""
        return np.flatnonzero(np.bincount(self.link, minlength=len(self)) == 2)

    @cached_property
    def _whole(self) -> Combinations:
        """The coordinates of each link, of whatever direction."""
        begin = np.append(self.along.begin[:-1][self.first_direction], self.along.begin[-1])
        return Combinations(self.count, begin, self.slots, self.weights)

    def chosen(self, rows: np.ndarray | slice) -> RoundLinks:
        links = np.arange(len(self))[rows]
        numbers = np.bincount(self.link, minlength=len(self))[links]
        begin = np.append(0, np.cumsum(numbers))
        places = np.repeat(self.first_direction[links] - begin[:-1], numbers) + np.arange(begin[-1])
        link = np.repeat(np.arange(len(links)), numbers)
        return RoundLinks(self.count, self.along.chosen(places), link, self.center[places], self.mobility)

    def held(self, flags: np.ndarray) -> Links:
        """See `Links.held`; round links become plain, for callers that need only the coordinates of each link."""
        return self._whole.held(flags) if flags.any() else self

    def joined_with(self, other: Links) -> RoundLinks:
        """Return these links and, after them, others that are not round."""
        both = joined(self.along, other)
        assert isinstance(both, Combinations)
        link = np.append(self.link, len(self) + np.arange(len(other)))
        return RoundLinks(self.count, both, link, np.pad(self.center, (0, len(other))), self.mobility)

    def gap(self, q: np.ndarray) -> np.ndarray:
        place = self.along.gap(q)
        place -= self.center.reshape(-1, *[1] * (q.ndim - 1))
        result, first = place[self.first_direction], self.first_direction[self.round]
        at_rest = np.hypot(self.center[first], self.center[first + 1]).reshape(-1, *[1] * (q.ndim - 1))
        result[self.round] = np.hypot(place[first], place[first + 1]) - at_rest
        return np.asarray(result)

    def rates(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        place, speed = self.along.gap(q), self.along.gap(v)
        place -= self.center.reshape(-1, *[1] * (q.ndim - 1))
        result, x = speed[self.first_direction], self.first_direction[self.round]
        distance = np.hypot(place[x], place[x + 1])
        along = place[x] * speed[x] + place[x + 1] * speed[x + 1]
        result[self.round] = np.divide(along, distance, out=np.zeros_like(along), where=distance > 0.0)
        return np.asarray(result)

    def radii(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return cosines and sines of the radii of the round links, and the velocities across them, (round link, …).

        All are 0 at a center.
        """
        place, speed = self.along.gap(q), self.along.gap(v)
        place -= self.center.reshape(-1, *[1] * (q.ndim - 1))
        x = self.first_direction[self.round]
        a, b = place[x], place[x + 1]
        distance = np.hypot(a, b)
        cosine, sine = (np.divide(item, distance, out=np.zeros_like(item), where=distance > 0.0) for item in (a, b))
        return cosine, sine, cosine * speed[x + 1] - sine * speed[x]

    def squares(self, values: np.ndarray) -> np.ndarray:
        xx, yy, xy = self.in_plane(values)
        with np.errstate(invalid="ignore"):
            largest = 0.5 * (xx + yy) + np.hypot(0.5 * (xx - yy), xy)
        result = self.along.squares(values)[self.first_direction]
        result[self.round] = np.where(np.isfinite(largest), largest, xx + yy)
        return np.asarray(result)

    def in_plane(self, values: np.ndarray) -> np.ndarray:
        """Return ``Σ w_x² a``, ``Σ w_y² a`` and ``Σ w_x w_y a`` of the round links, (3, round link)."""
        x = self.first_direction[self.round]
        squares, mixed = self.along.squares(values), np.zeros(len(x))
        for place, (one, other) in enumerate(zip(self._weights_by_slot(x), self._weights_by_slot(x + 1), strict=True)):
            mixed[place] = sum(weight * other[slot] * values[slot] for slot, weight in one.items() if slot in other)
        return np.stack([squares[x], squares[x + 1], mixed])

    def _weights_by_slot(self, directions: np.ndarray) -> list[dict[int, float]]:
        ranges = (slice(*self.along.begin[item : item + 2]) for item in directions)
        return [dict(zip(self.slots[some].tolist(), self.weights[some].tolist(), strict=True)) for some in ranges]

    def others(self, values: np.ndarray) -> np.ndarray:
        return self.along.others(values)

    def mixed(self, covariance: np.ndarray, slots: np.ndarray) -> np.ndarray:
        return np.asarray(np.maximum.reduceat(self.along.mixed(covariance, slots), self.first_direction))

    def with_strengths(self, values: np.ndarray, strength: np.ndarray) -> np.ndarray:
        return self.along.with_strengths(values, strength[self.link])

    def pushes(self, force: np.ndarray) -> np.ndarray:
        """See `Links.pushes`: at rest, where nothing pushes a body in the center anywhere."""
        way, x = np.ones(len(self.link)), self.first_direction[self.round]
        distance = np.hypot(self.center[x], self.center[x + 1])
        for item in (x, x + 1):
            way[item] = -np.divide(self.center[item], distance, out=np.zeros(len(x)), where=distance > 0.0)
        return self.along.pushes(way * force[self.link])

    def first(self) -> np.ndarray:
        return self._whole.first()

    def largest(self, values: np.ndarray, wall: float = 0.0) -> np.ndarray:
        return self._whole.largest(values, wall)

    def springs(self, strength: np.ndarray, slots: np.ndarray | None = None) -> np.ndarray:
        return self.along.springs(strength[self.link], slots)

    def with_row_sums(self, values: np.ndarray, strength: np.ndarray, inverse_mass: np.ndarray) -> np.ndarray:
        return self.along.with_row_sums(values, strength[self.link], inverse_mass)

    def exchanges(self, mass: np.ndarray) -> Exchanges:
        return self._whole.exchanges(mass)

    def laid_out(self) -> tuple[Combinations, np.ndarray, np.ndarray]:
        """Return the layout for `impactlab.kernels.combinations`: weights, numbers of round links, and their centers.

        Weights of the links come first, none for round links; then the weights along x of all round links, along y,
        and both again times the inverse masses. Each round link has its number and its rows along x and y.
        """
        x = self.first_direction[self.round]
        linear = np.delete(self.first_direction, self.round)
        begin = np.zeros(len(self), dtype=np.int64)
        begin[np.delete(np.arange(len(self)), self.round)] = np.diff(self.along.begin)[linear]
        places = np.concatenate([linear, x, x + 1, x, x + 1])
        chosen = self.along.chosen(places)
        numbers = np.concatenate([begin, np.diff(chosen.begin)[len(linear) :]])
        weights, slots = chosen.weights.copy(), chosen.slots
        last = slice(int(chosen.begin[len(linear) + 2 * len(x)]), None)
        weights[last] *= self.mobility[slots[last]]
        numbered = np.arange(len(x))
        rounds = np.stack([self.round, len(self) + numbered, len(self) + len(x) + numbered], axis=1)
        centers = np.stack([self.center[x], self.center[x + 1]], axis=1)
        return Combinations(self.count, np.append(0, np.cumsum(numbers)), slots, weights), rounds, centers


def joined(one: Links, other: Links) -> Links:
    """Return some links and, after them, others between the same coordinates."""
    if isinstance(one, RoundLinks):
        return one.joined_with(other)
    if isinstance(one, Pairs) and isinstance(other, Pairs):
        return Pairs(one.count, np.concatenate([one.pairs, other.pairs])) if len(other) else one
    begin, slots, weights = np.zeros(1, dtype=np.int64), [], []
    for links in (one, other):
        moving = links.slots < links.count
        begin = np.append(begin, begin[-1] + np.cumsum(np.bincount(links.rows[moving], minlength=len(links))))
        slots.append(links.slots[moving])
        weights.append(links.weights[moving])
    return Combinations(one.count, begin, np.concatenate(slots), np.concatenate(weights))


@remembered
def _parts(pairs: np.ndarray, count: int) -> np.ndarray:
    first, second = pairs[(pairs < count).all(axis=1)].T
    parts = np.arange(count)
    while True:  # every coordinate takes the smallest label in reach, which doubles each time
        before = parts.copy()
        lowest = np.minimum(parts[first], parts[second])
        for side in (parts[first], parts[second], first, second):
            np.minimum.at(parts, side, lowest)
        parts = parts[parts]
        if (parts == before).all():
            labels: np.ndarray = np.unique(parts, return_inverse=True)[1].reshape(-1)
            labels.setflags(write=False)
            return labels
