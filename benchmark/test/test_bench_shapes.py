"""The laws of the problems among bodies of any shape: by Coal, dense, and by the check."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from bodied_robots import coal_distance
from scipy.spatial import ConvexHull

from ff_planner_benchmark.bench import prices
from ff_planner_benchmark.bench.plans import SHAPES_PLANS
from ff_planner_benchmark.problems import shapes
from ff_planner_benchmark.problems.shapes import LINES_EVERY, ROBOTS, SITUATIONS
from ff_planner_benchmark.problems.tumbling_witness import Witness
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.forward import driven
from ff_planner_ros.planning.motion.plan import SolverReport
from ff_planner_ros.planning.problem.problem import Obstacle
from ff_planner_ros.planning.search.candidate import plan_of_motion
from ff_planner_ros.planning.search.planner import plan
from ff_planner_ros.problems.drawn import Drawn
from ff_planner_ros.problems.paths import STRAIGHT, roll_out
from ff_planner_ros.problems.robots import bench_robot
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.collision.lines import with_bodies
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.dynamics import accelerations
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.momentum import total_momentum

FINE, FAR = 601, 0.05  # [m] of what is further apart a bound will do
# Every robot and every situation, with lines, too; then every robot in every situation.
NUMBERS = [*range(7), *(pytest.param(n, marks=pytest.mark.nightly) for n in range(7, 30))]


@pytest.fixture(scope="module", params=NUMBERS)
def number(request: pytest.FixtureRequest) -> int:
    return request.param


@pytest.fixture(scope="module")
def drawn(number: int) -> Drawn[Witness]:
    return shapes.problem(number)


@pytest.fixture(scope="module")
def situation(number: int) -> str:
    return SITUATIONS[number % len(SITUATIONS)]


def witness_at(drawn: Drawn[Witness], points: int) -> tuple[Array, Array, Array, Array]:
    """Times, configurations, velocities and accelerations of the witness."""
    problem, joints = drawn.problem, drawn.witness.joints
    robot, times = problem.robot, np.linspace(0.0, problem.duration, points)
    assert joints is not None
    q, v = configuration(robot, problem.start)
    momentum = total_momentum(robot, robot.model.createData(), q, v)
    way, twists, *_ = driven(robot, q, momentum, joints, times)
    return times, way, twists, accelerations(robot, way, twists, joints.at(times)[2])


def least_distances(robot: Robot, way: Array, times: Array, one: Obstacle) -> Array:
    """Distances of every body from an obstacle, or less where they are far. (times, bodies) [m]."""
    data, found = robot.model.createData(), np.empty((len(way), len(robot.bodies)))
    rotations, positions = one.motion.poses(times)
    for number, q in enumerate(way):
        pin.forwardKinematics(robot.model, data, q)
        there = pin.SE3(rotations[number], positions[number])
        center = there.act(one.solid.center)
        for k, body in enumerate(robot.bodies):
            apart = np.linalg.norm(data.oMi[body.joint].act(body.center_in_joint) - center)
            found[number, k] = apart - body.radius - one.solid.radius
            if found[number, k] > FAR:
                continue
            at = data.oMi[body.joint] * body.placement_in_joint
            found[number, k] = coal_distance(body.solid, at, one.solid.geometry, there)
    return found


def test_the_witness_stays_clear_of_every_body_between_the_points_too(
    drawn: Drawn[Witness], situation: str
) -> None:
    times, way, *_ = witness_at(drawn, FINE)
    least = [
        least_distances(with_bodies(drawn.problem.robot), way, times, one).min()
        for one in drawn.problem.obstacles
    ]
    assert min(least) > shapes.CLEAR
    slot = situation == "slot"
    assert min(least[: 2 * slot], default=np.inf) > shapes.SLOT
    assert max(least[: 2 * slot], default=0.0) < shapes.SLOT + 6e-3


def test_the_witness_passes_the_planners_own_check(drawn: Drawn[Witness]) -> None:
    problem, settings = drawn.problem, load_parameters().planner
    _, *motion = witness_at(drawn, problem.points)
    report = SolverReport(0, 0, 0, 0.0, "")
    witness = plan_of_motion(problem, settings, *motion, report)
    assert [failure.finding for _, failure in witness.failures] == []


def test_the_straight_path_meets_a_body(drawn: Drawn[Witness], situation: str) -> None:
    if situation in ("slot", "capture"):
        return
    motion = roll_out(drawn.problem, STRAIGHT, 101)
    times = np.linspace(0.0, drawn.problem.duration, 101)
    first, robot = drawn.problem.obstacles[0], with_bodies(drawn.problem.robot)
    assert least_distances(robot, motion.q, times, first).min() < 0.0


def test_each_situation_is_what_it_promises(drawn: Drawn[Witness], situation: str) -> None:
    problem, bodies, still = drawn.problem, drawn.problem.obstacles, np.zeros(3)
    assert problem.obstacles == bodies
    turning = [float(np.linalg.norm(one.motion.angular_velocity)) for one in bodies]
    moving = [one.moves for one in bodies]
    match situation:
        case "at rest":
            assert not any(moving)
        case "moving":
            assert all(moving)
            assert not any(turning)
        case "turning":
            assert all(turning)
        case "slot":
            assert not any(moving)
            for plate in bodies[:2]:
                assert plate.solid.sizes[2] == 0.005
        case "sweeping panel":
            assert turning[0] * problem.duration >= 1.0
            assert bodies[0].solid.sizes[2] == 0.005
        case _:
            body = problem.target_body
            assert body is not None
            assert len(body.obstacles) >= 6
            assert np.linalg.norm(body.angular_velocity) > 0.0
            assert {one.body for one in bodies} == {body}
            return
    assert len(bodies) >= 3
    np.testing.assert_array_equal(problem.target.linear_velocity, still)


@pytest.mark.nightly
def test_robots_situations_and_kinds_of_shapes_are_all_there() -> None:
    first = [shapes.problem(number) for number in range(2 * LINES_EVERY)]
    names = {one.problem.robot.model.name for one in first}
    assert names == {bench_robot(name).model.name for name in ROBOTS}
    of_lines = [one.problem.robot.geometry is Geometry.LINES for one in first]
    assert of_lines == ([False] * (LINES_EVERY - 1) + [True]) * 2
    kinds = {body.solid.kind for one in first for body in one.problem.obstacles}
    assert kinds == {"box", "cylinder", "capsule", "cone", "mesh"}


def test_the_same_problem_is_drawn_again_and_another_number_is_another() -> None:
    def numbers(drawn: Drawn[Witness]) -> Array:
        problem = drawn.problem
        places = [one.motion.position for one in problem.obstacles]
        return np.concatenate([problem.start.joint_positions, *places])

    first, other = numbers(shapes.problem(2)), numbers(shapes.problem(3))
    np.testing.assert_array_equal(numbers(shapes.problem.__wrapped__(2)), first)
    assert not np.array_equal(first[:7], other[:7])


@pytest.mark.law("PLAN-33")
@pytest.mark.ci
def test_the_benchmark_plans_them_and_tells_of_each_situation_and_robot() -> None:
    rows = list(SHAPES_PLANS.rows(6, load_parameters().planner))
    assert [row["status"] for row in rows] == ["SOLVED"] * 6
    table = SHAPES_PLANS.table(rows)
    names = ["all", *SITUATIONS, *ROBOTS, "shapes"]
    assert [row[0] for row in table.rows] == names
    assert {row[2] for row in table.rows} == {"100.0%"}
    assert [int(row[1]) for row in table.rows] == [6, *[1] * 6, 2, *[1] * 4, 6]


@pytest.mark.nightly
def test_what_shapes_cost_is_measured_against_what_else_is_there() -> None:
    rows = list(prices.prices(1, load_parameters().planner))
    compared = [(row["of"], row["beside"]) for row in rows]
    of_captures = [
        ("3 boxes", "3 spheres"),
        ("3 hulls of 200 corners", "3 boxes"),
        ("30 boxes", "3 boxes"),
    ]
    of_targets, of_many = ("target of 20 bodies", "of 20 spheres"), ("boxes", "spheres")
    assert compared == [*of_captures, *of_captures, *[of_targets] * 2, *[of_many] * 2]
    assert [row["capture"] for row in rows[-2:]] == [f"3 problems, {of}" for of in Geometry]
    assert all(min(row["seconds"], row["seconds_beside"], row["rollouts"]) > 0 for row in rows)


def test_a_box_in_a_sphere_has_its_corners_on_it() -> None:
    sphere = Obstacle.sphere("s", np.array([1.0, 2.0, 3.0]), 0.5, np.array([0.1, 0.0, 0.0]))
    box = prices._box_inside(sphere)
    assert box.solid.radius == pytest.approx(0.5)
    assert (box.motion.position == sphere.center).all()
    assert (box.motion.velocity == sphere.motion.velocity).all()


def test_what_is_compared_is_nearly_the_same() -> None:
    sphere = Obstacle.sphere("s", np.array([1.0, 2.0, 3.0]), 0.5)
    box = prices._box(sphere)
    hull = prices._hull(box)
    assert box.solid.geometry.computeVolume() == pytest.approx(4 / 3 * np.pi * 0.5**3)
    assert len(hull.solid.corners) == 200
    edge = float(box.solid.sizes[0])
    assert np.abs(hull.solid.corners).max() <= edge / 2
    assert 0.8 < ConvexHull(hull.solid.corners).volume / edge**3 < 1.0


def test_among_edges_lines_too_are_planned_from_the_first_guess() -> None:
    """Where a line slides along an edge, multipliers converge slowly: no reason for another."""
    found = plan(shapes.problem(41).problem, load_parameters().planner)
    assert found.solver.starts == 1
