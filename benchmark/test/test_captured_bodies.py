"""The problems of captured bodies have witnesses; plans of them come true, and replay."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from recorded_requests import only_request

from ff_planner_benchmark.problems import captured
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.problem.problem import lasting
from ff_planner_ros.planning.problem.scene import scene_of
from ff_planner_ros.planning.task.following import phase_tasks
from ff_planner_ros.planning.task.task import perform
from ff_planner_ros.runs.offline_bag import record_answer
from ff_planner_ros.runs.replay import Verdict, replay
from ff_planner_ros.simulation.verification import verify

SETTINGS = load_parameters().planner


def test_a_witness_does_what_its_problem_asks() -> None:
    for kind in ("captured stop", "payload stow"):
        drawn = captured.problem(kind, 1)
        problem, (witness,) = drawn.problem, drawn.witness
        np.testing.assert_array_equal(witness.positions[0], problem.start.joint_positions)
        np.testing.assert_array_equal(witness.velocities[0], problem.start.joint_velocities)
        assert not witness.velocities[-1].any()
        assert problem.posture is not None
        if kind == "payload stow":
            np.testing.assert_array_equal(witness.positions[-1], problem.posture.positions)
            assert witness.time[-1] == problem.duration
        else:
            limits, (lowest, highest) = problem.limits.joint_accelerations, witness.extremes(2)[0]
            assert (np.maximum(-lowest, highest) < np.array(limits)).all()
        assert problem.robot.payload is not None
        assert 20.0 <= problem.robot.payload.mass <= 800.0


@pytest.mark.ci
@pytest.mark.sampled
@pytest.mark.parametrize("kind", captured.KINDS)
@pytest.mark.parametrize("number", range(2))
def test_a_plan_is_found_comes_true_and_replays(kind: str, number: int, tmp_path: Path) -> None:
    task = captured.problem(kind, number).task(SETTINGS)
    plan = perform(task)
    for one, found in phase_tasks(task, plan):
        problem = lasting(one.problem, found.duration)
        assert verify(problem.robot, found.trajectory, scene_of(problem)).passed
    record_answer(tmp_path / "bag", task, plan, 0.5)
    recorded = only_request(tmp_path / "bag")
    assert replay(recorded).verdict is Verdict.IDENTICAL
