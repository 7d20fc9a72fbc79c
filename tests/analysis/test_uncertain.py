"""Statistics over uncertain numbers, and what noise and numbers do to them."""

import numpy as np
import pytest
import scipy.stats

import impactlab as il
from impactlab.statistics.sensitivity import Sensitivity

STIFFNESS, DAMPING = scipy.stats.lognorm(0.15, scale=20.0), scipy.stats.uniform(0.5, 0.3)
NAME = "mean_square_displacement"


def make(stiffness, damping):
    body = il.LinearOscillator(stiffness=stiffness, damping=damping)
    return il.Network({"a": body}, excitations={"a": il.WhiteNoise(1.0)})


NETWORK = make(il.Uncertain(STIFFNESS), il.Uncertain(DAMPING))
PLACES = ["oscillators.a.damping", "oscillators.a.stiffness"]


def known(power=1):
    """Means over the draws of powers of E[x²] = πS/(c k), a product of independent factors."""
    of_stiffness = STIFFNESS.expect(lambda k: k**-power)
    return np.pi**power * of_stiffness * DAMPING.expect(lambda c: c**-power)


def index_of_stiffness():
    return np.pi**2 * STIFFNESS.expect(lambda k: 1 / k) ** 2 * (
        np.exp(0.15**2) - 1.0
    ) * DAMPING.expect(lambda c: 1 / c) ** 2 / (known(2) - known() ** 2)  # fmt: skip


@pytest.fixture(scope="module")
def result():
    return il.simulate(NETWORK, 50.0, realizations=512, rng=2)


def score(dataset, name, value):
    return (dataset[name].values.ravel() - value) / dataset[f"{name}_standard_error"].values.ravel()


@pytest.mark.full
def test_means_and_parts_of_the_variance(result):
    assert abs(score(result, NAME, known())) < 3.0
    assert abs(score(result, "variance_displacement", known())) < 3.0
    assert abs(score(result, f"{NAME}_parameter_variance", known(2) - known() ** 2)) < 3.0
    indices = result[f"{NAME}_sobol_index"].sel(parameter=PLACES[1])
    assert abs(indices.item() - index_of_stiffness()) < 3.0 * result[f"{NAME}_sobol_index_standard_error"].max()
    assert (result[f"{NAME}_sobol_index_standard_error"] < 0.2).all()
    # of the power of a linear body the mean is that of the noise, whatever its stiffness
    assert abs(score(result, "mean_square_velocity", np.pi * DAMPING.expect(lambda c: 1 / c))) < 3.0
    assert result["mean_square_velocity_sobol_index"].sel(parameter=PLACES[0]).item() > 0.6


@pytest.mark.full
def test_the_variance_by_noise_is_that_of_one_network(result):
    """Of a narrow distribution it is the variance of the time averages of one network."""
    narrow = make(il.Uncertain("uniform", location=20.0, scale=1e-6), 0.6)
    found = il.simulate(narrow, 50.0, realizations=512, rng=1)
    alone = il.simulate(make(20.0, 0.6), 50.0, realizations=512, record=il.PerRealization(), rng=3)
    variance = alone[f"{NAME}_by_realization"].var("realization", ddof=1).item()
    assert found[f"{NAME}_noise_variance"].item() == pytest.approx(variance, rel=0.3)
    assert np.isnan(found[f"{NAME}_sobol_index"]).all()
    assert abs(score(found, f"{NAME}_parameter_variance", 0.0)) < 3.0


@pytest.mark.full
def test_files_reruns_and_single_draws(result, tmp_path):
    result.to_netcdf(tmp_path / "uncertain.nc")
    again = il.rerun(tmp_path / "uncertain.nc")
    for name, values in result.data_vars.items():
        np.testing.assert_array_equal(again[name].transpose(*values.dims).values, values.values)
    assert il.network_of(result) == NETWORK == il.Network.from_toml(NETWORK.to_toml())
    numbers = dict(zip(PLACES, result.parameter_value.values[0].tolist(), strict=True))
    first = NETWORK.with_numbers(numbers)
    assert not first.is_uncertain
    assert first.oscillators["a"].stiffness == numbers[PLACES[1]]


