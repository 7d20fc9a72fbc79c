"""Components: definition, fields, kernels, and the errors of each."""

import dataclasses

import numpy as np
import pytest

import impactlab as il
from impactlab.inputs import suggestion


class Spring(il.ContactLaw):
    stiffness: float = il.parameter(units="N m-1", minimum=0.0)
    rest: float = il.parameter(0.5, units="m", above=0.0, maximum=2.0)
    count: int = il.parameter(1, minimum=1)
    stiff: bool = il.parameter(False)
    label: str = il.parameter("spring")
    places: tuple[float, ...] = il.parameter((), units="m", minimum=0.0)

    def force(indentation, rate, stiffness, rest):
        return stiffness * indentation + rest * rate


def define(source):
    """Define a class from the text of its body, which follows the name of the base."""
    base, _, body = source.partition(":")
    scope = {"il": il}
    exec(f"class Bad(il.{base}):\n    stiffness: float = il.parameter(1.0)\n    {body.strip()}", scope)
    return scope["Bad"]


def test_first_field_by_position_and_the_others_by_name():
    assert Spring(2.0, rest=0.25) == Spring(stiffness=2.0, rest=0.25)
    with pytest.raises(il.InvalidInput, match=r"takes 1 value\(s\) by position, not 2.*rest"):
        Spring(2.0, 0.25)


def test_inherited_fields_stay_keywords():
    with pytest.raises(il.InvalidInput, match="takes 0"):
        il.LinearOscillator(1.0)
    assert il.DuffingOscillator(3.0).cubic == 3.0


def test_fields_have_their_declared_type():
    spring = Spring(np.float32(2), count=np.int64(3), stiff=np.bool_(True))
    assert [type(value) for value in dataclasses.astuple(spring)] == [float, float, int, bool, str, tuple]


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({}, r"Spring needs stiffness \(N m-1\)"),
        ({"stiffness": -1.0}, r"Spring.stiffness must be at least 0 N m-1, not -1.0"),
        ({"stiffness": np.nan}, r"Spring.stiffness must be a finite number, not nan"),
        ({"stiffness": np.inf}, r"must be a finite number, not inf"),
        ({"stiffness": "1"}, r"Spring.stiffness must be a number, not '1'"),
        ({"stiffness": True}, r"must be a number, not True"),
        ({"stiffness": None}, r"must be a number, not None"),
        ({"stiffness": np.ones(2)}, r"must be a number, not array"),
        ({"stiffness": 1.0, "rest": 0.0}, r"Spring.rest must be larger than 0 m, not 0.0"),
        ({"stiffness": 1.0, "rest": 3.0}, r"Spring.rest must be at most 2 m, not 3.0"),
        ({"stiffness": 1.0, "count": 1.5}, r"Spring.count must be a whole number, not 1.5"),
        ({"stiffness": 1.0, "count": True}, r"Spring.count must be a whole number, not True"),
        ({"stiffness": 1.0, "count": 0}, r"Spring.count must be at least 1"),
        ({"stiffness": 1.0, "stiff": 1}, r"Spring.stiff must be true or false, not 1"),
        ({"stiffness": 1.0, "label": 1}, r"Spring.label must be a string, not 1"),
        ({"stiffness": 1.0, "places": (0.0, np.nan)}, r"Spring.places must hold finite numbers only"),
        ({"stiffness": 1.0, "places": [0.0, -1.0]}, r"Spring.places must be at least 0 m, not -1.0"),
        ({"stiffness": 1.0, "places": (np.float32(-1),)}, r"Spring.places must be at least 0 m"),
        ({"stifness": 1.0}, r"Spring has no field 'stifness'; did you mean 'stiffness'\?"),
        ({"stiffness": 1.0, "q": 1.0}, r"Spring has no field 'q'; allowed are 'stiffness', 'rest'"),
    ],
)
def test_bad_field(fields, message):
    with pytest.raises(il.InvalidInput, match=message) as caught:
        Spring(**fields)
    assert isinstance(caught.value, ValueError)


def test_replace_checks_again():
    assert Spring(1.0).replace(rest=1.0).rest == 1.0
    with pytest.raises(il.InvalidInput, match=r"rest must be larger"):
        Spring(1.0).replace(rest=-1.0)


def test_repr_leaves_out_defaults():
    assert repr(Spring(1.0, label="x")) == "Spring(stiffness=1.0, label='x')"


def test_bare_function_becomes_a_static_method():
    assert Spring.force(2.0, 3.0, 10.0, 0.1) == pytest.approx(20.3, rel=1e-15)
    assert isinstance(vars(Spring)["force"], staticmethod)
    assert Spring.kernel("force")[1:] == (("indentation", "rate"), ("stiffness", "rest"))


def test_call_broadcasts_over_arrays():
    law = Spring(10.0, rest=0.1)
    value = law.call("force", np.array([[1.0], [2.0]]), np.array([0.0, 3.0]))
    np.testing.assert_allclose(value, [[10.0, 10.3], [20.0, 20.3]], rtol=1e-15)
    assert il.WhiteNoise(3.0).call("intensity", np.zeros(4)).tolist() == [3.0] * 4


