"""Numbers do not depend on how an ensemble runs; interrupts, divergence and progress."""

import concurrent.futures
import itertools
import json
import math
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from laws import DampedCubicCoupling, RunawayContact
from scenes import base, linear

import impactlab as il
from impactlab.machine import tuned
from impactlab.results.dataset import CONFIGURATION
from impactlab.simulation import first_states

RECORDS = (il.Density(bins=20), il.Trajectory(0.05), il.PerRealization())


class UndefinedOscillator(il.Oscillator):
    """Has no force beyond a displacement."""

    end: float = il.parameter(units="m")

    @staticmethod
    def residual(displacement, end):
        return math.sqrt(end - displacement) if displacement < end else math.nan


def run(network=None, realizations=20, **options):
    return il.simulate(network or base(), 0.5, realizations=realizations, **{"rng": 1, "spin_up": 0.5, **options})


def assert_same(first, second):
    assert set(first.variables) == set(second.variables)
    for name in first.variables:
        np.testing.assert_array_equal(first[name].values, second[name].values, err_msg=name)


pytestmark = pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")


@pytest.mark.parametrize("workers", [1, 2, 5])
def test_threads_do_not_change_the_numbers(workers):
    with concurrent.futures.ThreadPoolExecutor(workers) as pool:
        assert_same(run(record=RECORDS), run(record=RECORDS, executor=pool))


def test_processes_do_not_change_the_numbers():
    with concurrent.futures.ProcessPoolExecutor(2) as pool:
        assert_same(run(record=RECORDS), run(record=RECORDS, executor=pool))


@pytest.mark.parametrize("lanes", [1, 3, 8, 16])
def test_block_sizes_do_not_change_the_numbers(lanes):
    expected = run(record=RECORDS)
    with tuned(lanes=lanes):
        assert_same(expected, run(record=RECORDS))


@pytest.mark.full
@pytest.mark.parametrize(
    ("integrator", "step"), [(il.ExactFlow(), 5e-3), (il.RungeKutta4(), 1e-3), (il.EulerMaruyama(), 5e-5)]
)
@pytest.mark.parametrize("noise", [il.WhiteNoise(1.0), il.ShinozukaNoise(1.0, band=(0.0, 20.0), components=400)])
def test_a_realization_is_the_same_alone_and_among_many(integrator, step, noise):
    network = base().replace(excitations={"one": noise, "two": noise})
    options = {"integrator": integrator, "record": il.PerRealization(), "step": step}
    many = run(network, 12, **options)
    for count in (1, 5):
        few = run(network, count, **options)
        for name in few:
            if name.endswith("_by_realization"):
                np.testing.assert_array_equal(few[name], many[name][:count], err_msg=name)


def everything():
    """Twelve bodies in a row with more contacts across, of several kinds, and all that a loop can hold."""
    soft = il.LinearOscillator.from_frequency(6.28, 0.1)
    cubic = il.DuffingOscillator(mass=1.0, damping=0.3, stiffness=3.0, cubic=2.0)
    names = "abcdefghijkl"
    hertz = il.HertzContact(1e4)
    pairs = [*itertools.pairwise(names), ("a", "l"), ("c", "a"), (il.WALL, "d"), ("f", "a")]
    laws = [hertz] * 12 + [
        il.LinearContact(1e3),
        il.HertzContact(2e4),
        hertz,
        il.HuntCrossleyContact(1e4, dissipation=0.3),
    ]
    contacts = {
        str(k): il.Contact(*pair, law, clearance=0.02) for k, (pair, law) in enumerate(zip(pairs, laws, strict=False))
    }
    couplings = {
        "cubic": il.Coupling("a", "e", DampedCubicCoupling(3.0, damping=0.1)),
        "more": il.Coupling("b", "e", DampedCubicCoupling(4.0, damping=0.1)),
        "stiff": il.Coupling("g", "h", il.LinearCoupling(5000.0, damping=1.0)),
        "soft": il.Coupling("g", "i", il.LinearCoupling(2.0)),
    }
    excitations = {name: il.WhiteNoise(2.0) for name in "acdegk"}
    excitations |= {"b": il.Harmonic(2.0, frequency=3.0), "l": il.ShinozukaNoise(1.0, band=(0.0, 8.0), components=100)}
    return il.Network({name: cubic if name in "dej" else soft for name in names}, contacts, excitations, couplings)


