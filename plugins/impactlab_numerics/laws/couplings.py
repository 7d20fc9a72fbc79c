"""Couplings as people write them."""

from __future__ import annotations

import impactlab as il


class DeadBandCoupling(il.CouplingLaw):
    """Spring with play: force ``stiffness (e ∓ play)`` beyond the play on either side."""

    stiffness: float = il.parameter(units="N m-1", minimum=0.0)
    play: float = il.parameter(units="m", minimum=0.0)

    @staticmethod
    def force(extension, stiffness, play):  # type: ignore[no-untyped-def]
        return stiffness * (max(extension - play, 0.0) - max(-extension - play, 0.0))


class StringCoupling(il.CouplingLaw):
    """String that pulls beyond its slack, and never pushes."""

    stiffness: float = il.parameter(units="N m-1", minimum=0.0)
    slack: float = il.parameter(units="m")

    @staticmethod
    def force(extension, stiffness, slack):  # type: ignore[no-untyped-def]
        return stiffness * max(extension - slack, 0.0)
