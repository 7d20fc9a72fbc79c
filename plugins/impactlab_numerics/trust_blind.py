"""Fifty more scenes, of laws and parameters that no rule was made with: run when everything is believed to be right."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any

import numpy as np

import impactlab as il
from impactlab_numerics.trust_networks import RELAXATIONS, Costly, Draw, Scene, Sketch, between, number, one_of

SEEDS = range(10_000, 10_050)
"""Numbers of the scenes."""


class ConicalContact(il.ContactLaw):
    """Cone on a plane: force ``stiffness δ²``."""

    stiffness: float = il.parameter(units="N m-2", minimum=0.0)

    @staticmethod
    def force(indentation, stiffness):  # type: ignore[no-untyped-def]
        return stiffness * indentation * indentation

    @staticmethod
    def potential(indentation, stiffness):  # type: ignore[no-untyped-def]
        return stiffness * indentation * indentation * indentation / 3.0


class ExponentialWall(il.ContactLaw):
    """Wall that hardens without end: force ``scale (exp(δ/depth) − 1)``."""

    scale: float = il.parameter(units="N", minimum=0.0)
    depth: float = il.parameter(units="m", above=0.0)

    @staticmethod
    def force(indentation, scale, depth):  # type: ignore[no-untyped-def]
        return scale * math.expm1(indentation / depth)

    @staticmethod
    def potential(indentation, scale, depth):  # type: ignore[no-untyped-def]
        return scale * (depth * math.expm1(indentation / depth) - indentation)


class TanhContact(il.ContactLaw):
    """Pad that yields: force ``limit tanh(δ/depth)``."""

    limit: float = il.parameter(units="N", minimum=0.0)
    depth: float = il.parameter(units="m", above=0.0)

    @staticmethod
    def force(indentation, limit, depth):  # type: ignore[no-untyped-def]
        return limit * math.tanh(indentation / depth)

    @staticmethod
    def potential(indentation, limit, depth):  # type: ignore[no-untyped-def]
        return limit * depth * math.log(math.cosh(indentation / depth))


class BangContact(il.ContactLaw):
    """Pad of constant force, which is there or not."""

    push: float = il.parameter(units="N", minimum=0.0)

    @staticmethod
    def force(push):  # type: ignore[no-untyped-def]
        return push

    @staticmethod
    def potential(indentation, push):  # type: ignore[no-untyped-def]
        return push * indentation


class LankaraniNikraveshContact(il.ContactLaw):
    """Hertz contact with hysteresis damping for one speed of approach: ``η δ^(3/2) (1 + ¾(1 − e²) δ'/speed)``."""

    stiffness: float = il.parameter(units="N m-3/2", minimum=0.0)
    restitution: float = il.parameter(minimum=0.0, maximum=1.0)
    speed: float = il.parameter(units="m s-1", above=0.0)

    @staticmethod
    def force(indentation, rate, stiffness, restitution, speed):  # type: ignore[no-untyped-def]
        loss = 0.75 * (1.0 - restitution * restitution) * rate / speed
        return stiffness * indentation * math.sqrt(indentation) * (1.0 + loss)


class SlidingPadContact(il.ContactLaw):
    """Spring with a damper that works inwards alone: force ``stiffness δ + damping max(δ', 0)``."""

    stiffness: float = il.parameter(units="N m-1", minimum=0.0)
    damping: float = il.parameter(units="N s m-1", minimum=0.0)

    @staticmethod
    def force(indentation, rate, stiffness, damping):  # type: ignore[no-untyped-def]
        return stiffness * indentation + damping * max(rate, 0.0)


class CubicDragOscillator(il.Oscillator):
    """Residual force ``drag v³``."""

    drag: float = il.parameter(units="N s3 m-3", minimum=0.0)

    @staticmethod
    def residual(velocity, drag):  # type: ignore[no-untyped-def]
        return drag * velocity * velocity * velocity


class CoulombOscillator(il.Oscillator):
    """Dry friction without a peak: residual force ``friction v/sqrt(v² + creep²)``."""

    friction: float = il.parameter(units="N", minimum=0.0)
    creep: float = il.parameter(units="m s-1", above=0.0)

    @staticmethod
    def residual(velocity, friction, creep):  # type: ignore[no-untyped-def]
        return friction * velocity / math.sqrt(velocity * velocity + creep * creep)


class RayleighOscillator(il.Oscillator):
    """Self-excitation by the velocity: residual force ``growth (v²/speed² − 1) v``."""

    growth: float = il.parameter(units="N s m-1", minimum=0.0)
    speed: float = il.parameter(units="m s-1", above=0.0)

    @staticmethod
    def residual(velocity, growth, speed):  # type: ignore[no-untyped-def]
        ratio = velocity / speed
        return growth * (ratio * ratio - 1.0) * velocity


class BangStopOscillator(il.Oscillator):
    """Stops of constant force beyond a distance on either side, as a residual force."""

    push: float = il.parameter(units="N", minimum=0.0)
    distance: float = il.parameter(units="m", minimum=0.0)

    @staticmethod
    def residual(displacement, push, distance):  # type: ignore[no-untyped-def]
        if displacement > distance:
            return push
        return -push if displacement < -distance else 0.0

    @staticmethod
    def residual_potential(displacement, push, distance):  # type: ignore[no-untyped-def]
        return push * max(abs(displacement) - distance, 0.0)


class QuinticOscillator(il.Oscillator):
    """Residual force ``quintic x⁵``."""

    quintic: float = il.parameter(units="N m-5", minimum=0.0)

    @staticmethod
    def residual(displacement, quintic):  # type: ignore[no-untyped-def]
        return quintic * displacement**5

    @staticmethod
    def residual_potential(displacement, quintic):  # type: ignore[no-untyped-def]
        return quintic * displacement**6 / 6.0


class StringCoupling(il.CouplingLaw):
    """String that pulls beyond its slack, and never pushes."""

    stiffness: float = il.parameter(units="N m-1", minimum=0.0)
    slack: float = il.parameter(units="m")

    @staticmethod
    def force(extension, stiffness, slack):  # type: ignore[no-untyped-def]
        return stiffness * max(extension - slack, 0.0)


class TwoTones(il.Excitation):
    """Given force of two cosines."""

    amplitude: float = il.parameter(units="N")
    first: float = il.parameter(units="rad s-1", above=0.0)
    second: float = il.parameter(units="rad s-1", above=0.0)

    @staticmethod
    def force(time, amplitude, first, second):  # type: ignore[no-untyped-def]
        return 0.5 * amplitude * (math.cos(first * time) + math.cos(second * time))


class SquareWave(il.Excitation):
    """Given force that changes its sign twice a period."""

    amplitude: float = il.parameter(units="N")
    frequency: float = il.parameter(units="rad s-1", above=0.0)

    @staticmethod
    def force(time, amplitude, frequency):  # type: ignore[no-untyped-def]
        return amplitude if math.sin(frequency * time) >= 0.0 else -amplitude


class Blasts(il.Excitation):
    """Given force that decays after each of equally distant blasts."""

    amplitude: float = il.parameter(units="N")
    interval: float = il.parameter(units="s", above=0.0)
    decay: float = il.parameter(units="s", above=0.0)

    @staticmethod
    def force(time, amplitude, interval, decay):  # type: ignore[no-untyped-def]
        return amplitude * math.exp(-(time - interval * math.floor(time / interval)) / decay)


class PulsedNoise(il.Excitation):
    """White noise of density ``level |sin(frequency t)|³``."""

    level: float = il.parameter(units="N2 s rad-1", minimum=0.0)
    frequency: float = il.parameter(units="rad s-1", above=0.0)

    @staticmethod
    def intensity(time, level, frequency):  # type: ignore[no-untyped-def]
        return level * abs(math.sin(frequency * time)) ** 3


class FadingNoise(il.Excitation):
    """White noise that is switched on at 0 and fades."""

    level: float = il.parameter(units="N2 s rad-1", minimum=0.0)
    decay: float = il.parameter(units="s", above=0.0)

    @staticmethod
    def intensity(time, level, decay):  # type: ignore[no-untyped-def]
        return level * math.exp(-time / decay) if time > 0.0 else 0.0


class Tones(il.Excitation):
    """Sum of a few cosines of unequal distances with random phases."""

    amplitude: float = il.parameter(units="N")
    first: float = il.parameter(units="rad s-1", above=0.0)
    ratio: float = il.parameter(above=1.0)
    count: int = il.parameter(5, minimum=1)

    def lines(self) -> tuple[np.ndarray, np.ndarray]:
        """Return frequencies and amplitudes."""
        frequencies = self.first * self.ratio ** np.arange(self.count)
        return frequencies, np.full(self.count, self.amplitude / math.sqrt(self.count))


Law = Callable[..., il.ContactLaw]


def _depth(sketch: Sketch, *sides: Any, most: float = 6.0) -> tuple[float, float]:
    """Return a stiffness, and the depth at which it stores T."""
    stiffness = sketch.closed_frequency(*sides, most=most) ** 2 * sketch.reduced_mass(*sides)
    return stiffness, math.sqrt(2.0 * sketch.temperature / stiffness)


def _shape(sketch: Sketch, kind: type[il.ContactLaw]) -> Law:
    rng = sketch.rng

    def law(*sides: Any) -> il.ContactLaw:
        stiffness, depth = _depth(sketch, *sides)
        mass, thermal = sketch.reduced_mass(*sides), math.sqrt(sketch.temperature / sketch.reduced_mass(*sides))
        if kind is ConicalContact:
            return ConicalContact(3.0 * sketch.temperature / depth**3)
        if kind is ExponentialWall:
            sketch.fastest *= 2.0
            return ExponentialWall(0.5 * stiffness * depth, depth=0.7 * depth)
        if kind is TanhContact:
            return TanhContact(stiffness * depth, depth=depth * between(rng, 0.05, 1.0))
        if kind is BangContact:
            return BangContact(stiffness * depth * between(rng, 0.2, 2.0))
        if kind is LankaraniNikraveshContact:
            restitution, share = float(rng.uniform(0.1, 0.9)), between(rng, 0.3, 3.0)
            sketch.finest = min(sketch.finest, 0.05 / sketch.fastest)
            return LankaraniNikraveshContact(
                2.5 * sketch.temperature / depth**2.5, restitution=restitution, speed=share * thermal
            )
        damping = 2.0 * between(rng, 0.1, 5.0) * math.sqrt(stiffness * mass)
        sketch.finest = min(sketch.finest, 0.1 * mass / damping)
        return SlidingPadContact(stiffness, damping=damping)

    return law


_CONSERVATIVE = (ConicalContact, ExponentialWall, TanhContact, BangContact)
_LOSSY = (LankaraniNikraveshContact, SlidingPadContact)


def conservative(rng: np.random.Generator) -> Scene:
    """Conservative contacts of other shapes, at one temperature or several."""
    sketch = Sketch(rng)
    sketch.tree(number(rng, most=4), _shape(sketch, one_of(rng, *_CONSERVATIVE)), clearance=(-1.0, 2.5))
    if rng.random() < 0.4:
        _heat(sketch)
    return sketch.scene(settling=2.0)


def _heat(sketch: Sketch) -> None:
    for name, noise in list(sketch.excitations.items()):
        sketch.excitations[name] = il.WhiteNoise(noise.spectral_density * between(sketch.rng, 0.3, 3.0))  # type: ignore[attr-defined]


def lossy(rng: np.random.Generator) -> Scene:
    """Contacts with loss of other shapes."""
    sketch = Sketch(rng, ratio=(0.005, 1.0))
    sketch.tree(number(rng, most=4), _shape(sketch, one_of(rng, *_LOSSY)), clearance=(-1.0, 2.5))
    return sketch.scene()


def friction(rng: np.random.Generator) -> Scene:
    """Friction of other shapes, and another self-excitation."""
    sketch = Sketch(rng)
    kind, share = int(rng.integers(3)), between(rng, 0.05, 2.0)

    def made(**fields: Any) -> il.Oscillator:
        mass, thermal = fields["mass"], math.sqrt(sketch.temperature / fields["mass"])
        usual = math.sqrt(fields["stiffness"] * mass)
        rate = 10.0 * share * usual
        if kind == 1:
            creep = thermal * between(rng, 0.03, 1.0)
            rate = share * usual * thermal / creep
            body: il.Oscillator = CoulombOscillator(friction=share * usual * thermal, creep=creep, **fields)
        elif kind == 0:
            body = CubicDragOscillator(drag=share * usual / thermal**2, **fields)
        else:
            body = RayleighOscillator(growth=0.3 * share * usual, speed=thermal * between(rng, 0.7, 3.0), **fields)
        sketch.finest = min(sketch.finest, 0.1 * mass / rate)
        return body

    sketch.tree(number(rng, most=3), kind=made, clearance=(0.0, 2.5))
    return sketch.scene(settling=2.0)


def springs(rng: np.random.Generator) -> Scene:
    """Residual forces with jumps or high powers, and strings."""
    sketch, kind = Sketch(rng), int(rng.integers(3))

    def made(**fields: Any) -> il.Oscillator:
        spread = math.sqrt(sketch.temperature / fields["stiffness"])
        if kind == 0:
            push = fields["stiffness"] * spread * between(rng, 0.3, 3.0)
            return BangStopOscillator(push=push, distance=spread * float(rng.uniform(0.5, 2.0)), **fields)
        if kind == 1:
            sketch.fastest = max(sketch.fastest, 3.0 * math.sqrt(fields["stiffness"] / fields["mass"]))
            return QuinticOscillator(quintic=fields["stiffness"] / spread**4 * between(rng, 0.1, 2.0), **fields)
        return il.LinearOscillator(**fields)

    sketch.tree(number(rng, 1 + (kind == 2), 3), kind=made, clearance=(0.0, 2.5))
    names = list(sketch.bodies)
    if kind == 2:
        for one, other in itertools.pairwise(names):
            stiffness, _ = _depth(sketch, one, other)
            slack = float(rng.uniform(-0.5, 2.0)) * sketch.spread(one, other)
            sketch.couplings[f"string_{one}"] = il.Coupling(one, other, StringCoupling(stiffness, slack=slack))
    return sketch.scene()


def forces(rng: np.random.Generator) -> Scene:
    """Two tones, square waves and blasts, with noise on other bodies, or on linear bodies alone."""
    sketch = Sketch(rng, ratio=(0.05, 0.5))
    linear = rng.random() < 0.4
    if linear:
        sketch.body(noise=False)
        options: dict[str, Any] = {"duration": 30.0 * max(1.0, sketch.slowest * sketch.frequency) / sketch.frequency}
        options["realizations"] = 1
    else:
        sketch.tree(number(rng, 2, 3), clearance=(0.0, 2.5))
        options = sketch.scene(times=8.0).options
    body = sketch.bodies["body_0"]
    own, force = body.natural_frequency, math.sqrt(sketch.temperature * body.stiffness)
    kind, frequency = int(rng.integers(3)), own * between(rng, 0.15, 8.0)
    size = force * between(rng, 0.5, 3.0) * max(1.0, (frequency / own) ** 2)
    if kind == 0:
        second = frequency * between(rng, 1.05, 4.0)
        sketch.finest = min(sketch.finest, 0.05 / second)
        sketch.excitations["body_0"] = TwoTones(size, first=frequency, second=second)
    elif kind == 1:
        sketch.finest = min(sketch.finest, 0.01 / frequency)
        sketch.excitations["body_0"] = SquareWave(size, frequency=frequency)
    else:
        interval = 2.0 * math.pi / frequency
        sketch.finest = min(sketch.finest, 0.002 * interval)
        sketch.excitations["body_0"] = Blasts(2.0 * size, interval=interval, decay=interval * between(rng, 0.05, 0.5))
    return sketch.scene(options=options, transient=True, deterministic=linear)


def noises(rng: np.random.Generator) -> Scene:
    """Noise in pulses, noise that fades, and a few tones with random phases."""
    sketch = Sketch(rng, ratio=(0.05, 0.5))
    sketch.tree(number(rng, most=3), clearance=(-1.0, 2.0))
    kind = int(rng.integers(3))
    options = sketch.scene(times=8.0, work=0.05 if kind == 2 else 1.0).options
    for name, noise in list(sketch.excitations.items()):
        own, level = sketch.bodies[name].natural_frequency, noise.spectral_density  # type: ignore[attr-defined]
        if kind == 0:
            frequency = own * between(rng, 0.1, 10.0)
            sketch.finest = min(sketch.finest, 0.05 / frequency)
            sketch.excitations[name] = PulsedNoise(2.0 * level, frequency=frequency)
        elif kind == 1:
            decay = between(rng, 0.1, 20.0) / own
            sketch.finest = min(sketch.finest, 0.02 * decay)
            sketch.excitations[name] = FadingNoise(level * max(1.0, sketch.slowest / decay), decay=decay)
        else:
            size = math.sqrt(2.0 * sketch.temperature * sketch.bodies[name].stiffness)
            sketch.excitations[name] = Tones(size, first=own * between(rng, 0.2, 0.8), ratio=1.2345)
            sketch.finest = min(sketch.finest, 0.05 / own)
    if kind == 2:
        options["realizations"] = min(options["realizations"], 128)
        if options["duration"] + RELAXATIONS * sketch.slowest > 3000.0 / sketch.fastest * 10.0:
            raise Costly
    return sketch.scene(options=options, transient=True)


def shapes(rng: np.random.Generator) -> Scene:
    """Rings and stars, pressed together or free, with preloads and undamped bodies among them."""
    sketch = Sketch(rng)
    law = _shape(sketch, one_of(rng, *_CONSERVATIVE))
    count, ring = number(rng, 3, 5), rng.random() < 0.5
    for index in range(count):
        sketch.body()
        if index:
            sketch.touch(f"body_{index}", f"body_{index - 1 if ring else 0}", law, clearance=(-2.0, 2.0))
    if ring:
        sketch.touch("body_0", f"body_{count - 1}", law, clearance=(0.0, 2.0))
    if rng.random() < 0.4:
        last = f"body_{count - 1}"
        sketch.bodies[last] = sketch.bodies[last].replace(damping=0.0)
        del sketch.excitations[last]
    if rng.random() < 0.5:
        _heat(sketch)
    return sketch.scene(settling=2.0)


def beginnings(rng: np.random.Generator) -> Scene:
    """Given starts with loss in contacts, short runs, few realizations, extreme damping."""
    kind = int(rng.integers(3))
    ratio = one_of(rng, (0.003, 0.01), (0.05, 0.5), (3.0, 100.0)) if kind == 2 else (0.05, 0.5)
    sketch = Sketch(rng, ratio=ratio, frequencies=2.0)
    kind_of_law = one_of(rng, *_CONSERVATIVE, *_LOSSY)
    sketch.tree(number(rng, most=2), _shape(sketch, kind_of_law), clearance=(0.3, 2.0))
    if kind == 0:
        fast = {
            name: math.sqrt(sketch.temperature / body.mass) * float(rng.uniform(-5.0, 5.0))
            for name, body in sketch.bodies.items()
        }
        duration = between(rng, 0.5, 6.0) * sketch.slowest
        options = {"duration": duration, "realizations": 1024, "initial": {"velocity": fast}}
        return sketch.scene(options=options, transient=True)
    if kind == 1:
        realizations = int(rng.integers(1, 6))
        return sketch.scene(options={"realizations": realizations, "duration": 3000.0 / realizations * sketch.slowest})
    return sketch.scene(work=2.0)


def platforms(rng: np.random.Generator) -> Scene:
    """Bodies on a heavy platform that two tones shake, or noise, with stops of theirs."""
    sketch = Sketch(rng, ratio=(0.05, 0.3))
    count, heavier, own = number(rng, 2, 3), between(rng, 30.0, 3e5), sketch.frequency * between(rng, 0.7, 3.0)
    mass = heavier * sketch.mass
    base = il.LinearOscillator(mass=mass, damping=0.2 * own * mass, stiffness=mass * own**2)
    amplitude = math.sqrt(sketch.temperature / sketch.mass) / sketch.frequency
    law = _shape(sketch, one_of(rng, ConicalContact, ExponentialWall))
    mounts = {}
    for _ in range(count):
        name = sketch.body(noise=False)
        body = sketch.bodies[name]
        mounts[f"mount_{name}"] = il.Coupling("base", name, il.LinearCoupling(body.stiffness, damping=body.damping))
        if len(mounts) > 1:
            sketch.touch(name, list(sketch.bodies)[-2], law, clearance=(0.0, 1.5))
    sketch.bodies = {name: body.replace(stiffness=0.0, damping=0.0) for name, body in sketch.bodies.items()}
    sketch.bodies["base"] = base
    sketch.slowest = max(sketch.slowest, 1.0 / (0.1 * own))
    sketch.couplings = mounts
    sketch.excitations = {"base": il.WhiteNoise(base.stiffness * amplitude**2 * base.damping / math.pi)}
    return sketch.scene()


CLASSES: dict[str, Draw] = {
    "conservative": conservative,
    "lossy": lossy,
    "friction": friction,
    "springs": springs,
    "forces": forces,
    "noises": noises,
    "shapes": shapes,
    "beginnings": beginnings,
    "platforms": platforms,
}
"""Classes of scenes by name, in the order in which they are drawn."""
