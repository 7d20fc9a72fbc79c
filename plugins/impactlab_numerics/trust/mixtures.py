"""Scenes that mix all mechanisms: laws, couplings, structures, planes, noises, given forces and motions, records."""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np

import impactlab as il
from impactlab_numerics.trust.drawing import Scene, Sketch, between, number, one_of
from impactlab_numerics.trust.networks import Draw


def _contact_law(sketch: Sketch, *sides: Any) -> il.ContactLaw:
    """Draw a contact law: conservative, dissipative, with a state, or rigid."""
    rng, kind = sketch.rng, int(sketch.rng.integers(7))
    if kind < 2:
        return sketch.smooth(*sides)
    if kind == 2:
        return sketch.damped(*sides)
    if kind == 3:
        speed = sketch.thermal_speed(sketch.reduced_mass(*sides))
        return il.HuntCrossleyContact(sketch.power(1.5, *sides), dissipation=between(rng, 0.1, 1.0) / speed)
    if kind == 4:
        strength = sketch.power(1.5, *sides, most=4.0)
        return il.LankaraniNikraveshContact(strength, restitution=float(rng.uniform(0.4, 1.0)))
    sketch.quicken(2.0 * max(sketch.bodies[side].natural_frequency for side in sides if isinstance(side, str)))
    return il.RigidContact(one_of(rng, 1.0, float(rng.uniform(0.4, 0.95))))


def _couple(sketch: Sketch) -> None:
    """Add a coupling of any law between two bodies, or a body and the wall."""
    rng, names = sketch.rng, list(sketch.bodies)
    first = names[int(rng.integers(len(names)))]
    second = one_of(rng, il.WALL, *(name for name in names if name != first))
    stiffness = sketch.closed_frequency(first, second, most=2.0) ** 2 * sketch.reduced_mass(first, second)
    spread = math.sqrt(sketch.temperature / stiffness)
    rate = stiffness / sketch.frequency * between(rng, 0.1, 3.0)
    force = stiffness * spread * between(rng, 0.2, 2.0)
    kind = int(rng.integers(9))
    if kind == 0:
        law: Any = il.LinearCoupling(stiffness, damping=0.1 * stiffness / sketch.fastest)
    elif kind == 1:
        distance = spread * between(rng, 0.5, 3.0)
        law = il.BoucWenCoupling(stiffness, yield_displacement=distance, ratio=float(rng.uniform(0.1, 0.6)))
    elif kind == 2:
        law = il.MaxwellCoupling(stiffness, damping=rate)
    elif kind == 3:
        law = il.JenkinsCoupling(stiffness, slip_force=force)
    elif kind == 4:
        law = il.CubicCoupling(stiffness / spread**2)
        sketch.quicken(2.0 * math.sqrt(stiffness / sketch.reduced_mass(first, second)))
    elif kind == 5:
        law = il.QuadraticDampingCoupling(sketch.reduced_mass(first, second) / spread * between(rng, 0.02, 0.3))
    elif kind == 6:
        law = il.BilinearCoupling(stiffness, outer_stiffness=stiffness * between(rng, 2.0, 8.0), break_extension=spread)
        sketch.quicken(math.sqrt(8.0 * stiffness / sketch.reduced_mass(first, second)))
    elif kind == 7:
        velocity = sketch.thermal_speed(sketch.reduced_mass(first, second)) * between(rng, 0.2, 1.0)
        law = il.FrictionCoupling(0.3 * force, velocity=velocity)
        sketch.resolve(0.1 * sketch.reduced_mass(first, second) * velocity / force)
    else:
        law = il.PiezoelectricCoupling(1.0, capacitance=1.0 / stiffness, resistance=between(rng, 0.3, 3.0) * rate)
    sketch.couplings[f"coupling_{len(sketch.couplings)}"] = il.Coupling(first, second, law)


