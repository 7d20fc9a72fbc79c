"""Records in memory of their own, as compiled functions find them by their addresses."""

from typing import NamedTuple

import numpy as np
import pytest

from impactlab.compiling.intrinsics import address_of, call, number_at, value_at, write_at
from impactlab.compiling.jit import loop
from impactlab.compiling.own_memory import Stored, function_of
from impactlab.compiling.records import Block, Numbers, address, signature


class Around(NamedTuple):
    lengths: Numbers


AroundAddress = address(Around)


class Own(NamedTuple):
    around: AroundAddress
    sums: Block  # [row, lane]
    factor: float


def add(place, now):
    own = value_at(place)
    around = value_at(own.around)
    for row in range(own.sums.shape[0]):
        for lane in range(own.sums.shape[1]):
            own.sums[row, lane] += own.factor * around.lengths[row] + now


def call_twice(place, function, lengths):
    write_at(number_at(address_of(Around(lengths))), place)
    call(function, place, 1)
    call(function, place, 2)


@pytest.mark.full
def test_processes_load_no_records_of_modules_that_they_have_not(tmp_path, run_python, monkeypatch):
    """The cache of one function for all records would name the classes of each."""
    monkeypatch.setenv("IMPACTLAB_CACHE", str(tmp_path))
    text = """
import sys
from typing import NamedTuple
sys.path.insert(0, {folder!r})
from impactlab.compiling.own_memory import Stored
{record}
assert Stored(Record(0, 0.5), False).address
"""
    record = "class Record(NamedTuple):\n    around: int\n    factor: float\n"
    for name in ("one", "other"):
        folder = tmp_path / name
        folder.mkdir()
        (folder / f"records_of_{name}.py").write_text(f"from typing import NamedTuple\n{record}")
        run_python("-c", text.format(folder=str(folder), record=f"from records_of_{name} import Record"))


@pytest.mark.parametrize("single", [False, True], ids=["lanes", "one lane"])
def test_a_function_finds_the_record_of_its_address(single):
    sums, lengths = np.zeros((2, 1 if single else 3)), np.array([10.0, 20.0])
    stored = Stored(Own(0, sums, 0.0), single)
    stored.change(factor=0.5)
    run = loop(signature(single, int, int, Numbers), call_twice)
    run(stored.address, function_of(Own, add, single), lengths)
    np.testing.assert_array_equal(sums, [[13.0] * sums.shape[1], [23.0] * sums.shape[1]])
