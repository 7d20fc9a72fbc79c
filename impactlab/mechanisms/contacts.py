"""Smooth contacts, contacts in a plane, and links with weights."""

from __future__ import annotations

import numpy as np

from impactlab.assembly.mechanism import ALL, Mechanism, Mode, at, linked
from impactlab.assembly.model import Model


class SmoothContacts(Mechanism):
    """Contacts whose force is a function of an indentation along one direction."""

    name = "contacts"
    modes = ALL - {Mode.IDLE_BODIES}

    def there(self, model: Model) -> bool:
        return bool((~model.contacts.impulsive & ~model.contacts.round).any())

    def bodies(self, model: Model) -> np.ndarray:
        return linked(model, model.ends, ~model.contacts.impulsive & ~model.contacts.round)


class ContactsInAPlane(Mechanism):
    """Contacts with the rim of a round clearance, whose indentation is a function of two coordinates."""

    name = "contacts in a plane"
    modes = frozenset({Mode.ONE_LANE, Mode.SAMPLES, Mode.FORCES})

    def there(self, model: Model) -> bool:
        return bool(model.contacts.round.any())

    def bodies(self, model: Model) -> np.ndarray:
        return linked(model, model.ends, model.contacts.round)


class WeightedLinks(Mechanism):
    """Links of weighted sums of bodies, laid out otherwise than pairs; contacts in a plane are, too."""

    name = "links of weighted bodies"
    modes = frozenset({Mode.ONE_LANE, Mode.SAMPLES, Mode.CERTIFIED_STEP, Mode.LOCATED, Mode.FORCES})

    def there(self, model: Model) -> bool:
        return not (model.ends.plain and model.coupled.plain)

    def bodies(self, model: Model) -> np.ndarray:
        return at(model, model.links.slots)
