"""The times of a network: in which it does about the same again, and in which it forgets its start."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

from impactlab.assembly.mechanism import given_motions
from impactlab.assembly.model import Model
from impactlab.components.excitation import Excitation
from impactlab.components.loads import Harmonic
from impactlab.components.oscillator import ParametricOscillator
from impactlab.errors import InvalidInput
from impactlab.linear.damping import damped
from impactlab.linear.decay import relaxation_time

RELAXATIONS = 30.0
"""Relaxation times in which a start is forgotten: 1e-13 of a linear transient is left."""


INTERVALS = 200.0
"""Intervals in which a start is forgotten where impacts, contacts or dry friction damp only, as `il.orbits` takes."""


class Rhythm(NamedTuple):
    """The times of a network."""

    interval: float  # in which it does about the same again (s)
    settling: float  # whole intervals in which it forgets its start (s)
    rate: float  # at which it does (s-1)

    @classmethod
    def of(cls, model: Model, transient: float | None) -> Rhythm:
        """Return the times of a network; what is to be forgotten may be given as a `transient` (s)."""
        interval, relaxation = interval_of(model), relaxation_time(damped(model)[1])
        if transient is None and not (relaxation or _loses_in_contacts(model)):
            raise InvalidInput("Nothing damps this network: give transient= (s), the length of the motion before.")
        own = RELAXATIONS * relaxation or INTERVALS * interval
        length = own if transient is None else transient
        return cls(interval, interval * math.ceil(length / interval * (1.0 - 1e-12)), 1.0 / (relaxation or interval))


def _loses_in_contacts(model: Model) -> bool:
    """Whether contacts or couplings take energy."""
    contacts, couplings = model.contacts, model.couplings.laws
    return any(
        getattr(law, "restitution", 0.0) < 1.0
        if impulsive
        else "rate" in law.kernel("force")[1] or bool(law.state_names())
        for law, impulsive in zip(contacts.laws, contacts.impulsive, strict=True)
    ) or any(law.dissipative for law in couplings)


def interval_of(model: Model) -> float:
    """Return the longest period of a given force or motion, else of a body alone, else its relaxation time (s)."""
    waves = (item for _, item in acting(model) if isinstance(item, Harmonic | ParametricOscillator))
    given = max((2.0 * math.pi / item.frequency for item in waves), default=0.0)
    if given:
        return given
    swinging = model.stiffness > 0.0
    if swinging.any():
        return float((2.0 * math.pi * (model.mass[swinging] / model.stiffness[swinging]) ** 0.5).max())
    return relaxation_time(damped(model)[1]) or 1.0


def acting(model: Model) -> Iterator[tuple[str, Excitation | ParametricOscillator]]:
    """Yield names and functions of given forces, of bodies whose motion is given, and of springs that vary."""
    sources = model.sources["force"]
    yield from zip(sources.names, sources.excitations, strict=True)
    for slot, motion in given_motions(model):
        yield model.bodies.names[slot], motion
    for name, oscillator in zip(model.bodies.names, model.bodies.oscillators, strict=True):
        if isinstance(oscillator, ParametricOscillator):
            yield name, oscillator
