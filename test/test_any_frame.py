"""The same physics in any inertial frame gives the same plan, and the plan comes true there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
import pytest
from robots import CANADARM2_SCENARIO, LEMUR_SCENARIO, ROBOTS, random_state
from scipy.spatial.transform import Rotation

from ff_planner_ros.analysis.drawing.tracking import planned_poses
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import NoPlanFound
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.distance.clearance import arm_points
from ff_planner_ros.planning.motion.joint_motion import joint_motion
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.motion.system_frame import system_frame
from ff_planner_ros.planning.problem.problem import (
    Limits,
    Objective,
    Obstacle,
    PlanningProblem,
    Target,
)
from ff_planner_ros.planning.problem.settings import SearchDepth
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.task.tail import EndBehaviour
from ff_planner_ros.planning.task.task import PlanningTask, perform
from ff_planner_ros.problems.robots import bench_robot
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.ee_at_rest import joint_rates_with_ee_at_rest
from ff_planner_ros.robot.model import Robot, robot_from_urdf_text
from ff_planner_ros.robot.momentum import total_momentum
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.simulation.verification import verify

# What is tested here does not depend on how long the least attitude is looked for.
SETTINGS = replace(load_parameters().planner, search=SearchDepth.QUICK)
LENGTH, ATTITUDE, WEIGHTED = Objective(1.0, 0.0), Objective(0.0, 1.0), Objective(1.0, 5.0)


@dataclass(frozen=True)
class Frame:
    """Another user's: what is at x at a time t from the plan's first point is at R x + s + V t."""

    turn: Rotation
    shift: Array  # [m]
    velocity: Array  # [m/s]

    def place(self, x: Array, t: float | Array) -> Array:
        moved: Array = (
            x @ self.turn.as_matrix().T + self.shift + np.multiply.outer(t, self.velocity)
        )
        return moved

    def vector(self, x: Array) -> Array:
        turned: Array = x @ self.turn.as_matrix().T
        return turned

    def attitude(self, xyzw: Array) -> Array:
        turned: Array = (self.turn * Rotation.from_quat(xyzw)).as_quat()
        return turned

    def state(self, state: SystemState, t: float) -> SystemState:
        velocity = self.vector(state.linear_velocity_chaser_in_inertial) + self.velocity
        return replace(
            state,
            position_chaser_in_inertial=self.place(state.position_chaser_in_inertial, t),
            quaternion_chaser_to_inertial_xyzw=self.attitude(
                state.quaternion_chaser_to_inertial_xyzw
            ),
            linear_velocity_chaser_in_inertial=velocity,
            angular_velocity_chaser_in_inertial=self.vector(
                state.angular_velocity_chaser_in_inertial
            ),
        )

    def problem(self, problem: PlanningProblem, ahead: float = 0.0) -> PlanningProblem:
        """What was measured some time ahead of the first point, and the target at arrival."""
        target = problem.target
        return replace(
            problem,
            start=self.state(problem.start, -ahead),
            target=Target(
                position=self.place(target.position, problem.duration),
                quaternion_xyzw=self.attitude(target.quaternion_xyzw),
                linear_velocity=self.vector(target.linear_velocity) + self.velocity,
                angular_velocity=self.vector(target.angular_velocity),
                linear_acceleration=self.vector(target.linear_acceleration),
                angular_acceleration=self.vector(target.angular_acceleration),
            ),
            obstacles=tuple(
                Obstacle.sphere(
                    sphere.id,
                    self.place(sphere.center, 0.0),
                    sphere.radius,
                    self.vector(sphere.motion.velocity) + self.velocity,
                )
                for sphere in problem.obstacles
            ),
        )


def frame(seed: int, shift: float = 0.0, speed: float = 0.0, turned: bool = True) -> Frame:
    """A frame as far away [m] and as fast [m/s] as said, in a random direction."""
    rng = np.random.default_rng(seed)
    turn = Rotation.from_quat(rng.normal(size=4)) if turned else Rotation.identity()
    directions = rng.normal(size=(2, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return Frame(turn, shift * directions[0], speed * directions[1])


FRAMES = {
    "turned": frame(1),
    "at 1 m/s": frame(2, speed=1.0, turned=False),
    "at 2 m/s": frame(3, speed=2.0),
    "7000 km away": frame(4, shift=7e6),
    "in orbit": frame(5, shift=7e6, speed=8e3),
}


def off_centre_arm() -> PlanningProblem:
    """A robot whose chaser's centre of mass, axes and joints lie nowhere in particular."""
    robot = robot_from_urdf_text(*ROBOTS["nine joints"])
    return drawn_problem(robot, seed=4)


