"""Couplings with events as rows behind those of contacts: dry friction, alone or behind springs, and kinked springs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from impactlab.assembly.links import Links
from impactlab.assembly.model import Model
from impactlab.components.coupling import CoulombFrictionCoupling
from impactlab.components.hysteresis import JenkinsCoupling
from impactlab.components.springs import BilinearCoupling
from impactlab.errors import InvalidInput
from impactlab.kernels.contact_states import FRICTION, JENKINS, SPRING


class Rows(NamedTuple):
    """Rows of couplings, each with a direction and numbers as a contact has them."""

    names: tuple[str, ...]
    links: np.ndarray  # (row, body) weights in the extension, or in its negative
    kinds: np.ndarray  # (row,)
    springs: np.ndarray  # (row,)
    clearance: np.ndarray  # (row,)
    frictions: np.ndarray  # (row, 3) forces of sliding and breakaway, and the velocity of the surface


def rows_of_couplings(model: Model) -> Rows:
    """Return the couplings of a network that have events, those with sliders last.

    A spring with kinks is a linear one with two contacts that add to it beyond the kinks, or take away.
    """
    extension, free = -weights(model.coupled), model.bodies.free
    rows: list[tuple[int, float, int, float, float, tuple[float, ...]]] = []
    for row, law in enumerate(model.couplings.laws):
        if isinstance(law, BilinearCoupling):
            beyond = law.outer_stiffness - law.stiffness
            rows += [(row, way, SPRING, beyond, law.break_extension, (0.0, 0.0, 0.0)) for way in (1.0, -1.0)]
        elif isinstance(law, CoulombFrictionCoupling) and law.friction > 0.0 and extension[row, free].any():
            numbers = law.friction, law.static_ratio * law.friction, law.velocity
            rows.append((row, 1.0, FRICTION, 0.0, 0.0, numbers))
    rows += [
        (row, 1.0, JENKINS, law.stiffness, 0.0, (law.slip_force, law.slip_force, 0.0))
        for row, law in sliding_couplings(model)
    ]
    places, ways, kinds, springs, clearance, frictions = zip(*rows, strict=True) if rows else ((),) * 6
    return Rows(
        tuple(model.couplings.names[row] for row in places),
        np.array(ways).reshape(-1, 1) * extension[np.array(places, dtype=np.int64)],
        np.array(kinds, dtype=np.int64),
        np.array(springs),
        np.array(clearance),
        np.array(frictions).reshape(-1, 3),
    )


def sliding_couplings(model: Model) -> list[tuple[int, JenkinsCoupling]]:
    """Return the couplings with sliders, and their places."""
    found = [(row, law) for row, law in enumerate(model.couplings.laws) if isinstance(law, JenkinsCoupling)]
    for row, law in found:
        if law.stiffness == 0.0:
            raise InvalidInput(
                f"EventLocated knows no JenkinsCoupling without stiffness such as {model.couplings.names[row]!r}; "
                "leave it out."
            )
    return found


def inner_springs(model: Model) -> np.ndarray:
    """Return the stiffness of each coupling with kinks before these, (coupling,)."""
    return np.array([law.stiffness if isinstance(law, BilinearCoupling) else 0.0 for law in model.couplings.laws])


def weights(links: Links) -> np.ndarray:
    """Return the weight of each body in each link, (link, body)."""
    result = np.zeros((len(links), links.count + 1))
    np.add.at(result, (links.rows, links.slots), links.weights)
    return result[:, :-1]
