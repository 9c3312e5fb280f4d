"""A payload: the robot that holds it weighs, fills and keeps clear what both do together."""

from __future__ import annotations

import math
from contextlib import nullcontext
from dataclasses import fields, replace
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pinocchio as pin
import pytest
import yaml
from ff_planner_msgs.msg import PlanRequest
from heard_inputs import HeardScenes
from recorded_requests import only_request
from robots import CONFIG, random_state, random_urdf

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.common.times import NANOSECONDS
from ff_planner_ros.errors import InvalidInput, NoPlanFound, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.check.check import failures
from ff_planner_ros.planning.motion.forward import carried_forward
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import (
    Objective,
    PlanningProblem,
    Posture,
    Target,
)
from ff_planner_ros.planning.problem.scene import scene_of
from ff_planner_ros.planning.scenario.scenario import Defaults, load_scenario, load_task
from ff_planner_ros.planning.scenario.scenario_writer import write_scenario
from ff_planner_ros.planning.task.digest import digest_of
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.collision.solids import Solid
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Base, Robot, robot_from_urdf_text
from ff_planner_ros.robot.momentum import total_momentum
from ff_planner_ros.robot.tree import Tree
from ff_planner_ros.robot.urdf.payload import HeldShape, Payload, with_payload
from ff_planner_ros.robot.wheels import Wheels
from ff_planner_ros.ros.inputs.state_input import Snapshot
from ff_planner_ros.ros.messages.to_messages import (
    payload_message,
    request_message,
    scene_message,
)
from ff_planner_ros.ros.outputs.made_plan import MadePlan
from ff_planner_ros.ros.requests.publication import (
    require_same_start,
    start_deviations,
)
from ff_planner_ros.ros.requests.reading import Knowledge, measured_state, read_request
from ff_planner_ros.runs.offline_bag import record_answer
from ff_planner_ros.runs.replay import Verdict, replay
from ff_planner_ros.simulation.verification import verify

SCENARIO = CONFIG / "scenarios" / "lemur_capture_bodies.yaml"
SETTINGS = load_parameters().planner
NOW = 1_000 * NANOSECONDS
INERTIA = np.array([[3.0, 0.2, -0.1], [0.2, 2.5, 0.3], [-0.1, 0.3, 2.0]])
BUS = HeldShape("bus", Solid("box", np.array([0.15, 0.1, 0.2])), np.array([0.0, 0.0, 0.35]))
PAYLOAD = Payload("end_effector", 30.0, INERTIA, np.array([0.02, -0.03, 0.24]), (BUS,))
FILE = {
    "link": "end_effector",
    "mass": 30.0,
    "com": [0.02, -0.03, 0.24],
    "inertia": {"ixx": 3.0, "ixy": 0.2, "ixz": -0.1, "iyy": 2.5, "iyz": 0.3, "izz": 2.0},
    "shapes": [
        {"id": "bus", "shape": {"box": {"size": [0.15, 0.1, 0.2]}}, "position": [0.0, 0.0, 0.35]}
    ],
}


@pytest.fixture(scope="module")
def bare() -> Robot:
    return load_scenario(SCENARIO).robot


@pytest.fixture(scope="module")
def held(bare: Robot) -> Robot:
    return with_payload(bare, PAYLOAD)


@pytest.fixture(scope="module")
def problem(held: Robot) -> PlanningProblem:
    return replace(load_scenario(SCENARIO), robot=held, obstacles=())


@pytest.fixture(scope="module")
def plan(problem: PlanningProblem) -> Plan:
    return perform(PlanningTask(problem, SETTINGS))


def scenario(directory: Path, **changes: Any) -> Path:
    document = yaml.safe_load(SCENARIO.read_text(encoding="utf-8"))
    document["robot"]["urdf"] = str(CONFIG / "robots/lemur/lemur.urdf")
    document["robot"]["payload"] = FILE | changes
    document["obstacles"] = []
    path = directory / "scenario.yaml"
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    return path


def momentum_of_payload(robot: Robot, q: Array, v: Array) -> Array:
    """Linear and angular about the origin, of the rigid body alone, by the textbook. Shape (6,)."""
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q, v)
    frame = robot.model.getFrameId(PAYLOAD.link, pin.FrameType.BODY)
    pin.updateFramePlacement(robot.model, data, frame)
    twist = pin.getFrameVelocity(robot.model, data, frame, pin.LOCAL_WORLD_ALIGNED)
    place = data.oMf[frame]
    arm = place.rotation @ PAYLOAD.center_of_mass
    center, velocity = place.translation + arm, twist.linear + np.cross(twist.angular, arm)
    spin = place.rotation @ PAYLOAD.inertia @ place.rotation.T @ twist.angular
    linear = PAYLOAD.mass * velocity
    return np.concatenate([linear, np.cross(center, linear) + spin])


