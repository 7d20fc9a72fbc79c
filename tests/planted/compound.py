"""Bugs in combinations of coordinates, noises of several bodies, structures, and laws with states or time."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from impactlab.assembly import sources
from impactlab.assembly.links import Combinations
from impactlab.components.linear_structure import LinearStructure
from impactlab.integrators import exact_flow
from impactlab.simulation import block
from planted.compound_scenes import CREEPING, LEVER, PULSATING, TOWER
from planted.plant import Bug, Plant, returned, text


def combined(change: Any) -> Plant:
    """Change the weights of links with weights."""
    return returned(Combinations, "of", lambda links, *_: replace(links, weights=change(links.weights)))


def apart(rows: Any, *_: Any) -> Any:
    """A normal number of its own for every body."""
    return rows._replace(numbers=np.arange(len(rows.bodies)))


def springs_only(terms: Any, *_: Any) -> Any:
    return [item._replace(damping=0.0) for item in terms]


UPDATED = "MaxwellCoupling_force_update(x[second + member, lane] - x[first + member, lane], parameters[-1], "

BUGS = [
    Bug("combination without the signs of its weights", LEVER, combined(np.abs)),
    Bug("combination of equal weights", LEVER, combined(np.sign)),
    Bug("one noise without the signs of its weights", LEVER,
        returned(sources, "Drives", lambda drives, *_: drives._replace(weight=np.abs(drives.weight)))),
    Bug("one noise drawn anew for every body", LEVER, returned(exact_flow, "rows_of_source", apart)),
    Bug("structure without the dampers between its coordinates", TOWER,
        returned(LinearStructure, "terms", springs_only)),
    Bug("structure with positive springs between coordinates only", TOWER,
        returned(LinearStructure, "terms", lambda terms, *_: [item for item in terms if len(item.weights) == 2])),
    Bug("state that is updated for half a step", CREEPING, text(UPDATED, UPDATED.replace("[-1]", "[-1] / 2.0"))),
    Bug("force by the state at the beginning of the step", CREEPING,
        text("force = MaxwellCoupling_force(extension, pull_)",
             "force = MaxwellCoupling_force(extension, remembered_0[member, lane])")),
    Bug("laws at the time of the beginning of a step", PULSATING,
        text("time = parameters[-2] + parameters[-1]", "time = parameters[-2]")),
    Bug("laws whose time begins with the spin-up", PULSATING,
        returned(block, "Steps", lambda steps, *_: steps._replace(spin_up=0))),
]  # fmt: skip
