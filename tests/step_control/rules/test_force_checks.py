"""Laws that are not finite, return nothing, or are not functions: refused, or the run stops and says which."""

import math

import numpy as np
import pytest

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.step_control.rules import force_checks

BODY = il.LinearOscillator(stiffness=10.0, damping=1.0)
SHORT = {"duration": 20.0, "realizations": 64, "rng": 1}


class NoNumber(il.ContactLaw):
    @staticmethod
    def force(indentation):
        return math.nan


class Infinite(il.ContactLaw):
    @staticmethod
    def force(indentation):
        return math.inf


class Enormous(il.ContactLaw):
    @staticmethod
    def force(indentation):
        return 1e300


class Singular(il.ContactLaw):
    @staticmethod
    def force(indentation):
        return -math.log(indentation)


class Cap(il.ContactLaw):
    """The square root of a negative number beyond a depth; Python refuses what compiled code makes NaN."""

    depth: float = il.parameter(units="m")

    @staticmethod
    def force(indentation, depth):
        return 1e2 * indentation * math.sqrt(depth - indentation)


class Ending(il.ContactLaw):
    """Infinite beyond a depth, or with `beyond` 0 not a number."""

    depth: float = il.parameter(units="m")
    beyond: float = il.parameter(1.0, units="N")

    @staticmethod
    def force(indentation, depth, beyond):
        return 100.0 * indentation if indentation <= depth else beyond * math.inf


class Hindered(il.ContactLaw):
    """Not a number where the contact opens."""

    @staticmethod
    def force(indentation, rate):
        return math.nan if rate < 0.0 else 100.0 * indentation


class Rough(il.ContactLaw):
    @staticmethod
    def force(indentation):
        return 100.0 * indentation * (1.0 + 0.1 * np.random.rand())  # noqa: NPY002  (a user's mistake)


class Two(il.ContactLaw):
    @staticmethod
    def force(indentation, rate):
        return indentation, rate


class RandomCoupling(il.CouplingLaw):
    @staticmethod
    def force(extension):
        return extension + np.random.rand()  # noqa: NPY002


class BrokenCoupling(il.CouplingLaw):
    @staticmethod
    def force(extension):
        return math.nan


class BrokenBody(il.Oscillator):
    @staticmethod
    def residual(displacement):
        return math.nan


def wall(law, clearance=0.2):
    return il.Network({"a": BODY}, {"w": il.Contact("a", il.WALL, law, clearance=clearance)}, {"a": il.WhiteNoise(1.0)})


REFUSED = {
    NoNumber(): r"contact 'w', NoNumber\(\), is nan N at an indentation of 0 m",
    Infinite(): r"contact 'w', Infinite\(\), is inf N at an indentation of 0 m",
    Enormous(): r"contact 'w', Enormous\(\), is 1e\+300 N at an indentation of 0 m",
    Singular(): r"contact 'w', Singular\(\), is nan N at an indentation of 0 m",
    Cap(0.01): r"contact 'w', Cap\(depth=0\.01\), is nan N at an indentation of 0\.01\d* m, which this network reaches",
    Hindered(): r"Hindered\(\), is nan N at an indentation of 0 m and a rate of -\d\.\d* m/s",
    Rough(): r"the kernel Rough\.force reads 'np\.random', which is no function of scalars",
    Two(): r"Two\.force failed for Two\(\) at indentation = .*, rate = .*: TypeError: it returned \(.*\), not a number",
}


@pytest.mark.parametrize("law", REFUSED, ids=lambda law: type(law).__name__)
def test_a_contact_that_has_no_finite_force_is_refused(law, monkeypatch, capfd):
    monkeypatch.setattr("impactlab.simulation.growing_ensemble.run", lambda *_: pytest.fail("was compiled and run"))
    for step in (None, 0.01):
        with pytest.raises(il.InvalidInput, match=REFUSED[law]):
            il.simulate(wall(law), **SHORT, step=step)
    with pytest.raises(il.InvalidInput, match=REFUSED[law]):
        wall(law).check()
    assert capfd.readouterr() == ("", "")


