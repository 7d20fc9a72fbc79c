"""Bodies whose motion is given: vibrating tables, driven stops and moving supports."""

from __future__ import annotations

from typing import ClassVar

from impactlab.components.component import Component, take_part
from impactlab.components.excitation import Excitation
from impactlab.components.fields import parameter
from impactlab.components.oscillator import Oscillator

HEAVY = 2.0**100
"""Mass of a body that no force of others moves, even in the last digit (kg)."""


class PrescribedMotion(Component):
    """Body that moves as given, x(t), whatever pushes it: a vibrating table, a driven stop, a moving support.

    It takes the place of an oscillator: contacts, couplings and combinations name it, with all laws, and results have
    its displacement and velocity. The velocity is the derivative of the displacement over half a step on either side,
    of the eighth order. Nothing acts on the body. Networks with one run with `ExactFlow`; their motion is not
    stationary, so that means are over the time of the measurement, and there is no exact law.

    Parameters
    ----------
    displacement : Excitation
        Continuous function of time, whose numbers are displacements (m), such as ``il.Harmonic(0.01, frequency=50.0)``.
        A `Chirp`, a `Pulse` or samples that do not repeat keep their first value before they begin, and the last one
        after they end.

    Raises
    ------
    InvalidInput
        If `displacement` is no excitation; where a network is made, if it is a noise.

    Examples
    --------
    >>> il.PrescribedMotion(il.Harmonic(0.01, frequency=40.0))
    PrescribedMotion(displacement=Harmonic(amplitude=0.01, frequency=40.0))
    """

    moves_as_given: ClassVar[bool] = True

    displacement: Excitation = parameter(kw_only=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        _take_displacement(self)


class PrescribedBody(Oscillator):
    """What a network has in the place of a `PrescribedMotion`: a body too heavy to be moved by any other."""

    moves_as_given: ClassVar[bool] = True

    mass: float = parameter(HEAVY, units="kg", above=0.0)
    displacement: Excitation = parameter()

    def __post_init__(self) -> None:
        super().__post_init__()
        _take_displacement(self)


def _take_displacement(owner: Component) -> None:
    take_part(owner, "displacement", Excitation, "an excitation such as il.Harmonic(0.01, frequency=50.0)")
