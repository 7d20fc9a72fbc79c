"""The command that begins a study: it writes a package that can be installed and run at once."""

from __future__ import annotations

import argparse
import keyword
import re
from pathlib import Path
from string import Template

from impactlab.command_line.output import DONE, Command
from impactlab.errors import InvalidInput


def add_commands(command: Command) -> None:
    """Add the command of this family."""
    new = command("new", _new, "begin a study of your own: write a package that runs at once")
    new.add_argument("name", metavar="NAME", help="name of the study, such as my-study")
    new.add_argument("--folder", dest="into", metavar="FOLDER", help="folder to be made (default: NAME)")


def _new(options: argparse.Namespace) -> int:
    folder = Path(options.into or options.name)
    write_study(options.name, folder)
    print(_NEXT.substitute(name=options.name, folder=folder))
    return DONE


def write_study(name: str, folder: Path) -> None:
    """Write the package of a study into a folder that is made for it; a name that is taken is refused."""
    import importlib.util
    from importlib.metadata import entry_points

    from impactlab.studies.discovery import GROUP

    module = name.replace("-", "_")
    if not re.fullmatch(r"[a-z][a-z0-9]*(-[a-z0-9]+)*", name):
        known = "starts with a small letter, and has small letters, digits and single '-' in between"
        raise InvalidInput(f"The name of a study {known}, such as my-study, not {name!r}.")
    if keyword.iskeyword(module):
        raise InvalidInput(f"{name!r} is a word of Python's language; choose another name, such as my-{name}.")
    taken = any(entry.name == name for entry in entry_points(group=GROUP))
    if taken or importlib.util.find_spec(module) is not None:
        what = f"a study {name!r}" if taken else f"a module {module!r}"
        raise InvalidInput(f"There is {what} in this installation already; choose another name.")
    try:
        folder.mkdir(parents=True)
    except FileExistsError as error:
        raise InvalidInput(f"{folder} exists already; choose another name, or give another --folder.") from error
    words = {"name": name, "module": module, "class": "".join(map(str.capitalize, name.split("-")))}
    words["class"] = words["class"].removesuffix("Study") + "Study"
    for place, text in _FILES.items():
        path = folder / Template(place).substitute(words)
        path.parent.mkdir(exist_ok=True)
        path.write_text(Template(text.removeprefix("\n")).substitute(words), encoding="utf-8")


_NEXT = Template("""$folder holds the study $name. Install it and run it:

  python -m pip install -e $folder
  impactlab show $name
  impactlab run $name --quick""")

