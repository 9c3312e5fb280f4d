"""Plans made by hand: joints move as a test says, the base as physics makes it.

No search makes them, so that a plan can break one requirement and nothing else. Kinematics and
dynamics are Pinocchio's own mass matrix and frames, the integration is scipy's: nothing here is
the planner's but the types.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp
from scipy.interpolate import BPoly, PPoly
from scipy.spatial.transform import Rotation

from ff_planner_ros.common.arrays import Array
from ff_planner_ros.errors import Failure
from ff_planner_ros.parameters import load_parameters
from ff_planner_ros.planning.check.check import failures, measure
from ff_planner_ros.planning.motion.metrics import Metrics
from ff_planner_ros.planning.motion.plan import Plan, SolverReport, Trajectory
from ff_planner_ros.planning.problem.problem import Objective, Orientation, PlanningProblem, Target
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.state import SystemState

SETTINGS = load_parameters().planner
GOAL, TAIL, STEP = 8, 4, 0.5  # points to the goal and after it, time between two [s]
POINTS = GOAL + TAIL + 1
PLACES = {"start": 0, "between": 4, "before the goal": GOAL - 1, "tail": GOAL, "end": POINTS - 2}
ACCURACY = 1e-10  # of the integration, relative
DENSE = 40  # times from point to point that count as all
NOBODY = SolverReport(starts=1, iterations=0, rollouts=0, optimality=0.0, stop_reason="by hand")


@dataclass(frozen=True, eq=False)
class Joints:
    """Samples of the joints; between them they move on quintics."""

    positions: Array
    velocities: Array
    accelerations: Array

    def bulging(self, joint: int, interval: int, size: float) -> Joints:
        """Let a joint go out and back between two points, and beside them to the other side."""
        velocities = self.velocities.copy()
        velocities[interval, joint] += 3.2 * size / STEP
        velocities[interval + 1, joint] -= 3.2 * size / STEP
        return replace(self, velocities=velocities)

    def swelling(self, joint: int, interval: int, size: float) -> Joints:
        """Let a joint go out and back between two points, half as far beside them, never back."""
        accelerations = self.accelerations.copy()
        accelerations[interval : interval + 2, joint] += 32.0 * size / STEP**2
        return replace(self, accelerations=accelerations)

    def stepping(self, joint: int, interval: int, way: float) -> Joints:
        """Let a joint go a way between two points, and stay there."""
        positions = self.positions.copy()
        positions[interval + 1 :, joint] += way
        return replace(self, positions=positions)


def resting(posture: Array) -> Joints:
    nothing = np.zeros((POINTS, len(posture)))
    return Joints(nothing + posture, nothing, nothing)


@dataclass(frozen=True, eq=False)
class Made:
    """A problem, a plan that solves it, and the truth between its points."""

    problem: PlanningProblem
    plan: Plan
    time: Array  # dense
    q: Array  # dense
    v: Array  # at the points alone
    velocity: Callable[[float, Array], Array]  # at a time, of the base's configuration

    @cached_property
    def torques(self) -> Array:
        """Dense."""
        motion = self.plan.trajectory
        joints = motion.joint_positions, motion.joint_velocities, motion.joint_accelerations
        quintics = BPoly.from_derivatives(motion.time, np.stack(joints, axis=1))
        v = [self.velocity(*each) for each in zip(self.time, self.q[:, :7], strict=True)]
        return _torques(self.problem.robot, self.q, np.array(v), quintics(self.time, 2))

    def judged(self, **changes: object) -> list[Failure]:
        """What the check finds when the problem is changed."""
        return judged(replace(self.problem, **changes), self.plan)

    def told(self, **arrays: Array) -> list[Failure]:
        """What the check finds when samples are changed."""
        return judged(self.problem, self.spoilt(**arrays))

    def measured(self) -> Metrics:
        """Return the metrics of the plan."""
        return measure(self.problem, self.plan.trajectory, SETTINGS)

    def spoilt(self, **arrays: Array) -> Plan:
        return replace(self.plan, trajectory=replace(self.plan.trajectory, **arrays))


def judged(
    problem: PlanningProblem, plan: Plan, settings: PlannerSettings = SETTINGS
) -> list[Failure]:
    metrics = measure(problem, plan.trajectory, settings)
    return list(failures(problem, replace(plan, metrics=metrics), settings))


def unlimited(robot: Robot) -> Robot:
    many = np.full(robot.joints, 50.0)
    return replace(
        robot,
        lower_position_limits=-many,
        upper_position_limits=many,
        velocity_limits=many,
        effort_limits=np.inf * many,
    )


def made(
    robot: Robot, joints: Joints, twist: Array, place: Array, attitude: Rotation | None = None
) -> Made:
    """Let a system move freely.

    Args:
        robot: Its limits are lifted.
        joints: What its joints do.
        twist: Of the base at the start, in its own axes; v then w.
        place: Of the base at the start.
        attitude: Of the chaser's axes at the start; None: those of the inertial frame.
    """
    robot = unlimited(robot)
    model = robot.model
    to_chaser = model.frames[model.getFrameId(robot.base_link)].placement.rotation
    turned = (attitude or Rotation.identity()) * Rotation.from_matrix(to_chaser).inv()
    times = STEP * np.arange(POINTS)
    base = np.concatenate([place, turned.as_quat()])
    time, q, velocity = _carried(robot, joints, times, base, twist)
    v = np.array([velocity(*each) for each in zip(times, q[::DENSE, :7], strict=True)])
    trajectory = _trajectory(robot, times, joints, q[::DENSE], v)
    duration = float(times[GOAL])
    problem = PlanningProblem(
        robot=robot,
        start=SystemState(
            trajectory.chaser_positions[0],
            trajectory.chaser_quaternions_xyzw[0],
            trajectory.chaser_linear_velocities[0],
            trajectory.chaser_angular_velocities[0],
            joints.positions[0],
            joints.velocities[0],
            joints.accelerations[0],
        ),
        target=Target(
            trajectory.ee_positions[GOAL],
            trajectory.ee_quaternions_xyzw[GOAL],
            orientation=Orientation.FIXED
            if robot.joints >= len(robot.base.rows)
            else Orientation.FREE,
        ),
        duration=duration,
        points=GOAL + 1,
        obstacles=(),
        objective=Objective(1.0, 0.0),
    )
    plan = Plan(
        joint_names=robot.joint_names,
        trajectory=trajectory,
        xi=np.empty(0),
        orientation_reading="",
        metrics=measure(problem, trajectory, SETTINGS),
        solver=NOBODY,
    )
    return Made(problem, plan, time, q, v, velocity)


def arm(robot: Robot, q: Array) -> Array:
    """Joints and end effector by Pinocchio. Shape (joints + 1, 3)."""
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    tip = pin.updateFramePlacement(robot.model, data, robot.tip_frame_id).translation
    return np.array([*(data.oMi[k + 2].translation for k in range(robot.joints)), tip])


def from_lines(points: Array, center: Array) -> Array:
    """Distances of a place from the lines between points."""
    along, to_center = np.diff(points, axis=0), center - points[:-1]
    square = np.maximum(np.sum(along**2, axis=1), 1e-12)
    part = np.clip(np.sum(to_center * along, axis=1) / square, 0.0, 1.0)
    return np.asarray(np.linalg.norm(to_center - part[:, None] * along, axis=1))


def _carried(
    robot: Robot, joints: Joints, times: Array, base: Array, twist: Array
) -> tuple[Array, Array, Callable[[float, Array], Array]]:
    """Return dense times, configurations and the velocity; momentum is that of the start."""
    model, data, rows = robot.model, robot.model.createData(), robot.base.rows
    quintics = BPoly.from_derivatives(
        times, np.stack([joints.positions, joints.velocities, joints.accelerations], axis=1)
    )
    powers = PPoly.from_bernstein_basis(quintics).c  # quick for one time
    q = np.concatenate([base, joints.positions[0]])
    v = np.concatenate([twist, joints.velocities[0]])
    pin.computeCentroidalMomentum(model, data, q, v)
    linear = data.hg.linear.copy()
    angular = data.hg.angular + np.cross(data.com[0], linear)

    def velocity(when: float, base: Array) -> Array:
        piece = min(max(int(np.searchsorted(times, when, "right")) - 1, 0), len(times) - 2)
        positions, rates = _value_and_rate(powers[:, piece], when - times[piece])
        q = np.concatenate([base, positions])
        q[3:7] /= np.linalg.norm(q[3:7])
        by_velocity = pin.computeCentroidalMap(model, data, q)
        wanted = np.concatenate([linear, angular - _cross(data.com[0], linear)])
        of_joints = by_velocity[:, 6:] @ rates
        if len(rows) == 6:
            return np.concatenate([np.linalg.solve(by_velocity[:, :6], wanted - of_joints), rates])
        turned = Rotation.from_quat(q[3:7]).as_matrix()
        # In inertial axes, where a table takes up what leaves the plane.
        to_base = np.kron(np.eye(2), turned)
        of_base = (by_velocity[:, :6] @ to_base.T)[np.ix_(rows, rows)]
        found = np.zeros(6)
        found[rows] = np.linalg.solve(of_base, (wanted - of_joints)[rows])
        return np.concatenate([to_base.T @ found, rates])

    def base_rate(when: float, base: Array) -> Array:
        moving, turning = np.split(velocity(when, base)[:6], 2)
        vector, scalar = base[3:6], base[6]
        vector_rate = (scalar * turning + _cross(vector, turning)) / 2
        turned = pin.Quaternion(base[3:7] / np.linalg.norm(base[3:7])).toRotationMatrix()
        return np.concatenate([turned @ moving, vector_rate, [-vector @ turning / 2]])

    time, bases = [times[:1]], [base[None]]
    for begin, end in pairwise(times.tolist()):
        part = np.linspace(begin, end, DENSE + 1)
        ways = (begin, end), bases[-1][-1], "DOP853", part[1:]
        bases.append(solve_ivp(base_rate, *ways, rtol=ACCURACY, atol=ACCURACY / 100).y.T)
        time.append(part[1:])
    at, poses = np.concatenate(time), np.concatenate(bases)
    poses[:, 3:7] /= np.linalg.norm(poses[:, 3:7], axis=1)[:, None]
    return at, np.hstack([poses, quintics(at)]), velocity


def _value_and_rate(powers: Array, time: float) -> tuple[Array, Array]:
    """Return polynomials, their highest powers first, and their rates at a time."""
    value, rate = powers[0], np.zeros_like(powers[0])
    for row in powers[1:]:
        rate = rate * time + value
        value = value * time + row
    return value, rate


def _cross(one: Array, other: Array) -> Array:
    (a, b, c), (x, y, z) = one.tolist(), other.tolist()
    return np.array([b * z - c * y, c * x - a * z, a * y - b * x])


def _torques(robot: Robot, q: Array, v: Array, accelerated: Array) -> Array:
    data, samples = robot.model.createData(), zip(q, v, accelerated, strict=True)
    return np.array([free_motion(robot, *at, data)[1] for at in samples])


def free_motion(
    robot: Robot, q: Array, v: Array, accelerated: Array, data: pin.Data | None = None
) -> tuple[Array, Array]:
    """Return the base's acceleration and the torques while nothing pushes the base."""
    model, rows = robot.model, robot.base.rows
    data = data or model.createData()
    mass = np.array(pin.crba(model, data, q))
    mass = np.triu(mass) + np.triu(mass, 1).T
    bias = np.array(pin.nonLinearEffects(model, data, q, v))
    of_base = np.zeros(6)
    of_base[rows] = np.linalg.solve(
        mass[np.ix_(rows, rows)], -(bias[:6] + mass[:6, 6:] @ accelerated)[rows]
    )
    return of_base, bias[6:] + mass[6:, :6] @ of_base + mass[6:, 6:] @ accelerated


