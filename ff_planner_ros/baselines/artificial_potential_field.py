"""The artificial potential field: the paper's second baseline, Sec. 4.1.

A reference for the end effector, of unit mass, moves under the field's forces; Eq. (31) maps its
twist to the joints. Nothing ensures that it arrives: it may come to rest in a local minimum, run
out of time or be pushed into an obstacle. The plan then says so.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ff_planner_ros.baselines.potential_field import (
    PotentialFieldParameters,
    attraction,
    repulsion,
)
from ff_planner_ros.common.arrays import Array
from ff_planner_ros.core.velocity_map import velocity
from ff_planner_ros.planning.check.preconditions import require_plannable
from ff_planner_ros.planning.motion.metrics import Metrics
from ff_planner_ros.planning.motion.plan import Plan, SolverReport
from ff_planner_ros.planning.motion.runge_kutta import runge_kutta_step
from ff_planner_ros.planning.paths.path_family import singular_refusal
from ff_planner_ros.planning.problem.problem import PlanningProblem
from ff_planner_ros.planning.problem.settings import PlannerSettings
from ff_planner_ros.planning.search.candidate import plan_of_motion
from ff_planner_ros.planning.search.families import require_papers_paths
from ff_planner_ros.robot.configuration import configuration
from ff_planner_ros.robot.momentum import total_momentum

# On the way to the goal, damping balances the attraction. In a local minimum, repulsion does, and
# damping balances less than this part.
_HELD = 0.1


def artificial_potential_field(
    problem: PlanningProblem, settings: PlannerSettings, parameters: PotentialFieldParameters
) -> Plan:
    """Return the motion in the field, not yet checked; `solver.stop_reason` says how it ended.

    Raises:
        InvalidInput: The start violates a constraint, or the field does not apply to the arm, its
            base or the target.
        NoPlanFound: The goal is out of reach, or the motion meets a dynamic singularity.
    """
    require_papers_paths(problem, "method", "APF", "only the planner itself will do")
    require_plannable(problem, settings)
    q, v = configuration(problem.robot, problem.start)
    momentum = total_momentum(problem.robot, problem.robot.model.createData(), q, v)
    motion = _Motion(problem, parameters, momentum)
    interval = problem.duration / (problem.points - 1)
    pieces = int(np.ceil(interval / parameters.longest_step))
    twist = motion.twist_ee(q, v)
    samples = [motion.at(0.0, q, twist)]
    for point in range(problem.points - 1):
        for piece in range(pieces):
            time = (point + piece / pieces) * interval
            q, twist = motion.advanced(time, interval / pieces, q, twist)
        samples.append(motion.at((point + 1) * interval, q, twist))
    report = SolverReport(starts=1, iterations=0, rollouts=1, optimality=np.inf, stop_reason="")
    plan, _ = plan_of_motion(
        problem,
        settings,
        np.array([sample.q for sample in samples]),
        np.array([sample.v for sample in samples]),
        np.array([sample.acceleration for sample in samples]),
        report,
    )
    endings = "; ".join(_endings(problem, settings, plan.metrics, samples[-1]))
    report = replace(report, stop_reason=f"artificial potential field: {endings}")
    return replace(plan, solver=report)


class _Sample(NamedTuple):
    """The motion at one time."""

    q: Array  # configuration; shape (7 + joints,)
    v: Array  # tangent velocity; shape (6 + joints,)
    acceleration: Array  # dv/dt; shape (6 + joints,)
    attraction: Array  # of the end effector; like the next two, linear, angular, shape (6,)
    repulsion: Array  # of the end effector
    damping: Array  # of the end effector, relative to the goal's own motion
    nearest: str  # name of the obstacle that is nearest to the arm; empty if there is none

    @property
    def force(self) -> Array:
        """The acceleration of the end effector's reference. Shape (6,)."""
        total: Array = self.attraction + self.repulsion + self.damping
        return total


