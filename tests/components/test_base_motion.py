"""Motions of the ground: what they are for bodies and structures, and buildings that pound in an earthquake."""

import json

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import impactlab as il

RECORD = il.SampledForce([0.0, 0.5, 2.0], [0.0, 3.0, -1.0], after="zero")
BALL = il.LinearOscillator(mass=0.5)
LUMPED = il.LinearStructure([2.0, 3.0], np.zeros((2, 2)), [[50.0, -20.0], [-20.0, 20.0]], names=["low", "high"])
FULL = il.LinearStructure(
    [[2.0, 0.5], [0.5, 3.0]], np.zeros((2, 2)), [[50.0, -20.0], [-20.0, 20.0]], names=["u", "turn"]
)
MODAL = il.ModalStructure([6.0], 0.02, points={"tip": [1.0]})


def shaken(motion, **oscillators):
    return il.Network(oscillators, {}, {"ground": motion})


def test_forces_on_bodies_and_coordinates():
    network = shaken(il.BaseMotion(RECORD), ball=BALL, tower=LUMPED)
    assert network.sources["ground"] == il.Source(RECORD, on={"ball": -0.5, "tower.low": -2.0, "tower.high": -3.0})
    for on in ("ball", ["ball"], ("tower.high", "ball"), ["tower"]):
        some = shaken(il.BaseMotion(RECORD, on=on), ball=BALL, tower=LUMPED).sources["ground"].on
        named = [on] if isinstance(on, str) else list(on)
        assert set(some) == {"tower.low", "tower.high"} if named == ["tower"] else set(named)
    heavier = network.replace(oscillators={"ball": BALL.replace(mass=0.75)})
    assert heavier.sources["ground"].on["ball"] == -0.75


def test_a_full_mass_matrix():
    """The forces at the coordinates are −M ι, of which the modes get Φᵀ, with 0 for a rotation that does not follow."""
    for on, influence in (((), [1.0, 1.0]), (("slab.u",), [1.0, 0.0])):
        network = shaken(il.BaseMotion(RECORD, on=on), slab=FULL)
        shapes = np.array([list(network.points[f"slab.{name}"].values()) for name in ("u", "turn")])
        expected = -shapes.T @ np.array(FULL.mass) @ influence
        np.testing.assert_allclose(list(network.sources["ground"].on.values()), expected, rtol=1e-12)


def test_factors_of_the_acceleration():
    """That of a coordinate goes before that of its structure; modes get −Φᵀ M ι with factors in ι."""
    motion = il.BaseMotion(RECORD, on={"ball": -2.0, "tower": 0.5, "tower.high": 3.0})
    on = shaken(motion, ball=BALL, tower=LUMPED, other=BALL).sources["ground"].on
    assert on == {"ball": 1.0, "tower.low": -1.0, "tower.high": -9.0}
    network = shaken(il.BaseMotion(RECORD, on={"slab.u": 0.5, "slab.turn": -2.0}), slab=FULL)
    shapes = np.array([list(network.points[f"slab.{name}"].values()) for name in ("u", "turn")])
    expected = -shapes.T @ np.array(FULL.mass) @ [0.5, -2.0]
    np.testing.assert_allclose(list(network.sources["ground"].on.values()), expected, rtol=1e-12)
    for points in ({}, {"tip": [1.0]}):
        pole = il.ModalStructure([6.0], 0.02, points=points, participation=[2.0])
        assert shaken(il.BaseMotion(RECORD, on={"pole": 0.5}), pole=pole).sources["ground"].on == {"pole.1": -1.0}
        assert shaken(il.BaseMotion(RECORD), pole=pole).sources["ground"].on == {"pole.1": -2.0}


@pytest.mark.parametrize("on", [["tower"], {"tower": 0.5, "tower.low": 2.0}])
def test_copies(on):
    network = shaken(il.BaseMotion(RECORD, on=on), ball=BALL, tower=LUMPED)
    assert il.Network.from_toml(network.to_toml()) == network
    assert il.Network.from_dict(json.loads(json.dumps(network.to_dict()))) == network
    assert "BaseMotion(SampledForce" not in repr(network)
    assert "ground: BaseMotion(acceleration=SampledForce(" in repr(network)


def test_gravity():
    """A body falls, whatever its mass."""
    network = shaken(il.BaseMotion(il.ConstantForce(9.80665)), light=BALL, heavy=il.LinearOscillator(mass=30.0))
    path = il.simulate(network, 1.0, initial={"displacement": {"heavy": 0.1}}, step=0.1, record=il.Trajectory(0.1))
    falling = -0.5 * 9.80665 * path.time.values**2
    np.testing.assert_allclose(path.displacement[0], np.stack([falling, 0.1 + falling], axis=1), atol=1e-12)


