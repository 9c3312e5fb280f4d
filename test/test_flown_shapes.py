"""Plans among bodies of any shape, flown in MuJoCo: nothing touches, and distances are as planned.

MuJoCo has its own links and solids. Distances at the closest moment of a plan are those that MuJoCo
measures in the state that its execution has then.
"""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np
import pytest

from ff_planner_benchmark.problems import shapes
from ff_planner_ros.analysis.nearest import Nearest, nearest
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.scene import scene_of
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.robot.collision.lines import with_bodies
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.simulation.contacts import Touch
from ff_planner_ros.simulation.execution import Execution
from ff_planner_ros.simulation.verification import verify

SETTINGS = load_parameters().planner


@pytest.mark.ci
@pytest.mark.law("PLAN-10")
def test_nothing_touches_in_mujoco_and_distances_are_as_planned(
    times: Callable[[int, int], int],
) -> None:
    """The class `shapes` in turn: five robots, lines too, at rest, moving, turning, captures."""
    for number in range(times(10, 200)):
        problem = shapes.problem(number).problem
        plan = perform(PlanningTask(problem, SETTINGS))
        found = verify(problem.robot, plan.trajectory, scene_of(problem))
        assert found.passed, (number, found.contacts, found.deviation)
        assert found.contacts == ()
        whole = with_bodies(problem.robot)
        assert found.pairs == len(whole.pairs) + len(whole.bodies) * len(problem.obstacles)
        planned = nearest(whole, plan.trajectory, problem.obstacles)
        assert planned is not None
        measured = by_mujoco(problem, plan.trajectory, found.execution, planned)
        assert measured == pytest.approx(planned.distance, abs=1e-4), (number, planned.words)


def by_mujoco(
    problem: PlanningProblem, motion: Trajectory, execution: Execution, planned: Nearest
) -> float:
    """Return the distance of a pair in the state that MuJoCo has come to by then [m]."""
    robot, scene = problem.robot, scene_of(problem)
    touch = Touch(robot, scene)
    row = int(np.abs(motion.time - motion.time[0] - planned.time).argmin())
    none = np.zeros(3)
    state = SystemState(
        execution.chaser_positions[row],
        execution.chaser_quaternions_xyzw[row],
        none,
        none,
        execution.joint_positions[row],
        np.zeros(robot.joints),
    )
    q, _ = configuration(robot, state)
    touch.along([np.concatenate([q[:3], q[[6, 3, 4, 5]], q[7:]])], np.array([planned.time]))
    called = {one.name: f"body {k}" for k, one in enumerate(with_bodies(robot).bodies)}
    obstacles = scene.obstacles
    called |= {one.id: f"obstacle {k}" for k, one in enumerate(obstacles)}
    geoms = [touch._model.geom(called[name]).id for name in planned.pair.split("/")]
    return float(mujoco.mj_geomDistance(touch._model, touch._data, *geoms, 50.0, np.zeros(6)))
