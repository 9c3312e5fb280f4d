"""An integrator's day from docs/how_to/integrating.md: parameters, order and promises."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from ff_planner_msgs.msg import ChaserState, PlanAnswer, PlanStatus
from ff_planner_msgs.srv import Describe
from pages import SOURCE_TREE
from ros_processes import (
    DEADLINE,
    connected_client,
    private_domain,
    read_bag,
    running_planner,
)
from test_node_hand_over import LATCHED, SCENE, Arm, arm
from visualization_msgs.msg import MarkerArray

from ff_planner_ros.cli import main
from ff_planner_ros.common.times import NANOSECONDS, nanoseconds
from ff_planner_ros.errors import Status
from ff_planner_ros.messages.plans import plan_from_answer
from ff_planner_ros.planning.motion.forward import carried_forward
from ff_planner_ros.planning.motion.joint_motion import joint_motion
from ff_planner_ros.ros.messages.foreign import TFMessage
from ff_planner_ros.ros.messages.to_messages import state_message, time_message
from ff_planner_ros.ros.outputs.execution import Event

PAGE = SOURCE_TREE / "docs" / "how_to" / "integrating.md"
PATIENT = ("-p", "state_max_age:=3600.0")  # a client takes seconds to start on a busy machine
LEAD = 1.0  # from a request to where its plan takes over [s]


def along(at: Arm, made: PlanAnswer) -> ChaserState:
    """The state that navigation measures now, while a plan is executed."""
    motion, problem = plan_from_answer(made).trajectory, SCENE.problem
    now_ns = at.client.now_ns()
    since = (now_ns - nanoseconds(made.plans[0].joint_trajectory.header.stamp)) / NANOSECONDS
    state = carried_forward(problem.robot, problem.start, since, joint_motion(motion))
    return state_message(state, problem.robot.joint_names, now_ns, "inertial")


def frames(heard: list[TFMessage]) -> dict[str, str]:
    """Parents of frames."""
    return {one.child_frame_id: one.header.frame_id for told in heard for one in told.transforms}


def waiting(heard: list[MarkerArray]) -> list[str]:
    """What the newest markers say of a plan that waits."""
    newest = heard[-1].markers if heard else ()
    return [one.text for one in newest if one.ns == "waiting/words"]


@pytest.mark.ci
def test_the_clients_of_the_page_get_a_plan_and_otherwise_the_reason(tmp_path: Path) -> None:
    """By rclpy alone, and by the client that comes with the planner."""
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert len(blocks) == 2
    code = "\n".join([*blocks, "print(status.code, answer.plan_id)"])
    with (
        private_domain(),
        running_planner(tmp_path, *PATIENT) as planner,
        connected_client() as client,
    ):
        client.wait_for_planner()
        command = [sys.executable, "-c", code]
        refused = subprocess.run(command, capture_output=True, text=True, timeout=DEADLINE)
        client.publish_obstacles(SCENE.obstacles())
        client.publish_and_wait(SCENE.state(client.now_ns()))
        planned = subprocess.run(command, capture_output=True, text=True, timeout=DEADLINE)
        run = planner.bag.name
    alone, *_, by_client = refused.stdout.splitlines()
    assert alone.startswith(f"{int(Status.NO_STATE)} ")
    assert alone.endswith("ask again")
    assert by_client.startswith(f"{int(Status.UNKNOWN_PLAN)} {run}.")
    *told, by_client = planned.stdout.splitlines()
    assert any(line.startswith(f"{run}.") and line.endswith(" rad") for line in told)
    assert by_client.startswith(f"{int(Status.SOLVED)} {run}.")


@pytest.mark.ci
def test_a_day_from_the_page_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (parameters,) = re.findall(r"```yaml\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    (tmp_path / "mine.yaml").write_text(parameters, encoding="utf-8")
    limits = {"constraints.joint_1.goal": 0.01}
    with arm(tmp_path, "--params-file", str(tmp_path / "mine.yaml"), **limits) as at:
        client, controller = at.client, at.controller
        transforms = client.hear(TFMessage, "/tf")
        markers = client.hear(MarkerArray, "markers", LATCHED)
        # 3. what it can do
        told = client.call(Describe, "/ff_planner/describe", Describe.Request())
        assert list(controller.joints) == told.robot.joint_names
        # 4. and 5. looked at before it goes out
        client.publish_obstacles(SCENE.obstacles())
        client.publish_state(SCENE.state(client.now_ns()))
        made = at.plan(plan_only=True)
        assert at.of(made) == []
        client.wait_until(
            lambda: waiting(markers) == [f"{made.plan_id} waits to be released"], "it"
        )
        wrong = client.publish_plan(made, plan_id="guessed")
        assert (wrong.field, wrong.retry) == ("plan_id", PlanStatus.RETRY_CHANGED)
        client.publish_state(SCENE.state(client.now_ns()))
        approved = client.publish_plan(made, start_state=[SCENE.state(client.now_ns())])
        assert approved.code == Status.SOLVED, approved
        client.wait_until(lambda: waiting(markers) == [], "markers of a plan that is released")
        # 6. execution
        at.wait_for(made, Event.STARTED)
        client.publish_state(along(at, made))
        wanted = {"chaser", "preview/chaser", "predicted/chaser", "predicted/end_effector"}
        client.wait_until(lambda: set(frames(transforms)) >= wanted, "frames")
        assert {frames(transforms)[name] for name in wanted} == {"inertial"}
        # 7. again on the way
        start = time_message(client.now_ns() + round(LEAD * NANOSECONDS))
        request = at.request(replan_active=True, duration=0.0, start_time=start)
        request.start_state = [along(at, made)]
        again = client.plan(request)
        assert again.status.code == Status.SOLVED, again.status
        assert again.inputs.previous_plan_id == made.plan_id
        assert at.wait_for(made, Event.SUPERSEDED).successor == again.plan_id
        taken = controller.trajectories[-1].points[0].positions
        there = joint_motion(plan_from_answer(made).trajectory).at(
            np.array([again.inputs.splice_time])
        )
        np.testing.assert_allclose(taken, there[0][0], atol=1e-9)
        # 8. something goes wrong
        at.wait_for(again, Event.STARTED)
        controller.off = 0.2
        assert at.wait_for(again, Event.ABORTED).error_code == -4
        client.wait_until(lambda: at.told("PATH_TOLERANCE_VIOLATED"), "the diagnostics")
        request.start_time = time_message(0)  # as soon as may be
        status = Status.STATE_TOO_OLD
        while status is Status.STATE_TOO_OLD:  # on a busy machine it is by the time it is read
            request.start_state = [SCENE.state(client.now_ns())]
            status = Status(client.plan(request).status.code)
        assert status is Status.NO_ACTIVE_PLAN
        assert at.planner.stop() == 0
    # 9. afterwards
    assert main(["replay", str(at.planner.bag)]) == 0
    assert "2 identical, 1 not planned" in capsys.readouterr().out
    recorded = frames(read_bag(at.planner.bag)["/tf"])
    assert wanted <= set(recorded)
