"""Messages to planning objects and back."""

from __future__ import annotations

import pickle
import re
from collections.abc import Iterator
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Duration
from ff_planner_msgs.msg import (
    AllowedCollisions,
    ChaserState,
    Goal,
    PlanAnswer,
    PlanMetrics,
    PlanRequest,
    PlanStatus,
    Scene,
)
from ff_planner_msgs.msg import SolverReport as SolverReportMsg
from pages import DOCS
from robots import CONFIG
from scipy.spatial.transform import Rotation

from ff_planner_benchmark.problems import tumbling
from ff_planner_ros.common.declared_messages import value_at
from ff_planner_ros.common.times import nanoseconds
from ff_planner_ros.errors import (
    REMEDIES,
    Failure,
    FfPlannerError,
    InvalidInput,
    NoPlanFound,
    Retry,
    Status,
)
from ff_planner_ros.messages.plans import plan_from_answer
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.metrics import Metrics
from ff_planner_ros.planning.motion.plan import Plan, SolverReport, Trajectory
from ff_planner_ros.planning.problem.goal_words import GoalKind
from ff_planner_ros.planning.problem.problem import (
    DurationRange,
    Objective,
    Obstacle,
    Orientation,
    Parametrisation,
    PlanningProblem,
    with_capture_target,
)
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.ros.messages.answers import answer_of, status_message
from ff_planner_ros.ros.messages.from_messages import (
    problem_from_request,
    scene_from_message,
    state_from_message,
)
from ff_planner_ros.ros.messages.to_messages import (
    request_message,
    scene_message,
    state_message,
    time_message,
)

FRAME = "inertial"
STAMP_NS = 1_700_000_000_123_456_789
DURATION, POINTS, JOINTS = 10.0, 7, 3
PLACE = "goal.pose.pose.position"


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
            | dict.fromkeys(("peak_wheel_momenta", "peak_wheel_torques"), (0.3, 0.2, 0.1))
        ),
        solver=SolverReport(**{item.name: values[item.type] for item in fields(SolverReport)}),
    )


def answered(plan: Plan) -> PlanAnswer:
    return answer_of(plan, "run.1", 0.5, None, STAMP_NS, FRAME)


@pytest.fixture
def answer(plan: Plan) -> PlanAnswer:
    return answered(plan)


def test_the_messages_have_the_fields_of_the_planning_objects() -> None:
    # rosidl's constructors ignore a field that the message does not have.
    assert set(PlanMetrics.get_fields_and_field_types()) == {item.name for item in fields(Metrics)}
    assert set(SolverReportMsg.get_fields_and_field_types()) == {"solve_time"} | {
        item.name for item in fields(SolverReport)
    }
    told = {name.removeprefix("RETRY_"): value for name, value in constants(PlanStatus).items()}
    assert told == {one.name: one.value for one in (*Status, *Retry)}
    # A goal's kinds, and its orientations by their place among the words of a file.
    words = {word.name: number for number, word in enumerate(Orientation)}
    assert constants(Goal) == {kind.name: kind.value for kind in GoalKind} | words


def constants(message: Any) -> dict[str, int]:
    """Return the constants of a message's definition."""
    names = {name for name in vars(type(message)) if name.isupper() and name[0] != "_"}
    return {name: getattr(message, name) for name in names}


