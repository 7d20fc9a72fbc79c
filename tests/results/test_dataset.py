"""Datasets: labels, attributes, files that are whole or absent."""

import hashlib
import json
import os
import re
import signal
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import netCDF4
import numpy as np
import pytest
import xarray as xr

import impactlab as il
from impactlab.interrupts import UninterruptedLock
from impactlab.results.contents import DIGESTS
from impactlab.results.dataset import CONFIGURATION, configuration_of, load, provenance
from impactlab.results.schema import STATISTICS, balances, statistics


@pytest.fixture(scope="module")
def network():
    body = il.LinearOscillator(damping=0.4, stiffness=4.0)
    return il.chain(2, body, il.HertzContact(1e3), clearance=0.1, excitation=il.WhiteNoise(1.0))


@pytest.fixture(scope="module")
def result(network):
    """A result with every kind of variable."""
    records = [
        il.Trajectory(0.5),
        il.Density("velocity", bins=5),
        il.JointDensity("body_0", "body_1", bins=4),
        il.PerRealization(),
    ]
    return il.simulate(network, 2.0, realizations=64, step=0.02, spin_up=0.0, record=records, rng=1)


def made_by_hand():
    """A small dataset with values of its own."""
    values = {"mean_displacement": np.array([1.5, 2.5]), "contact_ratio": np.array([0.25])}
    return statistics(
        ["a", "b"], ["c"], values, {"contact_ratio": np.array([0.01])}, **provenance("Test", "{}", "A. Body")
    )


# Labels and attributes


def test_labels():
    data = made_by_hand()
    assert data.mean_displacement.sel(oscillator="b") == 2.5
    assert data.contact_ratio_standard_error.sel(contact="c") == 0.01
    assert list(data.data_vars) == ["mean_displacement", "contact_ratio", "contact_ratio_standard_error"]
    assert "mean_displacement_standard_error" not in data


def test_variables_without_labels_are_left_out():
    data = statistics(["a"], [], {"mean_displacement": np.zeros(1), "contact_ratio": np.zeros(0)})
    assert list(data.variables) == ["mean_displacement", "oscillator"]


def test_every_default_statistic_has_its_error_and_its_units(result):
    for variable in (*STATISTICS.values(), *balances()):
        name, dimension, units, long_name = variable.name, variable.dimension, variable.units, variable.long_name
        variable, error = result[name], result[f"{name}_standard_error"]
        assert variable.dims == error.dims == (dimension,)
        assert variable.attrs["units"] == error.attrs["units"] == units
        assert variable.attrs["long_name"] == long_name
        assert variable.attrs["ancillary_variables"] == error.name


