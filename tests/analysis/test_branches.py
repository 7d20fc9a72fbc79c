"""Branches of orbits and curves of their events, against closed forms and given constants."""

import math
import re

import numpy as np
import pytest
import xarray as xr
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq, fsolve

import impactlab as il
from impactlab.analysis.linear_orbits import LinearOrbits
from impactlab.analysis.made_networks import MadeNetworks, made_again
from impactlab.located.families import Family

TURN = 2.0 * math.pi


def cosine(amplitude, frequency):
    return il.Harmonic(amplitude=amplitude, frequency=frequency, phase=0.5 * math.pi)


def stop(frequency=1.0, gap=0.0, amplitude=1.0, law=None):
    """One driven body and its stop."""
    return il.Network(
        oscillators={"a": il.LinearOscillator(damping=0.1, stiffness=1.0)},
        contacts={"stop": il.Contact("a", il.WALL, law or il.RigidContact(restitution=0.8), clearance=gap)},
        excitations={"a": cosine(amplitude, frequency)},
    )


def at(branch, name, event):
    """Values of a parameter at which there is an event, in the order of the branch."""
    return branch[name].values[branch["bifurcation"].values == event]


def one(orbits, **wanted):
    """The first orbit with some properties."""
    for number in range(orbits.sizes["orbit"]):
        if all(round(float(orbits[name].values[number])) == value for name, value in wanted.items()):
            return orbits.isel(orbit=[number])
    raise AssertionError(f"no orbit has {wanted}")


@pytest.fixture(scope="module")
def branch():
    return il.continue_orbits(lambda frequency: stop(frequency), il.orbits(stop(2.0)), {"frequency": (0.9, 3.0)})


def test_flips_of_the_driven_stop(branch):
    """Period one is stable between two flips: constants of the multiplier −1 by other means."""
    flips = at(branch, "frequency", "flip")
    assert np.abs(flips - 1.2297353466).min() < 5e-11
    assert np.abs(flips - 2.6588845467).min() < 5e-11
    frequency, stable = branch["frequency"].values, branch["stable"].values
    inside = (frequency > 1.2297353466 + 1e-9) & (frequency < 2.6588845467 - 1e-9)
    assert stable[inside].all()
    assert not stable[(frequency > 2.6588845467 + 1e-9)].any()


def test_multipliers_have_a_known_product_along_the_branch(branch):
    both = branch["multiplier_real"].values + 1j * branch["multiplier_imag"].values
    known = 0.64 ** branch["impacts"].values * np.exp(-0.1 * branch["period"].values)
    hits = np.nanmin(branch["closing_velocity"].values, axis=1) > 0.1  # where it grazes, multipliers are infinite
    np.testing.assert_allclose(both.prod(axis=1).real[hits], known[hits], rtol=1e-12)
    assert hits.sum() > 0.9 * len(hits)


def test_all_orbits_are_closed_on_paths_of_their_own(branch):
    grazes = branch["bifurcation"].values == "grazing"
    assert np.nanmax(branch["closure"].values[~grazes]) < 1e-11
    assert branch.attrs["ends"] == "the end of the range is reached at 0.9; the end of the range is reached at 3"
    assert branch["frequency"].values[[0, -1]].tolist() == [0.9, 3.0]


def test_straight_lines_between_orbits_are_near_the_branch(branch):
    """Some hundred orbits, as near to those of a fine branch as is told."""
    fine = il.continue_orbits(
        lambda frequency: stop(frequency), il.orbits(stop(2.0)), {"frequency": (0.9, 3.0)}, points=500
    )
    assert len(branch["frequency"]) < 400 < 1000 < len(fine["frequency"])
    assert branch.attrs["interpolation_error"] < 1e-3
    frequency, chosen = fine["frequency"].values, fine["frequency"].values > 1.05  # where the branch does not turn
    velocities = fine["closing_velocity"].values[chosen, 0]
    line = np.interp(frequency[chosen], branch["frequency"].values, branch["closing_velocity"].values[:, 0])
    assert np.abs(line - velocities).max() < 2e-3 * velocities.max()


def test_an_orbit_without_impacts_grazes_and_goes_on_with_one():
    """The linear response has the amplitude of the gap at A = sqrt((1 − ω²)² + (0.1 ω)²)."""

    def make(amplitude):
        return stop(0.8, 1.0, amplitude)

    found = il.continue_orbits(make, il.orbits(make(0.2)), {"amplitude": (0.1, 1.0)})
    assert at(found, "amplitude", "grazing") == pytest.approx([0.3687817783], abs=1e-10)
    impacts = found["impacts"].values
    assert set(impacts[found["amplitude"].values < 0.36]) == {0}
    assert impacts[-1] == 1
    assert np.nanmax(found["closure"].values) < 1e-6


