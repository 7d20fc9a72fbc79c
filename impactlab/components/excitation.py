"""Excitations: forces on a body that come from outside the network."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Self

from impactlab.components.component import Component, take_part
from impactlab.components.fields import parameter
from impactlab.components.weights import Weights
from impactlab.errors import InvalidInput
from impactlab.inputs import checked, finite, shown

KINDS = ("intensity", "force", "lines", "filter", "impulses")
"""What an excitation may define: one of white noise, given force, sum of cosines, filtered white noise and impulses."""


class Excitation(Component):
    """A force on a body, defined by exactly one of five things.

    - the kernel ``intensity(time, ...)``: white noise, its two-sided spectral density
      over angular frequency (N2 s rad-1), which may vary in time;
    - the kernel ``force(time, ...)``: a given function of time (N);
    - the method ``lines(self)``: a sum of cosines with random phases, returned as
      angular frequencies (rad s-1) and amplitudes (N);
    - the method ``filter(self)``: what a linear filter makes of white noise, returned as
      the matrix A and the vectors b and c of ``z' = A z + b w``, ``f = c z`` (N), with
      white noise w of the two-sided spectral density 1 over angular frequency, times
      what the kernel ``modulation(time, ...)`` returns where there is one;
    - the method ``impulses(self)``: independent impulses at the times of a Poisson process, returned as
      their rate (s-1), and mean and standard deviation of their normal sizes (N s), times
      what the kernel ``modulation(time, ...)`` returns where there is one.

    The noises of two bodies are independent, also when they share one object; one noise on several bodies is a
    `Source`.

    Examples
    --------
    >>> class Gust(il.Excitation):
    ...     peak: float = il.parameter(units="N2 s rad-1", minimum=0.0)
    ...
    ...     @staticmethod
    ...     def intensity(time, peak):
    ...         return peak / (1.0 + time * time)
    >>> network.replace(excitations={"a": Gust(2.0)}).excitations["a"]
    Gust(peak=2.0)
    """

    kernels: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "intensity": ("time",),
        "force": ("time",),
        "modulation": ("time",),
    }
    kind: ClassVar[str | None] = None
    """Which of the five defines this class; None for an abstract one."""

    required: ClassVar[tuple[str, ...]] = ("kind",)

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if "force" in vars(cls) and "highest_frequency" not in vars(cls):  # that of another force
            cls.highest_frequency = Excitation.highest_frequency  # type: ignore[method-assign]
        defined = [name for name in KINDS if callable(getattr(cls, name, None))]
        if len(defined) > 1:
            raise InvalidInput(
                f"{cls.__name__} defines {' and '.join(defined)}; an excitation must define exactly one of "
                f"{', '.join(KINDS)}."
            )
        cls.kind = defined[0] if defined else None

    @property
    def period(self) -> float:
        """Time after which the force repeats, so that a longer run is refused (s)."""
        return math.inf

    @property
    def phases_of(self) -> str | None:
        """Name of the random phases that a sum of cosines shares with others; None if they are its own.

        Amplitudes that `lines` returns may be complex then, to shift its phases relative to the others.
        """
        return None

    @property
    def known_until(self) -> float:
        """Time up to which the force is known; a longer run is refused (s)."""
        return math.inf

    @property
    def at_rest(self) -> bool:
        """Whether a filter is at rest where a run begins."""
        return False

    @property
    def largest_modulation(self) -> float:
        """Largest size of what the kernel ``modulation`` returns, for which a step is chosen."""
        return 1.0

    @property
    def highest_frequency(self) -> float:
        """Highest angular frequency of a given force that is a sum of cosines at all times, else inf (rad s-1).

        Steps need fewer values of a force whose highest frequency is known.
        """
        return math.inf

    @property
    def multiplied_by(self) -> Excitation | None:
        """The other factor of a force that is a product: what the kernel ``force`` returns is multiplied by it."""
        return None

    @property
    def acts_between(self) -> tuple[float, float]:
        """Times between which the force acts, and is looked at to choose a step (s)."""
        return -math.inf, math.inf


class WhiteNoise(Excitation):
    """Gaussian white noise: ``E[f(t) f(t+τ)] = 2π S δ(τ)``.

    Parameters
    ----------
    spectral_density : float
        Two-sided spectral density S over angular frequency (N2 s rad-1).

    Notes
    -----
    Equation :eq:`white-noise` of the theory.

    Examples
    --------
    >>> il.WhiteNoise.from_one_sided(per_hertz=4 * np.pi).spectral_density
    1.0
    """

    spectral_density: float = parameter(units="N2 s rad-1", minimum=0.0)

    @staticmethod
    def intensity(spectral_density):  # type: ignore[no-untyped-def]
        return spectral_density

    @classmethod
    @checked
    def from_one_sided(cls, per_hertz: float) -> Self:
        """Make white noise from its one-sided density over frequency, S_f = 4π S (N2 Hz-1)."""
        return cls(spectral_density=two_sided(cls, per_hertz))


class Source(Component):
    """One excitation of several bodies, or one more of a body: the force on each is a weight times the excitation.

    A network has it under a name of its own, by which its random numbers are addressed, such as
    ``excitations={"ground": il.Source(il.WhiteNoise(0.2), on={"left": -3.0, "right": -1.0})}`` for the motion of the
    ground below two bodies of 3 and 1 kg, whose displacements are then relative to the ground: 0.2 m2 s-3 rad-1 is the
    spectral density of its acceleration.

    Parameters
    ----------
    excitation : Excitation
        Excitation that drives all the bodies.
    on : mapping of str to float, or str
        Weight of the force on each body, or point of a structure, by its name. A name alone has the weight 1.

    Raises
    ------
    InvalidInput
        If it drives nothing, or a weight is 0 or not finite.

    Examples
    --------
    >>> il.Source(il.WhiteNoise(0.05), on={"left": -2.0, "right": -1.0})
    Source(excitation=WhiteNoise(spectral_density=0.05), on={'left': -2.0, 'right': -1.0})
    """

    excitation: Excitation = parameter(kw_only=False)
    on: Any = parameter()

    def __post_init__(self) -> None:
        super().__post_init__()
        take_part(self, "excitation", Excitation, "an excitation such as il.WhiteNoise(1.0)")
        on = {self.on: 1.0} if isinstance(self.on, str) else self.on
        if not isinstance(on, Mapping):
            raise InvalidInput(f"Source.on must be {{name of a body: weight}}, not {shown(on)}.")
        object.__setattr__(self, "on", _weights("Source", on))

    def to_dict(self) -> dict[str, Any]:
        return {**super().to_dict(), "on": dict(self.on)}


class BaseMotion(Component):
    """Motion of the ground below bodies, by its acceleration a(t): a force −m a on each of them (N).

    Displacements and velocities are then relative to the ground, and so are all statistics: walls, and springs to the
    ground, move with it. For a structure of coordinates x the forces are ``−M ι a``, where ι is 1 for the coordinates
    that follow the ground, all unless some are named, and 0 for others, such as rotations (Chopra, Dynamics of
    Structures, 4th ed., 2012, section 9.4). In a network it has a name of its own, as in
    ``excitations={"ground": il.BaseMotion(il.SampledForce(times, accelerations))}``.

    The displacements of bodies on different grounds, such as those of `impactlab.coherent`, are relative to the ground
    of each. Contacts and couplings between them see the difference of these, without that between the grounds.

    A constant acceleration is gravity: ``il.BaseMotion(il.ConstantForce(9.80665))`` pulls all bodies to the left, where
    displacements are negative. `impactlab.absolute_acceleration` returns absolute accelerations.

    Parameters
    ----------
    acceleration : Excitation
        Any excitation, whose numbers are accelerations (m s-2), or of white noise their spectral density
        (m2 s-3 rad-1).
    on : sequence of str, or mapping of str to float
        Names of bodies, structures or coordinates of structures that follow the ground; all by default. With factors of
        the acceleration they follow it more or less, or against it; that of a coordinate goes before that of its
        structure.

    Raises
    ------
    InvalidInput
        If `on` is not made of names, or a factor is 0 or not finite.

    Examples
    --------
    >>> il.BaseMotion(il.ConstantForce(9.80665))
    BaseMotion(acceleration=ConstantForce(load=9.80665))
    """

    acceleration: Excitation = parameter(kw_only=False)
    on: Any = parameter(())

    def __post_init__(self) -> None:
        take_part(self, "acceleration", Excitation, "an excitation such as il.SampledForce(times, accelerations)")
        on = (self.on,) if isinstance(self.on, str) else self.on
        if isinstance(on, Mapping):
            object.__setattr__(self, "on", _weights("BaseMotion", on))
        elif isinstance(on, Sequence) and all(isinstance(name, str) for name in on):
            object.__setattr__(self, "on", tuple(on))
        else:
            raise InvalidInput(f"BaseMotion.on must be names of bodies, not {shown(self.on)}.")
        super().__post_init__()

    def factor(self, *names: str) -> float:
        """Return the factor of the acceleration of what has some names, the most particular first; 0 if it rests."""
        factors = dict.fromkeys(self.on, 1.0) if isinstance(self.on, tuple) else self.on
        return next((factors[name] for name in names if name in factors), 0.0) if factors else 1.0

    def to_dict(self) -> dict[str, Any]:
        return {**super().to_dict(), "on": list(self.on) if isinstance(self.on, tuple) else dict(self.on)}


def _weights(kind: str, on: Mapping[Any, Any]) -> Weights[float]:
    """Return the weights of bodies by name, or refuse them."""
    if not all(isinstance(name, str) for name in on):
        raise InvalidInput(f"{kind}.on must be {{name of a body: weight}}, not {shown(on)}.")
    if not on:
        raise InvalidInput(f"{kind}.on is empty, so that it drives nothing; name the bodies with their weights.")
    weights = {name: finite(f"{kind}.on: the weight of {name!r}", weight) for name, weight in on.items()}
    for name, weight in weights.items():
        if not weight:
            raise InvalidInput(f"{kind}.on: the weight of {name!r} is 0; leave it out, or give it another.")
    return Weights(weights)


def two_sided(cls: type, per_hertz: float) -> float:
    """Return the two-sided density over angular frequency that a class makes of a one-sided one over frequency."""
    return finite(f"{cls.__name__}.from_one_sided: per_hertz", per_hertz) / (4.0 * math.pi)
