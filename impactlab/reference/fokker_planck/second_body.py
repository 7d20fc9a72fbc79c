"""A second, linear body beside one with limits: functions of its state as sums of Hermite functions.

Over the plane of the limited body the coefficients are finite elements. The generator is that of the limited body with
the second one held, that of the second one with the first held, and the coupling between them. Without the coupling
the coefficients of the eigenvectors of the second body are equations of the plane, each shifted by an eigenvalue: their
solutions precondition the whole.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
import scipy.linalg
import scipy.sparse as sp
import scipy.sparse.linalg

from impactlab.assembly.model import SAMPLED, Model
from impactlab.components.composition import Composition
from impactlab.components.coupling import Coupling
from impactlab.components.sides import WALL
from impactlab.errors import InvalidInput, NoExactReference
from impactlab.inputs import known_name
from impactlab.reference.fokker_planck.elements import Elements, Mesh
from impactlab.reference.fokker_planck.phase_plane import REFUSAL, PhasePlane

_CLOSE = 1e-6
"""Relative residual at which a solution is good enough: below what the meshes leave."""

_VECTORS, _RESTARTS = 60, 4
"""Vectors of a space of GMRES (Y. Saad and M. H. Schultz, SIAM J. Sci. Stat. Comput. 7, 1986, 856), and how many there
are: beyond, the coupling is too strong for this."""

_REAL = 1e-12
"""Imaginary part of an eigenvalue, as a part of the largest one, up to which it is real."""

_REACH = 8.0
"""Largest velocity of the limited body, in standard deviations without the limits."""


@dataclass(frozen=True, eq=False)
class PlaneBeside:
    """The plane of the limited body with the second one held, and the linear motion of this beside it."""

    plane: PhasePlane
    other: str  # name of the second body
    mass: np.ndarray  # (2,) the limited body first
    damping: np.ndarray  # (2, 2)
    stiffness: np.ndarray
    diffusion: np.ndarray  # (2,) of velocities (m2 s-3)

    @classmethod
    def of(cls, network: Composition, absorb: Mapping[str, Any]) -> Self:
        """Return the plane of two bodies, one of which has limits, or refuse them with all reasons."""
        if not isinstance(absorb, Mapping) or len(absorb) != 1:
            raise InvalidInput(f"absorb= takes the limits of one oscillator, such as {{'a': 0.1}}, not {absorb!r}.")
        ((name, given),) = absorb.items()
        known_name("oscillator", name, network.oscillators)
        model = Model.of(network)
        first = model.bodies.names.index(name)
        order = np.array([first, 1 - first])
        other = model.bodies.names[1 - first]
        if reasons := list(_reasons(model, first)):
            raise NoExactReference("\n- ".join([REFUSAL, *reasons]))
        if isinstance(given, list | tuple) and None in given:
            raise InvalidInput(f"absorb of {name!r} beside another body has two limits, not {given!r}.")
        plane = PhasePlane.of(_held(network, name, other), absorb)
        both = np.ix_(order, order)
        damping, stiffness = (
            (np.diag(own) + model.coupled.springs(numbers))[both]
            for own, numbers in zip((model.damping, model.stiffness), model.couplings.linear[::-1], strict=True)
        )
        diffusion = 2.0 * math.pi * model.noise.intensity[order] / model.mass[order] ** 2
        found = cls(plane, other, model.mass[order], damping, stiffness, diffusion)
        return replace(found, plane=replace(plane, speed=_REACH * float(found.deviations[1, 0])))

    @cached_property
    def deviations(self) -> np.ndarray:
        """Standard deviations of displacements and velocities without limits and contacts, (2, 2 body)."""
        drift, noise = np.zeros((4, 4)), np.zeros((4, 4))
        drift[:2, 2:], noise[2:, 2:] = np.eye(2), np.diag(self.diffusion)
        drift[2:, :2], drift[2:, 2:] = -self.stiffness / self.mass[:, None], -self.damping / self.mass[:, None]
        if np.linalg.eigvals(drift).real.max() >= 0.0:
            raise NoExactReference(f"{REFUSAL}\n- its linear motion does not come to rest")
        covariance = scipy.linalg.solve_continuous_lyapunov(drift, -noise)
        return np.sqrt(np.diag(covariance)).reshape(2, 2)


def _held(network: Composition, name: str, other: str) -> Composition:
    """Return the network with the second body held where it is at rest."""
    couplings: dict[str, Coupling | None] = {}
    for title, item in network.couplings.items():
        sides = [WALL if side == other else side for side in (item.first, item.second)]
        couplings[title] = None if name not in sides else Coupling(sides[0], sides[1], item.law)
    excitations = {title: None for title in network.given()["excitations"] if title == other}
    return network.replace(oscillators={other: None}, couplings=couplings, excitations=excitations)


def _reasons(model: Model, first: int) -> Iterator[str]:
    """Yield why the second body is not linear, coupled linearly, and under white noise of its own."""
    name, other = model.bodies.names[first], model.bodies.names[1 - first]
    if model.bodies.residual[1 - first]:
        yield f"{other!r} is not linear, and only {name!r} may be"
    slots, rows = model.ends.slots, model.ends.rows
    for contact in rows[slots == 1 - first][:1]:
        yield f"{model.contacts.names[contact]!r} is a contact of {other!r}, and only {name!r} may have some"
    for title, law in zip(model.couplings.names, model.couplings.laws, strict=True):
        if law.linear == (0.0, 0.0):
            yield f"the coupling {title!r} is not linear"
    if any(not isinstance(side, str) for item in model.network.couplings.values() for side in _named(item)):
        yield "it couples combinations of bodies"
    for kind in SAMPLED:
        if model.sources[kind].names:
            yield "noise is not white"
    if set(model.sources["force"].bodies) & {1 - first}:
        yield f"a force acts on {other!r}"
    if len(set(model.sources["intensity"].names) - set(model.bodies.names)):
        yield "bodies share a noise"


def _named(item: Coupling) -> list[Any]:
    """Return the sides of a coupling that are no walls."""
    return [side for side in (item.first, item.second) if side is not WALL]


class Hermite:
    """Hermite functions of displacement and velocity up to a degree, each of unit norm, and operators on their sums."""

    def __init__(self, degree: int, scales: np.ndarray) -> None:
        self.scales, orders = scales, [(n, total - n) for total in range(degree + 1) for n in range(total + 1)]
        places = {order: place for place, order in enumerate(orders)}
        self.orders, self.number = np.array(orders), len(orders)
        self.slopes, self.times = np.zeros((2, 2, self.number, self.number))  # by x and by v, of coefficients
        for order, place in places.items():
            for axis in range(2):
                up, down = list(order), list(order)
                up[axis], down[axis] = order[axis] + 1, order[axis] - 1
                if (above := places.get(tuple(up))) is not None:  # type: ignore[arg-type]
                    self.times[axis, above, place] = scales[axis] * math.sqrt(order[axis] + 1.0)
                if (below := places.get(tuple(down))) is not None:  # type: ignore[arg-type]
                    self.times[axis, below, place] = scales[axis] * math.sqrt(order[axis])
                    self.slopes[axis, below, place] = math.sqrt(order[axis]) / scales[axis]

    def at(self, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return all functions in some states, (state, function)."""
        last = int(self.orders.max(initial=0))
        values = np.ones((2, last + 2, len(x)))
        for axis, place in enumerate((x / self.scales[0], v / self.scales[1])):
            values[axis, 1] = place
            for n in range(1, last + 1):
                values[axis, n + 1] = (place * values[axis, n] - math.sqrt(n) * values[axis, n - 1]) / math.sqrt(n + 1)
        return np.asarray((values[0, self.orders[:, 0]] * values[1, self.orders[:, 1]]).T)


