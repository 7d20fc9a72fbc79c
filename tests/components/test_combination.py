"""Contacts and couplings between combinations of bodies: descriptions, motion, laws, and who knows them."""

import json
import pickle

import numpy as np
import pytest
from laws import DampedCubicCoupling, LossyContact
from scenes import deviations
from scipy.integrate import solve_ivp

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.plotting.drawing import draw_network
from impactlab.step_control.rules.tangent_stiffness import Stiffening

MASS = {"a": 1.0, "b": 2.0, "c": 0.5}
STIFFNESS = {"a": 30.0, "b": 10.0, "c": 5.0}
DAMPING = {"a": 0.5, "b": 0.4, "c": 0.2}
LEVER = il.Combination({"a": 1.0, "b": -0.5})
WEIGHTS, CLEARANCE = np.array([1.0, -0.5, -1.0]), 0.05
BODIES = {name: il.LinearOscillator(mass=MASS[name], damping=DAMPING[name], stiffness=STIFFNESS[name]) for name in MASS}
WARM = {name: il.WhiteNoise(DAMPING[name] / np.pi) for name in MASS}  # temperature 1 J


def lever(law=None, **changes):
    """Three bodies; the first two move the end of a lever, which can touch the third."""
    contact = il.Contact(LEVER, "c", law or il.HertzContact(1e4), clearance=CLEARANCE)
    return il.Network(BODIES, {"lever": contact}).replace(**changes)


# descriptions


def test_contact_and_its_data():
    contact = lever().contacts["lever"]
    assert repr(LEVER) == "Combination({'a': 1.0, 'b': -0.5})"
    assert il.Combination({"a": 1, "b": -0.5}) == LEVER
    assert contact.to_dict()["first"] == {"combination": {"a": 1.0, "b": -0.5}}
    assert il.Contact.from_dict(json.loads(json.dumps(contact.to_dict()))) == contact
    assert pickle.loads(pickle.dumps(contact)) == contact
    network = lever(couplings={"tie": il.Coupling(il.WALL, LEVER, il.LinearCoupling(3.0))})
    assert il.Network.from_dict(json.loads(json.dumps(network.to_dict()))) == network
    assert Model.of(network).ends.gap(np.array([1.0, 10.0, 100.0])).tolist() == [1.0 - 5.0 - 100.0]


@pytest.mark.parametrize(
    ("sides", "same"),
    [
        ((il.Combination({"a": 1.0, "b": -1.0}), il.WALL), ("a", "b")),
        ((il.Combination({"a": 0.5, "b": -1.0}), il.Combination({"a": -0.5})), ("a", "b")),
        ((il.WALL, il.Combination({"a": 1.0})), (il.WALL, "a")),
        ((il.Combination({"b": 1.0, "a": 2.0}), il.Combination({"a": 2.0})), ("b", il.WALL)),
    ],
)
def test_combinations_that_are_differences_are_written_as_such(sides, same):
    law = il.HertzContact(1e4)
    assert il.Contact(*sides, law, clearance=0.1) == il.Contact(*same, law, clearance=0.1)


@pytest.mark.parametrize(
    ("weights", "message"),
    [
        ({}, r"A Combination needs a weight for at least one body, such as .*, not \{\}"),
        (3.0, r"weights must be a mapping of names to numbers, not 3.0"),
        ({"a": 1.0, "b": 0.0}, r"Combination: the weight of 'b' must not be 0"),
        ({"a": np.inf}, r"Combination: weights\['a'\] must be a finite number, not inf"),
        ({"a": "1"}, r"Combination: weights\['a'\] must be a number, not '1'"),
        ({3: 1.0}, r"weights: a name must be a string, not 3"),
    ],
)
def test_bad_combination(weights, message):
    with pytest.raises(il.InvalidInput, match=message):
        il.Combination(weights)


