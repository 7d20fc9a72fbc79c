"""Simulations against exact laws, closed forms and brute force."""

import math

import numpy as np
import pytest
from impactlab_numerics.laws.oscillators import QuinticOscillator
from scenes import base, deviations, linear
from scipy.integrate import solve_ivp

import impactlab as il

NAMES = [
    "mean_displacement", "mean_square_displacement", "variance_displacement", "mean_velocity", "mean_square_velocity",
    "contact_ratio", "contact_rate", "mean_contact_force",
]  # fmt: skip
BALANCES = ["mean_displacement", "mean_square_displacement", "mean_square_velocity"]


class CubicContact(il.ContactLaw):
    """A user's own law: force κ δ³."""

    stiffness: float = il.parameter(units="N m-3", minimum=0.0)

    @staticmethod
    def force(indentation, stiffness):
        return stiffness * indentation * indentation * indentation

    @staticmethod
    def potential(indentation, stiffness):
        return 0.25 * stiffness * indentation**4


class Swelling(il.Excitation):
    """White noise that swells."""

    density: float = il.parameter(units="N2 s rad-1", minimum=0.0)
    rate: float = il.parameter(units="s-1")

    @staticmethod
    def intensity(time, density, rate):
        return density * (1.0 + math.sin(rate * time)) ** 2


def assert_agrees(ds, exact, names=NAMES, sigmas=3.0, relative=1e-3):
    names = [name for name in names if name in ds]
    found = deviations(ds, exact, names, relative)
    assert max(found.values()) < sigmas, found


def assert_balanced(ds, sigmas=3.5):
    for name in BALANCES:
        if f"balance_{name}" in ds:
            scores = ds[f"balance_{name}"] / ds[f"balance_{name}_standard_error"]
            assert float(abs(scores).max()) < sigmas, name


def exact_of(network):
    return il.exact(network).statistics()


# the paper's pair


@pytest.fixture(scope="module", params=[0.01, 0.05, 0.1])
def paper_pair(request):
    network = base(16.0, request.param)
    return il.simulate(network, 400.0, realizations=512, rng=1), exact_of(network)


def test_all_statistics_of_the_pair_are_exact(paper_pair):
    ds, exact = paper_pair
    assert_agrees(ds, exact)
    relative = {name: np.abs(ds[f"{name}_standard_error"] / ds[name]).values for name in NAMES}
    assert relative["mean_square_displacement"][0] < 1e-3
    assert relative["mean_square_displacement"][1] < 4e-3
    assert relative["contact_ratio"][0] < 4e-3
    assert relative["mean_contact_force"][0] < 4e-3


def test_balances_of_the_pair_close(paper_pair):
    assert_balanced(paper_pair[0])


def test_peak_is_between_the_forces_that_are_sure_and_that_are_impossible(paper_pair):
    """It is the mean of the largest of many collisions: above three mean forces, below an energy of 30 T."""
    ds, _ = paper_pair
    temperature = np.pi / (0.4 * np.pi)
    largest = 1e4 * (2.5 * 30.0 * temperature / 1e4) ** 0.6
    assert 3.0 * float(ds.mean_contact_force[0] / ds.contact_ratio[0]) < float(ds.peak_contact_force[0]) < largest


@pytest.mark.parametrize("ratio", [1.0, 4.0, 64.0])
def test_balances_close_where_no_exact_law_is_known(ratio):
    with pytest.raises(il.NoExactReference):
        il.exact(base(ratio))
    ds = il.simulate(base(ratio), 100.0 if ratio < 64.0 else 30.0, realizations=512, rng=1)
    assert_balanced(ds)


@pytest.mark.full
@pytest.mark.parametrize("ratio", [4.0, 64.0])
def test_half_the_step_gives_the_same(ratio):
    options = {"realizations": 512, "rng": 1}
    coarse = il.simulate(base(ratio), 60.0, **options)
    fine = il.simulate(base(ratio), 60.0, step=0.5 * coarse.step, **options)
    for name in NAMES:
        error = np.hypot(coarse[f"{name}_standard_error"], fine[f"{name}_standard_error"])
        beyond = np.abs(coarse[name] - fine[name]) - 1e-3 * np.abs(fine[name])
        assert float((beyond / error).max()) < 3.5, name


