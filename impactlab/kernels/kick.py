"""What acts between flows or within a stage: kicks, given forces, series of cosines."""

from __future__ import annotations

from impactlab.kernels.jit import kernel


@kernel
def gather(indices, contact_force, total):  # type: ignore[no-untyped-def]
    """Write the sum of its contacts' forces on every body to `total`, in the order of the contacts.

    Parameters
    ----------
    indices : ndarray of int
        `Model.indices`: the second entry tells where the rows for this begin.
    contact_force : [contact, lane]
        Forces of the contacts.
    total : [body, lane]
        Result; 0 for the wall, which is the last body.
    """
    at = indices[1] + 2
    for _ in range(indices[indices[1]]):  # bodies in a row: first, number, contact and sign of two terms
        count = indices[at + 1]
        result = total[indices[at] : indices[at] + count]
        sign, other = float(indices[at + 3]), float(indices[at + 5])
        one = contact_force[indices[at + 2] : indices[at + 2] + count]
        two = contact_force[indices[at + 4] : indices[at + 4] + count]
        at += 6
        if sign == 0.0:
            clear(result)
        elif other == 0.0:
            for row in range(result.shape[0]):
                for lane in range(result.shape[1]):
                    result[row, lane] = sign * one[row, lane]
        else:
            for row in range(result.shape[0]):
                for lane in range(result.shape[1]):
                    result[row, lane] = sign * one[row, lane] + other * two[row, lane]
    for _ in range(indices[indices[1] + 1]):  # further contacts: first body, number, contact and sign
        count, sign = indices[at + 1], float(indices[at + 3])
        result = total[indices[at] : indices[at] + count]
        one = contact_force[indices[at + 2] : indices[at + 2] + count]
        at += 4
        for row in range(result.shape[0]):
            for lane in range(result.shape[1]):
                result[row, lane] += sign * one[row, lane]
    for lane in range(total.shape[1]):
        total[-1, lane] = 0.0


@kernel
def differences(indices, a, result):  # type: ignore[no-untyped-def]
    """Write the difference of a quantity between the first and the second body of every contact.

    Parameters
    ----------
    indices : ndarray of int
        `Model.indices`: the first entry tells where the rows for this begin.
    a : [body, lane]
        The quantity.
    result : [contact, lane]
        Result.
    """
    at = indices[0] + 1
    for _ in range(indices[indices[0]]):  # contacts in a row: the first and its bodies, number
        count = indices[at + 3]
        some = result[indices[at] : indices[at] + count]
        first = a[indices[at + 1] : indices[at + 1] + count]
        second = a[indices[at + 2] : indices[at + 2] + count]
        at += 4
        for row in range(some.shape[0]):
            for lane in range(some.shape[1]):
                some[row, lane] = first[row, lane] - second[row, lane]


@kernel
def scaled_sum(a, coefficients, column, b, result):  # type: ignore[no-untyped-def]
    """Write ``a + coefficient b`` of every body to `result`; the coefficients are a column."""
    for body in range(coefficients.shape[2]):
        c = coefficients[0, column, body]
        for lane in range(result.shape[1]):
            result[body, lane] = a[body, lane] + c * b[body, lane]


@kernel
def apply_kick(coefficients, column, total, v, middle):  # type: ignore[no-untyped-def]
    """Add ``coefficient total`` to the velocities; write those in the middle of the kick to `middle`."""
    for body in range(coefficients.shape[2]):
        c = coefficients[0, column, body]
        for lane in range(v.shape[1]):
            g = c * total[body, lane]
            before = v[body, lane]
            middle[body, lane] = before + 0.5 * g
            v[body, lane] = before + g


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
def add_response(samples, sample, sign, bodies, x, v):  # type: ignore[no-untyped-def]
    """Add or subtract a sampled linear response, rows 2 r (x) and 2 r + 1 (v), periodic."""
    index = sample % samples.shape[0]
    for row in range(bodies.shape[0]):
        body = bodies[row]
        for lane in range(x.shape[1]):
            x[body, lane] += sign * samples[index, 2 * row, lane]
        for lane in range(v.shape[1]):
            v[body, lane] += sign * samples[index, 2 * row + 1, lane]


@kernel
def add_series(samples, sample, bodies, force):  # type: ignore[no-untyped-def]
    """Add a sampled force, periodic, to ``force[body, lane]``."""
    index = sample % samples.shape[0]
    for row in range(bodies.shape[0]):
        body = bodies[row]
        for lane in range(force.shape[1]):
            force[body, lane] += samples[index, row, lane]


@kernel
def add_forced(table, sample, bodies, force):  # type: ignore[no-untyped-def]
    """Add a given force, the same in all lanes, to ``force[body, lane]``."""
    for row in range(bodies.shape[0]):
        body = bodies[row]
        given = table[sample, row]
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
