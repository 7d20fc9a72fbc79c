"""Quantities of one's own along located paths, against SciPy and integrals in closed form."""

import numpy as np
import pytest
import scipy.integrate

import impactlab as il


def power(velocity, damping):
    return damping * velocity * velocity


def mixed(displacement, velocity):
    return displacement**3 * velocity + velocity**2 * displacement**2


def rectified(displacement, velocity):
    return displacement**2 * abs(velocity)


def work_rate(force, rate):
    return force * rate


def rate_of(rate):
    return rate


def over_rate(velocity):
    return 1.0 / (velocity - velocity)


STOP = il.Contact("a", il.WALL, il.KelvinVoigtContact(100.0, damping=1.0), clearance=0.5)


def network(kind=il.LinearOscillator, **fields):
    body = kind(mass=1.0, damping=0.1, stiffness=1.0, **fields)
    return il.Network({"a": body}, {"stop": STOP}, {"a": il.Harmonic(0.8, frequency=1.3)})


def run(network, records, duration=20.0, **options):
    return il.simulate(network, duration, record=records, initial="rest", spin_up=0.0, **options)


def exact(duration, cubic=0.0):
    """Means of `mixed`, its square and `rectified`, and velocities, from SciPy with its events."""

    def rates(t, y, closed):
        x, v = y[:2]
        force = max(100.0 * (x - 0.5) + v, 0.0) if closed else 0.0
        value = mixed(x, v)
        acceleration = 0.8 * np.sin(1.3 * t) - 0.1 * v - x - cubic * x**3 - force
        return [v, acceleration, value, value**2, rectified(x, v)]

    opening = [lambda t, y, closed: 100.0 * (y[0] - 0.5) + y[1] if closed else y[0] - 0.5]
    opening[0].terminal, options = True, {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13, "max_step": 0.02}
    time, state, closed, rate = 0.0, np.zeros(5), False, []
    while time < duration:
        opening[0].direction = -1.0 if closed else 1.0
        part = scipy.integrate.solve_ivp(
            rates, (time, duration), state, events=opening, args=(closed,), dense_output=True, **options
        )
        rate.append(part.sol(np.linspace(time, part.t[-1], 20001))[1])
        time, state = part.t[-1], part.y[:, -1]
        closed = not closed and state[0] > 0.4
    return state[2:] / duration, np.concatenate(rate)


@pytest.mark.parametrize("cubic", [0.0, pytest.param(0.5, marks=pytest.mark.full)])
def test_means_and_extremes_are_those_of_scipy(cubic):
    """To the error of the path; a kernel with kinks has the error of the quadrature at these."""
    of_body = il.Observable("mixed", mixed, per="oscillator", units="m4 s-2")
    kinked = il.Observable("rectified", rectified, per="oscillator", units="m3 s-1")
    of_contact = il.Observable("speed", rate_of, per="contact", units="m s-1")
    made = network() if cubic == 0.0 else network(il.DuffingOscillator, cubic=cubic)
    ds = run(made, [of_body, kinked, of_contact])
    (mean, square, of_kinks), rates = exact(20.0, cubic)
    assert ds.attrs["integrator"] == "EventLocated"
    assert float(ds.mean_mixed[0]) == pytest.approx(mean, abs=1e-9 * np.sqrt(square))
    assert float(ds.mean_square_mixed[0]) == pytest.approx(square, rel=1e-7)
    assert float(ds.mean_rectified[0]) == pytest.approx(of_kinks, rel=1e-3)
    assert float(ds.largest_speed[0]) == pytest.approx(rates.max(), rel=1e-4)
    assert float(ds.smallest_speed[0]) == pytest.approx(rates.min(), rel=1e-4)
    assert (ds.density_mixed[0] * np.diff(ds.mixed_edges[0])).sum() == pytest.approx(1.0)


def test_means_of_powers_are_integrals_in_closed_form():
    """To rounding, beside a trajectory with other samples, whose path they share."""
    records = [
        il.Observable("power", power, per="oscillator", units="W", interval=0.1),
        il.Observable("work rate", work_rate, per="contact", units="W"),
        il.EnergyFlows(),
        il.Trajectory(0.25),
    ]
    ds = run(network(), records)
    assert float(ds.mean_power[0]) == pytest.approx(float(ds.power_dissipated[0]), rel=1e-12)
    assert float(ds.mean_work_rate[0]) == pytest.approx(float(ds.contact_power_dissipated[0]), rel=1e-11)
    path, velocity = ds.power.values[0, ::5, 0], ds.velocity.values[0, ::2, 0]
    np.testing.assert_allclose(path, 0.1 * velocity**2, rtol=1e-12, atol=1e-15)
    assert np.isnan(ds.mean_power_standard_error).all()


