"""The layers: imports point one way, and heavy packages stay where they belong."""

import ast
import functools
from pathlib import Path

import pytest

import impactlab

PACKAGE = Path(impactlab.__file__).parent

LAYERS = [
    {"errors", "inputs", "interrupts", "quadrature", "step_control"},  # of the last, modules are in rows of their own
    {"allowed_time", "given_files", "machine", "memory_limits"},
    {"progress", "toml_text", "results", "compiling", "components"},
    {"kernels"},
    {"assembly"},
    {"linear"},
    {"integrators", "reference"},
    {"plan"},
    {"step_control/rules"},
    {"mechanisms"},
    {"networks", "statistics"},
    {"records", "plotting"},
    {"located"},
    {"step_control/measured"},
    {"step_control/tolerance"},
    {"simulation", "plot"},
    {"sweeps"},
    {"analysis"},
    {"studies"},
    {"command_line"},
    {"__main__"},
]
"""Folders, and modules in none, from the bottom to the top. Imports are from lower rows, or within a folder.

Folders inside a folder have rows of their own where the table names them.
"""

HEAVY = {"numba": {"compiling"}, "matplotlib": {"plotting"}, "netCDF4": {"records", "results"}}
"""Packages, and the only layers that may import them."""

FLOORS = 12
"""How many modules may stand on top of each other."""

HEIGHT = {name: height for height, layer in enumerate(LAYERS) for name in layer}


@functools.cache
def imports(file, of_types=False):
    """All imports of a file that are made when it runs: (module, names, whether inside a function).

    With `of_types`, also those that only a type checker makes.
    """

    def walk(node, inside):
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.Import):
                yield from ((item.name, [], inside) for item in child.names)
            elif isinstance(child, ast.ImportFrom):
                yield child.module, [item.name for item in child.names], inside
            elif of_types or not (isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING"):
                yield from walk(child, inside or isinstance(child, ast.FunctionDef))

    return list(walk(ast.parse(file.read_text(encoding="utf-8")), False))


def layer(names):
    """The folder of the package, or the module, that a module belongs to by the parts of its name."""
    inner = "/".join(names[:2])
    return inner if inner in HEIGHT else names[0]


def part(file):
    """The folder of the package, or the module, that a file belongs to."""
    return layer(file.relative_to(PACKAGE).with_suffix("").parts)


FILES = [file for file in sorted(PACKAGE.rglob("*.py")) if file != PACKAGE / "__init__.py"]
each_file = pytest.mark.parametrize("file", FILES, ids=lambda file: file.relative_to(PACKAGE).as_posix())


def test_every_module_has_a_layer():
    assert {part(file) for file in FILES} == set(HEIGHT), "LAYERS must list every folder once"
    assert len(HEIGHT) == sum(map(len, LAYERS))


@each_file
def test_imports_point_down_and_to_few_packages(file):
    here = part(file)
    for module, names, _ in imports(file):
        package, _, rest = module.partition(".")
        assert here in HEAVY.get(package, {here}), f"{here} must not import {package}"
        assert not package.startswith("impactlab_"), "the package knows no plugin"
        if package != "impactlab":
            continue
        below = layer(rest.split("."))
        if below not in (here, ""):
            assert HEIGHT[below] < HEIGHT[here], f"{here} must not import {below}"
        assert below == here or not any(name.startswith("_") for name in names if name != "__version__")


def test_no_stage_imports_a_mechanism():
    """Stages ask all mechanisms of a network, by `impactlab.assembly.mechanism`."""
    for file in FILES:
        for module, names, _ in imports(file, of_types=True):
            whole = [module, *(f"{module}.{name}" for name in names)]
            inside = any(f"{name}.".startswith("impactlab.mechanisms.") for name in whole)
            assert not inside or part(file) == "mechanisms", f"{file} knows {module} by its answers only"


def test_imports_have_few_floors_and_no_circles():
    """A module stands one floor above the highest that it imports: in its folder or not, late, or for a type only."""
    names = {".".join(["impactlab", *file.relative_to(PACKAGE).with_suffix("").parts]): file for file in FILES}
    names = {name.removesuffix(".__init__"): file for name, file in names.items()}

    @functools.cache
    def floor(name):
        below = set()
        for module, imported, _ in imports(names[name], of_types=True):
            items = {f"{module}.{each}" for each in imported} & names.keys()
            below |= items or {module} & names.keys()
        return 1 + max(map(floor, below - {name}), default=0)  # a circle never ends

    assert max(map(floor, names)) <= FLOORS


def test_plugins_import_matplotlib_for_figures_only():
    """A plugin is found and configured without it: its package and its study do not import it."""
    for file in (PACKAGE.parent / "plugins").glob("*/*.py"):
        if file.stem in ("__init__", "study"):
            assert not [module for module, _, inside in imports(file) if module.startswith("matplotlib") and not inside]


def test_a_network_is_described_without_heavy_packages(run_python):
    text = """
import sys
import impactlab as il
il.chain(3, il.LinearOscillator(stiffness=1.0), il.HertzContact(1e4), excitation=il.WhiteNoise(1.0)).to_dict()
print(sorted({"numba", "xarray", "matplotlib", "scipy", "netCDF4", "pandas"} & set(sys.modules)))
"""
    assert run_python("-c", text).strip() == "[]"
