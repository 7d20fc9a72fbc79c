"""The flow of linear bodies between kicks, with and without noise."""

from __future__ import annotations

from impactlab.compiling.intrinsics import rows
from impactlab.compiling.jit import kernel

COEFFICIENTS = 4
"""Columns of a flow: a_xx, a_xv, a_vx, a_vv."""


@kernel
def flow(coefficients, phase, noise, sample, normals, x, v, result):  # type: ignore[no-untyped-def]
    """Carry all bodies over one step.

    coefficients, phase: the flow, (phase, 4 or more, body), and which step of the method's cycle it is.
    noise, sample: rows of noise, and the row of ``noise.scale`` that belongs to the step.
    normals: standard normals of the step [row, lane].
    x, v: state [body, lane]; v is changed in place.
    result: displacements after the step [body, lane].
    """
    own, amplitude, scales = coefficients[phase], noise.amplitude[phase], noise.scale[sample]
    for run in range(noise.runs.shape[0]):
        begin, row, count = noise.runs[run, 0], noise.runs[run, 1], noise.runs[run, 2]
        a_xx, a_xv = rows(own[0], begin, count), rows(own[1], begin, count)
        a_vx, a_vv = rows(own[2], begin, count), rows(own[3], begin, count)
        before, velocity, after = rows(x, begin, count), rows(v, begin, count), rows(result, begin, count)
        if row < 0:
            for body in range(after.shape[0]):
                c_xx, c_xv, c_vx, c_vv = a_xx[body], a_xv[body], a_vx[body], a_vv[body]
                for lane in range(after.shape[1]):
                    place, speed = before[body, lane], velocity[body, lane]
                    after[body, lane] = c_xx * place + c_xv * speed
                    velocity[body, lane] = c_vx * place + c_vv * speed
            continue
        scale, some = rows(scales, row, count), rows(normals, row, count)
        of_x, of_v = rows(amplitude[0], row, count), rows(amplitude[1], row, count)
        for body in range(after.shape[0]):
            c_xx, c_xv, c_vx, c_vv = a_xx[body], a_xv[body], a_vx[body], a_vv[body]
            l_x, l_v = scale[body] * of_x[body], scale[body] * of_v[body]
            for lane in range(after.shape[1]):
                place, speed, z = before[body, lane], velocity[body, lane], some[body, lane]
                after[body, lane] = c_xx * place + c_xv * speed + l_x * z
                velocity[body, lane] = c_vx * place + c_vv * speed + l_v * z
    for row in range(noise.seconds, noise.bodies.shape[0]):
        body = noise.bodies[row]
        l_x = scales[row] * amplitude[0, row]
        l_v = scales[row] * amplitude[1, row]
        for lane in range(result.shape[1]):
            z = normals[row, lane]
            result[body, lane] += l_x * z
            v[body, lane] += l_v * z


@kernel
def flow_between(cross, normals, x, v, result, after):  # type: ignore[no-untyped-def]
    """Add the motion that connected bodies pass on to each other during the flow, by blocks of the flow, `Cross`.

    `normals` are the same as in `flow`; x and v are the state before the step, and the results the displacements and
    velocities after the step, [body, lane] each.
    """
    for block in range(cross.bodies.shape[0]):
        body, other = cross.bodies[block, 0], cross.bodies[block, 1]
        a_xx, a_xv, a_vx, a_vv = cross.flow[block]
        for lane in range(result.shape[1]):
            displacement, velocity = x[other, lane], v[other, lane]
            result[body, lane] += a_xx * displacement + a_xv * velocity
            after[body, lane] += a_vx * displacement + a_vv * velocity
        row, second_row = cross.rows[0, other], cross.rows[1, other]
        if row < 0:
            continue
        l_xx, l_xv, l_vx, l_vv = cross.noise[block]
        for lane in range(result.shape[1]):
            first, second = normals[row, lane], normals[second_row, lane]
            result[body, lane] += l_xx * first + l_xv * second
            after[body, lane] += l_vx * first + l_vv * second


@kernel
def push_between(cross, part, push, x, v):  # type: ignore[no-untyped-def]
    """Add the response of bodies to a part of the given force on a body that they are coupled to; see `Cross.push`."""
    for block in range(cross.bodies.shape[0]):
        body, other = cross.bodies[block, 0], cross.bodies[block, 1]
        of_x, of_v = cross.push[block, 2 * part], cross.push[block, 2 * part + 1]
        for lane in range(x.shape[1]):
            x[body, lane] += of_x * push[other, lane]
            v[body, lane] += of_v * push[other, lane]
