"""How long the intervals are that realizations may cover in one transition, and the tables for it."""

from __future__ import annotations

import functools
from statistics import NormalDist

import numpy as np

from impactlab.assembly.mechanism import Mode, refusing
from impactlab.assembly.model import Model
from impactlab.assembly.remembered import remembered
from impactlab.integrators.base import Integrator
from impactlab.integrators.exact_flow import ExactFlow
from impactlab.integrators.interval_arguments import IntervalNoise, Jumps
from impactlab.kernels.random import addresses
from impactlab.linear.laws import NEVER
from impactlab.linear.transitions import transitions
from impactlab.machine import Tuning

LEAF, LONGEST = 8, 256
"""Steps of the shortest interval, and of the longest one at most."""

JUMP_LANES = 4 * Tuning.lanes
"""Lanes of a block that skips intervals: many, since few of them are near contact at a time."""

JUMP_STATES = 4 * JUMP_LANES
"""Upper bound of lanes times bodies, for more lanes than the fewest of any block."""

MOST_CONTACTS = 1000
"""Number of contacts from which at least one contact is nearly always near closing."""

OPERATION = 1000.0
"""Cost of an operation at any number of lanes (ns); costs of bodies and contacts are below."""

SAMPLES, SEARCHES, GAIN = 512, 20_000, 1.3
"""States sampled to foresee the work, the largest number of states times contacts, and the least gain in work."""


def sampled_will_do(model: Model, integrator: Integrator, every_step: bool) -> bool:
    """Whether statistics may be estimated from samples: the motion is stationary, and no force varies in time.

    Features that need `every_step` exclude samples.
    """
    exact = isinstance(integrator, ExactFlow) and integrator.crosses and not every_step
    return exact and not refusing(model, Mode.SAMPLES)


def refusal_of_intervals(model: Model) -> str:
    """Return why a network wants every step, so that no contact-free interval is crossed at once; nothing else."""
    reasons = [item.name for item in refusing(model, Mode.INTERVALS)]
    return ", ".join([*reasons, *[f"more than {MOST_CONTACTS} contacts"] * (len(model.ends) > MOST_CONTACTS)])


