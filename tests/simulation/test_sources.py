"""One noise, sum of cosines or given force on several bodies, and several of them on one."""

import numpy as np
import pytest
from impactlab_numerics.laws.excitations import PulsatingNoise
from scipy.integrate import solve_ivp
from scipy.linalg import solve_continuous_lyapunov

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.simulation.idle_bodies import split

A = il.LinearOscillator(mass=1.0, damping=0.4, stiffness=9.0)
B = il.LinearOscillator(mass=2.0, damping=1.2, stiffness=20.0)
GROUND = il.Source(il.WhiteNoise(1.0), on={"a": 1.0, "b": 2.0})
FAR = il.Contact("a", "b", il.HertzContact(1e3), clearance=50.0)
SPRING = il.Coupling("a", "b", il.LinearCoupling(400.0))
few = pytest.mark.filterwarnings("ignore:Too few independent samples")


def pair(contacts=None, excitations=None, couplings=None):
    return il.Network({"a": A, "b": B}, contacts, excitations or {"ground": GROUND}, couplings)


def law(between=0.0, own=(0.0, 0.0)):
    """Covariance of (x_a, x_b, v_a, v_b) by the Lyapunov equation, without anything of impactlab."""
    mass, damping, stiffness = np.array([1.0, 2.0]), np.diag([0.4, 1.2]), np.diag([9.0, 20.0])
    stiffness = stiffness + between * np.array([[1.0, -1.0], [-1.0, 1.0]])
    drift = np.block([[np.zeros((2, 2)), np.eye(2)], [-stiffness / mass[:, None], -damping / mass[:, None]]])
    growth = np.zeros((4, 4))
    growth[2:, 2:] = 2.0 * np.pi * (np.outer([1.0, 2.0], [1.0, 2.0]) + np.diag(own)) / np.outer(mass, mass)
    return solve_continuous_lyapunov(drift, -growth)


def products(data):
    """Means over time of products of (x_a, x_b, v_a, v_b), (4, 4), and their standard errors over realizations."""
    z = np.concatenate([data.displacement.values, data.velocity.values], axis=2)
    each = np.einsum("rti,rtj->rij", z, z) / z.shape[1]
    return each.mean(axis=0), each.std(axis=0, ddof=1) / np.sqrt(len(each))


def run(network, duration=40.0, realizations=256, **options):
    return il.simulate(
        network, duration=duration, realizations=realizations, rng=1, record=il.Trajectory(2.0), **options
    )


@pytest.mark.parametrize(
    ("network", "expected", "options"),
    [
        (pair(), law(), {}),
        (pair(excitations={"a": il.WhiteNoise(0.5), "ground": GROUND}), law(own=(0.5, 0.0)), {}),
        (pair(couplings={"s": SPRING}), law(between=400.0), {"step": 0.01}),
        (pair({"far": FAR}), law(), {"step": 0.04}),
        (pair({"far": FAR}), law(), {"step": 0.01, "integrator": il.RungeKutta4()}),
    ],
    ids=["linear", "own noise, too", "coupled", "contact far away", "Runge-Kutta"],
)
def test_covariances_of_two_bodies_under_one_noise(network, expected, options):
    found, error = products(run(network, **options))
    assert np.abs((found - expected) / error).max() < 3.5  # of ten numbers
    assert abs(expected[0, 1]) > 5.0 * error[0, 1]


def test_the_start_is_drawn_from_the_joint_law():
    network = pair({"far": FAR})
    data = il.simulate(network, duration=0.02, spin_up=0.0, realizations=4000, rng=3, record=il.Trajectory(0.01))
    z = np.concatenate([data.displacement.values[:, 0], data.velocity.values[:, 0]], axis=1)
    error = np.sqrt((np.outer(np.diag(law()), np.diag(law())) + law() ** 2) / len(z))
    assert np.abs((z.T @ z / len(z) - law()) / error).max() < 3.5


