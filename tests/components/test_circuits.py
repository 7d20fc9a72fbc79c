"""Equations without masses: actuators with a lag, circuits that several bodies share, and driven ones."""

import functools
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import solve_continuous_lyapunov

import impactlab as il


def lagged(value, before, after, part):
    """What follows a linear input with a lag, some part of the lag later."""
    left = math.exp(-part)
    mean = -math.expm1(-part) / part
    return left * value + (mean - left) * before + (1.0 - mean) * after


class Actuator(il.CouplingLaw):
    """Force that follows ``gain e`` with a lag."""

    gain: float = il.parameter(units="N m-1")
    lag: float = il.parameter(units="s", above=0.0)
    pull: float = il.state(0.0, units="N")
    last: float = il.state(0.0, units="m")

    @staticmethod
    def force(extension, pull):
        return pull

    @staticmethod
    def update(extension, elapsed, pull, last, gain, lag):
        if elapsed > 0.0:
            pull = lagged(pull, gain * last, gain * extension, elapsed / lag)
        return pull, extension


class DrivenCoil(il.CouplingLaw):
    """Moving coil of a circuit with a source: ``L i' + R i = θ e' + U cos(ω t)``, force ``θ i``."""

    transduction: float = il.parameter(units="N A-1")
    inductance: float = il.parameter(units="H", above=0.0)
    resistance: float = il.parameter(units="Ohm", above=0.0)
    voltage: float = il.parameter(units="V")
    frequency: float = il.parameter(units="rad s-1")
    current: float = il.state(0.0, units="A")
    last: float = il.state(0.0, units="m")

    @staticmethod
    def force(extension, transduction, current):
        return transduction * current

    @staticmethod
    def update(
        extension, elapsed, time, current, last, transduction, inductance, resistance, voltage, frequency
    ):  # fmt: skip
        if elapsed > 0.0:
            induced = transduction * (extension - last) / elapsed
            before = (induced + voltage * math.cos(frequency * (time - elapsed))) / resistance
            after = (induced + voltage * math.cos(frequency * time)) / resistance
            current = lagged(current, before, after, elapsed * resistance / inductance)
        return current, extension


BODY = il.LinearOscillator(mass=1.5, damping=0.2, stiffness=60.0)
SHARED = il.Combination({"first": 1.0, "second": -0.6})
NETWORK = il.Network(
    dict.fromkeys(["arm", "first", "second", "coil", "beam"], BODY)
    | {"charge": il.LinearOscillator(mass=0.4, damping=1.2)},  # an inductance and a resistance
    couplings={
        "actuator": il.Coupling(il.WALL, "arm", Actuator(25.0, lag=0.15)),
        "capacitor": il.Coupling(il.WALL, SHARED, il.PiezoelectricCoupling(3.0, capacitance=0.2, resistance=2.0)),
        "circuit": il.Coupling(
            il.WALL, "coil", DrivenCoil(2.0, inductance=0.3, resistance=1.5, voltage=4.0, frequency=9.0)
        ),
        "piezo": il.Coupling(il.Combination({"charge": 1.0, "beam": -3.0}), il.WALL, il.LinearCoupling(1.0 / 0.2)),
    },
)
START = {"arm": 0.1, "first": 0.2, "second": -0.1, "coil": 0.05, "beam": 0.1}
END = 2.0


@functools.cache
def found():
    options = {"step": 2e-4, "initial": {"displacement": START}, "integrator": il.ExactFlow(measured=False)}
    return il.simulate(NETWORK, END, record=il.Trajectory(END), **options).isel(time=-1, realization=0)


def exact(right_side, start):
    return solve_ivp(right_side, (0.0, END), start, "DOP853", rtol=1e-11, atol=1e-13).y[:, -1]


def pulled(x, v, force):
    return (force - 60.0 * x - 0.2 * v) / 1.5


def of_bodies(*names):
    return np.array(
        [found()[quantity].sel(oscillator=list(names)) for quantity in ("displacement", "velocity")]
    ).ravel()


