"""What the search keeps of limits, both ways and between points, against what is written out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_rows import CoreRows, rows_of_motion
from handmade_plans import SETTINGS, STEP, Made, free_motion, unlimited
from reference_program import rows_of
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation
from straight_arms import ball, straight_arm
from test_limits_by_hand import (
    FASTEST,
    POSTURE,
    accelerating,
    euler,
    moving,
    rotated,
    swinging,
    with_limit,
)

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.planning.paths.path_family import Motion, Sensitivity
from ff_planner_ros.planning.problem.problem import (
    Limits,
    Objective,
    Obstacle,
    Orientation,
    PlanningProblem,
    RigidMotion,
    Target,
)
from ff_planner_ros.planning.requirements.body_rows import times_looked_at
from ff_planner_ros.planning.requirements.clear_of_itself import ClearOfItself
from ff_planner_ros.planning.requirements.clear_of_obstacles import ClearOfObstacles
from ff_planner_ros.planning.requirements.limits.chaser_rotation import (
    ChaserAttitude,
    ChaserRotation,
)
from ff_planner_ros.planning.requirements.limits.joint_limits import (
    JointAccelerations,
    JointPositions,
    JointRates,
)
from ff_planner_ros.planning.requirements.limits.loads import Torques
from ff_planner_ros.planning.requirements.requirement import Requirement, Samples
from ff_planner_ros.robot.collision.solids import Solid
from ff_planner_ros.robot.state import SystemState

POINTS, MARGIN = 9, 0.01
both_ways = pytest.mark.parametrize("sign", [1.0, -1.0])


def problem() -> PlanningProblem:
    return moving("step", "start", 1, 0.2).problem


def motion_of(positions: Array, rates: Array, turned: Array | None = None) -> Motion:
    """Joints at the points of a path; the base turns about an axis, or rests."""
    turns = np.zeros((len(positions), 3)) if turned is None else turned
    attitudes = Rotation.from_rotvec(turns).as_quat()
    q = np.hstack([np.zeros((len(positions), 3)), attitudes, positions])
    half = (turns[:-1] + turns[1:]) / 2
    q_half_way = q[:-1].copy()
    q_half_way[:, 3:7] = Rotation.from_rotvec(half).as_quat()
    v = np.hstack([np.zeros((len(positions), 6)), rates])
    return Motion(x=np.zeros(2), q=q, v=v, q_half_way=q_half_way, goal_error=np.empty(0))


def sensitivity_of(positions: Array, rates: Array) -> Sensitivity:
    """Of two variables: what positions and rates change by; shape (points, joints, 2)."""
    count, base = len(positions), np.zeros((len(positions), 6, 2))
    return Sensitivity(
        q=np.concatenate([base, positions], axis=1),
        v=np.concatenate([base, rates], axis=1),
        q_half_way=np.zeros((count - 1, 12, 2)),
        goal_error=np.empty((0, 2)),
        acceleration=np.zeros((count, 12)),
    )


def wandering(seed: int) -> tuple[Array, Array]:
    rng = np.random.default_rng(seed)
    return 0.1 * rng.normal(size=(POINTS, 6)), 0.4 * rng.normal(size=(POINTS, 6))


def one_bulge(order: int, sign: float) -> tuple[Array, Array]:
    """One joint goes aside between two points, or onward from the one to the other, all one way."""
    positions, rates = np.zeros((2, POINTS, 6))
    if order == 0:
        rates[4:6, 2] = np.array([sign, -sign]) * 1.2 / STEP
    else:
        positions[5:, 2] = sign * 0.3
    return positions, rates


@pytest.mark.law("PLAN-04")
@pytest.mark.parametrize("seed", [0, 1, 2, None])
@both_ways
@pytest.mark.parametrize("order", [0, 1])
def test_the_search_keeps_what_joints_do_between_the_points(
    seed: int | None, sign: float, order: int
) -> None:
    """The least that is left is that of the cubics; limits to the other side are far away."""
    positions, rates = one_bulge(order, sign) if seed is None else wandering(seed)
    dense = np.linspace(0.0, STEP * (POINTS - 1), 2000 * (POINTS - 1) + 1)
    values = CubicHermiteSpline(STEP * np.arange(POINTS), positions, rates)(dense, order)
    at_points = sign * (positions, rates)[order]
    peak = int(((sign * values).max(axis=0) - at_points.max(axis=0)).argmax())
    highest = float((sign * values)[:, peak].max())
    assert highest > at_points[:, peak].max() + 0.005, "no turn between"
    found, robot = problem(), unlimited(problem().robot)
    if order == 0:
        name = "upper_position_limits" if sign > 0.0 else "lower_position_limits"
        limits = getattr(robot, name).copy()
        limits[peak] = sign * (highest + 0.1)
        asked, left = replace(found, robot=replace(robot, **{name: limits})), 0.1 - MARGIN
        required: Requirement = JointPositions()
    else:
        limits = robot.velocity_limits.copy()
        limits[peak] = highest * 1.1
        asked = replace(found, robot=replace(robot, velocity_limits=limits))
        asked = replace(asked, limits=Limits(joint_velocities=True))
        left, required = (0.1 - 1.1 * MARGIN) * highest, JointRates()
    by_x = np.random.default_rng(9).normal(size=(2, POINTS, 6, 2))
    rows = rows_of(required, asked, motion_of(positions, rates), sensitivity_of(*by_x), MARGIN)
    assert rows is not None
    if order == 0 or np.abs(values[:, peak]).max() == highest:
        assert rows.values.min() == pytest.approx(left, abs=1e-6)
    # And its derivative is that of differences.
    step, worst = 1e-6, int(rows.values.argmin())
    for column in range(2):
        sides = []
        for way in (-step, step):
            aside = motion_of(
                *(a + way * b[..., column] for a, b in zip((positions, rates), by_x, strict=True))
            )
            again = rows_of(required, asked, aside, sensitivity_of(*by_x), MARGIN)
            assert again is not None
            sides.append(again.values[again.names == rows.names[worst]])
        slope = (sides[1] - sides[0]) / (2 * step)
        # Two turns between two points have one name.
        assert np.abs(rows.jacobian[worst, column] - slope).min() < 1e-4


@pytest.mark.parametrize("of_torques", [False, True])
@both_ways
def test_the_search_keeps_accelerations_and_torques_at_the_points(
    of_torques: bool, sign: float
) -> None:
    """Of quintics, whose accelerations it knows exactly; one joint, one way."""
    rng, time = np.random.default_rng(4), STEP * np.arange(POINTS)
    curves = [
        np.polynomial.Polynomial(0.02 * rng.normal(size=6) / 2.0 ** np.arange(6)) for _ in "abcdef"
    ]
    positions, rates, accelerations = (
        np.array([curve.deriv(order)(time) for curve in curves]).T for order in range(3)
    )
    motion = motion_of(POSTURE + positions, rates)
    robot = unlimited(problem().robot)
    values = accelerations
    if of_torques:
        samples = zip(motion.q, motion.v, accelerations, strict=True)
        values = np.array([free_motion(robot, *at)[1] for at in samples])
    joint = int(((sign * values[1:]).max(axis=0) / np.abs(values).max(axis=0)).argmax())
    highest = float((sign * values[1:, joint]).max())
    assert highest == np.abs(values[:, joint]).max()
    limit = 1.2 * highest
    asked = replace(problem(), limits=accelerating(joint, limit), duration=float(time[-1]))
    required: Requirement = JointAccelerations()
    if of_torques:
        efforts = np.full(6, 1e6)
        efforts[joint] = limit
        robot = replace(robot, effort_limits=efforts)
        asked, required = replace(asked, robot=robot, limits=Limits()), Torques()
    nothing = np.zeros((POINTS, 6, 2))
    rows = rows_of(required, asked, motion, sensitivity_of(nothing, nothing), MARGIN)
    assert rows is not None
    assert rows.values.min() == pytest.approx(1.0 - MARGIN - 1.0 / 1.2, abs=1e-6)


@both_ways
@pytest.mark.parametrize("axis", range(3))
def test_the_search_keeps_the_attitude_both_ways(sign: float, axis: int) -> None:
    turned = np.outer(np.linspace(0.0, sign * 0.15, POINTS), np.eye(3)[axis])
    chaser = Rotation.from_matrix(problem().robot.rotation_chaser_to_base)
    motion = motion_of(np.zeros((POINTS, 6)), np.zeros((POINTS, 6)), turned)
    for q in (motion.q, motion.q_half_way):  # the chaser's axes begin as the inertial ones
        q[:, 3:7] = (Rotation.from_quat(q[:, 3:7]) * chaser.inv()).as_quat()
    last = Rotation.from_rotvec(turned[-1]).as_euler("ZYX")
    limit = float(np.abs(last).max()) + 0.1
    nothing = np.zeros((POINTS, 6, 2))
    asked = replace(problem(), limits=Limits(chaser_attitude=limit))
    rows = rows_of(ChaserAttitude(), asked, motion, sensitivity_of(nothing, nothing), MARGIN)
    assert rows is not None
    assert rows.values.min() == pytest.approx(0.1 - MARGIN, abs=1e-9)


@both_ways
@pytest.mark.parametrize("axis", range(3))
def test_the_search_keeps_the_rotation_both_ways(sign: float, axis: int) -> None:
    """Of a base that begins anywhere; what is far from its limit has no row."""
    turned = np.outer(np.linspace(0.0, sign * 0.15, POINTS), np.eye(3)[axis])
    motion = motion_of(np.zeros((POINTS, 6)), np.zeros((POINTS, 6)), turned)
    for q in (motion.q, motion.q_half_way):
        begin = Rotation.from_rotvec([0.4, -2.0, 1.0])
        q[:, 3:7] = (begin * Rotation.from_quat(q[:, 3:7])).as_quat()
    nothing = np.zeros((POINTS, 6, 2))
    in_parabola = 0.39 - (0.15**2 / 0.39 + 0.39 / 4)
    for limit, count, left in (
        (0.25, 2 * POINTS - 2, 0.1 - MARGIN),
        (0.39 + MARGIN, 3, in_parabola),
    ):
        asked = replace(problem(), limits=Limits(chaser_rotation=limit))
        rows = rows_of(ChaserRotation(), asked, motion, sensitivity_of(nothing, nothing), MARGIN)
        assert rows is not None
        kept = ChaserRotation().in_core(asked, POINTS, MARGIN)
        for found in (rows, rows_of_motion(asked.robot, kept, motion)):
            assert found.values.min() == pytest.approx(left, abs=1e-9)
            assert len(found.values) == count


def slack_of(required: Requirement, found: Made, **changes: object) -> float:
    asked = replace(found.problem, **changes)  # type: ignore[arg-type]
    motion = Samples(asked, SETTINGS, found.plan.trajectory).followed
    return required.slack(asked, motion)


@both_ways
@pytest.mark.parametrize("place", ["start", "tail"])
def test_slack_is_what_is_left_of_the_nearest_limit_and_negative_beyond(
    place: str, sign: float
) -> None:
    rounding = 1e-6
    found = moving("bulge", place, 2, sign * 0.3)
    name = "upper_position_limits" if sign > 0.0 else "lower_position_limits"
    robot = with_limit(found, name, 2, POSTURE[2] + sign * 0.2)
    left = slack_of(JointPositions(), found, robot=robot)
    assert left == pytest.approx(-0.1 + rounding, abs=1e-8)
    robot = with_limit(found, name, 2, POSTURE[2] + sign * 0.31)
    assert slack_of(JointPositions(), found, robot=robot) > -0.05
    found = moving("step", place, 1, sign * 0.2)
    rate, limits = FASTEST * 0.2 / STEP, Limits(joint_velocities=True)
    robot = with_limit(found, "velocity_limits", 1, 0.8 * rate)
    left = slack_of(JointRates(), found, robot=robot, limits=limits)
    assert left == pytest.approx(-0.25 + rounding / (0.8 * rate), abs=1e-8)
    found = moving("accelerations", "between" if place == "tail" else place, 0, sign * 0.5)
    left = slack_of(JointAccelerations(), found, limits=accelerating(0, 0.4))
    assert left == pytest.approx(-0.25 + rounding / 0.4, abs=1e-8)
    torques = found.torques[:, 0]
    largest = float(np.abs(torques).max())
    robot = with_limit(found, "effort_limits", 0, 0.8 * largest)
    assert slack_of(Torques(), found, robot=robot) == pytest.approx(-0.25, abs=2e-3)
    swing = swinging(place, 0, sign * 1.0)
    angle = float(np.abs(euler(swing)).max())
    left = slack_of(ChaserAttitude(), swing, limits=Limits(chaser_attitude=angle - 0.01))
    assert left == pytest.approx(-0.01, abs=1e-4)
    angle = float(rotated(swing).max())
    for aside in (-0.01, 0.01):
        left = slack_of(ChaserRotation(), swing, limits=Limits(chaser_rotation=angle + aside))
        assert left == pytest.approx(aside, abs=1e-4)


@pytest.mark.parametrize("apart", [0.05, 0.021, 0.019, 0.004, 0.0, -0.01])
def test_of_what_begins_close_no_more_than_half_the_distance_is_asked(apart: float) -> None:
    """A folded arm that rests: its second link ends 0.4 m from the chaser's middle."""
    of_elbow = ("link_1", ball(0.05, 1.0))
    solids = ("chaser", ball(0.2 - apart, 0.0)), of_elbow, ("link_2", ball(0.2, 0.6))
    robot = straight_arm(0.0, 1.0, 0.6, 0.1, solids=solids)
    assert robot.pairs == ((0, 2),)
    still, upright, posture = np.zeros(3), [0.0, 0.0, 0.0, 1.0], np.array([0.0, np.pi, 0.0])
    start = SystemState(still, upright, still, still, posture, still)
    anywhere = Target(still, upright, orientation=Orientation.FREE)
    rock = Obstacle.sphere("rock", [0.4, 0.5 + apart, 0.0], 0.3)
    # So slow that it stays where it is, and fast enough to see which way it goes.
    coming = np.array([0.0, -1e-12, 0.0])
    crate = Obstacle(
        "crate", Solid("box", np.array([0.2, 0.6, 0.2])), RigidMotion(rock.center, velocity=coming)
    )
    obstacles = (rock, crate)
    asked = PlanningProblem(robot, start, anywhere, 1.0, POINTS, obstacles, Objective(1.0, 0.0))
    motion = motion_of(np.tile(posture, (POINTS, 1)), np.zeros((POINTS, 3)))
    room, times = max(apart, 0.0) / 2, times_looked_at(1.0, POINTS)
    assert times[-1] == 1.0
    # Where there is room for less than half of the margin, a quarter of the time makes it up.
    gained = MARGIN * np.minimum(4.0 * times, 1.0) ** 3 if room < MARGIN / 2 else 0.0 * times

    def rows(
        required: Requirement, beside: tuple[Obstacle, ...], lasting: bool = False
    ) -> CoreRows:
        kept = required.in_core(replace(asked, obstacles=beside), POINTS, MARGIN)
        assert kept is not None
        return rows_of_motion(robot, kept, motion, lasting)

    later = rows(ClearOfObstacles(), (crate,), lasting=True).jacobian[:, -1]
    assert (later < 0.0).all()
    assert later.min() == pytest.approx(-1e-12)
    for required, beside, count in (
        (ClearOfItself(), obstacles, 1),
        (ClearOfObstacles(), (rock,), 3),
        (ClearOfObstacles(), (crate,), 3),
    ):
        found = rows(required, beside)
        assert len(found.values) == len(times)
        more = gained[found.names // count] if count > 1 else 0.0
        left = apart - np.minimum(MARGIN, room + more)
        assert found.values == pytest.approx(left, abs=1e-9)
