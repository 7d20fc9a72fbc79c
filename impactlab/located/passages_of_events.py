"""First passages of limits, from the events of runs without steps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from impactlab.assembly.model import Model
from impactlab.components.contact import Contact, LinearContact
from impactlab.components.sides import WALL
from impactlab.errors import InvalidInput
from impactlab.kernels import event_log as log
from impactlab.kernels.contact_states import OPEN
from impactlab.records.passage_limits import NOT_PASSED, Limit

ABOVE, BELOW = "{} above its limit", "{} below its limit"
"""Names of contacts without a force that tell when a limit is passed."""


def with_limits(model: Model, limits: Sequence[Limit]) -> Model:
    """Return the network that is followed, with a contact of no force at each limit."""
    contacts = {name: item for limit in limits for name, item in _contacts(model, limit)}
    network: Any = model.network
    return Model.of(network.replace(contacts=contacts)) if contacts else model


def _contacts(model: Model, limit: Limit) -> list[tuple[str, Contact]]:
    """Return the contacts of a limit."""
    law, result = LinearContact(0.0), []
    if limit.quantity not in ("displacement", "indentation"):
        raise InvalidInput(
            f"EventLocated locates no limit of the {limit.quantity.replace('_', ' ')} of {limit.name!r}; use "
            "integrator=il.ExactFlow()."
        )
    first, second, clearance = limit.name, WALL, 0.0
    if limit.quantity == "indentation":
        contact = model.network.contacts[limit.name]
        first, second, clearance = contact.first, contact.second, contact.clearance
    if limit.high is not None and not at_impact(model, limit):
        above = Contact(first, second, law, clearance=clearance + limit.high)
        result.append((ABOVE.format(limit.name), above))
    if limit.low is not None:
        below = Contact(second, first, law, clearance=-(clearance + limit.low))
        result.append((BELOW.format(limit.name), below))
    return result


def at_impact(model: Model, limit: Limit) -> bool:
    """Whether a limit is passed by impacts of a rigid contact, which end where its gap does."""
    if limit.quantity != "indentation" or limit.high is None or limit.high < 0.0:
        return False
    return bool(model.contacts.impulsive[model.contacts.names.index(limit.name)])


class PassagesOfEvents:
    """The first passages of the realizations of one network.

    Parameters
    ----------
    limits : sequence of Limit
    model : Model
        The network that is followed, see `with_limits`.
    displacement : (realization, body) ndarray
        Displacements of the free bodies where realizations begin.
    """

    def __init__(self, limits: Sequence[Limit], model: Model, displacement: np.ndarray) -> None:
        names = {ABOVE.format(item.name): row for row, item in enumerate(limits)}
        names |= {BELOW.format(item.name): row for row, item in enumerate(limits)}
        names |= {item.name: row for row, item in enumerate(limits) if at_impact(model, item)}
        self._limit = np.array([names.get(name, NOT_PASSED) for name in model.contacts.names])
        self.times = np.full(len(displacement), np.nan)
        self.causes = np.full(len(displacement), NOT_PASSED)
        x = np.zeros((len(model.bodies) + 1, len(displacement)))
        x[:-1][model.bodies.free] = displacement[:, : model.bodies.free.sum()].T
        outside = (model.ends.gap(x) - model.clearance[:, None] >= 0.0) & (self._limit >= 0)[:, None]
        if outside.any():
            contact, realization = np.argwhere(outside)[0]
            limit = limits[self._limit[contact]]
            raise InvalidInput(
                f"FirstPassage: the {limit.quantity} of {limit.name!r} is not within its limits {limit.pair} at the "
                f"start of realization {realization}; give other limits or another initial=."
            )

    def take(self, lane: int, events: np.ndarray, states: np.ndarray) -> None:
        """Take the events of a realization, and the states after them."""
        causes = self._limit[np.clip(events[:, log.OF_CONTACT].astype(int), 0, len(self._limit) - 1)]
        of_contact = events[:, log.OF_CONTACT] < len(self._limit)
        chosen = of_contact & (causes >= 0) & (events[:, log.BEFORE] == OPEN)
        if chosen.any() and np.isnan(self.times[lane]):
            first = int(chosen.argmax())
            self.times[lane], self.causes[lane] = events[first, log.WHEN], causes[first]
