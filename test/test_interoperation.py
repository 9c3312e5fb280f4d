"""The planner among processes that have another vendor's DDS and know nothing of ROS."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from ff_planner_msgs.msg import PlanAnswer
from ros_processes import (
    DEADLINE,
    FRAME,
    Scene,
    connected_client,
    private_domain,
    read_bag,
    running_planner,
)

from ff_planner_ros.errors import Status
from ff_planner_ros.planning.problem.problem import PlanningProblem

# The private domain stays on this host and without multicast: Cyclone DDS is told where to look.
_ON_THIS_HOST = """
<CycloneDDS><Domain>
  <General>
    <Interfaces><NetworkInterface address="127.0.0.1" multicast="false"/></Interfaces>
    <AllowMulticast>false</AllowMulticast>
  </General>
  <Discovery>
    <Peers><Peer address="127.0.0.1"/></Peers>
    <ParticipantIndex>auto</ParticipantIndex>
    <MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>
  </Discovery>
</Domain></CycloneDDS>
"""


@pytest.mark.ci
def test_a_process_without_ros_tells_the_state_and_reads_the_trajectory(
    lemur_capture: PlanningProblem, tmp_path: Path
) -> None:
    start, names = lemur_capture.start, list(lemur_capture.robot.joint_names)
    told = {
        "frame_id": FRAME,
        "position": start.position_chaser_in_inertial.tolist(),
        "quaternion_xyzw": start.quaternion_chaser_to_inertial_xyzw.tolist(),
        "linear_velocity": start.linear_velocity_chaser_in_inertial.tolist(),
        "angular_velocity": start.angular_velocity_chaser_in_inertial.tolist(),
        "joint_names": names[::-1],
        "joint_positions": start.joint_positions.tolist()[::-1],
        "joint_velocities": start.joint_velocities.tolist()[::-1],
    }
    scene = Scene(lemur_capture)
    request = scene.request()
    request.scene = scene.complete_request().scene
    with (
        private_domain(),
        # The client of tests has a publisher of the state, too, which stays silent here.
        running_planner(
            tmp_path,
            *("-p", "planning_lead_time:=5.0", "-p", "allow_several_publishers:=true"),
        ) as planner,
        connected_client() as client,
    ):
        foreign = subprocess.Popen(
            [sys.executable, str(Path(__file__).with_name("foreign_chaser.py")), json.dumps(told)],
            env={**os.environ, "CYCLONEDDS_URI": _ON_THIS_HOST},
            stdout=subprocess.PIPE,
            text=True,
        )
        try:
            client.wait_for_planner()

            def heard(answer: PlanAnswer) -> bool:
                assert not foreign.poll(), "the foreign process failed"
                return answer.status.code not in (Status.NO_STATE, Status.TOO_LATE)

            answer = client.plan_until(request, heard)
            assert answer.status.code == Status.SOLVED, answer.status.message
            output, _ = foreign.communicate(timeout=DEADLINE)
            client.wait_until(lambda: client.received["joint_trajectory"], "a trajectory")
            (ours,) = client.received["joint_trajectory"]
        finally:
            foreign.kill()
            foreign.wait()
        planner.stop()
    read: Any = json.loads(output)
    assert read["header"]["frame_id"] == FRAME
    assert read["header"]["stamp"] == _fields(ours.header.stamp)
    assert read["joint_names"] == names
    assert len(read["points"]) == len(ours.points)
    for point, expected in zip(read["points"], ours.points, strict=True):
        for field in ("positions", "velocities", "accelerations", "effort"):
            assert point[field] == getattr(expected, field).tolist()
        assert point["time_from_start"] == _fields(expected.time_from_start)
    states = read_bag(planner.bag)["/chaser_state"]
    assert states
    for state in states:
        assert state.header.frame_id == FRAME
        assert list(state.joint_names) == told["joint_names"]
        assert state.joint_positions.tolist() == told["joint_positions"]
        assert state.joint_velocities.tolist() == told["joint_velocities"]
        assert _numbers(state.pose.position, "xyz") == told["position"]
        assert _numbers(state.pose.orientation, "xyzw") == told["quaternion_xyzw"]
        assert _numbers(state.twist.linear, "xyz") == told["linear_velocity"]
        assert _numbers(state.twist.angular, "xyz") == told["angular_velocity"]


def _numbers(message: Any, names: str) -> list[float]:
    return [getattr(message, name) for name in names]


def _fields(stamp: Any) -> dict[str, int]:
    return {"sec": stamp.sec, "nanosec": stamp.nanosec}
