"""Joints that mimic planned ones, in the arm and beside it: held against what drives each alone."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from itertools import islice

import numpy as np
import pinocchio as pin
import pytest
from bodied_robots import random_robot
from robots import CONFIG, LEMUR_URDF, MIMICS, coupled_urdf, random_state
from scipy.spatial.transform import Rotation

from ff_planner_benchmark.problems import witnessed
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.system_frame import in_own_frame
from ff_planner_ros.planning.optimisation.evaluated_path import seen
from ff_planner_ros.planning.optimisation.program import PathProgram, path_program
from ff_planner_ros.planning.problem.posture import end_effector_at
from ff_planner_ros.planning.problem.problem import Objective, Orientation, PlanningProblem
from ff_planner_ros.planning.scenario.scenario import Defaults, load_task
from ff_planner_ros.planning.scenario.task_json import task_json
from ff_planner_ros.planning.search.families import path_families
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.dynamics import base_acceleration, joint_torques
from ff_planner_ros.robot.model import Base, Robot, robot_from_urdf_text
from ff_planner_ros.robot.momentum import (
    angular_momenta,
    angular_momentum_bounds,
    total_momenta,
    total_momentum,
)
from ff_planner_ros.simulation.verification import verify

SETTINGS = load_parameters().planner
ENDS = "bus", "tool"


@cache
def each_alone(joints: int) -> pin.Model:
    """The robot of `coupled_urdf` as Pinocchio reads it, in which no joint moves another."""
    urdf = coupled_urdf(joints, joints, mimics=False)
    urdf = urdf.replace('"continuous"', '"revolute"')
    model = pin.buildModelFromXML(urdf, pin.JointModelFreeFlyer())
    model.gravity.setZero()
    return model


def spread(model: pin.Model, robot: Robot, planned: Array, offset: bool) -> Array:
    """Positions, or rates, of all joints by those of the planned ones, in the order of a model."""
    found = dict(zip(robot.joint_names, planned, strict=True))
    for name, (of, multiplier, aside) in MIMICS.items():
        if name in model.names and (of in found):
            found[name] = multiplier * found[of] + (aside if offset else 0.0)
    return np.array([found[name] for name in list(model.names)[2:]])


@pytest.mark.parametrize("joints", [6, 8, 9])
def test_a_robot_with_mimics_is_the_one_whose_joints_are_driven_so(joints: int) -> None:
    """Its momentum, its end effector and its torques, by virtual work."""
    robot, model = robot_from_urdf_text(coupled_urdf(joints, joints), *ENDS), each_alone(joints)
    assert robot.joints == joints - 2
    rng, data = np.random.default_rng(joints), model.createData()
    for _ in range(5):
        q, v = configuration(robot, random_state(robot, rng))
        acceleration = rng.normal(size=robot.model.nv)
        every = np.concatenate([q[:7], spread(model, robot, q[7:], True)])
        rates, rise = (
            np.concatenate([one[:6], spread(model, robot, one[6:], False)])
            for one in (v, acceleration)
        )
        momentum = np.array(pin.computeCentroidalMomentum(model, data, every, rates).vector)
        momentum[3:] += np.cross(data.com[0], momentum[:3])
        found = total_momentum(robot, robot.model.createData(), q, v)
        np.testing.assert_allclose(found, momentum, rtol=0.0, atol=1e-10)
        pin.framesForwardKinematics(model, data, every)
        tip = data.oMf[model.getFrameId("tool")]
        own = robot.model.createData()
        pin.framesForwardKinematics(robot.model, own, q)
        assert (own.oMf[robot.tip_frame_id].inverse() * tip).isIdentity(1e-12)
        forces = pin.rnea(model, data, every, rates, rise)
        unit = np.eye(robot.joints)
        work = [forces[6:] @ spread(model, robot, one, False) for one in unit]
        pushed = pin.rnea(robot.model, own, q, v, acceleration)
        np.testing.assert_allclose(pushed[6:], work, rtol=0.0, atol=1e-10)


def test_each_of_many_samples_has_the_torques_that_push_no_base() -> None:
    """By the equations of what drives each joint alone; one sample has no inertias of another."""
    robot, model = robot_from_urdf_text(coupled_urdf(9, 9), *ENDS), each_alone(9)
    rng = np.random.default_rng(4)
    samples = [configuration(robot, random_state(robot, rng)) for _ in range(6)]
    q, v = (np.array(rows) for rows in zip(*samples, strict=True))
    accelerations, own = rng.normal(size=(6, robot.joints)), robot.model.createData()
    found = joint_torques(robot, q, v, accelerations)
    momenta = total_momenta(robot, q, v)
    for k, joint_accelerations in enumerate(accelerations):
        data = model.createData()
        every = np.concatenate([q[k, :7], spread(model, robot, q[k, 7:], True)])
        rates, rise = (
            np.concatenate([base, spread(model, robot, joints, False)])
            for base, joints in ((v[k, :6], v[k, 6:]), (np.zeros(6), joint_accelerations))
        )
        at_rest = np.array(pin.rnea(model, data, every, rates, rise))
        base = np.array(pin.crba(model, data, every))[:6]
        rise[:6] = np.linalg.solve(base[:, :6], -at_rest[:6])
        forces = np.array(pin.rnea(model, data, every, rates, rise))
        work = [forces[6:] @ spread(model, robot, one, False) for one in np.eye(robot.joints)]
        np.testing.assert_allclose(found[k], work, rtol=0.0, atol=1e-9)
        of_base = base_acceleration(robot, own, q[k], v[k], joint_accelerations)
        np.testing.assert_allclose(of_base, rise[:6], rtol=0.0, atol=1e-9)
        momentum = total_momentum(robot, own, q[k], v[k])
        np.testing.assert_allclose(momenta[k], momentum, rtol=0.0, atol=1e-10)


def coupled_problem(base: Base, seed: int) -> PlanningProblem:
    """A problem among spheres with limits of torques, and of wheels if there are some."""
    shapes, rng = random_robot(42, joints=9), np.random.default_rng(seed)
    robot = robot_from_urdf_text(shapes.drawn_urdf, *ENDS, base)
    for _ in range(100):
        posture = rng.uniform(-1.0, 1.0, robot.joints)
        drawn = witnessed.drawn_problem(robot, posture, Orientation.FIXED, 3, rng)
        if drawn is not None:
            return in_own_frame(drawn.problem)
    raise AssertionError("no problem was drawn")


def programs(problem: PlanningProblem) -> Iterator[tuple[PathProgram, Array]]:
    """Of each family of paths, with all that is asked of one and a first guess."""
    objective = Objective(0.7, 0.4, wheel_momentum=0.3 * (problem.robot.wheels is not None))
    problem = replace(problem, objective=objective)
    for ways in path_families(problem, SETTINGS):
        program = path_program(problem, ways[0], SETTINGS)
        program = program.with_requirements(program.on_demand)
        for x in islice(ways[0].first_guesses(problem.obstacles, 13, 0.0), 2):
            yield program, x


@pytest.mark.parametrize("base", [Base.FREE_FLYER, Base.ATTITUDE_HELD])
def test_the_search_has_the_derivatives_of_what_it_computes(base: Base) -> None:
    """By differences, with both families of paths: of objective, goal and all requirements."""
    problem, rng, families = coupled_problem(base, 1), np.random.default_rng(0), set[str]()
    for program, x in programs(problem):
        at_x = seen(program.evaluate(x))
        if not at_x.is_defined:
            continue
        families.add(type(program.family).__name__)
        for _ in range(3):
            way, step = rng.normal(size=len(x)), 1e-6
            ahead, behind = (seen(program.evaluate(x + sign * step * way)) for sign in (1, -1))
            for name in ("value", "equalities", "max_terms"):
                rate = (getattr(ahead, name) - getattr(behind, name)) / (2 * step)
                by = "gradient" if name == "value" else f"{name}_jacobian"
                expected = getattr(at_x, by) @ way if np.size(rate) else rate
                np.testing.assert_allclose(expected, rate, rtol=1e-4, atol=2e-4, err_msg=name)
            rows = [
                dict(zip(one.names.tolist(), one.constraints, strict=True))
                for one in (ahead, behind)
            ]
            kept = [k for k, name in enumerate(at_x.names.tolist()) if all(name in r for r in rows)]
            names = at_x.names[kept].tolist()
            rate = np.array([rows[0][name] - rows[1][name] for name in names]) / (2 * step)
            found = at_x.constraints_jacobian[kept] @ way
            apart = np.abs(found - rate) / np.maximum(1.0, np.abs(rate))
            # Where nearest points jump from edge to edge, and limits of rates turn round.
            assert (apart > 1e-3).mean() < 0.01
            assert len(kept) > 100
    assert len(families) == 2 - (base is Base.ATTITUDE_HELD) or len(families) == 2


LINKS = """<link name="of_rod"><inertial><origin xyz="0.3 0.1 0"/><mass value="40"/>
<inertia ixx="0.4" iyy="2" izz="2.2" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="0.3 0 0"/><geometry><box size="0.4 0.1 0.1"/></geometry></collision></link>
<joint name="a_rod" type="revolute"><parent link="chaser"/><child link="of_rod"/>
<origin xyz="0.2 0.9 -0.4" rpy="0 0 0.3"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" velocity="1" effort="1"/>
<mimic joint="joint_3" multiplier="-2" offset="0.4"/></joint></robot>"""


def coupled_lemur(kind: str) -> str:
    """The paper's arm that drives a rod on the chaser, or has two joints that move as one."""
    urdf = LEMUR_URDF.read_text()
    if kind == "beside the arm":
        return urdf.replace("</robot>", LINKS)
    before, joint, after = urdf.partition('<joint name="joint_7"')
    mimic = '<mimic joint="joint_5" multiplier="-0.8"/></joint>'
    return before + joint + after.replace("</joint>", mimic, 1)


