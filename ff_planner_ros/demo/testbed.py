"""A simulated chaser on ROS: publishes its state, follows trajectories, grasps, in real time."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np
import pinocchio as pin
from ff_planner_msgs.msg import (
    ChaserState,
    PlanAnswer,
)
from rclpy.node import Node
from scipy.spatial.transform import Rotation
from trajectory_msgs.msg import JointTrajectory

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.common.times import NANOSECONDS, nanoseconds
from ff_planner_ros.demo.waiting import Wait
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.motion.joint_motion import JointMotion
from ff_planner_ros.planning.problem.problem import PlanningProblem, carried
from ff_planner_ros.planning.problem.target_body import TargetBody as FreeBody
from ff_planner_ros.planning.scenario.scenario import SCENARIO_FRAME
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.ros.messages.joint_names import joint_order
from ff_planner_ros.ros.messages.to_messages import (
    scene_message,
    state_message,
    target_body_message,
)
from ff_planner_ros.ros.qos import create_publisher
from ff_planner_ros.ros.topics import CHASER_STATE, OBSTACLES, TARGET_BODY
from ff_planner_ros.simulation.capture import captured
from ff_planner_ros.simulation.free_floating import FreeFloatingSystem, carried_back

# Where an arm's trajectory controller listens.
CONTROLLER_TOPIC = "arm_controller/joint_trajectory"
# Rate at which the target body is measured [Hz].
_BODY_RATE = 10.0
# Largest errors to the grasp at which the end effector closes on it [m], [rad].
REACH = 0.02, float(np.deg2rad(2.0))


@dataclass(frozen=True)
class Imperfections:
    """Deviations of a testbed from its model: noise (standard deviations), delays, errors."""

    position_noise: float = 0.0  # of the chaser's position [m]
    angle_noise: float = 0.0  # of the chaser's attitude about each axis, and of each joint [rad]
    velocity_noise: float = 0.0  # of the chaser's velocity [m/s]
    rate_noise: float = 0.0  # of the chaser's angular velocity and each joint's velocity [rad/s]
    state_delay: float = 0.0  # from measuring a state to publishing it [s]
    command_delay: float = 0.0  # of the joints behind a trajectory [s]
    rate_bias: float = 0.0  # of the chaser's measured angular velocity about each axis [rad/s]
    arm_heavier: float = 0.0  # relative excess of the arm's masses and inertias over the model's
    seed: int = 0  # of the noise


class SimulatedTestbed:
    """A scenario in real time: obstacles, a chaser that drifts and follows trajectories, a target.

    The target body, if there is one, moves freely until the end of a phase that captures it and
    has a successor. If the end effector is within `REACH` of the grasp then, there is an impact,
    and the body moves with the end effector from then on.
    """

    def __init__(
        self,
        node: Node,
        scenario: PlanningProblem,
        body: FreeBody | None,
        epoch_ns: int | None,
        state_rate: float,
        imperfections: Imperfections,
        lead: float = 0.0,
    ) -> None:
        """Create the publishers, timers and subscriptions of the testbed.

        Args:
            node: Its clock is the testbed's, simulated time included.
            body: Body that a phase captures, in its state at the epoch; None: there is none.
            epoch_ns: When the chaser passes through the start state [ns]. Before and after, until a
                trajectory begins, it drifts and its joints keep their velocities. None: it waits
                for its first plan, at the state that leads to the start state within `lead`.
            state_rate: Rate of the published states [Hz].
            lead: Time from a request to the start of its plan [s]; without effect with an epoch.
        """
        self._scenario, self._imperfections = scenario, imperfections
        self._lead_ns = round(lead * NANOSECONDS)
        self._period_ns = round(NANOSECONDS / state_rate)
        self._clock, self._logger = node.get_clock(), node.get_logger()
        self._random = np.random.default_rng(imperfections.seed)
        self._waiting: deque[ChaserState] = deque()
        self._last_stamp_ns = 0  # of a state

        self._body = body
        self._plan_ns = 0  # start of the plan that is followed
        self._grasps_ns = dict[int, int]()  # moment of the grasp by the start of the plan
        self._wait = Wait(node, self._hear_plan)
        if epoch_ns is not None:
            self._wait.end()
        now_ns = self._clock.now().nanoseconds
        # While the testbed waits, body and chaser are published at different times, each with an
        # epoch of its own.
        self._epoch_ns = self._body_epoch_ns = (
            now_ns + self._lead_ns if epoch_ns is None else epoch_ns
        )
        self._begin = min(self._seconds(now_ns), 0.0)
        self._first = carried_back(scenario.robot, scenario.start, -self._begin)
        self._true = with_heavier_arm(scenario.robot, imperfections.arm_heavier)
        self._system = FreeFloatingSystem(self._true, self._first, self._begin)

        self._name = node.get_name()
        self._obstacles = create_publisher(node, OBSTACLES)
        self._publish_obstacles()
        if any(one.moves for one in scenario.obstacles):
            node.create_timer(1.0 / _BODY_RATE, self._hold_obstacles)
        self._states = create_publisher(node, CHASER_STATE)
        node.create_timer(1.0 / state_rate, self._publish_state)
        self._bodies = create_publisher(node, TARGET_BODY)
        if body is not None:
            node.create_timer(1.0 / _BODY_RATE, partial(self._publish_body, body))
        node.create_subscription(JointTrajectory, CONTROLLER_TOPIC, self._follow, 10)

    def _seconds(self, time_ns: int) -> float:
        """Return the time since the epoch [s]; it keeps more digits than ROS time in seconds."""
        return (time_ns - self._epoch_ns) / NANOSECONDS

    def _publish_obstacles(self) -> None:
        stamp_ns = self._clock.now().nanoseconds
        free = tuple(one for one in self._scenario.obstacles if one.body is None)
        since_epoch = self._begin if self._wait.stands_still() else self._seconds(stamp_ns)
        there = carried(free, since_epoch)
        self._obstacles.publish(scene_message(there, stamp_ns, SCENARIO_FRAME, self._name))

    def _hold_obstacles(self) -> None:
        if self._wait.stands_still():
            self._publish_obstacles()

    def _publish_state(self) -> None:
        now_ns = self._clock.now().nanoseconds
        # At multiples of the period, as by a sensor with its own clock.
        stamp_ns = now_ns - now_ns % self._period_ns
        if stamp_ns > self._last_stamp_ns and self._seconds(stamp_ns) > self._begin:
            self._last_stamp_ns = stamp_ns
            if self._wait.stands_still():
                self._set_back(stamp_ns)
            self._grasp_if_due(stamp_ns)
            state = with_sensor_noise(
                self._system.advance(self._seconds(stamp_ns)), self._imperfections, self._random
            )
            names = self._scenario.robot.joint_names
            self._waiting.append(state_message(state, names, stamp_ns, SCENARIO_FRAME))
        due_ns = now_ns - round(self._imperfections.state_delay * NANOSECONDS)
        while self._waiting and nanoseconds(self._waiting[0].header.stamp) <= due_ns:
            self._states.publish(self._waiting.popleft())

    def _set_back(self, stamp_ns: int) -> None:
        """Move the epoch, so that the system is in its first state at a stamp."""
        self._epoch_ns = stamp_ns + self._lead_ns
        if self._system.time > self._begin:
            self._system = FreeFloatingSystem(self._true, self._first, self._begin)

    def _grasp_if_due(self, now_ns: int) -> None:
        """Grasp the body if the plan that is followed has reached its grasp."""
        grasp_ns = self._grasps_ns.get(self._plan_ns, now_ns + 1)
        if self._body is None or grasp_ns > now_ns:
            return
        del self._grasps_ns[self._plan_ns]
        state = self._system.advance(self._seconds(grasp_ns))
        ahead = (self._epoch_ns - self._body_epoch_ns) / NANOSECONDS
        body = self._body.after(self._system.time + ahead)
        found = captured(self._true, state, body)
        apart, turned = found.position_error, found.orientation_error
        where = f"{1e3 * apart:.2f} mm and {np.rad2deg(turned):.3f} deg from the grasp"
        if apart > REACH[0] or turned > REACH[1]:
            reach = f"{1e3 * REACH[0]:g} mm, {np.rad2deg(REACH[1]):g} deg"
            self._logger.error(f"no contact: {where}, the end effector closes within {reach}")
            return
        impulse = self._system.grasp(body).impulse_in_ee
        linear, angular = np.linalg.norm(impulse.reshape(2, 3), axis=1)
        self._logger.info(f"contact: {where}, impulse {linear:.4g} N s, {angular:.4g} N m s")

    def _hear_plan(self, answer: PlanAnswer) -> None:
        """Note the time of a plan's grasp; set the epochs if the testbed still waits."""
        starts_ns = [nanoseconds(one.joint_trajectory.header.stamp) for one in answer.plans]
        for plan, (_, next_ns) in zip(answer.plans, pairwise(starts_ns), strict=False):
            if plan.target_path.poses:
                self._grasps_ns[starts_ns[0]] = next_ns
        if not self._wait.is_over:
            self._begin_as_planned_from(answer)

    def _begin_as_planned_from(self, answer: PlanAnswer) -> None:
        """Set the epochs by the states that a plan was made from, of the many published."""
        inputs = answer.inputs
        if inputs.state_source == CHASER_STATE.name:
            state_stamp_ns = nanoseconds(inputs.state_stamp)
            self._epoch_ns = min(self._epoch_ns, state_stamp_ns + self._lead_ns)
        if body_stamp_ns := nanoseconds(inputs.target_body_stamp):
            self._body_epoch_ns = min(self._body_epoch_ns, body_stamp_ns + self._lead_ns)

    def _publish_body(self, body: FreeBody) -> None:
        """Publish the state of a body, free until it is held; `body` is its state at the epoch."""
        if (held := self._system.body) is not None:
            # Its state is that of the last measurement.
            self._bodies.publish(target_body_message(held, self._last_stamp_ns, SCENARIO_FRAME))
            return
        now_ns = self._clock.now().nanoseconds
        if self._wait.stands_still():
            self._body_epoch_ns = now_ns + self._lead_ns
        there = body.after((now_ns - self._body_epoch_ns) / NANOSECONDS)
        self._bodies.publish(target_body_message(there, now_ns, SCENARIO_FRAME))

    def _follow(self, message: JointTrajectory) -> None:
        try:
            motion = motion_from_message(message, self._scenario.robot.joint_names)
        except InvalidInput as error:
            self._logger.error(f"trajectory refused: {error}")
            return
        begin_ns = self._plan_ns = nanoseconds(message.header.stamp)
        if begin_ns and self._wait.stands_still():  # no request was seen, but its start is known
            self._epoch_ns = min(self._epoch_ns, begin_ns)
        self._wait.end()
        begin = self._seconds(begin_ns)
        now = max(self._seconds(self._clock.now().nanoseconds), self._system.time)
        if begin_ns == 0:
            begin = now
        elif begin < now:
            # To jump to where the joints should be by now would be no free-floating motion.
            self._logger.warning(f"the trajectory came {now - begin:.3f} s late and begins now")
        begin = max(begin + self._imperfections.command_delay, now)
        self._system.follow(replace(motion, time=begin + motion.time))
        self._logger.info(
            f"following {len(motion.time)} points, from {begin - now:.3f} s from now on, "
            f"for {motion.time[-1]:g} s"
        )


