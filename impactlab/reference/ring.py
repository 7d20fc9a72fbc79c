"""Exact law of bodies in a ring, by transfer integrals in coordinates relative to one of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from impactlab.components.contact import Contact
from impactlab.errors import NoExactReference
from impactlab.reference.distribution import Distribution, OfDistributions
from impactlab.reference.ground import START, about_ground, depth_of, span_of
from impactlab.reference.marginal import Marginal
from impactlab.reference.messages import FLOOR, PROBED, TOLERANCE, edges_between, is_noise
from impactlab.reference.piecewise import (
    COEFFICIENTS,
    TRANSFORM,
    Fineness,
    Piecewise,
    resolve,
    resolve_with,
    shifted_integrals,
)
from impactlab.reference.potential import Gap, Potential, composite_rule

_MOST_ENERGY = 600.0  # in units of T; the exponential of more is hardly a number
_MOST_NODES = 5000  # of a relative displacement
_RAREST = 1e-10  # density, relative to its top, that is resolved
_TOLERANCE = 10.0 * TOLERANCE  # of a function on a panel, relative to its size there


class RingLaw(OfDistributions):
    """Stationary law of bodies in a ring: each is connected with the next, and the last with the first.

    Seen from body 0, with ``u_j = x_j − x_0``, the sum over the states of all others is

        Z(x_0) = ∫ k(−u_1) h(u_1) ∫ k(u_1 − u_2) h(u_2) … ∫ k(u_(n−2) − u_(n−1)) h(u_(n−1)) k(u_(n−1)) du_(n−1) … du_1,

    ``h(u_j) = exp(−Φ_j(x_0 + u_j)/T)`` being the factor of a body and k those of the differences. No k depends on x_0,
    so the weights of their integrals are found once, as in `TreeLaw`, and used for all x_0. Every body is taken for
    body 0 in turn, which gives its law and that of the gap to the next one. All must find the same sum over all states,
    which shows how exact they are.

    Bodies are named in the order of the ring. Each has a potential of its own, without walls, and one of the difference
    of it and the next. What cannot be normalised or resolved is refused.
    """

    def __init__(self, bodies: tuple[str, ...], own: Sequence[Potential], links: Sequence[Potential]) -> None:
        self.bodies, self.temperature = bodies, own[0].temperature
        count = len(bodies)
        own, between_bodies = about_ground(own, [(k, (k + 1) % count, item) for k, item in enumerate(links)])
        links = [item for *_, item in between_bodies]
        # above the energy at rest, in units of T, beyond which nothing counts
        most = 50.0 - depth_of([*own, *links])
        spans = [span_of(item, most) for item in own]
        for item, span in zip(own, spans, strict=True):
            if not np.isfinite(span).all():
                raise NoExactReference(f"{item.names}: in a loop the law is computed for bodies with springs only.")
        widest = max(high - low for low, high in spans)
        reaches = [np.clip(span_of(item, most), -widest, widest).tolist() for item in links]
        views = []
        try:
            kernels = [_resolved(item, low, high, np.exp) for item, (low, high) in zip(links, reaches, strict=True)]
            factors = [
                _resolved(item, low - widest, high + widest, np.asarray)
                for item, (low, high) in zip(own, spans, strict=True)
            ]
            for first in range(count):
                order = [(first + k) % count for k in range(count)]
                turned = [factors[k] for k in order], [kernels[k] for k in order]
                views.append(_seen([spans[k] for k in order], *turned, most))
        except NoExactReference as error:
            raise _unresolved() from error
        self._laws, self._gaps = [law for law, _ in views], [gap for _, gap in views]
        totals = [law.total for law in self._laws]
        # the sums over all states, as different bodies see them
        if not 0.0 < max(totals) <= (1.0 + 1e-8) * min(totals):
            raise _unresolved()

    def contact(self, contact: Contact) -> tuple[float, float, float]:
        law, gap = self._gap(contact)
        return law.of_gaps([gap])[0]

    def gap_marginal(self, contact: Contact, speed: float) -> Marginal:
        law, gap = self._gap(contact)
        return law.marginal(gap.sign, -gap.clearance, speed)

    def joint_density(self, first: str, second: str, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Refuse: it is not computed for loops."""
        raise NoExactReference(f"The joint density of {first!r} and {second!r}, which are in a loop, is not computed.")

    def of_body(self, body: str) -> Distribution:
        return self._laws[self.bodies.index(body)]

    def _gap(self, contact: Contact) -> tuple[Distribution, Gap]:
        """Return the law of the difference that a contact acts on, and the gap in it."""
        places = [self.bodies.index(str(side)) for side in (contact.first, contact.second)]
        first = next(k for k in places if (k + 1) % len(self.bodies) in places)
        return self._gaps[first], Gap.of(contact, self.bodies[first])


def _resolved(item: Potential, low: float, high: float, scale: Callable[..., np.ndarray]) -> Piecewise:
    """Return a function of a potential's factor in the density, given by that of its logarithm, within a range."""
    first, probes = (edges_between(item.panels(start), low, high) for start in (START, PROBED))

    def function(*places: np.ndarray) -> np.ndarray:
        return scale(-np.minimum(item.energy(*places), _MOST_ENERGY)[None])

    found = resolve_with(function, first, probes, partial(_fine, TOLERANCE), item.names, 1e-10)
    known = found.edges[item.energy(found.edges) < _MOST_ENERGY]
    item.check_work(np.union1d(known, item.corners))
    return found


