"""From a model to the text of a module: one loop per kind of component. Pure.

The text depends on the kinds of components only, never on how many there are or on
their parameters, which travel in arrays. It holds the source of every kernel: numbers
that a kernel reads from its module become literals, helper functions it calls are
copied, anything else is refused with file and line. (Importing the kernels instead would
miss changes in the imported file on a cache hit, and would not work for a script.)
"""

from __future__ import annotations

from impactlab.assembly.inlining import Inliner, free_name
from impactlab.assembly.loops import FORCE_LOOPS, Loop, accept_loop, name_of, slowing
from impactlab.assembly.members import Kind
from impactlab.assembly.model import Model, kept
from impactlab.kernels.single import single_text

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
    x, v, parameters, indices = value_at(place)
'''

_DISTANCES = "    differences(indices, x, indentation)\n"

_ELONGATIONS = "    elongations(indices, parameters, x, indentation)\n"

_TIMETABLE = '''
@timetable
def {name}(times, parameters, indices, result):
    """Write {what} at some times, result[time, row]."""
'''

_TIMETABLES = {
    "forcing": "the given force on every forced body",
    "modulation": "the envelope of every filtered noise",
    "intensity": "the two-sided spectral density of every white noise",
}


def generate(model: Model, single: bool = False) -> str:
    """Return the text of the module that holds a network's forces, for blocks of many lanes or of a `single` one.

    Kernels are refused whose source cannot be found, or reads something that is neither a number, nor a function, nor
    from ``math`` or ``numpy``.
    """
    return _generated(model, single)


@kept
def _generated(model: Model, single: bool) -> str:
    names = _kernel_names(model.members.kinds)
    kernels: dict[str, str] = {}
    taken = {name_of(name, kind, kernel) for kind, name in names.items() for kernel in kind.kernels}
    for kind, name in names.items():
        for kernel in kind.kernels:
            Inliner(name, kernels, taken).inline(getattr(kind.component, kernel), name_of(name, kind, kernel))
    loops = [
        Loop(number, kind, names[kind], single, model.ends.plain)
        for number, kind in enumerate(model.members.kinds)
        if kind in names
    ]
    parts = [_header(model, kernels, single)]
    parts += [f"\n\n@scalar\n{text}\n" for text in kernels.values()]
    parts += [f"\n{slowing(loop)}" for loop in loops if loop.kind.slows]
    parts.append("\n" + _FORCES)
    if len(model.ends) and not model.ends.plain:
        parts.append(_ELONGATIONS)
    elif single and len(model.ends):
        parts.append(_DISTANCES)
    for role, write in FORCE_LOOPS.items():
        if role == "coupling":  # after the contacts
            parts.append(_gathering(model))
        parts += [write(loop) for loop in loops if loop.kind.role == role]
    remembering = [loop for loop in loops if loop.kind.states]
    if remembering:
        parts += ["\n" + _ACCEPT, *map(accept_loop, remembering)]
    for role, what in _TIMETABLES.items():
        of_role = [loop for loop in loops if loop.kind.role == role]
        if of_role:
            parts += ["\n" + _TIMETABLE.format(name=role, what=what), *map(_timetable_loop, of_role)]
    return single_text("".join(parts)) if single else "".join(parts)


def _kernel_names(kinds: tuple[Kind, ...]) -> dict[Kind, str]:
    """Name each kernel after its class; classes of one name are numbered."""
    names: dict[Kind, str] = {}
    for kind in kinds:
        if kind.role == "intensity" and not any(k.kinematic for k in kinds if k.role == "intensity"):
            continue  # constant intensities are numbers, not code
        names[kind] = free_name(f"{kind.component.__name__}_{kind.kernel}", names.values())
    return names


def _header(model: Model, kernels: dict[str, str], single: bool) -> str:
    roles = {kind.role for kind in model.members.kinds}
    slowing = any(kind.slows for kind in model.members.kinds)
    tables = not roles.isdisjoint({"forcing", "modulation"}) or model.time_varying
    remembering = any(kind.states for kind in model.members.kinds)
    plain = ["differences", "gather"] if single else ["gather"]
    called = [] if not len(model.ends) else plain if model.ends.plain else ["elongations", "push_back"]
    kernels_from = "kick" if model.ends.plain or not called else "combinations"
    resident = bool(called) and model.ends.plain
    decorators = {"resident": resident, "timetable": tables}
    of_arrays = ["rows"] * bool(model.members.kinds) + ["value_at"] * remembering
    text = "\n".join(kernels.values())
    lines = [
        '"""Forces of a network of oscillators; generated by impactlab, not to be edited."""',
        "",
        *(["import math", ""] if "math." in text else []),
        *(["import numpy as np", ""] if "np." in text else []),
        *([f"from impactlab.kernels.arrays import {', '.join(of_arrays)}"] if of_arrays else []),
        "from impactlab.kernels.jit import FORCES, "
        + ", ".join(["pointer", *(name for name, wanted in decorators.items() if wanted)]),
        f"from impactlab.kernels.{kernels_from} import {', '.join(called) or 'clear'}",
        *(["from impactlab.kernels.memory import ACCEPT, accepting, remembered"] if remembering else []),
        *(["from impactlab.kernels.scalars import scalar"] if kernels else []),
        *(["from impactlab.kernels.slowing import stretch"] if slowing else []),
        *(["", *(f"{name} = resident({name}, FORCES)" for name in called)] if resident else []),
    ]
    return "\n".join(lines) + "\n"


def _gathering(model: Model) -> str:
    """Begin the total force with that of the contacts."""
    if not len(model.ends):
        return "    clear(total)\n"
    if not model.ends.plain:
        return "    push_back(indices, parameters, contact_force, total)\n"
    return "    gather(indices, contact_force, total)\n"


def _timetable_loop(loop: Loop) -> str:
    return (
        f"{loop.runs()}"
        "            for index in range(result.shape[0]):\n"
        f"                result[index, row + member] = {loop.call({'time': 'times[index]'})}\n"
    )