def drawn_problem(robot: Robot, seed: int) -> PlanningProblem:
    """A tumbling, drifting chaser, its end effector at rest, and a goal half a metre away."""
    rng = np.random.default_rng(seed)
    quaternion = rng.normal(size=4)
    start = SystemState(
        position_chaser_in_inertial=rng.normal(size=3),
        quaternion_chaser_to_inertial_xyzw=quaternion / np.linalg.norm(quaternion),
        linear_velocity_chaser_in_inertial=rng.normal(scale=0.02, size=3),
        angular_velocity_chaser_in_inertial=rng.normal(scale=0.01, size=3),
        joint_positions=rng.uniform(-1.0, 1.0, robot.joints)
        + (robot.lower_position_limits + robot.upper_position_limits) / 2,
        joint_velocities=np.zeros(robot.joints),
    )
    start = replace(start, joint_velocities=joint_rates_with_ee_at_rest(robot, start))
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, configuration(robot, start)[0])
    tip = pin.updateFramePlacement(robot.model, data, robot.tip_frame_id)
    way, turn = (scale * rng.normal(size=3) for scale in (0.15, 0.2))
    target = Target(
        position=tip.translation + way,
        quaternion_xyzw=pin.Quaternion(tip.rotation @ pin.exp3(turn)).coeffs(),
        angular_velocity=np.array([0.0, 0.01, 0.0]),
    )
    beside = tip.translation + way / 2 + 0.25 * np.cross(way, [0.3, 1.0, 0.2]) / 0.15
    obstacle = Obstacle.sphere("drifting", beside, 0.05, np.array([0.01, 0.0, -0.01]))
    return PlanningProblem(robot, start, target, 12.0, 30, (obstacle,), LENGTH)


PROBLEMS: dict[str, Callable[[], PlanningProblem]] = {
    "lemur": lambda: load_scenario(LEMUR_SCENARIO),
    "six joints": lambda: drawn_problem(bench_robot("arm6"), seed=10),
    "canadarm2": lambda: load_scenario(CANADARM2_SCENARIO),
    "off centre": off_centre_arm,
}


def require_same(here: Plan, there: Plan, frame: Frame, robot: Robot) -> None:
    """The same joints, the same motion as the other user sees it, and one that comes true."""
    one, other = here.trajectory, there.trajectory
    off = np.abs(other.joint_positions - one.joint_positions).max()
    assert off <= 1e-6, f"joints off by {off:.1e} rad"
    for name in ("joint_velocities", "joint_accelerations", "joint_torques"):
        expected = getattr(one, name)
        np.testing.assert_allclose(
            getattr(other, name), expected, rtol=1e-5, atol=1e-5 * np.abs(expected).max()
        )
    for part in ("chaser", "ee"):
        x, q, v, w = (
            getattr(one, f"{part}_{name}")
            for name in ("positions", "quaternions_xyzw", "linear_velocities", "angular_velocities")
        )
        there_x = getattr(other, f"{part}_positions")
        expected = x @ frame.turn.as_matrix().T
        seen = (there_x - frame.shift) - np.outer(one.time, frame.velocity)
        np.testing.assert_allclose(seen, expected, rtol=0.0, atol=2e-6)
        there_q = getattr(other, f"{part}_quaternions_xyzw")
        turn = Rotation.from_quat(frame.attitude(q)).inv() * Rotation.from_quat(there_q)
        assert turn.magnitude().max() < 2e-6
        there_v = getattr(other, f"{part}_linear_velocities")
        np.testing.assert_allclose(there_v, frame.vector(v) + frame.velocity, rtol=0.0, atol=2e-6)
        there_w = getattr(other, f"{part}_angular_velocities")
        np.testing.assert_allclose(there_w, frame.vector(w), rtol=0.0, atol=2e-6)
    for name in ("joint_path_length", "max_chaser_euler", "min_clearance"):
        assert getattr(there.metrics, name) == pytest.approx(getattr(here.metrics, name), abs=1e-5)
    found = verify(robot, other)
    assert found.passed, found.deviation


