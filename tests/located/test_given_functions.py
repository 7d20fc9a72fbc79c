"""Given functions of time in networks that are linear between events: paths against independent solutions."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from test_certificate import Drawn
from test_motion import course_of

import impactlab as il

EXACT = il.EventLocated()


class Sine(il.Excitation):
    """A force of one's own, of which nobody knows that it is harmonic."""

    amplitude: float = il.parameter(units="N")
    rate: float = il.parameter(units="rad s-1")

    @staticmethod
    def force(time, amplitude, rate):
        return amplitude * math.sin(rate * time)


class Switched(il.Excitation):
    """A force that jumps at a time which it does not tell."""

    at: float = il.parameter(units="s")

    @staticmethod
    def force(time, at):
        return 0.4 if time > at else -0.2


class Root(il.Excitation):
    @staticmethod
    def force(time):
        return math.sqrt(3.0 - time) if time < 3.0 else math.nan


BODY = {"a": il.LinearOscillator(mass=1.0, damping=0.1, stiffness=1.0)}


def stop(force, law=None, **options):
    """Return a body that is driven against a stop."""
    contact = il.Contact("a", il.WALL, law or il.LinearContact(60.0), clearance=0.2)
    return il.Network(BODY, {"stop": contact}, {"a": force}, **options)


def run(network, duration, interval=0.5, **options):
    """Simulate from rest, with a trajectory."""
    record = il.Trajectory(interval)
    return il.simulate(network, duration, initial="rest", record=record, integrator=EXACT, **options)


def pair(force):
    """Two bodies whose damping couples their modes, with a dashpot between them and a rigid stop on which one rests."""
    bodies = {"a": il.LinearOscillator(mass=1.0, damping=0.3, stiffness=4.0), "b": il.LinearOscillator(mass=0.5)}
    contacts = {
        "gap": il.Contact("a", "b", il.KelvinVoigtContact(80.0, damping=1.5), clearance=0.1),
        "floor": il.Contact("b", il.WALL, il.RigidContact(0.6), clearance=0.3),
    }
    couplings = {"c": il.Coupling("a", "b", il.LinearCoupling(1.0, damping=0.2))}
    load = il.Source(il.ConstantForce(0.2), on={"b": 1.0})
    return il.Network(bodies, contacts, {"f": il.Source(force, on={"a": 1.0, "b": -0.3}), "g": load}, couplings)


@pytest.mark.parametrize("make", [stop, lambda force: stop(force, il.RigidContact(0.7)), pair])
@pytest.mark.parametrize("spin_up", [0.0, 300.0])
def test_a_force_of_ones_own_has_the_path_of_the_same_harmonic_force(make, spin_up):
    """Contacts, dashpots, impacts and rests included, as sums, samples, and the list of impacts."""
    own, known = (
        il.simulate(
            make(force), 100.0, spin_up=spin_up, initial="rest", integrator=EXACT,
            record=[il.Trajectory(1.0), il.Impacts()],
        )
        for force in (Sine(0.9, rate=1.3), il.Harmonic(0.9, frequency=1.3))
    )  # fmt: skip
    assert known.sizes["impact"] > 5
    for name in ("displacement", "velocity", "impact_time", "impact_impulse", "impact_closing_velocity"):
        np.testing.assert_allclose(own[name], known[name], rtol=0.0, atol=1e-10 * float(np.abs(known[name]).max()))
    for name in ("mean_square_velocity", "contact_ratio", "mean_contact_force"):
        np.testing.assert_allclose(own[name], known[name], rtol=1e-10)
    assert own.path_error < 1e-9


def rubbed(force):
    """Two bodies, one on a belt that moves, with a stop; frictions that stick and slip."""
    bodies = {"a": il.LinearOscillator(mass=1.0, damping=0.05, stiffness=2.0), "b": il.LinearOscillator(mass=0.5)}
    belt = il.PrescribedMotion(il.Harmonic(0.2, frequency=0.7))
    couplings = {
        "rub": il.Coupling("a", "belt", il.CoulombFrictionCoupling(0.3, static_ratio=1.3)),
        "between": il.Coupling("a", "b", il.CoulombFrictionCoupling(0.15)),
        "spring": il.Coupling("a", "b", il.LinearCoupling(3.0)),
    }
    stops = {"stop": il.Contact("b", il.WALL, il.RigidContact(0.6), clearance=0.3)}
    return il.Network({**bodies, "belt": belt}, stops, {"f": il.Source(force, on={"a": 1.0, "b": -0.3})}, couplings)


def sliding(force):
    """A spring in series with dry friction beside a soft stop."""
    return stop(force, couplings={"slider": il.Coupling("a", il.WALL, il.JenkinsCoupling(5.0, slip_force=0.4))})


BLAST = np.array([0.0, 10.0, 10.01, 10.02, 30.0]), np.array([0.0, 0.0, 90.0, 0.0, 0.0])


