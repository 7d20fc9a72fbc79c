"""Walls do not move, whatever the method."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import impactlab as il


@pytest.mark.parametrize(
    ("method", "step"), [(il.ExactFlow(), 1e-3), (il.RungeKutta4(), 1e-3), (il.EulerMaruyama(), 1e-5)]
)
def test_a_body_bounces_between_walls(method, step):
    """The path of a body that hits one wall and then the other is that of a solver of high order."""
    body = il.LinearOscillator(damping=0.5, stiffness=1.0)
    walls = {
        "upper": il.Contact("ball", il.WALL, il.LinearContact(400.0), clearance=0.1),
        "lower": il.Contact(il.WALL, "ball", il.LinearContact(400.0), clearance=0.1),
    }
    network = il.Network({"ball": body}, walls)
    start = {"velocity": {"ball": 1.0}}
    result = il.simulate(
        network, 0.8, step=step, integrator=method, initial=start, record=il.Trajectory(interval=0.01), rng=1
    )
    system = network.compile()
    exact = solve_ivp(
        system.rhs, (0.0, 0.8), system.state(**start), method="DOP853", t_eval=result.time, rtol=1e-10, atol=1e-12,
        max_step=0.01, events=system.contact_events,
    )  # fmt: skip
    assert [len(times) for times in exact.t_events] == [2, 2], "into both walls and out again"
    np.testing.assert_allclose(result.velocity.squeeze(), exact.y[1], atol=0.02)
    np.testing.assert_allclose(result.displacement.squeeze(), exact.y[0], atol=2e-3)
