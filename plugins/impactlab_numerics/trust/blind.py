"""Fifty more scenes, with laws and parameters that no rule was made with; to be run when all rules are settled."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np

import impactlab as il
from impactlab_numerics.laws.contacts import (
    BangContact,
    ConicalContact,
    ExponentialWall,
    HysteresisDampingContact,
    SlidingPadContact,
    TanhContact,
)
from impactlab_numerics.laws.couplings import StringCoupling
from impactlab_numerics.laws.excitations import Blasts, FadingNoise, PulsedNoise, SquareWave, Tones, TwoTones
from impactlab_numerics.laws.oscillators import (
    BangStopOscillator,
    CoulombOscillator,
    CubicDragOscillator,
    QuinticOscillator,
)
from impactlab_numerics.trust.drawing import RELAXATIONS, Costly, Law, Scene, Sketch, between, number, one_of
from impactlab_numerics.trust.networks import Draw


def _depth(sketch: Sketch, *sides: Any, most: float = 6.0) -> tuple[float, float]:
    """Return a stiffness, and the depth at which it stores T."""
    stiffness = sketch.closed_frequency(*sides, most=most) ** 2 * sketch.reduced_mass(*sides)
    return stiffness, math.sqrt(2.0 * sketch.temperature / stiffness)


def _shape(sketch: Sketch, kind: type[il.ContactLaw]) -> Law:
    rng = sketch.rng

    def law(*sides: Any) -> il.ContactLaw:
        stiffness, depth = _depth(sketch, *sides)
        mass, thermal = sketch.reduced_mass(*sides), sketch.thermal_speed(sketch.reduced_mass(*sides))
        if kind is ConicalContact:
            return ConicalContact(3.0 * sketch.temperature / depth**3)
        if kind is ExponentialWall:
            sketch.fastest *= 2.0
            return ExponentialWall(0.5 * stiffness * depth, depth=0.7 * depth)
        if kind is TanhContact:
            return TanhContact(stiffness * depth, depth=depth * between(rng, 0.05, 1.0))
        if kind is BangContact:
            return BangContact(stiffness * depth * between(rng, 0.2, 2.0))
        if kind is HysteresisDampingContact:
            restitution, share = float(rng.uniform(0.1, 0.9)), between(rng, 0.3, 3.0)
            sketch.resolve(0.05 / sketch.fastest)
            return HysteresisDampingContact(
                2.5 * sketch.temperature / depth**2.5, restitution=restitution, speed=share * thermal
            )
        damping = 2.0 * between(rng, 0.1, 5.0) * math.sqrt(stiffness * mass)
        sketch.resolve(0.1 * mass / damping)
        return SlidingPadContact(stiffness, damping=damping)

    return law


_CONSERVATIVE = (ConicalContact, ExponentialWall, TanhContact, BangContact)
_LOSSY = (HysteresisDampingContact, SlidingPadContact)


def conservative(rng: np.random.Generator) -> Scene:
    """Conservative contacts of other shapes, at one temperature or several."""
    sketch = Sketch(rng)
    sketch.tree(number(rng, most=4), _shape(sketch, one_of(rng, *_CONSERVATIVE)), clearance=(-1.0, 2.5))
    if rng.random() < 0.4:
        sketch.heat(0.3, 3.0)
    return sketch.scene(settling=2.0)


def lossy(rng: np.random.Generator) -> Scene:
    """Dissipative contacts of other shapes."""
    sketch = Sketch(rng, ratio=(0.005, 1.0))
    sketch.tree(number(rng, most=4), _shape(sketch, one_of(rng, *_LOSSY)), clearance=(-1.0, 2.5))
    return sketch.scene()


def friction(rng: np.random.Generator) -> Scene:
    """Friction of other shapes, and another self-excitation."""
    sketch = Sketch(rng)
    kind, share = int(rng.integers(3)), between(rng, 0.05, 2.0)

    def made(**fields: Any) -> il.Oscillator:
        mass, thermal = fields["mass"], sketch.thermal_speed(fields["mass"])
        usual = math.sqrt(fields["stiffness"] * mass)
        rate = 10.0 * share * usual
        if kind == 1:
            creep = thermal * between(rng, 0.03, 1.0)
            rate = share * usual * thermal / creep
            body: il.Oscillator = CoulombOscillator(friction=share * usual * thermal, creep=creep, **fields)
        elif kind == 0:
            body = CubicDragOscillator(drag=share * usual / thermal**2, **fields)
        else:
            body = il.RayleighOscillator(growth=0.3 * share * usual, speed=thermal * between(rng, 0.7, 3.0), **fields)
        sketch.resolve(0.1 * mass / rate)
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
            sketch.quicken(3.0 * math.sqrt(fields["stiffness"] / fields["mass"]))
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
        sketch.resolve(0.05 / second)
        sketch.excitations["body_0"] = TwoTones(size, first=frequency, second=second)
    elif kind == 1:
        sketch.resolve(0.01 / frequency)
        sketch.excitations["body_0"] = SquareWave(size, frequency=frequency)
    else:
        interval = 2.0 * math.pi / frequency
        sketch.resolve(0.002 * interval)
        sketch.excitations["body_0"] = Blasts(2.0 * size, interval=interval, decay=interval * between(rng, 0.05, 0.5))
    return sketch.scene(options=options, transient=True, deterministic=linear)


def noises(rng: np.random.Generator) -> Scene:
    """Noise in pulses, noise that fades, and a few tones with random phases."""
    sketch = Sketch(rng, ratio=(0.05, 0.5))
    sketch.tree(number(rng, most=3), clearance=(-1.0, 2.0))
    kind = int(rng.integers(3))
    options = sketch.scene(times=8.0, work=0.05 if kind == 2 else 1.0).options
    for name, level in sketch.levels().items():
        own = sketch.bodies[name].natural_frequency
        if kind == 0:
            frequency = own * between(rng, 0.1, 10.0)
            sketch.resolve(0.05 / frequency)
            sketch.excitations[name] = PulsedNoise(2.0 * level, frequency=frequency)
        elif kind == 1:
            decay = between(rng, 0.1, 20.0) / own
            sketch.resolve(0.02 * decay)
            sketch.excitations[name] = FadingNoise(level * max(1.0, sketch.slowest / decay), decay=decay)
        else:
            size = math.sqrt(2.0 * sketch.temperature * sketch.bodies[name].stiffness)
            sketch.excitations[name] = Tones(size, first=own * between(rng, 0.2, 0.8), ratio=1.2345)
            sketch.resolve(0.05 / own)
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
        sketch.undamp(f"body_{count - 1}")
    if rng.random() < 0.5:
        sketch.heat(0.3, 3.0)
    return sketch.scene(settling=2.0)


def beginnings(rng: np.random.Generator) -> Scene:
    """Given starts with loss in contacts, short runs, few realizations, extreme damping."""
    kind = int(rng.integers(3))
    ratio = one_of(rng, (0.003, 0.01), (0.05, 0.5), (3.0, 100.0)) if kind == 2 else (0.05, 0.5)
    sketch = Sketch(rng, ratio=ratio, frequencies=2.0)
    kind_of_law = one_of(rng, *_CONSERVATIVE, *_LOSSY)
    sketch.tree(number(rng, most=2), _shape(sketch, kind_of_law), clearance=(0.3, 2.0))
    if kind == 0:
        fast, duration = sketch.velocities(5.0), between(rng, 0.5, 6.0) * sketch.slowest
        options = {"duration": duration, "realizations": 1024, "initial": {"velocity": fast}}
        return sketch.scene(options=options, transient=True)
    if kind == 1:
        realizations = int(rng.integers(1, 6))
        return sketch.scene(options={"realizations": realizations, "duration": 3000.0 / realizations * sketch.slowest})
    return sketch.scene(work=2.0)


def platforms(rng: np.random.Generator) -> Scene:
    """Bodies on a heavy platform that noise shakes; each can touch the one before."""
    sketch = Sketch(rng, ratio=(0.05, 0.3))
    count, heavier, own = number(rng, 2, 3), between(rng, 30.0, 3e5), sketch.frequency * between(rng, 0.7, 3.0)
    mass = heavier * sketch.mass
    base = il.LinearOscillator(mass=mass, damping=0.2 * own * mass, stiffness=mass * own**2)
    amplitude = sketch.thermal_speed(sketch.mass) / sketch.frequency
    law = _shape(sketch, one_of(rng, ConicalContact, ExponentialWall))
    sketch.mount(count, base, clearance=(0.0, 1.5), law=law)
    sketch.slowest = max(sketch.slowest, 1.0 / (0.1 * own))
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
