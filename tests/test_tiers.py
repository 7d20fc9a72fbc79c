"""The tiers of tests: each test is in one of them, and `.ci/run` runs all."""

from itertools import product
from pathlib import Path

from tiers import FILES, FULL, SHORT

ROOT = Path(__file__).parent.parent


def test_each_test_is_in_one_tier():
    for full, campaign in product([False, True], repeat=2):
        short, whole, long, named = (
            eval(tier, {"full": full, "campaign": campaign}) for tier in (SHORT, FULL, "campaign", FILES)
        )
        assert short + whole + long == 1
        assert named == short + whole


def test_ci_runs_the_other_tiers_too():
    """Besides the short one, which `tests/test_docs.py` finds in it."""
    text = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    assert "for tier in full campaign; do" in text
    assert 'pytest -n auto --dist loadfile -m "$tier"' in text