@pytest.mark.full
@pytest.mark.parametrize("kind", ["sticks", "slides", "kinks", "yields"])
def test_works_of_couplings_are_those_of_energy_flows(kind):
    """Also of dry friction while it sticks, and of laws with states."""
    laws = {
        "sticks": il.CoulombFrictionCoupling(0.3, velocity=0.2),
        "slides": il.JenkinsCoupling(5.0, slip_force=0.3),
        "kinks": il.BilinearCoupling(1.0, outer_stiffness=5.0, break_extension=0.2),
        "yields": il.BoucWenCoupling(0.5, yield_displacement=0.2),
    }
    bodies = {"a": il.LinearOscillator(mass=1.0, damping=0.1, stiffness=1.0), "b": il.LinearOscillator(damping=0.1)}
    coupled = il.Network(
        bodies,
        couplings={
            "own": il.Coupling("a", "b", laws[kind]),
            "spring": il.Coupling("b", il.WALL, il.LinearCoupling(1.0)),
        },
        excitations={"a": il.Harmonic(1.0, frequency=1.3)},
    )
    ds = run(coupled, [il.Observable("work", work_rate, per="coupling", units="W"), il.EnergyFlows()], 30.0)
    assert ds.attrs["integrator"] == "EventLocated"
    absorbed = ds.coupling_power_dissipated + ds.coupling_power_stored
    size = np.abs(ds.coupling_power_carried).max()
    np.testing.assert_allclose(ds.mean_work.values, absorbed.values, atol=1e-9 * float(size))


@pytest.mark.parametrize("kind", ["linear", pytest.param("smooth", marks=pytest.mark.full)])
def test_of_rigid_contacts_gaps_and_rates_are_there_but_no_forces(kind):
    rigid = il.Contact("a", il.WALL, il.RigidContact(0.7), clearance=0.3)
    made = network() if kind == "linear" else network(il.DuffingOscillator, cubic=0.5)
    bouncing = made.replace(contacts={"stop": rigid})
    ds = run(bouncing, [il.Observable("speed", rate_of, units="m s-1"), il.Impacts()])
    assert float(ds.largest_speed[0]) == pytest.approx(float(ds.impact_closing_velocity.max()), rel=1e-9)
    with pytest.raises(il.InvalidInput, match="'stop', a rigid contact"):
        run(bouncing, il.Observable("work", work_rate, units="W"))


def test_starts_a_file_and_a_sweep_have_the_same_numbers(tmp_path):
    record = il.Observable("power", power, per="oscillator", units="W", interval=0.5)
    starts = {"displacement": {"a": [0.1, 0.2, 0.3]}}
    options = {"duration": 10.0, "record": [record, il.PerRealization()], "spin_up": 0.0}
    ds = il.simulate(network(), initial=starts, realizations=3, **options)
    one = il.simulate(network(), initial={"displacement": {"a": 0.2}}, **options)
    np.testing.assert_array_equal(ds.power[1], one.power[0])
    il.save(ds, tmp_path / "power.nc")
    again = il.rerun(tmp_path / "power.nc")
    for name in ("mean_power", "largest_power", "density_power", "power"):
        np.testing.assert_array_equal(again[name], ds[name])
    swept = il.sweep(
        lambda push: network().replace(excitations={"a": il.Harmonic(push, frequency=1.3)}), {"push": [0.8, 1.0]},
        initial="rest", **options,
    )  # fmt: skip
    assert (swept.status == "done").all()
    assert float(swept.mean_power[0, 0]) == float(run(network(), record, 10.0).mean_power[0])


@pytest.mark.full
def test_a_value_that_is_not_finite_is_an_error():
    with pytest.raises(il.InvalidInput, match="'over' is inf at the oscillator 'a' of realization 0"):
        run(network(), il.Observable("over", over_rate, per="oscillator", units="s m-1"))
