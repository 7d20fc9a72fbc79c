"""The text that is generated: what it holds, what it leaves out, what it refuses."""

import ast
import functools
import inspect
import math
import math as mathematics
import time
from math import sqrt

import numba
import numpy as np
import pytest
from numpy import tanh
from scipy import constants

import impactlab as il
from impactlab.assembly.generate import generate
from impactlab.assembly.members import Kind
from impactlab.assembly.model import Model
from impactlab.compiling.inlining import Inliner

BODY = il.LinearOscillator()
HERTZ = il.HertzContact(1e4)

GAIN = 3
NEGATIVE = -2.0
SINGLE = np.float32(0.1)
FLAG = np.bool_(True)
LARGEST = float("inf")
NOT_A_NUMBER = float("nan")
TABLE = [1.0, 2.0]
ARRAY = np.ones(2)


def twice(value):
    return 2.0 * value


def four_times(value):
    """A helper that calls a helper, and has a local name of this module."""
    GAIN = twice(value)
    return twice(GAIN)


@numba.njit
def jitted(value):
    return sqrt(value) + GAIN


def other_twice():
    def twice(value):
        return 20.0 * value

    return twice


tenfold = other_twice()


def doubled(function):
    @functools.wraps(function)
    def wrapper(value):
        return 2.0 * function(value)

    return wrapper


@doubled
def decorated(value):
    return value


def law(force):
    """Make a law of a function (which must be in this file)."""
    return type("Law", (il.ContactLaw,), {"force": force})()


def text_of(*members, time_varying=False):
    """Generate the text of a network with these laws, bodies or excitations."""
    bodies = {f"body_{k}": item for k, item in enumerate(members) if isinstance(item, il.Oscillator)}
    bodies = bodies or {"a": BODY, "b": BODY}
    first = next(iter(bodies))
    laws = [item for item in members if isinstance(item, il.ContactLaw)]
    contacts = {f"contact_{k}": il.Contact(first, il.WALL, item) for k, item in enumerate(laws)}
    excitations = [item for item in members if isinstance(item, il.Excitation)]
    return il.Network(bodies, contacts, dict(zip(bodies, excitations, strict=False))).source()


def names(text):
    """All names that the code of a text uses, without its comments and docstrings."""
    nodes = list(ast.walk(ast.parse(text)))
    used = {node.id for node in nodes if isinstance(node, ast.Name)}
    return used | {node.name for node in nodes if isinstance(node, ast.FunctionDef)}


def loops(text):
    """Comments that open a loop over the members of a kind."""
    return [line.strip() for line in text.splitlines() if line.strip().startswith("# ")]


def copied(force):
    """The copy of a kernel, run as plain Python."""
    text = text_of(law(force))
    definitions = [item for item in ast.parse(text).body if isinstance(item, ast.FunctionDef) and item.name != "forces"]
    for item in definitions:
        item.decorator_list = []
    scope = {"math": math, "np": np}
    exec(compile(ast.Module(definitions, []), "copied", "exec"), scope)
    return scope["Law_force"]


# What the text holds


def test_text_of_the_pair(base_case, golden):
    golden("pair.py.txt", base_case().source())


def test_the_pair_has_no_code_that_it_does_not_need(base_case):
    text = base_case().source()
    assert names(text).isdisjoint(
        {"rate", "damping", "velocity", "residual", "forcing", "intensity", "times", "result", "row", "np", "v"}
    )
    assert loops(text) == ["# HertzContact: force of slot with clearance, stiffness"]


def test_walls_need_no_code(base_case):
    network = base_case()
    stopped = network.replace(contacts={"stop": il.Contact("two", il.WALL, HERTZ)})
    assert stopped.source() == network.source()


def test_linear_bodies_with_constant_noise_need_no_loop():
    text = text_of(BODY, il.WhiteNoise(1.0), il.ShinozukaNoise(1.0))
    assert loops(text) == []
    assert names(text) <= {"pointer", "FORCES", "forces", "clear", "total"}
    assert "math" not in text


class RateLaw(il.ContactLaw):
    stiffness: float = il.parameter(100.0, units="N m-1")
    damping: float = il.parameter(1.0, units="N s m-1")

    def force(indentation, rate, stiffness, damping):
        return stiffness * indentation + damping * rate


