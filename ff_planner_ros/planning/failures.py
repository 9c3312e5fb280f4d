"""What is wrong with a plan: which constraint is not met, where, by how much, what may help."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ff_planner_ros.errors import Failure as Failure
from ff_planner_ros.errors import NoPlanFound, OutOfTime, Status
from ff_planner_ros.planning.clearance import arm_points, clearances, segments
from ff_planner_ros.planning.motion import from_trajectory
from ff_planner_ros.planning.plan import Plan, Trajectory
from ff_planner_ros.planning.problem import PlanningProblem
from ff_planner_ros.planning.settings import PlannerSettings
from ff_planner_ros.robot.dynamics import joint_torques
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.momentum import smallest_singular_values

# A limit violated by less is violated by rounding; no arm and no motor feels it. In the unit of the
# limit: rad, rad/s, N m, and that of singular values.
LIMIT_TOLERANCE = 1e-6

_REPORT = "a report to the maintainers, for this is a fault of the planner"


def refusal(
    plan: Plan, found: Sequence[Failure], advice: Sequence[str] | None = None
) -> NoPlanFound:
    """Return the error that tells an operator of all failures of the best attempt.

    Args:
        found: At least one failure; the first gives the status.
        advice: What may help; None: what the failures advise.
    """
    starts = plan.solver.starts
    attempts = "the only attempt" if starts == 1 else f"{starts} attempts; in the best"
    helps = ", ".join(_advice(found) if advice is None else advice)
    message = f"no plan found in {attempts}, {_findings(found)}. What may help: {helps}"
    return NoPlanFound(found[0].status, message, plan, found)


def out_of_time(
    end: OutOfTime, plan: Plan | None = None, found: Sequence[Failure] = ()
) -> NoPlanFound:
    """Return the error that tells an operator how far a search came that was ended.

    Args:
        plan: The best attempt; None if there is none.
    """
    message = f"{end}; whether there is a plan is not known: give it more time or fewer points"
    if plan is not None:
        points = f"the best attempt so far, on {len(plan.trajectory.time)} points"
        state = (
            _findings(found) or "it keeps every constraint, but was not yet optimised to the end"
        )
        message += f"; {points}: {state}"
    return NoPlanFound(Status.OUT_OF_TIME, message, plan, found)


def _findings(found: Sequence[Failure]) -> str:
    return "; ".join(failure.finding for failure in found)


def _advice(found: Sequence[Failure]) -> list[str]:
    return list(dict.fromkeys(word for failure in found for word in failure.advice))


def failures(problem: PlanningProblem, plan: Plan, settings: PlannerSettings) -> Iterator[Failure]:
    """Yield every constraint that a plan does not meet, what can do most harm first.

    Args:
        plan: With metrics of `measure`.
    """
    metrics = plan.metrics
    if not metrics.min_clearance >= 0.0:
        yield _collision(problem, plan, settings)
    if not metrics.min_joint_margin >= -LIMIT_TOLERANCE:
        yield _position_limit(problem, plan)
    if problem.limits.joint_velocities and not metrics.min_velocity_margin >= -LIMIT_TOLERANCE:
        yield _velocity_limit(problem, plan)
    if not metrics.min_singular_value >= settings.singular_value_threshold - LIMIT_TOLERANCE:
        yield _singularity(problem, plan, settings)
    # After the singularity, near which torques are a symptom.
    torques = np.array(metrics.peak_joint_torques)
    if not (torques <= problem.robot.effort_limits + LIMIT_TOLERANCE).all():
        yield _effort_limit(problem, plan)
    yield from _inaccuracies(plan, settings)


def _collision(problem: PlanningProblem, plan: Plan, settings: PlannerSettings) -> Failure:
    q, _ = from_trajectory(problem.robot, plan.trajectory)
    positions = arm_points(problem.robot, q)
    starts = segments(positions)
    distance = clearances(positions, starts, problem.obstacles).distance
    point, segment, sphere = np.unravel_index(distance.argmin(), distance.shape)
    depth, obstacle = -distance[point, segment, sphere], problem.obstacles[sphere].id
    link, when = link_name(problem.robot, int(starts[segment])), _when(problem, plan, point)
    if depth <= 0.0:
        return Failure(
            Status.COLLISION,
            f"{link} may touch obstacle {obstacle} between two points near {when}: all that is "
            f"certain is a clearance of {plan.metrics.min_clearance * 1e3:.2f} mm",
            ("more points", "a larger planner.clearance_margin"),
        )
    margin = "a smaller planner.clearance_margin"
    return Failure(
        Status.COLLISION,
        f"{link} is {depth:.3g} m inside obstacle {obstacle} at {when}",
        (
            "a longer duration",
            "a goal or start posture on another side of the obstacle",
            "more planner.starts",
            *([margin] if depth < settings.clearance_margin else []),
        ),
    )


def _position_limit(problem: PlanningProblem, plan: Plan) -> Failure:
    lower, upper = problem.robot.lower_position_limits, problem.robot.upper_position_limits
    joints = plan.trajectory.joint_positions
    excess = np.maximum(joints - upper, lower - joints)
    point, joint = np.unravel_index(excess.argmax(), excess.shape)
    return Failure(
        Status.LIMIT_VIOLATED,
        f"joint {plan.joint_names[joint]} is {excess[point, joint]:.3g} rad outside its limits "
        f"[{lower[joint]:.4f}, {upper[joint]:.4f}] rad at {_when(problem, plan, point)}",
        ("another goal orientation, start posture or duration", "more planner.starts"),
    )


def _velocity_limit(problem: PlanningProblem, plan: Plan) -> Failure:
    rates, limits = plan.trajectory.joint_velocities, problem.robot.velocity_limits
    excess = np.abs(rates) - limits
    point, joint = np.unravel_index(excess.argmax(), excess.shape)
    return Failure(
        Status.LIMIT_VIOLATED,
        f"joint {plan.joint_names[joint]} turns at {rates[point, joint]:.4f} rad/s, "
        f"{excess[point, joint]:.3g} rad/s faster than its limit of {limits[joint]:.4f} rad/s, at "
        f"{_when(problem, plan, point)}",
        ("a longer duration", "more planner.starts"),
    )


def _singularity(problem: PlanningProblem, plan: Plan, settings: PlannerSettings) -> Failure:
    q, _ = from_trajectory(problem.robot, plan.trajectory)
    point = smallest_singular_values(problem.robot, q).argmin()
    return Failure(
        Status.SINGULAR,
        f"the arm is in a dynamic singularity at {_when(problem, plan, point)}: the smallest "
        f"singular value of the generalised Jacobian is {plan.metrics.min_singular_value:.3g}, "
        f"allowed is {settings.singular_value_threshold:g}",
        ("a nearer goal", "another goal orientation, start posture or duration"),
    )


def _effort_limit(problem: PlanningProblem, plan: Plan) -> Failure:
    motion, limits = plan.trajectory, problem.robot.effort_limits
    q, v = from_trajectory(problem.robot, motion)
    torques = joint_torques(problem.robot, q, v, motion.joint_accelerations)
    excess = np.abs(torques) - limits
    point, joint = np.unravel_index(excess.argmax(), excess.shape)
    return Failure(
        Status.TORQUE_TOO_HIGH,
        f"joint {plan.joint_names[joint]} needs {torques[point, joint]:.4g} N m, "
        f"{excess[point, joint]:.4g} N m more than its effort limit of {limits[joint]:g} N m, at "
        f"{_when(problem, plan, point)}",
        ("a longer duration",),
    )


def _inaccuracies(plan: Plan, settings: PlannerSettings) -> Iterator[Failure]:
    # A motion leaves its path where steps are long, or where a singularity lies between two.
    follow = "more points, or a nearer goal if it is at the edge of the workspace"
    for name, tolerance, unit, advice in (
        ("final_position_error", settings.position_tolerance, " m", follow),
        ("final_orientation_error", settings.orientation_tolerance, " rad", follow),
        ("momentum_error", settings.momentum_tolerance, "", _REPORT),
        ("torque_error", LIMIT_TOLERANCE, " N m", _REPORT),
        (
            "start_velocity_jump",
            settings.start_velocity_tolerance + LIMIT_TOLERANCE,
            " rad/s",
            "damping the null-space motion that the start's joint rates hold",
        ),
    ):
        value = getattr(plan.metrics, name)
        if not value <= tolerance:
            yield Failure(
                Status.CHECK_FAILED,
                f"{name} is {value:.3g}{unit}, allowed is {tolerance:.3g}{unit}",
                (advice,),
            )


def _when(problem: PlanningProblem, plan: Plan, point: np.intp) -> str:
    time, goal = plan.trajectory.time[point], goal_index(problem, plan.trajectory)
    if point > goal:
        return f"t = {time:.2f} s, {time - problem.duration:.2f} s after the goal"
    words = f"t = {time:.2f} s of {problem.duration:g} s"
    return f"the goal, {words}" if point == goal else words


def goal_index(problem: PlanningProblem, trajectory: Trajectory) -> int:
    """Return the point at which a trajectory is at its goal; those after it are its tail."""
    return int(np.abs(trajectory.time - problem.duration).argmin())


def link_name(robot: Robot, start: int) -> str:
    """Return words for the arm's segment that starts at a joint."""
    ends = (*robot.joint_names, robot.tip_link)
    return f"the link from {ends[start]} to {ends[start + 1]}"
