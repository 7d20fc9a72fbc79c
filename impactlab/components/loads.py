"""Loads: given forces of common shapes in time."""

from __future__ import annotations

import math

from impactlab.components.component import known_name
from impactlab.components.excitation import Excitation
from impactlab.components.fields import parameter

_SHAPES = {"rectangle": 0, "half-sine": 1, "versed-sine": 2}
"""Powers of half a wave of a sine by the name of a pulse."""


class ConstantForce(Excitation):
    """Static load ``f(t) = F``.

    Parameters
    ----------
    load : float
        Force F (N), of either sign.
    """

    load: float = parameter(units="N")

    @staticmethod
    def force(load):  # type: ignore[no-untyped-def]
        return load


class Harmonic(Excitation):
    """Harmonic force ``f(t) = F sin(ω t + φ)``, which acts before t = 0 as well, in the spin-up.

    Parameters
    ----------
    amplitude : float
        Amplitude F (N).
    frequency : float
        Angular frequency ω (rad s-1), as all frequencies of bodies are; 2π times that in hertz.
    phase : float
        Phase φ at t = 0 (rad); π/2 for a cosine.
    """

    amplitude: float = parameter(units="N")
    frequency: float = parameter(units="rad s-1", above=0.0)
    phase: float = parameter(0.0, units="rad")

    @staticmethod
    def force(time, amplitude, frequency, phase):  # type: ignore[no-untyped-def]
        return amplitude * math.sin(frequency * time + phase)


class Chirp(Excitation):
    """Sine sweep ``f(t) = F sin(ω₁ t + (ω₂ − ω₁) t²/(2 T))`` for 0 ≤ t ≤ T, and 0 before and after it.

    The angular frequency, the derivative of the argument, grows linearly from ω₁ to ω₂ (Ewins, Modal Testing, 2nd ed.,
    2000, chapter 3).

    Parameters
    ----------
    amplitude : float
        Amplitude F (N).
    start_frequency, end_frequency : float
        Angular frequencies ω₁ and ω₂ (rad s-1), in either order.
    duration : float
        Duration T (s).
    """

    amplitude: float = parameter(units="N")
    start_frequency: float = parameter(units="rad s-1", minimum=0.0)
    end_frequency: float = parameter(units="rad s-1", minimum=0.0)
    duration: float = parameter(units="s", above=0.0)

    @staticmethod
    def force(time, amplitude, start_frequency, end_frequency, duration):  # type: ignore[no-untyped-def]
        if not 0.0 <= time <= duration:
            return 0.0
        growth = (end_frequency - start_frequency) / duration
        return amplitude * math.sin((start_frequency + 0.5 * growth * time) * time)


class Pulse(Excitation):
    """Single pulse ``f(t) = F sinᵖ(π (t − t₀)/T)`` for t₀ ≤ t ≤ t₀ + T, else 0.

    The power p is 0 for a rectangle, 1 for half a wave of a sine, and 2 for a versed sine,
    ``F (1 − cos(2π (t − t₀)/T))/2`` (Harris and Piersol, Shock and Vibration Handbook, 5th ed., 2002, chapter 8).

    Parameters
    ----------
    amplitude : float
        Largest force F (N).
    duration : float
        Duration T (s).
    start : float
        Time t₀ at which it begins (s).
    shape : str
        "half-sine", "rectangle" or "versed-sine".

    Raises
    ------
    InvalidInput
        If there is no such shape, or no duration.
    """

    amplitude: float = parameter(units="N")
    duration: float = parameter(units="s", above=0.0)
    start: float = parameter(0.0, units="s")
    shape: str = parameter("half-sine")

    def __post_init__(self) -> None:
        super().__post_init__()
        known_name("shape of a pulse", self.shape, _SHAPES)

    @property
    def power(self) -> int:
        """Power of half a wave of a sine."""
        return _SHAPES[self.shape]

    @staticmethod
    def force(time, amplitude, duration, start, power):  # type: ignore[no-untyped-def]
        if not start <= time <= start + duration:
            return 0.0
        return amplitude * math.sin(math.pi * (time - start) / duration) ** power
