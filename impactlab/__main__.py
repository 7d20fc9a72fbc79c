"""The command line, ``python -m impactlab``: results and claims on stdout, everything else on stderr."""

from __future__ import annotations

import argparse
import contextlib
import json
import signal
import sys
import traceback
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import impactlab
from impactlab.errors import ImpactLabError, InvalidInput

if TYPE_CHECKING:
    from impactlab.studies import Item, Study, StudyResult

DONE, FAILED, USAGE, INCOMPLETE, INTERRUPTED = 0, 1, 2, 3, 130

_CODES = """exit codes:
  0 done   1 done, but checks failed   2 usage, configuration or plugin
  3 incomplete, can be resumed   130 interrupted, can be resumed"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line, by default with the arguments of the process, and return the exit code.

    It is 0 where all is done, 1 where checks failed, 2 for usage, configuration or plugin, 3 for what is incomplete and
    can be resumed, 130 where it was interrupted.
    """
    for stream in (sys.stdout, sys.stderr):  # names and units are not ASCII
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(encoding="utf-8", errors="replace")
    options = _parser().parse_args(arguments)
    with warnings.catch_warnings():
        warnings.showwarning = lambda message, *_, **__: _say("warning:", str(message))
        try:
            return int(options.action(options))
        except KeyboardInterrupt as stopped:
            _say("interrupted.", _resumable(options))
            return INCOMPLETE if isinstance(stopped, _Terminated) else INTERRUPTED
        except (ImpactLabError, OSError) as error:
            if options.verbose:
                traceback.print_exc()
            _say("error:", str(error))
            if isinstance(error, InvalidInput):
                return USAGE
            kept = _resumable(options)
            if kept:
                _say(kept)
            return INCOMPLETE if kept else FAILED


def _parser() -> argparse.ArgumentParser:
    style: dict[str, Any] = {"epilog": _CODES, "formatter_class": argparse.RawDescriptionHelpFormatter}
    text = "Studies of networks of oscillators that collide."
    parser = argparse.ArgumentParser(prog="impactlab", description=text, **style)
    parser.add_argument("--version", action="version", version=f"impactlab {impactlab.__version__}")
    parser.set_defaults(verbose=False, quiet=False, out=None)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    def command(name: str, action: Any, text: str) -> argparse.ArgumentParser:
        added = commands.add_parser(name, help=text, description=text, **style)
        added.set_defaults(action=action)
        return added

    def common(added: argparse.ArgumentParser) -> None:
        added.add_argument("--json", action="store_true", help="claims, checks and files as JSON on stdout")
        volume = added.add_mutually_exclusive_group()
        volume.add_argument("-q", "--quiet", action="store_true", help="only errors and, with --json, the JSON")
        volume.add_argument("-v", "--verbose", action="store_true", help="each simulation, and tracebacks")

    command("list", _list, "list the studies that can be run")
    run = command("run", _run, "run a study")
    run.add_argument("study", metavar="STUDY_OR_TOML", help="name of a study, or a .toml file that configures one")
    run.add_argument("--set", metavar="KEY=VALUE", action="append", default=[], help="change a setting (value in TOML)")
    run.add_argument("--quick", action="store_true", help="the study's smoke form")
    run.add_argument("--out", metavar="FOLDER", help="folder for the results (default: results/STUDY)")
    run.add_argument("--dry-run", action="store_true", help="say what would be simulated, and stop")
    run.add_argument("--workers", type=int, metavar="N", help="number of threads (default: one per core)")
    common(run)
    resume = command("resume", _resume, "continue a run that was stopped")
    resume.add_argument("out", metavar="FOLDER")
    resume.add_argument("--workers", type=int, metavar="N", help="number of threads (default: one per core)")
    common(resume)
    report = command("report", _report, "judge and draw the result in a folder again, without simulating")
    report.add_argument("out", metavar="FOLDER")
    common(report)
    command("plugins", _plugins, "list the installed distributions that offer studies, and those that fail")
    command("doctor", _doctor, "check this installation")
    return parser


def _list(_: argparse.Namespace) -> int:
    from impactlab.studies.discovery import plugins

    found = plugins()
    width = max((len(plugin.name) for plugin in found), default=0)
    for plugin in found:
        if plugin.study is not None:
            print(f"{plugin.name:{width}}  {plugin.study.title}")
        else:
            _say(f"the study {plugin.name!r} of {plugin.distribution} cannot be used: {plugin.problem}")
    if not found:
        _say("no study is installed.")
    return DONE


def _plugins(_: argparse.Namespace) -> int:
    from impactlab.studies.discovery import plugins

    found = plugins()
    for plugin in found:
        print(f"{plugin.name}  {plugin.distribution}  {plugin.problem or 'ok'}")
    return USAGE if any(plugin.problem for plugin in found) else DONE