@pytest.mark.full
@pytest.mark.parametrize("law", [il.LinearContact(60.0), il.HertzContact(60.0)])
def test_short_blasts_are_met_wherever_their_samples_are(law):
    """Those of a force, of a force with an envelope, and of the envelope."""
    long = np.array([0.0, 30.0]), np.ones(2)
    forces = (
        il.SampledForce(*BLAST),
        il.ModulatedForce(il.SampledForce(*BLAST), *long),
        il.ModulatedForce(il.ConstantForce(1.0), *BLAST),
    )
    paths = [run(stop(force, law), 20.0).displacement for force in forces]
    assert float(paths[0].max()) > 0.2
    for path in paths[1:]:
        np.testing.assert_allclose(path, paths[0], rtol=0.0, atol=1e-10)


class Bump(il.Excitation):
    """A smooth push, of which nobody knows when it is."""

    at: float = il.parameter(units="s")

    @staticmethod
    def force(time, at):
        part = abs(time - at) / 0.4
        return math.exp(-1.0 / (1.0 - part * part)) if part < 1.0 else 0.0


def test_a_push_that_lasts_a_third_of_a_radian_is_seen_wherever_it_is():
    body = {"a": il.LinearOscillator(mass=1.0, damping=0.01, stiffness=1.0)}
    for at in np.linspace(900.0, 903.0, 40):
        network = il.Network(body, excitations={"a": Bump(at)})
        assert il.simulate(network, 1000.0, initial="rest", integrator=EXACT).mean_square_velocity.item() > 1e-6


def test_functions_of_many_panels_are_refused_before_they_fill_the_memory():
    force = il.Chirp(1.0, start_frequency=0.0, end_frequency=1e9, duration=100.0)
    with pytest.raises(il.InvalidInput, match=r"needs over 1e\+09 bytes for the given forces from 0 to 100 s"):
        run(stop(force), 100.0)


@pytest.mark.parametrize("make", [rubbed, sliding])
def test_frictions_slip_and_stick_under_a_force_of_ones_own_as_under_the_same_harmonic_force(make):
    paths = [run(make(force), 60.0) for force in (Sine(1.2, rate=1.3), il.Harmonic(1.2, frequency=1.3))]
    assert float(paths[1].contact_rate.max()) > 0.05
    np.testing.assert_allclose(paths[0].displacement, paths[1].displacement, rtol=0.0, atol=1e-10)


def test_rests_on_a_rigid_contact_end_where_a_force_of_ones_own_lifts():
    """A body that is pressed against a rigid wall, at the time at which the force changes its sign."""
    result = il.simulate(
        il.Network({"a": il.LinearOscillator(mass=2.0)}, {"w": il.Contact("a", il.WALL, il.RigidContact(0.0))},
                   {"a": Sine(1.0, rate=0.5)}),
        8.0, initial="rest", integrator=EXACT, record=il.Trajectory(0.5),
    )  # fmt: skip
    time = result.time.values
    lifted = np.maximum(time - 2.0 * math.pi, 0.0)  # x'' = sin(t/2)/2, which is negative from 2π to 4π
    np.testing.assert_allclose(result.displacement.values.ravel(), 2.0 * np.sin(0.5 * lifted) - lifted, atol=1e-11)


SAMPLES = np.array([0.0, 0.7, 1.1, 2.0, 3.1, 4.0, 5.2, 6.0]), np.array([0.0, 0.9, -0.4, 1.0, 0.8, -0.7, 0.3, 0.0])


@pytest.mark.parametrize(
    "force",
    [
        il.SampledForce(*SAMPLES, after="zero"),
        il.SampledForce(*SAMPLES, interpolation="previous", after="zero"),
        il.Pulse(2.0, duration=0.9, start=1.3, shape="half-sine"),
        il.Pulse(80.0, duration=0.01, start=1.3, shape="rectangle"),
        il.Chirp(1.0, start_frequency=0.3, end_frequency=2.0, duration=6.0),
        Switched(math.e),
    ],
    ids=["samples", "steps of samples", "half-sine", "short rectangle", "chirp", "unknown jump"],
)
def test_paths_under_given_functions_are_those_of_a_solver_with_events(force):
    result = run(stop(force), 8.0)
    ends = [*SAMPLES[0], 1.3, 1.31, 2.2, math.e, *np.arange(0.0, 8.5, 0.5)]
    times, now, y = np.unique(ends), 0.0, np.zeros(2)
    found = {0.0: 0.0}

    def gap(t, y):
        return y[0] - 0.2

    gap.terminal = True
    closed = False
    for end in times[1:]:
        middle = 1e-12 * (end - now)  # functions of pieces, not of their ends
        while now < end:
            stiffness, low, high = 60.0 if closed else 0.0, now + middle, end - middle
            gap.direction = -1.0 if closed else 1.0

            def rates(t, y, k=stiffness, low=low, high=high):
                given = float(force.call("force", min(max(t, low), high)))
                return [y[1], given - 0.1 * y[1] - y[0] - k * (y[0] - 0.2)]

            piece = solve_ivp(rates, (now, end), y, method="DOP853", rtol=1e-12, atol=1e-15, events=gap)
            now, y = piece.t[-1], piece.y[:, -1]
            if len(piece.t_events[0]):
                closed = not closed
        found[end] = y[0]
    wanted = [found[time] for time in result.time.values]
    assert float(result.contact_rate.values.item()) > 0.0
    np.testing.assert_allclose(result.displacement.values.ravel(), wanted, rtol=0.0, atol=2e-11)