def test_bad_sides():
    law = il.HertzContact(1e4)
    with pytest.raises(il.InvalidInput, match=r"acts on nothing: no weight is left of their difference"):
        il.Contact(LEVER, LEVER, law)
    with pytest.raises(il.InvalidInput, match=r"Contact.first must be the name of a body, an il.Comb"):
        il.Contact({"a": 1.0}, "b", law)
    with pytest.raises(il.InvalidInput, match=r"Contact 'gap' names a body 'bb' that is not in the network"):
        lever(contacts={"gap": il.Contact(il.Combination({"a": 1.0, "bb": 2.0}), "c", law)})


# motion


@pytest.mark.full
@pytest.mark.parametrize(
    ("method", "order", "step"),
    [(il.ExactFlow(), 4, 5e-3), (il.RungeKutta4(), 4, 1e-3), (il.EulerMaruyama(), 1, 4e-5)],
)
def test_a_path_with_contacts(method, order, step):
    """Against a solver of differential equations with forces of its own; the law is so smooth that orders show."""
    network = lever(il.PowerLawContact(2e3, exponent=4.0))
    k, c, m = (np.array([item[name] for name in MASS]) for item in (STIFFNESS, DAMPING, MASS))

    def rhs(t, y):
        x, v = y[:3], y[3:]
        force = 2e3 * max(WEIGHTS @ x - CLEARANCE, 0.0) ** 4
        return np.concatenate([v, (-k * x - c * v - WEIGHTS * force) / m])

    start = np.array([0.0, 0.0, 0.0, 4.0, -2.0, -3.0])
    solution = solve_ivp(rhs, (0.0, 1.5), start, "DOP853", rtol=1e-12, atol=1e-13, max_step=2e-3)
    np.testing.assert_allclose(network.compile().rhs(0.0, start[::-1].copy()), rhs(0.0, start[::-1]), rtol=1e-13)
    errors = []
    for length in (step, 0.5 * step):
        options = {
            "duration": 1.5, "spin_up": 0.0, "step": length, "integrator": method, "rng": 1,
            "initial": {"velocity": {"a": 4.0, "b": -2.0, "c": -3.0}}, "record": [il.Trajectory(interval=1.5)],
        }  # fmt: skip
        result = il.simulate(network, **options)
        assert result.contact_rate.item() * 1.5 == pytest.approx(2.0)
        errors.append(np.abs(result.displacement.values[0, -1] - solution.y[:3, -1]).max())
    assert errors[-1] < 2e-3
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.25)


def scaled(couplings, contact):
    """The same network twice: with differences, and with twice or half the differences in the place of these."""
    double, half = il.Combination({"a": 2.0, "b": -2.0}), il.Combination({"b": 1.0, "c": -0.5})
    law, other = contact
    plain = il.Network(
        BODIES,
        {"gap": il.Contact("a", "b", law, clearance=0.02)},
        WARM,
        {name: il.Coupling("b", "c", item) for name, (item, _) in couplings.items()},
    )
    weighted = plain.replace(
        contacts={"gap": il.Contact(double, il.WALL, other, clearance=0.04)},
        couplings={name: il.Coupling(half, il.Combination({"b": 0.5}), item) for name, (_, item) in couplings.items()},
    )
    return plain, weighted


SPRING = {"spring": (il.LinearCoupling(40.0, damping=0.3), il.LinearCoupling(160.0, damping=1.2))}
STIFF = {"spring": (il.LinearCoupling(4000.0, damping=9.0), il.LinearCoupling(16000.0, damping=36.0))}
MAXWELL = {"maxwell": (il.MaxwellCoupling(50.0, damping=20.0), il.MaxwellCoupling(200.0, damping=80.0))}
LATCHED = (
    il.LankaraniNikraveshContact(1e4, restitution=0.7),
    il.LankaraniNikraveshContact(1e4 / 2.0**2.5, restitution=0.7),
)
CUBIC = {"cubic": (DampedCubicCoupling(50.0, damping=0.2), DampedCubicCoupling(800.0, damping=0.8))}


