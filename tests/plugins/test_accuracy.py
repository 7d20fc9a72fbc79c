"""The accuracy study: random networks, its small run, and verdicts that follow the numbers."""

import numpy as np
import pytest
import xarray as xr
from impactlab_numerics.accuracy.collect import exact_statistics
from impactlab_numerics.accuracy.random_networks import LEAST_RATE, closing_rates, random_network
from impactlab_numerics.accuracy.study import AccuracyStudy

import impactlab as il
from impactlab.results.schema import STATISTICS

pytestmark = pytest.mark.campaign

STUDY = AccuracyStudy


def test_a_study_of_nothing_is_refused():
    with pytest.raises(il.InvalidInput, match="there is nothing to do"):
        AccuracyStudy(networks=0, coverage_networks=0, coverage_runs=0, tolerance_seeds=0)


@pytest.mark.parametrize("seed", [4, 9, 14])
def test_random_networks_are_what_they_say(seed):
    network = random_network(seed)
    assert network == random_network.__wrapped__(seed)
    assert 2 <= len(network.oscillators) <= 6
    assert min(closing_rates(network).values()) >= LEAST_RATE
    exact = exact_statistics(network)["contact_rate"].to_series()
    assert dict(exact) == pytest.approx(closing_rates(network), rel=0.05)
    for name, body in network.oscillators.items():
        assert 0.1 <= body.mass <= 10.0
        assert 2.0 <= body.natural_frequency <= 63.3
        assert 0.02 <= body.damping_ratio <= 0.5
        assert np.pi * network.excitations[name].spectral_density / body.damping == pytest.approx(1.0)
    heated = random_network(seed, equal_temperature=False)
    assert heated.replace(excitations=network.excitations) == network
    ratios = [heated.excitations[name].spectral_density / noise.spectral_density
              for name, noise in network.excitations.items()]  # fmt: skip
    assert 0.5 <= min(ratios) < max(ratios) <= 2.0


def test_random_networks_have_everything():
    networks = [random_network(seed) for seed in (4, 9, 11, 12, 14, 16)]
    laws = {type(contact.law).__name__ for network in networks for contact in network.contacts.values()}
    assert laws == {"HertzContact", "LinearContact", "PowerLawContact"}
    assert any(network.couplings for network in networks)
    sides = [side for network in networks for item in network.contacts.values() for side in (item.first, item.second)]
    assert il.WALL in sides
    assert any(contact.clearance < 0.0 for network in networks for contact in network.contacts.values())
    kinds = {type(body).__name__ for network in networks for body in network.oscillators.values()}
    assert kinds == {"LinearOscillator", "DuffingOscillator"}
    assert {len(network.oscillators) for network in networks} == {2, 4, 5}


def test_runs_end_when_the_errors_are_small_or_the_steps_are_spent():
    study = AccuracyStudy()
    network = random_network(14)
    short, long = (study.replace(body_steps=steps).length(network) for steps in (1e6, 1e15))
    step = network.check().dataset.attrs["step"]
    assert short["duration"] * short["realizations"] * 2 / step == pytest.approx(1e6)
    assert study.replace(body_steps=1e15, standard_error=6e-4).length(network)["duration"] == pytest.approx(
        0.25 * long["duration"]
    )


def test_the_quick_form_holds(run, explained):
    assert [check for check in run.checks if not check.ok] == []
    assert run.claims.sizes["claim"] == 7
    equal = run.tree["equal"].to_dataset()
    networks = [random_network(number) for number in (11, 12)]
    rows = sum(5 * len(network.oscillators) + 3 * len(network.contacts) for network in networks)
    assert equal.sizes == {"comparison": rows}
    assert float(np.abs(equal.z).max()) < 4.5
    quarter = run.tree["unequal"].to_dataset()
    assert float(np.abs(quarter.z).max()) < 4.5
    assert float(run.tree["tolerance"].to_dataset().error.max()) < 1.0
    explained(run.study, run.figures, run.claims)
    assert {name for name, _ in run.study.figures(run.tree)} == {
        "bias_equal",
        "bias_unequal",
        "intervals",
        "coverage",
        "tolerance",
    }
    assert [title for title, rows in run.study.tables(run.tree) if not rows] == []


