"""``impactlab simulate``: a network's file, options in it and beside it."""

import re
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import impactlab as il
from impactlab.command_line.main import main
from impactlab.command_line.output import DONE, USAGE
from impactlab.results.measured import measured_text

NETWORK = il.chain(
    2, il.LinearOscillator(stiffness=1.0, damping=1.0), il.HertzContact(10.0), excitation=il.WhiteNoise(1.0)
)
OPTIONS = """
[simulate]
duration = 20.0
realizations = 64
seed = 1
records = ["PerRealization"]
"""


@pytest.fixture(autouse=True)
def _here(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    Path("net.toml").write_text(NETWORK.to_toml() + OPTIONS, encoding="utf-8")


def test_a_file_is_simulated_with_its_options(capsys):
    assert main(["simulate", "net.toml", "-o", "result.nc"]) == DONE
    shown = capsys.readouterr()
    assert shown.err == "impactlab: the result is result.nc\n"
    wanted = il.simulate(NETWORK, 20.0, realizations=64, rng=1, record=il.PerRealization())
    found = il.rerun("result.nc")
    assert found.contact_ratio.equals(wanted.contact_ratio)
    assert "contact_ratio_by_realization" in found
    text = measured_text(wanted.contact_ratio.item(), wanted.contact_ratio_standard_error.item())
    assert re.search(rf"^contact_ratio +contact_0 +{re.escape(text)}$", shown.out, re.MULTILINE)
    assert re.search(r"^mean_contact_force +contact_0 .* ± .* N$", shown.out, re.MULTILINE)


def test_options_beside_the_file_count(capsys):
    records = [
        "--records",
        "Density,quantity=velocity,bins=20,limits=[['body_0', -4, 4], ['body_1', -4, 4]]",
        "FinalState",
    ]
    given = ["--duration", "10", "--realizations", "65", "--seed", "2", *records]
    assert main(["simulate", "net.toml", "-q", "-o", "result.nc", *given]) == DONE
    assert capsys.readouterr() == ("", "")
    with xr.open_dataset("result.nc") as found:
        assert found.sizes["velocity_bin"] == 20
        assert found.sizes["realization"] == 65
        assert "contact_ratio_by_realization" not in found
        record = il.Density("velocity", bins=20, limits=[("body_0", -4.0, 4.0), ("body_1", -4.0, 4.0)])
        wanted = il.simulate(NETWORK, 10.0, realizations=65, rng=2, record=record)
        np.testing.assert_array_equal(found.contact_rate, wanted.contact_rate)


def test_a_tolerance_is_an_option_of_the_file(capsys):
    text = NETWORK.to_toml() + "[simulate]\nseed = 1\ntolerance = {contact_ratio = 0.5}\n"
    Path("net.toml").write_text(text, encoding="utf-8")
    assert main(["simulate", "net.toml", "-o", "result.nc"]) == DONE
    assert Path("result.nc").is_file()


@pytest.mark.full
def test_classes_of_a_module_that_is_named(capsys):
    law = """
import impactlab as il

class OwnLineContact(il.ContactLaw):
    stiffness: float = il.parameter(units="N m-1")

    def force(indentation, stiffness):
        return stiffness * indentation
"""
    Path("own_laws.py").write_text(law, encoding="utf-8")
    text = Path("net.toml").read_text(encoding="utf-8").replace("HertzContact", "OwnLineContact")
    Path("net.toml").write_text(text, encoding="utf-8")
    assert main(["simulate", "net.toml"]) == USAGE
    assert "No component class named 'OwnLineContact'" in capsys.readouterr().err
    assert main(["simulate", "net.toml", "--import", "own_laws.py"]) == DONE
    assert main(["simulate", "net.toml", "--import", "nowhere_at_all"]) == USAGE
    assert "Cannot import nowhere_at_all: ModuleNotFoundError" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("duration =", "duratoin =", r"net\.toml, line \d+, simulate\.duratoin: .*did you mean 'duration'"),
        ("duration = 20.0", 'duration = "x"', r"line \d+, simulate\.duration: duration must be a number"),
        ("PerRealization", "PerRealisation", r"line \d+, simulate\.records: .*did you mean 'PerRealization'"),
        ("duration = 20.0", "", r"error: simulate needs a duration"),
        ("stiffness = 10.0", "stifness = 10.0", r"line \d+, contacts\.contact_0\.law\.stifness: "),
    ],
)
def test_what_is_wrong_in_a_file(old, new, message, capsys):
    text = Path("net.toml").read_text(encoding="utf-8")
    assert old in text
    Path("net.toml").write_text(text.replace(old, new), encoding="utf-8")
    assert main(["simulate", "net.toml", "-o", "result.nc"]) == USAGE
    assert re.search(message, capsys.readouterr().err)
    assert not Path("result.nc").exists()


@pytest.mark.parametrize("arguments", [["--realizations", "0"], ["--records", "Densty"], ["-o", "no/where.nc"]])
def test_what_is_wrong_beside_the_file(arguments, capsys):
    assert main(["simulate", "net.toml", *arguments]) == USAGE
    assert "line" not in capsys.readouterr().err
