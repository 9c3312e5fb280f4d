"""Convex obstacles beside a robot's motion: each is pushed from outside until it is near.

All distances are Coal's, at the motion's points; nothing here knows how the planner measures.
"""

from __future__ import annotations

from dataclasses import dataclass

import coal
import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.problem.problem import Obstacle, RigidMotion
from ff_planner_ros.problems.bodies import Swept, distance
from ff_planner_ros.robot.collision.solids import Solid, hull_of_vertices
from ff_planner_ros.robot.configuration import eigen_quaternion

# Kinds that are drawn in turn: a plate is a box of 5 mm.
KINDS = ("box", "cylinder", "plate", "capsule", "cone", "mesh")
THICKNESS = 0.005  # of plates [m]
# Half of the edges of what is drawn, in lengths of the stretched arm, and corners of a hull.
_SMALLEST, _LARGEST, _CORNERS = 0.02, 0.07, 20
# Tolerance of the distance at which a body stops [m], and largest number of steps.
_NEAR, _STEPS = 1e-3, 40


@dataclass(frozen=True, eq=False)
class Track:
    """A solid's poses over time, and the direction in which it is pushed at each time."""

    solid: Solid
    rotations: Array  # solid to inertial axes; shape (times, 3, 3)
    positions: Array  # of its origin, inertial; shape (times, 3) [m]
    ways: Array  # unit vectors of the push, inertial; shape (times, 3)

    def gap(self, swept: Swept, come: float = 0.0) -> float:
        """Return the smallest distance to the robot's bodies after a push by `come` [m]."""
        robot, solid = swept.robot, self.solid
        positions = self.positions + come * self.ways
        centers = positions + self.rotations @ solid.center
        apart = np.linalg.norm(swept.centers - centers[:, None], axis=-1)
        bounds = apart - np.array([body.radius for body in robot.bodies]) - solid.radius
        least = np.inf
        for flat in np.argsort(bounds, axis=None):
            time, body = divmod(int(flat), len(robot.bodies))
            if bounds[time, body] >= least:
                break
            place = coal.Transform3s(self.rotations[time], positions[time])
            one, at = robot.bodies[body].solid, swept.places[time][body]
            least = min(least, distance(one, at, solid.geometry, place))
        return float(least)

    def come(self, swept: Swept, clear: float, most: float) -> float | None:
        """Return the push up to a distance `clear` [m], at most `most`; None: it starts nearer.

        A distance changes by no more than the push, so nothing is hit on the way.
        """
        way = 0.0
        for step in range(_STEPS):
            room = self.gap(swept, way) - clear
            if room < 0.0:
                return None if step == 0 else way
            way = min(way + room, most)
            if room < _NEAR or way == most:
                break
        return way


def drawn_solid(kind: str, reach: float, rng: np.random.Generator) -> Solid:
    """Draw a solid of one of `KINDS`; reach: length of the stretched arm, which scales it [m]."""
    sizes = 2.0 * reach * rng.uniform(_SMALLEST, _LARGEST, 3)
    if kind == "mesh":
        return hull_of_vertices("mesh", rng.normal(size=(_CORNERS, 3)) * sizes / 3.0)
    if kind == "plate":
        return Solid("box", np.array([2.0 * sizes[0], 2.0 * sizes[1], THICKNESS]))
    return Solid(kind, sizes if kind == "box" else np.array([sizes[0] / 2.0, 1.5 * sizes[1]]))


def free_body(
    name: str,
    solid: Solid,
    pose: pin.SE3,
    twist: Array,
    time: float,
) -> Obstacle:
    """Return a body with a constant twist that has a pose at a time [s].

    Args:
        pose: In the inertial frame.
        twist: Linear and angular velocity, inertial. Shape (6,) [m/s, rad/s].
    """
    rotation = pin.exp3(-time * twist[3:]) @ pose.rotation
    return Obstacle(
        name,
        solid,
        RigidMotion(
            pose.translation - time * twist[:3],
            pin.Quaternion(eigen_quaternion(rotation)).normalized().coeffs(),
            twist[:3],
            twist[3:],
        ),
    )


def beside(
    swept: Swept, times: Array, body: Obstacle, way: Array, clear: float, most: float
) -> Obstacle | None:
    """Return a body pushed along a unit vector `way`; distances are those of `Track.come`."""
    rotations, positions = body.motion.poses(times)
    track = Track(body.solid, rotations, positions, np.tile(way, (len(times), 1)))
    far = track.come(swept, clear, most)
    return None if far is None else moved(body, far * way)


def moved(body: Obstacle, way: Array) -> Obstacle:
    """Return a body shifted by `way` (3,) [m], and not attached to a target body."""
    position = body.motion.position + way
    return body.with_motion(position=position, body=None, place_in_body=None)


def gap_of(swept: Swept, times: Array, body: Obstacle) -> float:
    """Return the smallest distance of an obstacle to a robot's bodies over some times [m]."""
    return Track(body.solid, *body.motion.poses(times), np.zeros((len(times), 3))).gap(swept)


def random_turn(rng: np.random.Generator) -> Array:
    """Return a random rotation matrix."""
    return np.asarray(Rotation.random(rng=rng).as_matrix(), np.float64)
