"""`il.EventLocated` as a user meets it: datasets, sweeps, starts, refusals, and the error of the path."""

import math

import numpy as np
import pytest

import impactlab as il

EXACT = il.EventLocated()
PERIOD = 2.0 * math.pi / 0.8


def stop(amplitude=0.7, law=None, mass=1.0, clearance=0.2, **options):
    """A driven body at a stop; the mass scales all forces, so that it changes nothing but rounding."""
    return il.Network(
        {"a": il.LinearOscillator(mass=mass, damping=0.1 * mass, stiffness=mass)},
        {"g": il.Contact("a", il.WALL, law or il.LinearContact(60.0 * mass), clearance=clearance)},
        {"a": il.Harmonic(amplitude * mass, frequency=0.8)},
        **options,
    )


def located(network, duration=50.0, **options):
    return il.simulate(network, duration, **{"integrator": EXACT, "spin_up": 0.0, **options})


def test_statistics_and_path_are_those_of_short_steps():
    record = il.Trajectory(PERIOD / 4.0)
    options = {"duration": 8.0 * PERIOD, "spin_up": 2.0 * PERIOD, "record": record}
    found = il.simulate(stop(), integrator=EXACT, **options)
    steps = il.simulate(stop(), integrator=il.ExactFlow(measured=False), step=PERIOD / 8000.0, **options)
    for name in ("mean_displacement", "mean_square_displacement", "variance_displacement", "mean_square_velocity"):
        np.testing.assert_allclose(found[name], steps[name], rtol=3e-5, err_msg=name)
    np.testing.assert_allclose(found.mean_velocity, steps.mean_velocity, atol=1e-5)
    np.testing.assert_allclose(found.contact_ratio, steps.contact_ratio, rtol=5e-3)
    np.testing.assert_allclose(found.contact_rate, steps.contact_rate, rtol=1e-9)
    np.testing.assert_allclose(found.mean_contact_force, steps.mean_contact_force, rtol=3e-5)
    np.testing.assert_allclose(found.peak_contact_force, steps.peak_contact_force, rtol=1e-4)
    for name in ("displacement", "velocity"):
        assert found[name].dims == steps[name].dims
        np.testing.assert_allclose(found[name], steps[name], atol=3e-5)
    np.testing.assert_array_equal(found.time, steps.time)
    assert {name for name in steps.data_vars if "balance" not in name and "contacts_per" not in name} <= set(
        found.data_vars
    )


def test_balances_of_force_and_energy_close_to_rounding():
    """Over whole periods of a periodic motion: k E[x] = −E[F], and the force does no work on average."""
    found = located(stop(0.5), 8.0 * PERIOD, spin_up=100.0 * PERIOD, initial="rest")
    assert found.mean_displacement.item() == pytest.approx(-found.mean_contact_force.item(), rel=1e-11)
    assert found.mean_velocity.item() == pytest.approx(0.0, abs=1e-12)


def test_a_sweep_has_the_numbers_of_single_runs():
    options = {"duration": 30.0, "integrator": EXACT, "record": [il.Trajectory(1.0), il.FinalState()], "spin_up": 5.0}
    over = {"law": [il.RigidContact(0.0), il.RigidContact(0.7)], "amplitude": [0.3, 0.6, 0.9]}
    whole = il.sweep(stop, over, **options)
    assert (whole.status == "done").all()
    for i, law in enumerate(over["law"]):
        for j, amplitude in enumerate(over["amplitude"]):
            alone = il.simulate(stop(amplitude, law), **options)
            point = whole.isel(law=i, amplitude=j)
            for name in alone.data_vars:
                np.testing.assert_array_equal(point[name], alone[name], err_msg=name)
    np.testing.assert_array_equal(il.rerun(whole).displacement, whole.displacement)


def test_a_refused_point_loses_no_other():
    def overlapping(clearance):
        return stop(law=il.RigidContact(0.5), clearance=clearance)

    whole = il.sweep(overlapping, {"clearance": [-0.1, 0.2]}, duration=5.0, integrator=EXACT, initial={})
    assert whole.status.values[1] == "done"
    assert "'g' overlap by 0.1 m" in whole.status.values[0]


