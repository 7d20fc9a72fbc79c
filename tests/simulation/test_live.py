"""What a run tells while it goes on: the plain mean over realizations of what is done."""

import re

import numpy as np
import pytest

import impactlab as il
from impactlab.progress import Report, reporter
from impactlab.results.measured import headline_text
from impactlab.simulation import ensemble
from impactlab.studies.simulations import Simulations, run_simulations
from impactlab.studies.study import Item

BODY = il.LinearOscillator(stiffness=4.0, damping=0.5)
NETWORK = il.Network(
    {"one": BODY, "two": BODY},
    {"gap": il.Contact("one", "two", il.LinearContact(100.0), clearance=0.2)},
    {"one": il.WhiteNoise(0.2), "two": il.WhiteNoise(0.1)},
)


@pytest.fixture(autouse=True)
def _short_calls(monkeypatch):
    """Let compiled calls be short, so that even short runs are heard of often."""
    shape = ensemble.Block.advance

    def advance(self, steps, sampler):
        for done in range(0, steps, 96):
            shape(self, min(96, steps - done), sampler)

    monkeypatch.setattr(ensemble.Block, "advance", advance)


def told(network, realizations, duration, **options):
    """The texts of a run, and its result."""
    texts = []
    result = il.simulate(
        network, duration, realizations=realizations, rng=1, record=il.PerRealization(),
        progress=Report(lambda part, found: texts.append(found())), **options,
    )  # fmt: skip
    return texts, result


@pytest.mark.parametrize(
    ("realizations", "duration", "options"),
    [(64, 60.0, {}), (16, 340.0, {}), (64, 60.0, {"integrator": il.RungeKutta4(), "step": 0.02})],
    ids=["two batches", "many batches", "another method"],
)
def test_the_last_text_is_the_mean_over_realizations(realizations, duration, options):
    texts, result = told(NETWORK, realizations, duration, **options)
    values = result.contact_ratio_by_realization.sel(contact="gap").values
    assert texts[-1] == headline_text("contact_ratio", "gap", values.mean(), values.std(ddof=1) / np.sqrt(realizations))


def test_texts_on_the_way(monkeypatch):
    heard = []
    take = ensemble.Live.take
    monkeypatch.setattr(ensemble.Live, "take", lambda self, *block: (take(self, *block), heard.append(self.text())))
    _, result = told(NETWORK, 64, 60.0)
    expected, error = result.contact_ratio.item(), result.contact_ratio_standard_error.item()
    assert "" in heard  # in the spin-up
    numbers = [re.fullmatch(r"contact ratio of gap ([\d.]+) ± ([\d.]+)", text) for text in heard if text]
    half = [tuple(map(float, found.groups())) for found in numbers[len(numbers) // 2 :]]
    assert len(half) > 10
    for value, own in half:
        assert abs(value - expected) < 5.0 * np.hypot(own, error)
        assert own > 0.9 * error  # without control variates, and of a part of the run


def test_few_realizations_have_no_error_yet():
    texts, result = told(NETWORK, 4, 1300.0)
    values = result.contact_ratio_by_realization.sel(contact="gap").values
    assert texts[-1] == f"contact ratio of gap {values.mean():.4g}"


@pytest.mark.full
def test_without_contacts_it_is_a_mean_square():
    cubic = {"tie": il.Coupling("one", "two", il.CubicCoupling(0.1))}
    texts, result = told(NETWORK.replace(contacts={"gap": None}, couplings=cubic), 64, 40.0)
    value = float(re.fullmatch(r"mean square displacement of one ([\d.]+) ± [\d.]+", texts[-1])[1])
    values = result.mean_square_displacement_by_realization.sel(oscillator="one").values
    assert value == pytest.approx(values.mean(), rel=0.02)


def test_functions_hear_the_part_alone():
    parts = []
    il.simulate(NETWORK, 20.0, realizations=64, rng=1, progress=parts.append)
    assert parts[-1] == 1.0
    report = Report(lambda part, found: None)
    assert reporter(report) is report


def test_bars_show_it(capsys, monkeypatch):
    monkeypatch.setattr("impactlab.progress._PATIENCE", 0.0)
    show = reporter(True)
    show(0.5, lambda: "contact ratio of gap 0.1 ± 0.01")
    show(1.0, lambda: "what the result says")
    lines = capsys.readouterr().err.split("\r")
    assert lines[1].rstrip().endswith("left   contact ratio of gap 0.1 ± 0.01")
    assert lines[2].startswith("[##############################] 100 %")
    assert len(lines[2]) > len(lines[1].rstrip())  # which it covers
    assert "result" not in lines[2]


def test_studies_show_it(capsys, monkeypatch):
    monkeypatch.setattr("impactlab.studies.simulations.is_watched", lambda: True)
    items = [Item("pair", NETWORK, {"duration": 4000.0, "realizations": 64, "rng": 1})]
    run_simulations(Simulations(items, {}), None, 1, None, True)
    assert re.search(r"\[1/1\] pair \d+ %: contact ratio of gap 0\.\d+ ± 0\.\d+", capsys.readouterr().err)
