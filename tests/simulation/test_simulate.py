"""What simulate returns, its options, and that all methods and excitations agree."""

import json
import math
import textwrap

import numpy as np
import pytest
from laws import LossyContact
from scenes import base, deviations, linear, plan_of
from scipy.linalg import expm

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.linear.laws import linear_variances
from impactlab.results.schema import STATISTICS, balances


class TwoTones(il.Excitation):
    """A user's own lines, which lie on no grid."""

    amplitude: float = il.parameter(units="N")

    def lines(self):
        return np.array([5.0, 5.0 * math.sqrt(2.0)]), np.array([self.amplitude, 0.5 * self.amplitude])


@pytest.fixture(scope="module")
def result():
    return il.simulate(base(), 20.0, realizations=64, rng=1)


# the dataset


def test_every_default_statistic_has_its_dimension_units_and_error(result):
    for name, statistic in STATISTICS.items():
        dimension = statistic.dimension
        assert result[name].dims == (dimension,)
        assert result[name].attrs["units"] == statistic.units
        error = result[name].attrs["ancillary_variables"]
        assert result[error].dims == (dimension,)
        assert (result[error] > 0.0).all()
    for balance in balances():
        assert balance.name in result
    assert result.oscillator.values.tolist() == ["one", "two"]
    assert result.contact.values.tolist() == ["gap"]


def test_what_was_chosen_is_recorded(result):
    assert result.attrs["duration"] == pytest.approx(20.0)
    assert result.attrs["realizations"] == 64
    assert result.attrs["integrator"] == "ExactFlow"
    assert result.attrs["initial"] == "stationary"
    assert result.attrs["spin_up"] == pytest.approx(12.0 / (0.2 * np.pi), rel=1e-3)
    assert 1e-3 < result.attrs["step"] < 1e-2
    assert float(result.observation_time) == pytest.approx(20.0)
    assert result.attrs["Conventions"] == "CF-1.11"
    stored = json.loads(result.attrs["impactlab_configuration"])
    assert stored["simulate"]["realizations"] == 64
    assert il.network_of(result) == base()


def test_a_network_without_contacts_has_no_statistics_of_contacts():
    ds = il.simulate(linear(), 10.0, realizations=64, rng=1)
    assert "contact" not in ds.dims
    assert not {"contact_ratio", "peak_contact_force", "observation_time"} & set(ds)


def test_the_identity_of_variance_and_mean_square(result):
    """Up to what Simpson's rule for the mean square lacks of the square of the mean."""
    np.testing.assert_allclose(
        result.direct_variance_displacement,
        result.direct_mean_square_displacement - result.direct_mean_displacement**2,
        rtol=1e-4,
    )


# options


@pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")
@pytest.mark.parametrize(
    ("initial", "x", "v"),
    [
        ("rest", [0.0, 0.0], [0.0, 0.0]),
        ({"displacement": {"two": 0.3}}, [0.0, 0.3], [0.0, 0.0]),
        ({"velocity": {"one": 2.0, "two": -1.0}}, [0.0, 0.0], [2.0, -1.0]),
        ({}, [0.0, 0.0], [0.0, 0.0]),
    ],
)
def test_a_given_start_is_where_it_starts(initial, x, v):
    ds = il.simulate(base(), 0.1, realizations=3, rng=1, initial=initial, step=5e-3, record=il.Trajectory(5e-3))
    assert ds.spin_up == 0.0
    np.testing.assert_array_equal(ds.displacement[:, 0], np.tile(x, (3, 1)))
    np.testing.assert_array_equal(ds.velocity[:, 0], np.tile(v, (3, 1)))


@pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")
def test_a_stationary_start_is_open_everywhere_and_has_the_linear_velocities():
    ds = il.simulate(base(), 0.05, realizations=4000, rng=1, spin_up=0.0, record=il.Trajectory(0.05))
    x, v = ds.displacement[:, 0].values, ds.velocity[:, 0].values
    assert (x[:, 0] - x[:, 1] <= 0.05).all()
    variances = linear_variances(Model.of(base()))
    error = variances[1] * math.sqrt(2.0 / 4000.0)
    assert (np.abs((v**2).mean(axis=0) - variances[1]) < 4.0 * error).all()
    assert x[:, 1].mean() > 0.05  # as the closed ones were drawn again, not moved


@pytest.mark.filterwarnings("ignore:The two halves of the run differ")
def test_a_free_body_starts_at_rest_since_it_has_no_law():
    free = il.Network({"a": il.LinearOscillator(damping=1.0)}, excitations={"a": il.WhiteNoise(1.0)})
    ds = il.simulate(free, 1.0, realizations=64, rng=1, step=0.05, spin_up=0.0)
    assert ds.attrs["initial"] == "rest"


