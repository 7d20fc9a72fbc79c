"""Sweeps: labels, random numbers, refused points, one compilation, and made again bit for bit."""

import concurrent.futures

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from laws import RunawayContact
from scenes import base, linear

import impactlab as il
from impactlab.compiling.jit import compilations

pytestmark = pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")

SHORT = {"duration": 2.0, "realizations": 16, "spin_up": 1.0, "rng": 1}
RATIOS = {"ratio": [8.0, 16.0], "clearance": [0.02, 0.05, 0.1]}


def at_clearance(clearance):
    """A network that is refused below 0, and that diverges at a clearance of exactly 1."""
    if clearance < 0.0:
        raise il.InvalidInput(f"The clearance is\nnegative: {clearance:g} m.")
    law = RunawayContact() if clearance == 1.0 else il.LinearContact(100.0)
    distance = 0.05 if clearance == 1.0 else clearance
    return linear().replace(contacts={"stop": il.Contact("a", il.WALL, law, clearance=distance)})


def assert_same(first, second):
    assert first.attrs.keys() == second.attrs.keys()
    xr.testing.assert_identical(first.drop_attrs(deep=False), second.drop_attrs(deep=False))


# what a sweep is


def test_every_combination_is_a_point():
    ratios = xr.DataArray([8.0, 16.0], dims="any", attrs={"units": "1", "long_name": "frequency ratio"})
    ds = il.sweep(base, {"ratio": ratios, "clearance": (0.02, 0.05, 0.1)}, **SHORT)
    assert ds.contact_ratio.dims == ("ratio", "clearance", "contact")
    assert ds.mean_displacement.dims == ("ratio", "clearance", "oscillator")
    assert ds.status.dims == ("ratio", "clearance")
    assert (ds.status == "done").all()
    assert ds.ratio.attrs == ratios.attrs
    assert ds.clearance.values.tolist() == [0.02, 0.05, 0.1]
    assert np.isfinite(ds.contact_ratio).all()
    assert ds.contact_ratio.attrs["units"] == "1"
    assert ds.step.dims == ("ratio", "clearance")
    assert ds.step.attrs["units"] == "s"
    assert (ds.realizations == 16).all()


@pytest.mark.full
@settings(max_examples=8)
@given(seed=st.integers(0, 2**70), clearance=st.floats(-0.01, 0.3), ratio=st.sampled_from([1.0, 16.0]))
def test_a_point_with_common_random_numbers_is_what_simulate_gives(seed, clearance, ratio):
    options = {**SHORT, "rng": seed, "record": [il.Density(bins=5), il.PerRealization(), il.Trajectory(0.5)]}
    ds = il.sweep(base, {"clearance": [clearance], "ratio": [ratio]}, common_random_numbers=True, **options)
    point = ds.isel(clearance=0, ratio=0)
    alone = il.simulate(base(ratio, clearance), step=point.step.item(), **options)
    for name in alone.variables:
        np.testing.assert_array_equal(point[name], alone[name], err_msg=name)
    for name in ("step", "duration", "spin_up", "realizations", "initial", "integrator", "drift"):
        np.testing.assert_array_equal(point[name].item(), alone.attrs[name])


def test_random_numbers_follow_from_the_values_of_a_point():
    def make(clearance, copy):
        return base(clearance=clearance)

    few = il.sweep(make, {"clearance": [0.05], "copy": [2]}, **SHORT)
    many = il.sweep(make, {"copy": [1.0, 2.0, 3.5], "clearance": [0.02, 0.05]}, **SHORT)
    np.testing.assert_array_equal(few.mean_displacement[0, 0], many.mean_displacement.sel(copy=2, clearance=0.05))
    assert len(np.unique(many.mean_displacement.sel(clearance=0.05, oscillator="one"))) == 3
    common = il.sweep(make, {"copy": [1.0, 2.0]} | {"clearance": [0.05]}, common_random_numbers=True, **SHORT)
    np.testing.assert_array_equal(*common.mean_displacement)


@pytest.mark.parametrize("common", [False, True])
@pytest.mark.parametrize("make_rng", [lambda: np.random.default_rng(3), lambda: np.random.SeedSequence(3)])
def test_every_kind_of_seed(make_rng, common):
    first, second = (
        il.sweep(base, {"clearance": [0.02, 0.05]}, common_random_numbers=common, **{**SHORT, "rng": make_rng()})
        for _ in range(2)
    )
    assert_same(first, second)
    if common:
        alone = il.simulate(base(), **{**SHORT, "step": first.step[1].item(), "rng": make_rng()})
        np.testing.assert_array_equal(first.mean_displacement[1], alone.mean_displacement)


