"""Forces of the artificial potential field against the potential itself, and its parameters."""

from dataclasses import fields, replace
from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest
import yaml
from robots import CONFIG, random_state

from ff_planner_ros.baselines.potential_field import (
    PotentialFieldParameters,
    attraction,
    load_parameters,
    repulsion,
)
from ff_planner_ros.common.declared import declared_by_name
from ff_planner_ros.core.velocity_map import velocity
from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.planning.problem.problem import Objective, Obstacle, PlanningProblem, Target
from ff_planner_ros.robot.configuration import configuration

FILE = CONFIG / "baselines.yaml"
FIELD = load_parameters(FILE)
BLOCK = yaml.safe_load(FILE.read_text())["artificial_potential_field"]


def joint_origins(robot, q):
    """Joint origins and end effector, by a forward kinematics of its own call."""
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, q)
    points = [data.oMi[k].translation.copy() for k in range(2, robot.model.njoints)]
    return [*points, data.oMf[robot.tip_frame_id].translation.copy()]


def yukawa(robot, q, spheres, field):
    """Sum over links and spheres of g exp(-decay d) / d, Born's approximation, written out."""
    total = 0.0
    points = joint_origins(robot, q)
    for a, b in pairwise(points):
        length = np.linalg.norm(b - a)
        if length < 1e-6:
            continue
        for sphere in spheres:
            along = np.clip((sphere.center - a) @ (b - a) / length, 0.0, length)
            distance = np.linalg.norm(a + along * (b - a) / length - sphere.center) - sphere.radius
            total += field.repulsion * np.exp(-field.decay * distance) / distance
    return total


def motion_by_twist(robot, q):
    """Velocity per end-effector twist with least joint rates and no momentum, by least squares."""
    data = robot.model.createData()
    momentum = pin.crba(robot.model, data, q)[:6]
    jacobian = pin.computeFrameJacobian(
        robot.model, data, q, robot.tip_frame_id, pin.LOCAL_WORLD_ALIGNED
    )
    base_by_joints = np.vstack(
        [-np.linalg.inv(momentum[:, :6]) @ momentum[:, 6:], np.eye(robot.joints)]
    )
    return base_by_joints @ np.linalg.pinv(jacobian @ base_by_joints)


def problem_with(robot, state, spheres):
    target = Target(np.ones(3), np.array([0.0, 0.0, 0.0, 1.0]))
    return PlanningProblem(robot, state, target, 10.0, 50, tuple(spheres), Objective(1.0, 0.0))


def spheres_near(robot, q, rng):
    """One beside each of four links, none touching the arm."""
    points = joint_origins(robot, q)
    spheres = []
    while len(spheres) < 4:
        center = points[rng.integers(len(points))] + rng.normal(scale=0.3, size=3)
        sphere = Obstacle.sphere(f"s{len(spheres)}", center, 0.05)
        if nearest(points, center) > 0.1:
            spheres.append(sphere)
    return spheres


def nearest(points, center):
    """Distance of a centre from the arm, by sampling."""
    along = np.linspace(0.0, 1.0, 200)[:, None]
    return min(
        np.linalg.norm(a + along * (b - a) - center, axis=1).min() for a, b in pairwise(points)
    )


@pytest.mark.parametrize("seed", range(5))
def test_the_repulsion_is_the_fall_of_the_potential_along_the_motion_of_eq_31(robot, seed):
    rng = np.random.default_rng(seed)
    state = random_state(robot, rng)
    q, _ = configuration(robot, state)
    spheres = spheres_near(robot, q, rng)
    by_twist = motion_by_twist(robot, q)
    field = replace(FIELD, decay=5.0, smallest_distance=1e-4)
    step = 1e-6
    expected = [
        -(
            yukawa(robot, pin.integrate(robot.model, q, step * column), spheres, field)
            - yukawa(robot, pin.integrate(robot.model, q, -step * column), spheres, field)
        )
        / (2 * step)
        for column in by_twist.T
    ]
    # The map of the planner's own rollout, as the method uses it.
    solution = velocity(robot, q, np.zeros(6), np.zeros(6))
    force, distance = repulsion(
        problem_with(robot, state, spheres), field, 0.0, q, solution.by_twist
    )
    assert force == pytest.approx(expected, rel=1e-5, abs=1e-6 * np.abs(expected).max())
    assert distance.min() > 0.04