class Sine(il.Excitation):
    amplitude: float = il.parameter(units="N")

    def force(time, amplitude):
        return amplitude * math.sin(time)


class Burst(il.Excitation):
    density: float = il.parameter(units="N2 s rad-1")

    def intensity(time, density):
        return density * np.exp(-time * time)


def test_law_that_depends_on_the_rate():
    text = text_of(RateLaw())
    assert {"rate", "middle", "half_step"} <= names(text)
    assert "force = RateLaw_force_over_kick(gap, rate, response, stiffness, damping)" in text
    assert names(text).isdisjoint({"math", "np", "residual", "forcing"})


def test_fields_may_have_names_that_the_solver_of_velocities_uses():
    class Named(il.ContactLaw):
        speed: float = il.parameter(1.0)
        given: float = il.parameter(1.0)

        def force(indentation, rate, speed, given):
            return speed * indentation + given * rate

    text = text_of(Named())
    compile(text, "text", "exec")  # no argument twice
    assert "given_ = column_" in text
    assert "speed_ = column_" in text


def test_duffing_oscillators():
    text = text_of(il.DuffingOscillator(2.0))
    assert loops(text) == ["# DuffingOscillator: residual of body with cubic"]
    assert names(text).isdisjoint({"gap", "rate", "indentation", "contact_force", "v", "math", "np"})


def test_given_force():
    text = text_of(BODY, Sine(2.0))
    assert loops(text) == ["# Sine: forcing of row with amplitude"]
    assert "forcing" in names(text)
    assert "intensity" not in names(text)


def test_noise_that_varies_in_time():
    """Constant noises beside it are written by a loop of their own."""
    text = text_of(BODY, il.DuffingOscillator(1.0), Burst(2.0), il.WhiteNoise(1.0))
    assert [loop.split(":")[0] for loop in loops(text)] == ["# DuffingOscillator", "# Burst", "# WhiteNoise"]
    assert "intensity" in names(text)
    assert "forcing" not in names(text)


def test_one_loop_for_each_law():
    """And one for the peaks of those that depend on the rate."""
    text = text_of(il.LinearContact(1.0), HERTZ, il.LinearContact(2.0), RateLaw())
    forces, peaks = text.split("def peaks(")
    assert [loop.split(":")[0] for loop in loops(forces)] == ["# HertzContact", "# LinearContact", "# RateLaw"]
    assert [loop.split(":")[0] for loop in loops(peaks)] == ["# RateLaw"]


def test_text_does_not_depend_on_parameters_counts_or_names():
    def chain(bodies, mass, stiffness, clearance, names=""):
        laws = [il.HertzContact(stiffness)] + [il.LinearContact(stiffness)] * (bodies - 2)
        network = il.chain(bodies, il.LinearOscillator(mass=mass), laws, clearance=clearance)
        return network.replace(oscillators={f"x{names}": BODY}).source()

    assert chain(3, 1.0, 1e4, 0.05) == chain(200, 0.1, 3e7, -0.2, names="y")


def test_text_does_not_depend_on_the_order_of_members():
    one, other = text_of(HERTZ, RateLaw(), BODY), text_of(RateLaw(), HERTZ, BODY)
    assert one == other


def test_text_is_python_that_a_person_can_read(base_case):
    for text in (base_case().source(), text_of(BODY, RateLaw(), Sine(1.0)), text_of(BODY, Burst(1.0))):
        assert ast.get_docstring(ast.parse(text)).startswith("Forces of a network")
        assert max(map(len, text.splitlines())) <= 110
        assert text.endswith("\n")
        assert not text.endswith("\n\n")


# What kernels may read


def numbers(indentation):
    return GAIN * indentation + SINGLE if FLAG else 0.0


def negative_numbers(indentation):
    return NEGATIVE**2 * indentation - NEGATIVE + indentation**NEGATIVE


def limits(indentation):
    return min(indentation, LARGEST) if NOT_A_NUMBER != NOT_A_NUMBER else -1.0


def functions_of_modules(indentation):
    return sqrt(indentation) + mathematics.exp(-indentation) + np.cos(indentation) + tanh(math.pi)


def numbers_of_modules(indentation):
    return constants.g * indentation


def nested_helpers(indentation):
    return four_times(indentation) + twice(indentation)


def jitted_helper(indentation):
    return jitted(indentation)


