"""Basins of attraction against networks whose basins are known, and against long runs."""

import math
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import impactlab as il

OVER = "displacement:a", "velocity:a"


def struck(frequency, clearance=0.0, stiffness=1.0):
    body = il.LinearOscillator(damping=0.1, stiffness=stiffness)
    wall = il.Contact("a", il.WALL, il.RigidContact(0.8), clearance=clearance)
    return il.Network({"a": body}, {"stop": wall}, {"a": il.Harmonic(1.0, frequency=frequency)})


def wells(damping=0.4):
    return il.Network({"a": il.DoubleWellOscillator(damping=damping, cubic=1.0, repulsion=1.0)})


def test_the_wells_of_a_symmetric_network_have_half_each():
    values = {"x": np.linspace(-1.9, 1.9, 24), "v": np.linspace(-1.5, 1.5, 24)}
    found = il.basins(wells(), OVER, values, section=il.Strobe(1.0))
    assert found.period.values.tolist() == [1, 1]
    assert found.displacement.values[:, 0, 0] == pytest.approx([-1.0, 1.0], abs=1e-9)
    assert (np.abs(found.fraction - 0.5) <= 2.0 * found.fraction_standard_error).all()
    assert (found.label.values == 1 - found.label.values[::-1, ::-1]).all()


@pytest.mark.full
def test_labels_of_a_driven_double_well_are_those_of_long_paths():
    body = il.DoubleWellOscillator(damping=0.5, cubic=1.0, repulsion=1.0)
    network = il.Network({"a": body}, excitations={"a": il.Harmonic(0.25, frequency=1.0)})
    found = il.basins(network, OVER, {"x": np.linspace(-2.0, 2.0, 5), "v": np.linspace(-1.9, 1.8, 4)})
    assert found.period.values.tolist() == [1, 1]

    def rates(time, state):
        x, v = state
        return [v, x - x**3 - 0.5 * v + 0.25 * math.sin(time)]

    for x in found.x.values:
        for v in found.v.values:
            end = solve_ivp(rates, (0.0, 60.0 * math.pi), [x, v], method="DOP853", rtol=1e-11, atol=1e-11).y[0, -1]
            label = int(found.label.sel(x=x, v=v))
            assert end == pytest.approx(float(found.displacement[label, 0, 0]), abs=1e-5)


def test_all_labels_of_a_network_that_is_integrable_by_hand_are_right():
    """Between two stops that hold a body which is pushed away from the middle: the growing mode tells which one."""
    damping, push = 0.5, 1.0
    grows = (math.sqrt(damping**2 + 4 * push) + damping) / 2  # v + grows x grows: the other mode has v = -grows x
    body = il.InvertedOscillator(damping=damping, repulsion=push)
    stops = il.backlash("a", il.WALL, il.RigidContact(0.0), clearance=1.0, name="stop")
    values = {"x": np.linspace(-0.99, 0.99, 20), "v": np.linspace(-1.4, 1.4, 20)}
    found = il.basins(il.Network({"a": body}, stops), OVER, values, section=il.Strobe(2.0))
    ends = found.displacement.values[:, 0, 0]
    assert sorted(ends) == pytest.approx([-1.0, 1.0])
    x, v = np.meshgrid(*values.values(), indexing="ij")
    assert (np.sign(ends[found.label.values]) == np.sign(v + grows * x)).all()


@pytest.mark.full
def test_a_double_well_leads_where_another_solver_leads():
    """The default section, where nothing varies in time; motions that come to rest at places other than 0."""
    values = {"x": np.linspace(-2.1, 2.0, 5), "v": np.linspace(-1.9, 2.2, 4)}
    found = il.basins(wells(0.1), OVER, values)
    assert found.period.values.tolist() == [1, 1]
    assert found.displacement.values[:, 0, 0] == pytest.approx([-1.0, 1.0], abs=1e-9)

    def right_hand_side(time, state):
        x, v = state
        return v, x - x**3 - 0.1 * v

    for place in np.ndindex(found.label.shape):
        start = [values["x"][place[0]], values["v"][place[1]]]
        end = solve_ivp(right_hand_side, (0.0, 100.0), start, method="DOP853", rtol=1e-11, atol=1e-12).y[0, -1]
        assert found.label.values[place] == (end > 0.0)


def resting(law, clearance, stiffness=1.0, gravity=0.0):
    body = il.LinearOscillator(damping=0.1, stiffness=stiffness)
    pull = {"gravity": il.BaseMotion(il.ConstantForce(gravity))} if gravity else {}
    return il.Network({"a": body}, {"stop": il.Contact(il.WALL, "a", law, clearance=clearance)}, pull)


