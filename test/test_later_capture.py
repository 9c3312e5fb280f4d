"""Sequences that come to rest before they capture: what is where in each phase, and in its bag.

Laws are held against a body that is integrated here, by Euler's equations, from the first point on.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from recorded_requests import motions_in, only_request
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from ff_planner_benchmark.problems import tumbling
from ff_planner_ros.analysis.plan_document import phases_of, planned_scene
from ff_planner_ros.analysis.plan_json import plan_dictionary
from ff_planner_ros.bag.plans import read_plans
from ff_planner_ros.cli import main
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.common.times import NANOSECONDS, nanoseconds
from ff_planner_ros.console.curves import ATTITUDE, CLEARANCE, VELOCITIES, curves_of
from ff_planner_ros.console.stages import stages_of
from ff_planner_ros.demo.executive import FlownPlan
from ff_planner_ros.demo.mission import ends_of_phases, mission_report
from ff_planner_ros.messages.plans import plan_from_answer
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.motion import from_trajectory
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.objective import DurationRange
from ff_planner_ros.planning.problem.obstacles import Obstacle, RigidMotion
from ff_planner_ros.planning.problem.posture import Posture
from ff_planner_ros.planning.problem.scene import scene_of
from ff_planner_ros.planning.problem.target_body import TargetBody
from ff_planner_ros.planning.scenario.scenario_writer import write_scenario
from ff_planner_ros.planning.task.digest import digest_of
from ff_planner_ros.planning.task.following import following, phase_tasks
from ff_planner_ros.planning.task.phase import Phase
from ff_planner_ros.planning.task.planning_task import PlanningTask
from ff_planner_ros.planning.task.task import perform
from ff_planner_ros.planning.task.whole import whole, whole_scene
from ff_planner_ros.report.from_bag import report_of_bag
from ff_planner_ros.robot.collision.solids import Solid
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.momentum import total_momentum
from ff_planner_ros.ros.messages.from_messages import target_body_from_message
from ff_planner_ros.ros.messages.requests import request_of_scenario
from ff_planner_ros.ros.outputs.prediction import FramePose, PoseError
from ff_planner_ros.runs.offline_bag import record_answer
from ff_planner_ros.runs.replay import Verdict, replay

REST = Posture(at_rest=True)
# No two phases last equally long, or a whole number of seconds.
FIRST, SECOND = 1.7, 2.3
PASSING = Obstacle.sphere("passing", [9.0, 1.0, -2.0], 0.1, [0.1, 0.2, -0.05])
TURNING = Obstacle(
    "turning",
    Solid("box", np.array([0.5, 0.3, 0.2])),
    RigidMotion([-9.0, 0.0, 3.0], [0.5, 0.5, -0.5, 0.5], [0.0, -0.1, 0.05], [0.2, 0.1, -0.3]),
)


def mass_of(robot: Robot) -> float:
    return sum(inertia.mass for inertia in robot.model.inertias)


class There(NamedTuple):
    """A free body: its centre of mass, axes and twist, and its momentum about the origin."""

    position: Array
    attitude: Rotation
    twist: Array  # linear first, inertial axes

    def momentum(self, body: TargetBody) -> Array:
        axes, linear = self.attitude.as_matrix(), body.mass * self.twist[:3]
        spin = axes @ body.inertia @ axes.T @ self.twist[3:]
        return np.concatenate([linear, np.cross(self.position, linear) + spin])

    def grasp(self, body: TargetBody) -> tuple[Array, Rotation, Array]:
        """Place, attitude and twist of an end effector that holds it."""
        lever, turn = self.attitude.apply(np.array(body.grasp_position)), self.twist[3:]
        twist = np.concatenate([self.twist[:3] + np.cross(turn, lever), turn])
        held = self.attitude * Rotation.from_quat(body.grasp_quaternion_xyzw)
        return self.position + lever, held, twist


def tumbled(body: TargetBody, seconds: float) -> There:
    """Where a body is by Euler's equations, I w' = I w x w in its own axes."""
    first = Rotation.from_quat(body.quaternion_xyzw)

    def rates(_: float, x: Array) -> Array:
        (a, b, c, d), w = x[:4], x[4:]
        cross = np.array([[d, -c, b], [c, d, -a], [-b, a, d], [-a, -b, -c]])
        spin = np.linalg.solve(body.inertia, np.cross(body.inertia @ w, w))
        return np.concatenate([cross @ w / 2.0, spin])

    begin = np.concatenate(
        [body.quaternion_xyzw, first.inv().apply(np.array(body.angular_velocity))]
    )
    end = solve_ivp(rates, (0.0, seconds), begin, "DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
    attitude = Rotation.from_quat(end[:4])
    twist = np.concatenate([body.linear_velocity, attitude.apply(end[4:])])
    return There(body.position + seconds * body.linear_velocity, attitude, twist)


def apart(one: Rotation, other: Rotation) -> float:
    return float((one.inv() * other).magnitude())


@pytest.fixture(scope="module", params=["the second captures", "the third captures"])
def task(request: pytest.FixtureRequest) -> PlanningTask:
    """Three phases among obstacles that move: the capture goes on, or is the last of them."""
    problem = tumbling.problem("tumbling", 0)
    body = problem.target_body
    assert body is not None
    body = replace(body, mass=body.mass or 50.0)
    free = tuple(one for one in problem.obstacles if one.body is None)
    first = replace(
        problem,
        target_body=None,
        posture=REST,
        obstacles=(*free, PASSING, TURNING),
        duration=FIRST,
        points=20,
    )
    home = Posture(problem.start.joint_positions)
    # As for the problem itself, the body is in reach when its phase begins.
    then = (
        Phase(duration=problem.duration, target_body=body.after(-FIRST)),
        Phase(duration=20.0, target=REST),
    )
    if request.param == "the third captures":
        then = (
            Phase(duration=SECOND, target=home),
            Phase(duration=problem.duration, target_body=body.after(-FIRST - SECOND)),
        )
    return PlanningTask(first, load_parameters().planner, then=then)


@pytest.fixture(scope="module")
def plan(task: PlanningTask) -> Plan:
    return perform(task)


@pytest.fixture(scope="module")
def captor(task: PlanningTask) -> int:
    """The number of the phase that captures, from 0 on."""
    (number,) = (k for k, one in enumerate(task.then, 1) if one.target_body is not None)
    return number


@pytest.fixture(scope="module")
def body(task: PlanningTask, captor: int) -> TargetBody:
    """The body at the first point of all."""
    found = task.then[captor - 1].target_body
    assert found is not None
    return found


@pytest.fixture(scope="module")
def begins(task: PlanningTask) -> Array:
    """When each phase begins, and the last one ends: no phase has a tail, and all are given."""
    lasts = [task.problem.duration, *(one.duration for one in task.then)]
    return np.cumsum([0.0, *(one for one in lasts if isinstance(one, float))])


def require_moved(obstacles: tuple[Obstacle, ...], seconds: float) -> None:
    """Both obstacles that move by themselves are where they are after a while."""
    (passing,) = (one for one in obstacles if one.id == "passing")
    (turning,) = (one for one in obstacles if one.id == "turning")
    assert passing.is_sphere
    assert not turning.is_sphere
    place = PASSING.center + seconds * PASSING.motion.velocity
    np.testing.assert_allclose(passing.center, place, atol=1e-6)
    place = TURNING.motion.position + seconds * TURNING.motion.velocity
    np.testing.assert_allclose(turning.motion.position, place, atol=1e-6)
    turn = Rotation.from_rotvec(seconds * TURNING.motion.angular_velocity)
    turned = turn * Rotation.from_quat(TURNING.motion.quaternion_xyzw)
    assert apart(Rotation.from_quat(turning.motion.quaternion_xyzw), turned) < 1e-6


def require_body(found: TargetBody | None, there: There) -> None:
    assert found is not None
    np.testing.assert_allclose(found.position, there.position, atol=1e-6)
    np.testing.assert_allclose(found.linear_velocity, there.twist[:3], atol=1e-8)
    np.testing.assert_allclose(found.angular_velocity, there.twist[3:], atol=1e-8)
    assert apart(Rotation.from_quat(found.quaternion_xyzw), there.attitude) < 1e-6


def test_in_each_phase_all_is_where_it_is_by_then(
    task: PlanningTask, plan: Plan, body: TargetBody, captor: int, begins: Array
) -> None:
    np.testing.assert_allclose([*plan.begins, whole(plan).duration], begins, atol=1e-9)
    for number, (one, _) in enumerate(phase_tasks(task, plan)):
        require_moved(one.problem.obstacles, begins[number])
        assert one.problem.duration == pytest.approx(np.diff(begins)[number])
        later = [one.problem.target_body, *(phase.target_body for phase in one.then)]
        for found in later[: captor - number + 1]:
            if found is not None:
                require_body(found, tumbled(body, begins[number]))
        assert (later[0] is not None) == (number == captor)
        if number == captor:
            place, attitude, twist = tumbled(body, begins[number + 1]).grasp(body)
            goal = one.problem.target
            np.testing.assert_allclose(goal.position, place, atol=1e-6)
            assert apart(Rotation.from_quat(goal.quaternion_xyzw), attitude) < 1e-6
            moves = np.concatenate([goal.linear_velocity, goal.angular_velocity])
            np.testing.assert_allclose(moves, twist, atol=1e-8)


def test_the_grasp_is_held_where_it_is_by_then_and_as_it_moves(
    plan: Plan, body: TargetBody, captor: int, begins: Array
) -> None:
    motion = plan.phases[captor].trajectory
    place, attitude, twist = tumbled(body, begins[captor + 1]).grasp(body)
    np.testing.assert_allclose(motion.ee_positions[-1], place, atol=2e-4)
    assert apart(Rotation.from_quat(motion.ee_quaternions_xyzw[-1]), attitude) < 2e-4
    moves = motion.ee_linear_velocities[-1], motion.ee_angular_velocities[-1]
    np.testing.assert_allclose(np.concatenate(moves), twist, atol=2e-4)


def test_from_the_grasp_on_there_is_the_momentum_of_all_at_that_moment(
    task: PlanningTask, plan: Plan, captor: int, begins: Array
) -> None:
    """Of a body that moves otherwise than the plan knows, and tumbles: its twist then counts."""
    one, found = list(phase_tasks(task, plan))[captor]
    seen, rng = one.problem.target_body, np.random.default_rng(3)
    assert seen is not None
    body = replace(
        seen,
        linear_velocity=seen.linear_velocity + rng.normal(scale=0.05, size=3),
        angular_velocity=seen.angular_velocity + rng.normal(scale=0.05, size=3),
    )
    problem = replace(one.problem, target_body=body, target=body.target(one.problem.duration))
    stop = Phase(duration=20.0, target=REST)
    after = following(replace(one, problem=problem, then=(stop,)), found).problem
    # At the grasp the body is where the end effector has it.
    motion, lasted = found.trajectory, begins[captor + 1] - begins[captor]
    held = Rotation.from_quat(motion.ee_quaternions_xyzw[-1])
    attitude = held * Rotation.from_quat(body.grasp_quaternion_xyzw).inv()
    lever, free = attitude.apply(np.array(body.grasp_position)), tumbled(body, lasted)
    assert apart(free.attitude, attitude) > 0.1
    _, _, twist = free.grasp(body)
    twist[:3] -= np.cross(twist[3:], lever)
    there = There(motion.ee_positions[-1] - lever, attitude, twist)
    q, v = from_trajectory(one.problem.robot, motion)
    alone = momentum_of(one.problem.robot, q[-1], v[-1])
    both = momentum_of(after.robot, *configuration(after.robot, after.start))
    np.testing.assert_allclose(both - alone, there.momentum(body), atol=1e-6 * body.mass)


def momentum_of(robot: Robot, q: Array, v: Array) -> Array:
    return total_momentum(robot, robot.model.createData(), q, v)


def test_a_phase_of_a_free_duration_is_followed_from_when_it_ends(
    task: PlanningTask, plan: Plan
) -> None:
    """Whatever it might have lasted."""
    for one, found in phase_tasks(task, plan):
        if one.then:
            lasted = one.problem.duration
            window = DurationRange(0.5 * lasted, 3.0 * lasted)
            free = replace(one.problem, duration=3.0 * lasted, duration_range=window)
            lasting = replace(found, duration=lasted)
            after = [
                following(replace(one, problem=problem), lasting).problem
                for problem in (one.problem, free)
            ]
            assert digest_of(after[0]) == digest_of(after[1])


@pytest.fixture
def bag(task: PlanningTask, plan: Plan, tmp_path: Path) -> Path:
    record_answer(tmp_path / "bag", task, plan, 0.5)
    return tmp_path / "bag"


def test_it_replays_with_its_body(bag: Path) -> None:
    replayed = replay(only_request(bag))
    assert replayed.verdict is Verdict.IDENTICAL, (replayed.words, *map(str, replayed.differences))


def test_each_phase_has_the_scene_and_the_robot_that_it_was_planned_with(
    bag: Path, task: PlanningTask, plan: Plan, body: TargetBody, captor: int, begins: Array
) -> None:
    drawn = report_of_bag(bag, 1).requests[0]
    assert drawn.plan is not None
    wanted = [one.problem for one, _ in phase_tasks(task, plan)]
    for number, (found, problem) in enumerate(zip(motions_in(bag), wanted, strict=True)):
        scene, robot = found.scene, found.robot
        assert scene is not None
        told = scene_of(problem)
        reported = (drawn.plan, *drawn.then)[number]
        found_ids, told_ids = ({one.id for one in of} for of in (scene.obstacles, told.obstacles))
        assert found_ids == told_ids
        assert reported.obstacles is not None
        for obstacles in (tuple(scene.obstacles), reported.obstacles):
            require_moved(obstacles, begins[number])
        assert mass_of(robot) == pytest.approx(mass_of(problem.robot))
        assert mass_of(reported.robot) == pytest.approx(mass_of(problem.robot))
        for of in (scene, reported.scene):
            assert of.capture_time == pytest.approx(np.diff(begins)[number])
        if number == captor:
            require_body(scene.target_body, tumbled(body, begins[number]))
            place, attitude, _ = tumbled(body, begins[number + 1]).grasp(body)
            for goal in (scene.goal, reported.goal):
                assert goal is not None
                np.testing.assert_allclose(goal.position, place, atol=1e-6)
                assert apart(Rotation.from_quat(goal.quaternion_xyzw), attitude) < 1e-6
        else:
            assert scene.target_body is None


def test_its_bag_tells_when_each_phase_begins_and_where_the_body_is(
    bag: Path, plan: Plan, body: TargetBody, captor: int, begins: Array
) -> None:
    response = only_request(bag).answer
    assert response is not None
    stamps = [nanoseconds(one.joint_trajectory.header.stamp) for one in response.plans]
    since = (np.array(stamps) - stamps[0]) / NANOSECONDS
    np.testing.assert_allclose(since, begins[:-1], atol=2e-9)
    np.testing.assert_allclose(ends_of_phases(response), begins[1:], atol=2e-9)
    pose, error = FramePose(np.zeros(3), Rotation.identity()), PoseError(0.0, 0.0)
    flown = FlownPlan(pose, pose, error, error, np.zeros(0), np.zeros(0))
    assert mission_report(response, [flown])["duration"] == pytest.approx(begins[-1])
    assert plan_from_answer(response).duration == pytest.approx(begins[-1])
    (told,) = read_plans(bag)
    columns = told.columns()
    assert len({len(column) for column in columns.values()}) == 1
    times = columns["time_s"]
    ends = [len(one.trajectory.time) for one in plan.phases]
    rows = np.cumsum([0, *(count - 1 for count in ends)])
    np.testing.assert_allclose(times[rows], begins, atol=2e-9)
    assert told.duration == pytest.approx(begins[-1])
    first, last = rows[captor], rows[captor + 1]
    for part, found in told.target_body.items():
        assert np.isnan(found[:first]).all(), part
        assert np.isfinite(found[first:]).all(), part
    for row in np.linspace(first, last, 5).astype(int):
        there = tumbled(body, times[row])
        place = told.target_body["positions"][row]
        np.testing.assert_allclose(place, there.position, atol=1e-6)
        turned = Rotation.from_quat(told.target_body["quaternions_xyzw"][row])
        assert apart(turned, there.attitude) < 1e-6
        np.testing.assert_allclose(
            told.target_body["angular_velocities"][row], there.twist[3:], atol=1e-8
        )


def test_its_json_has_each_phase_where_it_is_by_then(
    task: PlanningTask, plan: Plan, body: TargetBody, captor: int, begins: Array
) -> None:
    written = json.loads(json.dumps(plan_dictionary(plan, task, 1.0)))
    assert written["time"][-1] == written["duration"] == pytest.approx(begins[-1])
    for number, (_, one) in enumerate(phases_of(written, "plan")):
        scene, motion = planned_scene(one), plan.phases[number].trajectory
        assert scene is not None
        require_moved(tuple(scene.obstacles), begins[number])
        assert scene.capture_time == pytest.approx(np.diff(begins)[number])
        np.testing.assert_array_equal(one["time"], motion.time)
        if number == captor:
            require_body(scene.target_body, tumbled(body, begins[number]))
            for row in (0, 7, -1):
                there = tumbled(body, begins[number] + motion.time[row])
                place = one["target_body"]["positions"][row]
                np.testing.assert_allclose(place, there.position, atol=1e-6)
                rates = one["target_body"]["angular_velocities"][row]
                np.testing.assert_allclose(rates, there.twist[3:], atol=1e-8)
        else:
            assert scene.target_body is None


def test_the_whole_is_told_with_the_capture_when_it_comes(
    task: PlanningTask, plan: Plan, body: TargetBody, captor: int, begins: Array
) -> None:
    scene = whole_scene(task, plan)
    assert scene.target_body is body
    assert scene.capture_time == pytest.approx(begins[captor + 1])
    held = begins[captor + 1] if captor + 1 < len(plan.phases) else np.inf
    assert scene.held_from == pytest.approx(held)


def test_curves_go_through_all_phases(task: PlanningTask, plan: Plan, begins: Array) -> None:
    """The clearance is that from obstacles as they are by then; here one passes far away."""
    stages = stages_of(task, plan)
    rows = [len(one.trajectory.time) for one in plan.phases]
    for name in (ATTITUDE, VELOCITIES, CLEARANCE):
        curves = curves_of(name, stages)
        assert curves is not None
        assert (np.diff(curves.times) >= 0.0).all()
        assert curves.times[[0, -1]] == pytest.approx(begins[[0, -1]])
        if name == VELOCITIES:
            at = np.cumsum([0, *(count - 1 for count in rows)])
            assert curves.times[at] == pytest.approx(begins)


@pytest.mark.parametrize("brings", [("target_body",), ()])
def test_a_request_for_its_scenario_brings_the_body_if_it_shall(
    task: PlanningTask, body: TargetBody, tmp_path: Path, brings: tuple[str, ...]
) -> None:
    """Whichever phase captures it."""
    write_scenario(task, tmp_path / "scenario.yaml")
    request = request_of_scenario(tmp_path / "scenario.yaml", "inertial", brings)
    found = [target_body_from_message(one, "inertial") for one in request.target_body]
    assert [*map(digest_of, found)] == [digest_of(body) for _ in brings]


def test_its_plans_pass_verification(bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["verify", str(bag)]) == 0
    assert capsys.readouterr().out.count("verdict: passed") == 3
