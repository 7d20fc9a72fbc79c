"""The Fokker–Planck equation of pairs: against exact laws, linear motion, simulations and itself."""

import math
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import impactlab as il
from impactlab.kernels.phases import turn
from impactlab.linear.transitions import transition
from impactlab.reference.fokker_planck import cost, settings
from impactlab.reference.fokker_planck.convergence import Convergence
from impactlab.reference.fokker_planck.follower import Hermite, propagator_of
from impactlab.reference.fokker_planck.march import March
from impactlab.reference.fokker_planck.pair import Pair
from impactlab.reference.fokker_planck.propagator import Basis, Shears
from impactlab.reference.fokker_planck.reading import Reading
from impactlab.reference.fokker_planck.settings import LADDER, SHARES

pytestmark = pytest.mark.campaign

COARSE = {"gap": 45, "center": 17, "first": 19, "second": 19, "box": 5.0}
BODIES = {
    "a": il.LinearOscillator(mass=1.0, damping=0.5, stiffness=1.0),
    "b": il.LinearOscillator(mass=2.0, damping=0.5, stiffness=1.5),
}


def pair(temperatures=(1.0, 1.0), law=None, clearance=0.5, sides=("a", "b")):
    noises = {
        name: il.WhiteNoise(T * BODIES[name].damping / math.pi) for name, T in zip("ab", temperatures, strict=True)
    }
    contact = il.Contact(*sides, law or il.HertzContact(3.0), clearance=clearance)
    return il.Network(BODIES, {"gap": contact}, noises)


def stiff(ratio=64.0, sides=("fast", "slow"), intensity=0.1, law=None):
    """A fast body and a slow one, at equal temperatures with the default intensity; dampings are 0.2 frequencies."""
    bodies = {
        "fast": il.LinearOscillator(mass=1.0, damping=0.2 * ratio, stiffness=ratio**2),
        "slow": il.LinearOscillator(mass=1.0, damping=0.2, stiffness=1.0),
    }
    noises = {"fast": il.WhiteNoise(intensity * ratio), "slow": il.WhiteNoise(0.1)}
    return il.Network(bodies, {"gap": il.Contact(*sides, law or il.HertzContact(100.0), clearance=0.2)}, noises)


def within_errors(solved, exact):
    data = solved.statistics()
    for name in exact.data_vars:
        if name in data and name != "mean_velocity":
            assert (np.abs(data[name] - exact[name]) <= data[f"{name}_error"]).all(), name


@pytest.fixture(scope="module")
def equal():
    network = pair()
    return network, il.fokker_planck(network, basis=COARSE, tolerance=3e-3)


@pytest.fixture(scope="module")
def unequal():
    network = pair((1.5, 1.0))
    return network, il.fokker_planck(network, basis=COARSE, tolerance=3e-3)


def propagator(network, **changes):
    own = Pair.of(network)
    well = own.well(float(own.temperatures.max()))
    return propagator_of(well, settings.rule(own, well)._replace(**changes))


def test_errors_hold_the_exact_law(equal):
    network, solved = equal
    data, exact = solved.statistics(), il.exact(network).statistics()
    for name in exact.data_vars:
        if name not in data or name == "mean_velocity":
            continue
        error = np.abs(data[name] - exact[name])
        assert (error <= data[f"{name}_error"]).all(), name
        assert (data[f"{name}_error"] <= 5e-3 * np.abs(data[name])).all(), name


@pytest.mark.parametrize(
    ("ratio", "sides", "tolerance"), [(64.0, ("fast", "slow"), 3e-3), (128.0, ("slow", "fast"), 1e-4)]
)
def test_a_body_that_follows_the_other_one_needs_few_functions(ratio, sides, tolerance):
    """The exact law, whichever side of the contact the fast body is on; 1e-4 needs double precision at 128."""
    network = stiff(ratio, sides)
    solved, exact = il.fokker_planck(network, tolerance=tolerance), il.exact(network)
    assert solved.basis["center"] <= 9
    assert solved.basis["first"] <= 9
    within_errors(solved, exact.statistics())
    assert (
        solved.statistics().mean_square_displacement_error <= tolerance * exact.statistics().mean_square_displacement
    ).all()
    for body, reach in (("fast", 2.0 / ratio), ("slow", 2.0)):
        places = np.linspace(-reach, reach, 9)
        for quantity, scale in (("displacement", 1.0), ("velocity", 2.0 / reach)):
            density = exact.density(body, quantity, scale * places)
            found = solved.density(body, quantity, scale * places)
            np.testing.assert_allclose(found, density, atol=tolerance * density.max())


