"""Coupling laws that are nonlinear dampers: odd functions of the rate of the extension."""

from __future__ import annotations

import math

from impactlab.components.coupling import CouplingLaw
from impactlab.components.fields import parameter
from impactlab.components.literature import article, entry


class QuadraticDampingCoupling(CouplingLaw):
    """Damper of turbulent flow: force ``damping |e'| e'`` at the rate e' of the extension.

    J. R. Morison, M. P. O'Brien, J. W. Johnson and S. A. Schaaf, Trans. AIME 189 (1950) 149. For a body in a fluid that
    is at rest, coupled to `WALL`, the coefficient is half the density times the drag coefficient and the area.

    Parameters
    ----------
    damping : float
        Coefficient of the force (N s2 m-2).

    Examples
    --------
    >>> il.QuadraticDampingCoupling(3.0).evaluate(0.0, rate=[-2.0, 2.0])
    array([-12.,  12.])
    """

    citation = article(
        "Morison, J. R. and O'Brien, M. P. and Johnson, J. W. and Schaaf, S. A.",
        "The force exerted by surface waves on piles",
        "Trans. AIME", 189, 1950, "149",
    )  # fmt: skip

    damping: float = parameter(units="N s2 m-2", minimum=0.0)

    @staticmethod
    def force(rate, damping):  # type: ignore[no-untyped-def]
        return damping * abs(rate) * rate


class PowerLawDampingCoupling(CouplingLaw):
    """Damper whose force is a power of the rate: ``damping |e'/1 m s-1|^p sign e'``.

    M. C. Constantinou and M. D. Symans, Technical Report NCEER-92-0032 (1992), for fluid dampers of buildings, of which
    p is 0.3 to 2. Exponent 2 is `QuadraticDampingCoupling`, which is faster; dry friction, the limit 0, is
    `CoulombFrictionCoupling` or `FrictionCoupling`.

    Parameters
    ----------
    damping : float
        Coefficient, given as the force at a rate of 1 m s-1 (N).
    exponent : float
        Exponent p, more than 0 and at most 20.

    Examples
    --------
    >>> il.PowerLawDampingCoupling(3.0, exponent=0.5).evaluate(0.0, rate=[-4.0, 4.0])
    array([-6.,  6.])
    """

    citation = entry("techreport", "Constantinou, M. C. and Symans, M. D.", 1992, number="NCEER-92-0032")

    damping: float = parameter(units="N", minimum=0.0)
    exponent: float = parameter(above=0.0, maximum=20.0)

    @staticmethod
    def force(rate, damping, exponent):  # type: ignore[no-untyped-def]
        return math.copysign(damping * abs(rate) ** exponent, rate)


class FrictionCoupling(CouplingLaw):
    """Dry friction that is smooth about rest: force ``friction tanh(e'/velocity)``.

    S. Andersson, A. Söderberg and S. Björklund, Tribol. Int. 40 (2007) 580. Coulomb's law is the limit of a vanishing
    velocity scale. Nothing sticks: under a steady force f below the friction F a body creeps at
    ``velocity artanh(f/F)``. `CoulombFrictionCoupling` sticks, and so does `JenkinsCoupling` on its spring.

    Parameters
    ----------
    friction : float
        Force of sliding (N).
    velocity : float
        Velocity at which the force is 0.76 of that (m s-1); the smaller, the shorter the steps.

    Examples
    --------
    >>> il.FrictionCoupling(1.5, velocity=0.01).evaluate(0.0, rate=[-1.0, 1.0])
    array([-1.5,  1.5])
    """

    citation = article("Andersson, S. and Söderberg, A. and Björklund, S.", "", "Tribol. Int.", 40, 2007, "580")

    friction: float = parameter(units="N", minimum=0.0)
    velocity: float = parameter(units="m s-1", above=0.0)

    @staticmethod
    def force(rate, friction, velocity):  # type: ignore[no-untyped-def]
        return friction * math.tanh(rate / velocity)
