"""Fragility over scaled records, its lognormal laws, and the separation that buildings need."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import lsim
from scipy.special import ndtr
from scipy.stats import norm

import impactlab as il
from impactlab.statistics.capacities import NORMAL, fraction_band, lognormal, quantile_band

SCALES = [0.5, 1.5, 3.0]


def record(number, samples=151, interval=0.02):
    """A short record of coloured noise that grows and fades."""
    rng, times = np.random.default_rng(number), interval * np.arange(samples)
    white = rng.normal(size=samples)
    values = np.convolve(white, np.hanning(7), "same") * np.sin(np.pi * times / times[-1]) ** 2
    return il.SampledForce(times, 3.0 * values / np.abs(values).max(), after="zero")


RECORDS = [record(number) for number in range(4)]


def towers(ground, law=None, **changes):
    """Two towers on one ground, which pound."""
    left = il.LinearOscillator.from_frequency(natural_frequency=6.0, damping_ratio=0.05)
    right = il.LinearOscillator.from_frequency(mass=1.5, natural_frequency=11.0, damping_ratio=0.05)
    network = il.Network(
        {"left": left, "right": right},
        {"gap": il.Contact("left", "right", law or il.HertzContact(2e4), clearance=0.01)},
        {"ground": il.BaseMotion(ground)},
    )
    return network.replace(**changes)


LIMIT = {"left": 0.05, "gap": [10.0, 50.0], "drift": ({"left": 1.0, "right": -1.0}, 0.06)}


@pytest.fixture(scope="module")
def result():
    return il.fragility(towers, RECORDS, SCALES, LIMIT)


def peaks_by_scipy(network, duration, forms):
    """Peaks of forms of displacements and contact forces by steps of order eight at a tight tolerance."""
    compiled = network.compile()
    found = solve_ivp(
        compiled.rhs, (0.0, duration), compiled.state(), "DOP853", rtol=1e-9, atol=1e-12, max_step=0.02,
        t_eval=np.arange(0.0, duration, 2e-4),
    )  # fmt: skip
    x = found.y[: len(network.oscillators)]
    return [np.abs(form(x)).max() for form in forms]


@pytest.mark.full
def test_peaks_are_those_of_runs_by_scipy(result):
    law = il.HertzContact(2e4)
    forms = [
        lambda x: x[0],
        lambda x: law.evaluate(np.maximum(x[0] - x[1] - 0.01, 0.0)),
        lambda x: x[0] - x[1],
    ]  # fmt: skip
    for place, scale in ((1, 1), (2, 2)):
        expected = peaks_by_scipy(towers(RECORDS[place].replace(scale=SCALES[scale])), 3.0, forms)
        assert result.peak.values[:, place, scale] == pytest.approx(expected, rel=5e-3)
    assert result.attrs["peak_error"] <= 1e-3


@pytest.mark.full
def test_linear_motion_is_exact():
    body = il.LinearOscillator.from_frequency(natural_frequency=7.0, damping_ratio=0.03)

    def make(ground):
        return il.Network({"a": body}, excitations={"ground": il.Source(ground, on={"a": 2.0})})

    found = il.fragility(make, RECORDS, [1.0, 2.0], {"a": 0.1})
    for number, item in enumerate(RECORDS):
        times = np.linspace(0.0, item.times[-1], 150 * 40 + 1)
        system = [[0.0, 1.0], [-body.stiffness, -body.damping]], [[0.0], [2.0]], [[1.0, 0.0]], [[0.0]]
        _, x, _ = lsim(system, np.interp(times, item.times, item.values), times)
        assert found.peak.values[0, number] == pytest.approx(np.abs(x).max() * np.array([1.0, 2.0]), rel=1e-5)


@pytest.mark.full
@pytest.mark.parametrize("changed", ["rigid", "hysteresis", "structure", "friction"])
def test_all_mechanisms_run_beside_each_other_as_alone(changed):
    step = 5e-4
    yielding = il.BoucWenCoupling(stiffness=50.0, yield_displacement=0.02)
    networks = {
        "rigid": lambda ground: towers(ground, il.RigidContact(0.6)),
        "hysteresis": lambda ground: towers(
            ground, couplings={"yields": il.Coupling("right", il.WALL, yielding)}
        ),
        "friction": lambda ground: towers(
            ground, couplings={"rubs": il.Coupling("right", il.WALL, il.CoulombFrictionCoupling(friction=0.5))}
        ),
        "structure": lambda ground: towers(
            ground,
            couplings={"link": il.Coupling("left", "right", il.LinearCoupling(stiffness=30.0, damping=0.2))},
        ),
    }  # fmt: skip
    make = networks[changed]
    found = il.fragility(make, RECORDS[:2], [1.0, 3.0], {"left": 0.05, "right": 0.05}, step=step)
    rigid = changed == "rigid"  # whose paths turn between steps, where they hit
    options = {} if rigid else {"step": step, "integrator": il.ExactFlow()}
    path = il.Trajectory(1e-4 if rigid else step)
    alone = il.simulate(make(RECORDS[1].replace(scale=3.0)), 3.0, initial="rest", record=[path], **options)
    assert found.peak.values[:, 1, 1] == pytest.approx(np.abs(alone.displacement.values[0]).max(axis=0), rel=1e-3)


@pytest.mark.full
def test_one_lane_of_a_large_network():
    bodies = il.LinearOscillator.from_frequency(natural_frequency=20.0, damping_ratio=0.05)

    def make(ground):
        return il.chain(600, bodies, il.HertzContact(1e4), clearance=0.01).replace(
            excitations={"ground": il.Source(ground, on={"body_0": 5.0})}
        )

    found = il.fragility(make, RECORDS[:2], [4.0], {"body_0": 0.05, "body_1": 0.05}, step=2e-3)
    alone = il.simulate(
        make(RECORDS[1].replace(scale=4.0)), 3.0, step=2e-3, initial="rest", integrator=il.ExactFlow(),
        record=[il.Trajectory(2e-3, names=["body_0", "body_1"])],
    )  # fmt: skip
    assert found.peak.values[:, 1, 0] == pytest.approx(np.abs(alone.displacement.values[0]).max(axis=0), rel=2e-3)


@pytest.mark.full
def test_probabilities_are_fractions_of_records(result):
    assert list(result.state.values) == ["left ≥ 0.05 m", "gap ≥ 10 N", "gap ≥ 50 N", "drift ≥ 0.06 m"]
    exceeded = result.peak.sel(demand="gap").values >= 50.0
    assert result.probability.values[2] == pytest.approx(exceeded.mean(axis=0))
    low, high = result.probability_low, result.probability_high
    assert ((low <= result.probability) & (result.probability <= high)).all()
    assert (result.peak_quantile.sel(quantile=0.5).values == np.median(result.peak.values, axis=1)).all()


@pytest.mark.full
def test_files_and_reruns(result, tmp_path):
    result.to_netcdf(tmp_path / "fragility.nc")
    again = il.rerun(tmp_path / "fragility.nc")
    for name, variable in result.variables.items():
        assert np.array_equal(variable.values, again[name].values, equal_nan=variable.dtype.kind == "f"), name
    assert "Baker" in result.attrs["references"]


def test_records_count_until_their_own_ends():
    short = record(1, samples=51)
    both = il.fragility(towers, [RECORDS[0], short], SCALES, {"left": 0.05}, step=1e-3)
    alone = il.fragility(towers, [short, short], SCALES, {"left": 0.05}, step=1e-3)
    assert both.peak.values[0, 1] == pytest.approx(alone.peak.values[0, 0], rel=1e-9)
    assert both.record_value.shape == (2, 151)
    again = il.rerun(both)
    assert np.array_equal(again.peak.values, both.peak.values)


@pytest.mark.full
def test_required_separation_closes_the_contact_as_often():
    records = [record(number) for number in range(10)]
    found = il.required_separation(towers, records, SCALES, "gap", probability=0.25)
    separation = float(found.separation.values[0, 1])
    assert (found.relative_displacement.values[:, 1] > separation).mean() == pytest.approx(0.25, abs=0.06)
    gap = il.Contact("left", "right", il.HertzContact(2e4), clearance=separation)
    wide = il.fragility(lambda ground: towers(ground, contacts={"gap": gap}), records, SCALES, {"gap": 1e-6})
    closes = found.relative_displacement.values[:, 1] > separation
    assert (wide.peak.values[0, :, 1] > 0.0).tolist() == closes.tolist()
    assert np.array_equal(il.rerun(found).separation.values, found.separation.values)


@pytest.mark.full
def test_random_excitations_have_the_same_realizations_at_all_scales():
    noise = il.ModulatedNoise(0.02, [0.0, 1.0, 4.0], [0.0, 1.0, 0.0])
    body = il.LinearOscillator.from_frequency(natural_frequency=7.0, damping_ratio=0.1)

    def make(ground):
        return il.Network({"a": body}, excitations={"ground": il.BaseMotion(ground)})

    options = {"duration": 4.0, "realizations": 64, "rng": 3}
    found = il.fragility(make, noise, [1.0, 2.0, 3.0], {"a": 0.05}, **options)
    peaks = found.peak.values[0]
    assert peaks / peaks[:, :1] == pytest.approx(np.tile([1.0, 2.0, 3.0], (64, 1)), rel=1e-6)
    assert np.array_equal(il.rerun(found).peak.values, found.peak.values)
    path = il.simulate(make(noise), 4.0, realizations=64, initial="rest", rng=3, step=found.attrs["step"],
                       integrator=il.ExactFlow(jumps=False), record=[il.Trajectory(found.attrs["step"])])  # fmt: skip
    assert peaks[:, 0] == pytest.approx(np.abs(path.displacement.values[..., 0]).max(axis=1), rel=2e-3)


def test_lognormal_law_is_that_of_greatest_likelihood():
    rng, scales = np.random.default_rng(5), np.geomspace(0.3, 3.0, 9)
    capacities = np.exp(rng.normal(np.log(1.2), 0.4, 60))
    law = lognormal(capacities[:, None] <= scales, scales)

    def likelihood(median, dispersion):
        edges = np.concatenate([[0.0], norm.cdf(np.log(scales / median) / dispersion), [1.0]])
        return np.log(np.diff(edges)[np.searchsorted(scales, capacities)]).sum()

    best = likelihood(law.median, law.dispersion)
    for factor in (0.99, 1.01):
        assert likelihood(factor * law.median, law.dispersion) < best
        assert likelihood(law.median, factor * law.dispersion) < best
    assert law.errors[0] == pytest.approx(law.median * law.dispersion / np.sqrt(60.0), rel=0.15)
    assert law.errors[1] == pytest.approx(law.dispersion / np.sqrt(120.0), rel=0.25)


def test_no_law_without_a_slope():
    scales = np.array([1.0, 2.0, 3.0])
    for exceeded in ([[0, 0, 0]] * 3, [[0, 1, 1]] * 3, [[0, 1, 1], [1, 1, 1], [0, 1, 1]]):
        assert np.isnan(lognormal(np.array(exceeded, dtype=bool), scales).median)


def coverage(number, runs, scales, seed):
    """Shares of runs in which intervals hold the median, the dispersion, curves and fractions."""
    rng, held = np.random.default_rng(seed), np.zeros(5)
    truth = ndtr(np.log(scales / 1.1) / 0.4)
    for _ in range(runs):
        capacities = np.exp(rng.normal(np.log(1.1), 0.4, number))
        exceeded = capacities[:, None] <= scales
        law = lognormal(exceeded, scales)
        errors = np.abs([law.median - 1.1, law.dispersion - 0.4]) <= NORMAL * np.array(law.errors)
        _, low, high = law.probability(scales)
        least, most = fraction_band(exceeded.sum(axis=0), number)
        _, below, above = quantile_band(capacities, 0.9)
        held += [
            *errors, ((low <= truth) & (truth <= high)).mean(), ((least <= truth) & (truth <= most)).mean(),
            below <= 1.1 * np.exp(0.4 * norm.ppf(0.9)) <= above,
        ]  # fmt: skip
    return held / runs


def test_intervals_hold_the_values():
    held = coverage(100, 300, np.geomspace(0.4, 3.0, 10), 1)
    assert (np.abs(held - 0.95) < 0.02 + 2.0 * np.sqrt(0.05 * 0.95 / 300)).all(), held


@pytest.mark.campaign
def test_coverage_of_all_intervals():
    for number, count in ((50, 8), (100, 30), (400, 15)):
        held = coverage(number, 3000, np.geomspace(0.3, 3.0, count), number)
        assert (np.abs(held - 0.95) < 0.02 + 2.0 * np.sqrt(0.05 * 0.95 / 3000)).all(), (number, held)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"limit": {"middle": 0.1}}, "there is no oscillator or contact 'middle'"),
        ({"limit": {"left": -0.1}}, "limit of 'left' must be larger than 0"),
        ({"limit": {"left": [0.2, 0.1]}}, "increasing levels"),
        ({"limit": {}}, "limits by name"),
        ({"limit": {"drift": ({"left": 0.0}, 0.1)}}, "no weight other than 0"),
        ({"limit": {"force": (("contact_force", "hole"), 1.0)}}, "no contact 'hole'"),
        ({"scales": [1.0, 0.5]}, "increasing numbers above 0"),
        ({"records": RECORDS[:1]}, "two at least"),
        ({"records": [il.ConstantForce(1.0)] * 2}, r"records\[0\] must be an il.SampledForce"),
        ({"records": il.WhiteNoise(1.0), "realizations": 8}, "give duration="),
        ({"realizations": 8}, "realizations= is for a random excitation"),
        ({"make": lambda ground: 3}, "must return an il.Network"),
        ({"make": lambda ground: towers(RECORDS[0])}, "must use the record itself"),
        ({"duration": 5.0, "records": [RECORDS[0].replace(after="error")] * 2}, "ends at 3 s"),
        ({"make": lambda ground: towers(ground, il.RigidContact(0.5))}, "impulse, but no force"),
        ({"step": -1.0}, "step must be larger than 0"),
    ],
)
def test_bad_input_is_refused_by_name(changes, said):
    given = {"make": towers, "records": RECORDS, "scales": SCALES, "limit": LIMIT} | changes
    with pytest.raises(il.InvalidInput, match=said):
        il.fragility(**given)


def test_a_limit_that_is_exceeded_at_rest_is_refused():
    def pressed(ground):
        return towers(ground, contacts={"gap": il.Contact("left", "right", il.HertzContact(2e4), clearance=-0.02)})

    with pytest.raises(il.InvalidInput, match="exceeded before the motion begins"):
        il.fragility(pressed, RECORDS, SCALES, {"gap": 1e-3})
    with pytest.raises(il.InvalidInput, match="no contact 'hole'"):
        il.required_separation(towers, RECORDS, SCALES, "hole")
    with pytest.raises(il.InvalidInput, match="probability must be between"):
        il.required_separation(towers, RECORDS, SCALES, "gap", probability=1.5)
