"""Laws of largest values, fitted to samples of maxima, and errors of any statistic of independent groups."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

TAILS = "Gumbel", "GEV"
"""The laws that are fitted: exp(-exp(-(x - location)/scale)), and the general one, of a shape."""

LEAST_MAXIMA = 20
"""Number of maxima from which laws are fitted."""

LEAST_BEYOND = 10.0
"""Number of maxima that are above, and of those below a level, from which the level is known."""

GROUPS = 64
"""Groups whose maxima are left out in turn for an error."""


def fitted(ordered: np.ndarray) -> np.ndarray:
    """Return location, scale and shape of both laws, (law, 3), by L-moments of maxima in ascending order.

    A positive shape is that of a heavy tail (J. R. M. Hosking, J. R. Stat. Soc. B 52, 1990, 105; J. R. M. Hosking,
    J. R. Wallis and E. F. Wood, Technometrics 27, 1985, 251). NaN where maxima are few, or where several are the least
    one, as of windows without contact.
    """
    number = len(ordered)
    if number < LEAST_MAXIMA or not ordered[1] > ordered[0]:
        return np.full((2, 3), math.nan)
    below = np.arange(number)
    first = ordered.mean()
    second = (below / (number - 1.0) * ordered).mean()
    third = (below * (below - 1.0) / ((number - 1.0) * (number - 2.0)) * ordered).mean()
    spread, lean = 2.0 * second - first, 6.0 * third - 6.0 * second + first
    scale = spread / math.log(2.0)
    return np.array([[first - np.euler_gamma * scale, scale, 0.0], _general(first, spread, lean / spread)])


def _general(mean: float, spread: float, skewness: float) -> list[float]:
    """Return location, scale and shape of the general law of these L-moments."""
    if not -1.0 < skewness < 1.0:
        return [math.nan] * 3
    wanted, logs = 0.5 * (3.0 + skewness), (math.log(2.0), math.log(3.0))
    rough = 1.0 / wanted - logs[0] / logs[1]
    bend = 7.8590 * rough + 2.9554 * rough**2  # minus the shape; Hosking's approximation, made exact below
    for _ in range(50):
        bend = bend if abs(bend) > 1e-6 else 1e-6
        two, three = (-math.expm1(-bend * log) for log in logs)
        slope = (logs[1] * (1.0 - three) - logs[0] * (1.0 - two) * three / two) / two
        change = (three / two - wanted) / slope
        bend -= change
        if abs(change) < 1e-12:
            break
    if not bend > -1.0:
        return [math.nan] * 3
    gamma = math.gamma(1.0 + bend)
    scale = spread * bend / (-math.expm1(-bend * logs[0]) * gamma)
    return [mean - scale * (1.0 - gamma) / bend, scale, -bend]


def level_of(law: np.ndarray, periods: np.ndarray) -> np.ndarray:
    """Return the levels that maxima of windows pass once in so many windows, by a law of location, scale and shape."""
    location, scale, shape = law
    logs = np.log(periods)
    return np.asarray(location + scale * (np.expm1(shape * logs) / shape if abs(shape) > 1e-9 else logs))


def level_with_error(maxima: np.ndarray, groups: np.ndarray, part: float, trusted: bool) -> tuple[float, float]:
    """Return the level below which a part of the maxima is, and its error; NaN where it is not known.

    The error is a quarter of the distance of the levels of the part plus and minus two of its own errors, which are
    those of the shares of independent groups of maxima (R. S. Woodruff, J. Am. Stat. Assoc. 47, 1952, 635). Levels that
    are closer together scatter more, and errors with them.
    """
    number = len(maxima)
    if number * min(part, 1.0 - part) < LEAST_BEYOND:
        return math.nan, math.nan
    level = float(np.quantile(maxima, part))
    count = int(groups[-1]) + 1
    if not trusted:
        return level, math.nan
    beyond = np.bincount(groups, (maxima <= level) - np.mean(maxima <= level), count)
    error = math.sqrt((beyond**2).sum() * count / (count - 1.0)) / number
    low, high = np.quantile(maxima, np.clip([part - 2.0 * error, part + 2.0 * error], 0.0, 1.0))
    return level, float(0.25 * (high - low))


def summary_of(ordered: np.ndarray, periods: np.ndarray) -> np.ndarray:
    """Return mean and standard deviation of maxima in ascending order, the numbers of both laws, and their levels.

    A level is that which maxima of windows pass once in some periods, in windows.
    """
    laws = fitted(ordered)
    return np.concatenate(
        [[ordered.mean(), ordered.std()], laws.ravel(), *(level_of(law, periods) for law in laws)], dtype=float
    )


def without_each(
    statistic: Callable[[np.ndarray], np.ndarray], values: np.ndarray, groups: np.ndarray, trusted: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Return a statistic of values in ascending order, and its error, by leaving out each of some groups of them.

    The bias that the same values tell (M. H. Quenouille, Biometrika 43, 1956, 353) is part of the error: where windows
    hardly differ from one realization to the next, the scatter is less.
    """
    order = np.argsort(values, kind="stable")
    ordered, count = values[order], int(groups[-1]) + 1
    value = statistic(ordered)
    if not trusted:
        return value, np.full_like(value, math.nan)
    own = groups[order] * min(count, GROUPS) // count
    others = np.array([statistic(ordered[own != group]) for group in range(min(count, GROUPS))])
    middle, left = others.mean(axis=0), len(others) - 1.0
    scatter = ((others - middle) ** 2).sum(axis=0) * left / len(others)
    return value, np.hypot(np.sqrt(scatter), left * (middle - value))
