"""The conservation study: its small run, energies by hand, and verdicts that follow the numbers."""

import numpy as np
import pytest
import xarray as xr
from impactlab_numerics import ConservationStudy
from impactlab_numerics.conservation.claims import over_contacts
from impactlab_numerics.conservation.collect import energies, kink
from impactlab_numerics.conservation.scenes import SCENES, bounces, free_chain, pair, side_by_side, starts

import impactlab as il

pytestmark = pytest.mark.campaign

STUDY = ConservationStudy


def test_copies_are_apart_and_start_differently():
    network = side_by_side(pair(il.HertzContact(1.5)), 3)
    assert list(network.oscillators) == ["a_0", "b_0", "a_1", "b_1", "a_2", "b_2"]
    assert [(item.first, item.second) for item in network.contacts.values()] == [
        ("a_0", "b_0"), ("a_1", "b_1"), ("a_2", "b_2"),
    ]  # fmt: skip
    velocities = starts(pair(il.HertzContact(1.5)), 3, 1.0, 1)["velocity"]
    assert set(velocities) == set(network.oscillators)
    assert len(set(velocities.values())) == 6
    walled = side_by_side(SCENES["chain, Hertz"].make(), 2)
    assert sum(il.WALL in (item.first, item.second) for item in walled.contacts.values()) == 4
    assert not any(body.damping for body in free_chain().oscillators.values())


def test_energies_by_hand():
    network = side_by_side(pair(il.HertzContact(2.0)), 2)
    x = np.array([[[0.5, 0.25, 0.1, 0.3]]])
    v = np.array([[[1.0, -2.0, 0.0, 0.5]]])
    force = np.array([[[2.0 * 0.25**1.5, 0.0]]])
    dims = ("realization", "time", "oscillator")
    dataset = xr.Dataset(
        {
            "displacement": (dims, x),
            "velocity": (dims, v),
            "contact_force": (("realization", "time", "contact"), force),
        }
    )
    energy, is_open = energies(network, dataset, 2)
    first = 0.5 * 1.0 + 0.5 * 2.0 * 4.0 + 0.5 * 0.25 + 0.5 * 3.0 * 0.0625 + 0.4 * 2.0 * 0.25**2.5
    second = 0.5 * 2.0 * 0.25 + 0.5 * 0.01 + 0.5 * 3.0 * 0.09
    np.testing.assert_allclose(energy, [[first, second]], rtol=1e-15)
    assert is_open.tolist() == [[False, True]]


def test_the_small_run_finds_what_theory_says(run):
    assert set(run.claims.verdict.values.tolist()) == {"holds"}
    energy = run.tree["energy"].to_dataset()
    # the error of a kink is of the order p + 1 and its sign changes from contact to contact
    for name, power in (("chain, Hertz", 2.5), ("chain, linear", 2.0)):
        _, of_step, of_n = over_contacts(energy.sel(scene=name))
        assert of_step == pytest.approx(power, abs=0.4)
        assert of_n == pytest.approx(0.5, abs=0.2)
    pressed = energy.sel(scene="pressed chain, Hertz")
    swing = pressed.swing.mean("window").values
    assert (swing[:-1] / swing[1:] > 5.0).all()  # of the smooth path it is of more than second order
    reversal = run.tree["reversal"].to_dataset()
    assert (reversal.error.values[0, :2] < 1e-12).all()
    growth = reversal.error.values[:, -1] / reversal.error.values[:, 0]
    assert growth[1] > 10.0 * growth[0]  # the chain is chaotic
    assert float(np.abs(run.tree["momentum"].error).max()) < 1e-13


def test_figures_and_tables_are_made(run, explained):
    explained(run.study, run.figures, run.claims)
    assert set(run.figures) == {"energy", "reversal", "order"}
    tables = dict(run.study.tables(run.tree))
    assert [row["integrator"] for row in tables["Observed orders"]] == ["ExactFlow", "RungeKutta4", "EulerMaruyama"]
    assert len(tables["Energy at the end of each run"]) == 3 * len(SCENES)


def verdict_of(tree, words):
    table = ConservationStudy().claims(tree)
    found = [v for s, v in zip(table.statement.values, table.verdict.values, strict=True) if words in str(s)]
    assert len(found) == 1
    return found[0]


@pytest.mark.parametrize(
    ("group", "variable", "change", "words"),
    [
        ("energy", "error", lambda item: item + 0.01 * (item.scene == "pressed chain, Hertz"), "pressed chain"),
        ("energy", "error", lambda item: item.isel(halving=0).broadcast_like(item), "chain, linear: where"),
        ("bounce", "change", lambda item: 1.4 * item, "Hertz contact"),
        ("reversal", "largest", lambda item: item + 1e-6, "comes back"),
        ("momentum", "error", lambda item: item + 1e-10 * item.time, "momentum"),
        ("order", "order", lambda item: item - 0.5, "RungeKutta4 has order 2.5"),
    ],
)
def test_verdicts_see_what_does_not_hold(run, group, variable, change, words):
    tree = run.tree.copy(deep=True)
    table = tree[group].to_dataset()
    tree[group] = xr.DataTree(table.assign({variable: change(table[variable]).transpose(*table[variable].dims)}))
    assert verdict_of(run.tree, words) == "holds"
    assert verdict_of(tree, words) == "does not hold"


def test_one_contact_by_hand():
    # for a linear contact ζ(−1, a) = −B₂(a)/2, of which the mean square is 1/720
    assert kink(1.0, np.array(150.0), 0.01) == pytest.approx(2.0 * 225.0 * 1e-4 * np.sqrt(2.0 / 720.0), rel=1e-12)
    network, initial, frequency = bounces("linear", 5, 1)
    assert frequency == pytest.approx(np.sqrt(100.0 / (2.0 / 3.0)))
    assert len(network.contacts) == 5
    assert all(-0.6 <= place <= -0.3 for place in initial["displacement"].values())