def test_attributes_follow_cf(result):
    assert result.attrs["Conventions"] == "CF-1.11"
    assert {"title", "source", "history", "references"} <= set(result.attrs)
    assert result.attrs["source"] == f"impactlab {il.__version__}"
    assert re.match(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ made by impactlab", result.attrs["history"])
    for value in result.attrs.values():
        assert isinstance(value, str | int | float)
        assert not isinstance(value, bool)
    for name, variable in result.variables.items():
        assert re.fullmatch(r"[A-Za-z]\w*", name)
        assert variable.attrs["long_name"] or name not in result.coords
        if variable.dtype.kind == "f":
            assert variable.attrs["units"], name
            assert variable.attrs["long_name"], name
        for other in variable.attrs.get("ancillary_variables", "").split():
            assert other in result


def test_numbers_that_say_how_it_was_made(result):
    assert (result.attrs["step"], result.attrs["duration"], result.attrs["spin_up"]) == (0.02, 2.0, 0.0)
    assert (result.attrs["realizations"], result.attrs["integrator"]) == (64, "ExactFlow")
    assert float(result.observation_time) == 2.0


def test_configuration_is_json(result, network):
    configuration = json.loads(result.attrs[CONFIGURATION])
    assert configuration == configuration_of(result)
    assert configuration["network"] == network.to_dict()


@pytest.mark.full
def test_the_order_of_names_is_kept():
    """That of bodies, contacts, sources and the weights of a combination, on which streams and labels depend."""
    bodies = {name: il.LinearOscillator(damping=0.2, stiffness=1.0) for name in "cab"}
    sides = il.Combination({"c": 1.0, "b": -0.5}), il.Combination({"b": 0.5, "a": -1.0})
    network = il.Network(
        bodies,
        {"second": il.Contact("c", "a", il.LinearContact(10.0)), "first": il.Contact(*sides, il.LinearContact(10.0))},
        {
            "wind": il.Source(il.WhiteNoise(1.0), on={"c": 1.0, "a": 0.5}),
            "base": il.Source(il.WhiteNoise(1.0), on={"b": 1.0}),
        },
    )
    result = il.simulate(network, 4.0, realizations=64, step=0.01, spin_up=0.0, rng=1)
    again = il.network_of(result)
    assert again == network
    assert repr(again) == repr(network)
    assert list(again.oscillators) == ["c", "a", "b"]
    xr.testing.assert_equal(il.rerun(result), result)


# Files


def test_file_is_the_dataset(result, network, tmp_path):
    path = tmp_path / "result.nc"
    digest = il.save(result, path)
    assert digest == hashlib.sha256(path.read_bytes()).hexdigest()
    xr.testing.assert_identical(load(path), result)
    with xr.open_dataset(path) as data:
        del data.attrs[DIGESTS]
        xr.testing.assert_identical(data.load(), result)
    assert il.network_of(path) == il.network_of(str(path)) == il.network_of(result) == network
    assert [file.name for file in tmp_path.iterdir()] == ["result.nc"]


def test_plain_to_netcdf_works(result, tmp_path):
    result.to_netcdf(tmp_path / "result.nc")
    xr.testing.assert_identical(load(tmp_path / "result.nc"), result)


def test_file_opens_without_xarray(result, tmp_path):
    il.save(result, tmp_path / "result.nc")
    with netCDF4.Dataset(tmp_path / "result.nc") as file:
        assert file.Conventions == "CF-1.11"
        assert file.data_model == "NETCDF4"
        assert list(file["oscillator"][:]) == ["body_0", "body_1"]
        assert file["mean_square_velocity"].units == "m2 s-2"
        np.testing.assert_array_equal(file["mean_square_velocity"][:], result.mean_square_velocity)
        assert file["displacement"].dimensions == ("realization", "time", "oscillator")


def test_every_array_of_numbers_has_a_checksum(result, tmp_path):
    tree = xr.DataTree.from_dict({"/hand": made_by_hand(), "/inside": result})
    il.save(result, tmp_path / "result.nc")
    il.save(tree, tmp_path / "tree.nc")
    with netCDF4.Dataset(tmp_path / "result.nc") as file, netCDF4.Dataset(tmp_path / "tree.nc") as groups:
        for group in (file, groups["hand"], groups["inside"]):
            checked = {name for name, item in group.variables.items() if item.filters()["fletcher32"]}
            numbers = {name for name, item in group.variables.items() if item.ndim and item.dtype is not str}
            assert checked == numbers
            assert checked


@pytest.mark.full
def test_coordinates_have_no_fill_values(result, tmp_path):
    """The conventions allow none, since no coordinate may be missing."""
    out = {"record": il.Trajectory(0.5), "out": tmp_path / "out.nc"}
    il.simulate(il.network_of(result), 2.0, realizations=64, step=0.02, spin_up=0.0, rng=1, **out).close()
    il.save(result.assign_coords(frequency=1.5), tmp_path / "result.nc")
    il.save(xr.DataTree.from_dict({"/inside": result}), tmp_path / "tree.nc")
    for name in ("result.nc", "tree.nc", "out.nc"):
        with netCDF4.Dataset(tmp_path / name) as file:
            group = file["inside"] if name == "tree.nc" else file
            for coordinate in ("time", "realization", "oscillator", *(["frequency"] if name == "result.nc" else [])):
                assert "_FillValue" not in group[coordinate].ncattrs(), f"{coordinate} in {name}"


def test_damage_is_found(tmp_path):
    """One bit is turned; without the checksum the wrong number would be read."""
    path = tmp_path / "result.nc"
    il.save(made_by_hand(), path)
    content = bytearray(path.read_bytes())
    place = content.index(np.array([1.5, 2.5]).tobytes())
    content[place + 6] ^= 1
    path.write_bytes(content)
    with pytest.raises(il.InvalidInput, match=r"result.nc cannot be read"):
        load(path)


def test_tree_round_trip(result, network, tmp_path):
    tree = xr.DataTree.from_dict({"/": xr.Dataset(attrs=result.attrs), "/statistics": result, "/hand": made_by_hand()})
    il.save(tree, tmp_path / "tree.nc")
    loaded = load(tmp_path / "tree.nc")
    assert loaded.identical(tree)
    assert il.network_of(tmp_path / "tree.nc") == il.network_of(loaded) == network


@pytest.mark.parametrize("old", [b"old", None])
def test_failure_in_the_middle_leaves_what_was_there(old, tmp_path, monkeypatch):
    path = tmp_path / "result.nc"
    if old is not None:
        path.write_bytes(old)

    def write_half(self, place, **options):
        Path(place).write_bytes(b"half")
        raise KeyboardInterrupt

    monkeypatch.setattr(xr.Dataset, "to_netcdf", write_half)
    with pytest.raises(KeyboardInterrupt):
        il.save(made_by_hand(), path)
    assert [file.read_bytes() for file in tmp_path.iterdir()] == ([] if old is None else [old])


def test_attribute_that_netcdf_cannot_hold_leaves_the_old_file(tmp_path):
    path = tmp_path / "result.nc"
    il.save(made_by_hand(), path)
    before = path.read_bytes()
    with pytest.raises(TypeError):
        il.save(made_by_hand().assign_attrs(bad=None), path)
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["result.nc"]


@pytest.mark.full
def test_threads_may_save_and_load_at_once(result, tmp_path):
    """The netCDF library itself crashes the process when two threads are in it."""
    failures = []

    def work(name):
        try:
            for _ in range(8):
                il.save(result, tmp_path / name)
                xr.testing.assert_identical(load(tmp_path / name), result)
        except BaseException as error:  # what a thread raises is lost otherwise
            failures.append(error)

    threads = [threading.Thread(target=work, args=(name,)) for name in ("one.nc", "two.nc", "two.nc")]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert failures == []
    assert sorted(file.name for file in tmp_path.iterdir()) == ["one.nc", "two.nc"]


# Bad input


def test_bad_places(tmp_path):
    data = made_by_hand()
    with pytest.raises(il.InvalidInput, match=r"is a folder; give the name of a file"):
        il.save(data, tmp_path)
    with pytest.raises(il.InvalidInput, match=r"Cannot write .*Give a folder that exists and is writable"):
        il.save(data, tmp_path / "nowhere" / "result.nc")
    (tmp_path / "file").write_text("text")
    with pytest.raises(il.InvalidInput, match=r"Cannot write .*Give a folder that exists and is writable"):
        il.save(data, tmp_path / "file" / "result.nc")
    with pytest.raises(il.InvalidInput, match=r"There is no file .*missing.nc"):
        il.network_of(tmp_path / "missing.nc")
    with pytest.raises(il.InvalidInput, match=r"file is no netCDF file, such as impactlab writes"):
        il.network_of(tmp_path / "file")


def test_what_is_not_a_result():
    with pytest.raises(il.InvalidInput, match=r"dataset must be a Dataset or a DataTree, not 3"):
        il.save(3, "result.nc")
    with pytest.raises(il.InvalidInput, match=r"source must be a Dataset, .*not 3"):
        il.network_of(3)
    with pytest.raises(il.InvalidInput, match=r"There is no attribute 'impactlab_configuration'"):
        il.network_of(xr.Dataset())
    with pytest.raises(il.InvalidInput, match=r"describes no network"):
        il.network_of(made_by_hand())


# Interrupts and full disks


@pytest.mark.skipif(os.name == "nt", reason="Windows sends no signals")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_waits_until_the_file_is_written(number, result, tmp_path, monkeypatch):
    """Inside of the netCDF library, and of the locks around it, it would leave them closed for ever."""
    usual, seen = xr.Dataset.to_netcdf, []

    def write(self, place, **options):
        os.kill(os.getpid(), number)
        time.sleep(0.01)  # where Python answers signals
        seen.append(place)
        return usual(self, place, **options)

    class Terminated(BaseException):
        pass

    def terminate(number, frame):
        raise Terminated

    before = signal.getsignal(signal.SIGINT), signal.signal(signal.SIGTERM, terminate)
    handlers = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    try:
        monkeypatch.setattr(xr.Dataset, "to_netcdf", write)
        with pytest.raises((KeyboardInterrupt, Terminated)):
            il.save(result, tmp_path / "result.nc")
        monkeypatch.setattr(xr.Dataset, "to_netcdf", usual)
        assert len(seen) == 2  # the data, then their digests
        assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == handlers
        xr.testing.assert_identical(load(tmp_path / "result.nc"), result)  # whole, and the locks are open
        thread = threading.Thread(target=il.save, args=(result, tmp_path / "other.nc"))
        thread.start()
        thread.join(30.0)
        assert not thread.is_alive()
    finally:
        signal.signal(signal.SIGTERM, before[1])


def test_handlers_of_signals_are_left_as_they_are_found():
    lock, before = UninterruptedLock(), signal.getsignal(signal.SIGTERM)
    try:
        for handler in (lambda number, frame: None, signal.SIG_DFL, signal.SIG_IGN, signal.default_int_handler):
            signal.signal(signal.SIGTERM, handler)
            with lock:
                pass
            assert signal.getsignal(signal.SIGTERM) == handler
    finally:
        signal.signal(signal.SIGTERM, before)


def test_an_interrupt_between_is_answered_at_once():
    lock = UninterruptedLock()
    with lock, lock:
        pass
    assert lock.acquire(blocking=False)
    lock.release()
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)


