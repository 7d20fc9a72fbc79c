"""Velocities at which the forces of kicks do their work, in snapshots."""

from __future__ import annotations

from impactlab.compiling.jit import kernel


@kernel
def write_at_kicks(middle, force, sums, snapshots, index):  # type: ignore[no-untyped-def]
    """Write the velocities at which forces of kicks do their work into a snapshot, before peaks.

    A force F of a kick does the work ``h F v`` with the velocity v in its middle. Friction that slows the body down
    within the step wastes a part of that which the force itself would not lose: in the mean, F times its share
    ``late`` of the velocity is taken away.
    """
    late = sums.turns.late
    first = snapshots.shape[1] - sums.closings.peaks.written - late.shape[0]
    for body in range(late.shape[0]):
        share = late[body]
        for lane in range(snapshots.shape[2]):
            snapshots[index, first + body, lane] = middle[body, lane] - share * force[body, lane]


@kernel
def put_at_kicks(middle, force, lanes, sums, snapshots, index):  # type: ignore[no-untyped-def]
    """Write them for some lanes, whose blocks are dense."""
    late = sums.turns.late
    first = snapshots.shape[1] - sums.closings.peaks.written - late.shape[0]
    for body in range(late.shape[0]):
        share = late[body]
        for lane in range(middle.shape[1]):
            snapshots[index, first + body, lanes[lane]] = middle[body, lane] - share * force[body, lane]


@kernel
def add_linear_forces(snapshots, begins, rows, weights, numbers, result):  # type: ignore[no-untyped-def]
    """Add the forces of linear springs and dampers along links to ``result[sample, link, lane]``.

    Entries of a link begin at `begins`; `rows`, (2, entry), are those of displacements and velocities in a snapshot,
    and `numbers`, (2, link), stiffness and damping.
    """
    for link in range(result.shape[1]):
        stiffness, damping = numbers[0, link], numbers[1, link]
        for entry in range(begins[link], begins[link + 1]):
            x, v, weight = rows[0, entry], rows[1, entry], weights[entry]
            for sample in range(result.shape[0]):
                for lane in range(result.shape[2]):
                    push = stiffness * snapshots[sample, x, lane] + damping * snapshots[sample, v, lane]
                    result[sample, link, lane] += weight * push


@kernel
def add_work(forces, snapshots, rows, weights, sums):  # type: ignore[no-untyped-def]
    """Subtract weight times force times velocity in all samples from ``sums[entry, lane]``.

    `rows`, (2, entry), are the row of the force among forces and that of the velocity in a snapshot.
    """
    for entry in range(sums.shape[0]):
        force, pace, weight = rows[0, entry], rows[1, entry], weights[entry]
        for sample in range(snapshots.shape[0]):
            for lane in range(sums.shape[1]):
                sums[entry, lane] -= weight * forces[sample, force, lane] * snapshots[sample, pace, lane]
