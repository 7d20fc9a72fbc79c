"""From a model to the text of a module: one loop per kind of component. Pure.

The text depends on the kinds of components only, never on how many there are or on
their parameters, which travel in arrays. It holds the source of every kernel: numbers
that a kernel reads from its module become literals, helper functions it calls are
copied, anything else is refused with file and line. (Importing the kernels instead would
miss changes in the imported file on a cache hit, and would not work for a script.)
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Sequence
from typing import NamedTuple

from impactlab.assembly.inlining import Inliner, free_name
from impactlab.assembly.members import HEADER, LEADING, PLACES, Kind
from impactlab.assembly.model import Model, kept
from impactlab.components.component import ELAPSED, UPDATE
from impactlab.kernels.single import single_text

_TAKEN = frozenset({
    "above", "after", "at", "begin", "below", "body", "clear", "clearance", "contact_force", "count", "differences",
    "elongations", "end", "enough", "entry", "extension", "first", "force", "forces_of", "forces_on", "gap", "gaps",
    "gather", "given", "half_step",
    "indentation", "index", "indices", "lane", "math", "max", "member", "middle", "mobility", "near", "np", "nudged",
    "off", "off_after", "off_end", "parameters", "push_back", "r",
    "range", "rate", "refined", "response", "result", "row", "rows",
    "run", "second", "share", "slot", "slots", "some_v", "some_x", "speed", "start", "stretch", "times", "total", "v",
    "velocity", "x",
})  # fmt: skip

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

_ALONG = (
    "at = indices[0]",
    "slots = at + indices[at]",
    "begin, end = indices[at + 1 + {link} + member], indices[at + 2 + {link} + member]",
)
"""Where the coordinates of a link with weights stand, and its entries."""

_ALONG_RATE = (
    "for entry in range(begin, end):",
    "    rate {sign}= parameters[entry] * middle[indices[slots + entry], lane]",
)

_TIMETABLE = '''
@timetable
def {name}(times, parameters, indices, result):
    """Write {what} at some times, result[time, row]."""
'''

_TIMETABLES = {
    "forcing": "the given force on every forced body",
    "intensity": "the two-sided spectral density of every white noise",
}


_SLOWING = '''
@scalar
def {name}_over_kick({place}, speed, response{fields}):
    """Return the force of a kick that takes ``2 response force`` from a velocity, half up to its middle.

    It acts at r of ``r + share force(r) = speed``, found by secants, bracketed if they can be; the
    share is the response, then what the slope of the force at that r makes of it.
    """
    result = force = {speed}
    share = response
    for refined in range(2):
        given = share * force
        if given == 0.0:
            break
        nudged = share * {nudged}
        end, off_end, r, off = speed, given, speed, given
        after = speed - given / (1.0 + max(1000.0 * (given - nudged) / given, -0.5))
        enough = 1e-6 * abs(given)
        for _ in range(51):
            off_after = after - speed + share * {after}
            if off * off_after < 0.0 or off * off_end > 0.0:
                end, off_end = r, off
            else:
                off_end *= 0.5
            r, off = after, off_after
            if abs(off) <= enough or abs(r - end) <= enough or off == off_end:
                break
            after = r - off * (r - end) / (off - off_end)
        if refined:
            result = (speed - r) / share
            break
        near = 0.001 * (speed - r)
        if near == 0.0:
            break
        above = {above}
        below = {below}
        share = response * stretch(response * (above - below) / near)
    return result
'''


def _slowing(kind: Kind, name: str) -> str:
    """Text of the function that solves a force for the velocity that it changes."""
    place, speed = kind.component.kernels[kind.kernel]
    at = {
        "speed": "speed",
        "nudged": "speed - 0.001 * given",
        "after": "after",
        "above": "r + near",
        "below": "r - near",
    }
    calls = {item: _call(kind, name, {place: place, speed: value}) for item, value in at.items()}
    fields = "".join(f", {_local(field)}" for field in kind.component.arguments(kind.kernel)[1])
    return _SLOWING.format(name=name, place=place, fields=fields, **calls)


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
    taken = {_name_of(name, kind, kernel) for kind, name in names.items() for kernel in kind.kernels}
    for kind, name in names.items():
        for kernel in kind.kernels:
            Inliner(name, kernels, taken).inline(getattr(kind.component, kernel), _name_of(name, kind, kernel))
    form, parts = _Form(single, model.ends.plain), [_header(model, kernels, single)]
    parts += [f"\n\n@scalar\n{text}\n" for text in kernels.values()]
    parts += [f"\n{_slowing(kind, names[kind])}" for kind in model.members.kinds if kind.slows]
    parts.append("\n" + _FORCES)
    if len(model.ends) and not model.ends.plain:
        parts.append(_ELONGATIONS)
    elif single and len(model.ends):
        parts.append(_DISTANCES)
    for role in _LOOPS:
        if role == "coupling":  # after the contacts
            parts.append(_gathering(model))
        parts += [
            _LOOPS[role](index, kind, names[kind], form)
            for index, kind in enumerate(model.members.kinds)
            if kind.role == role
        ]
    if any(kind.states for kind in model.members.kinds):
        parts.append("\n" + _ACCEPT)
        parts += [_accept_loop(i, kind, names[kind], form) for i, kind in enumerate(model.members.kinds) if kind.states]
    for role, what in _TIMETABLES.items():
        if (role == "forcing" and model.members.of_role(role)) or (role == "intensity" and model.time_varying):
            parts.append("\n" + _TIMETABLE.format(name=role, what=what))
            parts += [
                _timetable_loop(i, kind, names[kind]) for i, kind in enumerate(model.members.kinds) if kind.role == role
            ]
    return single_text("".join(parts)) if single else "".join(parts)


def _kernel_names(kinds: tuple[Kind, ...]) -> dict[Kind, str]:
    """Name each kernel after its class; classes of one name are numbered."""
    names: dict[Kind, str] = {}
    for kind in kinds:
        if kind.role == "intensity" and not any(k.kinematic for k in kinds if k.role == "intensity"):
            continue  # constant intensities are numbers, not code
        names[kind] = free_name(f"{kind.component.__name__}_{kind.kernel}", names.values())
    return names


def _name_of(name: str, kind: Kind, kernel: str) -> str:
    """Return the name of a kernel of a kind, of which one has a `name`."""
    return name if kernel == kind.kernel else f"{name}_{kernel}"


def _header(model: Model, kernels: dict[str, str], single: bool) -> str:
    roles = {kind.role for kind in model.members.kinds}
    slowing = any(kind.slows for kind in model.members.kinds)
    tables = "forcing" in roles or model.time_varying
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


def _run(index: int, kind: Kind, *lines: str, slices: tuple[str, ...] = ()) -> str:
    """Open the loops over the runs of a kind and over the members of each, and read their parameters.

    `slices` name rows of arrays along a run, such as ``gaps = indentation[slot]``; `lines` begin a member.
    """
    leading, at, names = LEADING[kind.role], PLACES + HEADER * index, _parameters(kind)
    entries = [*leading, "count", *(["start"] if names else [])]
    at_states, size = f"indices[at + {len(leading) + 2}]", len(leading) + 2 + bool(kind.states)
    parts = [item.replace("= ", "= rows(").replace("[", ", ").replace("]", ", count)") for item in slices]
    parts += [f"column_{k} = rows(parameters, start{_times(k)}, count)" for k in range(len(names))]
    parts += [f"{_row(k)} = remembered(parameters, {at_states}{_less(k)}, count, x)" for k in range(len(kind.states))]
    text = [
        f"# {kind.component.__name__}: {kind.role} of {', '.join(leading)}"
        + (f" with {', '.join(kind.parameters)}" if names else "")
        + (f"; states {', '.join(kind.states)}" if kind.states else ""),
        f"for run in range(indices[{at}]):",
        f"    at = indices[{at + 1}] + {size} * run",
        *(f"    {name} = indices[at{_plus(k)}]" for k, name in enumerate(entries)),
        *(f"    {part}" for part in parts),
        f"    for member in range({slices[0].split(' ')[0]}.shape[0]):"
        if slices
        else "    for member in range(count):",
        *(f"        {name} = column_{k}[member]" for k, name in enumerate(names)),
        *(f"        {line}" for line in lines),
    ]
    return textwrap.indent("\n".join(text), "    ") + "\n"


def _over_lanes(rows: str, lines: Sequence[str]) -> str:
    """Write the loop over the lanes of a member, of which there are as many as in some rows."""
    return f"            for lane in range({rows}.shape[1]):\n" + "".join(f"                {line}\n" for line in lines)


def _parameters(kind: Kind) -> list[str]:
    """Names of the parameters of a member inside a loop; the clearance is not a field."""
    return [*kind.parameters[: len(kind.parameters) - len(kind.fields)], *map(_local, kind.fields)]


def _times(count: int) -> str:
    return ("", " + count")[count] if count < 2 else f" + {count} * count"


def _plus(offset: int) -> str:
    return f" + {offset}" if offset else ""


def _less(count: int) -> str:
    return ("", " - count")[count] if count < 2 else f" - {count} * count"


def _row(state: int) -> str:
    """Name of the rows of a state inside a loop."""
    return f"remembered_{state}"


def _call(kind: Kind, name: str, values: dict[str, str]) -> str:
    """Call the kernel of a kind."""
    kinematic, fields = kind.component.arguments(kind.kernel)
    return f"{name}({', '.join([*(values[item] for item in kinematic), *(_local(item) for item in fields)])})"


def _update(kind: Kind, name: str, values: dict[str, str], result: str | None = None) -> str:
    """Assign the states at some place to their names, or to another `result`."""
    kinematic, fields = kind.component.arguments(UPDATE)
    old = {state: f"{_row(k)}[member, lane]" for k, state in enumerate(kind.states)}
    values = {**values, ELAPSED: "parameters[-1]"}
    arguments = [*(values[item] for item in kinematic), *(old.get(item, _local(item)) for item in fields)]
    new = result or ", ".join(map(_local, kind.states))
    return f"{new} = {_name_of(name, kind, UPDATE)}({', '.join(arguments)})"


def _local(field: str) -> str:
    """Name of a field's value inside a loop, where some names are taken."""
    taken = field.rstrip("_") in _TAKEN or field.startswith(("column_", "remembered"))
    return f"{field}_" if taken else field


