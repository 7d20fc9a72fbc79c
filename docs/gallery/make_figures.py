"""Draw the figures of the gallery: each page saves its own, under its name.

Run ``python docs/gallery/make_figures.py [FOLDER [PAGE …]]``; the default is the folder ``figures`` beside it, and all
pages. It takes a minute.
"""

import os
import re
import sys
import tempfile
from pathlib import Path

import matplotlib

HERE = Path(__file__).parent
BLOCK = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def draw(page: Path, folder: Path) -> None:
    """Run the code of a page in a folder of its own, and keep its figure."""
    with tempfile.TemporaryDirectory() as scratch:
        os.chdir(scratch)
        code, file = "\n".join(BLOCK.findall(page.read_text(encoding="utf-8"))), Path(f"{page.stem}.py").resolve()
        file.write_text(code, encoding="utf-8")  # where laws are read
        exec(compile(code, file, "exec"), {})
        (folder / f"{page.stem}.png").write_bytes(Path(f"{page.stem}.png").read_bytes())
        os.chdir(folder)


if __name__ == "__main__":
    folder = (Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "figures").resolve()
    folder.mkdir(exist_ok=True)
    matplotlib.use("agg")
    for page in sorted(HERE.glob("*.md")):
        if page.stem != "index" and (len(sys.argv) < 3 or page.stem in sys.argv[2:]):
            draw(page, folder)