class ElementsBeside:
    """The equations ``M dS/dt = G S`` of two bodies; unknowns are (function, unknown of the plane).

    Parameters
    ----------
    beside : PlaneBeside
    mesh : Mesh
        Of the plane of the limited body.
    degree : int
        Of the Hermite functions of the second one.
    """

    def __init__(self, beside: PlaneBeside, mesh: Mesh, degree: int) -> None:
        self.beside, self.plane = beside, beside.plane
        self.of_plane = Elements(self.plane, mesh)
        self.hermite = Hermite(degree, beside.deviations[:, 1])
        self.unknowns = self.hermite.number * self.of_plane.unknowns
        (mass_a, mass_b), k, c = beside.mass, beside.stiffness, beside.damping
        (by_x, by_v), (times_x, times_v) = self.hermite.slopes, self.hermite.times
        pull = (k[1, 1] * times_x + c[1, 1] * times_v) / mass_b
        self.alone = times_v @ by_x - pull @ by_v + 0.5 * beside.diffusion[1] * by_v @ by_v
        plane = self.of_plane
        self.couples = [
            (plane.pushed, -(k[0, 1] * times_x + c[0, 1] * times_v) / mass_a),
            (-(k[1, 0] * plane.displacement + c[1, 0] * plane.velocity) / mass_b, by_v),
        ]

    @property
    def others(self) -> tuple[str, ...]:
        """The name of the second body."""
        return (self.beside.other,)

    @property
    def v(self) -> np.ndarray:
        """Edges of velocities of the limited body (m s-1)."""
        return self.of_plane.v

    @cached_property
    def ones(self) -> np.ndarray:
        """The coefficients of the function 1."""
        result = np.zeros((self.hermite.number, self.of_plane.unknowns))
        result[0] = 1.0
        return result.ravel()

    def read(self, field: np.ndarray, *states: np.ndarray) -> np.ndarray:
        """Return a function (unknown, …) at some states: displacement and velocity of each body, (state,) each."""
        x, v, y, w = states
        coefficients = field.reshape(self.hermite.number, self.of_plane.unknowns, *field.shape[1:])
        over_plane = self.of_plane.read(np.moveaxis(coefficients, 0, 1), x, v)
        return np.asarray(np.einsum("sk...,sk->s...", over_plane, self.hermite.at(y, w)))

    def weigh(self, field: np.ndarray) -> np.ndarray:
        """Return M times a function, (unknown,)."""
        return self._by_plane(self.of_plane.mass, field.reshape(self.hermite.number, -1)).ravel()

    def inverse(self, step: float | None = None) -> Callable[..., np.ndarray]:
        """Return what solves equations of G, or of ``M - step G``, from a guess if there is one."""
        plane, (values, vectors) = self.of_plane, np.linalg.eig(self.alone)
        one, other = (0.0, 1.0) if step is None else (1.0, -step)
        back = np.linalg.inv(vectors)
        chosen = np.flatnonzero(values.imag > -_REAL * np.abs(values).max())
        real = np.abs(values[chosen].imag) <= _REAL * np.abs(values).max()
        solvers = []
        for value, is_real in zip(values[chosen], real, strict=True):
            shift = value.real if is_real else value
            solvers.append(scipy.sparse.linalg.splu((one + other * shift) * plane.mass + other * plane.generator).solve)
        shape, weights = (self.hermite.number, plane.unknowns), np.where(real, 1.0, 2.0)

        def uncoupled(field: np.ndarray) -> np.ndarray:
            parts = back[chosen] @ field.reshape(shape)
            pairs = zip(solvers, parts, real, strict=True)
            found = [solve(part.real if is_real else part) for solve, part, is_real in pairs]
            return np.asarray((vectors[:, chosen] * weights @ np.array(found)).real).ravel()

        def applied(field: np.ndarray) -> np.ndarray:
            own = field.reshape(shape)
            coupled = sum(functions @ self._by_plane(matrix, own) for matrix, functions in self.couples)
            return field + other * uncoupled(coupled)

        whole = scipy.sparse.linalg.LinearOperator((self.unknowns,) * 2, matvec=applied, dtype=float)

        def solve(field: np.ndarray, guess: np.ndarray | None = None) -> np.ndarray:
            begin = uncoupled(field)
            numbers = {"rtol": _CLOSE, "restart": _VECTORS, "maxiter": _RESTARTS}
            found, left = scipy.sparse.linalg.gmres(whole, begin, begin if guess is None else guess, **numbers)
            if left:
                raise NoExactReference(f"{REFUSAL}\n- the coupling of {self.beside.other!r} is too strong")
            return np.asarray(found)

        return solve

    @staticmethod
    def _by_plane(matrix: sp.csc_array, field: np.ndarray) -> np.ndarray:
        """Return a matrix of the plane times each coefficient, (function, unknown)."""
        return np.asarray((matrix @ field.T).T)
