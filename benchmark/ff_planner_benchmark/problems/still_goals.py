"""Problems with a goal at rest, each with a motion that solves it: planar, or of high momentum.

That motion, the witness, is a quintic of each joint; at its end the end effector is at rest in the
inertial frame, whatever the chaser's motion. The obstacles stay clear of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from ff_planner_benchmark.problems.tumbling_witness import (
    FROM_LIMITS,
    Grip,
    Witness,
    tip,
    witness_to_grip,
)
from ff_planner_benchmark.problems.witnessed import spheres_beside
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.problem.problem import (
    Limits,
    Objective,
    Orientation,
    PlanningProblem,
    Target,
)
from ff_planner_ros.problems.drawn import Drawn, first_sound
from ff_planner_ros.problems.robots import bench_robot
from ff_planner_ros.robot.configuration import eigen_quaternion
from ff_planner_ros.robot.model import Base, Robot
from ff_planner_ros.robot.state import SystemState


@dataclass(frozen=True)
class Kind:
    """A class of problems."""

    robots: tuple[str, ...]  # in turn
    orientations: tuple[Orientation, ...]  # in turn
    drift: tuple[float, float]  # least and largest speed of the chaser at the start [m/s]
    spin: tuple[float, float]  # least and largest angular rate of the chaser at the start [deg/s]
    spheres: int  # largest number


# With high momentum the system drifts by its own length and rotates by 30 to 120 deg in a motion.
KINDS = {
    "planar": Kind(
        ("planar3", "planar4", "planar5"),
        (Orientation.FIXED, Orientation.FREE),
        (0.0, 0.03),
        (0.0, 2.0),
        2,
    ),
    "high_momentum": Kind(
        ("lemur", "arm6", "arm7"), (Orientation.FIXED,), (0.08, 0.2), (4.0, 8.0), 4
    ),
}

# How far each joint turns at most [rad], and how fast it begins [rad/s].
_TURN, _MOVING = 0.9, 0.03
# The obstacles move so fast, about [m/s].
_SLOW = 0.005
_POINTS = 50


@cache
def drawn(kind: str, number: int) -> Drawn[Witness]:
    """Return a problem of one of `KINDS`; kind and number seed the draw."""
    asked = KINDS[kind]
    name = asked.robots[number % len(asked.robots)]
    robot = bench_robot(name)
    orientation = asked.orientations[number % len(asked.orientations)]
    rng = np.random.default_rng([*kind.encode(), number])
    return first_sound(kind, name, lambda: _drawn(robot, asked, orientation, rng))


def _drawn(
    robot: Robot, kind: Kind, orientation: Orientation, rng: np.random.Generator
) -> Drawn[Witness] | None:
    """Draw a moving system and a motion; None: the motion violates a constraint."""
    lowest = np.maximum(robot.lower_position_limits, -np.pi) + FROM_LIMITS
    highest = np.minimum(robot.upper_position_limits, np.pi) - FROM_LIMITS
    drift = _drawn_vector(rng, *kind.drift)
    spin = _drawn_vector(rng, *np.deg2rad(kind.spin))
    if robot.base is Base.PLANAR:
        drift[2] = spin[0] = spin[1] = 0.0
    start = SystemState(
        position_chaser_in_inertial=np.zeros(3),
        quaternion_chaser_to_inertial_xyzw=np.array([0.0, 0.0, 0.0, 1.0]),
        linear_velocity_chaser_in_inertial=drift,
        angular_velocity_chaser_in_inertial=spin,
        joint_positions=rng.uniform(lowest, highest),
        joint_velocities=_MOVING * rng.uniform(-1.0, 1.0, robot.joints),
    )
    duration = float(rng.uniform(8.0, 15.0))
    end = start.joint_positions + rng.uniform(-_TURN, _TURN, robot.joints)
    nothing = np.zeros(3)
    at_rest = Grip(np.eye(3), nothing, np.eye(3), rate=nothing, drift=nothing)
    witness = witness_to_grip(robot, start, end, at_rest, duration)
    if witness is None:
        return None
    goal = tip(robot, witness.way[-1])
    asked = PlanningProblem(
        robot=robot,
        start=start,
        target=Target(
            position=goal.translation,
            quaternion_xyzw=eigen_quaternion(goal.rotation),
            orientation=orientation,
        ),
        duration=duration,
        points=_POINTS,
        obstacles=spheres_beside(robot, witness.way, witness.times, kind.spheres, _SLOW, rng),
        objective=Objective(1.0, 0.0),
        limits=Limits(joint_velocities=True),
    )
    return Drawn(asked, witness)


def _drawn_vector(rng: np.random.Generator, least: float, most: float) -> Array:
    vector = rng.normal(size=3)
    drawn: Array = vector / np.linalg.norm(vector) * rng.uniform(least, most)
    return drawn
