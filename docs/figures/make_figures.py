"""Draw the figures of the README and the documentation.

Run ``python docs/figures/make_figures.py [FOLDER]``; the default is this folder. It takes a few seconds.
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import impactlab as il
from impactlab.plotting.drawing import draw_network
from impactlab.plotting.style import COLORS, style

NETWORK = il.Network(
    oscillators={
        "one": il.LinearOscillator.from_frequency(natural_frequency=32 * np.pi, damping_ratio=0.1),
        "two": il.LinearOscillator.from_frequency(natural_frequency=2 * np.pi, damping_ratio=0.1),
    },
    contacts={"gap": il.Contact("one", "two", il.HertzContact(stiffness=1e4), clearance=0.05)},
    excitations={"one": il.WhiteNoise(spectral_density=16.0), "two": il.WhiteNoise(spectral_density=1.0)},
)
BLUE, ORANGE = COLORS[:2]


def densities(network: il.Network) -> Figure:
    """Densities of both displacements: the ensemble, the exact law, and their difference in standard errors."""
    result = il.simulate(
        network,
        duration=1000.0,
        realizations=512,
        record=il.Density(bins=120, limits={"one": (-0.075, 0.075), "two": (-0.25, 0.85)}),
        rng=1,
    )
    exact = il.exact(network)
    figure = Figure(figsize=(7.5, 6.0), layout="constrained")
    system, plots = figure.subfigures(2, 1, height_ratios=(4, 5))
    draw_network(network, system.subplots())
    axes = plots.subplots(2, 2, sharex="col", height_ratios=(3, 1))
    for name, (above, below) in zip(network.oscillators, axes.T, strict=True):
        body = result.sel(oscillator=name)
        expected = exact.bin_density(name, "displacement", body.displacement_edges.values)
        center = 1e3 * body.displacement_center.values
        above.plot(center, expected, color=ORANGE, label="exact law")
        above.plot(center, body.density_displacement, ".", color=BLUE, markersize=3, label="512 realizations")
        error = body.density_displacement_standard_error.values
        z = np.divide(
            body.density_displacement.values - expected, error, out=np.full_like(error, np.nan), where=error > 0
        )
        below.axhspan(-2, 2, color="0.9")
        below.plot(center, z, ".", color=BLUE, markersize=3)
        above.set(title=f"body {name!r}", ylabel="density (1/m)", ylim=(0, None))
        below.set(xlabel="displacement (mm)", ylabel="difference\n(std. errors)", ylim=(-5, 5), yticks=(-4, 0, 4))
    axes[0, 1].legend(frameon=False)
    return figure


if __name__ == "__main__":
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent
    with style():
        densities(NETWORK).savefig(folder / "densities.png", dpi=130)
