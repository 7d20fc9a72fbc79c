"""Branches of orbits and curves of their events, against closed forms and given constants."""

import math
import re

import numpy as np
import pytest
import xarray as xr
from scipy.integrate import solve_ivp

import impactlab as il
from impactlab.analysis.made_networks import MadeNetworks, made_again

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
    assert np.nanmax(branch["closure"].values) < 1e-6
    assert branch.attrs["ends"] == "the end of the range is reached at 0.9; the end of the range is reached at 3"
    assert branch["frequency"].values[[0, -1]].tolist() == [0.9, 3.0]
    assert len(branch["frequency"]) > 1000


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
    assert len(frequency) >= 200
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
    assert level["amplitude"].values.min() == 0.5
    assert level["amplitude"].values.max() == 2.0
    curve = il.continue_orbits(
        lambda frequency, gap: stop(frequency, gap), found, {"frequency": (1.5, 3.0)}, also={"gap": (-0.1, 0.3)},
    )  # fmt: skip
    np.testing.assert_allclose(np.abs(curve["multiplier_real"].values + 1.0).min(axis=1), 0.0, atol=1e-8)
    assert np.ptp(curve["gap"].values) > 0.39


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
    with pytest.raises(il.InvalidInput, match="begins with an orbit"):
        il.continue_orbits(make, "orbit", {"frequency": (0.5, 3.0)})
    with pytest.raises(il.InvalidInput, match="There are 2 orbits"):
        il.continue_orbits(make, found.isel(orbit=[0, 0]), {"frequency": (0.5, 3.0)})


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
    found = il.continue_orbits(make, start, {"frequency": (2.45, end)}, **options)
    il.save(found, tmp_path / "branch.nc")
    again = il.rerun(tmp_path / "branch.nc")
    assert again.drop_attrs().identical(found.drop_attrs())
    assert again.attrs["ends"] == found.attrs["ends"]
    assert il.network_of(again) == make(2.5)


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
        ({"frequency": 2.0}, {}, "has a range"),
        ({}, {}, "one parameter"),
        ({"frequency": (0.5, 3.0)}, {"points": 1}, "points is"),
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