def test_functions_shift_and_move_a_normal_law():
    """A displaced normal law, and a wave that it carries along, against its characteristic function."""
    own = propagator(stiff(intensity=0.15), gap=15, center=11, first=11, step=0.02)
    (pair_, spreads), functions = (own.pair, own.spreads), Hermite(11)
    place, velocity = 0.4 * spreads[0], 0.3 * spreads[1]
    of_x = functions.shifting(np.array(place / spreads[0])) @ functions.weights
    of_v = functions.shifting(np.array(velocity / spreads[1])) @ functions.weights
    a, q = (item[0] for item in own.flow)
    covariance = np.diag(np.square(spreads))
    for mode in (0, 4):
        wave = own.grid.modes.numbers[mode]
        planes = own.motion[mode] @ np.concatenate([np.outer(of_x, of_v).ravel(), np.zeros(121)])
        moved = (planes[:121] + 1j * planes[121:]).reshape(11, 11)
        over = np.array([a[0, 0] - 1.0, a[0, 1]])  # displacement during the step
        exponent = -1j * wave * (over @ [place, velocity]) - 0.5 * wave**2 * (over @ covariance @ over + q[0, 0])
        assert moved.sum() == pytest.approx(np.exp(exponent), abs=1e-4)
    at_rest = (own.motion[0] @ np.concatenate([np.outer(of_x, of_v).ravel(), np.zeros(121)]))[:121].reshape(11, 11)
    means = at_rest.sum(axis=1) @ functions.nodes * spreads[0], at_rest.sum(axis=0) @ functions.nodes * spreads[1]
    np.testing.assert_allclose(means, a @ [place, velocity], rtol=1e-4)
    assert pair_.gaussian == pytest.approx(float(pair_.temperatures[0]))


def test_kicks_of_a_constant_force_move_a_body_by_its_compliance():
    """At any step, read at the shifted place."""
    for step in (0.003, 0.02, 0.04):
        own = propagator(stiff(), step=step)
        a, kick = own.flow[0][0], step / own.pair.mass[0]
        state = np.zeros(2)
        for _ in range(4000):
            state = a @ (state + np.array([0.0, kick]))
        assert state[0] + own.shifts[0] == pytest.approx(1.0 / own.pair.stiffness[0], rel=1e-9)
    own = propagator(stiff(), step=1e-4)
    np.testing.assert_allclose(own.shifts, 1e-8 / 12.0 / own.pair.mass, rtol=1e-3)


def test_other_pairs_have_no_body_that_follows():
    for network in (pair(), pair((1.5, 1.0)), stiff(2.0), stiff(intensity=100.0), stiff(law=il.HertzContact(1e6))):
        assert Pair.of(network).gaussian == 0.0


def test_densities_are_exact(equal):
    network, solved = equal
    exact = il.exact(network)
    for body, quantity in (("a", "displacement"), ("b", "displacement"), ("a", "velocity"), ("b", "velocity")):
        grid = np.linspace(-2.0, 2.0, 9)
        top = exact.density(body, quantity, grid).max()
        np.testing.assert_allclose(
            solved.density(body, quantity, grid), exact.density(body, quantity, grid), atol=1e-3 * top
        )
        edges = np.linspace(-6.0, 6.0, 25)
        bins = solved.bin_density(body, quantity, edges)
        np.testing.assert_allclose(bins, exact.bin_density(body, quantity, edges), atol=1e-3 * top)
        assert (bins * np.diff(edges)).sum() == pytest.approx(1.0, abs=1e-3)


def test_the_chain_is_that_of_simulations(unequal):
    network, solved = unequal
    result = il.simulate(network, 1000.0, realizations=256, rng=3)
    rows = il.compare(result, solved)
    data = solved.statistics()
    numerical = np.array(
        [
            float(np.ravel(data[f"{name}_error"].sel({dim: label}))[0])
            for name, label in zip(rows.statistic.values, rows.label.values, strict=True)
            for dim in data[name].dims
        ]
    )
    beyond = np.abs(rows.difference.values) - numerical
    known = rows.standard_error.values > 0.0
    assert (beyond[known] <= 4.0 * rows.standard_error.values[known]).all()


