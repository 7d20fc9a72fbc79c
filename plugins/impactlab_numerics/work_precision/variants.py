"""The default method without one of its devices, to show the contribution of each."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.integrators.kicks import SHIFT


class PlainKick(il.ExactFlow):
    """Exact flow with a kick that is read where the body is, an ordinary splitting."""

    order: ClassVar[float] = 2.0

    def coefficients(self, model: Model, step: float) -> np.ndarray:
        result = super().coefficients(model, step)
        result[..., SHIFT] = 0.0
        return result


class TwoNormals(il.ExactFlow):
    """Exact flow with the exact Gaussian transition of every body, which takes two normals."""

    order: ClassVar[float] = 2.0

    def _split(self, model: Model, step: float) -> np.ndarray:
        return np.zeros(len(model.mass), dtype=bool)
