"""Plans come true in an engine that we did not write, and wrong plans do not."""

from __future__ import annotations

from dataclasses import astuple, replace
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from robots import CANADARM2_SCENARIO, CONFIG, LEMUR_SCENARIO
from scipy.spatial.transform import Rotation
from shared_plans import planned

from ff_planner_benchmark.problems import captured, witnessed
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.motion import state_at
from ff_planner_ros.planning.motion.plan import Plan, SolverReport, Trajectory
from ff_planner_ros.planning.optimisation.program import path_program
from ff_planner_ros.planning.paths.end_effector_polynomial import end_effector_paths
from ff_planner_ros.planning.problem.problem import (
    Objective,
    Parametrisation,
    PlanningProblem,
    Target,
)
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.search.candidate import Candidate, plan_of_path
from ff_planner_ros.planning.search.planner import plan
from ff_planner_ros.planning.task.task import perform
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.simulation.deviation import (
    ORIENTATION_TOLERANCE,
    POSITION_TOLERANCE,
    Deviation,
    deviation,
)
from ff_planner_ros.simulation.engine import Engine
from ff_planner_ros.simulation.execution import execute
from ff_planner_ros.simulation.feed_forward import feed_forward, torque_spline
from ff_planner_ros.simulation.verification import (
    MIN_STEPS_PER_POINT,
    MOMENTUM_TOLERANCE,
    Verification,
    steps_per_point,
    verify,
)

PLANAR_SCENARIO = CONFIG / "scenarios/planar_capture.yaml"
LENGTH, ATTITUDE = Objective(1.0, 0.0), Objective(0.0, 1.0)
every_plan = pytest.mark.parametrize(
    ("scenario", "objective"),
    [
        pytest.param(
            scenario,
            objective,
            id=f"{scenario.stem} {name}",
            marks=[pytest.mark.ci] if objective is ATTITUDE else [],
        )
        for scenario in (LEMUR_SCENARIO, CANADARM2_SCENARIO)
        for name, objective in (("min(L)", LENGTH), ("min(Theta)", ATTITUDE))
    ],
)


@cache
def scenario_and_plan(scenario: Path, objective: Objective) -> tuple[PlanningProblem, Plan]:
    problem = replace(load_scenario(scenario), objective=objective)
    return problem, planned(problem)


@cache
def verified(scenario: Path, objective: Objective) -> Verification:
    problem, answer = scenario_and_plan(scenario, objective)
    return verify(problem.robot, answer.trajectory)


# Of a path that swings the arm far out for a chaser that hardly turns: open loop its wrist
# multiplies by a hundred thousand what the torques are off.
VIOLENT = (
    *(-3.9694, 17.9801, -17.3934, -2.4754, 7.5197, -7.3391, -1.0127, 5.1634, -4.9635),
    *(-4.0036, 10.172, -6.8443, -6.7107, 20.2786, -20.7788, 2.045, -3.3836, 3.8937),
)


def test_a_violent_plan_comes_true_as_well_as_a_tame_one() -> None:
    problem, settings = load_scenario(LEMUR_SCENARIO), load_parameters().planner
    family = end_effector_paths(problem)
    path = path_program(problem, family, settings).linearise(np.array(VIOLENT))
    nothing = SolverReport(1, 0, 1, np.inf, "a given path")
    made, _ = plan_of_path(problem, settings, family, Candidate(path, nothing))
    off = verify(problem.robot, made.trajectory).deviation
    assert off.final_position_error <= 1e-5
    assert off.final_orientation_error <= np.deg2rad(0.005)


@pytest.mark.law("PLAN-22")
@every_plan
def test_a_plan_comes_true(scenario: Path, objective: Objective) -> None:
    found = verified(scenario, objective)
    off = found.deviation
    assert found.passed
    assert off.final_position_error <= 1e-3
    assert off.final_orientation_error <= np.deg2rad(0.05)
    assert off.max_chaser_position_error <= 1e-3
    assert off.max_chaser_orientation_error <= np.deg2rad(0.05)


@every_plan
def test_the_end_effector_arrives_at_the_target(scenario: Path, objective: Objective) -> None:
    problem, _ = scenario_and_plan(scenario, objective)
    execution = verified(scenario, objective).execution
    miss = np.linalg.norm(execution.ee_positions[-1] - problem.target.position)
    wanted = Rotation.from_quat(problem.target.quaternion_xyzw)
    turn = wanted.inv() * Rotation.from_quat(execution.ee_quaternions_xyzw[-1])
    assert miss <= 1e-3
    assert turn.magnitude() <= np.deg2rad(0.05)


