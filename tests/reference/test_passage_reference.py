"""First passages from the Fokker–Planck equation: exact laws, limits, themselves on finer meshes, and refusals."""

import math

import numpy as np
import pytest
import scipy.integrate
import scipy.special

import impactlab as il

NOISE = {"a": il.WhiteNoise(0.2 / math.pi)}
FREE = il.Network({"a": il.LinearOscillator(mass=1.0)}, {}, {"a": il.WhiteNoise(1.0 / math.pi)})


def body(damping=0.2, kind=il.LinearOscillator, contacts=None, **others):
    oscillator = kind(mass=1.0, damping=damping, stiffness=1.0, **others)
    return il.Network({"a": oscillator}, contacts or {}, {"a": il.WhiteNoise(damping / math.pi)})


@pytest.mark.parametrize(("start", "mean"), [(0.5, 1.155979149), (0.1, 0.909029221)])
def test_a_free_body_between_walls(start, mean):
    """Randomly accelerated motion from rest (J. Masoliver and J. M. Porrà, Phys. Rev. Lett. 75, 1995, 189)."""
    found = il.fokker_planck(FREE, absorb={"a": (0.0, 1.0)}, tolerance=1e-3).statistics(start)
    assert abs(found.mean_passage_time - mean) < found.mean_passage_time_error < 2e-3 * mean


@pytest.mark.full
def test_linear_body():
    two, three = (il.fokker_planck(body(), absorb={"a": level}).statistics() for level in (2.0, 3.0))
    assert two.mean_passage_time.item() == pytest.approx(42.0863, abs=1e-3)
    assert three.mean_passage_time.item() == pytest.approx(400.4399, abs=1e-2)
    assert two.mean_passage_time_error < 0.01
    assert three.mean_passage_time_error < 0.1


@pytest.mark.full
def test_strong_damping_is_an_ornstein_uhlenbeck_process():
    """Its mean time to leave ±2σ is 4.5016024 τ; a mass adds terms in powers of 1/c."""
    exact = (
        math.sqrt(math.pi / 2.0)
        * scipy.integrate.quad(lambda y: math.exp(0.5 * y * y) * scipy.special.erf(y / math.sqrt(2.0)), 0.0, 2.0)[0]
    )
    assert exact == pytest.approx(4.5016024, abs=1e-7)
    dampings = np.array([40.0, 80.0, 160.0])
    means = [il.fokker_planck(body(c), absorb={"a": 2.0}).mean_passage_time().item() / c for c in dampings]
    assert np.polynomial.Polynomial.fit(1.0 / dampings, means, 2)(0.0) == pytest.approx(exact, rel=3e-5)


@pytest.mark.full
def test_survival_ends_in_the_rate_of_decay_and_has_the_mean_as_its_area():
    reference = il.fokker_planck(body(), absorb={"a": (-1.5, 2.0)}, tolerance=1e-3)
    times = np.linspace(0.0, 600.0, 3001)
    survival = reference.survival(times, 0.5, -0.3)
    assert np.trapezoid(survival, times) == pytest.approx(reference.mean_passage_time(0.5, -0.3).item(), rel=2e-3)
    assert survival[1000] / survival[900] == pytest.approx(math.exp(-reference.decay_rate * 20.0), rel=1e-6)
    assert survival[0] == 1.0
    assert (np.diff(survival[100:]) <= 0.0).all()


@pytest.mark.full
def test_a_limit_on_one_side():
    """From far below, the mean time of a body without a limit there is that with a limit never reached."""
    one, both = (il.fokker_planck(body(), absorb={"a": pair}, tolerance=1e-3) for pair in ((None, 2.0), (-6.5, 2.0)))
    assert one.mean_passage_time().item() == pytest.approx(both.mean_passage_time().item(), rel=1e-3)
    mirrored = il.fokker_planck(body(), absorb={"a": (-2.0, None)}, tolerance=1e-3)
    assert mirrored.mean_passage_time(0.5).item() == pytest.approx(one.mean_passage_time(-0.5).item(), rel=1e-6)


