"""Every bug that is planted into the code must show in a statistic, and the right code in none.

``python -m pytest tests/test_planted_bugs.py -m campaign -rP`` prints the statistic that caught each bug, and its
distance in standard errors.
"""

import math
import warnings

import pytest
from planted import (
    compound,
    compound_scenes,
    dynamics,
    estimates,
    forms,
    friction,
    passages,
    powers,
    questions,
    scenes,
    wider,
    wider_scenes,
)
from planted.plant import forget

import impactlab as il

RIGHT, CAUGHT = 5.0, 6.0
"""Standard errors that the right code may be off, and a bug must be."""

BUGS = [
    *dynamics.BUGS, *estimates.BUGS, *wider.BUGS, *compound.BUGS, *friction.BUGS, *forms.BUGS, *passages.BUGS,
    *powers.BUGS, *questions.BUGS,
]  # fmt: skip
SCENES = [
    *scenes.SCENES,
    *wider_scenes.SCENES,
    *compound_scenes.SCENES,
    *friction.SCENES,
    *forms.SCENES,
    *passages.SCENES,
    *powers.SCENES,
    *questions.SCENES,
]

pytestmark = pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")


@pytest.fixture
def plant():
    """Put a bug into the code as long as a test lasts; nothing that either code has worked out is remembered."""
    with pytest.MonkeyPatch.context() as monkeypatch:

        def put(bug):
            forget()
            bug.plant(monkeypatch)

        yield put
    forget()


@pytest.fixture(scope="module")
def right():
    """Evidence of the right code, by scene, made when it is first wanted."""
    found = {}

    def of(scene):
        if scene.name not in found:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", il.AccuracyWarning)
                found[scene.name] = scene.evidence()
        return found[scene.name]

    return of


def largest(distances):
    """Name and distance of the detector that is off most; a number that is missing is infinitely far off."""
    assert distances
    known = {name: z if z < 1e12 else math.inf for name, z in distances.items()}
    return max(known.items(), key=lambda item: item[1])


@pytest.mark.campaign
@pytest.mark.parametrize("scene", SCENES, ids=lambda scene: scene.name)
def test_the_right_code_is_found_right(scene, right):
    name, distance = largest(scene.distances(right(scene), scene.law()))
    assert distance < RIGHT, name


@pytest.mark.campaign
@pytest.mark.parametrize("bug", BUGS, ids=lambda bug: bug.name)
def test_every_planted_bug_is_caught(bug, right, plant):
    scene, law = bug.scene, bug.scene.law()
    found = right(scene) if bug.in_reference else None
    plant(bug)
    try:
        if bug.in_reference:
            law = type(scene).law.__wrapped__(scene)
        else:
            found = scene.evidence()
    except il.ImpactLabError as error:
        print(f"{bug.name} | {scene.name} | refused: {str(error).splitlines()[0]}")
        return
    name, distance = largest(scene.distances(found, law))
    print(f"{bug.name} | {scene.name} | {name} | {distance:.3g}")
    assert distance > CAUGHT, name


def test_every_scene_has_a_bug_to_catch_and_no_bug_is_there_twice():
    names = [bug.name for bug in BUGS]
    assert len(set(names)) == len(names) >= 30
    assert {bug.scene.name for bug in BUGS} == {scene.name for scene in SCENES}


@pytest.mark.parametrize("bug", BUGS, ids=lambda bug: bug.name)
def test_what_a_bug_replaces_is_there(bug, monkeypatch):
    bug.plant(monkeypatch)
