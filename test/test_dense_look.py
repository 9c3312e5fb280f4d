"""What is certified of plans, against a look at 20,001 times.

The motion is integrated at all of them. Pinocchio says where bodies and the ends of lines are, Coal
how far they are apart. From one time to another a distance changes by no more than both have gone,
so that few need be measured.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin
import pytest
from robots import CONFIG

from ff_planner_benchmark.problems import joint_goals, tumbling
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.distance.body_certificate import CHECK_GAP
from ff_planner_ros.planning.motion.followed import followed
from ff_planner_ros.planning.motion.joint_motion import joint_motion
from ff_planner_ros.planning.motion.motion import from_trajectory
from ff_planner_ros.planning.problem.problem import Obstacle, PlanningProblem, RigidMotion
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.robot.collision.solids import Solid

SETTINGS = load_parameters().planner
TIMES, COARSE = 20_001, 100
ALONG_Z = np.array([0.0, 0.0, 1.0])


class Track(NamedTuple):
    """A solid at all times, and what bounds its distances."""

    solid_at: Callable[[int], tuple[coal.CollisionGeometry, pin.SE3]]
    center: Array  # of a sphere around it; shape (times, 3) [m]
    radius: float
    gone: Array  # how far any point went since the first time, at most; shape (times,) [m]


def rigid(solid: coal.CollisionGeometry, poses: Sequence[pin.SE3]) -> Track:
    solid.computeLocalAABB()
    middle, radius = np.array(solid.aabb_center), float(solid.aabb_radius)
    centers = np.array([pose.act(middle) for pose in poses])
    axes = np.array([pose.rotation for pose in poses])
    turned = np.linalg.norm(np.diff(axes, axis=0), axis=(1, 2))
    steps = np.linalg.norm(np.diff(centers, axis=0), axis=1) + radius * turned
    gone = np.append(0.0, np.cumsum(steps))
    return Track(lambda at: (solid, poses[at]), centers, radius, gone)


def line(begin: Array, end: Array) -> Track:
    def solid_at(at: int) -> tuple[coal.CollisionGeometry, pin.SE3]:
        along = end[at] - begin[at]
        turn = pin.Quaternion.FromTwoVectors(ALONG_Z, along).matrix()
        middle = (begin[at] + end[at]) / 2
        return coal.Capsule(0.0, float(np.linalg.norm(along))), pin.SE3(turn, middle)

    steps = np.maximum(*(np.linalg.norm(np.diff(one, axis=0), axis=1) for one in (begin, end)))
    radius = float(np.linalg.norm(end - begin, axis=1).max()) / 2
    return Track(solid_at, (begin + end) / 2, radius, np.append(0.0, np.cumsum(steps)))


def tracks(problem: PlanningProblem, q: Array) -> list[Track]:
    """Return the robot's bodies, or its lines."""
    robot, data = problem.robot, problem.robot.model.createData()
    poses, ends = list[list[pin.SE3]](), list[list[Array]]()
    for at in q:
        pin.forwardKinematics(robot.model, data, at)
        poses.append([data.oMi[one.joint] * one.placement_in_joint for one in robot.bodies])
        tip = pin.updateFramePlacement(robot.model, data, robot.tip_frame_id)
        joints = [data.oMi[2 + k].translation.copy() for k in range(robot.joints)]
        ends.append([*joints, tip.translation.copy()])
    if robot.bodies:
        every = zip(robot.bodies, zip(*poses, strict=True), strict=True)
        return [rigid(body.solid, at) for body, at in every]
    places = np.array(ends)
    lengths = np.linalg.norm(np.diff(places, axis=1), axis=2).max(axis=0)
    return [line(places[:, k], places[:, k + 1]) for k in np.flatnonzero(lengths > 1e-6)]


