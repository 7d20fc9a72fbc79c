"""Pictures of networks, and the helpers of figures."""

from __future__ import annotations

import matplotlib
import numpy as np
import pytest
import xarray as xr
from matplotlib import pyplot
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle

import impactlab as il
from impactlab.plotting.captions import words
from impactlab.plotting.drawing import draw_network
from impactlab.plotting.layout import BODIES
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


@pytest.mark.parametrize(
    ("component", "text"),
    [
        (LAW, "Hertz contact"),
        (il.HuntCrossleyContact(1.0, dissipation=0.1), "Hunt–Crossley contact"),
        (il.BoucWenCoupling(1.0, yield_displacement=1.0), "Bouc–Wen coupling"),
        (il.PowerLawDampingCoupling(1.0, exponent=0.5), "Power law damping coupling"),
        (il.WhiteNoise(1.0), "White noise"),
    ],
)
def test_names_of_classes_are_words(component, text):
    assert words(component) == text


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


@pytest.mark.full
def test_long_chains_are_shortened():
    figure = drawn(draw_network(il.chain(1000, BODY, LAW)))
    shown = texts(figure)
    assert "and 993 more bodies, 994 more contacts" in shown
    names = [name for name in (f"body_{number}" for number in range(1000)) if name in shown.split()]
    assert names == ["body_0", "body_1", "body_2", "body_3", "body_997", "body_998", "body_999"]
    assert "\N{MIDLINE HORIZONTAL ELLIPSIS}" in shown


def place_of(figure, text):
    (found,) = (item for item in figure.axes[0].texts if item.get_text().split("\n")[0] == text)
    return found.get_position()


def test_any_number_of_gaps_and_couplings_between_two_bodies():
    contacts = il.backlash("a", "b", LAW, clearance=0.01, name="play") | {
        "stop": il.Contact("a", "b", LAW, clearance=0.5)
    }
    tie = il.Coupling("b", "a", il.LinearCoupling(10.0, damping=0.2))
    figure = drawn(draw_network(il.Network(dict.fromkeys("ab", BODY), contacts, {}, {"tie": tie})))
    x, heights = zip(*(place_of(figure, name) for name in ("play_upper", "play_lower", "stop", "tie")), strict=True)
    assert len(set(x)) == 1
    assert (np.diff(heights) < -0.3).all()
    assert texts(figure).count("0.01 m") == 2
    assert "stiffness = 10 N m$^{-1}$\ndamping = 0.2 N s m$^{-1}$" in texts(figure)


def test_links_of_bodies_apart_and_of_combinations_lie_below_the_row():
    ring = {"ab": ("a", "b"), "bc": ("b", "c"), "ca": ("c", "a")}
    contacts = {name: il.Contact(*ends, LAW) for name, ends in ring.items()}
    contacts["lever"] = il.Contact(il.Combination({"a": 1.0, "b": -0.5}), "c", LAW, clearance=0.02)
    figure = drawn(draw_network(il.Network(dict.fromkeys("abc", BODY), contacts)))
    assert place_of(figure, "ab")[1] == place_of(figure, "bc")[1] > 0.0 > place_of(figure, "ca")[1]
    assert "lever\na − 0.5 b with c, 0.02 m" in texts(figure)
    for weight in ("× 1", "× −0.5", "× −1"):
        assert weight in texts(figure)


@pytest.mark.full
def test_too_many_links_apart_are_named():
    contacts = {f"c{name}": il.Contact("hub", name, LAW) for name in "pqrstu"}
    figure = drawn(draw_network(il.Network(dict.fromkeys(["hub", *"pqrstu"], BODY), contacts)))
    assert "Not drawn: cu" in texts(figure)
    assert "Not drawn: ct" not in texts(figure)


def test_stops_of_inner_bodies_and_couplings_to_the_wall_are_below_them():
    contacts = {
        "ab": il.Contact("a", "b", LAW), "bc": il.Contact("b", "c", LAW),
        "right": il.Contact("b", il.WALL, LAW, clearance=0.1), "end": il.Contact("c", il.WALL, LAW, clearance=0.2),
    }  # fmt: skip
    held = il.Coupling("a", il.WALL, il.MaxwellCoupling(3.0, damping=2.0))
    figure = drawn(draw_network(il.Network(dict.fromkeys("abc", BODY), contacts, {}, {"held": held})))
    assert place_of(figure, "right")[1] < place_of(figure, "held")[1] < 0.0
    assert place_of(figure, "end")[0] > place_of(figure, "c")[0]
    assert "Maxwell coupling" in texts(figure)


def test_structures_have_points_where_something_acts():
    beam = il.ModalStructure((10.0, 60.0), 0.02, points={"tip": (2.0, -2.0), "middle": (0.7, 1.4), "root": (0.1, 0.1)})
    tower = il.LinearStructure((2.0, 2.0), np.zeros((2, 2)), [[20.0, -10.0], [-10.0, 10.0]], names=("floor", "roof"))
    network = il.Network(
        {"beam": beam, "a": BODY, "tower": tower},
        {"hit": il.Contact("beam.tip", "a", LAW), "pound": il.Contact("a", "tower.roof", LAW)},
        {"beam.middle": il.WhiteNoise(1.0)},
        {"tie": il.Coupling("beam.middle", "tower.floor", il.LinearCoupling(3.0))},
    )
    figure = drawn(draw_network(network))
    for part in ("2 modes\n10 to 60 rad s$^{-1}$", "2 coordinates", "tip", "roof", "at middle\nWhite noise"):
        assert part in texts(figure)
    assert "root" not in texts(figure)
    assert place_of(figure, "beam")[0] < place_of(figure, "tip")[0] < place_of(figure, "hit")[0]
    assert place_of(figure, "pound")[0] < place_of(figure, "roof")[0] < place_of(figure, "tower")[0]


