"""The exact transition of a body as a product of shears, friction and noise."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Shears(NamedTuple):
    """K(first), D(before), friction and noise, noise `spread` on x, D(after), K(last); noises are variances."""

    first: float
    before: float
    decay: float
    noise: float
    spread: float
    after: float
    last: float

    @classmethod
    def of(cls, a: np.ndarray, q: np.ndarray, decay: float) -> Shears:
        drift = a[0, 1]
        last = (decay - a[1, 1]) / drift
        back = np.array([[1.0, 0.0], [last, 1.0]])
        before_last = back @ q @ back.T
        noise = before_last[1, 1]
        after = before_last[0, 1] / noise
        spread = max(before_last[0, 0] - after**2 * noise, 0.0)
        return cls((1.0 - a[0, 0]) / drift, drift - after * decay, decay, noise, spread, after, last)
