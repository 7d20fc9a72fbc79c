"""Simulations side by side: how many at a time, what is shared, and how all stop."""

import threading

import pytest
import xarray as xr

import impactlab as il
from impactlab.ensemble import SharedThreads, cores, workers_of
from impactlab.together import run_together


def test_as_many_at_a_time_as_there_are_threads():
    """One block of each: no core waits for another simulation."""
    meet = threading.Barrier(3)

    def job(pool, note):
        pool.submit(meet.wait, 60.0).result()
        return xr.Dataset()

    finished = []
    run_together(dict.fromkeys("abcdef", job), lambda key, _: finished.append(key), kind="Job", workers=3)
    assert finished == list("abcdef")


def test_jobs_alone_are_one_at_a_time():
    inside = threading.Lock()

    def job(pool, note):
        assert inside.acquire(blocking=False)
        assert workers_of(pool) == 4
        pool.submit(int).result()
        inside.release()
        return xr.Dataset()

    run_together(dict.fromkeys("abc", job), lambda *_: None, kind="Job", workers=4, alone=True)


def test_a_simulation_is_cut_for_its_share_of_the_threads():
    shares = {(threads, jobs): workers_of(SharedThreads(threads, jobs)) for threads, jobs in [(8, 1), (8, 3), (8, 20)]}
    assert shares == {(8, 1): 8, (8, 3): 3, (8, 20): 1}
    assert workers_of(None) == cores()


def test_an_error_of_impactlab_is_an_outcome_and_any_other_stops_all():
    begun, outcomes = threading.Event(), {}

    def refused(pool, note):
        raise il.InvalidInput("no")

    def endless(pool, note):
        begun.set()
        while True:
            note(0.0)

    def broken(pool, note):
        assert begun.wait(60.0)
        raise ZeroDivisionError

    jobs = {"refused": refused, "broken": broken, "endless": endless}
    with pytest.raises(ZeroDivisionError):
        run_together(jobs, outcomes.__setitem__, kind="Job", workers=2)
    assert list(outcomes) == ["refused"]
    assert isinstance(outcomes["refused"], il.InvalidInput)


def test_nothing_to_do():
    run_together({}, lambda *_: pytest.fail("called"), kind="Job")
