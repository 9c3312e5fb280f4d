"""A chaser whose attitude wheels hold: its motion, what the wheels take up, and their limits."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pinocchio as pin
import pytest
import yaml
from core_rows import sensitivity_of
from reference_load_rows import loads_with_derivatives
from reference_program import rows_of
from robots import CONFIG, LEMUR_SCENARIO, ROBOTS, random_state, random_urdf

from ff_planner_ros.analysis.plan_document import plan_document
from ff_planner_ros.analysis.plan_json import plan_dictionary
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput, NoPlanFound, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.check.check import failures
from ff_planner_ros.planning.motion import certified_least
from ff_planner_ros.planning.motion.followed import FollowedMotion, followed, peaks_of_steps
from ff_planner_ros.planning.motion.forward import carried_forward
from ff_planner_ros.planning.motion.joint_motion import joint_motion
from ff_planner_ros.planning.motion.motion import to_trajectory
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.system_frame import in_own_frame, system_frame
from ff_planner_ros.planning.motion.wheel_motion import certain_peaks, wheels_along
from ff_planner_ros.planning.paths.joint_spline import JointSplines, joint_splines
from ff_planner_ros.planning.problem.problem import Objective, PlanningProblem, Target
from ff_planner_ros.planning.problem.scene import Scene
from ff_planner_ros.planning.problem.uncertainty import Uncertainty
from ff_planner_ros.planning.requirements.limits.wheels import WheelLimits, exceeds_at_points
from ff_planner_ros.planning.requirements.plane import Plane
from ff_planner_ros.planning.requirements.requirement import Samples
from ff_planner_ros.planning.scenario.scenario import Defaults, load_scenario, load_task
from ff_planner_ros.planning.scenario.scenario_writer import write_scenario
from ff_planner_ros.planning.search.continuing import joined
from ff_planner_ros.planning.task.tail import EndBehaviour
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Base, Robot, robot_from_urdf_text
from ff_planner_ros.robot.momentum import angular_momenta, angular_momentum_bounds
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.robot.wheels import Wheels
from ff_planner_ros.robot.wheels import momenta_of as wheel_momenta_of
from ff_planner_ros.simulation.free_floating import FreeFloatingSystem, carried_back
from ff_planner_ros.simulation.monte_carlo import monte_carlo
from ff_planner_ros.simulation.verification import TORQUE_TOLERANCE, verify

SETTINGS = load_parameters().planner
SCENARIO = CONFIG / "scenarios/lemur_wheels.yaml"
FOUR = Wheels(np.array([[1.0, 0.2, 0.1], [-0.3, 1.0, 0.4], [0.2, -0.5, 2.0], [1.0, 1.0, 1.0]]))


def held_robot(name: str, wheels: Wheels | None = None) -> Robot:
    urdf, *links = ROBOTS[name]
    return robot_from_urdf_text(urdf, *links, Base.ATTITUDE_HELD, wheels=wheels)


def held_problem(name: str = "six joints", wheels: Wheels | None = None) -> PlanningProblem:
    """A chaser anywhere that drifts without turning, its base link turned against the root."""
    robot, rng = held_robot(name, wheels), np.random.default_rng(3)
    start = replace(
        random_state(robot, rng),
        angular_velocity_chaser_in_inertial=np.zeros(3),
        joint_accelerations=rng.normal(scale=0.01, size=robot.joints),
        wheel_momenta=None if robot.wheels is None else rng.normal(size=robot.wheels.count),
    )
    target = Target(position=rng.normal(size=3), quaternion_xyzw=np.array([0.0, 0.0, 0.0, 1.0]))
    return PlanningProblem(robot, start, target, 8.0, 50, (), Objective(1.0, 0.0))


def drawn(problem: PlanningProblem) -> tuple[JointSplines, Array]:
    family = joint_splines(problem, SETTINGS)
    hold = np.repeat(family.fixed[-1:], family.basis.count - 3, axis=0).T.ravel()
    return family, hold + np.random.default_rng(1).normal(scale=0.2, size=family.variables)


@cache
def planned() -> tuple[PlanningTask, Plan]:
    task = load_task(SCENARIO, Defaults(SETTINGS))
    return task, perform(task)


def test_the_chaser_drifts_so_that_linear_momentum_is_conserved_and_does_not_turn() -> None:
    problem = held_problem()
    family, x = drawn(problem)
    motion = family.motion(x, 50)
    model, data = problem.robot.model, problem.robot.model.createData()
    first = configuration(problem.robot, problem.start)[0][3:7]
    np.testing.assert_allclose(np.abs(motion.q[:, 3:7] @ first), 1.0, atol=1e-14)
    linear = np.array(
        [
            pin.computeCentroidalMomentum(model, data, q, v).linear
            for q, v in zip(motion.q, motion.v, strict=True)
        ]
    )
    np.testing.assert_allclose(linear - linear[0], 0.0, atol=1e-11)
    assert not motion.v[:, 3:6].any()
    # The velocities are those of the configurations.
    step = problem.duration / (49)
    way = np.array(
        [pin.difference(model, a, b) for a, b in zip(motion.q[:-2], motion.q[2:], strict=True)]
    )
    off = way / (2 * step) - motion.v[1:-1]
    assert np.abs(off).max() < 0.05 * np.abs(motion.v).max()


@pytest.mark.parametrize("name", ["six joints", "nine joints"])
def test_all_derivatives_are_those_of_finite_differences(name: str) -> None:
    problem = in_own_frame(held_problem(name, replace(FOUR, momentum=(0.5,), torque=(0.3,))))
    family, x = drawn(problem)
    motion = family.motion(x, 9)
    sensitivity, by = sensitivity_of(family, motion), np.random.default_rng(2).normal(size=len(x))
    rows = rows_of(WheelLimits(), problem, motion, sensitivity, 1e-3)
    assert rows is not None
    assert (np.abs(rows.jacobian).max(axis=1) > 0.0).all()
    step = 1e-6
    beside = [family.motion(x + way * by, 9) for way in (-step, step)]

    def central(of: Any) -> Array:
        low, high = (of(one) for one in beside)
        return (high - low) / (2 * step)

    def kept(at: Any) -> dict[int, float]:
        found = rows_of(WheelLimits(), problem, at, sensitivity_of(family, at), 1e-3)
        assert found is not None
        return dict(zip(found.names.tolist(), found.values.tolist(), strict=True))

    np.testing.assert_allclose(
        sensitivity.goal_error @ by, central(lambda m: m.goal_error), atol=1e-7
    )
    np.testing.assert_allclose(sensitivity.v @ by, central(lambda m: m.v), atol=1e-7)
    names = rows.names.tolist()
    low, high = map(kept, beside)
    known = [k for k, name in enumerate(names) if name in low and name in high]
    assert len(known) > 20
    found = np.array([(high[names[k]] - low[names[k]]) / (2 * step) for k in known])
    np.testing.assert_allclose(rows.jacobian[known] @ by, found, atol=1e-6 * np.abs(found).max())


def test_torques_that_are_near_their_limits_have_rows_with_derivatives() -> None:
    problem = in_own_frame(held_problem("six joints", FOUR))
    family, x = drawn(problem)
    motion = family.motion(x, 9)
    sensitivity = sensitivity_of(family, motion)
    robot = problem.robot
    assert robot.wheels is not None
    _, _, torques, by_x = loads_with_derivatives(problem, robot.wheels, motion, sensitivity)
    limit = 1.25 * float(np.abs(torques[1:]).max())
    near = replace(problem, robot=replace(robot, wheels=replace(FOUR, torque=(limit,))))
    rows = rows_of(WheelLimits(), near, motion, sensitivity, 1e-3)
    assert rows is not None
    kept = np.abs(torques[1:]) / limit > 0.6 + 1e-3
    assert 0 < kept.sum() < kept.size
    of_torques = rows.jacobian[rows.names >= 1 << 30]
    assert len(of_torques) >= kept.sum()
    for expected in np.abs(by_x[1:][kept]) / limit:
        off = np.abs(np.abs(of_torques) - expected).max(axis=1)
        assert off.min() < 1e-12 * expected.max()


@pytest.mark.law("PLAN-15")
@pytest.mark.parametrize("wheels", [None, FOUR], ids=["own axes", "four"])
def test_what_wheels_and_bodies_have_of_angular_momentum_together_is_constant(
    wheels: Wheels | None,
) -> None:
    problem = in_own_frame(held_problem("six joints", wheels))
    family, x = drawn(problem)
    motion = family.motion(x, 400)
    robot = problem.robot
    assert robot.wheels is not None
    sensitivity = sensitivity_of(family, motion)
    momenta, _, torques, _ = loads_with_derivatives(problem, robot.wheels, motion, sensitivity)
    data, total = robot.model.createData(), []
    for q, v, held in zip(motion.q, motion.v, momenta, strict=True):
        about = pin.computeCentroidalMomentum(robot.model, data, q, v).angular
        axes = pin.XYZQUATToSE3(q[:7]).rotation @ robot.rotation_chaser_to_base
        total.append(about + axes @ robot.wheels.axes.T @ held)
    np.testing.assert_allclose(np.array(total) - total[0], 0.0, atol=1e-10)
    np.testing.assert_allclose(momenta[0], problem.start.wheel_momenta, atol=1e-12)
    # And a wheel's torque is the rate of its momentum.
    step = problem.duration / 399
    rates = (8 * (momenta[3:-1] - momenta[1:-3]) - momenta[4:] + momenta[:-4]) / (12 * step)
    np.testing.assert_allclose(torques[2:-2], rates, atol=1e-4 * np.abs(rates).max())


@pytest.mark.law("PLAN-15")
def test_a_plan_keeps_the_limits_of_its_wheels_and_one_without_exceeds_them() -> None:
    task, plan = planned()
    wheels, told = task.problem.robot.wheels, plan.wheels
    assert wheels is not None
    assert told is not None
    momenta, torques = plan.metrics.peak_wheel_momenta, plan.metrics.peak_wheel_torques
    assert (momenta <= wheels.momentum_limits + 1e-6).all()
    assert (torques <= wheels.torque_limits + 1e-6).all()
    assert max(momenta) > 0.99 * wheels.momentum_limits[0]
    np.testing.assert_allclose(told.momenta[0], [0.2, -0.5, 0.0])
    assert (np.abs(told.momenta) <= np.array(momenta) + 1e-9).all()
    free = replace(task.problem, robot=replace(task.problem.robot, wheels=Wheels()))
    without = perform(PlanningTask(free, SETTINGS))
    assert without.wheels is not None
    assert max(without.metrics.peak_wheel_momenta) > 4.01
    assert without.metrics.joint_path_length < plan.metrics.joint_path_length
    # The check, which takes nothing from the search, refuses it by wheel, value and time.
    found = list(failures(in_own_frame(task.problem), seen(task.problem, without), SETTINGS))
    assert [one.status for one in found] == [Status.LIMIT_VIOLATED]
    assert "wheel 2 holds" in found[0].finding
    assert "beyond its limit of 4 N m s, at t = " in found[0].finding


def test_a_start_at_the_torque_limit_of_a_wheel_is_planned_from() -> None:
    """A limit that the shortest path would exceed later on."""
    task, _ = planned()
    bare = replace(task.problem.robot, wheels=Wheels())
    free = perform(replace(task, problem=replace(task.problem, robot=bare)))
    most = np.array(free.metrics.peak_wheel_torques)
    problem, wheel = task.problem, int(most.argmax())
    q, v = configuration(bare, problem.start)

    def torques(accelerations: Array) -> Array:
        sample = q[None], v[None], accelerations[None]
        found: Array = wheels_along(bare, Wheels(), np.zeros(3), *sample)[1][0]
        return found

    limit, way = 0.7 * most[wheel], (-1.0) ** np.arange(bare.joints)
    none, by = torques(0.0 * way)[wheel], (torques(way) - torques(0.0 * way))[wheel]
    start = replace(problem.start, joint_accelerations=(1.00005 * limit - none) / by * way)
    limits = 100.0 * most
    limits[wheel] = limit
    robot = replace(bare, wheels=Wheels(torque=tuple(limits.tolist())))
    plan = perform(replace(task, problem=replace(problem, robot=robot, start=start)))
    assert (plan.metrics.peak_wheel_torques <= 1.0002 * limits).all()


@pytest.mark.law("PLAN-15")
def test_a_wheel_is_refused_that_holds_or_gives_too_much_either_way() -> None:
    """One wheel alone beyond its limit, by a hundredth, of which the largest value is negative."""
    task, plan = planned()
    told = plan.wheels
    assert told is not None
    for name, rows, verb in (
        ("momentum", told.momenta, "holds"),
        ("torque", told.torques, "gives"),
    ):
        negative = np.flatnonzero(-rows.min(axis=0) > rows.max(axis=0))
        assert negative.size
        wheel = int(negative[0])
        limits = np.full(3, 99.0)
        limits[wheel] = -0.99 * rows[:, wheel].min()
        weak = Wheels(**{name: tuple(limits.tolist())})
        problem = replace(task.problem, robot=replace(task.problem.robot, wheels=weak))
        (found,) = failures(in_own_frame(problem), seen(problem, plan), SETTINGS)
        assert f"wheel {wheel + 1} {verb} -" in found.finding


def seen(problem: PlanningProblem, plan: Plan) -> Plan:
    return system_frame(problem.robot, problem.start).plan(plan)


def test_a_torque_beyond_the_limit_is_refused_by_name() -> None:
    task, plan = planned()
    weak = replace(task.problem.robot.wheels, torque=(0.3,))
    problem = in_own_frame(replace(task.problem, robot=replace(task.problem.robot, wheels=weak)))
    found = [one.finding for one in failures(problem, seen(problem, plan), SETTINGS)]
    assert any("gives" in words and "N m beyond its limit of 0.3 N m" in words for words in found)
    with pytest.raises(NoPlanFound, match=r"wheel . gives"):
        perform(
            PlanningTask(
                replace(
                    task.problem,
                    robot=replace(task.problem.robot, wheels=replace(weak, torque=(0.01,))),
                ),
                replace(SETTINGS, starts=2),
            )
        )


@pytest.mark.nightly
def test_a_plan_comes_true_on_three_slides_with_the_torque_of_the_wheels() -> None:
    task, plan = planned()
    found = verify(task.problem.robot, plan.trajectory)
    assert found.passed
    assert found.deviation.final_position_error < 1e-4
    assert found.holding_torque_error is not None
    assert found.holding_torque_error < 1e-6
    # In another frame, on a base link that is turned against the root link.
    problem = held_problem()
    family, x = drawn(problem)
    motion = family.motion(x, 50)
    rates = sensitivity_of(family, motion).acceleration
    there = to_trajectory(problem.robot, np.linspace(0.0, 8.0, 50), motion.q, motion.v, rates)
    other = verify(problem.robot, there)
    assert other.passed
    assert other.holding_torque_error is not None
    turning = replace(there, joint_accelerations=1.01 * there.joint_accelerations)
    wrong = verify(problem.robot, turning)
    assert not wrong.passed
    # By that torque alone, too.
    assert not replace(found, holding_torque_error=2.0 * TORQUE_TOLERANCE).passed


def test_a_chaser_that_turns_in_its_samples_is_refused_by_the_check() -> None:
    task, plan = planned()
    trajectory = plan.trajectory
    spin = replace(
        trajectory, chaser_angular_velocities=trajectory.chaser_angular_velocities + 1e-4
    )
    found = Plane().assess(Samples(task.problem, SETTINGS, spin))
    assert [one.finding for one in found.failures] == [
        "the chaser is held by wheels, but turns at up to 0.0001 rad/s"
    ]


def test_a_state_is_carried_forward_with_what_its_wheels_hold() -> None:
    task, plan = planned()
    robot, start = task.problem.robot, task.problem.start
    assert plan.wheels is not None
    running = joint_motion(plan.trajectory)
    when = float(plan.trajectory.time[20])
    there = carried_forward(robot, start, when, running)
    np.testing.assert_allclose(there.wheel_momenta, plan.wheels.momenta[20], atol=1e-6)
    np.testing.assert_allclose(
        there.position_chaser_in_inertial, plan.trajectory.chaser_positions[20], atol=1e-6
    )
    over = joined(robot, start, when, running)
    np.testing.assert_allclose(over.wheel_momenta, plan.wheels.momenta[20], atol=1e-6)
    system = FreeFloatingSystem(robot, start, 5.0)
    system.follow(replace(running, time=running.time + 5.0))
    flown = system.advance(5.0 + when)
    np.testing.assert_allclose(flown.wheel_momenta, plan.wheels.momenta[20], atol=1e-6)
    moving = held_problem("six joints", FOUR)
    back = carried_back(moving.robot, carried_forward(moving.robot, moving.start, 2.0, None), 2.0)
    np.testing.assert_allclose(back.wheel_momenta, moving.start.wheel_momenta, atol=1e-8)


@pytest.mark.parametrize("behaviour", [EndBehaviour.STOP_JOINTS, EndBehaviour.HOLD_END_EFFECTOR])
def test_the_wheels_are_told_in_the_tail_too(behaviour: EndBehaviour) -> None:
    task, _ = planned()
    plan = perform(replace(task, end_behaviour=behaviour, tail=2.0))
    assert plan.wheels is not None
    assert len(plan.wheels.momenta) == len(plan.trajectory.time) > 50
    assert verify(task.problem.robot, plan.trajectory).passed


def test_a_scenario_and_an_answer_hold_the_wheels(tmp_path: Path) -> None:
    task, plan = planned()
    write_scenario(task, tmp_path / "held.yaml")
    again = load_task(tmp_path / "held.yaml", Defaults(SETTINGS))
    assert again.digest == task.digest
    answer = json.loads(json.dumps(plan_dictionary(plan, task, 0.1)))
    assert answer["robot"]["wheels"]["momentum"] == [4.0] * 3
    assert np.shape(answer["wheels"]["momenta"]) == np.shape(answer["wheels"]["torques"]) == (50, 3)
    assert len(answer["metrics"]["peak_wheel_torques"]) == 3
    document = plan_document(answer)
    assert document.robot.base is Base.ATTITUDE_HELD
    assert document.robot.wheels is not None
    assert document.plan.wheels is not None
    assert plan.wheels is not None
    np.testing.assert_array_equal(document.plan.wheels.momenta, plan.wheels.momenta)
    assert document.plan.metrics == plan.metrics
    stored = replace(task.problem, start=replace(task.problem.start, wheel_momenta=np.zeros(3)))
    assert PlanningTask(stored, SETTINGS).digest != task.digest


def scenario_with(tmp_path: Path, **changes: Any) -> Path:
    document = yaml.safe_load(SCENARIO.read_text())
    document["robot"]["urdf"] = str(CONFIG / "robots/lemur/lemur.urdf")
    for key, value in changes.items():
        block: Any = document
        *groups, last = key.split("__")
        for group in groups:
            block = block[group]
        block[last] = value
    path = tmp_path / "s.yaml"
    path.write_text(yaml.safe_dump(document))
    return path


@pytest.mark.parametrize(
    ("changes", "field", "words"),
    [
        ({"robot__base": "free_flyer"}, "robot.wheels", "with robot.base free_flyer"),
        ({"robot__wheels__axes": [[1, 0, 0], [0, 1, 0]]}, "robot.wheels.axes", "three wheels"),
        (
            {"robot__wheels__axes": [[1, 0, 0], [0, 1, 0], [1, 1, 0]]},
            "robot.wheels.axes",
            "one plane",
        ),
        (
            {"robot__wheels__axes": [[1, 0, 0], [0, 1, 0], [0, 0, 0]]},
            "robot.wheels.axes[2]",
            "long",
        ),
        ({"robot__wheels__momentum": [1.0, 2.0]}, "robot.wheels.momentum", "3 entries"),
        ({"robot__wheels__torque": -1.0}, "robot.wheels.torque", "0"),
        ({"robot__wheels__stored": [1.0]}, "robot.wheels.stored", "3 entries"),
        (
            {"chaser__angular_velocity": [0.0, 0.01, 0.0]},
            "chaser.angular_velocity",
            "must not turn",
        ),
        ({"parametrisation": "end_effector_polynomial"}, "parametrisation", "wheels hold"),
        (
            {"robot__wheels__stored": [0.0, 4.5, 0.0]},
            "robot.wheels.stored[1]",
            "wheel 2 holds 4.5 N m s, 0.5 N m s beyond its limit of 4 N m s",
        ),
    ],
)
def test_what_wheels_cannot_do_is_refused_by_name(
    tmp_path: Path, changes: dict[str, Any], field: str, words: str
) -> None:
    with pytest.raises(InvalidInput) as refused:
        perform(load_task(scenario_with(tmp_path, **changes), Defaults(SETTINGS)))
    assert refused.value.field == field
    assert words in str(refused.value)


def test_a_start_that_accelerates_against_a_weak_wheel_is_refused(tmp_path: Path) -> None:
    path = scenario_with(tmp_path, joints__acceleration=[0.5] * 7, robot__wheels__torque=0.5)
    with pytest.raises(InvalidInput, match=r"wheel . gives .* beyond its limit of 0\.5 N m"):
        perform(load_task(path, Defaults(SETTINGS)))


def test_wheels_may_be_left_out_and_then_have_no_limits(tmp_path: Path) -> None:
    document = yaml.safe_load(scenario_with(tmp_path).read_text())
    del document["robot"]["wheels"]
    (tmp_path / "s.yaml").write_text(yaml.safe_dump(document))
    problem = load_scenario(tmp_path / "s.yaml")
    assert problem.robot.wheels is not None
    assert problem.robot.wheels.momentum is None
    np.testing.assert_array_equal(problem.robot.wheels.axes, np.eye(3))
    np.testing.assert_array_equal(problem.start.wheel_momenta, np.zeros(3))


def test_a_free_chaser_has_no_wheels() -> None:
    problem = load_scenario(LEMUR_SCENARIO)
    assert problem.robot.wheels is None
    assert problem.start.wheel_momenta is None


def test_what_is_not_known_of_wheels_is_refused_by_name() -> None:
    task, plan = planned()
    robust = replace(SETTINGS, robust=replace(SETTINGS.robust, sigmas=3.0))
    with pytest.raises(InvalidInput, match=r"planner\.robust\.sigmas .*attitude_held"):
        perform(replace(task, settings=robust))
    asked = task.problem.robot, plan.trajectory, Scene(), Uncertainty()
    with pytest.raises(InvalidInput, match=r"--execution .*attitude_held"):
        monte_carlo(*asked, 2)


@pytest.mark.ci
def test_a_weight_on_the_momentum_of_the_wheels_makes_it_less() -> None:
    task, _ = planned()
    free = replace(task.problem, robot=replace(task.problem.robot, wheels=Wheels()))
    shortest, least = (
        perform(PlanningTask(replace(free, objective=objective), SETTINGS))
        for objective in (Objective(1.0, 0.0), Objective(1.0, 0.0, wheel_momentum=10.0))
    )
    peaks = [max(plan.metrics.peak_wheel_momenta) for plan in (shortest, least)]
    assert peaks[1] < 0.8 * peaks[0]
    lengths = [plan.metrics.joint_path_length for plan in (shortest, least)]
    assert lengths[1] > lengths[0]
    # Alone it is least of all: the joint path only breaks ties.
    alone = Objective(0.0, 0.0, wheel_momentum=1.0)
    found = perform(PlanningTask(replace(free, objective=alone), SETTINGS))
    assert max(found.metrics.peak_wheel_momenta) < 1.01 * peaks[1]
    assert verify(free.robot, found.trajectory).passed


def test_without_wheels_there_is_no_weight_on_their_momentum() -> None:
    problem = load_scenario(LEMUR_SCENARIO)
    weighted = replace(problem, objective=Objective(1.0, 0.0, wheel_momentum=1.0))
    with pytest.raises(InvalidInput, match=r"objective\.wheel_momentum .*free_flyer.*no wheels"):
        perform(PlanningTask(weighted, SETTINGS))


def driven(robot: Robot, seed: int) -> FollowedMotion:
    """A motion at held attitude for eight seconds on 50 points."""
    problem = replace(in_own_frame(held_problem("six joints", FOUR)), robot=robot)
    rng = np.random.default_rng(seed)
    start = replace(
        problem.start,
        joint_positions=rng.normal(size=robot.joints),
        joint_velocities=np.zeros(robot.joints),
        joint_accelerations=None,
    )
    family, x = drawn(in_own_frame(replace(problem, start=start)))
    motion = family.motion(x + rng.normal(scale=0.3, size=len(x)), 50)
    rates = sensitivity_of(family, motion).acceleration
    samples = to_trajectory(robot, np.linspace(0.0, 8.0, 50), motion.q, motion.v, rates)
    return followed(robot, motion.q[0], motion.v[0], joint_motion(samples))


def momenta_of(robot: Robot, motion: FollowedMotion, times: Array) -> tuple[Array, Array]:
    """Angular momenta and their rates at any times."""
    positions, rates, accelerations = motion.joints.at(times)
    q, v = np.tile(motion.q[0], (len(times), 1)), np.zeros((len(times), motion.v.shape[1]))
    q[:, 7:], v[:, 6:] = positions, rates
    return angular_momenta(robot, q, v, accelerations)


@pytest.mark.law("PLAN-15")
@pytest.mark.parametrize("sliding", [(), (1,), (2, 5)])
def test_no_derivative_of_angular_momentum_exceeds_its_bound(
    sliding: tuple[int, ...], times: Callable[[int, int], int]
) -> None:
    """By differences of what Pinocchio's centroidal algorithms find."""
    for seed in range(times(5, 50)):
        urdf = random_urdf(6, seed=seed, sliding=sliding)
        robot = robot_from_urdf_text(urdf, "bus", "tool", Base.ATTITUDE_HELD, wheels=FOUR)
        motion = driven(robot, seed)
        bounds = angular_momentum_bounds(robot, motion.joints.largest(5))
        parts, step = np.linspace(0.0, 1.0, 41), 8.0 / 49 / 40
        moments = ((np.arange(49)[:, None] + parts) * 8.0 / 49).ravel()
        momenta, rates = (rows.reshape(49, 41, 3) for rows in momenta_of(robot, motion, moments))
        changes = np.diff(rates, axis=1) / step, np.diff(rates, 2, axis=1) / step**2
        every = (momenta, rates, *changes)
        found = np.array([np.linalg.norm(rows, axis=2).max(axis=1) for rows in every])
        assert (found <= bounds).all(), seed
        assert (bounds.max(axis=1) < 1e3 * found.max(axis=1)).all(), seed


