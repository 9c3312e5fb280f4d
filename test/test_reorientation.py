"""The arm turns the satellite: a hundred targets, in flight, and with momentum and moving goals."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest
from dense_motion import truth
from published_paths import P5_START, at_rest, p5_robot
from robots import CONFIG, LEMUR_URDF
from scipy.interpolate import BPoly
from scipy.spatial.transform import Rotation

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.forward import carried_forward
from ff_planner_ros.planning.motion.joint_motion import joint_motion
from ff_planner_ros.planning.motion.plan import Plan, Trajectory
from ff_planner_ros.planning.problem.posture import end_effector_at
from ff_planner_ros.planning.problem.problem import (
    ChaserGoal,
    Limits,
    Objective,
    Orientation,
    PlanningProblem,
    Posture,
)
from ff_planner_ros.planning.problem.scene import scene_of
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.robot.model import Robot, robot_from_urdf_text
from ff_planner_ros.simulation.verification import verify

SETTINGS = load_parameters().planner
TARGETS, LARGEST = 100, np.deg2rad(5.0)
TOLERANCE = 1e-4  # [rad]
ROUNDING = 2e-6  # of the core's integration, and of ours [rad]


def at(attitude: Rotation, tolerance: float) -> ChaserGoal:
    return ChaserGoal(quaternion_xyzw=attitude.as_quat(), tolerance=tolerance)


def attitude_wanted(number: int) -> Rotation:
    """One of the targets: about any axis, by any angle up to the largest."""
    rng = np.random.default_rng([300, number])
    axis = rng.normal(size=3)
    return Rotation.from_rotvec(rng.uniform(0.0, LARGEST) * axis / np.linalg.norm(axis))


@cache
def reoriented(number: int) -> tuple[PlanningProblem, Plan]:
    """A satellite of 300 kg at rest, its arm of 12.5 kg in one posture at start and goal."""
    robot = p5_robot(300.0)
    start = at_rest(robot, P5_START)
    problem = PlanningProblem(
        robot=robot,
        start=start,
        target=end_effector_at(robot, start),
        posture=Posture(start.joint_positions),
        chaser_goal=at(attitude_wanted(number), TOLERANCE),
        duration=30.0,
        points=61,
        obstacles=(),
        objective=Objective(1.0, 0.0),
        limits=Limits(joint_velocities=True),
    )
    return problem, perform(PlanningTask(problem, SETTINGS))


def turned_by_joints(robot: Robot, motion: Trajectory, parts: int = 4) -> Rotation:
    """How joints turn a base at rest: w = -(A^-1 B)_w dq/dt, by a Magnus rule of fourth order."""
    samples = motion.joint_positions, motion.joint_velocities, motion.joint_accelerations
    joints = BPoly.from_derivatives(motion.time, np.stack(samples, axis=1))
    ends = np.interp(
        np.linspace(0.0, 1.0, parts * (len(motion.time) - 1) + 1),
        np.linspace(0.0, 1.0, len(motion.time)),
        motion.time,
    )
    data = robot.model.createData()

    def rate(time: float) -> Array:
        q = np.concatenate([np.zeros(6), [1.0], joints(time)])
        of_velocity = pin.computeCentroidalMap(robot.model, data, q)
        twist = np.linalg.solve(of_velocity[:, :6], -of_velocity[:, 6:] @ joints(time, 1))
        turning: Array = twist[3:]
        return turning

    turned = Rotation.identity()
    for begin, end in pairwise(ends):
        middle, step = (begin + end) / 2.0, end - begin
        first, second = (rate(middle + side * step / np.sqrt(12.0)) for side in (-1.0, 1.0))
        both = step / 2.0 * (first + second) + step**2 / np.sqrt(48.0) * np.cross(first, second)
        turned *= Rotation.from_rotvec(both)
    return turned


@pytest.mark.sampled
@pytest.mark.parametrize("number", range(TARGETS))
def test_a_closed_loop_of_the_joints_leads_to_an_attitude(number: int) -> None:
    problem, plan = reoriented(number)
    motion, wanted = plan.trajectory, attitude_wanted(number)
    np.testing.assert_allclose(motion.joint_positions[-1], P5_START, atol=1e-9)
    np.testing.assert_allclose(motion.joint_velocities[-1], 0.0, atol=1e-9)
    turned = turned_by_joints(problem.robot, motion)
    assert (wanted.inv() * turned).magnitude() <= TOLERANCE + ROUNDING
    assert plan.metrics.final_chaser_rotation == pytest.approx(turned.magnitude(), abs=ROUNDING)
    assert np.abs(motion.joint_velocities).max() <= problem.robot.velocity_limits.min() + 1e-9


@pytest.mark.ci
@pytest.mark.parametrize("number", range(0, TARGETS, 20))
def test_a_closed_loop_comes_true_in_the_engine(number: int) -> None:
    problem, plan = reoriented(number)
    found = verify(problem.robot, plan.trajectory)
    assert found.passed
    assert found.parts == 1  # in open loop from start to end
    (last,) = Rotation.from_quat(found.execution.chaser_quaternions_xyzw[-1:])
    assert (attitude_wanted(number).inv() * last).magnitude() <= TOLERANCE + ROUNDING


def crooked(name: str) -> PlanningProblem:
    """A scenario whose chaser has its centre of mass and main axes off the base frame."""
    problem, place, turn = load_scenario(CONFIG / f"scenarios/{name}.yaml"), [0.2, -0.1, 0.15], 0.4
    mass = '<mass value="350.0"/>'
    urdf = LEMUR_URDF.read_text("utf-8")
    assert urdf.count(mass) == 1
    origin = f'<origin xyz="{place[0]} {place[1]} {place[2]}" rpy="0 0 {turn}"/>'
    robot = robot_from_urdf_text(
        urdf.replace(mass, f"{origin}{mass}"),
        "chaser",
        "end_effector",
        geometry=problem.robot.geometry,
    )
    start = replace(
        problem.start,
        position_chaser_in_inertial=np.array(place),
        quaternion_chaser_to_inertial_xyzw=Rotation.from_rotvec([0.0, 0.0, turn]).as_quat(),
    )
    return replace(problem, robot=robot, start=start)


def ends_within(problem: PlanningProblem, plan: Plan) -> float:
    """How far the chaser is off its goal [rad], integrated anew from the plan's joints."""
    base = Rotation.from_quat(truth(problem, plan.trajectory).q[[0, -1], 3:7])
    first, last = base * Rotation.from_matrix(problem.robot.rotation_chaser_to_base)
    start = Rotation.from_quat(problem.start.quaternion_chaser_to_inertial_xyzw)
    assert (start.inv() * first).magnitude() < 1e-9
    wanted = Rotation.from_quat(problem.chaser_goal.wanted(start.as_quat()))
    return float((wanted.inv() * last).magnitude())


