"""Counting samples into bins."""

from __future__ import annotations

from impactlab.compiling.jit import kernel


@kernel
def count_samples(snapshots, first, stride, quantity, low, inverse_width, subsamples, counts):  # type: ignore[no-untyped-def]
    """Add every `stride`-th snapshot from `first` on to ``counts[subsample, bin]``.

    The first and the last bin hold what lies below and above; bin k + 1 holds
    ``low + k width ≤ value < low + (k + 1) width``.
    """
    bins = counts.shape[1] - 2
    for sample in range(first, snapshots.shape[0], stride):
        for lane in range(snapshots.shape[2]):
            place = (snapshots[sample, quantity, lane] - low) * inverse_width + 1.0
            counts[subsamples[lane], int(min(max(place, 0.0), bins + 1.0))] += 1


@kernel
def count_pairs(snapshots, first, stride, quantities, low, inverse_width, subsamples, counts):  # type: ignore[no-untyped-def]
    """Add pairs of two quantities to ``counts[subsample, first bin, second bin]``, as `count_samples`."""
    bins = counts.shape[1] - 2
    for sample in range(first, snapshots.shape[0], stride):
        for lane in range(snapshots.shape[2]):
            a = (snapshots[sample, quantities[0], lane] - low[0]) * inverse_width[0] + 1.0
            b = (snapshots[sample, quantities[1], lane] - low[1]) * inverse_width[1] + 1.0
            row, column = int(min(max(a, 0.0), bins + 1.0)), int(min(max(b, 0.0), bins + 1.0))
            counts[subsamples[lane], row, column] += 1


@kernel
def find_peaks(snapshots, row, level, peaks):  # type: ignore[no-untyped-def]
    """Write peaks to ``peaks[sample, lane]`` where they end, and 0 elsewhere.

    A peak ends where the force has fallen to less than half of it; the next begins where the force has doubled from its
    least value since. `level` is the largest value of a peak that goes on, or minus the least since the last peak,
    (lane,).
    """
    for sample in range(snapshots.shape[0]):
        for lane in range(snapshots.shape[2]):
            value, last = snapshots[sample, row, lane], level[lane]
            peaks[sample, lane] = 0.0
            if last > 0.0:
                if value < 0.5 * last:
                    peaks[sample, lane] = last
                    level[lane] = -value
                elif value > last:
                    level[lane] = value
            elif value > -2.0 * last:
                level[lane] = value
            elif value < -last:
                level[lane] = -value


@kernel
def add_crossings(snapshots, along, clearance, inverse_width, flux, inward, push):  # type: ignore[no-untyped-def]
    """Add crossings of indentations of a contact to bins of indentations, ``[lane, bin]``.

    `flux` gets half the speed: levels are crossed as often on the way out as on the way in, and the two see the effect
    of a step on the velocity from both sides. `inward` gets the speed on the way in, and `push` this speed times the
    force.

    `along` describes the indentation: rows of displacements and of velocities of bodies, (2, body), their weights, and
    the row of the force.
    """
    rows, weights, of_force = along
    bins = flux.shape[1]
    for sample in range(snapshots.shape[0]):
        for lane in range(snapshots.shape[2]):
            depth, closing = -clearance, 0.0
            for body in range(rows.shape[1]):
                depth += weights[body] * snapshots[sample, rows[0, body], lane]
                closing += weights[body] * snapshots[sample, rows[1, body], lane]
            place = depth * inverse_width
            if depth > 0.0 and place < bins:
                flux[lane, int(place)] += 0.5 * abs(closing)
                inward[lane, int(place)] += max(closing, 0.0)
                push[lane, int(place)] += max(closing, 0.0) * snapshots[sample, of_force, lane]
