"""Warnings of runs without noise: none that is wrong, none missing, judged by finer steps and by located paths."""

import math
import re
import warnings
from collections import Counter
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numba
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import impactlab as il
from impactlab.step_control.measured.segment_statistics import error_of_means
from impactlab.step_control.measured.segments import in_pieces

FINER = 16
"""The step of a run that judges another, as a part of the step of that."""

RIGHT, WRONG = 0.0025, 0.01
"""Bias of a statistic up to which a warning of it is wrong, and from which on one is missing."""

MOMENTS = 40_000
"""Moments at which located paths are looked at."""

COUNTED = ("step_bias", "unknown_step_bias", "chaotic_path", "several_motions")
"""Kinds of warnings that say that a statistic is not to be trusted."""


@dataclass
class Scene:
    """A run without noise."""

    name: str
    network: il.Network
    duration: float
    initial: dict
    step: float | None = None  # (s); None for the automatic one
    realizations: int = 1
    spin_up: float | None = None
    rigid: dict = field(default_factory=dict)  # what the event code takes, see `impacts`
    longest: float = math.inf  # longest step of located paths (s)
    events: bool = True  # whether closings of located paths are located

    def run(self, step=None, **options):
        """The result of steps, and the warnings."""
        options = {"integrator": il.ExactFlow()} | options
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            result = il.simulate(
                self.network, self.duration, step=step or self.step, initial=self.initial, spin_up=self.spin_up,
                realizations=self.realizations, rng=1, progress=False, **options,
            )  # fmt: skip
        return result, [item.message for item in caught if isinstance(item.message, il.AccuracyWarning)]


