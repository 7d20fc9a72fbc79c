"""Arrays and addresses in compiled code: without counts of references, without checks, as one argument."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import types
from numba.extending import intrinsic

from impactlab.compiling.numba_private import (
    DATA,
    MEMINFO,
    NITEMS,
    SHAPE,
    STRIDES,
    RequireLiteralValue,
    in_frame,
    ir,
    literal,
    populate_array,
    unpack_tuple,
)
from impactlab.compiling.records import pointer_to
from impactlab.compiling.scalars import DISABLED

Function = Callable[..., Any]


def compiled_as(intrinsic: Any) -> Callable[[Function], Function]:
    """Let compiled code have an intrinsic in the place of a function, which runs where nothing is compiled."""
    return lambda function: function if DISABLED else intrinsic


def _without_count(context: Any, builder: Any, kind: Any, item: Any) -> Any:
    """Return an array, or a tuple of them, that does not count references."""
    if isinstance(kind, types.Array):
        return builder.insert_value(item, ir.Constant(item.type.elements[MEMINFO], None), MEMINFO)
    if isinstance(kind, types.BaseTuple):
        parts: Any = kind
        for index, part in enumerate(parts):
            stripped = _without_count(context, builder, part, builder.extract_value(item, index))
            item = builder.insert_value(item, stripped, index)
    return item


def _as_data(context: Any, builder: Any, kind: Any, item: Any) -> Any:
    """Return a value as it is in memory. Numba takes all arrays of a tuple to pieces for that, and joins them again."""
    if context.get_value_type(kind) == context.get_data_type(kind):
        return item
    if not isinstance(kind, types.BaseTuple):
        return context.data_model_manager[kind].as_data(builder, item)
    parts: Any = kind
    result = ir.Constant(context.get_data_type(kind), ir.Undefined)
    for index, part in enumerate(parts):
        data = _as_data(context, builder, part, builder.extract_value(item, index))
        result = builder.insert_value(result, data, index)
    return result


@intrinsic
def _unmanaged(typing_context, value):  # type: ignore[no-untyped-def]
    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _without_count(context, builder, value, arguments[0])

    return value(value), codegen


@compiled_as(_unmanaged)
def borrow(value):  # type: ignore[no-untyped-def]
    """Return an array, or a tuple of them, for use inside a loop whose caller holds it.

    Every view of it and every call would else count references, atomically: 0.3 µs a step.
    """
    return value


@intrinsic
def _address_of(typing_context, value):  # type: ignore[no-untyped-def]
    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        place = in_frame(builder, context.get_data_type(value))
        builder.store(_as_data(context, builder, value, arguments[0]), place)
        return place

    return pointer_to(value)(value), codegen


@intrinsic
def _value_at(typing_context, pointer):  # type: ignore[no-untyped-def]
    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        value = context.data_model_manager[pointer.dtype].load_from_data_pointer(builder, arguments[0])
        return _without_count(context, builder, pointer.dtype, value)

    return pointer.dtype(pointer), codegen


@compiled_as(_address_of)
def address_of(value):  # type: ignore[no-untyped-def]
    """Return a pointer to a value in the frame of the caller, for functions that take it as one argument.

    Handing over all arrays of a block one by one takes 0.1 µs.
    """
    return value


@compiled_as(_value_at)
def value_at(pointer):  # type: ignore[no-untyped-def]
    """Return the value that `address_of` gave a pointer to, borrowed."""
    return pointer


@intrinsic
def _write_at(typing_context, value, place):  # type: ignore[no-untyped-def]
    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        data = _as_data(context, builder, value, arguments[0])
        builder.store(data, builder.inttoptr(arguments[1], data.type.as_pointer()))
        return context.get_dummy_value()

    return types.none(value, place), codegen


@compiled_as(_write_at)
def write_at(value, place):  # type: ignore[no-untyped-def]
    """Write a value into memory from an address on, as a number, where `value_at` finds it; somebody else holds it.

    Where nothing is compiled it is the first field of an object.
    """
    setattr(place, next(iter(vars(place))), value)


@intrinsic
def _number_at(typing_context, pointer):  # type: ignore[no-untyped-def]
    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.ptrtoint(arguments[0], context.get_value_type(types.int64))

    return types.int64(pointer), codegen


@compiled_as(_number_at)
def number_at(pointer):  # type: ignore[no-untyped-def]
    """Return what `address_of` gave as a number, which `call` takes as well, or 0 may stand for."""
    return pointer


@intrinsic
def _call(typing_context, function, pointer, index):  # type: ignore[no-untyped-def]
    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        address, *values = arguments
        kind = ir.FunctionType(ir.VoidType(), [value.type for value in values])
        builder.call(builder.inttoptr(address, kind.as_pointer()), values)
        return context.get_dummy_value()

    return types.none(function, pointer, index), codegen


@compiled_as(_call)
def call(function, pointer, index):  # type: ignore[no-untyped-def]
    """Call what `part` compiled by its address, ``function(pointer, index)``; see `address_of`."""
    function(pointer, index)


@intrinsic
def _first_lanes(typing_context, block, lanes):  # type: ignore[no-untyped-def]
    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array = context.make_array(block)(context, builder, arguments[0])
        shape = [*unpack_tuple(builder, array.shape)[:-1], arguments[1]]
        size = array.itemsize
        strides: list[Any] = []
        for length in reversed(shape):
            strides.insert(0, size)
            size = builder.mul(size, length)
        items = builder.udiv(size, array.itemsize)
        populate_array(array, array.data, shape, strides, array.itemsize, None)
        array.nitems = items
        return array._getvalue()

    return block(block, types.intp), codegen


@compiled_as(_first_lanes)
def dense(block, lanes):  # type: ignore[no-untyped-def]
    """Return the memory of a block (…, lane), or its beginning, as a block of fewer lanes without gaps.

    As with `borrow`, somebody else must hold the memory.
    """
    rows = block.shape[:-1]
    return block.reshape(-1)[: math.prod(rows) * lanes].reshape(*rows, lanes)


@intrinsic
def _rows(typing_context, array, begin, count):  # type: ignore[no-untyped-def]
    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        whole, begin, items = arguments
        data = builder.extract_value(whole, DATA)
        memory = builder.bitcast(data, ir.IntType(8).as_pointer())  # a number of items would take a division
        first = builder.gep(memory, [builder.mul(begin, builder.extract_value(whole, (STRIDES, 0)))])
        result = builder.insert_value(whole, builder.bitcast(first, data.type), DATA)
        result = builder.insert_value(result, items, (SHAPE, 0))
        for axis in range(1, array.ndim):
            items = builder.mul(items, builder.extract_value(whole, (SHAPE, axis)), flags=["nsw"])
        return _without_count(context, builder, array, builder.insert_value(result, items, NITEMS))

    return array(array, types.intp, types.intp), codegen


@compiled_as(_rows)
def rows(array, begin, count):  # type: ignore[no-untyped-def]
    """Return some rows of an array that somebody else holds, without the checks of a slice, which cost as much."""
    return array[begin : begin + count]


@intrinsic
def _registers(typing_context, count):  # type: ignore[no-untyped-def]
    if not isinstance(count, types.IntegerLiteral):
        raise RequireLiteralValue("the number of registers")
    number, result = count.literal_value, types.Array(types.float64, 1, "C")

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind = ir.ArrayType(ir.DoubleType(), number)
        place = in_frame(builder, kind)
        builder.store(ir.Constant(kind, None), place)
        array = context.make_array(result)(context, builder)
        length, size = context.get_constant(types.intp, number), context.get_constant(types.intp, 8)
        data = builder.bitcast(place, ir.DoubleType().as_pointer())
        populate_array(array, data, [length], [size], size, None)
        return array._getvalue()

    return result(literal(number)), codegen


@compiled_as(_registers)
def registers(count):  # type: ignore[no-untyped-def]
    """Return an array of zeros in the frame of the caller; its numbers are in registers where all indices are known."""
    return np.zeros(count)


@intrinsic
def _shaped(typing_context, array, first, second, third):  # type: ignore[no-untyped-def]
    lengths = first, second, third
    if not all(isinstance(item, types.IntegerLiteral) for item in lengths):
        raise RequireLiteralValue("a shape")
    shape = [item.literal_value for item in lengths]

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        strides = [8 * math.prod(shape[place + 1 :]) for place in range(3)]
        numbers = ([context.get_constant(types.intp, item) for item in items] for items in (shape, strides))
        populate_array(array, array.data, *numbers, context.get_constant(types.intp, 8), None)
        return array._getvalue()

    return array(array, *map(literal, shape)), codegen


@compiled_as(_shaped)
def shaped(array, first, second, third):  # type: ignore[no-untyped-def]
    """Return an array of floats with the shape that it has, which the compiler then knows."""
    return array


@intrinsic
def _rows_of_lanes(typing_context, array, begin, count, lanes):  # type: ignore[no-untyped-def]
    result = types.Array(array.dtype, 2, "C")

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        whole = context.make_array(signature.args[0])(context, builder, arguments[0])
        block, size = context.make_array(result)(context, builder), whole.itemsize
        data, shape = builder.gep(whole.data, [arguments[1]]), arguments[2:]
        populate_array(block, data, shape, [builder.mul(arguments[3], size), size], size, None)
        return block._getvalue()

    return result(array, types.intp, types.intp, types.intp), codegen


@compiled_as(_rows_of_lanes)
def rows_of_lanes(array, begin, count, lanes):  # type: ignore[no-untyped-def]
    """Return numbers of an array (number,) from a place on as rows of lanes, as `rows` does."""
    return array[begin : begin + count * lanes].reshape(count, lanes)


@intrinsic
def _sized(typing_context, place, shape):  # type: ignore[no-untyped-def]
    result = types.Array(place.dtype, len(shape), "C")

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array, lengths = context.make_array(result)(context, builder), unpack_tuple(builder, arguments[1])
        strides = [context.get_constant(types.intp, 8)]
        for length in reversed(lengths[1:]):
            strides.insert(0, builder.mul(length, strides[0]))
        populate_array(array, arguments[0], lengths, strides, strides[-1], None)
        return array._getvalue()

    return result(place, shape), codegen


@compiled_as(_sized)
def sized(place, shape):  # type: ignore[no-untyped-def]
    """Return the array of a shape whose numbers of 8 bytes are at some place, which somebody else holds."""
    raise NotImplementedError("There are no addresses where nothing is compiled")


@intrinsic
def _seldom(typing_context, condition):  # type: ignore[no-untyped-def]
    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        bit = ir.IntType(1)
        value = context.cast(builder, arguments[0], signature.args[0], types.boolean)
        expect = builder.module.declare_intrinsic("llvm.expect", [bit], ir.FunctionType(bit, [bit, bit]))
        return builder.call(expect, [value, bit(0)])

    return types.boolean(condition), codegen


@compiled_as(_seldom)
def seldom(condition):  # type: ignore[no-untyped-def]
    """Return a condition that the compiler takes to be seldom true: so it makes a branch of it, not a choice of two."""
    return condition
