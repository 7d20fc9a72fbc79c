"""The state of least energy of a tree, about which its density is looked at, and how far from it that matters."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from impactlab.errors import NoExactReference
from impactlab.reference.potential import Potential

VANISHED = 100.0
"""Energy above the least one, in units of T, beyond which nothing counts."""

START = 0.3
"""Energy, in units of T, at which the first panels around corners and minima begin."""

_LARGEST_STEP = 1e3  # in lengths that change the energy by T
_LEAST_DAMPING = 1e-15  # of the steps, relative to the curvature

Link = tuple[int, int, Potential]
"""Two bodies and the potential of the difference of their displacements."""


def about_ground(own: Sequence[Potential], links: Sequence[Link]) -> tuple[list[Potential], list[Link]]:
    """Return the same potentials less lines that add up to 0, so that each is near 0 where the energy is least.

    The lines are the tangents of the links where the energy is least, and what balances them
    on the bodies. So the factors of the density, and products of some of them, are large
    where the density is large, also for bodies that press against each other.
    """
    x = _least(own, links)
    between = [x[i] - x[j] for i, j, _ in links]
    tangents = [float(item.force(np.array([u]))[0]) for (_, _, item), u in zip(links, between, strict=True)]
    pulls = [0.0] * len(own)
    for (i, j, _), tangent in zip(links, tangents, strict=True):
        pulls[i] -= tangent
        pulls[j] += tangent
    bodies = [_less(item, slope, place) for item, slope, place in zip(own, pulls, x, strict=True)]
    pairs = [(i, j, _less(item, s, u)) for (i, j, item), s, u in zip(links, tangents, between, strict=True)]
    depth = depth_of([*bodies, *(item for *_, item in pairs)])
    # an energy down to −T is taken for rounding
    if depth < -1.0 and not any(
        item.springs for item in [*own, *(link[2] for link in links)]
    ):  # forces that grow: no depth but of rounding
        raise _not_found(own)
    # so far down a potential less its tangent has no minimum of interest
    if depth < -1e4:
        return list(own), list(links)
    return bodies, pairs


def spans(own: Sequence[Potential], links: Sequence[Link]) -> tuple[np.ndarray, np.ndarray]:
    """Return the ranges of each displacement and of each difference that count, (body, 2) and (link, 2) (m).

    In it neither a potential of the body nor one on the way to any other body need be larger than the least energy plus
    `VANISHED`. Bodies that nothing confines are refused.
    """
    between = [item for *_, item in links]
    most = VANISHED - depth_of([*own, *between])
    known = {item: span_of(item, most) for item in dict.fromkeys([*own, *between])}
    result = np.array([known[item] for item in own])
    steps = outwards(len(own), links)
    for inwards in (True, False):
        for near, far, link in reversed(steps) if inwards else steps:
            body, other = (near, far) if inwards else (far, near)
            i, _, item = links[link]
            low, high = known[item] if body == i else np.negative(known[item])[::-1]
            result[body, 0] = max(result[body, 0], result[other, 0] + low)
            result[body, 1] = min(result[body, 1], result[other, 1] + high)
    for item, span in zip(own, result, strict=True):
        if not np.isfinite(span).all():
            raise NoExactReference(
                f"{item.names}: the law cannot be normalised, because neither springs nor contacts confine it "
                "on both sides; add either."
            )
    reached = [result[i] - result[j, ::-1] for i, j, _ in links]
    between_links = [np.clip(known[item], *ends) for (*_, item), ends in zip(links, reached, strict=True)]
    return result, np.array(between_links).reshape(-1, 2)


def outwards(count: int, links: Sequence[Link], first: int = 0) -> list[tuple[int, int, int]]:
    """Return the links of a tree from one body on: near body, far body, index of the link."""
    result: list[tuple[int, int, int]] = []
    near, reached, waiting = around(count, links), {first}, [first]
    for body in waiting:
        for other, index in near[body]:
            if other not in reached:
                reached.add(other)
                waiting.append(other)
                result.append((body, other, index))
    return result


def around(count: int, links: Sequence[Link]) -> list[list[tuple[int, int]]]:
    """Return the neighbours of each body, and the indices of the links to them."""
    result: list[list[tuple[int, int]]] = [[] for _ in range(count)]
    for index, (i, j, _) in enumerate(links):
        result[i].append((j, index))
        result[j].append((i, index))
    return result


def _less(item: Potential, slope: float, place: float) -> Potential:
    """Return a potential less its tangent of some slope at a place."""
    level = float(item.energy(np.array([place]))[0]) - slope * place
    return dataclasses.replace(item, slope=slope, level=level)


def depth_of(items: Sequence[Potential]) -> float:
    """Return the sum of the least values of some potentials, at most 0."""
    least = {item: min(float(item.energy(item.panels(START)).min()), 0.0) for item in dict.fromkeys(items)}
    return math.fsum(least[item] for item in items)


def span_of(item: Potential, most: float) -> tuple[float, float]:
    """Return between which places a potential is not larger than some value, infinite if that never ends."""
    edges = item.panels(START)
    inside = np.flatnonzero(item.energy(edges) <= most)
    ends = []
    for within, beyond, last in ((inside[0], inside[0] - 1, -1), (inside[-1], inside[-1] + 1, len(edges))):
        if beyond == last:
            ends.append(math.copysign(math.inf, last))
            continue
        low, high = edges[within], edges[beyond]
        for _ in range(6):  # octaves are coarse
            middle = 0.5 * (low + high)
            low, high = (middle, high) if item.energy(np.array([middle]))[0] <= most else (low, middle)
        ends.append(float(high))
    return ends[0], ends[1]


def _least(own: Sequence[Potential], links: Sequence[Link]) -> list[float]:
    """Return about where the energy is least, by Newton's method from 0 on.

    It need not be exact, only close in terms of T; what is close is rounded, so that equal
    bodies get equal numbers.
    """
    from scipy.sparse import coo_array, diags_array

    count = len(own)
    items = [*own, *(item for *_, item in links)]
    rows = [(k, k, 1.0) for k in range(count)]
    for k, (i, j, _) in enumerate(links, start=count):
        rows += [(k, i, 1.0), (k, j, -1.0)]
    term, body, sign = (np.array(column) for column in zip(*rows, strict=True))
    to_terms = coo_array((sign, (term, body)), shape=(len(items), count)).tocsr()
    members: dict[Potential, list[int]] = {}
    for k, item in enumerate(items):
        members.setdefault(item, []).append(k)

    def of_terms(name: str, q: np.ndarray) -> np.ndarray:
        result = np.empty(len(items))
        for item, of_item in members.items():
            result[of_item] = getattr(item, name)(q[of_item])
        return result

    lengths = {item: _length(item) for item in members}
    longest = max((value for value in lengths.values() if math.isfinite(value)), default=1.0)
    length = np.array([min(lengths[item], longest) for item in items])
    scale = abs(to_terms).T @ length**-2.0
    x, damping, floor = np.zeros(count), _LEAST_DAMPING, np.ones(count)
    energy = of_terms("energy", to_terms @ x).sum()
    for _ in range(200):
        q = to_terms @ x
        gradient = to_terms.T @ of_terms("force", q)
        step = 1e-4 * length + 1e-7 * np.abs(q)
        curvature = np.abs(of_terms("force", q + step) - of_terms("force", q - step)) / (2.0 * step)  # also uphill
        hessian = to_terms.T @ diags_array(curvature) @ to_terms
        diagonal = hessian.diagonal()
        floor = diagonal + 1e-12 * diagonal.max() + 1e-300
        if not gradient.any() or _newton(hessian, _LEAST_DAMPING * floor, gradient) @ gradient < 1e-3:
            break
        while damping < 1e12:
            change = -_newton(hessian, damping * floor, gradient)
            change = np.clip(change, -_LARGEST_STEP * longest, _LARGEST_STEP * longest)
            lower = of_terms("energy", to_terms @ (x + change)).sum()
            if lower < energy:
                x, energy, damping = x + change, lower, max(0.01 * damping, _LEAST_DAMPING)
                break
            damping *= 100.0
    else:
        raise _not_found(own)
    quantum = 2.0 ** np.floor(np.log2(1e-8 / np.sqrt(floor + scale)))
    return [float(place) for place in np.where(x == 0.0, 0.0, np.round(x / quantum) * quantum)]


def _newton(hessian: Any, damping: np.ndarray, gradient: np.ndarray) -> np.ndarray:
    """Return the step of Newton's method up the gradient."""
    from scipy.sparse import diags_array
    from scipy.sparse.linalg import splu

    return np.asarray(splu((hessian + diags_array(damping)).tocsc()).solve(gradient))


def _not_found(own: Sequence[Potential]) -> NoExactReference:
    return NoExactReference(
        f"{own[0].names} and what is connected to it: no state of minimum energy is found, because forces do not grow "
        "with the displacement, or contacts are too stiff for their preload."
    )


def _length(item: Potential) -> float:
    """Return the least distance from a corner that changes a potential by T, in octaves; infinite if none does."""
    corners = item.corners[:, None]
    octaves = item.octaves
    change = np.abs(item.energy(corners + octaves) - item.energy(corners))
    change = np.maximum(change, np.abs(item.energy(corners - octaves) - item.energy(corners))).max(axis=0)
    return float(octaves[np.argmax(change > 1.0)]) if (change > 1.0).any() else math.inf
