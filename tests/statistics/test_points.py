"""Statistics at points of structures: those of bodies by another way, of the same motion by other means, and laws."""

import numpy as np
import pytest
from scenes import deviations
from scipy.linalg import eigh, expm, solve_continuous_lyapunov
from scipy.special import ndtr

import impactlab as il
from impactlab.results.schema import BODY, OF_POINTS, STATISTICS

OF_BODIES = [name for name, statistic in STATISTICS.items() if statistic.dimension == BODY]
HERTZ = il.HertzContact(1e4)

# plain means at points


BEAM = il.ModalStructure(
    [10.0, 60.0, 25.0],
    [0.02, 0.02, 0.2],
    points={"one": [1.0, 0.0, 0.0], "tip": [2.0, -2.0, 1.0], "two": [0.0, 1.0, 0.0]},
)
STOP = {"stop": il.Contact("beam.tip", il.WALL, HERTZ, clearance=0.1)}


@pytest.mark.full
@pytest.mark.filterwarnings("ignore:Too few independent samples", "ignore:The two halves", "ignore:At the step of")
@pytest.mark.parametrize(
    ("excitation", "options"),
    [
        ({"beam.tip": il.WhiteNoise(1.0)}, {"spin_up": 2.0}),
        ({"beam.tip": il.WhiteNoise(1.0)}, {"initial": {"velocity": {"beam.1": 1.0}}}),
        ({"beam.tip": il.ShinozukaNoise(1.0, band=(0.0, 20.0), components=500)}, {"spin_up": 2.0}),
        ({"beam.tip": il.Harmonic(amplitude=3.0, frequency=7.0)}, {}),
        ({"beam.tip": il.Harmonic(amplitude=3.0, frequency=7.0)}, {"integrator": il.RungeKutta4()}),
    ],
    ids=["white", "given start", "cosines", "given force", "Runge-Kutta"],
)
def test_a_point_of_one_mode_is_its_body(excitation, options):
    """Sums of their own give the numbers of the body to rounding."""
    options = {"duration": 5.0, "realizations": 8, "rng": 1, "record": il.PerRealization(), **options}
    result = il.simulate(il.Network({"beam": BEAM}, STOP, excitation), **options)
    assert result.contact_ratio.item() > 0.03
    for name in OF_BODIES:
        body = result[f"{name}_by_realization"].sel(oscillator=["beam.1", "beam.2"]).values
        point = result[f"point_{name}_by_realization"].sel(point=["beam.one", "beam.two"]).values
        np.testing.assert_allclose(point, body, rtol=1e-11, atol=1e-15, err_msg=name)


# one building, three ways

MASS = np.array([2.0, 1.9, 1.8, 1.7, 1.6])
STOREYS = np.array([400.0, 380.0, 350.0, 300.0, 260.0])
STIFFNESS = np.diag(STOREYS + np.append(STOREYS[1:], 0.0)) - np.diag(STOREYS[1:], 1) - np.diag(STOREYS[1:], -1)
RATE = 0.2  # damping over mass
NAMES = ["first", "second", "third", "fourth", "roof"]
FLOORS = [f"tower.{name}" for name in NAMES]
TOWER = il.LinearStructure(MASS, RATE * np.diag(MASS), STIFFNESS, names=NAMES)


def modes(mass=MASS, stiffness=STIFFNESS, rate=RATE, names=NAMES):
    squares, shapes = eigh(stiffness, np.diag(mass))
    points = dict(zip(names, shapes.tolist(), strict=True))
    return il.ModalStructure(np.sqrt(squares), 0.5 * rate / np.sqrt(squares), points=points)


def building(kind, **members):
    """A network with the tower: as bodies, as matrices, or as modes."""
    if kind != "bodies":
        return il.Network({"tower": {"matrices": TOWER, "modes": modes()}[kind]}, **members)
    grounds = np.append(STOREYS[0], np.zeros(4))
    bodies = {
        name: il.LinearOscillator(mass=mass, damping=RATE * mass, stiffness=ground)
        for name, mass, ground in zip(FLOORS, MASS, grounds, strict=True)
    }
    springs = {
        upper: il.Coupling(lower, upper, il.LinearCoupling(storey))
        for lower, upper, storey in zip(FLOORS, FLOORS[1:], STOREYS[1:], strict=False)
    }
    return il.Network(bodies, couplings=springs, **members)