@pytest.mark.parametrize(("restitution", "periods"), [(0.5, 1), (0.8, 1), (0.8, 2)])
def test_windows_of_the_bouncing_ball(restitution, periods):
    """P. J. Holmes, J. Sound Vib. 84, 1982: folds and flips of orbits of n periods of a vibrating table."""
    gravity, frequency = 9.81, 10.0 * TURN
    low = math.pi * periods * (1.0 - restitution) / (1.0 + restitution)
    high = math.sqrt(low**2 + (2.0 * (1.0 + restitution**2) / (1.0 + restitution) ** 2) ** 2)

    def make(gamma):
        table = il.PrescribedMotion(il.Harmonic(amplitude=gamma * gravity / frequency**2, frequency=frequency))
        return il.Network(
            oscillators={"ball": il.LinearOscillator(), "table": table},
            contacts={"bounce": il.Contact("table", "ball", il.RigidContact(restitution=restitution))},
            excitations={"ball": il.ConstantForce(load=-gravity)},
        )

    found = il.orbits(make(0.5 * (low + high)), start="search", periods=periods)
    period = periods * TURN / frequency
    begin = next(
        found.isel(orbit=[place])
        for place in range(found.sizes["orbit"])
        if found["impacts"].values[place] == 1 and abs(found["period"].values[place] - period) < 1e-9
    )
    branch = il.continue_orbits(make, begin, {"gamma": (0.5 * low, 1.2 * high)})
    assert at(branch, "gamma", "fold") == pytest.approx([low], rel=1e-10)
    assert at(branch, "gamma", "flip") == pytest.approx([high], rel=1e-10)


@pytest.mark.full
def test_the_threshold_of_an_impact_damper():
    """Two impacts a period of a ball in a cavity begin at amplitudes of σ/sqrt(1 + σ²) of its half length."""
    restitution = 0.6
    slope = 2.0 * (1.0 - restitution) / (math.pi * (1.0 + restitution))
    threshold = slope / math.sqrt(1.0 + slope**2)

    def make(amplitude):
        law = il.RigidContact(restitution=restitution)
        return il.Network(
            oscillators={
                "ball": il.LinearOscillator(mass=1e-3),
                "box": il.PrescribedMotion(il.Harmonic(amplitude=amplitude, frequency=1.0)),
            },
            contacts=il.backlash("ball", "box", law, clearance=1.0, name="play"),
        )

    found = one(il.orbits(make(1.3 * threshold), start="search", periods=1), impacts=2)
    branch = il.continue_orbits(make, found, {"amplitude": (0.5 * threshold, 2.0 * threshold)}, points=100)
    assert at(branch, "amplitude", "fold") == pytest.approx([threshold], rel=1e-10)


def test_grazing_over_two_parameters_is_the_resonance_curve():
    def make(amplitude, frequency):
        return stop(frequency, 1.0, amplitude)

    curve = il.continue_orbits(
        make, il.orbits(make(0.2, 0.8)), {"amplitude": (0.05, 1.0)}, also={"frequency": (0.5, 1.4)},
        bifurcation="grazing",
    )  # fmt: skip
    frequency, amplitude = curve["frequency"].values, curve["amplitude"].values
    assert len(frequency) >= 100
    assert frequency.min() == 0.5
    np.testing.assert_allclose(amplitude, np.sqrt((1.0 - frequency**2) ** 2 + (0.1 * frequency) ** 2), rtol=1e-12)


def test_a_flip_over_two_parameters():
    """With the wall in the middle amplitudes scale: the flip stays, whatever the amplitude; at a gap it has −1."""
    found = il.orbits(stop(2.0))
    level = il.continue_orbits(
        lambda frequency, amplitude: stop(frequency, 0.0, amplitude), found, {"frequency": (1.5, 3.0)},
        also={"amplitude": (0.5, 2.0)}, bifurcation="flip",
    )  # fmt: skip
    np.testing.assert_allclose(level["frequency"], 2.6588845467, atol=5e-11)
    assert level["stable"].values.all()  # but for the multiplier −1, whose rounding does not count
    assert level["amplitude"].values.min() == 0.5
    assert level["amplitude"].values.max() == 2.0
    curve = il.continue_orbits(
        lambda frequency, gap: stop(frequency, gap), found, {"frequency": (1.5, 3.0)}, also={"gap": (-0.1, 0.3)},
    )  # fmt: skip
    np.testing.assert_allclose(np.abs(curve["multiplier_real"].values + 1.0).min(axis=1), 0.0, atol=1e-8)
    assert np.ptp(curve["gap"].values) > 0.39


