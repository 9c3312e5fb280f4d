"""Each kind of shape in each kind of motion, beside the arm: its bag gives the same plan again.

A body is pushed from outside until the plan of the free scene would hit it, and the plan goes
round. Where it is near the arm, Coal says.
"""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from recorded_requests import only_request
from robots import CONFIG
from shaped_problems import SOLIDS
from shared_plans import planned
from test_tumbling import body_of

from ff_planner_benchmark.problems.placing import Track, beside, free_body, gap_of
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.motion import from_trajectory
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.obstacles import Obstacle, RigidMotion
from ff_planner_ros.planning.problem.problem import PlanningProblem, with_capture_target
from ff_planner_ros.planning.problem.target_body import AttachedObstacle
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.problems.bodies import Swept, sphere_gap
from ff_planner_ros.robot.collision.solids import KINDS, Solid
from ff_planner_ros.runs.offline_bag import record_answer
from ff_planner_ros.runs.replay import Verdict, replay

SETTINGS = load_parameters().planner
SHAPES = {"sphere": Solid("sphere", np.array([0.15])), **SOLIDS}
# Constant twists, linear part first [m/s, rad/s].
TWISTS = {
    "at rest": np.zeros(6),
    "moving": np.array([0.02, 0.01, -0.01, 0.0, 0.0, 0.0]),
    "turning": np.array([0.0, 0.0, 0.0, 0.1, 0.15, 0.05]),
}
FIXED = "fixed to the target"
MOTIONS = (*TWISTS, FIXED)
DAILY = (("turning", 0.0), (FIXED, 3.0))  # of balls, with so many deviations that are kept back
# The direction of the push in the inertial frame, and in body axes in the middle of the plan.
WAY = np.array([0.0, 0.0, -1.0])
TURN = pin.exp3(np.array([0.4, 0.3, 0.2]))
# Bodies come from so far, and the plan of the free scene would go so deep into them [m].
FAR, DEEP = 2.5, 0.02
# The plan round a body passes it as closely as this [m].
NEAR = 0.05


@pytest.fixture(scope="module")
def free() -> PlanningProblem:
    """The capture of a tumbling body, with nothing in the way."""
    problem = load_scenario(CONFIG / "scenarios" / "lemur_tumbling.yaml")
    body = replace(body_of(problem), obstacles=())
    return with_capture_target(body, replace(problem, obstacles=()))


def _swept(problem: PlanningProblem, plan: Plan) -> tuple[Swept, Array]:
    """Return the robot's bodies along a plan, and the times from its first point on."""
    motion = plan.trajectory
    return Swept(problem.robot, from_trajectory(problem.robot, motion)[0]), motion.time


def beside_the_arm(free: PlanningProblem, kind: str, motion: str) -> PlanningProblem:
    """Return the capture with a solid of a kind where the plan of the free scene would hit it."""
    swept, times = _swept(free, planned(free))
    solid, middle = SHAPES[kind], len(times) // 2
    links = [body.link for body in free.robot.bodies]
    at = swept.centers[middle, links.index("link_5")] - FAR * WAY
    if motion != FIXED:
        body = free_body("it", solid, pin.SE3(TURN, at), TWISTS[motion], float(times[middle]))
        laid = beside(swept, times, body, WAY, -DEEP, FAR)
        assert laid is not None
        return replace(free, obstacles=(laid,))
    target = body_of(free)
    seen = target.motion(np.zeros(3), times)
    there = pin.SE3(seen.rotations[middle], seen.positions[middle])
    place, way = there.actInv(pin.SE3(TURN, at)), there.rotation.T @ WAY
    moved = target.motion(place.translation, times)
    track = Track(solid, moved.rotations @ place.rotation, moved.positions, moved.rotations @ way)
    far = track.come(swept, -DEEP, FAR)
    assert far is not None
    to, quaternion = place.translation + far * way, pin.Quaternion(place.rotation).normalized()
    fixed = AttachedObstacle("it", solid, to, quaternion.coeffs())
    return with_capture_target(replace(target, obstacles=(fixed,)), free)


