"""Steps in time."""

from __future__ import annotations

from dataclasses import dataclass

from impactlab.rules import SETTLED


@dataclass(frozen=True, eq=False)
class Clock:
    """Steps, and the times that they are measured by.

    Attributes
    ----------
    step : float
        (s)
    spin_up_steps, steps : int
        Before statistics begin, and of the statistics.
    boundaries : tuple of int
        Steps at which batches end; the last is `steps`.
    relaxation : float
        Longest time after which samples are independent (s), 0 if nothing is damped.
    settling : float
        Relaxation time of what the start does not know (s).
    automatic : float
        The step that is chosen where none is given (s); 0 where none can be. Where a larger one was measured, that from
        which its biases are to be expected to grow with its square.
    certified : bool
        Whether the automatic step of such a network is right without a measurement.
    """

    step: float
    spin_up_steps: int
    steps: int
    boundaries: tuple[int, ...]
    relaxation: float
    settling: float
    automatic: float
    certified: bool

    @property
    def spin_up(self) -> float:
        """Time before statistics begin (s)."""
        return self.spin_up_steps * self.step

    @property
    def duration(self) -> float:
        """Time of the statistics (s)."""
        return self.steps * self.step

    @property
    def all_steps(self) -> int:
        """Steps of the whole run."""
        return self.spin_up_steps + self.steps

    @property
    def settled(self) -> bool:
        """Whether the spin-up is long enough for balances to be used."""
        return settles(self.spin_up, self.settling)


def settles(spin_up: float, settling: float) -> bool:
    """Whether a motion is stationary after a spin-up, by the relaxation time of what its start does not know (s)."""
    return spin_up >= SETTLED * settling * (1.0 - 1e-9)
