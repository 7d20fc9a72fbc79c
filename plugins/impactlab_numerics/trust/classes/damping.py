"""Classes of networks by their damping: in residual forces, weak, strong, none in the middle of a row."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

import impactlab as il
from impactlab_numerics.laws.oscillators import (
    DragOscillator,
    FrictionOscillator,
    ViscousOscillator,
)
from impactlab_numerics.trust.drawing import Scene, Sketch, between, number


def residual_damping(rng: np.random.Generator) -> Scene:
    """Damping in residual forces: linear, quadratic, of friction, negative."""
    sketch = Sketch(rng)
    kind, share = int(rng.integers(4)), between(rng, 0.05, 2.0)
    plain: dict[str, il.Oscillator] = {}

    def made(**fields: Any) -> il.Oscillator:
        mass, stiffness, thermal = fields["mass"], fields["stiffness"], sketch.thermal_speed(fields["mass"])
        usual = math.sqrt(stiffness * mass)  # a dashpot of damping ratio 1/2
        body: il.Oscillator
        if kind == 0:
            viscous = 2.0 * share * usual
            name = f"body_{len(sketch.bodies)}"
            plain[name] = il.LinearOscillator(**(fields | {"damping": fields["damping"] + viscous}))
            rate = viscous
            body = ViscousOscillator(viscous=viscous, **fields)
        elif kind == 1:
            drag = share * usual / thermal
            rate, body = 6.0 * drag * thermal, DragOscillator(drag=drag, **fields)
        elif kind == 2:
            friction, creep = 0.5 * share * usual * thermal, thermal * between(rng, 0.02, 1.0)
            rate, body = friction / creep, FrictionOscillator(friction=friction, creep=creep, **fields)
        else:
            width = math.sqrt(sketch.temperature / stiffness) * between(rng, 0.5, 3.0)
            growth = 0.5 * share * usual
            rate, body = 8.0 * growth, il.VanDerPolOscillator(growth=growth, width=width, **fields)
        sketch.resolve(0.1 * mass / rate)
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
        sketch.heat(0.5, 2.0)
        return sketch.scene(work=2.0, settling=3.0)
    network = sketch.network()  # at one temperature the law is the same whoever is damped
    damped = {name: body.replace(damping=sketch.mass * sketch.frequency) for name, body in network.oscillators.items()}
    noises = {name: il.WhiteNoise(sketch.temperature * body.damping / math.pi) for name, body in damped.items()}
    return sketch.scene(work=2.0, equivalent=network.replace(oscillators=damped, excitations=noises))
