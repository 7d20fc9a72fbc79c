"""What is expected of a motion before it is simulated."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from impactlab.assembly.model import Model
from impactlab.linear.damping import damped
from impactlab.linear.laws import relaxation_time
from impactlab.nonlinear.force_checks import stiffening_of
from impactlab.nonlinear.relaxation import Relaxation, spin_up_of, warn_of_unknown_damping
from impactlab.nonlinear.tangent_stiffness import Stiffening, energies, met_energies
from impactlab.plan.clock import RELAXATION_TIMES, settles
from impactlab.plan.start import start_of
from impactlab.simulation.request import Request


@dataclass(frozen=True, eq=False)
class Expected:
    """What is expected of a motion before it is simulated.

    Attributes
    ----------
    start : str or ndarray
        "stationary", "rest", or displacements and velocities, (2, body).
    spin_up : float
        (s)
    stiffening, met : Stiffening
        The scene at its energies, and at those that were met.
    relaxed : Relaxation
    settling : float
        Relaxation time of what the start does not know (s).
    """

    start: str | np.ndarray
    spin_up: float
    stiffening: Stiffening
    met: Stiffening
    relaxed: Relaxation
    settling: float

    @classmethod
    def of(cls, model: Model, request: Request) -> Self:
        """Estimate energies and relaxation times, and choose the spin-up where it is not given."""
        start, spin_up = start_of(request.initial, model), request.spin_up
        linear = relaxation_time(damped(model)[1])
        automatic = spin_up is None and isinstance(start, str) and bool(model.network.excitations)
        if spin_up is None:
            spin_up = RELAXATION_TIMES * linear if automatic else 0.0
        stiffening = stiffening_of(model, energies(model, start, request.duration, spin_up))
        relaxed = Relaxation.of(model, stiffening)
        if automatic:
            spin_up = spin_up_of(relaxed, spin_up, request.duration)
            warn_of_unknown_damping(model, spin_up)
        met = stiffening
        if request.velocity is not None:
            met = Stiffening.of(model, np.minimum(stiffening.energy, met_energies(model, request.velocity)))
        return cls(start, spin_up, stiffening, met, relaxed, max(linear, relaxed.settling))

    @property
    def settled(self) -> bool:
        """Whether the motion is stationary when statistics begin."""
        rested = settles(self.spin_up, self.settling)
        return isinstance(self.start, str) and (self.start == "stationary" or rested)
