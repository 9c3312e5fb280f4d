"""A controller takes over plan after plan without a jump, whichever way it takes them over.

The controllers are written out as ros2_controllers documents its `joint_trajectory_controller`:
where positions, velocities and accelerations are given it goes on the quintic between two points;
times are those of the header's stamp plus `time_from_start`; behind the last point it holds still.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from test_continuing import AHEAD, SETTINGS, TURN_ERROR, continuing, off
from trajectory_msgs.msg import JointTrajectory

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.common.times import NANOSECONDS, nanoseconds
from ff_planner_ros.demo.testbed import motion_from_message, with_heavier_arm
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import Parametrisation, PlanningProblem
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.ros.messages.to_messages import controller_message, plan_message
from ff_planner_ros.simulation.free_floating import FreeFloatingSystem

BEGIN_NS = 1_763_000_000 * NANOSECONDS + 123_456_789  # of the first plan, as clocks are
SINCE = (0.9, 1.1, 4.0, 6.3, 8.5)  # measurements, from the first plan's first point [s]

Desired = tuple[Array, Array, Array]  # positions, rates and accelerations, each of shape (joints,)


def quintic(begin: Desired, end: Desired, duration: float, t: float) -> Desired:
    """The polynomial of degree five between two states: six conditions for six coefficients."""

    def rows(at: float) -> Array:
        powers = np.arange(6)
        rates = powers * at ** np.maximum(powers - 1, 0)
        accelerations = powers * (powers - 1) * at ** np.maximum(powers - 2, 0)
        return np.array([at**powers, rates, accelerations])

    # In parts of the duration, where the conditions are well-scaled.
    scale = duration ** np.arange(3)[:, None]
    conditions = np.vstack([rows(0.0), rows(1.0)])
    values = np.vstack([scale * np.array(begin), scale * np.array(end)])
    position, rate, acceleration = rows(t / duration) @ np.linalg.solve(conditions, values) / scale
    return position, rate, acceleration


@dataclass
class Controller:
    """A controller that has received trajectories, and what it wants of the joints."""

    # Whether it forgets its trajectory when it receives the next, and goes from where it is then
    # straight to the new one's first point; else it goes on with the old one until the new one's
    # stamp (`allow_trajectory_replacement`).
    forgets: bool
    # Since when each counts, and its points: when they are to be reached, increasing [ns]
    trajectories: list[tuple[int, list[tuple[int, Desired]]]] = field(default_factory=list)

    def receive(self, message: JointTrajectory, now_ns: int) -> None:
        stamp_ns = nanoseconds(message.header.stamp)
        assert stamp_ns > now_ns
        points = [
            (
                stamp_ns + nanoseconds(point.time_from_start),
                (
                    np.array(point.positions),
                    np.array(point.velocities),
                    np.array(point.accelerations),
                ),
            )
            for point in message.points
        ]
        if self.forgets and self.trajectories:
            here = (now_ns, self.desired(now_ns))
            self.trajectories.append((now_ns, [here, *points]))
        else:
            self.trajectories.append((stamp_ns, points))

    def desired(self, at_ns: int) -> Desired:
        points = next(points for since, points in self.trajectories[::-1] if since <= at_ns)
        after = next((k for k, one in enumerate(points) if one[0] > at_ns), None)
        if after is None:  # it holds still
            position = points[-1][1][0]
            return position, 0.0 * position, 0.0 * position
        (begin_ns, begin), (end_ns, end) = points[after - 1 : after + 1]
        seconds = (end_ns - begin_ns) / NANOSECONDS, (at_ns - begin_ns) / NANOSECONDS
        return quintic(begin, end, *seconds)


Published = tuple[int, JointTrajectory]  # with the time at which it is heard [ns]


def published(plan: Plan, stamp_ns: int) -> JointTrajectory:
    written = plan_message(plan, stamp_ns, "inertial")
    return controller_message(written.joint_trajectory, effort_interface=False)


@pytest.fixture(scope="module", params=["end_effector_polynomial", "joint_spline"])
def takeovers(request: pytest.FixtureRequest, lemur_capture: PlanningProblem) -> list[Published]:
    """Plans that take over from each other; the chaser is not where it is expected, each time."""
    problem = replace(lemur_capture, parametrisation=Parametrisation(request.param))
    names, begin = problem.robot.joint_names, problem.start
    system = FreeFloatingSystem(with_heavier_arm(problem.robot, 0.05), begin, 0.0)
    found = [
        (BEGIN_NS - NANOSECONDS, published(perform(PlanningTask(problem, SETTINGS)), BEGIN_NS))
    ]
    for since in SINCE:
        message = found[-1][1]
        motion = motion_from_message(message, names)
        begun = (nanoseconds(message.header.stamp) - BEGIN_NS) / NANOSECONDS
        motion = replace(motion, time=motion.time + begun)
        system.follow(motion)
        measured = off(system.advance(since), np.zeros(7), TURN_ERROR)
        made = perform(continuing(problem, motion, since, measured))
        heard_ns = BEGIN_NS + round(since * NANOSECONDS)
        found.append((heard_ns, published(made, heard_ns + round(AHEAD * NANOSECONDS))))
    return found


def worst(one: Desired, other: Desired) -> list[float]:
    return [float(np.abs(a - b).max()) for a, b in zip(one, other, strict=True)]


def test_a_controller_that_waits_for_the_stamp_changes_over_without_a_jump(
    takeovers: list[Published],
) -> None:
    controller = Controller(forgets=False)
    for heard_ns, message in takeovers:
        stamp_ns = nanoseconds(message.header.stamp)
        running = None if not controller.trajectories else controller.desired(stamp_ns)
        controller.receive(message, heard_ns)
        if running is not None:  # what is left is that times are told in whole nanoseconds
            jumps = worst(controller.desired(stamp_ns), running)
            assert max(jumps) < 1e-8, (heard_ns, jumps)
            assert np.abs(running[1]).max() > 1e-3  # it moves meanwhile


def test_a_controller_that_forgets_stays_near_the_running_plan_and_never_jumps(
    takeovers: list[Published],
) -> None:
    """It goes straight to the first point of the new plan; that is on the running one."""
    forgetful, patient = Controller(forgets=True), Controller(forgets=False)
    for heard_ns, message in takeovers:
        moving = bool(forgetful.trajectories)
        stamp_ns = nanoseconds(message.header.stamp)
        before = forgetful.desired(heard_ns) if moving else None
        for controller in (forgetful, patient):
            controller.receive(message, heard_ns)
        if before is None:
            continue
        assert max(worst(forgetful.desired(heard_ns), before)) < 1e-9
        between = np.linspace(heard_ns, stamp_ns, 21)[:-1].astype(int)
        off_by = [worst(forgetful.desired(int(t)), patient.desired(int(t))) for t in between]
        positions, rates, _ = np.max(off_by, axis=0)
        assert positions < 1e-5, heard_ns
        assert rates < 1e-3, heard_ns
        arrived = worst(forgetful.desired(stamp_ns - 1), forgetful.desired(stamp_ns))
        assert max(arrived) < 1e-7, (heard_ns, arrived)


def test_the_rule_that_is_written_out_here_is_that_of_our_own_controller(
    takeovers: list[Published], lemur_capture: PlanningProblem
) -> None:
    """The simulated testbed moves its joints as this rule says."""
    _, message = takeovers[0]
    controller = Controller(forgets=False)
    controller.receive(message, BEGIN_NS - 1)
    motion = motion_from_message(message, lemur_capture.robot.joint_names)
    for at_ns in np.random.default_rng(3).integers(0, 10 * NANOSECONDS, 20).tolist():
        ours = [rows[0] for rows in motion.at(np.array([at_ns / NANOSECONDS]))]
        assert max(worst(controller.desired(BEGIN_NS + at_ns), (ours[0], ours[1], ours[2]))) < 1e-8
