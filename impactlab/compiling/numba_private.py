"""Every name of numba and llvmlite that they do not document; no other module of the package imports them.

The documented names are ``numba.njit``, ``numba.types``, ``numba.extending``, the types such as ``f8``, and
``numba.config``. All names here were tested with numba 0.60.0 and 0.68.1; ``tests/compiling/test_versions.py`` tests
them with the oldest and the newest release that ``pyproject.toml`` allows.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import os
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numba
from llvmlite import ir as ir
from llvmlite.binding import add_symbol as add_symbol
from llvmlite.binding import parse_assembly, parse_bitcode
from llvmlite.binding.ffi import ObjectRef
from numba.core import caching, cgutils, runtime, types
from numba.core import typing as numba_typing
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile
from numba.core.ccallback import CFunc
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, CompileResult
from numba.core.compiler_machinery import register_pass
from numba.core.errors import RequireLiteralValue as RequireLiteralValue
from numba.core.event import Listener as Listener
from numba.core.event import install_listener as install_listener
from numba.core.lowering import Lower
from numba.core.typed_passes import NativeLowering

config: Any = numba.config
_runtime: Any = runtime.rtsys  # type: ignore[attr-defined]

_finalize: Any = JITCodeLibrary._finalize_specific


def make_code_within(context: Callable[[], contextlib.AbstractContextManager[None]]) -> None:
    """Let machine code of each module be made within a context: the compiler calls Python meanwhile, and would lose an
    error there, such as that of Ctrl-C, and the code with it.
    """

    def finalize(library: Any) -> None:
        with context():
            _finalize(library)

    JITCodeLibrary._finalize_specific = finalize  # type: ignore[method-assign]


def _dispose_of_passes() -> None:
    """Let managers of LLVM's passes be freed, 0.4 MB for each function that is compiled.

    llvmlite has what frees them, but behind a base class that frees nothing, so that they stay as long as the process.
    """
    try:
        from llvmlite.binding import newpassmanagers
    except ImportError:  # an older llvmlite has other managers
        return
    for manager in (newpassmanagers.ModulePassManager, newpassmanagers.FunctionPassManager):
        if manager._dispose is ObjectRef._dispose:
            manager._dispose = newpassmanagers.NewPassManager._dispose


_dispose_of_passes()

any_others: Any = types.VarArg
declared: Any = cgutils.get_or_insert_function
in_frame: Any = cgutils.alloca_once
literal: Any = types.literal
signature_of: Any = numba_typing.signature  # type: ignore[attr-defined]
unpack_tuple: Any = cgutils.unpack_tuple


def populate_array(*arguments: Any) -> None:
    """Set the numbers that an array consists of: array, data, shape, strides, size of an item, count of references."""
    from numba.np.arrayobj import populate_array  # late: it loads numba's library, of which only the compiler has use

    populate: Any = populate_array
    populate(*arguments)


MEMINFO, PARENT, NITEMS, ITEM_SIZE, DATA, SHAPE, STRIDES = range(7)
"""Fields of an array in compiled code."""


class _Lower(Lower):
    """Writes the text of reads and writes of arrays in C order at whole numbers with a third of the instructions.

    Numba copies the whole array into memory for each of them, and reads shape and strides from there one by one. The
    optimiser finds that all this can go, but takes a good part of the time of a compilation to do so.
    """

    def lower_getitem(self, resty: Any, expr: Any, value: Any, index: Any, signature: Any) -> Any:
        kind, by = signature.args
        if not _is_plain(self.context, kind, by):
            return super().lower_getitem(resty, expr, value, index, signature)  # type: ignore[no-untyped-call]
        from numba.np.arrayobj import load_item  # late, as above

        array = self.loadvar(value.name)  # type: ignore[no-untyped-call]
        indices = _indices(self.builder, by, self.loadvar(index.name))  # type: ignore[no-untyped-call]
        place = _place(self.builder, array, indices)
        kept = signature.return_type
        if len(indices) == kind.ndim:
            read: Any = load_item
            result = read(self.context, self.builder, kind, place)
        else:
            result = _view(self.context, self.builder, array, place, len(indices), kept)
            if self.context.enable_nrt:
                self.context.nrt.incref(self.builder, kept, result)
        return self.context.cast(self.builder, result, kept, resty)

    def lower_setitem(self, target_var: Any, index_var: Any, value_var: Any, signature: Any) -> Any:
        kind, by, item = signature.args
        one = _is_plain(self.context, kind, by) and kind.ndim == len(_types(by))
        if not one or isinstance(item, types.Array):
            return super().lower_setitem(target_var, index_var, value_var, signature)  # type: ignore[no-untyped-call]
        from numba.np.arrayobj import store_item  # late, as above

        array, by_value, value = (self.loadvar(item.name) for item in (target_var, index_var, value_var))  # type: ignore[no-untyped-call]
        place = _place(self.builder, array, _indices(self.builder, by, by_value))
        value = self.context.cast(self.builder, value, self.typeof(value_var.name), kind.dtype)  # type: ignore[no-untyped-call]
        write: Any = store_item
        return write(self.context, self.builder, kind, value, place)

    def lower_expr(self, resty: Any, expr: Any) -> Any:
        if expr.op == "getattr" and expr.attr == "shape" and isinstance(self.typeof(expr.value.name), types.Array):  # type: ignore[no-untyped-call]
            return self.builder.extract_value(self.loadvar(expr.value.name), SHAPE)  # type: ignore[no-untyped-call]
        return super().lower_expr(resty, expr)  # type: ignore[no-untyped-call]


def _is_plain(context: Any, kind: Any, by: Any) -> bool:
    """Whether an array is in C order, and indices are whole numbers that may be negative."""
    indices = _types(by)
    return (
        type(kind) is types.Array and kind.layout == "C" and 0 < len(indices) <= kind.ndim
        and all(item == types.intp for item in indices) and not context.enable_boundscheck
    )  # fmt: skip


def _types(by: Any) -> Any:
    """Return the types of the numbers of an index."""
    return by.types if isinstance(by, types.BaseTuple) else (by,)  # type: ignore[attr-defined]


def _indices(builder: Any, kind: Any, value: Any) -> list[Any]:
    """Return the numbers of an index."""
    if not isinstance(kind, types.BaseTuple):
        return [value]
    return [builder.extract_value(value, place) for place in range(len(_types(kind)))]


def _place(builder: Any, array: Any, indices: list[Any]) -> Any:
    """Return where the item, or the view, of an array at some indices is."""
    shape = builder.extract_value(array, SHAPE)
    lengths = [builder.extract_value(shape, axis) for axis in range(shape.type.count)]
    steps: list[Any] = []
    for length in reversed(lengths[1:]):
        steps.insert(0, builder.mul(length, steps[0]) if steps else length)
    steps.append(None)
    place = None
    for index, length, step in zip(indices, lengths, steps, strict=False):
        if not (isinstance(index, ir.Constant) and index.constant >= 0):
            negative = builder.icmp_signed("<", index, index.type(0))
            index = builder.select(negative, builder.add(index, length), index)
        shift = index if step is None else builder.mul(index, step)
        place = shift if place is None else builder.add(place, shift)
    return builder.gep(builder.extract_value(array, DATA), [place])


def _view(context: Any, builder: Any, array: Any, place: Any, axes: int, kind: Any) -> Any:
    """Return the array of a type at a place in another one, without its first axes."""
    fields: dict[Any, Any] = {item: builder.extract_value(array, item) for item in (MEMINFO, PARENT, ITEM_SIZE)}
    fields[DATA] = place
    for axis in range(kind.ndim):
        for field in (SHAPE, STRIDES):
            fields[field, axis] = builder.extract_value(array, (field, axes + axis))
        length = fields[SHAPE, axis]
        fields[NITEMS] = builder.mul(fields[NITEMS], length, flags=["nsw"]) if axis else length
    result = ir.Constant(context.get_value_type(kind), ir.Undefined)
    for field, item in fields.items():
        result = builder.insert_value(result, item, field)  # type: ignore[no-untyped-call]
    return result


@register_pass(mutates_CFG=True, analysis_only=False)  # type: ignore[no-untyped-call]
class _Lowering(NativeLowering):
    """Numba's pass with `_Lower` in it."""

    _name = "lowering_of_plain_arrays"

    @property
    def lowering_class(self) -> Any:
        return _Lower