def helpers_of_one_name(indentation):
    return twice(indentation) + tenfold(indentation)


def statements(indentation):
    """A kernel of several statements."""
    total = 0.0
    for k in range(1, 4):
        if k == 2:
            continue
        total += abs(indentation) ** k
    low, high = (0.0, 1.0)
    return max(low, min(high, total))


def annotated(indentation: float) -> float:
    scale: float = 2.0
    return scale * indentation


def make_closure(power, function):
    def closure(indentation):
        return function(indentation) ** power

    return closure


@pytest.mark.parametrize(
    "force",
    [
        numbers, negative_numbers, limits, functions_of_modules, numbers_of_modules, nested_helpers, jitted_helper,
        helpers_of_one_name, statements, annotated, make_closure(3, twice), make_closure(-1, sqrt),
    ],
)  # fmt: skip
def test_copy_of_a_kernel_is_the_kernel(force):
    copy = copied(force)
    for indentation in (0.25, 1.0, 1.75):
        assert copy(indentation) == force(indentation)


# What kernels may contain


def operators(x):
    whole = int(4.0 * x)
    bits = (whole & 1) + (whole | 2) + (whole ^ 3) + (whole << 2) + (whole >> 1) + ~whole
    return -x % 0.4 + (-x) // 0.4 + 7 // 2 + 7 % 4 + 1 / 3 + x**2.5 + bits


def comparisons(x):
    return 1.0 if (0.0 < x <= 2.0 and not x > 3.0) or x != x else (2.0 if x in (0.5, 1.5) else 3.0)


def powers_of_whole_numbers(x):
    total, power, exponent = 0.0, 2, -GAIN
    for k in range(1, 4):
        total += k**-2 + x * 3**-k + (k - 5) ** -k + float(k) ** -1
    power **= exponent
    return total + power + 2**exponent


def for_else(x):
    for k in range(3):
        if k > x:
            break
    else:
        return 7.0
    return x


def loops_over_tuples(x):
    total, k = 0.0, 0
    for row, (one, other) in enumerate(zip((x, 1.0), (2.0, x))):  # noqa: B905
        total += row * one + other
    for item in (x, 3.0):
        total -= item
    while True:
        k += 1
        if k > 3:
            break
    return total + k


def functions_of_python(x):
    return (
        abs(-x) + divmod(x, 0.4)[1] + float(int(x)) + bool(x) + len((x, x)) + round(x, 1) + sum((x, 1.0)) - max(x, 1.0)
    )


def several_values(x):
    return x + 1.0, 2.0 * x


def tuples(x):
    table = (1.0, 4.0, x)
    one, other = several_values(x)
    one, other = other, one
    return table[int(x)] + table[-1] + table[1:][0] + one / other + several_values(x)[1]


def functions_of_math(x):
    return math.hypot(x, 1.0) + math.atan2(x, 2.0) + math.floor(x) + math.copysign(1.0, -x) + math.isfinite(x) + math.e


def functions_of_numpy(x):
    return np.maximum(x, 1.0) + np.hypot(x, np.pi) + np.sign(x) + np.sinc(x) + np.float64(2.0) * np.round(x, 1)


def with_default(value, factor=GAIN):
    return factor * value


def arguments_of_helpers(x):
    return with_default(x) + with_default(x, factor=2.0)


ALLOWED = [
    operators, comparisons, powers_of_whole_numbers, for_else, loops_over_tuples, functions_of_python, tuples,
    functions_of_math, functions_of_numpy, arguments_of_helpers, statements, nested_helpers, jitted_helper, annotated,
]  # fmt: skip


@pytest.mark.full
@pytest.mark.parametrize("formula", ALLOWED)
def test_what_a_kernel_may_contain_gives_the_numbers_of_python(formula):
    texts = {}
    Inliner("of", texts, set(), []).inline(formula, "formula")
    scope = {"math": math, "np": np}
    for name, text in texts.items():
        exec(text, scope)
        scope[name] = numba.njit(error_model="numpy", _nrt=False, no_cfunc_wrapper=True)(scope[name])
    for x in (0.25, 1.0, 1.75):
        assert scope["formula"](x) == pytest.approx(formula(x), rel=1e-15)


def prints(x):
    print(x)
    return x


def prints_and_returns(x):
    return print(x) or x