@pytest.mark.full
@pytest.mark.parametrize(
    "integrator", [il.ExactFlow(measured=False), il.RungeKutta4()], ids=lambda item: type(item).__name__
)
def test_blocks_of_one_lane_give_the_same_bits(integrator):
    """Their loops run over bodies, and come from the same text."""
    options = {"integrator": integrator, "step": 1e-3, "realizations": 3, "record": RECORDS}
    together = run(everything(), **options)
    with tuned(single_lane_bodies=1, single_lane_steps=0.0):
        assert_same(together, run(everything(), **options))


def test_the_length_of_a_compiled_call_does_not_change_the_numbers():
    expected = run(record=RECORDS)
    with tuned(call_seconds=2e-5):
        assert_same(expected, run(record=RECORDS))


def test_a_longer_run_begins_like_a_shorter_one():
    short = il.simulate(base(), 0.5, rng=1, step=5e-3, record=il.Trajectory(0.05))
    long = il.simulate(base(), 1.0, rng=1, step=5e-3, record=il.Trajectory(0.05))
    np.testing.assert_array_equal(short.displacement, long.displacement[:, : short.sizes["time"]])


def test_another_body_does_not_change_the_noise():
    """Names key the streams: order, number and contacts of other bodies do not matter."""
    network = base().replace(contacts={"gap": None})
    third = il.LinearOscillator.from_frequency(5.0, 0.2)
    larger = il.Network(
        {"third": third, **network.oscillators},
        excitations={"third": il.WhiteNoise(3.0), **network.excitations},
    )
    options = {"step": 5e-3, "spin_up": 1.0, "record": il.Trajectory(0.05)}
    names = ["one", "two"]
    few, many = run(network, **options), run(larger, **options)
    np.testing.assert_array_equal(few.displacement, many.displacement.sel(oscillator=names))
    alone = run(network.replace(oscillators={"two": None}, excitations={"two": None}), **options)
    np.testing.assert_array_equal(alone.displacement[:, :, 0], many.displacement.sel(oscillator="one"))


def test_equal_bodies_have_different_noise():
    body = il.LinearOscillator.from_frequency(2.0 * np.pi, 0.1)
    noise = il.WhiteNoise(1.0)
    ds = run(il.Network({"a": body, "b": body}, excitations={"a": noise, "b": noise}), 300, record=il.Trajectory(0.5))
    a, b = ds.displacement.values[:, -1].T
    assert abs(np.corrcoef(a, b)[0, 1]) * np.sqrt(300) < 4.0


def test_seeds_matter_and_are_kept():
    first, again, other = run(), run(), run(rng=2)
    assert_same(first, again)
    assert (first.mean_displacement != other.mean_displacement).all()


@pytest.mark.parametrize("rng", [None, 5])
def test_rerun_gives_the_same_numbers(rng, tmp_path):
    ds = run(record=RECORDS, rng=rng, initial="rest")
    assert_same(ds, il.rerun(ds))
    il.save(ds, tmp_path / "result.nc")
    again = il.rerun(tmp_path / "result.nc")
    assert_same(ds, again)
    assert again.attrs["impactlab_configuration"] == ds.attrs["impactlab_configuration"]


def test_rerun_of_a_start_at_rest_that_an_older_version_let_spin_up():
    """Its spin-up is stored with the result, but not among the options."""
    ds = run(initial="rest", spin_up=0.1)
    stored = json.loads(ds.attrs[CONFIGURATION])
    now = run(initial="rest", spin_up=None)
    assert json.loads(now.attrs[CONFIGURATION])["simulate"]["spin_up"] == now.spin_up == 0.0
    stored["simulate"]["spin_up"] = None
    assert_same(ds, il.rerun(ds.assign_attrs({CONFIGURATION: json.dumps(stored)})))


@pytest.mark.parametrize(
    "options",
    [
        {"integrator": il.RungeKutta4(), "step": 1e-3},
        {"initial": {"displacement": {"two": 0.2}, "velocity": {"one": -3.0}}},
        {"record": [il.JointDensity("one", "two", bins=7), il.Density("velocity", limits={"one": (-1.0, 1.0)})]},
    ],
)
def test_rerun_takes_every_option(options):
    ds = run(**options)
    assert_same(ds, il.rerun(ds))


