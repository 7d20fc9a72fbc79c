"""What acts between flows or within a stage: kicks, given forces, series of cosines."""

from __future__ import annotations

from impactlab.compiling.intrinsics import rows
from impactlab.compiling.jit import kernel, scattered


@kernel
def gather(indices, contact_force, total):  # type: ignore[no-untyped-def]
    """Write the sum of its contacts' forces on every body, in the order of the contacts; 0 for the wall, the last body.

    Forces are [contact, lane], their sums [body, lane]; the second entry of the indices, `Members.indices`, tells where
    the rows for this begin.
    """
    begin = indices[1]
    at = begin + 6
    for _ in range(indices[begin]):  # bodies in a row: the first, number, contact and sign of two terms
        body, count = indices[at], indices[at + 1]
        sign, other = float(indices[at + 3]), float(indices[at + 5])
        result, one = rows(total, body, count), rows(contact_force, indices[at + 2], count)
        two = rows(contact_force, indices[at + 4], count)
        at += 6
        for row in range(result.shape[0]):
            for lane in range(result.shape[1]):
                result[row, lane] = sign * one[row, lane] + other * two[row, lane]
    for _ in range(indices[begin + 1]):  # their further terms: the first body, number, contact and sign
        body, count, sign = indices[at], indices[at + 1], float(indices[at + 3])
        result, one = rows(total, body, count), rows(contact_force, indices[at + 2], count)
        at += 4
        for row in range(result.shape[0]):
            for lane in range(result.shape[1]):
                result[row, lane] += sign * one[row, lane]
    # other bodies without a contact, with one, with more, and their further terms; columns of a table each
    none, one, more, rest = indices[begin + 2], indices[begin + 3], indices[begin + 4], indices[begin + 5]
    for row in range(none):
        body = indices[at + row]
        for lane in range(total.shape[1]):
            total[body, lane] = 0.0
    at += none
    bodies, contacts, signs = rows(indices, at, one), rows(indices, at + one, one), rows(indices, at + 2 * one, one)
    for row in range(one):
        body, first, sign = bodies[row], contacts[row], float(signs[row])
        for lane in range(total.shape[1]):
            total[body, lane] = sign * contact_force[first, lane]
    at += 3 * one
    bodies, contacts, signs = (
        rows(indices, at, more),
        rows(indices, at + more, more),
        rows(indices, at + 2 * more, more),
    )
    seconds, others = rows(indices, at + 3 * more, more), rows(indices, at + 4 * more, more)
    for row in range(more):
        body, first, second = bodies[row], contacts[row], seconds[row]
        sign, other = float(signs[row]), float(others[row])
        for lane in range(total.shape[1]):
            total[body, lane] = sign * contact_force[first, lane] + other * contact_force[second, lane]
    at += 5 * more
    bodies, contacts, signs = (
        rows(indices, at, rest),
        rows(indices, at + rest, rest),
        rows(indices, at + 2 * rest, rest),
    )
    for row in range(rest):
        body, first, sign = bodies[row], contacts[row], float(signs[row])
        for lane in range(total.shape[1]):
            total[body, lane] += sign * contact_force[first, lane]
    for lane in range(total.shape[1]):
        total[-1, lane] = 0.0


@scattered
def differences(indices, a, result):  # type: ignore[no-untyped-def]
    """Write the difference of a quantity, [body, lane], between the first and the second body of every contact.

    The result is [contact, lane]; the first entry of the indices, `Members.indices`, tells where the rows for this
    begin.
    """
    begin = indices[0]
    at = begin + 2
    for _ in range(indices[begin]):  # contacts in a row: the first and its bodies, number
        contact, count = indices[at], indices[at + 3]
        some, first = rows(result, contact, count), rows(a, indices[at + 1], count)
        second = rows(a, indices[at + 2], count)
        at += 4
        for row in range(some.shape[0]):
            for lane in range(some.shape[1]):
                some[row, lane] = first[row, lane] - second[row, lane]
    others = indices[begin + 1]
    contacts, firsts = rows(indices, at, others), rows(indices, at + others, others)
    seconds = rows(indices, at + 2 * others, others)
    for row in range(others):
        contact, one, two = contacts[row], firsts[row], seconds[row]
        for lane in range(result.shape[1]):
            result[contact, lane] = a[one, lane] - a[two, lane]


@kernel
def scaled_sum(a, coefficients, column, b, result):  # type: ignore[no-untyped-def]
    """Write ``a + coefficient b`` of every body to `result`; the coefficients are a column."""
    for body in range(coefficients.shape[2]):
        c = coefficients[0, column, body]
        for lane in range(result.shape[1]):
            result[body, lane] = a[body, lane] + c * b[body, lane]


@kernel
def add_scaled(coefficients, column, b, result):  # type: ignore[no-untyped-def]
    """Add ``coefficient b`` of every body to `result`; the coefficients are a column."""
    for body in range(coefficients.shape[2]):
        c = coefficients[0, column, body]
        for lane in range(result.shape[1]):
            result[body, lane] += c * b[body, lane]


