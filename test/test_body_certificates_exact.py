"""What is certified of bodies, where geometry says how near they come.

Balls on a straight arm: each motion comes nearest between two points and is far at all of them. Of
the check's certificate and the search's; both name the right pair, and the right time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from near_bodies import certified_clearance, least_distance
from straight_arms import ball, panel_about, straight_arm, told, turning

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.distance import body_certificate
from ff_planner_ros.planning.distance.body_certificate import CHECK_GAP, least_pair_distance
from ff_planner_ros.planning.distance.body_motion import body_ways, pair_ways
from ff_planner_ros.planning.distance.moving_place import least_margin
from ff_planner_ros.planning.distance.search_certificate import (
    CERTIFICATE_GAP,
    search_distance,
    search_pair_distance,
)
from ff_planner_ros.planning.distance.solids_apart import Distances
from ff_planner_ros.planning.motion import certified_least
from ff_planner_ros.planning.motion.certified_least import NOTHING, Least, least_of
from ff_planner_ros.planning.motion.followed import FollowedMotion
from ff_planner_ros.planning.problem.problem import Obstacle, attached
from ff_planner_ros.planning.problem.target_body import AttachedObstacle, TargetBody
from ff_planner_ros.robot.model import Robot

# A chaser of 0.2 m in the first joint, a ball in the elbow, and one of 0.1 m at the tip.
ARM = straight_arm(
    0.0,
    1.0,
    0.6,
    solids=(("chaser", ball(0.2, 0.0)), ("link_1", ball(0.05, 1.0)), ("link_2", ball(0.1, 0.6))),
)
CHASER, ELBOW, TIP = range(3)
# Twenty points: more than are looked at first, and at steps that are not equal.
TIMES = np.cumsum([0.0, *(0.1 + 0.05 * (np.arange(19) % 3))])
LAST = len(TIMES) - 1
STILL = np.zeros((len(TIMES), 2))
REST = told(TIMES, STILL, STILL)


def require(least: Least, searched: float, true: float, part: float = 0.0) -> None:
    """Hold both certificates against the true distance, and each against its gap."""
    gap = CHECK_GAP + 1e-9
    assert true - gap <= least.certified <= true + 1e-9
    assert true - 1e-9 <= least.found <= least.certified + gap
    gap = max(CERTIFICATE_GAP, part * true) + 1e-9
    assert true - gap <= searched <= true + 1e-9


def spheres_are(
    motion: FollowedMotion,
    spheres: Sequence[Obstacle],
    true: float,
    chosen: Sequence[int] | None = None,
    last: int = LAST,
    part: float = 0.0,
) -> Least:
    """Require the least distance of bodies from spheres."""
    every = range(3 * len(spheres)) if chosen is None else chosen
    asked = ARM, motion, spheres, np.array(every, np.intp), last
    least = least_distance(*asked)
    require(least, search_distance(*asked, part), true, part)
    return least


def on_circle(angle: float, distance: float) -> Array:
    return distance * np.array([np.cos(angle), np.sin(angle), 0.0])


def swing(way: float = 1.0) -> FollowedMotion:
    """The stretched arm about its first joint, at one radian a second."""
    return turning(TIMES, np.array([-0.4 * way, 0.0]), np.array([way, 0.0]))


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize("interval", [0, 3, 7, 8, 15, 16, 18])
def test_a_tip_that_swings_past_a_sphere_between_two_points(interval: int, way: float) -> None:
    when = TIMES[interval] + 0.4 * (TIMES[interval + 1] - TIMES[interval])
    rock = Obstacle.sphere("rock", on_circle(way * (when - 0.4), 1.8), 0.07)
    far = Obstacle.sphere("far", [0.0, 0.0, 1.0], 0.5)
    least = spheres_are(swing(way), [far, rock], 0.03)
    assert divmod(least.number, 2) == (TIP, 1)
    assert least.time == pytest.approx(when, abs=0.02)
    # What is not asked for is not told: the elbow's distance, and that of the other sphere.
    of_elbow = spheres_are(swing(way), [far, rock], 0.68, chosen=[ELBOW * 2 + 1])
    assert of_elbow.number == ELBOW * 2 + 1
    of_chaser = spheres_are(swing(way), [far, rock], 0.3, chosen=[CHASER * 2])
    assert of_chaser.number == CHASER * 2


@pytest.mark.parametrize("interval", [0, 9, 18])
def test_what_is_nearest_half_way_between_two_points_is_nearest_then(interval: int) -> None:
    """The first look there finds it, and no later one finds anything nearer."""
    when = (TIMES[interval] + TIMES[interval + 1]) / 2
    rock = Obstacle.sphere("rock", on_circle(when - 0.4, 1.8), 0.07)
    assert spheres_are(swing(), [rock], 0.03).time == pytest.approx(when, abs=1e-6)


@pytest.mark.parametrize("pace", [1.0, 20.0])
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_what_turns_far_from_a_robot_at_rest_in_steps_of_seconds(way: float, pace: float) -> None:
    """On a circle of 1 m about a place 3 m beyond the tip; nearest is its near end, once a turn."""
    rest, rate = told(pace * TIMES, STILL, STILL), 3.0 * way / pace
    begin = np.pi - rate * pace * (0.6 * TIMES[11] + 0.4 * TIMES[12])
    assert spheres_are(rest, panel_about(4.6, begin, rate), 1.6).number == TIP


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_an_arm_that_swings_out_and_back_between_two_points(way: float) -> None:
    """At both it is at zero, and half-way between them at half a radian."""
    rates = np.zeros((5, 2))
    rates[1, 0], rates[2, 0] = 2.0 * way, -2.0 * way
    motion = told([0.0, 1.0, 2.0, 3.0, 4.0], np.zeros((5, 2)), rates)
    rock = Obstacle.sphere("rock", on_circle(0.9 * way, 1.6), 0.05)
    spheres_are(motion, [rock], 3.2 * np.sin(0.2) - 0.1 - 0.05, last=4)


@pytest.mark.parametrize("last", [5, 9, 16])
def test_what_comes_after_the_last_point_that_counts_is_not_looked_at(last: int) -> None:
    """The tip comes nearest in the interval behind it; up to there it comes as near as this."""
    end, nearest = TIMES[last] - 0.4, TIMES[last] - 0.4 + 0.08
    rock = Obstacle.sphere("rock", on_circle(nearest, 1.8), 0.07)
    until = float(np.linalg.norm(on_circle(nearest, 1.8) - on_circle(end, 1.6))) - 0.17
    assert until > 0.05
    least = spheres_are(swing(), [rock], until, last=last)
    assert least.time == pytest.approx(TIMES[last], abs=1e-9)
    spheres_are(swing(), [rock], 0.03, last=last + 1)


@pytest.mark.parametrize("part", [0.02, 0.5])
def test_what_is_far_away_is_certified_to_a_part_of_its_distance(part: float) -> None:
    rock = Obstacle.sphere("rock", on_circle(0.73, 4.0), 0.3)
    spheres_are(swing(), [rock], 2.0, part=part)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("interval", [0, 6, 18])
def test_a_sphere_that_flies_past_a_resting_arm(interval: int, side: float) -> None:
    when = TIMES[interval] + 0.55 * (TIMES[interval + 1] - TIMES[interval])
    velocity = np.array([0.0, 6.0 * side, 0.0])
    flying = Obstacle.sphere("debris", np.array([1.6, 0.0, 0.4]) - when * velocity, 0.1, velocity)
    least = spheres_are(REST, [Obstacle.sphere("far", [9.0, 0.0, 0.0], 0.1), flying], 0.2)
    assert least.time == pytest.approx(when, abs=0.01)
    assert divmod(least.number, 2) == (TIP, 1)


@pytest.mark.law("PLAN-10")
@pytest.mark.parametrize("spin", [3.0, -3.0])
def test_a_sphere_that_swings_past_on_a_body_that_spins(spin: float) -> None:
    """A boom of 2 m; it points to the tip at the middle of an interval."""
    when = (TIMES[9] + TIMES[10]) / 2
    body = TargetBody(
        position=[4.0, 0.0, 0.0],
        quaternion_xyzw=[0.0, 0.0, 0.0, 1.0],
        inertia=np.eye(3),
        grasp_position=[0.0, 0.0, 9.0],
        grasp_quaternion_xyzw=[0.0, 0.0, 0.0, 1.0],
        angular_velocity=[0.0, 0.0, spin],
        obstacles=(AttachedObstacle.sphere("boom", -on_circle(-spin * when, 2.0), 0.15),),
    )
    spheres_are(REST, tuple(attached(body)), 0.4 - 0.1 - 0.15)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_chaser_that_flies_past_a_sphere_and_one_that_turns_past_it(way: float) -> None:
    count, when = len(TIMES), (TIMES[12] + TIMES[13]) / 2
    base, twists = np.zeros((count, 7)), np.zeros((count, 6))
    base[:, 1], base[:, 6], twists[:, 1] = 3.0 * way * TIMES, 1.0, 3.0 * way
    flying = told(TIMES, STILL, STILL, base, twists)
    spheres_are(flying, [Obstacle.sphere("rock", [1.9, 3.0 * way * when, 0.0], 0.1)], 0.1)
    base, twists = np.zeros((count, 7)), np.zeros((count, 6))
    base[:, 5], base[:, 6] = np.sin(0.5 * way * TIMES), np.cos(0.5 * way * TIMES)
    twists[:, 5] = way
    turned = told(TIMES, STILL, STILL, base, twists)
    spheres_are(turned, [Obstacle.sphere("rock", on_circle(way * when, 1.9), 0.1)], 0.1)


def pairs_are(motion: FollowedMotion, true: float, robot: Robot = ARM, last: int = LAST) -> Least:
    """Require the least distance of bodies from each other."""
    asked = robot, motion, np.arange(len(robot.pairs)), last
    least = least_pair_distance(*asked)
    require(least, search_pair_distance(*asked, 0.0), true)
    return least


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize("interval", [0, 7, 8, 18])
def test_a_tip_that_folds_past_the_chaser_between_two_points(interval: int, way: float) -> None:
    """Nearest where the elbow is folded: 1 m less 0.6 m less both radii."""
    assert ARM.pairs == ((CHASER, TIP),)
    when = TIMES[interval] + 0.45 * (TIMES[interval + 1] - TIMES[interval])
    begin = np.array([0.3, way * (np.pi - when)])
    motion = turning(TIMES, begin, np.array([0.2, way]))
    least = pairs_are(motion, 1.0 - 0.6 - 0.2 - 0.1)
    assert least.number == 0
    assert least.time == pytest.approx(when, abs=0.05)


@pytest.mark.parametrize("interval", [0, 9, 18])
def test_a_tip_that_folds_into_the_chaser_is_certified_to_be_as_deep_at_least(
    interval: int,
) -> None:
    """How deep, the core does not know: the search is told by the check."""
    box = '<collision><geometry><box size="1 1 1"/></geometry></collision>'
    solids = (("chaser", box), ("link_1", ball(0.05, 1.0)), ("link_2", ball(0.1, 0.6)))
    when = TIMES[interval] + 0.45 * (TIMES[interval + 1] - TIMES[interval])
    motion = turning(TIMES, np.array([0.0, np.pi - when]), np.array([0.0, 1.0]))
    pairs_are(motion, 0.4 - 0.5 - 0.1, straight_arm(0.0, 1.0, 0.6, solids=solids))


def test_bodies_that_swing_together_are_as_far_apart_as_they_were() -> None:
    """The joint before both of them moves neither against the other."""
    arm = straight_arm(
        0.3, 0.5, 0.4, 0.6, solids=tuple((f"link_{k}", ball(0.1, 0.0)) for k in (1, 2, 3))
    )
    assert arm.pairs == ((0, 2),)
    rates = np.array([2.0, 0.0, 0.0])
    motion = turning(TIMES, np.zeros(3), rates)
    assert not pair_ways(arm, motion).any()
    pairs_are(motion, 0.9 - 0.2, arm)


def test_at_the_first_point_alone_every_pair_and_sphere_is_measured() -> None:
    """Where what is allowed later begins behind it, nothing lies between two points."""
    rocks = [
        Obstacle.sphere("near", [1.6, 0.3, 0.0], 0.05),
        Obstacle.sphere("far", [0.0, 0.0, -2.0], 1.5),
    ]
    least = spheres_are(REST, rocks, 0.15, last=0)
    assert (least.time, divmod(least.number, 2)) == (0.0, (TIP, 0))
    assert spheres_are(REST, rocks, 0.3, chosen=[1], last=0).number == 1
    pairs_are(REST, 1.6 - 0.3, last=0)
    asked = ARM, REST, np.zeros(0, np.intp), LAST
    assert least_pair_distance(*asked) == NOTHING
    assert least_pair_distance(ARM, REST, np.arange(1), -1) == NOTHING
    assert search_pair_distance(*asked, 0.0) == np.inf
    # One time is all that is left of the motion.
    fields = ("time", "q", "v", "joint_accelerations")
    left = replace(REST, maps=None, **{name: getattr(REST, name)[:1] for name in fields})
    assert least_pair_distance(ARM, left, np.arange(1), 0).certified == pytest.approx(1.3, abs=1e-5)
    found = least_distance(ARM, left, rocks, np.arange(6), 0)
    assert found.certified == pytest.approx(0.15, abs=1e-5)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_ways_of_bodies_are_exact_where_one_axis_moves(sign: float) -> None:
    """In the last interval of 0.15 s the farthest point of each ball moves at rate times lever."""
    step, farthest = float(TIMES[-1] - TIMES[-2]), np.array([0.2, 1.05, 1.7])
    for rates, levers in (
        ([sign, 0.0], [0.0, 1.05, 1.7]),
        ([0.0, 2.0 * sign], [0.0, 0.0, 1.4]),
        ([sign, sign], [0.0, 1.05, 1.7 + 0.7]),
    ):
        motion = turning(TIMES, np.zeros(2), np.array(rates))
        assert body_ways(ARM, motion)[-1] == pytest.approx(step * np.array(levers), abs=1e-12)
    base, twists = np.zeros((len(TIMES), 7)), np.zeros((len(TIMES), 6))
    base[:, 6], base[:, 2], twists[:, 2] = 1.0, 0.5 * sign * TIMES, 0.5 * sign
    drifting = told(TIMES, STILL, STILL, base, twists)
    assert body_ways(ARM, drifting)[-1] == pytest.approx(0.5 * step, abs=1e-12)
    base[:, 2], base[:, 4] = 0.0, sign * np.sin(TIMES / 2)
    base[:, 6], twists[:, 2], twists[:, 4] = np.cos(TIMES / 2), 0.0, sign
    spinning = told(TIMES, STILL, STILL, base, twists)
    assert body_ways(ARM, spinning)[-1] == pytest.approx(step * farthest, rel=1e-9)
    # The axis of a base that drifts and turns turns on its way: by half of it more.
    base[:, 1], twists[:, 4], twists[:, 5] = 0.0, 0.0, sign
    base[:, 4], base[:, 5] = 0.0, sign * np.sin(TIMES / 2)
    twists[:, 2], base[:, 2] = 2.0, 2.0 * TIMES
    screw = told(TIMES, STILL, STILL, base, twists)
    expected = 2.0 * step + step * (farthest + 2.0 * step / 2)
    assert body_ways(ARM, screw)[-1] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(("order", "factor"), [(1, 1.0), (2, 2.0), (3, 3.0)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_ways_follow_the_cubic_and_pairs_take_the_nearer_body(
    order: int, factor: float, sign: float
) -> None:
    """One interval of 1 s on which a joint goes as a power of time: fastest at its end.

    The elbow moves the tip by 0.7 m a radian, and seen from it the chaser is 1.2 m away; the first
    joint is in the chaser's middle.
    """
    for joint, way in ((0, 0.2), (1, 0.7)):
        angles, rates = np.zeros((2, 2)), np.zeros((2, 2))
        angles[1, joint], rates[1, joint] = 0.1 * sign, 0.1 * sign * factor
        rates[0, joint] = 0.1 * sign if order == 1 else 0.0
        motion = told([0.0, 1.0], angles, rates)
        expected = 0.1 * factor * way
        assert pair_ways(ARM, motion) == pytest.approx(np.array([[expected]]), rel=1e-12)


def test_the_lesser_of_two_keeps_the_lower_certificate_of_both() -> None:
    """What is nearer was found so; what is farther may be certified to less all the same."""
    near, far = Least(0.195, 0.2, 3, 1.0), Least(0.19, 0.21, 4, 2.0)
    for found in (least_of(near, far), least_of(far, near)):
        assert found == Least(0.19, 0.2, 3, 1.0)


def counted(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Let few pieces be looked at; return how many distances are measured, call by call."""
    looked_at, measure = list[int](), body_certificate.obstacle_distances

    def counting(*asked: Any) -> Distances:
        looked_at.append(len(asked[-1][0]))
        return measure(*asked)

    monkeypatch.setattr(body_certificate, "obstacle_distances", counting)
    monkeypatch.setattr(certified_least, "MOST_PIECES", 1 << 9)
    return looked_at


