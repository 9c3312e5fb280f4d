"""A robot as the planner sees it, in a browser: its bodies, its arm and its end effector."""

from __future__ import annotations

import html
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pinocchio as pin
import plotly.graph_objects as go

from ff_planner_ros.analysis.drawing.scene_layout import lay_out, save_page
from ff_planner_ros.analysis.drawing.solids import (
    drawn_posture,
    part_colour,
    robot_surface,
    surface_at,
)
from ff_planner_ros.analysis.drawing.surroundings import axis_lines, xyz
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.distance.clearance import arm_points
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.shapes import link_shapes

# Length of the end effector's axes beside the arm's.
_AXIS_LENGTH = 0.1
_EYE = {"x": -1.2, "y": -2.3, "z": 1.0}


def save_robot(robot: Robot, path: Path) -> None:
    """Write the view of `robot_figure` as one HTML file that needs nothing else."""
    title = f"{robot.base_link} to {robot.tip_link}, {robot.geometry}"
    save_page(robot_figure(robot), title, path)


def robot_figure(robot: Robot) -> go.Figure:
    """Draw a robot at zero joint positions, clipped to its limits, in its root link's frame.

    The links that one joint carries share a colour and a legend entry. With geometry `lines` the
    surfaces are the shapes in the URDF, and only the centre lines are collision-checked.
    """
    q = drawn_posture(robot)
    arm = arm_points(robot, q[None])[0]
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    ee = pin.updateFramePlacement(robot.model, data, robot.tip_frame_id)
    length = _AXIS_LENGTH * float(np.linalg.norm(np.diff(arm, axis=0), axis=1).sum())
    axes = axis_lines(arm[-1], length * ee.rotation.T, "end effector's axes")
    line = go.Scatter3d(
        **xyz(arm),
        mode="lines+markers",
        line={"color": "black", "width": 5},
        marker={"color": "black", "size": 3},
        name=f"arm's lines, to {html.escape(robot.tip_link)}",
    )
    figure = go.Figure([*_parts(robot, q), line, axes.update(showlegend=False)])
    lay_out(figure)
    figure.update_layout(scene_camera_eye=_EYE)  # from further away: a stretched arm is long
    return figure


def _parts(robot: Robot, q: Array) -> Iterator[go.Mesh3d]:
    """Yield a surface for the chaser and for what each joint moves."""
    surface = robot_surface(robot)
    corners, of_triangle = surface_at(robot, surface, q[None])[0], surface.joints[surface.triangles]
    for joint in np.unique(surface.joints).tolist():
        triangles = surface.triangles[of_triangle[:, 0] == joint]
        used, numbers = np.unique(triangles, return_inverse=True)
        name = html.escape(", ".join(_links(robot, joint)))
        yield go.Mesh3d(
            **xyz(corners[used]),
            **dict(zip("ijk", numbers.reshape(-1, 3).T, strict=True)),
            color=part_colour(joint),
            opacity=0.6,
            flatshading=True,
            name=name,
            showlegend=True,
            hovertemplate=f"{name}<br>%{{x:.3f}}, %{{y:.3f}}, %{{z:.3f}} m<extra></extra>",
        )


def _links(robot: Robot, joint: int) -> list[str]:
    """Return the links that a joint carries and that are drawn."""
    drawn = robot.bodies or link_shapes(robot.drawn_urdf)
    frames = robot.model.frames
    return [
        link
        for link in dict.fromkeys(one.link for one in drawn)
        if frames[robot.model.getFrameId(link, pin.FrameType.BODY)].parentJoint == joint
    ]
