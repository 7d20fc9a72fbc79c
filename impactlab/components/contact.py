"""Contacts between two bodies, or a body and a wall, also in a plane, and the laws of their forces."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np

from impactlab.components.component import Component, take_part
from impactlab.components.evaluation import call_each
from impactlab.components.fields import parameter
from impactlab.components.literature import article
from impactlab.components.sides import WALL, Direction, Side, Wall, check_directions, check_sides
from impactlab.errors import InvalidInput
from impactlab.inputs import FiniteNumbers, checked, finite, of_one_shape, positive

if TYPE_CHECKING:
    from impactlab import Uncertain


class ContactLaw(Component):
    """Force of a closed contact as a function of its indentation.

    Subclasses define the kernel ``force(indentation, rate, ...)`` (N, positive in
    compression), which must be finite at zero indentation, and, if the force has one,
    the kernel ``potential(indentation, ...)`` (J, 0 at 0), which makes exact
    stationary laws possible. A law with fields that are a `impactlab.state` defines
    ``update(indentation, rate, elapsed, ...)``, which returns their values at an
    indentation (negative where the contact is open), `elapsed` seconds after they had
    those that it is given; ``force`` is given what ``update`` returns. Either may take the
    `time` since the beginning of the measurement (s) as well; a contact is closed where its
    indentation is positive, also where such a law has no force.

    Examples
    --------
    >>> class Conical(il.ContactLaw):
    ...     stiffness: float = il.parameter(units="N m-2", minimum=0.0)
    ...
    ...     @staticmethod
    ...     def force(indentation, stiffness):
    ...         return stiffness * indentation * indentation
    >>> Conical(1e6).evaluate([0.01, 0.02])
    array([100., 400.])
    """

    kernels: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "force": ("indentation", "rate", "time"),
        "potential": ("indentation",),
        "update": ("indentation", "rate", "elapsed", "time"),
    }
    required: ClassVar[tuple[str, ...]] = ("force",)

    restitution_field: ClassVar[str] = ""
    """Name of the field that `calibrate` changes; of laws that can lose energy."""

    impulsive: ClassVar[bool] = False
    """Whether each impact, located within the flow of a step, is an impulse in the place of a force."""

    @property
    def linear(self) -> tuple[float, float] | None:
        """Stiffness (N m-1) and damping (N s m-1) of a law that is linear while the contact is closed; else None."""
        return None

    @checked
    def evaluate(self, indentation: FiniteNumbers, rate: FiniteNumbers = 0.0, time: FiniteNumbers = 0.0) -> np.ndarray:
        """Return the contact force for arrays of indentations and their rates, from the start values of states.

        Parameters
        ----------
        indentation : array_like
            Indentation (m); the contact is open where it is not positive.
        rate : array_like
            Rate of the indentation (m s-1).
        time : array_like
            Time since the beginning of the measurement (s).

        Returns
        -------
        ndarray
            Force (N), 0 where the contact is open.
        """
        indentation, rate, time = of_one_shape(type(self).__name__, *map(np.asarray, (indentation, rate, time)))
        force = self.call("force", np.maximum(indentation, 0.0), rate, time)
        return np.where(indentation > 0.0, force, 0.0)

    @checked
    def restitution_at(self, velocity: float, mass: float) -> float:
        """Return the coefficient of restitution of a free collision, without springs and other forces.

        Parameters
        ----------
        velocity : float
            Closing velocity (m s-1).
        mass : float
            Effective mass of the bodies, ``m₁ m₂/(m₁ + m₂)``, m₁ at a wall (kg).

        Returns
        -------
        float
            Velocity at which the bodies part over that at which they meet; 0 if they stay together.

        Raises
        ------
        InvalidInput
            If a value is not positive, or the law does not stop the bodies.
        """
        from impactlab.components.collision import restitution

        return restitution(self, positive("velocity", velocity, "m s-1"), positive("mass", mass, "kg"))

    @checked
    def calibrate(self, *, restitution: float, velocity: float, mass: float) -> Self:
        """Return the law that gives a coefficient of restitution: with another damping, or what it has instead.

        Parameters
        ----------
        restitution : float
            What :meth:`restitution_at` of the new law is to be, more than 0 and less than 1.
        velocity, mass : float
            Closing velocity (m s-1) and effective mass (kg).

        Returns
        -------
        ContactLaw
            The law with another value of the field that its class names as `restitution_field`.

        Raises
        ------
        InvalidInput
            If the law has no such field, or no value of it gives the restitution.
        """
        from impactlab.components.collision import calibrated

        wanted = finite("restitution", restitution)
        if not 0.0 < wanted < 1.0:
            raise InvalidInput(f"restitution must be more than 0 and less than 1, not {restitution!r}.")
        law: Self = calibrated(self, wanted, positive("velocity", velocity, "m s-1"), positive("mass", mass, "kg"))
        return law


_BEGIN = np.zeros((1, 1))


def contact_forces(laws: Sequence[ContactLaw], indentation: np.ndarray, time: np.ndarray = _BEGIN) -> np.ndarray:
    """Return what `ContactLaw.evaluate` gives for many laws, each at its row of indentations, (law, point)."""
    force = call_each(laws, "force", np.maximum(indentation, 0.0), np.zeros_like(indentation), time)
    return np.where(indentation > 0.0, force, 0.0)


class HertzContact(ContactLaw):
    """Hertz contact of two elastic bodies: force ``stiffness δ^(3/2)``.

    Parameters
    ----------
    stiffness : float
        Contact stiffness η (N m-3/2).

    Examples
    --------
    >>> il.HertzContact(1e4).evaluate([-0.01, 0.01])
    array([ 0., 10.])
    """

    citation = article(
        "Hertz, H.", "Ueber die Beruehrung fester elastischer Koerper", "J. reine angew. Math.", 92, 1882, "156"
    )

    stiffness: float = parameter(units="N m-3/2", minimum=0.0)

    @staticmethod
    def force(indentation, stiffness):  # type: ignore[no-untyped-def]
        return stiffness * indentation * math.sqrt(indentation)

    @staticmethod
    def potential(indentation, stiffness):  # type: ignore[no-untyped-def]
        return 0.4 * stiffness * indentation * indentation * math.sqrt(indentation)


class LinearContact(ContactLaw):
    """One-sided linear spring: force ``stiffness δ``.

    Parameters
    ----------
    stiffness : float
        Contact stiffness κ (N m-1).

    Examples
    --------
    >>> il.LinearContact(1e4).evaluate([-0.01, 0.01])
    array([  0., 100.])
    """

    stiffness: float = parameter(units="N m-1", minimum=0.0)

    @property
    def linear(self) -> tuple[float, float] | None:
        return (self.stiffness, 0.0) if type(self).force is LinearContact.force else None

    @staticmethod
    def force(indentation, stiffness):  # type: ignore[no-untyped-def]
        return stiffness * indentation

    @staticmethod
    def potential(indentation, stiffness):  # type: ignore[no-untyped-def]
        return 0.5 * stiffness * indentation * indentation


class PowerLawContact(ContactLaw):
    """Contact whose force is a power of the indentation: ``stiffness (δ/1 m)^exponent``.

    Exponent 1 is `LinearContact`, 3/2 is `HertzContact`, both of which are faster; 2 is a cone on
    a plane.

    Parameters
    ----------
    stiffness : float
        Contact stiffness η, given as the force at an indentation of 1 m (N); in SI units it is
        the number of the usual η (N m⁻ᵖ).
    exponent : float
        Exponent p, more than 0 and at most 20.

    Examples
    --------
    >>> il.PowerLawContact(1e6, exponent=2.0).evaluate([0.01, 0.02])
    array([100., 400.])
    """

    stiffness: float = parameter(units="N", minimum=0.0)
    exponent: float = parameter(above=0.0, maximum=20.0)

    @staticmethod
    def force(indentation, stiffness, exponent):  # type: ignore[no-untyped-def]
        return stiffness * indentation**exponent

    @staticmethod
    def potential(indentation, stiffness, exponent):  # type: ignore[no-untyped-def]
        return stiffness * indentation ** (exponent + 1.0) / (exponent + 1.0)


class RigidContact(ContactLaw):
    """Contact of rigid bodies, which never overlap: an impact turns the closing velocity v into −e v at once.

    The coefficient of restitution e is Newton's. Impacts are located within the steps of `ExactFlow`, in the order of
    time; those at the same time follow in the order of the contacts. A contact that loses energy comes to rest where
    ever shorter bounces would end within the step, and then stays closed as long as a force presses it; one without
    restitution does so at its first impact.

    ``mean_contact_force`` is the total impulse divided by the time. ``contact_rate`` counts impacts and the beginnings
    of rests, or, if a body comes to rest after infinitely many impacts, those that close at
    ``impact_velocity_threshold`` or faster. ``contact_ratio`` is the fraction of time at rest, and there is no
    ``peak_contact_force``. In trajectories a force is the impulse since the previous sample, divided by the interval.

    Parameters
    ----------
    restitution : float
        Coefficient of restitution e, from 0 to 1.

    Notes
    -----
    Under forces that press the contact, impacts count from the velocity of equation :eq:`impact-threshold` on.

    Examples
    --------
    >>> il.Contact("a", il.WALL, il.RigidContact(0.8), clearance=0.1)
    Contact('a', WALL, RigidContact(restitution=0.8), clearance=0.1)
    """

    impulsive: ClassVar[bool] = True

    restitution: float = parameter(minimum=0.0, maximum=1.0)

    @staticmethod
    def potential(indentation):  # type: ignore[no-untyped-def]
        return math.inf if indentation > 0.0 else 0.0

    @staticmethod
    def force():  # type: ignore[no-untyped-def]
        return 0.0

    def restitution_at(self, velocity: float, mass: float) -> float:
        return self.restitution

    def calibrate(self, *, restitution: float, velocity: float, mass: float) -> Self:
        return self.replace(restitution=restitution)


class Contact(Component):
    """A place where two bodies can touch.

    The indentation is ``δ = x_first − x_second − clearance``; for ``δ > 0`` the law's
    force acts on `first` in the negative and on `second` in the positive direction.

    Parameters
    ----------
    first, second : str, Combination or WALL
        Names of the bodies. ``Contact("a", WALL, law, clearance=d)`` stops ``a`` at
        ``x = +d``, ``Contact(WALL, "a", law, clearance=d)`` stops it at ``x = −d``. The displacement of a
        combination is that of its point.
    law : ContactLaw
        Law of the force.
    clearance : float
        Distance to be closed before the bodies touch (m); negative for a preload.

    Raises
    ------
    InvalidInput
        If a body is in contact with itself, no weight is left of a combination, or a value is not what it should be.

    Examples
    --------
    >>> il.Contact("a", "b", il.HertzContact(1e4), clearance=0.05)
    Contact('a', 'b', HertzContact(stiffness=10000.0), clearance=0.05)
    """

    first: Side = parameter(kw_only=False)
    second: Side = parameter(kw_only=False)
    law: ContactLaw = parameter(kw_only=False)
    clearance: float = parameter(0.0, units="m")

    def __post_init__(self) -> None:
        super().__post_init__()
        check_sides(self)
        take_part(self, "law", ContactLaw, "a contact law such as il.HertzContact(1e4)")

    def __repr__(self) -> str:
        return f"Contact({self.first!r}, {self.second!r}, {self.law!r}, clearance={self.clearance!r})"


def contacts_between(
    pairs: Sequence[tuple[Side, Side]], laws: Sequence[ContactLaw], clearances: Sequence[float]
) -> list[Contact]:
    """Return the contact of each pair of two different bodies, or of a body and the wall, with its law and clearance.

    The first contact of a law is made and checked; the others are copies of it with other sides and clearances.
    """
    checked: dict[int, ContactLaw] = {}
    result = []
    for (first, second), law, clearance in zip(pairs, laws, clearances, strict=True):
        known = checked.get(id(law))
        if known is None or known.is_uncertain or type(clearance) is not float or not math.isfinite(clearance):
            contact = Contact(first, second, law, clearance=clearance)
            checked[id(law)] = contact.law
        else:
            contact = object.__new__(Contact)
            _set(contact, "first", first)
            _set(contact, "second", second)
            _set(contact, "law", known)
            _set(contact, "clearance", clearance)
        result.append(contact)
    return result


_set = object.__setattr__  # contacts are frozen


@checked
def backlash(
    first: Side, second: Side, law: ContactLaw, *, clearance: float | Uncertain, name: str
) -> dict[str, Contact]:
    """Return the contacts of a body between two stops, or of two bodies with play, for a network.

    Parameters
    ----------
    first, second : str, Combination or WALL
        Sides of the contacts.
    law : ContactLaw
        Law of both.
    clearance : float
        Half of the play (m): ``x_first − x_second`` can go as far up and down before the bodies touch.
    name : str
        The contacts are called ``name_upper`` and ``name_lower``.

    Returns
    -------
    dict of str to Contact

    Raises
    ------
    InvalidInput
        If a contact cannot be made of a value.

    Examples
    --------
    >>> list(il.backlash("gear", "pinion", il.HertzContact(1e5), clearance=0.01, name="teeth"))
    ['teeth_upper', 'teeth_lower']
    """
    return {
        f"{name}_upper": Contact(first, second, law, clearance=clearance),  # type: ignore[arg-type]
        f"{name}_lower": Contact(second, first, law, clearance=clearance),  # type: ignore[arg-type]
    }


class SlidingFriction(Component):
    """Coulomb friction of a closed contact, smooth about rest: ``coefficient N tanh((rate + surface)/scale)``.

    Parameters
    ----------
    friction_coefficient : float
        Coefficient of friction.
    surface_velocity : float
        Velocity of one surface beyond that of its body (m s-1).
    friction_velocity : float
        Velocity at which the friction is 0.76 of that of sliding (m s-1).
    """

    kernels: ClassVar[Mapping[str, tuple[str, ...]]] = {"force": ("normal_force", "rate", "time")}

    friction_coefficient: float = parameter()
    surface_velocity: float = parameter(units="m s-1", kw_only=True)
    friction_velocity: float = parameter(units="m s-1", kw_only=True)

    @staticmethod
    def force(normal_force, rate, friction_coefficient, surface_velocity, friction_velocity):  # type: ignore[no-untyped-def]
        return friction_coefficient * normal_force * math.tanh((rate + surface_velocity) / friction_velocity)


class RoundContact(Component):
    """A contact of a body that moves in a plane with the rim of a round clearance around it.

    The body is at (x, y) relative to the second side. With ``r = sqrt((x − x₀)² + (y − y₀)²)`` the indentation is
    ``δ = r − clearance``; for ``δ > 0`` the law's force F(δ, δ') pushes the body back along the radius. Friction acts
    across it, ``friction_coefficient F tanh(s/friction_velocity)`` against the sliding velocity
    ``s = v_t + surface_velocity``; v_t is the velocity of the body across the radius, positive from x to y. The surface
    velocity of a rotor of radius R that spins from x to y at Ω is R Ω; then friction drives a backward whirl.

    ``contact_force``, and what is summed of it, is the force of the law, without friction.

    Parameters
    ----------
    first : pair of str or Combination
        Names of the coordinates x and y.
    second : WALL or pair of str or Combination
        What is around the body: fixed, or with coordinates x and y of its own.
    law : ContactLaw
        Law of the force along the radius, without states; not `RigidContact`.
    clearance : float
        Radial clearance, the distance from the center at which the body touches (m).
    center : pair of float
        Place (x₀, y₀) of the center of the clearance (m).
    friction_coefficient : float
        Coefficient of Coulomb friction; 0 for none.
    surface_velocity : float
        Velocity of the surface of the body by its spin, R Ω (m s-1).
    friction_velocity : float
        Sliding velocity at which the friction is 0.76 of that of sliding (m s-1); with friction it must be given. The
        smaller, the shorter the steps.

    Raises
    ------
    InvalidInput
        If x or y is missing, both are the same, or a value is not what it should be.

    Examples
    --------
    >>> rub = il.RoundContact(("rotor.x", "rotor.y"), il.WALL, il.LinearContact(1e6), clearance=3e-5)
    >>> rub.clearance
    3e-05
    """

    first: tuple[Side, Side] = parameter(kw_only=False)
    second: tuple[Side, Side] | Wall = parameter(kw_only=False)
    law: ContactLaw = parameter(kw_only=False)
    clearance: float = parameter(units="m", above=0.0)
    center: tuple[float, float] = parameter((0.0, 0.0), units="m")
    friction_coefficient: float = parameter(0.0, minimum=0.0)
    surface_velocity: float = parameter(0.0, units="m s-1")
    friction_velocity: float = parameter(0.0, units="m s-1", minimum=0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_directions(self)
        take_part(self, "law", ContactLaw, "a contact law such as il.HertzContact(1e4)")
        if self.law.impulsive or self.law.state_names():
            reason = "impacts are located along straight lines" if not self.law.state_names() else "it has states"
            raise InvalidInput(f"RoundContact.law cannot be {type(self.law).__name__}: {reason}.")
        if self.friction_coefficient and not self.friction_velocity:
            raise InvalidInput(
                "RoundContact with friction needs friction_velocity (m s-1), the sliding velocity at which friction is "
                "0.76 of its largest value."
            )

    @property
    def directions(self) -> tuple[Direction, Direction]:
        """Both sides along x, and along y."""
        second = (WALL, WALL) if isinstance(self.second, Wall) else self.second
        return Direction(self.first[0], second[0]), Direction(self.first[1], second[1])

    @property
    def clearance_at_rest(self) -> float:
        """Distance to be closed from where all bodies are at 0 (m)."""
        return self.clearance - math.hypot(*self.center)

    @property
    def friction(self) -> SlidingFriction | None:
        """Law of the friction, if there is any."""
        if not self.friction_coefficient:
            return None
        return SlidingFriction(
            self.friction_coefficient, surface_velocity=self.surface_velocity, friction_velocity=self.friction_velocity
        )
