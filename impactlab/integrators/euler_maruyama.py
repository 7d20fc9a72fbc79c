"""The Euler-Maruyama method, a baseline for white noise."""

from __future__ import annotations

from typing import ClassVar

from impactlab.integrators.explicit import ExplicitIntegrator


class EulerMaruyama(ExplicitIntegrator):
    """Euler-Maruyama method with a fixed step: first order, stable only below ``2 ζ/ω``.

    It is here as the baseline that most hand-written simulations use (Maruyama, Rend. Circ. Mat.
    Palermo 4, 1955, 48).
    """

    order: ClassVar[float] = 1.0
    nodes: ClassVar[tuple[float, ...]] = (0.0,)
    weights: ClassVar[tuple[float, ...]] = (1.0,)
    fraction: ClassVar[float] = 0.02
