"""The record of impacts, from the logs of events that runs without steps keep."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from impactlab.kernels import event_log as log
from impactlab.kernels import impacts_at_steps as column
from impactlab.kernels.contact_states import HELD, OPEN
from impactlab.kernels.from_event_to_event import Lanes
from impactlab.records.impact_tables import Tally

OF_EVENTS: dict[str, str] = {
    "largest_force": "Impacts of rigid contacts have none.",
    "duration": "0 for impacts of rigid contacts; of a rest, its length from the end of the bouncing on.",
}
"""What is said of quantities."""


class ImpactsOfEvents:
    """The impacts of the realizations of one network.

    Parameters
    ----------
    tally : Tally
        Takes the impacts.
    slots : sequence of int
        The contacts that are followed.
    rows : int
        How many contacts, and couplings with events, there are.
    realizations : int
    """

    def __init__(self, tally: Tally, slots: Sequence[int], rows: int, realizations: int) -> None:
        self.tally, self.realizations = tally, realizations
        self.place = np.full(rows, -1)
        self.place[list(slots)] = np.arange(len(slots))

    def take(self, lane: int, events: np.ndarray, states: np.ndarray) -> None:
        """Take the events of a realization."""
        ended = (events[:, log.AFTER] == OPEN) & (events[:, log.WHEN] >= 0.0)
        self._take(lane, events[ended], np.where(events[ended, log.BEFORE] == HELD, column.RESTS, 0))

    def end(self, lanes: Lanes, begin: int) -> None:
        """Take the impacts that go on when the lanes from one on have ended."""
        for lane in range(self.realizations):
            going = np.flatnonzero((lanes.statuses[begin + lane] != OPEN) & (self.place >= 0))
            events = np.full((len(going), log.EVENT), np.nan)
            events[:, log.OF_CONTACT] = going
            events[:, log.BEGAN :] = lanes.contacts[begin + lane, log.OF_IMPACT :, going]
            events[:, log.LEAVING] = np.nan
            rests = lanes.statuses[begin + lane, going] == HELD
            self._take(lane, events, column.CLOSED_AT_END + np.where(rests, column.RESTS, 0))

    def _take(self, lane: int, events: np.ndarray, flags: np.ndarray) -> None:
        places = self.place[events[:, log.OF_CONTACT].astype(int)]
        rows = events.copy()
        rows[:, column.LANE], rows[:, column.SUBSAMPLE], rows[:, log.OF_CONTACT] = lane, 0, places
        early = ~(events[:, log.BEGAN] >= 0.0) | np.isnan(events[:, log.CLOSING])
        rows[:, column.FLAG] = flags + np.where(early, column.CLOSED_AT_START, 0)
        rows[early, log.BEGAN], rows[early, log.CLOSING] = 0.0, np.nan
        if (places >= 0).any():
            self.tally.take(rows[places >= 0])