@pytest.mark.parametrize("seed", range(20))
def test_the_momentum_is_that_of_the_robot_and_of_the_body(
    bare: Robot, held: Robot, seed: int
) -> None:
    state = random_state(bare, np.random.default_rng(seed))
    q, v = configuration(bare, state)
    alone = total_momentum(bare, bare.model.createData(), q, v)
    both = total_momentum(held, held.model.createData(), *configuration(held, state))
    wanted = alone + momentum_of_payload(bare, q, v)
    np.testing.assert_allclose(both, wanted, rtol=1e-10, atol=1e-10)


def test_the_chaser_and_the_end_effector_are_where_they_were(bare: Robot, held: Robot) -> None:
    assert held.joint_names == bare.joint_names
    np.testing.assert_array_equal(held.position_chaser_in_base, bare.position_chaser_in_base)
    tips = [robot.model.frames[robot.tip_frame_id].placement.homogeneous for robot in (bare, held)]
    np.testing.assert_array_equal(*tips)


def test_its_shapes_are_kept_clear_of_all_that_moves_against_it(bare: Robot, held: Robot) -> None:
    (index,) = (k for k, body in enumerate(held.bodies) if body.link == "payload")
    others = {held.bodies[a + b - index].link for a, b in held.pairs if index in (a, b)}
    fixed = {body.link for body in held.bodies if body.joint == held.bodies[index].joint}
    assert others == {body.link for body in bare.bodies} - fixed
    assert len(held.pairs) - len(bare.pairs) == len(
        [body for body in bare.bodies if body.link not in fixed]
    )


def test_a_plan_with_it_passes_the_check_and_comes_true_in_mujoco(
    problem: PlanningProblem, plan: Plan
) -> None:
    assert not list(failures(problem, plan, SETTINGS))
    found = verify(problem.robot, plan.trajectory, scene_of(problem))
    assert found.passed
    without = verify(load_scenario(SCENARIO).robot, plan.trajectory, scene_of(problem))
    assert not without.passed  # the chaser of a robot that holds nothing goes elsewhere


def test_a_scenario_says_it_and_a_written_one_has_it(
    problem: PlanningProblem, tmp_path: Path
) -> None:
    task = PlanningTask(problem, SETTINGS)
    assert load_scenario(scenario(tmp_path)).robot.urdf == problem.robot.urdf
    write_scenario(task, tmp_path / "written.yaml")
    again = load_task(tmp_path / "written.yaml", Defaults(SETTINGS))
    assert again.digest == task.digest
    assert again.problem.robot.pairs == problem.robot.pairs


def test_a_request_brings_it_to_the_node_s_robot_and_its_bag_replays(
    bare: Robot, problem: PlanningProblem, plan: Plan, tmp_path: Path
) -> None:
    request = request_message(problem, "inertial")
    request.payload = [payload_message(PAYLOAD)]
    task = asked(bare, problem, request)
    assert task.problem.robot.urdf == problem.robot.urdf
    assert task.problem.robot.pairs == problem.robot.pairs
    assert task.problem.robot.payload is not None
    record_answer(tmp_path / "bag", PlanningTask(problem, SETTINGS), plan, 0.5)
    recorded = only_request(tmp_path / "bag")
    assert replay(recorded).verdict is Verdict.IDENTICAL


def test_a_fault_of_a_request_is_named_as_in_the_message(
    bare: Robot, problem: PlanningProblem
) -> None:
    for change, field in (
        ({"link": "hand"}, "payload.link"),
        ({"bodies": 2}, "payload.bodies"),
        ({"mass": 0.0}, "payload.inertia.m"),
        ({"com": math.inf}, "payload.inertia.com"),
        ({"ixx": -1.0}, "payload.inertia"),
        ({"turning": 1.0}, "payload.bodies[0].twist.angular"),
    ):
        request = request_message(problem, "inertial")
        message = payload_message(PAYLOAD)
        request.payload = [message]
        match next(iter(change.items())):
            case "link", str(link):
                message.link = link
            case "bodies", int(times):
                message.bodies = times * list(message.bodies)
            case "mass", float(mass):
                message.inertia.m = mass
            case "com", float(x):
                message.inertia.com.x = x
            case "ixx", float(ixx):
                message.inertia.ixx = ixx
            case _, float(rate):
                message.bodies[0].twist.angular.z = rate
        with pytest.raises(InvalidInput) as refused:
            asked(bare, problem, request)
        assert refused.value.field == field, refused.value


