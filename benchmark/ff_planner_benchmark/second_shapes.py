"""The bodies of a robot and obstacles in Drake, which measures their distances.

Drake has no cones: a pyramid stands for each. Poses of obstacles are computed from their states at
the plan's first point alone, not by the planner.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from functools import lru_cache
from typing import Any

import coal
import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from ff_planner_benchmark.second_engine import AbstractValue, RigidTransform, as_pose, geometry
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.problem.problem import Obstacle
from ff_planner_ros.planning.problem.target_body import TargetBody
from ff_planner_ros.robot.collision.lines import with_bodies
from ff_planner_ros.robot.model import Robot

# Drake has no solids without thickness [m].
_THINNEST = 1e-6
# A pyramid of so many sides is thinner than its cone by 2e-5 of the radius at most.
_SIDES = 512
# Of the integration of Euler's equations.
_ACCURACY = 1e-10


class Shapes:
    """Drake's distances of a robot's bodies, or centre lines, from each other and obstacles."""

    def __init__(
        self, robot: Robot, obstacles: Sequence[Obstacle], may_touch: Collection[str] = ()
    ) -> None:
        """Register all solids.

        Args:
            obstacles: At the plan's first point.
            may_touch: Pairs that are not measured, named as in `allowed_collisions`.
        """
        robot = with_bodies(robot)
        self._bodies, self._obstacles = robot.bodies, obstacles
        solids = {one.name: one.solid for one in robot.bodies}
        solids |= {one.id: one.solid.geometry for one in obstacles}
        self._graph: Any = geometry.SceneGraph()
        self._source = self._graph.RegisterSource("solids")
        added = {name: self._added(name, solid) for name, solid in solids.items()}
        self._frames = [frame for frame, _ in added.values()]
        names = [one.name for one in robot.bodies]
        pairs = [(names[first], names[second]) for first, second in robot.pairs]
        pairs += [(name, one.id) for name in names for one in obstacles]
        links = {one.name: one.link for one in robot.bodies}
        told = [[links.get(name, name) for name in pair] for pair in pairs]
        self._pairs = {
            "/".join(pair): [added[name][1] for name in pair]
            for pair, (a, b) in zip(pairs, told, strict=True)
            if not {f"{a}/{b}", f"{b}/{a}"}.intersection(may_touch)
        }
        self._context = self._graph.CreateDefaultContext()

    def _added(self, name: str, solid: coal.CollisionGeometry) -> tuple[Any, Any]:
        """Register a solid in a frame of its own, and return Drake's ids of both."""
        frame = self._graph.RegisterFrame(self._source, geometry.GeometryFrame(name))
        one = geometry.GeometryInstance(RigidTransform(), _shape(solid), name)
        one.set_proximity_properties(geometry.ProximityProperties())
        return frame, self._graph.RegisterGeometry(self._source, frame, one)

    def distances(self, links: Sequence[Any], time: float) -> dict[str, float]:
        """Return the signed distance of each pair [m], by the names of both.

        Args:
            links: As a `Look` is told.
            time: From the plan's first point on [s].
        """
        poses = [
            links[one.joint - 1] @ RigidTransform(one.placement_in_joint.homogeneous)
            for one in self._bodies
        ]
        poses += [_obstacle_at(one, time) for one in self._obstacles]
        placed = geometry.FramePoseVector()
        for frame, pose in zip(self._frames, poses, strict=True):
            placed.set_value(frame, pose)
        port = self._graph.get_source_pose_port(self._source)
        port.FixValue(self._context, AbstractValue.Make(placed))
        query = self._graph.get_query_output_port().Eval(self._context)
        return {
            pair: query.ComputeSignedDistancePairClosestPoints(*both).distance
            for pair, both in self._pairs.items()
        }


def _shape(solid: coal.CollisionGeometry) -> Any:
    """Return Drake's shape of a solid."""
    match solid:
        case coal.Sphere():
            return geometry.Sphere(solid.radius)
        case coal.Capsule():
            return geometry.Capsule(max(solid.radius, _THINNEST), 2.0 * solid.halfLength)
        case coal.Cylinder():
            return geometry.Cylinder(solid.radius, 2.0 * solid.halfLength)
        case coal.Box():
            return geometry.Box(*(2.0 * solid.halfSide))
        case coal.Cone():
            angles = 2.0 * np.pi / _SIDES * np.arange(_SIDES)
            rim = solid.radius * np.array([np.cos(angles), np.sin(angles)])
            base = np.vstack([rim, np.full(_SIDES, -solid.halfLength)])
            corners: Any = np.column_stack([base, [0.0, 0.0, solid.halfLength]])
        case _:
            corners = np.transpose(solid.points())
    return geometry.Convex(corners, "hull")


def _obstacle_at(one: Obstacle, time: float) -> Any:
    """Return an obstacle's pose, inertial."""
    motion = one.motion
    turn, place = Rotation.from_quat(motion.quaternion_xyzw), motion.position
    if one.body is not None:
        begin = _body_at(one.body, 0.0)
        return _body_at(one.body, time) @ begin.inverse() @ _drakes(turn, place)
    turned = Rotation.from_rotvec(time * motion.angular_velocity)
    return _drakes(turned * turn, place + time * motion.velocity)


@lru_cache(maxsize=2)
def _body_at(body: TargetBody, time: float) -> Any:
    """Return a target body's pose, inertial, by Euler's equations without torque.

    Cached, as all that is fixed to it asks for the same.
    """
    turn = Rotation.from_quat(body.quaternion_xyzw)

    def derivative(_: float, state: Array) -> Array:
        axis, scalar, rate = state[:3], state[3], state[4:]
        turning = np.append(scalar * rate + np.cross(axis, rate), -axis @ rate) / 2.0
        gyroscopic = np.cross(body.inertia @ rate, rate)
        return np.append(turning, np.linalg.solve(body.inertia, gyroscopic))

    start = np.append(turn.as_quat(), turn.as_matrix().T @ body.angular_velocity)
    way = solve_ivp(derivative, (0.0, time), start, "DOP853", rtol=_ACCURACY, atol=_ACCURACY)
    turned = Rotation.from_quat(way.y[:4, -1])
    return _drakes(turned, body.position + time * body.linear_velocity)


def _drakes(turn: Rotation, place: Array) -> Any:
    return RigidTransform(as_pose(turn.as_matrix(), place))