def swinging(chaser: float, arm: float) -> Robot:
    """An arm of one link that turns about z, each body's mass [kg] as told.

    The chaser's centre of mass is 1 m behind the base link, the joint 0.5 m before it, the link's
    centre of mass 0.3 m beyond; its largest moment of inertia is that about z, 5 kg m2.
    """

    def link(name: str, mass: float, x: float, moments: Sequence[float]) -> str:
        inertia = " ".join(f'i{2 * axis}="{of}"' for axis, of in zip("xyz", moments, strict=True))
        return (
            f'<link name="{name}"><inertial><origin xyz="{x} 0 0"/><mass value="{mass}"/>'
            f'<inertia {inertia} ixy="0" ixz="0" iyz="0"/></inertial></link>'
        )

    bodies = link("chaser", chaser, -1.0, (3.0, 3.0, 3.0)), link("tool", arm, 0.3, (2.0, 4.0, 5.0))
    limit = '<limit lower="-3" upper="3" velocity="9" effort="9"/>'
    joint = (
        '<joint name="joint" type="revolute"><parent link="chaser"/><child link="tool"/>'
        f'<origin xyz="0.5 0 0"/><axis xyz="0 0 1"/>{limit}</joint>'
    )
    text = f'<robot name="swing">{"".join(bodies)}{joint}</robot>'
    return robot_from_urdf_text(text, "chaser", "tool", Base.ATTITUDE_HELD)


