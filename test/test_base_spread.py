"""Momentum and motion are right where inertias and start rates are not as modelled."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin
import pytest
import robots
from handmade_plans import made, resting
from scipy.spatial.transform import Rotation

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.motion.motion import state_at, to_trajectory
from ff_planner_ros.planning.motion.plan import Plan, Trajectory
from ff_planner_ros.planning.problem.problem import Limits, PlanningProblem
from ff_planner_ros.planning.problem.scene import Scene
from ff_planner_ros.planning.problem.uncertainty import Draws, Uncertainty, directions, draws
from ff_planner_ros.planning.robust.base_spread import (
    TrackedMotion,
    base_spread,
    torques_by_errors,
    tracked_motion,
)
from ff_planner_ros.planning.robust.margins import (
    ATTITUDE,
    ROTATION,
    margins,
    rotated_since_start,
    turned_from_start,
)
from ff_planner_ros.planning.robust.nearness import nearness
from ff_planner_ros.planning.scenario.scenario import load_scenario
from ff_planner_ros.planning.search.planner import plan
from ff_planner_ros.robot.dynamics import accelerations
from ff_planner_ros.robot.model import Robot, robot_from_urdf_text
from ff_planner_ros.robot.momentum import inertial_parameters, momentum_regressors, total_momentum
from ff_planner_ros.simulation.engine import Engine
from ff_planner_ros.simulation.execution import execute
from ff_planner_ros.simulation.feed_forward import feed_forward
from ff_planner_ros.simulation.tracked_runs import run_torques, tracked_runs

# Everything that can be wrong, and more of it than is usual.
WRONG = Uncertainty(
    mass=0.05, inertia=0.05, center_of_mass=0.005, linear_velocity=1e-3, angular_velocity=1e-3
)
PLANAR = robots.CONFIG / "scenarios/planar_capture.yaml"


class Tracked(NamedTuple):
    """A motion that a controller tracks, and the plan that it is of."""

    motion: TrackedMotion
    plan: Trajectory


@pytest.fixture(scope="module", params=["lemur", "planar", "turned"])
def tracked(
    request: pytest.FixtureRequest, lemur_capture: PlanningProblem, lemur_plan: Plan
) -> Tracked:
    """A plan of a free chaser that tumbles, one on a table, and one of a robot that is turned.

    In any attitude at the start, off the origin and drifting; the chaser's axes and its centre of
    mass are not those of the base.
    """
    robot, planned = lemur_capture.robot, lemur_plan.trajectory
    if request.param == "planar":
        problem = load_scenario(PLANAR)
        robot = problem.robot
        planned = plan(problem, load_parameters().planner).trajectory
    elif request.param == "turned":
        robot = robot_from_urdf_text(robots.random_urdf(4, 1), "bus", "tool")
        rng = np.random.default_rng(2)
        still = resting(rng.uniform(-1.0, 1.0, 4))
        swung = still.bulging(0, 2, 0.005).stepping(2, 3, 0.01).swelling(3, 8, 0.005)
        place, turned = np.array([3.0, -2.0, 5.0]), Rotation.from_rotvec([0.4, 2.0, -1.0])
        twist = np.array([0.3, -0.1, 0.2, 0.05, -0.04, 0.06])
        planned = made(robot, swung, twist, place, turned).plan.trajectory
    return Tracked(tracked_motion(robot, planned), planned)


@pytest.fixture(scope="module")
def motion(tracked: Tracked) -> TrackedMotion:
    return tracked.motion


def along_each_error(motion: TrackedMotion, step: float) -> Draws:
    """Systems a step to either side of the model, along each error."""
    of = directions(motion.robot, WRONG)
    count = of.parameters.shape[1]
    errors = step * np.concatenate([np.eye(count), -np.eye(count)])
    blank = draws(motion.robot, WRONG, range(len(errors)), 0)
    return blank._replace(
        errors=errors,
        parameters=inertial_parameters(motion.robot) + errors @ of.parameters.T,
        base_twist=errors @ of.base_twist.T,
    )


def difference(values: Array, step: float, axis: int) -> Array:
    """Return the central difference of runs along each error."""
    plus, minus = np.split(values, 2, axis=axis)
    return (plus - minus) / (2 * step)


def test_momentum_is_linear_in_the_inertial_parameters() -> None:
    """Against the mass matrix, of a robot whose bodies lie in every direction."""
    robot = robot_from_urdf_text(robots.random_urdf(4, 1), "bus", "tool")
    rng, data = np.random.default_rng(0), robot.model.createData()
    positions, rates = rng.normal(size=(2, 3, robot.joints))
    regressors = momentum_regressors(robot, positions, rates)
    for angles, speeds, regressor in zip(positions, rates, regressors, strict=True):
        q = np.concatenate([pin.neutral(robot.model)[:7], angles])
        twist = rng.normal(size=6)
        expected = pin.crba(robot.model, data, q)[:6] @ np.concatenate([twist, speeds])
        found = np.einsum("k,kin->in", [*twist, 1.0], regressor) @ inertial_parameters(robot)
        assert found == pytest.approx(expected, rel=1e-12, abs=1e-11)


def test_a_system_as_modelled_does_what_the_plan_says(motion: TrackedMotion) -> None:
    nothing = replace(WRONG, **dict.fromkeys(vars(WRONG), 0.0))
    exact = tracked_runs(motion, draws(motion.robot, nothing, range(1), 0))
    turns = Rotation.from_quat(motion.q[:, 3:7]).as_matrix()
    assert exact.positions[:, 0] == pytest.approx(motion.q[:, :3], abs=1e-7)
    assert exact.rotations[:, 0] == pytest.approx(turns, abs=1e-6)
    assert exact.twists[:, 0] == pytest.approx(motion.half_v[::2, :6], abs=1e-7)


def test_the_frame_of_the_motion_moves_with_the_system_s_centre_of_mass(tracked: Tracked) -> None:
    """Where the plan has the chaser, and in which attitude, seen from there and without a turn."""
    motion, planned = tracked
    q, robot = motion.q[motion.at_points], motion.robot
    turned = Rotation.from_quat(q[:, 3:7])
    origin = motion.origin + planned.time[:, None] * motion.velocity
    chaser = origin + q[:, :3] + turned.apply(np.array(robot.position_chaser_in_base))
    assert chaser == pytest.approx(planned.chaser_positions, abs=1e-5)
    attitudes = turned * Rotation.from_matrix(np.array(robot.rotation_chaser_to_base))
    off = attitudes.inv() * Rotation.from_quat(planned.chaser_quaternions_xyzw)
    assert off.magnitude().max() < 1e-5
    data = robot.model.createData()
    centers = [pin.centerOfMass(robot.model, data, at).copy() for at in q]
    assert np.abs(centers)[:, [row for row in robot.base.rows if row < 3]].max() < 1e-9


def test_margins_of_the_chasers_turn_are_those_since_its_first_attitude(
    motion: TrackedMotion,
) -> None:
    """And change as the finite differences of runs, by scipy's rotations."""
    step, of = 1e-3, directions(motion.robot, WRONG)
    limits = Limits(chaser_attitude=3.0, chaser_rotation=3.0)
    spread, nowhere = base_spread(motion, of), Scene()
    near = nearness(motion.robot, motion.q, motion.time, nowhere)
    told = {one.kind: one for one in margins(motion, nowhere, near, limits, of, spread)}
    runs = tracked_runs(motion, along_each_error(motion, step))
    to_base = motion.robot.rotation_chaser_to_base
    first = Rotation.from_quat(motion.q[0, 3:7]).as_matrix() @ to_base

    def since(rotations: Array) -> tuple[Array, Array]:
        """Euler angles, then the angle, of base attitudes. Shapes (..., 3) and (...)."""
        turned = Rotation.from_matrix((first.T @ rotations @ to_base).reshape(-1, 3, 3))
        shape = rotations.shape[:-2]
        euler = turned.as_euler("xyz").reshape(*shape, 3)
        return euler, turned.magnitude().reshape(shape)

    planned = since(Rotation.from_quat(motion.q[:, 3:7]).as_matrix())
    euler, angles = since(runs.rotations)
    assert turned_from_start(motion, runs.rotations) == pytest.approx(euler, abs=1e-9)
    assert rotated_since_start(motion, runs.rotations) == pytest.approx(angles, abs=1e-7)
    found, count = told[ATTITUDE], len(motion.time)
    assert found.values.reshape(2, count, 3) == pytest.approx(
        np.stack([3.0 - planned[0], 3.0 + planned[0]]), abs=1e-9
    )
    expected = np.moveaxis(difference(euler, step, axis=1), 1, -1)
    by_errors = found.by_errors.reshape(2, count, 3, -1)
    scale = np.abs(expected).max()
    assert by_errors[1] == pytest.approx(expected, abs=1e-4 * scale)
    assert by_errors[0] == pytest.approx(-expected, abs=1e-4 * scale)
    found = told[ROTATION]
    assert found.values == pytest.approx(3.0 - planned[1], abs=1e-7)
    # At the start there is no axis; near to it runs turn to all sides.
    turns = planned[1] > 0.05 * planned[1].max()
    expected = np.moveaxis(difference(angles, step, axis=1), 1, -1)[turns]
    assert -found.by_errors[turns] == pytest.approx(expected, abs=1e-3 * np.abs(expected).max())