@pytest.mark.full
@pytest.mark.filterwarnings("ignore:Too few independent samples")
@pytest.mark.parametrize("realizations", [1, 3])
@pytest.mark.parametrize(
    ("couplings", "contact"),
    [
        pytest.param({}, (il.LinearContact(400.0), il.LinearContact(100.0)), marks=pytest.mark.campaign),
        (SPRING, (il.LinearContact(400.0), il.LinearContact(100.0))),
        pytest.param(STIFF, (il.LinearContact(400.0), il.LinearContact(100.0)), marks=pytest.mark.campaign),
        pytest.param(
            CUBIC, (LossyContact(400.0, damping=8.0), LossyContact(100.0, damping=1.0)), marks=pytest.mark.campaign
        ),
        pytest.param(MAXWELL, LATCHED, marks=pytest.mark.campaign),
    ],
    ids=["contact", "spring", "stiff", "dissipative", "states"],
)
def test_the_same_motion_by_other_weights(couplings, contact, realizations):
    """Gaps of twice the length and half the extensions, with laws that make the same forces."""
    plain, weighted = scaled(couplings, contact)
    initial = {"displacement": {"a": 0.3}, "velocity": {"b": 1.0}}
    options = {
        "duration": 3.0, "step": 2e-3, "spin_up": 0.0, "initial": initial, "realizations": realizations, "rng": 3,
        "record": [il.Trajectory(interval=0.5), il.PeakForces(limits=None)],
    }  # fmt: skip
    one = il.simulate(plain, **options)
    options["record"] = [il.Trajectory(interval=0.5), il.PeakForces(limits=2.0 * one.crossing_indentation.max().item())]
    other = il.simulate(weighted, **options)
    assert (one.contact_ratio > 0.01).all()
    for name in ("displacement", "velocity", "mean_square_velocity", "contact_ratio", "contact_rate"):
        np.testing.assert_allclose(other[name], one[name], rtol=1e-7, atol=1e-9, err_msg=name)
    for name in ("contact_force", "mean_contact_force", "window_peak_force"):
        np.testing.assert_allclose(2.0 * other[name], one[name], rtol=1e-7, atol=1e-7, err_msg=name)
    assert (other.crossing_rate.sum() > 0.0).all()


# laws


def by_quadrature(law, count=1201):
    """Moments of two bodies at 1 J with a contact between the displacement of one and 1.5 times that of the other."""
    x, y = (np.linspace(-7.0, 7.0, count) / np.sqrt(STIFFNESS[name]) for name in "ab")
    gap = x[:, None] - 1.5 * y - CLEARANCE
    energy = 0.5 * STIFFNESS["a"] * x[:, None] ** 2 + 0.5 * STIFFNESS["b"] * y**2
    density = np.exp(-energy - law.call("potential", np.maximum(gap, 0.0)))
    density /= density.sum()
    force = law.evaluate(np.maximum(gap, 0.0))
    near = np.abs(gap) < 0.02
    speed = 1.0 / MASS["a"] + 1.5**2 / MASS["b"]
    return {
        "mean_displacement": np.array([(density.sum(axis=1) * x).sum(), (density.sum(axis=0) * y).sum()]),
        "mean_square_displacement": np.array([(density.sum(axis=1) * x**2).sum(), (density.sum(axis=0) * y**2).sum()]),
        "mean_square_velocity": np.array([1.0 / MASS["a"], 1.0 / MASS["b"]]),
        "contact_ratio": (density * (gap > 0.0)).sum(),
        "mean_contact_force": (density * force).sum(),
        "contact_rate": np.sqrt(speed / (2.0 * np.pi)) * density[near].sum() / 0.04,
    }


