"""What notebooks show of networks."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from time import process_time

import pytest

import impactlab as il

BODY = il.LinearOscillator(mass=2.0, damping=0.5, stiffness=50.0)
LAW = il.HertzContact(1e4)


class Cells(HTMLParser):
    """Collects the text of the elements of a table, and of what else stands outside the drawing."""

    def __init__(self, text):
        super().__init__()
        self.texts, self.tags, self.inside = [], [], 0
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.inside += tag == "svg"

    def handle_endtag(self, tag):
        self.inside -= tag == "svg"

    def handle_data(self, data):
        if not self.inside:
            self.texts.append(data)


def test_a_network_with_an_exact_law():
    network = il.Network(
        {"a <b>": BODY, "c": BODY}, {"gap": il.Contact("a <b>", "c", LAW, clearance=0.05)},
        {"a <b>": il.WhiteNoise(1.0), "c": il.WhiteNoise(1.0)},
    )  # fmt: skip
    html = network._repr_html_()
    cells = Cells(html)
    assert cells.tags.count("svg") == 1
    assert "<b>" not in cells.texts
    for cell in ("a <b>", "2 kg", "5 rad s⁻¹", "0.025", "6.28 J", "a <b> and c", "Hertz contact", "0.05 m"):
        assert cell in cells.texts, cell
    (step,) = (text for text in cells.texts if "ExactFlow()" in text)
    assert float(step.split(" s,")[0]) == pytest.approx(network.check().dataset.attrs["step"], rel=5e-3)
    assert " known exactly: il.exact(network)" in cells.texts
    assert html == il.plot.network_html(network)


def test_the_reasons_against_an_exact_law_are_listed():
    network = il.Network({"a": BODY}, {"stop": il.Contact("a", il.WALL, il.FloresContact(1e4, restitution=0.8))})
    cells = Cells(network._repr_html_())
    with pytest.raises(il.NoExactReference) as error:
        il.exact(network)
    reasons = [line.removeprefix("- ") for line in str(error.value).splitlines() if line.startswith("- ")]
    assert reasons
    assert set(reasons) <= set(cells.texts)
    assert "temperature" not in cells.texts  # a column without entries


def test_networks_without_step_or_contacts():
    free = Cells(il.Network({"free": il.LinearOscillator()})._repr_html_())
    assert " No step can be chosen: no body has stiffness or damping. Give step= (s)." in free.texts
    ball = il.Network({"ball": il.LinearOscillator()}, {"table": il.Contact(il.WALL, "ball", LAW)}, {
        "gravity": il.BaseMotion(il.ConstantForce(9.81)),
    })  # fmt: skip
    assert "free" in Cells(ball._repr_html_()).texts


def test_bodies_that_stops_alone_hold():
    beam = il.InvertedOscillator(3.0, stiffness=2.0, damping=0.1)
    stop = il.Contact("beam", il.WALL, LAW, clearance=0.1)
    network = il.Network({"beam": beam}, {"stop": stop, "other": stop.replace(first=il.WALL, second="beam")})
    with pytest.raises(il.NoExactReference):
        il.exact(network)
    assert "repulsion = 3" in network._repr_html_()


def test_long_chains_are_shortened_and_quick():
    network = il.chain(1000, BODY, LAW, excitation=il.WhiteNoise(1.0))
    begin = process_time()
    cells = Cells(network._repr_html_())
    assert process_time() - begin < 2.0  # 0.3 s, but for a machine that is busy
    assert "… 988 more" in cells.texts
    assert "… 987 more" in cells.texts
    assert not re.search("body_500", "".join(cells.texts))


def test_only_networks_are_described():
    with pytest.raises(il.InvalidInput, match=r"must be an il\.Network"):
        il.plot.network_html(BODY)
