"""The table of a result, its reference and the distance between them."""

import numpy as np
import pytest

import impactlab as il
from impactlab.reference.compare import compare
from impactlab.reference.reference import exact
from impactlab.results.schema import statistics


def network():
    body = il.LinearOscillator(mass=2.0, damping=0.3, stiffness=5.0)
    return il.chain(2, body, il.HertzContact(1e3), clearance=0.1, excitation=il.WhiteNoise(1.0))


def result(values, errors=None, oscillators=("body_0", "body_1"), contacts=("contact_0",)):
    as_arrays = [
        {name: np.array(item) for name, item in (data or {}).items()} if data is not None else None
        for data in (values, errors)
    ]
    return statistics(list(oscillators), list(contacts), *as_arrays)


def row(table, statistic, label):
    chosen = (table.statistic == statistic) & (table.label == label)
    return table.isel(comparison=int(np.flatnonzero(chosen.values).item()))


def test_result_against_exact_reference():
    reference = exact(network())
    true = float(reference.statistics().contact_ratio[0])
    data = result(
        {"mean_velocity": [0.2, 0.0], "contact_ratio": [1.1 * true], "peak_contact_force": [7.0]},
        {"mean_velocity": [0.1, 0.0], "contact_ratio": [0.05 * true]},
    )
    table = compare(data, reference)
    assert table.sizes == {"comparison": 3}
    assert set(table.data_vars) == {
        "value", "standard_error", "reference", "difference", "relative_difference", "z"
    }  # fmt: skip
    assert table.to_dataframe().columns.tolist()[:4] == ["statistic", "label", "units", "value"]
    ratio = row(table, "contact_ratio", "contact_0")
    assert ratio.reference == true
    assert ratio.units == "1"
    assert float(ratio.difference) == pytest.approx(0.1 * true)
    assert float(ratio.relative_difference) == pytest.approx(0.1)
    assert float(ratio.z) == pytest.approx(2.0)
    assert float(row(table, "mean_velocity", "body_0").z) == pytest.approx(2.0)
    still = row(table, "mean_velocity", "body_1")
    assert np.isnan(still.z)  # its standard error is 0
    assert np.isnan(still.relative_difference)  # its reference is 0
    assert still.difference == 0.0


def test_reference_and_its_statistics_are_the_same():
    reference = exact(network())
    table = compare(reference.statistics(), reference)
    assert table.sizes["comparison"] == 13
    assert (table.difference == 0.0).all()
    assert np.isnan(table.z).all()
    assert np.isnan(table.standard_error).all()
    assert table.identical(compare(reference.statistics(), reference.statistics()))


def test_two_simulations_combine_their_errors():
    one = result({"mean_displacement": [1.0, 5.0]}, {"mean_displacement": [0.3, 0.3]})
    two = result({"mean_displacement": [2.0, 4.0]}, {"mean_displacement": [0.4, np.nan]})
    table = compare(one, two)
    np.testing.assert_allclose(table.z, [-2.0, np.nan])
    np.testing.assert_allclose(table.standard_error, 0.3)
    np.testing.assert_allclose(table.relative_difference, [-0.5, 0.25])
    bare = two.drop_vars("mean_displacement_standard_error")
    np.testing.assert_allclose(compare(one, bare).z, [-1.0 / 0.3, 1.0 / 0.3])
    np.testing.assert_allclose(compare(bare, one).z, [1.0 / 0.3, -1.0 / 0.3])
    negative = compare(one, -bare)
    assert negative.relative_difference[0] == 1.5  # relative to the size of the reference


def test_labels_are_matched_by_name():
    one = result({"mean_displacement": [1.0, 5.0]})
    two = result({"mean_displacement": [7.0, 6.0, 5.0]}, oscillators=("other", "body_1", "body_0"))
    table = compare(one, two)
    assert table.label.values.tolist() == ["body_0", "body_1"]
    assert table.reference.values.tolist() == [5.0, 6.0]


def test_table_survives_a_file(tmp_path):
    table = compare(exact(network()).statistics(), exact(network()))
    il.save(table, tmp_path / "table.nc")
    xr = pytest.importorskip("xarray")
    with xr.open_dataset(tmp_path / "table.nc") as loaded:
        assert loaded.statistic.values.tolist() == table.statistic.values.tolist()
        np.testing.assert_array_equal(loaded.value, table.value)


def test_nothing_to_compare():
    one = result({"mean_displacement": [1.0, 5.0]})
    with pytest.raises(il.InvalidInput, match="no statistic of the same body or contact in common"):
        compare(one, result({"contact_ratio": [0.1]}))
    with pytest.raises(il.InvalidInput, match="no statistic of the same body or contact in common"):
        compare(one, result({"mean_displacement": [1.0]}, oscillators=("other",)))
    with pytest.raises(il.InvalidInput, match="result must be a Dataset"):
        compare("result.nc", one)
    with pytest.raises(il.InvalidInput, match="select one"):
        compare(one.expand_dims(clearance=[0.1, 0.2]), exact(network()))


def test_numerical_errors_of_a_reference_count():
    reference = result({"contact_ratio": [0.20]}).assign(contact_ratio_error=("contact", [0.03]))
    table = compare(result({"contact_ratio": [0.25]}, {"contact_ratio": [0.04]}), reference)
    assert float(row(table, "contact_ratio", "contact_0").z) == pytest.approx(1.0)
