"""A cache with damaged files: they are made anew, once, and numbers stay what they were."""

import json
import shutil
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from impactlab.compiling.jit import cache_folder

SCENE = """
import json, sys
opened = set()
sys.addaudithook(lambda event, given: opened.add(str(given[0])) if event == "open" else None)
import impactlab as il
from impactlab.compiling.jit import compilations
body = il.LinearOscillator(damping=0.4, stiffness=4.0)
network = il.chain(2, body, il.HertzContact(1e3), clearance=0.1, excitation=il.WhiteNoise(1.0))
result = il.simulate(network, 2.0, realizations=64, step=0.02, spin_up=0.0, rng=1)
print(json.dumps([result.mean_square_displacement.values.tolist(), compilations(), sorted(opened)]))
"""

TRIES = 5
"""Damaged caches; each takes a process that compiles what was damaged, and one that finds it."""


def damaged(content, generator):
    """Return how some content was damaged, and what became of it."""
    place = int(generator.integers(len(content)))
    changed = bytes([content[place] ^ (1 << int(generator.integers(8)))])
    ways = {
        "flip": content[:place] + changed + content[place + 1 :], "cut": content[:place], "empty": b"",
        "overwritten": b"\xff\xfe\x00" * 7 + content[21:],
    }  # fmt: skip
    way = list(ways)[int(generator.integers(len(ways)))]
    return way, ways[way]


@pytest.mark.campaign
def test_a_damaged_cache_heals(run_python, tmp_path):
    json.loads(run_python("-c", SCENE))  # all is compiled
    good, compiled, opened = json.loads(run_python("-c", SCENE))
    assert compiled == 0
    own = cache_folder()
    used = sorted({Path(name) for name in opened if own in Path(name).parents})
    used = [file for file in used if file.suffix in (".nbi", ".nbc", ".py") and file.is_file()]
    assert {file.suffix for file in used} == {".nbi", ".nbc", ".py"}
    found, generator = Counter(), np.random.default_rng(1)
    for number in range(TRIES):
        cache = tmp_path / str(number)
        for file in used:
            copy = cache / own.name / file.relative_to(own)
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(file, copy)
        (cache / own.name).chmod(0o700)
        file = used[int(generator.integers(len(used)))]
        copy = cache / own.name / file.relative_to(own)
        way, content = damaged(file.read_bytes(), generator)
        copy.write_bytes(content)
        numbers, first, _ = json.loads(run_python("-c", SCENE, IMPACTLAB_CACHE=str(cache)))
        again, second, _ = json.loads(run_python("-c", SCENE, IMPACTLAB_CACHE=str(cache)))
        assert numbers == again == good
        assert second == 0
        assert (first > 0) == (file.suffix != ".py")
        found[file.suffix, way] += 1
        shutil.rmtree(cache)
    print(f"{TRIES} damaged caches, all healed: {dict(found)}")
