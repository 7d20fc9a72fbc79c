"""Quantities of one's own."""

import math

import numpy as np
import pytest
from scenes import base, linear

import impactlab as il
from impactlab.records.signed_histogram import SignedHistogram, edges_of, joined_counts


def work_rate(force, rate):
    return force * rate


def energy(displacement, velocity, mass, stiffness):
    return 0.5 * (mass * velocity * velocity + stiffness * displacement * displacement)


def electric_power(voltage, resistance):
    return voltage * voltage / resistance


def harvester(theta=0.4, ratio=0.02):
    """A piezoelectric harvester with m = k = C = R = 1 on a base of a white acceleration."""
    beam = il.LinearOscillator(damping=2.0 * ratio, stiffness=1.0)
    patch = il.PiezoelectricCoupling(theta, capacitance=1.0, resistance=1.0)
    return il.Network(
        {"beam": beam},
        couplings={"patch": il.Coupling(il.WALL, "beam", patch)},
        excitations={"beam": il.WhiteNoise(1.0)},
    )


POWER = 2.026833970
"""Mean power of the harvester (W): S. Adhikari, M. I. Friswell and D. J. Inman, Smart Mater. Struct. 18, 2009."""


def score(ds, name, expected):
    return np.abs((ds[name].values - expected) / ds[f"{name}_standard_error"].values).max()


def test_the_energy_of_a_linear_body():
    """The mean is that of the law, and the density exponential."""
    record = il.Observable("energy", energy, per="oscillator", units="J")
    ds = il.simulate(linear(), 60.0, realizations=128, rng=1, record=record)
    body = linear().oscillators["a"]
    heat = np.pi / body.damping
    assert score(ds, "mean_energy", heat) < 4.0
    assert score(ds, "mean_square_energy", 2.0 * heat**2) < 4.0
    assert ds.mean_energy.attrs["units"] == "J"
    assert ds.mean_square_energy.attrs["units"] == "J2"
    edges, density = ds.energy_edges.values[0], ds.density_energy.values[0]
    law = -np.diff(np.exp(-np.maximum(edges, 0.0) / heat)) / np.diff(edges)
    error = ds.density_energy_standard_error.values[0]
    seen = error > 0.0
    assert np.abs((density - law)[seen] / error[seen]).max() < 5.0
    assert (density * np.diff(edges)).sum() == pytest.approx(1.0)
    assert 0.0 <= float(ds.smallest_energy[0]) < heat < float(ds.largest_energy[0]) < edges[-1]


@pytest.mark.full
def test_the_power_of_a_harvester():
    """By the voltage, a state of a law, by the energy flows, and by the exact law of the circuit."""
    records = [il.Observable("power", electric_power, per="coupling", units="W"), il.EnergyFlows()]
    ds = il.simulate(harvester(), 1500.0, realizations=64, rng=1, record=records)
    assert ds.power_coupling.values.tolist() == ["patch"]
    assert score(ds, "mean_power", POWER) < 4.0
    assert score(ds, "coupling_power_dissipated", POWER) < 4.0
    circuit = il.Network(
        {"beam": harvester().oscillators["beam"], "charge": il.LinearOscillator.massless(1.0)},
        couplings={
            "patch": il.Coupling(il.Combination({"beam": 0.4, "charge": -1.0}), il.WALL, il.LinearCoupling(1.0))
        },
        excitations={"beam": il.WhiteNoise(1.0)},
    )
    exact = il.exact(circuit).statistics().mean_square_velocity.sel(oscillator="charge")
    assert float(exact) == pytest.approx(POWER, rel=1e-7)


def test_the_work_of_a_contact():
    """Force times rate is what the contact loses, here by its damper."""
    contact = {"gap": il.Contact("one", "two", il.KelvinVoigtContact(1e4, damping=20.0), clearance=0.05)}
    records = [il.Observable("work rate", work_rate, per="contact", units="W"), il.EnergyFlows()]
    ds = il.simulate(base(contacts=contact), 60.0, realizations=128, rng=1, record=records)
    error = math.hypot(
        *(float(ds[f"{name}_standard_error"][0]) for name in ("mean_work_rate", "contact_power_dissipated"))
    )
    assert abs(float(ds.mean_work_rate[0] - ds.contact_power_dissipated[0])) < 4.0 * error
    assert float(ds.mean_work_rate[0]) > 10.0 * float(ds.mean_work_rate_standard_error[0])