def test_equipartition():
    """Bodies of different mass at one temperature have one mean kinetic energy."""
    bodies = {
        "light": il.LinearOscillator(mass=0.1, damping=0.05, stiffness=20.0),
        "heavy": il.LinearOscillator(mass=5.0, damping=2.0, stiffness=100.0),
    }
    noises = {name: il.WhiteNoise(0.4 * body.damping / np.pi) for name, body in bodies.items()}
    gap = il.Contact("light", "heavy", il.HertzContact(1e3), clearance=0.02)
    ds = il.simulate(il.Network(bodies, {"gap": gap}, noises), 300.0, realizations=256, rng=1)
    mass = np.array([0.1, 5.0])
    error = mass * ds.mean_square_velocity_standard_error
    assert (abs(mass * ds.mean_square_velocity - 0.4) < 3.0 * error + 4e-4).all()


# other networks with an exact law


def wall(law, clearance, second=True):
    contacts = {"right": il.Contact("a", il.WALL, law, clearance=clearance)}
    if second:
        contacts["left"] = il.Contact(il.WALL, "a", law, clearance=0.5 * clearance)
    return linear().replace(contacts=contacts)


def duffing(cubic, stiffness=20.0):
    body = il.DuffingOscillator(cubic=cubic, stiffness=stiffness, damping=1.0)
    return il.Network({"a": body}, excitations={"a": il.WhiteNoise(1.0)})


def pair_with(law, clearance):
    return base().replace(contacts={"gap": il.Contact("one", "two", law, clearance=clearance)})


SCENES = {
    "one wall, linear": wall(il.LinearContact(500.0), 0.1, second=False),
    "two walls, Hertz": wall(il.HertzContact(1e4), 0.1),
    "Duffing": duffing(30.0),
    "strong Duffing without a linear spring": duffing(100.0, stiffness=0.0),
    "linear contact of a pair": pair_with(il.LinearContact(1e3), 0.05),
    "a user's law": pair_with(CubicContact(2e5), 0.02),
    "a user's oscillator": il.Network(
        {"a": QuinticOscillator(200.0, stiffness=5.0, damping=0.5)}, excitations={"a": il.WhiteNoise(0.3)}
    ),
    "negative clearance": pair_with(il.HertzContact(1e4), -0.02),
}


@pytest.mark.parametrize("network", SCENES.values(), ids=SCENES)
def test_statistics_are_exact(network):
    ds = il.simulate(network, 100.0, realizations=512, rng=2)
    assert_agrees(ds, exact_of(network), sigmas=3.5, relative=1.5e-3)
    assert_balanced(ds)


def test_an_unforced_undamped_body_takes_the_temperature_of_its_neighbour():
    network = base().replace(oscillators={"one": il.LinearOscillator(stiffness=300.0)}, excitations={"one": None})
    ds = il.simulate(network, 400.0, realizations=512, rng=1, spin_up=200.0)
    assert_agrees(ds, exact_of(network), sigmas=3.5, relative=2e-3)


def chain_of_three():
    """Three bodies of one temperature, T = 0.5, that can touch in a row."""
    bodies = [
        il.LinearOscillator(mass=0.5, damping=0.4, stiffness=30.0),
        il.LinearOscillator(mass=2.0, damping=1.0, stiffness=15.0),
        il.LinearOscillator(mass=1.0, damping=0.7, stiffness=50.0),
    ]
    noises = [il.WhiteNoise(0.5 * body.damping / np.pi) for body in bodies]
    laws = [il.HertzContact(800.0), il.LinearContact(300.0)]
    return il.chain(3, bodies, laws, clearance=[0.05, 0.1], excitation=noises)


@pytest.mark.full
def test_a_chain_of_three_against_brute_force():
    network = chain_of_three()
    k = [body.stiffness for body in network.oscillators.values()]
    grids = [np.linspace(-6.0, 6.0, 241) * np.sqrt(0.5 / value) for value in k]
    a, b, c = np.meshgrid(*grids, indexing="ij", sparse=True)
    laws = [contact.law for contact in network.contacts.values()]
    gaps = [np.maximum(a - b - 0.05, 0.0), np.maximum(b - c - 0.1, 0.0)]
    potential = 0.5 * (k[0] * a**2 + k[1] * b**2 + k[2] * c**2)
    potential = potential + 0.4 * laws[0].stiffness * gaps[0] ** 2.5 + 0.5 * laws[1].stiffness * gaps[1] ** 2
    weight = np.exp(-potential / 0.5)
    weight /= weight.sum()
    forces = [laws[0].stiffness * gaps[0] ** 1.5, laws[1].stiffness * gaps[1]]
    exact = {
        "mean_displacement": [(weight * x).sum() for x in (a, b, c)],
        "mean_square_displacement": [(weight * x**2).sum() for x in (a, b, c)],
        "mean_square_velocity": [0.5 / body.mass for body in network.oscillators.values()],
        "mean_contact_force": [(weight * force).sum() for force in forces],
    }
    ds = il.simulate(network, 200.0, realizations=512, rng=1)
    assert_agrees(ds, exact, list(exact), sigmas=3.5, relative=1.5e-3)
    assert_balanced(ds)


