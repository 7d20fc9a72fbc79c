"""Results whose configuration or variables somebody has changed, with digests that fit, and all that reads a result."""

import copy
import json
import math
import shutil
from collections import Counter

import matplotlib.pyplot as plt
import netCDF4

import impactlab as il
import impactlab.command_line.main as command_line
from impactlab.plotting.overview import overview
from impactlab.results.contents import DIGESTS
from impactlab.results.dataset import CONFIGURATION
from tests.strangers.attempt import attempt
from tests.strangers.damage import NETWORK

LONGEST = 3.0
"""Time that a simulation may take to be made again (s)."""


def made(path):
    """Write the file that is changed."""
    record = [
        il.Density(bins=20), il.JointDensity("a", "b", bins=10), il.PerRealization(), il.FinalState(),
        il.Trajectory(0.1),
    ]  # fmt: skip
    il.save(il.simulate(NETWORK, 4.0, realizations=64, rng=1, record=record), path)


def _command(*words):
    code = command_line.main(list(map(str, words)))
    if code not in (0, 1, 2):
        raise AssertionError(f"exit code {code}")


def _drawn(draw):
    def read(file):
        draw(il.load(file))
        plt.close("all")

    return read


READERS = {
    "load": il.load,
    "network_of": il.network_of,
    "rerun": lambda file: il.rerun(file, max_seconds=LONGEST),
    "citation": lambda file: il.citation(str(file)),
    "overview": _drawn(overview),
    "animate": _drawn(lambda data: il.animate(data.isel(time=slice(0, 3))).html),
    "trajectory": _drawn(il.plot.trajectory),
    "phase_portrait": _drawn(lambda data: il.plot.phase_portrait(data, "a")),
    "joint_density": _drawn(il.plot.joint_density),
    "html": lambda file: il.load(file)._repr_html_(),
    "absolute_acceleration": il.absolute_acceleration,
    "initial": lambda file: il.simulate(NETWORK, 1.0, realizations=64, initial=str(file), rng=2),
    "effective_samples": lambda file: il.effective_samples(il.load(file)),
    "compare": lambda file: il.compare(il.load(file), il.exact(NETWORK)),
    "plot": lambda file: _command("plot", file, "-o", file.with_suffix(".svg")),
}
"""What reads a result, by name; that of the command line writes a figure beside it."""


def _set(*path_and_value):
    *path, key, value = path_and_value

    def change(data):
        for name in path:
            data = data[name]
        data[key] = value

    return change


_BODY, _GAP, _RUN = ("network", "oscillators", "a"), ("network", "contacts", "g"), ("simulate",)

_LARGE = {
    "type": "LinearStructure",
    "mass": [1.0] * 300,
    "damping": [[0.0] * 300] * 300,
    "stiffness": [[0.0] * 300] * 300,
}

CONFIGURATIONS = {
    "nothing": dict.clear,
    "another question": _set("shell", {"command": "true"}),
    **{f"network {value!r}": _set("network", value) for value in (None, [1], "x", 5, {}, {"oscillators": 5})},
    **{f"contacts {value!r}": _set("network", "contacts", value) for value in (None, [1], "x", {"g": None},
    {"g": "x"})},
    **{f"first {value!r}": _set(*_GAP, "first", value) for value in (
        ["a", "b"], {"combination": [1]}, {"combination": {"a": "x"}}, {"wall": 5}, 5, None, "a" * 5000)},
    **{f"clearance {value!r}": _set(*_GAP, "clearance", value) for value in (
        "x", None, math.nan, 1e308, [1], 10**90, {"a": 1})},
    "contact without a side": lambda data: data["network"]["contacts"]["g"].pop("first"),
    **{f"oscillators {value!r}": _set("network", "oscillators", value) for value in (None, [1], {"a": None},
    {"a": "x"})},
    "body without a type": lambda data: data["network"]["oscillators"]["a"].pop("type"),
    **{f"type {value!r}": _set(*_BODY, "type", value) for value in (
        5, None, "os.system", "TwoSystemStudy", "__import__", "impactlab.components.oscillator.LinearOscillator",
        "builtins.eval", "Component", [1])},
    "many modes": _set(*_BODY, {"type": "ModalStructure", "natural_frequencies": [1.0] * 3000, "damping_ratios": 0.1}),
    "a large structure": _set(*_BODY, _LARGE),
    "10⁹ cosines": _set("network", "excitations", "a", {
        "type": "ShinozukaNoise", "spectral_density": 1.0, "components": 10**9, "allow_repeat": True}),
    "10⁵ samples": _set("network", "excitations", "a", {
        "type": "SampledForce", "times": list(range(10**5)), "values": [1.0] * 10**5}),
    **{f"simulate {value!r}": _set("simulate", value) for value in (None, [1], "x", {})},
    **{f"option {name}": _set(*_RUN, name, value) for name, value in {
        "out": "PWNED.nc", "checkpoint": "PWNED", "executor": "x", "progress": "x", "coarse": True, "rng": 5}.items()},
    **{f"duration {value!r}": _set(*_RUN, "duration", value) for value in (1e12, "x", None, -1.0, math.nan)},
    **{f"realizations {value!r}": _set(*_RUN, "realizations", value) for value in (10**10, 4 * 10**6, 0, 1.5)},
    **{f"step {value!r}": _set(*_RUN, "step", value) for value in (1e-9, math.nan, "x", 0.0)},
    **{f"spin_up {value!r}": _set(*_RUN, "spin_up", value) for value in (1e9, "x", math.inf)},
    **{f"initial {value!r}": _set(*_RUN, "initial", value) for value in (
        "/etc/passwd", {"displacement": 5}, [1], 5, {"displacement": {"a": [1.0] * 7}})},
    **{f"record {str(value)[:40]}": _set(*_RUN, "record", value) for value in (
        ["x"], [None], {"type": "Density"}, [{"type": "Density", "bins": 10**12}], [{"type": "Density", "bins": 10**8}],
        [{"type": "Trajectory", "interval": 1e-9}], [{"type": "Observable", "formula": "__import__('os')"}])},
    **{f"integrator {value!r}": _set(*_RUN, "integrator", value) for value in (None, [1],
    {"type": "ExplicitIntegrator"})},
    **{f"statistics {value!r}": _set(*_RUN, "statistics", value) for value in (5, ["zz"], {"a": 1})},
    **{f"seed {value!r}": _set(*_RUN, "seed", value) for value in ([1.0, 2.0], [True, False], [1, 2, 3], None,
    [2**64, 0])},
    "text None": _set("text", None),
    **{f"only {name} {value!r}": lambda data, name=name, value=value: (data.clear(), data.update({name: value}))
       for name in ("sweep", "study", "uncertain", "basins", "orbits", "lyapunov", "fragility", "bifurcation", "spread",
                    "continuation")
       for value in (None, [1], {}, {"checkpoint": "PWNED"})},
    "10⁵ realizations for a day": lambda data: data["simulate"].update(realizations=10**5, duration=1e5),
}  # fmt: skip
"""Changes of the configuration."""

