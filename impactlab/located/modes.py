"""Pieces: the modes of the linear motion while some contacts are closed, and gaps and forces in these."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from impactlab.errors import InvalidInput
from impactlab.kernels.contact_states import (
    CLOSED,
    HELD,
    JENKINS,
    OPEN,
    RIGID,
    SLIPS_DOWN,
    SLIPS_UP,
    STICKS,
)
from impactlab.kernels.pieces import (
    AMPLITUDE,
    FREE,
    GENERAL,
    LEVELS,
    LIMITS,
    NATURAL,
    PAIR,
    SWINGING,
    WEIGHTS,
    G,
    Pieces,
)
from impactlab.located.frictions import write_holding, write_slip_and_stick
from impactlab.located.scenes import Linear
from impactlab.located.sliders import held_directions, let_slip, with_sliders

RESONANT = 1e-6
"""Part of its own stiffness below which the dynamic stiffness of a mode at the frequency of a wave is a resonance."""

CRITICAL = 1e-4
"""The same of the square of the frequency of a damped mode below which it is close to critical damping."""

COUPLED = 1e-14
"""Part of the largest damping up to which damping between modes is rounding."""

Array = np.ndarray


class Motions(NamedTuple):
    """The linear motion of some lanes in pairs, (lane, …) each; see `impactlab.kernels.pieces`."""

    pairs: Array  # (lane, pair, PAIR)
    into: Array  # (lane, 2 pair, 2 body)
    outof: Array  # (lane, 2 body, 2 pair)
    offset: Array  # (lane, 2 body)
    waves: Array  # (lane, 2 body, wave), complex


def pieces_of(scene: Linear, lanes: Array, status: Array) -> Pieces:
    """Return the pieces of some lanes while their contacts have the given states, one row for each lane."""
    bodies, contacts, waves = scene.shape
    slides, sticks = scene.kinds == JENKINS, status == STICKS
    closed, held = (status == CLOSED) | (slides & sticks), (status == HELD) | sticks | slides
    slips = np.where(status == SLIPS_UP, 1.0, 0.0) - (status == SLIPS_DOWN)
    k, c = (item[lanes] * closed for item in (scene.springs, scene.dampers))
    w, gap, wall, frequency = (item[lanes] for item in (scene.links, scene.gap, scene.wall, scene.frequencies))
    springs, directions = with_sliders(scene, w), held_directions(scene, w)
    stiffness = scene.stiffness[lanes] + np.einsum("lk,lki,lkj->lij", k, springs, springs)
    damping = scene.damping[lanes] + np.einsum("lk,lki,lkj->lij", c, w, w)
    load = scene.load[lanes] - np.einsum("lki,lk->li", springs, k * gap)
    load -= np.einsum("lki,lk->li", w, slips * scene.frictions[lanes, :, 0])
    turning = k[:, :, None] + 1j * frequency[:, None, :] * c[:, :, None]
    force = scene.force[lanes] - np.einsum("lki,lkw->liw", springs, turning * wall)
    mass = scene.mass[lanes]
    loads = scene.loads[lanes]
    system = _System(mass, damping, stiffness, load, force, frequency, loads)
    motions, react, moved = system.motions(), None, loads / mass[:, :, None]
    if held.any():
        motions, react, moved = system.held(
            directions[:, held], (gap * ~slides)[:, held], (wall * ~slides[:, None])[:, held], sticks[held]
        )
        let_slip(scene, lanes, status, (motions.into, motions.outof, motions.offset, motions.waves))
    # functionals: gaps at even places, forces at odd ones
    rows = np.zeros((len(lanes), 2 * contacts, 2 * bodies))
    direct = np.zeros((len(lanes), 2 * contacts, loads.shape[2]))
    constants, swings = np.zeros((len(lanes), 2 * contacts)), np.zeros((len(lanes), 2 * contacts, waves), complex)
    rows[:, 0::2, :bodies], constants[:, 0::2], swings[:, 0::2] = w, gap, wall
    soft = (scene.kinds != RIGID) & (status != OPEN)
    k, c = (item[lanes] * soft for item in (scene.springs, scene.dampers))
    rows[:, 1::2, :bodies], rows[:, 1::2, bodies:] = k[:, :, None] * w, c[:, :, None] * w
    constants[:, 1::2] = k * gap
    swings[:, 1::2] = (k[:, :, None] + 1j * frequency[:, None, :] * c[:, :, None]) * wall
    if react is not None:
        places = 2 * np.flatnonzero(held) + 1
        rows[:, places], constants[:, places], swings[:, places], direct[:, places] = react
    write_slip_and_stick(scene, lanes, status, (rows, constants, swings, direct))
    drives = motions.into[:, :, bodies:] @ moved
    functionals = rows, constants, swings, direct
    pieces = _with_functionals(motions, functionals, drives, frequency, status, scene.points[lanes])
    if slips.any():
        write_holding(scene, lanes, slips, directions[:, held], pieces)
    return pieces


def _with_functionals(
    motions: Motions, functionals: tuple[Array, Array, Array, Array], drives: Array, frequency: Array, status: Array,
    points: Array,
) -> Pieces:  # fmt: skip
    rows, constants, swings, first = functionals
    pairs, into, outof, offset, waves = motions
    lanes, bodies, count = len(rows), rows.shape[2] // 2, pairs.shape[1]
    g, kappa, root, push, kind, _ = (pairs[:, None, :, column] for column in range(PAIR))
    in_pairs = rows @ outof
    of_a, of_b = in_pairs[:, :, 0::2], in_pairs[:, :, 1::2]
    constant = constants + np.einsum("lfe,le->lf", rows, offset)
    weights = np.zeros((lanes, rows.shape[1], count, WEIGHTS))
    levels = np.zeros((lanes, rows.shape[1], LEVELS))
    direct = np.zeros((lanes, rows.shape[1], drives.shape[2], LEVELS + 1))
    direct[..., 0] = first
    swinging = kind == SWINGING
    weights[..., AMPLITUDE] = np.where(swinging, np.hypot(of_a - g * of_b, root * of_b), 0.0)
    for level in range(LEVELS):
        weights[..., 2 * level], weights[..., 2 * level + 1] = of_a, of_b
        levels[..., level] = constant
        constant = (of_b * push).sum(axis=-1)
        direct[..., level + 1] = of_a @ drives[:, 0::2] + of_b @ drives[:, 1::2]
        of_a, of_b = -kappa * of_b, of_a - 2.0 * g * of_b
    amplitude = swings + rows @ waves
    powers = frequency[:, None, None, :] ** np.arange(2, 2 + LIMITS)[:, None]
    limits = (np.abs(amplitude)[:, :, None, :] * powers).sum(axis=-1)
    rates = np.maximum(pairs[..., NATURAL], 2.0 * pairs[..., G])
    fastest = np.maximum(rates.max(axis=1, initial=0.0), frequency.max(axis=1, initial=0.0))
    room = bodies - count
    plain = ~(outof[:, :bodies, 1::2].any(axis=(1, 2)) | outof[:, bodies:, 0::2].any(axis=(1, 2)))
    outof, offset, waves = (
        np.concatenate([item, points @ item[:, :bodies], points @ item[:, bodies:]], axis=1)
        for item in (outof, offset[:, :, None], waves)
    )
    return Pieces(
        np.repeat(status[None], lanes, axis=0),
        np.full(lanes, count),
        np.pad(pairs, ((0, 0), (0, room), (0, 0))),
        np.pad(into, ((0, 0), (0, 2 * room), (0, 0))).transpose(0, 2, 1),
        offset[:, :, 0],
        parts(waves),
        np.pad(outof, ((0, 0), (0, 0), (0, 2 * room))).transpose(0, 2, 1),
        np.pad(weights, ((0, 0), (0, 0), (0, room), (0, 0))).reshape(lanes, rows.shape[1], bodies * WEIGHTS),
        levels,
        parts(amplitude),
        limits,
        fastest,
        np.asarray(plain, np.int64),
        np.pad(drives, ((0, 0), (0, 2 * room), (0, 0))),
        direct.reshape(lanes, rows.shape[1], drives.shape[2] * (LEVELS + 1)),
    )


def parts(waves: Array) -> Array:
    """Return real and imaginary parts in turn, on the last axis."""
    return np.stack([waves.real, waves.imag], axis=-1).reshape(*waves.shape[:-1], 2 * waves.shape[-1])


class _System(NamedTuple):
    """Linear motion under a constant load and waves, lane by lane."""

    mass: Array
    damping: Array
    stiffness: Array
    load: Array
    force: Array
    frequency: Array
    loads: Array

    def motions(self) -> Motions:
        """Return the motion of all coordinates."""
        lanes, bodies = self.mass.shape
        basis = np.zeros((lanes, bodies, bodies))
        basis[:, range(bodies), range(bodies)] = self.mass**-0.5
        return self._in(basis, np.zeros((lanes, bodies)), np.zeros((lanes, bodies, self.frequency.shape[1]), complex))

    def held(
        self, links: Array, gap: Array, wall: Array, moving: Array
    ) -> tuple[Motions, tuple[Array, Array, Array, Array], Array]:
        """Return the motion while some gaps stay 0, the forces that hold them as functionals, and accelerations.

        The latter are by the given functions, (lane, body, source).

        Gaps that are `moving` keep their velocity: each direction that these add is a pair of its own.
        """
        root = self.mass**-0.5
        scaled = links * root[:, None, :]
        _, sizes, directions = np.linalg.svd(scaled, full_matrices=True)
        ranks = (sizes > 1e-12 * sizes[:, :1]).sum(axis=1)
        rank = int(ranks[0])
        if (ranks != rank).any():
            raise InvalidInput("Lanes of one call have contacts at rest of different numbers of directions.")
        basis = root[:, :, None] * directions[:, rank:].transpose(0, 2, 1)
        inverse = np.linalg.pinv(scaled, rcond=1e-12)
        fixed = np.linalg.pinv(scaled[:, ~moving], rcond=1e-12)
        center = -root * np.einsum("lik,lk->li", fixed, gap[:, ~moving])
        moved = -root[:, :, None] * (inverse @ wall)
        motions = self._in(basis, center, moved)
        if moving.any():
            along = directions[:, :rank]
            _, sizes, turned = np.linalg.svd(along - along @ (fixed @ scaled[:, ~moving]))
            count = int((sizes[0] > 0.5).sum())
            motions = self._with_drift(motions, basis, root[:, :, None] * turned[:, :count].transpose(0, 2, 1))
        # W M^-1 (f − C v − K x − Wᵀ λ) = −(gap of the walls)''
        back = inverse.transpose(0, 2, 1) * root[:, None, :]  # (W M^-1 Wᵀ)^-1 W M^-1
        gram = np.linalg.pinv(scaled @ scaled.transpose(0, 2, 1), rcond=1e-12)
        rows = -np.concatenate([back @ self.stiffness, back @ self.damping], axis=2)
        constants = np.einsum("lki,li->lk", back, self.load)
        swings = back @ self.force - self.frequency[:, None, :] ** 2 * (gram @ wall)
        moves = basis @ (basis.transpose(0, 2, 1) @ self.loads)
        return motions, (rows, constants, swings, back @ self.loads), moves

    def _with_drift(self, motions: Motions, basis: Array, drift: Array) -> Motions:
        """Return a motion with that in directions whose velocities are constant, and which take the others along.

        For ``x = b y + d z`` with ``z'' = 0`` the others follow as ``y = y₀ + P z + Q z'``, with y₀ as without z.
        """
        lanes, bodies, count = drift.shape
        outof, into = np.zeros((lanes, 2 * bodies, 2 * count)), np.zeros((lanes, 2 * count, 2 * bodies))
        for lane in range(lanes):
            p, q = _followed(self.stiffness[lane], self.damping[lane], basis[lane], drift[lane])
            outof[lane, :bodies, 0::2] = outof[lane, bodies:, 1::2] = drift[lane] + basis[lane] @ p
            outof[lane, :bodies, 1::2] = basis[lane] @ q
        across = drift.transpose(0, 2, 1) * self.mass[:, None, :]
        into[:, 0::2, :bodies] = into[:, 1::2, bodies:] = across
        still = np.zeros(drift.shape[::2])
        pairs = np.concatenate([motions.pairs, _pairs(still, still, still)], axis=1)
        others = motions.into - (motions.into @ outof) @ into
        return motions._replace(
            pairs=pairs,
            into=np.concatenate([others, into], axis=1),
            outof=np.concatenate([motions.outof, outof], axis=2),
        )

    def _in(self, basis: Array, center: Array, moved: Array) -> Motions:
        """Return the motion about a moving center, in coordinates of unit mass."""
        lanes, bodies = self.mass.shape
        count, across = basis.shape[2], basis.transpose(0, 2, 1)
        kappa, turned = np.linalg.eigh(across @ self.stiffness @ basis)
        shapes = basis @ turned
        across = shapes.transpose(0, 2, 1)
        size = np.einsum("lik,lij,ljk->lk", np.abs(shapes), np.abs(self.stiffness), np.abs(shapes))
        kappa = np.where(np.abs(kappa) <= 4.0 * bodies * np.finfo(float).eps * size, 0.0, kappa)
        if (kappa < 0.0).any():
            raise InvalidInput("EventLocated knows no springs that push away; use il.ExactFlow().")
        damping = across @ self.damping @ shapes
        load = np.einsum("lki,li->lk", across, self.load - np.einsum("lij,lj->li", self.stiffness, center))
        dynamic = (
            self.stiffness[..., None]
            + 1j * self.frequency[:, None, None, :] * self.damping[..., None]
            - self.frequency[:, None, None, :] ** 2 * np.eye(bodies)[..., None] * self.mass[:, :, None, None]
        )
        force = across @ (self.force - np.einsum("lijw,ljw->liw", dynamic, moved))
        g = 0.5 * np.diagonal(damping, axis1=1, axis2=2)
        off = np.abs(damping - 2.0 * g[:, :, None] * np.eye(count))
        mixed = off.max(axis=(1, 2), initial=0.0) > COUPLED * np.abs(damping).max(axis=(1, 2), initial=0.0)
        response = self._responses(kappa, g, force, ~mixed)
        pairs = _pairs(g, kappa, load)
        outof, into = np.zeros((lanes, 2 * bodies, 2 * count)), np.zeros((lanes, 2 * count, 2 * bodies))
        outof[:, :bodies, 0::2] = outof[:, bodies:, 1::2] = shapes
        weighed = across * self.mass[:, None, :]
        into[:, 0::2, :bodies] = into[:, 1::2, bodies:] = weighed
        offset = np.concatenate([center, np.zeros_like(center)], axis=1)
        for lane in np.flatnonzero(mixed):
            of_lane = _complex(kappa[lane], damping[lane], load[lane], force[lane], self.frequency[lane])
            pairs[lane], turned, back, shift, response[lane] = of_lane
            plain = outof[lane].copy(), into[lane].copy()
            order = np.concatenate([np.arange(0, 2 * count, 2), np.arange(1, 2 * count, 2)])
            outof[lane] = plain[0][:, order] @ turned
            into[lane] = back @ plain[1][order]
            offset[lane] += plain[0][:, order] @ shift
        place = shapes @ response + moved
        waves = np.concatenate([place, 1j * self.frequency[:, None, :] * place], axis=1)
        return Motions(pairs, into, outof, offset, waves)

    def _responses(self, kappa: Array, g: Array, force: Array, chosen: Array) -> Array:
        """Return the amplitudes of real modes under waves; refuse those in resonance without damping."""
        omega = self.frequency[:, None, :]
        dynamic = kappa[..., None] - omega**2 + 2j * omega * g[..., None]
        resonant = np.abs(dynamic) <= RESONANT * omega**2
        if (resonant & (force != 0.0) & chosen[:, None, None]).any():
            lane, _, wave = np.argwhere(resonant & (force != 0.0))[0]
            raise InvalidInput(
                f"EventLocated cannot drive an undamped mode at its natural frequency, {self.frequency[lane, wave]:g} "
                "rad s-1; add damping, change the frequency by a millionth, or use il.ExactFlow()."
            )
        response: Array = np.divide(force, dynamic, out=np.zeros_like(force), where=force != 0.0)
        return response


def _followed(stiffness: Array, damping: Array, basis: Array, drift: Array) -> tuple[Array, Array]:
    """Return how much coordinates go with others of constant velocity: their parts in these and in their rates."""
    kappa, turned = np.linalg.eigh(basis.T @ stiffness @ basis)
    shapes = basis @ turned
    size = np.einsum("ik,ij,jk->k", np.abs(shapes), np.abs(stiffness), np.abs(shapes))
    held = kappa > 4.0 * len(basis) * np.finfo(float).eps * size
    between, slowed = shapes.T @ stiffness @ drift, shapes.T @ damping @ drift
    own = shapes.T @ damping @ shapes
    p, q = np.zeros_like(between), np.zeros_like(between)
    p[held] = -between[held] / kappa[held, None]
    free = np.ix_(~held, ~held)
    p[~held] = -np.linalg.pinv(own[free], rcond=1e-12) @ (slowed[~held] + own[~held][:, held] @ p[held])
    q[held] = -(slowed[held] + own[held] @ p) / kappa[held, None]
    return turned @ p, turned @ q


def _pairs(g: Array, kappa: Array, push: Array) -> Array:
    """Return the numbers of pairs."""
    square = kappa - g * g
    kind = np.where(square > CRITICAL * kappa, SWINGING, GENERAL)
    kind = np.where((kappa == 0.0) & (g == 0.0), FREE, kind)
    return np.stack([g, kappa, np.sqrt(np.abs(square)), push, kind, np.sqrt(kappa)], axis=-1)


def _complex(
    kappa: Array, damping: Array, load: Array, force: Array, frequency: Array
) -> tuple[Array, Array, Array, Array, Array]:
    """Return the pairs of modes that damping couples.

    Returned are pairs, displacements and velocities of the modes from them and the reverse, the offset of the former,
    and the response of the displacements to waves.
    """
    count = len(kappa)
    drift = np.block([[np.zeros((count, count)), np.eye(count)], [-np.diag(kappa), -damping]])
    turned, numbers = np.zeros((2 * count, 2 * count)), list[tuple[float, float]]()
    for part in _parts_of(damping):
        both, place = np.concatenate([part, part + count]), 2 * len(numbers)
        if len(part) == 1:
            turned[both, [place, place + 1]] = 1.0
            numbers.append((0.5 * damping[part[0], part[0]], kappa[part[0]]))
            continue
        rates, vectors = np.linalg.eig(drift[np.ix_(both, both)])
        real = np.flatnonzero(np.abs(rates.imag) <= 1e-12 * np.abs(rates).max())
        real = real[np.argsort(rates[real].real)]
        for one, two in zip(real[0::2], real[1::2], strict=True):
            first, second = rates[one].real, rates[two].real
            shapes = vectors[:, [one, two]].real
            place = 2 * len(numbers)
            turned[both, place] = (first * shapes[:, 1] - second * shapes[:, 0]) / (first - second)
            turned[both, place + 1] = (shapes[:, 0] - shapes[:, 1]) / (first - second)
            numbers.append((-0.5 * (first + second), max(first * second, 0.0)))
        for one in np.flatnonzero(rates.imag > 1e-12 * np.abs(rates).max()):
            decay, root, shape = -rates[one].real, rates[one].imag, vectors[:, one]
            place = 2 * len(numbers)
            turned[both, place] = shape.real + decay / root * shape.imag
            turned[both, place + 1] = shape.imag / root
            numbers.append((decay, abs(rates[one]) ** 2))
    scale = np.abs(turned).max(axis=0)
    condition = np.linalg.cond(turned / scale)
    if not condition < 1e7:
        raise InvalidInput(
            "EventLocated cannot tell apart the modes of a damped motion that is critical; change a damping by a "
            "thousandth, or use il.ExactFlow()."
        )
    back = np.linalg.inv(turned)
    push = back[:, count:] @ load
    g, stiff = np.array(numbers).T
    pairs = _pairs(g, stiff, 2.0 * g * push[0::2] + push[1::2])
    shift = -turned[:, 1::2] @ push[0::2]
    response = np.zeros((count, len(frequency)), complex)
    for wave, omega in enumerate(frequency):
        matrix = np.diag(kappa) - omega**2 * np.eye(count) + 1j * omega * damping
        response[:, wave] = np.linalg.solve(matrix, force[:, wave])
    return pairs, turned, back, shift, response


def _parts_of(damping: Array) -> list[Array]:
    """Return the modes that damping couples with each other, part by part."""
    from scipy.sparse.csgraph import connected_components  # loaded only where damping couples modes

    _, labels = connected_components(np.abs(damping) > COUPLED * np.abs(damping).max())
    return [np.flatnonzero(labels == label) for label in np.unique(labels)]
