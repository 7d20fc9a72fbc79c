"""Sums over time of one lane each, from which all statistics are estimated.

Steps are kept in a history of eight, the *slots*, and added together: the sums are then
read and written once for four steps.
"""

from __future__ import annotations

import math

from impactlab.compiling.jit import inlined, kernel
from impactlab.compiling.scalars import scalar
from impactlab.compiling.single import instead_of
from impactlab.kernels.combinations import elongations, round_rates
from impactlab.kernels.interpolation import cubic
from impactlab.kernels.kick import differences
from impactlab.kernels.peaks import read_peaks
from impactlab.kernels.rows import FF, FLUX, FV, FX, TOUCHING, TURN, VV, XV, XX, F, V, X

SLOTS = 8
"""Steps that are added together."""

GRAZING, HIDDEN, SLOWEST = 0.5, 0.037, 0.1
"""How closings that noise hides within a step are estimated; see `closings`. The turning points that count lie within
`GRAZING` of contact, in units of the distance by which noise moves the gap in a step. `HIDDEN` is the factor in
the closings that noise hides, and `SLOWEST` the least change of the closing velocity in a step that counts as one,
in units of the change that noise makes."""


@kernel
def empty_slots(history, begin, end):  # type: ignore[no-untyped-def]
    """Fill some slots of a history with zeros, which add nothing to any sum."""
    for slot in range(begin, end):
        for row in range(history.x.shape[1]):
            for lane in range(history.x.shape[2]):
                history.x[slot, row, lane] = 0.0
                history.v[slot, row, lane] = 0.0
                history.force[slot, row, lane] = 0.0
        for contact in range(history.contact_force.shape[1]):
            for lane in range(history.contact_force.shape[2]):
                history.indentation[slot, contact, lane] = 0.0
                history.contact_force[slot, contact, lane] = 0.0


@inlined
def close_slot(history, slot, now, last, sums):  # type: ignore[no-untyped-def]
    """Count the closings of a step, and read peaks between it and those before.

    Return whether the history must be added: after its last slot, or of a call.
    """
    if sums.closings.before.shape[1] and sums.closings.weights.shape[0]:
        elongations(sums.indices, sums.closings.weights, history.v[slot], sums.flux.closing[0])
        round_rates(sums.indices, sums.closings.weights, history.x[slot], history.v[slot], sums.flux.closing[0])
        count_closings_along(history.indentation[slot], sums.flux.closing[0], sums)
    elif sums.closings.before.shape[1]:
        count_closings(history.indentation[slot], history.v[slot], sums)
    if sums.closings.peaks.function:
        read_peaks(history, slot, now, sums.closings, sums.indices)
    full = last or slot == SLOTS - 1
    if full:
        empty_slots(history, slot + 1, SLOTS)
    return full


@inlined
def add_history(history, sums):  # type: ignore[no-untyped-def]
    """Add all slots to the sums; those of different phases of the method's cycle apart.

    What statistics sample is added by `impactlab.kernels.samples.adding`.
    """
    phases = sums.bodies.shape[0]
    for slot in (0, 1):
        slots = slot, slot + 2, slot + 4, slot + 6
        if sums.bodies.shape[1] > F:
            add_kicks(history.x, history.v, history.force, slots, slot % phases, sums.bodies)
        else:
            add_states(history.x, history.v, slots, slot % phases, sums.bodies)
        if sums.flux.window.shape[0] and not sums.closings.before.shape[1]:
            add_flux(history, slots, sums)
        if sums.pairs.shape[0]:
            add_products(history.x, history, slots, sums.pairs, 0, sums.products)
            add_products(history.v, history, slots, sums.pairs, 3, sums.products)
            add_products(history.force, history, slots, sums.pairs, 6, sums.products)


@kernel
def add_states(x, v, slots, phase, sums):  # type: ignore[no-untyped-def]
    """Add the powers of displacement and velocity in four slots to ``sums[phase, row, body, lane]``."""
    for body in range(sums.shape[2]):
        add_state(x, v, slots, phase, body, sums)


