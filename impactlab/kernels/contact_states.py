"""States, kinds and numbers of contacts, and of dry friction, which is a row behind them, from event to event."""

OPEN, CLOSED, PARTED, HELD, SLIPS_UP, SLIPS_DOWN, STICKS = range(7)
"""States of a contact; parted is one that is indented without a force, and held one at rest. And states of dry
friction: its slip rate is positive, negative, or held at 0."""

SPRING, DASHPOT, RIGID, FRICTION, JENKINS = range(5)
"""Kinds of contacts: closed while they are indented; while their force is positive; with impacts; dry friction;
and a spring in series with dry friction."""

RESTITUTION, EFFECTIVE_MASS, DAMPING, SLIP_FORCE, STICK_FORCE, SURFACE = range(6)
"""Columns of the numbers of a contact; the effective mass is ``1/Σ w²/m``. The last are those of friction: forces of
sliding and of breakaway, and the velocity of the surface."""
