"""A free-floating system whose joints move exactly as commanded.

It is the planner's own model of motion, and so no proof of that model. `simulation.execution` runs
plans in an independent engine.
"""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np

from ff_planner_ros.planning.motion.forward import carried_forward, driven
from ff_planner_ros.planning.motion.joint_motion import JointMotion, steady_motion
from ff_planner_ros.planning.motion.system_frame import system_frame
from ff_planner_ros.robot.configuration import configuration, system_state
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.momentum import total_momentum, with_wheel_momenta
from ff_planner_ros.robot.state import SystemState

# One step of RK4 at most [s]; within it a chaser turns by a degree or less.
_LONGEST_STEP = 0.02


class FreeFloatingSystem:
    """Chaser and arm over time; nothing pushes them."""

    def __init__(self, robot: Robot, state: SystemState, time: float) -> None:
        """Start from a state at a time [s]; without a command the joints keep their rates."""
        self._robot = robot
        self._begin = self._time = time
        self._frame, self._first = system_frame(robot, state), state
        self._q, v = configuration(robot, self._frame.start)
        self._v = v
        self._momentum = total_momentum(robot, robot.model.createData(), self._q, v)
        self._motions = [steady_motion(time, time, state.joint_positions, state.joint_velocities)]

    @property
    def time(self) -> float:
        """The time of its present state [s]."""
        return self._time

    def follow(self, motion: JointMotion) -> None:
        """Command the joints.

        They go on as before until the motion begins, and after its end they are held at its last
        point. If the motion begins elsewhere than the joints are, they jump, and the system's
        centre of mass stays.

        Args:
            motion: Begins now or later, and replaces every motion that begins later than itself.
        """
        begin = motion.time[0]
        kept = [told for told in self._motions if told.time[0] < begin]
        end, positions = motion.time[-1], motion.positions[-1]
        held = steady_motion(end, end, positions, np.zeros(self._robot.joints))
        self._motions = [*kept, motion, held]

    def advance(self, time: float) -> SystemState:
        """Go on to a time [s], unless it is over, and return the state there."""
        # No step goes over the begin or the end of a motion.
        edges = sorted({float(edge) for told in self._motions for edge in told.time[[0, -1]]})
        for end in [*(edge for edge in edges if self._time < edge < time), time]:
            if end > self._time:
                self._integrate(end)
        state = system_state(self._robot, self._q, self._v)
        there = self._frame.state_seen_by_user(state, self._time - self._begin)
        return with_wheel_momenta(self._robot, self._first, there)

    def _integrate(self, end: float) -> None:
        """Go on to a time before which no motion begins or ends."""
        while len(self._motions) > 1 and self._motions[1].time[0] <= self._time:
            del self._motions[0]
        steps = int(np.ceil((end - self._time) / _LONGEST_STEP))
        times = np.linspace(self._time, end, steps + 1)
        told = _between(self._motions[0], self._time, end)
        q, v, _ = driven(self._robot, self._q, self._momentum, told, times)
        self._q, self._v, self._time = q[-1], v[-1], end


def carried_back(robot: Robot, state: SystemState, seconds: float) -> SystemState:
    """Return where a system was whose joints have kept their rates since.

    Raises:
        InvalidInput: `seconds` is negative or not finite.
    """
    # Nothing pushes it and nothing rubs: run backwards it moves as it would forwards.
    return _reversed(carried_forward(robot, _reversed(state), seconds, None))


def _reversed(state: SystemState) -> SystemState:
    velocities = "linear_velocity_chaser_in_inertial", "angular_velocity_chaser_in_inertial"
    turned = {name: -getattr(state, name) for name in (*velocities, "joint_velocities")}
    if state.wheel_momenta is not None:
        turned["wheel_momenta"] = -state.wheel_momenta
    return replace(state, **turned)


def _between(motion: JointMotion, begin: float, end: float) -> JointMotion:
    """Return the part of a motion that is needed between two times, to interpolate less.

    Beyond its last point a motion is a steady one: its polynomials would lose digits there.
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