def asked(robot: Robot, problem: PlanningProblem, request: PlanRequest) -> PlanningTask:
    """Return the task that a node with this robot makes of a request."""
    parameters = replace(load_parameters(), inertial_frame="inertial", planning_lead_time=0.0)
    states = Mock()
    states.snapshot.return_value = Snapshot(problem.start, NOW, "chaser_state")
    request.scene = [scene_message((), 0, "inertial")]
    knowledge = Knowledge(robot, parameters, states, HeardScenes(), None, NOW)
    return read_request(request, knowledge).task


def test_a_plan_that_waits_is_compared_with_where_the_robot_goes_with_its_payload(
    bare: Robot, held: Robot, problem: PlanningProblem, plan: Plan
) -> None:
    moving = replace(problem.start, joint_velocities=np.full(held.joints, 0.1))
    there = carried_forward(held, moving, 5.0, None)
    at_start = {
        "chaser_positions": there.position_chaser_in_inertial,
        "chaser_quaternions_xyzw": there.quaternion_chaser_to_inertial_xyzw,
        "chaser_linear_velocities": there.linear_velocity_chaser_in_inertial,
        "chaser_angular_velocities": there.angular_velocity_chaser_in_inertial,
        "joint_positions": there.joint_positions,
        "joint_velocities": there.joint_velocities,
    }
    motion = replace(
        plan.trajectory,
        **{
            name: np.vstack([row, getattr(plan.trajectory, name)[1:]])
            for name, row in at_start.items()
        },
    )
    start_ns, parameters = NOW + 5 * NANOSECONDS, load_parameters()
    states = Mock()
    states.snapshot.return_value = Snapshot(moving, NOW, "chaser_state")
    node = Knowledge(bare, parameters, states, HeardScenes(), None, NOW)
    for robot, refused in ((held, nullcontext()), (bare, pytest.raises(NoPlanFound))):
        made = MadePlan(
            *("run.1", replace(plan, trajectory=motion), start_ns, "none"),
            *(robot, scene_of(problem), parameters.inertial_frame),
        )
        with refused:
            require_same_start(made, start_deviations(made, measured_state((), node), node), node)


# Of a robot, what a payload changes; the rest is as it was.
OF_PAYLOAD = {"model", "urdf", "drawn_urdf", "tip_frame_id", "notes", "payload"}
OF_SHAPES = {"bodies", "pairs", "may_touch"}
OWN_WHEELS = Wheels(np.vstack([np.eye(3), np.ones(3)]), (1.0, 2.0, 3.0, 4.0), (0.5,))
# URDF, links and how it is loaded.
TAKING: dict[str, tuple[str, dict[str, Any]]] = {
    "own weight of slides": (random_urdf(5, 3, (1, 4)), {"slide_weight": 7.5}),
    "slides locked": (random_urdf(5, 3, (1, 4)), {"slide_weight": 0.0}),
    "joint locked elsewhere": (random_urdf(5, 3), {"held_at": {"joint_2": 0.3}}),
    "own wheels": (random_urdf(6, 3), {"base": Base.ATTITUDE_HELD, "wheels": OWN_WHEELS}),
    "lines beside shapes": (random_urdf(5, 3), {"geometry": Geometry.LINES}),
}


@pytest.mark.parametrize("case", TAKING)
def test_a_robot_that_takes_a_payload_is_in_all_else_what_it_was(case: str) -> None:
    urdf, given = TAKING[case]
    bare = robot_from_urdf_text(urdf, "bus", "tool", **given)
    took = with_payload(bare, Payload("tool", 3.0, np.diag([1.0, 2.0, 2.5])))
    assert took.slide_weight == bare.slide_weight
    assert took.notes == (*bare.notes, "link tool holds a payload of 3 kg")
    for name in {item.name for item in fields(Robot)} - OF_PAYLOAD - OF_SHAPES:
        before, after = getattr(bare, name), getattr(took, name)
        if name == "locked_joints":  # the payload's own joint is one more
            assert after[-1].name == "payload_on_tool"
            after = after[:-1]
        if name == "wheels":
            assert digest_of(before) == digest_of(after)
        elif name == "tree":
            for item in {one.name for one in fields(Tree)} - {"model"}:
                np.testing.assert_array_equal(getattr(before, item), getattr(after, item), item)
        elif isinstance(before, np.ndarray):
            np.testing.assert_array_equal(before, after, err_msg=name)
        else:
            assert before == after, name
    assert took.bodies == bare.bodies == ()
    # What it holds is the only thing that moves otherwise.
    for joint in range(1, bare.model.njoints - 1):
        np.testing.assert_array_equal(
            bare.model.inertias[joint].matrix(), took.model.inertias[joint].matrix()
        )