@kernel
def apply_kick(coefficients, column, total, v, middle):  # type: ignore[no-untyped-def]
    """Add ``coefficient total`` to the velocities; write the velocities in the middle of the kick to `middle`."""
    for body in range(coefficients.shape[2]):
        c = coefficients[0, column, body]
        for lane in range(v.shape[1]):
            g = c * total[body, lane]
            before = v[body, lane]
            middle[body, lane] = before + 0.5 * g
            v[body, lane] = before + g


@kernel
def smooth_velocity(coefficients, kick, lag, middle, total, before, result):  # type: ignore[no-untyped-def]
    """Write the velocities of the smooth path that kicks follow to `result`.

    In the middle of kicks by a force F the velocity is ``h² F'/12m`` off, as far as the shifted place is off the
    place; F' is the change of F since the kick before over h. Friction adds its `lag`, a column of the coefficients as
    is that of the `kick`; see `impactlab.integrators.kicks.kick_lag`.
    """
    for body in range(coefficients.shape[2]):
        of_change, of_force = coefficients[0, kick, body] / 12.0, coefficients[0, lag, body]
        for lane in range(result.shape[1]):
            change = total[body, lane] - before[body, lane]
            result[body, lane] = middle[body, lane] - of_change * change - of_force * total[body, lane]


@kernel
def clear(block):  # type: ignore[no-untyped-def]
    """Set a block to 0."""
    for body in range(block.shape[0]):
        for lane in range(block.shape[1]):
            block[body, lane] = 0.0


@kernel
def copy(block, result):  # type: ignore[no-untyped-def]
    """Copy a block."""
    for body in range(block.shape[0]):
        for lane in range(result.shape[1]):
            result[body, lane] = block[body, lane]


@kernel
def combine(a, factor, b, result):  # type: ignore[no-untyped-def]
    """Write ``a + factor b`` to `result`."""
    for body in range(result.shape[0]):
        for lane in range(result.shape[1]):
            result[body, lane] = a[body, lane] + factor * b[body, lane]


@kernel
def add_multiple(factor, b, result):  # type: ignore[no-untyped-def]
    """Add ``factor b`` to `result`."""
    for body in range(result.shape[0]):
        for lane in range(result.shape[1]):
            result[body, lane] += factor * b[body, lane]


@kernel
def add_response(series, index, sign, x, v):  # type: ignore[no-untyped-def]
    """Add or subtract a linear response of `series.near`, rows 2 r (x) and 2 r + 1 (v)."""
    for row in range(series.bodies.shape[0]):
        body = series.bodies[row]
        for lane in range(x.shape[1]):
            x[body, lane] += sign * series.near[index, 2 * row, lane]
        for lane in range(v.shape[1]):
            v[body, lane] += sign * series.near[index, 2 * row + 1, lane]


@kernel
def add_series(series, index, force):  # type: ignore[no-untyped-def]
    """Add the force of `series.near` to ``force[body, lane]``."""
    for row in range(series.bodies.shape[0]):
        body = series.bodies[row]
        for lane in range(force.shape[1]):
            force[body, lane] += series.near[index, row, lane]


@kernel
def add_forced(forced, sample, force):  # type: ignore[no-untyped-def]
    """Add given forces at a time, the same in all lanes, to ``force[body, lane]``."""
    for row in range(forced.bodies.shape[0]):
        body = forced.bodies[row]
        given = forced.weights[row] * forced.force[sample, forced.numbers[row]]
        for lane in range(force.shape[1]):
            force[body, lane] += given


@kernel
def add_held_noise(noise, sample, normals, normal, force):  # type: ignore[no-untyped-def]
    """Add white noise that is held constant over a step to ``force[body, lane]``."""
    for row in range(noise.bodies.shape[0]):
        body = noise.bodies[row]
        amplitude = noise.amplitude[0, 1, row] * noise.scale[sample, row]
        for lane in range(force.shape[1]):
            force[body, lane] += amplitude * normals[normal, row, lane]


@kernel
def accelerate(coefficients, x, v, external, total):  # type: ignore[no-untyped-def]
    """Turn the non-linear force `total` into the acceleration, in place.

    The first three columns of the coefficients are mass, damping and stiffness.
    """
    for body in range(coefficients.shape[2]):
        inverse = 1.0 / coefficients[0, 0, body]
        c, k = coefficients[0, 1, body], coefficients[0, 2, body]
        for lane in range(total.shape[1]):
            force = total[body, lane] + external[body, lane] - c * v[body, lane] - k * x[body, lane]
            total[body, lane] = inverse * force
    for body in range(coefficients.shape[2], total.shape[0]):  # the wall stays at rest
        for lane in range(total.shape[1]):
            total[body, lane] = 0.0