def gap(problem: PlanningProblem, plan: Plan) -> float:
    """Return the smallest distance of the only obstacle from the robot, by Coal [m]."""
    (one,), (swept, times) = problem.obstacles, _swept(problem, plan)
    if not one.is_sphere:
        return gap_of(swept, times, one)
    centers = np.array([one.center + one.motion.way(float(time)) for time in times])
    return sphere_gap(swept, one, np.inf, centers)


def require_motion(one: Obstacle, motion: str, duration: float) -> None:
    """Require that an obstacle moves as is said: it goes, turns, does both or nothing."""
    assert (one.body is not None) == (motion == FIXED)
    if one.is_sphere:
        assert bool(one.motion.way(duration).any()) == (motion in ("moving", FIXED))
        return
    rotations, positions = one.motion.poses(np.array([0.0, duration]))
    assert bool((positions[0] != positions[1]).any()) == (motion in ("moving", FIXED))
    assert bool((rotations[0] != rotations[1]).any()) == (motion in ("turning", FIXED))


def verdict_of(task: PlanningTask, plan: Plan, bag: Path) -> Verdict:
    """Record a plan, require that its bag has the task, and plan it again from that alone."""
    record_answer(bag, task, plan, 0.5)
    recorded = only_request(bag)
    assert recorded.planned_task().digest == task.digest
    return replay(recorded).verdict


def test_the_shapes_are_of_every_kind_that_there_is() -> None:
    assert set(SHAPES) == {solid.kind for solid in SHAPES.values()} == set(KINDS)


@pytest.mark.law("BAG-02")
@pytest.mark.sampled
@pytest.mark.parametrize(("kind", "motion"), list(itertools.product(SHAPES, MOTIONS)))
def test_a_shape_that_the_arm_goes_round_replays_to_the_last_bit(
    kind: str, motion: str, free: PlanningProblem, tmp_path: Path
) -> None:
    problem = beside_the_arm(free, kind, motion)
    (one,) = problem.obstacles
    assert one.solid.kind == kind
    require_motion(one, motion, problem.duration)
    assert gap(problem, planned(free)) < 0.0
    task = PlanningTask(problem, SETTINGS)
    plan = perform(task)
    assert 0.0 < gap(problem, plan) < NEAR
    assert verdict_of(task, plan, tmp_path / "bag") is Verdict.IDENTICAL


@pytest.mark.law("BAG-02")
@pytest.mark.parametrize(
    ("motion", "sigmas"),
    [
        pytest.param(motion, sigmas, marks=() if (motion, sigmas) in DAILY else pytest.mark.ci)
        for motion, sigmas in itertools.product(MOTIONS, (0.0, 3.0))
    ],
)
def test_a_ball_that_is_written_as_a_body_is_the_sphere_that_it_is(
    motion: str, sigmas: float, free: PlanningProblem, tmp_path: Path
) -> None:
    """The same plan, with and without deviations that are kept back, and the same again."""
    sphere = beside_the_arm(free, "sphere", motion)
    (one,) = sphere.obstacles
    ball, turn = Solid("sphere", np.array([one.radius])), pin.Quaternion(TURN).coeffs()
    if motion == FIXED:
        fixed = AttachedObstacle("it", ball, one.motion.lever, turn)
        problem = with_capture_target(replace(body_of(free), obstacles=(fixed,)), free)
    else:
        body = Obstacle(
            "it", ball, RigidMotion(one.center, turn, one.motion.velocity, TWISTS[motion][3:])
        )
        problem = replace(free, obstacles=(body,))
    settings = replace(SETTINGS, robust=replace(SETTINGS.robust, sigmas=sigmas))
    task = PlanningTask(problem, settings)
    plan, expected = perform(task), perform(PlanningTask(sphere, settings))
    for name in ("joint_positions", "joint_velocities", "joint_torques"):
        assert (getattr(plan.trajectory, name) == getattr(expected.trajectory, name)).all(), name
    assert verdict_of(task, plan, tmp_path / "bag") is Verdict.IDENTICAL
