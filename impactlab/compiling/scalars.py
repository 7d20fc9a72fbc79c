"""Functions of scalars, which are parts of the compiled functions that call them, and how functions wait for that."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable
from typing import Any

import numba

DISABLED = bool(numba.config.DISABLE_JIT)  # type: ignore[attr-defined]
"""Whether functions run as they are, without a compiler."""

_HANDED_OVER = threading.RLock()
"""Held while a function is handed to the compiler, but not while it is compiled."""


Make = Callable[[Callable[..., Any]], Any]
"""Hands a function to the compiler."""


def deferred(function: Callable[..., Any], make: Make, link: Make | None = None) -> Callable[..., Any]:
    """Return a function that `make` hands to the compiler when Python calls it for the first time, and `link` for
    compiled code, by default the same.

    To hand over a function takes 0.2 ms, and there are more than a hundred; where machine code is in the cache, few
    are ever wanted.
    """
    return function if DISABLED else _Deferred(function, make, link or make)


class _Deferred:
    """A function of Python that turns into numba's dispatcher when somebody asks for what only that has."""

    def __init__(self, function: Callable[..., Any], make: Make, link: Make) -> None:
        functools.update_wrapper(self, function)
        self.py_func, self._makers, self._made = function, (make, link), dict[Make, Any]()

    def __getattr__(self, name: str) -> Any:
        """Return an attribute of the dispatcher of compiled code, among them the type by which numba knows it."""
        if name.startswith("__"):
            raise AttributeError(name)
        return getattr(self._dispatcher(self._makers[1]), name)

    def __call__(self, *arguments: Any) -> Any:
        return self._dispatcher(self._makers[0])(*arguments)

    def _dispatcher(self, make: Make) -> Any:
        if make not in self._made:
            with _HANDED_OVER:
                if make not in self._made:
                    self._made[make] = make(self.py_func)
        return self._made[make]


def scalar(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function of scalars that is to be inlined into the kernels that call it."""
    return deferred(function, numba.njit(inline="always", error_model="numpy"))
