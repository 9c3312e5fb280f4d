"""What a plan of a bag was made among: where everything is at the plan's first point."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from ff_planner_msgs.msg import AllowedCollisions, Approach, Goal, Plan, PlanAnswer
from geometry_msgs.msg import Vector3
from scipy.spatial.transform import Rotation

from ff_planner_benchmark.problems import tumbling
from ff_planner_ros.bag.scenes import (
    Received,
    Stamps,
    asked_scene,
    obstacles_in,
    scene_at_start,
    stamps_of,
)
from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.planning.problem.approach import HALF_ANGLE
from ff_planner_ros.planning.problem.obstacles import ObstacleBody
from ff_planner_ros.planning.problem.problem import (
    CONTACT_DISTANCE,
    Orientation,
    PlanningProblem,
    Sphere,
)
from ff_planner_ros.planning.problem.target_body import TargetBody
from ff_planner_ros.robot.collision.solids import Solid
from ff_planner_ros.ros.messages.to_messages import (
    bodies_message,
    obstacles_message,
    request_message,
    scene_message,
    target_body_message,
    time_message,
)

START = 1_000 * NANOSECONDS
SEEN = START - round(2.5 * NANOSECONDS)
BODY_SEEN = START - round(4.0 * NANOSECONDS)
SPHERES = (
    Sphere("still", np.array([1.0, 2.0, 3.0]), 0.2),
    Sphere("moving", np.array([1.0, -2.0, 3.0]), 0.3, np.array([0.1, -0.2, 0.4])),
)
STAMPS = Stamps(SEEN, BODY_SEEN, 7.5)
NOTHING = Received({}, {})


@pytest.fixture(scope="module")
def capture() -> PlanningProblem:
    return tumbling.problem("tumbling", 0)


def body_of(problem: PlanningProblem) -> TargetBody:
    assert problem.target_body is not None
    return replace(problem.target_body, linear_velocity=np.array([0.02, -0.01, 0.03]))


def test_obstacles_are_told_as_they_were_seen() -> None:
    found = obstacles_in(obstacles_message(SPHERES, SEEN, "inertial"))
    assert found is not None
    for told, sphere in zip(found, SPHERES, strict=True):
        assert (told.id, told.radius) == (sphere.id, sphere.radius)
        assert told.center.tolist() == sphere.center.tolist()
        assert told.velocity.tolist() == sphere.velocity.tolist()


@pytest.mark.parametrize("own", [True, False])
@pytest.mark.parametrize("later", [-1.0, 0.0, 2.5])
def test_obstacles_go_on_from_their_stamp_to_the_first_point(
    lemur_capture: PlanningProblem, own: bool, later: float
) -> None:
    """Those of a request go before those that were received with the same stamp."""
    request = request_message(lemur_capture, "inertial")
    stamp_ns = START - round(later * NANOSECONDS)
    if own:
        request.scene = [scene_message(SPHERES, stamp_ns, "inertial")]
    received = Received({stamp_ns: None if own else SPHERES, SEEN + 1: ()}, {})
    scene = scene_at_start(asked_scene(request), Stamps(stamp_ns, 0), START, received)
    assert scene is not None
    still, moving = scene.obstacles
    np.testing.assert_allclose(still.center, [1.0, 2.0, 3.0])
    np.testing.assert_allclose(
        moving.center, [1.0 + 0.1 * later, -2.0 - 0.2 * later, 3.0 + 0.4 * later]
    )
    assert moving.velocity.tolist() == [0.1, -0.2, 0.4]
    assert scene.capture_time == lemur_capture.duration


BODIES_SEEN = START - round(1.5 * NANOSECONDS)
PANEL = ObstacleBody(
    "panel",
    Solid("box", np.array([1.0, 2.0, 0.1])),
    np.array([3.0, 2.0, 1.0]),
    velocity=np.array([0.1, 0.0, 0.0]),
    angular_velocity=np.array([0.0, 0.2, 0.0]),
)


@pytest.mark.parametrize("own", [True, False])
def test_bodies_of_the_scene_go_on_and_turn_from_their_own_stamp(
    lemur_capture: PlanningProblem, own: bool
) -> None:
    request = request_message(lemur_capture, "inertial")
    bodies = obstacles_in(bodies_message((PANEL,), BODIES_SEEN, "inertial"))
    received = Received({SEEN: SPHERES}, {}, {BODIES_SEEN: bodies, SEEN: ()})
    stamps = Stamps(SEEN, 0, bodies_ns=BODIES_SEEN)
    if own:  # all of one stamp
        request.scene = [scene_message((*SPHERES, PANEL), BODIES_SEEN, "inertial")]
        stamps = Stamps(BODIES_SEEN, 0)
    scene = scene_at_start(asked_scene(request), stamps, START, received)
    assert scene is not None
    assert [one.id for one in scene.obstacles] == ["still", "moving", "panel"]
    (panel,) = scene.obstacle_bodies
    np.testing.assert_allclose(panel.position, [3.15, 2.0, 1.0])
    turned = Rotation.from_quat(panel.quaternion_xyzw.copy()).as_rotvec()
    np.testing.assert_allclose(turned, [0.0, 0.3, 0.0], atol=1e-12)


def test_a_scene_whose_bodies_the_bag_lacks_is_not_known(lemur_capture: PlanningProblem) -> None:
    asked = asked_scene(request_message(lemur_capture, "inertial"))
    stamps = Stamps(SEEN, 0, bodies_ns=BODIES_SEEN)
    for bodies in ({}, {BODIES_SEEN: None}, {SEEN: (PANEL,)}):
        assert scene_at_start(asked, stamps, START, Received({SEEN: SPHERES}, {}, bodies)) is None
    # The answer does not say when they were seen: they rest, or there were none.
    for told, names in (({}, []), ({0: (PANEL,)}, ["panel"])):
        received = Received({SEEN: SPHERES}, {}, told)
        scene = scene_at_start(asked, Stamps(SEEN, 0), START, received)
        assert scene is not None
        assert [one.id for one in scene.obstacle_bodies] == names


@pytest.mark.parametrize("own", [True, False])
def test_a_body_goes_on_from_its_own_stamp_with_all_that_is_fixed_to_it(
    capture: PlanningProblem, own: bool
) -> None:
    request, body = request_message(capture, "inertial"), body_of(capture)
    if own:
        request.target_body = [target_body_message(body, BODY_SEEN, "inertial")]
    received = Received({SEEN: ()}, {} if own else {BODY_SEEN: body, SEEN: capture.target_body})
    scene = scene_at_start(asked_scene(request), STAMPS, START, received)
    assert scene is not None
    assert scene.target is None
    found = scene.target_body
    assert found is not None
    np.testing.assert_allclose(found.position, body.position + 4.0 * np.array([0.02, -0.01, 0.03]))
    places = body.places(np.array([one.center for one in body.obstacles]), np.array([4.0]))[0]
    attached = {f"{sphere.id}": sphere for sphere in scene.obstacles}
    assert len(attached) == len(body.obstacles) > 0
    for one, place in zip(body.obstacles, places, strict=True):
        np.testing.assert_allclose(attached[one.id].center, place, atol=1e-9)
    assert scene.capture_time == 7.5


def test_the_capture_is_when_the_answer_says_and_else_when_was_asked_for(
    lemur_capture: PlanningProblem,
) -> None:
    request = request_message(lemur_capture, "inertial")
    received = Received({SEEN: SPHERES}, {})
    for told, captured in ((7.5, 7.5), (0.0, lemur_capture.duration)):
        scene = scene_at_start(asked_scene(request), Stamps(SEEN, 0, told), START, received)
        assert scene is not None
        assert scene.capture_time == captured


def test_what_the_bag_does_not_hold_makes_no_scene(capture: PlanningProblem) -> None:
    asked = asked_scene(request_message(capture, "inertial"))
    body = body_of(capture)
    assert scene_at_start(asked, STAMPS, START, NOTHING) is None
    assert scene_at_start(asked, STAMPS, START, Received({SEEN: ()}, {SEEN: body})) is None
    assert (
        scene_at_start(asked, STAMPS, START, Received({BODY_SEEN: ()}, {BODY_SEEN: body})) is None
    )
    alone = scene_at_start(None, STAMPS, START, Received({SEEN: SPHERES}, {}))
    assert alone is not None
    assert (len(alone.obstacles), alone.target, alone.target_body) == (2, None, None)


def test_a_body_whose_spheres_have_names_of_obstacles_makes_no_scene(
    capture: PlanningProblem,
) -> None:
    asked, body = asked_scene(request_message(capture, "inertial")), body_of(capture)
    namesake = (Sphere(body.obstacles[0].id, np.full(3, 9.0), 0.1),)
    received = Received({SEEN: namesake}, {BODY_SEEN: body})
    assert scene_at_start(asked, STAMPS, START, received) is None


def test_a_request_says_where_its_target_is_how_it_moves_and_what_may_touch(
    lemur_capture: PlanningProblem,
) -> None:
    target = replace(
        lemur_capture.target,
        linear_velocity=np.array([0.01, -0.02, 0.03]),
        angular_velocity=np.array([-0.1, 0.2, 0.05]),
    )
    request = request_message(replace(lemur_capture, target=target), "inertial")
    scene = asked_scene(request).scene
    found = scene.target
    assert found is not None
    np.testing.assert_allclose(found.position, target.position)
    turn = Rotation.from_quat(found.quaternion_xyzw).inv() * Rotation.from_quat(
        target.quaternion_xyzw
    )
    assert turn.magnitude() < 1e-9
    assert found.linear_velocity.tolist() == [0.01, -0.02, 0.03]
    assert found.angular_velocity.tolist() == [-0.1, 0.2, 0.05]
    assert found.orientation is Orientation.FIXED
    assert (scene.contact_distance, scene.approach) == (CONTACT_DISTANCE, None)
    goal, corridor = request.goal, Approach(distance=0.15)
    contact = AllowedCollisions(pairs=["end_effector/handle"], distance=0.07)
    corridor.direction.z = -2.0
    goal.allowed_collisions, goal.approach = [contact], [corridor]
    more = asked_scene(request).scene
    assert (more.contact_distance, more.allowed_collisions) == (0.07, ("end_effector/handle",))
    assert more.approach is not None
    assert more.approach.direction.tolist() == [0.0, 0.0, -1.0]
    assert (more.approach.distance, more.approach.half_angle) == (0.15, HALF_ANGLE)
    corridor.half_angle = 0.4
    narrower = asked_scene(request).scene.approach
    assert narrower is not None
    assert narrower.half_angle == 0.4
    goal.twist.angular = Vector3()
    goal.orientation, goal.free_axis.z = Goal.ABOUT_AXIS, 2.0
    about = asked_scene(request).scene.target
    assert about is not None
    assert about.orientation is Orientation.ABOUT_AXIS
    assert about.free_axis_in_ee is not None
    assert about.free_axis_in_ee.tolist() == [0.0, 0.0, 1.0]
    goal.orientation, goal.free_axis.z = Goal.FREE, 0.0
    free = asked_scene(request).scene.target
    assert free is not None
    assert free.orientation is Orientation.FREE


def test_stamps_are_those_of_the_answer() -> None:
    answer = PlanAnswer(plans=[Plan(duration=7.5)])
    answer.inputs.obstacles_stamp = time_message(SEEN)
    answer.inputs.target_body_stamp = time_message(BODY_SEEN)
    assert stamps_of(answer) == STAMPS
    answer.inputs.obstacle_bodies_stamp = time_message(BODIES_SEEN)
    assert stamps_of(answer) == replace(STAMPS, bodies_ns=BODIES_SEEN)