@pytest.mark.parametrize(("chaser", "arm"), [(200.0, 5.0), (10.0, 10.0), (2.0, 300.0)])
def test_bounds_of_momentum_are_sums_of_moduli_however_heavy_the_arm(
    chaser: float, arm: float
) -> None:
    """Of spin, each centre of mass and the whole one, by hand; and no posture has more of it."""
    robot, rate = swinging(chaser, arm), 0.7
    largest = np.array([3.0, rate, 0.0, 0.0, 0.0])[:, None, None]
    bounds = angular_momentum_bounds(robot, largest)[:, 0]
    spin, speed, total = 5.0 * rate, 0.3 * rate, chaser + arm
    by_whole = (chaser * 1.0 + arm * 0.8) * arm * speed / total
    assert bounds[0] == pytest.approx(spin + arm * 0.8 * speed + by_whole, rel=1e-12)
    turned = np.linspace(-3.0, 3.0, 61)
    q, v = np.zeros((61, 8)), np.zeros((61, 7))
    q[:, 6], q[:, 7], v[:, 6] = 1.0, turned, rate
    momenta, rates = angular_momenta(robot, q, v, np.zeros((61, 1)))
    apart = chaser * arm / total * speed * (1.5 * np.cos(turned) + 0.3)
    assert momenta[:, 2] == pytest.approx(spin + apart, rel=1e-9)
    assert np.abs(momenta).max() <= bounds[0]
    assert np.abs(rates).max() <= bounds[1]


