"""Coupling laws with a memory: relaxation, electric circuits, hysteresis and dry friction in series with a spring."""

from __future__ import annotations

import math

from impactlab.components.coupling import CouplingLaw, Series
from impactlab.components.fields import parameter, state
from impactlab.components.literature import article, entry, joined_entries


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

    Examples
    --------
    >>> law = il.MaxwellCoupling(100.0, damping=5.0)
    >>> il.Coupling("a", il.WALL, law)
    Coupling('a', WALL, MaxwellCoupling(stiffness=100.0, damping=5.0))
    """

    citation = article(
        "Maxwell, J. C.", "On the dynamical theory of gases", "Philos. Trans. R. Soc.", 157, 1867, "49",
        "10.1098/rstl.1867.0004",
    )  # fmt: skip

    stiffness: float = parameter(units="N m-1", minimum=0.0)
    damping: float = parameter(units="N s m-1", above=0.0)
    pull: float = state(0.0, units="N")
    last: float = state(0.0, units="m")

    @property
    def series(self) -> Series:
        return Series(0.0, self.stiffness, self.damping, "pull", 1.0)

    @staticmethod
    def force(extension, pull):  # type: ignore[no-untyped-def]
        return pull

    @staticmethod
    def update(extension, elapsed, pull, last, stiffness, damping):  # type: ignore[no-untyped-def]
        return _relaxed(pull, stiffness * (extension - last), elapsed * stiffness / damping), extension


def _relaxed(value: float, added: float, elapsed: float) -> float:
    """Relax a value with unit time constant over `elapsed` time constants, while `added` enters at a constant rate."""
    share = -math.expm1(-elapsed) / elapsed if elapsed > 0.0 else 1.0
    return value * math.exp(-elapsed) + added * share


class ZenerCoupling(CouplingLaw):
    """Standard linear solid: a spring beside a spring and a damper in series, of which `MaxwellCoupling` tells.

    C. Zener, Elasticity and Anelasticity of Metals (1948). The force is ``k e + F`` with ``F'/k₁ + F/c = e'``, so that
    the stiffness is k + k₁ in fast motion and k in slow motion. A stiff spring k is better a `LinearCoupling` beside a
    `MaxwellCoupling`, whose motion is exact.

    Parameters
    ----------
    stiffness : float
        Stiffness k of the spring that does not relax (N m-1).
    relaxing_stiffness : float
        Stiffness k₁ of the spring in series with the damper (N m-1).
    damping : float
        Coefficient c of viscous damping (N s m-1).
    pull : float
        State: the force F (N).
    last : float
        State: the extension (m); the start value is that at which the force is `pull` at the start.

    Examples
    --------
    >>> law = il.ZenerCoupling(100.0, relaxing_stiffness=50.0, damping=5.0)
    >>> il.Coupling("a", il.WALL, law)
    Coupling('a', WALL, ZenerCoupling(stiffness=100.0, relaxing_stiffness=50.0, damping=5.0))
    """

    citation = entry("book", "Zener, C.", 1948, title="Elasticity and Anelasticity of Metals")

    stiffness: float = parameter(units="N m-1", minimum=0.0)
    relaxing_stiffness: float = parameter(units="N m-1", minimum=0.0)
    damping: float = parameter(units="N s m-1", above=0.0)
    pull: float = state(0.0, units="N")
    last: float = state(0.0, units="m")

    @property
    def series(self) -> Series:
        return Series(self.stiffness, self.relaxing_stiffness, self.damping, "pull", 1.0)

    @staticmethod
    def force(extension, stiffness, pull):  # type: ignore[no-untyped-def]
        return stiffness * extension + pull

    @staticmethod
    def update(extension, elapsed, pull, last, relaxing_stiffness, damping):  # type: ignore[no-untyped-def]
        rate = relaxing_stiffness / damping
        return _relaxed(pull, relaxing_stiffness * (extension - last), elapsed * rate), extension


class PiezoelectricCoupling(CouplingLaw):
    """Piezoelectric transducer with a resistor: force ``−θ v`` with the voltage v of ``C v' + v/R + θ e' = 0``.

    A. Erturk and D. J. Inman, J. Vib. Acoust. 130 (2008) 041002, as an energy harvester whose piezoelectric stiffness
    is counted elsewhere. A trajectory has the voltage, and v²/R is the power. Over a step the extension is taken to
    grow evenly. A coil with the inductance L and the resistance R in a magnet, of the force ``K i`` with
    ``L i' + R i = K e'``, is a `MaxwellCoupling` of the stiffness K²/L and the damping K²/R.

    Parameters
    ----------
    transduction : float
        Force over voltage θ (N V-1); its sign, of which only the polarity depends, is positive.
    capacitance : float
        Capacitance C (F).
    resistance : float
        Resistance R (ohm).
    voltage : float
        State: the voltage v (V).
    last : float
        State: the extension (m); the start value is that at which the voltage is `voltage` at the start.

    Examples
    --------
    >>> patch = il.PiezoelectricCoupling(1e-3, capacitance=1e-7, resistance=1e5)
    >>> patch.state_names()
    ('voltage', 'last')
    """

    citation = article(
        "Erturk, A. and Inman, D. J.",
        "A distributed parameter electromechanical model for cantilevered piezoelectric energy harvesters",
        "J. Vib. Acoust.", 130, 2008, "041002",
    )  # fmt: skip

    transduction: float = parameter(units="N V-1", minimum=0.0)
    capacitance: float = parameter(units="F", above=0.0)
    resistance: float = parameter(units="ohm", above=0.0)
    voltage: float = state(0.0, units="V")
    last: float = state(0.0, units="m")

    @property
    def series(self) -> Series | None:
        force = self.transduction
        if not force:
            return None
        return Series(0.0, force**2 / self.capacitance, force**2 * self.resistance, "voltage", -1.0 / force)

    @staticmethod
    def force(extension, transduction, voltage):  # type: ignore[no-untyped-def]
        return -transduction * voltage

    @staticmethod
    def update(extension, elapsed, voltage, last, transduction, capacitance, resistance):  # type: ignore[no-untyped-def]
        charged = -transduction / capacitance * (extension - last)
        return _relaxed(voltage, charged, elapsed / (resistance * capacitance)), extension


class JenkinsCoupling(CouplingLaw):
    """Spring in series with dry friction: it sticks with ``F' = stiffness e'``, and slips at ``|F| = slip_force``.

    G. M. Jenkins, Br. J. Appl. Phys. 13 (1962) 30. The force follows from the extensions, exactly where these do not
    turn back within a step. A stiff spring k makes it Coulomb's friction with sticking, but a body m at rest
    rings on it, with velocities of up to ``slip_force/sqrt(k m)``. Several in parallel are an Iwan element.

    Parameters
    ----------
    stiffness : float
        Stiffness of the spring (N m-1).
    slip_force : float
        Force at which it slips (N).
    pull : float
        State: the force F (N).
    last : float
        State: the extension (m); the start value is that at which the force is `pull` at the start.

    Examples
    --------
    >>> il.JenkinsCoupling(100.0, slip_force=1.0).evaluate([0.005, 0.02])
    array([0.5, 1. ])
    """

    citation = article("Jenkins, G. M.", "", "Br. J. Appl. Phys.", 13, 1962, "30")

    stiffness: float = parameter(units="N m-1", minimum=0.0)
    slip_force: float = parameter(units="N", minimum=0.0)
    pull: float = state(0.0, units="N")
    last: float = state(0.0, units="m")

    @staticmethod
    def force(extension, pull):  # type: ignore[no-untyped-def]
        return pull

    @staticmethod
    def update(extension, pull, last, stiffness, slip_force):  # type: ignore[no-untyped-def]
        return max(-slip_force, min(slip_force, pull + stiffness * (extension - last))), extension


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

    Examples
    --------
    >>> law = il.BoucWenCoupling(1e4, yield_displacement=0.01, ratio=0.1)
    >>> il.Coupling("a", il.WALL, law)
    Coupling('a', WALL, BoucWenCoupling(stiffness=10000.0, yield_displacement=0.01, ratio=0.1))
    """

    citation = joined_entries(
        entry(
            "inproceedings", "Bouc, R.", 1967, title="Forced vibration of mechanical systems with hysteresis",
            booktitle="Proc. 4th Conf. on Nonlinear Oscillations, Prague",
        ),
        article(
            "Wen, Y.-K.", "Method for random vibration of hysteretic systems",
            "J. Eng. Mech. Div.", 102, 1976, "249", "10.1061/JMCEA3.0002106",
        ),
    )  # fmt: skip

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
