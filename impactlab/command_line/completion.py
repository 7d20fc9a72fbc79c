"""Completion of commands in a shell, written by the package shtab."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import Any

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
