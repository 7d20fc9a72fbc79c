"""Coordinates without mass against their elimination: springs and dampers between bodies, one Maxwell element.

With springs K in all, dampers C in all, and the means u and w of the displacements on their far ends, weighted by
stiffness and by damping, the node x of ``C (x − w)' + K (x − u) = f`` acts on ``u − w`` as a Maxwell element of K and C
and, with the lag ``C/K``, as f; springs and dampers act between the far ends as well (star to mesh).
"""

import itertools
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import impactlab as il


def mesh(shares):
    """What springs or dampers to a node are between their far ends, of which "" is the ground."""
    total = sum(shares.values())
    return {pair: shares[pair[0]] * shares[pair[1]] / total for pair in itertools.combinations(shares, 2)}


def along(springs, dampers):
    """Weights of ``u − w``."""
    weights = {
        name: springs.get(name, 0.0) / sum(springs.values()) - dampers.get(name, 0.0) / sum(dampers.values())
        for name in {**springs, **dampers}
        if name
    }
    return {name: weight for name, weight in weights.items() if weight}


def side(name):
    return name or il.WALL


def node(springs, dampers, pull=0.0):
    """Couplings that are a node with springs and dampers, by the name of the body at their far end."""
    stiffness, damping = sum(springs.values()), sum(dampers.values())
    stiff, damped = mesh(springs), mesh(dampers)
    couplings = {
        f"mesh {one}{other}": il.Coupling(
            side(one),
            side(other),
            il.LinearCoupling(stiff.get((one, other), 0.0), damping=damped.get((one, other), 0.0)),
        )
        for one, other in {**stiff, **damped}
    }
    law = il.MaxwellCoupling(stiffness, damping=damping, pull=pull)
    return couplings | {"node": il.Coupling(il.WALL, il.Combination(along(springs, dampers)), law)}


BODIES = {
    "a": il.LinearOscillator(mass=1.0, damping=0.2, stiffness=30.0),
    "b": il.LinearOscillator(mass=1.5, damping=0.3, stiffness=20.0),
    "c": il.LinearOscillator(mass=0.7, damping=0.1, stiffness=50.0),
}
SPRINGS = {"a": 8.0, "b": 12.0, "c": 5.0, "": 3.0}
DAMPERS = {"a": 1.5, "": 2.0}
HARD = 2000.0
GAP = 0.05


def full(springs, dampers, bodies, hard=0.0):
    """The right-hand side with the node as a coordinate of its own: displacements, velocities, node."""
    names, count = list(bodies), len(bodies)
    mass, c, k = np.array([(body.mass, body.damping, body.stiffness) for body in bodies.values()]).T
    k_node, c_node = (np.array([part.get(name, 0.0) for name in names]) for part in (springs, dampers))

    def right_side(t, y):
        x, v, own = y[:count], y[count : 2 * count], y[-1]
        change = (k_node @ x - sum(springs.values()) * own + c_node @ v) / sum(dampers.values())
        force = -k * x - c * v + k_node * (own - x) + c_node * (change - v)
        if hard:
            force[0] -= hard * max(x[0] - x[1] - GAP, 0.0)
            force[1] += hard * max(x[0] - x[1] - GAP, 0.0)
        return np.concatenate([v, force / mass, [change]])

    return right_side


def path_of(network, start, step=2e-4, end=1.0):
    options = {"step": step, "initial": {"displacement": start}, "integrator": il.ExactFlow(measured=False)}
    return il.simulate(network, end, record=il.Trajectory(end), **options).isel(time=-1, realization=0)


def found_with(path, bodies):
    own = [path[name].sel(oscillator=list(bodies)) for name in ("displacement", "velocity")]
    return np.concatenate(own)


def exact(right_side, start, end=1.0):
    return solve_ivp(right_side, (0.0, end), start, "DOP853", rtol=1e-11, atol=1e-13).y[:, -1]