def test_points_without_a_seed_are_independent_and_made_again():
    ds = il.sweep(lambda copy: base(), {"copy": [1, 2]}, **{**SHORT, "rng": None})
    assert (ds.mean_displacement[0] != ds.mean_displacement[1]).all()
    assert_same(ds, il.rerun(ds))


@pytest.mark.full
def test_values_may_be_texts_and_components():
    laws = [il.HertzContact(1e4), il.LinearContact(1e3)]

    def make(law, kind):
        noise = il.WhiteNoise(1.0) if kind == "white" else il.ShinozukaNoise(1.0, band=(0.0, 20.0), components=400)
        return linear().replace(contacts={"w": il.Contact("a", il.WALL, law)}, excitations={"a": noise})

    ds = il.sweep(make, {"law": laws, "kind": ["white", "bounded"]}, **{**SHORT, "spin_up": 0.0})
    assert ds.law.values.tolist() == ["HertzContact(stiffness=10000.0)", "LinearContact(stiffness=1000.0)"]
    assert (ds.sel(kind="bounded").status == "done").all()
    assert len(np.unique(ds.contact_ratio)) == 4


def test_options_of_a_single_point():
    def make(clearance, step):
        return base(clearance=clearance), {"step": step, "realizations": 8 if clearance < 0.1 else 24}

    ds = il.sweep(make, {"clearance": [0.05, 0.1], "step": [2e-3, 4e-3]}, record=il.PerRealization(), **SHORT)
    assert ds.step.dims == ("step",)  # the values of the sweep
    assert ds.realizations.values.tolist() == [[8, 8], [24, 24]]
    known = np.isfinite(ds.mean_displacement_by_realization).sum("realization").sel(oscillator="one")
    assert known.values.tolist() == [[8, 8], [24, 24]]
    assert_same(ds, il.rerun(ds))


def test_a_tolerance_for_every_point():
    ds = il.sweep(base, {"clearance": [0.02, 0.05]}, tolerance={"contact_ratio": 0.1}, rng=1)
    spent = np.abs(ds.contact_ratio_bias) + 2.0 * ds.contact_ratio_standard_error
    assert (spent <= 0.1 * ds.contact_ratio).all()


# refused points


def test_a_refused_point_loses_no_other():
    ds = il.sweep(at_clearance, {"clearance": [0.05, -0.1, 1.0, 0.2]}, **{**SHORT, "duration": 50.0})
    assert ds.status.values[[0, 3]].tolist() == ["done", "done"]
    assert ds.status.values[1] == "The clearance is negative: -0.1 m."
    assert "left the range of finite numbers" in ds.status.values[2]
    assert np.isnan(ds.contact_ratio.values[1:3]).all()
    assert np.isnan(ds.step.values[1:3]).all()
    assert ds.integrator.values.tolist() == ["ExactFlow", "", "", "ExactFlow"]
    alone = il.sweep(at_clearance, {"clearance": [0.2]}, **{**SHORT, "duration": 50.0})
    np.testing.assert_array_equal(ds.contact_ratio[3], alone.contact_ratio[0])
    assert_same(ds, il.rerun(ds))


def test_a_point_that_simulate_refuses(tmp_path):
    ds = il.sweep(base, {"ratio": [2.0, 256.0]}, step=5e-3, **SHORT)
    assert ds.status.values[0] == "done"
    assert "too large" in ds.status.values[1]
    assert il.network_of(ds.sel(ratio=256.0)) == base(256.0)
    il.save(ds, tmp_path / "sweep.nc")
    assert_same(ds, il.rerun(tmp_path / "sweep.nc"))


def test_a_sweep_that_is_refused_everywhere_says_why():
    with pytest.raises(il.InvalidInput, match=r"No point .*; at clearance=-1: The clearance is negative"):
        il.sweep(at_clearance, {"clearance": [-1, -2]}, **SHORT)
    with pytest.raises(il.InvalidInput, match=r"No point .* needs a duration"):
        il.sweep(base, {"clearance": [0.1]})
    with pytest.raises(il.Diverged, match=r"No point .* finite"):
        il.sweep(at_clearance, {"clearance": [1.0]}, **{**SHORT, "duration": 50.0})


