"""Contact laws as people write them: with loss, with kinks and jumps of the force, soft and hard."""

from __future__ import annotations

import math

import impactlab as il


class SlidingPadContact(il.ContactLaw):
    """Spring with a damper that works inwards alone: force ``stiffness δ + damping max(δ', 0)``."""

    stiffness: float = il.parameter(units="N m-1", minimum=0.0)
    damping: float = il.parameter(units="N s m-1", minimum=0.0)

    @staticmethod
    def force(indentation, rate, stiffness, damping):  # type: ignore[no-untyped-def]
        return stiffness * indentation + damping * max(rate, 0.0)


class HysteresisDampingContact(il.ContactLaw):
    """Hertz contact with hysteresis damping for one speed of approach: ``η δ^(3/2) (1 + ¾(1 − e²) δ'/speed)``."""

    stiffness: float = il.parameter(units="N m-3/2", minimum=0.0)
    restitution: float = il.parameter(minimum=0.0, maximum=1.0)
    speed: float = il.parameter(units="m s-1", above=0.0)

    @staticmethod
    def force(indentation, rate, stiffness, restitution, speed):  # type: ignore[no-untyped-def]
        loss = 0.75 * (1.0 - restitution * restitution) * rate / speed
        return stiffness * indentation * math.sqrt(indentation) * (1.0 + loss)


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


class BangContact(il.ContactLaw):
    """Pad of constant force, which is there or not."""

    push: float = il.parameter(units="N", minimum=0.0)

    @staticmethod
    def force(push):  # type: ignore[no-untyped-def]
        return push

    @staticmethod
    def potential(indentation, push):  # type: ignore[no-untyped-def]
        return push * indentation


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


class TanhContact(il.ContactLaw):
    """Pad that yields: force ``limit tanh(δ/depth)``."""

    limit: float = il.parameter(units="N", minimum=0.0)
    depth: float = il.parameter(units="m", above=0.0)

    @staticmethod
    def force(indentation, limit, depth):  # type: ignore[no-untyped-def]
        return limit * math.tanh(indentation / depth)

    @staticmethod
    def potential(indentation, limit, depth):  # type: ignore[no-untyped-def]
        depths = abs(indentation / depth)  # log cosh, without overflow
        return limit * depth * (depths + math.log1p(math.exp(-2.0 * depths)) - math.log(2.0))


class ConicalContact(il.ContactLaw):
    """Cone on a plane: force ``stiffness δ²``."""

    stiffness: float = il.parameter(units="N m-2", minimum=0.0)

    @staticmethod
    def force(indentation, stiffness):  # type: ignore[no-untyped-def]
        return stiffness * indentation * indentation

    @staticmethod
    def potential(indentation, stiffness):  # type: ignore[no-untyped-def]
        return stiffness * indentation * indentation * indentation / 3.0


class ExponentialWall(il.ContactLaw):
    """Wall that hardens without end: force ``scale (exp(δ/depth) − 1)``."""

    scale: float = il.parameter(units="N", minimum=0.0)
    depth: float = il.parameter(units="m", above=0.0)

    @staticmethod
    def force(indentation, scale, depth):  # type: ignore[no-untyped-def]
        return scale * math.expm1(indentation / depth)

    @staticmethod
    def potential(indentation, scale, depth):  # type: ignore[no-untyped-def]
        return scale * (depth * math.expm1(indentation / depth) - indentation)