RETRIES = {
    Retry.NOT_NEEDED: {Status.SOLVED},
    Retry.LATER: {
        *(Status.NO_STATE, Status.STATE_TOO_OLD, Status.STATE_IN_FUTURE, Status.NO_OBSTACLES),
        *(Status.STATE_NOT_SYNCHRONIZED, Status.NO_TARGET_BODY, Status.TARGET_TOO_OLD),
        *(Status.TARGET_IN_FUTURE, Status.INTERNAL_ERROR),
        *(Status.SOLVER_DIED, Status.BUSY, Status.CANCELLED, Status.PREEMPTED),
        *(Status.NOT_ACTIVE, Status.CLOCK_JUMPED, Status.TOO_LATE),
    },
    Retry.CHANGED: {
        *(Status.START_IN_COLLISION, Status.START_OUTSIDE_LIMITS, Status.START_SINGULAR),
        *(Status.NOT_FINITE, Status.WRONG_SIZE, Status.BAD_QUATERNION, Status.WRONG_FRAME),
        *(Status.UNKNOWN_JOINT, Status.OUT_OF_RANGE, Status.UNSUPPORTED, Status.BAD_ROBOT),
        *(Status.START_IN_PAST, Status.UNKNOWN_PLAN, Status.NO_ACTIVE_PLAN, Status.PLAN_ENDING),
        *(Status.GOAL_OUT_OF_REACH, Status.COLLISION, Status.LIMIT_VIOLATED, Status.SINGULAR),
        *(Status.CHECK_FAILED, Status.TIMED_OUT, Status.TORQUE_TOO_HIGH),
        *(Status.SEVERAL_PUBLISHERS, Status.CONTROLLER_CONSTRAINT, Status.STATE_MOVED),
    },
    Retry.DO_NOT_RETRY: {Status.SHUT_DOWN},
}


def test_each_status_says_whether_it_makes_sense_to_ask_again() -> None:
    """A new status has a place here before it has an answer."""
    for retry, statuses in RETRIES.items():
        assert {status for status in Status if REMEDIES[status].retry is retry} == statuses
        for status in statuses:
            answer = answer_of(FfPlannerError(status, "so"), "run.1", 0.0)
            assert answer.status.retry == retry
    assert set.union(*RETRIES.values()) == set(Status)


def test_a_refusal_that_names_no_field_is_of_a_code_that_does() -> None:
    """1xx and 2xx beside those of a start are values of messages: InvalidInput names the field."""
    unnamed = {status for status in Status if not REMEDIES[status].field}
    starts = {Status.START_IN_COLLISION, Status.START_OUTSIDE_LIMITS, Status.START_SINGULAR}
    values = {one for one in Status if one < Status.GOAL_OUT_OF_REACH} - starts
    assert unnamed == values
    for status in set(Status) - unnamed:
        told = answer_of(FfPlannerError(status, "so"), "run.1", 0.0).status
        assert all((told.field, told.value, told.allowed, told.retry)), status


def documented() -> dict[Status, tuple[str, str]]:
    """Return retry and field of each code, as the page of codes has them; empty: the value's."""
    page = (DOCS / "reference" / "status_codes.md").read_text(encoding="utf-8")
    told = re.compile(
        r"^### (\d+) \w+\n\n[^\n]*`retry` is `(\w+)`; `field` "
        r"(?:is `([^`]+)`|names the value at fault)\.",
        re.MULTILINE,
    )
    return {Status(int(code)): (retry, field) for code, retry, field in told.findall(page)}


def errors_of(status: Status) -> Iterator[FfPlannerError]:
    """Yield errors that may have a status: of a value, without a plan, or of the planner itself."""
    if status < Status.INTERNAL_ERROR:
        yield InvalidInput(status, "obstacles[c1]", "around link_2", "it must be outside")
    if status.is_no_plan:
        failure = Failure(status, "target.position is 9 m away", ("a nearer goal",))
        for failures in ((), (failure,)):
            yield NoPlanFound(status, "target.position is 9 m away", failures=failures)
        later = NoPlanFound(status, "phase 2 of 2: it fails")
        later.cause = InvalidInput(status, "then[0].duration", -1.0, "it must be more")
        yield later
    elif status >= Status.INTERNAL_ERROR:
        yield FfPlannerError(status, "so")


@pytest.mark.law("NODE-07")
@pytest.mark.parametrize("status", [one for one in Status if one is not Status.SOLVED])
def test_an_answer_has_field_and_retry_as_the_page_of_codes_says(status: Status) -> None:
    retry, field = documented()[status]
    for error in errors_of(status):
        told = status_message(error)
        assert told.code == status
        assert told.retry == getattr(PlanStatus, retry)
        assert told.field == (field or getattr(error, "field", "")), error
        for words in (told.message, told.value):
            assert "target.position" not in words, "a request has no such field"
        if isinstance(error, InvalidInput):
            assert told.message == f"{told.field} is {told.value}: {told.allowed}"
            for part in (error.field, error.value, error.allowed):
                assert part in told.message


