"""The drawing of a robot: its bodies where the URDF has them, and its lines."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import plotly.graph_objects as go
import pytest
from bodied_robots import lemur_with_bodies, random_robot
from read_page import Page
from robots import LEMUR_URDF, random_urdf

from ff_planner_ros import cli
from ff_planner_ros.analysis.drawing.robot_view import robot_figure
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.robot.model import robot_from_urdf_text


def surfaces(figure: go.Figure) -> dict[str, Array]:
    """Corners by the links that they belong to. Shape (corners, 3) each."""
    return {
        one.name: np.stack([one.x, one.y, one.z], axis=1)
        for one in figure.data
        if isinstance(one, go.Mesh3d)
    }


def test_bodies_are_drawn_where_the_urdf_has_them() -> None:
    """At zero angles the Lemur's frames are parallel: its numbers can be added up by hand."""
    found = surfaces(robot_figure(lemur_with_bodies()))
    assert list(found) == ["chaser", "link_1", "link_2", "link_3", "link_4", "link_5", "link_7"]
    chaser = found["chaser"]  # a cube of 0.8 m, and panels up to 0.05 + 1.6 m off its sides
    np.testing.assert_allclose(chaser.min(axis=0), [-0.4, -2.05, -0.4], atol=1e-12)
    np.testing.assert_allclose(chaser.max(axis=0), [0.4, 2.05, 0.4], atol=1e-12)


@pytest.mark.parametrize("seed", [1, 2])
def test_what_is_drawn_of_links_lies_in_the_spheres_around_their_bodies(seed: int) -> None:
    """Pinocchio places the spheres; each goes through a corner of what it is around."""
    robot = random_robot(seed)
    drawn = surfaces(robot_figure(robot))
    named = [link for name in drawn for link in name.split(", ")]
    assert sorted(named) == sorted({body.link for body in robot.bodies})
    q = pin.neutral(robot.model)
    q[7:] = np.clip(0.0, robot.lower_position_limits, robot.upper_position_limits)
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    for name, corners in drawn.items():
        bodies = [body for body in robot.bodies if body.link in name.split(", ")]
        centers = [data.oMi[body.joint].act(body.center_in_joint) for body in bodies]
        far = np.linalg.norm(corners[:, None] - centers, axis=-1) - [one.radius for one in bodies]
        assert far.min(axis=1).max() < 1e-9, name
        assert far.min(axis=0).max() < 1e-3, name


def test_lines_are_drawn_where_there_are_no_bodies() -> None:
    robot = robot_from_urdf_text(random_urdf(joints=4, seed=3), "bus", "tool")
    figure = robot_figure(robot)
    (line,) = (one for one in figure.data if one.name == "arm's lines, to tool")
    assert len(line.x) == robot.joints + 1


def test_the_page_needs_nothing_else_and_is_the_same_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pages = [tmp_path / name for name in ("one.html", "two.html")]
    for page in pages:
        assert cli.main(["robot", str(LEMUR_URDF), "--draw", str(page)]) == 0
        assert f"{page}  " in capsys.readouterr().out
    assert pages[0].read_bytes() == pages[1].read_bytes()
    assert Page(pages[0].read_text()).referred == []
