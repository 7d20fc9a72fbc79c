"""Large networks in tiles: parts that run alone for some steps, with all bodies that reach them meanwhile.

A force reaches one contact further with every evaluation. Noise belongs to (body, step), so that
a tile and its *halo*, the bodies within reach, can make some steps without the rest of the network;
what happens in the halo is worked out more than once and thrown away. Bit for bit it is what the
whole network would do. A tile stays in the cache, and tiles run on several cores.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from impactlab.assembly.links import Pairs
from impactlab.assembly.members import packed
from impactlab.assembly.model import Model
from impactlab.machine import tuning


class Tile(NamedTuple):
    """A part of a network, with its halo."""

    bodies: np.ndarray  # slots, its own first
    contacts: np.ndarray  # slots of all contacts between them, its own first
    own_bodies: int
    own_contacts: int
    ends: np.ndarray  # (contact, 2) places in `bodies`, the wall last
    parameters: np.ndarray
    indices: np.ndarray


@dataclass(frozen=True, eq=False)
class Subdomains:
    """Parts of a large network that run in turn."""

    steps: int  # steps that tiles make alone
    tiles: tuple[Tile, ...]  # none where the network is small or halos would be too large

    @classmethod
    def of(cls, model: Model, reach: int) -> Subdomains:
        """Cut a network into tiles; `reach` are evaluations of forces in a step, 0 if tiles are not wanted."""
        bodies, sizes = len(model.bodies), tuning()
        count = bodies // sizes.tile_bodies
        if count < 2 or not reach or not model.ends.plain:
            return cls(0, ())
        bounds = np.arange(count + 1) * bodies // count
        between = model.ends.pairs[(model.ends.pairs < bodies).all(axis=1)]
        both = np.concatenate([between, between[:, ::-1]])
        both = both[np.argsort(both[:, 0], kind="stable")]
        begin = np.searchsorted(both[:, 0], np.arange(bodies + 1))
        for steps in sizes.tile_steps:
            left, found = int(sizes.tile_excess * bodies), []
            for low, high in itertools.pairwise(bounds):
                inside = _near(begin, both[:, 1], np.arange(low, high), reach * steps, left)
                left -= len(inside)
                if left < 0:
                    break
                found.append(np.concatenate([np.arange(low, high), inside[(inside < low) | (inside >= high)]]))
            else:
                own = np.diff(bounds)
                return cls(steps, tuple(_tile(model, slots, own[k]) for k, slots in enumerate(found)))
        return cls(0, ())


def _near(begin: np.ndarray, neighbours: np.ndarray, start: np.ndarray, distance: int, most: int) -> np.ndarray:
    """Bodies within a distance of some, in increasing order; may stop at more than `most`."""
    inside = np.zeros(len(begin) - 1, dtype=bool)
    inside[start] = True
    edge, total = start, len(start)
    for _ in range(distance):
        number = begin[edge + 1] - begin[edge]
        offset = np.repeat(begin[edge] - (np.cumsum(number) - number), number)
        reached = neighbours[offset + np.arange(len(offset))]
        edge = np.unique(reached[~inside[reached]])
        inside[edge] = True
        total += len(edge)
        if not edge.size or total > most:
            break
    return np.flatnonzero(inside)


def _tile(model: Model, slots: np.ndarray, own: int) -> Tile:
    wall, pairs = model.wall, model.ends.pairs
    place = np.full(wall + 1, -1)
    place[slots], place[wall] = np.arange(len(slots)), len(slots)
    contacts = np.flatnonzero((place[pairs] >= 0).all(axis=1))
    owner = np.where(pairs[:, 0] < wall, pairs[:, 0], pairs[:, 1])[contacts]
    mine = place[owner] < own
    contacts = np.concatenate([contacts[mine], contacts[~mine]])
    places = {"force": np.full(len(model.ends), -1), "residual": place}
    places["force"][contacts] = np.arange(len(contacts))
    tables = []
    for kind, (leading, numbers) in zip(model.members.kinds, model.members.tables, strict=True):
        if kind.role in places:
            here = places[kind.role][leading[:, 0]]
            order = np.argsort(here)[np.count_nonzero(here < 0) :]
            tables.append((here[order, None], numbers[order]))
        else:  # nothing that a tile evaluates
            tables.append((leading[:0], numbers[:0]))
    ends = place[pairs[contacts]]
    parameters, indices, _ = packed(tables, Pairs(len(slots), ends), model.members.samples, contacts)
    return Tile(slots, contacts, int(own), int(np.count_nonzero(mine)), ends, parameters, indices)
