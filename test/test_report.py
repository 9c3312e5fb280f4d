"""The report of a run: all that was asked is on the page, and its plots are the bag's numbers."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml
from answers import FRAME, answer_with, exchange, write_bag
from drawn_plans import paper_terms_at
from ff_planner_msgs.msg import Plan as PlanMessage
from ff_planner_msgs.msg import PlanAnswer, PlanRequest, PublishedPlan
from nav_msgs.msg import Odometry
from read_page import Page, numbers
from recorded_requests import recorded
from robots import CONFIG
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectoryPoint

from ff_planner_ros.analysis.drawing.panels import joint_angles
from ff_planner_ros.analysis.drawing.tracking import Deviations
from ff_planner_ros.analysis.plan_json import plan_dictionary, refusal_dictionary
from ff_planner_ros.bag.mcap.encoding import encode
from ff_planner_ros.bag.provenance import PROVENANCE
from ff_planner_ros.bag.writer import BagWriter
from ff_planner_ros.cli import main
from ff_planner_ros.errors import BagError, FfPlannerError, InvalidInput, NoPlanFound, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.plan import Plan, Trajectory
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.scenario.task_json import task_json
from ff_planner_ros.planning.search.planner import plan
from ff_planner_ros.planning.task.task import PlanningTask
from ff_planner_ros.report import from_bag
from ff_planner_ros.report.from_bag import report_of_bag, reported_request
from ff_planner_ros.report.plan_plots import shown_rows
from ff_planner_ros.report.run_page import save_page
from ff_planner_ros.report.run_report import (
    Report,
    ReportedRequest,
    report_of_answer,
    robot_facts,
)
from ff_planner_ros.robot.model import robot_from_urdf_text
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.ros.messages.answers import answer_of
from ff_planner_ros.ros.messages.interfaces import type_name
from ff_planner_ros.ros.messages.to_messages import (
    pose_message,
    request_message,
    state_message,
    time_message,
)

SECOND, T0 = 10**9, 1_795_000_000 * 10**9
EVIL = "<script>alert(1)</script><img src=x onerror='alert(2)'>\" & </td>"
PARAMETERS: dict[str, Any] = yaml.safe_load((CONFIG / "planner.yaml").read_text())["/**"][
    "ros__parameters"
]
PLOTS = (*("scene", "clearance", "joints", "end-effector", "chaser-pose", "chaser-velocity"),)


class Run:
    """A bag as the node records it, written message by message."""

    def __init__(self, directory: Path, problem: PlanningProblem, **parameters: Any) -> None:
        self.bag = BagWriter(directory, flush_interval=0.0)
        self.problem, self._topics = problem, set[str]()
        self.task = PlanningTask(problem, load_parameters().planner)
        document = yaml.safe_dump({"/**": {"ros__parameters": PARAMETERS | parameters}})
        self.bag.attach("robot.urdf", "application/xml", problem.robot.drawn_urdf.encode())
        self.bag.attach("parameters.yaml", "application/yaml", document.encode())

    def put(self, topic: str, message: Any, time_ns: int) -> None:
        if topic not in self._topics:
            self._topics.add(topic)
            self.bag.add_topic(topic, type_name(type(message)), [])
        self.bag.write(topic, encode(message), time_ns, time_ns)

    def ask(
        self,
        answer: PlanAnswer | None,
        asked_ns: int,
        interface: str = "service",
        *,
        plan_only: bool = False,
    ) -> None:
        """A request, and half a second later its answer."""
        request = request_message(self.problem, FRAME)
        request.plan_only = plan_only
        told = {
            "interface": interface,
            "plan_id": "run.unanswered" if answer is None else answer.plan_id,
        }
        self.put("/exchanges", exchange(None, request, asked_ns, **told), asked_ns)
        if answer is not None:
            at_ns, task = (
                asked_ns + SECOND // 2,
                task_json(self.task, self.problem.robot.drawn_urdf),
            )
            self.put("/exchanges", exchange(answer, request, at_ns, task=task, **told), at_ns)

    def states(self, motion: Trajectory, start_ns: int) -> None:
        names = self.problem.robot.joint_names
        for i, stamp_ns in enumerate(stamps(motion, start_ns)):
            state = state_message(state_at(motion, i), names, stamp_ns, FRAME)
            self.put("/chaser_state", state, stamp_ns)


def answered(plan: Plan, plan_id: str, start_ns: int) -> PlanAnswer:
    return answer_with(plan, plan_id, start_ns, 0.25)


def stamps(motion: Trajectory, start_ns: int) -> list[int]:
    return [start_ns + round(time * SECOND) for time in motion.time.tolist()]


def state_at(motion: Trajectory, i: int) -> SystemState:
    return SystemState(
        motion.chaser_positions[i],
        motion.chaser_quaternions_xyzw[i],
        motion.chaser_linear_velocities[i],
        motion.chaser_angular_velocities[i],
        motion.joint_positions[i],
        motion.joint_velocities[i],
    )


def disturbed(motion: Trajectory) -> Trajectory:
    """The plan's own points, of which some are off by known amounts."""
    position, joints = motion.chaser_positions.copy(), motion.joint_positions.copy()
    rates, quaternions = motion.joint_velocities.copy(), motion.chaser_quaternions_xyzw.copy()
    position[20] += [0.0, 0.003, -0.004]
    turned = Rotation.from_rotvec([0.0, 0.0, 0.02]) * Rotation.from_quat(quaternions[10])
    quaternions[10] = turned.as_quat()
    joints[30, 1] += 0.01
    rates[40, 6] -= 0.002
    return replace(
        motion,
        chaser_positions=position,
        chaser_quaternions_xyzw=quaternions,
        joint_positions=joints,
        joint_velocities=rates,
    )


