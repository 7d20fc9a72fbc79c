"""Transfer integrals: what the bodies of a tree say to each other, and the densities that follow."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Sequence
from typing import Any

import numpy as np

from impactlab.errors import NoExactReference
from impactlab.reference.ground import START, Link, about_ground, around, outwards, spans
from impactlab.reference.piecewise import Fineness, Piecewise, fine_integrals, resolve, resolve_with, shifted_integrals
from impactlab.reference.potential import NODES_OF_PANEL, OCTAVES, USUAL, Potential

TOLERANCE = 1e-12  # of a function on a panel, relative to its size there
FLOOR = 1e-23  # of a density or message, relative to its top
PROBED = 1e-8  # energy in units of T at which one looks for kinks near corners
NONE = np.empty(0)


class Messages:
    """Messages between the bodies of a tree, and densities of displacements.

    `TreeLaw` says what they are, and what it takes. All functions are polynomials on panels.
    """

    def __init__(self, bodies: tuple[str, ...], own: Sequence[Potential], links: Sequence[Link]) -> None:
        self.bodies, self.temperature = bodies, own[0].temperature
        for item in own:
            if item.octaves[0] < 2.0**-OCTAVES:
                raise NoExactReference(
                    f"{item.names}: the motion on its spring is smaller than {2.0**-USUAL:.1g} m, which the law "
                    "of several bodies does not resolve; give more noise, or other units."
                )
        self._places = {name: place for place, name in enumerate(bodies)}
        self.own, self.links = about_ground(own, links)
        self.spans, self._reaches = spans(self.own, self.links)
        self._known: dict[tuple[Hashable, ...], Any] = {}
        self._last: dict[tuple[int, int], Piecewise] = {}
        self._weights: dict[tuple[int, bytes, bytes], np.ndarray] = {}
        self._bytes = 0
        self._around = around(len(bodies), self.links)
        self._logarithms = [self._logarithm(k) for k in range(len(bodies))]
        self._kernels = [self._kernel(k) for k in range(len(links))]
        self._messages: dict[tuple[int, int], Piecewise] = {}
        steps = outwards(len(bodies), self.links)
        for near, far, link in reversed(steps):
            self._messages[far, near] = self._message(far, near, link)
        for near, far, link in steps:
            self._messages[near, far] = self._message(near, far, link)

    def _once(self, make: Callable[[], Any], name: str, *of: object) -> Any:
        """Make something once for each name and the objects that it is made of."""
        _, made = self._alike(lambda: (of, make()), name, *map(id, of))  # with the objects: their ids stay theirs
        return made

    def _alike(self, make: Callable[[], Any], *of: Hashable) -> Any:
        """Make something once for all that is equal."""
        if of not in self._known:
            self._known[of] = make()
        return self._known[of]

    def _logarithm(self, body: int) -> Piecewise:
        """Return the logarithm of a body's own function."""
        item, (low, high) = self.own[body], self.spans[body]

        def make() -> Piecewise:
            def fine(values: np.ndarray, tails: np.ndarray, panels: np.ndarray, before: np.ndarray) -> np.ndarray:
                return np.asarray(tails[0] <= 0.1 * TOLERANCE * (1.0 + np.abs(values[0]).max(axis=1)))

            first, probes = (edges_between(item.panels(start), low, high) for start in (START, PROBED))
            result = resolve_with(
                lambda *places: -item.energy(*places)[None], first, probes, lambda: fine, item.names, 1e-10
            )
            item.check_work(np.union1d(result.edges, _with_corners(item, low, high)))
            return result

        result: Piecewise = self._alike(make, "logarithm", item, low, high)
        return result

    def _kernel(self, index: int) -> Piecewise:
        """Return the factor of a link in the density, that where each contact is closed, and it times each force."""
        item = self.links[index][2]
        (low, high), origin = self._reaches[index], origin_of(item)

        def make() -> Piecewise:
            def function(starts: np.ndarray, offsets: np.ndarray) -> np.ndarray:
                places = np.full_like(starts, origin), starts + offsets
                factor = np.exp(-item.energy(*places))
                forces = [gap.law.evaluate(gap.indentation(*places)) for gap in item.gaps]
                with np.errstate(invalid="ignore"):
                    return np.array([factor, *(np.where(factor > 0.0, factor * force, 0.0) for force in forces)])

            corners = np.array(sorted(gap.corner for gap in item.gaps)) - origin

            def is_fine() -> Fineness:
                integrals = fine_integrals(corners, 0.1 * TOLERANCE)
                return lambda values, tails, panels, before: np.asarray(
                    integrals(values, tails, panels, before) & _relative(values[0], tails[0])
                )

            first, probes = (
                edges_between(item.panels(start) - origin, low - origin, high - origin) for start in (START, PROBED)
            )
            found = resolve_with(function, first, probes, is_fine, item.names, 1e-10)
            counts = np.flatnonzero(np.abs(found.values[0]).max(axis=1) > FLOOR**2)
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

        result: Piecewise = self._alike(make, "kernel", item, low, high)
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
            sums = self._integrals(density.edges, kernel, starts + offsets + sign * origin_of(item))[0] @ coefficients
            top = max(top, math.log(sums.max()))
            return np.asarray(np.log(np.maximum(sums, 10.0 * FLOOR * math.exp(top)))[None])

        def fine(values: np.ndarray, tails: np.ndarray, panels: np.ndarray, before: np.ndarray) -> np.ndarray:
            high = values[0].max(axis=1)
            noise = np.minimum(FLOOR * np.exp(np.minimum(top - high, 99.0)), 1.0)
            smooth = tails[0] <= TOLERANCE * (1.0 + np.abs(values[0]).max(axis=1)) + noise
            return np.asarray(smooth | is_noise(tails[0], before[0], np.exp(0.5 * np.minimum(top - high, 99.0))))

        hints = np.subtract.outer(self.own[source].corners, sign * item.corners).ravel()
        edges = edges_between(np.concatenate([np.linspace(span[0], span[1], 9), hints]), *span)
        found = resolve(function, edges, fine, item.names)
        found.coefficients[..., 0] -= top
        place = id(kernel), id(self._logarithms[target])
        last = self._last.get(place, found)
        # logarithms of messages that differ by less are the same
        same = np.array_equal(last.edges, found.edges) and np.abs(last.coefficients - found.coefficients).max() < 3e-13
        self._last[place] = last if same else found
        return self._last[place]

    def _factor(self, link: int, forward: bool) -> Piecewise:
        """Return the factor of a link in the density, for a sum over its first or its second body."""
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
        # bytes of weights of integrals that are kept
        while self._bytes > 100e6 and len(self._weights) > 1:
            self._bytes -= self._weights.pop(next(iter(self._weights))).nbytes
        return found

    def _density(self, body: int, without: int | None = None) -> Piecewise:
        """Return the density of a body, not normalised, without what one neighbour says."""
        got = [self._messages[other, body] for other, _ in self._around[body] if other != without]
        logarithm = self._logarithms[body]
        density: Piecewise = self._once(
            lambda: self._product(body, got, probes=np.concatenate([NONE, *map(narrow, got)])),
            "density",
            logarithm,
            *sorted(got, key=id),
        )
        return density

    def _product(
        self,
        body: int,
        factors: Sequence[Callable[..., np.ndarray]],
        extra: np.ndarray = NONE,
        probes: np.ndarray = NONE,
    ) -> Piecewise:
        """Return the product of a body's own function and some factors, which are given as logarithms."""
        logarithm = self._logarithms[body]

        both: list[Callable[..., np.ndarray]] = [logarithm, *factors]

        def parts(*places: np.ndarray) -> np.ndarray:
            return np.array([item(*places)[0] for item in both])

        edges, top, change = edges_between(extra, *logarithm.edges[[0, -1]]), -math.inf, math.inf
        edges = np.union1d(edges, logarithm.edges)
        while change > 1.0:  # towards the peak, which may be narrow
            values = parts(Piecewise(edges, NONE).nodes.ravel()).sum(axis=0)
            change, top = values.max() - top, values.max()
            peak = int(np.argmax(values)) // len(NODES_OF_PANEL)
            around = edges[max(peak - 1, 0) : peak + 3]
            edges = np.union1d(edges, 0.5 * (around[1:] + around[:-1]))

        sizes = NONE

        def function(starts: np.ndarray, offsets: np.ndarray) -> np.ndarray:
            nonlocal sizes
            logarithms = parts(starts, offsets)
            sizes = np.abs(logarithms).sum(axis=0)
            return np.asarray(np.exp(logarithms.sum(axis=0) - top)[None])

        def fine(values: np.ndarray, tails: np.ndarray, panels: np.ndarray, before: np.ndarray) -> np.ndarray:
            errors = 4.0 * (1.0 + sizes.reshape(values[0].shape).max(axis=1))  # of the logarithms
            smooth = _relative(values[0], tails[0], errors)
            return np.asarray(smooth | is_noise(tails[0], before[0], values[0].max(axis=1)))

        probes = edges_between(probes, *edges[[0, -1]])
        return resolve_with(function, edges, probes, lambda: fine, self.own[body].names, 1e-8)


