"""The solids that a URDF's `<collision>` elements describe, against Pinocchio's own reading."""

import pickle
import re

import coal
import numpy as np
import pinocchio as pin
import pytest
from robots import random_urdf

from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.collision.urdf_body import urdf_body
from ff_planner_ros.robot.model import robot_from_urdf_text

ENDS = ("bus", "tool")


def with_collisions(shapes: dict[str, list[str]]) -> str:
    """A random arm whose links have solids: geometry by link."""
    urdf = random_urdf(joints=4, seed=3)
    for number, (link, solids) in enumerate(shapes.items()):
        origin = f'<origin xyz="0.1 {0.05 * number} -0.2" rpy="0.3 -0.8 {number}"/>'
        text = "".join(
            f"<collision>{origin}<geometry>{solid}</geometry></collision>" for solid in solids
        )
        before = urdf
        urdf = urdf.replace(f'<link name="{link}">', f'<link name="{link}">{text}')
        assert urdf != before
    return urdf


SHAPES = {
    "bus": ['<box size="0.8 0.6 0.4"/>', '<sphere radius="0.3"/>'],
    "antenna": ['<sphere radius="0.2"/>'],
    "link_1": ['<cylinder radius="0.05" length="0.6"/>'],
    "link_2": ['<box size="0.04 0.5 0.1"/>'],
    "link_4": ['<cylinder radius="0.02" length="0.3"/>'],
    "camera": ['<box size="0.1 0.1 0.2"/>'],
}


def test_bodies_lie_where_pinocchio_places_them() -> None:
    text = with_collisions(SHAPES)
    robot = robot_from_urdf_text(text, *ENDS)
    assert robot.geometry is Geometry.SHAPES
    theirs = pin.GeometryModel()
    pin.buildGeomFromUrdfString(robot.model, text, pin.GeometryType.COLLISION, theirs)
    by_name = {found.name: found for found in theirs.geometryObjects}
    assert len(by_name) == len(robot.bodies) == 7
    data, rng = robot.model.createData(), np.random.default_rng(1)
    for _ in range(20):
        q = pin.randomConfiguration(robot.model, -4.0 * np.ones(11), 4.0 * np.ones(11))
        q[:3] = rng.normal(size=3)
        pin.forwardKinematics(robot.model, data, q)
        for body in robot.bodies:
            link, _, number = body.name.partition("#")
            other = by_name[f"{link}_{int(number or 1) - 1}"]
            ours = data.oMi[body.joint] * body.placement_in_joint
            wanted = data.oMi[other.parentJoint] * other.placement
            np.testing.assert_allclose(ours.homogeneous, wanted.homogeneous, atol=1e-12)
            other.geometry.computeLocalAABB()  # as ours has done
            assert body.solid == other.geometry


def test_a_sphere_around_a_body_holds_it() -> None:
    """By the support of each solid in many directions, in the words of a textbook."""
    rng = np.random.default_rng(2)
    for body in robot_from_urdf_text(with_collisions(SHAPES), *ENDS).bodies:
        solid, place = body.solid, body.placement_in_joint
        middle = place.actInv(body.center_in_joint)
        reach = 0.0
        for way in rng.normal(size=(2000, 3)):
            way /= np.linalg.norm(way)
            if isinstance(solid, coal.Sphere):
                point = solid.radius * way
            elif isinstance(solid, coal.Box):
                point = np.sign(way) * solid.halfSide
            else:
                across = np.array([*way[:2], 0.0])
                ends = np.array([0.0, 0.0, np.sign(way[2]) * solid.halfLength])
                point = ends + solid.radius * across / np.linalg.norm(across)
            reach = max(reach, float(np.linalg.norm(point - middle)))
        assert reach <= body.radius * (1.0 + 1e-12)
        assert reach > 0.9 * body.radius


def test_pairs_are_of_links_that_are_neither_neighbours_nor_fixed_to_each_other() -> None:
    """Without a solid, link_3 is no neighbour: those on its two sides are each other's."""
    robot = robot_from_urdf_text(with_collisions(SHAPES), *ENDS)
    names = [body.name for body in robot.bodies]
    assert names == ["bus", "bus#2", "antenna", "link_1", "link_2", "link_4", "camera"]
    found = {(names[first], names[second]) for first, second in robot.pairs}
    assert found == {
        ("bus", "link_2"),
        ("bus", "link_4"),
        ("bus", "camera"),
        ("bus#2", "link_2"),
        ("bus#2", "link_4"),
        ("bus#2", "camera"),
        ("antenna", "link_1"),
        ("antenna", "link_2"),
        ("antenna", "link_4"),
        ("antenna", "camera"),
        ("link_1", "link_4"),
        ("link_1", "camera"),
        ("link_4", "camera"),
    }


