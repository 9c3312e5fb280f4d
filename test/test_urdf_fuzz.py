"""Whatever is written in a URDF: a sound robot, or a refusal in words."""

from __future__ import annotations

import random
from collections.abc import Callable
from xml.etree import ElementTree

import numpy as np
import pytest
from robots import CANADARM2_URDF, LEMUR_URDF, random_urdf

from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.robot.model import Robot, robot_from_urdf_text

SEED = 20261122
GIVEN = (LEMUR_URDF.read_text(), CANADARM2_URDF.read_text(), random_urdf(6, seed=3))
VALUES = (
    *("", " ", "0", "-1", "1e308", "-1e308", "1e-308", "1e400", "nan", "-inf", "1e12", "1e-12"),
    *("0 0 0", "1e-200 0 0", "1e300 1e300 1e300", "1 2", "1 2 3 4", "nan 0 0", "x y z", "1,2,3"),
    *("fixed", "revolute", "continuous", "prismatic", "floating", "planar", "ball", "world"),
    *("link_1", "link_3", "joint_2", "chaser", "bus", "universe", "root_joint", "9" * 5000),
    *("\u00e4\u00f6", "\U0001f916", "a\nb", "<&>", "'\"", "n" * 5000, "0x1p3", "1_0", "\u0663"),
)
TAGS = ("link", "joint", "inertial", "origin", "mass", "inertia", "axis", "limit", "mimic", "robot")


def of_other_text(text: str, chance: random.Random) -> str:
    """Change characters: mostly no XML any more."""
    for _ in range(chance.choice((1, 1, 3))):
        place, other = chance.randrange(len(text)), chance.randrange(len(text))
        length = chance.choice((0, 1, 1, 4, 60))
        written = (chr(chance.randrange(1, 0xE000)), text[other : other + length], "<a>" * 2000)
        text = text[:place] + chance.choice(written) + text[place + length :]
    return text


def of_other_elements(text: str, chance: random.Random) -> str:
    """Change elements and attributes: XML, and nearly a robot."""
    robot = ElementTree.fromstring(text)
    for _ in range(chance.choice((1, 1, 1, 1, 2, 4, 20))):
        if len(list(robot.iter())) > 2000:
            break
        parents = [element for element in robot.iter() if len(element)]
        parent = chance.choice(parents)
        child, other = chance.choice(list(parent)), chance.choice(list(robot.iter()))
        match chance.randrange(7):
            case 0:
                parent.remove(child)
            case 1:
                parent.append(ElementTree.fromstring(ElementTree.tostring(child)))
            case 2:
                child.tag = chance.choice(TAGS)
            case 3 if other not in child.iter():  # no loop
                other.append(child)
            case 4 if child.attrib:
                del child.attrib[chance.choice(list(child.attrib))]
            case _ if other.attrib:
                other.set(chance.choice(list(other.attrib)), chance.choice(VALUES))
    return ElementTree.tostring(robot, encoding="unicode")


@pytest.mark.law("FILE-02")
@pytest.mark.parametrize("written", [of_other_text, of_other_elements])
def test_any_urdf_is_a_sound_robot_or_a_refusal_in_words(
    written: Callable[[str, random.Random], str], times: Callable[[int, int], int]
) -> None:
    loaded = 0
    for number in range(times(250, 20_000)):
        chance = random.Random(SEED + number)
        text = written(chance.choice(GIVEN), chance)
        tip = chance.choice(("end_effector", "tool", None))
        answer = robot_or_refusal(text, tip)
        if isinstance(answer, InvalidInput):
            assert answer.status is Status.BAD_ROBOT, number
            assert len(str(answer)) <= 950, number
            continue
        robot = answer
        loaded += 1
        assert is_sound(robot), number
        again = robot_from_urdf_text(robot.urdf, robot.base_link, robot.tip_link)
        assert again.urdf == robot.urdf, number
        assert again.model == robot.model, number
    assert loaded > times(20, 20)


def robot_or_refusal(text: str, tip_link: str | None) -> Robot | InvalidInput:
    try:
        return robot_from_urdf_text(text, None, tip_link)
    except InvalidInput as refusal:
        return refusal


def is_sound(robot: Robot) -> bool:
    bodies = list(robot.model.inertias)[1:]
    moments = np.array([np.linalg.eigvalsh(body.inertia) for body in bodies])
    return (
        robot.joints >= 1
        and all(body.mass > 0.0 and np.isfinite(body.lever).all() for body in bodies)
        and bool((moments > 0.0).all() and np.isfinite(moments).all())
        and np.allclose(np.linalg.norm(robot.joint_axes, axis=1), 1.0)
        and bool((robot.lower_position_limits < robot.upper_position_limits).all())
        and bool((robot.velocity_limits > 0.0).all())
    )
