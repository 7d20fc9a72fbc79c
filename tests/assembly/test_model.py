"""Models: from names to slots and arrays."""

import numpy as np
import pytest
from laws import TabulatedContact
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

import impactlab as il
from impactlab.assembly.generate import generate
from impactlab.assembly.members import HEADER, PLACES, Kind
from impactlab.assembly.model import Model
from impactlab.compiling.build import build
from impactlab.compiling.force_type import evaluate

HERTZ, LINEAR = il.HertzContact(1e4), il.LinearContact(50.0)


class Ramp(il.Excitation):
    slope: float = il.parameter(units="N s-1")

    def force(time, slope):
        return slope * time


class Decaying(il.Excitation):
    density: float = il.parameter(units="N2 s rad-1")

    def intensity(time, density):
        return density * np.exp(-time)


class Damped(il.ContactLaw):
    damping: float = il.parameter(units="N s m-1")

    def force(rate, damping):
        return damping * rate


class Named(il.ContactLaw):
    name: str = il.parameter("steel")

    def force(indentation, name):
        return indentation


def network():
    return il.Network(
        oscillators={
            "free": il.LinearOscillator(mass=2.0),
            "duffing": il.DuffingOscillator(3.0, damping=0.5, stiffness=4.0),
            "alone": il.LinearOscillator(stiffness=7.0),
            "last": il.LinearOscillator(),
        },
        contacts={
            "one": il.Contact("free", "duffing", HERTZ, clearance=0.1),
            "two": il.Contact(il.WALL, "free", LINEAR, clearance=0.2),
            "three": il.Contact("duffing", "last", HERTZ.replace(stiffness=2e4), clearance=-0.3),
        },
        excitations={
            "last": il.WhiteNoise(5.0),
            "free": il.WhiteNoise(2.0),
            "alone": Ramp(0.5),
            "duffing": il.ShinozukaNoise(1.0),
        },
    )


def rows(model, kind):
    """Unpack the indices and the parameters of the members of a kind as the generated text does."""
    at, width = PLACES + HEADER * model.members.kinds.index(kind), len(kind.parameters)
    count, first = model.members.indices[at : at + HEADER]
    indices, parameters = [], []
    for begin, members, start in model.members.indices[first : first + 3 * count].reshape(count, 3):
        indices += range(begin, begin + members)
        parameters += model.members.parameters[start : start + width * members].reshape(width, members).T.tolist()
    return indices, parameters


def test_slots_follow_the_names():
    model = Model.of(network())
    assert model.bodies.names == ("free", "duffing", "alone", "last")
    assert model.contacts.names == ("one", "two", "three")
    assert model.wall == 4
    assert model.ends.pairs.tolist() == [[0, 1], [4, 0], [1, 3]]
    assert model.mass.tolist() == [2.0, 1.0, 1.0, 1.0]
    assert model.damping.tolist() == [0.0, 0.5, 0.0, 0.0]
    assert model.stiffness.tolist() == [0.0, 4.0, 7.0, 0.0]
    assert model.clearance.tolist() == [0.1, 0.2, -0.3]
    driven = {kind: sources.bodies for kind, sources in model.sources.items() if sources.bodies}
    assert driven == {"intensity": (0, 3), "lines": (1,), "force": (2,)}


def test_rows_of_each_kind():
    model = Model.of(network())
    assert rows(model, Kind("force", il.HertzContact, "force")) == (
        [0, 2],
        [[0.1, 1e4], [-0.3, 2e4]],
    )
    assert rows(model, Kind("force", il.LinearContact, "force")) == ([1], [[0.2, 50.0]])
    assert rows(model, Kind("residual", il.DuffingOscillator, "residual")) == ([1], [[3.0]])
    assert rows(model, Kind("forcing", Ramp, "force")) == ([0], [[0.5]])
    assert rows(model, Kind("intensity", il.WhiteNoise, "intensity")) == ([0, 1], [[2.0], [5.0]])
    assert len(model.members.parameters) == 2 * 2 + 2 + 1 + 1 + 2


