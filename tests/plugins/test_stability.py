"""The stability study and the wild scenes: scenes, verdicts, a small run."""

import numpy as np
import pytest
import xarray as xr
from impactlab_numerics import StabilityStudy
from impactlab_numerics.stability.cells import JUDGED, Length, pair, scene_on, shaken, verdict
from impactlab_numerics.stability.study import AXES
from impactlab_numerics.stability.wild_runs import BAD, Outcome, run_scene
from impactlab_numerics.stability.wild_scenes import FAMILIES, wild_scene

import impactlab as il

pytestmark = pytest.mark.campaign

STUDY = StabilityStudy


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"clearances": (1.0, 0.0)}, "clearances must be rising numbers"),
        ({"factors": (1.0, 1.0)}, "factors must be rising numbers"),
        ({"hertz_stiffness": (0.0, 1.0)}, "larger than 0"),
        ({"paper_band": (500.0, 0.0)}, "band"),
    ],
)
def test_settings_that_make_no_sense_are_refused(settings, message):
    with pytest.raises(il.InvalidInput, match=message):
        StabilityStudy(**settings)


@pytest.mark.parametrize("axis", AXES)
def test_every_place_has_an_exact_law(axis):
    """The temperatures are equal, and one thing is changed."""
    for value in getattr(StabilityStudy(), axis):
        network = scene_on(axis, value)
        assert np.isfinite(il.exact(network).statistics()["contact_rate"]).all()
    same = {"frequency_ratios": 16.0, "mass_ratios": 1.0, "damping_ratios": 0.1, "clearances": 0.2}
    assert scene_on(axis, same.get(axis, 1e4)).oscillators == pair().oscillators


def test_series_are_those_of_the_white_noise():
    """They have its density in their band, and a period that a given step of a cell divides."""
    white = pair()
    for name, noise in shaken(white, 400).excitations.items():
        assert noise.spectral_density == white.excitations[name].spectral_density
        assert noise.band[1] * np.pi == pytest.approx(white.oscillators[name].natural_frequency)


def test_a_length_is_what_is_wanted_or_what_is_left():
    network = pair()
    enough, less = Length.of(network, 1e9, 2.0), Length.of(network, 5e3, 2.0)
    assert enough.total < 1e9
    assert less.total == pytest.approx(5e3)
    assert Length.of(network, 1e2, 2.0) is None
    paired = Length.of(network, 1e9, 2.0, 200.0)
    assert paired.total < 0.5 * enough.total
    assert paired.duration + paired.spin_up == pytest.approx(200.0)


def made(values, errors, contacts=1e6, references=None):
    """A result whose statistics are known numbers, and references of 1."""
    data = {}
    for name in JUDGED:
        dim = "contact" if "contact" in name else "oscillator"
        data[name] = (dim, [values.get(name, 1.0)])
        data[f"{name}_standard_error"] = (dim, [errors.get(name, 1e-4)])
    result = xr.Dataset(data, {"oscillator": ["a"], "contact": ["c"]}, {"duration": contacts, "realizations": 1})
    return verdict(result, references or {name: np.ones(1) for name in JUDGED})


@pytest.mark.parametrize(
    ("values", "errors", "contacts", "kind", "statistic"),
    [
        ({}, {}, 1e6, "accurate", ""),
        ({"contact_ratio": 1.02}, {}, 1e6, "degraded", "contact_ratio of c"),
        ({"contact_ratio": 1.02}, {"contact_ratio": 0.005}, 1e6, "accurate", "contact_ratio of c"),
        ({"contact_ratio": 1.2}, {"contact_ratio": 0.02}, 1e6, "accurate", ""),  # not judged
        ({"contact_ratio": 0.0}, {"contact_ratio": 0.0}, 10.0, "accurate", ""),  # too few contacts
        ({"mean_square_velocity": 20.0}, {}, 1e6, "unstable", ""),
    ],
)
def test_verdicts_follow_the_numbers(values, errors, contacts, kind, statistic):
    found = made(values, errors, contacts)
    assert found.kind == kind
    assert found.statistic == statistic or not statistic
    judged = len(JUDGED) - (3 if contacts < 1e3 else sum(error > 0.01 for error in errors.values()))
    assert found.judged == judged


@pytest.mark.parametrize("error", [0.5, np.nan])
def test_realizations_under_the_same_series_are_compared_one_by_one(error):
    """Each has 2 % more than in the reference; a few realizations have no standard error of their own."""
    each = np.linspace(0.8, 1.2, 16)[:, None]
    result = {name: xr.DataArray(np.ones(1), dims="oscillator") for name in JUDGED}
    for name in JUDGED:
        result[f"{name}_standard_error"] = xr.DataArray([error], dims="oscillator")
        result[f"{name}_by_realization"] = xr.DataArray(each, dims=("realization", "oscillator"))
    same = xr.Dataset(result, {"oscillator": ["a"]}, {"duration": 1e6, "realizations": 16})
    more = same.assign(contact_ratio_by_realization=same.contact_ratio_by_realization + 0.02)
    assert verdict(same, same).kind == "accurate"
    found = verdict(more, same)
    assert (found.kind, found.statistic, found.judged) == ("degraded", "contact_ratio of a", len(JUDGED))
    assert found.deviation == pytest.approx(0.02)


