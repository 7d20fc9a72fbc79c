"""Judges a default run of a scene: right, or wrong with a warning, or silently wrong."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.special import stdtrit

import impactlab as il
from impactlab.results.schema import CONTACT, STATISTICS
from impactlab_numerics.trust.drawing import BODY_STEPS, Scene
from impactlab_numerics.trust.networks import CLASSES, Draw, class_of, scene_of
from impactlab_numerics.trust.reference import JUDGED, Reference, Sensitive, Unknown, reference_of, scale_of

STEPS = il.ExactFlow()
"""The method that is judged, also where nothing is random."""

ALLOWED = 5e-3
"""Relative error that is allowed."""

ERRORS = 3.0
"""Standard errors of the difference that are allowed in addition."""

SURE = 5.0
"""Standard errors beyond which chance explains no difference."""

AGAIN = 8
"""Runs with other noise that judge a smaller one."""

MANY = 32
"""Runs with other noise that judge a warning where nothing is off."""

REFERENCE_BODY_STEPS = 20.0 * BODY_STEPS
"""Steps of a body that a reference may take."""

SCARCE = ("too few", "too seldom", "closed fewer than")
"""Words of warnings that say that there are few data, which they do whether or not a value is off."""

STARTS_COUNT = "depends on how"
"""Words of warnings that say that another start leads to another answer."""

OUTCOMES = (
    "right",
    "right, few data said",
    "warned rightly",
    "warned needlessly",
    "refused",
    "diverged",
    "failed",
    "silently wrong",
    "not judged",
)
"""What can become of a run."""


def judge(
    seed: int, classes: Mapping[str, Draw] = CLASSES, body_steps: float = REFERENCE_BODY_STEPS, share: float = 1.0
) -> dict[str, Any]:
    """Draw a numbered network, run it at default settings, with a share of its realizations, and judge it.

    Returns
    -------
    dict
        Plain data: ``seed``, ``class``, ``outcome`` (one of `OUTCOMES`), ``messages``, ``kind`` of the reference,
        steps and times, and ``rows``, one for each statistic of each body or contact.
    """
    scene = reduced(scene_of(seed, classes), share)
    found: dict[str, Any] = {"seed": seed, "class": class_of(seed, classes), "messages": [], "rows": []}
    found["bodies"], found["contacts"] = len(scene.network.oscillators), len(scene.network.contacts)
    begin = time.process_time()
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        try:
            options = {"rng": [seed, 1], "integrator": STEPS, "on_divergence": "raise", **scene.options}
            result = il.simulate(scene.network, **options)
        except il.Diverged as error:
            return found | {"outcome": "diverged", "messages": [str(error)]}
        except il.ImpactLabError as error:
            return found | {"outcome": "refused", "messages": [str(error)]}
        except Exception as error:  # whatever else comes out is a defect of its own
            return found | {"outcome": "failed", "messages": [f"{type(error).__name__}: {error}"]}
    found["messages"] = [str(item.message) for item in said]
    found["step"], found["seconds"] = float(result.attrs["step"]), time.process_time() - begin
    begin = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            reference = reference_of(scene, found["step"], [seed, 2], body_steps)
        except (Unknown, il.ImpactLabError) as error:
            told = isinstance(error, Sensitive) and _says(found, STARTS_COUNT)
            found["kind"] = f"{type(error).__name__}: {error}"
            return found | {"outcome": "warned rightly" if told else "not judged"}
    found |= {"kind": reference.kind, "reference_step": reference.step, "doubts": list(reference.doubts)}
    found["reference_seconds"] = time.process_time() - begin
    found["rows"] = compared(scene, result, reference)
    if any(row["excess"] > 1.0 for row in found["rows"]) and not scene.deterministic:
        _look_again(scene, found, body_steps)
    found["outcome"] = outcome(found["rows"], found["messages"])
    if found["outcome"] == "warned needlessly" and _needed(scene, found, result, reference, body_steps):
        found["outcome"] = "warned rightly"
    return found


def _says(found: Mapping[str, Any], words: str) -> bool:
    return any(words in message for message in found["messages"])


def _needed(scene: Scene, found: dict[str, Any], result: Any, reference: Reference, body_steps: float) -> bool:
    """Whether a warning is justified although the numbers are right: another start, or more runs, confirm it."""
    other = None
    if _says(found, STARTS_COUNT):
        led = scene.network.prescribed
        speeds = 3.0 * np.sqrt(result["mean_square_velocity"].values)
        names = result["oscillator"].values.tolist()
        free = {name: speed for name, speed in zip(names, speeds.tolist(), strict=True) if name not in led}
        fast = {"velocity": free}
        other = scene.options | {"initial": fast, "spin_up": float(result.attrs["spin_up"])}
    elif _says(found, "spin-up") and "spin_up" in scene.options:
        other = {name: value for name, value in scene.options.items() if name not in ("initial", "spin_up")}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if other is None:
            runs = [il.simulate(scene.network, rng=[found["seed"], 1, run], **scene.options) for run in range(MANY)]
            return any(row["excess"] > 1.0 for row in compared(scene, _mean_of(runs, by_scatter=True), reference))
        begun = reference_of(scene._replace(options=other), found["step"], [found["seed"], 2, 2], body_steps)
    for name in set(begun.values) & set(reference.values):
        scatter = np.hypot(begun.errors[name], reference.errors[name])
        allowed = ALLOWED * scale_of(name, reference.values) + ERRORS * scatter
        if (np.abs(begun.values[name] - reference.values[name]) > allowed).any():
            return True
    return False


def reduced(scene: Scene, share: float) -> Scene:
    """Return a scene with a share of its realizations, as far as these are more than standard errors need."""
    realizations = scene.options["realizations"]
    return scene._replace(
        options=scene.options | {"realizations": max(min(realizations, 64), int(share * realizations))}
    )


def _look_again(scene: Scene, found: dict[str, Any], body_steps: float) -> None:
    """Judge a difference again, by further runs with other noise against a further reference.

    Among thousands of differences some are beyond 0.5 % and three standard errors by chance: these are within `SURE`
    beside 0.5 %, and the mean of the further runs is within what is allowed. What these agree about is no matter of
    few data.
    """
    seed = found["seed"]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            results = [
                il.simulate(scene.network, rng=[seed, 1, run], integrator=STEPS, **scene.options)
                for run in range(AGAIN)
            ]
            reference = reference_of(scene, found["step"], [seed, 2, 1], body_steps)
        except (Unknown, il.ImpactLabError):
            return
    quoted, scattered = (_mean_of(results, by_scatter) for by_scatter in (False, True))
    again, anyway = (
        {(row["statistic"], row["label"]): row["excess"] for row in compared(scene, pooled, reference)}
        for pooled in (quoted, scattered)
    )
    for row in found["rows"]:
        if row["excess"] > 1.0:
            key = row["statistic"], row["label"]
            beyond = (abs(row["relative"]) - ALLOWED) / row["relative_error"] if row["relative_error"] else math.inf
            row["chance"] = beyond <= SURE and again.get(key, math.inf) <= 1.0
            row["scarce"] = row["scarce"] or anyway.get(key, math.inf) <= 1.0


def _mean_of(results: list[Any], by_scatter: bool) -> Any:
    """Return the mean of results, with standard errors as they are quoted or, if these are smaller, of the scatter."""
    pooled = results[0].copy()
    for name in JUDGED:
        if name in pooled:
            error = f"{name}_standard_error"
            values = np.stack([item[name].values for item in results])
            quoted = np.sqrt(sum(item[error].values ** 2 for item in results)) / len(results)
            scatter = values.std(axis=0, ddof=1) / math.sqrt(len(results))
            pooled[name] = (pooled[name].dims, values.mean(axis=0))
            pooled[error] = (pooled[name].dims, np.fmax(quoted, scatter) if by_scatter else quoted)
    return pooled


def compared(scene: Scene, result: Any, reference: Reference) -> list[dict[str, Any]]:
    """Return a row for each statistic of each body or contact that can be judged.

    A row has the relative difference and its standard error, ``excess``, the difference over what is allowed,
    and, where there are standard errors, ``held``, whether the interval of 95 % holds what is right.
    """
    rows = []
    samples = float(result.attrs["independent_samples"])
    quantile = float(stdtrit(max(samples - 1.0, 1.0), 0.975))
    for name in JUDGED:
        if name not in result or name not in reference.values:
            continue
        value, error = result[name].values, result[f"{name}_standard_error"].values
        expected, scatter = reference.values[name], reference.errors[name]
        scale = scale_of(name, reference.values)
        for index, label in enumerate(result[result[name].dims[0]].values.tolist()):
            own = 0.0 if scene.deterministic else float(error[index])
            combined = math.hypot(own, float(scatter[index]))
            difference = float(value[index] - expected[index])
            allowed = ALLOWED * float(scale[index]) + ERRORS * combined
            if math.isnan(expected[index]) or (math.isnan(own) and not math.isnan(value[index])):
                continue  # nothing is known, or the error is said not to be known
            tiny = 1e-9 * float(scale[index])
            excess = abs(difference) / allowed if allowed > 0.0 else 0.0 if difference == 0.0 else math.inf
            rows.append({
                "statistic": name,
                "label": label,
                "relative": difference / float(scale[index]) if scale[index] > 0.0 else math.nan,
                "relative_error": combined / float(scale[index]) if scale[index] > 0.0 else math.nan,
                "excess": math.inf if math.isnan(value[index]) else excess,
                "chance": False,
                "scarce": STATISTICS[name].dimension == CONTACT,
                "z": difference / combined if combined > 0.0 else math.nan,
                "held": None if combined <= tiny else bool(abs(difference) <= quantile * combined),
            })  # fmt: skip
    return rows


def outcome(rows: list[dict[str, Any]], messages: list[str]) -> str:
    """Return one of `OUTCOMES`: a warning of few data is none of a value that more data leave as it is."""
    wrong = [row for row in rows if row["excess"] > 1.0 and not row["chance"]]
    scarce = all(any(word in message.lower() for word in SCARCE) for message in messages)
    if wrong:
        named = messages and (not scarce or all(row["scarce"] for row in wrong))
        return "warned rightly" if named else "silently wrong"
    if messages:
        return "right, few data said" if scarce else "warned needlessly"
    return "right" if rows else "not judged"


def worst(found: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return the row with the largest difference."""
    return max(found["rows"], key=lambda row: (not row["chance"], row["excess"]), default=None)