def changed_by(parts):
    """Statistics, and coarser ones, of which one direction changes some by parts of them."""
    values = {
        "mean_displacement": np.array([-1.0, 1.0]), "mean_square_displacement": np.array([2.0, 0.1]),
        "mean_square_velocity": np.array([1.0, 0.2]), "contact_rate": np.array([0.3]),
        "mean_contact_force": np.array([4.0]),
    }  # fmt: skip
    coarser = dict.fromkeys(LADDER, values)
    coarser["second"] = {name: value * (1.0 + np.array(parts.get(name, 0.0))) for name, value in values.items()}
    balances = {"balance_force": np.zeros(2), "balance_power": np.zeros(1)}
    return Convergence(values, coarser, balances)


def test_each_statistic_has_an_error_of_its_own():
    """A cold body that the grid does not resolve leaves the others their errors; its own are the largest of its two."""
    errors = changed_by({"mean_square_velocity": [1e-4, 0.6], "mean_contact_force": 2e-3})
    of_first, of_contact, most = (SHARES["second"] * change for change in (1.5 * 1e-4, 1.5 * 2e-3, 0.6))
    np.testing.assert_allclose(errors.total["mean_square_velocity"], [of_first, most * 0.2])
    np.testing.assert_allclose(errors.total["mean_square_displacement"], [of_first * 2.0, most * 0.1])
    np.testing.assert_allclose(errors.total["mean_displacement"], of_contact)
    assert errors.together() == pytest.approx(most)  # the tolerance is for all


def test_a_cold_heavy_body_is_resolved():
    """Temperatures 1 : 0.02 and masses 1 : 20, to 1 %, against an ensemble."""
    mass, stiffness, damping = (1.0, 20.0), (2.25, 20.0), (0.24, 12.0)
    parts = zip("ab", mass, damping, stiffness, strict=True)
    bodies = {name: il.LinearOscillator(mass=m, damping=c, stiffness=k) for name, m, c, k in parts}
    noises = {"a": il.WhiteNoise(0.24 / math.pi), "b": il.WhiteNoise(0.24 / math.pi)}
    network = il.Network(bodies, {"g": il.Contact("a", "b", il.LinearContact(30.0), clearance=0.4)}, noises)
    solved = il.fokker_planck(network, tolerance=0.01)
    ds = il.simulate(network, 300.0, realizations=512, rng=1)
    table = il.compare(ds, solved)
    assert solved.basis["gap"] * solved.basis["center"] * solved.basis["first"] * solved.basis["second"] < 1.5e6
    assert (np.abs(table.z.values[np.isfinite(table.z.values)]) < 4.0).all()
    data = solved.statistics()
    for name in ("mean_square_displacement", "mean_square_velocity", "mean_contact_force"):
        assert (data[f"{name}_error"] < 0.01 * data[name]).all()


def test_balances_close(unequal):
    _, solved = unequal
    table, data = solved.convergence(), solved.statistics()
    error = sum(value for name, value in solved.errors.relative.items() if name != "balances")
    assert np.abs(table.balance_force).max() < error
    assert table.balance_moments.max() < 0.1 * error
    assert abs(table.balance_power) < 0.1 * error
    assert data.mean_displacement.values @ [1.0, 1.5] == pytest.approx(0.0, abs=1e-12)  # the contact pushes both ways
    assert data.mean_square_velocity.values @ [0.5, 0.5] == pytest.approx(2.5 * 0.5 / 1.0 - 0.25, rel=1e-4)


def test_convergence_is_in_each_direction(unequal):
    network, solved = unequal
    table = solved.convergence()
    assert list(table.direction.values) == ["gap", "center", "first", "second", "box", "step", "step twice"]
    assert (table.basis.values[:5] < [solved.basis[name] for name in COARSE]).all()
    with pytest.warns(il.AccuracyWarning, match="With the given basis errors exceed"):
        rough = il.fokker_planck(network, basis=COARSE | {"step": 0.3}, tolerance=1e-3).convergence()
    once, twice = (abs(rough.mean_square_velocity.sel(direction=name)).max() for name in ("step", "step twice"))
    assert twice > 3.0 * once  # of second order at least: 2^(p/2) + 1 times
    finer = il.fokker_planck(network, basis=COARSE | {"gap": 61}, tolerance=3e-3)
    change = abs(finer.statistics().mean_contact_force - solved.statistics().mean_contact_force)
    assert (change <= solved.statistics().mean_contact_force_error).all()
    assert finer.errors.relative["gap"] < solved.errors.relative["gap"]


