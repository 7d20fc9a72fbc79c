"""The warning of energy that wanders where nothing takes heat away."""

import warnings

import numpy as np
import pytest

import impactlab as il
from impactlab.errors import WORTH_SAYING

START = {"velocity": {"a": 1.0, "b": -0.5}}


def pair(law, damping=0.0):
    bodies = {
        "a": il.LinearOscillator(mass=1.0, stiffness=1.0, damping=damping),
        "b": il.LinearOscillator(mass=2.0, stiffness=3.0),
    }
    return il.Network(bodies, {"gap": il.Contact("a", "b", law)})


def quiet(network, duration, **options):
    """Simulate with warnings as errors."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return il.simulate(network, duration, initial=START, rng=1, **options)


def test_long_motion_without_friction_warns_and_names_a_step():
    network = pair(il.LinearContact(2.0))
    with pytest.warns(il.AccuracyWarning, match=r"Without friction .* step=") as caught:
        automatic = il.simulate(network, 2e4, initial=START, integrator=il.ExactFlow())
    step = float(str(caught[0].message).split("step=")[1].split()[0])
    assert step < automatic.attrs["step"]
    quiet(network, 2e4, step=step)


def test_the_energy_wanders_no_more_than_the_warning_says():
    network = pair(il.LinearContact(40.0))
    duration, samples = 2000.0, 400
    with pytest.warns(il.AccuracyWarning, match="or less") as caught:
        il.simulate(network, duration, initial=START, integrator=il.ExactFlow())
    step = float(str(caught[0].message).split("step=")[1].split()[0])
    interval = duration / samples
    step = interval / np.ceil(interval / step)
    paths = quiet(network, duration, step=step, record=il.Trajectory(interval)).isel(realization=0)
    mass, stiffness = np.array([1.0, 2.0]), np.array([1.0, 3.0])
    energy = (0.5 * mass * paths.velocity.values**2 + 0.5 * stiffness * paths.displacement.values**2).sum(axis=1)
    is_open = paths.contact_force.values[:, 0] == 0.0
    change = energy[is_open] / energy[0] - 1.0
    assert len(change) > 100
    assert np.sqrt((change**2).mean()) < WORTH_SAYING


@pytest.mark.full
@pytest.mark.parametrize(
    ("network", "duration"),
    [
        (pair(il.HertzContact(2.0)), 2.0),  # few contacts that begin softly
        (pair(il.LinearContact(2.0), damping=0.1), 1e4),  # friction
        (pair(il.LinearContact(2.0)).replace(contacts={"gap": None}), 1e4),  # none
    ],
)
def test_no_warning_where_the_energy_is_safe(network, duration):
    quiet(network, duration)