def page_of(report: Report, directory: Path) -> Page:
    save_page(report, directory / "report.html")
    return Page((directory / "report.html").read_text(encoding="utf-8"))


@dataclass(frozen=True)
class Told:
    report: Report
    page: Page
    measured: Trajectory


@pytest.fixture(scope="module")
def told(
    lemur_capture: PlanningProblem, lemur_plan: Plan, tmp_path_factory: pytest.TempPathFactory
) -> Told:
    """Three plans and three refusals: flown with faults, flown by nobody, and not measured."""
    directory = tmp_path_factory.mktemp("report")
    motion = lemur_plan.trajectory
    measured = disturbed(motion)
    run = Run(directory / "run", lemur_capture)
    with run.bag:
        run.bag.add_record(PROVENANCE, {"node": "/ff_planner", "numpy": "2.0.0", "host": "moon"})
        run.ask(answered(lemur_plan, "run.1", T0 + 10 * SECOND), T0 + SECOND)
        run.states(measured, T0 + 10 * SECOND)
        refusal = answer_of(FfPlannerError(Status.NO_STATE, EVIL), "run.2", 0.01)
        run.ask(refusal, T0 + 30 * SECOND)
        attempt = NoPlanFound(Status.COLLISION, "c1 is in the way", lemur_plan)
        run.ask(answer_of(attempt, "run.3", 1.5), T0 + 40 * SECOND, "action")
        run.ask(None, T0 + 50 * SECOND)
        run.ask(answered(lemur_plan, "run.5", T0 + 70 * SECOND), T0 + 60 * SECOND)
        run.states(replace(motion, joint_positions=motion.joint_positions + 0.3), T0 + 70 * SECOND)
        run.ask(answered(lemur_plan, "run.6", T0 + 100 * SECOND), T0 + 90 * SECOND, "action")
    report = report_of_bag(directory / "run", 20)
    return Told(report, page_of(report, directory), measured)


def test_every_request_is_listed_with_door_time_status_and_numbers(told: Told) -> None:
    assert told.page.row("run.1") == [
        *("run.1", "service", "11:06:41.000", "0 SOLVED", "1, 0, 0, 0", "10", "50"),
        *("1.1072", "15.63", "19.40", "1.8", "0.250", told.page.row("run.1")[-1]),
    ]
    listed = [(row[0], row[1], row[3]) for row in told.page.rows if len(row) == 13][1:]
    assert listed == [
        ("run.1", "service", "0 SOLVED"),
        ("run.2", "service", "100 NO_STATE"),
        ("run.3", "action", "301 COLLISION"),
        ("run.unanswered", "service", "unanswered"),
        ("run.5", "service", "0 SOLVED"),
        ("run.6", "action", "0 SOLVED"),
    ]
    assert "6 requests: 3 solved, 2 refused, 1 unanswered" in told.page.words


def test_what_goes_on_from_a_running_plan_has_the_duration_that_is_left() -> None:
    answer = PlanAnswer(plans=[PlanMessage(duration=8.4)])
    answer.plans[0].joint_trajectory.points = [JointTrajectoryPoint()]
    going_on = recorded(None, answer, request=PlanRequest(replan_active=True))
    assert reported_request(going_on).duration == 8.4
    answer.status.code = Status.TOO_LATE
    assert reported_request(going_on).duration is None


