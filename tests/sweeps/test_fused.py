"""Points that run side by side: bit for bit what each gives alone, and alone where they must."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from laws import DampedCubicCoupling, DoubleWell, LossyContact
from scenes import base, linear, plan_of

import impactlab as il
from impactlab.assembly import members
from impactlab.assembly.mechanism import Mode
from impactlab.assembly.model import Model
from impactlab.linear import transitions
from impactlab.plan.side_by_side import Planned
from impactlab.progress import reporter
from impactlab.results.stack import Findings
from impactlab.simulation import joint_runs
from impactlab.step_control.rules import force_checks
from impactlab.step_control.rules.tangent_stiffness import Stiffening
from impactlab.sweeps.scheduler import Heard
from impactlab.sweeps.sweep import drafted, prepared, run_fused, run_side_by_side, runs_of
from impactlab.sweeps.sweep_points import Point

pytestmark = pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")


class PullingContact(il.ContactLaw):
    """Pulls, or pushes where its strength is negative."""

    strength: float = il.parameter(units="N m-1")

    @staticmethod
    def force(indentation, strength):
        return -strength * indentation


class BrittleContact(il.ContactLaw):
    """Has no force from a strength of 2 on."""

    strength: float = il.parameter(units="N m-1")

    @staticmethod
    def force(indentation, strength):
        return strength * indentation if strength < 2.0 else strength / (indentation - indentation)


ENSEMBLE = {"duration": 2.0, "realizations": 16, "spin_up": 1.0, "rng": 5}


def driven(frequency, clearance=0.5, law=il.LinearContact, stiffness=20.0, damping=0.1):
    """A body under a harmonic force before a stop."""
    return il.Network(
        {"body": il.LinearOscillator(mass=1.0, damping=damping, stiffness=1.0)},
        {"stop": il.Contact("body", il.WALL, law(stiffness), clearance=clearance)},
        {"body": il.Harmonic(1.0, frequency=frequency)},
    )


class Swell(il.Excitation):
    """White noise that begins with a jump and decays."""

    density: float = il.parameter()
    begin: float = il.parameter(0.3, units="s")

    @staticmethod
    def intensity(time, density, begin):
        return density * (0.1 if time < begin else math.exp(begin - time))


class Beat(il.Excitation):
    """A force that jumps."""

    size: float = il.parameter(units="N")
    rate: float = il.parameter(units="rad s-1")

    @staticmethod
    def force(time, size, rate):
        return size if math.sin(rate * time) > 0.0 else math.cos(time)


def modulated(density):
    """Three bodies in a row under noises that vary in time, one of which drives two, and two forces that do."""
    body = il.LinearOscillator.from_frequency(natural_frequency=10.0, damping_ratio=0.1)
    return il.Network(
        dict.fromkeys("abc", body),
        {
            "left": il.Contact("a", "b", il.HertzContact(1e4)),
            "right": il.Contact("b", "c", LossyContact(1e3, damping=1e3)),
        },
        {
            "a": Swell(density), "wind": il.Source(Swell(density, begin=density), on={"b": 1.0, "c": -0.5}),
            "b": Beat(density, rate=9.0 + density), "ground": il.Source(il.Harmonic(1.0, frequency=3.0), on={"c": 2.0}),
        },
    )  # fmt: skip


def wells(depth):
    """A body in two wells, kicked by a coupling that takes energy."""
    return il.Network(
        {"x": DoubleWell(mass=1.0, damping=0.3, depth=depth), "y": il.LinearOscillator(damping=0.5, stiffness=2.0)},
        excitations={"x": il.WhiteNoise(0.05), "y": il.WhiteNoise(0.02)},
        couplings={"link": il.Coupling("x", "y", DampedCubicCoupling(0.5, damping=0.1))},
    )


def noisy(density):
    """A body that soon forgets."""
    return linear(200.0, 0.5, density)


def run_of(make, values, **options):
    """Return points that `il.sweep` would run together, and what came of those that did."""
    points = [Point(f"{value!r}", make(value), {"rng": 1, **options}) for value in values]
    found, rest = run_side_by_side(points, None, reporter(False), Heard(), {})
    return {key: item.dataset() for key, item in found.items()}, rest


def assert_as_alone(make, values, **options):
    """All points run side by side, and have the numbers that each of them has alone."""
    found, rest = run_of(make, values, **options)
    assert rest == []
    for value in values:
        together = found[f"{value!r}"]
        same = {"step": together.attrs["step"], "spin_up": together.attrs["spin_up"]}
        alone = il.simulate(make(value), **{"rng": 1, **options, **same})
        for name in alone.variables:
            np.testing.assert_array_equal(together[name], alone[name], err_msg=f"{name} at {value}")
        assert together.attrs.keys() == alone.attrs.keys()
        for name in alone.attrs.keys() - {"history", "impactlab_configuration"}:
            np.testing.assert_array_equal(together.attrs[name], alone.attrs[name], err_msg=name)


@pytest.mark.full
@settings(max_examples=6, deadline=None)
@given(
    frequencies=st.lists(st.floats(0.5, 3.0), min_size=2, max_size=12, unique=True),
    start=st.floats(-1.0, 1.0),
    steps=st.sampled_from([37, 60]),
)
def test_a_path_is_that_of_the_point_alone(frequencies, start, steps):
    period = 2.0 * np.pi
    assert_as_alone(
        driven, frequencies, duration=3.0 * period, spin_up=2.0 * period, step=period / steps,
        initial={"displacement": {"body": start}}, record=[il.Trajectory(period), il.PeakForces()],
    )  # fmt: skip


@pytest.mark.full
@settings(max_examples=6, deadline=None)
@given(seed=st.integers(0, 2**70), first=st.floats(0.0, 0.1), realizations=st.sampled_from([3, 20]))
def test_an_ensemble_is_that_of_the_point_alone(seed, first, realizations):
    def make(clearance):
        return base(clearance=clearance)

    records = [il.Density(bins=5), il.PerRealization(), il.Trajectory(0.5), il.JointDensity("one", "two", bins=3)]
    options = {**ENSEMBLE, "realizations": realizations, "step": 4e-3, "record": records, "rng": seed}
    common = il.sweep(make, {"clearance": [first, 0.2, 0.3]}, common_random_numbers=True, **options)
    for clearance in common.clearance.values.tolist():
        alone = il.simulate(make(clearance), **options)
        for name in alone.data_vars:
            np.testing.assert_array_equal(common[name].sel(clearance=clearance), alone[name], err_msg=name)


@pytest.mark.full
@pytest.mark.parametrize(
    ("make", "values", "options"),
    [
        (base, [16.0, 17.0, 18.0], {}),
        pytest.param(modulated, [1.0, 2.0, 5.0], {"step": 5e-3}, marks=pytest.mark.campaign),
        (wells, [0.2, 0.25, 0.3], {"step": 0.02, "initial": "rest"}),
        (driven, [1.0, 1.5], {"step": 0.02, "integrator": il.RungeKutta4()}),
        (linear, [5.0, 6.0], {"integrator": il.EulerMaruyama(), "step": 2e-3}),
        (linear, [5.0, 6.0], {"step": 2e-3, "record": il.Trajectory(0.1)}),
        (
            noisy,
            [0.0, 1.0, 2.0],
            {"step": 2e-3, "duration": 13.0, "realizations": 1},
        ),  # one has nothing to estimate from
    ],
)
def test_every_kind_of_force_is_that_of_the_point_alone(make, values, options):
    assert_as_alone(make, values, **{**ENSEMBLE, **options})


@pytest.mark.full
def test_more_points_than_a_run_holds_and_steps_that_differ():
    """Steps follow from the stiffness; points of one rounded step share runs."""
    stiffness = np.linspace(1e3, 3e4, 40).tolist()

    def make(value):
        return base(contacts={"gap": il.Contact("one", "two", il.HertzContact(value), clearance=0.05)})

    options = {"duration": 1.0, "realizations": 64, "spin_up": 0.5}
    points = [Point(f"{value}", make(value), {"rng": 1, **options}) for value in stiffness]
    ready = {point.key: prepared(drafted(point)) for point in points}
    runs = runs_of(ready)
    assert 1 < len(runs) < 12
    assert all(len({ready[key].planned.plan.clock.step for key in keys}) == 1 for keys in runs)
    assert len(run_fused(ready, runs, lambda part: None)) == sum(map(len, runs)) > 30
    automatic = il.simulate(make(stiffness[7]), rng=1, **options).step
    assert automatic / 1.2 < ready[points[7].key].planned.plan.clock.step <= automatic


def test_all_cores_have_work(monkeypatch):
    """A single realization is a single block: points are then shared out among several runs."""
    frequencies = np.linspace(0.5, 3.0, 200).tolist()
    plan = plan_of(driven(1.0), duration=2.0, step=0.02)
    alike = {f"{value}": Planned(Model.of(driven(value)), plan) for value in frequencies}
    for number, sizes in ((1, [200]), (2, [100, 100]), (8, [66, 67, 67])):
        monkeypatch.setattr(joint_runs, "cores", lambda number=number: number)
        assert sorted(map(len, joint_runs.grouped(alike))) == sizes
    assert list(map(len, joint_runs.grouped(dict(list(alike.items())[:20])))) == [20]


@pytest.mark.full
def test_a_point_that_diverges_loses_no_other():
    def runaway(strength):
        law = PullingContact(strength)
        return linear().replace(contacts={"stop": il.Contact("a", il.WALL, law, clearance=0.05)})

    options = {**ENSEMBLE, "duration": 20.0, "step": 5e-3}
    ds = il.sweep(runaway, {"strength": [-50.0, 1e6, -20.0, -10.0]}, common_random_numbers=True, **options)
    assert "left the range of finite numbers" in ds.status.values[1]
    assert np.isnan(ds.contact_ratio.values[1]).all()
    for strength in (-50.0, -20.0, -10.0):
        alone = il.simulate(runaway(strength), **options)
        np.testing.assert_array_equal(ds.contact_ratio.sel(strength=strength), alone.contact_ratio)


@pytest.mark.full
def test_mixed_structures_fall_apart():
    """Points of each law run side by side; the single one of a third runs alone."""
    laws = {"hertz": il.HertzContact, "linear": il.LinearContact}

    def make(law, clearance):
        if clearance == 0.3:
            return base(
                contacts={"gap": il.Contact("one", "two", il.PowerLawContact(1e4, exponent=1.2), clearance=0.3)}
            )
        return base(contacts={"gap": il.Contact("one", "two", laws[law](1e4), clearance=clearance)})

    options = {**ENSEMBLE, "step": 4e-3}
    over = {"law": list(laws), "clearance": [0.02, 0.05, 0.3]}
    ds = il.sweep(make, over, common_random_numbers=True, **options)
    assert (ds.status == "done").all()
    for law in laws:
        for clearance in over["clearance"]:
            alone = il.simulate(make(law, clearance), **options)
            point = ds.sel(law=law, clearance=clearance)
            np.testing.assert_array_equal(point.mean_contact_force, alone.mean_contact_force)


def test_what_points_share_is_worked_out_once(monkeypatch):
    """Forces of all points are looked at together, no point has a model or a dataset of its own twice."""
    looks, models, datasets = [], [], []
    together, model_of, dataset = Stiffening.of_each, Model.of, Findings.dataset
    monkeypatch.setattr(Stiffening, "of", None)
    monkeypatch.setattr(Stiffening, "of_each", lambda *scenes: looks.append(len(scenes[0])) or together(*scenes))
    monkeypatch.setattr(Model, "of", lambda *given: models.append(1) or model_of(*given))
    monkeypatch.setattr(Findings, "dataset", lambda found: datasets.append(1) or dataset(found))
    ds = il.sweep(lambda clearance: base(clearance=clearance), {"clearance": [0.02, 0.03, 0.04, 0.05]}, **ENSEMBLE)
    assert (ds.status == "done").all()
    assert (looks, len(models), datasets) == ([4], 4, [])


def test_random_numbers_are_those_of_each_point():
    """Also its step: none depends on the other points."""
    many = il.sweep(base, {"ratio": [4.0, 8.0, 16.0, 64.0]}, **ENSEMBLE)
    for ratio in (4.0, 64.0):
        one = il.sweep(base, {"ratio": [ratio]}, **ENSEMBLE)
        np.testing.assert_array_equal(one.mean_displacement[0], many.mean_displacement.sel(ratio=ratio))
        assert one.step[0] == many.step.sel(ratio=ratio)
    assert len(np.unique(many.mean_square_displacement.sel(oscillator="two"))) == 4


@pytest.mark.full
def test_a_single_point_is_made_again():
    ds = il.sweep(driven, {"frequency": [1.0, 1.5, 2.0]}, duration=20.0, record=il.Trajectory(1.0), rng=1)
    again = il.rerun(ds.sel(frequency=1.5))
    for name in ("displacement", "mean_square_velocity", "contact_rate"):
        np.testing.assert_array_equal(again[name], ds[name].sel(frequency=1.5))


@pytest.mark.parametrize(
    ("network", "options", "reason"),
    [
        (driven(1.0, law=il.RigidContact, stiffness=0.8), {"step": 0.01}, "rigid contacts"),
        (base(clearance=2.0), {"realizations": 64}, ""),
        (
            linear().replace(excitations={"a": il.ShinozukaNoise(1.0, band=(0.0, 20.0), components=4000)}),
            {"step": 0.01}, "sums of cosines",
        ),
    ],
)  # fmt: skip
def test_what_runs_alone(network, options, reason):
    plan = plan_of(network, **options)
    assert plan.system.refusals.get(Mode.SIDE_BY_SIDE, "") == reason
    assert reason or plan.method.interval > 1
    points = [Point(key, network, {"duration": 5.0, "rng": 1, **options}) for key in "ab"]
    found, rest = run_side_by_side(points, None, reporter(False), Heard(), {})
    assert (found, rest) == ({}, points)


def test_options_of_points_that_run_alone():
    for options in ({"tolerance": {"contact_ratio": 0.5}}, {"duration": 1.0, "max_seconds": 60.0}):
        points = [Point(key, base(), {"rng": 1, **options}) for key in "ab"]
        assert run_side_by_side(points, None, reporter(False), Heard(), {}) == ({}, points)
    point = Point("a", base(), {"rng": 1, "duration": 1.0, "record": [il.FinalState()]})
    assert run_side_by_side([point, point], None, reporter(False), Heard(), {})[0] == {}


def calls_of(monkeypatch, number):
    """Return how often points of a number call what they have in common: exponentials, layouts, looks at forces."""
    calls = {"_taylor": 0, "gathering": 0, "_check": 0}

    def counting(name, original):
        def call(*arguments, **options):
            calls[name] += 1
            return original(*arguments, **options)

        return call

    def make(value):
        body = il.LinearOscillator(mass=1.0 + 0.01 * number, damping=1.0, stiffness=50.0)  # not met before
        return base(
            oscillators={"one": body}, contacts={"gap": il.Contact("one", "two", il.HertzContact(1e4), clearance=value)}
        )

    with monkeypatch.context() as patch:
        for module, name in ((transitions, "_taylor"), (members, "gathering"), (force_checks, "_check")):
            patch.setattr(module, name, counting(name, getattr(module, name)))
        found, rest = run_of(make, np.linspace(0.05, 0.06, number).tolist(), **ENSEMBLE)
    assert len(found) == number
    assert not rest
    return calls


@pytest.mark.full
def test_what_points_have_in_common_is_worked_out_once(monkeypatch):
    few, many = (calls_of(monkeypatch, number) for number in (3, 60))
    assert many["_taylor"] == few["_taylor"] < 10
    assert many["_check"] == few["_check"] == 2  # of contacts, and of others
    assert many["gathering"] < 10


@pytest.mark.full
def test_a_point_with_a_wrong_force_leaves_others_as_they_are():
    """Forces of all points are looked at together: where one has to be refused, each is looked at alone."""

    def make(strength):
        return il.Network(
            {"body": il.LinearOscillator(damping=0.2, stiffness=1.0)},
            {"stop": il.Contact("body", il.WALL, BrittleContact(strength), clearance=0.1)},
            {"body": il.WhiteNoise(0.1)},
        )

    swept = il.sweep(make, {"strength": [1.0, 3.0, 1.5]}, duration=5.0, realizations=4, step=0.01, rng=1)
    first, wrong, last = swept.status.values
    assert first == last == "done"
    assert "BrittleContact(strength=3.0)" in wrong
    alone = il.rerun(swept.sel(strength=1.5))
    np.testing.assert_array_equal(swept.mean_contact_force.sel(strength=1.5), alone.mean_contact_force)


@pytest.mark.parametrize("order", [1, -1])
def test_records_that_differ_from_point_to_point(order):
    """Snapshots of one point hold peaks between steps, those of another do not."""
    law = il.HuntCrossleyContact(5e3, dissipation=0.5)
    records = [[il.Trajectory(0.004)], [il.PeakForces()]][::order]

    def make(place):
        return base().replace(contacts={"gap": il.Contact("one", "two", law, clearance=0.05)}), {
            "record": records[place]
        }

    method = il.ExactFlow(jumps=False, measured=False)
    swept = il.sweep(make, {"place": [0, 1]}, duration=1.0, realizations=4, step=0.004, integrator=method, rng=1)
    assert set(swept.status.values.tolist()) == {"done"}
