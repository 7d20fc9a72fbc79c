"""How a force acts on a velocity that it slows down during a kick."""

from __future__ import annotations

import math

from impactlab.compiling.scalars import scalar


@scalar
def stretch(rate):  # type: ignore[no-untyped-def]
    """Twice the weight of the velocity after a kick in the velocity at which the force acts, as a function of γh.

    At ``v − θ h F/m`` the force changes the velocity v as the exact solution does if it grows in proportion to it, with
    γ its slope over the mass, for ``θ = 1/(1 − e^(−γh)) − 1/(γh)``: 1/2 for a weak damper, the middle of the kick; 1
    for a strong one, which stops the body and does not throw it back.
    """
    if abs(rate) < 0.01:
        result = 1.0 + rate / 6.0 - rate * rate * rate / 360.0
    else:
        result = 2.0 / -math.expm1(-rate) - 2.0 / rate
    return result
