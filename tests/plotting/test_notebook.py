"""Pictures in notebooks: each cell of a notebook that runs shows all figures that it draws."""

import os
from pathlib import Path

import pytest
from nbclient import NotebookClient
from nbformat.v4 import new_code_cell, new_notebook

import impactlab as il

SETUP = """
import numpy as np
import xarray as xr
import impactlab as il

chain = il.chain(2, il.LinearOscillator(stiffness=1.0), il.HertzContact(1e4))
result = xr.Dataset({"contact_ratio": ("contact", [0.1, 0.2])}, {"contact": ["a", "b"]})
path = xr.Dataset({"displacement": (("time", "oscillator"), np.eye(2))}, {"time": [0.0, 0.1], "oscillator": ["a", "b"]})
"""
PROFILE = "il.plot.profile(result, 'contact_ratio')\n"
NETWORK = "il.plot.network(chain)\n"
OWN = "import matplotlib.pyplot as plt\nplt.figure()\nplt.plot([1, 2])\n"


@pytest.fixture
def shown(monkeypatch, tmp_path):
    """Run cells in a fresh notebook, and return how many pictures each of them shows."""
    package = str(Path(il.__file__).parents[1])
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, [package, os.environ.get("PYTHONPATH")])))
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path))
    monkeypatch.setenv("JUPYTER_RUNTIME_DIR", str(tmp_path))
    monkeypatch.delenv("MPLBACKEND", raising=False)

    def count(*cells):
        notebook = new_notebook(cells=list(map(new_code_cell, cells)))
        NotebookClient(notebook, timeout=120).execute()
        data = [[item.get("data", {}) for item in cell.outputs] for cell in notebook.cells]
        return [sum(f"{item.get('text/html')}".count("<img") + ("image/png" in item) for item in cell) for cell in data]

    return count


@pytest.mark.full
def test_every_cell_shows_its_figures(shown):
    """Also those of the user, and several of one cell; a film has an image for the sample that it shows."""
    cells = [SETUP + PROFILE, PROFILE, NETWORK, OWN, PROFILE + OWN + NETWORK, "il.animate(path)", PROFILE]
    assert shown(*cells) == [1, 1, 1, 1, 3, 1, 1]


@pytest.mark.campaign
@pytest.mark.parametrize("first", ["import matplotlib.pyplot as plt\n", "%matplotlib inline\n"])
def test_after_other_beginnings(shown, first):
    assert shown(first + SETUP, PROFILE, PROFILE, OWN) == [0, 1, 1, 1]
