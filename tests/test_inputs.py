"""Wrong calls of everything public end in a value, or in one error in words.

The calls are those of the examples in the docstrings, so that a new public name is covered; one or two of their
arguments are replaced by values that nobody means.
"""

import collections
import datetime
import decimal
import doctest
import fractions
import inspect
import math
import random
import warnings

import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr
from time_limit import Hangs, limited

import impactlab as il
from impactlab import inputs
from impactlab.results.schema import EVERY
from tests.test_examples import NAMES, RUNS, SHARED, text_of


class NoNumber:
    """Says that it is a number, and is none."""

    def __float__(self):
        raise RuntimeError("no number")


def wrong_values():
    """Values that nobody means: beyond all ranges, of other types, empty, false, hostile as names."""
    body, force = il.LinearOscillator(stiffness=1.0, damping=1.0), il.HertzContact(1e3)
    return [
        math.nan, math.inf, -math.inf, -1.0, 0.0, -0.0, 1e308, -1e308, 5e-324, 1e-308, 10**400, -(10**30), 2**63,
        10**5000, -7, "\0", {}, il.WALL,
        True, False, None, 1 + 2j, np.float32(1.5), np.int64(3), np.float64(np.nan), np.array(2.0), np.bool_(True), 3,
        decimal.Decimal("1.5"), fractions.Fraction(1, 3), "1.0", "nan", "", b"1", [1.0], (1.0, 2.0), 1.5, [], (), set(),
        object(), NoNumber(), lambda *_, **__: math.nan, Ellipsis, range(3), "a" * 5000, "a\nb",
        "\ud800", "<script>alert(1)</script>", "../../x", "a.b", " ", r"$\frac{$", np.array([]),
        np.array([[1.0, np.nan]]),
        np.array(["x", "y"]), np.array([1 + 1j]), xr.DataArray([1.0, 2.0]), xr.Dataset(), np.datetime64("2020"),
        datetime.date(2020, 1, 1), [None], [[1.0, 2.0], [3.0]], {"a": math.nan}, {"a": 1.0}, {"zz": 1.0}, {1: 2},
        [math.nan, 1.0], [3.0, 2.0, 1.0], [1.0, 1.0], ["a", "a"], ["a", "zz"], (math.inf, 1.0), np.full((2, 2), np.nan),
        -np.eye(2), np.zeros((2, 2)), np.ones((3, 2)), {"type": "LinearOscillator"}, force, il.WhiteNoise(1.0), body,
        il.HertzContact, plt, np.random.default_rng(1), np.arange(10.0)[::-1], np.linspace(0.0, 1.0, 5), il.Density(),
    ]  # fmt: skip


def examples(names):
    """Calls that the examples of public names make: (function, arguments by position, by name)."""
    calls = []

    def noted(checked, *values, **named):
        calls.append((checked, values, named))
        return call(checked, *values, **named)

    def made(cls, /, *values, **fields):
        calls.append((cls, values, fields))
        return new(cls, *values, **fields)

    call, new = inputs.Checked.__call__, il.Component.__new__
    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        patch.setattr(inputs.Checked, "__call__", noted)
        patch.setattr(il.Component, "__new__", made)
        for name in names:
            shared = {}
            exec(compile(SHARED.read_text(encoding="utf-8"), SHARED.name, "exec"), shared)
            shown = text_of(name).partition("Examples\n--------\n")[2]
            test = doctest.DocTestParser().get_doctest(shown, shared, name, None, None)
            doctest.DocTestRunner().run(test, out=lambda _: None, clear_globs=False)
    return [item for item in calls if name_of(item[0])]


def name_of(called):
    """Name of a callable for whoever uses the library, none of what only the library calls."""
    if isinstance(called, type):
        return called.__name__ if hasattr(il, called.__name__) else ""
    name, home = called.function.__qualname__, called.function.__module__
    hidden = home.startswith(("impactlab.records", "impactlab.studies.discovery"))  # called by the library
    hidden |= "Reference.__init__" in name or name == "Processes.submit"  # as executors have it
    return "" if hidden else f"{home}.{name}"


def changed(rng, wrong, call):
    """Return a call with one or two wrong arguments, and what they are."""
    called, values, named = call
    function = called if isinstance(called, type) else called.function
    arguments = [item for item in inspect.signature(function).parameters.values() if item.kind not in (2, 4)]
    named = {**dict(zip([item.name for item in arguments], values, strict=False)), **named}
    fixed = [item.name for item in arguments if item.kind == item.POSITIONAL_ONLY or item.name in ("self", "cls")]
    kept = {name: named.pop(name) for name in fixed if name in named}
    free = sorted({*named, *(item.name for item in arguments)} - {*fixed})
    given = rng.sample(free, min(len(free), rng.choice([1, 1, 1, 2])))
    if rng.random() < 0.03:
        given = ["stifness"]
    faults = {name: rng.choice(wrong) for name in given}
    return called, tuple(kept.values()), {**named, **faults}, faults