def test_nearer_than_the_smallest_distance_the_repulsion_grows_no_more(lemur_capture):
    """Straight through a sphere: outside it grows, inside it stays what it is at the bound."""
    robot = lemur_capture.robot
    q, _ = configuration(robot, lemur_capture.start)
    tip = joint_origins(robot, q)[-1]
    by_twist = motion_by_twist(robot, q)

    def strength(gap):
        sphere = Obstacle.sphere("s", tip + np.array([0.3 + gap, 0.0, -0.001]), 0.3)
        force, _ = repulsion(replace(lemur_capture, obstacles=(sphere,)), FIELD, 0.0, q, by_twist)
        return np.linalg.norm(force[:3])

    assert strength(0.1) < strength(0.05) < strength(0.02) < strength(0.011)
    # g exp(-decay d) (1 + decay d) / d^2 for d = 1 cm; the forearm meets the sphere at the tip.
    bound = 0.0025 * np.exp(-0.2) * 1.2 / 1e-4
    assert strength(0.008) == pytest.approx(bound, rel=0.01)
    assert strength(-0.05) == pytest.approx(bound, rel=0.01)


def test_without_obstacles_nothing_repels(lemur_capture):
    q, _ = configuration(lemur_capture.robot, lemur_capture.start)
    free = replace(lemur_capture, obstacles=())
    force, distance = repulsion(free, FIELD, 0.0, q, motion_by_twist(free.robot, q))
    assert np.array_equal(force, np.zeros(6))
    assert distance.size == 0


@pytest.mark.parametrize("seed", range(5))
def test_the_attraction_has_constant_magnitude_and_points_to_the_goal(seed):
    rng = np.random.default_rng(seed)
    way, turn = rng.normal(size=3), rng.normal(size=3)
    for far in (1.0, 2.0, 50.0):
        offset = np.concatenate([way * far / np.linalg.norm(way), turn])
        pull = attraction(offset, FIELD)
        assert pull[:3] == pytest.approx(FIELD.attraction * way / np.linalg.norm(way))
        assert pull[3:] == pytest.approx(FIELD.angular_attraction * turn / np.linalg.norm(turn))


def test_close_to_the_goal_the_attraction_is_a_spring_that_the_damping_makes_critical():
    """Critical: damping^2 = 4 stiffness. The two laws meet without a jump."""
    stiffness = FIELD.damping**2 / 4
    near = 0.5 * FIELD.attraction / stiffness
    pull = attraction(np.array([near, 0.0, 0.0, 0.0, 1e-3, 0.0]), FIELD)
    assert pull == pytest.approx([stiffness * near, 0.0, 0.0, 0.0, stiffness * 1e-3, 0.0])
    edge = np.array([FIELD.attraction / stiffness, 0, 0, 0, 0, 0])
    assert attraction(edge * (1 - 1e-9), FIELD) == pytest.approx(attraction(edge * 1.1, FIELD))
    assert np.array_equal(attraction(np.zeros(6), FIELD), np.zeros(6))


def test_the_parameters_are_those_of_the_file():
    assert {item.name: getattr(FIELD, item.name) for item in fields(FIELD)} == BLOCK


@pytest.mark.parametrize("name", BLOCK)
def test_a_parameter_out_of_its_range_is_refused_by_name(name):
    smallest = declared_by_name(PotentialFieldParameters)[name].form.schema()["minimum"]
    assert getattr(replace(FIELD, **{name: smallest}), name) == smallest
    for value in (smallest - 1.0, float("nan"), "strong"):
        with pytest.raises(InvalidInput, match=rf"artificial_potential_field\.{name} is "):
            replace(FIELD, **{name: value})


@pytest.mark.parametrize(
    ("found", "instead", "message"),
    [
        ("artificial_potential_field:", "apf:", "apf is unknown"),
        ("  decay:", "  decya:", "artificial_potential_field.decya is unknown"),
        ("  decay: 20.0 ", "#", "artificial_potential_field.decay is missing"),
        (
            "damping: 4.0",
            "damping: 0.0",
            "artificial_potential_field.damping is 0.0: it must be at",
        ),
    ],
)
def test_a_file_with_a_fault_is_refused_by_name(tmp_path, found, instead, message):
    text = FILE.read_text()
    assert found in text
    path = tmp_path / "baselines.yaml"
    path.write_text(text.replace(found, instead))
    with pytest.raises(InvalidInput) as refusal:
        load_parameters(path)
    assert str(refusal.value).startswith(message)


def test_every_parameter_says_what_it_means():
    for one in declared_by_name(PotentialFieldParameters).values():
        assert len(one.sentence) > 5
        assert one.unit