def test_age_and_source_of_what_a_plan_was_made_from_are_told(
    lemur_capture: PlanningProblem, lemur_plan: Plan, tmp_path: Path
) -> None:
    run, answer = Run(tmp_path / "run", lemur_capture), answered(lemur_plan, "run.1", T0)
    answer.inputs.received_stamp = time_message(T0)
    answer.inputs.state_stamp = time_message(T0 - SECOND // 4)
    answer.inputs.state_source = "chaser_state"
    answer.inputs.obstacles_stamp = time_message(T0 - 3 * SECOND)
    with run.bag:
        run.ask(answer, T0)
    page = page_of(report_of_bag(tmp_path / "run", 20), tmp_path)
    assert "0.250 s old, chaser_state" in page.words
    assert "3.000 s old" in page.words


def test_refusals_have_their_reasons_in_full_and_their_attempts_numbers_marked(told: Told) -> None:
    rows = told.page.rows
    for plan_id, reason in (("run.2", EVIL), ("run.3", "c1 is in the way")):
        assert rows[rows.index(told.page.row(plan_id)) + 1] == [reason]
    assert told.page.row("run.3")[7:11] == ["1.1072 *", "15.63 *", "19.40 *", "1.8 *"]
    assert told.page.row("run.2")[7:] == 6 * ["-"]


def test_what_a_user_should_know_of_a_robot_stands_in_the_header() -> None:
    robot = load_scenario(CONFIG / "scenarios" / "rail_capture.yaml").robot
    told = replace(robot, notes=("joint_9 is held", "two links touch"))
    notes = [value for name, value in robot_facts(told) if name == "note on the robot"]
    assert notes == ["joint_9 is held", "two links touch"]


def test_where_a_joint_slides_no_figure_is_of_angles_alone() -> None:
    robot = load_scenario(CONFIG / "scenarios" / "rail_capture.yaml").robot
    found = joint_angles(robot)
    assert (found.title, found.labels[0]) == ("joint positions", "rail [m]")


def test_the_header_says_which_bag_of_what_robot_and_node_it_is(told: Told) -> None:
    facts = {row[0]: row[1] for row in told.page.rows if len(row) == 2}
    assert facts["bag"].endswith("/run")
    assert facts["node"] == "/ff_planner"
    assert facts["versions"] == "numpy 2.0.0"
    assert facts["robot"].startswith("lemur: 7 joints from chaser to end_effector")
    assert facts["recorded"] == "2026-11-18 11:06:41.000 UTC, 89.5 s"
    assert "parameters.yaml" in facts["attached"]


def test_timing_is_told_from_the_request_on(told: Told) -> None:
    (row,) = (row for row in told.page.rows if row[:1] == ["run.1"] and len(row) == 5)
    assert row[1:] == ["11:06:41.000", "-", "0.500", "9.000"]


@pytest.mark.parametrize("answers", [9, 10])
def test_solve_times_are_a_histogram_where_there_are_enough(answers: int, tmp_path: Path) -> None:
    times = [0.1 * (1 + k) for k in range(answers)]
    requests = [ReportedRequest("plan", "service", asked_ns=10**18, solve_time=t) for t in times]
    save_page(Report("run", (), (), tuple(requests)), tmp_path / "page.html")
    page = Page((tmp_path / "page.html").read_text("utf-8"))
    assert ("solve-times" in page.plots) == (answers == 10)
    if answers == 10:
        assert sorted(numbers(page.plot("solve-times")["data"][0]["x"])) == pytest.approx(times)


def test_a_page_begins_with_what_happened_and_ends_with_the_file(told: Told) -> None:
    words = told.page.words
    happened = words.index("6 requests: 3 solved, 2 refused, 1 unanswered")
    worst = words.index("Least clearance: 1.8 mm, run.1.")
    facts, plans = words.index("About this file"), words.index("Plans")
    assert happened < worst < words.index("Requests") < plans < facts < words.index("/run")


def test_a_single_plan_is_its_page_with_the_picture_before_every_table(
    answer: dict[str, Any], tmp_path: Path
) -> None:
    text = (page_of(report_of(answer, tmp_path), tmp_path)).words
    assert "Solved. It takes 10 s; clearance 1.8 mm; " in text
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    scene, table = page.index('id="plan-0-scene"'), page.index("<table")
    assert page.index("Solved. It takes") < scene < table
    assert page.index(">At its worst, as planned<") < page.index(">Asked<")


def test_every_plan_has_its_plots_and_nothing_else_has(told: Told) -> None:
    expected = [f"plan-{k}-{name}" for k in (0, 4, 5) for name in PLOTS]
    expected += ["plan-0-deviations", "plan-4-deviations"]
    assert sorted(told.page.plots) == sorted(expected)
    assert sorted(told.page.plots.values()) == sorted(told.page.data)


def test_curves_are_the_plans_and_the_measured_states_own_numbers(
    told: Told, lemur_plan: Plan
) -> None:
    planned, measured = lemur_plan.trajectory, told.measured
    for name, of in (
        ("chaser-pose", "chaser_positions"),
        ("chaser-velocity", "chaser_linear_velocities"),
    ):
        for method, motion in (("planned", planned), ("measured", measured)):
            left = told.page.curves(f"plan-0-{name}", method)[::2]
            for (time, values), wanted in zip(left, getattr(motion, of).T, strict=True):
                np.testing.assert_allclose(time, motion.time, atol=1e-9)
                np.testing.assert_allclose(values, wanted, atol=1e-12)
    for method, motion, kinds in (("planned", planned, 3), ("measured", measured, 2)):
        curves = [values for _, values in told.page.curves("plan-0-joints", method)]
        angles, rates, *torques = (curves[kind::kinds] for kind in range(kinds))
        np.testing.assert_allclose(angles, np.rad2deg(motion.joint_positions.T), atol=1e-9)
        np.testing.assert_allclose(rates, np.rad2deg(motion.joint_velocities.T), atol=1e-9)
        if torques:
            np.testing.assert_array_equal(torques[0], motion.joint_torques.T)
    x, y, z = (values for _, values in told.page.curves("plan-0-end-effector", "planned")[::2])
    np.testing.assert_array_equal(np.stack([x, y, z], axis=1), planned.ee_positions)


def test_the_text_says_what_was_asked(told: Told) -> None:
    """Start, target and obstacles of the scenario, in metres and degrees."""
    facts = {row[0]: row[1] for row in told.page.rows if len(row) == 2}
    assert facts["start, chaser"].startswith("[0.000, 0.000, 0.000] m")
    start, target = facts["start, end effector"], facts["target, end effector"]
    assert start == "[0.800, 0.400, 0.600] m, roll, pitch, yaw [-45.0, 55.0, -65.0] deg"
    assert target == "[1.700, 0.400, 0.600] m, roll, pitch, yaw [-65.0, 80.0, -85.0] deg"
    assert "0.900 m and 25.8 deg from the start" in told.page.words
    assert "moving [0.02, 0, 0.05] m/s, turning [0, 2.865, 0.573] deg/s" in told.page.words
    assert facts["obstacles"].startswith("3: c1, c2, c3")
    obstacle = next(row for row in told.page.rows if row[0] == "c1" and len(row) == 7)
    assert obstacle[1:4] == ["[1.200, 0.400, 0.540]", "0.2", "at rest"]


def test_the_text_names_the_worst_joints_and_the_nearest_obstacle(
    told: Told, lemur_plan: Plan
) -> None:
    motion, robot = lemur_plan.trajectory, told.report.requests[0].plan.robot
    facts = {row[0]: row[1] for row in reversed(told.page.rows) if len(row) == 2}
    upper, lower = robot.upper_position_limits, robot.lower_position_limits
    margins = np.minimum(upper - motion.joint_positions, motion.joint_positions - lower)
    _, joint = np.unravel_index(margins.argmin(), margins.shape)
    words = f"joint_{joint + 1}, {np.rad2deg(margins.min()):.1f} deg from its limit, at "
    assert facts["nearest to a joint limit"].startswith(words)
    shares = np.abs(motion.joint_velocities) / robot.velocity_limits
    words = f"joint_{shares.max(axis=0).argmax() + 1}, "
    assert facts["fastest beside its limit"].startswith(words)
    assert f"({100 * shares.max():.0f} % of its limit)" in facts["fastest beside its limit"]
    peaks = lemur_plan.metrics.peak_joint_torques
    words = f"joint_{np.argmax(peaks / robot.effort_limits) + 1}, "
    assert facts["most torque beside its limit"].startswith(words)
    least = re.fullmatch(
        r"(.*) mm between the link from joint_4 to joint_5 and c2, at (.*) s; "
        r"for certain never less than 1\.8 mm",
        facts["least clearance"],
    )
    assert least is not None
    ((time, values),) = told.page.curves("plan-5-clearance", "planned")
    assert float(least[1]) == pytest.approx(values.min(), abs=0.05)
    assert float(least[2]) == pytest.approx(time[values.argmin()], abs=0.005)


def test_a_plan_has_one_clock_for_all_its_plots_and_times_in_the_text_set_it(told: Told) -> None:
    clocks = [found for tag, found in told.page.elements if found.get("type") == "range"]
    assert [clock["max"] for clock in clocks] == ["10.0"] * 3
    times = [float(found["data-time"]) for _, found in told.page.elements if "data-time" in found]
    assert len(times) > 3 * (4 + 3 * 7 + 3)
    assert all(0.0 <= time <= 10.0 for time in times)
    scene = told.page.plot("plan-0-scene")
    assert [float(frame["name"]) for frame in scene["frames"]] == pytest.approx(
        np.linspace(0.0, 10.0, 50), abs=0.005
    )


def test_a_narrow_screen_gets_every_cell_with_the_name_of_its_column(told: Told) -> None:
    cells = [found["data-column"] for tag, found in told.page.elements if "data-column" in found]
    assert {"plan id", "clearance [mm]", "largest torque", "least distance [mm]"} <= set(cells)
    assert ("meta", "width=device-width") in [
        (tag, found.get("content")) for tag, found in told.page.elements
    ]


def test_the_clearance_plot_ends_where_the_metric_says(told: Told, lemur_plan: Plan) -> None:
    ((_, values),) = told.page.curves("plan-0-clearance", "planned")
    # The metric is what is certain.
    assert 0.0 <= values.min() - 1e3 * lemur_plan.metrics.min_clearance < 1.0


def test_the_scene_plays_planned_and_measured_arms(told: Told, lemur_plan: Plan) -> None:
    scene = told.page.plot("plan-0-scene")
    assert len(scene["frames"]) == 50
    assert {trace["name"] for trace in scene["data"]} == {
        "obstacles",
        "goal",
        "planned",
        "measured",
    }
    # The slider of the page moves all plots.
    assert "sliders" not in scene["layout"]
    end = paper_terms_at(lemur_plan, 49).r_ee
    arm = scene["frames"][-1]["data"][1]
    drawn = np.stack([numbers(arm[axis]) for axis in "xyz"], axis=1)
    np.testing.assert_allclose(drawn[~np.isnan(drawn[:, 0])][-1], end, atol=1e-9)


def test_deviations_are_those_that_the_states_were_given(told: Told, lemur_plan: Plan) -> None:
    moved = replace(lemur_plan, trajectory=told.measured)
    ee = [
        np.linalg.norm(paper_terms_at(moved, i).r_ee - paper_terms_at(lemur_plan, i).r_ee)
        for i in range(50)
    ]
    time = lemur_plan.trajectory.time
    for label, size, point in (
        ("chaser [mm]", 5.0, 20),
        ("chaser [deg]", np.rad2deg(0.02), 10),
        ("end effector [mm]", 1e3 * max(ee), int(np.argmax(ee))),
        ("worst joint [deg]", np.rad2deg(0.01), 30),
        ("worst joint [deg/s]", np.rad2deg(0.002), 40),
    ):
        found = told.page.row(label)
        assert float(found[1]) == pytest.approx(size, rel=6e-3), label
        assert float(found[2]) == pytest.approx(time[point], abs=1e-3), label
    ((_, chaser), *_) = told.page.curves("plan-0-deviations", "deviation")
    assert chaser.max() == pytest.approx(5.0, rel=1e-6)


def test_between_the_points_the_plan_is_interpolated(
    lemur_capture: PlanningProblem, tmp_path: Path
) -> None:
    """States at other times than the plan's points, of the same motion on twice as many points."""
    fine = plan(replace(lemur_capture, points=99), load_parameters().planner)
    rows = {
        name: getattr(fine.trajectory, name)[::2] for name in fine.trajectory.__dataclass_fields__
    }
    coarse = replace(fine, trajectory=Trajectory(**rows))
    run = Run(tmp_path / "run", lemur_capture)
    with run.bag:
        run.ask(answered(coarse, "run.1", T0), T0)
        run.states(fine.trajectory, T0)
    (request,) = report_of_bag(tmp_path / "run", 1).requests
    assert request.plan is not None
    found = request.plan.deviations
    assert found is not None
    assert len(found.time) == 99
    assert 0.0 < found.chaser_position.max() < 1e-5
    assert 0.0 < found.joint_position.max() < 1e-5
    assert 0.0 < found.ee_position.max() < 1e-5


def test_of_very_many_states_some_are_drawn_and_the_worst_of_each_kind_always() -> None:
    count, peaks = 20_001, (1, 1234, 4321, 7777, 15_001, 19_999)
    sizes = np.zeros((6, count))
    sizes[range(6), peaks] = 1.0
    rows = shown_rows(Deviations(np.arange(count) * 1e-3, *sizes))
    assert set(peaks) | {0, count - 1} <= set(rows.tolist())
    assert 300 < len(rows) < 500
    assert np.diff(rows).max() < 60


def test_who_did_not_follow_or_was_not_measured_is_told(told: Told) -> None:
    assert "more than tracking.max_joint_position" in told.page.words
    assert told.page.words.count("holds no measured state while it ran") == 1
    plans = [request.plan for request in told.report.requests if request.plan is not None]
    assert [plan.measured is not None for plan in plans] == [True, True, False]
    assert [len(plan.remarks) for plan in plans] == [0, 1, 1]
    assert told.page.curves("plan-5-chaser-pose", "measured") == []


def test_what_comes_from_a_bag_is_text_and_never_a_tag(told: Told) -> None:
    assert EVIL in told.page.words
    assert "img" not in told.page.tags
    assert len(told.page.scripts) == 2


def test_the_page_loads_nothing_and_lets_only_its_own_scripts_run(told: Told) -> None:
    assert all(target.startswith("#plan-") for target in told.page.referred)
    assert "link" not in told.page.tags
    assert "iframe" not in told.page.tags
    hashes = re.findall(r"'sha256-([^']+)'", told.page.policy)
    assert hashes == [
        base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
        for script in told.page.scripts
    ]
    assert told.page.policy.startswith("default-src 'none'; script-src 'sha256-")
    assert "unsafe-eval" not in told.page.policy
    assert "://" not in told.page.scripts[1]


@pytest.mark.parametrize("name", ["plan_id", "joint", "obstacle"])
def test_names_in_plots_are_no_tags_either(
    name: str, lemur_capture: PlanningProblem, lemur_plan: Plan, tmp_path: Path
) -> None:
    problem, named = lemur_capture, lemur_plan
    evil = "<img/src=x>"
    if name == "obstacle":
        spheres = tuple(replace(s, id=f"{s.id}{evil}") for s in problem.obstacles)
        problem = replace(problem, obstacles=spheres)
    if name == "joint":
        urdf = problem.robot.urdf.replace("joint_1", "&lt;img/src=x&gt;")
        problem = replace(problem, robot=robot_from_urdf_text(urdf, "chaser", "end_effector"))
        named = replace(named, joint_names=problem.robot.joint_names)
        assert evil in named.joint_names
    run = Run(tmp_path / "run", problem)
    with run.bag:
        run.ask(answered(named, evil if name == "plan_id" else "run.1", T0), T0)
    page = page_of(report_of_bag(tmp_path / "run", 1), tmp_path)
    assert len(page.plots) == len(PLOTS)
    assert "img" not in page.tags
    assert evil not in json.dumps(page.data)


def test_a_bag_with_refusals_only_is_a_page_without_plots(
    lemur_capture: PlanningProblem, tmp_path: Path
) -> None:
    run = Run(tmp_path / "run", lemur_capture)
    with run.bag:
        refusal = FfPlannerError(Status.BUSY, "another request is being planned")
        run.ask(answer_of(refusal, "run.1", 0.0), T0)
    page = page_of(report_of_bag(tmp_path / "run", 20), tmp_path)
    assert page.row("run.1")[3] == "500 BUSY"
    assert page.plots == {}
    assert "Plans" not in page.words


def test_an_empty_bag_is_a_page(lemur_capture: PlanningProblem, tmp_path: Path) -> None:
    with Run(tmp_path / "run", lemur_capture).bag:
        pass
    page = page_of(report_of_bag(tmp_path / "run", 20), tmp_path)
    assert "0 requests: 0 solved" in page.words


def test_the_last_plans_are_drawn_and_the_page_says_that_others_are_not(
    lemur_capture: PlanningProblem, lemur_plan: Plan, tmp_path: Path
) -> None:
    run = Run(tmp_path / "run", lemur_capture)
    with run.bag:
        for k in range(4):
            start_ns = T0 + (20 * k + 5) * SECOND
            run.ask(answered(lemur_plan, f"run.{k}", start_ns), T0 + 20 * k * SECOND)
    report = report_of_bag(tmp_path / "run", 1)
    assert [request.plan is not None for request in report.requests] == [False, False, False, True]
    assert "of 4 plans the last 1 are drawn; --plans N draws more" in report.notes
    assert all(request.plan is None for request in report_of_bag(tmp_path / "run", 0).requests)


def test_a_plan_is_measured_until_the_next_one_takes_the_arm_over(
    lemur_capture: PlanningProblem, lemur_plan: Plan, tmp_path: Path
) -> None:
    run = Run(tmp_path / "run", lemur_capture)
    with run.bag:
        run.ask(answered(lemur_plan, "run.1", T0 + 5 * SECOND), T0)
        run.ask(answered(lemur_plan, "run.2", T0 + 9 * SECOND), T0 + SECOND)
        run.states(lemur_plan.trajectory, T0 + 5 * SECOND)
    first, second = report_of_bag(tmp_path / "run", 20).requests
    assert first.plan is not None
    assert first.plan.deviations is not None
    assert second.plan is not None
    assert second.plan.deviations is not None
    assert first.plan.deviations.time[-1] == pytest.approx(4.0, abs=10 / 49)
    assert first.plan.deviations.time[-1] <= 4.0
    assert second.plan.deviations.time[-1] == pytest.approx(6.0, abs=1e-6)


def test_a_plan_is_measured_until_any_later_one_takes_the_arm_over_however_early(
    lemur_capture: PlanningProblem, lemur_plan: Plan, tmp_path: Path
) -> None:
    """Three plans, of which the last one begins before the second, which then never begins."""
    run = Run(tmp_path / "run", lemur_capture)
    with run.bag:
        for number, (start, asked) in enumerate(((5, 0), (11, 1), (8, 2)), start=1):
            answer = answered(lemur_plan, f"run.{number}", T0 + start * SECOND)
            run.ask(answer, T0 + asked * SECOND)
        run.states(lemur_plan.trajectory, T0 + 5 * SECOND)
    first, second, third = (one.plan for one in report_of_bag(tmp_path / "run", 20).requests)
    assert first is not None
    assert second is not None
    assert third is not None
    assert first.deviations is not None
    assert third.deviations is not None
    assert first.deviations.time[-1] == pytest.approx(3.0, abs=10 / 49)
    assert first.deviations.time[-1] <= 3.0
    assert second.deviations is None
    assert third.deviations.time[-1] == pytest.approx(7.0, abs=1e-6)


def test_a_plan_that_was_only_asked_for_is_measured_once_it_was_published(
    lemur_capture: PlanningProblem, lemur_plan: Plan, tmp_path: Path
) -> None:
    """Of three plans the second waits for ever: the first one goes on meanwhile."""
    run = Run(tmp_path / "run", lemur_capture)
    with run.bag:
        run.ask(answered(lemur_plan, "run.1", T0 + 5 * SECOND), T0)
        run.ask(answered(lemur_plan, "run.2", T0 + 7 * SECOND), T0, plan_only=True)
        run.ask(answered(lemur_plan, "run.3", T0 + 9 * SECOND), T0, plan_only=True)
        run.put("/published_plan", PublishedPlan(plan_id="run.3"), T0 + SECOND)
        run.states(lemur_plan.trajectory, T0 + 5 * SECOND)
    first, second, third = (one.plan for one in report_of_bag(tmp_path / "run", 20).requests)
    assert first is not None
    assert second is not None
    assert third is not None
    assert first.deviations is not None
    assert third.deviations is not None
    assert first.deviations.time[-1] == pytest.approx(4.0, abs=10 / 49)
    assert third.deviations.time[-1] == pytest.approx(6.0, abs=1e-6)
    assert second.deviations is None
    assert any("never published" in remark for remark in second.remarks)


def test_states_from_odometry_and_joint_states_are_paired(
    lemur_capture: PlanningProblem, lemur_plan: Plan, tmp_path: Path
) -> None:
    """A sensor half a metre off the chaser's centre of mass, axes turned by a quarter about z."""
    lever, turn = np.array([0.5, 0.0, 0.1]), Rotation.from_euler("z", 90, degrees=True)
    odometry = {
        "child_frame_id": "sensor",
        "sensor_position_in_chaser": lever.tolist(),
        "sensor_quaternion_in_chaser_xyzw": turn.as_quat().tolist(),
    }
    run = Run(tmp_path / "run", lemur_capture, state_source="odometry", odometry=odometry)
    motion = lemur_plan.trajectory
    with run.bag:
        run.ask(answered(lemur_plan, "run.1", T0), T0)
        for i, stamp_ns in enumerate(stamps(motion, T0)):
            chaser = Rotation.from_quat(motion.chaser_quaternions_xyzw[i])
            message = Odometry(child_frame_id="sensor")
            message.header = Header(stamp=time_message(stamp_ns), frame_id=FRAME)
            message.pose.pose = pose_message(
                (motion.chaser_positions[i] + chaser.apply(lever)).tolist(),
                (chaser * turn).as_quat().tolist(),
            )
            run.put("/odometry", message, stamp_ns)
            joints = JointState(
                header=Header(stamp=time_message(stamp_ns + 2_000_000)),
                name=[*reversed(lemur_plan.joint_names), "gripper"],
                position=[*reversed(motion.joint_positions[i].tolist()), 9.0],
                velocity=[*reversed(motion.joint_velocities[i].tolist()), 9.0],
            )
            # Those of the last point come after the end of the plan.
            run.put("/joint_states", joints, stamp_ns + 2_000_000)
            run.put("/planned_joint_states", JointState(name=["none"]), stamp_ns)
    (request,) = report_of_bag(tmp_path / "run", 20).requests
    assert request.plan is not None
    measured, found = request.plan.measured, request.plan.deviations
    assert measured is not None
    assert found is not None
    assert len(measured.time) == 49
    assert found.chaser_position.max() < 1e-9
    assert found.joint_position.max() < 1e-9
    (unusable,) = request.plan.remarks
    assert unusable.startswith("1 measurements could not be used; the first: no joint_states are")


def test_states_that_cannot_be_used_are_counted(
    lemur_capture: PlanningProblem, lemur_plan: Plan, tmp_path: Path
) -> None:
    run = Run(tmp_path / "run", lemur_capture)
    motion = lemur_plan.trajectory
    with run.bag:
        run.ask(answered(lemur_plan, "run.1", T0), T0)
        for i, stamp_ns in enumerate(stamps(motion, T0)):
            names, frame = lemur_plan.joint_names, FRAME if i % 2 else "elsewhere"
            state = state_message(state_at(motion, i), names, stamp_ns, frame)
            run.put("/chaser_state", state, stamp_ns)
    (request,) = report_of_bag(tmp_path / "run", 20).requests
    assert request.plan is not None
    assert request.plan.deviations is not None
    assert len(request.plan.deviations.time) == 25
    assert "25 measurements could not be used" in request.plan.remarks[-1]
    assert "'elsewhere'" in request.plan.remarks[-1]


def test_a_damaged_answer_is_not_drawn_and_the_page_says_why(
    lemur_capture: PlanningProblem, lemur_plan: Plan, tmp_path: Path
) -> None:
    run = Run(tmp_path / "run", lemur_capture)
    other = answered(lemur_plan, "run.1", T0)
    other.plans[0].joint_trajectory.joint_names = [f"other_{k}" for k in range(7)]
    broken = answered(lemur_plan, "run.2", T0)
    broken.plans[0].joint_trajectory.points[7].velocities = [float("nan")] * 7
    short = answered(lemur_plan, "run.3", T0)
    short.plans[0].chaser_twists = []
    empty = PlanAnswer(plan_id="run.4")
    with run.bag:
        for k, answer in enumerate((other, broken, short, empty)):
            run.ask(answer, T0 + k * SECOND)
    report = report_of_bag(tmp_path / "run", 20)
    assert [request.plan for request in report.requests] == [None] * 4
    notes = "\n".join(report.notes)
    for words in (
        "run.1 is not drawn: joint_trajectory.joint_names is other_0",
        "run.2 is not drawn: joint_velocities is not finite",
        "run.3 is not drawn: ",
        "run.4 is not drawn: ",
    ):
        assert words in notes


@pytest.mark.parametrize(
    ("attached", "task", "words"),
    [
        ("", "{robot}", "run.1 is not drawn: robot.urdf is sha256:"),
        ("<robot/>", "{robot}", "run.1 is not drawn: robot.urdf is sha256:"),
        ("{urdf}", "", "run.1 is not drawn: task is missing: it was refused before"),
        ("{urdf}", "{", "run.1 is not drawn: task is damaged: JSON: "),
    ],
    ids=["no URDF", "another URDF", "no task", "damaged task"],
)
def test_without_its_task_and_robot_no_plan_is_drawn_and_the_page_says_why(
    attached: str,
    task: str,
    words: str,
    lemur_capture: PlanningProblem,
    lemur_plan: Plan,
    tmp_path: Path,
) -> None:
    urdf = lemur_capture.robot.drawn_urdf
    whole = task_json(PlanningTask(lemur_capture, load_parameters().planner), urdf)
    told = exchange(
        answered(lemur_plan, "run.1", T0), ns=T0, task=whole if task == "{robot}" else task
    )
    write_bag(
        tmp_path / "run",
        told,
        attached={"robot.urdf": attached.replace("{urdf}", urdf).encode()} if attached else {},
    )
    report = report_of_bag(tmp_path / "run", 20)
    (request,) = report.requests
    assert (request.code, request.plan) == (Status.SOLVED, None)
    assert any(note.startswith(words) for note in report.notes)


def test_an_answer_of_another_form_is_left_out_and_the_page_says_why(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """As a definition of strangers may have it."""
    answer: Any = SimpleNamespace(status=SimpleNamespace(code=0), plans=0.5)
    monkeypatch.setattr(from_bag, "exchanges", lambda _: [recorded(None, answer)])
    report = report_of_bag(write_bag(tmp_path / "run"), 20)
    assert report.requests == ()
    assert any(note.startswith("run.1 is left out, it is damaged: ") for note in report.notes)


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        (None, "no parameters.yaml is attached: nothing measured is compared"),
        (b": [", "parameters.yaml is damaged, and nothing measured is compared"),
        (b"tracking: {max_angle: -1}", "parameters.yaml is damaged, and nothing measured"),
    ],
)
def test_without_the_parameters_of_its_node_nothing_measured_is_compared_and_the_page_says_so(
    parameters: bytes | None,
    words: str,
    lemur_capture: PlanningProblem,
    lemur_plan: Plan,
    tmp_path: Path,
) -> None:
    task = task_json(PlanningTask(lemur_capture, load_parameters().planner))
    told = exchange(answered(lemur_plan, "run.1", T0), task=task)
    with BagWriter(tmp_path / "run", flush_interval=0.0) as bag:
        bag.add_record(PROVENANCE, {"node": "/ff_planner"})
        if parameters is not None:
            bag.attach("parameters.yaml", "application/yaml", parameters)
        bag.add_topic("/exchanges", type_name(type(told)), [])
        bag.write("/exchanges", encode(told), T0, T0)
    report = report_of_bag(tmp_path / "run", 20)
    (request,) = report.requests
    assert request.plan is not None
    assert any(note.startswith(words) for note in report.notes)


