"""Contact laws with viscous damping: by coefficients, or by a restitution and the closing velocity."""

from __future__ import annotations

import math
from typing import Any, Self

from impactlab.components.contact import ContactLaw
from impactlab.components.fields import parameter, state
from impactlab.components.literature import article
from impactlab.inputs import finite, positive


def _pushing(force: float, tension: bool) -> float:
    """Return a force, or 0 where it would pull and must not."""
    return force if tension else max(force, 0.0)


class _DashpotContact(ContactLaw):
    """Base of laws with a dashpot of its own beside the spring, as `damping`; abstract."""

    restitution_field = "damping"

    @classmethod
    def from_damping_ratio(cls, stiffness: float, damping_ratio: float, mass: float, **fields: Any) -> Self:
        """Make a law with the damping ``2 ζ sqrt(stiffness mass)``.

        Parameters
        ----------
        stiffness : float
            Contact stiffness, in the units of the law.
        damping_ratio : float
            Damping ratio ζ.
        mass : float
            Effective mass of the bodies that collide, ``m₁ m₂/(m₁ + m₂)``, m₁ at a wall (kg).
        **fields
            Further fields of the law.

        Raises
        ------
        InvalidInput
            If a value is not allowed.
        """
        product = positive("mass", mass, "kg") * max(finite("stiffness", stiffness), 0.0)
        return cls(stiffness=stiffness, damping=2.0 * finite("damping_ratio", damping_ratio) * product**0.5, **fields)


class KelvinVoigtContact(_DashpotContact):
    """Linear spring and dashpot in parallel: force ``stiffness δ + damping δ'``.

    The dashpot acts at once when bodies touch, and pulls before they part, unless it is not allowed to: without
    `tension` the force is at least 0, and the bodies are free from where it vanishes. Of a damping ratio ζ < 1 the
    restitution is exp(−π ζ/sqrt(1 − ζ²)) with tension, S. A. Anagnostopoulos, Earthq. Eng. Struct. Dyn. 16 (1988) 443,
    and exp(−2 ζ arccos(ζ)/sqrt(1 − ζ²)) without, T. Schwager and T. Pöschel, Granular Matter 9 (2007) 465. It does not
    depend on the velocity.

    Parameters
    ----------
    stiffness : float
        Contact stiffness κ (N m-1).
    damping : float
        Coefficient of the dashpot (N s m-1).
    tension : bool
        Whether the force may pull.

    Examples
    --------
    >>> il.KelvinVoigtContact(1e4, damping=20.0).evaluate(0.01, rate=[0.5, -8.0])
    array([110.,   0.])
    """

    citation = article(
        "Anagnostopoulos, S. A.",
        "",
        "Earthq. Eng. Struct. Dyn.", 16, 1988, "443",
    )  # fmt: skip

    stiffness: float = parameter(units="N m-1", minimum=0.0)
    damping: float = parameter(units="N s m-1", minimum=0.0)
    tension: bool = parameter(False)

    @property
    def linear(self) -> tuple[float, float] | None:
        own = type(self).force is KelvinVoigtContact.force
        return (self.stiffness, self.damping) if own else None

    @staticmethod
    def force(indentation, rate, stiffness, damping, tension):  # type: ignore[no-untyped-def]
        return _pushing(stiffness * indentation + damping * rate, tension)


class TsujiContact(_DashpotContact):
    """Hertz contact with a dashpot of constant restitution: force ``stiffness δ^(3/2) + damping δ^(1/4) δ'``.

    Y. Tsuji, T. Tanaka and T. Ishida, Powder Technol. 71 (1992) 239, with ``damping = α sqrt(m stiffness)``. The
    restitution does not depend on the velocity; with tension it is exp(−π α/sqrt(5 − α²)), D. Antypov and
    J. A. Elliott, Europhys. Lett. 94 (2011) 50004.

    Parameters
    ----------
    stiffness : float
        Contact stiffness η (N m-3/2).
    damping : float
        Coefficient of the dashpot (N s m-5/4).
    tension : bool
        Whether the force may pull; without tension it is at least 0.

    Examples
    --------
    >>> law = il.TsujiContact(1e4, damping=20.0)
    >>> round(law.restitution_at(0.5, mass=1.0), 3)
    0.766
    """

    citation = article(
        "Tsuji, Y. and Tanaka, T. and Ishida, T.",
        "Lagrangian numerical simulation of plug flow of cohesionless particles in a horizontal pipe",
        "Powder Technol.", 71, 1992, "239", "10.1016/0032-5910(92)88030-L",
    )  # fmt: skip

    stiffness: float = parameter(units="N m-3/2", minimum=0.0)
    damping: float = parameter(units="N s m-5/4", minimum=0.0)
    tension: bool = parameter(False)

    @staticmethod
    def force(indentation, rate, stiffness, damping, tension):  # type: ignore[no-untyped-def]
        root = math.sqrt(indentation)
        return _pushing(stiffness * indentation * root + damping * math.sqrt(root) * rate, tension)


