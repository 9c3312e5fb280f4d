"""Capture of a body that tumbles: plans against the body as an independent engine moves it."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import reference_clearance
import yaml
from core_rows import certified_by_core, distances_of_core
from near_bodies import certified_clearance
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from test_any_frame import FRAMES, Frame

from ff_planner_benchmark.problems import tumbling
from ff_planner_ros.analysis.plan_document import plan_document
from ff_planner_ros.analysis.plan_json import plan_dictionary
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput, NoPlanFound
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.distance.clearance import arm_points, centers_at, clearances, segments
from ff_planner_ros.planning.distance.search_certificate import CERTIFICATE_GAP
from ff_planner_ros.planning.motion.motion import from_trajectory
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.system_frame import system_frame
from ff_planner_ros.planning.problem.problem import (
    Obstacle,
    PlanningProblem,
    attached,
    with_capture_target,
)
from ff_planner_ros.planning.problem.scene import Scene, scene_of
from ff_planner_ros.planning.problem.target_body import AttachedObstacle, TargetBody
from ff_planner_ros.planning.scenario.scenario import Defaults, load_scenario, load_task
from ff_planner_ros.planning.scenario.scenario_writer import write_scenario
from ff_planner_ros.planning.task.tail import EndBehaviour
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.robot.collision.solids import Solid
from ff_planner_ros.simulation.verification import verify

SETTINGS = load_parameters().planner
SPEEDS = ("tumbling", "fast tumbling")


@pytest.fixture(scope="module", params=[("tumbling", 0), ("fast tumbling", 3)], ids=str)
def problem(request: pytest.FixtureRequest) -> PlanningProblem:
    return tumbling.problem(*request.param)


@pytest.fixture(scope="module")
def plan(problem: PlanningProblem) -> Plan:
    return perform(PlanningTask(problem, SETTINGS))


def body_of(problem: PlanningProblem) -> TargetBody:
    assert problem.target_body is not None
    return problem.target_body


def moved(body: TargetBody, times: Array) -> tuple[Array, Rotation, Array]:
    """Return centres, attitudes and turn rates of a body, by Euler's equations written out."""

    def change(_: float, state: Array) -> Array:
        x, y, z, w = state[:4]
        a, b, c = state[4:]
        rate = np.linalg.solve(body.inertia, np.cross(body.inertia @ state[4:], state[4:]))
        return 0.5 * np.array(
            [w * a + y * c - z * b, w * b + z * a - x * c, w * c + x * b - y * a,
             -x * a - y * b - z * c, *(2.0 * rate)]
        )  # fmt: skip

    to_inertial = Rotation.from_quat(body.quaternion_xyzw.copy())
    begin = np.concatenate(
        [body.quaternion_xyzw, to_inertial.as_matrix().T @ body.angular_velocity]
    )
    span = (0.0, float(times[-1]))
    found = solve_ivp(change, span, begin, "DOP853", times, rtol=1e-12, atol=1e-13).y
    attitudes = Rotation.from_quat(found[:4].T)
    centers = body.position + np.outer(times, body.linear_velocity)
    return centers, attitudes, attitudes.apply(found[4:].T)


@pytest.mark.law("PLAN-14")
def test_the_end_effector_rests_in_the_body_at_capture(
    problem: PlanningProblem, plan: Plan
) -> None:
    body, motion = body_of(problem), plan.trajectory
    (center,), (attitude,), (rate,) = moved(body, np.array([problem.duration]))
    lever = attitude.as_matrix() @ body.grasp_position
    turn = (
        Rotation.from_quat(motion.ee_quaternions_xyzw[-1].copy())
        * (attitude * Rotation.from_quat(body.grasp_quaternion_xyzw.copy())).inv()
    )
    assert motion.ee_positions[-1] == pytest.approx(center + lever, abs=1e-5)
    assert turn.magnitude() < 1e-5
    assert motion.ee_angular_velocities[-1] == pytest.approx(rate, abs=1e-6)
    assert motion.ee_linear_velocities[-1] == pytest.approx(
        body.linear_velocity + np.cross(rate, lever), abs=1e-6
    )