@pytest.mark.parametrize(
    ("over", "message"),
    [
        ({}, "values by name"),
        ([0.1], "must be a mapping"),
        ({"clearance": []}, "no values of 'clearance'"),
        ({"clearance": 0.1}, r"must be a list, not 0\.1"),
        ({"clearance": "abc"}, "must be a list"),
        ({"clearance": [0.1, 0.2, 0.1]}, r"value 0\.1 of 'clearance' more than once"),
        ({"clearance": [1, 1.0]}, "more than once"),
        ({"clearance": [0.1, np.nan]}, r"clearance\[1\].*finite"),
        ({"clearence": [0.1]}, "cannot be called with the names of the sweep, clearence"),
        ({"ratio": [1.0], "clearance": [0.1], "mass": [1.0]}, "mass"),
        ({"oscillator": ["one"]}, "cannot have a dimension 'oscillator'"),
        ({"status": [1.0]}, "cannot have a dimension"),
        ({3: [1.0]}, "must be a string, not 3"),
    ],
)
def test_bad_values(over, message):
    with pytest.raises(il.InvalidInput, match=message):
        il.sweep(lambda ratio=1.0, clearance=0.1: pytest.fail("called"), over, **SHORT)


@pytest.mark.parametrize("made", [None, "network", (base(), 3), (base(),)])
def test_what_make_network_may_not_return(made):
    with pytest.raises(il.InvalidInput, match=r"must return an il\.Network, or a pair .* at clearance=0\.1"):
        il.sweep(lambda clearance: made, {"clearance": [0.1]}, **SHORT)


def test_unknown_options():
    with pytest.raises(il.InvalidInput, match=r"no option 'realisations' .*did you mean 'realizations'"):
        il.sweep(base, {"clearance": [0.1]}, duration=1.0, realisations=3)
    with pytest.raises(il.InvalidInput, match="no option 'rng' for a point"):
        il.sweep(lambda clearance: (base(), {"rng": 3}), {"clearance": [0.1]}, **SHORT)
    with pytest.raises(il.InvalidInput, match="make_network must be a function"):
        il.sweep(base(), {"clearance": [0.1]}, **SHORT)


def test_bodies_of_other_names_are_refused():
    def make(bodies):
        return il.chain(bodies, il.LinearOscillator(stiffness=1.0), il.HertzContact(1e4))

    with pytest.raises(il.InvalidInput, match=r"oscillators of a sweep .* at bodies=2 and .* at bodies=3"):
        il.sweep(make, {"bodies": [2, 3]}, **SHORT)
    with pytest.raises(il.InvalidInput, match="contacts of a sweep"):
        il.sweep(lambda apart: base().replace(contacts={"gap": None} if apart else {}), {"apart": [False, True]})


def test_an_error_in_make_network_is_not_hidden():
    with pytest.raises(ZeroDivisionError):
        il.sweep(lambda clearance: base(clearance=1.0 / clearance), {"clearance": [1.0, 0.0]}, **SHORT)


# how it runs


@pytest.mark.full
def test_points_share_one_compilation(monkeypatch, tmp_path):
    """Of two laws that nothing has compiled before, in the memory of this process or in files."""
    for place in ("build", "jit"):
        monkeypatch.setattr(f"impactlab.compiling.{place}.cache_folder", lambda: tmp_path)

    def law(factor):
        class Law(il.ContactLaw):
            @staticmethod
            def force(indentation):
                return factor * indentation

        return Law()

    def compiled(run, law):
        def network(ratio=16.0, clearance=0.05):
            return base(ratio, contacts={"gap": il.Contact("one", "two", law, clearance=clearance)})

        before = compilations()
        run(network)
        return compilations() - before

    il.simulate(base(), **SHORT)  # what all networks share
    once = compiled(lambda network: il.simulate(network(), **SHORT), law(1e3))
    assert once > 0
    assert 0 < compiled(lambda network: il.sweep(network, RATIOS, **SHORT), law(2e3)) <= once


@pytest.mark.full
def test_numbers_do_not_depend_on_the_executor():
    options = {**SHORT, "record": il.Trajectory(0.5)}
    expected = il.sweep(base, RATIOS, **options)
    with concurrent.futures.ThreadPoolExecutor(1) as pool:
        assert_same(expected, il.sweep(base, RATIOS, executor=pool, **options))
    with concurrent.futures.ProcessPoolExecutor(2) as pool:
        parts = []
        assert_same(expected, il.sweep(base, RATIOS, executor=pool, progress=parts.append, **options))
    assert parts == sorted(parts)


def test_progress_rises_to_one():
    parts = []
    il.sweep(base, RATIOS, progress=parts.append, **{**SHORT, "duration": 50.0})
    assert parts == sorted(parts)
    assert parts[-1] == 1.0
    assert all(0.0 <= part <= 1.0 for part in parts)


