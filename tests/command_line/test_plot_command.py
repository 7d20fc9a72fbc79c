"""``impactlab plot``: a figure of a file."""

from pathlib import Path

import pytest
import xarray as xr

import impactlab as il
from impactlab.command_line.main import main
from impactlab.command_line.output import DONE, USAGE


@pytest.fixture(autouse=True)
def _here(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    value = ("clearance", "contact"), [[0.1], [0.2]]
    result = xr.Dataset({"contact_ratio": value}, {"clearance": [0.0, 0.1], "contact": ["gap"]})
    il.save(result, "result.nc")
    il.save(xr.DataTree.from_dict({"/statistics": result}), "study.nc")
    Path("notes.txt").write_text("a\n", encoding="utf-8")
    Path("broken.toml").write_text("[oscilators.a]\n", encoding="utf-8")
    network = il.Network({"a": il.LinearOscillator(stiffness=1.0)})
    Path("network.toml").write_text(network.to_toml(), encoding="utf-8")


def test_a_result_is_drawn(capsys):
    assert main(["plot", "result.nc"]) == DONE
    assert capsys.readouterr() == ("", "impactlab: the figure is result.svg\n")
    assert Path("result.svg").read_bytes().startswith(b"<?xml")
    assert main(["plot", "result.nc", "-o", "other.png"]) == DONE
    assert Path("other.png").read_bytes().startswith(b"\x89PNG")


def test_the_file_of_a_network_is_said_to_be_one_and_drawn(capsys):
    assert main(["plot", "network.toml"]) == DONE
    said = "network.toml describes a network, which is drawn\nimpactlab: the figure is network.svg\n"
    assert capsys.readouterr() == ("", f"impactlab: {said}")
    assert Path("network.svg").read_bytes().startswith(b"<?xml")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["study.nc"], "is the result of a study"),
        (["missing.nc"], "There is no file missing.nc."),
        (["notes.txt"], "notes.txt is no netCDF file, such as impactlab writes."),
        (["broken.toml"], "broken.toml, line 1, oscilators: A network has no 'oscilators'; did you mean 'oscillators'"),
        (["result.nc", "-o", "figure.xyz"], "must end in .svg"),
    ],
)
def test_what_cannot_be_drawn(arguments, message, capsys):
    assert main(["plot", *arguments]) == USAGE
    assert message in capsys.readouterr().err
    assert not list(Path().glob("*.svg"))