@pytest.mark.full
@pytest.mark.parametrize(
    ("network", "place"),
    [
        (resting(il.RigidContact(0.8), 1.0), 0.0),
        (resting(il.HertzContact(10.0), 1.0), 0.0),
        (resting(il.HertzContact(10.0), -0.1), brentq(lambda x: x - 10.0 * (0.1 - x) ** 1.5, 0.0, 0.1)),
        (resting(il.RigidContact(0.5), 0.0, stiffness=0.0, gravity=1.0), 0.0),
    ],
)
def test_a_rest_without_a_force_is_one_attractor(network, place):
    found = il.basins(network, OVER, {"x": np.linspace(0.0, 2.0, 8), "v": np.linspace(-2.0, 2.0, 7)})
    assert found.period.values.tolist() == [1]
    assert found.displacement.values[0, 0, 0] == pytest.approx(place, abs=1e-9)
    assert (found.label == 0).all()
    diagram = il.bifurcation(lambda gain: network, {"gain": [1.0]}, section=il.Strobe(1.3), transient=400)
    assert diagram.period.item() == 1


def test_other_starts_of_a_diagram_need_velocities():
    network = resting(il.RigidContact(0.5), -0.1)
    found = il.bifurcation(lambda gain: network, {"gain": [1.0]}, section=il.Strobe(1.0))
    assert found.displacement.values == pytest.approx(np.full(found.displacement.shape, 0.1), abs=1e-12)
    free = resting(il.RigidContact(0.5), 1.0)
    with pytest.raises(il.InvalidInput, match="stays there"):
        il.bifurcation(lambda gain: free, {"gain": [1.0]}, section=il.Strobe(1.0), starts=3)


@pytest.fixture(scope="module")
def fractal():
    values = {"x": np.linspace(-2.5, 0.5, 40), "v": np.linspace(-2.0, 2.0, 41)}
    return il.basins(struck(1.2497), OVER, values)


@pytest.mark.full
def test_labels_are_those_of_long_runs(fractal):
    chosen = np.random.default_rng(1).integers(0, fractal.label.size, 200)
    x, v = (item.values.ravel()[chosen] for item in xr_meshes(fractal))
    allowed = x <= 0.0
    assert (fractal.label.values.ravel()[chosen][~allowed] == -1).all()
    begin = {"displacement": {"a": x[allowed]}, "velocity": {"a": v[allowed]}}
    runs = il.bifurcation(struck, {"frequency": [1.2497]}, initial=begin, transient=1500, keep=60)
    labels = fractal.label.values.ravel()[chosen][allowed]
    assert (runs.period.values[0] == fractal.period.values[labels]).all()
    for label in np.unique(labels):
        period = int(fractal.period[label])
        orbit = fractal.displacement.values[label, :period, 0]
        points = runs.displacement.values[0, labels == label, -1, 0]
        assert np.abs(points[:, None] - orbit).min(axis=1).max() < 1e-6


def xr_meshes(found):
    return [found[name].broadcast_like(found.label).transpose("x", "v") for name in ("x", "v")]


def test_attractors_fractions_and_entropies(fractal):
    assert fractal.period.values.tolist() == [1, 2]
    assert fractal.impacts.values.ravel() == pytest.approx([1.0, 1.5])
    shares = [(fractal.label.values == label).sum() / (fractal.label.values >= 0).sum() for label in (0, 1)]
    assert fractal.fraction.values == pytest.approx(shares)
    assert 0.0 < fractal.basin_entropy < fractal.boundary_entropy < math.log(2)


def test_labels_do_not_depend_on_the_executor_or_the_order_of_the_grid(fractal, monkeypatch):
    values = {"x": fractal.x.values[::-1], "v": fractal.v.values[np.random.default_rng(2).permutation(41)]}
    turned = il.basins(struck(1.2497), OVER, values)
    assert (turned.label.sel(x=fractal.x, v=fractal.v).values == fractal.label.values).all()
    monkeypatch.setattr("impactlab.analysis.basins.AT_A_TIME", 300)
    given = {"x": fractal.x.values, "v": fractal.v.values}
    with ThreadPoolExecutor(3) as threads:
        assert il.basins(struck(1.2497), OVER, given, executor=threads).drop_attrs().identical(fractal.drop_attrs())


@pytest.mark.full
def test_labels_do_not_depend_on_processes(fractal):
    given = {"x": fractal.x.values, "v": fractal.v.values}
    with ProcessPoolExecutor(2) as processes:
        assert il.basins(struck(1.2497), OVER, given, executor=processes).drop_attrs().identical(fractal.drop_attrs())


def test_a_chaotic_attractor_is_known_by_its_cells():
    values = {"x": np.linspace(-2.0, 0.0, 8), "v": np.linspace(-1.0, 1.0, 8)}
    found = il.basins(struck(2.8), OVER, values, transient=200)
    assert found.period.values.tolist() == [0]
    assert (found.label == 0).all()
    assert found.fraction.item() == 1.0


