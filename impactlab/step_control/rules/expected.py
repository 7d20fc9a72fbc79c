"""Estimates of a motion before it is simulated: energies, relaxation times, spin-up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from impactlab.assembly.mechanism import with_given_motions
from impactlab.assembly.model import Model
from impactlab.errors import InvalidInput
from impactlab.linear.damping import damped
from impactlab.linear.decay import relaxation_time
from impactlab.plan.clock import RELAXATION_TIMES, settles
from impactlab.plan.request import Request
from impactlab.plan.start import start_of
from impactlab.step_control.rules.force_checks import look_at_all, stiffening_of
from impactlab.step_control.rules.relaxation import Relaxation, growth_of, spin_up_of, warn_of_unknown_damping
from impactlab.step_control.rules.tangent_stiffness import Stiffening, energies, measured_energies, moments


@dataclass(frozen=True, eq=False)
class Expected:
    """Estimates of a motion before it is simulated."""

    start: str | np.ndarray  # "stationary", "rest", or displacements and velocities, (2, body, realization)
    spin_up: float  # (s)
    stiffening: Stiffening
    """Tangent stiffness of contacts, couplings and residual forces at the estimated energies of the bodies."""
    measured: Stiffening  # the same at the energies that a measurement of the step met, if there was one
    relaxed: Relaxation
    settling: float  # longest relaxation time of the decay from the start to stationary motion (s)
    usual_spin_up: float  # the given one, or the one that linear motion needs (s)

    @classmethod
    def of(cls, model: Model, request: Request) -> Self:
        """Estimate energies and relaxation times; choose the spin-up if none is given."""
        start, linear = start_of(request.initial, model), relaxation_time(damped(model)[1])
        spin_up, automatic = usual_spin_up(model, request, start)
        usual = spin_up
        if automatic and model.kicks.timed.any() and (growth := growth_of(model)):
            raise InvalidInput(
                f"{growth}, so that no spin-up makes it stationary. Give another depth, frequency or damping of the "
                "stiffness; to see it grow, give initial= or spin_up=0.0."
            )
        if isinstance(start, np.ndarray) and not model.bodies.free.all():
            start = np.stack([with_given_motions(model, start[0], -spin_up), start[1]])
        energy = energies(model, start, request.duration, spin_up)
        stiffening = stiffening_of(model, energy, moments(model, -spin_up, request.duration))
        relaxed = Relaxation.of(model, stiffening)
        if automatic:
            spin_up = spin_up_of(relaxed, spin_up, request.duration)
            warn_of_unknown_damping(model, spin_up)
        measured = stiffening
        if request.mean_square_velocity is not None:
            # rules take all connected bodies to be as hot as the hottest: the smaller energy is closer
            energy = np.minimum(stiffening.energy, measured_energies(model, request.mean_square_velocity))
            if not np.array_equal(energy, stiffening.energy):
                measured = Stiffening.of(model, energy, stiffening.times)
        return cls(start, spin_up, stiffening, measured, relaxed, max(linear, relaxed.settling), usual)

    @property
    def stationary(self) -> bool:
        """Whether the motion is stationary when statistics begin; after a given initial state it is taken not to be."""
        return isinstance(self.start, str) and (self.start == "stationary" or settles(self.spin_up, self.settling))


def usual_spin_up(model: Model, request: Request, start: str | np.ndarray) -> tuple[float, bool]:
    """Return the given spin-up, or the spin-up that linear motion needs (s), and whether it is still to be chosen."""
    if request.spin_up is not None:
        return request.spin_up, False
    # a free motion, or one from rest or a given state that was asked for, is a transient: all of it counts
    led = model.kicks.timed.any() or not model.bodies.free.all()
    automatic = not request.from_rest and isinstance(start, str) and bool(model.network.excitations or led)
    return RELAXATION_TIMES * relaxation_time(damped(model)[1]) if automatic else 0.0, automatic


def expect_together(scenes: Sequence[tuple[Model, Request]]) -> None:
    """Evaluate the forces of several networks in one pass and store the results where `Expected.of` finds them."""
    heats = []
    for model, request in scenes:
        start = start_of(request.initial, model)
        heats.append(energies(model, start, request.duration, usual_spin_up(model, request, start)[0]))
    look_at_all([model for model, _ in scenes], heats)