@pytest.mark.parametrize(
    ("status", "retry"),
    [
        (Status.STATE_TOO_OLD, Retry.CHANGED),
        (Status.TARGET_TOO_OLD, Retry.CHANGED),
        (Status.NO_ACTIVE_PLAN, Retry.LATER),
        (Status.TOO_LATE, Retry.CHANGED),
    ],
)
def test_an_error_may_say_itself_whether_to_ask_again_where_the_page_of_codes_says_so(
    status: Status, retry: Retry
) -> None:
    page = (DOCS / "reference" / "status_codes.md").read_text(encoding="utf-8")
    section = page.partition(f"### {int(status)} ")[2].partition("\n#")[0]
    assert f"`retry` is `RETRY_{REMEDIES[status].retry.name}`;" in section
    assert section.count(f"`retry` is `RETRY_{retry.name}`") == 1
    error = InvalidInput(status, "start_time", "over", "later")
    error.retry = retry
    assert status_message(error).retry == retry
    assert status_message(pickle.loads(pickle.dumps(error))).retry == retry


def _at_start(problem: PlanningProblem, **changes: Any) -> PlanningProblem:
    return replace(problem, start=replace(problem.start, **changes))


def _capture_far_away(_: PlanningProblem) -> PlanningProblem:
    problem = tumbling.problem("tumbling", 0)
    assert problem.target_body is not None
    away = problem.target_body.position + np.array([90.0, 0.0, 0.0])
    body = replace(problem.target_body, position=away)
    return with_capture_target(body, problem)


def _with_goal(problem: PlanningProblem, x: float, radius: float = 0.0) -> PlanningProblem:
    place = problem.target.position + np.array([x, 0.0, 0.0])
    clamp = (Obstacle.sphere("clamp", place, radius),) if radius else ()
    return replace(problem, target=replace(problem.target, position=place), obstacles=clamp)


@pytest.mark.parametrize(
    ("status", "spoil", "words"),
    [
        (
            Status.START_IN_COLLISION,
            lambda problem: replace(problem, obstacles=(Obstacle.sphere("c1", np.zeros(3), 1.5),)),
            "obstacles[c1]",
        ),
        (
            Status.START_OUTSIDE_LIMITS,
            lambda problem: _at_start(problem, joint_positions=np.full(7, 9.0)),
            "joints.position[joint_1]",
        ),
        (
            Status.START_SINGULAR,
            lambda problem: _at_start(
                replace(problem, obstacles=()),
                joint_positions=problem.start.joint_positions * np.r_[1, 1, 1, 0, 1, 1, 1]
                + np.pi / 2 * np.eye(7)[3],
            ),
            "singular value",
        ),
        (Status.GOAL_OUT_OF_REACH, _capture_far_away, "target_body.grasp.position is 9"),
        (Status.GOAL_OUT_OF_REACH, lambda problem: _with_goal(problem, 90.0), f"{PLACE} is 9"),
        (Status.COLLISION, lambda problem: _with_goal(problem, 0.0, 0.05), f"{PLACE} lies 0.05"),
    ],
)
def test_what_is_wrong_with_start_and_goal_is_told_in_the_fields_of_requests(
    lemur_capture: PlanningProblem, status: Status, spoil: Any, words: str
) -> None:
    problem = replace(spoil(lemur_capture), parametrisation=Parametrisation.END_EFFECTOR_POLYNOMIAL)
    with pytest.raises((InvalidInput, NoPlanFound)) as refused:
        perform(PlanningTask(problem, load_parameters().planner))
    told = status_message(refused.value)
    assert (told.code, told.field) == (status, documented()[status][1])
    assert words in told.message
    assert told.value in told.message