@kernel
def add_kicks(x, v, f, slots, phase, sums):  # type: ignore[no-untyped-def]
    """Do so, and add the powers of the forces of kicks.

    Each body has both in turn, while its states are in the nearest cache; in one loop there would be too many rows.
    """
    for body in range(sums.shape[2]):
        add_state(x, v, slots, phase, body, sums)
        add_force(x, v, f, slots, phase, body, sums)


@instead_of(add_kicks)
def add_kicks_of_one(x, v, f, slots, phase, sums):  # type: ignore[no-untyped-def]
    """Do what `add_kicks` does, in loops over all bodies that vectorise."""
    for body in range(sums.shape[2]):
        add_state(x, v, slots, phase, body, sums)
    for body in range(sums.shape[2]):
        add_force(x, v, f, slots, phase, body, sums)


@inlined
def add_state(x, v, slots, phase, body, sums):  # type: ignore[no-untyped-def]
    """Add the powers of displacement and velocity of one body."""
    a, b, c, d = slots
    for lane in range(sums.shape[3]):
        x0, x1, x2, x3 = x[a, body, lane], x[b, body, lane], x[c, body, lane], x[d, body, lane]
        v0, v1, v2, v3 = v[a, body, lane], v[b, body, lane], v[c, body, lane], v[d, body, lane]
        sums[phase, X, body, lane] += (x0 + x1) + (x2 + x3)
        sums[phase, V, body, lane] += (v0 + v1) + (v2 + v3)
        sums[phase, XX, body, lane] += (x0 * x0 + x1 * x1) + (x2 * x2 + x3 * x3)
        sums[phase, XV, body, lane] += (x0 * v0 + x1 * v1) + (x2 * v2 + x3 * v3)
        sums[phase, VV, body, lane] += (v0 * v0 + v1 * v1) + (v2 * v2 + v3 * v3)


@inlined
def add_force(x, v, f, slots, phase, body, sums):  # type: ignore[no-untyped-def]
    """Add the powers of the forces of kicks of one body."""
    a, b, c, d = slots
    for lane in range(sums.shape[3]):
        f0, f1, f2, f3 = f[a, body, lane], f[b, body, lane], f[c, body, lane], f[d, body, lane]
        x0, x1, x2, x3 = x[a, body, lane], x[b, body, lane], x[c, body, lane], x[d, body, lane]
        v0, v1, v2, v3 = v[a, body, lane], v[b, body, lane], v[c, body, lane], v[d, body, lane]
        sums[phase, F, body, lane] += (f0 + f1) + (f2 + f3)
        sums[phase, FF, body, lane] += (f0 * f0 + f1 * f1) + (f2 * f2 + f3 * f3)
        sums[phase, FX, body, lane] += (f0 * x0 + f1 * x1) + (f2 * x2 + f3 * x3)
        sums[phase, FV, body, lane] += (f0 * v0 + f1 * v1) + (f2 * v2 + f3 * v3)


@kernel
def add_turns(force, middle, summing, phase, target):  # type: ignore[no-untyped-def]
    """Add the mean force of two kicks times what the flow between them gave to the velocity.

    Parameters
    ----------
    force, middle : [body, lane]
        Force of the later kick, and velocity in its middle.
    summing : bool
        Whether to add anything.
    phase : int
        Which step of the method's cycle it is.
    target : Sums
        Where to add; the earlier kick in `target.turns` is replaced by the later.
    """
    sums, last = target.bodies, target.turns
    for body in range(sums.shape[2]):
        half = last.half[body]
        for lane in range(sums.shape[3]):
            both = last.force[body, lane] + force[body, lane]
            turn = 0.5 * both * (middle[body, lane] - last.middle[body, lane] - half * both)
            sums[phase, TURN, body, lane] += turn if summing else 0.0
            last.force[body, lane] = force[body, lane]
            last.middle[body, lane] = middle[body, lane]


