"""What a mechanism is, and the questions that stages ask all mechanisms of a network.

A *mechanism* is one way in which forces or motion arise in a network, such as white noise. A *mode* is a way of running
other than plain blocks, such as tiles. Each mechanism names the modes that it can meet. A mode that it does not name is
not taken for any network that has the mechanism.

Mechanisms stand in `impactlab.mechanisms`, above the stages: no stage imports one. A stage asks all of
`Model.mechanisms`, by a method of `Mechanism`, which has the answer of a mechanism that is not concerned.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from enum import Enum
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np

from impactlab.assembly.links import Links
from impactlab.assembly.model import KNOWN, Model
from impactlab.assembly.remembered import kept
from impactlab.components.excitation import Excitation
from impactlab.errors import InvalidInput


class Mode(Enum):
    """A way of running, or a rule, that not every mechanism can meet."""

    ONE_LANE = "blocks of one lane, in arrays without an axis of lanes"
    REGISTERS = "a state of few bodies that is kept in registers for several steps"
    TILES = "tiles of a large network"
    INTERVALS = "contact-free intervals, each crossed in one transition"
    SAMPLES = "statistics of a stationary motion, from samples of it"
    SIDE_BY_SIDE = "several networks in one run"
    IDLE_BODIES = "bodies that nothing else acts on, simulated apart"
    FINE_FLOW = "friction at one moment of a step, within the bias that an accuracy allows"
    CERTIFIED_STEP = "a step that is right without a measurement"
    LOCATED = "exact motion from event to event, without steps"
    FORCES = "forces as a function of displacements, velocities, states and time"


class Method(Protocol):
    """The properties of an integrator that mechanisms use; see `impactlab.integrators.base.Integrator`."""

    handles: ClassVar[tuple[str, ...]]
    collides: ClassVar[bool]
    takes_response: ClassVar[bool]
    makes_steps: ClassVar[bool]

    @property
    def samples_per_step(self) -> int: ...


class Load(NamedTuple):
    """A function of time, and the forces by which it pushes bodies."""

    bodies: np.ndarray  # (n,) slots
    function: Excitation
    weights: np.ndarray  # (n,) force by the function
    of_rate: np.ndarray  # (n,) force by the rate of the function
    span: tuple[float, float] = (-math.inf, math.inf)  # times outside of which it stays as it is (s)


class Mechanism:
    """One way in which forces or motion arise; a class that derives from this one becomes known."""

    name: ClassVar[str]
    """The mechanism in the words of messages, in the plural."""

    modes: ClassVar[frozenset[Mode]] = frozenset()
    """Modes in which the mechanism has the numbers of plain blocks."""

    in_flow: ClassVar[bool] = False
    """Whether it locates events, such as impacts, within the flow of a step; it then has `events`."""

    strikes: ClassVar[bool] = False
    """Whether these events change velocities at once."""

    def __init_subclass__(cls, family: bool = False) -> None:
        if not family:  # others derive from it
            KNOWN.append(cls())

    def there(self, model: Model) -> bool:
        """Whether a network has the mechanism."""
        raise NotImplementedError

    def bodies(self, model: Model) -> np.ndarray:
        """Whether the mechanism acts on each body of a network that has it, (body,) of bool."""
        return np.ones(len(model.bodies), dtype=bool)

    def place(self, model: Model) -> str:
        """Return the name of the first body, contact or coupling of a network that has it."""
        return model.bodies.names[int(self.bodies(model).argmax())]

    def example(self, model: Model) -> str:
        """Return the name of the mechanism and of the first place where a network has it."""
        return f"{self.name} such as {self.place(model)!r}"

    def followed(self, model: Model) -> np.ndarray | None:
        """Return where the mechanism follows bodies through the events of a step, so that it must hear of strikes.

        Rows are which of its links follows each body, and which entry of its links the body is, (2, body); −1 for none.
        """
        return None

    def largest_step(self, model: Model) -> float:
        """Return the largest step that the mechanism allows (s)."""
        return math.inf

    def events(self, model: Model, step: float, seed: tuple[int, int], energy: np.ndarray | float) -> Any:
        """Return the part of a plan that locates events: an `impactlab.plan.events.EventPart`.

        Parameters
        ----------
        model : Model
        step : float
            (s)
        seed : tuple of int
        energy : (body,) ndarray or float
            Typical energies of the bodies (J).
        """
        raise NotImplementedError

    def motions(self, model: Model, systems: Any) -> tuple[Any, ...]:
        """Return the linear motions under the noises of the mechanism, of single bodies and of systems of bodies.

        Each is an `impactlab.linear.noise_motion.NoiseMotion`; systems are those of
        `impactlab.linear.laws.coupled_systems`. White noises and sums of cosines have none.
        """
        return ()

    def labels(self, model: Model) -> list[str]:
        """Return the names of the states of its processes, such as "left.0", from which a run can go on."""
        return []

    def rates(self, model: Model) -> np.ndarray:
        """Return the rates at which these states forget how they began (s-1)."""
        return np.zeros(0)

    def density(self, model: Model, frequency: float) -> np.ndarray | float:
        """Return the spectral density of the noises that are not white at a frequency (rad s-1), (body,)."""
        return 0.0

    def sudden_energies(self, model: Model, begin: float, end: float) -> np.ndarray | float:
        """Return ``m v²`` of each body after a sudden push that few between two times (s) exceed, (body,) (J)."""
        return 0.0

    def given_motions(self, model: Model) -> tuple[tuple[int, Excitation], ...]:
        """Return slots and displacements of the bodies whose motion the mechanism gives, whatever pushes them."""
        return ()

    def loads(self, model: Model) -> Iterator[Load]:
        """Yield the functions of time by which the mechanism pushes linear bodies."""
        return iter(())

    def sampled_step(self, model: Model) -> float:
        """Return the largest step at which samples of its forces have nearly their spectral density (s)."""
        return math.inf

    def process(self, model: Model, method: Method, step: float, seed: tuple[int, int], finer: int) -> Any:
        """Return the part of a plan with a process that pushes bodies, `impactlab.plan.processes.ProcessPart`, or None.

        Parameters
        ----------
        model : Model
        method : Method
            The integrator.
        step : float
            (s)
        seed : tuple of int
        finer : int
            Samples of the process in one that is taken.
        """
        return None

    def refuse(self, model: Model, method: Method) -> None:
        """Refuse an integrator that does not know the mechanism, or a network in which it cannot be followed.

        Raises
        ------
        InvalidInput
            Names the place, and what would work.
        """


ALL = frozenset(Mode)


def refusing(model: Model, mode: Mode) -> tuple[Mechanism, ...]:
    """Return the mechanisms of a network that cannot meet a mode."""
    return tuple(item for item in model.mechanisms if mode not in item.modes)


def refusals(model: Model) -> dict[Mode, str]:
    """Return the modes that a network cannot meet, and the names of the mechanisms that cannot."""
    each = {mode: ", ".join(item.name for item in refusing(model, mode)) for mode in Mode}
    return {mode: names for mode, names in each.items() if names}


def check_method(model: Model, method: Method) -> None:
    """Refuse an integrator that does not know every mechanism of a network."""
    for item in model.mechanisms:
        item.refuse(model, method)


@kept
def interrupted(model: Model) -> np.ndarray:
    """Whether events are located in the motion of each body between kicks, (body,) of bool."""
    return _bodies([item for item in model.mechanisms if item.in_flow], model)


def struck(model: Model) -> np.ndarray:
    """Whether events may change the velocity of each body at once, (body,) of bool."""
    return _bodies([item for item in model.mechanisms if item.strikes], model)


def followed(model: Model) -> np.ndarray:
    """Return which link of a mechanism follows each body through the events of a step; see `Mechanism.followed`."""
    found = [item for mechanism in model.mechanisms if (item := mechanism.followed(model)) is not None]
    if len(found) > 1:
        raise NotImplementedError("One mechanism of a network at most may follow bodies through the events of a step.")
    return found[0] if found else np.full((2, len(model.bodies)), -1)


def state_labels(model: Model) -> list[str]:
    """Return the names of the states of all processes of a network."""
    return [label for item in model.mechanisms for label in item.labels(model)]


def given_motions(model: Model) -> tuple[tuple[int, Excitation], ...]:
    """Return slots and displacements of the bodies of a network whose motion is given."""
    return tuple(pair for item in model.mechanisms for pair in item.given_motions(model))


def with_given_motions(model: Model, displacement: np.ndarray, time: float) -> np.ndarray:
    """Return displacements, (body,) or (body, realization), with those of bodies of given motion at a time (s)."""
    result = displacement.copy()
    for slot, item in given_motions(model):
        result[slot] = item.call("force", np.clip(np.array([time]), *item.acts_between))[0]
    return result


def sampled_step(model: Model) -> float:
    """Return the largest step at which samples of all forces have nearly their spectral density (s)."""
    return min((item.sampled_step(model) for item in model.mechanisms), default=math.inf)


def largest_step(model: Model) -> float:
    """Return the largest step that all mechanisms of a network allow (s)."""
    return min((item.largest_step(model) for item in model.mechanisms), default=math.inf)


def _bodies(mechanisms: Sequence[Mechanism], model: Model) -> np.ndarray:
    """Whether one of some mechanisms acts on each body, (body,) of bool."""
    none = np.zeros(len(model.bodies), dtype=bool)
    return np.asarray(np.logical_or.reduce([none, *(item.bodies(model) for item in mechanisms)]))


def refuse_unless(knows: bool, mechanism: Mechanism, model: Model, method: Method) -> None:
    """Refuse an integrator unless it knows a mechanism of a network."""
    if not knows:
        raise InvalidInput(f"{type(method).__name__} knows no {mechanism.example(model)}; use il.ExactFlow().")


def at(model: Model, slots: Sequence[int] | np.ndarray) -> np.ndarray:
    """Return whether each body stands at one of the slots, (body,) of bool; the wall is left out."""
    result = np.zeros(model.wall + 1, dtype=bool)
    result[np.asarray(slots, dtype=np.int64)] = True
    return result[:-1]


def linked(model: Model, links: Links, chosen: np.ndarray) -> np.ndarray:
    """Return whether each body has one of the chosen links, (body,) of bool."""
    return at(model, links.chosen(chosen).slots)
