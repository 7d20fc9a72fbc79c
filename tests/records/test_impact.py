"""Impacts as lists and as distributions: collisions in closed form, balances, and what datasets keep of them."""

import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import xarray as xr
from scenes import base

import impactlab as il
from impactlab.results.dataset import load

EXACT = il.EventLocated()


def body(law, mass=2.0, clearance=1.0, excitations=None, **fields):
    """A body that may meet a wall."""
    return il.Network(
        {"a": il.LinearOscillator(mass=mass, **fields)},
        {"stop": il.Contact("a", il.WALL, law, clearance=clearance)},
        excitations,
    )


def falling(restitution=0.9):
    """A ball above the ground, which is 1 m below."""
    return body(il.RigidContact(restitution), excitations={"gravity": il.BaseMotion(il.ConstantForce(-9.81))})


def thrown(network, speed=1.5, duration=4.0, **options):
    """Run a body from a velocity, and list its impacts."""
    options = {"initial": {"velocity": {"a": speed}}, "record": il.Impacts(), "integrator": EXACT} | options
    return il.simulate(network, duration, **options)


def balanced(data):
    """Assert that the impulses of all contacts are their mean forces over time."""
    for contact in data.contact.values:
        own = data.impact_contact.values == contact
        force = data.mean_contact_force.sel(contact=contact).item() * data.attrs["duration"]
        assert data.impact_impulse.values[own].sum() == pytest.approx(force, rel=1e-11)


def test_a_bouncing_ball_has_closing_velocities_in_geometric_series():
    data = il.simulate(falling(), 10.0, initial="rest", integrator=EXACT, record=il.Impacts())
    closing, number = data.impact_closing_velocity.values, data.sizes["impact"]
    first = math.sqrt(2.0 * 9.81)
    np.testing.assert_allclose(closing, first * 0.9 ** np.arange(number), rtol=1e-9)
    np.testing.assert_allclose(closing[:40], first * 0.9 ** np.arange(40), rtol=1e-13)
    np.testing.assert_allclose(data.impact_leaving_velocity.values[:-1], 0.9 * closing[:-1], rtol=1e-14)
    np.testing.assert_allclose(data.impact_lost_energy.values[:-1], closing[:-1] ** 2 * (1.0 - 0.81), rtol=1e-14)
    times = math.sqrt(2.0 / 9.81) * (1.0 + 2.0 * 0.9 * (1.0 - 0.9 ** np.arange(number)) / (1.0 - 0.9))
    np.testing.assert_allclose(data.impact_time.values, times, rtol=1e-11)
    assert (data.impact_duration.values[:-1] == 0.0).all()
    assert data.impact_duration.values[-1] == pytest.approx(10.0 - 8.578949179, abs=1e-8)
    assert data.impact_flag.values.tolist() == [0] * (number - 1) + [6]  # it ends in rest, and rests at the end
    assert np.isnan(data.impact_largest_force.values).all()
    assert data.impact_lost_energy.values.sum() == pytest.approx(2.0 * 9.81, rel=1e-12)
    assert data.impact_number.item() == number
    balanced(data)


def test_collisions_of_two_masses_and_a_wall():
    network = il.Network(
        {"light": il.LinearOscillator(mass=1.0), "heavy": il.LinearOscillator(mass=100.0)},
        {
            "between": il.Contact("heavy", "light", il.RigidContact(1.0), clearance=1.0),
            "wall": il.Contact("light", il.WALL, il.RigidContact(1.0), clearance=1.0),
        },
    )
    start = {"velocity": {"heavy": 1.0}}
    data = il.simulate(network, 10.0, initial=start, integrator=EXACT, record=il.Impacts())
    assert data.impact_number.values.sum() == 31
    assert data.impact_series_size.attrs["sample_dimension"] == "impact"
    assert data.impact_series_size.values.tolist() == [16, 15]
    assert data.impact_series_contact.values.tolist() == ["between", "wall"]
    between = data.impact_contact.values == "between"
    assert between.tolist() == [True] * 16 + [False] * 15
    # the heavy body has turned round at nearly its speed
    assert data.impact_impulse.values[between].sum() == pytest.approx(100.0 * (1.0 + 0.9991), rel=2e-3)
    np.testing.assert_allclose(data.impact_lost_energy.values, 0.0, atol=1e-15)
    some = il.simulate(
        network, 10.0, initial=start, integrator=EXACT,
        record=il.Impacts(contacts=["wall"], quantities=["impulse"]),
    )  # fmt: skip
    np.testing.assert_array_equal(some.impact_impulse.values, data.impact_impulse.values[~between])
    assert np.isnan(some.impact_number.values).tolist() == [True, False]
    assert "impact_closing_velocity" not in some


