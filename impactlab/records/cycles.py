"""Records of cycles for fatigue: ranges of linear forms, counted by rainflow while a run goes on."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from impactlab.components.fields import parameter
from impactlab.components.literature import article
from impactlab.errors import InvalidInput
from impactlab.kernels.turning_points import BINS, BROWNIAN, LOWEST, PER_OCTAVE, bin_of, count_cycles
from impactlab.plan.plan import Plan
from impactlab.records.linear_forms import Forms, names_of_forms, units_of
from impactlab.records.paths_of_forms import RecordOfPaths, TurnsOfPath, paths_of
from impactlab.records.record import Keeper
from impactlab.records.recorded_run import RecordedRun
from impactlab.results.labels import Variables, labelled, with_error

SHOWN_OCTAVES = 8
"""Factors of two below the largest range, in which rates of cycles are returned."""

ROOM = 32
"""Turning points for which there is room on a stack at first."""


class Cycles(RecordOfPaths):
    """Cycles of linear forms, counted by rainflow, and the damage of fatigue that they do.

    Cycles are counted as in ASTM E1049: a range is a cycle where it lies within both its neighbours, and the ranges
    that are left at the end are half cycles. Between steps displacements follow Hermite's cubic, forces a parabola. By
    the rule of Palmgren and Miner, a cycle of the range r does a damage in proportion to ``r^m``, m being the exponent
    of the line ``N r^m = C`` of Basquin: the rate of damage over C is the part of the life that is used in a second.

    Under white noise the smallest cycles of a displacement have no rate, as its path turns ever more often in shorter
    steps, but their damage vanishes. Velocities that white noise makes rough are refused. Standard errors are those of
    independent realizations, or of batches, to which the cycles count that end in them.

    Parameters
    ----------
    of : mapping, sequence or str, optional
        Linear forms by name, as of `Extremes`; all bodies and contacts by default.
    exponent : float
        Exponent m of the damage.

    Examples
    --------
    >>> record = il.Cycles({"drift": {"upper": 1.0, "lower": -1.0}}, exponent=5.0)
    """

    citation = article(
        "Downing, S. D. and Socie, D. F.", "Simple rainflow counting algorithms", "Int. J. Fatigue", 4, 1982, "31",
        "10.1016/0142-1123(82)90018-4",
    )  # fmt: skip

    exponent: float = parameter(3.0, minimum=1.0)

    copies: ClassVar[int] = 4

    def keeper(self, run: RecordedRun, realizations: np.ndarray, ratio: int) -> Keeper:
        return _Stacks(self, run.plan, realizations)

    def bytes_per_realization(self, run: RecordedRun, interval: float) -> int:
        return 8 * len(self.of) * run.parts * (BINS + 2)

    def label(self, run: RecordedRun, results: list[dict[str, np.ndarray]], interval: float) -> Variables:
        forms: Forms = self.of
        times = [result["samples"] * run.step for result in results]
        rate, of_rate = run.mean([result["counts"] for result in results], times)  # (form, bin)
        damage, of_damage = run.mean([result["damage"] for result in results], times)
        used = np.flatnonzero(rate[:, 1:].any(axis=0)) + 1
        last = int(used.max(initial=SHOWN_OCTAVES * PER_OCTAVE))
        bins = slice(max(1, last + 1 - SHOWN_OCTAVES * PER_OCTAVE), last + 1)
        edges = np.exp2((np.arange(bins.start, bins.stop + 1) + LOWEST) / PER_OCTAVE)
        units, root = units_of(forms), damage ** (1.0 / self.exponent)
        of_root = np.divide(root * of_damage, self.exponent * damage, out=np.zeros_like(root), where=damage > 0.0)
        each, bin_, power = (
            ("cycle_form",),
            ("cycle_form", "cycle_bin"),
            f"sum a second of the power {self.exponent:g} of ranges",
        )
        same = "range of one cycle a second with the same damage"
        of_bin = "rate of cycles with a range in a bin"
        return {
            **with_error("cycle_damage_rate", each, damage, of_damage, self._units(units), power),
            **with_error("cycle_equivalent_range", each, root, of_root, units, same),
            **with_error("cycle_rate", bin_, rate[:, bins], of_rate[:, bins], "s-1", of_bin),
            "cycle_range_edges": labelled(("cycle_edge",), edges, units, "edges of the bins of ranges"),
            "cycle_form": names_of_forms("cycle_form", forms),
        }

    def _units(self, units: str) -> str:
        """Return the units of the damage, "" where there are none of UDUNITS."""
        if not units or not self.exponent.is_integer():
            return ""
        power = int(self.exponent)
        return {"m": f"m{power} s-1", "m s-1": f"m{power} s-{power + 1}", "N": f"N{power} s-1"}[units]


class _Stacks(Keeper):
    """Turning points of forms that no cycle has closed, and what the cycles add up to."""

    wants_start = True

    def __init__(self, record: Cycles, plan: Plan, realizations: np.ndarray) -> None:
        super().__init__()
        forms, lanes, self.parts = len(record.of), len(realizations), plan.samples_per_realization
        paths, _ = paths_of(record.of, plan)
        self.turns, self.exponent = [TurnsOfPath(path, lanes) for path in paths], record.exponent
        for form, turns in zip(record.of, self.turns, strict=True):
            if turns.path.kind == BROWNIAN:
                raise InvalidInput(
                    f"Cycles.of: white noise makes the velocities of {form.name!r} rough, so that its cycles depend on "
                    "the step; give forms of displacements or forces."
                )
        self.stacks = [np.zeros((lanes, ROOM)) for _ in range(forms)]
        self.born = [np.zeros((lanes, ROOM), np.int64) for _ in range(forms)]
        self.heights = np.zeros((forms, lanes), np.int64)
        self.damage, self.samples = np.zeros((forms, self.parts, lanes)), np.zeros((lanes, self.parts))
        self.counts = np.zeros((forms, self.parts, lanes, BINS))

    def start(self, values: np.ndarray) -> None:
        for turns in self.turns:
            turns.start(values)

    def add(self, snapshots: np.ndarray, batch: int) -> None:
        part = min(batch, self.parts - 1)
        self.samples[:, part] += len(snapshots)
        for form, turns in enumerate(self.turns):
            for places, values, number in turns.next(snapshots):
                done, sums = 0, (self.damage[form], self.counts[form])
                while done < number:
                    stack, born, points = self.stacks[form], self.born[form], (done, number)
                    done = count_cycles(
                        places, values, points, part, stack, born, self.heights[form], *sums, self.exponent
                    )
                    if done < number:
                        self.stacks[form] = np.concatenate([stack, np.zeros_like(stack)], axis=1)
                        self.born[form] = np.concatenate([born, np.zeros_like(born)], axis=1)

    def result(self) -> dict[str, np.ndarray]:
        for form, stack in enumerate(self.stacks):
            for lane, height in enumerate(self.heights[form]):
                ends = self.born[form][lane, 1:height]
                for part, size in zip(ends, np.abs(np.diff(stack[lane, :height])), strict=True):
                    self.damage[form, part, lane] += 0.5 * size**self.exponent
                    self.counts[form, part, lane, bin_of(size)] += 0.5
        return {
            "samples": self.samples,
            "damage": self.damage.transpose(2, 1, 0),
            "counts": self.counts.transpose(2, 1, 0, 3),
        }