@pytest.mark.full
def test_transient_chaos_is_no_attractor():
    """Gear teeth with play: two orbits of one period, reached after hundreds of periods by another solver too."""
    mesh = il.HertzContact(200.0)
    teeth = {
        "drive": il.Contact("g", il.WALL, mesh, clearance=0.1),
        "coast": il.Contact(il.WALL, "g", mesh, clearance=0.1),
    }
    gear = il.LinearOscillator(mass=1.0, damping=0.2, stiffness=0.5)
    network = il.Network({"g": gear}, teeth, {"motor": il.Source(il.Harmonic(0.6, frequency=1.3), on="g")})
    values = {"x": [-0.388888888888889, 0.0555555555555555], "v": [-0.333333333333333, 0.333333333333333]}
    found = il.basins(network, ("displacement:g", "velocity:g"), values, transient=20)
    assert found.period.values.tolist() == [1, 1]
    assert (found.label >= 0).all()


def test_basins_over_one_quantity_and_given_rest():
    found = il.basins(
        struck(1.2497), ["velocity:a"], {"v": [-1.0, 0.0, 1.0]}, initial={"displacement": {"a": -0.7}}
    )  # fmt: skip
    assert found.label.dims == ("v",)
    assert (found.label >= 0).all()


def test_rerun(fractal, tmp_path):
    il.save(fractal, tmp_path / "basins.nc")
    assert il.rerun(tmp_path / "basins.nc").drop_attrs().identical(fractal.drop_attrs())
    assert "software{impactlab" in il.citation(fractal)
    assert il.network_of(fractal).oscillators
    assert all("long_name" in item.attrs for item in fractal.variables.values() if item.dtype.kind in "if")


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"over": ["displacement:a"]}, "as many values by name"),
        ({"over": ["displacement:a", "speed:a"]}, "not 'speed:a'"),
        ({"over": ["displacement:a", "velocity:b"]}, "there is no oscillator 'b'"),
        ({"over": ["velocity:a", "velocity:a"]}, "twice"),
        ({"grid": {"x": [], "v": [0.0]}}, "has no values"),
        ({"grid": {"x": ["left"], "v": [0.0]}}, "must be real numbers"),
        ({"section": il.Strobe(1.0)}, "no whole number of periods"),
        ({"network": il.Network({"a": il.LinearOscillator()})}, "drifts"),
    ],
)
def test_bad_input(given, words):
    arguments = {"network": struck(2.0), "over": OVER, "grid": {"x": [-1.0], "v": [0.0, 1.0]}, **given}
    with pytest.raises(il.InvalidInput, match=words):
        il.basins(**arguments)


def test_an_interrupted_run_keeps_what_was_found(monkeypatch):
    monkeypatch.setattr("impactlab.analysis.basins.AT_A_TIME", 6)

    def interrupt(part):
        if part >= 0.3:
            raise KeyboardInterrupt

    grid = {"x": [-2.0, -1.0], "v": np.linspace(-1.0, 1.0, 6)}
    with pytest.raises(KeyboardInterrupt) as raised:
        il.basins(struck(1.2497), OVER, grid, progress=interrupt)
    assert (raised.value.found.label.values[0] >= 0).all()
    assert (raised.value.found.label.values[1] == -2).any()


def test_two_bodies_of_which_one_varies():
    bodies = {name: il.LinearOscillator(damping=0.2, stiffness=1.0) for name in "ab"}
    contact = {"gap": il.Contact("a", "b", il.RigidContact(0.6), clearance=0.1)}
    network = il.Network(bodies, contact, {"a": il.Harmonic(1.0, frequency=1.4)})
    found = il.basins(
        network, ["displacement:b", "velocity:a"], {"b": np.linspace(-0.5, 0.5, 5), "v": np.linspace(-1.0, 1.0, 5)}
    )  # fmt: skip
    assert (found.label.sel(b=[-0.5, -0.25]) == -1).all()
    assert (found.label.sel(b=[0.0, 0.25, 0.5]) >= 0).all()


def test_networks_that_drift_have_no_basins():
    pushed = il.Network({"a": il.LinearOscillator(damping=1.0)}, excitations={"a": il.Harmonic(1.0, frequency=1.0)})
    with pytest.raises(il.InvalidInput, match="drifts"):
        il.basins(pushed, OVER, {"x": [0.0], "v": [0.0, 1.0]})


def test_a_grid_within_a_wall_is_refused():
    with pytest.raises(il.InvalidInput, match="overlap at all starts"):
        il.basins(struck(1.25), OVER, {"x": [1.0, 2.0], "v": [0.0, 1.0]})