def leapfrog(weights, clearance, stiffness, step, steps, realizations, seed):
    """Two bodies under one noise, with a linear stop between them: moments and the share of time in contact."""
    generator = np.random.default_rng(seed)
    mass, damping, own, weight = (np.array(item)[:, None] for item in ([1, 2.0], [0.4, 1.2], [9, 20.0], weights))
    x, v = np.zeros((2, 2, realizations))
    sums, closed = np.zeros((4, 4, realizations)), np.zeros(realizations)
    decay = np.exp(-damping / mass * step)
    for index in range(2 * steps):
        for half in range(2):
            push = stiffness * np.maximum(x[0] - x[1] - clearance, 0.0)
            v += 0.5 * step / mass * (-own * x + np.array([-push, push]))
            if half == 0:
                x += 0.5 * step * v
                shared = generator.standard_normal(realizations)
                v = decay * v + weight / mass * np.sqrt(2.0 * np.pi * step) * np.sqrt(decay) * shared
                x += 0.5 * step * v
        if index >= steps:
            z = np.concatenate([x, v])
            sums += z[:, None] * z
            closed += x[0] - x[1] > clearance
    return sums / steps, closed / steps


@pytest.mark.full
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_bodies_that_collide_under_one_noise(sign):
    """Against a simulation by another method, without anything of impactlab."""
    stop = il.Contact("a", "b", il.LinearContact(200.0), clearance=0.3)
    data = run(pair({"stop": stop}, {"ground": il.Source(il.WhiteNoise(1.0), on={"a": 1.0, "b": 2.0 * sign})}))
    found, error = products(data)
    moments, closed = leapfrog([1.0, 2.0 * sign], 0.3, 200.0, 0.01, 4000, 400, seed=5)
    both = np.sqrt(error**2 + moments.var(axis=2, ddof=1) / moments.shape[2])
    assert np.abs((found - moments.mean(axis=2)) / both)[[0, 0, 1, 2, 2, 3], [0, 1, 1, 2, 3, 3]].max() < 3.5
    ratio, scatter = data.contact_ratio.values[0], data.contact_ratio_standard_error.values[0]
    assert abs(ratio - closed.mean()) < 3.0 * np.hypot(scatter, closed.std() / np.sqrt(len(closed)))
    assert ratio > 20.0 * scatter


@pytest.mark.full
def test_a_heavy_base_and_the_motion_of_the_ground():
    """Bodies of 1 kg on a base of 10⁶ kg feel its acceleration, which is nearly white."""
    law, gap, base = il.HertzContact(1e5), 0.03, 1e6
    heavy = il.Network(
        {
            "base": il.LinearOscillator(mass=base, damping=0.5 * base, stiffness=0.25 * base),
            "a": il.LinearOscillator(),
            "b": il.LinearOscillator(),
        },
        {"gap": il.Contact("a", "b", law, clearance=gap)},
        {"base": il.WhiteNoise(base**2)},
        {
            "of a": il.Coupling("base", "a", il.LinearCoupling(400.0, damping=2.0)),
            "of b": il.Coupling("base", "b", il.LinearCoupling(676.0, damping=2.0)),
        },
    )
    ideal = il.Network(
        {
            "a": il.LinearOscillator(damping=2.0, stiffness=400.0),
            "b": il.LinearOscillator(damping=2.0, stiffness=676.0),
        },
        {"gap": il.Contact("a", "b", law, clearance=gap)},
        {"ground": il.Source(il.WhiteNoise(1.0), on={"a": -1.0, "b": -1.0})},
    )
    both = [il.simulate(network, duration=60.0, realizations=64, rng=1) for network in (heavy, ideal)]
    for name in ("contact_rate", "contact_ratio", "mean_contact_force"):
        values, errors = ([data[item].item() for data in both] for item in (name, f"{name}_standard_error"))
        assert abs(values[0] - values[1]) < 3.0 * np.hypot(*errors), name
        assert np.hypot(*errors) < 0.02 * values[0]