def test_differences_are_those_of_the_simulation(run):
    study = run.study
    item = next(item for item in study.items() if item.key == "equal_12")
    result, law = il.simulate(item.network, **item.options), exact_statistics(item.network)
    table = run.tree["equal"].to_dataset()
    (row,) = np.flatnonzero((table.network == 12) & (table.statistic == "contact_ratio") & (table.label == "contact_3"))
    difference = result.contact_ratio.values[3] - law.contact_ratio.values[3]
    assert float(table.difference[row]) == pytest.approx(difference, rel=1e-12)
    assert float(table.scale[row]) == law.contact_ratio.values[3]
    error = result.contact_ratio_standard_error.values[3]
    allowed = 1e-3 * law.contact_ratio.values[3] + 3.0 * error
    assert float(table.excess[row]) == pytest.approx(abs(difference) / allowed, rel=1e-12)


def verdicts(run, **groups):
    """Verdicts on a tree in which groups were replaced."""
    tree = run.tree.copy(deep=True)
    for name, group in groups.items():
        tree[name] = group
    return run.study.claims(tree).verdict.values.tolist()


def test_verdicts_see_a_bias(run):
    table = run.tree["equal"].to_dataset()
    limit = 1e-3 * table.scale[7] + 3.0 * table.standard_error[7]
    shifted = {}
    for factor in (1.05, 2.0):
        shifted[factor] = table.copy(deep=True)
        shifted[factor].difference[7] = factor * limit
    assert verdicts(run)[0] == "holds"
    assert verdicts(run, equal=shifted[1.05])[0] == "sampling error"
    assert verdicts(run, equal=shifted[2.0])[0] == "does not hold"


def test_verdicts_see_intervals_that_are_too_short_or_too_long(run):
    table = run.tree["coverage"].to_dataset().isel(run=[0] * 200)
    shares = {0.95: "holds", 0.92: "sampling error", 0.88: "does not hold", 0.98: "sampling error"}
    for share, verdict in shares.items():
        assert verdicts(run, coverage=table.assign(by_run=("run", np.full(200, share))))[5] == verdict


def test_verdicts_see_intervals_of_random_networks(run):
    names = np.tile(np.repeat(list(STATISTICS)[:-1], 4), 200)
    scores = np.random.default_rng(3).standard_t(63, size=len(names))
    coordinates = {"statistic": ("comparison", names), "label": ("comparison", names)}

    def found(z):
        columns = {"network": np.repeat(np.arange(200), 32), "z": z, "held": (np.abs(z) <= 2.0).astype(float)}
        rows = {name: ("comparison", values) for name, values in columns.items()}
        return verdicts(run, intervals=xr.Dataset(rows, coordinates, {"realizations": 64}))[2:5]

    def with_one(score):
        return np.where(np.arange(len(names)) == 5, score, scores)

    assert found(scores) == ["holds", "holds", "holds"]
    assert found(2.0 * scores)[:2] == ["does not hold", "does not hold"]  # errors of half the size
    assert found(0.3 * scores)[:2] == ["sampling error", "sampling error"]  # all are covered
    assert found(np.where(names == "mean_contact_force", 1.6 * scores, scores))[:2] == ["holds", "does not hold"]
    assert found(with_one(5.2))[2] == "sampling error"
    assert found(with_one(-7.0))[2] == "does not hold"


def test_runs_of_intervals_hold_twenty_contacts(run):
    item = next(item for item in run.study.items() if item.key == "intervals_3")
    law, result = exact_statistics(item.network), il.simulate(item.network, **item.options)
    assert float((law.contact_rate * item.options["duration"]).min()) == pytest.approx(20.0, rel=1e-3)
    assert float(result.contacts_per_sample.min()) == pytest.approx(20.0, rel=0.1)
    table = run.tree["intervals"].to_dataset()
    (row,) = np.flatnonzero((table.network == 3) & (table.statistic == "contact_ratio") & (table.label == "contact_0"))
    score = (result.contact_ratio[0] - law.contact_ratio[0]) / result.contact_ratio_standard_error[0]
    assert float(table.z[row]) == pytest.approx(float(score), rel=1e-9)
    assert bool(table.held[row]) == (abs(float(score)) <= 1.998)


def test_verdicts_see_tolerances_that_were_missed(run):
    table = run.tree["tolerance"].to_dataset().isel(run=[0] * 100)
    for missed, verdict in ((5, "holds"), (8, "sampling error"), (13, "does not hold")):
        error = np.where(np.arange(100) < missed, 1.1, 0.4)
        assert verdicts(run, tolerance=table.assign(error=("run", error)))[6] == verdict
