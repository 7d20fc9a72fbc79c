"""Spectral densities against exact ones, without what samples fold back."""

import numpy as np
import pytest
from scenes import base, linear
from scipy.integrate import quad

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.linear.decay import relaxation_time
from impactlab.records.spectrum import _POWER, FOLDED, _folded


@pytest.mark.parametrize("quantity", ["displacement", "velocity"])
def test_spectra_of_linear_bodies(quantity):
    network = linear()
    record = il.Spectrum(quantity, segment=60.0)
    ds = il.simulate(network, 200.0, realizations=128, rng=1, record=record)
    frequency = ds[f"{quantity}_frequency"].values
    value, error = (ds[f"spectrum_{quantity}{suffix}"].values[0] for suffix in ("", "_standard_error"))
    score = (value - il.exact(network).spectrum("a", quantity, frequency)) / error
    assert len(frequency) > 150
    assert frequency[-1] == pytest.approx(
        {"displacement": 2.0, "velocity": 8.0}[quantity] * np.pi * 2.0 * np.pi, rel=0.02
    )
    assert np.abs(score).max() < 4.5
    assert 0.85 < score[frequency < 0.5 * frequency[-1]].std() < 1.15
    assert abs(score.mean()) < 0.4
    assert 3.0 < float(ds[f"spectrum_{quantity}_band_factor"][0]) < 4.4  # of up to 1500 bins


@pytest.mark.parametrize(("quantity", "power"), [("displacement", 4), ("velocity", 2), ("contact_force", 2)])
def test_what_is_folded_back_onto_a_spectrum_that_falls_like_a_power(quantity, power):
    """Within 2 % at a tenth of the highest frequency, where the spectrum has its maximum, as everywhere."""
    frequency = np.linspace(0.0, np.pi, 1001)

    def law(omega):
        ratio = (omega / 0.3) ** 2
        return ratio ** (power == 2) / ((1.0 - ratio) ** 2 + 0.04 * ratio)

    images = [sign * frequency + 2.0 * np.pi * turn for turn in range(1, 2000) for sign in (-1.0, 1.0)]
    folded = sum(law(image) for image in images)
    assert _POWER[quantity] == power
    np.testing.assert_allclose(_folded(law(frequency) + folded, power), folded, rtol=0.02)


def test_the_integral_is_the_variance():
    """That of a body which is pushed aside, so that its mean is not 0; and of the force."""
    record = [il.Spectrum(labels=("two",)), il.Spectrum("contact_force", segment=10.0), il.Trajectory(0.02)]
    ds = il.simulate(base(), 60.0, realizations=128, rng=1, record=record)
    spectrum = ds.spectrum_displacement.sel(oscillator="two")
    step = float(ds.displacement_frequency[1])
    integral = float(2.0 * spectrum.sum() - spectrum[0] - spectrum[-1]) * step
    assert float(ds.mean_displacement[1]) ** 2 > 0.05 * float(ds.variance_displacement[1])
    assert integral == pytest.approx(float(ds.variance_displacement[1]), rel=0.03)
    assert np.isnan(ds.spectrum_displacement.sel(oscillator="one")).all()
    force = ds.spectrum_contact_force[0]
    integral = float(2.0 * force.sum() - force[0] - force[-1]) * float(ds.contact_force_frequency[1])
    assert integral == pytest.approx(float(ds.contact_force.var()), rel=0.03)


def test_the_length_of_segments_is_chosen_or_given():
    ds = il.simulate(linear(), 100.0, realizations=64, rng=1, record=il.Spectrum())
    wanted = 2.0 * np.pi / (20.0 * relaxation_time(Model.of(linear())))
    assert float(ds.displacement_frequency[1]) == pytest.approx(wanted, rel=0.02)
    ds = il.simulate(linear(), 100.0, realizations=64, rng=1, record=il.Spectrum(interval=0.05, segment=25.0))
    assert float(ds.displacement_frequency[1]) == pytest.approx(2.0 * np.pi / 25.0)
    assert float(ds.displacement_frequency[-1]) == pytest.approx(np.pi / 0.05)


def test_segments_are_no_longer_than_the_run():
    ds = il.simulate(linear(), 20.0, realizations=64, rng=1, record=il.Spectrum())
    assert float(ds.displacement_frequency[1]) == pytest.approx(2.0 * np.pi / 20.0, rel=0.02)


@pytest.mark.parametrize(
    ("record", "message"),
    [
        (lambda: il.Spectrum("energy"), r"Spectrum\.quantity"),
        (lambda: il.Spectrum(labels=("b",)), r"there is no label 'b'"),
        (lambda: il.Spectrum(labels="a"), r"a list of strings"),
        (lambda: il.Spectrum(segment=0.3), r"a segment has \d samples, .* needs at least 8"),
    ],
)
def test_bad_input_is_refused(record, message):
    with pytest.raises(il.InvalidInput, match=message):
        il.simulate(linear(), 20.0, realizations=64, rng=1, record=record())
    free = il.Network({"a": il.LinearOscillator(stiffness=1.0)})
    with pytest.raises(il.InvalidInput, match="nothing is damped; give segment="):
        il.simulate(free, 20.0, realizations=64, rng=1, step=0.1, record=il.Spectrum())


def test_what_lies_beyond_the_frequencies_is_said():
    """Of an overdamped body, whose velocity is nearly white: the exact share, and an interval that makes it small."""
    body = il.LinearOscillator.from_frequency(2.0, 5.0)
    network, options = il.Network({"a": body}, {}, {"a": il.WhiteNoise(0.05)}), {"realizations": 64, "rng": 1}
    with pytest.warns(il.AccuracyWarning, match=r"19 % of the variance of the velocity of 'a' .* give interval=0.013"):
        ds = il.simulate(network, 100.0, record=il.Spectrum("velocity", segment=20.0), **options)
    highest = float(ds.velocity_frequency[-1])
    on_axis, _ = quad(lambda w: w**2 / ((4.0 - w**2) ** 2 + (20.0 * w) ** 2), 0.0, highest, limit=200)
    share = 1.0 - on_axis / (np.pi / 2.0 / 20.0)
    assert float(ds.spectrum_velocity_beyond[0]) == pytest.approx(share, rel=FOLDED)
    ds = il.simulate(network, 20.0, record=il.Spectrum("velocity", segment=10.0, interval=0.0125), **options)
    assert float(ds.spectrum_velocity_beyond[0]) < 0.05
