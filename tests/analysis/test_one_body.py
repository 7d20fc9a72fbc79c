"""Paths of one body in the lanes of vectors, against lanes that go from event to event."""

import math

import numpy as np
import pytest

import impactlab as il
from impactlab.analysis.one_body import OneBodyPaths, is_one_body
from impactlab.analysis.tangents import Tangents
from impactlab.assembly.model import Model
from impactlab.kernels.contact_states import HELD
from impactlab.kernels.from_event_to_event import CLOSINGS, Span
from impactlab.kernels.one_body_lanes import LANES, RESTING
from impactlab.located.course import Course
from impactlab.located.scenes import as_lanes, linear_of

BEGIN, STROBES = 0.37, 12


def scene_of(restitution, clearance, frequency, force=1.0, damping=0.1, wall=0.0, load=0.0):
    bodies = {"a": il.LinearOscillator(mass=1.3, stiffness=1.0, damping=damping)}
    forces = {"a": il.Harmonic(force, frequency=frequency, phase=0.4)} if force else {}
    side = il.WALL
    if wall:
        bodies["w"], side = il.PrescribedMotion(il.Harmonic(wall, frequency=frequency)), "w"
    if load:
        forces["l"] = il.Source(il.ConstantForce(load), on={"a": 1.0})
    contact = il.Contact("a", side, il.RigidContact(restitution), clearance=clearance)
    return linear_of(Model.of(il.Network(bodies, {"stop": contact}, forces)))


@pytest.mark.parametrize(
    "scene",
    [
        scene_of(0.8, 1.0, 1.0),
        scene_of(0.3, -0.2, 0.7),  # rests in each period
        scene_of(0.0, 0.1, 0.7),
        scene_of(0.5, 0.1, 0.9, wall=0.3),
        scene_of(0.6, 0.1, 2.1, force=0.0, wall=0.3, load=0.4),
        scene_of(1.0, 0.3, 1.3, damping=0.5),
        scene_of(0.7, -0.3, 0.5, force=0.2, damping=0.6),  # stays at rest
    ],
)
def test_paths_are_those_of_located_events(scene):
    assert is_one_body(scene)
    omega, wall = scene.frequencies[0, 0], scene.wall[0, 0, 0]
    period, moving = 2.0 * math.pi / omega, wall * np.exp(1j * omega * BEGIN)
    draws = np.random.default_rng(1)
    x = -scene.gap[0, 0] - moving.real - draws.uniform(0.01, 1.0, LANES)
    v = draws.normal(size=LANES)
    begin = np.full(LANES, BEGIN)
    times = BEGIN + period * np.arange(1, STROBES + 1) * np.ones((LANES, 1))
    span = Span(1e-10, False)
    course = Course(as_lanes([scene] * LANES), x[:, None].copy(), v[:, None].copy(), begin, times[:, -1], times, span)
    course.run(lambda lane, contact: "stop")
    paths = OneBodyPaths(scene, BEGIN, x, v, period, 1e-10)
    states = paths.points(STROBES)
    assert states[:, :, 0] == pytest.approx(course.lanes.samples[:, :, 0], abs=2e-10)
    assert states[:, :, 1] == pytest.approx(course.lanes.samples[:, :, 1], abs=2e-9)
    if not course.lanes.contacts[:, 5].any():  # no bouncing was summed
        assert paths.impacts.tolist() == course.lanes.contacts[:, CLOSINGS, 0].tolist()
    assert (paths.state[0, RESTING] > 0.0).tolist() == (course.lanes.statuses[:, 0] == HELD).tolist()


def test_growths_are_those_of_carried_differences():
    body = il.LinearOscillator(mass=1.0, stiffness=1.0, damping=0.1)
    contact = {"stop": il.Contact("a", il.WALL, il.RigidContact(0.8), clearance=0.0)}
    network = il.Network({"a": body}, contact, {"a": il.Harmonic(1.0, frequency=2.8)})
    course = Tangents(network, Model.of(network), 1, LANES, None, None, (1, 2))
    lanes = course.course.lanes
    held, time = lanes.statuses[:, 0] == HELD, course.course.end[0]
    paths = OneBodyPaths(course.course.scene, time, lanes.x[:, 0], lanes.v[:, 0], course.base, 1e-10, held)
    course._follow(1)
    alone = paths.grown(8, 1)
    course._to(course.course, 8 * course.base, 8)
    other = course.course.lanes.growths[:, :, 0]
    unit = lambda item: np.abs(item).sum(axis=1)  # noqa: E731
    last = np.log(unit(course.course.lanes.differences[:, 1]))
    assert alone.sum(axis=1) == pytest.approx(other.sum(axis=1) + last, abs=1e-8)  # in the norm of the sum


@pytest.mark.parametrize("changes", [{"force": 0.0}, {"damping": 3.0}])
def test_other_scenes_are_none(changes):
    assert not is_one_body(scene_of(0.8, 1.0, 1.0, **changes))


@pytest.mark.parametrize("scene", [scene_of(0.3, 0.0, 0.7), scene_of(0.7, 0.0, 0.5, force=0.2, wall=0.1)])
def test_starts_at_the_stop_and_beyond_it(scene):
    """Pressed, pulled and thrown, at several phases; in hard bodies there is no motion."""
    period = 2.0 * math.pi / scene.frequencies[0, 0]
    for begin in np.linspace(0.0, period, 7):
        wall = scene.wall[0, 0, 0] * np.exp(1j * scene.frequencies[0, 0] * begin)
        place, pace = -scene.gap[0, 0] - wall.real, -(1j * scene.frequencies[0, 0] * wall).real
        x, v = place + np.array([0.0, 0.0, 0.0, 0.1]), pace + np.array([0.0, 0.3, -0.3, 0.0])
        points = OneBodyPaths(scene, begin, x, v, period, 1e-10).points(3)
        assert np.isnan(points[3]).all()
        times, lanes = begin + period * np.arange(1, 4) * np.ones((3, 1)), as_lanes([scene] * 3)
        begins, still = np.full(3, begin), [values[:3, None].copy() for values in (x, v)]
        course = Course(lanes, *still, begins, times[:, -1], times, Span(1e-10, False))
        course.run(lambda lane, contact: "stop")
        np.testing.assert_allclose(points[:3], course.lanes.samples[:, :, :2], atol=1e-9)