def _trajectory(robot: Robot, times: Array, joints: Joints, q: Array, v: Array) -> Trajectory:
    """Return the samples; the chaser's frame is at the centre of mass of the first body."""
    model, data, tip = robot.model, robot.model.createData(), robot.tip_frame_id
    axes = model.frames[model.getFrameId(robot.base_link)].placement.rotation
    rows: dict[str, list[Array]] = {
        name: [] for name in ("p", "r", "v", "w", "ep", "er", "ev", "ew")
    }
    for at in zip(q, v, strict=True):
        pin.forwardKinematics(model, data, *at)
        base, twist = data.oMi[1], data.v[1]
        lever = model.inertias[1].lever
        rows["p"].append(base.act(lever))
        rows["r"].append(Rotation.from_matrix(base.rotation @ axes).as_quat())
        rows["v"].append(base.rotation @ (twist.linear + np.cross(twist.angular, lever)))
        rows["w"].append(base.rotation @ twist.angular)
        ee = pin.updateFramePlacement(model, data, tip)
        moving = pin.getFrameVelocity(model, data, tip, pin.LOCAL_WORLD_ALIGNED)
        rows["ep"].append(ee.translation.copy())
        rows["er"].append(Rotation.from_matrix(ee.rotation).as_quat())
        rows["ev"].append(moving.linear.copy())
        rows["ew"].append(moving.angular.copy())
    arrays = [np.array(each) for each in rows.values()]
    torques = _torques(robot, q, v, joints.accelerations)
    return Trajectory(
        times, joints.positions, joints.velocities, joints.accelerations, torques, *arrays
    )
