"""How a random network is drawn: bodies at one temperature, contacts, and a run that spends a given number of steps.

What is drawn does not depend on what the code makes of it: durations follow from frequencies that were drawn.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

import impactlab as il

BODY_STEPS = 1.2e7
"""Steps of a body that a run should take, if the step is half of the time in which its fastest motion turns by 1."""

MOST = 4.0
"""Multiple of `BODY_STEPS` beyond which a network is drawn again."""

RELAXATIONS = 12.0
"""Length of the automatic spin-up in relaxation times."""


class Scene(NamedTuple):
    """A network with options of `simulate`, and facts for its reference.

    Attributes
    ----------
    network : Network
    options : dict
        Duration, realizations, and whatever else the class is about.
    fine : float
        A step that resolves every motion and every force (s).
    transient : bool
        Whether means over [0, T] depend on T.
    deterministic : bool
        Whether nothing is random.
    settling : float
        Spin-up of a reference by that of the run.
    equivalent : Network or None
        A network of the same law with other components, whose law is exact.
    """

    network: il.Network
    options: dict[str, Any]
    fine: float
    transient: bool = False
    deterministic: bool = False
    settling: float = 1.0
    equivalent: il.Network | None = None


class Costly(Exception):
    """The network would take too long; another one is drawn."""


Law = Callable[..., il.ContactLaw]
"""What draws a contact law from the sides that it lies between."""


def between(rng: np.random.Generator, low: float, high: float) -> float:
    """Return a number that is uniform in its logarithm."""
    return float(math.exp(rng.uniform(math.log(low), math.log(high))))


def one_of(rng: np.random.Generator, *choices: Any) -> Any:
    """Return one of several things."""
    return choices[int(rng.integers(len(choices)))]


@dataclass
class Sketch:
    """A network while it is drawn: bodies at one temperature, and how fast everything moves.

    Masses are uniform in their logarithm around one scale of the network between 0.1 and 10 kg, so that they lie
    between 0.01 and 100 kg; frequencies around one between 1 and 10 rad/s, temperatures between 0.1 and 10 J.
    """

    rng: np.random.Generator
    ratio: tuple[float, float] = (0.02, 0.5)
    frequencies: float = 3.0
    bodies: dict[str, il.Oscillator] = field(default_factory=dict)
    contacts: dict[str, il.Contact] = field(default_factory=dict)
    couplings: dict[str, il.Coupling] = field(default_factory=dict)
    excitations: dict[str, il.Excitation] = field(default_factory=dict)
    temperature: float = 0.0
    fastest: float = 0.0
    slowest: float = 0.0
    finest: float = math.inf
    mass: float = 0.0
    frequency: float = 0.0

    def __post_init__(self) -> None:
        self.mass, self.frequency = between(self.rng, 0.1, 10.0), between(self.rng, 1.0, 10.0)
        self.temperature = between(self.rng, 0.1, 10.0)

    def body(self, kind: Callable[..., il.Oscillator] = il.LinearOscillator, noise: bool = True, **fields: Any) -> str:
        """Add a body, under white noise that gives it the temperature."""
        rng, name = self.rng, f"body_{len(self.bodies)}"
        mass = self.mass * between(rng, 0.1, 10.0)
        frequency = self.frequency * between(rng, 1.0, self.frequencies)
        ratio = between(rng, *self.ratio)
        made = {"mass": mass, "damping": 2.0 * ratio * frequency * mass, "stiffness": mass * frequency**2} | fields
        body = self.bodies[name] = kind(**made)
        if noise:
            self.excitations[name] = il.WhiteNoise(self.temperature * body.damping / math.pi)
        self.quicken(body.natural_frequency)
        self.slowest = max(self.slowest, relaxation(body))
        return name

    def quicken(self, frequency: float) -> None:
        """Note a motion of this frequency (rad/s)."""
        self.fastest = max(self.fastest, frequency)

    def resolve(self, time: float) -> None:
        """Note that a fine step may not be longer than this (s)."""
        self.finest = min(self.finest, time)

    def spread(self, *sides: Any) -> float:
        """Return the standard deviation of a gap by the springs alone."""
        flexibility = sum(1.0 / self.bodies[side].stiffness for side in sides if isinstance(side, str))
        return math.sqrt(self.temperature * flexibility)

    def reduced_mass(self, *sides: Any) -> float:
        """Return the reduced mass of bodies, or of one and a wall."""
        return float(1.0 / sum(1.0 / self.bodies[side].mass for side in sides if isinstance(side, str)))

    def thermal_speed(self, mass: float) -> float:
        """Return the standard deviation of the velocity of a mass (m/s)."""
        return math.sqrt(self.temperature / mass)

    def velocities(self, most: float) -> dict[str, float]:
        """Draw a velocity of each body, up to so many standard deviations on either side."""
        return {
            name: self.thermal_speed(body.mass) * float(self.rng.uniform(-most, most))
            for name, body in self.bodies.items()
        }

    def closed_frequency(self, *sides: Any, most: float = 8.0) -> float:
        """Draw the frequency of a closed contact, 0.5 to `most` times that of the faster body (rad/s)."""
        own = max(self.bodies[side].natural_frequency for side in sides if isinstance(side, str))
        frequency = own * between(self.rng, 0.5, most)
        self.quicken(frequency)
        return frequency

    def power(self, exponent: float, *sides: Any, most: float = 8.0) -> float:
        """Return the coefficient of a power law that, at the depth that stores T, is as stiff as a drawn frequency."""
        tangent = self.closed_frequency(*sides, most=most) ** 2 * self.reduced_mass(*sides)
        depth = math.sqrt(exponent * (exponent + 1.0) * self.temperature / tangent)
        return float((exponent + 1.0) * self.temperature / depth ** (exponent + 1.0))

    def smooth(self, *sides: Any) -> il.ContactLaw:
        """Draw a contact law of Hertz, a linear one, or a power from 1 to 3."""
        exponent = one_of(self.rng, 1.5, 1.0, float(self.rng.uniform(1.0, 3.0)))
        stiffness = self.power(exponent, *sides)
        if exponent == 1.5:
            return il.HertzContact(stiffness)
        if exponent == 1.0:
            return il.LinearContact(stiffness)
        return il.PowerLawContact(stiffness, exponent=exponent)

    def damped(self, *sides: Any) -> il.ContactLaw:
        """Draw a spring with a dashpot that never pulls, of a damping ratio between 0.1 and 0.7."""
        stiffness, mass = self.power(1.0, *sides), self.reduced_mass(*sides)
        damping = 2.0 * between(self.rng, 0.1, 0.7) * math.sqrt(stiffness * mass)
        self.resolve(0.1 * mass / damping)
        return il.KelvinVoigtContact(stiffness, damping=damping)

    def touch(
        self,
        first: Any,
        second: Any,
        law: Law | None = None,
        clearance: tuple[float, float] = (-1.0, 3.0),
    ) -> None:
        """Add a contact, its clearance uniform in standard deviations of the gap."""
        made = law(first, second) if law is not None else self.smooth(first, second)
        distance = float(self.rng.uniform(*clearance)) * self.spread(first, second)
        self.contacts[f"contact_{len(self.contacts)}"] = il.Contact(first, second, made, clearance=distance)

    def tree(
        self,
        number: int,
        law: Law | None = None,
        clearance: tuple[float, float] = (-1.0, 3.0),
        wall: float = 0.3,
        **of_bodies: Any,
    ) -> None:
        """Add bodies in a chain or a tree of contacts, one of them at least at a wall if it is alone."""
        for _ in range(number):
            name = self.body(**of_bodies)
            others = [item for item in self.bodies if item != name]
            if others:
                self.touch(name, one_of(self.rng, others[-1], one_of(self.rng, *others)), law, clearance)
            if number == 1 or self.rng.random() < wall:
                first, second = (name, il.WALL) if self.rng.random() < 0.5 else (il.WALL, name)
                self.touch(first, second, law, clearance)

    def mount(self, count: int, base: il.Oscillator, clearance: tuple[float, float], law: Law | None = None) -> None:
        """Add bodies that springs and dashpots hold to a base, each of which can touch the one before."""
        for _ in range(count):
            name = self.body(noise=False)
            body, before = self.bodies[name], list(self.bodies)[:-1]
            holder = il.LinearCoupling(body.stiffness, damping=body.damping)
            self.couplings[f"mount_{name}"] = il.Coupling("base", name, holder)
            if before:
                self.touch(name, before[-1], law, clearance)
        self.bodies = {name: body.replace(stiffness=0.0, damping=0.0) for name, body in self.bodies.items()}
        self.bodies["base"] = base

    def levels(self) -> dict[str, float]:
        """Return the spectral densities of the white noises."""
        return {name: noise.spectral_density for name, noise in self.excitations.items()}  # type: ignore[attr-defined]

    def heat(self, low: float, high: float) -> None:
        """Multiply each density by a number of its own, so that the temperatures are unequal."""
        for name, level in self.levels().items():
            self.excitations[name] = il.WhiteNoise(level * between(self.rng, low, high))

    def undamp(self, name: str) -> None:
        """Take the dashpot and the noise of a body away."""
        self.bodies[name] = self.bodies[name].replace(damping=0.0)
        del self.excitations[name]

    def network(self) -> il.Network:
        """Return the network as it is."""
        return il.Network(self.bodies, self.contacts, self.excitations, self.couplings)

    def scene(
        self, *, times: float | None = None, work: float = 1.0, network: il.Network | None = None, **known: Any
    ) -> Scene:
        """Return the scene, with a duration that spends the steps or is a multiple of the relaxation time.

        Raises
        ------
        Costly
            If it would take far more steps.
        """
        step, settling = 0.5 / self.fastest, RELAXATIONS * self.slowest
        options = dict(known.pop("options", {}))
        if "initial" in options or options.get("spin_up") == 0.0:
            settling = 0.0
        affordable = work * BODY_STEPS * step / len(self.bodies)  # simulated time of all realizations
        if times is None:
            realizations = int(np.clip(affordable / (3.0 * settling + 50.0 / self.fastest), 64, 512))
            duration = max(affordable / realizations - settling, 4.0 * self.slowest)
        else:
            duration = times * self.slowest
            realizations = int(np.clip(affordable / (settling + duration), 64, 2048))
        options = {"duration": duration, "realizations": realizations} | options
        if options["realizations"] * (settling + options["duration"]) > MOST * affordable:
            raise Costly
        fine = min(known.pop("fine", math.inf), self.finest, 0.05 / self.fastest)
        return Scene(network or self.network(), options, fine, **known)


def relaxation(body: il.Oscillator) -> float:
    """Return the time in which the slowest motion of a body alone decays (s); 0 without damping."""
    half = 0.5 * body.damping / body.mass
    if half == 0.0:
        return 0.0
    if body.natural_frequency == 0.0:
        return 0.5 / half
    beyond = half**2 - body.natural_frequency**2
    return 1.0 / half if beyond <= 0.0 else (half + math.sqrt(beyond)) / body.natural_frequency**2


def number(rng: np.random.Generator, least: int = 1, most: int = 5) -> int:
    """Draw the number of bodies."""
    return int(rng.integers(least, most + 1))
