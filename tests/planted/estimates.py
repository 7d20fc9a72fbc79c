"""Bugs in what is made of the motion: moments, balances, errors, densities; in series of cosines; in exact laws."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

import impactlab as il
from impactlab.kernels.rows import FF, FLUX, FV, FX, TURN, VV, XV, XX, F, V, X
from impactlab.kernels.sums import SLOTS
from impactlab.linear import band_limited, cosine_series
from impactlab.linear.cosine_series import Cosines
from impactlab.plan import clock
from impactlab.records import density
from impactlab.reference import conditions, reference
from impactlab.results import schema
from impactlab.simulation import functions_in_steps, labelling
from impactlab.simulation.block import Block
from impactlab.statistics import estimate, moments, regression
from impactlab.statistics.chain import Chain
from impactlab.step_control.rules import automatic
from planted.plant import Bug, Plant, both, called, in_plan, instead, returned
from planted.scenes import ALONE, BATCHES, BOUNDED, COARSE, DRIVEN, INTERVALS, LONG, PAIR, TREE


def continuous_balances(right: Any, chain: Any, intensity: np.ndarray, s: np.ndarray, *_: Any) -> Any:
    """The balances of continuous time: k E[x] = E[f], c E[v²] = πS/m + E[f v], and that of x v."""
    mass, damping, stiffness = (item[:, None] for item in (chain.mass, chain.damping, chain.stiffness))
    heat, mean = np.pi * intensity[:, None], s.mean(axis=0)
    kinetic = mass * mean[VV] - (heat + mass * mean[FV]) / damping
    return {
        "mean_displacement": mean[X] - mean[F] / stiffness,
        "mean_square_displacement": mean[XX] - (mass * mean[VV] + mean[FX]) / stiffness,
        "mean_square_velocity": kinetic / mass,
    }, right[1]


def after_the_kick(monkeypatch: Any) -> None:
    """Read velocities at the end of the kick."""
    right = moments.moments_of

    def wrong(plan: Any, sums_of: Any, *others: Any) -> Any:
        def after(rows: slice) -> np.ndarray:
            half, sums = 0.5 * plan.clock.step / plan.system.linear[0][rows, None], sums_of(rows)
            s = sums.copy()
            s[:, V] += half * sums[:, F]
            s[:, XV] += half * sums[:, FX]
            s[:, VV] += 2.0 * half * sums[:, FV] + half**2 * sums[:, FF]
            s[:, FV] += half * sums[:, FF]
            return s

        return right(plan, after, *others)

    monkeypatch.setattr(estimate, "moments_of", wrong)


def closings(monkeypatch: Any) -> None:
    """Count contacts that close between one step and the next, in the place of the flux."""
    call = Block.call

    def wrong(self: Block, count: int, snapshots: Any, summing: bool, *others: Any) -> None:
        before, last = self.sums.contacts[FLUX].copy(), getattr(self, "last", -1.0)
        slots = slice(self.now % SLOTS, self.now % SLOTS + count)
        call(self, count, snapshots, summing, *others)
        for gap in self.history.indentation[slots]:
            window, step = self.plan.observed.window[:, None], self.plan.clock.step
            before += ((last <= 0.0) & (gap > 0.0)) * (8.0 / 9.0 * window / step)
            last = gap.copy()
        self.last = last
        if summing:
            self.sums.contacts[FLUX] = before

    monkeypatch.setattr(Block, "call", wrong)
    in_plan(realizations__steps_per_call=lambda plan: SLOTS)(monkeypatch)


def at_kicks(over_steps: Any, chain: Any, s: Any, kicks: Any, *_: Any) -> Any:
    return kicks


def other_sign(monkeypatch: Any) -> None:
    """Move values away from balance 0 instead of to it."""
    right = regression.Regression.at_zero

    def wrong(self: Any, values: np.ndarray) -> Any:
        value, error = right(self, values)
        return 2.0 * (values * self.share).sum(axis=1) - value, error

    monkeypatch.setattr(regression.Regression, "at_zero", wrong)


def errors(factor: Any) -> Plant:
    """Multiply all standard errors by a function of the number of units."""

    def plant(monkeypatch: Any) -> None:
        def wider(right: Any) -> Any:
            def wrong(self: Any, values: np.ndarray) -> Any:
                value, error = right(self, values)
                return schema.Estimate(value, factor(values.shape[-1]) * error)

            return wrong

        for kind, name in ((regression.Regression, "at_zero"), (regression.Mean, "__call__")):
            monkeypatch.setattr(kind, name, wider(getattr(kind, name)))

    return plant


def scaled_rate(factor: float) -> Plant:
    def change(found: Any, *_: Any) -> Any:
        return found._replace(others={**found.others, "contact_rate": factor * found.others["contact_rate"]})

    return returned(estimate, "moments_of", change)


def bins(shift: float = 0.0, width: float = 1.0) -> Plant:
    """Count into bins that are shifted by a part of their width, or wider."""
    right = density.count_samples

    def wrong(snapshots, first, stride, quantity, low, inverse_width, groups, counts):  # type: ignore[no-untyped-def]
        low += shift / inverse_width
        right(snapshots, first, stride, quantity, low, inverse_width / width, groups, counts)

    return instead(density, "count_samples", wrong)


def into_end_bins(found: dict[str, np.ndarray], *_: Any) -> dict[str, np.ndarray]:
    counts = found["counts"].copy()
    counts[..., 1] += counts[..., 0]
    counts[..., -2] += counts[..., -1]
    counts[..., 0] = counts[..., -1] = 0
    return {"counts": counts}


def wider(found: dict[str, Any], *_: Any) -> dict[str, Any]:
    dims, density, attributes = found["density_displacement"]
    return {**found, "density_displacement": (dims, 24.0 / 23.0 * density, attributes)}


def lines(frequency: float = 1.0, amplitude: float = 1.0) -> Plant:
    return returned(il.ShinozukaNoise, "lines", lambda found, *_: (frequency * found[0], amplitude * found[1]))


def one_draw(monkeypatch: Any) -> None:
    draw = Cosines._draw
    monkeypatch.setattr(Cosines, "_draw", lambda self, realization, attempt: draw(self, 0, attempt))


def sign_of_velocity(monkeypatch: Any) -> None:
    sample = Cosines.sample

    def wrong(self: Cosines, realization: int, attempt: int, samples: np.ndarray) -> None:
        sample(self, realization, attempt, samples)
        samples[1::2] *= -1.0

    monkeypatch.setattr(Cosines, "sample", wrong)


def printed_potential(monkeypatch: Any) -> None:
    """The paper's Eq. 10 and 12: 3/2 where the integral of the force has 5/2."""

    def potential(indentation, stiffness):  # type: ignore[no-untyped-def]
        return 0.4 * stiffness * indentation * math.sqrt(indentation)

    monkeypatch.setattr(il.HertzContact, "potential", staticmethod(potential))


