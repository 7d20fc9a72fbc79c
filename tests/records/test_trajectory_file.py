"""Trajectories in files: the same numbers, in constant memory, whole or absent."""

import os
import pickle
import signal
import tracemalloc
from collections import namedtuple
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

import numpy as np
import pytest
import xarray as xr
from scenes import base, linear, plan_of

import impactlab as il
from impactlab.machine import tuned
from impactlab.records import trajectory_file
from impactlab.results.dataset import load
from impactlab.simulation import memory_use as memory
from impactlab.simulation.block_sums import merged
from impactlab.simulation.ensemble import run
from impactlab.statistics.estimate import estimate

pytestmark = pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")

RUN = {"realizations": 5, "rng": 1, "step": 5e-3, "spin_up": 0.0}


@pytest.fixture
def path(tmp_path):
    return tmp_path / "run.nc"


def assert_same(first, second):
    """Both are the same but for the time when they were made."""
    first, second = (
        item.drop_attrs(deep=False).assign_attrs({**item.attrs, "history": ""}) for item in (first, second)
    )
    xr.testing.assert_identical(first, second)


@pytest.mark.parametrize("chunk", [1, 999, 1_000_000])
@pytest.mark.parametrize("threads", [1, 3])
def test_a_file_has_what_memory_has(path, chunk, threads):
    """Whatever is written at a time, and by how many threads."""
    record = [il.Trajectory(0.01), il.Density(bins=7)]
    kept = il.simulate(base(), 0.63, record=record, **RUN)
    with tuned(chunk_bytes=chunk), ThreadPoolExecutor(threads) as pool:
        ds = il.simulate(base(), 0.63, record=record, out=path, executor=pool, **RUN)
    assert_same(ds.load(), kept)
    assert_same(load(path), kept)
    ds.close()


def test_several_blocks_write_to_one_file(path):
    options = {**RUN, "realizations": 700, "record": il.Trajectory(0.1)}
    kept, ds = il.simulate(base(), 0.2, **options), il.simulate(base(), 0.2, out=path, **options)
    assert_same(ds.load(), kept)
    ds.close()


def test_trajectories_are_read_when_they_are_needed(path):
    ds = il.simulate(base(), 0.2, record=il.Trajectory(0.1), out=path, **RUN)
    assert {name for name, item in ds.variables.items() if not item._in_memory} == {
        "displacement", "velocity", "contact_force",
    }  # fmt: skip
    ds.close()
    assert np.isfinite(ds.mean_square_velocity).all()


def test_a_file_of_a_run_makes_it_again(path):
    il.simulate(base(), 0.3, record=il.Trajectory(0.1), out=path, **RUN).close()
    assert il.network_of(path) == base()
    assert_same(il.rerun(path), load(path))


def test_without_trajectories_the_dataset_is_written(path):
    ds = il.simulate(base(), 0.3, out=path, **RUN)
    assert_same(ds, il.simulate(base(), 0.3, **RUN))
    assert_same(ds, load(path))


def test_an_existing_file_is_replaced_at_the_end_and_kept_when_something_fails(path, monkeypatch):
    path.write_text("old")
    with monkeypatch.context() as patch:
        patch.setattr("impactlab.simulation.growing_ensemble.run", lambda *_: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            il.simulate(base(), 0.3, record=il.Trajectory(0.1), out=path, **RUN)
    assert path.read_text() == "old"
    assert os.listdir(path.parent) == [path.name]
    il.simulate(base(), 0.3, record=il.Trajectory(0.1), out=path, **RUN).close()
    assert load(path).sizes["time"] == 4


@pytest.mark.full
def test_memory_does_not_grow_with_the_duration(path):
    """Ten times the samples, of 0.5 and 5 MB, take hardly more memory, with calls of one length."""
    peaks = []
    options = {**RUN, "realizations": 16, "record": il.Trajectory(5e-3)}
    with tuned(call_seconds=5e-4, chunk_bytes=100_000):
        il.simulate(base(), 0.1, out=path, **options).close()
        for duration in (4.0, 40.0):
            tracemalloc.start()
            il.simulate(base(), duration, out=path, **options).close()
            peaks.append(tracemalloc.get_traced_memory()[1])
            tracemalloc.stop()
    assert peaks[1] - peaks[0] < 500_000


def test_what_does_not_fit_on_the_disk_is_refused_with_its_size(path, monkeypatch):
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(trajectory_file.shutil, "disk_usage", lambda folder: usage(0, 0, 1_000_000))
    monkeypatch.setattr("impactlab.simulation.growing_ensemble.run", lambda *_: pytest.fail("was run"))
    with pytest.raises(
        il.InvalidInput, match=r"would take up to 0\.02 GB, but only 0\.001 GB are free in .*longer interval"
    ):
        il.simulate(base(), 500.0, record=il.Trajectory(5e-3), out=path, **RUN)
    assert os.listdir(path.parent) == []


def test_what_does_not_fit_into_memory_is_refused_with_its_size(path, monkeypatch):
    monkeypatch.setattr(memory, "available", lambda: 1e6)
    with pytest.raises(il.InvalidInput, match=r"would take 0\.02 GB of memory, but 0\.001 GB are available.*with out="):
        il.simulate(base(), 500.0, record=il.Trajectory(5e-3), **RUN)
    il.simulate(base(), 50.0, record=il.Trajectory(5e-3), out=path, **RUN).close()


@pytest.mark.full
def test_a_network_that_does_not_fit_into_memory_says_what_it_needs(monkeypatch):
    monkeypatch.setattr(memory, "available", lambda: 1e6)
    monkeypatch.setattr("impactlab.simulation.growing_ensemble.run", lambda *_: pytest.fail("was run"))
    body, noise = il.LinearOscillator(damping=1.0, stiffness=9.0), il.WhiteNoise(1.0)
    network = il.chain(100, body, il.HertzContact(1e4), excitation=noise)
    needs = r"640 realizations of 100 bodies and 99 contacts would take 0\.\d+ GB of memory \([.\de+]+ bytes per body"
    with pytest.raises(il.InvalidInput, match=rf"{needs} and realization\), but 0\.001 GB are available: use fewer"):
        il.simulate(network, 1.0, realizations=640, step=0.01, rng=1)


def test_a_full_disk_leaves_nothing(path):
    """Files of this process may not grow beyond 30 kB for a moment; those of this run would take 120 kB."""
    resource = pytest.importorskip("resource", reason="this system limits no sizes of files")
    options = {**RUN, "record": il.Trajectory(0.01), "out": path}
    with tuned(chunk_bytes=1000):
        il.simulate(base(), 0.1, **options).close()  # the compiler writes files, too
        path.unlink()
        usual = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (30_000, usual[1]))
        try:
            with pytest.raises(il.ImpactLabError, match=r"of which nothing is left, cannot be written: .*NetCDF: "):
                il.simulate(base(), 1.0, **options)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, usual)
    assert os.listdir(path.parent) == []


