"""Networks: composition, validation, change, text."""

import json
import pickle

import numpy as np
import pytest

import impactlab as il

BODY = il.LinearOscillator(stiffness=4.0)
LAW = il.HertzContact(1e4)
NOISE = il.WhiteNoise(1.0)
SPRING = il.Coupling("a", "b", il.LinearCoupling(20.0, damping=0.5))


def pair(**changes):
    parts = {
        "oscillators": {"a": BODY, "b": il.DuffingOscillator(3.0, damping=0.5)},
        "contacts": {"gap": il.Contact("a", "b", LAW, clearance=0.1), "stop": il.Contact("b", il.WALL, LAW)},
        "excitations": {"a": NOISE},
    }
    return il.Network(**{**parts, **changes})


def test_members_cannot_be_changed():
    network = pair()
    for name in ("oscillators", "contacts", "excitations", "couplings"):
        family = getattr(network, name)
        with pytest.raises(TypeError):
            family["a"] = BODY
        with pytest.raises(AttributeError):
            setattr(network, name, {})
    with pytest.raises(AttributeError):
        network.other = 1


def test_later_changes_of_what_was_given_do_not_matter():
    bodies = {"a": BODY, "b": BODY}
    network = il.Network(bodies)
    del bodies["b"]
    assert list(network.oscillators) == ["a", "b"]


def test_pairs_do_as_well_as_mappings():
    assert il.Network([("a", BODY)], excitations=iter([("a", NOISE)])) == il.Network({"a": BODY}, {}, {"a": NOISE})


def test_value():
    assert pair() == pair()
    assert hash(pair()) == hash(pair())
    assert pair() != pair(excitations={})
    assert pair() != pair(contacts={"gap": il.Contact("a", "b", LAW, clearance=0.2)})
    assert pair(couplings={"s": SPRING}) == pair(couplings={"s": SPRING}) != pair()
    assert pair() != "pair"
    assert len({pair(), pair(), pair(excitations={})}) == 2


def test_order_of_names_is_kept_and_matters():
    one, other = (il.Network(dict.fromkeys(names, BODY)) for names in ("ba", "ab"))
    assert list(one.oscillators) == ["b", "a"]
    assert one != other


@pytest.mark.parametrize("couplings", [{}, {"s": SPRING, "w": il.Coupling(il.WALL, "a", SPRING.law)}])
def test_copies(couplings):
    network = pair(couplings=couplings)
    assert pickle.loads(pickle.dumps(network)) == network
    data = json.loads(json.dumps(network.to_dict(), allow_nan=False))
    assert il.Network.from_dict(data) == network
    assert list(il.Network.from_dict(data).oscillators) == list(network.oscillators)


