"""Contacts along a motion, by MuJoCo's collision detection on MuJoCo's own links.

For a robot with geometry `lines`, the arm's centre lines are checked against obstacles. Contacts
exert no force: the first one fails the plan, and a motion after a push would say nothing about it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.problem.scene import Scene
from ff_planner_ros.robot.collision.bodies import Body
from ff_planner_ros.robot.collision.lines import with_bodies
from ff_planner_ros.robot.collision.primitives import kind_and_sizes
from ff_planner_ros.robot.configuration import eigen_quaternion
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.quaternion import quaternion_from_rotation
from ff_planner_ros.simulation.mujoco_model import compiled, mujoco, specification

# Checks between two states of an execution, and in a second, at least. From one state to the next
# nothing turns by more than 0.01 rad: from check to check a corner 3 m away moves 1.5 mm.
LOOKS, _LOOKS_A_SECOND = 20, 1000.0
# Checks for which obstacles are placed at once: more would save no time, but take memory.
_AT_ONCE = 1000

# What a geom must not bring along: mass, and contacts beside those that are asked for.
_BARE: dict[str, Any] = {"mass": 0.0, "contype": 0, "conaffinity": 0}


@dataclass(frozen=True)
class Contact:
    """A contact of a pair that must not touch."""

    pair: str  # "body/body" or "body/obstacle", by their names
    first_time: float  # first time of contact, from the start of the plan [s]
    time: float  # time of the deepest penetration, from the start of the plan [s]
    depth: float  # deepest penetration [m]


# What is nearer than this touches [m].
_TOUCHING = 1e-5
# MuJoCo has no solids without thickness [m].
_THINNEST = 1e-6
# MuJoCo's kinds; any other is a mesh.
_GEOMS = {
    coal.Sphere: mujoco.mjtGeom.mjGEOM_SPHERE,
    coal.Capsule: mujoco.mjtGeom.mjGEOM_CAPSULE,
    coal.Cylinder: mujoco.mjtGeom.mjGEOM_CYLINDER,
    coal.Box: mujoco.mjtGeom.mjGEOM_BOX,
}
# A pyramid stands for a cone: it is thinner by so much at most [m], or has so many sides.
_THINNER, _FEWEST_SIDES, _MOST_SIDES = 5e-5, 128, 2048


class Touch:
    """MuJoCo's contact checks of a robot's bodies, or centre lines, in a scene."""

    def __init__(self, robot: Robot, scene: Scene) -> None:
        """Build a model with the geoms of all bodies and obstacles.

        Args:
            scene: In the inertial frame of the states to check.

        Raises:
            InvalidInput: MuJoCo refuses a shape.
        """
        obstacles = scene.obstacles
        robot = with_bodies(robot)
        spec, names = specification(robot.urdf)
        spec.compiler.discardvisual = False  # else what is in no pair is left out
        bodies = [f"body {number}" for number in range(len(robot.bodies))]
        others = [f"obstacle {number}" for number in range(len(obstacles))]
        for geom, body in zip(bodies, robot.bodies, strict=True):
            frame = _carrier(robot, body)
            placement = frame.placement.actInv(body.placement_in_joint)
            _add_geom(spec, spec.body(names[frame.name]), geom, body.solid, placement)
        for geom, one in zip(others, obstacles, strict=True):
            mover = spec.worldbody.add_body(name=geom, mocap=True)
            _add_geom(spec, mover, geom, one.solid.geometry, pin.SE3.Identity())
        pairs = [(bodies[first], bodies[second]) for first, second in robot.pairs]
        pairs += [(body, other) for body in bodies for other in others]
        for first, second in pairs:
            spec.add_pair(geomname1=first, geomname2=second)
        self.pairs = len(pairs)
        self._model = compiled(spec)
        self._data = mujoco.MjData(self._model)
        told = [one.name for one in robot.bodies] + [one.id for one in obstacles]
        links = [one.link for one in robot.bodies] + [one.id for one in obstacles]
        order = {self._model.geom(geom).id: n for n, geom in enumerate([*bodies, *others])}
        self._order = [order[geom] for geom in range(self._model.ngeom)]
        self._names = [told[number] for number in self._order]
        self._links = [links[number] for number in self._order]
        self._scene, self._tip = scene, self._data.body(names[robot.tip_link])
        self._base = self._data.body(names[robot.base_link])
        self._mocaps = {one.id: number for number, one in enumerate(obstacles)}
        self._allowed = [
            tuple(self._model.geom(geom).id for geom in pair)
            for pair in pairs
            if self._may_touch(*(self._model.geom(geom).id for geom in pair))
        ]

    def _places(self, times: Array) -> tuple[Array, Array]:
        """Return obstacle positions, (times, obstacles, 3), and quaternions, (..., 4), w first."""
        obstacles = self._scene.obstacles
        rotations = np.empty((len(times), len(obstacles), 3, 3))
        positions = np.empty((len(times), len(obstacles), 3))
        for number, one in enumerate(obstacles):
            rotations[:, number], positions[:, number] = one.motion.poses(times)
        return positions, np.roll(quaternion_from_rotation(rotations), 1, axis=-1)

    def _seen(
        self, q: Array, positions: Array, turns: Array
    ) -> tuple[dict[str, list[float]], set[str]]:
        """Return the depths of each pair that touches, and the allowed collisions among them."""
        data = self._data
        data.qpos[:] = q
        data.mocap_pos[:], data.mocap_quat[:] = positions, turns
        mujoco.mj_kinematics(self._model, data)
        mujoco.mj_collision(self._model, data)
        found: dict[str, list[float]] = {}
        allowed: set[str] = set()
        for geoms, distance in zip(data.contact.geom, data.contact.dist, strict=True):
            if distance < 0.0:  # one pair may touch in several points
                first, second = sorted(geoms.tolist(), key=self._order.__getitem__)
                pair = f"{self._names[first]}/{self._names[second]}"
                found.setdefault(pair, []).append(-float(distance))
                if self._may_touch(first, second):
                    allowed.add(pair)
        return found, allowed

    def _may_touch(self, first: int, second: int) -> bool:
        links = self._links[first], self._links[second]
        names = {"/".join(links), "/".join(reversed(links))}
        return bool(names & set(self._scene.allowed_collisions))

    def _touching(self) -> dict[str, int]:
        """Return the allowed pairs that touch now, each with its obstacle's number; -1: a link."""
        return {
            f"{self._names[first]}/{self._names[second]}": self._mocaps.get(self._names[second], -1)
            for first, second in self._allowed
            if mujoco.mj_geomDistance(self._model, self._data, first, second, 1.0, np.zeros(6))
            < _TOUCHING
        }

    def _tip_seen(self, obstacle: int) -> Array:
        """Return the end effector's position in the frame of an obstacle; -1: of the base."""
        data, place, turn = self._data, self._base.xpos, self._base.xquat
        if obstacle >= 0:
            place, turn = data.mocap_pos[obstacle], data.mocap_quat[obstacle]
        back, seen = np.empty(4), np.empty(3)
        mujoco.mju_negQuat(back, turn)
        mujoco.mju_rotVecQuat(seen, self._tip.xpos - place, back)
        return seen

    def along(self, states: Sequence[Array], times: Array) -> tuple[Contact, ...]:
        """Return all contacts along a motion, the earliest first.

        Allowed collisions are ignored near the goal, and where they exist at the start, until the
        end effector has moved `contact_distance` from there relative to the obstacle.

        Args:
            states: States of `Engine`, which begin with MuJoCo's configuration.
            times: From the start of the plan, at least as many as states. Shape (times,) [s].
        """
        found: list[tuple[float, str, float, bool]] = []
        outside = -np.inf  # when the end effector was last away from the goal
        # What touches since the start: its obstacle, and where the end effector was, seen from it
        held: dict[str, tuple[int, Array]] | None = None
        for configurations, moments in _looks(states, times, self._model.nq):
            positions, turns = self._places(moments)
            targets = self._scene.targets(moments)
            for look, time in enumerate(moments.tolist()):
                depths, allowed = self._seen(configurations[look], positions[look], turns[look])
                if held is None:
                    held = {
                        pair: (one, self._tip_seen(one)) for pair, one in self._touching().items()
                    }
                for pair, (one, first) in list(held.items()):
                    if np.linalg.norm(self._tip_seen(one) - first) > self._scene.contact_distance:
                        del held[pair]
                found += [
                    (time, pair, max(deep), pair in allowed)
                    for pair, deep in depths.items()
                    if pair not in held
                ]
                if (
                    targets is None
                    or np.linalg.norm(self._tip.xpos - targets[look]) > self._scene.contact_distance
                ):
                    outside = time
        told: dict[str, Contact] = {}
        for time, pair, depth, may in found:
            if may and time > outside:
                continue
            before = told.setdefault(pair, Contact(pair, time, time, depth))
            if depth > before.depth:
                told[pair] = Contact(pair, before.first_time, time, depth)
        return tuple(told.values())