def test_means_over_a_transient_from_rest_are_told_unless_it_is_asked_for(recwarn):
    options = {"realizations": 1024, "initial": "rest", "rng": 1}
    ds = il.simulate(linear(), 5.0, spin_up=0.0, **options)
    il.simulate(linear(), 5.0, **{**options, "initial": {}})
    il.simulate(linear(), 5.0, record=il.Trajectory(1.0), **options)
    assert ds.drift > 6.0
    assert not recwarn
    with pytest.warns(il.AccuracyWarning, match=r"transient from rest: the two halves .* differ by \d+\.\d") as told:
        again = il.simulate(linear(), 5.0, **options)
    assert len(told) == 1
    assert again.mean_square_displacement.equals(ds.mean_square_displacement)


def test_steps_and_durations_are_kept():
    ds = il.simulate(linear(), 10.0, step=0.125, realizations=64, rng=1)
    assert ds.attrs["step"] == 0.125
    assert ds.attrs["duration"] == 10.0


@pytest.mark.full
def test_a_dissipative_pair_cools():
    """A dashpot in the contact takes energy: both bodies are colder, and the balances still close."""

    contact = il.Contact("one", "two", LossyContact(1000.0, damping=100.0), clearance=0.05)
    elastic = base().replace(contacts={"gap": il.Contact("one", "two", il.LinearContact(1000.0), clearance=0.05)})
    cold = il.simulate(base().replace(contacts={"gap": contact}), 60.0, realizations=512, rng=1)
    warm = il.exact(elastic).statistics()
    drop = warm.mean_square_velocity - cold.mean_square_velocity
    assert (drop > 10.0 * cold.mean_square_velocity_standard_error).all()
    for name in (balance.name for balance in balances()):
        assert float(abs(cold[name] / cold[f"{name}_standard_error"]).max()) < 3.5, name


# methods and excitations agree


@pytest.mark.parametrize(
    ("integrator", "step", "relative"),
    [(il.RungeKutta4(), 2e-3, 2e-3), pytest.param(il.EulerMaruyama(), 2e-5, 4e-3, marks=pytest.mark.campaign)],
)
def test_explicit_methods_have_the_exact_statistics(integrator, step, relative):
    """Euler's bias is about h ω/(2ζ) with the largest ω and its ζ, 0.2 % here."""
    gap = il.Contact("one", "two", il.LinearContact(200.0), clearance=0.05)
    network = base(ratio=2.0).replace(excitations={"one": il.WhiteNoise(2.0)}, contacts={"gap": gap})
    duration = 40.0 if isinstance(integrator, il.RungeKutta4) else 4.0
    ds = il.simulate(network, duration, realizations=512, step=step, integrator=integrator, rng=1, spin_up=8.0)
    names = ["mean_displacement", "mean_square_displacement", "mean_square_velocity", "mean_contact_force"]
    found = deviations(ds, il.exact(network).statistics(), [*names, "contact_ratio", "contact_rate"], relative)
    assert max(found.values()) < 3.5, found
    assert not any(name.startswith("balance_") for name in ds)  # they belong to methods that kick


def test_bounded_noise_without_contacts_has_the_band_limited_law():
    noise = il.ShinozukaNoise(1.0, band=(0.0, 8.0), components=800)
    network = linear().replace(excitations={"a": noise})
    expected = linear_variances(Model.of(network))[:, 0]
    ds = il.simulate(network, 60.0, realizations=256, rng=1, spin_up=0.0)
    for name, value in zip(("mean_square_displacement", "mean_square_velocity"), expected, strict=True):
        assert abs(float(ds[name][0]) - value) < 3.5 * float(ds[f"{name}_standard_error"][0])


@pytest.mark.full
def test_bounded_noise_with_contacts_agrees_with_white_noise():
    """A band that is wide for both bodies; what it cuts off is seen in the velocities."""
    noise = {
        "one": il.ShinozukaNoise(16.0, band=(0.0, 200.0), components=12_000),
        "two": il.ShinozukaNoise(1.0, band=(0.0, 200.0), components=12_000),
    }
    bounded = base().replace(excitations=noise)
    ds = il.simulate(bounded, 40.0, realizations=128, rng=1)
    exact = il.exact(base()).statistics()
    names = ["mean_displacement", "mean_square_displacement", "contact_ratio", "mean_contact_force"]
    assert max(deviations(ds, exact, names, relative=5e-3).values()) < 3.5


@pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")
def test_exact_flow_and_runge_kutta_take_the_same_phases():
    """Path by path under bounded noise, with collisions: the methods agree within their errors."""
    noise = il.ShinozukaNoise(1.0, band=(0.0, 50.0), components=1000)
    network = base(4.0).replace(excitations={"one": noise, "two": noise})
    options = {"rng": 1, "initial": "rest", "spin_up": 0.0, "record": il.Trajectory(0.05)}
    flow = il.simulate(network, 5.0, step=5e-4, **options)
    kutta = il.simulate(network, 5.0, step=5e-4, integrator=il.RungeKutta4(), **options)
    assert float(flow.contact_ratio[0]) > 0.01
    difference = flow.displacement - kutta.displacement
    assert float(np.sqrt((difference**2).mean())) < 2e-4 * float(np.sqrt((kutta.displacement**2).mean()))


