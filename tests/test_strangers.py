"""Files of every kind, damaged and hostile, through all that reads them: read, or refused in words."""

from collections import Counter

import pytest

from tests.strangers.damage import damaged, kinds
from tests.strangers.hostile import hostile
from tests.strangers.tampered import READERS, tampered

FLIPS, CUTS = 300, 45
"""Of each kind of file, of which there are seven; code in the cache has a test of its own, `tests/compiling`."""


def told(title, found, missed):
    print(title, ", ".join(f"{' '.join(key)} {number}" for key, number in sorted(found.items())))
    for line in missed:
        print("   ", line)


@pytest.mark.full
def test_damage_is_noticed_or_harmless(tmp_path):
    for number, (name, path, read) in enumerate(kinds(tmp_path)):
        found, missed = damaged(path, read, 6, 2, number)
        assert not missed, name
        assert found.total() == 8


@pytest.mark.campaign
def test_all_damage_is_noticed_or_harmless(tmp_path):
    whole, every = Counter(), []
    for number, (name, path, read) in enumerate(kinds(tmp_path)):
        found, missed = damaged(path, read, FLIPS, CUTS, 100 + number)
        told(f"{name}, {path.stat().st_size} bytes:", found, missed)
        whole, every = whole + found, every + missed
    told("all:", whole, [])
    assert not every


@pytest.mark.full
def test_hostile_files_are_read_or_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    number, found, missed = hostile(tmp_path)
    print(f"{number} hostile files and places: {dict(found)}")
    assert not missed
    assert not list(tmp_path.glob("PWNED*"))


@pytest.mark.full
def test_some_tampered_results_are_read_or_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    _, found, missed = tampered(tmp_path, ["only basins None", "clearance None", "deep list", "label 'b'"])
    assert not missed
    assert found.total() == 2 * len(READERS) + 2 * 5


@pytest.mark.campaign
def test_tampered_results_are_read_or_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    number, found, missed = tampered(tmp_path)
    print(f"{number} tampered results, {len(READERS)} readers: {dict(found)}")
    for line in missed:
        print("   ", line)
    assert not missed
    assert not list(tmp_path.glob("PWNED*"))
