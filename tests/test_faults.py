"""What goes wrong inside a run is said, never averaged away; what cannot go wrong does not."""

import math
import os

import numpy as np
import pytest
from scenes import base, linear

import impactlab as il


class Explosive(il.Excitation):
    start: float = il.parameter(units="s")

    @staticmethod
    def force(time, start):
        return math.nan if time > start else 0.0


class Driving(il.ContactLaw):
    """Pushes along with the motion: no step is small enough, and no plan can know."""

    @staticmethod
    def force(indentation, rate):
        return 100.0 * indentation - 1e6 * rate


class Late(il.Excitation):
    """White noise whose density is no number from some time on."""

    end: float = il.parameter(units="s")

    @staticmethod
    def intensity(time, end):
        return math.sqrt(end - time) if time < end else math.nan


def test_a_force_that_is_not_a_number():
    network = linear().replace(excitations={"a": Explosive(2.0)})
    with pytest.raises(il.Diverged, match=r"'a' of realization 0 left .* at t = "):
        il.simulate(network, 4.0, rng=1, step=0.01)


@pytest.mark.full
def test_a_contact_that_drives_names_the_realization_and_the_time():
    network = linear().replace(contacts={"w": il.Contact("a", il.WALL, Driving(), clearance=0.01)})
    with pytest.raises(il.Diverged, match=r"realization \d+ left .* at t = -?\d.*smaller step"):
        il.simulate(network, 20.0, realizations=64, rng=1, step=0.05)


def test_the_time_of_divergence_is_near():
    """A negative spring beside a wall: x grows as exp(t √κ) from x = 1 at t = 0."""

    class Negative(il.Oscillator):
        softness: float = il.parameter(units="N m-1")

        @staticmethod
        def residual(displacement, softness):
            return -softness * displacement

    network = il.Network({"a": Negative(100.0)})
    with pytest.raises(il.Diverged) as caught:
        il.simulate(network, 100.0, step=0.01, initial={"displacement": {"a": 1.0}})
    time = float(str(caught.value).split("at t = ")[1].split(" s")[0])
    assert time == pytest.approx(math.log(1e100 / 5.0) / 10.0, rel=0.01)  # of a velocity of 1e100 m/s


def test_a_density_that_is_not_a_number():
    network = linear().replace(excitations={"a": Late(1.0)})
    with pytest.raises(il.Diverged, match=r"negative or NaN near t = 1\.00\d* s"):
        il.simulate(network, 3.0, realizations=64, rng=1, initial="rest", spin_up=0.0, step=0.01)


def test_a_density_that_ends_with_the_run():
    """No time after the end is asked for."""
    network = linear().replace(excitations={"a": Late(1.0)})
    ds = il.simulate(network, 1.0, realizations=64, rng=1, initial="rest", spin_up=0.0, step=0.01)
    assert float(ds.mean_square_velocity[0]) > 0.0


@pytest.mark.parametrize("scale", [1e-9, 1e9])
def test_units_of_any_size_give_the_same_physics(scale):
    """Lengths times a factor, at equal masses and times: all dimensionless numbers stay."""

    def scaled(s):
        return base().replace(
            contacts={"gap": il.Contact("one", "two", il.HertzContact(1e4 * s**-0.5), clearance=0.05 * s)},
            excitations={"one": il.WhiteNoise(16.0 * s**2), "two": il.WhiteNoise(s**2)},
        )

    first, second = (il.simulate(scaled(s), 2.0, realizations=64, rng=1) for s in (1.0, scale))
    assert second.attrs["step"] == pytest.approx(first.attrs["step"], rel=1e-6)
    np.testing.assert_allclose(second.contact_ratio, first.contact_ratio, rtol=1e-6)
    np.testing.assert_allclose(
        second.direct_mean_square_displacement, scale**2 * first.direct_mean_square_displacement, rtol=1e-6
    )
    np.testing.assert_allclose(second.direct_mean_contact_force, scale * first.direct_mean_contact_force, rtol=1e-6)


def test_a_mirrored_network_has_the_mirrored_statistics():
    """The contact from the other side, with all displacements reversed: laws, not paths, agree."""
    mirrored = base().replace(
        contacts={"gap": il.Contact("two", "one", il.HertzContact(1e4), clearance=0.05)},
    )
    ds = il.simulate(base(), 60.0, realizations=256, rng=1)
    other = il.simulate(mirrored, 60.0, realizations=256, rng=2)
    for name, sign in (("mean_displacement", -1.0), ("mean_square_displacement", 1.0), ("mean_contact_force", 1.0)):
        error = np.hypot(ds[f"{name}_standard_error"], other[f"{name}_standard_error"])
        assert float((abs(ds[name] - sign * other[name]) / error).max()) < 3.5, name


def test_the_order_of_names_does_not_matter():
    network = base()
    turned = il.Network(
        dict(reversed(network.oscillators.items())), network.contacts, dict(reversed(network.excitations.items()))
    )
    options = {"realizations": 64, "rng": 1}
    first, second = il.simulate(network, 5.0, **options), il.simulate(turned, 5.0, **options)
    for name in ("direct_mean_square_displacement", "direct_mean_displacement"):
        np.testing.assert_array_equal(first[name], second[name].sel(oscillator=first.oscillator))


def test_contacts_that_never_close_change_nothing():
    far = base(clearance=100.0)
    farther = far.replace(contacts={"gap": il.Contact("one", "two", il.LinearContact(7.0), clearance=200.0)})
    options = {"realizations": 64, "rng": 1, "step": 4e-3}
    first, second = il.simulate(far, 5.0, **options), il.simulate(farther, 5.0, **options)
    np.testing.assert_array_equal(first.direct_mean_square_displacement, second.direct_mean_square_displacement)
    assert (first.contact_ratio == 0.0).all()
    assert (first.peak_contact_force == 0.0).all()


def test_a_contact_that_never_closes_keeps_the_linear_law():
    """Friction and noise act at one moment of the step there; that has no error either."""
    body = il.LinearOscillator.from_frequency(2.0, 0.02)
    network = il.Network(
        {"a": body}, {"w": il.Contact("a", il.WALL, il.LinearContact(1.0), clearance=1e3)}, {"a": il.WhiteNoise(1.0)}
    )
    ds = il.simulate(network, 2000.0, realizations=256, step=0.4, rng=1)
    law = {"velocity": np.pi / body.damping, "displacement": np.pi / body.damping / body.stiffness}
    for quantity, expected in law.items():
        name = f"mean_square_{quantity}"
        assert abs(ds[name][0] / expected - 1.0) < 3.5 * ds[f"{name}_standard_error"][0] / expected
        assert ds[f"{name}_standard_error"][0] < 1e-3 * expected


@pytest.mark.full
def test_a_failed_run_leaves_the_next_one_alone():
    network = linear().replace(contacts={"w": il.Contact("a", il.WALL, Driving(), clearance=0.01)})
    before = il.simulate(base(), 1.0, realizations=64, rng=1)
    with pytest.raises(il.Diverged):
        il.simulate(network, 20.0, realizations=64, rng=1, step=0.05)
    after = il.simulate(base(), 1.0, realizations=64, rng=1)
    np.testing.assert_array_equal(before.mean_square_displacement, after.mean_square_displacement)


def test_nothing_is_written_to_the_working_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    il.simulate(base(), 1.0, realizations=64, rng=1)
    assert os.listdir(tmp_path) == []