def at_floors(result, name):
    """A statistic or a trajectory of the floors, which are bodies or points."""
    return result[f"point_{name}"].sel(point=FLOORS) if "point" in result.dims else result[name].sel(oscillator=FLOORS)


@pytest.mark.full
@pytest.mark.parametrize("force", [False, True])
def test_one_motion_three_ways(force):
    """Where nothing is random, paths with contacts and their statistics are the same up to rounding."""
    push = {"excitations": {"tower.third": il.Harmonic(amplitude=20.0, frequency=9.0)}} if force else {}
    contacts = {"stop": il.Contact("tower.roof", il.WALL, HERTZ, clearance=0.05)}
    start = {"velocity": {"tower.roof": 1.0, "tower.second": 0.4}, "displacement": {"tower.first": -0.02}}
    options = {"duration": 6.0, "spin_up": 0.0, "step": 2e-3, "initial": start, "rng": 1, "record": il.Trajectory(0.2)}
    bodies, matrices, shapes = (
        il.simulate(building(kind, contacts=contacts, **push), **options) for kind in ("bodies", "matrices", "modes")
    )
    assert bodies.contact_ratio.item() > 0.01
    for other in (matrices, shapes):
        for name in ("displacement", "velocity", *OF_BODIES):
            expected = at_floors(bodies, name).values
            scale = 1e-9 * np.abs(expected).max()
            np.testing.assert_allclose(at_floors(other, name).values, expected, rtol=1e-9, atol=scale, err_msg=name)
        for name in ("contact_force", "contact_ratio", "contact_rate", "mean_contact_force"):
            scale = 1e-8 * float(np.abs(bodies[name]).max())
            np.testing.assert_allclose(other[name], bodies[name], rtol=1e-8, atol=scale, err_msg=name)


@pytest.mark.campaign
def test_one_noise_three_ways():
    """One physical noise on two floors: the same law of the floors, and the same statistics within their errors."""
    wind = {"wind": il.Source(il.WhiteNoise(0.4), on={"tower.second": 1.0, "tower.roof": 2.0})}
    calm = [building(kind, excitations=wind) for kind in ("bodies", "matrices", "modes")]
    laws = [il.exact(network).statistics() for network in calm]
    for name in OF_BODIES:
        for law in laws[1:]:
            np.testing.assert_allclose(at_floors(law, name), at_floors(laws[0], name), rtol=1e-8, atol=1e-14)
    contacts = {"stop": il.Contact("tower.roof", il.WALL, HERTZ, clearance=0.05)}
    results = [
        il.simulate(building(kind, contacts=contacts, excitations=wind), duration=30.0, realizations=64, rng=seed)
        for seed, kind in enumerate(("matrices", "modes"))
    ]
    for name in ("mean_displacement", "mean_square_displacement", "variance_displacement", "mean_square_velocity"):
        (one, error), (other, beside) = (
            (at_floors(item, name).values, at_floors(item, f"{name}_standard_error").values) for item in results
        )
        assert (np.abs(one - other) < 3.5 * np.hypot(error, beside)).all(), name
        assert (error < 0.2 * np.sqrt(at_floors(results[0], "mean_square_velocity").values)).all()


# laws


@pytest.mark.full
@pytest.mark.parametrize("stiffness", [20.0, 300.0], ids=["kicks", "flows"])
def test_the_linear_law_at_a_large_step(stiffness):
    """Modes and a body with their own and common noises and a coupling that kicks or flows, at a step of one radian."""
    beam = il.ModalStructure(
        [10.0, 17.0, 25.0],
        [0.05, 0.1, 0.05],
        points={"a": [2.0, -2.0, 1.0], "b": [1.0, 1.0, 1.0], "c": [0.0, 1.0, -1.0]},
    )
    network = il.Network(
        {"beam": beam, "x": il.LinearOscillator(damping=3.0, stiffness=300.0)},
        {"far": il.Contact("x", il.WALL, il.LinearContact(1.0), clearance=50.0)},
        {
            "beam.a": il.WhiteNoise(1.0),
            "beam.2": il.WhiteNoise(0.3),
            "both": il.Source(il.WhiteNoise(0.5), on={"beam.b": 1.0, "x": 2.0}),
            "x": il.WhiteNoise(0.2),
        },
        {"tie": il.Coupling("beam.c", "x", il.LinearCoupling(stiffness))},
    )
    method = il.ExactFlow(measured=False)
    result = il.simulate(network, duration=200.0, realizations=256, rng=6, step=0.04, integrator=method)
    law = il.exact(network).statistics()
    off = deviations(result, law, OF_POINTS)
    assert max(off.values()) < 3.5, off
    assert (result.point_mean_square_velocity_standard_error < 8e-4 * law.point_mean_square_velocity).all()


