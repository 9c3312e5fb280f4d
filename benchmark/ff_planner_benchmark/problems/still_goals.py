"""Problems with a goal at rest, each with a motion that solves it: planar, or of high momentum.

That motion, the witness, is a quintic of each joint; at its end the end effector is at rest in the
inertial frame, whatever the chaser's motion. The obstacles stay clear of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from ff_planner_benchmark.problems.tumbling_witness import (
    Grip,
    Witness,
    tip,
    witness_to_grip,
)
from ff_planner_benchmark.problems.witnessed import random_state, spheres_beside
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.problem.problem import (
    Orientation,
    Target,
)
from ff_planner_ros.problems.drawn import Drawn, asked, first_sound
from ff_planner_ros.problems.robots import bench_robot
from ff_planner_ros.robot.configuration import eigen_quaternion
from ff_planner_ros.robot.model import Robot


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


@cache
def drawn(kind: str, number: int) -> Drawn[Witness]:
    """Return a problem of one of `KINDS`; kind and number seed the draw."""
    of_kind = KINDS[kind]
    name = of_kind.robots[number % len(of_kind.robots)]
    robot = bench_robot(name)
    orientation = of_kind.orientations[number % len(of_kind.orientations)]
    rng = np.random.default_rng([*kind.encode(), number])
    return first_sound(kind, name, lambda: _drawn(robot, of_kind, orientation, rng))


def _drawn(
    robot: Robot, kind: Kind, orientation: Orientation, rng: np.random.Generator
) -> Drawn[Witness] | None:
    """Draw a moving system and a motion; None: the motion violates a constraint."""
    drift = _drawn_vector(rng, *kind.drift)
    spin = _drawn_vector(rng, *np.deg2rad(kind.spin))
    start = random_state(robot, drift, spin, _MOVING, rng)
    duration = float(rng.uniform(8.0, 15.0))
    end = start.joint_positions + rng.uniform(-_TURN, _TURN, robot.joints)
    nothing = np.zeros(3)
    at_rest = Grip(np.eye(3), nothing, np.eye(3), rate=nothing, drift=nothing)
    witness = witness_to_grip(robot, start, end, at_rest, duration)
    if witness is None:
        return None
    goal = tip(robot, witness.way[-1])
    target = Target(goal.translation, eigen_quaternion(goal.rotation), orientation=orientation)
    obstacles = spheres_beside(robot, witness.way, witness.times, kind.spheres, _SLOW, rng)
    return Drawn(asked(robot, start, target, duration, obstacles=obstacles), witness)


def _drawn_vector(rng: np.random.Generator, least: float, most: float) -> Array:
    vector = rng.normal(size=3)
    drawn: Array = vector / np.linalg.norm(vector) * rng.uniform(least, most)
    return drawn