_FILES = {
    "pyproject.toml": """
[build-system]
requires = ["setuptools>=77"]
build-backend = "setuptools.build_meta"

[project]
name = "$name"
version = "0.1.0"
description = "A study for impactlab"
readme = "README.md"
requires-python = ">=3.11"
dependencies = ["impactlab"]

[project.optional-dependencies]
test = ["pytest"]

[project.entry-points."impactlab.studies"]
$name = "$module:$class"

[tool.setuptools]
py-modules = ["$module"]

[tool.pytest.ini_options]
testpaths = ["tests"]
""",
    "README.md": """
# $name

A study for impactlab: a body on a spring beside a wall, under white noise, against the clearance.

```sh
python -m pip install -e .          # once, in this folder
impactlab show $name                # settings, and what the study makes
impactlab run $name --quick         # its smoke form
impactlab run $name.toml            # with the settings of that file
impactlab run $name --set realizations=1024
python -m pytest                    # needs pip install -e ".[test]"
```

Results are in `results/$name`; open `report.html` first. To make the study your own, change `$module.py`: its
fields are the settings, `network` and `items` say what is simulated, `collect` what is kept, and `claims` and
`figures` what is found.
""",
    "$name.toml": """
study = "$name"
clearances = [0.0, 0.5, 1.0, 1.5, 2.0]  # m
spectral_density = 0.1  # N2 s rad-1
duration = 200.0  # s
realizations = 256
seed = 1
""",
    "tests/test_$module.py": '''
"""The study in its smoke form, and its file of settings."""

import tomllib
from pathlib import Path

import impactlab as il

from $module import $class


def test_the_smoke_form_holds():
    result = il.run_study($class, quick=True)
    assert result.passed, result.checks
    assert list(result.figures) == list($class.captions)


def test_the_file_has_the_defaults():
    text = (Path(__file__).parents[1] / "$name.toml").read_text(encoding="utf-8")
    assert tomllib.loads(text) == {"study": "$name", **$class().settings()}
''',
    "$module.py": '''
"""A study for impactlab: a body beside a wall, against the clearance.

What only a run needs is imported inside functions, so that the study is listed at once.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, ClassVar, Self

import impactlab as il
from impactlab.studies import Check, Claim, SweepItem, checks_of, table_of

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure


class $class(il.Study):
    """A body on a spring beside a wall, under white noise.

    The part of the time in contact is compared with the exact stationary law, at each clearance.
    """

    name: ClassVar[str] = "$name"
    title: ClassVar[str] = "A body beside a wall, against the clearance"
    captions: ClassVar[Mapping[str, str]] = {
        "contact_ratio": "Part of the time in contact against the clearance: simulated, with a band of two standard "
        "errors, and exact.",
    }
    sections: ClassVar[Mapping[str, str]] = {"contact": "the part of the time in contact is as expected"}

    clearances: tuple[float, ...] = il.parameter((0.0, 0.5, 1.0, 1.5, 2.0), units="m", minimum=0.0)
    spectral_density: float = il.parameter(0.1, units="N2 s rad-1", above=0.0)
    duration: float = il.parameter(200.0, units="s", above=0.0)
    realizations: int = il.parameter(256, minimum=2)
    seed: int = il.parameter(1, minimum=0)

    def quick(self) -> Self:
        """Two clearances and short runs."""
        return self.replace(clearances=self.clearances[:2], duration=50.0, realizations=64)

    def network(self, clearance: float) -> il.Network:
        """Return the body and the wall."""
        return il.Network(
            {"body": il.LinearOscillator(mass=1.0, damping=0.2, stiffness=1.0)},
            {"stop": il.Contact("body", il.WALL, il.HertzContact(100.0), clearance=clearance)},
            {"body": il.WhiteNoise(self.spectral_density)},
        )

    def items(self) -> list[SweepItem]:
        """One sweep over the clearances, with the exact law beside the simulation."""
        options = {
            "duration": self.duration,
            "realizations": self.realizations,
            "rng": self.seed,
            "reference": True,
        }
        return [SweepItem("clearances", self.network, {"clearance": self.clearances}, options)]

    def collect(self, results: Mapping[str, xr.Dataset]) -> xr.DataTree:
        """Keep the sweep as it is."""
        import xarray as xr

        return xr.DataTree.from_dict({"statistics": results["clearances"]})

    def claims(self, tree: xr.DataTree) -> xr.Dataset:
        """Compare the simulation with the exact law."""
        data = tree["statistics"].to_dataset().sel(contact="stop")
        difference = abs(data.contact_ratio - data.contact_ratio_exact) / data.contact_ratio_standard_error
        worst = float(difference.max())
        claim = Claim(
            section="contact",
            statement="The simulated part of the time in contact agrees with the exact law.",
            measured=f"The largest difference is {worst:.1f} standard errors.",
            verdict="holds" if worst < 4.0 else "does not hold",
            criterion="less than 4 standard errors at each clearance",
            figure="contact_ratio",
        )
        return table_of([claim])

    def checks(self, tree: xr.DataTree) -> list[Check]:
        """No claim may be wrong."""
        return checks_of(self.claims(tree))

    def figures(self, tree: xr.DataTree) -> Iterator[tuple[str, Figure]]:
        """Draw what the captions say."""
        from matplotlib.figure import Figure

        figure = Figure(figsize=(5.0, 3.5))
        axes = il.plot.sweep(tree["statistics"].to_dataset(), "contact_ratio", ax=figure.subplots())
        axes.set_xlabel("clearance (m)")
        yield "contact_ratio", figure
''',
}
