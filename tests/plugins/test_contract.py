"""What every study keeps to: its file has its defaults, it is light to describe, and its parts lie in its folder."""

import importlib.util
import inspect
import tomllib
from pathlib import Path

import pytest
from impactlab_numerics import (
    AccuracyStudy,
    ConservationStudy,
    CoverageStudy,
    ScalingStudy,
    StabilityStudy,
    TrustStudy,
    WorkPrecisionStudy,
)
from impactlab_two_system import TwoSystemStudy

from impactlab.studies import FolderStudy
from impactlab.studies.discovery import plugins

ROOT = Path(__file__).parents[2]

DESCRIBED = {
    AccuracyStudy: "()",
    ConservationStudy: "()",
    CoverageStudy: "()",
    ScalingStudy: "().apart(3.0)",
    StabilityStudy: "().quick()",
    TrustStudy: "()",
    TwoSystemStudy: "().network(16, 0.05)",
    WorkPrecisionStudy: "().scenes()",
}
"""The studies, and how one is made, or described, for which nothing heavy may be imported."""

each_study = pytest.mark.parametrize("study", DESCRIBED, ids=lambda study: study.name)


def test_these_are_the_studies_that_are_installed():
    found = {
        plugin.study for plugin in plugins() if plugin.distribution.startswith(("impactlab ", "impactlab-numerics "))
    }
    assert found == set(DESCRIBED)


@each_study
def test_the_file_has_every_default(study):
    name = study.name.replace("-", "_")
    settings = tomllib.loads((ROOT / "studies" / f"{name}.toml").read_text(encoding="utf-8"))
    assert settings.pop("study") == study.name
    assert set(settings) == set(study.field_names())
    assert study(**settings) == study()


@pytest.mark.full
@each_study
def test_the_study_is_described_without_heavy_imports(study, run_python):
    package = study.__module__.partition(".")[0]
    code = (
        f"import sys; from {package} import {study.__name__}; {study.__name__}{DESCRIBED[study]}\n"
        "print([name for name in ('numba', 'xarray', 'matplotlib', 'scipy') if name in sys.modules])"
    )
    assert run_python("-c", code).strip() == "[]"


@each_study
@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("collect", ["study", "results"]),
        ("claims", ["study", "tree"]),
        ("checks", ["study", "tree"]),
        ("tables", ["study", "tree"]),
        ("figures", ["study", "tree"]),
    ],
)
def test_the_parts_of_a_study_are_in_its_folder(study, name, arguments):
    part = study().part(name)
    if part is None:  # the checks of a study without any are its claims
        assert name == "checks"
        assert importlib.util.find_spec(f"{study.folder}.{name}") is None
    else:
        assert list(inspect.signature(part).parameters) == arguments
        assert part.__module__ == f"{study.folder}.{name}"


def test_a_study_of_ones_own_keeps_the_parts_that_it_does_not_change():
    class Longer(TrustStudy):
        """The trust study with more networks."""

    assert issubclass(Longer, FolderStudy)
    assert Longer.folder == TrustStudy.folder
    assert Longer().part("collect") is TrustStudy().part("collect")