def helper_prints(x):
    return prints(x)


def raises(x):
    if x < 0.0:
        raise ValueError("negative")
    return x


def asserts(x):
    assert x >= 0.0
    return x


def tries(x):
    try:
        return 1.0 / x
    except ZeroDivisionError:
        return 0.0


def opens(x):
    with open("values.txt") as file:
        return float(file.read())


def imports(x):
    import cmath

    return cmath.pi * x


def remembers(x):
    global GAIN
    GAIN = x
    return GAIN


def formats(x):
    return x * len(f"{x}")


def compares_text(x):
    name = "soft"
    return x if name == "soft" else 2.0 * x


def returns_nothing_known(x):
    known = None
    return x if known is None else known


def appends(x):
    values = []
    values.append(x)
    return values[0]


def changes(x):
    values = (x, x)
    values.__setitem__(0, x)
    return values[0]


def comprehends(x):
    return max([k * x for k in range(3)])


def generates(x):
    return sum(k * x for k in range(3))


def looks_up(x):
    return {1: x}[1]


def has_a_function(x):
    def doubled(y):
        return 2.0 * y

    return doubled(x)


def has_a_lambda(x):
    return (lambda y: 2.0 * y)(x)


def assigns_in_expression(x):
    return (y := 2.0 * x) * y


def unpacks(x):
    first, *others = (x, 1.0, 2.0)  # noqa: F841
    return first


def factorial(x):
    return x * factorial(x - 1.0) if x > 1.0 else 1.0


def takes_any(*values):
    return values[0]


def calls_one_that_takes_any(x):
    return takes_any(x, 1.0)


def attribute(x):
    return x.real


def asks_for_type(x):
    return x if isinstance(x, float) else 0.0


def makes_text(x):
    return len(str(x))


def power_function(x):
    return pow(2, -int(x))


def draws(x):
    return x * np.random.rand()  # noqa: NPY002


def array(x):
    return np.array([x]).sum()


def makes_array(x):
    return np.zeros(2)[0] + x


def looks_at_clock(x):
    return x * time.time()


def reads_array(x):
    return x * ARRAY[0]


def complex_number(x):
    return abs(1j * x)


REFUSED = {
    prints: (1, "has 'print(x)', which is a statement without a result"),
    prints_and_returns: (1, "reads 'print', which is no function of scalars"),
    raises: (2, "which is an exception (return math.nan"),
    asserts: (1, "which is an exception (return math.nan"),
    tries: (1, "has 'try:', which is an exception"),
    opens: (1, "which is no formula of scalars"),
    imports: (1, "has 'import cmath', which is no formula of scalars"),
    remembers: (1, "has 'global GAIN', which is a variable that outlives the call"),
    formats: (1, "which is text"),
    compares_text: (1, "has \"'soft'\", which is no number"),
    returns_nothing_known: (1, "has 'None', which is no number"),
    appends: (1, "has '[]', which is a list"),
    changes: (2, "has 'values.__setitem__(0, x)', which is a statement without a result"),
    comprehends: (1, "has '[k * x for k in range(3)]', which is no formula of scalars"),
    generates: (1, "has '(k * x for k in range(3))', which is no formula of scalars"),
    looks_up: (1, "has '{1: x}', which is a dictionary"),
    has_a_function: (1, "has 'def doubled(y):', which is a function in a function"),
    has_a_lambda: (1, "has 'lambda y: 2.0 * y', which is a function in a function"),
    assigns_in_expression: (1, "which is no formula of scalars"),
    unpacks: (1, "has '*others', which is no formula of scalars"),
    factorial: (1, "reads 'factorial', which calls itself"),
    attribute: (1, "reads 'x.real', which belongs to an object"),
    asks_for_type: (1, "reads 'isinstance', which is no function of scalars"),
    makes_text: (1, "reads 'str', which is no function of scalars"),
    power_function: (1, "reads 'pow', which is no function of scalars"),
    draws: (1, "reads 'np.random', which is no function of scalars"),
    array: (1, "has '[x]', which is a list (a table is a field that is a tuple of numbers)"),
    makes_array: (1, "reads 'np.zeros', which is no function of scalars"),
    looks_at_clock: (1, "reads 'time.time', which is builtin_function_or_method"),
    reads_array: (1, "reads 'ARRAY', which is ndarray"),
    complex_number: (1, "has '1j', which is no number"),
    (helper_prints, prints): (1, "has 'print(x)'"),
    (calls_one_that_takes_any, takes_any): (0, "takes arguments that are not plain ones"),
}
"""Kernels, and whom they call, with the line and the words of the refusal."""