def test_the_arm_stays_outside_what_is_fixed_to_the_body(
    problem: PlanningProblem, plan: Plan
) -> None:
    """Looked at a hundred times between any two of its points."""
    q, _ = from_trajectory(problem.robot, plan.trajectory)
    times = plan.trajectory.time
    centers, attitudes, _ = moved(body_of(problem), times)
    points = arm_points(problem.robot, q)
    along = np.linspace(0.0, 1.0, 60)[:, None, None, None]
    line = (1.0 - along) * points[:, :-1] + along * points[:, 1:]
    nearest = np.inf
    for sphere in body_of(problem).obstacles:
        there = centers + attitudes.apply(np.tile(sphere.position, (len(times), 1)))
        away = np.linalg.norm(line - there[:, None], axis=-1).min() - sphere.radius
        nearest = min(nearest, float(away))
    assert plan.metrics.min_clearance > 0.0
    assert plan.metrics.min_clearance <= nearest + 1e-9
    # Sampled lines, and the clearance between the points, are a little beside it.
    assert plan.metrics.min_clearance == pytest.approx(nearest, abs=5e-3)


@pytest.mark.law("PLAN-14")
def test_mujoco_sees_the_capture_come_true(problem: PlanningProblem, plan: Plan) -> None:
    found = verify(problem.robot, plan.trajectory, scene_of(problem))
    assert found.passed
    assert found.capture is not None
    assert found.capture.position_error < 1e-3
    assert found.capture.orientation_error < np.deg2rad(0.05)
    assert found.capture.linear_speed < 1e-3
    # A body that is elsewhere, or turns otherwise, is not captured.
    for change in (
        {"position": body_of(problem).position + np.array([0.0, 2e-3, 0.0])},
        {"angular_velocity": 1.02 * body_of(problem).angular_velocity},
        {"linear_velocity": body_of(problem).linear_velocity + np.array([2e-3, 0.0, 0.0])},
    ):
        other = replace(body_of(problem), **change)
        assert not verify(problem.robot, plan.trajectory, Scene(target_body=other)).passed


@pytest.mark.law("PLAN-24")
@pytest.mark.parametrize("name", ["turned", "in orbit"])
def test_the_plan_is_the_same_in_every_inertial_frame(
    name: str, problem: PlanningProblem, plan: Plan
) -> None:
    frame = FRAMES[name]
    found = perform(PlanningTask(seen_from(problem, frame), SETTINGS)).trajectory
    for quantity, tolerance in (("joint_positions", 1e-5), ("joint_velocities", 1e-5)):
        there, here = getattr(found, quantity), getattr(plan.trajectory, quantity)
        assert np.abs(there - here).max() < tolerance, quantity


def seen_from(problem: PlanningProblem, frame: Frame) -> PlanningProblem:
    body = body_of(problem)
    there = replace(
        body,
        position=frame.place(body.position, 0.0),
        quaternion_xyzw=frame.attitude(body.quaternion_xyzw.copy()),
        linear_velocity=frame.vector(body.linear_velocity) + frame.velocity,
        angular_velocity=frame.vector(body.angular_velocity),
    )
    return with_capture_target(there, frame.problem(replace(problem, obstacles=())))


def test_a_body_that_does_not_turn_is_a_target_that_drifts(problem: PlanningProblem) -> None:
    body = replace(body_of(problem), angular_velocity=np.zeros(3))
    captured = with_capture_target(body, problem)
    spheres = tuple(
        Obstacle.sphere(one.id, one.center, one.radius, body.linear_velocity)
        for one in captured.obstacles
    )
    drifting = replace(captured, target_body=None, obstacles=spheres)
    frame = system_frame(problem.robot, problem.start)
    # In the frame that plans are made in, where places are rounded to a micrometre.
    one, other = frame.problem(captured), frame.problem(drifting)
    for item in fields(one.target)[:6]:
        there, here = getattr(one.target, item.name), getattr(other.target, item.name)
        assert there == pytest.approx(here, abs=2e-6), item.name
    times = np.linspace(0.0, problem.duration, 7)
    centers = [centers_at(times, made.obstacles) for made in (one, other)]
    assert centers[0] == pytest.approx(centers[1], abs=2e-6)
    speeds = [[sphere.highest_speed for sphere in made.obstacles] for made in (one, other)]
    assert speeds[0] == pytest.approx(speeds[1], abs=1e-8)


