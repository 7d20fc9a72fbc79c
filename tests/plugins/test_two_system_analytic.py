"""The paper's analytic solution against the exact law, its own equations and itself."""

import numpy as np
import pytest
from impactlab_two_system import TwoSystemStudy
from impactlab_two_system.analytic import (
    PRINTED_EXPONENT,
    AnalyticSolution,
    fokker_planck_residual,
    runge_kutta_mean_square,
)

import impactlab as il

STUDY = TwoSystemStudy()
EXACT = (
    "mean_displacement",
    "mean_square_displacement",
    "variance_displacement",
    "contact_ratio",
    "mean_contact_force",
)


def solution(ratio: float = 16.0, clearance: float = 0.05, **options: float) -> AnalyticSolution:
    return AnalyticSolution.of(STUDY.network(ratio, clearance), **options)


def states(case: AnalyticSolution, count: int = 500) -> tuple[np.ndarray, np.ndarray]:
    """States of the linear law, about two in five with a closed contact."""
    normals = np.random.default_rng(7).standard_normal((2, 2, count))
    scales = np.sqrt([case.linear_mean_square_displacement, case.linear_mean_square_velocity])
    displacement, velocity = normals * scales[:, :, None]
    return displacement, velocity


@pytest.mark.parametrize("clearance", STUDY.clearances)
def test_it_is_the_exact_law_where_the_temperatures_are_equal(clearance):
    found = solution(clearance=clearance).statistics()
    exact = il.exact(STUDY.network(16.0, clearance)).statistics()
    for name in EXACT:
        np.testing.assert_allclose(found[name], exact[name], rtol=1e-10, err_msg=name)


@pytest.mark.parametrize("quantity", ["displacement", "velocity"])
def test_its_densities_are_the_exact_ones_where_the_temperatures_are_equal(quantity):
    case, exact = solution(), il.exact(STUDY.network(16.0, 0.05))
    for system, (name, low, high) in enumerate(STUDY.limits(16.0)[quantity]):
        edges = np.linspace(low, high, 101)
        expected = exact.density(name, quantity, edges)
        np.testing.assert_allclose(case.density(system, quantity, edges), expected, atol=1e-10 * expected.max())
        expected = exact.bin_density(name, quantity, edges)
        np.testing.assert_allclose(case.bin_density(system, quantity, edges), expected, atol=1e-10 * expected.max())


def test_the_contact_ratio_of_the_paper_and_with_the_printed_exponent():
    # 25-digit quadrature of the Gibbs density
    assert solution().statistics()["contact_ratio"][0] == pytest.approx(0.1076930779498, rel=1e-12)
    assert solution(exponent=PRINTED_EXPONENT).statistics()["contact_ratio"][0] == pytest.approx(0.0173, abs=5e-5)


@pytest.mark.full
@pytest.mark.parametrize("ratio", [1.0, 16.0, 256.0])
def test_moments_are_those_of_the_densities(ratio):
    case = solution(ratio)
    found = case.statistics()
    for system in (0, 1):
        reach = 9.0 * np.sqrt(case.linear_mean_square_displacement[system])
        points = np.linspace(-reach, reach, 40001)
        density = case.density(system, "displacement", points)
        assert np.trapezoid(density, points) == pytest.approx(1.0, rel=1e-7)
        mean = np.trapezoid(points * density, points)
        assert mean == pytest.approx(found["mean_displacement"][system], rel=1e-7)
        square = np.trapezoid(points**2 * density, points)
        assert square == pytest.approx(found["mean_square_displacement"][system], rel=1e-7)


def test_the_corrected_density_solves_the_fokker_planck_equation_and_the_printed_one_does_not():
    corrected, printed = solution(), solution(exponent=PRINTED_EXPONENT)
    displacement, velocity = states(corrected)
    touching = displacement[0] - displacement[1] > corrected.clearance
    assert 0.3 < touching.mean() < 0.5
    rate = corrected.dampings[0] / corrected.masses[0]  # the size of one term of the equation
    assert np.abs(fokker_planck_residual(corrected, displacement, velocity)).max() < 1e-4 * rate
    wrong = np.abs(fokker_planck_residual(printed, displacement, velocity))
    assert wrong[~touching].max() < 1e-4 * rate
    assert np.median(wrong[touching]) > 10.0 * rate


def test_where_the_condition_fails_no_exponent_solves_the_equation():
    case = solution(8.0)
    residual = np.abs(fokker_planck_residual(case, *states(case)))
    assert residual.max() > case.dampings[0]


def test_equation_six_holds_for_the_corrected_potential():
    case = solution()
    displacement, velocity = states(case)
    force = case.force(displacement[0] - displacement[1] - case.clearance)
    for system, sign in enumerate((1.0, -1.0)):
        step = np.zeros_like(displacement)
        step[system] = 1e-4 * np.sqrt(case.linear_mean_square_displacement[system])
        slope = case.log_density(displacement + step, velocity) - case.log_density(displacement - step, velocity)
        slope = case.temperatures[system] * slope / (2.0 * step[system])
        opposing = case.stiffnesses[system] * displacement[system] + sign * force
        np.testing.assert_allclose(slope, -opposing, atol=1e-4 * np.abs(opposing).max())


@pytest.mark.parametrize(("ratio", "velocity"), [(1.0, 16.0), (12.0, 4.0 / 3.0), (16.0, 1.0), (256.0, 0.0625)])
def test_the_ratios_of_the_linear_systems(ratio, velocity):
    case = solution(ratio)
    assert case.velocity_ratio == pytest.approx(velocity)
    assert case.displacement_ratio == pytest.approx(velocity / ratio**2)
    assert case.condition_holds == (ratio == 16.0)


def test_the_foretold_error_of_runge_kutta():
    def error(ratio: float, step: float) -> float:
        network = STUDY.network(ratio, 0.05, "paper")
        body, series = network.oscillators["one"], network.excitations["one"]
        white = np.pi * series.spectral_density / (body.damping * body.stiffness)
        return runge_kutta_mean_square(body, series, step) / white - 1.0

    assert error(256.0, 1e-3) == pytest.approx(-0.37, abs=0.005)
    assert -0.020 < error(128.0, 1e-3) < -0.016
    assert abs(error(16.0, 1e-3)) < 1e-4


def test_the_response_of_runge_kutta_to_one_cosine():
    body = il.LinearOscillator.from_frequency(1000.0, 0.1)
    line = il.ShinozukaNoise(2.0, band=(0.0, 130.0), components=1)
    (frequency,), (amplitude,) = line.lines()
    step, steps = 1e-3, 6000
    matrix = np.array([[0.0, 1.0], [-body.stiffness, -body.damping]])

    def slope(time: float, state: np.ndarray) -> np.ndarray:
        return matrix @ state + np.array([0.0, amplitude * np.cos(frequency * time)])

    state, squares = np.zeros(2), np.empty(steps)
    for n in range(steps):
        first = slope(n * step, state)
        second = slope((n + 0.5) * step, state + 0.5 * step * first)
        third = slope((n + 0.5) * step, state + 0.5 * step * second)
        fourth = slope((n + 1) * step, state + step * third)
        state = state + step / 6.0 * (first + 2.0 * second + 2.0 * third + fourth)
        squares[n] = state[0] ** 2
    late = squares[steps // 6 :]  # 5000 steps hold whole periods: 130 Hz over 5 s
    assert late.mean() == pytest.approx(runge_kutta_mean_square(body, line, step), rel=1e-6)
