"""First passages of a body under white noise, without random numbers: mean times, survival and rate of decay."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.linalg
import scipy.sparse.linalg

from impactlab.allowed_time import OutOfTime
from impactlab.components.composition import Composition
from impactlab.components.literature import article, in_one_line
from impactlab.components.stored import entries, json_of, stored
from impactlab.errors import InvalidInput, NoExactReference, warn
from impactlab.inputs import FiniteNumbers, checked, finite_array, known_name
from impactlab.reference.fokker_planck.cost import Budget
from impactlab.reference.fokker_planck.elements import Elements, Mesh
from impactlab.reference.fokker_planck.phase_plane import PhasePlane
from impactlab.reference.fokker_planck.second_body import ElementsBeside, PlaneBeside
from impactlab.results.dataset import provenance
from impactlab.results.labels import Variables, labelled

if TYPE_CHECKING:
    import xarray as xr

MESHES = (
    Mesh(3, 2, 0.1, 2.5, 1e-6, 1e-2, 0.9),
    Mesh(3, 3, 0.1, 2.0, 1e-7, 5e-3, 0.95),
    Mesh(4, 4, 0.1, 2.0, 1e-8, 3e-3, 1.0),
    Mesh(5, 5, 0.08, 2.0, 1e-9, 2e-3, 1.05),
)
"""Meshes, each finer than the one before: relative errors of mean times are about 1e-4, 3e-5, 3e-6 and 1e-7."""

BESIDE = (
    (Mesh(2, 2, 0.2, 3.0, 1e-3, 5e-2, 0.8), 4),
    (Mesh(3, 3, 0.1, 2.0, 1e-5, 1e-2, 0.95), 6),
    (Mesh(4, 4, 0.1, 2.0, 1e-6, 5e-3, 1.0), 8),
)
"""The same beside another body, with degrees of its Hermite functions: rates of decay on the first mesh are off by 1 %,
on the next one by less than 1e-4."""

_STARTS = np.array([0.2, 0.35, 0.5, 0.65, 0.8])
"""Places of rest between the ends at which meshes are compared."""

_ORDER = 1.5
"""Power of the unknowns with which the time of a solution grows, as sparse factors in a plane do."""

_KRYLOV, _SHORTER = 60, 45
"""Vectors of the space in which survival over time is found, and of a smaller one that tells the error of this."""

_ITERATIONS, _CLOSE_RATE = 20, 1e-5
"""Iterations for the rate of decay beside another body at most, and its relative change in the last one."""

_SHIFT = 15.0
"""Mean time over the time of the implicit step that makes these vectors."""

CITATIONS = [
    article("Marshall, T. W. and Watson, E. J.", "", "J. Phys. A", 18, 1985, "3531"),
    article("Masoliver, J. and Porrà, J. M.", "", "Phys. Rev. Lett.", 75, 1995, "189"),
]
"""Sources of the boundary layer at limits, and of the mean time with which the method was compared."""


@checked
@dataclass(frozen=True, eq=False, repr=False)
class PassageReference:
    """First passages of a body through limits of its displacement; `fokker_planck` makes it with ``absorb=``.

    Parameters
    ----------
    network : Network
        The network.
    absorb : mapping
        The limits as they were given.
    fine, coarse : Solved
        Solutions on two meshes, whose difference is the quoted error.

    Examples
    --------
    >>> alone = network.replace(contacts={"stop": None})
    >>> law = il.fokker_planck(alone, absorb={"a": 1.0}, tolerance=1e-3)
    >>> round(float(law.mean_passage_time()), 1)
    4.2
    """

    network: Composition
    absorb: Mapping[str, Any]
    fine: Solved
    coarse: Solved

    def mean_passage_time(self, displacement: Any = 0.0, velocity: Any = 0.0) -> np.ndarray:
        """Return the mean time until a limit is first passed (s).

        Parameters
        ----------
        displacement, velocity : array_like, or mapping of these by the name of a body
            Where the body with the limits starts (m, m s-1), or each of two bodies; all broadcast, and a body that is
            not named starts at 0. Between the limits; at a limit a body that leaves at once has the mean time 0.

        Returns
        -------
        ndarray

        Raises
        ------
        InvalidInput
            If a start is beyond a limit, or faster than the mesh reaches.
        """
        starts = self._starts(displacement, velocity)
        return self.fine.mean_time(*starts)

    def survival(self, time: FiniteNumbers, displacement: Any = 0.0, velocity: Any = 0.0) -> np.ndarray:
        """Return the probability that no limit is passed until a time.

        Parameters
        ----------
        time : array_like
            Times after the start (s).
        displacement, velocity : float, or mapping of these by the name of a body
            Where it starts (m, m s-1).

        Returns
        -------
        ndarray
            Of the shape of `time`.

        Raises
        ------
        InvalidInput
            If a time is negative, or the start is beyond a limit.
        """
        return self._survival(time, displacement, velocity)[0]

    @property
    def decay_rate(self) -> float:
        """Rate at which survival decays in the end, whatever the start (s-1)."""
        return self.fine.decay_rate

    def statistics(
        self, displacement: Any = 0.0, velocity: Any = 0.0, times: FiniteNumbers | None = None
    ) -> xr.Dataset:
        """Return mean time and rate of decay with their errors, and survival if there are times.

        Parameters
        ----------
        displacement, velocity : float, or mapping of these by the name of a body
            Where it starts (m, m s-1).
        times : array_like, optional
            Times of ``survival`` (s), as a record has them: ``result["survival_time"]``.

        Returns
        -------
        xarray.Dataset
            ``mean_passage_time``, ``decay_rate`` and ``survival`` as `il.FirstPassage` names them, each with an
            ``<name>_error``: the difference between two meshes, of which the finer one is some times as accurate, at
            least the largest relative difference of mean times.
        """
        import xarray as xr

        starts = self._starts(displacement, velocity)
        variables: Variables = {}
        for name, read, units, text in (
            ("mean_passage_time", lambda solved: solved.mean_time(*starts), "s", "mean time until a limit is passed"),
            ("decay_rate", lambda solved: np.asarray(solved.decay_rate), "s-1", "rate at which survival decays"),
        ):
            fine, coarse = read(self.fine), read(self.coarse)
            errors = np.maximum(np.abs(fine - coarse), self.relative_error * fine)
            variables |= _with_error(name, (), fine, errors, units, text)
        if times is not None:
            grid = times.ravel()
            text = "probability that no limit is passed until a time"
            variables |= _with_error(
                "survival", ("survival_time",), *self._survival(grid, displacement, velocity), "1", text
            )
            variables["survival_time"] = labelled(("survival_time",), grid, "s", "time after the start")
        absorb = {name: list(value) if isinstance(value, tuple) else value for name, value in self.absorb.items()}
        configuration = {"network": stored(self.network), "absorb": absorb}
        title = "first passages from the Fokker-Planck equation"
        sources = in_one_line([*entries(configuration), *CITATIONS])
        return xr.Dataset(variables).assign_attrs(provenance(title, json_of(configuration), sources))

    @cached_property
    def relative_error(self) -> float:
        """Largest difference between mean times from rest on the two meshes, over the largest mean time."""
        low, high = self.fine.elements.plane.ends
        starts = self.fine.at_rest(low + (high - low) * _STARTS)
        difference = self.fine.mean_time(*starts) - self.coarse.mean_time(*starts)
        return float(np.abs(difference).max() / self.fine.typical)

    def __repr__(self) -> str:
        (name,), elements = self.absorb, self.fine.elements
        low, high = elements.plane.ends
        return f"PassageReference: {name} from {low:g} to {high:g} m, {elements.unknowns:.3g} unknowns"

    def _starts(self, displacement: Any, velocity: Any) -> tuple[np.ndarray, ...]:
        """Return where bodies start, which must be within the limits: displacement and velocity of each."""
        plane, names = self.fine.elements.plane, [*self.absorb, *self.fine.elements.others]
        given = []
        for title, values in (("displacement", displacement), ("velocity", velocity)):
            by_name = values if isinstance(values, Mapping) else {names[0]: values}
            for name in by_name:
                known_name("oscillator", name, dict.fromkeys(names))
            given.append([finite_array(title, by_name.get(name, 0.0)) for name in names])
        states = np.broadcast_arrays(*(item for pair in zip(*given, strict=True) for item in pair))
        x, v = states[:2]
        outside = (x < plane.ends[0]) | (x > plane.ends[1])
        if outside.any():
            raise InvalidInput(
                f"The start of {plane.name!r} at {x[outside][0]:g} m is not within its limits, from {plane.ends[0]:g} "
                f"to {plane.ends[1]:g} m."
            )
        fastest = min(self.fine.elements.v[-1], self.coarse.elements.v[-1])
        if (np.abs(v) > fastest).any():
            raise InvalidInput(f"velocity must be within {fastest:g} m s-1, beyond which the body never is.")
        return tuple(states)

    def _survival(self, times: np.ndarray, displacement: Any, velocity: Any) -> tuple[np.ndarray, np.ndarray]:
        """Return the probabilities of survival, and their errors."""
        if (times < 0.0).any():
            raise InvalidInput(f"time must be 0 s or later, not {times.min():g} s.")
        starts = self._starts(displacement, velocity)
        fine, shorter, coarse = (
            solved.survival(times.ravel(), vectors, *starts).reshape(times.shape)
            for solved, vectors in ((self.fine, _KRYLOV), (self.fine, _SHORTER), (self.coarse, _KRYLOV))
        )
        return fine, np.maximum(np.abs(fine - shorter), np.abs(fine - coarse))


class Solved:
    """Equations of first passage on a mesh, and their solution, which may take the time of a budget."""

    def __init__(self, elements: Elements | ElementsBeside, budget: Budget, last: Solved | None = None) -> None:
        begun: float = budget.spent
        self.elements = elements
        if last is not None:
            budget.check(last.seconds * (elements.unknowns / last.elements.unknowns) ** _ORDER)
        self._solve = elements.inverse()
        self._time = self._solve(-elements.weigh(elements.ones))
        self.seconds: float = budget.spent - begun

    def at_rest(self, x: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return states at rest, of which the body with the limits is at some places, (state,)."""
        return x, *[np.zeros(len(x))] * (1 + 2 * len(self.elements.others))

    def mean_time(self, *states: np.ndarray) -> np.ndarray:
        """Return the mean time from some starts (s)."""
        return self.elements.read(self._time, *(item.ravel() for item in states)).reshape(states[0].shape)

    @cached_property
    def typical(self) -> float:
        """Largest mean time from rest, about (s)."""
        low, high = self.elements.plane.ends
        return float(self.mean_time(*self.at_rest(low + (high - low) * _STARTS)).max())

    def survival(self, times: np.ndarray, vectors: int, *states: np.ndarray) -> np.ndarray:
        """Return the probabilities that a body is still within at some times."""
        space, matrix, size = self._space
        read = self.elements.read(space[:vectors].T, *(item.ravel() for item in states))[0] * size
        small = self._small(matrix, vectors)
        values = np.array([read @ scipy.linalg.expm(time * small)[:, 0] for time in times])
        return np.clip(np.where(times == 0.0, 1.0, values), 0.0, 1.0)

    @cached_property
    def decay_rate(self) -> float:
        """The slowest rate of decay (s-1)."""
        elements = self.elements
        if elements.others:
            return self._rate_by_iteration()
        shape = elements.unknowns, elements.unknowns
        inverse = scipy.sparse.linalg.LinearOperator(shape, matvec=lambda field: self._solve(elements.weigh(field)))
        (largest,) = scipy.sparse.linalg.eigs(inverse, k=1, v0=self._time, return_eigenvectors=False)
        return float(-1.0 / largest.real)

    def _rate_by_iteration(self) -> float:
        """Return this rate by inverse iteration from the mean time, which is nearly its eigenvector.

        Each equation begins with the solution of the one before, and so takes few steps.
        """
        field, rate = self._time, 1.0 / self.typical
        for _ in range(_ITERATIONS):
            found = self._solve(-self.elements.weigh(field), field / rate)
            before, rate = rate, float(field @ field / (field @ found))
            field = found * rate
            if abs(rate - before) <= _CLOSE_RATE * rate:
                break
        return rate

    def _small(self, matrix: np.ndarray, vectors: int) -> np.ndarray:
        """Return the generator in the space of some vectors."""
        inverse = np.linalg.inv(matrix[:vectors, :vectors])
        return np.asarray((np.eye(vectors) - inverse) * (_SHIFT / self.typical))

    @cached_property
    def _space(self) -> tuple[np.ndarray, np.ndarray, float]:
        """Orthonormal vectors made by implicit steps from survival at the start, how steps act on them, and its size.

        It is Arnoldi's method for ``(M − γ G)⁻¹ M`` (J. van den Eshof and M. Hochbruck, SIAM J. Sci. Comput. 27, 2006,
        1438).
        """
        elements = self.elements
        solve = elements.inverse(self.typical / _SHIFT)
        space, matrix = np.zeros((_KRYLOV + 1, elements.unknowns)), np.zeros((_KRYLOV + 1, _KRYLOV))
        size = float(np.sqrt(elements.ones.sum()))
        space[0] = elements.ones / size
        for number in range(_KRYLOV):
            vector = solve(elements.weigh(space[number]))
            for _ in range(2):  # the second time removes the rounding of the first one
                parts = space[: number + 1] @ vector
                vector -= parts @ space[: number + 1]
                matrix[: number + 1, number] += parts
            matrix[number + 1, number] = np.linalg.norm(vector)
            space[number + 1] = vector / matrix[number + 1, number]
        return space[:_KRYLOV], matrix[:_KRYLOV], size