class _Compiler(Compiler):
    """Numba's compiler with `_Lower` in it."""

    def define_pipelines(self) -> Any:
        pipelines = super().define_pipelines()  # type: ignore[no-untyped-call]
        for pipeline in pipelines:
            pipeline.passes = [(_Lowering if item is NativeLowering else item, text) for item, text in pipeline.passes]
            pipeline.finalize()
        return pipelines


class _Apart(_Compiler):
    """Compiles functions that write to no memory of which another argument is read or written.

    Loops need not find out, for every row, whether arrays overlap; so not even a change in place may be asked for by
    the same array given twice.
    """

    def define_pipelines(self) -> Any:
        self.state.flags.noalias = True
        return super().define_pipelines()  # type: ignore[no-untyped-call]


class _Linked(JITCodeLibrary):
    """Code of a function that is only ever linked into its callers, and optimised there.

    Numba would optimise each one by itself, with all that it calls, and make machine code of it: half of the time of a
    compilation.
    """

    def finalize(self) -> None:
        for library in dict.fromkeys(self._linking_libraries):
            self._reload_init.update(library._reload_init)
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._finalize_dynamic_globals()  # type: ignore[no-untyped-call]
        self._finalized = True

    @classmethod
    def read(cls, codegen: Any, name: str, bitcode: bytes) -> _Linked:
        """Return what was kept."""
        result = cls(codegen, name)  # type: ignore[no-untyped-call]
        result._final_module, result._finalized = parse_bitcode(bitcode), True
        return result


