"""The planner without its compiled core: the references by numpy, Pinocchio and Coal in its place.

    with core_by_reference():
        plan = perform(task)

This is what the planner was before there was a core. Whatever the search still asked of the core is
refused, so that nothing but the references makes the plan; but it solves the quadratic programs.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import partialmethod
from typing import Any, cast
from unittest.mock import patch

import numpy as np
import reference_clearance
import reference_distance_rows
import reference_end_effector
import reference_goal_rows
import reference_program
from reference_joint_spline import ReferenceMotion, reference_motion, reference_sensitivity
from reference_velocity_map import VelocityMap, stacked

from ff_planner_ros.common.arrays import Array, Indices
from ff_planner_ros.core import compiled, velocity_map
from ff_planner_ros.core.conversions import sphere_arrays
from ff_planner_ros.planning.distance import clearance, search_certificate
from ff_planner_ros.planning.distance.bodies import centers_in_base, placed_bodies
from ff_planner_ros.planning.distance.body_certificate import (
    least_pair_distance,
    least_sphere_distance,
)
from ff_planner_ros.planning.distance.body_distances import (
    Distances,
    pair_bounds,
    pair_distances,
    pair_gradients,
    sphere_bounds,
    sphere_distances,
    sphere_gradients,
)
from ff_planner_ros.planning.distance.clearance import centers_at
from ff_planner_ros.planning.motion import followed_path
from ff_planner_ros.planning.motion.followed import FollowedMotion, followed
from ff_planner_ros.planning.motion.joint_motion import JointMotion
from ff_planner_ros.planning.optimisation.program import PathProgram
from ff_planner_ros.planning.paths import joint_spline
from ff_planner_ros.planning.paths.end_effector_polynomial import EndEffectorPaths
from ff_planner_ros.planning.paths.joint_spline import JointSplines
from ff_planner_ros.planning.paths.path_family import JointHull, Motion, Sensitivity
from ff_planner_ros.planning.problem.problem import PlanningProblem, Sphere
from ff_planner_ros.planning.requirements import singular_values
from ff_planner_ros.planning.requirements.body_rows import OF_INTEREST, times_looked_at
from ff_planner_ros.planning.requirements.requirement import OF_INTEREST as LINES_OF_INTEREST
from ff_planner_ros.planning.requirements.requirement import Requirement, Rows
from ff_planner_ros.robot.model import Robot
from ff_planner_ros.robot.momentum import smallest_singular_values

# Derivatives of singular values by central differences so wide [rad] are exact to nine digits.
_ASIDE = 1e-5


@contextmanager
def core_by_reference() -> Iterator[None]:
    """Let the planner compute by the references, and by nothing of the core.

    A duration that the planner chooses has no reference.
    """
    with ExitStack() as stack:
        for family, motion, sensitivity in (
            (EndEffectorPaths, _end_effector_motion, reference_end_effector.sensitivity),
            (JointSplines, _spline_motion, _spline_sensitivity),
        ):
            stack.enter_context(patch.object(family, "motion", motion))
            stack.enter_context(patch.object(family, "sensitivity", sensitivity))
        evaluate = partialmethod(reference_program.linearise, distances_of=_distances)
        stack.enter_context(patch.object(PathProgram, "evaluate", evaluate))
        for original, by_reference in (
            (velocity_map.velocity, _velocity),
            (
                clearance.arm_points_with_derivatives,
                reference_clearance.arm_points_with_derivatives,
            ),
            (search_certificate.search_certificate, reference_clearance.search_certificate),
            (search_certificate.search_pair_distance, _pair_distance),
            (search_certificate.search_sphere_distance, _sphere_distance),
            (followed_path.followed_path, _followed),
        ):
            _replace_everywhere(stack, original, by_reference)
        # Those that take the robot as the core has it: they are given the robot itself.
        for module in (reference_goal_rows, singular_values):
            stack.enter_context(patch.object(module, "chain_of", _itself))
        kept = {
            "smallest_singular_values": _singular_values,
            # test_core_subproblem.py and test_solver.py have their truth.
            "solve_subproblem": compiled.solve_subproblem,
            "minimise": compiled.minimise,
        }
        for name in _functions():
            stack.enter_context(patch.object(compiled, name, kept.get(name, _refuse)))
        yield


def _functions() -> list[str]:
    """Return the core's functions and what it makes; the other classes only hold numbers."""
    functions = [name for name in vars(compiled) if name[0].islower()]
    return [*functions, "DrivenMotion"]


def _refuse(*_: object, **__: object) -> None:
    raise AssertionError("the search asked the core")


def _itself(one: Any, *_: object) -> Any:
    return one


def _replace_everywhere(
    stack: ExitStack, original: Callable[..., Any], by: Callable[..., Any]
) -> None:
    """Replace a function in every module of the package that has imported it."""
    for module in [
        m for name, m in sys.modules.items() if name.startswith(("ff_planner_ros", "reference_"))
    ]:
        for name in [name for name, value in vars(module).items() if value is original]:
            stack.enter_context(patch.object(module, name, by))


def _end_effector_motion(
    self: EndEffectorPaths, x: Array, points: int, damping: float = 0.0
) -> Motion:
    found = reference_end_effector.motion(self, x, points, damping)
    if not isinstance(found, float):
        return found
    return Motion(x=x, q=x, v=x, q_half_way=x, goal_error=x[:0], singular_at=found)


@dataclass(frozen=True, eq=False, kw_only=True)
class _SplineMotion(Motion):
    reference: ReferenceMotion


