"""Loads: given forces of common shapes in time, and forces and envelopes of noise of any shape by samples."""

from __future__ import annotations

import functools
import math
import reprlib
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from impactlab.components.component import known_name, take_part
from impactlab.components.evaluation import real_array
from impactlab.components.excitation import Excitation
from impactlab.components.fields import parameter
from impactlab.components.literature import article
from impactlab.errors import InvalidInput

if TYPE_CHECKING:
    import xarray as xr

_SHAPES = {"rectangle": 0, "half-sine": 1, "versed-sine": 2}
"""Powers of half a wave of a sine by the name of a pulse."""

_AFTER = "error", "zero", "repeat"
"""What may follow the last sample."""

_ORDERS = {"previous": 0, "linear": 1, "cubic": 3}
"""Degrees of the polynomials between samples by the name of an interpolation."""

_PLACES = {"times": ("time", "s"), "frequencies": ("frequency", "rad/s")}
"""What samples may be of: what one of them is called, and its unit."""

SAMPLES_SHOWN = 6
"""Samples up to which all are printed."""

MODULATED_BY = {
    "force": "a given force with an envelope is an il.ModulatedForce",
    "intensity": "white noise with an envelope is an il.ModulatedNoise",
    "filter": "coloured noise with an envelope is an il.Modulated",
    "lines": (
        "sums of cosines have no envelope, since what they move would be no sum of cosines: take coloured noise of "
        "much the same spectrum, or samples of one realization, il.SampledForce"
    ),
    "impulses": "impulses with an envelope are il.ModulatedImpulses",
}
"""What an envelope of another kind of excitation is."""


