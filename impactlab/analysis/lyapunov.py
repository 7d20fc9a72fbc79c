"""Lyapunov exponents: how fast small differences between paths grow or die away.

Where motion is linear between events, differences are carried exactly through flights and events, and made orthonormal
on the way (G. Benettin, L. Galgani, A. Giorgilli and J.-M. Strelcyn, Meccanica 15, 1980, 9). Other paths, and those
under noise, have companions at a small distance that share their noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from time import monotonic
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from impactlab.analysis.companions import Companions
from impactlab.analysis.tangents import Tangents
from impactlab.assembly.model import Model
from impactlab.compiling.announced import announced
from impactlab.components.literature import article, in_one_line
from impactlab.components.stored import entries, json_of, stored
from impactlab.errors import LONG_TIME, ImpactLabWarning, InvalidInput, keep_in, warn
from impactlab.inputs import checked, positive, whole
from impactlab.located.event_located import linear_between_events
from impactlab.located.limits import LOOKED_AT
from impactlab.networks.network import Network
from impactlab.plan.seed import seed_from, seed_of
from impactlab.progress import reporter
from impactlab.results.dataset import configuration_of, provenance
from impactlab.results.labels import Variables, labelled, with_error

BLOCKS = 64
"""Parts of a run, of all paths together, from whose scatter standard errors are found: these are known to 9 %."""

FIRST = 64
"""Intervals in a path at first."""

PART_OF_MISSING, LEAST_LONGER, LONGER = 0.6, 0.04, 4.0
"""Part of the length that is missing by the errors so far by which paths are lengthened at once, and the least and the
largest factor of this: errors are known to 9 % only, and a path that is too long cannot be taken back.
"""

SMOOTHER = 0.1
"""Part of the standard error of a plain mean below which that of a weighted mean is taken: the motion is regular."""

CITATION = article(
    "Benettin, G. and Galgani, L. and Giorgilli, A. and Strelcyn, J.-M.",
    "Lyapunov characteristic exponents for smooth dynamical systems and for Hamiltonian systems",
    "Meccanica", 15, 1980, "9--20",
)  # fmt: skip


class Growth(NamedTuple):
    """Exponents with their standard errors (s-1), and how they were found."""

    exponents: np.ndarray
    errors: np.ndarray
    method: str
    history: np.ndarray | None = None  # (part, exponent) means over all paths from their beginning on


class _Time:
    """The time that may be spent."""

    def __init__(self, begun: float, seconds: float) -> None:
        self.begun, self.seconds, self.said = begun, seconds, False

    def is_over(self, part: float) -> bool:
        """Whether no time is left; a long one is foreseen from the part that is done."""
        spent = monotonic() - self.begun
        if spent > LOOKED_AT and spent / part > LONG_TIME and math.isinf(self.seconds) and not self.said:
            self.said = True
            text = f"This would take about {spent / part:.2g} s. Give max_seconds=, or a larger tolerance=."
            warn("long_run", text, ImpactLabWarning)
        return spent > self.seconds


@checked
def lyapunov(
    network: Network,
    number: int | str = 1,
    *,
    tolerance: float = 1e-2,
    duration: float | None = None,
    transient: float | None = None,
    paths: int = 32,
    initial: Any = None,
    rng: Any = None,
    max_seconds: float | None = None,
    progress: bool | Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Return Lyapunov exponents with their standard errors.

    A periodic motion has those of its Floquet multipliers, exactly. Under noise they are those of paths that share
    their noise: a negative one means that noise makes paths forget how they began.

    Parameters
    ----------
    network : Network
        The network.
    number : int or "all"
        How many exponents, the largest first.
    tolerance : float
        Standard error to be reached, as a part of the largest exponent in size, or of the rate at which the network
        relaxes if this is larger.
    duration : float, optional
        Length of each path (s), in the place of a tolerance.
    transient : float, optional
        Length of the motion before (s); by default 30 relaxation times.
    paths : int
        Paths side by side; they begin with small random differences, which only chaos makes large.
    initial : optional
        Where paths begin, as for `simulate`; at rest by default.
    rng : optional
        Seed of the differences, and of noise.
    max_seconds : float, optional
        Time that may be spent (s); what was reached is returned with its errors, and a warning.
    progress : bool or callable, optional
        As for `simulate`. When a run is interrupted, its error has what was reached as `found`.

    Returns
    -------
    xarray.Dataset
        ``lyapunov_exponent`` (exponent) with standard errors (s-1), and where they are means along paths
        ``lyapunov_exponent_so_far`` (time, exponent). With all exponents there are also
        ``lyapunov_sum``, the ``lyapunov_sum_balance`` that dampers and restitutions demand, where laws are linear
        between events, and the ``kaplan_yorke_dimension`` of the section of the attractor.

    Raises
    ------
    InvalidInput
        If something given cannot be used.

    Notes
    -----
    The exponents of a motion that comes to rest at a contact are -inf: its past is lost. The sum of all exponents is
    ``-Σ c/m + 2 Σ ν ln e`` with the rates ν at which rigid contacts of the restitution e are hit.

    Differences of paths pass events by equation :eq:`saltation` of the theory.

    Examples
    --------
    >>> found = il.lyapunov(driven, rng=1)
    >>> bool(found.lyapunov_exponent[0] < 0.0)
    True
    """
    model, seed = Model.of(network), seed_of(rng)
    exact = not model.random.any() and linear_between_events(model)
    most = 2 * int(model.bodies.free.sum())
    count = most if number == "all" else number
    if isinstance(count, str) or not 1 <= count <= most:
        raise InvalidInput(f'number is "all" or a whole number from 1 to {most}, twice that of bodies, not {number!r}.')
    whole("paths", paths, 1)
    wanted = positive("tolerance", tolerance), None if duration is None else positive("duration", duration)
    seconds = math.inf if max_seconds is None else positive("max_seconds", max_seconds)
    begun, report = monotonic(), reporter(progress)
    options = {
        "number": number, "tolerance": tolerance, "duration": duration, "transient": transient, "paths": paths,
        "initial": initial, "seed": list(seed),
    }  # fmt: skip
    configuration = {"network": stored(network), "lyapunov": options}
    with announced(progress):
        kind = Tangents if exact else Companions
        with kind(network, model, count, paths, transient, initial, seed) as course:
            describe = partial(_dataset, course=course, configuration=configuration)
            found = _followed(course, wanted, _Time(begun, seconds), report, describe)
            report(1.0)
            return describe(found, every=count == most)


