"""Replanning in motion: the state at the handover, and the remainder of the running plan.

The arm's controller tracks the running plan, so that the new plan's joints begin exactly on it:
position, velocity and acceleration. The chaser is not controlled: its state is the measured one,
propagated with the joints of the running plan and the measured momentum.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.core.conversions import chain_of, start_of
from ff_planner_ros.planning.motion.forward import carried_forward
from ff_planner_ros.planning.motion.joint_motion import JointMotion
from ff_planner_ros.planning.motion.system_frame import system_frame
from ff_planner_ros.planning.paths.path_family import PathFamily
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.robot.configuration import configuration, system_state
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.momentum import base_twist, total_momentum, with_wheel_momenta
from ff_planner_ros.robot.state import SystemState

# Number of times at which a remainder is sampled: paths of both families can follow them.
SAMPLES = 17
# A path whose joints are never further from the remainder's counts as equal to it [rad].
NEAR = 0.02


@dataclass(frozen=True, eq=False)
class PathNear:
    """The path of one family that is nearest to a remainder; it need not meet the goal."""

    family: PathFamily
    x: Array  # decision variables
    off: float  # largest difference of its joints from the remainder's; infinite: singular [rad]


@dataclass(frozen=True, eq=False)
class Remainder:
    """The remainder of a running plan, from the handover to its goal."""

    joints: JointMotion  # of the running plan, time zero at the handover
    goal: float  # time of its goal, greater than zero [s]

    def path_near(self, problem: PlanningProblem, family: PathFamily) -> PathNear:
        """Return the path of a family that is nearest to the remainder.

        If the problem has another duration, time is scaled.

        Args:
            problem: That of the family; it starts at the handover.
        """
        robot = problem.robot
        start = start_of(robot, *configuration(robot, problem.start))
        half_steps = self.joints.at(np.linspace(0.0, self.goal, 2 * SAMPLES - 1))
        q = compiled.DrivenMotion(chain_of(robot), start, *half_steps, self.goal).q
        x = family.near(q)
        path = family.motion(x, SAMPLES)
        if path.singular_at is not None:
            return PathNear(family, x, np.inf)
        return PathNear(family, x, float(np.abs(path.q[:, 7:] - q[:, 7:]).max()))


def joined(robot: Robot, state: SystemState, ahead: float, running: JointMotion) -> SystemState:
    """Return the state of a system at the handover from the running plan to another one.

    Args:
        state: As measured.
        ahead: Time from the measurement to the handover [s].
        running: Time zero at the measurement; it must not end before the handover.
    """
    (positions,), (rates,), (accelerations,) = running.at(np.array([ahead]))
    # In the system's own frame no digit is lost to where it is.
    frame = system_frame(robot, carried_forward(robot, state, ahead, running))
    q, v = configuration(robot, frame.start)
    data = robot.model.createData()
    momentum = total_momentum(robot, data, q, v)
    q = np.concatenate([q[:7], positions])
    v = np.concatenate([base_twist(robot, data, q, momentum, rates), rates])
    there = frame.state_seen_by_user(system_state(robot, q, v), 0.0)
    there = replace(there, joint_accelerations=accelerations)
    return with_wheel_momenta(robot, state, there)