class _Linking(_Compiler):
    """Compiles functions that only compiled code calls."""

    def define_pipelines(self) -> Any:
        state = self.state
        state.library = _Linked(state.targetctx.codegen(), state.func_id.func_qualname)  # type: ignore[no-untyped-call]
        state.flags.no_compile = state.flags.no_cpython_wrapper = True
        return super().define_pipelines()  # type: ignore[no-untyped-call]


class _LinkingApart(_Linking, _Apart):
    """Compiles such functions with arguments that stand apart in memory."""


_PACKAGE = Path(__file__).parents[1]

_Located: Any = getattr(caching, "UserProvidedCacheLocator", None) or caching._UserProvidedCacheLocator  # type: ignore[attr-defined]


class _LocatedAnywhere(_Located):  # type: ignore[misc]
    """Finds machine code by the place of its text in the package, and by that text.

    Numba goes by the path of the package and, in older versions, by the time of a file, so that a cache would not serve
    another environment, a copy in an image or a new clone.
    """

    @classmethod
    def get_suitable_cache_subpath(cls, py_file: str) -> str:
        file = Path(os.path.abspath(py_file))
        for folder, name in ((_PACKAGE, "package"), (Path(os.path.abspath(config.CACHE_DIR)), "generated")):
            if folder in file.parents:
                return "_".join([name, *file.relative_to(folder).parts[:-1]])
        return str(super().get_suitable_cache_subpath(py_file))

    def get_source_stamp(self) -> str:
        return hashlib.sha256(Path(self._py_file).read_bytes()).hexdigest()


class _CheckedFiles(IndexDataCacheFile):
    """Files that end with a digest of their content, without which they are as good as absent, and made anew.

    They hold pickled data and machine code, of which even one wrong bit may end the process. What reads a pickle stops
    before the digest.
    """

    @contextlib.contextmanager
    def _open_for_write(self, filepath: str) -> Iterator[io.BytesIO]:
        with super()._open_for_write(filepath) as file:  # type: ignore[no-untyped-call]
            content = io.BytesIO()
            yield content
            file.write(content.getvalue() + hashlib.sha256(content.getvalue()).digest())

    def _load_index(self) -> Any:
        return super()._load_index() if _is_whole(self._index_path) else {}  # type: ignore[no-untyped-call]

    def _load_data(self, name: str) -> Any:
        return super()._load_data(name) if _is_whole(self._data_path(name)) else None  # type: ignore[no-untyped-call]


def _is_whole(path: str) -> bool:
    """Whether a file ends with the digest of its content."""
    try:
        content = memoryview(Path(path).read_bytes())
    except OSError:
        return False
    end = max(0, len(content) - hashlib.sha256().digest_size)
    return hashlib.sha256(content[:end]).digest() == content[end:]


class _KeptLinked(CompileResultCacheImpl):
    """Keeps the code that callers are made of."""

    _locator_classes = [_LocatedAnywhere]  # noqa: RUF012 as numba reads it

    def get_filename_base(self, fullname: str, abiflags: str) -> str:
        return f"linked-{super().get_filename_base(fullname, abiflags)}"  # type: ignore[no-untyped-call]

    def reduce(self, cres: Any) -> Any:
        library = cres.library
        library._ensure_finalized()
        cres.fndesc.typemap = cres.fndesc.calltypes = None
        bitcode = library._final_module.as_bitcode()
        return library.name, bitcode, cres.fndesc, cres.environment, cres.signature, cres.reload_init

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        name, bitcode, fndesc, environment, signature, reload_init = payload
        for item in reload_init:
            item()
        known = {
            "typing_context": target_context.typing_context, "target_context": target_context, "signature": signature,
            "library": _Linked.read(target_context.codegen(), name, bitcode), "fndesc": fndesc, "lifted": (),
            "environment": environment, "objectmode": False, "reload_init": reload_init,
        }  # fmt: skip
        return CompileResult(**{str(item): known.get(item) for item in CompileResult._fields})  # type: ignore[var-annotated]


