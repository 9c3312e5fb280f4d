"""Contacts in MuJoCo: told where bodies touch by the books, and nowhere else."""

from __future__ import annotations

from dataclasses import replace

import coal
import mujoco
import numpy as np
import pinocchio as pin
import pytest
from bodied_robots import random_obstacles
from near_bodies import distances_from
from straight_arms import straight_arm
from test_body_distances import configurations, every_row

from ff_planner_benchmark.bench.touching import touching
from ff_planner_ros.commands.verify import print_verdict
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.distance.bodies import placed_bodies
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.planning.problem.problem import (
    Obstacle,
    PlanningProblem,
    RigidMotion,
    Target,
)
from ff_planner_ros.planning.problem.scene import Scene
from ff_planner_ros.planning.search.planner import plan
from ff_planner_ros.problems import bodies
from ff_planner_ros.problems.robots import bench_robot
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.collision.lines import with_bodies
from ff_planner_ros.robot.collision.solids import Solid
from ff_planner_ros.robot.model import Robot, robot_from_urdf_text
from ff_planner_ros.simulation.contacts import Contact, Touch, _cone
from ff_planner_ros.simulation.verification import verify

# What the surface of each solid is away from its centre along its x axis: 0.5 m.
SOLIDS = {
    "box": '<box size="1 0.4 0.4"/>',
    "cylinder": '<cylinder radius="0.5" length="2"/>',
    "capsule": '<capsule radius="0.5" length="2"/>',
    "sphere": '<sphere radius="0.5"/>',
}
INERTIAL = (
    '<inertial><mass value="50"/><inertia ixx="9" iyy="9" izz="9" ixy="0" ixz="0" iyz="0"/>'
    "</inertial>"
)


def bus_with(solid: str, world: str = "bus") -> Robot:
    """A solid that is shifted and turned on a bus: its x axis is y of the bus."""
    origin = '<origin xyz="0.3 -0.2 0.1" rpy="0 0 1.5707963267948966"/>'
    return robot_from_urdf_text(
        f'<robot name="bus"><link name="{world}">{INERTIAL}<collision>{origin}'
        f'<geometry>{solid}</geometry></collision></link><link name="arm">{INERTIAL}'
        '<collision><geometry><sphere radius="0.1"/></geometry></collision></link>'
        f'<joint name="joint" type="revolute"><parent link="{world}"/><child link="arm"/>'
        '<origin xyz="0 0 2"/><axis xyz="0 1 0"/>'
        '<limit lower="-3" upper="3" velocity="1" effort="9"/></joint></robot>'
    )


def depths(engine: Touch, q: Array, time: float = 0.0) -> dict[str, float]:
    """The depth of each pair that touches in one of MuJoCo's configurations."""
    return {one.pair: one.depth for one in engine.along([q], np.array([time]))}


def touch(robot: Robot, *spheres: Obstacle, time: float = 0.0) -> dict[str, float]:
    stretched = np.concatenate([[0, 0, 0, 1, 0, 0, 0], np.zeros(robot.joints)])
    return depths(Touch(robot, Scene(spheres)), stretched, time)


