"""The class of networks whose automatic step is known to be right, without a measurement."""

from __future__ import annotations

import numpy as np

from impactlab.assembly.model import Model, kept
from impactlab.components.contact import contact_forces
from impactlab.components.evaluation import distinct
from impactlab.components.oscillator import DuffingOscillator
from impactlab.nonlinear.tangent_stiffness import energy_of

EXPONENTS, UNIFORM = (0.95, 4.0), 0.3
"""Exponents ``d ln F/d ln δ`` of forces whose step is known from theory and tests, and how much they may vary."""

NOISY = 0.05
"""Energy that noise gives bodies in a run, over that at a given start, from which on errors of kinks average out."""

_PLACES = np.array([0.01, 0.03, 0.1, 0.3, 1.0, 1.5, 3.0])


def certified(model: Model, penetration: np.ndarray, step: float) -> bool:
    """Whether a step of a network, up to the automatic one, is known to be right, without a measurement.

    So it is, by theory and by random networks against exact laws, for bodies under white noises of constant intensity,
    one for each, from any start but those that `alike` tells of, whose forces are conservative: linear couplings, and
    contacts and residual forces that are nearly powers of their indentation or displacement, with exponents from 1 to
    4. Friction does not stop a body within a step: at c h/m from 8 to 60 the mean force of a contact was up to 1.6 %
    too small.
    """
    if (model.nonlinear_bodies & (model.damping * step > 1.001 * model.mass)).any():  # steps are often m/c
        return False
    if model.varying or model.passes or model.remembering or model.rigid.any():
        return False
    if model.sources["intensity"].joining or model.round.any():
        return False
    if not model.coupling[0].all():
        return False
    if not _powers(model, penetration.tobytes()):
        return False
    bent = np.flatnonzero(model.residual).tolist()
    return all(isinstance(model.oscillators[slot], DuffingOscillator) for slot in bent)


@kept
def _powers(model: Model, penetrations: bytes) -> bool:
    """Whether the forces of all contacts are nearly powers of indentations up to some depths (m)."""
    depths = np.frombuffer(penetrations)
    for row in distinct(model.contact_laws, [depths])[0].tolist():
        law, depth = model.contact_laws[row], float(depths[row])
        if depth > 0.0 and not _a_power(contact_forces([law], depth * _PLACES[None])[0], _PLACES):
            return False
    return True


def alike(model: Model, start: str | np.ndarray, duration: float) -> bool:
    """Whether a start is given beside which noise does so little that all realizations collide at much the same times.

    Errors of kinks then do not average out over the phases of the steps: they were up to 5 % of E[v²] at steps that are
    certified otherwise, below 0.5 % where noise gives a hundredth of the energy at the start.
    """
    if not isinstance(start, np.ndarray) or not len(model.ends):
        return False
    labels = model.connected()
    cooled = np.bincount(labels, model.damping) > 0.0  # without friction kinks make the energy wander, which is told
    heat = np.bincount(labels, np.pi * model.initial_intensities / model.mass * duration)
    begun = np.bincount(labels, energy_of(model, start))
    touching = np.zeros(len(heat), dtype=bool)
    touching[labels[model.ends.coordinates()]] = True
    return bool((touching & cooled & (heat < NOISY * begun)).any())


def _a_power(force: np.ndarray, places: np.ndarray) -> bool:
    """Whether a force is nearly a power of the place."""
    if not ((force > 0.0) & (force < np.inf)).all():
        return not force.any()
    exponents = np.diff(np.log(force)) / np.diff(np.log(places))
    low, high = EXPONENTS
    return bool(low <= exponents.min() and exponents.max() <= high and np.ptp(exponents) <= UNIFORM)
