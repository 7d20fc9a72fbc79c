"""Noises whose coherence depends on distance and frequency, against the formula of their cross-spectral density."""

import numpy as np
import pytest
from scenes import BUILDINGS, covariances_of_buildings, matrices_of_buildings
from scipy.integrate import quad

import impactlab as il

PLACES = {"a": 0.0, "b": 3.0, "c": 7.0}
LINES = 64
PERIOD = 16.0 * np.pi
NOISE = il.TabulatedNoise([0.0, 2.0, 8.0], [0.2, 0.5, 0.1], components=LINES)
SPEED = 20.0
GUSTS = il.davenport(8.0, 10.0)
BODY = il.LinearOscillator(mass=1.0, damping=0.6, stiffness=9.0)


def coherence(frequency, distance):
    """Davenport's, written once more."""
    return np.exp(-8.0 * frequency * distance / (2.0 * np.pi * 10.0))


def blowing(places=PLACES, **options):
    return il.coherent(NOISE, places, GUSTS, wave_speed=SPEED, **options)


def network(noise=NOISE):
    return il.Network(dict.fromkeys(PLACES, BODY), None, il.coherent(noise, PLACES, GUSTS, wave_speed=SPEED))


def test_sources_have_the_cross_spectral_density_of_the_formula():
    frequencies, amplitudes = NOISE.lines()
    on = {body: {} for body in PLACES}
    for source in blowing().values():
        (body,) = source.on
        on[body][source.excitation.phases] = source.excitation.lines()[1]
    for one, here in PLACES.items():
        for other, there in PLACES.items():
            both = on[one].keys() & on[other].keys()
            found = sum(on[one][phases] * on[other][phases].conj() for phases in both)
            passing = np.exp(-1j * frequencies * (here - there) / SPEED)
            expected = amplitudes**2 * coherence(frequencies, abs(here - there)) * passing
            np.testing.assert_allclose(found, expected, atol=1e-8 * amplitudes.max() ** 2)


def test_the_exact_covariance_is_the_integral_of_the_cross_spectral_density():
    fine = il.TabulatedNoise(NOISE.frequencies, NOISE.densities, components=8000)
    law = il.exact(network(fine))

    def density(w):
        receptance = 1.0 / ((9.0 - w**2) ** 2 + (0.6 * w) ** 2)
        passing = np.cos(4.0 * w / SPEED)
        return 2.0 * np.interp(w, NOISE.frequencies, NOISE.densities) * coherence(w, 4.0) * passing * receptance

    expected = quad(density, 0.0, 8.0, points=[2.0, 3.0], limit=200)[0]
    assert law.covariance("b", "c", "displacement") == pytest.approx(expected, rel=2e-3)
    assert law.covariance("c", "b", "displacement") == pytest.approx(expected, rel=2e-3)


def test_samples_have_the_cross_spectra_of_the_formula():
    """By Fourier coefficients over one period, line by line, in standard errors of independent realizations."""
    result = il.simulate(
        network(), PERIOD, realizations=400, rng=1, spin_up=0.0, step=PERIOD / 512,
        record=il.Trajectory(interval=PERIOD / 512),
    )  # fmt: skip
    x = result.displacement.transpose("realization", "oscillator", "time").values[..., -512:]
    time = result.time.values[-512:]
    frequencies, amplitudes = NOISE.lines()
    chosen = slice(8, 48)
    waves = np.exp(-1j * np.outer(frequencies[chosen], time)) / 256.0
    receptance = 1.0 / (9.0 - frequencies[chosen] ** 2 + 0.6j * frequencies[chosen])
    force = np.einsum("rot,ft->rof", x, waves) / (receptance * amplitudes[chosen])
    for first, second in ((0, 1), (1, 2), (0, 2), (1, 1)):
        apart = list(PLACES.values())[first] - list(PLACES.values())[second]
        passing = np.exp(-1j * frequencies[chosen] * apart / SPEED)
        expected = coherence(frequencies[chosen], abs(apart)) * passing
        product = force[:, first] * force[:, second].conj()
        for part in (np.real, np.imag):
            values = part(product)
            error = values.std(axis=0, ddof=1) / np.sqrt(len(values))
            assert (np.abs(values.mean(axis=0) - part(expected)) < 4.5 * error + 1e-6).all()


@pytest.mark.parametrize("method", [il.ExactFlow(), il.RungeKutta4()], ids=["exact flow", "RK4"])
def test_statistics_agree_with_the_exact_law(method):
    result = il.simulate(network(), 40.0, realizations=128, rng=2, spin_up=0.0, integrator=method)
    compared = il.compare(result, il.exact(network()))
    assert np.abs(compared.z).max() < 4.5