class _Form(NamedTuple):
    """What the text is for: blocks of one lane or of many, and links that are pairs or have weights."""

    single: bool
    plain: bool


def _contact_loop(index: int, kind: Kind, name: str, form: _Form) -> str:
    """Write the loop over some contacts.

    The force of an open contact is 0, but not a number where the gap is infinite, so that a law without a finite
    value, which throws a body out of every contact, does not pass for an open one.
    """
    place: tuple[str, ...] = ()
    distance, rate = "gaps[member, lane]", ["rate = middle[first, lane] - middle[second, lane]{own}"]
    if not form.plain and (kind.slows or "rate" in kind.kinematic):
        place = tuple(line.format(link="slot") for line in _ALONG)
        rate = ["rate = 0.0{own}", *(line.format(sign="+") for line in _ALONG_RATE)]
    elif form.plain and (not form.single or kind.slows or "rate" in kind.kinematic):
        place = "at = indices[2] + 2 * (slot + member)", "first = indices[at]", "second = indices[at + 1]"
        distance = "x[first, lane] - x[second, lane]"
    lines = [f"gap = {distance} - clearance"]
    at_gap = _trial(kind, name, {"indentation": "gap", "rate": "rate"})
    if kind.slows:  # each alone: the rate without what this contact did to it in the pass before
        place = (*place, "response = half_step * mobility")
        lines += [
            "force = gap - gap",
            "if not gap <= 0.0:",
            *(f"    {line}".format(own=" + response * forces_of[member, lane]") for line in rate),
            *(f"    {line}" for line in at_gap),
            f"    force = {_over_kick(kind, name, 'gap', 'rate')}",
            "gaps[member, lane] = gap",
            "forces_of[member, lane] = force",
        ]
    else:
        lines += [
            *(line.format(own="") for line in rate if at_gap and "rate" in kind.kinematic),
            *at_gap,
            f"force = {_call(kind, name, {'indentation': 'max(gap, 0.0)'})}",
            "gaps[member, lane] = gap",
            "forces_of[member, lane] = gap - gap if gap <= 0.0 else force",
        ]
    slices = "gaps = indentation[slot]", "forces_of = contact_force[slot]"
    return _run(index, kind, *place, slices=slices) + _over_lanes("gaps", lines)


