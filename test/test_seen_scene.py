"""A scene from elsewhere: what stands by what does not depend on who looks, nor on when."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from reference_goal_rows import in_inertial, sees_by_duration
from robots import CONFIG
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from ff_planner_benchmark.problems import tumbling
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.planning.distance.grasp_seen import GraspSeen
from ff_planner_ros.planning.problem.obstacles import attached, carried
from ff_planner_ros.planning.problem.problem import (
    Obstacle,
    PlanningProblem,
    Target,
    with_attached,
    with_capture_target,
)
from ff_planner_ros.planning.problem.scene import Scene, scene_of
from ff_planner_ros.planning.problem.target_body import AttachedObstacle, TargetBody
from ff_planner_ros.planning.robust.grasp_frames import grasp_frames
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.robot.collision.solids import Solid
from ff_planner_ros.robot.model import Base
from ff_planner_ros.robot.rotation import skew

SIGNS = pytest.mark.parametrize("sign", [1.0, -1.0])
TIMES = np.array([0.0, 1.0, 2.5, 4.0, 5.0, 6.5])
CAPTURE = 5.0
PLACE = np.array([0.3, -0.2, 0.5])  # in the grasp's frame [m]
ATTITUDE = Rotation.from_rotvec([0.7, -1.9, 0.4])


def moving_target(sign: float) -> Target:
    return Target(
        position=np.array([1.0, -2.0, 0.5]),
        quaternion_xyzw=ATTITUDE.as_quat(),
        linear_velocity=sign * np.array([0.05, -0.02, 0.1]),
        angular_velocity=sign * np.array([0.3, -0.2, 0.15]),
    )


def spinning_body(sign: float) -> TargetBody:
    """A ball, which turns steadily."""
    return TargetBody(
        position=np.array([0.5, 1.5, -0.5]),
        quaternion_xyzw=Rotation.from_rotvec([-0.4, 1.2, 2.0]).as_quat(),
        inertia=np.eye(3),
        grasp_position=np.array([0.4, 0.1, -0.3]),
        grasp_quaternion_xyzw=Rotation.from_rotvec([0.1, -0.8, 0.5]).as_quat(),
        linear_velocity=sign * np.array([-0.03, 0.06, 0.02]),
        angular_velocity=sign * np.array([-0.2, 0.25, 0.1]),
    )


def grasp_at(thing: Target | TargetBody, time: float) -> tuple[Array, Array]:
    """Place and rotation of the grasp, by the exponential of its turn rate."""
    turn = expm
    if isinstance(thing, Target):
        since = time - CAPTURE
        rotation = turn(since * skew(thing.angular_velocity)) @ ATTITUDE.as_matrix()
        return thing.position + since * thing.linear_velocity, rotation
    body = turn(time * skew(thing.angular_velocity))
    body = body @ Rotation.from_quat(thing.quaternion_xyzw).as_matrix()
    center = thing.position + time * thing.linear_velocity
    grasp = Rotation.from_quat(thing.grasp_quaternion_xyzw).as_matrix()
    return center + body @ thing.grasp_position, body @ grasp


THINGS = pytest.mark.parametrize("make", [moving_target, spinning_body])


@SIGNS
@THINGS
def test_the_grasp_sees_what_goes_with_it_in_one_place(make: type, sign: float) -> None:
    """Up to the capture, and that moment is the last one though rounding may put it later."""
    thing = make(sign)
    is_target = isinstance(thing, Target)
    scene = Scene(
        target=thing if is_target else None,
        target_body=None if is_target else thing,
        capture_time=CAPTURE,
    )
    for times in (TIMES, TIMES + 1e-9, TIMES - 1e-9):
        frames = grasp_frames(scene, Base.FREE_FLYER, times)
        assert frames is not None
        assert frames.until == 5
        points = []
        for time in times[:5]:
            position, rotation = grasp_at(thing, time)
            points.append(position + rotation @ PLACE)
        np.testing.assert_allclose(frames.sees(np.array(points)), np.tile(PLACE, (5, 1)), atol=1e-9)
        two = np.array(points)[:, None].repeat(2, axis=1)
        np.testing.assert_allclose(frames.sees(two)[:, 1], np.tile(PLACE, (5, 1)), atol=1e-9)


def test_without_a_capture_time_the_last_moment_is_that_of_the_capture() -> None:
    frames = grasp_frames(Scene(target=moving_target(1.0)), Base.FREE_FLYER, TIMES[:5])
    assert frames is not None
    assert frames.until == 5
    np.testing.assert_allclose(frames.positions[-1], [1.0, -2.0, 0.5])
    assert grasp_frames(Scene(), Base.FREE_FLYER, TIMES) is None


@THINGS
def test_on_a_table_no_height_counts(make: type) -> None:
    thing = make(1.0)
    is_target = isinstance(thing, Target)
    scene = Scene(
        target=thing if is_target else None,
        target_body=None if is_target else thing,
        capture_time=CAPTURE,
    )
    frames = grasp_frames(scene, Base.PLANAR, TIMES)
    assert frames is not None
    points = frames.positions + np.array([0.0, 0.0, 7.0])
    np.testing.assert_allclose(frames.sees(points), np.zeros((5, 3)), atol=1e-12)
    aside = frames.positions + np.array([0.2, 0.0, 7.0])
    np.testing.assert_allclose(np.linalg.norm(frames.sees(aside), axis=1), 0.2)


@SIGNS
@THINGS
def test_what_goes_with_the_grasp_rests_in_it_for_the_check_and_the_search(
    lemur_capture: PlanningProblem, make: type, sign: float
) -> None:
    thing = make(sign)
    problem = replace(lemur_capture, obstacles=(), duration=CAPTURE)
    if isinstance(thing, Target):
        problem = replace(problem, target=thing)
    else:
        problem = with_capture_target(thing, problem)
    points, step = [], 1e-5
    for time in TIMES:
        at = [grasp_at(thing, time + off) for off in (-step, 0.0, step)]
        points.append([position + rotation @ PLACE for position, rotation in at])
    before, now, after = np.array(points).swapaxes(0, 1)
    seen, places = GraspSeen(problem, TIMES), np.tile(PLACE, (len(TIMES), 1))
    np.testing.assert_allclose(seen.sees(now), places, atol=1e-9)
    np.testing.assert_allclose(seen.is_at(places), now, atol=1e-9)
    np.testing.assert_allclose(seen.sees_moving(now, (after - before) / (2 * step)), 0.0, atol=1e-8)
    from_grasp = [position for position, _ in (grasp_at(thing, time) for time in TIMES)]
    np.testing.assert_allclose(seen.from_grasp(now), now - from_grasp, atol=1e-9)
    gradients = np.tile([0.0, 1.0, 0.0], (len(TIMES), 1))
    turned = [grasp_at(thing, time)[1][:, 1] for time in TIMES]
    np.testing.assert_allclose(in_inertial(seen, gradients), turned, atol=1e-9)


@SIGNS
def test_places_change_with_the_duration_as_those_of_problems_made_anew(
    lemur_capture: PlanningProblem, sign: float
) -> None:
    """At fixed parts of the duration, for points that stay where they are."""
    parts = TIMES[:5] / CAPTURE
    points = np.random.default_rng(2).normal(size=(5, 3))
    for thing in (moving_target(sign), spinning_body(sign)):
        no_change = np.zeros(6)
        seen = {}
        for duration in (CAPTURE - 1e-5, CAPTURE, CAPTURE + 1e-5):
            problem = replace(lemur_capture, obstacles=(), duration=duration)
            if isinstance(thing, Target):  # it stays the same at the goal, whenever that is
                problem = replace(problem, target=thing)
            else:
                problem = with_capture_target(thing, problem)
            seen[duration] = GraspSeen(problem, parts * duration)
        low, middle, high = seen.values()
        wanted = (high.sees(points) - low.sees(points)) / 2e-5
        found = sees_by_duration(middle, points, no_change)
        np.testing.assert_allclose(found, wanted, atol=1e-6)


def test_on_a_table_the_check_and_the_search_know_no_height() -> None:
    problem = load_scenario(CONFIG / "scenarios/planar_capture.yaml")
    seen = GraspSeen(problem, np.array([problem.duration]))
    above = problem.target.position + np.array([0.0, 0.0, 3.0])
    np.testing.assert_allclose(seen.sees(above[None]), np.zeros((1, 3)), atol=1e-12)
    lifted = in_inertial(seen, np.array([[1.0, 2.0, 3.0]]))
    assert lifted[0, 2] == 0.0


@SIGNS
def test_everything_in_a_scene_is_seen_in_one_place_from_a_frame_that_moves(sign: float) -> None:
    origin, velocity = np.array([3.0, -7.0, 2.0]), sign * np.array([0.4, 0.1, -0.3])
    free = Obstacle.sphere("free", np.array([1.0, 1.0, -1.0]), 0.2, np.array([0.1, 0.0, -0.2]))
    body = replace(
        tumbling.problem("tumbling", 0).target_body or spinning_body(1.0),
        linear_velocity=np.array([0.01, -0.04, 0.02]),
    )
    way = origin + TIMES[:, None] * velocity
    for scene in (
        Scene((free,), target=moving_target(1.0), capture_time=CAPTURE),
        Scene(with_attached((free,), body), target_body=body, capture_time=CAPTURE),
    ):
        seen = scene.seen_from(origin, velocity)
        assert len(seen.obstacles) == len(scene.obstacles)
        for here, there in zip(scene.obstacles, seen.obstacles, strict=True):
            assert here.id == there.id
        moved = seen.obstacles[0]
        places = moved.center + TIMES[:, None] * moved.motion.velocity
        wanted = free.center + TIMES[:, None] * free.motion.velocity - way
        np.testing.assert_allclose(places, wanted, atol=1e-12)
        before, after = scene.targets(TIMES), seen.targets(TIMES)
        assert before is not None
        assert after is not None
        np.testing.assert_allclose(after, before - way, atol=1e-12)
        if seen.target_body is not None:
            points = np.array([one.position for one in body.obstacles])
            np.testing.assert_allclose(
                seen.target_body.places(points, TIMES),
                body.places(points, TIMES) - way[:, None],
                atol=1e-12,
            )


def test_a_target_is_where_it_is_told_to_be_at_the_capture_alone() -> None:
    scene = Scene(target=moving_target(1.0)).captured_at(CAPTURE)
    assert scene.capture_time == CAPTURE
    assert scene.captured_at(9.0).capture_time == CAPTURE, "what is told counts"
    found = scene.targets(TIMES)
    wanted = [grasp_at(moving_target(1.0), time)[0] for time in TIMES]
    np.testing.assert_allclose(found, wanted, atol=1e-12)


def test_what_is_fixed_to_a_body_goes_on_with_it() -> None:
    """Later, it is what is fixed to the body as that is then."""
    tumbler = tumbling.problem("tumbling", 0).target_body
    assert tumbler is not None
    panel = AttachedObstacle("panel", Solid("box", np.array([0.5, 0.3, 0.1])), [0.4, -0.2, 0.9])
    body = replace(tumbler, obstacles=(*tumbler.obstacles, panel))
    fixed, expected = carried((*attached(body),), 3.0), (*attached(body.after(3.0)),)
    assert {type(one) for one in fixed} == {Obstacle, Obstacle}
    for one, wanted in zip(fixed, expected, strict=True):
        for time in (0.0, 2.0):
            there, then = one.after(time), wanted.after(time)
            for name in ("center", "position", "quaternion_xyzw", "velocity", "angular_velocity"):
                if hasattr(one, name):
                    found = getattr(there, name)
                    np.testing.assert_allclose(found, getattr(then, name), atol=1e-9)


def test_without_a_capture_time_a_target_is_where_it_is_told_at_the_last_moment() -> None:
    scene = Scene(target=moving_target(1.0))
    wanted = scene.captured_at(float(TIMES[-1])).targets(TIMES)
    np.testing.assert_array_equal(scene.targets(TIMES), wanted)
    with pytest.raises(InvalidInput, match="capture_time is missing"):
        scene.seen_from(np.zeros(3), np.ones(3))


def test_the_scene_of_a_problem_has_its_target_or_its_body_and_when(
    lemur_capture: PlanningProblem,
) -> None:
    scene = scene_of(lemur_capture)
    assert (scene.target, scene.target_body) == (lemur_capture.target, None)
    assert scene.capture_time == lemur_capture.duration
    assert scene.obstacles == lemur_capture.obstacles
    capture = tumbling.problem("tumbling", 0)
    assert (scene_of(capture).target, scene_of(capture).target_body) == (None, capture.target_body)
