"""The forces of a network as a part of what calls them, from the text of its module for blocks of one lane."""

from __future__ import annotations

import ast
from functools import cache
from typing import Any

from impactlab.compiling.kernel_text import parsed

_LEFT_OUT = "timetable", "accepting", "reading"
"""Decorators of functions that are no forces."""

CHOICE = "gap - gap if gap <= 0.0 else "
"""Text of loops over contacts before the force: 0 where a contact is open, NaN where its gap is not finite."""


class _WhereClosed(ast.NodeTransformer):
    """Evaluates the force of a contact only where it is closed, in the loops of `forces` over contacts.

    They end ``forces_of[member] = gap - gap if gap <= 0.0 else force``; see `impactlab.assembly.loops`.

    Vectors need both. One lane would wait for roots of a force that it does not feel, which takes a fifth of a step.
    """

    def visit_For(self, node: ast.For) -> ast.For:
        self.generic_visit(node)
        *lines, last = node.body
        if not (isinstance(last, ast.Assign) and ast.unparse(last).startswith(f"forces_of[member] = {CHOICE}")):
            return node
        choice: Any = last.value
        force = ast.unparse(choice.orelse)
        found = [item for item in lines if isinstance(item, ast.Assign) and ast.unparse(item.targets[0]) == force]
        if len(found) == 1:
            lines.remove(found[0])
            closed = ast.Call(ast.Name("seldom", ast.Load()), [ast.UnaryOp(ast.Not(), choice.test)], [])
            here, there = (ast.Assign(last.targets, value) for value in (choice.orelse, choice.body))
            node.body = [*lines, ast.If(closed, [found[0], here], [there])]
        return node


@cache
def inlined_forces(text: str) -> str:
    """Return the text of a module whose function ``forces`` is a kernel, as are the kernels that it calls."""
    tree = parsed(text)
    body: list[ast.stmt] = []
    for node in tree.body:
        if isinstance(node, ast.FunctionDef):
            name = _name(node.decorator_list[0])
            if name in _LEFT_OUT:
                continue
            if name == "pointer":
                node.decorator_list = [ast.Name("kernel", ast.Load())]
        elif isinstance(node, ast.ImportFrom) and node.module == "impactlab.compiling.force_type":
            node.module, node.names = "impactlab.compiling.jit", [ast.alias("kernel")]
        elif isinstance(node, ast.Assign) and _name(node.value) == "resident":
            continue
        body.append(node)
    tree.body = [*parsed("from impactlab.compiling.intrinsics import seldom").body, *body]
    _WhereClosed().visit(next(node for node in body if isinstance(node, ast.FunctionDef) and node.name == "forces"))
    return ast.unparse(ast.fix_missing_locations(tree)) + "\n"


def _name(node: ast.expr) -> str:
    """Return the name of a function, or of what is called."""
    function = node.func if isinstance(node, ast.Call) else node
    return function.id if isinstance(function, ast.Name) else ""