@pytest.mark.parametrize("formula", REFUSED)
def test_what_a_kernel_may_not_contain_is_refused_in_one_line(formula):
    caller, place = formula if isinstance(formula, tuple) else (formula, formula)
    line, words = REFUSED[formula]
    with pytest.raises(il.InvalidInput) as caught:
        Inliner("of", {}, set(), []).inline(caller, "formula")
    message = str(caught.value)
    assert message.startswith(f"{__file__}:{inspect.getsourcelines(place)[1] + line}: the kernel {place.__qualname__} ")
    assert words in message
    assert "\n" not in message


class PrintingContact(il.ContactLaw):
    def force(indentation):
        print(indentation)
        return indentation


class PrintingUpdate(il.CouplingLaw):
    last: float = il.state(0.0)

    def update(extension, last):
        print(last)
        return extension

    def force(extension, last):
        return extension - last


class PrintingCoupling(il.CouplingLaw):
    def force(extension):
        print(extension)
        return extension


class PrintingOscillator(il.Oscillator):
    def residual(displacement):
        print(displacement)
        return displacement


class PrintingForce(il.Excitation):
    def force(time):
        print(time)
        return time


class PrintingNoise(il.Excitation):
    def intensity(time):
        print(time)
        return 1.0 + time


def with_contact(law):
    return il.Network({"a": BODY}, {"c": il.Contact("a", il.WALL, law)})


def with_coupling(law):
    return il.Network({"a": BODY}, couplings={"c": il.Coupling("a", il.WALL, law)})


@pytest.mark.parametrize(
    "network",
    [
        lambda: with_contact(PrintingContact()),
        lambda: with_coupling(PrintingUpdate()),
        lambda: with_coupling(PrintingCoupling()),
        lambda: il.Network({"a": PrintingOscillator()}),
        lambda: il.Network({"a": BODY}, {}, {"a": PrintingForce()}),
        lambda: il.Network({"a": BODY}, {}, {"a": PrintingNoise()}),
    ],
)
def test_kernels_of_all_kinds_are_refused_before_they_are_called(network, capsys):
    with pytest.raises(il.InvalidInput, match=r"test_generate.py:\d+: the kernel Printing\w+\.\w+ has 'print"):
        il.simulate(network(), 1.0, realizations=1, rng=1)
    assert capsys.readouterr().out == ""


def test_numbers_become_literals():
    text = text_of(law(numbers))
    assert f"return 3 * indentation + {float(SINGLE)!r} if True else 0.0" in text
    assert names(text).isdisjoint({"GAIN", "SINGLE", "FLAG"})


def test_a_changed_number_changes_the_text():
    assert text_of(law(make_closure(2, twice))) != text_of(law(make_closure(3, twice)))


def undefined(indentation):
    return indentation * UNKNOWN  # noqa: F821


def reads_a_list(indentation):
    return indentation * TABLE[0]


def reads_an_object(indentation):
    return indentation * HERTZ.stiffness


def reads_a_module(indentation):
    return indentation * constants.value("electron mass")


def helper_reads_a_list(indentation):
    return reads_a_list(indentation)


@pytest.mark.parametrize(
    ("force", "place", "name", "problem"),
    [
        (undefined, undefined, "UNKNOWN", "is not defined"),
        (reads_a_list, reads_a_list, "TABLE", "is list"),
        (reads_an_object, reads_an_object, "HERTZ", "is HertzContact"),
        (helper_reads_a_list, reads_a_list, "TABLE", "is list"),
    ],
)
def test_what_a_kernel_may_not_read(force, place, name, problem):
    """The message names file and line."""
    with pytest.raises(il.InvalidInput) as caught:
        text_of(law(force))
    line = inspect.getsourcelines(place)[1] + 1
    assert f"{__file__}:{line}: the kernel {place.__qualname__} reads {name!r}, which {problem}" in str(caught.value)


def calls_a_decorated_function(indentation):
    return decorated(indentation)


def hidden_module(indentation):
    math = 2.0
    return sqrt(indentation) * math