@pytest.mark.parametrize("interval", [None, 0.013])
def test_a_linear_contact_is_half_a_swing(interval):
    mass, stiffness, speed = 2.0, 300.0, 1.5
    paths = [] if interval is None else [il.Trajectory(interval)]
    data = thrown(body(il.LinearContact(stiffness), mass), speed, record=[il.Impacts(), *paths])
    expected = {
        "time": 1.0 / speed, "closing_velocity": speed, "leaving_velocity": speed,
        "duration": math.pi * math.sqrt(mass / stiffness), "impulse": 2.0 * mass * speed,
        "largest_force": speed * math.sqrt(stiffness * mass),
    }  # fmt: skip
    for name, value in expected.items():
        assert data[f"impact_{name}"].item() == pytest.approx(value, rel=1e-14), name
    assert data.impact_lost_energy.item() == 0.0
    assert data.peak_contact_force.item() == pytest.approx(expected["largest_force"], rel=1e-14)
    balanced(data)


@pytest.mark.parametrize("ratio", [0.02, 0.3, 0.8])
def test_a_damped_contact_loses_what_its_closed_form_says(ratio):
    """It lets go where its force is 0, δ'' = 0, with what is stored in its spring."""
    mass, stiffness, speed = 2.0, 300.0, 1.5
    rate = math.sqrt(stiffness / mass)
    decay, turn = ratio * rate, rate * math.sqrt(1.0 - ratio**2)
    data = thrown(body(il.KelvinVoigtContact(stiffness, damping=2.0 * mass * decay), mass), speed)
    power = complex(-decay, turn)
    ends = math.atan2(2.0 * decay * turn, decay**2 - turn**2) / turn
    leaving = -(power * np.exp(power * ends)).imag * speed / turn
    top = (math.pi * np.arange(-3, 4) - 3.0 * np.angle(power)) / turn
    top = [time for time in top if 0.0 < time < ends]
    force = max(-mass * (power**2 * np.exp(power * time)).imag * speed / turn for time in [0.0, *top])
    depth = np.exp(power * ends).imag * speed / turn
    assert data.impact_leaving_velocity.item() == pytest.approx(leaving, rel=1e-12)
    assert data.impact_duration.item() == pytest.approx(ends + depth / leaving, rel=1e-12)
    assert data.impact_impulse.item() == pytest.approx(mass * (speed + leaving), rel=1e-12)
    assert data.impact_largest_force.item() == pytest.approx(force, rel=1e-12)
    assert data.impact_lost_energy.item() == pytest.approx(0.5 * mass * (speed**2 - leaving**2), rel=1e-12)


