"""Couplings: springs and dampers between two bodies, or a body and a wall, and the laws of their forces."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np

from impactlab.components.component import Component, take_part
from impactlab.components.fields import parameter
from impactlab.components.literature import article
from impactlab.components.sides import Side, check_sides
from impactlab.errors import InvalidInput
from impactlab.inputs import FiniteNumbers, checked, of_one_shape


class Series(NamedTuple):
    """A spring beside another one in series with a damper, and the state that tells the force of the latter."""

    beside: float  # stiffness of the spring that is alone (N m-1)
    stiffness: float  # of the spring in series (N m-1)
    damping: float  # of the damper (N s m-1)
    state: str
    gain: float  # state over the force of spring and damper in series


class CouplingLaw(Component):
    """Force of a coupling, which always acts, as a function of its extension.

    Subclasses define the kernel ``force(extension, rate, ...)`` (N, positive where it pulls
    the bodies together), and, if the force has one, the kernel ``potential(extension, ...)`` (J, 0
    at 0), which makes exact stationary laws possible. A law with fields that are a `impactlab.state` defines
    ``update(extension, rate, elapsed, ...)``, which returns their values at an extension,
    `elapsed` seconds after they had those that it is given; ``force`` is given what ``update``
    returns. Either may take the `time` since the beginning of the measurement (s) as well.

    Examples
    --------
    >>> class Hardening(il.CouplingLaw):
    ...     stiffness: float = il.parameter(units="N m-1")
    ...
    ...     @staticmethod
    ...     def force(extension, stiffness):
    ...         return stiffness * extension * (1.0 + extension * extension)
    >>> Hardening(100.0).evaluate([0.0, 1.0])
    array([  0., 200.])
    """

    kernels: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "force": ("extension", "rate", "time"),
        "potential": ("extension",),
        "update": ("extension", "rate", "elapsed", "time"),
    }
    required: ClassVar[tuple[str, ...]] = ("force",)

    sticks: ClassVar[bool] = False
    """Whether slip and stick are located within the flow of a step, so that the force does not kick."""

    @property
    def linear(self) -> tuple[float, float]:
        """Stiffness (N m-1) and damping (N s m-1) of a linear law; zeros for any other."""
        return 0.0, 0.0

    @property
    def series(self) -> Series | None:
        """The springs and the damper that the law is, if it is linear with a force that relaxes."""
        return None

    @property
    def dissipative(self) -> bool:
        """Whether the force depends on the rate, or on the past."""
        return "rate" in self.kernel("force")[1] or bool(self.state_names())

    @checked
    def evaluate(self, extension: FiniteNumbers, rate: FiniteNumbers = 0.0, time: FiniteNumbers = 0.0) -> np.ndarray:
        """Return the force (N) for arrays of extensions (m), rates (m s-1) and times (s), from the start of states."""
        return self.call("force", *of_one_shape(type(self).__name__, *map(np.asarray, (extension, rate, time))))


class LinearCoupling(CouplingLaw):
    """Spring and viscous damper: force ``stiffness e + damping e'`` at the extension e.

    Parameters
    ----------
    stiffness : float
        Stiffness (N m-1).
    damping : float
        Coefficient of viscous damping (N s m-1).

    Examples
    --------
    >>> il.LinearCoupling(100.0, damping=2.0).evaluate(0.1, rate=0.5)
    array(11.)
    """

    stiffness: float = parameter(units="N m-1", minimum=0.0)
    damping: float = parameter(0.0, units="N s m-1", minimum=0.0)

    def __init_subclass__(cls, **options: Any) -> None:
        if "force" in cls.__dict__:
            raise InvalidInput(f"{cls.__name__} would be taken for linear: derive it from il.CouplingLaw.")
        super().__init_subclass__(**options)

    @property
    def linear(self) -> tuple[float, float]:
        return self.stiffness, self.damping

    @property
    def dissipative(self) -> bool:
        return self.damping > 0.0

    @staticmethod
    def force(extension, rate, stiffness, damping):  # type: ignore[no-untyped-def]
        return stiffness * extension + damping * rate


class MatrixTerm(LinearCoupling):
    """Spring and damper that is a term of the matrices of an `impactlab.LinearStructure`."""


class CoulombFrictionCoupling(CouplingLaw):
    """Dry friction that sticks: force ``friction sign(e' + velocity)``, or what holds the sides together at 0.

    C. A. de Coulomb, Mém. Math. Phys. Acad. R. Sci. 10 (1785) 161. While it slips the force is constant. It sticks as
    soon as the rate e' + velocity is 0 and the force that this takes is not more than ``static_ratio friction``, and
    slips when it is. Both are located within the steps of `ExactFlow`, in the linear motion of the bodies between the
    kicks of contacts and couplings. With `WALL` it is a body on the ground, or on a belt. A body has one such
    friction, or several with `EventLocated`, and no white noise, under which nothing sticks; `FrictionCoupling` acts
    there.

    Parameters
    ----------
    friction : float
        Force of sliding (N).
    static_ratio : float
        Force up to which it sticks over that of sliding, the ratio of the coefficients of static and sliding friction.
    velocity : float
        Velocity of the surface of the second side, a belt, beyond that of the side itself (m s-1).

    Notes
    -----
    The force that holds a body is that of equation :eq:`holding-force` of the theory.

    Examples
    --------
    >>> il.CoulombFrictionCoupling(1.5, static_ratio=1.3, velocity=0.2)
    CoulombFrictionCoupling(friction=1.5, static_ratio=1.3, velocity=0.2)
    """

    citation = article(
        "de Coulomb, C. A.", "Théorie des machines simples", "Mém. Math. Phys. Acad. R. Sci.", 10, 1785, "161"
    )

    sticks: ClassVar[bool] = True

    friction: float = parameter(units="N", minimum=0.0)
    static_ratio: float = parameter(1.0, minimum=1.0)
    velocity: float = parameter(0.0, units="m s-1")

    @staticmethod
    def force(rate, friction, velocity):  # type: ignore[no-untyped-def]
        slip = rate + velocity
        return math.copysign(friction, slip) if slip != 0.0 else 0.0


class Coupling(Component):
    """A spring or damper between two bodies, or a body and a wall.

    The extension is ``x_second − x_first``; the law's force acts on `first` in the positive
    and on `second` in the negative direction.

    Parameters
    ----------
    first, second : str, Combination or WALL
        Names of the bodies. The displacement of a combination is that of its point.
    law : CouplingLaw
        Law of the force.

    Raises
    ------
    InvalidInput
        If a body is coupled to itself, no weight is left of a combination, or a value is not what it should be.

    Examples
    --------
    >>> il.Coupling("a", "b", il.LinearCoupling(100.0))
    Coupling('a', 'b', LinearCoupling(stiffness=100.0))
    """

    first: Side = parameter(kw_only=False)
    second: Side = parameter(kw_only=False)
    law: CouplingLaw = parameter(kw_only=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_sides(self)
        take_part(self, "law", CouplingLaw, "a coupling law such as il.LinearCoupling(1e3)")

    def __repr__(self) -> str:
        return f"Coupling({self.first!r}, {self.second!r}, {self.law!r})"
