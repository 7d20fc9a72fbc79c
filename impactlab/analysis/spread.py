"""The spread of a periodic orbit under weak white noise, by Lyapunov's equation along it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from scipy.linalg import expm, solve_discrete_lyapunov

from impactlab.analysis.described import PHASES, dataset_of, start_of, stored_start
from impactlab.analysis.itineraries import rotated
from impactlab.analysis.linear_orbits import LinearOrbits, method_of
from impactlab.analysis.mapped_orbits import MappedOrbits
from impactlab.analysis.near_returns import one_configuration, orbit_again
from impactlab.analysis.orbit import Orbit, OrbitMethod, along
from impactlab.analysis.spread_along_paths import PathParts
from impactlab.assembly.model import Model
from impactlab.components.stored import stored
from impactlab.errors import InvalidInput, warn
from impactlab.inputs import checked
from impactlab.kernels.contact_states import FRICTION, HELD, STICKS
from impactlab.kernels.shooting import BOUNCES, COMES_TO_REST, Itinerary
from impactlab.located.families import numbers_of
from impactlab.located.scenes import Linear, linear_of
from impactlab.networks.network import Network
from impactlab.results.dataset import configuration_of
from impactlab.results.labels import Variables, labelled
from impactlab.results.schema import BODY

WEAK = 0.2
"""Standard deviation, as a part of a distance to a contact or of a closing velocity, up to which noise is weak."""

SAME_NUMBERS = 1e-9
"""Part of numbers by which those of the network with noise may differ from those of the orbit."""


@checked
def orbit_spread(network: Network, orbit: xr.Dataset) -> xr.Dataset:
    """Return how far weak white noise takes a network from a periodic orbit, as covariances along it.

    The deviations are those of the linear theory: they move with the motion between events, through these by saltation
    matrices, and grow by the noise; in the long run they are Gaussian with a covariance of the period of the orbit. It
    holds while they are much smaller than the distances to other contacts, and impacts are not grazing; where they are
    not, a warning says so.

    Parameters
    ----------
    network : Network
        The network of the orbit with `WhiteNoise` on bodies of it.
    orbit : Dataset
        One stable orbit that `orbits` found for the network without noise.

    Returns
    -------
    xarray.Dataset
        Along ``phase``, at times after the beginning of a period of the force: ``covariance`` of the states,
        ``standard_deviation_displacement`` and ``standard_deviation_velocity``. For each event of the orbit, in order:
        ``event_time_standard_deviation`` (s), and ``closing_velocity_standard_deviation`` (m s-1) where a contact
        closes. The attribute ``largest_deviation`` is the largest standard deviation of a gap where it nearly closes,
        or of a closing velocity, as a part of it: the theory holds where it is small.

    Raises
    ------
    InvalidInput
        If the network is not that of the orbit with white noise, or the orbit is not stable.

    Examples
    --------
    >>> noisy = driven.replace(excitations={"noise": il.Source(il.WhiteNoise(1e-6), on="a")})
    >>> spread = il.orbit_spread(noisy, il.orbits(driven))
    >>> spread.closing_velocity_standard_deviation.values.round(6)
    array([0.003997])
    """
    configuration = one_configuration(orbit, "orbit_spread takes")
    known = Network.from_dict(configuration["network"])
    method = method_of(known)
    density = _density(network, known, method)
    found = orbit_again(method, orbit, np.zeros(1))
    largest = float(np.abs(np.linalg.eigvals(found.monodromy)).max())
    if not largest < 1.0:
        raise InvalidInput(
            f"The spread of an orbit whose largest multiplier has the size {largest:.6g} grows without end: give a "
            "stable orbit."
        )
    parts = _parts_of(method, found, density)
    start = solve_discrete_lyapunov(*parts.over_a_period())
    title = "Spread of a periodic orbit under weak white noise"
    options = {"network": configuration["network"], "start": stored_start(orbit, method)}
    stored_as = {"network": stored(network), "spread": options}
    variables, coordinates = _variables(method, found, parts, start)
    largest, where = _largest(method, found, variables)
    if largest > WEAK:
        warn(
            "strong_noise",
            f"The noise is strong: the standard deviation of {where} is {largest:.2g} of it, and the spread that of a "
            f"linear theory, for {WEAK} at most. Compare il.simulate with realizations=, or give a weaker noise.",
        )
    return dataset_of(variables, coordinates, title, stored_as, {"largest_deviation": largest})


def again(
    dataset: xr.Dataset, options: Mapping[str, Any], progress: Callable[[float], None] | None = None
) -> xr.Dataset:
    """Return a spread again from what is stored with it."""
    network = Network.from_dict(configuration_of(dataset)["network"])
    return orbit_spread(network, start_of(options["start"], options["network"]))


def _parts_of(method: LinearOrbits | MappedOrbits, orbit: Orbit, density: np.ndarray) -> _Parts | PathParts:
    """Return how deviations from an orbit move under noise."""
    if isinstance(method, MappedOrbits):
        return PathParts.of(method, orbit, density)
    return _Parts.of(method, orbit, density)


def _density(network: Network, known: Network, method: LinearOrbits | MappedOrbits) -> np.ndarray:
    """Return the growth of the covariance of velocities by white noises of a network, (body, body)."""
    model = Model.of(network)
    if model.bodies.sampled or model.noise.varying or not model.random.any():
        raise InvalidInput("The spread is that under stationary white noises, il.WhiteNoise(…), and no others.")
    free = np.flatnonzero(model.bodies.free)
    if tuple(np.array(model.bodies.names)[free].tolist()) != method.bodies:
        raise InvalidInput("The network has other bodies than that of the orbit.")
    same = _has_numbers_of(method, model) if isinstance(method, LinearOrbits) else _has_members_of(known, network)
    if not same:
        raise InvalidInput("The network is not that of the orbit with noise: masses, laws or forces differ.")
    mass = model.mass[free]
    result: np.ndarray = 2.0 * np.pi * model.noise.matrix(free) / np.outer(mass, mass)
    return result


def _has_numbers_of(method: LinearOrbits, model: Model) -> bool:
    """Whether a network is that of some orbits, by its numbers."""
    one, other = numbers_of(linear_of(model)), numbers_of(method.family.first)
    return one.shape == other.shape and bool((np.abs(one - other) <= SAME_NUMBERS * np.abs(other).max()).all())


def _has_members_of(known: Network, network: Network) -> bool:
    """Whether networks have the same bodies, contacts, couplings and given forces."""
    members = [{name: item for name, item in one.given().items() if name != "excitations"} for one in (known, network)]
    forces = [Model.of(one).sources["force"] for one in (known, network)]
    drives = [[array.tolist() for array in one.drives] for one in forces]
    return members[0] == members[1] and drives[0] == drives[1] and [*forces[0].excitations] == [*forces[1].excitations]


@dataclass(frozen=True, eq=False)
class _Parts:
    """The linear motion of deviations in the segments of an orbit, and through its events."""

    generators: list[np.ndarray]  # of each segment
    growth: list[np.ndarray]  # of covariances by noise there
    times: np.ndarray  # of the beginning, events and the end
    saltations: list[np.ndarray]  # of each event
    delays: list[np.ndarray]  # (2 body,) by which deviations before each event delay it
    velocities: list[np.ndarray]  # and change the rate of its gap

    @staticmethod
    def of(method: LinearOrbits, orbit: Orbit, density: np.ndarray) -> _Parts:
        """Return those of an orbit under noise."""
        events, size, scene = orbit.events, len(method.sizes), method.family.first
        assert isinstance(events, Itinerary)
        count = len(events.functionals)
        generators, states = method.segments(orbit)
        times = np.concatenate([[0.0], orbit.unknowns[size : size + count + 1]])
        growth = [_held_growth(scene, events.statuses[segment], density) for segment in range(count + 1)]
        saltations, delays, velocities = list[np.ndarray](), list[np.ndarray](), list[np.ndarray]()
        for event in range(count):
            before, after = states[event, 1], states[event + 1, 0]
            rate_before, rate_after = generators[event] @ before, generators[event + 1] @ after
            jump, pushed, form, bend = _jump(scene, events, event, times[event + 1], rate_before, size)
            if events.together[event]:
                delay = delays[-1] @ np.linalg.pinv(saltations[-1])
            else:
                delay = -_vanishing(method, orbit, event, before[:size]) / _rate(events, orbit, event)
            saltations.append(jump - np.outer(rate_after[:size] - pushed, delay))
            delays.append(delay)
            velocities.append(form + bend * delay)
        plain = [item[:size, :size] for item in generators]
        return _Parts(plain, growth, times, saltations, delays, velocities)

    def moved(self, segment: int, length: float) -> tuple[np.ndarray, np.ndarray]:
        """Return how deviations move in a part of a segment, and the covariance that noise adds (C. F. Van Loan)."""
        size = len(self.generators[segment])
        block = np.zeros((2 * size, 2 * size))
        block[:size, :size], block[:size, size:] = -self.generators[segment], self.growth[segment]
        block[size:, size:] = self.generators[segment].T
        whole = expm(block * length)
        flow = whole[size:, size:].T
        return flow, flow @ whole[:size, size:]

    def over_a_period(self) -> tuple[np.ndarray, np.ndarray]:
        """Return how deviations move in a period, and the covariance that noise adds."""
        size = len(self.generators[0])
        flow, added = np.eye(size), np.zeros((size, size))
        for segment in range(len(self.generators)):
            step, more = self.moved(segment, self.times[segment + 1] - self.times[segment])
            if segment < len(self.saltations):
                step, more = (
                    self.saltations[segment] @ step,
                    self.saltations[segment] @ more @ self.saltations[segment].T,
                )
            flow, added = step @ flow, step @ added @ step.T + more
        return flow, added

    def along(self, start: np.ndarray, wanted: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
        """Return covariances at times, (time, 2 body, 2 body), and before each event."""
        found, before, now = np.empty((len(wanted), *start.shape)), list[np.ndarray](), start
        for segment in range(len(self.generators)):
            begin, end = self.times[segment : segment + 2]
            last = segment == len(self.saltations)
            for place in np.flatnonzero((wanted >= begin) & ((wanted < end) | last)):
                flow, added = self.moved(segment, wanted[place] - begin)
                found[place] = flow @ now @ flow.T + added
            flow, added = self.moved(segment, end - begin)
            now = flow @ now @ flow.T + added
            if not last:
                before.append(now)
                now = self.saltations[segment] @ now @ self.saltations[segment].T
        return found, before


def _largest(method: LinearOrbits | MappedOrbits, orbit: Orbit, variables: Variables) -> tuple[float, str]:
    """Return the largest standard deviation of a gap that nearly closes, or of a closing velocity, in it, and whose."""
    found = [(0.0, "nothing")]
    velocities, happenings = variables["closing_velocity_standard_deviation"][1], method.happenings(orbit)
    for happening, deviation in zip(happenings, velocities.tolist(), strict=True):
        if happening.closing_velocity > 0.0:
            what = f"the closing velocity of {happening.contact!r} at {happening.time:.6g} s"
            found.append((deviation / happening.closing_velocity, what))
    covariance, bodies = variables["covariance"][1], len(method.bodies)
    times = np.linspace(0.0, float(orbit.unknowns[-2]), len(covariance))
    for name, link, gap in _gaps(method, orbit, times):
        deviation = np.sqrt(np.einsum("tij,i,j->t", covariance[:, :bodies, :bodies], link, link))
        own = [item.time for item in happenings if item.contact == name]
        for place in np.flatnonzero((gap[1:-1] < gap[:-2]) & (gap[1:-1] <= gap[2:]) & (gap[1:-1] > 0.0)) + 1:
            if not any(times[place - 1] <= time <= times[place + 1] for time in own):
                what = f"the gap of {name!r} where it nearly closes, at {times[place]:.6g} s,"
                found.append((float(deviation[place] / gap[place]), what))
    return max(found)


def _gaps(
    method: LinearOrbits | MappedOrbits, orbit: Orbit, times: np.ndarray
) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """Yield the name of each contact, by what displacements close it, and its gap along an orbit."""
    path = along(method, orbit, times)
    if isinstance(method, MappedOrbits):
        for contact, name in enumerate(method.contacts):
            yield name, method.link(orbit, contact), method.gaps(orbit, contact, path, times)[0]
        return
    scene = method.family.first
    for contact in np.flatnonzero(scene.kinds < FRICTION).tolist():
        link, wall = scene.links[0, contact], scene.wall[0, contact]
        turned = (np.exp(1j * np.outer(times, scene.frequencies[0])) @ wall).real
        yield method.contacts[contact], link, -(path[:, : len(link)] @ link + scene.gap[0, contact] + turned)


def _held_growth(scene: Linear, statuses: np.ndarray, density: np.ndarray) -> np.ndarray:
    """Return the growth of the covariance of states by noise while some contacts are held."""
    bodies, mass = len(density), scene.mass[0]
    links = scene.links[0, np.isin(statuses, (HELD, STICKS))]
    free = np.eye(bodies)
    if len(links):
        if (np.abs(links @ density @ links.T) > 0.0).any():
            raise InvalidInput(
                "White noise acts on a contact that rests, or on dry friction that sticks: the force that holds it has "
                "no value at a moment, and so no time at which it lets go."
            )
        along = (links / mass).T
        free -= along @ np.linalg.pinv(links @ along) @ links
    result = np.zeros((2 * bodies, 2 * bodies))
    result[bodies:, bodies:] = free @ density @ free.T
    return result


def _vanishing(method: LinearOrbits, orbit: Orbit, event: int, state: np.ndarray) -> np.ndarray:
    """Return what vanishes at an event as a form of the state before it, (2 body,)."""
    size, count = len(state), len(orbit.events.functionals)
    times = np.roll(orbit.unknowns[size : size + count], -event)
    unknowns = np.concatenate([state, times - times[0], orbit.unknowns[size + count :]])
    _, _, jacobian = method.evaluate(rotated(orbit.events, event), unknowns)
    form: np.ndarray = jacobian[size, :size]
    return form


def _rate(events: Itinerary, orbit: Orbit, event: int) -> float:
    """Return the rate of what vanishes at an event."""
    sign = events.signs[event, events.functionals[event]]
    return float(orbit.rates[event]) * (float(sign) if sign else 1.0)


def _jump(
    scene: Linear, events: Itinerary, event: int, time: float, rate: np.ndarray, size: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Return what an event does to states and to their rate before it; the rate of its gap as a form, and its rate."""
    contact, bodies = int(events.functionals[event]) // 2, size // 2
    link, turn = scene.links[0, contact], np.exp(1j * scene.frequencies[0] * time)
    form = np.concatenate([np.zeros(bodies), link])
    bend = float(form @ rate[:size] - (scene.frequencies[0] ** 2 * scene.wall[0, contact] * turn).sum().real)
    jump, pushed = np.eye(size), rate[:size].copy()
    if events.strikes[event] >= BOUNCES:
        along = link / scene.mass[0]
        factor = 1.0 if events.strikes[event] == COMES_TO_REST else 1.0 + float(scene.restitution[0, contact])
        jump[bodies:, bodies:] -= factor * np.outer(along, link) / (link @ along)
        pushed[bodies:] -= factor * along * bend / (link @ along)
    return jump, pushed, form, bend


