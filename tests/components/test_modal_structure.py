"""Structures given by modes and by full mass matrices: descriptions, points by name, and what they come to."""

import json
import pickle

import numpy as np
import pytest
from scipy.linalg import eigh

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.plotting.drawing import draw_network

LAW = il.HertzContact(1e4)
BEAM = il.ModalStructure([10.0, 60.0, 170.0], 0.02, points={"tip": [2.0, -2.0, 2.0], "mid": [0.7, 1.4, 0.0]})


def hermite(count, length=1.0):
    """Mass and stiffness of a clamped beam of unit bending stiffness and mass by length, in cubic elements."""
    h = length / count
    stiffness = np.array([[12.0, 6 * h, -12, 6 * h], [6 * h, 4 * h**2, -6 * h, 2 * h**2],
                          [-12, -6 * h, 12, -6 * h], [6 * h, 2 * h**2, -6 * h, 4 * h**2]]) / h**3  # fmt: skip
    mass = np.array([[156, 22 * h, 54, -13 * h], [22 * h, 4 * h**2, 13 * h, -3 * h**2],
                     [54, 13 * h, 156, -22 * h], [-13 * h, -3 * h**2, -22 * h, 4 * h**2]]) * h / 420.0  # fmt: skip
    whole = np.zeros((2, 2 * count + 2, 2 * count + 2))
    for element in range(count):
        place = slice(2 * element, 2 * element + 4)
        whole[:, place, place] += mass, stiffness
    return whole[:, 2:, 2:]


def hermite_names(count):
    """Names of its coordinates: deflections and slopes."""
    return [f"{kind}{node + 1}" for node in range(count) for kind in ("w", "slope")]


# descriptions


def test_modes_and_their_data():
    many = {f"p{number}": np.arange(7.0) for number in range(8)}
    shown = "ModalStructure of 7 modes with the points p0, p1, p2, p3, p4, p5 and 2 more"
    assert repr(il.ModalStructure(np.arange(1.0, 8.0), 0.0, points=many)) == shown
    assert il.ModalStructure(np.array([10, 60, 170]), [0.02] * 3, points={**BEAM.points}, mass=1) == BEAM
    assert hash(pickle.loads(pickle.dumps(BEAM))) == hash(BEAM)
    network = il.Network(
        {"beam": BEAM, "a": il.LinearOscillator(mass=3.0)},
        {"stop": il.Contact("beam.tip", il.WALL, LAW), "gap": il.Contact(il.Combination({"beam.mid": 0.5}), "a", LAW)},
        {"beam.tip": il.WhiteNoise(1.0), "wind": il.Source(il.WhiteNoise(2.0), on={"beam.mid": 2.0, "a": 1.0})},
        {"tie": il.Coupling("beam.tip", "beam.mid", il.LinearCoupling(3.0))},
    )
    data = json.loads(json.dumps(network.to_dict()))
    assert data["contacts"]["stop"]["first"] == "beam.tip"
    assert il.Network.from_dict(data) == network
    assert pickle.loads(pickle.dumps(network)) == network
    assert list(network.oscillators) == ["beam.1", "beam.2", "beam.3", "a"]
    body = network.oscillators["beam.2"]
    assert (body.mass, body.natural_frequency, body.damping_ratio) == (1.0, 60.0, pytest.approx(0.02))
    assert network.points == {
        "beam.tip": {"beam.1": 2.0, "beam.2": -2.0, "beam.3": 2.0},
        "beam.mid": {"beam.1": 0.7, "beam.2": 1.4},
    }


def test_drawing():
    network = il.Network(
        {"beam": BEAM}, {"stop": il.Contact("beam.tip", il.WALL, LAW)}, {"beam.tip": il.WhiteNoise(1.0)}
    )
    assert {"beam", "tip"} <= {text.get_text() for text in draw_network(network).axes[0].texts}


