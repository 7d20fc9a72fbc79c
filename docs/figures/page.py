"""Write all figures of the documentation on one page, to look at them together.

Run ``python docs/figures/page.py PAGE.html [FOLDER …]``; figures of further folders, such as those of a study in
``results/two-system/figures``, and films (HTML) are shown below.
"""

import html
import sys
from pathlib import Path

HERE = Path(__file__).parent
STYLE = """body { font: 14px sans-serif; margin: 1rem }
figure { display: inline-block; margin: 0.5rem; vertical-align: top }
img { max-width: 45rem; background: white } iframe { width: 42rem; height: 18rem; border: 1px solid #ccc }"""


def shown(file: Path) -> str:
    """Return a figure or a film with its name."""
    place = html.escape(file.resolve().as_uri())
    film = file.suffix == ".html"
    picture = f'<iframe src="{place}"></iframe>' if film else f'<img src="{place}" alt="{html.escape(file.stem)}">'
    return f"<figure><figcaption>{html.escape(file.name)}</figcaption>{picture}</figure>"


def page(folders: list[Path]) -> str:
    """Return the page with the figures of some folders."""
    parts = ['<!DOCTYPE html><html lang="en"><head><meta charset="utf-8"><title>Figures</title>']
    parts.append(f"<style>{STYLE}</style></head><body>")
    for folder in folders:
        files = sorted(file for kind in ("*.png", "*.gif", "*.svg", "*.html") for file in folder.glob(kind))
        parts += [f"<h2>{html.escape(str(folder))}</h2>", *map(shown, files)]
    return "\n".join([*parts, "</body></html>", ""])


if __name__ == "__main__":
    folders = [HERE, HERE / "checks", *map(Path, sys.argv[2:])]
    Path(sys.argv[1]).write_text(page(folders), encoding="utf-8")
