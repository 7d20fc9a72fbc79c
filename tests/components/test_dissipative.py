"""Restitutions of the bundled laws in free collisions: against closed forms, and against other solutions."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import impactlab as il

SPEED, MASS = 0.7, 1.3


def of(law, speed=SPEED):
    return law.restitution_at(speed, MASS)


def solved(pull, states=(), rates=None, speed=SPEED):
    """The same of the equations of a law, ``pull(δ, δ', *states)``, whose states have rates."""

    def right_side(t, y):
        inside = max(y[0], 0.0)
        more = rates(inside, y[1], *y[2:]) if rates else []
        return [y[1], -pull(inside, y[1], *y[2:]) / MASS, *more]

    def opens(t, y):
        return y[0]

    opens.terminal, opens.direction = True, -1.0
    options = {"method": "Radau", "rtol": 1e-10, "atol": 1e-14, "max_step": 1e-3, "events": opens}
    return -solve_ivp(right_side, (0.0, 1.0), [0.0, speed, *states], **options).y_events[0][0][1] / speed


@pytest.mark.parametrize("law", [il.HertzContact(1e5), il.LinearContact(1e5), il.AdhesiveContact(1e5, pull_off=3.0)])
def test_what_has_a_potential_loses_nothing(law):
    assert of(law) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("ratio", [0.05, 0.5, 0.9])
def test_spring_and_dashpot_with_and_without_tension(ratio):
    """Without tension the bodies are free from where the force vanishes (Schwager and Pöschel)."""
    law = il.KelvinVoigtContact.from_damping_ratio(1e4, ratio, MASS, tension=True)
    decay = ratio / math.sqrt(1.0 - ratio**2)
    assert of(law) == pytest.approx(math.exp(-decay * math.pi), abs=1e-9)
    assert of(law.replace(tension=False)) == pytest.approx(math.exp(-2.0 * decay * math.acos(ratio)), abs=1e-9)


def test_a_strong_dashpot_lets_go_only_where_it_cannot_pull():
    law = il.KelvinVoigtContact.from_damping_ratio(1e4, 2.0, MASS)
    root = math.sqrt(3.0)
    assert of(law) == pytest.approx(math.exp(-4.0 * math.acosh(2.0) / root), abs=1e-9)
    assert of(law.replace(tension=True)) == 0.0


@pytest.mark.parametrize("alpha", [0.2, 1.0, 2.0])
def test_tsujis_restitution_is_that_of_its_closed_form_at_all_velocities(alpha):
    law = il.TsujiContact(1e5, damping=alpha * math.sqrt(MASS * 1e5), tension=True)
    exact = math.exp(-math.pi * alpha / math.sqrt(5.0 - alpha**2))
    for speed in (0.01, 10.0):
        assert of(law, speed) == pytest.approx(exact, abs=1e-9)
    free = law.replace(tension=False)
    assert of(free, 0.01) == pytest.approx(of(free, 10.0), abs=1e-9)
    assert of(free) > exact


@pytest.mark.full
@pytest.mark.parametrize("wanted", [0.2, 0.5, 0.9])
def test_jankowskis_damping_ratio_gives_nearly_the_restitution(wanted):
    ratio = 4.5 * math.sqrt(5.0) * (1.0 - wanted**2) / (wanted * (wanted * (9.0 * math.pi - 16.0) + 16.0))
    law = il.JankowskiContact.from_damping_ratio(1e5, ratio, MASS)
    assert of(law) == pytest.approx(wanted, abs=0.01)
    damping = law.damping
    assert of(law) == pytest.approx(
        solved(lambda x, v: 1e5 * x**1.5 + damping * x**0.25 * v if v > 0.0 else 1e5 * x**1.5), abs=1e-7
    )


LOSSES = {  # (δ'₀ χ of Hunt and Crossley, how far the restitution may be off what is given)
    il.LankaraniNikraveshContact: (lambda e: 0.75 * (1.0 - e**2), 0.6),
    il.HertzdampContact: (lambda e: 0.75 * (1.0 - e**2), 0.6),
    il.FloresContact: (lambda e: 1.6 * (1.0 - e) / e, 0.05),
    il.GonthierContact: (lambda e: (1.0 - e**2) / e, 0.04),
    il.CarvalhoMartinsContact: (lambda e: 1.5 * (1.0 - e) * (11.0 - e) / (1.0 + 9.0 * e), 0.03),
}


@pytest.mark.parametrize("given", [0.1, 0.5, 0.9])
@pytest.mark.parametrize("cls", LOSSES, ids=lambda cls: cls.__name__)
def test_laws_by_the_closing_velocity_have_the_restitution_of_hunt_and_crossley(cls, given):
    """For any exponent ``(1 + e) c = ln((1 + c)/(1 − e c))``, with the number c of the publication."""
    loss, tolerance = LOSSES[cls][0](given), LOSSES[cls][1]
    law = cls(1e5, restitution=given)
    found = of(law)
    assert (1.0 + found) * loss == pytest.approx(math.log((1.0 + loss) / (1.0 - found * loss)), rel=1e-6)
    assert of(law, 10.0) == pytest.approx(found, abs=1e-9)
    assert found == pytest.approx(given, abs=tolerance)
    if given == 0.5 and "exponent" in cls.field_names():
        assert of(law.replace(exponent=2.5)) == pytest.approx(found, abs=1e-9)
        same = il.HuntCrossleyContact(1e5, dissipation=loss / SPEED, exponent=1.2)
        assert of(same) == pytest.approx(found, abs=1e-9)


@pytest.mark.parametrize("cls", LOSSES, ids=lambda cls: cls.__name__)
def test_damping_by_the_closing_velocity_is_limited(cls):
    """A load may move bodies faster than they have closed, however slowly that was."""
    loss, law = LOSSES[cls][0](0.5), cls(1e5, restitution=0.5, closing=1e-9)
    elastic = 1e5 * 0.01**1.5
    found = law.evaluate(0.01, [-2.0, -1e-9, 0.0, 5e-10, 1e-9, 2.0])
    parts = loss * np.array([-1.0, -1.0, 0.0, 0.5, 1.0, 1.0])
    np.testing.assert_allclose(found, elastic * np.maximum(1.0 + parts, 0.0), rtol=1e-12)


@pytest.mark.parametrize("cls", [il.FloresContact, il.GonthierContact])
def test_a_restitution_of_0_is_refused_where_the_damping_would_be_infinite(cls):
    with pytest.raises(il.InvalidInput, match=r"restitution must be larger than 0, not 0.0"):
        cls(1e5, restitution=0.0)


def test_walton_and_brauns_restitution_is_the_root_of_the_stiffnesses():
    law = il.WaltonBraunContact(1e4, unloading=4e4)
    for speed in (0.01, 10.0):
        assert of(law, speed) == pytest.approx(0.5, abs=1e-9)
    with pytest.raises(il.InvalidInput, match=r"unloading must be at least the stiffness of loading, 10000 N m-1"):
        law.replace(unloading=9e3)


@pytest.mark.parametrize("ratio", [0.5, 1.5, 10.0, 100.0])
def test_thorntons_restitution_is_that_of_his_formula(ratio):
    """In terms of the velocity over that at which yielding begins."""
    law = il.ThorntonContact(1e6, yield_indentation=1e-3)
    speed = math.sqrt(0.8 * 1e6 * 1e-3**2.5 / MASS)
    r = min(1.0 / ratio, 1.0)
    slope = r / (r + 2.0 * math.sqrt(1.2 - 0.2 * r**2))
    exact = math.sqrt(1.2 * math.sqrt(3.0) * (1.0 - r**2 / 6.0)) * slope**0.25
    assert of(law, ratio * speed) == pytest.approx(exact, abs=1e-9)


def test_a_dent_is_forgotten_when_the_contact_opens():
    """And not before: what loads again goes along the line of unloading."""
    law = il.WaltonBraunContact(1e4, unloading=4e4, largest=0.1)
    assert law.evaluate([0.05, 0.1, 0.2]).tolist() == pytest.approx([0.0, 1e3, 2e3])
    assert [law.update(place, 0.1) for place in (-0.01, 0.05, 0.2)] == [0.0, 0.1, 0.2]


class StandardSolid(il.ContactLaw):
    """Spring beside a Maxwell element, by its exact motion along a straight way."""

    stiffness: float = il.parameter(units="N m-1")
    more: float = il.parameter(units="N m-1")
    relaxation: float = il.parameter(units="s")
    pull: float = il.state(0.0, units="N")
    last: float = il.state(0.0, units="m")

    restitution_field = "more"

    def force(indentation, stiffness, pull):
        return stiffness * indentation + pull

    def update(indentation, elapsed, more, relaxation, pull, last):
        inside, time = max(indentation, 0.0), elapsed / relaxation
        return pull * math.exp(-time) + more * (inside - last) * (-math.expm1(-time) / time if time else 1.0), inside


def test_states_that_relax_follow_their_equation():
    law = StandardSolid(1e4, more=2e4, relaxation=0.01)
    exact = solved(lambda x, v, pull: 1e4 * x + pull, [0.0], lambda x, v, pull: [2e4 * v - pull / 0.01])
    assert 0.3 < exact < 0.8
    assert of(law) == pytest.approx(exact, abs=2e-6)


LAWS = [
    il.KelvinVoigtContact(1e4, damping=0.0), il.TsujiContact(1e4, damping=3.0), il.JankowskiContact(1e5, damping=1.0),
    il.HuntCrossleyContact(1e5, dissipation=0.1), il.FloresContact(1e5, restitution=0.9),
    il.GonthierContact(1e5, restitution=0.2), il.CarvalhoMartinsContact(1e5, restitution=0.5),
    il.WaltonBraunContact(1e4, unloading=2e4), il.ThorntonContact(1e6, yield_indentation=1e-3),
]  # fmt: skip


@pytest.mark.full
@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
def test_a_calibrated_law_has_the_restitution(law):
    found = law.calibrate(restitution=0.5, velocity=SPEED, mass=MASS)
    assert of(found) == pytest.approx(0.5, abs=1e-9)
    assert found == law.replace(**{law.restitution_field: getattr(found, law.restitution_field)})


def test_the_approximate_formula_of_hunt_and_crossley_is_far_off():
    typed = il.HuntCrossleyContact(1e5, dissipation=1.5 * (1.0 - 0.5) / SPEED)
    assert of(typed) == pytest.approx(0.663, abs=5e-4)
    assert of(typed.calibrate(restitution=0.5, velocity=SPEED, mass=MASS)) == pytest.approx(0.5, abs=1e-9)


def test_what_cannot_be_had_is_refused_with_the_reason():
    law = il.LankaraniNikraveshContact(1e5, restitution=0.5)
    with pytest.raises(il.InvalidInput, match=r"cannot have the restitution 0.5: for restitution from .* to 1 it has"):
        law.calibrate(restitution=0.5, velocity=1.0, mass=1.0)
    with pytest.raises(il.InvalidInput, match=r"HertzContact cannot be calibrated: it has no field that changes"):
        il.HertzContact(1e4).calibrate(restitution=0.5, velocity=1.0, mass=1.0)
    with pytest.raises(il.InvalidInput, match=r"restitution must be more than 0 and less than 1, not 1"):
        law.calibrate(restitution=1.0, velocity=1.0, mass=1.0)
    with pytest.raises(il.InvalidInput, match=r"mass must be larger than 0 kg, not 0"):
        law.restitution_at(1.0, 0)
    with pytest.raises(il.InvalidInput, match=r"stiffness must be at least 0 N m-1, not -1.0"):
        il.KelvinVoigtContact.from_damping_ratio(-1.0, 0.1, mass=1.0)
    with pytest.raises(il.InvalidInput, match=r"does not stop a mass that closes with 1 m s-1"):
        il.HertzContact(0.0).restitution_at(1.0, 1.0)
