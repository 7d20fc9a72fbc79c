"""What every component promises. The classes are found, not listed."""

import copy
import dataclasses
import importlib
import json
import pickle
import pkgutil
import re

import numpy as np
import pytest
from scipy.integrate import quad

import impactlab as il
from impactlab.assembly.generate import generate
from impactlab.assembly.model import Model
from impactlab.compiling.build import build
from impactlab.compiling.force_type import evaluate
from impactlab.components.component import undefined
from impactlab.kernels.memory import with_states

for module in pkgutil.walk_packages(il.__path__, "impactlab."):
    if not module.name.endswith("__main__"):
        importlib.import_module(module.name)


def subclasses(family):
    """All bundled classes below a family that can be used, in the order of their names."""
    found = {family}
    for cls in family.__subclasses__():
        found |= set(subclasses(cls))
    usable = [cls for cls in found if cls.__module__.startswith("impactlab.") and not is_abstract(cls)]
    return sorted(usable, key=lambda cls: cls.__name__)


def is_abstract(cls):
    return cls in (il.Component, il.Oscillator) or bool(undefined(cls))


def type_of(field):
    return field.type if isinstance(field.type, str) else field.type.__name__


SAMPLES = {
    "ContactLaw": il.HertzContact(1e4), "CouplingLaw": il.LinearCoupling(1e3), "Excitation": il.WhiteNoise(1.0),
    "distribution": "expon", "carrier": il.Harmonic(1.5, frequency=5.0),
    "FilteredNoise": il.OrnsteinUhlenbeckNoise(1.0, correlation_time=0.5),
    "formula": "def kernel(force):\n    return force",
    "limits": {"tower": (None, 0.25)}, "str": "text", "bool": True, "Surface": il.Crossing("x", 1.5, "down"),
    "Sequence[float]": (1.0, 2.0), "Sequence[float] | np.ndarray": (1.0, 2.0), "float | Sequence[float]": (1.0, 2.0),
    "tuple[Side, Side]": ("x", "y"), "tuple[Side, Side] | Wall": ("p", "q"),
    "tuple[float, ...]": (1.0, 2.0), "Matrix": ((2.0, -1.0), (-1.0, 3.0)), "Vector | Matrix": ((2.0, 0.5), (0.5, 1.0)),
}  # fmt: skip


def sample(cls):
    """Make a component in which no number has its default value."""
    values = {}
    for field in dataclasses.fields(cls):
        if field.name in cls.state_names():
            continue  # their start values
        limits = field.metadata
        low = next((limits[name] for name in ("minimum", "above") if limits.get(name) is not None), 0.0)
        high = limits.get("maximum")
        if type_of(field) == "float":
            values[field.name] = low + 1.75 if high is None else 0.375 * low + 0.625 * high
        elif type_of(field) == "int":
            values[field.name] = int(low) + 7
        elif field.default is dataclasses.MISSING:
            values[field.name] = SAMPLES.get(field.name, SAMPLES.get(type_of(field), field.name))
    return cls(**values)


COMPONENTS = [cls for cls in subclasses(il.Component) if not issubclass(cls, il.Study)]
LAWS, OSCILLATORS = subclasses(il.ContactLaw), subclasses(il.Oscillator)
FORCES = [cls for cls in LAWS if cls is not il.RigidContact]  # which has impulses instead
COUPLING_LAWS = subclasses(il.CouplingLaw)
each_component = pytest.mark.parametrize("cls", COMPONENTS)
each_law = pytest.mark.parametrize("cls", FORCES)


def each_with(kernel, classes):
    return pytest.mark.parametrize("cls", [cls for cls in classes if cls.has_kernel(kernel)])


