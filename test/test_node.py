"""How the planner node starts, where it listens, and what it refuses to start with."""

from __future__ import annotations

import signal
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest
import rclpy
from builtin_interfaces.msg import Time
from ff_planner_msgs.msg import PlanAnswer
from quick_capture import resting_capture
from rclpy.context import Context
from ros_processes import DEADLINE, Scene, connected_client, private_domain, running_planner
from rosbags.highlevel import AnyReader
from rosgraph_msgs.msg import Clock

from ff_planner_ros.errors import Status
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.ros.node import not_taken

in_ci = partial(pytest.param, marks=pytest.mark.ci)  # each starts a node


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("-p", "state_max_agee:=1.0"), ("state_max_agee is an unknown parameter",)),
        in_ci(("-p", "points:=3"), ("points is 3", "from 5 to 10000")),
        in_ci(("-p", "points:=many"), ("points is 'many'", "whole number")),
        in_ci(("-p", "robot.urdf:=/nowhere/arm.urdf"), ("robot.urdf", "/nowhere/arm.urdf")),
        in_ci(("-p", "robot.tip_link:=finger"), ("finger",)),
        in_ci(
            ("--params-file", "/nowhere/planner.yaml"), ("ROS arguments", "/nowhere/planner.yaml")
        ),
        (("--no-such-argument",), ("ROS arguments", "--no-such-argument")),
    ],
)
def test_a_node_that_cannot_start_says_why_in_one_line(
    arguments: tuple[str, ...], words: tuple[str, ...], tmp_path: Path
) -> None:
    command = [sys.executable, "-m", "ff_planner_ros.ros.node", "--ros-args", *arguments]
    with private_domain():
        ended = subprocess.run(
            command, cwd=tmp_path, capture_output=True, text=True, timeout=DEADLINE, check=False
        )
    assert ended.returncode == 2
    # ROS itself logs a line about its own arguments; a traceback would be many.
    own_lines = [line for line in ended.stderr.splitlines() if "[rcl]" not in line]
    assert len(own_lines) == 1
    for word in words:
        assert word in own_lines[0]


@pytest.mark.parametrize("namespace", ["/", "/sat1"])
def test_what_is_given_of_other_nodes_is_told_as_ros_has_it(tmp_path: Path, namespace: str) -> None:
    keys = ("ff_planner", "/ff_planner", "/**", "/*", "/**/ff_planner", "'**'", "/*/ff_planner")
    keys += ("/sat1/ff_planner", "sat1/ff_planner", "/sat1/*", "/sat1/**", "/sat2/**", "planner")
    texts = {key: f"{key}: {{ros__parameters: {{points: 30}}}}" for key in keys}
    for outer in ("sat1", "/sat1", "/**"):
        texts[outer] = f"{outer}: {{ff_planner: {{ros__parameters: {{points: 30}}}}}}"
    files, taken = {name: tmp_path / f"{n}.yaml" for n, name in enumerate(texts)}, set()
    with private_domain():
        for name, file in files.items():
            file.write_text(texts[name], encoding="utf-8")
            arguments = ["--ros-args", "-r", f"__ns:={namespace}", "--params-file", str(file)]
            rclpy.init(args=arguments, context=(context := Context()))
            node = rclpy.create_node("ff_planner", context=context)
            told = list(not_taken(arguments, node.get_fully_qualified_name()))
            assert bool(told) is ("points" not in node._parameter_overrides), (name, told)
            taken |= set() if told else {name}
            node.destroy_node()
            context.try_shutdown()
    assert 0 < len(taken) < len(files)


def test_a_parameter_of_another_node_is_told_and_what_is_not_for_ros_is_none() -> None:
    given = ("-p", "other:points:=30", "--param", "ff_planner:points:=30", "-p", "points:=30")
    (told,) = not_taken(["node", "--ros-args", *given, "--", "-p", "it:points:=3"], "/ff_planner")
    assert told.startswith("-p other:points:=30 is a parameter of other and not of /ff_planner")
    assert not list(not_taken(["node", *given], "/ff_planner"))


