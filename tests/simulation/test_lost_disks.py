"""Disks that are full, or taken away, wherever a run writes what it keeps: refused in words, and to be gone on with."""

import errno
import os
import pathlib

import bits
import pytest
from scenes import base

import impactlab as il
from impactlab.machine import tuned
from impactlab.simulation import block_state

pytestmark = [pytest.mark.full, pytest.mark.filterwarnings("ignore::impactlab.errors.AccuracyWarning")]

SHORT = {"duration": 1.0, "realizations": 20, "rng": 1, "spin_up": 0.1}

WRITES = {"write": (pathlib.Path, "write_bytes"), "flush": (os, "fsync"), "rename": (os, "replace")}
"""Places where a disk may fail."""


class Failing:
    """Fails at one of its calls."""

    def __init__(self, usual, at):
        self.usual, self.at, self.calls = usual, at, 0

    def __get__(self, owner, kind):
        return lambda *given: self(owner, *given)

    def __call__(self, *given):
        self.calls += 1
        if self.calls == self.at:
            raise OSError(errno.ENOSPC, "No space left on device")
        return self.usual(*given)


@pytest.fixture(autouse=True)
def often(monkeypatch):
    """Keep states after every call of the compiled loop."""
    monkeypatch.setattr(block_state, "BETWEEN_STATES", 0.0)
    monkeypatch.setattr(block_state, "SHARE", 1e9)
    with tuned(call_seconds=1e-4):
        yield


@pytest.mark.parametrize("kind", WRITES)
def test_a_disk_that_is_full_at_any_write(tmp_path, monkeypatch, kind):
    expected, refused = bits.digest(il.simulate(base(), **SHORT)), 0
    for at in (1, 2, 3, 5, 8, 13, 21):
        folder = tmp_path / str(at)
        with monkeypatch.context() as patched:
            owner, name = WRITES[kind]
            failing = Failing(getattr(owner, name), at)
            patched.setattr(owner, name, failing)
            words = ""
            try:
                il.simulate(base(), **SHORT, checkpoint=folder)
            except il.ImpactLabError as error:
                words = str(error)
        assert "cannot be written" in words or failing.calls < at
        refused += bool(words)
        assert bits.digest(il.simulate(base(), **SHORT, checkpoint=folder)) == expected
        assert {path.suffix for path in folder.rglob("*") if path.is_file()} == {".item", ".json"}
    assert refused > 2


def test_a_folder_that_is_taken_away(tmp_path, monkeypatch):
    expected, note, calls = bits.digest(il.simulate(base(), **SHORT)), block_state.BlockStates.note, 0

    def taking(self, block, course=None):
        nonlocal calls
        calls += 1
        if calls == 3:
            (tmp_path / "kept").rename(tmp_path / "away")
        note(self, block, course)

    with monkeypatch.context() as patched:
        patched.setattr(block_state.BlockStates, "note", taking)
        with pytest.raises(il.ImpactLabError, match="kept"):
            il.simulate(base(), **SHORT, checkpoint=tmp_path / "kept")
    assert bits.digest(il.simulate(base(), **SHORT, checkpoint=tmp_path / "kept")) == expected