def test_sources_of_several_bodies_and_motions_of_the_ground():
    figure = drawn(draw_network(il.Network(dict.fromkeys("abc", BODY), {}, {
        "a": il.WhiteNoise(1.0), "wind": il.Source(il.WhiteNoise(2.0), on={"a": 1.0, "c": -2.0}),
        "gust": il.Source(il.Harmonic(1.0, frequency=2.0), on={"b": 3.0}),
        "quake": il.BaseMotion(il.WhiteNoise(0.1)),
        "slip": il.BaseMotion(il.WhiteNoise(0.1), on={"a": 1.0, "c": -0.5}),
    })))  # fmt: skip
    for part in (
        "wind: White noise, $S$ = 2",
        "× 1",
        "× −2",
        "gust, 3 times\nHarmonic",
        "quake: base motion, White noise",
        "slip: base motion of a, −0.5 c, White noise",
    ):
        assert part in texts(figure)
    assert (
        place_of(figure, "quake: base motion, White noise")[1] < place_of(figure, "a")[1] < place_of(figure, "× −2")[1]
    )


def test_axes_that_are_returned():
    axes = il.plot.network(il.Network({"a": BODY}))
    assert axes.texts
    assert axes.figure.number in pyplot.get_fignums()
    pyplot.close(axes.figure)


def test_into_axes_that_are_given():
    figure = Figure()
    axes = figure.subplots(2)
    assert draw_network(il.Network({"a": BODY}), axes[1]) is figure
    assert axes[1].texts
    assert not axes[0].texts


def test_letters_shrink_with_the_axes():
    network = il.Network({"a": BODY})
    whole = draw_network(network)
    small = Figure(figsize=0.5 * whole.get_size_inches())
    drawn = draw_network(network, small.add_axes((0.0, 0.0, 1.0, 1.0)))
    sizes = [[text.get_fontsize() for text in figure.axes[0].texts] for figure in (whole, drawn)]
    assert sizes[0][0] == 10.0
    np.testing.assert_allclose(sizes[1], 0.5 * np.array(sizes[0]))


def test_only_networks_are_drawn():
    with pytest.raises(il.InvalidInput, match=r"is of an il\.Network"):
        draw_network(BODY)


def test_the_style_ends_with_its_context():
    before = dict(matplotlib.rcParams)
    with style():
        assert matplotlib.rcParams["axes.prop_cycle"].by_key()["color"] == list(COLORS)
    assert dict(matplotlib.rcParams) == before


def test_the_style_keeps_what_is_none_of_its_own():
    """A backend that pyplot switches on meanwhile changes ``interactive``."""
    with matplotlib.rc_context({"interactive": False, "font.size": 13.0}):
        with style():
            pyplot.ion()
        assert matplotlib.is_interactive()
        axes = il.plot.network(il.Network({"a": BODY}))
        assert matplotlib.is_interactive()
        assert matplotlib.rcParams["font.size"] == 13.0
        pyplot.close(axes.figure)


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


def test_round_contacts_are_discs_in_circles():
    round_contact = il.RoundContact(
        ("x", "y"), il.WALL, LAW, clearance=0.1, friction_coefficient=0.3, friction_velocity=1e-3
    )
    network = il.Network(dict.fromkeys(("x", "y"), BODY), {"rub": round_contact})
    figure = drawn(draw_network(network))
    circles = [item for item in figure.axes[0].patches if isinstance(item, Circle)]
    assert len(circles) == 3  # the wall, its inside, and the disc
    for line in ("rub", "(x, y) in the wall", "clearance = 0.1 m", "Hertz contact", "friction coefficient = 0.3"):
        assert line in texts(figure)
    assert "Not drawn" not in texts(figure)
    many = {f"rub {number}": round_contact for number in range(6)}
    assert texts(drawn(draw_network(network.replace(contacts=many)))).count("Not drawn") == 3


def test_names_are_no_formulas():
    name = r"$\frac{$"
    bodies = {name: BODY, "b": BODY, f"s{name}": il.ModalStructure((1.0,), 0.1, points={name: (1.0,)})}
    contacts = {
        f"c{name}": il.Contact(name, "b", LAW, clearance=0.1),
        f"l{name}": il.Contact(il.Combination({name: 1.0, "b": 0.5}), f"s{name}.{name}", LAW),
        f"r{name}": il.RoundContact((name, "b"), il.WALL, LAW, clearance=0.1),
    }
    excitations = {
        f"e{name}": il.Source(il.WhiteNoise(1.0), on={name: 1.0, f"s{name}.{name}": 2.0}),
        f"g{name}": il.BaseMotion(il.Harmonic(1.0, frequency=1.0), on=[name]),
    }
    network = il.Network(bodies, contacts, excitations)
    figure = draw_network(network)
    figure.canvas.draw()
    assert name in network._repr_html_()
    data = xr.Dataset(
        {"contact_ratio": (("p", "contact"), np.ones((2, 2)))}, {"p": [name, "b"], "contact": [name, "c"]}
    )
    for axes in (
        il.plot.sweep(data, "contact_ratio", name, ax=Figure().subplots()),
        il.plot.sweep(data, "contact_ratio", ax=Figure().subplots()),
    ):
        axes.figure.canvas.draw()