def least(first: Track, second: Track, best: float) -> float:
    """Return the least distance of two, if it is less than the best so far."""
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    request.enable_signed_distance, request.gjk_tolerance = True, 1e-8

    def measure(at: int) -> float:
        (one, here), (other, there) = first.solid_at(at), second.solid_at(at)
        places = (coal.Transform3s(pose.rotation, pose.translation) for pose in (here, there))
        return float(coal.distance(one, next(places), other, next(places), request, result))

    low = np.linalg.norm(first.center - second.center, axis=1) - first.radius - second.radius
    if low.min() >= best:
        return best
    coarse, gone = np.arange(0, len(low), COARSE), first.gone + second.gone
    found = np.array([measure(at) for at in coarse])
    before = np.arange(len(low)) // COARSE
    after = np.minimum(before + 1, len(coarse) - 1)
    low = np.maximum(low, found[before] - (gone - gone[coarse[before]]))
    later = found[after] - (gone[coarse[after]] - gone)
    low = np.maximum(low, np.where(after > before, later, low))
    best = min(best, float(found.min()))
    for at in np.argsort(low):
        if low[at] >= best:
            break
        best = min(best, measure(int(at)))
    return best


def scenario(name: str) -> PlanningProblem:
    return load_scenario(Path(CONFIG) / "scenarios" / f"{name}.yaml")


def among_boxes(problem: PlanningProblem) -> PlanningProblem:
    """Boxes inside the spheres: one moves, one turns, one rests."""
    spins = ([0.0, 0.0, 0.0], [0.0, 0.3, 0.2], [0.0, 0.0, 0.0])
    drifts = ([0.0, 0.002, -0.001], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0])
    boxes = tuple(
        Obstacle(
            one.id,
            Solid("box", np.full(3, 1.1 * one.radius)),
            RigidMotion(one.motion.position, velocity=drift, angular_velocity=spin),
        )
        for one, drift, spin in zip(problem.obstacles, drifts, spins, strict=True)
    )
    return replace(problem, obstacles=boxes)


PROBLEMS: dict[str, Callable[[], PlanningProblem]] = {
    "lines among spheres": lambda: scenario("lemur_capture"),
    "lines among boxes that move": lambda: among_boxes(scenario("lemur_capture")),
    "bodies among spheres": lambda: scenario("lemur_capture_bodies"),
    "bodies among boxes that move": lambda: among_boxes(scenario("lemur_capture_bodies")),
    "lines at what tumbles": lambda: tumbling.problem("tumbling", 0),
    "lines that slide": lambda: joint_goals.problem("rail", 0).problem,
}


@pytest.mark.sampled
@pytest.mark.law("PLAN-09")
@pytest.mark.parametrize("name", PROBLEMS)
def test_no_time_shows_less_than_is_certified_and_hardly_more_at_the_nearest(name: str) -> None:
    problem = PROBLEMS[name]()
    plan = perform(PlanningTask(problem, SETTINGS))
    assert not problem.allowed_collisions
    q, v = from_trajectory(problem.robot, plan.trajectory)
    joints = joint_motion(plan.trajectory)
    steps = -(-(TIMES - 1) // (len(joints.time) - 1))
    motion = followed(problem.robot, q[0], v[0], joints, multiple=steps)
    assert len(motion.time) >= TIMES
    parts, clearance, of_pairs = tracks(problem, motion.q), np.inf, np.inf
    for one in problem.obstacles:
        poses = [pin.SE3(*at) for at in zip(*one.motion.poses(motion.time), strict=True)]
        beside = rigid(one.solid.geometry, poses)
        for part in parts:
            clearance = least(part, beside, clearance)
    for first, second in problem.robot.pairs:
        of_pairs = least(parts[first], parts[second], of_pairs)
    for dense, certified in (
        (clearance, plan.metrics.min_clearance),
        (of_pairs, plan.metrics.min_self_clearance),
    ):
        if np.isfinite(dense) or np.isfinite(certified):
            assert dense - CHECK_GAP - 1e-6 <= certified <= dense
