"""Formulas of scalars as text, compiled to be evaluated at many points."""

from __future__ import annotations

import ast
import hashlib
import linecache
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from impactlab.compiling.build import build
from impactlab.compiling.inlining import Inliner
from impactlab.compiling.kernel_text import parsed
from impactlab.errors import InvalidInput

_HEAD = '''"""A formula of scalars, evaluated at many points."""

import math

import numpy as np
from numba import f8, void

from impactlab.compiling.jit import loop
from impactlab.compiling.scalars import scalar
'''

_LOOP = '''

def evaluate(columns, numbers, result):
    """Write the formula at some points of each member, from numbers at the points and those of the member."""
    for member in range(result.shape[0]):
        for point in range(result.shape[1]):
            result[member, point] = {name}({arguments})


evaluate = loop(void(f8[:, :, ::1], f8[:, ::1], f8[:, ::1]), evaluate, True)
'''

COLUMN, NUMBER = "columns[{}, member, point]", "numbers[member, {}]"
"""Where an argument comes from: numbers that vary from point to point, and those of a member."""

Evaluate = Callable[[Any, Any, Any], None]


def formula_text(function: Any, name: str) -> str:
    """Return the text of a formula under a name, with the functions that it calls, or refuse it with file and line."""
    texts: dict[str, str] = {}
    Inliner(name, texts, {name}, []).inline(function, name)
    return "\n\n\n".join(texts.values())


def evaluator(text: str, name: str, sources: Sequence[str]) -> Evaluate:
    """Return the compiled loop that evaluates a formula, whose arguments come from some `sources`.

    It takes columns, [column, member, point], and numbers, [member, number], and writes [member, point].
    """
    parts = "".join(f"\n\n@scalar\n{part}\n" for part in text.split("\n\n\n"))
    module = build(_HEAD + parts + _LOOP.format(name=name, arguments=", ".join(sources)))
    evaluate: Evaluate = module.evaluate
    return evaluate


def formula_of(text: str, name: str, owner: str) -> Callable[..., float]:
    """Return the function of a name in the text of a formula, which `formula_text` has made; refuse any other text.

    The text may define functions and nothing else; whoever looks at their texts sees those here.
    """
    try:
        nodes = parsed(text).body
    except SyntaxError as error:
        raise InvalidInput(f"{owner} has a kernel that is no text of a function: {error}.") from error
    plain = [
        isinstance(node, ast.FunctionDef)
        and not (node.decorator_list or node.args.defaults or node.args.kw_defaults or node.returns)
        and not any(argument.annotation for argument in node.args.args)
        for node in nodes
    ]
    if not all(plain) or not nodes or nodes[-1].name != name:  # type: ignore[attr-defined]
        raise InvalidInput(f"{owner} has a kernel that is not the text of plain functions, the last of them {name!r}.")
    file = f"<formula {hashlib.sha256(text.encode()).hexdigest()[:12]}>"
    linecache.cache[file] = len(text), None, [f"{line}\n" for line in text.split("\n")], file
    known: dict[str, Any] = {"math": math, "np": np}
    exec(compile(text, file, "exec"), known)  # which defines functions, and calls none
    function: Callable[..., float] = known[name]
    return function