class JankowskiContact(_DashpotContact):
    """Hertz contact with damping while bodies approach: force ``stiffness δ^(3/2) + damping δ^(1/4) max(δ', 0)``.

    R. Jankowski, Earthq. Eng. Struct. Dyn. 34 (2005) 595, with ``damping = 2 ξ sqrt(m stiffness)``. The restitution e
    does not depend on the velocity; ibid. 35 (2006) 517 gives
    ``ξ ≈ (9 sqrt(5)/2) (1 − e²)/(e (e (9π − 16) + 16))``, within 0.01 of e.

    Parameters
    ----------
    stiffness : float
        Contact stiffness β (N m-3/2).
    damping : float
        Coefficient of the dashpot (N s m-5/4).

    Examples
    --------
    >>> law = il.JankowskiContact(1e4, damping=20.0)
    >>> round(law.restitution_at(0.5, mass=1.0), 3)
    0.875
    """

    citation = article(
        "Jankowski, R.",
        "Non-linear viscoelastic modelling of earthquake-induced structural pounding",
        "Earthq. Eng. Struct. Dyn.", 34, 2005, "595", "10.1002/eqe.434",
    )  # fmt: skip

    stiffness: float = parameter(units="N m-3/2", minimum=0.0)
    damping: float = parameter(units="N s m-5/4", minimum=0.0)

    @staticmethod
    def force(indentation, rate, stiffness, damping):  # type: ignore[no-untyped-def]
        root = math.sqrt(indentation)
        return stiffness * indentation * root + damping * math.sqrt(root) * max(rate, 0.0)


class HuntCrossleyContact(ContactLaw):
    """Power law with damping in proportion to it: force ``K (δ/1 m)^p (1 + χ δ')``, at least 0.

    K. H. Hunt and F. R. E. Crossley, J. Appl. Mech. 42 (1975) 440. The force begins and ends at 0. At a closing
    velocity v the restitution e follows from ``(1 + e) χ v = ln((1 + χ v)/(1 − e χ v))``, whatever the exponent;
    ``χ ≈ 3/2 (1 − e)/v`` is good for e close to 1 only.

    Parameters
    ----------
    stiffness : float
        Contact stiffness K, given as the elastic force at an indentation of 1 m (N).
    dissipation : float
        Dissipation χ (s m-1).
    exponent : float
        Exponent p, more than 0 and at most 20.

    Examples
    --------
    >>> law = il.HuntCrossleyContact(1e4, dissipation=0.5)
    >>> round(law.restitution_at(0.5, mass=1.0), 3)
    0.857
    """

    citation = article(
        "Hunt, K. H. and Crossley, F. R. E.",
        "Coefficient of restitution interpreted as damping in vibroimpact",
        "J. Appl. Mech.", 42, 1975, "440", "10.1115/1.3423596",
    )  # fmt: skip

    stiffness: float = parameter(units="N", minimum=0.0)
    dissipation: float = parameter(units="s m-1", minimum=0.0)
    exponent: float = parameter(1.5, above=0.0, maximum=20.0)

    restitution_field = "dissipation"

    @staticmethod
    def force(indentation, rate, stiffness, dissipation, exponent):  # type: ignore[no-untyped-def]
        return stiffness * indentation**exponent * max(1.0 + dissipation * rate, 0.0)


