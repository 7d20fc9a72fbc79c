"""Structures given by their matrices: descriptions, and their motion and laws as bodies of a network."""

import json
import pickle

import numpy as np
import pytest
from scenes import deviations
from scipy import sparse
from scipy.integrate import quad, solve_ivp
from scipy.linalg import eigh, solve_continuous_lyapunov

import impactlab as il
from impactlab.assembly.model import Model

MASS = np.array([2.0, 1.9, 1.8, 1.7, 1.6])
STOREYS = np.array([400.0, 380.0, 350.0, 300.0, 260.0])
RATE = 0.2  # damping over mass


def shear(storeys=STOREYS):
    """Stiffness of a building of several storeys."""
    return np.diag(storeys + np.append(storeys[1:], 0.0)) - np.diag(storeys[1:], 1) - np.diag(storeys[1:], -1)


def cantilever(count=5, stiffness=1.0):
    """Stiffness of a clamped beam of length 1 m, by differences: positive beside the diagonal, too."""
    bend = np.diag(np.full(count, 1.0)) - 2.0 * np.diag(np.ones(count - 1), -1) + np.diag(np.ones(count - 2), -2)
    bend[0, 0] = np.sqrt(2.0)  # half the length and twice the bend at the clamp
    return bend.T @ bend * stiffness * count**3


TOWER = il.LinearStructure(MASS, RATE * np.diag(MASS), shear(), names=["1", "2", "3", "4", "roof"])
WARM = {f"tower.{name}": il.WhiteNoise(RATE * mass / np.pi) for name, mass in zip(TOWER.names, MASS, strict=True)}


# descriptions


def test_structure_and_its_data():
    again = il.LinearStructure(np.diag(MASS), sparse.diags_array(RATE * MASS), shear().tolist(), names=TOWER.names)
    assert again == TOWER
    assert hash(again) == hash(TOWER)
    assert pickle.loads(pickle.dumps(TOWER)) == TOWER
    assert il.LinearStructure(MASS, np.zeros((5, 5)), shear()).names == ("1", "2", "3", "4", "5")
    assert repr(il.LinearStructure(np.ones(9), np.zeros((9, 9)), np.eye(9))) == "LinearStructure of 9 coordinates"
    network = il.Network({"tower": TOWER}, {"stop": il.Contact("tower.roof", il.WALL, il.HertzContact(1e4))}, WARM)
    data = json.loads(json.dumps(network.to_dict()))
    assert data["oscillators"]["tower"]["type"] == "LinearStructure"
    assert data["couplings"] == {}
    assert il.Network.from_dict(data) == network
    assert pickle.loads(pickle.dumps(network)) == network
    assert list(network.oscillators) == ["tower.1", "tower.2", "tower.3", "tower.4", "tower.roof"]
    assert dict(network.structures) == {"tower": TOWER}
    assert network.replace(oscillators={"tower": TOWER.replace(mass=2.0 * MASS)}) != network


@pytest.mark.parametrize("stiffness", [shear(), cantilever(), np.diag([1.0, 0.0, 2.0, 0.0, 3.0]), np.ones((5, 5))])
def test_matrices_of_the_bodies_in_a_network(stiffness):
    damping = 0.1 * np.diag(MASS) + 0.02 * stiffness
    network = il.Network({"some": il.LinearStructure(MASS, damping, stiffness)})
    model = Model.of(network)
    for own, of_couplings, expected in (
        (model.stiffness, model.couplings.linear[0], stiffness),
        (model.damping, model.couplings.linear[1], damping),
    ):
        np.testing.assert_allclose(
            np.diag(own) + model.links.springs(of_couplings), expected, atol=1e-9 * expected.max()
        )