def jump_lanes(bodies: int) -> int:
    """Return the largest number of realizations in a block of so many bodies that jumps."""
    return min(JUMP_LANES, max(Tuning.fewest_lanes, JUMP_STATES // bodies))


def foreseen_levels(model: Model, step: float, deviations: np.ndarray, window: np.ndarray, realizations: int) -> int:
    """Return how often the longest interval should be halved, 0 if jumps would not save work, or may not be made.

    They may where nothing but contacts acts on bodies that move each by itself, under their own noise. Without contacts
    states are normal; how often bounds hold for them tells the work.
    """
    if not len(model.ends) or refusal_of_intervals(model) or not (deviations > 0.0).all():
        return 0
    lanes, bodies, contacts = min(realizations, jump_lanes(len(model.mass))), len(model.mass), len(model.ends)
    samples = min(SAMPLES, SEARCHES // contacts)
    single = 0.5 * OPERATION + 3.5 * lanes * bodies  # work of a step that is taken by itself
    inside = 0.0  # and of one within an interval, at the levels that were looked at
    best, foreseen = GAIN, 0
    for level in range((LONGEST // LEAF).bit_length()):
        steps = LEAF << level
        nearest, farthest = _foreseen(*_motion(model, step, steps), model.ends.pairs, deviations, samples)
        near = float((nearest > (model.clearance - window)[:, None]).any(axis=0).mean())
        if level == 0:
            inside += _some(near, lanes) * 0.7 * OPERATION + near * lanes * 7.0 * bodies
        else:
            each = _some(near, lanes) * 4.0 * OPERATION
            inside += (each + near * lanes * (20.0 * bodies + 0.7 * steps * contacts)) / steps
        if single <= best * inside:  # nor can longer intervals save more
            break
        if level == 0:
            continue
        flagged = (farthest > (model.clearance - window)[:, None]).any(axis=0).mean()
        work = OPERATION + lanes * (5.0 * bodies + contacts) + steps * inside
        work += _some(flagged, lanes) * OPERATION + flagged * lanes * (12.0 * bodies + 0.7 * steps * contacts)
        gain = steps * single / work
        if gain > best:
            best, foreseen = gain, level
    return foreseen


@remembered
def _foreseen(
    a_of: np.ndarray, q_of: np.ndarray, pairs: np.ndarray, deviations: np.ndarray, samples: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return how near gaps come to a contact at clearance 0 in an interval, and a bound of it, (contact, sample) each.

    Flows and covariances are as `_motion` returns them.
    """
    steps, z = len(a_of) - 1, _normals(deviations.shape[1] + 1, samples)
    path, scatter = _bridge(a_of, q_of, pairs, steps)
    stray, draw = _sigmas(len(pairs), steps) * scatter, _cholesky(q_of[steps])
    reach = _reach(path, draw, deviations)[:, None]
    size = np.append(reach * np.sqrt((z[:-1] ** 2).sum(axis=1)), np.zeros((1, samples)), axis=0)
    path = np.concatenate([path, np.zeros((steps, 1, 4))], axis=1)
    state = z.copy()
    state[:-1, :2] *= deviations.T[..., None]
    state[:-1, 2] = draw[:, :1] * z[:-1, 2]
    state[:-1, 3] = draw[:, 1:2] * z[:-1, 2] + draw[:, 2:] * z[:-1, 3]
    state[-1] = 0.0
    nearest = np.empty((len(pairs), samples))
    for row, (first, second) in enumerate(pairs):
        # not by BLAS, whose threads would take longer to wake up than this takes
        gap = np.einsum("sc,cn->sn", path[:, first], state[first])
        gap -= np.einsum("sc,cn->sn", path[:, second], state[second])
        nearest[row] = (gap + stray[:, row, None]).max(axis=0)
    return nearest, size[pairs].sum(axis=1) + stray.max(axis=0)[:, None]


@functools.lru_cache(maxsize=4)
def _normals(bodies: int, samples: int) -> np.ndarray:
    """Return the normal numbers that states are made of, (body, 4, sample)."""
    result = np.random.default_rng(2023).standard_normal((bodies, 4, samples))
    result.setflags(write=False)
    return result


def _some(share: float, lanes: int) -> float:
    """Probability that an event of some probability happens in one lane at least."""
    return float(1.0 - (1.0 - share) ** lanes)


def jump_tables(
    model: Model,
    step: float,
    leaf: int,
    levels: int,
    deviations: np.ndarray,
    window: np.ndarray,
    seed: tuple[int, int] = (0, 0),
) -> Jumps:
    """Return the tables for intervals of ``leaf 2^levels`` steps and their halves.

    The deviations are the usual size of displacements and velocities, (2, body) (m, m s-1), and the window is how near
    to contact a gap must be for statistics to look at it, (contact,) (m).
    """
    bodies, noisy = len(model.mass), model.noise.intensity > 0.0
    a_of, q_of = _motion(model, step, leaf << levels)
    sigmas = _sigmas(len(model.ends), leaf << levels)
    gain, rest = np.zeros((2, levels + 1, bodies, 2, 2))
    path, limit = [], []
    for level in range(levels + 1):
        steps = leaf << level
        if level:
            half, inverse = steps // 2, _inverse(q_of[steps])
            gain[level] = q_of[half] @ a_of[half].transpose(0, 2, 1) @ inverse
            rest[level] = q_of[half] - gain[level] @ a_of[half] @ q_of[half]
        own_path, scatter = _bridge(a_of, q_of, model.ends.pairs, steps)
        path.append(own_path)
        limit.append(model.clearance - window - sigmas * scatter)
    factors = _cholesky(q_of[-1])
    reach = np.concatenate([1.0 / deviations, [_reach(path[-1], factors, deviations)]]).T
    names = [name for name, some in zip(model.bodies.names, noisy, strict=True) if some]
    inside = np.arange(leaf)
    terms = q_of[1][None] @ a_of[leaf - 1 - inside].swapaxes(-1, -2)
    return Jumps(
        leaf=leaf,
        levels=levels,
        transition=_rows(a_of[leaf << np.arange(levels + 1)]),
        noise=IntervalNoise(
            draw=factors,
            gain=_rows(gain),
            rest=np.stack([_cholesky(item) for item in rest]),
            inverse=np.ascontiguousarray(_inverse(q_of[leaf]).reshape(-1, 4)[:, [0, 1, 3]]),
            terms=_rows(terms),
            rows=np.where(noisy, np.cumsum(noisy) - 1, -1),
            draws=addresses(seed, names, "jump"),
            halves=addresses(seed, names, "half"),
        ),
        path=np.concatenate([np.concatenate(path), np.zeros((sum(map(len, path)), 1, 4))], axis=1),
        limit=np.ascontiguousarray(np.concatenate(limit)),
        reach=np.ascontiguousarray(np.concatenate([reach, [[0.0, 0.0, 0.0]]])),
        nearest=limit[-1].min(axis=0),
    )


def _motion(model: Model, step: float, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Return flows and covariances of the motion of bodies over 0 to a number of steps, (steps, body, 2, 2) each."""
    linear = model.mass, model.damping, model.stiffness, model.noise.intensity
    return _repeated(*transitions(*linear, [step, 0.5 * step])[0], number)  # both, as the flow of a step has them


@remembered
def _repeated(a: np.ndarray, q: np.ndarray, number: int) -> tuple[np.ndarray, np.ndarray]:
    flows, growth = [np.broadcast_to(np.eye(2), a.shape)], [np.zeros_like(q)]
    for _ in range(number):
        flows.append(a @ flows[-1])
        growth.append(a @ growth[-1] @ a.transpose(0, 2, 1) + q)
    return np.array(flows), np.array(growth)


def _sigmas(contacts: int, steps: int) -> float:
    """Return the standard deviations from a mean path of some steps beyond which nothing is expected."""
    return -NormalDist().inv_cdf(NEVER / (steps * max(1, contacts)))


@remembered
def _bridge(a_of: np.ndarray, q_of: np.ndarray, pairs: np.ndarray, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean path between two ends, by the state at the first and noise, and how far gaps stray from it.

    They are (step, body, 4) and (step, contact); flows and covariances are as `_motion` returns them.
    """
    inside = np.arange(1, steps + 1)
    by_noise = q_of[inside] @ a_of[steps - inside].swapaxes(-1, -2) @ _inverse(q_of[steps])
    around = q_of[inside] - by_noise @ a_of[steps - inside] @ q_of[inside]
    path = np.concatenate([a_of[inside, :, 0], by_noise[:, :, 0]], axis=-1)
    variance = np.concatenate([np.maximum(around[:, :, 0, 0], 0.0), np.zeros((steps, 1))], axis=1)
    return path, np.sqrt(variance[:, pairs].sum(axis=-1))


def _reach(path: np.ndarray, factors: np.ndarray, deviations: np.ndarray) -> np.ndarray:
    """Return the largest standard deviation of each body along its mean path, (body,)."""
    by_x, by_v = path[..., 2], path[..., 3]
    by_normals = np.stack([by_x * factors[:, 0] + by_v * factors[:, 1], by_v * factors[:, 2]], axis=-1)
    most = np.concatenate([path[..., :2] * deviations.T, by_normals], axis=-1)
    return np.asarray(np.sqrt((most**2).sum(axis=-1)).max(axis=0))


def _rows(matrices: np.ndarray) -> np.ndarray:
    """Write (…, 2, 2) as (…, 4)."""
    return np.ascontiguousarray(matrices.reshape(*matrices.shape[:-2], 4))


def _inverse(q: np.ndarray) -> np.ndarray:
    """Inverse of covariances, 0 for covariances that are 0, (body, 2, 2)."""
    xx, xv, vv = q[:, 0, 0], q[:, 0, 1], q[:, 1, 1]
    some = vv > 0.0
    adjugate = np.stack([vv, -xv, -xv, xx], axis=1).reshape(q.shape)
    result = np.zeros_like(q)
    result[some] = adjugate[some] / (xx * vv - xv**2)[some, None, None]
    return result


def _cholesky(q: np.ndarray) -> np.ndarray:
    """Return l_xx, l_vx, l_vv of covariances, (body, 3)."""
    l_xx = np.sqrt(np.maximum(q[:, 0, 0], 0.0))
    l_vx = np.divide(q[:, 0, 1], l_xx, out=np.zeros_like(l_xx), where=l_xx > 0.0)
    return np.stack([l_xx, l_vx, np.sqrt(np.maximum(q[:, 1, 1] - l_vx**2, 0.0))], axis=1)
