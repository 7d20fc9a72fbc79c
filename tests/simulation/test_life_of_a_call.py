"""How much of the package a reader meets who follows one call: upper bounds, to be lowered."""

import ast
import functools
import sys
from itertools import pairwise
from pathlib import Path

import pytest

import impactlab as il

pytestmark = pytest.mark.full

PACKAGE = Path(il.__file__).parent
MODULES = {
    ".".join(["impactlab", *file.relative_to(PACKAGE).with_suffix("").parts]).removesuffix(".__init__"): file
    for file in sorted(PACKAGE.rglob("*.py"))
}
FUNCTIONS, TRACED, DEPTH = 640, 100, 27
"""Functions and modules that `il.simulate` of a pair calls in its thread, and how deep."""


def imports(tree):
    """Modules of the package by the names that a module imports from them."""
    nodes = (node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module)
    found = {item.asname or item.name: node.module for node in nodes for item in node.names}
    return {name: module for name, module in found.items() if module.startswith("impactlab.")}


@functools.cache
def floor(module):
    """How many modules stand on top of each other up to a module."""
    below = set(imports(ast.parse(MODULES[module].read_text(encoding="utf-8"))).values()) & MODULES.keys()
    return 1 + max(map(floor, below - {module}), default=0)


def pair():
    """Two bodies under white noise, and a gap between them."""
    fast, slow = (il.LinearOscillator.from_frequency(rate, 0.1) for rate in (100.0, 6.0))
    gap = {"gap": il.Contact("fast", "slow", il.HertzContact(1e4), clearance=0.05)}
    return il.Network({"fast": fast, "slow": slow}, gap, {"fast": il.WhiteNoise(16.0), "slow": il.WhiteNoise(1.0)})


def test_functions_of_a_simulation():
    """Of the second call in a process, whose step is given; comprehensions, and what threads run, do not count."""
    run = functools.partial(il.simulate, duration=10.0, realizations=130, step=0.005, rng=1)
    run(pair())
    network, calls, open_calls, depth = pair(), set(), [], 0

    def note(frame, event, _):
        nonlocal depth
        code = frame.f_code
        if event == "call":
            own = code.co_filename.startswith(str(PACKAGE)) and code.co_name[1:] not in COMPREHENSIONS
            open_calls.append(own)
            depth = max(depth, sum(open_calls))
            if own:
                calls.add((code.co_filename, code.co_firstlineno, code.co_name))
        elif event == "return" and open_calls:
            open_calls.pop()

    sys.setprofile(note)
    try:
        run(network)
    finally:
        sys.setprofile(None)
    modules = {file for file, *_ in calls}
    print(f"{len(calls)} functions of {len(modules)} modules, {depth} deep")
    assert len(calls) <= FUNCTIONS
    assert len(modules) <= TRACED
    assert depth <= DEPTH


COMPREHENSIONS = {"listcomp>", "setcomp>", "dictcomp>", "genexpr>"}


def walked(module, function, name):
    """Modules of the calls, in order, that take an argument of a function, and of those in helpers beside it."""
    tree = ast.parse(MODULES[module].read_text(encoding="utf-8"))
    homes, helpers = imports(tree), {item.name: item for item in tree.body if isinstance(item, ast.FunctionDef)}
    kinds, stays = {}, []

    def visit(node, names):
        for child in ast.iter_child_nodes(node):
            visit(child, names)
        if isinstance(node, ast.arg) and isinstance(node.annotation, ast.Name):
            kinds[node.arg] = homes.get(node.annotation.id)
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Call) and isinstance(node.targets[0], ast.Name):
            kinds.setdefault(node.targets[0].id, homes.get(root(node.value)))
        if not isinstance(node, ast.Call):
            return
        taken = [*enumerate(node.args), *((item.arg, item.value) for item in node.keywords)]
        places = [place for place, item in taken if isinstance(item, ast.Name) and item.id in names]
        if not places:
            return
        base = root(node)
        stays.append(module if base in helpers else homes.get(base) or kinds.get(base))
        if base in helpers:
            parameters = [item.arg for item in helpers[base].args.args]
            visit(helpers[base], {parameters[item] if isinstance(item, int) else item for item in places})

    def root(call):
        item = call.func
        while isinstance(item, ast.Attribute):
            item = item.value
        return item.id if isinstance(item, ast.Name) else ""

    visit(helpers[function], {name})
    return stays


def test_stays_and_climbs_of_a_plan():
    """How often the model is handed on while a plan is made, and how often to a module on a higher floor."""
    stays = walked("impactlab.simulation.planning", "make_plan", "model")
    floors = [floor(module) for module in stays if module]
    climbs = sum(after > before for before, after in pairwise(floors))
    print(f"{len(stays)} stays, {len(set(stays))} rooms, {climbs} climbs")
    assert len(stays) > 20
    assert len(stays) <= 25
    assert climbs <= 6


def test_imports_of_simulate():
    tree = ast.parse((PACKAGE / "simulation" / "simulate.py").read_text(encoding="utf-8"))
    assert len(set(imports(tree).values())) <= 15