@pytest.mark.full
def test_an_actuator_with_a_lag():
    x, v, pull = exact(lambda t, y: [y[1], pulled(y[0], y[1], -y[2]), (25.0 * y[0] - y[2]) / 0.15], [0.1, 0.0, 0.0])
    np.testing.assert_allclose(of_bodies("arm"), [x, v], atol=1e-6)
    assert float(found().law_state.sel(state="actuator.pull")) == pytest.approx(pull, abs=1e-5)


@pytest.mark.full
def test_a_circuit_that_two_bodies_share():
    """``C V' + V/R = Σ θ x'`` with the force −θ V on each, as a law along the weighted sum.

    It goes to the first displacements at once, for which the capacitor is charged.
    """

    def right_side(t, y):
        x1, x2, v1, v2, voltage = y
        change = (3.0 * v1 - 1.8 * v2 - voltage / 2.0) / 0.2
        return [v1, v2, pulled(x1, v1, -3.0 * voltage), pulled(x2, v2, 1.8 * voltage), change]

    end = exact(right_side, [0.2, -0.1, 0.0, 0.0, 3.0 * (0.2 + 0.6 * 0.1) / 0.2])
    np.testing.assert_allclose(of_bodies("first", "second"), end[:4], atol=1e-6)


@pytest.mark.full
def test_a_circuit_with_a_source():
    def right_side(t, y):
        return [y[1], pulled(y[0], y[1], -2.0 * y[2]), (2.0 * y[1] + 4.0 * math.cos(9.0 * t) - 1.5 * y[2]) / 0.3]

    np.testing.assert_allclose(of_bodies("coil"), exact(right_side, [0.05, 0.0, 0.0])[:2], atol=1e-6)


@pytest.mark.full
def test_a_charge_is_a_coordinate():
    """With an inductance it has a mass: ``L q'' + R q' + (q − θ x)/C = 0``, and ``θ (q − θ x)/C`` pulls the body."""

    def right_side(t, y):
        q, x, dq, v = y
        voltage = (q - 3.0 * x) / 0.2
        return [dq, v, (-voltage - 1.2 * dq) / 0.4, pulled(x, v, 3.0 * voltage)]

    end = exact(right_side, [0.0, 0.1, 0.0, 0.0])
    np.testing.assert_allclose(of_bodies("charge", "beam"), end, atol=1e-6)


def test_thermal_noise_of_a_resistor():
    """Of the spectral density ``R T/π`` it gives the charge, and the body, the temperature T: (q − 3x)²/C = T."""
    temperature = 0.01
    noises = {
        "charge": il.WhiteNoise(1.2 * temperature / math.pi), "beam": il.WhiteNoise(0.2 * temperature / math.pi)
    }  # fmt: skip
    bodies = {name: NETWORK.oscillators[name] for name in ("charge", "beam")}
    network = il.Network(bodies, {}, noises, {"piezo": NETWORK.couplings["piezo"]})
    law = il.exact(network)
    square = sum(
        one * other * law.covariance(first, second, "displacement")
        for first, one in (("charge", 1.0), ("beam", -3.0))
        for second, other in (("charge", 1.0), ("beam", -3.0))
    )
    assert square / 0.2 == pytest.approx(temperature, rel=1e-9)


HERTZ = il.HertzContact(2e4)
LOAD = il.Harmonic(3.0, frequency=4.0)


def hit(node, coupling, noises, body=BODY):
    """A body with a stop that is coupled to a node."""
    contact = il.Contact("body", il.WALL, HERTZ, clearance=0.03)
    return il.Network({"body": body, "node": node}, {"stop": contact}, noises, {"coupling": coupling})


def paths(network, step, end=5.0):
    options = {"step": step, "initial": {}, "integrator": il.ExactFlow(measured=False), "record": il.Trajectory(0.05)}
    path = il.simulate(network, end, **options).isel(realization=0)
    return path.time.values, *(path.displacement.sel(oscillator=name).values for name in ("body", "node"))