def by_hull(robot: Robot) -> Robot:
    """The same with the hull of a box's corners instead of each solid."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.2, 0.2) for z in (-0.2, 0.2)])
    # Corners inside a hull are none of it.
    cloud = coal.BVHModelOBBRSS()
    cloud.beginModel(0, 9)
    cloud.addVertices(np.vstack([corners, [[0.1, 0.1, 0.1]]]))
    cloud.endModel()
    cloud.buildConvexHull(True, "Qt")
    bus, arm = robot.bodies
    return replace(robot, bodies=(replace(bus, solid=cloud.convex), arm))


@pytest.mark.parametrize("shape", [*SOLIDS, "hull"])
def test_depth_is_that_of_the_books(shape: str) -> None:
    robot = by_hull(bus_with(SOLIDS["box"])) if shape == "hull" else bus_with(SOLIDS[shape])
    for depth in (-0.01, -0.001, 0.001, 0.05):
        center = np.array([0.3, -0.2 + 0.5 + 0.25 - depth, 0.1])
        found = touch(robot, Obstacle.sphere("ball", center, 0.25))
        if depth < 0.0:
            assert found == {}, (shape, depth)
        else:
            assert found == {"bus/ball": pytest.approx(depth, abs=1e-5)}


def test_a_moving_obstacle_is_where_it_is_then() -> None:
    robot = bus_with(SOLIDS["sphere"])
    ball = Obstacle.sphere("ball", np.array([0.3, 2.0, 0.1]), 0.2, np.array([0.0, -0.5, 0.0]))
    assert touch(robot, ball, time=2.9) == {}
    # Centres 2.2 m apart at first, 0.7 m when they touch: after 3 s.
    assert touch(robot, ball, time=3.1) == {"bus/ball": pytest.approx(0.05, abs=1e-6)}


def test_a_link_may_be_called_as_mujoco_calls_the_universe() -> None:
    ball = Obstacle.sphere("ball", np.array([0.3, 0.4, 0.1]), 0.2)
    assert touch(bus_with(SOLIDS["sphere"], "world"), ball) == {"world/ball": pytest.approx(0.1)}


def test_bodies_that_may_touch_all_others_are_no_hindrance() -> None:
    assert touch(bus_with(SOLIDS["box"])) == {}


def test_bodies_touch_where_coal_says_so_and_nothing_else_is_told() -> None:
    robot = bench_robot("arm6", Geometry.SHAPES)
    rng = np.random.default_rng(1)
    data, engine = robot.model.createData(), Touch(robot, Scene())
    touched = 0
    for _ in range(300):
        joints = rng.uniform(robot.lower_position_limits, robot.upper_position_limits)
        base = rng.normal(size=7)
        base[3:] /= np.linalg.norm(base[3:])
        pin.forwardKinematics(robot.model, data, np.concatenate([base, joints]))
        truth = {}
        for first, second in robot.pairs:
            one, other = robot.bodies[first], robot.bodies[second]
            places = [data.oMi[body.joint] * body.placement_in_joint for body in (one, other)]
            at_one, at_other = (coal.Transform3s(p.rotation, p.translation) for p in places)
            request, result = coal.DistanceRequest(), coal.DistanceResult()
            gap = coal.distance(one.solid, at_one, other.solid, at_other, request, result)
            if abs(gap) > 1e-4:
                truth[f"{one.name}/{other.name}"] = gap < 0.0
        in_mujoco = np.concatenate([base[:3], base[[6, 3, 4, 5]], joints])
        found = depths(engine, in_mujoco)
        assert {pair for pair in found if pair in truth} == {p for p, deep in truth.items() if deep}
        touched += bool(found)
    assert 50 < touched < 250


@pytest.mark.parametrize("geometry", Geometry)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_obstacles_of_any_shape_are_in_mujoco_as_coal_measures_them(
    seed: int, geometry: Geometry
) -> None:
    """Distances of ten to thirty obstacles from an arm's bodies, at rest, moving and tumbling."""
    of_geometry, rng = bench_robot("arm6", geometry), np.random.default_rng(seed)
    robot = with_bodies(of_geometry)
    (q,) = configurations(robot, 1, seed)
    time = np.array([1.7])
    obstacles = random_obstacles(rng, q[:3], 15)
    engine, touching_pairs = Touch(of_geometry, Scene(obstacles)), set()
    in_mujoco = np.concatenate([q[:3], q[[6, 3, 4, 5]], q[7:]])
    deep = depths(engine, in_mujoco, float(time[0]))
    placed = placed_bodies(robot, q[None, 7:])
    rows = every_row(1, len(robot.bodies), 15)
    found = distances_from(robot, placed, q[None], time, obstacles, rows).distance
    model, data = engine._model, engine._data
    seen = 0
    for _, body, number, distance in zip(*rows, found, strict=True):
        one, name = obstacles[number], f"{robot.bodies[body].name}/{obstacles[number].id}"
        geoms = model.geom(f"body {body}").id, model.geom(f"obstacle {number}").id
        by_mujoco = mujoco.mj_geomDistance(model, data, *geoms, 50.0, np.zeros(6))
        if distance > 0.0:
            # The pyramid is in its cone, by half a tenth of a millimetre.
            exact = 2e-5 + (5e-5 if one.solid.kind == "cone" else 0.0)
            assert by_mujoco == pytest.approx(distance, abs=exact), (name, one.solid.kind)
            seen += 1
        if abs(distance) > 1e-3:
            touching_pairs |= {name} if distance < 0.0 else set()
            assert (name in deep) == (distance < 0.0), (name, distance)
    assert seen > 20
    assert touching_pairs or (geometry, seed) != (Geometry.SHAPES, 1)