def test_nothing_known_is_no_verdict():
    assert made({}, dict.fromkeys(JUDGED, 0.5)).kind == "refused for its cost"


def test_a_small_run(run, explained):
    cells = run.tree["cells"].to_dataset()
    assert run.passed
    assert set(cells.noise.values) == {"white", "series"}
    default = cells.isel(cell=np.flatnonzero(cells.method.values == "ExactFlow"))
    columns = (default[name].values.tolist() for name in ("noise", "label", "value", "kind"))
    kinds = {(noise, label, value): kind for noise, label, value, kind in zip(*columns, strict=True)}
    assert kinds["white", "automatic", 1e4] == "accurate"
    assert kinds["series", "automatic", 1e4] == "accurate"
    assert kinds["white", "8", 1e4] == "refused"
    assert [noise for noise, label, value in kinds if (label, value) == ("0.25", 1e4)] == ["white"]  # or the reference
    refused = cells.reason.values[cells.kind.values == "refused"]
    assert all("too large" in reason or "unstable at any step" in reason for reason in refused)
    names = {f"stability_{method}_{noise}" for method in ("ExactFlow", "RungeKutta4", "EulerMaruyama")
             for noise in ("white", "series")}  # fmt: skip
    explained(run.study, run.figures, run.claims)
    assert set(run.figures) == names | {"stability_paper"}
    paper = run.tree["paper"].to_dataset()
    assert paper.kind.values[paper.frequency_ratio.values == 400.0] == "degraded"
    assert set(run.claims.verdict.values) <= {"holds", "does not hold", "not testable"}


def test_claims_and_checks_follow_the_numbers(run):
    tree = run.tree.copy()
    cells = tree["cells"].to_dataset()
    own = (cells.method.values == "ExactFlow") & (cells.label.values == "automatic") & (cells.noise.values == "white")
    tree["cells"] = xr.DataTree(cells.assign(kind=("cell", np.where(own, "degraded", cells.kind.values))))
    wild = tree["wild"].to_dataset()
    tree["wild"] = xr.DataTree(wild.assign(outcome=("scene", np.array([*wild.outcome.values[:-1], "hanging"]))))
    verdicts = StabilityStudy().claims(tree).verdict.values
    assert run.claims.verdict.values[[0, -1]].tolist() == ["holds", "holds"]
    assert verdicts[[0, -1]].tolist() == ["does not hold", "does not hold"]
    assert {item.name for item in StabilityStudy().checks(tree) if not item.ok} == {"automatic step", "wild scenes"}


# wild scenes


def test_wild_scenes_are_valid_and_differ():
    scenes = [wild_scene(seed) for seed in range(3)]
    assert all(isinstance(scene.network, il.Network) for scene in scenes)
    assert len({str(scene.network) for scene in scenes}) == 3
    assert wild_scene(1).network == scenes[1].network


def test_no_wild_scene_ends_without_a_word():
    """Two families of a thousand scenes."""
    seeds = [family + FAMILIES * turn for family in (1, 3) for turn in range(30)]
    outcomes = {seed: run_scene(wild_scene(seed)) for seed in seeds}
    assert {seed: outcome for seed, outcome in outcomes.items() if outcome.kind in BAD} == {}
    assert sum(outcome.kind in ("done", "warned") for outcome in outcomes.values()) >= 20


def test_a_scene_that_breaks_is_seen(monkeypatch):
    """What is looked for is found where it is put."""
    body = il.LinearOscillator(damping=0.5, stiffness=10.0)
    network = il.Network({"a": body, "b": body}, {"c": il.Contact("a", "b", il.HertzContact(1e3))},
                         {"a": il.WhiteNoise(1.0)})  # fmt: skip
    scene = wild_scene(1)._replace(network=network, options={"duration": 2000.0, "realizations": 64, "rng": 1})
    whole = il.simulate

    def with_nan(*args, **options):
        result = whole(*args, **options)
        result.mean_displacement[0] = np.nan
        return result

    def off(*args, **options):
        result = whole(*args, **options)
        result.balance_mean_displacement[:] = 6.0 * result.balance_mean_displacement_standard_error
        return result

    def failing(*args, **options):
        raise ZeroDivisionError("division by zero")

    kinds = {with_nan: "silent NaN", off: "unbalanced", failing: "crash", whole: "done"}
    for function, kind in kinds.items():
        monkeypatch.setattr(il, "simulate", function)
        found = run_scene(scene)
        assert isinstance(found, Outcome)
        assert found.kind == kind, found
