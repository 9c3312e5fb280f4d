"""Values so small, or so large, that nothing could be planned with them are refused by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import pytest
from ff_planner_msgs.msg import Approach, PlanRequest
from geometry_msgs.msg import Vector3
from heard_inputs import HeardScenes
from ros_processes import Scene

from ff_planner_ros.errors import InvalidInput, NoPlanFound, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.watch import Budget
from ff_planner_ros.planning.problem.limits import Limits
from ff_planner_ros.planning.problem.objective import DurationRange
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.ros.requests.reading import Knowledge, read_request
from ff_planner_ros.time_budget import TimeBudget

TINY = (1e-300, 5e-324, 1e-50, 1e-10)
NOW = 1_700_000_000_000_000_000


def _duration(request: PlanRequest, value: float) -> str:
    request.duration = value
    return "duration"


def _shortest(request: PlanRequest, value: float) -> str:
    request.duration, request.duration_max = value, 12.0
    return "duration"


def _limit(name: str) -> Callable[[PlanRequest, float], str]:
    def spoil(request: PlanRequest, value: float) -> str:
        setattr(request.limits, name, [value])
        return f"limits.{name}"

    return spoil


def _corridor(request: PlanRequest, value: float) -> str:
    request.goal.approach = [Approach(direction=Vector3(z=1.0), distance=value, half_angle=0.2)]
    return "goal.approach.distance"


@pytest.mark.parametrize(
    "spoil",
    [
        *(_duration, _shortest, _corridor),
        *map(_limit, ("chaser_attitude", "chaser_rotation", "accelerations")),
        *map(_limit, ("grasp_force", "grasp_torque", "capture_impulse")),
    ],
)
@pytest.mark.parametrize(
    ("values", "status"),
    [
        (TINY, Status.OUT_OF_RANGE),
        ((0.0, -1.0), Status.OUT_OF_RANGE),
        ((float("inf"), float("nan")), Status.NOT_FINITE),
    ],
)
def test_durations_and_limits_that_nothing_keeps_are_refused_as_what_they_are(
    lemur_capture: PlanningProblem,
    spoil: Callable[[PlanRequest, float], str],
    values: tuple[float, ...],
    status: Status,
) -> None:
    for value in values:
        request = Scene(lemur_capture).complete_request()
        field = spoil(request, value)
        knowledge = Knowledge(
            lemur_capture.robot, load_parameters(), Mock(), HeardScenes(), None, NOW
        )
        with pytest.raises(InvalidInput) as refused:
            read_request(request, knowledge)
        assert refused.value.status is status, (value, str(refused.value))
        assert refused.value.field.startswith(field)


@pytest.mark.parametrize("value", TINY)
def test_they_are_refused_in_python_too(lemur_capture: PlanningProblem, value: float) -> None:
    with pytest.raises(InvalidInput, match=r"duration is .* at least"):
        replace(lemur_capture, duration=value)
    with pytest.raises(InvalidInput, match="at least"):
        DurationRange(value, 10.0)
    for name in ("chaser_attitude", "chaser_rotation"):
        with pytest.raises(InvalidInput, match=f"{name} is .* at least"):
            Limits(**{name: value})
    with pytest.raises(InvalidInput, match="at least"):
        Limits(joint_accelerations=(value,))


@pytest.mark.ci
def test_a_plan_of_the_shortest_duration_is_refused_for_what_it_asks_of_the_arm(
    lemur_capture: PlanningProblem,
) -> None:
    hasty = replace(lemur_capture, duration=1e-3)
    with pytest.raises(NoPlanFound):
        perform(PlanningTask(hasty, load_parameters().planner), TimeBudget(Budget(60.0)))


def test_a_scenario_with_an_infinite_limit_is_refused_and_one_with_none_is_not(
    tmp_path: Path,
) -> None:
    text = Path("config/scenarios/lemur_capture.yaml").read_text()
    for word, is_refused in ((".inf", True), ("none", False)):
        path = tmp_path / "limited.yaml"
        text = text.replace("../robots", str(Path("config/robots").absolute()))
        path.write_text(text.replace("limits: {", f"limits: {{chaser_attitude: {word}, "))
        if is_refused:
            with pytest.raises(InvalidInput, match=r"limits\.chaser_attitude is inf") as refused:
                load_scenario(path)
            assert refused.value.status is Status.NOT_FINITE
        else:
            load_scenario(path)