class _Motion:
    """The equations of motion of configuration and end-effector twist in the field."""

    def __init__(
        self, problem: PlanningProblem, parameters: PotentialFieldParameters, momentum: Array
    ) -> None:
        self._problem, self._parameters, self._momentum = problem, parameters, momentum
        self._data = problem.robot.model.createData()
        target = problem.target
        self._goal_rotation = pin.Quaternion(target.quaternion_xyzw).toRotationMatrix()
        self._goal_twist = np.concatenate([target.linear_velocity, target.angular_velocity])

    def twist_ee(self, q: Array, v: Array) -> Array:
        """Return the end effector's twist in inertial axes. Shape (6,)."""
        robot = self._problem.robot
        pin.forwardKinematics(robot.model, self._data, q, v)
        frame, axes = robot.tip_frame_id, pin.LOCAL_WORLD_ALIGNED
        return np.array(pin.getFrameVelocity(robot.model, self._data, frame, axes).vector)

    def at(self, time: float, q: Array, twist: Array) -> _Sample:
        """Return velocities, accelerations and forces at one time.

        Raises:
            NoPlanFound: The posture is a dynamic singularity.
        """
        problem, parameters = self._problem, self._parameters
        solution = velocity(problem.robot, q, self._momentum, twist)
        if solution is None:
            raise singular_refusal(time, problem.duration)
        push, distance = repulsion(problem, parameters, time, q, solution.by_twist)
        pull = attraction(self._offset(time, q), parameters)
        drag = -parameters.damping * (twist - self._goal_twist)
        names = [one.id for one in problem.obstacles if one.is_sphere]
        nearest = names[int(distance.min(axis=0).argmin())] if names else ""
        acceleration = solution.by_q @ solution.v + solution.by_twist @ (pull + push + drag)
        return _Sample(q, solution.v, acceleration, pull, push, drag, nearest)

    def advanced(self, time: float, step: float, q: Array, twist: Array) -> tuple[Array, Array]:
        """Return configuration and twist one step later, both by Runge-Kutta of order four."""
        forces: list[Array] = []

        def at_stage(stage: int, there: Array) -> Array:
            part = (0.0, 0.5, 0.5, 1.0)[stage] * step
            sample = self.at(time + part, there, twist + part * forces[-1] if forces else twist)
            forces.append(sample.force)
            return sample.v

        model = self._problem.robot.model
        way = runge_kutta_step(model, q, step, at_stage)
        f1, f2, f3, f4 = forces
        return pin.integrate(model, q, way), twist + step / 6 * (f1 + 2 * (f2 + f3) + f4)

    def _offset(self, time: float, q: Array) -> Array:
        """Return the way to the moving goal: position [m] and rotation vector [rad], inertial."""
        robot, left = self._problem.robot, self._problem.duration - time
        pin.forwardKinematics(robot.model, self._data, q)
        ee = pin.updateFramePlacement(robot.model, self._data, robot.tip_frame_id)
        position = self._problem.target.position - left * self._goal_twist[:3]
        rotation = pin.exp3(-left * self._goal_twist[3:]) @ self._goal_rotation
        return np.concatenate([position - ee.translation, pin.log3(rotation @ ee.rotation.T)])


def _endings(
    problem: PlanningProblem, settings: PlannerSettings, metrics: Metrics, last: _Sample
) -> Iterator[str]:
    """Yield in words how the motion ended, the most harmful first."""
    if not metrics.min_clearance >= 0.0:
        yield "collision: the repulsion did not keep the arm out of the obstacles"
    if not metrics.final_position_error <= settings.position_tolerance:
        missed = slice(3)
    elif not metrics.final_orientation_error <= settings.orientation_tolerance:
        missed = slice(3, 6)
    else:
        yield "the goal is reached"
        return
    left = (
        f"{metrics.final_position_error:.3g} m and {metrics.final_orientation_error:.3g} rad "
        f"from the goal after {problem.duration:g} s"
    )
    drag, pull = last.damping[missed], last.attraction[missed]
    if -drag @ pull < _HELD * (pull @ pull):
        yield (
            "local minimum: repulsion holds the attraction, the nearest obstacle is "
            f"{last.nearest}; the end effector comes no nearer, {left}"
        )
    else:
        yield f"time out: the end effector is still under way, {left}"
