"""Kernels for blocks of one lane, from the text of those for many.

A block of one lane has arrays without an axis of lanes, and no loops over them: the loops
over bodies are then innermost and vectorise. Each kernel is written once, for lanes; here its
text loses the loops over ``lane`` and the index of that name, and what it calls loses them too.
"""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Callable
from functools import cache
from typing import Any

from impactlab.compiling.jit import Function, maker
from impactlab.compiling.kernel_text import parsed

_TYPES = "ACCEPT", "FORCES", "PEAKS"
"""Types of functions that generated modules import; those of functions over blocks of one lane end in _OF_ONE."""


def _is_lane(node: ast.AST) -> bool:
    return isinstance(node, ast.Name) and node.id == "lane"


class _WithoutLanes(ast.NodeTransformer):
    """Drops loops over lanes and a last index that is the lane; elsewhere the lane is the first."""

    def visit_For(self, node: ast.For) -> Any:
        self.generic_visit(node)
        return node.body if _is_lane(node.target) else node

    def visit_Subscript(self, node: ast.Subscript) -> ast.AST:
        index = node.slice
        if isinstance(index, ast.Tuple) and _is_lane(index.elts[-1]):
            del index.elts[-1]
            node.slice = index.elts[0] if len(index.elts) == 1 else index
        self.generic_visit(node)
        return node

    def visit_Name(self, node: ast.Name) -> ast.AST:
        return ast.Constant(0) if _is_lane(node) and isinstance(node.ctx, ast.Load) else node


_OF_BLOCKS = "impactlab.kernels.kick", "impactlab.kernels.combinations", "impactlab.kernels.memory"
"""Modules with kernels that a generated module calls."""

_NOT_OF_BLOCKS = *_TYPES, "accepting"
"""Other names that a generated module imports from these modules."""


@cache
def single_text(text: str) -> str:
    """Return the text of a generated module for blocks of one lane."""
    tree = _WithoutLanes().visit(parsed(text))
    body = tree.body
    for place, node in enumerate(body):
        if not isinstance(node, ast.ImportFrom):
            continue
        if node.module in ("impactlab.compiling.force_type", "impactlab.kernels.memory", "impactlab.kernels.peaks"):
            node.names = [
                ast.alias(f"{item.name}_OF_ONE", item.name) if item.name in _TYPES else item for item in node.names
            ]
        if node.module in _OF_BLOCKS:
            names = [item.name for item in node.names if (item.asname or item.name) not in _NOT_OF_BLOCKS]
            singles = [f"{name} = single({name})" for name in names]
            lines = ["from impactlab.compiling.single import single", *singles]
            body[place + 1 : place + 1] = parsed("\n".join(lines)).body
    return ast.unparse(ast.fix_missing_locations(tree)) + "\n"


_instead: dict[Function, Function] = {}


def instead_of(compiled: Function) -> Callable[[Function], Function]:
    """Take the text for blocks of one lane from another function, which has loops over lanes as well."""

    def decorate(function: Function) -> Function:
        _instead[compiled] = function
        return function

    return decorate


@cache
def single(compiled: Function) -> Function:
    """Return a kernel for blocks of one lane."""
    make = maker(compiled)
    assert make is not None
    return make(without_lanes(_instead.get(compiled, compiled)))


def without_lanes(function: Function) -> Function:
    """Return a function over blocks for blocks of one lane, as the kernels that it calls; not compiled."""
    plain: Any = getattr(function, "py_func", function)
    tree: Any = _WithoutLanes().visit(parsed(textwrap.dedent(inspect.getsource(plain))))
    definition = tree.body[0]
    definition.decorator_list, definition.name = [], f"{plain.__name__}_single"
    ast.fix_missing_locations(ast.increment_lineno(tree, plain.__code__.co_firstlineno - 1))
    names = dict(plain.__globals__)
    for name in plain.__code__.co_names:
        if maker(names.get(name)):
            names[name] = single(names[name])
    exec(compile(tree, plain.__code__.co_filename, "exec"), names)
    return names[definition.name]  # type: ignore[no-any-return]


@cache
def text_of(function: Function, single: bool) -> Function:
    """Return a function that is not compiled, from the same text for blocks and for blocks of one lane."""
    return without_lanes(function) if single else getattr(function, "py_func", function)
