"""What acts between flows or within a stage: kicks, given forces, series of cosines."""

from __future__ import annotations

from impactlab.kernels.jit import kernel


@kernel
def gather(indices, place, contact_force, total):  # type: ignore[no-untyped-def]
    """Write the sum of its contacts' forces on every body to `total`, in the order of the contacts.

    Parameters
    ----------
    indices : ndarray of int
        `Model.indices`.
    place : int
        Where in `indices` the place of the contacts of each body stands: first where those of
        each body begin, counted in pairs, then pairs of a contact and a sign.
    contact_force : [contact, lane]
        Forces of the contacts.
    total : [body, lane]
        Result; 0 for the wall, which is the last body.
    """
    begins = indices[place]
    bodies = total.shape[0] - 1
    pairs = begins + bodies + 1
    for body in range(bodies):
        at, end = pairs + 2 * indices[begins + body], pairs + 2 * indices[begins + body + 1]
        if at == end:
            for lane in range(total.shape[1]):
                total[body, lane] = 0.0
            continue
        one, sign = indices[at], float(indices[at + 1])
        if at + 2 == end:
            for lane in range(total.shape[1]):
                total[body, lane] = sign * contact_force[one, lane]
            continue
        two, other = indices[at + 2], float(indices[at + 3])
        for lane in range(total.shape[1]):
            total[body, lane] = sign * contact_force[one, lane] + other * contact_force[two, lane]
        for further in range(at + 4, end, 2):
            one, sign = indices[further], float(indices[further + 1])
            for lane in range(total.shape[1]):
                total[body, lane] += sign * contact_force[one, lane]
    for lane in range(total.shape[1]):
        total[bodies, lane] = 0.0


@kernel
def scaled_sum(a, coefficients, column, b, result):  # type: ignore[no-untyped-def]
    """Write ``a + coefficient b`` of every body to `result`; the coefficients are a column."""
    for body in range(coefficients.shape[1]):
        c = coefficients[0, body, column]
        for lane in range(result.shape[1]):
            result[body, lane] = a[body, lane] + c * b[body, lane]


@kernel
def apply_kick(coefficients, column, total, v, middle):  # type: ignore[no-untyped-def]
    """Add ``coefficient total`` to the velocities; write those in the middle of the kick to `middle`."""
    for body in range(coefficients.shape[1]):
        c = coefficients[0, body, column]
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
        amplitude = noise.amplitude[0, row, 1] * noise.scale[sample, row]
        for lane in range(force.shape[1]):
            force[body, lane] += amplitude * normals[row, normal, lane]


@kernel
def accelerate(coefficients, x, v, external, total):  # type: ignore[no-untyped-def]
    """Turn the non-linear force `total` into the acceleration, in place.

    The first three columns of the coefficients are mass, damping and stiffness.
    """
    for body in range(coefficients.shape[1]):
        inverse = 1.0 / coefficients[0, body, 0]
        c, k = coefficients[0, body, 1], coefficients[0, body, 2]
        for lane in range(total.shape[1]):
            force = total[body, lane] + external[body, lane] - c * v[body, lane] - k * x[body, lane]
            total[body, lane] = inverse * force
    for body in range(coefficients.shape[1], total.shape[0]):  # the wall stays at rest
        for lane in range(total.shape[1]):
            total[body, lane] = 0.0