@pytest.mark.full
def test_a_hertz_stop_by_the_same_call():
    """Grazing as of the linear response; the orbit flips behind it, and is found where it is unstable."""

    def make(amplitude):
        return stop(0.8, 1.0, amplitude, il.HertzContact(50.0))

    found = il.continue_orbits(make, il.orbits(make(0.3)), {"amplitude": (0.3, 0.42)}, points=8)
    assert at(found, "amplitude", "grazing") == pytest.approx([0.3687817783], abs=1e-7)
    (flip,) = at(found, "amplitude", "flip")
    amplitude, stable = found["amplitude"].values, found["stable"].values
    assert stable[amplitude < flip - 1e-6].all()
    assert not stable[amplitude > flip + 1e-6].any()
    assert il.orbits(make(0.42))["periods"].values[0] == 2
    network, state = make(0.42), [found["displacement"].values[-1, 0], found["velocity"].values[-1, 0]]
    period = TURN / 0.8
    path = solve_ivp(network.compile().rhs, (0.0, period), state, "DOP853", rtol=1e-11, atol=1e-13, max_step=0.02)
    np.testing.assert_allclose(path.y[:, -1], state, atol=1e-8)


def test_branches_begin_with_one_orbit_of_their_networks():
    found = il.orbits(stop(2.0))

    def make(frequency):
        return stop(frequency)

    with pytest.raises(il.InvalidInput, match=r"none that make returns in the range; the nearest is at frequency=1\.5"):
        il.continue_orbits(make, found, {"frequency": (0.5, 1.5)})
    with pytest.raises(il.InvalidInput, match="none that make returns"):
        il.continue_orbits(lambda frequency: stop(frequency, 0.5), found, {"frequency": (0.5, 3.0)})
    with pytest.raises(il.InvalidInput, match="orbit must be a Dataset"):
        il.continue_orbits(make, "orbit", {"frequency": (0.5, 3.0)})
    with pytest.raises(il.InvalidInput, match="There are 2 orbits"):
        il.continue_orbits(make, found.isel(orbit=[0, 0]), {"frequency": (0.5, 3.0)})


@pytest.mark.full
@pytest.mark.parametrize(
    ("law", "end", "options"),
    [
        (None, 2.7, {"points": 100}),
        (None, 2.7, {"also": {"gap": (-0.1, 0.1)}, "bifurcation": "flip", "points": 20}),
        (il.HertzContact(50.0), 2.55, {"points": 2}),
    ],
)
def test_rerun(law, end, options, tmp_path):
    """Of a file, without the function that made the networks."""

    def make(frequency, gap=0.0):
        return stop(frequency, gap, law=law)

    start = il.orbits(make(2.5), il.Strobe(TURN / 2.5, start=1.0))
    ends = xr.DataArray([2.45, end], attrs={"units": "rad s-1"})
    found = il.continue_orbits(make, start, {"frequency": ends}, **options)
    il.save(found, tmp_path / "branch.nc")
    again = il.rerun(tmp_path / "branch.nc")
    assert again.drop_attrs().identical(found.drop_attrs())
    assert again.frequency.attrs == found.frequency.attrs
    assert again.attrs["ends"] == found.attrs["ends"]
    assert il.network_of(again) == make(2.5)


@pytest.mark.full
@pytest.mark.parametrize("law", [None, il.HertzContact(50.0)])
def test_rerun_without_a_network_is_refused(law):
    """A branch must not end where a network is lost."""
    found = il.continue_orbits(
        lambda frequency: stop(frequency, law=law), il.orbits(stop(2.5, law=law)), {"frequency": (2.45, 2.55)}, points=2
    )
    with pytest.raises(il.ImpactLabError, match=r"The network at frequency=.* is not stored"):
        il.rerun(found.isel(network=slice(-1)))
    with pytest.raises(il.InvalidInput, match="has lost its variable"):
        il.rerun(found[["period"]])


def test_networks_that_were_refused_are_refused_again():
    made = MadeNetworks(lambda frequency: stop(frequency, gap="none" if frequency > 1.0 else 0.0))
    made(frequency=0.5)
    with pytest.raises(il.InvalidInput) as refused:
        made(frequency=2.0)
    again = made_again(xr.Dataset({"impactlab_configuration": made.variable()}))
    assert again(frequency=0.5) == stop(0.5)
    with pytest.raises(il.InvalidInput, match=re.escape(str(refused.value))):
        again(frequency=2.0)