START = {"a": 0.2, "b": -0.1, "c": 0.05}


def at_rest(springs, dampers, start):
    """The node where the Maxwell element begins: ``x = w``."""
    return sum(dampers.get(name, 0.0) * place for name, place in start.items()) / sum(dampers.values())


def with_node(springs, dampers):
    """Couplings of a coordinate "node"; what connects it with the ground is its own."""
    names = [name for name in {**springs, **dampers} if name]
    laws = {name: il.LinearCoupling(springs.get(name, 0.0), damping=dampers.get(name, 0.0)) for name in names}
    own = il.LinearOscillator.massless(dampers[""], springs.get("", 0.0))
    return own, {f"to {name}": il.Coupling("node", name, law) for name, law in laws.items()}


CONTACT = {"stop": il.Contact("a", "b", il.LinearContact(HARD), clearance=GAP)}


@pytest.mark.full
def test_a_node_that_three_bodies_share_beside_a_contact():
    """As a coordinate of its own, and eliminated, against the equations with the node."""
    begin = at_rest(SPRINGS, DAMPERS, START)
    end = exact(full(SPRINGS, DAMPERS, BODIES, hard=HARD), [*START.values(), 0.0, 0.0, 0.0, begin])
    own, couplings = with_node(SPRINGS, DAMPERS)
    path = path_of(il.Network(BODIES | {"node": own}, CONTACT, {}, couplings), START | {"node": begin})
    np.testing.assert_allclose(found_with(path, BODIES), end[:-1], atol=2e-5)
    assert float(path.displacement.sel(oscillator="node")) == pytest.approx(end[-1], abs=2e-5)
    eliminated = path_of(il.Network(BODIES, CONTACT, {}, node(SPRINGS, DAMPERS)), START)
    np.testing.assert_allclose(found_with(eliminated, BODIES), end[:-1], atol=2e-5)


@pytest.mark.campaign
def test_thermal_noise_of_the_load_of_a_harvester_with_a_stop():
    """The motion has the law that it has without a circuit, at the temperature T, and the voltage the variance T/C."""
    temperature, transduction, capacitance, resistance = 0.5, 3.0, 0.2, 2.0
    body = il.LinearOscillator(mass=1.5, damping=0.2, stiffness=60.0)
    stop = {"stop": il.Contact("beam", il.WALL, il.LinearContact(600.0), clearance=0.05)}
    bare = il.Network({"beam": body}, stop, {"beam": il.WhiteNoise(0.2 * temperature / math.pi)})
    voltage = il.Combination({"beam": transduction, "charge": -1.0})
    network = bare.replace(
        oscillators={"charge": il.LinearOscillator.massless(resistance)},
        couplings={"patch": il.Coupling(voltage, il.WALL, il.LinearCoupling(1.0 / capacitance))},
        excitations={"charge": il.WhiteNoise(resistance * temperature / math.pi)},
    )
    law = il.exact(bare).statistics()
    options = {"step": 0.01, "spin_up": 20.0, "initial": "rest", "rng": 5}
    result = il.simulate(network, 100.0, realizations=96, record=il.Trajectory(20.0), **options)
    for name in ("mean_displacement", "mean_square_displacement", "mean_square_velocity"):
        value, error = (
            float(result[key].sel(oscillator="beam")) for key in (name, f"{name}_standard_error")
        )  # fmt: skip
        reference = float(law[name].item())
        assert error < 0.06 * abs(reference), name
        assert abs(value - reference) < 4.0 * error + 2e-3 * abs(reference), name
    beam, charge = (result.displacement.sel(oscillator=name).values[:, 1:] for name in ("beam", "charge"))
    squares = ((transduction * beam - charge) / capacitance) ** 2
    error = squares.mean(axis=1).std(ddof=1) / math.sqrt(96)
    assert abs(squares.mean() - temperature / capacitance) < 4.0 * error < 0.5 * temperature / capacitance