def test_small_motions_of_the_base_are_the_finite_differences_of_runs(
    motion: TrackedMotion,
) -> None:
    step, spread = 1e-3, base_spread(motion, directions(motion.robot, WRONG))
    runs = tracked_runs(motion, along_each_error(motion, step))
    places = difference(runs.positions, step, axis=1).swapaxes(1, 2)
    linear, angular = np.split(spread.pose, 2, axis=1)
    moved = linear + np.cross(angular, motion.q[:, :3, None], axis=1)
    assert moved == pytest.approx(places, abs=1e-5 * np.abs(places).max())
    turned = difference(runs.rotations, step, axis=1) @ np.swapaxes(
        Rotation.from_quat(motion.q[:, 3:7]).as_matrix()[:, None], -1, -2
    )
    turns = np.stack([turned[..., 2, 1], turned[..., 0, 2], turned[..., 1, 0]], axis=1)
    assert angular == pytest.approx(turns, abs=1e-5 * np.abs(turns).max())
    twists = difference(runs.twists, step, axis=1).swapaxes(1, 2)
    assert spread.twist == pytest.approx(twists, abs=1e-5 * np.abs(twists).max())


def test_torques_change_as_the_finite_differences_of_runs(motion: TrackedMotion) -> None:
    step, of = 1e-3, directions(motion.robot, WRONG)
    drawn = along_each_error(motion, step)
    needed = run_torques(motion, drawn, tracked_runs(motion, drawn))
    torques, by_errors = torques_by_errors(motion, of, base_spread(motion, of))
    expected = np.moveaxis(difference(needed, step, axis=0), 0, -1)
    assert by_errors == pytest.approx(expected, abs=1e-5 * np.abs(expected).max())
    assert torques == pytest.approx(needed.mean(axis=0), abs=1e-4 * np.abs(torques).max())


