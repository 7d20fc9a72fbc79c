"""Counting samples into bins."""

from __future__ import annotations

from impactlab.kernels.jit import kernel


@kernel
def count_samples(snapshots, first, stride, quantity, low, inverse_width, groups, counts):  # type: ignore[no-untyped-def]
    """Add every `stride`-th snapshot from `first` on to ``counts[group, bin]``.

    The first and the last bin hold what lies below and above; bin k + 1 holds
    ``low + k width ≤ value < low + (k + 1) width``.
    """
    bins = counts.shape[1] - 2
    for sample in range(first, snapshots.shape[0], stride):
        for lane in range(snapshots.shape[2]):
            place = (snapshots[sample, quantity, lane] - low) * inverse_width + 1.0
            counts[groups[lane], int(min(max(place, 0.0), bins + 1.0))] += 1


@kernel
def count_pairs(snapshots, first, stride, quantities, low, inverse_width, bins, groups, counts):  # type: ignore[no-untyped-def]
    """Add pairs of two quantities to ``counts[group, first bin, second bin]``, as `count_samples`."""
    for sample in range(first, snapshots.shape[0], stride):
        for lane in range(snapshots.shape[2]):
            a = (snapshots[sample, quantities[0], lane] - low[0]) * inverse_width[0] + 1.0
            b = (snapshots[sample, quantities[1], lane] - low[1]) * inverse_width[1] + 1.0
            row, column = int(min(max(a, 0.0), bins + 1.0)), int(min(max(b, 0.0), bins + 1.0))
            counts[groups[lane], row, column] += 1
