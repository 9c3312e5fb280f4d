"""A plan and its scene as markers, for RViz, Foxglove and other viewers."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from copy import copy
from dataclasses import replace

import numpy as np
from geometry_msgs.msg import Point
from scipy.spatial.transform import Rotation
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from ff_planner_ros.analysis.drawing.obstacle_surfaces import obstacle_surface
from ff_planner_ros.analysis.drawing.solids import robot_surface, surface_at
from ff_planner_ros.analysis.drawing.surroundings import constraint_lines
from ff_planner_ros.analysis.nearest import Nearest, nearest_of
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.distance.clearance import arm_points
from ff_planner_ros.planning.distance.surroundings import obstacle_poses
from ff_planner_ros.planning.motion.motion import from_trajectory
from ff_planner_ros.planning.motion.plan import Plan, Trajectory
from ff_planner_ros.planning.problem.obstacles import Obstacle, attached
from ff_planner_ros.planning.problem.scene import Scene
from ff_planner_ros.planning.task.captured import CapturedBody, captured_in
from ff_planner_ros.robot.collision.box import uniform_box
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.ros.messages.to_messages import point_message, pose_message

# Number of times at which arm and chaser are shown, evenly spaced; later ones are more solid.
SNAPSHOTS = 5
_FAINT, _SOLID = 0.2, 0.9  # opacity of the first and the last of them
_ARM_WIDTH, _PATH_WIDTH = 0.04, 0.015  # [m] seen well beside a chaser of one metre
# Okabe and Ito's colours, which colour-blind readers tell apart: red, green, blue, opacity.
_OBSTACLE = (0.84, 0.37, 0.0, 0.5)
_EE_PATH = (0.0, 0.45, 0.70, 1.0)
_TARGET, _GRASP_PATH, _WAY = (0.94, 0.89, 0.26), (0.94, 0.89, 0.26, 1.0), _OBSTACLE
_GUIDE, _GUIDE_WIDTH = (0.0, 0.0, 0.0, 0.8), 0.004
_CHASER_PATH = (0.0, 0.62, 0.45, 1.0)
_ARM, _CHASER = _EE_PATH[:3], _CHASER_PATH[:3]
_BODIES, _NEAREST = (0.80, 0.47, 0.65), (0.84, 0.0, 0.0, 1.0)
_TEXT_HEIGHT = 0.08  # [m]
# A plan that waits for release: prefix of its namespaces, and the colour of what moves.
WAITING = "waiting/"
_WAITING = (0.90, 0.62, 0.0)
_MOVES = ("arm", "chaser", "bodies", "end_effector_path", "chaser_path")
_AROUND = 24  # corners of a circle


def plan_markers(
    robot: Robot,
    plan: Plan,
    scene: Scene,
    inertial_frame: str,
) -> MarkerArray:
    """Return the markers of a plan and its scene, in the inertial frame.

    The first marker deletes all earlier ones. Ids count from 0 in each namespace, in the order of
    the obstacles and of time. Namespaces:

    - `obstacles`, at the first point, and `obstacle_path` of those that move.
    - `end_effector_path`, `chaser_path`, and at `SNAPSHOTS` times `arm` and `chaser`, a box.
    - `bodies`: collision geometry at these times; the chaser's own replaces the box.
    - `nearest`: line and text at the minimum distance, of the motion until a grasp that a phase
      follows.
    - `grasp_path` and, at these times, `target_body` of a captured body; after a grasp that a phase
      follows, it moves with the end effector.
    - Those of `constraint_lines`, for constraints on the end effector's path.
    """
    obstacles, captured = scene.obstacles, captured_in(scene)
    motion, end = plan.trajectory, float(plan.trajectory.time[-1])
    shown = np.linspace(0, len(motion.time) - 1, SNAPSHOTS).round().astype(int)
    opacities = np.linspace(_FAINT, _SOLID, SNAPSHOTS).tolist()
    q, _ = from_trajectory(robot, motion)
    arms = arm_points(robot, q[shown])
    box = uniform_box(robot)
    attitudes = Rotation.from_quat(motion.chaser_quaternions_xyzw[shown])
    turns = (attitudes * Rotation.from_matrix(box.rotation_box_to_chaser)).as_quat()
    chasers = zip(motion.chaser_positions[shown].tolist(), turns.tolist(), strict=True)
    surface = robot_surface(robot) if robot.bodies else None
    alone = slice(int(np.searchsorted(motion.time, scene.held_from, side="right")))
    allowed = scene.allowed_collisions
    near = nearest_of(robot, q[alone], motion.time[alone], obstacles, allowed)
    boxed = not any(body.joint == 1 for body in robot.bodies)
    markers = [
        Marker(action=Marker.DELETEALL),
        *(
            marker
            for one in obstacles
            if one.body is None
            for marker in _obstacle("obstacles", one, np.zeros(1), [_OBSTACLE])
        ),
        *(
            _line("obstacle_path", obstacle_poses(one, np.array([0.0, end]))[1], _PATH_WIDTH, _WAY)
            for one in obstacles
            if one.body is None and one.moves
        ),
        *(() if captured is None else _target_body(captured, motion, shown, opacities)),
        *(_lines(name, lines) for name, lines in constraint_lines(scene, robot, motion).items()),
        _line("end_effector_path", motion.ee_positions, _PATH_WIDTH, _EE_PATH),
        _line("chaser_path", motion.chaser_positions, _PATH_WIDTH, _CHASER_PATH),
        *(
            _line("arm", points, _ARM_WIDTH, (*_ARM, opacity))
            for points, opacity in zip(arms, opacities, strict=True)
        ),
        *(
            _solid("chaser", Marker.CUBE, position, box.edges, (*_CHASER, opacity), turn)
            for (position, turn), opacity in zip(chasers, opacities, strict=True)
            if boxed
        ),
    ]
    if surface is not None:
        for corners, opacity in zip(surface_at(robot, surface, q[shown]), opacities, strict=True):
            markers.append(_surface("bodies", corners[surface.triangles], (*_BODIES, opacity)))
    if near is not None:
        markers += _marked(near)
    ids: dict[str, int] = {}
    for marker in markers:
        # Stamp zero: to be drawn whatever time it is.
        marker.header = Header(frame_id=inertial_frame)
        marker.id = ids[marker.ns] = ids.get(marker.ns, -1) + 1
    return MarkerArray(markers=markers)


def waiting_markers(plan_id: str, markers: Iterable[Marker]) -> Iterator[Marker]:
    """Yield the markers of a plan as those of a plan that waits for release, and a text.

    Their namespaces begin with `waiting/`. What moves has another colour than in a published plan.
    """
    header, place = Header(), Point()
    for drawn in map(copy, markers):
        if drawn.ns in _MOVES:
            drawn.color = ColorRGBA(**dict(zip("rgb", _WAITING, strict=True)), a=drawn.color.a)
        if drawn.ns == "end_effector_path":
            header, place = drawn.header, drawn.points[-1]
        drawn.ns = f"{WAITING}{drawn.ns}"
        yield drawn
    words = Marker(ns=f"{WAITING}words", type=Marker.TEXT_VIEW_FACING, header=header)
    words.text = f"{plan_id} waits to be released"
    words.color = _colour((*_WAITING, 1.0))
    words.pose.position = Point(x=place.x, y=place.y, z=place.z + 2.0 * _TEXT_HEIGHT)
    words.scale.x = words.scale.y = words.scale.z = _TEXT_HEIGHT
    yield words


def _target_body(
    captured: CapturedBody, motion: Trajectory, shown: Array, opacities: Sequence[float]
) -> Iterator[Marker]:
    """Yield the path of a body's grasp, and what is fixed to the body at some of the points."""
    body, there = captured.body, captured.along(motion)
    grasps = Rotation.from_quat(there.quaternions_xyzw).apply(body.grasp_position.copy())
    yield _line("grasp_path", there.positions + grasps, _PATH_WIDTH, _GRASP_PATH)
    for point, opacity in zip(shown.tolist(), opacities, strict=True):
        place, turn = there.positions[point], there.quaternions_xyzw[point]
        for one in attached(replace(body, position=place, quaternion_xyzw=turn)):
            yield from _obstacle("target_body", one, np.zeros(1), [(*_TARGET, opacity)])


