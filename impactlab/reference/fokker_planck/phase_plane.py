"""One body under white noise between limits of its displacement, as equations of first passage see it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from impactlab.assembly.forces_in_states import Forces
from impactlab.assembly.mechanism import Mode, refusing
from impactlab.assembly.model import SAMPLED, Model
from impactlab.components.allowed_ranges import Limits, range_of
from impactlab.components.composition import Composition
from impactlab.components.loads import ConstantForce
from impactlab.errors import InvalidInput, NoExactReference
from impactlab.inputs import known_name

REFUSAL = "First passages of this network are simulated only, by il.FirstPassage:"
"""What reasons follow."""

_FAR = 30.0
"""Energy above the least one, in units of T, at which a body without a limit is turned back: beyond it the body is
with a probability of e⁻³⁰."""

_DOUBLINGS = 60
"""How often the distance is doubled in which such an energy is looked for."""

_SAMPLES = 2001
"""Places at which forces between the limits are looked at."""

_REACH = 8.0
"""Largest velocity, in standard deviations."""


@dataclass(frozen=True, eq=False)
class PhasePlane:
    """The motion ``dv = a(x, v) dt + sqrt(D) dW`` of a body from within an interval until it leaves."""

    name: str
    ends: tuple[float, float]  # of the interval (m)
    mirrored: tuple[bool, bool]  # whether the body is turned back at an end, which is no limit
    kinks: np.ndarray  # displacements at which a contact begins (m)
    diffusion: float  # D (m2 s-3)
    speed: float  # that the body exceeds with a negligible probability (m s-1)
    forces: MeanMotion

    @classmethod
    def of(cls, network: Composition, absorb: Mapping[str, Any]) -> PhasePlane:
        """Return the plane of a network with limits of its body, or refuse it with all reasons."""
        if not isinstance(absorb, Mapping) or len(absorb) != 1:
            raise InvalidInput(f"absorb= takes the limits of one oscillator, such as {{'a': 0.1}}, not {absorb!r}.")
        ((name, given),) = absorb.items()
        known_name("oscillator", name, network.oscillators)
        limits, model = range_of(f"absorb of {name!r}", given), Model.of(network)
        if reasons := list(_reasons(model)):
            raise NoExactReference("\n- ".join([REFUSAL, *reasons]))
        motion = MeanMotion(model)
        ends = _ends(motion, limits)
        onsets = model.clearance / model.ends.gap(np.array([[1.0], [0.0]]))[:, 0]
        inside = np.unique(onsets[(onsets > ends[0]) & (onsets < ends[1])])
        mirrored = limits[0] is None, limits[1] is None
        return cls(name, ends, mirrored, inside, motion.diffusion, _speed(motion, ends), motion)


class MeanMotion:
    """The mean acceleration of one body, and the noise on it."""

    def __init__(self, model: Model) -> None:
        self._model = model
        (self.mass,), (self.damping,) = model.mass, model.damping
        self.diffusion = 2.0 * math.pi * float(model.noise.intensity[0]) / self.mass**2
        self.temperature = self.diffusion * self.mass**2 / (2.0 * self.damping) if self.damping > 0.0 else math.inf
        force = model.sources["force"]
        self._constant = sum(
            weight * force.excitations[number].call("force", 0.0)
            for number, weight in zip(force.drives.source, force.drives.weight, strict=True)
        )

    def acceleration(self, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the mean acceleration in some states, (state,) (m s-2)."""
        model, forces = self._model, Forces(self._model, len(x))
        forces.x[:], forces.v[:] = x, v
        forces.evaluate(0.0)
        force: np.ndarray = forces.total[0] + self._constant - model.stiffness * x - model.damping * v
        return np.asarray(force / self.mass)

    def energies(self, x: np.ndarray) -> np.ndarray:
        """Return the potential energy at increasing displacements, above that at the first one (J)."""
        force = self.mass * self.acceleration(x, np.zeros_like(x))
        return np.append(0.0, np.cumsum(-0.5 * np.diff(x) * (force[1:] + force[:-1])))


def _reasons(model: Model) -> Iterator[str]:
    """Yield why there is no equation of one displacement and one velocity."""
    if len(model.bodies) != 1:
        yield f"it has {len(model.bodies)} oscillators, and there must be one or two"
        return
    (name,) = model.bodies.names
    for mechanism in refusing(model, Mode.FORCES):
        yield f"it has {mechanism.example(model)}"
    if model.kicks.states:
        yield f"laws have states, such as {model.kicks.states[0][0]!r}"
    if model.kicks.timed.any():
        yield "forces of laws depend on time"
    for kind in SAMPLED:
        if model.sources[kind].names:
            yield f"the noise on {name!r} is not white"
    if any(type(item) is not ConstantForce for item in model.sources["force"].excitations):
        yield f"a force on {name!r} depends on time"
    if model.noise.varying:
        yield f"the white noise on {name!r} depends on time"
    elif not model.noise.intensity.any():
        yield f"there is no white noise on {name!r}"


def _ends(motion: MeanMotion, limits: Limits) -> tuple[float, float]:
    """Return the ends of the interval: the limits, and where a body without one is turned back."""
    low, high = limits
    return (
        _far(motion, high, -1.0) if low is None else low,  # type: ignore[arg-type]
        _far(motion, low, 1.0) if high is None else high,  # type: ignore[arg-type]
    )


def _far(motion: MeanMotion, limit: float, side: float) -> float:
    """Return the place beyond which a body is not, on a side of its limit."""
    if math.isfinite(motion.temperature):
        distance = 1e-3 * max(abs(limit), math.sqrt(motion.temperature / motion.mass) * motion.mass / motion.damping)
        for _ in range(_DOUBLINGS):
            x = limit + side * distance * np.linspace(0.0, 1.0, _SAMPLES)
            energy = motion.energies(x)
            beyond = np.flatnonzero(energy - np.minimum.accumulate(energy) > _FAR * motion.temperature)
            if beyond.size and energy[-1] == energy.max():
                return float(x[beyond[0]])
            distance *= 2.0
    raise InvalidInput("Nothing keeps the body from leaving on the side without a limit; give both limits.")


def _speed(motion: MeanMotion, ends: tuple[float, float]) -> float:
    """Return a velocity that is hardly exceeded before the body leaves: of the noise, and of energies between the ends.

    Undamped noise that pushes a body across the interval makes velocities of about the cube root of D times its length.
    """
    energies = motion.energies(np.linspace(*ends, _SAMPLES))
    falling = math.sqrt(2.0 * float(np.ptp(energies)) / motion.mass)
    pushed = _REACH * math.cbrt(motion.diffusion * (ends[1] - ends[0]))
    thermal = _REACH * math.sqrt(motion.temperature / motion.mass)
    return min(falling + pushed, thermal)
