"""Records of linear forms: ways to write forms, files, sweeps, going on, points of structures, mixtures with others."""

import warnings

import numpy as np
import pytest
import xarray as xr
from test_extremes import DRIFT, towers

import impactlab as il
from impactlab.records.linear_forms import Form, forms_given

pytestmark = pytest.mark.full

RECORDS = [
    il.Extremes({"drift": DRIFT, "force": "gap", "speed": ("velocity", "upper")}, windows=(2.0, 4.0)),
    il.Cycles({"drift": DRIFT, "force": "gap"}, exponent=4.0),
    il.Correlation((0.0, 0.1, 0.3), ("upper", ("contact_force", "gap"))),
    il.Correlation((0.0, 0.1), "upper", cyclic=0.4, phases=2),
]


def numbers(dataset):
    return dataset[[name for name, item in dataset.data_vars.items() if item.dtype.kind in "fiu"]].drop_attrs()


@pytest.fixture(scope="module")
def run():
    return il.simulate(towers(), 10.0, realizations=64, record=RECORDS, rng=1)


def test_ways_to_write_forms():
    drift = Form("drift", (("", "upper", 1.0), ("velocity", "lower", -0.5)))
    given = {"drift": {"upper": 1.0, ("velocity", "lower"): -0.5}, "top": "upper"}
    assert forms_given("of", given) == (drift, Form("top", (("", "upper", 1.0),)))
    assert forms_given("of", "upper") == (Form("upper", (("", "upper", 1.0),)),)
    speed = Form("velocity of upper", (("velocity", "upper", 1.0),))
    assert forms_given("of", ("velocity", "upper")) == forms_given("of", [("velocity", "upper")]) == (speed,)
    assert [form.name for form in forms_given("of", ["upper", ("velocity", "upper")])] == ["upper", "velocity of upper"]
    for record in RECORDS:
        assert il.Record.from_dict(record.to_dict()) == eval(repr(record), vars(il)) == record


def test_units_are_those_of_the_forms():
    ds = il.simulate(towers(), 4.0, realizations=64, record=il.Extremes({"drift": DRIFT}, windows=(2.0,)), rng=1)
    assert ds.extreme_mean.attrs["units"] == ds.extreme_return_level.attrs["units"] == "m"
    mixed = il.Extremes({"brake": {"upper": 36.0, ("velocity", "upper"): 0.6}}, windows=(2.0,))
    ds = il.simulate(towers(), 4.0, realizations=64, record=mixed, rng=1)
    assert "units" not in ds.extreme_mean.attrs
    assert "36 × displacement of upper + 0.6 × velocity of upper (mixed units)" in ds.extreme_form.attrs["comment"]


def test_all_bodies_and_contacts_by_default():
    ds = il.simulate(towers(), 4.0, realizations=64, record=il.Correlation((0.0, 0.1)), rng=1)
    assert ds.correlation_form.values.tolist() == ["upper", "lower", "gap"]
    ds = il.simulate(towers(il.RigidContact(0.8)), 4.0, realizations=64, record=il.Correlation((0.0, 0.1)), rng=1)
    assert ds.correlation_form.values.tolist() == ["upper", "lower"]


def test_files_keep_and_repeat_them(run, tmp_path):
    path = tmp_path / "run.nc"
    run.to_netcdf(path)
    with xr.open_dataset(path) as kept:
        xr.testing.assert_identical(numbers(kept.load()), numbers(run))
    xr.testing.assert_identical(numbers(il.rerun(path)), numbers(run))
    for text in ("Hosking", "Downing"):
        assert text in il.citation(path)


def test_they_change_nothing_and_do_not_depend_on_others(run):
    plain = il.simulate(
        towers(), 10.0, realizations=64, record=il.Cycles(RECORDS[1].of, exponent=4.0), step=run.step, rng=1
    )
    xr.testing.assert_identical(numbers(plain), numbers(run)[list(numbers(plain))])


