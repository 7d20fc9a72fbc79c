"""The bits of runs at default settings, as they were recorded: a change that means to keep all numbers keeps them."""

import json

import pytest
from bits import GOLDEN, SCENES, digest, run, surroundings

RECORDED = json.loads(GOLDEN.read_text(encoding="utf-8"))


def test_all_scenes_are_recorded():
    assert RECORDED.keys() == SCENES.keys() | {"surroundings"}
    assert len(SCENES) >= 40


@pytest.mark.campaign
@pytest.mark.skipif(RECORDED["surroundings"] != surroundings(), reason="recorded with other libraries or processors")
@pytest.mark.parametrize("name", SCENES)
def test_bits(name):
    """See `bits` for how to record them anew, and how to find the variables that differ."""
    assert digest(run(name)) == RECORDED[name]
