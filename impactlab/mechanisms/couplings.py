"""Couplings, linear or not, in the flow or in kicks."""

from __future__ import annotations

import numpy as np

from impactlab.assembly.mechanism import Mechanism, Mode, linked
from impactlab.assembly.model import Model
from impactlab.components.evaluation import of_classes
from impactlab.components.hysteresis import JenkinsCoupling
from impactlab.components.springs import BilinearCoupling


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
        return bool(self.chosen(model).any())

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
