"""The coverage study: networks, differences in errors, shares and their errors, and its small run."""

import numpy as np
import pytest
import xarray as xr
from impactlab_numerics import CoverageStudy
from impactlab_numerics.coverage.networks import CLASSES, drawn
from impactlab_numerics.coverage.questions import RECORDS, bands, compared
from impactlab_numerics.coverage.tables import by_question, covered

STUDY = CoverageStudy()


def made(z, network):
    """A table of differences of one quantity."""
    names = {name: ("comparison", np.array(["x"] * len(z))) for name in ("class", "question", "quantity")}
    return xr.Dataset({"z": ("comparison", z)}, {"network": ("comparison", network), **names})


def test_intervals_of_a_network_hold_together():
    alone, together = (made(np.where(np.arange(100) < 90, 1.0, 3.0), np.arange(100) // size) for size in (1, 10))
    assert covered(alone).share == covered(together).share == 0.9
    assert covered(alone).error == pytest.approx(np.sqrt(0.9 * 0.1 / 99))
    assert covered(together).error == pytest.approx(np.sqrt(0.9 * 0.1 / 9))


def test_rounding_and_values_without_errors_are_not_counted():
    short = xr.Dataset({"a": ("x", [1.0, 1.0, 1.0, 2.0]), "a_standard_error": ("x", [0.1, np.nan, 1e-17, 0.0])})
    long = xr.Dataset({"a": ("x", [1.2, 1.0, 1.0, 1.0]), "a_standard_error": ("x", [0.0, 0.1, 1e-17, 0.1])})
    long["a_standard_error"][0] = 1e-6
    (row,) = compared("q", ["a", "none"], short, long)
    assert row.z == pytest.approx(-2.0, rel=1e-6)


def test_bands_are_compared_in_their_errors():
    """At an end of the band of the short run a difference is 1.96 errors, less what the longer run has."""
    short = xr.Dataset({f"{name}{end}": ("s", [value]) for name in ("probability", "fitted_probability")
                        for end, value in (("_low", 0.3), ("_high", 0.5))})  # fmt: skip
    long = xr.Dataset({name: ("s", [0.5]) for name in ("probability", "fitted_probability")})
    assert [row.z for row in bands(short, long, 8)] == pytest.approx([1.96 / np.sqrt(1.125)] * 2, rel=1e-3)


@pytest.mark.campaign
def test_every_class_is_drawn_and_the_same_again():
    items = [drawn(number, 64) for number in range(2 * len(CLASSES))]
    assert {item.kind for item in items} == {*CLASSES, "mixtures"}
    assert drawn(3, 64).network == items[3].network
    assert all(item.options["realizations"] <= 64 for item in items)


@pytest.mark.campaign
@pytest.mark.filterwarnings("ignore::impactlab.ImpactLabWarning")
def test_the_quick_form_holds(run, explained):
    """Of six networks each question is answered, and nothing is certainly off."""
    assert [check for check in run.checks if not check.ok] == []
    parts = by_question(run.tree)
    assert {*RECORDS, "balance", "FirstPassage", "fragility", "Uncertain"} == set(parts)
    assert all(np.abs(part.z).max() < 6.0 for part in parts.values())
    explained(run.study, run.figures, run.claims)