def of_contacts(rate: float = 1.0, force: float = 1.0) -> Plant:
    """Multiply what the exact law says of contacts."""
    law = reference.ExactReference
    factors = {"contact_rate": rate, "mean_contact_force": force}
    return returned(
        law, "_contact", lambda found, *_: {name: factors.get(name, 1.0) * value for name, value in found.items()}
    )


def without_turns(plan: Any, sums: np.ndarray, *others: Any) -> tuple[Any, ...]:
    """Take what flows add to velocities under given forces for nothing."""
    return plan, np.where(np.arange(len(sums))[:, None, None] == TURN, 0.0, sums), *others


def without_middle(flows: Any) -> Any:
    """Leave out the noise up to the middle of a flow."""
    return flows._replace(middle_covariance=0.0 * flows.middle_covariance)


def without_mass(made):
    """Leave the mass out of the increments of a chain, after it was made."""

    def make(chain):
        made(chain)
        object.__setattr__(chain, "increment", np.full((len(chain.mass), 1), chain.step))

    return make


BUGS = [
    Bug("balances of continuous time", LONG, returned(moments, "balances_of", continuous_balances)),
    Bug("regression with the other sign", LONG, other_sign),
    Bug("moments at the kick alone", PAIR, returned(moments, "_over_steps", at_kicks)),
    Bug("velocities after the kick", PAIR, after_the_kick),
    Bug("increment of a kick without the mass", TREE,
        instead(Chain, "__post_init__", without_mass(Chain.__post_init__))),
    Bug("middle of the flow without its noise", PAIR,
        in_plan(method__flows=lambda plan: without_middle(plan.method.flows))),
    Bug("window of the contact rate eight times as wide", PAIR,
        in_plan(observed__window=lambda plan: 8.0 * plan.observed.window)),
    Bug("contacts counted from step to step", COARSE, closings),
    Bug("flux through the window in both directions", PAIR, scaled_rate(2.0)),
    Bug("flux through the window without its weight", PAIR, scaled_rate(8.0 / 9.0)),
    Bug("variance without the square of the mean", PAIR,
        instead(schema.Variance, "averaged", lambda variance, moments, average: average(moments.bodies.xx))),
    Bug("sums that are not cleared between batches", PAIR, instead(Block, "clear_sums", lambda block: None)),
    Bug("sums of one batch for the next", BATCHES,
        returned(labelling, "merged",
                 lambda found, _: tuple(np.repeat(sums[:1], len(sums), axis=0) for sums in found))),
    Bug("blocks in another order", ALONE,
        returned(labelling, "merged", lambda found, results: tuple(
            np.concatenate([getattr(item, name) for item in results[::-1]], axis=-1)
            for name in ("bodies", "contacts", "products", "points", "laws")))),
    Bug("means without the states at both ends", DRIVEN,
        returned(Block, "_edge", lambda edge, _: type(edge)(*(0.0 * item for item in edge)))),
    Bug("given forces as at the begin of a step", DRIVEN,
        both(returned(band_limited, "mean_and_slope", lambda _, values: (values[..., 0], 0.0 * values[..., 0])),
             instead(functions_in_steps, "panel_weights", band_limited.panel_weights.__wrapped__))),
    Bug("a step that does not know given forces", DRIVEN,
        instead(automatic, "resolving_step", lambda model, begin, end, longest: longest)),
    Bug("a slow load taken for motion", DRIVEN, called(moments, "_open_flow", without_turns)),
    Bug("labels of bodies in another order", PAIR, in_plan(system__bodies=lambda plan: plan.system.bodies[::-1])),
    Bug("standard errors of samples as if they were independent", INTERVALS, errors(lambda units: 0.2)),
    Bug("standard deviations for standard errors", INTERVALS, errors(math.sqrt)),
    Bug("batches shorter than the relaxation time", BATCHES,
        both(instead(clock, "BATCH_TIMES", 0.2),
             returned(clock, "batches_wanted", lambda wanted, *_: 40 * wanted))),
    Bug("bins half a width aside", PAIR, bins(shift=0.5)),
    Bug("bins that are too wide", PAIR, bins(width=24.0 / 23.0)),
    Bug("samples beyond the limits in the last bins", PAIR,
        returned(density.Counts, "result", into_end_bins)),
    Bug("density by the width of the bins without the last", PAIR, returned(il.Density, "label", wider)),
    Bug("cosines with the amplitude of a two-sided density", BOUNDED, lines(amplitude=math.sqrt(0.5))),
    Bug("cosines without the 2π of their density", BOUNDED, lines(amplitude=1.0 / math.sqrt(2.0 * math.pi))),
    Bug("frequencies of cosines in Hz", BOUNDED, lines(frequency=0.5 / math.pi)),
    Bug("the same phases in every realization", BOUNDED, one_draw),
    Bug("the same phases on every body", BOUNDED,
        instead(cosine_series, "stream", lambda *_: (1, 2, 3))),
    Bug("linear response with its velocity reversed", BOUNDED, sign_of_velocity),
    Bug("potential as printed in the paper", PAIR, printed_potential, in_reference=True),
    Bug("contact rate of one body's temperature", PAIR, of_contacts(rate=math.sqrt(0.5)), in_reference=True),
    Bug("mean force over the time in contact", PAIR, of_contacts(force=1.0 / 0.1077), in_reference=True),
    Bug("temperature without the factor π", PAIR,
        called(conditions, "pair_law", lambda group, heat: (group, heat / math.pi)),
        in_reference=True),
]  # fmt: skip