def test_distances_are_those_of_places_in_space():
    sources = il.coherent(NOISE, {"a": (0.0, 0.0), "b": (3.0, 4.0)}, GUSTS)
    frequencies, amplitudes = NOISE.lines()
    found = sources["noise 1 b"].excitation.lines()[1]
    np.testing.assert_allclose(found, amplitudes * coherence(frequencies, 5.0), rtol=1e-8)


def test_the_coherence_of_motions_of_the_ground():
    found = il.harichandran_vanmarcke(0.736, 0.147, 5210.0, 2.0 * np.pi * 1.09, 2.78)(np.array([0.0, 10.0]), 200.0)
    scale = 5210.0 / np.sqrt(1.0 + (10.0 / (2.0 * np.pi * 1.09)) ** 2.78)
    b = 0.264 + 0.147 * 0.736
    for value, theta in zip(found, (5210.0, scale), strict=True):
        expected = 0.736 * np.exp(-400.0 * b / (0.147 * theta)) + 0.264 * np.exp(-400.0 * b / theta)
        assert value == pytest.approx(expected, rel=1e-12)


def test_full_coherence_is_one_noise():
    together = il.coherent(NOISE, PLACES, lambda frequencies, distance: 1.0)
    law = il.exact(il.Network(dict.fromkeys(PLACES, BODY), None, together))
    variance = law.statistics().variance_displacement.values
    assert law.covariance("a", "c", "displacement") == pytest.approx(variance[0], rel=1e-7)
    np.testing.assert_allclose(variance, variance[0], rtol=1e-7)


def test_a_network_with_them_is_the_same_from_its_text():
    there = network()
    assert il.Network.from_dict(there.to_dict()) == there


STREET = {"tower": (0.0, 0.0), "beam": (60.0, 25.0), "hut": (-40.0, 0.0)}


class Given(il.Excitation):
    """A sum of cosines of given amplitudes."""

    frequencies: tuple = il.parameter(kw_only=False)
    amplitudes: tuple = il.parameter(kw_only=False)

    def lines(self):
        return np.array(self.frequencies), np.array(self.amplitudes)


def quake():
    soil, w = il.KanaiTajimi(1.0, 15.0, 0.6), np.linspace(0.5, 40.0, 80)
    return il.TabulatedNoise(w, soil.density(w), components=1000)


@pytest.mark.parametrize("quantity", ["displacement", "velocity"])
def test_coherent_motions_of_the_ground_move_structures_as_their_receptances_say(quantity):
    """Sums over the lines of what the cross-spectral densities of the accelerations do to whole matrices."""
    numbers = 0.736, 0.147, 300.0, 2.0 * np.pi * 1.09, 2.78
    coherence = il.harichandran_vanmarcke(*numbers)
    given = il.coherent(il.BaseMotion(quake()), STREET, coherence, wave_speed=200.0)
    mass, damping, stiffness, forces, roofs = matrices_of_buildings()
    frequencies, amplitudes = quake().lines()
    places = np.array(list(STREET.values()))
    distances = np.linalg.norm(places[:, None] - places, axis=-1)
    late = np.subtract.outer(places[:, 0], places[:, 0]) / 200.0
    expected = np.zeros((3, 3))
    for w, amplitude in zip(frequencies, amplitudes, strict=True):
        moving = roofs @ np.linalg.solve(stiffness - w**2 * mass + 1j * w * damping, -forces)
        alike = [[coherence(np.array([w]), distance)[0] for distance in row] for row in distances]
        cross = 0.5 * amplitude**2 * np.array(alike) * np.exp(-1j * w * late)
        expected += (moving @ cross @ moving.conj().T).real * (w**2 if quantity == "velocity" else 1.0)
    np.testing.assert_allclose(covariances_of_buildings(given, quantity), expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("coherence", [1.0, 0.0])
def test_full_and_no_coherence_of_the_ground_are_one_motion_and_independent_ones(coherence):
    ground = il.BaseMotion(quake())
    found = covariances_of_buildings(il.coherent(ground, STREET, lambda w, d: coherence))
    on_their_own = {f"ground {name}": il.BaseMotion(quake(), on=name) for name in STREET}
    expected = covariances_of_buildings({"ground": ground} if coherence else on_their_own)
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-16)
    assert coherence or not found[0, 1:].any()