def test_from_dict_of_bodies_alone_and_of_unknown_parts():
    assert il.Network.from_dict({"oscillators": {"a": BODY.to_dict()}}) == il.Network({"a": BODY})
    before_couplings = {name: family for name, family in pair().to_dict().items() if name != "couplings"}
    assert il.Network.from_dict(before_couplings) == pair()
    with pytest.raises(il.InvalidInput, match="no 'oscilators'; did you mean 'oscillators'"):
        il.Network.from_dict({"oscilators": {}})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"oscillators": {}}, r"at least one oscillator; none was given"),
        ({"oscillators": {"": BODY}}, r"oscillators: a name must be a non-empty string, not ''"),
        ({"oscillators": {" ": BODY}}, r"oscillators: a name must be a non-empty string, not ' '"),
        ({"oscillators": {1: BODY}}, r"oscillators: a name must be a string, not 1"),
        ({"oscillators": [("a", BODY), ("a", BODY)]}, r"oscillators: the name 'a' was given twice"),
        ({"contacts": [("c", il.Contact("a", "b", LAW))] * 2}, r"contacts: the name 'c' was given twice"),
        ({"contacts": {"": il.Contact("a", "b", LAW)}}, r"contacts: a name must be a non-empty string"),
        (
            {"oscillators": {"a": LAW}},
            r"oscillators\['a'\] must be an il.Oscillator, an il.Structure or an il.PrescribedMotion, not HertzContact",
        ),
        (
            {"oscillators": {"a": il.LinearOscillator}},
            r"oscillators\['a'\] must be an il.Oscillator, an il.Structure or an il.PrescribedMotion, not <class",
        ),
        ({"contacts": {"c": LAW}}, r"contacts\['c'\] must be an il.Contact or an il.RoundContact, not HertzContact"),
        (
            {"excitations": {"a": 16.0}},
            r"excitations\['a'\] must be an il.Excitation, an il.Source or an il.BaseMotion, not 16.0",
        ),
        (
            {"contacts": {"c": il.Contact("a", "x", LAW)}},
            r"Contact 'c' names a body 'x' that is not in the network; allowed are 'a', 'b'",
        ),
        (
            {"contacts": {"c": il.Contact("a", "wall", LAW)}},
            r"body 'wall' that is not in the network; the wall is il.WALL, in a file \{wall = true\}",
        ),
        ({"contacts": {"c": il.Contact("A", "b", LAW)}}, r"names a body 'A' that is not in the network"),
        ({"couplings": {"c": LAW}}, r"couplings\['c'\] must be an il.Coupling, not HertzContact"),
        (
            {"couplings": {"c": il.Coupling("a", "x", SPRING.law)}},
            r"Coupling 'c' names a body 'x' that is not in the network; allowed are 'a', 'b'",
        ),
        (
            {"excitations": {"c": NOISE}},
            r"'c', which is not in the network \(.* il\.Source\(…, on=…\), or an il\.BaseMotion .*; allowed are 'a'",
        ),
    ],
)
def test_bad_network(changes, message):
    with pytest.raises(il.InvalidInput, match=message):
        pair(**changes)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((BODY,), r"oscillators must be .* LinearOscillator"),
        ((3,), r"oscillators must be .* not 3"),
        (("ab",), r"oscillators must be .* not 'ab'"),
        (([BODY, BODY],), r"oscillators\[0\] must be"),
        (({"a": BODY}, il.Contact("a", il.WALL, LAW)), r"contacts must be"),
        (({"a": BODY}, None, NOISE), r"excitations must be"),
    ],
)
def test_what_is_not_a_family(arguments, message):
    with pytest.raises(il.InvalidInput, match=message):
        il.Network(*arguments)


def test_replace_changes_adds_and_removes():
    network = pair()
    stiffer = network.replace(oscillators={"a": BODY.replace(stiffness=9.0)})
    assert stiffer.oscillators["a"].stiffness == 9.0
    assert network.oscillators["a"].stiffness == 4.0
    assert list(stiffer.oscillators) == ["a", "b"]
    larger = network.replace(oscillators={"c": BODY}, contacts={"new": il.Contact("b", "c", LAW)})
    assert list(larger.oscillators) == ["a", "b", "c"]
    assert list(larger.contacts) == ["gap", "stop", "new"]
    smaller = network.replace(oscillators={"b": None}, contacts={"gap": None, "stop": None})
    assert smaller == il.Network({"a": BODY}, {}, {"a": NOISE})
    coupled = network.replace(couplings={"s": SPRING})
    assert dict(coupled.couplings) == {"s": SPRING}
    assert coupled.replace(couplings={"s": None}) == network
    assert network.replace() == network


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"oscillators": {"bb": None}}, r"no oscillator 'bb' to remove; did you mean 'b'\?"),
        ({"contacts": {"gab": None}}, r"no contact 'gab' to remove; did you mean 'gap'\?"),
        ({"excitations": {"b": None}}, r"no excitation 'b' to remove"),
        ({"couplings": {"s": None}}, r"no coupling 's' to remove"),
        ({"oscillators": {"b": None}}, r"Contact 'gap' names a body 'b' that is not in the network"),
        ({"oscillators": {"a": None, "b": None}, "contacts": {"gap": None, "stop": None}}, r"at least one"),
        ({"contacts": {"new": il.Contact("a", "z", LAW)}}, r"names a body 'z'"),
    ],
)
def test_bad_replace(changes, message):
    with pytest.raises(il.InvalidInput, match=message):
        pair().replace(**changes)


