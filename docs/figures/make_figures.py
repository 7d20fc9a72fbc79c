"""Draw the figures of the README and of the pages of the documentation.

Run ``python docs/figures/make_figures.py [FOLDER]``; the default is this folder. It takes a minute. Figures of a page
are those that its own code draws: each is saved where the page shows it.
"""

import os
import re
import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib import pyplot
from matplotlib.figure import Figure

import impactlab as il
from impactlab.plotting.drawing import draw_network
from impactlab.plotting.style import COLORS, style

PAGES = ("tutorial", "plots")
DOCS = Path(__file__).parent.parent
PARTS = re.compile(r"^```python\n(.*?)^```$|^!\[[^]]*\]\(figures/(\w+\.png)\)", re.MULTILINE | re.DOTALL)

NETWORK = il.Network(
    oscillators={
        "one": il.LinearOscillator.from_frequency(natural_frequency=32 * np.pi, damping_ratio=0.1),
        "two": il.LinearOscillator.from_frequency(natural_frequency=2 * np.pi, damping_ratio=0.1),
    },
    contacts={"gap": il.Contact("one", "two", il.HertzContact(stiffness=1e4), clearance=0.05)},
    excitations={"one": il.WhiteNoise(spectral_density=16.0), "two": il.WhiteNoise(spectral_density=1.0)},
)


def densities(network: il.Network) -> Figure:
    """Densities of both displacements: the ensemble, the exact law, and their difference in standard errors."""
    record = il.Density(bins=120, limits={"one": (-0.075, 0.075), "two": (-0.25, 0.85)})
    result = il.simulate(network, duration=1000.0, realizations=512, record=record, rng=1)
    exact = il.exact(network)
    figure = Figure(figsize=(7.5, 6.0), layout="constrained")
    system, plots = figure.subfigures(2, 1, height_ratios=(4, 5))
    draw_network(network, system.subplots())
    axes = plots.subplots(2, 2, sharex="col", height_ratios=(3, 1))
    for name, (above, below) in zip(network.oscillators, axes.T, strict=True):
        il.plot.density(result, name, reference=exact, ax=above)
        body = result.sel(oscillator=name)
        expected = exact.bin_density(name, "displacement", body.displacement_edges.values)
        error = body.density_displacement_standard_error.where(body.density_displacement_standard_error > 0.0)
        below.axhspan(-2, 2, color="0.9")
        below.plot(body.displacement_center, (body.density_displacement - expected) / error, ".", color=COLORS[0], ms=3)
        above.set(title=f"body {name!r}", xlabel="")
        below.set(xlabel="displacement (m)", ylabel="difference\n(std. errors)", ylim=(-5, 5), yticks=(-4, 0, 4))
    return figure


def of_page(page: str, folder: Path) -> Iterator[tuple[str, Figure]]:
    """Run the code of a page, and give the figures that it draws by the names under which the page shows them.

    Films, which it writes itself, go to the folder.
    """
    names: dict[str, object] = {}
    for number, (code, file) in enumerate(PARTS.findall((DOCS / f"{page}.md").read_text(encoding="utf-8"))):
        if file:
            yield file, pyplot.gcf()
        else:
            pyplot.close("all")
            block = Path(f"{page}_{number}.py").resolve()
            block.write_text(code, encoding="utf-8")  # kernels are read from files
            exec(compile(code, block, "exec"), names)
            for film in Path().glob("*.gif"):
                shutil.move(film, folder / film.name)


if __name__ == "__main__":
    folder = (Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent).resolve()
    matplotlib.use("agg")
    with style():
        densities(NETWORK).savefig(folder / "densities.png", dpi=130)
    with tempfile.TemporaryDirectory() as scratch:
        os.chdir(scratch)  # where the pages write their files
        for page in PAGES:
            for file, figure in of_page(page, folder):
                figure.savefig(folder / file, dpi=100)
        os.chdir(folder)
