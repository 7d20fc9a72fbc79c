"""Digests of what a file holds: damage and changes are named, other ways to store the same values are not."""

import json
import os

import netCDF4
import numpy as np
import pytest
import xarray as xr

import impactlab as il
from impactlab.results import contents
from impactlab.results.contents import DIGESTS
from impactlab.results.dataset import CONFIGURATION, part_of

DATA = xr.Dataset(
    {
        "number": ((), 1.5, {"scale": 0.1, "counts": np.array([1, 2, 3])}),
        "whole": ("x", np.array([3, 2, 1])),
        "values": (("x", "y"), np.array([[0.0, np.nan], [-0.0, 1e-320], [np.inf, 3.0]]), {"units": "m"}),
        "single": ("x", np.array([1.0, 2.0, 3.0], dtype=np.float32)),
        "none": ("nothing", np.zeros(0)),
        "text": ((), "a\nb"),
        "sure": ("x", np.array([True, False, True])),
    },
    {"x": ["é", "β", ""], "y": [0.25, 0.5]},
    {CONFIGURATION: "{}", "step": 0.001, "title": "A title", "limits": [1.0, 2.0], "one": [7.0], "empty": ""},
)


@pytest.fixture
def path(tmp_path):
    il.save(DATA, tmp_path / "data.nc")
    return tmp_path / "data.nc"


def test_what_was_saved_is_loaded(path, tmp_path):
    assert il.load(path).equals(DATA)
    assert DIGESTS not in il.load(path).attrs
    il.save(il.load(path), path)  # and so on
    il.save(xr.open_dataset(path).load(), tmp_path / "again.nc")
    assert il.load(tmp_path / "again.nc").equals(DATA)
    tree = xr.DataTree.from_dict({"/": xr.Dataset(attrs=DATA.attrs), "/a": DATA, "/a/b": DATA[["values"]]})
    il.save(tree, path)
    assert il.load(path).equals(tree)


@pytest.mark.parametrize(
    "options",
    [
        {"format": "NETCDF3_64BIT"},
        {"format": "NETCDF3_CLASSIC", "engine": "scipy"},
        {"encoding": {"values": {"zlib": True, "chunksizes": (1, 2)}, "single": {"dtype": "f8"}}},
        {"encoding": {"whole": {"dtype": "i2"}}},
        {"unlimited_dims": ["y"]},
    ],
)
def test_the_digests_are_of_values(options, path, tmp_path):
    stored = (
        xr.open_dataset(path).drop_encoding().drop_vars("none" if "format" in options else [])
    )  # netCDF 3 has no empty dimensions
    digests = json.loads(stored.attrs[DIGESTS])
    stored.attrs[DIGESTS] = json.dumps({name: item for name, item in digests.items() if name in {*stored, ":step"}})
    stored.to_netcdf(tmp_path / "other.nc", **options)
    assert il.load(tmp_path / "other.nc").equals(DATA.drop_vars("none" if "format" in options else []))


def test_additions_do_not_matter(path):
    with netCDF4.Dataset(path, "a") as file:
        file.createVariable("mine", "f8", ("x",))[:] = 1.0
        file.note = "read it"
    read = il.load(path)
    assert read.attrs["note"] == "read it"
    assert read.drop_vars("mine").equals(DATA)


CHANGES = {
    "number": lambda file: file["number"].__setitem__(..., 1.5000000000000002),
    "values": lambda file: file["values"].__setitem__((0, 0), -0.0),
    "x": lambda file: file["x"].__setitem__(0, "e"),
    "text": lambda file: file["text"].__setitem__(..., "a b"),
    "sure": lambda file: file["sure"].__setitem__(0, 0),
    ":step": lambda file: file.setncattr("step", np.nextafter(0.001, 1.0)),
    f":{CONFIGURATION}": lambda file: file.setncattr(CONFIGURATION, "{ }"),
    ":title": lambda file: file.delncattr("title"),
    "single": lambda file: file.renameVariable("single", "singly"),
}