def _carrier(robot: Robot, body: Body) -> pin.Frame:
    """Return the frame of the link that a body is fixed to.

    For a centre line, it is that of the first link that its joint moves.
    """
    if robot.model.existFrame(body.link, pin.FrameType.BODY):
        return robot.model.frames[robot.model.getFrameId(body.link, pin.FrameType.BODY)]
    return next(
        frame
        for frame in robot.model.frames
        if frame.type is pin.FrameType.BODY and frame.parentJoint == body.joint
    )


def _looks(states: Sequence[Array], times: Array, size: int) -> Iterator[tuple[Array, Array]]:
    """Yield configurations and times to check: on each chord between states, and the last state.

    Chords are off the motion by a few micrometres. They come many at a time, in order: obstacles
    are placed for all of these times at once.
    """
    chords, moments, count = list[Array](), list[Array](), 0
    for (first, second), (begin, end) in zip(
        pairwise(states), pairwise(times.tolist()), strict=False
    ):
        looks = max(LOOKS, math.ceil((end - begin) * _LOOKS_A_SECOND))
        shares = np.arange(looks) / looks
        chord = np.outer(1.0 - shares, first[:size]) + np.outer(shares, second[:size])
        chords.append(chord)
        moments.append((1.0 - shares) * begin + shares * end)
        count += looks
        if count >= _AT_ONCE:
            yield np.concatenate(chords), np.concatenate(moments)
            chords, moments, count = [], [], 0
    chords.append(states[-1][None, :size])
    moments.append(times[len(states) - 1 : len(states)])
    yield np.concatenate(chords), np.concatenate(moments)


