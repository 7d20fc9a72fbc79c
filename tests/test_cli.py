"""The command line: what it prints where, its exit codes, what it imports."""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import impactlab as il
from impactlab.command_line.main import main, parser
from impactlab.command_line.output import CLOSED, DONE, FAILED, INCOMPLETE, INTERRUPTED, USAGE
from impactlab.command_line.study_commands import described
from impactlab.studies.discovery import study_class

PLUGIN = Path(__file__).parent / "plugin_example"
SHORT = ["--set", "duration=20.0", "--set", "clearances=[0.5]"]


@pytest.fixture(autouse=True)
def _here(monkeypatch, tmp_path):
    monkeypatch.syspath_prepend(str(PLUGIN))
    monkeypatch.chdir(tmp_path)


def environment():
    path = os.pathsep.join([str(PLUGIN), *(str(Path(entry).absolute()) for entry in sys.path)])
    return {**os.environ, "PYTHONPATH": path, "PYTHONIOENCODING": "utf-8"}


def process(*arguments):
    return subprocess.run([sys.executable, *arguments], env=environment(), capture_output=True, text=True)


# what is printed


def test_list(capsys):
    assert main(["list"]) == DONE
    shown = capsys.readouterr()
    assert re.search(r"^example +A body that a wall stops <example>$", shown.out, re.MULTILINE)
    assert re.search(r"^two-system +Two ", shown.out, re.MULTILINE)
    assert shown.err == ""


def test_plugins_tell_what_fails(capsys, tmp_path, monkeypatch):
    assert main(["plugins"]) == DONE
    assert "example  impactlab-example 1.0  ok" in capsys.readouterr().out
    folder = tmp_path / "broken-2.0.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: broken\nVersion: 2.0\n")
    entries = ["[impactlab.studies]", "absent = nowhere_at_all:Thing", "[impactlab.components]", "Lost = nowhere:Lost"]
    (folder / "entry_points.txt").write_text("\n".join(entries))
    monkeypatch.syspath_prepend(str(tmp_path))
    assert main(["plugins"]) == USAGE
    shown = capsys.readouterr().out
    assert "absent  broken 2.0  ModuleNotFoundError" in shown
    assert "Lost  component  The component 'Lost' of broken 2.0 cannot be used: ModuleNotFoundError" in shown
    assert main(["list"]) == DONE
    rows = dict(row.split(maxsplit=1) for row in capsys.readouterr().out.splitlines())
    assert rows["example"].startswith("A body that a wall stops")
    assert rows["absent"].startswith("cannot be used: ModuleNotFoundError: No module named 'nowhere_at_all'")
    assert rows["absent"].endswith("(broken 2.0)")
    assert main(["show", "absent"]) == USAGE
    assert "'absent' of broken 2.0 cannot be used: ModuleNotFoundError" in capsys.readouterr().err


def test_without_a_command_the_next_ones_are_named(capsys):
    assert main([]) == DONE
    shown = capsys.readouterr().out
    commands = re.findall(r"^.{23}impactlab (.*?)(?:  .*)?$", shown, re.MULTILINE)
    assert len(commands) == len([line for line in shown.splitlines() if line[23:].startswith("impactlab ")])
    for command in commands:
        if command != "--help":
            parser().parse_args(command.split())


def test_show_tells_settings_and_files(capsys):
    assert main(["show", "example"]) == DONE
    shown = capsys.readouterr().out
    assert shown.startswith("example: A body that a wall stops <example>\n\nOne body between its spring and a wall")
    assert re.search(r"^  clearances +m +\[0\.5, 1\.0\]$", shown, re.MULTILINE)
    assert re.search(r"^  realizations +128$", shown, re.MULTILINE)
    assert re.search(r"^  figures/contact_ratio\.svg  the part of the time", shown, re.MULTILINE)
    assert "claims and checks" in shown
    assert re.search(r"^claims, by section\n  1  the wall stops the body$", shown, re.MULTILINE)
    assert main(["show", "exampel"]) == USAGE
    assert "did you mean 'example'?" in capsys.readouterr().err


def test_a_study_without_a_docstring_has_none():
    class BareStudy(il.Study):
        name = "bare"
        title = "Bare"

    assert described(BareStudy).startswith("bare: Bare\n\nsettings\n  none\n")


def test_run_prints_claims_and_writes_the_default_folder(capsys):
    assert main(["run", "example", *SHORT]) == DONE
    shown = capsys.readouterr()
    assert shown.out.split(maxsplit=2)[:2] == ["1", "holds"]
    assert "1 of 1 checks passed; 1 claims: holds 1." in shown.err
    assert Path("results", "example", "report.html").is_file()


@pytest.mark.full
def test_run_quietly_and_with_much_text(capsys):
    assert main(["run", "example", *SHORT, "-q"]) == DONE
    assert capsys.readouterr() == ("", "")
    assert main(["run", "example", *SHORT, "-v"]) == DONE
    shown = capsys.readouterr().err
    assert "[1/1] clearance/0.5" in shown
    assert "check passed: contact ratio" in shown


