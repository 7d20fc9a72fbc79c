"""The work-precision study: its arithmetic, its baselines, and a small run."""

import numpy as np
import pytest
from impactlab_numerics import WorkPrecisionStudy
from impactlab_numerics.baselines.loops import Loop, SeriesLoop
from impactlab_numerics.scenes import Law, scene
from impactlab_numerics.work_precision.methods import STATISTICS, Findings, Method, seconds_to
from impactlab_numerics.work_precision.results import time_text
from impactlab_numerics.work_precision.study import CHAIN, PAIR

import impactlab as il

pytestmark = pytest.mark.campaign

STUDY = WorkPrecisionStudy


def findings(bias=0.0, bias_error=0.0, **changes):
    arrays = [np.full(4, value) for value in (bias, bias_error, 2.0, 8.0)]
    return Findings(*arrays, **({"step": 0.01, "rate": 1e-5, "startup": 0.5} | changes))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"chain_bodies": 1}, "chain_bodies must be at least 2, or 0"),
        ({"baoab_steps": ()}, "baoab_steps must hold at least one step"),
        ({"accuracies": (0.001, 0.01)}, "accuracies must be falling numbers"),
        ({"realizations": 10}, "at least 64"),
    ],
)
def test_settings_that_make_no_sense_are_refused(settings, message):
    with pytest.raises(il.InvalidInput, match=message):
        WorkPrecisionStudy(**settings)


def test_the_pair_is_the_base_case():
    one, two = scene(2).oscillators.values()
    assert (one.natural_frequency, two.natural_frequency) == pytest.approx((32.0 * np.pi, 2.0 * np.pi))
    assert [noise.spectral_density for noise in scene(2).excitations.values()] == pytest.approx([16.0, 1.0])


def test_items_have_keys_of_their_own():
    items = WorkPrecisionStudy().items()
    assert len({item.key for item in items}) == len(items)
    assert not [item for item in WorkPrecisionStudy(chain_bodies=0).items() if CHAIN in item.key]


def test_the_time_to_an_accuracy():
    # startup + rate scatter (2 / room)², for the density 1 / room
    assert seconds_to(0.01, findings()) == pytest.approx([0.5 + 2e-5 * 4e4] * 3 + [0.5 + 2e-5 * 1e4])
    assert seconds_to(0.01, findings(), direct=True)[0] == pytest.approx(0.5 + 8e-5 * 4e4)
    assert seconds_to(0.01, findings(0.005, 0.001))[0] == pytest.approx(0.5 + 2e-5 * 16e4)
    assert seconds_to(0.01, findings(0.001, 0.001))[0] == seconds_to(0.01, findings())[0]  # not seen
    assert seconds_to(0.01, findings(-0.004, 0.001), deviations=1.0)[0] == seconds_to(0.01, findings(0.005))[0]
    assert seconds_to(0.01, findings(0.001, 0.001), deviations=-2.0)[0] == seconds_to(0.01, findings())[0]
    assert np.isinf(seconds_to(0.01, findings(0.02, 0.001))).all()


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.0312, "31 ms"), (1.96, "2 s"), (600.0, "10 min"), (86400.0, "24 h"), (np.inf, "never")]
)
def test_times_are_written_in_a_suitable_unit(seconds, text):
    assert time_text(seconds) == text


@pytest.mark.parametrize(("method", "step"), [("baoab", 0.001), ("euler_maruyama", 0.0001), ("runge_kutta", 0.001)])
def test_the_loops_for_pairs_and_for_chains_are_the_same_methods(method, step):
    """With one seed both make the same path, to rounding that collisions have not yet magnified."""
    loop = SeriesLoop if method == "runge_kutta" else Loop
    pair, chain = (loop(scene(2), method, step, 50, 7, of_chains=of_chains).run(1) for of_chains in (False, True))
    assert chain.values == pytest.approx(pair.values, rel=1e-3)


