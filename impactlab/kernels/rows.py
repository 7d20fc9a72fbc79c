"""Rows of the sums that blocks make over time."""

from __future__ import annotations

X, V, XX, XV, VV, F, FF, FX, FV = range(9)
"""Rows of the sums over bodies: powers of displacement x and velocity v, and of the force f that a
kick applied; the last four are there for methods that kick."""

TURN = 9
"""Row of the sums over bodies, where series or given forces push some: the force of kicks times what the flow
between them adds to the velocity."""

FLUX = 0
"""Row of the sums over contacts: the weighted closing velocity near the point of contact, or the number of closings.
After it come the rows of statistics, first those that are summed, then those of which the largest counts."""

STATE_ROWS, KICK_ROWS = 5, 9
"""How many rows there are over bodies, of methods that do not kick and of those that do."""

BEGUN, INTENSITY, TRANSIENT_ROWS = 10, 19, 20
"""In sums of transients the first rows are over [0, T], with half of the states at both ends. Then come those over the
kicks after which the flows of a phase begin, from the row `BEGUN` on, and the sum of the intensity of the white noise
in these flows, by that which the flow is made with. And how many rows these are."""

SQUARES, POINT_TURN, POINT_ROWS = slice(0, 4), 4, 5
"""Rows of the sums over points: the squares of displacement and velocity at the kick, and of two quantities that tell
what lies between kicks; then the same as `TURN`. And how many rows these are. See `impactlab.plan.points`."""

PAIR_ROWS = 9
"""Rows of the sums over pairs of bodies: products of x, v, f of the first and x, v, f of the second."""

TOUCHING = 1e-300
"""Indentation of a rigid contact that rests (m): positive, but nothing."""
