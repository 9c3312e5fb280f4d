"""How many conditions an arm can meet at once, of arms whose number is known."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from planar_model import Body, planar_urdf
from robots import CANADARM2_URDF, LEMUR_URDF, of_lines

from ff_planner_ros.planning.motion.steered import steered, why_not_steered
from ff_planner_ros.planning.problem.goal_words import Orientation
from ff_planner_ros.planning.problem.target import Target
from ff_planner_ros.robot.model import Base, robot_from_urdf_text

MOMENTS = ("ixx", "iyy", "izz")


@pytest.mark.parametrize("welded", list(combinations(range(1, 7), 2)))
def test_a_last_joint_about_the_free_axis_steers_nothing(welded: tuple[int, int]) -> None:
    """Whichever two of its joints are fixed, an arm of seven has five, and with that axis four."""
    text = of_lines(CANADARM2_URDF)
    for number in welded:
        joint = f'<joint name="joint_{number}" type="revolute">'
        assert joint in text
        text = text.replace(joint, joint.replace("revolute", "fixed"))
    robot = robot_from_urdf_text(text, "station", "end_effector")
    for free_axis, steerable in (([1.0, 0.0, 0.0], 4), ([0.6, -0.48, 0.64], 5)):
        target = Target(
            position=np.zeros(3),
            quaternion_xyzw=[0.0, 0.0, 0.0, 1.0],
            orientation=Orientation.ABOUT_AXIS,
            free_axis_in_ee=np.array(free_axis),
        )
        assert steered(robot, target) == steerable


@pytest.mark.parametrize("inertia", [0.0165, 0.1])
@pytest.mark.parametrize("welded", [(1, 5), (3, 5)])
def test_a_tool_that_turns_a_light_chaser_a_little_is_not_steered_by_that(
    inertia: float, welded: tuple[int, int]
) -> None:
    """However it turns about the free axis; about another one the tool's joint does steer it."""
    text = of_lines(LEMUR_URDF)
    for number in welded:
        joint = f'<joint name="joint_{number}" type="revolute">'
        text = text.replace(joint, joint.replace("revolute", "fixed"))
    own = 'ixx="0.0165" iyy="0.0070" izz="0.0165"'
    assert text.count(own) == 1
    text = text.replace(own, f'ixx="{inertia}" iyy="{inertia}" izz="{inertia}"')
    robot = robot_from_urdf_text(text, "chaser", "end_effector")
    for free_axis, steerable in (([0.0, 0.0, 1.0], 4), ([0.6, -0.48, 0.64], 5)):
        target = Target(
            position=np.zeros(3),
            quaternion_xyzw=[0.0, 0.0, 0.0, 1.0],
            orientation=Orientation.ABOUT_AXIS,
            free_axis_in_ee=np.array(free_axis),
        )
        assert steered(robot, target) == steerable


@pytest.mark.parametrize("limits", [("-2.5", "-0.4"), ("0.4", "2.5"), ("-2.5", "2.5")])
def test_an_arm_that_bends_to_one_side_alone_is_steered_as_to_the_other(
    limits: tuple[str, str],
) -> None:
    """Straight, which it may be in its limits or not, it is steered in one direction only."""
    bodies = (
        Body(60.0, (0.0, 0.0), 2.7, (0.4, 0.0)),
        Body(2.0, (0.2, 0.0), 0.1, (0.4, 0.0)),
        Body(2.0, (0.2, 0.0), 0.1, (0.4, 0.0)),
    )
    text = planar_urdf(bodies, np.random.default_rng(0))
    bent = text.replace('lower="-2.6" upper="2.6"', f'lower="{limits[0]}" upper="{limits[1]}"')
    assert bent != text
    robot = robot_from_urdf_text(bent, "body_0", "tip", Base.PLANAR)
    target = Target(np.zeros(3), [0.0, 0.0, 0.0, 1.0], orientation=Orientation.FREE)
    assert steered(robot, target) == 2


def _welded(text: str, numbers: tuple[int, ...]) -> str:
    for number in numbers:
        joint = f'<joint name="joint_{number}" type="revolute">'
        assert joint in text
        text = text.replace(joint, joint.replace("revolute", "fixed"))
    return text


def _with_a_light_chaser(text: str, mass: str = "0.1") -> str:
    root = ElementTree.fromstring(text)
    inertial = root.find("link[@name='chaser']/inertial")
    assert inertial is not None
    for part, values in (("mass", {"value": mass}), ("inertia", dict.fromkeys(MOMENTS, "1e-5"))):
        element = inertial.find(part)
        assert element is not None
        element.attrib.update(values)
    return ElementTree.tostring(root, encoding="unicode")


def _narrow(text: str) -> str:
    """Keep all joints but two where the wrist's axes lie in a plane."""
    root = ElementTree.fromstring(text)
    for joint in root.findall("joint[@type='revolute']")[2:]:
        limit = joint.find("limit")
        assert limit is not None
        limit.attrib.update(lower="-1e-5", upper="1e-5")
    return ElementTree.tostring(root, encoding="unicode")


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        (_with_a_light_chaser, "the chaser, 0.1 kg and 1e-05 kg m2, is too light for the arm"),
        (_narrow, "the joints' position limits are too narrow"),
        (lambda text: _welded(text, (1,)), "as its axes lie"),
        (
            lambda text: _narrow(_with_a_light_chaser(text)),
            "narrow and the chaser, 0.1 kg and 1e-05 kg m2, is light",
        ),
    ],
)
def test_an_arm_that_meets_too_few_conditions_is_told_which_of_axes_limits_and_masses_it_is(
    change: Callable[[str], str], cause: str
) -> None:
    """Each is changed by itself, of an arm that meets all."""
    six = _welded(of_lines(LEMUR_URDF), (3,))
    robot, other = (
        robot_from_urdf_text(text, "chaser", "end_effector") for text in (six, change(six))
    )
    target = Target(np.zeros(3), [0.0, 0.0, 0.0, 1.0])
    assert steered(robot, target) == 6
    assert steered(other, target) < 6
    assert cause in why_not_steered(other, target)
    assert f"no more than {steered(other, target)} of them" in why_not_steered(other, target)


def test_a_heavy_chaser_that_turns_away_is_not_called_light() -> None:
    """It is its moments of inertia alone: wheels that held its attitude would leave the arm all."""
    six = _welded(of_lines(LEMUR_URDF), (5,))
    heavy = robot_from_urdf_text(_with_a_light_chaser(six, "5000"), "chaser", "end_effector")
    target = Target(np.zeros(3), [0.0, 0.0, 0.0, 1.0])
    assert steered(heavy, target) == 5
    assert steered(replace(heavy, base=Base.ATTITUDE_HELD), target) == 6
    why = why_not_steered(heavy, target)
    assert "the chaser, 5000 kg and 1e-05 kg m2, turns away under the arm, 25.9 kg" in why
