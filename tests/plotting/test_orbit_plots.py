"""Plots of orbits and of their branches."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr

import impactlab as il


def stop(frequency=2.0, gap=0.0):
    return il.Network(
        oscillators={"a": il.LinearOscillator(damping=0.1, stiffness=1.0)},
        contacts={"stop": il.Contact("a", il.WALL, il.RigidContact(restitution=0.8), clearance=gap)},
        excitations={"a": il.Harmonic(1.0, frequency=frequency)},
    )


@pytest.fixture(scope="module")
def orbits():
    return il.orbits(stop())


@pytest.fixture(scope="module")
def branch(orbits):
    ends = xr.DataArray([1.2, 2.8], attrs={"units": "rad s-1"})
    return il.continue_orbits(lambda frequency: stop(frequency), orbits, {"frequency": ends}, points=50)


def test_a_branch_is_solid_where_it_is_stable(branch):
    axes = il.plot.branch(branch)
    solid, dashed = axes.lines[:2]
    assert np.isfinite(solid.get_ydata()).sum() >= branch["stable"].values.sum()
    assert np.isfinite(dashed.get_ydata()).sum() == (branch["stable"].values == 0).sum()
    assert axes.lines[2].get_label() == "flip"
    assert len(axes.lines[2].get_xdata()) == 2
    assert axes.get_xlabel() == "frequency (rad s$^{-1}$)"
    for quantity in ("velocity", "period", "energy_lost", "closing_velocity"):
        assert il.plot.branch(branch, "a" if quantity == "velocity" else None, quantity, ax=plt.figure().subplots())


def test_velocities_jump_at_impacts(orbits):
    """Straight up in the phase plane: the velocity after an impact is -0.8 times that before, at the stop."""
    x, v = il.plot.orbit(orbits, ax=plt.figure().subplots()).lines[0].get_xydata().T
    jump = int(np.abs(np.diff(v)).argmax())
    assert x[jump] == x[jump + 1] == pytest.approx(0.0, abs=1e-3)
    assert v[jump] == pytest.approx(orbits.closing_velocity.values[0, 0], rel=1e-3)
    assert v[jump + 1] == pytest.approx(-0.8 * v[jump], rel=2e-3)


def test_a_curve_is_drawn_over_both_parameters(orbits):
    curve = il.continue_orbits(
        stop, orbits, {"frequency": (1.5, 2.8)}, also={"gap": (-0.05, 0.05)}, bifurcation="flip", points=50
    )
    axes = il.plot.branch(curve, ax=plt.figure().subplots())
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("frequency", "gap")


def test_orbits_are_drawn_as_velocity_over_displacement(orbits):
    axes = il.plot.orbit(orbits, "a", ax=plt.figure().subplots())
    assert np.isin(orbits["path_displacement"].values[0, :, 0], axes.lines[0].get_xdata()).all()
    assert il.plot.orbit(orbits.isel(orbit=0), ax=plt.figure().subplots()).lines


def test_what_is_refused(orbits, branch):
    with pytest.raises(il.InvalidInput, match=r"what il\.continue_orbits returned"):
        il.plot.branch(orbits)
    with pytest.raises(il.InvalidInput, match="quantity"):
        il.plot.branch(branch, quantity="force")
    with pytest.raises(il.InvalidInput, match="no body 'b'"):
        il.plot.branch(branch, "b")
    with pytest.raises(il.InvalidInput, match="no body 'b'"):
        il.plot.orbit(orbits, "b")