def test_points_are_weighted_sums_of_modes():
    network = il.Network(
        {"beam": BEAM, "a": il.LinearOscillator()},
        {"stop": il.Contact(il.Combination({"beam.mid": 0.5, "beam.1": 1.0}), "a", LAW)},
        {"beam.tip": il.WhiteNoise(3.0), "wind": il.Source(il.WhiteNoise(2.0), on={"beam.mid": 2.0, "a": 1.0})},
        {"tie": il.Coupling("beam.tip", "beam.mid", il.LinearCoupling(3.0))},
    )
    model, q = Model.of(network), np.array([1.0, 10.0, 100.0, 1000.0])
    tip, mid = np.array([2.0, -2.0, 2.0, 0.0]), np.array([0.7, 1.4, 0.0, 0.0])
    assert model.links.gap(q) == pytest.approx([0.5 * mid @ q + 1.0 - 1000.0, (tip - mid) @ q])
    wind = np.append(2.0 * mid[:3], 1.0)
    expected = 3.0 * np.outer(tip, tip) + 2.0 * np.outer(wind, wind)
    np.testing.assert_allclose(model.noise.matrix(np.arange(4)), expected, rtol=1e-14)
    assert set(model.sources["intensity"].names) == {"beam.tip", "wind"}


@pytest.mark.full
def test_modal_masses():
    """Shapes and masses of a mode may be scaled together."""
    other = BEAM.replace(mass=[4.0, 1.0, 0.25], points={"tip": [4.0, -2.0, 1.0]})
    paths = []
    for beam in (BEAM, other):
        network = il.Network({"beam": beam}, {"stop": il.Contact("beam.tip", il.WALL, LAW, clearance=0.01)})
        root = np.sqrt(beam.mass)
        compiled, velocity = network.compile(), np.array([1.0, 2.0, -1.0]) / root
        start = np.concatenate([0.05 / root, velocity])
        paths.append(compiled.rhs(0.0, start) * np.tile(root, 2))
    np.testing.assert_allclose(paths[0], paths[1], rtol=1e-13)


@pytest.mark.parametrize(
    ("arguments", "changes", "message"),
    [
        (([1.0, 0.0], 0.1), {}, r"must be larger than 0 rad s-1, but that of mode 2 is 0: a mode of frequency 0 has"),
        (([1.0, -3.0], 0.1), {}, r"natural_frequencies must be larger than 0 .* mode 2 is -3"),
        (([1.0, np.nan], 0.1), {}, r"natural_frequencies must be finite real numbers"),
        (([], 0.1), {}, r"natural_frequencies must be finite real numbers"),
        (("ab", 0.1), {}, r"natural_frequencies must be finite real numbers, .* not 'ab'"),
        (([1.0, 2.0], [0.1, -0.2]), {}, r"damping_ratios must be at least 0, but the lowest is -0.2"),
        (([1.0, 2.0], [0.1]), {}, r"damping_ratios must be 2 numbers, one for all modes or one for each, not 1"),
        (([1.0, 2.0], 0.1), {"mass": [1.0, 0.0]}, r"mass must be larger than 0 kg, but the smallest is 0"),
        (([1.0, 2.0], 0.1), {"points": {"a": [1.0]}}, r"points\['a'\] must be 2 numbers, one for each mode, not 1"),
        (([1.0, 2.0], 0.1), {"points": {"a": [1.0, 1j]}}, r"points\['a'\] must be finite real numbers, .* \[1.0, 1j"),
        (([1.0, 2.0], 0.1), {"points": {"a": [0.0, 0.0]}}, r"points: no mode moves 'a'; one number at least"),
        (([1.0, 2.0], 0.1), {"points": {"2": [1.0, 0.0]}}, r"points: '2' is the name of a mode; give the point anot"),
        (([1.0, 2.0], 0.1), {"points": {" ": [1.0, 0.0]}}, r"points: a name must be a non-empty string, not ' '"),
        (([1.0, 2.0], 0.1), {"points": [1.0, 2.0]}, r"points must be \{name: displacement in each mode\}, not \[1.0"),
    ],
)
def test_bad_modes(arguments, changes, message):
    with pytest.raises(il.InvalidInput, match=message):
        il.ModalStructure(*arguments, **changes)


BODY, SAME = il.LinearOscillator(), il.ModalStructure([1.0], 0.1, points={"a": [1.0], "b": [1.0]})


