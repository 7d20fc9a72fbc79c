"""Rows of one noise on several bodies: what they add up to in a step."""

import numpy as np
import pytest
from scipy.linalg import expm

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.linear.laws import MOST_TOGETHER
from impactlab.linear.transitions import van_loan

BODIES = {
    "a": il.LinearOscillator(mass=1.0, damping=0.4, stiffness=9.0),
    "b": il.LinearOscillator(mass=2.0, damping=1.2, stiffness=30.0),
    "c": il.LinearOscillator(mass=0.5, damping=0.1),
}
WEIGHTS = {"c": 3.0, "a": 1.0, "b": -2.0}
SOURCE = il.Source(il.WhiteNoise(0.7), on=WEIGHTS)
SPRING = il.Coupling("a", "b", il.LinearCoupling(500.0, damping=0.3))
FAR = il.Contact("a", "b", il.HertzContact(1e4), clearance=50.0)


def covariance(model, method, step):
    """What all rows add to the covariance of (x, v), (phase, 2 body, 2 body), and rows that several bodies share."""
    rows = method.noise(model, step)
    phases, count = len(rows.amplitude), len(model.bodies)
    streams = sorted(set(zip(rows.streams, rows.numbers.tolist(), strict=True)))
    columns = np.zeros((phases, 2 * count, len(streams)))
    for row, (body, *stream) in enumerate(zip(rows.bodies, rows.streams, rows.numbers.tolist(), strict=True)):
        columns[:, [body, count + body], streams.index(tuple(stream))] += rows.amplitude[:, row]
    return columns @ columns.swapaxes(1, 2)


def exact(drift, growth, step):
    """By Van Loan's block exponential, in short steps."""
    count, parts = len(drift), max(1, int(np.ceil(40.0 * step)))
    block = expm(step / parts * van_loan(drift, growth))
    flow = block[count:, count:].T
    one = flow @ block[:count, count:]
    result = np.zeros_like(one)
    for _ in range(parts):
        result = flow @ result @ flow.T + one
    return result


@pytest.mark.parametrize("step", [1e-3, 0.3, 20.0])
@pytest.mark.parametrize("couplings", [{}, {"s": SPRING}])
def test_linear_motion_is_exact_at_any_step(step, couplings):
    """Bodies alone and a stiff spring between two, one of them under its own noise as well."""
    network = il.Network(BODIES, None, {"wind": SOURCE, "b": il.WhiteNoise(0.2)}, couplings)
    model = Model.of(network, couplings)
    found = covariance(model, il.ExactFlow(), step)
    mass, damping = np.array([1.0, 2.0, 0.5]), np.diag([0.4, 1.2, 0.1])
    stiffness = np.diag([9.0, 30.0, 0.0])
    if couplings:  # the symmetric root of the body's own noise reaches both: only the noise of the source is compared
        between = np.array([[1.0, -1.0, 0.0], [-1.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
        damping, stiffness = damping + 0.3 * between, stiffness + 500.0 * between
        own = Model.of(network.replace(excitations={"wind": None}), couplings)
        found = found - covariance(own, il.ExactFlow(), step)
    weights = np.array([1.0, -2.0, 3.0])
    intensity = 0.7 * np.outer(weights, weights) + np.diag([0.0, 0.0 if couplings else 0.2, 0.0])
    drift = np.block([[np.zeros((3, 3)), np.eye(3)], [-stiffness / mass[:, None], -damping / mass[:, None]]])
    growth = np.zeros((6, 6))
    growth[3:, 3:] = 2.0 * np.pi * intensity / np.outer(mass, mass)
    expected = exact(drift, growth, step)
    scale = np.sqrt(np.diag(expected))
    for phase in found:
        np.testing.assert_allclose(phase / np.outer(scale, scale), expected / np.outer(scale, scale), atol=1e-9)


def test_bodies_with_contacts_take_one_normal_and_others_their_part_of_it():
    """The mean of the increments of a free body under the noise of a step is known from its integral, as W h/m."""
    model, step = Model.of(il.Network(BODIES, {"gap": FAR}, {"wind": SOURCE})), 0.01
    method = il.ExactFlow()
    found, flows = covariance(model, method, step), method.flows(model, step)
    rows = method.noise(model, step)
    assert rows.bodies[:3].tolist() == [0, 1, 2]
    assert rows.bodies[3:].tolist() == [2]
    assert rows.numbers.tolist() == [0, 0, 0, 1]
    for body in range(3):
        own = found[:, [body, 3 + body]][:, :, [body, 3 + body]]
        np.testing.assert_allclose(own, flows.covariance[:, body], rtol=1e-9, atol=1e-20)
    velocities = found[:, 3:, 3:] / (2.0 * np.pi * 0.7 * step)
    expected = np.outer([1.0, -1.0, 6.0], [1.0, -1.0, 6.0])  # weights by masses
    np.testing.assert_allclose(velocities, np.broadcast_to(expected, (2, 3, 3)), rtol=0.01)


def test_more_bodies_than_can_be_taken_together():
    bodies = {f"body_{index}": BODIES["a"] for index in range(MOST_TOGETHER + 1)}
    network = il.Network(bodies, None, {"ground": il.Source(il.WhiteNoise(1.0), on=dict.fromkeys(bodies, 1.0))})
    with pytest.raises(il.InvalidInput, match=r"One white noise moves 501 bodies .* the exact flow takes 500"):
        il.ExactFlow().noise(Model.of(network), 0.01)