@pytest.mark.full
def test_paths_are_those_of_trajectories(tmp_path):
    """Whatever the place, and again from a file."""

    def product(displacement_one, velocity_two, force_gap):
        return displacement_one * velocity_two + force_gap

    records = [
        il.Observable("mix", product, per="network", units="1", interval=0.05),
        il.Observable("depth", depth_of, per="contact", units="m", interval=0.05),
        il.Trajectory(0.05),
    ]
    ds = il.simulate(base(), 4.0, realizations=70, rng=1, record=records)
    x, v = (ds[name].sel(oscillator=body).values for name, body in (("displacement", "one"), ("velocity", "two")))
    np.testing.assert_allclose(ds.mix, x * v + ds.contact_force[:, :, 0].values, rtol=1e-12, atol=1e-12)
    depth = np.maximum(x - ds.displacement.sel(oscillator="two").values - 0.05, 0.0)
    np.testing.assert_allclose(ds.depth[:, :, 0], depth, rtol=1e-12, atol=1e-12)
    assert float(ds.mean_mix) == pytest.approx(float(ds.mix[:, 1:].mean()), abs=4.0 * float(ds.mean_mix_standard_error))
    il.save(ds, tmp_path / "mix.nc")
    again = il.rerun(tmp_path / "mix.nc")
    for name in ("mean_mix", "mix", "density_depth", "largest_depth"):
        np.testing.assert_array_equal(again[name], ds[name])


def depth_of(indentation):
    return indentation


@pytest.mark.full
def test_records_have_the_same_numbers_alone_and_beside_one_that_reads_all():
    """Of which snapshots hold all rows; alone they hold those that the record reads."""
    records = [
        il.Observable("work rate", work_rate, units="W"),
        il.Extremes(["one", "gap"], windows=(1.0,)),
        il.Cycles({"drift": {"one": 1.0, "two": -1.0}}),
    ]
    for record in records:
        alone, beside = (
            il.simulate(base(), 4.0, realizations=70, rng=1, step=0.005, record=chosen)
            for chosen in ([record], [record, il.Trajectory(0.5)])
        )
        for name in alone.data_vars:
            np.testing.assert_allclose(alone[name], beside[name], rtol=1e-12, atol=1e-12, err_msg=str(name))


@pytest.mark.full
def test_bins_about_zero_widen_as_values_need_it():
    values = np.random.default_rng(1).normal(size=(2, 30, 5)) * np.geomspace(1e-3, 1e3, 30)[:, None]
    counts = SignedHistogram(2, 16, np.array([[0, 1, 2, 0, 1]]))
    for part in np.split(values, 6, axis=1):
        counts.add(np.ascontiguousarray(part), 0)
    found, width = joined_counts([counts.result()], 16)
    for place, edges in enumerate(edges_of(width, 16)):
        expected = np.histogram(values[place], edges)[0]
        np.testing.assert_array_equal(found[:, place].sum(axis=0), expected)


def test_formulas_that_cannot_be_are_refused():
    def wrong(force, speed):
        return force * speed

    def infinite(displacement):
        return 1.0 / (displacement - displacement)

    def printing(displacement):
        print(displacement)
        return displacement

    with pytest.raises(il.InvalidInput, match="Observable needs formula"):
        il.Observable("w", units="W")
    with pytest.raises(il.InvalidInput, match="Observable needs units"):
        il.Observable("w", work_rate, per="contact")
    with pytest.raises(il.InvalidInput, match="'w' needs units"):
        il.Observable("w", work_rate, per="contact", units="")
    with pytest.raises(il.InvalidInput, match="per: did you mean 'contact'"):
        il.Observable("w", work_rate, per="contacts", units="W")
    with pytest.raises(il.InvalidInput, match="takes 'speed'; allowed are 'indentation'"):
        il.simulate(base(), 10.0, record=il.Observable("w", wrong, units="W"), rng=1)
    with pytest.raises(il.InvalidInput, match="a statement without a result"):
        il.Observable("w", printing, per="oscillator", units="m")
    with pytest.raises(il.InvalidInput, match="a function of scalars"):
        il.Observable("w", 3.0, units="m")
    with pytest.raises(il.InvalidInput, match="plain functions"):
        il.Observable("w", "import os", units="m")
    with pytest.raises(il.InvalidInput, match=r"'w' is inf at the oscillator 'a' of realization \d+ at t ="):
        il.simulate(
            linear(), 60.0, realizations=64, rng=1, record=il.Observable("w", infinite, per="oscillator", units="1")
        )
    none = il.Network({"a": il.LinearOscillator(damping=1.0, stiffness=1.0)}, excitations={"a": il.WhiteNoise(1.0)})
    with pytest.raises(il.InvalidInput, match="looks at no contact"):
        il.simulate(none, 10.0, record=il.Observable("w", work_rate, units="W"), rng=1)