def test_lost_energies_are_the_decrease_of_the_energy():
    """Two undamped bodies between damped stops; what is closed at either end has its part, too."""
    stop = il.KelvinVoigtContact(400.0, damping=3.0, tension=True)
    network = il.Network(
        {"a": il.LinearOscillator(mass=1.0, stiffness=4.0), "b": il.LinearOscillator(mass=0.5, stiffness=9.0)},
        {
            "wall": il.Contact("a", il.WALL, stop, clearance=0.1),
            "between": il.Contact("b", "a", il.KelvinVoigtContact(200.0, damping=1.0), clearance=-0.02),
        },
    )
    mass, stiffness = np.array([1.0, 0.5]), np.array([4.0, 9.0])
    for duration in (2.0, 2.3, 2.5, 2.53):
        data = il.simulate(
            network, duration, initial={"velocity": {"a": 2.0, "b": -1.0}}, integrator=EXACT,
            record=[il.Impacts(), il.FinalState()],
        )  # fmt: skip
        x, v = data.final_displacement.values[0], data.final_velocity.values[0]
        depth = np.array([x[0] - 0.1, x[1] - x[0] + 0.02]).clip(0.0)
        begun = 0.5 * (mass * [4.0, 1.0]).sum() + 0.5 * 200.0 * 0.02**2
        kinetic = 0.5 * (mass * v**2 + stiffness * x**2).sum()
        lost = data.impact_lost_energy.values.sum() + 0.5 * 200.0 * 0.02**2  # of the contact that begins closed
        assert lost == pytest.approx(begun - kinetic, rel=1e-11)
        assert data.impact_flag.values[data.impact_contact.values == "between"][0] == 1
        assert (data.impact_flag.values >= 4).sum() == (depth > 0.0).sum()
        assert np.isnan(data.impact_closing_velocity.values).sum() == 1
        balanced(data)
        assert data.impact_duration.values.sum() == pytest.approx(data.contact_ratio.values.sum() * duration, rel=1e-12)


def test_a_rest_that_is_hit_ends_and_begins_anew():
    network = il.Network(
        {"lower": il.LinearOscillator(mass=1.0), "upper": il.LinearOscillator(mass=1.0)},
        {
            "ground": il.Contact("lower", il.WALL, il.RigidContact(0.0)),
            "between": il.Contact("upper", "lower", il.RigidContact(1.0), clearance=1.0),
        },
        {"gravity": il.BaseMotion(il.ConstantForce(-9.81))},
    )
    data = il.simulate(network, 4.0, initial="rest", integrator=EXACT, record=il.Impacts())
    ground = data.impact_contact.values == "ground"
    assert (data.impact_flag.values[ground][:-1] & 2 == 2).all()
    assert data.impact_flag.values.tolist() == [2, 6, 0, 6]  # the ball is stopped, and rests on the other
    assert data.impact_closing_velocity.values[1] == pytest.approx(math.sqrt(2.0 * 9.81), rel=1e-13)
    balanced(data)


def driven(amplitude):
    force = {"f": il.Source(il.Harmonic(amplitude, frequency=0.8), on={"a": 1.0})}
    return body(il.LinearContact(60.0), 1.0, 0.2, force, damping=0.1, stiffness=1.0)


def test_bins_hold_the_lists():
    starts = {"displacement": {"a": [0.0, 0.1, -0.3]}}
    options = {"initial": starts, "realizations": 3, "integrator": EXACT}
    listed = il.simulate(driven(1.0), 60.0, record=il.Impacts(), **options)
    limits = {"closing_velocity": (0.2, 1.0)}
    counted = il.simulate(driven(1.0), 60.0, record=il.Impacts(bins=16, limits=limits), **options)
    sums = listed.impact_series_size.values
    assert sums.sum() == listed.sizes["impact"]
    assert counted.impact_number.item() == listed.impact_number.item()
    assert counted.impact_rate.item() == listed.impact_number.item() / 180.0
    assert counted.impact_rate.item() == pytest.approx(counted.contact_rate.item(), rel=1e-12)
    whole = listed.impact_flag.values == 0
    for name in ("closing_velocity", "duration", "impulse", "largest_force"):
        values = listed[f"impact_{name}"].values[... if name == "closing_velocity" else whole]
        values = values[np.isfinite(values)]
        edges = counted[f"{name}_edges"].values[0]
        if name in limits:
            assert (edges[0], edges[-1]) == limits[name]
        else:
            assert edges[0] == 0.0
            assert 0.5 * edges[-1] <= values.max() < edges[-1]
            assert math.frexp(edges[1])[0] == 0.5
        number = np.histogram(values, edges)[0]
        np.testing.assert_allclose(
            counted[f"density_{name}"].values[0] * np.diff(edges), number / len(values), rtol=1e-12
        )
        assert counted[f"mean_{name}"].item() == pytest.approx(values.mean(), rel=1e-12)
        assert listed[f"mean_{name}"].item() == counted[f"mean_{name}"].item()
    assert "impact" not in counted.dims


