"""How studies are found: entry points of installed distributions, and TOML files that configure them."""

from __future__ import annotations

import os
from collections.abc import Mapping
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any, NamedTuple

from impactlab.components.offered import loaded
from impactlab.errors import InvalidInput
from impactlab.given_files import text_in
from impactlab.inputs import checked, shown, suggestion
from impactlab.studies.study import Study
from impactlab.toml_text import parsed_toml, value_text

GROUP = "impactlab.studies"
"""Group of entry points in which a distribution names its studies."""


class Plugin(NamedTuple):
    """A study that a distribution offers: its class, or why it cannot be used."""

    name: str
    distribution: str
    study: type[Study] | None
    problem: str


def plugins() -> list[Plugin]:
    """Return the studies of all installed distributions, in order of their names.

    A study that cannot be imported does not hide the others: its `problem` says why.
    """
    return [_load(entry) for entry in sorted(entry_points(group=GROUP), key=lambda entry: entry.name)]


def _load(entry: EntryPoint) -> Plugin:
    distribution = f"{entry.dist.name} {entry.dist.version}" if entry.dist is not None else "unknown"
    study, problem = loaded(entry)
    if problem:
        return Plugin(entry.name, distribution, None, problem)
    if not isinstance(study, type) or not issubclass(study, Study):
        problem = f"{entry.value} is not a subclass of il.Study"
    elif getattr(study, "name", None) != entry.name:
        problem = f"the class is named {getattr(study, 'name', None)!r}, its entry point {entry.name!r}"
    return Plugin(entry.name, distribution, None if problem else study, problem)


def study_class(name: str) -> type[Study]:
    """Return the class of a study by its name; refuse a study that none or several offer, or cannot be imported."""
    entries = entry_points(group=GROUP)
    found = [_load(entry) for entry in entries if entry.name == name]
    if not found:
        known = sorted(entry.name for entry in entries)
        raise InvalidInput(f"There is no study {name!r}; {suggestion(name, known)}")
    if len(found) > 1:
        places = ", ".join(plugin.distribution for plugin in found)
        raise InvalidInput(f"The study {name!r} is offered more than once ({places}); uninstall one of them.")
    if found[0].study is None:
        raise InvalidInput(f"The study {name!r} of {found[0].distribution} cannot be used: {found[0].problem}.")
    return found[0].study


@checked
def make_study(
    study: str | os.PathLike[str] | Study | type[Study],
    settings: Mapping[str, Any] | None = None,
    quick: bool = False,
) -> Study:
    """Return a configured study, given by its name, a TOML file (a path, or a text that ends in ``.toml``) or itself.

    A class of studies will do as well. Settings are values that replace those of the study, also those of its `quick`
    form, which is a smoke test. Studies and files that do not exist, and settings that are unknown or of the wrong
    type, are refused.
    """
    if isinstance(study, os.PathLike) or (isinstance(study, str) and study.endswith(".toml")):
        made = _from_toml(Path(study))
    elif isinstance(study, str):
        made = study_class(study)()
    elif isinstance(study, type) and issubclass(study, Study):
        made = study()
    else:
        made = study
    if quick:
        made = made.quick()
    return made.replace(**settings) if settings else made


def _from_toml(path: Path) -> Study:
    data = parsed_toml(text_in(path), str(path))
    name = data.pop("study", None)
    if not isinstance(name, str):
        raise InvalidInput(f'{path} must name its study in a line such as study = "two-system".')
    try:
        return study_class(name)(**data)
    except InvalidInput as error:
        raise InvalidInput(f"{path}: {error}") from error


def toml(study: Study) -> str:
    """Return the text of a TOML file that configures this study."""
    settings = {"study": study.name, **study.settings()}
    return "".join(f"{key} = {value_text(value)}\n" for key, value in settings.items())


def parse_setting(text: str, study: Study) -> tuple[str, Any]:
    """Return key and value of ``key=value``, or refuse it; the value is TOML, but quotes may be left out of a text."""
    key, separator, value = (part.strip() for part in text.partition("="))
    if not separator:
        raise InvalidInput(f"A setting is key=value, such as clearances=[0.05], not {text!r}.")
    if key not in study.field_names():
        raise InvalidInput(f"The study {study.name!r} has no setting {key!r}; {suggestion(key, study.field_names())}")
    if isinstance(getattr(study, key), str) and not value.startswith(("'", '"')):
        return key, value
    try:
        return key, parsed_toml(f"value = {value}", key)["value"]
    except InvalidInput as error:
        raise InvalidInput(
            f"The value of {key!r} must be written as in TOML (2.5, [1.0, 2.0], true), not {shown(value)}."
        ) from error