class ConstantForce(Excitation):
    """Static load ``f(t) = F``.

    Parameters
    ----------
    load : float
        Force F (N), of either sign.
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
                f"{reprlib.repr(getattr(record, 'sizes', record))}."
            )
        times = record[dimensions[0]]
        if times.dtype.kind not in "fiu":
            raise InvalidInput(f"SampledForce.from_dataarray takes times in seconds, not of the type {times.dtype}.")
        return cls(times.values, record.values, **fields)

    def __repr__(self) -> str:
        return super().__repr__() if len(self.times) <= SAMPLES_SHOWN else shown_samples(self)

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


class ModulatedForce(Excitation):
    """Given force times an envelope given by samples: ``e(t) f(t)``, such as a harmonic force that begins slowly.

    The envelope is linear between its samples, and 0 before the first and after the last one. Noise with an envelope is
    `ModulatedNoise` or `Modulated`.

    Parameters
    ----------
    carrier : Excitation
        The force where the envelope is 1: a given function of time, such as `Harmonic`, `Chirp` or `SampledForce`, but
        no `ModulatedForce`.
    times : (sample,) array_like
        Increasing times of the samples, at equal or other distances (s). The measurement begins at 0.
    envelope : (sample,) array_like
        Factor e of the force.

    Raises
    ------
    InvalidInput
        If the carrier is no given force, there are not as many values as times, fewer than two, one is not finite, or
        times do not increase.
    """

    carrier: Excitation = parameter(kw_only=False)
    times: Sequence[float] | np.ndarray = parameter(units="s", kw_only=False)
    envelope: Sequence[float] | np.ndarray = parameter(kw_only=False)

    def __post_init__(self) -> None:
        take_part(self, "carrier", Excitation, "a given force such as il.Harmonic(1.0, frequency=5.0)")
        if isinstance(self.carrier, ModulatedForce):
            raise InvalidInput("ModulatedForce.carrier has an envelope; give the product of both to its own carrier.")
        if self.carrier.kind != "force":
            raise InvalidInput(
                f"ModulatedForce.carrier must be a given force such as il.Harmonic(1.0, frequency=5.0), not "
                f"{self.carrier!r}; {MODULATED_BY[str(self.carrier.kind)]}."
            )
        take_samples(self, "envelope")
        super().__post_init__()

    def __repr__(self) -> str:
        return super().__repr__() if len(self.times) <= SAMPLES_SHOWN else f"{shown_samples(self)} of {self.carrier!r}"

    @property
    def known_until(self) -> float:
        end = self.carrier.known_until
        return math.inf if self.times[-1] <= end else end

    @property
    def acts_between(self) -> tuple[float, float]:
        first, last = self.carrier.acts_between
        first, last = max(first, self.times[0]), min(last, self.times[-1])
        return first, max(first, last)

    @property
    def multiplied_by(self) -> Excitation:
        return self.carrier

    def call(self, name: str, *kinematic: Any) -> np.ndarray:
        own = super().call(name, *kinematic)
        return own * self.carrier.call(name, *kinematic) if name == "force" else own

    @staticmethod
    def force(time, times, envelope):  # type: ignore[no-untyped-def]
        return between(time, times, envelope)  # what the force of the carrier is multiplied by


class TabulatedNoise(Excitation):
    """Bounded noise of a spectral density given as a table: a sum of cosines with random phases.

    The density is linear between the frequencies of the table, and 0 outside. Lines are ``Δω = (ω_b − ω_a)/N`` apart,
    at ω_a + Δω, …, ω_b, and each has the power of the band below it, so that the variance is exactly twice the integral
    of the table.

    Parameters
    ----------
    frequencies : (frequency,) array_like
        Increasing angular frequencies, from 0 or above on (rad s-1).
    densities : (frequency,) array_like
        Two-sided spectral densities over angular frequency (N2 s rad-1).
    components : int
        Number N of cosines.
    allow_repeat : bool
        Whether a run may be longer than ``2π/Δω``, after which the series repeats itself (up to a modulation with ω_a).

    Raises
    ------
    InvalidInput
        If a density or a frequency is negative, there are not as many densities as frequencies, fewer than two, one is
        not finite, or frequencies do not increase.
    """

    frequencies: Sequence[float] | np.ndarray = parameter(units="rad s-1", kw_only=False)
    densities: Sequence[float] | np.ndarray = parameter(units="N2 s rad-1", kw_only=False)
    components: int = parameter(4000, minimum=1)
    allow_repeat: bool = parameter(False)

    def __post_init__(self) -> None:
        take_samples(self, "densities", of="frequencies")
        super().__post_init__()
        if self.frequencies[0] < 0.0:
            raise InvalidInput(f"TabulatedNoise.frequencies must be at least 0 rad/s, not {self.frequencies[0]:g}.")
        for frequency, density in zip(self.frequencies, self.densities, strict=True):
            if density < 0.0:
                raise InvalidInput(
                    f"TabulatedNoise.densities must be at least 0, but that at {frequency:g} rad/s is {density:g}."
                )

    def __repr__(self) -> str:
        count = len(self.frequencies)
        if count <= SAMPLES_SHOWN:
            return super().__repr__()
        return f"TabulatedNoise of {count} densities from {self.frequencies[0]:g} to {self.frequencies[-1]:g} rad/s"

    @property
    def spacing(self) -> float:
        """Distance Δω between neighbouring lines (rad s-1)."""
        return (self.frequencies[-1] - self.frequencies[0]) / self.components

    @property
    def period(self) -> float:
        return math.inf if self.allow_repeat else 2.0 * math.pi / self.spacing

    def lines(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the angular frequencies (rad s-1) and the amplitudes (N) of the cosines."""
        known, density = np.array(self.frequencies), np.array(self.densities)
        ends = known[0] + self.spacing * np.arange(self.components + 1)
        places = np.union1d(known, ends[1:-1])
        values = np.interp(places, known, density)
        power = np.append(0.0, np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(places)))
        below = np.diff(np.interp(np.minimum(ends, places[-1]), places, power))
        return ends[1:], 2.0 * np.sqrt(np.maximum(below, 0.0))


