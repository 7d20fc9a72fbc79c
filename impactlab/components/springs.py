"""Coupling laws that are nonlinear springs: odd functions of the extension."""

from __future__ import annotations

import math

from impactlab.components.coupling import CouplingLaw
from impactlab.components.fields import parameter
from impactlab.components.literature import article


class CubicCoupling(CouplingLaw):
    """Cubic spring: force ``cubic e³`` at the extension e, without a linear part.

    The spring of nonlinear energy sinks: O. Gendelman, L. I. Manevitch, A. F. Vakakis and R. M'Closkey, J. Appl. Mech.
    68 (2001) 34. A linear spring beside it is best a coupling of its own, `LinearCoupling`.

    Parameters
    ----------
    cubic : float
        Coefficient of the force (N m-3).

    Examples
    --------
    >>> il.CubicCoupling(1e3).evaluate([-0.1, 0.2])
    array([-1.,  8.])
    """

    citation = article(
        "Gendelman, O. and Manevitch, L. I. and Vakakis, A. F. and M'Closkey, R.", "", "J. Appl. Mech.", 68, 2001, "34"
    )

    cubic: float = parameter(units="N m-3", minimum=0.0)

    @staticmethod
    def force(extension, cubic):  # type: ignore[no-untyped-def]
        return cubic * extension * extension * extension

    @staticmethod
    def potential(extension, cubic):  # type: ignore[no-untyped-def]
        square = extension * extension
        return 0.25 * cubic * square * square


class PowerLawCoupling(CouplingLaw):
    """Spring whose force is a power of the extension: ``stiffness |e/1 m|^p sign e``.

    Exponent 3 is `CubicCoupling`, which is faster. Free vibration of a mass m to the amplitude a has the period
    ``4 sqrt(m (p + 1)/(2 stiffness)) B(1/(p + 1), 1/2)/(p + 1) a^((1 − p)/2)``, with Euler's B and numbers in SI units;
    A. H. Nayfeh and D. T. Mook, Nonlinear Oscillations (1979), section 2.1, is about such integrals.

    Parameters
    ----------
    stiffness : float
        Stiffness, given as the force at an extension of 1 m (N).
    exponent : float
        Exponent p, more than 0 and at most 20.

    Examples
    --------
    >>> il.PowerLawCoupling(100.0, exponent=2.0).evaluate([-0.1, 0.1])
    array([-1.,  1.])
    """

    stiffness: float = parameter(units="N", minimum=0.0)
    exponent: float = parameter(above=0.0, maximum=20.0)

    @staticmethod
    def force(extension, stiffness, exponent):  # type: ignore[no-untyped-def]
        return math.copysign(stiffness * abs(extension) ** exponent, extension)

    @staticmethod
    def potential(extension, stiffness, exponent):  # type: ignore[no-untyped-def]
        return stiffness * abs(extension) ** (exponent + 1.0) / (exponent + 1.0)


class BilinearCoupling(CouplingLaw):
    """Spring of two slopes: ``k e`` up to the break d on either side, ``(k d + k₂ (|e| − d)) sign e`` beyond it.

    S. W. Shaw and P. J. Holmes, J. Sound Vib. 90 (1983) 129, is about oscillators of this kind. It gets stiffer beyond
    the break, or softer; with ``outer_stiffness=0`` the force does not grow any more. A slope that changes on one side
    only is a `LinearCoupling` beside a contact of `LinearContact` with a clearance.

    Parameters
    ----------
    stiffness : float
        Stiffness k at small extensions (N m-1).
    outer_stiffness : float
        Stiffness k₂ beyond the break (N m-1).
    break_extension : float
        Extension d at which the slope changes (m).

    Examples
    --------
    >>> il.BilinearCoupling(100.0, outer_stiffness=400.0, break_extension=0.1).evaluate([0.1, 0.2])
    array([10., 50.])
    """

    citation = article("Shaw, S. W. and Holmes, P. J.", "", "J. Sound Vib.", 90, 1983, "129")

    stiffness: float = parameter(units="N m-1", minimum=0.0)
    outer_stiffness: float = parameter(units="N m-1", minimum=0.0)
    break_extension: float = parameter(units="m", above=0.0)

    @staticmethod
    def force(extension, stiffness, outer_stiffness, break_extension):  # type: ignore[no-untyped-def]
        inner = max(-break_extension, min(break_extension, extension))
        return stiffness * inner + outer_stiffness * (extension - inner)

    @staticmethod
    def potential(extension, stiffness, outer_stiffness, break_extension):  # type: ignore[no-untyped-def]
        inner = min(abs(extension), break_extension)
        beyond = abs(extension) - inner
        return 0.5 * stiffness * inner * inner + (stiffness * break_extension + 0.5 * outer_stiffness * beyond) * beyond
