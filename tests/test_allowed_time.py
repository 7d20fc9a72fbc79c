"""The time that a call may take."""

import math
import time

import pytest

import impactlab as il
from impactlab.allowed_time import allowed_time, check_time, time_left, uncounted_time


def test_there_is_no_limit_by_default_and_the_narrowest_of_several_holds():
    assert math.isinf(time_left())
    check_time("Anything", 1e9)
    with allowed_time(100.0):
        with allowed_time(1000.0):
            assert 99.0 < time_left() <= 100.0
        with pytest.raises(il.InvalidInput, match="A task would take about 2e"), allowed_time(10.0):
            check_time("A task", 200.0)
        check_time("A task", 50.0)
    assert math.isinf(time_left())


def test_time_of_the_compiler_does_not_count():
    with allowed_time(10.0):
        before = time_left()
        with uncounted_time():
            time.sleep(0.05)
        assert time_left() > before - 0.04


def test_nothing_goes_on_when_the_time_is_over():
    with allowed_time(0.0):
        time.sleep(0.001)
        with pytest.raises(il.InvalidInput, match=r"A task takes longer, but 0 s are left\. Give"):
            check_time("A task")