@cache
def planned(kind: str) -> tuple[PlanningTask, Plan]:
    defaults = Defaults(SETTINGS)
    task = load_task(CONFIG / "scenarios/lemur_capture.yaml", defaults)
    robot = robot_from_urdf_text(coupled_lemur(kind), "chaser", "end_effector")
    start, names = task.problem.start, [f"joint_{k + 1}" for k in range(7)]
    of = [names.index(name) for name in robot.joint_names]
    start = replace(
        start,
        joint_positions=start.joint_positions[of],
        joint_velocities=np.zeros(len(of)),
        joint_accelerations=None,
    )
    problem = replace(task.problem, robot=robot, start=start)
    if kind == "in the arm":
        there = replace(start, joint_positions=start.joint_positions + 0.3)
        target = end_effector_at(robot, there)
        problem = replace(problem, target=target, obstacles=())
    return (task := replace(task, problem=problem)), perform(task)


def momentum_by_links(urdf: str, positions: dict[str, float], rates: dict[str, float]) -> Array:
    """Momentum of the Lemur's links about the chaser's origin, in its axes, at a base that rests.

    With the columns of the base's own twist: linear, then angular. Shape (6, 7).
    """
    robot, whole = ElementTree.fromstring(urdf), np.zeros((6, 7))

    def numbers(element: ElementTree.Element | None, key: str, default: str = "0 0 0") -> Array:
        return np.array(
            ("" if element is None else element.get(key, "")).split() or default.split(), float
        )

    def visit(link: str, turn: Array, place: Array, twists: Array) -> None:
        inertial = robot.find(f"link[@name='{link}']/inertial")
        if inertial is not None:
            origin = inertial.find("origin")
            at = Rotation.from_euler("xyz", numbers(origin, "rpy")).as_matrix()
            (xx, yy, zz, xy, xz, yz) = (
                float(inertial.find("inertia").get(f"i{key}"))
                for key in ("xx", "yy", "zz", "xy", "xz", "yz")
            )
            moments = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            axes, mass = turn @ at, float(inertial.find("mass").get("value"))
            lever = turn @ numbers(origin, "xyz")
            linear = mass * (twists[:3] - np.cross(lever, twists[3:], axis=0))
            angular = axes @ moments @ axes.T @ twists[3:]
            whole[:3] += linear
            whole[3:] += angular + np.cross(place + lever, linear, axis=0)
        for joint in robot.findall("joint"):
            if joint.find("parent").get("link") != link:
                continue
            origin, name = joint.find("origin"), joint.get("name")
            offset = turn @ numbers(origin, "xyz")
            turned = turn @ Rotation.from_euler("xyz", numbers(origin, "rpy")).as_matrix()
            moved = np.vstack([twists[:3] - np.cross(offset, twists[3:], axis=0), twists[3:]])
            if joint.get("type") != "fixed":
                axis = numbers(joint.find("axis"), "xyz", "1 0 0")
                moved[3:, 6] += turned @ axis * rates[name]
                turned = turned @ Rotation.from_rotvec(positions[name] * axis).as_matrix()
            visit(joint.find("child").get("link"), turned, place + offset, moved)

    visit("chaser", np.eye(3), np.zeros(3), np.eye(6, 7))
    return whole


