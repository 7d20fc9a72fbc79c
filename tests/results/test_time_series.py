"""Measured time series: PEER's accelerograms, columns of text, netCDF files."""

import numpy as np
import pytest
import xarray as xr

import impactlab as il

HEADING = """PEER NGA STRONG MOTION DATABASE RECORD
Somewhere, 5/1/2001, Station 7, 90
ACCELERATION TIME SERIES IN UNITS OF G
"""
ROWS = "  .1000000E-02 -.2000000E-02  .3000000E-02\n  .4000000E-02  0.0\n"


def written(folder, name, text):
    (folder / name).write_text(text, encoding="utf-8")
    return folder / name


@pytest.mark.parametrize("last", ["NPTS=      5, DT=   .0050 SEC,", "    5    0.0050    NPTS, DT"])
def test_accelerograms_of_peer(tmp_path, last):
    record = il.read_time_series(written(tmp_path, "record.AT2", f"{HEADING}{last}\n{ROWS}"))
    assert record.attrs == {"units": "m s-2", "long_name": "acceleration, Somewhere, 5/1/2001, Station 7, 90"}
    np.testing.assert_allclose(record.time, [0.0, 0.005, 0.01, 0.015, 0.02], rtol=1e-15)
    np.testing.assert_allclose(record, 9.80665 * np.array([1e-3, -2e-3, 3e-3, 4e-3, 0.0]), rtol=1e-15)
    assert il.SampledForce.from_dataarray(record).known_until == 0.02


@pytest.mark.parametrize(
    "text", ["time (s), a\n0.0, 1.0\n0.5, -2e-1\n", "# made in 2001\n\n0 1\n.5 -0.2\n", "0;1\n0.5;-.2;\n"]
)
def test_two_columns(tmp_path, text):
    record = il.read_time_series(written(tmp_path, "record.csv", text))
    assert (record.time.values.tolist(), record.values.tolist()) == ([0.0, 0.5], [1.0, -0.2])
    assert record.time.attrs["units"] == "s"


@pytest.mark.parametrize(
    ("text", "times", "values", "heading"),
    [
        ("\ufeff0,1\n1,2\n2,3\n", [0.0, 1.0, 2.0], [1.0, 2.0, 3.0], None),  # as spreadsheets write it
        ('"0","9"\n1,2\n\'2\',"3"\n', [0.0, 1.0, 2.0], [9.0, 2.0, 3.0], None),
        ("−1,5\n0,−1\n1,2\n", [-1.0, 0.0, 1.0], [5.0, -1.0, 2.0], None),
        ("\ufeffit's t,a\n# 2001-05-01\n\n'−1','5'\n'0','1'\n", [-1.0, 0.0], [5.0, 1.0], "it's t,a\n# 2001-05-01"),
    ],
)
def test_no_sample_is_taken_for_a_heading(tmp_path, text, times, values, heading):
    record = il.read_time_series(written(tmp_path, "record.csv", text))
    assert (record.time.values.tolist(), record.values.tolist()) == (times, values)
    assert record.attrs.get("heading") == heading


