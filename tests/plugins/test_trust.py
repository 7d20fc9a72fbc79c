"""The trust study: networks of all classes, references, verdicts that follow the numbers, and its small run."""

import json
import math

import numpy as np
import pytest
from impactlab_numerics import TrustStudy
from impactlab_numerics.trust import compound
from impactlab_numerics.trust.collect import found_of, tree_of
from impactlab_numerics.trust.drawing import Scene
from impactlab_numerics.trust.judge import OUTCOMES, compared, judge, outcome, reduced
from impactlab_numerics.trust.networks import CLASSES, class_of, scene_of
from impactlab_numerics.trust.path_means import PathMeans, path_statistics
from impactlab_numerics.trust.reference import Reference, reference_of, scale_of
from impactlab_numerics.trust.tables import class_rows, coverage, wrong_rows

import impactlab as il

pytestmark = pytest.mark.campaign


def test_the_quick_form_has_one_network_of_each_class():
    assert {class_of(seed) for seed in TrustStudy().quick().seeds} == set(CLASSES)


@pytest.mark.parametrize("seed", range(2 * len(CLASSES)))
def test_random_networks_are_the_same_again_and_can_be_drawn(seed):
    scene, again = scene_of(seed), scene_of(seed)
    assert scene.network == again.network
    assert scene.options == again.options
    assert 1 <= len(scene.network.oscillators) <= 16
    for body in scene.network.oscillators.values():
        assert 0.01 <= body.mass <= 100.0 or class_of(seed) == "heavy bases"
    assert 0.0 < scene.fine < scene.options["duration"]
    assert scene.deterministic == all(item.kind == "force" for item in scene.network.excitations.values())


@pytest.mark.parametrize("seed", range(2 * len(compound.CLASSES)))
def test_compound_scenes_are_right_at_default_settings(seed):
    found = judge(seed, compound.CLASSES, body_steps=2e7, share=0.25)
    assert found["outcome"] in ("right", "right, few data said"), found["messages"]
    assert found["rows"]


def test_networks_of_a_class_have_what_it_is_about():
    drawn = {name: [scene_of(index + len(CLASSES) * turn) for turn in range(12)] for index, name in enumerate(CLASSES)}
    kinds = {
        name: {type(item.law).__name__ for scene in scenes for item in scene.network.contacts.values()}
        for name, scenes in drawn.items()
    }
    assert kinds["rate-dependent contacts"] == {"KelvinVoigtContact", "HuntCrossleyContact"}
    assert kinds["home"] <= {"HertzContact", "LinearContact", "PowerLawContact"}
    ratios = {
        name: [body.damping_ratio for scene in scenes for body in scene.network.oscillators.values() if body.damping]
        for name, scenes in drawn.items()
    }
    assert max(ratios["weak damping"]) <= 0.01
    assert min(ratios["overdamped"]) >= 1.0
    assert max(ratios["overdamped"]) > 20.0
    assert {scene.options["realizations"] for scene in drawn["few realizations"]} <= set(range(1, 9))
    assert any("initial" in scene.options for scene in drawn["starts and short runs"])
    masses = [max(body.mass for body in scene.network.oscillators.values()) for scene in drawn["heavy bases"]]
    assert max(masses) > 1e3
    undamped = [sum(not body.damping for body in scene.network.oscillators.values())
                for scene in drawn["rows of undamped bodies"]]  # fmt: skip
    assert min(undamped) >= 3


def lone(**changes):
    """One body and a wall, under white noise at T = 1 J."""
    body = il.LinearOscillator(mass=1.0, damping=0.4, stiffness=4.0)
    contact = il.Contact("a", il.WALL, il.LinearContact(60.0), clearance=0.3)
    network = il.Network({"a": body}, {"wall": contact}, {"a": il.WhiteNoise(0.4 / math.pi)})
    return network.replace(**changes)


