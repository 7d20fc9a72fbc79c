"""How functions are compiled, and the folder where the machine code is kept.

``fastmath`` is never used: it removes the guards against NaN and makes results differ between machines. Machine code is
cached in a private folder whose name holds a digest of the text of this folder, of the kernels, the
integrators and the mechanisms, so that a change in one file never meets stale code compiled from another.
"""

from __future__ import annotations

import atexit
import contextlib
import hashlib
import os
import shutil
import stat
import sys
import tempfile
from collections.abc import Callable, Hashable
from functools import cache
from pathlib import Path
from types import FunctionType
from typing import Any

import numba
from numba import f8, i8, void

from impactlab.compiling.numba_private import callback, dispatcher, linked, make_code_within
from impactlab.compiling.scalars import DISABLED, deferred, scalar
from impactlab.errors import ImpactLabWarning, warn
from impactlab.interrupts import Uninterrupted

Function = Callable[..., Any]

make_code_within(Uninterrupted)

_dispatchers: list[Any] = []
_kernels: dict[Any, Callable[[Function], Function]] = {}


def kernel(function: Function) -> Function:
    """Compile a function when it is first called, without the interpreter's lock, and cache it.

    It may write to no memory of which another argument is read or written. It stands in the machine code of its
    callers: a call hands over nine numbers for each array, on the stack. What only compiled loops call is not even
    loaded when their machine code is cached.
    """
    return _kernel(function, kernel)


def scattered(function: Function) -> Function:
    """Compile as `kernel` does, but let arrays overlap: loops over tables of places are then no vectors, which would
    cost a third more.
    """
    return _kernel(function, scattered, apart=False)


def seldom_called(function: Function) -> Function:
    """Compile as `scattered` does, a function that stays one in the machine code of its callers.

    A large one would take the compiler seconds with each of them.
    """
    return _kernel(function, seldom_called, apart=False, inline=False)


def allocating(function: Function) -> Function:
    """Compile as `kernel` does, a function that makes arrays, which must be counted."""
    return _kernel(function, allocating, counting=True)


def _kernel(
    function: Function, made_by: Callable[[Function], Function], apart: bool = True, counting: bool = False,
    inline: bool = True,
) -> Function:  # fmt: skip
    def make(function: Function) -> Any:
        return _known(dispatcher(function, cache_folder(), apart, counting))

    def link(function: Function) -> Any:
        return _known(linked(function, cache_folder(), apart, counting, forceinline=inline))

    compiled = deferred(function, make, link)
    _kernels[compiled] = made_by
    return compiled


def _known(compiled: Any) -> Any:
    """Return a compiled function, whose compilations count from now on."""
    _dispatchers.append(compiled)
    return compiled


def inlined(function: Function) -> Function:
    """Compile a function over blocks with each kernel that calls it, as a part of its text."""
    compiled = scalar(function)
    _kernels[compiled] = inlined
    return compiled


def composed(function: Function, version: str, **names: Any) -> Function:
    """Return a function of the same text, not compiled, in which some names stand for others, known to the cache by a
    version.
    """
    result = FunctionType(function.__code__, {**function.__globals__, **names}, f"{function.__name__}_{version}")
    result.__qualname__ = result.__name__
    return result


def maker(item: Any) -> Callable[[Function], Function] | None:
    """Return `kernel`, `scattered`, `allocating` or `inlined` for what one of them returned, else nothing."""
    return _kernels.get(item) if isinstance(item, Hashable) else None


@cache
def loop(signature: Any, function: Function, counting: bool = False) -> Function:
    """Compile a loop for one signature, which may hold a `FORCES`, when it is first wanted.

    Arguments must have the types of the signature: to find that out takes 60 µs a call, which is more than many do.
    """
    if DISABLED:
        return function
    compiled = _known(dispatcher(function, cache_folder(), False, counting, alone=True))
    return compiled.compile(signature)  # type: ignore[no-any-return]


def timetable(function: Function) -> Function:
    """Compile a generated function of time: (times, parameters, indices, result[time, row])."""
    return loop(void(f8[::1], f8[::1], i8[::1], f8[:, ::1]), function, True)


@cache
def part(signature: Any, function: Function, counting: bool = False) -> Any:
    """Compile a function that loops `call`, and return it with its address, which holds as long as it does."""
    compiled: Any = function if DISABLED else _known(callback(function, cache_folder(), counting, signature))
    return compiled, compiled if DISABLED else compiled.address


def compilations() -> int:
    """Number of functions that were compiled in this process, not loaded from the cache."""
    count = 0
    for compiled in _dispatchers:
        if hasattr(compiled, "stats"):
            count += sum(compiled.stats.cache_misses.values())
        elif hasattr(compiled, "cache_hits"):
            count += compiled.cache_hits == 0
    return count


@cache
def cache_folder() -> Path:
    """Return the private folder for generated modules and machine code.

    It is taken from the environment variable ``IMPACTLAB_CACHE``, else from the
    system's convention. Where it cannot be written to, or others can, a temporary folder
    serves this process: what is in the cache is executed.
    """
    folder = (
        _user_folder() / f"{_kernel_digest()}-numba{numba.__version__}-py{sys.version_info[0]}{sys.version_info[1]}"
    )
    with contextlib.suppress(OSError):
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if not _is_ours(folder):
            warn(
                "cache",
                f"The cache {folder} is a link, belongs to somebody else or can be written to by others (mode "
                f"{stat.filemode(folder.lstat().st_mode)}), so it is not used, and everything is compiled again. "
                "Remove it, or set IMPACTLAB_CACHE to another folder.",
                ImpactLabWarning,
            )
        elif os.access(folder, os.W_OK | os.X_OK) and _can_create(folder):
            return folder
    temporary = Path(tempfile.mkdtemp(prefix="impactlab-"))
    atexit.register(shutil.rmtree, temporary, ignore_errors=True)
    return temporary


def _is_ours(folder: Path) -> bool:
    """Whether nobody else can put files into a folder, as far as the system knows owners."""
    found = folder.lstat()  # of a link, the link
    return stat.S_ISDIR(found.st_mode) and (
        not hasattr(os, "getuid") or (found.st_uid == os.getuid() and not found.st_mode & 0o022)
    )


def _can_create(folder: Path) -> bool:
    """Whether a file can be made in a folder (access rights alone do not tell)."""
    try:
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def _user_folder() -> Path:
    given = os.environ.get("IMPACTLAB_CACHE")
    if given:
        return Path(given)
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", Path.home() / "AppData" / "Local")) / "impactlab" / "cache"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "impactlab"
    return Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "impactlab"


def _kernel_digest() -> str:
    """Digest of the text of all static kernels."""
    package = Path(__file__).parent.parent
    digest = hashlib.sha256()
    for folder in ("compiling", "kernels", "integrators", "mechanisms"):
        for file in sorted((package / folder).rglob("*.py")):
            digest.update(file.name.encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()[:16]