def test_an_answer_holds_the_plan_row_by_row(plan: Plan, answer: PlanAnswer) -> None:
    (written,) = answer.plans
    motion, trajectory = plan.trajectory, written.joint_trajectory
    assert answer.status == PlanStatus(code=PlanStatus.SOLVED, message=plan.message)
    assert answer.plan_id == "run.1"
    assert trajectory.joint_names == ["shoulder", "elbow", "wrist"]
    assert trajectory.header.frame_id == FRAME
    for row, point in enumerate(trajectory.points):
        assert point.positions.tolist() == motion.joint_positions[row].tolist()
        assert point.velocities.tolist() == motion.joint_velocities[row].tolist()
        assert point.accelerations.tolist() == motion.joint_accelerations[row].tolist()
        assert point.effort.tolist() == motion.joint_torques[row].tolist()
        assert nanoseconds(point.time_from_start) == round(row * 1e9 * DURATION / (POINTS - 1))
    for path, positions, quaternions in (
        (written.chaser_path, motion.chaser_positions, motion.chaser_quaternions_xyzw),
        (written.end_effector_path, motion.ee_positions, motion.ee_quaternions_xyzw),
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
            written.chaser_twists,
            motion.chaser_linear_velocities,
            motion.chaser_angular_velocities,
        ),
        (written.end_effector_twists, motion.ee_linear_velocities, motion.ee_angular_velocities),
    ):
        for row, twist in enumerate(twists):
            assert [twist.linear.x, twist.linear.y, twist.linear.z] == linear[row].tolist()
            assert [twist.angular.x, twist.angular.y, twist.angular.z] == angular[row].tolist()
    assert written.xi.tolist() == plan.xi.tolist()
    assert written.family == plan.family
    (metrics,) = answer.metrics
    for item in fields(Metrics):
        expected = getattr(plan.metrics, item.name)
        assert np.array_equal(getattr(metrics, item.name), expected), item.name
    assert answer.solver.solve_time == 0.5
    for item in fields(SolverReport):
        assert getattr(answer.solver, item.name) == getattr(plan.solver, item.name)


def test_a_plan_comes_back_out_of_its_answer(plan: Plan, answer: PlanAnswer) -> None:
    back = plan_from_answer(answer)
    assert back.joint_names == plan.joint_names
    assert back.xi.tolist() == plan.xi.tolist()
    assert (back.orientation_reading, back.family) == (plan.orientation_reading, plan.family)
    assert back.metrics == plan.metrics
    assert back.solver == plan.solver
    np.testing.assert_allclose(back.trajectory.time, plan.trajectory.time, atol=1e-9)
    for item in fields(Trajectory):
        if item.name != "time":
            expected = getattr(plan.trajectory, item.name)
            np.testing.assert_array_equal(getattr(back.trajectory, item.name), expected)


@pytest.mark.parametrize(
    ("error", "status"),
    [
        (
            NoPlanFound(Status.COLLISION, "c1 is in the way"),
            PlanStatus(
                code=301,
                message="c1 is in the way",
                field="scene",
                value="c1 is in the way",
                allowed="room for the robot on its way",
                retry=PlanStatus.RETRY_CHANGED,
            ),
        ),
        (
            NoPlanFound(
                Status.LIMIT_VIOLATED,
                "in the best of 20 attempts joint_5 is too fast, and joint_6 too far",
                failures=(
                    Failure(Status.LIMIT_VIOLATED, "joint_5 is too fast", ("a longer duration",)),
                    Failure(Status.LIMIT_VIOLATED, "joint_6 is too far", ()),
                ),
            ),
            PlanStatus(
                code=302,
                message="in the best of 20 attempts joint_5 is too fast, and joint_6 too far",
                field="limits",
                value="joint_5 is too fast",
                allowed="a longer duration",
                retry=PlanStatus.RETRY_CHANGED,
            ),
        ),
        (
            InvalidInput(Status.OUT_OF_RANGE, "duration", -1.0, "it must be greater than 0"),
            PlanStatus(
                code=205,
                message="duration is -1.0: it must be greater than 0",
                field="duration",
                value="-1.0",
                allowed="it must be greater than 0",
                retry=PlanStatus.RETRY_CHANGED,
            ),
        ),
        (
            InvalidInput(Status.STATE_TOO_OLD, "chaser_state.header.stamp", "9 s ago", "newer"),
            PlanStatus(
                code=101,
                message="chaser_state.header.stamp is 9 s ago: newer",
                field="chaser_state.header.stamp",
                value="9 s ago",
                allowed="newer",
                retry=PlanStatus.RETRY_LATER,
            ),
        ),
        (
            FfPlannerError(Status.BUSY, "ask again"),
            PlanStatus(
                code=500,
                message="ask again",
                field="when_busy",
                value="reject",
                allowed="one request at a time, or preempt",
                retry=PlanStatus.RETRY_LATER,
            ),
        ),
    ],
)
def test_an_error_becomes_a_status_and_nothing_else(
    error: FfPlannerError, status: PlanStatus
) -> None:
    assert answer_of(error, "run.2", 0.5) == PlanAnswer(status=status, plan_id="run.2")


