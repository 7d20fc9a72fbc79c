"""Correlated noises on several bodies, or of the ground below them, as sources of independent ones."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from impactlab.components.excitation import BaseMotion, Excitation, Source
from impactlab.components.matrices import NEGLIGIBLE, sum_of_squares
from impactlab.errors import InvalidInput
from impactlab.inputs import checked, real_array, shown


@checked
def correlated(
    noise: Excitation | BaseMotion, densities: Any, on: Sequence[str], *, name: str = "noise"
) -> dict[str, Source | BaseMotion]:
    """Return correlated noises on several bodies: sources of independent noises, for ``excitations=`` of a network.

    The matrix of the spectral densities of the forces, with cross-spectral densities off the diagonal, is
    `densities` times the density of the noise. With ``il.WhiteNoise(1.0)`` it is `densities` itself (N2 s rad-1), with
    filtered noise of variance 1 it is that of the covariances (N2). With an `impactlab.BaseMotion` in the place of the
    noise it is that of the accelerations of the ground below each body or structure (m2 s-3 rad-1).

    Parameters
    ----------
    noise : Excitation or BaseMotion
        Of which each source has one of its own: white or filtered noise, or a sum of cosines with random phases, or a
        motion of the ground by one of them.
    densities : (body, body) array_like
        Symmetric matrix without negative eigenvalues.
    on : sequence of str
        Names of the bodies, or points of structures; of what is on the ground, with a `BaseMotion`.
    name : str
        The sources are called by it and a number, such as "noise 1".

    Returns
    -------
    dict of str to Source or BaseMotion
        As many as the rank of the matrix.

    Raises
    ------
    InvalidInput
        If the noise is none, or the matrix is not symmetric, of another size, or has a negative eigenvalue.

    Examples
    --------
    >>> gusts = il.correlated(il.WhiteNoise(1.0), [[2.0, 1.0], [1.0, 2.0]], on=["left", "right"])
    >>> list(gusts)
    ['noise 1', 'noise 2']
    """
    kind, own = driving_by("correlated", noise)
    if not isinstance(own, Excitation) or own.kind == "force":
        raise InvalidInput(f"correlated takes a noise such as il.WhiteNoise(1.0), not {own!r}.")
    if len(set(on)) < len(on):
        raise InvalidInput(f"correlated: on must be different names of bodies, not {shown(on)}.")
    matrix = _checked(densities, len(on))
    result: dict[str, Source | BaseMotion] = {}
    for number, (weights, strength) in enumerate(sum_of_squares(matrix), 1):
        size = math.sqrt(strength)
        shares = {body: size * float(weight) for body, weight in zip(on, weights, strict=True) if weight}
        result[f"{name} {number}"] = kind(own, on=shares)
    return result


def driving_by(place: str, noise: Any) -> tuple[type[Source] | type[BaseMotion], Any]:
    """Return the class that drives bodies, forces or motions of the ground, and its noise."""
    if not isinstance(noise, BaseMotion):
        return Source, noise
    if noise.on:
        raise InvalidInput(f"{place} takes a BaseMotion without on=; it names itself what is on the ground.")
    return BaseMotion, noise.acceleration


def _checked(given: Any, count: int) -> np.ndarray:
    """Return a symmetric matrix of a size without negative eigenvalues, or refuse it."""
    array = real_array("correlated: densities", given)
    if array.shape != (count, count):
        raise InvalidInput(f"correlated: densities must be a matrix for {count} bodies, not of shape {array.shape}.")
    wrong = np.argwhere(~np.isfinite(array))
    if len(wrong):
        row, column = wrong[0]
        raise InvalidInput(
            f"correlated: densities must be finite, but the entry ({row + 1}, {column + 1}) is {array[row, column]}."
        )
    if np.abs(array - array.T).max(initial=0.0) > NEGLIGIBLE * np.abs(array).max(initial=0.0):
        raise InvalidInput("correlated: densities must be symmetric.")
    values = np.linalg.eigvalsh(array)
    if values.size and values[0] < -NEGLIGIBLE * np.abs(values).max():
        raise InvalidInput(
            f"correlated: densities must have no negative eigenvalue, but the lowest of {count} is {values[0]:g}: no "
            "noises have these correlations."
        )
    return np.asarray(0.5 * (array + array.T))
