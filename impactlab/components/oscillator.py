"""Oscillators: one body each, a linear part and, if need be, a residual force."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import KW_ONLY
from typing import Any, ClassVar, Self

from impactlab.components.component import Component
from impactlab.components.fields import parameter
from impactlab.components.literature import article
from impactlab.errors import InvalidInput
from impactlab.inputs import checked, finite


class Oscillator(Component):
    """One body: ``mass x'' + damping x' + stiffness x + residual(x, x') = forces``.

    Subclasses may add fields and two kernels: ``residual(displacement, velocity, ...)``,
    the part of the restoring force that is not linear (N), and
    ``residual_potential(displacement, ...)``, its integral if it has one (J, 0 at 0).
    Subclasses with fields that are a `impactlab.state` define ``update(displacement, velocity,
    elapsed, ...)``, which returns their values at a displacement, `elapsed` seconds after they had
    those that it is given; ``residual`` is given what ``update`` returns. Either may take the `time`
    since the beginning of the measurement (s) as well.

    Parameters
    ----------
    mass : float
        Mass (kg).
    damping : float
        Coefficient of viscous damping (N s m-1).
    stiffness : float
        Stiffness of the linear spring (N m-1); 0 for a free body.

    Notes
    -----
    The motion is that of equation :eq:`motion` of the theory.

    Examples
    --------
    >>> class Quadratic(il.Oscillator):
    ...     quadratic: float = il.parameter(units="N m-2", minimum=0.0)
    ...
    ...     @staticmethod
    ...     def residual(displacement, quadratic):
    ...         return quadratic * displacement * abs(displacement)
    >>> Quadratic(50.0, damping=0.5, stiffness=10.0)
    Quadratic(damping=0.5, stiffness=10.0, quadratic=50.0)
    """

    kernels: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "residual": ("displacement", "velocity", "time"),
        "residual_potential": ("displacement",),
        "update": ("displacement", "velocity", "elapsed", "time"),
    }

    moves_as_given: ClassVar[bool] = False
    """Whether the motion of the body is given, whatever forces act on it."""

    _: KW_ONLY
    mass: float = parameter(1.0, units="kg", above=0.0)
    damping: float = parameter(0.0, units="N s m-1", minimum=0.0)
    stiffness: float = parameter(0.0, units="N m-1", minimum=0.0)

    def __new__(cls, /, *values: Any, **fields: Any) -> Self:
        if cls is Oscillator:
            raise InvalidInput("Oscillator is abstract: use LinearOscillator or another of its subclasses.")
        return super().__new__(cls, *values, **fields)

    @classmethod
    @checked
    def from_frequency(
        cls, natural_frequency: float, damping_ratio: float = 0.0, *, mass: float = 1.0, **fields: Any
    ) -> Self:
        """Make an oscillator from the natural frequency and the damping ratio.

        Parameters
        ----------
        natural_frequency : float
            Undamped natural frequency ω (rad s-1); ``stiffness = mass ω²``.
        damping_ratio : float
            Ratio ζ of the damping to the critical one; ``damping = 2 ζ ω mass``.
        mass : float
            Mass (kg).
        **fields
            Further fields of the class.

        Raises
        ------
        InvalidInput
            If a value is negative or not finite, or damping or stiffness is given as well.
        """
        frequency = finite(f"{cls.__name__}.from_frequency: natural_frequency", natural_frequency)
        ratio = finite(f"{cls.__name__}.from_frequency: damping_ratio", damping_ratio)
        if frequency < 0.0 or ratio < 0.0:
            raise InvalidInput(
                f"{cls.__name__}.from_frequency takes a natural frequency and a damping ratio of at least 0, not "
                f"{natural_frequency!r} and {damping_ratio!r}."
            )
        for name in ("damping", "stiffness"):
            if name in fields:
                raise InvalidInput(
                    f"{cls.__name__}.from_frequency computes {name} from the frequency and the damping ratio; "
                    f"leave {name} out, or give mass, damping and stiffness to {cls.__name__} itself."
                )
        mass = finite(f"{cls.__name__}.mass", mass)
        return cls(mass=mass, damping=2.0 * ratio * frequency * mass, stiffness=mass * frequency * frequency, **fields)

    @property
    def natural_frequency(self) -> float:
        """Undamped natural frequency of the linear part (rad s-1)."""
        return float((self.stiffness / self.mass) ** 0.5)

    @property
    def damping_ratio(self) -> float:
        """Ratio of the damping to the critical one; infinite for a damped free body."""
        critical = 2.0 * (self.stiffness * self.mass) ** 0.5
        if critical == 0.0:
            return float("inf") if self.damping else 0.0
        return float(self.damping / critical)


LAG = 1e-9
"""Time (s) by which a coordinate without mass lags behind forces: a shorter one only adds to rounding."""


class LinearOscillator(Oscillator):
    """Body on a linear spring and a viscous damper.

    Examples
    --------
    >>> il.LinearOscillator.from_frequency(10.0, damping_ratio=0.05)
    LinearOscillator(damping=1.0, stiffness=100.0)
    """

    @classmethod
    @checked
    def massless(cls, damping: float, stiffness: float = 0.0, *, lag: float = LAG) -> LinearOscillator:
        """Make a coordinate of an equation of first order, ``c x' + k x = f``, of a mass that does not matter.

        A charge behind a resistance c and a capacity 1/k, a node between springs and dampers, an actuator with the time
        constant c/k. Its mass is ``lag c``, so that it follows forces with this lag; linear couplings move it exactly,
        at steps of the other bodies' times. Contacts, and couplings that are not linear, act on bodies with a mass that
        a spring connects with it: a network in which one acts on it is refused, while a light
        ``LinearOscillator(mass=…)`` may have any. Under white noise its velocity has no meaning, and is as large as
        the mass is small.

        Parameters
        ----------
        damping : float
            Coefficient c (N s m-1, or Ω for a charge).
        stiffness : float
            Stiffness k (N m-1, or F-1 for a charge).
        lag : float
            Time (s) that is short beside all others; about 1e-9 of them is best, since rounding grows where it is less.

        Raises
        ------
        InvalidInput
            If the damping or the lag is not positive, or a value is not finite.
        """
        place = f"{cls.__name__}.massless"
        for name, value in (("damping", damping), ("lag", lag)):
            if not finite(f"{place}: {name}", value) > 0.0:
                raise InvalidInput(
                    f"{place} needs a positive {name}, not {value!r}: without friction nothing of first order is left."
                    if name == "damping"
                    else f"{place} needs a positive lag, such as {LAG:g} of the shortest time (s), not {value!r}."
                )
        return MasslessCoordinate(mass=lag * damping, damping=damping, stiffness=stiffness)


class MasslessCoordinate(LinearOscillator):
    """What `LinearOscillator.massless` makes, with a mass that does not matter; files call it by this name."""


class DuffingOscillator(Oscillator):
    """Body on a spring with a cubic term: residual force ``cubic x³``.

    Parameters
    ----------
    cubic : float
        Coefficient of the cubic restoring force (N m-3).

    Examples
    --------
    >>> il.DuffingOscillator(0.5, damping=0.1, stiffness=1.0)
    DuffingOscillator(damping=0.1, stiffness=1.0, cubic=0.5)
    """

    cubic: float = parameter(units="N m-3", minimum=0.0)

    @staticmethod
    def residual(displacement, cubic):  # type: ignore[no-untyped-def]
        return cubic * displacement * displacement * displacement

    @staticmethod
    def residual_potential(displacement, cubic):  # type: ignore[no-untyped-def]
        square = displacement * displacement
        return 0.25 * cubic * square * square


class InvertedOscillator(Oscillator):
    """Body that is repelled from its centre: residual force ``−repulsion x``, as of an inverted pendulum.

    S. W. Shaw and R. H. Rand, Int. J. Non-Linear Mech. 24 (1989) 41, between stops. The repulsion is what is taken off
    the `stiffness`, which is 0 by default. A network in which no contact and no coupling holds it is refused.

    Parameters
    ----------
    repulsion : float
        Negative stiffness (N m-1).

    Examples
    --------
    >>> il.InvertedOscillator(5.0, damping=0.5)
    InvertedOscillator(damping=0.5, repulsion=5.0)
    """

    citation = article("Shaw, S. W. and Rand, R. H.", "", "Int. J. Non-Linear Mech.", 24, 1989, "41")

    repulsion: float = parameter(units="N m-1", minimum=0.0)

    @staticmethod
    def residual(displacement, repulsion):  # type: ignore[no-untyped-def]
        return -repulsion * displacement

    @staticmethod
    def residual_potential(displacement, repulsion):  # type: ignore[no-untyped-def]
        return -0.5 * repulsion * displacement * displacement


class ParametricOscillator(Oscillator):
    """Body on a spring whose stiffness varies: residual force ``stiffness depth cos(ω t) x``.

    E. Mathieu, J. Math. Pures Appl. 13 (1868) 137. The equation of motion is
    ``mass x'' + damping x' + stiffness (1 + depth cos(ω t)) x = forces``, with the time t since the beginning of the
    measurement. With little damping it grows without end where ω is near twice the natural frequency, and
    ``depth > 4 damping_ratio``; where it does not, noise moves it with moments of the period of ω.

    Parameters
    ----------
    depth : float
        Amplitude of the stiffness over its mean; a spring with a depth above 1 repels the body now and then.
    frequency : float
        Angular frequency ω of the stiffness (rad s-1).

    Examples
    --------
    >>> il.ParametricOscillator(0.4, frequency=5.0, damping=0.5, stiffness=10.0)
    ParametricOscillator(damping=0.5, stiffness=10.0, depth=0.4, frequency=5.0)
    """

    citation = article(
        "Mathieu, É.", "Mémoire sur le mouvement vibratoire d'une membrane de forme elliptique",
        "J. Math. Pures Appl.", 13, 1868, "137",
    )  # fmt: skip

    depth: float = parameter(minimum=0.0)
    frequency: float = parameter(units="rad s-1", above=0.0)

    @staticmethod
    def residual(displacement, time, stiffness, depth, frequency):  # type: ignore[no-untyped-def]
        return stiffness * depth * math.cos(frequency * time) * displacement


class DoubleWellOscillator(Oscillator):
    """Body that is repelled from its centre, into one of two wells: residual force ``cubic x³ − repulsion x``.

    P. Holmes, Philos. Trans. R. Soc. A 292 (1979) 419, and F. C. Moon and P. J. Holmes, J. Sound Vib. 65 (1979) 275: a
    Duffing oscillator of negative stiffness, such as a beam that has buckled. The repulsion is what is taken off the
    `stiffness`, which is 0 by default.

    Parameters
    ----------
    cubic : float
        Coefficient of the cubic restoring force (N m-3).
    repulsion : float
        Negative stiffness (N m-1).

    Examples
    --------
    >>> bistable = il.DoubleWellOscillator(4.0, repulsion=1.0, damping=0.5)
    >>> bistable.wells, bistable.barrier
    (0.5, 0.0625)
    """

    citation = article(
        "Holmes, P.", "A nonlinear oscillator with a strange attractor", "Philos. Trans. R. Soc. A", 292, 1979, "419",
        "10.1098/rsta.1979.0068",
    )  # fmt: skip

    cubic: float = parameter(units="N m-3", above=0.0)
    repulsion: float = parameter(units="N m-1", minimum=0.0)

    @property
    def wells(self) -> float:
        """Distance of the wells from the centre (m); 0 where the spring is stronger than the repulsion."""
        return float((max(self.repulsion - self.stiffness, 0.0) / self.cubic) ** 0.5)

    @property
    def barrier(self) -> float:
        """Energy at the centre above that in the wells (J)."""
        return float(max(self.repulsion - self.stiffness, 0.0) ** 2 / (4.0 * self.cubic))

    @staticmethod
    def residual(displacement, cubic, repulsion):  # type: ignore[no-untyped-def]
        return (cubic * displacement * displacement - repulsion) * displacement

    @staticmethod
    def residual_potential(displacement, cubic, repulsion):  # type: ignore[no-untyped-def]
        square = displacement * displacement
        return (0.25 * cubic * square - 0.5 * repulsion) * square