@few
@pytest.mark.parametrize(
    ("method", "step"), [(il.ExactFlow(), 0.005), (il.RungeKutta4(), 0.005), (il.EulerMaruyama(), 1e-4)]
)
@pytest.mark.parametrize("contact", [None, FAR])
@pytest.mark.parametrize(
    "excitation",
    [
        il.WhiteNoise(1.0),
        pytest.param(PulsatingNoise(1.0, frequency=1.0), marks=pytest.mark.campaign),
        pytest.param(il.ShinozukaNoise(1.0, band=(0.0, 2.0), components=40), marks=pytest.mark.campaign),
        pytest.param(il.Harmonic(2.0, frequency=2.0), marks=pytest.mark.campaign),
    ],
    ids=lambda item: type(item).__name__,
)
def test_equal_bodies_move_in_proportion_to_their_weights(method, step, contact, excitation):
    network = il.Network(
        {"b": A, "a": A}, contact and {"far": contact}, {"ground": il.Source(excitation, on={"a": 1.0, "b": -2.0})}
    )
    data = il.simulate(
        network, duration=2.0, step=step, spin_up=0.0, initial="rest", realizations=2, rng=2,
        integrator=method, record=il.Trajectory(0.5),
    )  # fmt: skip
    path = data.displacement
    assert np.abs(path).max() > 0.1
    np.testing.assert_allclose(path.sel(oscillator="b"), -2.0 * path.sel(oscillator="a"), rtol=1e-9, atol=1e-12)


@pytest.mark.campaign
@few
def test_motions_under_several_excitations_add_up():
    """Noise of its own, a common noise, common cosines and a common force: each as if it were alone."""
    parts = {
        "a": il.WhiteNoise(0.5),
        "ground": GROUND,
        "sea": il.Source(il.ShinozukaNoise(1.0, band=(0.0, 2.0), components=40), on={"a": 1.0, "b": 0.5}),
        "motor": il.Source(il.Harmonic(2.0, frequency=2.0), on={"b": -1.0, "a": 3.0}),
        "push": il.Source(il.Harmonic(1.0, frequency=1.0), on="b"),
    }
    for contacts in (None, {"far": FAR}):
        for couplings in (None, {"s": SPRING}):

            def path(excitations, contacts=contacts, couplings=couplings):
                return il.simulate(
                    pair(contacts, excitations, couplings), duration=8.0, step=0.01, spin_up=0.0, initial="rest",
                    realizations=2, rng=2, record=il.Trajectory(0.5),
                ).displacement.values  # fmt: skip

            alone = [path({name: item}) for name, item in parts.items()]
            assert min(np.abs(item).max() for item in alone) > 0.02
            # friction of a body with contacts acts at one moment of a step where white noise does, else all the time
            np.testing.assert_allclose(path(parts), sum(alone), rtol=0.0, atol=3e-4 if contacts else 1e-9)


@few
def test_a_source_changes_no_numbers_of_others():
    bodies = {"a": A, "b": B, "c": A, "d": B}
    contacts = {"gap": il.Contact("c", "d", il.HertzContact(1e3), clearance=0.1)}
    own = {"a": il.WhiteNoise(1.0), "c": il.WhiteNoise(1.0)}
    options = {"duration": 20.0, "step": 0.01, "realizations": 3, "rng": 4, "record": il.Trajectory(0.5)}
    without = il.simulate(il.Network(bodies, contacts, own), **options, integrator=il.ExactFlow(jumps=False))
    more = {"ground": GROUND, "wind": il.Source(il.WhiteNoise(0.3), on={"b": 1.0, "a": 2.0})}
    with_sources = il.simulate(il.Network(bodies, contacts, own | more), **options)
    for name in ("c", "d"):
        for quantity in ("displacement", "velocity"):
            np.testing.assert_array_equal(
                with_sources[quantity].sel(oscillator=name), without[quantity].sel(oscillator=name)
            )
    assert (with_sources.displacement.sel(oscillator="a") != without.displacement.sel(oscillator="a")).any()


