"""Formulas of scalars as text, compiled to be evaluated at many points."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from impactlab.compiling.build import build
from impactlab.compiling.inlining import Inliner

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
