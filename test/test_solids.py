"""The robot as its URDF draws it: closed surfaces of the right size in the right place."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from itertools import product

import coal
import numpy as np
import pinocchio as pin
import pytest
import robots
from drawn_plans import drawn_plan

from ff_planner_ros.analysis.drawing.solids import (
    box,
    capsule,
    cylinder,
    hull,
    robot_surface,
    sphere,
    surface_at,
)
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.motion.motion import from_trajectory
from ff_planner_ros.problems.robots import bench_robot
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.model import Robot, robot_from_urdf_text
from ff_planner_ros.robot.shapes import link_shapes

URDF = robots.of_lines(robots.LEMUR_URDF)

LINKS = {"lemur": ("chaser", "end_effector"), "canadarm2": ("station", "end_effector")}


def volume(corners: Array, triangles: Array) -> float:
    """By the divergence theorem: that of the inside, if every triangle looks outwards."""
    a, b, c = (corners[triangles[:, k]] for k in range(3))
    return float(np.sum(a * np.cross(b, c)) / 6)


def cube() -> coal.Convex:
    """From -1 to 1, by its corners and a point inside."""
    cloud = coal.BVHModelOBBRSS()
    cloud.beginModel(0, 9)
    cloud.addVertices(np.vstack([list(product((-1.0, 1.0), repeat=3)), [[0.1, 0.2, 0.0]]]))
    cloud.endModel()
    cloud.buildConvexHull(True, "Qt")
    return cloud.convex


@pytest.mark.parametrize(
    ("solid", "wanted"),
    [
        (box((1.0, 2.0, 3.0)), 6.0),
        (cylinder(0.5, 4.0, 200), np.pi * 0.25 * 4.0),
        (sphere(200), 4 / 3 * np.pi),
        (capsule(0.5, 4.0, 100), np.pi * 0.25 * 4.0 + np.pi / 6),
        (hull(cube()), 8.0),
    ],
    ids=("box", "cylinder", "sphere", "capsule", "hull"),
)
def test_a_solid_is_closed_and_has_its_volume(solid: tuple[Array, Array], wanted: float) -> None:
    corners, triangles = solid
    assert volume(corners, triangles) == pytest.approx(wanted, rel=2e-3)
    assert volume(corners + np.array([5.0, -3.0, 2.0]), triangles) == pytest.approx(
        wanted, rel=2e-3
    )
    np.testing.assert_allclose(corners.max(axis=0), -corners.min(axis=0), atol=1e-12)


@pytest.mark.parametrize("urdf", [robots.LEMUR_URDF, robots.CANADARM2_URDF])
def test_every_visual_shape_of_the_urdf_is_drawn(urdf: str) -> None:
    text = urdf.read_text()
    robot = robot_from_urdf_text(text, *LINKS[urdf.stem])
    wanted = [
        (link.get("name"), next(iter(visual.find("geometry"))).tag)
        for link in ElementTree.fromstring(text).findall("link")
        for visual in link.findall("visual")
    ]
    assert wanted
    assert [(shape.link, shape.kind) for shape in link_shapes(robot.drawn_urdf)] == wanted


def test_shapes_ride_on_their_links(lemur: Robot) -> None:
    """By Pinocchio's own frames of the links."""
    q, _ = from_trajectory(lemur, drawn_plan(lemur, 4).trajectory)
    surface = robot_surface(lemur)
    placed, first = surface_at(lemur, surface, q[[3, 30]]), 0
    data = lemur.model.createData()
    for shape in link_shapes(lemur.drawn_urdf):
        count = {"box": 8, "cylinder": 26, "sphere": 84}[shape.kind]
        for row, point in enumerate((3, 30)):
            pin.framesForwardKinematics(lemur.model, data, q[point])
            link = data.oMf[lemur.model.getFrameId(shape.link, pin.FrameType.BODY)]
            back = (placed[row, first : first + count] - link.translation) @ link.rotation
            centred = (back - shape.position_in_link) @ shape.rotation_to_link
            half = {
                "box": np.array(shape.sizes) / 2,
                "cylinder": np.array([shape.sizes[0]] * 2 + [shape.sizes[-1] / 2]),
                "sphere": np.array([shape.sizes[0]] * 3),
            }[shape.kind]
            np.testing.assert_allclose(np.abs(centred).max(axis=0), half, rtol=1e-9)
        first += count
    assert first == len(surface.corners)


