"""Claims that need a criterion of their own."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from impactlab_two_system.corrections import PAPER_SAMPLES
from impactlab_two_system.predicates import (
    AGREE,
    CLOSE,
    DIFFER,
    Case,
    Judgement,
    beyond_noise,
    grade,
    relative,
    same,
    shares,
    span,
)
from impactlab_two_system.results import SURE, Measured, Results, mean

X2, V2 = "mean_square_displacement", "mean_square_velocity"
BOTH = ("one", "two")


def ergodic(results: Results) -> Judgement:
    """Mean squares of one record scatter by at most 5 %."""
    cases = [Case(f"E[x²] {system}", results.scatter("scatter", X2, system)) for system in BOTH]
    return Judgement(f"relative scatter between records: {span(cases)}", grade(c.value.value <= CLOSE for c in cases))


def settled(results: Results) -> Judgement:
    """The start from rest changes a linear mean square of System 2 by at most 5 % over the record."""
    study = results.study
    slow = 2.0 * study.damping_ratio * study.natural_frequency_two * study.duration
    start = Measured(-(1.0 - math.exp(-slow)) / slow)
    scatter = results.scatter("scatter", X2, "two")
    text = f"the start changes E[x2²] by {start:%}; the scatter of one record is {scatter:%}"
    return Judgement(text, grade([start.within(CLOSE)]))


def samples(results: Results) -> Judgement:
    """Duration over step, times four coordinates, is the number."""
    count = 4.0 * results.study.duration / results.study.paper_step
    return Judgement(f"{count:.3g} values of four coordinates", grade([math.isclose(count, PAPER_SAMPLES)]))


def fluctuations_stay(results: Results) -> Judgement:
    """The scatter with four times as many cosines is not smaller by more than three standard errors."""
    few, many, longer = (
        results.scatter(item, X2, "two") for item in ("scatter", "scatter_components", "scatter_duration")
    )
    text = f"scatter of E[x2²]: {few:%}, with 4 N {many:%}, with 4 N and four times the record {longer:%}"
    return Judgement(text, grade([not (few - many).surely_positive()]))


def acceptable(results: Results) -> Judgement:
    """In one record at most 10 % of the probability lies elsewhere than in the analytic density."""
    cases = shares(results, BOTH, (16, 16), ("displacement", "velocity"), "paper")
    return Judgement(
        f"probability elsewhere {span(cases)}; the error is the noise of one record",
        grade(case.value.value <= DIFFER for case in cases),
    )


def condition(results: Results) -> Judgement:
    """C_DV is 1 at this frequency ratio."""
    (ratio,) = results.ratios(16, 16)
    found = float(results.node("linear")["velocity_ratio"].sel(frequency_ratio=ratio))
    return Judgement(f"{found:.12g}", grade([math.isclose(found, 1.0, rel_tol=1e-9)]))


def more_obvious(results: Results, ratio: float) -> Judgement:
    """Analysis and simulation of System 2 are further apart than at the next ratio, beyond noise."""
    (here,) = results.ratios(ratio, ratio)
    following = results.ratios(ratio + 1e-9)[0]
    near, far = (shares(results, ["two"], (r, r), ("displacement", "velocity"), "accurate") for r in (here, following))
    records = shares(results, ["two"], (here, here), ("displacement", "velocity"), "paper")
    text = (
        f"probability elsewhere {span(near)}, against {span(far)}; one record {span(records)}; the error is the noise"
    )
    pairs = zip(near, far, strict=True)
    return Judgement(text, grade((a.value - b.value).surely_positive() for a, b in pairs))


def stiffness_ratio(results: Results) -> Judgement:
    """sqrt(1/C_DX) equals ω̄ where C_DV is 1, and nowhere else."""
    linear = results.node("linear")
    ratio, found = linear["frequency_ratio"].values, linear["displacement_ratio"].values ** -0.5
    equal = np.isclose(found, ratio, rtol=1e-9)
    balanced = np.isclose(linear["velocity_ratio"].values, 1.0, rtol=1e-9)
    text = ", ".join(f"{value:.4g} at ω̄ = {place:g}" for place, value in zip(ratio, found, strict=True))
    return Judgement(f"σ_x2/σ_x1: {text}", grade(equal == balanced))


def condition_number(results: Results) -> Judgement:
    """C_DV is 1 where S1/S2 = ζ1ω1/(ζ2ω2), and nowhere else."""
    study = results.study
    factors = results.node("linear")["velocity_ratio"].to_series()
    equal = [math.isclose(ratio, study.balanced_ratio, rel_tol=1e-9) for ratio in factors.index]
    text = ", ".join(f"{factor:.4g} at ω̄ = {ratio:g}" for ratio, factor in factors.items())
    conditions = [
        math.isclose(factor, 1.0, rel_tol=1e-9) == where for factor, where in zip(factors, equal, strict=True)
    ]
    return Judgement(f"C_DV: {text}", grade(conditions))


def normalisation(results: Results) -> Judgement:
    """Records with the printed normalisation (S_f = S) have this E[v²] within three standard errors."""
    study = results.study
    claimed = math.pi * study.spectral_density_one
    claimed /= 8.0 * study.damping_ratio * study.balanced_ratio * study.natural_frequency_two
    found = mean(results.seeds("normalisation_equation_14", V2, "one"))
    text = f"System 1: {found} m² s⁻² with S_f = S, claimed {claimed:.4g}; S_f/(8ζω) is {claimed / math.pi:.4g}"
    return Judgement(text, grade([abs(found.value - claimed) <= SURE * found.error]))


def methods_differ(results: Results) -> Judgement:
    """Simulation and analysis differ by more than 5 %."""
    verdict = {"holds": "does not hold", "does not hold": "holds"}
    agreement = same(results, (X2, V2), BOTH, "accurate", "analytic", (0, math.inf))
    return Judgement(agreement.measured, verdict.get(agreement.verdict, agreement.verdict))


def gaussian(results: Results) -> Judgement:
    """The excess kurtosis of each velocity is within 0.05 of zero, or within three standard errors."""
    cases = [
        Case(f"velocity {system}, ω̄ = {ratio:g}", results.excess_kurtosis(system, ratio))
        for ratio in results.ratios(0.0)
        for system in BOTH
    ]
    near = [abs(case.value.value) <= max(0.05, SURE * case.value.error) for case in cases]
    text = f"excess kurtosis {span(cases, '')}; {sum(near)} of {len(near)} near zero"
    return Judgement(text, grade(near))


def meets(results: Results, name: str, system: str, ratio: float) -> Judgement:
    """Simulation and analysis differ by at most 5 % from this ratio on, and by more at all below."""
    conditions, cases = [], []
    for case_ratio in results.ratios(0.0):
        found = relative(results, name, system, "accurate", "analytic", (case_ratio, case_ratio))
        cases += found
        conditions += [case.value.within(CLOSE) == (case_ratio >= ratio) for case in found]
    outside = [case for case in cases if not case.value.within(CLOSE)]
    last = outside[-1].place if outside else "none"
    return Judgement(f"simulated/analytic − 1: {span(cases)}; last beyond 5 %: {last}", grade(conditions))


def _bend(results: Results, source: str, name: str) -> Case:
    """Return the largest departure of log ratio from the straight line through its end points."""
    clearance = results.study.density_clearance
    ratios = results.ratios(0.0)
    values = [results.value(name, "one/two", ratio, clearance, source) for ratio in ratios]
    logs = np.log([value.value for value in values])
    errors = [value.error / value.value for value in values]
    line = np.interp(np.log(ratios), np.log([ratios[0], ratios[-1]]), logs[[0, -1]])
    worst = int(np.abs(logs - line).argmax())
    error = math.hypot(errors[0], errors[worst], errors[-1])
    symbol = "E[x²]" if name == X2 else "E[v²]"
    return Case(f"{symbol}, ω̄ = {ratios[worst]:g}", Measured(abs(float(logs[worst] - line[worst])), error))


def straight(results: Results) -> Judgement:
    """The logarithm of the linear ratio departs from a straight line by less than 1e-9."""
    cases = [_bend(results, "linear", name) for name in (X2, V2)]
    return Judgement(f"largest departure {span(cases, '')}", grade(case.value.value < 1e-9 for case in cases))


def curved(results: Results) -> Judgement:
    """The logarithm departs from a straight line by more than 0.05 and three standard errors."""
    cases = [_bend(results, "accurate", name) for name in (X2, V2)]
    sure = (case.value.value > max(CLOSE, SURE * case.value.error) for case in cases)
    return Judgement(f"largest departure {span(cases, '')}", grade(sure))


def _contact_ratios(results: Results, clearance: float) -> dict[float, Measured]:
    return {ratio: results.value("contact_ratio", "gap", ratio, clearance) for ratio in results.ratios(0.0)}


def _listed(values: dict[float, Measured]) -> str:
    shown = ", ".join(f"{value.value:.4f} ({ratio:g})" for ratio, value in values.items())
    return f"{shown} at (ω̄), standard errors up to {max(value.error for value in values.values()):.1g}"


def rises_then_stable(results: Results, clearance: float) -> Judgement:
    """It rises at every step up to ω̄ = 16, and beyond stays within 5 % of the value there."""
    found = _contact_ratios(results, clearance)
    results.ratios(16, 16)
    below = [value for ratio, value in found.items() if ratio <= 16]
    rises = [(after - before).surely_positive() for before, after in pairwise(below)]
    stable = [value.against(found[16.0]).within(CLOSE) for ratio, value in found.items() if ratio > 16]
    return Judgement(_listed(found), grade([*rises, *stable]))


def minimum_at(results: Results, clearance: float, ratio: float) -> Judgement:
    """Its neighbours, and all other frequency ratios, surely have a larger value."""
    found = _contact_ratios(results, clearance)
    (here,) = results.ratios(ratio, ratio)
    larger = {place: (value - found[here]).surely_positive() for place, value in found.items() if place != here}
    places = list(found)
    index = places.index(here)
    neighbours = places[max(0, index - 1) : index] + places[index + 1 : index + 2]
    lowest = min(found, key=lambda place: found[place].value)
    conditions = [all(larger[place] for place in neighbours), all(larger.values())]
    return Judgement(f"lowest at ω̄ = {lowest:g}: {_listed(found)}", grade(conditions))


def jump_at(results: Results, clearance: float, ratio: float) -> Judgement:
    """It is off the mean of its neighbours by more than 5 %, the others off theirs by less."""
    found = _contact_ratios(results, clearance)
    (here,) = results.ratios(ratio, ratio)
    places = list(found)
    if places.index(here) in (0, len(places) - 1):
        return Judgement(f"no neighbours of ω̄ = {here:g} were computed", "not testable")

    def off(values: dict[float, Measured], place: float) -> float:
        index = places.index(place)
        neighbours = [values[places[index - 1]].value, values[places[index + 1]].value]
        return abs(values[place].value / float(np.mean(neighbours)) - 1.0)

    inner = places[1:-1]
    conditions = [(off(found, place) > CLOSE) == (place == here) for place in inner]
    verdict = "holds" if all(conditions) else "does not hold"
    scatter = results.one_record("contact_ratio", "gap", here, clearance) / found[here].value
    if verdict == "does not hold" and 2.0 * scatter > CLOSE:
        verdict = "sampling error"
    text = f"off its neighbours by {off(found, here):.1%}, one record scatters by {scatter:.1%}; {_listed(found)}"
    return Judgement(text, verdict)


def peak_first(results: Results) -> Judgement:
    """For each clearance the largest force is greatest at ω̄ = 1, by more than three standard errors."""
    (first,) = results.ratios(1, 1)
    name = "peak_contact_force"
    cases, sure = [], []
    for clearance in results.study.clearances:
        for ratio in results.ratios(first + 1e-9):
            here, there = (results.value(name, "gap", r, clearance) for r in (first, ratio))
            cases.append(Case(f"ω̄ = {ratio:g}, d = {clearance:g}", there.against(here)))
            sure.append((here - there).surely_positive())
    time = results.study.duration
    return Judgement(f"largest force in {time:g} s against that at ω̄ = 1: {span(cases)}", grade(sure))


def falls_then_stable(results: Results) -> Judgement:
    """The largest force falls at each step up to ω̄ = 16, and beyond stays within 5 % of its last value."""
    (last,) = results.ratios(16, 16)
    name = "peak_contact_force"
    falls, stays, cases = [], [], []
    for clearance in results.study.clearances:
        values = {ratio: results.value(name, "gap", ratio, clearance) for ratio in results.ratios(0.0)}
        steps = pairwise([value for ratio, value in values.items() if ratio <= last])
        falls += [(before - after).surely_positive() for before, after in steps]
        ratios = results.ratios(last)
        beyond = [
            Case(f"ω̄ = {ratio:g}, d = {clearance:g}", values[ratio].against(values[ratios[-1]]))
            for ratio in ratios[:-1]
        ]
        stays += [case.value.within(CLOSE) for case in beyond]
        cases += beyond
    if not cases:
        return Judgement(f"no frequency ratio beyond {last:g} was computed", "not testable")
    text = f"falls in {sum(falls)} of {len(falls)} steps up to ω̄ = {last:g}; then against the last value {span(cases)}"
    return Judgement(text, grade([*falls, *stays]))


def densities_move_apart(results: Results) -> Judgement:
    """Up to C_DV = 1 each lower ω̄ has its displacement densities further from the analytic ones."""
    balanced = results.study.balanced_ratio
    cases, conditions = [], []
    for system in BOTH:
        found = shares(results, [system], (0.0, balanced), ("displacement",), "accurate")
        cases += found
        steps = pairwise(found)
        conditions += [
            (low.value - high.value).value > 0.0 or max(map(beyond_noise, (low, high))) <= AGREE for low, high in steps
        ]
    return Judgement(f"probability elsewhere {span(cases)}; the error is the noise", grade(conditions))
