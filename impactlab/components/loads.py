"""Loads: given forces of common shapes in time, and of any shape by samples."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from impactlab.components.component import SHOWN
from impactlab.components.excitation import Excitation
from impactlab.components.fields import parameter
from impactlab.components.sampled_rows import between, sample_before, shown_samples, take_samples
from impactlab.errors import InvalidInput
from impactlab.inputs import checked, known_name, shown

if TYPE_CHECKING:
    import xarray as xr

_SHAPES = {"rectangle": 0, "half-sine": 1, "versed-sine": 2}
"""Powers of half a wave of a sine by the name of a pulse."""

_AFTER = "error", "zero", "repeat"
"""What may follow the last sample."""

_ORDERS = {"previous": 0, "linear": 1, "cubic": 3}
"""Degrees of the polynomials between samples by the name of an interpolation."""


class ConstantForce(Excitation):
    """Static load ``f(t) = F``.

    Parameters
    ----------
    load : float
        Force F (N), of either sign.

    Examples
    --------
    >>> il.ConstantForce(-9.81)
    ConstantForce(load=-9.81)
    """

    load: float = parameter(units="N")

    @property
    def highest_frequency(self) -> float:
        return 0.0

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

    Examples
    --------
    >>> il.Harmonic(1.5, frequency=5.0)
    Harmonic(amplitude=1.5, frequency=5.0)
    """

    amplitude: float = parameter(units="N")
    frequency: float = parameter(units="rad s-1", above=0.0)
    phase: float = parameter(0.0, units="rad")

    @property
    def highest_frequency(self) -> float:
        return self.frequency

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

    Examples
    --------
    >>> il.Chirp(1.0, start_frequency=1.0, end_frequency=40.0, duration=60.0)
    Chirp(amplitude=1.0, start_frequency=1.0, end_frequency=40.0, duration=60.0)
    """

    amplitude: float = parameter(units="N")
    start_frequency: float = parameter(units="rad s-1", minimum=0.0)
    end_frequency: float = parameter(units="rad s-1", minimum=0.0)
    duration: float = parameter(units="s", above=0.0)

    @property
    def acts_between(self) -> tuple[float, float]:
        return 0.0, self.duration

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

    Examples
    --------
    >>> il.Pulse(50.0, duration=0.1, start=2.0)
    Pulse(amplitude=50.0, duration=0.1, start=2.0)
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

    @property
    def acts_between(self) -> tuple[float, float]:
        return self.start, self.start + self.duration

    @staticmethod
    def force(time, amplitude, duration, start, power):  # type: ignore[no-untyped-def]
        if not start <= time <= start + duration:
            return 0.0
        return amplitude * math.sin(math.pi * (time - start) / duration) ** power


class SampledForce(Excitation):
    """Force given by samples, by default linear between them; 0 before the first one.

    Steps that divide the distances of samples know exactly its mean and its growth in them.

    Parameters
    ----------
    times : (sample,) array_like
        Increasing times of the samples, at equal or other distances (s). The measurement begins at 0.
    values : (sample,) array_like
        Forces (N), or what a `Source` multiplies by its weights: accelerations of the ground (m s-2), say.
    scale : float
        Factor of the values.
    after : str
        What follows the last sample: "error" refuses runs that are longer, "zero" is no force, and "repeat" the samples
        again, with the last one in the place of the first, so that they repeat before the first one as well.
    interpolation : str
        What is between two samples: "linear", "previous" for the value of the first of them, as a digital controller
        holds it, or "cubic" for the spline with continuous second derivatives, the third ones of which are continuous
        at the second and the last but one sample (de Boor, A Practical Guide to Splines, 1978, chapter 4); it is
        periodic if samples repeat that end as they begin.

    Raises
    ------
    InvalidInput
        If there is no such interpolation, there are not as many values as times, fewer than two, one is not finite, or
        times do not increase.

    Examples
    --------
    >>> il.SampledForce([0.0, 1.0, 2.0], [0.0, 3.0, 0.0], after="zero")
    SampledForce(times=(0.0, 1.0, 2.0), values=(0.0, 3.0, 0.0), after='zero')
    """

    times: Sequence[float] | np.ndarray = parameter(units="s")
    values: Sequence[float] | np.ndarray = parameter(units="N", kw_only=False)
    scale: float = parameter(1.0)
    after: str = parameter("error")
    interpolation: str = parameter("linear")

    def __post_init__(self) -> None:
        take_samples(self, "values")
        super().__post_init__()
        known_name("value of SampledForce.after", self.after, _AFTER)
        known_name("value of SampledForce.interpolation", self.interpolation, _ORDERS)

    @classmethod
    @checked
    def from_dataarray(cls, record: xr.DataArray, **fields: Any) -> Self:
        """Make the force from a labelled array over one dimension, whose coordinate are the times (s).

        Parameters
        ----------
        record : (time,) DataArray
            Values, with a coordinate of times.
        **fields
            ``scale``, ``after`` and ``interpolation``.
        """
        dimensions: tuple[Any, ...] = getattr(record, "dims", ())
        if len(dimensions) != 1 or dimensions[0] not in record.coords:
            raise InvalidInput(
                "SampledForce.from_dataarray takes a DataArray of one dimension, with a coordinate of times (s), not "
                f"{shown(getattr(record, 'sizes', record))}."
            )
        times = record[dimensions[0]]
        if times.dtype.kind not in "fiu":
            raise InvalidInput(f"SampledForce.from_dataarray takes times in seconds, not of the type {times.dtype}.")
        return cls(times.values, record.values, **fields)

    def __repr__(self) -> str:
        return super().__repr__() if len(self.times) <= SHOWN else shown_samples(self)

    @property
    def known_until(self) -> float:
        return float(self.times[-1]) if self.after == "error" else math.inf

    @property
    def acts_between(self) -> tuple[float, float]:
        return super().acts_between if self.repeats else (self.times[0], self.times[-1])

    @property
    def repeats(self) -> bool:
        """Whether the samples repeat."""
        return self.after == "repeat"

    @property
    def order(self) -> int:
        """Degree of the polynomials between samples."""
        return _ORDERS[self.interpolation]

    @functools.cached_property
    def curvatures(self) -> tuple[float, ...]:
        """Second derivatives of the spline at the samples; none if it is no spline (N s-2)."""
        if self.order < 3:
            return ()
        from scipy.interpolate import CubicSpline  # loaded only where it is asked for

        closed = self.repeats and self.values[0] == self.values[-1]
        spline = CubicSpline(self.times, self.values, bc_type="periodic" if closed else "not-a-knot")
        return tuple(spline(self.times, 2).tolist())

    @staticmethod
    def force(time, times, values, curvatures, scale, repeats, order):  # type: ignore[no-untyped-def]
        if repeats:
            time = times[0] + (time - times[0]) % (times[-1] - times[0])
        if not times[0] <= time <= times[-1]:
            return 0.0
        if order == 1:
            return scale * between(time, times, values)
        low = sample_before(time, times)
        if order == 0:
            return scale * values[low]
        length = times[low + 1] - times[low]
        share = (time - times[low]) / length
        rest = 1.0 - share
        bent = (rest**3 - rest) * curvatures[low] + (share**3 - share) * curvatures[low + 1]
        return scale * (rest * values[low] + share * values[low + 1] + length**2 / 6.0 * bent)