def test_points_of_a_sweep_have_lists_of_their_own(tmp_path):
    options = {"duration": 40.0, "integrator": EXACT, "record": il.Impacts(), "initial": "rest"}
    data = il.sweep(driven, {"amplitude": [0.5, 1.0, 2.0]}, **options)
    for amplitude in (0.5, 1.0, 2.0):
        own, alone = data.sel(amplitude=amplitude), il.simulate(driven(amplitude), **options)
        number = alone.sizes["impact"]
        assert own.impact_series_size.item() == number
        np.testing.assert_array_equal(own.impact_impulse.values[:number], alone.impact_impulse.values)
        assert np.isnan(own.impact_impulse.values[number:]).all()
        assert set(own.impact_contact.values[number:]) <= {""}
    il.save(data, tmp_path / "sweep.nc")
    xr.testing.assert_identical(load(tmp_path / "sweep.nc"), data)


@pytest.mark.parametrize("record", [il.Impacts(), il.Impacts(bins=8)])
@pytest.mark.parametrize("clearance", [0.2, 50.0])  # that is never met
def test_files_and_reruns_have_the_same_impacts(tmp_path, record, clearance):
    network = driven(1.0).replace(
        contacts={"stop": il.Contact("a", il.WALL, il.LinearContact(60.0), clearance=clearance)}
    )
    data = il.simulate(network, 20.0, initial="rest", integrator=EXACT, record=record)
    il.save(data, tmp_path / "run.nc")
    loaded = load(tmp_path / "run.nc")
    xr.testing.assert_identical(loaded, data)
    again = il.rerun(tmp_path / "run.nc")
    xr.testing.assert_equal(again, data)


def test_lists_are_a_table():
    data = il.simulate(driven(1.0), 20.0, initial="rest", integrator=EXACT, record=il.Impacts())
    names = [name for name, item in data.items() if item.dims == ("impact",)]
    table = data[names].to_dataframe()
    assert len(table) == data.sizes["impact"]
    assert {"impact_contact", "impact_realization", "impact_time", "impact_impulse"} <= set(table.columns)


@pytest.mark.full
def test_steps_tell_impacts_as_the_exact_motion_does():
    """A few impacts of a driven body: what steps of 0.01 rad of the contact leave of them."""
    options = {"duration": 25.0, "initial": "rest", "record": il.Impacts()}
    exact = il.simulate(driven(1.0), integrator=EXACT, **options)
    steps = il.simulate(driven(1.0), step=0.01 / math.sqrt(61.0), **options)
    assert steps.sizes["impact"] == exact.sizes["impact"] > 4
    for name in ("time", "closing_velocity", "leaving_velocity", "duration", "impulse", "largest_force"):
        one, other = steps[f"impact_{name}"].values, exact[f"impact_{name}"].values
        np.testing.assert_allclose(one, other, rtol=2e-4, err_msg=name)
    np.testing.assert_allclose(steps.impact_lost_energy.values, 0.0, atol=1e-14)
    assert "two steps" in steps.impact_closing_velocity.attrs["comment"]
    balanced(steps)


@pytest.mark.full
def test_a_damped_contact_loses_the_same_in_steps():
    network = body(il.KelvinVoigtContact(300.0, damping=5.0))
    exact, steps = thrown(network), thrown(network, integrator=il.ExactFlow(), step=1e-4)
    for name in ("time", "closing_velocity", "leaving_velocity", "duration", "impulse", "largest_force", "lost_energy"):
        assert steps[f"impact_{name}"].item() == pytest.approx(exact[f"impact_{name}"].item(), rel=2e-3), name


@pytest.fixture(scope="module")
def noisy():
    """The base pair under white noise."""
    record = [il.Impacts(bins=40), il.PerRealization()]
    return il.simulate(base(), 100.0, realizations=256, record=record, rng=3), il.exact(base())