def test_means_of_the_path_are_those_of_a_trajectory():
    step = 0.02
    result = il.simulate(
        lone(), 20.0, realizations=70, step=step, record=[PathMeans(), il.Trajectory(step)], rng=1
    )  # fmt: skip
    path = path_statistics(result)
    x, v, force = (result[name].values for name in ("displacement", "velocity", "contact_force"))

    def mean(values):
        return np.trapezoid(values, dx=step, axis=1)[:, 0].mean() / 20.0

    assert path.mean_displacement.item() == pytest.approx(mean(x), rel=1e-9)
    assert path.variance_displacement.item() == pytest.approx(mean(x * x) - mean(x) ** 2, rel=1e-9)
    assert path.mean_square_velocity.item() == pytest.approx(mean(v * v), rel=1e-9)
    assert path.mean_contact_force.item() == pytest.approx(mean(force), rel=1e-9)
    closed = (x[:, :, 0] > 0.3).astype(float)
    assert path.contact_ratio.item() == pytest.approx(np.trapezoid(closed, dx=step, axis=1).mean() / 20.0, rel=1e-9)
    count = (np.diff(closed, axis=1) > 0.0).sum()
    seen = np.sqrt((np.diff(x, axis=1) ** 2).sum() / (v[:, 1:] ** 2).sum()) / step
    assert path.closings.item() * seen == pytest.approx(count)
    assert path.contact_rate.item() * seen == pytest.approx(count / 70 / 20.0)
    each = np.trapezoid(x[:, :, 0] ** 2, dx=step, axis=1) / 20.0
    error = each.std(ddof=1) / math.sqrt(70)
    assert path.mean_square_displacement_standard_error.item() == pytest.approx(error, rel=1e-9)


def test_closings_within_a_step_of_the_path_are_allowed_for():
    """At ``c h/m`` of 0.3 samples of the path show 5 % too few."""
    body = il.LinearOscillator(mass=1.0, damping=40.0, stiffness=4.0)
    contact = il.Contact("a", il.WALL, il.LinearContact(60.0), clearance=0.3)
    heavy = il.Network({"a": body}, {"wall": contact}, {"a": il.WhiteNoise(40.0 / math.pi)})
    result = il.simulate(heavy, 800.0, realizations=256, step=0.3 / 40.0, record=PathMeans(), rng=1)
    path, exact = path_statistics(result), il.exact(heavy).statistics().contact_rate.item()
    error = path.contact_rate_standard_error.item()
    assert error < 0.015 * exact
    assert abs(path.contact_rate.item() - exact) < 3.0 * error


def test_the_path_is_looked_at_at_every_step():
    far = lone(contacts={"wall": il.Contact("a", il.WALL, il.LinearContact(60.0), clearance=3.0)})
    with pytest.raises(il.InvalidInput, match="takes every step"):
        il.simulate(far, 40.0, realizations=70, record=PathMeans(), rng=1)
    every = il.simulate(far, 40.0, realizations=70, record=PathMeans(), integrator=il.ExactFlow(jumps=False), rng=1)
    assert path_statistics(every).mean_square_velocity.item() == pytest.approx(1.0, rel=0.05)


def test_references_agree_with_each_other():
    scene = Scene(lone(), {"duration": 100.0, "realizations": 512}, fine=0.01)
    exact = reference_of(scene, 0.08, 1, 1e8)
    fine = reference_of(scene._replace(transient=True), 0.08, 1, 1e8)
    assert (exact.kind, fine.kind, fine.step) == ("exact law", "fine step", pytest.approx(0.005))
    assert fine.doubts == ()
    for name, value in exact.values.items():
        assert abs(fine.values[name][0] - value[0]) < 4.0 * fine.errors[name][0] + 1e-3 * abs(value[0]), name


def test_the_path_without_noise_is_that_of_a_linear_body():
    network = lone(contacts=None, excitations={"a": il.Harmonic(3.0, frequency=2.0)})
    network = il.Network(network.oscillators, None, network.excitations)
    scene = Scene(network, {"duration": 20.0 * math.pi, "realizations": 1}, fine=0.02, deterministic=True)
    found = reference_of(scene, 0.1, 1, 1e8)
    assert found.kind == "path"
    square = 0.5 * (3.0 / (0.4 * 2.0)) ** 2  # at resonance
    assert found.values["mean_square_displacement"][0] == pytest.approx(square, rel=1e-4)
    assert found.values["mean_square_velocity"][0] == pytest.approx(4.0 * square, rel=1e-4)


def result_and_reference():
    scene = Scene(lone(), {"duration": 50.0, "realizations": 128}, fine=0.01)
    return scene, il.simulate(scene.network, rng=1, **scene.options), reference_of(scene, 0.08, 1, 1e8)