@pytest.mark.parametrize(
    ("over", "options", "message"),
    [
        ({"frequency": (3.0, 0.5)}, {}, "from a lower to a higher value"),
        ({"frequency": 2.0}, {}, "must be a list of numbers"),
        ({}, {}, "one parameter"),
        ({"frequency": (0.5, 3.0)}, {"points": 1}, "points is"),
        ({"frequency": (0.5, 3.0)}, {"also": {"frequency": (0.1, 0.3)}}, "it is 'frequency' again"),
        ({"frequency": (0.5, 3.0)}, {"bifurcation": "flip"}, "give also="),
        ({"frequency": (0.5, 3.0)}, {"also": {"gap": (-0.1, 0.3)}, "bifurcation": "hopf"}, "bifurcation is"),
    ],
)
def test_options_that_are_refused(over, options, message):
    with pytest.raises(il.InvalidInput, match=message):
        il.continue_orbits(lambda frequency, gap=0.0: stop(frequency, gap), il.orbits(stop(2.0)), over, **options)


def test_an_event_that_is_not_on_the_branch():
    with pytest.raises(il.NoOrbit, match="There is no fold on the branch of the orbit, but flip"):
        il.continue_orbits(
            lambda frequency, gap: stop(frequency, gap), il.orbits(stop(2.0)), {"frequency": (1.5, 3.0)},
            also={"gap": (-0.1, 0.3)}, bifurcation="fold",
        )  # fmt: skip


def test_progress_and_interrupts():
    told = []
    il.continue_orbits(
        lambda frequency: stop(frequency), il.orbits(stop(2.0)), {"frequency": (1.5, 2.5)}, progress=told.append
    )
    assert told[-1] == 1.0
    assert all(0.0 <= part <= 1.0 for part in told)

    def interrupt(part):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as caught:
        il.continue_orbits(
            lambda frequency: stop(frequency), il.orbits(stop(2.0)), {"frequency": (1.5, 2.5)}, progress=interrupt
        )
    assert caught.value.found["bifurcation"].values.tolist() == ["start"]


def capsule(frequency):
    """A body in a shell that only dry friction holds."""
    return il.Network(
        oscillators={"shell": il.LinearOscillator(mass=1.0), "mass": il.LinearOscillator(mass=0.5)},
        contacts={"stop": il.Contact("mass", "shell", il.LinearContact(100.0), clearance=0.02)},
        couplings={
            "ground": il.Coupling("shell", il.WALL, il.CoulombFrictionCoupling(friction=0.3)),
            "spring": il.Coupling("mass", "shell", il.LinearCoupling(stiffness=1.0, damping=0.2)),
        },
        excitations={"drive": il.Source(cosine(0.4, frequency), on={"mass": 1.0, "shell": -1.0})},
    )


def gear(frequency):
    """Teeth with play both ways."""
    law = il.KelvinVoigtContact(stiffness=200.0, damping=2.0)
    return il.Network(
        oscillators={"pinion": il.LinearOscillator(damping=0.3), "wheel": il.LinearOscillator(mass=2.0, damping=0.4)},
        contacts=il.backlash("pinion", "wheel", law, clearance=0.05, name="mesh"),
        couplings={"hold": il.Coupling("wheel", il.WALL, il.LinearCoupling(stiffness=5.0))},
        excitations={
            "drive": il.Source(cosine(5.0, frequency), on="pinion"),
            "torque": il.Source(il.ConstantForce(load=2.0), on={"pinion": 1.0, "wheel": -1.0}),
        },
    )


def beam(frequency):
    """Ten modes at a stop."""
    modes = il.beam(1.0, 1.0, 1.0, supports="cantilever", modes=10, damping_ratios=0.02, points={"tip": 1.0})
    return il.Network(
        oscillators={"beam": modes},
        contacts={"stop": il.Contact("beam.tip", il.WALL, il.LinearContact(50.0), clearance=0.02)},
        excitations={"force": il.Source(cosine(0.05, frequency), on={"beam.tip": 1.0})},
    )


