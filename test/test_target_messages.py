"""A target body, and spheres that move, from messages to the start of a plan, and into a bag."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from ff_planner_msgs.msg import Goal, PlanRequest, Scene, TargetBody
from heard_inputs import HeardScenes
from matplotlib.patches import Polygon
from recorded_requests import motions_in, only_request
from scipy.spatial.transform import Rotation
from test_tumbling import body_of, moved

from ff_planner_benchmark.problems import tumbling
from ff_planner_ros.analysis.drawing.capture_view import capture_figure
from ff_planner_ros.analysis.drawing.relative_motion import relative_motion
from ff_planner_ros.analysis.methods import PLANNED
from ff_planner_ros.bag.export import export_npz
from ff_planner_ros.bag.plans import read_plans
from ff_planner_ros.common.times import NANOSECONDS, nanoseconds
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import (
    DurationRange,
    Objective,
    Obstacle,
    PlanningProblem,
    with_capture_target,
)
from ff_planner_ros.planning.problem.scene import scene_of
from ff_planner_ros.planning.task.captured import CapturedBody
from ff_planner_ros.planning.task.tail import EndBehaviour
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.report.from_bag import report_of_bag
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.ros.inputs.state_input import Snapshot
from ff_planner_ros.ros.messages.from_messages import target_body_from_message
from ff_planner_ros.ros.messages.to_messages import (
    plan_message,
    request_message,
    scene_message,
    target_body_message,
    time_message,
)
from ff_planner_ros.ros.outputs.markers import SNAPSHOTS, plan_markers
from ff_planner_ros.ros.outputs.prediction import predicted_relative_pose
from ff_planner_ros.ros.requests.reading import Knowledge, ReadRequest, read_request
from ff_planner_ros.runs.offline_bag import record_answer
from ff_planner_ros.runs.replay import Verdict, replay
from ff_planner_ros.simulation.capture import captured
from ff_planner_ros.simulation.verification import verify

FRAME = "inertial"
NOW = 1_000 * NANOSECONDS
MAX_AGE, MAX_LEAD = 5.0, 0.05
SETTINGS = load_parameters().planner


@pytest.fixture(scope="module")
def problem() -> PlanningProblem:
    return tumbling.problem("tumbling", 0)


@pytest.fixture(scope="module")
def plan(problem: PlanningProblem) -> Plan:
    return perform(PlanningTask(problem, SETTINGS))


def message(problem: PlanningProblem, stamp: float = 0.0) -> TargetBody:
    """Write the body of a problem, stamped so long [s] after now."""
    return target_body_message(body_of(problem), NOW + round(stamp * NANOSECONDS), FRAME)


def asked(
    problem: PlanningProblem,
    request: PlanRequest,
    body: TargetBody | None = None,
    obstacles: Scene | None = None,
) -> ReadRequest:
    """Read a request whose plan starts two seconds from now."""
    parameters = replace(
        load_parameters(),
        planning_lead_time=2.0,
        target_max_age=MAX_AGE,
        state_future_tolerance=MAX_LEAD,
    )
    states, scenes = Mock(), HeardScenes(lambda: NOW)
    states.snapshot.return_value = Snapshot(problem.start, NOW, "chaser_state")
    scenes.hear(obstacles or scene_message((), NOW, FRAME))
    if body is not None:
        scenes.hear_body(body)
    return read_request(request, Knowledge(problem.robot, parameters, states, scenes, None, NOW))


def refused(*arguments: Any) -> InvalidInput:
    with pytest.raises(InvalidInput) as refusal:
        asked(*arguments)
    return refusal.value


def test_a_body_comes_back_out_of_its_message_to_the_last_bit(problem: PlanningProblem) -> None:
    body = body_of(problem)
    read = target_body_from_message(message(problem), FRAME)
    for name in ("position", "quaternion_xyzw", "linear_velocity", "angular_velocity", "inertia"):
        assert (getattr(read, name) == getattr(body, name)).all(), name
    for name in ("grasp_position", "grasp_quaternion_xyzw"):
        assert (getattr(read, name) == getattr(body, name)).all(), name
    assert [(one.id, *one.position, one.radius) for one in read.obstacles] == [
        (one.id, *one.position, one.radius) for one in body.obstacles
    ]


@pytest.mark.parametrize("stamp", [-4.0, -1.0, 0.0, 0.04])
@pytest.mark.parametrize("own", [False, True])
def test_nothing_acts_on_a_body_from_its_stamp_to_the_plans_start(
    problem: PlanningProblem, own: bool, stamp: float
) -> None:
    request, sent = request_message(problem, FRAME), message(problem, stamp)
    sent.source = "camera"
    if own:
        request.target_body = [sent]
    found = asked(problem, request, None if own else sent)
    (center,), (attitude,), (rate,) = moved(body_of(problem), np.array([2.0 - stamp]))
    body = body_of(found.task.problem)
    assert body.position == pytest.approx(center, abs=1e-9)
    assert (Rotation.from_quat(body.quaternion_xyzw.copy()) * attitude.inv()).magnitude() < 1e-9
    assert body.angular_velocity == pytest.approx(rate, abs=1e-10)
    assert found.inputs.target_body_source == "camera"
    assert nanoseconds(found.inputs.target_body_stamp) == NOW + round(stamp * NANOSECONDS)
    # The goal is where its grasp will be.
    (center,), (attitude,), _ = moved(body_of(problem), np.array([2.0 - stamp + problem.duration]))
    grasp = center + attitude.apply(body.grasp_position.copy())
    assert found.task.problem.target.position == pytest.approx(grasp, abs=1e-8)
    assert [one.id for one in found.task.problem.obstacles] == [one.id for one in body.obstacles]


def test_a_body_that_is_brought_without_a_stamp_was_seen_now(problem: PlanningProblem) -> None:
    request = request_message(problem, FRAME)
    digests = set()
    for time in (time_message(0), time_message(NOW)):
        request.target_body = [message(problem)]
        request.target_body[0].header.stamp = time
        found = asked(problem, request)
        assert nanoseconds(found.inputs.target_body_stamp) == NOW
        digests.add(found.task.digest)
    assert len(digests) == 1


def test_there_and_back_a_body_is_where_it_was(problem: PlanningProblem) -> None:
    body = body_of(problem)
    again = body.after(7.0).after(-7.0)
    assert again.position == pytest.approx(body.position, abs=1e-12)
    turn = Rotation.from_quat(again.quaternion_xyzw.copy())
    assert (turn * Rotation.from_quat(body.quaternion_xyzw.copy()).inv()).magnitude() < 1e-11
    assert again.angular_velocity == pytest.approx(body.angular_velocity, abs=1e-12)
    assert body.after(0.0) is body


def _set(path: str, value: Any) -> Callable[[TargetBody], None]:
    def change(body: TargetBody) -> None:
        *parts, last = path.split(".")
        there: Any = body
        for part in parts:
            there = there[int(part)] if part.isdigit() else getattr(there, part)
        setattr(there, last, value)

    return change


def _inertia(xx: float, yy: float, zz: float, xy: float = 0.0) -> Callable[[TargetBody], None]:
    def change(body: TargetBody) -> None:
        inertia = body.inertia
        inertia.ixx, inertia.iyy, inertia.izz, inertia.ixy = xx, yy, zz, xy
        inertia.ixz = inertia.iyz = 0.0

    return change


def _grasp_in_a_sphere(body: TargetBody) -> None:
    body.obstacles[1].center, body.obstacles[1].radius = body.grasp.position, 0.01


def _same_names(body: TargetBody) -> None:
    body.obstacles[1].id = body.obstacles[0].id


@pytest.mark.parametrize(
    ("change", "status", "field"),
    [
        (_set("header.frame_id", "map"), Status.WRONG_FRAME, "header.frame_id"),
        (_set("header.frame_id", ""), Status.WRONG_FRAME, "header.frame_id"),
        (_set("header.stamp.nanosec", 2**31), Status.OUT_OF_RANGE, "header.stamp.nanosec"),
        (_inertia(0.0, 0.0, 0.0), Status.OUT_OF_RANGE, "inertia"),
        (_inertia(1.0, 1.0, 2.1), Status.OUT_OF_RANGE, "inertia"),
        (_inertia(1.0, 1.0, -1.0), Status.OUT_OF_RANGE, "inertia"),
        (_inertia(1.0, 1.0, 1.0, 1.5), Status.OUT_OF_RANGE, "inertia"),
        (_inertia(math.nan, 1.0, 1.0), Status.NOT_FINITE, "inertia"),
        (_set("inertia.com.x", 0.1), Status.UNSUPPORTED, "inertia.com"),
        (_set("pose.orientation.w", 3.0), Status.BAD_QUATERNION, "pose.orientation"),
        (_set("grasp.orientation.w", 3.0), Status.BAD_QUATERNION, "grasp.orientation"),
        (_set("pose.position.y", math.inf), Status.NOT_FINITE, "pose.position"),
        (_set("twist.linear.y", math.nan), Status.NOT_FINITE, "twist.linear"),
        (_set("twist.angular.z", math.nan), Status.NOT_FINITE, "twist.angular"),
        (_set("twist.angular.z", 1e4), Status.OUT_OF_RANGE, "twist.angular"),
        (_set("grasp.position.z", math.nan), Status.NOT_FINITE, "grasp.position"),
        (_grasp_in_a_sphere, Status.OUT_OF_RANGE, "grasp.position"),
        (_same_names, Status.OUT_OF_RANGE, "obstacles"),
        (_set("obstacles.2.radius", 0.0), Status.OUT_OF_RANGE, "obstacles[2].radius"),
        (_set("obstacles.2.center.x", math.nan), Status.NOT_FINITE, "obstacles[2].center"),
        (_set("obstacles.2.twist.linear.x", 0.1), Status.UNSUPPORTED, "obstacles[2].twist.linear"),
        (
            _set("obstacles.0.twist.angular.y", -0.1),
            Status.UNSUPPORTED,
            "obstacles[0].twist.angular",
        ),
    ],
)
@pytest.mark.parametrize("own", [False, True])
def test_what_is_no_body_is_refused_by_its_field(
    problem: PlanningProblem,
    own: bool,
    change: Callable[[TargetBody], None],
    status: Status,
    field: str,
) -> None:
    request, sent = request_message(problem, FRAME), message(problem)
    change(sent)
    if own:
        request.target_body = [sent]
    refusal = refused(problem, request, None if own else sent)
    assert (refusal.status, refusal.field) == (status, f"target_body.{field}"), refusal


@pytest.mark.parametrize(
    ("stamp", "status"),
    [
        (-1.01 * MAX_AGE, Status.TARGET_TOO_OLD),
        (-NOW / NANOSECONDS, Status.TARGET_TOO_OLD),  # none at all
        (2.0 * MAX_LEAD, Status.TARGET_IN_FUTURE),
    ],
)
def test_a_stale_or_future_body_is_refused(
    problem: PlanningProblem, stamp: float, status: Status
) -> None:
    refusal = refused(problem, request_message(problem, FRAME), message(problem, stamp))
    assert (refusal.status, refusal.field) == (status, "target_body.header.stamp")


def test_without_any_body_there_is_nothing_to_capture(problem: PlanningProblem) -> None:
    refusal = refused(problem, request_message(problem, FRAME))
    assert (refusal.status, refusal.field) == (Status.NO_TARGET_BODY, "target_body")


def test_a_body_is_not_looked_at_where_nothing_is_captured(problem: PlanningProblem) -> None:
    request, spoilt = request_message(problem, FRAME), message(problem)
    request.goal.kind, spoilt.inertia.ixx = Goal.POSE, -1.0
    found = asked(problem, request, spoilt)
    assert found.task.problem.target_body is None
    assert nanoseconds(found.inputs.target_body_stamp) == 0
    assert (found.task.problem.target.position == problem.target.position).all()


def test_a_capture_fixes_the_orientation(problem: PlanningProblem) -> None:
    request = request_message(problem, FRAME)
    request.goal.orientation = Goal.FREE
    refusal = refused(problem, request, message(problem))
    assert (refusal.status, refusal.field) == (Status.UNSUPPORTED, "goal.orientation")


def test_an_obstacle_and_an_attached_sphere_have_different_names(problem: PlanningProblem) -> None:
    rock = Obstacle.sphere(body_of(problem).obstacles[1].id, np.array([50.0, 0.0, 0.0]), 0.1)
    scene = scene_message((rock,), NOW, FRAME)
    refusal = refused(problem, request_message(problem, FRAME), message(problem), scene)
    assert refusal.field == "target_body.obstacles[1].id"


# One of them, which moves.
ROCKS = (Obstacle.sphere("rock", np.array([9.0, -1.0, 2.0]), 0.3, np.array([-0.1, 0.02, 0.0])),)


def moving(stamp_ns: int) -> Scene:
    return scene_message(ROCKS, stamp_ns, FRAME)


@pytest.mark.parametrize("stamp", [NOW - 6 * NANOSECONDS, NOW - 900 * NANOSECONDS])
def test_spheres_that_move_are_refused_where_they_are_old(
    lemur_capture: PlanningProblem, stamp: int
) -> None:
    refusal = refused(lemur_capture, request_message(lemur_capture, FRAME), None, moving(stamp))
    assert (refusal.status, refusal.field) == (Status.STATE_TOO_OLD, "obstacles.header.stamp")
    assert "obstacles_max_age" in refusal.allowed


@pytest.mark.parametrize("age", [0.0, 1.5, 4.9])
def test_a_sphere_that_moves_goes_on_from_its_stamp_to_the_plans_start(
    lemur_capture: PlanningProblem, age: float
) -> None:
    scene = moving(NOW - round(age * NANOSECONDS))
    found = asked(lemur_capture, request_message(lemur_capture, FRAME), None, scene)
    (rock,) = found.task.problem.obstacles
    way = (age + 2.0) * np.array([-0.1, 0.02, 0.0])
    assert rock.center == pytest.approx(np.array([9.0, -1.0, 2.0]) + way, abs=1e-12)
    assert rock.motion.velocity.tolist() == [-0.1, 0.02, 0.0]


def test_spheres_that_move_need_a_time_but_those_of_a_request_may_be_of_now(
    lemur_capture: PlanningProblem,
) -> None:
    request = request_message(lemur_capture, FRAME)
    refusal = refused(lemur_capture, request, None, moving(0))
    assert refusal.field == "obstacles.header.stamp"
    ahead = moving(NOW + NANOSECONDS)
    assert refused(lemur_capture, request, None, ahead).status is Status.STATE_IN_FUTURE
    request.scene = [scene_message(ROCKS, 0, FRAME)]
    found = asked(lemur_capture, request)
    assert nanoseconds(found.inputs.obstacles_stamp) == NOW
    assert found.task.problem.obstacles[0].center[0] == pytest.approx(9.0 - 0.2, abs=1e-12)


def test_a_sphere_that_turns_is_refused_for_nobody_knows_about_what(
    lemur_capture: PlanningProblem,
) -> None:
    scene = moving(NOW)
    scene.spheres[0].twist.angular.y = 0.1
    refusal = refused(lemur_capture, request_message(lemur_capture, FRAME), None, scene)
    assert refusal.status is Status.UNSUPPORTED
    assert refusal.field == "obstacles.spheres[0].twist.angular"


def test_the_answer_has_the_bodys_predicted_poses_and_twists(
    problem: PlanningProblem, plan: Plan
) -> None:
    written = plan_message(plan, NOW, FRAME, CapturedBody(body_of(problem)))
    centers, attitudes, rates = moved(body_of(problem), plan.trajectory.time)
    poses = written.target_path.poses
    assert [pose.header for pose in poses] == [pose.header for pose in written.chaser_path.poses]
    for pose, center, attitude in zip(poses, centers, attitudes, strict=True):
        there = pose.pose.position
        assert [there.x, there.y, there.z] == pytest.approx(center, abs=1e-9)
        turn = pose.pose.orientation
        found = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w])
        assert (found * attitude.inv()).magnitude() < 1e-9
    for twist, rate in zip(written.target_twists, rates, strict=True):
        angular = twist.angular
        assert [angular.x, angular.y, angular.z] == pytest.approx(rate, abs=1e-9)


def test_the_predicted_relative_pose_is_zero_at_the_capture(
    problem: PlanningProblem, plan: Plan
) -> None:
    body, motion = body_of(problem), plan.trajectory
    captured = CapturedBody(body)
    end_ns = NOW + int(float(motion.time[-1]) * NANOSECONDS)
    found = predicted_relative_pose(motion, NOW, end_ns, captured)
    assert found is not None
    assert found.header.frame_id == "target_grasp"
    place, turn = found.pose.position, found.pose.orientation
    assert [place.x, place.y, place.z] == pytest.approx([0.0] * 3, abs=1e-5)
    assert abs(turn.w) == pytest.approx(1.0, abs=1e-9)
    # At a point before: in axes of the grasp, which turn with the body.
    found = predicted_relative_pose(
        motion, NOW, NOW + round(float(motion.time[7]) * NANOSECONDS), captured
    )
    assert found is not None
    (center,), (attitude,), _ = moved(body, motion.time[7:8])
    grasp = attitude * Rotation.from_quat(body.grasp_quaternion_xyzw.copy())
    way = motion.ee_positions[7] - center - attitude.apply(body.grasp_position.copy())
    place = found.pose.position
    assert [place.x, place.y, place.z] == pytest.approx(grasp.inv().apply(way), abs=1e-8)
    assert predicted_relative_pose(motion, NOW, NOW - 1, captured) is None


def test_what_is_drawn_of_the_relative_motion_ends_at_the_grasp_and_at_rest(
    problem: PlanningProblem, plan: Plan
) -> None:
    body, motion = body_of(problem), plan.trajectory
    place, velocity = (quantity.of(motion) for quantity in relative_motion(body))
    assert np.abs(place[-1]).max() < 1e-5
    assert np.abs(velocity[-1]).max() < 1e-5
    centers, attitudes, _ = moved(body, motion.time)
    grasps = attitudes * Rotation.from_quat(body.grasp_quaternion_xyzw.copy())
    levers = attitudes.apply(np.tile(body.grasp_position, (len(centers), 1)))
    expected = grasps.inv().apply(motion.ee_positions - centers - levers)
    assert place == pytest.approx(expected, abs=1e-8)
    # Its change is the velocity: a quantity of the axes that turn with the body.
    change = np.gradient(place, motion.time, axis=0, edge_order=2)
    assert np.abs(change - velocity)[2:-2].max() < 0.02 * np.abs(velocity).max()


def test_the_capture_is_drawn_where_an_independent_engine_moves_the_body(
    problem: PlanningProblem, plan: Plan
) -> None:
    body, motion = body_of(problem), plan.trajectory
    figure = capture_figure(problem, body, {PLANNED: motion})
    inertial, rides, distance, speed = figure.axes
    centers, attitudes, _ = moved(body, motion.time)
    grasps = centers + attitudes.apply(np.tile(body.grasp_position, (len(centers), 1)))
    in_body = attitudes.inv().apply(motion.ee_positions - centers)
    for axes, tips, grasp in (
        (inertial, motion.ee_positions, grasps[-1]),
        (rides, in_body, body.grasp_position),
    ):
        plane = ["xyz".index(words[0]) for words in (axes.get_xlabel(), axes.get_ylabel())]
        (way,) = (line for line in axes.lines if line.get_label() == "end effector, planned")
        assert np.asarray(way.get_xydata()) == pytest.approx(tips[:, plane], abs=1e-6)
        (mark,) = (line for line in axes.lines if line.get_label() == "grasp")
        assert np.asarray(mark.get_xydata())[0] == pytest.approx(grasp[plane], abs=1e-6)
        outlines = [one for one in axes.patches if isinstance(one, Polygon) and one.get_fill()]
        for outline, part in zip(outlines, body.obstacles, strict=True):
            at = (
                centers[-1] + attitudes[-1].apply(part.position.copy())
                if axes is inertial
                else part.position
            )
            corners = outline.get_xy()
            middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
            assert middle == pytest.approx(at[plane], abs=1e-6)
            away = np.linalg.norm(corners - at[plane], axis=1)
            assert away.max() == pytest.approx(part.radius, abs=2e-6)
            assert away.min() > 0.98 * part.radius
    drawn = np.asarray(distance.lines[0].get_ydata())
    assert drawn == pytest.approx(np.linalg.norm(motion.ee_positions - grasps, axis=1), abs=1e-6)
    assert np.asarray(speed.lines[0].get_ydata())[-1] < 1e-5


def test_the_executive_tells_how_the_measured_arm_is_to_the_measured_grasp(
    problem: PlanningProblem, plan: Plan
) -> None:
    motion = plan.trajectory
    end = SystemState(
        motion.chaser_positions[-1],
        motion.chaser_quaternions_xyzw[-1],
        motion.chaser_linear_velocities[-1],
        motion.chaser_angular_velocities[-1],
        motion.joint_positions[-1],
        motion.joint_velocities[-1],
    )
    there = body_of(problem).after(problem.duration)
    found = captured(problem.robot, end, there)
    assert max(found.position_error, found.linear_speed, found.angular_speed) < 1e-5
    aside = replace(
        there,
        position=there.position + np.array([3e-3, 0.0, -4e-3]),
        linear_velocity=there.linear_velocity + np.array([0.0, 7e-3, 0.0]),
    )
    found = captured(problem.robot, end, aside)
    assert found.position_error == pytest.approx(5e-3, abs=1e-5)
    # The body's point where the end effector is moves a little otherwise than its grasp does.
    assert found.linear_speed == pytest.approx(7e-3, abs=1e-3)
    assert found.orientation_error < 1e-5


def test_markers_show_the_body_where_it_is_when_the_arm_is_shown(
    problem: PlanningProblem, plan: Plan
) -> None:
    body = body_of(problem)
    drawn = plan_markers(problem.robot, plan, scene_of(problem), FRAME).markers
    found = [marker for marker in drawn if marker.ns == "target_body"]
    assert len(found) == SNAPSHOTS * len(body.obstacles)
    assert not [marker for marker in drawn if marker.ns == "obstacles"]
    (center,), (attitude,), _ = moved(body, plan.trajectory.time[-1:])
    last, sphere = found[-1], body.obstacles[-1]
    place = last.pose.position
    expected = center + attitude.apply(sphere.position.copy())
    assert [place.x, place.y, place.z] == pytest.approx(expected, abs=1e-8)
    assert last.scale.x == pytest.approx(2 * sphere.radius)


@pytest.mark.parametrize("ahead", [0.0, 2.5])
def test_an_offline_bag_of_a_capture_is_the_same_task_again(
    problem: PlanningProblem, ahead: float, tmp_path: Path
) -> None:
    rock = Obstacle.sphere("rock", np.array([30.0, 0.0, 0.0]), 0.2, np.array([0.1, 0.0, 0.0]))
    asked_for = replace(problem, obstacles=(rock, *problem.obstacles))
    task = PlanningTask(asked_for, SETTINGS, ahead=ahead)
    record_answer(tmp_path / "bag", task, perform(task), 0.5)
    recorded = only_request(tmp_path / "bag")
    assert recorded.planned_task().digest == task.digest
    begins, asked_ns = (
        nanoseconds(one)
        for one in (
            recorded.answer.plans[0].joint_trajectory.header.stamp,
            recorded.answer.inputs.received_stamp,
        )
    )
    assert begins - asked_ns == round(ahead * NANOSECONDS)
    # What `verify` makes of the bag is what was planned.
    ((_, _, robot, motion, scene, *_),) = motions_in(tmp_path / "bag")
    assert scene is not None
    assert scene.target_body is not None
    assert (scene.target_body.position == body_of(problem).position).all()
    assert [one.id for one in scene.obstacles] == [one.id for one in asked_for.obstacles]
    assert (scene.obstacles[0].center == rock.center).all()
    assert verify(robot, motion, scene).passed
    # And so is what a report draws.
    (reported,) = report_of_bag(tmp_path / "bag", 1).requests
    drawn = reported.plan
    assert drawn is not None
    assert drawn.obstacles is not None
    assert [one.id for one in drawn.obstacles] == [one.id for one in asked_for.obstacles]
    assert drawn.obstacles[-1].moves
    assert drawn.goal.position == pytest.approx(problem.target.position, abs=1e-12)
    if not ahead:
        assert replay(recorded).verdict is Verdict.IDENTICAL


@pytest.fixture(scope="module")
def free(problem: PlanningProblem) -> PlanningTask:
    """A capture whose moment is the planner's choice, with a tail behind it."""
    shortest, longest = 0.9 * problem.duration, 1.2 * problem.duration
    asked_for = replace(
        with_capture_target(body_of(problem), replace(problem, duration=longest)),
        duration_range=DurationRange(shortest, longest),
        objective=Objective(1.0, 0.0, 0.02),
    )
    settings = replace(SETTINGS, starts=1)
    return PlanningTask(asked_for, settings, end_behaviour=EndBehaviour.HOLD_END_EFFECTOR, tail=1.0)


