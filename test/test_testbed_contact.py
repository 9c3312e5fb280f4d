"""The simulated testbed makes contact at a grasp that phases follow, as its messages show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from ros_processes import FRAME
from scipy.spatial.transform import Rotation
from test_contact import momentum_of_body, momentum_of_links
from test_testbed import Watcher, running_testbed, stamp, steady
from test_tumbling import moved

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.demo.testbed import motion_from_message
from ff_planner_ros.errors import Status
from ff_planner_ros.planning.motion.forward import carried_forward
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.target_body import TargetBody
from ff_planner_ros.ros.messages.from_messages import state_from_message, target_body_from_message
from ff_planner_ros.simulation.capture import captured, end_effector_motion

GRASP = 0.2  # from the plan's start [s]


def beside(problem: PlanningProblem, off: Array) -> TargetBody:
    """A body at the start whose grasp is off from the end effector at the time of the grasp.

    It moves past the end effector by about a decimetre a second, and turns.
    """
    names, start = list(problem.robot.joint_names), problem.start
    motion = motion_from_message(steady(names, start.joint_positions, 0), names)
    pose, twist = end_effector_motion(
        problem.robot, carried_forward(problem.robot, start, GRASP, motion)
    )
    grasp = np.array([0.3, 0.0, 0.2])
    body = TargetBody(
        position=pose.translation + off - grasp,
        quaternion_xyzw=np.array([0.0, 0.0, 0.0, 1.0]),
        inertia=np.diag([90.0, 35.0, 100.0]),
        grasp_position=grasp,
        grasp_quaternion_xyzw=Rotation.from_matrix(pose.rotation).as_quat(),
        linear_velocity=twist[:3] + np.array([0.1, -0.05, 0.05]),
        angular_velocity=np.array([0.05, 0.1, -0.1]),
        mass=150.0,
    )
    return body.after(-GRASP)


def flown(problem: PlanningProblem, body: TargetBody) -> tuple[Watcher, int]:
    """Follow a plan of two phases in a testbed with a body; return who watched, and the grasp."""
    names = list(problem.robot.joint_names)
    with running_testbed(replace(problem, target_body=body), epoch=0.8) as (watcher, epoch_ns):
        watcher.wait_until_heard()
        grasp_ns = epoch_ns + round(GRASP * NANOSECONDS)
        plan = steady(names, problem.start.joint_positions, epoch_ns)
        watcher.tell_result(Status.SOLVED, plan, steady(names, np.zeros(len(names)), grasp_ns))
        watcher.controller.publish(plan)
        late_ns = grasp_ns + NANOSECONDS // 10
        watcher.wait_until(lambda: watcher.bodies and stamp(watcher.bodies[-1]) > late_ns)
    return watcher, grasp_ns


def test_at_the_grasp_two_bodies_become_one(lemur_capture: PlanningProblem) -> None:
    robot, off = lemur_capture.robot, np.array([0.004, 0.002, -0.003])
    watcher, grasp_ns = flown(lemur_capture, beside(lemur_capture, off))
    states = {stamp(m): state_from_message(m, "chaser_state", robot, FRAME) for m in watcher.states}
    bodies = {stamp(m): target_body_from_message(m, FRAME) for m in watcher.bodies}
    before = [momentum_of_links(robot, one) for at, one in states.items() if at < grasp_ns]
    free = [momentum_of_body(one) for at, one in bodies.items() if at < grasp_ns]
    total = before[-1] + free[-1]
    # Of some moments only the body was heard: states are sent best effort.
    held = {at: one for at, one in bodies.items() if at > grasp_ns and at in states}
    assert held
    for at, body in held.items():
        # Told as of the same moment as a state.
        there = momentum_of_links(robot, states[at]) + momentum_of_body(body)
        np.testing.assert_allclose(there, total, rtol=1e-6, atol=1e-5)
        found = captured(robot, states[at], body)
        assert found.position_error == pytest.approx(float(np.linalg.norm(off)), abs=1e-6)
        assert max(found.linear_speed, found.angular_speed) < 1e-8
    # The arm took a part of the motion: its own momentum is another one.
    after = momentum_of_links(robot, next(s for at, s in states.items() if at > grasp_ns))
    assert np.abs(after - before[-1]).max() > 0.1


def test_beside_the_grasp_there_is_no_contact(
    lemur_capture: PlanningProblem, capfd: pytest.CaptureFixture[str]
) -> None:
    body = beside(lemur_capture, np.array([0.0, 0.03, 0.0]))
    watcher, grasp_ns = flown(lemur_capture, body)
    assert "no contact: 30.00 mm and 0.000 deg from the grasp" in capfd.readouterr().err
    last = target_body_from_message(watcher.bodies[-1], FRAME)
    since = (stamp(watcher.bodies[-1]) - grasp_ns) / NANOSECONDS + GRASP
    (center,), _, (rate,) = moved(body, np.array([since]))
    np.testing.assert_allclose(last.position, center, atol=1e-9)
    np.testing.assert_allclose(last.angular_velocity, rate, atol=1e-9)
