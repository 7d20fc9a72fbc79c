"""Whether a run keeps its state in registers, and what the compiler must know for that."""

from __future__ import annotations

import numpy as np

from impactlab.assembly.mechanism import Mode
from impactlab.integrators.exact_flow import ExactFlow
from impactlab.integrators.stretches import MOST_BODIES, MOST_LINKS, Layout
from impactlab.plan.plan import Plan


def layout_of(plan: Plan) -> Layout | None:
    """Return the layout of a plan whose blocks have one lane of few bodies, None of others.

    All else is left to the loop of all networks.
    """
    system, noise, forces = plan.system, plan.noise, plan.forces
    small = len(system.bodies) <= MOST_BODIES and len(system.links) <= MOST_LINKS
    met = Mode.REGISTERS not in system.refusals
    if not (plan.single and small and met and plan.method.step is ExactFlow.step):
        return None
    return Layout(
        text=forces.text,
        indices=tuple(forces.indices.tolist()),
        rows=tuple(noise.rows.tolist()),
        runs=tuple(map(tuple, noise.runs.tolist())),
        seconds=len(np.unique(noise.rows)),
        forced=tuple(plan.driving.forced.tolist()),
        given=tuple(plan.driving.forces.tolist()),
        coefficients=plan.method.coefficients.shape,
        contacts=len(system.ends),
        passes=forces.passes,
    )
