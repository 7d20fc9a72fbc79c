"""What is shown while something runs: where somebody watches, and only there."""

import importlib
import sys
import types

import numpy as np
import pytest
import xarray as xr

from impactlab.assembly.compiling import announced
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
    notebook(object())
    monkeypatch.setattr("impactlab.progress._PATIENCE", 0.0)
    show = reporter(None)
    show(0.5)
    show(1.0)
    assert " 50 % " in capsys.readouterr().err


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


def test_compilation_is_told_once(capsys, compiled):
    with announced(True):
        assert compiled("compiled_one")(2) == 8
        assert compiled("compiled_two")(2) == 8
    assert capsys.readouterr().err.count("Compiling, once") == 1


def test_what_is_not_told(capsys, compiled):
    done = compiled("compiled_before")
    done(2)
    with announced(True):
        done(2)
        compiled("impactlab_network_1")(2)  # takes a second at most
    with announced(None), announced(False):  # nobody watches
        compiled("compiled_unseen")(2)
    assert capsys.readouterr() == ("", "")


def test_the_headline_of_a_result():
    data = xr.Dataset({"contact_ratio": ("contact", [0.25, 0.5])}, {"contact": ["gap", "stop"]})
    assert headline(data) == "contact ratio of gap 0.25"
    data["contact_ratio_standard_error"] = "contact", [0.0123, 0.1]
    assert headline(data) == "contact ratio of gap 0.250 ± 0.012"
    free = xr.Dataset({"contact_ratio": ("contact", np.zeros(0)), "mean_square_displacement": ("oscillator", [2.0])},
                      {"oscillator": ["one"]})  # fmt: skip
    assert headline(free) == "mean square displacement of one 2"
    assert headline(xr.Dataset()) == "done"
