"""Folders of checkpoints: what they refuse, who may work in them, and digests of descriptions."""

import os
import subprocess
import sys

import numpy as np
import pytest

import impactlab as il
from impactlab.results.checkpoint import checkpoint_in, made
from impactlab.results.plain_values import digest, plain_data

ASKED = {"question": "simulate", "duration": 1.0, "record": [{"bins": 200}], "nan": float("nan")}


def opened(path, **changes):
    return checkpoint_in(path, {**ASKED, **changes}, lambda: {"seed": [1, 2]})


def test_a_folder_goes_on_with_the_same_call_only(tmp_path):
    with opened(tmp_path / "a" / "b") as kept:
        kept.item("one").save([1.0])
    with opened(tmp_path / "a" / "b") as kept:
        assert kept.item("one").load() == [1.0]
        assert kept.chosen == {"seed": [1, 2]}
    message = r"keeps what another call has found: duration was 1.0 and is 2.0; record was .*200.* and is .*100"
    with (
        pytest.raises(il.InvalidInput, match=message),
        opened(tmp_path / "a" / "b", duration=2.0, record=[{"bins": 100}]),
    ):
        pass
    assert sorted(path.name for path in (tmp_path / "a" / "b").iterdir()) == ["asked.json", "items"]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda path: path.write_text("x"), "is a file; give the name of a folder"),
        (lambda path: (path.mkdir(), (path / "thesis.tex").touch()), "holds 'thesis.tex', so"),
        (lambda path: (path / "items").mkdir(parents=True), "has items, but no asked.json"),
        (lambda path: (path.mkdir(), (path / "asked.json").write_text("[" * 9999)), "asked.json cannot be read"),
    ],
)  # fmt: skip
def test_other_folders_are_refused(tmp_path, make, message):
    make(tmp_path / "folder")
    with pytest.raises(il.InvalidInput, match=message), opened(tmp_path / "folder"):
        pass


@pytest.mark.parametrize("path", ["", 3])
def test_what_is_no_path(path):
    with pytest.raises(il.InvalidInput, match="checkpoint is the path of a folder"), opened(path):
        pass


def test_one_run_at_a_time(tmp_path):
    """In another thread, and, by the system, in another process, whose lock ends with it however it ends."""
    with opened(tmp_path / "a"):
        with pytest.raises(il.InvalidInput, match="is in use by another run"), opened(tmp_path / "a"):
            pass
        assert (tmp_path / "a" / ".lock").exists()
    script = f"""if True:
        import os, sys
        from impactlab.results.checkpoint import locked
        from pathlib import Path
        with locked(Path({str(tmp_path / "a")!r})):
            print("locked", flush=True)
            sys.stdin.read()
    """
    with subprocess.Popen([sys.executable, "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        assert other.stdout.readline() == b"locked\n"
        with pytest.raises(il.InvalidInput, match="is in use by another run"), opened(tmp_path / "a"):
            pass
        other.kill()
        other.wait()
    (tmp_path / "a" / "items" / ".x.item.1.tmp").touch()  # of a process that was killed while it wrote
    with opened(tmp_path / "a"):
        pass
    assert sorted(os.listdir(tmp_path / "a")) == ["asked.json", "items"]
    assert not os.listdir(tmp_path / "a" / "items")


def test_a_damaged_item_is_made_again(tmp_path):
    with opened(tmp_path) as kept:
        item, calls = kept.item("one"), []
        for _ in range(2):
            assert made(item, lambda number: (calls.append(number), number)[1], 3) == 3
        assert calls == [3]
        content = bytearray(item.path.read_bytes())
        content[-1] ^= 1
        item.path.write_bytes(content)
        assert made(item, lambda number: number, 4) == 4


@pytest.mark.full
def test_digests_tell_content_apart():
    values = [1, 1.0, "1", None, True, [1], [[1]], {"a": 1}, {"a": 2}, np.ones(2), np.ones(3), np.ones(2, int), il.WALL]
    values += [{1, 2}, {1, 3}, il.HertzContact(1.0), il.HertzContact(2.0), il.LinearContact(2.0), digest, made]
    digests = [digest(value) for value in values]
    assert len(set(digests)) == len(values)
    script = "import impactlab as il; from impactlab.results.plain_values import digest; print(digest({'b', 'a', 'c'}))"
    found = {subprocess.check_output([sys.executable, "-c", script], env={**os.environ, "PYTHONHASHSEED": seed})
             for seed in "12"}  # fmt: skip
    assert len(found) == 1


def test_what_is_no_plain_data():
    assert plain_data({"a": (np.float64(1.0), np.arange(2))}) == {"a": [1.0, [0, 1]]}
    with pytest.raises(il.InvalidInput, match="Only plain data can be kept"):
        plain_data([object()])