def test_all_families_were_found():
    """The search itself: it finds the classes that the design names."""
    names = {cls.__name__ for cls in COMPONENTS}
    assert names >= {
        "Contact", "HertzContact", "LinearContact", "Coupling", "LinearCoupling", "LinearOscillator",
        "DuffingOscillator", "WhiteNoise",
        "ShinozukaNoise", "ExactFlow", "RungeKutta4", "EulerMaruyama", "Density", "Trajectory",
    }  # fmt: skip
    assert names.isdisjoint(
        {"Component", "ContactLaw", "CouplingLaw", "Oscillator", "Excitation", "Integrator", "Record"}
    )


@each_component
def test_component_is_a_value(cls):
    one, other = sample(cls), sample(cls)
    assert one == other
    assert hash(one) == hash(other)
    assert one is not other
    assert one != object()
    for field in dataclasses.fields(cls):
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(one, field.name, 1.0)
        with pytest.raises(dataclasses.FrozenInstanceError):
            delattr(one, field.name)
        if type_of(field) in ("float", "int"):
            value, high = getattr(one, field.name), field.metadata["maximum"]
            new = 2 * value + (not value) if high is None else type(value)(high)
            try:
                changed = one.replace(**{field.name: new})
            except il.InvalidInput:  # beyond another field
                new = value / 2
                changed = one.replace(**{field.name: new})
            assert changed != one
            assert getattr(changed, field.name) == new


@each_component
def test_component_survives_copies(cls):
    one = sample(cls)
    for other in (copy.copy(one), copy.deepcopy(one), pickle.loads(pickle.dumps(one)), one.replace()):
        assert other == one
        assert type(other) is cls


@each_component
def test_component_survives_json(cls):
    one = sample(cls)
    data = json.loads(json.dumps(one.to_dict(), allow_nan=False))
    assert data["type"] == cls.__name__
    assert cls.from_dict(data) == one
    assert il.Component.from_dict(data) == one


@each_component
def test_repr_evaluates_to_the_component(cls):
    one = sample(cls)
    names = {name: getattr(il, name) for name in il.__all__} | {cls.__name__: cls}
    assert eval(repr(one), {}, names) == one


@each_component
def test_numbers_have_units_and_refuse_what_is_not_finite(cls):
    for field in dataclasses.fields(cls):
        if type_of(field) != "float":
            continue
        units = field.metadata["units"]
        assert units == "1" or all(re.fullmatch(r"[A-Za-z]+(-?\d+(/\d+)?)?", unit) for unit in units.split())
        assert cls.units_of(field.name) == units
        bad = [np.nan, np.inf, -np.inf, "1", None, True]
        if field.metadata["minimum"] is not None:
            bad.append(np.nextafter(field.metadata["minimum"], -np.inf))
        if field.metadata["above"] is not None:
            bad.append(field.metadata["above"])
        if field.metadata["maximum"] is not None:
            bad.append(np.nextafter(field.metadata["maximum"], np.inf))
        for value in bad:
            with pytest.raises(il.InvalidInput, match=rf"{cls.__name__}.{field.name} must be"):
                sample(cls).replace(**{field.name: value})


@pytest.mark.parametrize("cls", [*LAWS, *COUPLING_LAWS, *OSCILLATORS])
def test_physical_constants_of_a_force_are_not_negative(cls):
    """Masses, stiffnesses and damping have a lower limit; a negative one is refused."""
    for field in dataclasses.fields(cls):
        if field.name in cls.state_names() or (cls, field.name) == (il.CoulombFrictionCoupling, "velocity"):
            continue  # a belt runs either way
        with pytest.raises(il.InvalidInput, match=r"not -1.0"):
            sample(cls).replace(**{field.name: -1.0})


ATTRACTIVE = (il.AdhesiveContact,)


@each_law
def test_law_at_zero_indentation(cls):
    law = sample(cls)
    for rate in (-2.0, 0.0, 3.0):
        assert np.isfinite(law.call("force", 0.0, rate))
    assert law.evaluate([-1.0, -1e-300, 0.0]).tolist() == [0.0] * 3
    if cls in ATTRACTIVE:
        assert law.evaluate(1e-9) < 0.0 < law.evaluate(1e3)
    else:
        assert law.call("force", 0.0, 0.0) == 0.0
        assert (law.evaluate([1e-9, 1.0, 1e3]) > 0.0).all()