def motion_from_message(message: JointTrajectory, joint_names: Sequence[str]) -> JointMotion:
    """Read a joint trajectory, its joints in any order; times are relative to its start.

    Raises:
        InvalidInput: A joint is missing or unknown, or the points cannot be followed.
    """
    order = joint_order("joint_names", message.joint_names, joint_names)
    times = np.array([nanoseconds(point.time_from_start) for point in message.points]) / NANOSECONDS
    if len(times) < 2 or not (np.diff(times) > 0.0).all():
        allowed = "it must have two points or more, at times that increase"
        raise InvalidInput(
            Status.CONTROLLER_CONSTRAINT, "points", f"at {times.tolist()} s", allowed
        )
    columns: list[Array] = []
    for name in ("positions", "velocities", "accelerations"):
        rows = [getattr(point, name) for point in message.points]
        sizes = {len(row) for row in rows}
        if sizes != {len(order)} or not np.isfinite(rows).all():
            allowed = f"it must be {len(order)} finite numbers in every point"
            found = f"of {', '.join(map(str, sorted(sizes)))} numbers"
            raise InvalidInput(Status.CONTROLLER_CONSTRAINT, f"points[].{name}", found, allowed)
        columns.append(np.array(rows)[:, order])
    return JointMotion(times, *columns)


