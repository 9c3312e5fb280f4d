"""A node plans for a request's payload; the bag knows, for replay, `verify` and report."""

from __future__ import annotations

from pathlib import Path

import pytest
from recorded_requests import replays_of
from ros_processes import Scene, connected_client, private_domain, read_bag, running_planner
from test_payload import PAYLOAD, scenario

from ff_planner_ros.cli import main
from ff_planner_ros.errors import Status
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.report.from_bag import report_of_bag
from ff_planner_ros.robot.urdf.payload import payload_frame
from ff_planner_ros.ros.messages.to_messages import payload_message
from ff_planner_ros.runs.replay import Verdict

pytestmark = pytest.mark.ci

PARAMETERS = ("-p", "planning_lead_time:=5.0", "-p", "robot.geometry:=shapes")


def test_each_request_has_its_payload_or_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = Scene(load_scenario(scenario(tmp_path)))
    with (
        private_domain(),
        running_planner(tmp_path, *PARAMETERS) as planner,
        connected_client() as client,
    ):
        client.wait_for_planner()
        client.wait_for_an_answer()
        bare, heavy = scene.complete_request(), scene.complete_request()
        heavy.payload = [payload_message(PAYLOAD)]
        answers = [client.plan(request) for request in (bare, heavy)]
        assert [answer.status.code for answer in answers] == [Status.SOLVED] * 2, answers[1].status
        assert planner.stop() == 0
    bag = planner.bag
    replayed = replays_of(bag)
    told = [replayed[answer.plan_id] for answer in answers]
    assert [one.verdict for one in told] == [Verdict.IDENTICAL] * 2
    robots = [one.exchange.planned_task().problem.robot for one in told]
    assert [payload_frame(robot) is None for robot in robots] == [True, False]
    assert main(["verify", str(bag)]) == 0
    assert capsys.readouterr().out.count("verdict: passed") == 2
    assert [one.plan is not None for one in report_of_bag(bag, 2).requests][-2:] == [True, True]
    # Screens show the payload, too: more triangles than those of the robot.
    surfaces = [
        max(len(marker.points) for marker in array.markers if marker.ns == "bodies")
        for array in read_bag(bag)["/markers"]
    ]
    assert surfaces[1] > surfaces[0]
