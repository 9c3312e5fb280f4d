"""Replanning in motion: the plan that a request replaces, and whether the system follows it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.parameters.published_plans import ReplanningParameters
from ff_planner_ros.planning.motion.joint_motion import JointMotion
from ff_planner_ros.ros.inputs.state_input import Snapshot
from ff_planner_ros.ros.outputs.plan_output import PublishedPlan
from ff_planner_ros.ros.outputs.prediction import tracking_error

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
    allowed: ReplanningParameters,
    weights: Array | float = 1.0,
) -> ContinuedPlan:
    """Return the published plan that a new plan takes over from at start_ns [ns].

    Args:
        weights: Factors of the joint deviations: 1, or rad/m for prismatic joints. Shape (joints,).

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
        raise InvalidInput(Status.NO_ACTIVE_PLAN, _FIELD, True, words)
    remaining = published.seconds_to_goal - splice_time
    if not remaining >= allowed.min_remainder:
        words = (
            f"{published.plan_id} is at its goal {remaining:.3f} s after the handover, and less "
            f"than replanning.min_remainder, {allowed.min_remainder:g} s, is not planned again"
        )
        raise InvalidInput(Status.PLAN_ENDING, _FIELD, True, words)
    motion = _joints(running, published, measured.stamp_ns)
    off = list(_off(running, motion, measured, allowed, weights))
    if off:
        words = f"the system is not where {running.plan_id} says: {'; '.join(off)}"
        raise InvalidInput(Status.STATE_MOVED, _FIELD, True, f"{words}; ask for a plan of its own")
    return ContinuedPlan(motion, splice_time, remaining)


def _joints(running: PublishedPlan, published: PublishedPlan, since_ns: int) -> JointMotion:
    """Return the joint motion of the running plan, then of the last published one."""
    last = published.motion(since_ns)
    if running is published:
        return last
    first = running.motion(since_ns)
    until = first.time < last.time[0] - _ONE_TIME
    return JointMotion(
        **{
            item.name: np.concatenate([getattr(first, item.name)[until], getattr(last, item.name)])
            for item in fields(JointMotion)
        }
    )


def _off(
    running: PublishedPlan,
    motion: JointMotion,
    measured: Snapshot,
    allowed: ReplanningParameters,
    weights: Array | float,
) -> Iterator[str]:
    """Yield a phrase for each deviation from the plan that is larger than allowed."""
    (planned,), _, _ = motion.at(np.zeros(1))
    joints = float(np.abs(weights * (measured.state.joint_positions - planned)).max())
    chaser = tracking_error(running.trajectory, running.start_ns, measured.state, measured.stamp_ns)
    found = [("a joint", "max_joint_position", joints, "rad")]
    if chaser is not None:
        found.append(("the chaser", "max_position", chaser.position, "m"))
        found.append(("the chaser's attitude", "max_angle", chaser.angle, "rad"))
    for what, name, off, unit in found:
        limit = getattr(allowed, name)
        if not off <= limit:  # written so that NaN is refused
            yield f"{what} by {off:.3g} {unit}, more than replanning.{name}, {limit:g} {unit}"