@pytest.mark.parametrize("kind", ["beside the arm", "in the arm"])
def test_a_plan_conserves_the_momentum_of_all_links_as_the_urdf_has_them(kind: str) -> None:
    """Link by link from the file alone, at all points; and not where the mimics stand still."""
    task, plan = planned(kind)
    robot, motion, urdf = task.problem.robot, plan.trajectory, coupled_lemur(kind)
    (name, of, multiplier, offset) = {
        "beside the arm": ("a_rod", "joint_3", -2.0, 0.4),
        "in the arm": ("joint_7", "joint_5", -0.8, 0.0),
    }[kind]
    assert name not in robot.joint_names
    for moves in (True, False):
        found = []
        for k in range(len(motion.time)):
            positions, rates = (
                dict(zip(robot.joint_names, row[k].tolist(), strict=True))
                for row in (motion.joint_positions, motion.joint_velocities)
            )
            positions[name] = multiplier * positions[of] + offset
            rates[name] = multiplier * rates[of] * moves
            turn = Rotation.from_quat(motion.chaser_quaternions_xyzw[k]).as_matrix()
            omega = turn.T @ motion.chaser_angular_velocities[k]
            center = robot.position_chaser_in_base
            linear = turn.T @ motion.chaser_linear_velocities[k] - np.cross(omega, center)
            momentum = momentum_by_links(urdf, positions, rates) @ [*linear, *omega, 1.0]
            P, L = turn @ momentum[:3], turn @ momentum[3:]
            origin = motion.chaser_positions[k] - turn @ center
            found.append([*P, *(L + np.cross(origin, P))])
        change = np.abs(np.array(found) - found[0]).max()
        assert (change < 1e-9) if moves else (change > 1e-6)