LIMITED = """
import os, resource, stat, sys
import numpy as np, xarray as xr
import impactlab as il
big, small = (xr.Dataset({"a": ("x", np.random.default_rng(1).random(count))}) for count in (500_000, 1000))
il.save(small, sys.argv[1])
resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, resource.RLIM_INFINITY))
for _ in range(2):
    try:
        il.save(big, sys.argv[1])
    except il.ImpactLabError as error:
        print(type(error).__name__, error)
il.save(small, sys.argv[1])
kept = [os.stat(f"/proc/self/fd/{name}") for name in os.listdir("/proc/self/fd") if name.isdigit() and int(name) > 2
        and os.path.exists(f"/proc/self/fd/{name}")]
kept += [os.stat(f"/proc/self/fd/{name}") for name in os.listdir("/proc/self/fd")
         if os.path.islink(f"/proc/self/fd/{name}") and "(deleted)" in os.readlink(f"/proc/self/fd/{name}")]
print("kept", sum(item.st_size for item in kept if stat.S_ISREG(item.st_mode) and item.st_nlink == 0))
"""


@pytest.mark.full
@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="needs to see open files")
def test_a_file_that_does_not_fit_is_said_and_its_space_comes_back(run_python, tmp_path):
    """The library does not close a file that it could not write; a disk that is full would stay so."""
    printed = run_python("-c", LIMITED, tmp_path / "result.nc").splitlines()
    assert [re.sub(r"cannot be written: .*", "cannot be written", line) for line in printed[:2]] == [
        f"ImpactLabError {tmp_path / 'result.nc'} cannot be written"
    ] * 2
    assert printed[2:] == ["kept 0"]
    assert [file.name for file in tmp_path.iterdir()] == ["result.nc"]
    assert load(tmp_path / "result.nc").sizes == {"x": 1000}


def test_a_full_disk_is_named(result, tmp_path, monkeypatch):
    def fail(self, place, **options):
        raise RuntimeError("NetCDF: HDF error")

    monkeypatch.setattr(xr.Dataset, "to_netcdf", fail)
    with pytest.raises(il.ImpactLabError, match=r"result\.nc cannot be written: the disk, a limit .*HDF error"):
        il.save(result, tmp_path / "result.nc")
    monkeypatch.setattr("shutil.disk_usage", lambda path: SimpleNamespace(free=4096))
    with pytest.raises(il.ImpactLabError, match=r"result\.nc cannot be written: no space is left in .*HDF error"):
        il.save(result, tmp_path / "result.nc")
    assert list(tmp_path.iterdir()) == []
