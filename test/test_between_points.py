"""Whatever the plan promises holds between its points, too, when a controller follows them.

The truth is that of `dense_motion`: twenty times denser, integrated independently.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from dense_motion import Truth, truth
from robots import CANADARM2_SCENARIO, LEMUR_URDF, of_lines
from shared_plans import planned

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.check.check import failures, measure
from ff_planner_ros.planning.distance.clearance import arm_points
from ff_planner_ros.planning.motion.motion import from_trajectory
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import Limits, Objective, PlanningProblem
from ff_planner_ros.planning.problem.settings import SearchDepth
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.search.planner import plan
from ff_planner_ros.planning.task.tail import EndBehaviour, with_tail
from ff_planner_ros.problems.scenarios import scenario
from ff_planner_ros.robot.ee_at_rest import joint_rates_with_ee_at_rest
from ff_planner_ros.robot.model import robot_from_urdf_text
from ff_planner_ros.simulation.verification import verify

# What is tested here does not depend on how long the least attitude is looked for.
SETTINGS = replace(load_parameters().planner, search=SearchDepth.QUICK)
LENGTH = Objective(1.0, 0.0)
# What is allowed beyond a limit: [rad], and in parts of a rate limit.
EXCESS = 1e-4
POINTS = (5, 8, 13, 25, 50, 200)


def lemur_off_centre() -> PlanningProblem:
    """The paper's capture with a chaser whose centre of mass is far from its base frame."""
    capture = load_scenario(LEMUR_URDF.parents[2] / "scenarios/lemur_capture.yaml")
    urdf = of_lines(LEMUR_URDF)
    moved = re.sub(
        r'(<link name="chaser">\s*<inertial>\s*)(<origin[^>]*/>)?',
        r'\1<origin xyz="0.15 -0.2 0.1" rpy="0 0 0"/>',
        urdf,
        count=1,
    )
    assert moved != urdf
    return replace(capture, robot=robot_from_urdf_text(moved, "chaser", "end_effector"))


def problem_of(arm: str) -> PlanningProblem:
    if arm == "lemur":
        capture = load_scenario(LEMUR_URDF.parents[2] / "scenarios/lemur_capture.yaml")
    elif arm == "canadarm2":
        capture = load_scenario(CANADARM2_SCENARIO)
    elif arm == "off centre":
        capture = lemur_off_centre()
    else:
        capture = scenario("ordinary", "arm6", 1, turned=False).problem
    return replace(capture, objective=LENGTH)


def require_kept(problem: PlanningProblem, answer: Plan) -> Truth:
    """Hold a plan against the truth, and what it says of itself."""
    found, metrics = truth(problem, answer.trajectory), answer.metrics
    case = f"{problem.points} points: {found._replace(q=np.empty(0), time=np.empty(0))}"
    assert len(answer.trajectory.time) == problem.points
    assert found.position_miss <= SETTINGS.position_tolerance, case
    assert found.orientation_miss <= SETTINGS.orientation_tolerance, case
    assert found.beyond_positions <= EXCESS, case
    if problem.limits.joint_velocities:
        assert found.beyond_rates <= EXCESS, case
    assert (found.torques <= problem.robot.effort_limits * (1.0 + 5e-4)).all(), case
    assert found.clearance >= 0.0, case
    assert found.chaser_attitude <= problem.limits.chaser_attitude + EXCESS, case
    # The metrics are those of this motion.
    assert metrics.final_position_error == pytest.approx(found.position_miss, abs=1e-6)
    assert -metrics.min_joint_margin == pytest.approx(found.beyond_positions, abs=1e-3)
    assert -metrics.min_joint_margin >= found.beyond_positions - 1e-9
    np.testing.assert_allclose(metrics.peak_joint_torques, found.torques, rtol=3e-3, atol=1e-6)
    assert metrics.min_clearance <= found.clearance + 1e-6
    return found


@pytest.mark.parametrize("arm", ["lemur", "six joints", "canadarm2", "off centre"])
def test_a_plan_on_any_number_of_points_is_driven_to_its_goal(arm: str) -> None:
    problem = problem_of(arm)
    for points in POINTS if arm == "lemur" else (5, 13):
        asked = replace(problem, points=points)
        answer = planned(asked, SETTINGS)
        require_kept(asked, answer)
        if points < 10:
            assert verify(asked.robot, answer.trajectory).passed, points


def turning_back(answer: Plan) -> tuple[Array, Array]:
    """How far each joint goes beyond both its ends, upwards and downwards."""
    joints = answer.trajectory.joint_positions
    ends = joints[[0, -1]]
    return joints.max(axis=0) - ends.max(axis=0), ends.min(axis=0) - joints.min(axis=0)


