"""Levels of displacements and forces: against closed forms, integrals, two laws of one pair, and simulations."""

import math

import numpy as np
import pytest
from laws import DoubleWell
from scenes import base, linear
from scipy.special import erfc

import impactlab as il
from impactlab.reference import conditions, subsystems
from impactlab.reference.reference import ExactReference, exact


class NotchedContact(il.ContactLaw):
    """A force that falls between two indentations."""

    @staticmethod
    def force(indentation):
        return 4.0 * math.sin(10.0 * indentation) + 30.0 * indentation

    @staticmethod
    def potential(indentation):
        return 0.4 * (1.0 - math.cos(10.0 * indentation)) + 15.0 * indentation**2


def gaussian(level, deviation, frequency):
    """Rate of upward crossings and probability to be above, of a Gaussian displacement."""
    rate = frequency / (2.0 * math.pi) * math.exp(-0.5 * (level / deviation) ** 2)
    return rate, 0.5 * erfc(level / deviation / math.sqrt(2.0))


@pytest.mark.parametrize("level", [0.0, -1.3, 2.0, 8.0])
def test_linear_body(level):
    frequency, deviation = 3.0, math.sqrt(math.pi / 0.2 / 27.0)
    reference = exact(linear(frequency, 0.1))
    rate, above = gaussian(level, 1.0, frequency)
    assert reference.crossing_rate("a", "displacement", level * deviation) == pytest.approx(rate, rel=1e-12)
    assert reference.exceedance_bound("a", "displacement", level * deviation) == pytest.approx(above, rel=1e-12)
    assert reference.return_level("a", "displacement", 20.0) == pytest.approx(
        deviation * math.sqrt(2.0 * math.log(20.0 * frequency / (2.0 * math.pi))), rel=1e-12
    )


def test_bound_and_estimate():
    reference = exact(linear(3.0, 0.1))
    arguments = "a", "displacement", 3.0 * math.sqrt(math.pi / 0.2 / 27.0)
    rate, above = gaussian(3.0, 1.0, 3.0)
    assert reference.exceedance_bound(*arguments, 20.0) == pytest.approx(above + 20.0 * rate, rel=1e-12)
    assert reference.exceedance_estimate(*arguments, 20.0) == pytest.approx(
        1.0 - (1.0 - above) * math.exp(-20.0 * rate), rel=1e-12
    )
    assert reference.exceedance_estimate(*arguments, 0.0) == pytest.approx(above, rel=1e-12)
    assert reference.exceedance_bound(*arguments, 1e9) == 1.0


def pair(law, clearance=0.1, swapped=False):
    """Two linear bodies at one temperature, and their law by one integral and by transfer integrals."""
    sides = ("b", "a") if swapped else ("a", "b")
    network = il.Network(
        {
            "a": il.LinearOscillator(mass=2.0, damping=0.5, stiffness=90.0),
            "b": il.LinearOscillator(mass=0.5, damping=0.5, stiffness=1.0),
        },
        {"gap": il.Contact(*sides, law, clearance=clearance)},
        dict.fromkeys("ab", il.WhiteNoise(0.5 / math.pi)),
    )
    (subsystem,) = subsystems.subsystems_of(network)
    return exact(network), ExactReference(network, (conditions.tree_law(subsystem, 1.0),))


LAWS = [il.HertzContact(2e4), il.LinearContact(1e8), il.PowerLawContact(50.0, exponent=0.5)]


@pytest.mark.full
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(
    ("clearance", "swapped"),
    [(0.1, False), *(pytest.param(*item, marks=pytest.mark.campaign) for item in ((0.1, True), (-0.7, False)))],
)
def test_levels_by_two_laws(law, clearance, swapped):
    one, other = pair(law, clearance, swapped)
    for name, quantity, time in (
        ("a", "displacement", 3.0), ("b", "displacement", 1e6), ("gap", "contact_force", 30.0),
        ("gap", "contact_force", 1e6),
    ):  # fmt: skip
        level = one.return_level(name, quantity, time)
        assert other.return_level(name, quantity, time) == pytest.approx(level, rel=1e-9)
        for reference in (one, other):
            assert reference.crossing_rate(name, quantity, level) == pytest.approx(1.0 / time, rel=1e-8)
        for part in (1.0, 0.7):
            bounds = [item.exceedance_bound(name, quantity, part * level) for item in (one, other)]
            assert bounds[0] == pytest.approx(bounds[1], rel=1e-7)
            assert bounds[0] > 0.0
    data = one.statistics()
    for reference in (one, other):
        assert reference.crossing_rate("gap", "contact_force", 0.0) == pytest.approx(data.contact_rate.item())
        assert reference.exceedance_bound("gap", "contact_force", 0.0) == pytest.approx(data.contact_ratio.item())