def test_decorated_function_is_refused():
    """Its source is that of the function inside: the copy would leave the decorator out."""
    with pytest.raises(il.InvalidInput, match=r"decorated has a decorator"):
        text_of(law(calls_a_decorated_function))


def test_hidden_module_is_refused():
    with pytest.raises(il.InvalidInput, match=r"'sqrt', which is hidden by .* named 'math'"):
        text_of(law(hidden_module))


def test_kernel_without_source_is_refused():
    scope = {}
    exec("def force(indentation): return indentation", scope)
    with pytest.raises(il.InvalidInput, match=r"source of the kernel force cannot be found"):
        text_of(law(scope["force"]))


def test_lambda_is_refused():
    with pytest.raises(il.InvalidInput, match=r"must be written as a function with def"):
        text_of(law(lambda indentation: indentation))


# Names that could clash


def same_name(factor):
    class Same(il.ContactLaw):
        def force(indentation):
            return factor * indentation

    return Same()


class Clash(il.ContactLaw):
    """Fields with the names of what the generated loops use."""

    clearance: float = il.parameter(1.0)
    row: float = il.parameter(2.0)
    lane: float = il.parameter(3.0)
    gap: float = il.parameter(4.0)
    gap_: float = il.parameter(5.0)
    x: float = il.parameter(6.0)
    v: float = il.parameter(7.0)
    total: float = il.parameter(8.0)
    max: float = il.parameter(9.0)
    range: float = il.parameter(10.0)
    math: float = il.parameter(11.0)
    np: float = il.parameter(12.0)
    slot: float = il.parameter(13.0)
    at: float = il.parameter(14.0)
    indices: float = il.parameter(15.0)
    forces: float = il.parameter(16.0)
    first: float = il.parameter(17.0)

    def force(
        indentation, clearance, row, lane, gap, gap_, x, v, total, max, range, math, np, slot, at, indices, forces,
        first,
    ):  # fmt: skip
        return indentation * (
            clearance + 1e1 * row + 1e2 * lane + 1e3 * gap + 1e4 * gap_ + 1e5 * x + 1e6 * v + 1e7 * total + 1e8 * max
            + 1e9 * range + math / 3 + np / 7 + slot / 11 + at / 13 + indices / 17 + forces / 19 + first / 23
        )  # fmt: skip


class ClashingOscillator(il.Oscillator):
    force: float = il.parameter(3.0)
    row: float = il.parameter(5.0)
    body: float = il.parameter(7.0)

    def residual(displacement, force, row, body):
        return displacement * (force + 10.0 * row + 100.0 * body)


class ClashingForce(il.Excitation):
    result: float = il.parameter(3.0)
    row: float = il.parameter(5.0)
    times: float = il.parameter(7.0)
    index: float = il.parameter(9.0)

    def force(time, result, row, times, index):
        return time * (result + 10.0 * row + 100.0 * times + 1000.0 * index)


@pytest.mark.full
def test_names_that_clash_compile_to_the_right_numbers():
    """Fields named like locals, and two classes of one name, in one network."""
    laws = [Clash(), same_name(2.0), same_name(30.0)]
    bodies = dict.fromkeys("abc", BODY) | {"d": ClashingOscillator()}
    contacts = {str(k): il.Contact(name, il.WALL, item) for k, (name, item) in enumerate(zip("abc", laws, strict=True))}
    compiled = il.Network(bodies, contacts, {"d": ClashingForce()}).compile()
    displacement = dict.fromkeys("abc", 2.0) | {"d": 0.5}
    acceleration = compiled.rhs(2.0, compiled.state(displacement=displacement))[4:]
    expected = [-float(item.evaluate(2.0 - contacts[str(k)].clearance)) for k, item in enumerate(laws)]
    np.testing.assert_allclose(acceleration[:3], expected, rtol=1e-15)
    assert acceleration[3] == pytest.approx(2.0 * 9753.0 - 0.5 * 753.0, rel=1e-15)
    assert expected[1:] == [-4.0, -60.0]


