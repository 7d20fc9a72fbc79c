"""What a stored configuration may hold, and how long it may keep a machine busy."""

import json

import pytest
import xarray as xr

import impactlab as il
from impactlab.results.dataset import CONFIGURATION, configuration_of
from impactlab.results.stored_options import OPTIONS
from impactlab.sweeps.rerun import QUESTIONS

BODY = il.LinearOscillator(damping=0.4, stiffness=4.0)


def chain(stiffness=1e3):
    law, noise = il.HertzContact(stiffness), il.WhiteNoise(1.0)
    return il.chain(2, BODY, law, clearance=0.1, excitation=noise)


def stored(**configuration):
    return xr.Dataset(attrs={CONFIGURATION: json.dumps({"network": chain().to_dict(), **configuration})})


def test_every_question_has_its_options():
    assert {*QUESTIONS, "simulate", "run", "sweep", "study"} == OPTIONS.keys()


@pytest.mark.parametrize("name", OPTIONS)
def test_no_option_names_a_file_or_a_function(name, tmp_path):
    for option in ("checkpoint", "executor", "out", "progress"):
        smuggled = stored(**{name: dict.fromkeys(OPTIONS[name]) | {option: str(tmp_path / "made")}})
        for read in (il.rerun, il.network_of, il.citation, configuration_of):
            with pytest.raises(il.InvalidInput, match=f"option '{option}' of '{name}', which is none of"):
                read(smuggled)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", QUESTIONS)
def test_what_is_missing_is_told(name):
    for options in ({}, dict.fromkeys(OPTIONS[name])):
        with pytest.raises(il.InvalidInput):
            il.rerun(stored(**{name: options}))
    for options in (None, [1], "x"):
        with pytest.raises(il.InvalidInput, match=f"for options of '{name}'"):
            il.rerun(stored(**{name: options}))


def test_what_is_unknown_is_refused():
    with pytest.raises(il.InvalidInput, match="has 'shell', which this version of impactlab does not know"):
        il.network_of(stored(shell={"command": "true"}))
    deep = "x"
    for _ in range(100):
        deep = [deep]
    with pytest.raises(il.InvalidInput, match="nested in more than"):
        il.network_of(stored(values=deep))
    with pytest.raises(il.InvalidInput, match="digits"):
        il.network_of(stored(values=[10**200]))


@pytest.mark.full
def test_the_time_of_a_simulation_that_is_made_again_is_bounded():
    options = {"realizations": 64, "step": 0.02, "spin_up": 0.0, "rng": 1}
    result = il.simulate(chain(), 2.0, **options)
    assert il.rerun(result, max_seconds=100.0).equals(result)
    configuration = configuration_of(result)
    configuration["simulate"]["duration"] = 1e7
    with pytest.raises(il.InvalidInput, match="Give a larger max_seconds="):
        il.rerun(result.assign_attrs({CONFIGURATION: json.dumps(configuration)}), max_seconds=1.0)
    with pytest.raises(il.InvalidInput, match="max_seconds must be"):
        il.rerun(result, max_seconds=0.0)
    swept = il.sweep(chain, {"stiffness": [1e3, 2e3]}, duration=2.0, **options)
    assert il.rerun(swept, max_seconds=100.0).equals(swept)
    with pytest.raises(il.InvalidInput, match=r"was done in 1e-06 s; give a larger max_seconds="):
        il.rerun(swept, max_seconds=1e-6)