def _dataset(
    found: Growth, course: Tangents | Companions, configuration: Mapping[str, Any], every: bool = False
) -> xr.Dataset:
    """Return exponents as a labelled dataset, with what follows from them where these are all."""
    variables: Variables = with_error(
        "lyapunov_exponent", ("exponent",), found.exponents, found.errors, "s-1", "Lyapunov exponent"
    )
    if every:
        variables |= _of_all(found, course)
    if found.history is not None:
        times = course.time * np.linspace(0.0, 1.0, len(found.history) + 1)[1:]
        variables["time"] = labelled(("time",), times, "s", "length of each path")
        text = "Lyapunov exponent by the paths up to a time"
        variables["lyapunov_exponent_so_far"] = labelled(("time", "exponent"), found.history, "s-1", text)
    if np.isneginf(found.exponents).any():
        variables["lyapunov_exponent"][2]["comment"] = "-inf where a contact comes to rest, which forgets its past"
    cited = in_one_line([*entries(configuration), CITATION])
    attributes = {
        **provenance("Lyapunov exponents of a network of oscillators with contacts", json_of(configuration), cited),
        "method": found.method,
        "duration": course.time,
        "paths": course.paths,
    }
    numbers = "exponent", np.arange(1, len(found.exponents) + 1), {"long_name": "number of the exponent"}
    return xr.Dataset(variables, {"exponent": numbers}, attributes)


def again(
    dataset: xr.Dataset, options: Mapping[str, Any], progress: Callable[[float], None] | None = None
) -> xr.Dataset:
    """Return exponents again from what is stored with them."""
    given = dict(options)
    network = Network.from_dict(configuration_of(dataset)["network"])
    seed = seed_from(given.pop("seed"))
    return lyapunov(network, given.pop("number"), rng=seed, progress=progress, **given)