@each_with("potential", FORCES)
def test_law_is_the_derivative_of_its_potential(cls):
    law = sample(cls)
    assert law.call("potential", 0.0) == 0.0
    for depth in (1e-3, 0.1, 2.0):
        work = quad(lambda d: float(law.evaluate(d)), 0.0, depth, epsabs=0.0, epsrel=1e-11)[0]
        assert float(law.call("potential", depth)) == pytest.approx(work, rel=1e-10)


@each_with("potential", COUPLING_LAWS)
def test_coupling_is_the_derivative_of_its_potential(cls):
    law = sample(cls)
    assert law.call("potential", 0.0) == 0.0
    for extension in (-2.5, 0.1, 1.5):
        work = quad(lambda e: float(law.evaluate(e)), 0.0, extension, epsabs=0.0, epsrel=1e-11, points=[-1.75])[0]
        assert float(law.call("potential", extension)) == pytest.approx(work, rel=1e-10)


@each_with("residual_potential", OSCILLATORS)
def test_residual_is_the_derivative_of_its_potential(cls):
    body = sample(cls)
    assert body.call("residual_potential", 0.0) == 0.0
    for x in (-2.0, 0.1, 1.5):
        work = quad(lambda d: float(body.call("residual", d, 0.0)), 0.0, x, epsabs=0.0, epsrel=1e-11)[0]
        assert float(body.call("residual_potential", x)) == pytest.approx(work, rel=1e-10)


def compiled_forces(network, y):
    """Forces of the contacts, and on the bodies, in states [x..., v...], from the start values of laws with states."""
    model, count = Model.of(network), y.shape[1]
    bodies, contacts = len(model.bodies), len(model.ends)
    x, v, total = np.zeros((3, 1, bodies + 1, count))
    x[0, :-1], v[0, :-1] = np.split(y, 2)
    indentation, contact_force = np.zeros((2, 1, contacts, count))
    parameters = with_states(model.members.parameters, model.members.states, count, np.zeros)
    evaluate(build(generate(model)).forces, x, v, parameters, model.members.indices, indentation, contact_force, total)
    return contact_force[0], total[0, :-1]


ALIKE = il.FloresContact, il.GonthierContact, il.CarvalhoMartinsContact, il.HertzdampContact
"""Laws with the kernel of `LankaraniNikraveshContact`, which takes a second to compile."""

COSTLY = il.LankaraniNikraveshContact, il.TsujiContact, il.JankowskiContact, il.ThorntonContact, il.WaltonBraunContact
"""Further laws that take about a second."""


@pytest.mark.parametrize(
    "cls",
    [
        pytest.param(cls, marks=[pytest.mark.campaign] * (cls in ALIKE) + [pytest.mark.full] * (cls in COSTLY))
        for cls in FORCES
    ],
)
def test_compiled_and_plain_force_agree(cls):
    """To one unit in the last place on random states, open and closed."""
    law = sample(cls)
    bodies = {"a": il.LinearOscillator(), "b": il.LinearOscillator()}
    network = il.Network(bodies, {"c": il.Contact("a", "b", law, clearance=0.25)})
    y = np.random.default_rng(1).normal(size=(4, 500))
    force = compiled_forces(network, y)[0][0]
    plain = law.evaluate(y[0] - y[1] - 0.25, y[2] - y[3])
    assert 100 < np.count_nonzero(plain) < 400
    np.testing.assert_array_max_ulp(force, plain, maxulp=1)