class _ClosingVelocityContact(ContactLaw):
    """Base of laws whose damping follows from a restitution and the closing velocity; abstract.

    They are Hunt and Crossley's with ``χ = loss/δ'₀``, so that the true restitution does not depend on the velocity.
    In a collision δ' is between δ'₀ and −δ'₀. Where other forces move bodies faster than they have closed, δ'/δ'₀
    counts as 1 or −1: the damping of a contact that closes slowly would else grow without a limit. Subclasses have the
    property `loss`, a number for each restitution.
    """

    stiffness: float = parameter(units="N", minimum=0.0)
    restitution: float = parameter(minimum=0.0, maximum=1.0, kw_only=True)
    exponent: float = parameter(1.5, above=0.0, maximum=20.0, kw_only=True)
    closing: float = state(0.0, units="m s-1", minimum=0.0)

    required = ("force", "loss")
    restitution_field = "restitution"

    @staticmethod
    def update(indentation, rate, closing):  # type: ignore[no-untyped-def]
        if indentation <= 0.0:
            return 0.0
        return closing if closing > 0.0 else max(rate, 0.0)


def _damped(indentation, rate, stiffness, exponent, loss, closing):  # type: ignore[no-untyped-def]
    """Return the force of these laws, which never pulls; no free collision is damped by more than `loss`."""
    damping = loss * min(max(rate / closing, -1.0), 1.0) if closing > 0.0 else 0.0
    return stiffness * indentation**exponent * max(1.0 + damping, 0.0)


class LankaraniNikraveshContact(_ClosingVelocityContact):
    """Power law with damping by the closing velocity: force ``K (δ/1 m)^p (1 + 3/4 (1 − e²) δ'/δ'₀)``.

    H. M. Lankarani and P. E. Nikravesh, J. Mech. Des. 112 (1990) 369. δ'₀ is the velocity at which the contact has
    closed, until it opens again; one that is closed at the start has no damping before. The published ratio δ'/δ'₀ has
    no limit; here it is at most 1 and at least −1, as in any free collision. It would be beyond where other forces move
    bodies that have closed slowly. The force never pulls. Bodies rebound with nearly the restitution e where that is
    close to 1, and with more where it is not.

    Parameters
    ----------
    stiffness : float
        Contact stiffness K, given as the elastic force at an indentation of 1 m (N).
    restitution : float
        Coefficient of restitution e, from 0 to 1.
    exponent : float
        Exponent p, more than 0 and at most 20.
    closing : float
        State: the closing velocity δ'₀ (m s-1), 0 while the contact is open.

    Examples
    --------
    >>> law = il.LankaraniNikraveshContact(1e4, restitution=0.8)
    >>> round(law.restitution_at(0.5, mass=1.0), 3)
    0.847
    """

    citation = article(
        "Lankarani, H. M. and Nikravesh, P. E.",
        "A contact force model with hysteresis damping for impact analysis of multibody systems",
        "J. Mech. Des.", 112, 1990, "369", "10.1115/1.2912617",
    )  # fmt: skip

    @property
    def loss(self) -> float:
        """Damping at the closing velocity, as a part of the elastic force."""
        return 0.75 * (1.0 - self.restitution * self.restitution)

    force = _damped


class HertzdampContact(LankaraniNikraveshContact):
    """The Hertzdamp model of structural pounding: `LankaraniNikraveshContact` with the exponent 3/2.

    S. Muthukumar and R. DesRoches, Earthq. Eng. Struct. Dyn. 35 (2006) 811.

    Examples
    --------
    >>> law = il.HertzdampContact(1e4, restitution=0.8)
    >>> round(law.restitution_at(0.5, mass=1.0), 3)
    0.847
    """

    citation = article(
        "Muthukumar, S. and DesRoches, R.",
        "A Hertz contact model with non-linear damping for pounding simulation",
        "Earthq. Eng. Struct. Dyn.", 35, 2006, "811", "10.1002/eqe.557",
    )  # fmt: skip