@pytest.mark.full
def test_the_stationary_law_at_the_automatic_step():
    """All noises have one temperature: density exp(−H/T), in which velocities know nothing of the contact."""
    law = il.HertzContact(1e3)
    network = il.Network(
        {name: BODIES[name] for name in "ab"},
        {"gap": il.Contact("a", il.Combination({"b": 1.5}), law, clearance=CLEARANCE)},
        {name: WARM[name] for name in "ab"},
    )
    result = il.simulate(network, duration=1500.0, realizations=256, rng=5)
    expected = by_quadrature(law)
    assert result.contact_ratio.item() > 0.05
    off = deviations(result, expected, expected, relative=2e-3)
    assert max(off.values()) < 3.5, off
    assert (result.mean_square_velocity_standard_error < 5e-3 * expected["mean_square_velocity"]).all()


@pytest.mark.full
def test_equipartition():
    network = lever(excitations=WARM)
    result = il.simulate(network, duration=1000.0, realizations=128, rng=7)
    expected = {"mean_square_velocity": np.array([1.0 / mass for mass in MASS.values()])}
    assert deviations(result, expected, expected, relative=1e-3)["mean_square_velocity"] < 3.5


def test_exact_law_of_linear_couplings():
    """With one temperature the covariance is T K⁻¹; contacts that never close do not matter."""
    tie = il.Coupling(LEVER, il.WALL, il.LinearCoupling(7.0))
    network = lever(excitations=WARM, couplings={"tie": tie}, contacts={"lever": None})
    far = network.replace(contacts={"far": il.Contact(LEVER, "c", il.HertzContact(1e4), clearance=30.0)})
    w = np.array([1.0, -0.5, 0.0])
    covariance = np.linalg.inv(np.diag(list(STIFFNESS.values())) + 7.0 * np.outer(w, w))
    for item in (network, far):
        statistics = il.exact(item).statistics()
        np.testing.assert_allclose(statistics.mean_square_displacement, np.diagonal(covariance), rtol=1e-12)
        np.testing.assert_allclose(statistics.mean_square_velocity, 1.0 / np.array(list(MASS.values())), rtol=1e-12)
    assert il.exact(far).statistics().contact_ratio.item() == 0.0


@pytest.mark.full
def test_exact_law_of_contacts_along_a_combination():
    """Against sums over a grid of all three displacements; the lever has stops on both sides."""
    stops = {
        "lever": il.Contact(LEVER, "c", il.HertzContact(300.0), clearance=0.2),
        "back": il.Contact("c", LEVER, il.PowerLawContact(500.0, exponent=2.0), clearance=0.4),
    }
    tie = il.Coupling("b", "c", il.LinearCoupling(3.0))
    network = lever(excitations=WARM, contacts=stops, couplings={"tie": tie})
    w = np.array([1.0, -0.5, -1.0])
    stiffness = np.diag(list(STIFFNESS.values())) + 3.0 * np.outer([0.0, 1.0, -1.0], [0.0, 1.0, -1.0])
    deviations = np.sqrt(np.diagonal(np.linalg.inv(stiffness)))
    axes = [np.linspace(-6.0, 6.0, 161) * deviation for deviation in deviations]
    x = np.stack(np.meshgrid(*axes, indexing="ij"))
    gap = np.tensordot(w, x, 1)
    near, far = np.maximum(gap - 0.2, 0.0), np.maximum(-gap - 0.4, 0.0)
    energy = 0.5 * np.einsum("i...,ij,j...->...", x, stiffness, x) + 120.0 * near**2.5 + 500.0 / 3.0 * far**3
    density = np.exp(-energy)
    density /= density.sum()
    law = il.exact(network)
    statistics = law.statistics()
    for axis, name in enumerate("abc"):
        alone = density.sum(axis=tuple({0, 1, 2} - {axis}))
        mean, square = (float((alone * axes[axis] ** power).sum()) for power in (1, 2))
        assert statistics.mean_displacement.sel(oscillator=name).item() == pytest.approx(mean, abs=1e-5)
        assert statistics.mean_square_displacement.sel(oscillator=name).item() == pytest.approx(square, rel=1e-5)
        own = law.density(name, "displacement", axes[axis])
        np.testing.assert_allclose(own, alone / np.diff(axes[axis])[0], atol=1e-5 * own.max())
    forces = 300.0 * near**1.5, 500.0 * far**2
    for name, force in zip(stops, forces, strict=True):
        expected = float((density * force).sum())
        assert statistics.mean_contact_force.sel(contact=name).item() == pytest.approx(expected, rel=1e-4)
    np.testing.assert_allclose(statistics.mean_square_velocity, 1.0 / np.array(list(MASS.values())), rtol=1e-12)
    with pytest.raises(il.NoExactReference, match=r"joint density of 'a' and 'b', whose contacts act along a comb"):
        law.joint_density("a", "b", np.zeros(1), np.zeros(1))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"contacts": {"gap": il.Contact("a", "c", il.HertzContact(1e4), clearance=0.1)}},
            "contact 'lever' acts on a combination with weights; with contacts the law is computed for differences",
        ),
        ({"excitations": {"a": il.WhiteNoise(1.0)}}, "the noises are not in balance with the damping at one temper"),
        ({"excitations": {"a": None}}, "the noises are not in balance with the damping at one temperature"),
        (
            {"excitations": {"a": il.ShinozukaNoise(0.5, band=(0.0, 9.0), components=40)}},
            "'a': the law is known for constant white noise only",
        ),
        ({"couplings": {"s": il.Coupling("a", "b", DampedCubicCoupling(1.0, damping=0.0))}}, "'s' depends on the rate"),
        ({"oscillators": {"c": il.LinearOscillator(damping=0.2)}}, "no spring confines one of their motions"),
    ],
)
def test_no_exact_law_of_weighted_contacts(changes, message):
    with pytest.raises(il.NoExactReference, match=message):
        il.exact(lever(excitations=WARM).replace(**changes))