GOALS = {"any orientation": "lemur_capture", "a moving grasp": "lemur_tumbling"}


@pytest.mark.ci
@pytest.mark.sampled
@pytest.mark.parametrize("turn", [None, [0.02, -0.015, 0.01]], ids=["as at the start", "turned"])
@pytest.mark.parametrize("goal", GOALS)
def test_a_crooked_chaser_that_drifts_is_led_to_its_attitude(
    goal: str, turn: list[float] | None
) -> None:
    """Beside a place with any orientation of the end effector, and beside a grasp that moves."""
    problem = crooked(GOALS[goal])
    if problem.target_body is None:
        free = replace(problem.target, orientation=Orientation.FREE)
        problem = replace(problem, target=free)
    asked = ChaserGoal(rotation=1e-3)
    if turn is not None:
        start = Rotation.from_quat(problem.start.quaternion_chaser_to_inertial_xyzw)
        asked = at(start * Rotation.from_rotvec(turn), 1e-3)
    task = PlanningTask(replace(problem, chaser_goal=asked), SETTINGS)
    plan = perform(task)
    assert ends_within(task.problem, plan) <= 1e-3 + ROUNDING
    motion = plan.trajectory
    flown = verify(task.problem.robot, motion, scene_of(task.problem))
    assert flown.passed
    first, last = Rotation.from_quat(flown.execution.chaser_quaternions_xyzw[[0, -1]])
    wanted = Rotation.from_quat(asked.wanted(first.as_quat()))
    assert (wanted.inv() * last).magnitude() <= 1e-3 + ROUNDING
    # Without it the chaser ends elsewhere.
    without = perform(PlanningTask(problem, SETTINGS))
    assert ends_within(task.problem, without) > 1e-2


@pytest.mark.ci
def test_a_plan_that_takes_over_in_flight_leads_to_the_attitude_of_the_first() -> None:
    """The joints are off the plan that runs, the chaser turns otherwise, and the goal has moved."""
    first = load_scenario(CONFIG / "scenarios/lemur_capture.yaml")
    wanted = Rotation.from_rotvec([0.0, 0.02, -0.01])
    first = replace(first, chaser_goal=at(wanted, 1e-3))
    plan = perform(PlanningTask(first, SETTINGS))
    running, since, ahead = joint_motion(plan.trajectory), 4.0, 0.2
    measured = carried_forward(first.robot, first.start, since, running)
    measured = replace(
        measured,
        joint_positions=measured.joint_positions + 2e-3,
        angular_velocity_chaser_in_inertial=measured.angular_velocity_chaser_in_inertial + 2e-4,
    )
    goal = first.duration - since
    target = replace(first.target, position=first.target.position + np.array([0.0, 0.01, 0.0]))
    problem = replace(first, start=measured, target=target, duration=goal - ahead)
    after = replace(running, time=running.time - since)
    task = PlanningTask(problem, SETTINGS, ahead=ahead, running=after, running_goal=goal)

    def off(asked: PlanningTask) -> float:
        motion = perform(asked).trajectory
        last = Rotation.from_quat(motion.chaser_quaternions_xyzw[-1])
        np.testing.assert_allclose(motion.ee_positions[-1], target.position, atol=1e-5)
        flown = verify(first.robot, motion)
        assert flown.passed
        (there,) = Rotation.from_quat(flown.execution.chaser_quaternions_xyzw[-1:])
        assert (there.inv() * last).magnitude() < 1e-4
        return float((wanted.inv() * there).magnitude())

    assert off(task) <= 1e-3 + 1e-4
    assert off(replace(task, problem=replace(problem, chaser_goal=ChaserGoal()))) > 1.2e-3