def loads_of(
    robot: Robot, wheels: Wheels, start: SystemState, motion: FollowedMotion
) -> tuple[Array, Array]:
    """Momenta and torques at the times of a motion, as the check has them."""
    stored = wheel_momenta_of(wheels, start)
    return wheels_along(robot, wheels, stored, motion.q, motion.v, motion.joint_accelerations)


@pytest.mark.law("PLAN-15")
def test_what_is_certain_of_wheels_is_above_all_that_they_ever_hold_and_give(
    times: Callable[[int, int], int],
) -> None:
    """Wherever limits are: below, at or above the peaks, and where there are none."""
    robot = held_robot("six joints", FOUR)
    for seed in range(times(10, 100)):
        motion = driven(robot, seed)
        start = in_own_frame(held_problem("six joints", FOUR)).start
        loads = loads_of(robot, FOUR, start, motion)
        found = np.abs(np.concatenate([peaks_of_steps(one, motion).values for one in loads]))
        every = np.linspace(0.0, 8.0, 8001)
        momenta, rates = momenta_of(robot, motion, every)
        held = loads[0][0] + (momenta[0] - momenta) @ FOUR.shares.T
        truth = np.abs(np.hstack([held, rates @ FOUR.shares.T])).max(axis=0)
        for part in (0.9, 1.0, 1.01, 1.5, np.inf):
            certain = certain_peaks(robot, FOUR, motion, loads, part * found)
            assert (certain >= truth * (1.0 - 1e-12)).all(), (seed, part)
            assert (certain <= np.maximum(part, 1.001) * found).all(), (seed, part)


