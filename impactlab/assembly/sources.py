"""Excitations of one kind as arrays: the bodies that each excitation drives, and the weights."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np

from impactlab.components.evaluation import call_each

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
        Names that address random numbers: the name of the body, or of the source.
    excitations : tuple
        The excitation of each name.
    own : int
        Number of excitations of one body under the body's name; they come first, ordered by slot.
    drives : Drives
        The bodies that they drive.
    beyond_own : range
        Numbers of the excitations with a name of their own.
    bodies : tuple of int
        Slots of the bodies that they drive, in increasing order.
    joining : list of ndarray
        Slots of the bodies of each excitation that drives several.
    """

    names: tuple[str, ...]
    excitations: tuple[Excitation, ...]
    own: int
    drives: Drives
    beyond_own: range = field(init=False)
    bodies: tuple[int, ...] = field(init=False)
    joining: list[np.ndarray] = field(init=False)

    def __post_init__(self) -> None:
        beyond = range(self.own, len(self.names))
        slots = np.unique(self.drives.body) if beyond else self.drives.body
        object.__setattr__(self, "beyond_own", beyond)
        object.__setattr__(self, "bodies", tuple(slots.tolist()))
        parts = [self.driven(number)[0] for number in beyond]
        object.__setattr__(self, "joining", [slots for slots in parts if len(slots) > 1])

    @classmethod
    def of(
        cls,
        own: Mapping[str, Excitation],
        shared: Mapping[str, tuple[Excitation, Mapping[str, float]]],
        slots: Mapping[str, int],
    ) -> Sources[Excitation]:
        """Return sources named after their body, in slot order, then named sources with the weights of their bodies."""
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

    def named(self) -> list[tuple[str, Excitation]]:
        """Return the excitations with their names."""
        return list(zip(self.names, self.excitations, strict=True))

    def only_own(self) -> Sources[Excitation]:
        """Return the excitations of single bodies under the body's name."""
        drives = Drives(*(item[: self.own] for item in self.drives))
        return Sources(self.names[: self.own], self.excitations[: self.own], self.own, drives)

    @cached_property
    def _begins(self) -> np.ndarray:
        """Where the pairs of each excitation begin, and where the last pair ends."""
        return np.searchsorted(self.drives.source, np.arange(len(self.names) + 1))

    def driven(self, number: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the slots of the bodies that an excitation drives, in increasing order, and their weights."""
        part = slice(self._begins[number], self._begins[number + 1])
        return self.drives.body[part], self.drives.weight[part]

    def on(self, slot: int) -> list[tuple[Excitation, float]]:
        """Return the excitations of a body, and their weights."""
        chosen = self.drives.body == slot
        pairs = zip(self.drives.source[chosen].tolist(), self.drives.weight[chosen].tolist(), strict=True)
        return [(self.excitations[number], weight) for number, weight in pairs]

    def added(self, densities: np.ndarray, bodies: int) -> np.ndarray:
        """Return the spectral densities of the forces on all bodies by independent excitations, (body,)."""
        return np.bincount(self.drives.body, self.drives.weight**2 * densities[self.drives.source], bodies)


@dataclass(frozen=True, eq=False)
class Noise:
    """Two-sided spectral densities of the white noises of a network (N2 s rad-1)."""

    sources: Sources[Any]
    varying: bool  # whether one depends on time
    density: np.ndarray  # (noise,) at time 0
    intensity: np.ndarray  # (body,) the same of the force on each body
    reference_density: np.ndarray  # (noise,) for which coefficients are made: 1 where they vary
    reference_intensity: np.ndarray  # (body,) the same of the force on each body

    @classmethod
    def of(cls, sources: Sources[Any], varying: bool, bodies: int) -> Noise:
        """Return the densities of some sources of noise, one of which may vary in time, on so many bodies."""
        density = call_each(sources.excitations, "intensity", np.zeros((len(sources.names), 1)))[:, 0]
        intensity = sources.added(density, bodies)
        ones = np.ones(len(density))
        reference = (ones, sources.added(ones, bodies)) if varying else (density, intensity)
        return cls(sources, varying, density, intensity, *reference)

    def at(self, time: float) -> np.ndarray:
        """Return the densities on each body at a time (s), (body,)."""
        density = call_each(self.sources.excitations, "intensity", np.full((len(self.density), 1), time))[:, 0]
        return self.sources.added(density, len(self.intensity))

    def matrix(self, slots: np.ndarray) -> np.ndarray:
        """Return the densities on some bodies and between them at time 0, (n, n)."""
        result = np.diag(self.intensity[slots])
        for number in self.sources.beyond_own:
            body, weight = self.sources.driven(number)
            place = np.minimum(np.searchsorted(body, slots), len(body) - 1)
            factor = np.where(body[place] == slots, weight[place], 0.0)
            between = np.outer(factor, factor) * self.density[number]
            np.fill_diagonal(between, 0.0)
            result += between
        return result
