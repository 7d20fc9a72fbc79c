"""Several steps of few bodies at once, in the registers of a processor: `ExactFlow` for blocks of one lane.

The kernels are those of all runs. Here the compiler knows how many bodies there are, and which of them touch: it
unrolls all loops over bodies, and arrays of the state become numbers in registers. The bits of results stay. A network
takes the better part of a second to compile so, once, and a step a third to half of the time.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from impactlab.compiling.build import build
from impactlab.compiling.inlined_forces import inlined_forces
from impactlab.compiling.intrinsics import registers, shaped, value_at
from impactlab.compiling.jit import cache_folder, composed, part
from impactlab.compiling.records import by_address
from impactlab.compiling.scalars import scalar
from impactlab.compiling.single import without_lanes
from impactlab.integrators.arguments import Forced, History, Stretch
from impactlab.integrators.driver import end_of_stretch
from impactlab.integrators.kicks import KICK, LAG, kick, push_by_given
from impactlab.kernels.flow import flow
from impactlab.kernels.kick import smooth_velocity
from impactlab.kernels.sums import SLOTS

MOST_BODIES, MOST_LINKS = 4, 6
"""Bodies and links of a network up to which its state is kept in registers."""

WORTH_COMPILING, WORTH_LOADING = 10_000_000, 100_000
"""Steps from which on a compiler is waited for, and from which on machine code in the cache is looked for. The steps of
all runs of a network count: what they would have gained is then what the compiler takes."""

_steps: Counter[str] = Counter()


class Layout(NamedTuple):
    """What the compiler knows of a network."""

    text: str  # of its generated module
    indices: tuple[int, ...]  # `impactlab.assembly.members.Members.indices`
    rows: tuple[int, ...]  # slots of the bodies with noise, and the runs and the first second row of `Noise`
    runs: tuple[tuple[int, ...], ...]
    seconds: int
    forced: tuple[int, ...]  # slots of the bodies under given forces, and which of these it is
    given: tuple[int, ...]
    coefficients: tuple[int, ...]  # their shape
    contacts: int
    passes: int

    @property
    def version(self) -> str:
        """Return a digest by which the cache knows it."""
        own = Path(__file__).read_bytes()
        known = self._replace(text=inlined_forces(self.text))  # what is compiled of it
        return hashlib.sha256(own + repr(tuple(known)).encode()).hexdigest()[:12]


class KickTables(NamedTuple):
    """Parts of `Tables` that kicks read."""

    parameters: np.ndarray
    indices: np.ndarray
    coefficients: np.ndarray


class RowsOfNoise(NamedTuple):
    """Parts of `Noise` that the flow reads."""

    bodies: np.ndarray
    runs: np.ndarray
    seconds: int
    amplitude: np.ndarray
    scale: np.ndarray


# what stands here for the numbers of a layout
BODIES = WITH_WALL = CONTACTS = COLUMNS = PHASES = SECONDS = PASSES = 0
INDICES = RUNS = ROWS = FORCED = GIVEN = np.zeros(0, np.int64)


def forces(*arguments: Any) -> None:
    """Stand for the forces of a network."""
    raise NotImplementedError


@scalar
def put(row, count, result):  # type: ignore[no-untyped-def]
    """Copy so many numbers, without the wall's: joined with one body's into a vector, they wait for two stores."""
    for place in range(count):
        result[place] = row[place]


def stretch(place, index):  # type: ignore[no-untyped-def]
    """Make the steps of a call from one of some index on, up to the end of a stretch; see `Stretch`."""
    given = value_at(place)
    state, history, steps = given.state, given.history, given.steps
    coefficients = shaped(given.coefficients, PHASES, COLUMNS, BODIES)
    numbers = KickTables(given.parameters, INDICES, coefficients)
    noise = RowsOfNoise(ROWS, RUNS, SECONDS, given.amplitude, given.scale)
    forced = Forced(FORCED, GIVEN, given.weights, given.force)
    x, v, y, after, push = (
        registers(WITH_WALL), registers(WITH_WALL), registers(WITH_WALL), registers(WITH_WALL), registers(WITH_WALL),
    )  # fmt: skip
    middle, total, before, still = (
        registers(WITH_WALL), registers(WITH_WALL), registers(WITH_WALL), registers(WITH_WALL),
    )  # fmt: skip
    indentation, contact_force = registers(CONTACTS), registers(CONTACTS)
    if index:
        last = (steps.first + index - 1) % SLOTS
        put(history.x[last], BODIES, x)
        put(history.force[last], BODIES, total)
    else:
        put(state.x, BODIES, x)
        put(state.total, BODIES, total)
    put(state.v, BODIES, v)
    for number in range(index, end_of_stretch(steps, index)):
        now = steps.first + number
        slot = now % SLOTS
        put(total, BODIES, before)
        sample, normals = number if noise.scale.shape[0] > 1 else 0, given.normals[now % 4]
        flow(coefficients, now % PHASES, noise, sample, normals, x, v, after)
        if FORCED.shape[0]:
            for half in range(2):
                push_by_given(coefficients, forced, number, half, push, after, v)
        put(after, BODIES, x)
        kick(forces, numbers, PASSES, still, v, y, History(x, middle, total, indentation, contact_force))
        put(x, BODIES, history.x[slot])
        put(middle, BODIES, history.v[slot])
        put(total, BODIES, history.force[slot])
        put(indentation, CONTACTS, history.indentation[slot])
        put(contact_force, CONTACTS, history.contact_force[slot])
    smooth_velocity(coefficients, KICK, LAG, middle, total, before, state.velocity)
    put(y, BODIES, state.reading)
    put(contact_force, CONTACTS, state.contact_force)
    put(x, BODIES, state.x)
    put(v, BODIES, state.v)
    put(total, BODIES, state.total)


def worth_compiling(layout: Layout, steps: int) -> bool:
    """Whether steps of a network in registers save time from now on; so many steps more are wanted."""
    version = layout.version
    _steps[version] += steps
    if steps >= WORTH_LOADING and any(cache_folder().rglob(f"*.stretch_*{version}-*.nbi")):
        return True
    return _steps[version] >= WORTH_COMPILING


@cache
def stretching(layout: Layout) -> tuple[Any, int]:
    """Return the function that makes a stretch of steps of a network, and its address."""
    phases, columns, bodies = layout.coefficients

    def of(numbers: Any, *shape: int) -> np.ndarray:
        return np.array(numbers, dtype=np.int64).reshape(shape or (-1,))

    numbers = {
        "BODIES": bodies, "WITH_WALL": bodies + 1, "CONTACTS": layout.contacts, "COLUMNS": columns, "PHASES": phases,
        "SECONDS": layout.seconds, "PASSES": layout.passes, "INDICES": of(layout.indices),
        "RUNS": of(layout.runs, len(layout.runs), 3), "ROWS": of(layout.rows), "FORCED": of(layout.forced),
        "GIVEN": of(layout.given),
    }  # fmt: skip
    own = build(inlined_forces(layout.text)).forces
    function = composed(without_lanes(stretch), layout.version, forces=own, **numbers)
    return part(by_address(Stretch, True), function, True)  # type: ignore[no-any-return]
