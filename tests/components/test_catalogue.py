"""The table of all that networks are made of, and the page of the documentation that shows it."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

import impactlab as il
from impactlab.components.textbooks import SOURCES

ROOT = Path(__file__).parent.parent.parent
ABSTRACT = {"Oscillator", "ContactLaw", "CouplingLaw", "Excitation", "FilteredNoise", "Structure"}
OTHERS = {"Component", "SharedCosines", "Uncertain", "WALL", "catalogue", "parameter", "state"}
"""Public names of the components that are no part of a network by themselves."""


@pytest.fixture(scope="module")
def script():
    spec = importlib.util.spec_from_file_location("catalogue_page", ROOT / "docs" / "figures" / "catalogue.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_public_component_is_there_with_its_source():
    public = {name for module, names in il._HOME.items() if module.startswith("components.") for name in names}
    names = [entry.name for entry in il.catalogue()]
    assert sorted(names) == sorted((public - ABSTRACT - OTHERS) | {"LinearOscillator.massless"})
    assert [entry.name for entry in il.catalogue() if not entry.source] == []
    assert SOURCES.keys() <= set(names)
    cited = {name for name in names if getattr(getattr(il, name, None), "citation", "")}
    assert cited.isdisjoint(SOURCES)


def test_entries_have_formulas_units_and_defaults():
    (hertz,) = (entry for entry in il.catalogue("contact laws") if entry.name == "HertzContact")
    assert hertz.parameters == ("stiffness [N m-3/2]",)
    assert "stiffness δ^(3/2)" in hertz.description
    assert "  HertzContact(stiffness [N m-3/2])\n" in str(il.catalogue())
    assert il.catalogue()._repr_html_().count("<tr>") == len(il.catalogue()) + 1
    with pytest.raises(il.InvalidInput, match="did you mean 'coupling laws'"):
        il.catalogue("coupling law")
    (beam,) = (entry for entry in il.catalogue("bodies") if entry.name == "beam")
    assert beam.parameters[:3] == ("length [m]", "bending_stiffness [N m2]", "mass_per_length [kg m-1]")
    (node,) = (entry for entry in il.catalogue("bodies") if entry.name == "LinearOscillator.massless")
    assert node.parameters == ("damping [N s m-1]", "stiffness [N m-1] = 0.0", "lag [s] = 1e-09")


def test_page_is_what_the_catalogue_says(script):
    page = ROOT / "docs" / "catalogue.md"
    assert page.read_text(encoding="utf-8") == script.page(), "run docs/figures/catalogue.py"


def test_all_that_has_a_force_is_drawn(script):
    for family, examples in script.EXAMPLES.items():
        if family == "contacts and couplings":
            assert set(examples) == {entry.name for entry in il.catalogue(family)} - {"Combination"}
            continue
        drawn = {name for name, component in examples.items() if type(component).__name__ == name}
        assert drawn == set(examples)
        for entry in il.catalogue(family):
            if entry.name[0].islower() or "." in entry.name:  # functions
                continue
            cls = getattr(il, entry.name)
            forced = ("force" in cls.kernels and getattr(cls, "force", None) is not None) or issubclass(
                cls, il.Oscillator
            )
            assert forced <= (entry.name in drawn or cls is il.RigidContact)


def test_curves_are_those_of_the_laws(script):
    """Loops of dissipative laws enclose what they dissipate, those of others nothing."""
    place, force = script.curve("contact laws", il.HuntCrossleyContact(1.0, dissipation=0.5))
    # ∮ δ^(3/2) χ δ' dδ = χ ∫ sin^(3/2) cos² dt
    time = np.linspace(0.0, np.pi, 20001)
    expected = 0.5 * np.trapezoid(np.sin(time) ** 1.5 * np.cos(time) ** 2, time)
    assert np.trapezoid(force, place) == pytest.approx(expected, rel=1e-3)
    place, force = script.curve("contact laws", il.HertzContact(1.0))
    assert np.trapezoid(force, place) == pytest.approx(0.0, abs=1e-9)
    place, force = script.curve("coupling laws", il.JenkinsCoupling(2.0, slip_force=1.0))
    assert np.abs(force).max() == pytest.approx(1.0)


@pytest.mark.full
def test_curves_of_contacts_are_those_of_the_networks(script):
    """The force on a body, as the right-hand side of a network of it has it."""
    for links in script.EXAMPLES["contacts and couplings"].values():
        families = {"contacts": {}, "couplings": {}}
        for number, link in enumerate(links):
            families["couplings" if isinstance(link, il.Coupling) else "contacts"][str(number)] = link
        bodies = dict.fromkeys("ab", il.LinearOscillator(mass=1.0, damping=0.0, stiffness=0.0))
        right_side = il.Network(bodies, **families).compile()
        x, force = script.curve("contacts and couplings", links)
        for place in range(0, len(x), 400):
            state = np.array([x[place], 0.3, 0.0, 0.0])
            assert right_side.rhs(0.0, state)[2] == pytest.approx(force[place], abs=1e-12)