def _obstacle(
    namespace: str, one: Obstacle, times: Array, colours: Sequence[Sequence[float]]
) -> Iterator[Marker]:
    """Yield an obstacle at some times."""
    rotations, origins = obstacle_poses(one, times)
    turns = Rotation.from_matrix(rotations).as_quat().tolist()
    for place, turn, colour in zip(origins.tolist(), turns, colours, strict=True):
        if one.is_sphere:
            yield _solid(namespace, Marker.SPHERE, place, [2 * one.radius] * 3, colour)
        elif one.solid.kind == "box":
            yield _solid(namespace, Marker.CUBE, place, one.solid.sizes, colour, turn)
        else:
            corners, triangles = obstacle_surface(one, _AROUND)
            marker = _surface(namespace, corners[triangles], colour)
            marker.pose = pose_message(place, turn)
            yield marker


def _lines(namespace: str, lines: Array) -> Marker:
    """Return separate lines as a marker; shape (lines, 2 ends, 3)."""
    marker = _line(namespace, lines.reshape(-1, 3), _GUIDE_WIDTH, _GUIDE)
    marker.type = Marker.LINE_LIST
    return marker


def _solid(
    namespace: str,
    kind: int,
    position: Sequence[float],
    edges: Sequence[float] | Array,
    colour: Sequence[float],
    quaternion_xyzw: Sequence[float] = (0.0, 0.0, 0.0, 1.0),
) -> Marker:
    marker = Marker(ns=namespace, type=kind, color=_colour(colour))
    marker.pose = pose_message(position, quaternion_xyzw)
    marker.scale.x, marker.scale.y, marker.scale.z = (float(edge) for edge in edges)
    return marker


def _surface(namespace: str, triangles: Array, colour: Sequence[float]) -> Marker:
    """Return triangles as a marker; shape (triangles, 3 corners, 3)."""
    marker = Marker(ns=namespace, type=Marker.TRIANGLE_LIST, color=_colour(colour))
    marker.scale.x = marker.scale.y = marker.scale.z = 1.0
    marker.points = [point_message(point) for point in triangles.reshape(-1, 3).tolist()]
    return marker


def _marked(near: Nearest) -> tuple[Marker, Marker]:
    words = Marker(ns="nearest", type=Marker.TEXT_VIEW_FACING, text=near.words)
    words.color = _colour(_NEAREST)
    words.pose = pose_message(near.ends.mean(axis=0).tolist(), (0.0, 0.0, 0.0, 1.0))
    words.scale.x = words.scale.y = words.scale.z = _TEXT_HEIGHT
    return _line("nearest", near.ends, _PATH_WIDTH, _NEAREST), words


def _line(namespace: str, points: Array, width: float, colour: Sequence[float]) -> Marker:
    marker = Marker(ns=namespace, type=Marker.LINE_STRIP, color=_colour(colour))
    marker.scale.x = width
    marker.points = [point_message(point) for point in points.tolist()]
    return marker


def _colour(colour: Sequence[float]) -> ColorRGBA:
    red, green, blue, opacity = colour
    return ColorRGBA(r=red, g=green, b=blue, a=opacity)