def _over_kick(kind: Kind, name: str, place: str, speed: str) -> str:
    fields = kind.component.arguments(kind.kernel)[1]
    return f"{name}_over_kick({', '.join([place, speed, 'response', *map(_local, fields)])})"


def _trial(kind: Kind, name: str, values: dict[str, str]) -> list[str]:
    """Find the states at a trial place, if the force reads them."""
    return [_update(kind, name, values)] if kind.reads_states else []


def _gathering(model: Model) -> str:
    """Begin the total force with that of the contacts."""
    if not len(model.ends):
        return "    clear(total)\n"
    if not model.ends.plain:
        return "    push_back(indices, parameters, contact_force, total)\n"
    return "    gather(indices, contact_force, total)\n"


def _combination_loop(index: int, kind: Kind, name: str, form: _Form) -> str:
    """Write the loop over some couplings in a network with weights."""
    rate = ["rate = 0.0", *(line.format(sign="-") for line in _ALONG_RATE)] if "rate" in kind.kinematic else []
    lines = [
        "extension = 0.0",
        "for entry in range(begin, end):",
        "    extension -= parameters[entry] * x[indices[slots + entry], lane]",
        *rate,
        *_trial(kind, name, {"extension": "extension", "rate": "rate"}),
        f"force = {_call(kind, name, {'extension': 'extension', 'rate': 'rate'})}",
        "for entry in range(begin, end):",
        "    total[indices[slots + entry], lane] += parameters[entry] * force",
    ]
    return _run(index, kind, *(line.format(link="link") for line in _ALONG)) + _over_lanes("total", lines)


