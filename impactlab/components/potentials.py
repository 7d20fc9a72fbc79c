"""Potentials against the work of their forces, before anything is computed with them."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping

import numpy as np

from impactlab.components.component import Component
from impactlab.components.evaluation import are_one
from impactlab.components.matrices import ZERO
from impactlab.errors import InvalidInput
from impactlab.quadrature import gauss_legendre

_OCTAVES = 2.0 ** np.arange(-40, 8)  # places (m) between which a potential is looked at
_ORDER = 16
_NODES, _WEIGHTS = gauss_legendre(_ORDER)
_TRANSFORM = np.linalg.inv(np.polynomial.legendre.legvander(_NODES, _ORDER - 1)).T  # values at the nodes → coefficients
_AT_ENDS = np.polynomial.legendre.legvander([-1.0, 1.0], _ORDER - 1).T  # coefficients → values at both ends
_ROUNDING = 64.0 * np.finfo(float).eps


def check_potentials(
    what: str, members: Mapping[str, Component], force: str, potential: str, both_sides: bool = False
) -> None:
    """Refuse potentials that are not the work of their forces from 0, also below 0 if they have `both_sides`.

    Members are laws by the names of `what`, as messages say it, with two kernels. Of each class up to eight are looked
    at, since what is wrong is a formula. From one octave of places to the next the change of the potential is compared
    with the integral of the force, by Gauss's rule. Where polynomials of order 15 do not resolve them (a kink), the
    tolerance grows by what they leave. Nothing is looked at where a kernel fails or overflows, or the force depends on
    a rate.
    """
    distinct: dict[type[Component], list[Component]] = {}
    laws = list(members.values())
    for component in laws[:1] if are_one(laws) else dict(zip(map(id, laws), laws, strict=True)).values():
        distinct.setdefault(type(component), []).append(component)
    for kind, found in distinct.items():
        if not kind.has_kernel(potential) or not set(kind.kernel(force)[1]) <= {kind.kernels[force][0]}:
            continue
        kernels = getattr(kind, force), getattr(kind, potential)
        # eight laws of a class at most
        for component in found[:: -(-len(found) // 8)]:
            wrong = _difference(component, force, potential, both_sides, kernels)
            if wrong:
                name = next(name for name, item in members.items() if item is component)
                raise InvalidInput(
                    f"{kind.__name__}.{potential} of {what} {name!r} {wrong} Make it the integral of {force} from 0, "
                    "or leave it out: only exact laws need it."
                )


@functools.lru_cache(maxsize=10_000)
def _difference(
    component: Component, force: str, potential: str, both_sides: bool, _kernels: tuple[Callable[..., float], ...]
) -> str:
    """Say what is wrong with a potential; nothing if it is right."""
    panels = np.stack([_OCTAVES[:-1], _OCTAVES[1:]], axis=1)
    if both_sides:
        panels = np.concatenate([-panels[::-1, ::-1], panels])
    half = 0.5 * np.diff(panels, axis=1)
    nodes = panels[:, :1] + half * (1.0 + _NODES)
    energies, forces = _values(component, potential, nodes), _values(component, force, nodes)
    push = _values(component, force, panels)
    ends, at_rest = _values(component, potential, panels), float(_values(component, potential, np.zeros(1))[0])
    known = np.isfinite(energies).all(axis=1) & np.isfinite(forces).all(axis=1) & np.isfinite(ends).all(axis=1)
    if not known.any():
        return ""
    if abs(at_rest) > ZERO * np.abs(energies[known]).max():
        return f"is {at_rest:g} J at 0, where it must be 0."
    panels, half, energies, forces, ends, push = (item[known] for item in (panels, half, energies, forces, ends, push))
    change, work = ends[:, 1] - ends[:, 0], half[:, 0] * (forces @ _WEIGHTS)
    left = [np.abs(values @ _TRANSFORM)[:, -4:].max(axis=1) for values in (energies, forces)]
    beyond = np.abs(forces @ _TRANSFORM @ _AT_ENDS - push).sum(axis=1)  # by a jump between a node and an end
    size, reach = half[:, 0] * (np.abs(forces) @ _WEIGHTS), np.abs(panels).max(axis=1)
    unresolved = 20.0 * left[0] + half[:, 0] * (4.0 * left[1] + 2.0 * (1.0 - _NODES[-1]) * np.nan_to_num(beyond))
    # a part of the work
    allowed = 1e-6 * size + unresolved + _rounding(size, reach, ends)
    wrong = np.abs(change - work) > allowed
    if not wrong.any():
        return ""
    # the place nearest to 0.01 m, about which messages like to speak
    worst = int(np.argmin(np.where(wrong, np.abs(np.log(reach / 0.01)), np.inf)))
    (low, high), grown, done = panels[worst], change[worst], work[worst]
    return (
        f"is not the integral of {type(component).__name__}.{force}: from {low:.4g} m to {high:.4g} m it grows by "
        f"{grown:.6g} J, and the integral is {done:.6g} J."
    )


def _rounding(work: np.ndarray, reach: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Return how much of a potential may be lost because large terms in it cancel.

    What cancels close to 0 shows farther out, as ``1 − cos x`` shows that 1 is in it. What grows faster
    than a sixth power does so by itself, as ``exp x``.
    """
    with np.errstate(all="ignore"):
        possible = work[:, None] * (reach / reach[:, None]) ** 6.0
    largest = np.abs(ends).max(axis=1)
    return np.asarray(_ROUNDING * np.where(largest <= possible, largest, 0.0).max(axis=1))


def _values(component: Component, name: str, places: np.ndarray) -> np.ndarray:
    """Return the values of a kernel, NaN where it fails."""
    function, kinematic, fields = component.kernel(name)
    filled = [getattr(component, field) for field in fields]

    def value(place: float) -> float:
        try:
            return float(function(*[place][: len(kinematic)], *filled))
        except Exception:  # whatever it is, those who need the value will say it better
            return np.nan

    with np.errstate(all="ignore"):  # a kernel may be NumPy's, which warns instead
        return np.array([value(place) for place in places.ravel().tolist()]).reshape(places.shape)
