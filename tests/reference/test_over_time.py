"""The covariance over time of linear networks, under noises with and without envelopes."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import solve_continuous_lyapunov

import impactlab as il

MASS, STIFFNESS = np.array([1.0, 2.0]), np.array([[33.0, -20.0], [-20.0, 38.0]])
DAMPING = np.array([[0.7, -0.3], [-0.3, 0.9]])
BODIES = {
    "a": il.LinearOscillator(mass=1.0, damping=0.4, stiffness=13.0),
    "b": il.LinearOscillator(mass=2.0, damping=0.6, stiffness=18.0),
}
SPRING = {"s": il.Coupling("a", "b", il.LinearCoupling(20.0, damping=0.3))}
SOIL = il.CloughPenzien(1.0, 15.0, 0.6, 1.5, 0.6)
GROWS = [-0.7, 0.4, 1.5, 4.0], [0.2, 1.0, -0.5, 0.8]  # ends with a jump
FADES = [0.3, 1.1, 3.3], [0.9, 0.2, 0.0]
TIMES = np.array([0.0, 0.05, 0.4, 1.0, 2.5, 4.0, 6.0])


def factor(envelope):
    return lambda t: np.interp(t, *envelope, left=0.0, right=0.0)


def of_bodies(*noises, **more):
    return il.Network(BODIES, None, dict(noises), SPRING, **more)


def by_quadrature(noises, filters, begin, times):
    """Covariance of (x, v) by a Runge–Kutta method for Lyapunov's equation in time.

    White noises are (forces, density, factor) and filtered ones (forces, A, b, c, start, factor).
    """
    count = sum(len(item[2]) for item in filters)
    size = count + 4
    drift, start, white = np.zeros((3, size, size))
    drift[count : count + 2, count + 2 :] = np.eye(2)
    drift[count + 2 :, count : count + 2] = -STIFFNESS / MASS[:, None]
    drift[count + 2 :, count + 2 :] = -DAMPING / MASS[:, None]
    place, pushes = 0, []
    for forces, a, b, c, own, envelope in filters:
        here = slice(place, place + len(b))
        drift[here, here], start[here, here], white[here, here] = a, own, 2.0 * np.pi * np.outer(b, b)
        push = np.zeros((size, size))
        push[count + 2 :, here] = np.outer(forces / MASS, c)
        pushes.append((push, envelope))
        place += len(b)
    grown = []
    for forces, density, envelope in noises:
        growth = np.zeros((size, size))
        growth[count + 2 :, count + 2 :] = 2.0 * np.pi * density * np.outer(forces / MASS, forces / MASS)
        grown.append((growth, envelope))

    def slope(t, p):
        p = p.reshape(size, size)
        moved = (drift + sum((f(t) * push for push, f in pushes), np.zeros(1))) @ p
        return (moved + moved.T + white + sum((f(t) ** 2 * growth for growth, f in grown), np.zeros(1))).ravel()

    # the method never steps over a kink or a jump of an envelope
    knots = sorted({begin, *times, *(t for t in (*GROWS[0], *FADES[0]) if begin < t < times[-1])})
    result, state = {begin: start}, start.ravel()
    for first, last in pairwise(knots):
        inside = np.nextafter(first, last), np.nextafter(last, first)
        state = solve_ivp(slope, inside, state, method="DOP853", rtol=1e-12, atol=1e-15).y[:, -1]
        result[last] = state.reshape(size, size)
    return np.array([result[t][count:, count:] for t in times])


def matrix_of(data):
    x, v, both = (data[f"covariance_{name}"].values for name in ("displacement", "velocity", "displacement_velocity"))
    return np.concatenate(
        [np.concatenate([x, both], axis=2), np.concatenate([both.transpose(0, 2, 1), v], axis=2)], axis=1
    )


def assert_close(found, expected):
    """To 10⁻⁸ of the standard deviations of both quantities."""
    deviations = np.sqrt(np.diagonal(expected, axis1=1, axis2=2))
    sizes = deviations[:, :, None] * deviations[:, None, :]
    np.testing.assert_array_less(np.abs(found - expected), 1e-8 * sizes + 1e-15)


@pytest.mark.parametrize("spin_up", [0.0, 0.5])
def test_white_noises_with_and_without_envelopes(spin_up):
    network = of_bodies(
        ("a", il.WhiteNoise(0.02)),
        ("b", il.ModulatedNoise(0.3, *GROWS)),
        ("both", il.Source(il.ModulatedNoise(0.5, *FADES), on={"a": 1.0, "b": -0.6})),
    )
    noises = [
        (np.array([1.0, 0.0]), 0.02, lambda t: 1.0),
        (np.array([0.0, 1.0]), 0.3, factor(GROWS)),
        (np.array([1.0, -0.6]), 0.5, factor(FADES)),
    ]
    found = matrix_of(il.exact_covariance(network, TIMES, spin_up=spin_up))
    assert_close(found, by_quadrature(noises, [], -spin_up, TIMES))


@pytest.mark.parametrize("at_rest", [False, True])
def test_coloured_noises_with_and_without_envelopes(at_rest):
    soil, wind = SOIL.replace(at_rest=at_rest), il.OrnsteinUhlenbeckNoise(0.4, correlation_time=0.3)
    network = of_bodies(("ground", il.BaseMotion(il.Modulated(soil, *GROWS))), ("a", wind), ("b", il.WhiteNoise(0.02)))
    a, b, c = map(np.array, SOIL.filter())
    start = np.zeros((4, 4)) if at_rest else solve_continuous_lyapunov(a, -2.0 * np.pi * np.outer(b, b))
    d, e, f = map(np.array, wind.filter())
    filters = [
        (-MASS, a, b, c, start, factor(GROWS)),
        (np.array([1.0, 0.0]), d, e, f, np.array([[np.pi * 0.4 / 0.3]]), lambda t: 1.0),
    ]
    noises = [(np.array([0.0, 1.0]), 0.02, lambda t: 1.0)]
    found = matrix_of(il.exact_covariance(network, TIMES, spin_up=0.5))
    assert_close(found, by_quadrature(noises, filters, -0.5, TIMES))


def test_a_free_body_and_an_undamped_one_from_rest():
    """``E[v²] = 2πSt/m²`` and ``E[x²] = 2πS t³/3m²``; ``E[x²] = πS (t − sin(2ωt)/2ω)/(mω)²`` on a spring."""
    free = il.Network(
        {"free": il.LinearOscillator(mass=2.0), "spring": il.LinearOscillator(mass=2.0, stiffness=18.0)},
        excitations=dict.fromkeys(["free", "spring"], il.WhiteNoise(0.3)),
    )
    t = np.array([0.3, 1.0, 700.0])
    law = il.exact_covariance(free, t)
    np.testing.assert_allclose(law.variance_velocity.sel(oscillator="free"), 0.15 * np.pi * t, rtol=1e-12)
    np.testing.assert_allclose(law.variance_displacement.sel(oscillator="free"), 0.05 * np.pi * t**3, rtol=1e-12)
    expected = 0.3 * np.pi * (t - np.sin(6.0 * t) / 6.0) / 36.0
    np.testing.assert_allclose(law.variance_displacement.sel(oscillator="spring"), expected, rtol=1e-10)
    assert not law.covariance_displacement.sel(oscillator="free", other_oscillator="spring").any()


def test_after_a_long_time_it_is_the_stationary_covariance():
    """Also of impulses with a mean, about it."""
    network = of_bodies(
        ("ground", il.BaseMotion(SOIL)), ("a", il.PoissonImpulses(3.0, mean=0.2)), ("b", il.WhiteNoise(0.02))
    )
    law, stationary = il.exact_covariance(network, [1000.0]).isel(time=0), il.exact(network)
    for quantity in ("displacement", "velocity"):
        expected = [[stationary.covariance(p, q, quantity) for q in "ab"] for p in "ab"]
        np.testing.assert_allclose(law[f"covariance_{quantity}"], expected, rtol=1e-9)


def test_points_of_structures():
    tower = il.ModalStructure([3.0, 8.0], 0.05, points={"top": [1.0, -0.7]}, participation=(1.0, 0.4))
    quake = il.BaseMotion(il.ModulatedNoise(0.1, *FADES))
    law = il.exact_covariance(il.Network({"tower": tower}, excitations={"ground": quake}), TIMES)
    for quantity in ("displacement", "velocity"):
        expected = np.einsum("i,tij,j->t", [1.0, -0.7], law[f"covariance_{quantity}"], [1.0, -0.7])
        np.testing.assert_allclose(law[f"point_variance_{quantity}"].sel(point="tower.top"), expected, rtol=1e-12)
    assert law.variance_velocity.attrs["units"] == "m2 s-2"


class Wave(il.Excitation):
    @staticmethod
    def intensity(time):
        return 1.0 + 0.5 * np.sin(time)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"contacts": {"stop": il.Contact("a", il.WALL, il.HertzContact(1e4))}}, "contact 'stop' is not linear"),
        ({"couplings": {"s": il.Coupling("a", "b", il.CubicCoupling(1.0))}}, "coupling 's' is not linear"),
        ({"oscillators": {"a": il.DuffingOscillator(stiffness=1.0, cubic=1.0)}}, "'a' has a residual force"),
        ({"oscillators": {"a": il.PrescribedMotion(il.Harmonic(0.1, frequency=3.0))}}, "'a' moves as it is given"),
        ({"excitations": {"b": il.ShinozukaNoise(1.0)}}, "'b' is a sum of cosines"),
        ({"excitations": {"b": Wave()}}, "'b' is Wave, a formula of time"),
    ],
)
def test_what_is_not_known_says_why(change, reason):
    with pytest.raises(il.NoExactReference, match=reason):
        il.exact_covariance(of_bodies(("b", il.WhiteNoise(0.1))).replace(**change), [0.0, 1.0])


@pytest.mark.parametrize("times", [[], [1.0, 1.0], [-1.0, 0.0], [0.0, np.nan], [[0.0, 1.0]], "soon"])
def test_times_increase_from_0_on(times):
    with pytest.raises(il.InvalidInput, match="times"):
        il.exact_covariance(of_bodies(("b", il.WhiteNoise(0.1))), times)


def test_other_arguments_are_checked():
    network = of_bodies(("b", il.WhiteNoise(0.1)))
    with pytest.raises(il.InvalidInput, match="spin_up must be at least 0 s, not -1"):
        il.exact_covariance(network, [0.0], spin_up=-1.0)
    with pytest.raises(il.InvalidInput, match=r"must be an il\.Network, not 3"):
        il.exact_covariance(3, [0.0])
    with pytest.raises(il.NoExactReference, match=r"il\.exact_covariance knows the covariance over time"):
        il.exact(network.replace(excitations={"b": il.ModulatedNoise(1.0, *FADES)}))
