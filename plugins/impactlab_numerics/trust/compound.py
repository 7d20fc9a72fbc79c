"""Scenes of combinations of coordinates, shared excitations, structures, and laws with states."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np

import impactlab as il
from impactlab_numerics.trust.drawing import RELAXATIONS, Scene, Sketch, between, number, one_of
from impactlab_numerics.trust.networks import Draw


def _weights(sketch: Sketch, least: int = 2) -> dict[str, float]:
    """Draw weights of some bodies, of either sign."""
    rng, names = sketch.rng, list(sketch.bodies)
    count = int(rng.integers(min(least, len(names)), len(names) + 1))
    chosen = rng.choice(names, count, replace=False).tolist()
    return {name: between(rng, 0.3, 2.0) * one_of(rng, -1.0, 1.0) for name in chosen}


def _law(sketch: Sketch, weights: dict[str, float]) -> tuple[il.ContactLaw, float]:
    """Draw a contact law along a combination, and return it with the standard deviation of the gap by springs alone."""
    rng = sketch.rng
    own = max(sketch.bodies[name].natural_frequency for name in weights)
    mass = 1.0 / sum(weight**2 / sketch.bodies[name].mass for name, weight in weights.items())
    frequency = own * between(rng, 0.5, 6.0)
    sketch.quicken(frequency)
    tangent, exponent = mass * frequency**2, one_of(rng, 1.0, 1.5)
    depth = math.sqrt(exponent * (exponent + 1.0) * sketch.temperature / tangent)
    strength = (exponent + 1.0) * sketch.temperature / depth ** (exponent + 1.0)
    law = il.HertzContact(strength) if exponent == 1.5 else il.LinearContact(strength)
    flexibility = sum(weight**2 / sketch.bodies[name].stiffness for name, weight in weights.items())
    return law, math.sqrt(sketch.temperature * flexibility)


def combinations(rng: np.random.Generator) -> Scene:
    """Contacts and couplings along combinations of coordinates, at one temperature or several."""
    sketch = Sketch(rng)
    for _ in range(number(rng, 2, 5)):
        sketch.body()
    for index in range(number(rng, 1, 3)):
        weights = _weights(sketch)
        law, spread = _law(sketch, weights)
        clearance = float(rng.uniform(-1.0, 2.5)) * spread
        point = il.Combination(weights)
        first, second = (point, il.WALL) if rng.random() < 0.5 else (il.WALL, point)
        sketch.contacts[f"contact_{index}"] = il.Contact(first, second, law, clearance=clearance)
    if rng.random() < 0.4:
        weights = _weights(sketch)
        mass = 1.0 / sum(weight**2 / sketch.bodies[name].mass for name, weight in weights.items())
        frequency = sketch.frequency * between(rng, 0.3, 2.0)
        spring = il.LinearCoupling(mass * frequency**2, damping=0.1 * mass * frequency)
        sketch.couplings["link"] = il.Coupling(il.Combination(weights), il.WALL, spring)
    if rng.random() < 0.5:
        sketch.heat(0.3, 3.0)
    return sketch.scene(settling=2.0)


def shared_excitations(rng: np.random.Generator) -> Scene:
    """One noise on several bodies, beside their own or alone, and a second noise of one body."""
    sketch = Sketch(rng)
    sketch.tree(number(rng, 2, 4), clearance=(-1.0, 2.5))
    names, levels = list(sketch.bodies), sketch.levels()
    share = one_of(rng, 1.0, float(rng.uniform(0.2, 0.8)))  # part of the intensity that is common
    on = {name: math.sqrt(levels[name]) * one_of(rng, -1.0, 1.0) for name in names}
    own = {name: il.WhiteNoise((1.0 - share) * levels[name]) for name in names if share < 1.0}
    sources: dict[str, Any] = {"common": il.Source(il.WhiteNoise(share), on=on)}
    if rng.random() < 0.5:
        name = names[int(rng.integers(len(names)))]
        sources["wind"] = il.Source(il.WhiteNoise(between(rng, 0.1, 1.0) * levels[name]), on=name)
    network = il.Network(sketch.bodies, sketch.contacts, own | sources, sketch.couplings)
    return sketch.scene(network=network, settling=2.0)


def _tower(sketch: Sketch, storeys: int, modal: bool) -> tuple[Any, np.ndarray, str, float]:
    """Draw a tower: the structure, its masses, the name of its top, and the flexibility of the top (m N-1)."""
    rng = sketch.rng
    mass = sketch.mass * np.array([between(rng, 0.5, 2.0) for _ in range(storeys)])
    lowest = sketch.frequency * between(rng, 1.0, 2.0)
    springs = mass.sum() * (storeys * lowest) ** 2 * np.array([between(rng, 0.7, 1.5) for _ in range(storeys)]) / 2.0
    stiffness = np.diag(springs + np.append(springs[1:], 0.0)) - np.diag(springs[1:], 1) - np.diag(springs[1:], -1)
    root = np.sqrt(mass)
    squares, shapes = np.linalg.eigh(stiffness / np.outer(root, root))
    frequencies, ratio = np.sqrt(squares), between(rng, 0.02, 0.2)
    sketch.quicken(float(frequencies[-1]))
    sketch.slowest = max(sketch.slowest, 1.0 / (ratio * frequencies[0]))
    flexibility = float(np.linalg.inv(stiffness)[-1, -1])
    if modal:
        kept = max(1, storeys - int(rng.integers(2)))
        points = {"top": tuple((shapes / root[:, None])[-1, :kept].tolist())}
        ratios = (ratio,) * kept
        made = il.ModalStructure(tuple(frequencies[:kept].tolist()), damping_ratios=ratios, points=points)
        return made, mass, "top", flexibility
    matrix = np.diag(mass) if rng.random() < 0.5 else _consistent(mass)
    return il.LinearStructure.from_damping_ratio(matrix, stiffness, ratio), mass, str(storeys), flexibility


def _consistent(mass: np.ndarray) -> np.ndarray:
    """Return a full mass matrix, part of which couples neighbours as in finite elements."""
    between_neighbours = np.diag(np.sqrt(mass[1:] * mass[:-1]), 1) / 6.0
    return np.asarray(np.diag(mass) * (2.0 / 3.0) + between_neighbours + between_neighbours.T)


def structures(rng: np.random.Generator) -> Scene:
    """A tower, by matrices or modes, that pounds another one or a stop at its top, under noises of its floors."""
    sketch = Sketch(rng)
    towers, tops, flexibility, top_mass = {}, [], 0.0, math.inf
    excitations: dict[str, Any] = {}
    for place in range(number(rng, 1, 2)):
        name, modal = f"tower_{place}", rng.random() < 0.4
        made, mass, top, soft = _tower(sketch, number(rng, 2, 4), modal)
        towers[name] = made
        tops.append(f"{name}.{top}")
        flexibility, top_mass = flexibility + soft, min(top_mass, float(mass[-1]))
        level = sketch.temperature * 0.1 * sketch.frequency / math.pi
        floors = ["top"] if modal else list(made.names)
        if rng.random() < 0.5:
            moved = zip(floors, mass[-len(floors) :].tolist(), strict=True)
            on = {f"{name}.{floor}": -item for floor, item in moved}
            excitations[f"ground_{place}"] = il.Source(il.WhiteNoise(level / float(mass.mean())), on=on)
        else:
            excitations |= {f"{name}.{floor}": il.WhiteNoise(level * float(mass.mean())) for floor in floors}
    frequency = sketch.fastest * between(rng, 0.5, 2.0)
    sketch.quicken(frequency)
    stiffness = top_mass * frequency**2
    depth = math.sqrt(2.0 * sketch.temperature / stiffness)
    law = one_of(rng, il.LinearContact(stiffness), il.HertzContact(2.5 * sketch.temperature / depth**2.5))
    clearance = float(rng.uniform(-0.5, 1.5)) * math.sqrt(sketch.temperature * flexibility)
    other = tops[1] if len(tops) == 2 else il.WALL
    network = il.Network(towers, {"top": il.Contact(tops[0], other, law, clearance=clearance)}, excitations)
    step, settling, count = 0.5 / sketch.fastest, RELAXATIONS * sketch.slowest, len(network.oscillators)
    affordable = 6e6 * step / count
    options = {"duration": max(4.0 * sketch.slowest, affordable / 128 - settling), "realizations": 128}
    return Scene(network, options, min(sketch.finest, 0.05 / sketch.fastest), settling=2.0)


def laws_with_states(rng: np.random.Generator) -> Scene:
    """Contacts that know how they closed, Maxwell elements and hysteretic springs."""
    sketch, kind = Sketch(rng, ratio=(0.05, 0.5)), int(rng.integers(3))

    def contact(*sides: Any) -> il.ContactLaw:
        strength = sketch.power(1.5, *sides, most=4.0)
        return il.LankaraniNikraveshContact(strength, restitution=float(rng.uniform(0.4, 1.0)))

    sketch.tree(number(rng, 2, 3), contact if kind == 0 else None, clearance=(0.0, 2.5))
    if kind:
        for one, other in itertools.pairwise(list(sketch.bodies)):
            stiffness = sketch.closed_frequency(one, other, most=2.0) ** 2 * sketch.reduced_mass(one, other)
            depth = math.sqrt(2.0 * sketch.temperature / stiffness)
            if kind == 1:
                law: Any = il.MaxwellCoupling(stiffness, damping=stiffness / sketch.frequency * between(rng, 0.1, 5.0))
            else:
                law = il.BoucWenCoupling(
                    stiffness, yield_displacement=depth * between(rng, 0.3, 3.0), ratio=float(rng.uniform(0.0, 0.5))
                )
            sketch.couplings[f"link_{one}"] = il.Coupling(one, other, law)
    return sketch.scene(settling=2.0, work=0.5)


CLASSES: dict[str, Draw] = {
    "combinations": combinations,
    "shared excitations": shared_excitations,
    "structures": structures,
    "laws with states": laws_with_states,
}
"""Classes of scenes by name, in the order in which they are drawn."""
