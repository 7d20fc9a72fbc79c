"""Commands that run studies, go on with runs that were stopped, and report on them."""

from __future__ import annotations

import argparse
import contextlib
import json
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from impactlab.command_line.engines import add_engines, engine
from impactlab.command_line.output import DONE, FAILED, Command, say
from impactlab.errors import InvalidInput

if TYPE_CHECKING:
    from impactlab.studies import Item, Study, StudyResult


def add_commands(command: Command) -> None:
    """Add the commands of this family."""
    run = command("run", _run, "run a study")
    run.add_argument("study", metavar="STUDY_OR_TOML", help="name of a study, or a .toml file that configures one")
    run.add_argument("--set", metavar="KEY=VALUE", action="append", default=[], help="change a setting (value in TOML)")
    run.add_argument("--quick", action="store_true", help="the study's smoke form")
    run.add_argument("--out", dest="folder", metavar="FOLDER", help="folder for results (default: results/STUDY)")
    run.add_argument("--dry-run", action="store_true", help="say what would be simulated, and stop")
    add_engines(run)
    resume = command("resume", _resume, "continue a run that was stopped")
    resume.add_argument("folder", metavar="FOLDER")
    add_engines(resume)
    report = command("report", _report, "judge and draw the result in a folder again, without simulating")
    report.add_argument("folder", metavar="FOLDER")
    for added in (run, resume, report):
        added.add_argument("--json", action="store_true", help="claims, checks and files as JSON on stdout")
        volume = added.add_mutually_exclusive_group()
        volume.add_argument("-q", "--quiet", action="store_true", help="only errors and, with --json, the JSON")
        volume.add_argument("-v", "--verbose", action="store_true", help="each simulation, and tracebacks")


def _run(options: argparse.Namespace) -> int:
    from impactlab.studies.discovery import make_study, parse_setting
    from impactlab.studies.simulations import checked_workers, simulations

    checked_workers(options.workers)
    study = make_study(options.study, quick=options.quick)
    settings = dict(parse_setting(text, study) for text in options.set)
    study = make_study(study, settings)
    options.folder = options.folder or str(Path("results", study.name))
    if options.dry_run:
        return _dry_run(study, simulations(study).items, options.json)
    return _execute(study, options)


def _resume(options: argparse.Namespace) -> int:
    from impactlab.studies.discovery import make_study
    from impactlab.studies.run_folder import Folder

    manifest = Folder(options.folder).manifest()
    if manifest["complete"]:
        if not options.quiet:
            say(f"the run in {options.folder} is complete.")
        return DONE if manifest.get("passed", True) else FAILED
    return _execute(make_study(manifest["study"], manifest["settings"]), options)


def _execute(study: Study, options: argparse.Namespace) -> int:
    from impactlab.studies.running import run_study

    progress = not options.quiet and (options.verbose or sys.stderr.isatty())
    with _stoppable(), engine(options) as executor:
        result = run_study(study, out=options.folder, workers=options.workers, executor=executor, progress=progress)
    return _finish(result, options)


def _report(options: argparse.Namespace) -> int:
    from impactlab.studies.report import republish
    from impactlab.studies.run_folder import Folder

    return _finish(republish(Folder(options.folder)), options)


def _finish(result: StudyResult, options: argparse.Namespace) -> int:
    """Say what was found and where it is."""
    from impactlab.studies.report_page import claim_rows, summary
    from impactlab.studies.run_folder import REPORT, Folder

    if options.json:
        manifest = Folder(options.folder).manifest()
        print(json.dumps({**manifest, "folder": options.folder, "claims": claim_rows(result.claims)}, indent=2))
    elif not options.quiet:
        for row in claim_rows(result.claims):
            print(f"{row['section']:5} {row['verdict']:15} {row['statement']}\n{'':21} {row['measured']}")
    for check in result.checks:
        if not check.ok or options.verbose:
            say(f"check {'passed' if check.ok else 'failed'}: {check.name}: {check.detail}")
    if not options.quiet:
        say(summary(result))
        say(f"the report is {Path(options.folder, REPORT)}")
    return DONE if result.passed else FAILED


def _dry_run(study: Study, items: list[Item], as_json: bool) -> int:
    """Print what would be simulated."""
    rows = [
        {
            "item": item.key,
            "bodies": len(item.network.oscillators),
            "contacts": len(item.network.contacts),
            "realizations": item.options.get("realizations", 1),
            "duration": item.options.get("duration"),  # as long as a tolerance needs, where there is none
        }
        for item in items
    ]
    if as_json:
        print(json.dumps({"study": study.name, "settings": study.settings(), "items": rows}, indent=2))
        return DONE
    width = max((len(item.key) for item in items), default=4)
    print(f"{'item':{width}} {'bodies':>7} {'contacts':>9} {'realizations':>13} {'duration (s)':>13}")
    for row in rows:
        duration = "any" if row["duration"] is None else f"{row['duration']:g}"
        print("{item:{width}} {bodies:7} {contacts:9} {realizations:13}".format(**row, width=width), f"{duration:>13}")
    return DONE


class Terminated(KeyboardInterrupt):
    """A request to terminate; no `except Exception` keeps it, as it would an error."""


@contextlib.contextmanager
def _stoppable() -> Iterator[None]:
    """Let a request to terminate stop the run in order, as Ctrl-C does."""

    def stop(*_: Any) -> None:
        raise Terminated

    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def resumable(options: argparse.Namespace) -> str:
    """Return what is kept of a run that was stopped and how to go on, nothing if there is no such run."""
    if checkpoint := getattr(options, "checkpoint", None):
        return f"what is finished is kept in {checkpoint}; the same command goes on."

    from impactlab.results.checkpoint import ITEM, ITEMS
    from impactlab.studies.run_folder import Folder

    try:
        if Folder(options.folder).manifest()["complete"]:
            return ""
    except (InvalidInput, TypeError):  # no folder was named, or it was not taken yet
        return ""
    saved = len(list(Path(options.folder, ITEMS).glob(f"*{ITEM}")))
    return f"{saved} simulation(s) are kept; continue with: impactlab resume {options.folder}"
