"""Standard errors that cover, drift, balances and processed moments."""

from types import SimpleNamespace

import numpy as np
import pytest
from impactlab_numerics.laws.couplings import DeadBandCoupling
from impactlab_numerics.laws.excitations import PulsatingNoise
from impactlab_numerics.laws.oscillators import StopOscillator
from scenes import base, linear, plan_of

import impactlab as il
from impactlab.statistics.rare import Events

pytestmark = pytest.mark.campaign

LAW = {  # of scenes.linear(): mean squares under white noise
    "mean_square_displacement": np.pi / (0.4 * np.pi * 4.0 * np.pi**2),
    "mean_square_velocity": np.pi / (0.4 * np.pi),
    "mean_displacement": 0.0,
    "mean_velocity": 0.0,
}


def coverage(runs, names, expected):
    """Part of the runs whose interval of 1.96 standard errors holds the expected value, by name."""
    return {
        name: np.mean(
            [abs(float(ds[name][0]) - expected[name]) < 1.96 * float(ds[f"{name}_standard_error"][0]) for ds in runs]
        )
        for name in names
    }


BATCH = 1.01 * 20.0 / (0.2 * np.pi)  # a little more than twenty relaxation times of scenes.linear()


@pytest.mark.parametrize(
    ("realizations", "duration", "step"),
    [(64, 10.0, 0.25), (8, 8 * BATCH, 0.25), (1, 64 * BATCH, 0.5)],
    ids=["realizations", "batches of realizations", "batches of one"],
)
def test_standard_errors_cover(realizations, duration, step):
    """95 % intervals of 200 runs; the standard error of one coverage is 1.5 %."""
    every = il.ExactFlow(jumps=False)  # where nothing can touch, jumps leave nothing to estimate
    runs = [
        il.simulate(linear(), duration, rng=k, realizations=realizations, step=step, integrator=every)
        for k in range(200)
    ]
    law = {**LAW, **{f"direct_{name}": value for name, value in LAW.items()}}
    del law["mean_displacement"]  # known exactly, see below
    parts = coverage(runs, law, law)
    assert min(parts.values()) >= 0.90, parts
    assert 0.90 <= np.mean(list(parts.values())) <= 0.98
    # and the errors are of the right size, not only wide enough
    for name, expected in law.items():
        scores = [(float(ds[name][0]) - expected) / float(ds[f"{name}_standard_error"][0]) for ds in runs]
        assert 0.85 < np.std(scores) < 1.2, name


def test_the_mean_of_a_body_without_contacts_is_exact():
    """The balance of forces leaves nothing to estimate."""
    ds = il.simulate(linear(), 10.0, rng=1, realizations=64)
    assert abs(ds.mean_displacement[0]) < 1e-12 * np.sqrt(ds.mean_square_displacement[0])
    assert ds.mean_displacement_standard_error[0] < 1e-12 * ds.direct_mean_displacement_standard_error[0]


def test_standard_errors_of_contacts_cover():
    network = il.Network(
        {"a": il.LinearOscillator.from_frequency(2.0 * np.pi, 0.1)},
        {"wall": il.Contact("a", il.WALL, il.LinearContact(400.0), clearance=0.1)},
        {"a": il.WhiteNoise(1.0)},
    )
    names = ["variance_displacement", "mean_square_velocity", "contact_ratio", "contact_rate", "mean_contact_force"]
    exact = il.exact(network).statistics()
    runs = [il.simulate(network, 10.0, realizations=64, rng=k) for k in range(200)]
    parts = coverage(runs, names, {name: float(exact[name][0]) for name in names})
    assert min(parts.values()) >= 0.90, parts
    assert 0.90 <= np.mean(list(parts.values())) <= 0.98


@pytest.mark.parametrize(("realizations", "advice"), [(1, r"2\.06e\+03 s"), (40, r"64\.3 s")])
def test_too_few_samples_give_nan_and_say_how_many_would_do(realizations, advice):
    with pytest.warns(il.AccuracyWarning, match=rf"Too few independent samples .* run for at least {advice}"):
        ds = il.simulate(linear(), 20.0, realizations=realizations, rng=1)
    assert np.isnan(ds.mean_square_displacement_standard_error).all()
    assert np.isfinite(ds.mean_square_displacement).all()