@pytest.mark.parametrize("kind", ["beside the arm", "in the arm"])
def test_mujoco_flies_such_a_plan_open_loop(kind: str) -> None:
    task, plan = planned(kind)
    found = verify(task.problem.robot, plan.trajectory)
    assert found.passed
    assert found.deviation.final_position_error < 1e-6
    wrong = robot_from_urdf_text(
        coupled_lemur(kind).replace('multiplier="-', 'multiplier="'), "chaser", "end_effector"
    )
    assert not verify(wrong, plan.trajectory).passed


def test_a_record_has_the_mimics() -> None:
    task, _ = planned("beside the arm")
    again = robot_from_urdf_text(task.problem.robot.drawn_urdf, "chaser", "end_effector")
    assert again.model == task.problem.robot.model
    assert "<mimic" in task_json(task)


def test_bounds_of_the_angular_momentum_count_what_moves_along() -> None:
    robot = robot_from_urdf_text(coupled_urdf(8, 8), *ENDS, Base.ATTITUDE_HELD)
    rng = np.random.default_rng(0)
    positions, rates, rises = rng.uniform(-1.0, 1.0, (3, 200, robot.joints))
    q = np.hstack([np.tile(pin.neutral(robot.model)[:7], (200, 1)), positions])
    v = np.hstack([np.zeros((200, 6)), rates])
    most = np.abs([positions, rates, rises]).max(axis=1)[:, None]
    momenta, torques = angular_momenta(robot, q, v, rises)
    bounds = angular_momentum_bounds(robot, most)[:, 0]
    assert np.linalg.norm(momenta, axis=1).max() <= bounds[0]
    assert np.linalg.norm(torques, axis=1).max() <= bounds[1]