@pytest.mark.full
def test_force_levels_are_integrals_over_the_gap():
    """Mean force by parts: ∫ P(F > f) df; and the rate by the gap's density written out."""
    reference, _ = pair(LAWS[0])
    nodes, weights = np.polynomial.legendre.leggauss(60)
    top = reference.return_level("gap", "contact_force", 1e12)
    edges = top * np.array([0.0, 1e-6, 1e-4, 1e-2, 0.1, 0.3, 1.0])
    forces = (0.5 * (edges[1:] + edges[:-1])[:, None] + 0.5 * np.diff(edges)[:, None] * nodes).ravel()
    lengths = np.outer(0.5 * np.diff(edges), weights).ravel()
    above = [reference.exceedance_bound("gap", "contact_force", force) for force in forces]
    data = reference.statistics()
    assert lengths @ above == pytest.approx(data.mean_contact_force.item(), rel=1e-6)
    force, k = 400.0, 90.0 / 91.0
    depth = (force / 2e4) ** (2.0 / 3.0)

    def density(delta):
        return math.exp(-0.5 * k * (0.1 + delta) ** 2 - 8e3 * max(delta, 0.0) ** 2.5)

    ratio = density(depth) / density(0.0)
    found = reference.crossing_rate("gap", "contact_force", force) / data.contact_rate.item()
    assert found == pytest.approx(ratio, rel=1e-9)


def test_the_highest_of_two_peaks_counts():
    """A body that rests in one of two wells: rare levels lie above the upper one."""

    reference = exact(il.Network({"a": DoubleWell(10.0, damping=1.0)}, {}, {"a": il.WhiteNoise(1.0 / math.pi)}))
    level = reference.return_level("a", "displacement", 10.0)
    assert level > 1.0
    assert reference.crossing_rate("a", "displacement", level) == pytest.approx(0.1, rel=1e-9)
    assert reference.crossing_rate("a", "displacement", 0.0) < 0.1  # between the wells, crossed less often


def test_levels_of_a_wall_and_of_a_preload():
    """A body that a linear contact presses to a wall: Gaussian about its place while it stays closed."""
    kappa, depth = 400.0, 2.0
    body = il.LinearOscillator(damping=0.5, stiffness=100.0)
    wall = {"stop": il.Contact("a", il.WALL, il.LinearContact(kappa), clearance=-depth)}
    reference = exact(il.Network({"a": body}, wall, {"a": il.WhiteNoise(0.5 / math.pi)}))
    rest, deviation = -kappa * depth / 500.0, math.sqrt(1.0 / 500.0)
    rate, above = gaussian(3.0, 1.0, math.sqrt(500.0))
    level = rest + 3.0 * deviation
    force = kappa * (level + depth)
    for name, quantity, value in (("a", "displacement", level), ("stop", "contact_force", force)):
        assert reference.crossing_rate(name, quantity, value) == pytest.approx(rate, rel=1e-10)
        assert reference.exceedance_bound(name, quantity, value) == pytest.approx(above, rel=1e-9)
    assert reference.crossing_rate("stop", "contact_force", 1e9) == 0.0
    assert reference.exceedance_bound("stop", "contact_force", 1e9, 1e9) == 0.0


def test_onset_velocities():
    """Rayleigh's law of scale (T/μ)^½; the mean momentum of contacts is the mean force on either body."""
    reference, _ = pair(LAWS[0])
    scale = math.sqrt(1.0 / 2.0 + 1.0 / 0.5)
    grid = np.array([[-1.0, 0.0], [0.5, 4.0]])
    expected = np.maximum(grid, 0.0) / scale**2 * np.exp(-0.5 * (grid / scale) ** 2)
    np.testing.assert_allclose(reference.onset_velocity_density("gap", grid), expected, rtol=1e-13)
    walled = il.Network(
        {"a": il.LinearOscillator(mass=4.0, damping=1.0)},
        {
            "up": il.Contact("a", il.WALL, il.HertzContact(1e3), clearance=0.2),
            "down": il.Contact(il.WALL, "a", il.HertzContact(1e3), clearance=0.2),
        },
        {"a": il.WhiteNoise(1.0 / math.pi)},
    )
    v = 0.5 * 0.01 * (np.arange(2000) + 0.5)
    assert 0.005 * exact(walled).onset_velocity_density("up", v).sum() == pytest.approx(1.0, rel=1e-5)
    assert exact(walled).onset_velocity_density("up", 0.5) == pytest.approx(2.0 * math.exp(-0.5), rel=1e-12)


