"""The study of the paper: settings, a small run with its numbers, verdicts, figures."""

import numpy as np
import pytest
from impactlab_two_system import TwoSystemStudy
from impactlab_two_system.claims import STATEMENTS
from impactlab_two_system.results import Measured, Results

import impactlab as il
from impactlab.studies import VERDICTS
from impactlab.studies.simulations import run_simulations, simulations

pytestmark = pytest.mark.full


def simulated(study: TwoSystemStudy) -> dict:
    return run_simulations(simulations(study), None, 1, None, False)


@pytest.fixture(scope="module")
def run():
    """The quick form of the study, as a dictionary of results and the tree made of it."""
    study = TwoSystemStudy().quick()
    with pytest.warns(il.AccuracyWarning, match="Too few independent samples"):  # one record has no error
        results = simulated(study)
    return study, results, study.collect(results)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"variants": ("exact",)}, "There is no variant 'exact'"),
        ({"normalisation": "consistant"}, "did you mean 'consistent'"),
        ({"reference": "fokker"}, "There is no reference 'fokker'; did you mean 'fokker-planck'"),
        ({"density_clearance": 0.02}, "density_clearance must be one of the clearances"),
        ({"clearances": (0.05, 0.05)}, "clearances must be an array of different values"),
        ({"frequency_ratios": ()}, "frequency_ratios must be an array of different values"),
        ({"frequency_ratios": (0.0,)}, "larger than 0"),
        ({"frequenci_ratios": (1.0,)}, "did you mean 'frequency_ratios'"),
        ({"realizations": 10}, "at least 64"),
        ({"components": 1.5}, "whole number"),
    ],
)
def test_settings_that_make_no_sense_are_refused(settings, message):
    with pytest.raises(il.InvalidInput, match=message):
        TwoSystemStudy(**settings)


def test_the_normalisations_of_the_series():
    study = TwoSystemStudy()
    densities = {
        name: study.network(16.0, 0.05, "paper", normalisation=name).excitations["one"].spectral_density
        for name in ("consistent", "equation 14", "equation 16")
    }
    assert densities["consistent"] == pytest.approx(16.0)
    assert densities["equation 14"] == pytest.approx(16.0 / (4.0 * np.pi))  # S_f = S
    assert densities["equation 16"] == pytest.approx(4.0)  # S_f = πS


def test_items_have_keys_of_their_own_and_follow_the_settings():
    study = TwoSystemStudy()
    items = simulations(study).items
    keys = [item.key for item in items]
    assert len(keys) == len(set(keys)) == 2 * 11 * 3 + 8
    accurate = study.replace(variants=("accurate",))
    assert [item.key for item in accurate.items()] == ["accurate"]
    paper = next(item for item in items if item.key == "paper, frequency_ratio=256.0, clearance=0.1")
    assert paper.options["step"] == 0.001
    assert paper.options["spin_up"] == 0.0
    assert paper.network.excitations["one"].period == pytest.approx(100.0)


def test_the_checks_pass(run):
    study, _, tree = run
    checks = study.checks(tree)
    assert [check for check in checks if not check.ok] == []
    names = " ".join(check.name for check in checks)
    for part in ("exact law: mean_square_displacement", "exact law: densities", "balance", "step at ω̄ = 256"):
        assert part in names


def test_the_checks_see_a_wrong_number(run):
    study, _, tree = run
    spoiled = tree.copy(deep=True)
    spoiled["accurate"]["contact_ratio"] = 1.05 * spoiled["accurate"]["contact_ratio"]
    failed = [check.name for check in study.checks(spoiled) if not check.ok]
    assert failed == ["exact law: contact_ratio"]


def test_the_ensemble_agrees_with_the_exact_law(run):
    study, _, tree = run
    results = Results(study, tree)
    for clearance, exact in ((0.01, 0.05408200897619), (0.05, 0.04965835433094), (0.1, 0.04628987912011)):
        found = results.value("mean_square_displacement", "two", 16.0, clearance)
        assert found.error < 0.012 * exact
        assert abs(found.value - exact) < 3.5 * found.error


def test_one_record_scatters_by_a_tenth(run):
    study, _, tree = run
    scatter = Results(study, tree).one_record("mean_square_displacement", "two", 16.0, 0.05) / 0.04966
    assert scatter == pytest.approx(np.sqrt(1.55 / 100.0), abs=3.5 * 0.1245 / np.sqrt(2 * 255))


def test_every_claim_is_judged(run):
    study, _, tree = run
    table = study.claims(tree)
    assert table.sizes["claim"] == len(STATEMENTS) == 52
    assert set(table["verdict"].values) <= set(VERDICTS)
    verdicts = dict(zip(table["statement"].values, table["verdict"].values, strict=True))
    expected = {
        "A record of 100 s at 1 ms gives 4×10⁶ samples.": "does not hold",
        "Base case, System 2: obvious discrepancies.": "sampling error",
        "At ω̄ = 12 (ratio 1.33) the densities coincide.": "not testable",
        "At ω̄ = 1 the densities of both systems are far apart.": "holds",
        "In the simulation the linear E[v²] is πS/(8ζω).": "does not hold",
        "Contact leaves E[v²] at its linear value.": "holds partly",
        "ω̄ = 1: the simulated E[x2²] is the greatest of the three.": "holds",
        "The smaller the clearance, the greater the contact ratio.": "holds",
    }
    assert {statement: verdicts[statement] for statement in expected} == expected
    assert all(text for name in ("section", "measured", "criterion") for text in table[name].values)


