"""What impactlab does with a dataset as its own: plots, tables for pandas, CSV and MATLAB, and a summary."""

import inspect

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from matplotlib.figure import Figure
from scenes import base
from scipy.io import loadmat, savemat

import impactlab as il
from impactlab.results.accessor import ROWS_OF_SUMMARY
from impactlab.results.dataset import provenance  # which registers it
from impactlab.results.measured import measured_text
from impactlab.results.schema import STATISTICS

pytestmark = pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")

COLUMNS = ["statistic", "label", "value", "standard_error", "units"]
SHORT = {"duration": 2.0, "realizations": 64, "spin_up": 1.0, "rng": 1}
VALUE = {"units": "1", "long_name": "fraction of time in contact"}


def small():
    data = {"contact_ratio": (("clearance", "contact"), [[0.3], [0.2], [0.1]], VALUE)}
    return xr.Dataset(data, {"clearance": [0.0, 0.1, 0.2], "contact": ["gap"]})


def test_a_plot_of_a_dataset_is_that_of_the_function():
    assert callable(provenance)
    data = small()
    own = data.impactlab.plot.sweep("contact_ratio", ax=Figure().subplots())
    other = il.plot.sweep(data, "contact_ratio", ax=Figure().subplots())
    for one, two in zip(own.lines, other.lines, strict=True):
        np.testing.assert_array_equal(one.get_xydata(), two.get_xydata())
    np.testing.assert_array_equal(own.lines[0].get_ydata(), [0.3, 0.2, 0.1])
    assert own.get_ylabel() == other.get_ylabel() == "fraction of time in contact"


def test_all_plots_of_datasets_are_there():
    plots = small().impactlab.plot
    expected = {
        name for name in il.plot.__all__ if next(iter(inspect.signature(getattr(il.plot, name)).parameters)) == "result"
    }
    assert set(dir(plots)) == expected
    with pytest.raises(
        AttributeError, match=r"draws no 'network' of a dataset; it draws basins, bifurcation, branch, correlation, "
    ):
        plots.network()
    assert not hasattr(plots, "densty")
    assert repr(plots).startswith("il.plot of this dataset: .basins(…), .bifurcation(…), .branch(…), ")


@pytest.mark.full
def test_nothing_is_drawn_by_importing(run_python):
    code = "import sys, impactlab.results.dataset; print('matplotlib' in sys.modules)"
    assert run_python("-c", code).strip() == "False"


# tables and summaries


@pytest.fixture(scope="module")
def result():
    return il.simulate(base(), record=[il.Density(bins=5), il.Trajectory(0.5)], **SHORT)


@pytest.fixture(scope="module")
def swept():
    def make(clearance):
        if clearance > 1.0:
            raise il.InvalidInput("too far")
        return base(clearance=clearance)

    return il.sweep(make, {"clearance": [0.02, 0.05, 2.0]}, **SHORT)


def test_each_statistic_of_each_label_is_a_row(result):
    table = result.impactlab.table()
    assert table.columns.tolist() == COLUMNS
    assert len(table) == sum(result[name].size for name in STATISTICS)
    for _, statistic, label, value, error, units in table.itertuples():
        place = {STATISTICS[statistic].dimension: label}
        assert value == result[statistic].sel(place)
        assert error == result[f"{statistic}_standard_error"].sel(place)
        assert units == result[statistic].units


def test_rows_of_a_sweep_begin_with_its_values(swept):
    table = swept.impactlab.table()
    assert table.columns.tolist() == ["clearance", *COLUMNS]
    contacts = table[table.statistic == "contact_ratio"]
    np.testing.assert_array_equal(contacts.clearance, swept.clearance)
    np.testing.assert_array_equal(contacts.value, swept.contact_ratio.values[:, 0])
    assert contacts.value.isna().tolist() == [False, False, True]


def test_parts_and_laws_have_tables(result, swept):
    whole, one = result.impactlab.table(), result.isel(oscillator=1).impactlab.table()
    assert set(one.label) == {"two", "gap"}
    pd.testing.assert_frame_equal(
        one[one.label == "two"].reset_index(drop=True), whole[whole.label == "two"].reset_index(drop=True)
    )
    point = swept.sel(clearance=0.05).impactlab.table()
    assert point.columns.tolist() == COLUMNS
    exact = il.exact(base()).statistics().impactlab.table()
    assert exact.standard_error.isna().all()
    with pytest.raises(il.InvalidInput, match="holds no statistics: give what"):
        xr.Dataset({"x": 1.0}).impactlab.table()


def test_files_of_text_and_of_matlab_have_the_same_numbers(result, tmp_path):
    table = result.impactlab.table()
    table.to_csv(tmp_path / "table.csv", index=False)
    read = pd.read_csv(tmp_path / "table.csv")
    np.testing.assert_allclose(read.value, table.value, rtol=1e-14)
    assert read.label.tolist() == table.label.tolist()
    arrays = {name: variable.values for name, variable in result.variables.items()}
    savemat(tmp_path / "result.mat", arrays)
    savemat(tmp_path / "struct.mat", {"result": arrays}, long_field_names=True)
    for found in (
        loadmat(tmp_path / "result.mat", simplify_cells=True),
        loadmat(tmp_path / "struct.mat", simplify_cells=True)["result"],
    ):
        assert arrays.keys() <= found.keys()
        for name, values in arrays.items():
            np.testing.assert_array_equal(
                np.squeeze(values), np.char.rstrip(found[name]) if values.dtype.kind == "U" else found[name]
            )


def test_a_result_shows_its_statistics(result):
    shown = repr(result.impactlab)
    assert shown.startswith(f"64 realization(s), duration 2 s, step {result.attrs['step']:.6g} s, spin-up 1 s\n")
    row = result.impactlab.table().iloc[-1]
    line = next(line for line in shown.splitlines() if row.statistic in line)
    assert line.split() == [*f"{row.statistic} {row.label} {measured_text(row.value, row.standard_error)} N".split()]
    page = result.impactlab._repr_html_()
    assert f"<td>{measured_text(row.value, row.standard_error)}</td>" in page
    assert "64 realization(s)" in page


def test_a_sweep_shows_its_first_rows(swept):
    shown = repr(swept.impactlab).splitlines()
    assert shown[0].startswith("2 of 3 points done, 64 realization(s), duration 2 s, step ")
    assert len(shown) == 2 + ROWS_OF_SUMMARY + 2
    assert shown[-2] == f"These are {ROWS_OF_SUMMARY} of {len(swept.impactlab.table())} rows."
    assert repr(swept.sel(clearance=0.05).impactlab).startswith("clearance = 0.05, 64 realization(s), ")


def test_warnings_are_shown_and_texts_are_escaped():
    texts = [["<b> is odd", ""], ["", ""], ["<c> is odd", ""]]
    data = {"contact_ratio": (("k", "contact"), [[0.5]] * 3), "warnings": (("k", "warning"), texts)}
    dataset = xr.Dataset(data, {"k": [0, 1, 2], "contact": ["<gap>"], "warning": ["odd", "other"]})
    warned = "Warning: <b> is odd (of 2 points the first)"
    assert [line for line in repr(dataset.impactlab).splitlines() if "Warning" in line] == [warned]
    page = dataset.impactlab._repr_html_()
    assert "&lt;gap&gt;" in page
    assert "&lt;b&gt; is odd" in page
    assert "<b>" not in page


def test_a_dataset_without_statistics_says_so():
    assert (
        repr(xr.Dataset({"x": 1.0}, attrs={"title": "of somebody"}).impactlab) == "of somebody\nIt holds no statistics."
    )
