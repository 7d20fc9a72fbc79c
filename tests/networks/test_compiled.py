"""Compiled networks: the right-hand side, collisions with known solutions, labels."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from laws import Cosine
from scipy.integrate import solve_ivp, trapezoid
from scipy.special import beta

import impactlab as il


def right_hand_side(network, t, y):
    """The equations of motion, body by body and contact by contact, in plain Python."""
    names = list(network.oscillators)
    x = {**dict(zip(names, y, strict=False)), il.WALL: 0.0}
    v = {**dict(zip(names, y[len(names) :], strict=True)), il.WALL: 0.0}
    force = dict.fromkeys([*names, il.WALL], 0.0)
    for name, body in network.oscillators.items():
        force[name] -= body.stiffness * x[name] + body.damping * v[name]
        if isinstance(body, il.DuffingOscillator):
            force[name] -= body.cubic * x[name] ** 3
    for contact in network.contacts.values():
        gap = x[contact.first] - x[contact.second] - contact.clearance
        rate = v[contact.first] - v[contact.second]
        law = contact.law
        if gap > 0.0:
            if isinstance(law, il.HertzContact):
                pressure = law.stiffness * gap**1.5
            else:
                pressure = law.stiffness * gap + law.damping * rate
            force[contact.first] -= pressure
            force[contact.second] += pressure
    for name, excitation in network.excitations.items():
        if isinstance(excitation, Cosine):
            force[name] += excitation.amplitude * math.cos(excitation.frequency * t)
    return [*(v[name] for name in names), *(force[name] / network.oscillators[name].mass for name in names)]


positive = st.floats(0.1, 10.0)


@st.composite
def networks(draw):
    """Networks of any shape, with loops, walls on both sides and contacts side by side."""
    names = [f"body {k}" for k in range(draw(st.integers(2, 5)))]
    linear = {"mass": positive, "damping": positive, "stiffness": positive}
    duffing = st.builds(il.DuffingOscillator, cubic=positive, **linear)
    oscillator = st.builds(il.LinearOscillator, **linear) | duffing
    dashpot = st.builds(il.KelvinVoigtContact, stiffness=positive, damping=positive, tension=st.just(True))
    laws = st.builds(il.HertzContact, positive), dashpot
    ends = st.tuples(*[st.sampled_from([*names, il.WALL])] * 2).filter(lambda pair: pair[0] != pair[1])
    contacts = draw(st.just([]) | st.lists(st.tuples(ends, st.floats(-2.0, 1.0)), min_size=2, max_size=6))
    cosine = st.builds(Cosine, amplitude=positive, frequency=positive)
    noise = st.builds(il.WhiteNoise, positive)
    excitations = draw(st.dictionaries(st.sampled_from(names), cosine | noise))
    # each set of kinds is compiled once: there are two, with a Duffing body, a force and a noise always and both laws
    # or none
    return il.Network(
        {name: draw(oscillator if k else duffing) for k, name in enumerate(names)},
        {str(k): il.Contact(*pair, draw(laws[k % 2]), clearance=gap) for k, (pair, gap) in enumerate(contacts)},
        {**excitations, names[0]: draw(cosine), names[1]: draw(noise)},
    )


@pytest.mark.full
@settings(max_examples=40)
@given(networks(), st.integers(0, 1000))
def test_rhs_is_the_equation_of_motion(network, seed):
    compiled = network.compile()
    size = 2 * len(network.oscillators)
    for y in np.random.default_rng(seed).normal(size=(5, size)):
        # forces of up to about 1e3 may cancel: the tolerance is a part of them
        np.testing.assert_allclose(compiled.rhs(0.7, y), right_hand_side(network, 0.7, y), rtol=1e-12, atol=1e-11)


def test_noise_does_not_act(base_case):
    network = base_case()
    quiet = network.replace(excitations={"one": None, "two": il.ShinozukaNoise(1.0)})
    y = np.array([0.3, -0.1, 2.0, 1.0])
    assert network.compile().rhs(0.0, y).tolist() == quiet.compile().rhs(0.0, y).tolist()


# Collisions with known solutions

MASSES, SPEED, CLEARANCE = (1.0, 3.0), 2.0, 0.1
REDUCED = MASSES[0] * MASSES[1] / sum(MASSES)


def collide(law):
    """Let a free body run into another one that is at rest; return the solution and the network."""
    bodies = {name: il.LinearOscillator(mass=mass) for name, mass in zip("ab", MASSES, strict=True)}
    compiled = il.Network(bodies, {"gap": il.Contact("a", "b", law, clearance=CLEARANCE)}).compile()
    solution = solve_ivp(
        compiled.rhs, (0.0, 0.4), compiled.state(velocity={"a": SPEED}),
        method="DOP853", rtol=1e-12, atol=1e-13, max_step=1e-3, events=compiled.contact_events,
    )  # fmt: skip
    return compiled, solution


@pytest.mark.parametrize(
    ("law", "depth", "duration"),
    [
        # Half sine of the frequency sqrt(κ/μ).
        (
            il.LinearContact(2e3),
            SPEED * math.sqrt(REDUCED / 2e3),
            math.pi * math.sqrt(REDUCED / 2e3),
        ),
        # Johnson, Contact Mechanics, 1985, section 11.4: δ* = (5 μ V²/(4 η))^(2/5) and T = 2.943 δ*/V.
        (
            il.HertzContact(1e4),
            (1.25 * REDUCED * SPEED**2 / 1e4) ** 0.4,
            0.8 * beta(0.4, 0.5) * (1.25 * REDUCED * SPEED**2 / 1e4) ** 0.4 / SPEED,
        ),
    ],
)
def test_collision_of_free_bodies(law, depth, duration):
    compiled, solution = collide(law)
    (times,) = solution.t_events
    assert len(times) == 2
    assert times[0] == pytest.approx(CLEARANCE / SPEED, rel=1e-9)
    assert times[1] - times[0] == pytest.approx(duration, rel=1e-7)
    x, v = solution.y[:2], solution.y[2:]
    assert (x[0] - x[1] - CLEARANCE).max() == pytest.approx(depth, rel=1e-3)  # read at steps
    momentum = MASSES[0] * v[0] + MASSES[1] * v[1]
    np.testing.assert_allclose(momentum, MASSES[0] * SPEED, rtol=1e-10)
    centre = MASSES[0] * SPEED / sum(MASSES)
    np.testing.assert_allclose(v[:, -1], [2.0 * centre - SPEED, 2.0 * centre], rtol=1e-8)  # elastic rebound
    stored = law.call("potential", np.maximum(x[0] - x[1] - CLEARANCE, 0.0))
    energy = 0.5 * MASSES[0] * v[0] ** 2 + 0.5 * MASSES[1] * v[1] ** 2 + stored
    # a step of the solver over a closing leaves up to 5e-9, by where in it the force begins
    np.testing.assert_allclose(energy, 0.5 * MASSES[0] * SPEED**2, rtol=1e-8)
    force = compiled.to_dataset(solution.t, solution.y).contact_force.sel(contact="gap")
    assert trapezoid(force, solution.t) == pytest.approx(2.0 * REDUCED * SPEED, rel=1e-3)  # its impulse


def test_events_are_the_indentations():
    bodies = dict.fromkeys("ab", il.LinearOscillator())
    law = il.LinearContact(1.0)
    contacts = {
        "pair": il.Contact("a", "b", law, clearance=0.5),
        "right": il.Contact("a", il.WALL, law, clearance=0.25),
        "left": il.Contact(il.WALL, "b", law, clearance=2.0),
    }
    compiled = il.Network(bodies, contacts).compile()
    y = compiled.state(displacement={"a": 1.0, "b": -3.0})
    assert [event(0.0, y) for event in compiled.contact_events] == [3.5, 0.75, 1.0]


# States and labels


def test_state():
    compiled = il.Network(dict.fromkeys("abc", il.LinearOscillator())).compile()
    assert compiled.state().tolist() == [0.0] * 6
    y = compiled.state(displacement={"b": 1.5}, velocity={"c": -2, "a": 3.0})
    assert y.tolist() == [0.0, 1.5, 0.0, 3.0, 0.0, -2.0]


@pytest.mark.parametrize(
    ("given_state", "message"),
    [
        ({"displacement": {"bb": 1.0}}, r"no oscillator 'bb'; did you mean 'b'\?"),
        ({"velocity": {"b": np.nan}}, r"velocity\['b'\] must be a finite number"),
        ({"displacement": {"b": "1"}}, r"displacement\['b'\] must be a number"),
    ],
)
def test_bad_state(given_state, message):
    compiled = il.Network({"b": il.LinearOscillator()}).compile()
    with pytest.raises(il.InvalidInput, match=message):
        compiled.state(**given_state)


def test_labels(base_case):
    compiled = base_case().compile()
    t = np.linspace(0.0, 1.0, 5)
    y = np.arange(20.0).reshape(4, 5)
    data = compiled.to_dataset(t, y)
    assert dict(data.sizes) == {"time": 5, "oscillator": 2, "contact": 1}
    assert data.displacement.sel(oscillator="two").values.tolist() == y[1].tolist()
    assert data.velocity.sel(oscillator="one").values.tolist() == y[2].tolist()
    assert data.time.values.tolist() == t.tolist()
    units = {str(name): data[name].attrs["units"] for name in ("time", "displacement", "velocity", "contact_force")}
    assert units == {"time": "s", "displacement": "m", "velocity": "m s-1", "contact_force": "N"}


def test_labels_without_contacts():
    data = il.Network({"a": il.LinearOscillator()}).compile().to_dataset(np.zeros(1), np.zeros((2, 1)))
    assert "contact_force" not in data
    assert "contact" not in data.coords
