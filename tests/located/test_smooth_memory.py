"""Laws with states that follow displacements beside smooth contacts, against SciPy's DOP853 with events."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import impactlab as il
from impactlab.located.turning import follows_exactly

pytestmark = pytest.mark.full

TIMES = np.arange(0.0, 80.5, 2.0)


def load(t):
    return math.sin(0.8 * t)


def with_law(law, contact=None):
    """Return a driven body with a coupling to the ground, and a stop."""
    return il.Network(
        oscillators={"a": il.LinearOscillator(mass=1.0, damping=0.1, stiffness=0.5)},
        contacts={"stop": il.Contact("a", il.WALL, contact or il.HertzContact(100.0), clearance=0.2)},
        couplings={"c": il.Coupling(il.WALL, "a", law)},
        excitations={"a": il.Harmonic(1.0, frequency=0.8)},
    )


def followed(network):
    record = il.Trajectory(2.0)
    return il.simulate(network, 80.0, record=record, integrator=il.EventLocated(), initial="rest")


def solved(y, first, modes):
    """Solve an equation in pieces at `TIMES`: a mode has rates, and events with their directions and what follows."""
    y, now, mode, result, count = np.array(y, dtype=float), 0.0, first, [np.array(y, dtype=float)], 0
    for target in TIMES[1:]:
        while now < target:
            rates, events = modes(mode)
            watched = []
            for event, way, _ in events:
                watched.append(lambda t, y, event=event: event(t, y))
                watched[-1].terminal, watched[-1].direction = True, way
            options = {"method": "DOP853", "rtol": 3e-14, "atol": 1e-15, "max_step": 0.1}
            found = solve_ivp(rates, (now, target), y, events=watched, **options)
            now, y = found.t[-1], found.y[:, -1]
            for (_, _, follows), hits in zip(events, found.t_events, strict=True):
                if len(hits):
                    mode, count = follows(y), count + 1
        result.append(y)
    return np.array(result), count


@pytest.mark.parametrize("exponent", [1.0, 2.0, 1.5])
def test_bouc_wen_beside_a_stop(exponent):
    """The hysteretic force of a coupling, whose rate turns with the velocity and has a kink at 0."""
    law = il.BoucWenCoupling(2.0, yield_displacement=0.3, ratio=0.1, exponent=exponent, shape=0.6)
    result = followed(with_law(law))

    def modes(mode):
        closed, way, side = mode

        def rates(t, y):
            x, v, z = y
            push = 100.0 * max(x - 0.2, 0.0) ** 1.5 if closed else 0.0
            pull = 2.0 * (0.1 * x + 0.9 * 0.3 * z)
            size = max(side * z, 0.0) ** exponent
            grow = (v - (0.6 * way * v * side + 0.4 * v) * size) / 0.3
            return [v, load(t) - 0.1 * v - 0.5 * x - pull - push, grow]

        return rates, [
            (lambda t, y: y[0] - 0.2, -1.0 if closed else 1.0, lambda y: (not closed, way, side)),
            (lambda t, y: y[1], -way, lambda y: (closed, -way, side)),
            (lambda t, y: y[2], -side, lambda y: (closed, way, -side)),
        ]

    wanted, _ = solved([0.0, 0.0, 0.0], (False, 1.0, 1.0), modes)
    assert result.events > 60
    error = np.abs(result.displacement[0, :, 0] - wanted[:, 0]).max()
    assert error < 1e-9
    assert error < result.path_error < 1e-7
    assert np.abs(result.law_state[0].sel(state="c.hysteretic") - wanted[:, 2]).max() < 1e-8


def test_a_slider_beside_a_stop():
    """A spring in series with dry friction: it sticks where its extension turns, and slips at its limit."""
    result = followed(with_law(il.JenkinsCoupling(3.0, slip_force=0.25)))

    def modes(mode):
        closed, slips = mode

        def rates(t, y):
            x, v, pull = y
            push = 100.0 * max(x - 0.2, 0.0) ** 1.5 if closed else 0.0
            return [v, load(t) - 0.1 * v - 0.5 * x - pull - push, 0.0 if slips else 3.0 * v]

        events = [(lambda t, y: y[0] - 0.2, -1.0 if closed else 1.0, lambda y: (not closed, slips))]
        if slips:
            events.append((lambda t, y: y[1], -slips, lambda y: (closed, 0.0)))
        else:
            events += [
                (lambda t, y, way=way: way * y[2] - 0.25, 1.0, lambda y, way=way: (closed, way)) for way in (1.0, -1.0)
            ]
        return rates, events

    wanted, _ = solved([0.0, 0.0, 0.0], (False, 0.0), modes)
    assert result.events > 60
    assert np.abs(result.displacement[0, :, 0] - wanted[:, 0]).max() < 1e-9
    assert np.abs(result.law_state[0].sel(state="c.pull") - wanted[:, 2]).max() < 1e-8


def test_a_contact_that_yields():
    """Loading, unloading on a stiffer line, and no force before it opens; the next contact has a fresh surface."""
    cubic = il.CubicCoupling(0.7)
    result = followed(with_law(cubic, il.WaltonBraunContact(60.0, unloading=90.0)))

    def modes(mode):
        phase, largest = mode  # 0 open, 1 on the first loading, 2 on the line of unloading, 3 without a force

        def rates(t, y):
            x, v = y
            depth = x - 0.2
            push = (0.0, 60.0 * depth, 60.0 * largest - 90.0 * (largest - depth), 0.0)[phase]
            return [v, load(t) - 0.1 * v - 0.5 * x - 0.7 * x**3 - push]

        gap, turn = (lambda t, y: y[0] - 0.2), (lambda t, y: y[1])
        if phase == 0:
            return rates, [(gap, 1.0, lambda y: (1, 0.0))]
        if phase == 1:
            return rates, [(turn, -1.0, lambda y: (2, y[0] - 0.2))]
        vanishes = lambda t, y: y[0] - 0.2 - largest / 3.0  # noqa: E731
        if phase == 2:
            again = lambda t, y: y[0] - 0.2 - largest  # noqa: E731
            return rates, [(vanishes, -1.0, lambda y: (3, largest)), (again, 1.0, lambda y: (1, largest))]
        return rates, [(gap, -1.0, lambda y: (0, 0.0)), (vanishes, 1.0, lambda y: (2, largest))]

    wanted, count = solved([0.0, 0.0], (0, 0.0), modes)
    assert count > 80
    assert np.abs(result.displacement[0, :, 0] - wanted[:, 0]).max() < 1e-9


def test_a_contact_that_remembers_how_fast_it_closed():
    """The damping of each impact follows from its closing velocity, so that the leaving velocity does."""
    law = il.FloresContact(1e4, restitution=0.7)
    free = il.Network(
        oscillators={"a": il.LinearOscillator(mass=1.0, damping=0.0, stiffness=0.0)},
        contacts={"stop": il.Contact("a", il.WALL, law, clearance=0.0)},
    )
    start = {"displacement": {"a": -0.1}, "velocity": {"a": 1.3}}
    data = il.simulate(free, 1.0, initial=start, record=il.Impacts(), integrator=il.EventLocated())
    # with χ of Hunt and Crossley: (1 + e) χ v = ln((1 + χ v)/(1 − e χ v))
    loss, low, high = law.loss, 0.0, 1.0
    for _ in range(100):
        middle = 0.5 * (low + high)
        beyond = (
            (1.0 + middle) * loss > math.log((1.0 + loss) / (1.0 - middle * loss)) if middle * loss < 1.0 else False
        )
        low, high = (middle, high) if beyond else (low, middle)
    assert data.impact_leaving_velocity.item() == pytest.approx(1.3 * low, rel=1e-9)
    assert data.impact_lost_energy.item() == pytest.approx(0.5 * 1.3**2 * (1.0 - low**2), rel=1e-9)


@pytest.mark.parametrize(
    ("law", "exact"),
    [
        (il.JenkinsCoupling(3.0, slip_force=0.5), True),
        (il.BoucWenCoupling(2.0, yield_displacement=0.3), True),
        (il.BoucWenCoupling(2.0, yield_displacement=0.3, exponent=2.0), False),
        (il.WaltonBraunContact(1e2, unloading=2e2), True),
        (il.ThorntonContact(1e3, yield_indentation=1e-3), True),
        (il.LankaraniNikraveshContact(1e3, restitution=0.5), True),
    ],
)
def test_laws_that_are_exact_between_turns(law, exact):
    assert follows_exactly(law) is exact
