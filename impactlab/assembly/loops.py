"""Loops of a generated module over the members of a kind: forces, and states of laws."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from impactlab.assembly.members import HEADER, LEADING, PLACES, SLIDING, Kind
from impactlab.compiling.inlined_forces import CHOICE
from impactlab.components.contact import SlidingFriction
from impactlab.components.evaluation import ELAPSED, TIME, UPDATE

FRICTION = "SlidingFriction_force"
"""Name of the kernel of the friction of contacts in a plane."""

_TAKEN = frozenset({
    "above", "after", "at", "at_most", "before", "begin", "below", "bend", "body", "by", "clear", "clearance",
    "closed", "contact_force", "count", "depth", "differences", "elongations", "end", "enough", "entry", "extension",
    "first", "followed", "force", "forces_of", "forces_on", "gap", "gaps", "gather", "given", "half_step",
    "indentation", "index", "indices", "interval", "jitter", "lane", "last", "last_force", "last_gap", "last_rate",
    "left", "math", "max", "member", "middle", "min", "mobility", "most", "near", "next_by", "next_force", "next_gap",
    "next_off", "next_rate", "np", "nudged", "number", "off", "off_after", "off_end", "parameters", "part", "place",
    "pull", "push_back", "r", "raised", "range", "rate", "refined", "response", "result", "rise", "row", "rows",
    "run", "second", "share", "slot", "slots", "some_v", "some_x", "speed", "start", "step", "stretch", "time",
    "times", "total", "touch", "touching", "twist", "v", "velocity", "within", "x",
    "distance", "mixed", "rubbing", "sliding", *SLIDING,
    *(f"{name}_{one}" for one in "xy" for name in (
        "along", "begin", "center", "end", "mobile", "mobile_begin", "mobile_end", "mobility", "off", "push", "speed",
        "toward",
    )), "mobility_xy",
})  # fmt: skip

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

_BETWEEN = '''
@scalar
def {name}_between(
    gap, rate, force, next_gap, next_rate, next_force, step, jitter{fields}
):
    """Return the largest force between the ends of a step that begins closed.

    The indentation is Hermite's cubic, the rate linear; so is what the forces of kicks are beyond those at
    these places and rates. Noise that changes the rate by the jitter in a step, root mean square, takes it
    beyond that at steps by 0.5826 of it, ``-zeta(1/2)/sqrt(2 pi)``.
    """
    next_off, raised = 0.0, 0.5826 * jitter
    off = force - {before}
    if next_gap > 0.0:
        next_off = next_force - {behind}
    by, next_by, rise = step * rate, step * next_rate, next_gap - gap
    bend, twist = cubic(by, next_by, rise)
    for part in range(1, 8):
        share = 0.125 * part
        depth = gap + share * (by + share * (bend + share * twist))
        if depth > 0.0:
            speed = rate + share * (next_rate - rate) + raised
            within = {within}
            force = max(force, within + off + share * (next_off - off))
    return force


@scalar
def {name}_followed(
    depth, speed, force, pull, interval, mobility, jitter, most{fields}
):
    """Follow a collision for an interval, under the pull of all else, and find the largest force.

    A kick feels the force at one place of a step, which depends on when the bodies touch. Noise raises the
    rate by less than of a force that changes slowly, as this one turns in a few steps: by 0.4 of the jitter.
    """
    interval, raised = 0.125 * interval, 0.4 * jitter
    for part in range(8):
        middle = max(depth + 0.5 * interval * speed, 0.0)
        rate = speed + 0.5 * interval * (pull - mobility * force)
        force = {followed}
        if 2.0 * force > most:
            rate += raised
            most = max(most, {followed})
        after = speed + interval * (pull - mobility * force)
        depth, speed = depth + 0.5 * interval * (speed + after), after
        if speed <= 0.0:
            break
    return depth, speed, force, most
'''


class Loop(NamedTuple):
    """A kind of members, over which loops are written."""

    number: int  # of the kind, among all of the network
    kind: Kind
    name: str  # of its kernel in the text
    single: bool  # whether for blocks of one lane
    plain: bool  # whether links are pairs; else they have weights

    def runs(self, *lines: str, slices: Sequence[str] = (), block: str = "x") -> str:
        """Open the loops over the runs of the kind and over the members of each, and read their parameters.

        `slices` name rows of arrays along a run, such as ``gaps = indentation[slot]``; `lines` begin a member.
        States have as many lanes as a `block`.
        """
        kind, leading, at = self.kind, LEADING[self.kind.role], PLACES + HEADER * self.number
        # those of a member inside the loop; clearance and mobility are no fields
        names = [*kind.leading, *map(_local, kind.fields)]
        entries = [*leading, "count", *(["start"] if names else [])]
        at_states, size = f"indices[at + {len(leading) + 2}]", len(leading) + 2 + bool(kind.states)
        parts = [item.replace("= ", "= rows(").replace("[", ", ").replace("]", ", count)") for item in slices]
        columns, parameters = self._parameters(names)
        parts += columns
        parts += [
            f"{row} = remembered(parameters, {at_states}{_times('-', k)}, count, {block})"
            for k, row in enumerate(self.rows)
        ]
        text = [
            f"# {kind.component.__name__}: {kind.role} of {', '.join(leading)}"
            + (f" with {', '.join(kind.parameters)}" if names else "")
            + (f"; states {', '.join(kind.states)}" if kind.states else ""),
            *([f"{TIME} = parameters[-2] + parameters[-1]"] if kind.timed else []),
            f"for run in range(indices[{at}]):",
            f"    at = indices[{at + 1}] + {size} * run",
            *(f"    {name} = indices[at{f' + {k}' if k else ''}]" for k, name in enumerate(entries)),
            *(f"    {part}" for part in parts),
            f"    for member in range({f'{slices[0].split()[0]}.shape[0]' if slices else 'count'}):",
            *(f"        {line}" for line in (*parameters, *lines)),
        ]
        return textwrap.indent("\n".join(text), "    ") + "\n"

    def _parameters(self, names: Sequence[str]) -> tuple[list[str], list[str]]:
        """Return the lines that find columns of parameters, and those that read the ones of a member under some names.

        A row of numbers has two columns, its place and its length.
        """
        columns, lines, k = [], [], 0
        for parameter, name in zip(self.kind.parameters, names, strict=True):
            place, after = (f"start{_times('+', number)}" for number in (k, k + 1))
            if parameter in self.kind.sampled:
                both = f"int(parameters[{place} + member]), int(parameters[{after} + member])"
                lines.append(f"{name} = rows(parameters, {both})")
                k += 2
            else:
                columns.append(f"column_{k} = rows(parameters, {place}, count)")
                lines.append(f"{name} = column_{k}[member]")
                k += 1
        return columns, lines

    @property
    def rows(self) -> list[str]:
        """Names of the rows of the states along a run."""
        return [f"remembered_{k}" for k in range(len(self.kind.states))]

    def call(self, values: Mapping[str, str]) -> str:
        """Call the kernel of the kind."""
        kinematic, fields = self.kind.component.arguments(self.kind.kernel)
        values = {TIME: TIME, **values}
        return f"{self.name}({', '.join([*(values[item] for item in kinematic), *map(_local, fields)])})"

    def over_kick(self, place: str, speed: str) -> str:
        """Call the function that solves the force of the kind for the velocity that it changes."""
        return f"{self.name}_over_kick({', '.join([place, speed, 'response', *self.over_kick_takes])})"

    @property
    def over_kick_takes(self) -> list[str]:
        """Further arguments of that function: the time, if the kernel depends on it, and the fields of the law."""
        kinematic, fields = self.kind.component.arguments(self.kind.kernel)
        return [*([TIME] if TIME in kinematic else []), *map(_local, fields)]

    def at_trial(self, **values: str) -> list[str]:
        """Find the states at a trial place, if the force reads them."""
        return [self.update(values, ", ".join(map(_local, self.kind.states)))] if self.kind.reads_states else []

    def update(self, values: Mapping[str, str], result: str) -> str:
        """Assign the states at some place to a result."""
        kinematic, fields = self.kind.component.arguments(UPDATE)
        old = {state: f"{row}[member, lane]" for state, row in zip(self.kind.states, self.rows, strict=True)}
        values = {**values, ELAPSED: "parameters[-1]", TIME: TIME}
        arguments = [*(values[item] for item in kinematic), *(old.get(item, _local(item)) for item in fields)]
        return f"{result} = {name_of(self.name, self.kind, UPDATE)}({', '.join(arguments)})"


def name_of(name: str, kind: Kind, kernel: str) -> str:
    """Return the name of a kernel of a kind, of which one has a `name`."""
    return name if kernel == kind.kernel else f"{name}_{kernel}"


def _local(field: str) -> str:
    """Name of the value of a field inside a loop, different from the names of the loop."""
    taken = field.rstrip("_") in _TAKEN or field.startswith(("column_", "remembered"))
    return f"{field}_" if taken else field


def _over_lanes(rows: str, lines: Sequence[str]) -> str:
    """Write the loop over the lanes of a member, of which there are as many as in some rows."""
    return f"            for lane in range({rows}.shape[1]):\n" + "".join(f"                {line}\n" for line in lines)


def _times(sign: str, count: int) -> str:
    return ("", f" {sign} count")[count] if count < 2 else f" {sign} {count} * count"


def friction_loop() -> Loop:
    """Return what stands for the kind of the friction of contacts in a plane, over which there is no loop."""
    return Loop(0, Kind("rubbing", SlidingFriction, "force"), FRICTION, False, False)


def slowing(loop: Loop) -> str:
    """Write the function that solves a force for the velocity that it changes."""
    component, kernel = loop.kind.component, loop.kind.kernel
    place, speed, *_ = component.kernels[kernel]
    at = {
        "speed": "speed",
        "nudged": "speed - 0.001 * given",
        "after": "after",
        "above": "r + near",
        "below": "r - near",
    }
    calls = {item: loop.call({place: place, speed: value}) for item, value in at.items()}
    fields = "".join(f", {item}" for item in loop.over_kick_takes)
    return _SLOWING.format(name=loop.name, place=place, fields=fields, **calls)


def between(loop: Loop) -> str:
    """Write the functions that find the largest force between the ends of a step, and that follow a collision."""
    at = {
        "before": ("gap", "rate"),
        "behind": ("next_gap", "next_rate"),
        "followed": ("middle", "rate"),
        "within": ("depth", "speed"),
    }
    calls = {item: loop.call({"indentation": depth, "rate": rate}) for item, (depth, rate) in at.items()}
    fields = "".join(f", {item}" for item in loop.over_kick_takes)
    return _BETWEEN.format(name=loop.name, fields=fields, **calls)


def _ends(loop: Loop) -> tuple[str, ...]:
    """Find the coordinates of a link: both ends, or the place and the entries of a weighted link."""
    if not loop.plain:
        link = LEADING[loop.kind.role][0]
        return (
            "at = indices[0]",
            "slots = at + indices[at]",
            f"begin, end = indices[at + 1 + {link} + member], indices[at + 2 + {link} + member]",
        )
    if loop.kind.role == "force":
        return "at = indices[2] + 2 * (slot + member)", "first = indices[at]", "second = indices[at + 1]"
    return ()


def _difference(loop: Loop, array: str) -> str:
    """Return the gap of a contact, or the extension of a coupling, between both ends in an array."""
    if loop.kind.role == "force":
        return f"{array}[first, lane] - {array}[second, lane]"
    return f"{array}[second + member, lane] - {array}[first + member, lane]"


def _sums(loop: Loop, **arrays: str) -> list[str]:
    """Add the weighted numbers of a link in the given arrays to sums with the given names."""
    sign = "+" if loop.kind.role == "force" else "-"
    sums = [
        f"    {name} {sign}= parameters[entry] * {item}[indices[slots + entry], lane]" for name, item in arrays.items()
    ]
    return ["for entry in range(begin, end):", *sums]


def _contact_loop(loop: Loop) -> str:
    """Write the loop over some contacts.

    The force of an open contact is 0, but not a number where the gap is infinite, so that a law without a finite
    value, which throws a body out of every contact, does not pass for an open one.
    """
    kind, distance = loop.kind, "gaps[member, lane]"
    begin: tuple[str, ...] = ()
    moving = kind.slows or "rate" in kind.kinematic
    if loop.plain:
        rate = [f"rate = {_difference(loop, 'middle')}{{own}}"]
        if moving or not loop.single:
            begin, distance = _ends(loop), _difference(loop, "x")
    else:
        rate = ["rate = 0.0{own}", *_sums(loop, rate="middle")]
        begin = _ends(loop) if moving else ()
    lines = [f"gap = {distance} - clearance"]
    at_gap = loop.at_trial(indentation="gap", rate="rate")
    if kind.slows:  # each alone: the rate without what this contact did to it in the pass before
        begin = (*begin, "response = half_step * mobility")
        lines += [
            "force = gap - gap",
            "if not gap <= 0.0:",
            *(f"    {line}".format(own=" + response * forces_of[member, lane]") for line in rate),
            *(f"    {line}" for line in at_gap),
            f"    force = {loop.over_kick('gap', 'rate')}",
            "gaps[member, lane] = gap",
            "forces_of[member, lane] = force",
        ]
    else:
        lines += [
            *(line.format(own="") for line in rate if at_gap and "rate" in kind.kinematic),
            *at_gap,
            f"force = {loop.call({'indentation': 'max(gap, 0.0)'})}",
            "gaps[member, lane] = gap",
            f"forces_of[member, lane] = {CHOICE}force",
        ]
    slices = "gaps = indentation[slot]", "forces_of = contact_force[slot]"
    return loop.runs(*begin, slices=slices) + _over_lanes("gaps", lines)


def _combination_loop(loop: Loop) -> str:
    """Write the loop over couplings of weighted coordinates."""
    lines = [
        "extension = 0.0",
        *_sums(loop, extension="x"),
        *(["rate = 0.0", *_sums(loop, rate="middle")] if "rate" in loop.kind.kinematic else []),
        *loop.at_trial(extension="extension", rate="rate"),
        f"force = {loop.call({'extension': 'extension', 'rate': 'rate'})}",
        "for entry in range(begin, end):",
        "    total[indices[slots + entry], lane] += parameters[entry] * force",
    ]
    return loop.runs(*_ends(loop)) + _over_lanes("total", lines)


def _coupling_loop(loop: Loop) -> str:
    lines = [
        f"extension = {_difference(loop, 'x')}",
        *[f"rate = {_difference(loop, 'middle')}"] * ("rate" in loop.kind.kinematic),
        *loop.at_trial(extension="extension", rate="rate"),
        f"force = {loop.call({'extension': 'extension', 'rate': 'rate'})}",
        "total[first + member, lane] += force",
        "total[second + member, lane] -= force",
    ]
    return loop.runs() + _over_lanes("total", lines)


def _residual_loop(loop: Loop) -> str:
    kind, place = loop.kind, "some_x[member, lane]"
    moving = kind.slows or "velocity" in kind.kinematic
    slices = ["forces_on = total[body]", "some_x = x[body]", *(["some_v = v[body]"] if moving else [])]
    trial = loop.at_trial(displacement=place, velocity="velocity" if kind.slows else "some_v[member, lane]")
    if kind.slows:  # after all other forces
        lines = [
            "velocity = some_v[member, lane] + response * forces_on[member, lane]",
            *trial,
            f"forces_on[member, lane] -= {loop.over_kick(place, 'velocity')}",
        ]
    else:
        lines = [*trial, f"forces_on[member, lane] -= {loop.call({'displacement': place})}"]
    response = ["response = half_step * mobility"] * kind.slows
    return loop.runs(*response, slices=slices) + _over_lanes("forces_on", lines)


def _in_plane(*lines: str) -> list[str]:
    """Return lines for x, then for y; `#` stands for the direction."""
    return [line.replace("#", direction) for direction in "xy" for line in lines]


def _round_loop(loop: Loop) -> str:
    """Write the loop over some contacts in a plane."""
    moving = loop.kind.slows or loop.kind.role == "rubbing"
    begin = ["at = indices[0]", "slots = at + indices[at]"]
    begin += _in_plane("begin_#, end_# = indices[at + 1 + along_# + member], indices[at + 2 + along_# + member]")
    begin += moving * _in_plane(
        "mobile_begin_#, mobile_end_# = indices[at + 1 + mobile_# + member], indices[at + 2 + mobile_# + member]"
    )
    sums = ["off_# = -center_#", "for entry in range(begin_#, end_#):"]
    sums += ["    off_# += parameters[entry] * x[indices[slots + entry], lane]"]
    pushes = ["for entry in range(begin_#, end_#):"]
    pushes += ["    total[indices[slots + entry], lane] -= parameters[entry] * push_#"]
    closed = [
        "toward_x, toward_y = off_x / distance, off_y / distance",
        *([*_in_the_middle(), *_solved(loop)] if moving else [f"force = {loop.call({'indentation': 'gap'})}"]),
        *_in_plane("push_# = force * toward_#"),
        *["push_x -= toward_y * rubbing", "push_y += toward_x * rubbing"] * (loop.kind.role == "rubbing"),
        *_in_plane(*pushes),
    ]
    lines = [
        *_in_plane(*sums),
        "distance = math.sqrt(off_x * off_x + off_y * off_y)",
        "gap = distance - clearance",
        "force = gap - gap",
        "if not gap <= 0.0:",
        *(f"    {line}" for line in closed),
        "gaps[member, lane] = gap",
        "forces_of[member, lane] = force",
    ]
    slices = "gaps = indentation[slot]", "forces_of = contact_force[slot]"
    return loop.runs(*begin, slices=slices) + _over_lanes("gaps", lines)


def _in_the_middle() -> list[str]:
    """Find the rates along the radius and across it in the middle of a kick by all forces before this one."""
    return [
        *_in_plane(
            "speed_# = 0.0",
            "for entry in range(begin_#, end_#):",
            "    speed_# += parameters[entry] * v[indices[slots + entry], lane]",
            "for entry in range(mobile_begin_#, mobile_end_#):",
            "    speed_# += half_step * parameters[entry] * total[indices[slots + entry], lane]",
        ),
        "rate = toward_x * speed_x + toward_y * speed_y",
        "sliding = toward_x * speed_y - toward_y * speed_x",
    ]


def _solved(loop: Loop) -> list[str]:
    """Solve the force of a contact in a plane for the velocity that it changes, and its friction.

    Where the normal force moves the body along the friction, or the reverse (as with different masses along x and y),
    the two forces are found in turn, twice.
    """
    kind, rubbing = loop.kind, loop.kind.role == "rubbing"
    xy, xx, yy = "toward_x * toward_y", "toward_x * toward_x", "toward_y * toward_y"
    mixed = f"mixed = half_step * ({xy} * (mobility_y - mobility_x) + ({xx} - {yy}) * mobility_xy)"
    along = f"response = half_step * ({xx} * mobility_x + {yy} * mobility_y + 2.0 * {xy} * mobility_xy)"
    across = f"response = half_step * ({yy} * mobility_x + {xx} * mobility_y - 2.0 * {xy} * mobility_xy)"
    if not rubbing:
        return [along, f"force = {loop.over_kick('gap', 'rate')}"]
    friction = f"rubbing = {FRICTION}_over_kick(force, sliding - mixed * force, response, {', '.join(SLIDING)})"
    if not kind.slows:
        return [mixed, across, f"force = {loop.call({'indentation': 'gap'})}", friction]
    each = [along, f"force = {loop.over_kick('gap', 'rate - mixed * rubbing')}", across, friction]
    return [mixed, "rubbing = 0.0", "for _ in range(2):", *(f"    {line}" for line in each)]


def peak_loop(loop: Loop) -> str:
    """Write the loop that finds the largest forces of contacts on the way to a step.

    A contact that closes is followed until it turns, and then read at steps and between them. Tiles do not sum all of
    their contacts.
    """
    takes, touching = ", ".join(loop.over_kick_takes), loop.call({"indentation": "0.0", "rate": "speed"})
    rate = [f"rate = {_difference(loop, 'v')}"] if loop.plain else ["rate = 0.0", *_sums(loop, rate="v")]
    states = [f"{_local(state)} = {row}[member, lane]" for state, row in zip(loop.kind.states, loop.rows, strict=True)]
    lines = [
        *rate,
        *states,
        "gap, force = gaps[member, lane], forces_of[member, lane]",
        "last_gap, last_rate = before[0, slot + member, lane], before[1, slot + member, lane]",
        "last_force, last = before[2, slot + member, lane], before[3, slot + member, lane]",
        "if gap > 0.0 or last_gap > 0.0:",
        *(
            f"    {line}"
            for line in (
                "depth, speed = before[4, slot + member, lane], before[5, slot + member, lane]",
                "within, most = before[6, slot + member, lane], before[7, slot + member, lane]",
                "if not most > 0.0:",
                "    most = 0.0",
                "left, closed = step, last_gap > 0.0 and last == number - 1.0",
                "pull = (rate - last_rate) / step + 0.5 * mobility * (force + last_force)",
                "if gap > 0.0 and last_gap <= 0.0 and last == number - 1.0:",
                "    by = step * (last_rate + 0.5 * step * pull)",
                "    touch = min(-last_gap / by, 1.0) if by > 0.0 else 1.0",
                "    depth, speed, left = 0.0, last_rate + touch * step * pull, (1.0 - touch) * step",
                "    if speed > 0.0:",
                f"        within = {touching}",
                "        most = max(most, within)",
                "elif not (gap > 0.0 and closed):",
                "    speed = 0.0",
                "if speed > 0.0:",
                f"    depth, speed, within, most = {loop.name}_followed(",
                "        depth, speed, within, pull, left, mobility, jitter[slot + member], most,",
                f"        {takes}",
                "    )",
                "elif closed and max(rate, last_rate) > 0.0 and 4.0 * max(force, last_force) > most:",
                f"    at_most = {loop.name}_between(",
                "        last_gap, last_rate, last_force, gap, rate, force, step, jitter[slot + member],",
                f"        {takes}",
                "    )",
                "    most = max(most, max(force, at_most))",
                "else:",
                "    most = max(most, force)",
                "before[4, slot + member, lane], before[5, slot + member, lane] = depth, speed",
                "before[6, slot + member, lane], before[7, slot + member, lane] = within, most",
            )
        ),
        "before[0, slot + member, lane], before[1, slot + member, lane] = gap, rate",
        "before[2, slot + member, lane], before[3, slot + member, lane] = force, number",
    ]
    begin = "if slot + member >= before.shape[1]:", "    break", *_ends(loop)
    slices = "gaps = indentation[slot]", "forces_of = contact_force[slot]"
    return loop.runs(*begin, slices=slices, block="v") + _over_lanes("gaps", lines)


FORCE_LOOPS = {
    "force": _contact_loop,
    "coupling": _coupling_loop,
    "combination": _combination_loop,
    "residual": _residual_loop,
    "round": _round_loop,
    "rubbing": _round_loop,
}
"""Functions that write the forces of each role, in the order of the text."""


def accept_loop(loop: Loop) -> str:
    """Write the loop that accepts the states with which the forces of a kind were evaluated.

    States that the force of a contact does not read, such as the work of its friction, are evaluated at the mean rate
    during the kick instead, so that force times rate is the power of the kick.
    """
    kind = loop.kind
    begin: tuple[str, ...] = ()
    slices: tuple[str, ...] = ()
    sums: list[str] = []
    targets = [f"{row}[member, lane]" for row in loop.rows]
    if kind.role == "residual":
        values = {"displacement": "x[body + member, lane]", "velocity": "v[body + member, lane]"}
    else:
        begin, extension, rate = _ends(loop), "extension", "rate"
        if loop.plain:
            extension, rate = (_difference(loop, item) for item in "xv")
        else:
            sums = ["extension, rate = 0.0, 0.0", *_sums(loop, extension="x", rate="v")]
        values = {"extension": extension, "indentation": f"{extension} - clearance", "rate": rate}
    lines = [loop.update(values, ", ".join(targets))]
    if kind.rated and kind.reads_states:
        begin, slices = (*begin, "response = half_step * mobility"), ("forces_of = contact_force[slot]",)
        # the rate without what this contact did to it, which has just closed or not, as in a kick
        values_of_force = {**values, "rate": f"{rate} + response * forces_of[member, lane]"}
        read = [name in kind.component.arguments(kind.kernel)[1] for name in kind.states]
        new, other = [[f"{name}_{k}" for k in range(len(read))] for name in ("new", "other")]
        if all(read):
            lines = [loop.update(values_of_force, ", ".join(targets))]
        else:
            chosen = [one if own else mean for own, one, mean in zip(read, new, other, strict=True)]
            lines = [
                loop.update(values_of_force, ", ".join(new)),
                loop.update(values, ", ".join(other)),
                f"{', '.join(targets)} = {', '.join(chosen)}",
            ]
    return loop.runs(*begin, slices=slices) + _over_lanes("x", [*sums, *lines])
