"""Counting samples into bins."""

from __future__ import annotations

import math

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
def add_values(values, sums, squares, largest, smallest):  # type: ignore[no-untyped-def]
    """Add values, ``[place, sample, lane]``, and their squares to sums, and widen their range, ``[place, lane]`` each.

    `smallest` has the largest of the negative.
    """
    for place in range(values.shape[0]):
        for sample in range(values.shape[1]):
            for lane in range(values.shape[2]):
                value = values[place, sample, lane]
                sums[place, lane] += value
                squares[place, lane] += value * value
                largest[place, lane] = max(largest[place, lane], value)
                smallest[place, lane] = max(smallest[place, lane], -value)


@kernel
def widen_bins(counts, times):  # type: ignore[no-untyped-def]
    """Make bins about 0, ``[subsample, bin]``, so many times twice as wide."""
    middle, by = counts.shape[1] // 2, min(times, 62)  # after which all are in the two bins at 0
    for subsample in range(counts.shape[0]):
        for place in range(1, middle):
            number, counts[subsample, middle + place] = counts[subsample, middle + place], 0.0
            counts[subsample, middle + (place >> by)] += number
        for place in range(-2, -middle - 1, -1):
            number, counts[subsample, middle + place] = counts[subsample, middle + place], 0.0
            counts[subsample, middle + (place >> by)] += number


@kernel
def count_about_zero(values, weights, subsamples, exponents, counts):  # type: ignore[no-untyped-def]
    """Count values, ``[place, sample, lane]``, with the weights of samples, in ``counts[place, subsample, bin]``.

    Bins reach from minus 2 to the power of an exponent of the place up to it, which is raised where values need it.
    """
    bins = counts.shape[2]
    for place in range(values.shape[0]):
        half = 2.0 ** exponents[place]
        for sample in range(values.shape[1]):
            beyond = 0
            for lane in range(values.shape[2]):
                beyond += 1 if abs(values[place, sample, lane]) >= half else 0
            if beyond:
                largest = 0.0
                for lane in range(values.shape[2]):
                    largest = max(largest, abs(values[place, sample, lane]))
                wanted = math.frexp(largest)[1]
                widen_bins(counts[place], wanted - exponents[place])
                exponents[place], half = wanted, 2.0**wanted
            scale = 0.5 * bins / half
            for lane in range(values.shape[2]):
                number = min(int(values[place, sample, lane] * scale + 0.5 * bins), bins - 1)
                counts[place, subsamples[lane], number] += weights[sample]


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
