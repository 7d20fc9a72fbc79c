"""What to cite follows from the components that were used."""

from __future__ import annotations

import re

import pytest
import xarray as xr

import impactlab as il
from impactlab.components.component import Component
from impactlab.components.literature import in_one_line, parts
from impactlab.results.dataset import CONFIGURATION

BODY = il.LinearOscillator(stiffness=1.0, damping=0.1)


class OwnContact(il.LinearContact):
    citation = "@misc{own,\n  author = {Doe, J.},\n  title = {A contact},\n  year = 2020\n}"


class Heir(OwnContact):
    """Another law, which its parent's source does not describe."""


def network(law):
    return il.Network({"a": BODY}, {"stop": il.Contact("a", il.WALL, law)}, {"a": il.WhiteNoise(1.0)})


def keys(text):
    return [line.split("{")[1].rstrip(",") for line in text.splitlines() if line.startswith("@")]


def test_components_bring_their_sources():
    assert keys(il.citation(network(il.LinearContact(1.0)))) == ["impactlab"]
    two = network(il.HuntCrossleyContact(1.0, dissipation=0.1)).replace(excitations={"a": il.ShinozukaNoise(1.0)})
    assert keys(il.citation(two)) == ["impactlab", "hunt1975", "shinozuka1972"]
    both = two.replace(contacts={"other": il.Contact(il.WALL, "a", il.HuntCrossleyContact(2.0, dissipation=0.1))})
    assert il.citation(both) == il.citation(two)


def test_several_sources_of_one_component():
    soil = il.BaseMotion(il.CloughPenzien(1.0, 15.0, 0.6, 1.5, 0.6))
    shaken = network(il.LinearContact(1.0)).replace(excitations={"a": None, "ground": soil})
    assert keys(il.citation(shaken)) == ["impactlab", "kanai1957", "tajimi1960", "clough1993"]
    assert "@inproceedings{tajimi1960,\n  author = {Tajimi, H.}," in il.citation(shaken)
    assert keys(il.citation(shaken.replace(excitations={"a": il.WhiteNoise(1.0), "ground": None}))) == ["impactlab"]


def test_entries_have_no_empty_fields():
    text = il.JenkinsCoupling.citation
    assert text.splitlines() == [
        "@article{jenkins1962,",
        "  author = {Jenkins, G. M.},",
        "  journal = {Br. J. Appl. Phys.},",
        "  volume = {13},",
        "  pages = {30},",
        "  year = {1962},",
        "}",
    ]
    assert in_one_line([text]) == "Jenkins, G. M., Br. J. Appl. Phys. 13 (1962) 30"


def test_sources_have_a_key_of_their_own():
    def all_of(cls):
        yield from (entry for entry in parts(cls.citation) if cls.__module__.startswith("impactlab."))
        for heir in cls.__subclasses__():
            yield from all_of(heir)

    il.catalogue()  # imports all
    found = set(all_of(Component))
    assert len(found) > 25
    assert len({entry.partition("{")[2].partition(",")[0] for entry in found}) == len(found)
    for entry in found:
        assert {"author", "year"} <= set(re.findall(r"^  (\w+) = \{.+\},$", entry, re.MULTILINE)), entry


def test_classes_of_ones_own():
    assert il.citation(network(OwnContact(1.0))).endswith(OwnContact.citation)
    assert keys(il.citation(network(Heir(1.0)))) == ["impactlab"]


def test_results_say_what_they_rest_on(tmp_path):
    exact = il.exact(network(il.HertzContact(1.0))).statistics()
    assert keys(il.citation(exact)) == ["impactlab", "hertz1882"]
    assert exact.attrs["references"].startswith(f"impactlab {il.__version__}; Hertz, H., Ueber die")
    assert exact.attrs["references"].endswith("J. reine angew. Math. 92 (1882) 156")
    il.save(exact, tmp_path / "exact.nc")
    assert il.citation(tmp_path / "exact.nc") == il.citation(exact)


def test_points_of_a_sweep_count():
    points = [il.exact(network(law)).statistics() for law in (il.LinearContact(1.0), il.HertzContact(1.0))]
    texts = [item.attrs[CONFIGURATION] for item in points]
    swept = xr.Dataset({CONFIGURATION: ("law", texts)}, attrs={CONFIGURATION: '{"sweep": {}}'})
    assert keys(il.citation(swept)) == ["impactlab", "hertz1882"]


def test_what_has_no_components():
    with pytest.raises(il.InvalidInput, match=r"must be an il.Network, a Dataset"):
        il.citation(BODY)