def solved(right_side, times, rows):
    found = solve_ivp(
        right_side, (0.0, times[-1]), [0.0] * 3, "DOP853", t_eval=times, rtol=1e-11, atol=1e-13, max_step=2e-3
    )
    return found.y[rows]


def stopped(x, v, force):
    return pulled(x, v, force - HERTZ.stiffness * max(x - 0.03, 0.0) ** 1.5)


@pytest.mark.full
def test_a_charge_without_inductance_behind_a_body_that_hits_a_stop():
    """``C V' + V/R = θ x'`` with the force −θ V on the body: C V = θ x − q, and R q' = V."""
    theta, capacity, resistance = 0.5, 0.02, 10.0
    weighted = il.Combination({"body": theta, "node": -1.0})
    patch = il.Coupling(weighted, il.WALL, il.LinearCoupling(1.0 / capacity))
    network = hit(il.LinearOscillator.massless(resistance), patch, {"body": LOAD})
    phase = LOAD.call("force", 0.0) / LOAD.amplitude

    def right_side(t, y):
        load = 3.0 * (math.cos(4.0 * t) if phase > 0.5 else math.sin(4.0 * t))
        return [y[1], stopped(y[0], y[1], load - theta * y[2]), (theta * y[1] - y[2] / resistance) / capacity]

    errors = []
    for step in (2.5e-4, 1.25e-4):
        times, body, charge = paths(network, step)
        x, voltage = solved(right_side, times, [0, 2])
        np.testing.assert_allclose(body, x, atol=1e-6)
        np.testing.assert_allclose((theta * body - charge) / capacity, voltage, atol=5e-5)
        errors.append(np.abs(body - x).max())
    assert errors[1] < 0.35 * errors[0]  # of second order


@pytest.mark.full
def test_an_actuator_that_a_force_drives_with_a_lag():
    """``c u' + k u = f − s (u − x)``, beside a body that hits a stop."""
    network = hit(
        il.LinearOscillator.massless(6.0, 20.0), il.Coupling("node", "body", il.LinearCoupling(50.0)), {"node": LOAD}
    )
    phase = LOAD.call("force", 0.0) / LOAD.amplitude

    def right_side(t, y):
        load, force = 3.0 * (math.cos(4.0 * t) if phase > 0.5 else math.sin(4.0 * t)), 50.0 * (y[2] - y[0])
        return [y[1], stopped(y[0], y[1], force), (load - 20.0 * y[2] - force) / 6.0]

    times, body, node = paths(network, 2.5e-4)
    x, u = solved(right_side, times, [0, 2])
    np.testing.assert_allclose(body, x, atol=1e-6)
    np.testing.assert_allclose(node, u, atol=1e-6)


@pytest.mark.full
def test_a_node_without_mass_between_a_spring_and_a_damper_is_a_maxwell_element():
    node, spring = il.LinearOscillator.massless(3.0), il.Coupling("body", "node", il.LinearCoupling(60.0))
    of_node = hit(node, spring, {"body": LOAD})
    element = il.Coupling("body", il.WALL, il.MaxwellCoupling(60.0, damping=3.0))
    of_law = of_node.replace(couplings={"coupling": element})
    _, body, _ = paths(of_node, 2.5e-4)
    _, other, _ = paths(of_law, 2.5e-4)
    np.testing.assert_allclose(body, other, atol=1e-6)