def absorbed(network: Composition, absorb: Mapping[str, Any], tolerance: float, budget: Budget) -> PassageReference:
    """Solve first passages on finer and finer meshes until two of them agree within a relative tolerance."""
    equations = _equations(network, absorb)
    coarse, late = Solved(next(equations), budget), ""
    found: PassageReference | None = None
    try:
        for elements in equations:
            fine = Solved(elements, budget, coarse)
            found = PassageReference(network, dict(absorb), fine, coarse)
            if found.relative_error <= tolerance:
                return found
            coarse = fine
    except OutOfTime as error:
        late = str(error)
    if found is None:
        raise NoExactReference(f"The second mesh, without which there is no error, {late}; give a larger max_seconds=.")
    text = f"Mean times have a relative error of {found.relative_error:.1e}, beyond {tolerance:g}"
    warn("tolerance", f"{text}. Give a larger max_seconds= or tolerance=.")
    return found


def _equations(network: Composition, absorb: Mapping[str, Any]) -> Iterator[Elements | ElementsBeside]:
    """Yield the equations of one body, or of one beside another, on finer and finer meshes."""
    if len(network.oscillators) == 2:
        beside = PlaneBeside.of(network, absorb)
        yield from (ElementsBeside(beside, mesh, degree) for mesh, degree in BESIDE)
    else:
        plane = PhasePlane.of(network, absorb)
        yield from (Elements(plane, mesh) for mesh in MESHES)


def _with_error(
    name: str, dimensions: tuple[str, ...], values: np.ndarray, errors: np.ndarray, units: str, text: str
) -> Variables:
    """Return a variable and its numerical error."""
    return {
        name: labelled(dimensions, values, units, text),
        f"{name}_error": labelled(dimensions, errors, units, f"numerical error of {text}"),
    }
