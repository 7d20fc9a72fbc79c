"""Print the oldest versions that `pyproject.toml` allows, as constraints of pip."""

import re
import tomllib
from pathlib import Path

project = tomllib.loads((Path(__file__).parent.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]
for needed in project["dependencies"]:
    print(re.sub(r"^([\w-]+)>=([\d.]+).*$", r"\1==\2.*", needed))
