"""A whole capture: each phase begins where the one before ends, contact included."""

from __future__ import annotations

import json
import pickle
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import yaml
from ff_planner_msgs.msg import PlanRequest
from judging import violations
from recorded_requests import only_request
from robots import CONFIG
from ros_processes import read_bag
from scipy.spatial.transform import Rotation

from ff_planner_ros.analysis.plan_json import plan_dictionary
from ff_planner_ros.bag.plans import read_plans
from ff_planner_ros.cli import main
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.errors import EndedBy, InvalidInput, NoPlanFound, OutOfTime, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.motion import from_trajectory
from ff_planner_ros.planning.motion.plan import Plan, RobustReport, WheelMotion
from ff_planner_ros.planning.motion.watch import SEARCHING, Watch
from ff_planner_ros.planning.problem.camera import Camera
from ff_planner_ros.planning.problem.objective import Objective
from ff_planner_ros.planning.problem.problem import (
    Approach,
    ChaserGoal,
    DurationRange,
    Limits,
    Obstacle,
    Parametrisation,
    Posture,
    Target,
    lasting,
)
from ff_planner_ros.planning.problem.scene import scene_of
from ff_planner_ros.planning.scenario.scenario import Defaults, load_task
from ff_planner_ros.planning.scenario.scenario_writer import write_scenario
from ff_planner_ros.planning.task.captured import captured_in
from ff_planner_ros.planning.task.controller_rules import Controller
from ff_planner_ros.planning.task.digest import digest_of
from ff_planner_ros.planning.task.following import following, held_body, phase_tasks
from ff_planner_ros.planning.task.phase import Phase
from ff_planner_ros.planning.task.planning_task import PlanningTask
from ff_planner_ros.planning.task.tail import EndBehaviour
from ff_planner_ros.planning.task.task import perform
from ff_planner_ros.planning.task.whole import bodies_of, whole, whole_scene
from ff_planner_ros.report.from_bag import report_of_bag
from ff_planner_ros.report.run_page import save_page
from ff_planner_ros.report.run_report import report_of_answer
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.momentum import total_momentum
from ff_planner_ros.robot.urdf.payload import Payload
from ff_planner_ros.ros.messages.answers import status_message
from ff_planner_ros.ros.messages.phases import phase_message, phases_in
from ff_planner_ros.ros.messages.requests import request_of_task
from ff_planner_ros.ros.messages.to_messages import request_message
from ff_planner_ros.ros.outputs.markers import SNAPSHOTS, plan_markers
from ff_planner_ros.ros.outputs.prediction import predicted_relative_pose, predicted_target
from ff_planner_ros.runs.offline_bag import record_answer
from ff_planner_ros.runs.replay import Verdict, replay
from ff_planner_ros.simulation.verification import verify

SCENARIO = CONFIG / "scenarios/whole_capture.yaml"
SETTINGS = load_parameters().planner
DEFAULTS = Defaults(SETTINGS)


@pytest.fixture(scope="module")
def task() -> PlanningTask:
    return load_task(SCENARIO, DEFAULTS)


@pytest.fixture(scope="module")
def plan(task: PlanningTask) -> Plan:
    return perform(task)


def scenario(directory: Path, change: Callable[[dict[str, Any]], object]) -> Path:
    document = yaml.safe_load(SCENARIO.read_text(encoding="utf-8"))
    document["robot"]["urdf"] = str(CONFIG / "robots/lemur/lemur.urdf")
    change(document)
    path = directory / "scenario.yaml"
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    return path


def test_every_phase_passes_the_check_of_its_own_task(task: PlanningTask, plan: Plan) -> None:
    assert len(plan.phases) == 3
    for one, found in phase_tasks(task, plan):
        problem = lasting(one.problem, found.duration)
        assert not violations(problem, found, one.settings)
    assert plan.phases[2].trajectory.joint_velocities[-1] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.law("PLAN-18")
def test_each_begins_where_the_one_before_ends(plan: Plan) -> None:
    """At the grasp what moves apart, by what a plan may miss its goal, moves together then."""
    names = {item.name for item in fields(plan.trajectory)} - {"time", "joint_torques"}
    for before, after in zip(plan.phases, plan.phases[1:], strict=False):
        for name in names:
            first, last = getattr(after.trajectory, name)[0], getattr(before.trajectory, name)[-1]
            np.testing.assert_allclose(first, last, atol=1e-5, err_msg=name)


@pytest.mark.law("PLAN-18")
def test_the_momentum_of_chaser_arm_and_target_is_one_from_the_first_point_to_the_last(
    task: PlanningTask, plan: Plan
) -> None:
    """The target's by the textbook until it is held; then it is a part of the robot."""
    found = list[Array]()
    for one, phase in phase_tasks(task, plan):
        robot, body = one.problem.robot, one.problem.target_body
        data = robot.model.createData()
        for q, v, time in zip(
            *from_trajectory(robot, phase.trajectory), phase.trajectory.time, strict=True
        ):
            momentum = total_momentum(robot, data, q, v)
            if body is not None:
                there = body.after(float(time))
                axes = pin.Quaternion(there.quaternion_xyzw).toRotationMatrix()
                linear = body.mass * there.linear_velocity
                spin = axes @ body.inertia @ axes.T @ there.angular_velocity
                angular = np.cross(there.position, linear) + spin
                momentum += np.concatenate([linear, angular])
            found.append(momentum)
    scale = np.abs(found).max()
    np.testing.assert_allclose(found, np.tile(found[0], (len(found), 1)), atol=1e-5 * scale)


