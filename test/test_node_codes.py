"""Every code of an answer is provoked in a running node; here those that its parameters decide."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
import test_node_action
import test_node_lifecycle
import test_node_odometry
import test_node_publish_plan
import test_node_publishers
import test_node_refusals
import test_node_robustness
import test_node_time
import test_planning_service
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from ff_planner_msgs.msg import ObstacleSphere, Plan, PlanRequest
from managed_node import Manager
from ros_processes import (
    FRAME,
    Client,
    PlannerProcess,
    Scene,
    connected_client,
    private_domain,
    running_planner,
)

from ff_planner_ros.common.times import NANOSECONDS, nanoseconds
from ff_planner_ros.errors import Status
from ff_planner_ros.messages.trajectories import trajectory_in
from ff_planner_ros.planning.motion.forward import carried_forward
from ff_planner_ros.planning.motion.joint_motion import joint_motion
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.ros.messages.to_messages import state_message, time_message

# States and plans are of this much ahead of the request: nobody is ever too late or too old [ns].
LEAD = 60_000_000_000
ARGUMENTS = {"state_future_tolerance": "3600.0", "planner.starts": "1", "rates.diagnostics": "20.0"}
NOT_AT_END = "controller.allow_nonzero_velocity_at_trajectory_end"


@dataclass(frozen=True)
class Case:
    """A request that can be solved but for one fault, and what the node is set to meanwhile."""

    words: tuple[str, ...]
    spoil: Callable[[PlanRequest], None]
    parameter: tuple[str, Any, Any] | None = None


def _nothing(_: PlanRequest) -> None:
    """Leave it as it is."""


def _target_inside(request: PlanRequest) -> None:
    clamp = ObstacleSphere(id="clamp", center=request.goal.pose.pose.position, radius=0.05)
    request.scene[0].spheres = [clamp]


def _stretched(request: PlanRequest) -> None:
    request.search.parametrisation = "end_effector_polynomial"  # joint splines begin there, too
    request.scene[0].spheres = []
    request.start_state[0].joint_positions[3] = math.pi / 2


def _out_of_reach_but_for_a_bound(request: PlanRequest) -> None:
    request.search.parametrisation = "end_effector_polynomial"  # joint splines find a plan
    request.scene[0].spheres = []
    request.goal.pose.pose.position.x = 3.6


def _in_a_hurry(request: PlanRequest) -> None:
    request.scene[0].spheres = []
    request.duration = 0.4


CASES = {
    Status.COLLISION: Case(
        ("goal.pose.pose.position lies", "inside obstacle clamp"), _target_inside
    ),
    Status.START_SINGULAR: Case(("joints.position", "singular value"), _stretched),
    Status.SINGULAR: Case(("dynamic singularity at t =",), _out_of_reach_but_for_a_bound),
    Status.CHECK_FAILED: Case(
        ("final_position_error is",), _nothing, ("planner.position_tolerance", 1e-12, 1e-3)
    ),
    Status.TORQUE_TOO_HIGH: Case(
        ("needs", "beyond its effort limit of 80 N m"),
        _in_a_hurry,
        ("limits.velocity", "none", "from_urdf"),
    ),
    Status.CONTROLLER_CONSTRAINT: Case(
        ("a joint_trajectory_controller would not take the plan", "choose the end_behaviour"),
        _nothing,
        (NOT_AT_END, False, True),
    ),
}

# Codes that need a moment or a world of their own, and the tests that make it. Nobody is answered
# with BAD_ROBOT: a node without a robot does not start, and says why (test_node.py). The real node
# could not be brought to an INTERNAL_ERROR; its service, with a solver that fails, was.
ELSEWHERE: dict[Status, Callable[..., object]] = {
    Status.SOLVED: test_node_refusals.test_the_node_lives_on_and_answers_a_good_request,
    Status.NO_STATE: test_node_refusals.test_what_is_or_is_not_published_is_refused_with_its_cause,
    Status.UNKNOWN_PLAN: (
        test_node_publish_plan.test_a_plan_that_is_only_asked_for_goes_out_by_its_id
    ),
    Status.NO_ACTIVE_PLAN: test_node_publish_plan.test_a_plan_takes_over_from_the_one_that_runs,
    Status.PLAN_ENDING: test_node_publish_plan.test_a_plan_takes_over_from_the_one_that_runs,
    Status.STATE_MOVED: test_node_publish_plan.test_a_plan_goes_out_only_from_where_it_begins,
    Status.SEVERAL_PUBLISHERS: (
        test_node_publishers.test_a_second_publisher_is_refused_by_name_until_it_stops
    ),
    Status.NO_OBSTACLES: (
        test_node_refusals.test_what_is_or_is_not_published_is_refused_with_its_cause
    ),
    Status.STATE_NOT_SYNCHRONIZED: (
        test_node_odometry.test_a_plan_starts_from_the_centre_of_mass_that_odometry_and_mounting_tell
    ),
    Status.TOO_LATE: test_node_action.test_a_plan_that_is_ready_too_late_is_refused_as_such,
    Status.INTERNAL_ERROR: (
        test_planning_service.test_an_error_that_nobody_foresaw_is_answered_and_logged_with_its_traceback
    ),
    Status.SOLVER_DIED: test_node_action.test_a_solver_that_is_killed_in_a_plan_is_the_goals_result,
    Status.BUSY: test_node_action.test_a_second_client_is_told_that_the_planner_is_busy,
    Status.CANCELLED: (
        test_node_action.test_cancelled_at_random_moments_a_goal_ends_cancelled_or_was_solved_before
    ),
    Status.PREEMPTED: (
        test_node_action.test_a_newer_request_takes_the_older_ones_place_where_the_parameter_says_so
    ),
    Status.NOT_ACTIVE: test_node_lifecycle.test_it_plans_only_while_it_is_active,
    Status.SHUT_DOWN: (
        test_node_robustness.test_a_node_that_ends_gives_up_its_goal_and_has_all_goals_and_answers_in_its_bag
    ),
    Status.CLOCK_JUMPED: test_node_time.test_time_goes_on_and_jumps_back,
}


@pytest.fixture(scope="module")
def planner(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PlannerProcess]:
    arguments = [word for name, value in ARGUMENTS.items() for word in ("-p", f"{name}:={value}")]
    directory = tmp_path_factory.mktemp("codes")
    with private_domain(), running_planner(directory, *arguments) as planner:
        yield planner


@pytest.fixture(scope="module")
def client(planner: PlannerProcess) -> Iterator[Client]:  # noqa: ARG001 (it must run)
    with connected_client() as client:
        client.wait_for_planner()
        yield client


def unhurried(client: Client, scene: Scene) -> PlanRequest:
    """A request whose plan starts from its own state, long after it is ready."""
    request = scene.complete_request()
    start = time_message(client.now_ns() + LEAD)
    request.start_state[0].header.stamp = request.start_time = start
    return request


def ask(client: Client, scene: Scene, case: Case) -> Any:
    request = unhurried(client, scene)
    case.spoil(request)
    if case.parameter is None:
        return client.plan(request)
    name, meanwhile, normally = case.parameter
    manager = Manager(client)
    manager.configure_with(name, meanwhile)
    client.wait_for_planner()
    try:
        return client.plan(request)
    finally:
        manager.configure_with(name, normally)


@pytest.mark.law("NODE-07")
@pytest.mark.parametrize("status", CASES, ids=lambda status: status.name)
def test_a_request_is_refused_with_its_cause(
    client: Client, lemur_capture: PlanningProblem, status: Status
) -> None:
    answer = ask(client, Scene(lemur_capture), CASES[status])
    assert Status(answer.status.code) is status, answer.status.message
    for word in CASES[status].words:
        assert word in answer.status.message
    assert not answer.plans


def test_what_comes_after_the_goal_is_what_the_request_says(
    client: Client, lemur_capture: PlanningProblem
) -> None:
    def rates_at_the_end(behaviour: str) -> tuple[Plan, float]:
        request = unhurried(client, Scene(lemur_capture))
        request.end_behaviour = behaviour
        answer = client.plan(request)
        assert answer.status.code == Status.SOLVED, answer.status
        (plan,) = answer.plans
        return plan, float(np.abs(plan.joint_trajectory.points[-1].velocities).max())

    points, target = lemur_capture.points, lemur_capture.target.position
    planned, moving = rates_at_the_end("none")
    assert len(planned.joint_trajectory.points) == points
    assert moving > 1e-3

    held, moving = rates_at_the_end("hold_end_effector")
    assert len(held.joint_trajectory.points) > points
    assert moving > 1e-3
    for pose in held.end_effector_path.poses[points - 1 :]:
        at = pose.pose.position
        assert [at.x, at.y, at.z] == pytest.approx(target, abs=1e-3)

    # A controller that wants joints at rest at the end takes this one, and only this one.
    manager = Manager(client)
    manager.configure_with(NOT_AT_END, False)
    client.wait_for_planner()
    stopped, moving = rates_at_the_end("stop_joints")
    manager.configure_with(NOT_AT_END, True)
    assert len(stopped.joint_trajectory.points) > points
    assert moving <= np.finfo(np.float32).eps
    client.wait_until(
        lambda: (
            client.received["joint_trajectory"]
            and client.received["joint_trajectory"][-1].header == stopped.joint_trajectory.header
        ),
        "the trajectory that comes to rest",
    )


@pytest.mark.law("NODE-19")
def test_a_chaser_that_leaves_its_plan_is_a_warning_in_the_diagnostics(
    client: Client, lemur_capture: PlanningProblem
) -> None:
    scene = Scene(lemur_capture)
    keep = client._keeper("diagnostics")
    client.received["diagnostics"] = []
    client.node.create_subscription(DiagnosticArray, "/diagnostics", keep, 10)
    answer = client.plan(unhurried(client, scene))
    assert answer.status.code == Status.SOLVED, answer.status
    predicted = answer.plans[0].chaser_path.poses[20]
    state = scene.state(0)
    state.header.stamp, state.pose = predicted.header.stamp, predicted.pose
    state.joint_positions = answer.plans[0].joint_trajectory.points[20].positions
    for off, level, words in (
        (0.0, DiagnosticStatus.OK, "the chaser is 0.0 mm"),
        (0.05, DiagnosticStatus.WARN, "leaves the plan: the chaser's position by 0.05 m"),
        (0.0, DiagnosticStatus.OK, "the chaser is 0.0 mm"),
    ):
        moved = predicted.pose.position.x
        state.pose.position.x = moved + off

        def told(level: bytes = level, words: str = words) -> bool:
            client.publish_state(state)
            heard = client.received["diagnostics"]
            return any(
                part.name.endswith(": tracking") and part.level == level and words in part.message
                for part in (heard[-1].status if heard else ())
            )

        client.wait_until(told, words)
        state.pose.position.x = moved


@pytest.mark.law("NODE-07")
def test_every_code_has_a_test_that_provokes_it() -> None:
    by_request = {case.status for case in test_node_refusals.CASES.values()} | CASES.keys()
    assert by_request | ELSEWHERE.keys() | {Status.BAD_ROBOT} == set(Status)
    for status, test in ELSEWHERE.items():
        assert f"Status.{status.name}" in inspect.getsource(test), test


def test_a_plan_asked_for_in_the_middle_of_another_joins_it(
    client: Client, lemur_capture: PlanningProblem
) -> None:
    """Its state is measured after 4 s of the first plan, and it begins after 6.3 s of it."""
    scene = Scene(lemur_capture)
    request = unhurried(client, scene)
    first = client.plan(request)
    assert first.status.code == Status.SOLVED, first.status
    begin_ns = nanoseconds(first.plans[0].joint_trajectory.header.stamp)
    running = joint_motion(trajectory_in(first.plans[0]))
    measured, begin = 4.0, 6.3
    after = carried_forward(lemur_capture.robot, lemur_capture.start, measured, running)
    names, stamp_ns = lemur_capture.robot.joint_names, begin_ns + round(measured * NANOSECONDS)
    # Nobody tells the accelerations: the node knows its own plan.
    after = replace(after, joint_accelerations=None)
    request.start_state = [state_message(after, names, stamp_ns, FRAME)]
    request.start_time = time_message(begin_ns + round(begin * NANOSECONDS))
    second = client.plan(request)
    assert second.status.code == Status.SOLVED, second.status
    assert second.inputs.previous_plan_id == first.plan_id
    _, (rates,), (accelerations,) = running.at(np.array([begin]))
    begins = second.plans[0].joint_trajectory.points[0]
    assert np.abs(begins.velocities - rates).max() <= 1e-9
    assert np.abs(begins.accelerations - accelerations).max() <= 1e-6
    assert np.abs(accelerations).max() > 1e-3
