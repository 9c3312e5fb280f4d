"""The post-goal segment: at the goal the joints of a plan still move, since the chaser drifts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from enum import StrEnum

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array, finite_number
from ff_planner_ros.core.velocity_map import Velocity, velocity
from ff_planner_ros.errors import Failure, InvalidInput, NoPlanFound, Status
from ff_planner_ros.planning.check.check import assess
from ff_planner_ros.planning.motion.forward import driven
from ff_planner_ros.planning.motion.joint_motion import JointMotion
from ff_planner_ros.planning.motion.motion import from_trajectory, to_trajectory
from ff_planner_ros.planning.motion.plan import Plan, Trajectory
from ff_planner_ros.planning.motion.runge_kutta import runge_kutta_step
from ff_planner_ros.planning.paths.holding import holding_in_part, poses_held
from ff_planner_ros.planning.paths.path_family import singular_refusal
from ff_planner_ros.planning.problem.problem import MAX_POINTS, PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.requirements.goal import miss
from ff_planner_ros.planning.requirements.requirement import Samples
from ff_planner_ros.robot.momentum import total_momentum

# On so many intervals or more the quintics between the points are the motion, within 1e-6 rad.
_LEAST_INTERVALS = 8
# The motion takes so many steps of Runge-Kutta or more in as long as the plan takes to its goal.
_STEPS = 40


class EndBehaviour(StrEnum):
    """The behaviour of the arm after the goal."""

    NONE = "none"
    HOLD_END_EFFECTOR = "hold_end_effector"
    STOP_JOINTS = "stop_joints"


def with_tail(
    problem: PlanningProblem,
    plan: Plan,
    end_behaviour: EndBehaviour,
    seconds: float,
    settings: PlannerSettings,
) -> Plan:
    """Return a plan with a post-goal segment, checked as a whole.

    - `none`: the plan itself. Its joints still move at its last point.
    - `hold_end_effector`: the end effector stays at its goal, or follows the target's twist or the
      target body's grasp, while the chaser moves. The joints still move at the last point.
    - `stop_joints`: joint velocities fall to zero; accelerations are continuous at the goal and
      end at zero. The end effector leaves its goal with the chaser.

    The points of the segment are equally spaced in time, not further apart than the plan's.

    Args:
        seconds: Duration of the segment; without effect for `none`.

    Returns:
        Its metrics are those of the whole motion, except those that refer to the goal (`Metrics`).

    Raises:
        InvalidInput: `seconds` is not positive, or so long that the points become too many, or the
            end effector is to be held after a goal of the joints.
        NoPlanFound: The segment violates what a plan must keep; then the attempt is the plan with
            it. Or it meets a dynamic singularity; then the attempt is the plan without it.
    """
    if end_behaviour is EndBehaviour.NONE:
        return plan
    robot, motion = problem.robot, plan.trajectory
    lasts, points = problem.duration, len(motion.time)
    intervals = tail_intervals(points, lasts, end_behaviour, seconds, problem.posture is not None)
    name = f"{end_behaviour}, {seconds:g} s"
    time = np.linspace(0.0, seconds, 1 + intervals)
    # A plan with few points has few points published, not a coarser motion.
    steps = int(np.ceil(time[1] * _STEPS / problem.duration - 1e-9))
    finer = np.interp(np.arange(steps * (len(time) - 1) + 1), steps * np.arange(len(time)), time)
    q, v = from_trajectory(robot, motion)
    momentum = total_momentum(robot, robot.model.createData(), q[0], v[0])
    if end_behaviour is EndBehaviour.HOLD_END_EFFECTOR:
        try:
            in_part = problem.target_body or plan.may_be_singular
            hold = holding_in_part if in_part else _holding
            tail = hold(problem, q[-1], v[-1, 6:], momentum, finer)
        except NoPlanFound as singular:
            raise _refusal(name, singular.status, str(singular), plan) from None
        if steps > 1:  # the motion between the points is the controller's interpolation
            samples = (rows[::steps] for rows in (tail[0][:, 7:], tail[1][:, 6:], tail[2][:, 6:]))
            tail = driven(robot, q[-1], momentum, JointMotion(time, *samples), finer)
    else:
        ramp = _ramp(q[-1, 7:], v[-1, 6:], motion.joint_accelerations[-1], seconds)
        tail = driven(robot, q[-1], momentum, ramp, finer)
    after = to_trajectory(robot, problem.duration + time, *(rows[::steps] for rows in tail))
    whole = motion.followed_by(after)
    metrics, wheels, named = assess(problem, whole, settings, plan.may_be_singular)
    longer = replace(plan, trajectory=whole, metrics=metrics, wheels=wheels)
    found = [failure for _, failure in named]
    if end_behaviour is EndBehaviour.HOLD_END_EFFECTOR:
        found += _lost_hold(problem, whole, settings)
    if found:
        findings = "; ".join(failure.finding for failure in found)
        raise _refusal(name, found[0].status, findings, longer)
    return longer


def tail_intervals(
    points: int, lasts: float, end_behaviour: EndBehaviour, seconds: float, is_of_joints: bool
) -> int:
    """Return the number of intervals of a post-goal segment; refuse one that no plan can have.

    Args:
        points: Of the plan to the goal.
        lasts: Time to the goal [s].
        is_of_joints: Whether the goal is one of the joints.

    Raises:
        InvalidInput: As by `with_tail`.
    """
    if end_behaviour is EndBehaviour.NONE:
        return 0
    if end_behaviour is EndBehaviour.HOLD_END_EFFECTOR and is_of_joints:
        allowed = "with a goal of the joints it must be none or stop_joints: the goal has no place"
        raise InvalidInput(Status.UNSUPPORTED, "end_behaviour", end_behaviour, allowed)
    seconds = finite_number("post_goal_duration", seconds, above=0.0)
    # A whole number of the plan's steps, but for rounding, takes no more than these.
    wanted = max(np.ceil(seconds / lasts * (points - 1) - 1e-9), _LEAST_INTERVALS)
    if not points + wanted <= MAX_POINTS:
        raise InvalidInput(
            Status.OUT_OF_RANGE,
            "post_goal_duration",
            f"{seconds:g} s",
            f"with its points the plan may have {MAX_POINTS} at most; choose a shorter "
            "post-goal segment or fewer points",
        )
    return int(wanted)


def _holding(
    problem: PlanningProblem, q_goal: Array, _rates: Array, momentum: Array, time: Array
) -> tuple[Array, Array, Array]:
    """Return q, v and accelerations of a motion with the end effector at the target's twist.

    Eq. (31). A path of the paper's family ends with the joint velocities that this begins with.

    Raises:
        NoPlanFound: It meets a dynamic singularity.
    """
    robot, target = problem.robot, problem.target
    model = robot.model
    twist = np.concatenate([target.linear_velocity, target.angular_velocity])
    step, last = time[1], problem.duration + time[-1]

    def solution(seconds: float, q: Array) -> Velocity:
        when = problem.duration + seconds
        regular = velocity(robot, q, momentum, twist)
        if regular is None:
            raise singular_refusal(when, last)
        return regular

    q = [q_goal]
    for begin in time[:-1]:

        def stage(_: int, at: Array, begin: float = begin) -> Array:
            return solution(begin, at).v

        q.append(pin.integrate(model, q[-1], runge_kutta_step(model, q[-1], step, stage)))
    solutions = [solution(*at) for at in zip(time, q, strict=True)]
    v = np.array([at.v for at in solutions])
    return np.array(q), v, np.array([at.by_q @ at.v for at in solutions])


def _ramp(positions: Array, rates: Array, accelerations: Array, seconds: float) -> JointMotion:
    """Return a motion to rest with cubic joint velocities, which a quintic spline reproduces."""
    way = seconds / 2 * rates + seconds**2 / 12 * accelerations
    rest = np.zeros_like(rates)
    return JointMotion(
        np.array([0.0, seconds]),
        np.array([positions, positions + way]),
        np.array([rates, rest]),
        np.array([accelerations, rest]),
    )


def _lost_hold(
    problem: PlanningProblem, whole: Trajectory, settings: PlannerSettings
) -> Iterator[Failure]:
    """Yield failures of the end effector to follow the target or the target body after the goal.

    Both the points of the plan and the motion that follows from them are looked at.
    """
    samples, target = Samples(problem, settings, whole), problem.target
    told, comes = slice(samples.goal, None), slice(samples.followed.pieces * samples.goal, None)
    time = np.append(whole.time[told], samples.followed.time[comes]) - problem.duration
    positions, rotations = poses_held(problem, time)
    q = np.append(samples.q[told], samples.followed.q[comes], axis=0)
    misses = [
        miss(problem.robot, at, replace(target, position=position, quaternion_xyzw=rotation))
        for at, position, rotation in zip(q, positions, rotations, strict=True)
    ]
    away, turned = np.linalg.norm(misses, axis=2).T
    for name, off, tolerance, unit in (
        ("position", away, settings.position_tolerance, "m"),
        ("orientation", turned, settings.orientation_tolerance, "rad"),
    ):
        if not off.max() <= tolerance:
            yield Failure(
                Status.CHECK_FAILED,
                f"the end effector's {name} is {off.max():.3g} {unit} off the target "
                f"{time[off.argmax()]:.2f} s after the goal, allowed is {tolerance:.3g} {unit}",
                (),
            )


def _refusal(name: str, status: Status, finding: str, attempt: Plan) -> NoPlanFound:
    message = (
        f"the plan reaches its goal, but its post-goal segment ({name}) is not feasible: {finding}"
        ". What may help: another post_goal_duration, another end_behaviour, another goal"
    )
    return NoPlanFound(status, message, attempt)
