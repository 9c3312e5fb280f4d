"""The robot as it is measured, in the scene beside the plan."""

from __future__ import annotations

import numpy as np
import viser

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.console.colours import GREEN
from ff_planner_ros.console.parts import Part, joined, joint_places, robot_parts
from ff_planner_ros.planning.distance.clearance import arm_points
from ff_planner_ros.robot.model import Robot

COLOUR = GREEN
_ABOVE, _OPACITY, _WIDTH = "/measured", 0.6, 6.0


class MeasuredRobot:
    """The measured robot in green; invisible until it is placed for the first time."""

    def __init__(self, server: viser.ViserServer, robot: Robot) -> None:
        """Draw nothing yet."""
        self._server, self._robot = server, robot
        self._parts: list[tuple[Part, viser.MeshHandle]] = []
        self._arm: viser.LineSegmentsHandle | None = None  # of a robot without shapes
        self._above: viser.FrameHandle | None = None

    def place(self, q: Array) -> None:
        """Show the robot at a configuration. Shape (7 + joints,)."""
        with self._server.atomic():
            if self._above is None:
                self._above = self._draw(q)
            positions, quaternions = joint_places(self._robot, q[None])
            for part, handle in self._parts:
                joint = self._robot.model.getJointId(part.name)
                handle.position, handle.wxyz = positions[0, joint], quaternions[0, joint]
            if self._arm is not None:
                self._arm.points = joined(arm_points(self._robot, q[None])[0])
            self._above.visible = True

    def hide(self) -> None:
        """Hide the robot, because its state is not known."""
        if self._above is not None:
            self._above.visible = False

    def _draw(self, q: Array) -> viser.FrameHandle:
        scene = self._server.scene
        above = scene.add_frame(_ABOVE, show_axes=False)
        for part in robot_parts(self._robot, q[None]):
            handle = scene.add_mesh_simple(
                f"{_ABOVE}/{part.name}",
                part.corners.astype(np.float32),
                part.triangles.astype(np.uint32),
                color=COLOUR,
                opacity=_OPACITY,
                side="double",
                flat_shading=True,
            )
            self._parts.append((part, handle))
        if not self._robot.bodies:
            self._arm = scene.add_line_segments(
                f"{_ABOVE}/arm",
                joined(arm_points(self._robot, q[None])[0]),
                COLOUR,
                thickness=_WIDTH,
                thickness_units="screen",
            )
        return above