def _spline_motion(self: JointSplines, x: Array, points: int, _: float = 0.0) -> Motion:
    found, controls = reference_motion(self, x, points), self.control_points(x)
    return _SplineMotion(
        x=x,
        q=found.q,
        v=found.v,
        q_half_way=found.q_half_way,
        goal_error=found.goal_error,
        hull=JointHull(*(matrix @ controls for matrix in joint_spline._hulls(self.basis))),
        reference=found,
    )


def _spline_sensitivity(self: JointSplines, motion: Motion, _: float = 0.0) -> Sensitivity:
    found = reference_sensitivity(self, cast(_SplineMotion, motion).reference)
    return replace(found, hull=joint_spline._hulls_by_x(self.basis, self.robot.joints, self.ending))


def _velocity(
    robot: Robot,
    q: Array,
    momentum: Array,
    twist_ee_in_inertial: Array,
    bias: Array | None = None,
    damping: float = 0.0,
) -> velocity_map.Velocity | None:
    there = VelocityMap(robot, damping)
    solution = there.regular(q, momentum, twist_ee_in_inertial, bias)
    if solution is None:
        return None
    at = stacked([solution])
    return velocity_map.Velocity(
        solution.v, *(of[0] for of in there.derivatives(at)), there.of_bias(at)[0]
    )


def _followed(problem: PlanningProblem, q: Array, v: Array, acceleration: Array) -> FollowedMotion:
    every = followed_path.points_per_sample(len(q), problem.points)
    time = np.linspace(0.0, 1.0, len(q[::every])) * problem.duration
    samples = (rows[::every] for rows in (q[:, 7:], v[:, 6:], acceleration[:, 6:]))
    return followed(problem.robot, q[0], v[0], JointMotion(time, *samples), 2 * every)


def _pair_distance(*question: Any) -> float:
    return least_pair_distance(*question).certified


def _sphere_distance(*question: Any) -> float:
    return least_sphere_distance(*question).certified


def _distances(
    program: PathProgram, required: Requirement, motion: Motion, sensitivity: Sensitivity
) -> Rows:
    """Return what `distances_of_core` does, where all obstacles are spheres."""
    assert sensitivity.goal_motion is None
    problem, has_quarters = program.problem, reference_distance_rows.quarters(motion)
    q, by_x = (np.concatenate([of.q[1:], of.q_half_way]) for of in (motion, sensitivity))
    if required.name == "clearance":
        times = times_looked_at(problem.duration, len(motion.q))
        asked = problem.spheres, LINES_OF_INTEREST, has_quarters
        return Rows(*reference_clearance.clearance_rows(problem.robot, q, by_x, times, *asked))
    times, q = reference_distance_rows.looked_at(problem, motion)
    at = np.arange(len(by_x) / 2)
    by_x = by_x[np.argsort(np.append(at + 0.5, at))]
    if has_quarters:
        by_x = reference_distance_rows.with_quarters(by_x)
    if required.name == "self_clearance":
        return _pair_rows(problem.robot, q, by_x)
    assert required.name == "body_clearance"
    return _sphere_rows(problem.robot, q, by_x, times, problem.spheres)


def _pair_rows(robot: Robot, q: Array, by_x: Array) -> Rows:
    placed = placed_bodies(robot, q[:, 7:])
    bounds = pair_bounds(robot, placed)
    rows = np.nonzero(bounds < OF_INTEREST)
    found, rows = _of_interest(pair_distances(robot, placed, rows), rows)
    gradients = pair_gradients(robot, placed, found, rows)
    jacobian = np.einsum("rj,rjx->rx", gradients, by_x[rows[0], 6:])
    return Rows(found.distance, jacobian, np.ravel_multi_index(rows, bounds.shape))


def _sphere_rows(
    robot: Robot, q: Array, by_x: Array, times: Array, spheres: Sequence[Sphere]
) -> Rows:
    placed, centers = (
        placed_bodies(robot, q[:, 7:]),
        centers_in_base(q, centers_at(times, spheres)),
    )
    radii = sphere_arrays(spheres)[2]
    bounds = sphere_bounds(robot, placed, centers, radii)
    rows = np.nonzero(bounds < OF_INTEREST)
    found, rows = _of_interest(sphere_distances(robot, placed, centers, radii, rows), rows)
    gradients = sphere_gradients(robot, placed, found, rows)
    jacobian = np.einsum("rj,rjx->rx", gradients, by_x[rows[0]])
    return Rows(found.distance, jacobian, np.ravel_multi_index(rows, bounds.shape))


def _of_interest(
    found: Distances, rows: tuple[Indices, ...]
) -> tuple[Distances, tuple[Indices, ...]]:
    near = found.distance < OF_INTEREST
    return Distances(*(part[near] for part in found)), tuple(row[near] for row in rows)


def _singular_values(
    robot: Robot, joints: Array, _: Sequence[int], __: float
) -> tuple[Array, Array]:
    """Return them by Pinocchio; they depend on the joints alone.

    The core leaves out derivatives of those above its last argument; here all are found.
    """
    q = np.zeros((len(joints), 7 + robot.joints))
    q[:, 6], q[:, 7:] = 1.0, joints
    nudges = np.zeros((2, robot.joints, q.shape[1]))
    nudges[:, :, 7:] = _ASIDE * np.array([-np.eye(robot.joints), np.eye(robot.joints)])
    beside = (q[:, None, None] + nudges).reshape(-1, q.shape[1])
    at_both = smallest_singular_values(robot, beside).reshape(len(q), 2, robot.joints)
    return smallest_singular_values(robot, q), (at_both[:, 1] - at_both[:, 0]) / (2.0 * _ASIDE)