def test_thermal_noise_on_nodes_without_mass():
    """Of a resistor beside a capacitor, and of a node between bodies, by Lyapunov's equation."""
    alone = il.Network({"charge": il.LinearOscillator.massless(2.0, 5.0)}, {}, {"charge": il.WhiteNoise(0.3)})
    assert il.exact(alone).statistics().mean_square_displacement.item() == pytest.approx(math.pi * 0.3 / 10.0, rel=1e-9)
    bodies = {"one": BODY, "node": il.LinearOscillator.massless(0.6, 2.0), "two": BODY}
    noises = {"one": il.WhiteNoise(0.5), "node": il.WhiteNoise(0.3), "two": il.WhiteNoise(0.1)}
    springs = {name: il.Coupling(name, "node", il.LinearCoupling(30.0)) for name in ("one", "two")}
    network = il.Network(bodies, {}, noises, springs)
    drift = np.array(
        [  # of x1, v1, u, x2, v2
            [0.0, 1.0, 0.0, 0.0, 0.0],
            [-60.0, -0.2 / 1.5, 20.0, 0.0, 0.0],
            [50.0, 0.0, -62.0 / 0.6, 50.0, 0.0],
            [0.0, 0.0, 0.0, 0.0, 1.0],
            [0.0, 0.0, 20.0, -60.0, -0.2 / 1.5],
        ]
    )
    diffusion = 2.0 * math.pi * np.diag([0.0, 0.5 / 1.5**2, 0.3 / 0.6**2, 0.0, 0.1 / 1.5**2])
    exact = np.diag(solve_continuous_lyapunov(drift, -diffusion))[[0, 2, 3]]
    np.testing.assert_allclose(il.exact(network).statistics().mean_square_displacement, exact, rtol=1e-7)


@pytest.mark.campaign
def test_statistics_beside_a_node_under_noise_that_a_contact_feels():
    noises = {"body": il.WhiteNoise(0.2 * 0.5 / math.pi), "node": il.WhiteNoise(0.6 * 0.5 / math.pi)}
    spring = il.Coupling("node", "body", il.LinearCoupling(20.0))
    network = hit(il.LinearOscillator.massless(0.6, 2.0), spring, noises)
    result = il.simulate(network, 500.0, realizations=256, rng=1)
    assert result.attrs["step"] > 1e-3
    table = il.compare(result, il.exact(network)).to_dataframe()
    assert (table.z.abs() < 4.0).all()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"damping": 0.0}, "needs a positive damping, not 0.0"),
        ({"damping": 1.0, "lag": 0.0}, "needs a positive lag, such as 1e-09"),
        ({"damping": math.nan}, "damping"),
    ],
)
def test_equations_of_first_order_need_friction(options, message):
    with pytest.raises(il.InvalidInput, match=message):
        il.LinearOscillator.massless(**options)


WEIGHTED = il.Combination({"body": 0.5, "node": -1.0})
ROUND = il.RoundContact(("body", "node"), il.WALL, il.LinearContact(1e3), clearance=0.1)


@pytest.mark.parametrize(
    ("link", "law"),
    [
        (il.Contact("node", il.WALL, il.LinearContact(1e3), clearance=0.1), "LinearContact"),
        (il.Contact("body", WEIGHTED, il.RigidContact(0.7)), "RigidContact"),
        (ROUND, "LinearContact"),
        (il.Coupling("node", "body", il.CubicCoupling(1e3)), "CubicCoupling"),
        (il.Coupling(WEIGHTED, il.WALL, il.BoucWenCoupling(1e3, yield_displacement=0.01)), "BoucWenCoupling"),
        (il.Coupling("body", "node", il.CoulombFrictionCoupling(0.1)), "CoulombFrictionCoupling"),
        (il.Coupling("node", il.WALL, il.MaxwellCoupling(10.0, damping=1.0)), "MaxwellCoupling"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_is_not_linear_acts_on_bodies_with_mass(link, law):
    family = "couplings" if isinstance(link, il.Coupling) else "contacts"
    bodies = {"body": BODY, "node": il.LinearOscillator.massless(6.0, 20.0)}
    spring = {"spring": il.Coupling("node", "body", il.LinearCoupling(50.0))}
    network = il.Network(bodies, couplings=spring)
    message = f"{type(link).__name__} 'link' with {law} acts on 'node', which has no mass"
    for started in (network, il.Network.from_toml(network.to_toml()), il.Network.from_dict(network.to_dict())):
        with pytest.raises(il.InvalidInput, match=message):
            started.replace(**{family: {"link": link}})
    light = il.LinearOscillator(mass=6e-9, damping=6.0, stiffness=20.0)
    assert network.replace(**{family: {"link": link}}, oscillators={"node": light}).oscillators["node"] == light
