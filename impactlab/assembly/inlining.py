"""Copies of kernels as text, in which every name that they read is resolved, or refused with file and line."""

from __future__ import annotations

import ast
import builtins
import inspect
import itertools
import math
import textwrap
import types
from collections import ChainMap
from collections.abc import Collection, Mapping
from typing import Any, NamedTuple

import numpy as np

from impactlab.errors import InvalidInput
from impactlab.kernels.parsing import parsed

_MODULES = {math: "math", np: "np"}


def free_name(name: str, taken: Collection[str]) -> str:
    """Return the name, numbered if it is taken."""
    numbered = (f"{name}_{number}" for number in itertools.count(2))
    return next(item for item in itertools.chain([name], numbered) if item not in taken)


class Read(NamedTuple):
    """A name that a kernel read from outside, and what it was."""

    function: Any
    name: str
    attribute: str  # of a module of that name, or nothing
    value: Any

    @property
    def holds(self) -> bool:
        """Whether it still is the same."""
        found = _outside(self.function).get(self.name)
        return (getattr(found, self.attribute, None) if self.attribute else found) is self.value


def _outside(function: Any) -> Mapping[str, Any]:
    """Return what a function reads beside its arguments and variables, by name."""
    cells = zip(function.__code__.co_freevars, function.__closure__ or (), strict=True)
    return ChainMap({name: cell.cell_contents for name, cell in cells}, function.__globals__, vars(builtins))


class Inliner:
    """Copies a function and what it calls, with every name it reads resolved."""

    def __init__(self, prefix: str, texts: dict[str, str], taken: set[str], reads: list[Read]) -> None:
        self.prefix = prefix
        self.texts = texts
        self.taken = taken
        self.reads = reads
        self.done: dict[Any, str] = {}

    def inline(self, function: Any, name: str) -> None:
        """Add the text of a function under a name, and those of all that it calls."""
        function = getattr(function, "py_func", function)
        self.done[function] = name
        self.taken.add(name)
        definition = _definition(function)
        definition.name = name
        definition.decorator_list = []
        definition.returns = None
        for argument in definition.args.args:
            argument.annotation = None
        if ast.get_docstring(definition) is not None:
            definition.body = definition.body[1:] or [ast.Pass()]
        local = {argument.arg for argument in definition.args.args}
        local |= {
            node.id for node in ast.walk(definition) if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
        }
        resolved = _Resolve(self, function, local).visit(definition)
        self.texts[name] = ast.unparse(ast.fix_missing_locations(resolved))


class _Resolve(ast.NodeTransformer):
    """Replaces the names that a function reads from its module."""

    def __init__(self, inliner: Inliner, function: types.FunctionType, local: set[str]) -> None:
        self.inliner = inliner
        self.function = function
        self.local = local
        self.outside = _outside(function)

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        owner = node.value
        if isinstance(owner, ast.Name) and owner.id not in self.local:
            value = self.outside.get(owner.id)
            if isinstance(value, types.ModuleType) and value in _MODULES:
                self.inliner.reads.append(Read(self.function, owner.id, "", value))
                return self._public(node, _MODULES[value], node.attr)
            if isinstance(value, types.ModuleType) and hasattr(value, node.attr):
                found = getattr(value, node.attr)
                self.inliner.reads.append(Read(self.function, owner.id, node.attr, found))
                return self._resolved(node, f"{owner.id}.{node.attr}", found)
        self.generic_visit(node)
        return node

    def visit_Name(self, node: ast.Name) -> ast.AST:
        if not isinstance(node.ctx, ast.Load) or node.id in self.local:
            return node
        if node.id not in self.outside:
            self._refuse(node, node.id, "is not defined")
        value = self.outside[node.id]
        self.inliner.reads.append(Read(self.function, node.id, "", value))
        return self._resolved(node, node.id, value)

    def _resolved(self, node: ast.expr, name: str, value: Any) -> ast.AST:
        if isinstance(value, bool | int | float | np.bool_ | np.integer | np.floating):
            return _literal(value.item() if isinstance(value, np.generic) else value)
        if getattr(builtins, name, None) is value:
            return node
        for module, alias in _MODULES.items():
            public = getattr(value, "__name__", "")
            if public and getattr(module, public, None) is value:
                return self._public(node, alias, public)
        plain = getattr(value, "py_func", value)
        if isinstance(plain, types.FunctionType):
            if plain not in self.inliner.done:
                name = free_name(f"{self.inliner.prefix}_{plain.__name__}", self.inliner.taken)
                self.inliner.inline(plain, name)
            return ast.Name(self.inliner.done[plain], ast.Load())
        return self._refuse(node, name, f"is {type(value).__name__}")

    def _public(self, node: ast.expr, module: str, name: str) -> ast.AST:
        if module in self.local:
            return self._refuse(node, name, f"is hidden by an argument or variable that is named {module!r}")
        return ast.Attribute(ast.Name(module, ast.Load()), name, ast.Load())

    def _refuse(self, node: ast.expr, name: str, problem: str) -> ast.AST:
        code = self.function.__code__
        line = code.co_firstlineno + node.lineno - 1
        raise InvalidInput(
            f"{code.co_filename}:{line}: the kernel {self.function.__qualname__} reads {name!r}, which {problem}. "
            "A kernel may use its arguments, numbers and functions of its module, math and numpy."
        )


def _literal(value: float) -> ast.expr:
    """Return a number as an expression; a negative one is an operation, so that a power gets its brackets."""
    text = repr(value).replace("inf", "math.inf").replace("nan", "math.nan")
    (statement,) = parsed(text).body
    assert isinstance(statement, ast.Expr)
    return statement.value


def _definition(function: types.FunctionType) -> ast.FunctionDef:
    if hasattr(function, "__wrapped__"):
        raise InvalidInput(
            f"The kernel {function.__qualname__} has a decorator, which cannot be compiled; "
            "write the whole formula in the function."
        )
    try:
        source = textwrap.dedent(inspect.getsource(function))
    except (OSError, TypeError) as error:
        raise InvalidInput(
            f"The source of the kernel {function.__qualname__} cannot be found; "
            "define it in a file, a script or a notebook."
        ) from error
    for node in ast.walk(parsed(source)):
        if isinstance(node, ast.FunctionDef) and node.name == function.__name__:
            return node
    raise InvalidInput(f"The kernel {function.__qualname__} must be written as a function with def.")