def outcome(called, values, named):
    """What a call ends in: "value" or "words", or the fault."""
    try:
        with limited(), warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            result = called(*values, **named)
    except il.ImpactLabError as error:
        return "words" if "\n" not in str(error) or isinstance(error, il.NoExactReference) else "several lines"
    except Hangs:
        return "hang"
    except Exception as error:
        return f"{type(error).__name__}: {error}"[:120]
    finally:
        plt.close("all")
    foreign = [item for item in told if not isinstance(item.message, il.ImpactLabWarning)]
    if foreign:
        return f"warning of a library: {foreign[0].message}"[:120]
    return "value" if told else wrong_in(result) or "value"


def wrong_in(result):
    """What is wrong in a result that came without a word."""
    if isinstance(result, il.Component):
        if il.Component.from_dict(result.to_dict()) != result:
            return "another component from its data"
        return "" if is_finite(result.to_dict()) else "not finite"
    if isinstance(result, xr.Dataset):
        lost = [name for name in EVERY if name in result and result[name].size and result[name].isnull().all()]
        return f"NaN: {lost[0]}" if lost else ""
    return "NaN" if isinstance(result, float | np.ndarray) and np.isnan(np.asarray(result, dtype=float)).any() else ""


def is_finite(data):
    """Whether all numbers in plain data are finite."""
    if isinstance(data, dict | list):
        return all(map(is_finite, data.values() if isinstance(data, dict) else data))
    return not isinstance(data, float) or math.isfinite(data)


def faults_of(names, number, seed):
    """Call the examples of some names wrongly, so many times; return the faults with the calls, and how often."""
    by_name = collections.defaultdict(list)
    for call in examples(names):
        by_name[name_of(call[0])].append(call)
    known, wrong, found, counts = sorted(by_name), wrong_values(), [], collections.Counter()
    for index in range(number):
        rng = random.Random(f"{seed} {index}")
        name = rng.choice(known)
        called, values, named, given = changed(rng, wrong, rng.choice(by_name[name]))
        ends = outcome(called, values, named)
        if ends == "NaN" and not is_finite(list(given.values())):
            ends = "value"  # of numbers that are none
        counts[ends if ends in ("value", "words") else "fault"] += 1
        if ends not in ("value", "words"):
            found.append(f"{name}({', '.join(f'{key}={inputs.shown(item)}' for key, item in given.items())}): {ends}")
    return found, counts


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch):
    """Wrong paths are those of files in a folder of the test."""
    monkeypatch.chdir(tmp_path)


def test_some_wrong_calls_are_refused_in_words():
    cheap = [name for name in NAMES if not RUNS.search(text_of(name))]
    found, counts = faults_of(cheap, 400, seed=1)
    assert not found, "\n".join(found)
    assert counts["words"] > 200


@pytest.mark.campaign
def test_wrong_calls_are_refused_in_words():
    """20 000 calls of all public names: no other error, no warning of a library, no NaN without a word, no hang."""
    found, counts = faults_of(NAMES, 20_000, seed=2)
    print(dict(counts))
    assert not found, "\n".join(found)


def test_all_that_is_public_is_checked():
    """Functions, and methods of classes other than components, whose fields are checked when they are made."""
    functions = [item for name in NAMES if inspect.isfunction(item := eval(f"il.{name}", {"il": il}))]
    unchecked = [item.__name__ for item in functions if not hasattr(item, "__wrapped__")]
    assert unchecked == ["parameter", "state"]  # of declarations, which the class checks
    for name in NAMES:
        item = eval(f"il.{name}", {"il": il})
        if inspect.isclass(item) and not issubclass(item, il.Component | BaseException):
            methods = {key: value for key, value in vars(item).items() if inspect.isfunction(value) and key[0] != "_"}
            assert all(hasattr(value, "__wrapped__") for value in methods.values()), name


def test_all_annotations_of_public_functions_are_understood():
    for name in NAMES:
        item = eval(f"il.{name}", {"il": il})
        if inspect.isfunction(item) and name not in ("parameter", "state"):
            for argument in inspect.signature(item).parameters.values():
                meaning = inputs.meaning_of(inspect.unwrap(item).__module__, argument.annotation)
                assert meaning is not inputs.Any or argument.annotation == "Any", f"{name}: {argument}"
