"""Forces of one's own, as people write them: contacts with loss, kinks and jumps, residual forces, excitations."""

from __future__ import annotations

import math

import impactlab as il


class KelvinVoigtContact(il.ContactLaw):
    """Spring and dashpot, which together may pull: force ``stiffness δ + damping δ'``."""

    stiffness: float = il.parameter(units="N m-1", minimum=0.0)
    damping: float = il.parameter(units="N s m-1", minimum=0.0)

    @staticmethod
    def force(indentation, rate, stiffness, damping):  # type: ignore[no-untyped-def]
        return stiffness * indentation + damping * rate


class ClampedKelvinVoigtContact(il.ContactLaw):
    """Spring and dashpot that never pull: force ``max(stiffness δ + damping δ', 0)``."""

    stiffness: float = il.parameter(units="N m-1", minimum=0.0)
    damping: float = il.parameter(units="N s m-1", minimum=0.0)

    @staticmethod
    def force(indentation, rate, stiffness, damping):  # type: ignore[no-untyped-def]
        return max(stiffness * indentation + damping * rate, 0.0)


class HuntCrossleyContact(il.ContactLaw):
    """Hertz contact with loss that never pulls: force ``stiffness δ^(3/2) max(1 + loss δ', 0)``."""

    stiffness: float = il.parameter(units="N m-3/2", minimum=0.0)
    loss: float = il.parameter(units="s m-1", minimum=0.0)

    @staticmethod
    def force(indentation, rate, stiffness, loss):  # type: ignore[no-untyped-def]
        return stiffness * indentation * math.sqrt(indentation) * max(1.0 + loss * rate, 0.0)


class JumpContact(il.ContactLaw):
    """Pre-stressed spring: force ``preload + stiffness δ``, which jumps at closing."""

    preload: float = il.parameter(units="N", minimum=0.0)
    stiffness: float = il.parameter(units="N m-1", minimum=0.0)

    @staticmethod
    def force(indentation, preload, stiffness):  # type: ignore[no-untyped-def]
        return preload + stiffness * indentation

    @staticmethod
    def potential(indentation, preload, stiffness):  # type: ignore[no-untyped-def]
        return preload * indentation + 0.5 * stiffness * indentation * indentation


class BilinearContact(il.ContactLaw):
    """Two springs, one behind the other: force ``first δ + second max(δ − distance, 0)``."""

    first: float = il.parameter(units="N m-1", minimum=0.0)
    second: float = il.parameter(units="N m-1", minimum=0.0)
    distance: float = il.parameter(units="m", minimum=0.0)

    @staticmethod
    def force(indentation, first, second, distance):  # type: ignore[no-untyped-def]
        return first * indentation + second * max(indentation - distance, 0.0)

    @staticmethod
    def potential(indentation, first, second, distance):  # type: ignore[no-untyped-def]
        beyond = max(indentation - distance, 0.0)
        return 0.5 * first * indentation * indentation + 0.5 * second * beyond * beyond


class SaturatingContact(il.ContactLaw):
    """Contact that yields: force ``limit (1 − exp(−δ/depth))``."""

    limit: float = il.parameter(units="N", minimum=0.0)
    depth: float = il.parameter(units="m", above=0.0)

    @staticmethod
    def force(indentation, limit, depth):  # type: ignore[no-untyped-def]
        return -limit * math.expm1(-indentation / depth)

    @staticmethod
    def potential(indentation, limit, depth):  # type: ignore[no-untyped-def]
        return limit * (indentation + depth * math.expm1(-indentation / depth))


class ViscousOscillator(il.Oscillator):
    """Viscous damping that is written as a residual force: ``viscous v``."""

    viscous: float = il.parameter(units="N s m-1", minimum=0.0)

    @staticmethod
    def residual(velocity, viscous):  # type: ignore[no-untyped-def]
        return viscous * velocity


class DragOscillator(il.Oscillator):
    """Quadratic drag: residual force ``drag |v| v``."""

    drag: float = il.parameter(units="N s2 m-2", minimum=0.0)

    @staticmethod
    def residual(velocity, drag):  # type: ignore[no-untyped-def]
        return drag * abs(velocity) * velocity


class FrictionOscillator(il.Oscillator):
    """Smoothed dry friction: residual force ``friction tanh(v/creep)``."""

    friction: float = il.parameter(units="N", minimum=0.0)
    creep: float = il.parameter(units="m s-1", above=0.0)

    @staticmethod
    def residual(velocity, friction, creep):  # type: ignore[no-untyped-def]
        return friction * math.tanh(velocity / creep)


