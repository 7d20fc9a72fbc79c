"""Write the lists that follow from the source: public names, and the constants of step control.

Run ``python docs/names.py``. It writes the stub `impactlab/__init__.pyi`, which editors and type checkers read, and the
rows of `docs/reference.md`: a new name gets a row at the end of the table of its neighbours, with its signature and the
first sentence of its docstring, which may then be edited there; the row of a name that has gone is removed. It also
writes `docs/decisions/step_constants.md` from the modules of `impactlab.step_control`.
"""

import ast
import importlib
import inspect
import re
import sys
from collections.abc import Container, Iterator
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT))  # the package of this checkout, whatever is installed

import impactlab as il  # noqa: E402

STUB, REFERENCE = ROOT / "impactlab" / "__init__.pyi", ROOT / "docs" / "reference.md"
CONSTANTS = ROOT / "docs" / "decisions" / "step_constants.md"

HEAD = '''"""The public names, for editors and type checkers; `docs/names.py` writes them."""

'''

ROW = re.compile(r"^\| `il\.(\w+)")


def stub() -> str:
    """Return the text of the stub."""
    homes = [("impactlab", name) for name in il._SUBMODULES]
    homes += [(f"impactlab.{module}", name) for name, module in il._MODULE.items()]
    homes.sort(key=lambda item: (item[0], not item[1].isupper(), item[1]))  # constants first, as the linter wants
    lines = [f"from {home} import {name} as {name}\n" for home, name in homes]
    return HEAD + "".join(lines) + "\n__version__: str\n"


def reference(page: str) -> str:
    """Return the page of the reference with a row for each public name, and for no other."""
    lines = [line for line in page.splitlines() if not (found := ROW.match(line)) or found[1] in il.__all__]
    listed = {found[1] for line in lines if (found := ROW.match(line))}
    for names in il._HOME.values():
        for name in names:
            if name not in listed:
                rows = {found[1]: place for place, line in enumerate(lines) if (found := ROW.match(line))}
                lines.insert(max(rows[item] for item in neighbours(name, rows)) + 1, row(name))
    return "\n".join(lines) + "\n"


def neighbours(name: str, listed: Container[str]) -> list[str]:
    """Return the listed names of the same module; if there are no others, of the same folder, or all."""
    home = il._MODULE[name]
    for near in (home, home.partition(".")[0], ""):
        names = [item for item, module in il._MODULE.items() if module.startswith(near) and item in listed]
        if names:
            return names
    raise AssertionError


def row(name: str) -> str:
    """Return the row of a name: its signature without types, and the first sentence of its docstring."""
    value = getattr(il, name)
    parameters = inspect.signature(value).parameters.values() if callable(value) else ()
    shown = ", ".join(
        item.name if item.default is item.empty else f"{item.name}={item.default!r}" for item in parameters
    )
    sentence = " ".join((inspect.getdoc(value) or "").partition("\n\n")[0].split()).removesuffix(".")
    return f"| `il.{name}({shown})` | {sentence[:1].lower()}{sentence[1:]} |".replace("``", "`")


class Constant(NamedTuple):
    """A number of a module, as its source says it."""

    module: str
    name: str
    value: str
    reason: str

    @property
    def unit(self) -> str:
        """The unit that the reason ends with, in brackets; 1 without any."""
        found = re.search(r" \(([^()]+)\)\.$", self.reason)
        return found[1] if found else "1"


def constants_of(module: str) -> Iterator[Constant]:
    """Find the numbers, tuples and arrays of numbers with a name in capitals; the reason is the text below each."""
    namespace = vars(importlib.import_module(f"impactlab.{module}"))
    body = ast.parse((ROOT / "impactlab" / f"{module.replace('.', '/')}.py").read_text(encoding="utf-8")).body
    for node, below in pairwise([*body, ast.Pass()]):
        if not isinstance(node, ast.Assign):
            continue
        target, value = node.targets[0], node.value
        several = isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple)
        text = below.value.value if isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant) else ""
        for name, number in zip(target.elts, value.elts, strict=True) if several else [(target, value)]:
            named = isinstance(name, ast.Name) and re.fullmatch("[A-Z][A-Z0-9_]*", name.id)
            if named and numeric(namespace[name.id]):
                shown = ast.unparse(number)
                shown = shown[1:-1] if isinstance(number, ast.Tuple) else shown
                yield Constant(module, name.id, shown, " ".join(str(text).split()))


def shared_constants() -> list[Constant]:
    """Return the constants of other modules that step control uses."""
    used = {
        (str(node.module).removeprefix("impactlab."), item.name)
        for file in (ROOT / "impactlab" / "step_control").glob("*/*.py")
        for node in ast.parse(file.read_text(encoding="utf-8")).body
        if isinstance(node, ast.ImportFrom) and re.match(r"impactlab\.(?!step_control)", str(node.module))
        for item in node.names
        if item.name.isupper()
    }
    found = (item for module in sorted({module for module, _ in used}) for item in constants_of(module))
    return [item for item in found if (item.module, item.name) in used and item.reason]


def numeric(value: object) -> bool:
    """Whether a value is a number, an array, or a tuple of numbers."""
    items = value if isinstance(value, tuple) and value else (value,)
    return type(value).__name__ == "ndarray" or all(type(item) in (int, float) for item in items)


def step_constants() -> str:
    """Return the page with the constants of step control, module by module."""
    lines = [
        "# Constants of step control",
        "",
        "`docs/names.py` writes this page from the modules of `impactlab.step_control`. A number of unit 1 is a part,",
        "a factor or a count. [Step size](step_size.md) has the decisions, and [theory](../theory.md#step) the rules.",
    ]
    folder = ROOT / "impactlab" / "step_control"
    parts = {
        part: [
            item
            for file in sorted((folder / part).glob("[!_]*.py"))
            for item in constants_of(f"step_control.{part}.{file.stem}")
        ]
        for part in ("rules", "measured", "tolerance")
    }
    for title, items in (parts | {"shared with the rest of the package": shared_constants()}).items():
        lines += ["", f"## {title.capitalize()}", "", "| constant | value | unit | reason |", "|---|---|---|---|"]
        for item in items:
            home, reason = item.module.rpartition(".")[2], item.reason.replace("|", "\\|").replace("``", "`")
            lines.append(f"| `{home}.{item.name}` | `{item.value}` | {item.unit} | {reason} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    CONSTANTS.write_text(step_constants(), encoding="utf-8")
    STUB.write_text(stub(), encoding="utf-8")
    REFERENCE.write_text(reference(REFERENCE.read_text(encoding="utf-8")), encoding="utf-8")
