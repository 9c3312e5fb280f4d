"""A node plans a whole capture in one request: one answer, one motion, one bag."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recorded_requests import replays_of
from robots import CONFIG
from ros_processes import Scene, connected_client, private_domain, read_bag, running_planner

from ff_planner_ros.bag.plans import read_plans
from ff_planner_ros.cli import main
from ff_planner_ros.common.times import nanoseconds
from ff_planner_ros.errors import Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.scenario.scenario import Defaults, load_task
from ff_planner_ros.report.from_bag import report_of_bag
from ff_planner_ros.ros.messages.phases import phase_message
from ff_planner_ros.ros.messages.to_messages import target_body_message
from ff_planner_ros.runs.replay import Verdict

pytestmark = pytest.mark.ci

SCENARIO = CONFIG / "scenarios/whole_capture.yaml"
LEAD = 20.0  # from the request to the first point [s]
PARAMETERS = ("-p", f"planning_lead_time:={LEAD}", "-p", "robot.geometry:=shapes")


def test_one_request_plans_the_whole_capture(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    task = load_task(SCENARIO, Defaults(load_parameters().planner))
    # Chaser and arm rest until the start; the body was elsewhere before.
    start = replace(
        task.problem.start,
        linear_velocity_chaser_in_inertial=np.zeros(3),
        angular_velocity_chaser_in_inertial=np.zeros(3),
        joint_velocities=np.zeros(7),
    )
    scene = Scene(replace(task.problem, start=start))
    names = task.problem.robot.joint_names
    then = [phase_message(one, names, "inertial") for one in task.then]
    body = task.problem.target_body
    assert body is not None
    with (
        private_domain(),
        running_planner(tmp_path, *PARAMETERS) as planner,
        connected_client() as client,
    ):
        client.wait_for_planner()
        client.wait_for_an_answer()
        request = scene.complete_request()
        request.target_body = [target_body_message(body.after(-LEAD), 0, "inertial")]
        request.then = then
        solved = client.plan(request)
        request.then[1].duration = 0.2
        refused = client.plan(request)
        request.then[1].duration, request.then[1].goal.kind = 30.0, 9
        wrong = client.plan(request)
        request.then[1].goal.kind = 2
        request.target_body[0].inertia.m = 0.0
        massless = client.plan(request)
        assert planner.stop() == 0
    assert solved.status.code == Status.SOLVED, solved.status.message
    assert len(solved.plans) == 3
    begins = [nanoseconds(plan.joint_trajectory.header.stamp) for plan in solved.plans]
    lasted = [nanoseconds(p.joint_trajectory.points[-1].time_from_start) for p in solved.plans]
    assert np.abs(np.diff(begins) - lasted[:-1]).max() <= 1
    assert solved.metrics[0].peak_grasp_force > 0.0
    assert refused.status.message.startswith("phase 3 of 3: 0.2 s is too short")
    assert len(refused.plans) == 2
    assert (wrong.status.code, wrong.status.field) == (Status.OUT_OF_RANGE, "then[1].goal.kind")
    assert massless.status.field == "target_body.inertia.m"

    # One motion went out: of the plan that is whole, and of nothing that was refused.
    (sent,) = read_bag(planner.bag)["/joint_trajectory"]
    assert len(sent.points) == sum(len(p.joint_trajectory.points) for p in solved.plans) - 2
    times = [nanoseconds(point.time_from_start) for point in sent.points]
    assert (np.diff(times) > 0).all()
    (told,) = (one for one in read_plans(planner.bag) if one.plan_id == solved.plan_id)
    assert told.trajectory is not None
    assert len(told.trajectory.time) == len(sent.points)
    assert main(["verify", str(planner.bag)]) == 0
    assert capsys.readouterr().out.count("verdict: passed") == 3
    (drawn,) = (one for one in report_of_bag(planner.bag, 1).requests if one.plan is not None)
    assert len(drawn.then) == 2, "each phase is drawn"
    assert replays_of(planner.bag)[solved.plan_id].verdict is Verdict.IDENTICAL