@pytest.mark.full
def test_common_draws_in_sweeps(tmp_path):
    stop = il.LinearContact(200.0)
    swept = il.sweep(
        lambda clearance: NETWORK.replace(contacts={"stop": il.Contact("a", il.WALL, stop, clearance=clearance)}),
        {"clearance": [0.2, 0.4]}, duration=10.0, realizations=512, rng=1, common_random_numbers=True,
    )  # fmt: skip
    assert (swept.parameter_value[0] == swept.parameter_value[1]).all()
    ratio = swept.contact_ratio.values[:, 0]
    assert ratio[0] > ratio[1] > 0.0
    swept.to_netcdf(tmp_path / "swept.nc")
    again = il.rerun(tmp_path / "swept.nc")
    np.testing.assert_array_equal(again.contact_ratio.values, swept.contact_ratio.values)


@pytest.mark.full
def test_functions_of_uncertain_numbers_where_nothing_is_random():
    def forced(frequency):
        body = il.LinearOscillator.from_frequency(frequency, 0.1)
        return il.Network({"a": body}, excitations={"a": il.Harmonic(1.0, frequency=2.0)})

    over = {"frequency": scipy.stats.uniform(4.0, 1.0)}
    found = il.uncertain(forced, over, 40.0 * np.pi, realizations=64, spin_up=60.0, rng=1)
    exact = [0.5 / ((w**2 - 4.0) ** 2 + (0.4 * w) ** 2) for w in found.parameter_value.values[:, 0]]
    np.testing.assert_allclose(found[f"{NAME}_by_draw"].values[:, 0], exact, rtol=1e-4)
    assert found[f"{NAME}_noise_variance"].item() == 0.0
    assert found[f"{NAME}_sobol_index"].item() == pytest.approx(1.0, abs=0.02)
    more = il.uncertain(forced, over, 1.0, realizations=70, rng=1)
    assert (more.parameter_value[:64] == found.parameter_value).all()


def test_places_of_uncertain_numbers():
    stiffness = il.Uncertain(STIFFNESS)
    gap = il.Contact("a", "b", il.HertzContact(stiffness), clearance=il.Uncertain(DAMPING))
    bodies = {name: il.LinearOscillator(stiffness=stiffness) for name in "ab"}
    network = il.Network(bodies, {"gap": gap}, {"a": il.Harmonic(il.Uncertain(DAMPING), frequency=2.0)})
    places = [
        "oscillators.a.stiffness", "oscillators.b.stiffness", "contacts.gap.law.stiffness", "contacts.gap.clearance",
        "excitations.a.amplitude",
    ]  # fmt: skip
    assert list(network.uncertain_numbers) == places
    made = network.with_numbers({places[1]: 3.0, places[2]: 5.0})
    assert made.oscillators["b"].stiffness == 3.0
    assert made.contacts["gap"].law == il.HertzContact(5.0)
    assert list(made.uncertain_numbers) == [places[0], *places[3:]]
    assert il.Network.from_dict(network.to_dict()) == network == il.Network.from_toml(network.to_toml())
    row = il.chain(3, bodies["a"], il.HertzContact(1.0), clearance=[il.Uncertain(DAMPING), 0.1])
    assert list(row.uncertain_numbers)[3:] == ["contacts.contact_0.clearance"]


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (lambda: il.LinearOscillator(stiffness=il.Uncertain(scipy.stats.norm(4.0, 1.0))), r"stiffness.* -1\.99781 to"),
        (lambda: il.HertzContact(il.Uncertain("uniform", location=-1.0)), "HertzContact.stiffness is drawn from -1 to"),
        (lambda: il.ShinozukaNoise(1.0, components=il.Uncertain(STIFFNESS)), "components must be a whole number"),
        (lambda: il.LinearOscillator.from_frequency(il.Uncertain(STIFFNESS)), "il.uncertain takes functions"),
        (lambda: 2.0 * il.Uncertain(STIFFNESS), "no single number"),
        (lambda: il.Uncertain(3.0), "takes a distribution of scipy.stats"),
        (lambda: il.Uncertain("lognormal"), "did you mean 'lognorm'"),
        (lambda: il.Uncertain("lognorm"), "takes the shapes s"),
        (lambda: il.Uncertain(scipy.stats.poisson(3.0)), "no continuous distribution 'poisson'"),
        (lambda: il.exact(NETWORK), "uncertain numbers .oscillators.a.damping"),
        (NETWORK.check, "network.with_numbers"),
        (lambda: NETWORK.with_numbers({"stiffness": 1.0}), "no uncertain number 'stiffness'"),
        (lambda: il.simulate(NETWORK, 1.0), "realizations must be at least 512 and a multiple of 8"),
        (lambda: il.simulate(NETWORK, 1.0, realizations=512, out="x.nc"), "out= is for a network without uncertain"),
        (lambda: il.uncertain(make(1.0, 1.0), None, 1.0, realizations=512), "in the place of some of its numbers"),
    ],
)
def test_what_cannot_be_drawn_is_refused(made, said):
    with pytest.raises(il.InvalidInput, match=said):
        made()