def with_heavier_arm(robot: Robot, part: float) -> Robot:
    """Return a robot with the arm's masses and inertias multiplied by 1 + `part`."""
    if part == 0.0:
        return robot
    model = robot.model.copy()
    for index in range(2, model.njoints):  # the first is the universe's, the second the base's
        inertia = model.inertias[index]
        more = 1.0 + part
        model.inertias[index] = pin.Inertia(
            more * inertia.mass, inertia.lever, more * inertia.inertia
        )
    return replace(robot, model=model)


def with_sensor_noise(
    state: SystemState, imperfections: Imperfections, random: np.random.Generator
) -> SystemState:
    """Return a state as the testbed's sensors measure it."""

    def noise(sigma: float, like: Array) -> Array:
        return random.normal(scale=sigma, size=like.shape)

    off = imperfections
    turn = Rotation.from_rotvec(noise(off.angle_noise, np.zeros(3)))
    attitude = Rotation.from_quat(state.quaternion_chaser_to_inertial_xyzw)
    position, velocity = state.position_chaser_in_inertial, state.linear_velocity_chaser_in_inertial
    omega = state.angular_velocity_chaser_in_inertial
    joints, rates = state.joint_positions, state.joint_velocities
    return SystemState(
        position_chaser_in_inertial=position + noise(off.position_noise, position),
        quaternion_chaser_to_inertial_xyzw=(turn * attitude).as_quat(),
        linear_velocity_chaser_in_inertial=velocity + noise(off.velocity_noise, velocity),
        angular_velocity_chaser_in_inertial=omega + off.rate_bias + noise(off.rate_noise, omega),
        joint_positions=joints + noise(off.angle_noise, joints),
        joint_velocities=rates + noise(off.rate_noise, rates),
    )