def test_what_is_handed_on_has_the_shapes_and_is_the_same_robot(lemur: Robot) -> None:
    again = robot_from_urdf_text(lemur.drawn_urdf, lemur.base_link, lemur.tip_link)
    assert (again.urdf, again.drawn_urdf) == (lemur.urdf, lemur.drawn_urdf)
    assert "visual" not in lemur.urdf


@pytest.mark.parametrize(
    "shape",
    [
        '<mesh filename="package://arm/link.stl"/>',
        '<box size="1 2"/>',
        '<box size="1 2 nan"/>',
        '<cylinder radius="-1" length="1"/>',
        '<cylinder radius="1e300" length="1"/>',
        '<sphere radius="wide"/>',
        "<sphere/>",
        "<cone/>",
        "",
    ],
)
def test_a_shape_that_cannot_be_drawn_is_left_out_and_refuses_no_robot(shape: str) -> None:
    broken = re.sub("<cylinder.*?/>", shape, URDF, count=1)
    assert broken != URDF
    robot = robot_from_urdf_text(broken, "chaser", "end_effector")
    assert "link_1" not in [found.link for found in link_shapes(robot.drawn_urdf)]
    assert len(link_shapes(robot.drawn_urdf)) > 5
    assert "mesh" not in robot.drawn_urdf


def test_a_link_whose_looks_are_a_mesh_is_drawn_by_what_it_collides_with() -> None:
    link = '<link name="link_1">'
    solid = f'{link}<collision><geometry><sphere radius="0.3"/></geometry></collision>'
    looks = re.sub("<cylinder.*?/>", '<mesh filename="a.dae"/>', URDF, count=1)
    looks = looks.replace(link, solid)
    robot = robot_from_urdf_text(looks, "chaser", "end_effector")
    shape = next(shape for shape in link_shapes(robot.drawn_urdf) if shape.link == "link_1")
    assert (shape.kind, shape.sizes) == ("sphere", (0.3,))


def test_thousands_of_shapes_are_not_handed_on() -> None:
    shape = '<visual><geometry><sphere radius="0.1"/></geometry></visual>'
    text = URDF.replace("</link>", 5000 * shape + "</link>", 1)
    robot = robot_from_urdf_text(text, "chaser", "end_effector")
    assert len(link_shapes(robot.drawn_urdf)) == 1000


def test_the_bodies_of_a_robot_are_drawn_where_they_are() -> None:
    """Each body's own corners fill its box, in its place at any posture; nothing else is drawn."""
    robot = bench_robot("arm6", Geometry.SHAPES)
    surface = robot_surface(robot)
    q = np.concatenate([[1.0, 2.0, 3.0, 0.5, 0.5, 0.5, 0.5], np.linspace(-1.0, 1.0, 6)])
    (placed,) = surface_at(robot, surface, q[None])
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    first = 0
    for body in robot.bodies:
        at = data.oMi[body.joint] * body.placement_in_joint
        corners = (placed[first:] - at.translation) @ at.rotation
        body.solid.computeLocalAABB()
        half = (body.solid.aabb_local.max_ - body.solid.aabb_local.min_) / 2
        inside = int(np.argmin(np.append((np.abs(corners) <= half + 1e-9).all(axis=1), False)))
        assert 0 < inside <= sum(surface.joints == body.joint)
        np.testing.assert_allclose(np.abs(corners[:inside]).max(axis=0), half, rtol=0.05)
        first += inside
    assert first == len(placed)