def test_exact_law_of_points():
    """w C wᵀ of the matrices, with noise on one floor."""
    mass = np.diag(MASS) + 0.2 * (np.eye(5, k=1) + np.eye(5, k=-1))
    damping = RATE * mass
    damping[4, 4] += 1.0
    tower = il.LinearStructure(mass, damping, STIFFNESS, names=NAMES)
    law = il.exact(il.Network({"tower": tower}, excitations={"tower.roof": il.WhiteNoise(0.3)})).statistics()
    inverse = np.linalg.inv(mass)
    drift = np.block([[np.zeros((5, 5)), np.eye(5)], [-inverse @ STIFFNESS, -inverse @ damping]])
    noise = np.zeros((10, 10))
    noise[5:, 5:] = 2.0 * np.pi * 0.3 * np.outer(inverse[4], inverse[4])
    covariance = np.diagonal(solve_continuous_lyapunov(drift, -noise))
    np.testing.assert_allclose(law.point_mean_square_displacement, covariance[:5], rtol=1e-9)
    np.testing.assert_allclose(law.point_variance_displacement, covariance[:5], rtol=1e-9)
    np.testing.assert_allclose(law.point_mean_square_velocity, covariance[5:], rtol=1e-9)


def pushed(excitations):
    """Modes of which some have noises of their own, and a body beside them that shares one."""
    points = {"a": [2.0, -2.0, 1.0], "b": [1.0, 1.0, 0.0], "c": [0.0, 0.0, 3.0]}
    beam = il.ModalStructure([4.0, 7.0, 9.0], [0.05, 0.1, 0.2], points=points)
    return il.Network({"beam": beam, "x": il.LinearOscillator(damping=0.5, stiffness=20.0)}, {}, excitations)


def test_correlations_of_points():
    """Against the drift matrix of modes and a body; of the modes the third moves independently of the others."""
    shared = {"both": il.Source(il.WhiteNoise(0.4), on={"beam.b": 1.0, "x": -2.0}), "beam.3": il.WhiteNoise(0.2)}
    law, places = il.exact(pushed(shared)), np.diag([1.0, 1.0, 1.0, 1.0])
    frequency, damping = np.array([4.0, 7.0, 9.0]), np.array([0.4, 1.4, 3.6, 0.5])
    stiffness = np.append(frequency**2, 20.0)
    drift = np.block([[np.zeros((4, 4)), np.eye(4)], [-np.diag(stiffness), -np.diag(damping)]])
    noise = 0.4 * np.outer([1.0, 1.0, 0.0, -2.0], [1.0, 1.0, 0.0, -2.0]) + 0.2 * np.outer(places[2], places[2])
    growth = np.zeros((8, 8))
    growth[4:, 4:] = 2.0 * np.pi * noise
    covariance = solve_continuous_lyapunov(drift, -growth)
    weights = {"beam.a": [2.0, -2.0, 1.0, 0.0], "beam.b": [1.0, 1.0, 0.0, 0.0], "beam.c": [0.0, 0.0, 3.0, 0.0],
               "beam.2": places[1], "x": places[3]}  # fmt: skip
    for one, first in weights.items():
        for other, second in weights.items():
            for quantity, part in (("displacement", covariance[:4, :4]), ("velocity", covariance[4:, 4:])):
                expected = np.array(first) @ part @ second
                assert law.covariance(one, other, quantity) == pytest.approx(expected, rel=1e-9, abs=1e-13)
    w, lags, frequencies = np.array(weights["beam.a"]), np.array([0.0, 0.3, -1.0]), np.array([0.5, 5.0, 8.0])
    flows = expm(np.abs(lags)[:, None, None] * drift)
    expected = [w @ (flow @ covariance)[4:, 4:] @ w for flow in flows]
    np.testing.assert_allclose(law.autocovariance("beam.a", "velocity", lags), expected, rtol=1e-9)
    responses = [w / (stiffness - f**2 + 1j * f * damping) for f in frequencies]
    expected = [(response @ noise @ response.conj()).real for response in responses]
    np.testing.assert_allclose(law.spectrum("beam.a", "displacement", frequencies), expected, rtol=1e-9)
    with pytest.raises(il.InvalidInput, match=r"There is no body 'beam\.d'"):
        law.spectrum("beam.d", "displacement", frequencies)