@pytest.mark.law("PLAN-03")
@every_plan
def test_the_momentum_that_is_not_zero_is_conserved(scenario: Path, objective: Objective) -> None:
    found = verified(scenario, objective)
    linear, angular = np.split(found.execution.momentum, 2, axis=1)
    assert np.linalg.norm(linear[0]) > 1.0
    assert np.linalg.norm(angular[0]) > 1.0
    assert linear == pytest.approx(
        np.tile(linear[0], (50, 1)), abs=1e-7 * np.linalg.norm(linear[0])
    )
    change = np.abs(found.execution.momentum - found.execution.momentum[0])
    assert change.max() / np.linalg.norm(found.execution.momentum[0]) <= found.momentum_drift < 1e-7


@pytest.mark.ci
@pytest.mark.sampled
@every_plan
def test_the_error_falls_with_the_fourth_power_of_the_step(
    scenario: Path, objective: Objective
) -> None:
    """The integrator's own error, apart from that of the torques between the points."""
    problem, answer = scenario_and_plan(scenario, objective)
    start = state_at(answer.trajectory, 0)

    def final_positions(steps: int) -> tuple[Array, Array]:
        command = feed_forward(problem.robot, answer.trajectory, steps)
        found = execute(Engine(problem.robot), start, command)
        return found.ee_positions[-1], found.joint_positions[-1]

    truth, coarse, fine = (final_positions(steps) for steps in (128, 20, 40))
    for wanted, at_coarse, at_fine in zip(truth, coarse, fine, strict=True):
        ratio = np.linalg.norm(at_coarse - wanted) / np.linalg.norm(at_fine - wanted)
        assert 2**4 * 0.85 < ratio < 2**4 * 1.2


def test_mujocos_own_integrator_comes_to_the_same_end() -> None:
    """Its steps hold the torques: the error falls with the square of the step, to nothing else."""
    problem, answer = scenario_and_plan(LEMUR_SCENARIO, LENGTH)
    start = state_at(answer.trajectory, 0)
    ours = execute(Engine(problem.robot), start, feed_forward(problem.robot, answer.trajectory, 16))

    def difference(steps: int) -> float:
        command = feed_forward(problem.robot, answer.trajectory, steps)
        engine = Engine(problem.robot)
        engine.model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
        engine.model.opt.timestep = command.time[2]
        data = mujoco.MjData(engine.model)
        data.qpos, data.qvel = np.split(engine.state(start), [engine.model.nq])
        for torques in command.torques[1::2]:
            data.qfrc_applied[6:] = torques
            mujoco.mj_step(engine.model, data)
        mujoco.mj_forward(engine.model, data)
        tip = data.body("end_effector").xpos
        return float(np.linalg.norm(tip - ours.ee_positions[-1]))

    coarse, fine = difference(32), difference(64)
    assert fine < 2e-6
    assert 3.8 < coarse / fine < 4.2


def test_what_is_left_is_little_however_few_the_points_are() -> None:
    problem, _ = scenario_and_plan(LEMUR_SCENARIO, LENGTH)
    # Along one path at all numbers of points.
    problem = replace(problem, parametrisation=Parametrisation.END_EFFECTOR_POLYNOMIAL)
    settings = load_parameters().planner
    for points in (5, 8, 25, 49):
        motion = plan(replace(problem, points=points), settings).trajectory
        command = feed_forward(problem.robot, motion, 32)
        execution = execute(Engine(problem.robot), state_at(motion, 0), command)
        assert deviation(execution, motion).final_position_error < 2e-7, points


def test_torques_alone_are_not_enough_between_few_points() -> None:
    problem, _ = scenario_and_plan(LEMUR_SCENARIO, LENGTH)
    motion = plan(replace(problem, points=13), load_parameters().planner).trajectory
    steps = steps_per_point(motion)
    for command, limit_deg in (
        (feed_forward(problem.robot, motion, steps), (0.0, 0.01)),
        (torque_spline(motion, steps), (1.0, 180.0)),
    ):
        execution = execute(Engine(problem.robot), state_at(motion, 0), command)
        turn_deg = np.rad2deg(deviation(execution, motion).final_orientation_error)
        assert limit_deg[0] < turn_deg < limit_deg[1]