@pytest.mark.full
def test_forces_act():
    """A spring that is a contact, a residual force or the body's own one is the same; so is its shift by a force."""
    stiff = {
        "up": il.Contact("a", il.WALL, il.LinearContact(1.0)),
        "down": il.Contact(il.WALL, "a", il.LinearContact(1.0)),
    }
    soft = il.LinearOscillator(mass=1.0, damping=0.2)
    by_contacts = il.Network({"a": soft}, stiff, NOISE)
    expected = il.fokker_planck(body(), absorb={"a": 2.0}, tolerance=1e-3).mean_passage_time().item()
    assert il.fokker_planck(by_contacts, absorb={"a": 2.0}, tolerance=1e-3).mean_passage_time().item() == pytest.approx(
        expected
    )
    pushed = {"a": NOISE["a"], "push": il.Source(il.ConstantForce(0.5), on={"a": 1.0})}
    shifted = il.Network({"a": body().oscillators["a"]}, {}, pushed)
    found = il.fokker_planck(shifted, absorb={"a": (-1.5, 2.5)}, tolerance=1e-3).mean_passage_time(0.5).item()
    assert found == pytest.approx(expected, rel=1e-6)


@pytest.mark.full
def test_errors_cover_finer_meshes():
    """The quoted error of each of these networks holds beside a solution of a smaller tolerance."""
    stop = {"stop": il.Contact("a", il.WALL, il.HertzContact(100.0), clearance=0.5)}
    networks = body(1.0), body(kind=il.DuffingOscillator, cubic=1.0), body(contacts=stop)
    for network in networks:
        rough = il.fokker_planck(network, absorb={"a": (-1.0, 0.8)}, tolerance=1e-2)
        fine = il.fokker_planck(network, absorb={"a": (-1.0, 0.8)}, tolerance=1e-4)
        for start in ((0.0, 0.0), (0.3, -0.5), (-0.7, 0.2)):
            found = rough.statistics(*start)
            off = abs(found.mean_passage_time - fine.mean_passage_time(*start))
            assert off <= found.mean_passage_time_error < 0.01 * found.mean_passage_time
        assert abs(rough.decay_rate - fine.decay_rate) <= rough.statistics().decay_rate_error


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda n: n.replace(excitations={"a": None}), "no white noise on 'a'"),
        (lambda n: n.replace(excitations={"a": il.Harmonic(1.0, frequency=1.0)}), "depends on time"),
        (lambda n: n.replace(oscillators=dict.fromkeys("bc", il.LinearOscillator(mass=1.0))), "3 oscillators"),
        (lambda n: n.replace(oscillators={"b": il.LinearOscillator(mass=1.0)}), "does not come to rest"),
        (lambda n: n.replace(oscillators={"b": il.DuffingOscillator(damping=0.1, cubic=1.0)}), "'b' is not linear"),
        (lambda n: n.replace(contacts={"c": il.Contact("a", il.WALL, il.RigidContact(0.5), clearance=1.0)}), "rigid"),
        (lambda n: n.replace(excitations={"a": il.OrnsteinUhlenbeckNoise(1.0, correlation_time=1.0)}), "not white"),
    ],
)  # fmt: skip
def test_other_networks_are_refused(change, message):
    with pytest.raises(il.NoExactReference, match=message):
        il.fokker_planck(change(body()), absorb={"a": 1.0})


@pytest.mark.parametrize("absorb", [{"b": 1.0}, {}, 1.0, {"a": 1.0, "b": 1.0}, {"a": -1.0}, {"a": (None, None)}])
def test_bad_limits(absorb):
    with pytest.raises(il.InvalidInput):
        il.fokker_planck(body(), absorb=absorb)


