"""Monte Carlo of a plan that is executed open loop by its torques, in MuJoCo, run by run.

Without feedback the joints deviate from the plan, too. Links that are fixed to each other share
the factors of mass and inertia. There are no first-order predictions.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from ff_planner_ros.common.arrays import Array, Indices
from ff_planner_ros.errors import InvalidInput, Status
from ff_planner_ros.planning.motion.motion import from_trajectory, state_at
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.planning.motion.sound_samples import require_sound_samples
from ff_planner_ros.planning.problem.scene import Scene
from ff_planner_ros.planning.problem.uncertainty import Uncertainty, draws
from ff_planner_ros.planning.robust.margins import CLEARANCE
from ff_planner_ros.planning.robust.nearness import nearness
from ff_planner_ros.robot.configuration import about
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.simulation.deviation import deviation
from ff_planner_ros.simulation.engine import Engine
from ff_planner_ros.simulation.execution import Execution, execute
from ff_planner_ros.simulation.feed_forward import feed_forward
from ff_planner_ros.simulation.monte_carlo import (
    JOINTS,
    TORQUES,
    UNITS,
    Compared,
    MonteCarlo,
    distribution,
    require_runs,
    violations,
)
from ff_planner_ros.simulation.verification import beside_center_of_mass, steps_per_point


def torque_monte_carlo(
    robot: Robot,
    trajectory: Trajectory,
    scene: Scene,
    uncertainty: Uncertainty,
    total: int,
    seed: int = 0,
) -> MonteCarlo:
    """Execute a plan in `total` runs by its torques alone, each by another random system.

    Distances and joint positions are checked at the plan's points. A run that diverges counts as
    one that violates everything.

    Args:
        scene: In the plan's inertial frame.

    Raises:
        InvalidInput: The samples cannot be executed, MuJoCo refuses the URDF, the number of runs or
            the seed is out of range, or centres of mass are uncertain.
    """
    require_sound_samples(robot, trajectory)
    require_runs(total, seed)
    if uncertainty.center_of_mass > 0.0:
        allowed = "it must be 0 where torques alone are given: these runs keep centres of mass"
        value = uncertainty.center_of_mass
        raise InvalidInput(Status.UNSUPPORTED, "uncertainty.center_of_mass", value, allowed)
    engine = Engine(robot)
    planned = beside_center_of_mass(engine, trajectory)
    origin, velocity = engine.center_of_mass(state_at(trajectory, 0))
    seen = scene.captured_at(float(trajectory.time[-1])).seen_from(origin, velocity)
    command = feed_forward(robot, planned, steps_per_point(planned))
    drawn, start = draws(robot, uncertainty, range(total), seed), state_at(planned, 0)
    peaks = np.abs(trajectory.joint_torques).max(axis=0)
    fastest = max(np.abs(trajectory.joint_velocities).max(), np.finfo(float).tiny)
    found = np.empty((4, total))
    for k in range(total):
        wrong = Engine(robot)
        for body, links in enumerate(_links_of_bodies(wrong, robot)):
            factors = drawn.masses[k, body], drawn.inertias[k, body]
            wrong.scale_inertias(links, *(np.full(len(links), factor) for factor in factors))
        wrong.add_friction(drawn.friction[k] * peaks / fastest, np.zeros(robot.joints))
        begin = _beside(robot, start, drawn.base_twist[k], drawn.joint_rates[k])
        execution = execute(wrong, begin, command)
        off = deviation(execution, planned)
        found[:2, k] = off.final_position_error, off.final_orientation_error
        found[2:, k] = _least(robot, planned, execution, seen)
    bounded = np.nan_to_num(found, nan=np.inf)
    bounded[2:] = np.nan_to_num(found[2:], nan=-np.inf)
    names = ("end_position_error", "end_orientation_error", CLEARANCE, JOINTS)
    measured = {
        name: values
        for name, values in zip(names, bounded, strict=True)
        if not np.isposinf(values).all()
    }
    return MonteCarlo(
        execution=TORQUES,
        total=total,
        seed=seed,
        uncertainty=uncertainty,
        numbers=tuple(
            Compared(name, UNITS[name], distribution(values), None)
            for name, values in measured.items()
        ),
        violations=violations(
            {name: measured[name] for name in (CLEARANCE, JOINTS) if name in measured}, None, total
        ),
        foretold_end_error=None,
    )


def _links_of_bodies(engine: Engine, robot: Robot) -> list[Indices]:
    """Return MuJoCo's numbers of the links of each body, the chaser first."""
    of_joints = [engine.links_moved_by(name) for name in tuple(robot.model.names)[2:]]
    return [engine.chaser_bodies, *of_joints]


def _beside(robot: Robot, start: SystemState, twist: Array, joint_rates: Array) -> SystemState:
    """Return a start with errors added to the base's twist, in the base frame, and joint rates."""
    chaser = Rotation.from_quat(start.quaternion_chaser_to_inertial_xyzw).as_matrix()
    to_inertial = chaser @ robot.rotation_chaser_to_base.T
    of_chaser = twist[:3] + np.cross(twist[3:], robot.position_chaser_in_base)
    linear, angular = to_inertial @ of_chaser, to_inertial @ twist[3:]
    return replace(
        start,
        linear_velocity_chaser_in_inertial=start.linear_velocity_chaser_in_inertial + linear,
        angular_velocity_chaser_in_inertial=start.angular_velocity_chaser_in_inertial + angular,
        joint_velocities=start.joint_velocities + joint_rates,
    )


def _least(
    robot: Robot, planned: Trajectory, execution: Execution, scene: Scene
) -> tuple[float, float]:
    """Return the least distance to obstacles [m] and to the joints' limits [rad]."""
    if not np.isfinite(execution.chaser_positions).all():
        return -np.inf, -np.inf
    done = replace(
        planned,
        joint_positions=execution.joint_positions,
        chaser_positions=execution.chaser_positions,
        chaser_quaternions_xyzw=execution.chaser_quaternions_xyzw,
    )
    q, _ = from_trajectory(robot, done)
    distance = nearness(robot, q, planned.time, scene).distance.min(initial=np.inf)
    robot = about(robot, planned.joint_positions[0])
    below = q[:, 7:] - robot.lower_position_limits
    above = robot.upper_position_limits - q[:, 7:]
    return float(distance), float(np.minimum(below, above).min())
