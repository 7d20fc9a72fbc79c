"""Short simulations with known answers, in which every bug must show."""

from __future__ import annotations

import math
from functools import cache
from typing import Any, ClassVar
from unittest import mock

import numpy as np
import pytest
from scenes import base

import impactlab as il
from impactlab.step_control.rules import steps
from planted.detectors import Distances, Scene, of_independence, of_statistics
from planted.simple_scenes import Alone, Bounded, Driven, Held, Linear, Pressed, Start


class Pair(Scene):
    """The base case at its automatic step: statistics, balances, densities, independence of realizations."""

    edges: ClassVar = {name: np.linspace(-limit, limit, 25) for name, limit in (("one", 0.047), ("two", 0.51))}

    def __init__(self, name: str, duration: float, realizations: int, **options: Any) -> None:
        self.name, self.duration, self.realizations, self.options = name, duration, realizations, options

    @cache  # noqa: B019
    def law(self) -> Any:
        law = il.exact(base())
        return law.statistics(), {
            name: law.bin_density(name, "displacement", edge) for name, edge in self.edges.items()
        }

    def evidence(self) -> Any:
        limits = {name: (edge[0], edge[-1]) for name, edge in self.edges.items()}
        record = [il.Density(bins=24, limits=limits), il.PerRealization()]
        return il.simulate(base(), self.duration, realizations=self.realizations, record=record, rng=1, **self.options)

    def distances(self, found: Any, law: Any) -> Distances:
        statistics, density = law
        result = of_statistics(found, statistics)
        for name, exact in density.items():
            of_body = found.sel(oscillator=name)
            likely = exact > 0.01 * exact.max()
            off = np.abs(of_body.density_displacement.values - exact)[likely]
            result[f"density[{name}]"] = float(
                (off / np.maximum(of_body.density_displacement_standard_error.values[likely], 1e-300)).max()
            )
            result[f"edges[{name}]"] = 0.0 if np.allclose(of_body.displacement_edges, self.edges[name]) else math.inf
        for name in ("mean_displacement", "mean_square_velocity"):
            values = found[f"{name}_by_realization"].sel(oscillator="two").values
            result[f"independence of realizations by {name}"] = of_independence(values)
        result["halves of the run"] = float(found.attrs["drift"])
        return result


class Early(Pair):
    """The same as it would begin without a law to draw from: at rest, before the automatic spin-up."""

    def evidence(self) -> Any:
        with mock.patch("impactlab.step_control.rules.expected.start_of", return_value="rest"):
            return super().evidence()


def tree(spring: float) -> il.Network:
    """Four unlike bodies at one temperature, a wall below them, contacts of two kinds and a coupling."""
    bodies = {
        "a": il.LinearOscillator(mass=0.5, damping=0.6, stiffness=20.0),
        "b": il.DuffingOscillator(mass=1.0, damping=0.9, stiffness=10.0, cubic=150.0),
        "c": il.LinearOscillator(mass=3.0, damping=2.0, stiffness=25.0),
        "d": il.LinearOscillator(mass=0.2, damping=0.3, stiffness=5.0),
    }
    noises = {name: il.WhiteNoise(body.damping / math.pi) for name, body in bodies.items()}
    contacts = {
        "floor": il.Contact(il.WALL, "a", il.LinearContact(300.0), clearance=0.15),
        "ab": il.Contact("a", "b", il.HertzContact(1e3), clearance=0.1),
        "bc": il.Contact("b", "c", il.LinearContact(200.0), clearance=-0.02),
    }
    return il.Network(bodies, contacts, noises, {"cd": il.Coupling("c", "d", il.LinearCoupling(spring))})


class Tree(Scene):
    """Unlike bodies, with a wall, other masses than 1, a cubic force, and a coupling that kicks or flows."""

    def __init__(self, spring: float) -> None:
        self.spring, self.name = spring, f"tree with {spring:g} N/m"

    @cache  # noqa: B019
    def law(self) -> Any:
        return il.exact(tree(self.spring)).statistics()

    def evidence(self) -> Any:
        return il.simulate(tree(self.spring), 6.0, realizations=2048, rng=2)

    def distances(self, found: Any, law: Any) -> Distances:
        return of_statistics(found, law)