CHANGES = {
    "out": (lambda c: c["simulate"].update(out="victim"), r"has the options \['duration', .* these are .*'out'"),
    "coarse": (lambda c: c["simulate"].update(coarse=True), r"these are .*'coarse'"),
    "executor": (lambda c: c["simulate"].update(executor=None), r"these are .*'executor'"),
    "missing": (lambda c: c["simulate"].pop("seed"), r"has the options .*'seed', 'spin_up', 'step'\] and no others"),
    "list": (lambda c: c.update(simulate=[1]), r"these are \[1\]"),
    "seed": (lambda c: c["simulate"].update(seed=[1, 2**64]), r"seed must be two whole numbers"),
    "seed of text": (lambda c: c["simulate"].update(seed="ab"), r"seed must be two whole numbers"),
    "record": (lambda c: c["simulate"].update(record={"a": 1}), r"records must be a list"),
    "a record": (lambda c: c["simulate"].update(record=[5]), r"data must be a mapping, not 5"),
    "integrator": (lambda c: c["simulate"].update(integrator=None), r"data must be a mapping"),
    "duration": (lambda c: c["simulate"].update(duration="long"), r"duration must be a number, not 'long'"),
    "realizations": (lambda c: c["simulate"].update(realizations=1.5), r"realizations must be a whole number"),
    "spin-up": (lambda c: c["simulate"].update(spin_up=[1]), r"spin_up must be a number"),
    "initial": (lambda c: c["simulate"].update(initial=5), r"initial must be"),
    "initial file": (lambda c: c["simulate"].update(initial="victim"), r"initial must not name a file"),
    "step": (lambda c: c["simulate"].update(step="x"), r"step must be a number"),
    "network": (lambda c: c.update(network=5), r"data must be a mapping, not 5"),
    "bodies": (lambda c: c["network"].update(oscillators=[1]), r"oscillators are stored as a mapping"),
    "body": (lambda c: c["network"]["oscillators"].update(one=1), r"data must be a mapping, not 1"),
    "cls": (lambda c: c["network"]["oscillators"]["one"].update(cls=1), r"has no field 'cls'"),
    "text": (lambda c: c.pop("text"), r"has changed since this result was made"),
}


@pytest.mark.parametrize("change", CHANGES)
def test_rerun_obeys_nothing_else_in_a_file(change, tmp_path, monkeypatch):
    """Who sends a file must not choose what is overwritten, nor get to raw errors."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "victim").write_text("precious")
    ds = run()
    configuration = json.loads(ds.attrs["impactlab_configuration"])
    alter, message = CHANGES[change]
    alter(configuration)
    ds.attrs["impactlab_configuration"] = json.dumps(configuration)
    with pytest.raises(il.InvalidInput, match=message):
        il.rerun(ds)
    assert [(file.name, file.read_text()) for file in tmp_path.iterdir()] == [("victim", "precious")]


@pytest.mark.parametrize("text", ["{", "[1]", "5", "[" * 200_000])
def test_a_configuration_that_is_none(text):
    with pytest.raises(il.InvalidInput, match="The stored configuration"):
        il.rerun(run().assign_attrs(impactlab_configuration=text))


def test_rerun_refuses_what_is_no_simulation():
    with pytest.raises(il.InvalidInput, match=r"describes no simulation"):
        il.rerun(il.exact(base()).statistics())


# divergence


def test_divergence_is_an_error_that_says_where():
    network = linear().replace(contacts={"w": il.Contact("a", il.WALL, RunawayContact(), clearance=0.05)})
    with pytest.raises(il.Diverged, match=r"realization \d+ left the range of finite numbers at t = -?\d"):
        il.simulate(network, 100.0, realizations=8, rng=1)


@pytest.mark.full
def test_a_law_that_returns_nan_is_never_averaged_away():
    body = UndefinedOscillator(1.0, stiffness=4.0, damping=0.4)
    network = il.Network({"a": body}, excitations={"a": il.WhiteNoise(0.5)})
    with pytest.raises(il.Diverged, match=r"realization \d+ left"):
        il.simulate(network, 200.0, realizations=8, rng=1, initial="rest", step=0.05)


def test_an_executor_passes_divergence_on():
    network = linear().replace(contacts={"w": il.Contact("a", il.WALL, RunawayContact(), clearance=0.05)})
    with concurrent.futures.ThreadPoolExecutor(1) as pool, pytest.raises(il.Diverged):
        il.simulate(network, 100.0, realizations=8, rng=1, executor=pool)


# progress and interrupts


def test_progress_rises_to_one():
    parts = []
    il.simulate(base(), 50.0, realizations=64, rng=1, progress=parts.append)
    assert parts == sorted(parts)
    assert parts[-1] == 1.0
    assert all(0.0 <= part <= 1.0 for part in parts)


def test_nothing_is_printed_where_nobody_watches(capfd):
    run()
    assert capfd.readouterr() == ("", "")


def test_an_error_in_progress_stops_the_run():
    calls = []

    def fail(part):
        calls.append(part)
        raise RuntimeError("seen")

    with pytest.raises(RuntimeError, match="seen"):
        il.simulate(base(), 1e5, realizations=256, rng=1, progress=fail)
    assert len(calls) == 1
    assert calls[0] < 0.1


LONG = """
import impactlab as il
body = il.LinearOscillator.from_frequency(6.0, 0.1)
network = il.chain(2, body, il.HertzContact(1e4), clearance=0.05, excitation=il.WhiteNoise(1.0))
def started(part):
    if part > 0.0:
        print("started", flush=True)
