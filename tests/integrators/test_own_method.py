"""A method of one's own: a tableau of three lines, and nothing else."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import impactlab as il
from impactlab.compiling.jit import compilations


class Heun(il.ExplicitIntegrator):
    order = 2.0
    nodes = (0.0, 1.0)
    weights = (0.5, 0.5)


def test_its_error_falls_with_the_square_of_the_step():
    body = il.DuffingOscillator(30.0, damping=0.4, stiffness=4.0)
    network, start = il.Network({"a": body}), {"displacement": {"a": 0.3}}
    compiled = il.CompiledNetwork(network)
    exact = solve_ivp(compiled.rhs, (0.0, 1.0), compiled.state(**start), method="DOP853", rtol=1e-12, atol=1e-12)

    def error(step, method):
        options = {"integrator": method, "initial": start, "record": il.Trajectory(interval=0.5), "step": step}
        return float(il.simulate(network, 1.0, **options)["displacement"].isel(time=-1).squeeze()) - exact.y[0, -1]

    error(0.01, il.RungeKutta4())
    before = compilations()
    coarse, fine = error(0.01, Heun()), error(0.005, Heun())
    assert compilations() == before  # the machine code is that of all explicit methods
    assert coarse / fine == pytest.approx(4.0, rel=0.1)
    assert Heun().stability_polynomial == (0.5, 1.0, 1.0)
    assert np.isfinite(coarse)