def test_namespace_remapping_and_parameters_file_reach_planner_and_recorder(
    tmp_path: Path,
) -> None:
    scene = Scene(resting_capture())
    parameters = tmp_path / "mine.yaml"
    parameters.write_text(
        "/**:\n  ros__parameters:\n    points: 20\n    planning_lead_time: 60.0\n", encoding="utf-8"
    )
    (tmp_path / "other.yaml").write_text(
        "planner_node: {ros__parameters: {points: 30}}\narm: {planner: {ros__parameters: {}}}\n",
        encoding="utf-8",
    )
    arguments = (
        *("--params-file", str(parameters), "--params-file", str(tmp_path / "other.yaml")),
        *("-r", "__ns:=/servicer", "-r", "__node:=planner"),
        *("-r", "obstacles:=/vision/spheres"),
    )
    with private_domain(), running_planner(tmp_path, *arguments) as planner:
        with connected_client("/servicer", "planner") as client:
            client.wait_for_planner()
            request = scene.complete_request()
            request.search.points = 0
            answer = client.plan(request)
            assert answer.status.code == Status.SOLVED
            assert len(answer.plans[0].joint_trajectory.points) == 20
            client.wait_until(lambda: client.received["joint_trajectory"], "the trajectory")
        assert planner.stop(signal.SIGTERM) == 0
    assert f"[servicer.planner]: ready; recording to {planner.bag}" in planner.log
    assert "; robot lemur of /" in planner.log
    assert "/lemur.urdf, joints joint_1, joint_2, " in planner.log
    other = f"{tmp_path / 'other.yaml'} has parameters of planner_node, arm/planner and none of "
    assert planner.log.count(f"{other}/servicer/planner: nothing of it was taken") == 1
    assert "mine.yaml has" not in planner.log
    assert "self-clearance no pairs, " in planner.log, "with lines"
    with AnyReader([planner.bag]) as reader:
        counts = {connection.topic: connection.msgcount for connection in reader.connections}
    assert set(counts) == {
        "/servicer/chaser_state",
        "/vision/spheres",
        "/servicer/target_body",
        "/servicer/predicted_target_path",
        "/servicer/predicted_relative_pose",
        "/servicer/joint_trajectory",
        "/servicer/published_plan",
        "/servicer/predicted_chaser_path",
        "/servicer/predicted_chaser_pose",
        "/servicer/predicted_wheel_momentum",
        "/servicer/tracking_error",
        "/servicer/plan_events",
        "/tf",
        "/tf_static",
        "/servicer/markers",
        "/servicer/planned_joint_states",
        "/servicer/robot_description",
        "/servicer/planner/transition_event",
        "/diagnostics",
        "/rosout",
        "/servicer/exchanges",
    }
    assert counts["/servicer/joint_trajectory"] == 1
    assert counts["/servicer/exchanges"] == 2


@pytest.mark.ci
def test_the_age_of_a_state_is_told_by_simulated_time(
    lemur_capture: PlanningProblem, tmp_path: Path
) -> None:
    request = Scene(lemur_capture).complete_request()
    request.start_state[0].header.stamp.sec = 100
    request.duration = -1.0  # the next thing that is refused once the age is right
    arguments = ("-p", "use_sim_time:=true")
    with (
        private_domain(),
        running_planner(tmp_path, *arguments) as planner,
        connected_client() as client,
    ):
        clock = client.node.create_publisher(Clock, "/clock", 10)
        client.wait_for_planner()
        early = client.plan(request)
        assert early.status.code == Status.STATE_IN_FUTURE
        assert "100.000 s ahead" in early.status.message

        def answer_at(seconds: int, before: PlanAnswer) -> PlanAnswer:
            def accepted(answer: PlanAnswer) -> bool:
                clock.publish(Clock(clock=Time(sec=seconds)))
                return answer.status != before.status

            return client.plan_until(request, accepted)

        in_time = answer_at(100, early)
        assert in_time.status.code == Status.OUT_OF_RANGE
        assert in_time.status.message.startswith("duration is -1")
        late = answer_at(150, in_time)
        assert late.status.code == Status.STATE_TOO_OLD
        assert "50.000 s old" in late.status.message
        assert planner.stop() == 0