# without noise


def test_a_bounce_has_its_closed_form():
    """A free body meets a linear spring: half a period of √(κ/m) later it flies back as fast as it came."""
    body = il.LinearOscillator(mass=2.0)
    network = il.Network({"a": body}, {"w": il.Contact("a", il.WALL, il.LinearContact(800.0), clearance=1.0)})
    speed, omega = 3.0, math.sqrt(800.0 / 2.0)
    meets, leaves = 1.0 / speed, 1.0 / speed + np.pi / omega
    ds = il.simulate(network, 1.0, step=2.5e-4, initial={"velocity": {"a": speed}}, record=il.Trajectory(0.01))
    time = ds.time.values
    expected = np.where(time < meets, speed * time, 1.0 + speed / omega * np.sin(omega * (time - meets)))
    expected = np.where(time > leaves, 1.0 - speed * (time - leaves), expected)
    np.testing.assert_allclose(ds.displacement[0, :, 0], expected, atol=2e-5)
    assert float(ds.velocity[0, -1, 0]) == pytest.approx(-speed, rel=1e-5)
    assert float(ds.peak_contact_force[0]) == pytest.approx(800.0 * speed / omega, rel=1e-4)
    assert float(ds.contact_ratio[0]) == pytest.approx(np.pi / omega, abs=1e-3)


def test_a_collision_of_two_free_bodies_conserves_momentum_and_energy():
    bodies = {"a": il.LinearOscillator(mass=1.0), "b": il.LinearOscillator(mass=3.0)}
    network = il.Network(bodies, {"gap": il.Contact("a", "b", il.HertzContact(1e4), clearance=0.1)})
    ds = il.simulate(network, 1.0, step=1e-4, initial={"velocity": {"a": 2.0, "b": -1.0}}, record=il.Trajectory(0.01))
    v = ds.velocity[0].values
    np.testing.assert_allclose(v @ [1.0, 3.0], -1.0, atol=1e-12)  # at every time
    centre = -1.0 / 4.0
    np.testing.assert_allclose(v[-1], 2.0 * centre - np.array([2.0, -1.0]), rtol=1e-6)
    depth = (1.25 * 0.75 * 9.0 / 1e4) ** 0.4  # μ v²/2 = (2/5) η δ^(5/2)
    assert float(ds.peak_contact_force[0]) == pytest.approx(1e4 * depth**1.5, rel=1e-4)


@pytest.mark.parametrize("second", ["a wall", "a body"])
def test_one_contact_pushes_both_ways(second):
    """At rest under a preload: the static solution of the springs in series."""
    other = il.WALL if second == "a wall" else "b"
    bodies = {name: il.LinearOscillator(stiffness=100.0, damping=20.0) for name in "ab"}
    network = il.Network(bodies, {"gap": il.Contact("a", other, il.LinearContact(300.0), clearance=-0.3)})
    ds = il.simulate(network, 10.0, step=1e-3, initial="rest", spin_up=20.0, record=il.Trajectory(1.0))
    compliance = 1.0 / 300.0 + 0.01 * (1 if second == "a wall" else 2)
    force = 0.3 / compliance
    np.testing.assert_allclose(ds.contact_force[0, :, 0], force, rtol=1e-6)
    expected = [-force / 100.0, 0.0 if second == "a wall" else force / 100.0]
    np.testing.assert_allclose(ds.displacement[0, -1], expected, rtol=1e-6)


# noise that varies in time


