"""Messages to planning objects and back."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Duration
from ff_planner_msgs.msg import ChaserState, ObstacleSphereArray, PlanMetrics, PlanStatus
from ff_planner_msgs.msg import SolverReport as SolverReportMsg
from ff_planner_msgs.srv import PlanTrajectory
from scipy.spatial.transform import Rotation

from ff_planner_ros.bag.decoding import nanoseconds
from ff_planner_ros.errors import InvalidInput, NoPlanFound, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.metrics import Metrics
from ff_planner_ros.planning.plan import Plan, SolverReport, Trajectory
from ff_planner_ros.planning.problem import (
    DurationRange,
    Objective,
    Orientation,
    Parametrisation,
    PlanningProblem,
)
from ff_planner_ros.ros.messages.from_messages import (
    plan_from_response,
    problem_from_request,
    spheres_from_message,
    state_from_message,
)
from ff_planner_ros.ros.messages.to_messages import (
    obstacles_message,
    request_message,
    response_from_error,
    response_from_plan,
    state_message,
    time_message,
)

FRAME = "inertial"
STAMP_NS = 1_700_000_000_123_456_789
DURATION, POINTS, JOINTS = 10.0, 7, 3


@pytest.fixture(scope="module")
def plan() -> Plan:
    """A plan of random numbers, every one of them different."""
    random = np.random.default_rng(7)
    values: Any = {"int": 13, "float": 0.25, "str": "converged"}

    def rows(columns: int) -> Any:
        return random.normal(size=(POINTS, columns))

    def quaternions() -> Any:
        return Rotation.random(POINTS, rng=random).as_quat()

    return Plan(
        joint_names=("shoulder", "elbow", "wrist"),
        trajectory=Trajectory(
            time=np.linspace(0.0, DURATION, POINTS),
            joint_positions=rows(JOINTS),
            joint_velocities=rows(JOINTS),
            joint_accelerations=rows(JOINTS),
            joint_torques=rows(JOINTS),
            chaser_positions=rows(3),
            chaser_quaternions_xyzw=quaternions(),
            chaser_linear_velocities=rows(3),
            chaser_angular_velocities=rows(3),
            ee_positions=rows(3),
            ee_quaternions_xyzw=quaternions(),
            ee_linear_velocities=rows(3),
            ee_angular_velocities=rows(3),
        ),
        xi=random.normal(size=18),
        orientation_reading="along_turn",
        metrics=Metrics(
            **{item.name: float(random.normal()) for item in fields(Metrics)}
            | {"peak_joint_torques": tuple(random.normal(size=JOINTS).tolist())}
        ),
        solver=SolverReport(**{item.name: values[item.type] for item in fields(SolverReport)}),
    )


@pytest.fixture
def response(plan: Plan) -> PlanTrajectory.Response:
    return response_from_plan(plan, "run.1", STAMP_NS, FRAME, 0.5)


def test_the_messages_have_the_fields_of_the_planning_objects() -> None:
    # rosidl's constructors ignore a field that the message does not have.
    assert set(PlanMetrics.get_fields_and_field_types()) == {item.name for item in fields(Metrics)}
    assert set(SolverReportMsg.get_fields_and_field_types()) == {"solve_time"} | {
        item.name for item in fields(SolverReport)
    }
    codes = {name for name in vars(type(PlanStatus)) if name.isupper() and name[0] != "_"}
    assert {name: getattr(PlanStatus, name) for name in codes} == {
        status.name: status.value for status in Status
    }


def test_an_answer_holds_the_plan_row_by_row(plan: Plan, response: PlanTrajectory.Response) -> None:
    motion, trajectory = plan.trajectory, response.joint_trajectory
    assert response.status.code == PlanStatus.SOLVED
    assert response.plan_id == "run.1"
    assert trajectory.joint_names == ["shoulder", "elbow", "wrist"]
    assert trajectory.header.frame_id == FRAME
    for row, point in enumerate(trajectory.points):
        assert point.positions.tolist() == motion.joint_positions[row].tolist()
        assert point.velocities.tolist() == motion.joint_velocities[row].tolist()
        assert point.accelerations.tolist() == motion.joint_accelerations[row].tolist()
        assert point.effort.tolist() == motion.joint_torques[row].tolist()
        assert nanoseconds(point.time_from_start) == round(row * 1e9 * DURATION / (POINTS - 1))
    for path, positions, quaternions in (
        (response.predicted_chaser_path, motion.chaser_positions, motion.chaser_quaternions_xyzw),
        (response.end_effector_path, motion.ee_positions, motion.ee_quaternions_xyzw),
    ):
        assert path.header.frame_id == FRAME
        assert nanoseconds(path.header.stamp) == STAMP_NS
        for row, item in enumerate(path.poses):
            point = trajectory.points[row]
            assert nanoseconds(item.header.stamp) == STAMP_NS + nanoseconds(point.time_from_start)
            assert item.header.frame_id == FRAME
            p, q = item.pose.position, item.pose.orientation
            assert [p.x, p.y, p.z] == positions[row].tolist()
            assert [q.x, q.y, q.z, q.w] == quaternions[row].tolist()
    for twists, linear, angular in (
        (
            response.predicted_chaser_twists,
            motion.chaser_linear_velocities,
            motion.chaser_angular_velocities,
        ),
        (response.end_effector_twists, motion.ee_linear_velocities, motion.ee_angular_velocities),
    ):
        for row, twist in enumerate(twists):
            assert [twist.linear.x, twist.linear.y, twist.linear.z] == linear[row].tolist()
            assert [twist.angular.x, twist.angular.y, twist.angular.z] == angular[row].tolist()
    assert response.xi.tolist() == plan.xi.tolist()
    for item in fields(Metrics):
        expected = getattr(plan.metrics, item.name)
        assert np.array_equal(getattr(response.metrics, item.name), expected), item.name
    assert response.solver.solve_time == 0.5
    for item in fields(SolverReport):
        assert getattr(response.solver, item.name) == getattr(plan.solver, item.name)


def test_a_plan_comes_back_out_of_its_answer(plan: Plan, response: PlanTrajectory.Response) -> None:
    back = plan_from_response(response)
    assert back.joint_names == plan.joint_names
    assert back.xi.tolist() == plan.xi.tolist()
    assert back.orientation_reading == plan.orientation_reading
    assert back.metrics == plan.metrics
    assert back.solver == plan.solver
    np.testing.assert_allclose(back.trajectory.time, plan.trajectory.time, atol=1e-9)
    for item in fields(Trajectory):
        if item.name != "time":
            expected = getattr(plan.trajectory, item.name)
            np.testing.assert_array_equal(getattr(back.trajectory, item.name), expected)


@pytest.mark.parametrize(
    ("error", "code", "message"),
    [
        (NoPlanFound(Status.COLLISION, "c1 is in the way"), 301, "c1 is in the way"),
        (
            InvalidInput(Status.OUT_OF_RANGE, "duration", -1.0, "it must be greater than 0"),
            205,
            "duration is -1.0: it must be greater than 0",
        ),
    ],
)
def test_an_error_becomes_code_and_message_and_nothing_else(
    error: InvalidInput | NoPlanFound, code: int, message: str
) -> None:
    assert response_from_error(error, "run.2", 0.5) == PlanTrajectory.Response(
        status=PlanStatus(code=code, message=message), plan_id="run.2"
    )


def test_the_best_attempt_tells_its_metrics_and_not_its_motion(plan: Plan) -> None:
    response = response_from_error(NoPlanFound(Status.COLLISION, "blocked", plan), "run.3", 0.5)
    for item in fields(Metrics):
        expected = getattr(plan.metrics, item.name)
        assert np.array_equal(getattr(response.metrics, item.name), expected), item.name
    assert response.solver.solve_time == 0.5
    for item in fields(SolverReport):
        assert getattr(response.solver, item.name) == getattr(plan.solver, item.name)
    assert response == PlanTrajectory.Response(
        status=PlanStatus(code=PlanStatus.COLLISION, message="blocked"),
        plan_id="run.3",
        metrics=response.metrics,
        solver=response.solver,
    )


def test_state_obstacles_and_request_come_back_out_of_their_messages(
    lemur_capture: PlanningProblem,
) -> None:
    problem, robot = lemur_capture, lemur_capture.robot
    message = state_message(problem.start, robot.joint_names, STAMP_NS, FRAME)
    state = state_from_message(message, "chaser_state", robot, FRAME)
    for item in fields(state):
        expected = getattr(problem.start, item.name)
        np.testing.assert_array_equal(getattr(state, item.name), expected)
    spheres = spheres_from_message(obstacles_message(problem.obstacles, STAMP_NS, FRAME), FRAME)
    assert [(s.id, s.center.tolist(), s.radius) for s in spheres] == [
        (s.id, s.center.tolist(), s.radius) for s in problem.obstacles
    ]
    request = request_message(problem, FRAME)
    back = problem_from_request(request, robot, state, spheres, load_parameters())
    for item in fields(problem.target):
        expected = getattr(problem.target, item.name)
        found = getattr(back.target, item.name)
        if isinstance(expected, np.ndarray):
            np.testing.assert_allclose(found, expected, atol=1e-15)
        else:
            assert found == expected
    assert (back.duration, back.points) == (problem.duration, problem.points)
    assert back.objective == problem.objective
    assert back.limits.joint_velocities


def test_a_range_of_durations_and_its_weight_come_back_out_of_a_request(
    lemur_capture: PlanningProblem,
) -> None:
    window, weights = DurationRange(6.5, 15.25), Objective(0.0, 0.0, 0.3)
    asked = replace(lemur_capture, duration=15.25, duration_range=window, objective=weights)
    request = request_message(asked, FRAME)
    assert (request.duration, request.duration_max, request.weight_duration) == (6.5, 15.25, 0.3)
    back = problem_from_request(request, asked.robot, asked.start, (), load_parameters())
    assert back.duration_range is not None
    assert (back.duration_range.minimum, back.duration_range.maximum) == (6.5, 15.25)
    assert (back.duration, back.objective) == (asked.duration, asked.objective)
    given = request_message(lemur_capture, FRAME)
    assert (given.duration, given.duration_max, given.weight_duration) == (10.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"duration": 0.0}, "duration"),
        ({"duration": np.inf}, "duration"),
        ({"duration_max": 9.9}, "duration_max"),
        ({"duration_max": -1.0}, "duration_max"),
        ({"duration_max": np.inf}, "duration_max"),
        ({"duration_max": np.nan}, "duration_max"),
        ({"weight_duration": -0.1}, "weight_duration"),
        ({"weight_duration": np.nan}, "weight_duration"),
    ],
)
def test_an_impossible_range_in_a_request_is_refused_by_name(
    lemur_capture: PlanningProblem, changes: dict[str, float], field: str
) -> None:
    request = request_message(lemur_capture, FRAME)
    request.duration_max = 20.0
    for name, value in changes.items():
        setattr(request, name, value)
    with pytest.raises(InvalidInput) as refused:
        problem_from_request(
            request, lemur_capture.robot, lemur_capture.start, (), load_parameters()
        )
    assert refused.value.field == field


def test_a_response_tells_the_duration_of_the_plan_without_its_tail(plan: Plan) -> None:
    chosen = replace(plan, duration=7.25)
    response = response_from_plan(chosen, "run.1", STAMP_NS, FRAME, 0.5)
    assert response.duration == plan_from_response(response).duration == 7.25
    # And of a search that was ended, that of the best plan until then.
    ended = NoPlanFound(Status.TIMED_OUT, "too soon", chosen)
    assert response_from_error(ended, "run.2", 0.5).duration == 7.25


def test_joints_are_put_in_the_robots_order(lemur_capture: PlanningProblem) -> None:
    robot = lemur_capture.robot
    order = [3, 0, 6, 1, 5, 2, 4]
    message = state_message(lemur_capture.start, robot.joint_names, STAMP_NS, FRAME)
    message.joint_names = [robot.joint_names[i] for i in order]
    message.joint_positions = [float(i) for i in order]
    message.joint_velocities = [10.0 * i for i in order]
    message.joint_accelerations = [100.0 * i for i in order]
    state = state_from_message(message, "chaser_state", robot, FRAME)
    assert state.joint_positions.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    assert state.joint_velocities.tolist() == [0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0]
    assert state.joint_accelerations is not None
    assert state.joint_accelerations.tolist() == [0.0, 100.0, 200.0, 300.0, 400.0, 500.0, 600.0]


def test_a_part_of_a_pose_comes_back_out_of_a_request(lemur_capture: PlanningProblem) -> None:
    about = replace(
        lemur_capture.target,
        orientation=Orientation.ABOUT_AXIS,
        free_axis_in_ee=np.array([0.6, 0.0, 0.8]),
    )
    free = replace(lemur_capture.target, orientation=Orientation.FREE)
    for target in (about, free):
        asked = replace(lemur_capture, target=target, parametrisation=Parametrisation.JOINT_SPLINE)
        request = request_message(asked, FRAME)
        start, obstacles = asked.start, asked.obstacles
        back = problem_from_request(request, asked.robot, start, obstacles, load_parameters())
        assert back.target.orientation is target.orientation
        np.testing.assert_array_equal(back.target.free_axis_in_ee, target.free_axis_in_ee)
        assert back.parametrisation is Parametrisation.JOINT_SPLINE


@pytest.mark.parametrize(
    ("orientation", "axis", "message"),
    [
        ("about_axis", 0.0, r"^free_axis is missing: orientation about_axis needs the axis"),
        ("free", 1.0, r"free_axis is .*where orientation is about_axis"),
        ("sideways", 0.0, r"orientation is 'sideways': it must be fixed, free or about_axis"),
    ],
)
def test_a_part_of_a_pose_that_makes_no_sense_is_refused_by_its_field(
    lemur_capture: PlanningProblem, orientation: str, axis: float, message: str
) -> None:
    request = request_message(lemur_capture, FRAME)
    request.orientation, request.free_axis.z = orientation, axis
    with pytest.raises(InvalidInput, match=message):
        problem_from_request(
            request, lemur_capture.robot, lemur_capture.start, (), load_parameters()
        )


def test_accelerations_come_back_out_of_a_message_and_none_are_not_known(
    lemur_capture: PlanningProblem,
) -> None:
    robot = lemur_capture.robot
    for accelerations in (None, np.linspace(-0.3, 0.3, 7)):
        start = replace(lemur_capture.start, joint_accelerations=accelerations)
        message = state_message(start, robot.joint_names, STAMP_NS, FRAME)
        state = state_from_message(message, "chaser_state", robot, FRAME)
        np.testing.assert_array_equal(state.joint_accelerations, accelerations)


@pytest.mark.parametrize(
    ("accelerations", "status"),
    [([0.1] * 6, Status.WRONG_SIZE), ([0.1] * 6 + [np.nan], Status.NOT_FINITE)],
)
def test_accelerations_that_are_none_are_refused_by_name(
    lemur_capture: PlanningProblem, accelerations: list[float], status: Status
) -> None:
    robot = lemur_capture.robot
    message = state_message(lemur_capture.start, robot.joint_names, STAMP_NS, FRAME)
    message.joint_accelerations = accelerations
    with pytest.raises(InvalidInput) as refusal:
        state_from_message(message, "start_state", robot, FRAME)
    assert refusal.value.status is status
    assert refusal.value.field == "start_state.joint_accelerations"


def test_a_target_twist_is_kept(lemur_capture: PlanningProblem) -> None:
    request = request_message(lemur_capture, FRAME)
    request.target_twist.linear.x, request.target_twist.angular.z = 0.01, -0.02
    problem = _problem(lemur_capture, request)
    assert problem.target.linear_velocity.tolist() == [0.01, 0.0, 0.0]
    assert problem.target.angular_velocity.tolist() == [0.0, 0.0, -0.02]


def test_points_of_zero_are_those_of_the_parameter(lemur_capture: PlanningProblem) -> None:
    request = request_message(lemur_capture, FRAME)
    request.points = 0
    assert _problem(lemur_capture, request).points == 9


def test_an_empty_message_is_refused_by_its_frame(lemur_capture: PlanningProblem) -> None:
    for refuse in (
        lambda: state_from_message(ChaserState(), "chaser_state", lemur_capture.robot, FRAME),
        lambda: spheres_from_message(ObstacleSphereArray(), FRAME),
        lambda: _problem(lemur_capture, PlanTrajectory.Request()),
    ):
        with pytest.raises(InvalidInput) as refusal:
            refuse()
        assert refusal.value.status is Status.WRONG_FRAME
        assert refusal.value.field.endswith("header.frame_id")


@pytest.mark.parametrize("time_ns", [0, 1, 999_999_999, 1_000_000_000, STAMP_NS])
def test_a_time_comes_back_out_of_its_message(time_ns: int) -> None:
    assert nanoseconds(time_message(time_ns)) == time_ns
    assert nanoseconds(Duration(sec=3, nanosec=7)) == 3_000_000_007


def _problem(problem: PlanningProblem, request: PlanTrajectory.Request) -> PlanningProblem:
    parameters = replace(load_parameters(), points=9)
    return problem_from_request(request, problem.robot, problem.start, (), parameters)
