"""The inertial frame that a plan is made in: it moves with the system's centre of mass.

The laws of motion are the same in every inertial frame, but numbers are not: far from the origin,
or where everything moves fast, differences lose digits, and an integration in steps turns a uniform
motion into an error. Here the centre of mass rests at the origin, linear momentum is zero, and the
chaser's axes at the first point are those of the frame. Its Euler angles are then those relative to
its start attitude, whatever the user's frame is.

The search may find different plans for two problems that differ by rounding. So a problem is
rounded here, far below the accuracy of any measurement: from most user frames, it is then the same
to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pinocchio as pin

from ff_planner_ros.common.arrays import Array, frozen
from ff_planner_ros.planning.motion.plan import Plan
from ff_planner_ros.planning.problem.limits import ChaserGoal
from ff_planner_ros.planning.problem.obstacles import Obstacle, SphereEntry, with_attached
from ff_planner_ros.planning.problem.path.followed import PathToFollow
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.target import Target
from ff_planner_ros.planning.problem.target_body import TargetBody
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.quaternion import (
    canonical_quaternion,
    quaternion_inverse,
    quaternion_product,
)
from ff_planner_ros.robot.state import SystemState

# Values are rounded to multiples of these: a thousand times the resolution of double precision at
# 7000 km and 8 km/s, and a thousandth of the allowed final error [m, m/s]; and of angular
# velocities, accelerations and quaternions.
_PLACE, _SPEED, _OTHER = 2.0**-20, 2.0**-30, 2.0**-40


@dataclass(frozen=True, eq=False)
class SystemFrame:
    """An inertial frame relative to the user's; time zero is the same in both."""

    origin: Array  # at time zero, in the user's frame; shape (3,) [m]
    velocity: Array  # constant, in the user's frame; shape (3,) [m/s]
    quaternion_xyzw: Array  # rotates its axes to the user's; shape (4,)
    start: SystemState  # state of the system at time zero, in this frame

    @cached_property
    def rotation(self) -> Array:
        """Rotation from its axes to the user's. Shape (3, 3)."""
        return frozen(pin.Quaternion(self.quaternion_xyzw).toRotationMatrix())

    def problem(self, problem: PlanningProblem) -> PlanningProblem:
        """Return a problem of the user's frame, whose first point is at time zero, in this frame.

        Its values are rounded, and its start is `start`.
        """
        body, end, window = problem.target_body, problem.duration, problem.duration_range
        here = None if body is None else self._body_here(body)
        others = tuple(
            self._obstacle_here(one)
            for one in problem.obstacles
            if here is None or one.body is None
        )
        return replace(
            problem,
            start=self.start,
            target=self._target_here(problem.target, end) if here is None else here.target(end),
            path=None if problem.path is None else self._path_here(problem.path),
            obstacles=others if here is None else with_attached(others, here),
            target_body=here,
            chaser_goal=self._chaser_goal_here(problem.chaser_goal),
            requirements=tuple(one.seen_from(self) for one in problem.requirements),
            duration_range=None
            if window is None
            else replace(window, target_velocity=self._velocity_here(window.target_velocity)),
        )

    def state_seen_by_user(self, state: SystemState, time: float) -> SystemState:
        """Return a state of this frame at a time [s] in the user's frame."""
        axes = self.rotation
        place = axes @ state.position_chaser_in_inertial + self.velocity * time
        attitude = quaternion_product(
            self.quaternion_xyzw, state.quaternion_chaser_to_inertial_xyzw
        )
        velocity = axes @ state.linear_velocity_chaser_in_inertial + self.velocity
        return replace(
            state,
            position_chaser_in_inertial=self.origin + place,
            quaternion_chaser_to_inertial_xyzw=attitude,
            linear_velocity_chaser_in_inertial=velocity,
            angular_velocity_chaser_in_inertial=axes @ state.angular_velocity_chaser_in_inertial,
        )

    def plan(self, plan: Plan) -> Plan:
        """Return a plan of the user's frame, its first point at time zero, in this frame."""
        axes = self.rotation

        def here(time: Array, x: Array, q: Array, v: Array, omega: Array) -> tuple[Array, ...]:
            place = ((x - self.origin) - np.outer(time, self.velocity)) @ axes
            attitude = quaternion_product(quaternion_inverse(self.quaternion_xyzw), q)
            return place, attitude, (v - self.velocity) @ axes, omega @ axes

        return _with_motion(plan, here)

    def plan_seen_by_user(self, plan: Plan) -> Plan:
        """Return a plan of this frame, its first point at time zero, in the user's frame."""
        axes = self.rotation.T

        def there(time: Array, x: Array, q: Array, v: Array, omega: Array) -> tuple[Array, ...]:
            place = self.origin + (np.outer(time, self.velocity) + x @ axes)
            attitude = quaternion_product(self.quaternion_xyzw, q)
            return place, attitude, v @ axes + self.velocity, omega @ axes

        return _with_motion(plan, there)

    def _target_here(self, target: Target, time: float) -> Target:
        return replace(
            target,
            position=self._place_here(target.position, time),
            quaternion_xyzw=self._attitude_here(target.quaternion_xyzw),
            linear_velocity=self._velocity_here(target.linear_velocity),
            angular_velocity=self._vector_here(target.angular_velocity, _OTHER),
            linear_acceleration=self._vector_here(target.linear_acceleration, _OTHER),
            angular_acceleration=self._vector_here(target.angular_acceleration, _OTHER),
        )

    def _chaser_goal_here(self, goal: ChaserGoal) -> ChaserGoal:
        wanted = goal.quaternion_xyzw
        return (
            goal if wanted is None else replace(goal, quaternion_xyzw=self._attitude_here(wanted))
        )

    def _path_here(self, path: PathToFollow) -> PathToFollow:
        # On the finer grid: points may be near each other, and the path is smooth.
        def place(at: Array, time: float) -> Array:
            return self._vector_here((at - self.origin) - self.velocity * time, _SPEED)

        return path.moved(place, self._attitude_here)

    def _body_here(self, body: TargetBody) -> TargetBody:
        return replace(
            body,
            position=self._place_here(body.position, 0.0),
            quaternion_xyzw=self._attitude_here(body.quaternion_xyzw),
            linear_velocity=self._velocity_here(body.linear_velocity),
            angular_velocity=self._vector_here(body.angular_velocity, _OTHER),
        )

    def _obstacle_here(self, one: Obstacle) -> Obstacle:
        place = self._place_here(one.motion.position, 0.0)
        velocity = self._velocity_here(one.motion.velocity)
        if one.is_sphere and one.body is None:  # there may be a thousand, none with an attitude
            there: Obstacle = SphereEntry(one.id, place, one.radius, velocity).made()
            return there
        return one.with_motion(
            position=place,
            quaternion_xyzw=self._attitude_here(one.motion.quaternion_xyzw),
            velocity=velocity,
            angular_velocity=self._vector_here(one.motion.angular_velocity, _OTHER),
        )

    def _place_here(self, point: Array, time: float) -> Array:
        # Subtracted before anything is multiplied: far away a rotation would cost the last digits.
        return self._vector_here((point - self.origin) - self.velocity * time, _PLACE)

    def _velocity_here(self, velocity: Array) -> Array:
        return self._vector_here(velocity - self.velocity, _SPEED)

    def _vector_here(self, vector: Array, grid: float) -> Array:
        return _rounded(vector @ self.rotation, grid)

    def _attitude_here(self, quaternion_xyzw: Array) -> Array:
        attitude = quaternion_product(quaternion_inverse(self.quaternion_xyzw), quaternion_xyzw)
        return _rounded(canonical_quaternion(attitude), _OTHER)