@pytest.mark.full
def test_a_varying_intensity_gives_the_moments_of_the_linear_equation():
    """Mean squares over the realizations at each time, against the equation of the moments."""
    noise = Swelling(1.0, rate=3.0)
    network = linear().replace(excitations={"a": noise})
    body = network.oscillators["a"]
    ds = il.simulate(
        network, 4.0, realizations=20_000, step=0.01, initial="rest", spin_up=0.0, rng=1, record=il.Trajectory(0.25)
    )

    def rhs(t, y):
        xx, xv, vv = y
        density = float(noise.call("intensity", t))
        k, c = body.stiffness, body.damping
        return [2.0 * xv, vv - k * xx - c * xv, -2.0 * k * xv - 2.0 * c * vv + 2.0 * np.pi * density]

    times = ds.time.values
    expected = solve_ivp(rhs, (0.0, 4.0), [0.0, 0.0, 0.0], t_eval=times, rtol=1e-9, atol=1e-12, max_step=0.05).y
    for values, moment in ((ds.displacement**2, expected[0]), (ds.velocity**2, expected[2])):
        measured = values.mean("realization").values[1:, 0]
        error = values.std("realization").values[1:, 0] / math.sqrt(20_000)
        assert (np.abs(measured - moment[1:]) < 4.0 * error + 5e-4 * moment[1:]).all()


@pytest.mark.full
def test_a_negative_intensity_is_refused():
    network = linear().replace(excitations={"a": Falling(1.0)})
    with pytest.raises(il.Diverged, match=r"negative or NaN near t = 5\.0\d* s"):
        il.simulate(network, 10.0, realizations=64, rng=1, initial="rest", spin_up=0.0, step=0.01)


class Falling(il.Excitation):
    density: float = il.parameter(units="N2 s rad-1")

    @staticmethod
    def intensity(time, density):
        return density * (5.0 - time)


# beyond exact laws


@pytest.mark.full
def test_the_peak_at_the_automatic_step_is_within_three_per_cent():
    options = {"realizations": 512, "rng": 1}
    coarse = il.simulate(base(), 50.0, **options)
    fine = il.simulate(base(), 50.0, step=0.125 * coarse.step, **options)
    name = "peak_contact_force"
    error = math.hypot(coarse[f"{name}_standard_error"][0], fine[f"{name}_standard_error"][0])
    assert abs(float(coarse[name][0] - fine[name][0])) < 0.03 * float(fine[name][0])
    assert error < 0.01 * float(fine[name][0])


@pytest.mark.full
def test_the_peak_grows_with_the_time_of_observation():
    """By about the same for every factor in time: the logarithm, not a limit."""
    runs = [il.simulate(base(), time, realizations=256, rng=1) for time in (10.0, 100.0, 1000.0)]
    steps = np.diff([float(ds.peak_contact_force[0]) for ds in runs])
    assert (steps > 10.0 * max(float(ds.peak_contact_force_standard_error[0]) for ds in runs)).all()
    assert 0.5 < steps[1] / steps[0] < 1.2


@pytest.mark.full
def test_a_long_chain_between_walls_has_equal_energies():
    """Sixty bodies of three kinds at one temperature; mean forces agree with the springs."""
    kinds = [il.LinearOscillator(mass=m, damping=0.5 * m, stiffness=20.0) for m in (0.5, 1.0, 3.0)]
    bodies = [kinds[k % 3] for k in range(60)]
    noises = [il.WhiteNoise(0.5 * body.mass / np.pi) for body in bodies]
    network = il.chain(60, bodies, il.HertzContact(1e3), clearance=0.1, excitation=noises, walls=True)
    ds = il.simulate(network, 60.0, realizations=128, rng=1)
    mass = np.array([body.mass for body in bodies])
    error = mass * ds.mean_square_velocity_standard_error
    assert float(((abs(mass * ds.mean_square_velocity - 1.0) - 1e-3) / error).max()) < 4.0
    scores = ds.balance_mean_displacement / ds.balance_mean_displacement_standard_error
    assert float(abs(scores).max()) < 4.0


@pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")
def test_a_single_realization_of_many_bodies_is_one_of_the_ensemble():
    """One lane, where loops run over bodies, and many lanes give the same paths."""
    body = il.LinearOscillator(damping=0.5, stiffness=20.0)
    network = il.chain(50, body, il.HertzContact(1e3), clearance=0.1, excitation=il.WhiteNoise(1.0))
    options = {"rng": 1, "spin_up": 0.0, "record": [il.Trajectory(0.1), il.PerRealization()]}
    alone = il.simulate(network, 2.0, **options)
    many = il.simulate(network, 2.0, realizations=64, **options)
    np.testing.assert_array_equal(alone.displacement[0], many.displacement[0])
