"""Plans under wrong assumptions on the chaser, their joint motions executed by the true system.

*Fixed base* assumes that the chaser does not move at all; *zero momentum*, that it only reacts to
the arm, P0 = L0 = 0, and does not drift. The planner itself makes both plans, for the problem under
that assumption, with every obstacle in its place and the true pose of chaser and joints at the
start. Rest and zero momentum are those in the problem's inertial frame.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin

from ff_planner_ros.planning.motion.forward import driven
from ff_planner_ros.planning.motion.joint_motion import joint_motion
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.system_frame import system_frame
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.search.candidate import plan_of_motion
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.robot.configuration import configuration, system_state
from ff_planner_ros.robot.momentum import base_twist, generalised_jacobian, total_momentum

# A chaser so many times heavier moves by microradians, which is below every tolerance.
_IMMOVABLE = 1e6


def fixed_base(problem: PlanningProblem, settings: PlannerSettings) -> Plan:
    """Plan as if the chaser did not move, and return the plan as `executed`.

    Raises:
        InvalidInput: As `perform`, for the problem of `with_fixed_base`.
        NoPlanFound: Likewise.
    """
    return _executed_as("a fixed base", problem, with_fixed_base(problem), settings)


def zero_momentum(problem: PlanningProblem, settings: PlannerSettings) -> Plan:
    """Plan as if P0 = L0 = 0, and return the plan as `executed`; errors as of `fixed_base`."""
    return _executed_as("zero momentum", problem, with_zero_momentum(problem), settings)


def _executed_as(
    belief: str, problem: PlanningProblem, believed: PlanningProblem, settings: PlannerSettings
) -> Plan:
    plan = perform(PlanningTask(believed, settings))
    reason = f"planned for {belief}, {plan.solver.stop_reason}; executed on the true system"
    motion = executed(problem, plan, settings)
    return replace(motion, solver=replace(plan.solver, stop_reason=reason))


def with_fixed_base(problem: PlanningProblem) -> PlanningProblem:
    """Return the problem with an immovable chaser, at rest in its start pose.

    The joint velocities are the start's without their part in the null space of the arm's own
    Jacobian, which Eq. (31) never has.
    """
    model = problem.robot.model.copy()
    chaser = model.inertias[1]
    model.inertias[1] = pin.Inertia(
        _IMMOVABLE * chaser.mass, chaser.lever, _IMMOVABLE * chaser.inertia
    )
    robot = replace(problem.robot, model=model)
    q, v = configuration(robot, problem.start)
    jacobian = generalised_jacobian(robot, robot.model.createData(), q)
    rates = np.linalg.pinv(jacobian) @ jacobian @ v[6:]
    start = system_state(robot, q, np.concatenate([np.zeros(6), rates]))
    return replace(problem, robot=robot, start=start)


def with_zero_momentum(problem: PlanningProblem) -> PlanningProblem:
    """Return the problem with zero total momentum.

    The joint velocities are the start's, and the chaser's twist is their reaction.
    """
    robot = problem.robot
    q, v = configuration(robot, problem.start)
    twist = base_twist(robot, robot.model.createData(), q, np.zeros(6), v[6:])
    return replace(problem, start=system_state(robot, q, np.concatenate([twist, v[6:]])))


def executed(problem: PlanningProblem, planned: Plan, settings: PlannerSettings) -> Plan:
    """Return the motion of the true system whose joints follow a plan exactly, not yet checked.

    Between the points the joints follow the quintics through positions, velocities and
    accelerations, as a trajectory controller makes them. The momentum is that of the problem's
    start: if the plan's first joint velocities differ from the start's, they jump and momentum
    stays. The final errors in its metrics are those of the executed motion.
    """
    robot, frame = problem.robot, system_frame(problem.robot, problem.start)
    problem = frame.problem(problem)
    start, v_start = configuration(robot, problem.start)
    momentum = total_momentum(robot, robot.model.createData(), start, v_start)
    points = np.linspace(0.0, 1.0, problem.points) * problem.duration
    q, v, accelerations = driven(robot, start, momentum, joint_motion(planned.trajectory), points)
    motion, _ = plan_of_motion(problem, settings, q, v, accelerations, planned.solver)
    return frame.plan_seen_by_user(motion)
