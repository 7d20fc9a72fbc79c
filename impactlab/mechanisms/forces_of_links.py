"""Forces of links: smooth contacts, contacts in a plane, links with weights, and couplings, in the flow or in kicks."""

from __future__ import annotations

import numpy as np

from impactlab.assembly.mechanism import ALL, Mechanism, Mode, at, linked
from impactlab.assembly.model import Model
from impactlab.components.evaluation import of_classes
from impactlab.components.hysteresis import JenkinsCoupling
from impactlab.components.springs import BilinearCoupling


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


class Couplings(Mechanism, family=True):
    """Base of the kinds of couplings."""

    modes = frozenset(
        {Mode.ONE_LANE, Mode.REGISTERS, Mode.SIDE_BY_SIDE, Mode.SAMPLES, Mode.FINE_FLOW, Mode.CERTIFIED_STEP,
         Mode.FORCES}
    )  # fmt: skip

    def chosen(self, model: Model) -> np.ndarray:
        """Whether each coupling is one of these, (coupling,) of bool."""
        raise NotImplementedError

    def there(self, model: Model) -> bool:
        return len(model.couplings.laws) > 0 and bool(self.chosen(model).any())

    def bodies(self, model: Model) -> np.ndarray:
        return linked(model, model.coupled, self.chosen(model))


class LinearCouplings(Couplings):
    """Linear couplings that kick."""

    name = "linear couplings"
    modes = Couplings.modes | {Mode.LOCATED}

    def chosen(self, model: Model) -> np.ndarray:
        return np.asarray(model.couplings.linear.any(axis=0) & ~model.couplings.flowing)


class FlowingCouplings(Couplings):
    """Linear couplings in the exact motion between kicks, whose transitions are those of groups of bodies."""

    name = "linear couplings in the flow"
    modes = Couplings.modes - {Mode.REGISTERS, Mode.SIDE_BY_SIDE}

    def chosen(self, model: Model) -> np.ndarray:
        return model.couplings.flowing


class NonlinearCouplings(Couplings):
    """All other couplings that kick."""

    name = "nonlinear couplings"
    modes = Couplings.modes - {Mode.CERTIFIED_STEP}

    def chosen(self, model: Model) -> np.ndarray:
        others = model.couplings.linear.any(axis=0) | model.couplings.flowing | model.couplings.sticking
        return np.asarray(~(others | _kinked(model)))


class KinkedCouplings(Couplings):
    """Springs that are linear between kinks, or between slip and stick of a slider in series."""

    name = "piecewise linear couplings"
    modes = NonlinearCouplings.modes | {Mode.LOCATED}

    def chosen(self, model: Model) -> np.ndarray:
        return _kinked(model)


def _kinked(model: Model) -> np.ndarray:
    """Whether each coupling is linear between kinks, (coupling,) of bool."""
    return np.array(
        of_classes(lambda kind: issubclass(kind, BilinearCoupling | JenkinsCoupling), model.couplings.laws), dtype=bool
    )