def test_what_is_no_bag_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BagError):
        report_of_bag(tmp_path / "nothing", 20)


@pytest.fixture
def answer(lemur_capture: PlanningProblem, lemur_plan: Plan) -> dict[str, Any]:
    task = PlanningTask(lemur_capture, load_parameters().planner)
    return json.loads(json.dumps(plan_dictionary(lemur_plan, task, 0.5)))


def report_of(answer: object, directory: Path) -> Report:
    file = directory / "answer.json"
    file.write_text(json.dumps(answer), encoding="utf-8")
    return report_of_answer(file)


def test_an_answer_in_json_gives_the_same_plots(
    answer: dict[str, Any], told: Told, tmp_path: Path
) -> None:
    page = page_of(report_of(answer, tmp_path), tmp_path)
    assert page.row("answer")[1:] == [
        *("command line", "-", "0 SOLVED", "1, 0, 0, 0", "10", "50"),
        *("1.1072", "15.63", "19.40", "1.8", "0.500", page.row("answer")[-1]),
    ]
    assert sorted(page.plots) == sorted(f"plan-0-{name}" for name in PLOTS)
    for name in PLOTS[1:]:
        curves, same = (
            [values for _, values in one.curves(f"plan-{k}-{name}", "planned")]
            for one, k in ((page, 0), (told.page, 5))
        )
        np.testing.assert_allclose(curves, same, atol=1e-9)


