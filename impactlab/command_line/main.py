"""The commands and what becomes of their errors: results on stdout, everything else on stderr."""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
import traceback
import warnings
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import impactlab
from impactlab.command_line import installation, network_commands, new_command, run_commands, study_commands
from impactlab.command_line.engines import Served
from impactlab.command_line.output import CLOSED, DONE, FAILED, INCOMPLETE, INTERRUPTED, USAGE, say
from impactlab.command_line.run_commands import Terminated, resumable
from impactlab.errors import ImpactLabError, InvalidInput

_CODES = """exit codes:
  0 done   1 done, but checks failed or realizations diverged
  2 usage, configuration or plugin
  3 incomplete, can be resumed   130 interrupted, can be resumed"""

_NEXT = """impactlab {version}: networks of oscillators that collide

run a study            impactlab list                   what can be run
                       impactlab show two-system        its settings, and what it makes
                       impactlab run two-system --quick
simulate a network     impactlab simulate NETWORK.toml --duration 100 --realizations 64 -o result.nc
                       impactlab plot result.nc
your own study         impactlab new my-study           writes a package that runs at once
all commands           impactlab --help                 and impactlab COMMAND --help
your installation      impactlab doctor

In Python: import impactlab as il"""


SHELLS = ("bash", "zsh", "fish")


class PrintCompletion(argparse.Action):
    """Prints the script that completes commands, their options, files and folders, and ends."""

    def __call__(self, parser: argparse.ArgumentParser, _: argparse.Namespace, shell: Any, option: Any = None) -> None:
        try:
            import shtab
        except ImportError:
            parser.error(f"{option} needs the package shtab: python -m pip install shtab")
        for action in _actions(parser):
            metavar = str(action.metavar)
            if "." in metavar or "TOML" in metavar:
                action.complete = shtab.FILE  # type: ignore[attr-defined]
            elif metavar == "FOLDER":
                action.complete = shtab.DIRECTORY  # type: ignore[attr-defined]
        print(shtab.complete(parser, shell))
        parser.exit()


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """Give the arguments of a parser and of its commands."""
    for action in parser._actions:
        yield action
        for command in action.choices.values() if isinstance(action.choices, dict) else ():
            yield from _actions(command)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line, by default with the arguments of the process, and return the exit code.

    It is 0 where all is done, 1 where checks failed or realizations diverged, 2 for usage, configuration or plugin, 3
    for what is incomplete and can be resumed, 130 where it was interrupted, 141 where nobody reads on.
    """
    for stream in (sys.stdout, sys.stderr):  # names and units are not ASCII
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(encoding="utf-8", errors="replace")
    try:
        try:
            return _run(parser().parse_args(arguments))
        finally:
            sys.stdout.flush()
    except BrokenPipeError:
        with contextlib.suppress(OSError), open(os.devnull, "w") as nowhere:  # for what Python writes at its end
            os.dup2(nowhere.fileno(), sys.stdout.fileno())
        return CLOSED


def _run(options: argparse.Namespace) -> int:
    """Run a command, and say in a line what went wrong."""
    with warnings.catch_warnings():
        warnings.showwarning = lambda message, *_, **__: say("warning:", str(message))
        try:
            return int(options.action(options))
        except KeyboardInterrupt as stopped:
            say("interrupted.", resumable(options))
            return INCOMPLETE if isinstance(stopped, Terminated) else INTERRUPTED
        except BrokenPipeError:
            raise
        except Served:
            return DONE
        except (ImpactLabError, OSError) as error:
            if options.verbose:
                traceback.print_exc()
            say("error:", str(error))
            if isinstance(error, InvalidInput):
                return USAGE
            kept = resumable(options)
            if kept:
                say(kept)
            return INCOMPLETE if kept else FAILED


def parser() -> argparse.ArgumentParser:
    """Return the parser of all commands."""
    style: dict[str, Any] = {"epilog": _CODES, "formatter_class": argparse.RawDescriptionHelpFormatter}
    text = "Networks of oscillators that collide, and studies of them."
    parser = argparse.ArgumentParser(prog="impactlab", description=text, **style)
    parser.add_argument("--version", action="version", version=f"impactlab {impactlab.__version__}")
    parser.add_argument("--print-completion", action=PrintCompletion, choices=SHELLS, metavar="SHELL",
                        help="print the script that completes commands in bash, zsh or fish (needs shtab)")  # fmt: skip
    parser.set_defaults(action=_what_next, verbose=False, quiet=False, folder=None)
    commands = parser.add_subparsers(metavar="COMMAND")

    def command(name: str, action: Callable[[argparse.Namespace], int], text: str) -> argparse.ArgumentParser:
        added = commands.add_parser(name, help=text, description=f"{text[0].upper()}{text[1:]}.", **style)
        added.set_defaults(action=action)
        return added

    for family in (study_commands, run_commands, new_command, network_commands, installation):
        family.add_commands(command)
    return parser


def _what_next(_: argparse.Namespace) -> int:
    print(_NEXT.format(version=impactlab.__version__))
    return DONE