@scalar
def closings(depth, closing, next_depth, next_closing, step, jitter):  # type: ignore[no-untyped-def]
    """Closings in a step, from the indentations and their rates at both ends of the step.

    Between the ends the indentation follows Hermite's cubic, which is also the mean path under white noise between
    these ends. The cubic shows excursions that begin and end within the step. The closings that noise adds are
    to first order ``HIDDEN σ² h p(0, 0)`` closings, whatever the mean acceleration; p is the density of
    (δ, δ') and σ√h the `jitter`. The density at (0, 0) is estimated from turning points just beyond contact: a step
    that changes the closing velocity by Δ has ``|Δ|`` turning points in each unit of p. An impulsive contact that rests
    has no excursions.
    """
    count = 1.0 if depth <= 0.0 < next_depth else 0.0
    if closing * next_closing >= 0.0 or 0.0 < max(depth, next_depth) <= TOUCHING:
        return count
    by, next_by = step * closing, step * next_closing
    grazing = step * jitter * GRAZING
    if min(abs(depth), abs(next_depth)) > abs(by) + abs(next_by) + grazing:
        return count
    rise = next_depth - depth
    bend, twist = cubic(by, next_by, rise)
    # the one root of by + 2 bend s + 3 twist s² in (0, 1)
    root = math.sqrt(bend * bend - 3.0 * twist * by)
    place = by / (root - bend) if by > 0.0 else by / (-root - bend)
    turning = depth + place * (by + place * (bend + place * twist))
    if (depth > 0.0) == (next_depth > 0.0) and (turning > 0.0) != (depth > 0.0):
        count += 1.0
    if 0.0 < (turning if closing > 0.0 else -turning) < grazing:
        count += HIDDEN / GRAZING * jitter / max(abs(next_closing - closing), SLOWEST * jitter)
    return count


@kernel
def count_closings(indentation, v, target):  # type: ignore[no-untyped-def]
    """Add the closings since the step before, whose indentations and rates are in `target.closings.before`."""
    before, sums = target.closings.before, target.contacts
    for contact in range(sums.shape[1]):
        first, second = target.ends[contact, 0], target.ends[contact, 1]
        jitter = target.closings.jitter[contact]
        for lane in range(sums.shape[2]):
            depth, closing = indentation[contact, lane], v[first, lane] - v[second, lane]
            number = closings(
                before[0, contact, lane], before[1, contact, lane], depth, closing, target.closings.step, jitter
            )  # fmt: skip
            sums[FLUX, contact, lane] += number
            before[0, contact, lane], before[1, contact, lane] = depth, closing


@kernel
def count_closings_along(indentation, closing, target):  # type: ignore[no-untyped-def]
    """Do the same with the rates of the indentations."""
    before, sums, step = target.closings.before, target.contacts, target.closings.step
    for contact in range(sums.shape[1]):
        jitter = target.closings.jitter[contact]
        for lane in range(sums.shape[2]):
            depth, rate = indentation[contact, lane], closing[contact, lane]
            sums[FLUX, contact, lane] += closings(
                before[0, contact, lane], before[1, contact, lane], depth, rate, step, jitter
            )
            before[0, contact, lane], before[1, contact, lane] = depth, rate


@scalar
def weighted(depth, closing, half, curvature):  # type: ignore[no-untyped-def]
    """Closing velocity times the weight of an indentation inside the window."""
    return max(closing, 0.0) * (1.0 - curvature * depth * depth) if abs(depth) < half else 0.0


@scalar
def weighted_around(depth, closing, kick, half, curvature):  # type: ignore[no-untyped-def]
    """Mean of the weighted closing velocities before, in the middle of and after a kick."""
    around = max(closing + kick, 0.0) + max(closing, 0.0) + max(closing - kick, 0.0)
    return around * (1.0 / 3.0 - 1.0 / 3.0 * curvature * depth * depth) if abs(depth) < half else 0.0


