"""Runs that are stopped or killed, and go on in the folder of a checkpoint with the bits of a whole run."""

import os
import random
import signal
import subprocess
import sys
import time

import bits
import numpy as np
import pytest
from scenes import base

import impactlab as il
from impactlab.machine import tuned
from impactlab.results.dataset import load
from impactlab.simulation.block_state import BlockStates

pytestmark = pytest.mark.filterwarnings("ignore::impactlab.errors.AccuracyWarning")

SHORT = {"duration": 1.0, "realizations": 20, "rng": 1, "spin_up": 0.1}


def stopped(monkeypatch, after, run):
    """Run something, keep a state after every call of the compiled loop, and stop after so many."""
    states = []
    note = BlockStates.note

    def stopping(self, block, course=None):
        self.next = 0.0
        note(self, block, course)
        states.append(course)
        if len(states) == after:
            raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(BlockStates, "note", stopping)
        with pytest.raises(KeyboardInterrupt):
            run()


def resumed(monkeypatch, run):
    """Run something; return its result, and the steps of blocks that went on from a state."""
    steps, restore = [], BlockStates.restore

    def noting(self, block, course=None):
        found = restore(self, block, course)
        steps.extend([block.now] * found)
        return found

    with monkeypatch.context() as patched:
        patched.setattr(BlockStates, "restore", noting)
        return run(), steps


def test_blocks_go_on_from_their_states(tmp_path, monkeypatch):
    expected = il.simulate(base(), **SHORT)

    def run():
        return il.simulate(base(), **SHORT, checkpoint=tmp_path)

    with tuned(call_seconds=1e-4):
        for after in (1, 2):
            stopped(monkeypatch, after, run)
        found, steps = resumed(monkeypatch, run)
    assert steps
    assert bits.digest(found) == bits.digest(expected)
    assert sorted(os.listdir(tmp_path)) == ["asked.json", "items"]
    assert all(name.endswith(".item") for name in os.listdir(tmp_path / "items"))
    assert bits.digest(run()) == bits.digest(expected)


def test_without_rng_later_calls_have_the_seed_of_the_first(tmp_path):
    one, two = (il.simulate(base(), **SHORT | {"rng": None}, checkpoint=tmp_path) for _ in range(2))
    assert bits.digest(one) == bits.digest(two)
    with pytest.raises(il.InvalidInput, match=r"rng was null and is \["):
        il.simulate(base(), **SHORT, checkpoint=tmp_path)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"tolerance": {"contact_ratio": 0.1}}, "checkpoint: how a tolerance is reached depends on the time"),
        ({"duration": 1.0, "record": il.Trajectory(0.1), "out": "x.nc"}, "checkpoint: trajectories that are written"),
    ],
)
def test_what_is_not_kept(tmp_path, options, message):
    with pytest.raises(il.InvalidInput, match=message):
        il.simulate(base(), **options, checkpoint=tmp_path / "a")
    assert not (tmp_path / "a").exists()


RECORDS = [
    il.Correlation(lags=[0.0, 0.1]), il.Cycles(), il.Density(bins=20), il.EnergyFlows(),
    il.Extremes(windows=(1.0,)), il.Impacts(), il.JointDensity("one", "two", bins=9),
    il.PeakForces(), il.Section(il.AtContact("gap", "closing")), il.Spectrum(), il.Trajectory(0.01), il.Wear(),
    il.PhaseMeans(period=0.2), il.PhaseDensity(period=0.2),
]  # fmt: skip


@pytest.mark.campaign
@pytest.mark.parametrize("record", RECORDS, ids=lambda item: type(item).__name__)
@pytest.mark.parametrize("realizations", [1, 20])
def test_records_go_on(tmp_path, monkeypatch, record, realizations):
    options = SHORT | {"duration": 4.0, "realizations": realizations, "record": record}
    going_on(tmp_path, monkeypatch, lambda **kept: il.simulate(base(), **options, **kept))


def scene(monkeypatch, name):
    """A function that runs a scene with further options of `simulate`."""
    simulate = il.simulate
    monkeypatch.setitem(bits.ALL, "spin_up", 0.1)

    def run(**kept):
        with monkeypatch.context() as patched:
            patched.setattr(il, "simulate", lambda *given, **options: simulate(*given, **options, **kept))
            return bits.SCENES[name]()

    return run