def _variables(
    method: OrbitMethod, orbit: Orbit, parts: _Parts | PathParts, start: np.ndarray
) -> tuple[Variables, Variables]:
    """Return covariances as variables, and coordinates."""
    size, phase = len(method.sizes), np.linspace(0.0, 1.0, PHASES + 1)
    found, before = parts.along(start, phase * float(orbit.unknowns[-2]))
    deviations = np.sqrt(np.diagonal(found, axis1=1, axis2=2)).reshape(len(phase), 2, -1)
    times = np.array([np.sqrt(delay @ one @ delay) for delay, one in zip(parts.delays, before, strict=True)])
    velocities = np.array([np.sqrt(form @ one @ form) for form, one in zip(parts.velocities, before, strict=True)])
    table = method.happenings(orbit)
    closes = np.isfinite([item.closing_velocity for item in table])
    of_event, along = ("event",), ("phase", BODY)
    text = "standard deviation of the"
    variables = {
        "covariance": labelled(("phase", "state", "other_state"), found, "", "covariance of the state"),
        "standard_deviation_displacement": labelled(along, deviations[:, 0], "m", f"{text} displacement"),
        "standard_deviation_velocity": labelled(along, deviations[:, 1], "m s-1", f"{text} velocity"),
        "event_time": labelled(of_event, np.array([item.time for item in table]), "s", "time of the event"),
        "event_contact": labelled(of_event, np.array([item.contact for item in table], dtype=str), "", "contact"),
        "event_kind": labelled(of_event, np.array([item.kind for item in table], dtype=str), "", "kind of the event"),
        "event_time_standard_deviation": labelled(of_event, times, "s", f"{text} time of the event"),
        "closing_velocity_standard_deviation": labelled(
            of_event, np.where(closes, velocities, np.nan), "m s-1", f"{text} closing velocity of the impact"
        ),
    }
    names = [f"{quantity} {body}" for quantity in ("displacement", "velocity") for body in method.bodies]
    assert len(names) == size
    return variables, {
        BODY: ((BODY,), np.array(method.bodies), {"long_name": "body"}),
        "phase": labelled(("phase",), phase, "1", "part of the period since its beginning"),
        "state": (("state",), np.array(names), {"long_name": "entry of the state"}),
        "other_state": (("other_state",), np.array(names), {"long_name": "other entry of the state"}),
    }