@pytest.mark.parametrize("law", [il.RigidContact(0.65), il.KelvinVoigtContact(90.0, damping=1.0)])
def test_buildings_that_pound_in_an_earthquake(law):
    """Samples of an acceleration move both, with the path of the same forces by samples, and no sample is made up."""
    times = np.arange(0.0, 12.0, 0.05)
    record = np.random.default_rng(3).standard_normal(times.size)
    bodies = {"l": il.LinearOscillator.from_frequency(1.0, 0.05), "r": il.LinearOscillator.from_frequency(2.0, 0.05)}
    gap = {"gap": il.Contact("l", "r", law, clearance=0.02)}
    shaken = il.Network(bodies, gap, {"quake": il.BaseMotion(il.SampledForce(times, record))})
    pushed = il.Network(bodies, gap, {name: il.SampledForce(times, -record) for name in bodies})
    paths = [run(network, 11.5) for network in (shaken, pushed)]
    assert paths[0].contact_rate.item() > 0.3
    np.testing.assert_allclose(paths[0].displacement, paths[1].displacement, rtol=0.0, atol=1e-12)
    with pytest.raises(il.InvalidInput, match=r"The samples of 'quake' end at 11\.95 s, 0\.05 s before"):
        run(shaken, 12.0)


def test_given_motions_of_ones_own_are_refused_beside_rigid_contacts():
    network = stop(il.ConstantForce(1.0), il.RigidContact(0.5))
    bodies = {**BODY, "table": il.PrescribedMotion(Sine(0.1, rate=2.0))}
    moved = network.replace(oscillators=bodies, contacts={"hits": il.Contact("a", "table", il.RigidContact(0.5))})
    with pytest.raises(il.InvalidInput, match="EventLocated knows no "):
        run(moved, 1.0)


def test_points_of_a_sweep_have_the_bits_of_single_runs():
    """They run in one call, and each has its own function."""
    options = {"duration": 20.0, "initial": "rest", "integrator": EXACT, "record": il.Trajectory(1.0)}

    def make(rate):
        return stop(Sine(0.8, rate=rate))

    swept = il.sweep(make, {"rate": [0.5, 3.0]}, **options)
    for rate in (0.5, 3.0):
        alone = il.simulate(make(rate), **options)
        np.testing.assert_array_equal(swept.displacement.sel(rate=rate), alone.displacement)


@pytest.mark.parametrize("seeds", [range(12), pytest.param(range(12, 300), marks=pytest.mark.full)], ids=["12", "288"])
def test_bounds_of_given_functions_miss_no_event(seeds):
    """Random networks have the events of the same harmonic force, whose bounds are exact."""
    found = 0
    for drawn in map(Drawn, seeds):
        forces = None, Sine(1.0, rate=drawn.frequency)
        known, own = (course_of(drawn.network(force), 10.0, drawn.x, drawn.v) for force in forces)
        if known.grazed.any():
            continue  # rounding decides
        events, others = known.events_of(0)[:60], own.events_of(0)[:60]
        np.testing.assert_array_equal(others[:, 1], events[:, 1])
        np.testing.assert_allclose(others[:, 0], events[:, 0], rtol=0.0, atol=1e-7)
        found += len(events)
    assert found > 5 * len(seeds)


def test_realizations_of_one_network_share_their_functions(monkeypatch):
    """A thousand starts evaluate a function as often as one does."""
    asked = []
    call = Sine.call
    monkeypatch.setattr(Sine, "call", lambda self, name, *at: asked.append(np.size(at[0])) or call(self, name, *at))
    starts = np.linspace(-0.5, 0.15, 1000)
    network = stop(Sine(0.8, rate=0.8))
    options = {"integrator": EXACT, "spin_up": 0.0, "record": il.FinalState()}
    alone = il.simulate(network, 20.0, initial={"displacement": {"a": starts[7]}}, **options)
    once = sum(asked)
    asked.clear()
    many = il.simulate(network, 20.0, realizations=1000, initial={"displacement": {"a": starts}}, **options)
    assert sum(asked) == once
    assert many.final_displacement.values.ravel()[7] == alone.final_displacement.values.item()


def test_a_function_that_is_not_finite_is_refused():
    with pytest.raises(il.InvalidInput, match=r"The force of Root\(\) is nan at 3\.\d* s"):
        run(stop(Root()), 8.0)
