"""The constants of step control: one name, one meaning, one reason, and a page that lists them."""

from collections import Counter
from pathlib import Path

import pytest

import impactlab

FOLDER = Path(impactlab.__file__).parent / "step_control"
MODULES = [
    ".".join(file.relative_to(FOLDER.parent).with_suffix("").parts) for file in sorted(FOLDER.glob("*/[!_]*.py"))
]


@pytest.fixture(scope="module")
def constants(lists):
    return [*(item for module in MODULES for item in lists.constants_of(module)), *lists.shared_constants()]


def test_the_page_lists_them(lists, constants):
    page = lists.CONSTANTS.read_text(encoding="utf-8")
    assert page == lists.step_constants(), "run docs/names.py"
    assert page.count("\n| `") == len(constants) > 50


def test_no_name_has_two_meanings(constants):
    assert [name for name, count in Counter(item.name for item in constants).items() if count > 1] == []


def test_each_has_a_reason_of_its_own(constants):
    assert [item.name for item in constants if not item.reason] == []
    assert [reason for reason, count in Counter(item.reason for item in constants).items() if count > 1] == []


def test_a_unit_ends_the_reason(lists):
    """Without brackets at the end a number is a part, a factor or a count."""
    one = lists.Constant("", "SECONDS", "2.0", "Time (s) of a run, at most (s).")
    assert one.unit == "s"
    assert one._replace(reason="Part of a run.").unit == "1"
