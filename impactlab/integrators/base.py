"""What every integrator is."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from impactlab.assembly.model import Model
from impactlab.components.component import Component
from impactlab.errors import InvalidInput
from impactlab.integrators.arguments import Cross, Flows, NoiseRows


class Integrator(Component):
    """A method that carries a block of realizations through time.

    A subclass is one module: a function that makes a step, and what it can do and how large the step may be.

    Examples
    --------
    >>> isinstance(il.ExactFlow(), il.Integrator)
    True
    """

    order: ClassVar[float | None] = None
    """Order of convergence of paths under smooth forces."""

    handles: ClassVar[tuple[str, ...]] = ()
    """Kinds of excitation, of `impactlab.components.excitation.KINDS`."""

    makes_steps: ClassVar[bool] = True
    """Whether the method makes steps, not pieces of motion from event to event."""

    kicks: ClassVar[bool] = False
    """Whether forces act as kicks, which the processed statistics and the balances need."""

    phases: ClassVar[int] = 1
    """Steps after which the method repeats itself."""

    blocks: ClassVar[int] = 0
    """Blocks of numbers, [body, lane] each, that a step works in."""

    reach: ClassVar[int] = 0
    """Contacts that a force reaches in a step, one more if it depends on velocities; 0 if nothing runs in tiles."""

    takes_response: ClassVar[bool] = False
    """Whether a series is the linear response (x, v) instead of the force, and given forces are integrated."""

    collides: ClassVar[bool] = False
    """Whether mechanisms locate events within the flow of a step; see `impactlab.integrators.located`."""

    required: ClassVar[tuple[str, ...]] = ("order",)

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if "step" in vars(cls):  # of what others do in a step this one may do nothing
            for name, least in (("reach", 0), ("collides", False)):
                if name not in vars(cls):
                    setattr(cls, name, least)

    @staticmethod
    def step(forces, tables, driven, state, history, steps, index):  # type: ignore[no-untyped-def]
        """Make a step; this is the text of a function that is compiled for the loop in `impactlab.integrators.driver`.

        It replaces ``state.x, state.v`` by the state after the step. In a slot of the history it writes the numbers
        for the sums; and where `sampled`, `state.reading`, `state.velocity` and `state.contact_force`.

        Parameters
        ----------
        forces : function
            See `impactlab.compiling.force_type.Forces`.
        tables : Tables
        driven : Driven
            With the noise and the series of the step.
        state : State
        history : History
        steps : Steps
        index : int
            Number of the step.
        """
        raise NotImplementedError

    @staticmethod
    def accepted(state, middle, steps):  # type: ignore[no-untyped-def]
        """Return displacements and velocities at which a step is accepted, where laws update their states.

        And the half of a kick in whose middle these velocities are (s), or 0.

        This is a text as well.

        Parameters
        ----------
        state : State
            After the step.
        middle : [body, lane]
            Velocities that the step has left in the history.
        steps : Steps
        """
        return state.x, state.v, 0.0

    @property
    def samples_per_step(self) -> int:
        """Samples of a series or a given force that a step takes."""
        return 1

    def arrange(self, model: Model, tangent: np.ndarray, residual: np.ndarray | float = 0.0) -> Model:
        """Return the model with the couplings that the method treats as linear motion.

        Parameters as for `largest_step`; all other functions take the returned model.
        """
        return model

    def cross(self, model: Model, step: float) -> Cross:
        """Return the linear motion between bodies; nothing where they move by themselves."""
        none = np.zeros((0, 4))
        return Cross(np.zeros((0, 2), np.int64), none, none, none, np.zeros((2, 0), np.int64))

    def tableau(self) -> np.ndarray:
        """Return nodes and weights of an explicit method, (2, stage)."""
        return np.zeros((2, 0))

    def coefficients(self, model: Model, step: float) -> np.ndarray:
        """Return the numbers per body that the loop takes, (phase, body, column)."""
        raise NotImplementedError

    def noise(self, model: Model, step: float) -> NoiseRows:
        """Return the rows of white noise."""
        raise NotImplementedError

    def flows(self, model: Model, step: float) -> Flows | None:
        """Return the linear motion between kicks, None for a method that does not kick."""
        return None

    def largest_step(self, model: Model, tangent: np.ndarray, residual: np.ndarray | float = 0.0) -> float:
        """Return the largest step at which the method is stable (s).

        Parameters
        ----------
        model : Model
            The network.
        tangent : (link,) ndarray
            Stiffness of the contacts when they are closed, then of the couplings (N m-1).
        residual : (body,) ndarray
            Stiffness of the residual forces (N m-1).
        """
        raise NotImplementedError

    def recommended_step(self, model: Model, tangent: np.ndarray, residual: np.ndarray | float = 0.0) -> float:
        """Return the step that is chosen when none is given (s)."""
        raise NotImplementedError


def frequencies(model: Model, tangent: np.ndarray, stiffness: np.ndarray | None = None) -> np.ndarray:
    """Natural frequencies with springs in the place of contacts and couplings, in increasing order (rad s-1).

    Bodies have springs of their own, or others of a stiffness that is given (N m-1). The largest frequency is bounded
    from above (Gershgorin) where there are many bodies.
    """
    own = model.stiffness if stiffness is None else stiffness
    if len(model.bodies) <= 300:
        matrix = np.diag(own) + model.links.springs(tangent)
        scale = 1.0 / np.sqrt(model.mass)
        return np.sqrt(np.maximum(np.linalg.eigvalsh(scale[:, None] * matrix * scale), 0.0))
    inverse = 1.0 / model.mass
    return np.asarray(np.sqrt(np.sort(model.links.with_row_sums(own * inverse, tangent, inverse))))


def coupling_rate(model: Model) -> float:
    """Largest rate at which the dampers of couplings that kick, alone, would slow the bodies down (s-1)."""
    dampers = np.concatenate([np.zeros(len(model.ends)), model.couplings.linear[1] * ~model.couplings.flowing])
    return float(frequencies(model, dampers, np.zeros_like(model.stiffness))[-1] ** 2) if dampers.any() else 0.0


def check_integrator(integrator: Any) -> None:
    """Refuse what is not an integrator."""
    if not isinstance(integrator, Integrator):
        raise InvalidInput(f"integrator must be one such as il.ExactFlow(), not {integrator!r}.")