def test_netcdf(tmp_path):
    record = xr.DataArray([1.0, 2.0, 4.0], {"t": [0.0, 1.0, 3.0]}, "t", "push", {"units": "N"})
    il.save(record.to_dataset(), tmp_path / "one.nc")
    read = il.read_time_series(tmp_path / "one.nc")
    assert (read.dims, read.attrs["units"], read.values.tolist()) == (("time",), "N", [1.0, 2.0, 4.0])
    il.save(record.assign_coords(time=("t", [5.0, 6.0, 7.0])).to_dataset(), tmp_path / "named.nc")
    assert il.read_time_series(tmp_path / "named.nc").time.values.tolist() == [0.0, 1.0, 3.0]
    il.save(xr.Dataset({"a": record, "b": record}), tmp_path / "two.nc")
    with pytest.raises(il.InvalidInput, match=r"two.nc holds 2 variables of one dimension with a coordinate, not one"):
        il.read_time_series(tmp_path / "two.nc")


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.csv", "0 1\n0.1 2 3\n", r"a.csv, line 2: a time and a value are needed, not 3 numbers"),
        ("a.csv", "0 1\n0.1 two\n", r"a.csv, line 2: '0.1 two' holds more than numbers"),
        ("a.at2", HEADING + "NPTS= 6, DT= .005 SEC\n" + ROWS, r"holds 5 values, but its heading announces 6"),
        ("a.at2", HEADING.replace("OF G", "OF CM/S") + "NPTS= 5, DT= .005 SEC\n" + ROWS, r"does not begin as PEER's"),
        ("a.at2", "0 1\n", r"does not begin as PEER's files of accelerations do"),
        ("a.csv", "time, a\n0, 1\n1, nan\n2, 3\n", r"a.csv, line 3: the value is nan, but .* \(1 of 3 are not\); fill"),
        ("a.csv", "time, a\n\nNaN, 1\n1, 2\n", r"a.csv, line 3: the time is nan, but all must be finite"),
        ("a.csv", "0 1\n1 2\n-inf 3\n", r"a.csv, line 3: the time is -inf, but all must be finite"),
        ("a.csv", "0 1\n0.5 2\n\n0.5 3\n", r"a.csv, line 4: the time 0.5 s follows 0.5 s, but times must increase; s"),
        ("a.csv", "0 1\n0.5 2\n0.25 3\n", r"a.csv, line 3: the time 0.25 s follows 0.5 s, but times must increase"),
        ("a.csv", "time (s), a\n", r"a.csv holds 0 samples; a time series has two at least"),
        ("a.csv", "", r"a.csv is empty"),
        ("a.csv", "time, a\n0, 1\n", r"a.csv holds 1 sample; a time series has two at least"),
        ("a.csv", ";0,1\n1,2\n2,3\n", r"a.csv, line 1: ';0,1' has digits and no words, but is no row of numbers"),
        ("a.csv", "t\n\u200b0,1\n1,2\n2,3\n", r"a.csv, line 2: .* begin a heading with #, or mend the row"),
        ("a.at2", HEADING + "NPTS= 5, DT= 1.2.3 SEC\n" + ROWS, r"a.at2, line 4: NPTS must be .* not '5' and '1.2.3'"),
        (
            "a.at2",
            HEADING + "NPTS= 5, DT= - SEC\n" + ROWS,
            r"a.at2, line 4: NPTS must be .* DT a number \(s\), not '5'",
        ),
        (
            "a.at2",
            HEADING + f"NPTS= {'5' * 5000}, DT= 1 SEC\n" + ROWS,
            r"a.at2, line 4: NPTS .* not '555.*555' and '1'",
        ),
        ("a.at2", HEADING + "NPTS= 0, DT= .005 SEC\n", r"a.at2 holds 0 samples; a time series has two at least"),
        ("a.at2", HEADING + "NPTS= 5, DT= 0.0 SEC\n" + ROWS, r"a.at2, line 4: the time between .* above 0 s, not 0 s"),
        ("a.at2", HEADING + "NPTS= 5, DT= .005 SEC\n" + ROWS.replace("0.0", "NaN"), r"a.at2, line 6: the value is nan"),
    ],
)
def test_bad_file(tmp_path, name, text, message):
    with pytest.raises(il.InvalidInput, match=message):
        il.read_time_series(written(tmp_path, name, text))
    with pytest.raises(il.InvalidInput, match=r"There is no file .*other\.csv"):
        il.read_time_series(tmp_path / "other.csv")


def test_no_path():
    with pytest.raises(il.InvalidInput, match=r"must be the path of a file or a folder, not"):
        il.read_time_series("a" * 5000)
    with pytest.raises(il.InvalidInput, match=r"path must be a path, not 5"):
        il.read_time_series(5)


@pytest.mark.parametrize(
    ("times", "values", "message"),
    [
        ([0.0, 1.0, 2.0], [1.0, np.nan, 2.0], r"a.nc, sample 1 \(from 0\): the value is nan, but all must be finite"),
        ([0.0, 1.0, 1.0], [1.0, 2.0, 3.0], r"a.nc, sample 2 \(from 0\): the time 1 s follows 1 s, but times must incr"),
        ([], [], r"a.nc holds 0 samples; a time series has two at least"),
    ],
)
def test_bad_netcdf(tmp_path, times, values, message):
    record = xr.DataArray(np.array(values), {"t": np.array(times)}, "t", "push")
    il.save(record.to_dataset(), tmp_path / "a.nc")
    with pytest.raises(il.InvalidInput, match=message):
        il.read_time_series(tmp_path / "a.nc")


def test_decimal_commas_between_semicolons(tmp_path):
    path = tmp_path / "comma.csv"
    path.write_text("t;x\n0,0;1,5\n0,1;2\n0,2;-3,25\n", encoding="utf-8")
    series = il.read_time_series(path)
    np.testing.assert_array_equal(series.time, [0.0, 0.1, 0.2])
    np.testing.assert_array_equal(series, [1.5, 2.0, -3.25])


def test_a_text_in_utf_16_is_named(tmp_path):
    path = tmp_path / "wide.csv"
    path.write_text("0.0,1.5\n0.1,2.5\n", encoding="utf-16")
    with pytest.raises(il.InvalidInput, match="UTF-16; save it as UTF-8"):
        il.read_time_series(path)