@pytest.mark.parametrize(
    ("members", "message"),
    [
        (
            ({"beam": BEAM}, {"c": il.Contact("beam", il.WALL, LAW)}),
            r"names a body 'beam' .*; name a coordinate or a point .*'beam.tip'",
        ),
        (({"beam": BEAM}, {"c": il.Contact("beam.top", il.WALL, LAW)}), r"'beam.top' .*; did you mean 'beam.tip'"),
        (({"beam": BEAM, "beam.tip": BODY},), r"'beam.tip' is the name of a body, and of a point of a structure"),
        (({"s": SAME}, {"c": il.Contact("s.a", "s.b", LAW)}), r"Contact 'c' of 's.a' with 's.b' acts on nothing"),
        (
            ({"s": SAME}, {"c": il.Contact(il.Combination({"s.a": 1.0, "s.b": -1.0}), il.WALL, LAW)}),
            r"Contact 'c' of .* acts on nothing",
        ),
        (
            ({"beam": BEAM}, {}, {"beam.tip": il.Source(il.WhiteNoise(1.0), on="beam.tip")}),
            r"source 'beam.tip' has the name of a body",
        ),
        (
            ({"s": SAME}, {}, {"w": il.Source(il.WhiteNoise(1.0), on={"s.a": 1.0, "s.b": -1.0})}),
            r"Source 'w' drives nothing: no weight is left of any body",
        ),
    ],
)
def test_bad_points_in_a_network(members, message):
    with pytest.raises(il.InvalidInput, match=message):
        il.Network(*members)


# from matrices


@pytest.mark.full
@pytest.mark.parametrize("proportional", [True, False])
def test_a_full_mass_matrix(proportional):
    """The motion is that of the matrices, also where modes do not diagonalise the damping."""
    mass, stiffness = hermite(3)
    damping = 0.3 * mass + 0.001 * stiffness
    if not proportional:
        damping[4, 4] += 2.0
    beam = il.LinearStructure(mass, damping, stiffness, names=hermite_names(3))
    network = il.Network(
        {"beam": beam},
        {"stop": il.Contact("beam.w3", il.WALL, il.LinearContact(50.0), clearance=0.01)},
        {"beam.w2": il.WhiteNoise(0.2)},
    )
    assert list(network.oscillators) == [f"beam.mode {number + 1}" for number in range(6)]
    assert bool(network.couplings) is not proportional
    model = Model.of(network)
    squares = eigh(stiffness, mass, eigvals_only=True)
    modal = np.diag(model.damping) + model.coupled.springs(model.couplings.linear[1])
    np.testing.assert_allclose(model.stiffness / model.mass, squares, rtol=1e-9)
    np.testing.assert_allclose(modal, modal.T)
    rng = np.random.default_rng(3)
    x, v = rng.normal(size=(2, 6)) * np.tile([0.1, 0.3], 3)
    names = [f"beam.{name}" for name in beam.names]
    state = network.compile().state(
        displacement=dict(zip(names, x.tolist(), strict=True)), velocity=dict(zip(names, v.tolist(), strict=True))
    )
    of_modes = np.array([[network.points[name].get(body, 0.0) for body in network.oscillators] for name in names])
    np.testing.assert_allclose(of_modes @ state[:6], x, rtol=1e-9, atol=1e-12)
    force = -stiffness @ x - damping @ v
    force[4] -= 50.0 * max(x[4] - 0.01, 0.0)
    expected = np.linalg.solve(mass, force)
    found = of_modes @ network.compile().rhs(0.0, state)[6:]
    np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-7 * np.abs(expected).max())
    forces = of_modes @ model.noise.matrix(np.arange(6)) @ of_modes.T
    unit = np.linalg.inv(mass)[:, 2]
    np.testing.assert_allclose(forces, 0.2 * np.outer(unit, unit), rtol=1e-7, atol=1e-7 * np.abs(forces).max())


