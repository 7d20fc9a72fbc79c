"""Simulations side by side: how many at a time, what is shared, and how all stop."""

import multiprocessing
import os
import threading
import warnings
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool

import numpy as np
import pytest
import xarray as xr

import impactlab as il
from impactlab.errors import heard_by, warn
from impactlab.machine import SharedThreads, cores, workers_of
from impactlab.sweeps.scheduler import run_together


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


# executors


@pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="there is no fork here")
def test_workers_are_forked_before_anything_runs_beside():
    """A fork while another thread multiplies matrices may hang for ever."""
    beside = []

    class Pool(ProcessPoolExecutor):
        def _launch_processes(self):
            beside.append({thread.name for thread in threading.enumerate()} - before)
            super()._launch_processes()

    def job(pool, note):
        pool.submit(int).result()
        return xr.Dataset()

    before = {thread.name for thread in threading.enumerate()}
    with Pool(2, mp_context=multiprocessing.get_context("fork")) as pool:
        run_together(dict.fromkeys("abcdefgh", job), lambda *_: None, kind="Job", executor=pool)
    assert beside == [set()]


def test_an_executor_that_takes_nothing():
    pool = ThreadPoolExecutor(1)
    pool.shutdown()
    network = il.Network({"a": il.LinearOscillator(stiffness=1.0, damping=1.0)}, excitations={"a": il.WhiteNoise(1.0)})
    with pytest.raises(il.InvalidInput, match=r"accepts no more work .*shutdown.*; give one that is running"):
        il.simulate(network, 5.0, realizations=64, executor=pool)
    with pytest.raises(il.InvalidInput, match="accepts no more work"):
        il.sweep(lambda c: network, {"c": [1.0, 2.0]}, duration=5.0, realizations=64, executor=pool)


def test_a_worker_that_dies_is_said():
    network = il.Network({"a": il.LinearOscillator(stiffness=1.0, damping=1.0)}, excitations={"a": il.WhiteNoise(1.0)})
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        pool.submit(os._exit, 1)
        with pytest.raises(il.ImpactLabError, match=r"A worker of the executor died|accepts no more work"):
            il.simulate(network, 5.0, realizations=64, executor=pool)


class FailingPool(ThreadPoolExecutor):
    """Accepts some work, the last of which ends the worker."""

    def __init__(self, accepts):
        super().__init__(1)
        self.accepts, self.numbers = accepts, iter(range(1, accepts + 1))

    def submit(self, function, /, *arguments):
        number = next(self.numbers, None)
        if number is None:
            raise BrokenProcessPool("A child process terminated abruptly.")
        return super().submit(function if number < self.accepts else ended, *arguments)


def ended(*arguments):
    raise BrokenProcessPool("A process was terminated\nabruptly.")


def test_points_that_are_lost_with_their_executor_are_an_error(tmp_path):
    def network(damping):
        body = il.LinearOscillator(stiffness=1.0, damping=damping)
        return il.Network({"a": body}, excitations={"a": il.Harmonic(1.0, frequency=1.0)})

    points = {"damping": [0.5, 1.0, 2.0, 4.0]}
    options = {"duration": 5.0, "integrator": il.ExactFlow()}  # of one realization: one block each
    expected = il.sweep(network, points, **options)
    kept_in = {"checkpoint": tmp_path / "kept"}
    with FailingPool(5) as pool, pytest.raises(il.ImpactLabError, match=r"^2 of 4 points were lost with the") as said:
        il.sweep(network, points, executor=pool, **options, **kept_in)  # of what it accepts, two begin workers
    found = said.value.found
    kept = (found.status == "done").values
    assert kept.sum() == 2
    values = found.mean_square_displacement
    np.testing.assert_array_equal(values[kept], expected.mean_square_displacement[kept])
    assert values[~kept].isnull().all()
    with FailingPool(3) as pool, pytest.raises(il.ImpactLabError, match=r"No point .* could be simulated; .* abruptly"):
        il.sweep(network, points, executor=pool, **options)
    with FailingPool(6) as pool:  # the two that are missing
        whole = il.sweep(network, points, executor=pool, **options, **kept_in)
    np.testing.assert_array_equal(whole.mean_square_displacement, expected.mean_square_displacement)
    assert all(path.name.endswith(".item") for path in (tmp_path / "kept" / "items").iterdir())


# warnings


def test_two_at_a_time_leave_the_warnings_of_others_alone():
    """Each hears its own, and what the process shows is as before."""
    meet, shown = threading.Barrier(2, timeout=60.0), warnings.showwarning
    outer, inner = threading.Event(), threading.Event()

    def first(pool, note):
        meet.wait()
        warn("drift", "of the first")
        outer.wait(60.0)
        return xr.Dataset()

    def second(pool, note):
        meet.wait()
        warn("drift", "of the second")
        return xr.Dataset()

    heard = {}

    def run(name, job, done):
        with heard_by(lambda warning: heard.setdefault(name, []).append((str(warning), type(warning)))):
            run_together({name: job}, lambda *_: None, kind="Job", workers=1)
        done.set()

    threads = [
        threading.Thread(target=run, args=("one", first, inner)),
        threading.Thread(target=run, args=("two", second, outer)),  # ends in the midst of the first
    ]
    for thread in threads:
        thread.start()
    meet_again = [thread.join(60.0) for thread in threads]
    assert meet_again == [None, None]
    assert inner.is_set()
    assert warnings.showwarning is shown
    assert heard == {
        "one": [("Job 'one': of the first", il.AccuracyWarning)],
        "two": [("Job 'two': of the second", il.AccuracyWarning)],
    }
    with pytest.warns(UserWarning, match="somebody else"):
        warnings.warn("of somebody else", stacklevel=1)


def test_many_jobs_give_three_warnings_at_most():
    kinds = ["few_samples", "drift", "heating", "balance"]

    def job(number):
        def run(pool, note):
            for kind in kinds[: 1 + number % 4]:
                warn(kind, f"{kind} {number}")
            return xr.Dataset()

        return run

    jobs = {f"k={number}": job(number) for number in range(300)}
    with pytest.warns(il.AccuracyWarning) as caught:
        run_together(jobs, lambda *_: None, kind="Point", workers=2)
    assert [str(item.message) for item in caught] == [
        "In 300 of 300 points, first 'k=0': few_samples 0",
        "In 225 of 300 points, first 'k=1': drift 1",
        "Also in some of 300 points: energy that the step adds or removes (in 150); a balance that does not close (in "
        "75). See `warnings` in the result.",
    ]


def test_warnings_of_others_are_not_taken():
    def job(pool, note):
        with pytest.warns(UserWarning, match="somebody else"):
            warnings.warn("of somebody else", stacklevel=1)
        return xr.Dataset()

    run_together({"a": job}, lambda *_: None, kind="Job", workers=1)