class VanDerPolOscillator(il.Oscillator):
    """Self-excitation: residual force ``growth (x²/width² − 1) v``."""

    growth: float = il.parameter(units="N s m-1", minimum=0.0)
    width: float = il.parameter(units="m", above=0.0)

    @staticmethod
    def residual(displacement, velocity, growth, width):  # type: ignore[no-untyped-def]
        ratio = displacement / width
        return growth * (ratio * ratio - 1.0) * velocity


class StopOscillator(il.Oscillator):
    """Two elastic stops, written as a residual force: ``stop (|x| − distance)`` beyond the distance."""

    stop: float = il.parameter(units="N m-1", minimum=0.0)
    distance: float = il.parameter(units="m", minimum=0.0)

    @staticmethod
    def residual(displacement, stop, distance):  # type: ignore[no-untyped-def]
        return stop * (max(displacement - distance, 0.0) - max(-displacement - distance, 0.0))

    @staticmethod
    def residual_potential(displacement, stop, distance):  # type: ignore[no-untyped-def]
        beyond = max(abs(displacement) - distance, 0.0)
        return 0.5 * stop * beyond * beyond


class SoftOscillator(il.Oscillator):
    """Spring that saturates: residual force ``limit tanh(x/width)``."""

    limit: float = il.parameter(units="N", minimum=0.0)
    width: float = il.parameter(units="m", above=0.0)

    @staticmethod
    def residual(displacement, limit, width):  # type: ignore[no-untyped-def]
        return limit * math.tanh(displacement / width)

    @staticmethod
    def residual_potential(displacement, limit, width):  # type: ignore[no-untyped-def]
        return limit * width * math.log(math.cosh(displacement / width))


class DeadBandCoupling(il.CouplingLaw):
    """Spring with play: force ``stiffness (e ∓ play)`` beyond the play on either side."""

    stiffness: float = il.parameter(units="N m-1", minimum=0.0)
    play: float = il.parameter(units="m", minimum=0.0)

    @staticmethod
    def force(extension, stiffness, play):  # type: ignore[no-untyped-def]
        return stiffness * (max(extension - play, 0.0) - max(-extension - play, 0.0))


class Harmonic(il.Excitation):
    """Given force ``amplitude sin(frequency t)``."""

    amplitude: float = il.parameter(units="N")
    frequency: float = il.parameter(units="rad s-1", above=0.0)

    @staticmethod
    def force(time, amplitude, frequency):  # type: ignore[no-untyped-def]
        return amplitude * math.sin(frequency * time)


class Pulse(il.Excitation):
    """Given force, half of a sine: ``amplitude sin(π (t − begin)/width)`` while it lasts."""

    amplitude: float = il.parameter(units="N")
    begin: float = il.parameter(units="s")
    width: float = il.parameter(units="s", above=0.0)

    @staticmethod
    def force(time, amplitude, begin, width):  # type: ignore[no-untyped-def]
        return amplitude * math.sin(math.pi * (time - begin) / width) if begin < time < begin + width else 0.0


class Chirp(il.Excitation):
    """Given force whose angular frequency ``first + rate t`` grows."""

    amplitude: float = il.parameter(units="N")
    first: float = il.parameter(units="rad s-1", minimum=0.0)
    rate: float = il.parameter(units="rad s-2", minimum=0.0)

    @staticmethod
    def force(time, amplitude, first, rate):  # type: ignore[no-untyped-def]
        return amplitude * math.sin((first + 0.5 * rate * time) * time) if time > 0.0 else 0.0


class ModulatedNoise(il.Excitation):
    """White noise of density ``level (1 + cos(frequency t))``."""

    level: float = il.parameter(units="N2 s rad-1", minimum=0.0)
    frequency: float = il.parameter(units="rad s-1", above=0.0)

    @staticmethod
    def intensity(time, level, frequency):  # type: ignore[no-untyped-def]
        return level * (1.0 + math.cos(frequency * time))


class GustNoise(il.Excitation):
    """White noise with a gust: density ``level + peak exp(−((t − middle)/width)²)``."""

    level: float = il.parameter(units="N2 s rad-1", minimum=0.0)
    peak: float = il.parameter(units="N2 s rad-1", minimum=0.0)
    middle: float = il.parameter(units="s")
    width: float = il.parameter(units="s", above=0.0)

    @staticmethod
    def intensity(time, level, peak, middle, width):  # type: ignore[no-untyped-def]
        distance = (time - middle) / width
        return level + peak * math.exp(-distance * distance)


class ConstantForce(il.Excitation):
    """A static load."""

    load: float = il.parameter(units="N")

    @staticmethod
    def force(load):  # type: ignore[no-untyped-def]
        return load