def test_thousands_of_starts_are_lanes():
    starts = np.linspace(-2.0, 0.1, 300)
    record = il.Trajectory(1.0)
    many = located(stop(), 10.0, initial={"displacement": {"a": starts}}, realizations=300, record=record)
    one = located(stop(), 10.0, initial={"displacement": {"a": starts[77]}}, record=record)
    np.testing.assert_array_equal(many.displacement[77], one.displacement[0])
    assert many.displacement.shape == (300, 11, 1)


def test_a_run_goes_on_from_the_end_of_another():
    force = {"a": il.ConstantForce(0.5)}
    network = stop(law=il.RigidContact(0.6)).replace(excitations=force)
    record = [il.Trajectory(0.5), il.FinalState()]
    whole = located(network, 8.0, record=record)
    first = located(network, 4.0, record=record)
    rest = located(network, 4.0, record=record, initial=first)
    np.testing.assert_allclose(rest.displacement[0], whole.displacement[0, 8:], atol=1e-9)


def test_a_file_is_written_and_run_again(tmp_path):
    data = located(stop(), 5.0, record=il.Trajectory(0.5), out=tmp_path / "run.nc")
    np.testing.assert_array_equal(il.rerun(tmp_path / "run.nc").displacement, data.displacement)


def test_the_error_of_the_path_is_known():
    """Two runs that differ by rounding alone are as far from each other as the estimate says."""
    record = il.Trajectory(1.0)
    for amplitude in (0.4, 0.9):
        one, two = (located(stop(amplitude, mass=mass), 400.0, record=record) for mass in (1.0, 3.0))
        apart = float(np.abs(one.displacement - two.displacement).max())
        assert apart < one.attrs["path_error"] < 1e3 * apart
        assert one.attrs["path_error"] < 1e-10
        assert one.attrs["undecided_touches"] == 0.0


def test_chaos_is_said():
    """Two stops and weak damping."""
    network = il.Network(
        {"a": il.LinearOscillator(damping=0.02)},
        il.backlash("a", il.WALL, il.RigidContact(0.95), clearance=0.3, name="g"),
        {"a": il.Harmonic(0.6, frequency=1.1)},
    )
    with pytest.warns(il.AccuracyWarning, match="as in chaotic motion"):
        found = located(network, 1000.0)
    assert "chaotic_path" in found.warning.values
    starts = {"displacement": {"a": np.linspace(0.0, 0.1, 8)}}  # averages over these are those of many paths
    assert "warning" not in located(network, 1000.0, initial=starts, realizations=8).dims


def test_a_beam_at_a_stop():
    """Points of a structure have statistics, and a contact acts on a combination of the coordinates of its modes."""
    beam = il.beam(
        1.0, 8.0, 2.0, supports="cantilever", modes=4, damping_ratios=0.01, points={"tip": 1.0, "middle": 0.5}
    )
    network = il.Network(
        {"beam": beam},
        {"stop": il.Contact("beam.tip", il.WALL, il.LinearContact(500.0), clearance=0.02)},
        {"shaking": il.BaseMotion(il.Harmonic(2.0, frequency=6.0))},
    )
    options = {"duration": 4.0, "initial": "rest", "record": il.Trajectory(0.02)}
    found = il.simulate(network, integrator=EXACT, **options)
    steps = il.simulate(network, integrator=il.ExactFlow(measured=False), step=1e-4, **options)
    assert float(found.contact_rate[0]) >= 1.0
    for name in ("displacement", "point_displacement", "contact_force"):
        np.testing.assert_allclose(found[name], steps[name], atol=2e-3 * float(np.abs(steps[name]).max()))
    for name in ("mean_square_displacement", "point_mean_square_displacement", "point_mean_square_velocity"):
        np.testing.assert_allclose(found[name], steps[name], rtol=3e-3)