def _fine(tolerance: float) -> Fineness:
    """Return a fineness relative to the size on a panel, or to rounding of the function's largest one so far."""
    tops: np.ndarray | None = None

    def fine(values: np.ndarray, tails: np.ndarray, panels: np.ndarray, before: np.ndarray) -> np.ndarray:
        nonlocal tops
        sizes = np.abs(values).max(axis=2)
        tops = sizes.max(axis=1) if tops is None else np.maximum(tops, sizes.max(axis=1))
        smooth = tails <= tolerance * sizes + 1e-3 * tolerance * tops[:, None] + FLOOR * tops.max()
        return np.asarray((smooth | is_noise(tails, before, sizes)).all(axis=0))

    return fine


@dataclass(frozen=True, eq=False)
class _Stage:
    """What bodies from one on to the end of the ring contribute, as a function of its relative displacement."""

    factor: Piecewise  # logarithm of the body's own factor
    outer: Piecewise | None  # factor of its difference from body 0, if they are connected
    onwards: _Stage | None  # the same of the next body
    kernel: Piecewise | None
    """Factor of the difference from it, as a function of its relative displacement less that of this body."""
    edges: np.ndarray  # edges of panels that resolve the function

    def resolved(self, looked_at: np.ndarray) -> _Stage:
        """Return the stage with panels fine enough for the given places of body 0."""

        def function(starts: np.ndarray, offsets: np.ndarray) -> np.ndarray:
            if len(starts) > _MOST_NODES:
                raise _unresolved()
            return self._values(looked_at, starts, offsets, self._weights(starts + offsets))

        found = resolve(function, self.edges, _fine(_TOLERANCE), "a loop")
        if found.nodes.size > _MOST_NODES:
            raise _unresolved()
        return replace(self, edges=found.edges)

    @cached_property
    def _nodes(self) -> tuple[np.ndarray, np.ndarray]:
        starts, offsets, _ = composite_rule(self.edges)
        return starts, offsets

    @cached_property
    def _weights_of_nodes(self) -> np.ndarray | None:
        starts, offsets = self._nodes
        return self._weights(starts + offsets)

    def coefficients(self, places: np.ndarray) -> np.ndarray:
        """Return the coefficients of the function for some places of body 0, (place, panel, order)."""
        values = self._values(places, *self._nodes, self._weights_of_nodes)
        return np.asarray(values.reshape(len(places), -1, COEFFICIENTS) @ TRANSFORM)

    def _weights(self, u: np.ndarray) -> np.ndarray | None:
        """Return the weights of integrals over the next body, (u, coefficient)."""
        if self.onwards is None or self.kernel is None:
            return None
        weights = shifted_integrals(self.onwards.edges, self.kernel, u)[0]
        return np.asarray(weights.reshape(len(u), -1))

    def _values(
        self, places: np.ndarray, starts: np.ndarray, offsets: np.ndarray, weights: np.ndarray | None
    ) -> np.ndarray:
        """Return the function at some relative displacements for some places of body 0, (place, u)."""
        x = places[:, None] + (starts + offsets)
        result = np.exp(self.factor(x.ravel())[0].reshape(x.shape))
        if self.outer is not None:
            result *= self.outer(starts, offsets)[0]
        if self.onwards is not None and weights is not None:
            result *= self.onwards.coefficients(places).reshape(len(places), -1) @ weights.T
        return np.asarray(result)


def _seen(
    spans: Sequence[tuple[float, float]],
    factors: Sequence[Piecewise],
    kernels: Sequence[Piecewise],
    most: float,
) -> tuple[Distribution, Distribution]:
    """Return the laws of body 0, and of its difference from body 1."""
    (low, high), last = spans[0], len(factors) - 1
    # places of a body for which the panels of the others are made
    looked_at = 0.5 * np.linspace(low, high, 9)
    stage: _Stage | None = None
    for j in range(last, 0, -1):
        outer = kernels[last] if j == last else kernels[0].mirrored() if j == 1 else None
        ends = spans[j][0] - high, spans[j][1] - low
        if outer is not None:
            ends = max(ends[0], outer.edges[0]), min(ends[1], outer.edges[-1])
        scale = (spans[j][1] - spans[j][0]) / math.sqrt(8.0 * most)  # the standard deviation of a Gaussian
        count = math.ceil((ends[1] - ends[0]) / scale)
        if count * COEFFICIENTS > _MOST_NODES:
            raise _unresolved()
        edges = edges_between(np.union1d(np.linspace(*ends, count + 1), [] if outer is None else outer.edges), *ends)
        kernel = None if stage is None else kernels[j].mirrored()
        stage = _Stage(factors[j], outer, stage, kernel, edges).resolved(looked_at)
    assert stage is not None
    nearest = stage

    def function(starts: np.ndarray, offsets: np.ndarray) -> np.ndarray:
        places = starts + offsets
        sums = nearest.coefficients(places)[:, :, 0] @ np.diff(nearest.edges)
        return np.asarray((np.exp(factors[0](places)[0]) * sums)[None])

    law = resolve(function, edges_between(factors[0].edges, low, high), _fine(_TOLERANCE), "a loop")
    starts, offsets, lengths = composite_rule(law.edges)
    weights = lengths * np.exp(factors[0](starts, offsets)[0])
    both = np.tensordot(weights, nearest.coefficients(starts + offsets), axes=1)
    gap = Piecewise(nearest.edges, both[None]).mirrored()
    return Distribution(law, _RAREST), Distribution(gap, _RAREST)


def _unresolved() -> NoExactReference:
    return NoExactReference(
        "The law of the bodies in a loop is not resolved: their springs or contacts differ too much in stiffness, or "
        "press too hard. Without one of the contacts or couplings of the loop they are a tree, which has another law."
    )