def test_a_users_own_lines_have_their_mean_square():
    network = linear().replace(excitations={"a": TwoTones(2.0)})
    expected = linear_variances(Model.of(network))[:, 0]
    ds = il.simulate(network, 100.0, realizations=64, rng=1, spin_up=0.0)
    error = ds.mean_square_displacement_standard_error
    assert abs(float(ds.mean_square_displacement[0]) - expected[0]) < 3.5 * float(error[0])
    assert float(error[0]) < 0.02 * expected[0]


@pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")
@pytest.mark.parametrize("integrator", [il.ExactFlow(), il.RungeKutta4()])
def test_a_given_force_has_its_closed_response(integrator):
    network = linear(ratio=0.2).replace(excitations={"a": il.Harmonic(3.0, frequency=4.0)})
    body = network.oscillators["a"]
    ds = il.simulate(
        network, 4.0, step=1e-3, initial="rest", spin_up=0.0, integrator=integrator, record=il.Trajectory(0.1)
    )
    steady = 3.0 / (body.stiffness - 16.0 + 1j * body.damping * 4.0)
    time = ds.time.values
    particular = np.stack([(steady * np.exp(4j * time)).imag, (4j * steady * np.exp(4j * time)).imag])
    drift = np.array([[0.0, 1.0], [-body.stiffness, -body.damping]])
    expected = particular.T - np.array([expm(drift * t) @ particular[:, 0] for t in time])
    np.testing.assert_allclose(ds.displacement[0, :, 0], expected[:, 0], atol=1e-6)
    np.testing.assert_allclose(ds.velocity[0, :, 0], expected[:, 1], atol=1e-5)


# accuracy instead of duration


def test_a_tolerance_is_kept():
    exact = il.exact(base()).statistics()
    tolerance = {"mean_square_displacement": 0.01, "contact_ratio": 0.01}
    ds = il.simulate(base(), tolerance=tolerance, rng=1)
    for name, relative in tolerance.items():
        assert (2.0 * ds[f"{name}_standard_error"] <= relative * abs(ds[name])).all()
        assert (abs(ds[name] / exact[name] - 1.0) < 1.5 * relative).all()


def test_neither_duration_nor_tolerance():
    with pytest.raises(il.InvalidInput, match=r"needs a duration \(s\), or a tolerance"):
        il.simulate(base())


# a script of a user's own


@pytest.mark.campaign
def test_a_law_typed_in_a_script_runs_there_and_in_its_processes(tmp_path, run_python):
    script = tmp_path / "script.py"
    script.write_text(
        textwrap.dedent(
            """
            import concurrent.futures
            import multiprocessing
            import impactlab as il

            class Square(il.ContactLaw):
                stiffness: float = il.parameter(units="N m-2")

                @staticmethod
                def force(indentation, stiffness):
                    return stiffness * indentation * indentation

            if __name__ == "__main__":
                body = il.LinearOscillator.from_frequency(6.0, 0.1)
                network = il.chain(2, body, Square(1e4), clearance=0.05, excitation=il.WhiteNoise(1.0))
                options = dict(realizations=64, rng=1)
                here = il.simulate(network, 2.0, **options)
                context = multiprocessing.get_context("spawn")
                with concurrent.futures.ProcessPoolExecutor(2, mp_context=context) as pool:
                    there = il.simulate(network, 2.0, executor=pool, **options)
                print((here.mean_contact_force == there.mean_contact_force).all().item())
                print(float(here.contact_ratio[0]) > 0.0)
            """
        )
    )
    assert run_python(script).split() == ["True", "True"]


def test_a_start_knows_couplings_that_rule_a_body():
    """By the linear law the spring of third power would hold 10⁵ times the energy kT = 1 J that a step is made for."""
    body = il.LinearOscillator(damping=0.2, stiffness=1.0)
    spring = il.Coupling("body", il.WALL, il.CubicCoupling(1e6))
    network = il.Network({"body": body}, excitations={"body": il.WhiteNoise(0.2 / np.pi)}, couplings={"spring": spring})
    deviation = plan_of(network).start.deviations[0, 0]
    assert 1e-3 < 1e6 / 4.0 * deviation**4 < 10.0
    weak = network.replace(couplings={"spring": il.Coupling("body", il.WALL, il.CubicCoupling(0.1))})
    assert plan_of(weak).start.deviations[0, 0] == pytest.approx(1.0)
