"""A plan tells of meshes whose convex hulls are much larger than they are."""

from __future__ import annotations

from dataclasses import replace

import pytest
from shaped_problems import FAR, SOLIDS

from ff_planner_ros.analysis.plan_json import plan_dictionary
from ff_planner_ros.analysis.summary import plan_rows
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.problem.obstacles import ObstacleBody
from ff_planner_ros.planning.task.notes import hull_notes
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.problems import tumbling

SETTINGS = load_parameters().planner


def _mesh(name: str, share: float) -> ObstacleBody:
    return ObstacleBody(name, replace(SOLIDS["mesh"], hull_share=share), FAR)


@pytest.mark.parametrize(
    ("shares", "words"),
    [
        ((), []),
        ((1.0, 1.05, 1.0999), []),
        ((1.0, 1.11), ["which have more volume: m1 by 11 %"]),
        ((2.0, 1.0, 1.5), ["m0 by 100 %, m2 by 50 %"]),
        ((2.0,) * 7, ["m4 by 100 % and 2 more"]),
    ],
)
def test_hulls_of_a_tenth_more_volume_or_more_are_told(
    shares: tuple[float, ...], words: list[str]
) -> None:
    bodies = [_mesh(f"m{number}", share) for number, share in enumerate(shares)]
    found = hull_notes([*bodies, ObstacleBody("box", SOLIDS["box"], FAR)])
    assert len(found) == len(words)
    assert all(word in note for word, note in zip(words, found, strict=True))


def test_a_plan_says_so_in_its_message_and_table_and_a_digest_knows_no_shares() -> None:
    problem = tumbling.problem("tumbling", 0)
    tasks = [
        PlanningTask(
            replace(problem, obstacles=(*problem.obstacles, _mesh("client", share))), SETTINGS
        )
        for share in (2.0, 1.0)
    ]
    assert tasks[0].digest == tasks[1].digest
    plan, plain = (perform(task) for task in tasks)
    words = "meshes count by their convex hulls, which have more volume: client by 100 %"
    assert plan.message == f"{plain.message}; {words}"
    assert ("note", words) in plan_rows(None, plan, 0.1, "", chosen=False, limits=None)
    assert plan_dictionary(plan, tasks[0], 0.1)["message"] == plan.message
    assert (plan.trajectory.joint_positions == plain.trajectory.joint_positions).all()