def scene(number):
    """One of many scenes; the same for the same number."""
    rng = np.random.default_rng([2024, number])

    def log(low, high):
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    kind = ("stop", "stop", "rigid stop", "damper", "ball", "resting", "cradle", "pair", "released", "several")[
        number % 10
    ]
    frequency, damping, force = log(0.5, 3.0), log(0.01, 0.1), log(0.2, 1.0)
    period = 2.0 * math.pi / frequency
    stiffness = log(5.0, 500.0)
    law = (
        il.LinearContact(stiffness), il.HertzContact(stiffness),
        il.KelvinVoigtContact(stiffness, damping=2.0 * log(0.02, 0.3) * math.sqrt(stiffness)),
    )[int(rng.integers(3))]  # fmt: skip
    body = il.LinearOscillator.from_frequency(1.0, damping)
    motor = {"motor": il.Source(il.Harmonic(force, frequency=frequency), on="a")}
    clearance = float(rng.uniform(0.0, 0.6))
    steps = None if rng.random() < 0.5 else int(log(60, 600))
    step = period / steps if steps else None
    wall = {"stop": il.Contact("a", il.WALL, law, clearance=clearance)}
    restitution = float(rng.uniform(0.5, 0.95))
    numbers = {"e": restitution, "force": force, "frequency": frequency}
    if kind == "stop":
        return Scene(kind, il.Network({"a": body}, wall, motor), 100.0 * period, {}, step, spin_up=50.0 * period)
    if kind == "several":
        starts = rng.normal(size=24) * 0.3 - 0.5
        initial = {"displacement": {"a": starts}}
        network = il.Network({"a": body}, wall, motor)
        return Scene(kind, network, 60.0 * period, initial, step, len(starts), 50.0 * period)
    if kind == "released":
        step = 2.0 * math.pi / steps if steps else None
        initial = {"displacement": {"a": -log(0.3, 2.0)}}
        return Scene(kind, il.Network({"a": body}, wall), log(20.0, 200.0), initial, step, spin_up=0.0)
    if kind == "rigid stop":
        network = il.Network(
            {"a": body}, {"stop": il.Contact("a", il.WALL, il.RigidContact(restitution), clearance=clearance)}, motor
        )
        rigid = {
            **numbers,
            "m": [1.0],
            "c": [2.0 * damping],
            "k": [1.0],
            "on": [1.0],
            "load": [0.0],
            "ends": [(0, -1, clearance)],
            "x": [0.0],
            "v": [0.0],
        }
        return Scene(kind, network, 100.0 * period, {}, step, spin_up=50.0 * period, rigid=rigid)
    if kind == "damper":
        mass, gap = log(0.02, 0.2), log(0.1, 2.0)
        network = il.Network(
            {"a": body, "b": il.LinearOscillator(mass=mass)},
            il.backlash("b", "a", il.RigidContact(restitution), clearance=gap, name="cavity"),
            motor,
        )
        rigid = {
            **numbers,
            "m": [1.0, mass],
            "c": [2.0 * damping, 0.0],
            "k": [1.0, 0.0],
            "on": [1.0, 0.0],
            "load": [0.0, 0.0],
            "ends": [(0, 1, gap), (1, 0, gap)],
            "x": [0.0, 0.01],
            "v": [0.0, 0.0],
        }
        return Scene(
            kind, network, 200.0 * period, {"displacement": {"b": 0.01}}, step, spin_up=100.0 * period, rigid=rigid
        )
    if kind == "ball":
        amplitude = log(1.2, 4.0) / frequency**2
        law = il.KelvinVoigtContact(k := (60.0 * frequency) ** 2, damping=0.2 * math.sqrt(k))
        network = il.Network(
            {
                "table": il.LinearOscillator(
                    mass=1e4, stiffness=1e4 * (20.0 * frequency) ** 2, damping=1e4 * 4.0 * frequency
                ),
                "b": il.LinearOscillator(),
            },
            {"hit": il.Contact("table", "b", law)},
            {
                "shaker": il.Source(
                    il.Harmonic(amplitude * 1e4 * 400.0 * frequency**2, frequency=frequency), on="table"
                ),
                "gravity": il.Source(il.ConstantForce(-1.0), on="b"),
            },
        )
        return Scene(
            kind,
            network,
            60.0 * period,
            {"displacement": {"b": log(0.5, 3.0)}},
            step and step / 8.0,
            spin_up=20.0 * period,
        )
    if kind == "resting":
        k = log(1e2, 1e4)
        network = il.Network(
            {"b": il.LinearOscillator()},
            {"floor": il.Contact(il.WALL, "b", il.KelvinVoigtContact(k, damping=log(0.1, 0.6) * math.sqrt(k)))},
            {"gravity": il.Source(il.ConstantForce(-1.0), on="b")},
        )
        long = log(3.0, 30.0)
        return Scene(
            kind,
            network,
            long,
            {"displacement": {"b": log(0.05, 0.5)}},
            2.0 * math.pi / math.sqrt(k) / log(8.0, 60.0) if steps else None,
            spin_up=float(rng.choice([0.0, 60.0])),
            longest=0.1 / math.sqrt(k),
            events=False,
        )
    if kind == "cradle":
        balls = [f"b{place}" for place in range(int(rng.integers(3, 6)))]
        law = il.HertzContact(log(1e3, 1e6)) if rng.random() < 0.6 else il.RigidContact(1.0)
        network = il.Network(
            {name: il.LinearOscillator.from_frequency(1.0) for name in balls},
            {f"c{place}": il.Contact(one, other, law) for place, (one, other) in enumerate(pairwise(balls))},
        )
        return Scene(
            kind,
            network,
            log(3.0, 30.0),
            {"displacement": {"b0": -1.0}},
            None if steps is None else log(1e-3, 1e-2),
            spin_up=0.0,
            events=False,
        )
    other = il.LinearOscillator.from_frequency(log(0.5, 2.0), damping)
    network = il.Network({"a": body, "b": other}, {"gap": il.Contact("a", "b", law, clearance=clearance)}, motor)
    return Scene(kind, network, 100.0 * period, {}, step, spin_up=50.0 * period)


