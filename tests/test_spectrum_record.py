"""Spectral densities against exact ones, folded as samples fold them."""

import numpy as np
import pytest
from scenes import base, linear

import impactlab as il
from impactlab.linear import relaxation_time
from impactlab.model import Model


def folded(network, quantity, frequency):
    """Exact spectrum of samples: what is faster than half their rate comes back."""
    law, rate = il.exact(network), 2.0 * frequency[-1]
    return sum(law.spectrum("a", quantity, frequency + turn * rate) for turn in range(-100, 101))


@pytest.mark.parametrize("quantity", ["displacement", "velocity"])
def test_spectra_of_linear_bodies(quantity):
    network = linear()
    record = il.Spectrum(quantity, segment=60.0)
    ds = il.simulate(network, 200.0, realizations=128, rng=1, record=record)
    frequency = ds[f"{quantity}_frequency"].values
    value, error = (ds[f"spectrum_{quantity}{suffix}"].values[0] for suffix in ("", "_standard_error"))
    score = (value - folded(network, quantity, frequency)) / error
    assert len(frequency) > 150
    assert np.abs(score).max() < 4.5
    assert 0.85 < score.std() < 1.15
    assert abs(score.mean()) < 0.4
    assert 3.0 < float(ds[f"spectrum_{quantity}_band_factor"][0]) < 4.2


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
        (lambda: il.Spectrum(labels=("b",)), r"there is no 'b'"),
        (lambda: il.Spectrum(labels="a"), r"a sequence of names"),
        (lambda: il.Spectrum(segment=0.3), r"a segment has \d samples, .* it needs 8"),
    ],
)
def test_bad_input_is_refused(record, message):
    with pytest.raises(il.InvalidInput, match=message):
        il.simulate(linear(), 20.0, realizations=64, rng=1, record=record())
    free = il.Network({"a": il.LinearOscillator(stiffness=1.0)})
    with pytest.raises(il.InvalidInput, match="nothing is damped; give segment="):
        il.simulate(free, 20.0, realizations=64, rng=1, step=0.1, record=il.Spectrum())
