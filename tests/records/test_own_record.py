"""Records of other packages: the example of the documentation, as a distribution offers it."""

import concurrent.futures
import importlib
import inspect
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from scenes import base

import impactlab as il

PAGE = Path(__file__).parents[2] / "docs" / "how_to" / "statistics.md"
OPTIONS = {"step": 0.005, "rng": 1, "spin_up": 2.0}


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    """A distribution that offers the record; its module imports numpy and impactlab alone."""
    folder = tmp_path_factory.mktemp("power")
    (text,) = re.findall(r"^```python\n(class MeanPower.*?)^```$", PAGE.read_text("utf-8"), re.MULTILINE | re.DOTALL)
    (folder / "power_package.py").write_text(f"import numpy as np\nimport impactlab as il\n\n\n{text}", "utf-8")
    info = folder / "power-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: power\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[impactlab.components]\nMeanPower = power_package:MeanPower\n")
    sys.path.insert(0, str(folder))
    importlib.invalidate_caches()
    yield importlib.import_module("power_package")
    sys.path.remove(str(folder))


@pytest.fixture(scope="module")
def record(package):
    return package.MeanPower("gap", "one", "two")


def of_paths(run):
    """Mean of |F v| of each realization, from its path."""
    velocity = run.velocity.sel(oscillator="one") - run.velocity.sel(oscillator="two")
    return np.abs(run.contact_force.sel(contact="gap") * velocity)[:, 1:].mean("time")


@pytest.mark.parametrize("other", [[], [il.Density(bins=5)]])
def test_it_is_the_mean_over_the_paths(record, other):
    run = il.simulate(base(), 4.0, realizations=64, record=[record, il.Trajectory(0.005), *other], **OPTIONS)
    each = of_paths(run)
    np.testing.assert_allclose(run.mean_power, each.mean(), rtol=1e-12)
    skewness = ((each - each.mean()) ** 3).mean() / each.std() ** 3
    error = (1.0 + 7.0 / 6.0 * skewness**2 / 64.0) * each.std(ddof=1) / 8.0
    np.testing.assert_allclose(run.mean_power_standard_error, error, rtol=1e-12)
    assert run.mean_power.attrs["units"] == "W"


def test_of_few_realizations_batches_tell_the_error(record):
    run = il.simulate(base(), 1100.0, realizations=2, record=record, step=0.005, rng=1)
    many = il.simulate(base(), 30.0, realizations=64, record=record, step=0.005, rng=2)
    assert 0.0 < run.mean_power_standard_error < 0.2 * run.mean_power
    error = np.hypot(run.mean_power_standard_error, many.mean_power_standard_error)
    assert abs(run.mean_power - many.mean_power) < 4.0 * error


@pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")
def test_numbers_do_not_depend_on_the_blocks(record):
    whole = il.simulate(base(), 0.5, realizations=700, record=[record, il.PerRealization()], **OPTIONS)
    path = il.simulate(base(), 0.5, realizations=700, record=il.Trajectory(0.005), **OPTIONS)
    np.testing.assert_allclose(whole.mean_power, of_paths(path).mean(), rtol=1e-12)


@pytest.mark.campaign
@pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")
def test_numbers_of_processes_are_the_same(record):
    threads = il.simulate(base(), 0.5, realizations=700, record=record, **OPTIONS)
    with concurrent.futures.ProcessPoolExecutor(2) as pool:
        processes = il.simulate(base(), 0.5, realizations=700, record=record, executor=pool, **OPTIONS)
    assert processes.mean_power.values == threads.mean_power.values


def test_points_of_a_sweep_are_those_alone(record):
    contact = base().contacts["gap"]
    points = {gap: base().replace(contacts={"gap": contact.replace(clearance=gap)}) for gap in (0.04, 0.05, 0.06)}
    options = {"duration": 2.0, "realizations": 64, "record": record, "step": 0.005, "rng": 1}
    swept = il.sweep(lambda gap: points[gap], {"gap": list(points)}, common_random_numbers=True, **options)
    assert swept.mean_power.dims == ("gap",)
    assert np.isfinite(swept.mean_power_standard_error).all()
    for gap, network in points.items():
        assert il.simulate(network, **options).mean_power.values == swept.mean_power.sel(gap=gap).values


def test_a_name_that_is_not_there_is_refused(package):
    with pytest.raises(il.InvalidInput, match="MeanPower: there is no contact 'gpa'"):
        il.simulate(base(), 1.0, record=package.MeanPower("gpa", "one", "two"))
    with pytest.raises(il.InvalidInput, match="There is no oscillator 'tow'; did you mean 'two'"):
        il.simulate(base(), 1.0, realizations=64, record=package.MeanPower("gap", "one", "tow"))


@pytest.mark.campaign
def test_a_file_is_rerun_where_the_class_is_offered(record, package, tmp_path, run_python):
    """And refused, with its name, where it is not."""
    options = {**OPTIONS, "realizations": 64, "record": record}
    run = il.simulate(base(), 1.0, **options)
    il.save(run, tmp_path / "run.nc")
    again = f"import impactlab as il; print(repr(il.rerun({str(tmp_path / 'run.nc')!r}).mean_power.item()))"
    path = str(Path(package.__file__).parent)
    assert run_python("-c", f"import sys; sys.path.append({path!r}); {again}").strip() == repr(run.mean_power.item())
    refused = f"import impactlab as il\ntry:\n    {again}\nexcept il.InvalidInput as error:\n    print(error)"
    assert "No component class named 'MeanPower' is defined" in run_python("-c", refused)


CONTRACT = {
    il.RecordedRun: {
        "realizations": None, "step": None, "duration": None, "parts": None,
        "interval": "(self, ratio)", "names": "(self, quantity)",
        "values": "(self, snapshots, quantity, names=None)", "mean": "(self, sums, samples)",
    },
    il.Keeper: {
        "wants_start": None, "own": "(self, snapshots)", "start": "(self, values)", "add": "(self, snapshots, batch)",
        "result": "(self)", "__init__": "(self, ratio=1, early=0)",
    },
    il.Record: {
        "every_step": None, "summed": None, "identity": None, "first_sample": None, "exact_interval": "(self)",
        "keeper": "(self, run, realizations, ratio)", "label": "(self, run, results, interval)",
        "resolved": "(self, model)", "stride": "(self, model, step)",
        "bytes_per_realization": "(self, run, interval)", "bytes_per_block": "(self, run)",
    },
}  # fmt: skip
"""What records of other packages may use, with their arguments; nothing of it goes or changes."""


@pytest.mark.parametrize("cls", CONTRACT)
def test_what_records_use_stays(cls):
    for name, arguments in CONTRACT[cls].items():
        member = getattr(cls, name)
        if arguments is not None:
            signature = inspect.signature(member)
            plain = [item.replace(annotation=inspect.Parameter.empty) for item in signature.parameters.values()]
            assert str(inspect.Signature(plain)) == arguments, name
        assert name == "__init__" or not callable(member) or inspect.getdoc(member)
