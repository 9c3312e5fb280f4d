"""A whole capture flown by two free bodies that a weld joins comes out as predicted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from robots import CONFIG

from ff_planner_benchmark.problems import captured as drawn
from ff_planner_ros.cli import main
from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.joint_motion import joint_motion
from ff_planner_ros.planning.motion.motion import state_at
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.scenario.scenario import Defaults, load_task
from ff_planner_ros.planning.task.planning_task import PlanningTask
from ff_planner_ros.planning.task.task import perform
from ff_planner_ros.planning.task.whole import whole
from ff_planner_ros.robot.model import Base
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.simulation.capture import captured, end_effector_motion
from ff_planner_ros.simulation.free_floating import FreeFloatingSystem
from ff_planner_ros.simulation.whole_flight import Reached, fly

SETTINGS = load_parameters().planner
# Asked for: at the grasp, and at the end [m], [rad].
AT_GRASP, AT_END = np.array([1e-3, np.deg2rad(0.1)]), np.array([5e-3, np.deg2rad(0.5)])

pytestmark = pytest.mark.ci


@pytest.fixture(scope="module")
def flown() -> tuple[PlanningTask, Plan]:
    task = load_task(CONFIG / "scenarios/whole_capture.yaml", Defaults(SETTINGS))
    return task, perform(task)


def test_the_whole_capture_is_flown_as_planned(flown: tuple[PlanningTask, Plan]) -> None:
    grasped, stopped, stowed = fly(*flown)
    assert (np.array([grasped.grasp, grasped.end_effector]) < AT_GRASP).all()
    for one in (stopped, stowed):
        assert (np.array([one.end_effector, one.chaser]) < AT_END).all()
        # The weld holds: the grasp is where it was.
        np.testing.assert_allclose(one.grasp, grasped.grasp, atol=1e-6)


def test_another_mass_than_planned_with_ends_elsewhere(flown: tuple[PlanningTask, Plan]) -> None:
    task, plan = flown
    body = task.problem.target_body
    assert body is not None
    heavy = replace(body, mass=2.0 * body.mass, inertia=2.0 * body.inertia)
    true = replace(task, problem=replace(task.problem, target_body=heavy))
    *_, stowed = fly(true, plan)
    assert stowed.chaser[0] > 10.0 * AT_END[0]


def flown_without_engine(task: PlanningTask, plan: Plan) -> list[Reached]:
    """Fly as the simulated testbed does: a system that makes contact at the grasp."""
    robot, body = task.problem.robot, task.problem.target_body
    assert body is not None
    system = FreeFloatingSystem(robot, state_at(plan.trajectory, 0), time=0.0)
    system.follow(joint_motion(whole(plan).trajectory))
    reached = list[Reached]()
    for begin, one in zip(plan.begins, plan.phases, strict=True):
        motion, end = one.trajectory, begin + float(one.trajectory.time[-1])
        state = system.advance(end)
        if not reached:
            system.grasp(body.after(end))
        planned = state_at(motion, -1)
        seen, there = (end_effector_motion(robot, at)[0] for at in (state, planned))
        held = system.body
        assert held is not None
        grasp = captured(robot, state, held)
        reached.append(
            Reached(
                end_effector=apart(seen, there),
                chaser=apart(chaser(state), chaser(planned)),
                grasp=(grasp.position_error, grasp.orientation_error),
            )
        )
    return reached


def chaser(state: SystemState) -> pin.SE3:
    turn = pin.Quaternion(state.quaternion_chaser_to_inertial_xyzw)
    return pin.SE3(turn, state.position_chaser_in_inertial)


def apart(one: pin.SE3, other: pin.SE3) -> tuple[float, float]:
    way = np.linalg.norm(one.translation - other.translation)
    turn = pin.log3(one.rotation.T @ other.rotation)
    return float(way), float(np.linalg.norm(turn))


def test_the_testbeds_contact_does_what_a_weld_of_two_bodies_does(
    flown: tuple[PlanningTask, Plan],
) -> None:
    """Another mass than planned with, 4 mm beside the grasp, at 20 mm/s and 1 deg/s from it."""
    task, plan = flown
    body = task.problem.target_body
    assert body is not None
    at_grasp = body.after(plan.begins[1])
    way, rate = np.array([0.02, -0.01, 0.01]), np.deg2rad([0.5, -0.6, 0.6])
    off = replace(
        at_grasp,
        mass=1.5 * body.mass,
        inertia=1.5 * body.inertia,
        position=at_grasp.position + np.array([0.003, 0.001, -0.002]),
        linear_velocity=at_grasp.linear_velocity + way,
        angular_velocity=at_grasp.angular_velocity + rate,
    ).after(-plan.begins[1])
    true = replace(task, problem=replace(task.problem, target_body=off))
    welded, here = fly(true, plan), flown_without_engine(true, plan)
    for one, other in zip(welded, here, strict=True):
        for name in ("end_effector", "chaser", "grasp"):
            found, expected = getattr(other, name), getattr(one, name)
            np.testing.assert_allclose(found, expected, rtol=1e-3, atol=3e-5)
    # It made a difference: contact and mass carry the chaser away from the plan.
    assert here[-1].chaser[0] > 20.0 * AT_END[0]


@pytest.mark.sampled
@pytest.mark.parametrize("number", range(4))
def test_whole_captures_of_the_benchmark_come_true(number: int) -> None:
    task = drawn.problem("whole capture", number).task(SETTINGS)
    reached = fly(task, perform(task))
    assert (np.array(reached[0].grasp) < AT_GRASP).all()
    assert (np.array([reached[-1].end_effector, reached[-1].chaser]) < AT_END).all()


def test_what_captures_nothing_is_refused(flown: tuple[PlanningTask, Plan]) -> None:
    task, plan = flown
    still = replace(task.problem, target_body=None, obstacles=(), allowed_collisions=())
    with pytest.raises(InvalidInput, match=r"target_body is missing: .* captures a body first"):
        fly(replace(task, problem=still, then=()), plan)


def test_a_base_that_is_not_free_is_refused_by_its_name(flown: tuple[PlanningTask, Plan]) -> None:
    task, plan = flown
    held = replace(task.problem.robot, base=Base.ATTITUDE_HELD)
    with pytest.raises(InvalidInput, match=r"robot\.base is attitude_held: .* free chaser"):
        fly(replace(task, problem=replace(task.problem, robot=held)), plan)


@pytest.mark.nightly
def test_the_demonstration_flies_it_over_ros_and_in_mujoco(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["demo", "whole_capture", "--output", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert "replay of the bag: identical" in said
    for where in ("over ROS", "in MuJoCo"):
        table = said.partition(f"Deviations from the prediction, {where}\n")[2].splitlines()[1:4]
        off = np.array([line.split() for line in table], float)[:, 1:].reshape(3, 3, 2)
        end_effector, chaser, grasp = np.swapaxes(off * [1e-3, np.pi / 180.0], 0, 1)
        assert (np.array([end_effector[0], grasp[0]]) < AT_GRASP).all()
        assert (np.array([end_effector, chaser, grasp]) < AT_END).all()
