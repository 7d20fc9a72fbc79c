"""Oscillators that take energy while they move little and lose it when they move much: limit cycles."""

from __future__ import annotations

from impactlab.components.fields import parameter
from impactlab.components.literature import article
from impactlab.components.oscillator import Oscillator


class VanDerPolOscillator(Oscillator):
    """Body with a damper that drives it at small displacements: residual force ``−growth (1 − (x/width)²) x'``.

    B. van der Pol, Philos. Mag. (7) 2 (1926) 978, whose equation ``x'' − μ (1 − x²) x' + x = 0`` has a unit mass, a
    unit stiffness, ``growth`` μ and a unit width. Its amplitude is close to twice the width for all μ.

    Parameters
    ----------
    growth : float
        Coefficient of the negative damping at rest (N s m-1).
    width : float
        Displacement beyond which it damps (m).

    Examples
    --------
    >>> il.VanDerPolOscillator(0.1, stiffness=1.0)
    VanDerPolOscillator(stiffness=1.0, growth=0.1)
    """

    citation = article("van der Pol, B.", "On relaxation-oscillations", "Philos. Mag.", 2, 1926, "978")

    growth: float = parameter(units="N s m-1", minimum=0.0)
    width: float = parameter(1.0, units="m", above=0.0)

    @staticmethod
    def residual(displacement, velocity, growth, width):  # type: ignore[no-untyped-def]
        ratio = displacement / width
        return growth * (ratio * ratio - 1.0) * velocity


class RayleighOscillator(Oscillator):
    """Body with a damper that drives it at small velocities: residual force ``−growth (1 − (x'/speed)²) x'``.

    Lord Rayleigh, Philos. Mag. (5) 15 (1883) 229. A small growth leaves the motion nearly harmonic, with the amplitude
    ``2 speed/(sqrt(3) ω)``. Its velocity moves as the displacement of `VanDerPolOscillator` with
    ``width = speed/sqrt(3)`` does.

    Parameters
    ----------
    growth : float
        Coefficient of the negative damping at rest (N s m-1).
    speed : float
        Velocity beyond which it damps (m s-1).

    Examples
    --------
    >>> il.RayleighOscillator(0.1, stiffness=1.0)
    RayleighOscillator(stiffness=1.0, growth=0.1)
    """

    citation = article("Rayleigh, Lord", "On maintained vibrations", "Philos. Mag.", 15, 1883, "229")

    growth: float = parameter(units="N s m-1", minimum=0.0)
    speed: float = parameter(1.0, units="m s-1", above=0.0)

    @staticmethod
    def residual(velocity, growth, speed):  # type: ignore[no-untyped-def]
        ratio = velocity / speed
        return growth * (ratio * ratio - 1.0) * velocity