def test_the_best_attempt_tells_its_metrics_and_not_its_motion(plan: Plan) -> None:
    answer = answer_of(NoPlanFound(Status.COLLISION, "blocked", plan), "run.3", 0.5)
    (metrics,) = answer.metrics
    for item in fields(Metrics):
        expected = getattr(plan.metrics, item.name)
        assert np.array_equal(getattr(metrics, item.name), expected), item.name
    assert answer.solver.solve_time == 0.5
    for item in fields(SolverReport):
        assert getattr(answer.solver, item.name) == getattr(plan.solver, item.name)
    assert (answer.status.code, answer.status.message) == (PlanStatus.COLLISION, "blocked")
    assert answer == PlanAnswer(
        status=answer.status, plan_id="run.3", metrics=[metrics], solver=answer.solver
    )


def test_state_obstacles_and_request_come_back_out_of_their_messages(
    lemur_capture: PlanningProblem,
) -> None:
    problem, robot = lemur_capture, lemur_capture.robot
    message = state_message(problem.start, robot.joint_names, STAMP_NS, FRAME)
    state = state_from_message(message, "chaser_state", robot, FRAME)
    assert not state.ee_at_rest, "a file's word, which no message has"
    for item in fields(state):
        expected = getattr(replace(problem.start, ee_at_rest=False), item.name)
        np.testing.assert_array_equal(getattr(state, item.name), expected)
    scene = scene_message(problem.obstacles, STAMP_NS, FRAME)
    spheres = scene_from_message(scene, "scene", FRAME)
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
    found = (request.duration, request.duration_max, request.objective.duration)
    assert found == (6.5, 15.25, 0.3)
    back = problem_from_request(request, asked.robot, asked.start, (), load_parameters())
    assert back.duration_range is not None
    assert (back.duration_range.minimum, back.duration_range.maximum) == (6.5, 15.25)
    assert (back.duration, back.objective) == (asked.duration, asked.objective)
    given = request_message(lemur_capture, FRAME)
    assert (given.duration, given.duration_max, given.objective.duration) == (10.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"duration": 0.0}, "duration"),
        ({"duration": np.inf}, "duration"),
        ({"duration_max": 9.9}, "duration_max"),
        ({"duration_max": -1.0}, "duration_max"),
        ({"duration_max": np.inf}, "duration_max"),
        ({"duration_max": np.nan}, "duration_max"),
        ({"objective.duration": -0.1}, "objective.duration"),
        ({"objective.duration": np.nan}, "objective.duration"),
    ],
)
def test_an_impossible_range_in_a_request_is_refused_by_name(
    lemur_capture: PlanningProblem, changes: dict[str, float], field: str
) -> None:
    request = request_message(lemur_capture, FRAME)
    request.duration_max = 20.0
    for name, value in changes.items():
        block, _, last = name.rpartition(".")
        setattr(value_at(request, block), last, value)
    with pytest.raises(InvalidInput) as refused:
        problem_from_request(
            request, lemur_capture.robot, lemur_capture.start, (), load_parameters()
        )
    assert refused.value.field == field