@pytest.fixture(scope="module")
def planned() -> tuple[PlanningProblem, Trajectory]:
    """A plan of the six-joint arm's lines; its links touch two spheres."""
    problem = bodies.problem("arm6", 0).problem
    as_lines = replace(problem, robot=bench_robot("arm6"))
    return problem, plan(as_lines, load_parameters().planner).trajectory


def test_a_plan_of_lines_fails_by_the_contacts_of_its_bodies(
    planned: tuple[PlanningProblem, Trajectory],
) -> None:
    """Those that Coal finds a thousand times a second, and as deep."""
    problem, motion = planned
    found = verify(problem.robot, motion, Scene(problem.obstacles))
    assert found.came_true
    assert not found.passed
    assert found.pairs == len(problem.robot.pairs) + len(problem.robot.bodies) * len(
        problem.obstacles
    )
    assert {one.pair for one in found.contacts} == touching(
        problem.robot, motion, problem.obstacles
    )
    assert [one.first_time for one in found.contacts] == sorted(
        one.first_time for one in found.contacts
    )
    for one in found.contacts:
        assert 0.0 <= one.first_time <= one.time <= problem.duration
        assert one.depth > 0.0


def test_a_line_touches_a_sphere_by_as_much_as_geometry_says() -> None:
    """And an obstacle of another shape through which it passes, however thin the line is."""
    robot = straight_arm(0.4, 1.0, 0.6)
    beside = Obstacle.sphere("beside", np.array([0.9, 0.06, 0.0]), 0.1)
    box = Obstacle(
        "box", Solid("box", np.array([0.2, 0.2, 0.3])), RigidMotion(np.array([1.7, 0.08, 0.0]))
    )
    away = Obstacle.sphere("away", np.array([0.9, 0.2, 0.0]), 0.19)
    stretched = np.concatenate([[0, 0, 0, 1, 0, 0, 0], np.zeros(2)])
    found = depths(Touch(robot, Scene((beside, away, box))), stretched)
    assert found == {
        "joint_1-joint_2/beside": pytest.approx(0.04, abs=1e-5),
        "joint_2-tip/box": pytest.approx(0.02, abs=1e-5),
    }


@pytest.mark.parametrize("radius", [1e-3, 0.2, 1.5, 20.0])
def test_the_pyramid_that_stands_for_a_cone_is_hardly_thinner(radius: float) -> None:
    """By less than a tenth of a millimetre, in the middle between two corners of its rim."""
    *rim, apex = _cone(coal.Cone(radius, 0.6))
    assert apex == pytest.approx([0.0, 0.0, 0.3])
    assert np.linalg.norm(np.array(rim)[:, :2], axis=1) == pytest.approx(radius)
    middles = (np.array(rim) + np.roll(rim, 1, axis=0)) / 2
    assert 0.0 <= radius - np.linalg.norm(middles[:, :2], axis=1).min() < 1e-4