@pytest.mark.ci
def test_a_bag_tells_when_a_capture_is_whose_moment_the_planner_chose(
    free: PlanningTask, tmp_path: Path
) -> None:
    made = perform(free)
    assert made.duration is not None
    assert made.trajectory.time[-1] > made.duration + 0.9
    record_answer(tmp_path / "bag", free, made, 0.5)
    recorded = only_request(tmp_path / "bag")
    assert recorded.planned_task().digest == free.digest
    assert replay(recorded).verdict is Verdict.IDENTICAL
    assert recorded.answer is not None
    assert recorded.answer.plans[0].duration == made.duration

    body = body_of(free.problem)
    (center,), (attitude,), _ = moved(body, np.array([made.duration]))
    place = center + attitude.apply(body.grasp_position.copy())
    ((*_, scene, _, _, _),) = motions_in(tmp_path / "bag")
    assert scene is not None
    assert scene.capture_time == made.duration
    (reported,) = report_of_bag(tmp_path / "bag", 1).requests
    assert reported.weights == (1.0, 0.0, 0.02, 0.0)
    window = free.problem.durations
    assert window.minimum < made.duration < window.maximum
    assert (reported.duration, reported.durations) == (
        made.duration,
        (window.minimum, window.maximum),
    )
    assert reported.plan is not None
    assert reported.plan.goal.position == pytest.approx(place, abs=1e-9)

    (plan,) = read_plans(tmp_path / "bag")
    row, columns = plan.row(), plan.columns()
    assert row["goal"] == "capture"
    assert [row[name] for name in ("duration_s", "duration_max_s", "planned_duration_s")] == [
        *(window.minimum, window.maximum, made.duration)
    ]
    assert row["weight_duration_rad_per_s"] == 0.02
    centers, attitudes, rates = moved(body, made.trajectory.time)
    for number, axis in enumerate("xyz"):
        told = columns[f"target_body_{axis}_m"], columns[f"target_body_velocity_{axis}_m_per_s"]
        assert told[0] == pytest.approx(centers[:, number], abs=1e-8)
        assert told[1] == pytest.approx(np.full(len(centers), body.linear_velocity[number]))
        turning = columns[f"target_body_angular_velocity_{axis}_rad_per_s"]
        assert turning == pytest.approx(rates[:, number], abs=1e-8)
    turns = np.column_stack([columns[f"target_body_q{axis}"] for axis in "xyzw"])
    assert (Rotation.from_quat(turns) * attitudes.inv()).magnitude().max() < 1e-8
    export_npz(tmp_path / "bag", tmp_path / "plans.npz")
    with np.load(tmp_path / "plans.npz") as arrays:
        assert (arrays["bag/target_body/quaternions_xyzw"] == turns).all()


def test_a_range_of_a_target_that_moves_with_the_frame_is_refused_and_not_recorded_without_that(
    problem: PlanningProblem, plan: Plan, tmp_path: Path
) -> None:
    window = DurationRange(1.0, 2.0 * problem.duration, np.array([0.0, 1.0, 0.0]))
    task = PlanningTask(replace(problem, duration_range=window), SETTINGS)
    with pytest.raises(InvalidInput, match="target_velocity"):
        record_answer(tmp_path / "bag", task, plan, 0.5)


def test_the_end_of_the_longest_duration_is_before_2038(problem: PlanningProblem) -> None:
    request = request_message(problem, FRAME)
    request.goal.kind, request.duration_max = Goal.POSE, 2.0**31
    refusal = refused(problem, request)
    assert (refusal.status, refusal.field) == (Status.OUT_OF_RANGE, "duration_max")