@pytest.mark.parametrize("beside", [0.0, 0.3])
def test_modes_are_those_of_the_matrices(beside):
    """Of a full mass matrix the coordinates are modes, and points have the names."""
    mass = np.diag(MASS) + beside * (np.eye(5, k=1) + np.eye(5, k=-1))
    ratios = np.array([0.01, 0.02, 0.03, 0.04, 0.05])
    modes = il.LinearStructure.from_damping_ratio(mass, shear(), ratios, names=TOWER.names).modes()
    squares, shapes = eigh(shear(), mass)
    np.testing.assert_allclose(modes.natural_frequency, np.sqrt(squares), rtol=1e-10)
    np.testing.assert_allclose(modes.damping_ratio, ratios, rtol=1e-7)
    found = modes.mode_shape.sel(place=list(TOWER.names))
    np.testing.assert_allclose(np.abs(found), np.abs(shapes), rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(found.values.T @ mass @ found.values, np.eye(5), atol=1e-9)
    assert modes.mode_shape.attrs["units"] == "kg-1/2"
    assert modes.mode.values.tolist() == [1, 2, 3, 4, 5]


def test_modes_of_other_structures():
    given = il.ModalStructure([3.0, 7.0], [0.01, 0.2], mass=[4.0, 1.0], points={"tip": [2.0, -1.0]})
    modes = given.modes()
    np.testing.assert_allclose(modes.natural_frequency, [3.0, 7.0], rtol=1e-14)
    np.testing.assert_allclose(modes.damping_ratio, [0.01, 0.2], rtol=1e-14)
    np.testing.assert_allclose(modes.mode_shape.sel(place="tip"), [1.0, -1.0], rtol=1e-14)
    free = il.LinearStructure([1.0, 3.0], [[0.1, -0.1], [-0.1, 0.1]], [[3.0, -3.0], [-3.0, 3.0]]).modes()
    np.testing.assert_allclose(free.natural_frequency, [0.0, 2.0], atol=1e-12)
    assert np.isnan(free.damping_ratio[0])
    assert free.damping_ratio[1] == pytest.approx(0.1 * (4.0 / 3.0) / 4.0)


def test_damping_ratios():
    stiffness, ratios = cantilever(), np.array([0.01, 0.02, 0.05, 0.1, 0.0])
    structure = il.LinearStructure.from_damping_ratio(MASS, stiffness, ratios)
    root = np.sqrt(MASS)
    squares, shapes = np.linalg.eigh(stiffness / np.outer(root, root))
    modal = shapes.T @ (np.array(structure.damping) / np.outer(root, root)) @ shapes
    np.testing.assert_allclose(modal, np.diag(2.0 * ratios * np.sqrt(squares)), atol=1e-10)
    with pytest.raises(il.InvalidInput, match=r"takes one damping ratio of at least 0, or one for each of the 5 modes"):
        il.LinearStructure.from_damping_ratio(MASS, stiffness, [0.1, 0.2])


ZERO, UNIT = np.zeros((2, 2)), np.eye(2)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([[2.0, 0.1], [0.2, 1.0]], ZERO, UNIT), r"mass must be symmetric, .* are 0.1 and 0.2"),
        (([[2.0, 3.0], [3.0, 2.0]], ZERO, UNIT), r"mass must have positive eigenvalues .* lowest of 2 is -1 kg"),
        (([[2.0, 1.0], [1.0, 0.0]], ZERO, UNIT), r"mass must have positive eigenvalues .* lowest of 2 is -0.414"),
        (([1.0, 0.0], ZERO, UNIT), r"mass must be larger than 0 kg, but the smallest is 0"),
        (([[1.0, 2.0]], ZERO, UNIT), r"mass is a row of masses or a square matrix of them, not of shape \(1, 2\)"),
        (([1.0, 2.0], ZERO, np.eye(3)), r"stiffness must be a square matrix for the 2 coordinates .* shape \(3, 3\)"),
        (
            ([1.0, 2.0], [[0.0, 1.0], [0.0, 0.0]], UNIT),
            r"damping must be symmetric, .* are 1 and 0",
        ),
        (([1.0, 2.0], ZERO, [[1.0, 2.0], [2.0, 1.0]]), r"stiffness must have no negative eigenvalue, .* of 2 is -1"),
        (([1.0, 2.0], ZERO, [[1.0, np.nan], [np.nan, 1.0]]), r"stiffness must hold finite numbers only"),
        (([1.0, 2.0], ZERO, (1.0 + 0.1j) * UNIT), r"stiffness must be real numbers, not array\(\[\[1.\+0.1j"),
        (([1.0, 2.0], ZERO, [["a", "b"], ["c", "d"]]), r"stiffness must be real numbers, not"),
        (([1.0, 2.0], ZERO, UNIT, ["a"]), r"names must be 2 different names, one for each mass, not \['a'\]"),
        (([1.0, 2.0], ZERO, UNIT, ["a", "a"]), r"names must be 2 different names"),
        (([1.0, 2.0], ZERO, UNIT, "ab"), r"names is a sequence of strings, not 'ab'"),
        (([1.0, 2.0], ZERO, UNIT, ["a", " "]), r"a name must be a non-empty string, not ' '"),
    ],
)
def test_bad_structure(arguments, message):
    mass, damping, stiffness, *names = arguments
    with pytest.raises(il.InvalidInput, match=message):
        il.LinearStructure(mass, damping, stiffness, **({"names": names[0]} if names else {}))