def test_the_captured_body_is_where_its_grasp_is_held(task: PlanningTask, plan: Plan) -> None:
    body, tasks = task.problem.target_body, [one for one, _ in phase_tasks(task, plan)]
    assert body is not None
    held, robot = held_body(body, task.problem.robot), tasks[1].problem.robot
    assert robot.payload is not None
    np.testing.assert_array_equal(robot.payload.inertia, held.inertia)
    q, _ = from_trajectory(robot, plan.phases[1].trajectory)
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q[0])
    tip = pin.updateFramePlacement(robot.model, data, robot.tip_frame_id)
    there = body.after(plan.phases[0].trajectory.time[-1])
    np.testing.assert_allclose(tip.act(held.center_of_mass), there.position, atol=1e-5)
    axes = pin.Quaternion(there.quaternion_xyzw).toRotationMatrix()
    spins = tip.rotation @ held.inertia @ tip.rotation.T, axes @ body.inertia @ axes.T
    np.testing.assert_allclose(*spins, atol=1e-2)
    assert len(held.shapes) == len(body.obstacles)
    assert {one.shape.kind for one in held.shapes} >= {"cone", "box", "cylinder"}


def test_its_shapes_are_where_they_were_on_the_body(task: PlanningTask, plan: Plan) -> None:
    body, robot = task.problem.target_body, task.problem.robot
    assert body is not None
    there = body.after(plan.phases[0].trajectory.time[-1])
    place = pin.SE3(pin.Quaternion(there.quaternion_xyzw).toRotationMatrix(), there.position)
    motion = plan.phases[0].trajectory
    axes = pin.Quaternion(motion.ee_quaternions_xyzw[-1]).toRotationMatrix()
    tip = pin.SE3(axes, motion.ee_positions[-1])
    for held, fixed in zip(held_body(body, robot).shapes, body.obstacles, strict=True):
        assert not fixed.is_sphere
        for point in (np.zeros(3), np.array([0.3, 0.5, -0.7])):
            turns = [
                pin.Quaternion(one.quaternion_xyzw).toRotationMatrix() for one in (held, fixed)
            ]
            seen = tip.act(held.position + turns[0] @ point)
            np.testing.assert_allclose(
                seen, place.act(fixed.position + turns[1] @ point), atol=1e-5, err_msg=held.id
            )


def test_what_moves_goes_on_until_the_next_phase(task: PlanningTask, plan: Plan) -> None:
    passing = Obstacle.sphere("passing", np.array([9.0, 0.0, 0.0]), 0.1, np.array([0.1, 0.2, 0.0]))
    problem = replace(task.problem, obstacles=(*task.problem.obstacles, passing))
    after = following(replace(task, problem=problem), plan.phases[0]).problem
    (seen,) = [one for one in after.obstacles if one.is_sphere]
    lasted = plan.phases[0].trajectory.time[-1]
    np.testing.assert_allclose(seen.center, [9.0 + 0.1 * lasted, 0.2 * lasted, 0.0])


def test_the_next_phase_begins_as_the_contact_leaves_it(task: PlanningTask, plan: Plan) -> None:
    """The body drifts faster than the plan knows: what it brings along stays in the whole."""
    body = task.problem.target_body
    assert body is not None
    faster = replace(body, linear_velocity=body.linear_velocity + 0.1 * np.eye(3)[0])
    problem = replace(task.problem, target_body=faster)
    problem = replace(problem, target=faster.target(problem.duration))
    after = following(replace(task, problem=problem), plan.phases[0]).problem
    usual = following(task, plan.phases[0]).problem
    momenta = [
        total_momentum(
            one.robot, one.robot.model.createData(), *configuration(one.robot, one.start)
        )[:3]
        for one in (after, usual)
    ]
    np.testing.assert_allclose(momenta[0] - momenta[1], [0.1 * body.mass, 0.0, 0.0], atol=1e-3)


@pytest.mark.ci
def test_every_phase_comes_true_in_mujoco(task: PlanningTask, plan: Plan) -> None:
    for one, found in phase_tasks(task, plan):
        problem = lasting(one.problem, found.duration)
        assert verify(problem.robot, found.trajectory, scene_of(problem)).passed


@pytest.mark.law("PLAN-19")
@pytest.mark.ci
def test_the_impulse_is_told_and_its_limit_refuses_by_name(task: PlanningTask, plan: Plan) -> None:
    told = plan.metrics.capture_impulse
    assert 0.01 < told < 0.2
    few = replace(task, settings=replace(task.settings, starts=3))
    for changed in (replace(few, then=()), few):
        problem = changed.problem
        limited = replace(problem, limits=replace(problem.limits, capture_impulse=0.9 * told))
        with pytest.raises(
            NoPlanFound, match=r"capture_impulse within the tolerances of the grasp is 0\.\d+ N s"
        ) as refused:
            perform(replace(changed, problem=limited))
        assert refused.value.status is Status.LIMIT_VIOLATED


def test_a_written_scenario_is_the_same_task(task: PlanningTask, tmp_path: Path) -> None:
    write_scenario(task, tmp_path / "written.yaml")
    again = load_task(tmp_path / "written.yaml", DEFAULTS)
    assert again.digest == task.digest
    assert len(again.then) == 2


@pytest.mark.ci
def test_its_bag_replays_to_the_last_bit(task: PlanningTask, plan: Plan, tmp_path: Path) -> None:
    record_answer(tmp_path / "bag", task, plan, 0.5)
    recorded = only_request(tmp_path / "bag")
    assert recorded.planned_task().digest == task.digest
    replayed = replay(recorded)
    assert replayed.verdict is Verdict.IDENTICAL
    assert isinstance(replayed.again, Plan)
    assert len(recorded.answer.plans) == len(replayed.again.phases) == 3


