"""What the tests of studies share."""

import pytest

import impactlab as il


@pytest.fixture(scope="module")
def run(request):
    """The quick form of the study that a module names as `STUDY`, run as a person does it."""
    return il.run_study(request.module.STUDY, quick=True, progress=False)
