"""A free-floating system whose joints move exactly as commanded.

It uses the planner's own model of motion, and so proves nothing of that model: plans are executed
in an independent engine by `simulation.execution`. A grasped body becomes part of the last link.
"""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.forward import carried_forward, driven
from ff_planner_ros.planning.motion.joint_motion import JointMotion, steady_motion
from ff_planner_ros.planning.motion.system_frame import system_frame
from ff_planner_ros.planning.problem.target_body import TargetBody
from ff_planner_ros.robot.configuration import configuration, eigen_quaternion, system_state
from ff_planner_ros.robot.impact import Impact, impact
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.momentum import total_momentum, with_wheel_momenta
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.simulation.capture import end_effector_motion

# One step of RK4 at most [s]; within it a chaser turns by a degree or less.
_LONGEST_STEP = 0.02
# Time in which joints return to their motion after a contact has changed their velocities [s].
_SETTLING = 0.5


class FreeFloatingSystem:
    """Chaser and arm without external forces, integrated over time."""

    def __init__(self, robot: Robot, state: SystemState, time: float) -> None:
        """Start from a state at a time [s]; without a command the joints keep their velocities."""
        self._motions = [steady_motion(time, time, state.joint_positions, state.joint_velocities)]
        self._held: tuple[TargetBody, pin.SE3] | None = None  # and its frame in the end effector's
        self._begin_from(robot, state, time)

    def _begin_from(self, robot: Robot, state: SystemState, time: float) -> None:
        self._robot = robot
        self._begin = self._time = time
        self._frame, self._first = system_frame(robot, state), state
        self._q, v = configuration(robot, self._frame.start)
        self._v = v
        self._momentum = total_momentum(robot, robot.model.createData(), self._q, v)

    @property
    def time(self) -> float:
        """Time of the present state [s]."""
        return self._time

    @property
    def body(self) -> TargetBody | None:
        """The held body in its present state; None: there is none."""
        if self._held is None:
            return None
        body, place = self._held
        pose, twist = end_effector_motion(self._robot, self.advance(self._time))
        there = pose * place
        lever = there.translation - pose.translation
        return replace(
            body,
            position=there.translation,
            quaternion_xyzw=eigen_quaternion(there.rotation),
            linear_velocity=twist[:3] + np.cross(twist[3:], lever),
            angular_velocity=twist[3:],
        )

    def grasp(self, body: TargetBody) -> Impact:
        """Grasp a body rigidly in the present state, and return the impact.

        The joints, whose velocities the impact changes, return to their motion in half a second.

        Args:
            body: In its present state, with known mass [kg] and inertia [kg m2].
        """
        before = self.advance(self._time)
        pose, _ = end_effector_motion(self._robot, before)
        attitude = pin.Quaternion(body.quaternion_xyzw).toRotationMatrix()
        place = pose.actInv(pin.SE3(attitude, body.position))
        inertia = place.act(pin.Inertia(body.mass, np.zeros(3), body.inertia))
        rate = body.angular_velocity
        at_tip = body.linear_velocity + np.cross(rate, pose.translation - body.position)
        found = impact(self._robot, inertia, before, np.concatenate([at_tip, rate]))
        self._held = body, place
        self._begin_from(_with_held(self._robot, inertia), found.after, self._time)
        self._forget_ended_motions()
        (_,), (rates,), _ = self._motions[0].at(np.array([self._time]))
        off = found.after.joint_velocities - rates
        self._motions[0] = _settling(self._motions[0], self._time, off)
        return found

    def follow(self, motion: JointMotion) -> None:
        """Command a motion of the joints.

        They continue as before until the motion begins, and stay at its last point after its end.
        If the motion begins elsewhere than the joints are, they jump, and the system's centre of
        mass stays.

        Args:
            motion: Begins now or later, and replaces motions that do not begin before it.
        """
        begin = motion.time[0]
        kept = [told for told in self._motions if told.time[0] < begin]
        end, positions = motion.time[-1], motion.positions[-1]
        held = steady_motion(end, end, positions, np.zeros(self._robot.joints))
        self._motions = [*kept, motion, held]

    def advance(self, time: float) -> SystemState:
        """Integrate to a time [s], unless it has passed, and return the present state."""
        # No step goes across the begin or the end of a motion.
        edges = sorted({float(edge) for told in self._motions for edge in told.time[[0, -1]]})
        for end in [*(edge for edge in edges if self._time < edge < time), time]:
            if end > self._time:
                self._integrate(end)
        state = system_state(self._robot, self._q, self._v)
        there = self._frame.state_seen_by_user(state, self._time - self._begin)
        return with_wheel_momenta(self._robot, self._first, there)

    def _integrate(self, end: float) -> None:
        """Integrate to a time before which no motion begins or ends."""
        self._forget_ended_motions()
        steps = int(np.ceil((end - self._time) / _LONGEST_STEP))
        times = np.linspace(self._time, end, steps + 1)
        told = _between(self._motions[0], self._time, end)
        q, v, _ = driven(self._robot, self._q, self._momentum, told, times)
        self._q, self._v, self._time = q[-1], v[-1], end

    def _forget_ended_motions(self) -> None:
        while len(self._motions) > 1 and self._motions[1].time[0] <= self._time:
            del self._motions[0]


