"""What is shown while something runs: where somebody watches, and only there."""

import importlib
import json
import sys
import types

import numpy as np
import pytest
import xarray as xr

import impactlab as il
from impactlab.compiling import announced as announcing
from impactlab.compiling import build, jit
from impactlab.compiling.announced import announced
from impactlab.compiling.jit import compilations
from impactlab.progress import is_shown, is_watched, reporter
from impactlab.results.measured import headline


@pytest.fixture
def notebook(monkeypatch):
    """Let IPython be there, with a kernel or without one."""

    def make(kernel):
        module = types.ModuleType("IPython")
        module.get_ipython = lambda: types.SimpleNamespace(kernel=kernel) if kernel else None
        monkeypatch.setitem(sys.modules, "IPython", module)

    return make


def test_a_notebook_is_watched(notebook):
    notebook(None)
    assert not is_watched()
    notebook(object())
    assert is_watched()
    assert is_shown(None)
    assert not is_shown(False)
    assert not is_shown(print)


def test_a_bar_in_a_notebook(notebook, capsys, monkeypatch):
    shown = []
    display = types.ModuleType("IPython.display")
    display.HTML = str
    display.display = lambda bar, display_id: shown.append(bar) or types.SimpleNamespace(update=shown.append)
    notebook(object())
    monkeypatch.setitem(sys.modules, "IPython.display", display)
    monkeypatch.setattr("impactlab.progress._PATIENCE", 0.0)
    show = reporter(None)
    show(0.5, lambda: "mean of <one> 2")
    show(1.0)
    assert shown[0].startswith('<progress value="0.500" max="1"></progress>  50 %')
    assert shown[0].endswith("left   mean of &lt;one&gt; 2")
    assert shown[1] == '<progress value="1.000" max="1"></progress> 100 %'
    assert capsys.readouterr().err == ""


@pytest.fixture
def compiled(tmp_path, monkeypatch):
    """A function of a module, which calls another one, that is compiled when it is called."""
    text = "import numba\n@numba.njit\ndef twice(x): return x + x\n@numba.njit\ndef four(x): return twice(twice(x))\n"
    monkeypatch.syspath_prepend(str(tmp_path))

    def make(name):
        (tmp_path / f"{name}.py").write_text(text, encoding="utf-8")
        importlib.invalidate_caches()
        return importlib.import_module(name).four

    return make


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A cache of compiled code in which nobody has compiled anything."""
    here = tmp_path / "digest-numba1-py3"
    here.mkdir()
    monkeypatch.setattr(announcing, "cache_folder", lambda: here)
    return here


@pytest.mark.parametrize("progress", [None, True])
def test_compilation_is_told_once(capsys, compiled, folder, progress):
    """Also in pipes, which nobody watches."""
    with announced(progress):
        assert compiled(f"compiled_one_{progress}")(2) == 8
        assert compiled(f"compiled_two_{progress}")(2) == 8
    assert capsys.readouterr().err == (
        "Compiling, once: the machine code is kept. The first time this takes half a minute or so of one core.\n"
    )


def test_the_time_of_the_same_compilation_is_told(capsys, compiled, folder):
    """Known from folders of other versions, too; one that was short is not worth a line."""
    with announced(True):
        compiled("compiled_three")(2)
    assert "half a minute" in capsys.readouterr().err
    assert 0.0 < json.loads((folder / "seconds.json").read_text())["four"] < announcing._LONG
    with announced(True):
        compiled("compiled_four")(2)
    assert capsys.readouterr().err == ""
    other = folder.parent / "other-numba1-py3"
    (folder / "seconds.json").unlink()
    other.mkdir()
    (other / "seconds.json").write_text('{"four": 17.3, "five": 99.0}')
    with announced(True):
        compiled("compiled_five")(2)
    assert "is kept. The last time this took 17 s of one core.\n" in capsys.readouterr().err


def test_what_is_not_told(capsys, compiled, folder):
    done = compiled("compiled_before")
    done(2)
    with announced(True):
        done(2)
        compiled("impactlab_network_1")(2)  # takes a second at most
    with announced(False), announced(lambda part: None):
        compiled("compiled_unseen")(2)
    assert capsys.readouterr() == ("", "")
    assert not list(folder.iterdir())


@pytest.mark.full
def test_functions_of_a_new_law_are_not_told(capsys, folder, monkeypatch, tmp_path):
    """Their module is compiled anew, and parts of the kernels for it."""
    for module in (build, jit):
        monkeypatch.setattr(module, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(build, "_modules", {})

    class Own(il.ContactLaw):
        stiffness: float = il.parameter(units="N m-1")

        def force(indentation, stiffness):
            return 1.25 * stiffness * indentation

    body = il.LinearOscillator.from_frequency(6.0, 0.1)
    network = il.Network({"a": body}, {"stop": il.Contact("a", il.WALL, Own(1e3))})
    with announced(None):
        before, compiled = compilations(), network.compile()
        compiled.rhs(0.0, compiled.state(displacement={"a": 0.1}))
    assert compilations() > before
    assert capsys.readouterr().err == ""


def test_the_headline_of_a_result():
    data = xr.Dataset({"contact_ratio": ("contact", [0.25, 0.5])}, {"contact": ["gap", "stop"]})
    assert headline(data) == "contact ratio of gap 0.25"
    data["contact_ratio_standard_error"] = "contact", [0.0123, 0.1]
    assert headline(data) == "contact ratio of gap 0.250 ± 0.012"
    free = xr.Dataset({"contact_ratio": ("contact", np.zeros(0)), "mean_square_displacement": ("oscillator", [2.0])},
                      {"oscillator": ["one"]})  # fmt: skip
    assert headline(free) == "mean square displacement of one 2"
    assert headline(xr.Dataset()) == "done"
