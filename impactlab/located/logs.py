"""The logs of events of lanes: their room, and how they are emptied while lanes run."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from impactlab.kernels.event_log import EVENT, OF_CONTACT, RESERVED, RESERVED_NODES, WHEN
from impactlab.kernels.from_event_to_event import Lanes

Taken = Callable[[int, np.ndarray, np.ndarray], None]
"""Takes the number of a lane, its events, (event, EVENT), and the states after these, (event, 2 body), part by part."""

LOG_BYTES, MOST_EVENTS = 3e7, 4096
"""Memory of the logs of all lanes, about (bytes), and events in one of them: they are emptied when one is full."""


def room_in_log(lanes: int, contacts: int) -> int:
    """Return how many events of a lane its log has room for."""
    return 2 * RESERVED * (1 + contacts**2) + min(int(LOG_BYTES / (8 * EVENT * lanes)), MOST_EVENTS)


NodesTaken = Callable[[int, np.ndarray], None]
"""Takes the number of a lane, and its nodes of integrals, (node, column), part by part."""

NODE_BYTES, MOST_NODES = 3e7, 16384
"""The same of nodes."""


def room_for_nodes(lanes: int, columns: int) -> int:
    """Return for how many nodes of a lane there is room."""
    return 2 * RESERVED_NODES + min(int(NODE_BYTES / (8 * columns * lanes)), MOST_NODES)


def hand_on_nodes(lanes: Lanes, take: NodesTaken | None, number: int) -> None:
    """Hand the nodes of some lanes on, from the first one; those of others are forgotten."""
    if take is not None:
        for lane in np.flatnonzero(lanes.noded[:number]).tolist():
            take(lane, lanes.nodes[lane, : lanes.noded[lane]].copy())
        lanes.noded[:] = 0


def empty_logs(
    lanes: Lanes, take: Taken, names: Callable[[int, int], str], stuck: dict[int, str]
) -> None:  # fmt: skip
    """Hand the events of all logs on; `stuck` tells of which lanes events are lost."""
    for lane, number in enumerate(lanes.logged.tolist()):
        rows = lanes.log[lane, :number].copy()
        if number > len(rows):
            stuck[lane] = (
                f"An impact of {names(lane, int(rows[-1, OF_CONTACT]))!r} at {rows[-1, WHEN]:.12g} s sets off more "
                "than are kept; leave out il.Impacts."
            )
        if number:
            take(lane, rows, lanes.states[lane, :number].copy())
    lanes.logged[:] = 0
