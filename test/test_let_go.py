"""After a capture the tool touches what it grasped: the next plan begins by letting go of it."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from bodied_robots import lemur_with_bodies
from core_rows import rows_of_motion
from handmade_plans import SETTINGS, arm, made, resting
from reference_distance_rows import looked_at
from robots import CONFIG
from scipy.spatial.transform import Rotation
from test_limits_by_hand import PLACE
from test_near_starts import end_of

from ff_planner_ros.analysis.plan_document import planned_scene
from ff_planner_ros.analysis.plan_json import plan_dictionary
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.check.check import measure
from ff_planner_ros.planning.check.preconditions import require_plannable
from ff_planner_ros.planning.distance.allowed_contact import after_contact
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.obstacles import Obstacle, RigidMotion
from ff_planner_ros.planning.problem.posture import Posture
from ff_planner_ros.planning.problem.problem import PlanningProblem, Target
from ff_planner_ros.planning.problem.scene import scene_of
from ff_planner_ros.planning.requirements.clear_of_obstacles import ClearOfObstacles
from ff_planner_ros.planning.requirements.requirement import Samples
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.scenario.scenario_writer import write_scenario
from ff_planner_ros.planning.search.families import path_families
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.robot.collision.solids import Solid
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.simulation.verification import verify

GRASPED = "link_7/ring_0"


def freed(one: Obstacle, time: float) -> Obstacle:
    """What was fixed to a body, as it is at a time, at rest."""
    rotations, positions = one.motion.poses(np.array([time]))
    attitude = pin.Quaternion(rotations[0]).coeffs()
    return Obstacle(one.id, one.solid, RigidMotion(positions[0], attitude))


@cache
def captured() -> PlanningProblem:
    """Where the capture of the client with panels ends, at rest: back to how the arm was before."""
    capture = load_scenario(CONFIG / "scenarios" / "panel_capture.yaml")
    ended = end_of(capture, perform(PlanningTask(capture, SETTINGS)))
    still = np.zeros(3)
    start = replace(
        ended.start,
        linear_velocity_chaser_in_inertial=still,
        angular_velocity_chaser_in_inertial=still,
        joint_velocities=np.zeros(7),
        joint_accelerations=None,
    )
    return replace(
        ended,
        start=start,
        target_body=None,
        obstacles=tuple(
            freed(one, capture.duration) for one in capture.obstacles if not one.is_sphere
        ),
        posture=Posture(positions=capture.start.joint_positions),
        allowed_collisions=(GRASPED,),
    )


@cache
def let_go() -> Plan:
    return perform(PlanningTask(captured(), SETTINGS))


def retreated() -> PlanningProblem:
    """The same, the end effector 0.3 m further back."""
    problem = replace(captured(), posture=None)
    robot, data = problem.robot, problem.robot.model.createData()
    pin.forwardKinematics(robot.model, data, configuration(robot, problem.start)[0])
    tip = pin.updateFramePlacement(robot.model, data, robot.tip_frame_id)
    back = tip.translation - 0.3 * tip.rotation[:, 2]
    return replace(problem, target=Target(back, pin.Quaternion(tip.rotation).coeffs()))


@pytest.mark.parametrize("goal", ["posture", pytest.param("pose", marks=pytest.mark.ci)])
def test_what_is_grasped_is_let_go_of_and_nothing_else_is_touched(goal: str) -> None:
    problem = captured() if goal == "posture" else retreated()
    plan = let_go() if goal == "posture" else perform(PlanningTask(problem, SETTINGS))
    assert plan.metrics.min_clearance > 0.0
    scene = scene_of(problem)
    assert verify(problem.robot, plan.trajectory, scene).contacts == ()
    # By MuJoCo alone: they touch at first, and no later than 0.1 m from there.
    (touched,) = verify(
        problem.robot, plan.trajectory, replace(scene, allowed_collisions=())
    ).contacts
    assert (touched.pair, touched.first_time) == (GRASPED, 0.0)
    early = replace(scene, contact_distance=1e-3)
    (touched,) = verify(problem.robot, plan.trajectory, early).contacts
    assert touched.first_time > 0.0


def test_what_is_let_go_of_at_the_last_moment_alone_is_measured_then() -> None:
    """One time is left of the motion: its distance then is the least, by check and search."""
    plan, (obstacle,) = let_go(), [one for one in captured().obstacles if one.id == "ring_0"]
    low, high = 1e-3, 10.0
    while True:
        problem = replace(captured(), contact_distance=(low + high) / 2)
        motion = Samples(problem, SETTINGS, plan.trajectory).followed
        last = len(motion.time) - 1
        first = after_contact(problem, obstacle, motion.time, motion.q)
        if first == last:
            break
        low, high = (
            (low, problem.contact_distance) if first > last else (high - (high - low) / 2, high)
        )
    metrics = measure(problem, plan.trajectory, SETTINGS)
    assert 0.0 < metrics.min_clearance < np.inf
    assert ClearOfObstacles().slack(problem, motion) > 0.0


def test_a_robust_plan_lets_go_of_what_is_grasped() -> None:
    withstood = replace(SETTINGS.robust, sigmas=2.0)
    plan = perform(PlanningTask(captured(), replace(SETTINGS, robust=withstood)))
    assert plan.robust is not None
    assert plan.robust.least_sigmas > 2.0
    assert plan.metrics.min_clearance > 0.0


def test_the_search_asks_nothing_of_what_is_touched_until_it_has_gone_so_far() -> None:
    problem = captured()
    family = path_families(problem, SETTINGS)[0][0]
    motion = family.motion(let_go().coefficients, problem.points)
    robot, others = problem.robot, len(problem.obstacles)
    ring = [one.id for one in problem.obstacles].index("ring_0")
    tool = [number for number, body in enumerate(robot.bodies) if body.link == "link_7"]

    def asked(problem: PlanningProblem) -> set[int]:
        required = ClearOfObstacles().in_core(problem, problem.points, 0.002)
        found = rows_of_motion(robot, required, motion)
        at, numbers = np.divmod(found.names, len(robot.bodies) * others)
        return set(at[np.isin(numbers, np.array(tool) * others + ring)].tolist())

    tips = [arm(robot, q)[-1] for q in looked_at(problem, motion)[1]]
    ways = [np.linalg.norm(tip - tips[0]) for tip in tips]
    first = int(np.flatnonzero(np.array(ways) > 0.09)[0])
    assert asked(problem) == {
        one for one in asked(replace(problem, allowed_collisions=())) if one >= first
    }
    assert first > 3


def test_another_contact_at_the_start_is_refused() -> None:
    for allowed in ((), ("link_7/ring_1",), ("link_5/ring_0",)):
        with pytest.raises(InvalidInput, match="is around link_7") as refused:
            require_plannable(replace(captured(), allowed_collisions=allowed), SETTINGS)
        assert refused.value.status is Status.START_IN_COLLISION
        assert refused.value.field == "obstacles[ring_0]"
    require_plannable(captured(), SETTINGS)


@pytest.mark.sampled
@pytest.mark.parametrize("way", [0.8, 0.02])
@pytest.mark.parametrize("is_back", [True, False])
@pytest.mark.parametrize("goal", ["pose", "posture"])
def test_a_plan_may_touch_until_it_has_gone_so_far_and_not_again(
    goal: str, way: float, is_back: bool
) -> None:
    """An arm whose tool is in a ball turns away, and perhaps back; its goal is elsewhere."""
    joints = resting(np.linspace(-0.9, 1.2, 7))
    joints = joints.swelling(0, 4, way) if is_back else joints.stepping(0, 4, way)
    found = made(lemur_with_bodies(), joints, np.zeros(6), PLACE)
    robot = found.problem.robot
    tips = np.array([arm(robot, q)[-1] for q in found.q])
    ball, furthest = (
        Obstacle.sphere("ball", tips[0], 0.02),
        np.linalg.norm(tips - tips[0], axis=1).max(),
    )
    elsewhere = replace(found.problem.target, position=tips[-1] + 9.0)
    links = {body.link for body in robot.bodies}
    for distance in (0.005, 0.3, 9.0):
        told = found.judged(
            obstacles=(ball,),
            allowed_collisions=tuple(f"{link}/ball" for link in links),
            contact_distance=distance,
            target=elsewhere,
            posture=Posture(positions=joints.positions[-1]) if goal == "posture" else None,
        )
        touches = [one.finding for one in told if "ball" in one.finding]
        # The tool is thicker than 5 mm: it still touches there.
        assert bool(touches) is bool(furthest > distance and (is_back or distance < 0.1)), touches
    assert furthest > 0.3 if way > 0.1 else furthest < 0.3


def test_how_far_it_has_gone_is_seen_from_what_it_touches() -> None:
    """All by the books: an arm at rest on a chaser that turns and drifts."""
    found = made(
        lemur_with_bodies(),
        resting(np.linspace(-0.9, 1.2, 7)),
        np.array([0.02, -0.01, 0.03, 0.0, 0.1, 0.05]),
        PLACE,
    )
    problem, times, q = found.problem, found.time, found.q
    tips = np.array([arm(problem.robot, one)[-1] for one in q])
    rng = np.random.default_rng(5)
    turn, drift, origin = rng.normal(size=3) * 0.1, rng.normal(size=3) * 0.02, tips[0] + 0.1
    box = Solid("box", np.full(3, 0.4))
    body = Obstacle("box", box, RigidMotion(origin, [0.5, -0.5, 0.5, 0.5], drift, turn))
    seen = np.array(
        [
            Rotation.from_rotvec(time * turn).inv().apply(tip - origin - time * drift)
            for time, tip in zip(times, tips, strict=True)
        ]
    )
    ways = np.linalg.norm(seen - seen[0], axis=1)
    assert ways.max() > 0.1
    for distance in (0.02, 0.05, 0.1):
        asked = replace(problem, obstacles=(body,), contact_distance=distance)
        first = int(np.flatnonzero(ways > distance)[0])
        assert after_contact(asked, body, times, q) == first
        assert after_contact(asked, body, times[first:], q[first:]) == 0
        # Seen from the base the tool stays where it is.
        assert after_contact(asked, None, times, q) == len(times)
    ball = Obstacle.sphere("ball", tips[0], 0.1, drift)
    ways = np.linalg.norm(tips - tips[0] - times[:, None] * drift, axis=1)
    asked = replace(problem, obstacles=(ball,), contact_distance=0.03)
    assert after_contact(asked, ball, times, q) == int(np.flatnonzero(ways > 0.03)[0])


def test_contacts_at_the_start_of_a_goal_of_the_joints_are_in_files_and_answers(
    tmp_path: Path,
) -> None:
    task = PlanningTask(captured(), SETTINGS)
    write_scenario(task, tmp_path / "stow.yaml")
    read = load_scenario(tmp_path / "stow.yaml")
    assert (read.allowed_collisions, read.contact_distance) == ((GRASPED,), 0.1)
    answer = plan_dictionary(let_go(), task, 0.1)
    scene = planned_scene(json.loads(json.dumps(answer)))
    assert scene is not None
    assert tuple(scene.allowed_collisions) == (GRASPED,)
