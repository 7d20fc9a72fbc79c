"""Networks as text: what is written is read again, and what is wrong is told with its line."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import impactlab as il
from impactlab.toml_text import lines_of, parsed_toml, value_text

WIDE = il.Network(
    {
        "one": il.LinearOscillator(stiffness=3.0, damping=0.1),
        'a "b"': il.DuffingOscillator(stiffness=1e-5, cubic=2e22),
        "frame": il.ModalStructure([1.0, 2.0], [0.01, 0.02], points={"top.mast": [1.0, 0.5]}),
        "tower": il.LinearStructure([[2.0, 0.0], [0.0, 1.0]], [[0.1, 0.0], [0.0, 0.1]], [[3.0, -1.0], [-1.0, 1.0]]),
    },
    {
        "gap = #1": il.Contact("one", il.Combination({'a "b"': 1.0, "frame.top.mast": -0.5}), il.HertzContact(1e4)),
        "stop]": il.Contact("one", il.WALL, il.RigidContact(0.5), clearance=0.05),
    },
    {
        "one": il.WhiteNoise(1.0),
        "quake": il.BaseMotion(il.SampledForce(np.linspace(0.0, 1.0, 50), np.sin(np.arange(50.0))), on=["one"]),
        "both": il.Source(il.Harmonic(1.0, frequency=3.0), on={'a "b"': 1.0, "one": -0.25}),
    },
    {"ü": il.Coupling("one", 'a "b"', il.BoucWenCoupling(2.0, yield_displacement=0.1))},
)

TEXT = """
[oscillators.one]
type = "LinearOscillator"
stiffness = 20.0

[oscillators."number two"]
type = "LinearOscillator"
mass = 2

[contacts.gap]
first = "one"
second = "number two"
law = {type = "HertzContact", stiffness = 1e4}

[couplings.spring]
first = "one"
second = {combination = {"number two" = 0.5}}

[couplings.spring.law]
type = "LinearCoupling"
stiffness = 3.0

