"""The one place that says how functions are compiled, and where the machine code is kept.

All flags stand here. ``fastmath`` is never used: it removes the guards against NaN and
makes results differ between machines. Machine code is cached in a private folder whose
name holds a digest of the kernels' own text, so that a change in one file never meets
stale code compiled from another.
"""

from __future__ import annotations

import atexit
import contextlib
import hashlib
import math
import os
import shutil
import stat
import sys
import tempfile
import threading
from collections.abc import Callable, Hashable, Iterator
from functools import cache
from pathlib import Path
from types import FunctionType
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from llvmlite.binding import add_symbol
from numba import f8, i8, types, void
from numba.core import cgutils
from numba.core.compiler import Compiler
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array

from impactlab.errors import ImpactLabWarning, warn

Function = Callable[..., Any]

BLOCK = f8[:, ::1]
"""State or force, ``[body, lane]`` or ``[contact, lane]``."""

BLOCK_OF_ONE = f8[::1]
"""The same of one lane; see `impactlab.kernels.single`."""

FORCES = types.FunctionType(void(BLOCK, BLOCK, BLOCK, f8, f8[::1], i8[::1], BLOCK, BLOCK, BLOCK))
"""Type of the function that is generated for a network's forces."""

FORCES_OF_ONE = types.FunctionType(void(*[BLOCK_OF_ONE] * 3, f8, f8[::1], i8[::1], *[BLOCK_OF_ONE] * 3))

_BLOCKS, _BLOCKS_OF_ONE = f8[:, :, ::1], f8[:, ::1]
_EVALUATE = void(FORCES, *[_BLOCKS] * 2, f8[::1], i8[::1], *[_BLOCKS] * 3)
_EVALUATE_ONE = void(FORCES_OF_ONE, *[_BLOCKS_OF_ONE] * 2, f8[::1], i8[::1], *[_BLOCKS_OF_ONE] * 3)

config: Any = numba.config
_unpack_tuple: Any = cgutils.unpack_tuple
_in_frame: Any = cgutils.alloca_once
_declared: Any = cgutils.get_or_insert_function
_populate_array: Any = populate_array

pointer_to: Any = types.CPointer
"""Type of what `address_of` returns, by the type of the value."""

DISABLED = bool(config.DISABLE_JIT)
"""Whether functions run as they are, without a compiler."""

_CACHED = threading.RLock()
"""Held while numba's setting is ours: threads that save and restore it at once would leave it so."""

_dispatchers: list[Any] = []
_kernels: dict[Any, Callable[[Function], Function]] = {}


class Apart(Compiler):
    """Compiles functions that write to no memory of which another argument is read or written.

    Loops need not find out, for every row, whether arrays overlap; so not even a change in place may be asked for by
    the same array given twice.
    """

    def define_pipelines(self) -> Any:
        self.state.flags.noalias = True
        return super().define_pipelines()  # type: ignore[no-untyped-call]


def kernel(function: Function) -> Function:
    """Compile a function when it is first called, without the interpreter's lock, and cache it; see `Apart`.

    What only compiled loops call is not even loaded when their machine code is cached.
    """
    return _kernel(function, kernel, Apart)


def scattered(function: Function) -> Function:
    """Compile as `kernel` does, but let arrays overlap: loops over tables of places are then no vectors, which would
    cost a third more.
    """
    return _kernel(function, scattered, Compiler)


def _kernel(function: Function, made_by: Callable[[Function], Function], pipeline: type[Compiler]) -> Function:
    with _cached_here():
        compiled = numba.njit(nogil=True, cache=True, error_model="numpy", pipeline_class=pipeline)(function)
    _dispatchers.append(compiled)
    _kernels[compiled] = made_by
    return compiled  # type: ignore[no-any-return]


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
    """Return `kernel`, `scattered` or `inlined` for what one of them returned, else nothing."""
    return _kernels.get(item) if isinstance(item, Hashable) else None


@cache
def loop(signature: Any, function: Function) -> Function:
    """Compile a loop for one signature, which may hold a `FORCES`, when it is first wanted.

    Arguments must have the types of the signature: to find that out takes 60 µs a call, which is more than many do.
    """
    if DISABLED:
        return function
    with _cached_here():
        compiled: Any = numba.njit(signature, nogil=True, cache=True, error_model="numpy")(function)
    _dispatchers.append(compiled)
    (found,) = compiled.overloads.values()
    return found.entry_point  # type: ignore[no-any-return]


def timetable(function: Function) -> Function:
    """Compile a generated function of time: (times, parameters, indices, result[time, row])."""
    return loop(void(f8[::1], f8[::1], i8[::1], f8[:, ::1]), function)