def test_helper_named_like_another_kernel():
    """Class A with a helper `force` and class A_force with its kernel `force` want one name."""

    def make(name, kernel):
        return type(name, (il.ContactLaw,), {"force": kernel})

    def force(indentation):
        return 7.0 * indentation

    def calls_force(indentation):
        return force(indentation)

    kinds = [make("A", calls_force), make("A_force", numbers)]
    network = il.Network({"a": BODY}, {cls.__name__: il.Contact("a", il.WALL, cls()) for cls in kinds})
    text = generate(Model.of(network))
    defined = [node.name for node in ast.parse(text).body if isinstance(node, ast.FunctionDef)]
    assert len(defined) == len(set(defined)) == 4


def test_field_named_like_a_kinematic_argument_is_refused():
    with pytest.raises(il.InvalidInput, match=r"Bad: the field 'rate' has the name of a kinematic argument of force"):

        class Bad(il.ContactLaw):
            rate: float = il.parameter(1.0)

            def force(indentation, rate):
                return rate * indentation


def test_kinds_say_what_a_row_holds():
    kind = Kind("force", RateLaw, "force")
    assert kind.kinematic == ("indentation", "rate")
    assert kind.parameters == ("clearance", "mobility", "stiffness", "damping")


TERMS = {
    "contacts": "gather(",
    "no contacts": "clear(",
    "Hertz": "HertzContact_force(",
    "linear": "LinearContact_force(",
    "rates of contacts": "rate = ",
    "couplings": "LinearCoupling_force(",
    "residual": "DuffingOscillator_residual(",
    "given forces": "def forcing(",
    "states": "def accept(",
    "noise that varies": "def intensity(",
}
PAIR = {"a": BODY, "b": BODY}
GAP = {"gap": il.Contact("a", "b", HERTZ)}
SCENES = {
    "one body": (il.Network({"a": BODY}), {"no contacts"}),
    "noise": (il.Network(PAIR, excitations={"a": il.WhiteNoise(1.0)}), {"no contacts"}),
    "bounded noise": (il.Network(PAIR, GAP, {"a": il.ShinozukaNoise(1.0)}), {"contacts", "Hertz"}),
    "varying noise": (il.Network(PAIR, excitations={"a": Burst(1.0)}), {"no contacts", "noise that varies"}),
    "push": (il.Network(PAIR, GAP, {"a": Sine(1.0)}), {"contacts", "Hertz", "given forces"}),
    "pair": (il.Network(PAIR, GAP, {"a": il.WhiteNoise(1.0)}), {"contacts", "Hertz"}),
    "wall": (il.Network(PAIR, {"w": il.Contact("a", il.WALL, il.LinearContact(1.0))}), {"contacts", "linear"}),
    "dashpot": (il.Network(PAIR, {"w": il.Contact("a", "b", RateLaw())}), {"contacts", "rates of contacts"}),
    "Duffing": (il.Network({"a": il.DuffingOscillator(cubic=1.0), "b": BODY}, GAP), {"contacts", "Hertz", "residual"}),
    "coupled": (
        il.Network(PAIR, couplings={"spring": il.Coupling("a", "b", il.LinearCoupling(1.0))}),
        {"no contacts", "couplings", "rates of contacts"},
    ),
    "remembering": (
        il.Network(PAIR, couplings={"oil": il.Coupling("a", "b", il.MaxwellCoupling(1.0, damping=1.0))}),
        {"no contacts", "states"},
    ),
}


@pytest.mark.parametrize("name", SCENES)
def test_absent_terms_have_no_code(name):
    """Of contacts, laws, rates, couplings, residual forces, given forces and noises only those of the scene."""
    network, present = SCENES[name]
    text = generate(Model.of(network)).partition('"""')[2]
    assert {term for term, code in TERMS.items() if code in text} == present


def test_a_text_is_made_once_for_each_structure(monkeypatch):
    """Parameters are no part of it, but numbers that a kernel reads from its module are."""
    texts, usual = [], Inliner.inline
    monkeypatch.setattr(Inliner, "inline", lambda *given: texts.append(given[-1]) or usual(*given))

    class Raised(il.ContactLaw):
        stiffness: float = il.parameter()

        @staticmethod
        def force(indentation, stiffness):
            return GAIN * stiffness * indentation

    first = text_of(Raised(1.0))
    assert (text_of(Raised(2.0)), len(texts)) == (first, 1)
    monkeypatch.setitem(globals(), "GAIN", 4)
    assert text_of(Raised(1.0)) == first.replace("3 * stiffness", "4 * stiffness") != first
    assert len(texts) == 2