@pytest.mark.full
def test_laws_with_rows_of_numbers():
    """Of several lengths, behind the weights of combinations; equal rows are there once."""
    laws = [TabulatedContact(row, distance=0.2) for row in ([0.0, 1.0, 4.0], [0.0, 3.0], [0.0, 1.0, 4.0])]
    ends = [il.Combination({"a": 1.0, "b": 0.5}), "b", "c"]
    contacts = {f"{k}": il.Contact(ends[k], il.WALL, law, clearance=0.1 * k) for k, law in enumerate(laws)}
    model = Model.of(il.Network(dict.fromkeys("abc", il.LinearOscillator()), contacts))
    assert model.members.samples.tolist() == [0.0, 1.0, 4.0, 0.0, 3.0]
    x = np.random.default_rng(1).uniform(-0.5, 1.0, (1, 4, 50))
    found, indentation, total = np.zeros((1, 3, 50)), np.zeros((1, 3, 50)), np.zeros((1, 4, 50))
    members = model.members
    evaluate(build(generate(model)).forces, x, 0.0 * x, members.parameters, members.indices, indentation, found, total)
    gaps = [x[0, 0] + 0.5 * x[0, 1], x[0, 1] - 0.1, x[0, 2] - 0.2]
    np.testing.assert_allclose(found[0], [law.evaluate(gap) for law, gap in zip(laws, gaps, strict=True)], rtol=1e-12)


def test_kinds_do_not_depend_on_the_order_of_members():
    one = network()
    other = il.Network(*({name: family[name] for name in reversed(family)} for family in (
        one.oscillators, one.contacts, one.excitations)))  # fmt: skip
    assert Model.of(one).members.kinds == Model.of(other).members.kinds


def test_what_a_scene_needs():
    plain = Model.of(il.chain(2, il.LinearOscillator(), HERTZ, excitation=il.WhiteNoise(1.0)))
    assert not plain.kicks.dissipative
    assert not plain.noise.varying
    assert Model.of(il.chain(2, il.LinearOscillator(), Damped(1.0))).kicks.dissipative
    assert Model.of(il.chain(1, il.LinearOscillator(), HERTZ, excitation=Decaying(1.0))).noise.varying


def test_bodies_that_are_not_linear():
    assert Model.of(network()).kicks.nonlinear.tolist() == [True, True, False, True]


def test_connected_parts():
    """Walls do not connect."""
    body = il.LinearOscillator()
    names = "abcd"
    contacts = {
        "ab": il.Contact("a", "b", HERTZ),
        "bw": il.Contact("b", il.WALL, HERTZ),
        "wc": il.Contact(il.WALL, "c", HERTZ),
    }
    labels = Model.of(il.Network(dict.fromkeys(names, body), contacts)).connected
    assert labels[0] == labels[1]
    assert len(set(labels.tolist())) == 3


def test_intensities():
    model = Model.of(network())
    assert model.noise.intensity.tolist() == [2.0, 0.0, 0.0, 5.0]
    assert model.noise.reference_intensity.tolist() == [2.0, 0.0, 0.0, 5.0]
    varying = Model.of(network().replace(excitations={"last": Decaying(5.0)}))
    np.testing.assert_allclose(varying.noise.at(1.0), [2.0, 0.0, 0.0, 5.0 * np.exp(-1.0)], rtol=1e-15)
    assert varying.noise.reference_intensity.tolist() == [1.0, 0.0, 0.0, 1.0]


def test_no_contacts_and_no_excitations():
    model = Model.of(il.Network({"a": il.LinearOscillator()}))
    assert model.members.kinds == ()
    assert model.ends.pairs.shape == (0, 2)
    assert model.members.parameters.size == 0
    assert model.connected.tolist() == [0]


def test_a_kernel_that_takes_a_text_is_refused():
    with pytest.raises(il.InvalidInput, match=r"Named.name, which a kernel takes, must be a number, not 'steel'"):
        Model.of(il.chain(2, il.LinearOscillator(), Named()))


def test_connected_parts_of_random_networks():
    """The same parts as scipy finds in the graph of the contacts between bodies."""
    generator = np.random.default_rng(5)
    body = il.LinearOscillator(stiffness=1.0)
    for _ in range(50):
        count = int(generator.integers(1, 25))
        names = [f"body_{index}" for index in range(count)]
        ends = generator.integers(0, count + 1, (int(generator.integers(0, 30)), 2))
        ends = ends[ends[:, 0] != ends[:, 1]]
        sides = [*names, il.WALL]
        contacts = {f"c{k}": il.Contact(sides[a], sides[b], HERTZ) for k, (a, b) in enumerate(ends)}
        labels = Model.of(il.Network(dict.fromkeys(names, body), contacts)).connected
        between = ends[(ends < count).all(axis=1)]
        graph = coo_array((np.ones(len(between)), (between[:, 0], between[:, 1])), shape=(count, count))
        parts, expected = connected_components(graph, directed=False)
        assert sorted(set(labels.tolist())) == list(range(parts))
        np.testing.assert_array_equal(labels[:, None] == labels, expected[:, None] == expected)
