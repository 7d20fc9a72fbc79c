"""Largest values of linear forms in windows: of the paths, of a Brownian particle, refusals."""

import warnings

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline
from scipy.linalg import eigh_tridiagonal

import impactlab as il

pytestmark = pytest.mark.full

DRIFT = {"upper": 1.0, "lower": -1.0}


def towers(law=None):
    """Two bodies that touch, under noise."""
    bodies = {
        "upper": il.LinearOscillator.from_frequency(6.0, 0.05),
        "lower": il.LinearOscillator.from_frequency(9.0, 0.05),
    }
    gap = il.Contact("upper", "lower", law or il.HertzContact(1e4), clearance=0.05)
    return il.Network(bodies, {"gap": gap}, {"upper": il.WhiteNoise(1.0), "lower": il.WhiteNoise(0.5)})


def drift_of(ds):
    """Displacement and velocity of the upper body beside the lower one."""
    return [
        ds[name].sel(oscillator="upper") - ds[name].sel(oscillator="lower") for name in ("displacement", "velocity")
    ]


def largest(times, values, slopes, window):
    """Largest and least values of Hermite's cubic in windows."""
    path = CubicHermiteSpline(times, values, slopes)
    at = np.sort(np.concatenate([times, path.derivative().roots(extrapolate=False)]))
    found = [path(at[(at >= begin) & (at <= begin + window)]) for begin in np.arange(0.0, times[-1] - 1e-9, window)]
    return [item.max() for item in found], [item.min() for item in found]


@pytest.mark.filterwarnings("ignore:Too few independent samples")
def test_extremes_are_those_of_the_paths():
    """Of windows in steps, from displacements and velocities at all of them; forces between steps by parabolas."""
    step, window = 0.005, 2.0
    of = {"drift": DRIFT, "force": "gap", "pull": {"gap": -1.0}}
    record = [il.Extremes(of, windows=(4.0, window)), il.Trajectory(step)]
    ds = il.simulate(towers(), 8.0, realizations=5, step=step, record=record, rng=1)
    x, v = drift_of(ds)
    for row in range(5):
        most, least = largest(ds.time.values, x.values[row], v.values[row], window)
        np.testing.assert_allclose(ds.window_maximum[row, :, 0], most, rtol=1e-12)
        np.testing.assert_allclose(ds.window_minimum[row, :, 0], least, rtol=1e-12)
    force = ds.contact_force.values[:, 1:, 0].reshape(5, 4, -1)
    top = ds.window_maximum.sel(extreme_form="force").values
    assert ((top >= force.max(axis=2)) & (top <= 1.05 * force.max(axis=2))).all()
    np.testing.assert_array_equal(ds.window_minimum.sel(extreme_form="pull"), -top)
    assert (ds.window_minimum.sel(extreme_form="force") == 0.0).all()
    of_four = ds.window_maximum.values.reshape(5, 2, 2, 3).max(axis=2)
    mean = ds.extreme_mean.sel(extreme_kind="maximum", extreme_window=4.0)
    np.testing.assert_allclose(mean, of_four.mean(axis=(0, 1)), rtol=1e-12)
    whole = np.maximum(ds.window_maximum, -ds.window_minimum).mean(("realization", "extreme_block"))
    np.testing.assert_allclose(ds.extreme_mean.sel(extreme_kind="magnitude", extreme_window=2.0), whole, rtol=1e-12)


def test_a_free_vibration_reaches_its_amplitude():
    """A sine of amplitude 0.1 at the automatic step, where the largest value at steps is up to 0.8 % less."""
    network = il.Network({"a": il.LinearOscillator(stiffness=1.0)})
    start = {"displacement": {"a": 0.06}, "velocity": {"a": 0.08}}
    of = {"a": "a", "twice": {"a": 2.0}, "speed": ("velocity", "a")}
    ds = il.simulate(network, 20.0, initial=start, record=il.Extremes(of, windows=(10.0,)))
    expected = [0.1, 0.2, 0.1]
    np.testing.assert_allclose(ds.window_maximum[0, 0], expected, rtol=2e-5)
    np.testing.assert_allclose(ds.window_minimum[0, 1], np.negative(expected), rtol=2e-5)
    with pytest.raises(il.InvalidInput, match="EventLocated keeps no Extremes"):
        il.simulate(network, 20.0, initial=start, integrator=il.EventLocated(), record=il.Extremes(windows=(10.0,)))


def test_rigid_stops_bound_displacements():
    """A body bounces between a wall and its spring: it comes as far as the wall, within what a step hides."""
    network = il.Network(
        {"a": il.LinearOscillator(stiffness=1.0)},
        {"stop": il.Contact("a", il.WALL, il.RigidContact(1.0), clearance=0.02)},
    )
    start = {"displacement": {"a": -0.1}}
    record = il.Extremes("a", windows=(10.0,))
    ds = il.simulate(network, 10.0, initial=start, integrator=il.ExactFlow(), step=0.05, record=record)
    assert float(ds.window_maximum[0, 0, 0]) == pytest.approx(0.02, abs=2e-4)
    assert float(ds.window_minimum[0, 0, 0]) == pytest.approx(-0.1, rel=1e-5)