@pytest.mark.parametrize("options", [{"statistics": "mean_displacement"}, {"realizations": 2}])
def test_one_path_alone_needs_no_standard_errors(options):
    path = {"record": il.Trajectory(0.5), "rng": 1}
    il.simulate(linear(), 5.0, **path)  # warnings are errors
    with pytest.warns(il.AccuracyWarning, match="Too few independent samples"):
        il.simulate(linear(), 5.0, **path, **options)


@pytest.mark.parametrize("step", [None, 0.1, 0.7])
@pytest.mark.parametrize("realizations", [1, 3, 5, 8, 20, 40, 63])
def test_the_advice_is_enough(realizations, step):
    with pytest.warns(il.AccuracyWarning) as caught:
        il.simulate(linear(), 5.0, realizations=realizations, step=step, rng=1)
    advised = float(str(caught[0].message).split("at least ")[1].split(" s,")[0])
    ds = il.simulate(linear(), advised, realizations=realizations, step=step, rng=1)
    assert np.isfinite(ds.mean_square_displacement_standard_error).all()


def test_errors_shrink_with_the_square_root_of_the_realizations():
    few, many = (il.simulate(linear(), 20.0, realizations=n, rng=1, step=0.1) for n in (256, 4096))
    name = "direct_mean_square_displacement_standard_error"
    ratio = few[name] / many[name]
    assert float(ratio[0]) == pytest.approx(4.0, rel=0.15)


# contacts


def test_a_contact_that_never_closed_is_not_known():
    """0 with an error of 0 would say that it cannot close; 1 that it cannot open."""
    never, always = (il.simulate(base(clearance=d), 20.0, realizations=64, rng=1) for d in (5.0, -12.0))
    for name in ("contact_ratio", "contact_rate", "mean_contact_force", "peak_contact_force"):
        assert float(never[name][0]) == 0.0
        assert np.isnan(never[f"{name}_standard_error"]).all()
    assert float(never.contacts_per_sample[0]) == 0.0
    assert float(always.contact_ratio[0]) == 1.0
    assert np.isnan(always.contact_ratio_standard_error).all()
    assert (always.mean_contact_force_standard_error > 0.0).all()


def test_contacts_of_a_still_network_are_known():
    """Without noise there is nothing to be estimated."""
    still = base(excitations={"one": None, "two": None})
    ds = il.simulate(still, 5.0, realizations=64, rng=1)
    assert (ds.contact_ratio_standard_error == 0.0).all()


def test_contacts_per_sample_are_those_of_a_realization_or_a_batch():
    rate = float(il.exact(base()).statistics().contact_rate[0])
    many = il.simulate(base(), 20.0, realizations=64, rng=1)
    few = il.simulate(base(), 64 * 2.1 * 16.0, realizations=2, rng=1)  # 32 batches each
    assert float(many.contacts_per_sample[0]) == pytest.approx(20.0 * rate, rel=0.05)
    assert float(few.contacts_per_sample[0]) == pytest.approx(4.2 * 16.0 * rate, rel=0.05)


def test_contacts_that_closed_too_seldom_are_named():
    message = r"1 contact\(s\) closed fewer than 30 times in all, .* 'gap' about \d\.\d times. Run for 0\.\d+ s"
    with pytest.warns(il.AccuracyWarning, match=message):
        il.simulate(base(), 0.1, realizations=64, rng=1)


def test_the_rate_of_a_soft_contact_beside_a_stiff_one():
    """What is pressed against the body narrows the gap to the wall far more than the soft contact there does."""
    network = il.Network(
        {
            "a": il.DuffingOscillator(mass=0.18, damping=0.18, stiffness=1.6, cubic=3.2),
            "b": il.LinearOscillator(mass=0.27, damping=1.2, stiffness=154.0),
        },
        {
            "soft": il.Contact("a", il.WALL, il.PowerLawContact(0.44, exponent=1.3), clearance=0.79),
            "stiff": il.Contact("b", "a", il.LinearContact(1800.0), clearance=-0.76),
        },
        {"a": il.WhiteNoise(0.18 / np.pi), "b": il.WhiteNoise(1.2 / np.pi)},
    )
    ds = il.simulate(network, 10.0, realizations=512, rng=1)
    row = il.compare(ds, il.exact(network)).to_dataframe().query("statistic == 'contact_rate' and label == 'soft'")
    assert abs(row.z.item()) < 3.5
    assert row.standard_error.item() < 0.005 * row.reference.item()


