"""Runs of `simulate` that go on from the end of an earlier one: realizations continue, or new ones branch off."""

import numpy as np
import pytest

import impactlab as il
from tests.simulation.test_held_run import EACH, NETWORKS

pytestmark = [
    pytest.mark.filterwarnings("ignore:Too few independent samples"),
    pytest.mark.filterwarnings("ignore:.*closed fewer than"),
]

END = il.FinalState(continues=True)
PATH = il.Trajectory(0.05)


def stop(law=None, force=0.7, **more):
    """A body at a stop under a harmonic force."""
    return il.Network(
        {"a": il.LinearOscillator(damping=0.1, stiffness=1.0)},
        {"g": il.Contact("a", il.WALL, law or il.KelvinVoigtContact(60.0, damping=0.5), clearance=0.2)},
        {"a": il.Harmonic(force, frequency=0.8)},
        **more,
    )


class Swept(il.Excitation):
    """A sine whose frequency grows."""

    rate: float = il.parameter(0.0, units="s-2")

    @staticmethod
    def force(time, rate):
        return 0.6 * np.sin(0.7 * time + rate * time * time)


@pytest.mark.parametrize("name", EACH)
def test_steps_continue_bit_for_bit(name, tmp_path):
    """Three parts, with a spin-up before the first: paths, impacts and ends are those of one run."""
    network, options = NETWORKS[name], {"realizations": 3, "rng": 3, "initial": "rest", "step": 0.01, "spin_up": 0.13}
    told = network.contacts and name != "rigid contact"
    record = [PATH, END, il.Impacts()] if told else [PATH, END]
    whole = il.simulate(network, 3.0, record=record, **options)
    first = il.simulate(network, 1.0, record=record, out=tmp_path / "first.nc", **options)
    second = il.simulate(network, 1.5, initial=tmp_path / "first.nc", continues=True, record=record)
    third = il.simulate(network, 0.5, initial=second, continues=True, record=record, out=tmp_path / "third.nc")
    assert (second.attrs["begin"], second.attrs["duration"]) == (1.0, 1.5)
    assert third.attrs["begin"] == 2.5
    for part in (first, second, third):
        for item in ("displacement", "velocity"):
            np.testing.assert_array_equal(part[item], whole[item].sel(time=part["time"]))
    for item in (name for name in whole if name.startswith(("final_", "continuation"))):
        np.testing.assert_array_equal(third[item], whole[item])
    if "impact_time" in whole:
        begun = np.concatenate([part["impact_time"][part["impact_flag"] % 2 == 0] for part in (first, second, third)])
        assert np.isin(begun, whole["impact_time"]).all()


def test_statistics_are_those_of_the_second_part():
    network, options = NETWORKS["white noise"], {"realizations": 4, "rng": 3, "initial": "rest", "step": 0.01}
    one = il.simulate(network, 2.0, record=[END], **options)
    other = il.simulate(network, 3.0, initial=one, continues=True, record=il.PerRealization())
    with il.Run(network, initial=one, continues=True) as run:
        run.advance(3.0)
        held = run.statistics()
    for name in ("mean_square_displacement", "mean_square_velocity", "contact_ratio", "mean_contact_force"):
        np.testing.assert_allclose(other[name], held[name], rtol=1e-13, err_msg=name)  # by batches of other lengths
    assert other.sizes["realization"] == 4
    path = il.simulate(network, 5.0, record=il.Trajectory(0.01), **options)["displacement"].sel(time=slice(2.0, 5.0))
    means = other["mean_displacement_by_realization"].values
    np.testing.assert_allclose(np.trapezoid(path, dx=0.01, axis=1) / 3.0, means, rtol=2e-2)


def test_branches_have_new_noise_and_the_same_start():
    network = NETWORKS["white noise"]
    trunk = il.simulate(network, 2.0, realizations=2, rng=3, initial="rest", step=0.01, record=END)
    data = il.simulate(network, 1.0, initial=trunk, branch=3, record=[PATH, END])
    assert data["realization"].values.tolist() == [2, 3, 4, 5, 6, 7]
    assert data["time"].values[[0, -1]] == pytest.approx([2.0, 3.0])
    begin = data["displacement"].isel(time=0, oscillator=0).values
    np.testing.assert_array_equal(begin, np.repeat(trunk["final_displacement"].values[:, 0], 3))
    ends = data["final_displacement"].values[:, 0]
    assert len(set(ends)) == 6
    straight = il.simulate(network, 1.0, initial=trunk, continues=True, record=END)["final_displacement"].values[:, 0]
    assert not set(straight) & set(ends)
    with il.Run(network, initial=trunk, continues=True) as run:  # which gives them the same numbers
        run.branch([0, 0, 0, 1, 1, 1])
        run.advance(1.0)
        np.testing.assert_array_equal(run.state["final_displacement"].values[2:, 0], ends)
    again = il.simulate(network, 1.0, initial=data, branch=1)
    assert again.attrs["begin"] == 3.0
    on = il.simulate(network, 0.5, initial=data, continues=True, record=END)
    longer = il.simulate(network, 1.5, initial=trunk, branch=3, record=END)
    np.testing.assert_array_equal(on["final_velocity"], longer["final_velocity"])