@pytest.mark.parametrize(
    "excitation",
    [il.OrnsteinUhlenbeckNoise(0.3, correlation_time=0.2), il.ShinozukaNoise(0.3, band=(0.0, 20.0), components=60)],
    ids=["coloured", "cosines"],
)
def test_correlations_of_points_under_other_noises(excitation):
    """Of the point of one mode those of its body; the squared sum of two points gives what is between them."""
    law = il.exact(pushed({"beam.a": excitation, "beam.2": excitation.replace(spectral_density=0.1), "x": excitation}))
    lags = np.array([0.0, 0.4])
    alone = law.autocovariance("beam.3", "displacement", lags)
    np.testing.assert_allclose(law.autocovariance("beam.c", "displacement", lags), 9.0 * alone, rtol=1e-9)
    for quantity in ("displacement", "velocity"):
        now = law.autocovariance("beam.a", quantity, 0.0)
        assert now == pytest.approx(law.covariance("beam.a", "beam.a", quantity), rel=1e-9)
    modes = [law.covariance(f"beam.{one}", f"beam.{other}", "displacement") for one, other in ("11", "22", "12")]
    expected = modes[0] + modes[1] + 2.0 * modes[2]
    assert law.covariance("beam.b", "beam.b", "displacement") == pytest.approx(expected, rel=1e-9)
    assert law.autocovariance("beam.b", "displacement", 0.0) == pytest.approx(expected, rel=1e-9)
    if isinstance(excitation, il.ShinozukaNoise):
        with pytest.raises(il.NoExactReference, match=r"The spectrum of 'beam\.1' and 'beam\.2' has no density"):
            law.spectrum("beam.b", "displacement", 1.0)
    else:
        frequencies = np.linspace(-400.0, 400.0, 160_001)
        whole = np.trapezoid(law.spectrum("beam.b", "displacement", frequencies), frequencies)
        assert whole == pytest.approx(expected, rel=1e-5)


@pytest.mark.campaign
def test_towers_of_modes_that_pound():
    """The law is that of the same towers as bodies, and the simulated one."""
    warm = {name: il.WhiteNoise(RATE * mass / np.pi) for name, mass in zip(FLOORS, MASS, strict=True)}
    floors = ["a", "b", "top"]
    warm |= {f"other.{name}": il.WhiteNoise(RATE * mass / np.pi) for name, mass in zip(floors, MASS[:3], strict=True)}
    gap = {"gap": il.Contact("tower.roof", "other.top", HERTZ, clearance=0.05)}
    other = il.LinearStructure(MASS[:3], RATE * np.diag(MASS[:3]), STIFFNESS[:3, :3], names=floors)
    network = il.Network({"tower": modes(), "other": modes(MASS[:3], STIFFNESS[:3, :3], names=floors)}, gap, warm)
    law = il.exact(network).statistics()
    reference = il.exact(il.Network({"tower": TOWER, "other": other}, gap, warm))
    bodies = reference.statistics()
    for name in ("contact_ratio", "contact_rate", "mean_contact_force"):
        np.testing.assert_allclose(law[name], bodies[name], rtol=1e-9)
    for name in ("mean_displacement", "mean_square_displacement", "variance_displacement", "mean_square_velocity"):
        np.testing.assert_allclose(law[f"point_{name}"], bodies[name], rtol=1e-8, err_msg=name)
    grid = np.linspace(-0.3, 0.3, 13)
    for quantity in ("displacement", "velocity"):
        own = il.exact(network).density("tower.roof", quantity, grid)
        np.testing.assert_allclose(own, reference.density("tower.roof", quantity, grid), rtol=1e-8)
    result = il.simulate(network, duration=20.0, realizations=128, rng=4)
    names = ["point_mean_square_velocity", "point_mean_square_displacement", "contact_ratio", "contact_rate"]
    off = deviations(result, law, names, relative=2e-3)
    assert max(off.values()) < 3.5, off
    assert result.contact_ratio.item() > 0.02