def _followed(
    course: Tangents | Companions, wanted: tuple[float, float | None], time: _Time, show: Callable[[float], None],
    describe: Callable[[Growth], xr.Dataset],
) -> Growth:  # fmt: skip
    """Follow paths until the errors are within a tolerance, or for a duration; an interrupt has what was reached."""
    tolerance, duration = wanted
    growths, length = np.zeros((course.paths, 0, course.count)), FIRST
    last = None if duration is None else max(1, math.ceil(duration / course.interval * (1.0 - 1e-9)))
    try:
        while (exact := course.multipliers()) is None:
            if growths.shape[1]:
                found = _growth(growths, course.interval)
                known = np.isfinite(found.exponents)
                if not known.any():
                    return Growth(found.exponents, found.errors, "differences are lost where bodies rest at contacts")
                size = max(np.abs(found.exponents[known]).max(), course.rate)
                worst = float(np.nan_to_num(found.errors, nan=math.inf)[known].max())
                reached = min(1.0, tolerance * size / max(worst, 1e-300)) ** 2
                part = reached if last is None else growths.shape[1] / last
                if part == 1.0:
                    return found
                show(0.99 * part)
                if time.is_over(part):
                    text = f"The time is over with standard errors of {worst / size:.2g} of the largest exponent."
                    warn("tolerance", text)
                    return found
                more = min(max(PART_OF_MISSING * (1.0 / part - 1.0), LEAST_LONGER), LONGER)
                length = math.ceil(growths.shape[1] * more)
            length = length if last is None else min(max(FIRST, growths.shape[1]), last - growths.shape[1])
            growths = np.concatenate([growths, course.grown(length)], axis=1)
    except KeyboardInterrupt as error:
        if growths.shape[1]:
            course.time = growths.shape[1] * course.interval
            keep_in(error, describe(_growth(growths, course.interval)), "exponents by the paths until then")
        raise
    return Growth(exact, np.zeros(len(exact)), "Floquet multipliers of a periodic motion")


def _growth(growths: np.ndarray, interval: float) -> Growth:
    """Return exponents from the growth in each interval, (path, interval, exponent)."""
    paths, length, _ = growths.shape
    with np.errstate(invalid="ignore"):
        exponents = growths.mean(axis=(0, 1)) / interval
        parts = min(length, -(-BLOCKS // paths))
        blocks = growths[:, length % parts :].reshape(paths * parts, length // parts, -1).mean(axis=1) / interval
        errors = (
            blocks.std(axis=0, ddof=1) / math.sqrt(len(blocks)) if len(blocks) > 1 else np.full(len(exponents), np.nan)
        )
        smooth, spread = _weighted(growths, interval)
    regular = spread < SMOOTHER * errors
    if not np.isfinite(exponents).all():
        errors = np.where(np.isfinite(exponents), errors, 0.0)
    ends = np.unique(np.linspace(1, length, min(length, BLOCKS)).astype(int))
    so_far = growths.mean(axis=0).cumsum(axis=0)[ends - 1] / (ends * interval)[:, None]
    if regular.all():
        return Growth(smooth, spread, "weighted means along regular paths", so_far)
    return Growth(exponents, errors, "means along paths", so_far)


def _weighted(growths: np.ndarray, interval: float) -> tuple[np.ndarray, np.ndarray]:
    """Return means with weights that vanish smoothly at both ends, and by how much those of halves differ.

    Along quasi-periodic paths their error falls faster than any power of the length (S. Das, Y. Saiki, E. Sander and
    J. A. Yorke, Nonlinearity 30, 2017, 4111).
    """
    length = growths.shape[1]

    def mean(part: np.ndarray) -> np.ndarray:
        place = (np.arange(part.shape[1]) + 0.5) / part.shape[1]
        weights = np.exp(-1.0 / (place * (1.0 - place)))
        return np.asarray(np.einsum("l,pln->pn", weights / weights.sum(), part) / interval)

    whole, halves = mean(growths), [mean(growths[:, : length // 2]), mean(growths[:, length // 2 :])]
    apart = np.abs(halves[0] - halves[1]).max(axis=0) if length > 1 else np.full(growths.shape[2], np.inf)
    return whole.mean(axis=0), np.maximum(apart, whole.std(axis=0))


def _of_all(found: Growth, course: Tangents | Companions) -> Variables:
    """Return what follows from all exponents: their sum, its balance, and a dimension."""
    variables: Variables = {
        "lyapunov_sum": labelled((), np.array(found.exponents.sum()), "s-1", "sum of all Lyapunov exponents"),
        "kaplan_yorke_dimension": labelled(
            (), np.array(dimension(found.exponents)), "1", "Kaplan-Yorke dimension of the section of the attractor"
        ),
    }
    balance = course.balance()
    if balance is not None:
        text = "sum of all Lyapunov exponents, from dampers, restitutions and the impacts of the paths"
        variables["lyapunov_sum_balance"] = labelled((), np.array(balance), "s-1", text)
    return variables


def dimension(exponents: np.ndarray) -> float:
    """Return the Kaplan–Yorke dimension: how many exponents, in order, have a sum of 0."""
    total, exponents = 0.0, np.sort(exponents)[::-1]
    for place, value in enumerate(exponents):
        if total + value < 0.0:
            return float(place + total / abs(value))
        total += value
    return float(len(exponents))
