"""Problems drawn as others publish theirs: random starts, and tumbling targets."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from ff_planner_benchmark.bench import columns
from ff_planner_benchmark.bench.experiment import Experiment, Row, Rows, attempt, is_solved
from ff_planner_benchmark.problems import joint_goals, tumbling
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.camera import Camera
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.robot.model import Base

# Of random starts with momentum: the chaser drifts and turns so fast, in any direction.
_DRIFT, _SPIN = 0.01, np.deg2rad(0.5)  # m/s, rad/s
# Random starts are as many as in the publication. Tumbling targets begin where the benchmark's,
# which the planner was made with, have ended.
_RANDOM_STARTS, _FIRST_TUMBLING = 50, 1000
# The view of a camera in the chaser's centre of mass, about where the grasp is at the start.
_HALF_ANGLE, _UNTIL = np.deg2rad(35.0), 0.1  # rad, m


def held(number: int) -> PlanningProblem:
    """As Misra and Bai have it: at rest, with a chaser that does not turn."""
    return joint_goals.problem("random start", number).problem


def free(number: int) -> PlanningProblem:
    """The same with a chaser that turns as the arm makes it turn."""
    problem = held(number)
    return replace(problem, robot=replace(problem.robot, base=Base.FREE_FLYER, wheels=None))


def moving(number: int) -> PlanningProblem:
    """The same with linear and angular momentum."""
    problem, rng = free(number), np.random.default_rng([17, number])
    drift, spin = (one / np.linalg.norm(one) for one in rng.normal(size=(2, 3)))
    start = replace(
        problem.start,
        linear_velocity_chaser_in_inertial=_DRIFT * drift,
        angular_velocity_chaser_in_inertial=_SPIN * spin,
    )
    return replace(problem, start=start)


def tumbling_target(number: int) -> PlanningProblem:
    """A body that tumbles at 1 to 5 deg/s, with parts that are in the way."""
    return tumbling.problem("tumbling", _FIRST_TUMBLING + number)


def tumbling_in_view(number: int) -> PlanningProblem:
    """The same, and the chaser sees the grasp until it is near."""
    problem = tumbling_target(number)
    robot, start, body = problem.robot, problem.start, problem.target_body
    if body is None:
        raise ValueError("there is no target body")
    grasp = body.grasp(np.zeros(1)).positions[0] - start.position_chaser_in_inertial
    turned = Rotation.from_quat(start.quaternion_chaser_to_inertial_xyzw.copy())
    axis = robot.rotation_chaser_to_base @ turned.inv().apply(grasp)
    place = robot.position_chaser_in_base
    return replace(problem, camera=Camera(robot.base_link, place, axis, _HALF_ANGLE, _UNTIL))


CLASSES: dict[str, Callable[[int], PlanningProblem]] = {
    "random start, held, at rest": held,
    "random start, free, at rest": free,
    "random start, free, moving": moving,
    "tumbling target": tumbling_target,
    "tumbling target, in view": tumbling_in_view,
}


def _attempts(count: int, settings: PlannerSettings) -> Iterator[Row]:
    for name, draw in CLASSES.items():
        for index in range(min(count, _RANDOM_STARTS) if "random" in name else count):
            yield attempt(PlanningTask(draw(index), settings), _measured, kind=name, number=index)


def _measured(made: Plan | None) -> Row:
    error = made.metrics.final_position_error if made else None
    return {"programs": made.solver.iterations if made else None, "error": error}


def _causes(rows: Rows) -> str:
    causes = Counter(row["status"] for row in rows if not is_solved(row))
    return ", ".join(f"{some} {cause}" for cause, some in causes.most_common()) or "-"


COMPARISONS = Experiment(
    "comparisons",
    "Problems as others publish theirs",
    _attempts,
    {"class": "kind"},
    {
        "problems": columns.count,
        "with a plan": columns.number_of(is_solved),
        **columns.TIMES,
        **columns.WORST,
        "convex programs, mean": columns.value("programs", np.mean, ".1f"),
        "largest error [m]": columns.value("error", max, ".0e"),
        "why there was none": _causes,
    },
    most=300,
)