def test_with_lines_a_robot_has_no_bodies() -> None:
    robot = robot_from_urdf_text(with_collisions(SHAPES), *ENDS, geometry=Geometry.LINES)
    assert (robot.geometry, robot.bodies, robot.pairs) == (Geometry.LINES, (), ())
    plain = robot_from_urdf_text(random_urdf(joints=4, seed=3), *ENDS)
    assert plain.geometry is Geometry.LINES


def test_a_robot_with_bodies_can_be_sent_to_another_process() -> None:
    robot = robot_from_urdf_text(with_collisions(SHAPES), *ENDS)
    again = pickle.loads(pickle.dumps(robot))
    assert again.pairs == robot.pairs
    for ours, theirs in zip(again.bodies, robot.bodies, strict=True):
        assert (ours.name, ours.joint, ours.radius) == (theirs.name, theirs.joint, theirs.radius)
        assert ours.solid == theirs.solid
        assert ours.placement_in_joint == theirs.placement_in_joint


@pytest.mark.parametrize(
    ("solid", "words"),
    [
        ("<sphere/>", "link 'bus' collision sphere radius is missing: it must be one number"),
        ('<cylinder radius="0" length="1"/>', "collision cylinder radius is '0'"),
        ('<box size="1 2"/>', "collision box size is '1 2': it must be 3 numbers"),
        ('<box size="1 2 nan"/>', "collision box size is '1 2 nan'"),
        ('<cylinder radius="1"/>', "collision cylinder length is missing"),
        ('<cylinder radius="-1" length="1"/>', "collision cylinder radius is '-1'"),
        ('<cylinder radius="1e300" length="1"/>', "collision cylinder radius is '1e300'"),
        ("", "collision is without a geometry"),
    ],
)
def test_a_solid_without_size_is_refused_by_its_link(solid: str, words: str) -> None:
    with pytest.raises(InvalidInput, match=words.replace("(", r"\(")):
        robot_from_urdf_text(with_collisions(SHAPES | {"bus": [solid]}), *ENDS)


def test_more_bodies_than_a_robot_has_are_refused() -> None:
    """Each pair costs time, and there are as many as the square."""
    sphere = '<sphere radius="0.1"/>'
    with pytest.raises(InvalidInput, match="<collision> is there 308 times: it may be at most 300"):
        robot_from_urdf_text(with_collisions(SHAPES | {"link_1": 302 * [sphere]}), *ENDS)


POINTS = ['<box size="0 0 0"/>', '<sphere radius="0.0"/>']


def test_solids_without_extent_are_named_and_keep_nothing_clear() -> None:
    """As simulators have them at frames and contacts."""
    plain = robot_from_urdf_text(with_collisions(SHAPES), *ENDS)
    pointed = SHAPES | {"link_1": [*SHAPES["link_1"], *POINTS], "tool": POINTS[:1]}
    text = with_collisions(pointed)
    robot = robot_from_urdf_text(text, *ENDS)
    assert [body.name for body in robot.bodies] == [body.name for body in plain.bodies]
    assert robot.pairs == plain.pairs
    (note,) = set(robot.notes) - set(plain.notes)
    for told in ("<box> of link link_1", "<sphere> of link link_1", "<box> of link tool"):
        assert f"{told}, without extent" in note
    assert len(urdf_body(text, "it").solids) == len(plain.bodies)


def test_an_arm_whose_only_solids_have_no_extent_is_planned_with_lines() -> None:
    robot = robot_from_urdf_text(with_collisions({"tool": POINTS}), *ENDS)
    assert robot.geometry is Geometry.LINES
    assert "<box> of link tool, without extent" in robot.notes[0]


def test_of_a_robot_at_one_point_no_inertia_is_too_wide() -> None:
    """Nothing says how large it is."""
    text = re.sub(r'xyz="[^"]*"(?= rpy)', 'xyz="0 0 0"', random_urdf(joints=3, seed=1))
    assert robot_from_urdf_text(text, *ENDS).notes == ()