def rows_of_impacts(part, **chosen):
    """Times, durations and impulses of the impacts that begin and end in a run, in the order of their begin."""
    return np.stack([part[f"impact_{name}"].values for name in ("time", "duration", "impulse")])


LOCATED = {
    "soft": stop(),
    "rigid": stop(il.RigidContact(restitution=0.6)),
    "resting": stop(il.RigidContact(restitution=0.2), force=2.0),
    "given force": stop().replace(excitations={"a": Swept(0.02)}),
    "friction": stop(
        couplings={"f": il.Coupling("a", il.WALL, il.CoulombFrictionCoupling(0.1)),
                   "j": il.Coupling("a", il.WALL, il.JenkinsCoupling(5.0, slip_force=0.3))},
    ),
    "Hertz": stop(il.HertzContact(200.0)),
    "Bouc-Wen": stop(
        il.HuntCrossleyContact(100.0, dissipation=0.3),
        couplings={"b": il.Coupling("a", il.WALL, il.BoucWenCoupling(2.0, yield_displacement=0.1))},
    ),
}  # fmt: skip


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.full] if name == "Bouc-Wen" else []) for name in LOCATED]
)
@pytest.mark.parametrize("cut", [7.5, 20.0])
def test_located_events_continue(name, cut, tmp_path):
    """Paths, events and forces are those of one run within its error; an impact at the cut is told as a whole."""
    record = [il.Trajectory(0.5), END, il.Impacts()]
    options = {"initial": "rest", "record": record}
    if name == "Bouc-Wen":  # which takes longer than steps
        options["integrator"] = il.EventLocated()
    whole = il.simulate(LOCATED[name], 30.0, **options)
    assert whole.attrs["integrator"] == "EventLocated"
    first = il.simulate(LOCATED[name], cut, **options, out=tmp_path / "first.nc")
    second = il.simulate(LOCATED[name], 30.0 - cut, initial=tmp_path / "first.nc", continues=True, record=record)
    assert second.attrs["integrator"] == "EventLocated"
    assert second.attrs["begin"] == cut
    error = 3.0 * (whole.attrs["path_error"] + second.attrs["path_error"]) + 1e-14
    for part in (first, second):
        expected = whole["displacement"].sel(time=part["time"])
        np.testing.assert_allclose(part["displacement"], expected, rtol=0.0, atol=error)
    np.testing.assert_allclose(second["final_velocity"], whole["final_velocity"], atol=100.0 * error)
    parts = [first["impact_time"][first["impact_flag"] < 4], second["impact_time"]]
    found = np.concatenate(parts)
    np.testing.assert_allclose(np.sort(found), np.sort(whole["impact_time"]), atol=100.0 * error)
    lasted = [first["impact_duration"][first["impact_flag"] < 4], second["impact_duration"]]
    np.testing.assert_allclose(
        np.concatenate(lasted)[np.argsort(found)], whole["impact_duration"][np.argsort(whole["impact_time"])],
        atol=1e3 * error,
    )  # fmt: skip
    for name in ("mean_displacement", "contact_ratio", "mean_contact_force", "mean_square_velocity"):
        joined = (cut * first[name] + (30.0 - cut) * second[name]) / 30.0
        np.testing.assert_allclose(joined, whole[name], rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("surface", [il.Strobe(2.0, start=0.5), il.AtContact("g")])
def test_sections_go_on(surface):
    """Also where the second part begins between two looks."""
    record = [il.Section(surface), END]
    whole = il.simulate(LOCATED["rigid"], 30.0, initial="rest", record=record)
    first = il.simulate(LOCATED["rigid"], 13.0, initial="rest", record=record)
    second = il.simulate(LOCATED["rigid"], 17.0, initial=first, continues=True, record=record)
    for name, error in (("section_time", 1e-10), ("section_displacement", 1e-10), ("section_velocity", 1e-9)):
        found = np.concatenate([first[name][0], second[name][0]])
        np.testing.assert_allclose(found, whole[name][0], atol=error)


def test_given_motions_go_on_in_time():
    """A moving table, whose means are those of its motion in the second part."""
    network = il.Network(
        {
            "a": il.LinearOscillator(damping=0.2, stiffness=1.0),
            "table": il.PrescribedMotion(il.Harmonic(0.3, frequency=1.1)),
        },
        {"g": il.Contact("table", "a", il.LinearContact(50.0), clearance=0.1)},
    )  # fmt: skip
    first = il.simulate(network, 3.0, initial="rest", record=END)
    second = il.simulate(network, 4.0, initial=first, continues=True, record=END)
    whole = il.simulate(network, 7.0, initial="rest", record=END)
    for name in ("mean_displacement", "mean_square_velocity"):
        np.testing.assert_allclose((3.0 * first[name] + 4.0 * second[name]) / 7.0, whole[name], rtol=1e-12)
    np.testing.assert_allclose(second["final_displacement"], whole["final_displacement"], atol=1e-13)


def test_bad_input_has_one_clear_error():
    network, noisy = stop(), NETWORKS["white noise"]
    result = il.simulate(network, 5.0, record=END, initial="rest")
    noise = il.simulate(noisy, 1.0, rng=1, step=0.01, record=END, realizations=2, initial="rest")
    plain = il.simulate(network, 5.0, record=il.FinalState(), initial="rest")
    on = {"initial": result, "continues": True}
    changed = result.assign(final_velocity=result["final_velocity"] + 1.0)
    shorter = result.isel(number=slice(-1))
    for words, bad in {
        "from a result with il.FinalState": lambda: il.simulate(network, 1.0, initial=plain, continues=True),
        "one as initial=": lambda: il.simulate(network, 1.0, continues=True),
        "another network": lambda: il.simulate(stop(force=0.5), 1.0, **on),
        "leave out integrator=": lambda: il.simulate(network, 1.0, **on, integrator=il.ExactFlow()),
        "leave out realizations=": lambda: il.simulate(network, 1.0, **on, realizations=2),
        "leave out rng=": lambda: il.simulate(network, 1.0, **on, rng=1),
        "leave out step=": lambda: il.simulate(network, 1.0, **on, step=0.1),
        "leave out tolerance=": lambda: il.simulate(network, 1.0, **on, tolerance={"contact_ratio": 0.1}),
        "needs a duration": lambda: il.simulate(network, **on),
        "not both": lambda: il.simulate(network, 1.0, **on, branch=2),
        "from 1 on, not 0": lambda: il.simulate(network, 1.0, initial=result, branch=0),
        "branches would all be alike": lambda: il.simulate(network, 1.0, initial=result, branch=2),
        "This state was changed": lambda: il.simulate(network, 1.0, initial=changed, continues=True),
        "another version": lambda: il.simulate(network, 1.0, initial=shorter, continues=True),
        "a held run makes steps": lambda: il.Run(network, **on),
        "rerun that one": lambda: il.rerun(il.simulate(network, 1.0, **on)),
        "not a whole number of periods": lambda: il.simulate(
            noisy, 1.0, initial=noise, continues=True, record=il.PhaseMeans(period=0.32)
        ),
        "did not all begin at once": lambda: il.simulate(
            noisy, 1.0, initial=noise.isel(realization=[1, 0]), continues=True
        ),
        "This state was changed;": lambda: il.simulate(
            noisy, 1.0, initial=noise.assign(final_velocity=2.0 * noise["final_velocity"]), continues=True
        ),
    }.items():
        with pytest.raises(il.InvalidInput, match=words) as told:
            bad()
        assert "\n" not in str(told.value)


@pytest.mark.full
def test_sums_of_cosines_cannot_go_on():
    network = il.Network(
        {"a": il.LinearOscillator(damping=1.0, stiffness=4.0)},
        excitations={"a": il.ShinozukaNoise(1.0, band=(0.0, 2.0), components=400)},
    )
    data = il.simulate(network, 5.0, rng=1, step=0.05, record=END)
    with pytest.raises(il.InvalidInput, match="Sums of cosines were sampled for the earlier run only"):
        il.simulate(network, 5.0, initial=data, continues=True)