def located(item):
    """Means of a scene along paths whose closings are located, by (statistic, body or contact); None where unknown."""
    if item.rigid:
        return impacts(item)
    if item.realizations > 1 or any(isinstance(one.law, il.RigidContact) for one in item.network.contacts.values()):
        return None
    compiled, names = item.network.compile(), list(item.network.oscillators)
    count, spin_up = len(names), item.spin_up or 0.0

    events = compiled.contact_events
    for event in events:
        event.terminal = True
    y = np.zeros(2 * count)
    for kind, offset in (("displacement", 0), ("velocity", count)):
        for name, value in item.initial.get(kind, {}).items():
            y[offset + names.index(name)] = value
    moments = np.linspace(0.0, item.duration, MOMENTS + 1)
    found, t, place = np.zeros((len(moments), 2 * count)), -spin_up, 0
    while place < len(moments):
        run = solve_ivp(
            compiled.rhs,
            (t, item.duration),
            y,
            "DOP853",
            rtol=1e-10,
            atol=1e-12,
            events=events if item.events else None,
            max_step=item.longest,
            dense_output=True,
        )
        last = np.searchsorted(moments, run.t[-1], side="right")
        if last > place:
            found[place:last] = run.sol(moments[place:last]).T
            place = last
        t, y = run.t[-1], run.y[:, -1]
        if run.status == 1:  # beyond the root, so that it is not found again
            ahead = 1e-9 * item.duration
            y, t = y + ahead * compiled.rhs(t, y), t + ahead
        elif run.status == 0:
            break
        else:
            return None
    means = {}
    for place, name in enumerate(names):
        x, v = found[:, place], found[:, count + place]
        means |= {
            ("mean_square_displacement", name): np.trapezoid(x**2) / MOMENTS,
            ("mean_square_velocity", name): np.trapezoid(v**2) / MOMENTS,
        }
    return means


def impacts(item):
    """The same with rigid contacts, by an own code that locates impacts."""
    r = item.rigid
    arrays = (np.array(r[name], float) for name in ("m", "c", "k", "on", "load"))
    ends = np.array([(i, j) for i, j, _ in r["ends"]]), np.array([gap for *_, gap in r["ends"]])
    period = 2.0 * math.pi / r["frequency"]
    values = _impacts(
        *arrays,
        *ends,
        r["e"],
        r["force"],
        r["frequency"],
        np.array(r["x"]),
        np.array(r["v"]),
        item.spin_up,
        item.duration,
        period / 1000,
    )
    if not np.isfinite(values).all():
        return None
    names = list(item.network.oscillators)
    return {("mean_square_displacement", name): values[0][i] for i, name in enumerate(names)} | {
        ("mean_square_velocity", name): values[1][i] for i, name in enumerate(names)
    }


@numba.njit
def _step(x, v, h, t, m, c, k, on, load, force, frequency):
    """One step of Runge and Kutta's fourth-order method."""
    k1x, k1v = v, (on * force * math.cos(frequency * t) + load - c * v - k * x) / m
    x2, v2 = x + 0.5 * h * k1x, v + 0.5 * h * k1v
    drive = on * force * math.cos(frequency * (t + 0.5 * h)) + load
    k2v = (drive - c * v2 - k * x2) / m
    x3, v3 = x + 0.5 * h * v2, v + 0.5 * h * k2v
    k3v = (drive - c * v3 - k * x3) / m
    x4, v4 = x + h * v3, v + h * k3v
    k4v = (on * force * math.cos(frequency * (t + h)) + load - c * v4 - k * x4) / m
    return x + h / 6.0 * (k1x + 2.0 * v2 + 2.0 * v3 + v4), v + h / 6.0 * (k1v + 2.0 * k2v + 2.0 * k3v + k4v)


@numba.njit
def _impacts(m, c, k, on, load, ends, gaps, e, force, frequency, x, v, spin_up, duration, h):
    """Mean squares of displacements and velocities over the duration."""
    t, xx, vv, time = -spin_up, np.zeros(len(m)), np.zeros(len(m)), 0.0
    for _ in range(round((spin_up + duration) / h)):
        left = h
        for number in range(4):
            nx, nv = _step(x, v, left, t, m, c, k, on, load, force, frequency)
            part, which = left, -1
            for contact in range(len(gaps)):
                i, j = ends[contact]
                gap = nx[i] - (nx[j] if j >= 0 else 0.0) - gaps[contact]
                rate = nv[i] - (nv[j] if j >= 0 else 0.0)
                if gap > 0.0 and rate > 0.0:
                    low, high = 0.0, left
                    for _ in range(30):
                        middle = 0.5 * (low + high)
                        mx, _v = _step(x, v, middle, t, m, c, k, on, load, force, frequency)
                        if mx[i] - (mx[j] if j >= 0 else 0.0) - gaps[contact] > 0.0:
                            high = middle
                        else:
                            low = middle
                    if low < part or which < 0:
                        part, which = low, contact
            if which >= 0:
                nx, nv = _step(x, v, part, t, m, c, k, on, load, force, frequency)
            if t >= -1e-9:
                xx += part * 0.5 * (x**2 + nx**2)
                vv += part * 0.5 * (v**2 + nv**2)
                time += part
            x, v, t, left = nx, nv, t + part, left - part
            if which < 0:
                break
            i, j = ends[which]
            bounce = 1.0 + e if number < 3 else 1.0  # of chatter no more than so many
            rate = v[i] - (v[j] if j >= 0 else 0.0)
            if j >= 0:
                inertia = 1.0 / (1.0 / m[i] + 1.0 / m[j])
                v[j] += bounce * inertia * rate / m[j]
                v[i] -= bounce * inertia * rate / m[i]
            else:
                v[i] -= bounce * rate
    return xx / time, vv / time


