"""Exact transitions of linear motion over a step: under white noise, and under forces that are given."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from impactlab.assembly.remembered import remembered

GAUSS = (0.5 - math.sqrt(3.0) / 6.0, 0.5 + math.sqrt(3.0) / 6.0)
"""Nodes of Gauss's rule with two points on (0, 1)."""


def transition(
    mass: np.ndarray, damping: np.ndarray, stiffness: np.ndarray, intensity: np.ndarray, step: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the exact Gaussian transition A, Q, (n, 2, 2), of linear bodies, (n,) each (SI units), over a step (s).

    The state (x, v) of ``m x'' + c x' + k x = f`` with white noise f of two-sided density S becomes ``A (x, v)`` plus a
    normal vector of covariance Q, ``A = exp(h M)``. A and Q come from Van Loan's block exponential (IEEE Trans. Autom.
    Control 23, 1978, 395), so that free and undamped bodies need no case of their own; long steps by doubling,
    ``Q(2h) = Q + A Q Aᵀ``, which has no cancellation.
    """
    return transitions(mass, damping, stiffness, intensity, [step])[0]


def transitions(
    mass: np.ndarray, damping: np.ndarray, stiffness: np.ndarray, intensity: np.ndarray, steps: Sequence[float]
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the results of `transition` for several steps (s)."""
    found = _transitions(mass, damping, stiffness, intensity, *steps)
    return list(zip(found[::2], found[1::2], strict=True))


@remembered
def _transitions(
    mass: np.ndarray, damping: np.ndarray, stiffness: np.ndarray, intensity: np.ndarray, *steps: float
) -> tuple[np.ndarray, ...]:
    """Return A and Q over the first step, over the second, and so on."""
    unique, which = distinct_rows(np.stack([mass, damping, stiffness], axis=1))
    unit = np.zeros((len(unique), 2, 2))
    unit[:, 1, 1] = 1.0  # the covariance is proportional to the intensity
    scale = (2.0 * np.pi * intensity / mass**2)[:, None, None]
    found = gaussian_transitions(_drift(unique), unit, steps, _rate(unique))
    return tuple(item for a, q in found for item in (a[which], q[which] * scale))


