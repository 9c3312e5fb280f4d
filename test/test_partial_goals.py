"""Goals that ask for a part of a pose: what counts, what is refused, and that plans reach it."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from planar_model import TESTBED, planar_robot, planar_state
from robots import CONFIG, random_urdf
from scipy.spatial.transform import Rotation

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.check.check import failures
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.steered import steered
from ff_planner_ros.planning.problem.problem import (
    Objective,
    Obstacle,
    Orientation,
    PlanningProblem,
    Target,
)
from ff_planner_ros.planning.problem.target import conditions_of
from ff_planner_ros.planning.requirements.goal import miss
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Base, Robot, load_robot, robot_from_urdf_text
from ff_planner_ros.simulation.verification import verify

SETTINGS = load_parameters().planner
PLANAR = CONFIG / "scenarios/planar_capture.yaml"
AXIS = np.array([0.6, 0.0, 0.8])


@pytest.fixture(scope="module")
def planar() -> PlanningProblem:
    """The capture on the table, without obstacles."""
    return replace(load_scenario(PLANAR), obstacles=())


def targeted(problem: PlanningProblem, **changes: Any) -> PlanningProblem:
    return replace(problem, target=replace(problem.target, **changes))


def ee_pose(robot: Robot, q: Array) -> pin.SE3:
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    return pin.updateFramePlacement(robot.model, data, robot.tip_frame_id)


def planned(problem: PlanningProblem) -> Plan:
    """Return a plan that came true in an independent engine."""
    found = perform(PlanningTask(problem, SETTINGS))
    verdict = verify(problem.robot, found.trajectory)
    assert verdict.passed, verdict.deviation
    return found


# ---- what counts


def test_where_the_orientation_is_free_only_the_way_counts(lemur_capture: PlanningProblem) -> None:
    q, _ = configuration(lemur_capture.robot, lemur_capture.start)
    target = replace(lemur_capture.target, orientation=Orientation.FREE)
    way, turn = miss(lemur_capture.robot, q, target)
    tip = ee_pose(lemur_capture.robot, q)
    np.testing.assert_allclose(way, lemur_capture.target.position - tip.translation)
    assert not turn.any()


@pytest.mark.parametrize("seed", range(5))
def test_about_an_axis_the_turn_is_the_angle_between_the_axes(
    lemur_capture: PlanningProblem, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    robot = lemur_capture.robot
    q, _ = configuration(robot, lemur_capture.start)
    tip = ee_pose(robot, q)
    wanted = Rotation.random(random_state=seed)
    target = replace(
        lemur_capture.target,
        quaternion_xyzw=wanted.as_quat(),
        orientation=Orientation.ABOUT_AXIS,
        free_axis_in_ee=rng.normal(size=3),
    )
    _, turn = miss(robot, q, target)
    axis = target.free_axis_in_ee
    here, there = tip.rotation @ axis, wanted.as_matrix() @ axis
    assert np.linalg.norm(turn) == pytest.approx(np.arccos(here @ there))
    np.testing.assert_allclose(Rotation.from_rotvec(turn).apply(here), there, atol=1e-12)
    # However it is turned about the axis, nothing is missed.
    spin = Rotation.from_rotvec(rng.uniform(-3.0, 3.0) * axis)
    spun = Rotation.from_matrix(tip.rotation) * spin
    _, none = miss(robot, q, replace(target, quaternion_xyzw=spun.as_quat()))
    assert np.linalg.norm(none) < 1e-12


def test_an_axis_that_points_the_other_way_is_half_a_turn_away(
    lemur_capture: PlanningProblem,
) -> None:
    robot = lemur_capture.robot
    q, _ = configuration(robot, lemur_capture.start)
    flip = Rotation.from_matrix(ee_pose(robot, q).rotation) * Rotation.from_rotvec([np.pi, 0, 0])
    target = replace(
        lemur_capture.target,
        quaternion_xyzw=flip.as_quat(),
        orientation=Orientation.ABOUT_AXIS,
        free_axis_in_ee=np.array([0.0, 0.0, 2.0]),
    )
    assert np.linalg.norm(miss(robot, q, target)[1]) == pytest.approx(np.pi)


def test_what_is_free_does_not_change_the_task(lemur_capture: PlanningProblem) -> None:
    free = targeted(lemur_capture, orientation=Orientation.FREE)
    other = targeted(free, quaternion_xyzw=np.array([1.0, 0.0, 0.0, 0.0]))
    assert PlanningTask(free, SETTINGS).digest == PlanningTask(other, SETTINGS).digest
    assert PlanningTask(free, SETTINGS).digest != PlanningTask(lemur_capture, SETTINGS).digest


# ---- refusals

REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "axis of zero length": (
        {"orientation": Orientation.ABOUT_AXIS, "free_axis_in_ee": np.zeros(3)},
        r"target\.free_axis is \[0\.0, 0\.0, 0\.0\]: it must be longer than",
    ),
    "axis missing": (
        {"orientation": Orientation.ABOUT_AXIS},
        r"target\.free_axis is missing",
    ),
    "axis not finite": (
        {"orientation": Orientation.ABOUT_AXIS, "free_axis_in_ee": np.array([0, np.nan, 1.0])},
        r"target\.free_axis.*finite",
    ),
    "axis not asked for": (
        {"free_axis_in_ee": AXIS},
        r"target\.free_axis.*where orientation is about_axis",
    ),
    "turn wanted where all are free": (
        {"orientation": Orientation.FREE, "angular_velocity": np.array([0.0, 0.1, 0.0])},
        r"target\.angular_velocity.*with orientation free the turn is free",
    ),
    "turn wanted about the free axis": (
        {
            "orientation": Orientation.ABOUT_AXIS,
            "free_axis_in_ee": AXIS,
            "quaternion_xyzw": np.array([0.0, 0.0, 0.0, 1.0]),
            "angular_velocity": 0.1 * AXIS,
        },
        r"target\.angular_velocity.*the turn about free_axis is free",
    ),
    "acceleration wanted about the free axis": (
        {
            "orientation": Orientation.ABOUT_AXIS,
            "free_axis_in_ee": AXIS,
            "quaternion_xyzw": np.array([0.0, 0.0, 0.0, 1.0]),
            "angular_acceleration": 0.1 * AXIS,
        },
        r"target\.angular_acceleration.*the turn about free_axis is free",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_goal_that_contradicts_itself_is_refused(
    lemur_capture: PlanningProblem, name: str
) -> None:
    changes, message = REFUSED[name]
    with pytest.raises(InvalidInput, match=message):
        replace(lemur_capture.target, **changes)


def test_a_turn_across_the_free_axis_may_be_wanted(lemur_capture: PlanningProblem) -> None:
    across = np.array([0.8, 0.0, -0.6])
    turn = Rotation.from_euler("xyz", [0.3, 0.4, -1.0])
    target = replace(
        lemur_capture.target,
        orientation=Orientation.ABOUT_AXIS,
        free_axis_in_ee=1e99 * AXIS,
        quaternion_xyzw=turn.as_quat(),
        angular_velocity=turn.apply(0.05 * across),
    )
    np.testing.assert_allclose(target.free_axis_in_ee, AXIS, rtol=1e-12)


OFF_THE_PLANE: dict[str, tuple[str, dict[str, Any], str]] = {
    "target above": (
        "target",
        {"position": np.array([1.2, 0.3, 0.2])},
        r"target\.position.*end effector stays at z = 0 m",
    ),
    "target tilted": (
        "target",
        {"quaternion_xyzw": Rotation.from_euler("x", 0.1).as_quat()},
        r"target\.quaternion_xyzw.*turns about z only",
    ),
    "target upside down": (
        "target",
        {"quaternion_xyzw": np.array([1.0, 0.0, 0.0, 0.0])},
        r"target\.quaternion_xyzw.*turns about z only",
    ),
    "target rising": (
        "target",
        {"linear_velocity": np.array([0.0, 0.0, 0.05])},
        r"target\.linear_velocity.*along z it must be zero",
    ),
    "target tumbling": (
        "target",
        {"angular_velocity": np.array([0.0, 0.05, 0.0])},
        r"target\.angular_velocity.*about x and y it must be zero",
    ),
    "free about another axis than the normal": (
        "target",
        {"orientation": Orientation.ABOUT_AXIS, "free_axis_in_ee": np.array([1.0, 0.0, 0.0])},
        r"target\.free_axis.*about the normal of the table only",
    ),
    "chaser tilted": (
        "start",
        {"quaternion_chaser_to_inertial_xyzw": Rotation.from_euler("y", 0.1).as_quat()},
        r"chaser\.quaternion_xyzw.*5\.73 degrees off",
    ),
    "chaser rising": (
        "start",
        {"linear_velocity_chaser_in_inertial": np.array([0.0, 0.0, -0.05])},
        r"chaser\.linear_velocity.*leaves the plane",
    ),
    "chaser tumbling": (
        "start",
        {"angular_velocity_chaser_in_inertial": np.array([0.05, 0.0, 0.01])},
        r"chaser\.angular_velocity.*leaves the plane",
    ),
}


@pytest.mark.parametrize("name", OFF_THE_PLANE)
def test_what_leaves_the_plane_is_refused_in_words(planar: PlanningProblem, name: str) -> None:
    part, changes, message = OFF_THE_PLANE[name]
    with pytest.raises(InvalidInput, match=message):
        replace(planar, **{part: replace(getattr(planar, part), **changes)})


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_target_may_be_off_the_plane_to_no_side(planar: PlanningProblem, sign: float) -> None:
    """By more than a camera is off, whichever way the target goes or leans."""
    target = planar.target
    z = np.array([0.0, 0.0, sign])
    for field, changes in (
        ("position", {"position": target.position + 0.011 * z}),
        ("linear_velocity", {"linear_velocity": 0.011 * z}),
        ("linear_acceleration", {"linear_acceleration": 0.011 * z}),
        *(
            (f"angular_{what}", {f"angular_{what}": 0.011 * sign * axis})
            for what in ("velocity", "acceleration")
            for axis in np.eye(3)[:2]
        ),
        *(
            ("quaternion_xyzw", {"quaternion_xyzw": leaning.as_quat()})
            for leaning in (
                Rotation.from_euler("zx", [2.5, 0.021 * sign]),
                Rotation.from_euler("zy", [-1.0, 0.021 * sign]),
            )
        ),
    ):
        with pytest.raises(InvalidInput, match=f"target.{field}"):
            targeted(planar, **changes)
    kept = targeted(
        planar,
        position=target.position + 0.009 * z,
        quaternion_xyzw=Rotation.from_euler("zx", [2.5, 0.019 * sign]).as_quat(),
        linear_velocity=0.009 * z + [0.01, -0.02, 0.0],
        angular_velocity=np.array([0.006, -0.006, -0.3 * sign]),
    ).target
    assert kept.position.tolist() == [*target.position[:2], 0.0]
    assert kept.linear_velocity.tolist() == [0.01, -0.02, 0.0]
    assert kept.angular_velocity.tolist() == [0.0, 0.0, -0.3 * sign]
    turn = Rotation.from_quat(kept.quaternion_xyzw).as_matrix()
    np.testing.assert_allclose(turn[2], [0.0, 0.0, 1.0], atol=1e-12)
    assert np.arctan2(turn[1, 0], turn[0, 0]) == pytest.approx(2.5, abs=1e-3)


@pytest.mark.parametrize("length", [1e-5, 0.3, 4.0])
def test_a_free_axis_of_any_length_is_one_direction(
    lemur_capture: PlanningProblem, length: float
) -> None:
    free = {"orientation": Orientation.ABOUT_AXIS, "free_axis_in_ee": -length * AXIS}
    axis = targeted(lemur_capture, **free).target.free_axis_in_ee
    np.testing.assert_allclose(axis, -AXIS, rtol=1e-12)


def test_the_normal_of_the_table_is_told_in_the_end_effectors_axes(
    planar: PlanningProblem,
) -> None:
    """An end effector that lies on its side turns about another of its own axes."""
    text = (CONFIG / "robots/planar_testbed/planar_testbed.urdf").read_text()
    hand = '<origin xyz="0.3545 0 0"/>'
    lying = text.replace(hand, hand.replace("/>", ' rpy="1.5707963267948966 0 0"/>'))
    robot = robot_from_urdf_text(lying, "satellite", "end_effector", Base.PLANAR)
    wrong, normal = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])
    about = replace(planar.target, orientation=Orientation.ABOUT_AXIS, free_axis_in_ee=normal)
    for sign in (1.0, -1.0):
        found = replace(planar, robot=robot, target=replace(about, free_axis_in_ee=sign * normal))
        assert found.target.orientation is Orientation.FREE
        assert found.target.free_axis_in_ee is None
        with pytest.raises(InvalidInput, match=r"target\.free_axis.*normal of the table only"):
            replace(planar, robot=robot, target=replace(about, free_axis_in_ee=sign * wrong))


def test_what_a_camera_is_off_by_is_left_out(planar: PlanningProblem) -> None:
    lean = Rotation.from_euler("xyz", [0.01, -0.008, 0.7])
    start = replace(
        planar.start,
        quaternion_chaser_to_inertial_xyzw=lean.as_quat(),
        linear_velocity_chaser_in_inertial=np.array([0.02, 0.01, 0.003]),
        angular_velocity_chaser_in_inertial=np.array([-0.004, 0.004, 0.02]),
    )
    target = replace(planar.target, position=np.array([1.3, 0.4, 0.004]))
    problem = replace(planar, start=start, target=target)
    assert problem.start.quaternion_chaser_to_inertial_xyzw[:2].tolist() == [0.0, 0.0]
    assert problem.start.linear_velocity_chaser_in_inertial.tolist() == [0.02, 0.01, 0.0]
    assert problem.start.angular_velocity_chaser_in_inertial.tolist() == [0.0, 0.0, 0.02]
    assert problem.target.position.tolist() == [1.3, 0.4, 0.0]
    heading = Rotation.from_quat(problem.start.quaternion_chaser_to_inertial_xyzw)
    assert heading.as_euler("xyz")[2] == pytest.approx(0.7, abs=1e-3)


@pytest.mark.parametrize("seed", range(5))
def test_a_target_on_the_table_stays_what_it_is_however_often_it_is_checked(
    planar: PlanningProblem, seed: int
) -> None:
    """Else a task that is written down and read again would be another one."""
    text = (CONFIG / "robots/planar_testbed/planar_testbed.urdf").read_text()
    hand = '<origin xyz="0.3545 0 0"/>'
    assert hand in text
    angles = np.random.default_rng(seed).uniform(-3.0, 3.0, 3)
    turned = hand.replace("/>", f' rpy="{angles[0]} {angles[1]} {angles[2]}"/>')
    robot = robot_from_urdf_text(
        text.replace(hand, turned), "satellite", "end_effector", Base.PLANAR
    )
    tip = ee_pose(robot, configuration(robot, planar.start)[0])
    wanted = Rotation.from_euler("xyz", [0.003 * (seed % 2), 0.0, seed - 2.0])
    target = replace(
        planar.target, quaternion_xyzw=(wanted * Rotation.from_matrix(tip.rotation)).as_quat()
    )
    once = replace(planar, robot=robot, target=target)
    assert PlanningTask(replace(once), SETTINGS).digest == PlanningTask(once, SETTINGS).digest


def table_problem(joints: int, target: Target) -> PlanningProblem:
    rng = np.random.default_rng(0)
    bodies = TESTBED[: joints + 1]
    robot = planar_robot(bodies, rng)
    angles = np.array([0.8, -1.2, 0.6])[:joints]
    start = planar_state(np.zeros(3), np.zeros(3), angles, np.zeros(joints), bodies[0], 0.0)
    height = ee_pose(robot, configuration(robot, start)[0]).translation[2]
    place = np.array([*target.position[:2], height])
    goal = replace(target, position=place)
    return PlanningProblem(robot, start, goal, 10.0, 30, (), Objective(1.0, 0.0))


@pytest.mark.parametrize(
    ("joints", "orientation", "message"),
    [
        (
            1,
            Orientation.FREE,
            r"target\.position.*position \(2\) are 2 conditions, the arm has 1",
        ),
        (2, Orientation.FIXED, r"target\.orientation is fixed: position \(2\) and heading \(1\)"),
    ],
)
def test_a_goal_with_more_conditions_than_joints_is_refused_by_their_names(
    joints: int, orientation: Orientation, message: str
) -> None:
    target = Target([1.0, 0.2, 0.0], [0.0, 0.0, 0.0, 1.0], orientation=orientation)
    with pytest.raises(InvalidInput, match=message) as refused:
        table_problem(joints, target)
    assert refused.value.status is Status.UNSUPPORTED


def test_an_arm_whose_axes_are_parallel_reaches_what_lies_in_its_plane_and_is_told_why_no_other(
    planar: PlanningProblem,
) -> None:
    """Three joints are as many as a position has conditions, but off a table they meet two."""
    table = CONFIG / "robots/planar_testbed/planar_testbed.urdf"
    problem = PlanningProblem(
        robot=load_robot(table, "satellite", "end_effector"),
        start=planar.start,
        target=Target([1.35, 0.5, 0.0], [0.0, 0.0, 0.0, 1.0], orientation=Orientation.FREE),
        duration=planar.duration,
        points=planar.points,
        obstacles=(),
        objective=planar.objective,
    )
    perform(PlanningTask(problem, SETTINGS))
    above = targeted(problem, position=np.array([1.35, 0.5, 0.1]))
    message = r"target\.position.*3 conditions.* no more than 2 of them at once"
    with pytest.raises(InvalidInput, match=message) as refused:
        perform(PlanningTask(above, SETTINGS))
    assert refused.value.status is Status.UNSUPPORTED


@pytest.mark.parametrize("joints", [6, 7, 9])
def test_an_arm_whose_axes_lie_anyhow_meets_every_condition_at_once(joints: int) -> None:
    robot = robot_from_urdf_text(random_urdf(joints, seed=joints), "bus", "tool")
    target = Target(np.zeros(3), [0.0, 0.0, 0.0, 1.0])
    assert steered(robot, target) == 6
    free = replace(target, orientation=Orientation.ABOUT_AXIS, free_axis_in_ee=AXIS)
    assert steered(robot, free) == 5


# ---- plans


@pytest.mark.parametrize("orientation", [Orientation.FIXED, Orientation.FREE])
def test_on_the_table_a_plan_reaches_position_and_heading(
    planar: PlanningProblem, orientation: Orientation
) -> None:
    obstacles = (Obstacle.sphere("post", [1.30, 0.12, 0.0], 0.06),)
    problem = replace(targeted(planar, orientation=orientation), obstacles=obstacles)
    found = planned(problem)
    np.testing.assert_allclose(
        found.trajectory.ee_positions[-1], planar.target.position, rtol=0.0, atol=1e-3
    )
    np.testing.assert_allclose(
        found.trajectory.ee_linear_velocities[-1], planar.target.linear_velocity, atol=1e-3
    )
    assert (found.trajectory.chaser_positions[:, 2] == 0.0).all()
    off = Rotation.from_quat(found.trajectory.ee_quaternions_xyzw[-1]).inv() * Rotation.from_quat(
        planar.target.quaternion_xyzw
    )
    if orientation is Orientation.FIXED:
        assert off.magnitude() < 1e-3
    else:
        assert found.metrics.final_orientation_error == 0.0
        assert off.magnitude() > 0.05  # else it was not free


def test_two_joints_reach_a_position_on_the_table() -> None:
    target = Target([1.05, 0.35, 0.0], [0.0, 0.0, 0.0, 1.0], orientation=Orientation.FREE)
    problem = table_problem(2, target)
    found = planned(problem)
    assert found.metrics.final_position_error < 1e-3


def test_about_an_axis_a_plan_points_the_axis(lemur_capture: PlanningProblem) -> None:
    problem = targeted(
        lemur_capture,
        orientation=Orientation.ABOUT_AXIS,
        free_axis_in_ee=np.array([0.0, 0.0, 1.0]),
        quaternion_xyzw=lemur_capture.target.quaternion_xyzw,
    )
    found = planned(problem)
    reached = Rotation.from_quat(found.trajectory.ee_quaternions_xyzw[-1])
    wanted = Rotation.from_quat(lemur_capture.target.quaternion_xyzw)
    z = np.array([0.0, 0.0, 1.0])
    assert np.arccos(np.clip(reached.apply(z) @ wanted.apply(z), -1, 1)) < 1e-3
    assert found.metrics.joint_path_length < 1.107  # that of the whole pose


def test_a_plan_that_leaves_the_plane_does_not_pass_the_check(planar: PlanningProblem) -> None:
    found = perform(PlanningTask(planar, SETTINGS))
    lifted = found.trajectory.chaser_positions.copy()
    lifted[20, 2] += 2e-3
    motion = replace(found.trajectory, chaser_positions=lifted)
    findings = [
        one.finding for one in failures(planar, replace(found, trajectory=motion), SETTINGS)
    ]
    assert any(re.search(r"leaves the plane.*0\.002 m", finding) for finding in findings)
    assert not list(failures(planar, found, SETTINGS))


@pytest.mark.parametrize(
    ("orientation", "count"),
    [(Orientation.FIXED, 6), (Orientation.ABOUT_AXIS, 5), (Orientation.FREE, 3)],
)
def test_each_kind_of_goal_has_so_many_conditions(
    lemur_capture: PlanningProblem, orientation: Orientation, count: int
) -> None:
    axis = AXIS if orientation is Orientation.ABOUT_AXIS else None
    target = replace(lemur_capture.target, orientation=orientation, free_axis_in_ee=axis)
    assert sum(conditions_of(lemur_capture.robot, target).values()) == count
    assert steered(lemur_capture.robot, target) == count