STATISTICS = {
    "mean_square_displacement": "oscillator",
    "mean_square_velocity": "oscillator",
    "variance_displacement": "oscillator",
    "mean_contact_force": "contact",
    "contact_ratio": "contact",
    "contact_rate": "contact",
}


def means_of(result):
    return {
        (name, label): float(result[name].sel({dimension: label}))
        for name, dimension in STATISTICS.items()
        for label in result[dimension].values.tolist()
    }


def largest(means, name):
    return max((value for (other, _), value in means.items() if other == name), default=0.0)


def judged(item):
    """Judge the warnings of a scene: verdict, what it rests on, and the largest bias."""
    result, given = item.run()
    kinds = {one.kind for one in given} & set(COUNTED)
    step = result.attrs["step"]
    plain = il.ExactFlow(measured=False)
    fine, _ = item.run(step=step / FINER, integrator=plain)
    finest, _ = item.run(step=step / (2 * FINER), integrator=plain)
    truth, values, again = means_of(fine), means_of(result), means_of(finest)
    paths = located(item)

    def off(one, other, key):
        """By how much a mean differs, as a part of itself, of what matters, and beyond what one sample makes."""
        name, label = key
        size = max(abs(other[key]), 1e-6 * largest(other, name), 1e-300)
        rate = values.get(("contact_rate", label), 0.0)
        one_more = {
            "contact_rate": 1.0 / (item.duration * max(rate, 1e-300)),
            "contact_ratio": step * rate / max(abs(other[key]), 1e-300),
        }
        return max(abs(one[key] - other[key]) / size - one_more.get(name, 0.0), 0.0)

    rigid = any(isinstance(one.law, il.RigidContact) for one in item.network.contacts.values())
    keys = [key for key in truth if not (rigid and key[0] in ("contact_rate", "contact_ratio"))]
    keys = [key for key in keys if largest(truth, key[0]) > 1e-12]
    bias = max((off(values, truth, key) for key in keys), default=0.0)
    of_all = max((off(values, truth, key) for key in truth if largest(truth, key[0]) > 1e-12), default=0.0)
    apart = max((off(again, truth, key) for key in truth if largest(truth, key[0]) > 1e-12), default=0.0)
    from_paths = max((off(truth, paths, key) for key in keys if key in paths), default=0.0) if paths else 0.0
    chaotic = max(apart, from_paths) > WRONG
    if chaotic:  # averages along three paths scatter as their statistical error
        scatter = max(apart, from_paths)
        if "step_bias" in kinds:
            verdict = "right" if bias > 3.0 * scatter else "wrong"
        else:
            verdict = "right" if kinds or bias < 5.0 * scatter else "missing"
    elif kinds:
        verdict = "right" if of_all > RIGHT or ("chaotic_path" in kinds and apart > RIGHT) else "wrong"
    else:
        verdict = "missing" if bias > WRONG else "right"
    where = max(keys, key=lambda key: off(values, truth, key), default=("", ""))
    return verdict, "chaotic" if chaotic else "regular", bias, apart, from_paths, where, step, given