class Far(Scene):
    """The base case with a wide gap, which realizations jump to: also against a run that clears no interval."""

    name = "jumps"

    @cache  # noqa: B019
    def law(self) -> Any:
        return il.exact(base(clearance=0.5)).statistics()

    def evidence(self) -> Any:
        result = il.simulate(base(clearance=0.5), 100.0, realizations=2080, rng=1)
        assert "longest_jump" in result.attrs
        short = {"duration": 20.0, "realizations": 2080, "rng": 1}
        return result, il.simulate(base(clearance=0.5), **short), self.doubting(short)

    def doubting(self, options: dict[str, Any]) -> Any:
        """Simulate with bounds that clear no interval."""
        with pytest.MonkeyPatch.context() as patch:
            make = steps.jump_tables

            def doubtful(*arguments: Any) -> Any:
                tables = make(*arguments)
                never = -np.inf
                return tables._replace(limit=np.full_like(tables.limit, never), nearest=never + tables.nearest)

            patch.setattr(steps, "jump_tables", doubtful)
            return il.simulate(base(clearance=0.5), **options)

    def distances(self, found: Any, law: Any) -> Distances:
        result, jumped, doubting = found
        near = ("contact_ratio", "contact_rate")
        unseen = any(abs(jumped[name].item() / doubting[name].item() - 1.0) > 1e-9 for name in near)
        return {**of_statistics(result, law), "what comes near unseen": math.inf if unseen else 0.0}


class Coverage(Scene):
    """Many short runs: whether standard errors are as large as the scatter."""

    runs = 40

    def __init__(self, name: str, options: dict[str, Any]) -> None:
        self.name, self.options = name, options

    @cache  # noqa: B019
    def law(self) -> Any:
        return il.exact(single()).statistics()

    def evidence(self) -> Any:
        return [il.simulate(single(), rng=[2, run], **self.options) for run in range(self.runs)]

    def distances(self, found: Any, law: Any) -> Distances:
        tables = [il.compare(item, law) for item in found]
        names = tables[0].statistic.values, tables[0].label.values
        labels = [f"{name}[{label}]" for name, label in zip(*names, strict=True)]
        squares = np.stack([table.z.values for table in tables]) ** 2 * (61.0 / 63.0)  # the variance of t is 63/61
        mean = squares.mean(axis=0)
        # a mean velocity is the difference of two displacements, which cancel from batch to batch
        kept = np.isfinite(mean) & ~np.array([label.startswith("mean_velocity") for label in labels])
        distance = np.abs(np.log(mean[kept])) / math.sqrt(2.0 / self.runs)
        return {
            f"scatter of {label}": float(z) for label, z in zip(np.array(labels)[kept], distance, strict=True)
        }  # fmt: skip


def single() -> il.Network:
    """One body that relaxes within half a second without a swing, and a wall."""
    body = il.LinearOscillator(damping=7.0, stiffness=10.0)
    contact = il.Contact("a", il.WALL, il.HertzContact(1e3), clearance=0.05)
    return il.Network({"a": body}, {"wall": contact}, {"a": il.WhiteNoise(1.0)})


class Halved(Scene):
    """A scene without an exact law, at its automatic step and at half of it."""

    name = "half the step"

    def network(self) -> il.Network:
        return base(excitations={"one": il.WhiteNoise(4.0), "two": il.WhiteNoise(2.0)})

    @cache  # noqa: B019
    def law(self) -> Any:
        return il.simulate(self.network(), 10.0, realizations=2048, step=0.002, rng=2)

    def evidence(self) -> Any:
        return il.simulate(self.network(), 10.0, realizations=4096, rng=1)

    def distances(self, found: Any, law: Any) -> Distances:
        return of_statistics(found, law)


PAIR, LONG, EARLY = (
    Pair("pair", 10.0, 4096),
    Pair("long pair", 20.0, 8192),
    Early("pair from rest", 1.0, 8192),
)
COARSE = Pair("pair at 10 ms", 10.0, 4096, step=0.01)
START, HELD, TREE, GROUP, JUMPS = Start(), Held(), Tree(2.0), Tree(120.0), Far()
LINEAR, BOUNDED, PRESSED, ALONE, HALVED, DRIVEN = Linear(), Bounded(), Pressed(), Alone(), Halved(), Driven()
INTERVALS = Coverage("intervals", {"duration": 10.0, "realizations": 64, "step": 0.02})
BATCHES = Coverage("intervals from batches", {"duration": 170.0, "realizations": 4, "step": 0.02})

SCENES = [
    PAIR,
    LONG,
    EARLY,
    COARSE,
    START,
    HELD,
    TREE,
    GROUP,
    JUMPS,
    LINEAR,
    BOUNDED,
    PRESSED,
    ALONE,
    HALVED,
    DRIVEN,
    INTERVALS,
    BATCHES,
]