def test_a_value_that_is_off_is_found_and_what_is_said_of_it_counts():
    scene, result, law = result_and_reference()
    assert outcome(compared(scene, result, law), []) == "right"
    error = result.mean_square_velocity_standard_error.item()
    for factor, expected in ((0.95, "right"), (1.05, "silently wrong")):
        off = result.copy(deep=True)
        value = law.values["mean_square_velocity"][0]
        off["mean_square_velocity"][0] = value + factor * (5e-3 * value + 3.0 * error)
        rows = compared(scene, off, law)
        assert outcome(rows, []) == expected
    assert outcome(rows, ["the step may be too large: E[v²] is off by 3 %"]) == "warned rightly"
    few = "1 contact(s) closed fewer than 30 times in all, too seldom for standard errors"
    for row in rows:
        assert row["scarce"] == ("contact" in row["statistic"])
    assert outcome(rows, [few]) == "silently wrong"  # it is about a contact
    assert outcome([row | {"scarce": True} for row in rows], [few]) == "warned rightly"
    assert outcome([row | {"chance": True} for row in rows], []) == "right"
    right = compared(scene, result, law)
    assert outcome(right, [few]) == "right, few data said"
    assert outcome(right, ["the step may be too large"]) == "warned needlessly"
    off["contact_rate"][0] = math.nan
    assert outcome(compared(scene, off, law), []) == "silently wrong"
    off["mean_square_velocity_standard_error"][0] = math.nan
    names = {row["statistic"] for row in compared(scene, off, law)}
    assert "mean_square_velocity" not in names  # its error is said not to be known


def test_intervals_know_the_error_of_the_reference():
    scene, result, law = result_and_reference()
    error = result.contact_ratio_standard_error.item()
    value = law.values["contact_ratio"][0]
    result["contact_ratio"][0] = value + 2.5 * error
    errors = {name: np.zeros(1) for name in law.values}
    rows = {}
    for scatter in (0.0, error):
        known = Reference("fine step", law.values, errors | {"contact_ratio": np.array([scatter])})
        rows[scatter] = next(row for row in compared(scene, result, known) if row["statistic"] == "contact_ratio")
    assert rows[0.0]["z"] == pytest.approx(2.5)
    assert [row["held"] for row in rows.values()] == [False, True]


SMALL = (16, 17, 19, 21, 24, 25, 30, 31, 32)
"""Networks of the small campaign: conservative and lossy contacts, bases, temperatures, weak and strong damping."""


@pytest.mark.parametrize("seed", SMALL)
def test_the_small_campaign_is_right(seed):
    found = judge(seed, share=0.1, body_steps=2e7)
    assert found["outcome"] in ("right", "right, few data said"), wrong_rows([found], OUTCOMES)


def test_what_is_off_by_chance_is_told_from_what_is_wrong(monkeypatch):
    import impactlab_numerics.trust.judge as module

    seed = 0
    found = judge(seed, share=0.1)
    assert found["outcome"] == "right"
    simulate = il.simulate

    def shifted(always):
        def wrong(network, **options):
            result = simulate(network, **options)
            if options["rng"] == [seed, 1] or always:
                value, error = (result[f"mean_square_velocity{part}"] for part in ("", "_standard_error"))
                result["mean_square_velocity"] = value + 5e-3 * value + 4.0 * error
            return result

        return wrong

    monkeypatch.setattr(module.il, "simulate", shifted(False))
    once = judge(seed, share=0.1)
    assert [row["statistic"] for row in once["rows"] if row["chance"]] == ["mean_square_velocity"]
    assert once["outcome"] == "right"
    monkeypatch.setattr(module.il, "simulate", shifted(True))
    assert judge(seed, share=0.1)["outcome"] == "silently wrong"


def test_refusals_and_other_ends_are_outcomes(monkeypatch):
    import impactlab_numerics.trust.judge as module

    for error, expected in ((il.InvalidInput, "refused"), (il.Diverged, "diverged"), (ZeroDivisionError, "failed")):

        def fail(*_, error=error, **__):
            raise error("of this")

        monkeypatch.setattr(module.il, "simulate", fail)
        found = judge(3)
        assert found["outcome"] == expected
        assert "of this" in found["messages"][0]


def made(**changes):
    """A network that was judged."""
    row = {"statistic": "contact_ratio", "label": "c", "relative": 0.01, "relative_error": 0.01, "excess": 0.3,
           "z": 1.0, "held": True, "chance": False, "scarce": True}  # fmt: skip
    found = {"seed": 0, "class": "home", "outcome": "right", "messages": [], "kind": "exact law", "rows": []}
    found |= {name: value for name, value in changes.items() if name in found}
    rows = changes.get("held", [True] * 19 + [False])
    return found | {"rows": [row | {"held": held, "excess": changes.get("excess", 0.3)} for held in rows]}


def verdicts(found):
    return TrustStudy().claims(tree_of(found)).verdict.values.tolist()


