"""Residual forces as people write them: damping, friction, stops and other springs."""

from __future__ import annotations

import math

import impactlab as il


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


class CubicDragOscillator(il.Oscillator):
    """Residual force ``drag v³``."""

    drag: float = il.parameter(units="N s3 m-3", minimum=0.0)

    @staticmethod
    def residual(velocity, drag):  # type: ignore[no-untyped-def]
        return drag * velocity * velocity * velocity


class FrictionOscillator(il.Oscillator):
    """Smoothed dry friction: residual force ``friction tanh(v/creep)``."""

    friction: float = il.parameter(units="N", minimum=0.0)
    creep: float = il.parameter(units="m s-1", above=0.0)

    @staticmethod
    def residual(velocity, friction, creep):  # type: ignore[no-untyped-def]
        return friction * math.tanh(velocity / creep)


class CoulombOscillator(il.Oscillator):
    """Dry friction without a peak: residual force ``friction v/sqrt(v² + creep²)``."""

    friction: float = il.parameter(units="N", minimum=0.0)
    creep: float = il.parameter(units="m s-1", above=0.0)

    @staticmethod
    def residual(velocity, friction, creep):  # type: ignore[no-untyped-def]
        return friction * velocity / math.sqrt(velocity * velocity + creep * creep)


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


class BangStopOscillator(il.Oscillator):
    """Stops of constant force beyond a distance on either side, as a residual force."""

    push: float = il.parameter(units="N", minimum=0.0)
    distance: float = il.parameter(units="m", minimum=0.0)

    @staticmethod
    def residual(displacement, push, distance):  # type: ignore[no-untyped-def]
        if displacement > distance:
            return push
        return -push if displacement < -distance else 0.0

    @staticmethod
    def residual_potential(displacement, push, distance):  # type: ignore[no-untyped-def]
        return push * max(abs(displacement) - distance, 0.0)


class SoftOscillator(il.Oscillator):
    """Spring that saturates: residual force ``limit tanh(x/width)``."""

    limit: float = il.parameter(units="N", minimum=0.0)
    width: float = il.parameter(units="m", above=0.0)

    @staticmethod
    def residual(displacement, limit, width):  # type: ignore[no-untyped-def]
        return limit * math.tanh(displacement / width)

    @staticmethod
    def residual_potential(displacement, limit, width):  # type: ignore[no-untyped-def]
        widths = abs(displacement / width)  # log cosh, without overflow
        return limit * width * (widths + math.log1p(math.exp(-2.0 * widths)) - math.log(2.0))


class SofteningOscillator(il.Oscillator):
    """Spring that gets softer and saturates: residual force ``stiffness (a tanh(x/a) − x)``, part by part."""

    part: float = il.parameter(minimum=0.0, maximum=1.0)
    width: float = il.parameter(units="m", above=0.0)
    softened: float = il.parameter(units="N m-1", minimum=0.0)

    @staticmethod
    def residual(displacement, part, width, softened):  # type: ignore[no-untyped-def]
        return part * softened * (width * math.tanh(displacement / width) - displacement)


class QuinticOscillator(il.Oscillator):
    """Residual force ``quintic x⁵``."""

    quintic: float = il.parameter(units="N m-5", minimum=0.0)

    @staticmethod
    def residual(displacement, quintic):  # type: ignore[no-untyped-def]
        return quintic * displacement**5

    @staticmethod
    def residual_potential(displacement, quintic):  # type: ignore[no-untyped-def]
        return quintic * displacement**6 / 6.0
