"""Links that may touch because they are drawn so: the share of postures in which they do.

Of an arm of twice 1 m the tip is 2 |cos(angle / 2)| from the first joint, the elbow's angle being
anything up to 9 rad: geometry says how often two balls touch.
"""

from __future__ import annotations

import pytest
from straight_arms import ball, straight_arm

from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.urdf.srdf import ALWAYS

CHASER, TIP = 0, 2


def folding(*radii: float) -> Robot:
    """The arm with a chaser of 1 m in the first joint, and balls of some radii at the tip."""
    at_tip = "".join(ball(radius, 1.0) for radius in radii)
    solids = (("chaser", ball(1.0, 0.0)), ("link_1", ball(0.05, 1.0)), ("link_2", at_tip))
    return straight_arm(0.0, 1.0, 1.0, solids=solids)


def may_touch(robot: Robot) -> set[tuple[str, str]]:
    return {(pair.link1, pair.link2) for pair in robot.may_touch if pair.reason == ALWAYS}


@pytest.mark.parametrize(
    ("radius", "always"),
    [(1.1, True), (0.9995, True), (0.95, False), (0.8, False), (0.3, False)],
    ids=["100 %", "99 %", "80 %", "71 %", "45 %"],
)
def test_links_that_touch_in_nearly_every_posture_may_and_others_may_not(
    radius: float, always: bool
) -> None:
    robot = folding(radius)
    assert may_touch(robot) == ({("chaser", "link_2")} if always else set())
    assert robot.pairs == (() if always else ((CHASER, TIP),))


@pytest.mark.parametrize("radii", [(1.1, 0.8), (0.8, 1.1), (1.1, 0.1)])
def test_of_links_of_several_solids_those_that_touch_most_decide(
    radii: tuple[float, float],
) -> None:
    robot = folding(*radii)
    assert may_touch(robot) == {("chaser", "link_2")}
    assert robot.pairs == ()


def test_of_links_of_several_solids_none_of_which_always_touches_all_are_kept_apart() -> None:
    assert folding(0.8, 0.3).pairs == ((CHASER, TIP), (CHASER, TIP + 1))
