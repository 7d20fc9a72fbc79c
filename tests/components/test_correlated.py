"""Correlated noises by a matrix of spectral densities, and spectra given as tables."""

import numpy as np
import pytest
from scenes import BUILDINGS, covariances_of_buildings, matrices_of_buildings
from scipy.linalg import solve_continuous_lyapunov

import impactlab as il

NAMES = "a", "b", "c"
MATRIX = np.array([[2.0, 0.8, -0.3], [0.8, 1.0, 0.2], [-0.3, 0.2, 0.5]])
BODIES = {name: il.LinearOscillator(mass=1.0, damping=0.4, stiffness=9.0) for name in NAMES}


def spanned(sources):
    weights = np.array([[source.on.get(name, 0.0) for name in NAMES] for source in sources.values()])
    return weights.T @ weights


@pytest.mark.parametrize(("matrix", "rank"), [(MATRIX, 3), (np.outer([1.0, -2.0, 0.5], [1.0, -2.0, 0.5]), 1)])
def test_sources_have_the_densities_of_the_matrix(matrix, rank):
    sources = il.correlated(il.WhiteNoise(1.0), matrix, NAMES)
    assert len(sources) == rank
    np.testing.assert_allclose(spanned(sources), matrix, atol=1e-12)


@pytest.mark.parametrize("noise", [il.WhiteNoise(1.0), il.OrnsteinUhlenbeckNoise(1.0, correlation_time=0.3)], ids=repr)
def test_equal_bodies_have_covariances_in_proportion_to_the_matrix(noise):
    network = il.Network(BODIES, None, il.correlated(noise, MATRIX, NAMES))
    exact = il.exact(network)
    found = np.array([[exact.covariance(p, q, "displacement") for q in NAMES] for p in NAMES])
    np.testing.assert_allclose(found / found[0, 0], MATRIX / MATRIX[0, 0], rtol=1e-9)
    result = il.simulate(network, 40.0, realizations=128, rng=1, record=il.Trajectory(1.0))
    x = result.displacement.values
    each = np.einsum("rti,rtj->rij", x, x) / x.shape[1]
    error = each.std(axis=0, ddof=1) / np.sqrt(len(each))
    np.testing.assert_array_less(np.abs(each.mean(axis=0) - found), 4.5 * error)


GROUND = il.KanaiTajimi(1.3, 15.0, 0.6)
RATIOS = np.array([[1.0, 0.6, 0.2], [0.6, 0.9, 0.3], [0.2, 0.3, 0.5]])


@pytest.mark.parametrize("quantity", ["displacement", "velocity"])
def test_correlated_motions_of_the_ground_move_structures_as_lyapunovs_equation_says(quantity):
    """The soil below each building is a filter of its own, of three correlated white noises."""
    mass, damping, stiffness, forces, roofs = matrices_of_buildings()
    inverse = np.linalg.inv(mass)
    drift, root = np.zeros((16, 16)), np.linalg.cholesky(RATIOS)
    for soil in range(3):
        drift[2 * soil : 2 * soil + 2, 2 * soil : 2 * soil + 2] = [[0.0, 1.0], [-(15.0**2), -2.0 * 0.6 * 15.0]]
        acceleration = np.array([15.0**2, 2.0 * 0.6 * 15.0])  # of the layer, −(ω² z + 2ζω z'), its sign is free
        drift[11:, 2 * soil : 2 * soil + 2] = -np.outer(inverse @ forces[:, soil], acceleration)
    drift[6:11, 11:], drift[11:, 6:11], drift[11:, 11:] = np.eye(5), -inverse @ stiffness, -inverse @ damping
    given = np.zeros((16, 3))
    given[1:6:2] = np.sqrt(1.3) * root
    covariance = solve_continuous_lyapunov(drift, -2.0 * np.pi * given @ given.T)
    part = slice(6, 11) if quantity == "displacement" else slice(11, 16)
    found = covariances_of_buildings(il.correlated(il.BaseMotion(GROUND), RATIOS, on=list(BUILDINGS)), quantity)
    np.testing.assert_allclose(found, roofs @ covariance[part, part] @ roofs.T, rtol=1e-9)


def test_full_and_no_correlation_of_the_ground_are_one_motion_and_independent_ones():
    ground, on = il.BaseMotion(GROUND), ["tower", "beam"]
    bodies = {name: BUILDINGS[name] for name in on}
    one = il.Network(bodies, None, il.correlated(ground, np.ones((2, 2)), on))
    assert one.sources == il.Network(bodies, None, {"noise 1": ground}).sources
    apart = il.Network(bodies, None, il.correlated(ground, np.diag([4.0, 0.25]), on))
    own = {"noise 1": il.BaseMotion(GROUND, on={"tower": 2.0}), "noise 2": il.BaseMotion(GROUND, on={"beam": 0.5})}
    assert apart.sources == il.Network(bodies, None, own).sources