TEXTS = {
    "no JSON": "{", "number": "5", "null": "null", "list": "[]", "deep list": "[" * 100_000,
    "deep mapping": '{"a":' * 50_000,
    "deep and whole": '{"network":' + "[" * 900 + "]" * 900 + "}",
    "5000 digits": '{"network":' + "1" * 5000 + "}", "300 digits": '{"network":' + "1" * 300 + "}",
    "no number": '{"network":NaN}', "the same twice": '{"network":{},"network":5}',
    "surrogate": '{"network":"\\ud800"}',
}  # fmt: skip
"""Texts in the place of the configuration."""


def _attribute(name, value, variable=None):
    return lambda file: (file if variable is None else file[variable]).setncattr(name, value)


def _values(variable, place, value):
    return lambda file: file[variable].__setitem__(place, value)


VARIABLES = {
    "time in days": _attribute("units", "days since 0000-00-00", "time"),
    "scale": _attribute("scale_factor", 1e300, "displacement"),
    "missing": _attribute("missing_value", 0.0, "contact_ratio"),
    "title": _attribute("title", "<script>alert(1)</script>"),
    "references": _attribute("references", 5.0),
    **{f"attribute step {value!r}": _attribute("step", value) for value in ("x", math.nan)},
    "realizations": _attribute("realizations", "x"),
    "initial": _attribute("initial", "zz"),
    "units": _attribute("units", [1, 2], "contact_ratio"),
    "long_name": _attribute("long_name", "<img src=x onerror=alert(1)>", "contact_ratio"),
    "formula": _attribute("long_name", "$\\frac{$", "displacement"),
    "formula in units": _attribute("units", "$\\x$", "displacement"),
    "a group": lambda file: file.createGroup("g"),
    "deep groups": lambda file: file.createGroup("/".join("g" * 400)),
    **{f"label {value[:9]!r}": _values("oscillator", 0, value) for value in ("<script>", "$\\frac{$", "b", "",
    "a" * 10_000)},
    "no times": _values("time", slice(None), math.nan),
    **{f"displacement {value!r}": _values("displacement", slice(None), value) for value in (math.inf, 1e308)},
    "10¹⁰ numbers": lambda file: file.createDimension("much", 10**10)
    and file.createVariable("much", "f8", ("much",), chunksizes=(1000,)),
}  # fmt: skip
"""Changes of variables and attributes."""


_FEW = "load", "network_of", "citation", "rerun", "trajectory"
"""Readers of changes that drawings can notice in one way only: they read the network, or cannot read the text."""

_OF_THE_RUN = (
    "option", "duration", "realizations", "step", "spin_up", "record", "integrator", "statistics", "seed", "only",
)  # fmt: skip
"""Beginnings of such changes of the configuration; all texts are."""


def tampered(folder, cases=None):
    """Count what all readers make of each change; list what is raw, hangs or has side effects."""
    good, file, found, missed = folder / "good.nc", folder / "tampered.nc", Counter(), []
    made(good)
    configuration = json.loads(il.load(good).attrs[CONFIGURATION])

    def read(name, change):
        shutil.copy(good, file)
        with netCDF4.Dataset(file, "a") as data:
            data.delncattr(DIGESTS)
            change(data)
        few = name in TEXTS or (name in every and name.startswith(_OF_THE_RUN))
        for reader in _FEW if few else READERS:
            kind, what, effects = attempt(lambda reader=reader: READERS[reader](file))
            found[kind] += 1
            if kind in ("raw", "hangs") or effects:
                missed.append((name, reader, kind, what if kind == "raw" else effects))

    every = {name: _text_of(change, configuration) for name, change in CONFIGURATIONS.items()}
    every = {**every, **TEXTS}
    changes = {name: _attribute(CONFIGURATION, text) for name, text in every.items()} | VARIABLES
    for name in changes if cases is None else cases:
        read(name, changes[name])
    return len(changes), found, missed


def _text_of(change, configuration):
    own = copy.deepcopy(configuration)
    change(own)
    return json.dumps(own)
