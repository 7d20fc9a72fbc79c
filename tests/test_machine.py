"""Tasks that run beside each other: the order of their results, and how all stop."""

import threading
from concurrent.futures import Future, ThreadPoolExecutor

import pytest

import impactlab as il
from impactlab.machine import Tally, hand_over


def nothing(*_):
    """Take something, and do nothing."""


def test_results_come_in_the_order_of_tasks():
    """Sums of floats over blocks then do not depend on which of them ended first."""
    tasks, seen = [Future() for _ in range(3)], []
    tasks[2].set_result("third")

    def show():
        seen.append("shown")
        if not tasks[0].done():
            tasks[0].set_result("first")
        elif not tasks[1].done():
            tasks[1].set_result("second")

    hand_over(tasks, seen.append, show, threading.Event())
    assert seen == ["shown", "first", "shown", "second", "third", "shown"]


@pytest.mark.parametrize("wrong", ["task", "finished", "show", "begin"])
def test_an_error_stops_all(wrong):
    """Whether in a task behind one that is endless, in what is called back, or where tasks begin."""
    tally, begun = Tally(), threading.Event()

    def endless():
        begun.set()
        while True:
            tally(1)

    def fail(*_):
        assert begun.wait(60.0)
        raise ZeroDivisionError

    with ThreadPoolExecutor(2) as pool:
        tasks = [pool.submit(task) for task in (int, endless, fail if wrong == "task" else int, endless, endless)]

        def begin():
            yield from tasks
            if wrong == "begin":
                fail()

        with pytest.raises(ZeroDivisionError):
            hand_over(
                begin(), fail if wrong == "finished" else nothing, fail if wrong == "show" else nothing, tally.stop
            )
    assert tally.done > 0
    assert isinstance(tasks[1].exception(), il.errors.Interrupted)
    assert tasks[4].cancelled()
