"""Recording as the operator of a planner process sees it: services, diagnostics, log and bag."""

from __future__ import annotations

import resource
import threading
from pathlib import Path
from typing import Any

import pytest
import robots
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from mcap.reader import make_reader
from quick_capture import resting_capture
from rcl_interfaces.msg import Log
from ros_processes import (
    DEADLINE,
    Client,
    Scene,
    answers_in,
    connected_client,
    private_domain,
    read_bag,
    running_planner,
)
from rosbag2_format import check_bag
from std_srvs.srv import Trigger

from ff_planner_ros.bag.recover import recover
from ff_planner_ros.errors import Status
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.model import load_robot

OFTEN = ("-p", "rates.diagnostics:=20.0", "-p", "planning_lead_time:=60.0")


class Operator:
    """Reads diagnostics and splits the bag."""

    def __init__(self, client: Client) -> None:
        self._client = client
        self._heard = threading.Condition()
        self._statuses: list[DiagnosticStatus] = []
        client.node.create_subscription(DiagnosticArray, "/diagnostics", self._keep, 10)
        self._service = client.node.create_client(Trigger, "ff_planner/split_bag")

    def split(self) -> Trigger.Response:
        assert self._service.wait_for_service(DEADLINE)
        done = threading.Event()
        future = self._service.call_async(Trigger.Request())
        future.add_done_callback(lambda _: done.set())
        assert done.wait(DEADLINE)
        return future.result()

    def wait_for(self, level: bytes) -> str:
        """Wait until diagnostics say so of the recorder, and return their words."""
        with self._heard:
            self._statuses.clear()
            assert self._heard.wait_for(
                lambda: self._statuses and self._statuses[-1].level == level, DEADLINE
            ), self._statuses
            return str(self._statuses[-1].message)

    def _keep(self, message: DiagnosticArray) -> None:
        with self._heard:
            self._statuses += [one for one in message.status if one.name == "/ff_planner: recorder"]
            self._heard.notify_all()


def _bag_metadata(bag: Path) -> dict[str, Any]:
    return yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]


@pytest.mark.ci
def test_an_operator_splits(tmp_path: Path) -> None:
    request = Scene(resting_capture()).complete_request()
    with private_domain(), running_planner(tmp_path, *OFTEN) as planner:
        with connected_client() as client:
            operator = Operator(client)
            client.wait_for_planner()
            before = client.plan(request)
            split = operator.split()
            assert split.success
            assert split.message == (
                f"{planner.bag}/{planner.bag.name}_0.mcap is complete, recording goes on in "
                f"{planner.bag.name}_1.mcap"
            )
            listed = _bag_metadata(planner.bag)["relative_file_paths"]
            assert listed == [f"{planner.bag.name}_{number}.mcap" for number in (0, 1)]
            after = client.plan(request)
        assert planner.stop() == 0
    for answer in (before, after):
        assert answer.status.code == Status.SOLVED
    messages = read_bag(planner.bag)
    answers = [one.plan_id for one in answers_in(messages)]
    assert answers == [before.plan_id, after.plan_id]
    log = [entry.msg for entry in messages["/rosout"] if entry.level >= Log.INFO]
    assert split.message in log
    assert _bag_metadata(planner.bag)["custom_data"]["dropped"] == "0"
    check_bag(planner.bag)
    for file in sorted(planner.bag.glob("*.mcap")):
        _explains_itself(file)


def _explains_itself(file: Path) -> None:
    with file.open("rb") as stream:
        reader = make_reader(stream)
        documents = {one.name: one.data.decode() for one in reader.iter_attachments()}
        (origin,) = (one.metadata for one in reader.iter_metadata() if one.name == "ff_planner_ros")
    lines = load_robot(robots.LEMUR_URDF, "chaser", "end_effector", geometry=Geometry.LINES)
    assert documents["robot.urdf"] == lines.drawn_urdf
    used = yaml.safe_load(documents["parameters.yaml"])["/**"]["ros__parameters"]
    assert used["rates"]["diagnostics"] == 20.0
    assert origin["node"] == "/ff_planner"
    assert origin["rmw"] == "rmw_fastrtps_cpp"
    assert origin["use_sim_time"] == "false"


@pytest.mark.law("BAG-08")
@pytest.mark.ci
def test_when_the_disk_is_full_planning_goes_on_and_everybody_is_told(
    tmp_path: Path,
) -> None:
    request = Scene(resting_capture()).complete_request()
    with private_domain(), running_planner(tmp_path, *OFTEN) as planner:
        with connected_client() as client:
            operator = Operator(client)
            client.wait_for_planner()
            before = client.plan(request)
            assert operator.split().success  # brings it to the disk
            (file,) = planner.bag.glob("*_1.mcap")
            full = file.stat().st_size
            resource.prlimit(planner.process.pid, resource.RLIMIT_FSIZE, (full, full))
            assert client.plan(request).status.code == Status.SOLVED
            told = operator.wait_for(DiagnosticStatus.ERROR)
            assert "recording has stopped, planning goes on: bag " in told
            assert "File too large" in told
            assert client.plan(request).status.code == Status.SOLVED
        assert planner.stop() == 0
    assert planner.log.count("recording has stopped, planning goes on") == 1
    recover(planner.bag, tmp_path / "saved")
    saved = [one.plan_id for one in answers_in(read_bag(tmp_path / "saved"))]
    assert saved == [before.plan_id]


@pytest.mark.ci
def test_where_no_bag_can_be_written_planning_goes_on_and_everybody_is_told(
    tmp_path: Path,
) -> None:
    arguments = (*OFTEN, "-p", "bag.directory:=/dev/null/bags")
    with private_domain(), running_planner(tmp_path, *arguments) as planner:
        with connected_client() as client:
            operator = Operator(client)
            client.wait_for_planner()
            answer = client.plan(Scene(resting_capture()).complete_request())
            assert answer.status.code == Status.SOLVED
            told = operator.wait_for(DiagnosticStatus.ERROR)
            assert "planning goes on: bag /dev/null/bags/" in told
            refused = operator.split()
            assert not refused.success
            assert "recording has stopped: bag /dev/null/bags/" in refused.message
        assert planner.stop() == 0
    assert planner.log.count("recording has stopped, planning goes on: bag /dev/null/bags/") == 1
    assert "ready; not recording to /dev/null/bags/" in planner.log
