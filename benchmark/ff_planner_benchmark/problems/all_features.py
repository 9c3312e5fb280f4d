"""Problems that use all features at once, each with a motion that solves it, the witness.

A robot with collision bodies captures a tumbling body, along a corridor and among moving spheres,
within limits of chaser attitude, torques, velocities and accelerations, in an inertial frame that
moves at orbital speed; the planner chooses the duration.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pinocchio as pin

from ff_planner_benchmark.problems.tumbling import Kind, drawn_capture
from ff_planner_benchmark.problems.tumbling_witness import Witness
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.motion import chaser_euler
from ff_planner_ros.planning.problem.problem import (
    DurationRange,
    Limits,
    Objective,
    PlanningProblem,
)
from ff_planner_ros.problems.drawn import Drawn, first_sound
from ff_planner_ros.problems.robots import bench_robot
from ff_planner_ros.problems.twin import seen_from
from ff_planner_ros.robot.collision.geometry import Geometry

ROBOTS = ("lemur", "arm6", "arm7", "arm8")  # in turn

# How fast the body turns at capture, at least and most [deg/s], and how many spheres pass at most.
_KIND = Kind((1.0, 5.0), geometry=Geometry.SHAPES, approach=True, passing=3)
# Limits of attitude, accelerations and torques, in parts of what the witness needs of them; no
# smaller than this [rad, rad/s2, N m].
_ROOM = 1.1
_LEAST_ANGLE, _LEAST_ACCELERATION, _LEAST_TORQUE = 0.02, 0.01, 0.1
# Ends of the durations to choose from, in parts of the witness's: each within these.
_SHORTEST, _LONGEST = (0.6, 0.9), (1.1, 1.5)
# Weights of the duration, beside that of the joint path, in turn [rad/s].
_DURATION_WEIGHTS = (0.0, 0.05)
# Three standard deviations of the system's position [m] and velocity [m/s] in the user's frame.
_AWAY, _FAST = 7e6, 8e3


@cache
def problem(number: int) -> Drawn[Witness]:
    """Return a problem by its number, which seeds the draw.

    Its witness is in the frame of the chaser at the start, and its duration in the problem's range.
    """
    name = ROBOTS[number % len(ROBOTS)]
    robot = bench_robot(name, _KIND.geometry)
    rng = np.random.default_rng([*b"all features", number])
    drawn = first_sound("all features", name, lambda: drawn_capture(robot, _KIND, rng))
    weight = _DURATION_WEIGHTS[number // len(ROBOTS) % len(_DURATION_WEIGHTS)]
    return _with_everything(drawn, Objective(1.0, 0.0, weight), rng)


def _with_everything(
    drawn: Drawn[Witness], objective: Objective, rng: np.random.Generator
) -> Drawn[Witness]:
    """Set limits and durations around a witness, and transform the problem to a moving frame."""
    given, witness = drawn.problem, drawn.witness
    angle = float(np.abs(chaser_euler(given.robot, witness.way)).max())
    accelerations = _ROOM * _accelerations(witness)
    shortest, longest = (
        float(rng.uniform(*part) * given.duration) for part in (_SHORTEST, _LONGEST)
    )
    limits = Limits(
        joint_velocities=True,
        joint_torques=True,
        joint_accelerations=tuple(np.maximum(accelerations, _LEAST_ACCELERATION).tolist()),
        chaser_attitude=max(_ROOM * angle, _LEAST_ANGLE),
    )
    torques = np.maximum(_ROOM * witness.torques, _LEAST_TORQUE)
    asked = replace(
        given,
        robot=replace(given.robot, effort_limits=torques),
        limits=limits,
        objective=objective,
        duration=longest,
        duration_range=DurationRange(shortest, longest),
    )
    return Drawn(_in_orbit(asked, rng), witness)


def _accelerations(witness: Witness) -> Array:
    """Return the largest acceleration of each joint along a witness. Shape (joints,) [rad/s2]."""
    rates = np.diff(witness.way[:, 7:], axis=0) / np.diff(witness.times)[:, None]
    middles = (witness.times[1:] + witness.times[:-1]) / 2
    return np.asarray(np.abs(np.diff(rates, axis=0) / np.diff(middles)[:, None]).max(axis=0))


def _in_orbit(problem: PlanningProblem, rng: np.random.Generator) -> PlanningProblem:
    """Return the same physics in a rotated frame, far away and at orbital speed."""
    axes = rng.normal(size=4)
    turned = pin.Quaternion(axes / np.linalg.norm(axes)).toRotationMatrix()
    there, velocity = rng.normal(size=(2, 3)) * np.array([[_AWAY], [_FAST]]) / 3.0
    return seen_from(problem, pin.SE3(turned, there), velocity)
