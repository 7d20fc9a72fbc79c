"""Command lines that nobody means end in an exit code and words, without a traceback and without a hang.

They are drawn from the parser, so that a new command or option is covered.
"""

import argparse
import collections
import contextlib
import io
import random
import traceback
import warnings

import pytest
from time_limit import Hangs, limited

import impactlab as il
from impactlab.command_line.main import main, parser
from impactlab.studies.discovery import plugins, study_class

SLOW = {"doctor", "accuracy"}
"""Commands that take long by design: they compile and simulate, or draw networks by their exact laws."""

VALUES = [
    "nan", "inf", "-inf", "-1", "0", "1", "1e308", "-1e308", "1e-308", "5e-324", "1" + "0" * 400, "1" * 5000, "true",
    '""', '"abc"', '"<script>"', '"\\u0000"', "[]", "[1]", "[1.0,2.0]", "[nan]", "[inf]", "[-1.0]", "[0.0]", "[1,1]",
    '["a"]', "[[1.0]]", "{a=1}", '{type="X"}', "1979-05-27", "[true]", '[1.0,"a"]', "0x10", "1_000", "1e5", "3", "2.5",
    "[0.05]", "", "[1.0]*3", "1;2", "$(id)", "[" * 3000, "{a=" * 3000, "é", "\0", "x", "9" * 4000,
]  # fmt: skip
"""Values of settings, options and lines of files."""

FILES = [
    "network.toml", "run.nc", "study.toml", "wrong.toml", "/nonexistent", "/", "/etc/passwd", "", ".", "\0", "a" * 5000,
    "/dev/null", "/dev/full", "/dev/zero", "é.nc", "-", "run.nc/x", "o.svg", "o.nc", "o.xyz",
]  # fmt: skip
"""Names of files and folders."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with a network, a result and two studies."""
    place = tmp_path_factory.mktemp("lines")
    bodies = {name: il.LinearOscillator(stiffness=10.0, damping=1.0) for name in "ab"}
    gap = il.Contact("a", "b", il.HertzContact(1e3), clearance=0.1)
    network = il.Network(bodies, {"g": gap}, {"a": il.WhiteNoise(1.0), "b": il.WhiteNoise(1.0)})
    (place / "network.toml").write_text(network.to_toml(), encoding="utf-8")
    (place / "study.toml").write_text('study = "two-system"\n', encoding="utf-8")
    il.save(il.exact(network).statistics(), place / "run.nc")
    return place


def commands():
    """The arguments of each command, by its name."""
    actions = parser()._actions
    (found,) = (action for action in actions if isinstance(action, argparse._SubParsersAction))
    return {name: command._actions for name, command in found.choices.items()}


def settings(rng, studies):
    name = rng.choice(sorted(studies))
    key = rng.choice([*studies[name], "seed", "realisations", "type", "", "a.b", "__class__"])
    return f"{key}={rng.choice(VALUES)}" if rng.random() < 0.95 else rng.choice(["x", "=", "=1", "a==b", "seed:1"])


def value_of(rng, action, studies):
    """A value of an argument: of its kind mostly."""
    metavar = str(action.metavar or action.dest)
    if metavar == "KEY=VALUE":
        return settings(rng, studies)
    if "STUDY" in metavar:
        return rng.choice([*studies, *studies, *FILES, "nope", "../x"])
    if metavar == "NETWORK" or "." in metavar or metavar in ("FOLDER", "FILE"):
        return rng.choice(["network.toml", "run.nc", *FILES])
    if action.choices:
        return rng.choice([*map(str, action.choices), "x"])
    if "record" in action.dest:
        return rng.choice(
            ["Density", f"Density,bins={rng.choice(VALUES)}", f"Trajectory,interval={rng.choice(VALUES)}", "X"]
        )
    return rng.choice(VALUES)


def line_of(rng, known, studies):
    """A command line; runs are dry."""
    name = rng.choice(sorted(known))
    words = [name] if rng.random() < 0.97 else [rng.choice(["", "x", "--nope", "\0"])]
    for action in known[name]:
        if isinstance(action, argparse._HelpAction):
            continue
        if action.option_strings and rng.random() > (0.7 if action.dest in ("duration", "set") else 0.15):
            continue
        words += action.option_strings[-1:]
        if action.nargs != 0:
            words.append(value_of(rng, action, studies))
    if name == "run":
        words.append("--dry-run")
    return words


def write_wrong(rng, place, studies):
    """Write a file with a wrong line, or wrong bytes, of a study or a network."""
    if rng.random() < 0.5:
        name = rng.choice(sorted(studies))
        text = f'study = "{name}"\n{rng.choice(studies[name] or ("seed",))} = {rng.choice(VALUES)}\n'
    else:
        lines = (place / "network.toml").read_text(encoding="utf-8").splitlines()
        at = rng.choice([number for number, line in enumerate(lines) if "=" in line])
        lines[at] = f"{lines[at].split('=')[0]}= {rng.choice(VALUES)}"
        text = "\n".join(
            [*lines, "[simulate]", f"{rng.choice(['duration', 'step', 'initial'])} = {rng.choice(VALUES)}"]
        )
    data = bytearray(text.encode("utf-8", "surrogatepass"))
    if rng.random() < 0.2:
        data[rng.randrange(len(data))] = rng.randrange(256)
    (place / "wrong.toml").write_bytes(data)


def outcome(words):
    """The exit code of a command line, or the fault."""
    out, err = io.StringIO(), io.StringIO()
    try:
        with (
            limited(), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), warnings.catch_warnings()
        ):  # fmt: skip
            warnings.simplefilter("ignore")
            code = main(words)
    except SystemExit as error:
        code = error.code
    except Hangs:
        return "hang"
    except Exception as error:
        return f"{type(error).__name__}: {error} at {traceback.extract_tb(error.__traceback__)[-1].name}"[:160]
    said = code == 0 or (err.getvalue() + out.getvalue()).strip()
    asked = "--verbose" in words or "-v" in words
    return code if said and (asked or "Traceback" not in err.getvalue()) else f"exit {code} without words"


def faults_of(place, number, seed):
    known = {name: actions for name, actions in commands().items() if name not in SLOW}
    offered = [item.name for item in plugins() if item.study is not None and item.name not in SLOW]
    studies = {name: study_class(name).field_names() for name in offered}
    found, codes = [], collections.Counter()
    for index in range(number):
        rng = random.Random(f"{seed} {index}")
        write_wrong(rng, place, studies)
        words = line_of(rng, known, studies)
        ends = outcome(words)
        codes[ends if isinstance(ends, int) else "fault"] += 1
        if not isinstance(ends, int):
            found.append(f"{[word[:60] for word in words]}: {ends}")
    return found, codes


@pytest.mark.full
def test_some_wrong_command_lines(folder, monkeypatch):
    monkeypatch.chdir(folder)
    found, codes = faults_of(folder, 60, seed=1)
    assert not found, "\n".join(found)
    assert codes[2] > 30


@pytest.mark.campaign
def test_wrong_command_lines(folder, monkeypatch):
    """1000 lines: no traceback, no hang, an exit code and words."""
    monkeypatch.chdir(folder)
    found, codes = faults_of(folder, 1000, seed=2)
    print(dict(codes))
    assert not found, "\n".join(found)
