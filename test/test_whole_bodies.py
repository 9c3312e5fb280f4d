"""Along a plan no body touches what it must not: Pinocchio and Coal say so apart from our code."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import count, islice

import numpy as np
import pytest
from whole_bodies import WholeBodies, judge_of

from ff_planner_benchmark.bench.experiment import OBJECTIVES
from ff_planner_benchmark.bench.touching import touching
from ff_planner_ros.errors import NoPlanFound
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.distance.clearance import arm_points, clearances, segments
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.problems import bodies
from ff_planner_ros.problems.robots import bench_robot
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Robot

SETTINGS = load_parameters().planner


@pytest.fixture(scope="module")
def judges(tmp_path_factory: pytest.TempPathFactory) -> dict[str, WholeBodies]:
    directory = tmp_path_factory.mktemp("urdfs")
    return {robot: judge_of(robot, directory) for robot in bodies.ROBOTS}


def pairs_of(robot: Robot) -> set[frozenset[str]]:
    return {frozenset((robot.bodies[a].link, robot.bodies[b].link)) for a, b in robot.pairs}


@pytest.mark.parametrize("name", bodies.ROBOTS)
def test_the_planner_has_the_pairs_that_are_written_out(
    name: str, judges: dict[str, WholeBodies]
) -> None:
    robot, judge = bodies.problem(name, 0).problem.robot, judges[name]
    links = {number: link for link, numbers in judge.solids.items() for number in numbers}
    assert pairs_of(robot) == {frozenset((links[a], links[b])) for a, b in judge.pairs}


@pytest.mark.ci
@pytest.mark.sampled
@pytest.mark.parametrize("name", bodies.ROBOTS)
def test_a_plan_of_lines_touches_what_bench_says(
    name: str, judges: dict[str, WholeBodies], times: Callable[[int, int], int]
) -> None:
    """So the judge can fail a plan."""
    some = False
    beginning = (number for number in count() if begins_outside_as_lines(name, number))
    for number in islice(beginning, times(1, 10)):
        problem = bodies.problem(name, number).problem
        as_lines = replace(problem, robot=bench_robot(name))
        try:
            motion = perform(PlanningTask(as_lines, SETTINGS)).trajectory
        except NoPlanFound:  # that one is found is test_bench_success.py's law
            continue
        found = judges[name].touching(motion, problem.obstacles)
        told = touching(problem.robot, motion, problem.obstacles)
        assert set(found) == {link_names(problem.robot, pair) for pair in told}, (name, number)
        some = some or bool(found)
    assert some or name != "arm6"


def begins_outside_as_lines(name: str, number: int) -> bool:
    """Whether a scenario has a plan of lines at all: it is drawn for shapes.

    A boom of Canadarm2 runs beside the line from joint to joint, so that the line may begin in a
    sphere that the boom is far from.
    """
    problem = bodies.problem(name, number).problem
    q, _ = configuration(problem.robot, problem.start)
    points = arm_points(problem.robot, q[None])
    found = clearances(points, np.zeros(1), segments(points), problem.obstacles)
    return bool(found.distance.min() > 0.0)


def link_names(robot: Robot, pair: str) -> str:
    links = {body.name: body.link for body in robot.bodies}
    return "/".join(links.get(name, name) for name in pair.split("/"))


@pytest.mark.law("PLAN-08")
def test_no_plan_of_shapes_touches_anything(
    judges: dict[str, WholeBodies], times: Callable[[int, int], int]
) -> None:
    planned = 0
    for number in range(times(1, 20)):
        for name in bodies.ROBOTS:
            for called in list(OBJECTIVES)[: times(1, 3)]:
                drawn = bodies.problem(name, number).problem
                problem = replace(drawn, objective=OBJECTIVES[called])
                try:
                    motion = perform(PlanningTask(problem, SETTINGS)).trajectory
                except NoPlanFound:
                    continue
                planned += 1
                found = judges[name].touching(motion, problem.obstacles)
                assert not found, (name, number, called, found)
    assert planned >= times(2, 120)