@kernel
def add_flux(history, slots, target):  # type: ignore[no-untyped-def]
    """Add the weighted closing velocities in four slots.

    The rate of contacts is a one-sided flux: the closing velocity of bodies near the point of
    contact, weighted by ``1 − 5/3 (δ/ε)²`` inside a window ``|δ| < ε``. The weight has no
    second moment on either side, so that neither slope nor curvature of the density of
    the gap count. Counting sign changes between samples would miss the short contacts.

    Velocities in the middle of kicks are what friction makes of them within the step, if that is much, later: see
    `impactlab.integrators.kicks.kick_share`.

    At a kick by force gradients K the mean square of the velocity is off by −h²K/6 in its middle
    and by h²K/12 on either side. Where bodies feel other forces than that of the contact,
    the mean of the three is right to second order.
    """
    a, b, c, d = slots
    v, indentation, force, sums = history.v, history.indentation, history.force, target.contacts
    for contact in range(sums.shape[1]):
        first, second = target.ends[contact, 0], target.ends[contact, 1]
        half = target.flux.window[contact]
        curvature = 5.0 / 3.0 / half**2
        if target.flux.half_kick.shape[0] == 0:
            for lane in range(sums.shape[2]):
                flux = weighted(indentation[a, contact, lane], v[a, first, lane] - v[a, second, lane], half, curvature)
                flux += weighted(indentation[b, contact, lane], v[b, first, lane] - v[b, second, lane], half, curvature)
                flux += weighted(indentation[c, contact, lane], v[c, first, lane] - v[c, second, lane], half, curvature)
                flux += weighted(indentation[d, contact, lane], v[d, first, lane] - v[d, second, lane], half, curvature)
                sums[FLUX, contact, lane] += flux
        if target.flux.half_kick.shape[0] == 1:
            of_first, of_second = target.flux.half_kick[0, first], target.flux.half_kick[0, second]
            for lane in range(sums.shape[2]):
                flux = sums[FLUX, contact, lane]
                closing = v[a, first, lane] - v[a, second, lane]
                kick = of_first * force[a, first, lane] - of_second * force[a, second, lane]
                flux += weighted_around(indentation[a, contact, lane], closing, kick, half, curvature)
                closing = v[b, first, lane] - v[b, second, lane]
                kick = of_first * force[b, first, lane] - of_second * force[b, second, lane]
                flux += weighted_around(indentation[b, contact, lane], closing, kick, half, curvature)
                closing = v[c, first, lane] - v[c, second, lane]
                kick = of_first * force[c, first, lane] - of_second * force[c, second, lane]
                flux += weighted_around(indentation[c, contact, lane], closing, kick, half, curvature)
                closing = v[d, first, lane] - v[d, second, lane]
                kick = of_first * force[d, first, lane] - of_second * force[d, second, lane]
                flux += weighted_around(indentation[d, contact, lane], closing, kick, half, curvature)
                sums[FLUX, contact, lane] = flux
        if target.flux.half_kick.shape[0] > 1:  # friction slows bodies within a step
            of_first, of_second = target.flux.half_kick[0, first], target.flux.half_kick[0, second]
            late_first, late_second = target.flux.half_kick[1, first], target.flux.half_kick[1, second]
            for slot in slots:
                for lane in range(sums.shape[2]):
                    middle = v[slot, first, lane] - v[slot, second, lane]
                    kick = of_first * force[slot, first, lane] - of_second * force[slot, second, lane]
                    late = late_first * force[slot, first, lane] - late_second * force[slot, second, lane]
                    depth = indentation[slot, contact, lane]
                    sums[FLUX, contact, lane] += weighted_around(depth, middle + late, kick, half, curvature)


