"""The published plans that the joints follow until a new one starts, and the one it replaces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.errors import InvalidInput, Retry, Status
from ff_planner_ros.parameters.published_plans import TrackingParameters
from ff_planner_ros.planning.motion.joint_motion import JointMotion, in_turns_of
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.ros.inputs.state_input import Snapshot
from ff_planner_ros.ros.outputs.plan_output import PublishedPlan
from ff_planner_ros.ros.outputs.prediction import deviations, too_far

_FIELD = "replan_active"
# Two times are one if they are no further apart [s]: a quintic needs an interval of some length.
_ONE_TIME = 1e-6


@dataclass(frozen=True, eq=False)
class ContinuedPlan:
    """A running plan, and where a new plan takes over from it."""

    motion: JointMotion  # of the joints, the time counted from the measurement of the state
    splice_time: float  # in the plan, from its first point [s]
    remaining: float  # from there to its goal [s]


def continued_plan(
    published: PublishedPlan | None,
    measured: Snapshot,
    start_ns: int,
    robot: Robot,
    min_remainder: float,
    tracking: TrackingParameters,
) -> ContinuedPlan:
    """Return the published plan that a new plan takes over from at start_ns [ns].

    Args:
        min_remainder: Least time from there to the running plan's goal [s].
        tracking: How far the system may be from the running plan.

    Raises:
        InvalidInput: No plan runs (NO_ACTIVE_PLAN), it ends too soon (PLAN_ENDING), or the measured
            system is too far from it (STATE_MOVED).
    """
    if published is None:
        words = (
            "none was published yet, or the last one was aborted: ask for one without "
            "replan_active first"
        )
        raise InvalidInput(Status.NO_ACTIVE_PLAN, _FIELD, True, words)
    splice_time = (start_ns - published.start_ns) / NANOSECONDS
    running = published.at(measured.stamp_ns)
    if running is None or splice_time < 0.0:
        begins = (published.start_ns - measured.stamp_ns) / NANOSECONDS
        lasts = float(published.trajectory.time[-1])
        words = (
            f"{published.plan_id}, the last one, begins {begins:.3f} s after the state was "
            f"measured and lasts {lasts:.3f} s; measurement and handover must be while it runs"
        )
        error = InvalidInput(Status.NO_ACTIVE_PLAN, _FIELD, True, words)
        error.retry = Retry.LATER if measured.stamp_ns < published.start_ns else None  # not begun
        raise error
    remaining = published.seconds_to_goal - splice_time
    if not remaining >= min_remainder:
        words = (
            f"{published.plan_id} is at its goal {remaining:.3f} s after the handover, and less "
            f"than replanning.min_remainder, {min_remainder:g} s, is not planned again"
        )
        raise InvalidInput(Status.PLAN_ENDING, _FIELD, True, words)
    time = (measured.stamp_ns - running.start_ns) / NANOSECONDS
    off = too_far(deviations(measured.state, running.trajectory, time, robot), tracking)
    if off:
        words = f"the system is not where {running.plan_id} says: {off}"
        raise InvalidInput(Status.STATE_MOVED, _FIELD, True, f"{words}; ask for a plan of its own")
    plans = _plans(published, measured.stamp_ns, start_ns + 1)
    motion = motion_on(plans, measured, robot.continuous)
    return ContinuedPlan(motion, splice_time, remaining)


def followed_until(
    published: PublishedPlan, measured: Snapshot, start_ns: int, robot: Robot, most: float
) -> list[PublishedPlan]:
    """Return the published plans that the joints follow from a state until start_ns [ns], in order.

    Nobody tells the planner which plans are executed; a plan that was not leaves the joints behind.

    Args:
        most: Largest deviation of a joint from the first of them [rad].
    """
    plans, state = _plans(published, measured.stamp_ns, start_ns), measured.state
    if not plans:
        return []
    first = plans[0]
    time = (measured.stamp_ns - first.start_ns) / NANOSECONDS
    # Until the first one begins the joints keep their rates.
    positions = state.joint_positions + max(-time, 0.0) * state.joint_velocities
    there = replace(state, joint_positions=positions)
    found = deviations(there, first.trajectory, max(time, 0.0), robot)
    aside = [one.amount for one in found if one.tolerance == "max_joint_position"]
    return plans if aside and max(aside) <= most else []


def _plans(published: PublishedPlan, since_ns: int, until_ns: int) -> list[PublishedPlan]:
    """Return the plans that run, or begin, between two times [ns], in the order of their starts."""
    found = list[PublishedPlan]()
    one: PublishedPlan | None = published
    while one is not None:
        if one.start_ns < until_ns and since_ns <= one.end_ns:
            found.append(one)
        one = one.before if since_ns < one.start_ns else None
    return found[::-1]


def motion_on(
    plans: Sequence[PublishedPlan], measured: Snapshot, continuous: Sequence[bool] | bool
) -> JointMotion:
    """Return the joint motion on plans that follow each other, its time counted from a state.

    Continuous joints go on from the turn in which they are measured.
    """
    since_ns = measured.stamp_ns
    motion = plans[0].motion(since_ns)
    for plan in plans[1:]:
        then = plan.motion(since_ns)
        until = motion.time < then.time[0] - _ONE_TIME
        motion = JointMotion(
            **{
                name: np.concatenate([getattr(motion, name)[until], getattr(then, name)])
                for name in (item.name for item in fields(JointMotion))
            }
        )
    return in_turns_of(measured.state.joint_positions, motion, continuous)
