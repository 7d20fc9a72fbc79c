"""From a model to the text of a module: one loop per kind of component. Pure.

The text depends on the kinds of components only, never on how many there are or on
their parameters, which travel in arrays. It holds the source of every kernel: numbers
that a kernel reads from its module become literals, helper functions it calls are
copied, anything else is refused with file and line. (Importing the kernels instead would
miss changes in the imported file on a cache hit, and would not work for a script.)
"""

from __future__ import annotations

from typing import Any, NamedTuple

from impactlab.assembly.loops import (
    FORCE_LOOPS,
    FRICTION,
    Loop,
    accept_loop,
    between,
    friction_loop,
    name_of,
    peak_loop,
    slowing,
)
from impactlab.assembly.members import ROUND, Kind
from impactlab.assembly.model import Model
from impactlab.compiling.inlining import Inliner, Read, free_name
from impactlab.compiling.single import single_text
from impactlab.components.contact import SlidingFriction

_FORCES = '''
@pointer(FORCES)
def forces(x, v, middle, half_step, parameters, indices, indentation, contact_force, total):
    """Write the force on every body, and the state of every contact, of a block.

    x, v: displacement and velocity [body, lane]; the last body is the wall.
    middle, half_step: v and 0, or for a kick from v on the velocity in its middle, as contact_force
        and total make it, and half its length; forces that depend on velocities are then solved.
    indentation, contact_force: of every contact [contact, lane]; positive when closed.
    total: force on every body [body, lane].
    """
'''

_ACCEPT = '''
@accepting(ACCEPT)
def accept(place, number):
    """Bring the states of laws from the last accepted place to this one; see `impactlab.kernels.memory.Accepted`."""
    x, v, contact_force, half_step, parameters, indices = value_at(place)
'''

_PEAKS = '''
@reading(PEAKS)
def peaks(place, number):
    """Find the largest forces on the way to a step of some number; see `impactlab.kernels.peaks.Between`."""
    v, indentation, contact_force, before, jitter, parameters, indices, step = value_at(place)
'''

_DISTANCES = "    differences(indices, x, indentation)\n"

_ELONGATIONS = "    elongations(indices, parameters, x, indentation)\n"

_TIMETABLE = '''
@timetable
def {name}(times, parameters, indices, result):
    """Write {what} at some times, result[time, row]."""
'''

_GIVEN = '''
@giving
def given(place, number):
    """Write the given forces of all sources at a time; see `impactlab.kernels.smooth_steps.GivenAt`."""
    time, parameters, indices, result = value_at(place)
'''

_TIMETABLES = {
    "forcing": "the given force on every forced body",
    "modulation": "the envelope of every filtered noise",
    "intensity": "the two-sided spectral density of every white noise",
}


def generate(model: Model, single: bool = False, located: bool = False) -> str:
    """Return the text of the module that holds a network's forces, for blocks of many lanes or of a `single` one.

    Steps that end at events, `located`, are those of a single lane, and ask for given forces at any time.

    A kernel is refused if its source cannot be found, or uses a name that is neither a number, nor a function, nor from
    ``math`` or ``numpy``.
    """
    names = _kernel_names(model.members.kinds)
    functions = tuple(getattr(kind.component, kernel) for kind in names for kernel in kind.kernels)
    form = _Form(model.members.kinds, functions, len(model.ends) > 0, model.ends.plain, single or located, located)
    text, reads = _texts.get(form, ("", None))
    if reads is None or not all(read.holds for read in reads):
        text, reads = _generated(form, names)
        _texts[form] = text, reads
    return text


class _Form(NamedTuple):
    """Everything on which a text depends, with the names that its kernels use."""

    kinds: tuple[Kind, ...]
    kernels: tuple[Any, ...]  # their functions
    touching: bool  # whether there are contacts
    plain: bool  # whether these are between two bodies each
    single: bool
    located: bool

    @property
    def time_varying(self) -> bool:
        """Whether the intensity of a white noise depends on time."""
        return any(kind.kinematic for kind in self.kinds if kind.role == "intensity")


_texts: dict[_Form, tuple[str, list[Read]]] = {}
"""Texts that were made: networks that differ in parameters only have the same."""