@instead_of(add_flux)
def add_flux_of_one(history, slots, target):  # type: ignore[no-untyped-def]
    """Do what `add_flux` does, in loops over all contacts that vectorise."""
    a, b, c, d = slots
    indentation, sums, closing, kick, push = (
        history.indentation,
        target.contacts,
        target.flux.closing,
        target.flux.kick,
        target.flux.push,
    )
    for place in range(4):
        if target.flux.half_kick.shape[0] > 1:  # friction slows bodies within a step
            for body in range(push.shape[0]):
                late = target.flux.half_kick[1, body]
                for lane in range(push.shape[1]):
                    push[body, lane] = (
                        history.v[slots[place], body, lane] + late * history.force[slots[place], body, lane]
                    )
            differences(target.indices, push, closing[place])
        else:
            differences(target.indices, history.v[slots[place]], closing[place])
    if target.flux.half_kick.shape[0] == 0:
        for contact in range(sums.shape[1]):
            half = target.flux.window[contact]
            curvature = 5.0 / 3.0 / half**2
            for lane in range(sums.shape[2]):
                flux = weighted(indentation[a, contact, lane], closing[0, contact, lane], half, curvature)
                flux += weighted(indentation[b, contact, lane], closing[1, contact, lane], half, curvature)
                flux += weighted(indentation[c, contact, lane], closing[2, contact, lane], half, curvature)
                flux += weighted(indentation[d, contact, lane], closing[3, contact, lane], half, curvature)
                sums[FLUX, contact, lane] += flux
        return
    for place in range(4):
        slot = slots[place]
        for body in range(push.shape[0]):
            of_body = target.flux.half_kick[0, body]
            for lane in range(push.shape[1]):
                push[body, lane] = of_body * history.force[slot, body, lane]
        differences(target.indices, push, kick)
        for contact in range(sums.shape[1]):
            half = target.flux.window[contact]
            curvature = 5.0 / 3.0 / half**2
            for lane in range(sums.shape[2]):
                depth, velocity = indentation[slot, contact, lane], closing[place, contact, lane]
                sums[FLUX, contact, lane] += weighted_around(depth, velocity, kick[contact, lane], half, curvature)


@kernel
def add_products(left, history, slots, pairs, row, sums):  # type: ignore[no-untyped-def]
    """Add a quantity of the first times x, v and f of the second body of each pair, in four slots, from a row on."""
    a, b, c, d = slots
    x, v, f = history.x, history.v, history.force
    for pair in range(sums.shape[1]):
        i, j = pairs[pair, 0], pairs[pair, 1]
        for lane in range(sums.shape[2]):
            q0, q1, q2, q3 = left[a, i, lane], left[b, i, lane], left[c, i, lane], left[d, i, lane]
            of_x = (q0 * x[a, j, lane] + q1 * x[b, j, lane]) + (q2 * x[c, j, lane] + q3 * x[d, j, lane])
            of_v = (q0 * v[a, j, lane] + q1 * v[b, j, lane]) + (q2 * v[c, j, lane] + q3 * v[d, j, lane])
            of_f = (q0 * f[a, j, lane] + q1 * f[b, j, lane]) + (q2 * f[c, j, lane] + q3 * f[d, j, lane])
            sums[row, pair, lane] += of_x
            sums[row + 1, pair, lane] += of_v
            sums[row + 2, pair, lane] += of_f


@kernel
def write_snapshot(x, v, contact_force, sums, snapshots, index):  # type: ignore[no-untyped-def]
    """Write displacements, velocities and contact forces of what is summed to ``snapshots[index, quantity, lane]``.

    Where only some rows are read, the others are not written.
    """
    bodies, contacts = sums.bodies.shape[2], sums.contacts.shape[1]
    for place in range(len(sums.read)):
        row = sums.read[place]
        if row < bodies:
            for lane in range(snapshots.shape[2]):
                snapshots[index, row, lane] = x[row, lane]
        elif row < 2 * bodies:
            for lane in range(snapshots.shape[2]):
                snapshots[index, row, lane] = v[row - bodies, lane]
        else:
            for lane in range(snapshots.shape[2]):
                snapshots[index, row, lane] = contact_force[row - 2 * bodies, lane]
    if len(sums.read):
        return
    for body in range(bodies):
        for lane in range(snapshots.shape[2]):
            snapshots[index, body, lane] = x[body, lane]
        for lane in range(snapshots.shape[2]):
            snapshots[index, bodies + body, lane] = v[body, lane]
    for contact in range(contacts):
        for lane in range(snapshots.shape[2]):
            snapshots[index, 2 * bodies + contact, lane] = contact_force[contact, lane]
