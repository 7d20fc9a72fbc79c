"""Machine code in files: what numba writes and reads there."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numba
from llvmlite.binding import parse_assembly, parse_bitcode
from numba.core import runtime
from numba.core.caching import CompileResultCacheImpl, FunctionCache

config: Any = numba.config
_runtime: Any = runtime.rtsys  # type: ignore[attr-defined]

_PLACED = threading.RLock()
"""Held while numba's setting is ours: threads that save and restore it at once would leave it so."""


class _Kept(CompileResultCacheImpl):
    """Keeps machine code without the modules of all that was inlined into it, which would be imported with it.

    What numba calls an environment refers to them, for functions that hand constants to the interpreter.
    """

    def reduce(self, cres: Any) -> Any:
        *parts, environments = super().reduce(cres)  # type: ignore[no-untyped-call]
        return *parts, tuple(item for item in environments if item.consts)


class _KeptAlone(_Kept):
    """Keeps it also without what a compiler would inline into other functions, which is as large and slow to read.

    Of that, numba reads the names of functions.
    """

    def reduce(self, cres: Any) -> Any:
        (name, kind, (code, bitcode)), *parts = super().reduce(cres)
        defined = (item.name for item in parse_bitcode(bitcode).functions if not item.is_declaration)
        names = "".join(f'define void @"{item}"() {{ ret void }}\n' for item in defined)
        return (name, kind, (code, parse_assembly(names).as_bitcode())), *parts


class Cache(FunctionCache):
    """numba's cache in a folder, which loads machine code and nothing else.

    Numba's own makes all ready for the compiler at first: the types and texts of what it knows of Python and NumPy, and
    parts of SciPy. That takes a quarter of a second, and machine code does not need it; the compiler does it itself.
    """

    _impl_class = _Kept

    def __init__(self, function: Callable[..., Any], folder: Path) -> None:
        with _placed_in(folder):
            super().__init__(function)  # type: ignore[no-untyped-call]

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        if not hasattr(self, "_load_overload"):  # another version of numba
            return super().load_overload(sig, target_context)  # type: ignore[no-untyped-call]
        _runtime.initialize(target_context)  # what machine code calls to count references
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)  # type: ignore[no-untyped-call]


class CacheAlone(Cache):
    """The same for functions that only Python calls, or others by their address."""

    _impl_class = _KeptAlone


@contextlib.contextmanager
def _placed_in(folder: Path) -> Iterator[None]:
    """Let numba put its cache into a folder while it looks for a place."""
    with _PLACED:
        before = config.CACHE_DIR
        config.CACHE_DIR = str(folder)
        try:
            yield
        finally:
            config.CACHE_DIR = before