def _structure(sketch: Sketch) -> None:
    """Add a structure of two or three coordinates, by matrices or modes, that can touch a body or the wall."""
    rng, count = sketch.rng, number(sketch.rng, 2, 3)
    mass = sketch.mass * between(rng, 0.5, 2.0)
    frequency = sketch.frequency * between(rng, 1.0, 2.0)
    frequencies = frequency * np.cumsum(rng.uniform(0.7, 2.0, count))
    ratio = between(rng, 0.03, 0.2)
    sketch.quicken(float(frequencies[-1]))
    sketch.slowest = max(sketch.slowest, 1.0 / (ratio * float(frequencies[0])))
    shape = rng.uniform(0.4, 1.2, count) * rng.choice([-1.0, 1.0], count)
    if rng.random() < 0.5:
        made: Any = il.ModalStructure(
            tuple(frequencies.tolist()), ratio, points={"top": tuple(shape.tolist())}, mass=mass
        )
        top = "structure.top"
        inertia = mass / float(shape @ shape)
        softness = float(np.sum(shape**2 / (mass * frequencies**2)))
    else:
        stiffness = mass * frequency**2 * (2.0 * np.eye(count) - np.eye(count, k=1) - np.eye(count, k=-1))
        made = il.LinearStructure.from_damping_ratio(np.full(count, mass), stiffness, ratio)
        top, inertia = f"structure.{count}", mass
        softness = float(np.linalg.inv(stiffness)[-1, -1])
        sketch.quicken(2.0 * frequency)
        sketch.slowest = max(sketch.slowest, 2.0 / (ratio * frequency))
    other = one_of(rng, il.WALL, *sketch.bodies)
    closed = sketch.fastest * between(rng, 0.5, 1.5)
    sketch.quicken(closed)
    clearance = float(rng.uniform(-0.5, 1.5)) * math.sqrt(sketch.temperature * softness)
    sketch.contacts["top"] = il.Contact(top, other, il.LinearContact(inertia * closed**2), clearance=clearance)
    level = sketch.temperature * ratio * frequency * mass / math.pi
    sketch.excitations["floor"] = il.Source(il.WhiteNoise(level), on={top: 1.0})  # type: ignore[assignment]
    sketch.bodies["structure"] = made


def _plane(sketch: Sketch) -> None:
    """Add a body that moves in a plane within a ring, with friction or without."""
    rng = sketch.rng
    first = sketch.body()
    body = sketch.bodies[first]
    second = sketch.body(mass=body.mass, stiffness=body.stiffness, damping=body.damping)
    spread = sketch.spread(first)
    law = il.LinearContact(sketch.closed_frequency(first, most=4.0) ** 2 * body.mass)
    friction: dict[str, float] = {}
    if rng.random() < 0.4:
        friction = {"friction_coefficient": 0.2, "friction_velocity": 0.3 * sketch.thermal_speed(body.mass)}
    clearance = float(rng.uniform(0.3, 1.5)) * spread
    sketch.contacts["ring"] = il.RoundContact((first, second), il.WALL, law, clearance=clearance, **friction)  # type: ignore


def _excite(sketch: Sketch) -> bool:
    """Add an excitation of another kind to a body, or change its own; return whether means depend on the time."""
    rng, levels = sketch.rng, sketch.levels()
    names = list(levels)
    name = names[int(rng.integers(len(names)))]
    body, level = sketch.bodies[name], levels[name]
    own, kind = body.natural_frequency, int(rng.integers(7))
    force = math.sqrt(sketch.temperature * body.stiffness)
    if kind == 0:
        noise = il.OrnsteinUhlenbeckNoise(level, correlation_time=between(rng, 0.1, 1.0) / own)
        sketch.excitations[name] = noise
    elif kind == 1:
        ground = il.KanaiTajimi(level / body.mass**2, own * between(rng, 0.7, 3.0), float(rng.uniform(0.3, 0.8)))
        sketch.excitations["ground"] = il.Source(ground, on={name: -body.mass})  # type: ignore[assignment]
        del sketch.excitations[name]
    elif kind == 2:
        rate = own * between(rng, 0.2, 2.0)
        size = math.sqrt(2.0 * math.pi * level / rate)
        sketch.excitations[name] = il.PoissonImpulses(rate, mean=0.3 * size, standard_deviation=0.95 * size)
    elif kind == 3:
        frequency = own * between(rng, 0.3, 2.0)
        wave = il.Harmonic(0.3 * force, frequency=frequency)
        sketch.excitations["wave"] = il.Source(wave, on={name: 1.0})  # type: ignore[assignment]
        return True
    elif kind == 4:
        load = il.ConstantForce(force * float(rng.uniform(-1.0, 1.0)))
        sketch.excitations["load"] = il.Source(load, on={name: 1.0})  # type: ignore[assignment]
    elif kind == 5:
        times = np.linspace(0.0, 4.0 * sketch.slowest, 5)
        envelope = rng.uniform(0.2, 1.5, 5)
        sketch.excitations[name] = il.ModulatedNoise(level, times.tolist(), envelope.tolist())
        return True
    else:
        on = {other: math.sqrt(levels[other]) for other in names}
        sketch.excitations["common"] = il.Source(il.WhiteNoise(0.5), on=on)  # type: ignore[assignment]
    return False


