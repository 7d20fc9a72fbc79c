"""The method for networks in which nothing is random, and the networks that it can follow."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np

from impactlab.assembly.mechanism import Mode, check_method, given_motions, refusing
from impactlab.assembly.model import Model
from impactlab.components.fields import parameter
from impactlab.components.loads import ConstantForce, Harmonic
from impactlab.errors import InvalidInput
from impactlab.integrators.base import Integrator

MOST_TOLERANCE = 1e-3
"""Largest tolerance: beyond it a bouncing would be taken for rest that anybody can see."""


class EventLocated(Integrator):
    """Exact motion from event to event, for networks in which nothing is random.

    Between events the motion of linear bodies is a sum of exponentials and waves, which is known at any time without
    steps. Events, where a contact opens, closes or begins to rest, or a body slips or sticks, are located to rounding.
    The search for the next one takes times for which bounds of the second and fifth derivatives of all gaps exclude an
    event, so that none is missed, however short or grazing the contact is; ``undecided_touches`` of the result counts
    the touches that rounding leaves open. ``path_error`` estimates the error of displacements, from what rounding adds
    in each piece and what the motion and its events make of it.

    Events at one time follow in the order of the contacts, as do impacts of rigid contacts that touch each other. The
    endlessly many bounces with which a rigid contact comes to rest are followed until they are lower than the
    tolerance, and their series is summed from there on.

    Dry friction slips, turns and sticks where its slip rate passes 0: it sticks where the force that holds it is within
    the breakaway force, and what this changes for other frictions follows at the same time.

    Motion is exact where bodies and structures are linear; couplings are, or are `BilinearCoupling`, `JenkinsCoupling`
    and `CoulombFrictionCoupling`; contacts have `LinearContact`, `KelvinVoigtContact` or `RigidContact`; motions are
    `Harmonic` or `ConstantForce`, or sums of several of these by `Source`; and forces are any functions of time, which
    are approximated by polynomials to rounding unless they are sums of these, too. A function that acts for less than a
    third of a radian of the fastest body may be overlooked, unless it tells by ``acts_between`` when it acts.

    Other networks whose forces are functions of displacements, velocities, states of laws and time are followed by
    steps of order eight that end where contacts open and close (J. R. Dormand and P. J. Prince, J. Comput. Appl. Math.
    6, 1980, 19; E. Hairer, S. P. Nørsett and G. Wanner, Solving Ordinary Differential Equations I, 1993). Laws that
    yield, such as `BoucWenCoupling` and `WaltonBraunContact`, end steps where their extensions turn, and where their
    states have kinks. Rigid contacts bounce, come to rest and are released as in linear motion. Within a step a gap
    differs from the polynomial of its values, rates and accelerations at both ends by an error that accelerations in
    between show; bounds of both exclude a passage, or the step ends there, at the passage or at the top of the gap. So
    no contact of the path is missed, however short it is, as far as the errors of steps are estimated rightly;
    ``undecided_touches`` counts the touches that the error of a step leaves open. ``path_error`` is the distance from a
    path of ten times the tolerance, at the samples. Beside smooth nonlinear laws, dry friction that
    sticks is refused, as are contacts in a plane: use `ExactFlow`.

    Parameters
    ----------
    tolerance : float
        Error of a path, about, as a part of the largest displacement of each body, under smooth nonlinear forces. And
        height of the bounces below which a rigid contact rests, as a part of that to which its fastest impact so far
        would lead.

    Notes
    -----
    No event is missed, by the bounds of equation :eq:`gap-bounds` of the theory.

    Examples
    --------
    >>> il.EventLocated()
    EventLocated()
    """

    makes_steps: ClassVar[bool] = False
    order: ClassVar[float | None] = math.inf
    handles: ClassVar[tuple[str, ...]] = ("force",)
    collides: ClassVar[bool] = True
    takes_response: ClassVar[bool] = True

    def recommended_step(self, model: Model, tangent: np.ndarray, residual: np.ndarray | float = 0.0) -> float:
        raise InvalidInput(
            "EventLocated makes no steps: it runs in il.simulate and il.sweep without step=; use il.ExactFlow() here."
        )

    def largest_step(self, model: Model, tangent: np.ndarray, residual: np.ndarray | float = 0.0) -> float:
        return self.recommended_step(model, tangent, residual)

    tolerance: float = parameter(1e-10, above=0.0, maximum=MOST_TOLERANCE, kw_only=False)


def linear_between_events(model: Model) -> bool:
    """Whether the motion is linear between events, under forces whose responses are known."""
    laws = zip(model.contacts.laws, model.contacts.impulsive, strict=True)
    return (
        not refusing(model, Mode.LOCATED)
        and all(type(motion) in (Harmonic, ConstantForce) for _, motion in given_motions(model))
        and all(impulsive or law.linear is not None for law, impulsive in laws)
    )


def check(model: Model, method: EventLocated) -> None:
    """Refuse a network that the method cannot follow; the message names the place."""
    check_method(model, method)
    if linear_between_events(model):
        return
    for mechanism in refusing(model, Mode.FORCES):
        if Mode.LOCATED in mechanism.modes and (mechanism.strikes or not mechanism.in_flow):
            continue  # rigid contacts, whose impacts end steps, and given motions
        raise InvalidInput(f"EventLocated knows no {mechanism.example(model)}; use il.ExactFlow().")
    for slot, motion in given_motions(model):
        if type(motion) not in (Harmonic, ConstantForce):
            raise InvalidInput(
                f"EventLocated knows no {type(motion).__name__} such as that of {model.bodies.names[slot]!r} beside "
                "nonlinear laws, but il.Harmonic and il.ConstantForce; use il.ExactFlow()."
            )
    if model.contacts.round.any():
        raise InvalidInput("EventLocated knows no contacts in a plane; use il.ExactFlow().")
