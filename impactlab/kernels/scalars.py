"""Functions of scalars, which are parts of the compiled functions that call them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba

DISABLED = bool(numba.config.DISABLE_JIT)  # type: ignore[attr-defined]
"""Whether functions run as they are, without a compiler."""


def scalar(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function of scalars that is to be inlined into the kernels that call it."""
    return numba.njit(inline="always", error_model="numpy")(function)  # type: ignore[no-any-return]


@scalar
def cubic(by, next_by, rise):  # type: ignore[no-untyped-def]
    """Return the coefficients of s² and s³ of Hermite's cubic from 0 to `rise`, with these slopes at s = 0 and 1."""
    return 3.0 * rise - 2.0 * by - next_by, by + next_by - 2.0 * rise