def _shake(sketch: Sketch) -> None:
    """Add a table of given motion that a body can touch."""
    rng = sketch.rng
    name = one_of(rng, *(item for item in sketch.bodies if item.startswith("body")))
    frequency = sketch.bodies[name].natural_frequency * between(rng, 0.3, 1.5)
    spread = sketch.spread(name)
    law = il.LinearContact(sketch.closed_frequency(name, most=4.0) ** 2 * sketch.bodies[name].mass)
    table: Any = il.PrescribedMotion(il.Harmonic(0.3 * spread, frequency=frequency))
    sketch.contacts["table"] = il.Contact("table", name, law, clearance=float(rng.uniform(0.2, 1.5)) * spread)
    sketch.bodies["table"] = table


def _records(sketch: Sketch) -> list[il.Record]:
    """Draw records, none of them in half of all scenes."""
    rng = sketch.rng
    if rng.random() < 0.5:
        return []
    offered = [il.PerRealization(), il.Density(bins=20), il.Spectrum(), il.FinalState()]
    without = [item for item in sketch.contacts.values() if isinstance(item, il.RoundContact)]
    without += [item for item in sketch.contacts.values() if isinstance(item.law, il.RigidContact)]
    if not without:  # contacts whose crossings are not recorded
        offered.append(il.PeakForces())
    chosen = rng.choice(len(offered), int(rng.integers(1, len(offered) + 1)), replace=False)
    return [offered[index] for index in chosen]


def mixture(rng: np.random.Generator) -> Scene:
    """Two to five mechanisms in one network, with records, many realizations or few."""
    sketch, transient = Sketch(rng, ratio=(0.03, 0.4), frequencies=2.0), False

    def made(**fields: Any) -> il.Oscillator:
        draw = rng.random()
        if draw < 0.15:
            spread = sketch.temperature / fields["stiffness"]
            sketch.quicken(2.0 * math.sqrt(fields["stiffness"] / fields["mass"]))
            return il.DuffingOscillator(cubic=fields["stiffness"] / spread * between(rng, 0.1, 1.0), **fields)
        if draw < 0.25:
            frequency = math.sqrt(fields["stiffness"] / fields["mass"])
            return il.ParametricOscillator(0.1, frequency=frequency * between(rng, 0.5, 1.5), **fields)
        return il.LinearOscillator(**fields)

    sketch.tree(number(rng, most=3), lambda *sides: _contact_law(sketch, *sides), clearance=(0.0, 2.0), kind=made)
    transient = any(isinstance(body, il.ParametricOscillator) for body in sketch.bodies.values())
    if rng.random() < 0.25:
        _plane(sketch)
    if rng.random() < 0.6:
        _couple(sketch)
    if rng.random() < 0.7:
        transient |= _excite(sketch)
    if rng.random() < 0.25:
        _shake(sketch)
        transient = True
    if rng.random() < 0.3:
        _structure(sketch)
    options: dict[str, Any] = {}
    if rng.random() < 0.15:
        realizations = int(rng.integers(1, 6))
        options = {"realizations": realizations, "duration": 3000.0 / realizations * sketch.slowest}
    elif transient:
        options = sketch.scene(times=8.0).options
    records = _records(sketch)
    if records:
        options["record"] = records
    return sketch.scene(options=options, transient=transient, settling=2.0, work=0.5)


CLASSES: dict[str, Draw] = {"mixtures": mixture}
"""Classes of scenes by name."""


def coarse(scene: Scene, steps: int = 96, realizations: int = 5) -> tuple[il.Network, dict[str, Any]]:
    """Return a network and options of a short run at a given step, for what holds bit by bit at any step."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        step = 0.3 * scene.network.check().dataset.attrs["step"]
    return scene.network, {
        "step": step, "duration": steps * step, "realizations": realizations, "initial": "rest", "spin_up": 0.0
    }  # fmt: skip
