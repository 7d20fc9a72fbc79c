"""The type of the function that is generated for a network's forces, and how compiled code calls it.

Its arguments are blocks. As arrays they are 69 numbers, and to write and read them takes a twentieth of a step of two
bodies in 64 lanes. So it is handed the places where they begin, and how many rows and lanes there are.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numba import extending, f8, i8, types, void

from impactlab.compiling.intrinsics import sized
from impactlab.compiling.jit import Function, composed, inlined, loop, part
from impactlab.compiling.numba_private import DATA, SHAPE, add_symbol, any_others, declared, ir, signature_of
from impactlab.compiling.records import Typed, pointer_to
from impactlab.compiling.scalars import DISABLED, scalar

_extending: Any = extending
_intrinsic: Any = extending.intrinsic

_PLACE, _PLACES = pointer_to(f8), [pointer_to(f8)] * 3
BY_ADDRESS = void(*_PLACES, f8, _PLACE, i8, pointer_to(i8), i8, *_PLACES, i8, i8, i8)
"""What is called in the end; see `by_address`."""


class Forces(types.Callable):  # type: ignore[misc]
    """Type of a network's forces, for blocks or for blocks of one lane; see `impactlab.assembly.generate`.

    The value is an address. All blocks of bodies have the rows of the first, and those of contacts the rows of the
    indentation: only these are handed over.
    """

    def __init__(self, single: bool) -> None:
        block = f8[::1] if single else f8[:, ::1]
        self.single, self.block = single, block
        self.arguments = *[block] * 3, f8, f8[::1], i8[::1], *[block] * 3
        super().__init__(f"Forces({single})")

    def get_call_type(self, context: Any, args: Any, kws: Any) -> Any:
        return signature_of(types.none, *self.arguments, recvr=self)

    def get_call_signatures(self) -> Any:
        return [self.get_call_type(None, (), {})], False

    def get_impl_key(self, sig: Any) -> Any:
        return Forces


FORCES, FORCES_OF_ONE = Forces(False), Forces(True)

ForceFunction = Annotated[Any, Typed(FORCES, FORCES_OF_ONE)]


@_extending.register_model(Forces)
class _Model(_extending.models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, dmm: Any, fe_type: Any) -> None:
        super().__init__(dmm, fe_type, ir.IntType(64))


@_extending.unbox(Forces)
def _unboxed(typ: Any, obj: Any, c: Any) -> Any:
    found = c.pyapi.object_getattr_string(obj, "address")
    address = c.pyapi.long_as_longlong(found)
    c.pyapi.decref(found)
    return _extending.NativeValue(address)


@_extending.lower_builtin(Forces, Forces, any_others(types.Any))
def _called(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    (kind, *kinds), (address, *values) = sig.args, args
    half_step, arrays = values.pop(3), kinds[:3] + kinds[4:]
    places, lengths = places_of(context, builder, arrays, values)
    x, v, middle, parameters, indices, *results = places
    lanes = context.get_constant(types.intp, 1) if kind.single else lengths[0][1]
    handed = [
        x, v, middle, half_step, parameters, lengths[3][0], indices, lengths[4][0], *results, lengths[0][0],
        lengths[5][0], lanes,
    ]  # fmt: skip
    function = ir.FunctionType(ir.VoidType(), [item.type for item in handed])
    builder.call(builder.inttoptr(address, function.as_pointer()), handed)
    return context.get_dummy_value()


def places_of(context: Any, builder: Any, kinds: Any, values: Any) -> tuple[list[Any], list[Any]]:
    """Return where the numbers of some arrays begin, and their lengths."""
    places = [builder.extract_value(value, DATA) for value in values]
    lengths = [
        [builder.extract_value(value, (SHAPE, axis)) for axis in range(kind.ndim)]
        for kind, value in zip(kinds, values, strict=True)
    ]
    return places, lengths


def by_address(  # type: ignore[no-untyped-def]
    x, v, middle, half_step, parameters, numbers, indices, entries, indentation, contact_force, total, bodies, contacts,
    lanes,
):  # fmt: skip
    """Call the forces with blocks at some places, of so many rows and lanes, and arrays of so many numbers."""
    of_bodies, of_contacts = shape(bodies, lanes), shape(contacts, lanes)
    forces(
        sized(x, of_bodies), sized(v, of_bodies), sized(middle, of_bodies), half_step, sized(parameters, (numbers,)),
        sized(indices, (entries,)), sized(indentation, of_contacts), sized(contact_force, of_contacts),
        sized(total, of_bodies),
    )  # fmt: skip


RESIDENT = void(pointer_to(i8), i8, _PLACE, i8, _PLACE, i8, i8)
"""What `resident` calls in the end; see `resident_by_address`."""


def resident_by_address(indices, entries, one, ones, other, others, lanes):  # type: ignore[no-untyped-def]
    """Call a kernel with `Members.indices` and two blocks, of so many rows and lanes."""
    kernel(sized(indices, (entries,)), sized(one, shape(ones, lanes)), sized(other, shape(others, lanes)))


@scalar
def of_lanes(rows, lanes):  # type: ignore[no-untyped-def]
    """Return the shape of a block."""
    return rows, lanes


@scalar
def of_one(rows, lanes):  # type: ignore[no-untyped-def]
    """Return the shape of a block of one lane, which has no axis of lanes."""
    return (rows,)


def _called_by(signature: Any, caller: Function, kind: Forces, name: str, **names: Any) -> Any:
    """Compile what is called by its address, with blocks of a kind, known to the cache by a name; return both."""
    shape, version = (of_one, f"{name}_of_one") if kind.single else (of_lanes, name)
    return part(signature, composed(caller, version, shape=shape, **names), True)


def _stand_in(*arguments: Any) -> Any:
    """Stand for the forces of a network, for a kernel, or for the shape of a block."""
    raise NotImplementedError


forces = kernel = shape = _stand_in

_BLOCKS, _BLOCKS_OF_ONE = f8[:, :, ::1], f8[:, ::1]
_EVALUATE = void(FORCES, *[_BLOCKS] * 2, f8[::1], i8[::1], *[_BLOCKS] * 3)
_EVALUATE_ONE = void(FORCES_OF_ONE, *[_BLOCKS_OF_ONE] * 2, f8[::1], i8[::1], *[_BLOCKS_OF_ONE] * 3)


def pointer(kind: Forces) -> Callable[[Function], Function]:
    """Compile a function that kernels receive as an argument of a type, and call by its address."""

    def decorate(function: Function) -> Function:
        compiled: Any = function
        if not DISABLED:
            version = Path(function.__code__.co_filename).stem
            compiled, _ = _called_by(BY_ADDRESS, by_address, kind, version, forces=inlined(function))
        compiled.single = kind.single
        return compiled  # type: ignore[no-any-return]

    return decorate


@cache
def resident(compiled: Function, kind: Forces) -> Function:
    """Return a kernel that takes `Members.indices` and two blocks for forces of a type, which call it where it is.

    Called as other kernels are, it would be compiled again with every function that is generated.
    """
    if DISABLED:
        return compiled
    name = compiled.__name__
    symbol = f"impactlab_{name}"
    add_symbol(symbol, _called_by(RESIDENT, resident_by_address, kind, name, kernel=compiled)[1])

    @_intrinsic
    def call(typing_context, indices, one, other):  # type: ignore[no-untyped-def]
        def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            places, lengths = places_of(context, builder, signature.args, arguments)
            lanes = context.get_constant(types.intp, 1) if kind.single else lengths[1][1]
            handed = [item for place, length in zip(places, lengths, strict=True) for item in (place, length[0])]
            function = ir.FunctionType(ir.VoidType(), [item.type for item in (*handed, lanes)])
            builder.call(declared(builder.module, function, symbol), [*handed, lanes])
            return context.get_dummy_value()

        return types.none(i8[::1], kind.block, kind.block), codegen

    return call  # type: ignore[no-any-return]


def evaluate(forces: Any, x: np.ndarray, v: np.ndarray, *arrays: np.ndarray) -> None:
    """Call a network's forces in some states, at their velocities, for what is outside the loops.

    `arrays` are parameters, indices, and the results: indentation, contact force, total. These and states are
    blocks, [state, body or contact, lane].
    """
    parameters, indices, *results = arrays
    single = forces.single
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