def test_an_answer_tells_the_duration_of_the_plan_without_its_tail(plan: Plan) -> None:
    answer = answered(replace(plan, duration=7.25))
    assert answer.plans[0].duration == plan_from_answer(answer).duration == 7.25
    assert plan_from_answer(answered(plan)).duration == plan.duration


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
        (Goal.ABOUT_AXIS, 0.0, r"^goal\.free_axis is missing: orientation about_axis needs the ax"),
        (Goal.FREE, 1.0, r"^goal\.free_axis is .*where orientation is about_axis"),
        (3, 0.0, r"^goal\.orientation is 3: it must be one of 0 \(fixed\), 1 \(free\), 2 \(about"),
        (255, 0.0, r"^goal\.orientation is 255: it must be one of"),
    ],
)
def test_a_part_of_a_pose_that_makes_no_sense_is_refused_by_its_field(
    lemur_capture: PlanningProblem, orientation: int, axis: float, message: str
) -> None:
    request = request_message(lemur_capture, FRAME)
    request.goal.orientation, request.goal.free_axis.z = orientation, axis
    with pytest.raises(InvalidInput, match=message):
        problem_from_request(
            request, lemur_capture.robot, lemur_capture.start, (), load_parameters()
        )


@pytest.mark.parametrize(
    ("pairs", "distance", "field"),
    [
        (["link_7/moon"], 0.2, "pairs"),
        (["link_7/c1"], -0.2, "distance"),
        (["link_7/c1"], np.nan, "distance"),
        (["link_7/c1"], 0.0, ""),
        ([], 0.0, ""),
    ],
)
def test_what_may_touch_is_refused_by_its_field_and_zero_is_the_usual_distance(
    pairs: list[str], distance: float, field: str
) -> None:
    problem = load_scenario(CONFIG / "scenarios" / "lemur_capture_bodies.yaml")
    request = request_message(problem, FRAME)
    request.goal.allowed_collisions = [AllowedCollisions(pairs=pairs, distance=distance)]
    arguments = (request, problem.robot, problem.start, problem.obstacles, load_parameters())
    if not field:
        found = problem_from_request(*arguments)
        assert (found.allowed_collisions, found.contact_distance) == (tuple(pairs), 0.1)
        return
    with pytest.raises(InvalidInput) as refused:
        problem_from_request(*arguments)
    assert refused.value.field == f"goal.allowed_collisions.{field}"


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
    request.goal.twist.linear.x, request.goal.twist.angular.z = 0.01, -0.02
    problem = _problem(lemur_capture, request)
    assert problem.target.linear_velocity.tolist() == [0.01, 0.0, 0.0]
    assert problem.target.angular_velocity.tolist() == [0.0, 0.0, -0.02]


def test_points_of_zero_are_those_of_the_parameter(lemur_capture: PlanningProblem) -> None:
    request = request_message(lemur_capture, FRAME)
    request.search.points = 0
    assert _problem(lemur_capture, request).points == 9


def test_an_empty_message_is_refused_by_its_frame(lemur_capture: PlanningProblem) -> None:
    for refuse in (
        lambda: state_from_message(ChaserState(), "chaser_state", lemur_capture.robot, FRAME),
        lambda: scene_from_message(Scene(), "scene", FRAME),
        lambda: _problem(lemur_capture, PlanRequest()),
    ):
        with pytest.raises(InvalidInput) as refusal:
            refuse()
        assert refusal.value.status is Status.WRONG_FRAME
        assert refusal.value.field.endswith("header.frame_id")


@pytest.mark.parametrize("time_ns", [0, 1, 999_999_999, 1_000_000_000, STAMP_NS])
def test_a_time_comes_back_out_of_its_message(time_ns: int) -> None:
    assert nanoseconds(time_message(time_ns)) == time_ns
    assert nanoseconds(Duration(sec=3, nanosec=7)) == 3_000_000_007


def _problem(problem: PlanningProblem, request: PlanRequest) -> PlanningProblem:
    parameters = replace(load_parameters(), points=9)
    return problem_from_request(request, problem.robot, problem.start, (), parameters)