def stopped(frequency, stiffness, clearance, **options):
    """A body at a linear stop under a harmonic force, in units of its period; kinds of warnings and the result."""
    body = il.LinearOscillator(mass=frequency**2, damping=0.1 * frequency, stiffness=1.0)
    wall = {"stop": il.Contact("a", il.WALL, il.LinearContact(stiffness), clearance=clearance)}
    network = il.Network({"a": body}, wall, {"a": il.Harmonic(1.0, frequency=1.0, phase=0.5 * math.pi)})
    item = Scene("stop", network, options.pop("periods") * PERIOD, {}, spin_up=50.0 * PERIOD, **options)
    result, given = item.run()
    return {one.kind: str(one) for one in given}, result


PERIOD = 2.0 * math.pi


def test_a_chaotic_path_tells_no_bias_of_the_step():
    """Its averages are those of any other path within the error that is told."""
    given, result = stopped(2.6, 50.0, 0.0, periods=100, step=PERIOD / 100)
    assert set(given) == {"chaotic_path"}
    known = float(re.search(r"known to ± ([\d.]+) % only", given["chaotic_path"])[1]) / 100.0
    assert 0.01 < known < 0.1
    _, long = stopped(2.6, 50.0, 0.0, periods=2000, step=PERIOD / 400)
    for name in ("mean_square_displacement", "mean_square_velocity"):
        assert abs(result[name].item() / long[name].item() - 1.0) < 3.0 * known
    assert long.attrs["step"] < result.attrs["step"]


@pytest.mark.full
@pytest.mark.parametrize("frequency", [0.66, 0.71, 0.88])
def test_one_sample_more_in_contact_is_no_bias(frequency):
    """Of 40 to 60 samples in each contact there is one more, or one less, at a finer step."""
    given, _ = stopped(frequency, 20.0, 0.5, periods=80, step=PERIOD / 400)
    assert not given


def test_what_is_left_of_a_motion_has_no_bias():
    wall = {"stop": il.Contact("a", il.WALL, il.LinearContact(100.0))}
    network = il.Network({"a": il.LinearOscillator.from_frequency(1.0, 0.1)}, wall)
    item = Scene("left", network, 5.0, {"displacement": {"a": -1.0}}, step=0.06, spin_up=200.0)
    result, given = item.run()
    assert result.mean_square_velocity.item() < 1e-15
    assert not given
    _, moving = replace(item, spin_up=0.0, duration=20.0).run()
    assert {one.kind for one in moving} == {"step_bias"}
    assert not any("± 0 %" in str(one) for one in moving)


def test_errors_of_averages_know_that_parts_of_a_path_are_alike():
    rng, scatter = np.random.default_rng(3), 0.3
    steps = rng.normal(size=(2000, 33))
    alike = 0.5 * (steps[:, 1:] + steps[:, :-1])  # neighbours have the correlation 1/2
    errors = error_of_means(scatter * alike[..., None], lambda freedom: 1.0)
    means = scatter * alike.mean(axis=1)
    assert errors.shape == (2000,)
    assert np.sqrt((errors**2).mean()) > 0.95 * means.std()
    lanes = rng.normal(size=(500, 4, 16))
    np.testing.assert_allclose((error_of_means(lanes, lambda freedom: 1.0) ** 2).mean(), 1.0 / 64, rtol=0.1)


def test_a_path_is_divided_into_equal_parts():
    for run in (40, 100, 6400, 6401, 99_991):
        begins, length = in_pieces(run)
        assert 16 <= len(begins) <= 32
        assert np.diff(begins).tolist() == [length] * (len(begins) - 1)
        assert 0 <= run - begins[-1] - length < 2 * 16
    assert in_pieces(20) == ((), 0)


SCENES = 20
"""Scenes that are judged: a hundred take ten minutes."""


@pytest.mark.campaign
def test_warnings_of_paths_without_noise_are_right_and_complete(capsys):
    """Random scenes of all kinds; the table of verdicts is printed."""
    table, lines = Counter(), []
    for number in range(SCENES):
        item = scene(number)
        verdict, nature, bias, *_, given = judged(item)
        warned = bool({one.kind for one in given} & set(COUNTED))
        table[item.name, nature, "warned" if warned else "silent", verdict] += 1
        if verdict != "right":
            lines.append(f"{number} {item.name} {nature} {bias:.2g}: {verdict} {[str(one) for one in given]}")
    with capsys.disabled():
        for row, count in sorted(table.items()):
            print(*row, count)
    assert not lines, "\n".join(lines)