def test_bins_hold_the_density_of_the_law():
    for bodies in (2, 3):
        law = Law.of(scene(bodies), 100)
        assert law.density @ np.diff(law.edges) == pytest.approx(1.0, abs=1e-5)
        center = 0.5 * (law.edges[1:] + law.edges[:-1])
        assert (law.density * center**2) @ np.diff(law.edges) == pytest.approx(law.values[0], rel=2e-3)


def test_the_checks_pass_and_every_claim_has_a_verdict(run):
    assert [check for check in run.checks if not check.ok] == []
    verdicts = dict(zip(run.claims["statement"].values, run.claims["verdict"].values, strict=True))
    assert len(verdicts) == 10
    assert set(verdicts.values()) <= {"holds", "does not hold", "not testable"}


def test_all_cases_are_in_the_result(run):
    methods = run.tree["methods"].to_dataset()
    assert set(methods["scene"].values) == {PAIR, CHAIN}
    assert set(methods["tool"].values) == {"impactlab", "numba", "scipy"}
    assert list(methods["statistic"].values) == list(STATISTICS)
    key = Method(PAIR, "impactlab", "exact flow", "white", 0.0).key
    assert float(methods["step"].sel(case=key)) == pytest.approx(0.006, abs=0.0005)
    balanced = methods.sel(case=key, statistic=STATISTICS[0])
    assert 2.0 < float(balanced["direct_scatter"] / balanced["scatter"]) < 12.0  # about 5
    assert (methods["seconds_to"] > methods["startup"]).all()


def test_a_library_that_is_not_installed_is_a_row_that_says_so(run, monkeypatch):
    """The time that it would take is unknown, and nothing is judged by it."""
    from impactlab_numerics.work_precision import collect
    from impactlab_numerics.work_precision.peers import Peer

    absent = Peer("absent_library", "method", 0.002, 8, None)
    found = collect._peer(run.study, absent, Law.of(scene(2), 10))
    assert found.note == "not installed"
    assert np.isnan(seconds_to(0.01, found)).all()


def test_the_checks_see_a_wrong_method(run):
    spoiled = run.tree.copy(deep=True)
    spoiled["methods"]["bias"][:, 1] += 0.2
    failed = [check.name for check in run.study.checks(spoiled) if not check.ok]
    assert failed == ["default method: bias", "all methods solve one problem: bias"]


def test_paths_without_noise_agree(run):
    """Located events, a solver with events and the finest loop solve one problem, in their order of accuracy."""
    paths = run.tree["paths"].to_dataset()
    rows = {
        (str(row["network"].values), str(row["line"].values), str(row["fineness"].values)): float(row["error"])
        for case in range(paths.sizes["case"])
        for row in [paths.isel(case=case)]
    }
    for network in ("linear stop", "Hertz stop", "rigid stop"):
        assert rows[network, "impactlab: located events", "1e-10"] < 1e-9
        assert rows[network, "scipy: DOP853 with events", "1e-10"] < 1e-8
        coarse, fine = (rows[network, "numba: Runge–Kutta", f"{steps} steps"] for steps in (100, 10_000))
        assert fine < 0.05 * coarse  # an impact at the end of a step is of the first order
    assert (paths["seconds"] > 0.0).all()


def test_the_diagrams_and_tables_show_every_method(run, explained):
    explained(run.study, run.figures, run.claims)
    assert set(run.figures) == {"work_precision_base_case", "work_precision_chain", "paths_without_noise"}
    figure = run.figures["work_precision_base_case"]
    labels = {text.get_text() for text in figure.legends[0].get_texts()}
    methods = run.tree["methods"].to_dataset()
    assert labels == {str(line) for line in methods["line"].values[methods["scene"].values == PAIR]}
    tables = dict(run.study.tables(run.tree))
    cases = run.tree["methods"].to_dataset().sizes["case"]
    assert sum(len(rows) for title, rows in tables.items() if title.startswith("E[x²]")) == cases
