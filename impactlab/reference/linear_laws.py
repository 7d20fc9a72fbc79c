"""Which parts of a network are linear, or would be without contacts that never close, and their laws."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from impactlab.assembly.model import Model
from impactlab.components.composition import Composition
from impactlab.components.loads import Harmonic
from impactlab.components.sides import weights_of
from impactlab.errors import NoExactReference
from impactlab.linear.laws import NEVER, lines_of, motions_of, responses, system_of
from impactlab.linear.systems import LinearSystem
from impactlab.reference.gaussian import CosineResponse, GaussianLaw
from impactlab.reference.subsystems import (
    UNHEATED,
    Subsystem,
    differ,
    is_enveloped,
    is_linear,
    is_stationary,
    listed,
    refusal,
    subsystems_of,
)


def linear_law_of(network: Composition, body: str) -> GaussianLaw:
    """Return the law of a body and what is connected to it, unless something else than linear motion matters."""
    subsystem = next(item for item in subsystems_of(network) if body in item.bodies)
    if subsystem.is_linear:
        part = LinearPart(subsystem)
        if part.reasons:
            raise refusal(part.reasons)
        return part.law
    apart = Apart.of(subsystem)
    if apart is None or apart.mattering:
        what = [f"the residual force of {name!r}" for name in subsystem.bent]
        what += [repr(name) for name in subsystem.contacts]
        what += [repr(name) for name, item in subsystem.couplings.items() if not is_linear(item)]
        raise NoExactReference(
            f"The motion of {body!r} is not linear, because of {' and '.join(what[:4])}; correlations in time are "
            "known for linear motion only."
        )
    return next(law for law in apart.laws if body in law.bodies)


@dataclass(frozen=True, eq=False)
class LinearPart:
    """Bodies that linear couplings connect."""

    subsystem: Subsystem

    @cached_property
    def model(self) -> Model:
        """The bodies with their couplings and excitations as arrays."""
        return Model.of(self.subsystem.without_contacts())

    @cached_property
    def system(self) -> LinearSystem:
        """Their matrices."""
        springs, dampers = (self.model.links.springs(strength) for strength in self.model.couplings.linear)
        return system_of(self.model, np.arange(self.model.wall), springs, dampers)

    @cached_property
    def reasons(self) -> list[str]:
        """Why there is no law."""
        return self.subsystem.given_motions or list(self._varying()) or list(self._unstable())

    @cached_property
    def law(self) -> GaussianLaw:
        """The law, where there are no reasons against it."""
        system, model = self.system, self.model
        together = ((np.arange(len(model.bodies)), system),)
        cosines = [
            CosineResponse(item.frequencies, item.amplitudes, receptance)
            for item, (_, receptance) in zip(lines_of(model), responses(model, together), strict=True)
        ]
        cosines += [
            CosineResponse(np.array([frequency]), np.ones(1), system.receptance(force, np.array([frequency])), True)
            for frequency, force in self._harmonics.items()
        ]
        temperatures = list(self.subsystem.temperatures.values())
        balanced = ((model.noise.intensity > 0.0) == (model.damping > 0.0)).all()
        balanced &= not model.couplings.linear[1].any()
        motions = motions_of(model, together)
        balanced = balanced and not (self.subsystem.common_noises or motions)
        thermal = temperatures and balanced and not differ(*temperatures)
        return GaussianLaw(self.subsystem.bodies, system, temperatures[0] if thermal else None, cosines, motions)

    @cached_property
    def _harmonics(self) -> dict[float, np.ndarray]:
        """Complex amplitudes of the harmonic forces on the bodies by their angular frequencies, (body,) (N)."""
        forces = self.model.sources["force"]
        result: dict[float, np.ndarray] = {}
        for number, excitation in enumerate(forces.excitations):
            if isinstance(excitation, Harmonic):
                bodies, weights = forces.driven(number)
                force = result.setdefault(excitation.frequency, np.zeros(self.model.wall, dtype=complex))
                force[bodies] += weights * excitation.amplitude * np.exp(1j * (excitation.phase - 0.5 * math.pi))
        return result

    @cached_property
    def slowest(self) -> float:
        """The longest relaxation time (s)."""
        return 1.0 / float(self.system.rates.min())

    def _varying(self) -> Iterator[str]:
        network = self.subsystem.network
        for name in self.subsystem.bodies:
            for _, excitation, _ in network.excitations_of(name):
                if is_enveloped(excitation):
                    yield (
                        f"{name!r} is excited by {type(excitation).__name__}, which depends on time, so that no law is "
                        "stationary; il.exact_covariance knows the covariance over time."
                    )
                elif not (is_stationary(excitation) or isinstance(excitation, Harmonic)):
                    yield (
                        f"{name!r} is excited by {type(excitation).__name__}, which depends on time; with constant "
                        "white or filtered noise or a sum of cosines of random phases the law would be stationary, "
                        "and with il.Harmonic known at each phase of the cycle."
                    )

    def _unstable(self) -> Iterator[str]:
        system, model, names = self.system, self.model, self.subsystem.bodies
        driven = model.noise.intensity.any() or any(item.amplitudes.any() for item in lines_of(model))
        driven = driven or any(motion.drives for motion in motions_of(model, ((np.arange(model.wall), system),)))
        driven = driven or any(force.any() for force in self._harmonics.values())
        one = len(names) == 1
        if not driven and not system.damping.any():
            yield f"{listed(names)}: {UNHEATED}"
        elif not driven:
            yield f"{listed(names)}: damping without noise, everything comes to rest; with noise there would be a law."
        elif not (model.damping > 0.0).all() and not system.rates.all():
            _, motions = np.linalg.eig(system.drift)
            moving = np.abs(motions[-len(names) :, system.rates == 0.0]).max(axis=1) > 1e-6
            free = listed([name for name, moves in zip(names, moving, strict=True) if moves])
            yield f"{free}: noise without damping, the energy grows for ever; with damping there would be a law."
        elif system.directions[1].size:
            yield (
                f"{listed(names)}: the law cannot be normalised, because no spring confines "
                f"{'it' if one else 'their center'}; with stiffness on {'it' if one else 'one of them'} there would "
                "be a law."
            )


@dataclass(frozen=True, eq=False)
class Apart:
    """The bodies of a subsystem without its contacts."""

    laws: list[GaussianLaw]  # their laws
    mattering: dict[str, float]  # the contacts that matter, with the clearance (m) from which on they would not

    @classmethod
    def of(cls, subsystem: Subsystem) -> Apart | None:
        """Take the contacts away; None if what is left has no Gaussian law."""
        bodies = [subsystem.network.oscillators[name] for name in subsystem.bodies]
        if not subsystem.contacts or any(body.has_kernel("residual") for body in bodies):
            return None  # some of which stops alone may hold
        left = subsystems_of(subsystem.without_contacts())
        if not all(item.is_linear for item in left):
            return None
        parts = list(map(LinearPart, left))
        if any(part.reasons for part in parts) or any(part.law.shot for part in parts):
            return None  # the bounds of tails are those of normal numbers and cosines
        part_of = {name: part for part in parts for name in part.subsystem.bodies}
        slowest = max(part.slowest for part in parts)
        mattering = {}
        for name, contact in subsystem.contacts.items():
            moving: dict[int, dict[str, float]] = {}
            for body, weight in weights_of(contact).items():
                moving.setdefault(id(part_of[body]), {})[body] = weight
            together = [part_of[next(iter(weights))].law.relative_variances(weights) for weights in moving.values()]
            place, speed = np.sum(together, axis=0).tolist()
            # exp(−c²/2σ²) bounds the tail, also of sums of cosines; times ω/2π it is a Gaussian's rate of crossings
            often = 1.0 + slowest * math.sqrt(speed / place) / (2.0 * math.pi)
            enough = math.sqrt(2.0 * place * math.log(often / NEVER))
            if contact.clearance < enough:
                mattering[name] = enough
        return cls([part.law for part in parts], mattering)

    @property
    def advice(self) -> str:
        """What would have to be so that the law is Gaussian."""
        some = [f"{clearance:.3g} m for {name!r}" for name, clearance in list(self.mattering.items())[:3]]
        return (
            "Without contacts the law would be Gaussian, and so it would with clearances so wide that they never "
            f"close: {', '.join(some)}{', …' if len(self.mattering) > 3 else ''}."
        )
