"""What the tests of studies share."""

import pytest

import impactlab as il


@pytest.fixture(scope="module")
def run(request):
    """The quick form of the study that a module names as `STUDY`, run as a person does it."""
    return il.run_study(request.module.STUDY, quick=True, progress=False)


@pytest.fixture(scope="session")
def explained():
    """Check that figures have captions, that claims name figures that there are, and that their sections are known."""

    def check(study, figures, claims):
        named = {str(name) for name in claims["figure"].values} - {""}
        assert named
        assert named <= set(figures)
        assert set(map(str, claims["section"].values)) <= set(study.sections)
        for name in figures:
            assert study.caption(name) != name.replace("_", " ")

    return check
