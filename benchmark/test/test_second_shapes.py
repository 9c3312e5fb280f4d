"""Plans among obstacles of every kind, flown in Drake, with solids and distances of its own."""

import numpy as np
import pytest
from robots import CONFIG

from ff_planner_benchmark.problems import shapes
from ff_planner_ros.analysis.nearest import nearest
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.problem.problem import Obstacle
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.problems import bodies
from ff_planner_ros.robot.collision.lines import with_bodies

pytestmark = pytest.mark.ci

pytest.importorskip("pydrake", reason="pip install './benchmark[drake]' brings Drake")

EXACT = 1e-4  # [m]


@pytest.mark.nightly
@pytest.mark.law("PLAN-10", "PLAN-22")
def test_nothing_touches_in_drake_and_distances_are_as_planned(times):
    """The class `shapes` in turn: five robots, lines too, at rest, moving, turning, captures."""
    for number in range(times(7, 100)):
        require_distances_in_drake(shapes.problem(number).problem)


@pytest.mark.law("PLAN-10", "PLAN-22")
def test_nothing_touches_among_spheres_either_fixed_to_a_body_that_tumbles_or_not():
    for name in bodies.ROBOTS:
        require_distances_in_drake(bodies.problem(name, 0).problem)
    require_distances_in_drake(load_scenario(CONFIG / "scenarios/lemur_tumbling.yaml"))


def test_what_is_in_the_way_touches_in_drake():
    problem = shapes.problem(0).problem
    motion = planned(problem)
    row = len(motion.time) // 2
    there = Obstacle.sphere("there", motion.ee_positions[row], 0.01)
    seen = flown(problem.robot, motion, [there])
    touched = {pair for pair, distance in seen[row].items() if distance < 0.0}
    assert touched
    assert all(pair.endswith("/there") for pair in touched)


def require_distances_in_drake(problem):
    """Plan and fly it: nothing touches at any point, and the closest pair is as far as planned."""
    robot, motion = with_bodies(problem.robot), planned(problem)
    closest = nearest(robot, motion, problem.obstacles)
    seen = flown(robot, motion, problem.obstacles)
    pairs = len(robot.pairs) + len(robot.bodies) * len(problem.obstacles)
    assert [len(distances) for distances in seen] == [pairs] * len(motion.time)
    assert min(min(distances.values()) for distances in seen) > 0.0, closest.words
    then = seen[int(np.abs(motion.time - closest.time).argmin())]
    assert then[closest.pair] == pytest.approx(closest.distance, abs=EXACT), closest.words
    assert min(then.values()) == pytest.approx(closest.distance, abs=EXACT), closest.words


def planned(problem):
    return perform(PlanningTask(problem, load_parameters().planner)).trajectory


def flown(robot, motion, obstacles):
    """Return the distances of all pairs at each point of a motion that Drake executes."""
    from ff_planner_benchmark.second_engine import flown_in_drake
    from ff_planner_benchmark.second_shapes import Shapes

    solids, seen = Shapes(robot, obstacles), []
    flown_in_drake(robot, motion, lambda links, time: seen.append(solids.distances(links, time)))
    return seen