def test_the_order_of_the_sides_does_not_matter(unequal):
    """A mirror: displacements change their sign, and the contact its sides."""
    _, solved = unequal
    other = il.fokker_planck(pair((1.5, 1.0), sides=("b", "a")), basis=COARSE, tolerance=3e-3)
    data, mirrored = solved.statistics(), other.statistics()
    np.testing.assert_allclose(mirrored.mean_displacement, -data.mean_displacement, rtol=2e-3)
    for name in ("mean_square_displacement", "mean_square_velocity", "contact_ratio", "mean_contact_force"):
        np.testing.assert_allclose(mirrored[name], data[name], rtol=2e-3)


def test_a_basis_is_found_and_refined():
    network = pair((1.2, 1.0), law=il.LinearContact(2.0), clearance=0.0)
    solved = il.fokker_planck(network, tolerance=0.02)
    for name in ("mean_square_displacement", "mean_square_velocity", "contact_ratio", "mean_contact_force"):
        data = solved.statistics()
        assert (data[f"{name}_error"] <= 0.02 * data[name]).all()
    assert il.fokker_planck(network, tolerance=0.02, basis=solved.basis).basis == solved.basis


def test_linear_motion_is_exact_at_any_step():
    """Far from the contact every step keeps the law of each body, at its own temperature."""
    network = pair((1.0, 0.7), clearance=9.0)
    own = propagator(network, gap=65, center=25, first=21, second=27, step=0.4)
    masses, stiffness, temperatures = (np.array(item) for item in ((1.0, 2.0), (1.0, 1.5), (1.0, 0.7)))
    shears = own.shears
    x1, x2 = own.displacements[..., None, None]
    v1 = own.velocities[0][:, None] - shears[0].last * x1
    v2 = own.velocities[1] - shears[1].last * x2
    energy = sum(
        0.5 * (k * x**2 + m * v**2) / T
        for k, m, T, x, v in zip(stiffness, masses, temperatures, (x1, x2), (v1, v2), strict=True)
    )
    density = own.normalized((np.exp(-energy) * own.grid.cells[:, None, None, None]).astype(np.float32))
    with ThreadPoolExecutor(1) as pool:
        after = March(own, pool)(density, 25)
    np.testing.assert_allclose(after, density, atol=1e-4 * density.max())
    values = Reading(own, after).values
    np.testing.assert_allclose(values["mean_square_displacement"], temperatures / stiffness, rtol=1e-4)
    np.testing.assert_allclose(values["mean_square_velocity"], temperatures / masses, rtol=1e-4)


def test_waves_of_the_gap_keep_probability():
    """A drift by the eigenvectors of a stretched grid is what the density of moved particles says."""
    own = propagator(pair(), gap=61, center=9, first=9, second=9)
    modes, grid = own.grid.modes, own.grid
    assert grid.coarse > 2.0 * grid.fine
    place, width, shift = -9.0 * grid.coarse, 2.0 * grid.coarse, 4.3 * grid.coarse

    def hill(center):
        return np.exp(-0.5 * ((grid.nodes - center) / width) ** 2) * grid.cells

    waves = (modes.onto @ hill(place)).reshape(-1, 2) @ [1.0, 1.0j] * np.exp(-1j * modes.numbers * shift)
    moved = modes.off @ np.stack([waves.real, waves.imag], axis=1).ravel()
    np.testing.assert_allclose(moved, hill(place + shift), atol=1e-4 * moved.max())
    assert moved.sum() == pytest.approx(hill(place).sum(), rel=1e-12)
    assert (modes.off @ (modes.onto @ hill(place))).sum() == pytest.approx(hill(place).sum(), rel=1e-12)


