"""Build the site into ``build/site``: ``python docs/site/build.py``. A warning is an error."""

import sys
from importlib.util import find_spec
from pathlib import Path

ROOT = Path(__file__).parent.parent.parent
NEEDS = ("sphinx", "myst_parser", "numpydoc", "sphinx_copybutton", "pydata_sphinx_theme", "latex2mathml")


def missing() -> str:
    """Return what is to be installed for the site; nothing if all of it is there."""
    absent = [name for name in NEEDS if find_spec(name) is None]
    return f'The site needs {", ".join(absent)}: python -m pip install -e ".[docs]"' if absent else ""


if __name__ == "__main__":
    if message := missing():
        sys.exit(message)
    from sphinx.cmd.build import main

    sys.exit(main(["-W", "--keep-going", "-q", str(ROOT / "docs"), str(ROOT / "build" / "site")]))