class ModulatedNoise(Excitation):
    """White noise of the spectral density ``S e(t)²``, with an envelope e given by samples: ``e(t) w(t)``.

    The envelope is linear between its samples, and 0 before the first and after the last one (Priestley, Evolutionary
    spectra and non-stationary processes, J. R. Stat. Soc. B 27, 1965, 204).

    Parameters
    ----------
    spectral_density : float
        Two-sided spectral density S over angular frequency where the envelope is 1 (N2 s rad-1).
    times : (sample,) array_like
        Increasing times of the samples, at equal or other distances (s). The measurement begins at 0.
    envelope : (sample,) array_like
        Factor e of the noise.

    Raises
    ------
    InvalidInput
        If there are not as many values as times, fewer than two, one is not finite, or times do not increase.
    """

    citation = article(
        "Priestley, M. B.",
        "Evolutionary spectra and non-stationary processes",
        "J. R. Stat. Soc. B", 27, 1965, "204",
    )  # fmt: skip

    spectral_density: float = parameter(units="N2 s rad-1", minimum=0.0)
    times: Sequence[float] | np.ndarray = parameter(units="s", kw_only=False)
    envelope: Sequence[float] | np.ndarray = parameter(kw_only=False)

    def __post_init__(self) -> None:
        take_samples(self, "envelope")
        super().__post_init__()

    def __repr__(self) -> str:
        return super().__repr__() if len(self.times) <= SAMPLES_SHOWN else shown_samples(self)

    @property
    def acts_between(self) -> tuple[float, float]:
        return self.times[0], self.times[-1]

    @staticmethod
    def intensity(time, spectral_density, times, envelope):  # type: ignore[no-untyped-def]
        return spectral_density * between(time, times, envelope) ** 2


def between(time: float, times: Sequence[float], values: Sequence[float]) -> float:
    """Return what is linear between samples, and 0 elsewhere."""
    if not times[0] <= time <= times[-1]:
        return 0.0
    low = sample_before(time, times)
    share = (time - times[low]) / (times[low + 1] - times[low])
    return (1.0 - share) * values[low] + share * values[low + 1]


def sample_before(time: float, times: Sequence[float]) -> int:
    """Return the number of the last sample, but for the last of all, that is not after a time.

    Samples at equal distances are found where they must be, others by bisection.
    """
    low, high = 0, len(times) - 1
    middle = min(int((time - times[0]) / (times[high] - times[0]) * high), high - 1)
    while high - low > 1:
        if times[middle] <= time:
            low = middle
        else:
            high = middle
        middle = low + 1 if times[low + 1] > time else (low + high) // 2
    return low


def take_samples(owner: Any, name: str, of: str = "times") -> None:
    """Make tuples of the times of a component, or of other places, and of the values of some name, or refuse them."""
    kind, (one, units) = type(owner).__name__, _PLACES[of]
    times, values = (_samples(f"{kind}.{field}", getattr(owner, field)) for field in (of, name))
    if len(times) != len(values):
        raise InvalidInput(f"{kind} takes a value for each {one}, not {len(values)} for {len(times)} {of}.")
    if len(times) < 2:
        raise InvalidInput(f"{kind} needs two samples at least.")
    back = np.flatnonzero(np.diff(times) <= 0.0)
    if len(back):
        raise InvalidInput(
            f"{kind}.{of} must increase, but sample {back[0] + 1} (from 0) at {times[back[0] + 1]:g} {units} follows "
            f"one at {times[back[0]]:g} {units}."
        )
    object.__setattr__(owner, of, tuple(times.tolist()))
    object.__setattr__(owner, name, tuple(values.tolist()))


def shown_samples(owner: Any) -> str:
    """Say what a component of many samples is."""
    times = owner.times
    return f"{type(owner).__name__} of {len(times)} samples from {times[0]:g} to {times[-1]:g} s"


def _samples(place: str, given: Any) -> np.ndarray:
    """Return a row of finite numbers, or refuse it."""
    try:
        array = real_array(given)
    except (TypeError, ValueError):
        raise InvalidInput(f"{place} must be real numbers, not {reprlib.repr(given)}.") from None
    if array.ndim != 1:
        raise InvalidInput(f"{place} must be a row of numbers, not of shape {array.shape}.")
    wrong = np.flatnonzero(~np.isfinite(array))
    if len(wrong):
        raise InvalidInput(
            f"{place} must be finite, but {len(wrong)} of {len(array)} are not, the first at {wrong[0]} (from 0)."
        )
    return array
