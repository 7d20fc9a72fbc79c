"""Nested data and datasets as files that carry a digest."""

import numpy as np
import pytest
import xarray as xr

import impactlab as il
from impactlab.results.arrays_file import load_arrays, save_arrays


@pytest.fixture
def dataset():
    """Numbers of several kinds, texts, a scalar that is no index, nothing in an array, and attributes."""
    return xr.Dataset(
        {
            "mean": (("oscillator", "time"), np.array([[0.1, np.nan], [-np.inf, 1e-300]]), {"units": "m", "file": "a"}),
            "count": ("oscillator", np.array([1, 2**62]), {"valid": np.array([0, 3])}),
            "status": ("oscillator", np.array(["fine", "ω̄ beyond"])),
            "none": ("empty", np.zeros(0)),
            "file": ((), True),
        },
        {"oscillator": ["one", "two"], "time": [0.0, 0.1], "clearance": 0.05, "body": ("oscillator", [3, 4])},
        {"title": "ζ", "step": np.float64(0.1), "seconds": np.inf, "seed": 2**64, "limits": [0.1, 0.3]},
    )


def test_a_dataset_is_read_as_it_was_written(tmp_path, dataset):
    save_arrays(dataset, tmp_path / "kept")
    read = load_arrays(tmp_path / "kept")
    xr.testing.assert_identical(read, dataset)
    assert {name: variable.dtype for name, variable in read.variables.items()} == {
        name: variable.dtype for name, variable in dataset.variables.items()
    }
    assert set(read.indexes) == {"oscillator", "time"}
    assert [path.name for path in tmp_path.iterdir()] == ["kept"]


def test_nested_data_are_read_as_they_were_written(tmp_path):
    """With the order of axes in memory, on which the rounding of sums depends."""
    turned = np.arange(24.0).reshape(2, 3, 4).transpose(1, 2, 0)
    value = {"a": [1, (2.5, None)], 3: {4, 5}, "turned": turned, "same": ..., "scalar": np.float32(0.1)}
    save_arrays(value, tmp_path / "kept")
    read = load_arrays(tmp_path / "kept")
    assert read["turned"].strides == turned.strides
    np.testing.assert_array_equal(read.pop("turned"), value.pop("turned"))
    assert read == value
    assert type(read["scalar"]) is np.float32


@pytest.mark.full
def test_damage_is_noticed(tmp_path, dataset):
    """Bits are flipped all over the file, or it is cut: it is refused."""
    save_arrays(dataset, tmp_path / "kept")
    whole = (tmp_path / "kept").read_bytes()
    for place in range(0, len(whole), 7):
        damaged = bytearray(whole)
        damaged[place] ^= 1 << place % 8
        (tmp_path / "kept").write_bytes(damaged)
        with pytest.raises(il.InvalidInput, match="kept cannot be read"):
            load_arrays(tmp_path / "kept")
    for length in (0, 100, len(whole) - 1):
        (tmp_path / "kept").write_bytes(whole[:length])
        with pytest.raises(il.InvalidInput, match="kept cannot be read"):
            load_arrays(tmp_path / "kept")


def test_objects_are_not_written(tmp_path):
    """They would be read by running what is in the file."""
    with pytest.raises(ValueError, match="Object arrays"):
        save_arrays(xr.Dataset({"a": ("x", np.array([{}], dtype=object))}), tmp_path / "kept")
    assert not list(tmp_path.iterdir())