def true_system(robot: Robot, parameters: Array) -> Robot:
    """Return a robot with a run's inertias."""
    model = robot.model.copy()
    for body, ten in enumerate(parameters.reshape(-1, 10)):
        model.inertias[body + 1] = pin.Inertia.FromDynamicParameters(ten)
    return replace(robot, model=model)


def test_every_run_keeps_its_own_momentum(motion: TrackedMotion) -> None:
    drawn = draws(motion.robot, WRONG, range(3), 5)
    runs, rows = tracked_runs(motion, drawn), motion.robot.base.rows
    for k, parameters in enumerate(drawn.parameters):
        system = true_system(motion.robot, parameters)
        data = system.model.createData()
        momenta = []
        for i, q in enumerate(motion.q):
            attitude = Rotation.from_matrix(runs.rotations[i, k]).as_quat()
            there = np.concatenate([runs.positions[i, k], attitude, q[7:]])
            v = np.concatenate([runs.twists[i, k], motion.half_v[2 * i, 6:]])
            momenta.append(total_momentum(system, data, there, v)[rows])
        assert np.ptp(momenta, axis=0).max() < 1e-9 * np.abs(drawn.parameters).max()


def test_a_run_comes_true_in_another_engine_with_its_masses(
    lemur_capture: PlanningProblem, lemur_plan: Plan
) -> None:
    """MuJoCo reads the URDF by itself, gets the factors, and the torques of the run."""
    robot = lemur_capture.robot
    motion = tracked_motion(robot, lemur_plan.trajectory)
    wrong = Uncertainty(mass=0.1, inertia=0.1, linear_velocity=1e-3, angular_velocity=1e-3)
    drawn = draws(robot, wrong, range(1), 3)
    runs, at = tracked_runs(motion, drawn), motion.at_points
    system = true_system(robot, drawn.parameters[0])
    turns = Rotation.from_matrix(runs.rotations[at, 0]).as_quat()
    q = np.hstack([runs.positions[at, 0], turns, motion.q[at, 7:]])
    v = np.hstack([runs.twists[at, 0], motion.half_v[::2][at, 6:]])
    rates = motion.joints.accelerations
    executed = to_trajectory(system, motion.joints.time, q, v, accelerations(system, q, v, rates))
    engine = Engine(robot)
    links = [engine.chaser_bodies, *(engine.links_moved_by(name) for name in robot.joint_names)]
    for body, numbers in enumerate(links):
        factors = drawn.masses[0, body], drawn.inertias[0, body]
        engine.scale_inertias(numbers, *(np.full(len(numbers), one) for one in factors))
    assert engine.mass != pytest.approx(Engine(robot).mass, rel=1e-3)
    done = execute(engine, state_at(executed, 0), feed_forward(system, executed, 8))
    assert done.ee_positions == pytest.approx(executed.ee_positions, abs=1e-5)
    assert done.chaser_positions == pytest.approx(executed.chaser_positions, abs=1e-5)


