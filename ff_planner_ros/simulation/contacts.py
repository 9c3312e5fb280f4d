"""Which bodies touch along a motion: MuJoCo's collision detection, on MuJoCo's own links.

Contacts are seen and do not push: the first one fails the plan, and a motion after a push would say
nothing about it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.distance.clearance import centers_at
from ff_planner_ros.planning.problem.scene import Scene
from ff_planner_ros.robot.collision.bodies import Body
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.simulation.engine import compiled, mujoco, specification

# So often it is looked between two states of an execution. From one to the next nothing turns by
# more than 0.01 rad: from look to look a corner 3 m away moves 1.5 mm.
LOOKS = 20

# What a geom must not bring along: mass, and contacts beside those that are asked for.
_BARE: dict[str, Any] = {"mass": 0.0, "contype": 0, "conaffinity": 0}


@dataclass(frozen=True)
class Contact:
    """Two things that must not touch, and do."""

    pair: str  # "body/body" or "body/obstacle", by their names
    first_time: float  # when they begin to, from the start of the plan [s]
    time: float  # when they are deepest in each other [s]
    depth: float  # then [m]


class Touch:
    """A robot's bodies in a scene, in MuJoCo."""

    def __init__(self, robot: Robot, scene: Scene) -> None:
        """Give each link the geoms of its bodies.

        Raises:
            InvalidInput: MuJoCo refuses a shape.
        """
        obstacles = scene.spheres
        spec, names = specification(robot.urdf)
        spec.compiler.discardvisual = False  # else what is in no pair is left out
        bodies = [f"body {number}" for number in range(len(robot.bodies))]
        spheres = [f"obstacle {number}" for number in range(len(obstacles))]
        for geom, body in zip(bodies, robot.bodies, strict=True):
            _add_geom(spec, names[body.link], geom, robot, body)
        for geom, sphere in zip(spheres, obstacles, strict=True):
            mover = spec.worldbody.add_body(name=geom, mocap=True)
            size = [sphere.radius, 0.0, 0.0]
            mover.add_geom(name=geom, type=mujoco.mjtGeom.mjGEOM_SPHERE, size=size, **_BARE)
        pairs = [(bodies[first], bodies[second]) for first, second in robot.pairs]
        pairs += [(body, sphere) for body in bodies for sphere in spheres]
        for first, second in pairs:
            spec.add_pair(geomname1=first, geomname2=second)
        self.pairs = len(pairs)
        self._model = compiled(spec)
        self._data = mujoco.MjData(self._model)
        told = [one.name for one in robot.bodies] + [one.id for one in obstacles]
        links = [one.link for one in robot.bodies] + [one.id for one in obstacles]
        order = {self._model.geom(geom).id: n for n, geom in enumerate([*bodies, *spheres])}
        self._order = [order[geom] for geom in range(self._model.ngeom)]
        self._names = [told[number] for number in self._order]
        self._links = [links[number] for number in self._order]
        self._scene, self._tip = scene, self._data.body(names[robot.tip_link])

    def depths(self, q: Array, time: float) -> dict[str, float]:
        """Return how deep the bodies of each pair are in each other [m], of all that touch.

        Args:
            q: MuJoCo's configuration.
            time: From the start of the plan [s].
        """
        (centers,) = centers_at(np.array([time]), self._scene.spheres)
        return {pair: max(depths) for pair, depths in self._seen(q, centers)[0].items()}

    def _seen(self, q: Array, centers: Array) -> tuple[dict[str, list[float]], set[str]]:
        """Return the depths of each pair that touches, and which of these may near the goal."""
        data = self._data
        data.qpos[:] = q
        data.mocap_pos[:] = centers
        mujoco.mj_kinematics(self._model, data)
        mujoco.mj_collision(self._model, data)
        found: dict[str, list[float]] = {}
        allowed: set[str] = set()
        for geoms, distance in zip(data.contact.geom, data.contact.dist, strict=True):
            if distance < 0.0:  # one pair may touch in several points
                first, second = sorted(geoms.tolist(), key=self._order.__getitem__)
                pair = f"{self._names[first]}/{self._names[second]}"
                found.setdefault(pair, []).append(-float(distance))
                links = self._links[first], self._links[second]
                names = {"/".join(links), "/".join(reversed(links))}
                if names & set(self._scene.allowed_collisions):
                    allowed.add(pair)
        return found, allowed

    def along(self, states: Sequence[Array], times: Array) -> tuple[Contact, ...]:
        """Return all contacts along a motion, the earliest first.

        Args:
            states: Of the engine: MuJoCo's configuration comes first in them.
            times: Of the states, from the start of the plan. Shape (states,) [s].
        """
        found: list[tuple[float, str, float, bool]] = []
        outside = -np.inf  # when the end effector was last away from the goal
        for configurations, moments in _looks(states, times, self._model.nq):
            centers = centers_at(moments, self._scene.spheres)
            targets = self._scene.targets(moments)
            for look, time in enumerate(moments.tolist()):
                depths, allowed = self._seen(configurations[look], centers[look])
                found += [(time, pair, max(deep), pair in allowed) for pair, deep in depths.items()]
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


def _looks(states: Sequence[Array], times: Array, size: int) -> Iterator[tuple[Array, Array]]:
    """Yield configurations and their times: on each chord between states, and the last state.

    They are off the arc by a few micrometres.
    """
    shares = np.arange(LOOKS) / LOOKS
    for (first, second), (begin, end) in zip(
        pairwise(states), pairwise(times.tolist()), strict=False
    ):
        chord = np.outer(1.0 - shares, first[:size]) + np.outer(shares, second[:size])
        yield chord, (1.0 - shares) * begin + shares * end
    yield states[-1][None, :size], times[len(states) - 1 : len(states)]


def _add_geom(spec: mujoco.MjSpec, link: str, name: str, robot: Robot, body: Body) -> None:
    frame = robot.model.frames[robot.model.getFrameId(body.link, pin.FrameType.BODY)]
    placement = frame.placement.actInv(body.placement_in_joint)
    place = {
        "pos": placement.translation.tolist(),
        "quat": np.roll(pin.Quaternion(placement.rotation).coeffs(), 1).tolist(),
    }
    solid, kinds = body.solid, mujoco.mjtGeom
    owner = spec.body(link)
    if isinstance(solid, coal.Sphere):
        kind, size = kinds.mjGEOM_SPHERE, [solid.radius, 0.0, 0.0]
    elif isinstance(solid, coal.Capsule):
        kind, size = kinds.mjGEOM_CAPSULE, [solid.radius, solid.halfLength, 0.0]
    elif isinstance(solid, coal.Cylinder):
        kind, size = kinds.mjGEOM_CYLINDER, [solid.radius, solid.halfLength, 0.0]
    elif isinstance(solid, coal.Box):
        kind, size = kinds.mjGEOM_BOX, np.asarray(solid.halfSide).tolist()
    else:
        # MuJoCo makes the hull of the corners by itself.
        mesh = spec.add_mesh(name=name)
        mesh.uservert = np.asarray(solid.points(), np.float64).ravel().tolist()
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
        owner.add_geom(name=name, type=kinds.mjGEOM_MESH, meshname=name, **place, **_BARE)
        return
    owner.add_geom(name=name, type=kind, size=size, **place, **_BARE)
