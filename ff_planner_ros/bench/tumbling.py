"""Problems whose target is a body that tumbles: a motion was drawn that ends at rest in its grasp.

That motion, the witness, is a quintic of each joint from the start to the twist and acceleration of
the grasp; the attached spheres stay away from it all the while.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from ff_planner_ros.arrays import Array
from ff_planner_ros.bench.robots import ROBOTS, bench_robot
from ff_planner_ros.planning.clearance import arm_points, clearances, segments
from ff_planner_ros.planning.forward import driven
from ff_planner_ros.planning.joint_motion import JointMotion
from ff_planner_ros.planning.problem import (
    Limits,
    Objective,
    PlanningProblem,
    Sphere,
    capturing,
)
from ff_planner_ros.planning.target_body import AttachedSphere, TargetBody
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.dynamics import accelerations, joint_torques
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.momentum import (
    base_twist,
    generalised_jacobian,
    smallest_singular_values,
    total_momentum,
)
from ff_planner_ros.robot.state import SystemState

# Classes of problems: how fast the bodies turn at capture, at least and at most [deg/s].
KINDS = {"tumbling": (1.0, 5.0), "fast tumbling": (10.0, 10.0)}

# How far each joint turns at most [rad], and how fast it and the chaser begin [rad/s, m/s, rad/s].
_TURN, _MOVING, _DRIFT, _SPIN = 0.9, 0.03, 0.01, 0.01
# The witness stays away from joint limits [rad], and below so much of rates and torques.
_FROM_LIMITS, _OF_LIMITS = 0.1, 0.7
# Its smallest singular value is more, at its ends; the planner's threshold is 0.02.
_REGULAR = 0.08
# The grasp is so far from the body's centre of mass [m], which drifts so fast [m/s].
_NEAREST, _FARTHEST, _BODY_DRIFT = 0.3, 0.8, 0.01
# Its mass is spread so far along its main axes: each moment is the sum of two.
_LOWEST_SPREAD, _HIGHEST_SPREAD = (0.2, 0.5, 0.8), (0.4, 0.8, 1.2)
_ASIDE = 0.4  # so far is the direction there from that of the arm's end, as a tangent
# Attached spheres: how many, how large [m], how far from the witness [m] and from the chaser [m],
# and half the edge of the cube that the body is [m].
_FEWEST, _MOST, _SMALLEST, _LARGEST = 6, 14, 0.06, 0.3
_CLEAR, _FROM_CHASER, _EXTENT = 0.02, 0.8, 0.5
_CANDIDATES = 80
_POINTS, _STEPS = 50, 100
# Of the witness's end: so often it is improved, until nothing changes any more [rad/s, rad/s2].
_ROUNDS, _SETTLED = 30, 1e-11


@dataclass(frozen=True, eq=False)
class _Grip:
    """A body in axes of the end effector that holds it."""

    to_ee: Array  # body axes to the end effector's; shape (3, 3)
    center: Array  # its centre of mass; shape (3,) [m]
    inertia: Array  # body axes; shape (3, 3)
    rate: Array  # body axes; shape (3,) [rad/s]
    drift: Array  # of its centre of mass, in axes of the end effector; shape (3,) [m/s]

    def body(self, tip: pin.SE3) -> TargetBody:
        """Return the body where the end effector is."""
        to_inertial = tip.rotation @ self.to_ee
        return TargetBody(
            position=tip.translation + tip.rotation @ self.center,
            quaternion_xyzw=pin.Quaternion(to_inertial).coeffs(),
            inertia=self.inertia,
            grasp_position=-self.to_ee.T @ self.center,
            grasp_quaternion_xyzw=pin.Quaternion(self.to_ee.T).coeffs(),
            linear_velocity=tip.rotation @ self.drift,
            angular_velocity=to_inertial @ self.rate,
        )


def problems(kind: str, count: int) -> Iterator[PlanningProblem]:
    """Yield the first problems of a class, always the same, the robots in turn."""
    for number in range(count):
        yield problem(kind, number)


@cache
def problem(kind: str, number: int) -> PlanningProblem:
    """Return one problem of a class, always the same."""
    robot = bench_robot(ROBOTS[number % len(ROBOTS)])
    rng = np.random.default_rng([*kind.encode(), number])
    while True:
        drawn = _drawn(robot, KINDS[kind], rng)
        if drawn is not None:
            return drawn


def _drawn(
    robot: Robot, fastest: tuple[float, float], rng: np.random.Generator
) -> PlanningProblem | None:
    """Draw a system, a body and a motion; None: the motion violates what a plan must keep."""
    start = _start(robot, rng)
    duration = float(rng.uniform(8.0, 15.0))
    end = start.joint_positions + rng.uniform(-_TURN, _TURN, robot.joints)
    grip = _grip(_ahead(robot, end), np.deg2rad(rng.uniform(*fastest)), rng)
    witness = _witness(robot, start, end, grip, duration)
    if witness is None:
        return None
    way, times = witness
    body = grip.body(_tip(robot, way[-1])).after(-duration)
    spheres = _attached(robot, way, times, body, rng)
    if len(spheres) < _FEWEST:
        return None
    body = replace(body, obstacles=spheres)
    asked = PlanningProblem(
        robot=robot,
        start=start,
        target=body.target(duration),
        duration=duration,
        points=_POINTS,
        obstacles=(),
        objective=Objective(1.0, 0.0),
        limits=Limits(joint_velocities=True),
    )
    return capturing(body, asked)


def _start(robot: Robot, rng: np.random.Generator) -> SystemState:
    lowest = np.maximum(robot.lower_position_limits, -np.pi) + _FROM_LIMITS
    highest = np.minimum(robot.upper_position_limits, np.pi) - _FROM_LIMITS
    return SystemState(
        position_chaser_in_inertial=np.zeros(3),
        quaternion_chaser_to_inertial_xyzw=np.array([0.0, 0.0, 0.0, 1.0]),
        linear_velocity_chaser_in_inertial=_DRIFT * rng.normal(size=3),
        angular_velocity_chaser_in_inertial=_SPIN * rng.normal(size=3),
        joint_positions=rng.uniform(lowest, highest),
        joint_velocities=_MOVING * rng.uniform(-1.0, 1.0, robot.joints),
    )


def _grip(ahead: Array, rate: float, rng: np.random.Generator) -> _Grip:
    """Draw a body that turns about no main axis of its inertia.

    Args:
        ahead: Of the end effector, in its axes, unit length. Shape (3,).
    """
    a, b, c = rng.uniform(_LOWEST_SPREAD, _HIGHEST_SPREAD)
    axes = Rotation.random(rng=rng).as_matrix()
    out = ahead + _ASIDE * rng.normal(size=3)
    turn = rng.normal(size=3)
    return _Grip(
        to_ee=Rotation.random(rng=rng).as_matrix(),
        center=rng.uniform(_NEAREST, _FARTHEST) * out / np.linalg.norm(out),
        inertia=axes @ np.diag([b + c, a + c, a + b]) @ axes.T,
        rate=rate * turn / np.linalg.norm(turn),
        drift=_BODY_DRIFT * rng.normal(size=3),
    )


def _ahead(robot: Robot, joints: Array) -> Array:
    """Return the direction in which the arm ends, in axes of the end effector. Shape (3,)."""
    q = np.concatenate([np.zeros(6), [1.0], joints])
    points = arm_points(robot, q[None])
    last = int(segments(points)[-1])
    along = points[0, last + 1] - points[0, last]
    ahead: Array = _tip(robot, q).rotation.T @ along / np.linalg.norm(along)
    return ahead


def _witness(
    robot: Robot, start: SystemState, end: Array, grip: _Grip, duration: float
) -> tuple[Array, Array] | None:
    """Return the configurations of a motion that ends at rest in the grip, and their times.

    None: there is none to that posture, or it violates what a plan must keep.
    """
    q, v = configuration(robot, start)
    momentum = total_momentum(robot, robot.model.createData(), q, v)
    times = np.linspace(0.0, duration, _STEPS + 1)
    still = np.zeros(robot.joints)
    last = np.zeros((2, robot.joints))  # rates and accelerations at the end
    for _ in range(_ROUNDS):
        witness = JointMotion(
            np.array([0.0, duration]),
            np.array([start.joint_positions, end]),
            np.array([start.joint_velocities, last[0]]),
            np.array([still, last[1]]),
        )
        angles, rates, _ = witness.at(times)
        if (angles < robot.lower_position_limits + _FROM_LIMITS).any():
            return None
        if (angles > robot.upper_position_limits - _FROM_LIMITS).any():
            return None
        if (np.abs(rates) > _OF_LIMITS * robot.velocity_limits).any():
            return None
        way, twists, changes = driven(robot, q, momentum, witness, times)
        if smallest_singular_values(robot, way[[0, -1]]).min() < _REGULAR:
            return None
        wanted = np.array(_rates_in_grip(robot, way[-1], momentum, grip))
        settled = np.abs(wanted - last).max() < _SETTLED
        last = wanted
        if settled:
            torques = joint_torques(robot, way, twists, changes[:, 6:])
            allowed = _OF_LIMITS * robot.effort_limits
            return (way, times) if (np.abs(torques) <= allowed).all() else None
    return None


def _rates_in_grip(robot: Robot, q: Array, momentum: Array, grip: _Grip) -> tuple[Array, Array]:
    """Return the least rates and accelerations at which the end effector rests in the body."""
    model, data, frame = robot.model, robot.model.createData(), robot.tip_frame_id
    jacobian = generalised_jacobian(robot, data, q)
    wanted = grip.body(_tip(robot, q)).grasp(np.zeros(1))
    still = np.zeros(robot.joints)
    drifting = np.concatenate([base_twist(robot, data, q, momentum, still), still])
    pin.forwardKinematics(model, data, q, drifting)
    twist = pin.getFrameVelocity(model, data, frame, pin.LOCAL_WORLD_ALIGNED).vector
    rates = np.linalg.pinv(jacobian) @ (wanted.twists[0] - twist)
    v = np.concatenate([base_twist(robot, data, q, momentum, rates), rates])
    coasting = accelerations(robot, q[None], v[None], still[None])[0]
    pin.forwardKinematics(model, data, q, v, coasting)
    change = pin.getFrameClassicalAcceleration(model, data, frame, pin.LOCAL_WORLD_ALIGNED).vector
    return rates, np.linalg.pinv(jacobian) @ (wanted.accelerations[0] - change)


def _tip(robot: Robot, q: Array) -> pin.SE3:
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    return pin.updateFramePlacement(robot.model, data, robot.tip_frame_id).copy()


def _attached(
    robot: Robot, way: Array, times: Array, body: TargetBody, rng: np.random.Generator
) -> tuple[AttachedSphere, ...]:
    """Draw spheres of a body that stay away from the arm and the chaser.

    Half of them are beside the arm's way as the body sees it, the others anywhere in the body.
    """
    points = arm_points(robot, way)
    starts, count = segments(points), int(rng.integers(_FEWEST, _MOST + 1))
    motion = body.motion(np.zeros(3), times)
    seen = (points - motion.positions[:, None]) @ motion.rotations
    seen = np.linspace(seen[:, starts], seen[:, starts + 1], 9).reshape(-1, 3)
    seen = seen[np.linalg.norm(seen, axis=1) < 2.0 * _EXTENT]
    chosen = list[AttachedSphere]()
    for number in range(_CANDIDATES):
        center, radius = _EXTENT * rng.uniform(-1.0, 1.0, 3), rng.uniform(_SMALLEST, _LARGEST)
        if number % 2 and len(seen):
            aside = rng.normal(size=3)
            center = seen[rng.integers(len(seen))]
            center = center + (radius + _CLEAR) * aside / np.linalg.norm(aside)
        places = body.places(center[None], times)[:, 0]
        sphere = Sphere("", places[0], radius, np.zeros(3), body, center)
        clear = float(clearances(points, times, starts, [sphere]).distance.min()) - _CLEAR
        away = float(np.linalg.norm(places - way[:, :3], axis=1).min()) - radius - _FROM_CHASER
        radius += min(clear, away, 0.0)
        if radius < _SMALLEST:
            continue
        chosen.append(AttachedSphere(f"part_{len(chosen) + 1}", center, radius))
        if len(chosen) == count:
            break
    return tuple(chosen)
