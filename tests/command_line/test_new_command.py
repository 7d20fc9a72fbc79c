"""The package of a study that ``impactlab new`` writes."""

import importlib
import tomllib
from pathlib import Path

import pytest

import impactlab as il
from impactlab.command_line.main import main
from impactlab.command_line.output import DONE, USAGE
from impactlab.studies.discovery import make_study


@pytest.fixture(autouse=True)
def _here(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)


def test_a_study_is_written_and_runs(capsys, monkeypatch):
    assert main(["new", "strange-one"]) == DONE
    assert "python -m pip install -e strange-one" in capsys.readouterr().out
    folder = Path("strange-one")
    files = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    assert files == {
        "pyproject.toml", "README.md", "strange-one.toml", "strange_one.py", "tests/test_strange_one.py",
    }  # fmt: skip
    described = tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))
    project = described["project"]
    assert described["tool"]["pytest"]["ini_options"]["testpaths"] == ["tests"]
    place, name = project["entry-points"]["impactlab.studies"]["strange-one"].split(":")
    monkeypatch.syspath_prepend(str(folder))
    study = getattr(importlib.import_module(place), name)
    assert (study.name, name) == ("strange-one", "StrangeOneStudy")
    result = il.run_study(study, quick=True)
    assert result.passed
    assert list(result.claims.figure.values) == list(result.figures) == list(study.captions)


def test_the_settings_of_the_file_are_the_defaults(monkeypatch):
    main(["new", "strange-two", "--folder", "here"])
    monkeypatch.syspath_prepend("here")
    study = importlib.import_module("strange_two").StrangeTwoStudy
    settings = tomllib.loads(Path("here", "strange-two.toml").read_text(encoding="utf-8"))
    assert settings.pop("study") == "strange-two"
    assert make_study(study, settings) == study()
    assert list(settings) == list(study().settings())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["Strange"], "small letters"),
        (["../strange"], "small letters"),
        (["3d"], "starts with a small letter"),
        (["class"], "'class' is a word of Python's language"),
        (["numpy"], "a module 'numpy'"),
        (["two-system"], "a study 'two-system'"),
        (["strange", "--folder", "there"], "there exists already"),
    ],
)
def test_what_is_refused(arguments, message, capsys, tmp_path):
    Path("there").mkdir()
    assert main(["new", *arguments]) == USAGE
    assert message in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["there"]
    assert not list(Path("there").iterdir())