def test_verdicts_follow_the_numbers():
    many = [made(seed=seed) for seed in range(100)]
    assert verdicts(many) == ["holds"] * 5
    assert verdicts([*many[1:], made(outcome="silently wrong", excess=5.0)])[0] == "does not hold"
    warned = [made(seed=seed, outcome="warned needlessly") for seed in range(6)]
    assert verdicts(many[5:] + warned[:5])[1] == "holds"
    assert verdicts(many[6:] + warned)[1] == "does not hold"
    short = [made(seed=seed, held=[True] * 8 + [False] * 2) for seed in range(100)]
    assert verdicts(short)[2:4] == ["does not hold"] * 2
    uneven = [made(seed=seed, held=[seed % 3 > 0] * 10) for seed in range(90, 100)]
    mixed = many[:90] + [item | {"class": "other"} for item in uneven]
    assert verdicts(mixed)[2:4] == ["holds", "sampling error"]
    assert verdicts([item | {"outcome": "not judged"} for item in many[:6]] + many[6:])[4] == "does not hold"


def test_intervals_of_one_network_are_no_independent_cases():
    """Networks that hold all of their intervals or none, in the mean 95 %, scatter as so many single intervals."""
    rng = np.random.default_rng(5)
    holds = rng.random(400) < 0.95
    together = coverage([made(seed=seed, held=[bool(held)] * 10) for seed, held in enumerate(holds)])
    assert together.share == holds.mean()
    assert together.error == pytest.approx(holds.std() / 20.0, rel=0.01)
    apart = coverage([made(seed=seed, held=[bool(held)]) for seed, held in enumerate(holds)])
    assert apart.error == pytest.approx(together.error, rel=0.1)
    one = coverage([made(held=[True] * 10)])
    assert one.share == 1.0
    assert one.error > 0.2


def test_a_tree_holds_everything_that_was_found():
    found = [made(seed=3, messages=["one", "two"]), made(seed=5, held=[None, False], outcome="refused")]
    again = found_of(tree_of(found))
    assert [{name: item[name] for name in made()} for item in again] == found
    assert coverage(again)[::2] == (19 / 21, 21)
    assert len(list(TrustStudy().figures(tree_of(found)))) == 3
    assert dict(TrustStudy().tables(tree_of(found))).keys() == {"Networks by class", "Warned or refused without need"}
    assert "refused" in str(class_rows(again))
    assert [row["seed"] for row in wrong_rows(again)] == [5]


def test_a_run_that_was_stopped_continues(tmp_path):
    file = tmp_path / "judged.jsonl"
    study = TrustStudy().quick().replace(networks=2, first_network=12, kept_in=str(file))
    tree = study.collect({})
    first, second = file.read_text(encoding="utf-8").splitlines()
    changed = json.loads(first) | {"outcome": "refused"}
    file.write_text(json.dumps(changed) + "\n" + second[:50], encoding="utf-8")
    outcomes = study.collect({})["networks"].outcome.values
    assert outcomes.tolist() == ["refused", tree["networks"].outcome.values[1]]
    assert len(file.read_text(encoding="utf-8").splitlines()) == 2
    file.write_text("something\n", encoding="utf-8")
    with pytest.raises(il.InvalidInput, match="does not hold networks that were judged"):
        study.collect({})


def test_realizations_are_not_fewer_than_errors_need():
    scene = scene_of(0)
    most = scene.options["realizations"]
    assert reduced(scene, 0.5).options["realizations"] == most // 2
    assert reduced(scene, 0.01).options["realizations"] == 64
    few = next(scene_of(seed) for seed in range(12, 400, 16))
    assert reduced(few, 0.1).options == few.options


def test_a_body_that_rests_is_measured_by_what_moves():
    values = {"mean_square_displacement": np.array([38.0, 0.1]), "variance_displacement": np.array([1e-13, 0.1])}
    np.testing.assert_allclose(scale_of("variance_displacement", values), [3.8e-8, 0.1])
    np.testing.assert_allclose(scale_of("mean_displacement", values), np.sqrt([38.0, 0.1]))


def test_rows_at_one_temperature_have_an_exact_law():
    scenes = [scene_of(seed) for seed in range(10, 400, 16)]
    equal = [scene for scene in scenes if scene.equivalent is not None]
    assert 5 < len(equal) < len(scenes)
    for scene in equal:
        temperatures = {
            round(math.pi * noise.spectral_density / network.oscillators[name].damping, 9)
            for network in (scene.network, scene.equivalent)
            for name, noise in network.excitations.items()
        }
        assert len(temperatures) == 1
        assert scene.equivalent.contacts == scene.network.contacts