def evaluate(forces: Any, x: np.ndarray, v: np.ndarray, *arrays: np.ndarray) -> None:
    """Call a network's forces in some states, at their velocities, for what is outside the loops.

    `arrays` are parameters, indices, and the results: indentation, contact force, total. These and states are
    blocks, [state, body or contact, lane].
    """
    parameters, indices, *results = arrays
    single = forces._numba_type_ is FORCES_OF_ONE
    x, v, *results = (item[..., 0] if single else item for item in (x, v, *results))
    evaluator(single)(forces, x, v, parameters, indices, *results)


def evaluator(single: bool) -> Function:
    """Return the compiled function that calls a network's forces, for blocks or for single lanes."""
    return loop(_EVALUATE_ONE if single else _EVALUATE, _evaluate)


def _evaluate(forces, x, v, parameters, indices, indentation, contact_force, total):  # type: ignore[no-untyped-def]
    for state in range(x.shape[0]):
        forces(
            x[state], v[state], v[state], 0.0, parameters, indices, indentation[state], contact_force[state],
            total[state],
        )  # fmt: skip


def scalar(function: Function) -> Function:
    """Compile a function of scalars that is to be inlined into the kernels that call it."""
    return numba.njit(inline="always", error_model="numpy")(function)  # type: ignore[no-any-return]


def resident(compiled: Function, function_type: types.FunctionType) -> Function:
    """Return a kernel that takes `Members.indices` and two blocks for functions of a type, which call it where it is.

    Called as other kernels are, it would be compiled again with every function that is generated.
    """
    if DISABLED:
        return compiled
    block = function_type.signature.args[0]
    signature, symbol = void(i8[::1], block, block), f"impactlab_{compiled.__name__}"
    kernel: Any = compiled
    kernel.compile(signature.args)
    found = kernel.overloads[signature.args]
    add_symbol(symbol, found.library.get_pointer_to_function(found.fndesc.llvm_func_name))

    @intrinsic
    def call(typing_context, indices, one, other):  # type: ignore[no-untyped-def]
        def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            convention, kinds = context.call_conv, signature.args
            there = _declared(builder.module, convention.get_function_type(types.none, kinds), symbol)
            status, _ = convention.call_function(builder, there, types.none, kinds, arguments)
            with builder.if_then(status.is_error, likely=False):
                convention.return_status_propagate(builder, status)
            return context.get_dummy_value()

        return signature, codegen

    return call  # type: ignore[no-any-return]


@intrinsic
def _unmanaged(typing_context, value):  # type: ignore[no-untyped-def]
    """Return an array, or a tuple of them, that does not count references."""

    def strip(context: Any, builder: Any, kind: Any, item: Any) -> Any:
        if isinstance(kind, types.Array):
            array = context.make_array(kind)(context, builder, item)
            array.meminfo = array.meminfo.type(None)
            return array._getvalue()
        if isinstance(kind, types.BaseTuple):
            parts: Any = kind
            for index, part in enumerate(parts):
                stripped = strip(context, builder, part, builder.extract_value(item, index))
                item = builder.insert_value(item, stripped, index)
        return item

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return strip(context, builder, value, arguments[0])

    return value(value), codegen


@scalar
def borrow(value):  # type: ignore[no-untyped-def]
    """Return an array, or a tuple of them, for use inside a loop whose caller holds it.

    Every view of it and every call would else count references, atomically: 0.3 µs a step.
    """
    return value if DISABLED else _unmanaged(value)  # type: ignore[call-arg]


@intrinsic
def _address_of(typing_context, value):  # type: ignore[no-untyped-def]
    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        place = _in_frame(builder, context.get_data_type(value))
        builder.store(context.data_model_manager[value].as_data(builder, arguments[0]), place)
        return place

    return pointer_to(value)(value), codegen


@intrinsic
def _value_at(typing_context, pointer):  # type: ignore[no-untyped-def]
    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return context.data_model_manager[pointer.dtype].load_from_data_pointer(builder, arguments[0])

    return pointer.dtype(pointer), codegen


@scalar
def address_of(value):  # type: ignore[no-untyped-def]
    """Return a pointer to a value in the frame of the caller, for functions that take it as one argument.

    Handing over all arrays of a block one by one takes 0.1 µs.
    """
    return value if DISABLED else _address_of(value)  # type: ignore[call-arg]


@scalar
def value_at(pointer):  # type: ignore[no-untyped-def]
    """Return the value that `address_of` gave a pointer to, borrowed."""
    return pointer if DISABLED else _unmanaged(_value_at(pointer))  # type: ignore[call-arg]


@intrinsic
def _call(typing_context, function, pointer, index):  # type: ignore[no-untyped-def]
    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        address, *values = arguments
        kind = ir.FunctionType(ir.VoidType(), [value.type for value in values])
        builder.call(builder.inttoptr(address, kind.as_pointer()), values)
        return context.get_dummy_value()

    return types.none(function, pointer, index), codegen


