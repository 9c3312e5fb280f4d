"""Sensitivity of open-loop execution: a plan executed by systems that differ from the model."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import astuple, dataclass, replace
from itertools import chain

import numpy as np

from ff_planner_ros.planning.motion.motion import state_at
from ff_planner_ros.planning.motion.plan import Trajectory
from ff_planner_ros.planning.motion.sound_samples import require_sound_samples
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.simulation.deviation import Deviation, deviation
from ff_planner_ros.simulation.engine import Engine
from ff_planner_ros.simulation.execution import execute
from ff_planner_ros.simulation.feed_forward import FeedForward, feed_forward, torque_spline
from ff_planner_ros.simulation.verification import beside_center_of_mass, steps_per_point

SHARES = (0.01, 0.05, 0.10)  # of masses, inertias and friction

# Draws of independent errors of all links, of which the worst is shown; and their seed.
DRAWS, SEED = 10, 0

# Errors at the start of a good estimate of the chaser's motion, and of good encoders.
SPEED_ERROR = 1e-3  # [m/s]
TURN_ERROR = np.deg2rad(0.01)  # [rad/s]

# MuJoCo's dry friction stops a joint within 0.02 s; half of that changes no position by 1 %.
LONGEST_STEP = 0.02  # [s]


@dataclass(frozen=True)
class ModelError:
    """Deviations of an open-loop execution under one kind of model error."""

    cause: str  # the model error, in words
    deviation: Deviation  # of the execution from the plan; each number the worst of all variants


# A system that differs from the model, and its initial state.
_Variant = tuple[Engine, SystemState]


def model_errors(robot: Robot, trajectory: Trajectory) -> tuple[ModelError, ...]:
    """Execute a plan open loop under one kind of model error after the other.

    The first result is without error, the second of torques from a cubic spline.

    Raises:
        InvalidInput: The samples cannot be executed, or MuJoCo refuses the robot's URDF.
    """
    require_sound_samples(robot, trajectory)
    trajectory = beside_center_of_mass(Engine(robot), trajectory)
    longest = np.diff(trajectory.time).max()
    steps = max(steps_per_point(trajectory), int(np.ceil(longest / LONGEST_STEP)))
    command, spline = feed_forward(robot, trajectory, steps), torque_spline(trajectory, steps)
    start = state_at(trajectory, 0)
    right = [(Engine(robot), start)]
    cases: list[tuple[str, FeedForward, Iterable[_Variant]]] = [
        ("nothing", command, right),
        ("cubic spline through the torques", spline, right),
    ]
    wrong = (_mass_errors(robot, start), _start_errors(robot, start))
    for cause, variants in chain(*wrong, _friction(robot, trajectory, start)):
        cases.append((cause, command, variants))
    return tuple(
        ModelError(cause, _worst(executed, variants, trajectory))
        for cause, executed, variants in cases
    )


def _worst(command: FeedForward, variants: Iterable[_Variant], trajectory: Trajectory) -> Deviation:
    found = [
        astuple(deviation(execute(engine, start, command), trajectory))
        for engine, start in variants
    ]
    return Deviation(*np.max(found, axis=0).tolist())


def _mass_errors(robot: Robot, start: SystemState) -> Iterator[tuple[str, list[_Variant]]]:
    """Yield errors of masses and inertias: of the arm, of the chaser, of each link by itself."""
    for part in ("arm", "chaser"):
        for share in SHARES:
            engine = Engine(robot)
            bodies = engine.arm_bodies if part == "arm" else engine.chaser_bodies
            engine.scale_inertias(bodies, *np.full((2, len(bodies)), 1.0 + share))
            yield f"{part} {share:.0%} heavier, inertias too", [(engine, start)]
    for share in SHARES:
        rng = np.random.default_rng(SEED)
        engines = [Engine(robot) for _ in range(DRAWS)]
        for engine in engines:
            bodies = np.concatenate([engine.chaser_bodies, engine.arm_bodies])
            factors = rng.uniform(1.0 - share, 1.0 + share, (2, len(bodies)))
            engine.scale_inertias(bodies, *factors)
        cause = f"every mass and inertia within {share:.0%}, worst of {DRAWS}"
        yield cause, [(engine, start) for engine in engines]


def _start_errors(robot: Robot, start: SystemState) -> Iterator[tuple[str, list[_Variant]]]:
    """Yield errors of initial velocities, along each axis or joint."""
    for cause, name, error in (
        ("chaser 1 mm/s off at the start", "linear_velocity_chaser_in_inertial", SPEED_ERROR),
        ("chaser 0.01 deg/s off at the start", "angular_velocity_chaser_in_inertial", TURN_ERROR),
        ("one joint 0.01 deg/s off at the start", "joint_velocities", TURN_ERROR),
    ):
        true = getattr(start, name)
        wrong = [replace(start, **{name: true + e}) for e in error * np.eye(len(true))]
        yield cause, [(Engine(robot), begin) for begin in wrong]


def _friction(
    robot: Robot, trajectory: Trajectory, start: SystemState
) -> Iterator[tuple[str, list[_Variant]]]:
    """Yield friction of all joints, as a share of each joint's peak torque along the plan."""
    torques = np.abs(trajectory.joint_torques).max(axis=0)
    fastest = max(np.abs(trajectory.joint_velocities).max(), np.finfo(float).tiny)
    none = np.zeros(robot.joints)
    for cause, viscous, dry in (
        ("viscous friction, {:.0%} of peak torque at peak rate", torques / fastest, none),
        ("dry friction, {:.0%} of peak torque", none, torques),
    ):
        for share in SHARES:
            engine = Engine(robot)
            engine.add_friction(share * viscous, share * dry)
            yield cause.format(share), [(engine, start)]
