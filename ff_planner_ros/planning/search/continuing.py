"""To plan while a plan runs: where the new plan joins, and what remains of the running one.

The arm's controller tracks the running plan, so that the new plan's joints begin exactly on it:
position, rate and acceleration. Nobody controls the chaser: it is where it was measured, carried
forward with the joints of the running plan, and it keeps the momentum that was measured.
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

# What remains of a plan is looked at at so many times: a path of either family follows them.
SAMPLES = 17
# A path whose joints are never further from the remainder's is one that runs as that does [rad].
NEAR = 0.02


@dataclass(frozen=True, eq=False)
class PathNear:
    """The path of one family that is most like a remainder; it need not be at the goal."""

    family: PathFamily
    x: Array  # decision variables
    off: float  # how far its joints are from the remainder's at most; infinite: singular [rad]


@dataclass(frozen=True, eq=False)
class Remainder:
    """What remains of a running plan, from where another one joins it to its goal."""

    joints: JointMotion  # the running plan, its time counted from the join
    goal: float  # time of its goal, greater than zero [s]

    def path_near(self, problem: PlanningProblem, family: PathFamily) -> PathNear:
        """Return the path of a family that runs as the remainder does.

        Where the problem has another duration, it is run through faster or slower.

        Args:
            problem: That of the family; its start is where it joins.
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
    """Return where a system will be when another plan takes over from the one that runs.

    Args:
        state: As measured.
        ahead: Time from the measurement to the join [s].
        running: Its time counted from the measurement; it must not be over at the join.
    """
    (positions,), (rates,), (accelerations,) = running.at(np.array([ahead]))
    # In the system's own frame no digit is lost to where it is.
    frame = system_frame(robot, carried_forward(robot, state, ahead, running))
    q, v = configuration(robot, frame.start)
    data = robot.model.createData()
    momentum = total_momentum(robot, data, q, v)
    q[7:], v[6:] = positions, rates
    v[:6] = base_twist(robot, data, q, momentum, rates)
    there = frame.state_seen_by_user(system_state(robot, q, v), 0.0)
    there = replace(there, joint_accelerations=accelerations)
    return with_wheel_momenta(robot, state, there)