def test_scenario_and_digest_hold_all_of_a_body(problem: PlanningProblem, tmp_path: Path) -> None:
    task, body = PlanningTask(problem, SETTINGS), body_of(problem)
    path = tmp_path / "scenario.yaml"
    write_scenario(task, path)
    again = load_task(path, Defaults(SETTINGS))
    assert again.digest == task.digest
    read = body_of(again.problem)
    for name in ("position", "quaternion_xyzw", "inertia", "grasp_quaternion_xyzw"):
        assert (getattr(read, name) == getattr(body, name)).all(), name
    assert len(again.problem.obstacles) == len(body.obstacles)
    sphere = body.obstacles[0]
    changes: list[dict[str, Any]] = [
        {"position": body.position + 1e-9},
        {"linear_velocity": body.linear_velocity + 1e-9},
        {"angular_velocity": body.angular_velocity + 1e-9},
        {"inertia": 1.001 * body.inertia},
        {"grasp_position": body.grasp_position + 1e-9},
        {"grasp_quaternion_xyzw": [0.0, 0.0, 0.0, 1.0]},
        {"obstacles": body.obstacles[1:]},
        {
            "obstacles": (
                replace(sphere, shape=Solid("sphere", [sphere.radius - 1e-9])),
                *body.obstacles[1:],
            )
        },
        {"obstacles": (replace(sphere, position=sphere.position + 1e-9), *body.obstacles[1:])},
    ]
    for change in changes:
        other = replace(task, problem=with_capture_target(replace(body, **change), problem))
        assert other.digest != task.digest, change


def test_the_answer_tells_where_the_body_is_at_each_point(
    problem: PlanningProblem, plan: Plan
) -> None:
    task = PlanningTask(problem, SETTINGS)
    answer = json.loads(json.dumps(plan_dictionary(plan, task, 0.5)))
    told, times = answer["target_body"], plan.trajectory.time
    centers, attitudes, rates = moved(body_of(problem), times)
    assert np.array(told["positions"]) == pytest.approx(centers, abs=1e-9)
    turns = Rotation.from_quat(told["quaternions_xyzw"]) * attitudes.inv()
    assert turns.magnitude().max() < 1e-9
    assert np.array(told["angular_velocities"]) == pytest.approx(rates, abs=1e-9)
    drift = np.tile(body_of(problem).linear_velocity, (len(times), 1))
    assert np.array(told["linear_velocities"]) == pytest.approx(drift, abs=1e-12)
    assert "inertia" in told
    document = plan_document(answer)
    read = document.scene.target_body
    assert read is not None
    assert read.target(3.0).position == pytest.approx(body_of(problem).target(3.0).position)
    assert document.obstacles is not None
    assert [one.id for one in document.obstacles] == [one.id for one in problem.obstacles]
    assert document.obstacles[-1].body is document.scene.target_body


def mapping(problem: PlanningProblem, path: Path) -> dict[str, Any]:
    """Write a problem as a scenario, and return the mapping that the file holds."""
    write_scenario(PlanningTask(problem, SETTINGS), path)
    content: dict[str, Any] = yaml.safe_load(path.read_text(encoding="utf-8"))
    return content


_REST = {"position": [1.0, 0.0, 0.0], "quaternion_xyzw": [0.0, 0.0, 0.0, 1.0]}


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"target": _REST}, "target"),
        ({"target_body": None}, "target"),
        ({"inertia": None}, "target_body.inertia"),
        ({"inertia": {"ixx": 1.0}}, "target_body.inertia.ixy"),
        ({"inertia": 3.0}, "target_body.inertia"),
        (
            {"inertia": {"ixx": 1.0, "iyy": 1.0, "izz": 2.5, "ixy": 0.0, "ixz": 0.0, "iyz": 0.0}},
            "target_body.inertia",
        ),
        ({"grasp": {"position": [0.0, 0.0, 0.0]}}, "target_body.grasp.quaternion_xyzw"),
        ({"mass": -3.0}, "target_body.mass"),
        ({"angular_velocity": [0.0, 0.0, 1e4]}, "target_body.angular_velocity"),
        (
            {"obstacles": [{"id": "a", "center": [9.0, 0.0, 0.0]}]},
            "target_body.obstacles[0].radius",
        ),
        (
            {"obstacles": 2 * [{"id": "a", "center": [9.0, 0.0, 0.0], "radius": 1.0}]},
            "target_body.obstacles[1].id",
        ),
        (
            {"obstacles": [{"id": "rock", "center": [9.0, 0.0, 0.0], "radius": 1.0}]},
            "target_body.obstacles[0].id",
        ),
    ],
)
def test_a_scenario_that_describes_no_body_is_refused_by_name(
    change: dict[str, Any], field: str, tmp_path: Path
) -> None:
    path = tmp_path / "scenario.yaml"
    content = mapping(tumbling.problem("tumbling", 0), path)
    content["obstacles"] = [{"id": "rock", "center": [50.0, 0.0, 0.0], "radius": 1.0}]
    for name, value in change.items():
        place = content if name.startswith("target") else content["target_body"]
        if value is None:
            del place[name]
        else:
            place[name] = value
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    with pytest.raises(InvalidInput) as refused:
        load_scenario(path)
    assert refused.value.field == field