def _add_geom(
    spec: mujoco.MjSpec,
    owner: mujoco.MjsBody,
    name: str,
    solid: coal.CollisionGeometry,
    placement: pin.SE3,
) -> None:
    place = {
        "pos": placement.translation.tolist(),
        "quat": np.roll(eigen_quaternion(placement.rotation), 1).tolist(),
    }
    kinds = mujoco.mjtGeom
    kind, size = _GEOMS.get(type(solid)), [*kind_and_sizes(solid)[1]]
    if kind == kinds.mjGEOM_CAPSULE and not solid.radius:
        # A thin capsule may pass through a box unseen.
        kind, size = kinds.mjGEOM_BOX, [_THINNEST, _THINNEST, solid.halfLength]
    if kind is None:
        # MuJoCo makes the hull of the corners by itself, and about its own centre and axes.
        mesh = spec.add_mesh(name=name)
        corners = _cone(solid) if isinstance(solid, coal.Cone) else np.asarray(solid.points())
        mesh.uservert = np.asarray(corners, np.float64).ravel().tolist()
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
        owner.add_geom(name=name, type=kinds.mjGEOM_MESH, meshname=name, **place, **_BARE)
        return
    owner.add_geom(name=name, type=kind, size=size, **place, **_BARE)


def _cone(solid: coal.Cone) -> Array:
    """Return the corners of a pyramid in a cone, which MuJoCo does not know."""
    # A side of angle a is off its arc by radius (1 - cos a / 2).
    enough = np.pi / math.acos(max(0.0, 1.0 - _THINNER / solid.radius))
    sides = min(max(_FEWEST_SIDES, math.ceil(enough)), _MOST_SIDES)
    angles = 2 * np.pi / sides * np.arange(sides)
    rim = np.column_stack([np.cos(angles), np.sin(angles)]) * solid.radius
    base = np.column_stack([rim, np.full(sides, -solid.halfLength)])
    return np.vstack([base, [0.0, 0.0, solid.halfLength]])