def test_json_is_all_of_stdout(capsys):
    assert main(["run", "example", *SHORT, "--json", "--out", "here"]) == DONE
    data = json.loads(capsys.readouterr().out)
    assert data["folder"] == "here"
    assert data["claims"][0]["verdict"] == "holds"
    assert data["checks"][0]["ok"] is True
    assert set(data["files"]) >= {"result.nc", "report.html"}


def test_a_toml_file_is_run(capsys):
    text = 'study = "example"\nduration = 20.0\nclearances = [0.5]\n'
    Path("mine.toml").write_text(text, encoding="utf-8")
    assert main(["run", "mine.toml", "--set", "law=linear", "--json"]) == DONE
    settings = json.loads(capsys.readouterr().out)["settings"]
    assert (settings["law"], settings["duration"], settings["clearances"]) == ("linear", 20.0, [0.5])


def test_dry_run_simulates_nothing(capsys, monkeypatch):
    monkeypatch.setattr(il, "simulate", None)
    assert main(["run", "example", "--dry-run", "--quick"]) == DONE
    rows = capsys.readouterr().out.splitlines()
    assert [row.split() for row in rows[1:]] == [["clearance/0.5", "1", "1", "128", "100"]]
    assert main(["run", "example", "--dry-run", "--json"]) == DONE
    assert len(json.loads(capsys.readouterr().out)["items"]) == 2
    assert not Path("results").exists()


@pytest.mark.full
def test_report_draws_again_without_simulating(capsys, monkeypatch):
    main(["run", "example", *SHORT, "--out", "here"])
    before = json.loads(Path("here", "manifest.json").read_text(encoding="utf-8"))
    Path("here", "report.html").unlink()
    monkeypatch.setattr(il, "simulate", None)
    capsys.readouterr()
    assert main(["report", "here"]) == DONE
    assert "holds" in capsys.readouterr().out
    after = json.loads(Path("here", "manifest.json").read_text(encoding="utf-8"))
    assert Path("here", "report.html").is_file()
    assert after["checks"] == before["checks"]
    assert after["complete"]


def test_doctor(capsys):
    assert main(["doctor"]) == DONE
    shown = capsys.readouterr().out
    assert f"impactlab    {il.__version__}" in shown
    assert "simulation   works" in shown


@pytest.mark.campaign
def test_after_warm_a_network_compiles_its_forces_alone(capsys, run_python):
    assert main(["warm"]) == DONE
    assert capsys.readouterr().out.count(" compiled ") == 5
    text = (
        "import impactlab as il\n"
        "from impactlab.compiling.jit import compilations\n"
        "body = il.LinearOscillator(mass=3.0, stiffness=50.0, damping=0.2)\n"
        "network = il.chain(3, body, il.HertzContact(1e5), clearance=0.03, excitation=il.WhiteNoise(2.0))\n"
        "il.simulate(network, 200.0, realizations=64, rng=1, progress=False)\n"
        "print(compilations())"
    )
    assert int(run_python("-W", "ignore", "-c", text)) <= 1


def test_completion_needs_a_package(capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "shtab", None)
    with pytest.raises(SystemExit) as stop:
        main(["--print-completion", "bash"])
    assert stop.value.code == USAGE
    assert "pip install shtab" in capsys.readouterr().err


def test_completion_knows_commands_and_files(capsys):
    pytest.importorskip("shtab")
    with pytest.raises(SystemExit) as stop:
        main(["--print-completion", "bash"])
    assert stop.value.code == DONE
    script = capsys.readouterr().out
    assert "simulate" in script
    assert "--realizations" in script
    assert re.search("_pos_0_COMPGEN=_shtab_compgen_files", script)


# exit codes


def test_a_check_that_fails(capsys):
    assert main(["run", "example", *SHORT, "--set", "largest_ratio=0.0", "--out", "here"]) == FAILED
    assert "check failed: contact ratio" in capsys.readouterr().err
    assert main(["resume", "here"]) == FAILED  # complete, but a check failed


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "exampel"], "did you mean 'example'?"),
        (["run", "missing.toml"], "There is no file missing.toml"),
        (["run", "example", "--set", "clearances=0.5"], "must be a list of numbers"),
        (["run", "example", "--set", "clearance=[0.5]"], "did you mean 'clearances'?"),
        (["run", "example", "--set", "duration"], "key=value"),
        (["run", "example", "--workers", "0"], "workers"),
        (["run", "example", "--out", "file"], "is a file"),
        (["resume", "nowhere"], "not the folder of a study's run"),
        (["report", "nowhere"], "not the folder of a study's run"),
    ],
)
def test_bad_input_is_one_line(arguments, message, capsys):
    Path("file").write_text("kept")
    assert main(arguments) == USAGE
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err.startswith("impactlab: error: ")
    assert shown.err.count("\n") == 1
    assert message in shown.err


