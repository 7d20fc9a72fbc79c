"""Many datasets as one: order, what is missing or shorter, and what stays as it is."""

import numpy as np
import pytest
import xarray as xr

from impactlab.results.stack import gathered


def point(value, time, **more):
    index = {"time": ("time", np.arange(time, dtype=float), {"units": "s"}), "edge": ("bin", [value, 1.0])}
    return xr.Dataset({"x": ("time", value + np.arange(time), {"units": "m"}), "n": ((), time), **more}, index)


def axes(**lengths):
    return {name: xr.Variable(name, np.arange(length), {"units": "1"}) for name, length in lengths.items()}


def test_the_last_coordinate_varies_fastest():
    ds = gathered([point(k, 2) for k in range(6)], axes(a=2, b=3))
    assert ds.x.dims == ("a", "b", "time")
    np.testing.assert_array_equal(ds.x[:, :, 0], [[0, 1, 2], [3, 4, 5]])
    assert ds.n.dtype.kind == "i"
    assert ds.x.attrs == {"units": "m"}
    assert ds.time.attrs == {"units": "s"}
    assert ds.a.attrs == {"units": "1"}
    assert ds.edge.dims == ("a", "b", "bin")
    assert "edge" in ds.coords


def test_what_is_missing_or_shorter_is_filled_up():
    ds = gathered([point(0, 3, text=((), "long enough"), y=((), 5)), xr.Dataset(), point(7, 1)], axes(a=3))
    np.testing.assert_array_equal(ds.x, [[0, 1, 2], [np.nan] * 3, [7, np.nan, np.nan]])
    np.testing.assert_array_equal(ds.y, [5, np.nan, np.nan])
    assert ds.text.values.tolist() == ["long enough", "", ""]
    assert ds.time.values.tolist() == [0.0, 1.0, 2.0]


def test_labels_find_their_place():
    first, second = (xr.Dataset({"x": ("body", [1.0, 2.0])}, {"body": names}) for names in (["b", "c"], ["c", "a"]))
    ds = gathered([first, second], axes(k=2))
    assert ds.x.sel(body="c").values.tolist() == [2.0, 1.0]
    assert np.isnan(ds.x.sel(body="a")[0])


@pytest.mark.parametrize("values", [[True, False], ["a", "bc"], [1, 2]])
def test_kinds_of_values_are_kept(values):
    ds = gathered([xr.Dataset({"x": ((), value)}) for value in values], axes(k=2))
    assert ds.x.values.tolist() == values
    assert ds.x.dtype == np.array(values).dtype