def share_above(network, name, level, time, realizations):
    """Part of the realizations in which a displacement exceeds a level within a time, and its standard error."""
    record = il.Trajectory(interval=0.02)
    result = il.simulate(network, time, realizations=realizations, rng=5, record=[record])
    found = (result.displacement.sel(oscillator=name).max("time").values > level).mean()
    return found, math.sqrt(found * (1.0 - found) / realizations)


@pytest.mark.full
@pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")
@pytest.mark.parametrize(
    ("network", "name", "clustered"),
    [(linear(ratio=0.5), "a", 0.0), (linear(ratio=0.02), "a", 0.4), (base(), "two", 0.05)],
)
def test_maxima_of_simulated_bodies(network, name, clustered):
    """The bound holds; the estimate is right where crossings do not cluster, too large where they do."""
    reference, time = exact(network), 20.0
    level = reference.return_level(name, "displacement", 60.0)
    found, error = share_above(network, name, level, time, 4000)
    assert found < reference.exceedance_bound(name, "displacement", level, time)
    estimate = reference.exceedance_estimate(name, "displacement", level, time)
    assert found < (1.0 - clustered) * estimate + 3.5 * error
    assert clustered or found > estimate - 3.5 * error


def test_bad_input():
    reference, _ = pair(LAWS[0])
    for arguments, message in (
        (("gap", "force", 1.0), "no quantity 'force'; allowed are 'displacement', 'contact_force'"),
        (("a", "contact_force", 1.0), "no contact 'a'"),
        (("gap", "displacement", 1.0), "no body 'gap'"),
        (("gap", "contact_force", -1.0), "must be at least 0 N"),
        (("a", "displacement", math.nan), "level must be a finite number"),
    ):
        with pytest.raises(il.InvalidInput, match=message):
            reference.crossing_rate(*arguments)
    with pytest.raises(il.InvalidInput, match="positive time"):
        reference.return_level("a", "displacement", 0.0)
    with pytest.raises(il.InvalidInput, match=r"less than once in 1e-06 s, at most once in [0-9.]+ s; give a longer"):
        reference.return_level("gap", "contact_force", 1e-6)
    with pytest.raises(il.InvalidInput, match="at least 0 s, not -1"):
        reference.exceedance_bound("a", "displacement", 1.0, -1.0)
    with pytest.raises(il.NoExactReference, match="too rare"):
        reference.return_level("a", "displacement", 1e300)
    notched, _ = pair(NotchedContact())
    with pytest.raises(il.NoExactReference, match="force of contact 'gap' decreases with the indentation"):
        notched.return_level("gap", "contact_force", 10.0)


@pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")
def test_crossings_of_a_simulated_pair_are_counted():
    """Of displacements and forces, at steps of a sixth of the automatic one, so that few are missed."""
    network, count, time = base(), 96, 20.0
    record = il.Trajectory(interval=1e-3)
    result = il.simulate(network, time, step=1e-3, realizations=count, rng=6, record=[record])
    reference = exact(network)
    for name, quantity, variable, period in (
        ("one", "displacement", result.displacement, 1.0),
        ("two", "displacement", result.displacement, 3.0),
        ("gap", "contact_force", result.contact_force, 1.0),
        ("gap", "contact_force", result.contact_force, 5.0),
    ):
        level = reference.return_level(name, quantity, period)
        above = variable.sel({variable.dims[-1]: name}).values > level
        crossings = (above[:, 1:] & ~above[:, :-1]).sum(axis=1)
        error = crossings.std(ddof=1) / math.sqrt(count)
        assert abs(crossings.mean() - time / period) < 3.5 * error, (name, quantity, period)
        assert error < 0.1 * time / period


@pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")
def test_onset_velocities_of_a_simulated_pair():
    """Relative velocities at the samples before contacts close, against Rayleigh's law: mean and mean square."""
    network = base()
    record = il.Trajectory(interval=1e-3)
    result = il.simulate(network, 20.0, step=1e-3, realizations=96, rng=7, record=[record])
    gap = result.displacement.values[..., 0] - result.displacement.values[..., 1] - 0.05
    velocity = result.velocity.values[..., 0] - result.velocity.values[..., 1]
    onset = (gap[:, 1:] > 0.0) & (gap[:, :-1] <= 0.0)
    found = velocity[:, :-1][onset]
    v = np.linspace(0.0, 20.0, 4001)
    density = exact(network).onset_velocity_density("gap", v)
    for power in (1, 2):
        expected = np.trapezoid(v**power * density, v)
        error = (found**power).std() / math.sqrt(found.size)
        assert abs((found**power).mean() - expected) < 3.5 * error
    assert found.size > 3000