[excitations.one]
type = "WhiteNoise"
spectral_density = 1.0
"""


def test_what_is_written_is_read_again():
    text = WIDE.to_toml()
    assert il.Network.from_toml(text) == WIDE
    assert "stiffness = 3.0  # N m-1" in text.splitlines()
    assert max(map(len, text.splitlines())) <= 104  # samples go over several lines


def test_a_file_is_read(tmp_path):
    path = tmp_path / "net.toml"
    path.write_text(TEXT + "\n[simulate]\nduration = 3.0\n", encoding="utf-8")
    network = il.Network.from_toml(path)
    assert network == il.Network.from_toml(str(path)) == il.Network.from_toml(TEXT)
    assert network.oscillators["number two"].mass == 2.0
    assert network.contacts["gap"] == il.Contact("one", "number two", il.HertzContact(1e4))
    with pytest.raises(il.InvalidInput, match=r"There is no file missing\.toml"):
        il.Network.from_toml("missing.toml")


@pytest.mark.parametrize(
    ("old", "new", "line", "key", "message"),
    [
        ("stiffness = 20", "stifness = 20", 4, "oscillators.one.stifness", "did you mean 'stiffness'"),
        ("stiffness = 20.0", 'stiffness = "x"', 4, "oscillators.one.stiffness", "must be a number, not 'x'"),
        ("mass = 2", "mass = -2", 8, 'oscillators."number two".mass', "must be larger than 0 kg"),
        ("LinearOscillator", "LinearOscilator", 3, "oscillators.one.type", "did you mean 'LinearOscillator'"),
        ("WhiteNoise", "HertzContact", 24, "excitations.one.type", "'HertzContact' is not a Excitation"),
        ("[oscillators.one]", "[oscilators.one]", 2, "oscilators", "did you mean 'oscillators'"),
        ('first = "one"', 'first = "oen"', 11, "contacts.gap.first", "did you mean 'one'"),
        ("law = {", "lwa = {", 13, "contacts.gap.lwa", "did you mean 'law'"),
        ("stiffness = 1e4", "stiff = 1e4", 13, "contacts.gap.law.stiff", "did you mean 'stiffness'"),
        ('"number two" = 0.5', '"number to" = 0.5', 17, "couplings.spring.second", "did you mean 'number two'"),
        ("stiffness = 3.0", "stiffness = nan", 21, "couplings.spring.law.stiffness", "finite"),
        ("[excitations.one]", "[excitations.oen]", 23, "excitations.oen", "did you mean 'one'"),
        ("spectral_density = 1.0", "", 23, "excitations.one", "needs spectral_density"),
    ],
)
def test_errors_name_line_and_key(old, new, line, key, message, tmp_path):
    assert old in TEXT
    path = tmp_path / "net.toml"
    path.write_text(TEXT.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(il.InvalidInput) as caught:
        il.Network.from_toml(path)
    told = str(caught.value)
    assert told.startswith(f"{path}, line {line}, {key}")
    assert message in told


def test_a_text_that_is_no_toml():
    with pytest.raises(il.InvalidInput, match=r"cannot be read as TOML: .*line 2"):
        il.Network.from_toml("[oscillators.a]\nmass = = 1\n")


SCALARS = st.booleans() | st.integers(-(2**63), 2**63 - 1) | st.floats(allow_nan=False) | st.text()
VALUES = st.recursive(SCALARS, lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner), max_leaves=8)


@pytest.mark.full
@settings(max_examples=40)
@given(VALUES)
def test_values_are_read_as_they_were_written(value):
    assert parsed_toml(f"value = {value_text(value)}", "text") == {"value": value}


def test_numbers_that_are_none_and_long_arrays():
    assert math.isnan(parsed_toml(f"value = {value_text(math.nan)}", "text")["value"])
    samples = [0.1 * number for number in range(1000)]
    text = value_text(samples)
    assert max(map(len, text.splitlines())) <= 101
    assert parsed_toml(f"value = {text}", "text")["value"] == samples


def test_lines_of_keys():
    text = '# a\n[a."b.c"]\nd . e = 1\n"f g" = [\n  1,\n]\n[ h ]\n'
    assert lines_of(text) == {("a", "b.c"): 2, ("a", "b.c", "d", "e"): 3, ("a", "b.c", "f g"): 4, ("h",): 7}


# components of other distributions


@pytest.fixture
def offer(tmp_path, monkeypatch):
    """Offer components by entry points, as an installed distribution does."""

    def offer(entries, **modules):
        folder = tmp_path / "strange-2.0.dist-info"
        folder.mkdir()
        (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: strange\nVersion: 2.0\n")
        (folder / "entry_points.txt").write_text("\n".join(["[impactlab.components]", *entries]))
        for name, text in modules.items():
            (tmp_path / f"{name}.py").write_text(text)
        monkeypatch.syspath_prepend(str(tmp_path))

    return offer


LAW = """
import impactlab as il
class {name}(il.ContactLaw):
    stiffness: float = il.parameter(units="N m-2", minimum=0.0)

    def force(indentation, stiffness):
        return stiffness * indentation * indentation
"""


def test_a_component_that_is_offered_is_found(offer):
    offer(["OfferedContact = offered_law:OfferedContact"], offered_law=LAW.format(name="OfferedContact"))
    network = il.Network.from_toml(TEXT.replace("HertzContact", "OfferedContact"))
    assert type(network.contacts["gap"].law).__module__ == "offered_law"
    with pytest.raises(il.InvalidInput, match="did you mean 'OfferedContact'"):
        il.Network.from_toml(TEXT.replace("HertzContact", "OferedContact"))


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ("AbsentContact = nowhere_at_all:AbsentContact", "ModuleNotFoundError: No module named 'nowhere_at_all'"),
        ("AbsentContact = misnamed_law:MisnamedContact", "misnamed_law:MisnamedContact is not a class of that name"),
    ],
)
def test_a_component_that_cannot_be_used_is_named(offer, entry, message):
    offer([entry], misnamed_law=LAW.format(name="MisnamedContact"))
    il.Network.from_toml(TEXT)  # nobody asks for it
    with pytest.raises(il.InvalidInput, match=r"line 13.*'AbsentContact' of strange 2\.0 cannot be used: ") as caught:
        il.Network.from_toml(TEXT.replace("HertzContact", "AbsentContact"))
    assert message in str(caught.value)


def test_a_file_imports_nothing_that_is_not_offered(offer):
    offer([], forbidden_law="raise SystemExit")
    with pytest.raises(il.InvalidInput, match="No component class named 'Contact' is defined"):
        il.Network.from_toml(TEXT.replace("HertzContact", "forbidden_law.Contact"))