def swinging(radius: float, turns: float, duration: float) -> Obstacle:
    """Return a sphere that comes back to where it begins, far away half-way."""
    body = TargetBody(
        position=[0.0, 0.0, 0.0],
        quaternion_xyzw=[0.0, 0.0, 0.0, 1.0],
        inertia=np.eye(3),
        grasp_position=[0.0, 0.0, 9.0],
        grasp_quaternion_xyzw=[0.0, 0.0, 0.0, 1.0],
        angular_velocity=[0.0, 0.0, 2.0 * np.pi * turns / duration],
        obstacles=(AttachedObstacle.sphere("boom", [-5.0, 0.0, 0.0], radius),),
    )
    (sphere,) = attached(body)
    return sphere


@pytest.mark.law("PLAN-10")
def test_what_swings_by_between_first_and_last_point_is_not_overlooked() -> None:
    """At the first and the last point the sphere is where the arm never is."""
    drawn = tumbling.problem("tumbling", 0)
    robot = drawn.robot
    q = np.concatenate([np.zeros(6), [1.0], drawn.start.joint_positions])
    tip = arm_points(robot, q[None])[0, -1]
    sphere = swinging(0.1, 1.0, 10.0)
    body = sphere.body
    assert body is not None
    times = np.linspace(0.0, 10.0, 50)
    shift = tip - np.array([5.2, 0.0, 0.0])
    (moved_sphere,) = attached(replace(body, position=shift))
    q_rows = np.tile(q, (50, 1))
    for seen, expected in ((times, True), (0.1 * times, False)):
        distances = distances_of_core(robot, q_rows, seen, [moved_sphere], 0.2).values
        assert bool((distances < 0.2).any()) is expected


@pytest.mark.parametrize("kind", SPEEDS)
def test_the_core_sees_attached_where_they_are(kind: str) -> None:
    rng = np.random.default_rng(0)
    drawn = tumbling.problem(kind, 1)
    robot, spheres = drawn.robot, drawn.obstacles
    own = (Obstacle.sphere("rock", [1.0, 0.5, 0.3], 0.2, [0.01, 0.0, -0.02]), *spheres)
    q = np.tile(np.concatenate([np.zeros(6), [1.0], drawn.start.joint_positions]), (20, 1))
    q[:, 7:] += rng.normal(scale=0.3, size=q[:, 7:].shape)
    v = 0.1 * rng.normal(size=(20, robot.model.nv))
    times = np.linspace(0.0, drawn.duration, 20)
    found, _, names, *_ = distances_of_core(robot, q, times, own, 100.0)
    positions = arm_points(robot, q)
    expected = clearances(positions, times, segments(positions), own).distance
    assert np.sort(names).tolist() == np.arange(expected.size).tolist()
    assert found == pytest.approx(expected.ravel()[names], abs=1e-12)
    dense = reference_clearance.dense_clearance(robot, q, v, times, own)
    certified = certified_by_core(robot, q, v, times, own)
    assert dense - CERTIFICATE_GAP - 1e-3 <= certified <= dense + 1e-9


