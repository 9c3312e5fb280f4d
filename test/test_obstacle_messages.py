"""Bodies in the way: from scenarios and problems to messages, bags and files, and back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ff_planner_msgs.msg import Obstacle as ObstacleMessage
from ff_planner_msgs.msg import Scene as SceneMessage
from geometry_msgs.msg import Point
from heard_inputs import HeardScenes
from rclpy.serialization import deserialize_message, serialize_message
from scipy.spatial.transform import Rotation
from shape_msgs.msg import Mesh, MeshTriangle, SolidPrimitive
from shaped_problems import FAR, SOLIDS, among_bodies, bodies, capture_among_bodies
from test_tumbling import body_of

from ff_planner_benchmark.problems import tumbling
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.messages import obstacles as obstacles_module
from ff_planner_ros.messages.obstacles import obstacles_of
from ff_planner_ros.planning.problem.obstacles import Obstacle, RigidMotion
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.task.digest import digest_of
from ff_planner_ros.robot.collision.primitives import PRIMITIVES
from ff_planner_ros.ros.messages.from_messages import (
    scene_from_message,
    target_body_from_message,
)
from ff_planner_ros.ros.messages.to_messages import scene_message, target_body_message

FRAME = "inertial"
SECOND = 1_000_000_000
STAMP = 12 * SECOND
RNG = np.random.default_rng(3)


@pytest.fixture(scope="module")
def capture() -> PlanningProblem:
    return capture_among_bodies(tumbling.problem("tumbling", 0))


def _sent(message: Any) -> Any:
    """Return a message as it comes out of the middleware."""
    return deserialize_message(serialize_message(message), type(message))


def test_obstacles_of_every_kind_come_back_out_of_their_messages_to_the_last_bit(
    capture: PlanningProblem,
) -> None:
    free = [one for one in capture.obstacles if one.body is None]
    scene = _sent(scene_message(capture.obstacles, STAMP, FRAME, "mapper"))
    assert [one.id for one in scene.bodies] == list(SOLIDS)
    assert (scene.header.stamp.sec, scene.header.frame_id, scene.source) == (12, FRAME, "mapper")
    assert digest_of_all(scene_from_message(scene, "obstacles", FRAME)) == digest_of_all(free)
    body = target_body_from_message(
        _sent(target_body_message(body_of(capture), STAMP, FRAME)), FRAME
    )
    assert digest_of(body) == digest_of(body_of(capture))


def digest_of_all(obstacles: Any) -> list[str]:
    return [digest_of(one) for one in obstacles]


def test_shape_msgs_has_the_numbers_and_dimensions_that_are_written() -> None:
    for kind, number in ((kind, one.message) for kind, one in PRIMITIVES.items()):
        if kind != "capsule":
            assert getattr(SolidPrimitive, kind.upper()) == number
    assert PRIMITIVES["capsule"].message not in range(SolidPrimitive.BOX, SolidPrimitive.PRISM + 1)
    scene = scene_message(tuple(bodies(RNG)), STAMP, FRAME)
    found = {one.id: list(one.primitive[0].dimensions) for one in scene.bodies if one.primitive}
    assert found["box"] == [0.3, 0.4, 0.005]
    for kind in ("cylinder", "cone"):
        radius, length = SOLIDS[kind].sizes.tolist()
        places = {
            getattr(SolidPrimitive, f"{kind.upper()}_HEIGHT"): length,
            getattr(SolidPrimitive, f"{kind.upper()}_RADIUS"): radius,
        }
        assert found[kind] == [places[0], places[1]]
    assert found["capsule"] == [0.3, 0.05], "length without caps, radius"


def test_a_capsules_number_stands_in_the_message() -> None:
    text = (Path(__file__).parents[1] / "msg_defs/msg/Obstacle.msg").read_text(encoding="utf-8")
    assert f"uint8 CAPSULE={PRIMITIVES['capsule'].message} " in text


def test_a_round_body_is_a_sphere() -> None:
    message = ObstacleMessage(id="ball")
    message.primitive = [SolidPrimitive(type=SolidPrimitive.SPHERE, dimensions=[0.25])]
    message.pose.position.y, message.twist.linear.z = 2.0, 0.1
    (ball,) = obstacles_of(SceneMessage(bodies=[message]), "scene")
    assert ball.is_sphere
    assert (ball.id, ball.radius, *ball.center, *ball.motion.velocity) == (
        *("ball", 0.25, 0.0, 2.0),
        *(0.0, 0.0, 0.0, 0.1),
    )


def test_bodies_fixed_to_a_target_move_and_turn_with_it(capture: PlanningProblem) -> None:
    body = target_body_from_message(target_body_message(body_of(capture), STAMP, FRAME), FRAME)
    (fixed,) = [one for one in body.obstacles if one.id == "fixed_cone"]
    assert not fixed.is_sphere
    (found,) = [one for one in capture.obstacles if one.id == "fixed_cone"]
    times = np.array([0.0, 3.0])
    rotations, positions = found.motion.poses(times)
    turned = Rotation.from_matrix(body.motion(np.zeros(3), times).rotations)
    assert positions == pytest.approx(body.places(fixed.position[None], times)[:, 0])
    wanted = turned * Rotation.from_quat(fixed.quaternion_xyzw.copy())
    assert rotations == pytest.approx(wanted.as_matrix())


TETRAHEDRON = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]
FACES = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]


def _mesh(points: Any = TETRAHEDRON, faces: Any = FACES) -> Mesh:
    return Mesh(
        vertices=[Point(x=x, y=y, z=z) for x, y, z in points],
        triangles=[MeshTriangle(vertex_indices=face) for face in faces],
    )


@pytest.mark.parametrize("faces", [FACES, []])
def test_a_mesh_counts_by_its_hull(faces: Any) -> None:
    points = [*TETRAHEDRON, (0.1, 0.1, 0.1)]
    (body,) = obstacles_of(
        SceneMessage(bodies=[ObstacleMessage(mesh=[_mesh(points, faces)])]), "scene"
    )
    assert not body.is_sphere
    assert sorted(map(tuple, body.solid.corners.tolist())) == sorted(TETRAHEDRON)


def _spoil_dimensions(body: ObstacleMessage) -> None:
    body.primitive[0].dimensions = [0.1]


def _spoil_size(body: ObstacleMessage) -> None:
    body.primitive[0].dimensions = [0.1, -0.2, 0.3]


def _spoil_finite(body: ObstacleMessage) -> None:
    body.primitive[0].dimensions = [0.1, float("nan"), 0.3]


def _prism(body: ObstacleMessage) -> None:
    body.primitive[0].type = SolidPrimitive.PRISM


def _of_no_kind(body: ObstacleMessage) -> None:
    body.primitive[0].type = 77


def _neither(body: ObstacleMessage) -> None:
    body.primitive = []


def _both(body: ObstacleMessage) -> None:
    body.mesh = [_mesh()]


def _flat(body: ObstacleMessage) -> None:
    body.primitive, body.mesh = [], [_mesh(TETRAHEDRON[:3], [])]


def _no_vertex(body: ObstacleMessage) -> None:
    body.primitive, body.mesh = [], [_mesh(faces=[(0, 1, 4)])]


def _mesh_not_finite(body: ObstacleMessage) -> None:
    body.primitive, body.mesh = [], [_mesh([*TETRAHEDRON, (0.0, float("inf"), 0.0)], [])]


def _unturned(body: ObstacleMessage) -> None:
    body.pose.orientation.w = 0.5


def _position(body: ObstacleMessage) -> None:
    body.pose.position.x = float("nan")


def _id(body: ObstacleMessage) -> None:
    body.id = "c0"


def _many(body: ObstacleMessage) -> None:
    body.primitive, body.mesh = [], [_mesh([*TETRAHEDRON, *TETRAHEDRON])]


SPOILT: dict[Callable[[ObstacleMessage], None], tuple[Status, str, str]] = {
    _spoil_dimensions: (Status.WRONG_SIZE, "primitive.dimensions", "a box has 3: x, y, z"),
    _spoil_size: (Status.OUT_OF_RANGE, "primitive.dimensions", "from 1e-06 to 10000 m"),
    _spoil_finite: (Status.NOT_FINITE, "primitive.dimensions", ""),
    _prism: (Status.UNSUPPORTED, "primitive.type", "PRISM"),
    _of_no_kind: (Status.UNSUPPORTED, "primitive.type", "101 (CAPSULE)"),
    _neither: (Status.WRONG_SIZE, "primitive", "give it or a mesh"),
    _both: (Status.WRONG_SIZE, "primitive", "give it or a mesh"),
    _flat: (Status.OUT_OF_RANGE, "mesh.vertices", "flat"),
    _no_vertex: (Status.OUT_OF_RANGE, "mesh.triangles[0]", "4 vertices"),
    _mesh_not_finite: (Status.NOT_FINITE, "mesh.vertices[4]", ""),
    _unturned: (Status.BAD_QUATERNION, "pose.orientation", ""),
    _position: (Status.NOT_FINITE, "pose.position", ""),
    _id: (Status.OUT_OF_RANGE, "id", "every id must be given once"),
    _many: (Status.OUT_OF_RANGE, "mesh.vertices", "at most"),
}


@pytest.mark.parametrize("spoil", SPOILT)
@pytest.mark.parametrize("where", ["topic", "request"])
def test_a_bad_body_is_told_by_its_field(
    where: str, spoil: Callable[[ObstacleMessage], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(obstacles_module, "MAX_MESH_VERTICES", 7)
    good, bad = (ObstacleMessage(id=f"c{number}") for number in range(2))
    for one in (good, bad):
        one.primitive = [SolidPrimitive(type=SolidPrimitive.BOX, dimensions=[0.1, 0.2, 0.3])]
    spoil(bad)
    scene, scenes = SceneMessage(bodies=[good, bad]), HeardScenes()
    scene.header.frame_id = FRAME
    scenes.hear(serialize_message(scene))
    own = scene if where == "request" else None
    with pytest.raises(InvalidInput) as refused:
        scenes.scene(own)
    status, field, words = SPOILT[spoil]
    source = "scene" if own else "obstacles"
    error = refused.value
    assert (error.status, error.field) == (status, f"{source}.bodies[1].{field}"), str(error)
    assert words in str(error)


def test_what_is_fixed_to_a_body_must_not_move_in_it(capture: PlanningProblem) -> None:
    message = target_body_message(body_of(capture), STAMP, FRAME)
    message.bodies[2].twist.angular.y = 0.1
    with pytest.raises(InvalidInput, match="what is fixed to a body moves with it") as refused:
        target_body_from_message(message, FRAME)
    assert refused.value.field == "target_body.bodies[2].twist.angular"


def test_what_moves_is_carried_from_the_scenes_stamp_to_the_plans_start() -> None:
    moving, ball = (
        Obstacle(
            "panel",
            SOLIDS["box"],
            RigidMotion(
                FAR, velocity=np.array([0.1, 0.0, 0.0]), angular_velocity=np.array([0.0, 0.0, 0.2])
            ),
        ),
        Obstacle.sphere("ball", FAR, 0.1, np.array([0.0, 0.3, 0.0])),
    )
    scenes = HeardScenes()
    scenes.hear(scene_message((moving, ball), STAMP, FRAME))
    scene = scenes.moving_scene(None, STAMP + SECOND, 0.1, 5.0)
    seen, there = scene.obstacles_at(STAMP + 3 * SECOND)
    assert seen.is_sphere
    assert not there.is_sphere
    assert seen.center == pytest.approx(FAR + np.array([0.0, 0.9, 0.0]))
    assert there.motion.position == pytest.approx(FAR + np.array([0.3, 0.0, 0.0]))
    turned = Rotation.from_quat(there.motion.quaternion_xyzw.copy()).as_rotvec()
    assert turned == pytest.approx([0.0, 0.0, 0.6])


def test_a_problem_has_its_obstacles_in_the_order_of_messages(capture: PlanningProblem) -> None:
    kinds = [one.is_sphere for one in capture.obstacles]
    assert kinds == sorted(kinds, reverse=True)
    again = replace(capture, obstacles=capture.obstacles[::-1])
    assert {one.id for one in again.obstacles} == {one.id for one in capture.obstacles}
    assert all(
        one.is_sphere for one in again.obstacles[: sum(one.is_sphere for one in capture.obstacles)]
    )
    assert among_bodies(tumbling.problem("tumbling", 0)).obstacles[-1].id == "mesh"