def test_frequencies_of_a_cantilever():
    """Of cubic elements, against the roots of cos β cosh β = −1: too high by (β h)⁴/1440."""
    mass, stiffness = hermite(12)
    beam = il.LinearStructure.from_damping_ratio(mass, stiffness, 0.02, names=hermite_names(12))
    network = il.Network({"beam": beam})
    frequencies = np.sqrt(eigh(stiffness, mass, eigvals_only=True))
    bodies = list(network.oscillators.values())
    np.testing.assert_allclose([body.natural_frequency for body in bodies], frequencies, rtol=1e-9)
    np.testing.assert_allclose([body.damping_ratio for body in bodies], 0.02, rtol=1e-6)
    assert not network.couplings
    roots = np.array([1.8751040687, 4.6940911330, 7.8547574382])
    np.testing.assert_allclose(frequencies[:3] / roots**2 - 1.0, (roots / 12.0) ** 4 / 1440.0, rtol=0.05)
    modal = il.ModalStructure.from_matrices(mass, stiffness, 0.02, modes=3, points={"tip": 22})
    np.testing.assert_allclose(modal.natural_frequencies, frequencies[:3], rtol=1e-9)
    np.testing.assert_allclose(np.abs(modal.points["tip"]), 2.0, rtol=1e-3)
    with pytest.raises(il.InvalidInput, match=r"modes must be a whole number from 1 to 24, not 25"):
        il.ModalStructure.from_matrices(mass, stiffness, 0.02, modes=25, points={"tip": 22})
    with pytest.raises(il.InvalidInput, match=r"must be the number of a coordinate, from 0 to 23, not -1"):
        il.ModalStructure.from_matrices(mass, stiffness, 0.02, modes=3, points={"tip": -1})


def test_a_free_structure():
    """Rigid motions of matrices are free bodies."""
    mass = np.array([[2.0, 1.0], [1.0, 2.0]]) / 6.0
    rod = il.LinearStructure(mass, np.zeros((2, 2)), [[1.0, -1.0], [-1.0, 1.0]])
    bodies = il.Network({"rod": rod}).oscillators
    assert [body.stiffness for body in bodies.values()] == [0.0, pytest.approx(12.0)]


def test_a_free_structure_whose_damping_moves_with_its_stiffness():
    """Its rigid motion has no damping, not that of rounding."""
    mass = np.array([[2.0, 1.0, 0.0], [1.0, 4.0, 1.0], [0.0, 1.0, 2.0]]) / 6.0
    stiffness = np.array([[1.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
    rod = il.LinearStructure(mass, 0.07 * stiffness, stiffness)
    rigid, *others = il.Network({"rod": rod}).oscillators.values()
    assert (rigid.stiffness, rigid.damping) == (0.0, 0.0)
    for body in others:
        assert body.damping == pytest.approx(0.07 * body.stiffness, rel=1e-12)


def test_a_coordinate_that_a_mode_does_not_move_can_be_excited():
    """Two masses that a third couples only inertially: each of the modes leaves something at rest."""
    mass, stiffness = np.array([[1.0, 0.0, 0.0], [0.0, 2.0, 0.5], [0.0, 0.5, 1.0]]), np.diag([1.0, 3.0, 2.0])
    tower = il.LinearStructure(mass, 0.1 * stiffness, stiffness, names=("a", "b", "c"))
    network = il.Network({"tower": tower}, excitations={"tower.a": il.WhiteNoise(1.0)})
    source = network.compile().model.sources["intensity"]
    assert [*source.drives[1]] == [0]


def test_initial_displacements_that_do_not_follow():
    compiled = il.Network({"beam": BEAM}).compile()
    with pytest.raises(il.InvalidInput, match=r"displacements of the 3 bodies of 'beam' do not follow .* 'beam.1'"):
        compiled.state(displacement={"beam.tip": 1.0})


def test_initial_displacements_of_a_point_and_of_a_mode_are_not_added():
    network = il.Network({"one": il.ModalStructure([1.0], 0.1, points={"tip": [2.0]})})
    compiled = network.compile()
    np.testing.assert_allclose(compiled.state(displacement={"one.tip": 1.0}), [0.5, 0.0])
    with pytest.raises(il.InvalidInput, match=r"displacement is given of the point 'one.tip' and of 'one.1', which"):
        compiled.state(displacement={"one.tip": 1.0, "one.1": 0.5})