@pytest.mark.parametrize("seed", range(3))
def test_the_certificate_knows_how_an_attached_sphere_moves_between_points(seed: int) -> None:
    """The arm rests; looked at six times only, the body turns by 100 degrees between two."""
    rng = np.random.default_rng(seed)
    drawn = tumbling.problem("tumbling", seed)
    robot, q = drawn.robot, np.concatenate([np.zeros(6), [1.0], drawn.start.joint_positions])
    tip = arm_points(robot, q[None])[0, -1]
    body = replace(
        body_of(drawn),
        position=tip + 1.5 * Rotation.random(rng=rng).apply([1.0, 0.0, 0.0]),
        linear_velocity=np.zeros(3),
        angular_velocity=0.6 * Rotation.random(rng=rng).apply([1.0, 0.0, 0.0]),
        obstacles=body_of(drawn).obstacles[:2],
    )
    spheres, times = list(attached(body)), np.linspace(0.0, 15.0, 6)
    rows, still = np.tile(q, (6, 1)), np.zeros((6, robot.model.nv))
    certified = certified_clearance(robot, rows, still, times, spheres)
    dense = np.linspace(0.0, 15.0, 3001)
    points = arm_points(robot, q[None])[0]
    along = np.linspace(0.0, 1.0, 100)[:, None, None]
    line = ((1.0 - along) * points[:-1] + along * points[1:]).reshape(-1, 3)
    centers = centers_at(dense, spheres)
    true = min(
        float(np.linalg.norm(line - center, axis=1).min()) - sphere.radius
        for k, sphere in enumerate(spheres)
        for center in centers[:, k]
    )
    assert certified <= true + 1e-9
    assert certified >= true - 6e-3


@pytest.mark.parametrize("kind", tumbling.KINDS)
def test_drawn_bodies_are_what_their_class_promises(kind: str) -> None:
    promised = tumbling.KINDS[kind]
    for drawn in (tumbling.problem(kind, number) for number in range(2)):
        body = body_of(drawn)
        rates = body.motion(np.zeros(3), np.linspace(0.0, 300.0, 100)).twists[:, 3:]
        rate = np.rad2deg(np.linalg.norm(drawn.target.angular_velocity))
        assert promised.rates[0] - 1e-6 <= rate <= promised.rates[1] + 1e-6
        assert 6 <= len(body.obstacles) <= 14
        least, most = promised.lever
        assert least - 1e-9 <= np.linalg.norm(body.grasp_position) <= most + 1e-9
        assert bool(drawn.robot.bodies) is (kind == "with shapes")
        passing = [sphere for sphere in drawn.obstacles if sphere.body is None]
        assert bool(passing) is (kind == "passing spheres")
        assert all(np.linalg.norm(sphere.motion.velocity) > 0.0 for sphere in passing)
        assert (drawn.approach is not None) is (kind == "corridor")
        across = np.cross(rates, rates[0])
        if kind == "on a table":
            assert np.abs(rates[:, :2]).max() < 1e-12
            continue
        # It precesses: the axis that it turns about wanders.
        assert np.linalg.norm(across, axis=1).max() > 0.02 * np.linalg.norm(rates[0]) ** 2
        if kind == "turning over":
            _, axes = np.linalg.eigh(body.inertia)
            to_body = Rotation.from_quat(body.quaternion_xyzw.copy()).inv()
            about = to_body.apply(body.angular_velocity.copy()) @ axes
            assert abs(about[1]) > 0.9 * np.linalg.norm(about)


def test_a_drawn_corridor_can_be_kept() -> None:
    """What a motion was drawn for is in reach: the planner keeps it, and so does a dense look."""
    drawn = tumbling.problem("corridor", 0)
    approach = drawn.approach
    assert approach is not None
    motion = perform(PlanningTask(drawn, SETTINGS)).trajectory
    centers, attitudes, _ = moved(body_of(drawn), motion.time)
    grasps = attitudes * Rotation.from_quat(body_of(drawn).grasp_quaternion_xyzw.copy())
    levers = attitudes.apply(np.tile(body_of(drawn).grasp_position, (len(centers), 1)))
    seen = grasps.inv().apply(motion.ee_positions - centers - levers)
    near = np.linalg.norm(seen, axis=1) < approach.distance
    along = -seen[near] @ approach.direction
    aside = np.linalg.norm(seen[near] + along[:, None] * approach.direction, axis=1)
    assert near.sum() > 3
    assert not near[0]
    assert (aside <= 0.005 + along * np.tan(approach.half_angle) + 1e-6).all()