def _generated(form: _Form, names: dict[Kind, str]) -> tuple[str, list[Read]]:
    """Return a text, and what its kernels read outside of them."""
    kernels: dict[str, str] = {}
    reads: list[Read] = []
    rubbing = any(kind.role == "rubbing" for kind in form.kinds)
    taken = {name_of(name, kind, kernel) for kind, name in names.items() for kernel in kind.kernels}
    for kind, name in names.items():
        for kernel in kind.kernels:
            inliner = Inliner(name, kernels, taken, reads)
            inliner.inline(getattr(kind.component, kernel), name_of(name, kind, kernel))
    if rubbing:
        Inliner(FRICTION, kernels, taken, reads).inline(SlidingFriction.force, FRICTION)
    loops = [
        Loop(number, kind, names[kind], form.single, form.plain)
        for number, kind in enumerate(form.kinds)
        if kind in names
    ]
    parts = [_header(form, kernels)]
    parts += [f"\n\n@scalar\n{text}\n" for text in kernels.values()]
    slowed = [loop for loop in loops if loop.kind.slows] + [friction_loop()] * rubbing
    parts += [f"\n{slowing(loop)}" for loop in slowed]
    rated = [loop for loop in loops if loop.kind.rated and not form.located]
    parts += [f"\n{between(loop)}" for loop in rated]
    parts.append("\n" + _FORCES)
    if form.touching and not form.plain:
        parts.append(_ELONGATIONS)
    elif form.single and form.touching:
        parts.append(_DISTANCES)
    for role, write in FORCE_LOOPS.items():
        if role == "coupling":  # after the contacts
            parts.append(_gathering(form))
        parts += [write(loop) for loop in loops if loop.kind.role == role]
    if form.located:
        of_role = [loop for role in ("forcing", "factor") for loop in loops if loop.kind.role == role]
        parts += ["\n" + _GIVEN, *map(_given_loop, of_role)] if of_role else []
        remembering = [loop for loop in loops if loop.kind.states]
        parts += ["\n" + _ACCEPT, *map(accept_loop, remembering)] if remembering else []
        return single_text("".join(parts)), reads
    remembering = [loop for loop in loops if loop.kind.states]
    if remembering:
        parts += ["\n" + _ACCEPT, *map(accept_loop, remembering), "    sum_states(parameters, x)\n"]
    if rated:
        parts += ["\n" + _PEAKS, *map(peak_loop, rated)]
    for role, what in _TIMETABLES.items():
        of_role = [loop for loop in loops if loop.kind.role == role]
        if role == "forcing":
            of_role += [loop for loop in loops if loop.kind.role == "factor"]
        if of_role:
            parts += ["\n" + _TIMETABLE.format(name=role, what=what), *map(_timetable_loop, of_role)]
    return single_text("".join(parts)) if form.single else "".join(parts), reads


def _kernel_names(kinds: tuple[Kind, ...]) -> dict[Kind, str]:
    """Name each kernel after its class; classes of one name are numbered."""
    names: dict[Kind, str] = {}
    for kind in kinds:
        if kind.role == "intensity" and not any(k.kinematic for k in kinds if k.role == "intensity"):
            continue  # constant intensities are numbers, not code
        names[kind] = free_name(f"{kind.component.__name__}_{kind.kernel}", names.values())
    return names


def _header(form: _Form, kernels: dict[str, str]) -> str:
    roles = {kind.role for kind in form.kinds}
    slowing = any(kind.slows or kind.role == "rubbing" for kind in form.kinds)
    tables = not roles.isdisjoint({"forcing", "modulation"}) or form.time_varying
    given = form.located and tables
    tables = tables and not form.located
    remembering = any(kind.states for kind in form.kinds)
    rated = any(kind.rated for kind in form.kinds) and not form.located
    plain = ["differences", "gather"] if form.single else ["gather"]
    called = [] if not form.touching else plain if form.plain else ["elongations", "push_back"]
    kernels_from = "kick" if form.plain or not called else "combinations"
    resident = bool(called) and form.plain
    of_arrays = ["rows"] * bool(form.kinds) + ["value_at"] * (remembering or rated or given)
    text = "\n".join(kernels.values())
    lines = [
        '"""Forces of a network of oscillators; generated by impactlab, not to be edited."""',
        "",
        *(["import math", ""] if "math." in text or not roles.isdisjoint(ROUND) else []),
        *(["import numpy as np", ""] if "np." in text else []),
        f"from impactlab.compiling.force_type import FORCES, pointer{', resident' * resident}",
        *([f"from impactlab.compiling.intrinsics import {', '.join(of_arrays)}"] if of_arrays else []),
        *(["from impactlab.compiling.jit import timetable"] if tables else []),
        *(["from impactlab.compiling.scalars import scalar"] if kernels else []),
        *(["from impactlab.kernels.interpolation import cubic"] if rated else []),
        *(["from impactlab.kernels.smooth_steps import giving"] if given else []),
        f"from impactlab.kernels.{kernels_from} import {', '.join(called) or 'clear'}",
        *(
            [f"from impactlab.kernels.memory import ACCEPT, accepting, remembered{', sum_states' * (not form.located)}"]
            if remembering
            else []
        ),
        *(["from impactlab.kernels.peaks import PEAKS, reading"] if rated else []),
        *(["from impactlab.kernels.slowing import stretch"] if slowing else []),
        *(["", *(f"{name} = resident({name}, FORCES)" for name in called)] if resident else []),
    ]
    return "\n".join(lines) + "\n"


def _gathering(form: _Form) -> str:
    """Begin the total force with that of the contacts."""
    if not form.touching:
        return "    clear(total)\n"
    if not form.plain:
        return "    push_back(indices, parameters, contact_force, total)\n"
    return "    gather(indices, contact_force, total)\n"


def _timetable_loop(loop: Loop) -> str:
    write = "*=" if loop.kind.role == "factor" else "="
    return (
        f"{loop.runs()}"
        "            for index in range(result.shape[0]):\n"
        f"                result[index, row + member] {write} {loop.call({'time': 'times[index]'})}\n"
    )


def _given_loop(loop: Loop) -> str:
    write = "*=" if loop.kind.role == "factor" else "="
    return f"{loop.runs()}            result[row + member] {write} {loop.call({'time': 'time'})}\n"
