"""The laws of the scenario generator, checked with formulas of their own."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from robots import LEMUR_SCENARIO

from ff_planner_benchmark.problems import classes
from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.planning.distance.clearance import arm_points
from ff_planner_ros.planning.problem.obstacles import Obstacle, RigidMotion
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.problems import scenarios
from ff_planner_ros.problems.drawn import first_sound
from ff_planner_ros.problems.paths import roll_out
from ff_planner_ros.problems.robots import ROBOTS, arm_urdf, bench_robot
from ff_planner_ros.problems.scenarios import KINDS, SINGULAR_VALUE_BOUND, scenario
from ff_planner_ros.problems.twin import seen_from
from ff_planner_ros.robot.collision.solids import Solid
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.momentum import generalised_jacobian, smallest_singular_values

FINE = 250
STRAIGHT = np.zeros((6, 3))
# Each class has its own number of spheres and clearance, and hits: at least so many, so deep.
LAWS = {"ordinary": (3, 6, 0.02, 1, 0.0), "cluttered": (9, 14, 0.01, 2, 0.04)}

every_scenario = pytest.mark.parametrize(
    ("kind", "robot", "number", "turned"),
    [
        (kind, robot, number, turned)
        for kind in LAWS
        for robot in ROBOTS
        for number in range(2)
        for turned in (False, True)
    ],
)


@pytest.fixture(scope="module")
def lemur_capture():
    return load_scenario(LEMUR_SCENARIO)


def distances(problem, coefficients, points):
    """Each sphere's distance from the arm's centre lines, by sampling these."""
    motion = roll_out(problem, coefficients, points)
    positions = arm_points(problem.robot, np.concatenate([motion.q, motion.q_half_way]))
    along = np.linspace(0.0, 1.0, 150)[:, None, None, None]
    line = (1.0 - along) * positions[:, :-1] + along * positions[:, 1:]
    return np.array(
        [np.linalg.norm(line - s.center, axis=-1).min() - s.radius for s in problem.obstacles]
    )


@every_scenario
def test_the_witness_keeps_what_its_class_promises(kind, robot, number, turned):
    drawn = scenario(kind, robot, number, turned=turned)
    fewest, most, clearance, _, _ = LAWS[kind]
    problem, model = drawn.problem, drawn.problem.robot
    motion = roll_out(problem, drawn.witness, FINE)
    joints, rates = motion.q[:, 7:], np.abs(motion.v[:, 6:])
    assert fewest <= len(problem.obstacles) <= most
    assert (joints >= model.lower_position_limits - 1e-6).all()
    assert (joints <= model.upper_position_limits + 1e-6).all()
    assert (rates <= 1.001 * model.velocity_limits).all()  # kept at 50 points, checked at 250
    assert smallest_singular_values(model, motion.q).min() > 0.99 * SINGULAR_VALUE_BOUND
    assert distances(problem, drawn.witness, FINE).min() >= clearance


@every_scenario
def test_the_witness_leads_to_the_target(kind, robot, number, turned):
    drawn = scenario(kind, robot, number, turned=turned)
    model, target = drawn.problem.robot, drawn.problem.target
    data = model.model.createData()
    pin.forwardKinematics(model.model, data, roll_out(drawn.problem, drawn.witness, FINE).q[-1])
    tip = pin.updateFramePlacement(model.model, data, model.tip_frame_id)
    wanted = pin.Quaternion(target.quaternion_xyzw).toRotationMatrix()
    np.testing.assert_allclose(tip.translation, target.position, atol=1e-5)
    np.testing.assert_allclose(tip.rotation, wanted, atol=1e-5)


@every_scenario
def test_the_straight_path_hits_what_its_class_promises(kind, robot, number, turned):
    """At the problem's own points: near a singularity, where it may come, these matter."""
    problem = scenario(kind, robot, number, turned=turned).problem
    _, _, _, hit, depth = LAWS[kind]
    assert (distances(problem, STRAIGHT, problem.points) < 1e-4 - depth).sum() >= hit