def test_a_grasp_that_is_carried_into_an_obstacle_is_refused() -> None:
    """An obstacle that the body carries its grasp into is named before anything is solved."""
    drawn = tumbling.problem("tumbling", 0)
    rock = Obstacle.sphere("rock", drawn.target.position, 0.3)
    with pytest.raises(NoPlanFound, match="inside obstacle rock"):
        perform(PlanningTask(replace(drawn, obstacles=(rock, *drawn.obstacles)), SETTINGS))


@pytest.mark.parametrize("kind", SPEEDS)
def test_after_the_capture_the_arm_goes_on_with_the_body(kind: str) -> None:
    drawn = tumbling.problem(kind, 0)
    task = PlanningTask(drawn, SETTINGS, end_behaviour=EndBehaviour.HOLD_END_EFFECTOR, tail=3.0)
    motion, body = perform(task).trajectory, body_of(drawn)
    after = motion.time >= drawn.duration
    centers, attitudes, _ = moved(body, motion.time)
    levers = attitudes.apply(np.tile(body.grasp_position, (len(motion.time), 1)))
    away = np.linalg.norm(motion.ee_positions - (centers + levers), axis=1)
    grasps = attitudes * Rotation.from_quat(body.grasp_quaternion_xyzw.copy())
    turned = (Rotation.from_quat(motion.ee_quaternions_xyzw.copy()) * grasps.inv()).magnitude()
    assert after.sum() > 8
    assert away[after].max() < 1e-4
    assert turned[after].max() < 1e-4
    # A target that went on as it was at the capture would be elsewhere by then.
    straight = drawn.target.position + 3.0 * drawn.target.linear_velocity
    assert np.linalg.norm(straight - motion.ee_positions[-1]) > 5e-4
    found = verify(drawn.robot, motion, scene_of(drawn))
    assert found.passed


SCENARIOS = Path(__file__).parents[1] / "config" / "scenarios"


def test_what_the_tool_grasps_may_touch_it_from_near_the_goal_on_as_the_body_moves_on() -> None:
    given = load_scenario(SCENARIOS / "lemur_tumbling.yaml")
    body = body_of(given)
    grasp = Rotation.from_quat(body.grasp_quaternion_xyzw.copy())
    fixture = AttachedObstacle.sphere(
        "fixture", body.grasp_position + grasp.apply([0, 0, 0.2]), 0.08
    )
    asked = with_capture_target(replace(body, obstacles=(*body.obstacles, fixture)), given)
    holding: dict[str, Any] = {"end_behaviour": EndBehaviour.HOLD_END_EFFECTOR, "tail": 2.0}
    with pytest.raises(NoPlanFound, match="name link_7/fixture in allowed_collisions"):
        perform(PlanningTask(asked, SETTINGS, **holding))
    asked = replace(asked, allowed_collisions=("link_7/fixture",), contact_distance=0.25)
    motion = perform(PlanningTask(asked, SETTINGS, **holding)).trajectory
    assert verify(asked.robot, motion, scene_of(asked)).passed
    # It does touch, in the tail, too, where the goal is elsewhere than at the capture.
    found = verify(asked.robot, motion, replace(scene_of(asked), allowed_collisions=()))
    (contact,) = found.contacts
    assert contact.pair == "link_7/fixture"
    assert asked.duration - 4.0 < contact.first_time < asked.duration
    assert np.linalg.norm(asked.target.position - motion.ee_positions[-1]) > 0.02


def test_a_body_that_leaves_the_table_is_refused_by_its_own_field() -> None:
    given = load_scenario(SCENARIOS / "planar_capture.yaml")
    flat = TargetBody(
        position=given.target.position,
        quaternion_xyzw=[0.0, 0.0, 0.0, 1.0],
        inertia=np.diag([1.0, 1.2, 1.5]),
        grasp_position=np.zeros(3),
        grasp_quaternion_xyzw=given.target.quaternion_xyzw,
        angular_velocity=[0.0, 0.0, 0.05],
    )
    with_capture_target(flat.after(-given.duration), given)
    rolling = replace(flat, angular_velocity=[0.05, 0.0, 0.0])
    with pytest.raises(InvalidInput) as refused:
        with_capture_target(rolling.after(-given.duration), given)
    assert refused.value.field == "target_body.angular_velocity"