def _run(options: argparse.Namespace) -> int:
    from impactlab.studies.discovery import make_study, parse_setting
    from impactlab.studies.simulations import checked_workers, simulations

    checked_workers(options.workers)
    study = make_study(options.study, quick=options.quick)
    settings = dict(parse_setting(text, study) for text in options.set)
    study = make_study(study, settings)
    options.out = options.out or str(Path("results", study.name))
    if options.dry_run:
        return _dry_run(study, simulations(study).items, options.json)
    return _execute(study, options)


def _resume(options: argparse.Namespace) -> int:
    from impactlab.studies.discovery import make_study
    from impactlab.studies.run_folder import Folder

    manifest = Folder(options.out).manifest()
    if manifest["complete"]:
        if not options.quiet:
            _say(f"the run in {options.out} is complete.")
        return DONE if manifest.get("passed", True) else FAILED
    return _execute(make_study(manifest["study"], manifest["settings"]), options)


def _execute(study: Study, options: argparse.Namespace) -> int:
    from impactlab.studies.running import run_study

    progress = not options.quiet and (options.verbose or sys.stderr.isatty())
    with _stoppable():
        result = run_study(study, out=options.out, workers=options.workers, progress=progress)
    return _finish(result, options)


def _report(options: argparse.Namespace) -> int:
    from impactlab.studies.report import republish
    from impactlab.studies.run_folder import Folder

    return _finish(republish(Folder(options.out)), options)


def _finish(result: StudyResult, options: argparse.Namespace) -> int:
    """Say what was found and where it is."""
    from impactlab.studies.report import claim_rows, summary
    from impactlab.studies.run_folder import REPORT, Folder

    if options.json:
        manifest = Folder(options.out).manifest()
        print(json.dumps({**manifest, "folder": options.out, "claims": claim_rows(result.claims)}, indent=2))
    elif not options.quiet:
        for row in claim_rows(result.claims):
            print(f"{row['section']:5} {row['verdict']:15} {row['statement']}\n{'':21} {row['measured']}")
    for check in result.checks:
        if not check.ok or options.verbose:
            _say(f"check {'passed' if check.ok else 'failed'}: {check.name}: {check.detail}")
    if not options.quiet:
        _say(summary(result))
        _say(f"the report is {Path(options.out, REPORT)}")
    return DONE if result.passed else FAILED


def _dry_run(study: Study, items: list[Item], as_json: bool) -> int:
    """Print what would be simulated."""
    rows = [
        {
            "item": item.key,
            "bodies": len(item.network.oscillators),
            "contacts": len(item.network.contacts),
            "realizations": item.options.get("realizations", 1),
            "duration": item.options["duration"],
        }
        for item in items
    ]
    if as_json:
        print(json.dumps({"study": study.name, "settings": study.settings(), "items": rows}, indent=2))
        return DONE
    width = max((len(item.key) for item in items), default=4)
    print(f"{'item':{width}} {'bodies':>7} {'contacts':>9} {'realizations':>13} {'duration (s)':>13}")
    for row in rows:
        print("{item:{width}} {bodies:7} {contacts:9} {realizations:13} {duration:13g}".format(**row, width=width))
    return DONE


def _doctor(_: argparse.Namespace) -> int:
    """Print what this installation is, and whether a compiled network runs."""
    import os
    import time

    from impactlab.kernels.jit import cache_folder
    from impactlab.machine import cores
    from impactlab.studies.run_folder import versions

    for name, version in versions().items():
        print(f"{name:12} {version}")
    print(f"{'cores':12} {cores()}")
    folder = cache_folder()
    print(f"{'cache':12} {folder} ({'writable' if os.access(folder, os.W_OK) else 'not writable'})")
    begin = time.perf_counter()
    body = impactlab.LinearOscillator(stiffness=1.0, damping=1.0)
    network = impactlab.chain(2, body, impactlab.HertzContact(10.0), excitation=impactlab.WhiteNoise(1.0))
    impactlab.simulate(network, 30.0, realizations=64, rng=1)
    print(f"{'simulation':12} works ({time.perf_counter() - begin:.2f} s with compilation or its cache)")
    return DONE


class _Terminated(KeyboardInterrupt):
    """A request to terminate; no `except Exception` keeps it, as it would an error."""


@contextlib.contextmanager
def _stoppable() -> Iterator[None]:
    """Let a request to terminate stop the run in order, as Ctrl-C does."""

    def stop(*_: Any) -> None:
        raise _Terminated

    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _resumable(options: argparse.Namespace) -> str:
    """Return what is kept of a run that was stopped and how to go on, nothing if there is no such run."""
    from impactlab.studies.run_folder import ITEMS, Folder

    try:
        if Folder(options.out).manifest()["complete"]:
            return ""
    except (InvalidInput, TypeError):  # no folder was named, or it was not taken yet
        return ""
    saved = len(list(Path(options.out, ITEMS).glob("*.nc")))
    return f"{saved} simulation(s) are kept; continue with: impactlab resume {options.out}"


def _say(*parts: str) -> None:
    print("impactlab:", *parts, file=sys.stderr)


if __name__ == "__main__":
    sys.exit(main())
