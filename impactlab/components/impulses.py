"""Impulses at random times: shot noise, also with an envelope."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from impactlab.components.excitation import Excitation
from impactlab.components.fields import parameter
from impactlab.components.literature import article
from impactlab.components.loads import SAMPLES_SHOWN, between, shown_samples, take_samples

_RICE = article(
    "Rice, S. O.",
    "Mathematical analysis of random noise",
    "Bell Syst. Tech. J.", 23, 1944, "282",
)  # fmt: skip


class PoissonImpulses(Excitation):
    """Impulses J_i at the times t_i of a Poisson process, which change velocities by J_i/m: ``f = Σ J_i δ(t − t_i)``.

    Their sizes are independent and normal, or all the same. The cumulants of a linear response are those of Campbell's
    theorem, ``κ_n = λ E[Jⁿ] ∫ g(t)ⁿ dt``, where g is the response to a unit impulse (Rice, Bell Syst. Tech. J. 23,
    1944, 282, sections 1.5 and 1.6); its mean and covariance are those under the constant force ``λ E[J]`` and white
    noise of the two-sided spectral density ``λ E[J²]/2π``.

    Parameters
    ----------
    rate : float
        Mean number λ of impulses per second (s-1).
    mean : float
        Mean size E[J] (N s), or of the changes of the ground's velocity in a `BaseMotion` (m s-1).
    standard_deviation : float
        Standard deviation of the sizes (N s); 0 if all are the same.
    """

    citation = _RICE

    rate: float = parameter(units="s-1", above=0.0)
    mean: float = parameter(units="N s")
    standard_deviation: float = parameter(0.0, units="N s", minimum=0.0)

    def impulses(self) -> tuple[float, float, float]:
        """Return rate (s-1), mean and standard deviation of the sizes (N s)."""
        return self.rate, self.mean, self.standard_deviation


class ModulatedImpulses(PoissonImpulses):
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
    """

    citation = _RICE

    times: Sequence[float] | np.ndarray = parameter(units="s", kw_only=False)
    envelope: Sequence[float] | np.ndarray = parameter(kw_only=False)

    def __post_init__(self) -> None:
        take_samples(self, "envelope")
        super().__post_init__()

    def __repr__(self) -> str:
        return super().__repr__() if len(self.times) <= SAMPLES_SHOWN else shown_samples(self)

    @property
    def largest_modulation(self) -> float:
        return float(np.abs(self.envelope).max())

    @property
    def acts_between(self) -> tuple[float, float]:
        return self.times[0], self.times[-1]

    @staticmethod
    def modulation(time, times, envelope):  # type: ignore[no-untyped-def]
        return between(time, times, envelope)