def test_blocks_do_not_matter(run, monkeypatch):
    """Realizations in one thread and in several blocks have the same extremes, damage and correlations."""
    from concurrent.futures import ThreadPoolExecutor

    with ThreadPoolExecutor(3) as pool:
        again = il.simulate(towers(), 10.0, realizations=64, record=RECORDS, rng=1, executor=pool)
    xr.testing.assert_allclose(numbers(again), numbers(run), rtol=1e-12)


def test_a_sweep_has_them():
    def make(clearance):
        network = towers()
        return network.replace(contacts={"gap": network.contacts["gap"].replace(clearance=clearance)})

    options = {"duration": 4.0, "realizations": 64, "record": RECORDS[:3], "step": 0.005, "rng": 1}
    swept = il.sweep(make, {"clearance": [0.02, 0.05]}, common_random_numbers=True, **options)
    alone = il.simulate(make(0.05), **options)
    for name in ("extreme_mean", "cycle_damage_rate", "correlation", "window_maximum"):
        np.testing.assert_array_equal(swept[name].sel(clearance=0.05), alone[name], err_msg=name)


def test_points_of_structures_have_forms():
    """The force of an actuator and the tip of a beam: a point is a sum of its coordinates."""
    beam = il.ModalStructure((10.0, 60.0), 0.02, points={"tip": (2.0, -2.0), "middle": (0.7, 1.4)})
    network = il.Network({"beam": beam}, excitations={"push": il.Source(il.WhiteNoise(1.0), on="beam.tip")})
    record = [il.Extremes({"bend": {"beam.tip": 1.0, "beam.middle": -1.0}}, windows=(1.0,)), il.Trajectory(0.002)]
    ds = il.simulate(network, 3.0, realizations=64, record=record, step=0.002, rng=1)
    tip, middle = (ds.point_displacement.sel(point=f"beam.{name}") for name in ("tip", "middle"))
    most = (tip - middle).max("time")
    found = ds.window_maximum.max("extreme_block")[:, 0]
    assert (found >= most - 1e-12).all()
    np.testing.assert_allclose(found, most, rtol=0.01)


@pytest.mark.parametrize("record", RECORDS, ids=lambda record: type(record).__name__)
def test_paths_without_noise_have_them_by_steps(record):
    """Where nothing is random: by steps, which the result says; from event to event they are refused in one line."""
    network = towers().replace(excitations={"upper": il.Harmonic(3.0, frequency=5.0), "lower": None})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", il.ImpactLabWarning)
        ds = il.simulate(network, 8.0, record=record)
    assert f"EventLocated keeps no {type(record).__name__}" in ds.attrs["integrator_reason"]
    with pytest.raises(il.InvalidInput, match=f"EventLocated keeps no {type(record).__name__}"):
        il.simulate(network, 8.0, record=record, integrator=il.EventLocated())


def test_other_methods_have_the_same_statistics(run):
    options = {"integrator": il.RungeKutta4(), "step": 0.002, "rng": 2}
    ds = il.simulate(towers(), 10.0, realizations=64, record=RECORDS[:3], **options)
    for name in ("extreme_mean", "cycle_damage_rate", "correlation"):
        error = np.hypot(ds[f"{name}_standard_error"], run[f"{name}_standard_error"]).values
        assert (np.abs((ds[name] - run[name]).values) <= 4.5 * error).all(), name


def test_plots(run):
    for draw in (il.plot.extremes, il.plot.cycles, il.plot.correlation):
        assert draw(run).has_data()
        with pytest.raises(il.InvalidInput, match="'drit' is not in the result"):
            draw(run, "drit")
    axes = il.plot.correlation(run, "upper", "contact_force of gap")
    assert axes.lines[0].get_label() == "upper, then contact_force of gap"
    with pytest.raises(il.InvalidInput, match="kind is one of"):
        il.plot.extremes(run, kind="least")
