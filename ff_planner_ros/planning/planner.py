"""From question to answer: refuse what cannot be, search, check, plan."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin

from ff_planner_ros.arrays import Array, finite_vector
from ff_planner_ros.errors import OutOfTime
from ff_planner_ros.planning.check import measure
from ff_planner_ros.planning.failures import failures, out_of_time, refusal
from ff_planner_ros.planning.motion import to_trajectory
from ff_planner_ros.planning.plan import Plan, SolverReport
from ff_planner_ros.planning.polynomial import (
    PARAMETERS,
    EndEffectorMotion,
    EndEffectorPolynomial,
    end_effector_polynomial,
)
from ff_planner_ros.planning.preconditions import require_reachable_goal, require_sound_start
from ff_planner_ros.planning.problem import Objective, PlanningProblem
from ff_planner_ros.planning.program import PathProgram
from ff_planner_ros.planning.rollout import Rollout, RolloutModel
from ff_planner_ros.planning.search import PathSolution, Search, rank
from ff_planner_ros.planning.settings import PlannerSettings
from ff_planner_ros.planning.watch import CHECKING, Watch
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.momentum import total_momentum

NOBODY = Watch()


def plan(
    problem: PlanningProblem,
    settings: PlannerSettings,
    watch: Watch = NOBODY,
    first_guess: Array | None = None,
) -> Plan:
    """Plan a trajectory: optimal, collision-free, checked.

    The same problem and settings give the same plan; how long it may take decides only whether
    there is an answer, never which.

    Args:
        watch: May end the search, and is told how far it has come.
        first_guess: Coefficients of a path, as in `Plan.coefficients`: tried first. None: the
            path family's own guesses alone.

    Raises:
        InvalidInput: The start violates what the plan must keep, or the first guess is no path.
        NoPlanFound: The goal is out of reach, the search found no feasible path or was ended, or
            the check refused the path that it found.
    """
    robot = problem.robot
    q_start, v_start, momentum = sound_start(problem, settings)
    polynomial = end_effector_paths(problem, q_start, v_start)

    guess = None
    if first_guess is not None:
        guess = finite_vector("first_guess", first_guess, PARAMETERS)

    def program(points: int, clearance_margin: float, damping: float) -> PathProgram:
        return PathProgram(
            robot=robot,
            rollouts=RolloutModel(robot, q_start, momentum, polynomial, points, damping),
            step=problem.duration / (points - 1),
            spheres=problem.obstacles,
            objective=_with_tie_break(problem.objective, settings),
            clearance_margin=clearance_margin,
            limit_joint_velocities=problem.limits.joint_velocities,
            keep_going=watch.require_time,
        )

    search = Search(program, problem.points, settings, watch.report, guess)

    def answer_along(path: PathSolution) -> Plan:
        report = SolverReport(
            starts=search.starts,
            iterations=search.iterations,
            rollouts=search.evaluations,
            optimality=path.optimality,
            stop_reason=path.stop_reason,
        )
        motion, acceleration = path.at_x.rollout, path.at_x.acceleration
        return plan_of_path(problem, settings, polynomial, motion, acceleration, report)

    paths: list[PathSolution] = []
    ended = None
    try:
        for path in search.paths():
            watch.report(search.progress(CHECKING, path.at_x))
            answer = answer_along(path)
            if not any(failures(problem, answer, settings)):
                return answer
            paths.append(path)
    except OutOfTime as end:
        ended = end
    attempts = paths or search.solved
    if ended is not None and not attempts:
        raise out_of_time(ended)
    if not attempts:
        raise search.refusals[0]
    best = answer_along(min(attempts, key=rank))
    found = list(failures(problem, best, settings))
    raise refusal(best, found) if ended is None else out_of_time(ended, best, found)


def sound_start(problem: PlanningProblem, settings: PlannerSettings) -> tuple[Array, Array, Array]:
    """Return where every motion begins, once the question may have an answer.

    Returns:
        Configuration, shape (7 + joints,), tangent velocity, (6 + joints,), and the momentum that
        stays constant, (6,): P and L about the inertial origin.

    Raises:
        InvalidInput: The start violates what the plan must keep.
        NoPlanFound: The goal is out of reach.
    """
    robot = problem.robot
    q_start, v_start = configuration(robot, problem.start)
    momentum = total_momentum(robot, robot.model.createData(), q_start, v_start)
    require_sound_start(problem, q_start, settings.singular_value_threshold)
    require_reachable_goal(problem, q_start, momentum)
    return q_start, v_start, momentum


def plan_of_path(
    problem: PlanningProblem,
    settings: PlannerSettings,
    polynomial: EndEffectorPolynomial,
    rollout: Rollout,
    acceleration: Array,
    solver: SolverReport,
) -> Plan:
    """Return the motion along one end-effector path, measured and not yet judged.

    Args:
        rollout: Of one of them, on as many points as it may be.
        acceleration: dv/dt at these points. Shape (points, 6 + joints).
    """
    motion = plan_of_motion(problem, settings, rollout.q, rollout.v, acceleration, solver)
    return replace(
        motion,
        xi=polynomial.decision_variables(rollout.coefficients),
        orientation_reading=polynomial.reading,
        family="end_effector_polynomial",
        coefficients=rollout.coefficients.ravel(),
    )


def plan_of_motion(
    problem: PlanningProblem,
    settings: PlannerSettings,
    q: Array,
    v: Array,
    acceleration: Array,
    solver: SolverReport,
) -> Plan:
    """Return a motion that need not follow a polynomial path, measured and not yet judged.

    Args:
        q: Configurations at equal steps of time. Shape (points, 7 + joints).
        v: Tangent velocities. Shape (points, 6 + joints).
        acceleration: dv/dt. Shape (points, 6 + joints).
    """
    time = np.linspace(0.0, 1.0, len(q)) * problem.duration
    trajectory = to_trajectory(problem.robot, time, q, v, acceleration)
    return Plan(
        joint_names=problem.robot.joint_names,
        trajectory=trajectory,
        xi=np.empty(0),
        orientation_reading="",
        metrics=measure(problem, trajectory, settings),
        solver=solver,
    )


def end_effector_paths(
    problem: PlanningProblem, q_start: Array, v_start: Array
) -> EndEffectorPolynomial:
    """Return all end-effector paths from the start state to the target.

    Args:
        q_start: Configuration at its start. Shape (7 + joints,).
        v_start: Tangent velocity at its start. Shape (6 + joints,).
    """
    robot, target = problem.robot, problem.target
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q_start, v_start)
    placement = pin.updateFramePlacement(robot.model, data, robot.tip_frame_id)
    twist = pin.getFrameVelocity(robot.model, data, robot.tip_frame_id, pin.LOCAL_WORLD_ALIGNED)
    start = EndEffectorMotion(
        position=placement.translation,
        rotation_ee_to_inertial=placement.rotation,
        twist=twist.vector,
        acceleration=np.zeros(6),
    )
    end = EndEffectorMotion(
        position=target.position,
        rotation_ee_to_inertial=pin.Quaternion(target.quaternion_xyzw).toRotationMatrix(),
        twist=np.concatenate([target.linear_velocity, target.angular_velocity]),
        acceleration=np.concatenate([target.linear_acceleration, target.angular_acceleration]),
    )
    return end_effector_polynomial(start, end, problem.duration)


def _with_tie_break(objective: Objective, settings: PlannerSettings) -> Objective:
    """Return the objective to solve: never the attitude alone."""
    if objective.joint_path_length > 0.0:
        return objective
    tie_break = settings.joint_path_tie_break * objective.chaser_attitude
    return replace(objective, joint_path_length=tie_break)
