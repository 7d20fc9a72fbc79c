"""Many datasets as one: order, what is missing or shorter, and what stays as it is."""

import numpy as np
import pytest
import xarray as xr

from impactlab.results.stack import gathered, on_own_axes


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


# axes


def recorded(times, **more):
    return xr.Dataset(
        {"x": ("time", np.arange(len(times), dtype=float)), **more}, {"time": ("time", times, {"units": "s"})}
    )


@pytest.mark.parametrize("lengths", [(3, 3), (3, 5), (5, 3)])
def test_samples_at_the_same_times_but_for_rounding_have_one_axis(lengths):
    times = 0.1 * np.arange(lengths[0]), np.cumsum(np.full(lengths[1], 0.1)) - 0.1
    times[1][0] = 0.0
    ds = gathered([recorded(each) for each in times], axes(k=2))
    assert ds.sizes["time"] == max(lengths)
    assert ds.x.count("time").values.tolist() == list(lengths)
    np.testing.assert_array_equal(ds.time, times[int(np.argmax(lengths))])


def test_samples_at_times_of_their_own_are_numbered():
    each = [0.1 * np.arange(3), np.array([]), 0.2 * np.arange(2)]
    names = [{"y": ("body", [1.0]), "body": ["b"]}, {}, {"y": ("body", [2.0]), "body": ["a"]}]
    results = [recorded(times, **more) for times, more in zip(each, names, strict=True)]
    results[1] = xr.Dataset()
    ds = gathered(results, axes(k=3))
    assert ds.x.dims == ds.time.dims == ("k", "sample")
    assert "time" in ds.coords
    assert ds.time.attrs == {"units": "s"}
    np.testing.assert_array_equal(ds.time, [[0.0, 0.1, 0.2], [np.nan] * 3, [0.0, 0.2, np.nan]])
    assert ds.y.sel(body="a").values.tolist()[2] == 2.0  # labels still find their place
    for place in (0, 2):
        xr.testing.assert_identical(on_own_axes(ds.isel(k=place))[["x"]].drop_vars("k"), results[place][["x"]])


def test_a_point_has_no_places_that_only_others_fill():
    first, second = (xr.Dataset({"share": ("bin", np.ones(bins)), "kind": ("bin", ["a"] * bins)}) for bins in (2, 4))
    ds = gathered([first, second], axes(k=2))
    assert ds.share.sizes["bin"] == 4
    xr.testing.assert_identical(on_own_axes(ds.isel(k=0)).drop_vars("k"), first)
    xr.testing.assert_identical(on_own_axes(ds), ds)