def test_nodes_are_close_where_the_contact_works():
    own = propagator(pair(law=il.HertzContact(3e4)), center=9, first=9, second=9)
    grid, well = own.grid, own.well
    assert (np.diff(grid.cells) <= 0.0).all()
    np.testing.assert_allclose(grid.at(grid.coordinate(grid.nodes)), grid.nodes, atol=1e-9 * well.width)
    assert well.penetration / grid.fine > 6.0
    assert well.width / grid.coarse > 2.0
    assert grid.nodes[grid.before] == pytest.approx(own.pair.first_node * grid.cells[grid.before], rel=2e-2)
    low, high = well.ends(own.basis.box)
    assert grid.nodes[0] == pytest.approx(low, abs=grid.coarse)
    assert grid.nodes[-1] == pytest.approx(high, abs=2.0 * grid.fine)


def test_phases_turn_complex_numbers():
    rng = np.random.default_rng(1)
    planes = rng.normal(size=(3, 2, 5, 4, 6)).astype(np.float32)
    first, second = (np.exp(1j * rng.normal(size=(3, 5, count))).astype(np.complex64) for count in (4, 6))
    expected = (planes[:, 0] + 1j * planes[:, 1]) * first[..., None] * second[..., None, :]
    turn(planes, first, second)
    np.testing.assert_allclose(planes[:, 0] + 1j * planes[:, 1], expected, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("damping", [0.01, 0.5, 5.0])
def test_shears_are_the_exact_transition(damping):
    step, (a, q) = (
        0.3,
        (item[0] for item in transition(*(np.array([value]) for value in (2.0, damping, 3.0, 0.4)), 0.3)),
    )
    parts = Shears.of(a, q, math.exp(-damping * step / 2.0))
    matrix, noise = np.eye(2), np.zeros((2, 2))
    for factor, added in (
        ([[1.0, 0.0], [-parts.first, 1.0]], 0.0),
        ([[1.0, parts.before], [0.0, 1.0]], 0.0),
        ([[1.0, 0.0], [0.0, parts.decay]], np.diag([parts.spread, parts.noise])),
        ([[1.0, parts.after], [0.0, 1.0]], 0.0),
        ([[1.0, 0.0], [-parts.last, 1.0]], 0.0),
    ):
        matrix, noise = factor @ matrix, np.array(factor) @ noise @ np.transpose(factor) + added
    np.testing.assert_allclose(matrix, a, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(noise, q, rtol=1e-9, atol=1e-14)


def test_threads_change_nothing():
    own = propagator(pair((1.5, 1.0)), gap=31, center=9, first=9, second=9)
    found = []
    for workers in (1, 3):
        with ThreadPoolExecutor(workers) as pool:
            found.append(March(own, pool)(own.start(), 3))
    np.testing.assert_array_equal(*found)


@pytest.mark.parametrize(("law", "place"), [(il.HertzContact(1.0), 0.359067), (il.LinearContact(1.0), 0.2113248654)])
def test_the_first_node_makes_sums_accurate(law, place):
    """Of the gap to the power of the force, the zeros of ζ(−3/2, ·) and of ζ(−1, ·)."""
    own = Pair.of(pair(law=law))
    assert own.first_node == pytest.approx(place, abs=1e-6)
    cells = [0.1, 0.05]
    errors = []
    for cell in cells:
        nodes = (np.arange(math.ceil(20.0 / cell)) + own.first_node) * cell
        sums = (own.force(nodes) * np.exp(-nodes)).sum() * cell
        power = 1.5 if place > 0.3 else 1.0
        errors.append(abs(sums / math.gamma(power + 1.0) - 1.0))
    assert errors[1] < errors[0] / 2.0 ** (power + 1.5)


class Sticky(il.ContactLaw):
    stiffness: float = il.parameter(units="N m-1")

    @staticmethod
    def force(indentation, rate, stiffness):
        return stiffness * indentation * (1.0 + 0.1 * rate)


def changed(**parts):
    return pair().replace(**parts)


@pytest.mark.parametrize(
    ("network", "reason"),
    [
        (il.chain(3, BODIES["a"], il.HertzContact(1.0), excitation=il.WhiteNoise(1.0)), "it has 3 bodies"),
        (il.Network(BODIES), "it has the contacts none"),
        (pair(law=Sticky(stiffness=1.0)), "depends on the rate"),
        (
            changed(couplings={"rod": il.Coupling("a", "b", il.LinearCoupling(1.0))}),
            "it has couplings, rod; none are allowed",
        ),
        (
            changed(oscillators={"a": il.DuffingOscillator(damping=0.5, stiffness=1.0, cubic=1.0)}),
            "'a' has a residual force",
        ),
        (changed(oscillators={"a": il.LinearOscillator(stiffness=1.0)}), "'a' has no damping"),
        (changed(oscillators={"b": il.LinearOscillator(damping=1.0)}), "'b' has no spring"),
        (changed(excitations={"b": None}), "'b' has no noise"),
        (changed(excitations={"b": il.WhiteNoise(0.0)}), "the noise on 'b' is 0"),
        (changed(excitations={"b": il.ShinozukaNoise(1.0)}), "'b' is excited by ShinozukaNoise"),
    ],
)
def test_other_networks_are_refused_with_the_reason(network, reason):
    with pytest.raises(il.NoExactReference, match=reason):
        il.fokker_planck(network)


def test_a_grid_beyond_the_memory_is_refused(monkeypatch):
    monkeypatch.setattr(cost, "available", lambda: 1e6)
    with pytest.raises(il.NoExactReference, match=r"The grid would need .* points \(.* GB\)"):
        il.fokker_planck(pair((1.5, 1.0)))


def test_what_takes_too_long_is_refused_with_the_time_it_would_take():
    with pytest.raises(
        il.NoExactReference, match=r"Even a coarse grid would take .* points, up to .* GB and about .* s"
    ):
        il.fokker_planck(pair((1.5, 1.0)), max_seconds=1e-3)


def test_what_was_reached_in_the_time_is_returned_with_its_errors():
    """The finest grid that was foreseen to be done in time, far from the tolerance."""
    network = stiff()
    begin = time.monotonic()
    with pytest.warns(il.AccuracyWarning, match=r"The tolerance of 1e-06 was not reached in .* The next grid takes"):
        solved = il.fokker_planck(network, tolerance=1e-6, max_seconds=30.0)
    assert time.monotonic() - begin < 60.0
    assert solved.errors.together() > 1e-6
    within_errors(solved, il.exact(network).statistics())


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"basis": {"gaps": 10}}, "basis has no 'gaps'; did you mean 'gap'"),
        ({"basis": {"gap": 4}}, "basis\\['gap'\\] must be an odd number from 9 on, not 4"),
        ({"basis": {"first": 20}}, "basis\\['first'\\] must be an odd number from 3 on, not 20"),
        ({"basis": {"box": 60.0}}, "basis\\['box'\\] must be from 3 to 9 standard deviations, not 60.0"),
        ({"basis": {"step": "1"}}, "basis\\['step'\\] must be a number, not '1'"),
        ({"basis": {"step": -1.0}}, "basis\\['step'\\] must be above 0, not -1.0"),
        ({"tolerance": 0.0}, "tolerance must be a relative error from 1e-6 to 1, not 0.0"),
        ({"max_seconds": 0.0}, "max_seconds must be larger than 0 s, not 0.0"),
    ],
)
def test_arguments_are_checked(given, message):
    with pytest.raises(il.InvalidInput, match=message):
        il.fokker_planck(pair(), **given)


