"""Success rate and time of the planner on problems that are known to have a plan."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ff_planner_benchmark.bench.measurement import (
    Attempt,
    Measurement,
    median,
    misses,
    solved_and_times,
    timed_plan,
)
from ff_planner_benchmark.problems import all_features, joint_goals, shapes
from ff_planner_ros.common.text_table import Table
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.problems.robots import ROBOTS
from ff_planner_ros.problems.scenarios import KINDS, scenario

_HEADER = (
    *("class", "which", "scenarios", "solved"),
    *("median [s]", "95 % [s]", "worst [s]", "starts"),
)
_SHAPES_HEADER = ("which", "problems", *_HEADER[3:])
_ALL_FEATURES_HEADER = (
    *("robot", "problems", "solved", "median [s]", "90 % [s]", "95 % [s]", "worst [s]"),
    "duration / reference's, median",
)


@dataclass(frozen=True)
class ScenarioAttempt(Attempt):
    """The planner's result on one scenario; solved only if its plan passes the check once more."""

    kind: str  # key of `KINDS`
    robot: str
    number: int
    turned: bool  # whether its inertial frame is turned
    starts: int  # initial guesses tried; 0 for a miss


def measurement(count: int, settings: PlannerSettings) -> Measurement:
    """Plan `count` scenarios of each class, and tabulate the results."""
    tried = [attempt for kind in KINDS for attempt in attempts(kind, count, settings)]
    groups: list[tuple[str, Callable[[ScenarioAttempt], bool]]] = [("all", lambda _: True)]
    groups += [(robot, lambda a, robot=robot: a.robot == robot) for robot in ROBOTS]  # type: ignore[misc]
    groups += [("as drawn", lambda a: not a.turned), ("frame turned", lambda a: a.turned)]
    rows = [
        (kind, name, *_summary([a for a in tried if a.kind == kind and belongs(a)]))
        for kind in KINDS
        for name, belongs in groups
    ]
    name = "{0.kind} {0.robot} {0.number}"
    missed = misses([a for a in tried if not a.turned], name)
    missed += misses([a for a in tried if a.turned], f"{name}, turned")
    return Measurement(tried, [Table("Scenarios that have a plan", _HEADER, rows)], missed)


def attempts(kind: str, count: int, settings: PlannerSettings) -> Iterator[ScenarioAttempt]:
    """Plan `count` scenarios of a class: the robots in turn, each as drawn and turned."""
    for index in range(count):
        pair, turned = divmod(index, 2)
        number, robot = divmod(pair, len(ROBOTS))
        yield attempt(kind, ROBOTS[robot], number, bool(turned), settings)


def attempt(
    kind: str, robot: str, number: int, turned: bool, settings: PlannerSettings
) -> ScenarioAttempt:
    """Plan one scenario, its inertial frame turned or not."""
    problem = scenario(kind, robot, number, turned=turned).problem
    made, outcome = timed_plan(PlanningTask(problem, settings))
    starts = made.solver.starts if made else 0
    return ScenarioAttempt(kind, robot, number, turned, starts, **outcome)


@dataclass(frozen=True)
class ShapesAttempt(Attempt):
    """The planner's result on one problem among convex obstacles."""

    situation: str  # of `shapes.SITUATIONS`
    robot: str  # of `shapes.ROBOTS`
    lines: bool  # whether the robot has lines instead of shapes
    number: int
    starts: int  # initial guesses tried; 0 for a miss


def shapes_measurement(count: int, settings: PlannerSettings) -> Measurement:
    """Plan `count` problems among convex obstacles, and tabulate the results."""
    tried = list(shapes_attempts(count, settings))
    groups: list[tuple[str, Callable[[ShapesAttempt], bool]]] = [("all", lambda _: True)]
    groups += [(name, lambda a, name=name: a.situation == name) for name in shapes.SITUATIONS]  # type: ignore[misc]
    groups += [(name, lambda a, name=name: a.robot == name) for name in shapes.ROBOTS]  # type: ignore[misc]
    groups += [("shapes", lambda a: not a.lines), ("lines", lambda a: a.lines)]
    rows = []
    for name, belongs in groups:
        group = [each for each in tried if belongs(each)]
        if group:
            rows.append((name, *_summary(group)))
    table = Table("Problems among bodies of any shape", _SHAPES_HEADER, rows)
    return Measurement(tried, [table], misses(tried, "{0.robot} {0.number}, {0.situation}"))


def shapes_attempts(count: int, settings: PlannerSettings) -> Iterator[ShapesAttempt]:
    """Plan `count` problems among convex obstacles."""
    for number, drawn in enumerate(shapes.problems(count)):
        made, outcome = timed_plan(PlanningTask(drawn.problem, settings))
        starts = made.solver.starts if made else 0
        lines = not drawn.problem.robot.bodies
        yield ShapesAttempt(drawn.situation, drawn.robot, lines, number, starts, **outcome)


