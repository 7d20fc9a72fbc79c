"""Work rates of contacts: of paths, of a rotor that rubs all the time, refusals."""

import re
import warnings

import numpy as np
import pytest
import scipy.stats
from test_extremes import towers

import impactlab as il

pytestmark = pytest.mark.full


def test_work_of_closing_is_that_of_the_paths():
    record = [il.Wear(coefficient=2e-3), il.Trajectory(0.005)]
    ds = il.simulate(towers(), 5.0, realizations=64, step=0.005, record=record, rng=1)
    speed = ds.velocity.sel(oscillator="upper") - ds.velocity.sel(oscillator="lower")
    power = (ds.contact_force.sel(contact="gap") * np.maximum(speed, 0.0))[:, 1:]
    np.testing.assert_allclose(ds.contact_work_rate, [power.mean()], rtol=1e-12)
    np.testing.assert_allclose(ds.wear_rate, 2e-3 * ds.contact_work_rate, rtol=1e-12)
    each = power.mean("time").values
    error = each.std(ddof=1) / 8.0 * (1.0 + 7.0 / 6.0 * scipy.stats.skew(each) ** 2 / 64)
    assert float(ds.contact_work_rate_standard_error[0]) == pytest.approx(error, rel=1e-9)
    assert ds.contact_work_rate.attrs["units"] == "W"


@pytest.mark.filterwarnings("ignore::impactlab.ImpactLabWarning")
def test_a_rotor_that_rubs():
    """It is pressed on its stator and whirls forwards: the work rate is the force times the sliding velocity."""
    omega, surface = 20.0, 3.0
    rotor = il.LinearStructure([2.0, 2.0], damping=40.0 * np.eye(2), stiffness=200.0 * np.eye(2), names=("x", "y"))
    rub = il.RoundContact(
        ("rotor.x", "rotor.y"), il.WALL, il.KelvinVoigtContact(1e4, damping=20.0), clearance=0.001,
        friction_coefficient=0.1, surface_velocity=surface, friction_velocity=0.1,
    )  # fmt: skip
    forces = {
        "rotor.x": il.Harmonic(40.0, frequency=omega),
        "rotor.y": il.Harmonic(40.0, frequency=omega, phase=-np.pi / 2.0),
    }
    network = il.Network({"rotor": rotor}, {"rub": rub}, forces)
    record = [il.Wear(), il.Trajectory(0.001)]
    ds = il.simulate(network, 2.0, step=0.001, spin_up=4.0, initial="rest", record=record)
    x, y = (ds.displacement[0].sel(oscillator=f"rotor.{name}").values for name in "xy")
    u, v = (ds.velocity[0].sel(oscillator=f"rotor.{name}").values for name in "xy")
    sliding = (x * v - y * u) / np.hypot(x, y) + surface
    power = (ds.contact_force[0, :, 0].values * np.abs(sliding))[1:]
    np.testing.assert_allclose(ds.contact_work_rate, [power.mean()], rtol=1e-12)
    radius = np.hypot(x, y).mean()
    whirl = np.sign(np.mean(x * v - y * u)) * omega
    assert float(ds.contact_work_rate[0]) == pytest.approx(
        float(ds.mean_contact_force[0]) * abs(whirl * radius + surface), rel=2e-3
    )


def rubbing(step, seed=1):
    """The work rate of a body in a ring under white noise, its standard error, and the warnings on it."""
    body = il.LinearOscillator(damping=0.5, stiffness=10.0)
    ring = il.RoundContact(("x", "y"), il.WALL, il.LinearContact(2e3), clearance=0.1, friction_coefficient=0.3,
                           friction_velocity=0.05)  # fmt: skip
    network = il.Network({"x": body, "y": body}, {"ring": ring}, dict.fromkeys("xy", il.WhiteNoise(1.0)))
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        ds = il.simulate(network, 20.0, realizations=256, step=step, record=il.Wear(), rng=seed)
    on_it = [str(item.message) for item in told if str(item.message).startswith("Wear")]
    return ds.contact_work_rate.item(), ds.contact_work_rate_standard_error.item(), on_it


def test_a_step_in_which_friction_holds_a_body_is_told():
    work, error, (told,) = rubbing(0.004)
    enough = float(re.search(r"step=(\S+)\.$", told)[1])
    fine, its_error, silent = rubbing(enough, seed=2)
    finer, finer_error, _ = rubbing(enough / 4.0, seed=3)
    assert not silent
    assert work - finer > 4.0 * np.hypot(error, finer_error)
    assert abs(fine - finer) < 0.02 * finer + 3.0 * np.hypot(its_error, finer_error)


@pytest.mark.parametrize(
    ("record", "law", "message"),
    [
        (il.Wear(("gab",)), None, "did you mean 'gap'"),
        (il.Wear(("gap",), surface_velocities=(1.0, 2.0)), None, "1 contacts have so many surface_velocities, not 2"),
        (il.Wear(("gap",)), il.RigidContact(0.5), "'gap' is a RigidContact"),
        (il.Wear(), il.RigidContact(0.5), "no contact of this network has a force"),
    ],
)
def test_what_is_wrong_is_named(record, law, message):
    with pytest.raises(il.InvalidInput, match=message):
        il.simulate(towers(law), 2.0, record=record, rng=1)