def test_what_is_not_a_network_is_refused():
    with pytest.raises(il.InvalidInput, match="must be an il\\.Network"):
        il.fokker_planck("pair")


def test_names_and_places_are_checked(equal):
    _, solved = equal
    with pytest.raises(il.InvalidInput, match="There is no body 'c'"):
        solved.density("c", "displacement", [0.0])
    with pytest.raises(il.InvalidInput, match="There is no quantity 'position'"):
        solved.density("a", "position", [0.0])
    with pytest.raises(il.InvalidInput, match="grid must hold finite numbers"):
        solved.density("a", "displacement", [np.nan])
    with pytest.raises(il.InvalidInput, match="two increasing numbers"):
        solved.bin_density("a", "displacement", [1.0, 0.0])


def test_a_basis_that_is_too_small_is_warned_of():
    basis = COARSE | {"center": 9, "step": 0.2}
    with pytest.warns(il.AccuracyWarning, match="With the given basis errors exceed 0.0001: gap"):
        il.fokker_planck(pair(), basis=basis)


def test_repr_and_basis(equal):
    _, solved = equal
    assert repr(solved).startswith("FokkerPlanckReference: a and b, 2.76e+05 unknowns")
    assert {name: solved.basis[name] for name in COARSE} == COARSE
    assert isinstance(Basis(**solved.basis), Basis)