def test_an_answer_of_an_earlier_version_lacks_only_what_it_does_not_tell(
    answer: dict[str, Any], tmp_path: Path
) -> None:
    del answer["obstacles"], answer["objective"]
    report = report_of(answer, tmp_path)
    assert report.requests[0].weights is None
    page = page_of(report, tmp_path)
    assert sorted(page.plots) == sorted(f"plan-0-{n}" for n in PLOTS if n != "clearance")
    assert "Which obstacles it avoids is not known." in page.words


def test_a_refusal_in_json_gives_its_reason(tmp_path: Path) -> None:
    refusal = refusal_dictionary(NoPlanFound(Status.COLLISION, EVIL + "\ud800"), 0.1)
    page = page_of(report_of(refusal, tmp_path), tmp_path)
    assert EVIL + "?" in page.words
    assert "301 COLLISION" in page.words


def changed(answer: dict[str, Any], path: Sequence[str], value: Any) -> dict[str, Any]:
    *parents, last = path
    place = answer
    for name in parents:
        place = place[name]
    place[last] = value
    return answer


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (["time"], [1.0, 0.0], "joint_positions"),
        (["chaser_positions"], "here", "chaser_positions"),
        (["metrics"], 3, "metrics.joint_path_length is missing"),
        (["metrics", "penalty"], "no", "metrics.penalty"),
        (["solver", "iterations"], [1, 2], "solver.iterations"),
        (["obstacles"], [{"id": "c1"}], "obstacles[0].center is missing"),
        (["obstacles"], [{"id": "c1", "center": [0, 0], "radius": 1}], "center"),
        (["objective"], {"joint_path_length": -1, "chaser_attitude": 0}, "negative"),
        (["status"], "excellent", "status is excellent"),
    ],
)
def test_json_that_is_no_answer_is_refused_with_file_and_field(
    path: list[str], value: Any, message: str, answer: dict[str, Any], tmp_path: Path
) -> None:
    with pytest.raises(InvalidInput, match=rf"answer\.json: .*{re.escape(message)}"):
        report_of(changed(answer, path, value), tmp_path)


@pytest.mark.parametrize("text", ["{", "", "\xff"])
def test_what_is_no_json_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "answer.json").write_bytes(text.encode("latin-1"))
    with pytest.raises(InvalidInput, match=r"answer\.json: it is (not|empty)"):
        report_of_answer(tmp_path / "answer.json")


def test_the_command_writes_the_page_and_says_what_is_in_it(
    answer: dict[str, Any],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("a.json").write_text(json.dumps(answer), encoding="utf-8")
    assert main(["report", "a.json"]) == 0
    assert capsys.readouterr().out.startswith("a_report.html  1 request: 1 solved, 0 refused")
    assert Path("a_report.html").stat().st_size > 4e6
    Path("pages").mkdir()
    assert main(["report", "a.json", "--output", "pages"]) == 0
    assert Path("pages/a_report.html").read_bytes() == Path("a_report.html").read_bytes()
    capsys.readouterr()
    assert main(["report", "a.json", "--plans", "-1"]) == 2
    assert "--plans is -1" in capsys.readouterr().err
    assert main(["report", "nothing.json"]) == 2
    assert main(["report", "nothing"]) == 2
    assert main(["report", "a.json", "--output", "no/such/directory.html"]) == 2
    assert "Traceback" not in capsys.readouterr().err
