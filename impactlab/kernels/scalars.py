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