def test_a_body_in_resonance_is_refused():
    """It is found while the lane runs."""

    def body(stiffness):
        bodies = {"a": il.LinearOscillator(stiffness=stiffness)}
        return il.Network(bodies, {}, {"a": il.Harmonic(1.0, frequency=0.8)})

    with pytest.raises(il.InvalidInput, match="at its natural frequency"):
        il.simulate(body(0.64), 2.0, initial="rest", integrator=il.EventLocated())
    options = {"duration": 2.0, "initial": "rest", "integrator": il.EventLocated()}
    points = il.sweep(body, {"stiffness": [0.64, 1.0]}, **options)
    assert "at its natural frequency" in points.status.values[0]
    assert points.status.values[1] == "done"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"excitations": {"a": il.WhiteNoise(1.0)}}, "does not handle the excitation of 'a'"),
        (
            {
                "oscillators": {"a": il.DuffingOscillator(cubic=1.0)},
                "couplings": {"c": il.Coupling(il.WALL, "a", il.CoulombFrictionCoupling(0.5))},
            },
            "knows no dry frictions that stick such as 'c'",
        ),
        ({"oscillators": {"a": il.LinearOscillator(stiffness=0.64)}}, "undamped mode at its natural frequency"),
    ],
)
def test_other_networks_are_refused_by_name(change, message):
    with pytest.raises(il.InvalidInput, match=message) as found:
        located(stop().replace(**change))
    assert "il.ExactFlow()" in str(found.value)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"step": 0.1}, "makes no steps"),
        ({"record": il.Density()}, "keeps no Density"),
        ({"initial": {"displacement": {"a": [0.0, 0.1]}}}, "give realizations=2"),
    ],
)
def test_options_that_need_steps_are_refused(options, message):
    with pytest.raises(il.InvalidInput, match=message):
        located(stop(), **options)


def test_a_held_run_refuses_it():
    with pytest.raises(il.InvalidInput, match="makes no steps"):
        il.Run(stop(), integrator=EXACT)


def test_a_tolerance_is_positive():
    with pytest.raises(il.InvalidInput, match="tolerance"):
        il.EventLocated(0.0)


def test_a_spin_up_may_be_interrupted(monkeypatch):
    """A call that ends before the measurement begins is no sign of events without end."""
    whole = located(stop(), spin_up=50.0)
    monkeypatch.setattr("impactlab.located.course.LOOKS_OF_CALL", 1)
    monkeypatch.setattr("impactlab.located.course.LEAST_LOOKS", 1)
    assert np.array_equal(located(stop(), spin_up=50.0).mean_displacement, whole.mean_displacement)


@pytest.mark.filterwarnings("ignore:Rounding has grown")
def test_a_body_that_is_pressed_to_a_stop_where_a_run_begins_rests_there():
    """It has not moved before, and its velocity is rounding."""
    body = il.LinearOscillator(mass=1.0, stiffness=1.0, damping=0.1)
    contact = {"stop": il.Contact("a", il.WALL, il.RigidContact(0.8))}
    network = il.Network({"a": body}, contact, {"a": il.Harmonic(1.0, frequency=2.8)})
    for spin_up in (500.0, 501.0, 502.0):
        data = il.simulate(network, 1.0, spin_up=spin_up, initial="rest", integrator=EXACT)
        assert data.attrs["events"] > 100


def test_bounces_are_summed_wherever_the_stop_is():
    """At a stop where the body would be at rest all impacts happen at the displacement 0."""
    for clearance in (-0.1, 0.0, 0.1):
        body = il.LinearOscillator(mass=1.0, stiffness=1.0, damping=0.1)
        contact = {"stop": il.Contact("a", il.WALL, il.RigidContact(0.5), clearance=clearance)}
        network = il.Network({"a": body}, contact, {"a": il.ConstantForce(1.0)})
        data = il.simulate(network, 50.0, initial={"displacement": {"a": -1.0}}, integrator=EXACT, record=il.Impacts())
        assert np.isnan(data.contact_rate.item())  # endless bounces, summed
        assert 12 < data.sizes["impact"] < 25


def test_a_rest_that_is_hardly_released_takes_no_longer_than_others():
    """The table falls as fast as the ball for a moment: the force between them touches 0."""
    bodies = {"ball": il.LinearOscillator(mass=1.0), "table": il.PrescribedMotion(il.Harmonic(1.0, frequency=1.0))}
    contact = {"hit": il.Contact("table", "ball", il.RigidContact(0.5))}
    network = il.Network(bodies, contact, {"weight": il.Source(il.ConstantForce(-1.0), on="ball")})
    data = il.simulate(network, 40.0, initial="rest", spin_up=0.0, integrator=EXACT)
    assert data.attrs["evaluations"] < 1000
    assert data.contact_ratio.item() > 0.8
