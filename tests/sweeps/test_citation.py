"""What to cite follows from the components that were used."""

from __future__ import annotations

import pytest
import xarray as xr

import impactlab as il
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
    with pytest.raises(il.InvalidInput, match="Give a dataset returned by simulate"):
        il.citation(BODY)
