"""Every error that impactlab raises, and every warning that it gives."""


class ImpactLabError(Exception):
    """Base of all errors raised on purpose by impactlab."""


class InvalidInput(ImpactLabError, ValueError):
    """What was given cannot be used; the message says what is allowed and what to do."""


class NoExactReference(ImpactLabError):
    """The network has no exact stationary law that is known here; the message says why."""


class Diverged(ImpactLabError, ArithmeticError):
    """A realization left the range of finite numbers; the message says when and where."""


class Interrupted(ImpactLabError):
    """A computation was asked to stop before it was complete."""


class ImpactLabWarning(UserWarning):
    """Base of all warnings given by impactlab."""


class AccuracyWarning(ImpactLabWarning):
    """A result is complete, but less is known of its accuracy than was asked for."""
