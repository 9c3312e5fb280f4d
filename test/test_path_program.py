"""The core's program of a path against the same by Python: the family, then each requirement."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import fields, replace
from functools import partial
from itertools import islice
from typing import Any
from unittest.mock import patch

import numpy as np
import pinocchio as pin
import pytest
import reference_program
import touching_problems
from core_rows import rows_of_motion
from reference_load_rows import accelerations_at_points
from robots import CONFIG

from ff_planner_benchmark.bench.experiment import OBJECTIVES
from ff_planner_benchmark.problems import (
    all_features,
    captured,
    joint_goals,
    shapes,
    tumbling,
    witnessed,
)
from ff_planner_ros.core.compiled import NAMES_EACH
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.distance.clearance import arm_points, clearances, segments
from ff_planner_ros.planning.distance.grasp_seen import GraspSeen
from ff_planner_ros.planning.motion.system_frame import in_own_frame
from ff_planner_ros.planning.optimisation import program as program_module
from ff_planner_ros.planning.optimisation.evaluated_path import seen
from ff_planner_ros.planning.optimisation.free_program import goal_motion
from ff_planner_ros.planning.optimisation.program import PathProgram, path_program
from ff_planner_ros.planning.problem.approach import Approach
from ff_planner_ros.planning.problem.camera import Camera
from ff_planner_ros.planning.problem.problem import (
    DurationRange,
    Orientation,
    PlanningProblem,
    lasting,
)
from ff_planner_ros.planning.requirements import requirements_of
from ff_planner_ros.planning.requirements.clear_of_itself import ClearOfItself
from ff_planner_ros.planning.requirements.clear_of_obstacles import ClearOfObstacles
from ff_planner_ros.planning.robust.back_off import no_back_off, tighten
from ff_planner_ros.planning.robust.margins import CORRIDOR
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.search.families import path_families
from ff_planner_ros.planning.search.grid import grids_of
from ff_planner_ros.problems import bodies
from ff_planner_ros.problems.robots import ROBOTS, arm_urdf
from ff_planner_ros.problems.scenarios import scenario
from ff_planner_ros.robot.collision.lines import with_bodies
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.dynamics import frame_wrenches, joint_torques
from ff_planner_ros.robot.model import Base, robot_from_urdf_text
from ff_planner_ros.robot.urdf.payload import payload_frame

Drawing = Callable[[], PlanningProblem]
SETTINGS = load_parameters().planner
GUESSES = 3
# Bases of each kind, joints that slide, and a payload.
LOADED = ("witnessed planar", "joint goal, held", "joint goal, rail", "captured, payload stow")


def telescope() -> PlanningProblem:
    """A joint inside the arm slides, out of nothing at the start."""
    slide = '<origin xyz="0 0 0"/><axis xyz="0 0 1"/>'
    slide += '<limit lower="0" upper="0.6" velocity="0.2" effort="80"/></joint>'
    turns = r'(<joint name="joint_4" type=)"revolute">(.*?)<origin [^>]*/><axis .*?</joint>'
    urdf = re.sub(turns, rf'\1"prismatic">\2{slide}', arm_urdf(8))
    robot, rng = robot_from_urdf_text(urdf), np.random.default_rng(9)
    posture = rng.uniform(-1.5, 1.5, robot.joints)
    posture[3] = 0.0
    drawn = witnessed.drawn_problem(robot, posture, Orientation.FIXED, 3, rng)
    assert drawn is not None
    return drawn.problem


def kept_in_view(problem: PlanningProblem, link: str, until: float) -> PlanningProblem:
    """A camera on a link sees the goal to the end or until it is near, along a wide corridor."""
    robot, rng = problem.robot, np.random.default_rng([*link.encode()])
    q, _ = configuration(robot, problem.start)
    model, data = robot.model, robot.model.createData()
    pin.framesForwardKinematics(model, data, q)
    place, aside = rng.normal(scale=0.1, size=(2, 3))
    at = data.oMf[model.getFrameId(link, pin.FrameType.BODY)]
    to_goal = at.actInv(GraspSeen(problem, np.zeros(1)).positions[0]) - place
    axis = to_goal / np.linalg.norm(to_goal) + aside
    in_plane = np.isin(range(3), robot.base.rows)
    goal = pin.Quaternion(problem.target.quaternion_xyzw).toRotationMatrix()
    return replace(
        problem,
        approach=Approach(goal.T @ (in_plane * [0.8, -0.5, 0.3]), 0.4, 0.6),
        camera=Camera(link, place, axis, 0.4, until),
        limits=replace(problem.limits, chaser_rotation=0.3),
    )


def camera_on(place: str, until: float, problem: PlanningProblem) -> PlanningProblem:
    """Put a camera on the base, the link behind the middle joint, or the last link."""
    robot = problem.robot
    joint = robot.model.names[2 + robot.joints // 2]
    links = {
        frame.name: frame.parentJoint
        for frame in robot.model.frames
        if frame.type == pin.FrameType.BODY
    }
    middle = next(link for link, at in links.items() if robot.model.names[at] == joint)
    link = {"base": robot.base_link, "middle": middle, "last link": list(links)[-1]}[place]
    return kept_in_view(problem, link, until)


def seen_on_the_way() -> Iterator[tuple[str, Drawing]]:
    """Yield problems whose cameras are carried by the base, by joints and by slides."""
    drawn: dict[str, Drawing] = {
        name: lambda name=name: scenario("ordinary", name, 1, turned=True).problem
        for name in ("lemur", "arm6", "rail6", "off7")
    }
    drawn["table"] = lambda: load_scenario(CONFIG / "scenarios/planar_capture.yaml")
    for name, draw in drawn.items():
        for place, until in (("base", 0.0), ("middle", 0.5), ("last link", 0.3)):
            yield (
                f"{name}, camera on {place}",
                lambda draw=draw, place=place, until=until: camera_on(place, until, draw()),
            )
    yield "telescope, camera beyond", lambda: kept_in_view(telescope(), "end_effector", 0.2)
    yield "telescope, narrower corridor", narrower_corridor
    for kind in tumbling.KINDS:
        yield (
            f"tumbling {kind}, camera",
            lambda kind=kind: camera_on("base", 0.4, tumbling.problem(kind, 2)),
        )


def narrower_corridor() -> PlanningProblem:
    beyond = kept_in_view(telescope(), "end_effector", 0.2)
    return tighten(beyond, no_back_off(beyond) | {CORRIDOR: np.array([0.01])})


def limited(kind: str, robot: str, number: int) -> PlanningProblem:
    drawn = scenario(kind, robot, number, turned=True).problem
    limits = replace(drawn.limits, joint_velocities=True, chaser_attitude=0.2)
    return replace(drawn, limits=limits)


def with_all_features(number: int) -> PlanningProblem:
    problem = all_features.problem(number).problem
    return lasting(problem, problem.duration_range.maximum)


def drawings() -> Iterator[tuple[str, Drawing]]:
    """Yield problems with every requirement that the core knows, and some that it does not."""
    for number, robot in enumerate(ROBOTS):
        for kind in ("ordinary", "cluttered"):
            yield f"{kind} {robot}", partial(limited, kind, robot, number)
    for number, robot in enumerate(bodies.ROBOTS[:3]):
        yield f"bodies {number}", lambda robot=robot: bodies.problem(robot, 0).problem
    for number in range(6):
        yield f"shapes {number}", lambda number=number: shapes.problem(number).problem
    for kind in tumbling.KINDS:
        yield f"tumbling {kind}", partial(tumbling.problem, kind, 1)
    for kind in witnessed.KINDS:
        yield f"witnessed {kind}", lambda kind=kind: witnessed.drawn(kind, 1).problem
    for kind in joint_goals.KINDS:
        yield f"joint goal, {kind}", lambda kind=kind: joint_goals.problem(kind, 1).problem
    for kind in captured.KINDS:
        yield f"captured, {kind}", lambda kind=kind: captured.problem(kind, 1).problem
    yield "telescope", telescope
    yield from touching_problems.DRAWINGS.items()
    yield from seen_on_the_way()
    for number in range(3):
        yield f"all features {number}", partial(with_all_features, number)


def loaded(problem: PlanningProblem) -> PlanningProblem:
    """Limit accelerations, torques and what the grasp bears to what a path takes of them."""
    problem = in_own_frame(problem)
    ((family, *_), *_), points = path_families(problem, SETTINGS), 50
    motion = family.motion(next(family.first_guesses(problem.obstacles, 13, 0.0)), points)
    step, robot = problem.duration / (points - 1), problem.robot
    accelerations = accelerations_at_points(motion.q[:, 7:], motion.v[:, 6:], step)
    sample, payload = (motion.q, motion.v, accelerations), payload_frame(robot)
    limits = replace(
        problem.limits,
        joint_torques=True,
        joint_accelerations=tuple(1.1 * np.abs(accelerations).max(axis=0) + 1e-3),
    )
    if payload is not None:
        wrenches = frame_wrenches(robot, payload, *sample).reshape(-1, 2, 3)
        force, torque = 1.1 * np.linalg.norm(wrenches, axis=2).max(axis=0)
        limits = replace(limits, grasp_force=force, grasp_torque=torque)
    efforts = 1.1 * np.abs(joint_torques(robot, *sample)).max(axis=0) + 1e-3
    return replace(problem, robot=replace(robot, effort_limits=efforts), limits=limits)


# Drawn by their tests: drawing them all takes longer than any test here.
PROBLEMS = dict(drawings())
for which in LOADED:
    PROBLEMS[f"loaded {which}"] = lambda draw=PROBLEMS[which]: loaded(draw())
# Drawn longer than all others together, with the requirements of "all features 0".
ONCE_MORE = ("all features 1", "all features 2")
DISTANCES = {ClearOfObstacles.name, ClearOfItself.name}


def programs(problem: PlanningProblem) -> Iterator[tuple[PathProgram, np.ndarray]]:
    """Yield programs on coarse and fine grids, corrected ones, too, with paths."""
    for ways in path_families(problem, SETTINGS):
        program = path_program(problem, ways[0], SETTINGS)
        if problem.robot.base is not Base.ATTITUDE_HELD:  # whose paths may be singular
            program = replace(program, margins=program.margins | {"singular_values": 0.05})
        program = program.with_requirements(program.on_demand)
        for grid in grids_of(program, SETTINGS):
            for x in islice(ways[0].first_guesses(problem.obstacles, 13, 0.0), GUESSES):
                yield grid.program, x
                yield grid.with_correction(x).program, x
                yield replace(grid.program, attitude_norm=8.0), x
                yield with_duration(grid.program), x


def with_duration(program: PathProgram) -> PathProgram:
    """Return a program with the duration as one more variable."""
    problem, lasts = program.problem, program.problem.duration
    window = DurationRange(0.8 * lasts, 1.2 * lasts, np.array([0.01, -0.02, 0.005]))
    motion = goal_motion(replace(problem, duration_range=window), lasts)
    return replace(program, family=program.family.lasting(problem, motion))


@pytest.mark.sampled
@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=pytest.mark.ci) if name in ONCE_MORE else name for name in PROBLEMS],
)
def test_the_core_finds_what_the_family_and_the_requirements_find(name: str) -> None:
    problem, defined = in_own_frame(PROBLEMS[name]()), 0
    for number, (program, x) in enumerate(programs(problem)):
        objective = list(OBJECTIVES.values())[number % len(OBJECTIVES)]
        objective = replace(objective, joint_path_length=0.7, wheel_momentum=0.3 * (number % 2))
        program = replace(program, objective=objective)
        with patch.object(program_module, "_rows_by_python", side_effect=AssertionError):
            found = seen(program.evaluate(x))
        expected = reference_program.linearise(program, x)
        assert found.is_defined == expected.is_defined
        if not found.is_defined:
            singular_at = found.motion.singular_at, expected.motion.singular_at
            assert singular_at[0] == pytest.approx(singular_at[1])
            continue
        defined += 1
        for one in fields(expected):
            if one.name != "motion":
                same(getattr(found, one.name), getattr(expected, one.name), f"{name}, {one.name}")
        for part in ("x", "q", "v", "q_half_way", "goal_error"):
            same(getattr(found.motion, part), getattr(expected.motion, part), f"{name}, {part}")
    assert defined > 0


@pytest.mark.parametrize("name", touching_problems.DRAWINGS)
def test_what_may_touch_has_rows_but_where_it_may(name: str) -> None:
    """Of each kind of distance, near the start, near the goal and elsewhere."""
    problem = in_own_frame(PROBLEMS[name]())
    (family, *_), *_ = path_families(problem, SETTINGS)
    x = next(family.first_guesses(problem.obstacles, 13, 0.0))
    asked, without = (
        seen(path_program(each, family, SETTINGS).evaluate(x))
        for each in (problem, replace(problem, allowed_collisions=()))
    )
    for number, required in enumerate(requirements_of(problem)):
        if required.name in DISTANCES:
            few, many = (int((of.names // NAMES_EACH == number).sum()) for of in (asked, without))
            assert 0 < few < many, required.name


def test_a_line_that_slides_out_of_nothing_keeps_its_own_room() -> None:
    """Of the distances at the start half, which grows to the margin, by hand."""
    problem, margin = in_own_frame(telescope()), 0.2
    q_start, _ = configuration(problem.robot, problem.start)
    assert len(segments(arm_points(problem.robot, q_start[None]))) < problem.robot.joints - 2
    (family, *_), *_ = path_families(problem, SETTINGS)
    motion = family.motion(next(family.first_guesses(problem.obstacles, 13, 0.0)), 50)
    asked = ClearOfObstacles().in_core(problem, len(motion.q), margin)
    rows = rows_of_motion(problem.robot, asked, motion)
    lines = np.array([body.joint - 2 for body in with_bodies(problem.robot).bodies])
    at, pair = np.divmod(rows.names, len(lines) * len(problem.obstacles))
    line, sphere = np.divmod(pair, len(problem.obstacles))
    joint = lines[line]

    def distances(q: np.ndarray, times: np.ndarray) -> np.ndarray:
        every = np.arange(problem.robot.joints)
        return clearances(arm_points(problem.robot, q), times, every, problem.obstacles).distance

    q = np.stack([motion.q_half_way, motion.q[1:]], axis=1).reshape(-1, motion.q.shape[1])
    times = np.linspace(0.0, problem.duration, 99)[1:]
    room = 0.5 * distances(q_start[None], np.zeros(1))[0, joint, sphere]
    grown = room + margin * np.minimum(times[at] / (0.25 * problem.duration), 1.0) ** 3
    kept = np.minimum(margin, np.where(room < 0.5 * margin, grown, room))
    assert (kept < margin).any()
    assert rows.values == pytest.approx(distances(q, times)[at, joint, sphere] - kept, abs=1e-12)


def same(found: Any, expected: Any, what: str) -> None:
    """Names are the same, and all else to rounding, but for what bodies in parallel make of it.

    Where an edge lies along another, their nearest points, and with them the derivatives, differ
    by much more than distances do.
    """
    found, expected = np.asarray(found, np.float64), np.asarray(expected, np.float64)
    if what.endswith("equalities_jacobian") and not expected.size:
        return  # of no rows, its columns are not looked at
    assert found.shape == expected.shape, what
    apart = np.abs(found - expected) / max(1.0, float(np.abs(expected).max(initial=0.0)))
    if what.endswith("constraints_jacobian"):
        rows = apart.max(axis=1, initial=0.0) > 1e-4
        assert rows.mean() < 0.03, f"{what}: {np.flatnonzero(rows)} of {len(rows)}"
    else:
        assert apart.max(initial=0.0) < (1e-7 if what.endswith("constraints") else 1e-9), what
