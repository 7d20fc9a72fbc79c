"""Networks under scaled records, or realizations of a random excitation, and how far forms reach in each of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np

from impactlab.assembly.model import Model
from impactlab.components.excitation import BaseMotion, Excitation, Source
from impactlab.components.loads import SampledForce
from impactlab.errors import InvalidInput, unheard, warn
from impactlab.inputs import positive, whole
from impactlab.integrators.exact_flow import ExactFlow
from impactlab.machine import cores
from impactlab.networks.network import Network
from impactlab.plan.plan import Plan
from impactlab.plan.request import Request
from impactlab.plan.seed import Seed
from impactlab.results.labels import Variables, labelled
from impactlab.simulation.ensemble import Execution, run
from impactlab.simulation.planning import make_plan
from impactlab.simulation.recorded_runs import Form, Ranges, records_in_lanes, with_ranges, with_records

TYPICAL_ERROR = 1e-3
"""Typical error of peaks by the step, as a part of the peaks: the median over all tried motions."""

LANES_OF_CORE = 1040
"""Realizations of a call on each core: two blocks."""

TRIED_RECORDS, TRIED_SCALES = 24, 6
"""Records and scales, or realizations and scales, with which the step is chosen."""

STEP_TRIALS = 8
"""Steps that are tried at most."""

ORDER_OF_PEAKS = 1.5
"""Power of the step with which the error of peaks falls, between 1 and 2 where contacts close within steps."""

OF_CHANGE = 1.0 / (1.0 - 0.5**ORDER_OF_PEAKS)
"""Error of a step, by the change that half of it makes."""

BETWEEN_LOOKS = 0.25
"""Time between looks at forms, in steps of the rules: Hermite's cubic is then 1e-6 off, and a closed contact is seen 25
times."""

FORESEEN = 0.9
"""Part of the step foreseen to be short enough that is taken."""

RECORD_TIMES, RECORD_VALUES = "record_time", "record_value"
"""Variables that hold records."""

SAME_DISTANCE = 1e-6
"""Part of a distance of samples by which others may differ from it."""

Make = Callable[[Any], Network]


class ScaledMotions(Protocol):
    """What moves a network at different scales."""

    @property
    def number(self) -> int: ...

    @property
    def fitting(self) -> float: ...

    @property
    def smooth(self) -> bool: ...

    def plan(self, step: float | None) -> Plan: ...

    def ranges(
        self, forms: Sequence[Form], chosen: np.ndarray, scales: np.ndarray, steps: StepsAndLooks, where: Execution,
        show: Callable[[float], None],
    ) -> np.ndarray: ...  # fmt: skip


class StepsAndLooks(NamedTuple):
    """How steps are made."""

    step: float  # (s)
    looks: float = 0.0  # longest time between looks at forms (s); none is longer than a step where this is 0
    coarse: bool = False  # whether this is the coarse run of a pair with common noise


class ChosenSteps(NamedTuple):
    """Steps, and the errors of peaks by them, as parts of the peaks."""

    steps: StepsAndLooks
    typical: float  # the median
    large: float  # nine of ten are smaller


@dataclass(frozen=True, eq=False)
class RecordedMotions:
    """Given forces, such as samples of the acceleration of the ground, one of which moves a network at a time."""

    records: tuple[SampledForce, ...]
    network: Network  # with the strongest of them at the largest scale
    sources: tuple[str, ...]  # names of the excitations where it is
    duration: float  # (s)
    ends: np.ndarray  # (record,) until when each counts (s)
    smooth: ClassVar[bool] = True
    """Whether paths have no noise within steps."""

    @classmethod
    def of(cls, make: Make, records: Sequence[Any], scales: np.ndarray, duration: float | None) -> RecordedMotions:
        """Return the motions of the network that a function makes of a record, or refuse what cannot be used."""
        for number, record in enumerate(records):
            if not isinstance(record, SampledForce):
                raise InvalidInput(
                    f"records[{number}] must be an il.SampledForce(times, values), not {record!r}; or give one random "
                    "excitation in the place of all records, with realizations=."
                )
        if len(records) < 2:
            raise InvalidInput(f"records must be two at least, not {len(records)}.")
        lasts = np.array([record.times[-1] for record in records])
        length = float(lasts.max()) if duration is None else positive("duration", duration)
        known = np.array([record.known_until for record in records])
        if duration is not None and (known < length * (1.0 - SAME_DISTANCE)).any():
            short = int((known < length * (1.0 - SAME_DISTANCE)).argmax())
            raise InvalidInput(
                f"records[{short}] ends at {known[short]:g} s, before the duration of {length:g} s; give it "
                'after="zero", or a shorter duration=.'
            )
        strongest = records[int(np.argmax([np.abs(item.scale * np.array(item.values)).max() for item in records]))]
        longest = strongest.replace(scale=float(scales[-1]) * strongest.scale, after="zero")
        network, sources = network_of(make, longest)
        ends = np.full(len(records), length) if duration is not None else lasts
        result = cls(tuple(records), network, sources, length, ends)
        result.check()
        return result

    def check(self) -> None:
        """Refuse networks in which something else is random, or a record is the motion of a body."""
        model = self.model
        if model.random.any():
            noisy = model.bodies.names[int(np.flatnonzero(model.random)[0])]
            raise InvalidInput(f"A noise moves {noisy!r}: beside records nothing may be random.")
        drives = model.sources["force"].drives
        moved = drives.body[np.isin(drives.source, self.numbers)]
        if not model.bodies.free[moved].all():
            raise InvalidInput("A record is the motion of a body; records must be forces, or motions of the ground.")

    @property
    def number(self) -> int:
        """Number of records."""
        return len(self.records)

    @cached_property
    def model(self) -> Model:
        """The network as arrays."""
        return Model.of(self.network)

    @property
    def numbers(self) -> list[int]:
        """Numbers of the given forces that are the record."""
        return [place for place, name in enumerate(self.model.sources["force"].names) if name in self.sources]

    @property
    def fitting(self) -> float:
        """Time that steps should divide (s): the distance of all samples if it is one, else the whole duration."""
        distances = set[float]()
        for record in self.records:
            apart = np.diff(record.times)
            if np.ptp(apart) > SAME_DISTANCE * apart[0] or _apart(record.times[0], apart[0]):
                return self.duration
            distances.add(round(float(apart.mean()) / float(apart[0]), 6) * float(apart[0]))
        one = min(distances)
        same = max(distances) - one <= SAME_DISTANCE * one and not _apart(self.duration, one)
        return one if same else self.duration

    def with_network(self, network: Network) -> RecordedMotions:
        """Return the same records on another network."""
        return replace(self, network=network)

    def stored(self) -> tuple[dict[str, Any], Variables]:
        """Return options and variables that hold the records."""
        rows = [np.stack([record.times, record.values]) for record in self.records]
        most = max(row.shape[1] for row in rows)
        times, values = np.stack(
            [np.pad(row, ((0, 0), (0, most - row.shape[1])), constant_values=np.nan) for row in rows], axis=1
        )
        same = bool((times == times[0]).all())
        variables = {
            RECORD_TIMES: labelled(
                ("sample",) if same else ("record", "sample"), times[0] if same else times, "s", "time"
            ),
            RECORD_VALUES: labelled(("record", "sample"), values, "", "record before it is scaled"),
        }
        fields = ("scale", "after", "interpolation")
        return {"records": [{name: getattr(record, name) for name in fields} for record in self.records]}, variables

    def plan(self, step: float | None, lanes: int = 2) -> Plan:
        """Return the plan of lanes with the strongest record."""
        return _plan_from_rest(self.model, Seed(0, 0), self.duration, step, lanes)

    def ranges(
        self, forms: Sequence[Form], chosen: np.ndarray, scales: np.ndarray, steps: StepsAndLooks, where: Execution,
        show: Callable[[float], None],
    ) -> np.ndarray:  # fmt: skip
        """Return least, largest and first values of forms, (form, 3, record, scale), of some records at all scales."""
        at_once = max(1, where.workers * LANES_OF_CORE // len(scales))
        result = np.empty((len(forms), 3, len(chosen), len(scales)))
        for begin in range(0, len(chosen), at_once):
            part = chosen[begin : begin + at_once]
            lanes, records = len(part) * len(scales), [self.records[number] for number in part]
            plan = self.plan(steps.step, max(lanes, 2))
            of_lanes = records_in_lanes(
                self.model, self.numbers, records, scales, plan.clock.step, plan.clock.all_steps
            )
            plan = with_records(plan, of_lanes, self.numbers)
            plan = replace(plan, realizations=replace(plan.realizations, number=lanes))

            def shown(done: float, begin: int = begin, count: int = len(part)) -> None:
                show((begin + done * count) / len(chosen))

            found = _run(plan, forms, np.repeat(self.ends[part], len(scales)), steps.looks, where, shown)
            result[:, :, begin : begin + len(part)] = found.reshape(len(forms), 3, len(part), len(scales))
        return result


@dataclass(frozen=True, eq=False)
class RandomMotions:
    """Realizations of a random excitation, the same ones at all scales."""

    excitation: Excitation
    network: Network
    sources: tuple[str, ...]  # names of the excitations that are scaled
    duration: float  # (s)
    number: int
    seed: tuple[int, int]
    smooth: ClassVar[bool] = False
    """Whether paths have no noise within steps."""

    @classmethod
    def of(
        cls, make: Make, excitation: Excitation, duration: float | None, realizations: Any, seed: tuple[int, int]
    ) -> RandomMotions:
        """Return the motions of the network that a function makes of a random excitation."""
        number = whole("realizations", realizations, 2)
        if duration is None:
            raise InvalidInput("A random excitation has no end: give duration= (s).")
        network, sources = network_of(make, excitation)
        for name in sources:
            if isinstance(network.given()["excitations"][name], Excitation):
                raise InvalidInput(
                    f"The excitation of {name!r} cannot be scaled; give it as an il.Source, on={{{name!r}: 1.0}}, "
                    f"under a name of its own, or as an il.BaseMotion."
                )
        return cls(excitation, network, sources, positive("duration", duration), number, seed)

    @property
    def fitting(self) -> float:
        """Time that steps should divide (s)."""
        return self.duration

    def with_network(self, network: Network) -> RandomMotions:
        """Return the same realizations on another network."""
        return replace(self, network=network)

    def stored(self) -> tuple[dict[str, Any], Variables]:
        """Return options that hold the excitation, and no variables."""
        data = self.excitation.to_dict()
        return {"records": data, "realizations": self.number, "seed": list(self.seed)}, {}

    def plan(self, step: float | None, scale: float = 1.0, lanes: int = 2, coarse: bool = False) -> Plan:
        """Return the plan of some realizations at a scale."""
        network = with_scale(self.network, self.sources, scale)
        return _plan_from_rest(Model.of(network), self.seed, self.duration, step, lanes, coarse)

    def ranges(
        self, forms: Sequence[Form], chosen: np.ndarray, scales: np.ndarray, steps: StepsAndLooks, where: Execution,
        show: Callable[[float], None],
    ) -> np.ndarray:  # fmt: skip
        """Return the same of as many realizations as are chosen, from the first on."""
        result = np.empty((len(forms), 3, len(chosen), len(scales)))
        for place, scale in enumerate(scales.tolist()):
            plan = self.plan(steps.step, scale, len(chosen), steps.coarse)

            def shown(done: float, place: int = place) -> None:
                show((place + done) / len(scales))

            result[..., place] = _run(plan, forms, np.full(len(chosen), self.duration), steps.looks, where, shown)
        return result


def network_of(make: Make, excitation: Excitation) -> tuple[Network, tuple[str, ...]]:
    """Return the network that a function makes of an excitation, and the names under which it has this."""
    if not callable(make):
        raise InvalidInput(f"make must be a function that returns an il.Network of a record, not {make!r}.")
    network = make(excitation)
    if not isinstance(network, Network):
        raise InvalidInput(f"make must return an il.Network, not {network!r}.")
    sources = [name for name, item in network.given()["excitations"].items() if _inner(item) is excitation]
    if not sources:
        raise InvalidInput(
            "make must use the record itself as an excitation of the network that it returns, such as "
            'excitations={"ground": il.BaseMotion(record)}.'
        )
    return network, tuple(sources)


def _inner(item: Any) -> Any:
    """Return the excitation of a member of a network."""
    if isinstance(item, BaseMotion):
        return item.acceleration
    return item.excitation if isinstance(item, Source) else item


def with_excitation(network: Network, sources: Sequence[str], excitation: Excitation) -> Network:
    """Return a network with another excitation under some names."""
    members, changed = network.given()["excitations"], dict[str, Any]()
    for name in sources:
        item = members[name]
        field = {BaseMotion: "acceleration", Source: "excitation"}.get(type(item))
        changed[name] = item.replace(**{field: excitation}) if field else excitation
    return network.replace(excitations=changed)


def with_scale(network: Network, sources: Sequence[str], scale: float) -> Network:
    """Return a network with other weights of some sources and motions of the ground."""
    members, changed = network.given(), dict[str, Any]()
    for name in sources:
        item: Any = members["excitations"][name]
        on = item.on
        if isinstance(on, tuple):
            on = dict.fromkeys(on or members["oscillators"], 1.0)
        changed[name] = item.replace(on={place: scale * weight for place, weight in on.items()})
    return network.replace(excitations=changed)


def chosen_steps(
    motions: ScaledMotions, forms: Sequence[Form], scales: np.ndarray, given: float | None, where: Execution
) -> ChosenSteps:
    """Return steps of a given length, or of one at which the typical error of peaks is below `TYPICAL_ERROR`.

    The errors are those of some records at some scales, spread over all, by half the step.
    """
    records, tried = _spread(motions.number, TRIED_RECORDS), scales[_spread(len(scales), TRIED_SCALES)]
    first = motions.plan(None)
    rule = first.clock.step
    looks = BETWEEN_LOOKS * rule if motions.smooth and not len(first.events.impulsive) else 0.0
    step = given or _fitted(rule, motions)
    for trial in range(STEP_TRIALS):
        pair = StepsAndLooks(step, looks, True), StepsAndLooks(0.5 * step, looks)
        both = (motions.ranges(forms, records, tried, item, where, lambda part: None) for item in pair)
        coarse, fine = map(magnitudes, both)
        counted = fine > 0.0
        errors = OF_CHANGE * np.abs(coarse - fine)[counted] / fine[counted]
        typical, large = (float(np.quantile(errors, share)) for share in (0.5, 0.9)) if errors.size else (0.0, 0.0)
        if given is not None or typical <= TYPICAL_ERROR or trial == STEP_TRIALS - 1:
            break
        step = _fitted(
            step * max(0.25, FORESEEN * (TYPICAL_ERROR / typical) ** (1.0 / ORDER_OF_PEAKS)), motions, below=step
        )
    if typical > TYPICAL_ERROR:
        warn(
            "step_bias",
            f"At the step of {step:.3g} s a typical peak is {100.0 * typical:.2g} % off, and one in ten by more than "
            f"{100.0 * large:.2g} %. Give a shorter step=.",
        )
    return ChosenSteps(StepsAndLooks(step, looks), typical, large)


def magnitudes(ranges: np.ndarray) -> np.ndarray:
    """Return the largest sizes of forms from their least and largest values, (form, record, scale)."""
    return np.asarray(np.maximum(-ranges[:, 0], ranges[:, 1]))


def _fitted(step: float, motions: ScaledMotions, below: float = math.inf) -> float:
    """Return a step that is not longer, shorter than another one, and divides the time that steps should divide."""
    number = math.ceil(motions.fitting / step * (1.0 - SAME_DISTANCE))
    fitted = motions.fitting / number
    return motions.fitting / (number + 1) if fitted >= below else fitted


def _spread(number: int, most: int) -> np.ndarray:
    """Return so many of some places at most, spread evenly."""
    return np.unique(np.linspace(0, number - 1, min(number, most)).round().astype(int))


def _plan_from_rest(
    model: Model, seed: tuple[int, int], duration: float, step: float | None, lanes: int, coarse: bool = False
) -> Plan:
    """Return the plan of some realizations that begin at rest, with the fewest sums."""
    request = Request(
        duration, lanes, step, ExactFlow(jumps=False), 0.0, "rest", [], seed, workers=min(cores(), lanes),
        coarse=coarse, statistics=("peak_contact_force",), on_divergence="raise",
    )  # fmt: skip
    with unheard():
        return make_plan(model, request)


def _run(
    plan: Plan, forms: Sequence[Form], ends: np.ndarray, looks: float, where: Execution, show: Callable[[float], None]
) -> np.ndarray:
    """Return least, largest and first values of forms in all realizations of a plan, (form, 3, realization)."""
    most = max(1, int(looks / plan.clock.step))
    every = max(steps for steps in range(1, most + 1) if plan.clock.all_steps % steps == 0)
    results = run(with_ranges(plan, Ranges(forms, ends), every), where.executor, show, where.checkpoint)
    found: np.ndarray = np.concatenate([block.records[0]["range"] for block in results], axis=-1)
    return found


def _apart(time: float, distance: float) -> bool:
    """Whether a time is no whole number of distances."""
    return abs(math.remainder(time, distance)) > SAME_DISTANCE * distance
