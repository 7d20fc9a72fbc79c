"""The exact flow of linear bodies between kicks, with and without noise."""

from __future__ import annotations

import numpy as np

from impactlab.kernels.jit import kernel

COEFFICIENTS = 7
"""Columns of a flow: a_xx, a_xv, a_vx, a_vv of the transition, l_xx, l_vx, l_vv of the noise."""


def transition(
    mass: np.ndarray, damping: np.ndarray, stiffness: np.ndarray, intensity: np.ndarray, step: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the exact Gaussian transition of linear bodies over a step.

    The state (x, v) of ``m x'' + c x' + k x = f`` with white noise f of two-sided density
    S becomes ``A (x, v)`` plus a normal vector of covariance Q, ``A = exp(h M)``. A and Q come
    from Van Loan's block exponential (IEEE Trans. Autom. Control 23, 1978, 395), so that
    free and undamped bodies need no case of their own; long steps by doubling,
    ``Q(2h) = Q + A Q Aᵀ``, which has no cancellation.

    Parameters
    ----------
    mass, damping, stiffness : (n,) ndarray
        Bodies (kg, N s m-1, N m-1).
    intensity : (n,) ndarray
        Two-sided spectral density S of the force (N2 s rad-1).
    step : float
        Step h (s).

    Returns
    -------
    A, Q : (n, 2, 2) ndarray
    """
    bodies = np.stack([mass, damping, stiffness], axis=1)
    unique, which = np.unique(bodies, axis=0, return_inverse=True)
    which = which.reshape(-1)
    drift = _drift(unique)
    halvings = _halvings(unique, step)
    unit = np.zeros_like(drift)
    unit[:, 1, 1] = 1.0  # the covariance is proportional to the intensity
    block = np.block([[-drift, unit], [np.zeros_like(drift), drift.transpose(0, 2, 1)]])
    exponential = _taylor(block * (step / 2.0**halvings))
    a = exponential[:, 2:, 2:].transpose(0, 2, 1)
    q = a @ exponential[:, :2, 2:]
    for _ in range(halvings):
        q = q + a @ q @ a.transpose(0, 2, 1)
        a = a @ a
    q = 0.5 * (q + q.transpose(0, 2, 1))
    return a[which], q[which] * (2.0 * np.pi * intensity / mass**2)[:, None, None]


def response_to_force(mass: np.ndarray, damping: np.ndarray, stiffness: np.ndarray, step: float) -> np.ndarray:
    """Return displacement and velocity after a step from rest under a unit force, (n, 2) (m, m s-1)."""
    bodies = np.stack([mass, damping, stiffness], axis=1)
    extended = np.zeros((len(bodies), 3, 3))  # the state (x, v, f) with a constant force f
    extended[:, :2, :2] = _drift(bodies)
    extended[:, 1, 2] = 1.0 / mass
    halvings = _halvings(bodies, step)
    exponential = _taylor(extended * (step / 2.0**halvings))
    for _ in range(halvings):
        exponential = exponential @ exponential
    return exponential[:, :2, 2]


def _drift(bodies: np.ndarray) -> np.ndarray:
    """Matrix M of (x, v)' = M (x, v) of bodies (mass, damping, stiffness), (n, 2, 2)."""
    m, c, k = bodies.T
    drift = np.zeros((len(bodies), 2, 2))
    drift[:, 0, 1] = 1.0
    drift[:, 1, 0] = -k / m
    drift[:, 1, 1] = -c / m
    return drift


def _halvings(bodies: np.ndarray, step: float) -> int:
    """How often to halve a step until it is short for every body."""
    m, c, k = bodies.T
    rate = float(np.max(np.sqrt(k / m) + c / m, initial=0.0))
    return max(0, int(np.ceil(np.log2(max(step * rate, 1e-300)))))


def _taylor(matrices: np.ndarray) -> np.ndarray:
    """Exponential of matrices whose eigenvalues are at most 1: 20 terms reach the last bit.

    Scaled units would only scale the entries, so large ones (k/m) do no harm.
    """
    term = np.broadcast_to(np.eye(matrices.shape[-1]), matrices.shape)
    total = term.copy()
    for order in range(1, 21):
        term = term @ matrices / order
        total += term
    return total


def flow_coefficients(a: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return the columns that `flow` takes, (n, 7): A and the Cholesky factor of Q."""
    l_xx = np.sqrt(np.maximum(q[:, 0, 0], 0.0))
    l_vx = np.divide(q[:, 0, 1], l_xx, out=np.zeros_like(l_xx), where=l_xx > 0.0)
    l_vv = np.sqrt(np.maximum(q[:, 1, 1] - l_vx**2, 0.0))
    return np.ascontiguousarray(np.column_stack([a.reshape(-1, 4), l_xx, l_vx, l_vv]))


@kernel
def flow(coefficients, rows, scale, sample, normals, column, x, v):  # type: ignore[no-untyped-def]
    """Carry all bodies over one step.

    Parameters
    ----------
    coefficients : (body, 7) ndarray
        The flow.
    rows : (body,) ndarray of int
        Row of each body's noise, -1 for a body without.
    scale : (time, row) ndarray
        Amplitude of the noise relative to the coefficients'.
    sample : int
        Row of `scale` that belongs to the step.
    normals : (row, 4, lane) ndarray
        Standard normals.
    column : int
        First of the two columns of `normals` to be used.
    x, v : [body, lane]
        State.
    """
    for body in range(rows.shape[0]):
        a_xx, a_xv = coefficients[body, 0], coefficients[body, 1]
        a_vx, a_vv = coefficients[body, 2], coefficients[body, 3]
        row = rows[body]
        if row < 0:
            for lane in range(x.shape[1]):
                displacement, velocity = x[body, lane], v[body, lane]
                x[body, lane] = a_xx * displacement + a_xv * velocity
                v[body, lane] = a_vx * displacement + a_vv * velocity
        else:
            l_xx = scale[sample, row] * coefficients[body, 4]
            l_vx = scale[sample, row] * coefficients[body, 5]
            l_vv = scale[sample, row] * coefficients[body, 6]
            for lane in range(x.shape[1]):
                displacement, velocity = x[body, lane], v[body, lane]
                z = normals[row, column, lane]
                x[body, lane] = a_xx * displacement + a_xv * velocity + l_xx * z
                noise = l_vx * z + l_vv * normals[row, column + 1, lane]
                v[body, lane] = a_vx * displacement + a_vv * velocity + noise
