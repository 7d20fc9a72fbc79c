"""The vocabulary of the claims: what is measured, and by which criterion it is judged."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import NamedTuple

from impactlab_two_system.results import Measured, Results

AGREE = 0.02
"""Densities agree if at most this share of the probability lies elsewhere."""

DIFFER = 0.10
"""Densities differ much if at least this share of the probability lies elsewhere."""

CLOSE = 0.05
"""Statistics are almost the same, or something has little influence, up to this relative difference."""

QUANTITIES = ("displacement", "velocity")

At = tuple[float, float]
"""Lowest and highest frequency ratio that a claim speaks of."""


class Judgement(NamedTuple):
    """What was measured, and the verdict that the criterion gives."""

    measured: str
    verdict: str


def only(ratio: float) -> At:
    """A claim on one frequency ratio."""
    return (ratio, ratio)


def grade(conditions: Iterable[bool]) -> str:
    """Return the verdict: all conditions are met, some, or none."""
    conditions = list(conditions)
    return "holds" if all(conditions) else "holds partly" if any(conditions) else "does not hold"


class Case(NamedTuple):
    """A number and where it was measured."""

    place: str
    value: Measured


def span(cases: Sequence[Case], style: str = "%") -> str:
    """Return the smallest and the largest of some numbers, with their places, as text."""
    low, high = (choose(cases, key=lambda case: case.value.value) for choose in (min, max))
    if low is high:
        return f"{low.value:{style}} ({low.place})"
    return f"{low.value:{style}} ({low.place}) to {high.value:{style}} ({high.place})"


def shares(results: Results, systems: Sequence[str], at: At, quantities: Sequence[str], source: str) -> list[Case]:
    """Return the probability that densities have elsewhere than the analytic ones."""
    return [
        Case(f"{quantity} {system}, ω̄ = {ratio:g}", results.distance(system, quantity, ratio, source))
        for ratio in results.ratios(*at)
        for system in systems
        for quantity in quantities
    ]


def beyond_noise(case: Case) -> float:
    """Return a share of probability less what the noise of the bins alone would give."""
    return case.value.value - case.value.error


def densities_agree(
    results: Results, systems: Sequence[str], at: At, quantities: Sequence[str] = QUANTITIES
) -> Judgement:
    """At most 2 % of the probability lies elsewhere, beyond noise; not so where at least 10 % do.

    Probability is elsewhere where the simulated density differs from the analytic one.
    """
    cases = shares(results, systems, at, quantities, "accurate")
    small = [beyond_noise(case) <= AGREE for case in cases]
    large = [beyond_noise(case) >= DIFFER for case in cases]
    verdict = "holds" if all(small) else "does not hold" if all(large) else "holds partly"
    return Judgement(f"probability elsewhere {span(cases)}; the error is the noise", verdict)


def densities_differ(
    results: Results, systems: Sequence[str], at: At, quantities: Sequence[str] = QUANTITIES
) -> Judgement:
    """At least 10 % of the probability lies elsewhere, beyond noise; not so where at most 2 % do."""
    opposite = {"holds": "does not hold", "does not hold": "holds"}
    agreement = densities_agree(results, systems, at, quantities)
    return Judgement(agreement.measured, opposite.get(agreement.verdict, agreement.verdict))


def discrepancies_seen(results: Results, system: str, at: At) -> Judgement:
    """Beyond noise more than 2 % of the simulated probability lies elsewhere.

    It is a sampling error if that is so only in one record, within twice the noise of one.
    """
    real = shares(results, [system], at, QUANTITIES, "accurate")
    seen = shares(results, [system], at, QUANTITIES, "paper")
    text = f"probability elsewhere: ensemble {span(real)}; one record {span(seen)}, noise as its error"
    verdict = grade(beyond_noise(case) > AGREE for case in real)
    if verdict == "does not hold" and all(AGREE < case.value.value <= 2.0 * case.value.error for case in seen):
        verdict = "sampling error"
    return Judgement(text, verdict)


def relative(results: Results, name: str, label: str, left: str, right: str, at: At) -> list[Case]:
    """Return left/right − 1 for all clearances and frequency ratios of a claim."""
    return [
        Case(
            f"ω̄ = {ratio:g}, d = {clearance:g}",
            results.value(name, label, ratio, clearance, left).against(
                results.value(name, label, ratio, clearance, right)
            ),
        )
        for ratio in results.ratios(*at)
        for clearance in results.study.clearances
    ]


def _word(source: str) -> str:
    return "simulated" if source == "accurate" else source


def same(results: Results, names: Sequence[str], labels: Sequence[str], left: str, right: str, at: At) -> Judgement:
    """The two differ by at most 5 %, but for three standard errors."""
    cases = [
        Case(f"{SYMBOLS[name]} {label}, {case.place}", case.value)
        for name in names
        for label in labels
        for case in relative(results, name, label, left, right, at)
    ]
    close = [case.value.within(CLOSE) for case in cases]
    return Judgement(
        f"{_word(left)}/{_word(right)} − 1: {span(cases)}; {sum(close)} of {len(close)} cases within {CLOSE:.0%}",
        grade(close),
    )


def larger(
    results: Results, comparisons: Sequence[tuple[str, str, str, str]], at: At, factor: float = 1.0
) -> Judgement:
    """The first source is larger than the second, by three standard errors and the factor asked for.

    Comparisons are (statistic, label, first source, second source).
    """
    texts, conditions = [], []
    for name, label, left, right in comparisons:
        cases = relative(results, name, label, left, right, at)
        texts.append(f"{_word(left)}/{_word(right)} − 1 of {SYMBOLS[name]} {label}: {span(cases)}")
        conditions += [case.value.surely_positive() and case.value.value + 1.0 >= factor for case in cases]
    return Judgement("; ".join(texts), grade(conditions))


def by_clearance(results: Results, name: str, label: str, rises: bool) -> Judgement:
    """A larger clearance changes a statistic in one sense, by more than three standard errors.

    Where the change is surely the other way in all cases, but smaller than two standard
    deviations of the difference of two records, the statement is a sampling error.
    """
    cases, sense, hidden = [], [], []
    for ratio in results.ratios(0.0):
        for small, wide in pairwise(results.study.clearances):
            before, after = (results.value(name, label, ratio, d) for d in (small, wide))
            change = after - before if rises else before - after
            scatter = math.hypot(*(results.one_record(name, label, ratio, d) for d in (small, wide)))
            cases.append(Case(f"ω̄ = {ratio:g}, d = {small:g} to {wide:g}", after.against(before)))
            sense.append(1 if change.surely_positive() else -1 if change.surely_negative() else 0)
            hidden.append(abs(change.value) < 2.0 * scatter)
    if not any(sense):
        return Judgement("no change is larger than three standard errors", "not testable")
    text = (
        f"change of {SYMBOLS[name]} {label}: {span(cases)}; of {len(sense)} steps {sense.count(1)} as stated, "
        f"{sense.count(-1)} the other way"
    )
    verdict = grade(item == 1 for item in sense)
    if verdict == "does not hold" and all(hidden):
        verdict = "sampling error"
    return Judgement(text, verdict)


def little_influence(results: Results, names: Sequence[str], labels: Sequence[str]) -> Judgement:
    """Largest and smallest over the clearances differ by at most 5 %, but for three standard errors."""
    cases = []
    for name in names:
        for label in labels:
            for ratio in results.ratios(0.0):
                values = [results.value(name, label, ratio, d) for d in results.study.clearances]
                low, high = (choose(values, key=lambda item: item.value) for choose in (min, max))
                cases.append(Case(f"{SYMBOLS[name]} {label}, ω̄ = {ratio:g}", high.against(low)))
    small = [case.value.within(CLOSE) for case in cases]
    return Judgement(
        f"largest over smallest − 1: {span(cases)}; {sum(small)} of {len(small)} cases within {CLOSE:.0%}",
        grade(small),
    )


SYMBOLS = {
    "mean_square_displacement": "E[x²]",
    "variance_displacement": "var x",
    "mean_square_velocity": "E[v²]",
    "contact_ratio": "contact ratio",
    "peak_contact_force": "largest force",
}
