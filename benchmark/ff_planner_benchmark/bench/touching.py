"""Collisions along a plan, by Pinocchio's collision checks at samples of 1 kHz."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import pinocchio as pin
from scipy.interpolate import BPoly
from scipy.spatial.transform import Rotation, RotationSpline

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.distance.surroundings import obstacle_place
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.planning.problem.problem import Obstacle
from ff_planner_ros.robot.model import Robot

RATE = 1000.0  # [Hz]


def touching(robot: Robot, trajectory: Trajectory, obstacles: Sequence[Obstacle]) -> set[str]:
    """Return the pairs that touch somewhere along a plan: "body/body" or "body/obstacle".

    Args:
        robot: The plan's robot, with bodies, be they other than the plan was made for.
        obstacles: In their states at the plan's first point.
    """
    geometry, names = _geometry(robot, obstacles)
    data, placed = robot.model.createData(), geometry.createData()
    found: set[str] = set()
    for time, q in configurations(robot, trajectory):
        for one in obstacles:
            if one.moves:
                number = geometry.getGeometryId(_obstacle(one))
                geometry.geometryObjects[number].placement = obstacle_place(one, time)
        pin.updateGeometryPlacements(robot.model, data, geometry, placed, q)
        if pin.computeCollisions(geometry, placed, False):
            found |= {
                name
                for name, result in zip(names, placed.collisionResults, strict=True)
                if result.isCollision()
            }
    return found


def configurations(robot: Robot, trajectory: Trajectory) -> Iterator[tuple[float, Array]]:
    """Yield times [s] and configurations, shape (7 + joints,), along a plan at `RATE`.

    Joints are interpolated by quintics, the chaser's position by cubics and its attitude by a
    rotation spline: within a tenth of a millimetre of the true motion.
    """
    time = trajectory.time
    joints = trajectory.joint_positions, trajectory.joint_velocities
    quintics = BPoly.from_derivatives(
        time, np.stack([*joints, trajectory.joint_accelerations], axis=1)
    )
    chaser = trajectory.chaser_positions, trajectory.chaser_linear_velocities
    cubics = BPoly.from_derivatives(time, np.stack(chaser, axis=1))
    attitudes = RotationSpline(time, Rotation.from_quat(trajectory.chaser_quaternions_xyzw))
    looks = np.linspace(time[0], time[-1], int(np.ceil(RATE * (time[-1] - time[0]))) + 1)
    base = attitudes(looks) * Rotation.from_matrix(robot.rotation_chaser_to_base.T.copy())
    position = cubics(looks) - base.apply(robot.position_chaser_in_base.copy())
    yield from zip(
        (looks - time[0]).tolist(),
        np.hstack([position, base.as_quat(), quintics(looks)]),
        strict=True,
    )


def _geometry(robot: Robot, obstacles: Sequence[Obstacle]) -> tuple[pin.GeometryModel, list[str]]:
    """Return Pinocchio's model of all solids, and what its pairs are called."""
    geometry = pin.GeometryModel()
    for number, body in enumerate(robot.bodies):
        geometry.addGeometryObject(
            pin.GeometryObject(f"body {number}", body.joint, body.placement_in_joint, body.solid)
        )
    for one in obstacles:
        solid = one.solid.geometry
        place = obstacle_place(one, 0.0)
        geometry.addGeometryObject(pin.GeometryObject(_obstacle(one), 0, place, solid))
    bodies = len(robot.bodies)
    pairs = [
        *robot.pairs,
        *((body, bodies + one) for body in range(bodies) for one in range(len(obstacles))),
    ]
    told = [body.name for body in robot.bodies] + [one.id for one in obstacles]
    for first, second in pairs:
        geometry.addCollisionPair(pin.CollisionPair(first, second))
    return geometry, [f"{told[first]}/{told[second]}" for first, second in pairs]


def _obstacle(one: Obstacle) -> str:
    return f"obstacle {one.id}"
