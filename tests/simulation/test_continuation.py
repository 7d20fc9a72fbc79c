"""A bifurcation diagram with continuation: each run begins where that of the value before has ended."""

import math

import numpy as np
import pytest
import xarray as xr

import impactlab as il


def continued(make_network, values, *, period, settling, samples, steps, initial="rest"):
    """Return the states once a period for some values of a parameter, each from where the one before has ended.

    Parameters
    ----------
    make_network : callable
        Makes the network of a value.
    values : sequence of float
        In the order in which they are gone through.
    period : callable
        Time between samples, by the value (s).
    settling, samples : int
        Periods before samples are taken, and number of samples.
    steps : int
        Steps of a period.
    initial : optional
        State at the first value.

    Returns
    -------
    Dataset
        ``displacement`` and ``velocity`` by ``value``, ``sample`` and ``oscillator``.
    """
    found = {"displacement": [], "velocity": []}
    for value in values:
        time = period(value)
        with il.Run(make_network(value), initial=initial, step=time / steps, spin_up=0.0) as run:
            run.advance(settling * time)
            kept = []
            for _ in range(samples):
                run.advance(time)
                kept.append(run.state)
            initial = run.state
        for name, of_values in found.items():
            of_values.append([state[f"final_{name}"].values[0] for state in kept])
    variables = {name: (("value", "sample", "oscillator"), np.array(item)) for name, item in found.items()}
    return xr.Dataset(variables, {"value": list(values), "oscillator": kept[0]["oscillator"].values})


@pytest.mark.full
def test_a_bent_resonance_has_two_branches():
    """x'' + 0.1 x' + x + x³ = 0.3 cos ωt: the one that is found depends on where one comes from."""
    body = il.DuffingOscillator(damping=0.1, stiffness=1.0, cubic=1.0)

    def driven(frequency):
        return il.Network({"body": body}, excitations={"body": il.Harmonic(0.3, frequency=frequency)})

    def amplitudes(frequencies):
        found = continued(
            driven, frequencies, period=lambda value: 2.0 * math.pi / value, settling=40, samples=2, steps=256
        )
        x, v = (found[name].sel(oscillator="body").values for name in ("displacement", "velocity"))
        np.testing.assert_allclose(x[:, 0], x[:, 1], atol=2e-2)  # it has settled
        return np.hypot(x[:, 1], v[:, 1] / frequencies)

    frequencies = np.array([1.2, 1.3, 1.4, 1.5, 1.6, 1.7])
    up, down = amplitudes(frequencies), amplitudes(frequencies[::-1])[::-1]
    for found, largest in ((up, True), (down, False)):
        expected = [balance(frequency, largest) for frequency in frequencies]
        np.testing.assert_allclose(found, expected, rtol=0.06)
    assert up[3] > 2.0 * down[3]


def balance(frequency, largest):
    """Amplitude by harmonic balance: ((1 - ω² + ¾ a²)² + (0.1 ω)²) a² = 0.3²."""
    linear = 1.0 - frequency**2
    roots = np.roots([0.5625, 1.5 * linear, linear**2 + (0.1 * frequency) ** 2, -0.09])
    squares = np.sort(roots[np.abs(roots.imag) < 1e-9].real)
    return math.sqrt(squares[-1] if largest else squares[0])
