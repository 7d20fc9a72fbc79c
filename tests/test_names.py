"""One meaning for a name: no file name twice in the package, no public name of a module in three modules."""

import ast
from collections import defaultdict
from pathlib import Path

import impactlab

PACKAGE = Path(impactlab.__file__).parent

FILES: set[str] = set()
"""File names that stand in two folders still: mechanisms have a module in each stage."""

NAMES = {
    "COLUMNS", "Forces", "LAG", "LARGEST", "MANY", "MOST", "PLACES", "ROUNDING", "Rows",
    "SHIFT", "SPEED", "STATE", "Sums", "joined",
}  # fmt: skip
"""Names that have a meaning of their own in each of three modules still."""

INTERFACES = {"Result", "add_commands", "again"}
"""Names that mean the same in all modules that define them: the result of a function that is an argument, …"""


def defined(file):
    """Public names that a module defines at its top level."""
    for node in ast.parse(file.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            yield from (item.id for target in targets for item in ast.walk(target) if isinstance(item, ast.Name))


def several(named, least):
    """Names that belong to at least so many places."""
    places = defaultdict(set)
    for place, name in named:
        if not name.startswith("_"):
            places[name].add(place)
    return {name for name, where in places.items() if len(where) >= least}


def test_no_more_names_have_several_meanings():
    """The sets above may only become smaller."""
    files = sorted(PACKAGE.rglob("*.py"))
    assert several(((file, file.stem) for file in files), 2) - INTERFACES <= FILES
    assert several(((file, name) for file in files for name in defined(file)), 3) - INTERFACES <= NAMES


def test_the_measure(tmp_path):
    (tmp_path / "one.py").write_text("import os\n\nA, (b, _c) = 1, (2, 3)\nd: int = 4\n\ndef e(): f = 1\n")
    assert set(defined(tmp_path / "one.py")) - {"_c"} == {"A", "b", "d", "e"}
    assert several([(1, "a"), (2, "a"), (1, "b"), (1, "b"), (1, "_c"), (2, "_c")], 2) == {"a"}