# drift


def test_a_start_far_from_stationary_is_seen():
    with pytest.warns(il.AccuracyWarning, match=r"two halves of the run differ by \d+\.\d standard errors"):
        il.simulate(linear(), 5.0, realizations=1024, spin_up=0.5, initial="rest", rng=1)


@pytest.mark.parametrize("rng", range(5))
def test_a_stationary_run_shows_no_drift(rng):
    ds = il.simulate(base(), 20.0, realizations=128, rng=rng)
    assert ds.drift < 4.5


def test_drift_is_a_normal_score_with_few_realizations_too():
    """The largest of three scores: P(< 1) is 32 % if they are independent, and hardly one of 450 is beyond 4."""
    drifts = [il.simulate(linear(), 257.2, realizations=8, rng=k, step=0.25).drift for k in range(150)]
    assert max(drifts) < 4.0
    assert 0.25 < np.mean(np.array(drifts) < 1.0) < 0.55


def test_drift_is_not_warned_of_where_the_start_is_given():
    ds = il.simulate(linear(), 5.0, realizations=256, initial={"displacement": {"a": 3.0}}, rng=1)
    assert ds.drift > 6.0


# processed moments and balances


def test_processed_moments_remove_the_error_of_second_order():
    """The moments at the kicks are biased, Simpson's rule over the time of a step is hardly."""
    network = il.Network(
        {"a": il.LinearOscillator.from_frequency(2.0 * np.pi, 0.1)},
        {"wall": il.Contact("a", il.WALL, il.LinearContact(400.0), clearance=0.0)},
        {"a": il.WhiteNoise(1.0)},
    )
    step = 0.6 / np.sqrt(4.0 * np.pi**2 + 400.0)
    method = il.ExactFlow(measured=False)  # a step that is meant to be too large
    ds = il.simulate(network, 100.0, realizations=512, step=step, rng=1, integrator=method)
    exact = il.exact(network).statistics().mean_square_velocity[0]
    processed = float(ds.mean_square_velocity[0] / exact - 1.0)
    removed = float(1.0 - raw_velocity(network, step) / ds.direct_mean_square_velocity[0])  # of the same paths
    error = float(ds.mean_square_velocity_standard_error[0] / exact)
    assert removed > 0.005
    assert abs(processed) + 3.0 * error < 0.4 * removed


def raw_velocity(network, step):
    """Mean square velocity at the kicks, without processing."""
    from impactlab.kernels.rows import VV
    from impactlab.plan.seed import seed_of
    from impactlab.simulation.block_sums import merged
    from impactlab.simulation.ensemble import run

    plan = plan_of(network, duration=100.0, realizations=512, step=step, seed=seed_of(1))
    bodies, *_ = merged(run(plan, None, lambda part: None))
    return bodies[:, :, VV, 0].sum(axis=(0, 1)).mean() / plan.clock.steps


@pytest.mark.parametrize("ratio", [25.0, 100.0])
def test_steps_longer_than_the_memory_of_a_velocity_keep_its_temperature(ratio):
    """At a wall, at c h/m of 14 and 58; without what kicks add between each other E[v²] is 9 to 18 errors off."""
    body = il.LinearOscillator.from_frequency(1.0, ratio)
    wall = il.Contact("a", il.WALL, il.LinearContact(3.0))
    network = il.Network({"a": body}, {"wall": wall}, {"a": il.WhiteNoise(body.damping / np.pi)})
    rules = il.ExactFlow(measured=False)  # whose step a measurement may make smaller for the sake of the rate
    result = il.simulate(network, 40.0 * ratio, realizations=256, spin_up=20.0 * ratio, rng=1, integrator=rules)
    assert result.attrs["step"] * body.damping > 10.0
    error = result.mean_square_velocity_standard_error.item()
    assert error < 2e-5
    assert abs(result.mean_square_velocity.item() - 1.0) < 4.0 * error


