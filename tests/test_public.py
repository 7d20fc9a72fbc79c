"""The public names: they exist, are documented, and stand in the stub."""

import ast
import functools
import gc
import inspect
import re
from importlib import metadata

import pytest

import impactlab as il

NAMES = [name for name in il.__all__ if name != "__version__"]
CLASSES = [name for name in NAMES if inspect.isclass(getattr(il, name))]
PLOTS = [f"plot.{name}" for name in il.plot.__all__]
FUNCTIONS = [name for name in NAMES if inspect.isfunction(getattr(il, name))]


def test_names_of_the_design():
    assert set(NAMES) >= {
        "Component", "parameter", "Oscillator", "LinearOscillator", "DuffingOscillator", "ContactLaw",
        "HertzContact", "LinearContact", "Contact", "WALL", "Excitation", "WhiteNoise", "ShinozukaNoise", "Network",
        "chain", "simulate", "rerun", "exact", "compare", "save", "network_of", "run_study", "Study", "Integrator",
        "ExactFlow", "RungeKutta4", "EulerMaruyama", "Record", "Density", "JointDensity", "Trajectory",
        "ExplicitIntegrator", "PerRealization", "ImpactLabError", "InvalidInput", "NoExactReference",
    }  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_name_resolves_to_what_it_names(name):
    value = getattr(il, name)
    assert getattr(value, "__name__", name).removeprefix("impactlab.") == name
    assert (inspect.getdoc(value) or "").strip()


def test_unknown_name():
    with pytest.raises(AttributeError, match=r"module 'impactlab' has no attribute 'Netwrok'"):
        il.Netwrok  # noqa: B018
    assert dir(il) == il.__all__ == sorted(set(il.__all__))


def test_stub_and_reference_list_the_public_names(lists):
    """In the stub, each name stands as ``import X as X`` from the module that defines it."""
    assert lists.STUB.read_text(encoding="utf-8") == lists.stub(), "run docs/names.py"
    page = lists.REFERENCE.read_text(encoding="utf-8")
    assert page == lists.reference(page), "run docs/names.py"
    tree = ast.parse(lists.stub())
    names = [item for node in tree.body if isinstance(node, ast.ImportFrom) for item in node.names]
    assert all(item.asname == item.name for item in names)
    assert sorted([*(item.name for item in names), "__version__"]) == il.__all__


def test_a_new_name_gets_a_row_and_one_that_has_gone_loses_its_row(lists):
    page = lists.REFERENCE.read_text(encoding="utf-8")
    row = next(line for line in page.splitlines() if line.startswith("| `il.CubicCoupling"))
    without = page.replace(row + "\n", "| `il.Gone(x)` | nothing |\n")
    lines = lists.reference(without).splitlines()
    assert (
        "| `il.CubicCoupling(cubic)` | cubic spring: force `cubic e³` at the extension e, without a linear part |"
        in lines
    )
    assert not any("il.Gone" in line for line in lines)
    assert len(lines) == len(page.splitlines())


def test_version_is_that_of_the_distribution():
    assert il.__version__ == metadata.version("impactlab")


@pytest.mark.parametrize("name", [*FUNCTIONS, *PLOTS])
def test_function_is_documented_in_numpydoc_style(name):
    """Every argument stands under Parameters; what is returned and raised is said."""
    function = functools.reduce(getattr, name.split("."), il)
    text = inspect.getdoc(function)
    summary = text.splitlines()[0]
    assert re.fullmatch(r"[A-Z][^.]*(\.[^.]*)*\.", summary), summary
    sections = sections_of(text)
    arguments = {item.lstrip("*") for item in inspect.signature(function).parameters}
    assert documented(sections.get("Parameters", "")) == arguments
    if inspect.signature(function).return_annotation not in (None, "None"):
        assert {"Returns", "Raises"} & set(sections)


@pytest.mark.parametrize("name", CLASSES)
def test_class_is_documented_in_numpydoc_style(name):
    """Every field of its own stands under Parameters, those with units with their units."""
    cls = getattr(il, name)
    text = inspect.getdoc(cls)
    assert cls.__doc__, "the docstring must be the class's own"
    parameters = sections_of(text).get("Parameters", "")
    if issubclass(cls, il.Component) and cls is not il.Component:
        own = {field for field in inspect.get_annotations(cls) if field in cls.field_names()}
        assert own <= documented(parameters)
        for field in own:
            units = cls.units_of(field)
            if units != "1":
                assert f"({units})" in parameters, f"{field} needs its units, ({units})"


def sections_of(text):
    """Split a docstring at its underlined headings."""
    parts = re.split(r"^(\w[\w ]*)\n-{3,}\n", text, flags=re.MULTILINE)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def documented(section):
    """Names that a section of parameters describes."""
    heads = [line for line in section.splitlines() if line and not line.startswith(" ")]
    return {name.strip().lstrip("*") for head in heads for name in head.split(":")[0].split(",")}


@pytest.mark.parametrize("collecting", [True, False])
def test_loading_leaves_the_garbage_collector_as_it_was(collecting):
    usual, frozen = gc.isenabled(), gc.get_freeze_count()
    (gc.enable if collecting else gc.disable)()
    try:
        il.__getattr__("chain")
        assert (gc.isenabled(), gc.get_freeze_count()) == (collecting, frozen)
        gc.freeze()
        il.__getattr__("chain")
        assert gc.get_freeze_count() > frozen  # objects that somebody has frozen stay so
    finally:
        gc.unfreeze()
        (gc.enable if usual else gc.disable)()
