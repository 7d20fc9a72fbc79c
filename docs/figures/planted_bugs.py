"""Draw what caught each planted bug, and print it as a table.

Run ``python -m pytest tests/test_planted_bugs.py -m campaign -rP | python docs/figures/planted_bugs.py [FOLDER]``.
"""

import math
import re
import sys
from pathlib import Path

from matplotlib.figure import Figure

from impactlab.plotting.style import COLORS, style

LINE = re.compile(r"^([^|]+) \| ([^|]+) \| (?:refused: .*|([^|]+) \| ([^|]+))$")


def caught(lines: list[str]) -> list[tuple[str, str, str, float]]:
    """Return bug, scene, detector and distance in standard errors of each line that tells them."""
    found = [match.groups() for line in lines if (match := LINE.match(line.strip()))]
    return [(bug, scene, name or "refused", float(z or math.inf)) for bug, scene, name, z in found]


def draw(rows: list[tuple[str, str, str, float]]) -> Figure:
    """Distances by bug, the smallest first; what is refused or an exact fact goes beyond the axis."""
    rows = sorted(rows, key=lambda row: row[3])
    top = 1e4
    figure = Figure(figsize=(8.0, 1.0 + 0.16 * len(rows)), layout="constrained")
    axes = figure.subplots()
    lengths = [min(row[3], top) for row in rows]
    colors = [COLORS[0] if row[3] < top else COLORS[1] for row in rows]
    axes.barh(range(len(rows)), lengths, color=colors, height=0.7)
    axes.set_yticks(range(len(rows)), [row[0] for row in rows], fontsize=6)
    axes.set(xscale="log", xlim=(1.0, top), ylim=(-0.6, len(rows) - 0.4))
    axes.axvline(5.0, color="black", lw=0.8, ls="--")
    axes.set_xlabel("distance of what shows it most (standard errors)")
    return figure


if __name__ == "__main__":
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "checks"
    rows = caught(sys.stdin.read().splitlines())
    with style():
        draw(rows).savefig(folder / "planted_bugs.png", dpi=90)
    print("| bug | scene | caught by | standard errors |\n|---|---|---|---|")
    for bug, scene, name, z in rows:
        print(f"| {bug} | {scene} | {name.replace('_', ' ')} | {f'{z:.3g}' if math.isfinite(z) else '∞'} |")
