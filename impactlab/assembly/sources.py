"""Excitations of one kind as arrays: which bodies each of them drives, with which weights."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Generic, NamedTuple, TypeVar

import numpy as np

Excitation = TypeVar("Excitation")


class Drives(NamedTuple):
    """Pairs of an excitation and a body that it drives, one excitation after the other, by increasing slot."""

    source: np.ndarray  # (pair,) number of the excitation
    body: np.ndarray  # (pair,) slot
    weight: np.ndarray  # (pair,) factor of the force


@dataclass(frozen=True, eq=False)
class Sources(Generic[Excitation]):
    """Excitations of one kind.

    Attributes
    ----------
    names : tuple of str
        Their names, by which random numbers are addressed: that of the body, or of the source.
    excitations : tuple
        What has these names.
    own : int
        How many, the first ones, are the excitation of one body under the body's name, by its slot.
    drives : Drives
        What they drive.
    """

    names: tuple[str, ...]
    excitations: tuple[Excitation, ...]
    own: int
    drives: Drives

    @classmethod
    def of(
        cls,
        own: Mapping[str, Excitation],
        shared: Mapping[str, tuple[Excitation, Mapping[str, float]]],
        slots: Mapping[str, int],
    ) -> Sources[Excitation]:
        """Return those of bodies by the names of these, by slot, and then those with weights of the bodies on which."""
        source, body, weight = list(range(len(own))), list(map(slots.__getitem__, own)), [1.0] * len(own)
        for number, (_, on) in enumerate(shared.values(), len(own)):
            for slot, of_slot in sorted((slots[name], of_name) for name, of_name in on.items()):
                source.append(number)
                body.append(slot)
                weight.append(of_slot)
        return cls(
            (*own, *shared),
            (*own.values(), *(excitation for excitation, _ in shared.values())),
            len(own),
            Drives(np.array(source, dtype=np.int64), np.array(body, dtype=np.int64), np.array(weight, dtype=float)),
        )

    @property
    def of_several(self) -> np.ndarray:
        """Slots of the bodies of all excitations that drive several."""
        return np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *self.joining]))

    def named(self) -> list[tuple[str, Excitation]]:
        """Return their names with them."""
        return list(zip(self.names, self.excitations, strict=True))

    @cached_property
    def bodies(self) -> tuple[int, ...]:
        """Slots of the bodies that they drive, in increasing order."""
        slots = np.unique(self.drives.body) if self.beyond_own else self.drives.body
        return tuple(slots.tolist())

    @property
    def beyond_own(self) -> range:
        """Numbers of those that have a name of their own."""
        return range(self.own, len(self.names))

    @property
    def joining(self) -> list[np.ndarray]:
        """Slots of the bodies of each excitation that drives several."""
        parts = [self.driven(number)[0] for number in self.beyond_own]
        return [slots for slots in parts if len(slots) > 1]

    def only_own(self) -> Sources[Excitation]:
        """Return those that are the excitation of one body under its name."""
        drives = Drives(*(item[: self.own] for item in self.drives))
        return Sources(self.names[: self.own], self.excitations[: self.own], self.own, drives)

    @cached_property
    def _begins(self) -> np.ndarray:
        """Where the pairs of each excitation begin, and where the last ones end."""
        return np.searchsorted(self.drives.source, np.arange(len(self.names) + 1))

    def driven(self, number: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the slots of the bodies that one of them drives, in increasing order, and the weights."""
        part = slice(self._begins[number], self._begins[number + 1])
        return self.drives.body[part], self.drives.weight[part]

    def on(self, slot: int) -> list[tuple[Excitation, float]]:
        """Return the excitations of a body, and their weights."""
        chosen = self.drives.body == slot
        pairs = zip(self.drives.source[chosen].tolist(), self.drives.weight[chosen].tolist(), strict=True)
        return [(self.excitations[number], weight) for number, weight in pairs]

    def added(self, densities: np.ndarray, bodies: int) -> np.ndarray:
        """Return the spectral densities of the forces on all bodies from those of independent excitations, (body,)."""
        return np.bincount(self.drives.body, self.drives.weight**2 * densities[self.drives.source], bodies)

    def matrix(self, densities: np.ndarray, added: np.ndarray, slots: np.ndarray) -> np.ndarray:
        """Return the spectral densities of the forces on some bodies and between them, (n, n), from those `added`."""
        result = np.diag(added[slots])
        for number in self.beyond_own:
            body, weight = self.driven(number)
            place = np.minimum(np.searchsorted(body, slots), len(body) - 1)
            factor = np.where(body[place] == slots, weight[place], 0.0)
            between = np.outer(factor, factor) * densities[number]
            np.fill_diagonal(between, 0.0)
            result += between
        return result