# files and records


@pytest.mark.full
@pytest.mark.filterwarnings("ignore:.*Too few independent samples")
def test_files_trajectories_and_sweeps(tmp_path):
    def make(clearance):
        stop = {"stop": il.Contact("beam.tip", il.WALL, HERTZ, clearance=clearance)}
        return il.Network({"beam": BEAM}, stop, {"beam.tip": il.WhiteNoise(1.0)})

    options = {"duration": 2.0, "realizations": 3, "rng": 1, "record": il.Trajectory(0.1)}
    result = il.simulate(make(0.1), **options)
    shapes = np.array([[1.0, 0.0, 0.0], [2.0, -2.0, 1.0], [0.0, 1.0, 0.0]])
    for name in ("displacement", "velocity"):
        np.testing.assert_allclose(result[f"point_{name}"], result[name].values @ shapes.T, rtol=1e-12, atol=1e-15)
        assert result[f"point_{name}"].attrs["units"] == result[name].attrs["units"]
    streamed = il.simulate(make(0.1), **options, out=tmp_path / "paths.nc")
    il.save(result, tmp_path / "result.nc")
    again = il.rerun(tmp_path / "result.nc")
    for name in ("point_displacement", "point_velocity", "point_mean_square_velocity"):
        assert streamed[name].equals(result[name])
        assert again[name].equals(result[name])
    assert list(result.point.values) == ["beam.one", "beam.tip", "beam.two"]
    swept = il.sweep(make, {"clearance": [0.1, 0.2]}, duration=1.0, initial="rest", spin_up=0.0, rng=1)
    assert swept.point_mean_square_velocity.dims == ("clearance", "point")
    compiled = make(0.1).compile()
    solution = compiled.to_dataset(np.zeros(1), np.arange(6.0)[:, None])
    np.testing.assert_allclose(solution.point_displacement.values, [shapes @ np.arange(3.0)])


def test_densities_and_spectra_at_points():
    """Of a point that one mode moves they are those of this mode; at the tip they have the law of the linear motion."""
    bodies, points = ("beam.1", "beam.2"), ("beam.one", "beam.two")
    limits = {"beam.one": (-0.5, 0.5), "beam.two": (-0.2, 0.1)}
    limits |= {"beam.1": limits["beam.one"], "beam.2": limits["beam.two"]}
    own = {name: limits[name] for name in bodies}, {name: limits[name] for name in points}
    records = [
        record
        for names, of, kind in ((bodies, own[0], ""), (points, own[1], "point_"))
        for record in (
            il.Density(kind + "displacement", oscillators=names, limits=of, bins=30),
            il.Spectrum(kind + "velocity", labels=names, segment=5.0),
        )
    ]
    network = il.Network({"beam": BEAM}, STOP, {"beam.tip": il.WhiteNoise(1.0)})
    options = {
        "duration": 20.0,
        "realizations": 64,
        "rng": 1,
        "step": 0.005,
        "integrator": il.ExactFlow(measured=False),
    }
    found = il.simulate(network, **options, record=records)
    for name in ("density_displacement", "density_displacement_standard_error", "displacement_edges"):
        point = found[name.replace("displacement", "point_displacement", 1)].sel(point=list(points))
        np.testing.assert_allclose(point, found[name].sel(oscillator=list(bodies)), rtol=1e-12)
        assert point.attrs["units"] == found[name].attrs["units"]
    spectra = (
        found.spectrum_point_velocity.sel(point=list(points)),
        found.spectrum_velocity.sel(oscillator=list(bodies)),
    )
    np.testing.assert_allclose(*spectra, rtol=1e-9)
    assert {f"{quantity}_center" for quantity in ("displacement", "point_displacement")} <= set(found.variables)
    assert "displacement at points" in found.density_point_displacement.attrs["long_name"]


