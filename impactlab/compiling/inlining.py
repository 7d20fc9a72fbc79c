"""Copies of kernels as text, in which every name that they read is resolved, or refused with file and line."""

from __future__ import annotations

import ast
import builtins
import itertools
import math
import types
from collections import ChainMap
from collections.abc import Collection, Mapping
from typing import Any, NamedTuple

import numpy as np

from impactlab.compiling.kernel_text import definition_of, parsed, refuse

_MODULES = {math: "math", np: "np"}

_BUILTINS = abs, bool, divmod, enumerate, float, int, len, max, min, range, round, sum, zip
"""Functions of Python that compiled code has, with the same results."""

_OF_NUMPY = np.round, np.around, np.sinc, np.float64, np.int64
"""Functions of NumPy for scalars beside its universal ones."""


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
        self.complete: set[Any] = set()

    def inline(self, function: Any, name: str) -> None:
        """Add the text of a kernel under a name, and the texts of all functions that it calls."""
        self._inline(function, name, of_floats=True)

    def helper(self, function: Any) -> str:
        """Add the text of a function that a kernel calls, once, and return its name."""
        if function not in self.done:
            name = free_name(f"{self.prefix}_{function.__name__}", self.taken)
            self._inline(function, name, of_floats=False)
        return self.done[function]

    def _inline(self, function: Any, name: str, of_floats: bool) -> None:
        function = getattr(function, "py_func", function)
        self.done[function] = name
        self.taken.add(name)
        definition = definition_of(function)
        definition.name = name
        definition.decorator_list = []
        definition.returns = None
        for argument in definition.args.args:
            argument.annotation = None
        if ast.get_docstring(definition) is not None:
            definition.body = definition.body[1:] or [ast.Pass()]
        arguments = {argument.arg for argument in definition.args.args}
        assigned = {
            node.id for node in ast.walk(definition) if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
        }
        floats = arguments - assigned if of_floats else set()
        resolved = _Resolve(self, function, arguments | assigned, floats).visit(definition)
        self.texts[name] = ast.unparse(ast.fix_missing_locations(resolved))
        self.complete.add(function)


class _Resolve(ast.NodeTransformer):
    """Replaces the names that a function reads from its module."""

    def __init__(
        self, inliner: Inliner, function: types.FunctionType, local: Collection[str], floats: Collection[str]
    ) -> None:
        self.inliner = inliner
        self.function = function
        self.local = local
        self.floats = floats  # names that are certainly no whole numbers
        self.outside = _outside(function)

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        """Let powers of whole numbers be those of Python: the compiler rounds 2**−1 to 0."""
        self.generic_visit(node)
        plain = isinstance(node.right, ast.Constant) or self._is_float(node.left) or self._is_float(node.right)
        if isinstance(node.op, ast.Pow) and not plain:
            node.left = ast.Call(ast.Name("float", ast.Load()), [node.left], [])
        return node

    def visit_AugAssign(self, node: ast.AugAssign) -> ast.AST:
        if isinstance(node.op, ast.Pow) and isinstance(node.target, ast.Name):
            before = ast.Name(node.target.id, ast.Load())
            return self.visit(ast.Assign([node.target], ast.BinOp(before, node.op, node.value)))  # type: ignore[no-any-return]
        return self.generic_visit(node)

    def _is_float(self, node: ast.expr) -> bool:
        match node:
            case ast.Constant():
                return isinstance(node.value, float)
            case ast.Name():
                return node.id in self.floats
            case ast.UnaryOp():
                return self._is_float(node.operand)
            case ast.BinOp():
                return isinstance(node.op, ast.Div) or self._is_float(node.left) or self._is_float(node.right)
        return False

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        owner = node.value
        if isinstance(owner, ast.Name) and owner.id not in self.local:
            value = self.outside.get(owner.id)
            if isinstance(value, types.ModuleType) and hasattr(value, node.attr):
                found = getattr(value, node.attr)
                if value in _MODULES:
                    self.inliner.reads.append(Read(self.function, owner.id, "", value))
                    return self._public(node, _MODULES[value], node.attr, found)
                self.inliner.reads.append(Read(self.function, owner.id, node.attr, found))
                return self._resolved(node, f"{owner.id}.{node.attr}", found)
        self.generic_visit(node)
        return self._refuse(node, ast.unparse(node), "belongs to an object")

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
            return node if value in _BUILTINS else self._refuse(node, name, "is no function of scalars")
        for module, alias in _MODULES.items():
            public = getattr(value, "__name__", "")
            if public and getattr(module, public, None) is value:
                return self._public(node, alias, public, value)
        plain = getattr(value, "py_func", value)
        if isinstance(plain, types.FunctionType):
            if plain in self.inliner.done and plain not in self.inliner.complete:
                return self._refuse(node, name, "calls itself")
            return ast.Name(self.inliner.helper(plain), ast.Load())
        return self._refuse(node, name, f"is {type(value).__name__}")

    def _public(self, node: ast.expr, module: str, name: str, value: Any) -> ast.AST:
        if module in self.local:
            return self._refuse(node, name, f"is hidden by an argument or variable that is named {module!r}")
        if module == "np" and not isinstance(value, np.ufunc | int | float) and value not in _OF_NUMPY:
            return self._refuse(node, f"np.{name}", "is no function of scalars")
        return ast.Attribute(ast.Name(module, ast.Load()), name, ast.Load())

    def _refuse(self, node: ast.expr, name: str, problem: str) -> ast.AST:
        refuse(self.function, node, f"reads {name!r}, which {problem}")


def _literal(value: float) -> ast.expr:
    """Return a number as an expression; a negative one is an operation, so that a power gets its brackets."""
    text = repr(value).replace("inf", "math.inf").replace("nan", "math.nan")
    (statement,) = parsed(text).body
    assert isinstance(statement, ast.Expr)
    return statement.value
