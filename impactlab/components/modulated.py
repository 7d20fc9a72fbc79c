"""Excitations times an envelope: noises, impulses and given forces that grow and fade."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from impactlab.components.coloured import FilteredNoise
from impactlab.components.component import SHOWN, take_part
from impactlab.components.excitation import Excitation
from impactlab.components.fields import parameter
from impactlab.components.filters import filter_of
from impactlab.components.impulses import PoissonImpulses
from impactlab.components.literature import article
from impactlab.components.sampled_rows import between, shown_samples, take_samples
from impactlab.errors import InvalidInput

WITH_ENVELOPE = {
    "force": "il.ModulatedForce",
    "intensity": "il.ModulatedNoise",
    "filter": "il.Modulated",
    "impulses": "il.ModulatedImpulses",
}
"""Excitations of each kind that take samples of an envelope."""

_MODULATED_BY = {
    "force": f"a given force with an envelope is an {WITH_ENVELOPE['force']}",
    "intensity": f"white noise with an envelope is an {WITH_ENVELOPE['intensity']}",
    "filter": f"coloured noise with an envelope is an {WITH_ENVELOPE['filter']}",
    "lines": (
        "sums of cosines have no envelope, since what they move would be no sum of cosines: take coloured noise of "
        "much the same spectrum, or samples of one realization, il.SampledForce"
    ),
    "impulses": f"impulses with an envelope are {WITH_ENVELOPE['impulses']}",
}
"""What an envelope of another kind of excitation is."""


class ModulatedExcitation(Excitation):
    """An excitation times an envelope e(t): linear between samples, and 0 before the first and after the last one.

    A subclass declares what is multiplied, and then the fields ``times`` and ``envelope``.
    """

    if TYPE_CHECKING:  # declared here, they would be the first positional arguments of the subclasses

        @property
        def times(self) -> Sequence[float] | np.ndarray: ...

        @property
        def envelope(self) -> Sequence[float] | np.ndarray: ...

    def __post_init__(self) -> None:
        take_samples(self, "envelope")
        super().__post_init__()

    def __repr__(self) -> str:
        if len(self.times) <= SHOWN:
            return super().__repr__()
        parts = [getattr(self, name) for name in self.field_names()]
        return shown_samples(self) + "".join(f" of {part!r}" for part in parts if isinstance(part, Excitation))

    @property
    def largest_modulation(self) -> float:
        return float(np.abs(self.envelope).max())

    @property
    def acts_between(self) -> tuple[float, float]:
        return self.times[0], self.times[-1]


class ModulatedNoise(ModulatedExcitation):
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

    Examples
    --------
    >>> il.ModulatedNoise(0.05, [0.0, 2.0, 10.0], [0.0, 1.0, 0.0])
    ModulatedNoise(spectral_density=0.05, times=(0.0, 2.0, 10.0), envelope=(0.0, 1.0, 0.0))
    """

    citation = article(
        "Priestley, M. B.",
        "Evolutionary spectra and non-stationary processes",
        "J. R. Stat. Soc. B", 27, 1965, "204",
    )  # fmt: skip

    spectral_density: float = parameter(units="N2 s rad-1", minimum=0.0)
    times: Sequence[float] | np.ndarray = parameter(units="s", kw_only=False)
    envelope: Sequence[float] | np.ndarray = parameter(kw_only=False)

    @staticmethod
    def intensity(time, spectral_density, times, envelope):  # type: ignore[no-untyped-def]
        return spectral_density * between(time, times, envelope) ** 2


