"""Pages of all public names, by family, made from the code when the site is built."""

import inspect
import shutil
from collections import defaultdict
from operator import attrgetter
from pathlib import Path
from textwrap import indent
from typing import Any

from sphinx.application import Sphinx
from sphinx.util import logging

import impactlab as il

LOGGER = logging.getLogger(__name__)

FOLDER = Path(__file__).parent.parent / "api"

BASES = {
    il.ContactLaw: "Contact laws",
    il.CouplingLaw: "Coupling laws",
    il.Oscillator: "Bodies and structures",
    il.Structure: "Bodies and structures",
    il.Excitation: "Excitations",
    il.Record: "Records",
    il.Integrator: "Integrators",
    il.ImpactLabError: "Errors and warnings",
    il.ImpactLabWarning: "Errors and warnings",
}
MODULES = {
    "components.beams": "Bodies and structures",
    "components.prescribed": "Bodies and structures",
    "components.excitation": "Excitations",
    "components.coherent": "Excitations",
    "components.correlated": "Excitations",
    "records": "Records",
    "analysis.fragility": "Many networks",
    "analysis.uncertain": "Many networks",
    "sweeps.sweep": "Many networks",
    "analysis": "Motions without noise",
    "components": "Networks",
    "networks": "Networks",
    "simulation": "Runs",
    "reference": "Exact laws",
    "plotting": "Plots",
    "studies": "Studies",
    "": "Results",
}
ORDER = (
    "Networks", "Bodies and structures", "Contact laws", "Coupling laws", "Excitations", "Runs", "Records",
    "Integrators", "Many networks", "Motions without noise", "Exact laws", "Results", "Plots", "Studies",
    "Errors and warnings",
)  # fmt: skip


SHARED = Path(__file__).parent / "networks.py"
"""What the examples share."""

INTRODUCTION = f"""``import impactlab as il``. Each name has an example. Examples share these lines:

.. code-block:: python

{indent(SHARED.read_text(encoding="utf-8"), "   ")}
"""


def family(name: str) -> str:
    """Return the family of a public name."""
    value = getattr(il, name)
    for base, title in BASES.items():
        if isinstance(value, type) and issubclass(value, base):
            return title
    home = il._MODULE.get(name, "")
    return next(title for module, title in MODULES.items() if home.startswith(module))


def families() -> dict[str, list[str]]:
    """Return the public names by family, in the order of the pages."""
    found = defaultdict(list)
    for name in il.__all__:
        if not name.startswith("__") and name != "plot":
            found[family(name)].append(name)
    found["Plots"] += [f"plot.{name}" for name in il.plot.__all__]
    return {title: found[title] for title in ORDER}


def page(name: str) -> str:
    """Return the page of a name."""
    full, value = f"impactlab.{name}", attrgetter(name)(il)
    if "Examples\n--------" not in (inspect.getdoc(value) or ""):
        LOGGER.warning("il.%s has no section Examples in its docstring", name)
    if inspect.isclass(value):
        own = [item for item, of in vars(value).items() if documented(item, of) and not inherited(value, item)]
        members = f"   :members: {', '.join(own)}\n" if own else ""
        body = f".. autoclass:: {full}\n{members}"
    elif callable(value):
        body = f".. autofunction:: {full}\n"
    else:
        body = f".. autodata:: {full}\n   :no-value:\n"
    return heading(f"il.{name}") + body


def documented(name: str, member: object) -> bool:
    """Whether a member of a class is a public method or property with a docstring."""
    function = getattr(member, "__func__", getattr(member, "fget", member))
    known = inspect.isfunction(function) or isinstance(member, property)
    return known and not name.startswith("_") and bool(inspect.getdoc(member))


def inherited(value: type, name: str) -> bool:
    """Whether a class defines anew a member that its base has, where it is described."""
    return any(hasattr(base, name) for base in value.__bases__)


def heading(title: str) -> str:
    return f"{title}\n{'=' * len(title)}\n\n"


def contents(names: list[str]) -> str:
    return "\n.. toctree::\n   :hidden:\n\n" + "".join(f"   {name}\n" for name in names)


def write(app: Sphinx) -> None:
    """Write a page of each name, of each family, and of all."""
    shutil.rmtree(FOLDER, ignore_errors=True)
    FOLDER.mkdir()
    pages = {f"impactlab.{name}": page(name) for names in families().values() for name in names}
    every = heading("Public names") + INTRODUCTION
    for title, names in families().items():
        full = [f"impactlab.{name}" for name in names]
        table = ".. autosummary::\n   :nosignatures:\n\n" + "".join(f"   ~{name}\n" for name in full)
        of_family = title.lower().replace(" ", "_")
        pages[of_family] = heading(title) + table + contents(full)
        every += f"\n{title}\n{'-' * len(title)}\n\n{table}"
    pages["index"] = every + contents([title.lower().replace(" ", "_") for title in families()])
    for name, text in pages.items():
        (FOLDER / f"{name}.rst").write_text(text, encoding="utf-8")


def fields(app: Sphinx, what: str, name: str, value: Any, options: Any, arguments: str, result: str) -> Any:
    """Return the arguments of a component: its fields, which its `__new__` does not name."""
    if isinstance(value, type) and issubclass(value, il.Component):
        signature = inspect.signature(value.__init__)
        shown = [item.replace(annotation=inspect.Parameter.empty) for item in signature.parameters.values()][1:]
        return str(inspect.Signature(shown)), None
    return None


def setup(app: Sphinx) -> dict[str, Any]:
    app.connect("builder-inited", write)
    app.connect("autodoc-process-signature", fields)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