@pytest.mark.nightly
def test_a_report_of_its_bag_draws_each_phase_with_what_it_holds(
    task: PlanningTask, plan: Plan, tmp_path: Path
) -> None:
    record_answer(tmp_path / "bag", task, plan, 1.0, SCENARIO, "optimal")
    report = report_of_bag(tmp_path / "bag", 20)
    (request,) = report.requests
    assert request.plan is not None
    drawn, wanted = (request.plan, *request.then), list(phase_tasks(task, plan))
    assert len(drawn) == len(wanted) == 3
    for found, (one, phase) in zip(drawn, wanted, strict=True):
        for name in ("joint_positions", "chaser_positions", "ee_quaternions_xyzw"):
            expected = getattr(phase.trajectory, name)
            np.testing.assert_allclose(getattr(found.motion, name), expected, atol=1e-9)
        masses = (sum(i.mass for i in of.model.inertias) for of in (found.robot, one.problem.robot))
        assert next(masses) == pytest.approx(next(masses))
        assert found.obstacles is not None
        assert [o.id for o in found.obstacles] == [o.id for o in one.problem.obstacles]
    save_page(report, tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    for part in ("plan-0", "plan-0-2", "plan-0-3"):
        assert f'id="{part}"' in page
        assert f'id="{part}-scene"' in page


@pytest.mark.ci
def test_the_json_has_the_whole_motion_and_each_phase(
    task: PlanningTask, plan: Plan, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    written = json.loads(json.dumps(plan_dictionary(plan, task, 1.0)))
    assert len(written["time"]) == sum(len(one["time"]) for one in written["phases"]) - 2
    assert (np.diff(written["time"]) > 0.0).all()
    assert written["metrics"]["joint_path_length"] == pytest.approx(
        sum(one["metrics"]["joint_path_length"] for one in written["phases"])
    )
    file = tmp_path / "answer.json"
    file.write_text(json.dumps(written), encoding="utf-8")
    assert main(["verify", str(file)]) == 0
    assert capsys.readouterr().out.count("verdict: passed") == 3
    assert main(["report", str(file), "--output", str(tmp_path / "page.html")]) == 0
    assert "answer, phase 3" in (tmp_path / "page.html").read_text(encoding="utf-8")


def test_a_report_of_its_json_is_of_one_request(
    task: PlanningTask, plan: Plan, tmp_path: Path
) -> None:
    file = tmp_path / "answer.json"
    file.write_text(json.dumps(plan_dictionary(plan, task, 1.0)), encoding="utf-8")
    report = report_of_answer(file)
    assert report.counts == "1 request: 1 solved, 0 refused, 0 unanswered"
    (request,) = report.requests
    assert len(request.then) == 2
    assert request.solve_time == pytest.approx(1.0)
    assert request.metrics == whole(plan).metrics


def test_the_whole_is_one_motion_with_the_worst_of_all_phases(plan: Plan) -> None:
    total = whole(plan)
    assert (np.diff(total.trajectory.time) > 0.0).all()
    each = [one.metrics for one in plan.phases]
    assert total.metrics.peak_grasp_force == max(one.peak_grasp_force for one in each[1:])
    assert total.metrics.min_self_clearance == min(one.min_self_clearance for one in each)
    ends = np.cumsum([one.trajectory.time[-1] for one in plan.phases])
    assert total.duration == pytest.approx(ends[-1])
    worst = int(np.argmin([one.min_self_clearance for one in each]))
    assert total.metrics.min_self_clearance_time == pytest.approx(
        [0.0, *ends][worst] + each[worst].min_self_clearance_time
    )
    alone, stop, stow = plan.phases
    assert whole(alone) is alone
    near = replace(
        stop.metrics,
        min_self_clearance=1e-3,
        min_self_clearance_pair="a/b",
        min_self_clearance_time=0.25,
    )
    metrics = whole(replace(plan, then=(replace(stop, metrics=near), stow))).metrics
    assert metrics.min_self_clearance_pair == "a/b"
    assert metrics.min_self_clearance_time == pytest.approx(ends[0] + 0.25)


def test_nothing_that_phases_tell_is_lost_in_the_whole(plan: Plan) -> None:
    """Wheels, notes, margins and rates too, which few plans have."""
    rng, phases = np.random.default_rng(0), list[Plan]()
    for number, one in enumerate(plan.phases):
        loads = WheelMotion(*rng.normal(size=(2, len(one.trajectory.time), 3)))
        margins = RobustReport(
            sigmas=3.0,
            least_sigmas=5.0 - number,
            rounds=number,
            plain_joint_path_length=1.0 + number,
            clearance=(("bus", 0.01 * number), (f"rock {number}", 0.02)),
            chaser_attitude=0.03 * (2 - number),
            torques=(("joint_1", 0.4 + number),),
            corridor=0.05 * number,
            chaser_rotation=0.06,
            deviations=(("mass", 0.01),),
        )
        said = {"notes": ("of all", f"of {number}"), "turn_rate_at_rest": 0.1 * number}
        phases.append(replace(one, wheels=loads, robust=margins, effort=7 + number, **said))
    told = whole(replace(phases[0], then=tuple(phases[1:])))
    assert told.wheels is not None
    for name in ("momenta", "torques"):
        parts = [getattr(one.wheels, name)[k > 0 :] for k, one in enumerate(phases)]
        np.testing.assert_array_equal(getattr(told.wheels, name), np.concatenate(parts))
    assert len(told.wheels.momenta) == len(told.trajectory.time)
    assert told.notes == ("of all", "of 0", "of 1", "of 2")
    assert told.turn_rate_at_rest == pytest.approx(0.2)
    assert (told.joint_names, told.effort, told.then) == (plan.joint_names, 7, ())
    assert told.duration == pytest.approx(sum(one.duration or 0.0 for one in phases))
    assert told.robust == RobustReport(
        sigmas=3.0,
        least_sigmas=3.0,
        rounds=3,
        plain_joint_path_length=6.0,
        clearance=(("bus", 0.02), ("rock 0", 0.02), ("rock 1", 0.02), ("rock 2", 0.02)),
        chaser_attitude=0.06,
        torques=(("joint_1", 2.4),),
        corridor=0.1,
        chaser_rotation=0.06,
        deviations=(("mass", 0.01),),
    )
    longer = told.metrics.joint_path_length - 6.0
    assert f"smallest margin 3.00 sigmas, 3 required; joint path {longer:+.4f} rad" in told.message


def payload_poses(task: PlanningTask, plan: Plan) -> tuple[Array, Array, Array]:
    """The body by the arm that holds it, by Pinocchio: times, twists and frames."""
    body, times = task.problem.target_body, list[float]()
    frames, twists = list[pin.SE3](), list[Array]()
    assert body is not None
    grasp = pin.SE3(pin.Quaternion(body.grasp_quaternion_xyzw), body.grasp_position)
    for begin, (one, phase) in zip(plan.begins, phase_tasks(task, plan), strict=True):
        if not begin:
            continue
        model = one.problem.robot.model.copy()
        tip = model.frames[one.problem.robot.tip_frame_id]
        place = tip.placement * grasp.inverse()
        number = model.addFrame(pin.Frame("body", tip.parentJoint, place, pin.FrameType.OP_FRAME))
        data = model.createData()
        for q, v in zip(*from_trajectory(one.problem.robot, phase.trajectory), strict=True):
            pin.forwardKinematics(model, data, q, v)
            frames.append(pin.SE3(pin.updateFramePlacement(model, data, number)))
            twists.append(pin.getFrameVelocity(model, data, number, pin.LOCAL_WORLD_ALIGNED).vector)
        times += (begin + phase.trajectory.time).tolist()
    return np.array(times), np.array(twists), np.array([one.homogeneous for one in frames])


def test_from_the_grasp_on_the_body_is_told_where_the_arm_has_it(
    task: PlanningTask, plan: Plan
) -> None:
    scene, motion = whole_scene(task, plan), whole(plan).trajectory
    captured, body = captured_in(scene), task.problem.target_body
    assert captured is not None
    assert body is not None
    told = captured.along(motion)
    # Until then it moves freely.
    for row in (0, 20, len(plan.phases[0].trajectory.time) - 1):
        there = body.after(float(motion.time[row]))
        np.testing.assert_allclose(told.positions[row], there.position, atol=1e-9)
        np.testing.assert_allclose(told.angular_velocities[row], there.angular_velocity, atol=1e-9)
    times, twists, frames = payload_poses(task, plan)
    later = ~np.isin(times, plan.begins)  # the point of the contact is still the free body's
    rows = np.searchsorted(motion.time, times[later] - 1e-9)
    np.testing.assert_allclose(motion.time[rows], times[later], atol=1e-9)
    for row, there in zip(rows, frames[later], strict=True):
        np.testing.assert_allclose(told.positions[row], there[:3, 3], atol=1e-9)
        turn = pin.Quaternion(told.quaternions_xyzw[row]).toRotationMatrix()
        np.testing.assert_allclose(turn, there[:3, :3], atol=1e-9)
    found = np.hstack([told.linear_velocities, told.angular_velocities])[rows]
    np.testing.assert_allclose(found, twists[later], atol=1e-8)


def test_streams_and_markers_have_the_body_at_the_end_effector_from_the_grasp_on(
    task: PlanningTask, plan: Plan
) -> None:
    scene, total = whole_scene(task, plan), whole(plan)
    captured, motion = captured_in(scene), total.trajectory
    assert captured is not None
    for row in (10, 60, 120):
        time_ns = round(float(motion.time[row]) * NANOSECONDS)
        there = predicted_target(motion, time_ns / NANOSECONDS, captured)
        np.testing.assert_allclose(there.position, captured.along(motion).positions[row], atol=1e-8)
        relative = predicted_relative_pose(motion, 0, time_ns, captured)
        assert relative is not None
        at, way = relative.pose.position, relative.pose.orientation
        apart = np.linalg.norm([at.x, at.y, at.z])
        assert (apart < 1e-9) == (abs(abs(way.w) - 1.0) < 1e-12) == (row > 50)
    markers = plan_markers(task.problem.robot, total, scene, "inertial").markers
    (path,) = (one for one in markers if one.ns == "grasp_path")
    drawn = np.array([[point.x, point.y, point.z] for point in path.points])
    held = motion.time > plan.begins[1]
    np.testing.assert_allclose(drawn[held], motion.ee_positions[held], atol=1e-9)
    assert np.linalg.norm(drawn[0] - motion.ee_positions[0]) > 0.1
    # What is fixed to the body stays where it is beside the end effector.
    fixed = [one.pose.position for one in markers if one.ns == "target_body"]
    shapes = len(fixed) // SNAPSHOTS
    shown = np.linspace(0, len(motion.time) - 1, SNAPSHOTS).round().astype(int)
    beside = [
        Rotation.from_quat(motion.ee_quaternions_xyzw[row])
        .inv()
        .apply([place.x, place.y, place.z] - motion.ee_positions[row])
        for row, place in zip(shown[-2:], (fixed[-shapes - 1], fixed[-1]), strict=True)
    ]
    np.testing.assert_allclose(*beside, atol=1e-6)


def test_a_bags_columns_have_the_body_through_all_phases(
    task: PlanningTask, plan: Plan, tmp_path: Path
) -> None:
    record_answer(tmp_path / "bag", task, plan, 0.5)
    (told,) = read_plans(tmp_path / "bag")
    columns = told.columns()
    assert len({len(column) for column in columns.values()}) == 1
    captured, motion = captured_in(whole_scene(task, plan)), whole(plan).trajectory
    assert captured is not None
    along = captured.along(motion)
    np.testing.assert_allclose(told.target_body["positions"], along.positions, atol=1e-4)
    (path,) = read_bag(tmp_path / "bag")["/predicted_target_path"]
    poses = [pose.pose.position for pose in path.poses]
    np.testing.assert_allclose([[p.x, p.y, p.z] for p in poses], along.positions, atol=1e-12)


def test_a_body_that_a_later_phase_captures_is_told_from_the_first_point_on(
    task: PlanningTask, plan: Plan
) -> None:
    approach, stop, _ = plan.phases
    then = (replace(task.then[0], target=None, target_body=task.problem.target_body),)
    problem = replace(task.problem, target_body=None, posture=Posture(at_rest=True))
    later = replace(task, problem=problem, then=then)
    scene = whole_scene(later, replace(approach, then=(stop,)))
    assert scene.target_body is task.problem.target_body
    assert scene.held_from == np.inf
    assert scene.capture_time == pytest.approx(approach.trajectory.time[-1] + stop.duration)
    assert len(bodies_of(later, replace(approach, then=(stop,)))) == 2


def phase_of(request: PlanRequest, phase: Phase, task: PlanningTask) -> Phase:
    """A phase by way of a request's message."""
    robot = task.problem.robot
    request.then = [phase_message(phase, robot.joint_names, "inertial")]
    (found,) = phases_in(request, robot, load_parameters(), task.problem.target_body)
    return found


def test_a_request_has_for_a_phase_what_a_scenario_has(task: PlanningTask) -> None:
    camera = Camera("end_effector", np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.5, 0.2)
    given = {"points": 31, "parametrisation": Parametrisation.JOINT_SPLINE, "camera": camera}
    phase = replace(task.then[1], **given)
    request = request_message(task.problem, "inertial")
    found = phase_of(request, phase, task)
    assert digest_of(found) == digest_of(phase)
    # What a phase leaves out is as in the phase before.
    left_out = replace(task.then[1], points=None, parametrisation=None, camera=None)
    found = phase_of(request, left_out, task)
    assert (found.points, found.parametrisation, found.camera) == (None, None, None)
    request.then[0].points = 1
    with pytest.raises(InvalidInput) as refused:
        phases_in(request, task.problem.robot, load_parameters(), None)
    assert refused.value.field == "then[0].points"


# Another value of each field of a phase that ends at a pose; goals have tests of their own.
OTHERWISE: dict[str, Any] = {
    "duration": DurationRange(1.5, 2.5),
    "target": Posture(0.1 * np.arange(7.0), 0.01 * np.arange(7.0)),
    "chaser_goal": ChaserGoal(rotation=0.25),
    "objective": Objective(0.5, 0.25, 0.125),
    "limits": Limits(True, 0.5, (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7), True, 0.6, 2.0, 3.0, 4.0),
    "points": 31,
    "parametrisation": Parametrisation.JOINT_SPLINE,
    "approach": Approach(np.array([0.0, 0.6, 0.8]), 0.3, 0.4),
    "camera": Camera("link_3", np.array([0.1, 0.2, 0.3]), np.array([0.0, 0.6, 0.8]), 0.5, 0.2),
    "allowed_collisions": ("link_5/passing",),
    "contact_distance": 0.07,
    "payload": Payload("end_effector", 3.0, np.diag([1.0, 2.0, 2.5]), np.array([0.1, 0.2, 0.3])),
    "effort": 5,
}
# What a phase may leave out that the one before has.
INHERITED = ("objective", "limits", "points", "parametrisation")
PASSING = Obstacle.sphere("passing", np.array([9.0, 0.0, 0.0]), 0.1, np.array([0.1, 0.2, 0.0]))


@pytest.fixture(scope="module")
def three(task: PlanningTask) -> PlanningTask:
    """A capture among an obstacle, then two phases that end at a pose."""
    problem = replace(task.problem, obstacles=(*task.problem.obstacles, PASSING))
    pose = problem.target.position, problem.target.quaternion_xyzw
    there = Phase(2.0, target=Target(*pose), allowed_collisions=("link_7/passing",))
    return replace(task, problem=problem, then=(there, there))


def test_each_field_of_a_phase_has_another_value_here() -> None:
    assert OTHERWISE.keys() == {item.name for item in fields(Phase)} - {"target_body"}


@pytest.mark.parametrize("posture", [Posture(0.1 * np.arange(7.0)), Posture(at_rest=True)])
def test_a_request_for_a_goal_of_the_joints_says_what_may_touch_there(
    three: PlanningTask, posture: Posture
) -> None:
    """Of the first phase as of later ones."""
    contacts: dict[str, Any] = {
        "allowed_collisions": ("link_7/passing",),
        "contact_distance": 0.07,
    }
    free = replace(three.problem, target_body=None, obstacles=(PASSING,), allowed_collisions=())
    request = request_message(replace(free, posture=posture, **contacts), "inertial")
    request.then = [phase_message(Phase(2.0, target=posture, **contacts), (), "inertial")]
    for goal in (request.goal, request.then[0].goal):
        (told,) = goal.allowed_collisions
        assert (list(told.pairs), told.distance) == (["link_7/passing"], 0.07)


@pytest.mark.parametrize("name", OTHERWISE)
def test_each_field_of_a_later_phase_is_in_digests_files_and_requests(
    three: PlanningTask, name: str, tmp_path: Path
) -> None:
    """Of the third phase alone: the second keeps its own, and what it leaves out the first's."""
    if name == "payload":  # a robot that holds what it has captured can be given no other
        free = {"target_body": None, "obstacles": (PASSING,), "allowed_collisions": ()}
        three = replace(three, problem=replace(three.problem, **free))
    second, third = three.then
    changed = replace(three, then=(second, replace(third, **{name: OTHERWISE[name]})))
    assert changed.digest != three.digest
    write_scenario(changed, tmp_path / "written.yaml")
    again = load_task(tmp_path / "written.yaml", DEFAULTS)
    assert digest_of(again.then[0]) == digest_of(second)
    assert digest_of(again.then[1]) == digest_of(changed.then[1])
    request = request_message(three.problem, "inertial")
    found = phase_of(request, changed.then[1], three)
    assert digest_of(found) == digest_of(changed.then[1])


@pytest.mark.parametrize(
    "name", sorted(OTHERWISE.keys() - {"duration", "target", "payload", "effort"})
)
def test_each_field_of_a_phase_is_that_of_its_problem_and_of_no_other(
    three: PlanningTask, plan: Plan, name: str
) -> None:
    second, third = (replace(one, **dict.fromkeys(INHERITED)) for one in three.then)
    for number in (0, 1):
        then = [second, third]
        then[number] = replace(then[number], **{name: OTHERWISE[name]})
        one, of_phases = replace(three, then=tuple(then)), list[Any]()
        for phase in (plan.phases[0], replace(plan.phases[1], duration=2.0)):
            one = following(one, phase)
            of_phases.append(getattr(one.problem, name))
        usual = getattr(three.problem if name in INHERITED else second, name)
        expected = [usual, usual]
        expected[number] = OTHERWISE[name]
        # What a phase leaves out is as in the phase before.
        if number == 0 and name in INHERITED:
            expected[1] = OTHERWISE[name]
        assert [*map(digest_of, of_phases)] == [*map(digest_of, expected)]


@pytest.mark.parametrize("name", INHERITED)
def test_what_a_phase_leaves_out_is_the_same_as_saying_it_again(
    three: PlanningTask, name: str
) -> None:
    second, third = three.then
    told = {name: OTHERWISE[name]}
    second = replace(second, **told)
    again, left_out = (
        replace(three, then=(second, replace(third, **{name: given})))
        for given in (OTHERWISE[name], None)
    )
    assert left_out.digest == again.digest != three.digest


@pytest.mark.parametrize("number", [0, 1])
@pytest.mark.parametrize("name", ["linear_acceleration", "angular_acceleration"])
def test_what_no_request_holds_of_a_later_goal_is_asked_for_by_none_and_in_a_bag(
    three: PlanningTask, number: int, name: str, tmp_path: Path
) -> None:
    """A request would be for another goal."""
    request_of_task(three, "inertial")
    then = list(three.then)
    target = then[number].target
    assert isinstance(target, Target)
    then[number] = replace(then[number], target=replace(target, **{name: [0.0, 0.01, 0.0]}))
    asked = replace(three, then=tuple(then))
    record_answer(tmp_path / "bag", asked, NoPlanFound(Status.COLLISION, "none"), 0.1)
    recorded = only_request(tmp_path / "bag")
    assert recorded.request is None
    assert recorded.planned_task().digest == asked.digest
    with pytest.raises(InvalidInput, match="a request to a node cannot ask for it") as refused:
        request_of_task(asked, "inertial")
    assert refused.value.field == f"phases[{number + 1}].target.{name}"


@pytest.mark.parametrize(
    "rules", [(True, False, 0.0), (True, True, 0.01), (False, True, 0.0), (False, False, 0.02)]
)
def test_a_bag_holds_every_rule_that_the_plan_had_to_keep(
    three: PlanningTask, rules: tuple[bool, bool, float], tmp_path: Path
) -> None:
    """The controller's, and all others: what is read again is what was asked for."""
    controller = Controller(*rules)
    planner = replace(three.settings, clearance_margin=0.03, capture_turn_rate_tolerance=0.004)
    asked = replace(
        three,
        settings=replace(planner, robust=replace(planner.robust, sigmas=2.0, mass=0.03)),
        controller=controller,
        end_behaviour=EndBehaviour.STOP_JOINTS,
        tail=1.5,
    )
    record_answer(tmp_path / "bag", asked, NoPlanFound(Status.COLLISION, "none"), 0.1)
    again = only_request(tmp_path / "bag").planned_task()
    assert again.controller == controller
    assert again.settings == asked.settings
    assert again.digest == asked.digest


# Of three phases in turn.
LIMITS: dict[str, tuple[Limits, Limits, Limits]] = {
    "ever laxer": (
        Limits(True, 0.5, (0.1,), True, 0.6, 2.0, 3.0, 4.0),
        Limits(True, 0.6, (0.2,), True, 0.7, 3.0, 4.0, 5.0),
        Limits(True),
    ),
    "ever stricter": (
        Limits(False),
        Limits(False, 0.6, (0.2,), True, 0.7, 3.0, 4.0, 5.0),
        Limits(False, 0.5, (0.1,), True, 0.6, 2.0, 3.0, 4.0),
    ),
    "each its own": (
        Limits(True, 0.5, (0.1, *6 * (0.3,)), False),
        Limits(True, 0.6, (0.3, *6 * (0.1,)), False, grasp_force=2.0),
        Limits(True, 0.4, (0.2,), False, capture_impulse=1.0),
    ),
    "without velocities in the second": (Limits(), Limits(False), Limits()),
    "without torques in the third": (Limits(), Limits(), Limits(True, joint_torques=False)),
}


@pytest.mark.parametrize("case", LIMITS)
def test_a_bag_holds_the_limits_of_each_phase(
    three: PlanningTask, case: str, tmp_path: Path
) -> None:
    """A later phase may have laxer ones than the first, as in a scenario."""
    first, *others = LIMITS[case]
    phases = zip(three.then, others, strict=True)
    then = tuple(replace(one, limits=limits.of_joints(7)) for one, limits in phases)
    asked = replace(three, problem=replace(three.problem, limits=first), then=then)
    record_answer(tmp_path / "bag", asked, NoPlanFound(Status.COLLISION, "none"), 0.1)
    assert only_request(tmp_path / "bag").planned_task().digest == asked.digest


@pytest.mark.ci
def test_where_a_later_phase_has_no_plan_those_before_are_given(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def too_short(document: dict[str, Any]) -> None:
        document["phases"][2]["duration"] = 0.2

    file, answer = scenario(tmp_path, too_short), tmp_path / "answer.json"
    assert main(["plan", str(file), "--json", str(answer)]) == 3
    assert "phase 3 of 3: 0.2 s is too short" in capsys.readouterr().err
    told = json.loads(answer.read_text(encoding="utf-8"))
    assert [one["status"] for one in told["phases"]] == ["solved"] * 2
    bag = tmp_path / "bag"
    assert main(["plan", str(file), "--bag", str(bag)]) == 3
    recorded = only_request(bag)
    assert recorded.answer is not None
    assert len(recorded.answer.plans) == 2
    assert replay(recorded).verdict is Verdict.IDENTICAL


def test_another_way_that_cannot_be_followed_leaves_the_refusal_of_the_phase(
    task: PlanningTask, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A second plan of the first phase is tried, and no task of the second follows from it."""
    seen = list[Plan]()

    def once(of: PlanningTask, plan: Plan) -> PlanningTask:
        seen.append(plan)
        if len(seen) > 1:
            raise InvalidInput(Status.OUT_OF_RANGE, "obstacles[c1].position", 1.0, "not foretold")
        return following(of, plan)

    monkeypatch.setattr(f"{perform.__module__}.following", once)
    problem = replace(task.problem, target_body=None, posture=Posture(at_rest=True))
    posture = Posture(np.array([0.0, -0.5, 0.3, -0.8, -1.0, 0.5, -1.0]))
    then = (replace(task.then[1], target=posture, duration=0.2),)
    with pytest.raises(NoPlanFound, match=r"phase 2 of 2: 0\.2 s is too short") as refused:
        perform(replace(task, problem=problem, then=then))
    assert len(seen) > 1
    assert isinstance(refused.value.found, Plan)


class EndingAt(Watch):
    """Ends every search at a step, as a clock might."""

    def __init__(self, last: int) -> None:
        self._left = last

    def require_time(self, _phase: str = SEARCHING, /) -> None:
        self._left -= 1
        if self._left <= 0:
            raise OutOfTime("the time is over", EndedBy.DEADLINE)

    def share(self, searches: int) -> Watch:  # noqa: ARG002 (each has as much)
        return EndingAt(self._left)


@pytest.mark.ci
@pytest.mark.parametrize("last", [40, 60, 75])
def test_what_a_clock_ended_comes_again_by_its_efforts(task: PlanningTask, last: int) -> None:
    def answer(of: PlanningTask, watch: Watch) -> tuple[list[int], list[bytes], str]:
        plan: Plan | None = None
        words, more = "", list[int]()
        try:
            plan = perform(of, watch)
        except NoPlanFound as refused:
            words, more = str(refused).partition(":")[0], [refused.effort]
            plan = refused.found if isinstance(refused.found, Plan) else None
        phases = () if plan is None else plan.phases
        motions = [one.trajectory.joint_positions.tobytes() for one in phases]
        return [*(one.effort for one in phases), *more], motions, words

    before = answer(task, EndingAt(last))
    assert any(before[0])
    assert answer(task.ended_at(*before[0]), Watch()) == before


def _without_mass(document: dict[str, Any]) -> None:
    del document["phases"][0]["target_body"]["mass"]


def _with_mesh_of_second(document: dict[str, Any]) -> None:
    inertia = dict.fromkeys(("ixx", "iyy", "izz"), 1.0) | dict.fromkeys(("ixy", "ixz", "iyz"), 0.0)
    held = {"link": "end_effector", "mass": 3.0, "inertia": inertia}
    shape = {"id": "bus", "shape": {"mesh": {"file": "nowhere.stl"}}, "position": [0.0, 0.0, 0.0]}
    document["phases"][1]["payload"] = held | {"shapes": [shape]}


def _with_urdf_of_second(document: dict[str, Any]) -> None:
    first, second, *_ = document["phases"]
    del second["target"]
    second["target_body"] = first["target_body"] | {"urdf": "nowhere.urdf"}


FAULTS: dict[str, tuple[Callable[[dict[str, Any]], object], str, str]] = {
    "no mass": (_without_mass, "phases[0].target_body.mass", "inertia in kg m2"),
    "a goal beside": (
        lambda d: d.update(target={"at_rest": True}),
        "target",
        "say it in a phase: phases[0].target",
    ),
    "a payload of the first": (
        lambda d: d["phases"][0].update(payload={}),
        "phases[0].payload",
        "say it in robot.payload",
    ),
    "no phases": (lambda d: d.update(phases=[]), "phases", "1 to 9 phases"),
    "too many": (lambda d: d.update(phases=4 * d["phases"]), "phases", "1 to 9 phases"),
    "no goal": (lambda d: d["phases"][1].pop("target"), "phases[1].target", "must be given"),
    "two goals": (
        lambda d: d["phases"][1].update(target_body=d["phases"][0]["target_body"]),
        "phases[1].target",
        "must be given",
    ),
    "no duration": (lambda d: d["phases"][1].pop("duration"), "phases[1].duration", ""),
    "of the first": (
        lambda d: d["phases"][0].update(duration=-1.0),
        "phases[0].duration",
        "greater than 0",
    ),
    "a file of the first": (
        lambda d: d["phases"][0]["target_body"].update(urdf="nowhere.urdf"),
        "phases[0].target_body.urdf",
        "",
    ),
    "a mesh of another": (
        _with_mesh_of_second,
        "phases[1].payload.shapes[bus].shape.mesh.file",
        "no such file",
    ),
    "a file of another": (_with_urdf_of_second, "phases[1].target_body.urdf", ""),
    "unknown": (lambda d: d["phases"][0].update(goal=1), "phases[0].goal", "a phase may have"),
    "unknown later": (lambda d: d["phases"][2].update(goal=1), "phases[2].goal", ""),
    "other joints": (
        lambda d: d["phases"][2]["target"]["joints"].update(position=[0.0]),
        "phases[2].target.joints.position",
        "",
    ),
    "a limit": (
        lambda d: d["phases"][1].update(limits={"grasp_force": 0.0}),
        "phases[1].limits.grasp_force",
        "greater than 0",
    ),
}


@pytest.mark.parametrize("case", FAULTS)
def test_a_fault_of_a_phase_is_named_with_its_place(case: str, tmp_path: Path) -> None:
    change, field, allowed = FAULTS[case]
    with pytest.raises(InvalidInput) as refused:
        load_task(scenario(tmp_path, change), DEFAULTS)
    found = [one for one in refused.value.faults if one.field == field]
    assert found, [one.field for one in refused.value.faults]
    assert allowed in found[0].allowed


def test_a_capture_alone_depends_on_no_mass(task: PlanningTask) -> None:
    body = task.problem.target_body
    assert body is not None
    alone = replace(task, then=(), problem=replace(task.problem, limits=task.then[0].limits))
    free = replace(alone.problem.limits, capture_impulse=np.inf)
    alone = replace(alone, problem=replace(alone.problem, limits=free))

    def digest(of: PlanningTask, times: float) -> str:
        target_body = replace(body, mass=times * body.mass)
        return replace(of, problem=replace(of.problem, target_body=target_body)).digest

    assert digest(alone, 2.0) == digest(alone, 1.0)
    assert digest(task, 2.0) != digest(task, 1.0)


UNASKABLE: dict[str, tuple[dict[str, Any], str, str, str]] = {
    "a weight": (
        {"objective": Objective(1.0, 0.0, wheel_momentum=1.0)},
        "objective.wheel_momentum",
        "1.0",
        "with robot.base free_flyer it must be 0",
    ),
    "a contact": (
        {"allowed_collisions": ("link_7/moon",)},
        "allowed_collisions.pairs",
        "'link_7/moon'",
        "it must be link/obstacle or link/link",
    ),
    "a family": (
        {"parametrisation": Parametrisation.END_EFFECTOR_POLYNOMIAL},
        "parametrisation",
        "end_effector_polynomial",
        "with a goal of the joints it must be auto or joint_spline",
    ),
}


@pytest.mark.law("NODE-07")
@pytest.mark.parametrize("number", [1, 2])
@pytest.mark.parametrize("case", UNASKABLE)
def test_what_no_plan_of_a_later_phase_can_be_asked_for_is_refused_before_the_search(
    task: PlanningTask, case: str, number: int
) -> None:
    """By its place in the request, also from the process of the solver."""
    changes, field, value, allowed = UNASKABLE[case]
    posture = Posture(np.array([0.0, -0.5, 0.3, -0.8, -1.0, 0.5, -1.0]))
    then = [replace(one, target=posture, approach=None) for one in task.then]
    then[number - 1] = replace(then[number - 1], **changes)
    watch = EndingAt(1)
    with pytest.raises(InvalidInput) as refused:
        perform(replace(task, then=tuple(then)), watch)
    assert refused.value.field == f"phases[{number}].{field}"
    told = status_message(pickle.loads(pickle.dumps(refused.value)))
    assert (told.code, told.field) == (refused.value.status, f"then[{number - 1}].{field}")
    assert told.value == value
    assert told.allowed.startswith(allowed)
    assert told.message.startswith(f"{told.field} is {value}")


def test_a_file_is_checked_by_what_plans_of_its_phases_can_be_asked_for(tmp_path: Path) -> None:
    def weighted(document: dict[str, Any]) -> None:
        document["phases"][2]["objective"] = {
            "joint_path_length": 1.0,
            "chaser_attitude": 0.0,
            "wheel_momentum": 1.0,
        }

    with pytest.raises(InvalidInput, match="there are no wheels") as refused:
        load_task(scenario(tmp_path, weighted), DEFAULTS)
    assert refused.value.field == "phases[2].objective.wheel_momentum"