@pytest.mark.law("PLAN-24")
@pytest.mark.parametrize(
    "name", ["lemur", "six joints", "off centre", pytest.param("canadarm2", marks=pytest.mark.ci)]
)
def test_a_plan_does_not_depend_on_the_frame(name: str) -> None:
    problem = replace(PROBLEMS[name](), objective=LENGTH)
    here = perform(PlanningTask(problem, SETTINGS))
    for label, seen in FRAMES.items():
        there = perform(PlanningTask(seen.problem(problem), SETTINGS))
        try:
            require_same(here, there, seen, problem.robot)
        except AssertionError as failed:
            pytest.fail(f"{name}, frame {label}: {failed}")


@pytest.mark.ci
@pytest.mark.sampled
@pytest.mark.parametrize(
    ("name", "objective"),
    [
        ("lemur", ATTITUDE),
        ("canadarm2", ATTITUDE),
        ("six joints", WEIGHTED),
        ("off centre", WEIGHTED),
    ],
)
def test_neither_does_one_of_another_objective_carried_ahead_with_a_tail(
    name: str, objective: Objective
) -> None:
    problem = replace(PROBLEMS[name](), objective=objective, points=80)
    task = PlanningTask(
        problem, SETTINGS, ahead=0.4, end_behaviour=EndBehaviour.STOP_JOINTS, tail=4.0
    )
    here = perform(task)
    assert here.trajectory.time[-1] == pytest.approx(problem.duration + 4.0)
    seen = FRAMES["in orbit"]
    there = perform(replace(task, problem=seen.problem(problem, ahead=0.4)))
    require_same(here, there, seen, problem.robot)


@pytest.mark.parametrize("speed", [1.0, 2.0])
def test_the_arm_avoids_what_passes_by(lemur_capture: PlanningProblem, speed: float) -> None:
    """It rests for a user to whom the system moves; the arm that does not know it is hit."""
    seen = frame(6, speed=speed)
    free = seen.problem(replace(lemur_capture, objective=LENGTH, obstacles=()))
    ignorant = perform(PlanningTask(free, SETTINGS))
    problem = replace(
        free, obstacles=(Obstacle.sphere("bolt", ignorant.trajectory.ee_positions[25], 0.1),)
    )
    assert dense_clearance(problem, ignorant) < -0.05
    plan = perform(PlanningTask(problem, SETTINGS))
    assert dense_clearance(problem, plan) >= plan.metrics.min_clearance - 1e-5 >= 0.0
    found = verify(problem.robot, plan.trajectory)
    assert found.passed, found.deviation


