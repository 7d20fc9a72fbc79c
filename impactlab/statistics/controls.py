"""Balances as control variates: values at balance 0.

A balance takes all scatter from a value but that which contacts and other forces of kicks make. Where these acted
too seldom the rest says nothing: balances of bodies on which such a force acts are no controls, and a
regression whose residuals rest on a few units, or are nothing but rounding, gives way to the plain mean.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from impactlab.assembly.links import Links
from impactlab.machine import ROWS_AT_A_TIME
from impactlab.results.schema import BODY, CONTACT, EVERY, POINT, STATISTICS, Estimate, Moments
from impactlab.statistics.regression import CERTAIN, Mean, Regression, largest_of
from impactlab.statistics.subsamples import for_skewness

UNITS_PER_CONTROL = 8
"""Least number of units for each control of a regression."""


def unbalanced(balances: Mapping[str, Estimate], bodies: tuple[str, ...], random: np.ndarray) -> str:
    """Say which balance of a body whose motion is random is off, if one is.

    Then the run is not stationary, or the step is beyond what the theory covers, and no value is
    corrected by a balance.
    """
    count = sum(int(np.isfinite(error).sum()) for _, error in balances.values())
    most = largest_of(count, CERTAIN)
    for name, (value, error) in balances.items():
        scatter = np.where(np.isfinite(error) & random, error, np.inf)
        broken = np.flatnonzero(np.abs(value) > most * scatter)
        if broken.size:
            body = broken[0]
            distance = abs(value[body]) / scatter[body]
            return (
                f"{STATISTICS[name].balance.name} of {bodies[body]!r} is {distance:.1f} standard errors off 0, so "
                "balances are not used: the spin-up may be too short, or the step too large."
            )
    return ""


def controlled(near: Near, moments: Moments, mean: Mean, usable: np.ndarray) -> dict[str, Estimate]:
    """Return the statistics of bodies, contacts, points or states at balance 0, by name.

    Balances of bodies that are `near` may be controls, if they are `usable`, (body, balance) of bool. The moments are
    of independent units, whose plain mean is `mean`.
    """
    balances = np.stack(list(moments.balances.values()), axis=1)
    most = len(mean.weights) // UNITS_PER_CONTROL
    own = [item for item in EVERY.values() if item.stationary and item.dimension == near.dimension]
    result = {statistic.name: Estimate(*np.empty((2, len(near.doubtful)))) for statistic in own}
    for rows, chosen in near.choices(usable, most):
        average = AtBalance(Regression(balances[chosen], mean.weights), mean, near.doubtful[rows])
        of_rows = moments.of_rows(near.dimension, rows)
        for statistic in own:
            value, error = statistic.averaged(of_rows, average)
            result[statistic.name].value[rows], result[statistic.name].error[rows] = value, error
    return result


@dataclass(frozen=True, eq=False)
class Controls:
    """Balances of the independent units of a run, by which means of other numbers of the units are estimated, too."""

    moments: Moments  # of the units
    mean: Mean
    balances: np.ndarray  # (body, balance, unit)
    usable: np.ndarray  # (body, balance) of bool

    def with_balance(self, values: np.ndarray) -> Controls:
        """Return these and one more balance of each body, (body, unit), NaN where there is none.

        Where it is off 0 for certain it is not used, like others.
        """
        value, error = self.mean(values)
        usable = (error > 0.0) & (np.abs(value) <= CERTAIN * error)
        balances = np.concatenate([self.balances, values[:, None]], axis=1)
        return replace(self, balances=balances, usable=np.concatenate([self.usable, usable[:, None]], axis=1))

    def average(self, values: np.ndarray, pairs: np.ndarray) -> Estimate:
        """Return means of (row, unit) numbers and their errors, longer for skew units, at balance 0 of bodies near.

        `pairs` are of a row and a body, (pair, 2), those of one row in turn; without any the means are plain.
        """
        if not len(pairs):
            value, error = self.mean(values)
            return Estimate(value, error * for_skewness((values - value[:, None]).T))
        near = Near("", pairs, np.ones(len(values), dtype=bool))
        result = Estimate(*np.empty((2, len(values))))
        for rows, chosen in near.choices(self.usable, len(self.mean.weights) // UNITS_PER_CONTROL):
            average = AtBalance(Regression(self.balances[chosen], self.mean.weights), self.mean, near.doubtful[rows])
            value, error = average(values[rows])
            result.value[rows], result.error[rows] = value, error * for_skewness(average.residuals(values[rows]).T)
        return result


@dataclass(frozen=True)
class AtBalance:
    """Estimates values at balance 0, or plain means where doubtful ones rest on few units; see the module."""

    regression: Regression
    mean: Mean
    doubtful: np.ndarray

    def __call__(self, units: np.ndarray) -> Estimate:
        few = self.doubtful & self.regression.rests_on_few(units)
        found, plain = self.regression.at_zero(units), self.mean(units)
        return Estimate(*(np.where(few, there, here) for here, there in zip(found, plain, strict=True)))

    def residuals(self, units: np.ndarray) -> np.ndarray:
        """Return the scatter that is left, (row, unit): of the regression, or of the plain mean."""
        few = self.doubtful & self.regression.rests_on_few(units)
        plain = units - units.mean(axis=1, keepdims=True)
        return np.where(few[:, None], plain, self.regression.residuals(units))


@dataclass(frozen=True, eq=False)
class Near:
    """Bodies whose balances may be controls of each body, contact, point or state."""

    dimension: str
    pairs: np.ndarray  # (pair, 2) of int: a body or contact, and a body: all pairs of one in turn, the nearest first
    doubtful: np.ndarray  # (body or contact,) of bool: whether forces that regressions do not see may make its scatter

    def choices(self, usable: np.ndarray, most: int) -> Iterator[tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]]:
        """Give rows that have equally many controls, with the bodies and balances of these controls, (row, control).

        With its usable balances in the place of each body, the pairs are a list in which every row has a section::

            row      0  0  0  1  2  2  2 …
            body     0  0  3  1  2  2  0 …
            balance  0  2  1  0  0  1  0 …

        A section keeps at most its first `most` entries; sections of equal length are stacked into a matrix.
        """
        pair, balance = np.nonzero(usable[self.pairs[:, 1]])
        row, body = self.pairs[pair].T
        rank = np.arange(len(row)) - np.searchsorted(row, row)
        row, body, balance = (item[rank < most] for item in (row, body, balance))
        lengths = np.bincount(row, minlength=len(self.doubtful))
        begins = np.cumsum(lengths) - lengths
        for length in np.unique(lengths):
            rows = np.flatnonzero(lengths == length)
            for some in np.array_split(rows, len(rows) // ROWS_AT_A_TIME + 1):
                places = begins[some, None] + np.arange(length)
                yield some, (body[places], balance[places])


def neighbours(links: np.ndarray, kicked: np.ndarray) -> Near:
    """Return, for each body, the body itself and all bodies that it can touch or is coupled to.

    `links` are slots of bodies, (link, 2); the wall, beyond all slots, has no balances. `kicked` says whether nonlinear
    forces may act on each body, (body,) of bool.
    """
    links, own = links[(links < len(kicked)).all(axis=1)], np.repeat(np.arange(len(kicked))[:, None], 2, axis=1)
    pairs = np.concatenate([own, links, links[:, ::-1]])
    body, other = pairs.T
    pairs = pairs[np.lexsort((other, other != body, body))]  # by body, itself first
    several = (pairs[1:] == pairs[:-1]).all(axis=1)  # links between the same bodies
    return Near(BODY, pairs[~np.append(False, several)], kicked)


def touching(ends: Links, dimension: str = CONTACT) -> Near:
    """Return, for each contact, or state of a law, its bodies, the first body first."""
    pairs = np.stack([ends.rows, ends.slots], axis=1)
    return Near(dimension, pairs[ends.slots < ends.count], np.ones(len(ends), dtype=bool))


def moving(shares: Links, moments: Moments, bodies: Near) -> Near:
    """Return, for each point, the bodies in its weighted sum, the body that contributes most first."""
    size = shares.weights**2 * np.nan_to_num(moments.bodies.xx.mean(axis=-1))[shares.slots]
    order = np.lexsort((-size, shares.rows))
    return Near(POINT, np.stack([shares.rows, shares.slots], axis=1)[order], shares.any(bodies.doubtful))
