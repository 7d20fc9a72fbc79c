"""Classes of networks by their contacts: smooth, with loss, with kinks, preloaded, rare."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any

import numpy as np

import impactlab as il
from impactlab_numerics.laws.contacts import BilinearContact, JumpContact, SaturatingContact
from impactlab_numerics.laws.couplings import DeadBandCoupling
from impactlab_numerics.laws.oscillators import SoftOscillator, StopOscillator
from impactlab_numerics.trust.drawing import Scene, Sketch, between, number, one_of


def home(rng: np.random.Generator) -> Scene:
    """Smooth conservative contacts and white noise at one temperature."""
    sketch = Sketch(rng)
    sketch.tree(number(rng), kind=one_of(rng, il.LinearOscillator, il.LinearOscillator, _duffing(sketch)))
    return sketch.scene()


def rate_dependent_contacts(rng: np.random.Generator) -> Scene:
    """Contacts with dashpots: damping ratios of the closed contact between 0.05 and 5."""
    sketch = Sketch(rng)
    kind = one_of(rng, "pulling dashpot", "dashpot", "Hunt and Crossley")

    def law(*sides: Any) -> il.ContactLaw:
        loss, mass = between(rng, 0.05, 5.0), sketch.reduced_mass(*sides)
        if kind == "Hunt and Crossley":
            thermal = sketch.thermal_speed(mass)
            stiffness = sketch.power(1.5, *sides)
            sketch.resolve(0.05 / (sketch.fastest * max(loss, 1.0)))
            return il.HuntCrossleyContact(stiffness, dissipation=loss / thermal)
        stiffness = sketch.power(1.0, *sides)
        damping = 2.0 * loss * math.sqrt(stiffness * mass)
        sketch.resolve(0.1 * mass / damping)
        return il.KelvinVoigtContact(stiffness, damping=damping, tension=kind == "pulling dashpot")

    sketch.tree(number(rng, most=4), law)
    if rng.random() < 0.3:
        sketch.heat(0.2, 5.0)
    return sketch.scene()


def kinked(rng: np.random.Generator) -> Scene:
    """Forces with kinks and jumps, and forces that saturate: in contacts, stops and couplings with play."""
    sketch = Sketch(rng)
    kind = int(rng.integers(8))
    if kind < 5:

        def law(*sides: Any) -> il.ContactLaw:
            stiffness = sketch.power(1.0, *sides, most=4.0)
            depth = math.sqrt(2.0 * sketch.temperature / stiffness)
            if kind == 0:
                return JumpContact(stiffness * depth * between(rng, 0.1, 3.0), stiffness=stiffness)
            if kind == 1:
                second = stiffness * between(rng, 3.0, 100.0)
                sketch.quicken(math.sqrt(second / sketch.reduced_mass(*sides)))
                return BilinearContact(stiffness, second=second, distance=depth * float(rng.uniform(0.3, 2.0)))
            if kind == 2:
                return SaturatingContact(stiffness * depth, depth=depth * between(rng, 0.03, 1.0))
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
                sketch.quicken(math.sqrt(stop / fields["mass"]))
                return StopOscillator(stop=stop, distance=spread * float(rng.uniform(0.5, 3.0)), **fields)
            width = spread * between(rng, 0.03, 1.0)
            limit = fields["stiffness"] * spread * between(rng, 0.1, 2.0)
            sketch.quicken(math.sqrt(limit / width / fields["mass"]))
            return SoftOscillator(limit=limit, width=width, **fields)

        if rng.random() < 0.5:
            sketch.body(made)
        else:
            sketch.tree(number(rng, most=3), kind=made, clearance=(0.0, 3.0))
        return sketch.scene()
    sketch.tree(number(rng, 2, 4), clearance=(0.0, 3.0))
    for index, (one, other) in enumerate(itertools.pairwise(sketch.bodies)):
        stiffness = sketch.closed_frequency(one, other) ** 2 * sketch.reduced_mass(one, other)
        play = float(rng.uniform(0.0, 3.0)) * sketch.spread(one, other)
        law_of = DeadBandCoupling(stiffness, play=play)
        sketch.couplings[f"coupling_{index}"] = il.Coupling(one, other, law_of)
    return sketch.scene()


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
    sketch.excitations["body_0"] = il.ConstantForce(one_of(rng, -1.0, 1.0) * load)
    sketch.fastest *= depth**0.25
    return sketch.scene()


def rare_contacts(rng: np.random.Generator) -> Scene:
    """Contacts at 3 to 4.5 standard deviations, in runs in which they close between 0.1 and 1000 times."""
    sketch = Sketch(rng)
    sketch.tree(number(rng, most=2), clearance=(3.0, 4.5), wall=0.0)
    return sketch.scene(work=between(rng, 0.02, 1.0))


def _duffing(sketch: Sketch) -> Callable[..., il.Oscillator]:
    share = between(sketch.rng, 0.1, 2.0)  # of the linear force at the standard deviation

    def made(**fields: Any) -> il.Oscillator:
        return il.DuffingOscillator(cubic=share * fields["stiffness"] ** 2 / sketch.temperature, **fields)

    return made
