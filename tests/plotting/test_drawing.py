"""Pictures of networks, and the helpers of figures."""

from __future__ import annotations

import matplotlib
import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

import impactlab as il
from impactlab.plotting.drawing import BODIES, draw_network
from impactlab.plotting.style import COLORS, band, number_text, points, style, units_text

BODY = il.LinearOscillator(mass=2.0, damping=0.5, stiffness=40.0)
LAW = il.HertzContact(1e4)


def texts(figure):
    return "\n".join(text.get_text() for text in figure.axes[0].texts)


def drawn(figure):
    """The figure can be rendered, and every text lies inside it."""
    figure.canvas.draw()
    box = figure.bbox
    for text in figure.axes[0].texts:
        if text.get_text():
            extent = text.get_window_extent()
            assert box.x0 <= extent.x0, text
            assert extent.x1 <= box.x1, text
            assert box.y0 <= extent.y0, text
            assert extent.y1 <= box.y1, text
    return figure


def test_a_pair_shows_all_its_parts():
    network = il.Network(
        {"one": BODY, "two": il.DuffingOscillator(3.0, stiffness=7.0)},
        {"gap": il.Contact("one", "two", LAW, clearance=0.05)},
        {"one": il.WhiteNoise(16.0)},
    )
    shown = texts(drawn(draw_network(network)))
    for part in ("one", "two", "2 kg", "$k$ = 40", "$c$ = 0.5", "$k$ = 7", "cubic = 3", "0.05 m"):
        assert part in shown
    for part in ("Hertz contact\n$10^{4}$", "White noise\n$S$ = 16 N$^{2}$ s rad$^{-1}$"):
        assert part in shown
    assert shown.count("$c$") == 1  # the second body has no damper


@pytest.mark.parametrize(
    "network",
    [
        il.Network({"alone": BODY}),
        il.Network({"free": il.LinearOscillator()}),
        il.Network({"a": BODY}, {"stop": il.Contact("a", il.WALL, LAW, clearance=-0.1)}),
        il.Network({"a": BODY}, {"stop": il.Contact(il.WALL, "a", LAW)}),
        il.chain(4, BODY, LAW, walls=True, excitation=il.ShinozukaNoise(1.0)),
        il.chain(BODIES, BODY, il.LinearContact(1e3), clearance=1e-5),
    ],
    ids=["one", "free", "wall right", "wall left", "chain between walls", "long chain"],
)
def test_networks_of_all_kinds_are_drawn(network):
    shown = texts(drawn(draw_network(network)))
    assert all(name in shown for name in network.oscillators)
    assert "Not drawn" not in shown


def test_bodies_stand_in_the_order_of_their_contacts():
    network = il.Network(dict.fromkeys("bca", BODY), {
        "first": il.Contact("a", "b", LAW, clearance=1.0),
        "second": il.Contact("b", "c", LAW, clearance=2.0),
    })  # fmt: skip
    figure = draw_network(network)
    place = {text.get_text(): text.get_position()[0] for text in figure.axes[0].texts}
    assert place["a"] < place["1 m"] < place["b"] < place["2 m"] < place["c"]


def test_what_is_not_drawn_is_named():
    long = texts(drawn(draw_network(il.chain(100, BODY, LAW))))
    assert "and 92 more bodies, 92 more contacts" in long
    ring = {"ab": ("a", "b"), "bc": ("b", "c"), "ca": ("c", "a")}
    network = il.Network(dict.fromkeys("abc", BODY), {name: il.Contact(*ends, LAW) for name, ends in ring.items()})
    assert "Not drawn: ca (c, a)" in texts(drawn(draw_network(network)))


def test_into_axes_that_are_given():
    figure = Figure()
    axes = figure.subplots(2)
    assert draw_network(il.Network({"a": BODY}), axes[1]) is figure
    assert axes[1].texts
    assert not axes[0].texts


def test_only_networks_are_drawn():
    with pytest.raises(il.InvalidInput, match=r"takes an il\.Network"):
        draw_network(BODY)


def test_the_style_ends_with_its_context():
    before = dict(matplotlib.rcParams)
    with style():
        assert matplotlib.rcParams["axes.prop_cycle"].by_key()["color"] == list(COLORS)
    assert dict(matplotlib.rcParams) == before


@pytest.mark.parametrize(
    ("units", "text"),
    [
        ("N s m-1", "N s m$^{-1}$"),
        ("N2 s rad-1", "N$^{2}$ s rad$^{-1}$"),
        ("N m-3/2", "N m$^{-3/2}$"),
        ("m", "m"),
        ("1", "1"),
    ],
)
def test_units(units, text):
    assert units_text(units) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0"), (20.106, "20.1"), (1e4, "$10^{4}$"), (10106.0, r"$1.01 \times 10^{4}$"), (-0.05, "−0.05")],
)
def test_numbers(value, text):
    assert number_text(value) == text


def test_bands_and_bars_are_two_standard_errors():
    axes = Figure().subplots()
    x, value, error = np.arange(3.0), np.array([1.0, 2.0, 4.0]), np.array([0.1, 0.2, 0.3])
    band(axes, x, value, error, label="band", color=COLORS[1])
    (area,) = (item for item in axes.collections if isinstance(item, PolyCollection))
    y = area.get_paths()[0].vertices[:, 1]
    assert (y.min(), y.max()) == pytest.approx((0.8, 4.6))
    points(axes, x, value, error, label="points")
    (bars,) = (item for item in axes.collections if not isinstance(item, PolyCollection))
    ends = np.array([segment[:, 1] for segment in bars.get_segments()])
    np.testing.assert_allclose(ends, np.stack([value - 2.0 * error, value + 2.0 * error], axis=1))
