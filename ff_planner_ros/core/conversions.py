"""Conversion of robots, starts, targets and obstacles to types of the compiled core."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import coal
import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core import compiled
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.problem.obstacles import Obstacle
from ff_planner_ros.planning.problem.target import Target
from ff_planner_ros.robot.collision.bodies import Body
from ff_planner_ros.robot.collision.primitives import Kind, kind_and_sizes
from ff_planner_ros.robot.kept_with import kept_with_it
from ff_planner_ros.robot.model import Robot

_NOTHING, _ORIGIN, _NO_TURN = np.empty((0, 3)), np.zeros(3), np.eye(3)


@kept_with_it
def chain_of(robot: Robot) -> compiled.Chain:
    """Return a robot's chain: placements, axes and inertias, from its Pinocchio model.

    Raises:
        InvalidInput: Its arm has more joints than the core has room for.
    """
    tree = robot.tree
    if tree.joints > compiled.MAX_JOINTS:
        raise InvalidInput(
            Status.BAD_ROBOT,
            "robot.urdf",
            f"an arm of {tree.joints} joints",
            f"an arm has {compiled.MAX_JOINTS} joints at most; robot.locked_joints holds some",
        )
    model = robot.model
    # The first two joints are Pinocchio's: the universe and the free-flyer, whose body is the base.
    placements = [*model.jointPlacements[2:], model.frames[robot.tip_frame_id].placement]
    bodies = model.inertias[1:]
    return compiled.Chain(
        translations=np.array([placement.translation for placement in placements]),
        rotations=np.array([placement.rotation for placement in placements]),
        axes=tree.axes,
        slides=tree.slides,
        weights=robot.joint_weights,
        masses=np.array([body.mass for body in bodies]),
        centers=np.array([body.lever for body in bodies]),
        inertias=np.array([body.inertia for body in bodies]),
        before=tree.before.tolist(),
        planned=tree.planned.tolist(),
        multipliers=tree.multipliers,
        offsets=tree.offsets,
        tip=tree.tip,
    )


@kept_with_it
def bodies_of(robot: Robot) -> compiled.Bodies:
    """Return a robot's bodies, and the pairs of them that must not touch."""
    return compiled.Bodies(
        [_body_of(body) for body in robot.bodies], np.array(robot.pairs, np.intp).reshape(-1, 2)
    )


def _body_of(body: Body) -> compiled.Body:
    return compiled.Body(
        link=body.joint - 1,
        rotation=body.placement_in_joint.rotation,
        position=body.placement_in_joint.translation,
        center=body.center_in_joint,
        radius=body.radius,
        solid=_solid_of(body.solid, 0.0),
        slide=body.slide_in_joint,
    )


def _solid_of(solid: coal.CollisionGeometry, grown: float) -> compiled.Solid:
    kind, sizes = kind_and_sizes(solid)
    vertices = np.asarray(solid.points()) if kind == Kind.HULL else _NOTHING
    return compiled.Solid(kind, np.array(sizes), vertices, grown)


def obstacles_of(obstacles: Sequence[Obstacle], until: float) -> compiled.Obstacles:
    """Return obstacles, with their motion until a time [s] after the plan's first point."""
    last = until if any(one.body is not None for one in obstacles) else 0.0
    return _obstacles_of(tuple(obstacles), last)


@lru_cache(maxsize=8)
def _obstacles_of(obstacles: tuple[Obstacle, ...], until: float) -> compiled.Obstacles:
    bodies = {id(one.body): one.body for one in obstacles if one.body is not None}
    carriers = {
        key: compiled.TumblingBody(
            body.position, body.linear_velocity, *body.attitude_series(until)
        )
        for key, body in bodies.items()
    }
    return compiled.Obstacles([_obstacle_of(one, carriers.get(id(one.body))) for one in obstacles])


def _obstacle_of(one: Obstacle, carrier: compiled.TumblingBody | None) -> compiled.Obstacle:
    motion, place = one.motion, one.motion.place_in_body
    if one.is_sphere:  # there may be a thousand; its attitude does not matter
        solid = compiled.Solid(Kind.ROUND, np.array([one.radius, 0.0, 0.0]), _NOTHING, 0.0)
        center, rotation = _ORIGIN, _NO_TURN
    else:
        solid, center = _solid_of(one.solid.geometry, one.solid.grown), one.solid.center
        rotation = motion.rotation if place is None else place.rotation
    return compiled.Obstacle(
        solid=solid,
        center=center,
        radius=one.radius,
        rotation=rotation,
        position=motion.position if place is None else place.translation,
        velocity=motion.velocity,
        rate=motion.angular_velocity,
        body=carrier,
    )


def start_of(robot: Robot, q: Array, v: Array) -> compiled.Start:
    """Return base pose, centre of mass, and momentum about it, of a system at its start.

    Args:
        q: Configuration. Shape (7 + joints,).
        v: Tangent velocity. Shape (6 + joints,).
    """
    data = robot.model.createData()
    momentum = pin.computeCentroidalMomentum(robot.model, data, q, v)
    rotation = pin.Quaternion(q[3:7]).toRotationMatrix()
    return compiled.Start(q[:3], rotation, data.com[0], momentum.vector, robot.base)


def target_of(target: Target) -> compiled.Target:
    """Return a target, with two axes of the end effector normal to its free axis."""
    axis = np.zeros(3) if target.free_axis_in_ee is None else target.free_axis_in_ee
    _, _, axes = np.linalg.svd(axis[None])
    return compiled.Target(
        target.position,
        pin.Quaternion(target.quaternion_xyzw).toRotationMatrix(),
        np.append(target.linear_velocity, target.angular_velocity),
        np.append(target.linear_acceleration, target.angular_acceleration),
        target.orientation,
        axis,
        axes[1:],
    )