def test_what_a_run_draws_depends_on_the_seed_and_its_number_alone(motion: TrackedMotion) -> None:
    many = draws(motion.robot, WRONG, range(7), 4)
    alone = draws(motion.robot, WRONG, range(5, 6), 4)
    other = draws(motion.robot, WRONG, range(5, 6), 5)
    for name in Draws._fields:
        assert np.array_equal(getattr(many, name)[5:6], getattr(alone, name))
    assert not np.array_equal(alone.errors, other.errors)
    together, single = tracked_runs(motion, many), tracked_runs(motion, alone)
    assert together.positions[:, 5] == pytest.approx(single.positions[:, 0], abs=1e-14)


def test_every_body_that_is_drawn_can_be_one(lemur: Robot) -> None:
    """Masses are positive, and no principal moment is larger than the other two together."""
    wide = Uncertainty(mass=1.0, inertia=1.0, center_of_mass=0.1)
    drawn = draws(lemur, wide, range(50), 1)
    for ten in drawn.parameters.reshape(-1, 10):
        body = pin.Inertia.FromDynamicParameters(ten)
        moments = np.linalg.eigvalsh(body.inertia)
        assert body.mass > 0.0
        assert moments[0] > 0.0
        assert moments[2] <= (moments[0] + moments[1]) * (1.0 + 1e-9)


def test_draws_have_the_deviations_that_were_asked_for(lemur: Robot) -> None:
    drawn = draws(lemur, Uncertainty(mass=0.02, inertia=0.03, friction=0.1), range(600), 1)
    assert np.log(drawn.masses).std() == pytest.approx(0.02, rel=0.05)
    assert np.log(drawn.inertias).std() == pytest.approx(0.03, rel=0.05)
    assert np.sqrt(np.mean(drawn.friction**2)) == pytest.approx(0.1, rel=0.05)
    assert drawn.base_twist[:, 3:].std() == pytest.approx(np.deg2rad(0.01), rel=0.08)
