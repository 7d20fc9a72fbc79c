"""Tasks that run beside each other: the order of their results, and how all stop."""

import threading
from concurrent.futures import BrokenExecutor, Future, ThreadPoolExecutor

import pytest

import impactlab as il
from impactlab.machine import MOST_WAITING, Tally, hand_over


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


def test_few_tasks_wait():
    """However many there are, so that they do not fill the memory."""
    ended, begun, most = 0, 0, 0

    def tasks():
        nonlocal begun, most
        for _ in range(1000):
            begun += 1
            most = max(most, begun - ended)
            task = Future()
            task.set_result(None)
            yield task

    def finished(_):
        nonlocal ended
        ended += 1

    hand_over(tasks(), finished, nothing, threading.Event())
    assert ended == begun == 1000
    assert most <= MOST_WAITING


@pytest.mark.parametrize("module", ["distributed.scheduler", "concurrent.futures.process"])
def test_a_worker_that_died_is_told(module):
    kind = type("KilledWorker", (BrokenExecutor if module.startswith("conc") else Exception,), {"__module__": module})
    task = Future()
    task.set_exception(kind("worker tcp://…"))
    with pytest.raises(il.ImpactLabError, match=r"^A worker of the executor died, .*: worker tcp"):
        hand_over([task], nothing, nothing, threading.Event())
