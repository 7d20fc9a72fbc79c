"""Exact law of bodies that contacts and couplings connect to a tree, by transfer integrals."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Sequence
from typing import Any

import numpy as np

from impactlab.contact import Contact
from impactlab.reference.ground import START, Link, about_ground, outwards, spans
from impactlab.reference.piecewise import Fineness, Piecewise, fine_integrals, resolve, resolve_with, shifted_integrals
from impactlab.reference.potential import NODES, Gap, Potential, gauss_legendre

_TOLERANCE = 1e-12  # of a function on a panel, relative to its size there
_NOISE = 1e-9  # of the same, that is taken for rounding where it does not shrink
_FLOOR = 1e-23  # of a density or message, relative to its top
_SAME = 3e-13  # difference of the logarithms of two messages that count as one
_MOST_KEPT = 100e6  # bytes of weights of integrals that are kept
_PROBED = 1e-8  # energy in units of T at which one looks for kinks near corners
_NONE = np.empty(0)


class TreeLaw:
    """Stationary law of bodies in a tree.

    The density ``exp(−H/T)`` is a product of one function of each displacement and one of
    each difference of two that are connected. It is integrated body by body: what body i
    says to its neighbour j, its *message*, is

        M(x_j) = ∫ h(x_i) exp(−U(x_i − x_j)/T) dx_i ,

    h being the density of i without j: its own function times the messages of its other
    neighbours. (In a chain these are transfer integrals, Scalapino, Sears and Ferrell, Phys.
    Rev. B 6, 1972, 3409; in a tree the sum-product algorithm, Kschischang, Frey and Loeliger,
    IEEE Trans. Inf. Theory 47, 2001, 498.)

    All functions are polynomials on panels: logarithms for messages, which are smooth, densities
    as they are. Each integral over a difference is split where a contact closes, so that
    probabilities of contact are as exact as any other statistic. Messages that have become
    equal are one object, and nothing is computed twice from the same objects: the middle of a
    long chain of equal bodies costs nothing.

    Parameters
    ----------
    bodies : tuple of str
        Names of the bodies.
    own : sequence of Potential
        Of the displacement of each body.
    links : sequence of Link
        Potentials of the differences; they connect all bodies and form no loop.

    Raises
    ------
    NoExactReference
        If the density cannot be normalised or integrated.
    InvalidInput
        If a potential is not the integral of its force.
    """

    def __init__(self, bodies: tuple[str, ...], own: Sequence[Potential], links: Sequence[Link]) -> None:
        self.bodies, self.temperature = bodies, own[0].temperature
        self._places = {name: place for place, name in enumerate(bodies)}
        self.own, self.links = about_ground(own, links)
        self.spans, self._reaches = spans(self.own, self.links)
        self._known: dict[tuple[Hashable, ...], tuple[tuple[object, ...], Any]] = {}
        self._last: dict[tuple[int, int], Piecewise] = {}
        self._weights: dict[tuple[int, bytes, bytes], np.ndarray] = {}
        self._bytes = 0
        self._around: list[list[tuple[int, int]]] = [[] for _ in bodies]
        for index, (i, j, _) in enumerate(self.links):
            self._around[i].append((j, index))
            self._around[j].append((i, index))
        self._logarithms = [self._logarithm(k) for k in range(len(bodies))]
        self._kernels = [self._kernel(k) for k in range(len(links))]
        self._messages: dict[tuple[int, int], Piecewise] = {}
        steps = outwards(len(bodies), self.links)
        for near, far, link in reversed(steps):
            self._messages[far, near] = self._message(far, near, link)
        for near, far, link in steps:
            self._messages[near, far] = self._message(near, far, link)

    def moments(self, body: str) -> tuple[float, float]:
        """Return the mean (m) and the variance (m2) of a body's displacement."""
        density = self._density(self._places[body])

        def make() -> tuple[float, float]:
            masses, nodes = density.masses[0], density.nodes
            mean = float((masses * nodes).sum() / masses.sum())
            return mean, float((masses * (nodes - mean) ** 2).sum() / masses.sum())

        result: tuple[float, float] = self._once(make, "moments", density)
        return result

    def contact(self, contact: Contact) -> tuple[float, float, float]:
        """Return the probability that a contact is closed, the density where it closes (m-1) and its mean force (N)."""
        sides = [self._places[side] for side in (contact.first, contact.second) if isinstance(side, str)]
        if len(sides) == 1:
            item, of_gaps = self.own[sides[0]], self._of_walls(sides[0])
            gap = Gap.of(contact, self.bodies[sides[0]])
        else:
            link = dict(self._around[sides[0]])[sides[1]]
            item, of_gaps = self.links[link][2], self._of_link(link)
            gap = Gap.of(contact, self.bodies[self.links[link][0]])
        ratio, density, force = of_gaps[item.gaps.index(gap)]
        return ratio, density, force

    def density(self, body: str, displacement: np.ndarray) -> np.ndarray:
        """Return the density of a body's displacement (m-1)."""
        return self._values(self._density(self._places[body]), displacement)

    def probability(self, body: str, displacement: np.ndarray) -> np.ndarray:
        """Return the probability that a body's displacement is smaller."""
        density = self._density(self._places[body])
        return np.asarray(density.cumulative(displacement)[0] / density.integrals[0].sum())

    def joint_density(self, first: str, second: str, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return the joint density of the displacements of two bodies (m-2)."""
        one, other = self._places[first], self._places[second]
        result = np.empty(x.shape)
        for place in np.unique(x):
            here = x == place
            given = self._given(one, float(place), other)
            result[here] = self.density(first, np.array([place])) * self._values(given, y[here])
        return result

    def _values(self, density: Piecewise, places: np.ndarray) -> np.ndarray:
        """Return a density, normalised, and 0 outside its range."""
        inside = (places >= density.edges[0]) & (places <= density.edges[-1])
        result = np.zeros(places.shape)
        result[inside] = density(places[inside])[0] / density.integrals[0].sum()
        return result

    def _once(self, make: Callable[[], Any], name: str, *of: object) -> Any:
        """Make something once for each name and the objects that it is made of."""
        key = (name, *map(id, of))
        if key not in self._known:
            self._known[key] = of, make()  # with the objects, so that their ids stay theirs
        return self._known[key][1]

    def _logarithm(self, body: int) -> Piecewise:
        """Return the logarithm of a body's own function."""
        item, (low, high) = self.own[body], self.spans[body]

        def make() -> Piecewise:
            def fine(values: np.ndarray, tails: np.ndarray, panels: np.ndarray, before: np.ndarray) -> np.ndarray:
                return np.asarray(tails[0] <= 0.1 * _TOLERANCE * (1.0 + np.abs(values[0]).max(axis=1)))

            first, probes = (_between(item.panels(start), low, high) for start in (START, _PROBED))
            result = resolve_with(
                lambda *places: -item.energy(*places)[None], first, probes, lambda: fine, item.names, 1e-10
            )
            item.check_work(np.union1d(result.edges, _with_corners(item, low, high)))
            return result

        return self._alike(make, "logarithm", item, low, high)

    def _kernel(self, index: int) -> Piecewise:
        """Return the factor of a link in the density, that where each contact is closed, and it times each force."""
        item = self.links[index][2]
        (low, high), origin = self._reaches[index], _origin(item)

        def make() -> Piecewise:
            def function(starts: np.ndarray, offsets: np.ndarray) -> np.ndarray:
                places = np.full_like(starts, origin), starts + offsets
                factor = np.exp(-item.energy(*places))
                forces = [gap.law.evaluate(gap.indentation(*places)) for gap in item.gaps]
                with np.errstate(invalid="ignore"):
                    return np.array([factor, *(np.where(factor > 0.0, factor * force, 0.0) for force in forces)])

            corners = np.array(sorted(gap.corner for gap in item.gaps)) - origin

            def is_fine() -> Fineness:
                integrals = fine_integrals(corners, 0.1 * _TOLERANCE)
                return lambda values, tails, panels, before: np.asarray(
                    integrals(values, tails, panels, before) & _relative(values[0], tails[0])
                )

            first, probes = (
                _between(item.panels(start) - origin, low - origin, high - origin) for start in (START, _PROBED)
            )
            found = resolve_with(function, first, probes, is_fine, item.names, 1e-10)
            counts = np.flatnonzero(np.abs(found.values[0]).max(axis=1) > _FLOOR**2)
            edges, coefficients = (
                found.edges[counts[0] : counts[-1] + 2],
                found.coefficients[:, counts[0] : counts[-1] + 1],
            )
            middle = 0.5 * (edges[1:] + edges[:-1])
            closed = [
                coefficients[0] * (gap.indentation(np.full_like(middle, origin), middle) > 0.0)[:, None]
                for gap in item.gaps
            ]
            item.check_work(np.union1d(edges + origin, _with_corners(item, *(edges[[0, -1]] + origin))))
            return Piecewise(edges, np.array([coefficients[0], *closed, *coefficients[1:]]))

        return self._alike(make, "kernel", item, low, high)

    def _alike(self, make: Callable[[], Piecewise], *of: Hashable) -> Piecewise:
        """Make something once for all that is equal."""
        if of not in self._known:
            self._known[of] = (), make()
        result: Piecewise = self._known[of][1]
        return result

    def _message(self, source: int, target: int, link: int) -> Piecewise:
        """Return the logarithm of what a body says to a neighbour, over the range of the neighbour."""
        density, kernel = self._density(source, target), self._kernels[link]
        of = f"message{self.links[link][0] == source}", density, kernel, self._logarithms[target]
        message: Piecewise = self._once(lambda: self._said(density, source, target, link), *of)
        return message

    def _said(self, density: Piecewise, source: int, target: int, link: int) -> Piecewise:
        """Return the logarithm of what a body with some density says to a neighbour."""
        (i, _, item), span = self.links[link], self.spans[target]
        kernel, sign = self._factor(link, i == source), 1.0 if i == source else -1.0
        coefficients, top = density.coefficients[0].ravel(), -math.inf

        def function(starts: np.ndarray, offsets: np.ndarray) -> np.ndarray:
            nonlocal top
            sums = self._integrals(density.edges, kernel, starts + offsets + sign * _origin(item))[0] @ coefficients
            top = max(top, math.log(sums.max()))
            return np.asarray(np.log(np.maximum(sums, 10.0 * _FLOOR * math.exp(top)))[None])

        def fine(values: np.ndarray, tails: np.ndarray, panels: np.ndarray, before: np.ndarray) -> np.ndarray:
            high = values[0].max(axis=1)
            noise = np.minimum(_FLOOR * np.exp(np.minimum(top - high, 99.0)), 1.0)
            smooth = tails[0] <= _TOLERANCE * (1.0 + np.abs(values[0]).max(axis=1)) + noise
            return np.asarray(smooth | _is_noise(tails[0], before[0], np.exp(0.5 * np.minimum(top - high, 99.0))))

        hints = np.subtract.outer(self.own[source].corners, sign * item.corners).ravel()
        edges = _between(np.concatenate([np.linspace(span[0], span[1], 9), hints]), *span)
        found = resolve(function, edges, fine, item.names)
        found.coefficients[..., 0] -= top
        place = id(kernel), id(self._logarithms[target])
        last = self._last.get(place, found)
        same = np.array_equal(last.edges, found.edges) and np.abs(last.coefficients - found.coefficients).max() < _SAME
        self._last[place] = last if same else found
        return self._last[place]

    def _factor(self, link: int, forward: bool) -> Piecewise:
        """Return what a link multiplies the density with, for a sum over its first or its second body."""
        kernel = self._kernels[link]

        def make() -> Piecewise:
            first = Piecewise(kernel.edges, kernel.coefficients[:1])
            return first if forward else first.mirrored()

        factor: Piecewise = self._once(make, f"factor{forward}", kernel)
        return factor

    def _integrals(self, edges: np.ndarray, kernel: Piecewise, places: np.ndarray) -> np.ndarray:
        """Return the weights of integrals over panels, (kernel, place, coefficient); the latest ones are kept."""
        key = id(kernel), edges.tobytes(), places.tobytes()
        found = self._weights.pop(key, None)
        if found is None:
            found = shifted_integrals(edges, kernel, places)
            found = found.reshape(*found.shape[:2], -1)
            self._bytes += found.nbytes
        self._weights[key] = found
        while self._bytes > _MOST_KEPT and len(self._weights) > 1:
            self._bytes -= self._weights.pop(next(iter(self._weights))).nbytes
        return found

    def _density(self, body: int, without: int | None = None) -> Piecewise:
        """Return the density of a body, not normalised, without what one neighbour says."""
        got = [self._messages[other, body] for other, _ in self._around[body] if other != without]
        logarithm = self._logarithms[body]
        density: Piecewise = self._once(
            lambda: self._product(body, got, probes=np.concatenate([_NONE, *map(_narrow, got)])),
            "density",
            logarithm,
            *sorted(got, key=id),
        )
        return density

    def _product(
        self,
        body: int,
        factors: Sequence[Callable[..., np.ndarray]],
        extra: np.ndarray = _NONE,
        probes: np.ndarray = _NONE,
    ) -> Piecewise:
        """Return the product of a body's own function and some factors, which are given as logarithms."""
        logarithm = self._logarithms[body]

        both: list[Callable[..., np.ndarray]] = [logarithm, *factors]

        def parts(*places: np.ndarray) -> np.ndarray:
            return np.array([item(*places)[0] for item in both])

        edges, top, change = _between(extra, *logarithm.edges[[0, -1]]), -math.inf, math.inf
        edges = np.union1d(edges, logarithm.edges)
        while change > 1.0:  # towards the peak, which may be narrow
            values = parts(Piecewise(edges, _NONE).nodes.ravel()).sum(axis=0)
            change, top = values.max() - top, values.max()
            peak = int(np.argmax(values)) // len(NODES)
            around = edges[max(peak - 1, 0) : peak + 3]
            edges = np.union1d(edges, 0.5 * (around[1:] + around[:-1]))

        sizes = _NONE

        def function(starts: np.ndarray, offsets: np.ndarray) -> np.ndarray:
            nonlocal sizes
            logarithms = parts(starts, offsets)
            sizes = np.abs(logarithms).sum(axis=0)
            return np.asarray(np.exp(logarithms.sum(axis=0) - top)[None])

        def fine(values: np.ndarray, tails: np.ndarray, panels: np.ndarray, before: np.ndarray) -> np.ndarray:
            errors = 4.0 * (1.0 + sizes.reshape(values[0].shape).max(axis=1))  # of the logarithms
            smooth = _relative(values[0], tails[0], errors)
            return np.asarray(smooth | _is_noise(tails[0], before[0], values[0].max(axis=1)))

        probes = _between(probes, *edges[[0, -1]])
        return resolve_with(function, edges, probes, lambda: fine, self.own[body].names, 1e-8)

    def _of_walls(self, body: int) -> list[tuple[float, float, float]]:
        """Return the statistics of a body's walls."""
        density, item = self._density(body), self.own[body]

        def make() -> list[tuple[float, float, float]]:
            nodes = density.nodes
            weights = density.masses[0] / density.masses[0].sum()
            corners = np.array([gap.corner for gap in item.gaps])
            result = []
            for gap, here in zip(item.gaps, self._values(density, corners), strict=True):
                force = gap.law.evaluate(gap.indentation(nodes.ravel())).reshape(nodes.shape)
                closed = gap.indentation(nodes) > 0.0
                result.append((float(weights[closed].sum()), float(here), float((weights * force).sum())))
            return result

        result: list[tuple[float, float, float]] = self._once(make, "walls", density, item)
        return result

    def _of_link(self, link: int) -> list[tuple[float, float, float]]:
        """Return the statistics of the contacts between two bodies."""
        i, j, item = self.links[link]
        one, other, kernel = self._density(i, j), self._density(j, i), self._kernels[link]

        def make() -> list[tuple[float, float, float]]:
            coefficients = one.coefficients[0].ravel()

            def function(starts: np.ndarray, offsets: np.ndarray) -> np.ndarray:
                shifts = starts + offsets + _origin(item)
                return np.asarray(self._integrals(one.edges, kernel, shifts) @ coefficients * other(starts, offsets)[0])

            fine = fine_integrals(_NONE, 10.0 * _TOLERANCE)
            features = np.subtract.outer(_narrow(one), item.corners).ravel()
            edges = _between(np.concatenate([other.edges, features]), *self._ends(j))
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
                    edges = _between(np.concatenate([other.edges, one.edges - gap.corner]), low, high)
                    starts, offsets, lengths = gauss_legendre(edges)
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
        counts = np.flatnonzero(density.values[0].max(axis=1) > _FLOOR)
        return density.edges[[counts[0], counts[-1] + 1]]

    def _given(self, body: int, place: float, target: int) -> Piecewise:
        """Return the density of one body given the displacement of another, not normalised."""
        path = self._path(body, target)
        link = dict(self._around[body])[path[1]]
        i, _, item = self.links[link]
        sign = 1.0 if i == body else -1.0

        def logarithm(starts: np.ndarray, offsets: np.ndarray | float = 0.0) -> np.ndarray:
            return -item.energy(sign * (place - starts), -sign * offsets)[None]

        said: Callable[..., np.ndarray] = logarithm
        extra = place - sign * item.panels(_PROBED)
        for before, here, after in zip(path[:-1], path[1:], [*path[2:], None], strict=True):
            others = [self._messages[other, here] for other, _ in self._around[here] if other not in (before, after)]
            density = self._product(here, [said, *others], extra)
            if after is not None:
                said, extra = self._said(density, here, after, dict(self._around[here])[after]), _NONE
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


def _between(edges: np.ndarray, low: float, high: float) -> np.ndarray:
    """Return the edges within a range, and its ends."""
    return np.unique(np.concatenate([[low], edges[(edges > low) & (edges < high)], [high]]))


def _relative(values: np.ndarray, tails: np.ndarray, loss: np.ndarray | float = 1.0) -> np.ndarray:
    """Whether a density of about 1 at its top is resolved relative to itself on each panel, where it is not tiny."""
    return np.asarray(tails <= _TOLERANCE * loss * np.abs(values).max(axis=1) + _FLOOR)


def _with_corners(item: Potential, low: float, high: float) -> np.ndarray:
    """Return the panels of a potential within a range that is widened to hold all corners."""
    corners = item.corners
    return _between(item.panels(START), min(low, corners[0]), max(high, corners[-1]))


def _origin(item: Potential) -> float:
    """Return the coordinate from which the kernel of a link counts: a corner, near which it may be steep."""
    return item.gaps[0].corner if item.gaps else 0.0


def _is_noise(tails: np.ndarray, before: np.ndarray, sizes: np.ndarray | float) -> np.ndarray:
    """Whether the last coefficients are small and do not shrink with the panels: places are rounded."""
    return np.asarray((tails <= _NOISE * sizes) & (tails > 0.7 * before))


def _narrow(function: Piecewise) -> np.ndarray:
    """Return the edges where a function has features that are narrow in its range."""
    widths = np.diff(function.edges)
    narrow = widths < 0.01 * widths.sum()
    return np.asarray(function.edges[np.append(narrow, False) | np.insert(narrow, 0, False)])