@pytest.mark.parametrize("share", [0.5, 1.0, 1.5])
def test_balances_hold_at_every_step(share):
    """They are exact for the chain of steps, not only in the limit."""
    automatic = il.simulate(base(), 1.0, realizations=64, rng=1, spin_up=0.0).step
    ds = il.simulate(base(), 60.0, realizations=256, rng=2, step=share * automatic)
    for name in ("mean_displacement", "mean_square_displacement", "mean_square_velocity"):
        score = ds[f"balance_{name}"] / ds[f"balance_{name}_standard_error"]
        assert (abs(score) < 3.5).all(), name


def test_combination_with_balances_reduces_the_variance():
    """By 50 for E[x²] of the fast body and by 6 for the slow one, at a ratio of frequencies of 16."""
    ds = il.simulate(base(), 60.0, realizations=256, rng=2)
    gain = ds.direct_mean_square_displacement_standard_error / ds.mean_square_displacement_standard_error
    assert (gain**2 > [20.0, 3.0]).all()


def test_without_enough_spin_up_values_are_plain_means():
    ds = il.simulate(base(), 20.0, realizations=64, rng=2, spin_up=1.0)
    assert not any(name.startswith("direct_") for name in ds)


@pytest.mark.parametrize(
    ("led", "others"), [(il.Harmonic(amplitude=3.0, frequency=0.8), True), (PulsatingNoise(0.1, frequency=0.8), False)]
)
def test_bodies_connected_to_one_that_a_function_of_time_moves_have_no_balances(led, others):
    """Their energies at both ends of a run differ by more than chance, as that of the body itself does."""
    bodies = {name: il.LinearOscillator.from_frequency(1.0, 0.1) for name in "abc"}
    contacts = {"ab": il.Contact("a", "b", il.LinearContact(2.0), clearance=-1.0)}
    network = il.Network(bodies, contacts, {"a": led, "b": il.WhiteNoise(0.1), "c": il.WhiteNoise(0.1)})
    ds = il.simulate(network, 13.0, realizations=64, rng=1)
    known = np.isfinite(np.asarray(ds.get("balance_mean_square_velocity", np.full(3, np.nan))))
    assert known.tolist() == [False, False, others]


def test_balance_of_a_free_damped_body():
    network = il.Network(
        {"a": il.LinearOscillator(damping=1.0)},
        {
            "right": il.Contact("a", il.WALL, il.LinearContact(100.0), clearance=0.5),
            "left": il.Contact(il.WALL, "a", il.LinearContact(100.0), clearance=0.5),
        },
        {"a": il.WhiteNoise(1.0)},
    )
    ds = il.simulate(network, 100.0, realizations=256, rng=1, spin_up=30.0, initial="rest")
    assert abs(float(ds.balance_mean_square_velocity[0] / ds.balance_mean_square_velocity_standard_error[0])) < 3.5
    assert "balance_mean_square_displacement" not in ds  # there is no linear law to compare with


# forces that act too seldom


def unit_body(kind=il.LinearOscillator, **fields):
    return kind(mass=1.0, damping=0.2, stiffness=1.0, **fields)


def seldom_touching(spread):
    """Two bodies of temperature 1 whose contact closes beyond so many standard deviations of the gap."""
    return il.Network(
        {"a": unit_body(), "b": unit_body()},
        {"gap": il.Contact("a", "b", il.HertzContact(100.0), clearance=spread * np.sqrt(2.0))},
        {"a": il.WhiteNoise(0.2 / np.pi), "b": il.WhiteNoise(0.2 / np.pi)},
    )


def seldom_stopped(spread):
    body = unit_body(StopOscillator, stop=1000.0, distance=spread)
    return il.Network({"a": body}, {}, {"a": il.WhiteNoise(0.2 / np.pi)})