@pytest.mark.full
@pytest.mark.parametrize("law", [Ending(0.3, beyond=0.0), Ending(0.3)], ids=["undefined", "unbounded"])
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"integrator": il.ExactFlow(jumps=False)},
        {"step": 0.01},
        {"integrator": il.EulerMaruyama(), "step": 1e-3},
        {"integrator": il.RungeKutta4(), "step": 1e-3},
        {"realizations": 1, "duration": 400.0},
    ],
    ids=str,
)
def test_a_contact_that_ends_within_reach_stops_the_run_and_is_named(law, options):
    """The kick at the place to which such a force shifts the body is none: the contact would be as good as open."""
    found = rf"contact 'w', Ending\(depth=0\.3[^)]*\), is {math.inf * law.beyond} N at an indentation of 0\.30\d* m\."
    with pytest.raises(il.Diverged, match=r"'a' of realization \d+ left .*The force of " + found):
        il.simulate(wall(law), on_divergence="raise", **{**SHORT, **options})


class Pole(il.ContactLaw):
    """Python divides by zero where compiled code goes on with infinity."""

    @staticmethod
    def force(indentation):
        return 100.0 * indentation if indentation < 0.3 else 1.0 / (indentation - indentation)


def test_a_law_that_fails_in_python_within_reach():
    with pytest.raises(
        il.InvalidInput, match=r"Pole\.force failed for Pole\(\) at indentation = [\d.e+]+: ZeroDivision"
    ):
        il.simulate(wall(Pole()), **SHORT)


@pytest.mark.full
def test_a_law_may_end_where_nothing_comes():
    far, endless = (il.simulate(wall(law), **SHORT, step=0.01) for law in (Ending(50.0), il.LinearContact(100.0)))
    for name in endless.data_vars:
        np.testing.assert_array_equal(far[name], endless[name], err_msg=name)


def test_forces_of_couplings_and_bodies():
    options = {**SHORT, "step": 0.01}
    pair = il.Network({"a": BODY, "b": BODY}, excitations={"a": il.WhiteNoise(1.0)})
    with pytest.raises(il.InvalidInput, match=r"coupling 's', BrokenCoupling\(\), is nan N at an extension of 0 m"):
        il.simulate(pair.replace(couplings={"s": il.Coupling("a", "b", BrokenCoupling())}), **options)
    with pytest.raises(il.InvalidInput, match=r"the kernel RandomCoupling\.force reads 'np\.random'"):
        il.simulate(pair.replace(couplings={"s": il.Coupling("a", "b", RandomCoupling())}), **options)
    with pytest.raises(il.InvalidInput, match=r"body 'b', BrokenBody\(.*\), is nan N at a displacement of 0 m"):
        il.simulate(pair.replace(oscillators={"b": BrokenBody(stiffness=1.0, damping=1.0)}), **options)


def test_many_equal_contacts_are_looked_at_once(monkeypatch):
    asked = []
    usual = force_checks.call_each
    monkeypatch.setattr(
        force_checks, "call_each", lambda members, *rest: asked.append(len(members)) or usual(members, *rest)
    )
    many = Model.of(il.chain(3000, BODY, il.HertzContact(1e4)))
    force_checks.check_forces(many, np.full(2999, 0.01), np.ones(3000))
    assert asked == [1]


# ruff: noqa: RET502, RET503, RET505  (what is looked at)


def no_return(indentation):
    pass


def one_branch(indentation):
    if indentation > 0.1:
        return 1e2 * indentation


def bare(indentation):
    if indentation > 0.1:
        return 1e2 * indentation
    return


def all_branches(indentation):
    if indentation > 0.1:
        return 1e2 * indentation
    elif indentation > 0.05:
        return indentation
    else:
        return 0.0


def raises(indentation):
    if indentation > 0.1:
        return 1e2 * indentation
    raise ValueError


@pytest.mark.parametrize("force", [no_return, one_branch, bare])
def test_a_kernel_that_forgets_its_return(force):
    with pytest.raises(il.InvalidInput, match=r"Law\.force may end without a value: every branch must return a number"):
        type("Law", (il.ContactLaw,), {"force": staticmethod(force)})


@pytest.mark.parametrize("force", [all_branches, raises])
def test_a_kernel_that_returns_in_every_branch(force):
    assert type("Law", (il.ContactLaw,), {"force": staticmethod(force)})().evaluate(0.2) == pytest.approx(20.0)


def helper(indentation):
    if indentation > 0.1:
        return indentation


class Helped(il.ContactLaw):
    @staticmethod
    def force(indentation):
        return helper(indentation)


def test_a_helper_that_forgets_its_return():
    with pytest.raises(il.InvalidInput, match=r"Helped\.force failed for .*it returned None; every branch must return"):
        il.simulate(wall(Helped()), **SHORT)
    with pytest.raises(il.InvalidInput, match="it returned None"):
        Helped().evaluate([0.05, 0.2])