def shifted(values: Array, by: float) -> Array:
    """Move one coordinate, from the middle of the plan on."""
    moved = values.copy()
    moved[len(moved) // 2 :, 0] += by
    return moved


def turned(quaternions_xyzw: Array, by_deg: float) -> Array:
    turn = Rotation.from_rotvec([0.0, 0.0, np.deg2rad(by_deg)])
    return np.asarray((Rotation.from_quat(quaternions_xyzw) * turn).as_quat(), np.float64)


WRONG = {
    "torques 1 % too high": lambda m: {"joint_torques": 1.01 * m.joint_torques},
    "one torque with the wrong sign": lambda m: {
        "joint_torques": m.joint_torques * [1, 1, 1, 1, 1, 1, -1]
    },
    "no torques": lambda m: {"joint_torques": 0.0 * m.joint_torques},
    "torques of another moment": lambda m: {"joint_torques": np.roll(m.joint_torques, 1, axis=0)},
    "end effector elsewhere": lambda m: {"ee_positions": shifted(m.ee_positions, 2e-3)},
    "end effector turned": lambda m: {"ee_quaternions_xyzw": turned(m.ee_quaternions_xyzw, 0.1)},
    "chaser elsewhere": lambda m: {"chaser_positions": shifted(m.chaser_positions, 2e-3)},
    "chaser does not drift": lambda m: {
        "chaser_linear_velocities": 0.0 * m.chaser_linear_velocities
    },
    "chaser does not turn": lambda m: {
        "chaser_angular_velocities": 0.0 * m.chaser_angular_velocities
    },
}


@pytest.mark.sampled
@pytest.mark.law("PLAN-22")
@pytest.mark.parametrize("fault", WRONG)
def test_a_wrong_plan_does_not_come_true(fault: str) -> None:
    problem, answer = scenario_and_plan(LEMUR_SCENARIO, LENGTH)
    motion = answer.trajectory
    assert not verify(problem.robot, replace(motion, **WRONG[fault](motion))).passed


def test_a_plan_for_another_robot_does_not_come_true() -> None:
    """The plan is right but for a heavier hand: nobody but the engine knows."""
    problem, answer = scenario_and_plan(LEMUR_SCENARIO, LENGTH)
    heavier = problem.robot.urdf.replace('value="3.9"', 'value="4.0"')
    assert heavier != problem.robot.urdf
    robot = replace(problem.robot, urdf=heavier)
    assert not verify(robot, answer.trajectory).passed


SOUND = Deviation(
    POSITION_TOLERANCE, ORIENTATION_TOLERANCE, POSITION_TOLERANCE, ORIENTATION_TOLERANCE
)


@pytest.mark.parametrize("name", Deviation.__dataclass_fields__)
@pytest.mark.parametrize("excess", [1.001, np.nan, np.inf])
def test_each_deviation_beyond_its_tolerance_fails(name: str, excess: float) -> None:
    execution = verified(LEMUR_SCENARIO, LENGTH).execution
    assert Verification(execution, SOUND, MOMENTUM_TOLERANCE).passed
    off = replace(SOUND, **{name: excess * getattr(SOUND, name)})
    assert not Verification(execution, off, MOMENTUM_TOLERANCE).passed


@pytest.mark.parametrize("drift", [1.001 * MOMENTUM_TOLERANCE, np.nan])
def test_a_momentum_that_changes_fails(drift: float) -> None:
    execution = verified(LEMUR_SCENARIO, LENGTH).execution
    assert not Verification(execution, SOUND, drift).passed


def test_the_end_is_judged_by_the_end_effector_and_the_way_by_the_chaser() -> None:
    _, motion = _robot_and_motion()
    execution = verified(LEMUR_SCENARIO, LENGTH).execution
    middle = np.zeros((50, 3))
    middle[25] = [0.3, 0.4, 0.0]
    astray = replace(
        execution,
        chaser_positions=execution.chaser_positions + middle,
        ee_positions=execution.ee_positions + middle,
    )
    off = deviation(astray, motion)
    assert off.max_chaser_position_error == pytest.approx(0.5, abs=1e-6)
    assert off.final_position_error < 1e-6
    turned_by = turned(execution.chaser_quaternions_xyzw, 3.0)
    off = deviation(replace(execution, chaser_quaternions_xyzw=turned_by), motion)
    assert np.rad2deg(off.max_chaser_orientation_error) == pytest.approx(3.0, abs=1e-3)


def test_the_sign_of_a_quaternion_does_not_matter() -> None:
    robot, motion = _robot_and_motion()
    signs = np.where(np.arange(50) % 3 == 1, -1.0, 1.0)[:, None]
    flipped = replace(
        motion,
        chaser_quaternions_xyzw=signs * motion.chaser_quaternions_xyzw,
        ee_quaternions_xyzw=signs * motion.ee_quaternions_xyzw,
    )
    one = astuple(verified(LEMUR_SCENARIO, LENGTH).deviation)
    assert astuple(verify(robot, flipped).deviation) == pytest.approx(one, abs=1e-10)


def test_a_faster_motion_is_cut_into_more_steps() -> None:
    _, motion = _robot_and_motion()
    slow = replace(
        motion,
        joint_velocities=np.full((50, 7), 1e-3),
        chaser_angular_velocities=np.zeros((50, 3)),
    )
    assert steps_per_point(slow) == MIN_STEPS_PER_POINT
    interval = 10.0 / 49
    for fast in (
        replace(slow, joint_velocities=np.full((50, 7), -0.5)),
        replace(slow, chaser_angular_velocities=np.tile([0.3, 0.0, -0.4], (50, 1))),
    ):
        assert steps_per_point(fast) == np.ceil(0.5 * interval / 0.01)


@pytest.mark.parametrize(
    ("changes", "status", "message"),
    [
        ({"time": [0.0]}, Status.WRONG_SIZE, r"time is \[0\.\]: it must be two numbers or more"),
        ({"time": np.ones((50, 1))}, Status.WRONG_SIZE, "time is"),
        ({"joint_torques": np.ones((50, 6))}, Status.WRONG_SIZE, r"joint_torques.*\(50, 7\)"),
        ({"joint_torques": np.ones((50, 0))}, Status.WRONG_SIZE, r"joint_torques.*\(50, 7\)"),
        ({"ee_positions": np.ones((49, 3))}, Status.WRONG_SIZE, r"ee_positions.*\(50, 3\)"),
        (
            {"chaser_quaternions_xyzw": np.ones((50, 3))},
            Status.WRONG_SIZE,
            r"chaser_quaternions_xyzw.*\(50, 4\)",
        ),
        ({"joint_velocities": np.full((50, 7), np.nan)}, Status.NOT_FINITE, "joint_velocities"),
        ({"time": np.zeros(50)}, Status.OUT_OF_RANGE, "time is not increasing"),
    ],
)
def test_samples_that_cannot_be_executed_are_refused_by_name(
    changes: dict[str, Array], status: Status, message: str
) -> None:
    robot, motion = _robot_and_motion()
    with pytest.raises(InvalidInput, match=message) as refusal:
        verify(robot, replace(motion, **changes))
    assert refusal.value.status == status


def test_quaternions_of_no_length_are_refused() -> None:
    robot, motion = _robot_and_motion()
    for name in ("chaser_quaternions_xyzw", "ee_quaternions_xyzw"):
        with pytest.raises(InvalidInput, match=f"{name} is .*norm must be 1") as refusal:
            verify(robot, replace(motion, **{name: np.zeros((50, 4))}))
        assert refusal.value.status == Status.BAD_QUATERNION


def _robot_and_motion() -> tuple[Robot, Trajectory]:
    problem, answer = scenario_and_plan(LEMUR_SCENARIO, LENGTH)
    return problem.robot, answer.trajectory


def test_steps_are_as_fine_as_it_takes_an_arm_of_fourteen_joints_to_keep_the_momentum() -> None:
    """Eight steps a point let this one run away from its plan by 4 mm."""
    problem = witnessed.drawn("many joints", 1009).problem
    found = verify(problem.robot, plan(problem, load_parameters().planner).trajectory)
    assert found.momentum_drift <= MOMENTUM_TOLERANCE
    assert found.passed, found.deviation


def test_a_system_that_stands_still_comes_true() -> None:
    drifting = load_scenario(PLANAR_SCENARIO)
    robot, nothing = drifting.robot, np.zeros(3)
    start = replace(
        drifting.start,
        linear_velocity_chaser_in_inertial=nothing,
        angular_velocity_chaser_in_inertial=nothing,
        joint_velocities=nothing,
    )
    q, _ = configuration(robot, start)
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    here = pin.updateFramePlacement(robot.model, data, robot.tip_frame_id)
    target = Target(here.translation.copy(), pin.Quaternion(here.rotation).coeffs().copy())
    problem = replace(drifting, start=start, target=target, obstacles=(), points=10)
    found = verify(robot, plan(problem, load_parameters().planner).trajectory)
    assert found.passed, (found.deviation, found.momentum_drift)


@pytest.mark.ci
def test_an_unstable_motion_is_executed_in_parts_and_no_error_hides_between_them() -> None:
    """Ten joints and a heavy payload: without feedback the least error grows a millionfold.

    The torque of one point is wrong in turn: where the first of two executions begins a part, and
    in the middle of one.
    """
    task = captured.problem("payload stow", 3).task(load_parameters().planner)
    motion = perform(task).trajectory
    found = verify(task.problem.robot, motion)
    assert found.passed
    assert found.parts > 1
    assert found.deviation.final_position_error < POSITION_TOLERANCE / 1_000
    for point in (12, 18):
        torques = motion.joint_torques.copy()
        torques[point, 4] += 0.05
        wrong = verify(task.problem.robot, replace(motion, joint_torques=torques))
        assert not wrong.passed, point