@pytest.mark.parametrize("name", CHANGES)
def test_a_change_is_named(name, path):
    with netCDF4.Dataset(path, "a") as file:
        CHANGES[name](file)
    with pytest.raises(
        il.InvalidInput, match=rf"data.nc does not hold what impactlab wrote: {name} differs\..*il.save"
    ):
        il.load(path)


def test_an_attribute_of_a_variable_is_a_part_of_it(path):
    with netCDF4.Dataset(path, "a") as file:
        file["values"].units = "mm"
        file["number"].counts = [1, 2, 4]
    for read in (il.load, il.network_of, il.rerun, il.citation, il.absolute_acceleration):
        with pytest.raises(il.InvalidInput, match="number, values differ"):
            read(path)
    meant = xr.open_dataset(path)
    il.save(meant.load(), path.with_name("meant.nc"))
    assert il.load(path.with_name("meant.nc"))["values"].units == "mm"


def test_a_part_is_checked_by_itself(path):
    with netCDF4.Dataset(path, "a") as file:
        file["values"][0, 0] = 5.0
    assert part_of(path, ["number", "missing"]).number == 1.5
    with pytest.raises(il.InvalidInput, match="values differs"):
        part_of(path, ["values"])
    with netCDF4.Dataset(path, "a") as file:
        file.step = 0.002
    with pytest.raises(il.InvalidInput, match=":step differs"):
        part_of(path, ["number"])


def test_digests_that_are_damaged(path):
    for text in ("{", "5", "[[[]]]"):
        with netCDF4.Dataset(path, "a") as file:
            file.setncattr(DIGESTS, text)
        with pytest.raises(il.InvalidInput, match="its digests"):
            il.load(path)


def test_large_variables_are_digested_in_tiles(monkeypatch, path, tmp_path):
    values = np.random.default_rng(1).random((3, 1000, 2))
    data = xr.Dataset({"large": (("a", "b", "c"), values)})
    monkeypatch.setattr(contents, "TILE", 100)
    il.save(data, path)
    xr.open_dataset(path).to_netcdf(tmp_path / "other.nc", encoding={"large": {"chunksizes": (2, 7, 1)}})
    assert il.load(tmp_path / "other.nc").equals(data)
    with netCDF4.Dataset(path, "a") as file:
        file["large"][2, 731, 1] += 1e-12
    with pytest.raises(il.InvalidInput, match="large differs"):
        il.load(path)


def test_a_file_cannot_declare_more_than_it_holds(path, monkeypatch):
    with netCDF4.Dataset(path, "a") as file:
        file.createDimension("much", 10**10)
        file.createVariable("much", "f8", ("much",), chunksizes=(1000,))
    with pytest.raises(il.InvalidInput, match=r"declares 80 GB of data, but has 0.0\d* MB"):
        il.load(path)
    il.save(DATA, path)
    monkeypatch.setattr("impactlab.results.dataset.available", lambda: 10.0)
    with pytest.raises(il.InvalidInput, match="of memory are available"):
        il.load(path)


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such limits")
def test_groups_without_end(path):
    for depth in (100, 3000):
        with netCDF4.Dataset(path, "w") as file:
            file.createGroup("/".join("g" * depth))
        with pytest.raises(il.InvalidInput, match="cannot be read"):
            il.load(path)


def test_a_classic_file_without_its_end(path, tmp_path):
    """The library takes a classic file that ends in its heading for an empty one."""
    classic = tmp_path / "classic.nc"
    xr.open_dataset(path).drop_encoding()[["number"]].drop_attrs().to_netcdf(classic, format="NETCDF3_64BIT")
    assert il.load(classic).number == 1.5
    classic.write_bytes(classic.read_bytes()[:42])
    with pytest.raises(il.InvalidInput, match=r"holds nothing|cannot be read"):
        il.load(classic)