def test_a_kernel_may_take_a_number_that_follows_from_fields():
    class Sized(Spring):
        @property
        def size(self):
            return 2.0 * self.rest

        def force(indentation, size):
            return size * indentation

    assert Sized(1.0, rest=0.25).evaluate(3.0) == 1.5


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("ContactLaw: def force(self, indentation): pass", r"Bad.force must not take self.*Name the fields"),
        (
            "ContactLaw: def force(indentation, stifness): pass",
            r"'stifness' that is neither kinematic nor a field; did you mean 'stiffness'\?",
        ),
        ("ContactLaw: def force(rate, indentation): pass", r"kinematic arguments come first and in order"),
        ("ContactLaw: def force(stiffness, indentation): pass", r"kinematic arguments come first"),
        ("ContactLaw: def force(indentation, stiffness=1.0): pass", r"stiffness=1.0 is not a plain argument"),
        ("ContactLaw: def force(*arguments): pass", r"\*arguments is not a plain argument"),
        ("ContactLaw: def force(indentation, *, stiffness): pass", r"stiffness is not a plain argument"),
        ("ContactLaw: def force(**fields): pass", r"\*\*fields is not a plain argument"),
        ("ContactLaw: def potential(indentation, rate): pass", r"'rate' that is neither"),
        ("ContactLaw: force = 3.0", r"Bad.force must be a plain function of scalars, not 3.0"),
        ("ContactLaw: force = property(lambda indentation: 1.0)", r"must be a plain function of scalars"),
        ("Oscillator: def residual(velocity, displacement): pass", r"in order: residual\(displacement, velocity"),
        ("Oscillator: def residual_potential(displacement, velocity): pass", r"'velocity' that is neither"),
        ("Excitation: def intensity(indentation): pass", r"'indentation' that is neither"),
        (
            "Excitation: intensity = staticmethod(lambda time: 1.0); force = staticmethod(lambda time: 1.0)",
            r"Bad defines intensity and force; an excitation must define exactly one of",
        ),
        (
            "Excitation: lines = lambda self: ([1.0], [1.0]); force = staticmethod(lambda time: 1.0)",
            r"Bad defines force and lines",
        ),
    ],
)
def test_error_when_a_class_is_defined(source, message):
    with pytest.raises(il.InvalidInput, match=message):
        define(source)


def test_excitation_that_adds_a_second_kind_to_its_parent():
    with pytest.raises(il.InvalidInput, match=r"intensity and force"):

        class Both(il.WhiteNoise):
            def force(time):
                return time


def test_kernels_of_a_family_that_a_class_may_drop():
    class NotConservative(il.HertzContact):
        potential = None

    assert not NotConservative.has_kernel("potential")
    assert il.HertzContact.has_kernel("potential")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: il.ContactLaw(), r"ContactLaw is abstract: it does not define force"),
        (lambda: define("ContactLaw: other = 1")(), r"Bad is abstract: it does not define force"),
        (lambda: il.Excitation(), r"Excitation is abstract"),
        (lambda: define("Excitation: other = 1")(), r"Bad is abstract"),
        (lambda: il.Oscillator(), r"Oscillator is abstract: use LinearOscillator"),
        (lambda: il.Integrator(), r"Integrator is abstract"),
        (lambda: il.Record(), r"Record is abstract"),
    ],
)
def test_abstract_class(make, message):
    with pytest.raises(il.InvalidInput, match=message):
        make()


@pytest.mark.parametrize(
    ("family", "data", "message"),
    [
        (il.ContactLaw, {"type": "HerzContact"}, r"'HerzContact' is defined; did you mean 'HertzContact'\?"),
        (il.ContactLaw, {"type": "WhiteNoise", "spectral_density": 1.0}, r"'WhiteNoise' is not a ContactLaw"),
        (il.ContactLaw, {"type": "HertzContact"}, r"HertzContact needs stiffness"),
        (il.ContactLaw, {"type": "HertzContact", "stiffness": 1.0, "n": 2}, r"has no field 'n'"),
        (il.HertzContact, {"stiffness": -1.0}, r"must be at least 0"),
    ],
)
def test_from_dict_refuses(family, data, message):
    with pytest.raises(il.InvalidInput, match=message):
        family.from_dict(data)


def test_name_defined_in_two_modules_is_ambiguous():
    scope = {"il": il, "__name__": "somewhere_else"}
    text = "class Twice(il.Oscillator):\n    extra: float = il.parameter(0.0)"
    exec(text, {"il": il, "__name__": "somewhere"})
    exec(text, scope)
    with pytest.raises(il.InvalidInput, match=r"once \(somewhere, somewhere_else\); write 'somewhere\.Twice'"):
        il.Oscillator.from_dict({"type": "Twice", "extra": 1.0})
    data = scope["Twice"](1.0).to_dict()
    assert data == {"type": "somewhere_else.Twice", "mass": 1.0, "damping": 0.0, "stiffness": 0.0, "extra": 1.0}
    assert type(il.Oscillator.from_dict(data)) is scope["Twice"]


def test_a_name_of_a_bundled_class_that_is_not_loaded_is_ambiguous_too(run_python):
    text = """
import impactlab as il
class FloresContact(il.ContactLaw):
    stiffness: float = il.parameter(units="N", minimum=0.0)
    force = lambda indentation, stiffness: stiffness * indentation
print(FloresContact(2.0).to_dict()["type"])
try:
    il.ContactLaw.from_dict({"type": "FloresContact", "stiffness": 1.0})
except il.InvalidInput as error:
    print(error)
"""
    own, refused = run_python("-c", text).splitlines()
    assert own == "__main__.FloresContact"
    assert "defined more than once (__main__, impactlab.components.dissipative)" in refused


def test_suggestion_without_anything_known():
    assert suggestion("x", []) == "none is allowed here"