@pytest.mark.full
@pytest.mark.parametrize(("make", "begin", "end"), [(capsule, 1.0, 1.05), (gear, 3.0, 3.1), (beam, 3.0, 3.05)])
def test_branches_of_machines_agree_with_paths_that_settle(make, begin, end):
    found = il.continue_orbits(make, il.orbits(make(begin)), {"frequency": (begin - 0.01, end)}, points=20)
    assert np.nanmax(found["closure"].values) < 1e-8
    assert found["frequency"].values[-1] == end
    assert found["stable"].values[-1] == 1
    length = 200 * TURN / end
    path = il.simulate(make(end), duration=length, initial="rest", spin_up=0.0, record=[il.FinalState()])
    for name in found["oscillator"].values[:1]:
        last = found["velocity"].sel(oscillator=name).values[-1]
        assert path["final_velocity"].sel(oscillator=name).item() == pytest.approx(last, abs=1e-6)


def rubbing(phase, friction=0.4):
    """A driven body with dry friction, which sticks twice a period."""
    return il.Network(
        oscillators={"a": il.LinearOscillator(damping=0.1, stiffness=1.0)},
        couplings={"ground": il.Coupling("a", il.WALL, il.CoulombFrictionCoupling(friction=friction))},
        excitations={"a": il.Harmonic(amplitude=1.0, frequency=0.5, phase=phase)},
    )


def resting(phase, gap=0.1):
    """A driven body that comes to rest at a stop by bounces."""
    return il.Network(
        oscillators={"a": il.LinearOscillator(damping=0.1, stiffness=1.0)},
        contacts={"stop": il.Contact("a", il.WALL, il.RigidContact(restitution=0.3), clearance=gap)},
        excitations={"a": il.Harmonic(amplitude=1.0, frequency=0.4, phase=phase)},
    )


@pytest.mark.parametrize("make", [rubbing, resting])
@pytest.mark.parametrize("begin", [0.1, 6.1])
def test_phases_of_stick_and_rest_cross_the_beginning_of_a_period(make, begin):
    """A phase of the force moves the orbit in time only: impacts, losses and period stay, events go around."""
    found = il.continue_orbits(make, il.orbits(make(begin)), {"phase": (0.0, 6.2)})
    assert found["phase"].values[[0, -1]].tolist() == [0.0, 6.2]
    assert set(found["bifurcation"].values) == {"", "start"}
    assert np.nanmax(found["closure"].values) < 1e-10
    np.testing.assert_allclose(found["energy_lost"], found["energy_lost"].values[0], rtol=1e-10)
    frequency = 0.5 if make is rubbing else 0.4
    period, times = TURN / frequency, found["event_time"].values
    moved = (times + found["phase"].values[:, None] / frequency) % period
    moved = np.sort(np.where(moved > period - 1e-9, moved - period, moved), axis=1)
    np.testing.assert_allclose(moved, np.repeat(moved[:1], len(moved), axis=0), atol=1e-8)


def test_a_rest_that_vanishes_becomes_bounces():
    """Behind it the number of bounces falls one by one, each by a grazing and a fold; in the end paths lead there."""
    with pytest.warns(il.AccuracyWarning, match="orbits of the branch are not closed"):  # rests of no length
        found = il.continue_orbits(lambda gap: resting(0.0, gap), il.orbits(resting(0.0)), {"gap": (0.0, 0.9)})
    assert found["gap"].values[[0, -1]].tolist() == [0.0, 0.9]
    impacts, events = found["impacts"].values, found["bifurcation"].values
    assert impacts[0] > 10
    assert impacts[-1] == 2
    assert (events == "fold").sum() >= 8
    assert np.nanmax(found["closure"].values) < 1e-6
    network, period = resting(0.0, 0.9), TURN / 0.4
    path = il.simulate(network, duration=60 * period, initial="rest", spin_up=0.0, record=[il.FinalState()])
    assert path["final_displacement"].item() == pytest.approx(found["displacement"].values[-1, 0], abs=1e-9)


def test_a_brief_contact_across_the_beginning_of_a_period():
    """Cosines whose response is largest at the time 0: the contact of a spring shrinks to nothing there."""
    phase = 0.5 * math.pi + math.atan2(0.1 * 0.8, 1.0 - 0.64)

    def make(amplitude):
        return il.Network(
            oscillators={"a": il.LinearOscillator(damping=0.1, stiffness=1.0)},
            contacts={"stop": il.Contact("a", il.WALL, il.LinearContact(0.5), clearance=1.0)},
            excitations={"a": il.Harmonic(amplitude=amplitude, frequency=0.8, phase=phase)},
        )

    found = il.continue_orbits(make, il.orbits(make(0.45)), {"amplitude": (0.2, 0.5)})
    assert at(found, "amplitude", "grazing") == pytest.approx([0.3687817783], abs=1e-9)
    assert found["amplitude"].values[[0, -1]].tolist() == [0.2, 0.5]
    assert set(found["impacts"].values[found["amplitude"].values < 0.3687]) == {0}
    curve = il.continue_orbits(
        lambda amplitude, other: make(amplitude / other), il.orbits(make(0.45)), {"amplitude": (0.3, 0.5)},
        also={"other": (0.8, 1.2)}, bifurcation="grazing",
    )  # fmt: skip
    np.testing.assert_allclose(curve["amplitude"] / curve["other"], 0.3687817783, atol=1e-9)


