"""Large networks in tiles: parts that run alone for some steps, with all bodies that reach them meanwhile.

A force reaches one contact further with every evaluation. Noise belongs to (body, step), so that
a tile and its *halo*, the bodies within reach, can make some steps without the rest of the network;
what happens in the halo is worked out more than once and thrown away. Bit for bit it is what the
whole network would do. A tile stays in the cache, and tiles run on several cores.
"""

from __future__ import annotations

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


def refuse_to_cut(part: object, there: bool | np.bool_) -> None:
    """Refuse to restrict a part of a plan to a tile where there is anything in it that cannot be cut."""
    if there:
        raise NotImplementedError(f"Tiles know nothing of {type(part).__name__}; its mechanism must not meet them.")


@dataclass(frozen=True, eq=False)
class Subdomains:
    """Parts of a large network that run in turn."""

    steps: int  # steps that tiles make alone
    tiles: tuple[Tile, ...]  # none where the network is small or halos would be too large

    def restricted(self, tile: Tile) -> Subdomains:
        """Return nothing: a tile is not cut again."""
        return Subdomains(0, ())

    @classmethod
    def of(cls, model: Model, reach: int) -> Subdomains:
        """Cut a network into tiles; `reach` are evaluations of forces in a step."""
        bodies, sizes = len(model.bodies), tuning()
        count = bodies // sizes.tile_bodies
        if count < 2 or not model.ends.plain:
            return cls(0, ())
        bounds = np.arange(count + 1) * bodies // count
        between = model.ends.pairs[(model.ends.pairs < bodies).all(axis=1)]
        both = np.concatenate([between, between[:, ::-1]])
        both = both[np.argsort(both[:, 0], kind="stable")]
        begin = np.searchsorted(both[:, 0], np.arange(bodies + 1))
        own = np.diff(bounds)
        for steps in sizes.tile_steps:
            halos = _halos(begin, both[:, 1], own, reach * steps, int(sizes.tile_excess * bodies))
            if halos is not None:
                tables, slots = _Tables.of(model), map(np.arange, bounds, bounds[1:])
                within = [np.concatenate(pair) for pair in zip(slots, halos, strict=True)]
                return cls(steps, tuple(_tile(model, tables, *tile) for tile in zip(within, own, strict=True)))
        return cls(0, ())


def _halos(
    begin: np.ndarray, neighbours: np.ndarray, own: np.ndarray, distance: int, most: int
) -> list[np.ndarray] | None:
    """Return the other bodies within a distance of each tile, in increasing order; None for more than `most` in all.

    `own` are the numbers of bodies of each tile, in turn. All tiles grow at once: the bodies that a round reaches are
    written as numbers of a tile and a body, and only bodies of the last two rounds can be reached again.
    """
    bodies, tile_of = len(begin) - 1, np.repeat(np.arange(len(own)), own)

    def outside(tiles: np.ndarray, reached: np.ndarray) -> np.ndarray:
        others = np.flatnonzero(tile_of[reached] != tiles)
        return _distinct(tiles[others] * bodies + reached[others])

    before, edge = tile_of[:0], outside(np.repeat(tile_of, np.diff(begin)), neighbours)
    found, total = [edge], bodies + len(edge)
    for _ in range(distance - 1):
        if total > most or not edge.size:
            break
        tiles, rim = np.divmod(edge, bodies)
        reached = outside(np.repeat(tiles, begin[rim + 1] - begin[rim]), neighbours[_entries(begin, rim)])
        before, edge = edge, reached[~np.isin(reached, np.concatenate([before, edge]))]
        found.append(edge)
        total += len(edge)
    if total > most:
        return None
    tiles, halo = np.divmod(np.sort(np.concatenate(found)), bodies)
    return np.split(halo, np.searchsorted(tiles, np.arange(1, len(own))))


def _distinct(values: np.ndarray) -> np.ndarray:
    """Return the values that differ, in increasing order: `numpy.unique` of what is nearly in order, in a tenth."""
    values = np.sort(values, kind="stable")
    return np.asarray(values[np.append(True, values[1:] != values[:-1])[: len(values)]])


def _entries(begin: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Return the places of the entries of `rows`, from the places where rows begin."""
    number = begin[rows + 1] - begin[rows]
    offset = np.repeat(begin[rows] - (np.cumsum(number) - number), number)
    return np.asarray(offset + np.arange(len(offset)))


class _Tables(NamedTuple):
    """What tiles are cut from, so that each takes no more time than it has bodies."""

    contacts: np.ndarray  # of each body in turn
    begin: np.ndarray  # (body + 1,) where those of each body begin
    rows: tuple[np.ndarray | None, ...]
    """Row of each contact or body in the table of each kind, -1 for none; None for kinds that a tile does not evaluate.
    """

    @classmethod
    def of(cls, model: Model) -> _Tables:
        """Return the tables of a model."""
        ends = model.ends.pairs.ravel()
        order = np.argsort(ends, kind="stable")
        counts, rows = {"force": len(model.ends), "residual": model.wall}, []
        for kind, (leading, _) in zip(model.members.kinds, model.members.tables, strict=True):
            row = np.full(counts[kind.role], -1) if kind.role in counts else None
            if row is not None:
                row[leading[:, 0]] = np.arange(len(leading))
            rows.append(row)
        return cls(order // 2, np.searchsorted(ends[order], np.arange(model.wall + 1)), tuple(rows))


def _tile(model: Model, known: _Tables, slots: np.ndarray, own: int) -> Tile:
    wall, pairs = model.wall, model.ends.pairs
    place = np.full(wall + 1, -1)
    place[slots], place[wall] = np.arange(len(slots)), len(slots)
    near = _distinct(known.contacts[_entries(known.begin, slots)])
    contacts = near[(place[pairs[near]] >= 0).all(axis=1)]
    owner = np.where(pairs[:, 0] < wall, pairs[:, 0], pairs[:, 1])[contacts]
    mine = place[owner] < own
    contacts = np.concatenate([contacts[mine], contacts[~mine]])
    tables = []
    for kind, rows, (leading, numbers) in zip(model.members.kinds, known.rows, model.members.tables, strict=True):
        if rows is None:
            tables.append((leading[:0], numbers[:0]))
        else:
            chosen = rows[contacts if kind.role == "force" else slots]
            here = np.flatnonzero(chosen >= 0)
            tables.append((here[:, None], numbers[chosen[here]]))
    ends = place[pairs[contacts]]
    parameters, indices, _ = packed(tables, Pairs(len(slots), ends), model.members.samples, contacts)
    return Tile(slots, contacts, int(own), int(np.count_nonzero(mine)), ends, parameters, indices)