def test_heavy_soils_below_two_bodies_move_as_the_second_filter_of_clough_and_penzien():
    """So that bodies beside them do what they do on that ground, and what the soils move apart is there besides."""
    places, lines = {"a": 0.0, "b": 40.0}, np.linspace(0.2, 30.0, 500)
    layer, whole = il.KanaiTajimi(1.0, 15.0, 0.6), il.CloughPenzien(1.0, 15.0, 0.6, 1.5, 0.6)
    loss = il.harichandran_vanmarcke(0.736, 0.147, 300.0, 7.0, 2.8)

    def moved(noise, on):
        table = Given(tuple(lines), tuple(np.sqrt(noise.density(lines))))
        return il.coherent(il.BaseMotion(table), dict(zip(on, places.values(), strict=True)), loss, wave_speed=200.0)

    body = il.LinearOscillator(mass=1.0, damping=0.6, stiffness=30.0)
    beside = il.exact(il.Network({"a": body, "b": body}, None, moved(whole, places)))
    soil = il.LinearOscillator.from_frequency(1.5, 0.6, mass=1e9)
    columns = {
        f"{name} columns": il.Coupling(f"{name} soil", name, il.LinearCoupling(30.0, damping=0.6)) for name in places
    }
    bodies = {"a soil": soil, "b soil": soil} | dict.fromkeys(places, il.LinearOscillator(mass=1.0))
    law = il.exact(il.Network(bodies, None, moved(layer, ["a soil", "b soil"]), columns))
    for one, other in (("a", "a"), ("a", "b"), ("b", "b")):
        signs = {one: 1.0, f"{one} soil": -1.0}, {other: 1.0, f"{other} soil": -1.0}
        found = sum(
            here * there * law.covariance(first, second, "displacement")
            for first, here in signs[0].items() for second, there in signs[1].items()
        )  # fmt: skip
        assert found == pytest.approx(beside.covariance(one, other, "displacement"), rel=1e-6)


@pytest.mark.full
def test_structures_in_a_run_on_coherent_ground_are_those_of_the_law():
    street = {"beam": 0.0, "hut": 30.0}
    given = il.coherent(il.BaseMotion(quake()), street, il.harichandran_vanmarcke(0.7, 0.15, 300.0, 7.0, 2.8))
    network = il.Network({name: BUILDINGS[name] for name in street}, None, given)
    result = il.simulate(network, 20.0, realizations=128, rng=3, record=il.Trajectory(0.5))
    x = result.point_displacement.sel(point="beam.tip") * result.displacement.sel(oscillator="hut")
    each = x.mean("time").values
    expected = il.exact(network).covariance("beam.tip", "hut", "displacement")
    assert abs(each.mean() - expected) < 4.0 * each.std(ddof=1) / np.sqrt(len(each))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (lambda: il.coherent(NOISE, PLACES, lambda w, d: np.where(w > 2.05, -0.9, 0.0)), r"at 2\.125 rad/s, where the"),
        (lambda: il.coherent(NOISE, PLACES, lambda w, d: 1.5), r"from -1 to 1, but it is 1\.5 at 0\.125 rad/s and 3 m"),
        (lambda: il.coherent(il.WhiteNoise(1.0), PLACES, GUSTS), "a sum of cosines such as il.TabulatedNoise"),
        (
            lambda: il.coherent(il.BaseMotion(il.KanaiTajimi(1.0, 15.0, 0.6)), PLACES, GUSTS),
            r"not KanaiTajimi\(.*\); il.TabulatedNoise\(frequencies, noise.density\(frequencies\)\) is that of filt",
        ),
        (lambda: il.coherent(il.BaseMotion(NOISE, on="a"), PLACES, GUSTS), "coherent takes a BaseMotion without on="),
        (lambda: il.coherent(NOISE, {"a": "here"}, GUSTS), "the position of 'a' must be a number"),
        (lambda: il.coherent(NOISE, {"a": 0.0, "b": (1.0, 2.0)}, GUSTS), "as many coordinates each"),
        (lambda: il.coherent(NOISE, PLACES, GUSTS, wave_speed=0.0), "wave_speed must not be 0"),
        (lambda: il.davenport(-1.0, 10.0), "decay must be at least 0, not -1.0"),
        (lambda: il.harichandran_vanmarcke(1.5, 0.1, 5e3, 6.0, 2.0), "share must be from 0 to 1, not 1.5"),
    ],
)
def test_what_is_refused(given, message):
    with pytest.raises(il.InvalidInput, match=message):
        given()
