"""The table of laws and loads, and the page of the documentation that shows it."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

import impactlab as il

ROOT = Path(__file__).parent.parent.parent
ABSTRACT = {"Oscillator", "ContactLaw", "CouplingLaw", "Excitation", "FilteredNoise", "Structure"}


@pytest.fixture(scope="module")
def script():
    spec = importlib.util.spec_from_file_location("catalogue_page", ROOT / "docs" / "figures" / "catalogue.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_law_and_load_is_there():
    bases = il.Oscillator, il.ContactLaw, il.CouplingLaw, il.Excitation
    public = {name: getattr(il, name) for name in il.__all__}
    known = {name for name, item in public.items() if isinstance(item, type) and issubclass(item, bases)}
    others = {"LinearStructure", "ModalStructure", "PrescribedMotion", "Source", "BaseMotion"}
    assert {entry.name for entry in il.catalogue()} == (known - ABSTRACT) | others
    (hertz,) = (entry for entry in il.catalogue("contact laws") if entry.name == "HertzContact")
    assert hertz.parameters == ("stiffness [N m-3/2]",)
    assert "stiffness δ^(3/2)" in hertz.description
    assert "  HertzContact(stiffness [N m-3/2])\n" in str(il.catalogue())
    assert il.catalogue()._repr_html_().count("<tr>") == len(il.catalogue()) + 1
    with pytest.raises(il.InvalidInput, match="did you mean 'couplings'"):
        il.catalogue("coupling")


def test_page_is_what_the_catalogue_says(script):
    page = ROOT / "docs" / "catalogue.md"
    assert page.read_text(encoding="utf-8") == script.page(), "run docs/figures/catalogue.py"


def test_all_that_has_a_force_is_drawn(script):
    for family, examples in script.EXAMPLES.items():
        drawn = {name for name, component in examples.items() if type(component).__name__ == name}
        assert drawn == set(examples)
        for entry in il.catalogue(family):
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
    place, force = script.curve("couplings", il.JenkinsCoupling(2.0, slip_force=1.0))
    assert np.abs(force).max() == pytest.approx(1.0)