@pytest.mark.full
def test_a_given_force_on_two_bodies_that_collide():
    stop = {"stop": il.Contact("a", "b", il.LinearContact(200.0), clearance=0.1)}
    network = pair(stop, {"motor": il.Source(il.Harmonic(3.0, frequency=2.0), on={"a": 1.0, "b": -2.0})})
    data = il.simulate(network, duration=10.0, step=1e-3, spin_up=0.0, initial="rest", record=il.Trajectory(1.0))

    def slope(t, y):
        push = 200.0 * max(y[0] - y[1] - 0.1, 0.0)
        force = 3.0 * np.sin(2.0 * t)
        return [
            y[2],
            y[3],
            force - push - 0.4 * y[2] - 9.0 * y[0],
            (push - 2.0 * force - 1.2 * y[3] - 20.0 * y[1]) / 2.0,
        ]

    expected = solve_ivp(slope, (0.0, 10.0), np.zeros(4), t_eval=data.time.values, rtol=1e-9, atol=1e-11).y
    np.testing.assert_allclose(data.displacement.values[0].T, expected[:2], atol=2e-5)
    compiled = network.compile()
    state = np.array([0.4, -0.1, 0.3, 0.2])
    np.testing.assert_allclose(compiled.rhs(0.7, state), slope(0.7, state), rtol=1e-12)
    assert data.contact_rate.item() > 0.0


def test_parts_that_a_source_connects_run_together():
    bodies = {"a": A, "b": B, "c": A}
    gap = {"gap": il.Contact("b", "c", il.HertzContact(1e3), clearance=0.1)}
    noise = {name: il.WhiteNoise(1.0) for name in bodies}
    apart = Model.of(il.Network(bodies, gap, noise)), Model.of(il.Network(bodies, gap, noise | {"ground": GROUND}))
    found = [split(model, il.ExactFlow(), None, []) for model in apart]
    assert found[0] is not None
    assert [list(part.oscillators) for part in found[0]] == [["b", "c"], ["a"]]
    assert found[1] is None
    left = il.Network(
        bodies | {"d": A}, gap, noise | {"ground": il.Source(il.WhiteNoise(1.0), on={"a": 1.0, "d": 1.0})}
    )
    busy, idle = split(Model.of(left), il.ExactFlow(), None, [])
    assert (list(busy.excitations), list(idle.excitations)) == (["b", "c"], ["a", "ground"])


@pytest.mark.full
def test_a_source_that_drives_bodies_apart_keeps_statistics_right():
    """Steps, rates and balances of a network in which nothing but a source connects the bodies of two contacts."""
    walls = {
        "at a": il.Contact("a", il.WALL, il.LinearContact(200.0), clearance=0.3),
        "at b": il.Contact("b", il.WALL, il.LinearContact(200.0), clearance=0.3),
    }
    together = il.simulate(pair(walls), duration=100.0, realizations=64, rng=1)
    apart = pair(walls, {"a": il.WhiteNoise(1.0), "b": il.WhiteNoise(4.0)})
    statistics = il.compare(together, il.exact(apart)).to_dataframe()  # of each body alone, as if it were
    assert statistics.z.abs().max() < 4.0


@pytest.mark.full
def test_a_harmonic_force_and_noise_on_a_body_that_collides():
    """Rates and means over whole periods at the step that is chosen, and at a sixth of it under other noise."""
    period = 2.0 * np.pi / 5.0
    network = il.Network(
        {"a": il.LinearOscillator.from_frequency(2.0 * np.pi, 0.05)},
        {"stop": il.Contact("a", il.WALL, il.HertzContact(1e5), clearance=0.1)},
        {"a": il.WhiteNoise(0.02), "motor": il.Source(il.Harmonic(1.5, frequency=5.0), on="a")},
    )
    chosen = il.simulate(network, 40.0 * period, realizations=128, rng=1)
    fine = il.simulate(network, 40.0 * period, realizations=128, step=period / 2000.0, rng=2)
    assert chosen.step > 6.0 * fine.step
    for name in ("contact_rate", "contact_ratio", "mean_contact_force", "mean_square_displacement"):
        values, errors = ([data[item].item() for data in (chosen, fine)] for item in (name, f"{name}_standard_error"))
        assert abs(values[0] - values[1]) < 3.0 * np.hypot(*errors), name
        assert np.hypot(*errors) < 0.03 * values[0]