def test_chain_of_equal_bodies():
    network = il.chain(3, BODY, LAW, clearance=0.05, excitation=NOISE)
    assert network == il.Network(
        {f"body_{k}": BODY for k in range(3)},
        {f"contact_{k}": il.Contact(f"body_{k}", f"body_{k + 1}", LAW, clearance=0.05) for k in range(2)},
        {f"body_{k}": NOISE for k in range(3)},
    )


def test_chain_between_walls_of_different_members():
    bodies = [BODY.replace(mass=mass) for mass in (1.0, 2.0)]
    laws = [LAW, il.LinearContact(5.0), LAW]
    network = il.chain(2, bodies, laws, clearance=(0.1, 0.2, -0.3), excitation=[None, NOISE], walls=True)
    assert list(network.oscillators.values()) == bodies
    assert list(network.contacts.values()) == [
        il.Contact(il.WALL, "body_0", laws[0], clearance=0.1),
        il.Contact("body_0", "body_1", laws[1], clearance=0.2),
        il.Contact("body_1", il.WALL, laws[2], clearance=-0.3),
    ]
    assert dict(network.excitations) == {"body_1": NOISE}


def test_chain_of_a_number_from_an_array():
    count = np.array([2])[0]
    assert il.chain(count, BODY, il.HertzContact(1.0)) == il.chain(2, BODY, il.HertzContact(1.0))


def test_chain_of_one_body():
    assert il.chain(1, BODY, LAW) == il.Network({"body_0": BODY})
    assert len(il.chain(1, BODY, LAW, walls=True).contacts) == 2


@pytest.mark.parametrize("bodies", [0, -1, 2.0, True, "2", None])
def test_bad_number_of_bodies(bodies):
    with pytest.raises(il.InvalidInput, match=r"chain: bodies must be a whole number of at least 1"):
        il.chain(bodies, BODY, LAW)


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        (([BODY] * 2, LAW), {}, r"chain: oscillator must be a single one for all or a sequence of 3, not of 2"),
        ((BODY, [LAW] * 3), {}, r"chain: law must be a single one for all or a sequence of 2, not of 3"),
        ((BODY, [LAW] * 2), {"walls": True}, r"chain: law must be .* 4, not of 2"),
        ((BODY, LAW), {"clearance": [0.1]}, r"chain: clearance must be .* 2, not of 1"),
        ((BODY, LAW), {"excitation": [NOISE]}, r"chain: excitation must be .* 3, not of 1"),
        ((LAW, BODY), {}, r"must be"),
        ((BODY, LAW), {"clearance": float("nan")}, r"chain: clearance must be a finite number"),
    ],
)
def test_bad_chain(arguments, options, message):
    with pytest.raises(il.InvalidInput, match=message):
        il.chain(3, *arguments, **options)


def test_repr_is_short_and_readable(golden):
    golden("network.repr.txt", repr(pair()) + "\n")
    assert repr(il.Network({"a": BODY})).splitlines()[0] == "Network: 1 body, no contacts, no excitations"
    lines = repr(pair(couplings={"s": SPRING})).splitlines()
    assert lines[0] == "Network: 2 bodies, 2 contacts, 1 coupling, 1 excitation"
    assert lines[-2:] == ["  couplings", "    s: Coupling('a', 'b', LinearCoupling(stiffness=20.0, damping=0.5))"]


def test_repr_of_ten_thousand_bodies():
    names = list(map(str, range(10_000)))
    contact = il.Contact("0", "1", LAW)
    text = repr(il.Network(*(dict.fromkeys(names, member) for member in (BODY, contact, NOISE))))
    assert text.startswith("Network: 10000 bodies, 10000 contacts, 10000 excitations\n")
    assert len(text.splitlines()) == 25
    assert text.count("… and 9994 more") == 3
