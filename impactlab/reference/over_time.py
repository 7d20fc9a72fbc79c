"""The covariance over time of linear motion, also under noise with an envelope."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from impactlab.components.composition import Composition
from impactlab.components.excitation import Excitation
from impactlab.components.literature import in_one_line
from impactlab.components.modulated import WITH_ENVELOPE, ModulatedExcitation, ModulatedNoise
from impactlab.components.stored import entries, json_of, stored
from impactlab.errors import InvalidInput, NoExactReference
from impactlab.inputs import FiniteNumbers, checked, shown
from impactlab.linear.envelopes import ALWAYS, Envelope, EnvelopedMotion
from impactlab.linear.laws import motions_of
from impactlab.reference.linear_laws import LinearPart
from impactlab.reference.subsystems import Subsystem, is_enveloped, is_linear, is_steady_noise, subsystems_of
from impactlab.results.dataset import provenance
from impactlab.results.labels import labelled
from impactlab.results.schema import BODY, POINT, labels_of
from impactlab.results.snapshot import TIME

if TYPE_CHECKING:
    import xarray as xr

OTHER = f"other_{BODY}"
"""Dimension of the second body of a covariance."""


@checked
def exact_covariance(network: Composition, times: FiniteNumbers, *, spin_up: float = 0.0) -> xr.Dataset:
    """Return the exact covariance of displacements and velocities over time, of linear networks.

    It is the solution of Lyapunov's equation in time, ``P' = L P + P Lᵀ + e(t)² N`` under white noise with an envelope
    (`ModulatedNoise`), and that with the states of the filter under filtered noise with one (`Modulated`), by exact
    transitions between the samples of the envelope (Soong and Grigoriu, Random Vibration of Mechanical and Structural
    Systems, 1993, section 4.3). Noises without envelope may act as well, and
    `PoissonImpulses` or `ModulatedImpulses`, which have the covariance of white noise.

    A run of `simulate` has this covariance in whatever given state all its realizations begin, "rest" by default under
    an envelope. It is that about the mean, which a given state and given forces make; the mean squares are the
    variances where there are neither these nor `PoissonImpulses` with a mean. Filters are in their stationary state
    when a run begins, unless they are ``at_rest``.

    Parameters
    ----------
    network : Network
        Linear bodies and couplings, under noises.
    times : array_like
        Increasing times from 0 on, where the measurement begins and the time of envelopes is 0 (s).
    spin_up : float
        Time before 0 at which the run begins (s), as that of `simulate`; a result has it as ``attrs["spin_up"]``.

    Returns
    -------
    xarray.Dataset
        ``variance_displacement`` and ``variance_velocity`` (time, oscillator), and with ``point_`` before the name
        (time, point); ``covariance_displacement``, ``covariance_velocity`` and ``covariance_displacement_velocity``
        (time, oscillator, other_oscillator), of the displacement of the first and the velocity of the other one.

    Raises
    ------
    NoExactReference
        If there are contacts, forces that are not linear, given motions, sums of cosines, or a density or an envelope
        that is a formula of time.
    InvalidInput
        If `network` is not a network, times are not finite, negative or do not increase, or the spin-up is negative.

    Examples
    --------
    >>> linear = network.replace(contacts={"stop": None})
    >>> law = il.exact_covariance(linear, times=[1.0, 10.0])
    >>> law.variance_displacement.values.ravel().round(4)
    array([0.2466, 0.624 ])
    """
    places = np.atleast_1d(times)
    if places.ndim != 1 or not places.size or places[0] < 0.0 or (np.diff(places) <= 0.0).any():
        raise InvalidInput(
            f"times must be increasing numbers from 0 on, such as np.linspace(0.0, 10.0, 51), not {shown(times)}."
        )
    if spin_up < 0.0:
        raise InvalidInput(f"spin_up must be at least 0 s, not {spin_up!r}.")
    subsystems = subsystems_of(network)
    if reasons := [reason for item in subsystems for reason in _reasons(item)]:
        raise NoExactReference("\n- ".join(["There is no covariance over time that is known here:", *reasons]))
    names = list(network.oscillators)
    covariance = np.zeros((len(places), 2 * len(names), 2 * len(names)))  # of all displacements, then velocities
    for item in subsystems:
        slots = [names.index(body) for body in item.bodies]
        rows = np.array([*slots, *(len(names) + slot for slot in slots)])
        for motion in _motions(LinearPart(item)):
            covariance[:, rows[:, None], rows] += motion.covariances(-spin_up, places)
    return _labelled(network, places, covariance, spin_up)


def _reasons(subsystem: Subsystem) -> Iterator[str]:
    """Say why the covariance of a part of a network is not known."""
    yield from subsystem.given_motions
    for name in subsystem.contacts:
        yield f"contact {name!r} is not linear; without it the covariance would be known."
    for name in subsystem.bent:
        yield f"{name!r} has a residual force; with linear springs and dampers alone the covariance would be known."
    for name, coupling in subsystem.couplings.items():
        if not is_linear(coupling):
            yield f"coupling {name!r} is not linear; with il.LinearCoupling the covariance would be known."
    network = subsystem.network
    named = {name: item for body in subsystem.bodies for name, item, _ in network.excitations_of(body)}
    for name, excitation in named.items():
        if excitation.kind == "lines":
            yield f"{name!r} is a sum of cosines; of noises that are filters the covariance would be known."
        elif not _is_known(excitation):
            instead = WITH_ENVELOPE[str(excitation.kind)]
            yield (
                f"{name!r} is {type(excitation).__name__}, a formula of time of one's own; with samples of it, as "
                f"{instead} takes them, the covariance would be known."
            )


def _is_known(excitation: Excitation) -> bool:
    """Whether an excitation is a given force, or a noise without envelope or with one that is linear in pieces."""
    if excitation.kind == "intensity":
        return is_steady_noise(excitation) or is_enveloped(excitation)
    return not excitation.has_kernel("modulation") or is_enveloped(excitation)


def _motions(part: LinearPart) -> Iterator[EnvelopedMotion]:
    """Yield what each noise moves, and together all without envelope that are white or have the same covariance."""
    model, system = part.model, part.system
    together = ((np.arange(model.wall), system),)
    steady = np.zeros(system.intensity.shape)
    noises = model.sources["intensity"]
    for number, (_, excitation) in enumerate(noises.named()):
        bodies, weights = noises.driven(number)
        unit = np.zeros(model.wall)
        unit[bodies] = weights
        if isinstance(excitation, ModulatedNoise):
            intensity = excitation.spectral_density * np.outer(unit, unit)
            yield EnvelopedMotion.of_white(system, intensity, _envelope_of(excitation))
        else:
            steady += excitation.call("intensity", 0.0) * np.outer(unit, unit)
    motions = motions_of(model, together)
    for motion in motions:
        if motion.white is not None and is_enveloped(motion.excitation):
            yield EnvelopedMotion.of_white(system, motion.white, _envelope_of(motion.excitation))
        elif motion.white is not None:
            steady += motion.white
    if steady.any():
        yield EnvelopedMotion.of_white(system, steady, ALWAYS)
    for motion in motions:
        if motion.white is None:
            yield EnvelopedMotion.of_filtered(motion, _envelope_of(motion.excitation))


def _envelope_of(excitation: Excitation) -> Envelope:
    if not isinstance(excitation, ModulatedExcitation):
        return ALWAYS
    return Envelope(np.array(excitation.times), np.array(excitation.envelope))


def _labelled(network: Composition, times: np.ndarray, covariance: np.ndarray, spin_up: float) -> xr.Dataset:
    """Return covariances, (time, 2 body, 2 body), as variables."""
    import xarray as xr  # loaded only where results are made

    bodies, points = list(network.oscillators), list(network.points)
    x, v = slice(None, len(bodies)), slice(len(bodies), None)
    weights = np.array([[row.get(name, 0.0) for name in bodies] for row in network.points.values()])
    coordinates: dict[str, Any] = {"time": ("time", times, TIME), **labels_of(bodies, [], points)}
    coordinates[OTHER] = (OTHER, np.array(bodies), {"long_name": f"name of the other {BODY}"})
    variables = {}
    for quantity, rows, units in (("displacement", x, "m2"), ("velocity", v, "m2 s-2")):
        own, text = covariance[:, rows, rows], f"variance of the {quantity}"
        variables[f"variance_{quantity}"] = labelled(
            ("time", BODY), np.diagonal(own, axis1=1, axis2=2).copy(), units, text
        )
        if points:
            at_points = np.einsum("pi,tij,pj->tp", weights, own, weights)
            variables[f"point_variance_{quantity}"] = labelled(("time", POINT), at_points, units, f"{text} at points")
        variables[f"covariance_{quantity}"] = labelled(
            ("time", BODY, OTHER), own, units, f"covariance of the {quantity}"
        )
    variables["covariance_displacement_velocity"] = labelled(
        ("time", BODY, OTHER), covariance[:, x, v], "m2 s-1", "covariance of displacement and velocity"
    )
    configuration = {"network": stored(network)}
    return xr.Dataset(variables, coordinates).assign_attrs(
        provenance("exact covariance over time", json_of(configuration), in_one_line(entries(configuration))),
        spin_up=spin_up,
    )