@every_scenario
def test_the_start_moves_as_the_paper_lets_it(kind, robot, number, turned):
    """Slow enough, and with joint rates that Eq. (31) can give: in the row space of J_D."""
    problem = scenario(kind, robot, number, turned=turned).problem
    start, model = problem.start, problem.robot
    assert np.linalg.norm(start.linear_velocity_chaser_in_inertial) <= 0.06
    assert np.linalg.norm(start.angular_velocity_chaser_in_inertial) <= np.deg2rad(3.0)
    q, _ = configuration(model, start)
    jacobian = generalised_jacobian(model, model.model.createData(), q)
    outside = start.joint_velocities - np.linalg.pinv(jacobian) @ jacobian @ start.joint_velocities
    np.testing.assert_allclose(outside, 0.0, atol=1e-9)
    assert np.linalg.norm(start.joint_velocities) > 1e-3


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("robot", ROBOTS)
def test_twins_are_the_same_physics_in_two_frames(kind, robot):
    first, twin = (scenario(kind, robot, 0, turned=turned).problem for turned in (False, True))

    def seen_by_the_chaser(problem):
        start, target = problem.start, problem.target
        to_inertial = pin.Quaternion(start.quaternion_chaser_to_inertial_xyzw).toRotationMatrix()
        points = [target.position, *(sphere.center for sphere in problem.obstacles)]
        return [
            (np.array(points) - start.position_chaser_in_inertial) @ to_inertial,
            start.linear_velocity_chaser_in_inertial @ to_inertial,
            start.angular_velocity_chaser_in_inertial @ to_inertial,
            to_inertial.T @ pin.Quaternion(target.quaternion_xyzw).toRotationMatrix(),
            start.joint_positions,
            start.joint_velocities,
            [sphere.radius for sphere in problem.obstacles],
            problem.duration,
        ]

    for here, there in zip(seen_by_the_chaser(first), seen_by_the_chaser(twin), strict=True):
        np.testing.assert_allclose(here, there, atol=1e-12)
    between = pin.Quaternion(first.start.quaternion_chaser_to_inertial_xyzw).angularDistance(
        pin.Quaternion(twin.start.quaternion_chaser_to_inertial_xyzw)
    )
    assert between > 0.1


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("robot", ROBOTS)
def test_the_witnesses_of_twins_are_nearly_the_same_joint_path(kind, robot):
    """Not exactly: the twin's orientation is a polynomial in another reading of the angles."""
    paths = [
        roll_out(drawn.problem, drawn.witness).q[:, 7:]
        for drawn in (scenario(kind, robot, 0, turned=turned) for turned in (False, True))
    ]
    assert np.abs(paths[0] - paths[1]).max() < 0.1 * np.ptp(paths[0], axis=0).max()


def test_an_obstacle_of_any_shape_is_in_the_same_place_of_the_twin(lemur_capture):
    box = Obstacle(
        "box",
        Solid("box", np.array([0.2, 0.3, 0.4])),
        RigidMotion(
            position=[1.0, 2.0, 3.0], velocity=[0.1, -0.2, 0.3], angular_velocity=[0.4, 0.5, -0.6]
        ),
    )
    ball = Obstacle.sphere("ball", [3.0, 2.0, 1.0], 0.1, [0.3, -0.2, 0.1])
    problem = replace(lemur_capture, obstacles=(ball, box))
    frame, velocity = pin.SE3(pin.exp3(np.array([0.3, -0.7, 1.1])), np.array([5.0, 6.0, 7.0])), 0.5
    there, turned = seen_from(problem, frame, np.full(3, velocity)).obstacles
    assert there.id == "ball"
    times = np.array([0.0, 4.0])
    rotations, places = box.motion.poses(times)
    seen_rotations, seen_places = turned.motion.poses(times)
    moved = places @ frame.rotation.T + frame.translation + velocity * times[:, None]
    np.testing.assert_allclose(seen_places, moved, atol=1e-12)
    np.testing.assert_allclose(seen_rotations, frame.rotation @ rotations, atol=1e-12)


def test_the_same_arguments_give_the_same_scenario_and_others_another():
    def numbers(kind="ordinary", robot="lemur", number=0):
        scenarios._twins.cache_clear()
        drawn = scenario(kind, robot, number, turned=True)
        return np.concatenate([drawn.problem.start.joint_positions, drawn.witness.ravel()])

    np.testing.assert_array_equal(numbers(), numbers())
    for other in ({"kind": "cluttered"}, {"robot": "arm7"}, {"number": 1}):
        assert not np.array_equal(numbers(), numbers(**other))


@pytest.mark.parametrize("joints", [6, 7, 8, 9])
def test_generated_arms_have_the_joints_and_the_length_that_they_shall(joints):
    robot = bench_robot(f"arm{joints}")
    points = arm_points(robot, pin.neutral(robot.model)[None])[0]
    assert robot.joints == joints == arm_urdf(joints).count('"revolute"')
    assert np.linalg.norm(points[-1] - points[0]) == pytest.approx(3.0, abs=0.1)


def test_a_class_without_a_sound_draw_is_refused():
    """Every class draws this way: what none of so many draws gives was drawn for ever."""
    draws = iter([None, None, "sound", None, None, None])
    assert first_sound("a class", "arm6", lambda: next(draws), 3) == "sound"
    none = "robot is arm6: of 3 problems of kind a class that were drawn for it none has a plan"
    with pytest.raises(InvalidInput, match=none):
        first_sound("a class", "arm6", lambda: next(draws), 3)
    assert not [
        path
        for package in (scenarios, classes)
        for path in Path(package.__file__).parent.glob("*.py")
        if "while True" in path.read_text(encoding="utf-8")
    ]