def _coupling_loop(index: int, kind: Kind, name: str, form: _Form) -> str:
    values = {"extension": "extension", "rate": "rate"}
    lines = [
        "extension = x[second + member, lane] - x[first + member, lane]",
        *["rate = middle[second + member, lane] - middle[first + member, lane]"] * ("rate" in kind.kinematic),
        *_trial(kind, name, values),
        f"force = {_call(kind, name, values)}",
        "total[first + member, lane] += force",
        "total[second + member, lane] -= force",
    ]
    return _run(index, kind) + _over_lanes("total", lines)


def _residual_loop(index: int, kind: Kind, name: str, form: _Form) -> str:
    moving = kind.slows or "velocity" in kind.kinematic
    slices = ["forces_on = total[body]", "some_x = x[body]", *(["some_v = v[body]"] if moving else [])]
    place = "some_x[member, lane]"
    speed = "velocity" if kind.slows else "some_v[member, lane]"
    trial = _trial(kind, name, {"displacement": place, "velocity": speed})
    if kind.slows:  # after all other forces
        lines = [
            "velocity = some_v[member, lane] + response * forces_on[member, lane]",
            *trial,
            f"forces_on[member, lane] -= {_over_kick(kind, name, place, 'velocity')}",
        ]
    else:
        lines = [*trial, f"forces_on[member, lane] -= {_call(kind, name, {'displacement': place})}"]
    response = ["response = half_step * mobility"] * kind.slows
    return _run(index, kind, *response, slices=tuple(slices)) + _over_lanes("forces_on", lines)


def _accept_loop(index: int, kind: Kind, name: str, form: _Form) -> str:
    """Write the loop that changes the states of a kind."""
    of_member: tuple[str, ...] = ()
    along: list[str] = []
    if kind.role == "residual":
        values = {"displacement": "x[body + member, lane]", "velocity": "v[body + member, lane]"}
    elif not form.plain:
        link, sign = ("slot", "+") if kind.role == "force" else ("link", "-")
        of_member = tuple(line.format(link=link) for line in _ALONG)
        along = ["extension, rate = 0.0, 0.0", _ALONG_RATE[0]]
        along += [
            f"    {sum_} {sign}= parameters[entry] * {item}[indices[slots + entry], lane]"
            for sum_, item in (("extension", "x"), ("rate", "v"))
        ]
        values = {"extension": "extension", "indentation": "extension - clearance", "rate": "rate"}
    else:
        ends = "first + member", "second + member"
        if kind.role == "force":
            of_member = "at = indices[2] + 2 * (slot + member)", "first = indices[at]", "second = indices[at + 1]"
            ends = "second", "first"
        of_x, of_v = (f"{item}[{ends[1]}, lane] - {item}[{ends[0]}, lane]" for item in "xv")
        values = {"extension": of_x, "indentation": f"{of_x} - clearance", "rate": of_v}
    new = ", ".join(f"{_row(k)}[member, lane]" for k in range(len(kind.states)))
    return _run(index, kind, *of_member) + _over_lanes("x", [*along, _update(kind, name, values, new)])


def _timetable_loop(index: int, kind: Kind, name: str) -> str:
    call = _call(kind, name, {"time": "times[index]"})
    return (
        f"{_run(index, kind)}"
        "            for index in range(result.shape[0]):\n"
        f"                result[index, row + member] = {call}\n"
    )


_LOOPS: dict[str, Callable[[int, Kind, str, _Form], str]] = {
    "force": _contact_loop,
    "coupling": _coupling_loop,
    "combination": _combination_loop,
    "residual": _residual_loop,
}
