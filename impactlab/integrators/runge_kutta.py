"""The classical Runge-Kutta method of fourth order, for smooth excitation."""

from __future__ import annotations

from typing import ClassVar

from impactlab.integrators.explicit import ExplicitIntegrator


class RungeKutta4(ExplicitIntegrator):
    """Classical Runge-Kutta method with a fixed step.

    It is of fourth order for smooth forces; where Hertz contacts open and close, the second
    derivative of the force is singular and about 2.5 remains. Series of cosines and given
    forces are sampled at half steps. White noise is held constant over a step: the
    usual approximation, of second order in the mean squares of a linear body.
    """

    order: ClassVar[float] = 4.0
    nodes: ClassVar[tuple[float, ...]] = (0.0, 0.5, 0.5, 1.0)
    weights: ClassVar[tuple[float, ...]] = (1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0)
    fraction: ClassVar[float] = 0.05