def edges_between(edges: np.ndarray, low: float, high: float) -> np.ndarray:
    """Return the edges within a range, and its ends."""
    return np.unique(np.concatenate([[low], edges[(edges > low) & (edges < high)], [high]]))


def _relative(values: np.ndarray, tails: np.ndarray, loss: np.ndarray | float = 1.0) -> np.ndarray:
    """Whether a density of about 1 at its top is resolved relative to itself on each panel, where it is not tiny."""
    return np.asarray(tails <= TOLERANCE * loss * np.abs(values).max(axis=1) + FLOOR)


def _with_corners(item: Potential, low: float, high: float) -> np.ndarray:
    """Return the panels of a potential within a range that is widened to hold all corners."""
    corners = item.corners
    return edges_between(item.panels(START), min(low, corners[0]), max(high, corners[-1]))


def origin_of(item: Potential) -> float:
    """Return the coordinate from which the kernel of a link counts: a corner, near which it may be steep."""
    return item.gaps[0].corner if item.gaps else 0.0


def is_noise(tails: np.ndarray, before: np.ndarray, sizes: np.ndarray | float) -> np.ndarray:
    """Whether the last coefficients are small and do not shrink with the panels: places are rounded."""
    # a part of the size that does not shrink is rounding
    return np.asarray((tails <= 1e-9 * sizes) & (tails > 0.7 * before))


def narrow(function: Piecewise) -> np.ndarray:
    """Return the edges where a function has features that are narrow in its range."""
    widths = np.diff(function.edges)
    narrow = widths < 0.01 * widths.sum()
    return np.asarray(function.edges[np.append(narrow, False) | np.insert(narrow, 0, False)])
