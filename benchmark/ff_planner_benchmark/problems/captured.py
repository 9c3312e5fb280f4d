"""Problems after a grasp, each with a motion that solves it, the witness.

- "captured stop": chaser, arm and a captured body of 20 to 800 kg rotate, and the joints move; the
  joints must come to rest, with accelerations limited to little more than the witness's.
- "payload stow": the joints must reach a posture with such a body at the end effector.
- "whole capture": a tumbling body is grasped, its motion relative to the chaser stopped, and it is
  carried to a posture: a sequence of three phases.

Self collisions of the robot and collisions with the held body are checked.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import TypeAlias

import numpy as np

from ff_planner_benchmark.problems.tumbling import Kind, drawn_capture
from ff_planner_benchmark.problems.witnessed import (
    STOPS_IN,
    joint_range,
    quintic,
    stop,
    to_stop,
    way_of,
    window_of,
)
from ff_planner_ros.planning.motion.forward import driven
from ff_planner_ros.planning.motion.joint_motion import JointMotion
from ff_planner_ros.planning.problem.posture import end_effector_at
from ff_planner_ros.planning.problem.problem import (
    Objective,
    PlanningProblem,
    Posture,
)
from ff_planner_ros.planning.task.following import held_body
from ff_planner_ros.planning.task.phase import Phase
from ff_planner_ros.problems.bodies import APART, Swept, own_gap
from ff_planner_ros.problems.drawn import Drawn, asked, first_sound, state
from ff_planner_ros.problems.robots import bench_robot
from ff_planner_ros.robot.collision.geometry import Geometry
from ff_planner_ros.robot.collision.solids import Solid
from ff_planner_ros.robot.configuration import configuration, system_state
from ff_planner_ros.robot.dynamics import joint_torques
from ff_planner_ros.robot.impact import impact
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.momentum import total_momentum
from ff_planner_ros.robot.state import SystemState
from ff_planner_ros.robot.urdf.payload import HeldShape, Payload, with_payload

KINDS = ("captured stop", "payload stow", "whole capture")
ROBOTS = ("lemur", "arm6", "arm7", "arm10")  # in turn

# Masses of the bodies [kg], edges of those that are boxes [m], and how far the end effector is from
# their nearest face [m].
_LIGHTEST, _HEAVIEST = 20.0, 800.0
_EDGES, _BEFORE = (0.3, 0.9), 0.25
# How fast bodies turn at most [deg/s], and how fast joints begin at most [rad/s].
_TURNING, _MOVING = 5.0, 0.05
# A stop takes so much longer in each attempt until the motors can do it.
_LONGER, _ATTEMPTS = 1.6, 5
# How far joints turn to a posture [rad], and how long that takes [s].
_TURN, _STOWS_IN = 0.7, (10.0, 20.0)
_TORQUES, _STEPS = 0.95, 100  # part of the limits that a witness takes
_CAPTURED = Kind((1.0, _TURNING), geometry=Geometry.SHAPES)


# Motions of each phase; of a whole capture, of those after the first.
Motions: TypeAlias = tuple[JointMotion, ...]


@cache
def problem(kind: str, number: int) -> Drawn[Motions]:
    """Return a problem of one of `KINDS`, the robots in turn; kind and number seed the draw."""
    name = ROBOTS[number % len(ROBOTS)]
    robot, rng = bench_robot(name, Geometry.SHAPES), np.random.default_rng([*kind.encode(), number])
    draw = {"captured stop": _stop, "payload stow": _stow, "whole capture": _whole}[kind]
    return first_sound(kind, name, lambda: draw(robot, rng))


def _stop(robot: Robot, rng: np.random.Generator) -> Drawn[Motions] | None:
    holding = with_payload(robot, _box(robot, rng))
    start = _turning_together(holding, rng)
    witness = _stopping(holding, start, rng)
    if witness is None:
        return None
    given = _asked(holding, start, Posture(at_rest=True), float(witness.time[-1]))
    return Drawn(to_stop(given, witness), (witness,))


def _stow(robot: Robot, rng: np.random.Generator) -> Drawn[Motions] | None:
    holding = with_payload(robot, _box(robot, rng))
    moving = _turning_together(holding, rng)
    start = replace(moving, joint_velocities=np.zeros(robot.joints))
    witness = _stowing(holding, start, rng)
    if witness is None:
        return None
    posture = Posture(witness.positions[-1])
    return Drawn(_asked(holding, start, posture, float(witness.time[-1])), (witness,))


def _whole(robot: Robot, rng: np.random.Generator) -> Drawn[Motions] | None:
    capture = drawn_capture(robot, _CAPTURED, rng)
    if capture is None:
        return None
    given, way, light = capture.problem, capture.witness, capture.problem.target_body
    if light is None:
        return None
    mass = math.exp(rng.uniform(math.log(_LIGHTEST), math.log(_HEAVIEST)))
    body = replace(light, mass=mass, inertia=mass * light.inertia)
    # As the witness ends: joints by differences, the base by the momentum.
    rates = (way.way[-1, 7:] - way.way[-2, 7:]) / (way.times[-1] - way.times[-2])
    q, v = configuration(robot, given.start)
    momentum = total_momentum(robot, robot.model.createData(), q, v)
    ends = way.way[-1:, 7:].repeat(2, axis=0), np.tile(rates, (2, 1)), np.zeros((2, robot.joints))
    still = JointMotion(np.array([0.0, 1.0]), *ends)
    there, moves, _ = driven(robot, way.way[-1], momentum, still, np.array([0.0, 1e-6]))
    before = system_state(robot, there[0], moves[0])
    twist = body.grasp(np.array([given.duration])).twists[0]
    after = impact(robot, body.inertia_at_grasp, before, twist).after
    holding = with_payload(robot, held_body(body, robot))
    stopping = _stopping(holding, after, rng)
    if stopping is None:
        return None
    rest = system_state(
        holding, *(rows[-1] for rows in way_of(holding, after, stopping, _STEPS)[1:3])
    )
    stowing = _stowing(holding, rest, rng)
    if stowing is None:
        return None
    then = (
        Phase(
            duration=window_of(stopping),
            target=Posture(at_rest=True),
            objective=Objective(0.0, 0.0, 1.0),
        ),
        Phase(
            duration=float(stowing.time[-1]),
            target=Posture(stowing.positions[-1]),
            objective=Objective(1.0, 0.0),
        ),
    )
    return Drawn(replace(given, target_body=body), (stopping, stowing), then)


def _box(robot: Robot, rng: np.random.Generator) -> Payload:
    """Draw a box-shaped body in front of the end effector."""
    mass = math.exp(rng.uniform(math.log(_LIGHTEST), math.log(_HEAVIEST)))
    edges = rng.uniform(*_EDGES, 3)
    place = np.array([0.0, 0.0, _BEFORE + edges[2] / 2.0])
    squares = edges**2
    moments = mass / 12.0 * (squares.sum() - squares)
    aside = 0.1 * edges * rng.uniform(-1.0, 1.0, 3)
    shape = HeldShape("box", Solid("box", edges), place)
    return Payload(robot.tip_link, mass, np.diag(moments), place + aside, (shape,))


def _turning_together(robot: Robot, rng: np.random.Generator) -> SystemState:
    spin = rng.normal(size=3)
    spin *= np.deg2rad(rng.uniform(0.0, _TURNING)) / np.linalg.norm(spin)
    at, drift = rng.normal(size=3), 0.01 * rng.normal(size=3)
    joints = rng.uniform(*joint_range(robot))
    return state(joints, rng.uniform(-_MOVING, _MOVING, robot.joints), drift, spin, at)


def _stopping(robot: Robot, start: SystemState, rng: np.random.Generator) -> JointMotion | None:
    """Return a motion that stops all joints, slower until it is sound; None: none is."""
    lasts, rates = float(rng.uniform(*STOPS_IN)), start.joint_velocities
    for _ in range(_ATTEMPTS):
        motion = stop(start.joint_positions, rates, lasts)
        if _is_sound(robot, start, motion):
            return motion
        lasts *= _LONGER
    return None


def _stowing(robot: Robot, start: SystemState, rng: np.random.Generator) -> JointMotion | None:
    """Return a motion to a posture; None: it is not sound."""
    end = start.joint_positions + rng.uniform(-_TURN, _TURN, robot.joints)
    lasts, still = float(rng.uniform(*_STOWS_IN)), np.zeros(robot.joints)
    motion = quintic(start.joint_positions, end, still, lasts)
    return motion if _is_sound(robot, start, motion) else None


def _is_sound(robot: Robot, start: SystemState, motion: JointMotion) -> bool:
    """Tell whether joint positions and torques keep their limits, and bodies stay apart."""
    _, way, moves, accelerations = way_of(robot, start, motion, _STEPS)
    lower, upper = robot.lower_position_limits, robot.upper_position_limits
    if ((way[:, 7:] < lower + APART) | (way[:, 7:] > upper - APART)).any():
        return False
    torques = joint_torques(robot, way, moves, accelerations)
    if (np.abs(torques) > _TORQUES * robot.effort_limits).any():
        return False
    return own_gap(Swept(robot, way), APART) >= APART


def _asked(robot: Robot, start: SystemState, posture: Posture, duration: float) -> PlanningProblem:
    return asked(robot, start, end_effector_at(robot, start), duration, posture=posture)