def test_ctrl_c_in_the_middle_leaves_nothing(path):
    seen = []

    def interrupt(part):
        if part > 0.3 and not seen:
            seen.extend(path.parent.iterdir())
            signal.raise_signal(signal.SIGINT)  # the main thread is interrupted

    with tuned(chunk_bytes=1000, call_seconds=1e-4), pytest.raises(KeyboardInterrupt):
        il.simulate(base(), 100.0, record=il.Trajectory(0.01), out=path, progress=interrupt, **RUN)
    assert len(seen) == 1  # what was written until then
    assert os.listdir(path.parent) == []


@pytest.mark.parametrize(
    ("out", "message"),
    [("nowhere/run.nc", "Cannot write .*folder that exists"), ("", "out must be"), (3, "out must be")],
)
def test_places_that_cannot_be_written_to_are_refused_before_the_run(out, message, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("impactlab.simulation.growing_ensemble.run", lambda *_: pytest.fail("was run"))
    with pytest.raises(il.InvalidInput, match=message):
        il.simulate(base(), 0.3, record=il.Trajectory(0.1), out=out, **RUN)


def test_a_folder_is_refused(tmp_path):
    with pytest.raises(il.InvalidInput, match="is a folder"):
        il.simulate(linear(), 0.3, out=tmp_path, **RUN)


def test_what_cannot_be_streamed_is_refused(path):
    with pytest.raises(il.InvalidInput, match=r"out= until a tolerance is reached"):
        il.simulate(base(), tolerance={"mean_contact_force": 0.1}, out=path)
    with ProcessPoolExecutor(1) as pool, pytest.raises(il.InvalidInput, match="from threads only"):
        il.simulate(base(), 0.3, record=il.Trajectory(0.1), out=path, executor=pool, **RUN)
    assert os.listdir(path.parent) == []


@pytest.mark.full
@pytest.mark.parametrize(
    ("bodies", "realizations", "duration"), [(300, 1, 3.0), (40, 64, 3.0), (10, 4, 700.0), (300, 16, 30.0)]
)
def test_the_memory_of_a_run_is_foreseen(bodies, realizations, duration):
    """What is said is enough, and not four times too much."""
    body = il.LinearOscillator.from_frequency(2.0 * np.pi, 0.5)
    network = il.chain(bodies, body, il.HertzContact(1e4), clearance=0.1, excitation=il.WhiteNoise(1.0))
    plan = plan_of(
        network, duration=duration, realizations=realizations, integrator=il.ExactFlow(jumps=False), spin_up=0.0
    )
    estimate(plan, *merged(run(plan, None, lambda part: None)))  # loads what it needs
    tracemalloc.start()
    estimate(plan, *merged(run(plan, None, lambda part: None)))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak - 300_000 < memory.needed(plan, 2) < 4 * peak


def test_statistics_take_the_memory_of_a_short_run_however_long_it_is():
    """A plan for 10⁹ steps is no larger than one for 10⁴, and neither are its batches and sums."""
    sizes = []
    for duration in (60.0, 6e6):
        records = [il.Density(limits=(-1.0, 1.0))]
        plan = plan_of(base(), duration=duration, realizations=64, step=6e-3, records=records)
        sizes.append((len(pickle.dumps(plan)), len(plan.clock.boundaries), memory.needed(plan, 2)))
    assert plan.clock.steps >= 10**9
    assert sizes[1][1:] == sizes[0][1:]
    assert abs(sizes[1][0] - sizes[0][0]) < 100  # numbers with more digits
