"""Wild scenes: valid networks and options of any scale."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

import impactlab as il
from impactlab_numerics.laws.excitations import Burst
from impactlab_numerics.laws.oscillators import DragOscillator, SofteningOscillator

FAMILIES = 32
"""Kinds of networks: scenes of a family share compiled code, since only numbers and graphs differ."""

LIMIT = 1.0
"""Work that a scene may be foreseen to take (s)."""


class Scene(NamedTuple):
    """A network and options of `impactlab.simulate`."""

    network: il.Network
    options: dict[str, Any]


class _Draw:
    """Random numbers of a scene; `decades` is how far its scales lie apart."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self.decades = float(rng.choice([0.3, 1.0, 2.0, 4.0, 6.0]))

    def chance(self, probability: float) -> bool:
        return bool(self.rng.random() < probability)

    def scale(self, decades: float | None = None) -> float:
        """Return a number around 1, uniform in its logarithm."""
        decades = self.decades if decades is None else decades
        return float(10.0 ** self.rng.uniform(-decades, decades))

    def one(self, choices: Any) -> Any:
        return choices[int(self.rng.integers(len(choices)))]


def wild_scene(seed: int) -> Scene:
    """Return a valid scene of 1 to 8 bodies, of any scale.

    Masses and temperatures lie up to six decades on either side of 1, stiffnesses of contacts go up to
    1e12, damping from none to overdamped; there are walls, preloads, loops, couplings of any strength,
    laws with rates, softening and hardening springs, all kinds of excitation, integrators, starts and
    records, and steps and durations, given or automatic, of any size.
    """
    family = np.random.default_rng([seed % FAMILIES, 0])
    contacts = [kind for kind in _CONTACTS if family.random() < 0.4] or ["hertz"]
    bodies = [kind for kind in _BODIES if family.random() < 0.3] or ["linear"]
    noises = [kind for kind in _NOISES if family.random() < 0.35] or ["white"]
    couplings = [kind for kind in _COUPLINGS if family.random() < 0.3]
    method = _METHODS[int(family.choice(len(_METHODS), p=[0.6, 0.1, 0.2, 0.1]))]
    draw = _Draw(np.random.default_rng([seed, 1]))
    network = _network(draw, contacts, bodies, noises, couplings, isinstance(method, il.EulerMaruyama))
    return Scene(network, _options(draw, network, method))


_CONTACTS = ("hertz", "linear", "power", "lossy")
_BODIES = ("linear", "duffing", "softening", "rated")
_NOISES = ("white", "burst", "drive", "series")
_COUPLINGS = ("linear", "cubic")
_METHODS: tuple[il.Integrator, ...] = (
    il.ExactFlow(), il.ExactFlow(jumps=False), il.RungeKutta4(), il.EulerMaruyama(),
)  # fmt: skip


def _network(
    draw: _Draw, contacts: list[str], bodies: list[str], noises: list[str], couplings: list[str], damped: bool
) -> il.Network:
    number = int(draw.rng.integers(1, 9))
    temperature, mass, frequency = draw.scale(6.0), draw.scale(3.0), draw.scale(2.0)
    names = [f"body_{index}" for index in range(number)]
    made, excitations = {}, {}
    for name in names:
        own_mass, own = mass * draw.scale(), frequency * draw.scale() * (not draw.chance(0.1))
        ratio = float(10.0 ** draw.rng.uniform(-1.0 if damped else -3.0, 1.0)) * (damped or not draw.chance(0.1))
        made[name] = _body(draw, draw.one(bodies), own_mass, own, ratio, frequency, temperature)
        if not draw.chance(0.25):
            heat = temperature if draw.chance(0.7) else temperature * draw.scale()
            excitations[name] = _noise(draw, draw.one(noises), made[name], heat, frequency)
    length = math.sqrt(temperature / mass) / frequency  # a usual displacement
    touching = {}
    for index in range(int(draw.rng.integers(0, 2 * number + 1))):
        pair = _sides(draw, names)
        clearance = float(draw.rng.uniform(-2.0, 4.0)) * length * draw.scale(0.5 * draw.decades)
        touching[f"contact_{index}"] = il.Contact(
            *pair, _law(draw, draw.one(contacts), temperature, length), clearance=clearance
        )
    held = {}
    for index in range(int(draw.rng.integers(0, number + 1)) if couplings else 0):
        stiffness = mass * frequency**2 * draw.scale()
        if draw.one(couplings) == "linear":
            damping = 0.0 if draw.chance(0.5) else mass * frequency * draw.scale()
            law: il.CouplingLaw = il.LinearCoupling(stiffness, damping=damping)
        else:
            law = il.CubicCoupling(stiffness / length**2)
        held[f"coupling_{index}"] = il.Coupling(*_sides(draw, names), law)
    return il.Network(made, touching, excitations, held)