@pytest.mark.full
def test_correlated_ground_accelerations_in_a_run():
    """Beside contacts that never close, in standard errors of independent realizations."""
    network = il.Network(
        BUILDINGS,
        {"far": il.Contact("tower.2", "beam.tip", il.LinearContact(10.0), clearance=50.0)},
        il.correlated(il.BaseMotion(GROUND), RATIOS, on=list(BUILDINGS)),
    )
    result = il.simulate(network, 20.0, realizations=128, rng=3, record=il.Trajectory(0.5))
    x = np.stack([result.point_displacement.sel(point="beam.tip"), result.displacement.sel(oscillator="hut")])
    each = (x[0] * x[1]).mean(axis=-1)
    expected = il.exact(network.replace(contacts={"far": None})).covariance("beam.tip", "hut", "displacement")
    assert abs(each.mean() - expected) < 4.0 * each.std(ddof=1) / np.sqrt(len(each))


def test_what_is_no_matrix_of_densities_is_refused():
    noise = il.WhiteNoise(1.0)
    with pytest.raises(il.InvalidInput, match="no negative eigenvalue, but the lowest of 2 is -1"):
        il.correlated(noise, [[1.0, 2.0], [2.0, 1.0]], ["a", "b"])
    with pytest.raises(il.InvalidInput, match="symmetric"):
        il.correlated(noise, [[1.0, 0.5], [0.4, 1.0]], ["a", "b"])
    with pytest.raises(il.InvalidInput, match=r"for 3 bodies, not of shape \(2, 2\)"):
        il.correlated(noise, np.eye(2), NAMES)
    with pytest.raises(il.InvalidInput, match=r"must be finite, but the entry \(1, 2\) is nan"):
        il.correlated(noise, [[1.0, np.nan], [np.nan, 1.0]], ["a", "b"])
    with pytest.raises(il.InvalidInput, match="numbers"):
        il.correlated(noise, "matrix", NAMES)
    with pytest.raises(il.InvalidInput, match="different names"):
        il.correlated(noise, np.eye(2), ["a", "a"])
    with pytest.raises(il.InvalidInput, match="a noise such as"):
        il.correlated(il.ConstantForce(1.0), np.eye(3), NAMES)
    with pytest.raises(il.InvalidInput, match="a noise such as"):
        il.correlated(il.BaseMotion(il.ConstantForce(1.0)), np.eye(3), NAMES)
    with pytest.raises(il.InvalidInput, match="correlated takes a BaseMotion without on="):
        il.correlated(il.BaseMotion(noise, on="a"), np.eye(3), NAMES)


def test_a_table_has_the_power_of_its_bands():
    noise = il.TabulatedNoise([1.0, 3.0, 3.7, 8.0], [0.0, 2.0, 2.0, 0.5], components=700)
    frequencies, amplitudes = noise.lines()
    assert noise.period == pytest.approx(2.0 * np.pi / 0.01)
    assert 0.5 * (amplitudes**2).sum() == pytest.approx(2.0 * (2.0 + 1.4 + 4.3 * 1.25), rel=1e-12)
    middle = frequencies - 0.5 * noise.spacing
    inside = np.interp(middle, noise.frequencies, noise.densities)
    np.testing.assert_allclose(0.25 * amplitudes**2 / noise.spacing, inside, atol=2e-9 + 1e-12 * 700)
    flat = il.TabulatedNoise([0.0, 40.0 * np.pi], [0.7, 0.7], components=400)
    for found, expected in zip(
        flat.lines(), il.ShinozukaNoise(0.7, band=(0.0, 20.0), components=400).lines(), strict=True
    ):
        np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_a_table_moves_a_body_as_its_exact_law_says():
    noise = il.TabulatedNoise([0.0, 3.0, 9.0], [0.2, 1.0, 0.0], components=2000)
    network = il.Network({"a": BODIES["a"]}, None, {"a": noise})
    result = il.simulate(network, 100.0, realizations=128, rng=2)
    assert np.abs(il.compare(result, il.exact(network)).z).max() < 4.0


def test_tables_that_are_no_spectra_are_refused():
    with pytest.raises(il.InvalidInput, match=r"at least 0, but that at 3 rad/s is -1"):
        il.TabulatedNoise([0.0, 3.0], [1.0, -1.0])
    with pytest.raises(il.InvalidInput, match="at least 0 rad/s, not -1"):
        il.TabulatedNoise([-1.0, 3.0], [1.0, 1.0])
    with pytest.raises(il.InvalidInput, match=r"frequencies must increase, but sample 1 .* 2 rad/s"):
        il.TabulatedNoise([3.0, 2.0], [1.0, 1.0])
    many = il.TabulatedNoise(np.arange(20.0), np.ones(20))
    assert repr(many) == "TabulatedNoise of 20 densities from 0 to 19 rad/s"