def carried_back(robot: Robot, state: SystemState, seconds: float) -> SystemState:
    """Return the state `seconds` ago of a system whose joint velocities were constant.

    Raises:
        InvalidInput: `seconds` is negative or not finite.
    """
    # Without external forces and friction the motion is reversible.
    return _reversed(carried_forward(robot, _reversed(state), seconds, None))


def _reversed(state: SystemState) -> SystemState:
    velocities = "linear_velocity_chaser_in_inertial", "angular_velocity_chaser_in_inertial"
    turned = {name: -getattr(state, name) for name in (*velocities, "joint_velocities")}
    if state.wheel_momenta is not None:
        turned["wheel_momenta"] = -state.wheel_momenta
    return replace(state, **turned)


def _with_held(robot: Robot, inertia: pin.Inertia) -> Robot:
    """Return a robot with an inertia, given in the end effector's frame, added to the last link."""
    model = robot.model.copy()
    tip = model.frames[robot.tip_frame_id]
    model.appendBodyToJoint(tip.parentJoint, inertia, tip.placement)
    return replace(robot, model=model)


def _settling(motion: JointMotion, now: float, rates: Array) -> JointMotion:
    """Return a motion with a decaying deviation of the joints, as a controller would settle it.

    With s from 0 now to 1 at the end of the settling time T: e = T rates s (1 - s)^3.

    Args:
        rates: Deviation of the joint velocities now. Shape (joints,) [rad/s].
    """
    lasts = min(_SETTLING, float(motion.time[-1]) - now)
    if lasts <= 0.0:  # it is over: nothing brings them back, they are at its end at once
        return motion
    time = np.union1d([now, now + lasts], motion.time[motion.time > now])
    s = np.clip((time - now) / lasts, 0.0, 1.0)[:, None]
    positions, velocities, accelerations = motion.at(time)
    return JointMotion(
        time,
        positions + lasts * rates * s * (1.0 - s) ** 3,
        velocities + rates * (1.0 - s) ** 2 * (1.0 - 4.0 * s),
        accelerations + (6.0 / lasts) * rates * (1.0 - s) * (2.0 * s - 1.0),
    )


def _between(motion: JointMotion, begin: float, end: float) -> JointMotion:
    """Return the part of a motion that is needed between two times, to interpolate less.

    Beyond its last point a motion has constant velocity: its polynomials would lose digits there.
    """
    if begin >= motion.time[-1]:
        rates = motion.velocities[-1]
        passed = begin - motion.time[-1]
        return steady_motion(begin, end, motion.positions[-1] + passed * rates, rates)
    last = len(motion.time) - 1
    first = min(max(int(np.searchsorted(motion.time, begin, side="right")) - 1, 0), last - 1)
    after = min(max(int(np.searchsorted(motion.time, end, side="left")), first + 1), last)
    part = slice(first, after + 1)
    return JointMotion(
        **{item.name: getattr(motion, item.name)[part] for item in fields(motion)},
    )