@pytest.mark.parametrize("most", [0, 300])
def test_what_is_certain_of_wheels_ends_above_all_loads_however_long_it_would_take(
    most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot = held_robot("six joints", FOUR)
    motion, start = driven(robot, 0), in_own_frame(held_problem("six joints", FOUR)).start
    loads = loads_of(robot, FOUR, start, motion)
    found = np.abs(np.concatenate([peaks_of_steps(one, motion).values for one in loads]))
    close = certain_peaks(robot, FOUR, motion, loads, found)
    monkeypatch.setattr(certified_least, "MOST_PIECES", most)
    certain = certain_peaks(robot, FOUR, motion, loads, found)
    assert (certain >= found).all()
    assert (certain > close).any()


@pytest.mark.parametrize("part", [0.8, 1.2])
def test_points_show_whether_a_limit_is_exceeded_in_between(part: float) -> None:
    """Of each wheel alone, with a limit that is a part of its true peak torque."""
    robot, problem = held_robot("six joints", FOUR), in_own_frame(held_problem("six joints", FOUR))
    for seed in range(5):
        motion = driven(robot, seed)
        at = motion.q[:: motion.pieces], motion.v[:: motion.pieces], motion.joints.accelerations
        _, rates = momenta_of(robot, motion, np.linspace(0.0, 8.0, 8001))
        truth = np.abs(rates @ FOUR.shares.T).max(axis=0)
        for wheel in range(4):
            limits = np.full(4, 1e3)
            limits[wheel] = part * truth[wheel]
            weak = replace(robot, wheels=replace(FOUR, torque=tuple(limits.tolist())))
            found = exceeds_at_points(replace(problem, robot=weak), *at)
            assert found is (part < 1.0), (seed, wheel)


def test_a_load_that_exceeds_its_limit_between_the_times_of_the_check_is_refused() -> None:
    """A limit at the peak that the check finds where that is below the true one."""
    robot, seed = held_robot("six joints", FOUR), 0
    while True:
        motion, seed = driven(robot, seed), seed + 1
        start = in_own_frame(held_problem("six joints", FOUR)).start
        _, torques = loads_of(robot, FOUR, start, motion)
        _, rates = momenta_of(robot, motion, np.linspace(0.0, 8.0, 8001))
        given, truth = (
            np.abs(peaks_of_steps(torques, motion).values),
            np.abs(rates @ FOUR.shares.T).max(axis=0),
        )
        missed = truth / given - 1.0
        wheel = int(missed.argmax())
        if missed[wheel] > 2e-4:
            break
    limits = np.full(4, 1e3)
    limits[wheel] = given[wheel]
    weak = replace(robot, wheels=replace(FOUR, torque=tuple(limits.tolist())))
    problem = replace(in_own_frame(held_problem("six joints", FOUR)), robot=weak)
    tracked = SimpleNamespace(problem=problem, followed=motion)
    (found,) = WheelLimits().assess(cast(Samples, tracked)).failures
    assert found.status is Status.LIMIT_VIOLATED
    assert f"wheel {wheel + 1} may exceed its limit of {limits[wheel]:g} N m" in found.finding


def test_between_the_points_nothing_rises_above_the_peaks_that_are_told(
    times: Callable[[int, int], int],
) -> None:
    """The check looks at 98 moments or more; here at 8 times as many, of motions drawn at random.

    What it misses is less than the share of a limit that the search stays away from it.
    """
    for seed in range(times(10, 100)):
        problem = in_own_frame(held_problem("six joints", FOUR))
        family, x = drawn(problem)
        rng = np.random.default_rng(seed)
        motion = family.motion(x + rng.normal(scale=0.3, size=len(x)), 50)
        rates = sensitivity_of(family, motion).acceleration
        time = np.linspace(0.0, 8.0, 50)
        samples = to_trajectory(problem.robot, time, motion.q, motion.v, rates)
        joints = joint_motion(samples)
        begin = problem.robot, motion.q[0], motion.v[0], joints
        coarse = followed(*begin)
        fine = followed(*begin, 8 * coarse.pieces)
        assert problem.robot.wheels is not None
        asked = problem.robot, problem.robot.wheels, problem.start
        for kind in (0, 1):
            told, highest = (
                np.abs(peaks_of_steps(loads_of(*asked, one)[kind], one).values)
                for one in (coarse, fine)
            )
            assert (highest - told <= 1e-3 * highest).all()