def test_a_verdict_follows_the_numbers(run):
    study, _, tree = run
    changed = tree.copy(deep=True)
    changed["accurate"]["contact_ratio"] = changed["accurate"]["contact_ratio"][:, ::-1].copy()
    changed["accurate"]["contact_ratio"][:] = tree["accurate"]["contact_ratio"].values[:, ::-1]
    table = study.claims(changed)
    statement = "The smaller the clearance, the greater the contact ratio."
    (row,) = np.flatnonzero(table["statement"].values == statement)
    assert table["verdict"].values[row] in ("does not hold", "sampling error")


def test_the_nine_corrections_have_numbers(run):
    _, _, tree = run
    table = tree["corrections"].to_dataset()
    assert sorted(set(table["correction"].values)) == list(range(1, 10))
    assert np.isfinite(table["found"]).all()
    found = dict(zip(table["quantity"].values, table["found"].values, strict=True))
    assert found["relative error of E[x1²] by the paper's step at ω̄ = 256"] == pytest.approx(-0.37, abs=0.005)
    assert found["correlation of x2 with itself one duration later"] > 0.99
    assert found["time after which the series of equally spaced lines repeats"] == pytest.approx(100.0)
    assert found["E[v1²], normalisation equation 14, against πS/(8ζω)"] == pytest.approx(0.1989, rel=0.01)


def test_without_the_reference_nothing_is_compared_with_it(run):
    study, results, _ = run
    tree = study.replace(reference="none").collect(results)
    assert "reference" not in tree.children
    bare = study.replace(reference="none")
    verdicts = dict(zip(*(bare.claims(tree)[name].values for name in ("statement", "verdict")), strict=True))
    assert verdicts["At ω̄ = 16 all densities of the two methods are almost the same."] == "not testable"
    assert verdicts["The smaller the clearance, the greater the contact ratio."] == "holds"
    assert {name for name, _ in bare.figures(tree)} == {f"figure_{number}" for number in range(1, 9)}


@pytest.mark.campaign
def test_the_fokker_planck_equation_as_reference():
    study = TwoSystemStudy(
        frequency_ratios=(1.0, 2.0), clearances=(0.05,), variants=("accurate",), realizations=128, duration=60.0,
        spectral_density_one=1.5, contact_stiffness=50.0, reference="fokker-planck", fokker_planck_tolerance=0.05,
    )  # fmt: skip
    tree = study.collect(simulated(study))
    solved = tree["reference/fokker_planck"].to_dataset()
    assert solved["frequency_ratio"].values.tolist() == [1.0]  # of those that the study has
    checks = [item for item in study.checks(tree) if item.name.startswith("Fokker–Planck equation")]
    assert len(checks) == 8
    assert all(item.ok for item in checks), checks
    assert tree["reference/fokker_planck_convergence"]["direction"].values[0] == "gap"
    density = tree["reference/fokker_planck_density"].to_dataset().sel(oscillator="two")
    measured = tree["density/accurate"].to_dataset().sel(frequency_ratio=[1.0], oscillator="two")
    difference = measured.density_velocity - density.density_velocity
    assert (abs(difference) <= 5.0 * measured.density_velocity_standard_error + 2e-3).all()
    axes = dict(study.figures(tree))["figure_7"].axes[0]
    stars = [line.get_ydata() for line in axes.get_lines() if line.get_marker() == "*"]
    np.testing.assert_allclose(stars, solved.contact_ratio.values[:, 0, 0][None])


def test_the_figures_show_what_was_found(run, explained):
    study, _, tree = run
    figures = dict(study.figures(tree))
    explained(study, figures, study.claims(tree))
    assert list(figures) == [f"figure_{number}" for number in range(1, 9)]
    axes = figures["figure_7"].axes[0]
    drawn = [line.get_ydata() for line in axes.get_lines() if line.get_marker() == "o"]
    expected = tree["accurate"]["contact_ratio"].sel(contact="gap").values.T
    np.testing.assert_allclose(drawn, expected)


def test_one_variant_alone_is_enough():
    study = TwoSystemStudy(
        variants=("paper",),
        frequency_ratios=(16.0,),
        clearances=(0.05,),
        duration=20.0,
        components=10000,
        paper_seeds=4,
    )
    with pytest.warns(il.AccuracyWarning):
        results = simulated(study)
    tree = study.collect(results)
    assert "accurate" not in tree.children
    assert study.claims(tree).sizes["claim"] == len(STATEMENTS)
    assert list(study.sections) == list(dict.fromkeys(statement.section for statement in STATEMENTS))
    figures = dict(study.figures(tree))
    assert set(figures) == {"figure_1", "figure_2", "figure_5", "figure_6", "figure_7"}
    squares = [line for line in figures["figure_7"].axes[0].get_lines() if line.get_marker() == "s"]
    np.testing.assert_allclose(squares[0].get_ydata(), tree["paper"]["contact_ratio"].values.ravel())


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (Measured(0.123456, 0.0012), "0.1235 ± 0.0012"),
        (Measured(1234.5, 67.0), "1230 ± 70"),
        (Measured(0.5), "0.5"),
    ],
)
def test_numbers_are_shown_with_their_errors(value, text):
    assert f"{value}" == text


def test_errors_propagate():
    ratio = Measured(2.0, 0.02) / Measured(4.0, 0.04)
    assert ratio.value == 0.5
    assert ratio.error == pytest.approx(0.5 * np.hypot(0.01, 0.01))
    assert Measured(2.0, 0.02).against(Measured(1.0)).value == pytest.approx(1.0)