def test_bad_names_in_a_network():
    body, law = il.LinearOscillator(), il.HertzContact(1e4)
    with pytest.raises(
        il.InvalidInput, match=r"names a body 'tower' .*; name a coordinate or a point of the structure, such as"
    ):
        il.Network({"tower": TOWER, "b": body}, {"gap": il.Contact("tower", "b", law)})
    with pytest.raises(il.InvalidInput, match=r"excitation for 'tower', .* such as 'tower.1'"):
        il.Network({"tower": TOWER}, {}, {"tower": il.WhiteNoise(1.0)})
    with pytest.raises(il.InvalidInput, match=r"'tower.1' is the name of a body, and of a coordinate of a structure"):
        il.Network({"tower.1": body, "tower": TOWER})
    spring = {"tower: 1 to 2": il.Coupling("tower.1", "tower.3", il.LinearCoupling(1.0))}
    with pytest.raises(il.InvalidInput, match=r"'tower: 1 to 2' is the name of a coupling, and of a term of a struct"):
        il.Network({"tower": TOWER}, couplings=spring)


# motion


@pytest.mark.full
@pytest.mark.filterwarnings("ignore:Too few independent samples")
def test_a_building_is_bodies_and_couplings():
    names = list(WARM)
    grounds = np.append(STOREYS[0], np.zeros(4))
    bodies = {
        name: il.LinearOscillator(mass=mass, damping=RATE * mass, stiffness=ground)
        for name, mass, ground in zip(names, MASS, grounds, strict=True)
    }
    springs = {
        str(storey): il.Coupling(names[storey - 1], names[storey], il.LinearCoupling(STOREYS[storey]))
        for storey in range(1, 5)
    }
    contacts = {"stop": il.Contact("tower.roof", il.WALL, il.HertzContact(1e4), clearance=0.05)}
    options = {"duration": 5.0, "realizations": 4, "rng": 2}
    one = il.simulate(il.Network({"tower": TOWER}, contacts, WARM), **options)
    other = il.simulate(il.Network(bodies, contacts, WARM, springs), **options)
    assert (one.contact_ratio > 0.05).all()
    for name in ("mean_displacement", "mean_square_displacement", "mean_square_velocity", "contact_rate"):
        np.testing.assert_allclose(one[name], other[name], rtol=1e-9, err_msg=name)


@pytest.mark.full
@pytest.mark.filterwarnings("ignore:At the step of")
def test_a_path_with_contacts():
    """A beam that hits a stop with its tip, against a solver of differential equations with the matrices as given."""
    mass, stiffness = np.full(5, 0.2), cantilever()
    beam = il.LinearStructure.from_damping_ratio(mass, stiffness, 0.02, names=["1", "2", "3", "4", "tip"])
    law = il.PowerLawContact(2e3, exponent=4.0)
    network = il.Network({"beam": beam}, {"stop": il.Contact("beam.tip", il.WALL, law, clearance=0.05)})
    damping = np.array(beam.damping)

    def rhs(t, y):
        x, v = y[:5], y[5:]
        force = -stiffness @ x - damping @ v
        force[-1] -= 2e3 * max(x[-1] - 0.05, 0.0) ** 4
        return np.concatenate([v, force / mass])

    start = np.append(np.zeros(5), 1.5 * np.linspace(0.2, 1.0, 5) ** 2)
    np.testing.assert_allclose(network.compile().rhs(0.0, start[::-1].copy()), rhs(0.0, start[::-1]), atol=1e-9)
    solution = solve_ivp(rhs, (0.0, 2.0), start, "DOP853", rtol=1e-12, atol=1e-14, max_step=2e-3)
    errors = []
    for step in (1e-2, 5e-3):
        velocity = dict(zip(network.oscillators, start[5:].tolist(), strict=True))
        options = {"duration": 2.0, "spin_up": 0.0, "step": step, "initial": {"velocity": velocity}, "rng": 1}
        result = il.simulate(network, **options, record=[il.Trajectory(interval=2.0)])
        errors.append(np.abs(result.displacement.values[0, -1] - solution.y[:5, -1]).max())
    assert solution.y[4].max() > 0.2
    assert errors[-1] < 1e-6
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.3)


def test_many_coordinates_move_jointly():
    """Terms of matrices do not kick, as they would in a group of as many bodies."""
    beam = il.LinearStructure.from_damping_ratio(np.full(12, 1.0 / 12.0), cantilever(12), 0.02)
    network = il.Network({"beam": beam}, {"stop": il.Contact("beam.12", il.WALL, il.LinearContact(1.0))})
    model = Model.of(network)
    assert not model.ends.plain
    arranged = il.ExactFlow().arrange(model, np.append(1.0, model.couplings.linear[0]))
    assert arranged.couplings.flowing.all()
    assert arranged.ends.plain


# laws