def with_binding_limits(
    problem: PlanningProblem, free: Plan, kind: str, rng: np.random.Generator
) -> PlanningProblem:
    """The problem with limits that its shortest plan exceeds, in the URDF where they are there."""
    limits, urdf = Limits(joint_velocities=kind == "rates"), problem.robot.urdf
    if kind == "attitude":
        limits = Limits(chaser_attitude=free.metrics.max_chaser_euler * rng.uniform(0.85, 0.97))
    over, under = turning_back(free)
    joints, rates = free.trajectory.joint_positions, np.abs(free.trajectory.joint_velocities)
    part = rng.uniform(0.1, 0.4)
    for k, name in enumerate(problem.robot.joint_names):
        told: dict[str, float] = {}
        if kind == "positions" and over[k] > 0.01:
            told["upper"] = joints[:, k].max() - part * over[k]
        if kind == "positions" and under[k] > 0.01:
            told["lower"] = joints[:, k].min() + part * under[k]
        if kind == "rates":
            at_ends = rates[[0, -1], k].max()
            told["velocity"] = max((1.0 - part / 2) * rates[:, k].max(), 1.3 * at_ends)
        urdf = with_limit(urdf, name, told)
    robot = robot_from_urdf_text(urdf, problem.robot.base_link, problem.robot.tip_link)
    return replace(problem, robot=robot, limits=limits)


def with_limit(urdf: str, joint: str, told: dict[str, float]) -> str:
    """Replace attributes of a joint's <limit> in the text."""
    begin = urdf.index(f'<joint name="{joint}"')
    end = urdf.index("</joint>", begin)
    part = urdf[begin:end]
    for name, value in told.items():
        part, count = re.subn(rf'(<limit[^>]*\b{name}=")[^"]*', rf"\g<1>{float(value)!r}", part)
        assert count == 1, (joint, name)
    return urdf[:begin] + part + urdf[end:]


@pytest.mark.parametrize("kind", ["positions", "rates", "attitude"])
def test_limits_that_bind_are_kept_at_all_times(
    kind: str, times: Callable[[int, int], int]
) -> None:
    binding = 0
    for seed in range(times(2, 4)):
        rng = np.random.default_rng([seed, *kind.encode()])
        problem = problem_of(("lemur", "off centre", "six joints", "lemur")[seed])
        problem = replace(
            problem,
            obstacles=problem.obstacles if seed % 2 else (),
            duration=problem.duration * rng.uniform(0.8, 1.3),
        )
        free = plan(problem, SETTINGS)
        bounded = with_binding_limits(problem, free, kind, rng)
        for points in (8, 50):
            asked = replace(bounded, points=points)
            found = require_kept(asked, plan(asked, SETTINGS))
            binding += {
                "positions": -found.beyond_positions < 2e-3,
                "rates": -found.beyond_rates < 2e-3,
                "attitude": asked.limits.chaser_attitude - found.chaser_attitude < 2e-3,
            }[kind]
    assert binding >= 2, "too few of the limits are reached for this test to say anything"


@pytest.mark.law("PLAN-06")
def test_an_effort_limit_between_the_largest_torque_at_the_points_and_between_them_refuses() -> (
    None
):
    """The torque is named with its time; where the limit is above the peak, the plan is sound."""
    problem = replace(problem_of("lemur"), points=13)
    answer = planned(problem, SETTINGS)
    peaks = truth(problem, answer.trajectory).torques
    at_points = np.abs(answer.trajectory.joint_torques).max(axis=0)
    joint = int((peaks / at_points).argmax())
    assert peaks[joint] > 1.01 * at_points[joint], "no peak between the points"
    for limit, refused in ((0.995 * peaks[joint], True), (1.005 * peaks[joint], False)):
        name = problem.robot.joint_names[joint]
        urdf = with_limit(problem.robot.urdf, name, {"effort": limit})
        weak = replace(problem, robot=robot_from_urdf_text(urdf, "chaser", "end_effector"))
        again = replace(answer, metrics=measure(weak, answer.trajectory, SETTINGS))
        found = list(failures(weak, again, SETTINGS))
        assert [failure.status for failure in found] == [Status.TORQUE_TOO_HIGH] * refused
        assert not refused or f"joint {name} needs" in found[0].finding


def test_a_fast_motion_of_a_tumbling_chaser_is_driven_to_its_goal() -> None:
    """Thirty degrees a second: the chaser turns by more than a radian between eight points."""
    problem = problem_of("lemur")
    spin = np.array([0.2, -0.3, 0.4])
    start = replace(problem.start, angular_velocity_chaser_in_inertial=spin)
    rates = joint_rates_with_ee_at_rest(problem.robot, start)
    fast = replace(
        problem, start=replace(start, joint_velocities=rates), obstacles=(), duration=5.0
    )
    for points in (8, 50):
        asked = replace(fast, points=points)
        require_kept(asked, plan(asked, SETTINGS))


@pytest.mark.parametrize("behaviour", [EndBehaviour.HOLD_END_EFFECTOR, EndBehaviour.STOP_JOINTS])
def test_a_tail_of_few_points_is_what_comes_of_them(behaviour: EndBehaviour) -> None:
    problem = replace(problem_of("lemur"), points=6)
    answer = with_tail(problem, planned(problem, SETTINGS), behaviour, 6.0, SETTINGS)
    motion, found = answer.trajectory, truth(problem, answer.trajectory)
    q, _ = from_trajectory(problem.robot, motion)
    dense = (len(found.time) - 1) // (len(motion.time) - 1)
    assert np.abs(found.q[::dense, :3] - q[:, :3]).max() < 1e-6
    assert verify(problem.robot, motion).passed
    if behaviour is EndBehaviour.HOLD_END_EFFECTOR:
        after = found.q[found.time >= problem.duration]
        tips = arm_points(problem.robot, after)[:, -1]
        away = np.linalg.norm(tips - problem.target.position, axis=1)
        assert away.max() < SETTINGS.position_tolerance