def test_bad_starts_and_options():
    reference = il.fokker_planck(body(), absorb={"a": 1.0}, tolerance=1e-2)
    for start in ((1.5, 0.0), (0.0, 1e3), (math.nan, 0.0)):
        with pytest.raises(il.InvalidInput):
            reference.mean_passage_time(*start)
    with pytest.raises(il.InvalidInput, match="0 s or later"):
        reference.survival([-1.0])
    with pytest.raises(il.InvalidInput, match="basis"):
        il.fokker_planck(body(), absorb={"a": 1.0}, basis={"gap": 15})
    with pytest.raises(il.InvalidInput, match="both limits"):
        il.fokker_planck(FREE, absorb={"a": (None, 1.0)})


@pytest.mark.full
def test_the_reference_as_a_dataset(tmp_path):
    reference = il.fokker_planck(body(), absorb={"a": (-1.0, 2.0)}, tolerance=1e-2)
    data = reference.statistics(times=[0.0, 10.0])
    assert data.survival.dims == ("survival_time",)
    assert data.mean_passage_time.units == "s"
    il.save(data, tmp_path / "reference.nc")
    assert il.network_of(tmp_path / "reference.nc") == body()
    assert "from -1 to 2 m" in repr(reference)


def pair(spring, damper=0.0, **second):
    """A body with limits coupled to a second one under noise of the same temperature."""
    other = il.LinearOscillator(**{"mass": 1.0, "damping": 0.2, "stiffness": 1.0} | second)
    return il.Network(
        {"a": il.LinearOscillator(mass=1.0, damping=0.2, stiffness=1.0), "b": other},
        couplings={"spring": il.Coupling("a", "b", il.LinearCoupling(spring, damping=damper))} if spring else {},
        excitations={"a": il.WhiteNoise(0.2 / math.pi), "b": il.WhiteNoise(other.damping / math.pi)},
    )


@pytest.mark.full
def test_a_second_body_without_a_coupling_changes_nothing():
    both = il.fokker_planck(pair(0.0), absorb={"a": 1.5}, tolerance=1e-2)
    alone = il.fokker_planck(body(), absorb={"a": 1.5}, tolerance=1e-4)
    found = both.statistics()
    assert abs(found.mean_passage_time - alone.mean_passage_time()) <= found.mean_passage_time_error
    assert abs(found.decay_rate - alone.decay_rate) <= found.decay_rate_error
    x, v = np.array([0.5, -1.0]), np.array([0.3, 0.8])
    expected = alone.mean_passage_time(x, v)
    started = both.mean_passage_time({"a": x, "b": 2.0}, {"a": v, "b": [0.0, -1.0]})
    np.testing.assert_allclose(started, expected, rtol=1e-2)


@pytest.mark.full
def test_a_heavy_second_body_is_a_wall():
    """It hardly moves, so that the coupling is a spring of the body itself."""
    heavy = il.fokker_planck(pair(0.3, mass=1e6, stiffness=1e6, damping=1e3), absorb={"a": 1.5}, tolerance=1e-2)
    body_alone = il.LinearOscillator(mass=1.0, damping=0.2, stiffness=1.3)
    alone = il.fokker_planck(il.Network({"a": body_alone}, {}, NOISE), absorb={"a": 1.5}, tolerance=1e-4)
    found = heavy.statistics()
    assert found.mean_passage_time.item() == pytest.approx(alone.mean_passage_time().item(), rel=3e-3)


@pytest.mark.full
@pytest.mark.parametrize("spring", [0.2, 0.5])
def test_two_bodies_as_simulated(spring):
    """From rest, and from a start of both."""
    network = pair(spring, 0.05, stiffness=1.5)
    reference = il.fokker_planck(network, absorb={"a": 1.6}, tolerance=1e-2)
    start = {"displacement": {"b": -1.0}, "velocity": {"a": 0.5, "b": 1.0}}
    for initial, found in (("rest", reference.statistics()), (start, reference.statistics(*start.values()))):
        record = il.FirstPassage({"a": 1.6})
        ds = il.simulate(network, 600.0, realizations=20_000, initial=initial, record=record, rng=1)
        error = math.hypot(found.mean_passage_time_error, ds.mean_passage_time_standard_error)
        assert abs(found.mean_passage_time - ds.mean_passage_time) < 4.0 * error
        assert found.mean_passage_time_error < 0.01 * found.mean_passage_time