def test_an_interrupt_stops_every_point():
    """They would take hours."""

    def interrupt(part):
        if part > 0.0:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        il.sweep(base, RATIOS, progress=interrupt, **{**SHORT, "duration": 1e7, "realizations": 200})


@pytest.mark.filterwarnings("default::impactlab.AccuracyWarning")
def test_a_warning_is_given_once_and_names_the_points():
    with pytest.warns(
        il.AccuracyWarning, match=r"In 6 of 6 points, first 'ratio=8\.0, clearance=0\.02': Too few"
    ) as caught:
        ds = il.sweep(base, RATIOS, **SHORT)
    assert len(caught) == 1
    assert caught[0].filename == __file__
    assert caught[0].message.kind == "few_samples"
    assert ds.warnings.dims == (*RATIOS, "warning")
    assert ds.warning.values.tolist() == ["few_samples"]
    assert ds.warnings.str.startswith("Too few independent samples").all()


@pytest.mark.full
def test_records_that_can_be_read_once_are_for_every_point():
    records = [il.Density(bins=4), il.PerRealization()]
    listed = il.sweep(base, {"ratio": [8.0, 16.0]}, record=records, **SHORT)
    read_once = il.sweep(base, {"ratio": [8.0, 16.0]}, record=(record for record in records), **SHORT)
    assert np.isfinite(read_once.density_displacement.values).all()
    assert_same(read_once.drop_attrs(), listed.drop_attrs())
    of_a_point = il.sweep(lambda ratio: (base(ratio), {"record": iter(records)}), {"ratio": [8.0, 16.0]}, **SHORT)
    assert_same(of_a_point.drop_attrs(), listed.drop_attrs())


def test_whole_numbers_beyond_those_of_floats_have_their_own_random_numbers():
    ds = il.sweep(lambda c: base(), {"c": [2**53, 2**53 + 1]}, **SHORT)
    assert (ds.mean_displacement.values[0] != ds.mean_displacement.values[1]).all()


# references, files, and again


def test_exact_references_where_there_is_a_law():
    ds = il.sweep(base, {"ratio": [8.0, 16.0]}, reference=True, **SHORT)
    assert "temperatures" in ds.reference_status.values[0]
    assert ds.reference_status.values[1] == "done"
    exact = il.exact(base(16.0)).statistics()
    for name in exact.data_vars:
        assert np.isnan(ds[f"{name}_exact"][0]).all()
        np.testing.assert_array_equal(ds[f"{name}_exact"][1], exact[name])
        assert ds[f"{name}_exact"].attrs["units"] == exact[name].attrs["units"]
    assert_same(ds, il.rerun(ds))


def test_a_reference_where_nothing_was_simulated():
    ds = il.sweep(lambda step: (base(), {"step": step}), {"step": [5e-3, 1.0]}, reference=True, **SHORT)
    assert ds.status.values[1] != "done"
    assert np.isfinite(ds.contact_ratio_exact).all()
    refused = il.sweep(at_clearance, {"clearance": [0.1, -1.0]}, reference=True, **SHORT)
    assert refused.reference_status.values[1] == refused.status.values[1]


@pytest.mark.full
def test_a_file_is_made_again_bit_for_bit(tmp_path):
    record = [il.Density(bins=5), il.JointDensity("one", "two", bins=3), il.Trajectory(0.5)]
    ds = il.sweep(base, RATIOS, record=record, initial="rest", **SHORT)
    il.save(ds, tmp_path / "sweep.nc")
    again = il.rerun(tmp_path / "sweep.nc")
    assert_same(ds, again)
    il.save(again, tmp_path / "again.nc")
    assert again.attrs["impactlab_configuration"] == ds.attrs["impactlab_configuration"]


def test_a_part_of_a_sweep():
    ds = il.sweep(base, RATIOS, **SHORT)
    row, point = ds.sel(ratio=16.0), ds.sel(ratio=16.0, clearance=0.05)
    xr.testing.assert_equal(il.rerun(row), row.drop_vars("ratio"))
    assert il.network_of(point) == base(16.0, 0.05)
    alone = il.rerun(point)
    assert alone.attrs["step"] == point.step
    np.testing.assert_array_equal(alone.mean_square_displacement, point.mean_square_displacement)
    assert len(il.compare(point, il.exact(il.network_of(point))).comparison) == 13
    with pytest.raises(il.InvalidInput, match=r"describes no network\. Select one point"):
        il.network_of(ds)
    with pytest.raises(il.InvalidInput, match="lost its variables"):
        il.rerun(ds[["contact_ratio"]])