@pytest.mark.campaign
@pytest.mark.parametrize("name", [name for name in bits.SCENES if name not in ("tolerance", "sweep")])
def test_mechanisms_and_modes_go_on(tmp_path, monkeypatch, name):
    going_on(tmp_path, monkeypatch, scene(monkeypatch, name))


@pytest.fixture(scope="module")
def apart():
    with il.Processes(2) as processes:
        yield processes


@pytest.mark.campaign
@pytest.mark.parametrize("name", [name for name in bits.SCENES if name not in ("tolerance", "sweep")])
def test_mechanisms_go_on_in_other_processes(tmp_path, monkeypatch, apart, name):
    """A run that was stopped in threads goes on in processes."""
    run = scene(monkeypatch, name)
    with tuned(call_seconds=1e-5):
        expected = bits.digest(run())
        try:
            stopped(monkeypatch, 4, lambda: run(checkpoint=tmp_path))
        except pytest.fail.Exception:  # it has fewer calls
            return
        assert bits.digest(run(checkpoint=tmp_path, executor=apart)) == expected


def going_on(tmp_path, monkeypatch, run):
    """Stop a run in its spin-up and in its measurement, and compare it with a whole one."""
    with tuned(call_seconds=1e-5):
        expected = bits.digest(run())
        for place, after in enumerate((1, 9, 40)):
            folder = tmp_path / str(place)
            try:
                stopped(monkeypatch, after, lambda folder=folder: run(checkpoint=folder))
            except pytest.fail.Exception:  # it has fewer calls
                continue
            found, steps = resumed(monkeypatch, lambda folder=folder: run(checkpoint=folder))
            assert steps
            assert bits.digest(found) == expected


# kills

SCRIPT = """
import sys
import warnings
sys.path.insert(0, {tests!r})
from long_questions import answer
from scenes import base
import impactlab as il
from impactlab.simulation import block_state

def make(clearance):
    return base(clearance=clearance)

if __name__ == "__main__":
    warnings.simplefilter("ignore")
    block_state.BETWEEN_STATES = 0.05
    question, folder, out = sys.argv[1:]
    kept = {{}} if folder == "-" else {{"checkpoint": folder}}
    il.save(answer(question, make, 60, 200, **kept), out)
    print("done", flush=True)
"""


def numbers(path):
    found = load(path)
    return {name: np.asarray(item).tobytes() for name, item in found.variables.items() if item.dtype.kind in "fiu"}


def survives(tmp_path, question, kills, seed=1):
    """Kill a run at random times until it has been killed so often, let it end, and compare it with a whole run."""
    script = tmp_path / "script.py"
    script.write_text(SCRIPT.format(tests=os.path.dirname(bits.__file__)))
    command = [sys.executable, str(script), question]
    subprocess.run([*command, "-", str(tmp_path / "warm.nc")], check=True)  # compiles
    begin = time.monotonic()
    subprocess.run([*command, "-", str(tmp_path / "whole.nc")], check=True)
    usual, drawn, killed = time.monotonic() - begin, random.Random(seed), 0
    for _ in range(10 * kills):
        process = subprocess.Popen([*command, str(tmp_path / "kept"), str(tmp_path / "found.nc")])
        try:
            process.wait(drawn.uniform(0.2, 1.0) * usual)
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
            process.wait()
            killed += killed < kills
        if killed == kills:
            break
    subprocess.run([*command, str(tmp_path / "kept"), str(tmp_path / "found.nc")], check=True)
    assert killed > 0
    assert numbers(tmp_path / "found.nc") == numbers(tmp_path / "whole.nc")
    left = [path.name for path in (tmp_path / "kept").rglob("*") if path.is_file() and path.suffix != ".item"]
    assert left == ["asked.json"]
    return killed


@pytest.mark.full
def test_a_killed_run_goes_on(tmp_path):
    assert survives(tmp_path, "simulate", 2) == 2


@pytest.mark.campaign
@pytest.mark.parametrize("question", ["simulate", "one", "sweep", "basins"])
def test_kills_of_all_questions(tmp_path, question):
    survives(tmp_path, question, 2, seed=len(question))