@pytest.mark.full
def test_slips_in_sticks_come_and_go():
    """A capsule: where the friction's limit is touched a short slip begins, or a short stick vanishes."""
    found = il.continue_orbits(capsule, il.orbits(capsule(1.0)), {"frequency": (0.8, 1.3)})
    assert found["frequency"].values[[0, -1]].tolist() == [0.8, 1.3]
    assert np.nanmax(found["closure"].values) < 1e-10


@pytest.mark.full
def test_openings_in_impacts_and_sticks_at_the_beginning_come_and_go():
    """A capsule: an impact opens for a moment, and a period begins in a stick; against paths that settle."""
    found = il.continue_orbits(capsule, il.orbits(capsule(0.66)), {"frequency": (0.525, 0.67)})
    assert found["frequency"].values[[0, -1]].tolist() == [0.525, 0.67]
    assert np.nanmax(found["closure"].values) < 1e-8
    for frequency in (0.525, 0.6, 0.67):
        place = int(np.abs(found["frequency"].values - frequency).argmin())
        value, period = found["frequency"].values[place], TURN / found["frequency"].values[place]
        path = il.simulate(
            capsule(value), duration=80 * period, initial="rest", spin_up=0.0, record=[il.Trajectory(period)]
        )
        shell, velocity = path["displacement"].sel(oscillator="shell").values[0], path["velocity"].values[0, -1]
        assert np.diff(shell)[-1] == pytest.approx(found["drift"].sel(oscillator="shell").values[place], abs=1e-8)
        np.testing.assert_allclose(velocity, found["velocity"].values[place], atol=1e-7)


def test_states_at_events_are_those_of_the_orbit():
    """Not of a network beside it, whose equations tell their derivatives."""
    made = il.orbits(stop(2.0))
    branch = il.continue_orbits(lambda frequency: stop(frequency), made, {"frequency": (1.9, 2.1)}, points=2)
    family = LinearOrbits(
        Family.about(lambda frequency: stop(frequency), {"frequency": (1.0, 3.0)}, np.array([2.0]))[0]
    )
    orbit = family.near(
        np.array([made["displacement"].item(), made["velocity"].item()]), np.array([2.0]), math.pi, (0, 1)
    )
    before, after = (family.state_at_event(orbit, 0, later) for later in (False, True))
    assert before[1] == pytest.approx(made["closing_velocity"].values[0, 0], rel=1e-13)
    np.testing.assert_allclose(after, [before[0], -0.8 * before[1]], rtol=1e-13)
    assert branch.sizes["point"] > 2


def pair(frequency):
    """Two bodies in a row, the first of which is driven and has a stop."""
    return il.Network(
        {"a": il.LinearOscillator(damping=0.2, stiffness=1.0), "b": il.LinearOscillator()},
        {"stop": il.Contact("a", il.WALL, il.RigidContact(restitution=0.8))},
        {"a": cosine(1.0, frequency)},
        {"spring": il.Coupling("a", "b", il.LinearCoupling(1.0, damping=0.2))},
    )


