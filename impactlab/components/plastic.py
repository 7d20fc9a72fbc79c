"""Contact laws that yield, or that adhere."""

from __future__ import annotations

import math

from impactlab.components.contact import ContactLaw
from impactlab.components.fields import parameter, state
from impactlab.components.literature import article
from impactlab.errors import InvalidInput


class _DentedContact(ContactLaw):
    """Base of laws that remember the largest indentation of a contact until it opens; abstract.

    Each contact begins on a fresh surface, so that motion under noise can be stationary.
    """

    largest: float = state(0.0, units="m", minimum=0.0)

    @staticmethod
    def update(indentation, largest):  # type: ignore[no-untyped-def]
        return max(indentation, largest) if indentation > 0.0 else 0.0


class WaltonBraunContact(_DentedContact):
    """Linear spring that unloads on a stiffer line: force ``k₁ δ``, or ``k₁ δ_max − k₂ (δ_max − δ)``, at least 0.

    O. R. Walton and R. L. Braun, J. Rheol. 30 (1986) 949. The restitution is sqrt(k₁/k₂) at all velocities. Bodies
    that go on along the unloading line load on it, too. When the contact opens, its dent is forgotten.

    Parameters
    ----------
    loading : float
        Stiffness k₁ of the first loading (N m-1).
    unloading : float
        Stiffness k₂ of unloading, at least k₁ (N m-1).
    largest : float
        State: the largest indentation δ_max since the contact has closed (m).

    Raises
    ------
    InvalidInput
        If unloading is softer than loading, which would give energy to the bodies.

    Examples
    --------
    >>> law = il.WaltonBraunContact(1e4, unloading=4e4)
    >>> round(law.restitution_at(0.5, mass=1.0), 3)
    0.5
    """

    citation = article(
        "Walton, O. R. and Braun, R. L.",
        "Viscosity, granular-temperature, and stress calculations for shearing assemblies of inelastic, "
        "frictional disks",
        "J. Rheol.", 30, 1986, "949", "10.1122/1.549893",
    )  # fmt: skip

    loading: float = parameter(units="N m-1", minimum=0.0, kw_only=False)
    unloading: float = parameter(units="N m-1", minimum=0.0)

    restitution_field = "unloading"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.unloading < self.loading:
            raise InvalidInput(
                f"WaltonBraunContact.unloading must be at least the stiffness of loading, {self.loading:g} N m-1, "
                f"not {self.unloading!r}."
            )

    @staticmethod
    def force(indentation, loading, unloading, largest):  # type: ignore[no-untyped-def]
        return max(loading * largest - unloading * (largest - indentation), 0.0)


class ThorntonContact(_DentedContact):
    """Elastic, perfectly plastic spheres: Hertz contact up to the yield indentation, then linear; unloading by Hertz.

    C. Thornton, J. Appl. Mech. 64 (1997) 383. Beyond δ_y the force goes on along its tangent, ``F_y + 3/2 η sqrt(δ_y)
    (δ − δ_y)``, as the pressure does not exceed that of yielding; from the largest indentation δ_max, at the force F,
    bodies unload as spheres of the larger radius that then fits: ``F (1 − (δ_max − δ)/r)^(3/2)`` over the recovery
    ``r = F/(η sqrt(δ_max))``. The restitution is 1 below the velocity of yielding, and falls with the velocity. When
    the contact opens, its dent is forgotten.

    Parameters
    ----------
    stiffness : float
        Stiffness η of the elastic contact (N m-3/2).
    yield_indentation : float
        Indentation δ_y at which yielding begins (m).
    largest : float
        State: the largest indentation δ_max since the contact has closed (m).

    Examples
    --------
    >>> law = il.ThorntonContact(1e4, yield_indentation=1e-3)
    >>> round(law.restitution_at(0.5, mass=1.0), 3)
    0.499
    """

    citation = article(
        "Thornton, C.",
        "Coefficient of restitution for collinear collisions of elastic-perfectly plastic spheres",
        "J. Appl. Mech.", 64, 1997, "383",
    )  # fmt: skip

    stiffness: float = parameter(units="N m-3/2", above=0.0, kw_only=False)
    yield_indentation: float = parameter(units="m", above=0.0)

    restitution_field = "yield_indentation"

    @staticmethod
    def force(indentation, stiffness, yield_indentation, largest):  # type: ignore[no-untyped-def]
        elastic = min(largest, yield_indentation)
        peak = stiffness * math.sqrt(elastic) * (elastic + 1.5 * (largest - elastic))
        if indentation >= largest:
            return peak
        left = max(1.0 - (largest - indentation) * stiffness * math.sqrt(largest) / peak, 0.0)
        return peak * left * math.sqrt(left)


class AdhesiveContact(ContactLaw):
    """Hertz contact of bodies that attract each other: force ``stiffness δ^(3/2) − pull_off``.

    B. V. Derjaguin, V. M. Muller and Y. P. Toporov, J. Colloid Interface Sci. 53 (1975) 314: bodies stick at the point
    of contact until they are pulled with `pull_off`, 2π w R for spheres of the radius R and a work of adhesion w. The
    force jumps where the contact opens or closes. It has a potential, so that a free collision loses no energy.

    Parameters
    ----------
    stiffness : float
        Contact stiffness η (N m-3/2).
    pull_off : float
        Force of adhesion (N).

    Examples
    --------
    >>> law = il.AdhesiveContact(1e4, pull_off=2.0)
    >>> law.evaluate([0.0025, 0.01])
    array([-0.75,  8.  ])
    """

    citation = article(
        "Derjaguin, B. V. and Muller, V. M. and Toporov, Y. P.",
        "Effect of contact deformations on the adhesion of particles",
        "J. Colloid Interface Sci.", 53, 1975, "314",
    )  # fmt: skip

    stiffness: float = parameter(units="N m-3/2", minimum=0.0)
    pull_off: float = parameter(units="N", minimum=0.0)

    @staticmethod
    def force(indentation, stiffness, pull_off):  # type: ignore[no-untyped-def]
        return stiffness * indentation * math.sqrt(indentation) - pull_off

    @staticmethod
    def potential(indentation, stiffness, pull_off):  # type: ignore[no-untyped-def]
        return 0.4 * stiffness * indentation * indentation * math.sqrt(indentation) - pull_off * indentation