@pytest.mark.parametrize(
    ("over", "said"),
    [
        ({"stiffness": scipy.stats.norm(20.0, 5.0), "damping": DAMPING}, "distribution of 'stiffness'"),
        ({"stiffness": 3.0, "damping": DAMPING}, "over, 'stiffness': Uncertain takes a distribution"),
        ({}, "distributions by name"),
        ({"mass": DAMPING}, "cannot be called with the names mass"),
    ],
)
def test_bad_distributions_are_refused_by_name(over, said):
    with pytest.raises(il.InvalidInput, match=said):
        il.uncertain(make, over, 10.0, realizations=512)


def held(draws, seeds):
    """Shares of analyses in which two errors hold what is known of a sum of normal numbers and noise."""
    random, known = np.random.default_rng(draws), {"mean": 0.0, "noise": 9.0, "numbers": 5.0, "indices": [0.8, 0.2]}
    inside = {name: [] for name in known}
    for _ in range(seeds):
        numbers = random.normal(size=(draws, 2))
        values = (numbers @ [2.0, 1.0])[:, None] + 3.0 * random.normal(size=(draws, 8))
        found = Sensitivity.of(values, scipy.stats.norm.cdf(numbers))
        for name, value in known.items():
            estimate = getattr(found, name)
            inside[name].append(np.abs(estimate.value - value) <= 2.0 * estimate.error)
    return {name: np.mean(item) for name, item in inside.items()}


@pytest.mark.parametrize("seeds", [200, pytest.param(5000, marks=pytest.mark.campaign)])
def test_errors_cover(seeds):
    """Two errors hold 93 to 97 %, within three errors of these shares."""
    for name, share in held(128, seeds).items():
        assert 0.93 - 0.05 / np.sqrt(seeds / 200) < share < 0.97 + 0.05 / np.sqrt(seeds / 200), name


@pytest.mark.campaign
def test_errors_of_simulations_cover():
    network = make(il.Uncertain(STIFFNESS), 0.6)
    exact = np.pi / 0.6 * np.array([STIFFNESS.expect(lambda k: 1.0 / k), 0.0])
    exact[1] = (np.pi / 0.6) ** 2 * STIFFNESS.expect(lambda k: k**-2) - exact[0] ** 2
    names = ["variance_displacement", f"{NAME}_parameter_variance"]
    found = []
    for seed in range(60):
        run = il.simulate(network, 20.0, realizations=512, rng=seed, statistics=names[0])
        found.append([score(run, name, value).item() for name, value in zip(names, exact, strict=True)])
    inside = (np.abs(found) <= 2.0).mean(axis=0)
    assert (np.abs(inside - 0.95) < 0.02 + 3.0 * np.sqrt(0.05 * 0.95 / 60)).all()