class Modulated(ModulatedExcitation):
    """Coloured noise times an envelope given by samples: ``e(t) f(t)``, a uniformly modulated process.

    The envelope is linear between its samples, and 0 before the first and after the last one (Priestley, Evolutionary
    spectra and non-stationary processes, J. R. Stat. Soc. B 27, 1965, 204). White noise with an envelope is
    `ModulatedNoise`, a given force `ModulatedForce`, impulses `ModulatedImpulses`. Sums of cosines have none.

    Parameters
    ----------
    noise : FilteredNoise
        Noise where the envelope is 1.
    times : (sample,) array_like
        Increasing times of the samples, at equal or other distances (s). The measurement begins at 0.
    envelope : (sample,) array_like
        Factor e of the noise.

    Raises
    ------
    InvalidInput
        If the noise is not coloured, there are not as many values as times, fewer than two, one is not finite, or times
        do not increase.

    Examples
    --------
    >>> noise = il.OrnsteinUhlenbeckNoise(1.0, correlation_time=0.2)
    >>> il.Modulated(noise, [0.0, 2.0, 10.0], [0.0, 1.0, 0.0]).envelope
    (0.0, 1.0, 0.0)
    """

    citation = ModulatedNoise.citation

    noise: FilteredNoise = parameter(kw_only=False)
    times: Sequence[float] | np.ndarray = parameter(units="s", kw_only=False)
    envelope: Sequence[float] | np.ndarray = parameter(kw_only=False)

    def __post_init__(self) -> None:
        given = getattr(self.noise, "kind", None)
        if given in _MODULATED_BY and given != "filter":
            raise InvalidInput(f"Modulated.noise must be coloured noise, not {self.noise!r}; {_MODULATED_BY[given]}.")
        take_part(self, "noise", FilteredNoise, "coloured noise such as il.KanaiTajimi(1.0, 15.0, 0.6)")
        super().__post_init__()

    @property
    def at_rest(self) -> bool:
        return self.noise.at_rest

    def filter(self) -> tuple[Any, Any, Any]:
        """Return the filter of the noise; see `Excitation`."""
        return tuple(filter_of(self.noise))  # type: ignore[return-value]

    @staticmethod
    def modulation(time, times, envelope):  # type: ignore[no-untyped-def]
        return between(time, times, envelope)


class ModulatedImpulses(ModulatedExcitation, PoissonImpulses):
    """Impulses at random times times an envelope given by samples: ``f = Σ e(t_i) J_i δ(t − t_i)``.

    The envelope is linear between its samples, and 0 before the first and after the last one. By Campbell's theorem the
    cumulants of a linear response at a time t are ``κ_n = λ E[Jⁿ] ∫ e(s)ⁿ g(t − s)ⁿ ds``, as of `PoissonImpulses`.

    Parameters
    ----------
    rate : float
        Mean number λ of impulses per second (s-1).
    times : (sample,) array_like
        Increasing times of the samples, at equal or other distances (s). The measurement begins at 0.
    envelope : (sample,) array_like
        Factor e of the sizes.
    mean : float
        Mean size E[J] where the envelope is 1 (N s).
    standard_deviation : float
        Standard deviation of the sizes there (N s); 0 if all are the same.

    Raises
    ------
    InvalidInput
        If there are not as many values as times, fewer than two, one is not finite, or times do not increase.

    Examples
    --------
    >>> il.ModulatedImpulses(2.0, [0.0, 5.0, 20.0], [0.0, 1.0, 0.0], mean=0.3)
    ModulatedImpulses(rate=2.0, mean=0.3, times=(0.0, 5.0, 20.0), envelope=(0.0, 1.0, 0.0))
    """

    citation = PoissonImpulses.citation

    times: Sequence[float] | np.ndarray = parameter(units="s", kw_only=False)
    envelope: Sequence[float] | np.ndarray = parameter(kw_only=False)

    @staticmethod
    def modulation(time, times, envelope):  # type: ignore[no-untyped-def]
        return between(time, times, envelope)


class ModulatedForce(ModulatedExcitation):
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

    Examples
    --------
    >>> il.ModulatedForce(il.Harmonic(20.0, frequency=9.0), [0.0, 0.5, 3.0], [0.0, 1.0, 0.0])
    ModulatedForce(carrier=Harmonic(amplitude=20.0, frequency=9.0), times=(0.0, 0.5, 3.0), envelope=(0.0, 1.0, 0.0))
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
                f"{self.carrier!r}; {_MODULATED_BY[str(self.carrier.kind)]}."
            )
        super().__post_init__()

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
