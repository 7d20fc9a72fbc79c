"""Couplings: springs and dampers between two bodies, or a body and a wall, and the laws of their forces."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from impactlab.components.component import Component, take_part
from impactlab.components.fields import parameter, state
from impactlab.components.sides import Side, check_sides, plain_sides
from impactlab.errors import InvalidInput


class CouplingLaw(Component):
    """Force of a coupling, which always acts, as a function of its extension.

    Subclasses define the kernel ``force(extension, rate, ...)`` (N, positive where it pulls
    the bodies together). A law with fields that are a `impactlab.state` defines
    ``update(extension, rate, elapsed, ...)``, which returns their values at an extension,
    `elapsed` seconds after they had those that it is given; ``force`` is given what ``update``
    returns. Either may take the `time` since the beginning of the measurement (s) as well.
    """

    kernels: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "force": ("extension", "rate", "time"),
        "update": ("extension", "rate", "elapsed", "time"),
    }
    required: ClassVar[tuple[str, ...]] = ("force",)

    @property
    def linear(self) -> tuple[float, float]:
        """Stiffness (N m-1) and damping (N s m-1) of a linear law; zeros for any other."""
        return 0.0, 0.0

    @property
    def dissipative(self) -> bool:
        """Whether the force depends on the rate, or on the past."""
        return "rate" in self.kernel("force")[1] or bool(self.state_names())

    def evaluate(self, extension: Any, rate: Any = 0.0, time: Any = 0.0) -> np.ndarray:
        """Return the force (N) for arrays of extensions (m), rates (m s-1) and times (s), from the start of states."""
        return self.call("force", extension, rate, time)


class LinearCoupling(CouplingLaw):
    """Spring and viscous damper: force ``stiffness e + damping e'`` at the extension e.

    Parameters
    ----------
    stiffness : float
        Stiffness (N m-1).
    damping : float
        Coefficient of viscous damping (N s m-1).
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


class MaxwellCoupling(CouplingLaw):
    """Spring and viscous damper in series: a force F with ``F'/stiffness + F/damping = e'`` at the extension e.

    J. C. Maxwell, Philos. Trans. R. Soc. 157 (1867) 49. Over a step the extension is taken to grow evenly.

    Parameters
    ----------
    stiffness : float
        Stiffness of the spring (N m-1).
    damping : float
        Coefficient of viscous damping (N s m-1).
    pull : float
        State: the force F (N).
    last : float
        State: the extension (m); the start value is that at which the force is `pull` at the start.
    """

    stiffness: float = parameter(units="N m-1", minimum=0.0)
    damping: float = parameter(units="N s m-1", above=0.0)
    pull: float = state(0.0, units="N")
    last: float = state(0.0, units="m")

    @staticmethod
    def force(extension, pull):  # type: ignore[no-untyped-def]
        return pull

    @staticmethod
    def update(extension, elapsed, pull, last, stiffness, damping):  # type: ignore[no-untyped-def]
        relaxed = elapsed * stiffness / damping
        share = -math.expm1(-relaxed) / relaxed if relaxed > 0.0 else 1.0
        return pull * math.exp(-relaxed) + stiffness * (extension - last) * share, extension


class BoucWenCoupling(CouplingLaw):
    """Hysteretic spring: ``k (α e + (1 − α) d z)``, with ``d z' = e' − (b |e'| z |z|^(n−1) + (1 − b) e' |z|^n)``.

    R. Bouc, 4th Conf. on Non-linear Oscillations, Prague (1967); Y.-K. Wen, J. Eng. Mech. Div. 102 (1976) 249, with
    A = 1, β = b/dⁿ, γ = (1 − b)/dⁿ and d z for his z. It depends on the extensions, not on how fast they change; z is
    integrated over them, exactly for n = 1 (else Runge–Kutta).

    Parameters
    ----------
    stiffness : float
        Stiffness k at small extensions (N m-1).
    yield_displacement : float
        Extension d from which on it yields (m).
    ratio : float
        Stiffness after yielding over that before, α.
    exponent : float
        Sharpness n of the transition, from 1 to 20.
    shape : float
        Shape b of the loop: unloading is linear at 1/2.
    hysteretic : float
        State: z, from −1 to 1.
    last : float
        State: the extension (m); the start value is that at which z is `hysteretic` at the start.
    """

    stiffness: float = parameter(units="N m-1", minimum=0.0)
    yield_displacement: float = parameter(units="m", above=0.0)
    ratio: float = parameter(0.0, minimum=0.0, maximum=1.0)
    exponent: float = parameter(1.0, minimum=1.0, maximum=20.0)
    shape: float = parameter(0.5, above=0.0, maximum=1.0)
    hysteretic: float = state(0.0, minimum=-1.0, maximum=1.0)
    last: float = state(0.0, units="m")

    @staticmethod
    def force(extension, stiffness, yield_displacement, ratio, hysteretic):  # type: ignore[no-untyped-def]
        return stiffness * (ratio * extension + (1.0 - ratio) * yield_displacement * hysteretic)

    @staticmethod
    def update(extension, hysteretic, last, yield_displacement, exponent, shape):  # type: ignore[no-untyped-def]
        way = min(max((extension - last) / yield_displacement, -_SATURATED), _SATURATED)
        if exponent == 1.0:
            return _plain_bouc_wen(hysteretic, way, shape), extension
        parts = 1 + int(4.0 * (1.0 + exponent) * abs(way))
        part, z = way / parts, hysteretic
        for _ in range(parts):
            k1 = _bouc_wen(z, part, exponent, shape)
            k2 = _bouc_wen(z + 0.5 * k1, part, exponent, shape)
            k3 = _bouc_wen(z + 0.5 * k2, part, exponent, shape)
            z += (k1 + 2.0 * (k2 + k3) + _bouc_wen(z + k3, part, exponent, shape)) / 6.0
        return z, extension


_SATURATED = 40.0
"""Extension, in yield displacements, after which z no longer knows where it began."""


def _plain_bouc_wen(z: float, way: float, shape: float) -> float:
    """Return z at the end of a way for n = 1, where its equation is linear on either side of 0."""
    ahead, left = math.copysign(1.0, way) * z, abs(way)
    if ahead < 0.0:  # unloading: grows by 1 + slope ahead
        slope = 1.0 - 2.0 * shape
        to_zero = -math.log1p(slope * ahead) / slope if slope != 0.0 else -ahead
        if left < to_zero:
            share = math.expm1(slope * left) / slope if slope != 0.0 else left
            return math.copysign(1.0, way) * (ahead + (1.0 + slope * ahead) * share)
        ahead, left = 0.0, left - to_zero
    return math.copysign(1.0, way) * (1.0 - (1.0 - ahead) * math.exp(-left))


def _bouc_wen(z: float, way: float, exponent: float, shape: float) -> float:
    """Return the change of z along a way."""
    size = abs(z)  # a power takes ten times as long as all else
    full: float = size if exponent == 1.0 else size * size if exponent == 2.0 else size**exponent
    return way - (shape * abs(way) * math.copysign(1.0, z) + (1.0 - shape) * way) * full


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

    def to_dict(self) -> dict[str, Any]:
        return plain_sides(super().to_dict())
