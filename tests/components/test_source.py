"""Sources: one excitation of several bodies, described."""

import json
import math
import pickle

import numpy as np
import pytest

import impactlab as il

BODY = il.LinearOscillator(mass=2.0, damping=1.0, stiffness=100.0)
NOISE = il.WhiteNoise(0.5)


def pair(**excitations):
    return il.Network({"a": BODY, "b": BODY}, None, excitations)


def test_copies():
    source = il.Source(NOISE, on={"b": -3.0, "a": 1})
    network = pair(ground=source, a=NOISE)
    assert il.Source.from_dict(json.loads(json.dumps(source.to_dict(), allow_nan=False))) == source
    assert il.Network.from_dict(json.loads(json.dumps(network.to_dict(), allow_nan=False))) == network
    assert pickle.loads(pickle.dumps(network)) == network
    assert len({network, pickle.loads(pickle.dumps(network)), pair(ground=source.replace(on="a"), a=NOISE)}) == 2
    assert eval(repr(source.on)) == {"b": -3.0, "a": 1.0}


def test_what_drives_a_body():
    network = pair(
        b=NOISE, ground=il.Source(NOISE, on={"a": -2.0, "b": 3.0}), wind=il.Source(il.WhiteNoise(2.0), on="b")
    )
    assert network.excitations_of("a") == [("ground", NOISE, -2.0)]
    assert network.excitations_of("b") == [("b", NOISE, 1.0), ("ground", NOISE, 3.0), ("wind", il.WhiteNoise(2.0), 1.0)]
    left = network.replace(excitations={"ground": None})
    assert list(left.excitations) == ["b", "wind"]


def test_weights_do_not_change():
    weights = {"a": 1.0}
    source = il.Source(NOISE, on=weights)
    weights["a"] = 2.0
    assert source.on["a"] == 1.0
    with pytest.raises(TypeError):
        source.on["a"] = 2.0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"on": {}}, r"Source.on is empty, so that it drives nothing"),
        ({"on": {"a": 0.0}}, r"the weight of 'a' is 0; leave it out"),
        ({"on": {"a": math.inf}}, r"the weight of 'a' must be a finite number, not inf"),
        ({"on": {"a": np.nan}}, r"the weight of 'a' must be a finite number, not nan"),
        ({"on": {"a": "1"}}, r"the weight of 'a' must be a number, not '1'"),
        ({"on": {1: 1.0}}, r"Source.on must be \{name of a body: weight\}, not \{1: 1.0\}"),
        ({"on": ["a", "b"]}, r"Source.on must be \{name of a body: weight\}, not \('a', 'b'\)"),
        ({"on": None}, r"Source.on must be \{name of a body: weight\}, not None"),
        ({}, r"Source needs on"),
        (
            {"excitation": 1.0, "on": "a"},
            r"Source.excitation must be an excitation such as il.WhiteNoise\(1.0\), not 1.0",
        ),
        ({"excitation": BODY, "on": "a"}, r"Source.excitation must be an excitation"),
    ],
)
def test_bad_source(arguments, message):
    with pytest.raises(il.InvalidInput, match=message):
        il.Source(**{"excitation": NOISE, **arguments})


@pytest.mark.parametrize(
    ("excitations", "message"),
    [
        (
            {"ground": il.Source(NOISE, on={"a": 1.0, "left": 1.0})},
            r"Source 'ground' drives 'left', which is not in the",
        ),
        ({"a": il.Source(NOISE, on={"a": 1.0, "b": 1.0})}, r"The source 'a' has the name of a body"),
        ({"ground": NOISE}, r"There is an excitation for 'ground', which is not in the network .*il\.Base"),
        ({"a": 16.0}, r"excitations\['a'\] must be an il.Excitation, an il.Source or an il.BaseMotion, not 16.0"),
    ],
)
def test_bad_network(excitations, message):
    with pytest.raises(il.InvalidInput, match=message):
        pair(**excitations)


def test_a_removed_body_is_missed():
    with pytest.raises(il.InvalidInput, match=r"Source 'ground' drives 'b', which is not in the network"):
        pair(ground=il.Source(NOISE, on={"a": 1.0, "b": 1.0})).replace(oscillators={"b": None})
