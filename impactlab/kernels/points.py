"""Sums over time of points, which are weighted sums of bodies; see `impactlab.plan.structure_points`."""

from __future__ import annotations

from impactlab.compiling.jit import inlined, kernel
from impactlab.kernels.rows import POINT_TURN

COLUMNS = 9
"""Columns of weights: of the displacement of a body in that of a point; of its velocity and force in the velocity of
the point; of its displacement, velocity and force in each of two quantities that tell what lies between kicks."""


@inlined
def add_history_of_points(history, points):  # type: ignore[no-untyped-def]
    """Add all slots to the sums of points; see `impactlab.kernels.sums.add_history`."""
    phases = points.sums.shape[0]
    for slot in (0, 1):
        add_points(history.x, history.v, history.force, (slot, slot + 2, slot + 4, slot + 6), slot % phases, points)


@kernel
def add_points(x, v, force, slots, phase, points):  # type: ignore[no-untyped-def]
    """Add the squares of four weighted sums over the bodies of each point, at some slots of a history."""
    sums, read, weights = points.sums, points.read, points.weights[phase]
    for point in range(sums.shape[2]):
        for slot in slots:
            for lane in range(sums.shape[3]):
                for row in range(4):
                    read[row, lane] = 0.0
            for entry in range(points.begin[point], points.begin[point + 1]):
                body = points.bodies[entry]
                w_x, w_v, w_f = weights[0, entry], weights[1, entry], weights[2, entry]
                a_x, a_v, a_f = weights[3, entry], weights[4, entry], weights[5, entry]
                b_x, b_v, b_f = weights[6, entry], weights[7, entry], weights[8, entry]
                for lane in range(sums.shape[3]):
                    at, speed, push = x[slot, body, lane], v[slot, body, lane], force[slot, body, lane]
                    read[0, lane] += w_x * at
                    read[1, lane] += w_v * speed + w_f * push
                    read[2, lane] += a_x * at + a_v * speed + a_f * push
                    read[3, lane] += b_x * at + b_v * speed + b_f * push
            for row in range(4):
                for lane in range(sums.shape[3]):
                    sums[phase, row, point, lane] += read[row, lane] * read[row, lane]


@kernel
def add_turns_of_points(force, middle, phase, points, last):  # type: ignore[no-untyped-def]
    """Add the mean of two kicks times what the flow between them gave to the velocity of each point.

    Must be called before `impactlab.kernels.sums.add_turns` replaces the `last` kick.
    """
    sums, read = points.sums, points.read
    for point in range(sums.shape[2]):
        for lane in range(sums.shape[3]):
            read[0, lane] = 0.0
            read[1, lane] = 0.0
        for entry in range(points.begin[point], points.begin[point + 1]):
            body, weight = points.bodies[entry], points.weights[0, 0, entry]
            of_force = weight * last.half[body]
            for lane in range(sums.shape[3]):
                read[0, lane] += of_force * (last.force[body, lane] + force[body, lane])
                read[1, lane] += weight * (middle[body, lane] - last.middle[body, lane])
        for lane in range(sums.shape[3]):
            sums[phase, POINT_TURN, point, lane] += read[0, lane] * (read[1, lane] - read[0, lane])
