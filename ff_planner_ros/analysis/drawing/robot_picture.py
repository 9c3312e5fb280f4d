"""A robot from three sides, as a picture: its shapes, joints, centre of mass and end effector."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pinocchio as pin
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from ff_planner_ros.analysis.drawing.obstacle_surfaces import outline
from ff_planner_ros.analysis.drawing.solids import drawn_posture, part_colour, robot_solids
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.robot.model import Robot

# Title, axes to the right and up, and the one along which is looked, towards its smaller or larger.
_SIDES = (
    ("looking along y", 0, 2, 1, -1),
    ("looking along -x", 1, 2, 0, 1),
    ("looking along -z", 0, 1, 2, 1),
)
_AXIS_COLOURS = ("#e41a1c", "#4daf4a", "#377eb8")
_AXIS = 0.06  # length of drawn axes, in widths of the robot
_FLAT = 1e-9  # [m]
_DOTS_PER_INCH = 150


def save_picture(robot: Robot, path: Path) -> None:
    """Write `robot_picture` as SVG or PNG, by the path's suffix; the same robot, the same file."""
    dates = {"Date": None} if path.suffix == ".svg" else {}
    with mpl.rc_context(
        {"svg.hashsalt": "robot", "svg.fonttype": "none", "text.parse_math": False}
    ):
        robot_picture(robot).savefig(path, dpi=_DOTS_PER_INCH, metadata=dates)


def robot_picture(robot: Robot) -> Figure:
    """Draw a robot from three sides, at zero joint positions, clipped to its limits.

    Points are in the frame of the base link. Shapes are those that are kept clear, or else those
    of the URDF; each is drawn by its outline, what one joint carries in one colour.
    """
    model, data, q = robot.model, robot.model.createData(), drawn_posture(robot)
    pin.framesForwardKinematics(model, data, q)
    to_base = data.oMf[model.getFrameId(robot.base_link, pin.FrameType.BODY)].inverse()
    places = [to_base * place for place in data.oMi]
    tip = to_base * data.oMf[robot.tip_frame_id]
    shapes = [
        (joint, _moved(places[joint] * placement, corners))
        for (corners, _), placement, joint in robot_solids(robot)
    ]
    joints = [places[model.getJointId(name)] for name in robot.joint_names]
    arm = np.array([place.translation for place in (*joints, tip)])
    every = np.vstack([arm, np.zeros((1, 3)), *(corners for _, corners in shapes)])
    length = _AXIS * float(np.ptp(every, axis=0).max())
    center = to_base.act(np.array(pin.centerOfMass(model, data, q)))
    figure = Figure(figsize=(12.0, 5.0), layout="constrained")
    for axes, (title, right, up, depth, sign) in zip(figure.subplots(1, 3), _SIDES, strict=True):
        seen = [right, up]
        for joint, corners in sorted(shapes, key=lambda one: sign * one[1][:, depth].mean()):
            _add_shape(axes, corners[:, seen], part_colour(joint))
        axes.plot(*arm[:, seen].T, "-", color="black", linewidth=1.2, label="arm's lines")
        for k in range(robot.joints):
            axis = joints[k].rotation @ (robot.joint_axes[k] + robot.joint_slides[k])
            ends = arm[k] + length * np.outer((-1.0, 1.0), axis)
            axes.plot(*ends[:, seen].T, color="black", linewidth=2.5, alpha=0.6)
        axes.plot(*arm[:-1, seen].T, "o", color="black", markersize=4, label="joints and axes")
        for names, at in _together(robot.joint_names, arm[:, seen], length):
            axes.annotate(names, at, xytext=(4, 4), textcoords="offset points", size=7)
        for colour, axis in zip(_AXIS_COLOURS, 2.0 * length * tip.rotation.T, strict=True):
            axes.plot(*np.array([arm[-1], arm[-1] + axis])[:, seen].T, color=colour, linewidth=2.0)
        axes.plot(*arm[-1, seen], "^", color="black", label=f"end effector, {robot.tip_link}")
        axes.plot(*center[seen], "X", color="black", markersize=9, label="centre of mass")
        axes.set_title(title, fontsize=10)
        axes.set_xlabel(f"{'xyz'[right]} [m]")
        axes.set_ylabel(f"{'xyz'[up]} [m]")
        axes.set_aspect("equal", adjustable="datalim")
        axes.margins(0.08)
        axes.grid(visible=True, color="0.9")
        axes.set_axisbelow(True)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False)
    return figure


def _together(names: Sequence[str], points: Array, apart: float) -> Iterator[tuple[str, Array]]:
    """Yield the names of joints that are seen at one place, and the place of the first one."""
    left = list(range(len(names)))
    while left:
        at = points[left[0]]
        here = [k for k in left if np.linalg.norm(points[k] - at) <= apart]
        left = [k for k in left if k not in here]
        yield ", ".join(names[k] for k in here), at


def _add_shape(axes: Axes, corners: Array, colour: str) -> None:
    """Draw the outline of a convex shape, which from the side may be a line."""
    spread = np.linalg.svd(corners - corners.mean(axis=0), compute_uv=False)
    if spread[1] <= _FLAT:
        axes.plot(*corners.T, color=colour)
        return
    axes.add_patch(Polygon(outline(corners), facecolor=colour, alpha=0.35, edgecolor=colour))
    axes.update_datalim(corners)


def _moved(place: pin.SE3, corners: Array) -> Array:
    moved: Array = corners @ place.rotation.T + place.translation
    return moved