class FloresContact(_ClosingVelocityContact):
    """Power law for all restitutions: force ``K (δ/1 m)^p (1 + 8/5 (1 − e)/e δ'/δ'₀)``, at least 0.

    P. Flores, M. Machado, M. T. Silva and J. M. Martins, Multibody Syst. Dyn. 25 (2011) 357. Bodies rebound with up to
    0.05 less than e. The damping has no limit for e = 0, which is refused. δ'₀ is that of `LankaraniNikraveshContact`.

    Parameters
    ----------
    stiffness : float
        Contact stiffness K, given as the elastic force at an indentation of 1 m (N).
    restitution : float
        Coefficient of restitution e, more than 0 and at most 1.
    exponent : float
        Exponent p, more than 0 and at most 20.
    closing : float
        State: the closing velocity δ'₀ (m s-1), 0 while the contact is open.

    Examples
    --------
    >>> law = il.FloresContact(1e4, restitution=0.8)
    >>> round(law.restitution_at(0.5, mass=1.0), 3)
    0.789
    """

    citation = article(
        "Flores, P. and Machado, M. and Silva, M. T. and Martins, J. M.",
        "On the continuous contact force models for soft materials in multibody dynamics",
        "Multibody Syst. Dyn.", 25, 2011, "357", "10.1007/s11044-010-9237-4",
    )  # fmt: skip

    restitution: float = parameter(above=0.0, maximum=1.0)

    @property
    def loss(self) -> float:
        """Damping at the closing velocity, as a part of the elastic force."""
        return 1.6 * (1.0 - self.restitution) / self.restitution

    force = _damped


class GonthierContact(_ClosingVelocityContact):
    """Power law for all restitutions: force ``K (δ/1 m)^p (1 + (1 − e²)/e δ'/δ'₀)``, at least 0.

    Y. Gonthier, J. McPhee, C. Lange and J.-C. Piedbœuf, Multibody Syst. Dyn. 11 (2004) 209, with their approximation
    d = 1 − e² of the solution of ``(1 + d/e)/(1 − d) = exp(d (1 + 1/e))``. Bodies rebound within 0.04 of e. The damping
    has no limit for e = 0, which is refused. δ'₀ is that of `LankaraniNikraveshContact`.

    Parameters
    ----------
    stiffness : float
        Contact stiffness K, given as the elastic force at an indentation of 1 m (N).
    restitution : float
        Coefficient of restitution e, more than 0 and at most 1.
    exponent : float
        Exponent p, more than 0 and at most 20.
    closing : float
        State: the closing velocity δ'₀ (m s-1), 0 while the contact is open.

    Examples
    --------
    >>> law = il.GonthierContact(1e4, restitution=0.8)
    >>> round(law.restitution_at(0.5, mass=1.0), 3)
    0.768
    """

    citation = article(
        "Gonthier, Y. and McPhee, J. and Lange, C. and Piedboeuf, J.-C.",
        "A regularized contact model with asymmetric damping and dwell-time dependent friction",
        "Multibody Syst. Dyn.", 11, 2004, "209", "10.1023/B:MUBO.0000029392.21648.bc",
    )  # fmt: skip

    restitution: float = parameter(above=0.0, maximum=1.0)

    @property
    def loss(self) -> float:
        """Damping at the closing velocity, as a part of the elastic force."""
        return (1.0 - self.restitution**2) / self.restitution

    force = _damped


class CarvalhoMartinsContact(_ClosingVelocityContact):
    """Power law for all restitutions: ``K (δ/1 m)^p (1 + 3/2 (1 − e)(11 − e)/(1 + 9e) δ'/δ'₀)``, at least 0.

    A. S. Carvalho and J. M. Martins, Mech. Mach. Theory 139 (2019) 174; their approximation of the exact relation.
    Bodies rebound within 0.01 of e where it is 0.2 or more, and with up to 0.07 more below. δ'₀ is that of
    `LankaraniNikraveshContact`.

    Parameters
    ----------
    stiffness : float
        Contact stiffness K, given as the elastic force at an indentation of 1 m (N).
    restitution : float
        Coefficient of restitution e, from 0 to 1.
    exponent : float
        Exponent p, more than 0 and at most 20.
    closing : float
        State: the closing velocity δ'₀ (m s-1), 0 while the contact is open.

    Examples
    --------
    >>> law = il.CarvalhoMartinsContact(1e4, restitution=0.8)
    >>> round(law.restitution_at(0.5, mass=1.0), 3)
    0.8
    """

    citation = article(
        "Carvalho, A. S. and Martins, J. M.",
        "Exact restitution and generalizations for the Hunt-Crossley contact model",
        "Mech. Mach. Theory", 139, 2019, "174", "10.1016/j.mechmachtheory.2019.04.018",
    )  # fmt: skip

    @property
    def loss(self) -> float:
        """Damping at the closing velocity, as a part of the elastic force."""
        return 1.5 * (1.0 - self.restitution) * (11.0 - self.restitution) / (1.0 + 9.0 * self.restitution)

    force = _damped
