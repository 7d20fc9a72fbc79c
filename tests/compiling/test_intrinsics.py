"""Rows of arrays without the checks of a slice, and arrays that begin where a line of the cache does."""

import numpy as np

from impactlab.compiling.intrinsics import rows
from impactlab.compiling.jit import kernel
from impactlab.simulation.arrays import CACHE_LINE, aligned


@kernel
def copy_rows(block, begin, result):  # type: ignore[no-untyped-def]
    some = rows(block, begin, result.shape[0])
    for row in range(some.shape[0]):
        for lane in range(some.shape[1]):
            result[row, lane] = some[row, lane]


def test_rows_are_those_of_a_slice():
    block, result = np.arange(35.0).reshape(7, 5), np.zeros((3, 5))
    copy_rows(block, 2, result)
    np.testing.assert_array_equal(result, block[2:5])


def test_arrays_begin_where_a_line_of_the_cache_does():
    for shape, kind in (((3, 8), float), ((1,), np.float32), ((2, 4), np.int64)):
        array = aligned(shape, kind)
        assert (array.shape, array.dtype) == (shape, kind)
        assert array.ctypes.data % CACHE_LINE == 0
        assert not array.any()
