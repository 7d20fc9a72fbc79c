"""Runs of wild scenes: each must end with a result, a warning or a refusal."""

from __future__ import annotations

import time
import warnings
from typing import Any, NamedTuple

import numpy as np

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.compiling.jit import compilations
from impactlab.results.schema import balances
from impactlab_numerics.stability.wild_scenes import Scene

HANGING = 20.0
"""Processor time after which a scene counts as hanging (s), although no more than `LIMIT` was foreseen."""

UNBALANCED = 5.0
"""Standard errors by which no balance may be off without a warning."""

BAD = ("silent NaN", "unbalanced", "hanging", "crash")
"""Outcomes that no scene may have."""


class Outcome(NamedTuple):
    """How a scene ended: an outcome, its message, and the processor time since the last compilation (s)."""

    kind: str
    detail: str
    seconds: float


def run_scene(scene: Scene) -> Outcome:
    """Simulate a scene and say how it ended.

    Returns
    -------
    Outcome
        "done", "warned", "refused", "refused for its cost", "diverged", or one of `BAD`: a number that is
        not one, a balance off by `UNBALANCED` standard errors without a word, far more time (`HANGING`) than
        it may be foreseen to take, or an error that is not one of impactlab's.
    """
    begin, seen = time.process_time(), compilations()

    def since() -> float:
        """Time that was not spent on compiling (s), at least."""
        nonlocal begin, seen
        if compilations() != seen:
            begin, seen = time.process_time(), compilations()
        return time.process_time() - begin

    def guard(done: float) -> None:
        if since() > HANGING:
            raise TimeoutError(f"{done:.1%} done")

    def outcome(kind: str, detail: object) -> Outcome:
        return Outcome(kind, str(detail).splitlines()[0] if str(detail) else "", since())

    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        try:
            scene.network.check()
            result = il.simulate(scene.network, progress=guard, on_divergence="raise", **scene.options)
        except TimeoutError as error:
            return outcome("hanging", error)
        except il.InvalidInput as error:
            return outcome("refused for its cost" if "max_seconds" in str(error) else "refused", error)
        except il.Diverged as error:
            return outcome("diverged", error)
        except Exception as error:  # whatever else comes out is what is looked for
            return outcome("crash", f"{type(error).__name__}: {error}")
    foreign = [item for item in said if not issubclass(item.category, il.ImpactLabWarning)]
    if foreign:
        return outcome("crash", f"{foreign[0].category.__name__}: {foreign[0].message}")
    if since() > HANGING:
        return outcome("hanging", "before or after the steps")
    messages = [str(item.message) for item in said]
    noises = scene.network.excitations.values()
    quiet = not Model.of(scene.network).random.all()
    bad = _not_numbers(result, bool(messages), quiet)
    if bad:
        return outcome("silent NaN", bad)
    steady = scene.options.get("initial") is None or isinstance(scene.options["initial"], str)
    steady &= bool(noises) and all(noise.kind == "lines" or isinstance(noise, il.WhiteNoise) for noise in noises)
    off = _unbalanced(result) if steady and not messages else []
    if off:
        return outcome("unbalanced", off[0])
    return outcome("warned" if messages else "done", messages[0] if messages else "")


def _not_numbers(result: Any, warned: bool, quiet: bool) -> str:
    """Name the first variable that is not finite.

    Standard errors may be NaN after a warning, or where nothing is random, as of bodies that no noise reaches; those
    of contacts and bands where nothing scattered. A body without spring or damping has no balance.
    """
    of_balances = {name for item in balances() for name in (item.name, item.error, f"{item.name}_by_realization")}
    for name, item in result.data_vars.items():
        error, of_contact = str(name).endswith("_standard_error"), "contact" in item.dims
        known = name in of_balances or str(name).endswith("_band_factor")
        known |= error and (warned or quiet or of_contact)
        if item.dtype.kind == "f" and not known and not np.isfinite(item.values).all():
            return str(name)
    return ""


def _unbalanced(result: Any) -> list[str]:
    """Name the balances that are off in a motion that is to be stationary."""
    found = []
    for balance in balances():
        if balance.error in result:
            value, error = result[balance.name].values, result[balance.error].values
            worst = np.abs(value) / np.where(error > 0.0, error, np.inf)
            if (worst > UNBALANCED).any():
                body = result.oscillator.values[int(np.nanargmax(worst))]
                found.append(f"{balance.name} of {body!r}: {np.nanmax(worst):.1f} standard errors")
    return found
