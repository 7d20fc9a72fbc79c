"""Paths without noise: run time against error of located events, of steps, of DOP853 with events, and of a loop."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numba
import numpy as np
import xarray as xr

import impactlab as il

if TYPE_CHECKING:
    from impactlab_numerics.work_precision.study import WorkPrecisionStudy

FREQUENCY, AMPLITUDE, DAMPING, CLEARANCE = 0.8, 0.7, 0.1, 0.2
"""Of the driven stop of unit mass and unit stiffness, whose motion is periodic after a while."""

PERIOD = 2.0 * math.pi / FREQUENCY

SPRING, HERTZ, RESTITUTION = 60.0, 100.0, 0.8

TIGHT = 1e-13
"""Relative tolerance of the path that others are compared with."""

TOLERANCES = 1e-6, 1e-8, 1e-10
STEPS = 100, 1000, 10_000
"""Steps of a period."""


class Path(NamedTuple):
    """A way to a path: displacements at the end of each of some periods."""

    network: str
    line: str
    fineness: str
    run: Callable[[int], np.ndarray]


def stops() -> dict[str, il.ContactLaw]:
    """Return the laws of the stops by name."""
    return {
        "linear stop": il.LinearContact(SPRING),
        "Hertz stop": il.HertzContact(HERTZ),
        "rigid stop": il.RigidContact(RESTITUTION),
    }


def network_of(law: il.ContactLaw) -> il.Network:
    """Return the driven stop with a law."""
    return il.Network(
        {"body": il.LinearOscillator(mass=1.0, damping=DAMPING, stiffness=1.0)},
        {"stop": il.Contact("body", il.WALL, law, clearance=CLEARANCE)},
        {"body": il.Harmonic(AMPLITUDE, frequency=FREQUENCY)},
    )


def ways() -> Iterator[Path]:
    """Yield the ways to the paths of all stops."""
    for name, law in stops().items():
        network = network_of(law)
        for tolerance in TOLERANCES if name == "Hertz stop" else (1e-10,):
            method = il.EventLocated(tolerance)
            yield Path(name, "impactlab: located events", f"{tolerance:g}", _simulated(network, integrator=method))
        for steps in STEPS[:2]:
            options = {"integrator": il.ExactFlow(measured=False), "step": PERIOD / steps}
            yield Path(name, "impactlab: exact flow", f"{steps} steps", _simulated(network, **options))
        for tolerance in TOLERANCES:
            yield Path(name, "scipy: DOP853 with events", f"{tolerance:g}", _solved(network, tolerance))
        for steps in STEPS:
            yield Path(name, "numba: Runge–Kutta", f"{steps} steps", _looped(law, steps))


def paths(study: WorkPrecisionStudy) -> xr.Dataset:
    """Run all ways, in rounds; return errors of the displacements and processor times of whole calls, on one core."""
    known = {name: _solved(network_of(law), TIGHT)(study.periods) for name, law in stops().items()}
    cases, errors = list(ways()), []
    for way in cases:  # the first calls compile
        errors.append(float(np.abs(way.run(study.periods) - known[way.network]).max()))
    seconds = np.array([[_timed(way, study.periods) for way in cases] for _ in range(study.rounds)])
    data: dict[str, Any] = {
        name: ("case", [getattr(way, name) for way in cases], {"long_name": text})
        for name, text in (("network", "network"), ("line", "method"), ("fineness", "tolerance, or steps of a period"))
    }
    data["error"] = "case", errors, {"units": "m", "long_name": "largest error of a displacement at ends of periods"}
    data["seconds"] = "case", np.median(seconds, axis=0), {"units": "s", "long_name": "processor time of the call"}
    return xr.Dataset(data, attrs={"periods": study.periods})


def _timed(way: Path, periods: int) -> float:
    begin = time.process_time()
    way.run(periods)
    return time.process_time() - begin


def _simulated(network: il.Network, **options: Any) -> Callable[[int], np.ndarray]:
    """Return the call of `simulate`."""

    def run(periods: int) -> np.ndarray:
        record = il.Trajectory(PERIOD)
        result = il.simulate(network, periods * PERIOD, initial="rest", record=record, progress=False, **options)
        found: np.ndarray = result["displacement"].values.ravel()[1:]
        return found

    return run


def _solved(network: il.Network, tolerance: float) -> Callable[[int], np.ndarray]:
    """Return the call of SciPy's solver, piece by piece, each of which ends where the stop opens or closes."""
    from scipy.integrate import solve_ivp

    law, damping = network.contacts["stop"].law, network.oscillators["body"].damping  # type: ignore[attr-defined]
    rigid = isinstance(law, il.RigidContact)
    right_side = None if rigid else network.compile().rhs

    def free(t: float, y: np.ndarray) -> list[float]:
        return [y[1], AMPLITUDE * math.sin(FREQUENCY * t) - damping * y[1] - y[0]]

    def gap(t: float, y: np.ndarray) -> float:
        return float(y[0]) - CLEARANCE

    gap.terminal = True  # type: ignore[attr-defined]

    def run(periods: int) -> np.ndarray:
        ends = PERIOD * np.arange(1, periods + 1)
        now, y, closed, found = 0.0, np.zeros(2), False, np.empty(periods)
        while now < ends[-1]:
            gap.direction = -1.0 if closed else 1.0  # type: ignore[attr-defined]
            within = ends[ends > now]
            options = {"t_eval": within, "events": gap, "rtol": tolerance, "atol": 1e-3 * tolerance}
            piece = solve_ivp(right_side if closed else free, (now, ends[-1]), y, "DOP853", **options)
            found[periods - len(within) : periods - len(within) + len(piece.t)] = piece.y[0] if len(piece.t) else []
            if piece.status != 1:
                break
            now, y = float(piece.t_events[0][0]), piece.y_events[0][0].copy()
            if rigid:
                y[1] = -law.restitution * y[1]  # type: ignore[attr-defined]
            else:
                closed = not closed
        return found

    return run


@numba.njit(cache=False)  # type: ignore[untyped-decorator]
def _runge_kutta(periods, steps, spring, exponent, restitution):  # type: ignore[no-untyped-def]
    """Return displacements at the ends of periods, as many write it; an impact follows a step that went too far."""
    x, v, h, found = 0.0, 0.0, PERIOD / steps, np.empty(periods)
    for period in range(periods):
        for number in range(steps):
            time, p, q, dx, dv = (period * steps + number) * h, 0.0, 0.0, 0.0, 0.0
            for share, weight in ((0.0, 1.0), (0.5, 2.0), (0.5, 2.0), (1.0, 1.0)):
                a, b = x + share * h * p, v + share * h * q
                force = spring * max(a - CLEARANCE, 0.0) ** exponent if spring else 0.0
                p, q = b, AMPLITUDE * math.sin(FREQUENCY * (time + share * h)) - DAMPING * b - a - force
                dx, dv = dx + weight * p, dv + weight * q
            x, v = x + h * dx / 6.0, v + h * dv / 6.0
            if not spring and x > CLEARANCE and v > 0.0:
                v = -restitution * v
        found[period] = x
    return found


def _looped(law: il.ContactLaw, steps: int) -> Callable[[int], np.ndarray]:
    """Return the call of the loop by hand."""
    numbers = {il.LinearContact: (SPRING, 1.0, 0.0), il.HertzContact: (HERTZ, 1.5, 0.0)}.get(type(law))
    spring, exponent, restitution = numbers or (0.0, 1.0, RESTITUTION)

    def run(periods: int) -> np.ndarray:
        found: np.ndarray = _runge_kutta(periods, steps, spring, exponent, restitution)
        return found

    return run