def largest_of_pair(frequency, guess):
    """Return the size of the largest multiplier of the orbit of one impact a period, by exponentials of matrices."""
    between = np.array([[1.0, -1.0], [-1.0, 1.0]])
    motion = np.zeros((6, 6))
    motion[:2, 2:4], motion[2:4, :2] = np.eye(2), -np.diag([1.0, 0.0]) - between
    motion[2:4, 2:4] = -0.2 * np.diag([1.0, 0.0]) - 0.2 * between
    motion[2, 4], motion[4, 5], motion[5, 4] = 1.0, -frequency, frequency
    flow, bounces = expm(motion * TURN / frequency), np.diag([1.0, 1.0, -0.8, 1.0])

    def begun(unknowns):  # just after the impact
        x, v, w, phase = unknowns
        return np.array([0.0, x, v, w, math.cos(phase), math.sin(phase)])

    def left(unknowns):
        return bounces @ (flow @ begun(unknowns))[:4] - begun(unknowns)[:4]

    found, shifts = np.array(guess), 1e-6 * np.eye(4)
    for _ in range(30):
        slopes = np.stack([(left(found + shift) - left(found - shift)) / 2e-6 for shift in shifts], axis=1)
        found = found - np.linalg.solve(slopes, left(found))
    np.testing.assert_allclose(left(found), 0.0, atol=1e-12)
    before, after = (motion @ state for state in (flow @ begun(found), begun(found)))
    jump = np.outer(after[:4] - bounces @ before[:4], [1.0, 0.0, 0.0, 0.0]) / before[0]
    multipliers = np.linalg.eigvals((bounces + jump) @ flow[:4, :4])
    return np.abs(multipliers).max(), multipliers, found


def test_a_torus_of_two_bodies_with_impacts():
    """A Neimark–Sacker bifurcation, as G. W. Luo and J. H. Xie find some, J. Sound Vib. 253 (2002) 723, for others."""
    found = il.continue_orbits(pair, il.orbits(pair(2.4)), {"frequency": (2.3, 2.7)})
    (frequency,) = at(found, "frequency", "torus")
    time = found["event_time"].values[found["bifurcation"].values == "torus"][0, 0]
    orbit = il.orbits(pair(frequency - 0.01), il.AtContact("stop", "leaving")).isel(orbit=0)
    guess = [*(orbit[name].values[place] for name, place in (("displacement", 1), ("velocity", 0), ("velocity", 1)))]
    guess.append(frequency * time)
    expected = brentq(lambda value: largest_of_pair(value, guess)[0] - 1.0, 2.45, 2.55, xtol=1e-14)
    assert frequency == pytest.approx(expected, abs=1e-10)
    multipliers = largest_of_pair(expected, guess)[1]
    assert abs(multipliers[np.abs(multipliers).argmax()].imag) > 0.1


def test_a_branch_ends_where_there_is_no_network():
    """What was found is kept; the end says where and why, whatever error it was, on linear and smooth networks."""
    found = il.orbits(stop(2.0))

    def limited(frequency):
        if frequency > 2.5:
            raise il.InvalidInput("the motor turns at 2.5 rad/s at most")
        return stop(frequency)

    branch = il.continue_orbits(limited, found, {"frequency": (1.1, 3.0)})
    assert branch["frequency"].values[-1] == pytest.approx(2.5, abs=1e-9)
    assert at(branch, "frequency", "flip") == pytest.approx([1.2297353466], abs=5e-11)
    assert "the branch ends at frequency=2.5: There is no network at frequency=2.5: the motor" in branch.attrs["ends"]

    def broken(frequency):
        return stop(frequency, 0.0 * math.sqrt(2.5 - frequency))

    branch = il.continue_orbits(broken, found, {"frequency": (1.1, 3.0)})
    assert branch["frequency"].values[-1] == pytest.approx(2.5, abs=1e-9)
    assert "make fails at frequency=2.5: ValueError: math domain error" in branch.attrs["ends"]

    branch = il.continue_orbits(
        lambda frequency: stop(frequency, max(0.0, frequency - 2.4)), found, {"frequency": (1.1, 3.0)}
    )
    assert 2.38 < branch["frequency"].values[-1] < 2.4
    assert "no smooth functions of 'frequency'" in branch.attrs["ends"]


@pytest.mark.full
def test_smooth_branches_end_where_there_is_no_network():
    law = il.HertzContact(50.0)

    def limited(frequency):
        return stop(frequency + 0.0 * math.sqrt(2.52 - frequency), law=law)

    branch = il.continue_orbits(limited, il.orbits(stop(2.5, law=law)), {"frequency": (2.45, 2.6)}, points=2)
    assert branch["frequency"].values[[0, -1]] == pytest.approx([2.45, 2.52], abs=1e-4)
    assert branch["frequency"].values[-1] < 2.52
    assert "make fails at frequency=2.52: ValueError: math domain error" in branch.attrs["ends"]