@pytest.mark.full
def test_closing_velocities_under_white_noise_are_rayleigh_distributed(noisy):
    """But for the slowest: where contacts open again within a step they are not seen."""
    data, exact = noisy
    scale = math.sqrt(exact.statistics().mean_square_velocity.sum().item())  # of the relative velocity
    edges = data.closing_velocity_edges.values[0]
    below = np.exp(-0.5 * (edges / scale) ** 2)
    share, width = below[:-1] - below[1:], np.diff(edges)
    own = data.density_closing_velocity.values[0] * width
    error = data.density_closing_velocity_standard_error.values[0] * width
    assert share[:2].sum() < 0.1
    assert own[0] < share[0]
    counted = np.flatnonzero(share * data.impact_number.item() > 100.0)[2:]
    score = (own / own[2:].sum() - share / share[2:].sum())[counted] / error[counted]
    assert len(counted) > 10
    assert np.abs(score).max() < 3.5
    assert (score**2).mean() < 2.0
    assert data.mean_closing_velocity.item() == pytest.approx(scale * math.sqrt(0.5 * math.pi), rel=0.03)


def test_closings_are_counted_at_the_exact_rate_but_for_the_slowest(noisy):
    """The part that is missed is that of excursions shorter than a step, decay rate times step about."""
    data, exact = noisy
    rate, error = data.impact_rate.item(), data.impact_rate_standard_error.item()
    expected = exact.statistics().contact_rate.item()
    decay = base().oscillators["one"].damping
    assert error < 0.01 * rate
    missed = 1.0 - rate / expected
    assert -3.0 * error / rate < missed < decay * data.attrs["step"] + 3.0 * error / rate
    assert data.contact_rate.item() == pytest.approx(expected, abs=4.0 * data.contact_rate_standard_error.item())


def test_means_over_impacts_make_up_the_means_over_time(noisy):
    """But for impacts that the run begins or ends in, two in a realization at most."""
    data, _ = noisy
    number = data.impact_number.item()
    for name, whole in (("impulse", "mean_contact_force"), ("duration", "contact_ratio")):
        total = data[f"{whole}_by_realization"].sum().item() * 100.0
        assert data[f"mean_{name}"].item() * number == pytest.approx(total, rel=2.0 * 256.0 / number)
    lost, error = data.mean_lost_energy.item(), data.mean_lost_energy_standard_error.item()
    assert abs(lost) < 4.0 * error + 1e-3 * 0.5 * data.mean_closing_velocity.item() ** 2


def test_many_and_few_lanes_have_the_same_lists():
    options = {"duration": 3.0, "realizations": 64, "record": il.Impacts(), "rng": 5, "step": 0.002}
    one = il.simulate(base(), **options)
    with ThreadPoolExecutor(2) as pool:
        other = il.simulate(base(), executor=pool, **options)
    xr.testing.assert_equal(one, other)
    assert one.impact_series_size.sum() == one.sizes["impact"] > 64
    assert (np.diff(one.impact_realization.values) >= 0).all()
    same = np.diff(one.impact_realization.values) == 0
    assert (np.diff(one.impact_time.values)[same] > 0.0).all()


def test_rigid_contacts_need_located_events():
    network = body(il.RigidContact(0.9), excitations={"a": il.WhiteNoise(0.1)}, stiffness=1.0, damping=0.1)
    with pytest.raises(il.InvalidInput, match=r"'stop' is rigid, .* integrator=il.EventLocated\(\)"):
        il.simulate(network, 1.0, record=il.Impacts())


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"contacts": "stop"}, r"contacts must be a list of strings, not 'stop'"),
        ({"contacts": ["top"]}, "no contact 'top'; did you mean 'stop'"),
        ({"quantities": ["impulses"]}, "did you mean 'impulse'"),
        ({"limits": {"impulse": (0.0, 1.0)}}, "give bins="),
        ({"bins": 4, "limits": {"impulse": 1.0}}, r"are \{quantity: \(low, high\)\}"),
        ({"bins": 4, "limits": {"impulse": (1.0, 0.0)}}, "two increasing finite numbers"),
        ({"bins": 4, "limits": {"mass": (1.0, 0.0)}}, "limits: "),
        ({"bins": 0}, "bins"),
        ({"most": 3}, r"more than 3 impacts by .* give a larger most= .* or bins="),
    ],
)
def test_bad_input(options, message):
    with pytest.raises(il.InvalidInput, match=message):
        il.simulate(falling(), 10.0, initial="rest", integrator=EXACT, record=il.Impacts(**options))
