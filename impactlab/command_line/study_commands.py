"""Commands on studies: a list of all studies, and the settings and results of one study."""

from __future__ import annotations

import argparse
import textwrap
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from impactlab.command_line.output import DONE, Command, in_columns, say
from impactlab.toml_text import WIDTH

if TYPE_CHECKING:
    from impactlab.studies import Study


def add_commands(command: Command) -> None:
    """Add the commands of this family."""
    command("list", _list, "list the studies that can be run")
    show = command("show", _show, "show the settings of a study, and what it makes")
    show.add_argument("study", metavar="STUDY", help="name of a study")


def _list(_: argparse.Namespace) -> int:
    from impactlab.studies.discovery import plugins

    found = plugins()
    rows = [
        (item.name, item.study.title if item.study else f"cannot be used: {item.problem} ({item.distribution})")
        for item in found
    ]
    if rows:
        print(in_columns(rows))
    else:
        say("no study is installed.")
    return DONE


def _show(options: argparse.Namespace) -> int:
    from impactlab.studies.discovery import study_class

    print(described(study_class(options.study)))
    return DONE


def described(study: type[Study]) -> str:
    """Return a page on a study: its settings, claims and files. Only its class is read, not an instance."""
    import inspect

    text = inspect.cleandoc(study.__doc__ or "")
    if text.startswith(f"{study.__name__}("):  # what a dataclass has in the place of a docstring
        text = ""
    paragraphs = [textwrap.fill(" ".join(item.split()), WIDTH) for item in text.split("\n\n")] if text else []
    parts = [f"{study.name}: {study.title}", *paragraphs, "settings\n" + _settings(study)]
    if "quick" in vars(study):
        parts.append(textwrap.fill(f"--quick  {' '.join((inspect.getdoc(study.quick) or '').split())}", WIDTH))
    if study.sections:
        parts.append(f"claims, by section\n{_wrapped(study.sections.items())}")
    parts.append(f"makes, in {Path('results', study.name)} or --out FOLDER\n{_files(study)}")
    parts.append(f"run it  impactlab run {study.name}")
    return "\n\n".join(parts)


def _settings(study: type[Study]) -> str:
    from impactlab.toml_text import value_text

    rows = [
        (name, "" if study.units_of(name) == "1" else study.units_of(name), value_text(default))
        for name, default in _defaults(study).items()
    ]
    return in_columns(rows, "  ") if rows else "  none"


def _defaults(study: type[Study]) -> dict[str, object]:
    import dataclasses

    return {field.name: field.default for field in dataclasses.fields(study)}


def _files(study: type[Study]) -> str:
    judged = [name for name in ("claims", "checks") if study.makes(name)]
    rows = [
        ("report.html", "claims, figures, tables and settings on one page"),
        ("result.nc", "the numbers (netCDF with groups, an xarray.DataTree)"),
        ("manifest.json", "settings, versions and digests of the files"),
    ]
    figures = list(study.captions.items()) or ([("*", "")] if study.makes("figures") else [])
    rows += [(f"figures/{name}.svg", caption) for name, caption in figures]
    last = f"  and says how its {' and '.join(judged)} came out" if judged else "  no claims and no checks"
    return f"{_wrapped(rows)}\n{last}"


def _wrapped(rows: Iterable[tuple[str, str]]) -> str:
    """Return names with what is said of them, in two columns."""
    rows = list(rows)
    width = max(len(name) for name, _ in rows) + 4
    return "\n".join(
        textwrap.fill(f"  {name:{width - 2}}{text}", WIDTH + 10, subsequent_indent=" " * width) for name, text in rows
    )