def system_frame(robot: Robot, state: SystemState) -> SystemFrame:
    """Return the frame of a system's centre of mass, with the chaser's axes at time zero.

    Args:
        state: State of the system at time zero, in the user's frame.
    """
    quaternion = state.quaternion_chaser_to_inertial_xyzw
    axes = pin.Quaternion(quaternion).toRotationMatrix()
    # Relative to the chaser, so that no digit is lost to where the system is or how fast it moves.
    beside_chaser = replace(
        state,
        position_chaser_in_inertial=np.zeros(3),
        quaternion_chaser_to_inertial_xyzw=np.array([0.0, 0.0, 0.0, 1.0]),
        linear_velocity_chaser_in_inertial=np.zeros(3),
        angular_velocity_chaser_in_inertial=_rounded(
            state.angular_velocity_chaser_in_inertial @ axes, _OTHER
        ),
    )
    model, data = robot.model, robot.model.createData()
    pin.centerOfMass(model, data, *configuration(robot, beside_chaser))
    place, velocity = data.com[0], data.vcom[0]
    return SystemFrame(
        origin=state.position_chaser_in_inertial + axes @ place,
        velocity=state.linear_velocity_chaser_in_inertial + axes @ velocity,
        quaternion_xyzw=quaternion,
        start=replace(
            beside_chaser,
            position_chaser_in_inertial=-place,
            linear_velocity_chaser_in_inertial=-velocity,
        ),
    )


def in_own_frame(problem: PlanningProblem) -> PlanningProblem:
    """Return a problem in the `system_frame` of its start."""
    return system_frame(problem.robot, problem.start).problem(problem)


def _rounded(values: Array, grid: float) -> Array:
    rounded: Array = np.rint(values / grid) * grid
    return rounded


def _with_motion(plan: Plan, seen: Callable[..., tuple[Array, ...]]) -> Plan:
    """Return a plan with poses and twists of chaser and end effector as they are seen."""
    motion, arrays = plan.trajectory, dict[str, Array]()
    quantities = ("positions", "quaternions_xyzw", "linear_velocities", "angular_velocities")
    for part in ("chaser", "ee"):
        names = [f"{part}_{quantity}" for quantity in quantities]
        values = seen(motion.time, *(getattr(motion, name) for name in names))
        arrays |= dict(zip(names, values, strict=True))
    return replace(plan, trajectory=replace(motion, **arrays))
