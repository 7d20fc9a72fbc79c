"""Classes of networks by their excitation: given forces, varying or bounded noise, a base, bodies hot and cold."""

from __future__ import annotations

import math

import numpy as np

import impactlab as il
from impactlab_numerics.laws.excitations import GustNoise, PulsatingNoise
from impactlab_numerics.trust.drawing import RELAXATIONS, Costly, Scene, Sketch, between, number, one_of, relaxation


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
            sketch.quicken(math.sqrt(2.0 * stiffness / sketch.reduced_mass("body_0", other)))
    elif kind == 1:  # contacts with loss, so that the motion follows the force
        sketch.body(noise=False)
        sketch.touch("body_0", il.WALL, sketch.damped, clearance=(0.0, 2.0))
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


def _given_force(sketch: Sketch, name: str, duration: float) -> il.Excitation:
    """Draw a force on a body that moves it by a few standard deviations."""
    rng, body = sketch.rng, sketch.bodies[name]
    own, force = body.natural_frequency, math.sqrt(sketch.temperature * body.stiffness)
    kind = int(rng.integers(4))
    if kind == 0:
        width = between(rng, 0.03, 10.0) / own
        sketch.resolve(width / 100.0)
        begin = float(rng.uniform(0.0, 0.3)) * duration
        return il.Pulse(force * max(1.0, 1.0 / (own * width)), duration=width, start=begin)
    if kind == 1:
        first, last = own * between(rng, 0.1, 1.0), own * between(rng, 1.0, 10.0)
        sketch.resolve(0.05 / last)
        return il.Chirp(force, start_frequency=first, end_frequency=last, duration=duration)
    frequency = own * between(rng, 0.1, 15.0)
    if rng.random() < 0.3:  # a whole number of times as often as the run is looked at in 256 parts
        frequency = 2.0 * math.pi * 256.0 / duration * max(1, round(frequency * duration / (2.0 * math.pi * 256.0)))
    sketch.resolve(0.05 / frequency)
    return il.Harmonic(force * between(rng, 0.5, 5.0) * max(1.0, (frequency / own) ** 2), frequency=frequency)


def varying_noise(rng: np.random.Generator) -> Scene:
    """White noise whose density swings, or gusts."""
    sketch = Sketch(rng, ratio=(0.05, 0.5))
    if rng.random() < 0.3:
        sketch.body()
    else:
        sketch.tree(number(rng, most=3))
    options = sketch.scene(times=10.0).options
    kind = int(rng.integers(2))
    for name, level in sketch.levels().items():
        own = sketch.bodies[name].natural_frequency
        if kind == 0:
            frequency = own * between(rng, 0.05, 20.0)
            sketch.resolve(0.1 / frequency)
            sketch.excitations[name] = PulsatingNoise(level, frequency=frequency)
        else:
            width = between(rng, 0.02, 10.0) / own
            sketch.resolve(0.05 * width)
            share = max(1.0, sketch.slowest / width)
            middle = float(rng.uniform(0.1, 0.6)) * options["duration"]
            sketch.excitations[name] = GustNoise(
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
    for name, level in sketch.levels().items():
        top = sketch.bodies[name].natural_frequency * between(rng, 1.5, 10.0) / (2.0 * math.pi)
        components = math.ceil(3.0 * (duration + spin_up) * top)  # the spin-up may be longer than of bodies alone
        if components > 10_000:
            raise Costly
        sketch.excitations[name] = il.ShinozukaNoise(level, band=(0.0, top), components=components)
        sketch.resolve(0.1 / (2.0 * math.pi * top))
    return scene._replace(network=sketch.network())


def heavy_bases(rng: np.random.Generator) -> Scene:
    """Bodies on one shaken base, 10² to 10⁶ times as heavy, that touch each other."""
    sketch = Sketch(rng, ratio=(0.05, 0.3))
    count, heavier = number(rng, 2, 3), between(rng, 1e2, 1e6)
    own = sketch.frequency * between(rng, 0.7, 3.0)
    mass, ratio = heavier * sketch.mass, between(rng, 0.05, 0.3)
    base = il.LinearOscillator(mass=mass, damping=2.0 * ratio * own * mass, stiffness=mass * own**2)
    amplitude = sketch.thermal_speed(sketch.mass) / sketch.frequency
    density = (base.stiffness * amplitude**2) * base.damping / math.pi
    sketch.mount(count, base, clearance=(0.0, 2.0))
    sketch.slowest = max(sketch.slowest, relaxation(base))
    sketch.excitations = {"base": il.WhiteNoise(density)}
    if rng.random() < 0.3:
        options = sketch.scene(times=10.0).options
        frequency = own * between(rng, 0.3, 3.0)
        sketch.resolve(0.05 / frequency)
        sketch.excitations["base"] = il.Harmonic(mass * own**2 * amplitude, frequency=frequency)
        for name in list(sketch.bodies)[:count]:
            damping = sketch.couplings[f"mount_{name}"].law.linear[1]
            sketch.excitations[name] = il.WhiteNoise(0.1 * sketch.temperature * damping / math.pi)
        return sketch.scene(options=options, transient=True)
    return sketch.scene()


def unequal_temperatures(rng: np.random.Generator) -> Scene:
    """Bodies at temperatures up to 25 times apart; some between them are not damped at all."""
    sketch = Sketch(rng)
    sketch.tree(number(rng, 2, 5), clearance=(-1.0, 2.0))
    sketch.heat(0.2, 5.0)
    names = list(sketch.bodies)
    if len(names) > 2 and rng.random() < 0.4:
        sketch.undamp(names[1])
    return sketch.scene(settling=2.0)
