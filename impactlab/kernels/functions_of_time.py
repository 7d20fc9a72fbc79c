"""Given functions of time, looked at in compiled loops; see `impactlab.linear.given_functions`."""

from __future__ import annotations

from impactlab.compiling.jit import kernel


@kernel
def look_closely(values, functionals, tolerance, rough, least):  # type: ignore[no-untyped-def]
    """Say of rows of values whether some linear functionals of them are large, and how small those inside are.

    Parameters
    ----------
    values : (row, place)
    functionals : (functional, place)
    tolerance : float
        Part of the largest value from which on a functional is large.
    rough : (row,) of bool
        Is written: whether one is.
    least : (row,)
        Is written: the least value but for the first and the last, NaN if one is NaN.
    """
    for row in range(values.shape[0]):
        largest, size, low = 0.0, 0.0, values[row, 1]
        for functional in range(functionals.shape[0]):
            total = 0.0
            for place in range(values.shape[1]):
                total += functionals[functional, place] * values[row, place]
            if abs(total) > largest:
                largest = abs(total)
        for place in range(values.shape[1]):
            if abs(values[row, place]) > size:
                size = abs(values[row, place])
        for place in range(1, values.shape[1] - 1):
            if values[row, place] < low or values[row, place] != values[row, place]:
                low = values[row, place]
        rough[row], least[row] = largest > tolerance * size, low


@kernel
def sum_panels(values, weights, result):  # type: ignore[no-untyped-def]
    """Write the sums over the points of panels, ``values[panel, point, row]``, weighted by ``weights[point, column]``.

    The result is [row, panel, column].
    """
    for row in range(result.shape[0]):
        for panel in range(result.shape[1]):
            for column in range(weights.shape[1]):
                result[row, panel, column] = 0.0
            for point in range(weights.shape[0]):
                value = values[panel, point, row]
                for column in range(weights.shape[1]):
                    result[row, panel, column] += weights[point, column] * value


@kernel
def follow(pushes, flow, response, springs, energy):  # type: ignore[no-untyped-def]
    """Write the largest energy of a linear body under forces that are constant over steps, (1,), from rest.

    The flow of a step is (2, 2), the response to a unit force (2,); the last argument has the mass and the stiffness.
    """
    x = v = largest = 0.0
    for step in range(pushes.shape[0]):
        push = pushes[step]
        next_x = flow[0, 0] * x + flow[0, 1] * v + response[0] * push
        v = flow[1, 0] * x + flow[1, 1] * v + response[1] * push
        x = next_x
        here = springs[0] * v * v + springs[1] * x * x
        if here > largest:
            largest = here
    energy[0] = 0.5 * largest