def test_the_law_of_a_point_without_contacts():
    """Gaussian densities within limits that are chosen, and a joint density with a body."""
    network = il.Network({"beam": BEAM}, {}, {"beam.tip": il.WhiteNoise(1.0)})
    records = [
        il.Density("point_displacement", bins=40),
        il.Density("point_velocity", oscillators=("beam.tip",), bins=40),
    ]
    joint = il.JointDensity("beam.1", "beam.tip", bins=12)
    found = il.simulate(network, duration=30.0, realizations=256, rng=1, record=[*records, joint])
    law = il.exact(network).statistics()
    for quantity, names in (("displacement", ["beam.one", "beam.tip", "beam.two"]), ("velocity", ["beam.tip"])):
        variance = law[f"point_{'variance' if quantity == 'displacement' else 'mean_square'}_{quantity}"].sel(
            point=names
        )
        for name in names:
            edges = found[f"point_{quantity}_edges"].sel(point=name).values
            density = found[f"density_point_{quantity}"].sel(point=name).values
            error = found[f"density_point_{quantity}_standard_error"].sel(point=name).values
            exact = np.diff(ndtr(edges / np.sqrt(variance.sel(point=name).item()))) / np.diff(edges)
            np.testing.assert_allclose(il.exact(network).bin_density(name, quantity, edges), exact, rtol=1e-9)
            factor = found[f"density_point_{quantity}_band_factor"].sel(point=name).item()
            seen = error > 0.0
            assert seen.sum() > 20
            assert (np.abs(density - exact)[seen] < factor * error[seen]).mean() > 0.9
    marginal = found.joint_density.sum("joint_first_bin").values * np.diff(found.joint_first_edges.values)[0]
    edges, tip = found.joint_second_edges.values, law.point_variance_displacement.sel(point="beam.tip").item()
    exact = np.diff(ndtr(edges / np.sqrt(tip))) / np.diff(edges)
    np.testing.assert_allclose(marginal, exact, atol=0.02 * exact.max())
    for record, hint in (
        (il.Density("point_velocity", oscillators=("beam.1",)), r"oscillator 'beam\.1'; the quantity of a body is 'v"),
        (il.Density("velocity", oscillators=("beam.tip",)), r"oscillator 'beam\.tip'; .* of a point is 'point_veloc"),
        (
            il.Spectrum("displacement", labels=("beam.tip",)),
            r"label 'beam\.tip'; .* of a point is 'point_displacement'",
        ),
        (il.Spectrum("contact_force", labels=("beam.tip",)), r"label 'beam\.tip'; none is allowed here"),
    ):
        with pytest.raises(il.InvalidInput, match=f"there is no {hint}"):
            il.simulate(network, 1.0, record=record)


@pytest.mark.campaign
def test_a_tolerance_at_points():
    network = il.Network({"beam": BEAM}, STOP, {"beam.tip": il.WhiteNoise(1.0)})
    tolerance = {"point_mean_square_displacement": 0.05, "point_mean_velocity": 0.05}
    result = il.simulate(network, tolerance=tolerance, rng=1)
    value, bias = result.point_mean_square_displacement, result.point_mean_square_displacement_bias
    assert (abs(bias) + 2.0 * result.point_mean_square_displacement_standard_error <= 0.05 * value).all()
    assert bias.dims == ("point",)
    alone = il.Network({"a": il.LinearOscillator(damping=0.2, stiffness=1.0)}, {}, {"a": il.WhiteNoise(1.0)})
    with pytest.raises(il.InvalidInput, match="there is no statistic 'point_mean_velocity'"):
        il.simulate(alone, tolerance={"point_mean_velocity": 0.05})


def test_a_jackknife_at_points():
    network = il.Network({"beam": BEAM}, {}, {"beam.tip": il.WhiteNoise(1.0)})
    result = il.simulate(network, duration=10.0, realizations=64, rng=1, record=il.PerRealization())
    ratio = il.jackknife(result, lambda means: means.point_variance_displacement / means.point_mean_square_displacement)
    assert (np.abs(ratio.value - 1.0) < 0.05).all()


def test_networks_without_points_have_none():
    result = il.simulate(building("bodies"), duration=1.0, initial={"velocity": {"tower.roof": 1.0}}, rng=1)
    assert not any(str(name).startswith("point") for name in result.variables)
