"""Which contact acts on which body, laid out for loops that vectorise over bodies.

Rows whose indices rise by one form a *run*, along which neighbours are read and written side by
side. Contacts and bodies in long runs have loops of their own; all others are listed in tables,
one entry each.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

LONG = 8
"""Length from which a run of contacts has a loop of its own."""


def runs(*rising: np.ndarray, constant: Sequence[np.ndarray] = ()) -> list[np.ndarray]:
    """Split rows of integers into runs along which some columns rise by one and some are constant.

    Returns the values of all columns where runs begin, then the lengths of the runs.
    """
    steps = [np.diff(column) != 1 for column in rising] + [np.diff(column) != 0 for column in constant]
    count = len(rising[0])
    begins = np.flatnonzero(np.append(np.ones(min(count, 1), dtype=bool), np.any(steps, axis=0)))
    return [*(column[begins] for column in (*rising, *constant)), np.diff(begins, append=count)]


def _long(*columns: np.ndarray, constant: Sequence[np.ndarray] = ()) -> tuple[np.ndarray, np.ndarray]:
    """Return the `runs` that are long, (column, run), and whether each row is in one of them."""
    table = np.stack(runs(*columns, constant=constant))
    long = table[-1] >= LONG
    return table[:, long], np.repeat(long, table[-1])


def differences(ends: np.ndarray) -> np.ndarray:
    """Return the layout for `impactlab.kernels.kick.differences`."""
    contacts = np.arange(len(ends))
    along, inside = _long(contacts, *ends.T)
    alone = np.column_stack([contacts, ends])[~inside]
    return np.concatenate([[along.shape[1], len(alone)], along.T.ravel(), alone.T.ravel()])


def gathering(ends: np.ndarray, bodies: int, order: np.ndarray | None = None) -> np.ndarray:
    """Return the layout for `impactlab.kernels.kick.gather`; forces add up in the order of the contacts, or `order`."""
    body, contact, sign = ends.T.ravel(), np.tile(np.arange(len(ends)), 2), np.repeat((-1, 1), len(ends))
    rank = contact if order is None else np.tile(order, 2)
    order = np.lexsort((rank, body))[: np.count_nonzero(body < bodies)]  # the wall does not move
    body, contact, sign = body[order], contact[order], sign[order]
    slots = np.arange(bodies)
    begin = np.searchsorted(body, slots)
    number, place = np.diff(begin, append=len(body)), np.arange(len(body)) - begin[body]
    # bodies in a row whose first two contacts are in a row as well
    several = np.flatnonzero(number > 1)
    one, two = begin[several], begin[several] + 1
    pairs, inside = _long(several, contact[one], contact[two], constant=[sign[one], sign[two]])
    regular = np.zeros(bodies, dtype=bool)
    regular[several[inside]] = True
    slot, first, second, first_sign, second_sign, count = pairs
    later = np.lexsort((body, place))
    later = later[place[later] > 1]
    _, inside = _long(body[later], contact[later], constant=[sign[later]])
    scattered = ~regular
    scattered[body[later][~inside]] = True  # the further terms of a body stay together, for their order
    inside = ~scattered[body[later]]
    further = runs(body[later][inside], contact[later][inside], constant=[sign[later][inside]])
    # all others, one by one
    single, double = (begin[~regular & chosen] for chosen in (number == 1, number > 1))
    terms = np.stack([body, contact, sign], axis=1)
    tables = [
        np.stack([slot, count, first, first_sign, second, second_sign], axis=1),
        np.stack([further[0], further[3], further[1], further[2]], axis=1),
        np.flatnonzero(number == 0),
        terms[single],
        np.concatenate([terms[double], terms[double + 1][:, 1:]], axis=1),
        terms[later][~inside],
    ]
    sizes = [len(table) for table in tables]
    tables = [*tables[:2], *(table.T for table in tables[2:])]  # runs row by row, the others column by column
    return np.concatenate([sizes, *map(np.ravel, tables)])
