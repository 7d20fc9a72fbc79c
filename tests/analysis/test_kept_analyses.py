"""Basins, diagrams and fragilities that are stopped, and go on in the folder of a checkpoint with the same bits."""

import numpy as np
import pytest

import impactlab as il
from impactlab.analysis import basins, bifurcation
from impactlab.results import checkpoint

pytestmark = pytest.mark.full


def stopper(amplitude=1.0):
    return il.Network(
        {"a": il.LinearOscillator(stiffness=1.0, damping=0.1)},
        {"s": il.Contact("a", il.WALL, il.RigidContact(0.8), clearance=1.0)},
        {"a": il.Harmonic(amplitude, frequency=2.8)},
    )


def under(record):
    body = il.LinearOscillator(stiffness=40.0, damping=0.6)
    stop = il.Contact("a", il.WALL, il.LinearContact(1e3), clearance=0.02)
    return il.Network({"a": body}, {"s": stop}, {"g": il.BaseMotion(record)})


def basins_of(**kept):
    points = np.linspace(-1.0, 1.0, 24)
    over = "displacement:a", "velocity:a"
    return il.basins(stopper(), over, {"x": points, "v": points}, transient=100, **kept)


def diagram(**kept):
    return il.bifurcation(stopper, {"amplitude": np.linspace(0.6, 1.4, 21)}, starts=2, rng=1, keep=20, **kept)


def fragility(**kept):
    draws = np.random.default_rng(1)
    records = [il.SampledForce(np.linspace(0.0, 3.0, 301), draws.normal(size=301)) for _ in range(5)]
    return il.fragility(under, records, [0.5, 1.0, 2.0], {"a": 0.02}, **kept)


def separation(**kept):
    motion = il.KanaiTajimi(0.01, 15.0, 0.6)
    return il.required_separation(under, motion, [1.0, 2.0], "s", duration=2.0, realizations=30, **kept)


def numbers(found):
    return {name: item.values.tobytes() for name, item in found.variables.items() if item.dtype.kind in "fiub"}


@pytest.mark.parametrize("question", [basins_of, diagram, fragility])
def test_they_go_on(tmp_path, monkeypatch, question):
    monkeypatch.setattr(basins, "AT_A_TIME", 200)
    monkeypatch.setattr(bifurcation, "LANES_OF_ITEM", 8)
    expected, save = numbers(question()), checkpoint.KeptItem.save

    def stopping(self, value):
        save(self, value)
        if len(list(tmp_path.rglob("*.item"))) == 2:
            raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(checkpoint.KeptItem, "save", stopping)
        with pytest.raises(KeyboardInterrupt):
            question(checkpoint=tmp_path)
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.item")}
    assert len(before) == 2
    assert numbers(question(checkpoint=tmp_path)) == expected
    assert all(path.stat().st_mtime_ns == time for path, time in before.items())  # they were not made again
    assert numbers(question(checkpoint=tmp_path)) == expected
    with pytest.raises(il.InvalidInput, match="keeps what another call has found: question was"):
        il.simulate(stopper(), 1.0, checkpoint=tmp_path)


def test_without_rng_the_seed_is_that_of_the_first_call(tmp_path):
    assert numbers(separation(checkpoint=tmp_path)) == numbers(separation(checkpoint=tmp_path))