def dense_clearance(problem: PlanningProblem, plan: Plan) -> float:
    """The least distance of the arm from the spheres at 2000 times, the formula written out."""
    motion, robot = plan.trajectory, problem.robot
    time = np.linspace(0.0, problem.duration, 2000)
    positions, attitudes = planned_poses(motion, "chaser", time)
    joints, rates, _ = joint_motion(motion).at(time)
    still = np.zeros(3)
    states = zip(positions, attitudes, joints, rates, strict=True)
    q = [configuration(robot, SystemState(x, o, still, still, *j))[0] for x, o, *j in states]
    points = arm_points(robot, np.array(q))
    gaps = []
    for sphere in problem.obstacles:
        center = sphere.center + np.outer(time, sphere.motion.velocity)
        for a, b in zip(points[:, :-1].swapaxes(0, 1), points[:, 1:].swapaxes(0, 1), strict=True):
            along = b - a
            square = np.maximum((along**2).sum(axis=1), 1e-12)
            share = np.clip(((center - a) * along).sum(axis=1) / square, 0.0, 1.0)
            nearest = a + share[:, None] * along
            gaps.append(np.linalg.norm(nearest - center, axis=1).min() - sphere.radius)
    return float(min(gaps))


def test_a_sphere_in_the_goal_at_arrival_is_refused_wherever_it_is_now(
    lemur_capture: PlanningProblem,
) -> None:
    velocity = np.array([0.3, -0.2, 0.1])
    target = lemur_capture.target.position
    arriving = Obstacle.sphere("bolt", target - lemur_capture.duration * velocity, 0.05, velocity)
    problem = replace(lemur_capture, obstacles=(arriving,))
    with pytest.raises(NoPlanFound, match="inside obstacle bolt"):
        perform(PlanningTask(problem, SETTINGS))


def test_the_attempt_of_a_refusal_is_in_the_user_s_frame(lemur_capture: PlanningProblem) -> None:
    tight = replace(lemur_capture, limits=Limits(chaser_attitude=0.01), points=13)
    quick = replace(SETTINGS, starts=1)
    for seen in (FRAMES["turned"], FRAMES["in orbit"]):
        problem = seen.problem(tight)
        with pytest.raises(NoPlanFound) as refused:
            perform(PlanningTask(problem, quick))
        attempt = refused.value.attempt
        assert isinstance(attempt, Plan)
        first, start = attempt.trajectory, problem.start
        for name, expected in (
            ("chaser_positions", start.position_chaser_in_inertial),
            ("chaser_quaternions_xyzw", start.quaternion_chaser_to_inertial_xyzw),
            ("chaser_linear_velocities", start.linear_velocity_chaser_in_inertial),
            ("chaser_angular_velocities", start.angular_velocity_chaser_in_inertial),
        ):
            np.testing.assert_allclose(getattr(first, name)[0], expected, rtol=0.0, atol=1e-8)


def test_in_its_own_frame_a_system_has_no_momentum_and_no_attitude(robot: Robot) -> None:
    """Also where its numbers in the user's frame have lost nine digits."""
    rng = np.random.default_rng(3)
    model, data = robot.model, robot.model.createData()
    own = random_state(robot, rng)
    for seen in FRAMES.values():
        state = seen.state(own, 0.0)
        at_home = system_frame(robot, state).start
        q, v = configuration(robot, at_home)
        pin.centerOfMass(model, data, q, v)
        size = 1e-15 * np.linalg.norm(state.position_chaser_in_inertial) + 1e-13
        speed = 1e-15 * np.linalg.norm(state.linear_velocity_chaser_in_inertial) + 1e-13
        assert np.abs(data.com[0]).max() < size
        assert np.abs(data.vcom[0]).max() < speed
        np.testing.assert_allclose(
            at_home.quaternion_chaser_to_inertial_xyzw, [0.0, 0.0, 0.0, 1.0], atol=1e-15
        )
        angular = total_momentum(robot, data, q, v)[3:]
        expected = (
            spin(robot, own)
            @ Rotation.from_quat(own.quaternion_chaser_to_inertial_xyzw).as_matrix()
        )
        np.testing.assert_allclose(angular, expected, rtol=0.0, atol=1e-9 * np.abs(expected).max())


def spin(robot: Robot, state: SystemState) -> Array:
    """Angular momentum about the centre of mass, as Pinocchio has it."""
    q, v = configuration(robot, state)
    data = robot.model.createData()
    return np.array(pin.computeCentroidalMomentum(robot.model, data, q, v).angular)
