"""Rows of the sums that blocks make over time."""

from __future__ import annotations

X, V, XX, XV, VV, F, FF, FX, FV = range(9)
"""Rows of the sums over bodies: powers of displacement x and velocity v, and of the force f that a
kick applied; the last four are there for methods that kick."""

FLUX = 0
"""Row of the sums over contacts: the weighted closing velocity near the point of contact, or the number of closings.
After it come the rows of statistics, first those that are summed, then those of which the largest counts."""

STATE_ROWS, KICK_ROWS = 5, 9
"""Number of rows over bodies for methods without kicks, and for methods with kicks."""

TURN = KICK_ROWS
"""Row of the sums over bodies, where series or given forces push some: the force of kicks times what the flow
between them adds to the velocity."""

BEGUN = TURN + 1
INTENSITY = BEGUN + KICK_ROWS
TRANSIENT_ROWS = INTENSITY + 1
"""In sums of transients the first rows are over [0, T], with half of the states at both ends. Then come those over the
kicks after which the flows of a phase begin, from the row `BEGUN` on, and the sum of the intensity of the white noise
in these flows, relative to the intensity with which the flow is made. `TRANSIENT_ROWS` is the number of these rows."""

SQUARES = slice(0, 4)
POINT_TURN = SQUARES.stop
POINT_ROWS = POINT_TURN + 1
"""Rows of the sums over points: the squares of displacement and velocity at the kick, and of two quantities for the
motion between kicks; then the same as `TURN`. `POINT_ROWS` is their number. See `impactlab.plan.structure_points`."""

PAIR_ROWS = 9
"""Rows of the sums over pairs of bodies: products of x, v, f of the first and x, v, f of the second."""

TOUCHING = 1e-300
"""Indentation of a contact that rests after impacts (m): positive, but nothing."""