def test_a_structure_on_a_heavy_soil_feels_the_noise_of_kanai_and_tajimi():
    """Variances of its displacement beside the soil, and of the soil's acceleration, by integrals of the spectrum."""
    soil = il.LinearOscillator.from_frequency(15.0, 0.6, mass=1e7)
    network = il.Network(
        {"soil": soil, "house": il.LinearOscillator()},
        {},
        {"rock": il.BaseMotion(il.WhiteNoise(1.0))},
        {"column": il.Coupling("soil", "house", il.LinearCoupling(4.0 * np.pi**2, damping=0.2 * np.pi))},
    )
    law = il.exact(network)
    beside = sum(
        sign * law.covariance(one, other, "displacement")
        for one, other, sign in (("soil", "soil", 1), ("soil", "house", -2), ("house", "house", 1))
    )
    of_soil = [law.covariance("soil", "soil", quantity) for quantity in ("displacement", "velocity")]
    acceleration = 15.0**4 * of_soil[0] + 18.0**2 * of_soil[1]
    frequency = np.linspace(0.0, 4000.0, 400_001)
    filtered = (15.0**4 + (18.0 * frequency) ** 2) / ((225.0 - frequency**2) ** 2 + (18.0 * frequency) ** 2)
    response = 1.0 / (((2.0 * np.pi) ** 2 - frequency**2) ** 2 + (0.2 * np.pi * frequency) ** 2)
    tail = 2.0 * 18.0**2 / 4000.0
    assert acceleration == pytest.approx(2.0 * np.trapezoid(filtered, frequency) + tail, rel=1e-6)
    assert beside == pytest.approx(2.0 * np.trapezoid(filtered * response, frequency), rel=1e-6)
    assert (acceleration, beside) == (pytest.approx(95.81858, rel=1e-6), pytest.approx(0.1682484, rel=1e-6))


@pytest.mark.parametrize(
    ("motion", "message"),
    [
        (
            il.BaseMotion(RECORD, on="bal"),
            r"BaseMotion 'ground' drives 'bal', which is not in the network; did you mean",
        ),
        (il.BaseMotion(RECORD, on=["beam.1"]), r"BaseMotion 'ground' drives 'beam.1', which is not in the network"),
        (il.BaseMotion(RECORD), r"'ground' cannot move 'beam': a ModalStructure knows by which forces"),
        (il.BaseMotion(RECORD, on=["beam.tip"]), r"'ground' cannot move 'beam': a ModalStructure knows by which"),
    ],
)
def test_bad_motion(motion, message):
    with pytest.raises(il.InvalidInput, match=message):
        shaken(motion, ball=BALL, beam=MODAL)
    assert shaken(il.BaseMotion(RECORD, on="ball"), ball=BALL, beam=MODAL).sources["ground"].on == {"ball": -0.5}


def test_bad_fields():
    with pytest.raises(il.InvalidInput, match=r"BaseMotion.acceleration must be an excitation such as il.SampledForce"):
        il.BaseMotion([0.0, 1.0])
    with pytest.raises(il.InvalidInput, match=r"BaseMotion.on must be names of bodies, not 3"):
        il.BaseMotion(RECORD, on=3)
    with pytest.raises(il.InvalidInput, match=r"BaseMotion.on: the weight of 'a' is 0; leave it out"):
        il.BaseMotion(RECORD, on={"a": 0.0})
    with pytest.raises(il.InvalidInput, match=r"BaseMotion.on is empty, so that it drives nothing"):
        il.BaseMotion(RECORD, on={})
    with pytest.raises(il.InvalidInput, match=r"The source 'ball' has the name of a body"):
        il.Network({"ball": BALL}, {}, {"ball": il.BaseMotion(RECORD)})


def of_storeys(mass, stiffness):
    matrix = stiffness * (2.0 * np.eye(5) - np.eye(5, k=1) - np.eye(5, k=-1))
    matrix[-1, -1] = stiffness
    return il.LinearStructure.from_damping_ratio(np.full(5, mass), matrix, 0.05)


@pytest.mark.campaign
def test_two_buildings_that_pound_in_an_earthquake():
    """Peaks of displacements and contact forces, against a solver of ordinary differential equations."""
    left, right = of_storeys(2.0e4, 1.0e7), of_storeys(1.5e4, 2.4e7)
    times, rng = 0.005 * np.arange(1560), np.random.default_rng(11)
    accelerations = (
        9.0 * np.exp(-(((times - 3.0) / 2.0) ** 2)) * np.convolve(rng.normal(size=1560), np.full(20, 0.1), "same")
    )
    law, clearance = il.LinearContact(5e7), 0.01
    contacts = {f"floor {k}": il.Contact(f"left.{k}", f"right.{k}", law, clearance=clearance) for k in range(1, 6)}
    ground = il.BaseMotion(il.SampledForce(times, accelerations))
    network = il.Network({"left": left, "right": right}, contacts, {"ground": ground})
    duration = float(times[-1])
    data = il.simulate(network, duration, step=duration / 31180, initial={}, record=il.Trajectory(duration / 15590))

    drift = np.zeros((20, 20))  # of y = (x, v)
    drift[:10, 10:] = np.eye(10)
    for part, (building, mass) in zip((slice(0, 5), slice(5, 10)), ((left, 2.0e4), (right, 1.5e4)), strict=True):
        rows = slice(part.start + 10, part.stop + 10)
        drift[rows, part], drift[rows, rows] = -np.array(building.stiffness) / mass, -np.array(building.damping) / mass

    def push(x):
        return 5e7 * np.maximum(x[:5] - x[5:10] - clearance, 0.0)

    def slope(time, y):
        result, force = drift @ y, push(y)
        result[10:] -= np.interp(time, times, accelerations)
        result[10:15] -= force / 2.0e4
        result[15:] += force / 1.5e4
        return result

    path = solve_ivp(
        slope, (0.0, duration), np.zeros(20), method="LSODA", rtol=1e-9, atol=1e-12, max_step=0.005, t_eval=data.time
    ).y[:10]
    np.testing.assert_allclose(np.abs(data.displacement[0]).max("time"), np.abs(path).max(axis=1), rtol=1e-4)
    np.testing.assert_allclose(data.contact_force[0].max("time"), push(path).max(axis=1), rtol=1e-4)
    assert (data.contact_rate * duration > 3.0).all()
