"""Impulses at random times: shot noise."""

from __future__ import annotations

from impactlab.components.excitation import Excitation
from impactlab.components.fields import parameter
from impactlab.components.literature import article

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

    Examples
    --------
    >>> il.PoissonImpulses(2.0, mean=0.3, standard_deviation=0.1)
    PoissonImpulses(rate=2.0, mean=0.3, standard_deviation=0.1)
    """

    citation = _RICE

    rate: float = parameter(units="s-1", above=0.0)
    mean: float = parameter(units="N s")
    standard_deviation: float = parameter(0.0, units="N s", minimum=0.0)

    def impulses(self) -> tuple[float, float, float]:
        """Return rate (s-1), mean and standard deviation of the sizes (N s)."""
        return self.rate, self.mean, self.standard_deviation
