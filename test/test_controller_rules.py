"""What `joint_trajectory_controller` refuses is refused before it is sent, its rule named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ff_planner_ros.errors import NoPlanFound, Status
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.task.controller_rules import (
    Controller,
    require_acceptable,
    require_in_time,
)

NOW = 1_700_000_000_000_000_000
STRICT, MILD = Controller(False, False), Controller(True, True)


def ending_with(plan: Plan, *rates: float) -> Plan:
    """Return a plan whose first joints have these rates at the end [rad/s], the others none."""
    velocities = plan.trajectory.joint_velocities.copy()
    velocities[-1] = 0.0
    velocities[-1, : len(rates)] = rates
    return replace(plan, trajectory=replace(plan.trajectory, joint_velocities=velocities))


def test_a_plan_that_ends_at_rest_is_taken(lemur_plan: Plan) -> None:
    require_acceptable(STRICT, ending_with(lemur_plan, 1.1e-7, -1.1e-7))


@pytest.mark.law("PLAN-32")
@pytest.mark.parametrize("rate", [0.5, -1.2e-7])
def test_joints_that_still_move_at_the_end_are_refused_unless_the_controller_is_set_up_for_it(
    rate: float, lemur_plan: Plan
) -> None:
    moves = ending_with(lemur_plan, 0.0, rate)
    require_acceptable(MILD, moves)
    words = f"joint joint_2 still moves at {rate:.3g} rad/s at the last point: .* stop_joints"
    with pytest.raises(NoPlanFound, match=words) as refused:
        require_acceptable(STRICT, moves)
    assert refused.value.status is Status.CONTROLLER_CONSTRAINT
    assert str(refused.value).startswith("a joint_trajectory_controller would not take the plan: ")


def test_a_controller_that_gives_up_joints_that_have_not_stopped_names_the_first(
    lemur_plan: Plan,
) -> None:
    moves = ending_with(lemur_plan, 0.01, -0.02)
    require_acceptable(replace(MILD, stopped_velocity_tolerance=0.02), moves)
    words = r"joint joint_2 still moves at -0\.02 .* 0\.015 rad/s"
    with pytest.raises(NoPlanFound, match=words) as refused:
        require_acceptable(replace(MILD, stopped_velocity_tolerance=0.015), moves)
    assert refused.value.status is Status.CONTROLLER_CONSTRAINT


@pytest.mark.law("PLAN-32")
def test_points_within_a_nanosecond_are_refused(lemur_plan: Plan) -> None:
    """Messages have whole nanoseconds."""
    time = np.arange(len(lemur_plan.trajectory.time)) * 1e-8
    require_acceptable(
        MILD, replace(lemur_plan, trajectory=replace(lemur_plan.trajectory, time=time))
    )
    time[3] = time[2] + 1e-10
    with pytest.raises(NoPlanFound, match=r"points\[3\] is less than a nanosecond after"):
        require_acceptable(
            MILD, replace(lemur_plan, trajectory=replace(lemur_plan.trajectory, time=time))
        )


def test_a_trajectory_that_was_to_begin_before_now_comes_too_late() -> None:
    """The controller takes it until it has ended, and would jump to its middle."""
    with pytest.raises(NoPlanFound, match=r"begin 0\.500 s ago") as refused:
        require_in_time(NOW - 500_000_000, NOW)
    assert refused.value.status is Status.TOO_LATE
    with pytest.raises(NoPlanFound):
        require_in_time(NOW - 1, NOW)