@pytest.mark.parametrize("arguments", [["walk"], ["run"], ["run", "example", "--colour"]])
def test_bad_usage(arguments, capsys):
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == USAGE
    assert "usage: impactlab" in capsys.readouterr().err


def fail_at_the_second(monkeypatch, error):
    simulate, calls = il.simulate, []

    def failing(network, **options):
        calls.append(1)
        if len(calls) == 2:
            raise error
        return simulate(network, **options)

    monkeypatch.setattr(il, "simulate", failing)


@pytest.mark.full
@pytest.mark.parametrize(
    ("error", "code"),
    [(KeyboardInterrupt(), INTERRUPTED), (il.Diverged("too wild"), INCOMPLETE), (OSError(28, "No space"), INCOMPLETE)],
)
def test_a_run_that_stops_says_how_to_go_on(error, code, capsys, monkeypatch):
    fail_at_the_second(monkeypatch, error)
    assert main(["run", "example", "--set", "duration=20.0", "--out", "here"]) == code
    shown = capsys.readouterr().err
    assert "1 simulation(s) are kept; continue with: impactlab resume here" in shown
    assert main(["report", "here"]) == USAGE
    assert "not complete" in capsys.readouterr().err
    assert main(["resume", "here", "--json"]) == DONE
    assert json.loads(capsys.readouterr().out)["settings"]["duration"] == 20.0
    assert main(["resume", "here"]) == DONE
    assert "is complete" in capsys.readouterr().err


def test_a_traceback_only_when_asked_for(capsys, monkeypatch):
    fail_at_the_second(monkeypatch, il.Diverged("too wild"))
    assert main(["run", "example", "--set", "duration=20.0", "-v"]) == INCOMPLETE
    assert "Traceback" in capsys.readouterr().err


@pytest.fixture
def started():
    """Start a run beside the test, which does not outlive it."""
    with contextlib.ExitStack() as stack:

        def start(*arguments):
            command = [sys.executable, "-m", "impactlab", *arguments]
            run = stack.enter_context(subprocess.Popen(command, env=environment(), stderr=subprocess.PIPE, text=True))
            stack.callback(run.kill)
            return run

        yield start


@pytest.mark.full
@pytest.mark.skipif(sys.platform == "win32", reason="signals are sent in another way there")
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, INTERRUPTED), (signal.SIGTERM, INCOMPLETE)])
def test_signals_stop_a_run(number, code, tmp_path, started):
    run = started("run", "example", "--set", "duration=1e6", "--set", "clearances=[0.02]", "-v", "--out", "here")
    assert "[1/1]" in run.stderr.readline()
    time.sleep(1.5)  # compiled code is running by now
    run.send_signal(number)
    assert run.wait(30) == code  # the run would take many minutes
    assert "impactlab resume here" in run.stderr.read()
    assert {path.name for path in (tmp_path / "here").iterdir()} <= {"manifest.json", "items"}


@pytest.mark.skipif(sys.platform == "win32", reason="signals are sent in another way there")
def test_a_request_to_terminate_is_not_taken_for_an_error(capsys, monkeypatch):
    """A study that goes on after any error stops all the same."""

    def collect(self, results):
        with contextlib.suppress(Exception):
            signal.raise_signal(signal.SIGTERM)
        pytest.fail("the study went on")

    monkeypatch.setattr(study_class("example"), "collect", collect)
    assert main(["run", "example", *SHORT, "--out", "here"]) == INCOMPLETE
    assert "impactlab resume here" in capsys.readouterr().err
    assert sorted(path.name for path in Path("here").iterdir()) == ["items", "manifest.json"]


# imports


@pytest.mark.parametrize("arguments", [["--help"], ["list"], ["show", "scaling"], ["run", "example", "--dry-run"]])
def test_light_commands_import_nothing_heavy(arguments):
    code = (
        "import sys\nfrom impactlab.__main__ import main\n"
        f"try: main({arguments})\nexcept SystemExit: pass\n"
        "heavy = [name for name in ('numba', 'xarray', 'matplotlib', 'scipy') if name in sys.modules]\n"
        "print(heavy, 'numpy' in sys.modules, file=sys.stderr)"
    )
    heavy = process("-c", code).stderr.strip().splitlines()[-1]
    assert heavy.startswith("[] ")
    if arguments[0] != "run":
        assert heavy == "[] False"


@pytest.mark.skipif(sys.platform == "win32", reason="pipes close in another way there")
def test_nobody_reads_on():
    command = [sys.executable, "-m", "impactlab"]
    with subprocess.Popen(command, env=environment(), stdout=subprocess.PIPE, stderr=subprocess.PIPE) as run:
        run.stdout.close()  # before anything is written
        assert run.stderr.read() == b""
        assert run.wait(30) == CLOSED
