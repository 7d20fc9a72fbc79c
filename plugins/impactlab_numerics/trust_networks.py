"""Random networks of all classes that people put together, each class drawn by one function.

`scene_of` draws a network with options of `impactlab.simulate` from its number. What is drawn does not depend on what
the code makes of it: durations follow from frequencies that were drawn.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

import impactlab as il
from impactlab_numerics import trust_laws as laws

BODY_STEPS = 1.2e7
"""Steps of a body that a run should take, if the step is half of the time in which its fastest motion turns by 1."""

MOST = 4.0
"""Multiple of `BODY_STEPS` beyond which a network is drawn again."""

RELAXATIONS = 12.0
"""Length of the automatic spin-up in relaxation times."""


class Scene(NamedTuple):
    """A network, options of `simulate`, and what is known of it.

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
        self.fastest = max(self.fastest, body.natural_frequency)
        self.slowest = max(self.slowest, relaxation(body))
        return name

    def spread(self, *sides: Any) -> float:
        """Return the standard deviation of a gap by the springs alone."""
        flexibility = sum(1.0 / self.bodies[side].stiffness for side in sides if isinstance(side, str))
        return math.sqrt(self.temperature * flexibility)

    def reduced_mass(self, *sides: Any) -> float:
        """Return the reduced mass of bodies, or of one and a wall."""
        return float(1.0 / sum(1.0 / self.bodies[side].mass for side in sides if isinstance(side, str)))

    def closed_frequency(self, *sides: Any, most: float = 8.0) -> float:
        """Draw the frequency of a closed contact, 0.5 to `most` times that of the faster body (rad/s)."""
        own = max(self.bodies[side].natural_frequency for side in sides if isinstance(side, str))
        frequency = own * between(self.rng, 0.5, most)
        self.fastest = max(self.fastest, frequency)
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

    def touch(
        self,
        first: Any,
        second: Any,
        law: Callable[..., il.ContactLaw] | None = None,
        clearance: tuple[float, float] = (-1.0, 3.0),
    ) -> None:
        """Add a contact, its clearance uniform in standard deviations of the gap."""
        made = law(first, second) if law is not None else self.smooth(first, second)
        distance = float(self.rng.uniform(*clearance)) * self.spread(first, second)
        self.contacts[f"contact_{len(self.contacts)}"] = il.Contact(first, second, made, clearance=distance)

    def tree(
        self,
        number: int,
        law: Callable[..., il.ContactLaw] | None = None,
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

    def network(self) -> il.Network:
        """Return the network as it is."""
        return il.Network(self.bodies, self.contacts, self.excitations, self.couplings)

    def scene(
        self, *, times: float | None = None, work: float = 1.0, network: il.Network | None = None, **known: Any
    ) -> Scene:
        """Return the scene with a duration that spends the steps, or of some relaxation times.

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


# classes: each draws one network


def home(rng: np.random.Generator) -> Scene:
    """Smooth conservative contacts and white noise at one temperature."""
    sketch = Sketch(rng)
    sketch.tree(number(rng), kind=one_of(rng, il.LinearOscillator, il.LinearOscillator, _duffing(sketch)))
    return sketch.scene()


def _duffing(sketch: Sketch) -> Callable[..., il.Oscillator]:
    share = between(sketch.rng, 0.1, 2.0)  # of the linear force at the standard deviation

    def made(**fields: Any) -> il.Oscillator:
        return il.DuffingOscillator(cubic=share * fields["stiffness"] ** 2 / sketch.temperature, **fields)

    return made


def rate_dependent_contacts(rng: np.random.Generator) -> Scene:
    """Contacts with dashpots: damping ratios of the closed contact between 0.05 and 5."""
    sketch = Sketch(rng)
    kind = one_of(rng, laws.KelvinVoigtContact, laws.ClampedKelvinVoigtContact, laws.HuntCrossleyContact)

    def law(*sides: Any) -> il.ContactLaw:
        loss, mass = between(rng, 0.05, 5.0), sketch.reduced_mass(*sides)
        if kind is laws.HuntCrossleyContact:
            thermal = math.sqrt(sketch.temperature / mass)
            stiffness = sketch.power(1.5, *sides)
            sketch.finest = min(sketch.finest, 0.05 / (sketch.fastest * max(loss, 1.0)))
            return laws.HuntCrossleyContact(stiffness, loss=loss / thermal)
        stiffness = sketch.power(1.0, *sides)
        damping = 2.0 * loss * math.sqrt(stiffness * mass)
        sketch.finest = min(sketch.finest, 0.1 * mass / damping)
        return kind(stiffness, damping=damping)  # type: ignore[no-any-return]

    sketch.tree(number(rng, most=4), law)
    if rng.random() < 0.3:
        _heat_unequally(sketch)
    return sketch.scene()


def residual_damping(rng: np.random.Generator) -> Scene:
    """Damping in residual forces: linear, quadratic, of friction, negative."""
    sketch = Sketch(rng)
    kind, share = int(rng.integers(4)), between(rng, 0.05, 2.0)
    plain: dict[str, il.Oscillator] = {}

    def made(**fields: Any) -> il.Oscillator:
        mass, stiffness, thermal = fields["mass"], fields["stiffness"], math.sqrt(sketch.temperature / fields["mass"])
        usual = math.sqrt(stiffness * mass)  # a dashpot of damping ratio 1/2
        body: il.Oscillator
        if kind == 0:
            viscous = 2.0 * share * usual
            name = f"body_{len(sketch.bodies)}"
            plain[name] = il.LinearOscillator(**(fields | {"damping": fields["damping"] + viscous}))
            rate = viscous
            body = laws.ViscousOscillator(viscous=viscous, **fields)
        elif kind == 1:
            drag = share * usual / thermal
            rate, body = 6.0 * drag * thermal, laws.DragOscillator(drag=drag, **fields)
        elif kind == 2:
            friction, creep = 0.5 * share * usual * thermal, thermal * between(rng, 0.02, 1.0)
            rate, body = friction / creep, laws.FrictionOscillator(friction=friction, creep=creep, **fields)
        else:
            width = math.sqrt(sketch.temperature / stiffness) * between(rng, 0.5, 3.0)
            growth = 0.5 * share * usual
            rate, body = 8.0 * growth, laws.VanDerPolOscillator(growth=growth, width=width, **fields)
        sketch.finest = min(sketch.finest, 0.1 * mass / rate)
        return body

    if rng.random() < 0.4:
        sketch.body(made)
    else:
        sketch.tree(number(rng, most=3), kind=made, clearance=(0.0, 3.0))
    network = sketch.network()
    equivalent = network.replace(oscillators=plain) if kind == 0 else None
    if equivalent is not None:  # the noise of the total damping: one temperature
        noises = {name: il.WhiteNoise(sketch.temperature * body.damping / math.pi) for name, body in plain.items()}
        network, equivalent = (item.replace(excitations=noises) for item in (network, equivalent))
    return sketch.scene(network=network, equivalent=equivalent, settling=2.0 if kind == 3 else 1.0)


def kinked(rng: np.random.Generator) -> Scene:
    """Forces with kinks and jumps, and forces that saturate: in contacts, stops and couplings with play."""
    sketch = Sketch(rng)
    kind = int(rng.integers(8))
    if kind < 5:

        def law(*sides: Any) -> il.ContactLaw:
            stiffness = sketch.power(1.0, *sides, most=4.0)
            depth = math.sqrt(2.0 * sketch.temperature / stiffness)
            if kind == 0:
                return laws.JumpContact(stiffness * depth * between(rng, 0.1, 3.0), stiffness=stiffness)
            if kind == 1:
                second = stiffness * between(rng, 3.0, 100.0)
                sketch.fastest = max(sketch.fastest, math.sqrt(second / sketch.reduced_mass(*sides)))
                return laws.BilinearContact(stiffness, second=second, distance=depth * float(rng.uniform(0.3, 2.0)))
            if kind == 2:
                return laws.SaturatingContact(stiffness * depth, depth=depth * between(rng, 0.03, 1.0))
            if kind == 3:
                exponent = float(rng.uniform(0.1, 1.0))
                return il.PowerLawContact(sketch.power(exponent, *sides, most=4.0), exponent=exponent)
            return il.LinearContact(stiffness)

        sketch.tree(number(rng, most=4), law)
        return sketch.scene()
    if kind in (5, 6):

        def made(**fields: Any) -> il.Oscillator:
            spread = math.sqrt(sketch.temperature / fields["stiffness"])
            if kind == 5:
                stop = fields["stiffness"] * between(rng, 3.0, 100.0)
                sketch.fastest = max(sketch.fastest, math.sqrt(stop / fields["mass"]))
                return laws.StopOscillator(stop=stop, distance=spread * float(rng.uniform(0.5, 3.0)), **fields)
            width = spread * between(rng, 0.03, 1.0)
            limit = fields["stiffness"] * spread * between(rng, 0.1, 2.0)
            sketch.fastest = max(sketch.fastest, math.sqrt(limit / width / fields["mass"]))
            return laws.SoftOscillator(limit=limit, width=width, **fields)

        if rng.random() < 0.5:
            sketch.body(made)
        else:
            sketch.tree(number(rng, most=3), kind=made, clearance=(0.0, 3.0))
        return sketch.scene()
    sketch.tree(number(rng, 2, 4), clearance=(0.0, 3.0))
    for index, (one, other) in enumerate(itertools.pairwise(sketch.bodies)):
        stiffness = sketch.closed_frequency(one, other) ** 2 * sketch.reduced_mass(one, other)
        play = float(rng.uniform(0.0, 3.0)) * sketch.spread(one, other)
        law_of = laws.DeadBandCoupling(stiffness, play=play)
        sketch.couplings[f"coupling_{index}"] = il.Coupling(one, other, law_of)
    return sketch.scene()


def _given_force(sketch: Sketch, name: str, duration: float) -> il.Excitation:
    """Draw a force on a body that moves it by a few standard deviations."""
    rng, body = sketch.rng, sketch.bodies[name]
    own, force = body.natural_frequency, math.sqrt(sketch.temperature * body.stiffness)
    kind = int(rng.integers(4))
    if kind == 0:
        width = between(rng, 0.03, 10.0) / own
        sketch.finest = min(sketch.finest, width / 100.0)
        begin = float(rng.uniform(0.0, 0.3)) * duration
        return laws.Pulse(force * max(1.0, 1.0 / (own * width)), begin=begin, width=width)
    if kind == 1:
        first, last = own * between(rng, 0.1, 1.0), own * between(rng, 1.0, 10.0)
        sketch.finest = min(sketch.finest, 0.05 / last)
        return laws.Chirp(force, first=first, rate=(last - first) / duration)
    frequency = own * between(rng, 0.1, 15.0)
    if rng.random() < 0.3:  # a whole number of times as often as the run is looked at in 256 parts
        frequency = 2.0 * math.pi * 256.0 / duration * max(1, round(frequency * duration / (2.0 * math.pi * 256.0)))
    sketch.finest = min(sketch.finest, 0.05 / frequency)
    return laws.Harmonic(force * between(rng, 0.5, 5.0) * max(1.0, (frequency / own) ** 2), frequency=frequency)


def given_forces(rng: np.random.Generator) -> Scene:
    """Harmonic forces, pulses and chirps, on one body; others are under noise, or nothing is random."""
    sketch = Sketch(rng, ratio=(0.05, 0.5))
    kind = int(rng.integers(3))
    if kind == 0:  # linear bodies
        sketch.body(noise=False)
        if rng.random() < 0.5:
            other = sketch.body(noise=False)
            stiffness = sketch.bodies[other].stiffness * between(rng, 0.1, 3.0)
            sketch.couplings["spring"] = il.Coupling("body_0", other, il.LinearCoupling(stiffness))
            sketch.fastest = max(sketch.fastest, math.sqrt(2.0 * stiffness / sketch.reduced_mass("body_0", other)))
    elif kind == 1:  # contacts with loss, so that the motion follows the force
        law = _lossy(sketch)
        sketch.body(noise=False)
        sketch.touch("body_0", il.WALL, law, clearance=(0.0, 2.0))
    else:
        sketch.tree(number(rng, 2, 3), clearance=(0.0, 3.0))
    if kind < 2:
        duration = 40.0 * max(1.0, sketch.slowest * sketch.frequency) / sketch.frequency
        sketch.excitations = {"body_0": _given_force(sketch, "body_0", duration)}
        options = {"duration": duration, "realizations": 1}
        return sketch.scene(options=options, transient=True, deterministic=True)
    options = sketch.scene(times=10.0).options
    sketch.excitations["body_0"] = _given_force(sketch, "body_0", options["duration"])
    return sketch.scene(options=options, transient=True)


def _lossy(sketch: Sketch) -> Callable[..., il.ContactLaw]:
    def law(*sides: Any) -> il.ContactLaw:
        stiffness, mass = sketch.power(1.0, *sides), sketch.reduced_mass(*sides)
        damping = 2.0 * between(sketch.rng, 0.1, 0.7) * math.sqrt(stiffness * mass)
        sketch.finest = min(sketch.finest, 0.1 * mass / damping)
        return laws.ClampedKelvinVoigtContact(stiffness, damping=damping)

    return law


def varying_noise(rng: np.random.Generator) -> Scene:
    """White noise whose density swings, or gusts."""
    sketch = Sketch(rng, ratio=(0.05, 0.5))
    if rng.random() < 0.3:
        sketch.body()
    else:
        sketch.tree(number(rng, most=3))
    options = sketch.scene(times=10.0).options
    kind = int(rng.integers(2))
    for name, noise in list(sketch.excitations.items()):
        own, level = sketch.bodies[name].natural_frequency, noise.spectral_density  # type: ignore[attr-defined]
        if kind == 0:
            frequency = own * between(rng, 0.05, 20.0)
            sketch.finest = min(sketch.finest, 0.1 / frequency)
            sketch.excitations[name] = laws.ModulatedNoise(level, frequency=frequency)
        else:
            width = between(rng, 0.02, 10.0) / own
            sketch.finest = min(sketch.finest, 0.05 * width)
            share = max(1.0, sketch.slowest / width)
            middle = float(rng.uniform(0.1, 0.6)) * options["duration"]
            sketch.excitations[name] = laws.GustNoise(
                between(rng, 0.01, 1.0) * level, peak=between(rng, 0.3, 3.0) * share * level, middle=middle, width=width
            )
    return sketch.scene(options=options, transient=True)


def bounded_noise(rng: np.random.Generator) -> Scene:
    """Sums of cosines in the place of white noise, with contacts, preloaded ones too."""
    sketch = Sketch(rng, ratio=(0.05, 0.5))
    sketch.tree(number(rng, most=3), clearance=one_of(rng, (-1.0, 3.0), (-4.0, 0.0)))
    scene = sketch.scene(times=10.0, work=0.05)
    duration, spin_up = scene.options["duration"], RELAXATIONS * sketch.slowest
    scene.options["realizations"] = min(scene.options["realizations"], 128)
    for name, noise in list(sketch.excitations.items()):
        top = sketch.bodies[name].natural_frequency * between(rng, 1.5, 10.0) / (2.0 * math.pi)
        components = math.ceil(3.0 * (duration + spin_up) * top)  # the spin-up may be longer than of bodies alone
        if components > 10_000:
            raise Costly
        sketch.excitations[name] = il.ShinozukaNoise(
            noise.spectral_density,  # type: ignore[attr-defined]
            band=(0.0, top),
            components=components,
        )
        sketch.finest = min(sketch.finest, 0.1 / (2.0 * math.pi * top))
    return scene._replace(network=sketch.network())


def preloads(rng: np.random.Generator) -> Scene:
    """Contacts that a load keeps closed: clearances far below zero, and static loads on bodies."""
    sketch = Sketch(rng)
    depth = between(rng, 1.0, 30.0)
    if rng.random() < 0.7:
        sketch.tree(number(rng, most=3), clearance=(-depth, -1.0), wall=1.0)
        if rng.random() < 0.4:
            sketch.touch(il.WALL, "body_0", clearance=(0.5, 3.0))
        sketch.fastest *= depth**0.25  # powers above 1 stiffen
        return sketch.scene()
    sketch.tree(number(rng, 2, 3), clearance=(-1.0, 2.0), wall=1.0)
    body = sketch.bodies["body_0"]
    load = depth * math.sqrt(sketch.temperature * body.stiffness)
    sketch.excitations["body_0"] = laws.ConstantForce(one_of(rng, -1.0, 1.0) * load)
    sketch.fastest *= depth**0.25
    return sketch.scene()


def heavy_bases(rng: np.random.Generator) -> Scene:
    """Bodies on one shaken base, 10² to 10⁶ times as heavy, that touch each other."""
    sketch = Sketch(rng, ratio=(0.05, 0.3))
    count, heavier = number(rng, 2, 3), between(rng, 1e2, 1e6)
    own = sketch.frequency * between(rng, 0.7, 3.0)
    mass, ratio = heavier * sketch.mass, between(rng, 0.05, 0.3)
    base = il.LinearOscillator(mass=mass, damping=2.0 * ratio * own * mass, stiffness=mass * own**2)
    amplitude = math.sqrt(sketch.temperature / sketch.mass) / sketch.frequency
    density = (base.stiffness * amplitude**2) * base.damping / math.pi
    held = {}
    for _ in range(count):
        name = sketch.body(noise=False)
        body = sketch.bodies[name]
        held[name] = il.Coupling("base", name, il.LinearCoupling(body.stiffness, damping=body.damping))
        others = [item for item in sketch.bodies if item != name]
        if others:
            sketch.touch(name, others[-1], clearance=(0.0, 2.0))
    sketch.bodies = {
        name: body.replace(stiffness=0.0, damping=0.0) for name, body in sketch.bodies.items()
    } | {"base": base}  # fmt: skip
    sketch.slowest = max(sketch.slowest, relaxation(base))
    sketch.couplings = {f"mount_{name}": item for name, item in held.items()}
    sketch.excitations = {"base": il.WhiteNoise(density)}
    if rng.random() < 0.3:
        options = sketch.scene(times=10.0).options
        frequency = own * between(rng, 0.3, 3.0)
        sketch.finest = min(sketch.finest, 0.05 / frequency)
        sketch.excitations["base"] = laws.Harmonic(mass * own**2 * amplitude, frequency=frequency)
        for name in list(sketch.bodies)[:count]:
            body_noise = 0.1 * sketch.temperature * held[name].law.linear[1] / math.pi
            sketch.excitations[name] = il.WhiteNoise(body_noise)
        return sketch.scene(options=options, transient=True)
    return sketch.scene()


def _heat_unequally(sketch: Sketch, most: float = 5.0) -> None:
    for name, noise in list(sketch.excitations.items()):
        level = noise.spectral_density * between(sketch.rng, 1.0 / most, most)  # type: ignore[attr-defined]
        sketch.excitations[name] = il.WhiteNoise(level)


def unequal_temperatures(rng: np.random.Generator) -> Scene:
    """Bodies at temperatures up to 25 times apart; some between them are not damped at all."""
    sketch = Sketch(rng)
    sketch.tree(number(rng, 2, 5), clearance=(-1.0, 2.0))
    _heat_unequally(sketch)
    names = list(sketch.bodies)
    if len(names) > 2 and rng.random() < 0.4:
        middle = names[1]
        sketch.bodies[middle] = sketch.bodies[middle].replace(damping=0.0)
        del sketch.excitations[middle]
    return sketch.scene(settling=2.0)


def rows_of_undamped_bodies(rng: np.random.Generator) -> Scene:
    """Rows of 5 to 16 bodies with linear contacts; the ends alone are damped and shaken."""
    sketch = Sketch(rng, ratio=(0.02, 0.2), frequencies=1.3)
    count = number(rng, 5, 16)
    equal = rng.random() < 0.6

    def law(*sides: Any) -> il.ContactLaw:
        return il.LinearContact(sketch.power(1.0, *sides, most=4.0))

    for index in range(count):
        end = index in (0, count - 1)
        damping: dict[str, Any] = {} if end else {"damping": 0.0}
        sketch.body(noise=end, mass=sketch.mass, **damping)
        if index:
            sketch.touch(f"body_{index - 1}", f"body_{index}", law, clearance=(-0.5, 0.5))
    if not equal:
        _heat_unequally(sketch, 2.0)
        return sketch.scene(work=2.0, settling=3.0)
    network = sketch.network()  # at one temperature the law is the same whoever is damped
    damped = {name: body.replace(damping=sketch.mass * sketch.frequency) for name, body in network.oscillators.items()}
    noises = {name: il.WhiteNoise(sketch.temperature * body.damping / math.pi) for name, body in damped.items()}
    return sketch.scene(work=2.0, equivalent=network.replace(oscillators=damped, excitations=noises))


def starts(rng: np.random.Generator) -> Scene:
    """Given states, cold starts without a spin-up, and short runs, some of them without any noise."""
    sketch = Sketch(rng, ratio=(0.02, 0.5))
    noisy, kind = rng.random() < 0.7, int(rng.integers(3))
    if rng.random() < 0.4:
        sketch.body(noise=noisy)
    elif noisy:
        sketch.tree(number(rng, most=3), clearance=(0.5, 3.0))
    else:
        sketch.tree(1, _lossy(sketch), clearance=(0.5, 3.0), noise=False)
    options: dict[str, Any] = {"duration": between(rng, 0.3, 5.0) * sketch.slowest, "spin_up": 0.0}
    if kind == 0 and noisy:
        options["initial"] = "rest"
    elif kind == 1 or not noisy:
        free = [name for name in sketch.bodies if not any(name in _sides(item) for item in sketch.contacts.values())]
        far = {name: sketch.spread(name) * float(rng.uniform(-6.0, 6.0)) for name in free}
        fast = {
            name: math.sqrt(sketch.temperature / body.mass) * float(rng.uniform(-6.0, 6.0))
            for name, body in sketch.bodies.items()
        }
        options["initial"] = {"displacement": far, "velocity": fast}
        del options["spin_up"]
    if not noisy:
        options["realizations"] = 1
    else:
        affordable = BODY_STEPS * 0.5 / sketch.fastest / len(sketch.bodies)
        options["realizations"] = int(np.clip(affordable / options["duration"], 64, 4096))
    return sketch.scene(options=options, transient=True, deterministic=not noisy)


def _sides(contact: il.Contact) -> tuple[Any, Any]:
    return contact.first, contact.second


def few_realizations(rng: np.random.Generator) -> Scene:
    """One to eight realizations: long enough for batches, and shorter."""
    sketch = Sketch(rng, ratio=(0.05, 0.5))
    sketch.tree(number(rng), clearance=(-1.0, 2.0))
    realizations = int(rng.integers(1, 9))
    batches = 64 / realizations + 2.0
    times = 20.0 * batches * (between(rng, 1.0, 4.0) if rng.random() < 0.8 else between(rng, 0.1, 1.0))
    return sketch.scene(options={"realizations": realizations, "duration": times * sketch.slowest})


def rare_contacts(rng: np.random.Generator) -> Scene:
    """Contacts at 3 to 4.5 standard deviations, in runs in which they close between 0.1 and 1000 times."""
    sketch = Sketch(rng)
    sketch.tree(number(rng, most=2), clearance=(3.0, 4.5), wall=0.0)
    return sketch.scene(work=between(rng, 0.02, 1.0))


def weak_damping(rng: np.random.Generator) -> Scene:
    """Damping ratios between 0.002 and 0.01."""
    sketch = Sketch(rng, ratio=(0.002, 0.01), frequencies=2.0)
    sketch.tree(number(rng, most=3), clearance=(-1.0, 2.0))
    return sketch.scene(work=2.0)


def overdamped(rng: np.random.Generator) -> Scene:
    """Damping ratios between 1 and 300."""
    top = between(rng, 2.0, 300.0)
    sketch = Sketch(rng, ratio=(max(1.0, top / 3.0), top), frequencies=2.0)
    sketch.tree(number(rng, most=3), clearance=(-1.0, 2.0))
    return sketch.scene(work=2.0)


Draw = Callable[[np.random.Generator], Scene]

CLASSES: dict[str, Draw] = {
    "home": home,
    "rate-dependent contacts": rate_dependent_contacts,
    "residual damping": residual_damping,
    "kinks, jumps, saturation": kinked,
    "given forces": given_forces,
    "varying noise": varying_noise,
    "bounded noise": bounded_noise,
    "preloads and static loads": preloads,
    "heavy bases": heavy_bases,
    "unequal temperatures": unequal_temperatures,
    "rows of undamped bodies": rows_of_undamped_bodies,
    "starts and short runs": starts,
    "few realizations": few_realizations,
    "rare contacts": rare_contacts,
    "weak damping": weak_damping,
    "overdamped": overdamped,
}
"""Classes of networks by name, in the order in which they are drawn."""


def class_of(seed: int, classes: dict[str, Draw] = CLASSES) -> str:
    """Name of the class of a numbered network: one after the other."""
    return list(classes)[seed % len(classes)]


def scene_of(seed: int, classes: dict[str, Draw] = CLASSES) -> Scene:
    """Draw a numbered network, again while it would take too long."""
    draw = classes[class_of(seed, classes)]
    for attempt in range(1000):
        try:
            return draw(np.random.default_rng([seed, attempt]))
        except Costly:
            continue
    raise il.InvalidInput(f"No network {seed} of the class {class_of(seed, classes)!r} is cheap enough.")