@scalar
def call(function, pointer, index):  # type: ignore[no-untyped-def]
    """Call what `part` compiled by its address, ``function(pointer, index)``; see `address_of`."""
    if DISABLED:
        function(pointer, index)
    else:
        _call(function, pointer, index)  # type: ignore[call-arg]


@intrinsic
def _first_lanes(typing_context, block, lanes):  # type: ignore[no-untyped-def]
    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array = context.make_array(block)(context, builder, arguments[0])
        shape = [*_unpack_tuple(builder, array.shape)[:-1], arguments[1]]
        size = array.itemsize
        strides: list[Any] = []
        for length in reversed(shape):
            strides.insert(0, size)
            size = builder.mul(size, length)
        items = builder.udiv(size, array.itemsize)
        _populate_array(array, array.data, shape, strides, array.itemsize, None)
        array.nitems = items
        return array._getvalue()

    return block(block, types.intp), codegen


@scalar
def dense(block, lanes):  # type: ignore[no-untyped-def]
    """Return the memory of a block (…, lane), or its beginning, as a block of fewer lanes without gaps.

    As with `borrow`, somebody else must hold the memory.
    """
    if DISABLED:
        rows = block.shape[:-1]
        return block.reshape(-1)[: math.prod(rows) * lanes].reshape(*rows, lanes)
    return _first_lanes(block, lanes)  # type: ignore[call-arg]


@intrinsic
def _rows(typing_context, array, begin, count):  # type: ignore[no-untyped-def]
    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        shape, strides = (_unpack_tuple(builder, item) for item in (array.shape, array.strides))
        items = builder.udiv(strides[0], array.itemsize)
        data = builder.gep(array.data, [builder.mul(arguments[1], items)])
        _populate_array(array, data, [arguments[2], *shape[1:]], strides, array.itemsize, None)
        return array._getvalue()

    return array(array, types.intp, types.intp), codegen


@scalar
def rows(array, begin, count):  # type: ignore[no-untyped-def]
    """Return some rows of an array that somebody else holds, without the checks of a slice, which cost as much."""
    if DISABLED:
        return array[begin : begin + count]
    return _rows(array, begin, count)  # type: ignore[call-arg]


@intrinsic
def _rows_of_lanes(typing_context, array, begin, count, lanes):  # type: ignore[no-untyped-def]
    result = types.Array(array.dtype, 2, "C")

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        whole = context.make_array(signature.args[0])(context, builder, arguments[0])
        block, size = context.make_array(result)(context, builder), whole.itemsize
        data, shape = builder.gep(whole.data, [arguments[1]]), arguments[2:]
        _populate_array(block, data, shape, [builder.mul(arguments[3], size), size], size, None)
        return block._getvalue()

    return result(array, types.intp, types.intp, types.intp), codegen


@scalar
def rows_of_lanes(array, begin, count, lanes):  # type: ignore[no-untyped-def]
    """Return numbers of an array (number,) from a place on as rows of lanes, as `rows` does."""
    if DISABLED:
        return array[begin : begin + count * lanes].reshape(count, lanes)
    return _rows_of_lanes(array, begin, count, lanes)  # type: ignore[call-arg]


def pointer(function_type: types.FunctionType) -> Callable[[Function], Function]:
    """Compile a function that kernels receive as an argument of one fixed type."""

    def decorate(function: Function) -> Function:
        compiled: Any = function if DISABLED else _callback(function_type.signature, function)
        compiled._numba_type_ = function_type  # else numba makes it anew for each call
        return compiled  # type: ignore[no-any-return]

    return decorate


@cache
def part(signature: Any, function: Function) -> Any:
    """Compile a function that loops `call`, and return it with its address, which holds as long as it does."""
    compiled: Any = function if DISABLED else _callback(signature, function)
    return compiled, compiled if DISABLED else compiled.address


def _callback(signature: Any, function: Function) -> Any:
    with _cached_here():
        compiled: Any = numba.cfunc(signature, cache=True, error_model="numpy", pipeline_class=Apart)(function)
    _dispatchers.append(compiled)
    return compiled


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
    for folder in ("kernels", "integrators"):
        for file in sorted((package / folder).glob("*.py")):
            digest.update(file.name.encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()[:16]


@contextlib.contextmanager
def _cached_here() -> Iterator[None]:
    """Let numba put its cache into our folder while a function is being decorated."""
    with _CACHED:
        before = config.CACHE_DIR
        config.CACHE_DIR = str(cache_folder())
        try:
            yield
        finally:
            config.CACHE_DIR = before
