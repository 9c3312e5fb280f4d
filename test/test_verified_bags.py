"""Plans of bags as `ff-planner verify` executes them; bags of the node are in test_verify."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from answers import answer_with, exchange, write_bag
from ff_planner_msgs.msg import Exchange, PlanAnswer
from recorded_requests import motions_in

from ff_planner_ros.cli import main
from ff_planner_ros.errors import BagError, InvalidInput, NoPlanFound, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import Limits, PlanningProblem
from ff_planner_ros.planning.problem.uncertainty import Uncertainty
from ff_planner_ros.planning.robust.robust import withstood
from ff_planner_ros.planning.scenario.task_json import task_json
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.ros.messages.answers import answer_of
from ff_planner_ros.runs.offline_bag import record_answer

SETTINGS = load_parameters().planner


@pytest.fixture(scope="module")
def task(lemur_capture: PlanningProblem) -> PlanningTask:
    return PlanningTask(lemur_capture, SETTINGS)


def told(task: PlanningTask, answer: PlanAnswer) -> Exchange:
    return exchange(answer, task=task_json(task))


def test_robot_plan_and_scene_come_back_as_they_were(
    offline_bag: Path, lemur_capture: PlanningProblem, lemur_plan: Plan
) -> None:
    ((_, name, robot, motion, scene, limits, uncertainty, _),) = motions_in(offline_bag)
    assert name == "offline"
    assert (robot.urdf, robot.tip_link) == (lemur_capture.robot.urdf, "end_effector")
    for item in fields(lemur_plan.trajectory):
        tolerance = 1e-9 if item.name == "time" else 0.0  # a message counts nanoseconds
        wanted = getattr(lemur_plan.trajectory, item.name)
        assert getattr(motion, item.name) == pytest.approx(wanted, abs=tolerance, rel=0)
    assert scene is not None
    assert scene.target is not None
    for found, obstacle in zip(scene.obstacles, lemur_capture.obstacles, strict=True):
        assert (found.id, found.radius) == (obstacle.id, obstacle.radius)
        np.testing.assert_array_equal(found.center, obstacle.center)
    np.testing.assert_array_equal(scene.target.position, lemur_capture.target.position)
    assert scene.capture_time == lemur_capture.duration
    assert limits == lemur_capture.limits
    assert uncertainty == withstood(SETTINGS.robust)


def test_every_plan_of_a_run_is_found_and_refusals_are_left_out(
    task: PlanningTask, lemur_plan: Plan, tmp_path: Path
) -> None:
    first, third = (answer_with(lemur_plan, f"run.{number}") for number in (1, 3))
    second = answer_of(NoPlanFound(Status.COLLISION, "too near"), "run.2", 0.1)
    bag = write_bag(tmp_path / "bag", *(told(task, one) for one in (first, second, third)))
    assert [one.name for one in motions_in(bag)] == ["run.1", "run.3"]


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        ("points", r"run\.1\.plans is damaged: the shape of poses is \(50, 7\), not \(49, 7\)"),
        ("joints", r"run\.1\.joint_trajectory\.joint_names is other_0.*robot .* has joint_1"),
        ("numbers", r"run\.1\.joint_velocities is not finite"),
        ("no plan", r"run\.1\.plans is 0 plans: it must be one of each phase, up to 1"),
        ("too many", r"run\.1\.plans is 2 plans: it must be one of each phase, up to 1"),
        ("no metrics", r"run\.1\.plans is damaged"),
        ("no task", r"run\.1\.task is missing"),
    ],
)
def test_a_damaged_answer_is_refused_by_its_name(
    damage: str,
    words: str,
    task: PlanningTask,
    lemur_plan: Plan,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    answer = answer_with(lemur_plan)
    motion, recorded = answer.plans[0].joint_trajectory, told(task, answer)
    if damage == "points":
        motion.points = motion.points[:-1]
    elif damage == "joints":
        motion.joint_names = [f"other_{k}" for k in range(7)]
    elif damage == "numbers":
        motion.points[3].velocities[2] = math.nan
    elif damage == "no task":
        recorded.task = ""
    elif damage == "no metrics":
        answer.metrics = []
    else:
        answer.plans = [] if damage == "no plan" else [answer.plans[0]] * 2
    recorded.answer = [answer]
    bag = write_bag(tmp_path / "bag", recorded)
    with pytest.raises(InvalidInput, match=words):
        motions_in(bag)
    assert main(["verify", str(bag)]) == 2
    assert "run.1." in capsys.readouterr().err


def test_a_bag_without_plans_tells_its_answers(task: PlanningTask, tmp_path: Path) -> None:
    refusal = NoPlanFound(Status.COLLISION, "obstacle c1 is in the way")
    record_answer(tmp_path / "bag", task, refusal, 0.5)
    with pytest.raises(BagError, match=r"bag holds no plan.*obstacle c1 is in the way"):
        motions_in(tmp_path / "bag")
    with pytest.raises(BagError, match="silent holds no plan; its answers: none"):
        motions_in(write_bag(tmp_path / "silent", exchange()))


@pytest.mark.parametrize("angle", ["chaser_attitude", "chaser_rotation"])
@pytest.mark.parametrize("torques", [True, False])
def test_a_plan_is_verified_by_the_limits_and_the_uncertainty_of_its_task(
    lemur_capture: PlanningProblem, lemur_plan: Plan, tmp_path: Path, angle: str, torques: bool
) -> None:
    limits = replace(Limits(joint_torques=torques), **{angle: 0.2})
    robust = replace(SETTINGS.robust, sigmas=3.0, mass=0.25, angular_velocity=0.5)
    asked = PlanningTask(replace(lemur_capture, limits=limits), replace(SETTINGS, robust=robust))
    (found,) = motions_in(write_bag(tmp_path / "bag", told(asked, answer_with(lemur_plan))))
    assert found.limits == limits
    assert found.uncertainty == Uncertainty(mass=0.25, angular_velocity=0.5)
