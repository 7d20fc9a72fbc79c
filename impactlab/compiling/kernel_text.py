"""The text of a function as a syntax tree; that of a kernel, a function of scalars, or refused with file and line."""

from __future__ import annotations

import ast
import inspect
import textwrap
import threading
import types
from typing import NoReturn

from impactlab.errors import InvalidInput

_ONE_AT_A_TIME = threading.Lock()


def parsed(text: str) -> ast.Module:
    """Return the syntax tree of a text.

    Threads that parse at once share a counter in CPython 3.11, and one of them may get a `SystemError` for a text that
    is right.
    """
    with _ONE_AT_A_TIME:
        return ast.parse(text)


_STATEMENTS = (
    ast.Return, ast.Assign, ast.AugAssign, ast.AnnAssign, ast.If, ast.For, ast.While, ast.Break, ast.Continue, ast.Pass,
)  # fmt: skip
_EXPRESSIONS = (
    ast.Name, ast.Constant, ast.BinOp, ast.UnaryOp, ast.BoolOp, ast.Compare, ast.IfExp, ast.Call, ast.Attribute,
    ast.Subscript, ast.Slice, ast.Tuple,
)  # fmt: skip

_WHY = {
    ast.Expr: "a statement without a result: compiled code prints and changes nothing",
    ast.Raise: "an exception (return math.nan where a law is not defined)",
    ast.Assert: "an exception (return math.nan where a law is not defined)",
    ast.Try: "an exception",
    ast.FunctionDef: "a function in a function (define it beside the kernel)",
    ast.Lambda: "a function in a function (define it beside the kernel)",
    ast.List: "a list (a table is a field that is a tuple of numbers)",
    ast.Dict: "a dictionary (a table is a field that is a tuple of numbers)",
    ast.JoinedStr: "text",
    ast.Constant: "no number",
    ast.Global: "a variable that outlives the call",
    ast.Nonlocal: "a variable that outlives the call",
}
"""What is refused: else it is that which is no formula of scalars."""


def refuse(function: types.FunctionType, node: ast.AST, problem: str) -> NoReturn:
    """Refuse a kernel for a node of its syntax tree, in one line with file and line."""
    code = function.__code__
    line = code.co_firstlineno + getattr(node, "lineno", 1) - 1
    raise InvalidInput(
        f"{code.co_filename}:{line}: the kernel {function.__qualname__} {problem}. A kernel is a formula of scalars: "
        "it may use its arguments, arithmetic, if, for, while, numbers and functions of its module, math and numpy."
    )


def look_at(function: types.FunctionType) -> None:
    """Refuse statements and expressions that are no part of a formula of scalars, if the text can be found."""
    if isinstance(found := _found(function), ast.FunctionDef):
        _check(function, found)


def definition_of(function: types.FunctionType) -> ast.FunctionDef:
    """Return the syntax tree of a kernel, or of a function that it calls; refuse one that is no formula of scalars.

    The names that it reads are not looked at.
    """
    if isinstance(found := _found(function), str):
        raise InvalidInput(found)
    _check(function, found)
    return found


def _found(function: types.FunctionType) -> ast.FunctionDef | str:
    """Return the syntax tree of a function, or why there is none."""
    name = function.__qualname__
    if hasattr(function, "__wrapped__"):
        return f"The kernel {name} has a decorator, which cannot be compiled; write the whole formula in the function."
    try:
        source = textwrap.dedent(inspect.getsource(function))
    except (OSError, TypeError):
        return f"The source of the kernel {name} cannot be found; define it in a file, a script or a notebook."
    for node in ast.walk(parsed(source)):
        if isinstance(node, ast.FunctionDef) and node.name == function.__name__:
            return node
    return f"The kernel {name} must be written as a function with def."


def _check(function: types.FunctionType, definition: ast.FunctionDef) -> None:
    """Refuse statements and expressions that compiled code cannot have, or that call the interpreter."""
    others = [*definition.args.kwonlyargs, definition.args.vararg, definition.args.kwarg]
    if any(others):
        refuse(function, definition, "takes arguments that are not plain ones")
    body = definition.body[ast.get_docstring(definition) is not None :]
    for node in (inner for statement in (*body, *definition.args.defaults) for inner in ast.walk(statement)):
        if isinstance(node, ast.stmt):
            allowed = isinstance(node, _STATEMENTS)
        elif isinstance(node, ast.Constant):
            allowed = type(node.value) in (bool, int, float)
        elif isinstance(node, ast.expr):
            allowed = isinstance(node, _EXPRESSIONS)
        else:
            allowed = not isinstance(node, ast.MatMult | ast.Is | ast.IsNot)
        if not allowed:
            where = node if hasattr(node, "lineno") else definition
            text = ast.unparse(node).partition("\n")[0] if hasattr(node, "lineno") else type(node).__name__
            refuse(function, where, f"has {text!r}, which is {_WHY.get(type(node), 'no formula of scalars')}")