def below(level, time, cells=1500):
    """Probability that a stationary Ornstein-Uhlenbeck process of unit rate and variance stays below a level."""
    width = (level + 6.0) / cells
    at = -6.0 + width * (np.arange(cells) + 0.5)
    weight, edge = np.exp(-0.5 * at**2), np.exp(-0.5 * (at + 0.5 * width) ** 2)
    lost = np.append(edge[:-1], 2.0 * edge[-1]) + np.append(0.0, edge[:-1])  # half a cell to the level
    values, vectors = eigh_tridiagonal(
        -lost / (weight * width**2), edge[:-1] / np.sqrt(weight[1:] * weight[:-1]) / width**2, select="v",
        select_range=(-60.0 / time, 1.0),
    )  # fmt: skip
    share = np.sqrt(weight) @ vectors
    return float((share**2 * np.exp(values * time)).sum() * width / np.sqrt(2.0 * np.pi))


@pytest.fixture(scope="module")
def particle():
    """Velocities of a free body with friction, in windows of ten relaxation times."""
    network = il.Network({"a": il.LinearOscillator(damping=1.0)}, excitations={"a": il.WhiteNoise(1.0 / np.pi)})
    record = il.Extremes(("velocity", "a"), windows=(10.0, 40.0), return_times=(10.0, 100.0, 1000.0, 1e6))
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "The two halves of the run differ")  # the body goes away
        return il.simulate(network, 400.0, realizations=128, record=record, rng=1)


def test_extremes_of_a_rough_velocity(particle):
    """White noise makes it a Brownian path between steps; its levels are those of the exact law."""
    levels = particle.extreme_return_level.sel(extreme_kind="maximum", extreme_form="velocity of a")
    errors = particle.extreme_return_level_standard_error.sel(extreme_kind="maximum", extreme_form="velocity of a")
    for window in (10.0, 40.0):
        for time in (10.0, 100.0, 1000.0)[int(window == 40.0) :]:
            level, error = (
                float(item.sel(extreme_window=window, extreme_return_time=time)) for item in (levels, errors)
            )
            slope = (below(level + 0.05, window) - below(level - 0.05, window)) / 0.1
            off = (below(level, window) - np.exp(-window / time)) / slope
            assert abs(off) < 3.0 * error + 0.005, (window, time)
            assert error < 0.08
    assert np.isnan(levels.sel(extreme_return_time=1e6)).all()


def test_errors_of_means(particle):
    """The minimum is as far on the other side; means of windows are those of the exact law."""
    grid = np.linspace(0.0, 6.0, 61)
    for window in (10.0, 40.0):
        mean = 6.0 - np.trapezoid([below(level, window) for level in grid], grid)
        for kind, sign in (("maximum", 1.0), ("minimum", -1.0)):
            place = {"extreme_kind": kind, "extreme_window": window, "extreme_form": "velocity of a"}
            value, error = (float(particle[f"extreme_mean{end}"].sel(place)) for end in ("", "_standard_error"))
            assert abs(sign * value - mean) < 3.5 * error + 0.003
            spread = float(particle.extreme_deviation.sel(place))
            count = 128 * 400.0 / window
            assert error == pytest.approx(spread / np.sqrt(count), rel=0.35)  # windows depend on each other little


def test_fitted_levels(particle):
    """A level that the windows know is that of the laws; beyond, laws know it too, with a larger error."""
    place = {"extreme_kind": "magnitude", "extreme_window": 10.0, "extreme_form": "velocity of a"}
    of = particle.sel(place)
    level, error = (
        float(of[f"extreme_return_level{end}"].sel(extreme_return_time=100.0)) for end in ("", "_standard_error")
    )
    for law in ("Gumbel", "GEV"):
        fit, own = (of[f"extreme_fitted_level{end}"].sel(extreme_tail=law) for end in ("", "_standard_error"))
        assert abs(float(fit.sel(extreme_return_time=100.0)) - level) < 4.0 * error + 0.05
        assert float(own.sel(extreme_return_time=1e6)) > float(own.sel(extreme_return_time=100.0)) > 0.0
    assert (of.extreme_shape.sel(extreme_tail="Gumbel") == 0.0).all()
    assert abs(float(of.extreme_shape.sel(extreme_tail="GEV"))) < 0.2
    assert "fitted" in of.extreme_fitted_level.attrs["long_name"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"of": {"drift": {"uper": 1.0}}}, "no oscillator or contact 'uper'; did you mean 'upper'"),
        ({"of": {"drift": {("velocity", "gap"): 1.0}}}, "no oscillator 'gap'"),
        ({"of": {"drift": {("speed", "upper"): 1.0}}}, "quantities are 'displacement'"),
        ({"of": {"drift": {"upper": 0.0}}}, "no weight other than 0"),
        ({"of": {"drift": {"upper": float("nan")}}}, "must be a finite number"),
        ({"of": {}}, "is empty"),
        ({"of": ("upper", "upper")}, "'upper' is given twice"),
        ({"of": 3.0}, "must be linear forms by name"),
        ({"windows": (10.0, 25.0)}, "whole multiples of the shortest one, 10 s, and 25 s is not"),
        ({"windows": (10.0, 0.0)}, "larger than 0 s"),
        ({"windows": (10.0, 10.0)}, "given twice"),
        ({"windows": (10.0, 600.0)}, "longer than the duration of 20 s"),
        ({"windows": (10.0,), "return_times": (0.0,)}, "larger than 0 s"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(arguments, message):
    with pytest.raises(il.InvalidInput, match=message):
        il.simulate(towers(), 20.0, record=il.Extremes(**{"windows": (10.0,), **arguments}), rng=1)


def test_impacts_have_no_force():
    with pytest.raises(il.InvalidInput, match="'gap' is a RigidContact: its impacts have an impulse, but no force"):
        il.simulate(towers(il.RigidContact(0.8)), 20.0, record=il.Extremes("gap", windows=(10.0,)), rng=1)
