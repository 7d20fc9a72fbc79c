"""Every error that impactlab raises, and every warning that it gives."""

import contextlib
import contextvars
import sys
import warnings
from collections.abc import Callable, Iterator

WORTH_SAYING = 0.005
"""Part of a statistic, or of an energy, by which it must be off to be worth a warning."""

LONG_TIME = 3600.0
"""Time that a run may take without a warning before it begins (s)."""


class ImpactLabError(Exception):
    """Base of all errors raised on purpose by impactlab.

    Examples
    --------
    >>> issubclass(il.InvalidInput, il.ImpactLabError)
    True
    """


def keep_in(error: KeyboardInterrupt, found: object, what: str) -> None:
    """Give what was found before an interrupt to the error that tells of this."""
    error.found = found  # type: ignore[attr-defined]
    error.add_note(f"The attribute `found` of this error, sys.last_value.found, has the {what}.")


class InvalidInput(ImpactLabError, ValueError):
    """What was given cannot be used; the message says what is allowed and what to do, in one line.

    Examples
    --------
    >>> try:
    ...     il.LinearOscillator(mass=-1.0)
    ... except il.InvalidInput as error:
    ...     print(error)
    LinearOscillator.mass must be larger than 0 kg, not -1.0.
    """

    def __init__(self, message: str) -> None:
        super().__init__(" ".join(message.split()))  # arrays are printed over several


class NoExactReference(ImpactLabError):
    """The network has no exact stationary law that is known here; the message says why.

    Examples
    --------
    >>> try:
    ...     il.exact(driven)
    ... except il.NoExactReference as error:
    ...     print(str(error).splitlines()[0])
    There is no exact stationary law that is known here:
    """


class Diverged(ImpactLabError, ArithmeticError):
    """Realizations left the range of finite numbers, and none is left or wanted; the message says when and where.

    Examples
    --------
    >>> issubclass(il.Diverged, il.ImpactLabError)
    True
    """


class NoOrbit(ImpactLabError):
    """No periodic orbit was found; the message says what was tried, and what came nearest.

    Examples
    --------
    >>> try:
    ...     il.orbits(driven.replace(excitations={"a": None}), start="search", periods=1)
    ... except il.NoOrbit:
    ...     print("none")
    none
    """


class Interrupted(ImpactLabError):
    """A computation was asked to stop before it was complete."""


class ImpactLabWarning(UserWarning):
    """Base of all warnings given by impactlab.

    Parameters
    ----------
    message : str
    kind : str
        Its cause, one of `KINDS`, whatever the names and numbers in the message are.

    Examples
    --------
    >>> import warnings
    >>> with warnings.catch_warnings(action="ignore", category=il.ImpactLabWarning):
    ...     result = il.simulate(network, 0.5, realizations=64, rng=1)
    """

    def __init__(self, message: str, kind: str = "") -> None:
        super().__init__(message)
        self.kind = kind


class AccuracyWarning(ImpactLabWarning):
    """A result is complete, but may be less accurate than requested, or its accuracy is not known.

    Examples
    --------
    >>> import warnings
    >>> with warnings.catch_warnings(record=True) as told:
    ...     warnings.simplefilter("always")
    ...     result = il.simulate(network, 0.5, realizations=64, rng=1)
    >>> sorted({item.message.kind for item in told})
    ['rare_contacts']
    """


KINDS = {
    "few_samples": "too few independent samples for standard errors",
    "rare_contacts": "contacts that closed too seldom for standard errors",
    "rare_pushes": "bodies that contacts or couplings moved too seldom for standard errors",
    "short_spin_up": "a spin-up that may be too short",
    "drift": "two halves of a run that differ",
    "transient": "means that contain the transient from the start",
    "several_motions": "a motion that depends on how it begins",
    "no_section": "a section that the motion never meets",
    "open_orbits": "orbits of a branch that are not closed when their paths are followed",
    "strong_noise": "noise that takes a network too far from an orbit for linear deviations",
    "chaotic_path": "averages along a path that small errors change, as they change chaotic paths",
    "balance": "a balance that does not close",
    "heating": "energy that the step adds or removes",
    "step_bias": "a step that makes a statistic too large or too small",
    "unknown_step_bias": "a bias of the step that its measurement does not tell",
    "kinks": "energy that wanders, since contacts open and close within steps",
    "jumping_force": "forces that jump in time within steps",
    "small_impacts": "a rate of impacts that is that of the step",
    "chatter": "contacts that come to rest by endlessly many impacts",
    "many_impacts": "impacts without end in a step",
    "noise_band": "a noise whose band misses a natural frequency",
    "outside_limits": "samples outside the limits of a density",
    "beyond_spectrum": "variance at frequencies beyond a spectrum",
    "tolerance": "a tolerance that was not reached",
    "diverged": "realizations that left the range of finite numbers",
    "long_run": "a run that takes long",
    "cache": "a cache of compiled code that cannot be used",
}
"""Causes of warnings, by kind."""

Listener = Callable[[ImpactLabWarning], None]

_listener: contextvars.ContextVar[Listener | None] = contextvars.ContextVar("impactlab_listener", default=None)


@contextlib.contextmanager
def heard_by(listener: Listener) -> Iterator[None]:
    """Hand the warnings of impactlab that are given in here, by this thread, to a function instead."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


def unheard() -> contextlib.AbstractContextManager[None]:
    """Keep warnings to oneself that were given before."""
    return heard_by(lambda warning: None)


@contextlib.contextmanager
def noted() -> Iterator[list[ImpactLabWarning]]:
    """Note the warnings that are given in here, by this thread, and give them all the same."""
    given: list[ImpactLabWarning] = []
    outer = _listener.get() or _show

    def note(warning: ImpactLabWarning) -> None:
        given.append(warning)
        outer(warning)

    with heard_by(note):
        yield given


def warn(kind: str, message: str, category: type[ImpactLabWarning] = AccuracyWarning) -> None:
    """Give a warning of one of `KINDS` at the line outside of impactlab that led to it."""
    assert kind in KINDS, kind
    give(category(message, kind))


def give(warning: ImpactLabWarning) -> None:
    """Give a warning that was made, or heard, before."""
    (_listener.get() or _show)(warning)


def _show(warning: ImpactLabWarning) -> None:
    level = 2
    while f"{sys._getframe(level - 1).f_globals.get('__name__')}.".startswith(("impactlab.", "contextlib.")):
        level += 1
    warnings.warn(warning, stacklevel=level)