def dispatcher(
    function: Callable[..., Any], folder: Path, apart: bool, counting: bool, alone: bool = False, **options: Any
) -> Any:
    """Return a function that numba compiles, for the types of its arguments, or finds in its cache in a folder.

    Its arguments may stand `apart` in memory, its references are counted or not, and it may be called `alone`, not by
    what numba compiles.
    """
    compiled: Any = numba.njit(nogil=True, **_options(apart, counting), **options)(function)
    compiled._cache = (_CacheAlone if alone else _Cache)(function, folder)
    return compiled


def linked(function: Callable[..., Any], folder: Path, apart: bool, counting: bool, **options: Any) -> Any:
    """Return a function as `dispatcher` does, which only other compiled functions can call."""
    given = _options(apart, counting) | {"pipeline_class": _LinkingApart if apart else _Linking}
    compiled: Any = numba.njit(nogil=True, **given, **options)(function)
    compiled._cache = _CacheLinked(function, folder)

    def add(result: Any) -> None:
        known = object()
        compiled.targetctx.insert_user_function(known, result.fndesc, [result.library])
        compiled.overloads[tuple(result.signature.args)] = result._replace(entry_point=known)

    compiled.add_overload = add
    return compiled


def callback(function: Callable[..., Any], folder: Path, counting: bool, signature: Any) -> Any:
    """Return a function that was compiled, or found in a cache, and has an ``address``; arguments stand apart."""
    options = _options(True, counting)
    pipeline = options.pop("pipeline_class")
    compiled: Any = CFunc(function, (signature.args, signature.return_type), {}, options, pipeline)
    compiled._cache = _CacheAlone(function, folder)
    compiled.compile()
    return compiled


def _options(apart: bool, counting: bool) -> dict[str, Any]:
    """Return options of numba; references are counted only where arrays are made.

    Elsewhere callers hold all arrays. A loop takes records of many, and most of its text would count them: the compiler
    needs some seconds to find that it can go.
    """
    pipeline = _Apart if apart else _Compiler
    return {"error_model": "numpy", "pipeline_class": pipeline, "no_cfunc_wrapper": True, "_nrt": counting}


_PLACED = threading.RLock()
"""Held while numba's setting is ours: threads that save and restore it at once would leave it so."""


class _Kept(CompileResultCacheImpl):
    """Keeps machine code without the modules of all that was inlined into it, which would be imported with it.

    What numba calls an environment refers to them, for functions that hand constants to the interpreter.
    """

    _locator_classes = [_LocatedAnywhere]  # noqa: RUF012 as numba reads it

    def reduce(self, cres: Any) -> Any:
        *parts, environments = super().reduce(cres)  # type: ignore[no-untyped-call]
        return *parts, tuple(item for item in environments if item.consts)


class _KeptAlone(_Kept):
    """Keeps it also without what a compiler would inline into other functions, which is as large and slow to read.

    Of that, numba reads the names of functions.
    """

    def reduce(self, cres: Any) -> Any:
        (name, kind, (code, bitcode)), *parts = super().reduce(cres)
        cres.library._shared_module = None  # a copy for other functions, which would stay as long as this one
        defined = (item.name for item in parse_bitcode(bitcode).functions if not item.is_declaration)
        names = "".join(f'define void @"{item}"() {{ ret void }}\n' for item in defined)
        return (name, kind, (code, parse_assembly(names).as_bitcode())), *parts


class _Cache(FunctionCache):
    """numba's cache in a folder, which loads machine code and nothing else.

    Numba's own makes all ready for the compiler at first: the types and texts of what it knows of Python and NumPy, and
    parts of SciPy. That takes a quarter of a second, and machine code does not need it; the compiler does it itself.
    """

    _impl_class = _Kept

    def __init__(self, function: Callable[..., Any], folder: Path) -> None:
        with _placed_in(folder):
            super().__init__(function)  # type: ignore[no-untyped-call]
            parts = self._cache_path, self._impl.filename_base, self._impl.locator.get_source_stamp()
            self._cache_file = _CheckedFiles(*parts)  # type: ignore[no-untyped-call]

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        if not hasattr(self, "_load_overload"):  # another version of numba
            return super().load_overload(sig, target_context)  # type: ignore[no-untyped-call]
        _runtime.initialize(target_context)  # what machine code calls to count references
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)  # type: ignore[no-untyped-call]


class _CacheAlone(_Cache):
    """The same for functions that only Python calls, or others by their address."""

    _impl_class = _KeptAlone


class _CacheLinked(_Cache):
    """The same for functions that are made parts of others, in files of their own."""

    _impl_class = _KeptLinked  # type: ignore[assignment]


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
