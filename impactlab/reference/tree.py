"""Exact law of bodies that contacts and couplings connect to a tree, by transfer integrals."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from impactlab.components.contact import Contact
from impactlab.reference.distribution import Distribution, OfDistributions
from impactlab.reference.ground import outwards
from impactlab.reference.marginal import Marginal
from impactlab.reference.messages import (
    FLOOR,
    NONE,
    PROBED,
    TOLERANCE,
    Messages,
    edges_between,
    is_noise,
    narrow,
    origin_of,
)
from impactlab.reference.piecewise import Piecewise, fine_integrals, resolve, shifted_integrals
from impactlab.reference.potential import Gap, Potential, composite_rule


class TreeLaw(Messages, OfDistributions):
    """Stationary law of bodies in a tree.

    The density ``exp(−H/T)`` is a product of one function of each displacement and one of each difference of two that
    are connected. It is integrated body by body: what body i says to its neighbour j, its *message*, is

        M(x_j) = ∫ h(x_i) exp(−U(x_i − x_j)/T) dx_i ,

    h being the density of i without j: its own function times the messages of its other neighbours. (In a chain these
    are transfer integrals, Scalapino, Sears and Ferrell, Phys. Rev. B 6, 1972, 3409; in a tree the sum-product
    algorithm, Kschischang, Frey and Loeliger, IEEE Trans. Inf. Theory 47, 2001, 498.)

    All functions are polynomials on panels: logarithms for messages, which are smooth, densities as they are. Each
    integral over a difference is split where a contact closes, so that probabilities of contact are as exact as any
    other statistic. Messages that have become equal are one object, and nothing is computed twice from the same
    objects: the middle of a long chain of equal bodies costs nothing.

    Given are the potentials of the displacement of each body, and of the differences of those that are linked, which
    connect all and form no loop. What cannot be normalised or integrated is refused.
    """

    def contact(self, contact: Contact) -> tuple[float, float, float]:
        walled, place, item, gap = self._gap(contact)
        of_gaps = self._of_walls(place) if walled else self._of_link(place)
        return of_gaps[item.gaps.index(gap)]

    def gap_marginal(self, contact: Contact, speed: float) -> Marginal:
        walled, place, item, gap = self._gap(contact)
        if walled:
            return self._distribution(self._density(place)).marginal(gap.sign, -gap.clearance, speed)
        shift = float(gap.indentation(np.array(origin_of(item))))
        return Distribution(self._difference(place)).marginal(gap.sign, shift, speed)

    def joint_density(self, first: str, second: str, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return the joint density of the displacements of two bodies (m-2)."""
        one, other = self._places[first], self._places[second]
        result = np.empty(x.shape)
        for place in np.unique(x):
            here = x == place
            given = self._given(one, float(place), other)
            result[here] = self.density(first, np.array([place])) * Distribution(given).density(y[here])
        return result

    def of_body(self, body: str) -> Distribution:
        return self._distribution(self._density(self._places[body]))

    def _distribution(self, density: Piecewise) -> Distribution:
        result: Distribution = self._once(lambda: Distribution(density), "distribution", density)
        return result

    def _gap(self, contact: Contact) -> tuple[bool, int, Potential, Gap]:
        """Return whether a contact is a wall's, the body or the link that it acts on, the potential and the gap."""
        ends = [self._places[side] for side in (contact.first, contact.second) if isinstance(side, str)]
        if len(ends) == 1:
            return True, ends[0], self.own[ends[0]], Gap.of(contact, self.bodies[ends[0]])
        link = dict(self._around[ends[0]])[ends[1]]
        i, _, item = self.links[link]
        return False, link, item, Gap.of(contact, self.bodies[i])

    def _of_walls(self, body: int) -> list[tuple[float, float, float]]:
        """Return the statistics of a body's walls."""
        law, item = self._distribution(self._density(body)), self.own[body]
        result: list[tuple[float, float, float]] = self._once(lambda: law.of_gaps(item.gaps), "walls", law, item)
        return result

    def _of_link(self, link: int) -> list[tuple[float, float, float]]:
        """Return the statistics of the contacts between two bodies."""
        i, j, item = self.links[link]
        one, other, kernel = self._density(i, j), self._density(j, i), self._kernels[link]

        def make() -> list[tuple[float, float, float]]:
            coefficients = one.coefficients[0].ravel()

            def function(starts: np.ndarray, offsets: np.ndarray) -> np.ndarray:
                shifts = starts + offsets + origin_of(item)
                return np.asarray(self._integrals(one.edges, kernel, shifts) @ coefficients * other(starts, offsets)[0])

            fine = fine_integrals(NONE, 10.0 * TOLERANCE)
            features = np.subtract.outer(narrow(one), item.corners).ravel()
            edges = edges_between(np.concatenate([other.edges, features]), *self._ends(j))
            sums = resolve(function, edges, fine, item.names).integrals.sum(axis=1)
            count = len(item.gaps)
            result = []
            for k, gap in enumerate(item.gaps):
                low, high = (
                    max(other.edges[0], one.edges[0] - gap.corner),
                    min(other.edges[-1], one.edges[-1] - gap.corner),
                )
                here = 0.0
                if low < high:
                    edges = edges_between(np.concatenate([other.edges, one.edges - gap.corner]), low, high)
                    starts, offsets, lengths = composite_rule(edges)
                    places = starts + offsets
                    here = float(lengths @ (other(places)[0] * one(places + gap.corner)[0]))
                    here *= math.exp(-float(item.energy(np.array([gap.corner]))[0]))
                result.append((sums[1 + k] / sums[0], here / sums[0], sums[1 + count + k] / sums[0]))
            return result

        result: list[tuple[float, float, float]] = self._once(make, "link", one, other, kernel)
        return result

    def _ends(self, body: int) -> np.ndarray:
        """Return between which places the density of a body is not negligible."""
        density = self._density(body)
        counts = np.flatnonzero(density.values[0].max(axis=1) > FLOOR)
        return density.edges[[counts[0], counts[-1] + 1]]

    def _difference(self, link: int) -> Piecewise:
        """Return the density of the difference of two connected bodies, not normalised, from `origin_of` on."""
        (i, j, item), kernel = self.links[link], self._kernels[link]
        one, other, origin = self._density(i, j), self._density(j, i), origin_of(item)

        def make() -> Piecewise:
            coefficients, top = one.coefficients[0].ravel(), 0.0

            def function(starts: np.ndarray, offsets: np.ndarray) -> np.ndarray:
                nonlocal top
                q = starts + offsets
                sums = shifted_integrals(one.edges, other, q + origin)[0].reshape(len(q), -1) @ coefficients
                result = sums * np.exp(-item.energy(np.full_like(q, origin), q))
                top = max(top, float(result.max()))
                return np.asarray(result[None])

            def fine(values: np.ndarray, tails: np.ndarray, panels: np.ndarray, before: np.ndarray) -> np.ndarray:
                smooth = tails[0] <= 10.0 * TOLERANCE * np.abs(values[0]).max(axis=1) + FLOOR * top
                return np.asarray(smooth | is_noise(tails[0], before[0], np.abs(values[0]).max(axis=1)))

            low = max(kernel.edges[0], one.edges[0] - other.edges[-1] - origin)
            high = min(kernel.edges[-1], one.edges[-1] - other.edges[0] - origin)
            return resolve(function, edges_between(kernel.edges, low, high), fine, item.names)

        result: Piecewise = self._once(make, "difference", one, other, kernel)
        return result

    def _given(self, body: int, place: float, target: int) -> Piecewise:
        """Return the density of one body given the displacement of another, not normalised."""
        path = self._path(body, target)
        link = dict(self._around[body])[path[1]]
        i, _, item = self.links[link]
        sign = 1.0 if i == body else -1.0

        def logarithm(starts: np.ndarray, offsets: np.ndarray | float = 0.0) -> np.ndarray:
            return -item.energy(sign * (place - starts), -sign * offsets)[None]

        said: Callable[..., np.ndarray] = logarithm
        extra = place - sign * item.panels(PROBED)
        for before, here, after in zip(path[:-1], path[1:], [*path[2:], None], strict=True):
            others = [self._messages[other, here] for other, _ in self._around[here] if other not in (before, after)]
            density = self._product(here, [said, *others], extra)
            if after is not None:
                said, extra = self._said(density, here, after, dict(self._around[here])[after]), NONE
        return density

    def _path(self, body: int, target: int) -> list[int]:
        """Return the bodies on the way from one to another."""
        before: dict[int, int] = {}
        for near, far, _ in outwards(len(self.bodies), self.links, body):
            before[far] = near
        path = [target]
        while path[-1] != body:
            path.append(before[path[-1]])
        return path[::-1]
