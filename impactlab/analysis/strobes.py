"""The period with which forces repeat, at which a motion is looked at once in each period."""

from __future__ import annotations

import math
from fractions import Fraction
from functools import reduce

import numpy as np

from impactlab.analysis.rhythm import acting
from impactlab.assembly.forces_in_states import Forces
from impactlab.assembly.model import Model
from impactlab.components.excitation import Excitation
from impactlab.components.loads import ConstantForce, Harmonic, SampledForce
from impactlab.components.oscillator import ParametricOscillator
from impactlab.errors import InvalidInput
from impactlab.records.surface import Strobe

FITS = 1e-9
"""Part of a period, and of the size of a force, up to which a force repeats with it: rounding, and decimals of π."""

MOST_PERIODS = 64
"""Periods of one force in the common period of several, at most."""

TIMES_COMPARED = 97
"""Times in a period at which forces of unknown period are compared with those a period later: a prime number, so that
they are at no simple fraction of it.
"""


def strobe_of(model: Model, section: Strobe | None) -> Strobe:
    """Return the strobe of a network: the given one, which must fit its forces, or that of their common period."""
    known, others = [], list[Excitation]()
    for name, item in acting(model):
        if isinstance(item, Harmonic | ParametricOscillator):
            known.append((name, 2.0 * math.pi / item.frequency))
        elif isinstance(item, SampledForce) and item.repeats:
            known.append((name, float(item.times[-1] - item.times[0])))
        elif not isinstance(item, ConstantForce):
            others.append(item)
    if section is None:
        if others:
            raise InvalidInput(f"The period of {others[0]!r} is not known; give section=il.Strobe(period).")
        if not known:
            raise InvalidInput(
                "Nothing varies in time, so that no force gives a period: give section=il.Crossing(body), or "
                "il.AtContact(contact), or il.Strobe(period) with any period for motions that come to rest."
            )
        return Strobe(_common(known))
    for name, period in known:
        turns = section.period / period
        if round(turns) < 1 or abs(turns - round(turns)) > FITS * turns:
            raise InvalidInput(
                f"section: the period of {section.period:g} s is no whole number of periods of {period:.12g} s, with "
                f"which the force of {name!r} repeats; give il.Strobe({max(1, round(turns)) * period:.12g})."
            )
    for item in others:
        _check_function(item, section)
    if model.kicks.timed.any():
        _check_laws(model, section)
    return section


def is_autonomous(model: Model) -> bool:
    """Whether nothing varies in time."""
    return not model.kicks.timed.any() and all(isinstance(item, ConstantForce) for _, item in acting(model))


def _common(known: list[tuple[str, float]]) -> float:
    """Return the least common period of several."""
    first, shortest = min(known, key=lambda item: item[1])
    multiples = list[Fraction]()
    for name, period in known:
        ratio = Fraction(period / shortest).limit_denominator(MOST_PERIODS)
        if abs(float(ratio) * shortest - period) > FITS * period:
            raise InvalidInput(
                f"The forces of {first!r} and {name!r}, with periods of {shortest:.12g} s and {period:.12g} s, have no "
                "common period; give section=il.Crossing(body) or il.AtContact(contact), or forces with one."
            )
        multiples.append(ratio)
    common = reduce(_least_common, multiples)
    if common > MOST_PERIODS:
        raise InvalidInput(
            f"The common period of all forces is {float(common) * shortest:g} s, more than {MOST_PERIODS} of the "
            f"period of {first!r}; give section=il.Strobe(period)."
        )
    return float(common) * shortest


def _least_common(one: Fraction, other: Fraction) -> Fraction:
    return Fraction(math.lcm(one.numerator, other.numerator), math.gcd(one.denominator, other.denominator))


def _check_function(item: Excitation, section: Strobe) -> None:
    """Refuse a given function that does not repeat with the period."""
    times = section.start + section.period * np.arange(4 * TIMES_COMPARED) / TIMES_COMPARED
    with np.errstate(all="ignore"):
        values = item.call("force", times).reshape(4, TIMES_COMPARED)
    size = np.abs(values).max()
    if not np.abs(values - values[0]).max() <= 1e3 * FITS * size:
        raise InvalidInput(f"section: {item!r} does not repeat with the period of {section.period:g} s.")


def _check_laws(model: Model, section: Strobe) -> None:
    """Refuse laws in time that do not repeat with the period."""
    forces, found = Forces(model), list[np.ndarray]()
    draws = np.random.default_rng(1)
    forces.x[:, 0], forces.v[:, 0] = draws.normal(size=(2, len(model.bodies)))
    for time in section.start + section.period * np.arange(4 * TIMES_COMPARED) / TIMES_COMPARED:
        forces.evaluate(float(time))
        found.append(forces.total[:, 0].copy())
    values = np.array(found).reshape(4, TIMES_COMPARED, -1)
    if not np.abs(values - values[0]).max() <= 1e3 * FITS * np.abs(values).max():
        raise InvalidInput(f"section: a law in time does not repeat with the period of {section.period:g} s.")