def _sides(draw: _Draw, names: list[str]) -> tuple[Any, Any]:
    first = draw.one(names)
    second = draw.one([*(name for name in names if name != first), il.WALL])
    return (first, second) if draw.chance(0.5) else (second, first)


def _body(
    draw: _Draw, kind: str, mass: float, own: float, ratio: float, frequency: float, temperature: float
) -> il.Oscillator:
    stiffness = mass * own**2
    fields = {"mass": mass, "damping": 2.0 * ratio * mass * (own or frequency), "stiffness": stiffness}
    usual = stiffness or mass * frequency**2
    if kind == "duffing":
        return il.DuffingOscillator(cubic=usual**2 / temperature * draw.scale(), **fields)
    if kind == "softening":
        width = math.sqrt(temperature / usual) * draw.scale()
        return SofteningOscillator(part=float(draw.rng.uniform()), width=width, softened=stiffness, **fields)
    if kind == "rated":
        return DragOscillator(drag=mass * frequency * math.sqrt(mass / temperature) * draw.scale(), **fields)
    return il.LinearOscillator(**fields)


def _noise(draw: _Draw, kind: str, body: il.Oscillator, heat: float, frequency: float) -> il.Excitation:
    density = heat * (body.damping or body.mass * frequency * draw.scale()) / math.pi
    if kind == "burst":
        return Burst(density, frequency=frequency * draw.scale())
    if kind == "drive":
        return il.Harmonic(math.sqrt(density * frequency), frequency=frequency * draw.scale())
    if kind == "series":
        top = (body.natural_frequency or frequency) / math.pi * draw.scale(1.0)
        return il.ShinozukaNoise(
            density, band=(0.0, top), components=int(draw.rng.integers(1, 2000)), allow_repeat=draw.chance(0.97)
        )
    return il.WhiteNoise(density)


def _law(draw: _Draw, kind: str, temperature: float, length: float) -> il.ContactLaw:
    depth = length * 10.0 ** draw.rng.uniform(-min(draw.decades, 3.0), 0.0)  # stores the temperature
    exponent = {"linear": 1.0, "power": float(draw.rng.uniform(0.2, 4.0))}.get(kind, 1.5)
    stiffness = min((exponent + 1.0) * temperature / depth ** (exponent + 1.0), 1e12) * (not draw.chance(0.05))
    if kind == "linear":
        return il.LinearContact(stiffness)
    if kind == "power":
        return il.PowerLawContact(stiffness, exponent=exponent)
    if kind == "lossy":
        return il.HuntCrossleyContact(stiffness, dissipation=0.1 * draw.scale() / math.sqrt(temperature))
    return il.HertzContact(stiffness)


def _options(draw: _Draw, network: il.Network, method: il.Integrator) -> dict[str, Any]:
    """Return options in which a run takes a usual number of steps, mostly."""
    options: dict[str, Any] = {
        "realizations": int(draw.one((1, 3, 64, 64, 100))),
        "integrator": method,
        "rng": int(draw.rng.integers(2**31)),
        "max_seconds": LIMIT,
    }
    step = _automatic_step(network, method)
    given = math.nan
    if draw.chance(0.25) or not math.isfinite(step):
        given = (step if math.isfinite(step) else draw.scale(3.0)) * float(10.0 ** draw.rng.uniform(-2.0, 0.7))
        options["step"] = given
    options["duration"] = float(10.0 ** draw.rng.uniform(0.0, 5.0)) * (step if math.isfinite(step) else given)
    if draw.chance(0.1):
        options["duration"] *= draw.scale(8.0)
    if draw.chance(0.6):
        options["spin_up"] = options["duration"] * float(draw.one((0.0, 0.1, 1.0)))
    if math.isfinite(given):  # a whole number of steps
        options["duration"] = max(1, round(options["duration"] / given)) * given
    name = draw.one(list(network.oscillators))
    where = {"displacement": {name: draw.scale()}, "velocity": {name: -draw.scale()}}
    initial = draw.one((None, None, "stationary", "rest", {}, where))
    if initial is not None:
        options["initial"] = initial
    records: list[il.Record] = []
    if draw.chance(0.2):
        limits = (-1.0, 1.0) if draw.chance(0.7) else None
        records.append(il.Density(draw.one(("displacement", "velocity")), bins=20, limits=limits))
    if draw.chance(0.1):
        records.append(il.PerRealization())
    if draw.chance(0.1):
        parts = 1 if math.isfinite(given) else draw.one((1, 10, 100))
        records.append(il.Trajectory(options["duration"] / parts))
    if records:
        options["record"] = records
    return options


def _automatic_step(network: il.Network, method: il.Integrator) -> float:
    """Return the step that would be chosen, NaN if there is none."""
    try:
        return float(network.check(integrator=method).dataset.attrs["step"])
    except il.ImpactLabError:
        return math.nan