try:
    il.simulate(network, 1e7, realizations={realizations}, rng=1, spin_up=0.0, progress=started)
except KeyboardInterrupt:
    print("interrupted", flush=True)
    raise
"""


@pytest.mark.full
@pytest.mark.skipif(sys.platform == "win32", reason="Windows sends no SIGINT to one process")
@pytest.mark.parametrize("realizations", [pytest.param(1, marks=pytest.mark.campaign), 2000])
def test_interrupt_is_answered(realizations):
    process = subprocess.Popen(
        [sys.executable, "-c", LONG.format(realizations=realizations)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    try:
        assert process.stdout.readline() == "started\n"
        process.send_signal(signal.SIGINT)
        assert process.stdout.readline() == "interrupted\n"  # the run would take hours
        _, errors = process.communicate(timeout=20.0)
    finally:
        process.kill()
    assert errors.rstrip().endswith("KeyboardInterrupt")
    assert process.returncode != 0


COLD = """
import impactlab as il
from impactlab.simulation import block
usual = block.build
def build(text):
    print("compiles\\n", end="", flush=True)
    return usual(text)
block.build = build
body = il.LinearOscillator.from_frequency(6.0, 0.1)
network = il.chain(2, body, il.HertzContact(1e4), clearance=0.05, excitation=il.WhiteNoise(1.0))
try:
    {call}
except KeyboardInterrupt:
    print("interrupted", flush=True)
    raise
"""


@pytest.mark.full
@pytest.mark.skipif(sys.platform == "win32", reason="Windows sends no SIGINT to one process")
@pytest.mark.parametrize(
    "call",
    [
        "il.simulate(network, 10.0, realizations=64, rng=1)",
        pytest.param(
            "il.sweep(lambda c: network, dict(c=[1, 2]), duration=10.0, realizations=64, rng=1)",
            marks=pytest.mark.campaign,
        ),
    ],
    ids=["simulate", "sweep"],
)
def test_interrupt_is_answered_while_compiling(call, tmp_path):
    """Into a new cache, which takes long; a thread that compiles would have to be waited for."""
    process = subprocess.Popen(
        [sys.executable, "-c", COLD.format(call=call)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "IMPACTLAB_CACHE": str(tmp_path / "cache")},
    )
    try:
        assert process.stdout.readline().startswith("compiles")
        process.send_signal(signal.SIGINT)
        begin = time.monotonic()
        said = next(line for line in iter(process.stdout.readline, "") if line != "compiles\n")  # of the other thread
        assert said.endswith("interrupted\n")
        assert time.monotonic() - begin < 5.0
    finally:
        process.kill()
        process.communicate()


@pytest.mark.full
@pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")
def test_a_start_that_is_hopeless_is_not_drawn_again(monkeypatch):
    """In a crowd no draw has all contacts open; the bodies start at rest after the first."""
    draws, draw = [], first_states.fill_normals

    def counted(streams, realizations, attempt, normals):
        draws.append(attempt)
        draw(streams, realizations, attempt, normals)

    monkeypatch.setattr(first_states, "fill_normals", counted)
    body = il.LinearOscillator.from_frequency(natural_frequency=6.0, damping_ratio=0.5)
    network = il.chain(200, body, il.LinearContact(10.0), clearance=0.01, excitation=il.WhiteNoise(1.0))
    result = il.simulate(network, duration=0.5, spin_up=0.0, realizations=2, rng=1, record=il.Trajectory(interval=0.5))
    assert set(draws) == {0}
    assert not result["displacement"].isel(time=0).any()
