"""The laws of a network's parts, found by the names of bodies and contacts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, partial

from impactlab.components.component import SHOWN
from impactlab.components.composition import Composition
from impactlab.components.sides import bodies_of, weights_of
from impactlab.errors import NoExactReference
from impactlab.inputs import known_name
from impactlab.linear.laws import NEVER
from impactlab.reference.conditions import Law
from impactlab.reference.densities import STATE_QUANTITIES, Curves, normal_curves
from impactlab.reference.gaussian import GaussianLaw
from impactlab.reference.gibbs import GibbsLaw
from impactlab.reference.ring import RingLaw
from impactlab.reference.subsystems import listed
from impactlab.reference.tree import TreeLaw


@dataclass(frozen=True, eq=False)
class Laws:
    """Laws of the parts of a network, found by the names of bodies and contacts."""

    network: Composition
    laws: tuple[Law, ...]
    untouched: frozenset[str]

    def described(self) -> str:
        """Say what law each part has, of many the first ones."""
        lines = [f"  {listed(law.bodies).replace(chr(39), '')}: {law}" for law in self.laws[:SHOWN]]
        lines += [f"  … and {len(self.laws) - SHOWN} more"] if len(self.laws) > SHOWN else []
        if self.untouched:
            names = [name for name in self.network.contacts if name in self.untouched]
            lines.append(f"  left out, because it closes with a probability below {NEVER:g}: contact {listed(names)}")
        return "\n".join(lines)

    @cached_property
    def of_body(self) -> dict[str, Law]:
        """The law of which each body is a part."""
        return {name: law for law in self.laws for name in law.bodies}

    def law(self, oscillator: str, quantity: str) -> Law:
        """Return the law of which a body is a part; refuse names that are unknown."""
        known_name("body", oscillator, self.network.oscillators)
        known_name("quantity", quantity, STATE_QUANTITIES)
        return self.of_body[oscillator]

    def gap_law(self, contact: str) -> GibbsLaw | TreeLaw | RingLaw:
        """Return the law of which a contact is a part."""
        known_name("contact", contact, self.network.contacts)
        law = self.of_body[bodies_of(self.network.contacts[contact])[0]]
        if isinstance(law, GaussianLaw):
            raise NoExactReference(
                f"Contact {contact!r} was left out, because it closes with a probability below {NEVER:g}; the law of "
                "its closing is not known."
            )
        return law

    def speed(self, oscillator: str) -> float:
        """Return the standard deviation of a velocity."""
        law = self.of_body[oscillator]
        if isinstance(law, GaussianLaw):
            return math.sqrt(law.variance(oscillator, "velocity"))
        return math.sqrt(law.temperature / self.network.oscillators[oscillator].mass)

    def at_point(self, weights: Mapping[str, float]) -> tuple[float, float, float]:
        """Return mean and variance of the displacement, and variance of the velocity, of a weighted sum of bodies.

        The variance of the displacement is NaN where the sum has several bodies of a law of a tree or a ring.
        """
        by_law: dict[int, dict[str, float]] = {}
        for name, weight in weights.items():
            by_law.setdefault(id(self.of_body[name]), {})[name] = weight
        mean = sum(weight * self.of_body[name].moments(name)[0] for name, weight in weights.items())
        place = speed = 0.0
        for own in by_law.values():
            first = next(iter(own))
            law = self.of_body[first]
            if isinstance(law, GaussianLaw):
                more = law.relative_variances(own)
            else:
                if isinstance(law, GibbsLaw):
                    variance = law.variance_along(own)
                else:
                    variance = own[first] ** 2 * law.moments(first)[1] if len(own) == 1 else math.nan
                more = variance, sum(weight**2 * self.speed(name) ** 2 for name, weight in own.items())
            place, speed = place + more[0], speed + more[1]
        return mean, place, speed

    def curves_at_point(self, point: str, quantity: str) -> Curves:
        """Return the law of the displacement or velocity of a point, which is a weighted sum of bodies."""
        known_name("quantity", quantity, STATE_QUANTITIES)
        weights = self.network.points[point]
        laws = list({id(law): law for law in (self.of_body[name] for name in weights)}.values())
        for law in laws:
            if isinstance(law, GaussianLaw):
                law.refuse_density(point)
        if not any(isinstance(law, GaussianLaw) and law.cosines for law in laws):
            _, place, speed = self.at_point(weights)
            if quantity == "velocity":
                return normal_curves(math.sqrt(speed))
            if all(isinstance(law, GaussianLaw) for law in laws):
                return normal_curves(math.sqrt(place))
            if len(laws) == 1 and isinstance(laws[0], GibbsLaw):
                law = laws[0]
                return Curves(partial(law.density_along, weights), partial(law.probability_along, weights))
        raise NoExactReference(
            f"The density of the {quantity} of {point!r} is not computed: it is known under white noise, of linear "
            "motion and where all contacts act along one combination."
        )

    def relative_speed(self, contact: str) -> float:
        """Return the standard deviation of the rate of an indentation."""
        weights = weights_of(self.network.contacts[contact])
        return math.sqrt(sum(weight**2 * self.speed(name) ** 2 for name, weight in weights.items()))
