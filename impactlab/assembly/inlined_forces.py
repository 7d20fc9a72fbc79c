"""The forces of a network as a part of what calls them, from the text of its module for blocks of one lane."""

from __future__ import annotations

import ast

_LEFT_OUT = "timetable", "accepting", "reading"
"""Decorators of functions that are no forces."""


def inlined_forces(text: str) -> str:
    """Return the text of a module whose function ``forces`` is a kernel, as are the kernels that it calls."""
    tree = ast.parse(text)
    body: list[ast.stmt] = []
    for node in tree.body:
        if isinstance(node, ast.FunctionDef):
            name = _name(node.decorator_list[0])
            if name in _LEFT_OUT:
                continue
            if name == "pointer":
                node.decorator_list = [ast.Name("kernel", ast.Load())]
        elif isinstance(node, ast.ImportFrom) and node.module == "impactlab.kernels.jit":
            node.names = [ast.alias("kernel")]
        elif isinstance(node, ast.Assign) and _name(node.value) == "resident":
            continue
        body.append(node)
    tree.body = body
    return ast.unparse(ast.fix_missing_locations(tree)) + "\n"


def _name(node: ast.expr) -> str:
    """Return the name of a function, or of what is called."""
    function = node.func if isinstance(node, ast.Call) else node
    return function.id if isinstance(function, ast.Name) else ""
