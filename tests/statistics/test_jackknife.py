"""Functions of statistics with their errors, and effective sample sizes."""

import numpy as np
import pytest
from scenes import base, linear

import impactlab as il

RUN = {"duration": 20.0, "realizations": 64, "record": il.PerRealization()}


@pytest.fixture(scope="module")
def run():
    return il.simulate(base(), rng=1, **RUN)


def test_a_statistic_itself_is_what_the_run_says(run):
    """With the same balances: the two bodies touch, so that all of them are controls of both."""
    for name in ("mean_square_displacement", "mean_square_velocity", "variance_displacement"):
        found, error = il.jackknife(run, lambda s, name=name: s[name]), run[f"{name}_standard_error"]
        # a variance is not linear in the means: the jackknife takes a bias of the order 1/n away
        np.testing.assert_array_less(abs(found.value - run[name]) / error, 0.3 if name.startswith("var") else 1e-9)
        np.testing.assert_allclose(found.standard_error, error, rtol=0.02 if name.startswith("var") else 1e-9)


@pytest.mark.campaign
def test_intervals_of_a_ratio_cover():
    """A ratio of dependent statistics with an exact value; the standard error of the coverage is 1.5 %."""

    def force_in_contact(s):
        return s.mean_contact_force / s.contact_ratio

    expected = float(force_in_contact(il.exact(base()).statistics())[0])
    scores = []
    everything = il.simulate(base(), rng=2, **RUN | {"duration": 5.0, "realizations": 200 * 64})
    for first in range(0, 200 * 64, 64):
        found = il.jackknife(everything.isel(realization=slice(first, first + 64)), force_in_contact)
        scores.append((float(found.value[0]) - expected) / float(found.standard_error[0]))
    assert 0.905 <= np.mean(np.abs(scores) < 2.0) <= 0.985
    assert 0.85 < np.std(scores) < 1.15
    assert abs(np.mean(scores)) < 4.0 / np.sqrt(200.0)


def test_the_bias_of_a_quotient_is_taken_away():
    """The quotient of two means of n: the pseudo-values are those of the formula, written out."""
    rng = np.random.default_rng(5)
    a, b = rng.gamma(2.0, size=(2, 64))
    names = {"mean_square_displacement_by_realization": a, "mean_square_velocity_by_realization": b}
    ds = il.simulate(linear(), rng=1, **RUN)[[]].assign_coords(oscillator=["a"])
    ds = ds.assign({name: (("realization", "oscillator"), item[:, None]) for name, item in names.items()})
    found = il.jackknife(ds, lambda s: s.mean_square_displacement / s.mean_square_velocity)
    each = np.array([np.delete(a, k).sum() / np.delete(b, k).sum() for k in range(64)])
    pseudo = 64.0 * a.sum() / b.sum() - 63.0 * each
    assert float(found.value[0]) == pytest.approx(pseudo.mean(), rel=1e-12)
    assert float(found.standard_error[0]) == pytest.approx(pseudo.std(ddof=1) / 8.0, rel=1e-12)


def test_labels_stay(run):
    found = il.jackknife(run, lambda s: s.mean_square_displacement.sel(oscillator="one") / s.contact_ratio)
    assert found.value.dims == ("contact",)
    total = il.jackknife(run, lambda s: (s.mean_square_velocity * [1.0, 2.0]).sum("oscillator"))
    assert total.value.dims == ()


@pytest.mark.parametrize(
    "function", [lambda s: s.contact_ratio.values, lambda s: s.contact_ratio.mean(), lambda s: 1.0]
)
def test_functions_that_lose_the_realizations_are_refused(run, function):
    with pytest.raises(il.InvalidInput, match="keep all dimensions it does not reduce by name"):
        il.jackknife(run, function)


def test_what_the_jackknife_needs_is_said(run):
    with pytest.raises(il.InvalidInput, match=r"record=il\.PerRealization"):
        il.jackknife(il.simulate(linear(), 20.0, realizations=64, rng=1), lambda s: s.mean_displacement)
    with pytest.raises(il.InvalidInput, match="at least 64 realizations, not 20"):
        il.jackknife(run.isel(realization=slice(20)), lambda s: s.mean_displacement)
    with pytest.raises(il.InvalidInput, match="a point of the sweep, of clearance"):
        il.jackknife(run.expand_dims(clearance=[0.05]), lambda s: s.mean_displacement)


def test_effective_samples_are_those_of_independent_ones():
    """Of states so far apart that they are independent: one a realization and batch of a long linear run."""
    network = linear(ratio=0.5)
    options = {"realizations": 256, "rng": 1, "step": 5.0, "integrator": il.ExactFlow(jumps=False)}
    ds = il.simulate(network, 50.0, spin_up=10.0, initial="rest", **options)
    number = float(il.effective_samples(ds).direct_mean_displacement_effective_samples[0])
    # ten states after steps of 16 relaxation times; the scatter of a variance of 256 is 9 %
    assert number == pytest.approx(2560.0, rel=0.3)


def test_effective_samples_of_a_run(run):
    found = il.effective_samples(run)
    ratio, error = run.contact_ratio.values[0], run.contact_ratio_standard_error.values[0]
    assert float(found.contact_ratio_effective_samples[0]) == pytest.approx(ratio * (1.0 - ratio) / error**2)
    assert (found.mean_displacement_effective_samples > found.direct_mean_displacement_effective_samples).all()
    with pytest.raises(il.InvalidInput, match="with its standard errors"):
        il.effective_samples(il.exact(base()).statistics())