@pytest.mark.parametrize("rate", [100.0, 300.0])
def test_a_motion_too_fast_to_certify_closely_ends_with_a_lower_bound(
    rate: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The tip circles below a sphere at a constant distance, so that no piece is decided early."""
    looked_at = counted(monkeypatch)
    motion = turning(TIMES, np.array([-0.4 * rate, 0.0]), np.array([rate, 0.0]))
    above = [Obstacle.sphere("above", [0.0, 0.0, 0.5], 0.05)]
    least = least_distance(ARM, motion, above, np.array([TIP]), LAST)
    assert sum(looked_at) < 1 << 13
    true = np.hypot(1.6, 0.5) - 0.15
    assert least.certified < true - CERTIFICATE_GAP
    assert least.found == pytest.approx(true)


def test_centre_lines_too_fast_to_certify_closely_end_with_a_lower_bound(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As above, of an arm without bodies."""
    looked_at = counted(monkeypatch)
    lines = straight_arm(0.0, 1.0, 0.6)
    motion = turning(TIMES, np.array([-120.0, 0.0]), np.array([300.0, 0.0]))
    beside = [Obstacle.sphere("around", [0.0, 0.0, 0.5], 0.05)]
    found = certified_clearance(lines, motion.q, motion.v, TIMES, beside)
    assert sum(looked_at) < 1 << 13
    assert found < 0.45 + 1e-9


@pytest.mark.parametrize("way", [2e3, 1e9])
def test_a_point_too_fast_to_certify_closely_ends_with_a_lower_bound(way: float) -> None:
    """Along a wall, at a constant distance."""
    looked_at = list[int]()

    def margins(places: Array) -> Array:
        looked_at.append(len(places))
        return np.asarray(places[:, 2])

    times = np.linspace(0.0, 1.0, 5)
    velocities = np.outer(np.ones(5), [way, 0.0, 0.0])
    places = times[:, None] * velocities
    places[:, 2] = 1.0
    least, _ = least_margin(times, places, velocities, margins)
    assert sum(looked_at) < 1 << 20
    assert least.certified < least.found - CERTIFICATE_GAP
    assert least.found == 1.0