def distinct_rows(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows that differ, and the place of each row among them."""
    if (rows == rows[:1]).all():
        return rows[:1], np.zeros(len(rows), dtype=np.int64)
    order = np.lexsort(rows.T)  # `numpy.unique` takes five times as long for many rows
    ordered = rows[order]
    new = np.append(True, (ordered[1:] != ordered[:-1]).any(axis=1))[: len(rows)]
    which = np.empty(len(rows), dtype=np.int64)
    which[order] = np.cumsum(new) - 1
    return ordered[new], which


def system_transition(
    mass: np.ndarray, damping: np.ndarray, stiffness: np.ndarray, intensity: np.ndarray, step: float, rate: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the exact Gaussian transition A, Q, (2 n, 2 n), of bodies that springs and dampers connect.

    Masses are (n,), matrices of damping, stiffness and spectral densities (n, n) (SI units). The rate is at least the
    magnitude of the largest eigenvalue of the motion (s-1). In A and Q all displacements come before all velocities.
    """
    drift, growth = drift_matrix(mass, damping, stiffness), diffusion_matrix(mass, intensity)
    a, q = gaussian_transition(drift[None], growth[None], step, rate)
    return a[0], q[0]


def gaussian_transition(
    drift: np.ndarray, growth: np.ndarray, step: float, rate: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return A and Q of ``z' = drift z`` under noise that adds `growth` to the covariance per time, (n, d, d) each."""
    return gaussian_transitions(drift, growth, [step], rate)[0]


def gaussian_transitions(
    drift: np.ndarray, growth: np.ndarray, steps: Sequence[float], rate: float
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the results of `gaussian_transition` for several steps (s)."""
    size, result = drift.shape[-1], []
    halvings = [_halvings(rate, step) for step in steps]
    short = np.array([step / 2.0**times for step, times in zip(steps, halvings, strict=True)])
    exponentials = _taylor(van_loan(drift, growth) * short[:, None, None, None])
    for exponential, times in zip(exponentials, halvings, strict=True):
        a = exponential[:, size:, size:].transpose(0, 2, 1)
        q = a @ exponential[:, :size, size:]
        for _ in range(times):
            q = q + a @ q @ a.transpose(0, 2, 1)
            a = a @ a
        result.append((a, 0.5 * (q + q.transpose(0, 2, 1))))
    return result


def split_transition(
    mass: np.ndarray,
    damping: np.ndarray,
    stiffness: np.ndarray,
    intensity: np.ndarray,
    step: float,
    place: float,
    until: float = 1.0,
    known: Mapping[float, np.ndarray] | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the flow A, Q, (n, 2, 2), of linear bodies with the friction and noise of a step at one moment.

    The undamped motion is exact, and so is what friction and noise do to the velocity over a step; each alone keeps the
    stationary law of the body, and so does the product, at any step. It needs one normal, since Q has rank one. The
    moment and the end of the flow are parts of the step, the rest is as in `transition`. Flows without friction and
    noise may be `known`, as `free_flows` returns them for this place and end.
    """
    flows = free_flows(mass, stiffness, step, [(place, until)]) if known is None else known
    if until < place:
        return flows[until * step], np.zeros((len(mass), 2, 2))
    before, after = flows[place * step], flows[(until - place) * step]
    decay = damping / mass * step
    friction = np.zeros_like(before)
    friction[:, 0, 0], friction[:, 1, 1] = 1.0, np.exp(-decay)
    noise = np.zeros_like(before)
    noise[:, 1, 1] = 2.0 * np.pi * intensity / mass**2 * step * _kept_of_noise(decay)
    return after @ friction @ before, after @ noise @ after.transpose(0, 2, 1)


def free_flows(
    mass: np.ndarray, stiffness: np.ndarray, step: float, ends: Iterable[tuple[float, float]]
) -> dict[float, np.ndarray]:
    """Return the flows without friction and noise, (n, 2, 2), that `split_transition` takes, by their times (s).

    They are those up to and from its place to its end, for all such pairs in `ends`.
    """
    parts = [(until,) if until < place else (place, until - place) for place, until in ends]
    times = list(dict.fromkeys(part * step for of_end in parts for part in of_end))
    return dict(zip(times, _undamped(mass, stiffness, *times), strict=True))


@remembered
def _undamped(mass: np.ndarray, stiffness: np.ndarray, *times: float) -> tuple[np.ndarray, ...]:
    """Return the motions without friction and noise over some times (s), (n, 2, 2) each."""
    unique, which = distinct_rows(np.stack([mass, np.zeros_like(mass), stiffness], axis=1))
    rate, result = _rate(unique), []
    halvings = [_halvings(rate, time) for time in times]
    short = np.array([time / 2.0**number for time, number in zip(times, halvings, strict=True)])
    flows = _taylor(_drift(unique).transpose(0, 2, 1) * short[:, None, None, None]).transpose(0, 1, 3, 2)
    for a, number in zip(flows, halvings, strict=True):
        for _ in range(number):
            a = a @ a
        result.append(a[which])
    return tuple(result)


def split_noise(
    mass: np.ndarray, damping: np.ndarray, stiffness: np.ndarray, size: np.ndarray, step: float, places: Sequence[float]
) -> np.ndarray:
    """Return the response of (x, v) to a normal number in the flow of `split_transition`, (place, n, 2).

    The size is the root of 2π times the two-sided spectral density of the force, with its sign, (n,), and the places
    are moments when friction and noise act, as parts of the step.
    """
    change = size / mass * np.sqrt(step * _kept_of_noise(damping / mass * step))
    after = [a[:, :, 1] for a in _undamped(mass, stiffness, *((1.0 - place) * step for place in places))]
    result: np.ndarray = np.stack(after) * change[:, None]
    return result


def _kept_of_noise(decay: np.ndarray) -> np.ndarray:
    """Return how much of the variance that noise gives in a step friction leaves, which alone decays by so much."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(decay > 0.0, -np.expm1(-2.0 * decay) / (2.0 * decay), 1.0))


@remembered
def response_to_force(mass: np.ndarray, damping: np.ndarray, stiffness: np.ndarray, step: float) -> np.ndarray:
    """Return displacement and velocity after a step from rest, (n, 4) (m, m s-1 each).

    Under a unit force, and under one that grows from -1 to 1 during the step.
    """
    unique, which = distinct_rows(np.stack([mass, damping, stiffness], axis=1))
    acceleration = np.stack([np.zeros(len(unique)), 1.0 / unique[:, 0]], axis=1)[..., None]
    response = np.concatenate(_response(_drift(unique), acceleration, step, _rate(unique))[..., 0], axis=1)
    return np.asarray(response[which])


def system_response(
    mass: np.ndarray, damping: np.ndarray, stiffness: np.ndarray, step: float, rate: float
) -> np.ndarray:
    """Return the response after a step from rest to forces on each body, (2, 2 n, n); see `system_transition`.

    The forces are 1, and grow from -1 to 1 during the step.
    """
    acceleration = np.concatenate([np.zeros((len(mass), len(mass))), np.diag(1.0 / mass)])
    return _response(drift_matrix(mass, damping, stiffness)[None], acceleration[None], step, rate)[:, 0]


def _response(drift: np.ndarray, acceleration: np.ndarray, step: float, rate: float) -> np.ndarray:
    """Return the state after a step from rest of ``z' = drift z + acceleration f``, (2, n, d, forces).

    Under ``f = 1``, and under ``f = 2 t/step - 1``.
    """
    count, size, forces = acceleration.shape
    whole = size + 2 * forces
    extended = np.zeros((count, whole, whole))  # the state (z, f, f' step)
    extended[:, :size, :size], extended[:, :size, size : size + forces] = drift, acceleration
    extended[:, size : size + forces, size + forces :] = np.eye(forces) / step
    halvings = _halvings(rate, step)
    exponential = _taylor(extended * (step / 2.0**halvings))
    for _ in range(halvings):
        exponential = exponential @ exponential
    constant, growing = exponential[:, :size, size : size + forces], exponential[:, :size, size + forces :]
    return np.stack([constant, 2.0 * growing - constant])


def _drift(bodies: np.ndarray) -> np.ndarray:
    """Matrix M of (x, v)' = M (x, v) of bodies (mass, damping, stiffness), (n, 2, 2)."""
    m, c, k = bodies.T
    drift = np.zeros((len(bodies), 2, 2))
    drift[:, 0, 1] = 1.0
    drift[:, 1, 0] = -k / m
    drift[:, 1, 1] = -c / m
    return drift


def drift_matrix(mass: np.ndarray, damping: np.ndarray, stiffness: np.ndarray) -> np.ndarray:
    """Return the matrix L of ``(x, v)' = L (x, v)`` of bodies that springs and dampers connect, (2 n, 2 n)."""
    none, inverse = np.zeros_like(stiffness), 1.0 / mass[:, None]
    return np.block([[none, np.eye(len(mass))], [-inverse * stiffness, -inverse * damping]])


def diffusion_matrix(mass: np.ndarray, intensity: np.ndarray) -> np.ndarray:
    """Return the growth of the covariance of (x, v) per time by white noise, (2 n, 2 n); see `system_transition`."""
    none = np.zeros_like(intensity)
    return np.block([[none, none], [none, 2.0 * np.pi * intensity / np.outer(mass, mass)]])


def with_delayed_response(drift: np.ndarray, count: int) -> np.ndarray:
    """Return the drift of `count` states of a filter and of bodies, and of ``∫ q Φ(q) f`` as further states.

    Φ is the flow of the bodies, f what drives them, and q the time from then to the end: with the response
    ``∫ Φ(q) f`` of bodies that begin at rest it gives that to f times a factor that is linear in time.
    """
    size, bodies = len(drift), len(drift) - count
    result = np.zeros((size + bodies, size + bodies))
    result[:size, :size], result[size:, size:] = drift, drift[count:, count:]
    result[size:, count:size] = np.eye(bodies)
    return result


def van_loan(drift: np.ndarray, growth: np.ndarray) -> np.ndarray:
    """Return Van Loan's block matrix, whose exponential has the transition and the covariance of a motion."""
    size = drift.shape[-1]
    result = np.zeros((*drift.shape[:-2], 2 * size, 2 * size))
    result[..., :size, :size], result[..., :size, size:] = -drift, growth
    result[..., size:, size:] = np.swapaxes(drift, -1, -2)
    return result


def _rate(bodies: np.ndarray) -> float:
    """Bound of the eigenvalues of the motion of bodies (mass, damping, stiffness)."""
    m, c, k = bodies.T
    return float(np.max(np.sqrt(k / m) + c / m, initial=0.0))


def _halvings(rate: float, step: float) -> int:
    """How often to halve a step until it is short at some rate."""
    return max(0, int(np.ceil(np.log2(max(step * rate, 1e-300)))))


def _taylor(matrices: np.ndarray) -> np.ndarray:
    """Exponential of matrices whose eigenvalues are at most 1: 20 terms reach the last bit.

    Scaled units would only scale the entries, so large ones (k/m) do no harm.
    """
    term, product = np.zeros(matrices.shape), np.empty(matrices.shape)
    term[..., range(matrices.shape[-1]), range(matrices.shape[-1])] = 1.0
    total = term.copy()
    for order in range(1, 21):
        np.matmul(term, matrices, out=product)
        np.divide(product, order, out=term)
        total += term
    return total


@remembered
def noise_columns(q: np.ndarray) -> np.ndarray:
    """Return the Cholesky factor of covariances, column by column, (2, n, 2).

    Column k is what the k-th normal of a body adds to displacement and velocity. Where Q
    has rank one the second column is 0.
    """
    l_xx = np.sqrt(np.maximum(q[:, 0, 0], 0.0))
    l_vx = np.divide(q[:, 0, 1], l_xx, out=np.zeros_like(l_xx), where=l_xx > 0.0)
    rest = np.maximum(q[:, 1, 1] - l_vx**2, 0.0)
    singular = (rest <= 1e-12 * q[:, 1, 1]) | (l_xx == 0.0)
    l_vx = np.where(singular, np.copysign(np.sqrt(q[:, 1, 1]), q[:, 0, 1]), l_vx)
    l_vv = np.where(singular, 0.0, np.sqrt(rest))
    return np.stack([np.column_stack([l_xx, l_vx]), np.column_stack([np.zeros_like(l_vv), l_vv])])


def lower_root(q: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Return the lower triangular root of a covariance, with 0 where its rank is exhausted to a part of `size`."""
    rest, root = q.copy(), np.zeros_like(q)
    for column in range(len(q)):
        # a smaller part of a variance that remains is rounding
        if rest[column, column] > 1e-12 * size[column]:
            root[column:, column] = rest[column:, column] / math.sqrt(rest[column, column])
            rest -= np.outer(root[:, column], root[:, column])
    return root


def noise_root(q: np.ndarray) -> np.ndarray:
    """Return the symmetric root of a covariance, scaled to that of its correlations; there is only one."""
    scale = np.sqrt(np.diag(q))
    inverse = np.divide(1.0, scale, out=np.zeros_like(scale), where=scale > 0.0)
    squares, directions = np.linalg.eigh(inverse[:, None] * q * inverse)
    root: np.ndarray = scale[:, None] * (directions * np.sqrt(np.maximum(squares, 0.0))) @ directions.T
    return root
