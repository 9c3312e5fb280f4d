"""An end effector that leaves its corridor before the goal is refused, and after it is not."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from handmade_plans import DENSE, GOAL, PLACES, STEP, Made, arm, made, resting
from robots import ROBOTS
from scipy.spatial.transform import Rotation
from test_limits_by_hand import PLACE, POSTURE, the_one

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import Status
from ff_planner_ros.planning.problem.approach import RADIUS_AT_GRASP, Approach
from ff_planner_ros.robot.model import robot_from_urdf_text

GAP = 6e-4  # to which the margin is known between the points, and a little more [m]
DRIFT = np.array([0.05, -0.02, 0.03])


@cache
def swerving(place: str, way: float, drifts: bool) -> tuple[Made, Array]:
    """The end effector rests at the grasp but for one place; and where it is, seen from there.

    Where the system drifts, the grasp drifts along.
    """
    robot = robot_from_urdf_text(*ROBOTS["six joints"])
    joints = resting(POSTURE).swelling(0, PLACES[place], way)
    attitude = Rotation.from_rotvec([0.7, -1.1, 1.9])
    chaser = Rotation.from_matrix(robot.rotation_chaser_to_base)
    drift = DRIFT if drifts else np.zeros(3)
    in_base = (attitude * chaser.inv()).inv().apply(drift)
    found = made(robot, joints, np.concatenate([in_base, np.zeros(3)]), PLACE, attitude)
    tips = np.array([arm(robot, q)[-1] for q in found.q])
    later = found.time - found.problem.duration
    goal = tips[GOAL * DENSE]
    axes = Rotation.from_quat(found.problem.target.quaternion_xyzw.copy())
    places = axes.inv().apply(tips - goal - np.outer(later, drift))
    target = replace(found.problem.target, linear_velocity=drift)
    return replace(found, problem=replace(found.problem, target=target)), places


def margins(approach: Approach, places: Array) -> Array:
    """How far inside the cone, or beyond the distance, by a drawing of it."""
    along = -places @ approach.direction
    lateral = np.linalg.norm(np.cross(places, approach.direction), axis=1)
    in_cone = (RADIUS_AT_GRASP + along * math.tan(approach.half_angle) - lateral) * math.cos(
        approach.half_angle
    )
    return np.asarray(np.maximum(in_cone, np.linalg.norm(places, axis=1) - approach.distance))


def ways(places: Array) -> tuple[Array, Array]:
    """Where the end effector swerves to, and a direction across."""
    furthest = places[np.linalg.norm(places, axis=1).argmax()]
    there = furthest / np.linalg.norm(furthest)
    across = np.cross(there, [0.36, -0.48, 0.8])
    return there, across / np.linalg.norm(across)


@pytest.mark.sampled
@pytest.mark.law("PLAN-13")
@pytest.mark.parametrize(
    ("place", "drifts"), [("start", True), ("between", False), ("before the goal", True)]
)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_end_effector_that_swerves_between_two_points_is_refused(
    place: str, sign: float, drifts: bool
) -> None:
    for way, refused in ((0.03, True), (0.01, True), (0.003, False)):
        found, places = swerving(place, sign * way, drifts)
        there, across = ways(places)
        approach = Approach(across, 0.5)
        least = margins(approach, places[: GOAL * DENSE + 1]).min()
        assert (least < -GAP) if refused else (least > GAP), "the way does not fit the corridor"
        failures = found.judged(approach=approach)
        assert bool(failures) is refused
        if refused:
            the_one(failures, Status.LIMIT_VIOLATED, "beside the corridor of the approach")
            words = failures[0].finding.split()
            assert 1e-3 * float(words[words.index("mm") - 1]) == pytest.approx(-least, abs=GAP)
            told = float(failures[0].finding.split("t = ")[1].split()[0])
            assert told == pytest.approx(STEP * (PLACES[place] + 0.5), abs=0.15)
        # Back along the way that it comes, however far, but not ahead of the grasp.
        assert not found.judged(approach=Approach(-there, 0.5, 0.6))
        failures = found.judged(approach=Approach(there, 0.5, 0.6))
        assert bool(failures) is refused


def test_after_the_goal_the_corridor_is_nobodys_matter() -> None:
    found, places = swerving("end", 0.03, True)
    _, across = ways(places)
    approach = Approach(across, 0.5)
    assert margins(approach, places).min() < -GAP
    assert not found.judged(approach=approach)


def test_beyond_the_distance_the_end_effector_may_come_from_anywhere() -> None:
    found, places = swerving("between", 0.03, False)
    _, across = ways(places)
    furthest = np.linalg.norm(places, axis=1).max()
    for part, refused in ((1.2, True), (0.2, False)):
        approach = Approach(across, part * RADIUS_AT_GRASP if not refused else part * furthest)
        least = margins(approach, places[: GOAL * DENSE + 1]).min()
        assert (least < -GAP) if refused else (least > GAP)
        assert bool(found.judged(approach=approach)) is refused