def test_a_curve_ends_where_there_is_no_network():
    def make(frequency, gap):
        if gap > 0.2:
            raise il.InvalidInput("no room")
        return stop(frequency, gap)

    curve = il.continue_orbits(
        make, il.orbits(stop(2.0)), {"frequency": (1.5, 3.0)}, also={"gap": (-0.1, 0.3)}, bifurcation="flip"
    )
    assert curve["gap"].values.max() == pytest.approx(0.2, abs=1e-9)
    assert curve["gap"].values.min() == -0.1
    assert "the branch ends at gap=0.2: There is no network" in curve.attrs["ends"]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda frequency: 1 / 0, "make fails at frequency=.*: ZeroDivisionError: division by zero"),
        (lambda frequency: None, "make must return an il.Network, but at frequency=.* it returned None"),
        (lambda other: stop(other), "make fails at frequency=.*: TypeError"),
    ],
)
def test_functions_that_make_no_network(make, message):
    with pytest.raises(il.InvalidInput, match=message) as refused:
        il.continue_orbits(make, il.orbits(stop(2.0)), {"frequency": (0.5, 3.0)})
    assert refused.value.__cause__ is not None or "returned" in message


@pytest.mark.parametrize("law", [il.KelvinVoigtContact(stiffness=50.0, damping=3.0), il.RigidContact(restitution=0.6)])
def test_losses_are_the_work_of_the_force(law):
    """Over a period all that the force does is lost: its work by Simpson's rule along the path of the orbit."""
    found = il.orbits(stop(1.7, 0.2, law=law))
    time = found["phase"].values * found["period"].item()
    velocity = found["path_velocity"].values[0, :, 0]
    jumps = found["event_time"].values[0]
    network = stop(1.7, 0.2, law=law)
    start = {"displacement": {"a": found["displacement"].item()}, "velocity": {"a": found["velocity"].item()}}
    run = il.simulate(
        network, duration=found["period"].item(), initial=start, spin_up=0.0, record=[il.Trajectory(time[-1] / 65536)]
    )
    power = np.cos(1.7 * run["time"].values) * run["velocity"].values[0, :, 0]
    known = float(power[:-1].mean() * time[-1])
    assert found["energy_lost"].item() == pytest.approx(known, rel=1e-4)
    assert len(jumps)
    assert np.isfinite(velocity).all()


class VanDerPol(il.Oscillator):
    """An oscillator that sways by itself."""

    drive: float = il.parameter(units="kg s-1")

    @staticmethod
    def residual(displacement, velocity, drive):
        return drive * (displacement * displacement - 1.0) * velocity


def locked(amplitude):
    """The oscillator under a force that holds it at its frequency, if it is large enough."""
    return il.Network(oscillators={"a": VanDerPol(drive=0.3, stiffness=1.0)}, excitations={"a": cosine(amplitude, 1.1)})


def torus_by_variational_equations():
    """Start and amplitude of the orbit with the determinant 1 of its variational equations, by SciPy alone."""
    period = TURN / 1.1

    def rhs(time, state, amplitude):
        x, v = state[:2]
        jacobian = np.array([[0.0, 1.0], [-1.0 - 0.6 * x * v, 0.3 * (1.0 - x * x)]])
        rate = -x + 0.3 * (1.0 - x * x) * v + amplitude * math.cos(1.1 * time)
        return [v, rate, *(jacobian @ state[2:].reshape(2, 2)).ravel()]

    def equations(unknowns):
        start = [*unknowns[:2], 1.0, 0.0, 0.0, 1.0]
        end = solve_ivp(rhs, (0.0, period), start, "DOP853", args=(unknowns[2],), rtol=1e-12, atol=1e-13).y[:, -1]
        return [*(end[:2] - unknowns[:2]), np.linalg.det(end[2:].reshape(2, 2)) - 1.0]

    return fsolve(equations, [-1.14, -0.98, 0.4], xtol=1e-12)


@pytest.mark.full
def test_a_torus_of_a_forced_van_der_pol_oscillator():
    """Two complex multipliers leave the unit circle where the force no longer holds the oscillator."""
    found = il.continue_orbits(locked, il.orbits(locked(0.5)), {"amplitude": (0.35, 0.55)}, points=5)
    x, v, amplitude = torus_by_variational_equations()
    assert at(found, "amplitude", "torus") == pytest.approx([amplitude], abs=1e-7)
    place = int(np.argmax(found["bifurcation"].values == "torus"))
    assert found["displacement"].values[place, 0] == pytest.approx(x, abs=1e-6)
    assert found["velocity"].values[place, 0] == pytest.approx(v, abs=1e-6)
    stable, amplitudes = found["stable"].values.astype(bool), found["amplitude"].values
    assert stable[amplitudes > amplitude + 1e-6].all()
    assert not stable[amplitudes < amplitude - 1e-6].any()
    assert abs(found["multiplier_imag"].values[place]).min() > 0.1
