"""A stranger's study: one body that a wall stops, at several clearances."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar, Self

import impactlab as il
from impactlab.studies import Check, Item, Study

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure


class ExampleStudy(Study):
    """One body between its spring and a wall, under white noise."""

    name: ClassVar[str] = "example"
    title: ClassVar[str] = "A body that a wall stops <example>"

    captions: ClassVar[Mapping[str, str]] = {
        "system": "the body and its wall",
        "contact_ratio": "the part of the time that the contact is closed, against the clearance",
    }
    sections: ClassVar[Mapping[str, str]] = {"1": "the wall stops the body"}

    clearances: tuple[float, ...] = il.parameter((0.5, 1.0), units="m", minimum=0.0)
    realizations: int = il.parameter(128, minimum=1)
    duration: float = il.parameter(100.0, units="s", above=0.0)
    law: str = il.parameter("hertz")
    reference: bool = il.parameter(True)
    largest_ratio: float = il.parameter(1.0)

    def quick(self) -> Self:
        return self.replace(clearances=self.clearances[:1])

    def items(self) -> list[Item]:
        law = il.HertzContact(1e3) if self.law == "hertz" else il.LinearContact(1e3)
        body = il.LinearOscillator.from_frequency(2.0, 0.2)
        options = {"duration": self.duration, "realizations": self.realizations, "rng": 1}
        return [
            Item(
                f"clearance/{clearance:g}",
                il.Network({"body": body}, {"stop": il.Contact("body", il.WALL, law, clearance=clearance)},
                           {"body": il.WhiteNoise(1.0)}),
                options,
            )
            for clearance in self.clearances
        ]  # fmt: skip

    def collect(self, results: Mapping[str, xr.Dataset]) -> xr.DataTree:
        import xarray as xr

        cases = xr.concat(results.values(), "clearance", combine_attrs="drop", join="exact")
        return xr.DataTree.from_dict({"/statistics": cases.assign_coords(clearance=list(self.clearances))})

    def claims(self, tree: xr.DataTree) -> xr.Dataset:
        import xarray as xr

        ratio = tree["statistics/contact_ratio"].values[:, 0]
        columns = {
            "section": ["1"],
            "statement": ["The contact is closed for less than half of the time."],
            "measured": [f"{ratio.max():.3f}"],
            "verdict": ["holds" if ratio.max() < 0.5 else "does not hold"],
            "figure": ["contact_ratio"],
        }
        return xr.Dataset({name: ("claim", value) for name, value in columns.items()})

    def figures(self, tree: xr.DataTree) -> Iterable[tuple[str, Figure]]:
        from matplotlib.figure import Figure

        from impactlab.plotting.drawing import draw_network
        from impactlab.plotting.style import points

        yield "system", draw_network(self.items()[0].network)
        figure = Figure(figsize=(3.0, 2.0))
        axes = figure.subplots()
        statistics = tree["statistics"]
        points(
            axes, statistics["clearance"], statistics["contact_ratio"].values[:, 0],
            statistics["contact_ratio_standard_error"].values[:, 0],
        )  # fmt: skip
        yield "contact_ratio", figure

    def checks(self, tree: xr.DataTree) -> list[Check]:
        ratio = float(tree["statistics/contact_ratio"].max())
        return [Check("contact ratio", ratio < self.largest_ratio, f"{ratio:.3f}")]

    def tables(self, tree: xr.DataTree) -> Iterable[tuple[str, list[dict[str, Any]]]]:
        yield (
            "Contact ratio",
            [{"contact ratio": float(value)} for value in tree["statistics/contact_ratio"].values[:, 0]],
        )