@dataclass(frozen=True)
class JointGoalAttempt(Attempt):
    """The planner's result on one problem of `joint_goals`."""

    kind: str  # of `joint_goals.KINDS`
    robot: str  # as `joint_goals.JointGoal.robot`
    number: int
    starts: int  # initial guesses tried; 0 for a miss
    iterations: int  # quadratic programs solved; 0 for a miss
    # Larger of the end effector's errors at the goal, position [m] and angle [rad]; None: no plan
    error: float | None
    longer: float | None  # duration over the witness's; None: it is given, or there is no plan


def joint_goals_measurement(count: int, settings: PlannerSettings) -> Measurement:
    """Plan `count` problems of each kind of `joint_goals`, and tabulate the results."""
    tried = list(joint_goals_attempts(count, settings))
    rows = []
    for kind in joint_goals.KINDS:
        group = [each for each in tried if each.kind == kind]
        longer = [each.longer for each in group if each.longer is not None]
        errors = [each.error for each in group if each.error is not None]
        iterations = median([each.iterations for each in group if each.iterations], 1)
        largest = f"{max(errors):.0e}" if errors else "-"
        rows.append((kind, *_summary(group), iterations, largest, median(longer, 2)))
    header = (
        *("kind", "problems", *_HEADER[3:], "iterations", "largest error [m, rad]"),
        "duration / reference's",
    )
    table = Table("Chasers held by wheels, rails, and goals of the joints", header, rows)
    return Measurement(tried, [table], misses(tried, "{0.kind} {0.robot} {0.number}"))


def joint_goals_attempts(count: int, settings: PlannerSettings) -> Iterator[JointGoalAttempt]:
    """Plan `count` problems of each kind of `joint_goals`."""
    for kind in joint_goals.KINDS:
        for number, drawn in enumerate(joint_goals.problems(kind, count)):
            made, outcome = timed_plan(PlanningTask(drawn.problem, settings))
            longer = None
            if made and made.duration and drawn.problem.duration_range and drawn.witness:
                longer = made.duration / float(drawn.witness.time[-1])
            starts, iterations, error = 0, 0, None
            if made:
                starts, iterations = made.solver.starts, made.solver.iterations
                of_goal = made.metrics
                error = max(of_goal.final_position_error, of_goal.final_orientation_error)
            reached = starts, iterations, error, longer
            yield JointGoalAttempt(kind, drawn.robot, number, *reached, **outcome)


@dataclass(frozen=True)
class EverythingAttempt(Attempt):
    """The planner's result on one problem."""

    robot: str
    number: int
    of_witness: float | None  # chosen duration over the witness's; None for a miss


def all_features_measurement(count: int, settings: PlannerSettings, *, quick: bool) -> Measurement:
    """Plan `count` problems; if quick, not the first one, which takes twenty times the median."""
    tried = list(all_features_attempts(count, settings, first=1 if quick else 0))
    groups = {"all": tried} | {
        robot: [each for each in tried if each.robot == robot] for robot in all_features.ROBOTS
    }
    rows = [(name, *_summary_with_quantiles(group)) for name, group in groups.items() if group]
    table = Table("All features at once", _ALL_FEATURES_HEADER, rows)
    return Measurement(tried, [table], misses(tried, "{0.robot} {0.number}"))


def all_features_attempts(
    count: int, settings: PlannerSettings, first: int = 0
) -> Iterator[EverythingAttempt]:
    """Plan `count` problems, from number `first` on."""
    for number in range(first, first + count):
        drawn = all_features.problem(number)
        made, outcome = timed_plan(PlanningTask(drawn.problem, settings))
        part = made.duration / drawn.duration if made and made.duration else None
        robot = all_features.ROBOTS[number % len(all_features.ROBOTS)]
        yield EverythingAttempt(robot, number, part, **outcome)


def _summary_with_quantiles(group: Sequence[EverythingAttempt]) -> Iterator[str]:
    seconds = [each.seconds for each in group]
    problems, solved, median, most = solved_and_times(group)
    yield from (problems, solved, median, f"{np.quantile(seconds, 0.9):.3f}", most)
    yield f"{max(seconds):.3f}"
    parts = [each.of_witness for each in group if each.of_witness is not None]
    yield f"{np.median(parts):.3f}" if parts else "-"


def _summary(group: Sequence[ScenarioAttempt | ShapesAttempt | JointGoalAttempt]) -> Iterator[str]:
    if not group:
        yield from "0-----"
        return
    yield from solved_and_times(group)
    yield f"{max(each.seconds for each in group):.3f}"
    yield f"{max(each.starts for each in group)}"