# who knows them


def test_check():
    """A closed contact is a spring along w, which sees the mass 1/(wᵀM⁻¹w)."""
    network = lever(excitations=WARM)
    data = network.check().dataset
    inverse = WEIGHTS**2 @ (1.0 / np.array(list(MASS.values())))
    tangent = data.tangent_stiffness.item()
    assert data.shortest_contact.item() == pytest.approx(np.pi / np.sqrt(tangent * inverse), rel=1e-12)
    stiffness = np.diag(list(STIFFNESS.values())) + tangent * np.outer(WEIGHTS, WEIGHTS)
    squares = np.linalg.eigvals(stiffness / np.array(list(MASS.values()))[:, None])
    np.testing.assert_allclose(data.closed_frequency, np.sqrt(np.sort(squares)), rtol=1e-9)


def test_what_is_estimated_before_a_run():
    """As of the same gap without weights."""
    plain, weighted = (Model.of(item) for item in scaled(SPRING, (il.LinearContact(400.0), il.LinearContact(100.0))))
    one, other = (Stiffening.of(model, np.array([1.0, 1.0, 1.0])) for model in (plain, weighted))
    np.testing.assert_allclose(other.penetration, 2.0 * one.penetration, rtol=1e-9)
    np.testing.assert_allclose(other.contacts, one.contacts / 4.0, rtol=1e-9)
    steps = [il.ExactFlow().recommended_step(model, item.links) for model, item in ((plain, one), (weighted, other))]
    assert steps[1] == pytest.approx(steps[0], rel=1e-9)


@pytest.mark.full
@pytest.mark.filterwarnings("ignore:Too few independent samples")
def test_files_and_drawings(tmp_path):
    network = lever(excitations=WARM)
    result = il.simulate(network, duration=2.0, realizations=2, rng=1)
    il.save(result, tmp_path / "result.nc")
    assert il.network_of(tmp_path / "result.nc") == network
    assert il.rerun(tmp_path / "result.nc").contact_rate.equals(result.contact_rate)
    assert any("a − 0.5 b with c" in text.get_text() for text in draw_network(network).axes[0].texts)


def test_arrays_in_the_place_of_names_are_refused_in_one_line():
    with pytest.raises(il.InvalidInput) as caught:
        il.Contact(np.eye(3), "a", il.HertzContact(1.0))
    assert "\n" not in str(caught.value)