@pytest.mark.filterwarnings("ignore:.*closed fewer than 30 times:impactlab.AccuracyWarning")
@pytest.mark.parametrize(
    ("make", "spread"), [(seldom_touching, 3.0), (seldom_touching, 4.2), (seldom_stopped, 3.6), (seldom_stopped, 4.3)]
)
def test_intervals_cover_what_a_force_that_acted_too_seldom_could_change(make, spread):
    """Balances take all scatter away that the force does not make: they are no controls here."""
    network = make(spread)
    exact = il.exact(network).statistics()
    names = ["mean_displacement", "mean_square_displacement", "mean_square_velocity"]
    runs = [il.simulate(network, 60.0, realizations=64, rng=k, step=0.0125) for k in range(60)]
    parts = coverage(runs, names, {name: float(exact[name][0]) for name in names})
    assert min(parts.values()) >= 0.85, parts  # 3.5 standard errors below 0.95
    assert np.mean(list(parts.values())) >= 0.91
    assert min(float(ds[f"{name}_standard_error"][0]) for ds in runs for name in names) > 1e-4


@pytest.mark.filterwarnings("ignore:.*closed fewer than 30 times:impactlab.AccuracyWarning")
def test_errors_of_few_closings_know_that_there_may_be_harder_ones():
    network = seldom_touching(3.0)
    exact = il.exact(network).statistics()
    runs = [il.simulate(network, 60.0, realizations=64, rng=k) for k in range(100)]
    for name in ("contact_ratio", "mean_contact_force"):
        scores = np.array([(ds[name][0] - exact[name][0]) / ds[f"{name}_standard_error"][0] for ds in runs])
        scores = scores[np.isfinite(scores)]  # NaN where it never closed
        assert np.mean(np.abs(scores) < 1.96) > 0.88
        assert np.abs(scores).max() < 6.0


@pytest.mark.parametrize("link", ["coupling", "contact"])
def test_a_body_that_only_a_rare_force_moves_is_not_known(link):
    contact = {"gap": il.Contact("a", "b", il.LinearContact(1000.0), clearance=4.2)} if link == "contact" else {}
    coupling = {"band": il.Coupling("a", "b", DeadBandCoupling(1000.0, play=4.2))} if link == "coupling" else {}
    network = il.Network(
        {"a": unit_body(), "b": unit_body()}, contact, {"a": il.WhiteNoise(0.2 / np.pi)}, couplings=coupling
    )
    with pytest.warns(il.AccuracyWarning, match=r"pushed independently fewer than 30 times in all.* 'b' about 0 times"):
        ds = il.simulate(network, 60.0, realizations=64, rng=2, step=0.0125)
    for name in ("mean_displacement", "mean_square_displacement", "variance_displacement", "mean_square_velocity"):
        assert np.isnan(ds[f"{name}_standard_error"][1])
        assert ds[f"{name}_standard_error"][0] > 1e-4


@pytest.mark.parametrize("link", ["impacts", "dry friction"])
def test_impacts_and_dry_friction_move_bodies(link):
    """They are no kicks, whose forces are summed."""
    wall = il.backlash("b", "a", il.RigidContact(0.6), clearance=0.1, name="gap") if link == "impacts" else {}
    friction = {} if wall else {"rub": il.Coupling("a", "b", il.CoulombFrictionCoupling(0.1))}
    noise = il.Source(il.OrnsteinUhlenbeckNoise(0.1, correlation_time=0.5), on="a")
    network = il.Network({"a": unit_body(), "b": il.LinearOscillator(mass=0.1)}, wall, {"noise": noise}, friction)
    plan = plan_of(network, duration=10.0, realizations=64)
    for units, still in ((64, []), (10, [1] if wall else [])):  # in which it was hit
        closed = np.zeros((len(wall), 64))
        closed[:, :units] = 1.0
        moments = SimpleNamespace(others={"contact_ratio": closed.copy(), "contact_rate": closed})
        events = Events.of(plan, moments, np.zeros((2, 64)))
        assert events.moved.tolist() == still
        assert not events.seldom(plan)[1] or still


def test_a_body_that_nothing_can_move_is_known():
    network = il.Network(
        {"a": unit_body(), "b": unit_body()},
        {"wall": il.Contact("b", il.WALL, il.LinearContact(10.0), clearance=1.0)},
        {"a": il.WhiteNoise(0.2 / np.pi)},
    )
    ds = il.simulate(network, 60.0, realizations=64, rng=2)
    assert ds.mean_square_displacement[1] == 0.0
    assert ds.mean_square_displacement_standard_error[1] == 0.0