@pytest.mark.parametrize("with_states", [False, pytest.param(True, marks=pytest.mark.full)])
def test_compiled_and_plain_couplings_agree(with_states):
    """On both bodies, to one unit in the last place; nothing pulls at no extension and no rate."""
    acting = [cls for cls in COUPLING_LAWS if cls is not il.CoulombFrictionCoupling]  # which acts between kicks
    acting = [cls for cls in acting if bool(cls.state_names()) == with_states]
    assert len(acting) > 2
    laws = {cls.__name__: sample(cls) for cls in acting}
    bodies = dict.fromkeys((f"{name} {end}" for name in laws for end in "ab"), il.LinearOscillator())
    couplings = {name: il.Coupling(f"{name} a", f"{name} b", law) for name, law in laws.items()}
    y = np.random.default_rng(3).normal(size=(4 * len(laws), 100))
    forces = dict(zip(bodies, compiled_forces(il.Network(bodies, couplings=couplings), y)[1], strict=True))
    places, rates = (dict(zip(bodies, part, strict=True)) for part in np.split(y, 2))
    for name, law in laws.items():
        ends = f"{name} a", f"{name} b"
        plain = law.evaluate(*(item[ends[1]] - item[ends[0]] for item in (places, rates)))
        np.testing.assert_array_max_ulp(np.array([forces[end] for end in ends]), np.array([plain, -plain]), maxulp=1)
        assert law.evaluate(0.0) == 0.0


def test_compiled_and_plain_given_forces_agree():
    """To two units in the last place, before, while and after they act."""
    loads = {cls.__name__: sample(cls) for cls in subclasses(il.Excitation) if cls.kind == "force"}
    model = Model.of(il.Network(dict.fromkeys(loads, il.LinearOscillator()), {}, loads))
    times, forces = np.random.default_rng(5).uniform(-1.0, 4.0, 200), np.zeros((200, len(loads)))
    build(generate(model, single=True)).forcing(times, model.members.parameters, model.members.indices, forces)
    plain = np.array([load.call("force", times) for load in loads.values()])
    np.testing.assert_array_max_ulp(forces.T, plain, maxulp=2)
    assert len(loads) > 4
    assert forces.any(axis=0).all()


@pytest.mark.parametrize("cls", [cls for cls in [*LAWS, *COUPLING_LAWS, *OSCILLATORS] if cls.state_names()])
def test_states_stay_where_nothing_moves(cls):
    """Those that hold at some place and speed still hold there at the same time: what is accepted twice is as once."""
    law = sample(cls)
    kinematic, fields = law.arguments("update")
    rng = np.random.default_rng(4)
    for place, rate in rng.normal(size=(20, 2)):
        values = {name: getattr(law, name) for name in law.field_names()}
        values.update(dict.fromkeys(law.kernels["update"], place), rate=rate, velocity=rate, elapsed=0.0)
        for _ in range(2):
            before = [values[name] for name in law.state_names()]
            new = law.update(*(values[item] for item in (*kinematic, *fields)))
            values.update(zip(law.state_names(), np.atleast_1d(new).tolist(), strict=True))
        assert [values[name] for name in law.state_names()] == pytest.approx(before, abs=1e-12)


def test_compiled_and_plain_residuals_agree():
    """To one unit in the last place, of all classes in one network."""
    classes = [cls for cls in OSCILLATORS if cls.has_kernel("residual")]
    bodies = {cls.__name__: sample(cls).replace(mass=1.0, damping=0.0, stiffness=0.0) for cls in classes}
    held = {name: il.Coupling(name, il.WALL, il.LinearCoupling(0.0)) for name in bodies}
    compiled = il.Network(bodies, couplings=held).compile()
    y = np.random.default_rng(2).normal(size=(2, len(bodies), 100))
    acceleration = np.array([compiled.rhs(0.0, column)[len(bodies) :] for column in y.reshape(-1, 100).T])
    assert len(bodies) > 4
    for row, body in enumerate(bodies.values()):
        np.testing.assert_array_max_ulp(-acceleration[:, row], np.array(body.call("residual", *y[:, row])), maxulp=1)
