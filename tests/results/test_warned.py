"""The table of warnings in results."""

import numpy as np
import pytest
import xarray as xr

import impactlab as il
from impactlab.errors import AccuracyWarning, ImpactLabWarning, noted, warn
from impactlab.results.stack import Findings, gathered
from impactlab.results.warned import by_kind, with_all_kinds, with_warnings

NOTHING = Findings({"x": ((), np.array(1.0), {})}, {}, {})


def complaining():
    with noted() as given:
        warn("drift", "Halves differ.")
        warn("few_samples", "Too few.")
        warn("drift", "Halves differ.")
        warn("drift", "Quarters differ.")
        warn("long_run", "It takes long.", ImpactLabWarning)
    return given


def test_warnings_of_a_run_are_texts_by_kind():
    with pytest.warns(ImpactLabWarning) as caught:
        given = complaining()
    assert [item.message for item in caught] == given
    assert {item.filename for item in caught} == {__file__}
    assert by_kind(given) == {"few_samples": "Too few.", "drift": "Halves differ. Quarters differ."}


def test_runs_of_a_sweep_have_one_table(tmp_path):
    first, second = with_warnings(NOTHING, {"drift": "a"}), with_warnings(NOTHING, {"few_samples": "b", "drift": "c"})
    refused = Findings({}, {}, {})
    found = with_all_kinds([first, NOTHING, refused, second])
    whole = gathered(found, {"k": xr.Variable("k", np.arange(4))})
    assert whole.warning.values.tolist() == ["few_samples", "drift"]
    assert whole.warnings.values.tolist() == [["", "a"], ["", ""], ["", ""], ["b", "c"]]
    il.save(whole, tmp_path / "whole.nc")
    assert xr.load_dataset(tmp_path / "whole.nc").warnings.equals(whole.warnings)


def test_runs_without_warnings_have_no_table():
    assert with_warnings(NOTHING, {}) == NOTHING
    assert with_all_kinds([NOTHING, NOTHING]) == [NOTHING, NOTHING]


def test_a_warning_of_its_own_kind_only():
    with pytest.raises(AssertionError, match="unheard_of"):
        warn("unheard_of", "What is it?")
    assert AccuracyWarning("text", "drift").kind == "drift"