@pytest.mark.parametrize("case", TAKING)
def test_a_bag_of_a_robot_is_read_as_that_robot_with_and_without_a_payload(
    case: str, tmp_path: Path
) -> None:
    """Whoever wrote it: links, base, wheels and weight of slides are in its parameters."""
    urdf, given = TAKING[case]
    bare = robot_from_urdf_text(urdf, "bus", "tool", **given)
    held = with_payload(bare, Payload("tool", 3.0, np.diag([1.0, 2.0, 2.5])))
    for robot in (bare, held):
        start = random_state(robot, np.random.default_rng(0))
        still = np.zeros(3) if robot.wheels else start.angular_velocity_chaser_in_inertial
        start = replace(start, angular_velocity_chaser_in_inertial=still)
        posture = Posture(np.zeros(robot.joints))
        target = Target(np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]))
        asked = PlanningProblem(
            robot, start, target, 8.0, 30, (), Objective(1.0, 0.0), posture=posture
        )
        task, bag = PlanningTask(asked, SETTINGS), tmp_path / f"bag {robot.payload is not None}"
        record_answer(bag, task, NoPlanFound(Status.COLLISION, "none"), 0.1)
        again = only_request(bag).planned_task()
        assert digest_of(again.problem.robot) == digest_of(robot)
        assert again.digest == task.digest


FAULTS: dict[str, tuple[dict[str, Any], Status, str, str]] = {
    "no such link": ({"link": "hand"}, Status.OUT_OF_RANGE, "robot.payload.link", "end_effector"),
    "the chaser": ({"link": "chaser"}, Status.OUT_OF_RANGE, "robot.payload.link", "the arm moves"),
    "no mass": ({"mass": 0.0}, Status.OUT_OF_RANGE, "robot.payload.mass", "greater than 0"),
    "no number": ({"mass": math.nan}, Status.NOT_FINITE, "robot.payload.mass", "finite"),
    "no number in the inertia": (
        {"inertia": FILE["inertia"] | {"izz": math.nan}},
        Status.NOT_FINITE,
        "robot.payload.inertia",
        "finite",
    ),
    "no inertia": (
        {"inertia": FILE["inertia"] | {"izz": 9.0}},
        Status.OUT_OF_RANGE,
        "robot.payload.inertia",
        "",
    ),
    "twice": (
        {"shapes": 2 * FILE["shapes"]},
        Status.OUT_OF_RANGE,
        "robot.payload.shapes[1].id",
        "",
    ),
}


@pytest.mark.parametrize("case", FAULTS)
def test_what_no_link_can_hold_is_refused_by_name(case: str, tmp_path: Path) -> None:
    changes, status, field, allowed = FAULTS[case]
    with pytest.raises(InvalidInput) as refused:
        load_scenario(scenario(tmp_path, **changes))
    found = refused.value.faults[0]
    assert (found.status, found.field) == (status, field)
    assert allowed in found.allowed


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
def test_an_inertia_that_is_not_symmetric_is_refused_by_name(scale: float) -> None:
    """Half of it would count, and the other half not. Rounding is let pass."""
    for change, refused in ((2e-6, True), (5e-7, False)):
        lopsided = scale * INERTIA
        lopsided[0, 1] += 3.0 * scale * change
        told = r"robot\.payload\.inertia is .*it must be symmetric"
        with pytest.raises(InvalidInput, match=told) if refused else nullcontext():
            Payload("end_effector", 30.0, lopsided)


def test_a_robot_of_lines_holds_what_has_no_shapes(lemur: Robot) -> None:
    with pytest.raises(InvalidInput, match=r"robot\.payload\.shapes is given: with robot.geometry"):
        with_payload(lemur, PAYLOAD)
    heavier = with_payload(lemur, replace(PAYLOAD, shapes=()))
    whole = sum(one.mass for one in heavier.model.inertias)
    assert whole == pytest.approx(sum(one.mass for one in lemur.model.inertias) + PAYLOAD.mass)
    with pytest.raises(InvalidInput, match="holds a payload already"):
        with_payload(heavier, replace(PAYLOAD, shapes=()))
