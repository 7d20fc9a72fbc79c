"""Random networks of all mechanisms: no record, sweep, file or number of realizations changes a number of a run."""

import numpy as np
import pytest
import xarray as xr
from impactlab_numerics.trust.judge import judge
from impactlab_numerics.trust.mixtures import CLASSES, coarse
from impactlab_numerics.trust.networks import scene_of

import impactlab as il

pytestmark = [pytest.mark.campaign, pytest.mark.filterwarnings("ignore::impactlab.ImpactLabWarning")]

SEEDS = range(8)
REALIZATIONS = 5


def run(network, **options):
    return il.simulate(network, rng=3, **options)


def numbers(dataset, names=None):
    """Variables of numbers by name, without their attributes."""
    chosen = names or [name for name, item in dataset.data_vars.items() if item.dtype.kind in "fiub"]
    return dataset[list(chosen)].drop_attrs()


@pytest.fixture(scope="module", params=SEEDS)
def mixed(request):
    """Network, options of a short run at a step of its own, and the run with all records."""
    network, options = coarse(scene_of(request.param, CLASSES))
    records = [il.PerRealization(), il.FinalState(), il.Trajectory(4 * options["step"])]
    return network, options, run(network, record=records, **options)


def test_records_change_no_statistic(mixed):
    network, options, recorded = mixed
    plain = run(network, **options)
    xr.testing.assert_identical(numbers(recorded, list(numbers(plain))), numbers(plain))


def test_a_sweep_has_the_numbers_of_each_run(mixed):
    network, options, _ = mixed
    factors = [1.0, 1.1]

    def make(factor):
        contacts = {name: item.replace(clearance=factor * item.clearance) for name, item in network.contacts.items()}
        return network.replace(contacts=contacts)

    record = [il.PerRealization(), il.Trajectory(4 * options["step"])]
    swept = il.sweep(make, {"factor": factors}, rng=3, common_random_numbers=True, record=record, **options)
    for factor in factors:
        alone = numbers(run(make(factor), record=record, **options))
        point = numbers(swept.sel(factor=factor, drop=True), list(alone))
        for name in alone:
            np.testing.assert_array_equal(point[name].values, alone[name].values, err_msg=name)


def test_a_file_repeats_its_run(mixed, tmp_path):
    *_, recorded = mixed
    il.save(recorded, tmp_path / "result.nc")
    xr.testing.assert_identical(numbers(il.rerun(tmp_path / "result.nc")), numbers(recorded))


def test_a_realization_is_the_same_among_few_and_many(mixed):
    network, options, recorded = mixed
    few = run(network, **options | {"realizations": 2}, record=[il.PerRealization(), il.FinalState()])
    for name in few:
        if "realization" in few[name].dims and "batch" not in few[name].dims:
            np.testing.assert_array_equal(few[name].values, recorded[name].values[:2], err_msg=name)


@pytest.mark.parametrize("seed", range(8))
def test_no_mixture_is_silently_wrong(seed):
    found = judge(seed, CLASSES, body_steps=2e7, share=0.25)
    assert found["outcome"] not in ("silently wrong", "diverged", "failed"), found["messages"]
