"""The wrench through the grasp of a payload, against Newton and Euler and finite differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from reference_dynamics import frame_wrenches_by_x
from robots import CONFIG, random_state, random_urdf

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import InvalidInput, NoPlanFound, Status
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.joint_motion import joint_motion
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.dynamics import accelerations, frame_wrenches
from ff_planner_ros.robot.model import Base, Robot, robot_from_urdf_text
from ff_planner_ros.robot.urdf.payload import Payload, payload_frame, with_payload

SETTINGS = load_parameters().planner
INERTIA = np.array([[3.0, 0.2, -0.1], [0.2, 2.5, 0.3], [-0.1, 0.3, 2.0]])
PAYLOAD = Payload("tool", 30.0, INERTIA, np.array([0.1, -0.03, 0.24]))
SLOW = 1e-6  # step of finite differences


def holding(seed: int, base: Base = Base.FREE_FLYER) -> tuple[Robot, int]:
    bare = robot_from_urdf_text(random_urdf(5, seed, sliding=(2,)), "bus", "tool", base)
    robot = with_payload(bare, PAYLOAD)
    frame = payload_frame(robot)
    assert payload_frame(bare) is None
    assert frame is not None
    return robot, frame


def sample(robot: Robot, seed: int) -> tuple[Array, Array, Array]:
    rng = np.random.default_rng(seed)
    state = random_state(robot, rng)
    if robot.base is Base.ATTITUDE_HELD:
        state = replace(state, angular_velocity_chaser_in_inertial=np.zeros(3))
    q, v = configuration(robot, state)
    return q[None], v[None], rng.normal(size=(1, robot.joints))


@pytest.mark.law("PLAN-19")
@pytest.mark.parametrize("seed", range(6))
def test_it_is_what_moves_the_body_by_newton_and_euler(seed: int) -> None:
    """Force m a of the centre of mass, torque d(spin)/dt plus arm times force: by differences."""
    robot, frame = holding(seed)
    q, v, rates = sample(robot, seed)
    moved = accelerations(robot, q, v, rates)[0]

    def body(time: float) -> tuple[Array, Array, pin.SE3]:
        """Momentum and spin of the body alone in inertial axes, and the frame's placement."""
        model, data = robot.model, robot.model.createData()
        there = pin.integrate(model, q[0], time * v[0] + time**2 / 2.0 * moved)
        pin.forwardKinematics(model, data, there, v[0] + time * moved)
        place = pin.updateFramePlacement(model, data, frame)
        twist = pin.getFrameVelocity(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
        arm = place.rotation @ PAYLOAD.center_of_mass
        linear = PAYLOAD.mass * (twist.linear + np.cross(twist.angular, arm))
        spin = place.rotation @ INERTIA @ place.rotation.T @ twist.angular
        return linear, spin, place.copy()

    (ahead, spin_ahead, _), (behind, spin_behind, _) = body(1e-5), body(-1e-5)
    _, _, place = body(0.0)
    force = (ahead - behind) / 2e-5
    arm = place.rotation @ PAYLOAD.center_of_mass
    torque = (spin_ahead - spin_behind) / 2e-5 + np.cross(arm, force)
    expected = np.array([force, torque]) @ place.rotation
    found = frame_wrenches(robot, frame, q, v, rates)[0]
    np.testing.assert_allclose(found, expected.ravel(), rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("base", [Base.FREE_FLYER, Base.ATTITUDE_HELD])
@pytest.mark.parametrize("seed", range(4))
def test_its_derivatives_are_exact(seed: int, base: Base) -> None:
    robot, frame = holding(seed, base)
    q, v, rates = sample(robot, seed)
    rng, size = np.random.default_rng(seed + 50), robot.model.nv
    q_by, v_by = rng.normal(size=(2, 1, size, 3))
    if base is Base.ATTITUDE_HELD:
        q_by[:, 3:6], v_by[:, 3:6] = 0.0, 0.0
    rates_by = rng.normal(size=(1, robot.joints, 3))
    found = frame_wrenches_by_x(robot, frame, q, v, rates, q_by, v_by, rates_by)

    def there(step: Array) -> Array:
        moved = pin.integrate(robot.model, q[0], q_by[0] @ step)
        return frame_wrenches(robot, frame, moved[None], v + v_by @ step, rates + rates_by @ step)[
            0
        ]

    for column, way in enumerate(np.eye(3)):
        slope = (there(SLOW * way) - there(-SLOW * way)) / (2.0 * SLOW)
        np.testing.assert_allclose(found[0, :, column], slope, rtol=1e-5, atol=1e-5)


@pytest.fixture(scope="module")
def stop() -> PlanningProblem:
    problem = load_scenario(CONFIG / "scenarios/lemur_payload.yaml")
    return replace(problem, duration=10.0, duration_range=None)


@pytest.fixture(scope="module")
def free(stop: PlanningProblem) -> Plan:
    return perform(PlanningTask(stop, SETTINGS))


def peaks_by_hand(problem: PlanningProblem, plan: Plan) -> Array:
    """Largest force and torque on a fine grid, by the motion of the plan's own quintics."""
    robot, frame = problem.robot, payload_frame(problem.robot)
    assert frame is not None
    time = np.linspace(0.0, plan.trajectory.time[-1], 2001)
    positions, rates, faster = joint_motion(plan.trajectory).at(time)
    # Forces do not depend on where the chaser is, and on how it moves by the momentum alone.
    from ff_planner_ros.planning.motion.forward import driven
    from ff_planner_ros.planning.motion.motion import from_trajectory
    from ff_planner_ros.robot.momentum import total_momentum

    q, v = from_trajectory(robot, plan.trajectory)
    momentum = total_momentum(robot, robot.model.createData(), q[0], v[0])
    moved, twists, _ = driven(robot, q[0], momentum, joint_motion(plan.trajectory), time)
    np.testing.assert_allclose(moved[:, 7:], positions, atol=1e-12)
    np.testing.assert_allclose(twists[:, 6:], rates, atol=1e-12)
    wrenches = frame_wrenches(robot, frame, moved, twists, faster).reshape(-1, 2, 3)
    peaks: Array = np.linalg.norm(wrenches, axis=2).max(axis=0)
    return peaks


@pytest.mark.law("PLAN-19")
@pytest.mark.parametrize("kept", ["grasp_force", "grasp_torque"])
def test_a_plan_keeps_a_limit_that_it_would_break(
    kept: str, stop: PlanningProblem, free: Plan
) -> None:
    before = peaks_by_hand(stop, free)
    told = free.metrics.peak_grasp_force, free.metrics.peak_grasp_torque
    np.testing.assert_allclose(told, before, rtol=5e-4)
    limit = 0.9 * float(before[int(kept == "grasp_torque")])
    problem = replace(stop, limits=replace(stop.limits, **{kept: limit}))
    plan = perform(PlanningTask(problem, SETTINGS))
    assert peaks_by_hand(problem, plan)[int(kept == "grasp_torque")] <= limit * (1.0 + 5e-4)


def test_a_limit_that_no_plan_keeps_is_named(stop: PlanningProblem) -> None:
    problem = replace(stop, limits=replace(stop.limits, grasp_force=1e-3))
    with pytest.raises(NoPlanFound, match=r"peak_grasp_force is .* N, .* N beyond limits") as no:
        perform(PlanningTask(problem, SETTINGS))
    assert no.value.status is Status.LIMIT_VIOLATED


def test_a_start_that_takes_too_much_is_refused(stop: PlanningProblem) -> None:
    start = replace(stop.start, joint_accelerations=np.full(7, 0.02))
    problem = replace(stop, start=start, limits=replace(stop.limits, grasp_torque=0.01))
    with pytest.raises(InvalidInput, match=r"beyond limits.grasp_torque of 0.01 N m") as refused:
        perform(PlanningTask(problem, SETTINGS))
    assert refused.value.field == "joints.acceleration"
    assert refused.value.status is Status.START_OUTSIDE_LIMITS


@pytest.mark.parametrize("kind", [0, 1])
@pytest.mark.parametrize("share", [0.9995, 1.0, 1.00009])
def test_a_start_that_takes_all_that_is_allowed_is_planned_from(
    stop: PlanningProblem, kind: int, share: float
) -> None:
    start = replace(stop.start, joint_accelerations=-0.25 * stop.start.joint_velocities)
    q, v = configuration(stop.robot, start)
    frame = payload_frame(stop.robot)
    assert frame is not None
    wrench = frame_wrenches(stop.robot, frame, q[None], v[None], start.joint_accelerations[None])
    limit = float(np.linalg.norm(wrench.reshape(2, 3)[kind])) / share
    kept = ("grasp_force", "grasp_torque")[kind]
    problem = replace(stop, start=start, limits=replace(stop.limits, **{kept: limit}))
    plan = perform(PlanningTask(problem, SETTINGS))
    assert peaks_by_hand(problem, plan)[kind] <= limit * (1.0 + 1e-4)