def test_linear_law():
    """By the Lyapunov equation, with noise on the tip alone."""
    beam = il.LinearStructure.from_damping_ratio(np.full(4, 0.25), cantilever(4), [0.02, 0.05, 0.05, 0.1])
    network = il.Network({"beam": beam}, excitations={"beam.4": il.WhiteNoise(0.3)})
    inverse = 4.0 * np.eye(4)
    drift = np.block(
        [[np.zeros((4, 4)), np.eye(4)], [-inverse @ np.array(beam.stiffness), -inverse @ np.array(beam.damping)]]
    )
    noise = np.zeros((8, 8))
    noise[7, 7] = 2.0 * np.pi * 0.3 * 16.0
    covariance = np.diagonal(solve_continuous_lyapunov(drift, -noise))
    statistics = il.exact(network).statistics()
    np.testing.assert_allclose(statistics.mean_square_displacement, covariance[:4], rtol=1e-8)
    np.testing.assert_allclose(statistics.mean_square_velocity, covariance[4:], rtol=1e-8)


@pytest.mark.campaign
def test_towers_that_pound():
    """Two buildings of one temperature: the gap between the roofs is Gaussian but for the energy of the contact."""
    other = il.LinearStructure(MASS[:3], RATE * np.diag(MASS[:3]), shear(0.5 * STOREYS[:3]))
    noise = {f"other.{k + 1}": il.WhiteNoise(RATE * mass / np.pi) for k, mass in enumerate(MASS[:3])}
    law, clearance = il.HertzContact(1e4), 0.05
    network = il.Network(
        {"tower": TOWER, "other": other},
        {"gap": il.Contact("tower.roof", "other.3", law, clearance=clearance)},
        WARM | noise,
    )
    variance = np.linalg.inv(shear())[-1, -1] + np.linalg.inv(shear(0.5 * STOREYS[:3]))[-1, -1]

    def density(gap):
        return np.exp(-0.5 * gap**2 / variance - float(law.call("potential", max(gap - clearance, 0.0))))

    open_, closed = (
        quad(density, *ends, epsabs=0.0, epsrel=1e-10)[0] for ends in ((-2.0, clearance), (clearance, 0.5))
    )
    speed = np.sqrt((1.0 / MASS[4] + 1.0 / MASS[2]) / (2.0 * np.pi))
    expected = {
        "contact_ratio": closed / (open_ + closed),
        "contact_rate": speed * density(clearance) / (open_ + closed),
        "mean_square_velocity": 1.0 / np.append(MASS, MASS[:3]),
    }
    statistics = il.exact(network).statistics()
    for name, value in expected.items():
        np.testing.assert_allclose(statistics[name].values, np.resize(value, statistics[name].shape), rtol=1e-6)
    result = il.simulate(network, duration=300.0, realizations=128, rng=4)
    off = deviations(result, statistics, [*expected, "mean_square_displacement"], relative=2e-3)
    assert max(off.values()) < 3.5, off


class Shaft(il.Structure):
    """Equal discs on a shaft that is clamped at one end."""

    discs: int = il.parameter(minimum=1)
    mass: float = il.parameter(units="kg")
    stiffness: float = il.parameter(units="N m-1")

    def bodies(self):
        springs = [self.stiffness] + [0.0] * (self.discs - 1)
        return {f"{disc + 1}": {"mass": self.mass, "damping": 0.4, "stiffness": k} for disc, k in enumerate(springs)}

    def terms(self):
        for disc in range(1, self.discs):
            yield f"{disc}", {f"{disc}": 1.0, f"{disc + 1}": -1.0}, self.stiffness, 0.0

    def weights(self):
        return {"middle": {f"{disc + 1}": 1.0 / self.discs for disc in range(self.discs)}}


@pytest.mark.full
def test_structures_of_ones_own():
    """What a class says in a few lines of its own is a structure as any other."""
    stop = il.Contact("shaft.middle", il.WALL, il.HertzContact(1e3), clearance=0.1)
    shaft = Shaft(3, mass=2.0, stiffness=50.0)
    own = il.Network({"shaft": shaft}, {"stop": stop}, {"ground": il.BaseMotion(il.WhiteNoise(1.0))})
    assert il.Network.from_dict(own.to_dict()) == own
    assert il.Network.from_toml(own.to_toml()) == own
    bodies = il.LinearStructure([2.0] * 3, 0.4 * np.eye(3), shear(np.full(3, 50.0)))
    sides = il.Combination({f"shaft.{disc + 1}": 1.0 / 3.0 for disc in range(3)})
    same = own.replace(oscillators={"shaft": bodies}, contacts={"stop": stop.replace(first=sides)})
    one, other = (il.simulate(network, 5.0, realizations=64, step=0.01, spin_up=1.0, rng=1) for network in (own, same))
    for name in ("mean_square_displacement", "contact_ratio"):
        np.testing.assert_allclose(one[name], other[name], rtol=1e-10)
    with pytest.raises(il.InvalidInput, match="Unfinished is abstract: it does not define bodies, terms"):
        type("Unfinished", (il.Structure,), {})()
