"""Start, search and check allow the same excess of every limit: an admitted start fails no plan."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from robots import CONFIG

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.followed import FollowedMotion, followed, peaks_of_steps
from ff_planner_ros.planning.motion.joint_motion import JointMotion
from ff_planner_ros.planning.problem.problem import Limits, PlanningProblem
from ff_planner_ros.planning.requirements.limits.joint_limits import (
    JointAccelerations,
    JointPositions,
    JointRates,
)
from ff_planner_ros.planning.requirements.limits.limited import Limited
from ff_planner_ros.planning.requirements.limits.loads import GraspWrench, LimitedLoads, Torques
from ff_planner_ros.planning.requirements.limits.wheels import WheelLimits
from ff_planner_ros.planning.requirements.requirement import Samples
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.wheels import Wheels

SETTINGS, LASTS = load_parameters().planner, 4.0
LEMUR, WHEELS, PAYLOAD = (
    load_scenario(CONFIG / f"scenarios/{name}.yaml")
    for name in ("lemur_capture", "lemur_wheels", "lemur_payload")
)
MANY = 1e6
# What a limit of so much, or of a position, allows: a ten-thousandth, and never less than rounding.
RELATIVE, ROUNDING, OF_POSITION = 1e-4, 1e-6, 1e-4


def slowing(
    problem: PlanningProblem, rng: np.random.Generator
) -> tuple[PlanningProblem, JointMotion]:
    """Joints come to rest, rate and acceleration largest at the start: v0 (1 - t / T)^2."""
    start, joints = problem.start, problem.robot.joints
    rates = rng.uniform(0.02, 0.3, joints) * rng.choice([-1.0, 1.0], joints)
    time = np.linspace(0.0, LASTS, 25)
    left = (1.0 - time / LASTS)[:, None]
    motion = JointMotion(
        time,
        start.joint_positions + rates * LASTS / 3.0 * (1.0 - left**3),
        rates * left**2,
        -2.0 * rates / LASTS * left,
    )
    begins = replace(start, joint_velocities=rates, joint_accelerations=motion.accelerations[0])
    if problem.robot.wheels is not None:
        begins = replace(begins, wheel_momenta=rng.uniform(-20.0, 20.0, 3))
    return replace(problem, start=begins), motion


def limited(
    kind: str, rng: np.random.Generator, part: float
) -> Iterator[tuple[Limited, PlanningProblem, FollowedMotion]]:
    """Yield problems whose limits the start exceeds by a part of what is allowed, and no later."""
    drawn = {"wheel momenta": WHEELS, "wheel torques": WHEELS, "grasp": PAYLOAD}.get(kind, LEMUR)
    problem, joints = slowing(drawn, rng)
    robot = problem.robot
    motion = followed(robot, *configuration(robot, problem.start), joints)
    first = {
        "positions": joints.positions[0],
        "rates": joints.velocities[0],
        "accelerations": joints.accelerations[0],
    }
    if kind == "positions":
        away = joints.velocities[0] > 0.0
        beyond = part * OF_POSITION
        lower = np.where(away, first[kind] + beyond, -MANY)
        upper = np.where(away, MANY, first[kind] - beyond)
        tight = replace(robot, lower_position_limits=lower, upper_position_limits=upper)
        yield JointPositions(), replace(problem, robot=tight), motion
        return
    if kind in first:
        sizes = np.abs(first[kind])
        limits = limit_below(sizes, part, RELATIVE)
        if kind == "rates":
            slow = replace(robot, velocity_limits=limits)
            limited_to = replace(problem, robot=slow, limits=Limits(joint_velocities=True))
            yield JointRates(), limited_to, motion
        else:
            allowed = Limits(joint_accelerations=tuple(limits.tolist()))
            yield JointAccelerations(), replace(problem, limits=allowed), motion
        return
    required: LimitedLoads = {"torques": Torques(), "grasp": GraspWrench()}.get(kind, WheelLimits())
    samples = motion.q, motion.v, motion.joint_accelerations, motion.maps
    loads = required.loads(problem, *samples)
    which = {"wheel torques": 1}.get(kind, int(rng.integers(len(loads))) if kind == "grasp" else 0)
    is_peak = peaks_of_steps(loads[which], motion).values == loads[which][0]
    relative = 0.0 if kind == "torques" else RELATIVE
    limits = np.where(is_peak, limit_below(np.abs(loads[which][0]), part, relative), MANY)
    if not is_peak.any():
        return
    if kind == "torques":
        weak = replace(robot, effort_limits=limits)
        yield required, replace(problem, robot=weak), motion
    elif kind == "grasp":
        name = ("grasp_force", "grasp_torque")[which]
        yield required, replace(problem, limits=Limits(**{name: float(limits[0])})), motion
    else:
        name = ("momentum", "torque")[which]
        wheels = cast(Wheels, robot.wheels)
        given = {"momentum": None, "torque": None} | {name: tuple(limits.tolist())}
        yield (
            required,
            replace(problem, robot=replace(robot, wheels=replace(wheels, **given))),
            motion,
        )


def limit_below(sizes: Array, part: float, relative: float) -> Array:
    """Return the limits that sizes exceed by a part of what is allowed."""
    return np.minimum(sizes / (1.0 + part * relative), sizes - part * ROUNDING)


def failures(required: Limited, problem: PlanningProblem, motion: FollowedMotion) -> list[Status]:
    samples = SimpleNamespace(problem=problem, followed=motion, at=lambda time: f"{time} s")
    return [one.status for one in required.assess(cast(Samples, samples)).failures]


KINDS = (
    *("positions", "rates", "accelerations", "torques"),
    *("wheel momenta", "wheel torques", "grasp"),
)


@pytest.mark.law("PLAN-29")
@pytest.mark.parametrize("kind", KINDS)
def test_a_start_that_is_admitted_makes_no_plan_fail_and_one_beyond_does(kind: str) -> None:
    """At the limit, anywhere in what is allowed, at the end of that, and just beyond."""
    rng, seen = np.random.default_rng(len(kind)), 0
    for part in (0.0, *rng.uniform(0.0, 1.0, 12).tolist(), 1.0 - 1e-6, 1.03, 1.5):
        for required, problem, motion in limited(kind, rng, part):
            is_beyond, seen = part > 1.0, seen + 1
            q_start, _ = configuration(problem.robot, problem.start)
            with pytest.raises(InvalidInput) if is_beyond else nullcontext():
                required.refuse_start(problem, q_start, SETTINGS)
            assert (required.slack(problem, motion) < 0.0) is is_beyond, part
            assert bool(failures(required, problem, motion)) is is_beyond, part
    assert seen > 10