def test_contacts_do_not_push_and_lines_keep_clear_of_what_they_were_planned_among(
    planned: tuple[PlanningProblem, Trajectory],
) -> None:
    problem, motion = planned
    with_bodies = verify(problem.robot, motion, Scene(problem.obstacles))
    with_lines = verify(bench_robot("arm6"), motion, Scene(problem.obstacles))
    assert with_lines.passed
    assert with_lines.contacts == ()
    assert with_lines.deviation == with_bodies.deviation
    assert np.array_equal(with_lines.execution.momentum, with_bodies.execution.momentum)


def test_contacts_are_the_same_from_any_frame_that_drifts(
    planned: tuple[PlanningProblem, Trajectory],
) -> None:
    """A thousand kilometres away and at orbital speed, obstacles too: the same pairs and depths."""
    problem, motion = planned
    away, speed = np.array([1e6, -2e6, 3e5]), np.array([7e3, 100.0, -50.0])
    way = motion.time[:, None] * speed + away
    there = replace(
        motion,
        chaser_positions=motion.chaser_positions + way,
        chaser_linear_velocities=motion.chaser_linear_velocities + speed,
        ee_positions=motion.ee_positions + way,
        ee_linear_velocities=motion.ee_linear_velocities + speed,
    )
    spheres = [s.with_motion(position=s.center + away, velocity=speed) for s in problem.obstacles]
    here = verify(problem.robot, motion, Scene(problem.obstacles)).contacts
    for one, other in zip(here, verify(problem.robot, there, Scene(spheres)).contacts, strict=True):
        assert one.pair == other.pair
        assert other.first_time == pytest.approx(one.first_time, abs=1e-6)
        assert other.depth == pytest.approx(one.depth, abs=1e-6)


def test_the_verdict_names_the_first_contact(
    planned: tuple[PlanningProblem, Trajectory], capsys: pytest.CaptureFixture[str]
) -> None:
    problem, motion = planned
    assert not print_verdict("plan", problem.robot, motion, False, Scene(problem.obstacles))
    shown = capsys.readouterr().out
    first = verify(problem.robot, motion, Scene(problem.obstacles)).contacts[0]
    assert f"{first.pair} " in shown
    assert f"failed: {first.pair} touch at {first.first_time:.3f} s" in shown
    assert print_verdict("plan", bench_robot("arm6"), motion, False, Scene(problem.obstacles))
    lines = with_bodies(bench_robot("arm6")).bodies
    words = f"contacts: none of {len(lines) * len(problem.obstacles)} pairs of lines and obstacles"
    assert words in capsys.readouterr().out


def test_unknown_obstacles_are_told(
    planned: tuple[PlanningProblem, Trajectory], capsys: pytest.CaptureFixture[str]
) -> None:
    problem, motion = planned
    print_verdict("plan", problem.robot, motion, False, None)
    assert "but the obstacles are not known" in capsys.readouterr().out


def test_what_is_grasped_may_be_touched_near_the_goal_and_only_there(
    planned: tuple[PlanningProblem, Trajectory],
) -> None:
    """The tool's box is 12 cm long and ends in the end effector's frame."""
    problem, motion = planned
    goal, radius = motion.ee_positions[-1], 0.05
    grasped = Obstacle.sphere("grasped", goal, radius)
    way = np.linalg.norm(motion.ee_positions - goal, axis=1)

    def seen(distance: float, *allowed: str) -> dict[str, Contact]:
        scene = Scene((grasped,), allowed, distance, Target(goal, [0.0, 0.0, 0.0, 1.0]))
        found = verify(problem.robot, motion, scene).contacts
        return {one.pair: one for one in found if one.pair.endswith("grasped")}

    (touched,) = seen(1.0)
    assert touched == "end_effector/grasped"
    assert seen(0.15, "end_effector/grasped") == {}
    assert seen(0.15, "grasped/end_effector") == {}
    assert seen(0.15, "link_6/grasped").keys() == {touched}
    early = seen(0.02, "end_effector/grasped")[touched]
    assert early.first_time == seen(1.0)[touched].first_time
    assert np.interp(early.time, motion.time, way) == pytest.approx(0.02, abs=1e-3)
    assert seen(1.0)[touched].time > early.time
