"""The scene of the page: a motion or task in the browser, at the time of the slider."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from ff_planner_ros.analysis.drawing.solids import Triangles
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.console.colours import (
    BLACK,
    BLUE,
    GREY,
    LINE,
    ORANGE,
    PURPLE,
    RGB,
    SKY,
    VERMILION,
)
from ff_planner_ros.console.faults import Place
from ff_planner_ros.console.parts import (
    ARM,
    CHASER,
    OBSTACLE,
    TARGET,
    Part,
    joined,
    obstacle_parts,
    robot_parts,
)
from ff_planner_ros.console.stages import Stage, at_time
from ff_planner_ros.planning.distance.clearance import arm_points
from ff_planner_ros.planning.problem.problem import Orientation
from ff_planner_ros.robot.quaternion import rotation_from_quaternion

KINDS = {CHASER: GREY, ARM: BLUE, OBSTACLE: ORANGE, TARGET: PURPLE}
# Without a graphics card, shading by the default material takes as long as all the rest of a frame.
_GHOST: dict[str, Any] = {"color": SKY, "opacity": 0.2, "material": "toon3"}
FAULT = VERMILION
_SHOWN = "/shown"
_NEAR = "/nearest"
_WIDTH = 2.5  # of lines [pixels]
_EYE = np.array([-0.9, -1.5, 0.8])  # towards who looks on, in sizes of the scene


@dataclass(eq=False)
class _Drawn:
    """A stage in the browser."""

    stage: Stage
    node: viser.FrameHandle  # above all that belongs to the stage
    parts: list[tuple[Part, viser.MeshHandle]] = field(default_factory=list)
    arm: viser.LineSegmentsHandle | None = None  # of a robot without shapes


class SceneView:
    """Draws one motion, or one task, at a time."""

    def __init__(self, server: viser.ViserServer) -> None:
        """Light an empty scene, z up."""
        self._server = server
        self._drawn = list[_Drawn]()
        self._ghosts = dict[tuple[int, int], viser.MeshHandle]()  # by stage and point
        server.scene.set_up_direction("+z")
        # Where a browser has no graphics card, shadows would make pictures 14 times as slow, and an
        # environment map the first one 2 s late.
        server.scene.configure_environment_map(None)
        server.scene.add_light_hemisphere("/light", intensity=2.5, ground_color=(140, 140, 140))
        server.scene.configure_default_lights(enabled=True, cast_shadow=False)
        server.scene.world_axes.visible = True
        server.scene.world_axes.axes_length = 0.2
        server.scene.world_axes.axes_radius = 0.004
        self._near = server.scene.add_line_segments(
            f"{_NEAR}/line", np.zeros((1, 2, 3)), BLACK, thickness=4.0, thickness_units="screen"
        )
        self._words = server.scene.add_label(f"{_NEAR}/words", "", visible=False)
        self._is_framed = False

    @property
    def is_empty(self) -> bool:
        """Whether nothing is shown yet."""
        return not self._drawn

    def show(self, stages: Sequence[Stage], fault: Place | None = None) -> None:
        """Replace the stages that are shown, and mark a fault if there is one."""
        scene = self._server.scene
        with self._server.atomic():
            scene.add_frame(_SHOWN, show_axes=False).remove()
            scene.add_frame(_SHOWN, show_axes=False)
            self._drawn = [self._draw(number, stage) for number, stage in enumerate(stages)]
            last = len(stages) - 1
            self._ghosts = {}
            if stages[0].motion is not None:
                self._ghosts = {
                    (0, 0): self._ghost("start", stages[0], 0),
                    (last, len(stages[-1].times) - 1): self._ghost("goal", stages[-1], -1),
                }
            if fault is not None:
                self._mark(fault)
        if not self._is_framed:
            self._frame(stages)
            self._is_framed = True

    def move_to(self, time: float) -> str:
        """Move everything to a time [s], and return a sentence on the smallest distance then."""
        number, point = at_time([one.stage for one in self._drawn], time)
        drawn = self._drawn[number]
        near = drawn.stage.nearest(point)
        with self._server.atomic():
            for other in self._drawn:
                other.node.visible = other is drawn
            for at, ghost in self._ghosts.items():
                ghost.visible = at != (number, point)  # or else it lies in the robot
            for part, handle in drawn.parts:
                if part.moves:
                    handle.position = part.positions[point]
                if part.turns:
                    handle.wxyz = part.quaternions_wxyz[point]
            if drawn.arm is not None:
                drawn.arm.points = joined(_arm(drawn.stage, point))
            self._near.visible = self._words.visible = near is not None
            if near is None:
                return "the robot has centre lines, no shapes: the plan's table has the clearance"
            self._near.points = near.ends[None].astype(np.float32)
            self._words.position = near.ends.mean(axis=0)
            self._words.text = f"{near.distance * 1e3:.1f} mm"
        allowed = ", may touch near the goal" if drawn.stage.may_touch(near.pair) else ""
        return f"nearest: {near.pair}, {near.distance * 1e3:.1f} mm{allowed}"

    def _draw(self, number: int, stage: Stage) -> _Drawn:
        scene, above = self._server.scene, f"{_SHOWN}/{number}"
        drawn = _Drawn(stage, scene.add_frame(above, show_axes=False, visible=number == 0))
        robot = stage.problem.robot
        for k, part in enumerate([*robot_parts(robot, stage.q), *obstacle_parts(stage)]):
            # A slash would begin a child of the node.
            name, place = f"{above}/{k}_{part.name.replace('/', '_')}", part.positions[0]
            pose = {"position": place, "wxyz": part.quaternions_wxyz[0]}
            surface = part.corners, part.triangles
            handle = self._surface(name, *surface, color=KINDS[part.kind], **pose)
            drawn.parts.append((part, handle))
        if not robot.bodies:
            drawn.arm = self._lines(f"{above}/arm", joined(_arm(stage, 0)), 6.0)
        self._lines(f"{above}/way", joined(stage.tip))
        for name, lines in stage.constraints.items():
            self._lines(f"{above}/{name}", lines, 1.0)
        self._goal(above, stage)
        return drawn

    def _goal(self, above: str, stage: Stage) -> None:
        target = stage.problem.target
        size = 0.1 * float(np.linalg.norm(np.diff(_arm(stage, 0), axis=0), axis=1).sum())
        x, y, z, w = target.quaternion_xyzw
        self._server.scene.add_frame(
            f"{above}/goal",
            show_axes=target.orientation is not Orientation.FREE,
            axes_length=size,
            axes_radius=size / 25,
            position=target.position,
            wxyz=np.array([w, x, y, z]),
        )
        self._server.scene.add_icosphere(
            f"{above}/goal/place", radius=size / 8, color=LINE, opacity=0.6
        )

    def _ghost(self, name: str, stage: Stage, point: int) -> viser.MeshHandle:
        """Draw the robot at a point as one surface, which takes less time than its parts."""
        corners, triangles, count = list[Array](), list[Triangles](), 0
        for part in robot_parts(stage.problem.robot, stage.q[[point]]):
            (turn,) = rotation_from_quaternion(np.roll(part.quaternions_wxyz, -1, axis=1))
            corners.append(part.corners @ turn.T + part.positions[0])
            triangles.append(part.triangles + count)
            count += len(part.corners)
        surface = np.concatenate(corners), np.concatenate(triangles)
        return self._surface(f"{_SHOWN}/{name}", *surface, **_GHOST)

    def _mark(self, fault: Place) -> None:
        scene, above = self._server.scene, f"{_SHOWN}/fault"
        for k, point in enumerate(fault.points):
            scene.add_icosphere(f"{above}/{k}", radius=0.03, color=FAULT, position=point)
        if len(fault.points) == 2:
            self._lines(f"{above}/line", fault.points[None], 6.0, FAULT)
        scene.add_label(f"{above}/words", fault.words, position=fault.points.mean(axis=0))

    def _surface(
        self, name: str, corners: Array, triangles: Triangles, **more: Any
    ) -> viser.MeshHandle:
        # Every surface is closed and looks outwards; its back would take half as long again.
        given = {"side": "front", "flat_shading": True, **more}
        return self._server.scene.add_mesh_simple(
            name, corners.astype(np.float32), triangles.astype(np.uint32), **given
        )

    def _lines(
        self, name: str, lines: NDArray[Any], width: float = _WIDTH, colour: RGB = LINE
    ) -> viser.LineSegmentsHandle:
        return self._server.scene.add_line_segments(
            name, lines.astype(np.float32), colour, thickness=width, thickness_units="screen"
        )

    def _frame(self, stages: Sequence[Stage]) -> None:
        """Point the camera at the arm's motion so that it fills the page."""
        points = np.concatenate(
            [arm_points(one.problem.robot, one.q[[0, -1]]).reshape(-1, 3) for one in stages]
        )
        points = np.concatenate([points, stages[0].q[:1, :3], stages[-1].tip])
        low, high = points.min(axis=0), points.max(axis=0)
        middle, size = (low + high) / 2, float(np.linalg.norm(high - low))
        self._server.initial_camera.look_at = middle
        self._server.initial_camera.position = middle + size * _EYE


def _arm(stage: Stage, point: int) -> Array:
    points: Array = arm_points(stage.problem.robot, stage.q[point][None])[0]
    return points
