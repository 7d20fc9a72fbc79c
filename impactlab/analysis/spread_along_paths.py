"""How deviations from an orbit under smooth forces move along it, by differences of paths, and grow by noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from impactlab.analysis.mapped_orbits import SHIFT, MappedOrbits
from impactlab.analysis.orbit import Happening, Orbit
from impactlab.errors import InvalidInput
from impactlab.located.smooth_course import longest_step
from impactlab.quadrature import mean_rule

NODES = 4
"""Nodes of the integral of the noise in a part of a period."""

PARTS_OF_PERIOD, OF_LONGEST, PARTS_BETWEEN = 256, 0.25, 8
"""Parts of a period at least, the longest of them as a part of the longest step of a path, and parts between events."""

AROUND, SHIFTS, LONGEST_WINDOW = 1e-5, 20.0, 1e-2
"""Time before and after an event in which it happens on all paths beside the orbit: a part of the period, at least so
many times that by which it comes earlier on one of them; and the part of the period from which on it nearly grazes.
"""


@dataclass(frozen=True, eq=False)
class PathParts:
    """The motion of deviations in parts of a period that begins between events, in one of which each event is."""

    times: np.ndarray  # (part + 1,) of the ends of parts (s)
    flows: np.ndarray  # (part, 2 body, 2 body)
    growths: np.ndarray  # (part, 2 body, 2 body) covariances that noise adds
    before: list[tuple[int, np.ndarray, np.ndarray]]  # part of each event, motion and growth until it
    delays: list[np.ndarray]  # (2 body,) by which deviations before each event delay it
    velocities: list[np.ndarray]  # and change the rate of its gap

    @staticmethod
    def of(method: MappedOrbits, orbit: Orbit, density: np.ndarray) -> PathParts:
        """Return those of an orbit under noise."""
        events, period = method.happenings(orbit), float(orbit.unknowns[len(method.sizes)])
        if any(item.kind in ("rest", "release") for item in events):
            raise InvalidInput(
                "The spread of an orbit that rests at a rigid contact beside nonlinear forces is not known."
            )
        found = [_Event.of(method, orbit, place) for place in range(len(events))]
        begin = _between([item.time for item in events], period)
        whens = np.array([begin + (item.time - begin) % period for item in events])
        halves = np.array([item.half for item in found])
        times = _edges(begin, period, whens, halves, OF_LONGEST * longest_step(method.network(orbit)))
        begins, lengths = np.append(times[:-1], whens - 2.0 * halves), np.append(np.diff(times), halves)
        nodes, _ = mean_rule(NODES)
        flows = method.flows(orbit, begins, begins[:, None] + lengths[:, None] * np.append(nodes, 1.0))
        places = np.searchsorted(times, whens) - 1
        growth = np.kron(np.diag([0.0, 1.0]), density)
        added = [
            _over_events(flow[-1], growth, length) if part in places else _added(flow, growth, length)
            for part, (flow, length) in enumerate(zip(flows[: len(times) - 1], lengths, strict=False))
        ]
        before = list(zip(places.tolist(), flows[len(times) - 1 :, -1], halves[:, None, None] * growth, strict=True))
        forms = [item.delay for item in found], [item.velocity for item in found]
        return PathParts(times, flows[: len(times) - 1, -1], np.array(added), before, *forms)

    def over_a_period(self) -> tuple[np.ndarray, np.ndarray]:
        """Return how deviations move in a period, and the covariance that noise adds."""
        flow, added = np.eye(self.flows.shape[1]), np.zeros(self.flows.shape[1:])
        for step, more in zip(self.flows, self.growths, strict=True):
            flow, added = step @ flow, step @ added @ step.T + more
        return flow, added

    def along(self, start: np.ndarray, wanted: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
        """Return covariances at times, (time, 2 body, 2 body), and before each event."""
        covariances = [start]
        for step, more in zip(self.flows, self.growths, strict=True):
            covariances.append(step @ covariances[-1] @ step.T + more)
        begin, period = self.times[0], self.times[-1] - self.times[0]
        places = np.abs(self.times - (begin + (wanted - begin) % period)[:, None]).argmin(axis=1)
        found = np.array(covariances)[places]
        return found, [flow @ covariances[part] @ flow.T + more for part, flow, more in self.before]


@dataclass(frozen=True, eq=False)
class _Event:
    """An event of an orbit, and what deviations before it change."""

    half: float  # half of the time in which it happens on all paths beside the orbit (s)
    delay: np.ndarray  # (2 body,)
    velocity: np.ndarray  # (2 body,)

    @staticmethod
    def of(method: MappedOrbits, orbit: Orbit, place: int) -> _Event:
        """Return one of the events of an orbit."""
        event, period = method.happenings(orbit)[place], float(orbit.unknowns[len(method.sizes)])
        contact, bodies = method.contacts.index(event.contact), len(method.bodies)
        link = method.link(orbit, contact)
        sides = np.stack([method.state_at_event(orbit, place, after) for after in (False, True)])
        _, rates = method.gaps(orbit, contact, sides, np.full(2, event.time))
        shift = SHIFT * float(np.abs(link) @ method.sizes[:bodies])
        half = max(AROUND * period, SHIFTS * shift / max(float(np.abs(rates).min()), 1e-300))
        if half > LONGEST_WINDOW * period:
            raise InvalidInput(_grazes(event))
        early = np.array([event.time - half, event.time - 2.0 * half]) % period
        states = np.array([method.state_at(orbit, time) for time in early])
        _, (once, twice) = method.gaps(orbit, contact, states, early)
        delay = np.concatenate([link, np.zeros(bodies)]) / rates[0]
        bend = (3.0 * rates[0] - 4.0 * once + twice) / (2.0 * half)
        return _Event(half, delay, bend * delay - np.concatenate([np.zeros(bodies), link]))


def _grazes(event: Happening) -> str:
    return (
        f"The orbit nearly grazes {event.contact!r} at {event.time:.6g} s: no spread of a linear theory is known there."
    )


def _between(whens: list[float], period: float) -> float:
    """Return the time in the middle of the longest part of a period without events (s)."""
    if not whens:
        return 0.0
    times = np.sort(whens)
    lengths = np.diff(np.append(times, times[0] + period))
    longest = int(lengths.argmax())
    return float((times[longest] + 0.5 * lengths[longest]) % period)


def _edges(begin: float, period: float, whens: np.ndarray, halves: np.ndarray, longest: float) -> np.ndarray:
    """Return the ends of parts of a period, none of which is in the time of an event (s)."""
    count = PARTS_OF_PERIOD * max(1, int(np.ceil(period / longest / PARTS_OF_PERIOD)))
    even = period * np.arange(count + 1) / count
    marks = np.sort(np.concatenate([[begin], whens, [begin + period]]))
    shares = np.arange(PARTS_BETWEEN) / PARTS_BETWEEN
    finer = (marks[:-1, None] + np.diff(marks)[:, None] * shares).ravel() if len(whens) else marks
    plain = np.concatenate([begin + (even - begin) % period, finer])
    inside = (np.abs(plain[:, None] - whens) <= halves).any(axis=1)
    edges = np.concatenate([plain[~inside], [begin, begin + period]])
    borders = np.concatenate([whens - halves, whens + halves])
    within = (np.abs(borders[:, None] - whens) < halves * (1.0 - 1e-9)).any(axis=1)
    result = np.unique(np.concatenate([edges, borders[~within]]))
    return np.asarray(result[np.append(True, np.diff(result) > 1e-12 * period)])


def _added(flow: np.ndarray, growth: np.ndarray, length: float) -> np.ndarray:
    """Return the covariance that noise adds in a part, by the motion to nodes in it and to its end."""
    result, (_, shares) = np.zeros_like(growth), mean_rule(NODES)
    for there, share in zip(flow[:-1], shares, strict=True):
        onwards = np.linalg.solve(there.T, flow[-1].T).T
        result += share * length * onwards @ growth @ onwards.T
    return np.asarray(result)


def _over_events(flow: np.ndarray, growth: np.ndarray, length: float) -> np.ndarray:
    """Return the covariance that noise adds in a short time in the midst of which an event is."""
    return np.asarray(0.5 * length * (flow @ growth @ flow.T + growth))
