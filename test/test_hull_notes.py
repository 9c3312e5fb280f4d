"""Plans and refusals tell of meshes whose convex hulls are much larger than they are."""

from __future__ import annotations

from dataclasses import replace

import pytest
from shaped_problems import FAR, SOLIDS

from ff_planner_benchmark.problems import tumbling
from ff_planner_ros.analysis.plan_json import plan_dictionary, refusal_dictionary
from ff_planner_ros.analysis.summary import plan_rows
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import Failure, InvalidInput, NoPlanFound, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.distance.clearance import arm_points
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.obstacles import ObstacleBody
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.task.notes import hull_notes
from ff_planner_ros.planning.task.task import PlanningTask, perform, without_search
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.ros.messages.to_messages import answer_of_error

WORDS = "meshes count by their convex hulls, which have more volume: client by 100 %"
SETTINGS = load_parameters().planner


def _mesh(name: str, added: float, place: Array = FAR) -> ObstacleBody:
    return ObstacleBody(name, replace(SOLIDS["mesh"], hull_added=added), place)


def _task(*bodies: ObstacleBody) -> PlanningTask:
    problem = tumbling.problem("tumbling", 0)
    return PlanningTask(replace(problem, obstacles=(*problem.obstacles, *bodies)), SETTINGS)


@pytest.mark.parametrize(
    ("added", "words"),
    [
        ((), []),
        ((0.0, 0.05, 0.0999), []),
        ((0.0, 0.11), ["which have more volume: m1 by 11 %"]),
        ((1.0, 0.0, 0.5), ["m0 by 100 %, m2 by 50 %"]),
        ((1.0,) * 7, ["m4 by 100 % and 2 more"]),
    ],
)
def test_hulls_of_a_tenth_more_volume_or_more_are_told(
    added: tuple[float, ...], words: list[str]
) -> None:
    bodies = [_mesh(f"m{number}", one) for number, one in enumerate(added)]
    found = hull_notes([*bodies, ObstacleBody("box", SOLIDS["box"], FAR)])
    assert len(found) == len(words)
    assert all(word in note for word, note in zip(words, found, strict=True))


def test_a_plan_says_so_in_its_message_and_table_and_a_digest_does_not() -> None:
    tasks = [_task(_mesh("client", added)) for added in (1.0, 0.0)]
    assert tasks[0].digest == tasks[1].digest
    plan, plain = (perform(task) for task in tasks)
    assert plan.message == f"{plain.message}; {WORDS}"
    assert ("note", WORDS) in plan_rows(None, plan, 0.1, "", chosen=False, limits=None)
    assert plan_dictionary(plan, tasks[0], 0.1)["message"] == plan.message
    assert (plan.trajectory.joint_positions == plain.trajectory.joint_positions).all()


def _end_effector() -> Array:
    """Where the end effector is at the start."""
    problem = tumbling.problem("tumbling", 0)
    q, _ = configuration(problem.robot, problem.start)
    place: Array = arm_points(problem.robot, q[None])[0, -1]
    return place


def _refuse(_problem: PlanningProblem, _settings: PlannerSettings) -> Plan:
    failure = Failure(Status.COLLISION, "link_2 is in client", ("another goal",))
    raise NoPlanFound(Status.COLLISION, "link_2 is in client", None, (failure,))


def test_a_refusal_says_so_wherever_it_is_told() -> None:
    task = _task(_mesh("client", 1.0))
    with pytest.raises(NoPlanFound) as refused:
        perform(task, method=without_search(_refuse))
    error, words = refused.value, f"link_2 is in client; {WORDS}"
    assert str(error) == words  # the command line prints this
    assert [one.advice for one in error.failures] == [("another goal",)]
    assert refusal_dictionary(error, 0.1)["message"] == words
    assert answer_of_error(error, "plan", 0.1).status.message == words
    with pytest.raises(NoPlanFound, match=r"^link_2 is in client$"):
        perform(_task(_mesh("client", 0.0)), method=without_search(_refuse))


def test_a_refused_start_says_so_of_the_mesh_that_it_is_in() -> None:
    place = _end_effector() - [0.03, 0.03, 0.02]
    with pytest.raises(InvalidInput, match=r"client by 100 %$") as refused:
        perform(_task(_mesh("client", 1.0, place), _mesh("far", 2.0)))
    assert refused.value.status is Status.START_IN_COLLISION
    assert refused.value.field == "obstacles[client]"
    assert answer_of_error(refused.value, "plan", 0.1).status.allowed.endswith(WORDS)
    with pytest.raises(InvalidInput) as refused:
        perform(_task(_mesh("client", 0.0, place), _mesh("far", 2.0)))
    assert "hull" not in str(refused.value)
