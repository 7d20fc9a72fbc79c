"""A scene for each mechanism: a row of bodies that collide under white noise, to which it is added."""

import itertools
import math

import numpy as np
from laws import Slider, TabulatedContact

import impactlab as il

HERTZ = il.HertzContact(1e4)
TIMES = [0.0, 0.4, 1.0, 20.0]
ENVELOPE = [0.2, 1.0, 0.6, 0.6]


class BreathingContact(il.ContactLaw):
    """A spring whose stiffness varies in time."""

    stiffness: float = il.parameter(units="N m-1")
    frequency: float = il.parameter(units="rad s-1")

    @staticmethod
    def force(indentation, time, stiffness, frequency):
        return stiffness * (1.0 + 0.5 * math.sin(frequency * time)) * indentation


def body(number, kind=il.LinearOscillator, **fields):
    frequency = 5.0 + 0.3 * (number % 4)
    return kind(mass=1.0, damping=0.1 * frequency, stiffness=frequency**2, **fields)


def excited(excitation):
    return {"excitations": {"b0": excitation}}


def touching(law, **fields):
    return {"contacts": {"own": il.Contact("b0", il.WALL, law, clearance=0.03, **fields)}}


def coupled(law, first="b0", second="b1"):
    return {"couplings": {"own": il.Coupling(first, second, law)}}


def of_body(made):
    return {"oscillators": {"b0": made}}


def in_plane(**fields):
    return {"contacts": {"own": il.RoundContact(("b0", "b1"), il.WALL, HERTZ, clearance=0.05, **fields)}}


SUM = il.Combination({"b0": 1.0, "b1": -0.5})
BEAM = il.ModalStructure([6.0, 9.0], 0.05, points={"tip": [1.0, -0.6]})
COLOURED = il.OrnsteinUhlenbeckNoise(3.0, correlation_time=0.1)
SHAKEN = il.Harmonic(5.0, frequency=6.0)

MECHANISMS = {
    "white noise": excited(il.WhiteNoise(2.0)),
    "noise that varies in time": excited(il.ModulatedNoise(3.0, TIMES, ENVELOPE)),
    "correlated white noise": {"excitations": {"wind": il.Source(il.WhiteNoise(2.0), on={"b0": 1.0, "b1": -0.5})}},
    "sum of cosines": excited(il.ShinozukaNoise(3.0, band=(0.1, 5.0), components=40, allow_repeat=True)),
    "filtered noise": excited(COLOURED),
    "filtered noise that varies in time": excited(il.Modulated(COLOURED, TIMES, ENVELOPE)),
    "impulses": excited(il.PoissonImpulses(8.0, mean=0.3, standard_deviation=0.2)),
    "impulses that vary in time": excited(
        il.ModulatedImpulses(8.0, mean=0.3, standard_deviation=0.2, times=TIMES, envelope=ENVELOPE)
    ),
    "harmonic force": excited(SHAKEN),
    "force on several bodies": {"excitations": {"wind": il.Source(SHAKEN, on={"b0": 1.0, "b1": -0.5})}},
    "sampled force": excited(il.SampledForce(np.linspace(0.0, 0.7, 8), np.sin(np.arange(8.0)), after="repeat")),
    "constant force": excited(il.ConstantForce(3.0)),
    "pulse": excited(il.Pulse(30.0, duration=0.3, start=0.2)),
    "product of forces": excited(il.ModulatedForce(SHAKEN, TIMES, ENVELOPE)),
    "prescribed motion": of_body(il.PrescribedMotion(il.Harmonic(0.05, frequency=5.0))),
    "conservative contact": touching(il.PowerLawContact(1e4, exponent=1.2)),
    "dissipative contact": touching(il.HuntCrossleyContact(1e4, dissipation=0.3)),
    "contact by its closing velocity": touching(il.FloresContact(1e4, restitution=0.7)),
    "contact with a state": touching(il.WaltonBraunContact(3e3, unloading=6e3)),
    "contact by rows of numbers": touching(TabulatedContact([0.0, 50.0, 400.0], distance=0.01)),
    "contact that varies in time": touching(BreathingContact(3e3, frequency=7.0)),
    "rigid contact": touching(il.RigidContact(0.8)),
    "contact in a plane": in_plane(),
    "contact in a plane with friction": in_plane(friction_coefficient=0.2, friction_velocity=0.1),
    "contact of weighted bodies": {"contacts": {"own": il.Contact(SUM, il.WALL, HERTZ, clearance=0.03)}},
    "weak linear coupling": coupled(il.LinearCoupling(0.05)),
    "stiff linear coupling": coupled(il.LinearCoupling(3000.0, damping=1.0)),
    "nonlinear coupling": coupled(il.CubicCoupling(200.0)),
    "coupling with a state": coupled(il.JenkinsCoupling(50.0, slip_force=0.5)),
    "coupling of weighted bodies": coupled(il.CubicCoupling(200.0), SUM, il.WALL),
    "smooth friction": coupled(il.FrictionCoupling(0.5, velocity=0.2)),
    "dry friction": coupled(il.CoulombFrictionCoupling(0.8, velocity=0.3), second=il.WALL),
    "dry friction at a rigid contact": touching(il.RigidContact(0.8))
    | coupled(il.CoulombFrictionCoupling(0.8, velocity=0.3), second=il.WALL),
    "residual force": of_body(body(0, il.DuffingOscillator, cubic=30.0)),
    "residual force of velocity": of_body(body(0, il.VanDerPolOscillator, growth=1.0, width=0.05)),
    "parametric body": of_body(body(0, il.ParametricOscillator, depth=0.3, frequency=8.0)),
    "body with a state": of_body(body(0, Slider, spring=20.0, most=0.3)),
    "points of a structure": {"oscillators": {"beam": BEAM}, "excitations": {"beam.1": il.WhiteNoise(2.0)}},
    "structure that is touched": {
        "oscillators": {"beam": BEAM}, "contacts": {"own": il.Contact("beam.tip", "b0", HERTZ, clearance=0.02)}
    },
    "structure of matrices": {
        "oscillators": {
            "tower": il.LinearStructure([2.0, 1.0], [[3.0, -1.0], [-1.0, 1.0]], [[400.0, -150.0], [-150.0, 150.0]])
        },
        "contacts": {"own": il.Contact("tower.2", "b0", HERTZ, clearance=0.02)},
    },
}  # fmt: skip


def row(name="", bodies=3, clearance=0.02, noisy=None, idle=False):
    """Bodies in a row, the last one, or those that are `noisy`, under white noise, and a mechanism.

    There may be a body that nothing but white noise moves.
    """
    names = [f"b{number}" for number in range(bodies)]
    pairs = itertools.pairwise(names)
    parts = {
        "oscillators": {name: body(number) for number, name in enumerate(names)},
        "contacts": {f"{one} {two}": il.Contact(one, two, HERTZ, clearance=clearance) for one, two in pairs},
        "excitations": dict.fromkeys(names[-1:] if noisy is None else noisy, il.WhiteNoise(4.0)),
        "couplings": {},
    }
    added = MECHANISMS.get(name, {})
    parts = {kind: members | added.get(kind, {}) for kind, members in parts.items()}
    if idle:
        parts["oscillators"]["idle"], parts["excitations"]["idle"] = body(1), il.WhiteNoise(1.0)
    return il.Network(**parts)