def test_a_planned_joint_keeps_the_limits_of_what_it_moves_along() -> None:
    urdf = coupled_lemur("beside the arm").replace('lower="-3" upper="3" velocity="1"', "{}")
    own = robot_from_urdf_text(LEMUR_URDF.read_text(), "chaser", "end_effector")
    for limits, ends, rate in (
        ('lower="-9" upper="9" velocity="9"', None, None),
        ('lower="-1.6" upper="1" velocity="0.1"', (-0.3, 1.0), 0.05),
    ):
        robot = robot_from_urdf_text(urdf.format(limits), "chaser", "end_effector")
        lower, upper, fastest = (
            own.lower_position_limits.copy(),
            own.upper_position_limits.copy(),
            own.velocity_limits.copy(),
        )
        told = [note for note in robot.notes if note.startswith("limits of joint_3 are")]
        assert len(told) == (ends is not None)
        if ends is not None:
            (lower[2], upper[2]), fastest[2] = ends, rate
            assert told[0].endswith("-0.3 to 1 rad and 0.05 rad/s, for what it moves along: a_rod")
        np.testing.assert_allclose(robot.lower_position_limits, lower, atol=1e-12)
        np.testing.assert_allclose(robot.upper_position_limits, upper, atol=1e-12)
        np.testing.assert_allclose(robot.velocity_limits, fastest, atol=1e-12)
        assert "moved along: a_rod at -2 joint_3 +0.4" in robot.notes
    # Published grippers have limits that their own <mimic> never meets.
    apart = urdf.format('lower="20" upper="30" velocity="9"')
    robot = robot_from_urdf_text(apart, "chaser", "end_effector")
    np.testing.assert_array_equal(robot.upper_position_limits, own.upper_position_limits)
    told = "limits of joints, which are not kept, as what they mimic cannot reach them: a_rod"
    assert told in robot.notes


def test_a_joint_that_drives_others_has_one_turn() -> None:
    """A panel that turns twice as fast is not where it was after a turn of the joint."""
    text = coupled_lemur("beside the arm")
    before, joint, after = text.partition('<joint name="joint_3"')
    text = before + joint + after.replace('"revolute"', '"continuous"', 1)
    assert not any(robot_from_urdf_text(text, "chaser", "end_effector").continuous)


def test_a_joint_of_the_arm_cannot_mimic_one_further_out() -> None:
    text = LEMUR_URDF.read_text()
    before, joint, after = text.partition('<joint name="joint_2"')
    text = before + joint + after.replace("</joint>", '<mimic joint="joint_5"/></joint>', 1)
    with pytest.raises(
        InvalidInput, match=r"joint 'joint_2' is a mimic of joint_5: .*further from"
    ):
        robot_from_urdf_text(text, "chaser", "end_effector")
